"""
Limits of a robot along a path as linear limits on s'^2 and s'' at its vertices.

Along q(s) the torque is a s'' + b s'^2 + c + friction(q_s s'), with a = M q_s, b = M q_ss + the
Coriolis forces at speeds q_s, and c = gravity, springs and the offset of friction. Friction is not
linear in x = s'^2. It is replaced with its tangent at a profile x, which the next profile refines
(sequential linear programming); the profile to which this converges satisfies the exact limits.
A limit P of the power bounds the torque by P / |q_s s'|, which is replaced likewise.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.feasibility.path_geometry import Section
from kane_dynamics.feasibility.reachability import IntervalLimits
from kane_dynamics.feasibility.segment_peaks import largest
from kane_dynamics.feasibility.time_scale import HIGHEST
from kane_dynamics.mechanics.friction import friction_slope, friction_torque
from kane_dynamics.motion.controller_points import Segments
from kane_dynamics.native.runtime.batch_kernel import batch_kernel
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.robot import Robot
import numpy as np

FLAT = 1e-9  # least x, relative to its size, at which friction has a tangent
MARGIN = 5e-4  # of all limits, for the motion between the points
ACTIVE = 1.0 - 0.5 * MARGIN  # share from which a limit is tightened
TIGHTER = 1.1  # by which a limit is tightened, in its excess
OUT_OF_REACH = 1e4  # width of a limit on one side, relative to its numbers
IRRELEVANT = 3.0  # torque of a limit of power at which it does not count, in limits of effort


class Bounds(NamedTuple):
    """Limits of the joints, (n,) arrays; infinite for none."""

    effort: Array
    velocity: Array
    power: Array
    acceleration: Array


class PathLimits:
    """
    The limits of a robot at the vertices of a section of a path.

    Attributes
    ----------
    stated : indices
        The joints that the path states; the others follow from them.
    acts : bool or (n,) array of bool
        Whether joints have torques.

    """

    stated: slice | Sequence[int] = slice(None)
    acts: Flags | bool = True

    def __init__(self, robot: Robot, section: Section, bounds: Bounds) -> None:
        """Compute the coefficients of the torque."""
        q, first, second = (x[::2] for x in section[:3])
        self.robot, self.section, self.bounds, self.first = robot, section, bounds, first
        self.second, count = second, len(q)
        self.powered = bool(np.isfinite(bounds.power).any())
        self.rough = robot.friction and any(
            body.joint.damping or body.joint.friction for body in robot.model.bodies)
        self.linear = not self.powered and not self.rough  # in x
        # The limits on the torque as lines of the passes, without friction and width.
        self.lines = np.empty((count, 4, robot.n_q))
        tau = self.lines[:, :3]
        self._compute_torques(q, first, second, tau)
        # Factors that make the largest of |a|, |q_s| and |q_s| its share of the limits.
        factors = [np.where(bound > 0.0, 1.0 / np.where(bound > 0.0, bound, 1.0), 0.0)
                   for bound in (bounds.effort, bounds.acceleration, bounds.velocity)]
        vertices, found = 2 * np.arange(count), np.empty((count, 2))
        bounds_kernel(robot.n_q).run(
            [tau[:, 0], first, section.first, section.first, np.array(factors)], found, count, {
                'before': np.maximum(vertices - 1, 1),
                'after': np.minimum(vertices + 1, 2 * count - 3)})
        # Sizes of x: at the fastest, and with an acceleration along the whole path.
        speed, need = found[:, 0].copy(), found[:, 1].max()
        sizes = [x for x in ((count - 1) / need if need else np.inf, speed.min())
                 if 0.0 < x < np.inf] or [(0.5 * (count - 1) / section.span)**2]
        self.free = HIGHEST**2 * float(sizes[0])  # x beyond which nothing bounds the path
        self.size = float(min(sizes))
        self.most = np.minimum(speed, self.free)
        # Factors of the limits of `Bounds`, smaller where a motion exceeds them between points.
        self.tight = np.full((count, len(bounds), robot.n_q), 1.0 - MARGIN)
        self._tight_speed = np.full(count, 1.0 - MARGIN)
        self.tightened: Segments = np.arange(count)  # vertices, since the latest limits
        self._used = {name: self._used_joints(name) for name in (
            'effort', 'power', 'acceleration')}
        self._latest: IntervalLimits | None = None
        self.sets: Array | None = None  # controllable sets with the latest limits

    def _compute_torques(self, q: Array, first: Array, second: Array, tau: Array) -> None:
        """Write the coefficients of the torques of `torque_kernel`, (N + 1, 3, n)."""
        kernel = torque_kernel(self.robot)
        if kernel.run([q, first, second], tau, len(q)):
            kernel(q, first, second)  # raises an error that names the state

    def _at_actuators(self, forces: Array) -> Array:
        """Return the torques of the actuators for forces of the joints, (N + 1, n) each."""
        return forces

    def speed_squared(self, vertex: int) -> float:
        """Return the squared speed of the joints that the path states, per unit of x."""
        first = self.first[vertex][self.stated]
        return float(first @ first)

    @property
    def constant(self) -> Array:
        """Return the torques at rest, (N + 1, n)."""
        return self.lines[:, 2]

    def tighten(self, shares: Array, largest: Array) -> None:
        """
        Make limits smaller where a motion uses more than them.

        Parameters
        ----------
        shares : (N + 1, 4, n) array
            The largest shares around the vertices.
        largest : (N + 1,) array
            The largest of them at each vertex.

        """
        tight = largest > ACTIVE
        # An excess also tightens the limits at the vertices beside it, but not at both ends.
        beside = tight[:-2] | tight[2:]
        tight[1:-1] |= beside
        near = np.flatnonzero(tight)
        inner = (near > 0) & (near < len(shares) - 1)
        worst = np.maximum(np.maximum(shares[near - inner], shares[near + inner]), shares[near])
        # The next profile leaves an excess beside a tightened limit; some more saves rounds.
        more = np.where(worst > 1.0, 1.0 + TIGHTER * (worst - 1.0), worst)
        self.tight[near] /= np.where(worst > ACTIVE, more / (1.0 - MARGIN), 1.0)
        self._tight_speed[near] = self.tight[near, 1].min(axis=1)
        self.tightened = near

    def at(self, x: Array | None, calm: bool = False) -> IntervalLimits:
        """
        Return the limits, exact at a profile x, (N + 1,); without friction for None.

        A limit of power falls steeply with x: a large x at one vertex and a small one at the next
        satisfy it, too, so the largest profile may alternate. With `calm`, x is at most that of
        steady motion there. The limits are valid until the next call, since they may share its
        memory.
        """
        if self.linear and self._latest is not None:
            return self._updated(self._latest)
        torque = self._torque_lines(x)
        rows: list[Array] = []
        middles: list[Array] = []
        steady = np.full(len(self.most), np.inf)
        for name in ('effort', 'power', 'acceleration'):
            used = self._used[name]
            if used is None:
                continue
            width = self.tight[:, Bounds._fields.index(name)] * getattr(self.bounds, name)
            if name == 'power':
                *lines, steady = self._power_lines(torque, width, x, used)
                for found, blocks in zip((rows, middles), lines):
                    found += blocks
                continue
            block = torque if name == 'effort' else np.stack(np.broadcast_arrays(
                self.first, self.second, 0.0, 0.0), axis=1)
            block[:, 3] = width
            rows.append(block if used.all() else block[:, :, used])
        most = np.minimum(self.most * self._tight_speed**2, self.free)
        if calm:
            most = np.minimum(most, steady)
        if not rows:
            rows = [np.zeros((len(most), 4, 1)) + [[0.0], [0.0], [0.0], [1.0]]]
        limits = IntervalLimits(_side_by_side(rows), _side_by_side(
            middles or [np.zeros((len(most) - 1, 4, 0))]), most)
        if self.linear:
            self._latest = limits
        return limits

    def _updated(self, limits: IntervalLimits) -> IntervalLimits:
        """Return linear limits after those at some vertices were tightened."""
        near = self.tightened
        begin = 0
        for name in ('effort', 'acceleration'):
            used = self._used[name]
            if used is None:
                continue
            width = self.tight[near, Bounds._fields.index(name)] * getattr(self.bounds, name)
            end = begin + int(used.sum())
            limits.rows[near, 3, begin:end] = width[:, used]
            begin = end
        limits.most[near] = np.minimum(self.most[near] * self._tight_speed[near]**2, self.free)
        return limits

    def _used_joints(self, name: str) -> Flags | None:
        """Return the joints for which a limit counts; None for no joint."""
        used = np.isfinite(getattr(self.bounds, name))
        if name != 'acceleration':
            used &= self.acts
        elif used.any():
            used &= self.first.any(axis=0)
        return used if used.any() else None

    def _from_rest(self, x: Array) -> Array:
        """Return a profile as a column, with a least value at which friction has a tangent."""
        return np.maximum(x, FLAT * self.size)[:, None]

    def _torque_lines(self, x: Array | None) -> Array:
        """Return the limits on the torque without width, with friction at x."""
        if x is None or not self.rough:
            return self.lines
        x, lines = self._from_rest(x), self.lines.copy()
        root = np.sqrt(x)
        force, slope = friction(self.robot, root * self.first)
        offset, _ = friction(self.robot, np.zeros((1, self.robot.n_q)))
        change = slope * self.first / (2.0 * root)
        lines[:, 1] += self._at_actuators(change)
        lines[:, 2] += self._at_actuators(force - offset - change * x)
        return lines

    def _power_lines(self, torque: Array, width: Array, x: Array | None, used: Flags
                     ) -> tuple[Sequence[Array], Sequence[Array], Array]:
        """
        Return the used limits of power at vertices and at the middles between.

        The third part is the largest x of steady motion where a limit is steep.
        """
        at = np.zeros((len(torque), 1)) if x is None else self._from_rest(x)
        each = [*torque.swapaxes(0, 1)[:3], np.broadcast_to(width, self.first.shape), at]
        alpha, beta, gamma, width, _ = each
        rows = [block[:, :, used] for block in _one_sided(
            alpha, beta, gamma, *self._torque_of_power(width, at, self.first))]
        # The limit at the middle counts too; the mean of those at both ends exceeds it.
        alpha, beta, gamma, width, at = (0.5 * (line[1:] + line[:-1]) for line in each)
        middles = [block[:, :, used] for block in _one_sided(
            alpha, beta, gamma, *self._torque_of_power(width, at, self.section.first[1::2]))]
        steady = np.minimum.reduce([_steady(block, 1.0) for block in rows])
        between = np.minimum.reduce([_steady(block, 0.5) for block in middles])
        steady[1:] = np.minimum(steady[1:], between)
        steady[:-1] = np.minimum(steady[:-1], between)
        for block in middles:
            block[:, 0] += 0.5 * block[:, 1]
        return rows, middles, steady

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
    def values(q: Any, first: Any, second: Any, parameters: Any) -> Any:
        equations: Any = robot.equations
        zero = np.zeros(robot.n)
        static, inertia, moving = (equations.rigid_dynamics(q, *state, None, parameters)
                                   for state in ((zero, zero), (zero, first), (first, second)))
        return np.array([inertia - static, moving - static,
                         static + equations.friction_force(zero)])
    row = (robot.n,)
    return robot.compiled(values, name='path_torque', q=row, first=row, second=row,
                          shape=(3, robot.n))


@cache
def bounds_kernel(n: int) -> Kernel:
    """
    Return the kernel of the largest x within the speed limits, and of a share of other limits.

    Its arguments are the coefficients of s'' in the torque and q_s at a vertex, q_s at the middles
    before and after it, (n,), and the reciprocal limits of torque, acceleration and speed. There
    x is the mean of both vertices'. The share is the largest for s'' = 1.
    """
    def values(inertia: Any, first: Any, before: Any, after: Any, factors: Any) -> Any:
        effort, acceleration, speed = factors
        needs = [largest((speed * each) * (speed * each)) for each in (first, before, after)]
        uses = np.concatenate([inertia * effort, first * acceleration])
        return np.array([1.0 / largest([needs[0], 0.5 * largest(needs[1:])]),
                         np.sqrt(largest(uses * uses))])
    return batch_kernel('path_bounds', values, [
        *((name, (n,)) for name in ('inertia', 'first', 'before', 'after')), ('factors', (3, n))],
        (2,))


def _side_by_side(blocks: Sequence[Array]) -> Array:
    """Return limits as one array for the passes."""
    return np.ascontiguousarray(blocks[0] if len(blocks) == 1 else np.concatenate(blocks, axis=2))


def _one_sided(alpha: Array, beta: Array, gamma: Array, width: Array, slope: Array
               ) -> tuple[Array, Array]:
    """
    Return |alpha v + beta x + gamma| <= width + slope x as two limits without slope.

    The other side of each is out of reach.
    """
    far = OUT_OF_REACH * (np.abs(gamma) + width)
    upper, lower = (np.stack([alpha, beta - sign * slope, gamma + sign * (far - width), far],
                             axis=1) for sign in (1.0, -1.0))
    return upper, lower


def _steady(block: Array, share: float) -> Array:
    """Return the largest x of steady motion where a share of beta exceeds alpha, else infinity."""
    alpha, beta, gamma, width = block.swapaxes(0, 1)
    with np.errstate(divide='ignore', invalid='ignore'):
        x = (width - np.sign(beta) * gamma) / np.abs(beta)
    return np.asarray(np.where(share * np.abs(beta) > np.abs(alpha), np.maximum(x, 0.0),
                               np.inf).min(axis=1))


def friction(robot: Robot, rates: Array) -> tuple[Array, Array]:
    """Return the friction torques at joint rates, (N, n), with their slopes."""
    torque, slope = np.zeros_like(rates), np.zeros_like(rates)
    for body in robot.model.bodies if robot.friction else ():
        joint, k = body.joint, body.joint.coordinate
        rate = joint.multiplier * rates[:, k]
        torque[:, k] += joint.multiplier * friction_torque(joint, rate)
        slope[:, k] += joint.multiplier**2 * friction_slope(joint, rate)
    return torque, slope
