"""Filled trajectories: the controller's motion, efforts in between, limits."""

from dataclasses import replace
from functools import cache
import math

from kane_dynamics import load_urdf, Motion, QuasiStatic, Robot, stiffened, Terms
from kane_dynamics._util.resources import resource_path
from kane_dynamics.control.trajectory_feedforward import fill_trajectory, PROBES
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.spline import (spline_velocities,
                                                    tridiagonal_solution)
from kane_dynamics.model.inertial import Inertial
from kane_dynamics.robot.robot import TORQUE_TERMS
import numpy as np
import pytest
from scipy.interpolate import BPoly, CubicSpline

URDF = resource_path('urdf', 'two_link.urdf')
JOINTS = tuple(f'fr3_joint{k}' for k in range(1, 8))
HOME = np.array([0.0, -0.4, 0.0, -2.0, 0.0, 1.7, 0.8])
TIMES = np.array([0.0, 0.4, 0.9, 1.2, 2.0])
POINTS = HOME + 0.3 * np.random.default_rng(0).uniform(-1.0, 1.0, (5, 7))


@cache
def arm(**options):
    return Robot(load_urdf(resource_path('urdf', 'fr3.urdf'), joints=JOINTS), **options)


@cache
def two_link():
    return Robot(load_urdf(URDF))


def executed(filled, t):
    """Return q, u, udot that quintics through the points have at some times."""
    curve = BPoly.from_derivatives(filled.times, np.stack(
        [filled.positions, filled.velocities, filled.accelerations], axis=1))
    return curve(t), curve(t, 1), curve(t, 2)


def interpolated(filled, t):
    """Return the efforts that the controller interpolates linearly."""
    return np.stack([np.interp(t, filled.times, column) for column in filled.efforts.T],
                    axis=1)


def inside(times, count=101):
    return np.linspace(times[0], times[-1], count)[1:-1]


def points_with_derivatives(kind):
    """Return positions, with velocities, then accelerations, of a smooth motion."""
    spline = CubicSpline(TIMES, POINTS, bc_type='clamped')
    return [POINTS, spline(TIMES, 1), spline(TIMES, 2)][:kind]


@pytest.mark.parametrize('kind', [1, 2, 3])
def test_efforts_are_those_of_the_motion_that_the_controller_executes(kind):
    filled = fill_trajectory(arm(), TIMES, *points_with_derivatives(kind))
    for mine, theirs in zip((filled.positions, filled.velocities),
                            points_with_derivatives(kind), strict=False):
        np.testing.assert_array_equal(mine, theirs)
    np.testing.assert_allclose(filled.efforts, arm().inverse_dynamics(
        filled.positions, filled.velocities, filled.accelerations), rtol=0, atol=1e-12)
    t = inside(TIMES)
    for mine, theirs in zip(filled.motion.sample(t), executed(filled, t), strict=True):
        np.testing.assert_allclose(mine, theirs, atol=1e-9)


def test_positions_only_give_the_cubic_spline_between_inner_points():
    filled = fill_trajectory(arm(), TIMES, POINTS)
    spline = CubicSpline(TIMES, POINTS, bc_type='clamped')
    t = np.linspace(TIMES[1], TIMES[-2], 50)
    np.testing.assert_allclose(executed(filled, t)[0], spline(t), atol=1e-12)


@pytest.mark.parametrize('kind', [1, 2, 3])
def test_a_trajectory_from_rest_to_rest_ends_with_the_effort_that_holds_the_arm(kind):
    """The controller holds the last effort for as long as it holds the last point."""
    filled = fill_trajectory(arm(), TIMES, *points_with_derivatives(kind))
    assert not filled.accelerations[-1].any()
    np.testing.assert_allclose(filled.efforts[-1], arm().gravity_force(POINTS[-1]),
                               atol=1e-12)


def test_accelerations_at_points_are_the_mean_of_both_cubics():
    u = np.random.default_rng(1).normal(size=POINTS.shape)
    filled = fill_trajectory(arm(), TIMES, POINTS, 0.1 * u, effort_limit=math.inf)
    cubic = BPoly.from_derivatives(TIMES, np.stack([POINTS, 0.1 * u], axis=1))
    for k in range(1, 4):
        sides = [cubic(TIMES[k] + e, 2) for e in (-1e-9, 1e-9)]
        np.testing.assert_allclose(filled.accelerations[k], np.mean(sides, axis=0),
                                   rtol=1e-6)
    # At the ends, where the arm moves, that of the one cubic.
    np.testing.assert_allclose(filled.accelerations[0], cubic(0.0, 2), rtol=1e-6)
    np.testing.assert_allclose(filled.accelerations[-1], cubic(TIMES[-1] - 1e-9, 2),
                               rtol=1e-6)


