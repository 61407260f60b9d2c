"""Tolerances, judgements and stops of FollowJointTrajectory, without a ROS graph."""

from functools import partial
import math
import sys
from types import SimpleNamespace

from hypothesis import given, settings, strategies as st
import numpy as np
import pytest

pytest.importorskip('rclpy')
pytest.importorskip('kane_dynamics_interfaces')

from builtin_interfaces.msg import Duration  # noqa: E402, I100
from kane_dynamics import (  # noqa: E402
    InputError, load_urdf, Motion, Robot, SmoothMotion)
from kane_dynamics._util.resources import resource_path  # noqa: E402
from kane_dynamics.control.elastic_control import derivatives_of  # noqa: E402
from kane_dynamics.motion.smooth_motion import require_smooth  # noqa: E402
from kane_dynamics.ros.common.conversion import JointNamesError  # noqa: E402
from kane_dynamics.ros.joint_trajectory_action.action_server import (  # noqa: E402
    follow_joint_trajectory_type, FollowedGoal, JointTrajectoryAction)
from kane_dynamics.ros.joint_trajectory_action.goal_monitor import (  # noqa: E402
    ACCELERATION_WINDOW, GoalMonitor, ResultCode)
from kane_dynamics.ros.joint_trajectory_action.goal_tolerances import (  # noqa: E402
    goal_tolerances, GoalTolerances, StateTolerance)
from kane_dynamics.ros.joint_trajectory_action.stop_motion import (  # noqa: E402
    HEADROOM, limit_demand, SHORTEST, stop_along, stop_from)
from node_values import node_values, served_robot  # noqa: E402
from palletizer import DRIVEN, palletizer, positions  # noqa: E402

NANO = 10**9
JOINTS = ('a', 'b')
MOTION = Motion.from_points([0.0, 1.0, 2.0], [[0.0, 0.0], [1.0, -0.5], [0.4, 0.3]],
                            joint_names=JOINTS)
START = 50 * NANO
ARM = Robot(load_urdf(resource_path('urdf', 'fr3.urdf'),
                      joints=[f'fr3_joint{k}' for k in range(1, 8)]))
HOME = np.array([0.0, -0.7, 0.0, -2.2, 0.0, 1.6, 0.8])


def tolerance(position=math.inf, velocity=math.inf, acceleration=math.inf):
    return StateTolerance(*(np.broadcast_to(value, 2).astype(float)
                            for value in (position, velocity, acceleration)))


def states(first, last, step=0.002, q_error=0.0, u_error=0.0):
    """Return stamps, positions, velocities around the motion; errors by time."""
    moments = np.arange(first, last, step)
    q, u, _ = MOTION.sample(moments)
    q_error = q_error(moments)[:, None] if callable(q_error) else q_error
    u_error = u_error(moments)[:, None] if callable(u_error) else u_error
    return START + np.round(moments * NANO).astype(np.int64), q - q_error, u - u_error


def outcome(pieces, tolerances):
    """Return the first outcome when states arrive in pieces."""
    monitor = GoalMonitor(MOTION, START, tolerances)
    for piece in pieces:
        if (result := monitor.judge(*piece)) is not None:
            return result
    return None


