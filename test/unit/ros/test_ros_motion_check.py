"""Impossible motions are refused with the reason, on topics and services."""

from functools import partial

from hypothesis import given, settings, strategies as st
import numpy as np
import pytest

pytest.importorskip('rclpy')
pytest.importorskip('kane_dynamics_interfaces')

from kane_dynamics import KaneError, load_urdf, Motion, Robot  # noqa: E402, I100
from kane_dynamics._util.resources import resource_path  # noqa: E402
from kane_dynamics.loop_tracking.loop_error import LoopError  # noqa: E402
from kane_dynamics.robot.parameters import JointLimits  # noqa: E402
from kane_dynamics.ros.services.motion_check import refuse_impossible  # noqa: E402
from kane_dynamics.ros.services.trajectory_filling import filled_message  # noqa: E402
from node_values import served_robot, UNCHECKED  # noqa: E402
from palletizer import DRIVEN, palletizer, positions, SINGULAR_SHOULDER  # noqa: E402
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint  # noqa: E402

NANO = 10**9
ARM = Robot(load_urdf(resource_path('urdf', 'fr3.urdf'),
                      joints=[f'fr3_joint{k}' for k in range(1, 8)]))
HOME = np.array([0.0, -0.7, 0.0, -2.2, 0.0, 1.6, 0.8])
NEAR = HOME + 0.1
LIMITS = ARM.limits


def served(changes=None, robot=ARM, measured=HOME):
    return served_robot(robot, changes, lambda: measured)


def motion(times, rows, joints=ARM.joint_names):
    return Motion.from_points(times, rows, joint_names=joints)


def home_moved(joint, by):
    q = HOME.copy()
    q[joint] += by
    return q


IMPOSSIBLE = {  # times, positions, reason
    'beyond a limit': ([0.0, 9.0], [HOME, home_moved(0, 3.0)],
                       ("joint 'fr3_joint1': "
                        r'position 3 at point 1 \(9 s\); expected at most')),
    'degrees': ([0.0, 9.0], [HOME, np.degrees(NEAR)],
                (r'position -120\.\d* at point 1 '
                 r'.* at least .*\(-2\.1 rad, if these are deg')),
    'beyond a limit between points': ([0.0, 1.0, 9.0],
                                      [HOME, home_moved(0, 2.7), home_moved(0, 2.4)],
                                      r"joint 'fr3_joint1': position .* after point 1"),
    'far from the arm': ([0.0, 9.0], [home_moved(1, 0.5), HOME],
                         ("'fr3_joint2': the "
                          r'motion sets out at -0\.2, the arm is at -0\.7 rad')),
    'too fast': ([0.0, 0.02], [HOME, NEAR],
                 (r"joint 'fr3_joint\d': speed .* expected at "
                  r'most .*, 1\.2 times its limit')),
    'far and at once': ([0.01], [home_moved(1, 0.5)], r"joint 'fr3_joint2': speed"),
    'too strong': (
        [0.0, 0.03, 0.06, 0.09], [HOME, home_moved(1, 0.03), HOME, home_moved(1, 0.03)],
        r"joint 'fr3_joint\d': effort .* expected at most .*, 1\.2 times its limit"),
}


def with_speeds(first, last):
    """Return times, positions and velocities of a motion, with two speeds of a joint."""
    speeds = np.zeros((3, 7))
    speeds[0, 1], speeds[2, 1] = first, last
    return [0.0, 1.0, 2.0], [HOME, home_moved(1, 0.3), home_moved(1, 0.6)], speeds


ENDS = {  # speeds at the first and the last point, reason
    'a speed at the end': (0.0, 2.4, (
        r"joint 'fr3_joint2': velocity 2\.4 rad/s or m/s at the last point \(2 s\); "
        'expected 0')),
    'a speed at the begin': (-0.5, 0.0, (
        r'velocity -0\.5 rad/s or m/s where the motion sets out \(0 s\); expected 0, '
        'the desired speed until then, or a first point after 0 s')),
}


def trajectory(times, rows, joints=ARM.joint_names, stamp=0):
    message = JointTrajectory(joint_names=list(joints))
    message.header.stamp.sec = stamp
    for t, q in zip(times, rows):
        point = JointTrajectoryPoint(positions=list(map(float, q)))
        point.time_from_start.sec, point.time_from_start.nanosec = divmod(
            round(t * NANO), NANO)
        message.points.append(point)
    return message


@pytest.mark.parametrize('fault', IMPOSSIBLE)
def test_an_impossible_motion_is_refused_with_the_reason(fault):
    times, rows, reason = IMPOSSIBLE[fault]
    start = (HOME, None, None)
    with pytest.raises(KaneError, match=reason):
        refuse_impossible(served(), Motion.from_points(
            times, rows, joint_names=ARM.joint_names, start=start), HOME)


