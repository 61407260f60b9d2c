"""
Native steps during which given joints press against their stops.

The joints in contact are arguments. They are held: the forces of their stops act in every stage of
the integrator (`held_steps`), so their work is zero, and the order of the step is that of the
integrator. At the end of the step their remaining motion, which is of the order of the error of
the step, is taken back; that of trees is zero. A step is valid if no stop pulls, and no other
joint passes its stop. `JointStops` computes the other steps.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple, TYPE_CHECKING

from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.mechanics.ball_joints import coordinate_rates, on_unit_quaternions
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.mechanics.constraints.row_units import coordinate_units
from kane_dynamics.mechanics.integrators.held_joints import held_response
from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.runtime.loop_support import repeat
from kane_dynamics.native.tracing.program import Shape, trace_program
from kane_dynamics.native.tracing.subroutine import call
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.step_kernels import margin_count, step_kernel, StepChoice
from kane_dynamics.simulation.stops.held_steps import held_step, pulls
import numpy as np

if TYPE_CHECKING:
    from kane_dynamics.simulation.torque_input import TorqueInput

ROUNDING = 1e-11  # rad or lengths: past a stop, with constraints, after loops are closed


class PressedSteps(NamedTuple):
    """
    Results of K steps with held joints, for k joints with stops.

    The states after the steps and before the last correction, (K, size). By coordinate, (K, n_q):
    accelerations of the joints at the beginning of the step, the pull of each stop then, and its
    largest pull, 0 of a stop that presses; a stop cannot pull. The generalized forces of the stops
    at both ends of the step, (2, K, n). Which steps are valid, (K,).
    """

    after: Array
    before: Array
    acceleration: Array
    first: Array
    pull: Array
    force: Array
    valid: Any


def pressed_steps(source: 'TorqueInput', state: Array, done: int, count: int, side: Array,
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
    size, k = len(state), len(stopped)
    kernel = _kernel(source.robot, source.kernel, source.choice, stopped)
    rows = np.empty((count + 1, *kernel.shape))
    rows[0, :size] = state
    contact = np.array([side[stopped], lower[stopped], upper[stopped]])
    inputs, _, stride = source.inputs(done, count)
    repeat(kernel.address,
           [x.ctypes.data for x in (rows, inputs, contact, source.constants, rows[1:])],
           [rows.strides[0], stride, 0, 0, rows.strides[0]], count)
    acceleration, first, pull = joints = np.zeros((3, count, len(side)))
    after, before, of_joints, force, valid = np.split(
        rows[1:], np.cumsum([size, size, 3 * k, 2 * source.robot.n]), axis=1)
    joints[:, :, stopped] = of_joints.reshape(count, 3, k).swapaxes(0, 1)
    return PressedSteps(after, before, acceleration, first, pull,
                        force.reshape(count, 2, -1).swapaxes(0, 1), valid[:, 0] > 0.5)


def compile_pressed_steps(robot: Robot, integrator: str, followed: Sequence[int] = ()) -> None:
    """Compile the kernels of `pressed_steps` with and without feedback, as `step_kernel`."""
    for choice in (StepChoice(x, integrator, None, followed) for x in (False, True)):
        compile_pressed_step(robot, choice)


def compile_pressed_step(robot: Robot, choice: StepChoice) -> None:
    """Compile the kernel of `pressed_steps` for one choice."""
    stopped = _stopped(robot.limits.lower, robot.limits.upper)
    if stopped:
        _kernel(robot, step_kernel(robot, *choice), choice, stopped)


def _stopped(lower: Array, upper: Array) -> list[int]:
    """Return the indices of the coordinates with a stop."""
    found: list[int] = np.flatnonzero(np.isfinite(lower) | np.isfinite(upper)).tolist()
    return found


def _kernel(robot: Robot, free: Kernel, choice: StepChoice, stopped: list[int]) -> Kernel:
    """Return the kernel of a pressed step, by that of a free step and the joints with stops."""
    (size,), k = free.shape, len(stopped)
    name = f'pressed_{free.name}_{"_".join(map(str, stopped))}'
    inputs = [(a.name, a.shape) for a in free.arguments] + [('contact', (3, k))]
    constants = ('constants', free.parameters.shape)
    whole = 2 * size + 3 * k + 2 * robot.n + 1
    return robot.kernels.extra(
        name, lambda: trace_program(name, partial(_step, robot, choice, stopped),
                                    [*inputs, constants]),
        [Argument(*x) for x in inputs], np.zeros(constants[1]), (whole,))


def _step(robot: Robot, choice: StepChoice, stopped: list[int], state: Any, inputs: Any,
          contact: Any, constants: Any) -> Any:
    """Return the entries of a row of `PressedSteps`."""
    side, lower, upper = contact
    step = held_step(robot, choice, state, inputs, constants, side, stopped)
    free = step.state
    q, u, rest = np.split(free, [robot.n_q, robot.n_q + robot.n])
    touching = [s * s > 0.5 for s in side]
    slack = np.zeros(len(stopped))
    valid: Any = 1.0
    if isinstance(robot.equations, ConstrainedEquations):
        q, u, left = _corrected(robot, stopped, touching, [
            select(s > 0.0, b, a) for s, a, b in zip(side, lower, upper)], q, u,
            list(rest[:int(robot.equations.timed)]), constants[-len(robot.parameters.block):])
        units = coordinate_units(robot.model, robot.mechanism.constraints)
        slack = ROUNDING * units[stopped]
        valid = _all(*(x < most for x, most in zip(left, slack)),
                     *(-most < x for x, most in zip(left, slack)))
    forces = [stage[0] for stage in step.stages]
    first, pull = pulls(forces[:1], side), pulls(forces, side)
    for c, x, a, b, j, most in zip(touching, pull, lower, upper, stopped, slack):
        within = (1.0 - _all(b + most < q[j])) * (1.0 - _all(q[j] < a - most))
        valid = valid * select(c, 1.0 - _all(x > 0.0), within)
    if margin_count(robot):
        valid = valid * _all(rest[-1] > 0.0)
    return [*q, *u, *rest, *free, *step.stages[0][1], *first, *pull,
            *step.stages[0][2], *step.stages[-1][2], valid]


def _corrected(robot: Robot, stopped: list[int], touching: list[Any], stops: list[Any], q: Any,
               u: Any, time: list[Any], parameters: Any) -> tuple[Any, Any, Any]:
    """Return q and u without the remaining motion of the held joints, and what is left of q."""
    system, closed = _system_of(robot, q, time, parameters)

    def away(q: Any) -> Any:
        return np.array([select(c, x, 0.0) for c, x in zip(touching, q[stopped] - stops)])
    T, _, inverse = system(q)
    along = inverse @ T[stopped].T
    for _ in range(2):  # the second has the error of the first, and of closing the loops
        q = closed(q - T @ (along @ held_response(T[stopped] @ along, touching, away(q))))
    T, X, inverse = system(q)
    along = inverse @ T[stopped].T
    u = u - along @ held_response(T[stopped] @ along, touching, (T @ u + X)[stopped])
    return q, u, away(q)


def _system_of(robot: Robot, q: Any, time: list[Any], parameters: Any) -> tuple[Any, Any]:
    """
    Return two functions of the configuration q.

    The first returns T and X of q' = T u + X, and M^-1. The second closes the loops of q.
    """
    equations: Any = robot.equations
    n_q, n = robot.n_q, robot.n
    inputs: list[tuple[str, Shape]] = [('q', (n_q,)), *(('t', ()) for _ in time),
                                       ('parameters', np.shape(parameters))]

    def parts(q: Any, *rest: Any) -> Any:
        t = rest[0][()] if time else 0.0
        motion = equations.at_rest(q, t)
        T = np.stack([coordinate_rates(robot.model, q, column) for column in motion.T.T], axis=1)
        inverse = equations.inverse_mass_matrix(q, rest[-1][:robot.parameters.physical], t)
        return np.concatenate([np.ravel(T), coordinate_rates(robot.model, q, motion.qdot),
                               np.ravel(inverse)])
    whole = trace_program('stopped_system', parts, inputs)

    def system(q: Any) -> tuple[Any, Any, Any]:
        T, X, inverse = np.split(np.array(call(whole, q, *time, parameters)),
                                 [n_q * n, n_q * n + n_q])
        return T.reshape(n_q, n), X, inverse.reshape(n, n)
    if not equations.keeps_positions(q, *time):
        return system, partial(on_unit_quaternions, robot.model)
    newton = trace_program('closure_step', lambda q, *rest: equations.closure_step(
        q, rest[0][()] if time else 0.0), inputs)
    return system, lambda q: on_unit_quaternions(
        robot.model, np.array(call(newton, q, *time, parameters)))


def _all(*conditions: Any) -> Any:
    """Return 1.0 if every condition holds, else 0.0; not-a-number holds for none."""
    result: Any = 1.0
    for condition in conditions:
        result = result * select(condition, 1.0, 0.0)
    return result
