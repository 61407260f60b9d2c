"""
Fastest timing of a path for arms with elastic joints, within the limits of their drives.

A motor's torque follows from four derivatives of the links' motion, so that a timing
whose acceleration jumps, as that of rigid joints, would need an infinite torque. Here the
path parameter is a spline of degree seven in time, at rest at both ends,

    sigma(t) = L sum_k c_k B_k(t / T)

and the duration T is minimized over T and c, within the limits at samples, by an
interior-point method: each limit v <= 1 has a logarithmic barrier (Nocedal and Wright,
Numerical Optimization, chapter 19), and curvatures of the limits are left out. It begins
with a slow motion and ends at a local optimum. Splines have twice as many intervals until
that shortens the motion no more.
"""

from collections.abc import Sequence
import math
from typing import NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.control.elastic_feedforward import ElasticFeedforward
from kane_dynamics.errors import InputError
from kane_dynamics.feasibility.path_geometry import path_of, SHORTEST
from kane_dynamics.feasibility.path_limits import Bounds
from kane_dynamics.feasibility.samples import ROUNDING
from kane_dynamics.feasibility.torque_demand import (Demand, DrivesAlong,
                                                     refined_demand)
from kane_dynamics.motion.controller_points import ControllerPoints
from kane_dynamics.motion.motion import Motion
from kane_dynamics.motion.smooth_motion import (b_splines, SmoothCurve, SmoothMotion,
                                                SmoothState)
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

DEGREE, FIXED = 7, 5  # of the spline; coefficients at each end that rest determines
INTERVALS, MOST_INTERVALS = 16, 64  # of the spline

SETTLED = 1e-2  # relative gain of the last refinement
SAMPLES, POINTS = 10, 4  # an interval of the spline: for limits, and of the result
# Of the interior-point method: relative excess of the duration, about, at the begin, the
# begin after a refinement, and the end.
FIRST, REFINED, LAST = 1.0, 0.02, 1e-3
ITERATIONS, BOUNDARY, HALVINGS = 100, 0.95, 20  # steps; of the way to a limit; shorter ones
REDUCTION = 0.15  # of the barrier parameter
SLOWER, SLOWEST, ROOM = 1.3, 1e6, 0.9  # durations of the start, and use of limits there
SLIGHT = 2e-3  # by which a law is slower after a refinement, or several times
DIFFERENCE = 1e-6  # relative step of numerical derivatives
# Of the limits, for between the samples. A slower motion is no remedy: its motors may be
# faster, because links swing at other times.
MARGIN, LARGEST_MARGIN = 1.5e-3, 0.05
DENSE = 4000  # samples of a path
CHECKED, RESULTS = 2000, 1000  # samples that are checked, and points that are returned
CURVE_POINTS = 200  # of the curve along a motion
DEVIATION = 1e-6  # of that curve from the motion, relative to its length


class ElasticTiming(NamedTuple):
    """The motion of the links, points of links and motors, and torques, (K, n)."""

    motion: SmoothMotion
    points: ControllerPoints
    tau: Array


class TimeLaw(NamedTuple):
    """Duration, s, and coefficients c of sigma(t) / L: those at the ends are 0 and 1."""

    duration: float
    coefficients: Array

    @property
    def free(self) -> Array:
        """Return duration and free coefficients, the variables of the optimization."""
        return np.append(self.duration, self.coefficients[FIXED:-FIXED])

    def moved(self, free: Array) -> 'TimeLaw':
        """Return the law with other variables."""
        coefficients = self.coefficients.copy()
        coefficients[FIXED:-FIXED] = free[1:]
        return TimeLaw(float(free[0]), coefficients)


def elastic_timing(robot: Robot, path: Motion | SmoothMotion | ArrayLike,
                   bounds: Bounds) -> ElasticTiming:
    """
    Return the fastest motion of elastic joints along a path.

    Parameters
    ----------
    robot : Robot
        As for `ElasticFeedforward`, without ball joints.
    path : Motion, SmoothMotion or (K, n) array_like
        Of the links, under constraints of as many joints as independent speeds; a motion
        without rests, whose timing is ignored.
    bounds : Bounds
        Limits of all joints of the robot; efforts of elastic links are those of gears.

    Raises
    ------
    InputError
        The path has corners or leaves the limits of position; motors or gears cannot
        hold the arm on it, or nothing bounds the motion.

    """
    along = _AlongPath(robot, path, bounds)
    while along.margin < LARGEST_MARGIN:
        timing, excess = along.result(_settled(along))
        if excess <= ROUNDING:
            return timing
        # Samples are denser than before: more of the limits is left for between them.
        along.margin += 1.5 * excess
    raise InputError('path: limits that are exceeded between the samples of its timing; '
                     'expected a smoother path')


