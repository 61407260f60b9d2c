"""
Largest fractions of the joint limits that a motion takes, also between its points.

A share is such a fraction: 1 is at the limit. Between two points the driving joints move
along a quintic. Shares are computed at both ends and in the middle of every segment, and
at more places of those segments in which one may exceed its limit. For trees one compiled
kernel does it all. With chosen speeds or constraints the loops are closed at each place,
in blocks of places.
"""

from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

from kane_dynamics._util.typing import Array, Flags, Matrix, Scalar, Vector
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.choice import largest, select
from kane_dynamics.motion.controller_points import Segments
from kane_dynamics.native.runtime.kernel import batch_kernel, Kernel
from kane_dynamics.robot.kernel_set import kernel_per_robot
from kane_dynamics.robot.robot import Robot
import numpy as np

SMALLEST = 1e-300  # limit
QUANTITIES = ('effort', 'velocity', 'power', 'acceleration')
ALWAYS = 2  # of these quantities, the first ones, are computed even where unlimited
# Within a segment a share exceeds the largest of its values at both ends and in the
# middle by at most these parts of their range and of their second difference, about. A
# parabola does so by at most an eighth of the second difference.
RANGE, BEND = 0.15, 0.2
CHANGING = 0.005  # range of a share in a segment from which it counts between the places
# Places in a segment: as many where friction changes, and times the root of the range
# elsewhere.
DENSE, SMOOTH = 200.0, 60.0
MARGIN = 5e-4  # of all limits, for the motion between the points
ACTIVE = 1.0 - 0.5 * MARGIN  # share from which a limit is tightened
MIDDLE = np.array(0.5)  # place in a segment
BLOCK = 1024  # places of a mechanism computed together, for arrays that fit the caches
STATE = ('q', 'u', 'udot', 'tau')

# Returns q, q', q'' and torques of all joints for nearly closed configurations, and
# rates and accelerations of the driving joints.
States = Callable[[Array, Array, Array], tuple[Array, Array, Array, Array]]


class MotionStates(NamedTuple):
    """
    States at P points of a motion, and the times between them, which are segments.

    Attributes
    ----------
    rows : (P, 4 n + 1) array
        q, u, udot, the time to the next point, s, and the torques of each point.
    n : int
        Number of joints.

    """

    rows: Array
    n: int

    @classmethod
    def of(cls, q: Array, u: Array, udot: Array, tau: Array, h: Array) -> 'MotionStates':
        """Return the states (P, n) at points with times (P - 1,) between them."""
        times = np.append(h, 0.0)
        return cls(np.column_stack([q, u, udot, times, tau]), q.shape[1])

    @property
    def u(self) -> Array:
        """Return the velocities, (P, n)."""
        return self.rows[:, self.n:2 * self.n]

    @property
    def h(self) -> Array:
        """Return the times between the points, (P - 1,), s."""
        return self.rows[:-1, 3 * self.n]

    @property
    def state(self) -> tuple[Array, Array, Array, Array]:
        """Return q, u, udot and the torques, (P, n) each."""
        return _state(self.rows, self.n)


def _state(rows: Array, n: int) -> tuple[Array, Array, Array, Array]:
    """Return q, u, udot and the torques of one or more rows of `MotionStates`."""
    return (rows[..., :n], rows[..., n:2 * n], rows[..., 2 * n:3 * n],
            rows[..., 3 * n + 1:])


class Peaks(NamedTuple):
    """
    Largest shares of limits at both ends of segments and at one place between.

    Attributes
    ----------
    shares : (S, k, n) array
        Shares of the limits of `SegmentPeaks.quantities`; 0 for infinite limits.
    largest : (S,) array
        The largest of them.
    places : (S,) array
        Number of places between the ends at which a smooth share is found to 3e-4 of its
        limit, by the largest range of a share that, by its estimate, may exceed it.
    estimate : (S,) array
        Largest share that is expected within the segment.

    """

    shares: Array
    largest: Array
    places: Array
    estimate: Array


