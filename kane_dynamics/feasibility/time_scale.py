"""
Highest speed at which a motion along its path satisfies all limits (time scaling).

A motion q(s t), s times as fast as q(t), has the speeds s u and accelerations s^2 udot.
Its torque at a sample is a quadratic in s plus Coulomb friction,

    tau(s) = s^2 (M udot + Coriolis) + s d u + (gravity + springs + offset) + T(s u),

(Hollerbach, ASME J. Dynamic Systems 106 (1984), with friction added). Each limit
excludes intervals of s in closed form; the result is the highest s outside all of them.
It is exact without Coulomb friction and power limits. T(s u) = mu tanh(s u / u_s) is
monotonic in s, and a power limit P bounds tau by P / (s |u|). Over an interval of s both
lie between their values at its ends. These give an inner and an outer estimate of the
excluded intervals; intervals are split until both agree. If the motion at the resulting
speed comes close to a limit between samples, samples are added there and the search is
repeated. A slower motion is not always feasible: an arm that cannot hold a configuration
may swing through it.

With elastic joints the torques of the motors are polynomials of degree four in s, or
no polynomials with curves of stiffness and damping: speeds are tried from the highest one
down, in steps of 1 % (10 % where a limit is used ten times), and the first feasible one
is refined by bisection. Feasible ranges that are narrower are missed.

With closed loops or chosen speeds all rates are proportional to s, too, and the torques
of the actuators are a linear map W(q) of the forces of the joints: W_ij T_j(s) is
monotonic in s.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
import math

from kane_dynamics._util.checks import instance, number, per_joint
from kane_dynamics._util.typing import Array
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.errors import InputError
from kane_dynamics.feasibility.fixed_point import upper_fixed_point
from kane_dynamics.feasibility.intervals import highest_free, positive_intervals
from kane_dynamics.feasibility.samples import NONE, ROUNDING, ROUNDS, sampled, STEP
from kane_dynamics.feasibility.torque_demand import (at_actuators, Demand, demand_at,
                                                     DrivesAlong,
                                                     motion_of_rigid_joints,
                                                     refuse_with_drives,
                                                     require_scalable, torque_of,
                                                     unit_torques, whole_motion)
from kane_dynamics.loop_tracking.driven_mechanism import MechanismMotion
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.mechanics.friction import (damping_range, is_nonlinear,
                                              refuse_load_friction, stribeck_excess)
from kane_dynamics.motion.motion import Motion
from kane_dynamics.motion.smooth_motion import SmoothMotion
from kane_dynamics.robot.robot import Robot
from kane_dynamics.robot.torque_bounds import Uncertainty
import numpy as np
from numpy.typing import ArrayLike, NDArray

LOWEST, HIGHEST = 1e-6, 1e4  # range of the search
PRECISION = 1e-10  # relative, of the speed with friction, power limits or beams
# Relative steps of the speeds that are tried with elastic joints: the least one, and that of
# an arm which its motors cannot hold. Torques of motors grow with at most that power.
COARSE, WIDE, POWER = 0.01, 0.1, 4

Indices = NDArray[np.int_]


@dataclass(frozen=True, eq=False)
class TimeScale:
    """
    Highest speed of a motion, and the limit that bounds it.

    Attributes
    ----------
    speed : float
        Factor on the velocities of the motion; infinite if no limit bounds it.
    joint, limit : str or None
        The joint that reaches a limit, and the limit: 'effort', 'velocity', 'power', or
        'gear' of an elastic joint.
    t : float or None
        Time of that, s, in the scaled motion.

    """

    speed: float
    joint: str | None = None
    limit: str | None = None
    t: float | None = None


def fastest(robot: Robot, motion: Motion | SmoothMotion, *, most: float = math.inf,
            step: float = STEP, power: ArrayLike = math.inf,
            bending: QuasiStatic | None = None,
            uncertainty: Uncertainty | None = None) -> TimeScale | None:
    """
    Return the highest speed at which a motion satisfies all limits, if there is one.

    Parameters
    ----------
    robot : Robot
        With chosen speeds or constraints, as for `demand`; they must not prescribe
        velocities.
    motion : Motion or SmoothMotion
        As for `demand`: of the robot's joints, of the driving joints, or of the links of
        elastic joints.
    most : float
        Highest speed to consider.
    step : float
        Largest time between two samples of the motion at speed 1, s.
    power : float or (n,) array_like
        Limit on the absolute mechanical power of each joint, W.
    bending : QuasiStatic, optional
        As in `demand`. The speed is a limit with the deflections that it causes.
    uncertainty : Uncertainty, optional
        As in `demand`: the speed is feasible for all parameters of the box.

    Returns
    -------
    TimeScale or None
        None if a position exceeds its limits, or no speed from 1e-6 up satisfies the
        limits: usually because the motors cannot hold a configuration, which
        ``demand(robot, motion, speed=1e-6).excesses`` names.

    Raises
    ------
    InputError
        If the robot, the motion or a number is invalid; the message names it.

    """
    instance(robot, Robot, 'robot')
    most = number(most, 'most', 'a positive number', lambda x: x > 0.0)
    if robot.drives:
        refuse_with_drives(bending, uncertainty)
        return _fastest_of_drives(DrivesAlong(robot, motion, step, power), most)
    motion = motion_of_rigid_joints(motion)

    # The parts of the demand that depend on the speed in another way than rigid dynamics
    # do.
    def added_torques(additional: Array, speed: float) -> Array:
        """Return the torques due to the deflections at a speed."""
        bent = demand_at(robot, motion, speed, step, power, additional, bending).tau
        stiff = demand_at(robot, motion, speed, step, power, additional, None).tau
        return bent - stiff

    def deviation(additional: Array, speed: float) -> Array:
        """Return the largest deviation of the torques from the model at a speed."""
        return demand_at(robot, motion, speed, step, power, additional, None,
                         uncertainty).deviation
    if bending is not None and uncertainty is not None:
        raise InputError('uncertainty: given with bending; expected one of them')

    # The highest speed on given samples, and the demand there, for the refinement below.
    def highest(additional: Array) -> float | None:
        """Return the highest speed that fits at the samples."""
        path = SampledPath(robot, motion, step, power, additional)
        top = min(most, HIGHEST, path.speed_bound)
        if not path.inside or top < LOWEST:
            return None
        if bending is not None:
            return _highest_bent(path, top, partial(added_torques, additional))
        if uncertainty is not None:
            return _highest_uncertain(path, top, partial(deviation, additional))
        return _highest_speed(path, LOWEST, top)

    def demanded(additional: Array, speed: float) -> Demand:
        """Return the demand at a speed."""
        return demand_at(robot, motion, speed, step, power, additional, bending,
                         uncertainty)
    return _with_finer_samples(highest, demanded)


def _with_finer_samples(highest: Callable[[Array], float | None],
                        demanded: Callable[[Array, float], Demand]) -> TimeScale | None:
    """
    Return the highest speed; samples are added where the demand may rise between them.

    Parameters
    ----------
    highest : callable
        Returns the highest speed that fits at the samples with additional ones, or None.
    demanded : callable
        Returns the demand with additional samples at a speed.

    """
    additional = NONE
    # A speed is final if the demand at it cannot be larger between the samples.
    for _ in range(ROUNDS + 1):
        speed = highest(additional)
        if speed is None:
            return None
        at_speed = demanded(additional, speed)
        scale = TimeScale(math.inf) if speed == HIGHEST else _bound(at_speed, speed)
        refined = at_speed.in_doubt
        if not refined.size:
            break
        additional = np.concatenate([additional, speed * refined])
    return scale


def _fastest_of_drives(drives: DrivesAlong, most: float) -> TimeScale | None:
    """Return the highest speed of a motion of elastic joints, if there is one."""
    highest_before = min(most, HIGHEST)

    def demanded(additional: Array, speed: float) -> Demand:
        return drives.demand_at(speed, additional=additional)

    def highest(additional: Array) -> float | None:
        """Return the highest speed that fits at the samples, which further ones lower."""
        nonlocal highest_before
        # A position limit that the links exceed even at the slowest speed is exceeded at
        # any.
        slowest = demanded(additional, LOWEST)
        for excess in slowest.excesses:
            is_position = excess.limit in ('lower', 'upper')
            if is_position and excess.joint in drives.feedforward.joint_names:
                return None

        # The links' speeds are proportional to s.
        rates = np.abs(slowest.u[:, drives.links]).max(axis=0) / LOWEST
        with np.errstate(divide='ignore', invalid='ignore'):
            bound = drives.limits.velocity[drives.links] / rates
        top = float(np.fmin.reduce(bound, initial=highest_before))
        speed = _highest_tried(partial(demanded, additional), slowest, top)
        if speed is not None:
            highest_before = speed
        return speed
    return _with_finer_samples(highest, demanded)


def _highest_tried(at_samples: Callable[[float], Demand], slowest: Demand, top: float
                   ) -> float | None:
    """
    Return the highest speed up to `top` at which a demand fits, or None.

    `slowest` is the demand at the lowest speed.
    """
    too_fast = speed = top
    demanded = at_samples(speed)
    # Slower in steps that the excess over the limits implies.
    while not demanded.fits:
        too_fast = speed
        speed = speed / _slowdown(demanded, slowest)
        if speed < LOWEST:
            return None
        demanded = at_samples(speed)
    # The demand fits at `speed`, and no longer at the next faster one.
    # Bisect between a speed that fits and one that does not.
    while too_fast - speed > PRECISION * speed:
        middle = 0.5 * (speed + too_fast)
        if at_samples(middle).fits:
            speed = middle
        else:
            too_fast = middle
    return speed


def _slowdown(demanded: Demand, slowest: Demand) -> float:
    """
    Return a factor by which a motion is too fast at least; infinite if no speed fits.

    What a motion uses of a limit beyond the use at rest grows with at most the fourth
    power of the speed.
    """
    use = np.concatenate(list(demanded.uses.values()))
    at_rest = np.concatenate(list(slowest.uses.values()))
    largest = float(at_rest.max())
    if largest < 1.0:
        available = 1.0 - at_rest
        excess = float(((use - at_rest) / available).max())
        return max(1.0 + COARSE, math.pow(excess, 1.0 / POWER))
    # The arm cannot be held somewhere. Only a motion that helps its motors as much fits.
    if np.abs(use - at_rest).max() < largest - 1.0:
        return math.inf
    return max(1.0 + WIDE, math.pow(float(use.max()), 1.0 / POWER))


def _bound(demanded: Demand, speed: float) -> TimeScale:
    """Return the highest speed and the limit that bounds it."""
    uses = demanded.uses
    limit = max(uses, key=lambda name: float(uses[name].max()))
    j = int(uses[limit].argmax())
    if uses[limit][j] < 1.0 - 1e3 * ROUNDING:
        return TimeScale(speed)
    largest_torque = np.abs(demanded.tau) + demanded.deviation
    quantities = {'effort': largest_torque, 'gear': largest_torque,
                  'velocity': demanded.u, 'power': largest_torque * demanded.u}
    k = int(np.abs(quantities[limit][:, j]).argmax())
    return TimeScale(speed, demanded.joint_names[j], limit, float(demanded.t[k]))


class SampledPath:
    """
    Torque of a motion at its samples as a function of the speed; arrays are (N, n).

    Parameters
    ----------
    robot, motion, step
        As in `fastest`.
    power : float or (n,) array_like
        As in `fastest`.
    additional : (k,) array
        Additional times of the motion, s.

    """

    def __init__(self, robot: Robot, motion: Motion, step: float, power: ArrayLike,
                 additional: Array) -> None:
        """Compute the coefficients of the torque as a polynomial in the speed."""
        require_angles(robot.model, 'fastest')
        if robot.friction:
            refuse_load_friction(robot.model, 'fastest')
            _refuse_falling_friction(robot)
        t, q, self.u, udot = sampled(robot, motion, step, additional)
        self.friction, limits = robot.friction_force, robot.limits
        # Torques of actuators for unit forces of the joints `rough`.
        self.shared: Array | None = None
        if robot.equations.in_joint_rates:
            terms = np.moveaxis(robot.torque_terms(q, self.u, udot), 1, 0)
        else:
            whole = self._of_mechanism(robot, motion, t, q, udot)
            q = whole.q
            # Each term by itself on the joints with actuators.
            rows = []
            for term in np.moveaxis(robot.torque_terms(*whole), 1, 0):
                rows.append(robot.joint_torques(np.ascontiguousarray(term), q))
            terms = np.stack(rows)
        # At the speed s the torque is square s^2 + linear s + constant, by actuator.
        inertia, coriolis, gravity, _, spring = terms
        self.offset = self.friction(np.zeros(robot.n_q))
        self.damping = _damping(robot)
        self.square = inertia + coriolis
        offsets = np.broadcast_to(self.offset, self.u.shape)
        self.constant = gravity + spring + at_actuators(robot, q, offsets)
        self.linear = at_actuators(robot, q, self.u * self.damping)
        self.effort = limits.effort
        self.margin = np.zeros_like(self.u)  # of effort, for uncertain parameters
        self.power = per_joint(power, 'power', robot.joint_names, finite=False)
        # Positions do not depend on the speed: outside their limits no speed fits.
        above = q >= limits.lower - ROUNDING * np.maximum(1.0, np.abs(limits.lower))
        below = q <= limits.upper + ROUNDING * np.maximum(1.0, np.abs(limits.upper))
        self.inside = bool((above & below).all())
        # The speed at which the first joint reaches its limit of velocity.
        with np.errstate(divide='ignore', invalid='ignore'):
            bound = limits.velocity / np.abs(self.u).max(axis=0)
        self.speed_bound = float(np.fmin.reduce(bound, initial=math.inf))

    def _of_mechanism(self, robot: Robot, motion: Motion, t: Array, q: Array, udot: Array
                      ) -> MechanismMotion:
        """Return the motion of all joints; store how forces reach the actuators."""
        whole = whole_motion(robot, motion, t, q, self.u, udot)
        require_scalable(robot, whole.q)
        self.u = robot.joint_rates(whole.q, whole.u)
        self.friction = Robot(robot.model, friction=robot.friction).friction_force
        # Joints whose friction does not grow in proportion to the speed.
        rough = set()
        for body in robot.model.bodies:
            if robot.friction and is_nonlinear(body.joint):
                rough.add(body.joint.coordinate)
        self.rough = sorted(rough)
        self.shared = unit_torques(robot, whole.q, self.rough)
        return whole

    def coulomb(self, rows: Indices, speed: float) -> Array:
        """Return the Coulomb friction T of the joints at a speed."""
        u = speed * self.u[rows]
        return np.asarray(self.friction(u) - self.offset - u * self.damping)

    def coulomb_range(self, rows: Indices, low: float, high: float
                      ) -> tuple[Array, Array]:
        """Return bounds of the actuators' torques for T at speeds from low to high."""
        ends = np.stack([self.coulomb(rows, low), self.coulomb(rows, high)])
        if self.shared is None:
            return ends.min(axis=0), ends.max(axis=0)
        parts = self.shared[rows] * ends[:, :, None, self.rough]
        return parts.min(axis=0).sum(axis=-1), parts.max(axis=0).sum(axis=-1)

    def bound(self, rows: Indices, speed: float) -> Array:
        """Return the largest torque allowed by effort and power at a speed."""
        widest = np.minimum(self.effort, torque_of(self.power, speed * self.u[rows]))
        return np.asarray(widest - self.margin[rows])

    def forbidden(self, rows: Indices, low: float, high: float) -> tuple[Array, Array]:
        """
        Return excluded open intervals of speeds in (low, high), (k, 4, n, 2) each.

        Returns
        -------
        certain, possible : arrays
            Inner estimate and outer estimate of the excluded speeds.

        """
        least, largest = self.coulomb_range(rows, low, high)
        wide, narrow = self.bound(rows, low), self.bound(rows, high)
        # Friction between its bounds and the widest limit exclude the least; the other
        # way round they exclude the most.
        return (self._excluded(rows, least, largest, wide),
                self._excluded(rows, largest, least, narrow))

    def _excluded(self, rows: Indices, upward: Array, downward: Array, bound: Array
                  ) -> Array:
        """Return the speeds at which a torque with Coulomb friction is too large."""
        A, B, C = self.square[rows], self.linear[rows], self.constant[rows]
        above = positive_intervals(A, B, C + upward - bound)
        below = positive_intervals(-A, -B, -C - downward - bound)
        return np.concatenate([above, below], axis=1)


