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

    The control points of a segment's Bernstein polynomial bound its position, their differences
    its velocity. Only segments whose bounds exceed a limit are sampled, at `SAMPLES`.

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
    lower, upper = (bound + sign * ROUNDING * np.maximum(1.0, np.abs(bound))
                    for bound, sign in ((limits.lower, -1.0), (limits.upper, 1.0)))
    ranges = (('position', lower, upper),
              ('velocity', -limits.velocity * (1.0 + ROUNDING),
               limits.velocity * (1.0 + ROUNDING)))
    for (what, low, high), values in zip(ranges, (points.q, points.u), strict=True):
        _check(what, points.t, values, low, high, names, given)
    if len(points.t) < 2 or _certain(points, *ranges[0][1:], ranges[1][2]):
        return
    for part, ((what, low, high), control) in enumerate(zip(ranges, _control_points(points),
                                                            strict=True)):
        beyond = ((control < low) | (control > high)).any(axis=(0, 2))
        segments = np.flatnonzero(beyond)
        if segments.size:
            values = points.inside(segments, SAMPLES)[part]
            times = points.t[segments] + SAMPLES[:, None] * np.diff(points.t)[segments]
            _check(what, times.ravel(), values.reshape(-1, len(names)), low, high, names, given)


def _certain(points: ControllerPoints, lower: Array, upper: Array, fastest: Array) -> bool:
    """
    Return whether no segment can exceed a limit; quicker than all control points.

    They differ from the points by at most the largest products of velocity and acceleration with
    the duration of the segments; only the middle one of the velocity is computed.
    """
    t, q, u, udot = points
    h = np.diff(t)[:, None]
    longest = float(h.max())
    speed, bend = (np.abs(values).max(axis=0) for values in (u, udot))
    reach = 0.4 * longest * speed + 0.05 * longest**2 * bend
    middle = (5.0 / h) * np.diff(q, axis=0) - 2.0 * (u[:-1] + u[1:]) + (0.25 * h) * np.diff(
        udot, axis=0)
    return bool((q.min(axis=0) - reach >= lower).all() and (q.max(axis=0) + reach <= upper).all()
                and (speed + 0.25 * longest * bend <= fastest).all()
                and (np.abs(middle).max(axis=0) <= fastest).all())


def check_efforts(t: Array, tau: Array, bound: Array, names: Sequence[str], given: Array) -> None:
    """Raise InputError if an effort, (K, n), exceeds its bound, (n,)."""
    _check('effort', t, tau, -bound * (1.0 + ROUNDING), bound * (1.0 + ROUNDING), names, given)


def _check(what: str, t: Array, values: Array, low: Array, high: Array, names: Sequence[str],
           given: Array) -> None:
    """Raise InputError that names the joint, the point, the value and the limit of an excess."""
    wrong = (values < low) | (values > high)
    if not wrong.any():
        return
    beyond = np.maximum(low - values, values - high)
    k, j = divmod(int(np.argmax(np.where(wrong, beyond, -np.inf))), values.shape[1])
    value, least, most = (float(x) for x in (values[k, j], low[j], high[j]))
    expected = f'at most {most:.6g}' if value > most else f'at least {least:.6g}'
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
    """Return control points of position and velocity in every segment, (6 or 5, K - 1, n)."""
    h = np.diff(points.t)[:, None]
    (q0, q1), (d0, d1), (c0, c1) = (
        (factor * values[:-1], factor * values[1:]) for factor, values in (
            (1.0, points.q), (h / 5.0, points.u), (h * h / 20.0, points.udot)))
    position = np.array([q0, q0 + d0, q0 + 2.0 * d0 + c0, q1 - 2.0 * d1 + c1, q1 - d1, q1])
    return position, np.diff(position, axis=0) * (5.0 / h)
