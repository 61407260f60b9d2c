"""Sample a motion, with refinement where a limit may be exceeded between samples."""

import math

from kane_dynamics._util.checks import positive_time
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.model.elastic_model import require_rigid_joints
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.robot import Robot
import numpy as np

STEP = 1e-3  # s between samples
MOST_SAMPLES = 200_000
ROUNDING = 1e-9  # relative tolerance on limits, for motions that were scaled to one
SUBDIVISIONS, ROUNDS = 32, 3  # of an interval per refinement, and refinements
SAME_TIME = 1e-12  # relative to the duration: two samples at one time
NONE = np.zeros(0)


def sampled(robot: Robot, motion: Motion, step: float, additional: Array = NONE
            ) -> tuple[Array, Array, Array, Array]:
    """
    Return t (N,) and q, u, udot (N, n) of a motion, with both sides of its points.

    Parameters
    ----------
    robot : Robot
        The robot whose joints the motion must have.
    motion : Motion
        The motion.
    step : float
        Largest time between samples, s.
    additional : (k,) array
        Additional times, s.

    Raises
    ------
    InputError
        If the motion has other joints, or there are too many samples. With chosen speeds
        or constraints the joints are not checked here.

    """
    require_angles(robot.model, 'motion')
    require_rigid_joints(robot.model)
    if motion.joint_names != robot.joint_names and robot.equations.in_joint_rates:
        raise InputError(f'motion: joints {list(motion.joint_names)}; expected '
                         f'{list(robot.joint_names)}')
    t = sample_times(motion.times, step, additional)
    q, u, udot = motion.sample(t)
    # At the ends the motion has an acceleration, and outside none: both are sampled.
    # The motion rests before and after.
    at_rest = np.zeros((1, motion.n))
    t = np.concatenate([motion.times[:1], t, motion.times[-1:]])
    q = np.concatenate([motion.positions[:1], q, motion.positions[-1:]])
    u = np.concatenate([at_rest, u, at_rest])
    udot = np.concatenate([at_rest, udot, at_rest])
    return t, q, u, udot


def sample_times(points: Array, step: float, additional: Array = NONE) -> Array:
    """
    Return times of samples of a motion, with both sides of its points, (N,), s.

    Parameters
    ----------
    points : (K,) array
        Times of the points, s.
    step, additional
        As of `sampled`.

    """
    step = positive_time(step, 'step')
    starts, h = points[:-1], np.diff(points)
    intervals = np.ceil(h / step)
    if intervals.sum() > MOST_SAMPLES:
        raise InputError(f'step: {step:g} s, {intervals.sum():.3g} samples of a motion '
                         f'of {points[-1]:g} s; expected a larger step, at most '
                         f'{MOST_SAMPLES} samples')
    # Each segment has whole intervals of at most a step, and samples at both of its
    # ends.
    counts = np.maximum(intervals, 1.0).astype(int) + 1
    segment = np.repeat(np.arange(len(h)), counts)
    first = np.cumsum(counts) - counts
    inside = np.arange(len(segment)) - np.repeat(first, counts)
    t = starts[segment] + h[segment] * (inside / (counts[segment] - 1))
    # Points are sampled on both sides: a derivative may differ between segments.
    last = inside == counts[segment] - 1
    t[last] = np.nextafter(points[1:], -math.inf)
    return np.sort(np.concatenate([t, additional]))


def times_to_refine(t: Array, shares: Array) -> Array:
    """
    Return times between samples at which a limit may be exceeded.

    All samples satisfy it. Between two samples at a distance h, a smooth function
    exceeds both by at most h^2/8 of its second derivative, which is estimated as twice
    the change of neighboring slopes.

    Parameters
    ----------
    t : (N,) array
        Times of the samples, s; the time of a jump occurs twice.
    shares : (N, m) array
        Values relative to their limits.

    """
    intervals = np.flatnonzero(np.diff(t) > SAME_TIME * t[-1])
    h = (t[intervals + 1] - t[intervals])[:, None]
    if len(h) < 2:
        return NONE
    with np.errstate(invalid='ignore'):  # infinite or zero limits
        begin, end = shares[intervals], shares[intervals + 1]
        slope = (end - begin) / h
        bend = np.abs(np.diff(slope, axis=0)) / (h[1:] + h[:-1])
        # Of the bends at both ends of an interval the larger one.
        bend = np.maximum(np.vstack([bend[:1], bend]), np.vstack([bend, bend[-1:]]))
        top = np.maximum(begin, end)
        peak = top + 0.5 * h**2 * bend
    doubtful = (top <= 1.0 + ROUNDING) & (peak > 1.0 + 0.1 * ROUNDING)
    inner = np.arange(1, SUBDIVISIONS) / SUBDIVISIONS
    times = t[intervals, None] + h * inner
    return np.asarray(times[doubtful.any(axis=1)].ravel())
