"""
Limits of a robot along a path as linear limits on s'^2 and s'' at its vertices.

Along q(s) the torque is a s'' + b s'^2 + c + friction(q_s s'), with a = M q_s, b = M q_ss + the
Coriolis forces at speeds q_s, and c = gravity, springs and the offset of friction. Friction is not
linear in x = s'^2. It is replaced with its tangent at a profile x, which the next profile refines
(sequential linear programming); the profile to which this converges satisfies the exact limits.
A limit P of the power bounds the torque by P / |q_s s'|, which is replaced likewise.
"""

from collections.abc import Sequence
import math
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.feasibility.banded_solution import kernels as compile_spline
from kane_dynamics.feasibility.path_geometry import Section
from kane_dynamics.feasibility.reachability import compile_passes, Limits
from kane_dynamics.feasibility.segment_peaks import peaks_kernel
from kane_dynamics.feasibility.time_scale import HIGHEST
from kane_dynamics.mechanics.friction import friction_slope, friction_torque
from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import trace_program
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import NDArray

Flags = NDArray[np.bool_]
FLAT = 1e-9  # least x, relative to its size, at which friction has a tangent
MARGIN = 5e-4  # of all limits, for the motion between the points
OUT_OF_REACH = 1e4  # width of a limit on one side, relative to its numbers
IRRELEVANT = 3.0  # torque of a limit of power at which it does not count, in limits of effort


class Bounds(NamedTuple):
    """Limits of the joints, (n,) arrays; infinite for none."""

    effort: Array
    velocity: Array
    power: Array
    acceleration: Array
    jerk: Array
    torque_rate: Array


class PathLimits:
    """The limits of a robot at the vertices of a section of a path."""

    def __init__(self, robot: Robot, section: Section, bounds: Bounds) -> None:
        """Compute the coefficients of the torque."""
        q, first, second = (np.ascontiguousarray(x[::2]) for x in section[:3])
        self.robot, self.section, self.bounds, self.first = robot, section, bounds, first
        self.second, count = second, len(q)
        tau: Array = torque_kernel(robot)(q, first, second)
        self.inertia, self.square, self.constant = tau[:, 0], tau[:, 1], tau[:, 2]
        self.offset, _ = friction(robot, np.zeros((1, robot.n)))
        with np.errstate(divide='ignore', invalid='ignore'):
            needs = (section.first / np.where(
                bounds.velocity > 0.0, bounds.velocity, 1.0)).T.copy()
            speed = 1.0 / (needs * needs).max(axis=0)
            rates = [np.fmin.reduce(bound / np.abs(size), axis=None, initial=np.inf)
                     for bound, size in ((bounds.effort, self.inertia),
                                         (bounds.acceleration, first))]
        # Sizes of x: at the fastest, and with an acceleration along the whole path.
        sizes = [x for x in (2.0 * min(rates), speed.min()) if 0.0 < x < np.inf] or [
            section.span**-2]
        self.free = HIGHEST**2 * float(sizes[0])  # x beyond which nothing bounds the path
        self.size = float(min(sizes))
        # In the middle between vertices x is the mean of theirs.
        middle = 2.0 * speed[1::2]
        self.most = np.minimum(speed[::2], self.free)
        self.most[1:] = np.minimum(self.most[1:], middle)
        self.most[:-1] = np.minimum(self.most[:-1], middle)
        # Factors of the limits of `Bounds`, smaller where a motion exceeds them between points.
        self.tight = np.full((len(bounds), count, robot.n), 1.0 - MARGIN)

    def check_rest(self) -> None:
        """Raise InputError if the motors cannot hold the robot at a vertex."""
        bound = self.bounds.effort
        with np.errstate(divide='ignore', invalid='ignore'):
            uses = np.nan_to_num(np.abs(self.constant) / bound, posinf=math.inf)
        k, j = np.unravel_index(int(uses.argmax()), uses.shape)
        if uses[k, j] > 1.0:
            q = self.section.q[2 * k].round(4).tolist()
            raise InputError(
                f"path: joint '{self.robot.joint_names[int(j)]}': torque "
                f'{abs(self.constant[k, j]):.6g} at rest at {k / (len(uses) - 1):.3g} of the '
                f'path, {q}; expected at most its effort limit {bound[j]:.6g}')

    @property
    def rough(self) -> bool:
        """Return whether there is friction."""
        return self.robot.friction and any(
            body.joint.damping or body.joint.friction for body in self.robot.model.bodies)

    @property
    def powered(self) -> bool:
        """Return whether there is a limit of power."""
        return bool(np.isfinite(self.bounds.power).any())

    @property
    def linear(self) -> bool:
        """Return whether the limits are linear in x: no friction, and no limit of power."""
        return not self.powered and not self.rough

    def at(self, x: Array | None) -> Limits:
        """Return the limits, exact at a profile x, (N + 1,); without friction for None."""
        given, x = x, np.maximum(1.0 if x is None else x, FLAT * self.size) * np.ones(
            len(self.constant))
        x = x[:, None]
        bounds, first = self.bounds, self.first
        alpha = self.inertia / (2.0 * self.section.step)
        beta, gamma = self.square, self.constant
        if given is not None and self.rough:
            root = np.sqrt(x)
            force, slope = friction(self.robot, root * first)
            change = slope * first / (2.0 * root)
            beta, gamma = beta + change, gamma + (force - self.offset - change * x)
        rows, middles, none = [], [], np.zeros_like(alpha)
        for name, lines in (('effort', (alpha, beta, gamma)), ('power', (alpha, beta, gamma)),
                            ('acceleration', (first / (2.0 * self.section.step), self.second,
                                              none))):
            limit = getattr(bounds, name)
            used = np.isfinite(limit)
            if name == 'acceleration':
                used &= first.any(axis=0)
            if not used.any():
                continue
            width = self.tight[Bounds._fields.index(name)] * limit
            if name == 'power':
                at = none if given is None else x
                rows += [block[:, :, used] for block in _one_sided(
                    *lines, *self._torque_of_power(width, at, first))]
                # The limit at the middle counts too; the mean of those at both ends exceeds it.
                alpha, beta, gamma, width, at = (0.5 * (line[1:] + line[:-1])
                                                 for line in (*lines, width, at))
                middles = [block[:, :, used] for block in _one_sided(
                    alpha, beta, gamma,
                    *self._torque_of_power(width, at, self.section.first[1::2]))]
                continue
            block = np.stack([*lines, width, none], axis=1)
            rows.append(block if used.all() else block[:, :, used])
        tight = self.tight[1].min(axis=1)
        most = np.minimum(self.most * tight**2, self.free)
        if not rows:
            rows = [np.zeros((len(x), 5, 1)) + [[0.0], [0.0], [0.0], [1.0], [0.0]]]
        for block in middles:
            block[:, 0] += 0.5 * block[:, 1]
        return Limits(_side_by_side(rows), _side_by_side(
            middles or [np.zeros((len(x) - 1, 5, 0))]), most)

    def _torque_of_power(self, power: Array, x: Array, first: Array) -> tuple[Array, Array]:
        """
        Return the tangent at x of the torque P / (|q_s| sqrt(x)), as its value at 0 and slope.

        The torque is convex in x, so a profile that satisfies the tangents satisfies the limit.
        It is irrelevant where x is so small that the limit of effort is lower; the tangent at
        the largest such x is irrelevant there too.
        """
        with np.errstate(divide='ignore', invalid='ignore'):
            speed = np.abs(first)
            x = np.maximum(x, (power / (IRRELEVANT * self.bounds.effort * speed))**2)
            torque = power / (speed * np.sqrt(x))
        matters = np.isfinite(torque) & np.isfinite(x)
        return (np.where(matters, 1.5 * torque, 1e6 * np.abs(self.constant).max() + 1e6),
                np.where(matters, -0.5 * torque / x, 0.0))