@pytest.mark.parametrize('tolerance', [1.0, 0.05])
@pytest.mark.parametrize('kind', [1, 2, 3])
def test_inserted_points_keep_the_interpolated_effort_within_the_tolerance(
        kind, tolerance):
    plain = fill_trajectory(arm(), TIMES, *points_with_derivatives(kind))
    filled = fill_trajectory(arm(), TIMES, *points_with_derivatives(kind),
                             tolerance=tolerance)
    assert filled.inserted == len(filled.times) - len(TIMES) > 0
    assert set(TIMES) <= set(filled.times)
    assert (filled.effort_error <= tolerance).all()
    t = inside(TIMES, 5001)
    state = executed(filled, t)
    for mine, theirs in zip(state, executed(plain, t), strict=True):  # the same motion
        np.testing.assert_allclose(mine, theirs, atol=1e-9)
    error = np.abs(interpolated(filled, t) - arm().inverse_dynamics(*state)).max(axis=0)
    # Checked at eighths of each segment.
    assert (error <= 1.05 * filled.effort_error).all()
    assert np.abs(
        interpolated(plain, t) - arm().inverse_dynamics(*state)).max() > tolerance


def test_an_infinite_tolerance_reports_the_error_and_inserts_nothing():
    filled = fill_trajectory(arm(), TIMES, POINTS, tolerance=math.inf)
    t = (TIMES[:-1, None] + np.diff(TIMES)[:, None] * PROBES).ravel()
    error = np.abs(
        interpolated(filled, t) - arm().inverse_dynamics(*executed(filled, t)))
    assert filled.inserted == 0
    np.testing.assert_allclose(filled.effort_error, error.max(axis=0), rtol=1e-9)
    assert fill_trajectory(arm(), TIMES, POINTS).effort_error is None


def test_insertion_is_bounded():
    with pytest.raises(InputError,
                       match=r'tolerance: [0-9]+ points or more; expected at most 50'):
        fill_trajectory(arm(), TIMES, POINTS, tolerance=1e-6, max_points=50)
    with pytest.raises(InputError,
                       match='trajectory: 5 points or more; expected at most 4'):
        fill_trajectory(arm(), TIMES, POINTS, max_points=4)


def test_coulomb_friction_is_that_of_the_desired_velocity_and_zero_at_standstill():
    robot = Robot(load_urdf(URDF, supplement={'joints': {
        name: {'friction': 2.0} for name in two_link().joint_names}}))
    points = np.array([[0.0, 0.0], [0.8, 0.4], [0.0, 0.0]])
    filled = fill_trajectory(robot, [0.0, 1.0, 2.0], points, tolerance=0.02)
    np.testing.assert_allclose(filled.efforts[[0, -1]],
                               robot.gravity_force(points[[0, -1]]), atol=1e-12)
    terms = robot.torque_terms(filled.positions, filled.velocities, filled.accelerations)
    friction = terms[:, TORQUE_TERMS.index('friction')]
    np.testing.assert_allclose(friction, robot.friction_force(filled.velocities),
                               atol=1e-12)
    assert (friction.min(axis=0) < -1.9).all() and (friction.max(axis=0) > 1.9).all()
    t = inside([0.0, 2.0], 2001)
    expected = robot.inverse_dynamics(*executed(filled, t))
    assert np.abs(interpolated(filled, t) - expected).max() <= 0.021


def test_terms_that_the_arm_adds_itself_are_left_out():
    names = ('inertia', 'coriolis', 'gravity', 'friction')
    state = fill_trajectory(arm(), TIMES, POINTS)
    terms = arm().torque_terms(state.positions, state.velocities, state.accelerations)
    for name in names:
        filled = fill_trajectory(arm(), TIMES, POINTS, compensate=Terms(**{name: False}))
        np.testing.assert_allclose(state.efforts - filled.efforts,
                                   terms[:, TORQUE_TERMS.index(name)], atol=1e-10)


def test_efforts_follow_the_payload_and_gravity_of_the_robot():
    robot = arm(payload_frame='fr3_link7').copy()
    torque_before = fill_trajectory(robot, TIMES, POINTS).efforts
    robot.parameters.payload = Inertial(2.0, np.array([0.0, 0.0, 0.1]), np.zeros((3, 3)))
    filled = fill_trajectory(robot, TIMES, POINTS)
    np.testing.assert_allclose(filled.efforts, robot.inverse_dynamics(
        filled.positions, filled.velocities, filled.accelerations), atol=1e-12)
    assert np.abs(filled.efforts - torque_before).max() > 5.0
    robot.parameters.gravity = np.zeros(3)
    assert np.abs(
        fill_trajectory(robot, TIMES, POINTS).efforts - filled.efforts).max() > 5.0


