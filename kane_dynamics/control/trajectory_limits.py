"""Compare a trajectory with the limits of the joints, at its points and between them."""

from collections.abc import Sequence

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.motion.controller_points import ControllerPoints
from kane_dynamics.robot.parameters import JointLimits
import numpy as np

ROUNDING = 1e-9  # relative tolerance on limits, for motions that were scaled to one
SAMPLES = np.linspace(0.0, 1.0, 33)  # of a segment that may exceed a limit


def check_motion(points: ControllerPoints, limits: JointLimits, names: Sequence[str],
                 given: Array) -> None:
    """
    Raise InputError if a motion exceeds a limit of position or velocity.

    The control points of a segment's Bernstein polynomial bound its position, their
    differences its velocity. Only segments whose bounds exceed a limit are sampled, at
    `SAMPLES`.

    Parameters
    ----------
    points : ControllerPoints
        The motion.
    limits : JointLimits
        Of the same joints.
    names : sequence of str
        Names of the joints.
    given : (K,) array
        Times of the points as they were given, s, for messages.

    """
    lower = limits.lower - ROUNDING * np.maximum(1.0, np.abs(limits.lower))
    upper = limits.upper + ROUNDING * np.maximum(1.0, np.abs(limits.upper))
    fastest = limits.velocity * (1.0 + ROUNDING)
    _check('position', points.t, points.q, lower, upper, names, given)
    _check('velocity', points.t, points.u, -fastest, fastest, names, given)
    if len(points.t) < 2 or _certain(points, lower, upper, fastest):
        return
    ranges = (('position', lower, upper), ('velocity', -fastest, fastest))
    # Control points bound position and velocity; segments within the limits need no
    # samples.
    bounds = _control_points(points)
    for part, (what, low, high) in enumerate(ranges):
        beyond = ((bounds[part] < low) | (bounds[part] > high)).any(axis=(0, 2))
        segments = np.flatnonzero(beyond)
        if segments.size:
            values = points.inside(segments, SAMPLES)[part]
            times = points.t[segments] + SAMPLES[:, None] * np.diff(points.t)[segments]
            _check(what, times.ravel(), values.reshape(-1, len(names)), low, high, names,
                   given)


def _certain(points: ControllerPoints, lower: Array, upper: Array,
             fastest: Array) -> bool:
    """
    Return whether no segment can exceed a limit; quicker than all control points.

    They differ from the points by at most the largest products of velocity and
    acceleration with the duration of the segments; only the middle one of the velocity
    is computed.
    """
    # The Bezier control points of the quintics bound positions and speeds between the
    # points.
    t, q, u, udot = points
    h = np.diff(t)[:, None]
    longest = float(h.max())
    speed = np.abs(u).max(axis=0)
    acceleration = np.abs(udot).max(axis=0)
    reach = 0.4 * longest * speed + 0.05 * longest**2 * acceleration
    above = (q.min(axis=0) - reach >= lower).all()
    below = (q.max(axis=0) + reach <= upper).all()
    # Velocity: control points next to the ends, then the middle one.
    ends = speed + 0.25 * longest * acceleration
    middle = ((5.0 / h) * np.diff(q, axis=0) - 2.0 * (u[:-1] + u[1:])
              + (0.25 * h) * np.diff(udot, axis=0))
    slow = (ends <= fastest).all() and (np.abs(middle).max(axis=0) <= fastest).all()
    return bool(above and below and slow)


def check_efforts(t: Array, tau: Array, bound: Array, names: Sequence[str],
                  given: Array) -> None:
    """Raise InputError if an effort, (K, n), exceeds its bound, (n,)."""
    _check('effort', t, tau, -bound * (1.0 + ROUNDING), bound * (1.0 + ROUNDING), names,
           given)


def _check(what: str, t: Array, values: Array, low: Array, high: Array,
           names: Sequence[str], given: Array) -> None:
    """Raise InputError for an excess; names joint, point, value and limit."""
    wrong = (values < low) | (values > high)
    if not wrong.any():
        return
    # The largest excess.
    excess = np.where(wrong, np.maximum(low - values, values - high), -np.inf)
    k, j = divmod(int(np.argmax(excess)), values.shape[1])
    value = float(values[k, j])
    expected = f'at least {low[j]:.6g}'
    if value > high[j]:
        expected = f'at most {high[j]:.6g}'
    raise InputError(f"joint '{names[j]}': {what} {value:.6g} "
                     f'{described_time(float(t[k]), given)}; expected {expected}')


def described_time(t: float, given: Array) -> str:
    """Return where a time is among the given points, as text."""
    k = int(np.searchsorted(given, t, side='right')) - 1
    if k >= 0 and t == given[k]:
        return f'at point {k} ({t:.6g} s)'
    side = f'before point {k + 1}' if k < 0 else f'after point {k}'
    return f'{side} (at {t:.6g} s)'


def _control_points(points: ControllerPoints) -> tuple[Array, Array]:
    """Return control points of position and velocity, (6 or 5, K - 1, n)."""
    h = np.diff(points.t)[:, None]
    q_0 = points.q[:-1]
    q_1 = points.q[1:]
    # Steps from control point to control point, by the derivatives at both ends.
    first_0 = h / 5.0 * points.u[:-1]
    first_1 = h / 5.0 * points.u[1:]
    second_0 = h * h / 20.0 * points.udot[:-1]
    second_1 = h * h / 20.0 * points.udot[1:]
    position = np.array([q_0, q_0 + first_0, q_0 + 2.0 * first_0 + second_0,
                         q_1 - 2.0 * first_1 + second_1, q_1 - first_1, q_1])
    return position, np.diff(position, axis=0) * (5.0 / h)
