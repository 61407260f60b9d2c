"""Read recordings from files: CSV, npz, ROS 2 bags."""

from collections.abc import Mapping, Sequence
import os
from pathlib import Path
import re
from typing import Any

from kane_dynamics._util.checks import increasing
from kane_dynamics._util.file_kinds import kind_of_content, LONGEST
from kane_dynamics._util.npz import npz_arrays
from kane_dynamics._util.text import listing
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.identification.recordings.bag import is_bag, read_bag
from kane_dynamics.identification.recordings.recording import NAMES, real, Recording
import numpy as np

# Names of columns: `<word>.<joint>`, or `<word><number>` counted from the base.
WORDS = {'q': ('q',), 'u': ('u', 'v'), 'udot': ('udot', 'a'), 'tau': ('tau',),
         'theta': ('theta',), 'motor_torque': ('motor_torque',),
         'gear_torque': ('gear_torque',), 'approach': ('approach',)}
TIMES = ('t', 'time')
OURS = re.compile(rf'({"|".join(word for words in WORDS.values() for word in words)})'
                  r'([1-9]\d*|\..*)?|' + '|'.join(TIMES))
LABELS = ('joint_names', 'speed_names')
SEPARATORS = {';': 'semicolons', '\t': 'tabs'}  # of other tables than CSV


def read_recording(path: str | os.PathLike[str], joint_names: Sequence[str],
                   topic: str | None = None, *, numbered: Sequence[str] | None = None
                   ) -> Recording:
    """
    Return the recording of a CSV file with a header, an npz file, or a ROS 2 bag.

    Columns (in npz: arrays) are `t` or `time`, and for each joint `q`, `u` or `v`,
    `udot` or `a`, and `tau`, either as `q.<joint>` or numbered from the base as `q1`. An
    npz may also hold (N, n) arrays `q` and so on, with an array `joint_names` or in the
    order of numbers; it may be one of `Trajectory.save_npz`. Speeds and accelerations
    that are missing are central differences. Of a bag (MCAP or SQLite) the joint states
    are read, on `topic` if it has them on several.

    Parameters
    ----------
    path : path
        Path of the file, or of the folder of a bag.
    joint_names : sequence of str
        Joints, in the order of the result.
    topic : str, optional
        Topic of a bag.
    numbered : sequence of str, optional
        All joints of the robot from the base, if `joint_names` are a part of them or in
        another order. Numbered columns are those of all joints of the robot, or of
        `joint_names` only, depending on their count.

    Raises
    ------
    InputError
        If a column is missing, not numeric, duplicate, or its number is ambiguous; the
        message names the file and the column.

    """
    file = Path(path)
    if is_bag(file):
        columns: dict[str, Any] = {**read_bag(file, joint_names, topic),
                                   'joint_names': list(joint_names)}
    elif topic is not None:
        raise InputError(f"topic: '{topic}' for the file '{path}'; expected it for a bag "
                         'only')
    else:
        columns = _read(file)
    t = _time(columns, path)

    # Positions and torques are needed; speeds and accelerations may follow from them.
    order = list(joint_names if numbered is None else numbered)
    quantities = _required(columns, NAMES, joint_names, order, path)
    for name, value in quantities.items():
        if value is not None and len(value) != len(t):
            raise InputError(f"{path}: '{name}': {len(value)} rows; expected {len(t)}, "
                             'as many as times')

    # Speeds that are missing are differences of positions, accelerations of speeds.
    derived: tuple[str, ...] = ()
    for name, source in (('u', 'q'), ('udot', 'u')):
        if quantities[name] is None:
            quantities[name] = np.gradient(quantities[source], t, axis=0)
            derived += (name,)
    # The errors of the record do not know the file.
    try:
        return Recording(t, **quantities, derived=derived)
    except InputError as error:
        raise InputError(f'{path}: {error}') from None


def recorded_columns(path: str | os.PathLike[str], joint_names: Sequence[str],
                     quantities: Sequence[str]) -> dict[str, Array | None]:
    """
    Return the times 't', (N,), and quantities of `WORDS`, (N, n), of a CSV or npz file.

    A quantity without columns is None. Errors are those of `read_recording`.
    """
    # Columns by name, of which times are needed and others may be missing.
    columns = _read(Path(path))
    t = _time(columns, path)
    result: dict[str, Array | None] = {'t': t}
    for name in quantities:
        values = _quantity(columns, name, joint_names, list(joint_names), path)
        if values is not None and len(values) != len(t):
            raise InputError(f"{path}: '{name}': {len(values)} rows; expected {len(t)}, "
                             'as many as times')
        result[name] = values
    return result


def has_times(path: str | os.PathLike[str]) -> bool:
    """Return whether a CSV or npz file has a column of times."""
    columns = _read(Path(path))
    return any(name in columns for name in TIMES)