def _refuse_falling_friction(robot: Robot) -> None:
    """Raise InputError if the friction of a joint falls with its rate."""
    for body in robot.model.bodies:
        joint = body.joint
        if joint.stribeck_speed and stribeck_excess(joint):
            raise InputError(f"fastest: joint '{joint.name}' has a stribeck_speed of "
                             f'{joint.stribeck_speed:g}; expected 0, since friction must '
                             'not fall with the speed')


def _damping(robot: Robot) -> Array:
    """Return the least viscous friction coefficients of the coordinates, (n,)."""
    total = np.zeros(robot.n_q)
    for body in robot.model.bodies if robot.friction else ():
        least = damping_range(body.joint)[0]  # what is beyond it grows with the rate
        total[body.joint.coordinate] += body.joint.multiplier**2 * least
    return total


def _highest_speed(path: SampledPath, low: float, high: float) -> float | None:
    """Return the highest allowed speed between low and high, or None."""
    boxes = [(low, high, np.arange(len(path.u)))]
    while boxes:
        low, high, rows = boxes.pop()
        certain, possible = path.forbidden(rows, low, high)
        up = highest_free(certain.reshape(-1, 2), low, high)
        if up is None:
            continue
        down = highest_free(possible.reshape(-1, 2), low, up)
        if down is not None and up - down <= PRECISION * up:
            return down
        if down is None:
            if up - low <= PRECISION * up:
                continue
            down = low
        # Samples without excluded speeds in the interval need no further check.
        begin, end = possible[..., 0], possible[..., 1]
        touched = (begin < np.minimum(up, end)) & (end > down)
        rows = rows[touched.any(axis=(1, 2))]
        down = max(low, down * (1.0 - PRECISION))  # margin for rounding
        middle = math.sqrt(down * up)
        boxes += [(down, middle, rows), (middle, up, rows)]
    return None


