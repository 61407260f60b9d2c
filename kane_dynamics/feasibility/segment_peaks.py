"""Largest shares of torque, speed, power and acceleration limits in quintic segments."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.motion.controller_points import Segments
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.robot import Robot
import numpy as np

SMALLEST = 1e-300  # limit
QUANTITIES = ('effort', 'velocity', 'power', 'acceleration')
# Within a segment a share exceeds the largest of its values at both ends and in the middle by at
# most these parts of their range and of their second difference, about. A parabola does so by at
# most an eighth of the second difference.
RANGE, BEND = 0.15, 0.2
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
    n = robot.n
    states = [name + end for end in ('_0', '_1') for name in ('q', 'u', 'udot', 'tau')]

    def values(*inputs: Any, parameters: Any) -> Any:
        begin, end = inputs[:4], inputs[4:8]
        h, x, factors = inputs[8:]
        q, u, udot = quintic(begin[:3], end[:3], h, x)
        tau = robot.equations.inverse_dynamics(q, u, udot, None, parameters)
        shares = [np.ravel([state[3], state[1], state[3] * state[1], state[2]])
                  * np.ravel(factors) for state in (begin, end, (q, u, udot, tau))]
        peaks, changes, estimates = [], [], []
        for row in zip(*shares):
            high, low = largest(row), -largest([-share for share in row])
            peak, change = largest([high, -low]), high - low
            bend = row[0] + row[1] - 2.0 * row[2]
            beyond = RANGE * change + BEND * select(bend < 0.0, -bend, bend)
            estimate = peak + select(change > CHANGING, beyond, 0.0)
            peaks.append(peak)
            changes.append(select(estimate > 1.0, change, 0.0))
            estimates.append(estimate)
        return np.array([*peaks, largest(peaks), largest(changes), largest(estimates)])
    return robot.compiled(values, name='shares', **dict.fromkeys(states, (n,)), h=(), x=(),
                          factors=(len(QUANTITIES), n), shape=(len(QUANTITIES) * n + 3,))


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


class MotionStates(NamedTuple):
    """States of a motion at P points, and the times between them, which delimit segments."""

    q: Array  # (P, n)
    u: Array
    udot: Array
    tau: Array
    h: Array  # (P - 1,), s


class SegmentPeaks:
    """
    Shares of limits in the segments between points, where the motion is a quintic.

    Parameters
    ----------
    robot : Robot
        A robot in joint rates.
    limits : (4, n) array
        Limits of `QUANTITIES`; 0 belongs to a joint that does not move.

    """

    def __init__(self, robot: Robot, limits: Array) -> None:
        self.n = robot.n
        self._kernel = peaks_kernel(robot)
        self._torque = robot.kernels.quantity('inverse_dynamics')
        self.factors = 1.0 / np.maximum(limits, SMALLEST)

    def torques(self, q: Array, u: Array, udot: Array) -> Array:
        """Return the torques at points, (P, n)."""
        kernel = self._torque
        tau = np.empty((len(q), self.n))
        _require_finite(kernel.run([q, u, udot, *kernel.defaults], tau, len(q)))
        return tau

    def middles(self, states: MotionStates, segments: Segments | None = None) -> Peaks:
        """Return the shares at both ends and in the middle of all segments, or of some."""
        return self._peaks(states, np.array(0.5), segments)

    def inside(self, states: MotionStates, segments: Segments, places: Segments) -> Array:
        """
        Return the largest shares in some segments, (S, 4, n).

        Parameters
        ----------
        states : MotionStates
            The points.
        segments : (S,) array of int
            Numbers of the segments.
        places : (S,) array of int
            Numbers of places between the ends of each segment, at least 1.

        """
        ends = places.cumsum()
        begins = ends - places
        first, step = np.repeat([begins - 1.0, 1.0 / (1.0 + places)], places, axis=1)
        x = (np.arange(ends[-1]) - first) * step
        peaks = self._peaks(states, x, segments.repeat(places))
        return np.asarray(np.maximum.reduceat(peaks.shares, begins))

    def _peaks(self, states: MotionStates, x: Array, segments: Segments | None) -> Peaks:
        """Return the shares at one place in all segments, or at a place in each of some."""
        kernel = self._kernel
        *rows, h = states
        ends = [*rows, *(row[1:] for row in rows), h]
        if segments is None:
            count, numbers = len(h), {}
        else:
            count = len(segments)
            numbers = {argument.name: segments for argument in kernel.arguments[:len(ends)]}
        table = np.empty((count, *kernel.shape))
        _require_finite(kernel.run([*ends, x, self.factors], table, count, numbers))
        return Peaks(table[:, :-3].reshape(count, -1, self.n), *table[:, -3:].T)


def _require_finite(flags: int) -> None:
    if flags:
        raise InputError('path: the torques along it are not finite; expected a path with '
                         'finite torques')
