"""One integration step of a robot as a kernel, its dynamics as subroutines."""

from typing import Any

from kane_dynamics.mechanics.constrained import ConstrainedEquations
from kane_dynamics.mechanics.integration import runge_kutta_4
from kane_dynamics.native.expression import call
from kane_dynamics.native.kernels import Argument, Kernel
from kane_dynamics.native.program import Program, Shape, trace_program
from kane_dynamics.native.support import support
from kane_dynamics.quantities import CONSTRAINED, IN_LOOPS
from kane_dynamics.robot import Robot
import numpy as np

# What `simulate` asks for all rows of its result at once.
AFTERWARDS = ('forward_dynamics', 'inverse_dynamics', 'friction_force', 'kinetic_energy',
              'potential_energy', 'constraint_forces', 'constraint_gap')


def compile_simulation(robot: Robot) -> None:
    """
    Compile every kernel that `simulate` may need, so that no request waits for a compiler.

    Those that step many simulations at once are not among them.
    """
    support()  # the loop that steps
    robot.compile(*loop_kernels(robot))
    for feedback in (False, True)[:1 if robot.constraint_names else 2]:
        step_kernel(robot, feedback)
    for name in loop_kernels(robot):
        if name in AFTERWARDS:
            robot.kernels.quantity(name).compile_lanes()


def loop_kernels(robot: Robot) -> list[str]:
    """Return the names of the kernels that control and simulation of this robot call."""
    return [name for name in (*IN_LOOPS, *CONSTRAINED) if name in robot.kernels.names]


def step_kernel(robot: Robot, feedback: bool) -> Kernel:
    """
    Return the kernel of one Runge-Kutta step.

    Its pointers: state, as `state_names`, inputs, constants, next state. With held torques the
    inputs are tau (n) and the constants the step and the robot's parameters. With feedback the
    inputs are q, u and udot desired at the step's beginning, middle and end (3, 3 n), and the
    constants begin with kp and kd.
    """
    name = 'step_computed_torque' if feedback else 'step_held_torque'
    inputs = _inputs(robot, feedback)
    arguments = [Argument(key, shape) for key, shape in inputs[:2]]
    return robot.kernels.extra(name, lambda: _program(robot, name, feedback), arguments,
                               np.zeros(inputs[2][1]), inputs[0][1])


def state_names(robot: Robot) -> tuple[str, ...]:
    """Name the entries of a state: q, then u, then the time where the robot depends on it."""
    return (*robot.coordinate_names, *robot.speed_names,
            *(['time'] if robot.equations.timed else []))


def _inputs(robot: Robot, feedback: bool) -> list[tuple[str, Shape]]:
    n, parameters = robot.n, len(robot.parameters.block)
    return [('state', (len(state_names(robot)),)), ('inputs', (3, 3 * n) if feedback else (1, n)),
            ('constants', ((2 * n if feedback else 0) + 1 + parameters,))]


def _program(robot: Robot, name: str, feedback: bool) -> Program:
    """Trace one step; where q' is not u, what it misses of closed loops is taken back after it."""
    n_q, n, kernels, equations = robot.n_q, robot.n, robot.kernels, robot.equations
    constrained = isinstance(equations, ConstrainedEquations)
    motion = _state_program(robot)
    law = kernels.feedback_program() if feedback else None
    wrench = [kernels.no_wrench] if len(kernels.no_wrench) else []

    def step(state: Any, inputs: Any, constants: Any) -> Any:
        gains, h, parameters = np.split(constants, [2 * n, 2 * n + 1] if feedback else [0, 1])

        def rates(x: Any, given: Any) -> Any:
            q, u, time = np.split(x, [n_q, n_q + n])
            tau = given
            if law is not None:  # the law of control.Controller
                tau = np.array(call(law, q, u, *np.split(given, 3), gains, *wrench, parameters))
            found = call(motion, q, u, tau, *wrench, *time, parameters)
            return np.array([*(found if constrained else [*u, *found]), *(1.0 for _ in time)])
        moments = inputs if feedback else (inputs[0], inputs[0], inputs[0])
        after = runge_kutta_4(rates, state, moments, h[0])
        if isinstance(equations, ConstrainedEquations):
            after[:n_q] = equations.closer(after[:n_q], *after[n_q + n:])
        return after
    return trace_program(name, step, _inputs(robot, feedback))


def _state_program(robot: Robot) -> Program:
    """Trace udot or, where q' is not u, q' and udot."""
    equations, kernels = robot.equations, robot.kernels
    if not isinstance(equations, ConstrainedEquations):
        return kernels.program('forward_dynamics')
    wrench: list[tuple[str, Shape]] = (
        [('wrench', kernels.no_wrench.shape)] if len(kernels.no_wrench) else [])
    time: list[tuple[str, Shape]] = [('t', ())] if equations.timed else []

    def rates(q: Any, u: Any, tau: Any, *rest: Any) -> Any:
        *moment, parameters = rest[len(wrench):]
        return equations.state_rates(q, u, tau, rest[0] if wrench else None, parameters,
                                     moment[0][()] if moment else 0.0)
    return trace_program('state_rates', rates, [
        ('q', (robot.n_q,)), ('u', (robot.n,)), ('tau', (robot.n,)), *wrench, *time,
        ('parameters', robot.parameters.block.shape)])
