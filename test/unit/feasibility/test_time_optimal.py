"""Time-optimal timing of paths, compared with independent formulations."""

from dataclasses import replace
from functools import cache
import math

from kane_dynamics import (Inertial, InputError, Limits, load_urdf, ModelBuilder, Motion,
                           Robot, rod)
from kane_dynamics.feasibility import demand, fastest, reachability, time_optimal
from kane_dynamics.feasibility.path_geometry import Part, path_of, sections
from kane_dynamics.feasibility.path_timing import SectionMotion
from kane_dynamics.feasibility.segment_peaks import (CHANGING, MIDDLE, MotionStates,
                                                     SegmentPeaks)
from kane_dynamics.motion.controller_points import ControllerPoints
from kane_dynamics.motion.free_spline import free_velocities
from kane_dynamics.motion.rests import rests
from kane_dynamics.motion.uniform_spline import spline_derivatives
from kane_dynamics.robot.parameters import JointLimits
from mechanisms import with_joints
import numpy as np
from path_torque import torque_along
from pinocchio_fr3 import pinocchio_fr3
import pytest
from scipy.integrate import quad
from scipy.interpolate import CubicSpline
from scipy.optimize import linprog

URDF = 'urdf/fr3.urdf'
SUPPLEMENT = 'urdf/fr3.supplement.yaml'


@cache
def fr3(friction=True):
    return Robot(load_urdf(URDF, supplement=SUPPLEMENT, tip='fr3_link7'),
                 friction=friction, payload_frame='fr3_link7')


def limited(friction=True, effort=1.0, velocity=1.0, payload=None):
    """Return the FR3 with scaled limits."""
    robot = fr3(friction)
    model = load_urdf(URDF, supplement=SUPPLEMENT, tip='fr3_link7')
    limits = Robot(model, friction=friction).limits
    robot.limits = JointLimits(limits.lower, limits.upper, velocity * limits.velocity,
                               effort * limits.effort)
    robot.parameters.payload = payload
    return robot


def waypoints(seed, count=5):
    limits = fr3().limits
    rng = np.random.default_rng(seed)
    return (0.5 * (limits.lower + limits.upper)
            + 0.25 * (limits.upper - limits.lower) * rng.uniform(-1.0, 1.0, (count, 7)))


def moving(seed):
    """Return a motion along a smooth path that does not rest at its ends."""
    t = np.linspace(0.0, 1.0, 5)
    points = waypoints(seed)
    return Motion.from_points(t, points, CubicSpline(t, points)(t, 1),
                              joint_names=fr3().joint_names)


def torques(robot, q, u, udot, payload=0.0):
    """Return torques by Pinocchio, with the friction of the model added."""
    pinocchio, model, data = pinocchio_fr3(payload)
    tau = np.array([pinocchio.rnea(model, data, *row) for row in zip(q, u, udot)])
    for k, body in enumerate(robot.model.bodies):
        joint = body.joint
        if robot.friction:
            tau[:, k] += (joint.damping * u[:, k] + joint.friction_offset
                          + joint.friction * np.tanh(u[:, k] / joint.friction_speed))
        tau[:, k] += joint.armature * udot[:, k]
    return tau


def excess(robot, motion, power=math.inf, payload=0.0, resolution=10):
    """Return the largest share of any limit, by Pinocchio, at finer resolution."""
    worst = 0.0
    for fraction in np.arange(resolution) / resolution:
        q, u, udot = motion.sample(motion.times[:-1] + fraction * np.diff(motion.times))
        tau = torques(robot, q, u, udot, payload)
        worst = max(worst, *(float((np.abs(x) / bound).max()) for x, bound in (
            (tau, robot.limits.effort), (u, robot.limits.velocity), (tau * u, power))))
    return worst


@pytest.mark.parametrize(
    ('seed', 'effort', 'velocity', 'power', 'friction', 'resolution'), [
        (2, 0.7, 100.0, math.inf, False, 10),
        pytest.param(3, 0.7, 2.0, 60.0, True, 10, marks=pytest.mark.slow),
        (4, 1.0, 1.0, math.inf, True, 20),
        pytest.param(4, 1.0, 1.0, math.inf, True, 100, marks=pytest.mark.slow)])
def test_no_limit_is_exceeded_by_a_thousandth_between_points(
        seed, effort, velocity, power, friction, resolution):
    robot = limited(friction, effort, velocity)
    timing = time_optimal(robot, waypoints(seed), power=power)
    assert excess(robot, timing.motion, power, resolution=resolution) <= 1.001
    assert max(float(use.max()) for use in timing.uses.values()) >= 0.999


def test_timing_is_faster_than_any_uniform_scaling_of_the_motion():
    robot = limited()
    path = Motion.from_points(np.arange(5.0), waypoints(1),
                              joint_names=robot.joint_names)
    assert time_optimal(robot, path).duration < 0.8 * path.duration / fastest(
        robot, path).speed


