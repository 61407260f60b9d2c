"""Filled trajectories over DDS, and a loop like joint_trajectory_controller's."""

import ast
import importlib.util
import json
import math
from pathlib import Path
import re
import signal
import time

from control_messages import control_messages
from kane_dynamics import Robot
from kane_dynamics.control.trajectory_feedforward import fill_trajectory
from node_process import (active_until_end, DEEP, JOINTS, model, NAME, Process, URDF,
                          wait_until)
import numpy as np
import pytest
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

HELPERS = Path(__file__).resolve().parents[1] / 'helpers'
START = np.array([0.3, -0.4, 0.2])
TIMES = np.array([0.0, 0.4, 0.8, 1.2, 1.6])
POINTS = START + np.array(
    [[0.0, 0.0, 0.0], [0.4, 0.3, 0.1], [0.0, 0.6, 0.2], [-0.3, 0.4, 0.1],
     [0.0, 0.1, 0.0]])
FIELDS = ('positions', 'velocities', 'accelerations', 'effort')


@pytest.fixture(scope='module')
def robot():
    return Robot(model())


@pytest.fixture(scope='module')
def module_node():
    yield from active_until_end(Process(
        '-r', '~/trajectory_with_effort:=/jtc/joint_trajectory',
        robot_description=f"'{URDF}'", diagnostics_rate=20, state_timeout=30.0))


class Filler:
    """A client of the topics of trajectories."""

    def __init__(self, client):
        self.client = client
        self.filled = []
        self.publisher = client.create_publisher(JointTrajectory, f'{NAME}/trajectory',
                                                 1)
        self.direct = client.create_publisher(JointTrajectory, '/jtc/joint_trajectory',
                                              1)
        self._subscription = client.create_subscription(
            JointTrajectory, '/jtc/joint_trajectory', self.filled.append, DEEP)
        assert wait_until(lambda: self.publisher.get_subscription_count()
                          and self._subscription.get_publisher_count() >= 2)

    def close(self):
        self.client.destroy_subscription(self._subscription)
        for publisher in (self.publisher, self.direct):
            self.client.destroy_publisher(publisher)

    def ask(self, message):
        """Publish a trajectory; return the filled one as arrays of its fields."""
        self.filled.clear()
        self.publisher.publish(message)
        assert wait_until(lambda: self.filled), 'no filled trajectory'
        return [np.array([getattr(point, name) for point in self.filled[0].points])
                for name in FIELDS]


@pytest.fixture
def filler(module_node, client):
    filler = Filler(client)
    yield filler
    filler.close()


def trajectory(times=TIMES, points=POINTS, names=JOINTS):
    message = JointTrajectory(joint_names=list(names))
    message.header.frame_id = 'world'
    for t, positions in zip(times, points, strict=True):
        point = JointTrajectoryPoint(positions=np.asarray(positions).tolist())
        point.time_from_start.sec, point.time_from_start.nanosec = divmod(
            round(t * 1e9), 10**9)
        message.points.append(point)
    return message


def test_the_topic_fills_in_what_the_library_does(filler, robot):
    order = [2, 0, 1]
    names = [JOINTS[k] for k in order]
    expected = fill_trajectory(robot, TIMES, POINTS[:, order], joint_names=names)
    arrays = [expected.positions, expected.velocities, expected.accelerations,
              expected.efforts]
    for got, array in zip(filler.ask(trajectory(points=POINTS[:, order], names=names)),
                          arrays, strict=True):
        np.testing.assert_allclose(got, array, rtol=0, atol=1e-12)
    filled = filler.filled[0]
    assert list(filled.joint_names) == names
    assert filled.header.frame_id == 'world'
    assert [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec
            for p in filled.points] == pytest.approx(TIMES.tolist(), abs=1e-12)


def test_joints_that_a_trajectory_lacks_rest_where_they_are_and_it_begins_there(
        filler, robot):
    pose = np.array([0.2, 0.4, -0.1])
    assert filler.client.ask(pose, np.zeros(3)) is not None
    q, u, _, effort = filler.ask(trajectory([1.0], [[0.5]], ['lift']))
    np.testing.assert_allclose(q.ravel(), [0.4, 0.5], atol=1e-12)
    assert not u.any()
    held = robot.gravity_force(np.array([[0.2, 0.4, -0.1], [0.2, 0.5, -0.1]]))[:, 1:2]
    np.testing.assert_allclose(effort, held, atol=1e-12)


def rejected(filler, node, message, reason):
    """Publish a trajectory; wait until log and diagnostics contain the reason."""
    count_before = len(node.log)
    filler.filled.clear()
    filler.client.diagnostics.clear()
    filler.publisher.publish(message)
    assert wait_until(lambda: re.search(f'trajectory rejected: {reason}',
                                        node.log[count_before:])), (
                                            node.log[count_before:])
    assert wait_until(lambda: any('rejected: trajectory' in values
                                  for _, _, values in filler.client.diagnostics))
    assert not filler.filled


