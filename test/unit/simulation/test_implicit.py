"""Promises of the implicit integrator: right, of second order, and never too stiff."""

import warnings

from kane_dynamics import (ComputedTorque, Drive, FlexibleLink, InputError,
                           load_urdf, longest_step, ModelBuilder, ModelWarning, Motion,
                           point_mass, Robot, simulate, with_drives)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.mechanics.integrators.rosenbrock import ImplicitStep
from mechanisms import random_model, wheel
import numpy as np
import pytest
from scipy.integrate import solve_ivp

UR10E = resource_path('urdf', 'ur10e.urdf')
Q = np.array([0.0, -1.0, 1.0, 0.0, 0.3, 0.0])
# Friction as identified on a real arm, without rotors: no explicit step beyond 2 us is
# stable.
COULOMB = np.array([20.0, 20.0, 15.0, 5.0, 4.0, 3.0])
SETS_IN = np.array([0.14, 0.03, 0.09, 0.08, 0.035, 0.005])


@pytest.fixture(scope='module')
def arm():
    """Return a UR10e whose friction is as stiff as identified friction is."""
    joints = {}
    for name, mu, speed in zip(load_urdf(UR10E).joint_names, COULOMB, SETS_IN):
        joints[name] = {'friction': float(mu), 'friction_speed': float(speed),
                        'damping': 3.0}
    return Robot(load_urdf(UR10E, supplement={'joints': joints}))


def bending():
    """Return a beam with a weight at its tip, on a joint with a spring and a damper."""
    b = ModelBuilder('beam')
    b.beam('arm', 'world',
           FlexibleLink(length=1.0, density=0.8, stiffness=120.0, modes=(0, 2)),
           axis=(0, -1, 0), stiffness=80.0, damping=2.0, friction=1.0,
           friction_speed=0.3)
    b.load('arm/tip', point_mass(0.5))
    return Robot(b.model())


def exact(robot, q, u, tau, duration):
    """Return q and u at the end, by an implicit method that is not ours."""
    def rates(t, x):
        return np.concatenate(
            [x[robot.n:], robot.forward_dynamics(*np.split(x, 2), tau)])
    solution = solve_ivp(rates, (0.0, duration), np.concatenate([q, u]), 'BDF',
                         rtol=1e-8, atol=1e-9)
    return np.split(solution.y[:, -1], 2)


@pytest.mark.parametrize('make', [bending, lambda: Robot(random_model(11, 3, mimics=1))])
def test_native_steps_are_the_readable_methods_steps(make):
    robot = make()
    h = 2e-3
    method = ImplicitStep(robot.equations)
    n = robot.n
    q = np.array([0.3, 0.015, -0.008])
    u = np.full(n, 0.1)
    tau = np.full(n, 0.2)

    def stage(*arguments):
        return method.stage(*arguments[:-2], None, robot.parameters.block)
    run = simulate(robot, q, u, 20 * h, step=h, torque=tau, integrator='implicit')
    for _ in range(20):
        q, u, _ = method.step(stage, q, u, lambda q, u, moment: tau, h, ())
    np.testing.assert_allclose(run.q[-1], q, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(run.u[-1], u, rtol=1e-11, atol=1e-12)


def elastic_arm(**joint):
    """Return an arm with elastic drives at all joints and linear losses."""
    rigid = load_urdf(resource_path('urdf', 'two_link.urdf'), supplement={
        'joints': {'joint1': joint, 'joint2': joint}})
    return Robot(with_drives(rigid, {name: Drive(300.0, 0.4, rotor_inertia=0.05)
                                     for name in rigid.joint_names}))


@pytest.mark.parametrize('joint', [{}, {
    'damping': 0.7, 'stiffness': 40.0, 'friction_offset': 0.2}])
def test_steps_of_elastic_joints_are_those_of_their_equations(joint):
    robot = elastic_arm(**joint)
    h = 2e-3
    rng = np.random.default_rng(3)
    q, u, tau = rng.uniform(-0.5, 0.5, (3, robot.n))
    run = simulate(robot, q, u, 20 * h, step=h, torque=tau, integrator='implicit')
    method = ImplicitStep(robot.equations)

    def stage(*arguments):
        return method.stage(*arguments[:-2], None, robot.parameters.block)
    for _ in range(20):
        q, u, _ = method.step(stage, q, u, lambda q, u, moment: tau, h, ())
    np.testing.assert_allclose(run.q[-1], q, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(run.u[-1], u, rtol=1e-11, atol=1e-12)


def test_half_the_step_leaves_a_quarter_of_the_error():
    robot = bending()
    q = np.array([0.4, 0.0, 0.0])
    u = np.array([0.5, 0.0, 0.0])
    tau = np.array([1.0, 0.0, 0.0])
    want = np.concatenate(exact(robot, q, u, tau, 0.1))
    errors = []
    for step in (4e-4, 2e-4, 1e-4):
        run = simulate(robot, q, u, 0.1, step=step, torque=tau, integrator='implicit')
        errors.append(np.abs(np.concatenate([run.q[-1], run.u[-1]]) - want).max())
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.15)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.15)


