"""The implicit integrator with constraints, speeds, time and ball joints."""

from functools import cache
import warnings

from kane_dynamics import (absolute_rates, Closure, ComputedTorque, ConstraintError,
                           longest_step, ModelBuilder, ModelWarning, Motion, Robot, rod,
                           simulate)
from kinds_of_mechanism import case
from linkages import at_angle, four_bar_model, PIN, sleigh, sleigh_path, SPIN
import numpy as np
import pytest
from scipy.integrate import solve_ivp

IDENTIFIED = {'friction': 15.0, 'friction_speed': 0.005, 'damping': 3.0}
SPRUNG = {'stiffness': 1e7, 'damping': 2e3}


@cache
def linkage(**coupler):
    """Return a four-bar with this friction and spring in the joint of its coupler."""
    b = ModelBuilder('four-bar')
    on = 'world'
    at = 0.0
    for name, length in zip(('crank', 'coupler', 'rocker'), (0.3, 0.9, 0.7)):
        b.body(name, on, axis=(0, -1, 0), at=(at, 0, 0),
               inertial=rod(2.0 * length, (0, 0, 0), (length, 0, 0)),
               **(coupler if name == 'coupler' else {}))
        on = name
        at = length
    b.frame('end', on, at=(at, 0, 0))
    b.frame('ground', 'world', at=(1, 0, 0))
    return Robot(
        b.model(), independent=['crank'],
        constraints=[Closure('end', 'ground', 'revolute', axis=(0, 1, 0), name='pin')])


def exact(robot, q, u, tau, duration):
    """Return q and u at the end by another implicit method; loops stay closed."""
    def rates(t, x):
        q = robot.closed_configuration(x[:robot.n_q], fixed=['crank'])
        return np.concatenate([robot.joint_rates(q, x[robot.n_q:]),
                               robot.forward_dynamics(q, x[robot.n_q:], tau)])
    solution = solve_ivp(rates, (0.0, duration), np.concatenate([q, u]), 'BDF',
                         rtol=1e-7, atol=1e-8)
    return solution.y[:robot.n_q, -1], solution.y[robot.n_q:, -1]


@pytest.mark.parametrize('kind', ['chosen speeds', 'closed loop', 'nonholonomic',
                                  'time-dependent', 'free and ball joints'])
def test_half_the_step_leaves_a_quarter_of_the_error(kind):
    one = case(kind)
    robot = one.robot
    # Joints that stop are not smooth.
    if kind in ('chosen speeds', 'free and ball joints'):
        speeds = {'speeds': absolute_rates} if kind == 'chosen speeds' else {}
        robot = Robot(robot.model, friction=False, **speeds)
    arguments = {'torque': np.linspace(1.0, 2.0, robot.n), 't0': one.time}
    exactly = simulate(robot, one.q, one.u, 0.1, step=5e-4, **arguments)
    errors = []
    for step in (4e-3, 2e-3, 1e-3):
        run = simulate(robot, one.q, one.u, 0.1,
                       step=step, integrator='implicit', **arguments)
        assert not run.warnings and run.drift < 1e-9
        errors.append(max(np.abs(run.q[-1] - exactly.q[-1]).max(),
                          np.abs(run.u[-1] - exactly.u[-1]).max()))
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.2)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.2)


def test_a_four_bar_with_identified_friction_moves_rightly_at_a_millisecond():
    robot = linkage(**IDENTIFIED)
    q = at_angle(0.8)
    u = np.array([2.0])
    tau = np.array([40.0])
    assert longest_step(robot, q).step < 1e-4
    q_end, u_end = exact(robot, q, u, tau, 0.5)
    with warnings.catch_warnings():
        warnings.simplefilter('error')  # no step is too long, the energy balance closes
        run = simulate(robot, q, u, 0.5, torque=tau, integrator='implicit')
    assert np.abs(q_end - q).max() > 0.3
    np.testing.assert_allclose(run.q[-1], q_end, atol=1e-3)
    np.testing.assert_allclose(run.u[-1], u_end, rtol=1e-3)
    assert run.drift < 1e-11
    with pytest.warns(ModelWarning, match="too long for 'crank'.*'implicit'"):
        simulate(robot, q, u, 1e-3, torque=tau, integrator='rk4')


