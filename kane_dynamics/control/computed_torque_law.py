"""
The computed-torque law, traced into one program for all of its uses.

    tau = ID_rigid(q, u, udot_d + kd (u_d - u) + kp (q_d - q)) + friction(u_d)

`Controller` calls it as a kernel; native simulation and sweeps call it as a subroutine of their
steps. Friction is that of the desired speed: compensation at the measured speed would accelerate
an arm at rest.
"""

from collections.abc import Callable
from typing import Any

from kane_dynamics.errors import InputError
from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import Program, Shape
from kane_dynamics.robot.robot import Robot
import numpy as np

NAME = 'computed_torque'
STATES = ('q', 'u', 'q_d', 'u_d', 'udot_d')  # measured, then desired; the gains follow


def corrected_acceleration(q: Any, u: Any, q_d: Any, u_d: Any, udot_d: Any, kp: Any,
                           kd: Any) -> Any:
    """Return the corrected acceleration of computed torque, (n,) or (N, n)."""
    return udot_d + (kd * (u_d - u) + kp * (q_d - q))


def law_program(robot: Robot) -> Program:
    """Trace the law; arguments as those of `law_kernel`, then the robot's parameters."""
    function, inputs = _law(robot)
    return robot.kernels.function(function, NAME, inputs).program()


def law_kernel(robot: Robot) -> Kernel:
    """
    Return the law as a kernel of the robot.

    Its arguments are q, u measured, q, u, udot desired, (n,) each, and the gains: kp, then kd,
    (2 n,); then the wrenches where frames for them are declared.

    Raises
    ------
    InputError
        The robot has chosen speeds or constraints.

    """
    function, inputs = _law(robot)
    return robot.kernels.compiled(function, NAME, inputs, (robot.n,))


def _law(robot: Robot) -> tuple[Callable[..., Any], dict[str, Shape | Argument]]:
    """Return the law as a function of a robot in joint rates, and its inputs."""
    equations, n = robot.equations, robot.n

    def law(q: Any, u: Any, q_d: Any, u_d: Any, udot_d: Any, gains: Any, wrench: Any,
            parameters: Any) -> Any:
        if not equations.in_joint_rates:
            raise InputError('computed torque: a robot with chosen speeds or constraints; '
                             'expected one in joint rates without constraints')
        wanted = corrected_acceleration(q, u, q_d, u_d, udot_d, gains[:n], gains[n:])
        rigid = equations.rigid_dynamics(q, u, wanted, wrench, parameters)
        return np.array(rigid) + equations.friction_force(u_d)
    states = {name: Argument(name, (n,), robot.coordinate_names) for name in STATES}
    return law, {**states, 'gains': (2 * n,)}
