"""Feedforward of bending arms: equilibrium of deflections, better tracking."""

from functools import cache

import energies
from examples.flexible_four_bar import flexible_four_bar
from kane_dynamics import (Controller, FlexibleLink, InputError, load_urdf, ModelBuilder,
                           Motion, QuasiStatic, Robot, simulate, stiffened)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.cli import main
from kane_dynamics.control.controller import OWN_MODES
from kane_dynamics.control.terms import Mode, Terms
from kane_dynamics.loop_tracking.loop_tracker import LoopTracker
from kane_dynamics.mechanics.definition import kane, nonholonomic
from kane_dynamics.robot.robot import TORQUE_TERMS
import numpy as np
from palletizer import bending_palletizer, DRIVEN, positions
import pytest
import yaml

URDF = resource_path('urdf', 'two_link.urdf')
BENDING = resource_path('urdf', 'two_link.bending.yaml')


@cache
def flexible():
    return Robot(load_urdf(URDF, supplement=BENDING))


@cache
def bending():
    return QuasiStatic(flexible())


def test_a_model_with_rigid_beams_is_that_of_no_modes():
    model = stiffened(flexible().model)
    data = yaml.safe_load(BENDING.read_text())
    for beam in data['beams'].values():
        beam['modes'] = 0
        beam.get('torsion', {})['modes'] = 0
    other_model = load_urdf(URDF, supplement=data)
    assert model.joint_names == other_model.joint_names == bending().joint_names
    assert not model.flexible and len(model.bodies) == 2
    assert [f.name for f in model.frames] == [f.name for f in other_model.frames]
    state = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 2))
    np.testing.assert_allclose(kane.inverse_dynamics(model, *state),
                               kane.inverse_dynamics(other_model, *state), rtol=1e-12)
    for name in ('link2', 'tip', 'link1/tip'):
        np.testing.assert_allclose(Robot(model).frame_pose(name, state[0]),
                                   Robot(other_model).frame_pose(name, state[0]),
                                   atol=1e-12)


def test_doctor_lists_joints_without_modes(capsys):
    main(['doctor', str(URDF), '--supplement', str(BENDING)])
    printed = capsys.readouterr().out
    assert 'joint1' in printed and 'mode_1' not in printed


def test_modes_are_in_equilibrium_by_the_definition():
    model = flexible().model
    q, u, udot = np.random.default_rng(1).uniform(-1.0, 1.0, (3, 4, 2))
    modes = bending().modes(q, u, udot)
    tau = bending().inverse_dynamics(q, u, udot)
    terms = bending().torque_terms(q, u, udot)
    assert np.abs(modes).max() > 0.003
    for k in range(4):
        whole = [np.append(q[k], modes[k]), np.append(u[k], np.zeros(5)),
                 np.append(udot[k], np.zeros(5))]
        expected = kane.inverse_dynamics(model, *whole)
        np.testing.assert_allclose(expected[2:], 0.0, atol=1e-8)
        np.testing.assert_allclose(tau[k], expected[:2], rtol=1e-9)
        np.testing.assert_allclose(terms[k].sum(axis=0), expected[:2], rtol=1e-9)
    still = bending().modes(q[0], np.zeros(2), np.zeros(2))
    force = energies.conservative_force(model, np.append(q[0], still))
    np.testing.assert_allclose(force[2:], 0.0, atol=1e-8)
    np.testing.assert_allclose(bending().gravity_force(q[0]), -force[:2], rtol=1e-9)


def rigid_four_bar():
    """Return the rigid model of the flexible four-bar, driven by its crank."""
    flexible = flexible_four_bar()
    return Robot(stiffened(flexible.model), constraints=flexible.mechanism.constraints,
                 independent=['crank'])


