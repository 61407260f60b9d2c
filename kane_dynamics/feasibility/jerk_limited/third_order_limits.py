"""
Limits of a robot at the points of a path as functions of x = s'^2, x' and x''.

With the torque a s'' + b s'^2 + c + friction (see `path_limits`) the limited quantities
are

    velocity        q_s sqrt(x)
    acceleration    q_s x'/2 + q_ss x
    torque          a x'/2 + b x + c + friction(q_s sqrt(x))
    power           torque * velocity
    jerk            sqrt(x) (q_s x''/2 + 3/2 q_ss x' + q_sss x)
    torque rate     sqrt(x) (a x''/2 + (a_s/2 + b) x' + b_s x + c_s)
                    + damping * acceleration

The rate of the torque is that without Coulomb friction.
"""

from collections.abc import Iterator
from typing import NamedTuple

from kane_dynamics._util.typing import Array, Flags, Matrix, Vector
from kane_dynamics.errors import InputError
from kane_dynamics.feasibility.jerk_limited.smooth_path import SmoothSection
from kane_dynamics.feasibility.path_geometry import STILL
from kane_dynamics.feasibility.path_limits import Bounds, friction, rough_coordinates
from kane_dynamics.feasibility.segment_peaks import MARGIN
from kane_dynamics.feasibility.time_scale import HIGHEST
from kane_dynamics.motion.motion import Motion
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.differentiation import forward
from kane_dynamics.native.tracing.subroutine import Subroutines
from kane_dynamics.robot.kernel_set import kernel_per_robot
from kane_dynamics.robot.robot import Robot
import numpy as np


class RateBounds(NamedTuple):
    """Limits of jerk and torque rate, (n,) arrays; infinite for none."""

    jerk: Array
    torque_rate: Array

    def along(self, motion: Motion) -> 'RateBounds':
        """Return the limits without those on the jerk of joints that do not move."""
        t = motion.times
        middles = motion.positions_at(0.5 * (t[1:] + t[:-1]))
        ranges = np.ptp(np.concatenate([motion.positions, middles]), axis=0)
        moves = ranges > STILL * ranges.max()
        return self._replace(jerk=np.where(moves, self.jerk, np.inf))


LIMITS = Bounds._fields + RateBounds._fields
BOUNDING = ('effort', 'acceleration', 'jerk', 'torque_rate')
UNBOUNDED = ('robot: no limit bounds the motion; expected limits of jerk, torque rate, '
             'effort or acceleration, which bound it everywhere')


class Uses(NamedTuple):
    """
    Shares of limits at the points, and their slopes.

    Attributes
    ----------
    values : (m, P) array
        Signed shares of m limits.
    slopes : (3, m, P) array
        Derivatives with respect to x, x' and x''.

    """

    values: Array
    slopes: Array


class LimitedQuantity(NamedTuple):
    """A limited quantity, (n, P), with its slopes in x, x' and x''; 0 for zeros."""

    value: Array
    by_x: Array
    by_change: Array | float
    by_bend: Array | float


