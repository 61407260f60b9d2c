"""
The kernels of the stepper: one step in given modes with its guards, and what chooses modes.

Joints with friction or stops, and contacts, are rows, each with a mode. The modes are
numbers of an input, constant in the step, so that one program serves all of them and its
order is that of the integrator. A guard is positive while a row may keep its mode:
distances of rows that are open, rates of those that slide, margins of the forces of those
that are held. NaN is not positive.
"""

from enum import IntEnum
from functools import partial
import hashlib
import math
from typing import Any, NamedTuple

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.choice import magnitude, select, smallest
from kane_dynamics.mechanics.algebra.ltdl import factorize, solve
from kane_dynamics.mechanics.ball_joints import coordinate_rates
from kane_dynamics.mechanics.constraints.conditioning import LIMITS
from kane_dynamics.mechanics.contacts import contact_rows, ContactPair
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.mechanics.friction import AT_BOUND, driving_torque, holding_friction
from kane_dynamics.mechanics.integrators.held_joints import (held_solution, linear_system,
                                                             LinearSystem, Solution,
                                                             Solver)
from kane_dynamics.mechanics.integrators.interface import StageRates
from kane_dynamics.mechanics.integrators.rosenbrock import ImplicitStep
from kane_dynamics.mechanics.integrators.rows import (ContactModes, forces_of_held,
                                                      HeldJointRows, row_solution,
                                                      StageRows)
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import Program, Shape, trace_program
from kane_dynamics.native.tracing.subroutine import call
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.step_kernels import (deflection_input, first_stage_inputs,
                                                   independent_speeds, optional_inputs,
                                                   RobotMotion,
                                                   state_layout, step_signature,
                                                   StepChoice, tau_from, time_input,
                                                   traced_step, wrench_input)
import numpy as np

FINITE = 1e300  # in place of infinite bounds, for which 0 times infinity would be NaN
AT_STOP = 1e-11  # rad or m: past a stop, with constraints, after loops are closed
STILL = 1e-9  # rad/s or m/s: rate of a joint of a tree that others hold, rounding
SLIP = 1e-10  # m/s: against the direction of a slip that begins, rounding
ROUNDING = 1e-12  # of forces, relative: a margin of the guards of held rows
PER_JOINT, PER_CONTACT = 7, 9  # numbers of the modes of a row


class RowMode(IntEnum):
    """Mode of a row."""

    OFF = 0  # free: no friction, or no contact
    LOWER = 1  # held at the lower bound: at a stop, or touching without friction
    UPPER = 2  # held at the upper stop
    STICKING = 3  # held by friction
    FORWARD = 4  # sliding
    BACKWARD = 5
    BOUND_FORWARD = 6  # held by other rows, with its own friction at the bound
    BOUND_BACKWARD = 7
    SLIDING = 8  # of a contact, in any direction
    BOUND = 9  # of a contact that others hold, with its own friction at the bound


HELD = RowMode.LOWER, RowMode.UPPER, RowMode.STICKING
AT_BOUNDS = RowMode.BOUND_FORWARD, RowMode.BOUND_BACKWARD
SIGNS = {RowMode.FORWARD: 1.0, RowMode.BACKWARD: -1.0,
         RowMode.BOUND_FORWARD: 1.0, RowMode.BOUND_BACKWARD: -1.0}