def test_some_joints_in_any_order_with_the_others_at_rest():
    names = JOINTS[4:2:-1]
    filled = fill_trajectory(arm(), TIMES, POINTS[:, [4, 3]],
                             joint_names=names, rest=HOME)
    q, u, udot = (np.zeros((5, 7)) for _ in range(3))
    q[:] = HOME
    for whole, part in zip((q, u, udot), (filled.positions, filled.velocities,
                                          filled.accelerations), strict=True):
        whole[:, [4, 3]] = part
    np.testing.assert_allclose(filled.efforts,
                               arm().inverse_dynamics(q, u, udot)[:, [4, 3]], atol=1e-12)
    with pytest.raises(InputError,
                       match=r'joint_names: without fr3_joint1, .*; expected these'):
        fill_trajectory(arm(), TIMES, POINTS[:, [4, 3]], joint_names=names)
    with pytest.raises(InputError,
                       match="joint_names: 'gripper' is not a joint of the robot"):
        fill_trajectory(arm(), TIMES, POINTS[:, [4, 3]],
                        joint_names=('fr3_joint1', 'gripper'))


@pytest.mark.parametrize('kind', [1, 2, 3])
def test_a_later_first_point_is_approached_from_the_start(kind):
    filled = fill_trajectory(arm(), TIMES + 0.5, *points_with_derivatives(kind),
                             start=(HOME, None, None))
    assert filled.times[0] == 0.0
    assert len(filled.times) == 6
    np.testing.assert_array_equal(filled.positions[0], HOME)
    assert not filled.velocities[0].any() and not filled.accelerations[0].any()
    np.testing.assert_allclose(filled.efforts[0], arm().gravity_force(HOME), atol=1e-12)
    same = fill_trajectory(arm(), TIMES, POINTS, start=(HOME, None, None))
    np.testing.assert_array_equal(same.positions, POINTS)


def test_a_joint_without_limits_starts_at_the_angle_next_to_the_first_point():
    robot = two_link().copy()
    limits = robot.limits
    robot.limits = replace(limits, lower=np.array([-math.inf, limits.lower[1]]),
                           upper=np.array([math.inf, limits.upper[1]]))
    filled = fill_trajectory(robot, [2.0], [[6.2, 0.1]], start=([0.05, 0.2], None, None))
    np.testing.assert_allclose(filled.positions[0], [0.05 + 2.0 * math.pi, 0.2])


def test_a_single_point_is_held():
    filled = fill_trajectory(arm(), [0.0], POINTS[:1], tolerance=0.1)
    np.testing.assert_allclose(filled.efforts, arm().gravity_force(POINTS[:1]),
                               atol=1e-12)


def overshooting():
    """Return two points within the limits between which the motion leaves them."""
    upper = arm().limits.upper[3]
    q = np.array([HOME, HOME])
    q[:, 3] = upper - 0.01
    u = np.zeros((2, 7))
    u[:, 3] = 0.5, -0.5
    return q, u


@pytest.mark.parametrize(('arguments', 'message'), [
    ((TIMES, POINTS + np.array([[0.0], [0.0], [9.0], [0.0], [0.0]])),
     r"joint 'fr3_joint\d': position .* at point 2 \(0.9 s\); expected at most "),
    (([0.0, 1.0], *overshooting()), (r"joint 'fr3_joint4': position \S+ after point 0 "
                                     r'\(at 0.5 s\); expected at most -0.1')),
    ((0.1 * TIMES, POINTS),
     r"joint 'fr3_joint\d': velocity .*; expected at (most|least) ")])
def test_a_limit_that_is_exceeded_is_named_with_joint_point_value_and_bound(
        arguments, message):
    with pytest.raises(InputError, match=message):
        fill_trajectory(arm(), *arguments)


def test_efforts_are_clamped_where_that_is_asked_for():
    bound = np.full(7, 20.0)
    free = fill_trajectory(arm(), TIMES, POINTS)
    filled = fill_trajectory(arm(), TIMES, POINTS, effort_limit=bound, clip=True)
    np.testing.assert_array_equal(filled.efforts, np.clip(
        free.efforts, -np.minimum(bound, arm().limits.effort),
        np.minimum(bound, arm().limits.effort)))
    with pytest.raises(InputError, match=r"joint 'fr3_joint2': effort -\S+ at point \d "
                       r'\(\S+ s\); expected at least -20$'):
        fill_trajectory(arm(), TIMES, POINTS, effort_limit=bound)


