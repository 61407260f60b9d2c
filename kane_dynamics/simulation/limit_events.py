"""Limit events: crossings of joint limits in a simulation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import repeat
from operator import itemgetter
from typing import Any, NamedTuple

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.observers import Chunk, Observer
from kane_dynamics.simulation.trajectory import LimitEvent
import numpy as np

MOST_EVENTS = 1_000_000


class _Bound(NamedTuple):
    """
    The bounds of one kind of limit.

    Attributes
    ----------
    part : slice
        The bounded entries of a state.
    bound : array
        Infinite where there is no limit.
    sign : float
        1 and -1 for upper and lower limits, 0 for limits of the magnitude.

    """

    part: slice
    bound: Array
    sign: float

    def is_beyond(self, x: Array, bound: Array) -> Any:
        """Return which entries of x are beyond bounds."""
        if self.sign == 0.0:
            return np.abs(x) > bound
        return x > bound if self.sign > 0.0 else x < bound

    def may_pass(self, low: Array, high: Array, was_beyond: Any) -> Any:
        """Return which entries may have passed their bound, by their least and largest values."""
        bound = self.bound
        # Of a magnitude: passed from inside, unless all states were already beyond.
        if self.sign == 0.0:
            stays_beyond = ((low > bound) | (high < -bound)) & was_beyond
            return (np.maximum(high, -low) > bound) & ~stays_beyond
        # A lower limit is an upper limit of the negative.
        largest, least = (high, low) if self.sign > 0.0 else (-low, -high)
        stays_beyond = (least > self.sign * bound) & was_beyond
        return (largest > self.sign * bound) & ~stays_beyond


class Crossings(NamedTuple):
    """Crossings of one limit: (M,) times, simulations, joints, values and bounds."""

    limit: str
    t: Array
    which: Any
    joint: Any
    value: Array
    bound: Array


@dataclass(frozen=True, eq=False, repr=False)
class LimitEvents(Sequence[LimitEvent]):
    """
    The events of a `LimitWatch`, in the order of time.

    The objects are created on first access, because a simulation may have thousands.
    """

    _names: Mapping[str, Sequence[str]]  # of the joints, by limit
    _crossings: tuple[Crossings, ...]
    _single: bool

    @lazy_property
    def _events(self) -> tuple[LimitEvent, ...]:
        events: list[LimitEvent] = []
        for limit, t, which, joint, value, bound in self._crossings:
            names = self._names[limit]
            simulations = repeat(None) if self._single else which.tolist()
            events += map(LimitEvent, t.tolist(), map(names.__getitem__, joint.tolist()),
                          repeat(limit), value.tolist(), bound.tolist(), simulations)
        return tuple(sorted(events, key=itemgetter(0)))

    def __len__(self) -> int:
        """Return the number of events."""
        return sum(len(crossings.t) for crossings in self._crossings)

    def __getitem__(self, index: Any) -> Any:
        """Return an event, or those of a slice."""
        return self._events[index]

    def __eq__(self, other: object) -> bool:
        """Return whether a sequence has the same events."""
        return isinstance(other, Sequence) and self._events == tuple(other)

    __hash__ = None  # type: ignore[assignment]


class LimitWatch(Observer):
    """
    Detects the steps at which a joint passes a limit.

    Speed limits are checked of robots in joint rates only; position limits only without
    stops.

    Parameters
    ----------
    robot : Robot
    count : int
        Number of simulations.
    single : bool
        Leave out the number of the simulation in events.
    stops : bool
        Whether there are stops at the position limits.

    """

    def __init__(self, robot: Robot, count: int, single: bool, stops: bool) -> None:
        """Begin without events."""
        n_q = robot.n_q
        coordinates = robot.coordinate_names
        self._names = {'lower': coordinates, 'upper': coordinates,
                       'velocity': robot.joint_names}
        self._single = single
        self._crossings: list[Crossings] = []
        self._count = 0
        limits, bounds = robot.limits, {}
        # Stops turn crossings of position limits into events of their own.
        if not stops:
            bounds['lower'] = _Bound(slice(0, n_q), limits.lower, -1.0)
            bounds['upper'] = _Bound(slice(0, n_q), limits.upper, 1.0)
        # Limits of speeds are those of joints, so that only joint rates can cross them.
        if robot.equations.speed_names == robot.joint_names:
            bounds['velocity'] = _Bound(slice(n_q, n_q + robot.n), limits.velocity, 0.0)

        # Only what has a finite limit is looked at.
        self._bounds = {limit: bound for limit, bound in bounds.items()
                        if np.isfinite(bound.bound).any()}
        self._beyond = {limit: np.zeros((count, len(bound.bound)), dtype=bool)
                        for limit, bound in self._bounds.items()}
        # The range of each entry of q and u: most chunks stay within it.
        self._lowest = np.full(n_q + robot.n, -np.inf)
        self._highest = np.full(n_q + robot.n, np.inf)
        for bound in self._bounds.values():
            if bound.sign == 0.0:
                self._lowest[bound.part] = -bound.bound
            if bound.sign < 0.0:
                self._lowest[bound.part] = bound.bound
            else:
                self._highest[bound.part] = bound.bound

    @property
    def events(self) -> LimitEvents:
        """Return the events so far."""
        return LimitEvents(self._names, tuple(self._crossings), self._single)

    def look(self, chunk: Chunk) -> None:
        """
        Add the crossings among the states after each step, and initial ones beyond a limit.

        Raises
        ------
        InputError
            There are more than a million crossings.

        """
        if not self._bounds:
            return
        low, high = chunk.extremes
        # The first state of a chunk is the last one of the chunk before, if there is one.
        begin = 1
        if chunk.done == 0:
            begin = 0
            initial = chunk.states[:, 0]
            low, high = np.minimum(low, initial), np.maximum(high, initial)
        was_within = not any(beyond.any() for beyond in self._beyond.values())
        if was_within and self._stays_within(low, high):
            return
        t = chunk.times[begin:]
        rows = np.moveaxis(chunk.states[:, begin:], 2, 1)  # one row for each entry
        for limit, bound in self._bounds.items():
            x, was_beyond = rows[:, bound.part], self._beyond[limit]
            i, j = np.nonzero(bound.may_pass(low[:, bound.part], high[:, bound.part],
                                             was_beyond))
            self._beyond[limit] = bound.is_beyond(x[:, :, -1], bound.bound)
            if not len(i):
                continue
            # A crossing is a state beyond the limit after one that is not.
            beyond = np.empty((len(i), x.shape[2] + 1), dtype=bool)
            beyond[:, 0] = was_beyond[i, j]
            beyond[:, 1:] = bound.is_beyond(x[i, j], bound.bound[j, None])
            crossed = beyond[:, 1:] > beyond[:, :-1]
            # np.nonzero takes ten times as long.
            which, k = np.divmod(np.flatnonzero(crossed), crossed.shape[1])
            i, j = i[which], j[which]
            self._count += len(k)
            if self._count > MOST_EVENTS:
                raise InputError(f'limit events: more than {MOST_EVENTS} by {t[-1]:.6g} '
                                 's; expected a shorter simulation, or a model without '
                                 'limits')
            if len(k):
                self._crossings.append(Crossings(limit, t[k], i, j, x[i, j, k],
                                                 bound.bound[j]))

    def _stays_within(self, low: Array, high: Array) -> bool:
        """Return whether all states are within the limits, by least and largest entries."""
        entries = len(self._lowest)
        is_within = ((low[:, :entries] >= self._lowest).all()
                     and (high[:, :entries] <= self._highest).all())
        return bool(is_within)