def by_definition(stamps, q, u, tolerances):
    """Judge one state after another, as the message defines the tolerances."""
    past = []
    for stamp, position, velocity in zip(stamps, q, u):
        moment = (stamp - START) / NANO
        desired = MOTION.sample(moment)
        errors = [desired[0] - position, desired[1] - velocity, np.zeros(2)]
        old = [entry for entry in past if moment - entry[0] >= ACCELERATION_WINDOW]
        if old:
            errors[2] = (errors[1] - old[-1][1]) / (moment - old[-1][0])
        past.append((moment, errors[1]))
        limits = tolerances.path if moment < MOTION.duration else tolerances.goal
        within = all((np.abs(error) <= getattr(limits, name)).all()
                     for name, error in zip(
                         ('position', 'velocity', 'acceleration'), errors))
        if 0.0 <= moment < MOTION.duration and not within:
            return ResultCode.PATH_TOLERANCE_VIOLATED, moment
        if moment >= MOTION.duration and within:
            return ResultCode.SUCCESSFUL, moment
        if moment >= MOTION.duration + tolerances.time and not within:
            return ResultCode.GOAL_TOLERANCE_VIOLATED, moment
    return None


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.integers(1, 40))
def test_judged_in_pieces_a_goal_ends_as_by_the_definition_state_by_state(seed, piece):
    random = np.random.default_rng(seed)
    stamps, q, u = states(-0.1, 3.5, 0.007)
    u = u + np.cumsum(random.normal(size=u.shape), axis=0) * 2e-3
    q = q + np.cumsum(random.normal(size=q.shape), axis=0) * 1e-3
    limits = [tolerance(*10.0 ** random.uniform(-2.0, 0.5, 3)) for _ in range(2)]
    tolerances = GoalTolerances(*limits, float(random.uniform(0.0, 1.0)))
    pieces = []
    for k in range(0, len(stamps), piece):
        pieces.append(tuple(column[k:k + piece] for column in (stamps, q, u)))
    expected = by_definition(stamps, q, u, tolerances)
    result = outcome(pieces, tolerances)
    assert (result is None) == (expected is None)
    if expected is not None:
        assert result.code is expected[0]
        moment = expected[1]
        if result.code is not ResultCode.PATH_TOLERANCE_VIOLATED:
            moment -= MOTION.duration
        assert f' {moment:.3f} s ' in result.text


def test_the_text_names_the_joint_the_error_the_time_and_the_tolerance():
    tolerances = GoalTolerances(tolerance([0.3, 0.1]), tolerance(0.02), 0.5)
    error = np.array([0.0, 0.15])
    result = outcome([states(0.5, 1.0, q_error=error)], tolerances)
    assert result.text == (
        "joint 'b': position error 0.15 rad or m at 0.500 s of 2.000 s; "
        'expected at most 0.1 (path tolerance)')
    result = outcome([states(1.99, 3.0, q_error=-0.4 * error)], tolerances)
    assert result.code is ResultCode.GOAL_TOLERANCE_VIOLATED
    assert result.text.startswith(
        "joint 'b': position error -0.06 rad or m 0.500 s after the end")


def test_before_its_start_a_goal_is_not_judged_and_afterwards_its_path_is_not():
    tight = GoalTolerances(tolerance(1e-6), tolerance(1e-6), math.inf)
    assert outcome([states(-1.0, 0.0, q_error=1.0)], tight) is None
    assert outcome([states(2.0, 9.0, q_error=1.0)], tight) is None


def test_a_constant_velocity_error_is_no_acceleration_error():
    tight = GoalTolerances(tolerance(acceleration=1e-3), tolerance(), 0.0)
    assert outcome([states(0.0, 1.9, u_error=3.0)], tight) is None
    result = outcome([states(0.0, 1.9, u_error=lambda t: 0.5 * t)], tight)
    assert result.text.startswith(
        "joint 'a': acceleration error 0.5 rad/s^2 or m/s^2 at 0.020 s")


# Tolerances of a goal.

VALUES = node_values({'trajectory.path_tolerance': [0.3, 0.4, 0.5],
                      'trajectory.goal_tolerance': 0.02,
                      'trajectory.stopped_speed': 0.07, 'trajectory.goal_time': 1.5})
EVERY_JOINT = ('b', 'passive', 'a')


def entry(name, position=0.0, velocity=0.0, acceleration=0.0, **others):
    return SimpleNamespace(name=name, position=position, velocity=velocity,
                           acceleration=acceleration, **others)


def stated(path=(), goal=(), seconds=(0, 0)):
    sec, nanosec = seconds
    goal = SimpleNamespace(path_tolerance=path, goal_tolerance=goal,
                           goal_time_tolerance=Duration(sec=sec, nanosec=nanosec))
    return goal_tolerances(goal, JOINTS, EVERY_JOINT, VALUES)


