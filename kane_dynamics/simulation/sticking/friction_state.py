"""
The joints that stick and those that slide, at states of a simulation.

Set-valued Coulomb friction of a joint at rest is any force up to breakaway friction. The
forces f of the joints at rest and their accelerations a solve one complementarity
problem, `mechanics.friction.held_forces`: a joint is held while the force that holds it
is within its bounds, else it begins to slide, with the friction of sliding. A stop at
which a joint rests makes one of its bounds infinite.

With constraints the forces act in the space of the admissible motions, where they change
the independent speeds by M^-1 T_s^T f.
"""

from itertools import pairwise
from typing import Any, NamedTuple, Protocol

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array, Flags, Scalar, Vector
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.mechanics.algebra.ltdl import factorize, solve
from kane_dynamics.mechanics.constraints.row_units import coordinate_units, rate_of
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.mechanics.friction import (AT_BOUND, driving_torque,
                                              has_breakaway_drop, has_dry_friction,
                                              held_forces, holding_friction,
                                              is_self_locking, stribeck_excess, UNLIMITED)
from kane_dynamics.mechanics.integrators.held_joints import linear_system, REGULAR
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.step_kernels import tau_from
import numpy as np

AT_REST = 3e-10  # rad, or lengths, in the time of the mechanism, with constraints
TOUCHING = 1e-9  # rad, or lengths of the mechanism: distance of a joint at its stop
NEGLIGIBLE = 1e-9  # acceleration, relative to the largest one without the forces
TRIALS = 4  # changes of joints that break away together, for each joint


class FrictionModes(NamedTuple):
    """
    Directions of sliding of k joints, and the joints that are held.

    Attributes
    ----------
    directions : (k,) array
        1 or -1 of a joint that slides, 0 of one that is held; times `at_bound` of one
        that others hold at the bound of its friction.
    sides : (k,) array
        1 or -1 of a held joint that rests at its upper or lower stop, else 0.

    """

    directions: Array
    sides: Array

    @property
    def held(self) -> Flags:
        """Return which joints are held, (k,) bool."""
        return np.asarray(self.directions == 0.0)

    def same(self, other: 'FrictionModes') -> bool:
        """Return whether the joints move in the same way."""
        return np.array_equal(self, other)


class Forces(NamedTuple):
    """
    Accelerations and forces at a state, with the friction of given directions.

    Those of K states have a leading axis.

    Attributes
    ----------
    udot : (n,) array
        Without forces that hold joints.
    v, a : (k,) arrays
        Rates and accelerations of the joints, also without these forces.
    B, A : (n, k), (k, k) arrays
        Accelerations of the speeds and of the joints per unit of each force.
    regular : (k, k) array
        A, made regular where constraints couple joints, which then share forces.
    least, largest : (k,) arrays
        Bounds of the force of friction on each joint at rest, N m or N.
    driving : (k,) array
        `friction.driving_torque` of self-locking joints that slide, N m or N.
    friction : (n_j,) array
        Torques that overcome the friction of all joints, without what holds joints.

    """

    udot: Array
    v: Array
    a: Array
    B: Array
    A: Array
    regular: Array
    least: Array
    largest: Array
    driving: Array
    friction: Array

    def holding(self, held: Flags) -> Array:
        """Return the forces that hold joints, (k,), zero of the others."""
        # Rows and columns of the others are those of the unit matrix.
        both = held[..., :, None] & held[..., None, :]
        unit = np.eye(held.shape[-1])
        A, regular = np.where(both, self.A, unit), np.where(both, self.regular, unit)
        motion = np.where(held, -self.a, 0.0)[..., None]
        forces: Array = np.linalg.solve(regular, motion)
        # One step of refinement, as of `held_response`.
        forces += np.linalg.solve(regular, motion - A @ forces)
        return forces[..., 0]

    def row(self, number: int) -> 'Forces':
        """Return the forces at one of several states."""
        return Forces(*(array[number] for array in self))