def test_controllable_sets_are_those_of_linear_programs():
    rng = np.random.default_rng(0)
    for _ in range(12):
        rows = rng.normal(size=(1, 4, 6))
        rows[:, 3] = np.abs(rows[:, 3]) + 0.1
        rows[0, 0, :2] *= 1e-7  # points of zero inertia
        last = tuple(np.sort(np.abs(rng.normal(size=2))))
        alpha, beta, gamma, width = rows[0]
        A = np.vstack([np.column_stack([beta, alpha]), -np.column_stack([beta, alpha]),
                       [[1.0, 1.0], [-1.0, -1.0]]])
        b = np.concatenate([width - gamma, width + gamma, [last[1], -last[0]]])
        ends = [linprog([sign, 0.0], A, b, bounds=[(0.0, 50.0), (None, None)],
                        method='highs') for sign in (1.0, -1.0)]
        points = np.zeros((2, 4, 1)) + np.eye(4)[3][:, None]
        limits = reachability.IntervalLimits(points, rows, np.full(2, 50.0))
        if ends[0].status == 2:
            with pytest.raises(reachability.Infeasible):
                reachability.controllable_sets(limits, last)
            continue
        sets = reachability.controllable_sets(limits, last)
        assert sets[0, :2] == pytest.approx([end.x[0] for end in ends],
                                            rel=1e-6, abs=1e-6)
        x = float(sets[0, :2].mean())
        v = linprog([-1.0], A[:, 1:], b - A[:, 0] * x,
                    bounds=[(None, None)], method='highs').x[0]
        assert reachability.largest_profile(sets, x)[1] == pytest.approx(
            x + v, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize('seed', [1, 2])
def test_frictionless_durations_are_those_of_toppra(seed):
    toppra = pytest.importorskip('toppra')
    constraints = pytest.importorskip('toppra.constraint')
    algorithm = pytest.importorskip('toppra.algorithm')
    pinocchio, model, data = pinocchio_fr3()
    robot = limited(False, 0.8, 3.0)
    path = moving(seed)
    effort = robot.limits.effort
    velocity = robot.limits.velocity

    class Path(toppra.interpolator.AbstractGeometricPath):
        dof = 7
        path_interval = np.array([0.0, 1.0])
        waypoints = None

        def __call__(self, s, order=0):
            return path.sample(np.clip(np.atleast_1d(s), 0.0, 1.0 - 1e-12))[order]
    torque = constraints.JointTorqueConstraint(
        lambda *state: pinocchio.rnea(model, data, *state),
        np.stack([-effort, effort], axis=1),
        np.zeros(7), discretization_scheme=constraints.DiscretizationType.Interpolation)
    speed = constraints.JointVelocityConstraint(np.stack([-velocity, velocity], axis=1))
    grid = np.linspace(0.0, 1.0, 4001)
    rates = algorithm.TOPPRA(
        [speed, torque], Path(), gridpoints=grid,
        solver_wrapper='seidel').compute_parameterization(0.0, 0.0)[1]
    expected = (2.0 * np.diff(grid) / (rates[1:] + rates[:-1])).sum()
    assert time_optimal(robot, path).duration == pytest.approx(expected, rel=1e-3)


def test_timing_without_friction_and_payload_overloads_the_arm_that_has_them():
    load = Inertial(2.0, np.zeros(3), np.zeros((3, 3)))
    path = waypoints(5)
    ideal = time_optimal(limited(False), path).motion
    robot = limited(True, payload=load)
    assert excess(robot, ideal, payload=2.0) > 1.05
    timing = time_optimal(robot, path)
    assert excess(robot, timing.motion, payload=2.0) <= 1.001
    assert timing.duration > ideal.duration


def two_link(damping=2.0, friction=3.0, effort=(40.0, 18.0)):
    """Return an arm of two rods in a vertical plane, with much friction."""
    builder = ModelBuilder('two links')
    for k, on in enumerate(('world', 'rod0')):
        builder.body(f'rod{k}', on, axis=(0.0, 1.0, 0.0), at=(0.0, 0.0, -float(k)),
                     inertial=rod(1.0, (0.0, 0.0, 0.0), (0.0, 0.0, -1.0)),
                     joint=f'joint{k}',
                     damping=damping, friction=friction, friction_speed=0.1,
                     limits=Limits(effort=effort[k], velocity=20.0))
    return Robot(builder.model())


def least_duration(robot, motion, count=50, levels=1500):
    """Return the least duration over a grid of speeds by dynamic programming."""
    v = np.linspace(0.0, 8.0, levels)
    h = motion.duration / count
    best = np.where(v == 0.0, 0.0, np.inf)
    begin = v[:, None]
    end = v[None, :]
    speed = np.sqrt(0.5 * (begin**2 + end**2))
    rate = (end**2 - begin**2) / (2.0 * h)
    for k in range(count - 1, -1, -1):
        near = np.abs(end - begin) < 1.6  # a larger step exceeds every torque
        q, first, second = motion.sample((k + 0.5) * h)
        u = speed[near][:, None] * first
        udot = rate[near][:, None] * first + speed[near][:, None]**2 * second
        tau = robot.inverse_dynamics(np.broadcast_to(q, u.shape).copy(), u, udot)
        cost = np.full((levels, levels), np.inf)
        with np.errstate(divide='ignore'):
            cost[near] = np.where((np.abs(tau) <= robot.limits.effort).all(axis=1),
                                  2.0 * h / (begin + end)[near], np.inf)
        best = (cost + best).min(axis=1)
    return float(best[0])


def bent_path(robot):
    """Return a curved path that moves at its ends."""
    points = np.array([[0.0, 0.3], [0.7, 1.2], [1.6, 0.4]])
    t = np.array([0.0, 0.5, 1.0])
    return Motion.from_points(t, points, CubicSpline(t, points)(t, 1),
                              joint_names=robot.joint_names)


@pytest.mark.slow  # a minute of brute force
def test_duration_with_friction_is_the_least_of_dynamic_programming():
    robot = two_link()
    path = bent_path(robot)
    ratio = time_optimal(robot, path).duration / least_duration(robot, path)
    # On a grid of velocities no motion is faster than the best one.
    assert 0.97 < ratio < 1.005


def test_each_limit_is_active_where_it_is_reached():
    robot = two_link()
    timing = time_optimal(robot, bent_path(robot), acceleration=30.0, power=60.0)
    names = list(timing.uses)
    assert names == ['effort', 'velocity', 'power', 'acceleration']
    for active in timing.active:
        inside = (timing.motion.times >= active.start) & (timing.motion.times
                                                          <= active.end)
        use = timing.uses[active.limit][inside, robot.joint_names.index(active.joint)]
        assert (use >= 0.99).all()
    covered = sum(active.end - active.start for active in timing.active)
    assert covered > 0.9 * timing.duration  # some limit is always active
    starts = [active.start for active in timing.active]
    assert starts == sorted(starts)


def test_path_is_followed_and_its_timing_ignored():
    robot = limited()
    path = moving(1)
    timing = time_optimal(robot, path)
    other_timing = time_optimal(robot, path.scaled(3.0))
    assert timing.duration == pytest.approx(other_timing.duration, rel=1e-6)
    near = path.sample(np.linspace(0.0, 1.0, 200_001) * (1.0 - 1e-12))[0]
    for q in timing.motion.sample(np.linspace(0.0, timing.duration, 37))[0]:
        k = np.clip(np.linalg.norm(near - q, axis=1).argmin(), 1, len(near) - 2)
        along = (near[k + 1] - near[k - 1]) / np.linalg.norm(near[k + 1] - near[k - 1])
        aside = q - near[k] - along * (along @ (q - near[k]))
        assert np.linalg.norm(aside) < 1e-7
    assert (timing.motion.positions[[0, -1]] == pytest.approx(path.positions[[0, -1]]))
    assert np.abs(timing.motion.sample(0.0)[1]).max() == 0.0


def test_point_of_zero_inertia_leaves_the_acceleration_smooth():
    # The path turns such that the inertia of each joint along it changes sign.
    robot = two_link(0.0, 0.0, (60.0, 14.0))
    t = np.linspace(0.0, 1.0, 41)
    s = np.linspace(-1.0, 1.0, 41)
    points = np.column_stack([0.3 * s**2, 1.2 * s])
    path = Motion.from_points(t, points, CubicSpline(t, points)(t, 1),
                              joint_names=robot.joint_names)
    timing = time_optimal(robot, path)
    durations = [time_optimal(robot, path, points=count).duration
                 for count in (500, 4000)]
    assert durations[0] == pytest.approx(durations[1], rel=2e-3)
    saturated = timing.uses['effort'].max(axis=1) > 0.99
    assert saturated[5:-5].mean() > 0.95
    jumps = np.abs(np.diff(np.sign(np.diff(timing.tau[:, 0]))))
    assert (jumps > 0.0).mean() < 0.05  # no oscillation between points


def test_rests_and_dwells_of_a_motion_separate_its_sections():
    robot = two_link()
    points = np.array([[0.0, 0.0], [0.5, 0.4], [0.5, 0.4], [0.0, 0.8]])
    path = Motion.from_points([0.0, 1.0, 2.0, 3.0], points, np.zeros((4, 2)),
                              joint_names=robot.joint_names)
    timing = time_optimal(robot, path)
    corner = np.flatnonzero(
        (np.abs(timing.motion.positions - points[1]) < 1e-12).all(axis=1))
    assert len(corner) == 2 and corner[1] == corner[0] + 1
    times = timing.motion.times[corner]
    assert times[1] - times[0] == pytest.approx(1e-6)
    assert np.abs(timing.motion.sample(times)[1]).max() < 1e-12
    parts = [time_optimal(robot, points[k:k + 2]).duration for k in (0, 2)]
    assert timing.duration == pytest.approx(sum(parts), rel=1e-3)
    assert timing.demand.uses['effort'].max() <= 1.001


def test_single_joint_that_reverses_is_timed_through_its_rest():
    robot = two_link()
    timing = time_optimal(robot, [[0.0, 0.0], [1.0, 0.0], [0.4, 0.0]])
    assert timing.motion.positions[:, 0].max() > 0.9
    assert timing.demand.uses['effort'].max() <= 1.001


def test_repeated_waypoints_count_once():
    robot = two_link()
    path = [[0.0, 0.0], [0.5, 0.4], [0.5, 0.4], [0.0, 0.8]]
    assert time_optimal(robot, path).duration == pytest.approx(
        time_optimal(robot, [path[0], *path[2:]]).duration, rel=1e-12)


def test_speeds_at_the_ends_are_those_asked_for():
    robot = two_link()
    path = bent_path(robot)
    timing = time_optimal(robot, path, start_speed=0.5, end_speed=0.25)
    _, u, _ = timing.motion.sample(np.array([0.0, np.nextafter(timing.duration, 0.0)]))
    assert np.linalg.norm(u, axis=1) == pytest.approx([0.5, 0.25], rel=1e-3)
    assert timing.duration < time_optimal(robot, path).duration


def largest_use(robot, found, power=math.inf):
    """Return the largest share of any limit, at many fractions of the segments."""
    worst = 0.0
    motion = found.motion
    for fraction in np.arange(0.0, 1.0, 0.02):
        q, u, udot = motion.sample(motion.times[:-1] + fraction * np.diff(motion.times))
        tau = robot.inverse_dynamics(q, u, udot)
        worst = max(worst, *(float((np.abs(x) / bound).max()) for x, bound in (
            (tau, robot.limits.effort), (u, robot.limits.velocity), (tau * u, power))))
    return worst


@pytest.mark.parametrize('name', ['start_speed', 'end_speed'])
@pytest.mark.parametrize('speed', [0.1, 1e-3, 1e-8])
def test_small_speeds_at_the_ends_are_kept_within_the_limits(name, speed):
    robot = two_link()
    timing = time_optimal(robot, bent_path(robot), **{name: speed})
    end = 0.0 if name == 'start_speed' else np.nextafter(timing.duration, 0.0)
    assert np.linalg.norm(timing.motion.sample(end)[1]) == pytest.approx(speed, rel=1e-3)
    assert timing.duration == pytest.approx(0.7, rel=0.01)
    assert largest_use(robot, timing) <= 1.001


def slider(damping=0.0, friction=0.0, velocity=1.0):
    """Return a cart of 2 kg with a force of 100 N."""
    builder = ModelBuilder('slider')
    builder.body('cart', 'world', axis=(1.0, 0.0, 0.0), kind='prismatic', joint='rail',
                 inertial=Inertial(2.0, np.zeros(3), np.zeros((3, 3))), damping=damping,
                 friction=friction, friction_speed=0.01,
                 limits=Limits(effort=100.0, velocity=velocity))
    return Robot(builder.model())


@pytest.mark.parametrize(('damping', 'friction', 'velocity', 'path', 'duration'), [
    (1e4, 0.0, 1.0, [[0.0], [1.0]], 100.0), (0.0, 95.0, 0.1, [[0.0], [0.4]], 4.016),
    (1.0, 0.0, 0.01, [[0.0], [0.4], [0.1]], 70.4),
    (0.0, 0.0, 1e-3, [[0.0], [0.3]], 300.0)])
def test_friction_and_slow_axes_keep_the_limits(damping, friction, velocity, path,
                                                duration):
    robot = slider(damping, friction, velocity)
    timing = time_optimal(robot, path)
    assert largest_use(robot, timing) <= 1.001
    assert timing.duration == pytest.approx(duration, rel=1e-3)
    assert timing.demand.uses['effort'].max() <= 1.001


@pytest.mark.parametrize('points', [1000, 10_000])
def test_many_sharp_bends_keep_the_limits(points):
    robot = Robot(load_urdf('urdf/two_link.urdf'))
    path = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 2))
    assert largest_use(robot, time_optimal(robot, path, points=points)) <= 1.001


