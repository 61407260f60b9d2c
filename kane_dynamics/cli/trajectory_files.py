"""Joint trajectories in files: reads YAML, CSV, npz and bags, writes YAML and bags."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, TextIO

from kane_dynamics._util.text import listing
from kane_dynamics.cli.tables import read_states, read_yaml_points
from kane_dynamics.control.trajectory_feedforward import FilledTrajectory
from kane_dynamics.errors import InputError
from kane_dynamics.identification.recordings.bag import bag_messages, is_bag, typestore
from kane_dynamics.simulation.trajectory import Trajectory
import numpy as np
import yaml

JOINT_TRAJECTORY = 'trajectory_msgs/msg/JointTrajectory'


class Points(NamedTuple):
    """
    Points of one trajectory as they were given; velocities and accelerations may be missing.

    `topic`, `logged` (ns) and `message` are those of a bag.
    """

    joint_names: tuple[str, ...]
    times: Any
    rows: tuple[Any, Any, Any]
    topic: str = ''
    logged: int = 0
    message: Any = None


def read_points(path: str, joint_names: Sequence[str],
                topic: str | None) -> list[Points]:
    """
    Return the trajectories of a file: one, or all of a topic of a bag.

    Raises
    ------
    InputError
        If the content is invalid; the message names the file and the entry.

    """
    names = tuple(joint_names)
    if is_bag(Path(path)):
        return _bag_points(Path(path), topic)
    if topic is not None:
        raise InputError(f"--topic: '{topic}' for a file; expected it for a bag only")
    if path.endswith('.npz'):
        saved = Trajectory.load_npz(Path(path))
        return [Points(tuple(saved.joint_names), saved.t,
                       (saved.q, saved.u, saved.udot))]
    if Path(path).suffix in ('.yaml', '.yml'):
        stated_names, times, (q, u, udot) = read_yaml_points(path)
        return [Points(tuple(stated_names), times, (q, u, udot))]
    states = read_states(path, names)
    if states.t is None or states.q is None:
        raise InputError(f"{path}: no column 't' or 'q.<joint>'; expected both for a "
                         f'motion, found {listing(states.header, 12)}')
    return [Points(names, states.t, (states.q, states.u, states.udot))]


def _bag_points(path: Path, topic: str | None) -> list[Points]:
    """Return the trajectories of a topic of a bag."""
    trajectories = []
    for name, logged, message in bag_messages(path, JOINT_TRAJECTORY, topic):
        times, positions, velocities, accelerations = [], [], [], []
        for point in message.points:
            times.append(point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec)
            positions.append(point.positions)
            velocities.append(point.velocities)
            accelerations.append(point.accelerations)
        rows = positions, velocities, accelerations
        trajectories.append(Points(tuple(message.joint_names), times, rows, name, logged,
                                   message))
    if not trajectories:
        raise InputError(f'{path}: no trajectory; expected one or more messages of type '
                         f'{JOINT_TRAJECTORY}')
    return trajectories


def write_yaml(stream: TextIO, filled: FilledTrajectory) -> None:
    """Write a trajectory like a trajectory_msgs/JointTrajectory, with all digits."""
    sec, nanosec = np.divmod(np.rint(filled.times * 1e9).astype(np.int64), 10**9)
    points = []
    for k in range(len(filled.times)):
        points.append({'positions': filled.positions[k].tolist(),
                       'velocities': filled.velocities[k].tolist(),
                       'accelerations': filled.accelerations[k].tolist(),
                       'effort': filled.efforts[k].tolist(),
                       'time_from_start': {'sec': int(sec[k]),
                                           'nanosec': int(nanosec[k])}})
    yaml.safe_dump({'joint_names': list(filled.joint_names), 'points': points}, stream,
                   default_flow_style=None, sort_keys=False, width=1000)


def write_bag(path: Path, trajectories: Sequence[Points],
              filled: Sequence[FilledTrajectory]) -> None:
    """Write a bag with filled trajectories, with topics and times of the given ones."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    # The message types, as rosbags defines them.
    types = typestore()
    Message = types.types[JOINT_TRAJECTORY]
    Point = types.types['trajectory_msgs/msg/JointTrajectoryPoint']
    Duration = types.types['builtin_interfaces/msg/Duration']
    if path.exists():
        raise InputError(f"--out: '{path}' exists; expected the folder of a new bag")
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection(trajectories[0].topic, JOINT_TRAJECTORY,
                                           typestore=types)
        for points, result in zip(trajectories, filled, strict=True):
            tables = map(np.ascontiguousarray, (result.positions, result.velocities,
                                                result.accelerations, result.efforts))
            # Times become whole nanoseconds, divided into seconds and the rest.
            nanoseconds = np.rint(result.times * 1e9).astype(np.int64).tolist()
            rows = []
            for *values, time in zip(*tables, nanoseconds, strict=True):
                sec, nanosec = divmod(time, 10**9)
                rows.append(Point(*values, time_from_start=Duration(sec, nanosec)))
            message = Message(points.message.header, list(result.joint_names), rows)
            writer.write(connection, points.logged,
                         types.serialize_cdr(message, JOINT_TRAJECTORY))
