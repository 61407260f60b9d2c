"""Read messages from a ROS 2 bag (MCAP or SQLite) with rosbags, without ROS."""

from collections.abc import Iterator, Sequence
import os
from pathlib import Path
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
import numpy as np

JOINT_STATE = 'sensor_msgs/msg/JointState'
MOST_RETURNS = 3  # of a clock
MOST_OUT_OF_ORDER = 0.01  # fraction of messages with a repeated or an earlier stamp


def is_bag(path: Path) -> bool:
    """Return whether a path is that of a bag: a folder, or the file in it."""
    return path.suffix in ('.mcap', '.db3') or path.is_dir()


def read_bag(path: Path, joint_names: Sequence[str], topic: str | None = None
             ) -> dict[str, Array]:
    """
    Return the joint states of a topic as columns t, q, u, tau.

    Parameters
    ----------
    path : Path
        Folder of a bag, or its .mcap or .db3 file.
    joint_names : sequence of str
        Joints, in the order of the result; other joints in the messages are ignored, and
        messages without any of them.
    topic : str, optional
        Default: the only topic of joint states in the bag.

    Returns
    -------
    dict
        t (N,), s from the first message; q, u, tau (N, n), u only if it was recorded.

    Raises
    ------
    InputError
        If the bag, the topic, a joint or the efforts are missing, messages are out of
        order, or the clock was set back.

    """
    stamps: list[int] = []
    states: list[list[Any]] = []
    dropped = 0
    returns: list[str] = []
    previous = 0
    for stamp, state in _messages(path, joint_names, topic):
        if stamp < previous:
            after = (previous - stamps[0]) * 1e-9
            returns.append(f'{(previous - stamp) * 1e-9:.3g} s after {after:.3g} s')
        previous = stamp
        # A stamp that repeats or goes back is dropped; too many mean two publishers.
        if stamps and stamp <= stamps[-1]:
            dropped += 1
            continue
        stamps.append(stamp)
        states.append(state)
    total = len(states) + dropped
    if dropped > MOST_OUT_OF_ORDER * total:
        # Two publishers alternate; a clock goes back now and then.
        if 0 < len(returns) <= MOST_RETURNS:
            raise InputError(f'{path}: stamps of joint states go back by '
                             f'{", ".join(returns)}; expected a clock that is not set '
                             'back while the bag is recorded')
        raise InputError(f'{path}: {dropped} of {total} joint states repeat a stamp or '
                         'come out of order; expected a single publisher on the topic')

    # The first stamp is time zero.
    t = np.array(stamps, dtype=np.float64)
    columns = {'t': (t - t[:1]) * 1e-9}
    for part, (name, what) in enumerate((('q', 'position'), ('u', 'velocity'),
                                         ('tau', 'effort'))):
        values = [state[part] for state in states]
        is_complete = all(value is not None for value in values)
        if is_complete:
            columns[name] = np.array(values).reshape(len(states), len(joint_names))
        # Speeds may be missing, since they follow from positions.
        elif name != 'u':
            lacking = sum(value is None for value in values)
            raise InputError(f'{path}: {lacking} of {len(values)} joint states without '
                             f'{what}; expected positions and efforts in each')
    return columns


def _messages(path: Path, joint_names: Sequence[str],
              topic: str | None) -> Iterator[tuple[int, list[Any]]]:
    """Yield stamp, ns, and position, velocity and effort (or None) of each message."""
    other_joints: set[str] = set()
    is_found = False
    for _, logged, message in bag_messages(path, JOINT_STATE, topic):
        # Other devices, such as grippers, publish on the same topic.
        if joint_names and set(joint_names).isdisjoint(message.name):
            other_joints.update(message.name)
            continue
        is_found = True
        stamp = message.header.stamp
        yield (stamp.sec * 10**9 + stamp.nanosec or logged,
               _of_joints(message, joint_names, path))
    if other_joints and not is_found:
        raise InputError(f'{path}: joint states of {sorted(other_joints)}; expected also '
                         f'{list(joint_names)}')


def typestore() -> Any:
    """Return the message types of a bag; raise InputError if rosbags is not installed."""
    try:
        from rosbags.typesys import get_typestore, Stores
    except ImportError:
        raise InputError("bag: 'rosbags' is not installed; expected pip install "
                         "'kane_dynamics[identify]'") from None
    return get_typestore(Stores.ROS2_JAZZY)


def bag_messages(path: Path, kind: str, topic: str | None) -> Iterator[tuple[str, int,
                                                                             Any]]:
    """
    Yield topic, time of recording, ns, and message of each message of a type on one topic.

    Parameters
    ----------
    path : Path
        Folder of a bag, or its .mcap or .db3 file.
    kind : str
        Type of the messages.
    topic : str or None
        None for the only topic of that type.

    Raises
    ------
    InputError
        If the bag or the topic is missing or not readable.

    """
    types = typestore()
    from rosbags.highlevel import AnyReader, AnyReaderError
    folder = path if path.is_dir() else path.parent
    if not path.exists():
        raise InputError(f'no such file: {os.fspath(path)!r}; expected the folder of a '
                         'ROS 2 bag, or its .mcap or .db3 file')
    if not (folder / 'metadata.yaml').exists():
        raise InputError(f'{path}: no metadata.yaml beside it; expected the folder of a '
                         'ROS 2 bag')
    # Messages are deserialized one by one, because a bag may be larger than the memory.
    try:
        with AnyReader([folder], default_typestore=types) as reader:
            chosen = _connections(reader.connections, path, kind, topic)
            for connection, logged, data in reader.messages(connections=chosen):
                yield connection.topic, logged, reader.deserialize(data,
                                                                   connection.msgtype)
    except AnyReaderError as error:
        raise InputError(f'{path}: {error}; expected a readable ROS 2 bag') from None


def _connections(connections: Sequence[Any], path: Path, kind: str,
                 topic: str | None) -> list[Any]:
    """Return the connections of the chosen topic of messages of a type."""
    # Messages of the type, on one topic or on several.
    of_kind = [connection for connection in connections if connection.msgtype == kind]
    topics = sorted({connection.topic for connection in of_kind})
    if topic is None and len(topics) == 1:
        topic = topics[0]
    # One topic of the type needs no choice.
    if topic not in topics:
        if topic is not None:
            problem = f"no topic '{topic}'"
        elif topics:
            problem = 'several topics'
        else:
            problem = 'no topic'
        raise InputError(f'{path}: {problem} of {kind}; expected one of '
                         f"{topics or 'none'}")
    return [connection for connection in of_kind if connection.topic == topic]


def _of_joints(message: Any, joint_names: Sequence[str], path: Path) -> list[Any]:
    """Return position, velocity and effort in the order of the joints; None if empty."""
    # Messages may have the joints in any order, and further ones.
    places = {name: k for k, name in enumerate(message.name)}
    missing = [name for name in joint_names if name not in places]
    if missing:
        raise InputError(f'{path}: joint states of {list(message.name)}; expected also '
                         f'{missing}')
    # Positions, velocities and efforts are optional, but as many as names.
    chosen = [places[name] for name in joint_names]
    parts: list[Any] = []
    for values in (message.position, message.velocity, message.effort):
        if not len(values):
            parts.append(None)
            continue
        if len(values) != len(message.name):
            raise InputError(f'{path}: a joint state with {len(values)} values; '
                             f'expected {len(message.name)}, one per name')
        parts.append(np.asarray(values, dtype=np.float64)[chosen])
    return parts