@pytest.mark.parametrize(('count', 'power', 'duration'), [
    (5, 5.0, 13.66), (20, 20.0, 11.76), (20, 5.0, 43.86)])
def test_limits_of_power_on_long_paths_have_the_duration_of_a_fine_grid(
        count, power, duration):
    robot = Robot(load_urdf('urdf/two_link.urdf'))
    path = np.random.default_rng(0).uniform(-1.0, 1.0, (5, 2))
    if count == 20:
        path = np.random.default_rng(0).uniform(-1.0, 1.0, (25, 2))[5:]
    timing = time_optimal(robot, path, power=power)
    assert timing.duration == pytest.approx(duration, rel=0.01)  # that on 4000 intervals
    assert largest_use(robot, timing, power) <= 1.001


def test_more_power_never_costs_time_on_a_long_path():
    rng = np.random.default_rng(3)
    builder = ModelBuilder('chain')
    on = 'world'
    for k in range(3):
        builder.body(f'body{k}', on, 'revolute',
                     axis=tuple(np.eye(3)[k]), at=(0.0, 0.0, 0.1), joint=f'joint{k}',
                     inertial=Inertial(1.0, 0.05 * rng.normal(size=3), 0.01 * np.eye(3)),
                     limits=Limits(velocity=4.0, effort=200.0 if k else math.inf))
        on = f'body{k}'
    robot = Robot(builder.model())
    path = [[19.2, 5.8, -18.7], [18.1, -0.4, -30.9], [20.4, -6.0, -30.2],
            [3.8, -21.1, -15.2]]
    timings = [time_optimal(robot, path, power=power, acceleration=5.0)
               for power in np.linspace(2.6, 2.8, 4)]
    durations = np.array([timing.duration for timing in timings])
    assert (np.diff(durations) < 0.0).all()
    assert durations[0] < 1.06 * durations[-1]
    assert largest_use(robot, timings[0], 2.6) <= 1.001


