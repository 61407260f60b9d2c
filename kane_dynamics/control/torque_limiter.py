"""
Torque limits: the effort clamp, then the rate limit.

The rules are functions over any scalar: `TorqueLimiter` applies them to floats, the native
torque path and exported controllers compile them.
"""

from collections.abc import Iterable, Sequence
import math
from typing import NamedTuple

from kane_dynamics._util.checks import per_joint
from kane_dynamics._util.typing import Array, Flags, Scalar
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.choice import select
import numpy as np
from numpy.typing import ArrayLike

FINITE = float(np.finfo(np.float64).max)


def clipped(x: Scalar, low: Scalar, high: Scalar) -> Scalar:
    """Return the number within bounds that is nearest to x."""
    return select(x < low, low, select(high < x, high, x))


def within_effort(tau: Iterable[Scalar], effort: Iterable[Scalar]) -> list[Scalar]:
    """Return torques within the effort limits."""
    return [clipped(x, -largest, largest)
            for x, largest in zip(tau, effort, strict=True)]


def within_rates(tau: Iterable[Scalar], last: Iterable[Scalar], change: Iterable[Scalar]
                 ) -> list[Scalar]:
    """Return torques that differ from the last ones by at most the largest changes."""
    return [clipped(x, last_x - largest, last_x + largest)
            for x, last_x, largest in zip(tau, last, change, strict=True)]


def lowered_efforts(stated: ArrayLike, effort_limit: ArrayLike, names: Sequence[str]
                    ) -> Array:
    """
    Return the effort limits of joints, (n,), which `effort_limit` lowers.

    Infinite ones lower nothing. One number, also if repeated, lowers larger limits.

    Raises
    ------
    InputError
        A limit is above the stated one of its joint, or one number is above all.

    """
    limits = np.asarray(stated, dtype=np.float64)
    effort = per_joint(effort_limit, 'effort_limit', names, finite=False)
    above = np.isfinite(effort) & (effort > limits)
    # Of one number, the largest limit counts.
    j = int(np.argmax(np.where(above, limits, -1.0)))
    is_one = (effort == effort[:1]).all()
    if above.all() if is_one else above.any():
        raise InputError(f"effort_limit: {effort[j]:g} of joint '{names[j]}'; expected at "
                         f'most {limits[j]:g}, the limit of the robot, or inf')
    return np.minimum(effort, limits)


class Command(NamedTuple):
    """Torques to apply, (n,) N m or N, with flags of clamped and rate-limited joints."""

    tau: Array
    clamped: Flags
    rate_limited: Flags
    limited: bool


class TorqueLimiter:
    """
    Clamps each torque to its limit, then its change since the last command.

    After construction or `stop` the previous command is zero at the first stamp, so a
    torque with a rate limit starts at zero. There are no limits until they are set.

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
        # Lists of floats: for the few joints of an arm, and between two sleeps of a
        # controller, plain arithmetic takes a fraction of the time of a dozen array
        # operations.
        self._last: list[float] = self._zero.tolist()
        self._stamp: float | None = None
        self.set_effort(np.full(len(self._names), math.inf))
        self.set_rate(np.full(len(self._names), math.inf))

    def set_effort(self, effort: Array) -> None:
        """Change the largest torques."""
        self.effort = effort
        self._largest: list[float] = effort.tolist()
        self._bounds = [(-bound, bound) for bound in np.minimum(effort, FINITE).tolist()]

    def set_rate(self, rate: Array) -> None:
        """Change the largest rates of torque."""
        self.rate = rate
        is_limited = np.isfinite(rate)
        self._rated = bool(is_limited.any())
        # The step is slope * dt + free, which avoids inf * 0 where there is no limit.
        self._slope: list[float] = np.where(is_limited, rate, 0.0).tolist()
        self._free: list[float] = np.where(is_limited, 0.0, math.inf).tolist()

    @property
    def last(self) -> Array | None:
        """Return the last command, (n,) N m or N; None before the first one."""
        return None if self._stamp is None else np.array(self._last)

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
        torques = tau.tolist()
        # The rate limit needs the time since the last command; it has none at the first.
        elapsed = 0.0 if self._stamp is None else max(t - self._stamp, 0.0)
        if self._is_within(torques, elapsed):
            self._last = torques
            self._stamp = t
            return Command(tau, self._none, self._none, False)
        # Outside the limits: refuse what is not finite, clamp, then limit the rate.
        if not all(map(math.isfinite, torques)):
            raise InputError('torques: not finite, '
                             f'{dict(zip(self._names, torques, strict=True))}; expected '
                             'a state, a motion and gains in a physical range')
        clamped = within_effort(torques, self._largest)
        # The last command within the present effort limits: the limit of the rate would
        # hold a command above one that has become smaller.
        last = within_effort(self._last, self._largest)
        change = [slope * elapsed + free for slope, free in zip(self._slope, self._free)]
        limited = within_rates(clamped, last, change)
        self._last = limited
        self._stamp = t
        if limited == torques:
            return Command(tau, self._none, self._none, False)
        # What the magnitude limited, and what the rate did.
        after_clamp = np.array(clamped)
        result = np.array(limited)
        return Command(result, after_clamp != tau, result != after_clamp, True)

    def _is_within(self, torques: list[float], elapsed: float) -> bool:
        """Return whether torques are finite and within all limits."""
        # Plain numbers and early returns: it runs in every cycle.
        for x, (low, high) in zip(torques, self._bounds):
            if not low <= x <= high:  # nan and infinity too
                return False
        if self._rated:
            for x, last, slope, free in zip(torques, self._last, self._slope,
                                            self._free):
                if not abs(x - last) <= slope * elapsed + free:
                    return False
        return True

    def stop(self) -> Command:
        """Return zeros, regardless of limits, and restart with the next stamp."""
        self._last = self._zero.tolist()
        self._stamp = None
        return Command(self._zero.copy(), self._none, self._none, False)