def _settled(along: '_AlongPath') -> TimeLaw:
    """Return the fastest time law, with enough intervals."""
    law = _fastest(along.limits(along.slow_law()), FIRST)
    # Twice as many intervals until the law gains next to nothing.
    intervals = INTERVALS
    while intervals < MOST_INTERVALS:
        intervals *= 2
        finer = _fastest(along.limits(along.refined(law, intervals)), REFINED)
        gain = 1.0 - finer.duration / law.duration
        law = finer
        if gain < SETTLED:
            break
    return law


class _AlongPath:
    """Limits of a robot with elastic joints along a path, and motions along it."""

    def __init__(self, robot: Robot, path: Motion | SmoothMotion | ArrayLike,
                 bounds: Bounds) -> None:
        self.robot, self.bounds = robot, bounds
        self.margin = MARGIN  # of the limits, that the time law does not use
        feedforward = ElasticFeedforward(robot)
        # Waypoints are of as many joints as independent speeds; a motion names its own.
        self.names = feedforward.joint_names
        if len(feedforward.speed_names) < len(self.names):
            self.names = feedforward.speed_names
        if isinstance(path, Motion | SmoothMotion):
            self.names = path.joint_names
        feedforward.check_joints(self.names)
        self.curve = _curve(path, self.names)
        self._require_inside(feedforward)
        # The demand is that of states; this motion is one that the class takes.
        ends = self.curve.sample(np.array([0.0, self.curve.length])).q
        self.drives = DrivesAlong(
            robot, SmoothMotion.from_points([0.0, 1.0], ends, joint_names=self.names),
            1.0, bounds.power)

    def _require_inside(self, feedforward: ElasticFeedforward) -> None:
        """Raise InputError if the links leave their limits of position on the path."""
        # At many places of the path, for each joint of the links and both of its
        # limits.
        places = np.linspace(0.0, self.curve.length, DENSE)
        q = feedforward.closed(places, self.curve.sample(places).q, self.names)
        limits = self.robot.limits
        names = feedforward.joint_names
        links = list(map(self.robot.joint_names.index, names))
        for side, bound, sign in (('lower', limits.lower[links], -1.0),
                                  ('upper', limits.upper[links], 1.0)):
            excess = sign * (q - bound) - ROUNDING * np.maximum(1.0, np.abs(bound))
            k, j = np.unravel_index(int(excess.argmax()), excess.shape)
            if excess[k, j] > 0.0:
                raise InputError(f"path: joint '{names[int(j)]}': position "
                                 f'{q[k, j]:.6g}; expected within its {side} limit '
                                 f'{bound[j]:.6g}')

    def limits(self, law: TimeLaw) -> '_Limits':
        """Return the limits as functions of the coefficients of such a time law."""
        return _Limits(self, law)

    def uses(self, needed: Demand) -> Array:
        """Return the shares of the limits, (N, m), with signs."""
        shares = []
        quantities = (needed.tau, needed.u, needed.tau * needed.u, needed.udot)
        for values, bound in zip(quantities, self.bounds):
            limited = np.isfinite(bound)
            shares.append(values[:, limited] / bound[limited])
        return np.hstack(shares)

    def slow_law(self) -> TimeLaw:
        """Return a law that is slow enough for all limits."""
        # Uniform coefficients are the law at constant speed; the fixed ones rest at
        # both ends.
        count = INTERVALS + DEGREE
        coefficients = np.linspace(-0.5, 1.5, count)
        coefficients[:FIXED] = 0.0
        coefficients[-FIXED:] = 1.0
        inner = np.linspace(0.0, 1.0, count - 2 * FIXED + 2)
        coefficients[FIXED:-FIXED] = inner[1:-1]
        law = TimeLaw(1e-3, coefficients)
        limits = self.limits(law)
        if not limits.of(law).size:
            raise InputError('path: no limit of motors, gears or links; expected some '
                             'that bound the motion')
        # Torques of motion fall with the duration; what remains at rest must be held
        # anyway: the start uses a share of what that leaves of each limit.
        at_rest = law._replace(duration=SLOWEST)
        held = np.abs(limits.of(at_rest))
        if held.max() >= 1.0:
            raise self._not_held(limits, at_rest)
        while (np.abs(limits.of(law)) > held + ROOM * (1.0 - held)).any():
            law = law._replace(duration=SLOWER * law.duration)
        return law

    def _not_held(self, limits: '_Limits', law: TimeLaw) -> InputError:
        """Return the error for a path on which a slow law exceeds a limit."""
        return InputError(f'path: {self._worst(limits, law)}; expected motors and gears '
                          'that hold the arm on it')

    def _worst(self, limits: '_Limits', law: TimeLaw) -> str:
        """Return the use of the limits by a slow law in words."""
        # The limit and the joint that are used most, where its torque is largest.
        needed = limits.needed(law)
        uses = needed.uses
        largest_uses = {name: float(use.max()) for name, use in uses.items()}
        limit = max(largest_uses, key=largest_uses.__getitem__)
        j = int(uses[limit].argmax())
        k = int(np.abs(needed.tau[:, j]).argmax())
        links = list(map(self.robot.joint_names.index, self.names))
        return (f"joint '{needed.joint_names[j]}': {uses[limit][j]:.4g} times its {limit} "
                f'limit at rest, at {needed.q[k, links].round(4).tolist()}')

    def refined(self, law: TimeLaw, intervals: int) -> TimeLaw:
        """
        Return the same law with twice as many intervals, inside all limits.

        It is a little slower, for what exceeds them between the samples of before.
        """
        # The finer splines nearest to the law, with the same ends, by least squares.
        places = np.linspace(0.0, 1.0, 4 * intervals)
        values = _basis(len(law.coefficients) - DEGREE, places, 0) @ law.coefficients
        basis = _basis(intervals, places, 0)
        coefficients = np.zeros(intervals + DEGREE)
        coefficients[-FIXED:] = 1.0
        known = basis @ coefficients
        inner = basis[:, FIXED:-FIXED]
        coefficients[FIXED:-FIXED] = np.linalg.lstsq(inner, values - known)[0]
        law = TimeLaw(law.duration, coefficients)
        limits = self.limits(law)
        # What the approximation changed may exceed a limit slightly.
        slower = 1.0 + SLIGHT
        while np.abs(limits.of(law)).max() >= 1.0:
            law = law._replace(duration=slower * law.duration)
            slower *= slower
            if law.duration > SLOWEST:
                raise self._not_held(limits, law)
        return law

    def result(self, law: TimeLaw) -> tuple[ElasticTiming, float]:
        """Return the motion of a law as a spline, and its excess over the limits."""
        # The path at the shares of the law, through which a smooth spline runs in time.
        intervals = len(law.coefficients) - DEGREE
        places = np.linspace(0.0, 1.0, POINTS * intervals + 1)
        share = _basis(intervals, places, 0) @ law.coefficients
        positions = self.curve.sample(self.curve.length * share).q
        motion = SmoothMotion.from_points(law.duration * places, positions,
                                          joint_names=self.names)

        # With samples between those where a limit is near.
        check = DrivesAlong(self.robot, motion, motion.duration / CHECKED,
                            self.bounds.power)
        needed = refined_demand(check.demand_at, 1.0)
        excess = float(np.abs(self.uses(needed)).max()) - 1.0
        times = np.linspace(0.0, motion.duration, RESULTS)
        needed = self.drives.demand_of(times, motion.sample(times), 1.0)
        points = ControllerPoints(times, needed.q, needed.u, needed.udot)
        return ElasticTiming(motion, points, needed.tau), excess


