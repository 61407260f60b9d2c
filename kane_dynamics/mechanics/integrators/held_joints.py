"""
Equations of motion in which forces hold some joints, over any scalar.

With q' = T u + X, and the rows s of the joints that are held:

    M u' = tau + external - bias + T_s^T f,    (T u' + T' u + X')_s = 0

Which of the candidates are held are conditions, so one program serves every set of them.
"""

from collections.abc import Callable
from typing import NamedTuple

from kane_dynamics._util.typing import Matrix, Scalar, Vector
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

    T: Matrix | None
    v: Vector
    drift: Vector
    M: Matrix
    net: Vector
    order: list[int]


class Held(NamedTuple):
    """
    Joints that may be held, and which of them are.

    `joints` are their indices among the speeds of the joints; `conditions` are
    comparisons.
    """

    joints: list[int]
    conditions: list[Scalar]


class Solution(NamedTuple):
    """
    Accelerations w, (n,), and what holds k joints.

    The forces on the joints, (k,), zero for those that are not held; the accelerations
    of the joints, (k,), zero for those that are; and the forces in the space of the
    speeds, T_s^T f.
    """

    w: Vector
    f: Vector
    accelerations: Vector
    generalized: Vector


Solver = Callable[[LinearSystem, Matrix, Vector], Solution]


def linear_system(equations: Equations, q: Vector, u: Vector, tau: Vector,
                  wrench: Matrix | None, parameters: Vector, t: Scalar = 0.0,
                  directions: Vector | None = None,
                  deflections: Vector | None = None) -> LinearSystem:
    """
    Return the equations of motion of a state; arguments as of `forward_dynamics`.

    `directions`, (n_j,), are those of sliding and `deflections`, (n_b,), those of
    bristles, as of `TreeEquations.friction_force`.
    """
    tree = equations.tree
    smooth = directions is None and deflections is None
    if equations.in_joint_rates:
        # Loads of drives depend on tau, and directions of sliding on the state: their
        # friction is added to the forces of the bodies.
        if equations.carries_loads or not smooth:
            rigid = equations.rigid_dynamics(q, u, equations.zeros, wrench, parameters)
            bias = rigid + equations.driven_friction(q, u, tau, t, directions,
                                                     deflections)
        else:
            bias = equations.inverse_dynamics(q, u, equations.zeros, wrench, parameters)
        M = equations.mass_matrix(q, parameters)
        return LinearSystem(None, u, equations.zeros, M, tau - bias, tree.order)

    # Chosen speeds or constraints: the terms of the tree at u' = 0, projected by T.
    motion = equations.joint_motion(q, u, equations.zeros, t)
    if equations.carries_loads or not smooth:
        rigid = tree.rigid_dynamics(q, motion.qdot, motion.qddot, wrench, parameters)
        bias = rigid + equations.driven_friction(q, motion.qdot, tau, t, directions,
                                                 deflections)
    else:
        bias = tree.inverse_dynamics(q, motion.qdot, motion.qddot, wrench, parameters)
    M = congruent(tree.mass_matrix(q, parameters), motion.T)
    net = tau - motion.T.T @ bias
    return LinearSystem(motion.T, motion.qdot, motion.qddot, M, net,
                        list(range(equations.n)))


def held_solution(system: LinearSystem, M: Matrix, force: Vector,
                  held: 'Held | Solver') -> Solution:
    """Return the solution of M w = force + T_s^T f with a f that holds joints."""
    if not isinstance(held, Held):  # rows of more kinds, as `rows.row_solution`
        return held(system, M, force)
    # With nothing held, w = M^-1 force, and no force f.
    if not held.joints:
        nothing = np.zeros(0)
        w = solve(factorize(M, system.order), system.order, force)
        return Solution(w, nothing, nothing, 0.0 * force)
    if system.T is None:
        return _held_tree(system, M, force, held)
    return _held_mechanism(system.T, system, M, force, held)


