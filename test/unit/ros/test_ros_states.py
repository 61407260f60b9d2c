"""The joint state reader: layouts agree with rclpy, invalid states dropped."""

from array import array
import math
import struct
from types import SimpleNamespace

from kane_dynamics import load_urdf, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.ros.common.configuration_files import locked_joints
from kane_dynamics.ros.common.stamped_numbers import MALFORMED, NOT_FINITE, with_stamp
from kane_dynamics.ros.torque_path.drop_reasons import (
    ELSEWHERE, MISSING, NO_VELOCITY, SHORT, TWICE)
from kane_dynamics.ros.torque_path.joint_state_reader import (JointStateReader,
                                                              MAX_LAYOUTS)
from kane_dynamics.ros.torque_path.torque_path import TorquePath
import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

JOINTS = ('a', 'b', 'c')


def state(names, positions, velocities=()):
    return JointState(name=list(names), position=array('d', positions),
                      velocity=array('d', velocities))


def wire(*arguments):
    return serialize_message(state(*arguments))


def test_only_a_message_without_a_stamp_gets_the_time_of_its_reception():
    message = state('abc', [1, 2, 3], [4, 5, 6])
    received = 1_700_000_000_123_456_789
    data = serialize_message(message)
    reader = JointStateReader(JOINTS)
    assert reader.read(with_stamp(data, received), True) is None
    assert reader.stamp == received
    assert (reader.q.tolist(), reader.u.tolist()) == ([1, 2, 3], [4, 5, 6])
    big_endian = data[:1] + b'\x00' + data[2:]
    for unchanged, time in ((data, 0), (big_endian, received), (data[:8], received)):
        assert with_stamp(unchanged, time) == unchanged
    message.header.stamp.nanosec = 1
    data = serialize_message(message)
    assert with_stamp(data, received) == data


def test_a_state_is_read_by_name_into_the_same_arrays():
    reader = JointStateReader(JOINTS)
    q = reader.q
    u = reader.u
    assert reader.read(wire('cxab', [3, 9, 1, 2], [30, 90, 10, 20]), True) is None
    assert (q.tolist(), u.tolist()) == ([1, 2, 3], [10, 20, 30])
    assert reader.read(wire('abc', [4, 5, 6], [7, 8, 9]), True) is None
    assert (q.tolist(), u.tolist()) == ([4, 5, 6], [7, 8, 9])
    assert reader.q is q


@pytest.mark.parametrize(('reason', 'detail', 'message'), [
    (MISSING, 'c', state('ab', [1, 2], [1, 2])),
    (TWICE, 'a', state('abca', [1, 2, 3, 4], [1, 2, 3, 4])),
    (SHORT, '2 positions for 3 names', state('abc', [1, 2], [1, 2, 3])),
    (SHORT, '2 velocities for 3 names', state('abc', [1, 2, 3], [1, 2])),
    (NO_VELOCITY, '0 velocities', state('abc', [1, 2, 3])),
    (NOT_FINITE, 'b', state('abc', [1, math.nan, 3], [1, 2, 3])),
    (NOT_FINITE, 'c', state('abc', [1, 2, 3], [1, 2, math.inf])),
    (SHORT, '0 positions', state('abc', [])),
])
def test_an_invalid_state_gives_its_reason_and_the_next_is_read(reason, detail, message):
    reader = JointStateReader(JOINTS)
    assert reader.read(serialize_message(message), True) == reason
    assert detail in reader.detail
    assert reader.read(wire('abc', [1, 2, 3], [1, 2, 3]), True) is None


def test_a_state_with_a_locked_joint_elsewhere_is_dropped():
    reader = JointStateReader(JOINTS)
    reader.locked = {'lift': 0.1}
    names = ('lift', *JOINTS)
    assert reader.read(wire(names, [0.8, 1, 2, 3], [0, 1, 2, 3]), True) == ELSEWHERE
    assert 'lift at 0.8, which the model has at 0; expected it there' in reader.detail
    assert reader.read(wire(names, [0.05, 1, 2, 3], [0, 1, 2, 3]), True) is None