def test_zero_means_the_parameter_and_minus_one_none():
    defaults = stated()
    assert defaults.path.position.tolist() == [0.5, 0.3]
    assert np.isinf(defaults.path.velocity).all()
    assert defaults.goal.position.tolist() == [0.02, 0.02]
    assert defaults.goal.velocity.tolist() == [0.07, 0.07]
    assert defaults.time == 1.5
    tolerances = stated([entry('b', -1.0, 2.0, 3.0), entry('a')],
                        [entry('a', 0.1, -1.0, effort=-1.0)], (2, NANO // 2))
    assert tolerances.path.position.tolist() == [0.5, math.inf]
    assert tolerances.path.velocity.tolist() == [math.inf, 2.0]
    assert tolerances.path.acceleration.tolist() == [math.inf, 3.0]
    assert tolerances.goal.position.tolist() == [0.1, 0.02]
    assert tolerances.goal.velocity.tolist() == [math.inf, 0.07]
    assert tolerances.time == 2.5
    assert stated(seconds=(-1, 0)).time == math.inf


@pytest.mark.parametrize(('fields', 'kind', 'words'), [
    ({'path': [entry('passive', 1.0)]}, JointNamesError,
     "path_tolerance: 'passive'; expected"),
    ({'goal': [entry('a', 1.0), entry('a')]}, InputError, "goal_tolerance: 'a' twice"),
    ({'goal': [entry('a', -0.5)]}, InputError,
     "goal_tolerance of 'a': position -0.5; expected"),
    ({'path': [entry('b', 0.0, math.nan)]}, InputError,
     "'b': velocity nan; expected a positive"),
    ({'path': [entry('b', effort=2.0)]}, InputError, "'b': effort 2; expected 0 or -1"),
    ({'seconds': (-2, 0)}, InputError, 'goal_time_tolerance -2; expected a positive'),
])
def test_impossible_tolerances_are_refused(fields, kind, words):
    with pytest.raises(kind, match=words):
        stated(**fields)


# Stops.

def arm_motion(seed):
    random = np.random.default_rng(seed)
    rows = HOME + random.uniform(-0.3, 0.3, (4, 7))
    return Motion.from_points([0.0, 0.5, 1.1, 1.6], rows, joint_names=ARM.joint_names)


def demand_of(served, rate=20.0):
    effort = served.robot.limits.effort
    return partial(limit_demand, served, effort, rate * effort)


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 2**31), st.floats(0.02, 1.55), st.booleans())
def test_a_stop_stays_on_the_path_begins_smoothly_and_keeps_the_limits(
        seed, moment, elastic):
    motion = arm_motion(seed)
    served = served_robot(ARM)
    stop = stop_along(motion, moment, demand_of(served), elastic=elastic)
    if stop is None:
        assert motion.duration - moment < 0.5
        return
    for ours, its in zip(stop.sample(0.0), motion.sample(moment)):
        np.testing.assert_allclose(ours, its, atol=1e-9)
    q, u, udot = stop.sample(stop.duration)
    np.testing.assert_allclose(q, motion.sample(moment + 0.5 * stop.duration)[0],
                               atol=1e-9)
    np.testing.assert_allclose(u, 0.0, atol=1e-9)
    np.testing.assert_allclose(udot, 0.0, atol=1e-9)
    # Every position is one of the path, at the time that the rate gives by its integral.
    t = np.linspace(0.0, stop.duration, 400)
    x = t / stop.duration
    rate = 1.0 - 3.0 * x**2 + 2.0 * x**3
    if elastic:
        rate = 1.0 - 10.0 * x**3 + 15.0 * x**4 - 6.0 * x**5
    passed = np.concatenate(
        [[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(t))])
    np.testing.assert_allclose(stop.sample(t)[0], motion.sample(moment + passed)[0],
                               atol=1e-4)
    tau = ARM.inverse_dynamics(*stop.sample(t))
    if stop.duration > SHORTEST and demand_of(served)(stop) <= HEADROOM:
        assert (np.abs(tau) <= ARM.limits.effort).all()


def test_the_jerk_of_a_stop_of_elastic_joints_does_not_jump_along_a_smooth_path():
    points = HOME + np.array([[0.0], [0.3], [-0.1]])
    smooth = SmoothMotion.from_points([0.0, 0.8, 1.6], points,
                                      joint_names=ARM.joint_names)
    t = np.linspace(0.0, 1.6, 161)
    motion = Motion.from_points(t, *smooth.sample(t)[:3], joint_names=ARM.joint_names)
    moving = derivatives_of(motion, np.array([0.5]))[0, 1:4]
    demand = demand_of(served_robot(ARM))
    require_smooth(stop_along(motion, 0.5, demand, elastic=True), 0.0, moving)
    with pytest.raises(InputError, match='the jerk of joint'):
        require_smooth(stop_along(motion, 0.5, demand), 0.0, moving)


