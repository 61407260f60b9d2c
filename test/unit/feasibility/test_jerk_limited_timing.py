"""Time-optimal timing with limits of jerk and torque rate, against independent formulations."""

import math

from kane_dynamics import InputError, Limits, load_urdf, ModelBuilder, Motion, Robot, rod
from kane_dynamics.feasibility import time_optimal
import numpy as np
import pytest

URDF, SUPPLEMENT = 'urdf/fr3.urdf', 'urdf/fr3.supplement.yaml'


def one_joint(velocity=2.0, axis=(0.0, 0.0, 1.0)):
    builder = ModelBuilder('one joint')
    builder.body('rod', 'world', axis=axis, matter=rod(1.0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
                 joint='joint', limits=Limits(effort=1e3, velocity=velocity))
    return Robot(builder.model())


def double_s(distance, velocity, acceleration, jerk):
    """Return the duration of the double-S profile that reaches all three limits."""
    assert velocity * jerk >= acceleration**2
    assert distance >= velocity * (velocity / acceleration + acceleration / jerk)
    return distance / velocity + velocity / acceleration + acceleration / jerk


def test_duration_of_a_line_is_that_of_the_double_s_profile():
    found = time_optimal(one_joint(), [[0.0], [3.0]], acceleration=5.0, jerk=20.0)
    least = double_s(3.0, 2.0, 5.0, 20.0)
    assert least < found.duration < 1.002 * least


def test_torque_rate_of_a_joint_without_gravity_is_a_limit_of_its_jerk():
    found = time_optimal(one_joint(math.inf), [[0.0], [3.0]], torque_rate=20.0 / 3.0)
    least = 4.0 * (3.0 / (2.0 * 20.0))**(1.0 / 3.0)  # the inertia is 1/3
    assert least < found.duration < 1.002 * least
    assert {active.limit for active in found.active} == {'torque_rate'}


def arm():
    return Robot(load_urdf(URDF, supplement=SUPPLEMENT, tip='fr3_link7'))


def waypoints(robot, seed):
    limits, rng = robot.limits, np.random.default_rng(seed)
    return (0.5 * (limits.lower + limits.upper)
            + 0.25 * (limits.upper - limits.lower) * rng.uniform(-1.0, 1.0, (5, 7)))


def rate_excess(robot, motion, jerk, torque_rate, resolution=100):
    """Return the largest shares of jerk and torque rate, by differences of Pinocchio's torques."""
    pinocchio = pytest.importorskip('pinocchio')
    model = pinocchio.buildModelFromUrdf(URDF)
    model = pinocchio.buildReducedModel(
        model, [k for k, name in enumerate(model.names) if 'finger' in name], np.zeros(model.nq))
    data = model.createData()
    h = np.diff(motion.times)
    t = np.append((motion.times[:-1, None] + h[:, None] * np.arange(resolution) / resolution
                   ).ravel(), np.nextafter(motion.duration, 0.0))
    q, u, udot = motion.sample(t)
    tau = np.array([pinocchio.rnea(model, data, *row) for row in zip(q, u, udot)])
    for k, body in enumerate(robot.model.bodies):
        tau[:, k] += body.joint.damping * u[:, k] + body.joint.armature * udot[:, k]
    step = np.diff(t)[:, None]
    return (float(np.abs(np.diff(udot, axis=0) / step / jerk).max()),
            float(np.abs(np.diff(tau, axis=0) / step / torque_rate).max()))


@pytest.mark.parametrize(('seed', 'jerk', 'torque_rate'), [
    (2, 500.0, math.inf), (3, 5000.0, 1000.0)])
def test_rates_of_the_motion_keep_their_limits_between_points(seed, jerk, torque_rate):
    robot = arm()
    found = time_optimal(robot, waypoints(robot, seed), jerk=jerk, torque_rate=torque_rate)
    worst = rate_excess(robot, found.motion, jerk, torque_rate)
    assert max(worst) <= 1.001
    assert max(worst) > 0.99
    assert found.duration > time_optimal(robot, waypoints(robot, seed)).duration


def test_accelerations_are_zero_at_rests():
    robot = one_joint()
    path = Motion.from_points([0.0, 1.0, 2.0], [[0.0], [1.0], [0.5]], np.zeros((3, 1)),
                              joint_names=robot.joint_names)
    found = time_optimal(robot, path, jerk=20.0).motion
    jumps = np.abs(np.diff(found.sample(np.linspace(0.0, found.duration, 20_001))[2], axis=0))
    assert jumps.max() <= 20.0 * 1.01 * found.duration / 20_000


@pytest.mark.parametrize(('given', 'message'), [
    ({'jerk': 5.0, 'start_speed': 1.0}, 'start_speed: 1 with a limit of jerk'),
    ({'jerk': 0.0}, "jerk of joint 'joint': limit 0"),
    ({'torque_rate': 0.0}, "torque_rate of joint 'joint': limit 0")])
def test_invalid_limits_of_rates_are_refused(given, message):
    with pytest.raises(InputError, match=message):
        time_optimal(one_joint(), [[0.0], [1.0]], **given)


def two_joints():
    builder = ModelBuilder('two joints')
    for k, on in enumerate(('world', 'rod0')):
        builder.body(f'rod{k}', on, axis=(0.0, 0.0, 1.0), at=(float(k), 0.0, 0.0),
                     matter=rod(1.0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), joint=f'joint{k}',
                     limits=Limits(effort=1e3, velocity=1.5))
    return Robot(builder.model())


def least_duration(acceleration, jerk, count=150):
    """Return the least duration along the curve (sin s, s^2 / 2), s = 0 to 2, by Ipopt in time."""
    casadi = pytest.importorskip('casadi')
    problem = casadi.Opti()
    state, third, span = problem.variable(3, count + 1), problem.variable(count), (
        problem.variable())
    problem.minimize(span)
    h = span / count
    for k in range(count):
        s, v, a = (state[i, k] for i in range(3))
        j = third[k]
        problem.subject_to(state[0, k + 1] == s + h * (v + h * (a / 2.0 + h * j / 6.0)))
        problem.subject_to(state[1, k + 1] == v + h * (a + h * j / 2.0))
        problem.subject_to(state[2, k + 1] == a + h * j)
        for end in (k, k + 1):
            s, v, a = (state[i, end] for i in range(3))
            for first, second, cubic in ((casadi.cos(s), -casadi.sin(s), -casadi.cos(s)),
                                         (s, 1.0, 0.0)):
                problem.subject_to(problem.bounded(-1.5, first * v, 1.5))
                problem.subject_to(problem.bounded(
                    -acceleration, first * a + second * v**2, acceleration))
                problem.subject_to(problem.bounded(
                    -jerk, first * j + 3.0 * second * v * a + cubic * v**3, jerk))
    problem.subject_to(state[:, 0] == 0.0)
    problem.subject_to(state[:, count] == casadi.vertcat(2.0, 0.0, 0.0))
    problem.subject_to(state[1, :] >= 0.0)
    problem.set_initial(span, 4.0)
    problem.set_initial(state[0, :], np.linspace(0.0, 2.0, count + 1))
    problem.set_initial(state[1, :], 0.5)
    problem.solver('ipopt', {'print_time': False}, {'print_level': 0, 'max_iter': 1000})
    return float(problem.solve().value(span))


@pytest.mark.slow
def test_duration_along_a_curve_is_the_least_of_a_program_in_time():
    robot = two_joints()
    s = np.linspace(0.0, 2.0, 401)
    path = Motion.from_points(
        s, np.column_stack([np.sin(s), 0.5 * s**2]), np.column_stack([np.cos(s), s]),
        np.column_stack([-np.sin(s), np.ones_like(s)]), joint_names=robot.joint_names)
    found = time_optimal(robot, path, acceleration=3.0, jerk=10.0)
    assert found.duration == pytest.approx(least_duration(3.0, 10.0), rel=0.01)
