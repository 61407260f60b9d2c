"""
The energy road under chosen speeds and constraints: the independent oracle, for numbers.

Two ways lead to F~_r* of an independent speed u_r, both from the kinetic energy of the
unconstrained system (what the constraints leave of it gives wrong equations). Passerello and
Huston:

    F~_r* = - sum_s ( d/dt dKE/dq_s' - dKE/dq_s ) ( W_sr + sum_k W_sk A_kr ),   k dependent

`vector_variations` is the other. Either takes the same declarations as `constrained` and
`nonholonomic` (model, speeds, constraints) and shares no computation with them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.mechanics.energy_form import energies
from kane_dynamics.mechanics.energy_form.admissible_motion import Admissible, admissible
import numpy as np

Wrenches = Mapping[str, tuple[Any, Any]]


class Form(Protocol):
    """A way from energies to generalized forces, for variations of q that are given."""

    def inertia_force(self, motion: Admissible, variations: Array) -> Array:
        """Return F*, (k,), for the columns of `variations`, (n_q, k)."""

    def conservative_force(self, motion: Admissible, variations: Array) -> Array:
        """Return the generalized active force, (k,), of gravity and springs."""


class PasserelloHuston:
    """Lagrange's derivatives of the energies by coordinates, then the chain rule."""

    def inertia_force(self, motion: Admissible, variations: Array) -> Array:
        """Return F*, (k,), for the columns of `variations`, (n_q, k)."""
        return variations.T @ energies.generalized_inertia_force(
            motion.posture.model, motion.q, motion.qdot, motion.qddot)

    def conservative_force(self, motion: Admissible, variations: Array) -> Array:
        """Return the generalized active force, (k,), of gravity and springs."""
        return variations.T @ energies.conservative_force(motion.posture.model, motion.q)


@dataclass(frozen=True, eq=False)
class EnergyForm:
    """
    The equations of motion of a mechanism by the energy road, M u' + bias = tau + external.

    Parameters
    ----------
    mechanism : Mechanism
        Model, speeds, constraints and which of them are independent (`structure.structured`).
    form : Form
        `PasserelloHuston` or `vector_variations.VectorVariations`.
    friction : bool
        Whether damping and Coulomb friction act.

    """

    mechanism: Mechanism
    form: Form
    friction: bool = True

    def inverse_dynamics(self, q: Array, u: Array, udot: Array, t: float = 0.0, *,
                         wrenches: Wrenches | None = None) -> Array:
        """
        Return the tau, (n,), dual to u, that makes F~_r + F~_r* zero.

        Parameters
        ----------
        q : (n_q,) array
            Coordinates, rad or m.
        u, udot : (n,) arrays
            Independent speeds and their rates.
        t : float
            s.
        wrenches : mapping of frame name to (force, moment), optional
            What the environment exerts at the frame's origin, world axes, N and N m.

        """
        motion = admissible(self.mechanism, q, u, udot, t)
        return self._missing(motion, motion.variations, wrenches)

    def forward_dynamics(self, q: Array, u: Array, tau: Array, t: float = 0.0, *,
                         wrenches: Wrenches | None = None) -> Array:
        """Return udot, (n,), for a tau dual to u; other arguments as for `inverse_dynamics`."""
        motion = admissible(self.mechanism, q, u, np.zeros(len(u)), t)
        return self._udot(motion, tau, wrenches)

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M, (n, n): how much tau every entry of udot takes."""
        rest = np.zeros(self.mechanism.n)
        return self._mass_matrix(admissible(self.mechanism, q, rest, rest, t))

    def joint_constraint_force(self, q: Array, u: Array, joint_torques: Array, t: float = 0.0, *,
                               wrenches: Wrenches | None = None) -> Array:
        """
        Return what all constraints together exert on the joint coordinates, (n_q,), N m or N.

        Parameters
        ----------
        q : (n_q,) array
            Coordinates, rad or m.
        u : (n,) array
            Independent speeds.
        joint_torques : (n_q,) array
            What the actuators do; the motion follows from them.
        t : float
            s.
        wrenches : mapping of frame name to (force, moment), optional
            As for `inverse_dynamics`.

        """
        motion = admissible(self.mechanism, q, u, np.zeros(len(u)), t)
        return self._constraint_force(motion, joint_torques, wrenches)

    def constraint_forces(self, q: Array, u: Array, joint_torques: Array, t: float = 0.0, *,
                          wrenches: Wrenches | None = None) -> Array:
        """
        Return Lagrange's multipliers lambda of every constraint row, (m,), 0 for dependent rows.

        J^T lambda is the `joint_constraint_force`, whose arguments these are.
        """
        motion = admissible(self.mechanism, q, u, np.zeros(len(u)), t)
        force = self._constraint_force(motion, joint_torques, wrenches)
        result = np.zeros(len(self.mechanism.labels))
        result[self.mechanism.kept] = np.linalg.lstsq(motion.J.T, force, rcond=None)[0]
        return result

    def _constraint_force(self, motion: Admissible, joint_torques: Array,
                          wrenches: Wrenches | None) -> Array:
        """Return the constraints' force on the joints, (n_q,), from the motion at udot = 0."""
        udot = self._udot(motion, motion.variations.T @ joint_torques, wrenches)
        every = np.eye(len(joint_torques))  # each coordinate alone, whatever constraints allow
        return self._missing(motion.accelerated(udot), every, wrenches) - joint_torques

    def _udot(self, motion: Admissible, tau: Array, wrenches: Wrenches | None) -> Array:
        """Return udot, (n,), from the motion at udot = 0."""
        bias = self._missing(motion, motion.variations, wrenches)
        udot: Array = np.linalg.solve(self._mass_matrix(motion), tau - bias).astype(np.float64)
        return udot

    def _mass_matrix(self, motion: Admissible) -> Array:
        """Return M, (n, n), from the motion at udot = 0."""
        def inertia_force(moving: Admissible) -> Array:
            return self.form.inertia_force(moving, moving.variations)
        start = inertia_force(motion)
        columns = [start - inertia_force(motion.accelerated(unit)) for unit in np.eye(len(start))]
        return np.stack(columns, axis=1)

    def _missing(self, motion: Admissible, variations: Array, wrenches: Wrenches | None) -> Array:
        """Return -(F + F*), (k,), for variations of the coordinates, (n_q, k)."""
        force = (self.form.inertia_force(motion, variations)
                 + self.form.conservative_force(motion, variations))
        if self.friction:
            force = force + variations.T @ energies.friction_force(motion.posture.model,
                                                                   motion.qdot)
        for name, (push, moment) in (wrenches or {}).items():
            here = motion.posture.possible_motion(*motion.posture.pose(name)).along(variations)
            force = force + here.displacement @ push + here.rotation @ moment
        return -force
