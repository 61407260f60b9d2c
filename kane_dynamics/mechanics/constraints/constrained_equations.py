"""
The equations of motion in chosen speeds and under constraints, over any scalar.

`TreeEquations` computes the joint forces f(q, q', q'') of a tree (RNEA). With the joint motion
from `mechanism`, q' = T u + ..., Kane's method gives:

    tau = T^T f,    M = T^T M_q T,    constraint forces = N^T (f - joint torques)

T^T f is F~_r + F~_r* with the sign changed: forces without work in an admissible motion cancel.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.algebra.dual import moving, rates
from kane_dynamics.mechanics.algebra.ltdl import factorize, inverse, solve
from kane_dynamics.mechanics.ball_joints import coordinate_rates
from kane_dynamics.mechanics.constraints.conditioning import guarded
from kane_dynamics.mechanics.constraints.constrained_kinematics import ConstrainedKinematics
from kane_dynamics.mechanics.constraints.mechanism import JointMotion, Mechanism
from kane_dynamics.mechanics.constraints.mechanism_state import ReleasedJointState
from kane_dynamics.mechanics.constraints.redundant_forces import shared_forces
from kane_dynamics.mechanics.constraints.transmission import transmission_margin
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
import numpy as np


class ConstrainedEquations(ConstrainedKinematics):
    """
    The equations of motion of a mechanism.

    Parameters
    ----------
    tree : TreeEquations
        Of the same model, in joint rates and without constraints.
    mechanism : Mechanism
    actuated : sequence of str or mapping of str to float, optional
        Names of the joints that have actuators; the torques have minimum norm, or with a mapping
        the least sum of weight times torque squared. By default tau acts as the forces dual to
        the independent speeds.
    redundant : one of `redundant_forces.SHARING`
        Distribution of the forces of redundant rows.

    Raises
    ------
    ConstraintError
        No such joint, fewer actuators than independent speeds, or a weight that is not positive.

    Notes
    -----
    Methods are those of `TreeEquations` with q (n_q,), the independent speeds u (n,), and the time
    t, s, as an additional argument.

    """

    def __init__(self, tree: TreeEquations, mechanism: Mechanism,
                 actuated: Sequence[str] | Mapping[str, float] | None = None,
                 redundant: str = 'minimum_norm') -> None:
        """Check the actuated joints and store the parts."""
        super().__init__(tree, mechanism)
        self._redundant = redundant
        self.actuated = None if actuated is None else self._actuated_coordinates(actuated)
        self._ease = None if self.actuated is None or not isinstance(actuated, Mapping) else (
            1.0 / np.array([actuated[self.model.joint_names[k]] for k in self.actuated]))

    def _actuated_coordinates(self, joints: Sequence[str] | Mapping[str, float]) -> list[int]:
        """Return the indices of the actuated coordinates, or raise ConstraintError."""
        names = self.model.joint_names
        for joint in joints:
            if joint not in names:
                raise ConstraintError(f"actuated: '{joint}'; expected one of "
                                      f'{", ".join(names)}')
            weight = joints[joint] if isinstance(joints, Mapping) else 1.0
            if not 0.0 < weight < np.inf:
                raise ConstraintError(f"actuated: weight {weight} of '{joint}'; expected a "
                                      'positive, finite number')
        places = sorted({names.index(joint) for joint in joints})
        if len(places) < self.n:
            raise ConstraintError(f'actuated: {len(places)} joints; expected at least {self.n}, '
                                  'the number of independent speeds '
                                  f'({", ".join(self.speed_names)})')
        return places

    def inverse_dynamics(self, q: Any, u: Any, udot: Any, wrench: Any, parameters: Any,
                         t: Any = 0.0) -> Any:
        """Return tau = M udot + bias - external, (n,), dual to u."""
        motion = self.joint_motion(q, u, udot, t)
        return motion.T.T @ self._joint_forces(q, motion, wrench, parameters)

    def _joint_forces(self, q: Any, motion: JointMotion, wrench: Any, parameters: Any) -> Any:
        """Return the joint forces of the tree for a motion, (n_q,)."""
        return self.tree.inverse_dynamics(q, motion.qdot, motion.qddot, wrench, parameters)

    def bias_force(self, q: Any, u: Any, parameters: Any, t: Any = 0.0) -> Any:
        """Return the bias force h(q, u), (n,): tau at udot = 0 without external wrenches."""
        return self.inverse_dynamics(q, u, self.zeros, None, parameters, t)

    def coriolis_matrix(self, q: Any, u: Any, parameters: Any, t: Any = 0.0) -> Any:
        """
        Return the Coriolis matrix C = T^T (C_q T + M_q dT/dt), (n, n).

        It follows from q' = T u + x and q'' = T u' + T' u + x', of which C u has the terms in u;
        dM/dt = C + C^T, since M = T^T M_q T.
        """
        motion = self.joint_motion(q, u, self.zeros, t)
        return motion.T.T @ (self.tree.coriolis_matrix(q, motion.qdot, parameters) @ motion.T
                             + self.tree.mass_matrix(q, parameters) @ motion.T_rate)

    def gravity_force(self, q: Any, parameters: Any, t: Any = 0.0) -> Any:
        """Return the tau that balances gravity alone, (n,)."""
        return self.at_rest(q, t).T.T @ self.tree.gravity_force(q, parameters)

    def external_force(self, q: Any, wrench: Any, t: Any = 0.0) -> Any:
        """Return the generalized force of wrenches (k, 6) at the declared frames, (n,)."""
        return self.at_rest(q, t).T.T @ self.tree.external_force(q, wrench)

    def mass_matrix(self, q: Any, parameters: Any, t: Any = 0.0) -> Any:
        """Return M = T^T M_q T, (n, n)."""
        return congruent(self.tree.mass_matrix(q, parameters), self.at_rest(q, t).T)

    def momentum_terms(self, q: Any, u: Any, parameters: Any, t: Any = 0.0) -> Any:
        """
        Return the momenta p of the independent speeds and beta, (2, n).

        With q' = T u + X: p = T^T M_q q', and p' = tau + external - beta,
        beta = T^T (h_q - dM_q/dt q') - (dT/dt)^T M_q q', where h_q is the tree's bias force.
        """
        motion = self.joint_motion(q, u, self.zeros, t)
        tree, qdot = self.tree, motion.qdot
        momentum = tree.mass_matrix(q, parameters) @ qdot
        C = tree.coriolis_matrix(q, qdot, parameters)
        held = tree.bias_force(q, qdot, parameters) - (C @ qdot + qdot @ C)
        return np.array([motion.T.T @ momentum, motion.T.T @ held - motion.T_rate.T @ momentum])

    def inverse_mass_matrix(self, q: Any, parameters: Any, t: Any = 0.0) -> Any:
        """Return M^-1, (n, n)."""
        order = list(range(self.n))
        M = self.mass_matrix(q, parameters, t)
        return inverse(factorize(M, order, self._watched_pivots), order)

    @property
    def _watched_pivots(self) -> range:
        """Return the independent speeds, if some joint may move without kinetic energy."""
        return range(self.n if self.tree.without_own_inertia else 0)

    def state_rates(self, q: Any, u: Any, tau: Any, wrench: Any, parameters: Any,
                    t: Any = 0.0) -> Any:
        """Return q' then udot, (n_q + n,): the system that is integrated."""
        if self.n == self.tree.n:
            speeds, udot = self._free(q, u, tau, wrench, parameters, t)
        else:
            motion, _, udot = self._forward(q, u, tau, wrench, parameters, t)
            speeds = motion.qdot
        return np.concatenate([coordinate_rates(self.model, q, speeds), udot])

    def _forward(self, q: Any, u: Any, tau: Any, wrench: Any, parameters: Any,
                 t: Any) -> tuple[JointMotion, Any, Any]:
        """Return the motion at udot = 0, the joint forces of the actual motion, and udot."""
        motion = self.joint_motion(q, u, self.zeros, t)
        held = self._joint_forces(q, motion, wrench, parameters)
        M_q = self.tree.mass_matrix(q, parameters)
        order = list(range(self.n))
        factors = factorize(congruent(M_q, motion.T), order, self._watched_pivots)
        udot = solve(factors, order, tau - motion.T.T @ held)
        return motion, held + M_q @ (motion.T @ udot), udot

    def actual_joint_forces(self, q: Any, u: Any, tau: Any, parameters: Any,
                            t: Any = 0.0) -> Any:
        """Return the joint forces, (n_q,), of actuators and constraint forces together."""
        if self.n == self.tree.n:
            here = self.mechanism.state(q, t, self.tree.geometry)
            return here.speed_rows(self.speed_names)[0].T @ tau
        return self._forward(q, u, tau, None, parameters, t)[1]

    def forward_dynamics(self, q: Any, u: Any, tau: Any, wrench: Any, parameters: Any,
                         t: Any = 0.0) -> Any:
        """Return udot = M^-1 (tau + external - bias), (n,)."""
        if self.n == self.tree.n:
            return self._free(q, u, tau, wrench, parameters, t)[1]
        return self._forward(q, u, tau, wrench, parameters, t)[2]

    def _free(self, q: Any, u: Any, tau: Any, wrench: Any, parameters: Any,
              t: Any) -> tuple[Any, Any]:
        """Return the joints' rates and udot without constraints, by the tree's dynamics."""
        Y, negative_Z = self.mechanism.system(self.mechanism.state(q, t, self.tree.geometry))
        if self.mechanism.speeds.definite:
            order = self.tree.order
            qdot = solve(factorize(Y, order), order, u + negative_Z)
        else:
            qdot = self.mechanism.solved(Y, u + negative_Z)
        qddot = self.tree.forward_dynamics(q, qdot, Y.T @ tau, wrench, parameters)
        Y_moving, negative_Z_moving = self.mechanism.system(self.mechanism.state(
            moving(q, coordinate_rates(self.model, q, qdot)), moving(t, 1.0),
            self.tree.geometry))
        return qdot, Y @ qddot + rates(Y_moving) @ qdot - rates(negative_Z_moving)

    def friction_force(self, u: Any, q: Any, t: Any = 0.0) -> Any:
        """Return the friction of all joints, (n,), dual to u."""
        motion = self.joint_motion(q, u, self.zeros, t)
        return motion.T.T @ self.tree.friction_force(motion.qdot)

    def joint_torques(self, tau: Any, q: Any, t: Any = 0.0) -> Any:
        """Return joint torques, (n_q,), with the generalized force tau; NaN if unactuated."""
        found = self.shared_torques(q, tau, t)
        if self.actuated is None:
            return found
        return guarded(found, transmission_margin(self.mechanism, self.at_rest(q, t).T,
                                                  self.actuated))

    def generalized_force(self, q: Any, joint_torques: Any, t: Any = 0.0) -> Any:
        """Return the generalized force of joint torques (n_q,), (n,)."""
        return self.at_rest(q, t).T.T @ joint_torques

    def shared_torques(self, q: Any, tau: Any, t: Any) -> Any:
        """Return `joint_torques` without a check of the configuration."""
        if self.actuated is None:  # Y_I T = 1, Y_I N = 0: gives tau without constraint forces
            here = self.mechanism.state(q, t, self.tree.geometry)
            return here.speed_rows(self.speed_names)[0].T @ tau
        T = self.at_rest(q, t).T[self.actuated]
        order = list(range(self.n))
        ease = np.ones(len(T)) if self._ease is None else self._ease
        share = solve(factorize(congruent(np.diag(ease), T), order), order, tau)
        torques = np.zeros(self.tree.n).astype(object)
        torques[self.actuated] = ease * (T @ share)
        return torques

    def constraint_forces(self, q: Any, u: Any, tau: Any, wrench: Any, parameters: Any,
                          t: Any = 0.0) -> Any:
        """Return the force of every constraint row, (m,); redundant rows as `redundant`."""
        motion, force, _ = self._forward(q, u, tau, wrench, parameters, t)
        return self._shared(q, t, motion.N, force - self.shared_torques(q, tau, t))

    def constraint_forces_of_motion(self, q: Any, u: Any, udot: Any, applied: Any,
                                    parameters: Any, t: Any = 0.0) -> Any:
        """
        Return the force of every constraint row, (m,), in a motion under given joint forces.

        `applied`, (n_j,), are the forces of actuators, stops and others on the joints.
        """
        motion = self.joint_motion(q, u, udot, t)
        force = self._joint_forces(q, motion, None, parameters)
        return self._shared(q, t, motion.N, force - applied)

    def _shared(self, q: Any, t: Any, N: Any, missing: Any) -> Any:
        """Return the forces of all rows, (m,), for given constraint forces of the joints."""
        rows = self.mechanism.rows(self.mechanism.state(q, t, self.tree.geometry))
        return shared_forces(self.mechanism, rows.J, N, N.T @ missing, self._redundant)

    def joint_reaction(self, body: int, q: Any, u: Any, udot: Any, wrench: Any, parameters: Any,
                       t: Any = 0.0) -> Any:
        """Return the joint reaction of the body with index `body`, (6,)."""
        return self.joint_reactions(q, u, udot, wrench, parameters, t)[body]

    def joint_reactions(self, q: Any, u: Any, udot: Any, wrench: Any, parameters: Any,
                        t: Any = 0.0) -> Any:
        """Return the wrench of parent on child at each body's joint, (n_bodies, 6), world axes."""
        motion = self.joint_motion(q, u, udot, t)
        force = self._joint_forces(q, motion, wrench, parameters)
        applied = self.shared_torques(q, motion.T.T @ force, t)
        held = self._shared(q, t, motion.N, force - applied)
        here = self.mechanism.state(q, t, self.tree.geometry)
        of_tree = self.tree.joint_reactions(q, motion.qdot, motion.qddot, wrench, parameters)
        result = []
        for body, (origin, whole) in enumerate(zip(self.tree.joint_origins(q), of_tree)):
            rows = self.mechanism.rows(ReleasedJointState(here, body, origin))
            result.append(whole - rows.J.T @ held)
        return np.array(result)

    def torque_terms(self, q: Any, u: Any, udot: Any, parameters: Any, t: Any = 0.0) -> Any:
        """Return inverse dynamics by source, (5, n), rows as `TORQUE_TERMS`."""
        motion = self.joint_motion(q, u, self.zeros, t)
        carried, coriolis, *others = self.tree.torque_terms(q, motion.qdot, motion.qddot,
                                                            parameters)
        inertia = congruent(self.tree.mass_matrix(q, parameters), motion.T) @ udot
        return np.stack([inertia, *(motion.T.T @ x for x in (carried + coriolis, *others))])

    def body_torques(self, q: Any, u: Any, udot: Any, parameters: Any, t: Any = 0.0) -> Any:
        """Return the contribution of each body to tau, (n_bodies, n)."""
        motion = self.joint_motion(q, u, udot, t)
        return self.tree.body_torques(q, motion.qdot, motion.qddot, parameters) @ motion.T

    def regressor(self, q: Any, u: Any, udot: Any, parameters: Any, t: Any = 0.0) -> Any:
        """Return the regressor Y, (n, 10 n_bodies): the rigid-body part of tau is Y theta."""
        motion = self.joint_motion(q, u, udot, t)
        return motion.T.T @ self.tree.regressor(q, motion.qdot, motion.qddot, parameters)

    def kinetic_energy(self, q: Any, u: Any, parameters: Any, t: Any = 0.0) -> Any:
        """Return the kinetic energy, J."""
        return self.tree.kinetic_energy(q, self.joint_speeds(q, u, t), parameters)

    def potential_energy(self, q: Any, parameters: Any, t: Any = 0.0) -> Any:
        """Return the potential energy of gravity and springs, J."""
        return self.tree.potential_energy(q, parameters)

    def center_of_mass(self, q: Any, parameters: Any, t: Any = 0.0) -> Any:
        """Return the center of mass of the moving bodies and the payload, (3,), m."""
        return self.tree.center_of_mass(q, parameters)

    def center_of_mass_jacobian(self, q: Any, parameters: Any, t: Any = 0.0) -> Any:
        """Return the velocity of the center of mass per unit of each independent speed, (3, n)."""
        return self.tree.center_of_mass_jacobian(q, parameters) @ self.at_rest(q, t).T


def congruent(M: Any, T: Any) -> Any:
    """Return T^T M T for a symmetric M, exactly symmetric: equal expressions."""
    half = M @ T
    n = T.shape[1]
    upper = {(r, s): T[:, r] @ half[:, s] for r in range(n) for s in range(r, n)}
    return np.array([[upper[min(r, s), max(r, s)] for s in range(n)] for r in range(n)])
