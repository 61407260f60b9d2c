"""
Reference formulation of Kane's equations, F_r + F_r* = 0, as sums over bodies and speeds.

`Robot.verify` compares the compiled kernels with it (Kane & Levinson, Dynamics: Theory and
Applications, 1985, chapters 4 to 6). World axes throughout; works on any scalar type, including
traced values and symbols.

For r = 1..n, over the bodies k, with R_k the resultant of the active forces at the center of mass
and T_k their torque:

    F_r  =   sum_k ( v_k^r . R_k + omega_k^r . T_k )
    F_r* = - sum_k ( v_k^r . m_k a_k* + omega_k^r . (I_k alpha_k + omega_k x I_k omega_k) )

In the code the sum over k is a loop, and the index r is the row of an array. Everywhere q, u and
udot are (n,) arrays of scalars: coordinates, speeds and their rates; rad or m, and s. With ball
joints q has more entries, (n_q,).
"""

from collections.abc import Mapping
from typing import Any

from kane_dynamics.mechanics.algebra.vector import cross
from kane_dynamics.mechanics.ball_joints import joint_positions
from kane_dynamics.mechanics.definition import beams
from kane_dynamics.mechanics.definition.kinematics import (Configuration, configurations,
                                                           frame_partial_velocities, motions,
                                                           position, rate)
from kane_dynamics.mechanics.friction import friction_torque
from kane_dynamics.model.model import Body, Joint, Model
import numpy as np

Wrenches = Mapping[str, tuple[Any, Any]]


def partial_velocities(model: Model, q: Any, frame: str | None = None) -> Any:
    """
    Return the Jacobian (partial velocities), (6, n): column r is v^r, then omega^r.

    Parameters
    ----------
    model, q
        The mechanism and its coordinates.
    frame : str, optional
        Frame whose origin is the reference point. Default: a tuple with one Jacobian per body, at
        its center of mass.

    Raises
    ------
    InputError
        If the frame does not exist; the message lists the valid ones.

    """
    if frame is not None:
        return frame_partial_velocities(model, model.frame(frame), q)
    return tuple(np.concatenate([body.partial_velocity.T, body.partial_angular_velocity.T])
                 for body in configurations(model, q))


def generalized_inertia_force(model: Model, q: Any, u: Any, udot: Any) -> Any:
    """Return the generalized inertia force F_r* of bodies and rotors, (n,), N m or N."""
    bodies = configurations(model, q)
    force: Any = np.zeros(model.n)
    for body, here, motion in zip(model.bodies, bodies, motions(model, bodies, q, u, udot)):
        inertia = central_inertia(body, here)
        torque = inertia @ motion.alpha + cross(motion.omega, inertia @ motion.omega)
        force = force - (here.partial_velocity @ (body.inertial.mass * motion.a_com)
                         + here.partial_angular_velocity @ torque)
        force = force - on_coordinate(model, body.joint, rotor_torque(body.joint, udot))
        if body.beam is not None:
            force = force + beams.inertia_force(body.beam, here, motion,
                                                joint_positions(model, q), u, udot)
    return force


def generalized_active_force(model: Model, q: Any, u: Any, *, tau: Any = None,
                             gravity: Any = None, friction: bool = True,
                             wrenches: Wrenches | None = None) -> Any:
    """
    Return the generalized active force F_r, (n,), N m or N.

    It includes gravity, springs, friction, actuators and external wrenches.

    Parameters
    ----------
    model, q, u
        The mechanism and its state.
    tau : (n,) array of scalars, optional
        Generalized forces of the actuators.
    gravity : (3,) array of scalars, optional
        m/s^2, world axes. Default: the model's.
    friction : bool
        Whether to include damping and Coulomb friction.
    wrenches : mapping of frame name to (force, moment), optional
        External wrenches at the frame's origin, world axes, N and N m.

    """
    g = model.gravity if gravity is None else gravity
    force: Any = np.zeros(model.n)
    x = joint_positions(model, q)
    for body, here in zip(model.bodies, configurations(model, q)):
        force = force + here.partial_velocity @ (body.inertial.mass * g)
        force = force - on_coordinate(model, body.joint, spring_torque(body.joint, x))
        if friction:
            force = force - on_coordinate(
                model, body.joint, friction_torque(body.joint, rate(body.joint, u)))
        if body.beam is not None:
            force = force + beams.weight(body.beam, here, x, g)
            force = force + beams.modal_force(body.beam, x, u, friction)
    for name, (force_at_frame, moment) in (wrenches or {}).items():
        partials = frame_partial_velocities(model, model.frame(name), q)
        force = force + partials[:3].T @ force_at_frame + partials[3:].T @ moment
    return force if tau is None else force + tau