class ThirdOrderLimits:
    """
    The limits of a robot at the points of a section that begins and ends at rest.

    Attributes
    ----------
    bounds : dict of (n,) arrays
        The limits by name.
    tight : (6, P, n) array
        Factors of the limits, smaller where a motion exceeds them between points.
    size, free : float
        x of a fast motion, about, and x beyond which nothing bounds the path.

    """

    def __init__(self, robot: Robot, path: SmoothSection, bounds: Bounds,
                 rates: RateBounds) -> None:
        """Compute the coefficients of the limited quantities."""
        q, first, second = (np.ascontiguousarray(rows) for rows in path.section[:3])
        self.robot, self.path = robot, path
        self.bounds = dict(zip(LIMITS, (*bounds, *rates)))
        self._check_limits(np.asarray(first.any(axis=0)))
        # a, b and c of the torque, and their slopes along s.
        tau: Array = torque_rate_kernel(robot)(q, first, second, path.third)
        coefficients = tau.transpose(1, 2, 0).copy()
        inertia, square, static, inertia_s, square_s, static_s = coefficients
        self.offset = friction(robot, np.zeros((1, robot.n)))[0]
        self._check_rest(static.T + self.offset)
        self.first = first.T.copy()
        self.second = second.T.copy()
        # Factors of x, x', (x'',) and 1.
        self.effort = square, 0.5 * inertia, static
        self._check_effort(inertia)
        self.jerk = path.third.T.copy(), 1.5 * self.second, 0.5 * self.first
        self.torque_rate = square_s, 0.5 * inertia_s + square, 0.5 * inertia, static_s
        self.damping = damping(robot)[:, None]
        self.rough = bool(rough_coordinates(robot))
        self.size = self._size()
        self.free = HIGHEST**2 * self.size
        self.tight = np.full((len(LIMITS), len(q), robot.n), 1.0 - MARGIN)

    def _check_limits(self, moves: Flags) -> None:
        """Raise InputError if a limit does not let the robot move, or none bounds it."""
        names = self.robot.joint_names
        for limit, refused in (('jerk', moves), ('torque_rate', np.ones_like(moves))):
            still = (self.bounds[limit] == 0.0) & refused
            if still.any():
                raise InputError(f"{limit} of joint '{names[int(still.argmax())]}': "
                                 'limit 0; expected a positive limit')
        bounded = np.isfinite([self.bounds[name] for name in BOUNDING]).any(axis=0)
        if not (moves & bounded).any():
            raise InputError(UNBOUNDED)

    def _check_effort(self, inertia: Array) -> None:
        """Raise InputError if a joint that the motion accelerates has no torque."""
        accelerated = np.abs(inertia).max(axis=1) > STILL * np.abs(inertia).max()
        still = (self.bounds['effort'] == 0.0) & accelerated
        if still.any():
            raise InputError(
                f"effort of joint '{self.robot.joint_names[int(still.argmax())]}': "
                'limit 0; expected a positive limit, since the motion needs a torque of '
                'the joint')

    def _size(self) -> float:
        """Return the approximate largest x that a kind of limits allows."""
        inertia = np.abs(self.effort[1])
        sizes = []
        # Each limit alone bounds x by a power of its ratio, since u ~ x^1/2, udot ~ x
        # and jerk ~ x^3/2.
        for name, amounts, power in (
                ('velocity', self.first, 2.0), ('acceleration', self.first, 1.0),
                ('effort', inertia, 1.0), ('jerk', self.first, 2.0 / 3.0),
                ('jerk', self.jerk[0], 2.0 / 3.0), ('torque_rate', inertia, 2.0 / 3.0)):
            with np.errstate(divide='ignore', invalid='ignore'):
                x = (self.bounds[name][:, None] / np.abs(amounts))**power
            counts = np.isfinite(x) & (x > 0.0)
            if counts.any():
                sizes.append(float(x[counts].min()))
        return max(sizes, default=self.path.section.span**-2)

    def _check_rest(self, held: Array) -> None:
        """Raise InputError if the motors cannot hold the robot at a point."""
        # A joint without effort and without load is no excess.
        bound = self.bounds['effort']
        with np.errstate(divide='ignore', invalid='ignore'):
            uses = np.nan_to_num(np.abs(held) / bound, posinf=np.inf)
        k, j = np.unravel_index(int(uses.argmax()), uses.shape)
        if uses[k, j] > 1.0:
            q = self.path.section.q[k].round(4).tolist()
            raise InputError(
                f"path: joint '{self.robot.joint_names[int(j)]}': torque "
                f'{abs(held[k, j]):.6g} at rest at {self.path.place[k]:.3g} of the '
                f'path, {q}; expected at most its effort limit {bound[j]:.6g}')

    def at(self, profile: Array) -> Uses:
        """Return the uses of all limits with x, x' and x'' at the points, (3, P)."""
        values, slopes = [], []
        for name, (value, *derivatives) in self._quantities(profile):
            bound = self.bounds[name]
            # A limit of 0 belongs to a joint that does not move.
            used = np.isfinite(bound) & ((bound > 0.0) | (name == 'effort'))
            if not used.any():
                continue
            tight = self.tight[LIMITS.index(name)].T[used]
            scale = 1.0 / (tight * np.maximum(bound[used, None], 1e-300))
            values.append(value[used] * scale)
            rows = [np.broadcast_to(row, value.shape)[used] for row in derivatives]
            slopes.append(np.stack(rows) * scale)
        # The limit on x itself, beyond which nothing bounds the path.
        values.append(profile[None, 0] / self.free)
        none = np.zeros((1, profile.shape[1]))
        slopes.append(np.stack([none + 1.0 / self.free, none, none]))
        return Uses(np.concatenate(values), np.concatenate(slopes, axis=1))

    def _quantities(self, profile: Array) -> Iterator[tuple[str, LimitedQuantity]]:
        """Yield the limited quantities by the names of their limits."""
        # With x = s'^2: u = q' s', udot = q'' x + q' x' / 2, and x' = 2 s''.
        x, change, bend = profile
        root = np.sqrt(x)
        half = 0.5 / root
        u_by_x = self.first * half
        velocity = LimitedQuantity(self.first * root, u_by_x, 0.0, 0.0)
        yield 'velocity', velocity
        udot = self.second * x + 0.5 * self.first * change
        acceleration = LimitedQuantity(udot, self.second, 0.5 * self.first, 0.0)
        yield 'acceleration', acceleration
        if self._limited('effort') or self._limited('power'):
            u = velocity.value
            # The torque with friction, which bends over x since its speed is q' sqrt(x).
            square, linear, static = self.effort
            tau, by_x = square * x + linear * change + static, square
            if self.rough:
                force, steep = friction(self.robot, np.ascontiguousarray(u.T))
                tau = tau + force.T
                by_x = by_x + steep.T * u_by_x
            else:
                tau = tau + self.offset.T
            yield 'effort', LimitedQuantity(tau, by_x, linear, 0.0)
            if self._limited('power'):
                yield 'power', LimitedQuantity(
                    tau * u, by_x * u + tau * u_by_x, linear * u, 0.0)
        if self._limited('jerk'):
            # Jerk and torque rate are sqrt(x) times a function that is linear in x, x'
            # and x''.
            by_x, by_change, by_bend = self.jerk
            inner = by_x * x + by_change * change + by_bend * bend
            yield 'jerk', LimitedQuantity(inner * root, by_x * root + half * inner,
                                          by_change * root, by_bend * root)
        if self._limited('torque_rate'):
            by_x, by_change, by_bend, static = self.torque_rate
            inner = by_x * x + by_change * change + by_bend * bend + static
            # The damping adds that times the acceleration.
            yield 'torque_rate', LimitedQuantity(
                inner * root + self.damping * udot,
                by_x * root + half * inner + self.damping * acceleration.by_x,
                by_change * root + self.damping * acceleration.by_change,
                by_bend * root)

    def _limited(self, name: str) -> bool:
        """Return whether a joint has a limit of a kind."""
        return bool(np.isfinite(self.bounds[name]).any())


