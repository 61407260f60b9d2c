"""
Limits of a robot along a path as linear limits on s'^2 and s'' at its vertices.

Along q(s) the torque is a s'' + b s'^2 + c + W friction(q_s s'), with a = M q_s, b = M
q_ss + the Coriolis forces at speeds q_s, and c = gravity, springs and the offset of
friction. W maps forces of joints to torques of actuators: one for trees in joint rates,
W(q) with chosen speeds or constraints, where a, b and c follow from the dynamics in the
independent speeds, which are linear in the rates and accelerations of the driving
joints.

Friction is not linear in x = s'^2. It is replaced with its tangent at a profile x, which
the next profile refines (sequential linear programming); the profile to which this
converges satisfies the exact limits. A limit P of the power bounds the torque by
P / |q_s s'|, which is replaced likewise.
"""

from collections.abc import Sequence
from functools import cache, lru_cache
from typing import NamedTuple

from kane_dynamics._util.typing import Array, Flags, Matrix, Vector
from kane_dynamics.feasibility.path_geometry import Section
from kane_dynamics.feasibility.reachability import IntervalLimits
from kane_dynamics.feasibility.segment_peaks import (ACTIVE, limited_quantities,
                                                     MARGIN)
from kane_dynamics.feasibility.time_scale import HIGHEST
from kane_dynamics.feasibility.torque_demand import at_actuators, unit_torques
from kane_dynamics.loop_tracking.driven_mechanism import motion_of_closed
from kane_dynamics.mechanics.algebra.choice import largest
from kane_dynamics.mechanics.friction import friction_slope, friction_torque, has_friction
from kane_dynamics.motion.controller_points import Segments
from kane_dynamics.native.runtime.kernel import batch_kernel, Kernel
from kane_dynamics.native.runtime.loops import BAD_RESULT
from kane_dynamics.robot.kernel_set import kernel_per_robot
from kane_dynamics.robot.robot import Robot
import numpy as np

SIZES = 2  # numbers of a vertex that are results of `bounds_kernel`
FLAT = 1e-9  # least x, relative to its size, at which friction has a tangent
OUT_OF_REACH = 1e4  # width of a limit on one side, relative to its numbers
IRRELEVANT = 3.0  # torque of a limit of power that does not count, in limits of effort


class Bounds(NamedTuple):
    """Limits of the joints, (n,) arrays; infinite for none."""

    effort: Array
    velocity: Array
    power: Array
    acceleration: Array


EVERY = slice(None)  # vertex
EFFORT, VELOCITY, POWER, ACCELERATION = range(len(Bounds._fields))


class PowerLines(NamedTuple):
    """Limits of power at vertices and in between, and the largest x of steady motion."""

    vertices: list[Array]
    middles: list[Array]
    steady: Array


