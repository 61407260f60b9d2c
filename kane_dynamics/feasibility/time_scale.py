"""
Highest speed at which a motion along its path satisfies all limits (time scaling).

A motion q(s t), s times as fast as q(t), has the speeds s u and accelerations s^2 udot. Its torque
at a sample is a quadratic in s plus Coulomb friction,

    tau(s) = s^2 (M udot + Coriolis) + s d u + (gravity + springs + offset) + T(s u),

(Hollerbach, ASME J. Dynamic Systems 106 (1984), with friction added). Each limit excludes
intervals of s in closed form; the result is the highest s outside all of them. It is exact without
Coulomb friction and power limits. T(s u) = mu tanh(s u / u_s) is monotonic in s, and a power limit
P bounds tau by P / (s |u|). Over an interval of s both lie between their values at its ends. These
give an inner and an outer estimate of the excluded intervals; intervals are split until both
agree. If the motion at the resulting speed comes close to a limit between samples, samples are
added there and the search is repeated. A slower motion is not always feasible: an arm that cannot
hold a configuration may swing through it.

With closed loops or chosen speeds all rates are proportional to s, too, and the torques of the
actuators are a linear map W(q) of the forces of the joints: W_ij T_j(s) is monotonic in s.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
import math

from kane_dynamics._util.checks import per_joint
from kane_dynamics._util.typing import Array
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.errors import InputError
from kane_dynamics.feasibility.samples import NONE, ROUNDING, ROUNDS, sampled, STEP
from kane_dynamics.feasibility.torque_demand import (at_actuators, Demand, demand_at,
                                                     require_scalable, torque_of,
                                                     unit_torques, whole_motion)
from kane_dynamics.loop_tracking.driven_mechanism import MechanismMotion
from kane_dynamics.mechanics.algebra.fixed_point import upper_fixed_point
from kane_dynamics.mechanics.algebra.intervals import highest_free, positive_intervals
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike, NDArray

LOWEST, HIGHEST = 1e-6, 1e4  # range of the search
PRECISION = 1e-10  # relative, of the speed with friction, power limits or beams

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
        The joint that reaches a limit, and the limit: 'effort', 'velocity' or 'power'.
    t : float or None
        Time of that, s, in the scaled motion.

    """

    speed: float
    joint: str | None = None
    limit: str | None = None
    t: float | None = None


def fastest(robot: Robot, motion: Motion, *, most: float = math.inf, step: float = STEP,
            power: ArrayLike = math.inf, bending: QuasiStatic | None = None
            ) -> TimeScale | None:
    """
    Return the highest speed at which a motion satisfies all limits; None if there is none.

    Parameters
    ----------
    robot : Robot
        With chosen speeds or constraints, as for `demand`; they must not prescribe velocities.
    motion : Motion
        As for `demand`: of the robot's joints, or of the driving joints.
    most : float
        Highest speed to consider.
    step : float
        Largest time between two samples of the motion at speed 1, s.
    power : float or (n,) array_like
        Limit on the absolute mechanical power of each joint, W.
    bending : QuasiStatic, optional
        As in `demand`. The speed is a limit with the deflections that it causes.

    Returns
    -------
    TimeScale or None
        None if a position exceeds its limits, or no speed from 1e-6 up satisfies the limits:
        usually because the motors cannot hold a configuration, which
        ``demand(robot, motion, speed=1e-6).excesses`` names.

    Raises
    ------
    InputError
        If the robot, the motion or a number is invalid; the message names it.

    """
    if not most > 0.0:
        raise InputError(f'most: {most}; expected a positive number')

    def torques(more: Array, speed: float) -> list[Array]:
        return [demand_at(robot, motion, speed, step, power, more, arm).tau
                for arm in (bending, None)]
    more = NONE
    for _ in range(ROUNDS + 1):
        path = SampledPath(robot, motion, step, power, more)
        top = min(most, HIGHEST, path.speed_bound)
        if not path.inside or top < LOWEST:
            return None
        speed = _highest_speed(path, LOWEST, top) if bending is None else (
            _highest_bent(path, top, partial(torques, more)))
        if speed is None:
            return None
        asked = demand_at(robot, motion, speed, step, power, more, bending)
        scale = TimeScale(math.inf) if speed == HIGHEST else _bound(asked, speed)
        refined = asked.in_doubt
        if not refined.size:
            break
        more = np.concatenate([more, speed * refined])
    return scale


