"""Presliding friction along a recorded motion (P. Dahl, "A solid friction model", 1968)."""

from collections.abc import Sequence

from kane_dynamics._util.typing import Array
import numpy as np


def dahl_friction(q: Array, lengths: Sequence[float] | Array) -> Array:
    """
    Return the friction of coefficient 1 by Dahl's law along positions, (N, lengths, n).

    It is exact between rows, in which a joint moves one way: z approaches the sign of the
    motion over the length, whatever the speed. It is 0 in the first row.
    """
    scale = np.asarray(lengths, dtype=np.float64)[:, None]
    friction = np.zeros((len(q), len(scale), q.shape[1]))
    for k, step in enumerate(np.diff(q, axis=0), start=1):
        direction = np.sign(step)
        decay = np.exp(-np.abs(step) / scale)
        friction[k] = direction + (friction[k - 1] - direction) * decay
    return friction
