"""The torque path without a ROS graph: clock, stamps, timeouts, motions."""

from functools import partial
import math
import time
from unittest.mock import Mock

import numpy as np
import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import WrenchStamped  # noqa: E402, I100
from kane_dynamics import Controller, load_urdf, Motion, Robot  # noqa: E402
from kane_dynamics._util.resources import resource_path  # noqa: E402
from kane_dynamics.control_cycle.arbitration import begun, UNGUARDED  # noqa: E402
from kane_dynamics.errors import InputError  # noqa: E402
from kane_dynamics.ros.common.configuration_files import load_model  # noqa: E402
from kane_dynamics.ros.common.conversion import motion_from_message  # noqa: E402
from kane_dynamics.ros.common.node_statistics import Statistics  # noqa: E402
from kane_dynamics.ros.common.stamped_numbers import FUTURE, OUT_OF_ORDER  # noqa: E402
from kane_dynamics.ros.inputs import trajectory_input  # noqa: E402
from kane_dynamics.ros.inputs.trajectory_input import follow_trajectory  # noqa: E402
from kane_dynamics.ros.loads.gravity_payload import GravityAndPayload  # noqa: E402
from kane_dynamics.ros.loads.wrench_input import WrenchInput  # noqa: E402
from kane_dynamics.ros.services.motion_check import refuse_impossible  # noqa: E402
from kane_dynamics.ros.torque_path.drop_reasons import (  # noqa: E402
    MISSING, NO_CLOCK, STALE)
from kane_dynamics.ros.torque_path.path_controller import path_controller  # noqa: E402
from kane_dynamics.ros.torque_path.torque_path import TorquePath  # noqa: E402
from native_rig import python_path  # noqa: E402
from node_values import node_values, served_robot, UNCHECKED  # noqa: E402
from rclpy.serialization import deserialize_message, serialize_message  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from std_msgs.msg import Float64MultiArray  # noqa: E402
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint  # noqa: E402

URDF = resource_path('urdf', 'two_link.urdf')
ROBOT = Robot(load_urdf(URDF))
MOTION = Motion.from_points([0.0, 2.0], [[0.0, 0.0], [1.0, -1.0]],
                            joint_names=ROBOT.joint_names)
NANO = 10**9


class Publisher:
    """Keeps the published messages."""

    def __init__(self, kind, field):
        self.sent = []
        self.kind = kind
        self.field = field

    def publish(self, message):
        self.sent.append(
            np.array(getattr(deserialize_message(message, self.kind), self.field)))


class Rig:
    """A torque path with a manual clock."""

    make = TorquePath

    def __init__(self, robot=ROBOT, **settings):
        self.time = 100 * NANO
        self.commands = Publisher(Float64MultiArray, 'data')
        self.torques = Publisher(JointState, 'effort')
        self.warnings = []
        self.statistics = Statistics()
        self.path = self.make(
            Controller(robot, **settings), self.commands, self.torques,
            lambda: self.time, node_values(UNCHECKED), self.statistics,
            lambda reason, detail: self.warnings.append(reason))
        self.path.start()

    def state(self, q=(0.3, -0.2), u=(0.0, 0.0), *, after=0.0, age=0.0):
        """Advance the clock, pass an aged state to the path, return its command."""
        self.time += round(after * NANO)
        message = JointState(name=list(ROBOT.joint_names), position=list(q),
                             velocity=list(u))
        stamp = message.header.stamp
        stamp.sec, stamp.nanosec = divmod(self.time - round(age * NANO), NANO)
        count_before = len(self.commands.sent)
        self.path.on_state(serialize_message(message))
        return self.commands.sent[-1] if len(self.commands.sent) > count_before else None

    def follow(self, start, motion=MOTION):
        """Schedule a motion at a time, ns."""
        active = self.path.active_motion
        assert active.follow(motion, start, self.time, active.generation)


@pytest.fixture(autouse=True, params=[TorquePath, python_path],
                ids=['compiled law', 'law in Python'])
