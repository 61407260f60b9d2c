"""Torque, speed and power along a motion, against the limits of the joints."""

from collections.abc import Iterator
from dataclasses import dataclass
import math
from typing import NamedTuple

from kane_dynamics.errors import InputError
from kane_dynamics.limiter import per_joint
from kane_dynamics.mechanics.constrained import ConstrainedEquations
from kane_dynamics.model import Array
from kane_dynamics.motion import Motion
from kane_dynamics.parameters import JointLimits
from kane_dynamics.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

STEP = 1e-3  # s between samples
MOST_SAMPLES = 200_000
ROUNDING = 1e-9  # relative: a motion that was scaled to a limit is on it, not beyond it
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
        """Say it in words."""
        return (f"joint '{self.joint}': {QUANTITIES[self.limit]} {self.value:.4g} at "
                f'{self.t:.4g} s; {self.limit} limit {self.bound:.4g}')


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

    The joints stand at both ends of a motion, which counts too.

    Parameters
    ----------
    robot : Robot
        With joint rates for speeds.
    motion : Motion
        Of its joints, in their order.
    speed : float
        At which the motion's path is followed: 2 is twice as fast.
    step : float
        Largest time between two samples of the motion at speed 1, s.
    power : float or (n,) array_like
        Largest size of the mechanical power of each joint, W: URDF has no word for it.

    Raises
    ------
    InputError
        The robot or the motion is not of that kind, a number is out of range: names it.

    """
    t, q, u, udot = sampled(robot, motion, step)
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


def sampled(robot: Robot, motion: Motion, step: float) -> tuple[Array, Array, Array, Array]:
    """
    Return t (N,) and q, u, udot (N, n) of a motion, both sides of its points among them.

    Parameters
    ----------
    robot : Robot
        Whose joints the motion must be of.
    motion : Motion
        What to sample.
    step : float
        Largest time between samples, s.

    Raises
    ------
    InputError
        Not a plain robot, other joints, or too many samples: names what it is.

    """
    if isinstance(robot.equations, ConstrainedEquations):
        raise InputError('the robot has chosen speeds or constraints; feasibility takes one with '
                         'joint rates for speeds and none')
    if motion.joint_names != robot.joint_names:
        raise InputError(f'the motion is of the joints {list(motion.joint_names)}; expected '
                         f'{list(robot.joint_names)}')
    if not 0.0 < step < math.inf:
        raise InputError(f'step is {step} s; expected a positive, finite number')
    starts, h = motion.times[:-1], np.diff(motion.times)
    intervals = np.ceil(h / step)
    if intervals.sum() > MOST_SAMPLES:
        raise InputError(f'step is {step:g} s: {intervals.sum():.3g} samples of a motion of '
                         f'{motion.duration:g} s; valid: up to {MOST_SAMPLES}, by a larger step')
    counts = np.maximum(intervals, 1.0).astype(int) + 1
    segment = np.repeat(np.arange(len(h)), counts)
    inside = np.arange(len(segment)) - np.repeat(np.cumsum(counts) - counts, counts)
    t = starts[segment] + h[segment] * (inside / (counts[segment] - 1))
    # The last sample of a segment must not be the first of the next: udot may differ.
    last = inside == counts[segment] - 1
    t[last] = np.nextafter(motion.times[1:], -math.inf)
    q, u, udot = motion.sample(t)
    rest = np.zeros((1, motion.n))
    return (np.concatenate([motion.times[:1], t, motion.times[-1:]]),
            np.concatenate([motion.positions[:1], q, motion.positions[-1:]]),
            np.concatenate([rest, u, rest]), np.concatenate([rest, udot, rest]))


def torque_of(power: Array, u: Array) -> Array:
    """Return the torque that has a power at speeds, (N, n); infinite at rest."""
    with np.errstate(divide='ignore', invalid='ignore'):
        return np.asarray(np.where(u == 0.0, math.inf, power / np.abs(u)))


def share(value: Array, bound: Array) -> Array:
    """Return value / bound of sizes: 0 of no limit, and 0 of a limit of 0 if the value is 0."""
    with np.errstate(divide='ignore', invalid='ignore'):
        return np.asarray(np.where(value == 0.0, 0.0, value / bound))