class PathLimits:
    """
    The limits of a robot at the vertices of a section of a path.

    Parameters
    ----------
    robot : Robot
        The robot.
    section : Section
        The path of all joints.
    bounds : Bounds
        The limits of the joints.
    driving : list of int, optional
        With chosen speeds or constraints: the joints that determine the others.

    Attributes
    ----------
    linear, powered : bool
        Whether the limits are linear in x, and whether there are limits of power.
    most, free : (N + 1,) array and float
        Largest x within the limits of speed, and the x beyond which nothing bounds it.
    size : float
        An x of the size of a profile.
    tightened : (k,) array of int
        The vertices at which `tighten` made limits smaller at last.
    sets : array or None
        Controllable sets with linear limits, if known.

    """

    def __init__(self, robot: Robot, section: Section, bounds: Bounds,
                 driving: list[int] | None = None) -> None:
        q, first, second = (samples[::2] for samples in section[:3])
        count = len(q)
        self.robot, self.section, self.bounds = robot, section, bounds
        self._first, self._second, self._driving = first, second, driving
        self._rough = rough_coordinates(robot)
        self.powered = bool(np.isfinite(bounds.power).any())
        self.linear = not (self.powered or self._rough)
        # A row for each vertex: the results of `bounds_kernel`, and the limits on the
        # torque as lines of the passes, without friction and width.
        self._rows = np.empty((count, SIZES + 4 * robot.n_q))
        self._lines = self._rows[:, SIZES:].reshape(count, 4, robot.n_q)
        self._map: Array | None = None  # W of the joints with friction, (N + 1, n_q, k)
        self._acts: Flags | bool = True  # whether joints have torques
        if driving is None:
            self._compute_rows(vertex_kernel(robot), [q, first, second])
        else:
            self._mechanism_torques(q, driving)
            self._compute_rows(bounds_kernel(robot.n_q), [self._lines[:, 0], first])
        self._compute_sizes()
        # Factors of the limits, smaller where a motion exceeds them between points.
        self._quantities = limited_quantities(np.array(bounds))
        self._tight = np.full((count, len(self._quantities), robot.n_q), 1.0 - MARGIN)
        self._tight_speed = np.full(count, 1.0 - MARGIN)
        self._used = [self._used_joints(quantity) for quantity in range(len(bounds))]
        self._latest: IntervalLimits | None = None
        self.tightened: Segments = np.arange(count)
        self.sets: Array | None = None

    def _compute_rows(self, kernel: Kernel, inputs: list[Array]) -> None:
        """Write the results of a kernel at the vertices, beside which q_s is known too."""
        count, bounds = len(self._rows), self.bounds
        limits = np.array([bounds.effort, bounds.acceleration, bounds.velocity])
        # Factors that make the largest of |a|, |q_s| and |q_s| its share of the limits.
        factors = np.divide(1.0, limits, out=np.zeros_like(limits), where=limits > 0.0)
        first = self.section.first
        # The samples of the middles before and after each vertex; at the ends the only one.
        vertices = 2 * np.arange(count)
        before = np.maximum(vertices - 1, 1)
        following = np.minimum(vertices + 1, 2 * count - 3)
        inputs = [*inputs, first, first, factors]
        numbers = {'before': before, 'following': following}
        if kernel.run(inputs, self._rows, count, numbers) & BAD_RESULT:
            kernel(*inputs[:-3], first[before], first[following],
                   np.broadcast_to(factors, (count, *factors.shape)))  # names the state

    def _mechanism_torques(self, q: Array, driving: list[int]) -> None:
        """Write the coefficients of the torque with chosen speeds or constraints."""
        robot, q = self.robot, np.ascontiguousarray(q)
        rates, accelerations = self._first[:, driving], self._second[:, driving]
        t = np.zeros(len(q))
        whole = motion_of_closed(robot, driving, t, q, rates, accelerations)
        # u is linear in the rates, and multiplies s''; udot multiplies s'^2.
        # Along the path u = r s' and udot = r s'' + b s'^2, so that the torque is
        # inertia s'' + (change + coriolis) s'^2 + gravity + spring + friction.
        inertia, *_ = np.moveaxis(robot.torque_terms(q, 0.0 * whole.u, whole.u), 1, 0)
        terms = np.moveaxis(robot.torque_terms(*whole), 1, 0)
        change, coriolis, gravity, _, spring = terms
        # In the torques of the actuators, which have the limits.
        for k, force in enumerate((inertia, change + coriolis, gravity + spring)):
            self._lines[:, k] = robot.joint_torques(np.ascontiguousarray(force), q)
        offset = np.broadcast_to(friction(robot, np.zeros((1, robot.n_q)))[0], q.shape)
        self._lines[:, 2] += at_actuators(robot, q, offset)
        self._map = unit_torques(robot, q, self._rough)
        acts = self._lines[:, :3].any(axis=(0, 1)) | self._map.any(axis=(0, 2))
        self._acts = np.asarray(acts)

    def _at_actuators(self, forces: Array) -> Array:
        """Return the torques of the actuators for friction of the joints, (N + 1, n)."""
        if self._map is None:
            return forces
        return np.asarray(np.einsum('kij,kj->ki', self._map, forces[:, self._rough]))

    def _compute_sizes(self) -> None:
        """Compute the largest x within the limits of speed, and the size of x."""
        count = len(self._rows)
        with np.errstate(divide='ignore'):
            speed = 1.0 / self._rows[:, 0]
            # Sizes of x: with an acceleration along the whole path, and at the fastest.
            sizes = [(count - 1) / self._rows[:, 1].max(), speed.min()]
        sizes = [x for x in sizes if 0.0 < x < np.inf]
        if not sizes:
            sizes = [(0.5 * (count - 1) / self.section.span)**2]
        self.free = HIGHEST**2 * float(sizes[0])
        self.size = float(min(sizes))
        self.most = np.minimum(speed, self.free)

    def _used_joints(self, quantity: int) -> Flags | None:
        """Return the joints whose limit is linear in s'' and s'^2; None without any."""
        # Limits of speed bound s'^2 alone; others only joints that have a limit and
        # move.
        if quantity == VELOCITY:
            return None
        if quantity not in self._quantities:
            return None
        used = np.isfinite(self.bounds[quantity])
        if quantity == ACCELERATION:
            used &= self._first.any(axis=0)
        else:
            used &= self._acts
        return used if used.any() else None

    @property
    def constant(self) -> Array:
        """Return the torques at rest, (N + 1, n)."""
        return self._lines[:, 2]

    @property
    def largest_at_rest(self) -> Array:
        """Return the absolute torques at rest, (N + 1, n)."""
        return np.asarray(np.abs(self.constant))

    def speed_squared(self, vertex: int) -> float:
        """Return the squared speed of the driving joints, per unit of x."""
        first = self._first[vertex]
        if self._driving is not None:
            first = first[self._driving]
        return float(first @ first)

    def _tight_bounds(self, quantity: int, vertices: Segments | slice) -> Array:
        """Return the tightened limits of a quantity at some vertices, (k, n)."""
        tight = self._tight[vertices, self._quantities.index(quantity)]
        return np.asarray(tight * self.bounds[quantity])

    def tighten(self, shares: Array, largest: Array, factor: float) -> None:
        """
        Tighten the limits that a motion exceeds.

        Parameters
        ----------
        shares : (N + 1, k, n) array
            The largest shares around the vertices, of `limited_quantities`.
        largest : (N + 1,) array
            The largest of them at each vertex.
        factor : float
            By which a limit is tightened, in its excess.

        """
        tight = largest > ACTIVE
        # An excess also tightens the limits at the vertices beside it, but not at ends.
        beside = tight[:-2] | tight[2:]
        tight[1:-1] |= beside
        near = tight.nonzero()[0]
        inner = (near > 0) & (near < len(shares) - 1)
        # The largest use at a vertex and its two neighbors.
        worst = np.maximum(shares[near - inner], shares[near + inner])
        worst = np.maximum(worst, shares[near])
        # The excess is corrected in part, since tighter limits at one vertex relieve the
        # others.
        target = np.where(worst > 1.0, 1.0 + factor * (worst - 1.0), worst)
        tighter = np.where(worst > ACTIVE, target / (1.0 - MARGIN), 1.0)
        tight_limits = self._tight[near] / tighter
        self._tight[near] = tight_limits
        speeds = tight_limits[:, self._quantities.index(VELOCITY)]
        self._tight_speed[near] = speeds.min(axis=1)
        self.tightened = near

    def at(self, x: Array | None, calm: bool = False) -> IntervalLimits:
        """
        Return the limits, exact at a profile x, (N + 1,); without friction for None.

        A limit of power falls steeply with x: a large x at one vertex and a small one at
        the next satisfy it, too, so the largest profile may alternate. With `calm`, x is
        at most that of steady motion there. The limits are valid until the next call,
        since they may share its memory.
        """
        if self.linear and self._latest is not None:
            return self._updated(self._latest)

        # One block of rows for each limited quantity, each as a x' + b x + c within its
        # width.
        torque = self._torque_lines(x)
        most = np.minimum(self.most * self._tight_speed**2, self.free)
        rows: list[Array] = []
        middles: list[Array] = []
        for quantity, used in enumerate(self._used):
            if used is None:
                continue
            width = self._tight_bounds(quantity, EVERY)
            if quantity == POWER:
                # Power multiplies torque by speed: its lines are tangents, also at the
                # middles of intervals.
                lines = self._power_lines(torque, width, x, used)
                rows += lines.vertices
                middles += lines.middles
                if calm:
                    most = np.minimum(most, lines.steady)
                continue
            block = torque if quantity == EFFORT else self._acceleration_lines()
            block[:, 3] = width
            rows.append(block if used.all() else block[:, :, used])
        # The solver needs a row, so it gets one that always holds.
        if not rows:  # a limit that is always satisfied
            rows = [np.zeros((len(most), 4, 1)) + [[0.0], [0.0], [0.0], [1.0]]]
        if not middles:
            middles = [np.zeros((len(most) - 1, 4, 0))]
        limits = IntervalLimits(_side_by_side(rows), _side_by_side(middles), most)
        if self.linear:
            self._latest = limits
        return limits

    def _updated(self, limits: IntervalLimits) -> IntervalLimits:
        """Return the linear limits with the tightened ones of some vertices."""
        near = self.tightened
        begin = 0
        # Only the widths of the tightened vertices change, in the order of `at`.
        for quantity, used in enumerate(self._used):
            if used is None:
                continue
            width = self._tight_bounds(quantity, near)
            end = begin + int(used.sum())
            limits.rows[near, 3, begin:end] = width[:, used]
            begin = end
        tight = self._tight_speed[near]
        limits.most[near] = np.minimum(self.most[near] * tight**2, self.free)
        return limits

    def _acceleration_lines(self) -> Array:
        """Return the limits on the acceleration without width."""
        lines = np.zeros_like(self._lines)
        lines[:, 0] = self._first
        lines[:, 1] = self._second
        return lines

    def _torque_lines(self, x: Array | None) -> Array:
        """Return the limits on the torque without width, with friction at x."""
        if x is None or not self._rough:
            return self._lines
        x = self._from_rest(x)
        lines = self._lines.copy()
        root = np.sqrt(x)
        force, slope = friction(self.robot, root * self._first)
        offset, _ = friction(self.robot, np.zeros((1, self.robot.n_q)))
        # The tangent of friction(q_s sqrt(x)) over x.
        change = slope * self._first / (2.0 * root)
        lines[:, 1] += self._at_actuators(change)
        lines[:, 2] += self._at_actuators(force - offset - change * x)
        return lines

    def _from_rest(self, x: Array) -> Array:
        """Return a profile as a column, with a least x, where friction has a tangent."""
        return np.maximum(x, FLAT * self.size)[:, None]

    def _power_lines(self, torque: Array, width: Array, x: Array | None, used: Flags
                     ) -> PowerLines:
        """Return the used limits of power."""
        at = np.zeros((len(torque), 1))
        if x is not None:
            at = self._from_rest(x)
        width = np.broadcast_to(width, self._first.shape)
        lines = torque[:, :3]
        # Power is torque times rate: tangents of the torque that it leaves.
        tangents = self._torque_of_power(width, at, self._first)
        rows = []
        for block in _one_sided(lines, *tangents):
            rows.append(block[:, :, used])

        # The limit at the middle counts too; the mean of those at both ends exceeds it.
        lines = _middles(lines)
        first = self.section.first[1::2]
        tangents = self._torque_of_power(_middles(width), _middles(at), first)
        middles = []
        for block in _one_sided(lines, *tangents):
            middles.append(block[:, :, used])

        # The largest x at which the path is passed at a steady speed.
        steady = np.minimum.reduce([_steady(block, 1.0) for block in rows])
        between = np.minimum.reduce([_steady(block, 0.5) for block in middles])
        steady[1:] = np.minimum(steady[1:], between)
        steady[:-1] = np.minimum(steady[:-1], between)
        for block in middles:
            block[:, 0] += 0.5 * block[:, 1]
        return PowerLines(rows, middles, steady)

    def _torque_of_power(self, power: Array, x: Array, first: Array
                         ) -> tuple[Array, Array]:
        """
        Return the tangent at x of the torque P / (|q_s| sqrt(x)): value at 0 and slope.

        The torque is convex in x, so a profile that satisfies the tangents satisfies the
        limit. It is irrelevant where x is so small that the limit of effort is lower;
        the tangent at the largest such x is irrelevant there too.
        """
        # Far below the speed at which power matters, the torque would be infinite.
        with np.errstate(divide='ignore', invalid='ignore'):
            speed = np.abs(first)
            x = np.maximum(x, (power / (IRRELEVANT * self.bounds.effort * speed))**2)
            torque = power / (speed * np.sqrt(x))
            slope = -0.5 * torque / x
        matters = np.isfinite(torque) & np.isfinite(x)
        # A limit that is never reached, instead of none.
        far = 1e6 * np.abs(self.constant).max() + 1e6
        return np.where(matters, 1.5 * torque, far), np.where(matters, slope, 0.0)