class RowSet(NamedTuple):
    """
    The rows of a simulation of one robot.

    Attributes
    ----------
    robot : Robot
    sticking : bool
        Whether friction of joints is set-valued.
    dual_to : tuple of str or None
        The speeds to which torques are dual; None: those of the robot.
    joints : list of k int
        Joints with friction or stops, by their places among the joint rates.
    places : (k,) array of int
        Their places in q; 0 of parts of ball joints, which have no stops.
    lower, upper : (k,) arrays
        Their stops, rad or m; infinite where there is none.
    rubs : (k,) array of bool
        Whether they have set-valued friction.
    drops : (k,) array
        By how much friction falls at once where the joint begins to slide, N m or N.
    locks : (k,) array of bool
        Whether their drives are self-locking, with set-valued friction.
    slow : (k,) array
        Largest rate of a joint at rest: rounding, with constraints.
    pairs : tuple of c ContactPair
    friction, restitution : (c,) arrays
        Of the contacts.
    tree : bool
        Whether joints rest exactly: a tree in joint rates.
    feedback : float
        Rate at which held rows lose the error of the integrator, 1/s.

    """

    robot: Robot
    sticking: bool
    dual_to: tuple[str, ...] | None
    joints: list[int]
    places: Any
    lower: Array
    upper: Array
    rubs: Any
    drops: Array
    locks: Any
    slow: Array
    pairs: tuple[ContactPair, ...]
    friction: Array
    restitution: Array
    tree: bool
    feedback: float

    @property
    def name(self) -> str:
        """Return a text that tells the kernels of one robot apart."""
        parts = ['sticking' if self.sticking else 'smooth', *map(str, self.joints)]
        if self.dual_to is not None:
            parts += ['dual_to', *self.dual_to]
        if self.pairs:
            # All numbers of contacts are constants of the kernels.
            text = repr([(pair.shape, pair.radius, pair.surface_radius,
                          *(x.tolist() for frame in (pair.point, pair.surface)
                            for x in (np.array(frame.body), frame.rotation,
                                      frame.translation))) for pair in self.pairs])
            text += repr(self.friction.tolist())
            parts.append(hashlib.sha256(text.encode()).hexdigest()[:16])
        return ''.join(x if x.isalnum() else '_' for x in '_'.join(parts))


class ModeInputs(NamedTuple):
    """The modes of rows as numbers: (k,) arrays of joints, (c,) and (c, 2) of contacts."""

    held: Vector
    directions: Vector  # of friction of joints that slide
    sides: Vector  # -1 at the lower, 1 at the upper stop
    lower: Vector
    upper: Vector
    at_bound: Vector  # 1 of joints that others hold at the bound of their friction
    joint_forces: Vector  # as redundant rows share them
    touching: Vector
    sticking: Vector
    bound: Vector
    floors: Vector  # distances that contacts keep, or fall to while they are open
    begins: Matrix
    contact_forces: Matrix  # (c, 3)

    @classmethod
    def of(cls, rows: RowSet, numbers: Vector) -> 'ModeInputs':
        """Return the parts of an input, (7 k + 9 c,)."""
        joints, contacts = np.split(numbers, [PER_JOINT * len(rows.joints)])
        contacts = contacts.reshape(PER_CONTACT, -1)
        fields = [*joints.reshape(PER_JOINT, -1), *contacts[:4], contacts[4:6].T,
                  contacts[6:].T]
        return cls._make(fields)


class ModeChoice(NamedTuple):
    """
    Modes of k joints and c contacts, and directions (c, 2) near those of their slip.

    `forces`, (k + 3 c,), are those of the complementarity problem: redundant rows share as
    it does, since another share may be beyond a bound.
    """

    joints: tuple[RowMode, ...]
    contacts: tuple[RowMode, ...]
    begins: Array
    floors: Array  # (c,), rounding: distances that contacts keep, or fall to while open
    stops: Array  # (2, k), lower and upper; where a joint at its stop is, if others hold it
    forces: Array

    def directions(self, rows: RowSet) -> Array:
        """Return the directions of friction of joints, (k,), as `friction_torque`."""
        result = []
        for mode, drops in zip(self.joints, rows.drops):
            bound = AT_BOUND if mode in AT_BOUNDS and drops else 1.0
            result.append(SIGNS.get(mode, 0.0) * bound)
        return np.array(result)

    def numbers(self, rows: RowSet) -> Array:
        """Return the input of the kernel."""
        k = len(self.joints)
        sides = [{RowMode.LOWER: -1.0, RowMode.UPPER: 1.0}.get(mode, 0.0) for mode in self.joints]
        touching = [float(mode != RowMode.OFF) for mode in self.contacts]
        sticking = [float(mode == RowMode.STICKING) for mode in self.contacts]
        at_bound = [float(mode in AT_BOUNDS) for mode in self.joints]
        bound = [float(mode == RowMode.BOUND) for mode in self.contacts]
        return np.concatenate([
            [float(mode in HELD) for mode in self.joints], self.directions(rows), sides,
            np.clip(self.stops, -FINITE, FINITE).ravel(), at_bound, self.forces[:k],
            touching, sticking, bound, self.floors,
            np.ravel(self.begins.T), np.ravel(self.forces[k:].reshape(-1, 3).T)])