class _Limits:
    """
    Limits of time laws at samples, as functions of duration and free coefficients.

    Parameters
    ----------
    along : _AlongPath
    law : TimeLaw
        The first law; others have as many coefficients.

    """

    def __init__(self, along: _AlongPath, law: TimeLaw) -> None:
        self.along, self.law = along, law
        intervals = len(law.coefficients) - DEGREE
        self.places = np.linspace(0.0, 1.0, SAMPLES * intervals + 1)
        self._basis = np.stack([_basis(intervals, self.places, order)
                                for order in range(5)])

    def parameters(self, law: TimeLaw) -> Array:
        """Return the path parameter and four time derivatives at samples, (5, N)."""
        derivatives = self.along.curve.length * (self._basis @ law.coefficients)
        powers = law.duration ** -np.arange(5.0)
        return np.asarray(powers[:, None] * derivatives)

    def needed(self, law: TimeLaw) -> Demand:
        """Return the demand of the motion."""
        return self._demand(law.duration * self.places, self.parameters(law))

    def _demand(self, times: Array, parameters: Array) -> Demand:
        state = _along_curve(self.along.curve, parameters)
        return self.along.drives.demand_of(times, state, 1.0)

    def of(self, law: TimeLaw) -> Array:
        """Return the shares of the limits at the samples, (N, m), with signs."""
        return self.shares_of(self.needed(law))

    def shares_of(self, needed: Demand) -> Array:
        """Return the shares of the limits without the margin, (N, m), with signs."""
        return self.along.uses(needed) / (1.0 - self.along.margin)

    def slopes(self, law: TimeLaw) -> Array:
        """Return the derivatives of `of` for duration and free coefficients, (N, m, k)."""
        if self.along.drives.feedforward.damped:
            return self._slopes_with_history(law)
        # At a sample a share is a function of the parameter and its derivatives there.
        parameters = self.parameters(law)
        times = law.duration * self.places
        sizes = np.abs(parameters).max(axis=1)
        by_derivative = []
        for order in range(5):
            step = DIFFERENCE * sizes[order]
            change = np.zeros_like(parameters)
            change[order] = step
            after = self.shares_of(self._demand(times, parameters + change))
            before = self.shares_of(self._demand(times, parameters - change))
            by_derivative.append((after - before) / (2.0 * step))
        slope = np.stack(by_derivative)

        # They are linear in the coefficients, and of order k in 1 / T.
        powers = law.duration ** -np.arange(5.0)
        scaled = self.along.curve.length * powers[:, None, None] * self._basis
        of_duration = -np.arange(5.0)[:, None] / law.duration * parameters
        columns = np.concatenate([of_duration[:, :, None], scaled[:, :, FIXED:-FIXED]],
                                 axis=2)
        return np.asarray(np.einsum('onm,onk->nmk', slope, columns))

    def _slopes_with_history(self, law: TimeLaw) -> Array:
        """Return the slopes where the deflection of a damped drive is a state."""
        # Central differences: each coefficient changes the whole history of the
        # deflection.
        free = law.free
        slopes = []
        for k in range(len(free)):
            step = DIFFERENCE * (free[0] if k == 0 else 1.0)
            sides = []
            for sign in (1.0, -1.0):
                moved = free.copy()
                moved[k] += sign * step
                sides.append(self.of(law.moved(moved)))
            slopes.append((sides[0] - sides[1]) / (2.0 * step))
        return np.stack(slopes, axis=2)


