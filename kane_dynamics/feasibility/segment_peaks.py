"""Largest shares of torque, speed, power and acceleration limits in quintic segments."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.motion.controller_points import ControllerPoints, Segments
from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import trace_program
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import NDArray

SMALLEST = 1e-300  # limit
QUANTITIES = ('effort', 'velocity', 'power', 'acceleration')
CHANGING = 0.005  # range of a share within a segment from which it counts between points, too


class Peaks(NamedTuple):
    """
    Largest shares of limits at both ends of segments and at one place between.

    Attributes
    ----------
    shares : (S, 4, n) array
        Shares of the limits of `QUANTITIES`; 0 for infinite limits.
    largest : (S,) array
        The largest of them.
    change : (S,) array
        Largest range of a share that, by its estimate, may exceed its limit; 0 for none.
    estimate : (S,) array
        Largest share plus its range, of those that change.

    """

    shares: Array
    largest: Array
    change: Array
    estimate: Array


def peaks_kernel(robot: Robot) -> Kernel:
    """
    Return the kernel of `Peaks` of a segment, (4 n + 3,).

    Its arguments are the positions, velocities, accelerations and torques (n,) at the start and at
    the end of the segment, its duration, s, the place x in it from 0 to 1, and the reciprocal
    limits (4, n).
    """
    block, n = robot.parameters.block, robot.n
    inputs: list[tuple[str, tuple[int, ...]]] = [
        *((each + end, (n,)) for end in ('_0', '_1') for each in ('q', 'u', 'udot', 'tau')),
        ('h', ()), ('x', ()), ('factors', (len(QUANTITIES), n))]

    def values(*given: Any) -> Any:
        begin, end, (h, x, factors, parameters) = given[:4], given[4:8], given[8:]
        q, u, udot = quintic(begin[:3], end[:3], h[()], x[()])
        tau = robot.equations.inverse_dynamics(q, u, udot, None, parameters)
        shares = [np.ravel([state[3], state[1], state[3] * state[1], state[2]])
                  * np.ravel(factors) for state in (begin, end, (q, u, udot, tau))]
        peaks, changes, estimates = [], [], []
        for row in zip(*shares):
            high, low = largest(row), -largest([-share for share in row])
            peak, change = largest([high, -low]), high - low
            estimate = peak + select(change > CHANGING, change, 0.0)
            peaks.append(peak)
            changes.append(select(estimate > 1.0, change, 0.0))
            estimates.append(estimate)
        return np.array([*peaks, largest(peaks), largest(changes), largest(estimates)])
    size = len(QUANTITIES) * n + 3
    return robot.kernels.extra(
        'shares', lambda: trace_program('shares', values, [*inputs, ('parameters', block.shape)]),
        [Argument(*each) for each in inputs], block, (size,))


def largest(values: Sequence[Any]) -> Any:
    """Return the largest of traced values."""
    if len(values) == 1:
        return values[0]
    a, b = (largest(part) for part in (values[::2], values[1::2]))
    return select(a < b, b, a)


def quintic(begin: Sequence[Any], end: Sequence[Any], h: Any, x: Any) -> tuple[Any, Any, Any]:
    """Return q, u and udot at a place of the quintic between two states."""
    u, udot = h * begin[1], h * h * begin[2]
    rise = end[0] - begin[0] - u - 0.5 * udot
    slope = h * end[1] - u - udot
    bend = h * h * end[2] - udot
    a, b, c = (10.0 * rise - 4.0 * slope + 0.5 * bend, -15.0 * rise + 7.0 * slope - bend,
               6.0 * rise - 3.0 * slope + 0.5 * bend)
    q = begin[0] + x * (u + x * (0.5 * udot + x * (a + x * (b + x * c))))
    rate = u + x * (udot + x * (3.0 * a + x * (4.0 * b + x * (5.0 * c))))
    change = udot + x * (6.0 * a + x * (12.0 * b + x * (20.0 * c)))
    r = 1.0 / h
    return q, rate * r, change * (r * r)


class SegmentPeaks:
    """
    Shares of limits in the segments between points.

    Parameters
    ----------
    robot : Robot
        A robot in joint rates.
    limits : (4, n) array
        Limits of `QUANTITIES`; 0 belongs to a joint that does not move.
    points : ControllerPoints
        The points.

    """

    def __init__(self, robot: Robot, limits: Array, points: ControllerPoints) -> None:
        """Compute the torques at the points."""
        self.n, self.kernel = robot.n, peaks_kernel(robot)
        self.factors = 1.0 / np.maximum(limits, SMALLEST)
        torque = robot.kernels.quantity('inverse_dynamics')
        states = [points.q, points.u, points.udot]
        self.tau = np.empty(points.q.shape)
        _require_finite(torque.run([*states, *torque.defaults], self.tau, len(self.tau)))
        rows = [*states, self.tau]
        self.ends = [*rows, *(each[1:] for each in rows), points.t[1:] - points.t[:-1]]

    def middles(self) -> Peaks:
        """Return the shares at both ends and the middle of all segments."""
        return self._peaks(np.array(0.5))

    def inside(self, segments: Segments, places: NDArray[np.intp]) -> Array:
        """
        Return the largest shares in some segments, (S, 4, n).

        Parameters
        ----------
        segments : (S,) array of int
            Numbers of the segments.
        places : (S,) array of int
            Numbers of places between the ends of each segment, at least 1.

        """
        begins = np.cumsum(places) - places
        own = np.repeat(np.arange(len(segments)), places)
        x = (1.0 + np.arange(len(own)) - begins[own]) / (1.0 + places[own])
        found = self._peaks(x, segments[own])
        return np.asarray(np.maximum.reduceat(found.shares, begins))

    def _peaks(self, x: Array, segments: Segments | None = None) -> Peaks:
        """Return the shares at one place in all segments, or at a place in each of some."""
        count, numbers = len(self.tau) - 1, {}
        if segments is not None:
            count, numbers = len(segments), dict.fromkeys(
                (each.name for each in self.kernel.arguments[:len(self.ends)]), segments)
        rows = np.empty((count, *self.kernel.shape))
        _require_finite(self.kernel.run([*self.ends, x, self.factors], rows, count, numbers))
        return Peaks(rows[:, :-3].reshape(len(rows), -1, self.n), *rows[:, -3:].T)


def _require_finite(flags: int) -> None:
    if flags:
        raise InputError('path: the torques along it are not finite; expected a path with '
                         'finite torques')
