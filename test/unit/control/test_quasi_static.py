"""Feedforward of arms that bend: deflections are in equilibrium, the joints follow better."""

from functools import cache

from examples.flexible_four_bar import flexible_four_bar
from kane_dynamics import (Controller, InputError, load_urdf, Motion, QuasiStatic, Robot, simulate,
                           stiffened)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.cli import main
from kane_dynamics.mechanics.definition import kane
from kane_dynamics.mechanics.energy_form import energies
import numpy as np
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
    other = load_urdf(URDF, supplement=data)
    assert model.joint_names == other.joint_names == bending().joint_names
    assert not model.flexible and len(model.bodies) == 2
    assert [f.name for f in model.frames] == [f.name for f in other.frames]
    state = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 2))
    np.testing.assert_allclose(kane.inverse_dynamics(model, *state),
                               kane.inverse_dynamics(other, *state), rtol=1e-12)
    for name in ('link2', 'tip', 'link1/tip'):
        np.testing.assert_allclose(Robot(model).frame_pose(name, state[0]),
                                   Robot(other).frame_pose(name, state[0]), atol=1e-12)


def test_doctor_speaks_of_joints_alone(capsys):
    main(['doctor', str(URDF), '--supplement', str(BENDING)])
    said = capsys.readouterr().out
    assert 'joint1' in said and 'mode_1' not in said


def test_modes_are_in_equilibrium_by_the_definition():
    model = flexible().model
    q, u, udot = np.random.default_rng(1).uniform(-1.0, 1.0, (3, 4, 2))
    found = bending().modes(q, u, udot)
    tau, terms = bending().inverse_dynamics(q, u, udot), bending().torque_terms(q, u, udot)
    assert np.abs(found).max() > 0.003
    for k in range(4):
        whole = [np.append(q[k], found[k]), np.append(u[k], np.zeros(5)),
                 np.append(udot[k], np.zeros(5))]
        expected = kane.inverse_dynamics(model, *whole)
        np.testing.assert_allclose(expected[2:], 0.0, atol=1e-8)
        np.testing.assert_allclose(tau[k], expected[:2], rtol=1e-9)
        np.testing.assert_allclose(terms[k].sum(axis=0), expected[:2], rtol=1e-9)
    still = bending().modes(q[0], np.zeros(2), np.zeros(2))
    force = energies.conservative_force(model, np.append(q[0], still))
    np.testing.assert_allclose(force[2:], 0.0, atol=1e-8)
    np.testing.assert_allclose(bending().gravity_force(q[0]), -force[:2], rtol=1e-9)


def test_feedforward_that_knows_of_the_bending_follows_far_better():
    rigid = Robot(stiffened(flexible().model))
    motion = Motion.from_points([0.0, 1.5, 3.0], [[0.4, 0.3], [0.9, -0.4], [0.2, 0.5]],
                                [[0.0, 0.0]] * 3, [[0.0, 0.0]] * 3, joint_names=rigid.joint_names)
    q_d, u_d, udot_d = motion.sample(0.0)
    start = np.append(q_d, bending().modes(q_d, u_d, udot_d))
    worst = []
    for knows in (None, bending()):
        controller = Controller(rigid, mode='computed_torque', kp=100.0, kd=20.0, bending=knows)

        def torque(t, q, u, controller=controller):
            return np.append(controller.command(t, q[:2], u[:2], motion).tau, np.zeros(5))
        run = simulate(flexible(), start, np.zeros(7), 3.0, step=1e-3, torque=torque, sample=0.01)
        desired = np.array([motion.sample(t)[0] for t in run.t])
        worst.append(np.abs(run.q[:, :2] - desired).max())
    assert worst[1] < 0.2 * worst[0]


@pytest.mark.parametrize('call, words', [
    (lambda: Controller(flexible()), 'with beams; expected the rigid model, such as stiffened'),
    (lambda: QuasiStatic(Robot(stiffened(flexible().model))),
     'without beams.*; expected one with beams'),
    (lambda: QuasiStatic(flexible_four_bar()), 'in joint rates and without constraints'),
    (lambda: bending().modes(np.zeros(3), np.zeros(2), np.zeros(2)), r'q: shape \(3,\); exp'),
    (lambda: bending().inverse_dynamics(np.zeros(2), [900.0, 0.0], np.zeros(2)),
     'load on the beams of two_link: no equilibrium found'),
    (lambda: Controller(Robot(load_urdf(resource_path('urdf', 'ur10e.urdf'))),
                        bending=bending()),
     "bending: of the joints .'joint1', 'joint2'.; expected .'shoulder")])
def test_what_has_no_equilibrium_is_refused(call, words):
    with pytest.raises(InputError, match=words):
        call()
