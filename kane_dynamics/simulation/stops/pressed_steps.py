"""
Native steps during which given joints press against their stops.

The joints in contact are arguments. They are held: the forces of their stops act in
every stage of the integrator, so their work is zero, and the order of the step is that
of the integrator. At the end of the step their remaining motion, which is of the order
of the error of the step, is taken back; that of trees is zero. A step is valid if no
stop pulls, and no other joint passes its stop. `JointStops` computes the other steps.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.mechanics.ball_joints import coordinate_rates, on_unit_quaternions
from kane_dynamics.mechanics.constraints.row_units import coordinate_units
from kane_dynamics.mechanics.integrators.held_joints import Held, held_response
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import Program, Shape, trace_program
from kane_dynamics.native.tracing.subroutine import call
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.held_motion import HeldMotion, HeldStage
from kane_dynamics.simulation.step_kernels import (state_layout, step_kernel, StepChoice,
                                                   time_input, traced_step)
from kane_dynamics.simulation.stops.contact_forces import ROUNDING
from kane_dynamics.simulation.torque_input import TorqueInput
import numpy as np

PULL = 1e-12  # of a stop, relative to the forces of all stops: rounding


class PressedSteps(NamedTuple):
    """
    Results of K steps with held joints.

    Attributes
    ----------
    after, before : (K, size) arrays
        The states after the steps, and these before their last correction.
    acceleration : (K, n_q) array
        Of the joints at the beginning of the step.
    first, pull : (K, n_q) arrays
        The pull of each stop at the beginning of the step, and its largest pull in the
        step; 0 of a stop that presses. A stop cannot pull.
    force : (2, K, n) array
        The generalized forces of the stops at both ends of the step.
    valid : (K,) array of bool

    """

    after: Array
    before: Array
    acceleration: Array
    first: Array
    pull: Array
    force: Array
    valid: Any


def pressed_steps(source: TorqueInput, state: Array, done: int, count: int, side: Array,
                  lower: Array, upper: Array) -> PressedSteps:
    """
    Return the results of pressed steps.

    Parameters
    ----------
    source : TorqueInput
        Of one simulation.
    state : (size,) array
        After `done` steps.
    done, count : int
        Number of earlier steps, and of steps to compute.
    side : (n_q,) array
        1 for a joint that presses against its upper stop, -1 for its lower stop, else 0.
    lower, upper : (n_q,) arrays
        The stops, rad or m; infinite where there is none.

    """
    stopped = _stopped(lower, upper)
    size = len(state)
    k = len(stopped)
    kernel = _kernel(source.robot, source.kernel, source.choice, stopped)
    # Each row begins with a state, which is an argument of the next one.
    rows = np.empty((count + 1, *kernel.shape))
    rows[0, :size] = state
    contact = np.array([side[stopped], lower[stopped], upper[stopped]])
    inputs = source.inputs(done, count)
    row = inputs[0, 0] if inputs.shape[1] == 1 else inputs[0]
    kernel.scan([rows[:-1, :size], row, contact], rows[1:], constants=source.constants)
    ends = np.cumsum([size, size, 3 * k, 2 * source.robot.n])
    after, before, of_stops, force, valid = np.split(rows[1:], ends, axis=1)

    # Entries of the stops, at the places of their coordinates.
    by_coordinate = np.zeros((3, count, len(side)))
    by_coordinate[:, :, stopped] = of_stops.reshape(count, 3, k).swapaxes(0, 1)
    acceleration, first, pull = by_coordinate
    return PressedSteps(after, before, acceleration, first, pull,
                        force.reshape(count, 2, -1).swapaxes(0, 1), valid[:, 0] > 0.5)


def compile_pressed_steps(robot: Robot, integrator: str,
                          followed: Sequence[int] = ()) -> None:
    """Compile the kernels of `pressed_steps` with and without feedback, as `step_kernel`."""
    for feedback in (False, True):
        compile_pressed_step(robot, StepChoice(feedback, integrator, None, tuple(followed)))


def compile_pressed_step(robot: Robot, choice: StepChoice) -> None:
    """Compile the kernel of `pressed_steps` for one choice."""
    stopped = _stopped(robot.limits.lower, robot.limits.upper)
    if stopped:
        _kernel(robot, step_kernel(robot, *choice), choice, stopped)


def _stopped(lower: Array, upper: Array) -> list[int]:
    """Return the indices of the coordinates with a stop."""
    stopped: list[int] = np.flatnonzero(np.isfinite(lower) | np.isfinite(upper)).tolist()
    return stopped


def _kernel(robot: Robot, free: Kernel, choice: StepChoice,
            stopped: list[int]) -> Kernel:
    """Return the kernel of a pressed step, by that of a free step and the joints with stops."""
    choice = choice.needed(robot)
    (size,) = free.shape
    # The inputs of the free step, and for each joint its side and both stops.
    k = len(stopped)
    name = f'pressed_{free.name}_{"_".join(map(str, stopped))}'
    inputs = {argument.name: argument.shape for argument in free.arguments}
    results = 2 * size + 3 * k + 2 * robot.n + 1
    return robot.kernels.compiled(partial(_traced_row, robot, choice, stopped), name,
                                  {**inputs, 'contact': (3, k)}, (results,),
                                  constants=free.parameters.shape)


def _traced_row(robot: Robot, choice: StepChoice, stopped: list[int], state: Vector,
                inputs: Matrix, contact: Matrix, constants: Vector) -> list[Scalar]:
    """Return the entries of a row of `PressedSteps`."""
    side, lower, upper = contact
    motions: list[_PressedMotion] = []

    def pressed_motion(*arguments: Any) -> _PressedMotion:
        motions.append(_PressedMotion(stopped, side, *arguments))
        return motions[0]
    free = traced_step(robot, choice, state, inputs, constants, pressed_motion)
    stages = motions[0].stages
    q, u, time_and_margin = np.split(free, [robot.n_q, robot.n_q + robot.n])

    # Trees hold their joints at rest exactly. Elsewhere the held joints go back to their
    # stops, on closed loops.
    touching = [s * s > 0.5 for s in side]
    slack = np.zeros(len(stopped))
    valid: Scalar = 1.0
    if not robot.equations.in_joint_rates:
        stops = [select(s > 0.0, high, low) for s, low, high in zip(side, lower, upper)]
        time = list(free[state_layout(robot).time])
        parameters = constants[-len(robot.parameters.block):]
        q, u, away = corrected(robot, stopped, touching, stops, q, u, time, parameters)
        units = coordinate_units(robot.model, robot.mechanism.constraints)
        slack = ROUNDING * units[stopped]
        for distance, limit in zip(away, slack):
            valid = valid * _all(distance < limit, -limit < distance)

    # No stop may pull, and no free joint may pass its stop.
    forces = [stage.forces for stage in stages]
    first = _pulls(forces[:1], side)
    pull = _pulls(forces, side)
    for i, place in enumerate(stopped):
        not_above = 1.0 - _all(upper[i] + slack[i] < q[place])
        not_below = 1.0 - _all(q[place] < lower[i] - slack[i])
        presses = 1.0 - _all(pull[i] > 0.0)
        valid = valid * select(touching[i], presses, not_above * not_below)
    if robot.equations.watched:
        valid = valid * _all(time_and_margin[-1] > 0.0)
    return [*q, *u, *time_and_margin, *free, *stages[0].accelerations, *first, *pull,
            *stages[0].generalized, *stages[-1].generalized, valid]


class _StageForces(NamedTuple):
    """
    Forces that hold k joints in one stage, as of `held_joints.Solution`.

    They are forces on the joints, (k,), the accelerations of the joints, (k,), and the
    generalized forces, (n,).
    """

    forces: Vector
    accelerations: Vector
    generalized: Vector


class _PressedMotion(HeldMotion):
    """
    A robot with joints that press against stops during one traced step.

    Parameters
    ----------
    stopped : sequence of int
        The indices in q of the k joints with stops.
    sides : (k,) array
        1 or -1 for a joint that presses against its stop, else 0.
    *arguments
        Of `RobotMotion`.

    """

    dynamics_name = 'held_dynamics'

    def __init__(self, stopped: Sequence[int], sides: Vector, robot: Robot,
                 *arguments: Any) -> None:
        """Begin without stages."""
        joints = list(map(robot.model.places.index, stopped))
        super().__init__(joints, sides, robot, *arguments)
        self.stages: list[_StageForces] = []

    def held(self, modes: Vector, q: Vector) -> Held:
        """Return the joints that press against a stop."""
        return Held(self._joints, [side * side > 0.5 for side in modes])

    def results(self, stage: HeldStage) -> list[Scalar]:
        """Return the forces of a stage: of stops, accelerations, generalized."""
        solution = stage.solution
        return [*solution.f, *solution.accelerations, *solution.generalized]

    def called(self, program: Program, q: Vector, u: Vector, tau: Vector, time: Any,
               *inputs: Any) -> Any:
        """Return the rates of a stage, and store what holds joints."""
        results = super().called(program, q, u, tau, time, *inputs)
        k = len(self._joints)
        ends = np.cumsum([len(results) - 2 * k - self.robot.n, k, k])
        rates, *stage = np.split(np.array(results), ends)
        self.stages.append(_StageForces(*stage))
        return rates


def _pulls(stages: Sequence[Vector], side: Vector) -> list[Scalar]:
    """Return the largest pull of each stop in several stages, (k,); 0 if it presses."""
    # A stop that pulls holds a joint which would leave it.
    largest = [0.0 * s for s in side]
    for forces in stages:
        # What is small beside the forces of all stops is rounding.
        magnitudes = []
        for f, s in zip(forces, side):
            pull = f * s
            magnitudes.append(pull * select(pull < 0.0, -1.0, 1.0))
        rounding = PULL * sum(magnitudes, 0.0)
        pulls = [f * s - rounding for f, s in zip(forces, side)]
        largest = [select(x < y, y, x) for x, y in zip(largest, pulls)]
    return largest


def corrected(robot: Robot, stopped: list[int], touching: list[Scalar],
              stops: list[Scalar], q: Vector, u: Vector, time: list[Scalar],
              parameters: Vector) -> tuple[Vector, Vector, Vector]:
    """
    Return q and u without the motion of joints at stops, and the remaining error of q.

    Parameters
    ----------
    robot : Robot
        In chosen speeds or with constraints.
    stopped : list of int
        The coordinates of k joints with stops.
    touching : list of k conditions
        Whether the joint presses against a stop.
    stops : list of k scalars
        The position of that stop, rad or m.
    q, u, time, parameters
        The state, the time if the equations depend on it, and the robot's parameters.

    """
    system, closed = _system_of(robot, q, time, parameters)

    def away(q: Vector) -> Vector:
        distances = q[stopped] - stops
        return np.array([select(held, x, 0.0) for held, x in zip(touching, distances)])

    # Displacements T M^-1 T_s^T f that end at the stops, as impulses f there would cause.
    T, _, inverse = system(q)
    along = inverse @ T[stopped].T
    for _ in range(2):  # the second has the error of the first, and of closing the loops
        response = held_response(T[stopped] @ along, touching, away(q))
        q = closed(q - T @ (along @ response))

    # Impulses that end the remaining rates of the held joints.
    T, X, inverse = system(q)
    along = inverse @ T[stopped].T
    u = u - along @ held_response(T[stopped] @ along, touching, (T @ u + X)[stopped])
    return q, u, away(q)


def _system_of(robot: Robot, q: Vector, time: list[Scalar],
               parameters: Vector) -> tuple[Any, Any]:
    """
    Return two functions of the configuration q.

    The first returns T and X of q' = T u + X, and M^-1. The second closes the loops of
    q.
    """
    equations: Any = robot.equations
    n_q, n = robot.n_q, robot.n
    inputs: list[tuple[str, Shape]] = [('q', (n_q,)), *time_input(robot),
                                       ('parameters', np.shape(parameters))]

    def time_of(inputs: Sequence[Any]) -> Scalar:
        return inputs[0][()] if time else 0.0

    def parts(q: Vector, *inputs: Any) -> Vector:
        t = time_of(inputs)
        motion = equations.at_rest(q, t)
        # In rates of coordinates: T by its columns, X the rates at u = 0.
        columns = [coordinate_rates(robot.model, q, column) for column in motion.T.T]
        T = np.stack(columns, axis=1)
        X = coordinate_rates(robot.model, q, motion.qdot)
        physical = inputs[-1][:robot.parameters.physical]
        inverse = equations.inverse_mass_matrix(q, physical, t)
        return np.concatenate([np.ravel(T), X, np.ravel(inverse)])
    system_program = trace_program('stopped_system', parts, inputs)

    # The traced programs as functions over any scalar: kernels of steps inline them.
    def system(q: Vector) -> tuple[Matrix, Vector, Matrix]:
        results = np.array(call(system_program, q, *time, parameters))
        T, X, inverse = np.split(results, [n_q * n, n_q * n + n_q])
        return T.reshape(n_q, n), X, inverse.reshape(n, n)
    # Only loops need a correction of positions; otherwise quaternions keep their length.
    if not equations.keeps_positions(q, *time):
        return system, partial(on_unit_quaternions, robot.model)

    def closure_step(q: Vector, *inputs: Any) -> Vector:
        return equations.closure_step(q, time_of(inputs))
    newton_step = trace_program('closure_step', closure_step, inputs)

    def closed(q: Vector) -> Vector:
        corrected = np.array(call(newton_step, q, *time, parameters))
        result: Vector = on_unit_quaternions(robot.model, corrected)
        return result
    return system, closed


def _all(*conditions: Scalar) -> Scalar:
    """Return 1.0 if every condition holds, else 0.0; not-a-number holds for none."""
    result: Scalar = 1.0
    for condition in conditions:
        result = result * select(condition, 1.0, 0.0)
    return result