def rows_without_times(path: str | os.PathLike[str], joint_names: Sequence[str],
                       numbered: Sequence[str] | None = None
                       ) -> tuple[Array, Array, Array]:
    """
    Return positions, torques and approaches, (N, n), of a table; 0 for no approaches.

    Errors are those of `read_recording`.
    """
    columns = _read(Path(path))
    order = list(joint_names if numbered is None else numbered)
    quantities = _required(columns, ('q', 'tau', 'approach'), joint_names, order, path)
    q, tau, approach = quantities.values()
    return q, tau, np.zeros_like(q) if approach is None else approach


def positions_by_name(path: str | os.PathLike[str],
                      joint_names: Sequence[str]) -> dict[str, Array]:
    """Return the positions, (N,), of the joints that a CSV or npz file has by name."""
    if is_bag(Path(path)):
        return {}
    columns = _read(Path(path))
    labels: list[str] = columns.get('joint_names', [])
    whole: Array = columns.get('q', np.zeros(0))
    positions = {}
    for joint in joint_names:
        if f'q.{joint}' in columns:
            positions[joint] = columns[f'q.{joint}']
        elif joint in labels and whole.ndim == 2:
            positions[joint] = whole[:, labels.index(joint)]
    return positions


def no_header(path: Any, names: Sequence[str], example: str) -> None:
    """Raise InputError if the header is missing, or has no commas between the names."""
    for separator, words in SEPARATORS.items():
        if len(names) == 1 and separator in names[0]:
            raise InputError(f'{path}: columns separated by {words}; expected commas, '
                             f'and numbers with a point: {example}')
    # A header of numbers is a row.
    try:
        [float(name) for name in names]
    except ValueError:
        return
    raise InputError(f'{path}: no header line (the first line is numbers); expected '
                     f'{example}')


def distinct(path: Any, names: Sequence[str]) -> None:
    """Raise InputError for duplicate names of columns."""
    twice = sorted({name for name in names if name and names.count(name) > 1})
    if twice:
        raise InputError(f'{path}: several columns {twice}; expected each name once')
    if all(name in names for name in TIMES):
        raise InputError(f"{path}: columns 't' and 'time'; expected one of them")


def _read(path: Path) -> dict[str, Any]:
    """Return the columns or arrays of a recording in a file, by name."""
    unread: list[str] = []

    def is_column(name: str) -> bool:
        known = name in LABELS or bool(OURS.fullmatch(name))
        if not known:
            unread.append(name)
        return known
    try:
        if path.suffix != '.npz':
            return _csv(path)
        arrays = npz_arrays(path, is_column)
    except FileNotFoundError:
        raise InputError(f'no such file: {os.fspath(path)!r}; expected a CSV or npz '
                         'file, or a ROS 2 bag') from None
    except OSError as error:
        raise InputError(f'{path}: {error.strerror or error}; expected a readable '
                         'file') from None

    # Labels stay text, all else are numbers.
    distinct(path, list(arrays))
    columns: dict[str, Any] = dict.fromkeys(unread)  # without content, for messages
    for name, array in arrays.items():
        if name in LABELS:
            columns[name] = array.astype(str).ravel().tolist()
        else:
            columns[name] = real(array, f"{path}: '{name}'")
    return columns


def _csv(path: Path) -> dict[str, Any]:
    """Return the columns of a CSV file by name."""
    with path.open('rb') as binary:
        kind = kind_of_content(binary.read(LONGEST + 1))
    if not kind.startswith(('a CSV', 'text', 'an empty')):
        raise InputError(f'{path}: seems to be {kind}; expected a CSV file, an npz file '
                         'with this ending, or a ROS 2 bag')
    try:
        with path.open(encoding='utf-8-sig') as stream:
            header = [name.strip() for name in stream.readline().split(',')]
            no_header(path, header, 't,q.<joint>,...,tau.<joint>,...')
            # Comments and empty lines are no rows.
            lines = [line for line in stream if line.partition('#')[0].strip()]
            rows = np.zeros((0, len(header)))
            if lines:
                rows = np.loadtxt(lines, delimiter=',', ndmin=2)
    except ValueError as error:
        raise InputError(f'{path}: {error}; expected named columns of numbers') from None
    # Rows of unequal length are refused by loadtxt itself.
    if rows.shape[1] != len(header):
        raise InputError(f'{path}: {len(header)} names for {rows.shape[1]} columns; '
                         'expected one name per column')
    distinct(path, header)
    return dict(zip(header, rows.T, strict=True))