class SegmentPeaks:
    """
    Shares of limits in the segments between points, where the motion is a quintic.

    Parameters
    ----------
    robot : Robot
        The robot.
    limits : (4, n) array
        Limits of `QUANTITIES`; 0 belongs to a joint that does not move.
    states : callable, optional
        `States` of a robot with chosen speeds or constraints.
    driving : sequence of int
        Indices of the driving joints of such a robot.

    Attributes
    ----------
    quantities : tuple of int
        The k quantities of which shares are computed, as places in `QUANTITIES`.
    driving : list of int
        Indices of the driving joints; empty for a tree.

    """

    def __init__(self, robot: Robot, limits: Array, states: States | None = None,
                 driving: Sequence[int] = ()) -> None:
        self.n = limits.shape[1]
        self.quantities = limited_quantities(limits)
        # Shares are values times the inverse limits, so that an infinite limit is never
        # used.
        self._factors = 1.0 / np.maximum(limits[self.quantities, :], SMALLEST)
        self._states = states
        self.driving = list(driving)
        # Trees compute their torques in the kernel; closed loops get them by `states`.
        if states is None:
            self._kernel = peaks_kernel(robot, self.quantities)
            self._robot = robot
        else:
            self._kernel = shares_kernel(self.n, self.quantities)

    def torques(self, q: Array, u: Array, udot: Array) -> Array:
        """Return the torques at points, (P, n)."""
        if self._states is not None:
            return self._states(q, u[:, self.driving], udot[:, self.driving])[3]
        tau = np.empty((len(q), self.n))
        kernel = self._robot.kernels.kernel('inverse_dynamics')
        require_finite_flags(kernel.run([q, u, udot, *kernel.defaults], tau, len(q)))
        return tau

    def at(self, states: MotionStates, x: Array, segments: Segments | None = None) -> Peaks:
        """
        Return the shares of the limits at both ends of segments and at a place x in each.

        `x` is one for all segments, such as `MIDDLE`, or one for each of some.
        """
        count = len(states.h) if segments is None else len(segments)
        table = np.empty((count, *self._kernel.shape))
        # Trees by the compiled table; closed loops need the states on both sides, block
        # by block.
        if self._states is None:
            self._compiled(states, x, segments, table)
        else:
            numbers = np.arange(count) if segments is None else segments
            places = np.broadcast_to(x, count)
            for begin in range(0, count, BLOCK):
                block = slice(begin, begin + BLOCK)
                self._closed(self._states, states, places[block], numbers[block],
                             table[block])
        shares = table[:, :-3].reshape(count, len(self.quantities), self.n)
        return Peaks(shares, *table.T[-3:])

    def inside(self, states: MotionStates, segments: Segments, places: Segments,
               least: float = 0.0) -> tuple[Array, Segments, Array]:
        """
        Return the largest shares in some segments, at places between their ends.

        Parameters
        ----------
        states : MotionStates
            The points.
        segments : (S,) array of int
            Numbers of the segments.
        places : (S,) array of int
            Numbers of places between the ends of each segment, at least 1.
        least : float
            Largest share in a segment from which its shares are needed.

        Returns
        -------
        largest : (S,) array
            The largest share in each segment.
        needed : (P,) array of int
            The rows of `segments` whose shares are needed.
        shares : (P, k, n) array
            The largest shares of these.

        """
        ends = places.cumsum()
        begins = ends - places
        # All places of all segments are rows of one batch.
        # A place for each row: the places of a segment are at equal distances.
        first = (begins - 1.0).repeat(places)
        step = (1.0 / (1.0 + places)).repeat(places)
        x = (np.arange(ends[-1]) - first) * step
        peaks = self.at(states, x, segments.repeat(places))
        # The largest share of each segment; details only of those that may decide.
        worst = np.maximum.reduceat(peaks.largest, begins)
        is_needed = worst >= least
        needed = is_needed.nonzero()[0]
        shares = np.empty((0, *peaks.shares.shape[1:]))
        if needed.size:
            counts = places[needed]
            rows = peaks.shares[is_needed.repeat(places)]
            shares = np.maximum.reduceat(rows, counts.cumsum() - counts)
        return worst, needed, shares

    def _compiled(self, states: MotionStates, x: Array, segments: Segments | None,
                  table: Array) -> None:
        """Write the rows of `peaks_kernel` of a tree."""
        numbers = {}
        if segments is not None:
            numbers = {'begin': segments, 'end': segments}
        inputs = [states.rows, states.rows[1:], x, self._factors]
        require_finite_flags(self._kernel.run(inputs, table, len(table), numbers))

    def _closed(self, states_of: States, states: MotionStates, x: Array,
                segments: Segments, table: Array) -> None:
        """Write the rows of `shares_kernel` of a robot whose loops are to be closed."""
        rows = states.state
        begin = [row[segments] for row in rows]
        end = [row[segments + 1] for row in rows]
        near, u, udot = quintic(begin, end, states.h[segments, None], x[:, None])
        inside = states_of(near, u[:, self.driving], udot[:, self.driving])
        # Columns that were chosen are contiguous, rows are asked for.
        rows_inside = map(np.ascontiguousarray, inside)
        inputs = [*begin, *end, *rows_inside, self._factors]
        require_finite_flags(self._kernel.run(inputs, table, len(table)))


def limited_quantities(limits: Array) -> tuple[int, ...]:
    """Return the quantities whose shares are computed for limits (4, n)."""
    limited: Flags = np.asarray(np.isfinite(limits).any(axis=1))
    limited[:ALWAYS] = True
    return tuple(limited.nonzero()[0].tolist())


