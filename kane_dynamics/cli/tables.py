"""
Files of joint states over time: CSV in and out, and YAML trajectory points in.

A CSV file has a header. Its columns are `t` and `<quantity>.<joint>` with a quantity of
q, u, udot or tau; the name of a joint alone means q; other columns are ignored. A YAML
file has the structure of a trajectory_msgs/JointTrajectory: `joint_names` and `points`
with `time_from_start` and `positions`, optionally `velocities` and `accelerations`;
`header` and `effort` are ignored, and other keys are errors.
"""

from collections.abc import Mapping, Sequence
import csv
from dataclasses import dataclass
import math
import os
from pathlib import Path
from typing import Any, TextIO

from kane_dynamics._util.checks import increasing
from kane_dynamics._util.file_kinds import kind_of_content
from kane_dynamics._util.text import listing, SHORT
from kane_dynamics._util.typing import Array
from kane_dynamics._util.yaml_io import mapping, read_yaml
from kane_dynamics.cli.arguments import STEP
from kane_dynamics.cli.printing import warn
from kane_dynamics.errors import InputError
from kane_dynamics.identification.recordings.reader import distinct, no_header
from kane_dynamics.loop_tracking.driven_mechanism import mechanism_motion
from kane_dynamics.motion.motion import Motion
from kane_dynamics.motion.smooth_motion import SmoothMotion
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.trajectory import Trajectory
import numpy as np

QUANTITIES = ('q', 'u', 'udot', 'tau')
MOST_SAMPLES = 1_000_000
TRAVEL = 0.1  # rad or m: smaller motions are not compared with their speeds
State = tuple[Array, Array, Array]
Rows = tuple[Array | None, State]
MESSAGE = ('joint_names', 'points', 'header')  # of trajectory_msgs/JointTrajectory
POINT = ('positions', 'velocities', 'accelerations', 'time_from_start', 'effort')


@dataclass(frozen=True)
class States:
    """Rows of a file for the chosen joints: t is (K,), q to tau are (K, n); None if missing."""

    header: tuple[str, ...] = ()
    t: Array | None = None
    q: Array | None = None
    u: Array | None = None
    udot: Array | None = None
    tau: Array | None = None


def read_motion(path: str | Path, joint_names: Sequence[str]) -> Motion:
    """Return the motion through the points of a CSV or YAML file; InputError names the entry."""
    names, times, rows = _read_points(path, joint_names)
    return _motion(path, times, rows, names, joint_names)


def read_smooth_motion(path: str | Path, joint_names: Sequence[str]) -> SmoothMotion:
    """
    Return the motion with a continuous jerk through the points of a CSV or YAML file.

    Through positions alone it is `SmoothMotion.from_points`. Speeds and accelerations, if
    the file states them, have to be those of such a motion.

    Raises
    ------
    InputError
        The content is invalid, or the jerk of the stated motion jumps; the message names
        the file and the entry.

    """
    names, times, rows = _read_points(path, joint_names)
    motion = _motion(path, times, rows, names, joint_names)
    stated = [values for values in rows[1:] if values is not None and any(map(len, values))]
    try:
        if stated:
            return SmoothMotion.from_motion(motion)
        return SmoothMotion.from_points(motion.times, motion.positions,
                                        joint_names=joint_names)
    except InputError as error:
        raise InputError(f'{path}: {error}') from None


def _read_points(path: str | Path, joint_names: Sequence[str]
                 ) -> tuple[Sequence[str], Any, list[Any]]:
    """Return names, times, and positions, velocities and accelerations; None if missing."""
    if _is_yaml(path):
        return read_yaml_points(path)
    states = read_states(path, joint_names)
    if states.t is None or states.q is None:
        raise InputError(f"{path}: no column 't' or 'q.<joint>'; expected both for a "
                         f'motion, found {listing(states.header, 12)}')
    return joint_names, states.t, [states.q, states.u, states.udot]


def read_states(path: str | Path, joint_names: Sequence[str]) -> States:
    """
    Return the columns of a CSV file for the named joints.

    Raises
    ------
    InputError
        If the content is invalid; the message names the file, and the row and column of
        a bad number, the joints without a column, or a duplicate column.

    """
    reader = csv.reader(_text(path).splitlines(), skipinitialspace=True)
    lines = list(filter(None, reader))
    if len(lines) < 2:
        raise InputError(f'{path}: {len(lines)} lines; expected a header and rows of '
                         'numbers')
    header = list(map(str.strip, lines[0]))
    no_header(path, header, f't,q.{joint_names[0]},...')
    distinct(path, header)
    # A quantity without a column is left out; some of its columns alone are an error.
    tables: dict[str, Any] = {}
    for quantity in QUANTITIES:
        columns = _columns_of(path, header, quantity, joint_names)
        if columns:
            tables[quantity] = _numbers(path, lines, columns)
    if not tables:
        raise InputError(f'{path}: no column of any joint; expected names like '
                         f"'q.{joint_names[0]}', found {header}")
    # Times are optional, under either name.
    t = None
    for k, name in enumerate(header):
        if name in ('t', 'time') and t is None:
            t = _numbers(path, lines, [k])[:, 0]
    return States(tuple(header), t, **tables)


