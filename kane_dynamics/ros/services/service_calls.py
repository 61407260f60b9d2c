"""The computations behind the dynamics services: fill in a response from a request."""

from typing import Any

from kane_dynamics.robot.robot import Robot, TORQUE_TERMS
from kane_dynamics.ros.common.conversion import as_wrench, doubles, Index, vector
from kane_dynamics.ros.loads.wrench_input import wrenches_of_request
from kane_dynamics.ros.services.explanation_message import explanation_message
from kane_dynamics.ros.services.joint_order import close_loops, JointOrder
from kane_dynamics.ros.services.served_robot import QUASI_STATIC, RIGID, ServedRobot
import numpy as np


def _state(robot: Robot, request: Any, *fields: str) -> tuple[Any, ...]:
    """
    Return joint order, q and further vectors of a request.

    An empty velocity means rest.
    """
    order = JointOrder.of(robot, request.joint_names)
    # A request has the joints in its own order, and need not close the loops exactly.
    q = close_loops(robot, vector(request.position, order.joints, robot.n_q, 'position'))
    vectors = []
    for field in fields:
        default = 0.0 if field == 'velocity' else None
        vectors.append(vector(getattr(request, field), order.speeds, robot.n, field,
                              default))
    return order, q, *vectors


def _reordered(values: Any, index: Index | None) -> Any:
    """Return an (n,) or (n, n) array in the joint order of the request."""
    if index is None:
        return values
    result = np.empty_like(values)
    result[index if values.ndim == 1 else np.ix_(index, index)] = values
    return result


def _constraint_forces(robot: Robot, response: Any, *state: Any) -> None:
    """Fill in the constraint forces."""
    response.constraint_names = list(robot.constraint_names)
    response.constraint_forces = doubles(robot.constraint_forces(*state))


def inverse_dynamics(served: ServedRobot, request: Any, response: Any) -> None:
    """Fill in the torques of a motion, joint reactions, and constraint forces."""
    robot = served.robot
    order, q, u, udot = _state(robot, request, 'velocity', 'acceleration')
    tau = robot.inverse_dynamics(q, u, udot)
    torques = robot.joint_torques(tau, q)
    # Beams bend under the load, which the torques of the motion include.
    if served.bending is not None:
        torques = robot.joint_torques(served.bending.inverse_dynamics(q, u, udot), q)
        response.message = QUASI_STATIC
    names = response.joint_names = order.joint_names
    response.effort = doubles(_reordered(torques, order.joints))
    # Reactions are by body, the response is by joint.
    joints = [body.joint.name for body in robot.model.bodies]
    reactions = robot.joint_reactions(q, u, udot)
    response.joint_reactions = [as_wrench(reactions[joints.index(name)])
                                for name in names]
    _constraint_forces(robot, response, q, u, tau)


def forward_dynamics(served: ServedRobot, request: Any, response: Any) -> None:
    """Fill in the accelerations that torques cause, and the constraint forces."""
    robot = served.robot
    response.message = RIGID * (served.bending is not None)
    order, q, u, tau = _state(robot, request, 'velocity', 'effort')
    response.joint_names = order.speed_names
    response.acceleration = doubles(_reordered(robot.forward_dynamics(q, u, tau),
                                               order.speeds))
    _constraint_forces(robot, response, q, u, tau)


def get_dynamics(served: ServedRobot, request: Any, response: Any) -> None:
    """Fill in mass matrix, bias, gravity and friction forces, and energies."""
    robot = served.robot
    response.message = RIGID * (served.bending is not None)
    order, q, u = _state(robot, request, 'velocity')
    response.joint_names = order.speed_names
    response.mass_matrix = doubles(_reordered(robot.mass_matrix(q), order.speeds))
    # In the order of the joints of the request.
    friction = robot.torque_terms(q, u,
                                  np.zeros(robot.n))[TORQUE_TERMS.index('friction')]
    for field, values in (('bias_force', robot.bias_force(q, u)),
                          ('gravity_force', robot.gravity_force(q)),
                          ('friction_force', friction)):
        setattr(response, field, doubles(_reordered(values, order.speeds)))
    response.kinetic_energy = float(robot.kinetic_energy(q, u))
    response.potential_energy = float(robot.potential_energy(q))


def explain(served: ServedRobot, request: Any, response: Any) -> None:
    """Fill in the torque breakdown of a motion, by source and by body, and the power."""
    robot = served.robot
    response.message = RIGID * (served.bending is not None)
    order, q, u, udot = _state(robot, request, 'velocity', 'acceleration')
    wrench = wrenches_of_request(served.frames, q, request.wrenches)
    response.explanation = explanation_message(robot, (q, u, udot), wrench,
                                               order.speed_names, order.speeds)