def test_beams_that_swing_at_a_millisecond_keep_their_energy():
    b = ModelBuilder('two beams')
    for name, carrier in (('upper', 'world'), ('fore', 'upper/tip')):
        b.beam(name, carrier, FlexibleLink(1.0, 1.0, 400.0, (2, 0)), armature=0.05)
    robot = Robot(b.model())
    q, u = np.zeros((2, robot.n))
    q[robot.joint_names.index('fore')] = 0.5
    u[0] = 1.0
    run = simulate(robot, q, u, 0.5, step=1e-3, integrator='implicit')
    energy = run.energy.sum(axis=1)
    assert np.abs(energy - energy[0]).max() < 1e-6 * run.energy[:, 0].max()
    assert not run.warnings


@pytest.mark.parametrize('joint', [{'damping': 1e6}, {'stiffness': 1e8},
                                   {'stiffness': 1e8, 'damping': 1e2}, {'damping': 8.0}])
def test_no_step_is_too_long_for_linear_friction_and_springs(joint):
    run = simulate(wheel(**joint), [1e-3], [1.0], 100.0, step=1.0, integrator='implicit')
    assert np.abs(run.u[-1]) < 1e-6
    assert np.abs(run.u[1:]).max() < 3.0


def test_a_sliding_wheel_stops_and_does_not_turn_back():
    run = simulate(wheel(friction=5.0, friction_speed=1e-5), [0.0], [1.0], 0.5,
                   step=1e-3, sample=1e-3, integrator='implicit')
    assert (run.u > -5e-4).all()  # a tenth of what one step takes away
    assert abs(run.u[-1, 0]) < 1e-9
    assert run.q[-1, 0] == pytest.approx(0.1, rel=0.01)  # u^2 / (2 mu)


def test_friction_over_speed_is_met_within_eight_percent():
    speeds = np.geomspace(1e-4, 1e4, 400)
    robot = wheel(friction=2.0, friction_speed=0.5, damping=0.1)
    method = ImplicitStep(robot.equations)
    for u in [*speeds, *-speeds]:
        true = robot.friction_force([u])[0] / u
        assert 0.92 * true < method.resistance(np.array([u]))[0] < 1.001 * true
    assert method.resistance(np.zeros(1))[0] == pytest.approx(2.0 / 0.5 + 0.1)


def test_an_arm_with_identified_friction_moves_rightly_at_a_millisecond(arm):
    assert longest_step(arm, Q).step < 2e-6
    u = np.array([0.5, -0.4, 0.3, 1.0, -0.8, 1.5])
    tau = arm.gravity_force(Q) + np.array([30.0, -10.0, 12.0, 6.0, 2.0, 4.0])
    q_end, u_end = exact(arm, Q, u, tau, 0.5)
    with warnings.catch_warnings():
        warnings.simplefilter('error')  # no step is too long
        run = simulate(arm, Q, u, 0.5, torque=tau, integrator='implicit')
    assert np.abs(q_end - Q).max() > 0.1
    np.testing.assert_allclose(run.q[-1], q_end, atol=1e-3)
    np.testing.assert_allclose(run.u[-1], u_end, atol=1e-3)


def test_an_arm_whose_friction_holds_it_stands_as_long_as_one_likes(arm):
    tau = arm.gravity_force(Q) + 0.1 * COULOMB * [1, -1, 1, -1, 1, -1]
    run = simulate(arm, Q, np.full(6, 0.01), 1.0, step=2e-3, torque=tau,
                   integrator='implicit')
    balance = arm.friction_force(run.u[-1]) + arm.gravity_force(run.q[-1]) - tau
    assert np.abs(balance).max() < 1e-3 * np.abs(tau).max()  # nothing accelerates
    # Smoothed friction takes this for standing.
    assert (np.abs(run.u[-1]) < 0.3 * SETS_IN).all()
    with pytest.warns(ModelWarning, match='too long'), pytest.raises(InputError):
        simulate(arm, Q, np.zeros(6), 1.0, step=2e-3, torque=tau,
                 integrator='rk4')


def test_computed_torque_moves_the_arm_in_spite_of_its_friction(arm):
    motion = Motion.from_points([0.0, 1.0, 2.0], [Q, Q + 0.3, Q],
                                joint_names=arm.joint_names)
    run = simulate(arm, Q, np.zeros(6), 2.0, integrator='implicit',
                   torque=ComputedTorque(arm, motion, 400.0, 40.0))
    assert np.abs(run.q - motion.sample(run.t)[0]).max() < 2e-2


def test_simulations_among_many_are_those_alone(arm):
    rng = np.random.default_rng(2)
    q = Q + 0.1 * rng.normal(size=(5, 6))
    u = rng.normal(size=(5, 6))
    many = simulate(arm, q, u, 0.05, integrator='implicit')
    for k in range(5):
        alone = simulate(arm, q[k], u[k], 0.05, integrator='implicit')
        np.testing.assert_allclose(many.q[k], alone.q, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(many.u[k], alone.u, rtol=1e-9, atol=1e-9)
    asked = simulate(arm, q[0], u[0], 0.05, integrator='implicit',
                     torque=lambda *_: np.zeros(6))
    np.testing.assert_array_equal(asked.q, simulate(arm, q[0], u[0], 0.05,
                                                    integrator='implicit').q)


def test_an_unknown_integrator_is_refused_by_name():
    with pytest.raises(InputError,
                       match="integrator: 'euler'; expected one of rk4, implicit"):
        simulate(wheel(), [0.0], [0.0], 0.01, integrator='euler')
