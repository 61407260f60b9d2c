"""
Limits of a robot at the points of a path as functions of x = s'^2, x' and x''.

With the torque a s'' + b s'^2 + c + friction (see `path_limits`) the limited quantities are

    velocity        q_s sqrt(x)
    acceleration    q_s x'/2 + q_ss x
    torque          a x'/2 + b x + c + friction(q_s sqrt(x))
    power           torque * velocity
    jerk            sqrt(x) (q_s x''/2 + 3/2 q_ss x' + q_sss x)
    torque rate     sqrt(x) (a x''/2 + (a_s/2 + b) x' + b_s x + c_s) + damping * acceleration

The rate of the torque is that without Coulomb friction.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.errors import InputError
from kane_dynamics.feasibility.jerk_limited.smooth_path import SmoothSection
from kane_dynamics.feasibility.path_geometry import STILL
from kane_dynamics.feasibility.path_limits import Bounds, friction, MARGIN
from kane_dynamics.feasibility.time_scale import HIGHEST
from kane_dynamics.motion.motion import Motion
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.differentiation import forward
from kane_dynamics.native.tracing.subroutine import Subroutines
from kane_dynamics.robot.robot import Robot
import numpy as np


class RateBounds(NamedTuple):
    """Limits of jerk and torque rate, (n,) arrays; infinite for none."""

    jerk: Array
    torque_rate: Array

    @property
    def given(self) -> bool:
        """Return whether there is a limit."""
        return bool(np.isfinite(self).any())

    def along(self, motion: Motion) -> 'RateBounds':
        """Return the limits without those on the jerk of joints that do not move."""
        t = motion.times
        q = np.concatenate([motion.positions, motion.positions_at(0.5 * (t[1:] + t[:-1]))])
        ranges = np.ptp(q, axis=0)
        return self._replace(jerk=np.where(ranges > STILL * ranges.max(), self.jerk, np.inf))


LIMITS = Bounds._fields + RateBounds._fields
BOUNDING = ('effort', 'acceleration', 'jerk', 'torque_rate')
UNBOUNDED = ('robot: no limit bounds the motion; expected limits of jerk, torque rate, effort or '
             'acceleration, which bound it everywhere')


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

    def __init__(self, robot: Robot, path: SmoothSection, bounds: Bounds, rates: RateBounds
                 ) -> None:
        """Compute the coefficients of the limited quantities."""
        q, first, second = (np.ascontiguousarray(rows) for rows in path.section[:3])
        self.robot, self.path = robot, path
        self.bounds = dict(zip(LIMITS, (*bounds, *rates)))
        self._check_limits(np.asarray(first.any(axis=0)))
        tau: Array = torque_rate_kernel(robot)(q, first, second, path.third)
        inertia, square, static, inertia_s, square_s, static_s = tau.transpose(1, 2, 0).copy()
        self.offset = friction(robot, np.zeros((1, robot.n)))[0]
        self._check_rest(static.T + self.offset)
        self.first, self.second = first.T.copy(), second.T.copy()
        self.effort = square, 0.5 * inertia, static
        self._check_effort(inertia)
        self.jerk = path.third.T.copy(), 1.5 * self.second, 0.5 * self.first
        self.torque_rate = square_s, 0.5 * inertia_s + square, 0.5 * inertia, static_s
        self.damping = damping(robot)[:, None]
        self.rough = robot.friction and any(
            body.joint.damping or body.joint.friction for body in robot.model.bodies)
        self.size = self._size()
        self.free = HIGHEST**2 * self.size
        self.tight = np.full((len(LIMITS), len(q), robot.n), 1.0 - MARGIN)

    def _check_limits(self, moves: Flags) -> None:
        """Raise InputError if a limit does not let the robot move, or none bounds its motion."""
        names = self.robot.joint_names
        for what, refused in (('jerk', moves), ('torque_rate', np.ones_like(moves))):
            still = (self.bounds[what] == 0.0) & refused
            if still.any():
                raise InputError(f"{what} of joint '{names[int(still.argmax())]}': limit 0; "
                                 'expected a positive limit')
        if not (moves & np.isfinite([self.bounds[name] for name in BOUNDING]).any(axis=0)).any():
            raise InputError(UNBOUNDED)

    def _check_effort(self, inertia: Array) -> None:
        """Raise InputError if a joint that the motion accelerates has no torque."""
        still = (self.bounds['effort'] == 0.0) & (
            np.abs(inertia).max(axis=1) > STILL * np.abs(inertia).max())
        if still.any():
            raise InputError(
                f"effort of joint '{self.robot.joint_names[int(still.argmax())]}': limit 0; "
                'expected a positive limit, since the motion needs a torque of the joint')

    def _size(self) -> float:
        """Return x of a fast motion: the largest one that a kind of limits allows, about."""
        inertia, found = np.abs(self.effort[1]), [self.path.section.span**-2]
        with np.errstate(divide='ignore', invalid='ignore'):
            for name, amounts, power in (
                    ('velocity', self.first, 2.0), ('acceleration', self.first, 1.0),
                    ('effort', inertia, 1.0), ('jerk', self.first, 2.0 / 3.0),
                    ('jerk', self.jerk[0], 2.0 / 3.0), ('torque_rate', inertia, 2.0 / 3.0)):
                x = (self.bounds[name][:, None] / np.abs(amounts))**power
                found.append(float(np.min(x, where=np.isfinite(x) & (x > 0.0), initial=np.inf)))
        sizes = [x for x in found[1:] if x < np.inf]
        return max(sizes) if sizes else found[0]

    def _check_rest(self, held: Array) -> None:
        """Raise InputError if the motors cannot hold the robot at a point."""
        bound = self.bounds['effort']
        with np.errstate(divide='ignore', invalid='ignore'):
            uses = np.nan_to_num(np.abs(held) / bound, posinf=np.inf)
        k, j = np.unravel_index(int(uses.argmax()), uses.shape)
        if uses[k, j] > 1.0:
            q = self.path.section.q[k].round(4).tolist()
            raise InputError(
                f"path: joint '{self.robot.joint_names[int(j)]}': torque {abs(held[k, j]):.6g} "
                f'at rest at {self.path.place[k]:.3g} of the path, {q}; expected at '
                f'most its effort limit {bound[j]:.6g}')

    def at(self, profile: Array) -> Uses:
        """Return the uses of all limits with x, x' and x'' at the points, (3, P)."""
        values, slopes = [], []
        for name, (value, *rows) in self._quantities(profile):
            bound = self.bounds[name]
            # A limit of 0 belongs to a joint that does not move.
            used = np.isfinite(bound) & ((bound > 0.0) | (name == 'effort'))
            if not used.any():
                continue
            scale = 1.0 / (self.tight[LIMITS.index(name)].T[used] * np.maximum(
                bound[used, None], 1e-300))
            values.append(value[used] * scale)
            slopes.append(np.stack([np.broadcast_to(row, value.shape)[used] * scale
                                    for row in rows]))
        fastest, none = profile[None, 0] / self.free, np.zeros((1, profile.shape[1]))
        values.append(fastest)
        slopes.append(np.stack([none + 1.0 / self.free, none, none]))
        return Uses(np.concatenate(values), np.concatenate(slopes, axis=1))

    def _quantities(self, profile: Array) -> Sequence[tuple[str, tuple[Any, ...]]]:
        """Return limited quantities with derivatives with respect to x, x', x'', (n, P) or 0."""
        x, change, bend = profile
        root = np.sqrt(x)
        half = 0.5 / root
        u, udot = self.first * root, self.second * x + 0.5 * self.first * change
        found: list[tuple[str, tuple[Any, ...]]] = [('velocity', (u, self.first * half, 0.0, 0.0))]
        accelerating = (udot, self.second, 0.5 * self.first, 0.0)
        found.append(('acceleration', accelerating))
        if np.isfinite([self.bounds['effort'], self.bounds['power']]).any():
            square, linear, static = self.effort
            tau, by_x = square * x + linear * change + static, square
            if self.rough:
                force, steep = friction(self.robot, np.ascontiguousarray(u.T))
                tau, by_x = tau + force.T, by_x + steep.T * self.first * half
            else:
                tau = tau + self.offset.T
            found.append(('effort', (tau, by_x, linear, 0.0)))
            if np.isfinite(self.bounds['power']).any():
                found.append(('power', (tau * u, by_x * u + tau * self.first * half,
                                        linear * u, 0.0)))
        for name, (by_x, by_change, by_bend, *static) in (
                ('jerk', self.jerk), ('torque_rate', self.torque_rate)):
            if not np.isfinite(self.bounds[name]).any():
                continue
            inner = by_x * x + by_change * change + by_bend * bend
            if static:
                inner = inner + static[0]
            rows: list[Any] = [inner * root, by_x * root + half * inner, by_change * root,
                               by_bend * root]
            if static:
                rows = [each + self.damping * more for each, more in zip(rows, accelerating)]
            found.append((name, tuple(rows)))
        return found