def test_excess_that_no_grid_removes_is_named():
    with pytest.raises(InputError,
                       match=r"path: joint 'rail': \S+ times its velocity limit at "
                       r'\S+ of the path, \[0\.\d\], on a grid of 16000 intervals'):
        time_optimal(slider(velocity=1e-5), [[0.0], [0.3]])


def test_duration_does_not_depend_on_the_number_of_waypoints():
    robot = Robot(load_urdf('urdf/ur10e.urdf', supplement='urdf/ur10e.supplement.yaml'))
    begin, end = np.array(
        [[0.0, -1.0, 1.2, 0.0, 0.5, 0.0], [1.5, -0.6, 0.8, 0.3, 0.5, 0.0]])
    for count in (2, 20, 150, 200, 500):
        timing = time_optimal(
            robot, begin + np.linspace(0.0, 1.0, count)[:, None] * (end - begin))
        assert timing.duration == pytest.approx(0.7674, rel=1e-3)
        assert largest_use(robot, timing) <= 1.001
    robot = Robot(load_urdf('urdf/two_link.urdf'))
    for count in (200, 1000):
        s = np.linspace(0.0, 1.0, count)
        timing = time_optimal(robot, np.column_stack([np.sin(6.0 * s), np.cos(9.0 * s)]))
        assert timing.duration == pytest.approx(1.229, rel=1e-3)  # toppra's
        assert largest_use(robot, timing) <= 1.001


@pytest.mark.parametrize('count', [2, 3, 4, 5, 12])
def test_velocities_of_a_free_spline_are_those_of_scipy(count):
    rng = np.random.default_rng(count)
    t = np.cumsum(rng.uniform(0.1, 2.0, count))
    q = rng.normal(size=(count, 3))
    assert free_velocities(t, q) == pytest.approx(CubicSpline(t, q)(t, 1),
                                                  rel=1e-9, abs=1e-9)


def test_limit_of_zero_matters_only_to_joints_that_move():
    robot = two_link()
    path = [[0.0, 0.0], [1.0, 0.0]]
    timing = time_optimal(robot, path, acceleration=[math.inf, 0.0])
    assert timing.duration == pytest.approx(time_optimal(robot, path).duration, rel=1e-9)
    with pytest.raises(InputError,
                       match="acceleration of joint 'joint0': limit 0; expected a po"):
        time_optimal(robot, path, acceleration=0.0)


