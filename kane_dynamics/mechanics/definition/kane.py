"""
Kane's equations as they are defined: F_r + F_r* = 0, sums over bodies and speeds.

The reference for everything that is compiled (`Robot.verify` compares with it) and for people who
want to see the method (Kane & Levinson, Dynamics: Theory and Applications, 1985, chapters 4 to
6). World axes throughout; works on any scalar, so it can be traced or fed with symbols.

For r = 1..n, over the bodies k, with R_k the active forces' resultant at the mass centre and T_k
their torque:

    F_r  =   sum_k ( v_k^r . R_k + omega_k^r . T_k )
    F_r* = - sum_k ( v_k^r . m_k a_k* + omega_k^r . (I_k alpha_k + omega_k x I_k omega_k) )

In the code the sum over k is a loop and the index r runs down the rows of arrays.
"""

from collections.abc import Mapping
from typing import Any

from kane_dynamics.mechanics.algebra.vector import cross
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
    Return partial velocities, (6, n): column r is v^r, then omega^r.

    Parameters
    ----------
    model : Model
        The mechanism.
    q : (n,) array of scalars
        Coordinates, rad or m.
    frame : str, optional
        Those at this frame's origin; by default a tuple with those at every body's mass centre.

    Raises
    ------
    InputError
        No such frame; the message lists the valid ones.

    """
    if frame is not None:
        return frame_partial_velocities(model, model.frame(frame), q)
    return tuple(np.concatenate([body.partial_velocity.T, body.partial_angular_velocity.T])
                 for body in configurations(model, q))


def generalized_inertia_force(model: Model, q: Any, u: Any, udot: Any) -> Any:
    """
    Return F_r*, (n,), N m or N: bodies' inertia forces and torques, and the rotors'.

    Parameters
    ----------
    model : Model
        The mechanism.
    q, u, udot : (n,) arrays of scalars
        Coordinates, speeds and their rates; rad or m, and s.

    """
    bodies = configurations(model, q)
    force: Any = np.zeros(model.n)
    for body, here, motion in zip(model.bodies, bodies, motions(model, bodies, q, u, udot)):
        inertia = central_inertia(body, here)
        torque = inertia @ motion.alpha + cross(motion.omega, inertia @ motion.omega)
        force = force - (here.partial_velocity @ (body.inertial.mass * motion.a_com)
                         + here.partial_angular_velocity @ torque)
        force = force - on_coordinate(model, body.joint, rotor_torque(body.joint, udot))
        if body.beam is not None:
            force = force + beams.inertia_force(body.beam, here, motion, q, u, udot)
    return force


def generalized_active_force(model: Model, q: Any, u: Any, *, tau: Any = None,
                             gravity: Any = None, friction: bool = True,
                             wrenches: Wrenches | None = None) -> Any:
    """
    Return F_r, (n,), N m or N: all forces that do work in some motion.

    Parameters
    ----------
    model : Model
        The mechanism.
    q, u : (n,) arrays of scalars
        Coordinates and speeds; rad or m, and s.
    tau : (n,) array of scalars, optional
        Actuators' generalized forces.
    gravity : (3,) array of scalars, optional
        m/s^2, world axes; by default the model's.
    friction : bool
        Whether damping and Coulomb friction act.
    wrenches : mapping of frame name to (force, moment), optional
        What the environment exerts at the frame's origin, world axes, N and N m.

    """
    g = model.gravity if gravity is None else gravity
    force: Any = np.zeros(model.n)
    for body, here in zip(model.bodies, configurations(model, q)):
        force = force + here.partial_velocity @ (body.inertial.mass * g)
        force = force - on_coordinate(model, body.joint, spring_torque(body.joint, q))
        if friction:
            force = force - on_coordinate(
                model, body.joint, friction_torque(body.joint, rate(body.joint, u)))
        if body.beam is not None:
            force = force + beams.weight(body.beam, here, q, g)
            force = force + beams.modal_force(body.beam, q, u, friction)
    for name, (push, moment) in (wrenches or {}).items():
        partials = frame_partial_velocities(model, model.frame(name), q)
        force = force + partials[:3].T @ push + partials[3:].T @ moment
    return force if tau is None else force + tau


def inverse_dynamics(model: Model, q: Any, u: Any, udot: Any, *, gravity: Any = None,
                     friction: bool = True, wrenches: Wrenches | None = None) -> Any:
    """Return the tau, (n,), that makes F_r + F_r* zero; arguments as in the two sums."""
    return -(generalized_active_force(model, q, u, gravity=gravity, friction=friction,
                                      wrenches=wrenches)
             + generalized_inertia_force(model, q, u, udot))


def bias_force(model: Model, q: Any, u: Any, *, gravity: Any = None,
               friction: bool = True) -> Any:
    """Return what torque must hold at udot = 0, (n,): M udot + bias = tau + external."""
    return inverse_dynamics(model, q, u, np.zeros(model.n), gravity=gravity, friction=friction)


def gravity_force(model: Model, q: Any, *, gravity: Any = None) -> Any:
    """Return the torque that holds gravity alone, (n,)."""
    g = model.gravity if gravity is None else gravity
    force: Any = np.zeros(model.n)
    for body, here in zip(model.bodies, configurations(model, q)):
        force = force - here.partial_velocity @ (body.inertial.mass * g)
        if body.beam is not None:
            force = force - beams.weight(body.beam, here, q, g)
    return force


def mass_matrix(model: Model, q: Any) -> Any:
    """Return M_rs = sum_k (m v^r . v^s + omega^r . I omega^s) with the rotors' share, (n, n)."""
    M: Any = np.zeros((model.n, model.n))
    for body, here in zip(model.bodies, configurations(model, q)):
        v, w = here.partial_velocity, here.partial_angular_velocity
        M = M + body.inertial.mass * (v @ v.T) + w @ central_inertia(body, here) @ w.T
        joint = body.joint
        rotor = on_coordinate(model, joint, joint.multiplier * joint.armature)
        M = M + np.diag(rotor)
        if body.beam is not None:
            M = M + beams.mass_matrix(body.beam, here, q)
    return M


def forward_dynamics(model: Model, q: Any, u: Any, tau: Any, *, gravity: Any = None,
                     friction: bool = True, wrenches: Wrenches | None = None) -> Any:
    """Return udot, (n,), for numbers only: M udot = F_r with tau + F_r* at udot = 0."""
    force = generalized_active_force(model, q, u, tau=tau, gravity=gravity, friction=friction,
                                     wrenches=wrenches)
    force = force + generalized_inertia_force(model, q, u, np.zeros(model.n))
    return np.linalg.solve(mass_matrix(model, q), force)


def central_inertia(body: Body, here: Configuration) -> Any:
    """Return a body's inertia about its mass centre, (3, 3), world axes, kg m^2."""
    return here.R_wb @ body.inertial.inertia @ here.R_wb.T


def rotor_torque(joint: Joint, udot: Any) -> Any:
    """Return what accelerating the rotor takes at the joint, N m or N."""
    return joint.armature * rate(joint, udot)


def spring_torque(joint: Joint, q: Any) -> Any:
    """Return what holds the joint's spring, N m or N."""
    return joint.stiffness * (position(joint, q) - joint.rest)


def on_coordinate(model: Model, joint: Joint, torque: Any) -> Any:
    """Return a torque at a joint as generalized force, (n,): the multiplier is its partial."""
    return (joint.multiplier * np.eye(model.n)[joint.coordinate]) * torque
