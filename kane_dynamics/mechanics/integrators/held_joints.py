"""
Equations of motion in which some joints are held by forces of their own, over any scalar.

With q' = T u + X, and the rows s of the joints that are held:

    M u' = tau + external - bias + T_s^T f,    (T u' + T' u + X')_s = 0

Which of the candidates are held are conditions, so one program serves every set of them.
"""

from typing import Any, NamedTuple

from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.mechanics.algebra.ltdl import factorize, solve
from kane_dynamics.mechanics.constraints.mechanism import congruent
from kane_dynamics.mechanics.equations import Equations
import numpy as np

REGULAR = 1e-12  # relative, added to the response to forces that the constraints couple


class LinearSystem(NamedTuple):
    """
    The equations M u' = net of one state, and the motion of its joints.

    T is (n_j, n) or None for the unit matrix, v the rates of the joints, and drift their
    accelerations at u' = 0, both (n_j,); `order` is that of the factorization of M.
    """

    T: Any
    v: Any
    drift: Any
    M: Any
    net: Any
    order: list[int]


class Held(NamedTuple):
    """Joints that may be held, by their indices among the speeds of the joints, and which are."""

    joints: list[int]
    conditions: list[Any]


class Solution(NamedTuple):
    """
    Accelerations w, (n,), and what holds k joints.

    The forces on the joints, (k,), zero for those that are not held; the accelerations of the
    joints, (k,), zero for those that are; and the forces in the space of the speeds, T_s^T f.
    """

    w: Any
    f: Any
    accelerations: Any
    generalized: Any


def linear_system(equations: Equations, q: Any, u: Any, tau: Any,
                  wrench: Any, parameters: Any, t: Any = 0.0) -> LinearSystem:
    """Return the equations of motion of a state; arguments as of `forward_dynamics`."""
    if equations.in_joint_rates:
        held = equations.inverse_dynamics(q, u, equations.zeros, wrench, parameters)
        return LinearSystem(None, u, equations.zeros, equations.mass_matrix(q, parameters),
                            tau - held, equations.tree.order)
    motion, tree = equations.joint_motion(q, u, equations.zeros, t), equations.tree
    held = tree.inverse_dynamics(q, motion.qdot, motion.qddot, wrench, parameters)
    M = congruent(tree.mass_matrix(q, parameters), motion.T)
    return LinearSystem(motion.T, motion.qdot, motion.qddot, M, tau - motion.T.T @ held,
                        list(range(equations.n)))


def held_solution(system: LinearSystem, M: Any, force: Any, held: Held) -> Solution:
    """Return the solution of M w = force + T_s^T f with a f that holds joints."""
    joints, conditions, order = held.joints, held.conditions, system.order
    if not joints:
        none = np.zeros(0)
        return Solution(solve(factorize(M, order), order, force), none, none, 0.0 * force)
    if system.T is None:  # u' of a held joint is exactly zero, and its row takes no part
        fixed = dict(zip(joints, conditions))
        rows = range(len(force))
        masked = [[_unless(fixed, (i, j), M[i, j], float(i == j)) for j in rows] for i in rows]
        w = solve(factorize(np.array(masked), order), order,
                  np.array([_unless(fixed, (i,), force[i], 0.0) for i in rows]))
        f = [select(c, M[j] @ w - force[j], 0.0) for j, c in fixed.items()]
        return Solution(w, np.array(f), w[joints], np.eye(len(force))[joints].T @ np.array(f))
    factors, T_s = factorize(M, order), system.T[joints]
    free = solve(factors, order, force)
    along = np.stack([solve(factors, order, row) for row in T_s], axis=1)
    a = T_s @ free + system.drift[joints]
    f = -held_response(T_s @ along, conditions, a)
    w = free + along @ f
    left = np.array([select(c, 0.0, x) for c, x in zip(conditions, a + T_s @ (along @ f))])
    return Solution(w, f, left, T_s.T @ f)


def held_response(A: Any, conditions: list[Any], motion: Any) -> Any:
    """
    Return the forces or impulses f, (k,), with A f = motion for the joints that are held.

    The others have none. Where the constraints couple joints, they share with the least sum of
    squares: A is made regular.
    """
    k = range(len(conditions))
    least = REGULAR * sum((select(conditions[i], A[i, i], 0.0) for i in k), 0.0)
    regular = np.array([[select(conditions[i], A[i, j] + least, 1.0) if i == j else
                         select(conditions[i], select(conditions[j], A[i, j], 0.0), 0.0)
                         for j in k] for i in k])
    masked = np.array([select(c, x, 0.0) for c, x in zip(conditions, motion)])
    return solve(factorize(regular, list(k)), list(k), masked)


def _unless(fixed: dict[int, Any], rows: tuple[int, ...], value: Any, otherwise: float) -> Any:
    """Return a value, or another one if one of the rows is that of a held joint."""
    for row in rows:
        if row in fixed:
            value = select(fixed[row], otherwise, value)
    return value