class FrictionSamples(NamedTuple):
    """
    Accelerations, forces and sticking joints at K states.

    Attributes
    ----------
    udot : (K, n) array
    stop_forces : (K, n_j) array
        Forces of the stops on the joints, N m or N.
    sticking : (K, n_j) array of bool
        Which joints friction holds.
    friction : (K, n_j) array
        Torques that overcome the friction of the joints, N m or N.

    """

    udot: Array
    stop_forces: Array
    sticking: Flags
    friction: Array


class StateFriction(Protocol):
    """The friction of a robot at states of a simulation, whichever law it has."""

    sticking: bool  # whether friction of joints is set-valued

    def at_samples(self, states: Array, tau: Array, times: Array) -> Any:
        """Return accelerations, forces of stops and friction at K states, (K, size)."""


class _Begins(NamedTuple):
    """
    Joints that begin to slide.

    Attributes
    ----------
    joints : (m,) array of int
    needed : (m,) array
        The forces that would hold them, N m or N.
    tried : bool
        Whether joints at their bounds changed their directions instead.

    """

    joints: Array
    needed: Array
    tried: bool


class FrictionState:
    """
    The friction of one robot, and its stops if they act, at states of a simulation.

    Parameters
    ----------
    robot : Robot
        The simulated robot, in the speeds of the states.
    stops : bool
        Whether there are stops at the position limits.
    dual_to : tuple of str, optional
        The speeds to which torques are dual. Default: those of the robot.

    Attributes
    ----------
    joints : list of k int
        The joints with friction or stops, as indices among the speeds of the joints.
    places : (k,) array of int
        Their places in q; -1 of parts of ball joints.
    lower, upper : (k,) arrays
        Their stops, rad or m; infinite where there is none.
    has_friction : (k,) array of bool
    drop : (k,) array
        By how much friction falls where joints begin to slide that constraints may hold at
        the bound of friction, N m or N; 0 of all others.
    at_bound : (k,) array
        `friction.AT_BOUND` of joints with such a drop; else 1.
    drops : bool
        Whether any joint has one.
    locks : bool
        Whether any of their drives is self-locking.

    """

    def __init__(self, robot: Robot, stops: bool,
                 dual_to: tuple[str, ...] | None = None) -> None:
        """Find the joints."""
        self.robot = robot
        self.stops = stops
        self.dual_to = dual_to

        # Joints that may stick, and joints with stops.
        model = robot.model
        with_friction = set()
        if robot.friction:
            for body in model.bodies:
                if has_dry_friction(body.joint):
                    with_friction.add(body.joint.coordinate)
        limits = robot.limits
        place_of: dict[int, int] = {}  # in q, of joints that have a position
        stopped = set()
        for joint, place in enumerate(model.places):
            if place is None:
                continue
            place_of[joint] = place
            if stops and np.isfinite([limits.lower[place], limits.upper[place]]).any():
                stopped.add(joint)

        # Of both kinds together: their places in q, and their stops.
        self.joints = sorted(with_friction | stopped)
        self.places = np.array([place_of.get(joint, -1) for joint in self.joints], dtype=int)
        self.lower = np.full(len(self.joints), -np.inf)
        self.upper = np.full(len(self.joints), np.inf)
        for row, joint in enumerate(self.joints):
            if joint in stopped:
                self.lower[row] = limits.lower[place_of[joint]]
                self.upper[row] = limits.upper[place_of[joint]]

        by_joint = model.coordinate_joints
        self.locks = robot.friction and any(is_self_locking(by_joint[joint])
                                            for joint in self.joints)
        self.has_friction = np.isin(self.joints, sorted(with_friction))

        # Joints of trees rest exactly, those of loops to the error of closing them.
        self.constrained = not robot.equations.in_joint_rates
        self.units = np.ones(len(self.joints))
        slow = 0.0
        if self.constrained:
            units = coordinate_units(model, robot.mechanism.constraints)
            self.units = units[self.places]
            slow = AT_REST * rate_of(model, robot.mechanism.constraints)
        self.slow = slow * self.units
        drop = np.zeros(model.n)
        # A joint alone with friction has no other that could hold it at its bound.
        if self.constrained and robot.friction and len(self.joints) > 1:
            for body in model.bodies:
                if has_breakaway_drop(body.joint):
                    size = abs(body.joint.multiplier)
                    drop[body.joint.coordinate] += size * stribeck_excess(body.joint)
        self.drop = drop[self.joints]
        self.at_bound = np.where(self.drop > 0.0, AT_BOUND, 1.0)
        self.drops = bool(self.drop.any())

    @lazy_property
    def finite_stops(self) -> Array:
        """Return the lower and upper stops for kernels, (2, k)."""
        # Infinite stops would make not-a-number of zero times infinity.
        return np.array([np.maximum(self.lower, -1e300), np.minimum(self.upper, 1e300)])

    @lazy_property
    def ends(self) -> Array:
        """Return where the entries of `Forces` but the last end in the kernel's result."""
        n, k = self.robot.n, len(self.joints)
        return np.cumsum([n, k, k, n * k, k * k, k, k, k])

    @lazy_property
    def parts(self) -> list[slice]:
        """Return the parts of the kernel's result."""
        ends = [0, *self.ends.tolist(), None]
        return [slice(begin, end) for begin, end in pairwise(ends)]

    @lazy_property
    def kernel(self) -> Kernel:
        """Return the kernel of accelerations, responses and bounds of friction: `Forces`."""
        robot = self.robot
        joints = self.joints
        dual_to = self.dual_to
        equations: Any = robot.equations
        n = robot.n
        k = len(joints)

        def forces(q: Vector, u: Vector, tau: Vector, directions: Vector, t: Scalar,
                   parameters: Vector) -> Vector:
            if dual_to is not None:
                tau = tau_from(equations, dual_to, q, tau, t)
            return traced_forces(equations, joints, q, u, tau, directions, t, parameters)
        name = f'forces_of_friction_{"_".join(map(str, joints))}'
        if dual_to is not None:
            name = f'{name}_dual_to_{"_".join(dual_to)}'
        tau_size = n if dual_to is None else len(dual_to)
        # udot; v and a of the joints; B and T_s B; both bounds and driving torques;
        # friction of all joints.
        return robot.compiled(forces, name=name, q=(robot.n_q,), u=(n,), tau=(tau_size,),
                              directions=(k,), shape=(n + 5 * k + n * k + k * k + robot.model.n,))

    def forces(self, state: Array, tau: Array, directions: Array, t: float) -> Forces:
        """Return `Forces` at a state, (size,), with the torque tau and these directions."""
        rows = state[None], tau[None], directions[None], np.array([t])
        return self.forces_at(*rows).row(0)

    def forces_at(self, states: Array, tau: Array, directions: Array,
                  times: Array) -> Forces:
        """Return `Forces` at K states, (K, size); the other arguments have K rows too."""
        robot = self.robot
        n_q, n, k = robot.n_q, robot.n, len(self.joints)
        # Without the checks of a call: states and torques are those of the simulation.
        inputs = [states[:, :n_q], states[:, n_q:n_q + n], tau, directions,
                  *robot.equations.time_inputs(times)]
        rows = np.empty((len(states), *self.kernel.shape))
        self.kernel.run([np.ascontiguousarray(x, dtype=np.float64) for x in inputs], rows,
                        len(rows))
        udot, v, a, B, A, *bounds_and_friction = (rows[:, part] for part in self.parts)
        A = A.reshape(-1, k, k)
        regular = A
        if self.constrained:  # may couple joints: then A is singular, and they share f
            size = A.diagonal(axis1=1, axis2=2).max(axis=1, initial=0.0)
            regular = A + REGULAR * size[:, None, None] * np.eye(k)
        return Forces(udot, v, a, B.reshape(-1, n, k), A, regular, *bounds_and_friction)

    def sides_at(self, q: Array) -> Array:
        """Return the stops at which joints are, (..., k): 1 upper, -1 lower, else 0."""
        x = np.where(self.places < 0, 0.0, q[..., self.places])
        near = TOUCHING * self.units * self.constrained
        return np.where(x >= self.upper - near, 1.0,
                        np.where(x <= self.lower + near, -1.0, 0.0))

    def modes(self, state: Array, tau: Array, t: float,
              sliding: dict[int, float] | None = None) -> FrictionModes:
        """
        Return how the joints move from a state on, under a torque.

        Parameters
        ----------
        state : (size,) array
            Entries as `step_kernels.state_names`.
        tau : array
            N m or N.
        t : float
            s.
        sliding : mapping of int to float, optional
            Directions of joints, by their numbers, that begin to slide now.

        """
        rows = state[None], tau[None], np.array([t])
        directions, sides = self.modes_at(*rows, sliding)
        return FrictionModes(directions[0], sides[0])

    def modes_at(self, states: Array, tau: Array, times: Array,
                 sliding: dict[int, float] | None = None) -> FrictionModes:
        """Return the modes at K states, (K, k); the arguments of `modes`, with K rows."""
        at_rest = np.zeros((len(states), len(self.joints)))
        rates = self.forces_at(states, tau, at_rest, times).v
        # Twice the rate at which a joint that stops has stopped, but for rounding.
        directions = np.sign(rates) * (np.abs(rates) > 2.0 * self.slow)
        for joint, direction in (sliding or {}).items():
            directions[:, joint] = direction
        at_stop = self.sides_at(states[:, :self.robot.n_q])

        # Joints that begin to slide have another friction then, which changes the forces
        # on those that still rest.
        at_begin = directions.copy()
        trials = np.zeros(len(directions), dtype=int)
        open_rows = np.flatnonzero((np.abs(directions) != 1.0).any(axis=1))
        while len(open_rows):
            forces = self.forces_at(states[open_rows], tau[open_rows],
                                    directions[open_rows], times[open_rows])
            changed = []
            for number, row in enumerate(open_rows.tolist()):
                begins = self._begins(forces.row(number), directions[row], at_stop[row])
                if self.locks:
                    self._require_driven(states[row], tau[row], times[row], begins)
                if begins.tried:
                    trials[row] += 1
                    # Without an answer, joints at their bounds slide once they move.
                    if trials[row] > TRIALS * len(self.joints):
                        directions[row] = at_begin[row]
                        continue
                if begins.tried or (len(begins.joints) and (directions[row] == 0.0).any()):
                    changed.append(row)
            open_rows = np.array(changed, dtype=int)
        return FrictionModes(directions, at_stop * (directions == 0.0))

    def _begins(self, forces: Forces, directions: Array, at_stop: Array) -> '_Begins':
        """Return the joints at rest that begin to slide, and set their directions."""
        # Joints at rest hold each other by forces within their bounds, as solved for
        # all at once.
        resting = np.flatnonzero(directions == 0.0)
        least, largest = bounds(forces, at_stop * (directions == 0.0))
        A = forces.regular[np.ix_(resting, resting)]
        f = held_forces(forces.a[resting], A, least[resting], largest[resting])
        a = forces.a[resting] + A @ f
        moves = np.abs(a) > NEGLIGIBLE * np.abs(forces.a).max(initial=1e-300)
        begins = np.sign(a[moves])
        needed = (f - a / np.diag(A))[moves]
        tried = False
        # Nothing moves: constraints may hold joints whose friction is at its bound.
        if self.constrained and not moves.any():
            reached = self._starts(forces, directions)
            of_all = forces.a + forces.regular[:, resting] @ f
            tried = self.drops and self._returns(forces, of_all, directions)
            if not tried:
                self._saturate(directions, resting, f, least[resting], largest[resting])
                tried = bool(reached.any()) and self._break_away(forces, directions)
        # The others begin to slide the way they accelerate.
        directions[resting[moves]] = begins
        return _Begins(resting[moves], needed, tried)

    def _starts(self, forces: Forces, directions: Array) -> Array:
        """Return which joints at rest have a direction of sliding, (k,) array of bool."""
        is_slow = np.abs(forces.v) <= 2.0 * self.slow
        return np.asarray(is_slow & (directions != 0.0))

    def _returns(self, forces: Forces, accelerations: Array, directions: Array) -> bool:
        """
        Hold the first joint at rest that does not accelerate in its direction of sliding.

        One whose friction has dropped must accelerate, one at its bound may rest.

        Parameters
        ----------
        forces : Forces
            With the friction of these directions.
        accelerations : (k,) array
            Of the joints, with the forces that hold those at rest.
        directions : (k,) array
            Changed in place.

        Returns
        -------
        bool
            Whether any direction changed.

        """
        # Accelerations that are zero but for rounding, by those that the drops cause.
        by_drops = np.abs(forces.A) @ self.drop
        zero = NEGLIGIBLE * (by_drops + np.abs(forces.a).max(initial=0.0))
        dropped = (np.abs(directions) == 1.0) & (self.drop > 0.0)
        along = np.sign(directions) * accelerations
        starts = self._starts(forces, directions)
        wrong = np.flatnonzero(starts & (along <= np.where(dropped, zero, -zero)))
        directions[wrong[:1]] = 0.0
        return bool(len(wrong))

    def _break_away(self, forces: Forces, directions: Array) -> bool:
        """
        Let joints at their bounds slide if no others hold them; arguments as `_returns`.

        They break away together, and their friction drops.
        """
        # The accelerations due to the drops, while joints at rest are held by any force.
        at_bound = np.abs(directions) > 1.5
        signs = np.sign(directions)
        response = forces.A @ np.where(at_bound, signs * self.drop, 0.0)
        held = directions == 0.0
        response += forces.A @ forces._replace(a=response).holding(held)
        by_drops = np.abs(forces.A) @ self.drop
        begins = at_bound & (signs * response > NEGLIGIBLE * by_drops)
        if begins.any():
            directions[at_bound] = np.where(begins, signs, 0.0)[at_bound]
        return bool(begins.any())

    def _require_driven(self, state: Array, tau: Array, t: float,
                        begins: '_Begins') -> None:
        """
        Raise InputError if the load of a self-locking drive helps its motor to move it.

        With the rotor as part of the load, the law then has several motions.
        """
        robot = self.robot
        q = state[:robot.n_q]
        torques = tau
        # The torque of the motor at the joint, without the offset of friction.
        if not robot.equations.in_joint_rates:
            torques = robot.joint_torques(tau, q, t=t)
        # f - a / A_jj is the force that would have held the joint by itself.
        for row, force in zip(begins.joints.tolist(), begins.needed):
            joint = robot.model.coordinate_joints[self.joints[row]]
            x = torques[self.joints[row]] - joint.friction_offset
            if is_self_locking(joint) and abs(force) > abs(x) and -force * x > 0.0:
                raise InputError(
                    f'sticking: at {t:.6g} s the load of the self-locking joint '
                    f"'{joint.name}' helps its motor to move it; expected a motor that "
                    'drives against the load, since the motion is not determined otherwise')

    def _saturate(self, directions: Array, resting: Any, f: Array, least: Array,
                  largest: Array) -> None:
        """
        Give joints at rest whose friction is at its bound the direction of sliding.

        Constraints may hold them through other joints at rest, between which forces are
        not unique; a friction at its bound is known.
        """
        between = (f > least) & (f < largest)
        if between.any():
            sign = np.where(f <= least, 1.0, -1.0)
            directions[resting] = np.where(between, 0.0, sign * self.at_bound[resting])


