"""Small vibrations of a robot about a configuration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from kane_dynamics._util.checks import finite_row, instance, names_of_joints
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.jet import moving, rates
from kane_dynamics.mechanics.ball_joints import balls, coordinate_rates, require_unit
from kane_dynamics.mechanics.constraints.conditioning import RANK
from kane_dynamics.mechanics.definition import kane
from kane_dynamics.model.model import with_payload
from kane_dynamics.robot.robot import Robot
import numpy as np

ASYMMETRY = 1e-9  # of a symmetric stiffness: rounding
ROUNDING = 1e-15  # relative to the terms of a stiffness, per coordinate: that of none


@dataclass(frozen=True, eq=False)
class Vibration:
    """
    Natural frequencies and mode shapes.

    Attributes
    ----------
    frequencies : (k,) array
        rad/s, ascending; 0 for modes without stiffness, such as the rigid motions of a
        free body, negative (minus the growth rate, 1/s) for unstable modes.
    shapes : (n, k) array
        Column j: mode shape of frequency j in the speeds of the joints, with unit modal
        mass: coordinates, and rotation vectors of ball joints on the axes of their
        bodies. Without constraints and chosen speeds, `Robot.integrate` moves a
        configuration by it.
    names : tuple of str
        Names of the rows, as `Robot.joint_names`.

    """

    frequencies: Array
    shapes: Array
    names: tuple[str, ...]


def natural_vibration(robot: Robot, q: Any, held: Sequence[str] = ()) -> Vibration:
    """
    Return natural frequencies and mode shapes at rest: M y'' + K y = 0, y' = u.

    K is the Hessian of the potential energy V along the motions that the constraints
    admit. With the joints' speeds T u and constraint forces J^T lambda = V' - tau, it is
    (the torques tau of the joints and lambda are constant)

        K_ij = T_i . V'' T_j + (V' - tau) . dT_i/dy_j.

    Derivatives of V are those along the motions of the joints, which for ball joints are
    rotations about the axes of their bodies.

    Parameters
    ----------
    robot : Robot
        Of any kind that does not depend on time.
    q : (n_q,) array
        An equilibrium, or a configuration held by actuators; rad, m, and modal
        coordinates. With constraints it must satisfy them; the actuators are those of
        `Robot.joint_torques`.
    held : sequence of str
        Joints, or modal coordinates, that do not move, such as braked joints.

    Raises
    ------
    InputError
        An unknown joint, an invalid q, a singular mass matrix, speeds or constraints
        that depend on time, or loaded ball joints or loaded constraints that are not
        those of positions: then K is not symmetric.
    ConstraintError
        The configuration is not closed.

    """
    instance(robot, Robot, 'robot')
    names = robot.joint_names
    robot.equations.require_timeless('vibrations', 'so that the robot has an equilibrium')
    for name in names_of_joints(held, 'held'):
        if name not in names:
            raise InputError(f"held: no joint '{name}'; expected one of "
                             f"{', '.join(names)}")
    q = require_unit(robot.model, finite_row(q, 'q', robot.coordinate_names), 'q')
    M, motions = robot.mass_matrix(q), _admitted(robot, q)
    # Only motions that do not move the held joints are left.
    held_rows = motions.T[list(map(names.index, held))]
    free = _free_motions(held_rows)
    M = free.T @ M @ free
    K = free.T @ motions.K @ free
    size = np.abs(free).T @ motions.size @ np.abs(free)
    if np.abs(K - K.T).max(initial=0.0) > ASYMMETRY * size.max(initial=0.0):
        loaded = [*(ball.name for ball in balls(robot.model)), *robot.constraint_names]
        raise InputError('vibrations: a ball joint or velocity constraint among '
                         f'{loaded} carries a load; expected an equilibrium in which '
                         'none does, so that the stiffness matrix is symmetric')
    # With M = L L^T and y = L^-T z the problem is z'' + L^-1 K L^-T z = 0.
    try:
        root = np.linalg.inv(np.linalg.cholesky(M))
    except np.linalg.LinAlgError:
        raise InputError('vibrations: the mass matrix is singular (a massless moving '
                         'body); expected mass in every motion that is not held') from None
    squares, vectors = np.linalg.eigh(root @ K @ root.T)
    shapes = root.T @ vectors
    # The eigenvalue of no stiffness is the rounding of K along its shape and of the
    # largest one.
    terms = np.einsum('ij,ik,kj->j', np.abs(shapes), size, np.abs(shapes))
    rounding = ROUNDING * len(K) * (terms + np.abs(squares).max(initial=0.0))
    squares[np.abs(squares) <= rounding] = 0.0
    frequencies = np.sign(squares) * np.sqrt(np.abs(squares))
    return Vibration(frequencies, motions.T @ free @ shapes, names)


class _Stiffness(NamedTuple):
    """T, (n_j, n), the stiffness of the admissible motions, (n, n), and its terms' size."""

    T: Array
    K: Array
    size: Array


def _admitted(robot: Robot, q: Array) -> _Stiffness:
    """Return the stiffness of the motions that the constraints admit."""
    slope, K, size = potential_derivatives(robot, q)
    equations = robot.equations
    motions = [equations.mechanism.joint_motion(q, unit,
                                                0.0 * unit) for unit in np.eye(robot.n)]
    T = motions[0].T.astype(np.float64)
    # The forces that constraints carry act along the curvature of the admissible
    # motions.
    carried = slope - robot.joint_torques(T.T @ slope, q)
    curvature = np.array([carried @ motion.T_rate for motion in motions],
                         dtype=np.float64).T
    size = np.abs(T).T @ size @ np.abs(T) + np.abs(curvature)
    return _Stiffness(T, T.T @ K @ T + curvature, size)


def _free_motions(rows: Array) -> Array:
    """Return a basis, (n, k), of the motions that rows, (m, n), map to zero."""
    if ((rows == 0.0) | (rows == 1.0)).all():  # coordinates of their own
        return np.eye(rows.shape[1])[:, ~rows.any(axis=0)]
    _, size, basis = np.linalg.svd(rows)
    rank = int((size > RANK * size.max()).sum())
    return np.asarray(basis[rank:].T)


def potential_derivatives(robot: Robot, q: Array) -> tuple[Array, Array, Array]:
    """
    Return the derivatives of V along the motions of the joints, (n_j,), and theirs, (n_j, n_j).

    Exact, of gravity, springs and beams. The derivatives of V are the forces that hold the
    robot at rest; entry [r, s] is the derivative of entry r along motion s. Entries of one
    ball joint differ from their transpose by its moment. The third result is the size of
    the terms, which states what is rounding.
    """
    model = robot.model
    frame = robot.equations.payload_frame
    payload = robot.parameters.payload
    if frame is not None and payload is not None:
        model = with_payload(model, frame.name, payload)
    at_rest = np.zeros(model.n)

    def holding_force(q: Any) -> Any:
        return kane.bias_force(model, q, at_rest, gravity=robot.parameters.gravity,
                               friction=False)
    slope = np.asarray(holding_force(q), dtype=np.float64)
    columns = []
    for motion in np.eye(model.n):
        along = holding_force(moving(q, coordinate_rates(model, q, motion)))
        columns.append(rates(along))
    K = np.array(columns).reshape(model.n, model.n).T
    return slope, K, np.abs(K)


def stiffness_matrix(robot: Robot, q: Array) -> Array:
    """Return the Jacobian of `potential_derivatives`, (n_j, n_j)."""
    return potential_derivatives(robot, q)[1]