def torque_rate_kernel(robot: Robot) -> Kernel:
    """
    Return the kernel of coefficients of the torque and their derivatives by s, (6, n).

    Its arguments are q and its three derivatives with respect to s. The first three results
    multiply s'' and s'^2, and 1; friction is left out.
    """
    def values(q: Any, first: Any, second: Any, third: Any, parameters: Any) -> Any:
        equations: Any = robot.equations
        zero = np.zeros(robot.n)
        static, inertia, moving = (equations.rigid_dynamics(q, *state, None, parameters)
                                   for state in ((zero, zero), (zero, first), (first, second)))
        found = np.array([inertia - static, moving - static, static], dtype=object)
        slopes = forward(found.ravel(), [*q, *first, *second], [*first, *second, *third],
                         Subroutines())
        return np.concatenate([found, np.array(slopes, dtype=object).reshape(found.shape)])
    row = (robot.n,)
    return robot.compiled(values, name='path_torque_rate', q=row, first=row, second=row,
                          third=row, shape=(6, robot.n))


def damping(robot: Robot) -> Array:
    """Return the damping of the joints with respect to their coordinates, (n,)."""
    found = np.zeros(robot.n)
    for body in robot.model.bodies if robot.friction else ():
        found[body.joint.coordinate] += body.joint.multiplier**2 * body.joint.damping
    return found
