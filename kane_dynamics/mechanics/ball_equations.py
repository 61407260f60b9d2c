"""Equations of motion of a tree with ball joints, over any scalar type."""

from collections.abc import Sequence
from typing import Any

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics.mechanics.algebra.ltdl import solve
from kane_dynamics.mechanics.ball_joints import (axis_acceleration, axis_rates, Ball, free_bodies,
                                                 joint_positions, rotations)
from kane_dynamics.mechanics.recursive import composite_inertia, inverse_dynamics
from kane_dynamics.mechanics.recursive.link import Link
from kane_dynamics.mechanics.recursive.link_frames import posed
from kane_dynamics.mechanics.recursive.subroutines import directly, Share
from kane_dynamics.mechanics.recursive.tree_equations import TORQUE_TERMS, TreeEquations
from kane_dynamics.model.model import Frame, WORLD
import numpy as np


class BallEquations(TreeEquations):
    """
    Equations of motion of a model with ball joints; see `ball_joints`.

    q has n_q entries and u n. Every quantity is that of the same tree in its local angles, which
    are zero at q, with theta' = u and theta'' = u' - gamma(u); torques are dual to both.
    """

    @lazy_property
    def _free(self) -> list[Ball]:
        """Return the free bodies without a payload or wrench on the slides before them."""
        loaded = {frame.body for frame in (self.payload_frame, *self.wrench_frames) if frame}
        return [ball for ball in free_bodies(self.model)
                if loaded.isdisjoint(range(ball.body - 3, ball.body))]

    @lazy_property
    def free_order(self) -> list[int]:
        """Return `order`, but with slides at its end if the free body carries one chain."""
        parents = [body.parent for body in self.model.bodies]
        branching = {k for k in parents if parents.count(k) > 1 and k != WORLD}
        carriers = {j for k in branching for j in self.model.path(k)}
        first = [k for ball in self._free if ball.body not in carriers
                 for k in range(ball.speed - 3, ball.speed)]
        return [k for k in self.order if k not in first] + first

    def _at(self, q: Any) -> tuple['_LocalTree', Any]:
        """Return the tree with the rotations of q, and its joint positions, (n,)."""
        return _LocalTree(self, q), joint_positions(self.model, q)

    def _local(self, u: Any, udot: Any) -> Any:
        """Return the accelerations of the local angles and of the other joints, (n,)."""
        return udot - axis_acceleration(self.model, u)

    def rigid_dynamics(self, q: Any, u: Any, udot: Any, wrench: Any, parameters: Any) -> Any:
        """Return inverse dynamics without friction, (n,)."""
        here, x = self._at(q)
        return here.rigid_dynamics(x, u, self._local(u, udot), wrench, parameters)

    def gravity_force(self, q: Any, parameters: Any) -> Any:
        """Return the gravity compensation torque, (n,)."""
        here, x = self._at(q)
        return here.gravity_force(x, parameters)

    def forward_dynamics(self, q: Any, u: Any, tau: Any, wrench: Any, parameters: Any) -> Any:
        """
        Return udot = M^-1 (tau + external - bias), (n,), by CRBA and LTDL, not by ABA.

        A free body's speeds are here the velocity of its origin along its own axes, as they are
        at this instant. The rows of M that belong to them are the mass and first moment of all
        that moves with it. They are eliminated first, which leaves M of motions about the center
        of mass; not if the body carries several branches, whose common entries of M are zero but
        would not be then.
        """
        slides = {ball.body: slice(ball.speed - 3, ball.speed) for ball in self._free}
        if not slides:
            return super().forward_dynamics(q, u, tau, wrench, parameters)
        here, x = _FreeTree(self, q), joint_positions(self.model, q)
        R = rotations(self.model, q)
        applied = tau - self.friction_force(u)
        for k, s in slides.items():
            # No other force depends on the position and velocity of the origin.
            x[s], applied[s] = 0.0, R[k].T @ applied[s]
        held = here.rigid_dynamics(x, u, self._local(u, self.zeros), wrench, parameters)
        udot = solve(here.factors(x, parameters), here.order, applied - held)
        for k, s in slides.items():
            udot[s] = R[k] @ udot[s]
        return udot

    def mass_matrix(self, q: Any, parameters: Any) -> Any:
        """Return the mass matrix with armature, (n, n), by CRBA."""
        here, x = self._at(q)
        return here.mass_matrix(x, parameters)

    def coriolis_matrix(self, q: Any, u: Any, parameters: Any,
                        share: Share = directly) -> Any:
        """
        Return the Coriolis matrix, (n, n): C = C_theta - M A, gamma = A u.

        C_theta are the Christoffel symbols in the local angles, and u = (1 + A dt) theta'.
        """
        here, x = self._at(q)
        M = composite_inertia.mass_matrix(here.base_links(parameters), x)
        return here.coriolis_matrix(x, u, parameters, share) - M @ axis_rates(self.model, u)

    def regressor(self, q: Any, u: Any, udot: Any, parameters: Any,
                  share: Share = directly) -> Any:
        """Return the joint torque regressor of the rigid bodies, (n, 10 n_bodies)."""
        here, x = self._at(q)
        return here.regressor(x, u, self._local(u, udot), parameters, share)

    def body_torques(self, q: Any, u: Any, udot: Any, parameters: Any) -> Any:
        """Return the torques due to each body with its payload and elasticity, (n_bodies, n)."""
        here, x = self._at(q)
        return here.body_torques(x, u, self._local(u, udot), parameters)

    def joint_reactions(self, q: Any, u: Any, udot: Any, wrench: Any, parameters: Any) -> Any:
        """Return the reactions of parent on child at all joints, (n_bodies, 6), world axes."""
        here, x = self._at(q)
        return here.joint_reactions(x, u, self._local(u, udot), wrench, parameters)

    def torque_terms(self, q: Any, u: Any, udot: Any, parameters: Any) -> Any:
        """Return the terms of inverse dynamics, (5, n), rows as `TORQUE_TERMS`."""
        here, x = self._at(q)
        terms = here.torque_terms(x, u, udot, parameters)
        terms[TORQUE_TERMS.index('coriolis')] = inverse_dynamics.inverse_dynamics(
            here.base_links(parameters), x, u, self._local(u, self.zeros),
            np.zeros(3).astype(object))
        return terms

    def kinetic_energy(self, q: Any, u: Any, parameters: Any) -> Any:
        """Return the kinetic energy including the rotors (armature), J."""
        here, x = self._at(q)
        return here.kinetic_energy(x, u, parameters)

    def potential_energy(self, q: Any, parameters: Any) -> Any:
        """Return the potential energy of gravity and springs, J."""
        here, x = self._at(q)
        return here.potential_energy(x, parameters)

    def center_of_mass(self, q: Any, parameters: Any) -> Any:
        """Return the center of mass of the moving bodies and the payload, (3,), m."""
        here, x = self._at(q)
        return here.center_of_mass(x, parameters)

    def center_of_mass_jacobian(self, q: Any, parameters: Any) -> Any:
        """Return the velocity of the center of mass per unit of each speed, (3, n)."""
        here, x = self._at(q)
        return here.center_of_mass_jacobian(x, parameters)

    def frame_pose(self, frame: Frame, q: Any) -> Any:
        """Return the homogeneous transformation from the frame to the world, (4, 4)."""
        here, x = self._at(q)
        return here.frame_pose(frame, x)

    def frame_velocity(self, frame: Frame, q: Any, u: Any) -> Any:
        """Return the linear, then angular velocity of a frame, (6,)."""
        here, x = self._at(q)
        return here.frame_velocity(frame, x, u)

    def frame_acceleration(self, frame: Frame, q: Any, u: Any, udot: Any) -> Any:
        """Return the linear, then angular acceleration of a frame, (6,)."""
        here, x = self._at(q)
        return here.frame_acceleration(frame, x, u, self._local(u, udot))

    def partial_velocities(self, frame: Frame, q: Any) -> Any:
        """Return the Jacobian (partial velocities) of a frame, (6, n): linear, then angular."""
        here, x = self._at(q)
        return here.partial_velocities(frame, x)

    def partial_velocity_rates(self, frame: Frame, q: Any, u: Any) -> Any:
        """Return the time derivative of the Jacobian (partial velocities), (6, n)."""
        here, x = self._at(q)
        return (here.partial_velocity_rates(frame, x, u)
                - here.partial_velocities(frame, x) @ axis_rates(self.model, u))

    def joint_origins(self, q: Any) -> list[Any]:
        """Return the joint origins of all bodies, (3,) each, m, world axes."""
        here, x = self._at(q)
        return here.joint_origins(x)


class _LocalTree(TreeEquations):
    """The tree of local angles at one configuration: its links have the rotations of q."""

    def __init__(self, tree: BallEquations, q: Any) -> None:
        """Share everything but the links."""
        vars(self).update(vars(tree))
        self._tree, self._q = tree, q

    @property
    def _raw_links(self) -> tuple[Link, ...]:
        return self._posed(self._tree._raw_links)

    @property
    def _links(self) -> tuple[Link, ...]:
        return self._posed(self._tree._links)

    def base_links(self, parameters: Any) -> tuple[Link, ...]:
        """Return the links with base inertial parameters: those of no rotation, rotated."""
        return self._posed(self._tree.base_links(parameters))

    def _posed(self, links: Sequence[Link]) -> tuple[Link, ...]:
        return posed(links, self.model, self._q)


class _FreeTree(_LocalTree):
    """The tree of local angles whose free bodies slide along their own axes at q."""

    @property
    def order(self) -> list[int]:
        """Return the coordinates in the order of the LTDL factorization."""
        return self._tree.free_order

    def _posed(self, links: Sequence[Link]) -> tuple[Link, ...]:
        return posed(links, self.model, self._q, [ball.body for ball in self._tree._free])
