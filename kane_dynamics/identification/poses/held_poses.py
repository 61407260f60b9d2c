"""Held poses: configurations at rest with the efforts that hold them, of tables and recordings."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
import os
from pathlib import Path

from kane_dynamics._util.frozen import freeze
from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.errors import InputError
from kane_dynamics.identification.recordings.bag import is_bag
from kane_dynamics.identification.recordings.reader import (has_times, read_recording,
                                                            rows_without_times)
from kane_dynamics.identification.recordings.recording import real, Recording
from kane_dynamics.identification.recordings.signal_faults import interruptions
import numpy as np

HOLD = 0.4  # s: the shortest hold
WINDOW = 0.1  # s, over which rest is judged
STILL = 2e-3  # rad or m: a joint at rest moves less than this over the window
SETTLING, LEAVING = 0.25, 0.15  # of a hold, at its begin and end, where efforts change
BEFORE = 1.0  # s before a hold, whose motion is the approach
APPROACH = 5e-3  # rad or m: travel of a joint that approaches a pose
SHARE = 0.5  # of the rows: a recording whose holds have more is one of held poses
FEWEST = 4  # holds of such a recording


@dataclass(frozen=True, eq=False)
class HeldPoses:
    """
    Configurations at rest, with the efforts that hold them.

    Attributes
    ----------
    q : (k, n) array
        Positions, rad or m.
    effort : (k, n) array
        Reported efforts, N m or N, or in a unit of their own.
    approach : (k, n) array
        Direction from which each joint came, 1 or -1; 0 if it is not known.

    Raises
    ------
    InputError
        Shapes differ, or values are not finite.

    """

    q: Array
    effort: Array
    approach: Array

    def __post_init__(self) -> None:
        """Check shapes and numbers."""
        for name in ('q', 'effort', 'approach'):
            value = real(getattr(self, name), f'poses: {name}')
            freeze(self, name, value)
            if value.ndim != 2 or value.shape != np.shape(self.q):
                raise InputError(f'poses: {name}: shape {value.shape}; expected (k, n), '
                                 'one row a pose')
            if not np.isfinite(value).all():
                row = int(np.argwhere(~np.isfinite(value))[0, 0])
                raise InputError(f'poses: {name}: not finite in row {row + 1}; expected '
                                 'finite numbers')

    def __len__(self) -> int:
        """Return the number of poses."""
        return len(self.q)

    def rows(self, chosen: Flags) -> 'HeldPoses':
        """Return some of the poses."""
        return HeldPoses(self.q[chosen], self.effort[chosen], self.approach[chosen])


def held_poses(recording: Recording) -> HeldPoses:
    """
    Return the held poses of a recording: the stretches of 0.4 s or more without motion.

    Positions alone tell whether the arm moves. The begin and the end of each stretch are
    left out, and the rest averaged. The motion before a stretch is the approach.

    Raises
    ------
    InputError
        The arm is held nowhere, or the argument is no `Recording`.

    """
    if not isinstance(recording, Recording):
        raise InputError(f'recording: {recording!r}; expected a Recording')
    q = []
    effort = []
    approach = []
    for first, end in holds(recording):
        settled = first + int(SETTLING * (end - first))
        leaving = end - int(LEAVING * (end - first))
        q.append(recording.q[settled:leaving].mean(axis=0))
        effort.append(recording.tau[settled:leaving].mean(axis=0))
        approach.append(_approach(recording, first, q[-1], interruptions(recording)))
    if not q:
        raise InputError(f'recording: no stretch of {HOLD:g} s in which all joints rest; '
                         'expected an arm that is held in several poses')
    return HeldPoses(np.array(q), np.array(effort), np.array(approach))


def last_hold(recording: Recording, seconds: float) -> HeldPoses | None:
    """
    Return how the arm is held at the end of a recording; None if it moved in this time.

    Unlike in files, missing states are those of a busy computer: they end no hold.
    """
    stretches = _holds_between(recording, 0, len(recording))
    begin = recording.t[-1] - seconds
    if not stretches:
        return None
    first, end = stretches[-1]
    if end < len(recording) or recording.t[first] > begin:
        return None
    held = recording.rows(recording.t >= begin)
    q = held.q.mean(axis=0)
    return HeldPoses(q[None], held.tau.mean(axis=0)[None],
                     _approach(recording, first, q, ())[None])


def is_held(recording: Recording) -> bool:
    """Return whether a recording is one of held poses: mostly at rest, in several poses."""
    stretches = holds(recording)
    rows_at_rest = sum(end - first for first, end in stretches)
    return len(stretches) >= FEWEST and rows_at_rest > SHARE * len(recording)


def holds(recording: Recording) -> list[tuple[int, int]]:
    """Return first and end row of each stretch in which all joints rest."""
    after = interruptions(recording)
    stretches = []
    for first, end in pairwise([0, *(after + 1).tolist(), len(recording)]):
        stretches += _holds_between(recording, first, end)
    return stretches


def _holds_between(recording: Recording, first: int, end: int) -> list[tuple[int, int]]:
    """Return the holds of rows without an interruption."""
    t = recording.t[first:end]
    q = recording.q[first:end]
    # A row is at rest if no joint moves over the window around it.
    before = np.searchsorted(t, t - 0.5 * WINDOW)
    behind = np.searchsorted(t, t + 0.5 * WINDOW, side='right') - 1
    rest = (np.abs(q[behind] - q[before]) < STILL).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], rest, [False]])))
    stretches = []
    for begin, stop in edges.reshape(-1, 2):
        # Slow motion all the time is no hold.
        travel = np.abs(q[stop - 1] - q[begin]).max()
        if t[stop - 1] - t[begin] >= HOLD and travel < APPROACH:
            stretches.append((first + int(begin), first + int(stop)))
    return stretches


def _approach(recording: Recording, first: int, q: Array,
              pauses: Iterable[int]) -> Array:
    """Return the direction in which each joint came to a hold, (n,); 0 if not known."""
    begin = int(np.searchsorted(recording.t, recording.t[first] - BEFORE))
    begin = max([begin, *(int(row) + 1 for row in pauses if row < first)])
    travel = q - recording.q[begin]
    return np.where(np.abs(travel) > APPROACH, np.sign(travel), 0.0)


def read_poses(path: str | os.PathLike[str], joint_names: Sequence[str],
               topic: str | None = None, *, numbered: Sequence[str] | None = None
               ) -> HeldPoses:
    """
    Return the held poses of a table, of a recording, or of a ROS 2 bag.

    Parameters
    ----------
    path : path
        A table, CSV or npz, has one row a pose, with columns `q` and `tau` as of
        `read_recording`, optionally `approach`, and no times. A file with times, or a
        bag, is a recording: its stretches at rest are the poses.
    joint_names, topic, numbered
        As of `read_recording`.

    Raises
    ------
    InputError
        A column is missing or not numeric, or a recording has no stretch at rest.

    """
    if is_bag(Path(path)) or has_times(path):
        return held_poses(read_recording(path, joint_names, topic, numbered=numbered))
    if topic is not None:
        raise InputError(f"topic: '{topic}' for the table '{path}'; expected it for a bag "
                         'only')
    return HeldPoses(*rows_without_times(path, joint_names, numbered))
