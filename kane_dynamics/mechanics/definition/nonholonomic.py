"""
Reference formulation of Kane's equations with constraints: F~_r + F~_r* = 0 for r = 1..p.

The reference for `equations`, on numbers. With q' = W u + X and u_D = A u_I + B,

    F~_r = F_r + sum_s F_s A_sr,    F~_r* likewise,    u_D' = A u_I' + A' u_I + B'

(Kane & Levinson, chapter 4; F_r and F_r* are the sums of `kane`.)
"""

from dataclasses import dataclass
from typing import Any, TYPE_CHECKING

from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.algebra.dual import moving, rates
from kane_dynamics.mechanics.ball_joints import coordinate_rates
from kane_dynamics.mechanics.definition import kane
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
    """Return W, X, A and B as numbers."""
    here = mechanism.state(q, t)
    Y, Z = _numbers(*mechanism.speeds.of(q, t))
    rows = mechanism.rows(here)
    J, b = _numbers(rows.J[mechanism.kept], rows.b[mechanism.kept])
    W, = _numbers(np.linalg.inv(Y))
    C, free, dependent = J @ W, mechanism.free, dependent_places(mechanism)
    A, B = _numbers(-np.linalg.solve(C[:, dependent], C[:, free]),
                    np.linalg.solve(C[:, dependent], b + C @ Z))
    return Reduction(W, -W @ Z, A, B)


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
    parts = reduction(mechanism, q, t)
    free, dependent = mechanism.free, dependent_places(mechanism)
    qdot = parts.W @ all_speeds(mechanism, parts, u) + parts.X
    q_moving = moving(q, coordinate_rates(mechanism.model, q, qdot))
    t_moving = moving(t, 1.0)
    Y_rate, Z_rate = _numbers(*(rates(x) for x in mechanism.speeds.of(q_moving, t_moving)))
    rows = mechanism.rows(mechanism.state(q_moving, t_moving))
    J_rate, b_rate = _numbers(rates(rows.J[mechanism.kept]), rates(rows.b[mechanism.kept]))
    J = _numbers(mechanism.rows(mechanism.state(q, t)).J[mechanism.kept])[0]
    _, Z = _numbers(*mechanism.speeds.of(q, t))
    C = J @ parts.W
    C_rate = J_rate @ parts.W - C @ Y_rate @ parts.W
    A_rate = -np.linalg.solve(C[:, dependent], C_rate[:, free] + C_rate[:, dependent] @ parts.A)
    B_rate = np.linalg.solve(C[:, dependent], b_rate + C_rate @ Z + C @ Z_rate
                             - C_rate[:, dependent] @ parts.B)
    u_rate = np.empty(mechanism.model.n)
    u_rate[free] = udot
    u_rate[dependent] = parts.A @ udot + A_rate @ u + B_rate
    return qdot, parts.W @ (u_rate - Y_rate @ qdot - Z_rate)


def reduced(mechanism: 'Mechanism', q: Array, force: Array, t: float = 0.0) -> Array:
    """
    Return the nonholonomic generalized forces F~_r, (n,), from joint forces, (n_q,).

    F_r of the chosen speeds is W^T times the joint force.
    """
    parts = reduction(mechanism, q, t)
    of_speeds = parts.W.T @ force
    return (of_speeds[mechanism.free]
            + parts.A.T @ of_speeds[dependent_places(mechanism)])


def inverse_dynamics(mechanism: 'Mechanism', q: Array, u: Array, udot: Array, t: float = 0.0,
                     **forces: Any) -> Array:
    """Return tau, (n,), such that F~_r + F~_r* = 0; `forces` as in `kane`."""
    qdot, qddot = joint_motion(mechanism, q, u, udot, t)
    active = kane.generalized_active_force(mechanism.model, q, qdot, **forces)
    inertia = kane.generalized_inertia_force(mechanism.model, q, qdot, qddot)
    return -(reduced(mechanism, q, active, t) + reduced(mechanism, q, inertia, t))


def mass_matrix(mechanism: 'Mechanism', q: Array, t: float = 0.0) -> Array:
    """Return M of the independent speeds, (n, n): F~_r* is linear in u', with this coefficient."""
    parts = reduction(mechanism, q, t)
    T = (parts.W[:, mechanism.free]
         + parts.W[:, dependent_places(mechanism)] @ parts.A)
    M: Array = T.T @ kane.mass_matrix(mechanism.model, q) @ T
    return M


def _numbers(*values: Any) -> tuple[Array, ...]:
    return tuple(np.array(x, dtype=np.float64) for x in values)
