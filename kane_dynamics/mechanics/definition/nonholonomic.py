"""
Reference formulation of Kane's equations with constraints: F~_r + F~_r* = 0.

The reference for `equations`, over numbers and symbols. With q' = W u + X and
u_D = A u_I + B,

    F~_r = F_r + sum_s F_s A_sr,    F~_r* likewise,    u_D' = A u_I' + A' u_I + B'

(Kane & Levinson, chapter 4; F_r and F_r* are the sums of `kane`.)
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TYPE_CHECKING

from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra import linear_solve
from kane_dynamics.mechanics.algebra.jet import moving, rates, values
from kane_dynamics.mechanics.ball_joints import coordinate_rates
from kane_dynamics.mechanics.definition import kane
from kane_dynamics.mechanics.elastic_joints import damping_torque, drive_forces
from kane_dynamics.mechanics.friction import carries_loads
import numpy as np

if TYPE_CHECKING:  # the type alone: the definition stands on its own
    from kane_dynamics.mechanics.constraints.mechanism import Mechanism

Rewriting = Callable[[str, Any], Any]


def unchanged(name: str, coefficients: Any) -> Any:
    """Return the coefficients of a reduction as they are."""
    return coefficients


@dataclass(frozen=True, eq=False)
class Reduction:
    """
    Coefficients of the generalized speeds and constraints at one configuration and time.

    Attributes
    ----------
    W, X : (n_q, n_q), (n_q,) arrays
        q' = W u + X.
    A, B : (m, n), (m,) arrays
        u_D = A u_I + B.
    D : (m, m) array
        Dependent speeds per unit of each row: the inverse of the rows' coefficients.

    """

    W: Matrix
    X: Vector
    A: Matrix
    B: Vector
    D: Matrix


@dataclass(frozen=True, eq=False)
class Drift:
    """
    Accelerations at constant independent speeds.

    Attributes
    ----------
    dependent : (m,) array
        u_D' = A u_I' + dependent.
    joints : (n_q,) array
        q'' = W u' + joints.

    """

    dependent: Vector
    joints: Vector


def reduction(mechanism: 'Mechanism', q: Vector, t: Scalar = 0.0,
              rewritten: Rewriting = unchanged) -> Reduction:
    """
    Return W, X of q' = W u + X, and A, B of u_D = A u_I + B, at a configuration.

    `rewritten` may replace the entries of each coefficient by equal ones.
    """
    dependent = dependent_places(mechanism)

    # u = Y q' + Z gives q' = W u + X.
    Y, Z = mechanism.speeds.of(q, t)
    W = rewritten('W', inverse(Y))
    X = rewritten('X', -(W @ Z))

    # J q' = b gives C u = b - J X with C = J W, which is solved for u_D.
    J, b = _rows(mechanism, q, t)
    C = rewritten('C', J @ W)
    D = rewritten('D', inverse(C[:, dependent]))
    A = rewritten('A', -(D @ C[:, mechanism.free]))
    B = rewritten('B', D @ (b - J @ X))
    return Reduction(W, X, A, B, D)


def dependent_places(mechanism: 'Mechanism') -> list[int]:
    """Return the indices of the dependent speeds."""
    return [r for r in range(mechanism.model.n) if r not in mechanism.free]


def in_all_speeds(mechanism: 'Mechanism', independent: Vector,
                  dependent: Vector) -> Vector:
    """Return quantities of all speeds, (n_q,), in their order."""
    places = [*mechanism.free, *dependent_places(mechanism)]
    both = np.concatenate([independent, dependent])
    return both[np.argsort(places)]


def all_speeds(mechanism: 'Mechanism', parts: Reduction, u: Vector) -> Vector:
    """Return all speeds, (n_q,), from the independent ones."""
    return in_all_speeds(mechanism, u, parts.A @ u + parts.B)


def constrained_rates(parts: Reduction, speeds: Vector) -> Vector:
    """Return q', (n_q,), for all speeds, (n_q,)."""
    rates_of_joints: Vector = parts.W @ speeds + parts.X
    return rates_of_joints


def drift(mechanism: 'Mechanism', parts: Reduction, q: Vector, qdot: Vector, u: Vector,
          t: Scalar = 0.0, rewritten: Rewriting = unchanged) -> Drift:
    """
    Return the accelerations by the time derivatives of A, B, Y and Z.

    `rewritten` may replace the entries of coefficients by equal ones, as in `reduction`.
    """
    free = mechanism.free
    dependent = dependent_places(mechanism)
    W, A, B, D = parts.W, parts.A, parts.B, parts.D

    # Time derivatives along the motion, by dual numbers.
    q_moving = moving(q, coordinate_rates(mechanism.model, q, qdot))
    t_moving = moving(t, 1.0)
    Y_moving, Z_moving = mechanism.speeds.of(q_moving, t_moving)
    Y_rate = rates(Y_moving)
    Z_rate = rates(Z_moving)
    rows = mechanism.rows(mechanism.state(q_moving, t_moving))
    J_rate = rates(rows.J[mechanism.kept])
    b_rate = rates(rows.b[mechanism.kept])

    # C = J W, and W' = -W Y' W since W Y = 1; X = -W Z.
    J, _ = _rows(mechanism, q, t)
    _, Z = mechanism.speeds.of(q, t)
    C = J @ W
    C_rate = rewritten('Ct', J_rate @ W - C @ (Y_rate @ W))

    # The rates of C_I + C_D A = 0 and of C_D B = b + C Z.
    C_D_rate = C_rate[:, dependent]
    A_rate = -(D @ (C_rate[:, free] + C_D_rate @ A))
    B_rate = D @ (b_rate + C_rate @ Z + C @ Z_rate - C_D_rate @ B)

    # u_D' = A u_I' + A' u_I + B', and q'' = W (u' - Y' q' - Z').
    return Drift(rewritten('U', A_rate @ u + B_rate),
                 rewritten('V', -(W @ (Y_rate @ qdot + Z_rate))))