def torque_kernel(robot: Robot) -> Kernel:
    """
    Return the kernel of the coefficients of the torque, (3, n), without friction.

    Its arguments are q and its derivatives with respect to s. The results multiply s'' and s'^2,
    and the last one, with the offset of friction, is the torque at rest.
    """
    block = robot.parameters.block
    inputs: list[tuple[str, tuple[int, ...]]] = [(name, (robot.n,)) for name in (
        'q', 'first', 'second')]

    def values(q: Any, first: Any, second: Any, parameters: Any) -> Any:
        equations: Any = robot.equations
        zero = np.zeros(robot.n)
        static, inertia, moving = (equations.rigid_dynamics(q, *state, None, parameters)
                                   for state in ((zero, zero), (zero, first), (first, second)))
        return np.array([inertia - static, moving - static,
                         static + equations.friction_force(zero)])
    return robot.kernels.extra(
        'path_torque', lambda: trace_program('path_torque', values, [
            *inputs, ('parameters', block.shape)]),
        [Argument(*each) for each in inputs], block, (3, robot.n))


def compile_timing(robot: Robot) -> None:
    """Compile what `time_optimal` needs for limits of effort and velocity."""
    bounds = robot.limits.effort, robot.limits.velocity
    compile_passes(int(np.isfinite(bounds[0]).sum()) or 1)
    compile_spline(robot.n)
    torque_kernel(robot).compile_lanes()
    used = [name for name, bound in zip(Bounds._fields, bounds) if np.isfinite(bound).any()]
    if used:
        peaks_kernel(robot, used).compile_lanes()


def _side_by_side(blocks: Sequence[Array]) -> Array:
    """Return limits as one array for the passes."""
    return np.ascontiguousarray(blocks[0] if len(blocks) == 1 else np.concatenate(blocks, axis=2))


def _one_sided(alpha: Array, beta: Array, gamma: Array, width: Array, slope: Array
               ) -> tuple[Array, Array]:
    """
    Return |alpha v + beta x + gamma| <= width + slope x as two limits without slope.

    The other side of each is out of reach. So x of the width is that of the end of the interval
    where the limit counts there, and a profile that satisfies the limits at the previous profile
    satisfies those at itself.
    """
    far = OUT_OF_REACH * (np.abs(gamma) + width)
    upper, lower = (np.stack([alpha, beta - sign * slope, gamma + sign * (far - width), far,
                              np.zeros_like(far)], axis=1) for sign in (1.0, -1.0))
    return upper, lower


def friction(robot: Robot, rates: Array) -> tuple[Array, Array]:
    """Return the friction torques at joint rates, (N, n), with their slopes."""
    torque, slope = np.zeros_like(rates), np.zeros_like(rates)
    for body in robot.model.bodies if robot.friction else ():
        joint, k = body.joint, body.joint.coordinate
        rate = joint.multiplier * rates[:, k]
        torque[:, k] += joint.multiplier * friction_torque(joint, rate)
        slope[:, k] += joint.multiplier**2 * friction_slope(joint, rate)
    return torque, slope
