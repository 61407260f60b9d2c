"""CDR reading and writing agree with rclpy, and malformed messages are rejected."""

import math
import struct

from kane_dynamics.errors import InputError
from kane_dynamics.ros.common.cdr import (float64_multi_array, joint_command,
                                          joint_state_of_efforts, Reader)
import pytest
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

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


def test_the_doubles_of_a_prepared_message_are_aligned():
    for message in (float64_multi_array(3), joint_state_of_efforts(['abc'])):
        assert message.numbers.flags.aligned


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
