"""Timing with limits of jerk and torque rate, against independent formulations."""

from functools import cache
import math

from kane_dynamics import (Inertial, InputError, Limits, load_urdf, ModelBuilder, Motion,
                           Robot, rod)
from kane_dynamics.feasibility import time_optimal
from kane_dynamics.feasibility.jerk_limited import rate_peaks, third_order_timing
from kane_dynamics.feasibility.jerk_limited.interior_point import banded_solver
from kane_dynamics.feasibility.jerk_limited.profile_spline import ProfileSpline
from kane_dynamics.feasibility.jerk_limited.smooth_path import smooth_sections
from kane_dynamics.feasibility.jerk_limited.third_order_limits import torque_rate_kernel
from kane_dynamics.motion.controller_points import ControllerPoints
from kane_dynamics.robot.parameters import JointLimits
from mechanisms import with_joints
import numpy as np
from path_torque import torque_along
from pinocchio_fr3 import pinocchio_fr3
import pytest

URDF = 'urdf/fr3.urdf'
SUPPLEMENT = 'urdf/fr3.supplement.yaml'


def one_joint(velocity=2.0, axis=(0.0, 0.0, 1.0), effort=1e3):
    builder = ModelBuilder('one joint')
    builder.body('rod', 'world', axis=axis,
                 inertial=rod(1.0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
                 joint='joint', limits=Limits(effort=effort, velocity=velocity))
    return Robot(builder.model())


def double_s(distance, velocity, acceleration, jerk):
    """Return the duration of the double-S profile that reaches all three limits."""
    assert velocity * jerk >= acceleration**2
    assert distance >= velocity * (velocity / acceleration + acceleration / jerk)
    return distance / velocity + velocity / acceleration + acceleration / jerk


def test_duration_of_a_line_is_that_of_the_double_s_profile():
    timing = time_optimal(one_joint(), [[0.0], [3.0]], acceleration=5.0, jerk=20.0)
    least = double_s(3.0, 2.0, 5.0, 20.0)
    assert least < timing.duration < 1.001 * least
    assert {active.limit for active in timing.active} == {'jerk', 'acceleration',
                                                          'velocity'}


@pytest.mark.parametrize('scale', [1e-6, 1.0])
def test_torque_rate_of_a_joint_without_gravity_is_a_limit_of_its_jerk(scale):
    timing = time_optimal(one_joint(math.inf), [[0.0], [3.0]],
                          torque_rate=scale * 20.0 / 3.0)
    least = 4.0 * (3.0 / (2.0 * scale * 20.0))**(1.0 / 3.0)  # the inertia is 1/3
    assert least < timing.duration < 1.001 * least
    assert {active.limit for active in timing.active} == {'torque_rate'}


def test_loose_limit_of_torque_rate_leaves_the_limit_of_effort():
    timing = time_optimal(one_joint(math.inf), [[0.0], [3.0]], torque_rate=1e8)
    least = 2.0 * math.sqrt(3.0 / 3e3)  # at the acceleration of 1000 N m
    assert least < timing.duration < 1.005 * least
    assert 'effort' in {active.limit for active in timing.active}


def test_jerks_and_torque_rates_inside_segments_are_derivatives_of_the_motion():
    robot = arm()
    t = np.array([0.0, 0.05, 0.08, 0.15])
    phases = 6.0 * t[:, None] + np.arange(7.0)
    points = ControllerPoints(t, np.sin(phases), 6.0 * np.cos(phases),
                              -36.0 * np.sin(phases + 0.01))
    motion = Motion.from_points(*points, joint_names=robot.joint_names)
    places = rate_peaks.PLACES[1:-1]
    times = t[:-1] + places[:, None] * np.diff(t)

    without_dry_friction = Robot(with_joints(robot.model, friction=0.0,
                                             friction_offset=0.0))

    def smooth_torque(moments):
        state = motion.sample(moments.ravel())
        return without_dry_friction.inverse_dynamics(*state).reshape(*moments.shape, 7)
    h = 1e-5
    udot = [motion.sample((times + side).ravel())[2].reshape(*times.shape, 7)
            for side in (-h, h)]
    expected = (udot[1] - udot[0]) / (2.0 * h)
    np.testing.assert_allclose(rate_peaks.jerks(points)[1:-1], expected, rtol=0,
                               atol=1e-7 * np.abs(expected).max())
    expected = (smooth_torque(times + h) - smooth_torque(times - h)) / (2.0 * h)
    rates = rate_peaks.torque_rates(robot, points)[1:-1]
    np.testing.assert_allclose(rates, expected, rtol=0,
                               atol=1e-5 * np.abs(expected).max())


def test_the_limit_of_jerk_holds_between_the_points_and_is_reached():
    robot = one_joint()
    timing = time_optimal(robot, [[0.0], [1.5], [0.7]], jerk=20.0, points=60)
    motion = timing.motion
    t = np.linspace(0.0, motion.duration, 20_001)
    jerk = np.abs(np.diff(motion.sample(t)[2][:, 0]) / np.diff(t))
    assert 0.99 * 20.0 < jerk.max() <= 1.001 * 20.0


@cache
def arm():
    return Robot(load_urdf(URDF, supplement=SUPPLEMENT, tip='fr3_link7'),
                 payload_frame='fr3_link7')


def waypoints(seed, count=5):
    limits = arm().limits
    rng = np.random.default_rng(seed)
    return (0.5 * (limits.lower + limits.upper)
            + 0.25 * (limits.upper - limits.lower) * rng.uniform(-1.0, 1.0, (count, 7)))


def excesses(robot, motion, payload, limits, resolution=100):
    """Return the largest shares of all limits, by Pinocchio and its differences."""
    pinocchio, model, data = pinocchio_fr3(payload)
    h = np.diff(motion.times)
    parts = h[:, None] * np.arange(resolution) / resolution
    inside = (motion.times[:-1, None] + parts).ravel()
    t = np.append(inside, np.nextafter(motion.duration, 0.0))
    q, u, udot = motion.sample(t)
    smooth = np.array([pinocchio.rnea(model, data, *row) for row in zip(q, u, udot)])
    tau = smooth.copy()
    for k, body in enumerate(robot.model.bodies):
        joint = body.joint
        smooth[:, k] += joint.damping * u[:, k] + joint.armature * udot[:, k]
        tau[:, k] = smooth[:, k] + joint.friction_offset + joint.friction * np.tanh(
            u[:, k] / joint.friction_speed)
    step = np.diff(t)[:, None]
    values = {'effort': tau, 'velocity': u, 'power': tau * u, 'acceleration': udot,
              'jerk': np.diff(udot, axis=0) / step,
              'torque_rate': np.diff(smooth, axis=0) / step}
    bounds = {'effort': robot.limits.effort, 'velocity': robot.limits.velocity, **limits}
    return {name: float(np.abs(values[name] / bound).max())
            for name, bound in bounds.items()}


@pytest.mark.parametrize(('seed', 'payload', 'limits'), [
    pytest.param(2, 0.0, {'jerk': 500.0}, marks=pytest.mark.slow),
    pytest.param(3, 0.0, {'jerk': 5000.0, 'torque_rate': 1000.0},
                 marks=pytest.mark.slow),
    pytest.param(5, 2.0, {'jerk': 300.0, 'torque_rate': 300.0, 'acceleration': 8.0,
                          'power': 40.0}, marks=pytest.mark.slow),
    (7, 3.0, {'torque_rate': 150.0})])
def test_no_limit_is_exceeded_by_a_thousandth_between_points(seed, payload, limits):
    robot = arm()
    if payload:
        robot.parameters.payload = Inertial(payload, np.zeros(3), np.zeros((3, 3)))
    try:
        timing = time_optimal(robot, waypoints(seed), points=300, **limits)
        worst = excesses(robot, timing.motion, payload, limits)
        assert max(worst.values()) <= 1.001, worst
        assert max(worst[name] for name in ('jerk',
                                            'torque_rate') if name in limits) > 0.99
        arguments = {}
        for name in ('acceleration', 'power'):
            if name in limits:
                arguments[name] = limits[name]
        assert timing.duration > time_optimal(
            robot, waypoints(seed), **arguments).duration
    finally:
        robot.parameters.payload = None


LIMITS = [{'jerk': 500.0}, {'jerk': 5000.0, 'torque_rate': 1000.0},
          {'torque_rate': 300.0},
          {'jerk': 100.0, 'acceleration': 5.0, 'power': 40.0}, {'jerk': 1e5}]


def check_random_path(seed, monkeypatch):
    """Time a path of 2 to 29 waypoints; all limits hold, and the work is bounded."""
    calls = []
    solve = third_order_timing.fastest_spline
    monkeypatch.setattr(third_order_timing, 'fastest_spline',
                        lambda *given: calls.append(1) or solve(*given))
    path = waypoints(seed, int(np.random.default_rng(seed).integers(2, 30)))
    timing = time_optimal(arm(), path, **LIMITS[seed % len(LIMITS)])
    assert len(calls) <= third_order_timing.ROUNDS * third_order_timing.GRIDS
    assert max(float(use.max()) for use in timing.demand.uses.values()) <= 1.001
    assert max(float(use.max()) for use in timing.uses.values()) <= 1.0
    assert np.linalg.norm(timing.motion.positions[:, None] - path,
                          axis=2).min(axis=0).max() < 1e-6


@pytest.mark.parametrize('seed', range(1, 4))
def test_random_paths_are_timed_with_bounded_work(seed, monkeypatch):
    check_random_path(seed, monkeypatch)


@pytest.mark.slow
@pytest.mark.parametrize('seed', range(4, 25))
def test_more_random_paths_are_timed_with_bounded_work(seed, monkeypatch):
    check_random_path(seed, monkeypatch)


def test_accelerations_are_zero_at_rests_and_continuous():
    robot = one_joint()
    path = Motion.from_points([0.0, 1.0, 2.0], [[0.0], [1.0], [0.5]], np.zeros((3, 1)),
                              joint_names=robot.joint_names)
    motion = time_optimal(robot, path, jerk=20.0).motion
    jumps = np.abs(np.diff(motion.sample(np.linspace(0.0, motion.duration, 20_001))[2],
                           axis=0))
    assert jumps.max() <= 20.0 * 1.01 * motion.duration / 20_000
    # Velocity 2 is not reached.
    least = sum(4.0 * (distance / 40.0)**(1.0 / 3.0) for distance in (1.0, 0.5))
    assert motion.duration == pytest.approx(least, rel=1e-3)


@pytest.mark.parametrize('factor', [1e-4, 1e4])
def test_times_of_the_motion_have_no_influence(factor):
    t = np.linspace(0.0, 2.0, 5)
    durations = []
    for scale in (1.0, factor):
        durations.append(time_optimal(arm(), Motion.from_points(scale * t, waypoints(
            3), joint_names=arm().joint_names), jerk=2000.0, points=200).duration)
    assert durations[0] == pytest.approx(durations[1], rel=1e-6)


@pytest.mark.parametrize('count', [51, 401, 2001])
def test_duration_does_not_depend_on_the_number_of_waypoints(count):
    s = np.linspace(0.0, 2.0, count)
    path = np.column_stack([np.sin(s), 0.5 * s**2])
    timing = time_optimal(two_joints(), path, acceleration=3.0, jerk=10.0, points=400)
    assert timing.duration == pytest.approx(least_of_the_curve(), rel=1e-3)


@cache
def least_of_the_curve():
    return time_optimal(two_joints(), curve(), acceleration=3.0, jerk=10.0).duration


def test_path_whose_acceleration_jumps_is_refused_with_joint_and_time():
    t = np.array([0.0, 1.0, 2.0])
    q = np.array([[0.0], [1.0], [1.5]])
    robot = one_joint()
    path = Motion.from_points(t, q, [[0.0], [1.5], [0.0]], joint_names=robot.joint_names)
    time_optimal(robot, path)
    with pytest.raises(InputError,
                       match=r"acceleration of joint 'joint' jumps by .* at 1 s"):
        time_optimal(robot, path, jerk=20.0)


@pytest.mark.parametrize(('given', 'message'), [
    ({'jerk': 5.0, 'start_speed': 1.0}, 'start_speed: 1 with a limit of jerk'),
    ({'torque_rate': 5.0, 'end_speed': 0.5}, 'end_speed: 0.5 with a limit of jerk'),
    ({'jerk': 0.0}, "jerk of joint 'joint': limit 0"),
    ({'torque_rate': 0.0}, "torque_rate of joint 'joint': limit 0"),
    ({'jerk': -1.0}, "jerk of joint 'joint': -1"), ({'jerk': math.nan}, 'jerk of joint'),
    ({'jerk': True}, 'jerk'), ({'torque_rate': 'fast'}, "torque_rate: 'fast'"),
    ({'torque_rate': [1.0, 2.0]},
     r'torque_rate: \[1.0, 2.0\]; expected one number, or 1')])
def test_invalid_limits_of_rates_are_refused(given, message):
    with pytest.raises(InputError, match=message):
        time_optimal(one_joint(), [[0.0], [1.0]], **given)


def test_configuration_that_the_motors_cannot_hold_is_named():
    with pytest.raises(InputError,
                       match=r'at rest at .* expected at most its effort limit 2'):
        time_optimal(one_joint(axis=(0.0, 1.0, 0.0), effort=2.0), [[0.0], [1.0]],
                     jerk=5.0)


def test_moving_joint_without_effort_is_named():
    with pytest.raises(InputError,
                       match=r"effort of joint 'joint': limit 0; expected a positive"):
        time_optimal(one_joint(effort=0.0), [[0.0], [1.0]], jerk=5.0)


def test_path_near_the_rounding_of_its_positions_is_refused_with_this_reason():
    for start, refused in ((0.0, False), (1.0, True)):
        path = [[start], [start + 1e-6]]
        if refused:
            with pytest.raises(InputError, match='positions on it, which are rounded'):
                time_optimal(one_joint(), path, jerk=10.0)
        else:
            least = 4.0 * (1e-6 / 20.0)**(1.0 / 3.0)
            assert time_optimal(one_joint(), path, jerk=10.0).duration == pytest.approx(
                least, rel=1e-3)


@pytest.mark.parametrize('count', [5, 40])
def test_dense_waypoints_there_and_back_take_at_most_a_fifth_more_than_two_lines(count):
    line = np.linspace(0.0, 1.0, count)[:, None]
    timing = time_optimal(one_joint(), np.vstack([line, line[-2::-1]]), jerk=10.0)
    alone = time_optimal(one_joint(), line, jerk=10.0)
    assert 2.0 * alone.duration * (1.0 - 1e-3) < timing.duration < 2.4 * alone.duration


def test_jerk_of_a_joint_that_does_not_move_is_no_limit():
    path = [[0.0, 0.5], [1.0, 0.5]]
    arguments = {'jerk': [10.0, 0.0]}
    assert time_optimal(two_joints(), path, **arguments).duration == pytest.approx(
        time_optimal(two_joints(), path, jerk=10.0).duration, rel=1e-3)


def test_banded_systems_are_solved_as_dense_ones():
    rng = np.random.default_rng(1)
    for count in (4, 5, 40):
        lower = np.tril(np.triu(rng.normal(size=(count, count)), -3))
        matrix = lower @ lower.T + np.eye(count)
        right = rng.normal(size=count)
        diagonals = np.array([np.pad(np.diagonal(matrix, -k), (k, 0)) for k in range(4)])
        assert banded_solver()(diagonals, right) == pytest.approx(
            np.linalg.solve(matrix, right), rel=1e-9)


def test_derivatives_of_the_path_and_of_its_torque_are_those_of_differences():
    robot = arm()
    path, = smooth_sections(Motion.from_points(np.arange(5.0), waypoints(4),
                                               joint_names=robot.joint_names), 4000)
    q, first, second = path.section[:3]
    count = path.size // 5  # before the first jump of the third derivative
    s = path.place[:count, None]
    # Between rests the parameter is far from the third power.
    inner = slice(count // 4, None)
    for low, high in ((q, first), (first, second), (second, path.third)):
        slope = np.gradient(low[:count], s[:, 0], axis=0, edge_order=2)
        error = np.abs(slope - high[:count])[inner] / np.abs(high).max()
        assert error.max() < 1e-4
    torque_rates = torque_rate_kernel(robot)(q, first, second, path.third)
    torque = torque_along(robot, q, first, second)
    assert torque_rates[:, :2] == pytest.approx(torque[:, :2], abs=1e-9)
    slope = np.gradient(torque[:count], s[:, 0], axis=0, edge_order=2)
    assert np.abs(slope - torque_rates[:count, 3:])[inner].max() < 1e-4 * np.abs(
        torque_rates[:, 3:]).max()


def test_spline_has_the_values_of_scipy():
    interpolate = pytest.importorskip('scipy.interpolate')
    rng = np.random.default_rng(2)
    s = np.concatenate([[0.0], np.sort(rng.uniform(size=19)), [1.0]])
    place = np.linspace(0.0, 1.0, 101)
    spline = ProfileSpline(s, place, 101)
    c = rng.uniform(size=19)
    h = np.diff(s)
    knots = np.concatenate(
        [-h[0] * np.arange(3, 0, -1), s, 1.0 + h[-1] * np.arange(1, 4)])
    peer = interpolate.BSpline(knots, np.concatenate([c[:1], c[:1], c, c[-1:], c[-1:]]),
                               3)
    for order, row in enumerate(spline.at(c)):
        expected = peer(place, nu=order)
        assert row == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())


def two_joints():
    builder = ModelBuilder('two joints')
    for k, on in enumerate(('world', 'rod0')):
        builder.body(f'rod{k}', on, axis=(0.0, 0.0, 1.0), at=(float(k), 0.0, 0.0),
                     inertial=rod(1.0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
                     joint=f'joint{k}', limits=Limits(effort=1e3, velocity=1.5))
    return Robot(builder.model())


def curve():
    s = np.linspace(0.0, 2.0, 401)
    return Motion.from_points(
        s, np.column_stack([np.sin(s), 0.5 * s**2]), np.column_stack([np.cos(s), s]),
        np.column_stack([-np.sin(s), np.ones_like(s)]),
        joint_names=two_joints().joint_names)


def least_duration(end, span, limit, count=150):
    """
    Return the least duration of s from rest to rest by Ipopt in time.

    `limit` bounds quantities at a state s, v, a with a third derivative, which is
    constant within each interval, at both of its ends.
    """
    casadi = pytest.importorskip('casadi')
    problem = casadi.Opti()
    state = problem.variable(*(3, count + 1))
    third = problem.variable(*(count,))
    total = problem.variable(*())
    problem.minimize(total)
    h = total / count
    for k in range(count):
        s, v, a = (state[i, k] for i in range(3))
        j = third[k]
        problem.subject_to(state[0, k + 1] == s + h * (v + h * (a / 2.0 + h * j / 6.0)))
        problem.subject_to(state[1, k + 1] == v + h * (a + h * j / 2.0))
        problem.subject_to(state[2, k + 1] == a + h * j)
        for place in (k, k + 1):
            for value, bound in limit(casadi, *(state[i, place] for i in range(3)), j):
                problem.subject_to(problem.bounded(-bound, value, bound))
    problem.subject_to(state[:, 0] == 0.0)
    problem.subject_to(state[:, count] == casadi.vertcat(end, 0.0, 0.0))
    problem.subject_to(state[1, :] >= 0.0)
    problem.set_initial(total, span)
    problem.set_initial(state[0, :], np.linspace(0.0, end, count + 1))
    problem.set_initial(state[1, :], end / span)
    problem.solver('ipopt', {'print_time': False}, {'print_level': 0, 'max_iter': 1000})
    return float(problem.solve().value(total))


@pytest.mark.slow
def test_duration_along_a_curve_is_the_least_of_a_program_in_time():
    def limit(casadi, s, v, a, j):
        for first, second, cubic in ((casadi.cos(s), -casadi.sin(s), -casadi.cos(s)),
                                     (s, 1.0, 0.0)):
            yield first * v, 1.5
            yield first * a + second * v**2, 3.0
            yield first * j + 3.0 * second * v * a + cubic * v**3, 10.0
    assert least_of_the_curve() == pytest.approx(least_duration(2.0, 4.0, limit),
                                                 rel=3e-3)


@pytest.mark.parametrize(('effort', 'rate', 'jerk'), [
    pytest.param(6.0, 20.0, math.inf, marks=pytest.mark.slow),
    pytest.param(5.5, 40.0, 30.0, marks=pytest.mark.slow), (1e3, 12.0, math.inf)])
def test_duration_of_a_pendulum_with_gravity_is_the_least_of_a_program_in_time(
        effort, rate, jerk):
    # Of a rod of 1 kg and 1 m, horizontal at s = 0.
    weight = 9.80665 * 0.5
    inertia = 1.0 / 3.0

    def limit(casadi, s, v, a, j):
        yield inertia * a - weight * casadi.cos(s), effort
        yield inertia * j + weight * casadi.sin(s) * v, rate
        yield v, 4.0
        if jerk < math.inf:
            yield j, jerk
    robot = one_joint(4.0, (0.0, 1.0, 0.0), effort)
    assert robot.gravity_force([0.0]) == pytest.approx([-weight], rel=1e-3)
    timing = time_optimal(robot, [[0.0], [2.0]], jerk=jerk, torque_rate=rate)
    assert timing.duration == pytest.approx(least_duration(2.0, 2.0, limit), rel=2e-3)


def test_plot_has_the_limits_of_jerk_and_torque_rate():
    pytest.importorskip('matplotlib')
    from kane_dynamics.plot import plot_timing
    timing = time_optimal(two_joints(), [[0.0, 0.0], [1.0, 0.5]],
                          jerk=10.0, torque_rate=20.0)
    titles = [axes.get_title('left') for axes in plot_timing(timing).axes]
    assert [title for title in titles if title] == [
        'effort limit', 'velocity limit', 'jerk limit', 'torque_rate limit']


def test_effort_limits_of_other_robots_are_kept_too():
    robot = Robot(load_urdf(URDF, supplement=SUPPLEMENT, tip='fr3_link7'))
    limits = robot.limits
    robot.limits = JointLimits(limits.lower, limits.upper, limits.velocity,
                               0.6 * limits.effort)
    timing = time_optimal(robot, waypoints(3),
                          jerk=2000.0, torque_rate=1000.0, points=300)
    assert timing.demand.fits and timing.uses['effort'].max() > 0.99
