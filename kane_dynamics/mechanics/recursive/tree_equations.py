"""
The dynamics of a tree in joint space, M udot + bias = tau + external, on any scalar.

`TreeEquations` combines the recursive algorithms (RNEA, CRBA, LTDL) with the active
forces of a Model and the run-time parameters: gravity, a payload, external wrenches. Its
methods are pure functions; compilation traces them and tests run them on numbers.

With ball joints, every quantity is that of the same tree in its local angles (see
`ball_joints`), which are zero at q: theta' = u and theta'' = u' - gamma(u). Torques are
dual to both.
"""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
import math
from typing import Any

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.frozen import freeze
from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.errors import ModelError
from kane_dynamics.mechanics.algebra.jet import moving, rates
from kane_dynamics.mechanics.algebra.ltdl import factorize, inverse, solve
from kane_dynamics.mechanics.ball_joints import (axis_acceleration, axis_rates, Ball,
                                                 free_bodies, joint_positions, rotations)
from kane_dynamics.mechanics.elastic_joints import (damping_slope, damping_torque,
                                                    drive_forces, drive_matrix,
                                                    spring_energy, spring_slope,
                                                    spring_torque)
from kane_dynamics.mechanics.friction import (bristle_energy, bristle_rate,
                                              bristle_torque, carries_load,
                                              carries_loads, deflection_after,
                                              DESIRED_SPEED, direction_of_sliding,
                                              elastic_bristle_torque,
                                              feedforward_direction, friction_slope,
                                              friction_torque, has_breakaway_drop,
                                              has_bristles, load_of_drive, load_slope,
                                              require_solvable)
from kane_dynamics.mechanics.recursive import (articulated_inertia,
                                               center_of_mass as masses,
                                               composite_inertia, frame_kinematics,
                                               inverse_dynamics, joint_reactions,
                                               regressor)
from kane_dynamics.mechanics.recursive.derivatives import inverse_dynamics_derivatives
from kane_dynamics.mechanics.recursive.flexible_modes import bent
from kane_dynamics.mechanics.recursive.link import (carrying, denavit_hartenberg,
                                                    homogeneous, Link, linkage, merged,
                                                    posed, regrouped)
from kane_dynamics.mechanics.recursive.subroutines import directly, Share
from kane_dynamics.model.beam import Beam
from kane_dynamics.model.model import Body, Frame, Joint, Model, WORLD
import numpy as np

RESISTS = 1e-9  # of the trace of an inertia: a smaller moment of inertia is zero
RIGID_ONLY = ('inverse_dynamics_derivatives', 'forward_dynamics_derivatives',
              'regressor')
TORQUE_TERMS = ('inertia', 'coriolis', 'gravity', 'friction', 'spring')
NO_GRAVITY = np.zeros(3).astype(object)