def joint_accelerations(mechanism: 'Mechanism', parts: Reduction, change: Drift,
                        udot: Vector) -> Vector:
    """Return q'', (n_q,), for the rates of the independent speeds."""
    u_rate = in_all_speeds(mechanism, udot, parts.A @ udot + change.dependent)
    return parts.W @ u_rate + change.joints


def joint_motion(mechanism: 'Mechanism', q: Vector, u: Vector, udot: Vector,
                 t: Scalar = 0.0) -> tuple[Vector, Vector]:
    """Return q' and q'', (n_q,)."""
    parts = reduction(mechanism, q, t)
    qdot = constrained_rates(parts, all_speeds(mechanism, parts, u))
    change = drift(mechanism, parts, q, qdot, u, t)
    return qdot, joint_accelerations(mechanism, parts, change, udot)


def nonholonomic_force(mechanism: 'Mechanism', q: Array, force: Array,
                       t: float = 0.0) -> Array:
    """
    Return the nonholonomic generalized forces F~_r, (n,), from joint forces, (n_q,).

    F_r of the chosen speeds is W^T times the joint force.
    """
    parts = reduction(mechanism, q, t)
    F = parts.W.T @ force
    total: Array = F[mechanism.free] + parts.A.T @ F[dependent_places(mechanism)]
    return total


def inverse_dynamics(mechanism: 'Mechanism', q: Array, u: Array, udot: Array,
                     t: float = 0.0, *, friction: bool = True,
                     motors: Sequence[int] | None = None, **forces: Any) -> Array:
    """
    Return tau, (n,), such that F~_r + F~_r* = 0.

    Parameters
    ----------
    mechanism, q, u, udot, t
        The mechanism and its motion.
    friction : bool
        Whether to include damping and Coulomb friction.
    motors : sequence of int, optional
        Coordinates of the joints whose motors give tau, as many as independent speeds,
        for friction that depends on their loads. Default: all joints.
    **forces
        As of `kane.generalized_active_force`.

    """
    model = mechanism.model
    qdot, qddot = joint_motion(mechanism, q, u, udot, t)
    inertia = kane.generalized_inertia_force(model, q, qdot, qddot)
    loads = None
    if friction and carries_loads(model):
        # The loads of the drives are the torques of the motion without friction, and the
        # damping of the drives.
        active = kane.generalized_active_force(model, q, qdot, friction=False, **forces)
        needed = -nonholonomic_force(mechanism, q, active + inertia, t)
        damping = drive_forces(model, qdot, damping_torque)
        loads = motor_torques(mechanism, q, needed, t, motors) + damping
    active = kane.generalized_active_force(model, q, qdot, friction=friction,
                                           loads=loads, **forces)
    return -nonholonomic_force(mechanism, q, active + inertia, t)


def motor_torques(mechanism: 'Mechanism', q: Array, tau: Array, t: float = 0.0,
                  motors: Sequence[int] | None = None) -> Array:
    """Return the torques of all joints, (n_q,), whose motors have the force tau, (n,)."""
    T = partial_rates(mechanism, q, t)
    places = range(len(T)) if motors is None else motors
    torques: Array = np.zeros(len(T))
    torques[places] = np.linalg.solve(T[places].T, tau)
    return torques


def partial_rates(mechanism: 'Mechanism', q: Vector, t: Scalar = 0.0) -> Matrix:
    """Return T, (n_q, n): joint rates per unit of each independent speed."""
    return partials_of(mechanism, reduction(mechanism, q, t))


def partials_of(mechanism: 'Mechanism', parts: Reduction) -> Matrix:
    """Return T, (n_q, n), of W and A."""
    W_I = parts.W[:, mechanism.free]
    W_D = parts.W[:, dependent_places(mechanism)]
    T: Matrix = W_I + W_D @ parts.A
    return T


def mass_matrix(mechanism: 'Mechanism', q: Array, t: float = 0.0) -> Array:
    """Return M of the independent speeds, (n, n): -F~_r* = sum_s M_rs u_s' + ..."""
    T = partial_rates(mechanism, q, t)
    M: Array = T.T @ kane.mass_matrix(mechanism.model, q) @ T
    return M


def _rows(mechanism: 'Mechanism', q: Vector, t: Scalar) -> tuple[Matrix, Vector]:
    """Return J, (m, n_q), and b, (m,), of the independent constraint rows, J q' = b."""
    rows = mechanism.rows(mechanism.state(q, t))
    return values(rows.J[mechanism.kept]), values(rows.b[mechanism.kept])


def inverse(A: Matrix) -> Matrix:
    """Return A^-1: of numbers by LAPACK, of symbols by `linear_solve`."""
    entries = values(A)  # floats, where all are
    if entries.dtype == np.float64:
        return np.linalg.inv(entries)
    return linear_solve.inverse(entries).reshape(entries.shape)
