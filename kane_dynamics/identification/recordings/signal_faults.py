"""Faults of signals: interruptions, outliers, constant or idle efforts, beyond limits."""

from dataclasses import replace
from itertools import pairwise

from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.identification.recordings.recording import Recording
import numpy as np
from numpy.typing import NDArray

PAUSE_STEPS, PAUSE = 10.0, 0.15  # median steps of time, and s, of the shortest interruption
NEIGHBORS = 2  # rows on either side, of whose median an outlier differs
OUTLIER_RANGE = 0.3  # of the usual range of a signal
OUTLIER_NOISE = 8.0  # of the 99.5th percentile of such differences
MOST_OUTLIERS = 0.005  # fraction of rows; more are no outliers
USUAL = 0.002, 0.998  # quantiles of the usual range
FROZEN, FROZEN_ROWS = 0.25, 8  # s, and rows, of the shortest constant stretch
FROZEN_RUNS = 10.0  # times the 95th percentile of the lengths of other constant stretches
FROZEN_MOTION = 0.02  # rad or m, by which the joint moves meanwhile
IDLE = 0.05  # of the range of efforts: largest range of the middle half of idle ones
IDLE_MOTION = 0.02  # rad/s or m/s, of a joint that moves
IDLE_ROWS, IDLE_SHARE = 100, 0.1  # least rows in motion, and share in each direction
BEYOND = 1.5  # effort limits that a tenth of the efforts exceeds


def interruptions(recording: Recording) -> NDArray[np.intp]:
    """Return the rows after which time is missing, (k,)."""
    steps = np.diff(recording.t)
    return np.flatnonzero(steps > max(PAUSE_STEPS * float(np.median(steps)), PAUSE))


def longest_stretch(recording: Recording) -> Recording:
    """Return the longest stretch of rows without an interruption."""
    after = interruptions(recording)
    if not len(after):
        return recording
    ends = [0, *(after + 1).tolist(), len(recording)]
    first, last = max(pairwise(ends), key=lambda stretch: stretch[1] - stretch[0])
    return recording.rows(slice(first, last))


def outliers(values: Array) -> tuple[Flags, Array]:
    """
    Return where single rows are far from their neighbors, (N, n), and the neighbors' medians.

    The median of a signal over a few rows follows every motion; its difference is noise,
    or an outlier if it is large relative to the range of the whole signal and to the
    noise.
    """
    if len(values) < 4 * NEIGHBORS:
        return np.zeros(values.shape, dtype=bool), values
    # The median of the neighbours of each row, itself included.
    padded = np.pad(values, ((NEIGHBORS, NEIGHBORS), (0, 0)), mode='reflect')
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * NEIGHBORS + 1, axis=0)
    medians = np.median(windows, axis=2)
    differences = np.abs(values - medians)

    # Far by the usual range of the signal, and by its usual distance from the median.
    low, high = np.quantile(values, USUAL, axis=0)
    bound = np.maximum(OUTLIER_RANGE * (high - low),
                       OUTLIER_NOISE * np.quantile(differences, 0.995, axis=0))
    flags = differences > bound
    # A signal in which many rows are far is noisy, not faulty.
    flags[:, flags.mean(axis=0) > MOST_OUTLIERS] = False
    return flags, medians


def without_outliers(recording: Recording) -> tuple[Recording, Flags]:
    """Return the recording with medians in place of outliers, and where they were."""
    flags, medians = outliers(recording.tau)
    return replace(recording, tau=np.where(flags, medians, recording.tau)), flags


def frozen_rows(recording: Recording) -> Flags:
    """
    Return where efforts stay the same while the joint moves, (N, n).

    Efforts of a coarse resolution are equal over some rows everywhere; the stretch must
    be much longer than the others.
    """
    flags = np.zeros(recording.tau.shape, dtype=bool)
    for j, tau in enumerate(recording.tau.T):
        # Runs of equal values; quantised signals have many short ones.
        changes = np.flatnonzero(np.diff(tau) != 0.0) + 1
        ends = np.concatenate([[0], changes, [len(tau)]])
        lengths = np.diff(ends)
        longest = int(np.argmax(lengths))
        stretch = slice(int(ends[longest]), int(ends[longest + 1]))
        usual = np.quantile(np.delete(lengths, longest),
                            0.95) if len(lengths) > 1 else 0.0
        duration = recording.t[stretch.stop - 1] - recording.t[stretch.start]
        # A frozen signal is long in time and rows, and its joint moves meanwhile.
        if (duration >= FROZEN and lengths[longest] >= max(FROZEN_ROWS,
                                                           FROZEN_RUNS * usual)
                and np.ptp(recording.q[stretch, j]) > FROZEN_MOTION):
            flags[stretch, j] = True
    return flags


def idle_efforts(recording: Recording) -> Flags:
    """
    Return which joints' efforts stay near one value while the joint moves both ways, (n,).

    Friction changes its sign with the motion, so that efforts of a moving joint do not.
    A channel that nothing is connected to has little but crosstalk of other joints.
    """
    flags = np.zeros(recording.tau.shape[1], dtype=bool)
    for j, tau in enumerate(recording.tau.T):
        u = recording.u[:, j]
        forward = u > IDLE_MOTION
        moving = forward | (u < -IDLE_MOTION)
        share = float(np.mean(forward[moving])) if moving.any() else 0.0
        if moving.sum() < IDLE_ROWS or not IDLE_SHARE < share < 1.0 - IDLE_SHARE:
            continue
        low, high = np.quantile(tau[moving], [0.25, 0.75])
        flags[j] = high - low < IDLE * np.ptp(tau)
    return flags


def beyond_limits(recording: Recording, limits: Array) -> Flags:
    """Return which joints' efforts are far beyond their limits for long, (n,)."""
    usual = np.quantile(np.abs(recording.tau), 0.9, axis=0)
    beyond: Flags = usual > BEYOND * limits
    return beyond
