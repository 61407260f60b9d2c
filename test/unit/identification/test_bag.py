"""Bags of joint states as real systems record them: read right, or refused by name."""

from kane_dynamics import InputError
from kane_dynamics.identification import read_recording
import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores

KIND = 'sensor_msgs/msg/JointState'
TYPES = get_typestore(Stores.ROS2_JAZZY)
JOINTS = ('turn', 'lift')
SECOND = 10**9


def state(stamp, names=JOINTS, values=(1.0, 2.0), effort=(3.0, 4.0)):
    """Return a joint state."""
    Time = TYPES.types['builtin_interfaces/msg/Time']
    header = TYPES.types['std_msgs/msg/Header'](Time(*divmod(stamp, SECOND)), '')
    numbers = np.array(values, dtype=np.float64)
    return TYPES.types[KIND](header, list(names), numbers, 0.0 * numbers,
                             np.array(effort, dtype=np.float64))


def bag(folder, states):
    """Write a bag of joint states; return its path."""
    path = folder / 'run'
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection('/joint_states', KIND, typestore=TYPES)
        # Bags are in the order of reception, whatever the stamps are.
        for received, message in enumerate(states):
            writer.write(connection, received, TYPES.serialize_cdr(message, KIND))
    return path


def stamps(count=100):
    """Return stamps 10 ms apart."""
    return [SECOND + k * SECOND // 100 for k in range(count)]


def test_messages_of_other_devices_on_the_topic_are_left_out(tmp_path):
    states = []
    for stamp in stamps():
        states.append(state(stamp, ('lift', 'turn')))
        states.append(state(stamp + SECOND // 1000, ('gripper',), (9.0,), (9.0,)))
    recording = read_recording(bag(tmp_path, states), JOINTS)
    assert len(recording) == 100
    # In the order of the joints, whatever that of the messages is.
    assert np.array_equal(recording.q[0], [2.0, 1.0])
    assert np.array_equal(recording.tau[-1], [4.0, 3.0])


def test_a_bag_of_other_joints_is_refused_with_their_names(tmp_path):
    states = [state(stamp, ('gripper',), (9.0,), (9.0,)) for stamp in stamps()]
    expected = r"\['gripper'\]; expected also \['turn', 'lift'\]"
    with pytest.raises(InputError, match=expected):
        read_recording(bag(tmp_path, states), JOINTS)


def test_a_clock_that_is_set_back_is_named_with_its_time(tmp_path):
    states = []
    for k, stamp in enumerate(stamps()):
        states.append(state(stamp - (3 * SECOND if k >= 50 else 0) + 5 * SECOND))
    with pytest.raises(InputError, match=r'go back by 2\.99 s after 0\.49 s; expected a '
                                         'clock that is not set back'):
        read_recording(bag(tmp_path, states), JOINTS)


def test_two_publishers_are_still_named_as_such(tmp_path):
    states = []
    for stamp in stamps():
        states.append(state(stamp))
        states.append(state(stamp - SECOND // 200))
    with pytest.raises(InputError, match='expected a single publisher'):
        read_recording(bag(tmp_path, states), JOINTS)


def test_joint_states_without_effort_are_counted(tmp_path):
    states = []
    for k, stamp in enumerate(stamps()):
        states.append(state(stamp, effort=() if k == 7 else (3.0, 4.0)))
    with pytest.raises(InputError, match='1 of 100 joint states without effort; '
                                         'expected positions and efforts in each'):
        read_recording(bag(tmp_path, states), JOINTS)


def test_a_folder_without_metadata_is_no_bag(tmp_path):
    with pytest.raises(InputError, match=r'no metadata\.yaml'):
        read_recording(tmp_path, JOINTS)