def inverse_dynamics(model: Model, q: Any, u: Any, udot: Any, *, gravity: Any = None,
                     friction: bool = True, wrenches: Wrenches | None = None) -> Any:
    """Return tau, (n,), such that F_r + F_r* = 0; arguments as in the two sums."""
    return -(generalized_active_force(model, q, u, gravity=gravity, friction=friction,
                                      wrenches=wrenches)
             + generalized_inertia_force(model, q, u, udot))


def bias_force(model: Model, q: Any, u: Any, *, gravity: Any = None,
               friction: bool = True) -> Any:
    """Return the bias force h(q, u), (n,): M udot + h = tau + external."""
    return inverse_dynamics(model, q, u, np.zeros(model.n), gravity=gravity, friction=friction)


def gravity_force(model: Model, q: Any, *, gravity: Any = None) -> Any:
    """Return the gravity compensation torque, (n,)."""
    g = model.gravity if gravity is None else gravity
    force: Any = np.zeros(model.n)
    for body, here in zip(model.bodies, configurations(model, q)):
        force = force - here.partial_velocity @ (body.inertial.mass * g)
        if body.beam is not None:
            force = force - beams.weight(body.beam, here, joint_positions(model, q), g)
    return force


def mass_matrix(model: Model, q: Any) -> Any:
    """Return M_rs = sum_k (m v^r . v^s + omega^r . I omega^s) plus rotor inertias, (n, n)."""
    M: Any = np.zeros((model.n, model.n))
    for body, here in zip(model.bodies, configurations(model, q)):
        v, w = here.partial_velocity, here.partial_angular_velocity
        M = M + body.inertial.mass * (v @ v.T) + w @ central_inertia(body, here) @ w.T
        joint = body.joint
        rotor = on_coordinate(model, joint, joint.multiplier * joint.armature)
        M = M + np.diag(rotor)
        if body.beam is not None:
            M = M + beams.mass_matrix(body.beam, here, joint_positions(model, q))
    return M


def forward_dynamics(model: Model, q: Any, u: Any, tau: Any, *, gravity: Any = None,
                     friction: bool = True, wrenches: Wrenches | None = None) -> Any:
    """Return udot, (n,), from M udot = F_r + F_r* at udot = 0; numbers only."""
    force = generalized_active_force(model, q, u, tau=tau, gravity=gravity, friction=friction,
                                     wrenches=wrenches)
    force = force + generalized_inertia_force(model, q, u, np.zeros(model.n))
    return np.linalg.solve(mass_matrix(model, q), force)


def central_inertia(body: Body, here: Configuration) -> Any:
    """Return a body's inertia about its center of mass, (3, 3), world axes, kg m^2."""
    return here.R_wb @ body.inertial.inertia @ here.R_wb.T


def rotor_torque(joint: Joint, udot: Any) -> Any:
    """Return the joint torque that accelerates the rotor, N m or N."""
    return joint.armature * rate(joint, udot)


def spring_torque(joint: Joint, q: Any) -> Any:
    """Return the torque that balances the joint's spring, N m or N."""
    return joint.stiffness * (position(joint, q) - joint.rest)


def on_coordinate(model: Model, joint: Joint, torque: Any) -> Any:
    """Return the generalized force of a joint torque, (n,), with the joint's multiplier."""
    return (joint.multiplier * np.eye(model.n)[joint.coordinate]) * torque
