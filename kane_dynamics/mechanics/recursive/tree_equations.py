"""
Equations of motion of a kinematic tree, M udot + bias = tau + external, over any scalar type.

`TreeEquations` combines the recursive algorithms (RNEA, CRBA, LTDL) with the active forces of a
Model and the run-time parameters: gravity, a payload, external wrenches. Its methods are pure
functions; compilation traces them and tests run them on numbers.
"""

from collections.abc import Sequence
from typing import Any

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics.errors import ModelError
from kane_dynamics.mechanics.algebra.dual import moving, rates
from kane_dynamics.mechanics.algebra.ltdl import factorize, inverse, solve
from kane_dynamics.mechanics.ball_joints import free_bodies
from kane_dynamics.mechanics.recursive import (center_of_mass as masses, composite_inertia,
                                               frame_kinematics, inverse_dynamics,
                                               joint_reactions, regressor)
from kane_dynamics.mechanics.recursive.derivatives import inverse_dynamics_derivatives
from kane_dynamics.mechanics.recursive.joint_forces import JointForces, position
from kane_dynamics.mechanics.recursive.link import homogeneous, Link
from kane_dynamics.mechanics.recursive.link_frames import (carrying, denavit_hartenberg, linkage,
                                                           regrouped)
from kane_dynamics.mechanics.recursive.subroutines import directly, Share
from kane_dynamics.model.model import Body, Frame, Model, WORLD
import numpy as np

RESISTS = 1e-9  # of the trace of an inertia: a smaller moment is zero
RIGID_ONLY = ('inverse_dynamics_derivatives', 'forward_dynamics_derivatives', 'regressor')
TORQUE_TERMS = ('inertia', 'coriolis', 'gravity', 'friction', 'spring')


def _own_inertia_resists(body: Body, central: bool) -> bool:
    """
    Return whether a body's own inertia, or its joint's rotor, resists the joint's motion.

    `central` says that the body's center of mass may stay at rest.
    """
    joint, inertial = body.joint, body.inertial
    if joint.armature > 0.0 or joint.kind == 'prismatic':
        return joint.armature > 0.0 or inertial.mass > 0.0
    lever = np.dot(inertial.com, inertial.com)
    offset = lever * np.eye(3) - np.outer(inertial.com, inertial.com)
    about_joint = inertial.inertia + (0.0 if central else inertial.mass) * offset
    return bool(joint.axis @ about_joint @ joint.axis > RESISTS * np.trace(about_joint))