def rough_coordinates(robot: Robot) -> list[int]:
    """Return the coordinates with friction."""
    if not robot.friction:
        return []
    rough = set()
    for body in robot.model.bodies:
        if has_friction(body.joint):
            rough.add(body.joint.coordinate)
    return sorted(rough)


@lru_cache(maxsize=8)  # most paths have a grid of the same size
@kernel_per_robot
def vertex_kernel(robot: Robot) -> Kernel:
    """
    Return the kernel of the limits of a tree at a vertex, (2 + 3 n,).

    Its arguments are q and its derivatives with respect to s, and the last three of
    `bounds_kernel`. The results are those of `bounds_kernel` and the coefficients of the
    torque, (3, n), without friction: they multiply s'' and s'^2, and the last one, with
    the offset of friction, is the torque at rest.
    """
    def values(q: Vector, first: Vector, second: Vector, before: Vector,
               following: Vector, factors: Matrix, parameters: Vector) -> Vector:
        equations = robot.equations

        # tau = M q' x' / 2 + (M q'' + h) x + g: three evaluations give the three
        # coefficients.
        zero = np.zeros(robot.n)
        static = equations.rigid_dynamics(q, zero, zero, None, parameters)
        inertia = equations.rigid_dynamics(q, zero, first, None, parameters) - static
        moving = equations.rigid_dynamics(q, first, second, None, parameters) - static
        at_rest = static + equations.friction_force(zero)
        sizes = _sizes_at(inertia, first, before, following, factors)
        return np.concatenate([sizes, inertia, moving, at_rest])
    row = (robot.n,)
    inputs = {'q': row, 'first': row, 'second': row, 'before': row, 'following': row,
              'factors': (3, robot.n)}
    return robot.kernels.compiled(values, 'path_vertex', inputs,
                                  (SIZES + 3 * robot.n,), ahead=False)


