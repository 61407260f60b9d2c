"""
The forces of joint stops at states of a simulation, and the accelerations under them.

At each state, the forces of the stops at which joints rest and the accelerations into them solve
the complementarity problem of `mechanics.joint_stops.stop_impulses`, f >= 0, a <= 0, f . a = 0.
"""

from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.ball_joints import angle_places, angles
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.mechanics.constraints.row_units import coordinate_units
from kane_dynamics.mechanics.integrators.held_joints import REGULAR
from kane_dynamics.mechanics.joint_stops import nearest_stops, stop_impulses
from kane_dynamics.robot.robot import Robot
import numpy as np

TOUCHING = 1e-9  # rad, or lengths of the mechanism: distance of a joint at its stop
AT_REST = 1e-7  # rad/s, or lengths of the mechanism per second, with constraints


def resting_sides(robot: Robot, q: Array, u: Array, lower: Array, upper: Array,
                  **at: Any) -> Array:
    """
    Return the sides of the stops at which joints rest, of the shape of q; 0 of other joints.

    Parameters
    ----------
    robot : Robot
        Of any kind.
    q, u : (..., n_q), (..., n) arrays
        States of the robot; rad or m, and s.
    lower, upper : (n_q,) arrays
        The stops, rad or m; infinite where there is none.
    **at
        The time, if the robot's equations depend on it.

    """
    side, away = nearest_stops(q, lower, upper)
    if isinstance(robot.equations, ConstrainedEquations):
        units = coordinate_units(robot.model, robot.mechanism.constraints)
        near, slow = TOUCHING * units, AT_REST * units
    else:
        near = slow = np.zeros(robot.n_q)  # joints of trees rest at their stops exactly
    resting = (np.abs(away) <= near) & (np.abs(robot.joint_rates(q, u, **at)) <= slow)
    sides: Array = side * resting
    return sides


def with_stop_forces(robot: Robot, q: Array, u: Array, udot: Array, lower: Array, upper: Array,
                     **at: Any) -> tuple[Array, Array]:
    """
    Return the accelerations under the forces of the stops, and these forces.

    Parameters
    ----------
    robot : Robot
        Of any kind.
    q, u, udot : (K, n_q), (K, n), (K, n) arrays
        States, and the accelerations without the stops.
    lower, upper, **at
        As in `resting_sides`; the time is a (K,) array.

    Returns
    -------
    udot : (K, n) array
    forces : (K, n_j) array
        Generalized forces of the stops on the joints, N m or N: positive at lower stops.

    """
    forces = np.zeros((len(q), robot.model.n))
    side = resting_sides(robot, q, u, lower, upper, **at)
    rows = np.flatnonzero(side.any(axis=1))
    if not len(rows):
        return udot, forces
    udot = udot.copy()
    joints, places = angles(robot.model), angle_places(robot.model)
    constrained = isinstance(robot.equations, ConstrainedEquations)
    moments = {name: x[rows] for name, x in at.items()}
    T, inverse = _partial_rates(robot, q[rows], moments)
    accelerations = robot.joint_accelerations(q[rows], u[rows], udot[rows], **moments)
    for row, partial_rates, inverse_mass, qddot in zip(rows, T, inverse, accelerations):
        of_joints = side[row, places]
        held = np.flatnonzero(of_joints)
        s, which = of_joints[held], np.array(joints)[held]
        along = inverse_mass @ (s[:, None] * partial_rates[which]).T
        A = (s[:, None] * partial_rates[which]) @ along
        if constrained:  # may couple stops: then A is singular, and the stops share the force
            A = A + REGULAR * np.diag(A).max() * np.eye(len(A))
        force, _ = stop_impulses(s * qddot[which], A)
        udot[row] -= along @ force
        forces[row, which] = -s * force
    return udot, forces


def _partial_rates(robot: Robot, q: Array, at: dict[str, Array]) -> tuple[Array, Array]:
    """Return T, (K, n_j, n), of the joints' speeds T u + X, and M^-1, (K, n, n)."""
    n, count = robot.n, len(q)
    inverse = robot.inverse_mass_matrix(q, **at)
    if not isinstance(robot.equations, ConstrainedEquations):
        return np.broadcast_to(np.eye(n), (count, n, n)), inverse
    T = np.empty((count, robot.model.n, n))
    rest = robot.joint_accelerations(q, np.zeros((count, n)), np.zeros((count, n)), **at)
    for k, unit in enumerate(np.eye(n)):
        moved = robot.joint_accelerations(q, np.zeros((count, n)), np.tile(unit, (count, 1)), **at)
        T[:, :, k] = moved - rest
    return T, inverse
