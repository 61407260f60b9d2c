"""
Motions that bring an arm to rest: along its path, or from where it is.

The rate of the time along the path falls from 1 to 0 as 1 - 3 x^2 + 2 x^3, with x from 0
to 1: positions, speeds and accelerations are continuous, and the arm stays on the path. For
elastic joints it is 1 - 10 x^3 + 15 x^4 - 6 x^5: along a smooth path the jerk is continuous
too, and the largest deceleration a quarter larger.
"""

from collections.abc import Callable
import math

from kane_dynamics.errors import KaneError
from kane_dynamics.motion.motion import Motion
from kane_dynamics.ros.common.conversion import Array
from kane_dynamics.ros.services.motion_check import check_positions, motion_efforts
from kane_dynamics.ros.services.served_robot import ServedRobot
import numpy as np

POINTS = 25  # of a stop, between which it is a quintic
SHORTEST, LONGEST, FACTOR = 0.05, 4.0, 1.3  # durations of a stop that are tried, s
HEADROOM = 0.9  # of the limits, the rest is for feedback

Demand = Callable[[Motion], float]


def stop_along(motion: Motion, moment: float, demand: Demand, *,
               elastic: bool = False) -> Motion | None:
    """
    Return the shortest stop along the path of a motion; None if it ends sooner by itself.

    Parameters
    ----------
    motion : Motion
        The motion that stops.
    moment : float
        Time of the motion at which the stop begins, s.
    demand : callable
        As `limit_demand`.
    elastic : bool
        Whether the jerk is continuous, as elastic joints need it.

    Returns
    -------
    Motion or None
        It begins at time 0. The arm comes to rest where it is at half the duration of
        the stop after `moment`.

    """
    def stop(duration: float) -> Motion:
        times, passed, rate, change = _slowing(duration, elastic)
        q, u, udot = motion.sample(moment + passed[:, 0])
        return Motion.from_points(times[:, 0], q, u * rate, udot * rate**2 + u * change,
                                  joint_names=motion.joint_names)

    remaining = motion.duration - moment
    durations = [duration for duration in _durations() if duration < remaining]
    return _least(stop, durations, demand)


def stop_from(served: ServedRobot, joints: tuple[str, ...], q: Array, u: Array,
              demand: Demand, *, elastic: bool = False) -> Motion:
    """
    Return the shortest stop from a state, with all joints in proportion.

    Parameters
    ----------
    served : ServedRobot
        The robot, whose position limits the stop must keep.
    joints : tuple of n str
        Names of the joints that move.
    q, u : (n,) arrays
        Positions and rates, rad or m, and s.
    demand : callable
        As `limit_demand`.
    elastic : bool
        As in `stop_along`.

    Returns
    -------
    Motion
        It rests at q where no stop is possible.

    """
    def stop(duration: float) -> Motion:
        times, passed, rate, change = _slowing(duration, elastic)
        return Motion.from_points(times[:, 0], q + u * passed, u * rate, u * change,
                                  joint_names=joints)

    def checked_demand(motion: Motion) -> float:
        check_positions(served, joints, motion.positions, motion.times, place=q)
        return demand(motion)

    stopping = _least(stop, _durations(), checked_demand)
    return stopping or Motion.from_points([0.0], [q], joint_names=joints)


def limit_demand(served: ServedRobot, effort: Array, rate: Array, motion: Motion
                 ) -> float:
    """
    Return the largest share of the limits of effort and its rate that a motion needs.

    Parameters
    ----------
    served : ServedRobot
        With its loads applied.
    effort, rate : (n_q,) arrays
        Limits, N m or N, and 1/s.
    motion : Motion
        A stop.

    Raises
    ------
    KaneError
        The motion is impossible, as where loops do not close.

    """
    times = motion.times
    tau = motion_efforts(served, motion, times, motion.sample(times))
    changes = np.diff(tau, axis=0) / np.diff(times)[:, None]
    return float(max((np.abs(tau) / effort).max(), (np.abs(changes) / rate).max()))


def _least(stop: Callable[[float], Motion], durations: list[float], demand: Demand
           ) -> Motion | None:
    """Return the first stop within the limits, or that with the least demand."""
    least = math.inf
    best = None
    for duration in durations:
        candidate = stop(duration)
        try:
            needed = demand(candidate)
        except KaneError:  # it leaves the position limits, or loops do not close
            continue
        if needed < least:
            best = candidate
            least = needed
        if needed <= HEADROOM:
            break
    return best


def _durations() -> list[float]:
    """Return the durations of stops that are tried, s."""
    count = math.ceil(math.log(LONGEST / SHORTEST, FACTOR))
    return [SHORTEST * FACTOR**k for k in range(count + 1)]


def _slowing(duration: float, elastic: bool) -> tuple[Array, Array, Array, Array]:
    """Return times, time along the path, its rate and the rate's rate, (K, 1) each."""
    x = np.linspace(0.0, 1.0, POINTS)[:, None]
    if elastic:
        passed = duration * (x - 2.5 * x**4 + 3.0 * x**5 - x**6)
        rate = 1.0 - 10.0 * x**3 + 15.0 * x**4 - 6.0 * x**5
        change = -30.0 * x**2 * (1.0 - x)**2 / duration
    else:
        passed = duration * (x - x**3 + 0.5 * x**4)
        rate = 1.0 - 3.0 * x**2 + 2.0 * x**3
        change = 6.0 * (x**2 - x) / duration
    return duration * x, passed, rate, change