def test_a_four_bar_whose_friction_holds_it_stands_as_long_as_one_likes():
    robot = linkage(**IDENTIFIED)
    q = at_angle(0.8)
    tau = robot.gravity_force(q) + 1.0
    run = simulate(robot, q, [0.01], 2.0, step=5e-3, torque=tau, integrator='implicit')
    balance = robot.bias_force(run.q[-1], run.u[-1]) - tau
    assert np.abs(balance).max() < 1e-3 * np.abs(tau).max()
    assert abs(run.u[-1, 0]) < 0.3 * IDENTIFIED['friction_speed']


@pytest.mark.parametrize('step', [1e-3, 1e-1])
def test_a_stiff_spring_in_a_loop_does_not_limit_the_step(step):
    q = at_angle(0.8)
    robot = linkage(rest=float(q[1]), **SPRUNG)
    assert longest_step(robot, q).step < 1e-3
    run = simulate(robot, q, [0.05], 100 * step, step=step, integrator='implicit')
    assert np.abs(run.u[-1]).max() < 1e-4
    at_rest = robot.gravity_force(q) / robot.joint_rates(
        q, [1.0])[1]**2 / SPRUNG['stiffness']
    np.testing.assert_allclose(run.q[-1, 0] - q[0], -at_rest[0], rtol=1e-2)
    assert run.drift < 1e-9


def test_each_of_many_simulations_is_that_alone_and_feedback_follows():
    robot = linkage(**IDENTIFIED)
    q = np.array([at_angle(a) for a in (0.6, 0.8, 1.0)])
    many = simulate(robot, q, np.ones((3, 1)), 0.05, integrator='implicit')
    for k in range(3):
        alone = simulate(robot, q[k], [1.0], 0.05, integrator='implicit')
        np.testing.assert_allclose(many.q[k], alone.q, rtol=1e-9, atol=1e-12)
    motion = Motion.from_points([0.0, 0.5], [[q[1, 0]], [q[1, 0] + 0.5]],
                                joint_names=['crank'])
    damped = linkage(damping=3.0)
    run = simulate(damped, q[1], [0.0], 0.5, integrator='implicit',
                   torque=ComputedTorque(damped, motion, 400.0, 40.0))
    assert np.abs(run.q[:, 0] - motion.sample(run.t)[0][:, 0]).max() < 5e-3


def test_independent_speeds_change_before_they_become_singular():
    run = simulate(sleigh(), [0.0, 0.0, 0.0], [0.0, SPIN], 3.0, step=1e-3, sample=0.1,
                   integrator='implicit')
    assert not run.warnings
    np.testing.assert_allclose(run.q[:, :2], sleigh_path(run.t), atol=1e-4)


def test_singular_configurations_are_the_errors_of_every_integrator():
    parallelogram = Robot(four_bar_model(bars=(0.5, 1.0, 0.5)), constraints=[PIN],
                          independent=['crank'], configuration=(1.0, -1.0, 1.0 - np.pi))
    arguments = {'step': 1e-3, 'integrator': 'implicit'}
    with pytest.raises(ConstraintError,
                       match=r"kinematic singularity \(dead point\).*'pin'"):
        simulate(parallelogram, (1.0, -1.0, 1.0 - np.pi), [6.0], 3.0, **arguments)
    # Speeds that the user named may be singular on the way.
    run = simulate(sleigh('body/x', 'body/rz'), [0, 0, 0], [0.0, SPIN], 3.0, sample=0.1,
                   **arguments)
    np.testing.assert_allclose(run.q[:, :2], sleigh_path(run.t), atol=1e-4)
