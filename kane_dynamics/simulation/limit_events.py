"""Limit events: crossings of joint limits in a simulation."""

from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.observers import Chunk, Observer
from kane_dynamics.simulation.trajectory import LimitEvent
import numpy as np

MOST_EVENTS = 1_000_000
STATES_OF_ROW = 64


class _Bound(NamedTuple):
    """
    The bounds of one kind of limit.

    Attributes
    ----------
    limit : str
        As in `LimitEvent`.
    names : sequence of str
        The joints.
    part : slice
        The bounded entries of a state.
    lower, upper : arrays
        Infinite where there is no limit.

    """

    limit: str
    names: tuple[str, ...]
    part: slice
    lower: Array
    upper: Array


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
        limits = robot.limits
        self._single = single
        self._events: list[LimitEvent] = []
        bounds = []
        # Stops turn crossings of position limits into events of their own.
        if not stops:
            names, q = robot.coordinate_names, slice(0, n_q)
            none = np.full(n_q, np.inf)
            bounds.append(_Bound('lower', names, q, limits.lower, none))
            bounds.append(_Bound('upper', names, q, -none, limits.upper))
        # Limits of speeds are those of joints, so that only joint rates can cross them.
        if robot.equations.speed_names == robot.joint_names:
            bounds.append(_Bound('velocity', robot.joint_names, slice(n_q, n_q + robot.n),
                                 -limits.velocity, limits.velocity))
        # Each with which entries are beyond it, (N, n), in the last state.
        self._watched: list[tuple[_Bound, Any]] = []
        for bound in bounds:
            if np.isfinite([bound.lower, bound.upper]).any():
                self._watched.append((bound, np.zeros((count, len(bound.names)), dtype=bool)))

    @property
    def events(self) -> tuple[LimitEvent, ...]:
        """Return the events so far, in the order of time."""
        return tuple(sorted(self._events, key=lambda event: event.t))

    def look(self, chunk: Chunk) -> None:
        """
        Add the crossings among the states after each step, and initial ones beyond a limit.

        Raises
        ------
        InputError
            There are more than a million crossings.

        """
        # The first state of a chunk is the last one of the chunk before, if there is one.
        begin = min(chunk.done, 1)
        times = chunk.times[begin:]
        states = chunk.states[:, begin:]
        low = _over_all(np.minimum, np.inf, states)
        high = _over_all(np.maximum, -np.inf, states)
        for bound, was_beyond in self._watched:
            within = ((low[bound.part] >= bound.lower).all()
                      and (high[bound.part] <= bound.upper).all())
            if within and not was_beyond.any():
                continue
            x = states[..., bound.part]
            beyond = (x < bound.lower) | (x > bound.upper)
            # A crossing is a state beyond the limit after one that is not.
            before = np.concatenate([was_beyond[:, None], beyond[:, :-1]], axis=1)
            was_beyond[:] = beyond[:, -1]
            crossings = np.argwhere(beyond & ~before)
            if len(self._events) + len(crossings) > MOST_EVENTS:
                raise InputError(f'limit events: more than {MOST_EVENTS} by '
                                 f'{times[-1]:.6g} s; expected a shorter simulation, or a '
                                 'model without limits')
            for i, k, j in crossings.tolist():
                limit = bound.lower[j] if bound.limit == 'lower' else bound.upper[j]
                self._events.append(LimitEvent(
                    float(times[k]), bound.names[j], bound.limit, float(x[i, k, j]),
                    float(limit), None if self._single else i))


def _over_all(compare: Any, initial: float, states: Array) -> Array:
    """Return the least or largest value of each entry over states, (N, K, size)."""
    # NumPy compares long rows several times faster than short ones.
    size = states.shape[2]
    numbers = states.reshape(-1)
    row = STATES_OF_ROW * size
    in_rows = len(numbers) // row * row
    long_rows = numbers[:in_rows].reshape(-1, row)
    of_rows = compare.reduce(long_rows, axis=0, initial=initial).reshape(-1, size)
    others = numbers[in_rows:].reshape(-1, size)
    result: Array = compare.reduce([*of_rows, *others], axis=0)
    return result
