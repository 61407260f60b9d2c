"""Which joints pass their limits in a simulation, and when."""

from collections.abc import Sequence
from itertools import repeat
from operator import itemgetter
from typing import Any

from kane_dynamics.errors import InputError
from kane_dynamics.model import Array
from kane_dynamics.parameters import JointLimits
from kane_dynamics.trajectory import LimitEvent
import numpy as np

ABREAST = 16  # times that are compared at once
MOST_EVENTS = 1_000_000

Extremes = tuple[Array, Array]


class LimitWatch:
    """
    Finds the steps at which a joint passes a limit that it kept before.

    Parameters
    ----------
    joint_names : sequence of str
    limits : JointLimits
    states : (N, 2 n) array
        At time 0; what is beyond a limit there is an event.
    single : bool
        Whether events shall leave open which of the N simulations they are of.

    """

    def __init__(self, joint_names: Sequence[str], limits: JointLimits, states: Array,
                 single: bool) -> None:
        self.events: list[LimitEvent] = []
        self._names, self._single, n = joint_names, single, len(joint_names)
        self._bounds = {
            name: (part, bound, sign) for name, part, bound, sign in (
                ('lower', slice(0, n), limits.lower, -1.0),
                ('upper', slice(0, n), limits.upper, 1.0),
                ('velocity', slice(n, 2 * n), limits.velocity, 0.0)) if np.isfinite(bound).any()}
        self._beyond = {name: np.zeros((len(states), n), dtype=bool) for name in self._bounds}
        self.look(states[:, None], np.zeros(1))

    def look(self, states: Array, t: Array, extremes: Extremes | None = None) -> None:
        """
        Add the crossings among further states.

        Parameters
        ----------
        states : (N, K, 2 n) array
            Of every simulation at further times.
        t : (K,) array
            Their times, s.
        extremes : (N, 2 n) arrays, optional
            Least and largest of each entry over the K times, where they are known already: they
            tell which joints may have passed a limit at all.

        Raises
        ------
        InputError
            There are more than a million crossings.

        """
        if not self._bounds:
            return
        low, high = extremes or _extremes(states)
        found: list[LimitEvent] = []
        for name, (part, bound, sign) in self._bounds.items():
            x, before = states[:, :, part], self._beyond[name]
            i, j = np.nonzero(_passing(low[:, part], high[:, part], bound, sign, before))
            self._beyond[name] = _beyond(x[:, -1], bound, sign)
            if not len(i):
                continue
            beyond = _beyond(x[i, :, j], bound[j, None], sign)
            new = beyond & ~np.concatenate([before[i, j][:, None], beyond[:, :-1]], axis=1)
            which, k = np.divmod(np.flatnonzero(new), new.shape[1])  # nonzero is ten times slower
            i, j = i[which], j[which]
            if len(self.events) + len(found) + len(k) > MOST_EVENTS:
                raise InputError(f'joints pass their limits more than {MOST_EVENTS} times by '
                                 f'{t[-1]:.6g} s; simulate less, or give the model no limits')
            found += map(LimitEvent, t[k].tolist(), map(self._names.__getitem__, j.tolist()),
                         repeat(name), x[i, k, j].tolist(), bound[j].tolist(),
                         repeat(None) if self._single else i.tolist())
        self.events += sorted(found, key=itemgetter(0))


def _extremes(states: Array) -> Extremes:
    """Return the least and the largest of each entry over the times; (N, K, 2 n) to (N, 2 n)."""
    N, K, size = states.shape
    if N == 1 and K >= 2 * ABREAST:  # numpy takes rows one by one: long ones go faster
        whole = K // ABREAST * ABREAST
        wide = states[:, :whole].reshape(1, -1, ABREAST * size)
        low, high = (x.reshape(1, ABREAST, size) for x in (wide.min(axis=1), wide.max(axis=1)))
        rest = states[:, whole:]
        return (np.concatenate([low, rest], axis=1).min(axis=1),
                np.concatenate([high, rest], axis=1).max(axis=1))
    return states.min(axis=1), states.max(axis=1)


def _beyond(x: Array, bound: Array, sign: float) -> Any:
    """Tell which entries are past a limit: a speed's size, a position to one side."""
    return np.abs(x) > bound if sign == 0.0 else sign * x > sign * bound


def _passing(low: Array, high: Array, bound: Array, sign: float, before: Any) -> Any:
    """Tell which joints, of each simulation, may have passed a limit, by their extremes."""
    if sign == 0.0:
        return (np.maximum(high, -low) > bound) & ~(((low > bound) | (high < -bound)) & before)
    largest, least = (high, low) if sign > 0.0 else (-low, -high)
    return (largest > sign * bound) & ~((least > sign * bound) & before)
