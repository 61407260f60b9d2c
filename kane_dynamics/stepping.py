"""One integration step of a robot as a kernel, its dynamics as subroutines."""

from typing import Any

from kane_dynamics.mechanics.integration import runge_kutta_4
from kane_dynamics.native.expression import call
from kane_dynamics.native.kernels import Argument, Kernel
from kane_dynamics.native.program import Program, Shape, trace_program
from kane_dynamics.quantities import IN_LOOPS
from kane_dynamics.robot import Robot
import numpy as np

# What `simulate` asks for all rows of its result at once.
AFTERWARDS = ('forward_dynamics', 'inverse_dynamics', 'friction_force', 'kinetic_energy',
              'potential_energy')


def compile_simulation(robot: Robot) -> None:
    """
    Compile every kernel that `simulate` may need, so that no request waits for a compiler.

    Those that step many simulations at once are not among them.
    """
    robot.compile(*IN_LOOPS)
    for feedback in (False, True):
        step_kernel(robot, feedback)
    for name in AFTERWARDS:
        robot.kernels.quantity(name).compile_lanes()


def step_kernel(robot: Robot, feedback: bool) -> Kernel:
    """
    Return the kernel of one Runge-Kutta step.

    Its pointers: state (2 n), inputs, constants, next state (2 n). With held torques the inputs
    are tau (n) and the constants the step and the robot's parameters. With feedback the inputs
    are q, u and udot desired at the step's beginning, middle and end (3, 3 n), and the constants
    begin with kp and kd.
    """
    name = 'step_computed_torque' if feedback else 'step_held_torque'
    n, inputs = robot.n, _inputs(robot, feedback)
    arguments = [Argument(key, shape) for key, shape in inputs[:2]]
    return robot.kernels.extra(name, lambda: _program(robot, name, feedback), arguments,
                               np.zeros(inputs[2][1]), (2 * n,))


def _inputs(robot: Robot, feedback: bool) -> list[tuple[str, Shape]]:
    n, parameters = robot.n, len(robot.parameters.block)
    return [('state', (2 * n,)), ('inputs', (3, 3 * n) if feedback else (1, n)),
            ('constants', ((2 * n if feedback else 0) + 1 + parameters,))]


def _program(robot: Robot, name: str, feedback: bool) -> Program:
    """Trace one step."""
    n, kernels = robot.n, robot.kernels
    forward = kernels.program('forward_dynamics')
    law = kernels.feedback_program() if feedback else forward
    wrench = [kernels.no_wrench] if len(kernels.no_wrench) else []

    def step(state: Any, inputs: Any, constants: Any) -> Any:
        gains, h, parameters = np.split(constants, [2 * n, 2 * n + 1] if feedback else [0, 1])

        def udot(q: Any, u: Any, given: Any) -> Any:
            tau = given
            if feedback:  # the law of control.Controller
                tau = np.array(call(law, q, u, *np.split(given, 3), gains, *wrench, parameters))
            return np.array(call(forward, q, u, tau, *wrench, parameters))
        moments = inputs if feedback else (inputs[0], inputs[0], inputs[0])
        q, u = runge_kutta_4(udot, state[:n], state[n:], moments, h[0])
        return np.concatenate([q, u])
    return trace_program(name, step, _inputs(robot, feedback))
