"""
Reference formulation of Kane's equations with constraints: F~_r + F~_r* = 0.

The reference for `equations`, on numbers. With q' = W u + X and u_D = A u_I + B,

    F~_r = F_r + sum_s F_s A_sr,    F~_r* likewise,    u_D' = A u_I' + A' u_I + B'

(Kane & Levinson, chapter 4; F_r and F_r* are the sums of `kane`.)
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TYPE_CHECKING

from kane_dynamics._util.typing import Array, Matrix
from kane_dynamics.mechanics.algebra.dual import moving, rates
from kane_dynamics.mechanics.ball_joints import coordinate_rates
from kane_dynamics.mechanics.definition import kane
from kane_dynamics.mechanics.elastic_joints import damping_torque, drive_forces
from kane_dynamics.mechanics.friction import carries_loads
import numpy as np

if TYPE_CHECKING:  # the type alone: the definition stands on its own
    from kane_dynamics.mechanics.constraints.mechanism import Mechanism


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

    """

    W: Array
    X: Array
    A: Array
    B: Array


def reduction(mechanism: 'Mechanism', q: Array, t: float = 0.0) -> Reduction:
    """Return W, X of q' = W u + X, and A, B of u_D = A u_I + B, at a configuration."""
    dependent = dependent_places(mechanism)

    # u = Y q' + Z gives q' = W u + X.
    Y, Z = mechanism.speeds.of(q, t)
    W = _numbers(np.linalg.inv(_numbers(Y)))
    X = _numbers(-W @ _numbers(Z))

    # J q' = b gives C u = b - J X with C = J W, which is solved for u_D.
    J, b = _rows(mechanism, q, t)
    C = J @ W
    A = _numbers(-np.linalg.solve(C[:, dependent], C[:, mechanism.free]))
    B = _numbers(np.linalg.solve(C[:, dependent], b - J @ X))
    return Reduction(W, X, A, B)


def dependent_places(mechanism: 'Mechanism') -> list[int]:
    """Return the indices of the dependent speeds."""
    return [r for r in range(mechanism.model.n) if r not in mechanism.free]


def all_speeds(mechanism: 'Mechanism', parts: Reduction, u: Array) -> Array:
    """Return all speeds, (n_q,), from the independent ones."""
    result = np.empty(mechanism.model.n)
    result[mechanism.free] = u
    result[dependent_places(mechanism)] = parts.A @ u + parts.B
    return result


def joint_motion(mechanism: 'Mechanism', q: Array, u: Array, udot: Array,
                 t: float = 0.0) -> tuple[Array, Array]:
    """Return q' and q'', (n_q,), with the time derivatives of A, B, Y and Z."""
    free = mechanism.free
    dependent = dependent_places(mechanism)
    parts = reduction(mechanism, q, t)
    W, A, B = parts.W, parts.A, parts.B
    qdot = W @ all_speeds(mechanism, parts, u) + parts.X

    # Time derivatives along the motion, by dual numbers.
    q_moving = moving(q, coordinate_rates(mechanism.model, q, qdot))
    t_moving = moving(t, 1.0)
    Y_moving, Z_moving = mechanism.speeds.of(q_moving, t_moving)
    Y_rate = _numbers(rates(Y_moving))
    Z_rate = _numbers(rates(Z_moving))
    rows = mechanism.rows(mechanism.state(q_moving, t_moving))
    J_rate = _numbers(rates(rows.J[mechanism.kept]))
    b_rate = _numbers(rates(rows.b[mechanism.kept]))

    # C = J W, and W' = -W Y' W since W Y = 1; X = -W Z.
    J, _ = _rows(mechanism, q, t)
    Z = _numbers(mechanism.speeds.of(q, t)[1])
    C = J @ W
    C_rate = J_rate @ W - C @ Y_rate @ W

    # The rates of C_I + C_D A = 0 and of C_D B = b + C Z.
    C_D = C[:, dependent]
    C_D_rate = C_rate[:, dependent]
    A_rate = -np.linalg.solve(C_D, C_rate[:, free] + C_D_rate @ A)
    B_rate = np.linalg.solve(C_D, b_rate + C_rate @ Z + C @ Z_rate - C_D_rate @ B)

    # u_D' = A u_I' + A' u_I + B', and q'' = W (u' - Y' q' - Z').
    u_rate = np.empty(mechanism.model.n)
    u_rate[free] = udot
    u_rate[dependent] = A @ udot + A_rate @ u + B_rate
    return qdot, W @ (u_rate - Y_rate @ qdot - Z_rate)


def nonholonomic_force(mechanism: 'Mechanism', q: Array, force: Array,
                       t: float = 0.0) -> Array:
    """
    Return the nonholonomic generalized forces F~_r, (n,), from joint forces, (n_q,).

    F_r of the chosen speeds is W^T times the joint force.
    """
    parts = reduction(mechanism, q, t)
    F = parts.W.T @ force
    return F[mechanism.free] + parts.A.T @ F[dependent_places(mechanism)]


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


def partial_rates(mechanism: 'Mechanism', q: Array, t: float = 0.0) -> Matrix:
    """Return T, (n_q, n): joint rates per unit of each independent speed."""
    parts = reduction(mechanism, q, t)
    W_I = parts.W[:, mechanism.free]
    W_D = parts.W[:, dependent_places(mechanism)]
    T: Matrix = W_I + W_D @ parts.A
    return T


def mass_matrix(mechanism: 'Mechanism', q: Array, t: float = 0.0) -> Array:
    """Return M of the independent speeds, (n, n): -F~_r* = sum_s M_rs u_s' + ..."""
    T = partial_rates(mechanism, q, t)
    M: Array = T.T @ kane.mass_matrix(mechanism.model, q) @ T
    return M


def _rows(mechanism: 'Mechanism', q: Array, t: float) -> tuple[Array, Array]:
    """Return J, (m, n_q), and b, (m,), of the independent constraint rows, J q' = b."""
    rows = mechanism.rows(mechanism.state(q, t))
    return _numbers(rows.J[mechanism.kept]), _numbers(rows.b[mechanism.kept])


def _numbers(values: Matrix) -> Array:
    """Return an array of scalars as floats."""
    return np.array(values, dtype=np.float64)
