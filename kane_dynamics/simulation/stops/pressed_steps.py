"""
Native steps during which given joints press against their stops.

A step of the integrator, then the impulses of the stops in contact: the joints are moved back,
loops are closed, and the motion into the stops ends. The joints in contact are arguments. A step
is valid if every one of them is pressed and no other joint comes to its stop: then the impulses
are the solution of the complementarity problem of `mechanics.joint_stops`. `JointStops` computes
the other steps.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any, TYPE_CHECKING

from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.mechanics.algebra.ltdl import factorize, solve
from kane_dynamics.mechanics.ball_joints import coordinate_rates, on_unit_quaternions
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.runtime.loop_support import repeat
from kane_dynamics.native.tracing.program import Program, Shape, trace_program
from kane_dynamics.native.tracing.subroutine import call
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.step_kernels import margin_count, step_kernel
import numpy as np

if TYPE_CHECKING:
    from kane_dynamics.simulation.torque_input import TorqueInput

ROUNDING = 1e-11  # rad or m: past a stop, with constraints, after loops are closed
NEAR = 1e-6  # rad or m: after one correction of loops; the second then leaves rounding errors
NOT_NEGATIVE = -1e-300


def pressed_steps(source: 'TorqueInput', state: Array, done: int, count: int, side: Array,
                  lower: Array, upper: Array) -> tuple[Array, Array, Any]:
    """
    Return the states after pressed steps, the same before the impulses, and which are valid.

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

    Returns
    -------
    (count, size), (count, size), (count,) arrays

    """
    stopped = _stopped(lower, upper)
    kernel, size = _kernel(source.robot, source.kernel, stopped), len(state)
    rows = np.empty((count + 1, 2 * size + 1))
    rows[0, :size] = state
    contact = np.array([side[stopped], lower[stopped], upper[stopped]])
    inputs, _, stride = source.inputs(done, count)
    repeat(kernel.address,
           [x.ctypes.data for x in (rows, inputs, contact, source.constants, rows[1:])],
           [rows.strides[0], stride, 0, 0, rows.strides[0]], count)
    return rows[1:, :size], rows[1:, size:-1], rows[1:, -1] > 0.5


def compile_pressed_steps(robot: Robot, integrator: str, followed: Sequence[int] = ()) -> None:
    """Compile the kernels of `pressed_steps`; arguments as those of `step_kernel`."""
    stopped = _stopped(robot.limits.lower, robot.limits.upper)
    for feedback in (False, True):
        _kernel(robot, step_kernel(robot, feedback, integrator, None, followed), stopped)


def _stopped(lower: Array, upper: Array) -> list[int]:
    """Return the indices of the coordinates with a stop."""
    found: list[int] = np.flatnonzero(np.isfinite(lower) | np.isfinite(upper)).tolist()
    return found


def _kernel(robot: Robot, free: Kernel, stopped: list[int]) -> Kernel:
    """Return the kernel of a pressed step, by that of a free step and the joints with stops."""
    (size,), k = free.shape, len(stopped)
    name = f'pressed_{free.name}_{"_".join(map(str, stopped))}'
    inputs = [(a.name, a.shape) for a in free.arguments] + [('contact', (3, k))]
    constants = ('constants', free.parameters.shape)

    def traced() -> Program:
        step = free.traced()
        return trace_program(name, lambda state, given, contact, constants: _step(
            robot, np.array(call(step, state, given, constants)), contact,
            constants[-len(robot.parameters.block):], stopped), [*inputs, constants])
    return robot.kernels.extra(name, traced, [Argument(*x) for x in inputs],
                               np.zeros(constants[1]), (2 * size + 1,))


def _step(robot: Robot, free: Any, contact: Any, parameters: Any, stopped: list[int]) -> Any:
    """Return the state after the impulses, that before them, and 1.0 if they are valid."""
    q, u, rest = np.split(free, [robot.n_q, robot.n_q + robot.n])
    constrained = isinstance(robot.equations, ConstrainedEquations)
    side, lower, upper = contact
    touching = [s * s > 0.5 for s in side]
    stop = [select(s > 0.0, b, a) for s, a, b in zip(side, lower, upper)]

    def masked(x: Any) -> Any:
        return np.array([select(c, each, 0.0) for c, each in zip(touching, x)])
    system, closed = _system_of(robot, q, list(rest[:int(robot.equations.timed)]), parameters)
    here = system(q)
    along, push = _impulses(here, stopped, touching, masked(q[stopped] - stop))
    q = q - here[0] @ along
    valid: Any = 1.0
    if constrained:
        q = closed(q)
        here, near = system(q), masked(q[stopped] - stop)
        q = closed(q - here[0] @ _impulses(here, stopped, touching, near)[0])
        here, left = system(q), masked(q[stopped] - stop)
        valid = _all(*(c for x, most in ((near, NEAR), (left, ROUNDING)) for each in x
                       for c in (each < most, -most < each)))
    T, X, _ = here
    along, held = _impulses(here, stopped, touching, masked((T @ u + X)[stopped]))
    u = u - along
    for k, j in enumerate(stopped):
        if not constrained:  # exactly, so that rounding does not move the joint
            q[j], u[j] = select(touching[k], stop[k], q[j]), select(touching[k], 0.0, u[j])
        pressed = _all(side[k] * push[k] > NOT_NEGATIVE, side[k] * held[k] > NOT_NEGATIVE)
        valid = valid * select(touching[k], pressed, _all(lower[k] < q[j], q[j] < upper[k]))
    if margin_count(robot):
        valid = valid * _all(rest[-1] > 0.0)
    return [*q, *u, *rest, *free, valid]


def _system_of(robot: Robot, q: Any, time: list[Any], parameters: Any) -> tuple[Any, Any]:
    """Return functions of q: T, X of q' = T u + X and M^-1; and q with closed loops."""
    equations: Any = robot.equations
    n_q, n = robot.n_q, robot.n
    if not isinstance(equations, ConstrainedEquations):
        inverse = robot.kernels.program('inverse_mass_matrix')
        return lambda q: (np.eye(n), np.zeros(n), np.array(
            call(inverse, q, parameters)).reshape(n, n)), None
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


def _impulses(system: tuple[Any, Any, Any], stopped: list[int], touching: list[Any],
              motion: Any) -> tuple[Any, Any]:
    """Return the change of the independent speeds that ends a motion, (n,), and impulses, (k,)."""
    T, _, inverse = system
    along = inverse @ T[stopped].T
    A, k = T[stopped] @ along, len(stopped)
    A = np.array([[select(touching[i], A[i, j], 1.0) if i == j else
                   select(touching[i], select(touching[j], A[i, j], 0.0), 0.0)
                   for j in range(k)] for i in range(k)])
    found = solve(factorize(A, range(k)), range(k), motion)
    return along @ found, found


def _all(*conditions: Any) -> Any:
    """Return 1.0 if every condition holds, else 0.0; not-a-number holds for none."""
    result: Any = 1.0
    for condition in conditions:
        result = result * select(condition, 1.0, 0.0)
    return result
