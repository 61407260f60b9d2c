"""Joint states out of a ROS 2 bag, without ROS: MCAP or SQLite, through rosbags."""

from collections.abc import Iterator, Sequence
import os
from pathlib import Path
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
import numpy as np

JOINT_STATE = 'sensor_msgs/msg/JointState'
MOST_OUT_OF_ORDER = 0.01  # share of messages that may repeat a stamp or come too late


def is_bag(path: Path) -> bool:
    """Tell whether a path is a bag: a folder with metadata, or the file in one."""
    return path.suffix in ('.mcap', '.db3') or (path / 'metadata.yaml').exists()


def read_bag(path: Path, joint_names: Sequence[str], topic: str | None = None
             ) -> dict[str, Array]:
    """
    Return the joint states on a topic as columns, like those of a file: t, q, u, tau.

    Parameters
    ----------
    path : Path
        Of a bag's folder, or of its .mcap or .db3 file.
    joint_names : sequence of str
        The joints that count, in their order; others in the messages are left aside.
    topic : str, optional
        By default the bag's only one of joint states.

    Returns
    -------
    dict
        t (N,), s from the first message; q, u, tau (N, n), u only if it was recorded.

    Raises
    ------
    InputError
        Names what is missing: the bag, the topic, a joint, the efforts; or messages out of order.

    """
    rows = list(_messages(path, joint_names, topic))
    stamps = np.array([stamp for stamp, _ in rows], dtype=np.float64)
    before = np.concatenate([[-np.inf], np.maximum.accumulate(stamps)[:-1]])[:len(stamps)]
    kept = np.flatnonzero(stamps > before)
    if len(rows) - len(kept) > MOST_OUT_OF_ORDER * len(rows):
        raise InputError(f'{path}: {len(rows) - len(kept)} of {len(rows)} joint states repeat a '
                         'stamp or come out of order: do several publishers share the topic?')
    columns = {'t': (stamps[kept] - stamps[0]) * 1e-9 if len(kept) else np.zeros(0)}
    for name, part in (('q', 0), ('u', 1), ('tau', 2)):
        values = [rows[k][1][part] for k in kept]
        if any(value is None for value in values):
            if name == 'u':
                continue
            raise InputError(f"{path}: joint states without {'effort' if part else 'position'}; "
                             'a comparison needs both')
        columns[name] = np.array(values).reshape(len(kept), len(joint_names))
    return columns


def _messages(path: Path, joint_names: Sequence[str],
              topic: str | None) -> Iterator[tuple[int, list[Any]]]:
    """Yield each message's stamp, ns, and position, velocity and effort of the joints, or None."""
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import get_typestore, Stores
    except ImportError:
        raise InputError("reading bags needs 'rosbags', which is not installed; pip install "
                         "'kane_dynamics[identify]'") from None
    folder = path if path.is_dir() else path.parent
    if not path.exists():
        raise InputError(f'no such file: {os.fspath(path)!r}; expected the folder of a ROS 2 bag, '
                         'or its .mcap or .db3 file')
    if not (folder / 'metadata.yaml').exists():
        raise InputError(f'{path}: no metadata.yaml beside it; expected the folder of a ROS 2 bag')
    try:
        with AnyReader([folder], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
            chosen = _connections(reader.connections, path, topic)
            for connection, logged, data in reader.messages(connections=chosen):
                message: Any = reader.deserialize(data, connection.msgtype)
                stamp = message.header.stamp
                yield (stamp.sec * 10**9 + stamp.nanosec or logged,
                       _of_joints(message, joint_names, path))
    except AnyReaderError as error:
        raise InputError(f'{path}: {error}') from None


def _connections(connections: Sequence[Any], path: Path, topic: str | None) -> list[Any]:
    """Return those of the wanted topic of joint states."""
    topics = sorted({c.topic for c in connections if c.msgtype == JOINT_STATE})
    if topic is None and len(topics) == 1:
        topic = topics[0]
    if topic not in topics:
        asked = 'several topics' if topic is None and topics else f"no topic '{topic}'"
        if topic is None and not topics:
            asked = 'no topic'
        raise InputError(f"{path}: {asked} of {JOINT_STATE}; it has {topics or 'none'}")
    return [c for c in connections if c.topic == topic and c.msgtype == JOINT_STATE]


def _of_joints(message: Any, joint_names: Sequence[str], path: Path) -> list[Any]:
    """Return position, velocity and effort in the order of the joints; None what is empty."""
    places = {name: k for k, name in enumerate(message.name)}
    missing = [name for name in joint_names if name not in places]
    if missing:
        raise InputError(f'{path}: a joint state lacks {missing}; it has {list(message.name)}')
    index = [places[name] for name in joint_names]
    parts: list[Any] = []
    for values in (message.position, message.velocity, message.effort):
        if len(values) not in (0, len(message.name)):
            raise InputError(f'{path}: a joint state has {len(message.name)} names and '
                             f'{len(values)} values')
        parts.append(np.asarray(values, dtype=np.float64)[index] if len(values) else None)
    return parts