@pytest.mark.parametrize('factor', [1e-4, 1e4])
def test_times_of_a_motion_have_no_influence(factor):
    robot = two_link()
    path = bent_path(robot)
    assert time_optimal(robot, path.scaled(factor)).duration == pytest.approx(
        time_optimal(robot, path).duration, rel=1e-6)


def test_path_of_a_motion_does_not_depend_on_the_time_at_which_it_begins():
    t = np.array([0.0, 1.0, 1.75, 3.0])
    points = waypoints(2, 4)
    names = fr3().joint_names
    first, late = (sections(Motion.from_points(begin + t, points, joint_names=names),
                            200, 2,
                            (True, True)) for begin in (0.0, 2.0**31))
    for section, late_section in zip(first, late, strict=True):
        for a, b, rounding in zip(section[:3], late_section[:3], (1e-14, 1e-11, 1e-9)):
            assert b == pytest.approx(a, rel=0.0, abs=rounding)


def test_waypoints_of_any_kind_of_array_are_their_numbers(tmp_path):
    array = waypoints(3)
    names = fr3().joint_names
    mapped = np.memmap(tmp_path / 'numbers', dtype=np.float64, mode='w+',
                       shape=array.shape)
    mapped[:] = array
    mapped.flush()
    read = np.memmap(tmp_path / 'numbers', dtype=np.float64, mode='r', shape=array.shape)
    masked = np.ma.masked_array(array, mask=array > array.mean())
    for kind in (array.tolist(), np.asfortranarray(array), array.astype('>f8'), read,
                 masked, np.repeat(array, 2, axis=0)[::2]):
        motion = path_of(kind, names)
        assert type(motion.positions) is np.ndarray
        assert motion.positions.flags.c_contiguous
        assert np.array_equal(motion.positions, array)
        assert np.array_equal(motion.times, path_of(array, names).times)
        assert np.array_equal(motion.coefficients, path_of(array, names).coefficients)


def test_integer_speeds_are_numbers():
    robot = two_link()
    path = bent_path(robot)
    assert time_optimal(robot, path, start_speed=np.int64(1)).duration == time_optimal(
        robot, path, start_speed=1.0).duration


def test_balls_are_named():
    builder = ModelBuilder('ball')
    builder.body('bob', 'world', kind='ball', joint='hip',
                 inertial=Inertial(1.0, np.array([0.0, 0.0, -1.0]), 0.1 * np.eye(3)))
    robot = Robot(builder.model())
    motion = Motion.from_points([0.0, 1.0], np.zeros((2, 3)),
                                joint_names=('a', 'b', 'c'))
    with pytest.raises(InputError,
                       match=r"time_optimal: a robot with ball joints \('hip'\)"):
        time_optimal(robot, np.zeros((2, 3)))
    with pytest.raises(InputError, match=r"fastest: a robot with ball joints \('hip'\)"):
        fastest(robot, motion)


@pytest.mark.parametrize(('change', 'words'), [
    ({'start_speed': 100.0}, r'start_speed: 100; expected 0 to \d'),
    ({'start_speed': -1.0}, 'start_speed: -1.0; expected a number from 0 to 1e'),
    ({'start_speed': True}, 'start_speed: True; expected a number from 0 to 1e'),
    ({'end_speed': 1e300}, r'end_speed: 1e\+300; expected a number from 0 to 1e'),
    ({'power': True}, 'power: True; expected one number, or one per joint'),
    ({'robot': None}, 'robot: a NoneType; expected a Robot'),
    ({'end_speed': 100.0},
     'end_speed: 100; expected a smaller one, with which the path can be'),
    ({'path': [[0.0, 0.0]]}, 'path: 1 different waypoints; expected at least 2'),
    ({'path': [[0.0, 0.0], [0.0, math.nan]]}, "waypoint 1 of joint 'joint1': nan"),
    ({'path': [[0.0], [1.0]]}, r'waypoint 0: shape \(1,\)'),
    ({'path': 3.0}, 'path: a float; expected a Motion'),
    ({'acceleration': -1.0}, "acceleration of joint 'joint0': -1.0"),
    ({'points': 3}, 'points: 3; expected'),
    ({'path': Motion.from_points([0.0, 1.0], np.zeros((2, 2)),
                                 joint_names=('joint0', 'joint1'))},
     'expected a path that moves'),
    ({'path': Motion.from_points([0.0], np.zeros((1, 2)),
                                 joint_names=('joint0', 'joint1'))},
     'expected a path that moves'),
    ({'path': Motion.from_points([0.0], np.zeros((1, 2)), joint_names=('a', 'b'))},
     r"path: joints \['a', 'b'\]; expected")])
def test_invalid_arguments_are_named(change, words):
    robot = two_link()
    with pytest.raises(InputError, match=words):
        time_optimal(**{'robot': robot, 'path': bent_path(robot), **change})


def test_configuration_that_the_motors_cannot_hold_is_named_with_its_place():
    robot = two_link(effort=(10.0, 18.0))
    with pytest.raises(InputError,
                       match=r"path: joint 'joint0': torque \S+ at rest at 1 of the "
                       r'path, \[1.6, 0.4\]; expected at most its effort limit 10'):
        time_optimal(robot, bent_path(robot))


def test_position_beyond_its_limit_is_named():
    robot = two_link()
    robot.limits = replace(robot.limits, upper=np.array([1.0, 3.0]))
    with pytest.raises(InputError,
                       match=r"path: joint 'joint0': position 1\.6; expected within "
                       'its upper limit 1'):
        time_optimal(robot, bent_path(robot))


def test_robots_without_bounds_are_refused():
    robot = two_link(effort=(math.inf, math.inf))
    with pytest.raises(InputError,
                       match='no limit bounds the motion; expected limits of effort'):
        time_optimal(robot, bent_path(robot))
    timing = time_optimal(robot, bent_path(robot), acceleration=5.0)
    assert timing.uses['acceleration'].max() > 0.99