def friction_state(robot: Robot, stops: bool,
                   dual_to: tuple[str, ...] | None = None) -> FrictionState:
    """Return the `FrictionState` of a robot, made once for its limits and kept with it."""
    key = 'friction', stops_of(robot, stops), dual_to
    kept = robot.kernels.kept
    if key not in kept:
        kept[key] = FrictionState(robot, stops, dual_to)
    state: FrictionState = kept[key]
    return state


def stops_of(robot: Robot, stops: bool) -> tuple[bytes, bytes] | None:
    """Return the present stops of a robot, as a key; None if they do not act."""
    if not stops:
        return None
    return robot.limits.lower.tobytes(), robot.limits.upper.tobytes()


def traced_forces(equations: Any, joints: list[int], q: Vector, u: Vector, tau: Vector,
                  directions: Vector, t: Scalar, parameters: Vector) -> Vector:
    """Return the entries of `Forces` in a row; `tau` is dual to the robot's speeds."""
    # M udot = net, with the friction of sliding joints; B = M^-1 T_s^T responds to
    # forces on the joints.
    sliding = of_all_joints(equations, joints, directions)
    system = linear_system(equations, q, u, tau, None, parameters, t, sliding)
    T = np.eye(equations.n) if system.T is None else system.T
    T_s = T[joints]
    factors = factorize(system.M, system.order)
    udot = solve(factors, system.order, system.net)
    B = np.stack([solve(factors, system.order, row) for row in T_s], axis=1)
    # Accelerations of the joints without holding forces; with them, a + T_s B f.
    a = T_s @ udot + system.drift[joints]
    least, largest = friction_bounds(equations, joints, q, tau, t)
    driving = driving_torques(equations, joints, q, system.v, tau, directions, t)
    friction = equations.driven_friction(q, system.v, tau, t, sliding)
    return np.concatenate([udot, system.v[joints], a, np.ravel(B), np.ravel(T_s @ B),
                           least, largest, driving, friction])