@kernel_per_robot
def peaks_kernel(robot: Robot, quantities: tuple[int, ...]) -> Kernel:
    """
    Return the kernel of `Peaks` of a segment of a tree, (k n + 3,).

    Its arguments are the rows of `MotionStates` at the start and at the end of the
    segment, the place x in it from 0 to 1, and the reciprocal limits (k, n) of the
    quantities.
    """
    n = robot.n

    def values(first: Vector, last: Vector, x: Scalar, factors: Matrix,
               parameters: Vector) -> Vector:
        begin = _state(first, n)
        end = _state(last, n)
        q, u, udot = quintic(begin[:3], end[:3], first[3 * n], x)
        tau = robot.equations.inverse_dynamics(q, u, udot, None, parameters)
        return largest_shares_of(quantities, begin, end, (q, u, udot, tau), factors)
    inputs = {'begin': (4 * n + 1,), 'end': (4 * n + 1,), 'x': (),
              'factors': (len(quantities), n)}
    return robot.kernels.compiled(values, 'shares', inputs,
                                  (len(quantities) * n + 3,), ahead=False)


@cache
def shares_kernel(n: int, quantities: tuple[int, ...]) -> Kernel:
    """Return the kernel of `largest_shares_of`, for states at the three places."""
    inputs: list[tuple[str, tuple[int, ...]]] = []
    for place in (0, 1, 'x'):
        for name in STATE:
            inputs.append((f'{name}_{place}', (n,)))
    inputs.append(('factors', (len(quantities), n)))

    def values(*arguments: Matrix) -> Vector:
        # Four quantities of each state.
        begin = arguments[:4]
        end = arguments[4:8]
        inside = arguments[8:12]
        return largest_shares_of(quantities, begin, end, inside, arguments[12])
    return batch_kernel('shares_of_states', values, inputs, (len(quantities) * n + 3,))


def largest_shares_of(quantities: Sequence[int], begin: Sequence[Vector],
                      end: Sequence[Vector], inside: Sequence[Vector], factors: Matrix
                      ) -> Vector:
    """
    Return the content of `Peaks` as one array, for one segment of a motion.

    `begin`, `end` and `inside` are the states (q, u, udot, tau) at its ends and at a place
    between. The array has the k n shares, the largest one, the number of places and the
    largest estimate, in this order.
    """
    # The share of a limit is the magnitude times the factor 1 / limit, at both ends and
    # in the middle.
    shares = []
    for _, u, udot, tau in (begin, end, inside):
        values = tau, u, tau * u, udot  # in the order of `QUANTITIES`
        used = [values[quantity] for quantity in quantities]
        shares.append(np.ravel(used) * np.ravel(factors))
    peaks, changes, estimates = [], [], []
    for first, last, middle in zip(*shares):
        high = largest([first, last, middle])
        low = -largest([-first, -last, -middle])
        # Three values bound the peak between them only if they are nearly on a line: a
        # change or a bend adds to the estimate.
        peak = largest([high, -low])
        change = high - low
        bend = first + last - 2.0 * middle
        beyond = RANGE * change + BEND * select(bend < 0.0, -bend, bend)
        estimate = peak + select(change > CHANGING, beyond, 0.0)
        peaks.append(peak)
        changes.append(select(estimate > 1.0, change, 0.0))
        estimates.append(estimate)
    # More places where the shares change more, since the error falls with their square.
    places = 1.0 + SMOOTH * np.sqrt(largest(changes))
    places = select(places < DENSE, places, DENSE)
    return np.array([*peaks, largest(peaks), places, largest(estimates)])


def quintic(begin: Sequence[Vector], end: Sequence[Vector], h: Scalar, x: Scalar
            ) -> tuple[Vector, Vector, Vector]:
    """Return q, u and udot at a place of the quintic between two states."""
    u = h * begin[1]
    udot = h * h * begin[2]
    # What the cubic and higher terms must add at the end to q, u and udot.
    rise = end[0] - begin[0] - u - 0.5 * udot
    slope = h * end[1] - u - udot
    bend = h * h * end[2] - udot
    # Coefficients of x^3, x^4 and x^5 that meet all three conditions at x = 1.
    a = 10.0 * rise - 4.0 * slope + 0.5 * bend
    b = -15.0 * rise + 7.0 * slope - bend
    c = 6.0 * rise - 3.0 * slope + 0.5 * bend
    q = begin[0] + x * (u + x * (0.5 * udot + x * (a + x * (b + x * c))))
    rate = u + x * (udot + x * (3.0 * a + x * (4.0 * b + x * (5.0 * c))))
    change = udot + x * (6.0 * a + x * (12.0 * b + x * (20.0 * c)))
    # From the fraction x of the segment back to seconds.
    r = 1.0 / h
    return q, rate * r, change * (r * r)


def require_finite_flags(flags: int) -> None:
    """Raise InputError for flags of a kernel that tell of a number that is not finite."""
    if flags:
        raise InputError('path: the torques along it are not finite; expected a path '
                         'with finite torques')
