"""
Smooth desired motion: splines of degree five and seven, with jerk and snap.

The torque of an elastic joint's motor follows from four derivatives of the motion. Where
the jerk jumps, so does the rate of the gear's torque, and the motor would need an
infinite torque. A spline of degree p has p - 1 continuous derivatives at its points. At
both ends the motion rests: speed, acceleration and jerk vanish, with degree seven the
snap too. For these conditions the spline has two more knots, in the middle of its first
and last segment.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
import math
from typing import NamedTuple

from kane_dynamics._util.checks import instance, number, real_numbers
from kane_dynamics._util.fixed_attributes import fixed
from kane_dynamics._util.text import short
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.motion.motion import Motion
from kane_dynamics.motion.points import checked_joint_names, trajectory_points
import numpy as np
from numpy.typing import ArrayLike

DEGREES = (5, 7)
MOST_POINTS = 2000  # the system for the coefficients is dense
DERIVATIVES = 4  # that `sample` returns
ORDERS = 'speed', 'acceleration', 'jerk'  # that must not jump
FASTEST = 1e6  # largest factor of the speed of a motion
JUMP = 1e-6  # of the largest jerk: a larger difference at a point is a jump
# Of the largest speed, acceleration and jerk, in a motion that laws of control follow. The
# jerk of a smooth motion jumps by a hundredth at points that are dense.
JUMPS_OF_LAWS = 0.01, 0.01, 0.1
AT_REST = 1e-9  # rad, m and s: rounding of the derivatives at the end of a motion
WITHIN = 0.3  # share of a segment: not its middle or ends, where derivatives may vanish


class SmoothState(NamedTuple):
    """Position and four derivatives: q, u, udot, jerk, snap; (n,) or (K, n) arrays."""

    q: Array
    u: Array
    udot: Array
    jerk: Array
    snap: Array


@fixed
class SmoothMotion:
    """
    Desired motion with a continuous jerk; immutable.

    Before the first and after the last point the motion rests there. Create one with
    `from_points`, or from a `Motion` whose jerk does not jump with `from_motion`.

    Attributes
    ----------
    joint_names : tuple of str
    times : (K,) array
        Times of the knots, s.
    duration : float
        Time of the last point, s.

    """

    def __init__(self, joint_names: tuple[str, ...], times: Array,
                 coefficients: Array) -> None:
        """Store checked arrays; `coefficients` are (K - 1, degree + 1, n), in t - t_k."""
        self.joint_names = joint_names
        self.times = times
        self.duration = float(times[-1])
        self._coefficients = coefficients
        times.flags.writeable = False
        coefficients.flags.writeable = False

    def __repr__(self) -> str:
        """Return degree, size and joints on one line."""
        return (f'<SmoothMotion of degree {self.degree} in {self.duration:g} s of '
                f'{short(self.joint_names)}>')

    @property
    def n(self) -> int:
        """Return the number of joints."""
        return len(self.joint_names)

    @property
    def degree(self) -> int:
        """Return the degree of the polynomials."""
        return int(self._coefficients.shape[1]) - 1

    @classmethod
    def from_points(cls, times: ArrayLike, positions: ArrayLike, *,
                    joint_names: Sequence[str], degree: int = 7) -> SmoothMotion:
        """
        Return the spline through points, at rest at both ends.

        Parameters
        ----------
        times : (K,) array_like
            s, nonnegative and strictly increasing, 2 <= K <= 2000.
        positions : (K, n) array_like
            rad or m.
        joint_names : sequence of str
            Names of the columns.
        degree : 5 or 7
            With 5, jerk and snap are continuous inside and the snap jumps at the ends,
            where the motor's torque then jumps. With 7 it does not.

        Raises
        ------
        InputError
            If an argument is invalid; the message names it.

        """
        if degree not in DEGREES:
            raise InputError(f'degree: {degree!r}; expected 5 or 7')
        names = checked_joint_names(joint_names, 'joint_names')
        t, q, _, _ = trajectory_points(times, positions, None, None, names)
        if not 2 <= len(t) <= MOST_POINTS:
            raise InputError(f'times: {len(t)} points; expected 2 to {MOST_POINTS}')
        # As many conditions at both ends as the degree leaves free.
        rest = range(1, (degree + 1) // 2 + 1)  # derivatives that vanish at the ends
        return cls(names, *_spline(t, q, degree, rest, _knots))

    @classmethod
    def from_motion(cls, motion: Motion) -> SmoothMotion:
        """
        Return a `Motion` as a smooth one, if its jerk is continuous.

        Raises
        ------
        InputError
            The acceleration or jerk of a joint jumps at a point, which would need an
            infinite torque of an elastic joint's motor; the message names point and
            joint.

        """
        instance(motion, Motion, 'motion')
        if len(motion.times) < 2:
            raise InputError('motion: one point; expected at least two')
        smooth = cls._in_seconds(motion)
        smooth.require_no_jumps()
        return smooth

    @classmethod
    def _in_seconds(cls, motion: Motion) -> SmoothMotion:
        """Return the polynomials of a motion of two points or more, which may jump."""
        # Coefficients in x from 0 to 1 become those in seconds: c_k / h^k.
        rate = 1.0 / np.diff(motion.times)
        powers = rate[:, None] ** np.arange(6.0)
        return cls(motion.joint_names, motion.times.copy(),
                   motion.coefficients * powers[:, :, None])

    def with_rest(self, seconds: float) -> SmoothMotion:
        """
        Return the motion followed by a rest at its last point.

        Motors of drives with damping still move then.

        Parameters
        ----------
        seconds : float
            Duration of the rest, s, positive.

        """
        rest = number(seconds, 'seconds', 'a positive finite number, s',
                      lambda x: 0.0 < x < np.inf)
        last = np.zeros((1, *self._coefficients.shape[1:]))
        last[0, 0] = self.sample(self.times[-1:])[0][0]
        return SmoothMotion(self.joint_names, np.append(self.times, self.duration + rest),
                            np.concatenate([self._coefficients, last]))

    def require_no_jumps(self, jumps: Sequence[float] = (JUMP, JUMP, JUMP),
                         after: float = -math.inf) -> None:
        """
        Raise InputError where speed, acceleration or jerk jumps after a time, s.

        `jumps` are the largest differences at a point that are accepted, relative to the
        largest speed, acceleration and jerk.
        """
        lengths = np.diff(self.times)
        rest = np.zeros((1, self.n))
        for order, what in enumerate(ORDERS, start=1):
            begins = _polynomials(self._coefficients, 0.0 * lengths, order)
            ends = _polynomials(self._coefficients, lengths, order)
            # Left and right of every point; it rests outside.
            differences = np.abs(np.vstack([begins, rest]) - np.vstack([rest, ends]))
            differences[self.times <= after] = 0.0
            point, joint = np.unravel_index(int(differences.argmax()), differences.shape)
            if differences[point, joint] > jumps[order - 1] * self._largest(order):
                raise _jump(what, self.joint_names[joint], differences[point, joint],
                            f'at point {point}, {self.times[point]:g} s')

    def _largest(self, order: int) -> float:
        """Return the largest derivative of an order at the points and within segments."""
        # Of a motion between two points at rest the derivatives vanish at the points.
        lengths = np.diff(self.times)
        values = [_polynomials(self._coefficients, share * lengths, order)
                  for share in (0.0, WITHIN, 1.0)]
        return float(np.abs(values).max())

    def scaled(self, speed: float) -> SmoothMotion:
        """Return the motion `speed` times as fast, from 1e-6 to 1e6; else InputError."""
        # Beyond these, powers of the factor overflow or vanish in the coefficients.
        factor = number(speed, 'speed', f'a number from {1.0 / FASTEST:g} to {FASTEST:g}',
                        lambda x: 1.0 / FASTEST <= x <= FASTEST)
        powers = factor ** np.arange(self.degree + 1.0)
        coefficients = self._coefficients * powers[:, None]
        return SmoothMotion(self.joint_names, self.times / factor, coefficients)

    def sample(self, t: ArrayLike) -> SmoothState:
        """
        Return q, u, udot, jerk and snap at times t from the start.

        Parameters
        ----------
        t : float or (K,) array_like
            s, finite.

        Returns
        -------
        SmoothState
            (n,) arrays, or (K, n) for an array of times.

        """
        try:
            stated = np.asarray(real_numbers(t))
        except (TypeError, ValueError):
            raise InputError(f't: {t!r}; expected a time in s, or (K,) times') from None
        if stated.ndim > 1 or not np.isfinite(stated).all():
            raise InputError(f't: shape {stated.shape}; expected finite times in s, on '
                             'at most one axis')
        at = np.atleast_1d(stated)
        inside = (at >= self.times[0]) & (at <= self.times[-1])
        clipped = np.clip(at, self.times[0], self.times[-1])
        pieces = np.searchsorted(self.times[1:-1], clipped, side='right')
        coefficients = self._coefficients[pieces]
        # Outside the motion it rests: derivatives are zero, the position is that of the
        # end.
        states = []
        for order in range(DERIVATIVES + 1):
            values = _polynomials(coefficients, clipped - self.times[pieces], order)
            if order:
                values[~inside] = 0.0
            states.append(values if stated.ndim else values[0])
        return SmoothState(*states)


def require_smooth(motion: Motion, moment: float | None = None,
                   before: Array | None = None) -> None:
    """
    Raise InputError for a motion that no law of elastic joints can follow.

    Points of a smooth motion with accelerations, dense enough, leave small jumps of the
    jerk, which are accepted.

    Parameters
    ----------
    motion : Motion
        From rest to rest, but where it is followed from a moment on.
    moment : float, optional
        Time of the motion from which on it is followed, s. Default: its beginning.
    before : (3, n) array, optional
        Speed, acceleration and jerk until that moment. Default: at rest.

    """
    # A motion of one point rests there.
    state = np.zeros((1 + len(ORDERS), motion.n))
    largest = np.zeros(1 + len(ORDERS))
    if len(motion.times) > 1:
        smooth = SmoothMotion._in_seconds(motion)
        if moment is None:
            smooth.require_no_jumps(JUMPS_OF_LAWS)
            return
        smooth.require_no_jumps(JUMPS_OF_LAWS, after=moment)
        state = np.stack(smooth.sample(moment)[:1 + len(ORDERS)])
        largest[1:] = [smooth._largest(order) for order in range(1, 1 + len(ORDERS))]
    # The jump where it begins to be followed.
    if before is None:
        before = np.zeros((len(ORDERS), motion.n))
    for order, what in enumerate(ORDERS, start=1):
        differences = np.abs(state[order] - before[order - 1])
        joint = int(differences.argmax())
        size = max(largest[order], np.abs(before[order - 1]).max())
        if differences[joint] > max(JUMPS_OF_LAWS[order - 1] * size, AT_REST):
            raise _jump(what, motion.joint_names[joint], differences[joint],
                        f'where it begins, {moment or 0.0:g} s')


def _jump(what: str, joint: str, size: float, place: str) -> InputError:
    """Return the error of a derivative that jumps at a place."""
    return InputError(f"motion: the {what} of joint '{joint}' jumps by {size:.4g} {place}; "
                      'expected continuous jerk, as of SmoothMotion.from_points, since '
                      'the torque rate of an elastic joint would jump')


def _spline(t: Array, q: Array, degree: int, orders: Iterable[int],
            knots_of: Callable[[Array], Array]) -> tuple[Array, Array]:
    """
    Return the knots, (K,), of a spline through points, and its coefficients.

    Derivatives of the stated orders vanish at both ends; with `knots_of` the places of
    the points it has as many more knots as these need.
    """
    # In units of the mean segment and from the first point, so that powers of time and
    # the equations stay well scaled.
    scale = (t[-1] - t[0]) / (len(t) - 1)
    places = (t - t[0]) / scale
    knots = knots_of(places)
    weights = _spline_weights(places, q - q[0], knots, degree, orders)
    # Each piece as its Taylor polynomial at the knot where it begins.
    coefficients = np.stack([
        b_splines(knots, degree, knots[:-1], order) @ weights / math.factorial(order)
        for order in range(degree + 1)], axis=1)
    coefficients[:, 0] += q[0]
    # Back to seconds: the k-th coefficient divides by scale^k.
    with np.errstate(over='ignore', invalid='ignore'):
        powers = scale ** -np.arange(degree + 1.0)
        coefficients = coefficients * powers[:, None]
    if not np.isfinite(coefficients).all():
        raise InputError(f'motion: positions up to {np.abs(q).max():g} in '
                         f'{t[-1] - t[0]:g} s overflow; expected a finite motion')
    return t[0] + scale * knots, coefficients


def _knots(places: Array) -> Array:
    """Return the points with a knot in the middle of the first and last segment."""
    first, last = places[:2], places[-2:]
    if len(places) == 2:  # both in one segment
        middle = np.linspace(first[0], first[1], 4)[1:3]
        return np.array([first[0], *middle, first[1]])
    return np.array([first[0], first.mean(), *places[1:-1], last.mean(), last[1]])


def _spline_weights(places: Array, values: Array, knots: Array, degree: int,
                    orders: Iterable[int]) -> Array:
    """Return the weights of the B-splines, with derivatives that vanish at the ends."""
    # Values at the places, then derivatives of zero at both ends: as many rows as
    # splines.
    ends = knots[[0, -1]]
    rows = [b_splines(knots, degree, places, 0)]
    right = [values]
    for order in orders:
        rows.append(b_splines(knots, degree, ends, order))
        right.append(np.zeros((2, values.shape[1])))
    return np.linalg.solve(np.vstack(rows), np.vstack(right))


def b_splines(knots: Array, degree: int, x: Array, order: int) -> Array:
    """
    Return a derivative of all B-splines at x, (len(x), len(knots) - 1 + degree).

    Cox and de Boor's recursion to the degree less the order, then the rule for the
    derivative, B_p' = p (B_(p-1),i / (t_i+p - t_i) - B_(p-1),i+1 / (t_i+p+1 - t_i+1)).
    """
    # The recursion of Cox and de Boor, from the pieces of degree 0 that contain x.
    t = np.concatenate([np.repeat(knots[0], degree), knots, np.repeat(knots[-1], degree)])
    count = len(t) - 1
    piece = degree + np.searchsorted(knots[1:-1], x, side='right')
    basis = np.zeros((len(x), count))
    basis[np.arange(len(x)), piece] = 1.0
    # The last `order` steps differentiate: p times the difference of neighbours over
    # their spans.
    for p in range(1, degree + 1):
        span = t[p:] - t[:-p]
        reciprocal = np.divide(1.0, span, out=np.zeros_like(span), where=span > 0.0)
        if p <= degree - order:
            rising = (x[:, None] - t[:-p]) * reciprocal
            falling = 1.0 - rising
            basis = rising[:, :-1] * basis[:, :-1] + falling[:, 1:] * basis[:, 1:]
        else:
            slopes = p * reciprocal * basis
            basis = slopes[:, :-1] - slopes[:, 1:]
    return basis


def _polynomials(coefficients: Array, x: Array, order: int) -> Array:
    """Return a derivative of K polynomials, (K, degree + 1, n), at x, (K,); (K, n)."""
    value = np.zeros(coefficients.shape[::2])
    for k in range(coefficients.shape[1] - 1, order - 1, -1):
        factor = math.perm(k, order)  # of the derivative of x^k
        value = value * x[:, None] + factor * coefficients[:, k]
    return value
