"""Limit events: crossings of joint limits in a simulation."""

from collections.abc import Mapping, Sequence
from itertools import repeat
from operator import itemgetter
from typing import Any, NamedTuple

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.robot.parameters import JointLimits
from kane_dynamics.simulation.trajectory import LimitEvent
import numpy as np

MOST_EVENTS = 1_000_000

Extremes = tuple[Array, Array]


class Crossings(NamedTuple):
    """Crossings of one limit: (M,) times, simulations, joints, values and bounds."""

    limit: str
    t: Array
    which: Any
    joint: Any
    value: Array
    bound: Array


class LimitEvents(Sequence[LimitEvent]):
    """
    The events of a `LimitWatch`, in the order of time.

    The objects are created on first access, because a simulation may have thousands.
    """

    def __init__(self, names: Mapping[str, Sequence[str]], found: Sequence[Crossings],
                 single: bool) -> None:
        self._names, self._found, self._single = names, tuple(found), single

    @lazy_property
    def _events(self) -> tuple[LimitEvent, ...]:
        events: list[LimitEvent] = []
        for limit, t, which, joint, value, bound in self._found:
            names = self._names[limit]
            events += map(LimitEvent, t.tolist(), map(names.__getitem__, joint.tolist()),
                          repeat(limit), value.tolist(), bound.tolist(),
                          repeat(None) if self._single else which.tolist())
        return tuple(sorted(events, key=itemgetter(0)))

    def __len__(self) -> int:
        return sum(len(crossings.t) for crossings in self._found)

    def __getitem__(self, index: Any) -> Any:
        return self._events[index]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and self._events == tuple(other)

    __hash__ = None  # type: ignore[assignment]


class LimitWatch:
    """
    Detects the steps at which a joint passes a limit.

    Parameters
    ----------
    joint_names : sequence of str
        Names of the speeds and, by default, of the positions.
    limits : JointLimits
    states : (N, 2 n) array
        Initial states; values beyond a limit are events.
    single : bool
        Leave out the number of the simulation in events.
    coordinate_names : sequence of str, optional
        Names of the entries of q, if they are others.

    """

    def __init__(self, joint_names: Sequence[str], limits: JointLimits, states: Array,
                 single: bool, coordinate_names: Sequence[str] | None = None) -> None:
        self._found: list[Crossings] = []
        self._count = 0
        coordinates = joint_names if coordinate_names is None else coordinate_names
        self._names = {'lower': coordinates, 'upper': coordinates, 'velocity': joint_names}
        self._single, n_q = single, len(coordinates)
        self._bounds = {
            name: (part, bound, sign) for name, part, bound, sign in (
                ('lower', slice(0, n_q), limits.lower, -1.0),
                ('upper', slice(0, n_q), limits.upper, 1.0),
                ('velocity', slice(n_q, n_q + len(joint_names)), limits.velocity, 0.0))
            if np.isfinite(bound).any()}
        self._beyond = {name: np.zeros((len(states), len(bound)), dtype=bool)
                        for name, (_, bound, _) in self._bounds.items()}
        self.look(states[:, None], np.zeros(1))

    @property
    def events(self) -> LimitEvents:
        """Return the events so far."""
        return LimitEvents(self._names, self._found, self._single)

    def look(self, states: Array, t: Array, extremes: Extremes | None = None) -> None:
        """
        Add the crossings among further states.

        Parameters
        ----------
        states : (N, K, 2 n) array
            States of every simulation at further times.
        t : (K,) array
            Their times, s.
        extremes : (N, 2 n) arrays, optional
            Minimum and maximum of each entry over the K times, if known already; used to skip
            joints that cannot have passed a limit.

        Raises
        ------
        InputError
            There are more than a million crossings.

        """
        if not self._bounds:
            return
        rows = np.moveaxis(states, 2, 1)  # one for each entry of each state
        if extremes is None:
            rows = np.ascontiguousarray(rows)  # long rows go several times faster
        low, high = extremes or (rows.min(axis=2), rows.max(axis=2))
        for name, (part, bound, sign) in self._bounds.items():
            x, before = rows[:, part], self._beyond[name]
            i, j = np.nonzero(_passing(low[:, part], high[:, part], bound, sign, before))
            self._beyond[name] = _beyond(x[:, :, -1], bound, sign)
            if not len(i):
                continue
            beyond = np.empty((len(i), x.shape[2] + 1), dtype=bool)
            beyond[:, 0] = before[i, j]
            beyond[:, 1:] = _beyond(x[i, j], bound[j, None], sign)
            new = beyond[:, 1:] > beyond[:, :-1]
            which, k = np.divmod(np.flatnonzero(new), new.shape[1])  # nonzero is ten times slower
            i, j = i[which], j[which]
            self._count += len(k)
            if self._count > MOST_EVENTS:
                raise InputError(f'limit events: more than {MOST_EVENTS} by {t[-1]:.6g} s; '
                                 'expected a shorter simulation, or a model without limits')
            if len(k):
                self._found.append(Crossings(name, t[k], i, j, x[i, j, k], bound[j]))


def _beyond(x: Array, bound: Array, sign: float) -> Any:
    """Return which entries are beyond a limit: of speeds in magnitude, of positions signed."""
    return np.abs(x) > bound if sign == 0.0 else x > bound if sign > 0.0 else x < bound


def _passing(low: Array, high: Array, bound: Array, sign: float, before: Any) -> Any:
    """Return which joints may have passed a limit, from their minima and maxima."""
    if sign == 0.0:
        return (np.maximum(high, -low) > bound) & ~(((low > bound) | (high < -bound)) & before)
    largest, least = (high, low) if sign > 0.0 else (-low, -high)
    return (largest > sign * bound) & ~((least > sign * bound) & before)