def of_each_kind(request, monkeypatch):
    """Run each case with compiled laws, and with laws that Python evaluates."""
    monkeypatch.setattr(Rig, 'make', staticmethod(request.param))


def gravity(q=(0.3, -0.2)):
    return ROBOT.gravity_force(np.array(q))


def test_without_a_motion_the_command_is_gravity():
    rig = Rig()
    np.testing.assert_array_equal(rig.state(), gravity())
    np.testing.assert_array_equal(rig.torques.sent[-1], gravity())


def test_the_motion_is_sampled_at_the_stamp_of_the_state():
    rig = Rig()
    rig.follow(rig.time)
    expected = ROBOT.inverse_dynamics(*MOTION.sample(0.73))
    np.testing.assert_allclose(rig.state(after=0.75, age=0.02), expected, rtol=1e-12)


def test_a_state_from_the_future_gets_the_torque_and_the_observation_of_the_clock():
    rig = Rig()
    observer = Mock()
    rig.path.add_observer(observer, need_effort=False)
    rig.follow(rig.time)
    command = rig.state(after=0.75, age=-0.05)
    np.testing.assert_allclose(command, ROBOT.inverse_dynamics(*MOTION.sample(0.75)),
                               rtol=1e-12)
    assert observer.on_cycle.call_args[0][0].stamp == rig.time
    assert rig.path.state_age == 0.0


@pytest.mark.parametrize('prefix', ['', 'left_'])
def test_commands_of_a_floating_base_are_of_the_joints_alone(prefix):
    """Their gravity is that of a fixed base, turned instead of the base."""
    values = node_values({**UNCHECKED, 'root_joint': 'floating', 'prefix': prefix,
                          'mode': 'gravity_compensation', 'limits.rate': math.inf})
    model = load_model(URDF, values, lambda warning: None)
    commands = Publisher(Float64MultiArray, 'data')
    torques = Publisher(JointState, 'effort')
    path = TorquePath(path_controller(model, values), commands, torques,
                      lambda: 100 * NANO, values, Statistics(), lambda *words: None)
    path.start()
    assert path.messages.joints == tuple(prefix + name for name in ROBOT.joint_names)
    base = [0.3, -2.0, 1.0, 0.4, -0.7, 0.2]
    message = JointState(name=list(model.joint_names), position=[*base, 0.3, -0.2],
                         velocity=[0.0] * 8)
    message.header.stamp.sec = 100
    path.on_state(serialize_message(message))
    floating = Robot(model)
    turn = floating.frame_pose(prefix + 'base_link', message.position)[:3, :3]
    turned = Robot(load_urdf(URDF, gravity=turn.T @ model.gravity))
    np.testing.assert_allclose(commands.sent,
                               [turned.gravity_force(np.array([0.3, -0.2]))], rtol=1e-12)
    np.testing.assert_array_equal(torques.sent, commands.sent)


def test_a_backward_clock_jump_drops_the_motion_and_commands_continue():
    rig = Rig()
    rig.follow(rig.time)
    rig.state(after=0.5)
    np.testing.assert_array_equal(rig.state(after=-50.0), gravity())
    assert 'clock' in rig.warnings
    np.testing.assert_array_equal(rig.state(after=0.01), gravity())


def test_a_backward_clock_jump_between_two_states_drops_the_motion():
    rig = Rig()
    rig.state()
    rig.time += 2 * NANO
    rig.follow(rig.time - NANO)
    rig.time -= NANO  # still after the last state
    rig.path.on_clock_jump()
    np.testing.assert_array_equal(rig.state(), gravity())


class Guard:
    """torque_guard as the path asks it; `numbers` answer the last request."""

    def __init__(self):
        self.requests = Publisher(Float64MultiArray, 'data')
        self.returns = []

    def beginning(self):
        now = time.perf_counter() * NANO
        return begun(UNGUARDED._replace(seen=now), 0.1 * NANO, now, 7.0)

    def numbers(self, commands, tau):
        return np.array([self.requests.sent[-1][0], commands, commands, 1.0, *tau])

    def report_return(self, silent, dropped):
        self.returns.append(dropped)


