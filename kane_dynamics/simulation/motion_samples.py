"""
States of a simulation, which have joint rates v, in terms of speeds and forces.

Speeds u = Y v + Z, accelerations, and forces with whichever law of friction. u is defined
also where these speeds do not determine the motion.
"""

from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.jet import moving, rates, values
from kane_dynamics.mechanics.ball_joints import coordinate_rates
from kane_dynamics.mechanics.constraints.speeds import JOINT_RATES, speed_places
from kane_dynamics.mechanics.integrators.held_joints import held_solution, linear_system
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.kernel_set import kernel_per_robot
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.step_kernels import (deflection_input, deflections_of,
                                                   independent_speeds, state_layout,
                                                   tau_from)
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
    contact_points : (K, c, 3) array
        Where the contacts touch, m, in the world.
    contact_modes : (K, c) array of int
        `ContactMode` of each contact.

    """

    vdot: Array
    stop_forces: Array
    friction: Array
    sticking: Any
    contact_forces: Array
    contact_points: Array
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
    q, v, _ = state_parts(robot, states)
    K, n_j = v.shape
    tau = np.ascontiguousarray(tau, dtype=np.float64)
    time = robot.equations.time_inputs(times)
    if robot.equations.in_joint_rates and not deflection_input(robot):
        no_wrench = (None,) if len(robot.kernels.no_wrench) else ()
        vdot = robot.kernels.kernel('forward_dynamics')(q, v, tau, *no_wrench, *time)
        friction: Array = np.full((K, n_j), np.nan)
    else:
        bent = [np.ascontiguousarray(deflections_of(robot, states))]
        results = motion_kernel(robot)(q, v, tau, *bent[:len(deflection_input(robot))], *time)
        vdot, friction = results.swapaxes(0, 1).copy()
    # Friction that does not stick never holds a joint.
    return MotionSamples(vdot, np.zeros((K, n_j)), friction, np.zeros((K, n_j), dtype=bool),
                         np.zeros((K, 0, 3)), np.zeros((K, 0, 3)), np.zeros((K, 0), dtype=int))


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


def state_parts(robot: Robot, states: Array) -> tuple[Array, Array, Array]:
    """Return q, v and the times, (...,), of states, (..., size); times are 0 without any."""
    layout = state_layout(robot)
    q, v, time = (states[..., part] for part in (layout.q, layout.v, layout.time))
    times = time[..., 0] if time.shape[-1] else np.zeros(states.shape[:-1])
    return np.ascontiguousarray(q), np.ascontiguousarray(v), times


def admissible(robot: Robot, states: Array) -> Array:
    """
    Return states, (K, size), whose joint rates are exactly those of the robot's speeds.

    After a step the rates of dependent joints are those before loops are closed.
    """
    if not robot.equations.watched:
        return states
    result = states.copy()
    q, v, times = state_parts(robot, states)
    result[:, state_layout(robot).v] = _rates_kernel(robot)(
        q, v, *robot.equations.time_inputs(times))
    return result


@kernel_per_robot
def _rates_kernel(robot: Robot) -> Kernel:
    """Return the kernel of v, (n_j,), that the constraints admit."""
    equations = robot.equations

    def rates(q: Vector, v: Vector, t: Scalar) -> Vector:
        return equations.joint_speeds(q, independent_speeds(equations, q, v, t), t)
    n_j = (robot.model.n,)
    return robot.compiled(rates, name='admissible_rates', q=(robot.n_q,), v=n_j, shape=n_j)


def speeds_in(robot: Robot, states: Array) -> Array:
    """Return the robot's speeds in states, (..., size), as (..., n)."""
    q, v, times = state_parts(robot, states)
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
    dual = np.linalg.solve(np.stack(columns, axis=-1), forces[..., None])
    return np.asarray(dual[..., 0], dtype=np.float64)


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
