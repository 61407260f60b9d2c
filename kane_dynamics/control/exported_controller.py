"""The parts of a controller as kernels, for `Robot.export_c`."""

from kane_dynamics._util.attribute_hints import hinting
from kane_dynamics._util.checks import instance
from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.control.computed_torque import law_kernel
from kane_dynamics.control.momentum_observer import residual_step
from kane_dynamics.control.torque_limiter import clipped, within_rate
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.robot import Robot
import numpy as np


@hinting
def controller_kernels(robot: Robot) -> tuple[Kernel, Kernel, Kernel]:
    """
    Return kernels of computed torque, torque limits and observer, for `export_c`.

    They are traced from the functions that `Controller`, `TorqueLimiter` and
    `MomentumObserver` use. In C, after the name of the file:

    - ``computed_torque(q, u, q_d, u_d, udot_d, gains, ...)``: gains are kp, then kd.
    - ``limited_torque(tau, last, effort, change)``: the torque clamped to the effort,
      then to a change from the last command; change is the limit of the rate times the
      time since.
    - ``momentum_observer(q, u, tau, memory, elapsed, forgotten, ...)``: the memory is
      the estimate of the external torques, the momenta and the torques beta, (3, n), of
      the sample before; the result is that of this sample. tau is the mean torque since,
      and `forgotten` exp(-K elapsed) of each joint. Begin with an elapsed time of 0,
      which sets the estimate to 0.

    Parameters
    ----------
    robot : Robot
        In joint rates, without constraints.

    Raises
    ------
    InputError
        The robot has chosen speeds or constraints.

    """
    instance(robot, Robot, 'robot')
    if not robot.equations.in_joint_rates:
        raise InputError('controller_kernels: a robot with chosen speeds or '
                         'constraints; expected one in joint rates without constraints')
    return law_kernel(robot), _limiter(robot), _observer(robot)


def _limiter(robot: Robot) -> Kernel:
    """Return the kernel of the torque limits."""
    def limits(tau: Vector, last: Vector, effort: Vector, change: Vector) -> Vector:
        limited = []
        for x, last_x, largest, largest_change in zip(tau, last, effort, change):
            clamped = clipped(x, -largest, largest)
            limited.append(within_rate(clamped, last_x, largest_change))
        return np.array(limited)
    row = (robot.n,)
    return robot.compiled(limits, name='limited_torque', tau=row, last=row, effort=row,
                          change=row, shape=row)


def _observer(robot: Robot) -> Kernel:
    """Return the kernel of a step of the momentum observer."""
    equations = robot.equations

    def step(q: Vector, u: Vector, tau: Vector, memory: Matrix, elapsed: Scalar,
             forgotten: Vector, parameters: Vector) -> Matrix:
        residual, last_momentum, last_beta = memory
        momentum, beta = equations.momentum_terms(q, u, parameters)
        if equations.carries_loads:
            tau = tau - equations.load_friction(q, u, tau)
        # The first sample has no time since the last: the estimate is 0.
        has_begun = elapsed > 0.0
        safe_elapsed = select(has_begun, elapsed, 1.0)
        estimate = residual_step(residual, last_momentum, momentum, tau,
                                 0.5 * (last_beta + beta), safe_elapsed, forgotten)
        estimate = [select(has_begun, x, 0.0) for x in estimate]
        return np.array([estimate, momentum, beta])
    row = (robot.n,)
    memory = (3, robot.n)
    return robot.compiled(step, name='momentum_observer', q=row, u=row, tau=row,
                          memory=memory, elapsed=(), forgotten=row, shape=memory)