def test_a_clock_that_jumped_while_the_guard_commanded_is_reported(monkeypatch):
    rig = Rig()
    guard = Guard()
    rig.state()  # compiles the law, which takes longer than the guard waits
    rig.commands.sent.clear()
    rig.path.use_guard(guard)
    rig.path.start()
    assert rig.state() is None, 'it waits for the answer'
    rig.path.hear(guard.numbers(0.0, gravity()))
    np.testing.assert_array_equal(rig.commands.sent, [gravity()])
    for _ in range(3):  # the guard takes over after two periods of the states
        np.testing.assert_array_equal(rig.state(after=0.002), gravity())
    rig.follow(rig.time)
    later = time.perf_counter() + 1.0
    monkeypatch.setattr(time, 'perf_counter', lambda: later)
    assert rig.state(after=0.05) is None
    rig.time -= 20 * NANO
    rig.path.hear(guard.numbers(1.0, gravity()))
    assert guard.returns == [True], 'the motion was dropped'
    assert rig.warnings == ['clock']
    np.testing.assert_array_equal(rig.state(after=0.01), gravity())


def test_a_paused_clock_neither_times_out_nor_stops_the_commands():
    rig = Rig()
    for _ in range(3):
        np.testing.assert_array_equal(rig.state(), gravity())
        rig.path.check_timeout()
    assert not rig.path.timed_out


@pytest.mark.parametrize(('age', 'reason'), [(0.2, STALE), (-0.2, FUTURE)])
def test_a_stale_or_future_state_gives_no_command(age, reason):
    rig = Rig()
    assert rig.state(age=age) is None
    assert rig.statistics.dropped[reason] == 1


def test_states_out_of_order_give_no_command():
    rig = Rig()
    assert rig.state(after=0.05) is not None
    assert rig.state(age=0.03) is None
    assert rig.statistics.dropped[OUT_OF_ORDER] == 1


def test_loads_are_applied_between_two_cycles():
    rig = Rig()
    gravity_before = ROBOT.parameters.gravity
    try:
        rig.state()
        rig.path.set_loads(GravityAndPayload(np.array([1.0, 0.0, -3.0])))
        assert (ROBOT.parameters.gravity
                == gravity_before).all(), 'not before the next cycle'
        command = rig.state(after=0.01)
        assert ROBOT.parameters.gravity.tolist() == [1.0, 0.0, -3.0]
        np.testing.assert_array_equal(command, gravity())
    finally:
        ROBOT.parameters.gravity = gravity_before


def test_a_timeout_commands_zeros_once_and_the_next_state_ends_it():
    rig = Rig()
    rig.state()
    for _ in range(3):
        rig.time += round(0.2 * NANO)
        rig.path.check_timeout()
    assert [command.any() for command in rig.commands.sent] == [True, False]
    assert rig.path.timed_out
    assert rig.statistics.timeouts == 1
    np.testing.assert_array_equal(rig.state(), gravity())
    assert not rig.path.timed_out


def test_there_is_no_command_before_the_first_state():
    rig = Rig()
    rig.time += NANO
    rig.path.check_timeout()
    assert not rig.commands.sent


def test_the_rate_limit_uses_the_time_between_stamps_and_zeros_bypass_it():
    rig = Rig(rate_limit=2.0)
    assert not rig.state().any()
    second = rig.state(after=0.05)
    np.testing.assert_allclose(np.abs(second), np.minimum(np.abs(gravity()), 0.1),
                               rtol=1e-9)
    rig.path.stop()
    assert not rig.commands.sent[-1].any()


def test_stopping_commands_zeros_and_ends_the_commands():
    rig = Rig()
    rig.state()
    rig.path.stop()
    assert not rig.commands.sent[-1].any()
    assert rig.state(after=0.01) is None


@pytest.mark.parametrize('bad', [math.inf, 1e308])
def test_non_finite_or_overflowing_states_give_no_command(bad):
    rig = Rig(mode='computed_torque')
    assert rig.state(u=(bad, 0.0)) is None
    assert rig.statistics.dropped.total() == 1