@pytest.mark.parametrize('fault', IMPOSSIBLE)
def test_the_topic_of_filled_trajectories_has_the_same_rules(fault):
    times, rows, reason = IMPOSSIBLE[fault]
    with pytest.raises(KaneError, match=reason):
        filled_message(served({'feedforward.clip': True}), trajectory(times, rows))


def test_a_trajectory_that_starts_later_may_start_elsewhere():
    times, rows, _ = IMPOSSIBLE['far from the arm']
    filled_message(served(), trajectory(times, rows, stamp=2_000_000_000))


def test_an_arm_outside_its_limits_may_move_back():
    outside = home_moved(0, 2.9)
    back = motion([0.0, 3.0], [outside, HOME])
    refuse_impossible(served(), back, outside)
    with pytest.raises(KaneError, match='position 2'):
        refuse_impossible(served(), back)


def test_parameters_change_or_switch_off_each_rule():
    for fault, changes in {'far from the arm': {'trajectory.start_tolerance': 0.6},
                           'too fast': {'trajectory.limit_factor': np.inf},
                           'too strong': {'trajectory.limit_factor': 10.0}}.items():
        times, rows, _ = IMPOSSIBLE[fault]
        refuse_impossible(served(changes), motion(times, rows), HOME)
    slow = motion([0.0, 1.0], [HOME, NEAR])
    refuse_impossible(served(), slow, HOME)
    for limit in ({'limits.velocity': 0.1}, {'limits.effort': 5.0}):
        with pytest.raises(KaneError, match=r'1\.2 times its limit'):
            refuse_impossible(served(limit), slow, HOME)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(-1.0, 1.0), min_size=28, max_size=28), st.floats(0.5, 1.15))
def test_a_motion_within_the_factor_is_accepted_and_one_beyond_it_refused(
        numbers, share):
    middle = 0.5 * (LIMITS.lower + LIMITS.upper)
    reach = 0.3 * (LIMITS.upper - LIMITS.lower)
    rows = middle + reach * np.array(numbers).reshape(4, 7)
    slow = motion([0.0, 10.0, 20.0, 30.0], rows)
    times = np.linspace(0.0, 30.0, 3001)
    speeds = np.abs(slow.sample(times)[1]) / LIMITS.velocity
    if speeds.max() < 1e-3 or (np.abs(slow.sample(times)[0] - middle) > 0.5 * (
            LIMITS.upper - LIMITS.lower)).any():
        return
    arm = served({'limits.effort': np.inf} | UNCHECKED)
    for factor in (share, 1.3):
        faster = slow.scaled(factor / speeds.max())
        q, u, udot = faster.sample(faster.times[-1] * np.linspace(0.0, 1.0, 3001))
        efforts = np.abs(ARM.inverse_dynamics(q, u, udot)) / LIMITS.effort
        if factor < 1.2 and efforts.max() < 1.15:
            refuse_impossible(arm, faster)
        elif factor > 1.2 or efforts.max() > 1.3:
            with pytest.raises(KaneError, match=r'1\.2 times its limit'):
                refuse_impossible(arm, faster)


@pytest.mark.parametrize('fault', ENDS)
def test_a_motion_sets_out_at_the_speed_of_the_arm_and_ends_at_rest(fault):
    first, last, reason = ENDS[fault]
    times, rows, speeds = with_speeds(first, last)
    jumps = Motion.from_points(times, rows, speeds, joint_names=ARM.joint_names)
    still = np.zeros(7)
    with pytest.raises(KaneError, match=reason):
        refuse_impossible(served(), jumps, HOME, 0.0, still)
    # The arm may move already, and what it does not execute may begin at any speed.
    moving = still.copy()
    moving[1] = first
    if last:
        message = trajectory(times, rows)
        for point, speed in zip(message.points, speeds):
            point.velocities = speed.tolist()
        with pytest.raises(KaneError, match=reason):
            filled_message(served(), message)
    else:
        refuse_impossible(served(), jumps, HOME, 0.0, moving)
        refuse_impossible(served(), jumps)
    # A motion with a first speed that waits for its first point jumps there.
    late = Motion.from_points([1.0, 2.0, 3.0], rows, with_speeds(0.5, 0.0)[2],
                              joint_names=ARM.joint_names)
    with pytest.raises(KaneError, match=r'at the first point \(1 s\); expected 0'):
        refuse_impossible(served(), late, HOME, 0.0, still)


def test_what_is_filled_to_be_executed_at_once_begins_at_the_speed_of_the_arm():
    times, rows, speeds = with_speeds(-0.5, 0.0)
    message = trajectory(times, rows)
    for point, velocity in zip(message.points, speeds):
        point.velocities = velocity.tolist()

    def fill(rates):
        return filled_message(served_robot(ARM, {}, lambda: HOME, lambda: rates),
                              message)
    with pytest.raises(KaneError, match=r'velocity -0\.5 .* out \(0 s\); expected 0,'):
        fill(np.zeros(7))
    fill(speeds[0])
    message.header.stamp.sec = 2_000_000_000  # the arm may have this speed by then
    fill(np.zeros(7))


