"""
The equations of motion in chosen speeds and under constraints, over any scalar.

`Equations` gives the joint forces f(q, q', q'') that a tree's motion takes. With the joints'
motion from `mechanism`, q' = T u + ..., Kane's method needs nothing else:

    tau = T^T f,    M = T^T M_q T,    constraint forces = N^T (f - joint torques)

T^T f is F~_r + F~_r* with the sign changed: what does no work in an admissible motion drops out.
"""

from typing import Any

from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.mechanics.factorization import factorize, solve
from kane_dynamics.mechanics.mechanism import JointMotion, Mechanism
import numpy as np


class ConstrainedEquations:
    """
    The equations of motion of a mechanism.

    Parameters
    ----------
    tree : Equations
        Of the same model, in joint rates and without constraints.
    mechanism : Mechanism

    Notes
    -----
    Methods are those of `Equations` with q (n_q,) and the independent speeds u (n,), and take the
    time t besides.

    """

    def __init__(self, tree: Equations, mechanism: Mechanism) -> None:
        """Keep both."""
        self.tree = tree
        self.mechanism = mechanism
        self.n = mechanism.n

    def joint_motion(self, q: Any, u: Any, udot: Any, t: Any) -> JointMotion:
        """Return the joints' motion."""
        return self.mechanism.joint_motion(q, u, udot, t, self.tree.geometry)

    def at_rest(self, q: Any, t: Any) -> JointMotion:
        """Return the joints' motion at u = udot = 0, for what depends on T and N alone."""
        rest = np.zeros(self.n).astype(object)
        return self.joint_motion(q, rest, rest, t)

    def inverse_dynamics(self, q: Any, u: Any, udot: Any, wrench: Any, parameters: Any,
                         t: Any) -> Any:
        """Return tau = M udot + bias - external, (n,), dual to u."""
        motion = self.joint_motion(q, u, udot, t)
        return motion.T.T @ self.tree.inverse_dynamics(q, motion.qdot, motion.qddot, wrench,
                                                       parameters)

    def bias_force(self, q: Any, u: Any, parameters: Any, t: Any) -> Any:
        """Return what tau must hold at udot = 0, external wrenches apart, (n,)."""
        return self.inverse_dynamics(q, u, np.zeros(self.n).astype(object), None, parameters, t)

    def gravity_force(self, q: Any, parameters: Any, t: Any) -> Any:
        """Return the tau that holds gravity alone, (n,)."""
        return self.at_rest(q, t).T.T @ self.tree.gravity_force(q, parameters)

    def mass_matrix(self, q: Any, parameters: Any, t: Any) -> Any:
        """Return M = T^T M_q T, (n, n)."""
        return congruent(self.tree.mass_matrix(q, parameters), self.at_rest(q, t).T)

    def state_rates(self, q: Any, u: Any, tau: Any, wrench: Any, parameters: Any, t: Any) -> Any:
        """Return q' then udot, (n_q + n,): the system that is integrated."""
        motion = self.joint_motion(q, u, np.zeros(self.n).astype(object), t)
        held = self.tree.inverse_dynamics(q, motion.qdot, motion.qddot, wrench, parameters)
        M = congruent(self.tree.mass_matrix(q, parameters), motion.T)
        order = list(range(self.n))
        udot = solve(factorize(M, order), order, tau - motion.T.T @ held)
        return np.concatenate([motion.qdot, udot])

    def forward_dynamics(self, q: Any, u: Any, tau: Any, wrench: Any, parameters: Any,
                         t: Any) -> Any:
        """Return udot = M^-1 (tau + external - bias), (n,)."""
        return self.state_rates(q, u, tau, wrench, parameters, t)[len(q):]

    def constraint_forces(self, q: Any, u: Any, udot: Any, wrench: Any, parameters: Any, t: Any,
                          joint_torques: Any) -> Any:
        """Return the force of every constraint row, (m,), given what the actuators do, (n_q,)."""
        motion = self.joint_motion(q, u, udot, t)
        force = self.tree.inverse_dynamics(q, motion.qdot, motion.qddot, wrench, parameters)
        kept = motion.N.T @ (force - joint_torques)
        result = np.zeros(len(self.mechanism.labels)).astype(object)
        result[self.mechanism.kept] = kept
        return result


def congruent(M: Any, T: Any) -> Any:
    """Return T^T M T for a symmetric M, its lower triangle the upper one's expressions."""
    half = M @ T
    n = T.shape[1]
    upper = {(r, s): T[:, r] @ half[:, s] for r in range(n) for s in range(r, n)}
    return np.array([[upper[min(r, s), max(r, s)] for s in range(n)] for r in range(n)])