def test_waypoints_that_are_all_but_equal_are_one():
    """A spline between close waypoints in the middle of a path would turn far away."""
    robot = two_link()
    corners = [[0.0, 0.0], [0.5, 0.3], [1.0, 0.2]]
    asked = time_optimal(robot, corners)
    rounded = time_optimal(
        robot, [[0, 0], [1e-14, 0], [0.5, 0.3], [0.5, 0.3 + 1e-15], [1, 0.2]])
    assert rounded.motion.duration == pytest.approx(asked.motion.duration, rel=1e-9)
    for noise in ([1e-9, 0.0], [-3e-8, 5e-8], [0.0, -1e-7]):
        twice = [*corners[:2], np.add(corners[1], noise), np.subtract(corners[2], noise),
                 corners[2]]
        timing = time_optimal(robot, twice)
        assert timing.duration == pytest.approx(asked.duration, rel=1e-5)
        np.testing.assert_allclose(timing.motion.positions[[0, -1]], corners[::2],
                                   atol=1e-15)


def test_dense_samples_of_a_smooth_motion_are_its_path():
    """From rest the first samples are close: 2e-7 of the path and less."""
    robot = two_link()
    rng = np.random.default_rng(0)
    ends = rng.uniform(-1.0, 1.0, (2, 2))
    motion = Motion.from_points([0.0, 1.0], ends, np.zeros((2, 2)), np.zeros((2, 2)),
                                joint_names=robot.joint_names)
    samples = motion.sample(np.linspace(0.0, 1.0, 5000))[0]
    steps = np.linalg.norm(np.diff(samples, axis=0), axis=1)
    assert steps.min() < 1e-7 * steps.sum()
    dense = time_optimal(robot, samples)
    assert dense.duration == pytest.approx(time_optimal(robot, ends).duration, rel=2e-3)


def test_five_hundred_random_waypoints_have_a_timing_within_the_limits():
    robot = Robot(load_urdf('urdf/fr3.urdf', tip='fr3_link7'), friction=False)
    middle = 0.5 * (robot.limits.lower + robot.limits.upper)
    size = 0.2 * (robot.limits.upper - robot.limits.lower)
    path = middle + size * np.random.default_rng(0).uniform(-1.0, 1.0, (500, 7))
    timing = time_optimal(robot, path)
    assert largest_use(robot, timing) <= 1.001


# Paths with the sharpest turns of twelve.
@pytest.mark.parametrize('seed', [5, pytest.param(7, marks=pytest.mark.slow)])
def test_five_hundred_random_waypoints_with_friction_have_a_timing_within_the_limits(
        seed):
    robot = two_link()
    path = np.random.default_rng(seed).uniform(-1.0, 1.0, (500, 2))
    timing = time_optimal(robot, path)
    assert largest_use(robot, timing) <= 1.001


def densest_use(robot, motion, places=1000):
    """Return the largest share of the torque limits at fractions of segments."""
    worst = 0.0
    for fraction in np.linspace(0.0, 1.0, places, endpoint=False):
        state = motion.sample(motion.times[:-1] + fraction * np.diff(motion.times))
        worst = max(worst, float((np.abs(robot.inverse_dynamics(*state))
                                  / robot.limits.effort).max()))
    return worst


@pytest.mark.parametrize('count', [2, 20, 200])
# Waypoints at the reversal symmetric, or not.
@pytest.mark.parametrize('back', [0.5, 0.77])
def test_waypoints_of_a_line_there_and_back_take_the_time_of_two_lines(count, back):
    robot = two_link()
    line = np.array([1.0, 0.4])
    s = np.concatenate([np.linspace(0.0, 1.0, count), np.linspace(1.0, 0.3, max(
        2, round(back * count)))[1:]])
    timing = time_optimal(robot, np.outer(s, line))
    lines = sum(time_optimal(robot, np.outer(ends, line)).duration for ends in (
        (0.0, 1.0), (1.0, 0.3)))
    # The spline overshoots somewhat.
    assert timing.duration == pytest.approx(lines, rel=1e-2)
    assert largest_use(robot, timing) <= 1.001


def test_rests_of_a_motion_stay_the_same_after_it_was_sampled():
    s = np.concatenate([np.linspace(0.0, 1.0, 20), np.linspace(1.0, 0.3, 10)[1:]])
    motion = path_of(np.outer(s, [1.0, 0.4]), ('a', 'b'))
    rests_before = rests(motion)
    motion.sample(0.1)  # lays the coefficients out in another way
    assert len(rests_before) == 3 and np.array_equal(rests(motion), rests_before)


def test_reversal_of_all_joints_keeps_the_torques_in_every_microsecond():
    """Friction jumps there, within much less than a segment."""
    robot = Robot(with_joints(two_link().model, friction_speed=0.0015))
    for end in (0.3, -0.2):
        timing = time_optimal(robot, np.outer([0.0, 1.0, end], [1.0, -0.7]))
        assert densest_use(robot, timing.motion) <= 1.001
        rests = np.flatnonzero(np.diff(timing.motion.times) < 1.1e-6)
        assert len(rests) == 1
        assert np.abs(
            timing.motion.sample(timing.motion.times[rests] + 5e-7)[2]).max() == 0.0