class Guards(NamedTuple):
    """
    Guards of a step: positive while rows may keep their modes.

    Attributes
    ----------
    forces : (..., k + 2 c) array
        Of held joints, of the normal forces, of the friction of sticking contacts, at the
        beginning.
    ends : (..., 2 k + 2 c) array
        Distances from stops and rates of joints, distances and slips of contacts, at the
        end.

    """

    forces: Array
    ends: Array


class RowMotion(RobotMotion):
    """
    A robot during one traced step in given modes of its rows.

    The modes are an input, so that one program serves every combination.

    Parameters
    ----------
    rows : RowSet
    numbers : array
        `ModeChoice.numbers`.
    *arguments
        Of `RobotMotion`.

    """

    def __init__(self, rows: RowSet, numbers: Vector, *arguments: Any) -> None:
        """Begin without stages."""
        super().__init__(*arguments)
        self._rows, self._modes = rows, numbers
        self._velocities: Vector = np.zeros(0)  # of contacts, in the traced stage
        self.first: Any = None  # of the first stage: forces, bounds, velocities of contacts

    def held(self, modes: Vector, q: Vector) -> Solver:
        """Return the solver of a stage at q."""
        def solution(system: LinearSystem, M: Matrix, force: Vector) -> Solution:
            numbers = ModeInputs.of(self._rows, modes)
            of_all, contacts = traced_rows(self._rows, q, system.v, numbers)
            if contacts is not None:
                self._velocities = contacts.velocities
            return row_solution(system, M, force, of_all)
        return solution

    def directions(self, modes: Vector) -> Vector | None:
        """Return the directions of sliding of all joints, (n_j,); None: smooth friction."""
        if not self._rows.sticking:
            return None
        directions = ModeInputs.of(self._rows, modes).directions
        return of_all_joints(self.equations, self._rows.joints, directions)

    def results(self, q: Vector, u: Vector, tau: Vector, modes: Vector, t: Scalar,
                solution: Solution) -> list[Scalar]:
        """Return forces of rows, bounds of friction, and velocities of contacts."""
        rows = self._rows
        bounds = bounds_of_joints(rows, q, tau, t)
        directions = ModeInputs.of(rows, modes).directions
        driving = driving_torques(rows, q, u, tau, directions, t)
        return [*solution.f, *np.concatenate(bounds), *driving, *self._velocities]

    def called(self, program: Program, q: Vector, u: Vector, tau: Vector, time: Any,
               *inputs: Any) -> Any:
        """Return the rates of a stage; what the guards need of the first one is stored."""
        results = super().called(program, q, u, tau, time, self._modes, *inputs)
        k, c = len(self._rows.joints), len(self._rows.pairs)
        end = len(results) - (4 * k + 6 * c)
        if self.first is None:
            parts = np.cumsum([k + 3 * c, k, k, k])
            self.first = np.split(np.array(results[end:]), parts)
        return results[:end]

    @lazy_property
    def _motion(self) -> Program:
        return self._program(None)

    @lazy_property
    def _stage(self) -> Program:
        return self._program(ImplicitStep(self.equations))

    def _program(self, method: ImplicitStep | None) -> Program:
        """Trace the dynamics of a stage, explicit without `method`: rates, then `results`."""
        robot = self.robot
        equations: Any = robot.equations

        # An implicit stage also has the results of the first stage, and its factor g.
        first_stage: list[tuple[str, Shape]] = []
        if method is not None:
            first_stage = first_stage_inputs(robot)

        def dynamics(q: Vector, u: Vector, tau: Vector, modes: Vector,
                     *inputs: Any) -> list[Scalar]:
            options = inputs[len(first_stage):]
            wrench, t, parameters, deflections = optional_inputs(robot, options)
            physical = parameters[:robot.parameters.physical]
            if self._dual_to is not None:
                tau = tau_from(equations, self._dual_to, q, tau, t)

            # Which rows are held, and the directions of joints that slide.
            held = self.held(modes, q)
            directions = self.directions(modes)
            # Explicit methods: udot and the forces that hold joints, from M udot = net.
            if method is None:
                system = linear_system(equations, q, u, tau, wrench, physical, t,
                                       directions, deflections)
                solution = held_solution(system, system.M, system.net, held)
                rates: Any = []  # q' = u
                if not equations.in_joint_rates:
                    rates = coordinate_rates(robot.model, q, system.v)
                bent: Any = []  # rates of the deflections of bristles
                if deflections is not None:
                    bent = equations.deflection_rates(q, system.v, deflections, tau, t)
            else:
                # The linearly implicit method solves its own system, held in the same
                # way.
                *first, g = inputs[:len(first_stage)]
                of_stage, solution = method.held_stage(
                    held, q, u, tau, StageRates(*first), g[()], wrench, physical, t,
                    directions=directions, deflections=deflections)
                rates, _, bent = of_stage

            results = [*rates, *solution.w, *bent,
                       *self.results(q, u, tau, modes, t, solution)]
            if self.watched:
                results.append(equations.margin(q, t, parameters[-LIMITS:]))
            return results

        # Subroutines of one kernel differ in their names.
        name = 'row_dynamics'
        if method is not None:
            name = f'implicit_{name}'
        if self.watched:
            name = f'watched_{name}'
        return trace_program(name, dynamics, [
            ('q', (robot.n_q,)), ('u', (robot.n,)), ('tau', (robot.n,)),
            ('modes', np.shape(self._modes)), *first_stage, *wrench_input(robot),
            *time_input(robot), *deflection_input(robot),
            ('parameters', robot.parameters.block.shape)])