def _bound(asked: Demand, speed: float) -> TimeScale:
    """Return the highest speed and the limit that bounds it."""
    uses = asked.uses
    limit = max(uses, key=lambda name: float(uses[name].max()))
    j = int(uses[limit].argmax())
    if uses[limit][j] < 1.0 - 1e3 * ROUNDING:
        return TimeScale(speed)
    values = {'effort': asked.tau, 'velocity': asked.u, 'power': asked.power}[limit]
    return TimeScale(speed, asked.joint_names[j], limit,
                     float(asked.t[int(np.abs(values[:, j]).argmax())]))


class SampledPath:
    """
    Torque of a motion at its samples as a function of the speed; arrays are (N, n).

    Parameters
    ----------
    robot, motion, step
        As in `fastest`.
    power : float or (n,) array_like
        As in `fastest`.
    more : (k,) array
        Additional times of the motion, s.

    """

    def __init__(self, robot: Robot, motion: Motion, step: float, power: ArrayLike,
                 more: Array) -> None:
        """Compute the coefficients of the torque as a polynomial in the speed."""
        require_angles(robot.model, 'fastest')
        t, q, self.u, udot = sampled(robot, motion, step, more)
        self.friction, limits = robot.friction_force, robot.limits
        self.shared: Array | None = None  # torques of actuators by unit forces of `rough`
        if not robot.equations.in_joint_rates:
            whole = self._of_mechanism(robot, motion, t, q, udot)
            q, terms = whole.q, robot.torque_terms(*whole)
            terms = np.stack([robot.joint_torques(np.ascontiguousarray(term), q)
                              for term in np.moveaxis(terms, 1, 0)])
        else:
            terms = np.moveaxis(robot.torque_terms(q, self.u, udot), 1, 0)
        inertia, coriolis, gravity, _, spring = terms
        self.offset = self.friction(np.zeros(robot.n_q))
        self.damping = _damping(robot)
        self.square = inertia + coriolis
        rest = np.broadcast_to(self.offset, self.u.shape)
        self.constant = gravity + spring + at_actuators(robot, q, rest)
        self.linear = at_actuators(robot, q, self.u * self.damping)
        self.effort = limits.effort
        self.power = per_joint(power, 'power', robot.joint_names, finite=False)
        slack = [ROUNDING * np.maximum(1.0, np.abs(b)) for b in (limits.lower, limits.upper)]
        self.inside = bool(((q >= limits.lower - slack[0])
                            & (q <= limits.upper + slack[1])).all())
        with np.errstate(divide='ignore', invalid='ignore'):
            bound = limits.velocity / np.abs(self.u).max(axis=0)
        self.speed_bound = float(np.fmin.reduce(bound, initial=math.inf))

    def _of_mechanism(self, robot: Robot, motion: Motion, t: Array, q: Array, udot: Array
                      ) -> MechanismMotion:
        """Return the motion of all joints, and store how their forces reach the actuators."""
        whole = whole_motion(robot, motion, t, q, self.u, udot)
        require_scalable(robot, whole.q)
        self.u = robot.joint_rates(whole.q, whole.u)
        self.friction = Robot(robot.model, friction=robot.friction).friction_force
        self.rough = sorted({body.joint.coordinate for body in robot.model.bodies
                             if robot.friction and body.joint.friction})
        self.shared = unit_torques(robot, whole.q, self.rough)
        return whole

    def coulomb(self, rows: Indices, speed: float) -> Array:
        """Return the Coulomb friction T of the joints at a speed."""
        u = speed * self.u[rows]
        return np.asarray(self.friction(u) - self.offset - u * self.damping)

    def coulomb_range(self, rows: Indices, low: float, high: float) -> tuple[Array, Array]:
        """Return bounds of the actuators' torques for T at speeds from low to high."""
        ends = np.stack([self.coulomb(rows, low), self.coulomb(rows, high)])
        if self.shared is None:
            return ends.min(axis=0), ends.max(axis=0)
        parts = self.shared[rows] * ends[:, :, None, self.rough]
        return parts.min(axis=0).sum(axis=-1), parts.max(axis=0).sum(axis=-1)

    def bound(self, rows: Indices, speed: float) -> Array:
        """Return the largest torque allowed by effort and power at a speed."""
        return np.minimum(self.effort, torque_of(self.power, speed * self.u[rows]))

    def forbidden(self, rows: Indices, low: float, high: float) -> tuple[Array, Array]:
        """
        Return excluded open intervals of speeds in (low, high), (k, 4, n, 2) each.

        Returns
        -------
        some, all_and_more : arrays
            Inner estimate and outer estimate of the excluded speeds.

        """
        least, largest = self.coulomb_range(rows, low, high)
        A, B, C = self.square[rows], self.linear[rows], self.constant[rows]
        wide, narrow = self.bound(rows, low), self.bound(rows, high)
        some, more = (np.concatenate([positive_intervals(A, B, C + under - bound),
                                      positive_intervals(-A, -B, -C - over - bound)], axis=1)
                      for under, over, bound in ((least, largest, wide),
                                                 (largest, least, narrow)))
        return some, more