def test_controller_that_interpolates_the_points_keeps_the_limits_at_a_reversal():
    robot = limited()
    ends = np.array([[0.0, -0.8, 0.0, -2.3, 0.0, 1.6, 0.8],
                     [1.2, 0.3, 0.4, -1.5, 0.3, 1.9, 0.2]])
    timing = time_optimal(robot, ends[0] + np.outer(
        1.0 - np.abs(np.linspace(-1.0, 1.0, 39)), ends[1] - ends[0]))
    points = timing.points
    rests = np.flatnonzero(np.diff(points.t) < 2e-6)
    assert len(rests) == 1
    executed = Motion.from_points(*points, joint_names=robot.joint_names)
    assert demand(robot, executed).uses['effort'].max() <= 1.001
    around = points.t[rests[0]] + 1e-6 * np.linspace(0.0, 0.999, 101)
    q, u, udot = executed.sample(around)
    size = np.abs(points.udot[rests[0]:rests[0] + 2]).max()
    assert np.abs(udot).max() <= size * (1.0 + 1e-6)
    assert np.abs(u).max() <= 1e-6 * size
    assert np.abs(q - points.q[rests[0]]).max() <= 1e-12 * size


def test_torques_asked_for_later_are_those_of_the_payload_of_the_call():
    robot = limited(True, payload=Inertial(2.0, np.zeros(3), np.zeros((3, 3))))
    timing = time_optimal(robot, waypoints(5))
    expected = robot.inverse_dynamics(*timing.points[1:])
    demanded = timing.demand.tau
    robot.parameters.payload = None
    assert np.array_equal(timing.demand.tau, demanded)
    assert np.abs(expected - robot.inverse_dynamics(*timing.points[1:])).max() > 1.0
    assert np.array_equal(timing.tau, expected)
    assert timing.uses['effort'].max() == pytest.approx(
        np.abs(expected / robot.limits.effort).max(), rel=1e-12)


def test_torque_along_a_path_is_that_of_inverse_dynamics():
    robot = fr3()
    rng = np.random.default_rng(5)
    q, first, second = rng.uniform(-1.0, 1.0, (3, 9, 7))
    rate, change = rng.uniform(0.5, 2.0, (2, 9, 1))
    inertia, square, constant = torque_along(robot, q, first, second).swapaxes(0, 1)
    u = rate * first
    expected = robot.inverse_dynamics(q, u, change * first + rate**2 * second)
    assert inertia * change + square * rate**2 + constant + robot.friction_force(u) - (
        robot.friction_force(0.0 * u)) == pytest.approx(expected, rel=1e-11, abs=1e-11)


def test_times_between_points_are_integrals_of_the_reciprocal_path_velocity():
    robot = fr3()
    section, = sections(path_of(waypoints(6), robot.joint_names), 60, 2, (True, True))
    rng = np.random.default_rng(6)
    s = np.linspace(0.0, 1.0, 31)
    x = np.concatenate([[1e-4], rng.uniform(0.2, 2.0, 29), 1.0 + 1e-3 * np.sin(s)])
    motion = SectionMotion(robot, section, SegmentPeaks(robot, np.ones((4, 7))))
    motion.follow(x)
    t, _, u, udot = motion.checked().points
    slope = np.diff(x)[np.clip(np.arange(-1, 60), 0, 59)[:61]]
    slope = np.append(slope, slope[-1])
    at = np.concatenate([x[:1], 0.5 * (x[1:] + x[:-1]), x[-1:]])
    h = np.full(61, 0.5)
    h[[0, -1]] = 0.25
    spans = [quad(lambda z, a, b, c: (a + b * z + c * z * z)**-0.5, 0.0, w, epsabs=0.0,
                  epsrel=1e-11, limit=200, args=(a, 2.0 * b, (d - b) / w))[0]
             for a, b, d, w in zip(at, slope, slope[1:], h)]
    assert np.diff(t) == pytest.approx(spans, rel=1e-9)
    rows = [0, *range(1, 120, 2), 120]
    first = section.first[rows]
    second = section.second[rows]
    assert u == pytest.approx(first * np.sqrt(at)[:, None], rel=1e-12, abs=1e-12)
    assert udot == pytest.approx(first * slope[:, None] + second * at[:, None],
                                 rel=1e-12, abs=1e-9)


@pytest.mark.parametrize('seed', range(5))
def test_part_that_ends_by_rounding_beside_a_point_has_positions(seed):
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.1, 1.0, 5))
    motion = Motion.from_points(t, rng.normal(size=(5, 1)) @ np.ones((1, 2)),
                                joint_names=('a', 'b'))
    for end in (t[2], np.nextafter(t[2], t[3]), np.nextafter(t[2], t[1])):
        for cuts in ((t[0], end), (end, t[-1])):
            section = Part(motion, *cuts, (True, True)).sampled(60, 2, 2)
            assert section.q[[0, -1]] == pytest.approx(motion.sample(np.array(cuts))[0],
                                                       rel=1e-9)
            assert np.isfinite(section.second).all()