def traced_rows(rows: RowSet, q: Vector, v: Vector,
                modes: ModeInputs) -> tuple[StageRows, Any]:
    """Return the rows in their modes at a configuration and joint rates, and the contacts."""
    held = [x > 0.5 for x in modes.held]
    past = []
    for place, side, lower, upper in zip(rows.places.tolist(), modes.sides, modes.lower,
                                         modes.upper):
        at_stop = select(side > 0.5, q[place] - upper, q[place] - lower)
        past.append(select(side * side > 0.5, at_stop, 0.0))
    contacts = None
    if rows.pairs:
        contacts = contact_rows(rows.robot.equations, rows.pairs, q, v)
    of_contacts = ContactModes([x > 0.5 for x in modes.touching],
                               [x > 0.5 for x in modes.sticking], modes.begins,
                               rows.friction, modes.floors)
    joints = HeldJointRows(rows.joints, held, np.array(past))
    forces = np.concatenate([modes.joint_forces, np.ravel(modes.contact_forces)])
    return StageRows(joints, contacts, of_contacts, rows.feedback, forces), contacts


def bounds_of_joints(rows: RowSet, q: Vector, tau: Vector, t: Scalar
                     ) -> tuple[Vector, Vector]:
    """Return the bounds of friction of joints at rest, (k,) each; 0 where it is smooth."""
    if not rows.sticking:
        zeros = np.zeros(len(rows.joints))
        return zeros, zeros
    return friction_bounds(rows.robot.equations, rows.joints, q, tau, t)


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


def of_all_joints(equations: Equations, joints: list[int], directions: Vector) -> Vector:
    """Return directions of k joints as those of all joints, (n_j,), 0 of the others."""
    result = np.zeros(equations.model.n).astype(object)
    for joint, direction in zip(joints, directions):
        result[joint] = direction
    return result


