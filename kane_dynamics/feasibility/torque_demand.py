"""Torque, speed and power along a motion, against the limits of the joints."""

from collections.abc import Iterator
from dataclasses import dataclass
import math
from typing import NamedTuple

from kane_dynamics._util.checks import per_joint
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.feasibility.samples import in_doubt, NONE, ROUNDING, ROUNDS, sampled, STEP
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.parameters import JointLimits
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

QUANTITIES = {'effort': 'torque', 'velocity': 'speed', 'power': 'power', 'lower': 'position',
              'upper': 'position'}


class Excess(NamedTuple):
    """Where a joint is farthest beyond one of its limits."""

    joint: str
    limit: str  # 'effort', 'velocity', 'power', 'lower' or 'upper'
    t: float
    value: float
    bound: float

    def __str__(self) -> str:
        """Say it in words, with as many digits as part the value from the bound."""
        digits = next((k for k in range(4, 17) if f'{self.value:.{k}g}' != f'{self.bound:.{k}g}'),
                      17)
        return (f"joint '{self.joint}': {QUANTITIES[self.limit]} {self.value:.{digits}g} at "
                f'{self.t:.4g} s; {self.limit} limit {self.bound:.{digits}g}')


@dataclass(frozen=True, eq=False)
class Demand:
    """
    What a motion asks of the motors, sample by sample; SI units of each joint.

    Attributes
    ----------
    joint_names : tuple of str
    t : (N,) array
        s; a time at which the acceleration jumps stands there twice, for both sides.
    q, u, udot, tau : (N, n) arrays
        Positions, speeds, accelerations and torques.
    limits : JointLimits
        Of the robot.
    power_limit : (n,) array
        W; infinite for none.

    """

    joint_names: tuple[str, ...]
    t: Array
    q: Array
    u: Array
    udot: Array
    tau: Array
    limits: JointLimits
    power_limit: Array

    @property
    def power(self) -> Array:
        """Return tau u, (N, n), W: negative where a joint brakes."""
        return self.tau * self.u

    @property
    def torque_rms(self) -> Array:
        """Return the root of the mean square of the torque over time, (n,): what heats motors."""
        span = float(self.t[-1] - self.t[0])
        if span == 0.0:
            return np.asarray(np.abs(self.tau[0]))
        squares = self.tau**2
        mean = np.diff(self.t) @ (squares[1:] + squares[:-1]) / (2.0 * span)
        return np.asarray(np.sqrt(mean))

    @property
    def uses(self) -> dict[str, Array]:
        """Return the peak of torque, speed and power as a share of each limit, (n,) arrays."""
        return {limit: share(np.abs(values).max(axis=0), bound)
                for limit, values, bound in self._sizes()}

    @property
    def excesses(self) -> tuple[Excess, ...]:
        """Return where limits are passed farthest, one for each joint and limit."""
        found = []
        for limit, values, bound in self._sizes():
            size = np.abs(values)
            found += self._worst(limit, size, size - bound, ROUNDING * bound, bound)
        for limit, bound, sign in (('lower', self.limits.lower, -1.0),
                                   ('upper', self.limits.upper, 1.0)):
            slack = ROUNDING * np.maximum(1.0, np.abs(bound))
            found += self._worst(limit, self.q, sign * (self.q - bound), slack, bound)
        return tuple(found)

    @property
    def fits(self) -> bool:
        """Tell whether every limit is kept at every sample."""
        return not self.excesses

    @property
    def in_doubt(self) -> Array:
        """Return times at which a limit may be passed though the samples keep it, (k,), s."""
        shares = [share(np.abs(values), bound) for _, values, bound in self._sizes()]
        with np.errstate(invalid='ignore'):
            shares += [1.0 + sign * (self.q - bound) / np.maximum(1.0, np.abs(bound))
                       for bound, sign in ((self.limits.lower, -1.0), (self.limits.upper, 1.0))]
        return in_doubt(self.t, np.hstack(shares))

    def _sizes(self) -> Iterator[tuple[str, Array, Array]]:
        """Yield limits on sizes: name, (N, n) values, (n,) bounds."""
        yield 'effort', self.tau, self.limits.effort
        yield 'velocity', self.u, self.limits.velocity
        yield 'power', self.power, self.power_limit

    def _worst(self, limit: str, values: Array, beyond: Array, slack: Array,
               bound: Array) -> list[Excess]:
        """Return the farthest sample of every joint that passes its bound by more than slack."""
        rows = beyond.argmax(axis=0)
        return [Excess(name, limit, float(self.t[k]), float(values[k, j]), float(bound[j]))
                for j, (name, k) in enumerate(zip(self.joint_names, rows.tolist()))
                if math.isfinite(bound[j]) and beyond[k, j] > slack[j]]


def demand(robot: Robot, motion: Motion, *, speed: float = 1.0, step: float = STEP,
           power: ArrayLike = math.inf) -> Demand:
    """
    Return what a motion asks of a robot's motors, its payload and friction included.

    The joints stand at both ends of a motion, which counts too. Between samples that keep a limit
    but come near it more are taken, until what may hide between them is rounding.

    Parameters
    ----------
    robot : Robot
        With joint rates for speeds.
    motion : Motion
        Of its joints, in their order.
    speed : float
        At which the motion's path is followed: 2 is twice as fast.
    step : float
        Largest time between two samples of the motion at speed 1, s; a peak that is much narrower
        goes unseen.
    power : float or (n,) array_like
        Largest size of the mechanical power of each joint, W: URDF has no word for it.

    Raises
    ------
    InputError
        The robot or the motion is not of that kind, a number is out of range: names it.

    """
    more = NONE
    for _ in range(ROUNDS):
        asked = demand_at(robot, motion, speed, step, power, more)
        doubtful = asked.in_doubt
        if not doubtful.size:
            return asked
        more = np.concatenate([more, speed * doubtful])
    return demand_at(robot, motion, speed, step, power, more)


def demand_at(robot: Robot, motion: Motion, speed: float, step: float, power: ArrayLike,
              more: Array) -> Demand:
    """Return what a motion asks for at its samples, and at further times of the motion."""
    t, q, u, udot = sampled(robot, motion, step, more)
    if not 0.0 < speed < math.inf:
        raise InputError(f'speed is {speed}; expected a positive, finite number')
    u, udot = speed * u, speed**2 * udot
    tau = robot.inverse_dynamics(q, u, udot)
    if not np.isfinite(tau).all():
        k, j = np.argwhere(~np.isfinite(tau))[0].tolist()
        raise InputError(f"joint '{robot.joint_names[j]}': torque is {tau[k, j]} at "
                         f'{t[k]:.4g} s; the motion is beyond any physical range')
    return Demand(robot.joint_names, t / speed, q, u, udot, tau, robot.limits,
                  per_joint(power, 'power', robot.joint_names, finite=False))


def torque_of(power: Array, u: Array) -> Array:
    """Return the torque that has a power at speeds, (N, n); infinite at rest."""
    with np.errstate(divide='ignore', invalid='ignore'):
        return np.asarray(np.where(u == 0.0, math.inf, power / np.abs(u)))


def share(value: Array, bound: Array) -> Array:
    """Return value / bound of sizes: 0 of no limit, and 0 of a limit of 0 if the value is 0."""
    with np.errstate(divide='ignore', invalid='ignore'):
        return np.asarray(np.where(value == 0.0, 0.0, value / bound))