def test_largest_shares_in_segments_are_those_of_the_motion():
    robot = limited()
    timing = time_optimal(robot, waypoints(6, 3))
    motion = timing.motion
    power = np.full(7, 80.0)
    limits = np.array(
        [robot.limits.effort, robot.limits.velocity, power, np.full(7, math.inf)])
    points = ControllerPoints(motion.times, *motion.sample(np.append(
        motion.times[:-1], np.nextafter(motion.duration, 0.0))))

    def shares(segments, places):
        t = motion.times[segments, None] + places * np.diff(motion.times)[segments, None]
        q, u, udot = motion.sample(t.ravel())
        tau = robot.inverse_dynamics(q, u, udot)
        return np.stack([tau, u, tau * u, udot], axis=1).reshape(*t.shape, 4, 7) / limits
    peaks = SegmentPeaks(robot, limits)
    state = points.q, points.u, points.udot
    states = MotionStates.of(*state, peaks.torques(*state), np.diff(points.t))
    chosen = np.array([0, 7, 400])
    counts = np.array([8, 60, 4])
    worst, needed, rows = peaks.inside(states, chosen, counts)
    assert needed.tolist() == [0, 1, 2]
    for row, segment, count in zip(rows, chosen, counts):
        inside = np.linspace(0.0, 1.0 - 1e-12, count + 2)
        expected = np.abs(shares([segment], inside)[0]).max(axis=0)[[*peaks.quantities]]
        assert row == pytest.approx(expected, rel=1e-6, abs=1e-6)
    assert worst == pytest.approx(rows.max(axis=(1, 2)), rel=1e-15)
    least = np.median(worst)
    again, needed, rows_of_some = peaks.inside(states, chosen, counts, least)
    assert np.array_equal(again, worst)
    assert needed.tolist() == np.flatnonzero(worst >= least).tolist()
    assert len(needed) == 2 and np.array_equal(rows_of_some, rows[needed])
    timing = peaks.at(states, MIDDLE)
    expected = shares(np.arange(len(points.t) - 1), np.array([0.0, 0.5, 1.0 - 1e-12]))
    largest = np.abs(expected).max(axis=1)
    ranges = np.ptp(expected, axis=1)
    assert timing.shares == pytest.approx(largest[:, [*peaks.quantities]],
                                          rel=1e-6, abs=1e-6)
    assert not largest[:, 3].any()
    assert timing.largest == pytest.approx(largest.max(axis=(1, 2)), rel=1e-6)
    bend = np.abs(expected[:, 0] + expected[:, 2] - 2.0 * expected[:, 1])
    beyond = np.where(ranges > CHANGING, 0.15 * ranges + 0.2 * bend, 0.0)
    assert timing.estimate == pytest.approx((largest + beyond).max(axis=(1, 2)),
                                            rel=1e-5)
    counting = np.where(largest + beyond > 1.0, ranges, 0.0).max(axis=(1, 2))
    places = np.minimum(1.0 + 60.0 * np.sqrt(counting), 200.0)
    assert timing.places == pytest.approx(places, rel=1e-4, abs=1e-2)


@pytest.mark.parametrize('seed', range(4))
def test_no_share_of_a_limit_exceeds_its_estimate_from_three_places(seed):
    robot = limited(friction=False)
    path = waypoints(seed, 14)
    timing = time_optimal(robot, path.mean(axis=0) + 0.6 * (path - path.mean(axis=0)),
                          points=400)
    points = timing.points
    peaks = SegmentPeaks(robot, np.array([*timing._bounds]))
    state = points.q, points.u, points.udot
    states = MotionStates.of(*state, peaks.torques(*state), np.diff(points.t))
    segments = np.arange(len(states.h))
    exact, _, _ = peaks.inside(states, segments, np.full(len(segments), 63))
    # A share that changes by less than `CHANGING` may exceed the three as a parabola
    # does.
    assert (exact - peaks.at(states, MIDDLE).estimate).max() < CHANGING / 8.0


@pytest.mark.parametrize('changed', [[0], [1], [20], [58, 59], [60], [0, 30, 31, 60]])
def test_motion_with_a_profile_that_differs_somewhere_is_that_computed_at_once(changed):
    robot = limited()
    section, = sections(path_of(waypoints(6), robot.joint_names), 60, 2, (True, True))
    limits = np.array(
        [robot.limits.effort, robot.limits.velocity, *np.full((2, 7), math.inf)])

    def motion():
        return SectionMotion(robot, section, SegmentPeaks(robot, limits))
    x = np.random.default_rng(1).uniform(0.5, 1.0, 61) * 1e-3
    counterpart = x.copy()
    counterpart[changed] *= 0.9
    updated, whole = motion(), motion()
    updated.follow(x)
    updated.follow(counterpart)
    whole.follow(counterpart)
    for a, b in zip(updated.checked().points, whole.checked().points):
        assert np.array_equal(a, b)
    assert np.array_equal(updated.shares, whole.shares)
    assert np.array_equal(updated.largest, whole.largest)


@pytest.mark.parametrize('count', [3, 4, 40, 2001])
def test_uniform_splines_are_those_of_scipy(count):
    rng = np.random.default_rng(count)
    q = rng.normal(size=(count, 4))
    ends = rng.normal(size=(2, 4))
    s = np.linspace(0, 1, count)
    spline = CubicSpline(s, q, bc_type=((1, ends[0]), (1, ends[1])))
    for order, derivative in enumerate(spline_derivatives(q, s[1], *ends)):
        expected = spline(s, order + 1)
        assert derivative == pytest.approx(expected,
                                           rel=1e-10, abs=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize(('distance', 'points'),
                         [(1e-5, 1000), (1e-8, 1000), (1e-3, 50_000)])
def test_a_path_whose_positions_are_too_coarse_for_its_grid_is_refused(distance, points):
    start = np.array([0.0, -1.2, 1.4, -0.2, 1.57, 0.0])
    arm = Robot(load_urdf('urdf/ur10e.urdf'))
    with pytest.raises(InputError, match='expected a longer path or fewer points'):
        time_optimal(arm, [start, start + distance], points=points)


def test_joints_at_rest_far_from_zero_do_not_count_as_coarse():
    start = np.array([0.0, -1.2, 1.4, -0.2, 6.2, 0.0])
    arm = Robot(load_urdf('urdf/ur10e.urdf'))
    timing = time_optimal(arm,
                          [start, start + np.array([1e-5, 0.0, 0.0, 0.0, 0.0, 0.0])])
    assert demand(arm, timing.motion).uses['effort'].max() < 1.001


@pytest.mark.parametrize(('distance', 'points'), [(1e-4, 1000), (1e-1, 50_000)])
def test_a_short_path_keeps_the_limits_where_its_positions_resolve_it(distance, points):
    start = np.array([0.0, -1.2, 1.4, -0.2, 1.57, 0.0])
    arm = Robot(load_urdf('urdf/ur10e.urdf'))
    timing = time_optimal(arm, [start, start + distance], points=points)
    assert demand(arm, timing.motion).uses['effort'].max() < 1.001
