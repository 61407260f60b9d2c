"""Steps with joints pressed against stops, and an independent solution of them."""

from dataclasses import replace
from functools import cache
import json
import warnings

from kane_dynamics import box, ComputedTorque, ModelBuilder, Motion, Robot, simulate
from kane_dynamics._util.resources import resource_path
from kane_dynamics.cli import main
from kane_dynamics.model.model import Limits
from kane_dynamics.simulation.stepper import compile_row_steps
from kinds_of_mechanism import case
from linkages import four_bar_model, PIN
import numpy as np
import pytest
from readable_stops import pressed_step

PRESSED = {'tree': 'upper', 'chosen speeds': 'fore', 'closed loop': 'rocker',
           'nonholonomic': 'cart/x', 'time-dependent': 'upper', 'flexible': 'fore',
           'free and ball joints': 'upper'}


def pressing(kind):
    """Return a robot with a stop ahead of a joint, its state, pressing torques."""
    one = case(kind)
    robot = one.robot.copy()
    joint = robot.coordinate_names.index(PRESSED[kind])
    push = np.array(
        [robot.joint_rates(one.q, x, **one.t)[joint] for x in np.eye(robot.n)])
    push = push - robot.joint_rates(one.q, np.zeros(robot.n), **one.t)[joint]
    upper = np.full(robot.n_q, np.inf)
    upper[joint] = one.q[joint] + 0.005
    robot.limits = replace(robot.limits, lower=np.full(robot.n_q, -np.inf), upper=upper)
    held = robot.gravity_force(one.q, **one.t)
    return robot, one, joint, held + 60.0 * push / np.abs(push).max()


@pytest.mark.parametrize('integrator', ['rk4', 'implicit'])
@pytest.mark.parametrize('kind', PRESSED)
def test_joints_that_press_move_as_an_independent_solution_says(kind, integrator):
    robot, one, joint, tau = pressing(kind)
    step = 1e-4 if kind == 'flexible' else 1e-3
    options = {'torque': tau, 't0': one.time, 'stops': True, 'integrator': integrator}
    with warnings.catch_warnings():
        warnings.simplefilter('error')  # the energy balance closes
        hit = simulate(robot, one.q, 0.1 * one.u, 60 * step, step=step, **options)
        t, q, u = hit.t[-1], hit.q[-1], hit.u[-1]
        run = simulate(robot, q, u, 40 * step, step=step, sample=step,
                       **{**options, 't0': t})
    assert [event.joint for event in hit.stop_events] == [PRESSED[kind]]
    upper = robot.limits.upper[joint]
    np.testing.assert_allclose(run.q[:, joint], upper, rtol=0.0, atol=1e-10)
    assert not run.stop_events
    side = np.zeros(robot.n_q)
    side[joint] = 1.0
    for t_end, q_end, u_end in zip(run.t[1:], run.q[1:], run.u[1:]):
        q, u = pressed_step(robot, tau, side, integrator, q, u, t, step)
        t = t_end
        scale = max(1.0, np.abs(u_end).max())
        np.testing.assert_allclose(q_end, q, rtol=1e-8, atol=1e-9)
        np.testing.assert_allclose(u_end, u, rtol=1e-7, atol=1e-7 * scale)


def test_a_joint_leaves_its_stop_when_pulled_and_computed_torque_presses_it():
    robot, one, joint, tau = pressing('closed loop')
    at_rest = 0.0 * one.u
    away = np.concatenate([np.tile(tau, (100, 1)), np.tile(-tau, (100, 1))])
    run = simulate(robot, one.q, at_rest, 0.2, torque=away, stops=True)
    assert len(run.stop_events) == 1
    assert run.q[-1, joint] < robot.limits.upper[joint] - 1e-3
    assert run.q[100, joint] == pytest.approx(robot.limits.upper[joint], abs=1e-10)
    name = robot.speed_names[0]
    k = robot.coordinate_names.index(name)
    ahead = np.sign(robot.joint_rates(one.q, [1.0])[joint])
    motion = Motion.from_points([0.0, 0.1], [[one.q[k]], [one.q[k] + 0.5 * ahead]],
                                joint_names=[name])
    run = simulate(robot, one.q, at_rest, 0.2,
                   stops=True, torque=ComputedTorque(robot, motion))
    np.testing.assert_allclose(run.q[-1, joint], robot.limits.upper[joint], atol=1e-10)
    assert not run.warnings