@pytest.mark.parametrize(('arm', 'joints', 'locked'), [
    ('two_link.urdf', ['joint2'], {'joint1'}),
    ('fr3.urdf', [f'fr3_joint{k}' for k in range(1, 8)], {'fr3_finger_joint1'})])
def test_locked_joints_may_be_where_they_change_the_torques_little(arm, joints, locked):
    path = resource_path('urdf', arm)
    model = load_urdf(path, joints=joints)
    allowed = locked_joints(path, '', model)
    assert set(allowed) == locked
    at_zero = Robot(model)
    q = at_zero.random_configuration(np.random.default_rng(0), 20)
    weakest = at_zero.limits.effort.min()
    for name, position in allowed.items():
        moved = Robot(load_urdf(path, joints=joints, locked={name: min(position, 0.04)}))
        change = np.abs(moved.gravity_force(q) - at_zero.gravity_force(q)).max()
        assert change < 0.02 * weakest
    assert locked_joints(path, '', load_urdf(path)) == {}


def test_wheels_another_arm_and_a_lift_or_a_vertical_axis_below_may_be_anywhere():
    # A mobile robot with two arms publishes all of its joints in one message.
    joints = [('wheel', 'base', 'continuous', '0 1 0'),
              ('yaw', 'base', 'revolute', '0 0 -1'),
              ('lift', 'yaw', 'prismatic', '0 0 1'),
              ('tilt', 'lift', 'revolute', '0 1 0')]
    for side in ('left', 'right'):
        joints += [(f'{side}_arm', 'tilt', 'revolute', '0 1 0'),
                   (f'{side}_slide', f'{side}_arm', 'prismatic', '1 0 0')]
    text = '<robot name="mobile"><link name="base"/>' + ''.join(
        f'<link name="{name}"><inertial><origin xyz="0.2 0 0"/><mass value="5"/>'
        '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>'
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{name}"/><axis xyz="{axis}"/>'
        '<limit lower="-9" upper="9" effort="50" velocity="2"/></joint>'
        for name, parent, kind, axis in joints) + '</robot>'
    model = load_urdf(text, joints=['left_arm'])
    allowed = locked_joints(text, '', model)
    assert set(allowed) == {'tilt', 'left_slide'}
    # A base on a wall has another gravity: its first axis turns the weight of the arm.
    on_a_wall = load_urdf(text, joints=['left_arm'], gravity=(9.81, 0.0, 0.0))
    assert set(locked_joints(text, '', on_a_wall)) == {'yaw', 'tilt', 'left_slide'}
    others = {'wheel': 4.0, 'yaw': 1.1, 'lift': 0.3, 'right_arm': 1.2,
              'right_slide': 0.3}
    moved = Robot(load_urdf(text, joints=['left_arm'], locked=others))
    gravity = Robot(model).gravity_force([0.3])
    np.testing.assert_allclose(moved.gravity_force([0.3]), gravity, rtol=1e-12)


def test_a_missing_velocity_is_zero_if_it_is_not_needed():
    reader = JointStateReader(JOINTS)
    reader.u[:] = 5.0
    assert reader.read(wire('abc', [1, 2, 3]), False) is None
    assert not reader.u.any()


def test_only_the_first_message_of_a_layout_is_fully_parsed():
    reader = JointStateReader(JOINTS)
    generator = np.random.default_rng(3)
    for _ in range(50):
        q, u = generator.normal(size=(2, 3))
        message = state('cab', q, u)
        message.header.stamp.sec = 7
        message.header.stamp.nanosec = 9
        assert reader.read(serialize_message(message), True) is None
        assert (reader.sec, reader.nanosec, reader.stamp) == (7, 9, 7_000_000_009)
        assert (reader.q == q[[1, 2, 0]]).all() and (reader.u == u[[1, 2, 0]]).all()
    assert reader.full_parses == 1


