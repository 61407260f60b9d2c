"""Accelerations and forces at states of a simulation, with whichever law of friction."""

from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.mechanics.integrators.held_joints import held_solution, linear_system
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.kernel_set import kernel_per_robot
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.step_kernels import (deflection_input, deflections_of,
                                                   independent_speeds)
from kane_dynamics.simulation.user_speeds import parts_of
import numpy as np


class MotionSamples(NamedTuple):
    """
    Accelerations, forces and modes at K states.

    Attributes
    ----------
    vdot : (K, n_j) array
        Accelerations of the joints.
    stop_forces, friction : (K, n_j) arrays
        Forces of stops on joints; torques that overcome the friction of joints and the
        forces of contacts, N m or N (NaN for trees with the smooth law: not computed).
    sticking : (K, n_j) array of bool
        Which joints friction holds.
    contact_forces : (K, c, 3) array
        On the first link, N, in world axes.
    contact_modes : (K, c) array of int
        `ContactMode` of each contact.

    """

    vdot: Array
    stop_forces: Array
    friction: Array
    sticking: Any
    contact_forces: Array
    contact_modes: Any


def motion_at(robot: Robot, states: Array, tau: Array, times: Array,
              rows: Any = None) -> MotionSamples:
    """
    Return the motion at K states, (K, size), under torques dual to the robot's speeds.

    `rows` are `stepper.RowSteps`, if there are any.
    """
    if rows is not None:
        of_rows: MotionSamples = rows.rows(robot).at_samples(states, tau, times)
        return of_rows
    q, v, _ = parts_of(robot, states)
    K, n_j = v.shape
    tau = np.ascontiguousarray(tau, dtype=np.float64)
    time = robot.equations.time_inputs(times)
    if robot.equations.in_joint_rates and not deflection_input(robot):
        no_wrench = (None,) if len(robot.kernels.no_wrench) else ()
        vdot = robot.kernels.kernel('forward_dynamics')(q, v, tau, *no_wrench, *time)
        friction = np.full((K, n_j), np.nan)
    else:
        bent = [np.ascontiguousarray(deflections_of(robot, states))]
        results = motion_kernel(robot)(q, v, tau, *bent[:len(deflection_input(robot))], *time)
        vdot, friction = results.swapaxes(0, 1).copy()
    # Friction that does not stick never holds a joint.
    return MotionSamples(vdot, np.zeros((K, n_j)), friction, np.zeros((K, n_j), dtype=bool),
                         np.zeros((K, 0, 3)), np.zeros((K, 0), dtype=int))


@kernel_per_robot
def motion_kernel(robot: Robot) -> Kernel:
    """Return the kernel of v' and the torques that overcome friction, (2, n_j)."""
    equations: Any = robot.equations
    n_j = (robot.model.n,)

    def motion(q: Vector, v: Vector, tau: Vector, *deflected: Vector, t: Scalar,
               parameters: Vector) -> Matrix:
        deflections = deflected[0] if deflected else None
        u = independent_speeds(equations, q, v, t)
        friction = equations.driven_friction(q, v, tau, t, None, deflections)
        if equations.in_joint_rates and deflections is None:
            vdot = equations.forward_dynamics(q, u, tau, None, parameters, t)
            return np.array([vdot, friction])
        # M u' = net, v' = T u' + drift
        system = linear_system(equations, q, u, tau, None, parameters, t, None,
                               deflections)
        udot = held_solution(system, system.M, system.net).w
        vdot = udot if system.T is None else system.T @ udot + system.drift
        return np.array([vdot, friction])
    return robot.compiled(motion, name='sampled_motion', q=(robot.n_q,), v=n_j,
                          tau=(robot.n,), **dict(deflection_input(robot)),
                          shape=(2, *n_j))