def driving_torques(rows: RowSet, q: Vector, u: Vector, tau: Vector, directions: Vector,
                    t: Scalar) -> Vector:
    """Return `friction.driving_torque` of self-locking joints that slide; else 1, (k,)."""
    equations = rows.robot.equations
    result: list[Scalar] = [1.0] * len(rows.joints)
    if rows.locks.any():
        torques = equations.drive_torques(q, tau, t)
        rates = equations.joint_speeds(q, u, t)
        for row in np.flatnonzero(rows.locks).tolist():
            r = rows.joints[row]
            driving = driving_torque(equations.model.coordinate_joints[r], rates[r],
                                     torques[r], directions[row])
            slides = directions[row] * directions[row] > 0.5
            result[row] = select(slides, driving, 1.0)
    return np.array(result)


def row_kernel(rows: RowSet, choice: StepChoice) -> Kernel:
    """
    Return the kernel of a step: the state, `Guards`, and the power of contacts.

    Its inputs are those of `step_kernel` and `ModeChoice.numbers`.
    """
    robot = rows.robot
    choice = choice.needed(robot)
    free, inputs, constants = step_signature(robot, choice)
    k, c = len(rows.joints), len(rows.pairs)
    size = inputs['state'][0]
    numbers = PER_JOINT * k + PER_CONTACT * c
    return robot.kernels.compiled(partial(_traced_step, rows, choice),
                                  f'rows_{free}_{rows.name}',
                                  {**inputs, 'modes': (numbers,)},
                                  (size + 3 * k + 4 * c + 1,), constants=constants)


def _traced_step(rows: RowSet, choice: StepChoice, state: Vector, inputs: Matrix,
                 numbers: Vector, constants: Vector) -> list[Scalar]:
    """Return the state after a step, its guards, and the power of contacts at its begin."""
    motions: list[RowMotion] = []

    def motion(*arguments: Any) -> RowMotion:
        motions.append(RowMotion(rows, numbers, *arguments))
        return motions[0]
    after = traced_step(rows.robot, choice, state, inputs, constants, motion)
    modes = ModeInputs.of(rows, numbers)
    if rows.joints and not rows.tree:
        after = _without_creep(rows, modes, after)
    f, least, largest, driving, velocities = motions[0].first
    forces = _force_guards(rows, modes, f, least, largest, driving)

    # Slip keeps its direction within a right angle.
    layout = state_layout(rows.robot)
    q, v = after[layout.q], after[layout.v]
    _, contacts = traced_rows(rows, q, v, modes)
    ends = _joint_ends(rows, modes, q, v)
    power: Scalar = 0.0
    of_distance, of_slip = [], []
    k = len(rows.joints)
    for i in range(len(rows.pairs)):
        first = slice(3 * i + 1, 3 * i + 3)
        begins = modes.begins[i]
        slides = select(modes.touching[i] > 0.5, 1.0 - modes.sticking[i], 0.0)
        slides = slides * select(begins @ begins > 0.5, 1.0, 0.0)
        of_distance.append(select(modes.touching[i] > 0.5, 1.0,
                                  contacts.distances[i] - modes.floors[i]))
        keeps = contacts.velocities[first] @ begins + SLIP
        of_slip.append(select(slides > 0.5, select(modes.bound[i] > 0.5, 1.0, keeps), 1.0))
        slip = velocities[first]
        speed = np.sqrt(slip @ slip)
        power = power - slides * rows.friction[i] * f[k + 3 * i] * speed
    return [*after, *forces, *ends, *of_distance, *of_slip, power]