def _time(columns: Mapping[str, Any], path: Any) -> Array:
    """Return the times, (N,)."""
    # The first of the usual names for the time.
    name = next((name for name in TIMES if name in columns), None)
    if name is None:
        raise InputError(f'{path}: columns {sorted(columns)[:20]}; expected a column '
                         "'t'")
    t: Array = columns[name]
    if t.ndim != 1:
        raise InputError(f"{path}: '{name}': shape {t.shape}; expected (N,)")
    if len(t) < 3:
        raise InputError(f'{path}: {len(t)} rows; expected 3 or more')
    increasing(t, len(t), f'{path}: t')
    return t


def _required(columns: Mapping[str, Any], names: Sequence[str],
              joint_names: Sequence[str], order: list[str], path: Any) -> dict[str, Any]:
    """Return quantities of all joints, of which positions and torques must be there."""
    quantities: dict[str, Any] = {}
    for name in names:
        quantities[name] = _quantity(columns, name, joint_names, order, path)
        if quantities[name] is None and name in ('q', 'tau'):
            raise InputError(f"{path}: no '{name}'; expected a column for each joint, "
                             f"the first named '{name}.{joint_names[0]}' or '{name}1', "
                             f'found {listing(columns, 12)}')
    return quantities


def _quantity(columns: Mapping[str, Any], name: str, joint_names: Sequence[str],
              numbered: list[str], path: Any) -> Any:
    """Return a quantity of all joints, (N, n); None without a column of it."""
    for word in WORDS[name]:
        # One array of all joints.
        if word in columns and columns[word].ndim > 1:
            return _of_array(columns, word, joint_names, numbered, path)
        # Or one column per joint, named by the joint or numbered.
        joint_columns = _joint_columns(columns, word, joint_names, numbered, path)
        if joint_columns:
            return _stacked(columns, joint_columns, path)
    return None


def _joint_columns(columns: Mapping[str, Any], word: str, joint_names: Sequence[str],
                   numbered: list[str], path: Any) -> list[str]:
    """Return the name of each joint's column: `word.joint`, or `word1`; empty without any."""
    # Names of joints first; numbers where the file has none.
    by_name = [f'{word}.{joint}' for joint in joint_names]
    if not columns.keys().isdisjoint(by_name):
        return by_name
    is_numbered = re.compile(rf'{word}[1-9]\d*').fullmatch
    count = len(list(filter(is_numbered, columns)))
    if not count:
        return []
    places = _places(count, word, joint_names, numbered, path)
    return [f'{word}{place + 1}' for place in places]


def _stacked(columns: Mapping[str, Any], names: Sequence[str], path: Any) -> Array:
    """Return the columns with these names as one array, (N, n)."""
    lacking = [name for name in names if name not in columns]
    if lacking:
        raise InputError(f'{path}: no columns {lacking}; expected one per joint')
    # Each column has one number for each row.
    of_joints = []
    for name in names:
        column = columns[name]
        if column.ndim != 1:
            raise InputError(f"{path}: '{name}' of shape {column.shape}; expected arrays of "
                             'shape (N,)')
        of_joints.append(column)
    return np.column_stack(of_joints)


def _of_array(columns: Mapping[str, Any], word: str, joint_names: Sequence[str],
              numbered: list[str], path: Any) -> Array:
    """Return the joints' columns of an (N, n) array, by the names in the file if it has any."""
    values: Array = columns[word]
    if values.ndim != 2:
        raise InputError(f"{path}: '{word}': shape {values.shape}; expected (N, n): one "
                         'motion')

    # Without names in the file, columns are by number.
    labels = columns.get('joint_names')
    if labels is None:
        return values[:, _places(values.shape[1], word, joint_names, numbered, path)]
    if columns.get('speed_names', labels) != labels:
        raise InputError(f"{path}: speeds {columns['speed_names']}; expected those of "
                         'the joints')
    # By name, in the order of the joints.
    distinct(path, labels)
    lacking = [joint for joint in joint_names if joint not in labels]
    if lacking:
        raise InputError(f'{path}: joints {labels}; expected also {lacking}')
    if len(labels) != values.shape[1]:
        raise InputError(f"{path}: '{word}': {values.shape[1]} columns; expected "
                         f'{len(labels)}')
    return values[:, list(map(labels.index, joint_names))]


def _places(count: int, word: str, joint_names: Sequence[str], numbered: list[str],
            path: Any
            ) -> list[int]:
    """Return the column of each joint among numbered columns."""
    # Numbers count through the joints of the robot, or through those that are asked
    # for.
    among = [joint for joint in numbered if joint in joint_names]
    for order in (numbered, among):
        if len(order) == count:
            return list(map(order.index, joint_names))
    or_all = ''
    if len(numbered) > len(among):
        or_all = f', or for all {len(numbered)} of the robot'
    raise InputError(f"{path}: '{word}': {count} numbered columns; expected one for each of "
                     f"the joints {among}{or_all}, or columns named '{word}.<joint>'")