def _columns_of(path: str | Path, header: list[str], quantity: str,
                joint_names: Sequence[str]) -> list[int]:
    """Return the columns of a quantity of all joints; none if no joint has one."""
    columns = []
    lacking = []
    for joint in joint_names:
        column = _column(header, quantity, joint)
        if column is None:
            lacking.append(joint)
        else:
            columns.append(column)
    # A quantity is there for all joints or for none.
    if lacking and columns:
        raise InputError(f"{path}: no column '{quantity}.{lacking[0]}'"
                         f'{further(lacking[1:])}, but {quantity} of other joints; '
                         f'expected {quantity}.<joint> of every joint (found '
                         f'{", ".join(header)})')
    return columns


def read_rows(path: str, joint_names: Sequence[str], step: float | None = None) -> Rows:
    """
    Return t and (q, u, udot) of a CSV or YAML file; t may be missing.

    The points of a YAML file are a motion, which is sampled; the rows of a CSV file are
    returned unchanged. Missing speeds and accelerations are those of the smooth curve
    through the points.

    Parameters
    ----------
    path : str
        Path of the file.
    joint_names : sequence of str
        The chosen joints, in the order of the result.
    step : float, optional
        Largest time between two samples, s, also of a CSV file. Default for YAML:
        `STEP`.

    Raises
    ------
    InputError
        If the content is invalid; the message names the file and the entry.

    """
    if step is None:
        rows = complete_rows(path, joint_names)
        if rows is not None:
            _warn_of_speeds(path, rows, joint_names)
            return rows
        step = STEP if _is_yaml(path) else math.inf
    return sampled_motion(read_motion(path, joint_names), step)


def complete_rows(path: str, joint_names: Sequence[str]) -> Rows | None:
    """Return the rows of a CSV file with q, u and udot; None for other files."""
    if _is_yaml(path):
        return None
    states = read_states(path, joint_names)
    if states.q is None or states.u is None or states.udot is None:
        return None
    if states.t is not None:
        increasing(states.t, len(states.q), f"{path}: column 't'")
    return states.t, (states.q, states.u, states.udot)


def _warn_of_speeds(path: str, rows: Rows, joint_names: Sequence[str]) -> None:
    """Warn of joints whose speeds are not the changes of their positions over time."""
    t, (q, u, _) = rows
    if t is None or len(t) < 2:
        return
    travel = np.abs(np.diff(q, axis=0)).sum(axis=0)
    mean_speed = 0.5 * np.abs(u[1:] + u[:-1])
    travel_of_speeds = np.diff(t) @ mean_speed
    # Coarse rows may miss half of a motion, not most of it.
    other = (travel > TRAVEL) & ((travel_of_speeds < 0.5 * travel)
                                 | (travel_of_speeds > 2.0 * travel))
    if other.any():
        j = int(np.argmax(other))
        warn(f"{path}: speeds of '{joint_names[j]}' move it by {travel_of_speeds[j]:.3g}, its "
             f'positions by {travel[j]:.3g} rad or m; expected speeds that are the '
             'derivative of the positions')


def sampled_motion(motion: Motion, step: float) -> Rows:
    """Return samples of a motion at its points and, at most `step` apart, between them."""
    if not step > 0.0:
        raise InputError(f'--step: {step}; expected a positive time in s')
    counts = np.maximum(np.ceil(np.diff(motion.times) / step - 1e-9), 1.0).astype(int)
    if counts.sum() > MOST_SAMPLES:
        raise InputError(f'--step: {step:g}, {counts.sum()} samples of '
                         f'{motion.duration:g} s; expected at most {MOST_SAMPLES}')
    pieces = []
    for begin, end, count in zip(motion.times[:-1], motion.times[1:], counts,
                                 strict=True):
        pieces.append(np.linspace(begin, end, count, endpoint=False))
    t = np.concatenate([*pieces, motion.times[-1:]])
    until = t.copy()
    until[-1] = np.nextafter(t[-1], -math.inf)  # at its very end a motion is at rest
    return t, motion.sample(until)


def load_trajectory(path: str, robot: Robot) -> Trajectory:
    """Return a trajectory from a CSV, YAML or saved npz file; InputError names the entry."""
    if path.endswith('.npz'):
        return Trajectory.load_npz(path)
    names = robot.speed_names
    rows = complete_rows(path, names)
    t, state = rows or sampled_motion(read_motion(path, names), STEP)
    if t is None:
        raise InputError(f"{path}: no column 't'; expected the times of the rows, s")
    return Trajectory.along(robot, t, *of_mechanism(path, robot, t, state))


def of_mechanism(path: str, robot: Robot, t: Array | None, state: State) -> State:
    """
    Return q (K, n_q), u and udot (K, n) of a robot for the rows of its independent joints.

    Other joints follow by loop closure, row by row from the configuration of the
    constraints file. Rows without times are in the order of a motion.
    """
    if t is None:
        robot.equations.require_timeless(path, "or a column 't' with the times, s")
    return mechanism_motion(robot, robot.speed_names, t, *state)