def test_a_speed_that_is_nan_counts_as_absent_and_a_position_that_is_drops_the_state():
    rig = Rig(mode='computed_torque')
    assert np.isfinite(rig.state(u=(math.nan, 0.0))).all()
    rig.state(q=(math.nan, 0.0), after=0.01)
    assert rig.statistics.dropped.total() == 1


def trajectory(*points, stamp=0, names=ROBOT.joint_names):
    """Return a serialized JointTrajectory of (time, positions)."""
    message = JointTrajectory(joint_names=list(names))
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, NANO)
    for t, q in points:
        point = JointTrajectoryPoint(positions=list(q))
        point.time_from_start.sec, point.time_from_start.nanosec = divmod(
            round(t * NANO), NANO)
        message.points.append(point)
    return serialize_message(message)


VALUES = node_values(UNCHECKED)
JUDGE = partial(refuse_impossible, served_robot(ROBOT, UNCHECKED))
POINTS = (0.0, (0.3, -0.2)), (2.0, (1.0, -1.0))


def test_a_timeout_drops_the_motion_and_rejects_others_until_the_next_state():
    rig = Rig(mode='computed_torque')
    rig.state()
    follow_trajectory(rig.path, trajectory(*POINTS), 0, VALUES, JUDGE)
    rig.state(after=0.05)
    rig.time += NANO
    rig.path.check_timeout()
    assert (rig.commands.sent[-1] == 0.0).all()
    with pytest.raises(InputError,
                       match=r'joint states: none for 1\.0\d* s; expected one within'):
        follow_trajectory(rig.path, trajectory(*POINTS), 0, VALUES, JUDGE)
    # The law holds the pose.
    np.testing.assert_allclose(rig.state(after=0.01), gravity(), rtol=1e-12)
    follow_trajectory(rig.path, trajectory(*POINTS), 0, VALUES, JUDGE)
    assert np.abs(rig.state(after=0.05) - gravity()).max() > 1e-3


@pytest.mark.parametrize('looks_first', [False, True])
def test_a_path_that_was_stopped_drops_its_motion_and_goes_on_without_zeros(
        looks_first, monkeypatch):
    rig = Rig(mode='computed_torque', kp=100.0, kd=20.0)
    monkeypatch.setattr(time, 'perf_counter', lambda: rig.time / NANO)
    pose = np.array([0.3, -0.2])

    def run(q, cycles=20):
        for _ in range(cycles):
            rig.state(q, after=0.002)
            rig.path.check_timeout()
    run(pose)
    rig.follow(rig.time, Motion.from_points([0.0, 4.0], [pose, pose + 1.0],
                                            joint_names=ROBOT.joint_names))
    run(pose)
    acting = rig.commands.sent[-1]
    # The process stops; its messages wait.
    rig.time += NANO
    sent = len(rig.commands.sent)
    if looks_first:
        rig.path.check_timeout()
    # A stale state, then one of now, which is held.
    assert rig.state(pose + 0.1, age=0.5) is None
    np.testing.assert_allclose(rig.state(pose + 0.2), gravity(pose + 0.2), rtol=1e-12)
    assert rig.path.active_motion.scheduled == (None, None)
    assert 'no joint state' in rig.warnings
    run(pose + 0.2)
    assert np.all(np.any(rig.commands.sent[sent:], axis=1))
    assert acting.any()
    # A slow simulated clock is no stop: looks are as far apart as it says.
    real = [1e9]
    with monkeypatch.context() as slow:
        slow.setattr(time, 'perf_counter', lambda: real[0])
        rig.path.check_timeout()
        for _ in range(8):
            real[0] += 0.4
            rig.time += NANO // 50
            rig.path.check_timeout()
        assert not rig.commands.sent[-1].any()
    run(pose + 0.2)
    # Where no state comes after another stop, the time-out begins again, and only once.
    began = rig.time
    sent = len(rig.commands.sent)
    for pause in (1.0, 1e-4, 0.08, 0.08):
        assert len(rig.commands.sent) == sent, (rig.time - began) / NANO
        rig.time += round(pause * NANO)
        rig.path.check_timeout()
    assert len(rig.commands.sent) == sent + 1
    assert not rig.commands.sent[-1].any()