@kernel_per_robot
def torque_rate_kernel(robot: Robot) -> Kernel:
    """
    Return the kernel of the torque's coefficients and their derivatives along s.

    The result is (6, n). Its arguments are q and its three derivatives with respect to
    s. The first three results multiply s'' and s'^2, and 1; friction is left out.
    """
    def values(q: Vector, first: Vector, second: Vector, third: Vector,
               parameters: Vector) -> Matrix:

        # tau = M q' x' / 2 + (M q'' + h) x + g along the path: three evaluations of
        # inverse dynamics.
        equations = robot.equations
        zero = np.zeros(robot.n)
        static = equations.rigid_dynamics(q, zero, zero, None, parameters)
        inertia = equations.rigid_dynamics(q, zero, first, None, parameters)
        moving = equations.rigid_dynamics(q, first, second, None, parameters)
        torque = np.array([inertia - static, moving - static, static], dtype=object)
        # Their derivatives along s, by dual numbers through the same equations.
        state, rates = [*q, *first, *second], [*first, *second, *third]
        slopes = forward(torque.ravel(), state, rates, Subroutines())
        by_s = np.array(slopes, dtype=object).reshape(torque.shape)
        return np.concatenate([torque, by_s])
    row = (robot.n,)
    return robot.compiled(values, name='path_torque_rate', q=row, first=row, second=row,
                          third=row, shape=(6, robot.n))


def damping(robot: Robot) -> Array:
    """Return the damping of the joints with respect to their coordinates, (n,)."""
    coefficients = np.zeros(robot.n)
    for body in robot.model.bodies if robot.friction else ():
        joint = body.joint
        coefficients[joint.coordinate] += joint.multiplier**2 * joint.damping
    return coefficients
