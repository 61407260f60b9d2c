"""CDR reading and writing agree with rclpy, and malformed messages are rejected."""

import math
import struct

from kane_dynamics.control.trajectory_feedforward import FilledTrajectory
from kane_dynamics.errors import InputError
from kane_dynamics.ros.common.cdr import (float64_multi_array, joint_command,
                                          joint_state_of_efforts, Reader)
from kane_dynamics.ros.common.conversion import motion_from_message
from kane_dynamics.ros.inputs.trajectory_input import (CdrTime, read_trajectory,
                                                       TrajectoryHeader)
from kane_dynamics.ros.services.trajectory_filling import serialized_trajectory
import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

VALUES = [0.1, -1e308, 5e-324, -0.0, math.pi, 1e22, 7.0]


@pytest.mark.parametrize('n', [1, 2, 3, 7])
def test_rclpy_reads_a_float64_multi_array(n):
    message = float64_multi_array(n)
    message.numbers[:] = VALUES[:n]
    assert list(
        deserialize_message(message.serialized(), Float64MultiArray).data) == VALUES[:n]
    message.numbers[:] = 1.0
    assert list(deserialize_message(message.serialized(), Float64MultiArray).data) == [
        1.0] * n


@pytest.mark.parametrize('names',
                         [['a'], ['ab', 'c'], ['abc', 'defg', 'h' * 31], ['é', '']])
def test_rclpy_reads_a_joint_state_of_efforts_and_its_stamp(names):
    message = joint_state_of_efforts(names)
    message.numbers[:] = VALUES[:len(names)]
    message.stamp(-3, 4_000_000_000)
    read = deserialize_message(message.serialized(), JointState)
    assert list(read.name) == names
    assert list(read.effort) == VALUES[:len(names)]
    assert (read.header.stamp.sec, read.header.stamp.nanosec) == (-3, 4_000_000_000)
    assert not read.position and not read.velocity


@pytest.mark.parametrize('names',
                         [['a'], ['ab', 'c'], ['abc', 'defg', 'h' * 31], ['é', '']])
def test_a_joint_command_has_the_fields_of_its_definition(names):
    """docs.ros.org/en/ros2_packages/rolling/api/control_msgs/msg/JointCommand.html."""
    message = joint_command(names, 'effort')
    message.numbers[:] = VALUES[:len(names)]
    message.stamp(7, 8)
    reader = Reader(message.serialized())
    assert (reader.pair(), reader.text()) == ((7, 8), '')
    assert (reader.texts(), reader.text()) == (names, 'effort')
    assert reader.doubles().tolist() == VALUES[:len(names)]
    assert reader.offset == len(message.serialized())


@pytest.mark.parametrize('frame', ['', 'abc', 'world', 'abcdefgh'])  # of every alignment
@pytest.mark.parametrize(('points', 'n'), [(1, 1), (3, 2), (100, 7)])
def test_rclpy_reads_a_filled_trajectory(frame, points, n):
    names = tuple('abcdefg'[:n])
    tables = np.random.default_rng(0).normal(size=(4, points, n))
    filled = FilledTrajectory(names, 0.25 + 0.7 * np.arange(points), *tables, 0, None)
    read = deserialize_message(serialized_trajectory(
        TrajectoryHeader(CdrTime(-3, 4_000_000_000), frame), filled), JointTrajectory)
    assert read.header.frame_id == frame
    assert (read.header.stamp.sec, read.header.stamp.nanosec) == (-3, 4_000_000_000)
    assert tuple(read.joint_names) == names
    for table, field in zip(tables,
                            ('positions', 'velocities', 'accelerations', 'effort'),
                            strict=True):
        assert [list(getattr(point, field)) for point in read.points] == table.tolist()
    assert [point.time_from_start.sec * 10**9 + point.time_from_start.nanosec
            for point in read.points] == [250_000_000 + 700_000_000 * k
                                          for k in range(points)]


