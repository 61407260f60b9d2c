"""
The independent speeds at states of a simulation, which have joint rates v.

u = Y v + Z is defined also where these speeds do not determine the motion.
"""

from typing import Any

from kane_dynamics._util.typing import Array, Scalar, Vector
from kane_dynamics.mechanics.algebra.dual import moving, rates, values
from kane_dynamics.mechanics.ball_joints import coordinate_rates
from kane_dynamics.mechanics.constraints.speeds import JOINT_RATES, speed_places
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.kernel_set import kernel_per_robot
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.step_kernels import state_layout, tau_from
import numpy as np


def parts_of(robot: Robot, states: Array) -> tuple[Array, Array, Array]:
    """Return q, v and the times, (...,), of states, (..., size); times are 0 without any."""
    layout = state_layout(robot)
    q, v, time = (states[..., part] for part in (layout.q, layout.v, layout.time))
    times = time[..., 0] if time.shape[-1] else np.zeros(states.shape[:-1])
    return np.ascontiguousarray(q), np.ascontiguousarray(v), times


def speeds_in(robot: Robot, states: Array) -> Array:
    """Return the robot's speeds in states, (..., size), as (..., n)."""
    q, v, times = parts_of(robot, states)
    if robot.equations.in_joint_rates:
        return v
    if robot.mechanism.speeds.key == JOINT_RATES:  # a part of the joint rates
        return np.ascontiguousarray(v[..., list(robot.mechanism.free)])
    n_j = robot.model.n
    rows = speeds_of_motion(robot, q.reshape(-1, robot.n_q), v.reshape(-1, n_j),
                            np.zeros((v.size // n_j, n_j)), times.ravel())
    return np.ascontiguousarray(rows[:, 0]).reshape(*v.shape[:-1], robot.n)


def speeds_of_motion(robot: Robot, q: Array, v: Array, vdot: Array, times: Array) -> Array:
    """Return the robot's speeds and their rates, (K, 2, n), in motions of the joints."""
    if robot.equations.in_joint_rates:
        return np.stack([v, vdot], axis=1)
    result: Array = _speeds_kernel(robot)(q, v, vdot, *robot.equations.time_inputs(times))
    return result


@kernel_per_robot
def _speeds_kernel(robot: Robot) -> Kernel:
    """Return the kernel of u and u', (2, n), by q, v and v'."""
    equations = robot.equations

    def speeds(q: Vector, v: Vector, vdot: Vector, t: Scalar) -> Any:
        q_moving = moving(q, coordinate_rates(robot.model, q, v))
        state = equations.mechanism.state(q_moving, moving(t, 1.0), equations.tree.geometry)
        Y, Z = state.speed_rows(equations.speed_names)
        return np.array([values(Y) @ v + values(Z),
                         values(Y) @ vdot + rates(Y) @ v + rates(Z)])
    n_j = (robot.model.n,)
    return robot.compiled(speeds, name='speeds_of_motion', q=(robot.n_q,), v=n_j, vdot=n_j,
                          shape=(2, robot.n))


def generalized_forces(robot: Robot, user_robot: Robot, q: Array, tau: Array,
                       times: Array) -> Array:
    """Convert forces dual to the user's speeds to those dual to the robot's, (K, n)."""
    if robot.speed_names == user_robot.speed_names:
        return tau
    kernel = _forces_kernel(robot, user_robot.speed_names)
    result: Array = kernel(q, tau, *robot.equations.time_inputs(times))
    return result


def dual_forces(robot: Robot, user_robot: Robot, q: Array, forces: Array,
                times: Array) -> Array:
    """Convert forces dual to the robot's speeds to those dual to the user's, (K, n)."""
    if robot.speed_names == user_robot.speed_names:
        return forces
    # The inverse of `generalized_forces`, whose columns are its values for unit forces.
    columns = [generalized_forces(robot, user_robot, q, np.tile(unit, (len(q), 1)), times)
               for unit in np.eye(forces.shape[1])]
    dual: Array = np.linalg.solve(np.stack(columns, axis=-1), forces[..., None])[..., 0]
    return dual


@kernel_per_robot
def _forces_kernel(robot: Robot, names: tuple[str, ...]) -> Kernel:
    """Return the kernel of `tau_from` for speeds of these names."""
    def forces(q: Vector, tau: Vector, t: Scalar) -> Any:
        return tau_from(robot.equations, names, q, tau, t)
    places = speed_places(robot.mechanism.speeds, names)
    return robot.kernels.compiled(forces, f'tau_from_{"_".join(map(str, places))}',
                                  {'q': (robot.n_q,), 'tau': (len(names),)}, (robot.n,),
                                  ahead=False)


def actuator_torques(robot: Robot, user_robot: Robot, q: Array, generalized: Array,
                     tau: Array, times: Array) -> Array:
    """
    Return the torques that the actuators exert on the joints, (K, n_j).

    Without stated actuators each acts on its own speed of the user's robot, to which tau is
    dual; `generalized` is dual to the robot's speeds.
    """
    stated = robot.equations.actuated is not None
    kernel = _actuators_kernel(robot, () if stated else user_robot.speed_names)
    result: Array = kernel(q, generalized if stated else tau,
                           *robot.equations.time_inputs(times))
    return result


@kernel_per_robot
def _actuators_kernel(robot: Robot, names: tuple[str, ...]) -> Kernel:
    """Return the kernel of `actuator_torques`, for forces dual to speeds of these names."""
    equations = robot.equations

    def torques(q: Vector, tau: Vector, t: Scalar) -> Any:
        if not names:
            return equations.shared_torques(q, tau, t)
        return equations.state(q, t).speed_rows(names)[0].T @ tau
    places = speed_places(robot.mechanism.speeds, names)
    return robot.kernels.compiled(torques, f'actuator_torques_{"_".join(map(str, places))}',
                                  {'q': (robot.n_q,), 'tau': (robot.n,)},
                                  (robot.model.n,), ahead=False)