def test_a_motion_received_or_read_before_the_motions_were_cleared_is_rejected(
        monkeypatch):
    rig = Rig()
    rig.state()
    with pytest.raises(InputError, match='received before the node was activated'):
        follow_trajectory(rig.path, trajectory(*POINTS),
                          rig.path.active_motion.cleared_at - 1, VALUES, JUDGE)

    def read(*arguments):  # the node is deactivated and activated during the call
        rig.path.stop()
        rig.path.start()
        return motion_from_message(*arguments)
    monkeypatch.setattr(trajectory_input, 'motion_from_message', read)
    with pytest.raises(InputError, match='received while the node was stopped'):
        follow_trajectory(rig.path, trajectory(*POINTS), 0, VALUES, JUDGE)
    np.testing.assert_array_equal(rig.state(after=0.01), gravity())


def slow(judge, rig, seconds):
    """Return a check of motions that takes some time at first, as to compile."""
    pauses = [seconds]

    def judge_slowly(*arguments):
        judge(*arguments)
        if pauses:
            rig.time += round(pauses.pop() * NANO)
    return judge_slowly


def test_a_motion_whose_check_takes_long_begins_at_its_end():
    rig = Rig(mode='computed_torque')
    rig.state()
    warning = follow_trajectory(rig.path, trajectory(*POINTS), 0, VALUES,
                                slow(JUDGE, rig, 1.0))
    assert warning == ''
    assert rig.path.active_motion.at(rig.time)[1] == 0.0


