"""The dynamics of a robot: inverse and forward dynamics, mass matrix, derivatives, energies."""

from __future__ import annotations

from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.recursive.regressor import inertial_parameters
from kane_dynamics.robot.methods.dispatch import compiled, Dispatch
from kane_dynamics.robot.torque_breakdown import SOURCES, TorqueBreakdown
import numpy as np
from numpy.typing import ArrayLike


class DynamicsMethods(Dispatch):
    """
    The methods of `Robot` for dynamics.

    Every method accepts one state, (n,) arrays, or a batch, (N, n) arrays, and returns the same; q
    has n_q entries, more than n under constraints and with ball joints.
    """

    @compiled
    def inverse_dynamics(self, q: ArrayLike, u: ArrayLike, udot: ArrayLike, *,
                         wrench: ArrayLike | None = None, t: ArrayLike = 0.0,
                         out: Array | None = None) -> Array:
        """
        Return tau = M udot + bias - external, (n,), N m or N.

        Parameters
        ----------
        q, u, udot : (n,) or (N, n) arrays
            Coordinates, speeds and their rates; rad or m, s.
        wrench : mapping of str to (6,) or (N, 6) arrays; or (k, 6) or (N, k, 6) array, optional
            External wrenches by frame: force then moment, at the frame's origin, world axes, N
            and N m. An array has one row for each of the `wrench_frames`, and is the fastest; of
            a single frame it may be (6,). Other frames need a mapping; their kernels compile at
            the first call.
        t : float or (N,) array
            Time, s; ignored unless speeds or constraints depend on it.
        out : array, optional
            Written to and returned.

        Raises
        ------
        InputError
            Names the argument, what was given and what is expected.

        """
        return self._loaded('inverse_dynamics', (q, u, udot), wrench, out,
                            t)

    @compiled
    def forward_dynamics(self, q: ArrayLike, u: ArrayLike, tau: ArrayLike, *,
                         wrench: ArrayLike | None = None, t: ArrayLike = 0.0,
                         out: Array | None = None) -> Array:
        """Return udot = M^-1 (tau + external - bias), (n,); arguments as inverse_dynamics."""
        return self._loaded('forward_dynamics', (q, u, tau), wrench, out,
                            t)

    @compiled
    def mass_matrix(self, q: ArrayLike, *, t: ArrayLike = 0.0, out: Array | None = None) -> Array:
        """Return M(q), (n, n), armature included, kg m^2, kg m or kg."""
        return self._call('mass_matrix', (q,), out, t)

    @compiled
    def inverse_mass_matrix(self, q: ArrayLike, *, t: ArrayLike = 0.0,
                            out: Array | None = None) -> Array:
        """Return the inverse of M(q), (n, n)."""
        return self._call('inverse_mass_matrix', (q,), out, t)

    @compiled
    def bias_force(self, q: ArrayLike, u: ArrayLike, *, t: ArrayLike = 0.0,
                   out: Array | None = None) -> Array:
        """Return h(q, u), (n,): Coriolis, centrifugal, gravity, friction and springs, N m or N."""
        return self._call('bias_force', (q, u), out, t)

    @compiled
    def coriolis_matrix(self, q: ArrayLike, u: ArrayLike, *, t: ArrayLike = 0.0,
                        out: Array | None = None) -> Array:
        """
        Return C(q, u), (n, n): C u is the Coriolis and centrifugal force, dM/dt = C + C^T.

        In joint rates C is the matrix of the Christoffel symbols, half the derivative of C u with
        respect to u; otherwise its projection on the independent speeds. Where speeds or
        constraints depend on time, C u lacks the force of the motion that they prescribe at u = 0.
        """
        return self._call('coriolis_matrix', (q, u), out, t)

    @compiled
    def gravity_force(self, q: ArrayLike, *, t: ArrayLike = 0.0,
                      out: Array | None = None) -> Array:
        """Return the torque that balances gravity alone, (n,), N m or N."""
        return self._call('gravity_force', (q,), out, t)

    @compiled
    def friction_force(self, u: ArrayLike, q: ArrayLike | None = None, *, t: ArrayLike = 0.0,
                       out: Array | None = None) -> Array:
        """
        Return d u + mu tanh(u / u_s) + offset, (n,): viscous and Coulomb friction, N m or N.

        With chosen speeds or constraints it depends on q; other robots ignore q and t.
        """
        if self.equations.in_joint_rates:
            return self._call('friction_force', (u,), out)
        if q is None:
            raise InputError('q: missing; expected the configuration, on which the friction of a '
                             'robot with chosen speeds or constraints depends')
        return self._call('friction_force', (u, q), out, t)

    @compiled
    def external_force(self, q: ArrayLike, *, wrench: ArrayLike | None = None, t: ArrayLike = 0.0,
                       out: Array | None = None) -> Array:
        """Return the generalized force of wrenches at the declared frames, (n,), N m or N."""
        return self._loaded('external_force', (q,), wrench, out, t)

    @compiled
    def torque_terms(self, q: ArrayLike, u: ArrayLike, udot: ArrayLike, *, t: ArrayLike = 0.0,
                     out: Array | None = None) -> Array:
        """Return inverse dynamics by source, (5, n): the rows of `TORQUE_TERMS`."""
        return self._call('torque_terms', (q, u, udot), out, t)

    @compiled
    def body_torques(self, q: ArrayLike, u: ArrayLike, udot: ArrayLike, *, t: ArrayLike = 0.0,
                     out: Array | None = None) -> Array:
        """
        Return the torque of each body at every joint, (n_bodies, n).

        Of its inertia and weight, and of a beam's elasticity and material damping.
        """
        return self._call('body_torques', (q, u, udot), out, t)

    @compiled
    def joint_reactions(self, q: ArrayLike, u: ArrayLike, udot: ArrayLike, *,
                        wrench: ArrayLike | None = None, t: ArrayLike = 0.0,
                        out: Array | None = None) -> Array:
        """Return `joint_reaction` of every body's joint, (n_bodies, 6), in order of bodies."""
        return self._loaded('joint_reactions', (q, u, udot), wrench, out,
                            t)

    def explain(self, q: ArrayLike, u: ArrayLike, udot: ArrayLike, *,
                wrench: ArrayLike | None = None, t: ArrayLike = 0.0) -> TorqueBreakdown:
        """Return the torque breakdown by source and by body; arguments as `inverse_dynamics`."""
        external: Any = self.external_force(q, wrench=wrench, t=t)
        terms = self.torque_terms(q, u, udot, t=t)
        model = self.equations.model
        return TorqueBreakdown(
            np.concatenate([terms, 0.0 - external[..., None, :]], axis=-2),
            self.body_torques(q, u, udot, t=t), SOURCES, tuple(body.name for body in model.bodies),
            tuple(self.equations.speed_names))

    @compiled
    def regressor(self, q: ArrayLike, u: ArrayLike, udot: ArrayLike, *, t: ArrayLike = 0.0,
                  out: Array | None = None) -> Array:
        """
        Return the regressor Y, (n, 10 n_bodies): Y times `inertial_parameters` is the torque.

        The torque is that of rigid bodies: inverse dynamics without armature, friction, springs,
        payload and wrenches. `mechanics.recursive.regressor` defines the order of parameters.
        """
        return self._call('regressor', (q, u, udot), out, t)

    @property
    def inertial_parameters(self) -> Array:
        """Return the model's inertial parameters, (10 n_bodies,), in the regressor's order."""
        return inertial_parameters(self.equations.model)

    @compiled
    def center_of_mass(self, q: ArrayLike, *, t: ArrayLike = 0.0,
                       out: Array | None = None) -> Array:
        """Return the center of mass of the moving bodies and the payload, (3,), m, world axes."""
        return self._call('center_of_mass', (q,), out, t)

    @compiled
    def center_of_mass_jacobian(self, q: ArrayLike, *, t: ArrayLike = 0.0,
                                out: Array | None = None) -> Array:
        """Return the Jacobian of `center_of_mass`, (3, n)."""
        return self._call('center_of_mass_jacobian', (q,), out, t)

    @compiled
    def kinetic_energy(self, q: ArrayLike, u: ArrayLike, *, t: ArrayLike = 0.0,
                       out: Array | None = None) -> Any:
        """Return 1/2 u^T M u, J; a float, or (N,) for a batch."""
        return self._call('kinetic_energy', (q, u), out, t)

    @compiled
    def potential_energy(self, q: ArrayLike, *, out: Array | None = None) -> Any:
        """Return the energy of gravity (zero at the world's origin) and springs, J."""
        return self._call('potential_energy', (q,), out)

    def joint_reaction(self, joint: str, q: ArrayLike, u: ArrayLike, udot: ArrayLike, *,
                       wrench: ArrayLike | None = None, t: ArrayLike = 0.0) -> Array:
        """
        Return the wrench of the parent on the child at a joint: force, moment, (6,), N, N m.

        At the joint's origin, in world axes; includes the torque of actuator and friction about
        the axis, all loads, and the forces of `constraint_forces`.

        Parameters
        ----------
        joint : str
            A moving joint; fixed and locked joints are merged into bodies.
        q, u, udot, wrench, t
            As in `inverse_dynamics`.

        Raises
        ------
        InputError
            An unknown joint; the message lists the valid ones.

        """
        if not isinstance(joint, str):
            raise InputError(f'joint: a {type(joint).__name__}; expected a name (str): the order '
                             'is (joint, q, u, udot)')
        entry = self._entry('joint_reaction', joint, self.kernels.reaction)
        if wrench is None and not self.equations.timed:
            result: Array = entry(q, u, udot)
            return result
        return self._loaded('joint_reaction', (q, u, udot), wrench, None, t, joint)