@cache
def bounds_kernel(n: int) -> Kernel:
    """
    Return the kernel of the least 1 / s'^2 within the speed limits, and of a share.

    Its arguments are the coefficients of s'' in the torque and q_s at a vertex, q_s at
    the middles before and after it, (n,), and the reciprocal limits of torque,
    acceleration and speed. The share is the largest fraction of a torque or acceleration
    limit that s'' = 1 takes.
    """
    names = ('inertia', 'first', 'before', 'following')
    return batch_kernel('path_bounds', _sizes_at, [
        *((name, (n,)) for name in names), ('factors', (3, n))], (SIZES,))


def _sizes_at(inertia: Vector, first: Vector, before: Vector, following: Vector,
              factors: Matrix) -> Vector:
    """Return the results of `bounds_kernel` at a vertex."""
    effort, acceleration, speed = factors
    needs = []
    for rates in (first, before, following):
        share = speed * rates
        needs.append(largest(share * share))
    shares = np.concatenate([inertia * effort, first * acceleration])
    # At a middle, x is the mean of its two vertices'.
    slowness = largest([needs[0], 0.5 * largest(needs[1:])])
    return np.array([slowness, np.sqrt(largest(shares * shares))])


def _side_by_side(blocks: Sequence[Array]) -> Array:
    """Return limits as one array for the passes, each vertex C-contiguous."""
    if len(blocks) == 1 and blocks[0][0].flags.c_contiguous:
        return blocks[0]
    return np.ascontiguousarray(np.concatenate(blocks, axis=2))