def test_a_motion_that_began_during_a_long_check_is_compared_where_it_is_by_then():
    """It passed at its start; the arm jumped to where it was after the check."""
    checked = {**UNCHECKED, 'trajectory.start_tolerance': 0.1}
    judge = partial(refuse_impossible, served_robot(ROBOT, checked))
    rig = Rig(mode='computed_torque')
    rig.state()
    message = trajectory(*POINTS, stamp=rig.time + NANO // 2)
    with pytest.raises(InputError,
                       match=r'the motion sets out at -0\.6, the arm is at -0\.2'):
        follow_trajectory(rig.path, message, 0, node_values(checked),
                          slow(judge, rig, 1.5))
    message = trajectory(*POINTS, stamp=rig.time + NANO // 2)
    with pytest.raises(InputError, match=r'end of the motion: 0\.500 s ago'):
        follow_trajectory(rig.path, message, 0, node_values(checked),
                          slow(judge, rig, 3.0))


def test_a_scheduled_motion_starts_from_the_active_one_which_continues_until_then():
    rig = Rig()
    rig.state()
    follow_trajectory(rig.path, trajectory(*POINTS), 0, VALUES, JUDGE)
    first = rig.path.active_motion.at(rig.time)[0]
    begun = rig.time
    follow_trajectory(rig.path, trajectory((1.0, (0.0, 0.0)), stamp=rig.time + NANO), 0,
                      VALUES, JUDGE)
    np.testing.assert_array_equal(rig.state(after=0.9),
                                  ROBOT.inverse_dynamics(*first.sample(0.9)))
    q, u, _ = first.sample(1.0)
    second, moment = rig.path.active_motion.at(begun + NANO)
    assert second is not first and moment == 0.0
    np.testing.assert_allclose(second.sample(0.0)[:2], [q, u], rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(rig.state(after=0.3),
                                  ROBOT.inverse_dynamics(*second.sample(0.2)))


@pytest.mark.parametrize(('ahead', 'words'), [
    (0, ''), (NANO // 4, ''), (-NANO // 4, ''), (3600 * NANO, 'begins in 3600.0 s'),
    (-NANO, 'began 1.0 s ago, by its stamp')])
def test_a_motion_says_when_it_begins_if_that_is_not_now(ahead, words):
    rig = Rig()
    rig.state()
    rest = (0.3, -0.2)
    message = trajectory((0.0, rest), (2.0, rest), stamp=rig.time + ahead)
    assert follow_trajectory(rig.path, message, 0, VALUES, JUDGE).startswith(words)
    assert bool(follow_trajectory(rig.path, message, 0, VALUES, JUDGE)) == bool(words)


def test_a_motion_with_a_later_first_point_starts_from_the_held_pose():
    rig = Rig(mode='computed_torque')
    rig.state()
    rig.state(q=(0.31, -0.2), after=0.01)
    follow_trajectory(rig.path, trajectory((2.0, (1.0, -1.0))), 0, VALUES, JUDGE)
    motion, _ = rig.path.active_motion.at(rig.time)
    np.testing.assert_allclose(motion.sample(0.0)[0], (0.3, -0.2), rtol=1e-12)
    assert motion.duration == 2.0


def test_a_trajectory_without_points_ends_the_motion_at_the_measured_pose():
    rig = Rig(mode='computed_torque')
    rig.state()
    follow_trajectory(rig.path, trajectory(*POINTS), 0, VALUES, JUDGE)
    rig.state(after=0.05)
    assert 'no points' in follow_trajectory(rig.path, trajectory(names=()), 0, VALUES,
                                            JUDGE)
    np.testing.assert_allclose(rig.state(q=(0.5, 0.1), after=0.05), gravity((0.5, 0.1)),
                               rtol=1e-12)


def test_gravity_compensation_rejects_motions():
    rig = Rig(mode='gravity_compensation')
    rig.state()
    with pytest.raises(InputError,
                       match='gravity_compensation; expected a mode that follows'):
        follow_trajectory(rig.path, trajectory(*POINTS), 0, VALUES, JUDGE)


def test_the_timeout_refers_to_the_stamp_of_the_state():
    rig = Rig()
    rig.state(age=0.09)
    rig.time += round(0.02 * NANO)
    rig.path.check_timeout()
    assert rig.path.timed_out and (rig.commands.sent[-1] == 0.0).all()


def test_without_simulated_time_states_are_dropped():
    rig = Rig()
    rig.time = 0
    rig.path.start()
    assert rig.state() is None
    assert rig.statistics.dropped[NO_CLOCK] == 1


def test_states_of_other_joints_only_are_not_dropped_states():
    rig = Rig()
    for name in ('left_finger', 'right_finger'):
        rig.path.on_state(serialize_message(JointState(name=[name], position=[0.0])))
    assert (rig.statistics.dropped.total(), rig.statistics.foreign_states) == (0, 2)
    assert rig.path.take_foreign_joints() == {('left_finger',), ('right_finger',)}
    assert rig.path.take_foreign_joints() == set()
    rig.time += NANO
    rig.path.check_timeout()  # without other states the names are a fault
    rig.path.on_state(
        serialize_message(JointState(name=['left_joint1'], position=[0.0])))
    assert rig.statistics.dropped == {MISSING: 1}
    assert rig.warnings[-1] == MISSING


def test_a_wrench_does_not_outlive_deactivation():
    robot = Robot(load_urdf(URDF), wrench_frames=('tip',))
    rig = Rig(robot=robot)
    limits = {'wrench.timeout': 60.0, 'wrench.max_force': 100.0,
              'wrench.max_moment': 10.0, 'wrench.rise_time': 0.0}
    rig.path.wrenches = WrenchInput(robot, lambda: rig.time, limits, print)
    push = WrenchStamped()
    push.header.frame_id = 'tip'
    push.wrench.force.x = 50.0
    rig.path.wrenches.changed = rig.path.law_changed
    rig.path.wrenches.on_message(serialize_message(push))
    assert np.abs(rig.state() - gravity()).max() > 1.0
    rig.path.stop()
    rig.path.start()
    np.testing.assert_array_equal(rig.state(after=0.01), gravity())
