"""Largest shares of torque, speed, power and acceleration limits in quintic segments."""

from collections.abc import Sequence
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.motion.controller_points import ControllerPoints, Segments
from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.runtime.batch_loop import run_batch, Strided
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import trace_program
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import NDArray

SMALLEST = 1e-300  # limit
STEPS = 4  # places of one state of a batch
QUANTITIES = ('effort', 'velocity', 'power', 'acceleration')


def peaks_kernel(robot: Robot, names: Sequence[str]) -> Kernel:
    """
    Return the kernel of shares of limits of some of `QUANTITIES`, (len(names), n), in a segment.

    Its arguments are the positions, velocities and accelerations (n,) at the start and at the end
    of the segment, its duration, s, the place x in it from 0 to 1, and the reciprocal limits.
    """
    name, block, n = '_'.join(('shares', *names)), robot.parameters.block, robot.n
    inputs: list[tuple[str, tuple[int, ...]]] = [
        *((each + end, (n,)) for end in ('_0', '_1') for each in ('q', 'u', 'udot')),
        ('h', ()), ('x', ()), ('factors', (len(names), n))]

    def values(*given: Any) -> Any:
        ends, (h, x, factors, parameters) = given[:6], given[6:]
        q, u, udot = _quintic(ends[:3], ends[3:], h[()], x[()])
        tau = robot.equations.inverse_dynamics(q, u, udot, None, parameters)
        found = {'effort': tau, 'velocity': u, 'power': tau * u, 'acceleration': udot}
        return np.array([found[name] for name in names]) * factors
    return robot.kernels.extra(
        name, lambda: trace_program(name, values, [*inputs, ('parameters', block.shape)]),
        [Argument(*each) for each in inputs], block, (len(names), n))


def _quintic(begin: Sequence[Any], end: Sequence[Any], h: Any, x: Any) -> tuple[Any, Any, Any]:
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


def segment_peaks(robot: Robot, limits: dict[str, Array], points: ControllerPoints,
                  segments: Segments, places: NDArray[np.intp]) -> Array:
    """
    Return the largest shares of limits in segments, (S, len(limits) n).

    Parameters
    ----------
    robot : Robot
        A robot in joint rates.
    limits : dict of (n,) arrays
        Limits of some of `QUANTITIES`; a limit of 0 belongs to a joint that does not move.
    points : ControllerPoints
        The points between which the segments are.
    segments : (S,) array of int
        Numbers of the segments.
    places : (S,) array of int
        Least numbers of places in each segment at which the shares are computed, at least 2.

    """
    # Every state of the batch takes a few places of one segment.
    states = -(-places // STEPS)
    begins = np.cumsum(states) - states
    own = np.repeat(np.arange(len(segments)), states)
    number = STEPS * (np.arange(len(own)) - begins[own])
    x = (number[:, None] + np.arange(STEPS)) / (STEPS * states[own, None] - 1.0)
    begin = segments[own]
    ends = [each[k] for k in (begin, begin + 1) for each in points[1:]]
    low, high, _ = _extremes(robot, limits, [*ends, np.diff(points.t)[begin]], x)
    return np.asarray(np.maximum.reduceat(np.maximum(high, -low), begins))


def coarse_peaks(robot: Robot, limits: dict[str, Array], points: ControllerPoints
                 ) -> tuple[Array, Array]:
    """
    Return the largest shares at the points and the middles of all segments, with their ranges.

    Both are (K - 1, len(limits) n); the end of the last segment is left out. The arguments are
    those of `segment_peaks`.
    """
    rows = [np.ascontiguousarray(each) for each in points[1:]]
    low, high, start = _extremes(
        robot, limits, [*rows, *(each[1:] for each in rows), np.diff(points.t)],
        np.broadcast_to([0.5, 0.0], (len(points.t) - 1, 2)))
    # The end of a segment is the start of the next one.
    np.minimum(low[:-1], start[1:], out=low[:-1])
    np.maximum(high[:-1], start[1:], out=high[:-1])
    return np.maximum(high, -low), high - low


def _extremes(robot: Robot, limits: dict[str, Array], ends: Sequence[Array], x: Array
              ) -> tuple[Array, Array, Array]:
    """
    Return the least, the largest and the last shares of limits in segments.

    Parameters
    ----------
    robot : Robot
        A robot in joint rates.
    limits : dict of (n,) arrays
        Limits of some of `QUANTITIES`.
    ends : seven arrays
        Positions, velocities and accelerations at both ends of segments, and their durations.
    x : (S, m) array
        Places in each segment.

    """
    kernel = peaks_kernel(robot, list(limits))
    factors = 1.0 / np.maximum(list(limits.values()), SMALLEST)
    count = len(ends[-1])
    low = np.full((count, factors.size), np.inf)
    high, last = np.full_like(low, -np.inf), np.empty_like(low)
    parameters = kernel.parameters.copy()
    table = [*(Strided(each.ctypes.data, each.strides[0]) for each in ends),
             Strided(x.ctypes.data, *x.strides), Strided(factors.ctypes.data),
             Strided(parameters.ctypes.data), Strided(last.ctypes.data, last.strides[0])]
    if run_batch(kernel.lane_address, table, count, steps=x.shape[1], extremes=(low, high)):
        raise InputError('path: the torques along it are not finite; expected a path with '
                         'finite torques')
    return low, high, last
