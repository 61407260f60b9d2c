"""
Energy formulation with chosen speeds and constraints: an independent reference.

On numbers. Two formulations give F~_r* of an independent speed u_r. Both use the kinetic
energy of the unconstrained system, since substituting the constraints into it gives
wrong equations. The first is that of Passerello and Huston:

    F~_r* = - sum_s ( d/dt dKE/dq_s' - dKE/dq_s ) ( W_sr + sum_k W_sk A_kr )

with k over the dependent speeds.

The second is `hamilton`. Both take the same inputs as `equations` and `nonholonomic`
(model, speeds, constraints) and share no computation with them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from admissible_motion import admissible, AdmissibleMotion
import energies
from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
import numpy as np

Wrenches = Mapping[str, tuple[Any, Any]]


class EnergyFormulation(Protocol):
    """Interface of a formulation of generalized forces for given variations of q."""

    def inertia_force(self, motion: AdmissibleMotion, variations: Array) -> Array:
        """Return F*, (k,), for the columns of `variations`, (n_q, k)."""

    def conservative_force(self, motion: AdmissibleMotion, variations: Array) -> Array:
        """Return the generalized active force, (k,), of gravity and springs."""


class PasserelloHuston:
    """Generalized forces by Lagrange's derivatives of the energies."""

    def inertia_force(self, motion: AdmissibleMotion, variations: Array) -> Array:
        """Return F*, (k,), for the columns of `variations`, (n_q, k)."""
        return variations.T @ energies.generalized_inertia_force(
            motion.state.model, motion.q, motion.qdot, motion.qddot)

    def conservative_force(self, motion: AdmissibleMotion, variations: Array) -> Array:
        """Return the generalized active force, (k,), of gravity and springs."""
        return variations.T @ energies.conservative_force(motion.state.model, motion.q)


@dataclass(frozen=True, eq=False)
class EnergyForm:
    """
    Equations of motion of a mechanism from energies, M u' + bias = tau + external.

    Parameters
    ----------
    mechanism : Mechanism
        Model, speeds, constraints and the choice of independent ones
        (`independent_speeds.choose_independent`).
    form : EnergyFormulation
        `PasserelloHuston` or `hamilton.HamiltonByVariations`.
    friction : bool
        Whether to include damping and Coulomb friction.

    """

    mechanism: Mechanism
    form: EnergyFormulation
    friction: bool = True

    def inverse_dynamics(self, q: Array, u: Array, udot: Array, t: float = 0.0, *,
                         wrenches: Wrenches | None = None,
                         loads: Array | None = None) -> Array:
        """
        Return tau, (n,), dual to u, such that F~_r + F~_r* = 0.

        Parameters
        ----------
        q : (n_q,) array
            Coordinates, rad or m.
        u, udot : (n,) arrays
            Independent speeds and their rates.
        t : float
            s.
        wrenches : mapping of frame name to (force, moment), optional
            External wrench at the frame's origin, world axes, N and N m.
        loads : (n_q,) array, optional
            Loads of the drives, on which friction may depend; none by default.

        """
        motion = admissible(self.mechanism, q, u, udot, t)
        return self._residual_force(motion, motion.variations, wrenches, loads)

    def forward_dynamics(self, q: Array, u: Array, tau: Array, t: float = 0.0, *,
                         wrenches: Wrenches | None = None) -> Array:
        """Return udot, (n,), for a tau dual to u; as `inverse_dynamics`."""
        motion = admissible(self.mechanism, q, u, np.zeros(len(u)), t)
        return self._udot(motion, tau, wrenches)

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return the mass matrix, (n, n)."""
        rest = np.zeros(self.mechanism.n)
        return self._mass_matrix(admissible(self.mechanism, q, rest, rest, t))

    def joint_constraint_force(self, q: Array, u: Array, joint_torques: Array,
                               t: float = 0.0, *,
                               wrenches: Wrenches | None = None) -> Array:
        """
        Return the sum of all constraint forces on the joints, (n_q,), N m or N.

        Parameters
        ----------
        q : (n_q,) array
            Coordinates, rad or m.
        u : (n,) array
            Independent speeds.
        joint_torques : (n_q,) array
            Torques of the actuators, which determine the accelerations.
        t : float
            s.
        wrenches : mapping of frame name to (force, moment), optional
            As for `inverse_dynamics`.

        """
        motion = admissible(self.mechanism, q, u, np.zeros(len(u)), t)
        return self._constraint_force(motion, joint_torques, wrenches)

    def constraint_forces(self, q: Array, u: Array, joint_torques: Array,
                          t: float = 0.0, *, wrenches: Wrenches | None = None) -> Array:
        """
        Return the Lagrange multipliers lambda of all constraint rows, (m,).

        They are 0 for dependent rows. J^T lambda is the `joint_constraint_force`, which
        has the same arguments.
        """
        motion = admissible(self.mechanism, q, u, np.zeros(len(u)), t)
        force = self._constraint_force(motion, joint_torques, wrenches)
        result = np.zeros(len(self.mechanism.labels))
        # J^T lambda = force has one solution: the rows are independent.
        result[self.mechanism.kept] = np.linalg.lstsq(motion.J.T, force, rcond=None)[0]
        return result

    def _constraint_force(self, motion: AdmissibleMotion, joint_torques: Array,
                          wrenches: Wrenches | None) -> Array:
        """Return the constraint force on the joints from the motion at udot = 0."""
        udot = self._udot(motion, motion.variations.T @ joint_torques, wrenches)
        coordinates = np.eye(len(joint_torques))  # varied one by one, across constraints
        accelerated = motion.accelerated(udot)
        return self._residual_force(accelerated, coordinates, wrenches) - joint_torques

    def _udot(self, motion: AdmissibleMotion, tau: Array,
              wrenches: Wrenches | None) -> Array:
        """Return udot, (n,), from the motion at udot = 0."""
        bias = self._residual_force(motion, motion.variations, wrenches)
        M = self._mass_matrix(motion)
        udot: Array = np.linalg.solve(M, tau - bias).astype(np.float64)
        return udot

    def _mass_matrix(self, motion: AdmissibleMotion) -> Array:
        """Return the mass matrix, (n, n), from the motion at udot = 0."""
        def inertia_force(moving: AdmissibleMotion) -> Array:
            return self.form.inertia_force(moving, moving.variations)
        at_rest = inertia_force(motion)
        columns = []
        for unit in np.eye(len(at_rest)):  # F* is linear in udot
            columns.append(at_rest - inertia_force(motion.accelerated(unit)))
        return np.stack(columns, axis=1)

    def _residual_force(self, motion: AdmissibleMotion, variations: Array,
                        wrenches: Wrenches | None, loads: Array | None = None) -> Array:
        """Return -(F + F*), (k,), for variations of the coordinates, (n_q, k)."""
        # Inertia and conservative forces from the energies;
        # friction and wrenches by their work.
        force = (self.form.inertia_force(motion, variations)
                 + self.form.conservative_force(motion, variations))
        if self.friction:
            friction = energies.friction_force(motion.state.model, motion.qdot, loads)
            force = force + variations.T @ friction
        if wrenches is not None:
            for frame, (force_at_frame, moment) in wrenches.items():
                # The work of a wrench in the possible motions of its frame.
                R, p = motion.state.pose(frame)
                possible = motion.state.possible_motion(R, p).along(variations)
                force = force + possible.displacement @ force_at_frame
                force = force + possible.rotation @ moment
        return -force