def _without_creep(rows: RowSet, modes: ModeInputs, after: Vector) -> Vector:
    """
    Return a state in which held joints of a loop rest, at their stops if these hold them.

    What is taken out is of the order of the error of the step.
    """
    robot = rows.robot
    equations: Any = robot.equations
    layout = state_layout(robot)
    times = time_input(robot)

    def motion(q: Vector, *time: Any) -> Matrix:
        T: Matrix = equations.at_rest(q, time[0][()] if times else 0.0).T
        return T
    program = trace_program('motion_of_joints', motion, [('q', (robot.n_q,)), *times])
    q, v, time = after[layout.q], after[layout.v], after[layout.time]
    T = np.array(call(program, q, *time)).reshape(robot.model.n, robot.n)
    T_s = T[rows.joints]
    of_rows, _ = traced_rows(rows._replace(pairs=()), q, v, modes)
    held = of_rows.joints.held
    change = T @ (T_s.T @ forces_of_held(T_s @ T_s.T, held, of_rows.joints.past))
    q = q - coordinate_rates(robot.model, q, change)
    v = v - T @ (T_s.T @ forces_of_held(T_s @ T_s.T, held, v[rows.joints]))
    return np.array([*q, *v, *after[layout.v.stop:]])


def _force_guards(rows: RowSet, modes: ModeInputs, f: Vector, least: Vector,
                  largest: Vector, driving: Vector) -> list[Scalar]:
    """
    Return the guards of the forces of held rows, (k + 2 c,); 1 of others.

    A self-locking joint that slides has the torque that drives it.
    """
    guards: list[Scalar] = []
    k = len(rows.joints)
    size: Scalar = 1e-300
    for x in f:
        size = size + magnitude(x)
    rounding = ROUNDING * size
    # A stop presses only inward, and takes the place of one bound.
    for held, side, x, low, high, drive in zip(modes.held, modes.sides, f, least, largest,
                                               driving):
        above = select(side > 0.5, 1.0, x - low + rounding)
        below = select(side < -0.5, 1.0, high - x + rounding)
        guards.append(select(held > 0.5, smallest([above, below]), drive))
    normals, tangents = [], []
    for i in range(len(rows.pairs)):
        normal, first, second = f[k + 3 * i:k + 3 * i + 3]
        normals.append(select(modes.touching[i] > 0.5, normal + rounding, 1.0))
        tangent = np.sqrt(first * first + second * second)
        inside = rows.friction[i] * normal - tangent + rounding
        tangents.append(select(modes.sticking[i] > 0.5, inside, 1.0))
    return [*guards, *normals, *tangents]


def _joint_ends(rows: RowSet, modes: ModeInputs, q: Vector, v: Vector) -> list[Scalar]:
    """Return distances from stops and rates of joints that are not held, (2 k,)."""
    distances, rates = [], []
    for row, joint in enumerate(rows.joints):
        free = modes.held[row] < 0.5
        place = int(rows.places[row])
        near = smallest([q[place] - modes.lower[row], modes.upper[row] - q[place]])
        # Others that hold a joint of a loop at its stop do so to rounding.
        distance = near if rows.tree else near + AT_STOP
        distances.append(select(free, distance, 1.0))
        direction_of = modes.directions[row]
        rate = direction_of * v[joint] + rows.slow[row]
        slides = direction_of * direction_of > 0.5
        # A joint at the bound of its friction, held by others, does not move.
        still = max(2.0 * rows.slow[row], STILL) - magnitude(v[joint])
        rate = select(modes.at_bound[row] > 0.5, still, rate)
        rates.append(select(slides, select(free, rate, 1.0), 1.0))
    return [*distances, *rates]


class Response(NamedTuple):
    """
    Velocities, accelerations and responses of all rows at one state.

    Attributes
    ----------
    vdot : (n_j,) array
        Of the joints, without the forces of rows at rest, with the friction of joints
        that slide.
    v, a : (k + 3 c,) arrays
        Velocities of the rows, and their accelerations with vdot.
    B : (n_j, k + 3 c) array
        Change of vdot per unit of each force.
    A : (k + 3 c, k + 3 c) array
        Change of a.
    least, largest : (k,) arrays
        Bounds of friction of joints at rest.
    distances : (c,) array
    friction : (n_j,) array
        Torques that overcome the friction of joints that slide.
    J : (3 c, n_j) array
        Of the contacts.
    bases : (c, 3, 3) array
    points : (c, 3) array
        m, in the world.

    """

    vdot: Array
    v: Array
    a: Array
    B: Array
    A: Array
    least: Array
    largest: Array
    distances: Array
    friction: Array
    J: Array
    bases: Array
    points: Array

    @classmethod
    def shapes(cls, rows: RowSet) -> list[tuple[int, ...]]:
        """Return the shapes of the fields."""
        n_j = rows.robot.model.n
        k, c = len(rows.joints), len(rows.pairs)
        m = k + 3 * c
        return [(n_j,), (m,), (m,), (n_j, m), (m, m), (k,), (k,), (c,), (n_j,), (3 * c, n_j),
                (c, 3, 3), (c, 3)]


