"""Torque limits: the effort clamp, then the rate limit."""

from collections.abc import Sequence
import math
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.dual import select
import numpy as np

Number = Any  # over any scalar, for tracing too
FINITE = float(np.finfo(np.float64).max)


def clipped(x: Number, low: Number, high: Number) -> Number:
    """Return x within bounds."""
    return select(x < low, low, select(high < x, high, x))


def within_rate(x: Number, last: Number, change: Number) -> Number:
    """Return a torque that differs from the last one by at most a change."""
    return clipped(x, last - change, last + change)


class Command(NamedTuple):
    """Torques to apply, (n,) N m or N, with flags of clamped and rate-limited joints."""

    tau: Array
    clamped: Flags
    rate_limited: Flags
    limited: bool


class TorqueLimiter:
    """
    Clamps each torque to its limit, then its change since the last command.

    After construction or `stop` the previous command is zero at the first stamp, so a torque with
    a rate limit starts at zero. There are no limits until they are set.

    Attributes
    ----------
    effort, rate : (n,) arrays
        N m and N m/s, or N and N/s; infinite for no limit.

    """

    def __init__(self, joint_names: Sequence[str]) -> None:
        self._names = tuple(joint_names)
        self._zero = np.zeros(len(self._names))
        self._none = np.zeros(len(self._names), dtype=bool)
        self._none.flags.writeable = False
        # Lists of floats: for the few joints of an arm, and between two sleeps of a controller,
        # plain arithmetic takes a fraction of the time of a dozen array operations.
        self._last: list[float] = self._zero.tolist()
        self._stamp: float | None = None
        self.set_effort(np.full(len(self._names), math.inf))
        self.set_rate(np.full(len(self._names), math.inf))

    def set_effort(self, effort: Array) -> None:
        """Change the largest torques; the last command is clamped to them."""
        self.effort = effort
        # Otherwise the rate limit would hold a command above the new limit.
        self._largest: list[float] = effort.tolist()
        self._bounds = [(-most, most) for most in np.minimum(effort, FINITE).tolist()]
        self._last = [min(max(last, -most), most)
                      for last, most in zip(self._last, self._largest, strict=True)]

    def set_rate(self, rate: Array) -> None:
        """Change the largest rates of torque."""
        self.rate = rate
        self._rated = bool(np.isfinite(rate).any())
        # The step is slope * dt + free, which avoids inf * 0 where there is no limit.
        self._slope: list[float] = np.where(np.isfinite(rate), rate, 0.0).tolist()
        self._free: list[float] = np.where(np.isfinite(rate), 0.0, math.inf).tolist()

    def apply(self, t: float, tau: Array) -> Command:
        """
        Return `tau` limited, at stamp `t`, s.

        A stamp before the last one allows no change.

        Parameters
        ----------
        t : float
            s, on any clock.
        tau : (n,) array
            N m or N; returned unchanged within all limits.

        Raises
        ------
        InputError
            A torque is not finite; the last command is not changed.

        """
        wanted = tau.tolist()
        elapsed = 0.0 if self._stamp is None else max(t - self._stamp, 0.0)
        if self._is_within(wanted, elapsed):
            self._last, self._stamp = wanted, t
            return Command(tau, self._none, self._none, False)
        if not all(map(math.isfinite, wanted)):
            raise InputError('torques: not finite, '
                             f'{dict(zip(self._names, wanted, strict=True))}; expected a state, '
                             'a motion and gains in a physical range')
        within = [clipped(x, -most, most)
                  for x, most in zip(wanted, self._largest, strict=True)]
        out = within if not self._rated else [
            within_rate(x, last, slope * elapsed + free)
            for x, last, slope, free in zip(within, self._last, self._slope, self._free,
                                            strict=True)]
        self._last, self._stamp = out, t
        if out == wanted:
            return Command(tau, self._none, self._none, False)
        limited = np.array(out)
        if out is within:
            return Command(limited, limited != tau, self._none, True)
        bounded = np.array(within)
        return Command(limited, bounded != tau, limited != bounded, True)

    def _is_within(self, wanted: list[float], elapsed: float) -> bool:
        """Return whether torques are finite and within all limits; as fast as may be."""
        for x, (low, high) in zip(wanted, self._bounds):
            if not low <= x <= high:  # nan and infinity too
                return False
        if self._rated:
            for x, last, slope, free in zip(wanted, self._last, self._slope, self._free):
                if not abs(x - last) <= slope * elapsed + free:
                    return False
        return True

    def resume(self, t: float | None, tau: Array) -> None:
        """Continue from `tau`, (n,), commanded elsewhere at stamp `t`, s; None: the next one."""
        self._last, self._stamp = tau.tolist(), t

    def stop(self) -> Command:
        """Return zeros, regardless of limits, and restart with the next stamp."""
        self._last, self._stamp = self._zero.tolist(), None
        return Command(self._zero.copy(), self._none, self._none, False)