def joint_rows(robot: Robot, state: State) -> dict[str, Array]:
    """Return positions, speeds, accelerations and torques of all joints along a motion."""
    q, u, udot = state
    tau = robot.inverse_dynamics(q, u, udot)
    return {'q': q, 'u': robot.joint_rates(q, u),
            'udot': robot.joint_accelerations(q, u, udot),
            'tau': robot.joint_torques(tau, q)}


def write_states(stream: TextIO, t: Array | None, states: Mapping[str, Array],
                 joint_names: Sequence[str]) -> None:
    """Write (K, n) arrays by quantity as CSV with all digits."""
    writer = csv.writer(stream, lineterminator='\n')
    header = []
    columns = []
    if t is not None:
        header.append('t')
        columns.append(t[:, None])
    # A block of columns for each quantity, one for each joint.
    for quantity, values in states.items():
        header += [f'{quantity}.{joint}' for joint in joint_names]
        columns.append(values)
    writer.writerow(header)
    writer.writerows(np.hstack(columns).tolist())


def further(names: Sequence[str]) -> str:
    """Return the number of further names as text, or an empty text."""
    return f' (nor of {len(names)} more joints)' if names else ''


def _is_yaml(path: str | Path) -> bool:
    return Path(path).suffix in ('.yaml', '.yml')


def _column(header: list[str], quantity: str, joint: str) -> int | None:
    """Return the index of the column of a joint's quantity; None if there is none."""
    name = f'{quantity}.{joint}'
    if name in header:
        return header.index(name)
    if quantity == 'q' and joint in header:
        return header.index(joint)
    return None


def _numbers(path: str | Path, lines: list[list[str]],
             columns: Sequence[int | None]) -> Array:
    """Return the (K, n) numbers of some columns."""
    out = np.empty((len(lines) - 1, len(columns)))
    for i, line in enumerate(lines[1:]):
        for k, column in enumerate(columns):
            assert column is not None
            try:
                out[i, k] = float(line[column])
            except (ValueError, IndexError):
                value = repr(line[column]) if column < len(line) else 'missing'
                raise InputError(f"{path}: row {i + 1}, column '{lines[0][column]}': "
                                 f'{value}; expected a number') from None
    return out


def read_yaml_points(path: str | Path) -> tuple[list[str], list[float], list[Any]]:
    """Return joint names, times, and rows of positions, velocities and accelerations."""
    content = mapping(read_yaml(path, 'motion', InputError), str(path), MESSAGE,
                      InputError)
    for key, what in (('joint_names', 'names'),
                      ('points', "points, each with 'time_from_start' and 'positions'")):
        if not isinstance(content.get(key), list):
            raise InputError(f'{path}: {key}: {SHORT.repr(content.get(key))}; expected '
                             f'a list of {what}')
    times = []
    rows: list[list[Any]] = [[], [], []]  # positions, velocities, accelerations
    for i, entry in enumerate(content['points']):
        what = f'{path}: point {i}'
        point = mapping(entry, what, POINT, InputError)
        times.append(_seconds(point.get('time_from_start'), f'{what}: time_from_start'))
        for values, name in zip(rows, POINT[:3], strict=True):
            values.append(point.get(name) or [])
    return content['joint_names'], times, rows


def _motion(path: str | Path, times: Any, rows: Any, names: Sequence[str],
            order: Sequence[str]) -> Motion:
    """Return the motion through points; errors name the file."""
    try:
        return Motion.from_points(times, *rows, joint_names=names, order=order)
    except InputError as error:
        raise InputError(f'{path}: {error}') from None


def _seconds(value: Any, what: str) -> float:
    """Return a time in s, given as a number or a builtin_interfaces/Duration."""
    parts: Mapping[str, Any] = {'sec': value}
    if isinstance(value, Mapping):
        parts = mapping(value, what, ('sec', 'nanosec'), InputError)
    try:
        return float(parts.get('sec', 0)) + 1e-9 * float(parts.get('nanosec', 0))
    except (TypeError, ValueError):
        raise InputError(f'{what}: {SHORT.repr(value)}; expected seconds, or a mapping '
                         'of sec and nanosec') from None


def _text(path: str | Path) -> str:
    """Return the text of a file, or raise InputError."""
    try:
        data = Path(path).read_bytes()
        kind = kind_of_content(data)
        if not kind.startswith(('a CSV', 'text', 'an empty')):
            raise InputError(f'{path}: seems to be {kind}; expected a CSV file, or a YAML or '
                             'npz file with this ending')
        return data.decode('utf-8-sig')
    except FileNotFoundError:
        raise InputError(f'no such file: {os.fspath(path)!r}; expected a CSV, YAML or '
                         'npz file') from None
    except OSError as error:
        raise InputError(f'{path}: {error.strerror}; expected a readable file') from None
