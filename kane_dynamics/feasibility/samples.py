"""Where a motion is looked at: at samples, and between them where a limit may be passed."""

import math

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.robot import Robot
import numpy as np

STEP = 1e-3  # s between samples
MOST_SAMPLES = 200_000
ROUNDING = 1e-9  # relative: a motion that was scaled to a limit is on it, not beyond it
PARTS, ROUNDS = 32, 3  # into which an interval in doubt is parted, and how often
SAME = 1e-12  # of the duration: both sides of one time
NONE = np.zeros(0)


def sampled(robot: Robot, motion: Motion, step: float, more: Array = NONE
            ) -> tuple[Array, Array, Array, Array]:
    """
    Return t (N,) and q, u, udot (N, n) of a motion, both sides of its points among them.

    Parameters
    ----------
    robot : Robot
        Whose joints the motion must be of.
    motion : Motion
        What to sample.
    step : float
        Largest time between samples, s.
    more : (k,) array
        Further times to look at, s.

    Raises
    ------
    InputError
        Not a plain robot, other joints, or too many samples: names what it is.

    """
    if isinstance(robot.equations, ConstrainedEquations):
        raise InputError('the robot has chosen speeds or constraints; feasibility takes one with '
                         'joint rates for speeds and none')
    if motion.joint_names != robot.joint_names:
        raise InputError(f'the motion is of the joints {list(motion.joint_names)}; expected '
                         f'{list(robot.joint_names)}')
    if not 0.0 < step < math.inf:
        raise InputError(f'step is {step} s; expected a positive, finite number')
    starts, h = motion.times[:-1], np.diff(motion.times)
    intervals = np.ceil(h / step)
    if intervals.sum() > MOST_SAMPLES:
        raise InputError(f'step is {step:g} s: {intervals.sum():.3g} samples of a motion of '
                         f'{motion.duration:g} s; valid: up to {MOST_SAMPLES}, by a larger step')
    counts = np.maximum(intervals, 1.0).astype(int) + 1
    segment = np.repeat(np.arange(len(h)), counts)
    inside = np.arange(len(segment)) - np.repeat(np.cumsum(counts) - counts, counts)
    t = starts[segment] + h[segment] * (inside / (counts[segment] - 1))
    # The last sample of a segment must not be the first of the next: udot may differ.
    last = inside == counts[segment] - 1
    t[last] = np.nextafter(motion.times[1:], -math.inf)
    t = np.sort(np.concatenate([t, more]))
    q, u, udot = motion.sample(t)
    rest = np.zeros((1, motion.n))
    return (np.concatenate([motion.times[:1], t, motion.times[-1:]]),
            np.concatenate([motion.positions[:1], q, motion.positions[-1:]]),
            np.concatenate([rest, u, rest]), np.concatenate([rest, udot, rest]))


def in_doubt(t: Array, shares: Array) -> Array:
    """
    Return times between samples at which a limit may be passed that all samples keep.

    Between two samples h apart, a smooth function rises above both by h^2/8 of its second
    derivative; that of neighbouring slopes, twice, is taken for it.

    Parameters
    ----------
    t : (N,) array
        Times of the samples, s; those of a jump stand there twice.
    shares : (N, m) array
        Of limits, which are at 1.

    """
    intervals = np.flatnonzero(np.diff(t) > SAME * t[-1])
    h = (t[intervals + 1] - t[intervals])[:, None]
    if len(h) < 2:
        return NONE
    with np.errstate(invalid='ignore'):  # a share of no limit, of a limit of 0
        before, after = shares[intervals], shares[intervals + 1]
        slope = (after - before) / h
        bend = np.abs(np.diff(slope, axis=0)) / (h[1:] + h[:-1])
        bend = np.maximum(np.vstack([bend[:1], bend]), np.vstack([bend, bend[-1:]]))
        top = np.maximum(before, after)
        doubtful = ((top <= 1.0 + ROUNDING)
                    & (top + 0.5 * h**2 * bend > 1.0 + 0.1 * ROUNDING)).any(axis=1)
    inner = np.arange(1, PARTS) / PARTS
    return np.asarray((t[intervals, None] + h * inner)[doubtful].ravel())