@cache
def chain():
    """Return three links on pivots with stops."""
    b = ModelBuilder('chain')
    on = 'world'
    for k in range(3):
        b.body(f'j{k}', on, axis=(0, 1, 0), at=(0.3 if k else 0.0, 0, 0), inertial=box(
            2.0, (0.3, 0.05, 0.05), at=(0.15, 0, 0)),
               limits=Limits(-0.1, 0.1, 100.0, 1e9))
        on = f'j{k}'
    return Robot(b.model())


@pytest.mark.parametrize('integrator', ['rk4', 'implicit'])
def test_the_torque_that_presses_a_joint_does_not_change_the_impacts_of_others(
        integrator):
    """A fixed joint takes every torque: only the motion of the others counts."""
    one, other_run = (simulate(chain(), [0.1, 0.05, -0.02], [0.0, 1.0, -2.0], 0.1,
                               stops=True, torque=[tau, 0.0, 0.0], integrator=integrator,
                               sample=1e-3) for tau in (60.0, 1e6))
    assert len(one.stop_events) == 3 and not other_run.warnings
    assert [e[1:3] for e in one.stop_events] == [e[1:3] for e in other_run.stop_events]
    np.testing.assert_allclose(*([(e.t, e.speed, e.loss) for e in run.stop_events]
                                 for run in (one, other_run)), rtol=1e-8)
    np.testing.assert_allclose(one.q, other_run.q, rtol=0.0, atol=1e-9)
    assert (np.diff(other_run.energy.sum(axis=1)) < 1e-9).all(), 'stops take energy'


@pytest.mark.parametrize('independent', ['crank', 'rocker'])
def test_stops_take_energy_in_a_loop_whose_motor_presses_without_measure(independent):
    robot = Robot(four_bar_model(), constraints=[PIN], independent=[independent],
                  friction=False)
    q0 = robot.closed_configuration((0.5, 0.0, -1.5), fixed=['crank'])
    robot.limits = replace(robot.limits, lower=np.full(3, -np.inf),
                           upper=np.array([q0[0] + 0.2, np.inf, q0[2]]))
    k = robot.coordinate_names.index(independent)
    run = simulate(robot, q0, [0.0], 0.05, stops=True, torque=[1e6], sample=1e-3)
    np.testing.assert_allclose(run.q, np.broadcast_to(run.q[0], run.q.shape), atol=1e-9)
    assert not run.warnings and np.isfinite(run.q[:, k]).all()


def test_joints_that_hardly_press_stay_at_rest_beside_one_that_presses_much():
    b = ModelBuilder('gripper')
    b.body('arm', axis=(0, 0, 1), inertial=box(5.0, (0.5, 0.1, 0.1), at=(0.2, 0, 0)),
           limits=Limits(-1.0, 0.5, 10.0, 1e9))
    for k in range(2):
        b.body(f'finger{k}', 'arm', 'prismatic', axis=(1, 0.1 * k, 0),
               at=(0.5, 0.01 * k, 0), inertial=box(0.05, (0.02, 0.01, 0.05)),
               limits=Limits(0.0, 0.04, 1.0, 50.0))
    run = simulate(Robot(b.model()), [0.5, 0.0, 0.0], np.zeros(3), 0.02, stops=True,
                   torque=[1e6, -1e-6, -1e-7])
    assert not (run.u.any() or run.stop_events or run.warnings)
    np.testing.assert_array_equal(run.q, run.q[:1].repeat(len(run.q), axis=0))


def row_kernels(robot):
    """Return what tells apart the kernels of rows that a robot has compiled."""
    return {place for place in robot.kernels._made if place[0].startswith('row')}


def test_kernels_compiled_in_advance_are_those_of_a_simulation():
    robot, one, _, tau = pressing('closed loop')
    compile_row_steps(robot, 'rk4', [robot.coordinate_names.index(robot.speed_names[0])],
                      stops=True, sticking=False)
    compiled = row_kernels(robot)
    run = simulate(robot, one.q, one.u, 0.1, torque=tau, stops=True)
    assert run.stop_events
    assert compiled and row_kernels(robot) == compiled


def test_the_command_line_has_stops(capsys):
    asked = ['simulate', str(resource_path('urdf', 'two_link.urdf')), '--duration', '1',
             '--torque', '0', '15']
    assert main([*asked, '--json']) == 0
    assert json.loads(capsys.readouterr().out)['stop_events'] == []
    assert main([*asked, '--json', '--stops']) == 0
    held = json.loads(capsys.readouterr().out)
    assert 'hits its upper stop' in held['stop_events'][0]
    assert held['q'][1] <= 2.8
    assert main([*asked, '--stops']) == 0
    assert held['stop_events'][0] in capsys.readouterr().out
