"""Times at which a motion rests or all its joints reverse at once."""

from kane_dynamics._util.typing import Array
from kane_dynamics.motion.motion import Motion
import numpy as np

AT_REST = 1e-9  # speed relative to the mean one of the motion
INSIDE = np.arange(8) / 8  # places of a segment between which all joints may reverse at once
REVERSAL = 1e-4  # least speed in a reversal of all joints, relative to that around it
BISECTIONS = 60


def rests(motion: Motion) -> Array:
    """
    Return the times of both ends of a motion and of its rests between them.

    It rests at points with zero speed, and where all joints reverse at once between points. There
    the direction of the friction changes, too, which a grid could not resolve.
    """
    knots = motion.times
    if len(knots) < 2:
        return knots
    u = np.zeros(((len(knots) - 1) * len(INSIDE) + 1, motion.n))
    u[:-1] = motion.velocities_inside(INSIDE).reshape(-1, motion.n)
    speed = np.sqrt(np.einsum('ij,ij->i', u, u))
    points = speed[::len(INSIDE)]
    still = points <= AT_REST * np.abs(motion.positions[1:] - motion.positions[:-1]).sum() / (
        knots[-1] - knots[0])
    still[[0, -1]] = True
    speed[::len(INSIDE)][still] = 0.0
    least = np.minimum(speed[:-2], speed[2:])
    k = 1 + np.flatnonzero((speed[1:-1] <= least) & (speed[1:-1] > 0.0) & (least > 0.0)
                           & (np.einsum('ij,ij->i', u[:-2], u[2:]) < 0.0))
    if not k.size:
        return np.asarray(knots[still])
    # The speed between two samples is at least that along the chord between their velocities, less
    # the sagitta of the curve: an eighth of the second difference where u is quadratic in t. With
    # twice that, for knots between, most turns are no reversals and need no bisection.
    sagitta = 0.25 * np.linalg.norm(u[k - 1] - 2.0 * u[k] + u[k + 1], axis=1)
    nearest = np.minimum(_nearest(u[k - 1], u[k]), _nearest(u[k], u[k + 1]))
    k = k[nearest - sagitta <= REVERSAL * least[k - 1]]
    if not k.size:
        return np.asarray(knots[still])
    t = np.append((knots[:-1, None] + np.diff(knots)[:, None] * INSIDE).ravel(), knots[-1])
    low, high = t[k - 1], t[k + 1]
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        _, rates, slopes = motion.sample(middle)
        slower = np.einsum('ij,ij->i', rates, slopes) < 0.0
        low, high = np.where(slower, middle, low), np.where(slower, high, middle)
    turned = np.linalg.norm(motion.sample(low)[1], axis=1) <= REVERSAL * least[k - 1]
    return np.unique(np.concatenate([knots[still], low[turned]]))


def _nearest(begin: Array, end: Array) -> Array:
    """Return the distances of the chords between two rows from zero, (K,)."""
    chord = end - begin
    square = np.einsum('ij,ij->i', chord, chord)
    along = -np.einsum('ij,ij->i', begin, chord)
    place = np.clip(along / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    nearest: Array = np.linalg.norm(begin + place[:, None] * chord, axis=1)
    return nearest