class TreeEquations:
    """
    The dynamics of a model in joint space: in joint rates and without constraints.

    Methods take the coordinates q (n_q,), the speeds u and accelerations udot of the
    joints (n,), wrenches (k, 6) at the declared frames or None, and the run-time
    parameters: gravity (3,), then the payload's ten inertial parameters if a frame for
    it is declared.

    Parameters
    ----------
    model : Model
    wrench_frames : sequence of str
        Frames at which external wrenches may act.
    payload_frame : str, optional
        Frame in which a payload's inertial parameters are given.
    friction : bool
        Whether to include damping and Coulomb friction.
    feedforward_friction : str or float
        The friction of `feedforward_friction`, as of `friction.feedforward_direction`.

    """

    def __init__(self, model: Model, *, wrench_frames: Sequence[str] = (),
                 payload_frame: str | None = None, friction: bool = True,
                 feedforward_friction: str | float = DESIRED_SPEED) -> None:
        """Resolve the frames; raise InputError for an unknown one."""
        self.model = model
        self.n, self.n_q = model.n, len(model.coordinate_names)
        self.joints = [body.joint for body in model.bodies]
        self.friction = friction
        self.feedforward_choice = feedforward_friction
        # Whether friction depends on the torques that the drives transmit.
        self.carries_loads = friction and carries_loads(model)
        # The joints whose friction has a state of its own in simulations.
        self.bristles: list[Joint] = []
        if friction:
            self.bristles = list(filter(has_bristles, self.joints))
        self.bristle_names = tuple(joint.name for joint in self.bristles)
        self.wrench_frames = tuple(model.frame(name) for name in wrench_frames)
        self.payload_frame: Frame | None = None
        if payload_frame is not None:
            self.payload_frame = model.frame(payload_frame)
        self.flexible = model.flexible
        self.drives = model.drives
        self.is_damped = bool(self.drives or self.flexible)  # beside the joints' friction
        # Quantities that are not available for beams.
        self.unsupported = RIGID_ONLY if self.flexible else ()
        # A joint that mimics another one turns its rotor by its multiplier.
        rotors = [joint.multiplier**2 * joint.armature for joint in self.joints]
        self.rotor_inertia = self._by_coordinate(rotors)
        self.order = _parents_first(model)
        free_balls = free_bodies(model) if model.balls else []
        self.without_own_inertia = _without_own_inertia(model, free_balls)
        self._free_balls = self._unloaded(free_balls)
        # Zeros of an array of objects add no operation to a traced program.
        self.zeros = np.zeros(self.n).astype(object)
        self.zeros.setflags(write=False)

    # The links, with their inertial parameters and at a configuration.

    @lazy_property
    def joint_links(self) -> tuple[Link, ...]:
        """Links with origins at the model's joints, without a payload."""
        return linkage(self.model)

    @lazy_property
    def geometry(self) -> tuple[Link, ...]:
        """Links without a payload, for kinematics, in Denavit-Hartenberg-like frames."""
        links = self.joint_links
        return denavit_hartenberg(merged(links) if self.flexible else links)

    def base_links(self, parameters: Vector) -> tuple[Link, ...]:
        """Return the links with base inertial parameters, enough for joint forces."""
        return regrouped(self._loaded(self.geometry, parameters))

    def _loaded(self, links: tuple[Link, ...], parameters: Vector) -> tuple[Link, ...]:
        """Return links with the payload added."""
        frame = self.payload_frame
        if frame is None or frame.body == WORLD:
            return links
        m, hx, hy, hz, xx, xy, xz, yy, yz, zz = parameters[3:13]
        # Pseudo inertia about the origin of the payload's frame: second moments, first
        # moments and mass.
        P = np.array([[xx, xy, xz, hx], [xy, yy, yz, hy], [xz, yz, zz, hz],
                      [hx, hy, hz, m]])
        pose = homogeneous(frame.rotation, frame.translation)
        return carrying(links, frame.body, pose, P)

    def with_constants(self, inertial_parameters: Vector | None = None,
                       damping: Vector | None = None,
                       friction: Vector | None = None) -> 'TreeEquations':
        """
        Return equations with other constants of rigid bodies and joints, any scalars.

        Parameters
        ----------
        inertial_parameters : (10 n_bodies,) array of scalars
            In the order of `regressor`.
        damping, friction : (n,) arrays of scalars
            Viscous damping and Coulomb friction of the joints.

        """
        result = copy(self)
        if inertial_parameters is not None:
            tensors = []
            for parameters in inertial_parameters.reshape(-1, 10):
                tensors.append(regressor.pseudo_inertia_of(parameters))
            for name in ('joint_links', 'geometry'):
                links = []
                for link, P in zip(getattr(self, name), tensors):
                    on_link = link.body @ P @ link.body.T
                    links.append(replace(link, pseudo_inertia=on_link))
                result.__dict__[name] = tuple(links)
        result.joints = list(map(copy, self.joints))
        for joint in result.joints:
            if joint.name not in self.model.joint_names:
                continue  # a joint that mimics another one
            for field, values in (('damping', damping), ('friction', friction)):
                if values is not None:
                    freeze(joint, field, values[joint.coordinate])
        return result

    def _links_at(self, q: Vector,
                  links: Sequence[Link]) -> tuple[Sequence[Link], Vector]:
        """Return links with balls rotated and beams bent as at q, and positions, (n,)."""
        x = q
        if self.model.balls:
            links = posed(links, self.model, q)
            x = joint_positions(self.model, q)
        if self.flexible:
            links = bent(links, x)
        return links, x

    def _angle_accelerations(self, u: Vector, udot: Vector) -> Vector:
        """Return the accelerations of the local angles and of the other joints, (n,)."""
        return udot - axis_acceleration(self.model, u) if self.model.balls else udot

    # Inverse dynamics and its parts.

    def inverse_dynamics(self, q: Vector, u: Vector, udot: Vector, wrench: Any,
                         parameters: Vector) -> Vector:
        """Return tau = M udot + bias - external, (n,), by RNEA."""
        load = self.rigid_dynamics(q, u, udot, wrench, parameters)
        return load + self.friction_force(u, load)

    def rigid_dynamics(self, q: Vector, u: Vector, udot: Vector, wrench: Any,
                       parameters: Vector) -> Vector:
        """Return inverse dynamics without friction, (n,)."""
        x = joint_positions(self.model, q) if self.model.balls else q
        forces = self.body_forces(q, u, udot, wrench, parameters)
        return forces + self.spring_force(x)

    def body_forces(self, q: Vector, u: Vector, udot: Vector, wrench: Any,
                    parameters: Vector) -> Vector:
        """Return inverse dynamics without friction and springs, (n,)."""
        links, x = self._links_at(q, self.base_links(parameters))
        # RNEA of the bodies and rotors. External wrenches relieve the actuators.
        acceleration = self._angle_accelerations(u, udot)
        rigid = inverse_dynamics.inverse_dynamics(links, x, u, acceleration,
                                                  parameters[:3])
        force = rigid + self.rotor_inertia * acceleration
        return force if wrench is None else force - self.external_force(q, wrench)

    def reference_dynamics(self, q: Vector, u: Vector, reference: Vector, udot: Vector,
                           parameters: Vector) -> Vector:
        """
        Return M udot + C(q, u) reference + gravity + springs, (n,), without friction.

        C is `coriolis_matrix`, with dM/dt = C + C^T: unlike the bias force of u, C(q, u)
        times a reference does no work on the difference u - reference. C(q, u) u is
        quadratic in u, so that C(q, u) w is its rate of change along w / 2.
        """
        links, x = self._links_at(q, self.base_links(parameters))
        acceleration = udot
        if self.model.balls:
            acceleration = udot - axis_rates(self.model, u) @ reference
        # All other forces are linear, and are their own rates. The values of the dual
        # numbers are those of the bias force, where a program needs that, too.
        gravity = parameters[:3]
        forces = inverse_dynamics.inverse_dynamics(
            links, x, moving(u, 0.5 * reference), moving(self.zeros, acceleration),
            moving(gravity, gravity))
        return (rates(forces) + self.rotor_inertia * acceleration
                + self.spring_force(x))

    def bias_force(self, q: Vector, u: Vector, parameters: Vector) -> Vector:
        """Return the bias force h(q, u) without external wrenches, (n,)."""
        return self.inverse_dynamics(q, u, self.zeros, None, parameters)

    def gravity_force(self, q: Vector, parameters: Vector) -> Vector:
        """Return the gravity compensation torque, (n,)."""
        links, x = self._links_at(q, self.base_links(parameters))
        return inverse_dynamics.inverse_dynamics(links, x, self.zeros, self.zeros,
                                                 parameters[:3])

    def external_force(self, q: Vector, wrench: Any) -> Vector:
        """Return the generalized force of wrenches (k, 6) at their frames, (n,)."""
        force = self.zeros
        if wrench is not None:
            for frame, frame_wrench in zip(self.wrench_frames, wrench):
                force = force + self.partial_velocities(frame, q).T @ frame_wrench
        return force

    def torque_terms(self, q: Vector, u: Vector, udot: Vector,
                     parameters: Vector) -> Matrix:
        """Return the terms of inverse dynamics, (5, n), rows as `TORQUE_TERMS`."""
        links, x = self._links_at(q, self.base_links(parameters))
        at_rest = self.zeros
        inertia = inverse_dynamics.inverse_dynamics(links, x, at_rest, udot, NO_GRAVITY)
        inertia = inertia + self.rotor_inertia * udot
        # At u' = 0 the local angles of ball joints accelerate: a part of the Coriolis
        # forces.
        acceleration = self._angle_accelerations(u, self.zeros)
        coriolis = inverse_dynamics.inverse_dynamics(links, x, u, acceleration,
                                                     NO_GRAVITY)
        gravity = self.gravity_force(q, parameters)
        spring = self.spring_force(x)
        load = inertia + coriolis + gravity + spring if self.carries_loads else None
        return np.stack([inertia, coriolis, gravity, self.friction_force(u, load), spring])

    def body_torques(self, q: Vector, u: Vector, udot: Vector,
                     parameters: Vector) -> Matrix:
        """Return torques due to each body, its payload, elasticity, (n_bodies, n)."""
        links, x = self._links_at(q, self._loaded(self.geometry, parameters))
        torques = joint_reactions.body_torques(links, x, u,
                                               self._angle_accelerations(u, udot),
                                               parameters[:3])
        # Elastic forces of a beam are in the row of its body.
        for row, body in zip(torques, self.model.bodies):
            if body.beam is not None:
                modes = list(body.beam.coordinates)
                row[modes] = row[modes] + self.elastic_force(body.beam, x, u)
        return torques

    def joint_reactions(self, q: Vector, u: Vector, udot: Vector, wrench: Any,
                        parameters: Vector) -> Matrix:
        """Return reactions of parents on children, (n_bodies, 6), world axes."""
        wrenches = () if wrench is None else tuple(zip(self.wrench_frames, wrench))
        links, x = self._links_at(q, self._loaded(self.joint_links, parameters))
        reactions = joint_reactions.joint_reactions(
            links, x, u, self._angle_accelerations(u, udot), parameters[:3], wrenches)
        return np.array(reactions).reshape(len(reactions), 6)

    def regressor(self, q: Vector, u: Vector, udot: Vector, parameters: Vector,
                  share: Share = directly) -> Matrix:
        """Return the joint torque regressor of the rigid bodies, (n, 10 n_bodies)."""
        links, x = self._links_at(q, self.joint_links)
        return regressor.regressor(links, x, u, self._angle_accelerations(u, udot),
                                   parameters[:3], share)

    # Mass matrix and forward dynamics.

    def mass_matrix(self, q: Vector, parameters: Vector) -> Matrix:
        """Return the mass matrix with armature, (n, n), by CRBA."""
        links, x = self._links_at(q, self.base_links(parameters))
        return composite_inertia.mass_matrix(links, x) + np.diag(self.rotor_inertia)

    def inverse_mass_matrix(self, q: Vector, parameters: Vector) -> Matrix:
        """Return the inverse mass matrix, (n, n), by LTDL."""
        return inverse(self.factors(self.mass_matrix(q, parameters)), self.order)

    def factors(self, M: Matrix, order: list[int] | None = None,
                factorized: Any = factorize) -> Any:
        """
        Return the LTDL factorization of a mass matrix; ModelError if it is singular.

        `order` is that of the coordinates, parents first by default.
        """
        try:
            return factorized(M, order or self.order, watched=self.without_own_inertia)
        except ZeroDivisionError as error:
            name = self.model.joint_names[error.args[0]]
            raise ModelError(f"the mass matrix is singular: joint '{name}' moves no "
                             'mass; expected a body with inertia or a joint with '
                             'armature') from None

    def forward_dynamics(self, q: Vector, u: Vector, tau: Vector, wrench: Any,
                         parameters: Vector) -> Vector:
        """Return udot = M^-1 (tau + external - bias), (n,), by CRBA and LTDL."""
        if self._free_balls:
            return self._forward_dynamics_of_free_bodies(q, u, tau, wrench, parameters)
        # M udot = tau - bias, with the bias less the external forces.
        if self.carries_loads:
            # The loads L that pass the drives satisfy tau = L + friction(u, L): in
            # M udot = L - bias, the bias has no friction.
            bias = self.rigid_dynamics(q, u, self.zeros, wrench, parameters)
            load = self.drive_loads(u, tau)
            M = self.mass_matrix(q, parameters)
            return solve(self.factors(M), self.order, load - bias)
        bias = self.inverse_dynamics(q, u, self.zeros, wrench, parameters)
        M = self.mass_matrix(q, parameters)
        return solve(self.factors(M), self.order, tau - bias)

    @lazy_property
    def has_simple_joints(self) -> bool:
        """Return whether rigid bodies have a coordinate each, and friction no load."""
        if self.flexible or self.carries_loads:
            return False
        return len(self.model.bodies) == self.n == self.n_q

    def accelerations_by_articulated_inertias(self, q: Vector, u: Vector, tau: Vector,
                                              wrench: Any, parameters: Vector,
                                              share: Share = directly) -> Vector:
        """Return `forward_dynamics` of a tree with simple joints, (n,), in linear time."""
        # Friction, springs and wrenches act on the joints; gravity accelerates the base.
        torque = (self.drive_loads(u, tau) - self.spring_force(q)
                  + self.external_force(q, wrench))
        return articulated_inertia.forward_dynamics(
            self.base_links(parameters), q, u, torque, self.rotor_inertia, parameters[:3],
            share)

    def _forward_dynamics_of_free_bodies(self, q: Vector, u: Vector, tau: Vector,
                                         wrench: Any,
                                         parameters: Vector) -> Vector:
        """
        Return udot of a tree with free bodies, (n,).

        In this function, the speeds of a free body are the velocity of its origin along
        its own axes at this instant. Their rows of M are the mass and the first moment of
        all that moves with the body. Eliminated first, they leave the M of motions about
        the center of mass. A body with several branches is the exception: elimination
        would fill the entries of M that are zero between its branches.
        """
        slides: dict[int, slice] = {}
        for ball in self._free_balls:
            slides[ball.body] = slice(ball.speed - 3, ball.speed)
        links: Sequence[Link] = posed(self.base_links(parameters), self.model, q,
                                      list(slides))
        if self.flexible:
            links = bent(links, joint_positions(self.model, q))
        geometry = posed(self.geometry, self.model, q, list(slides))
        x = joint_positions(self.model, q)
        R = rotations(self.model, q)
        applied = self.drive_loads(u, tau)
        for body, slide in slides.items():
            # No other force depends on the position and velocity of the origin.
            x[slide] = 0.0
            applied[slide] = R[body].T @ applied[slide]

        # M udot = applied - bias, along the body's axes.
        acceleration = self._angle_accelerations(u, self.zeros)
        bias = (inverse_dynamics.inverse_dynamics(links, x, u, acceleration,
                                                  parameters[:3])
                + self.rotor_inertia * acceleration + self.spring_force(x))
        if wrench is not None:
            for frame, w in zip(self.wrench_frames, wrench):
                J = frame_kinematics.partial_velocities(geometry, frame, x)
                bias = bias - J.T @ w
        M = composite_inertia.mass_matrix(links, x) + np.diag(self.rotor_inertia)
        order = self._free_order
        udot = solve(self.factors(M, order), order, applied - bias)
        for body, slide in slides.items():  # back to world axes
            udot[slide] = R[body] @ udot[slide]
        return udot

    def _unloaded(self, free_balls: Sequence[Ball]) -> list[Ball]:
        """Return the free bodies whose slides carry no payload or wrench."""
        # A payload or wrench on a slide would be at another body than the free one.
        loaded = []
        for frame in (self.payload_frame, *self.wrench_frames):
            if frame is not None:
                loaded.append(frame.body)
        unloaded = []
        for ball in free_balls:
            slides = range(ball.body - 3, ball.body)
            if not set(slides).intersection(loaded):
                unloaded.append(ball)
        return unloaded

    @lazy_property
    def _free_order(self) -> list[int]:
        """Return `order`, but slides last if the free body carries one chain."""
        parents = [body.parent for body in self.model.bodies]
        # Bodies with several children, and the bodies that carry them.
        carriers: set[int] = set()
        for body in set(parents) - {WORLD}:
            if parents.count(body) > 1:
                carriers.update(self.model.path(body))
        slides: list[int] = []
        for ball in self._free_balls:
            if ball.body not in carriers:
                slides.extend(range(ball.speed - 3, ball.speed))
        return [k for k in self.order if k not in slides] + slides

    # Derivatives.

    def coriolis_matrix(self, q: Vector, u: Vector, parameters: Vector,
                        share: Share = directly) -> Matrix:
        """
        Return the Coriolis matrix, (n, n), from Christoffel symbols: 1/2 d(C u)/du.

        With ball joints, C = C_theta - M A with gamma = A u: C_theta are the Christoffel
        symbols in the local angles, and u = (1 + A dt) theta'.
        """
        links, x = self._links_at(q, self.base_links(parameters))
        if not self.model.balls:
            return self._christoffel(links, x, u, share)
        M = composite_inertia.mass_matrix(links, x)
        return self._christoffel(links, x, u, share) - M @ axis_rates(self.model, u)

    def _christoffel(self, links: Sequence[Link], x: Vector, u: Vector,
                     share: Share) -> Matrix:
        """Return the Coriolis matrix in joint positions x, (n, n)."""
        if self.flexible:  # the analytic derivatives are those of rigid bodies
            columns = [rates(inverse_dynamics.inverse_dynamics(
                links, x, moving(u, unit), self.zeros,
                NO_GRAVITY)) for unit in np.eye(self.n)]
            return 0.5 * np.stack(columns, axis=1)
        return 0.5 * inverse_dynamics_derivatives(links, x, u, self.zeros, NO_GRAVITY,
                                                  share)[1]

    def inverse_dynamics_derivatives(self, q: Vector, u: Vector, udot: Vector,
                                     parameters: Vector,
                                     share: Share = directly) -> Matrix:
        """
        Return dtau/dq, dtau/du and dtau/dudot = M, (3, n, n), without external wrenches.

        The bodies are rigid, and there are no ball joints.
        """
        rigid = inverse_dynamics_derivatives(self.base_links(parameters), q, u, udot,
                                             parameters[:3], share)
        if not self.carries_loads:
            return rigid + np.stack(self.joint_slopes(q, u))
        # tau = L + friction(u, L): dtau = (1 + dfriction/dL) dL + dfriction/du du
        load = self.rigid_dynamics(q, u, udot, None, parameters)
        stiffness, friction, armature = self.joint_slopes(q, u, load)
        # What depends on the load first; then the rows are scaled by 1 + dfriction/dL.
        # The damping of drives, a part of the load, is in the slopes of friction once.
        of_load = rigid + np.stack([stiffness, np.diag(self.zeros), armature])
        by_load = self.load_slope(u, load)
        by_q, by_u, by_udot = (1.0 + by_load)[:, None] * of_load
        damping = drive_matrix(self.model, damping_slope)
        by_u = by_u + friction + by_load[:, None] * damping
        return np.stack([by_q, by_u, by_udot])

    def joint_slopes(self, q: Vector, u: Vector,
                     load: Vector | None = None) -> tuple[Matrix, Matrix, Matrix]:
        """
        Return the derivatives of springs, friction and armature, (n, n) each.

        Diagonal, but for the springs and dampers of drives.
        """
        springs = [joint.multiplier**2 * joint.stiffness for joint in self.joints]
        stiffness = np.diag(self._by_coordinate(springs))
        friction = np.diag(self.friction_slope(u, load))
        if self.drives:
            stiffness = stiffness + drive_matrix(self.model, spring_slope, q)
            if self.friction:
                friction = friction + drive_matrix(self.model, damping_slope)
        return stiffness, friction, np.diag(self.rotor_inertia)

    def forward_dynamics_derivatives(self, q: Vector, u: Vector, tau: Vector,
                                     parameters: Vector) -> Matrix:
        """Return dudot/dq, dudot/du and dudot/dtau, (3, n, n), no external wrenches."""
        udot = self.forward_dynamics(q, u, tau, None, parameters)
        # The differential of tau = M udot + bias, of inverse dynamics, gives
        # M dudot = dtau - (dtau/dq) dq - (dtau/du) du.
        by_q, by_u, _ = self.inverse_dynamics_derivatives(q, u, udot, parameters)
        W = self.inverse_mass_matrix(q, parameters)
        if self.carries_loads:
            # dtau/dudot is M with rows times 1 + dfriction/dL.
            load = self.drive_loads(u, tau)
            W = W * (1.0 / (1.0 + self.load_slope(u, load)))
        return np.stack([-(W @ by_q), -(W @ by_u), W])

    # Forces along the joints: rotor inertia, friction and springs.

    def transmitted(self, u: Vector, load: Vector | None) -> Vector:
        """
        Return the loads L that the drives transmit, (n,), on which friction depends.

        `load`, (n,), is the torque of the motion without friction and damping; None for
        drives without load. The gear of an elastic joint also transmits the torque D
        delta' of its damping, which acts behind the gear, in parallel with its spring.
        """
        if load is None:
            return self.zeros
        return load + self._drive_damping(u) if self.drives else load

    def _drive_damping(self, u: Vector) -> Vector:
        """Return the torque of the damping of all drives, (n,)."""
        return drive_forces(self.model, u, damping_torque)

    def friction_force(self, u: Vector, load: Vector | None = None,
                       directions: Vector | None = None,
                       deflections: Vector | None = None) -> Vector:
        """
        Return the torque that overcomes friction, (n,), by `friction.friction_torque`.

        `load`, (n,), is as of `transmitted`; None for drives without load. `directions`,
        (n,), are those of sliding in the set-valued law, -1, 1, or 0 of a joint at rest;
        None for the smooth law. `deflections` are those of `bristles`; None for the law
        without presliding.
        """
        if not self.friction:
            return self.zeros
        loads = self.transmitted(u, load)
        deflection_of = {} if deflections is None else self._by_bristle(deflections)

        # The law of each joint, at the rate of the joint itself (a mimic joint:
        # multiplier times).
        forces = []
        for joint in self.joints:
            k = joint.coordinate
            rate = joint.multiplier * u[k]
            if joint.name in deflection_of:
                torque = bristle_torque(joint, rate, deflection_of[joint.name], loads[k])
            elif directions is None:
                torque = friction_torque(joint, rate, loads[k])
            else:
                direction = self._direction(directions, joint)
                torque = friction_torque(joint, rate, loads[k], direction)
            forces.append(joint.multiplier * torque)

        # Damping of beams and drives has matrices of its own.
        friction = self._by_coordinate(forces)
        return self._with_damping(friction, u) if self.is_damped else friction

    def _direction(self, directions: Vector, joint: Joint) -> Scalar:
        """Return the direction in which a joint slides."""
        # A joint with a negative multiplier slides against its coordinate.
        direction = math.copysign(1.0, joint.multiplier) * directions[joint.coordinate]
        # Of the joints of one coordinate at its bound, some may have no drop.
        beside = [other for other in self.joints if other.coordinate == joint.coordinate]
        if not has_breakaway_drop(joint) and any(map(has_breakaway_drop, beside)):
            direction = direction_of_sliding(direction)
        return direction

    def scaled_friction(self, u: Vector, factors: Vector | None = None,
                        directions: Vector | None = None,
                        deflections: Vector | None = None) -> Vector:
        """
        Return `friction_force` without loads, with factors (n,) on that of the joints.

        The damping of drives acts on two joints alike and has no factor.
        """
        friction = self.friction_force(u, None, directions, deflections)
        if factors is None:
            return friction
        scaled: Vector = factors * friction
        # The factors are on the joints' friction, not on the dampers of drives.
        if self.model.drives and self.friction:
            scaled = scaled + (1.0 - factors) * self._drive_damping(u)
        return scaled

    def feedforward_friction(self, u: Vector, udot: Vector,
                             load: Vector | None = None) -> Vector:
        """
        Return the friction that a command compensates in a desired motion, (n,).

        It differs from `friction_force` at rest and at reversals, by the choice
        `feedforward_friction`. `load` is as of `friction_force`.
        """
        choice = self.feedforward_choice
        if not self.friction or choice == DESIRED_SPEED:
            return self.friction_force(u, load)
        loads = self.transmitted(u, load)

        # Of each joint, the direction is that of the desired motion, not of the speed.
        forces = []
        for joint in self.joints:
            k = joint.coordinate
            rate = joint.multiplier * u[k]
            acceleration = joint.multiplier * udot[k]
            direction = feedforward_direction(joint, rate, acceleration, choice)
            torque = friction_torque(joint, rate, loads[k], direction)
            forces.append(joint.multiplier * torque)
        friction = self._by_coordinate(forces)
        return self._with_damping(friction, u) if self.is_damped else friction

    def _with_damping(self, friction: Vector, u: Vector) -> Vector:
        """Return the friction of the joints plus the damping of drives and beams, (n,)."""
        if self.drives:
            friction = friction + self._drive_damping(u)
        if self.flexible:
            friction = self._with_beams(
                friction, lambda beam: beam.damping @ u[list(beam.coordinates)])
        return friction

    def deflection_rates(self, u: Vector, deflections: Vector,
                         load: Vector | None = None) -> Vector:
        """Return the rates of the deflections of `bristles`, (n_b,), rad/s or m/s."""
        loads = self.transmitted(u, load)
        rates = []
        for joint, deflection in zip(self.bristles, deflections):
            k = joint.coordinate
            rate = joint.multiplier * u[k]
            rates.append(bristle_rate(joint, rate, deflection, loads[k]))
        return np.array(rates)

    def deflections_after(self, u: Vector, deflections: Vector, load: Vector | None,
                          travel: Vector) -> Vector:
        """
        Return the deflections of `bristles`, (n_b,), after a travel, (n,), one way.

        `u` are the rates of the motion, of which the sizes count.
        """
        loads = self.transmitted(u, load)
        later = []
        for joint, deflection in zip(self.bristles, deflections):
            k = joint.coordinate
            rate = joint.multiplier * u[k]
            slip = joint.multiplier * travel[k]
            later.append(deflection_after(joint, rate, deflection, loads[k], slip))
        return np.array(later)

    def bristle_energy(self, deflections: Vector) -> Scalar:
        """Return the energy of all bristles, J."""
        energy: Scalar = 0.0
        for joint, deflection in zip(self.bristles, deflections):
            energy = energy + bristle_energy(joint, deflection)
        return energy

    def bristle_power(self, deflections: Vector, rates: Vector) -> Scalar:
        """Return the rate of `bristle_energy`, W, for the rates of the deflections."""
        power: Scalar = 0.0
        for joint, z, rate in zip(self.bristles, deflections, rates):
            power = power + joint.presliding_stiffness * z * rate
        return power

    def friction_slope(self, u: Vector, load: Vector | None = None) -> Vector:
        """Return d friction_force / du, (n,)."""
        if not self.friction:
            return self.zeros
        loads = self.transmitted(u, load)

        slopes = []
        for joint in self.joints:
            k = joint.coordinate
            slope = friction_slope(joint, joint.multiplier * u[k], loads[k])
            slopes.append(joint.multiplier**2 * slope)
        return self._by_coordinate(slopes)

    def load_slope(self, u: Vector, load: Vector) -> Vector:
        """Return d friction_force / d load, (n,)."""
        # No joint that mimics another has load friction.
        loads = self.transmitted(u, load)
        slopes = []
        for joint in self.joints:
            k = joint.coordinate
            slopes.append(load_slope(joint, u[k], loads[k]))
        return self._by_coordinate(slopes)

    def drive_loads(self, u: Vector, tau: Vector,
                    factors: Vector | None = None,
                    directions: Vector | None = None,
                    deflections: Vector | None = None) -> Vector:
        """
        Return the torque of the motion without friction, (n,), the `load` of `transmitted`.

        With tau = L + factors friction(u, L) it is L less the damping of drives.
        `factors`, (n,), are 1 by default; `directions` and `deflections` are as of
        `friction_force`.
        """
        loads = tau - self.scaled_friction(u, factors, directions, deflections)
        if not self.carries_loads:
            return loads
        if directions is None:
            require_solvable(self.model)
        deflection_of = {} if deflections is None else self._by_bristle(deflections)
        # `loads` have neither damping nor friction: the drives transmit damping, too.
        damping = self._drive_damping(u)
        for joint in self.model.coordinate_joints:
            k = joint.coordinate
            if joint.name in deflection_of:
                # Its bristles bear what does not depend on the load.
                z = deflection_of[joint.name]
                borne = elastic_bristle_torque(joint, u[k], z)
                loads[k] = loads[k] + bristle_torque(joint, u[k], z) - borne
            elif carries_load(joint):
                # Friction without load, that of joints which mimic this one included.
                factor = 1.0 if factors is None else factors[k]
                direction = None
                if directions is not None:
                    direction = self._direction(directions, joint)
                unloaded = friction_torque(joint, u[k], 0.0, direction)
                torque = loads[k] + damping[k] + factor * unloaded
                transmitted = load_of_drive(joint, u[k], torque, direction, factor)
                loads[k] = transmitted - damping[k]
        return loads

    def spring_force(self, x: Vector) -> Vector:
        """Return the torque of springs, of drives and of beams K eta, (n,)."""
        forces = []
        for joint in self.joints:
            stretch = position(joint, x) - joint.rest
            forces.append(joint.multiplier * joint.stiffness * stretch)
        springs = self._by_coordinate(forces)
        # Springs of drives act between two coordinates, those of beams on their modes.
        if self.drives:
            springs = springs + drive_forces(self.model, x, spring_torque)
        if self.flexible:
            springs = self._with_beams(
                springs, lambda beam: beam.stiffness @ x[list(beam.coordinates)])
        return springs

    def elastic_force(self, beam: Beam, x: Vector, u: Vector) -> Vector:
        """Return the force that balances a beam's elasticity and damping, (m,)."""
        modes = list(beam.coordinates)
        force = beam.stiffness @ x[modes]
        return force + beam.damping @ u[modes] if self.friction else force

    def _with_beams(self, total: Vector, force: Callable[[Beam], Vector]) -> Vector:
        """Return a force, (n,), plus the force of all beams on their modes."""
        result = list(total)
        for body in self.model.bodies:
            if body.beam is not None:
                for k, value in zip(body.beam.coordinates, force(body.beam)):
                    result[k] = result[k] + value
        return np.array(result)

    def _by_bristle(self, deflections: Vector) -> dict[str, Scalar]:
        """Return the deflections by the names of their joints."""
        return dict(zip(self.bristle_names, deflections, strict=True))

    def _by_coordinate(self, values: Sequence[Scalar]) -> Vector:
        """Sum a value of every joint on its coordinate, (n,)."""
        total: list[Scalar] = [0.0] * self.n
        for joint, value in zip(self.joints, values):
            total[joint.coordinate] = total[joint.coordinate] + value
        return np.array(total)

    # Energies, center of mass and frames.

    def kinetic_energy(self, q: Vector, u: Vector, parameters: Vector) -> Scalar:
        """Return the kinetic energy including the rotors (armature), J."""
        links, x = self._links_at(q, self._loaded(self.geometry, parameters))
        of_rotors = 0.5 * (u @ (self.rotor_inertia * u))
        return inverse_dynamics.kinetic_energy(links, x, u) + of_rotors

    def potential_energy(self, q: Vector, parameters: Vector) -> Scalar:
        """Return the potential energy of gravity and springs, J."""
        links, x = self._links_at(q, self._loaded(self.geometry, parameters))
        springs: Scalar = 0.0
        # Springs of joints, of beams, and between motors and links.
        for body in self.model.bodies:
            stretch = position(body.joint, x) - body.joint.rest
            springs = springs + 0.5 * body.joint.stiffness * (stretch * stretch)
            if body.beam is not None:
                eta = x[list(body.beam.coordinates)]
                springs = springs + 0.5 * (eta @ (body.beam.stiffness @ eta))
        for _, drive, link, motor in self.drives:
            springs = springs + spring_energy(drive, x[motor] - x[link])
        return inverse_dynamics.potential_energy(links, x, parameters[:3]) + springs

    def center_of_mass(self, q: Vector, parameters: Vector) -> Vector:
        """Return the center of mass of the moving bodies and the payload, (3,), m."""
        links, x = self._links_at(q, self._loaded(self.geometry, parameters))
        return masses.center_of_mass(links, x)

    def center_of_mass_jacobian(self, q: Vector, parameters: Vector) -> Matrix:
        """Return the velocity of the center of mass per unit of each speed, (3, n)."""
        links, x = self._links_at(q, self._loaded(self.geometry, parameters))
        return masses.center_of_mass_jacobian(links, x)

    def centroidal_momentum_matrix(self, q: Vector, parameters: Vector) -> Matrix:
        """Return linear and angular momentum per unit of each speed, (6, n)."""
        links, x = self._links_at(q, self._loaded(self.geometry, parameters))
        return masses.centroidal_momentum_matrix(links, x)

    def centroidal_momentum_rate(self, q: Vector, u: Vector, udot: Vector,
                                 parameters: Vector) -> Vector:
        """Return the rate of the centroidal momentum, (6,), by RNEA."""
        links, x = self._links_at(q, self._loaded(self.joint_links, parameters))
        reactions = joint_reactions.joint_reactions(
            links, x, u, self._angle_accelerations(u, udot), NO_GRAVITY, ())
        return masses.resultant(links, x, reactions)

    def frame_pose(self, frame: Frame, q: Vector) -> Matrix:
        """Return the homogeneous transformation from the frame to the world, (4, 4)."""
        links, x = self._links_at(q, self.geometry)
        return frame_kinematics.frame_pose(links, frame, x)

    def frame_velocity(self, frame: Frame, q: Vector, u: Vector) -> Vector:
        """Return the linear, then angular velocity of a frame, (6,)."""
        return self._frame_motion(frame, q, u, self.zeros)[0]

    def frame_acceleration(self, frame: Frame, q: Vector, u: Vector,
                           udot: Vector) -> Vector:
        """Return the linear, then angular acceleration of a frame, (6,)."""
        return self._frame_motion(frame, q, u, self._angle_accelerations(u, udot))[1]

    def _frame_motion(self, frame: Frame, q: Vector, u: Vector,
                      acceleration: Vector) -> Matrix:
        """Return velocity and acceleration of a frame, (2, 6), for local angles."""
        poses = frame_kinematics.LinkPoses(*self._links_at(q, self.geometry))
        return frame_kinematics.frame_motion(frame, poses, u, acceleration)

    def partial_velocities(self, frame: Frame, q: Vector) -> Matrix:
        """Return the Jacobian (partial velocities), (6, n): linear, then angular."""
        links, x = self._links_at(q, self.geometry)
        return frame_kinematics.partial_velocities(links, frame, x)

    def partial_velocity_rates(self, frame: Frame, q: Vector, u: Vector) -> Matrix:
        """Return the time derivative of the Jacobian (partial velocities), (6, n)."""
        links, x = self._links_at(q, self.geometry)
        J_rate = frame_kinematics.partial_velocity_rates(links, frame, x, u)
        if not self.model.balls:
            return J_rate
        J = frame_kinematics.partial_velocities(links, frame, x)
        return J_rate - J @ axis_rates(self.model, u)  # as in `coriolis_matrix`

    def joint_origins(self, q: Vector) -> list[Vector]:
        """Return the joint origins of all bodies, (3,) each, m, world axes."""
        poses = frame_kinematics.link_poses(*self._links_at(q, self.joint_links))
        return [origin for _, origin in poses]