def test_modes_of_closed_loops_are_in_equilibrium_by_the_definition():
    flexible, rigid = bending_palletizer()
    bent = QuasiStatic(flexible)
    mechanism = flexible.mechanism
    assert (bent.joint_names, bent.speed_names) == (rigid.joint_names, DRIVEN)
    rng = np.random.default_rng(2)
    driven = rng.uniform((-0.5, 0.0, -0.4, -1.0), (0.5, 0.4, 0.2, 1.0), (3, 4))
    u, udot = rng.uniform(-1.0, 1.0, (2, 3, 4))
    q = np.array([positions(rigid, *row) for row in driven])
    eta = bent.modes(q, u, udot)
    tau = bent.inverse_dynamics(q, u, udot)
    terms = bent.torque_terms(q, u, udot)
    gravity = bent.gravity_force(q)
    still = 0.0 * u
    assert (np.abs(eta) > 1e-4).all()
    for k in range(3):
        whole = flexible.closed_configuration(np.append(q[k], eta[k]),
                                              fixed=flexible.speed_names)
        moved = [rigid.joint_names.index(name) for name in DRIVEN]
        np.testing.assert_allclose(whole[moved], q[k, moved], atol=1e-12)
        state = (np.append(x[k], np.zeros(2)) for x in (u, udot))
        expected = nonholonomic.inverse_dynamics(mechanism, whole, *state)
        np.testing.assert_allclose(expected[4:], 0.0, atol=1e-6)  # of 1000 N
        np.testing.assert_allclose(tau[k], expected[:4], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(terms[k].sum(axis=0), expected[:4],
                                   rtol=1e-9, atol=1e-9)
        start = np.append(q[k], bent.modes(q[k], still[k], still[k]))
        closed = flexible.closed_configuration(start, fixed=flexible.speed_names)
        np.testing.assert_allclose(bent.configuration(q)[k, :len(q[k])],
                                   closed[:len(q[k])], atol=1e-9)
    np.testing.assert_allclose(gravity, bent.inverse_dynamics(q, still, still),
                               rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize('mode', OWN_MODES)
@pytest.mark.parametrize('terms', [Terms(), Terms(coriolis=False, friction=False)])
def test_commands_of_closed_loops_are_those_of_the_deflected_mechanism(mode, terms):
    flexible, rigid = bending_palletizer()
    bent = QuasiStatic(flexible)
    q = positions(rigid, 0.2, 0.3, -0.2, 0.5)
    u = np.array([0.2, -0.1, 0.3, 0.4])
    motion = Motion.from_points([0.0, 1.0],
                                [[0.2, 0.3, -0.2, 0.5], [0.4, 0.2, 0.0, 0.1]],
                                joint_names=DRIVEN)
    law = Controller(rigid, bending=bent, mode=mode, kp=20.0, kd=8.0, compensate=terms)
    tau = law.command(0.1, q, u, motion).tau
    q_d, u_d, udot_d = motion.sample(0.1)
    if mode is Mode.GRAVITY_COMPENSATION:
        expected = bent.gravity_force(q)
    elif mode is Mode.INVERSE_DYNAMICS:
        expected = terms.weights @ bent.torque_terms(positions(rigid, *q_d), u_d, udot_d)
    else:
        driven = [rigid.joint_names.index(name) for name in DRIVEN]
        udot = udot_d + 8.0 * (u_d - u) + 20.0 * (q_d - q[driven])
        rows = bent.torque_terms(q, u, udot)
        terms_of_model = []
        for k, name in enumerate(TORQUE_TERMS):
            if name != 'friction' and getattr(terms, name, True):
                terms_of_model.append(k)
        expected = rows[terms_of_model].sum(axis=0)
        if terms.friction:
            expected = expected + rigid.torque_terms(q, u_d, 0.0 * u_d)[
                TORQUE_TERMS.index('friction')]
    whole = np.zeros(rigid.n_q)
    whole[[rigid.joint_names.index(name) for name in DRIVEN]] = expected
    np.testing.assert_allclose(tau, whole, rtol=1e-7, atol=1e-7)


def test_feedforward_of_a_flexible_loop_follows_better():
    flexible = flexible_four_bar()
    rigid = rigid_four_bar()
    bent = QuasiStatic(flexible)
    motion = Motion.from_points([0.0, 1.5], [[0.8], [1.4]], [[0.0]] * 2, [[0.0]] * 2,
                                joint_names=['crank'])
    joints = [flexible.joint_names.index(name) for name in rigid.joint_names]
    place = flexible.speed_names.index('crank')
    tracker = LoopTracker(rigid, ['crank'])
    closed = rigid.closed_configuration([0.8, 0.0, -1.5], fixed=['crank'])
    worst = []
    for knows in (None, bent):
        law = Controller(rigid, mode='computed_torque', kp=25.0, kd=10.0, bending=knows)
        tracker.restart(closed)

        def torque(t, q, u, law=law):
            tracker.update(q[joints[:1]], u[place:place + 1])
            tau = np.zeros(3)
            tau[place] = law.command(
                t, tracker.q.copy(), tracker.u.copy(), motion).tau[0]
            return tau
        run = simulate(flexible, bent.configuration(closed), np.zeros(3), 1.5, step=1e-3,
                       torque=torque, sample=0.01)
        desired = np.array([motion.sample(t)[0] for t in run.t])
        worst.append(np.abs(run.q[:, joints[:1]] - desired).max())
    assert worst[1] < 0.5 * worst[0]


def test_feedforward_with_bending_tracks_far_better():
    rigid = Robot(stiffened(flexible().model))
    motion = Motion.from_points([0.0, 1.5, 3.0], [[0.4, 0.3], [0.9, -0.4], [0.2, 0.5]],
                                [[0.0, 0.0]] * 3, [[0.0, 0.0]] * 3,
                                joint_names=rigid.joint_names)
    q_d, u_d, udot_d = motion.sample(0.0)
    start = np.append(q_d, bending().modes(q_d, u_d, udot_d))
    worst = []
    for knows in (None, bending()):
        controller = Controller(rigid, mode='computed_torque', kp=100.0, kd=20.0,
                                bending=knows)

        def torque(t, q, u, controller=controller):
            return np.append(controller.command(t, q[:2], u[:2], motion).tau,
                             np.zeros(5))
        run = simulate(flexible(), start, np.zeros(7), 3.0,
                       step=1e-3, torque=torque, sample=0.01)
        desired = np.array([motion.sample(t)[0] for t in run.t])
        worst.append(np.abs(run.q[:, :2] - desired).max())
    assert worst[1] < 0.2 * worst[0]


def test_an_equilibrium_near_the_stiffness_is_found_though_corrections_grow():
    motion = Motion.from_points([0.0, 0.8, 1.5], [[0.3, -0.4], [0.9, 0.3], [0.5, 0.6]],
                                joint_names=bending().joint_names)
    q, u, udot = motion.sample(np.linspace(0.0, 1.5, 79))
    for row in zip(q, 10.5 * u, 10.5**2 * udot):
        eta = bending().modes(*row)
        state = [np.zeros(flexible().n) for _ in row]
        for whole, part in zip(state, row):
            whole[[flexible().joint_names.index(name)
                   for name in bending().joint_names]] = part
        modes = list(flexible().model.modal_coordinates)
        state[0][modes] = eta
        load = flexible().inverse_dynamics(*state)[modes]
        assert np.abs(load).max() < 1e-6 * np.abs(bending().inverse_dynamics(*row)).max()


@pytest.mark.parametrize('call, words', [
    (lambda: Controller(flexible()),
     'with beams; expected the rigid model, such as stiffened'),
    (lambda: QuasiStatic(Robot(stiffened(flexible().model))),
     'without beams.*; expected one with beams'),
    (lambda: QuasiStatic(Robot(flexible_four_bar().model,
                               independent=['coupler', 'rocker', 'crank'],
                               constraints=flexible_four_bar().mechanism.constraints)),
     'expected the rates of joints and of all modes'),
    (lambda: Controller(rigid_four_bar(), followed=['rocker'],
                        bending=QuasiStatic(flexible_four_bar())),
     r"followed: \['rocker'\]; expected \['crank'\], the independent joints"),
    (lambda: QuasiStatic(flexible_four_bar()).inverse_dynamics(
        np.zeros((2, 3)), np.zeros(1), np.zeros((2, 1))),
     r'u, udot: shapes \(1,\) and \(2, 1\)'),
    (lambda: bending().modes(np.zeros(3), np.zeros(2), np.zeros(2)),
     r'q: shape \(3,\); exp'),
    (lambda: bending().inverse_dynamics(np.zeros(2), [900.0, 0.0], np.zeros(2)),
     'load on the beams of two_link: no equilibrium found'),
    (lambda: Controller(Robot(load_urdf(resource_path('urdf', 'ur10e.urdf'))),
                        bending=bending()),
     "bending: for a robot with joints .'joint1', 'joint2'.*; expected .*'shoulder")])
def test_robots_and_motions_without_a_quasi_static_equilibrium_are_refused(call, words):
    with pytest.raises(InputError, match=words):
        call()


def test_a_clamped_beam_alone_is_refused():
    b = ModelBuilder('cantilever')
    b.beam('beam', 'world',
           FlexibleLink(length=1.0, density=0.8, stiffness=4.0, modes=(2, 0)),
           kind='fixed')
    with pytest.raises(InputError, match='whose only motions are those of beams'):
        QuasiStatic(Robot(b.model()))