def _highest_bent(path: SampledPath, top: float,
                  added_torques: Callable[[float], Array]) -> float | None:
    """
    Return the highest speed with the deflections that it causes, or None.

    What these add to the torque is a constant and a multiple of the squared speed, as
    inertial forces are, which follows from the speed before.
    """
    # Bending at rest does not depend on the speed, the rest of it grows with its square.
    at_rest = added_torques(LOWEST)
    square = path.square
    path.constant = path.constant + at_rest

    def highest(last: float) -> float | None:
        if last > LOWEST:
            path.square = square + (added_torques(last) - at_rest) / last**2
        return _highest_speed(path, LOWEST, top)
    message = (f'bending: no highest speed found from {LOWEST:g}; expected beams that '
               'bend less')
    return upper_fixed_point(highest, LOWEST, PRECISION, message)


def _highest_uncertain(path: SampledPath, top: float,
                       deviation: Callable[[float], Array]) -> float | None:
    """
    Return the highest speed that is feasible for all uncertain parameters, or None.

    What the parameters may add to the torque is a sum of absolute values, which follows
    from the speed before.
    """
    def highest(last: float) -> float | None:
        path.margin = deviation(last)
        return _highest_speed(path, LOWEST, top)
    message = (f'uncertainty: no highest speed found from {LOWEST:g}; expected smaller '
               'errors')
    return upper_fixed_point(highest, LOWEST, PRECISION, message)
