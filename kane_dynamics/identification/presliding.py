"""Presliding friction along a recorded motion (P. Dahl, "A solid friction model", 1968)."""

from collections.abc import Sequence

from kane_dynamics._util.typing import Array
import numpy as np

ROUNDING = 1e-9  # of the largest change of a position: smaller ones are none


def dahl_friction(q: Array, lengths: Sequence[float] | Array,
                  first: Array | None = None) -> Array:
    """
    Return the friction of coefficient 1 by Dahl's law along positions, (N, lengths, n).

    It is exact between rows, in which a joint moves one way: z approaches the sign of the
    motion over the length, whatever the speed. It is `first`, (lengths, n), in the first
    row, 0 by default.
    """
    scale = np.asarray(lengths, dtype=np.float64)[:, None]
    friction = np.zeros((len(q), len(scale), q.shape[1]))
    if first is not None:
        friction[0] = first
    for k, step in enumerate(np.diff(q, axis=0), start=1):
        direction = np.sign(step)
        decay = np.exp(-np.abs(step) / scale)
        friction[k] = direction + (friction[k - 1] - direction) * decay
    return friction


def friction_in_motion(u: Array, udot: Array, lengths: Sequence[float] | Array) -> Array:
    """
    Return the friction of coefficient 1 of joints whose earlier motion is unknown, (lengths, n).

    A joint that accelerates has slid by u^2 / (2 udot) since it last stood still, and one
    that does not by more than any length. Its friction at standstill is unknown, counts as
    0, and is forgotten over the length. `u` and `udot`, (n,), are rates and accelerations.
    """
    slid = np.full(len(u), np.inf)
    accelerates = u * udot > 0.0
    slid[accelerates] = u[accelerates]**2 / (2.0 * np.abs(udot[accelerates]))
    scale = np.asarray(lengths, dtype=np.float64)[:, None]
    return np.asarray(np.sign(u) * (1.0 - np.exp(-slid / scale)))


def first_rows(t: Array, q: Array, least: float) -> Array:
    """
    Return the first row of each motion that a recording joins to the one before, (motions,).

    Between two rows of one motion no joint moves farther than at twice its highest speed,
    beside a step of its encoder. Jumps below `least`, rad or m, do not count.
    """
    steps = np.abs(np.diff(q, axis=0))
    dt = np.diff(t)[:, None]
    farthest = least + _resolution(steps) + 2.0 * _highest_speed(steps / dt) * dt
    jumps = (steps > farthest).any(axis=1)
    return np.concatenate([[0], np.flatnonzero(jumps) + 1])


def _highest_speed(speeds: Array) -> Array:
    """Return the highest speed of each joint between rows, (n,), single jumps left out."""
    if len(speeds) < 3:
        return np.asarray(speeds.max(axis=0))
    # The median of three neighbors leaves out one that is far from both others.
    medians = np.median([speeds[:-2], speeds[1:-1], speeds[2:]], axis=0)
    return np.asarray(medians.max(axis=0))


def _resolution(steps: Array) -> Array:
    """Return the least change of positions, but for rounding errors and outliers, (n,)."""
    resolution = np.zeros(steps.shape[1])
    for j, of_joint in enumerate(steps.T):
        changes = of_joint[of_joint > ROUNDING * of_joint.max(initial=0.0)]
        if len(changes):
            resolution[j] = np.quantile(changes, 0.05)
    return resolution
