"""Presliding friction along a recorded motion (P. Dahl, "A solid friction model", 1968)."""

from collections.abc import Sequence

from kane_dynamics._util.typing import Array
import numpy as np


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


def first_rows(t: Array, q: Array, u: Array, least: float) -> Array:
    """
    Return the first row of each motion that a recording joins to the one before, (motions,).

    Between two rows of one motion no joint moves farther than at twice its highest rate.
    Jumps below `least`, rad or m, do not count.
    """
    farthest = least + 2.0 * np.abs(u).max(axis=0) * np.diff(t)[:, None]
    jumps = (np.abs(np.diff(q, axis=0)) > farthest).any(axis=1)
    return np.concatenate([[0], np.flatnonzero(jumps) + 1])