def _fastest(limits: _Limits, excess: float) -> TimeLaw:
    """
    Return the fastest law within limits, to a local optimum.

    `excess` is that of the duration of the first law, about, relative.
    """
    law = limits.law
    shares = limits.of(law)
    sides = _sides(shares, law)
    mu = excess * law.duration / sides.size
    dual = mu / sides
    for _ in range(ITERATIONS):
        # Newton's step of the barrier function.
        slopes = _side_slopes(limits.slopes(law))
        gradient = -mu * (slopes.T @ (1.0 / sides))
        gradient[0] += 1.0
        hessian = slopes.T @ ((dual / sides)[:, None] * slopes)
        hessian[np.diag_indices_from(hessian)] *= 1.0 + 1e-12
        change = -np.linalg.solve(hessian, gradient)
        rates = slopes @ change
        nearest = max(float((-rates / sides).max()), -change[0] / law.duration, 1e-30)
        length = min(1.0, BOUNDARY / nearest)

        # Line search: inside all limits, with a part of the decrease that is foreseen.
        decrease = float(gradient @ change)
        start = law.duration - mu * float(np.log(sides).sum())
        for _ in range(HALVINGS):
            tried = law.moved(law.free + length * change)
            new_sides = _sides(limits.of(tried), tried)
            if (new_sides > 0.0).all():
                merit = tried.duration - mu * float(np.log(new_sides).sum())
                if merit <= start + 1e-4 * length * decrease + 1e-12 * abs(start):
                    break
            length *= 0.5
        else:
            return law
        dual_change = mu / sides - dual - dual / sides * rates
        shorter = min(1.0, BOUNDARY / max(float((-dual_change / dual).max()), 1e-30))
        law, sides = tried, new_sides
        dual = np.clip(dual + shorter * dual_change, 1e-6 * mu / sides, 1e6 * mu / sides)

        # Near the minimum for this barrier a smaller one follows, or the end.
        if -decrease < 0.1 * mu * math.sqrt(sides.size) and length > 0.3:
            if mu * sides.size <= LAST * law.duration:
                return law
            mu = max(REDUCTION * mu, 0.9 * LAST * law.duration / sides.size)
    return law