@pytest.mark.parametrize(('mode', 'gains', 'joint'), [
    ('computed_torque', {'gains.kp': 2000.0}, 1),
    ('joint_impedance', {'joint_impedance.stiffness': 1500.0}, 3),
    ('inverse_dynamics', {'commands.form': 'mit', 'commands.stiffness': 1500.0}, 3)])
def test_the_effort_that_the_distance_from_the_arm_asks_for_is_a_part_of_the_check(
        mode, gains, joint):
    arm = served({'mode': mode, **gains})
    slow = motion([0.0, 5.0], [HOME, NEAR])
    limits = 1.2 * LIMITS.effort
    # Gravity makes the distances on both sides differ.
    refused = [0, 0]
    for offset in np.linspace(-0.099, 0.099, 45):
        place = home_moved(joint, -offset)
        u, udot = slow.sample(0.0)[1:]
        if mode == 'computed_torque':
            tau = ARM.inverse_dynamics(HOME, u, udot + 2000.0 * (HOME - place))
        else:
            tau = ARM.inverse_dynamics(HOME, u, udot) + 1500.0 * (HOME - place)
        if (np.abs(tau) <= limits).all():
            refuse_impossible(arm, slow, place)
            continue
        refused[int(offset > 0.0)] += 1
        with pytest.raises(KaneError, match='effort with the distance from the arm'):
            refuse_impossible(arm, slow, place)
    assert refused[0] != refused[1] and min(refused) > 0 and max(refused) < 22
    feedforward = gains | {'commands.form': 'effort'}
    refuse_impossible(served(feedforward), slow, place)


speeds_of_ends = st.sampled_from([0.0, 0.0, 1e-9, 0.02, -0.1, 0.4, 2.0])


@settings(max_examples=60, deadline=None)
@given(st.lists(speeds_of_ends, min_size=2, max_size=2),
       st.lists(st.floats(-0.5, 0.5), min_size=2, max_size=2), st.floats(0.0, 1.5),
       speeds_of_ends)
def test_the_desired_speed_of_accepted_motions_never_jumps(ends, inner, moment, moving):
    times, rows, speeds = with_speeds(*ends)
    speeds[1, :2] = inner
    arm = served({'trajectory.start_tolerance': 9.0})
    before = np.zeros(7)
    before[1] = moving
    drawn = Motion.from_points(times, rows, speeds, joint_names=ARM.joint_names)
    try:
        refuse_impossible(arm, drawn, HOME, moment, before)
    except KaneError:
        return
    # What the law sees: the speed before, then that of the motion, until it rests.
    at = np.arange(moment, 2.2, 1e-4)
    desired = np.vstack([before, drawn.sample(at)[1]])
    most = 1e-4 * np.abs(drawn.sample(at)[2]).max() + 0.0501 * LIMITS.velocity
    assert (np.abs(np.diff(desired, axis=0)) <= most).all()


def test_motions_of_closed_loops_are_judged_in_the_assembly_mode_of_the_arm():
    robot = palletizer()
    pose = (0.2, 0.3, -0.1, 0.5)
    q = positions(robot, *pose)
    arm = served(robot=robot, measured=q)
    refuse = partial(refuse_impossible, arm)
    refuse(motion([0.0, 2.0], [pose, (0.5, 0.1, 0.2, -0.5)], DRIVEN), np.array(pose))
    for rows, times, reason in (
            ([pose, (0.2, 40.0, -0.1, 0.5)], [0.0, 2.0],
             "'shoulder': position 40 at point 1"),
            ([(0.2, 0.8, -0.1, 0.5), pose], [0.0, 2.0],
             "'shoulder': the motion sets out at 0.8"),
            ([pose, (0.5, 0.1, 0.2, -0.5)], [0.0, 0.02], 'speed'),
            ([pose, (0.2, 0.35, -0.1, 0.5), pose], [0.0, 0.05, 0.1], 'effort')):
        with pytest.raises(KaneError, match=reason):
            refuse(motion(times, rows, DRIVEN), np.array(pose))
    with pytest.raises(KaneError,
                       match=r"joint 'elbow': position 1\.45 .* most 1\.3963$"):
        refuse(motion([0.0, 5.0], [pose, (0.2, -0.6, 0.85, 0.5)], DRIVEN))
    free = robot.copy()
    none = np.full(robot.n_q, np.inf)
    free.limits = JointLimits(-none, none, none, none)
    singular = motion([0.0, 9.0], [pose, (0.2, SINGULAR_SHOULDER - 0.2, -0.1, 0.5)],
                      DRIVEN)
    with pytest.raises(LoopError, match='near a singular configuration: after point 0'):
        refuse_impossible(served(robot=free, measured=q), singular)