def test_no_shorter_stop_keeps_the_limits():
    served = served_robot(ARM)
    fast = arm_motion(3).scaled(2.5)
    demand = demand_of(served, rate=5.0)
    stop = stop_along(fast, 0.2, demand)
    assert stop.duration > SHORTEST
    assert demand(stop) <= HEADROOM
    free = stop_along(fast, 0.2, demand_of(served, math.inf))
    assert free.duration < stop.duration


def test_a_stop_from_a_state_ends_at_rest_within_the_position_limits():
    served = served_robot(ARM)
    q = HOME.copy()
    q[0] = ARM.limits.upper[0] - 0.02
    u = np.array([0.5, 0.3, -0.2, 0.1, 0.0, 0.4, -0.6])
    stop = stop_from(served, ARM.joint_names, q, u, demand_of(served))
    np.testing.assert_allclose(stop.sample(0.0)[1], u, atol=1e-12)
    end, rates, _ = stop.sample(stop.duration)
    np.testing.assert_allclose(rates, 0.0, atol=1e-12)
    np.testing.assert_allclose(end, q + 0.5 * stop.duration * u, rtol=1e-12)
    # Nearer than any stop can be: the arm holds where it is.
    q[0] = ARM.limits.upper[0] - 1e-4
    held = stop_from(served, ARM.joint_names, q, u, demand_of(served))
    assert held.duration == 0.0
    np.testing.assert_array_equal(held.positions, [q])


def test_the_loops_of_an_arm_close_along_its_stop():
    robot = palletizer()
    q = np.array([positions(robot, *angles) for angles in ((0.0, 0.1, -0.2, 0.0),
                                                           (0.4, 0.3, 0.0, 0.2))])
    served = served_robot(robot, measured=lambda: q[0])
    columns = [robot.joint_names.index(name) for name in DRIVEN]
    motion = Motion.from_points([0.0, 0.8], q[:, columns], joint_names=DRIVEN)
    effort = np.full(robot.n_q, 1e4)
    stop = stop_along(motion, 0.4, partial(limit_demand, served, effort, 20.0 * effort))
    assert stop is not None
    np.testing.assert_allclose(stop.sample(stop.duration)[0],
                               motion.sample(0.4 + 0.5 * stop.duration)[0], atol=1e-9)


def test_without_control_msgs_the_reason_is_one_line(monkeypatch):
    monkeypatch.setitem(sys.modules, 'control_msgs.action', None)
    with pytest.raises(
            InputError, match='^action ~/follow_joint_trajectory: not served without '
            'control_msgs/FollowJointTrajectory .*; expected an installed package '
            r'control_msgs$'):
        follow_joint_trajectory_type()


def test_a_goal_that_is_no_longer_judged_stops_the_arm_before_it_ends():
    """A stop along the path may fail for the reason for which the judgement did."""
    done = []
    path = SimpleNamespace(
        now=0, remove_observer=lambda record: done.append('end'),
        interrupt=lambda stamp, reason: done.append('stop'),
        running=True, active_motion=None)
    handle = SimpleNamespace(abort=lambda: done.append('abort'))
    goal = FollowedGoal(handle, path, ARM, MOTION, 0, None, None)
    action = object.__new__(JointTrajectoryAction)
    action._goal, action._timer = goal, None
    action._log = SimpleNamespace(error=done.append, warning=done.append)
    action._node = SimpleNamespace(destroy_timer=lambda timer: None)
    action._server = SimpleNamespace(served=None)
    action._judge()  # neither the judgement nor the stop along the path is possible
    assert done[1:4] == ['stop', 'end', 'abort']
    assert goal.outcome.code is ResultCode.INVALID_GOAL
    assert 'internal error' in goal.outcome.text and 'no stop along the path' in done[0]