@pytest.mark.parametrize(('message', 'reason'), [
    (trajectory(names=('turn', 'lift', 'gripper')), ".*'gripper' is not a joint"),
    (trajectory(points=8.0 * POINTS),
     "joint 'turn': position 5.6 at point 1 .* at most 3"),
    (trajectory(0.3 * TIMES),
     "joint 'turn': velocity 5.49.* after point 0 .* at most 5")])
def test_a_trajectory_that_cannot_be_filled_is_rejected(filler, module_node, message,
                                                        reason):
    rejected(filler, module_node, message, reason)


def test_efforts_beyond_the_limits_are_rejected_or_clamped(filler, module_node):
    client = filler.client
    free = filler.ask(trajectory())[3]
    assert client.adjust(limits__effort=5.0).successful
    try:
        rejected(filler, module_node, trajectory(),
                 "joint 'lift': effort -?10.* at most 6, 1.2")
        assert client.adjust(trajectory__limit_factor=math.inf).successful
        rejected(filler, module_node, trajectory(),
                 "joint 'lift': effort -?10.* at point")
        assert client.adjust(feedforward__clip=True).successful
        np.testing.assert_allclose(filler.ask(trajectory())[3], np.clip(free, -5.0, 5.0))
        assert not client.adjust(feedforward__tolerance=[1.0, 2.0]).successful
    finally:
        assert client.adjust(limits__effort=math.inf, feedforward__clip=False,
                             trajectory__limit_factor=1.2).successful


@pytest.fixture
def errors(filler):
    """Return a function: the loop's RMS errors for a published trajectory."""
    plant = Process(module='kane_dynamics.ros.plant.main', robot_description=f"'{URDF}'",
                    rate=200, publish_clock='true', rate_factor=0.5,
                    initial__position=START.tolist())
    loop = Process(program=[str(HELPERS / 'effort_controller.py'), ','.join(JOINTS),
                            '100', '10', '0.2'])

    def errors(publisher):
        assert filler.client.call(Trigger, '/plant_node/reset').success
        count_before = len(loop.log)
        publisher.publish(trajectory())
        assert wait_until(lambda: ']' in loop.log[count_before:], 60.0), loop.log
        return np.array(json.loads(loop.log[count_before:]))
    try:
        plant.wait_for('200 joint states/s', 120.0)
        loop.wait_for('ready')
        assert wait_until(lambda: filler.direct.get_subscription_count() >= 2)
        time.sleep(1.0)  # until loop and plant have found each other
        yield errors
    finally:
        loop.end(signal.SIGTERM)
        plant.end()


def test_a_loop_like_the_controller_tracks_20_times_better_with_filled_efforts(
        filler, errors):
    assert filler.client.adjust(feedforward__tolerance=0.02).successful
    alone, helped = errors(filler.direct), errors(filler.publisher)
    print(f'RMS errors {alone} and {helped}: '
          f'{np.linalg.norm(alone) / np.linalg.norm(helped):.0f}')
    assert np.linalg.norm(alone) > 20.0 * np.linalg.norm(helped), (alone, helped)


def test_stamped_commands_without_their_message_are_an_error_at_configure(start):
    if importlib.util.find_spec('control_msgs') is not None:
        pytest.skip('control_msgs is installed')
    node = start(stamped_commands='true')
    node.wait_for("not configured: parameter 'stamped_commands': true without "
                  'control_msgs/JointCommand', 120.0)
    assert ("(No module named 'control_msgs'); expected false, or an installed"
            in node.log)


@pytest.mark.slow  # builds the message, which takes a minute of processor time
@pytest.mark.timeout(1200)
def test_stamped_commands_are_the_commands_with_names_and_stamp(monkeypatch, client):
    for name, value in control_messages().items():
        monkeypatch.setenv(name, value)
    node = Process(robot_description=f"'{URDF}'", stamped_commands='true')
    received = []
    code = (
        'import rclpy, sys\nfrom control_msgs.msg import JointCommand\nrclpy.init()\n'
        "node = rclpy.create_node('listener')\n"
        "node.create_subscription(JointCommand, 'stamped_commands', lambda m: print(\n"
        '    m.header.stamp.sec * 10**9 + m.header.stamp.nanosec, list(m.joint_names),\n'
        "    m.interface_name, list(m.values), sep='|', flush=True), 10)\n"
        "print('ready', flush=True)\nrclpy.spin(node)\n")
    listener = Process(program=['-c', code])
    try:
        node.wait_for('active, mode', 120.0)
        listener.wait_for('ready')
        q = np.array([0.1, 0.2, 0.05])
        assert wait_until(lambda: (client.ask(q, np.zeros(3)) is not None
                                   and '|' in listener.log),
                          60.0), listener.log + node.log
        for line in listener.log.splitlines()[1:]:
            stamp, names, interface, values = line.split('|')
            received.append(int(stamp))
            assert (names, interface) == (str(list(JOINTS)), 'effort')
            assert ast.literal_eval(values) in client.commands
        assert set(received) <= set(client.torques)
    finally:
        listener.end(signal.SIGTERM)
        node.end()
