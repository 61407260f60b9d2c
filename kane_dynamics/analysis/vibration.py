"""Small vibrations of a robot about a configuration."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.hyperdual import lifted, seeded
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.mechanics.constraints.conditioning import RANK
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.mechanics.energy_form import energies
from kane_dynamics.model.with_payload import with_payload
from kane_dynamics.robot.robot import Robot
import numpy as np

ASYMMETRY = 1e-9  # of a symmetric stiffness: rounding


@dataclass(frozen=True, eq=False)
class Vibration:
    """
    Natural frequencies and mode shapes.

    Attributes
    ----------
    frequencies : (k,) array
        rad/s, ascending; 0 for modes without stiffness, negative (minus the growth rate, 1/s) for
        unstable modes.
    shapes : (n_q, k) array
        Column j: mode shape of frequency j in the coordinates, with unit modal mass.
    names : tuple of str
        Names of the coordinates.

    """

    frequencies: Array
    shapes: Array
    names: tuple[str, ...]


def natural_vibration(robot: Robot, q: Any, held: Sequence[str] = ()) -> Vibration:
    """
    Return natural frequencies and mode shapes at rest: M y'' + K y = 0, y' = u.

    K is the Hessian of the potential energy V along the motions that the constraints admit. With
    q' = T u and constraint forces J^T lambda = dV/dq - tau, it is (the torques tau of the joints
    and lambda are constant)

        K_ij = T_i . V'' T_j + (dV/dq - tau) . dT_i/dy_j.

    Parameters
    ----------
    robot : Robot
        Of any kind that does not depend on time.
    q : (n_q,) array
        An equilibrium, or a configuration held by actuators; rad, m, and modal coordinates. With
        constraints it must satisfy them; the actuators are those of `Robot.joint_torques`.
    held : sequence of str
        Coordinates that do not move, such as braked joints.

    Raises
    ------
    InputError
        An unknown coordinate, speeds or constraints that depend on time, or loaded constraints
        that are not those of positions: then K is not symmetric.
    ConstraintError
        The configuration is not closed.

    """
    require_angles(robot.model, 'vibrations')
    names = robot.coordinate_names
    if robot.equations.timed:
        raise InputError('vibrations: speeds or constraints that are functions; expected a robot '
                         'that does not depend on time, which alone has an equilibrium')
    for name in held:
        if name not in names:
            raise InputError(f"held: no coordinate '{name}'; expected one of {', '.join(names)}")
    q = np.array(q, dtype=np.float64)
    M, (T, K) = robot.mass_matrix(q), _admitted(robot, q)
    free = _free_motions(T[[names.index(name) for name in held]])
    M, K = free.T @ M @ free, free.T @ K @ free
    root = np.linalg.inv(np.linalg.cholesky(M))
    square, vectors = np.linalg.eigh(root @ K @ root.T)
    return Vibration(np.sign(square) * np.sqrt(np.abs(square)), T @ free @ root.T @ vectors, names)


def _admitted(robot: Robot, q: Array) -> tuple[Array, Array]:
    """Return T, (n_q, n), and the stiffness of the admissible motions, (n, n)."""
    slope, K = potential_derivatives(robot, q)
    equations = robot.equations
    if not isinstance(equations, ConstrainedEquations):
        return np.eye(robot.n), K
    motions = [equations.mechanism.joint_motion(q, unit, 0.0 * unit) for unit in np.eye(robot.n)]
    T = motions[0].T.astype(np.float64)
    carried = slope - robot.joint_torques(T.T @ slope, q)  # by constraints
    turning = np.array([carried @ motion.T_rate for motion in motions], dtype=np.float64)
    size = max(np.abs(K).max(), np.abs(turning).max(), 1e-300)
    if np.abs(turning - turning.T).max() > ASYMMETRY * size:
        raise InputError('vibrations: constraints of velocities that carry a load; expected an '
                         'equilibrium without load on them, where the stiffness is symmetric')
    return T, T.T @ K @ T + turning


def _free_motions(rows: Array) -> Array:
    """Return a basis, (n, k), of the motions that rows, (m, n), map to zero."""
    if ((rows == 0.0) | (rows == 1.0)).all():  # coordinates of their own
        return np.eye(rows.shape[1])[:, ~rows.any(axis=0)]
    _, size, basis = np.linalg.svd(rows)
    rank = int((size > RANK * size.max()).sum())
    return np.asarray(basis[rank:].T)


def potential_derivatives(robot: Robot, q: Array) -> tuple[Array, Array]:
    """Return dV/dq, (n_q,), and its Jacobian, (n_q, n_q), exactly: gravity, springs and beams."""
    n, model = robot.n_q, robot.model
    frame, payload = robot.equations.payload_frame, robot.parameters.payload
    if frame is not None and payload is not None:
        model = with_payload(model, frame.name, payload)
    values = [lifted(energies.potential_energy(model, seeded(q, unit, 0, n),
                                               gravity=robot.parameters.gravity), n)
              for unit in np.eye(n)]
    return values[0].gradient, np.array([value.gradient_rate for value in values])


def stiffness_matrix(robot: Robot, q: Array) -> Array:
    """Return d2 V / dq2, (n_q, n_q), exactly: gravity, springs and beams."""
    return potential_derivatives(robot, q)[1]