def bounds(forces: Forces, sides: Array) -> tuple[Array, Array]:
    """Return the bounds of the forces on joints at rest, with those of stops, (k,) each."""
    least = np.where(sides > 0.0, -UNLIMITED, forces.least)
    largest = np.where(sides < 0.0, UNLIMITED, forces.largest)
    return least, largest


def friction_bounds(equations: Equations, joints: list[int], q: Vector, tau: Vector,
                    t: Scalar) -> tuple[Vector, Vector]:
    """
    Return the least and the largest force of friction on joints at rest, (k,) each.

    `tau`, (n,), is the generalized force of the motors.
    """
    model = equations.model
    torques: Any = np.zeros(model.n)
    if equations.carries_loads:
        torques = equations.drive_torques(q, tau, t)
    least: list[Scalar] = [0.0] * model.n
    largest: list[Scalar] = [0.0] * model.n
    if equations.friction:
        # A coordinate has the friction of its joint and of those that mimic it.
        for body in model.bodies:
            joint = body.joint
            r = joint.coordinate
            low, high = holding_friction(joint, torques[r])
            if joint.multiplier < 0.0:
                low, high = high, low
            # The force on the joint is opposite to the torque that overcomes friction.
            least[r] = least[r] - joint.multiplier * high
            largest[r] = largest[r] - joint.multiplier * low
    return np.array(least)[joints], np.array(largest)[joints]


def driving_torques(equations: Equations, joints: list[int], q: Vector, rates: Vector,
                    tau: Vector, directions: Vector, t: Scalar) -> Vector:
    """Return `friction.driving_torque` of self-locking joints, (k,); 1 of the others."""
    # A positive value drives; all other joints always do.
    result: list[Scalar] = [1.0] * len(joints)
    if not equations.carries_loads:
        return np.array(result)
    torques = equations.drive_torques(q, tau, t)
    for row, r in enumerate(joints):
        joint = equations.model.coordinate_joints[r]
        if is_self_locking(joint):
            driving = driving_torque(joint, rates[r], torques[r], directions[row])
            # Of a joint at rest it is no condition.
            result[row] = driving + select(directions[row] * directions[row] > 0.5, 0.0, 1.0)
    return np.array(result)


def of_all_joints(equations: Equations, joints: list[int], directions: Vector) -> Vector:
    """Return directions of k joints as those of all joints, (n_j,), 0 of the others."""
    result = np.zeros(equations.model.n).astype(object)
    for joint, direction in zip(joints, directions):
        result[joint] = direction
    return result