def _sides(shares: Array, law: TimeLaw) -> Array:
    """Return the distances to limits and increases of sigma, which must stay positive."""
    flat = shares.ravel()
    increases = np.diff(law.coefficients[FIXED - 1:len(law.coefficients) - FIXED + 1])
    return np.concatenate([1.0 - flat, 1.0 + flat, increases])


def _side_slopes(slopes: Array) -> Array:
    """Return the derivatives of `_sides`, (., k), from those of the shares."""
    flat = slopes.reshape(-1, slopes.shape[2])
    count = slopes.shape[2] - 1
    increases = np.zeros((count + 1, count + 1))
    increases[:-1, 1:] = np.eye(count)
    increases[1:, 1:] -= np.eye(count)
    return np.concatenate([-flat, flat, increases])


def _basis(intervals: int, places: Array, order: int) -> Array:
    """Return a derivative of all B-splines at places from 0 to 1, (N, intervals + 7)."""
    knots = np.linspace(0.0, 1.0, intervals + 1)
    return b_splines(knots, DEGREE, places, order)


def _curve(path: Motion | SmoothMotion | ArrayLike, names: Sequence[str]) -> SmoothCurve:
    """Return the curve of a path: through waypoints, or along a motion."""
    if not isinstance(path, Motion | SmoothMotion):
        return SmoothCurve(path_of(path, names).positions)
    if path.joint_names != tuple(names):
        raise InputError(f'path: joints {list(path.joint_names)}; expected {list(names)}, '
                         'the links of elastic joints')
    # Points of the motion at equal lengths along it.
    times = np.linspace(path.times[0], path.duration, DENSE)
    positions = path.sample(times)[0]
    lengths = _arc_lengths(positions)
    if lengths[-1] < SHORTEST:
        raise InputError(f'path: {lengths[-1]:.3g} rad or m long; expected a path that '
                         f'moves by at least {SHORTEST:g}')
    at = np.interp(np.linspace(0.0, lengths[-1], CURVE_POINTS), lengths, times)
    curve = SmoothCurve(path.sample(at)[0])

    # The curve and the motion agree between these points, but at corners.
    between = np.interp(np.linspace(0.0, lengths[-1], DENSE), lengths, times)
    expected = path.sample(between)[0]
    error = _distances(expected, curve.sample(np.linspace(0.0, curve.length, DENSE)).q)
    worst = int(error.argmax())
    if error[worst] > DEVIATION * curve.length:
        raise InputError(f'path: a corner near {expected[worst].round(4).tolist()}; '
                         'expected waypoints, through which a smooth curve is drawn, or '
                         'a motion along a smooth curve, because elastic joints need '
                         'four derivatives')
    return curve


def _distances(points: Array, curve: Array) -> Array:
    """Return the distances of points to a polygon that runs beside them, (N,)."""
    nearest = np.searchsorted(_arc_lengths(curve), _arc_lengths(points))
    nearest = np.clip(nearest, 1, len(curve) - 1)
    chord = curve[nearest] - curve[nearest - 1]
    off = points - curve[nearest - 1]
    share = (off * chord).sum(axis=1) / (chord * chord).sum(axis=1)
    share = np.clip(share, -1.0, 2.0)  # a reversal of one joint leaves the polygon
    return np.asarray(np.linalg.norm(off - share[:, None] * chord, axis=1))


def _along_curve(curve: SmoothCurve, parameters: Array) -> SmoothState:
    """Return q and four time derivatives for the parameter and its own, (5, N)."""
    inside = np.clip(parameters[0], 0.0, curve.length)
    q, first, second, third, fourth = curve.sample(inside)
    s1, s2, s3, s4 = parameters[1:, :, None]
    return SmoothState(
        q, first * s1, second * s1**2 + first * s2,
        third * s1**3 + 3.0 * second * s1 * s2 + first * s3,
        fourth * s1**4 + 6.0 * third * s1**2 * s2
        + second * (4.0 * s1 * s3 + 3.0 * s2**2) + first * s4)


def _arc_lengths(q: Array) -> Array:
    """Return the length along points, (K, n), from the first, (K,)."""
    steps = np.linalg.norm(np.diff(q, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])