def _damping(robot: Robot) -> Array:
    """Return the viscous friction coefficients of the coordinates, (n,)."""
    total = np.zeros(robot.n_q)
    for body in robot.model.bodies if robot.friction else ():
        total[body.joint.coordinate] += body.joint.multiplier**2 * body.joint.damping
    return total


def _highest_speed(path: SampledPath, low: float, high: float) -> float | None:
    """Return the highest allowed speed between low and high, or None."""
    boxes = [(low, high, np.arange(len(path.u)))]
    while boxes:
        low, high, rows = boxes.pop()
        some, more = path.forbidden(rows, low, high)
        up = highest_free(some.reshape(-1, 2), low, high)
        if up is None:
            continue
        down = highest_free(more.reshape(-1, 2), low, up)
        if down is not None and up - down <= PRECISION * up:
            return down
        if down is None:
            if up - low <= PRECISION * up:
                continue
            down = low
        # Samples without excluded speeds in the interval need no further check.
        touched = (more[..., 0] < np.minimum(up, more[..., 1])) & (more[..., 1] > down)
        rows = rows[touched.any(axis=(1, 2))]
        down = max(low, down * (1.0 - PRECISION))  # margin for rounding
        middle = math.sqrt(down * up)
        boxes += [(down, middle, rows), (middle, up, rows)]
    return None


def _highest_bent(path: SampledPath, top: float,
                  torques: Callable[[float], list[Array]]) -> float | None:
    """
    Return the highest speed with the deflections that it causes, or None.

    What these add to the torque, as `torques` with and without them, is a constant and a multiple
    of the squared speed, as inertial forces are, which follows from the speed before.
    """
    def added(speed: float) -> Array:
        bent, stiff = torques(speed)
        return bent - stiff
    at_rest, square = added(LOWEST), path.square
    path.constant = path.constant + at_rest

    def highest(before: float) -> float | None:
        if before > LOWEST:
            path.square = square + (added(before) - at_rest) / before**2
        return _highest_speed(path, LOWEST, top)
    return upper_fixed_point(highest, LOWEST, PRECISION, (
        f'bending: no highest speed found from {LOWEST:g}; expected beams that bend less'))