def _middles(values: Array) -> Array:
    """Return the means of neighbouring rows: values at the middles of intervals."""
    middles: Array = 0.5 * (values[1:] + values[:-1])
    return middles


def _one_sided(torque: Array, width: Array, slope: Array | float) -> list[Array]:
    """
    Return |torque| <= width + slope x as two limits without slope.

    The torque is a line alpha v + beta x + gamma, (N, 3, n). The other side of each limit
    is out of reach.
    """
    # The slope goes to the other side, with a width that is never reached.
    far = OUT_OF_REACH * (np.abs(torque[:, 2]) + width)
    added = np.zeros_like(torque)
    added[:, 1] -= slope
    added[:, 2] += far - width
    sides = []
    for sign in (1.0, -1.0):
        sides.append(np.concatenate([torque + sign * added, far[:, None]], axis=1))
    return sides


def _steady(block: Array, share: float) -> Array:
    """Return the largest x of steady motion where a share of beta exceeds alpha."""
    alpha, beta, gamma, width = block.swapaxes(0, 1)
    with np.errstate(divide='ignore', invalid='ignore'):
        x = (width - np.sign(beta) * gamma) / np.abs(beta)
    stiff = share * np.abs(beta) > np.abs(alpha)
    return np.asarray(np.where(stiff, np.maximum(x, 0.0), np.inf).min(axis=1))


def friction(robot: Robot, rates: Array) -> tuple[Array, Array]:
    """Return the friction torques at joint rates, (N, n), with their slopes."""
    torque = np.zeros_like(rates)
    slope = np.zeros_like(rates)
    if not robot.friction:
        return torque, slope
    # A coordinate has the friction of its joint and of those that mimic it.
    for body in robot.model.bodies:
        joint = body.joint
        k = joint.coordinate
        rate = joint.multiplier * rates[:, k]
        torque[:, k] += joint.multiplier * friction_torque(joint, rate)
        slope[:, k] += joint.multiplier**2 * friction_slope(joint, rate)
    return torque, slope