def _parents_first(model: Model) -> list[int]:
    """Return the coordinates, parents first: the order of the LTDL factorization."""
    coordinates: list[int] = []
    # The sections of a beam have no coordinates of their own; the beam lists its modes.
    for body in model.bodies:
        if body.joint.deflection is None:
            coordinates.append(body.joint.coordinate)
        if body.beam is not None:
            coordinates.extend(body.beam.coordinates)
    return list(dict.fromkeys(coordinates))


def _without_own_inertia(model: Model, free_balls: Sequence[Ball]) -> frozenset[int]:
    """
    Return the coordinates that may move without kinetic energy in some configuration.

    The factorization of M has a pivot for each coordinate. It is positive if the inertia
    of the coordinate's own body, or its rotor, resists a motion of this joint alone. A
    body without mass, or a thin rod that turns about itself, has no such inertia: M may
    be singular at these coordinates, and nowhere else.
    """
    # The slides of a free body are eliminated first, which leaves motions about its
    # center of mass.
    central = [ball.body + 2 for ball in free_balls]
    resisted: dict[int, bool] = {}  # by the first body of each coordinate
    for k, body in enumerate(model.bodies):
        joint = body.joint
        if joint.deflection is not None or not joint.multiplier:
            continue
        if joint.coordinate not in resisted:
            resisted[joint.coordinate] = _own_inertia_resists(body, k in central)
    return frozenset(k for k, resists in resisted.items() if not resists)


def position(joint: Joint, x: Vector) -> Scalar:
    """Return the position of a joint, rad or m."""
    return joint.multiplier * x[joint.coordinate] + joint.offset


def _own_inertia_resists(body: Body, central: bool) -> bool:
    """
    Return whether a body's inertia, or its joint's rotor, resists the joint's motion.

    `central` says that the body's center of mass may stay at rest.
    """
    joint, inertial = body.joint, body.inertial
    if joint.armature > 0.0 or joint.kind == 'prismatic':
        return joint.armature > 0.0 or inertial.mass > 0.0
    # Inertia about the joint's origin, by the parallel axis theorem.
    lever = np.dot(inertial.com, inertial.com)
    offset = lever * np.eye(3) - np.outer(inertial.com, inertial.com)
    mass = 0.0 if central else inertial.mass
    about_joint = inertial.inertia + mass * offset
    return bool(joint.axis @ about_joint @ joint.axis > RESISTS * np.trace(about_joint))