def response_kernel(rows: RowSet) -> Kernel:
    """Return the kernel of `Response`, by q, v, tau and directions of friction."""
    robot = rows.robot
    equations: Any = robot.equations
    k = len(rows.joints)

    def response(q: Vector, v: Vector, tau: Vector, directions: Vector, *deflected: Any,
                 t: Scalar, parameters: Vector) -> Vector:
        u = independent_speeds(equations, q, v, t)
        deflections = deflected[0] if deflected else None
        if rows.dual_to is not None:
            tau = tau_from(equations, rows.dual_to, q, tau, t)
        sliding = None
        if rows.sticking:
            sliding = of_all_joints(equations, rows.joints, directions)
        system = linear_system(equations, q, u, tau, None, parameters, t, sliding,
                               deflections)
        T = np.eye(equations.n) if system.T is None else system.T
        unit = np.eye(robot.model.n)[rows.joints].reshape(k, robot.model.n)
        J, drift, velocities = unit, np.zeros(k), system.v[rows.joints]
        distances, bases, of_contacts = np.zeros(0), np.zeros((0, 3, 3)), np.zeros(0)
        points = np.zeros((0, 3))
        if rows.pairs:
            contacts = contact_rows(equations, rows.pairs, q, system.v)
            J = np.concatenate([unit, contacts.J])
            drift = np.concatenate([drift, contacts.drift])
            velocities = np.concatenate([velocities, contacts.velocities])
            distances, bases, of_contacts = contacts.distances, contacts.bases, contacts.J
            points = contacts.points
        factors = factorize(system.M, system.order)
        vdot = T @ solve(factors, system.order, system.net) + system.drift
        B = T @ np.stack([solve(factors, system.order, row) for row in J @ T], axis=1)
        a = J @ vdot + drift
        least, largest = bounds_of_joints(rows, q, tau, t)
        friction = equations.driven_friction(q, system.v, tau, t, sliding, deflections)
        parts = (vdot, velocities, a, B, J @ B, least, largest, distances, friction,
                 of_contacts, bases, points)
        return np.concatenate([np.ravel(part) for part in parts])
    size = sum(int(np.prod(shape)) for shape in Response.shapes(rows))
    tau_size = robot.n if rows.dual_to is None else len(rows.dual_to)
    return robot.compiled(response, name=f'row_response_{rows.name}', q=(robot.n_q,),
                          v=(robot.model.n,), tau=(tau_size,), directions=(k,),
                          **dict(deflection_input(robot)),
                          shape=(size,))


def responses(rows: RowSet, kernel: Kernel, states: Array, tau: Array, directions: Array,
              times: Any) -> list[Response]:
    """Return the responses at K states, (K, size), under torques (K, n)."""
    layout = state_layout(rows.robot)
    bent = states[:, layout.deflections]
    inputs = [states[:, layout.q], states[:, layout.v], tau, directions,
              *([bent] if bent.shape[1] else []), *rows.robot.equations.time_inputs(times)]
    values = np.empty((len(states), *kernel.shape))
    arrays = [np.ascontiguousarray(x, dtype=np.float64) for x in inputs]
    if len(values) == 1:  # lanes and threads cost more than one state
        kernel.scan(arrays, values)
    else:
        kernel.run(arrays, values, len(values))
    begin, fields = 0, []
    for shape in Response.shapes(rows):
        end = begin + math.prod(shape)
        fields.append(values[:, begin:end].reshape(len(values), *shape))
        begin = end
    return [Response(*row) for row in zip(*fields)]