def test_the_doubles_of_a_prepared_message_are_aligned():
    for message in (float64_multi_array(3), joint_state_of_efforts(['abc'])):
        assert message.numbers.flags.aligned


def trajectory(points=3, n=2):
    message = JointTrajectory(joint_names=['a', 'b'][:n])
    message.header.stamp.sec = 12
    message.header.frame_id = 'world'
    for k in range(points):
        message.points.append(JointTrajectoryPoint(
            positions=[0.1 * k + i for i in range(n)],
            velocities=[0.5 * k] * n if k % 2 else [], effort=[1.0] * (k % 3)))
        message.points[-1].time_from_start.sec = k
        message.points[-1].time_from_start.nanosec = 5
    return message


@pytest.mark.parametrize('points', [1, 2, 7])
def test_a_trajectory_is_read_as_rclpy_reads_it(points):
    message = trajectory(points)
    read = read_trajectory(serialize_message(message), 10)
    assert read.joint_names == list(message.joint_names)
    assert read.header.stamp == (12, 0)
    for mine, theirs in zip(read.points, message.points, strict=True):
        for field in ('positions', 'velocities', 'accelerations'):
            assert getattr(mine, field).tolist() == list(getattr(theirs, field))
        assert mine.time_from_start == (theirs.time_from_start.sec, 5)


def test_a_motion_is_the_same_when_rclpy_reads_the_message():
    message = trajectory(5)
    for k, point in enumerate(message.points):
        point.velocities = [0.1 * k, -0.2]
    mine = motion_from_message(read_trajectory(serialize_message(message), 10),
                               ('b', 'a'), 10)
    theirs = motion_from_message(message, ('b', 'a'), 10)
    for t in np.linspace(-1.0, 5.0, 60):
        for a, b in zip(mine.sample(t), theirs.sample(t), strict=True):
            assert (a == b).all()


def test_too_many_points_are_refused_before_reading_them():
    data = bytearray(serialize_message(trajectory(11)))
    with pytest.raises(InputError,
                       match=': 11 points; expected 1 to 10'):
        read_trajectory(bytes(data), 10)
    at = data.index(struct.pack('<I', 11))
    data[at:at + 4] = b'\xff\xff\xff\x7f'
    with pytest.raises(InputError, match='trajectory: 2147483647 points'):
        read_trajectory(bytes(data), 10)


@pytest.mark.parametrize(('words', 'body', 'call'), [
    ('encapsulation: 0003', b'\0\3\0\0', None),
    ('encapsulation: absent', b'', None),
    ('message: 7 bytes; expected at least 8 for 1 elements of 4 bytes',
     b'\0\1\0\0\1\2\3', Reader.word),
    ('4294967295 elements of 8 bytes', b'\0\1\0\0\xff\xff\xff\xff' + bytes(32),
     Reader.doubles),
    ('4294967295 elements of 1 bytes', b'\0\1\0\0\xff\xff\xff\xff' + bytes(32),
     Reader.text),
    ('at least 17179869188 for 4294967295 strings',
     b'\0\1\0\0\xff\xff\xff\xff' + bytes(32), Reader.texts),
    ('expected a single NUL, at its end', b'\0\1\0\0\2\0\0\0ab', Reader.text),
    ('expected a single NUL, at its end', b'\0\1\0\0\3\0\0\0a\0\0', Reader.text),
    ('expected a single NUL, at its end', bytes([0, 1, 0, 0, 0, 0, 0, 0]), Reader.text),
    ('expected UTF-8', b'\0\1\0\0\2\0\0\0\xff\0', Reader.text),
])
def test_malformed_messages_are_refused_with_the_fault(words, body, call):
    with pytest.raises(InputError, match=words):
        call(Reader(body))


def test_both_byte_orders_are_read():
    for order, kind in (('<', 1), ('>', 0)):
        body = struct.pack(order + 'iII4xd', -2, 3, 1, 0.25)
        reader = Reader(bytes([0, kind, 0, 0]) + body)
        assert reader.pair() == (-2, 3)
        assert reader.doubles().tolist() == [0.25]
