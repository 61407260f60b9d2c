"""Times at which a motion rests or all its joints reverse at once."""

from functools import cache

from kane_dynamics._util.typing import Array, Matrix, Scalar
from kane_dynamics.motion.motion import Motion
from kane_dynamics.native.runtime.kernel import batch_kernel, Kernel
import numpy as np

AT_REST = 1e-9  # speed relative to the mean one of the motion
INSIDE = np.arange(8) / 8  # of a segment: between these, all joints may reverse
REVERSAL = 1e-4  # least speed in a reversal of all joints, relative to that around it
BISECTIONS = 60


def rests(motion: Motion) -> Array:
    """
    Return the times of both ends of a motion and of its rests between them.

    It rests at points with zero speed, and where all joints reverse at once between
    points. There the direction of the friction changes, too, which a grid could not
    resolve.
    """
    knots = motion.times
    if len(knots) < 2:
        return knots

    # Velocities and speeds at the points and at some places of each segment.
    n = motion.n
    samples = np.zeros(((len(knots) - 1) * len(INSIDE) + 1, n + 1))
    by_segment = samples[:-1].reshape(-1, len(INSIDE), n + 1)
    coefficients = np.ascontiguousarray(motion.coefficients)
    kernel(n).run([coefficients, knots, knots[1:]], by_segment, len(by_segment))
    u = samples[:, :n]
    speed = samples[:, n]
    speed_at_knots = speed[::len(INSIDE)]
    distance = abs(motion.positions[1:] - motion.positions[:-1]).sum()
    still = speed_at_knots <= AT_REST * distance / (knots[-1] - knots[0])
    still[[0, -1]] = True
    speed[::len(INSIDE)][still] = 0.0

    # Samples k with the least speed around, between which the velocity changes its
    # direction.
    turns_back = np.einsum('ij,ij->i', u[:-2], u[2:]) < 0.0
    if not turns_back.any():
        return np.asarray(knots[still])
    slower_neighbor = np.minimum(speed[:-2], speed[2:])
    inner_speed = speed[1:-1]
    moves = (inner_speed > 0.0) & (slower_neighbor > 0.0)
    is_least = moves & (inner_speed <= slower_neighbor)
    k = 1 + np.flatnonzero(is_least & turns_back)
    if not k.size:
        return np.asarray(knots[still])

    # The speed between two samples is at least that along the chord between their
    # velocities, less the sagitta of the curve: an eighth of the second difference where
    # u is quadratic in t. With twice that, for knots between, most turns are no
    # reversals and need no bisection.
    sagitta = 0.25 * np.linalg.norm(u[k - 1] - 2.0 * u[k] + u[k + 1], axis=1)
    chords = np.concatenate([k - 1, k])
    least_on_chords = _nearest(u[chords], u[chords + 1]).reshape(2, -1).min(axis=0)
    k = k[least_on_chords - sagitta <= REVERSAL * slower_neighbor[k - 1]]
    if not k.size:
        return np.asarray(knots[still])

    # Bisect for the time of least speed, where u . udot changes its sign.
    samples_of_segments = knots[:-1, None] + np.diff(knots)[:, None] * INSIDE
    t = np.append(samples_of_segments.ravel(), knots[-1])
    low = t[k - 1]
    high = t[k + 1]
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        _, rates, accelerations = motion.sample(middle)
        slows_down = np.einsum('ij,ij->i', rates, accelerations) < 0.0
        low = np.where(slows_down, middle, low)
        high = np.where(slows_down, high, middle)
    least_speed = np.linalg.norm(motion.sample(low)[1], axis=1)
    reverses = least_speed <= REVERSAL * slower_neighbor[k - 1]
    return np.unique(np.concatenate([knots[still], low[reverses]]))


@cache
def kernel(n: int) -> Kernel:
    """Return the kernel of the velocities and speeds inside a segment, (8, n + 1)."""
    def velocities(coefficients: Matrix, begin: Scalar, end: Scalar) -> Matrix:
        rate = 1.0 / (end[()] - begin[()])
        rows = []
        for x in INSIDE.tolist():
            # The derivative of the quintic by Horner's rule, at places of the segment
            # from 0 to 1.
            u = 5.0 * coefficients[5]
            for k in (4, 3, 2, 1):
                u = k * coefficients[k] + x * u
            speed = rate * np.sqrt(u @ u)
            rows.append([*(rate * u), speed])
        return np.array(rows)
    return batch_kernel('velocities_inside', velocities, [
        ('coefficients', (6, n)), ('begin', ()), ('end', ())], (len(INSIDE), n + 1))


def _nearest(begin: Array, end: Array) -> Array:
    """Return the distances of the chords between two rows from zero, (K,)."""
    chord = end - begin
    square = np.einsum('ij,ij->i', chord, chord)
    along = -np.einsum('ij,ij->i', begin, chord)
    # A chord between equal rows has no length; its distance is that of the row.
    fraction = np.clip(along / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    distance: Array = np.linalg.norm(begin + fraction[:, None] * chord, axis=1)
    return distance