def test_the_joints_of_partial_and_of_foreign_messages_are_kept():
    reader = JointStateReader(JOINTS)
    for names in ('ab', 'ab', 'cx', 'xy'):
        reader.read(wire(names, [0, 0], [0, 0]), True)
    assert reader.partial_joints == {('a', 'b'), ('c',)}
    assert reader.foreign_joints == {('x', 'y')}


@pytest.mark.parametrize(('messages', 'parts'), [
    (('ab', 'c'), [('a', 'b'), ('c',)]), (('ab',), []), (('a', 'b'), []),
    (('xy', 'ab'), [])])
def test_states_that_only_together_have_all_joints_are_recognized_as_parts(
        messages, parts):
    reader = JointStateReader(JOINTS)
    for names in messages:
        count = [0.0] * len(names)
        reader.read(wire(names, count, count), True)
    path = SimpleNamespace(_reader=reader)
    assert TorquePath.take_parts(path) == parts
    assert TorquePath.take_parts(path) == []


def test_padding_and_trailing_bytes_are_ignored():
    reader = JointStateReader(JOINTS)
    data = bytearray(wire('abc', [1, 2, 3], [4, 5, 6]))
    assert reader.read(bytes(data), True) is None
    data[17:20] = b'\xaa\xbb\xcc'  # after the empty frame
    data[-1] = 0x55
    assert reader.read(bytes(data), True) is None
    assert reader.full_parses == 1


@pytest.mark.parametrize('other', [
    wire('acb', [1, 2, 3], [4, 5, 6]),           # other order, same length
    wire('abc', [1, 2, 3], [], ) + bytes(24),    # same length, other counts
])
def test_another_layout_of_the_same_length_is_recognized(other):
    reader = JointStateReader(JOINTS)
    fresh = JointStateReader(JOINTS)
    assert reader.read(wire('abc', [1, 2, 3], [4, 5, 6]), False) is None
    assert reader.read(other, False) is fresh.read(other, False) is None
    assert (reader.q == fresh.q).all() and (reader.u == fresh.u).all()
    assert reader.full_parses == 2


def test_big_endian_messages_are_fully_parsed_or_dropped():
    body = b''.join([struct.pack('>iI', 1, 2), struct.pack('>I', 1), bytes(4),
                     struct.pack('>I', 3)] + [struct.pack('>I', 2) + name + bytes(3)
                                              for name in (b'a', b'b', b'c')])
    body += struct.pack('>I', 3)
    for values in ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0)):
        body += b'' if values[0] == 1.0 else struct.pack('>I', 3)
        body += bytes(-len(body) % 8) + struct.pack('>3d', *values)
    data = bytes(4) + body + bytes(4)
    reader = JointStateReader(JOINTS)
    fault = reader.read(data, True)
    assert fault == MALFORMED or (reader.q.tolist(), reader.stamp) == ([1, 2, 3],
                                                                       1_000_000_002)
    assert not reader._layouts


def test_the_layout_cache_is_bounded():
    reader = JointStateReader(JOINTS)
    extra = ['x' * (8 * k + 1) for k in range(MAX_LAYOUTS + 1)]
    messages = [wire([*JOINTS, name], [1, 2, 3, 4], [1, 2, 3, 4]) for name in extra]
    for _ in range(3):
        for message in messages[:MAX_LAYOUTS]:
            assert reader.read(message, True) is None
    assert reader.full_parses == MAX_LAYOUTS
    assert reader.read(messages[-1], True) is None
    assert len(reader._layouts) == MAX_LAYOUTS


@pytest.mark.parametrize('data', [b'', b'\0\1', b'\0\1\0\0', bytes(100), b'\xff' * 200])
def test_a_malformed_message_is_dropped_and_the_next_one_is_read(data):
    reader = JointStateReader(JOINTS)
    assert reader.read(data, True) is not None
    assert reader.read(wire('abc', [1, 2, 3], [4, 5, 6]), True) is None
