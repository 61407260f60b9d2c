"""Recordings of an arm in motion: read from CSV or npz, and filtered."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import os
from pathlib import Path
from typing import Any
import zipfile

from kane_dynamics.errors import InputError
from kane_dynamics.identification.bag import is_bag, read_bag
from kane_dynamics.identification.solvers import scientific
from kane_dynamics.model import Array
import numpy as np

# What a column may be called: `<name>.<joint>`, or `<name><number>` counted from the base.
NAMES = {'q': ('q',), 'u': ('u', 'v'), 'udot': ('udot', 'a'), 'tau': ('tau',)}
ORDER = 4  # of the Butterworth filter, before it runs both ways


@dataclass(frozen=True, eq=False)
class Recording:
    """
    Joint states and torques over time.

    Attributes
    ----------
    t : (N,) array
        s, increasing.
    q, u, udot : (N, n) arrays
        Positions, speeds and accelerations; rad or m, s.
    tau : (N, n) array
        Measured torques, N m or N.

    Raises
    ------
    InputError
        The shapes differ, a number is not finite, or the time does not increase.

    """

    t: Array
    q: Array
    u: Array
    udot: Array
    tau: Array

    def __post_init__(self) -> None:
        """Check that the parts fit together."""
        for name in NAMES:
            value = getattr(self, name)
            if value.ndim != 2 or value.shape != self.tau.shape or len(value) != len(self.t):
                raise InputError(f'recording: {name} has shape {value.shape}; expected '
                                 f'({len(self.t)}, {self.tau.shape[-1]})')
            if not np.isfinite(value).all():
                row = int(np.argwhere(~np.isfinite(value))[0, 0])
                raise InputError(f'recording: {name} is not finite in row {row + 1}')
        _check_time(self.t, 'recording')

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.t)

    def rows(self, chosen: slice) -> 'Recording':
        """Return some of the rows."""
        return Recording(*(getattr(self, name)[chosen] for name in ('t', *NAMES)))

    def filtered(self, cutoff: float) -> 'Recording':
        """
        Return positions and torques low-passed without delay, with the rates of the former.

        A Butterworth filter of order 4 runs forth and back over q and tau; u and udot become
        central differences of the filtered q. Rows must be evenly spaced.

        Parameters
        ----------
        cutoff : float
            Hz, below half the sampling rate: several times the fastest motion.

        Raises
        ------
        InputError
            The cutoff is out of range, the rows are too few or their times uneven.

        """
        step = np.diff(self.t)
        mean = float(step.mean())
        if np.abs(step - mean).max() > 0.02 * mean:
            raise InputError(f'recording: steps of time lie between {step.min():g} and '
                             f'{step.max():g} s; a filter needs them even within 2 %')
        if not 0.0 < cutoff < 0.5 / mean:
            raise InputError(f'cutoff is {cutoff:g} Hz; valid: above 0, below half the sampling '
                             f'rate, {0.5 / mean:g} Hz')
        signal = scientific('scipy.signal')
        sections = signal.butter(ORDER, cutoff, output='sos', fs=1.0 / mean)
        if len(self) <= 6 * ORDER:
            raise InputError(f'recording: {len(self)} rows; a filter needs more than {6 * ORDER}')
        q, tau = (signal.sosfiltfilt(sections, x, axis=0) for x in (self.q, self.tau))
        u = np.gradient(q, mean, axis=0)
        return replace(self, q=q, u=u, udot=np.gradient(u, mean, axis=0), tau=tau)


def read_recording(path: str | os.PathLike[str], joint_names: Sequence[str],
                   topic: str | None = None) -> Recording:
    """
    Return the recording in a CSV file with a header, in an npz file, or in a ROS 2 bag.

    Columns (in npz: arrays) are `t`, and for each joint `q`, `u` or `v`, `udot` or `a`, and
    `tau`, either as `q.<joint>` or numbered from the base as `q1`; an npz may also hold (N, n)
    arrays `q` and so on. Speeds and accelerations that are missing are central differences. Of a
    bag (MCAP or SQLite) the joint states are read, on `topic` if it has them on several.

    Raises
    ------
    InputError
        Names the file and the column that is missing or not numeric.

    """
    file = Path(path)
    columns = read_bag(file, joint_names, topic) if is_bag(file) else _columns(file)
    if 't' not in columns:
        raise InputError(f"{path}: has no column 't'; it has {sorted(columns)[:20]}")
    found = {name: _quantity(columns, name, joint_names, path) for name in NAMES}
    for name in ('q', 'tau'):
        if found[name] is None:
            raise InputError(f"{path}: has no '{name}' of the joints; expected "
                             f"'{name}.{joint_names[0]}' or '{name}1', and so on")
    t: Array = columns['t']
    if t.ndim != 1 or len(t) < 3:
        raise InputError(f'{path}: has {t.size} rows; expected 3 or more')
    _check_time(t, path)
    for name, source in (('u', 'q'), ('udot', 'u')):
        if found[name] is None:
            found[name] = np.gradient(found[source], t, axis=0)
    try:
        return Recording(t, **found)
    except InputError as error:
        raise InputError(f'{path}: {error}') from None


def _check_time(t: Array, what: Any) -> None:
    """Raise InputError if time does not increase from row to row."""
    rises = np.diff(t) > 0.0
    if not rises.all():
        raise InputError(f'{what}: t does not increase at row {int(np.argmin(rises)) + 2}')


def _columns(path: Path) -> dict[str, Any]:
    """Return the named columns or arrays of a file."""
    try:
        if path.suffix == '.npz':
            with np.load(path, allow_pickle=False) as data:
                return {name: np.asarray(data[name], dtype=float) for name in data.files}
        with path.open(encoding='utf-8-sig') as stream:
            header = [name.strip() for name in stream.readline().split(',')]
            rows = np.loadtxt(stream, delimiter=',', ndmin=2)
    except OSError as error:
        raise InputError(f'{path}: {error.strerror or error}') from None
    except (ValueError, zipfile.BadZipFile) as error:
        raise InputError(f'{path}: {error}; expected named columns of numbers') from None
    if rows.shape[1] != len(header):
        raise InputError(f'{path}: {len(header)} names stand above {rows.shape[1]} columns')
    return dict(zip(header, rows.T, strict=True))


def _quantity(columns: dict[str, Any], name: str, joint_names: Sequence[str], path: Any) -> Any:
    """Return a quantity of all joints, (N, n); None if no column is of it."""
    for word in NAMES[name]:
        if word in columns and columns[word].ndim == 2:
            return columns[word]
        for wanted in ([f'{word}.{joint}' for joint in joint_names],
                       [f'{word}{k + 1}' for k in range(len(joint_names))]):
            lacking = [column for column in wanted if column not in columns]
            if not lacking:
                return np.column_stack([columns[column] for column in wanted])
            if len(lacking) < len(wanted):
                raise InputError(f'{path}: has no columns {lacking}')
    return None
