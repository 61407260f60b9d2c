"""
Equations of motion in which forces hold some joints, over any scalar.

With q' = T u + X, and the rows s of the joints that are held:

    M u' = tau + external - bias + T_s^T f,    (T u' + T' u + X')_s = 0

`rows.row_solution` says which f holds rows.
"""

from collections.abc import Callable
from typing import NamedTuple

from kane_dynamics._util.typing import Matrix, Scalar, Vector
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
                  held: Solver | None = None) -> Solution:
    """Return the solution of M w = force, of `held` where forces may hold joints."""
    if held is not None:
        return held(system, M, force)
    nothing = np.zeros(0)
    w = solve(factorize(M, system.order), system.order, force)
    return Solution(w, nothing, nothing, 0.0 * force)