def test_bad_points_are_refused_like_those_of_a_motion():
    for arguments in (([0.0, 0.0], POINTS[:2]), ([0.0, math.nan], POINTS[:2]),
                      ([0.0], POINTS[:1, :3]), ([0.0, 1.0], POINTS[:2] * math.nan),
                      ([0.0, 1.0], POINTS[:2], None, POINTS[:2])):
        with pytest.raises(InputError) as mine:
            fill_trajectory(arm(), *arguments)
        with pytest.raises(InputError) as theirs:
            Motion.from_points(*arguments, joint_names=JOINTS)
        assert str(mine.value) == str(theirs.value)


def test_a_motion_that_overflows_is_an_error():
    robot = two_link().copy()
    largest = np.full(2, math.inf)
    robot.limits = replace(robot.limits, lower=-largest, upper=largest, velocity=largest)
    with pytest.raises(InputError,
                       match='the result of state 1 is not finite: the arguments'):
        fill_trajectory(robot, [0.0, 1.0, 1.0 + 1e-8],
                        [[0.0, 0.0], [0.1, 0.1], [1.0, -1.0]],
                        [[0.0, 0.0], [1e200, 1e200], [0.0, 0.0]])


@pytest.mark.parametrize(('change', 'message'), [
    ({'robot': None}, 'robot: a NoneType; expected a Robot'),
    ({'times': [0.0, 1e300]}, r'point 1: time 1e\+300 s; expected at most 2147483647 s'),
    ({'times': [0.0, 1e-10]},
     'point 1: 1e-10 s after point 0; expected at least 1e-09 s'),
    ({'joint_names': 'joint1'}, "joint_names: 'joint1'; expected a list of joint names"),
    ({'joint_names': 3}, 'joint_names: 3; expected a list'),
    ({'start': 3}, 'start: 3; expected positions, velocities and accelerations'),
    ({'start': ([0.0], None)}, r'start: \(.*; expected positions, velocities and'),
    ({'compensate': {'gravity': False}}, 'compensate: a dict; expected a Terms'),
    ({'max_points': math.nan}, 'max_points: nan; expected an integer >= 1'),
    ({'max_points': '5'}, "max_points: '5'; expected an integer >= 1"),
    ({'bending': two_link()}, 'bending: a Robot; expected a QuasiStatic')])
def test_an_invalid_argument_is_refused_by_name(change, message):
    arguments = {'robot': two_link(), 'times': [0.0, 1.0], 'positions': np.zeros((2, 2)),
                 **change}
    with pytest.raises(InputError, match=message):
        fill_trajectory(**arguments)


@pytest.mark.parametrize('value', ['no', 2, None])
def test_a_switch_of_a_torque_term_is_true_or_false(value):
    with pytest.raises(InputError, match=r'gravity: .*; expected True or False'):
        Terms(gravity=value)


def test_a_flexible_arm_includes_the_deflection_of_its_links():
    flexible = load_urdf(URDF, supplement=resource_path('urdf', 'two_link.bending.yaml'))
    bending = QuasiStatic(Robot(flexible))
    points = np.array([[0.0, 0.0], [0.4, 0.3]])
    filled = fill_trajectory(Robot(stiffened(flexible)), [0.0, 1.0], points,
                             tolerance=0.1, bending=bending)
    state = filled.positions, filled.velocities, filled.accelerations
    np.testing.assert_allclose(filled.efforts, bending.inverse_dynamics(*state),
                               atol=1e-9)
    assert np.abs(filled.efforts - two_link().inverse_dynamics(*state)).max() > 1e-3


@pytest.mark.parametrize('count', [1, 2, 3, 4, 5, 8, 13, 100])
def test_cyclic_reduction_solves_tridiagonal_equations(count):
    rng = np.random.default_rng(count)
    a, c, d = rng.normal(size=(3, count, 1))
    b = 3.0 + np.abs(a) + np.abs(c)
    d = rng.normal(size=(count, 3))
    M = np.diag(b[:, 0]) + np.diag(a[1:, 0], -1) + np.diag(c[:-1, 0], 1)
    np.testing.assert_allclose(tridiagonal_solution(a, b, c, d), np.linalg.solve(M, d),
                               rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize('count', [2, 3, 4, 5, 6, 33])
def test_spline_velocities_are_those_of_the_clamped_spline(count):
    rng = np.random.default_rng(count)
    t = np.cumsum(rng.uniform(0.01, 1.0, count))
    q = rng.normal(size=(count, 2))
    first = (rng.normal(size=2))
    peer = CubicSpline(t, q, bc_type=((1, first), (1, np.zeros(2))))
    np.testing.assert_allclose(spline_velocities(t, q, first), peer(t, 1),
                               rtol=1e-11, atol=1e-11)