def _held_tree(system: LinearSystem, M: Matrix, force: Vector, held: Held) -> Solution:
    """Return `held_solution` where T = 1: held joints have rows of the unit matrix."""
    joints, conditions = held
    order = system.order
    condition_of = dict(zip(joints, conditions))
    n = len(force)

    # u' of a held joint is exactly zero, and its row and column take no part.
    masked = np.empty((n, n), dtype=object)
    for i in range(n):
        for j in range(n):
            masked[i, j] = _unless(condition_of, (i, j), M[i, j], float(i == j))
    factors = factorize(masked, order)
    masked_force = [_unless(condition_of, (i,), force[i], 0.0) for i in range(n)]
    w = solve(factors, order, np.array(masked_force))

    # The force on a held joint is what its row of M w = force lacks.
    forces = []
    for joint, condition in condition_of.items():
        forces.append(select(condition, M[joint] @ w - force[joint], 0.0))
    f = np.array(forces)
    return Solution(w, f, w[joints], np.eye(n)[joints].T @ f)


def _held_mechanism(T: Matrix, system: LinearSystem, M: Matrix, force: Vector,
                    held: Held) -> Solution:
    """Return `held_solution` for any T: f follows from the accelerations without it."""
    joints, conditions = held
    order = system.order
    factors = factorize(M, order)
    T_s = T[joints]

    # Accelerations without f, and those due to a unit of each force.
    w_free = solve(factors, order, force)
    w_of_unit = np.stack([solve(factors, order, row) for row in T_s], axis=1)
    a = T_s @ w_free + system.drift[joints]

    # T_s w_of_unit f = -a for the held joints.
    f = -held_response(T_s @ w_of_unit, conditions, a)
    w_of_f = w_of_unit @ f
    w = w_free + w_of_f
    joint_accelerations = a + T_s @ w_of_f
    accelerations = [select(condition, 0.0, acceleration)
                     for condition, acceleration in zip(conditions, joint_accelerations)]
    return Solution(w, f, np.array(accelerations), T_s.T @ f)


def held_response(A: Matrix, conditions: list[Scalar], motion: Vector) -> Vector:
    """
    Return the forces or impulses f, (k,), with A f = motion for the held joints.

    The others have none. Where the constraints couple joints, they share with the least
    sum of squares: A is made regular. One step of refinement then takes out the error of
    that for joints that respond far less than others, such as heavy ones.
    """
    # The trace over the held joints is the scale of their response. It is zero where
    # constraints lock all of them: no force moves them, and none is needed.
    trace: Scalar = 0.0
    for condition, row, i in zip(conditions, A, range(len(conditions))):
        trace = trace + select(condition, row[i], 0.0)
    trace = select(trace > 0.0, trace, 1.0)
    regular = A + REGULAR * trace * np.eye(len(conditions))
    f = masked_solution(regular, conditions, motion)
    return f + masked_solution(regular, conditions, motion - A @ f)


def masked_solution(A: Matrix, conditions: list[Scalar], motion: Vector) -> Vector:
    """Return f, (k,), with A f = motion for the rows whose condition holds, zero of others."""
    k = len(conditions)

    # Rows and columns without condition are those of the unit matrix.
    masked = np.empty((k, k), dtype=object)
    for i in range(k):
        for j in range(k):
            entry = select(conditions[j], A[i, j], 0.0)
            masked[i, j] = select(conditions[i], entry, float(i == j))
    force = [select(condition, x, 0.0) for condition, x in zip(conditions, motion)]
    order = list(range(k))
    return solve(factorize(masked, order), order, np.array(force))


def _unless(condition_of: dict[int, Scalar], rows: tuple[int, ...], value: Scalar,
            otherwise: float) -> Scalar:
    """Return a value, or another one if one of the rows is that of a held joint."""
    for row in rows:
        if row in condition_of:
            value = select(condition_of[row], otherwise, value)
    return value