class TreeEquations(JointForces):
    """
    Equations of motion of a model.

    Parameters
    ----------
    model : Model
    wrench_frames : sequence of str
        Frames at which external wrenches may act.
    payload_frame : str, optional
        Frame in which a payload's inertial parameters are given.
    friction : bool
        Whether to include damping and Coulomb friction.
    frame_reduction : bool
        Use Denavit-Hartenberg-like link frames. Otherwise only the joint axes are aligned.

    """

    def __init__(self, model: Model, *, wrench_frames: Sequence[str] = (),
                 payload_frame: str | None = None, friction: bool = True,
                 frame_reduction: bool = True) -> None:
        """Resolve the frames; raise InputError for an unknown one."""
        self.model = model
        self.n, self.n_q = model.n, len(model.coordinate_names)
        self.speed_names = model.joint_names
        self.friction = friction
        self.wrench_frames = tuple(model.frame(name) for name in wrench_frames)
        self.payload_frame = None if payload_frame is None else model.frame(payload_frame)
        self.frame_reduction = frame_reduction
        self.unsupported = RIGID_ONLY if model.flexible else ()  # not available for beams

    timed = False  # no method depends on time

    @lazy_property
    def _raw_links(self) -> tuple[Link, ...]:  # needed only for tracing
        return linkage(self.model)

    @lazy_property
    def _links(self) -> tuple[Link, ...]:
        links = self._raw_links
        return denavit_hartenberg(links) if self.frame_reduction else links

    @lazy_property
    def order(self) -> list[int]:
        """Return the coordinates, parents first: the order of the LTDL factorization."""
        return list(dict.fromkeys(k for link in self._raw_links for k in (
            *([] if link.deflection else [link.coordinate]),
            *(link.beam.coordinates if link.beam else []))))

    @lazy_property
    def without_own_inertia(self) -> frozenset[int]:
        """
        Return the coordinates that may move without kinetic energy in some configuration.

        With the joints before it at rest, the body of a joint moves along the joint alone. Where
        its own inertia resists that, as does no thin rod about itself and no body without mass,
        the pivot of the coordinate is positive. Only at others may the mass matrix be singular.
        """
        first: dict[int, Body] = {}
        for body in self.model.bodies:
            if body.joint.deflection is None and body.joint.multiplier:
                first.setdefault(body.joint.coordinate, body)
        # The slides of a free body are eliminated first, which leaves motions about its center.
        central = [self.model.bodies[ball.body + 2] for ball in free_bodies(self.model)]
        return frozenset(k for k, body in first.items() if not _own_inertia_resists(
            body, any(body is other for other in central)))

    @property
    def joint_links(self) -> tuple[Link, ...]:
        """Return the links with their origins at the model's joints, without a payload."""
        return self._raw_links

    @property
    def geometry(self) -> tuple[Link, ...]:
        """Return the links without a payload, for kinematics."""
        return self._links

    def links(self, parameters: Any) -> tuple[Link, ...]:
        """Return the links with full inertial parameters, including the payload."""
        return self._loaded(self._links, parameters)

    def _loaded(self, links: tuple[Link, ...], parameters: Any) -> tuple[Link, ...]:
        """Return links with the payload added."""
        frame = self.payload_frame
        if frame is None or frame.body == WORLD:
            return links
        m, hx, hy, hz, xx, xy, xz, yy, yz, zz = parameters[3:13]
        P = np.array([[xx, xy, xz, hx], [xy, yy, yz, hy], [xz, yz, zz, hz], [hx, hy, hz, m]])
        return carrying(links, frame.body,
                        homogeneous(frame.rotation, frame.translation), P)

    def base_links(self, parameters: Any) -> tuple[Link, ...]:
        """Return the links with base inertial parameters only, sufficient for joint forces."""
        return regrouped(self.links(parameters))

    def inverse_dynamics(self, q: Any, u: Any, udot: Any, wrench: Any, parameters: Any) -> Any:
        """Return tau = M udot + bias - external, (n,), by RNEA."""
        return self.rigid_dynamics(q, u, udot, wrench, parameters) + self.friction_force(u)

    def rigid_dynamics(self, q: Any, u: Any, udot: Any, wrench: Any, parameters: Any) -> Any:
        """Return inverse dynamics without friction, (n,)."""
        rigid = inverse_dynamics.inverse_dynamics(self.base_links(parameters), q, u, udot,
                                                  parameters[:3])
        return (rigid + self.armature(udot) + self.spring_force(q)
                - self.external_force(q, wrench))

    def bias_force(self, q: Any, u: Any, parameters: Any) -> Any:
        """Return the bias force h(q, u) without external wrenches, (n,)."""
        return self.inverse_dynamics(q, u, self.zeros, None, parameters)

    def gravity_force(self, q: Any, parameters: Any) -> Any:
        """Return the gravity compensation torque, (n,)."""
        return inverse_dynamics.inverse_dynamics(self.base_links(parameters), q, self.zeros,
                                                 self.zeros, parameters[:3])

    def mass_matrix(self, q: Any, parameters: Any) -> Any:
        """Return the mass matrix with armature, (n, n), by CRBA."""
        M = composite_inertia.mass_matrix(self.base_links(parameters), q)
        return M + np.diag(self.armature(np.ones(self.n)))

    def inverse_mass_matrix(self, q: Any, parameters: Any) -> Any:
        """Return the inverse mass matrix, (n, n), by LTDL."""
        return inverse(self.factors(q, parameters), self.order)

    def forward_dynamics(self, q: Any, u: Any, tau: Any, wrench: Any, parameters: Any) -> Any:
        """Return udot = M^-1 (tau + external - bias), (n,), by CRBA and LTDL, not by ABA."""
        held = self.inverse_dynamics(q, u, self.zeros, wrench, parameters)
        return solve(self.factors(q, parameters), self.order, tau - held)

    def factors(self, q: Any, parameters: Any, factorized: Any = factorize) -> Any:
        """Return the LTDL factorization of M; raise ModelError if M is structurally singular."""
        try:
            return factorized(self.mass_matrix(q, parameters), self.order,
                              watched=self.without_own_inertia)
        except ZeroDivisionError as error:
            name = self.model.joint_names[error.args[0]]
            raise ModelError(f"the mass matrix is singular: joint '{name}' moves no mass; "
                             'expected a body with inertia or a joint with armature') from None

    def coriolis_matrix(self, q: Any, u: Any, parameters: Any,
                        share: Share = directly) -> Any:
        """Return the Coriolis matrix C, (n, n), from Christoffel symbols: C = 1/2 d(C u)/du."""
        none, links = np.zeros(3).astype(object), self.base_links(parameters)
        if self.model.flexible:  # the analytic derivatives are those of rigid bodies
            return 0.5 * np.stack([rates(inverse_dynamics.inverse_dynamics(
                links, q, moving(u, unit), self.zeros, none)) for unit in np.eye(self.n)], axis=1)
        return 0.5 * inverse_dynamics_derivatives(links, q, u, self.zeros, none, share)[1]

    def inverse_dynamics_derivatives(self, q: Any, u: Any, udot: Any, parameters: Any,
                                     share: Share = directly) -> Any:
        """Return dtau/dq, dtau/du and dtau/dudot = M, (3, n, n), without external wrenches."""
        rigid = inverse_dynamics_derivatives(self.base_links(parameters), q, u, udot,
                                             parameters[:3], share)
        return rigid + np.stack([np.diag(x) for x in self.joint_slopes(u)])

    def joint_slopes(self, u: Any) -> tuple[Any, Any, Any]:
        """Return what springs, friction and armature add to the diagonals of the derivatives."""
        return (self._by_coordinate(lambda j: j.multiplier**2 * j.stiffness),
                self.friction_slope(u), self.armature(np.ones(self.n)))

    def forward_dynamics_derivatives(self, q: Any, u: Any, tau: Any, parameters: Any) -> Any:
        """Return dudot/dq, dudot/du and dudot/dtau = M^-1, (3, n, n), no external wrenches."""
        udot = self.forward_dynamics(q, u, tau, None, parameters)
        by_q, by_u, _ = self.inverse_dynamics_derivatives(q, u, udot, parameters)
        W = self.inverse_mass_matrix(q, parameters)
        return np.stack([-(W @ by_q), -(W @ by_u), W])

    def regressor(self, q: Any, u: Any, udot: Any, parameters: Any,
                  share: Share = directly) -> Any:
        """Return the joint torque regressor of the rigid bodies, (n, 10 n_bodies)."""
        return regressor.regressor(self._raw_links, q, u, udot, parameters[:3], share)

    def body_torques(self, q: Any, u: Any, udot: Any, parameters: Any) -> Any:
        """Return the torques due to each body with its payload and elasticity, (n_bodies, n)."""
        found = joint_reactions.body_torques(self.links(parameters), q, u, udot, parameters[:3])
        for row, body in zip(found, self.model.bodies):
            if body.beam is not None:
                modes = list(body.beam.coordinates)
                row[modes] = row[modes] + self.elastic_force(body.beam, q, u)
        return found

    def joint_reactions(self, q: Any, u: Any, udot: Any, wrench: Any, parameters: Any) -> Any:
        """Return the reactions of parent on child at all joints, (n_bodies, 6), world axes."""
        wrenches = () if wrench is None else tuple(zip(self.wrench_frames, wrench))
        links = self._loaded(self._raw_links, parameters)
        found = joint_reactions.joint_reactions(links, q, u, udot, parameters[:3], wrenches)
        return np.array(found).reshape(len(found), 6)

    def joint_reaction(self, body: int, q: Any, u: Any, udot: Any, wrench: Any,
                       parameters: Any) -> Any:
        """Return the joint reaction of one body, (6,), world axes."""
        return self.joint_reactions(q, u, udot, wrench, parameters)[body]

    def torque_terms(self, q: Any, u: Any, udot: Any, parameters: Any) -> Any:
        """Return the terms of inverse dynamics, (5, n), rows as `TORQUE_TERMS`."""
        links, none = self.base_links(parameters), np.zeros(3).astype(object)
        rest = self.zeros
        return np.stack([
            inverse_dynamics.inverse_dynamics(links, q, rest, udot, none) + self.armature(udot),
            inverse_dynamics.inverse_dynamics(links, q, u, rest, none),
            self.gravity_force(q, parameters), self.friction_force(u), self.spring_force(q)])

    def kinetic_energy(self, q: Any, u: Any, parameters: Any) -> Any:
        """Return the kinetic energy including the rotors (armature), J."""
        return (inverse_dynamics.kinetic_energy(self.links(parameters), q, u)
                + 0.5 * (u @ self.armature(u)))

    def potential_energy(self, q: Any, parameters: Any) -> Any:
        """Return the potential energy of gravity and springs, J."""
        springs: Any = 0.0
        for body in self.model.bodies:
            stretch = position(body.joint, q) - body.joint.rest
            springs = springs + 0.5 * body.joint.stiffness * (stretch * stretch)
            if body.beam is not None:
                eta = q[list(body.beam.coordinates)]
                springs = springs + 0.5 * (eta @ (body.beam.stiffness @ eta))
        links = self.links(parameters)
        return inverse_dynamics.potential_energy(links, q, parameters[:3]) + springs

    def center_of_mass(self, q: Any, parameters: Any) -> Any:
        """Return the center of mass of the moving bodies and the payload, (3,), m."""
        return masses.center_of_mass(self.links(parameters), q)

    def center_of_mass_jacobian(self, q: Any, parameters: Any) -> Any:
        """Return the velocity of the center of mass per unit of each speed, (3, n)."""
        return masses.center_of_mass_jacobian(self.links(parameters), q)

    def frame_pose(self, frame: Frame, q: Any) -> Any:
        """Return the homogeneous transformation from the frame to the world, (4, 4)."""
        return frame_kinematics.frame_pose(self._links, frame, q)

    def frame_velocity(self, frame: Frame, q: Any, u: Any) -> Any:
        """Return the linear, then angular velocity of a frame, (6,)."""
        return self._frame_motion(frame, q, u, self.zeros)[0]

    def frame_acceleration(self, frame: Frame, q: Any, u: Any, udot: Any) -> Any:
        """Return the linear, then angular acceleration of a frame, (6,)."""
        return self._frame_motion(frame, q, u, udot)[1]

    def _frame_motion(self, frame: Frame, q: Any, u: Any, udot: Any) -> Any:
        poses = frame_kinematics.LinkPoses(self._links, q)
        return frame_kinematics.frame_motion(frame, poses, u, udot)

    def partial_velocities(self, frame: Frame, q: Any) -> Any:
        """Return the Jacobian (partial velocities) of a frame, (6, n): linear, then angular."""
        return frame_kinematics.partial_velocities(self._links, frame, q)

    def partial_velocity_rates(self, frame: Frame, q: Any, u: Any) -> Any:
        """Return the time derivative of the Jacobian (partial velocities), (6, n)."""
        return frame_kinematics.partial_velocity_rates(self._links, frame, q, u)

    def joint_rates(self, q: Any, u: Any) -> Any:
        """Return the rates of the joints, (n,): u itself."""
        return u

    def joint_accelerations(self, q: Any, u: Any, udot: Any) -> Any:
        """Return the accelerations of the joints, (n,): udot itself."""
        return udot

    def joint_torques(self, tau: Any, q: Any) -> Any:
        """Return the torques of the joints, (n,): tau itself."""
        return tau

    def joint_origins(self, q: Any) -> list[Any]:
        """Return the joint origins of all bodies, (3,) each, m, world axes."""
        return [origin for _, origin in frame_kinematics.link_poses(self._raw_links, q)]

    def external_force(self, q: Any, wrench: Any) -> Any:
        """Return the generalized force of wrenches (k, 6) at the declared frames, (n,)."""
        wrenches = () if wrench is None else zip(self.wrench_frames, wrench)
        return sum((self.partial_velocities(frame, q).T @ w for frame, w in wrenches), self.zeros)
