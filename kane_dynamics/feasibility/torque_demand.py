"""Torque, speed and power along a motion, compared with the joint limits."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
import math
from typing import NamedTuple

from kane_dynamics._util.checks import instance, number, per_joint
from kane_dynamics._util.typing import Array
from kane_dynamics.control.elastic_feedforward import ElasticFeedforward
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.errors import InputError, KaneError
from kane_dynamics.feasibility.samples import (NONE, ROUNDING, ROUNDS, sample_times,
                                               sampled, STEP, times_to_refine)
from kane_dynamics.loop_tracking.driven_mechanism import (mechanism_motion,
                                                          MechanismMotion)
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.motion.motion import Motion
from kane_dynamics.motion.smooth_motion import SmoothMotion, SmoothState
from kane_dynamics.robot.parameters import JointLimits
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

FASTEST = 1e6  # largest factor of the speed of a motion
QUANTITIES = {'effort': 'torque', 'gear': 'torque of the gear', 'velocity': 'speed',
              'power': 'power', 'lower': 'position', 'upper': 'position'}


class Excess(NamedTuple):
    """Largest excess of a joint over one of its limits."""

    joint: str
    limit: str  # 'effort', 'gear', 'velocity', 'power', 'lower' or 'upper'
    t: float
    value: float
    bound: float

    def __str__(self) -> str:
        """Return the excess as text, with digits that distinguish value and bound."""
        digits = 4
        while digits < 17 and f'{self.value:.{digits}g}' == f'{self.bound:.{digits}g}':
            digits += 1
        return (f"joint '{self.joint}': {QUANTITIES[self.limit]} "
                f'{self.value:.{digits}g} at {self.t:.4g} s; {self.limit} limit '
                f'{self.bound:.{digits}g}')


@dataclass(frozen=True, eq=False)
class Demand:
    """
    Torque, speed and power of a motion at its samples, with the limits; SI units.

    Attributes
    ----------
    joint_names : tuple of str
    t : (N,) array
        s; the time of an acceleration jump occurs twice, for both sides.
    q, u, udot, tau : (N, n) arrays
        Positions, speeds, accelerations and torques.
    limits : JointLimits
        Limits of the robot.
    power_limit : (n,) array
        W; infinite for no limit.
    gears : tuple of str
        The elastic joints. Their columns of `tau` and `limits.effort` are those of the
        gear, which the limit 'gear' compares; the motor's are those of its own joint.

    """

    joint_names: tuple[str, ...]
    t: Array
    q: Array
    u: Array
    udot: Array
    tau: Array
    limits: JointLimits
    power_limit: Array
    gears: tuple[str, ...] = ()

    @property
    def power(self) -> Array:
        """Return the mechanical power tau u, (N, n), W; negative for braking."""
        return self.tau * self.u

    @property
    def torque_rms(self) -> Array:
        """Return the root mean square of the torque, (n,), which heats motors."""
        span = float(self.t[-1] - self.t[0])
        if span == 0.0:
            return np.asarray(np.abs(self.tau[0]))
        squares = self.tau**2
        mean = np.diff(self.t) @ (squares[1:] + squares[:-1]) / (2.0 * span)
        return np.asarray(np.sqrt(mean))

    @property
    def uses(self) -> dict[str, Array]:
        """Return peak torque, speed and power as fractions of their limits, (n,)."""
        shares = {}
        for limit, values, bound in self._sizes():
            peak = np.abs(values).max(axis=0)
            shares[limit] = share(peak, bound)
        return shares

    @property
    def excesses(self) -> tuple[Excess, ...]:
        """Return the largest excess for each joint and exceeded limit."""
        excesses = []
        for limit, values, bound in self._sizes():
            size = np.abs(values)
            excesses += self._worst(limit, size, size - bound, ROUNDING * bound, bound)
        for limit, bound, sign in (('lower', self.limits.lower, -1.0),
                                   ('upper', self.limits.upper, 1.0)):
            slack = ROUNDING * np.maximum(1.0, np.abs(bound))
            beyond = sign * (self.q - bound)
            excesses += self._worst(limit, self.q, beyond, slack, bound)
        return tuple(excesses)

    @property
    def fits(self) -> bool:
        """Return whether all samples satisfy all limits."""
        return not self.excesses

    @property
    def in_doubt(self) -> Array:
        """Return times between samples at which a limit may be exceeded, (k,), s."""
        shares = [share(np.abs(values), bound) for _, values, bound in self._sizes()]
        for bound, sign in ((self.limits.lower, -1.0), (self.limits.upper, 1.0)):
            size = np.maximum(1.0, np.abs(bound))
            with np.errstate(invalid='ignore'):
                shares.append(1.0 + sign * (self.q - bound) / size)
        return times_to_refine(self.t, np.hstack(shares))

    def _sizes(self) -> Iterator[tuple[str, Array, Array]]:
        """Yield the limits on absolute values: name, (N, n) values, (n,) bounds."""
        effort = self.limits.effort
        if self.gears:
            of_gear = np.isin(self.joint_names, self.gears)
            yield 'gear', self.tau, np.where(of_gear, effort, math.inf)
            effort = np.where(of_gear, math.inf, effort)
        yield 'effort', self.tau, effort
        yield 'velocity', self.u, self.limits.velocity
        yield 'power', self.tau * self.u, self.power_limit

    def _worst(self, limit: str, values: Array, beyond: Array, slack: Array,
               bound: Array) -> list[Excess]:
        """Return the largest excess of each joint beyond its bound plus slack."""
        excesses = []
        for j, name in enumerate(self.joint_names):
            k = int(beyond[:, j].argmax())
            if math.isfinite(bound[j]) and beyond[k, j] > slack[j]:
                value, at_limit = float(values[k, j]), float(bound[j])
                excesses.append(Excess(name, limit, float(self.t[k]), value, at_limit))
        return excesses


def demand(robot: Robot, motion: Motion | SmoothMotion, *, speed: float = 1.0,
           step: float = STEP, power: ArrayLike = math.inf,
           bending: QuasiStatic | None = None) -> Demand:
    """
    Return torque, speed and power of a motion, including payload and friction.

    Rest before and after the motion is included. Samples are added where the motion
    comes close to a limit, until the remaining excess between samples is rounding.

    Parameters
    ----------
    robot : Robot
        With chosen speeds or constraints the result has all joints, with the torques of
        `Robot.joint_torques`; constraints must be those of positions. With elastic joints
        it has links and motors, by `ElasticFeedforward`: torques of gears and of motors,
        which accelerate the rotors and have their friction.
    motion : Motion or SmoothMotion
        Motion of the robot's joints, in their order; with constraints, of as many joints
        as there are independent speeds, which determine the others (`mechanism_motion`).
        With elastic joints, of the links, with a continuous jerk; without them a Motion.
    speed : float
        Factor on the velocities of the motion; 2 is twice as fast.
    step : float
        Largest time between two samples of the motion at speed 1, s; much narrower peaks
        are missed.
    power : float or (n,) array_like
        Limit on the absolute mechanical power of each joint, W; not part of URDF. Of an
        elastic joint the motor has the limit, its link none.
    bending : QuasiStatic, optional
        The flexible arm of which `robot` is the rigid model, in the same joints and
        speeds: the torques are those with the deflections in equilibrium along the
        motion, with its gravity and payload. Actuators are at the independent joints;
        the other joints of closed loops have the positions and speeds of rigid beams.

    Raises
    ------
    InputError
        If the robot, the motion or a number is invalid; the message names it. With
        `bending`, if the load exceeds the stiffness of the beams.

    """
    instance(robot, Robot, 'robot')
    # Elastic joints: demand on motors and gears; otherwise on the joints themselves.
    if robot.drives:
        refuse_with_drives(bending)
        drives = DrivesAlong(robot, motion, step, power)
        return refined_demand(drives.demand_at, _speed(speed))
    motion_of_rigid_joints(motion)

    def at_samples(factor: float, additional: Array) -> Demand:
        return demand_at(robot, motion, factor, step, power, additional, bending)
    return refined_demand(at_samples, speed)


def refined_demand(at_samples: Callable[[float, Array], Demand], speed: float) -> Demand:
    """
    Return the demand at samples, with some added where a limit may be exceeded between.

    `at_samples` returns it for a speed with samples at additional times of the motion.
    """
    additional = NONE
    for _ in range(ROUNDS):
        result = at_samples(speed, additional)
        refined = result.in_doubt
        if not refined.size:
            return result
        additional = np.concatenate([additional, speed * refined])
    return at_samples(speed, additional)


def excesses_of(demand_with: Callable[[float], Demand], x: float
                ) -> Sequence[Excess] | KaneError:
    """Return the excesses of a demand, empty if it fits, or the error that it raises."""
    try:
        return demand_with(x).excesses
    except KaneError as error:
        return error


def largest_fitting(demand_with: Callable[[float], Demand], low: float, high: float,
                    precision: float) -> tuple[float, Sequence[Excess]]:
    """
    Return the largest number up to `high` whose demand fits, and what a larger one exceeds.

    By bisection from `low`, which fits, to a relative precision. Raises the error of
    larger numbers if it alone bounds the result.
    """
    beyond = excesses_of(demand_with, high)
    if not beyond:
        return high, ()
    while high - low > precision * high:
        # The geometric mean while the numbers are of different sizes.
        middle = math.sqrt(low * high) if 0.0 < 2.0 * low < high else 0.5 * (low + high)
        excesses = excesses_of(demand_with, middle)
        if excesses:
            high, beyond = middle, excesses
        else:
            low = middle
    if isinstance(beyond, KaneError):
        raise beyond
    return low, beyond


def demand_at(robot: Robot, motion: Motion | SmoothMotion, speed: float, step: float,
              power: ArrayLike, additional: Array, bending: QuasiStatic | None = None
              ) -> Demand:
    """Return the demand of a motion at its samples and at additional times."""
    if robot.drives:
        refuse_with_drives(bending)
        return DrivesAlong(robot, motion, step, power).demand_at(_speed(speed), additional)
    motion = motion_of_rigid_joints(motion)
    t, q, u, udot = sampled(robot, motion, step, additional)
    speed = _speed(speed)
    # Time scaled by the speed v: u = v q', udot = v^2 q''.
    t, u, udot = t / speed, speed * u, speed**2 * udot
    if bending is not None:
        _require_rigid_model(robot, bending)
    # The driving joints move all joints; tau is of the actuators.
    whole = mechanism_motion(robot, motion.joint_names, t, q, u, udot)
    q, u, udot, tau = _of_mechanism(robot, whole, t, bending)
    _require_finite(robot, speed * t, tau)
    return Demand(robot.joint_names, t, q, u, udot, tau, robot.limits,
                  per_joint(power, 'power', robot.joint_names, finite=False))


class DrivesAlong:
    """
    The drives of elastic joints along a motion of their links, at any speed.

    Parameters
    ----------
    robot : Robot
        With drives, as for `ElasticFeedforward`.
    motion : Motion or SmoothMotion
        Of the links, with a continuous jerk; under constraints of as many joints as
        independent speeds of the links.
    step, power
        As of `demand`.

    """

    def __init__(self, robot: Robot, motion: Motion | SmoothMotion, step: float,
                 power: ArrayLike) -> None:
        require_angles(robot.model, 'motion')
        if not isinstance(motion, SmoothMotion):
            instance(motion, Motion, 'motion')
        self.robot, self.step = robot, step
        self.feedforward = ElasticFeedforward(robot)
        self.feedforward.check_joints(motion.joint_names)
        names = self.feedforward.joint_names
        # The motion of the motors takes four derivatives of that of the links.
        if isinstance(motion, Motion):
            motion = SmoothMotion.from_motion(motion)
        self.motion = motion
        self._sampled: tuple[Array, Array, SmoothState] | None = None
        self.gears = tuple(elastic.name for elastic in robot.drives)
        self.links = list(map(robot.joint_names.index, names))

        # The links of elastic joints have the gears' limits, and no motor of their own.
        self.limits = limits_of_drives(robot)
        # The power of an elastic joint is that of its motor.
        self.power = per_joint(power, 'power', robot.joint_names, finite=False).copy()
        self.power[[elastic.link for elastic in robot.drives]] = math.inf

    def demand_at(self, speed: float, additional: Array) -> Demand:
        """Return the demand at the samples of the motion and at additional times."""
        return self.demand_of(*self._samples(additional), speed)

    def demand_of(self, t: Array, sampled_state: SmoothState, speed: float) -> Demand:
        """Return the demand of a motion of the links at times, (N,), and its states."""
        robot = self.robot
        # At the speed s the derivative of order k is s^k times as large.
        state = SmoothState(*[speed**order * derivative
                              for order, derivative in enumerate(sampled_state)])
        rows, links = self.feedforward.rows_along(t / speed, state, self.motion.joint_names)

        # Links with the torques of gears, or of rigid joints; then motors.
        columns = np.empty((4, len(t), robot.model.n))
        columns[:3, :, self.links] = links.swapaxes(0, 1)
        columns[3][:, self.links] = rows[:, 0]
        joint_names = self.feedforward.joint_names
        for elastic in robot.drives:
            link = joint_names.index(elastic.name)
            columns[:, :, elastic.motor] = rows[:, 3:, link].T
        q, u, udot, tau = columns
        _require_finite(robot, t, tau)
        return Demand(robot.joint_names, t / speed, q, u, udot, tau, self.limits,
                      self.power, self.gears)

    def _samples(self, additional: Array) -> tuple[Array, SmoothState]:
        """Return the times of samples, (N,), and the motion there; as it was last."""
        if self._sampled is not None and np.array_equal(self._sampled[0], additional):
            return self._sampled[1:]
        motion = self.motion
        t = sample_times(motion.times, self.step, additional)
        ends = motion.times[[0, -1]]
        t = np.concatenate([ends[:1], t, ends[1:]])
        state = motion.sample(t)
        for derivative in state[1:]:  # the motion rests before and after
            derivative[[0, -1]] = 0.0
        self._sampled = additional, t, state
        return t, state


def limits_of_drives(robot: Robot) -> JointLimits:
    """Return the limits of a robot, with those of gears as efforts of elastic links."""
    limits = robot.limits
    effort = limits.effort.copy()
    for elastic in robot.drives:
        effort[elastic.link] = elastic.drive.gear_effort
    return replace(limits, effort=effort)


def refuse_with_drives(bending: QuasiStatic | None) -> None:
    """Raise InputError for bending, which is defined for robots with rigid joints alone."""
    if bending is not None:
        raise InputError('bending: given for a robot with elastic joints; expected '
                         'None, or rigid joints (with_rigid_joints)')


def motion_of_rigid_joints(motion: Motion | SmoothMotion) -> Motion:
    """Return the checked motion of a robot without drives."""
    if not isinstance(motion, Motion):
        raise InputError(f'motion: a {type(motion).__name__}; expected a Motion')
    return motion


def _speed(speed: float) -> float:
    """Return the checked factor of the speed of a motion."""
    return number(speed, 'speed', f'a number from {1.0 / FASTEST:g} to {FASTEST:g}',
                  lambda x: 1.0 / FASTEST <= x <= FASTEST)


def _require_finite(robot: Robot, t: Array, tau: Array) -> None:
    """Raise InputError for torques that are not finite; t are times of the motion."""
    if not np.isfinite(tau).all():
        k, j = np.argwhere(~np.isfinite(tau))[0].tolist()
        raise InputError(f"joint '{robot.joint_names[j]}': torque {tau[k, j]} at "
                         f'{t[k]:.4g} s; expected a motion with finite torques')


def _require_rigid_model(robot: Robot, bending: QuasiStatic) -> None:
    """Raise InputError unless a robot is the rigid model, with its actuators."""
    instance(bending, QuasiStatic, 'bending')
    bending.require_rigid_model(robot)
    equations = robot.equations
    if equations.actuated is not None:
        bending.require_drives('robot: actuated', robot.actuated_names)


def _of_mechanism(robot: Robot, whole: MechanismMotion, t: Array,
                  bending: QuasiStatic | None) -> tuple[Array, Array, Array, Array]:
    """Return q, rates, accelerations and torques of all joints, (N, n_q) each."""
    if bending is None:
        tau = robot.inverse_dynamics(*whole, t=t)
    else:
        tau = bending.inverse_dynamics(*whole)
    rates = robot.joint_rates(whole.q, whole.u, t=t)
    accelerations = robot.joint_accelerations(*whole, t=t)
    return whole.q, rates, accelerations, robot.joint_torques(tau, whole.q, t=t)


def require_scalable(robot: Robot, q: Array) -> None:
    """Raise InputError if speeds or constraints prescribe velocities."""
    # Joints that move at u = 0 have a velocity that the speed of the motion does not scale.
    robot.equations.require_timeless('robot', 'so that a motion can be scaled')
    if not len(q):
        return
    at_rest = robot.joint_rates(q, np.zeros((len(q), robot.n)))
    if np.abs(at_rest).max() > 0.0:
        raise InputError('robot: speeds or constraints that prescribe velocities; expected '
                         'those of a motion that can be scaled')


def unit_torques(robot: Robot, q: Array, joints: Sequence[int]) -> Array:
    """Return the torques of actuators for unit forces of some joints, (N, n_q, k)."""
    torques = np.empty((*q.shape, len(joints)))
    for k, j in enumerate(joints):
        unit = np.zeros_like(q)
        unit[:, j] = 1.0
        torques[..., k] = at_actuators(robot, q, unit)
    return torques


def at_actuators(robot: Robot, q: Array, forces: Array) -> Array:
    """Return the torques of actuators that balance forces of joints, (N, n) each."""
    force = robot.generalized_force(np.ascontiguousarray(forces), q)
    return robot.joint_torques(force, q)


def share(value: Array, bound: Array) -> Array:
    """Return value / bound; 0 for an infinite bound, and for a value and bound of 0."""
    with np.errstate(divide='ignore', invalid='ignore'):
        return np.asarray(np.where(value == 0.0, 0.0, value / bound))
