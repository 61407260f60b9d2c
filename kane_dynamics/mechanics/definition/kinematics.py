"""
Kinematics of every body in world axes: poses, partial velocities, velocities, accelerations.

Written to be read beside a textbook (Kane & Levinson, Dynamics: Theory and Applications, 1985,
chapter 2), not to be fast: `recursive` is the form that is compiled. Works on any scalar.

A partial velocity is the coefficient of a speed u_r in a velocity. All those of a body stand as
the rows of one (n, 3) array: omega = sum_r omega^r u_r is ``u @ partial_angular_velocity``.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from kane_dynamics.mechanics.algebra.vector import axis_rotation, cross, skew
from kane_dynamics.model.model import Frame, Joint, Model, WORLD
import numpy as np


@dataclass(frozen=True, eq=False)
class Configuration:
    """
    Where a body is, and how each speed would move it; a function of q alone.

    Attributes
    ----------
    R_wb, p_wb : (3, 3), (3,) arrays
        Axes (columns) and origin of the body in the world, m.
    p_com : (3,) array
        Mass centre in the world, m.
    axis : (3,) array
        Axis of the body's joint, world axes.
    partial_angular_velocity : (n, 3) array
        Row r: omega^r.
    partial_velocity_origin, partial_velocity : (n, 3) arrays
        Row r: v^r of the body's origin, and of its mass centre.

    """

    R_wb: Any
    p_wb: Any
    p_com: Any
    axis: Any
    partial_angular_velocity: Any
    partial_velocity_origin: Any
    partial_velocity: Any


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """
    How a body moves: a function of q, u and udot.

    Attributes
    ----------
    omega, alpha : (3,) arrays
        Angular velocity and acceleration, rad/s and rad/s^2.
    v, a : (3,) arrays
        Velocity and acceleration of the body's origin, m/s and m/s^2.
    v_com, a_com : (3,) arrays
        The same of its mass centre.

    """

    omega: Any
    alpha: Any
    v: Any
    a: Any
    v_com: Any
    a_com: Any


def position(joint: Joint, q: Any) -> Any:
    """Return a joint's position, rad or m."""
    bent = joint.deflection
    if bent is None:
        return joint.multiplier * q[joint.coordinate] + joint.offset
    eta = q[list(bent.coordinates)]
    return joint.offset + bent.slope @ eta + 0.5 * (eta @ bent.curvature @ eta)


def partials(joint: Joint, q: Any) -> Any:
    """Return the coefficients of the speeds in a joint's rate, (n,)."""
    bent = joint.deflection
    if bent is None:
        return joint.multiplier * np.eye(len(q))[joint.coordinate]
    places = list(bent.coordinates)
    return (bent.slope + bent.curvature @ q[places]) @ np.eye(len(q))[places]


def rate(joint: Joint, u: Any) -> Any:
    """Return a joint's rate given the speeds, or its acceleration given their rates."""
    return joint.multiplier * u[joint.coordinate]


def growth(joint: Joint, q: Any, u: Any, udot: Any) -> Any:
    """Return a joint's acceleration."""
    bent = joint.deflection
    if bent is None:
        return rate(joint, udot)
    speed = u[list(bent.coordinates)]
    return partials(joint, q) @ udot + speed @ bent.curvature @ speed


def configurations(model: Model, q: Any) -> tuple[Configuration, ...]:
    """
    Return the configuration of every body.

    Parameters
    ----------
    model : Model
        The mechanism.
    q : (n,) array of scalars
        Coordinates, rad or m.

    Notes
    -----
    A joint adds its multiplier times its axis to the partial angular velocity (revolute) or the
    partial velocity (prismatic) of its coordinate; all else a body takes over from its parent,
    a point at r from the parent's origin having v^r + omega^r x r.

    """
    bodies: list[Configuration] = []
    for body in model.bodies:
        joint = body.joint
        R, p, w, v = np.eye(3), np.zeros(3), np.zeros((model.n, 3)), np.zeros((model.n, 3))
        if body.parent != WORLD:
            parent = bodies[body.parent]
            R, p = parent.R_wb, parent.p_wb
            w, v = parent.partial_angular_velocity, parent.partial_velocity_origin
        r = R @ joint.translation
        R = R @ joint.rotation
        s = R @ joint.axis
        of_joint = np.outer(partials(joint, q), s)
        x = position(joint, q)
        if joint.kind == 'revolute':
            v = v + w @ skew(r)  # rows omega^r x r
            w = w + of_joint
            R = R @ axis_rotation(joint.axis, np.sin(x), np.cos(x))
        else:
            r = r + x * s
            v = v + w @ skew(r) + of_joint
        p = p + r
        c = R @ body.inertial.com
        bodies.append(Configuration(R, p, p + c, s, w, v, v + w @ skew(c)))
    return tuple(bodies)


def motions(model: Model, bodies: Sequence[Configuration], q: Any, u: Any,
            udot: Any) -> tuple[BodyMotion, ...]:
    """
    Return the motion of every body.

    Parameters
    ----------
    model : Model
        The mechanism.
    bodies : sequence of Configuration
        From `configurations`.
    q, u, udot : (n,) arrays of scalars
        Coordinates, speeds and their rates.

    Notes
    -----
    Velocities are the sums of partial velocities times speeds. Accelerations are not (partial
    velocities change): they go from body to body, with the centripetal and Coriolis terms.

    """
    result: list[BodyMotion] = []
    for body, here in zip(model.bodies, bodies):
        joint = body.joint
        alpha, a, omega_parent, r = np.zeros(3), np.zeros(3), np.zeros(3), here.p_wb
        if body.parent != WORLD:
            parent = result[body.parent]
            alpha, a, omega_parent = parent.alpha, parent.a, parent.omega
            r = here.p_wb - bodies[body.parent].p_wb
        a = _carried(a, omega_parent, alpha, r)
        relative = (partials(joint, q) @ u) * here.axis
        along = growth(joint, q, u, udot) * here.axis
        if joint.kind == 'revolute':
            alpha = alpha + along + cross(omega_parent, relative)
        else:
            a = a + along + 2.0 * cross(omega_parent, relative)
        omega = u @ here.partial_angular_velocity
        result.append(BodyMotion(
            omega, alpha, u @ here.partial_velocity_origin, a, u @ here.partial_velocity,
            _carried(a, omega, alpha, here.p_com - here.p_wb)))
    return tuple(result)


def frame_pose(model: Model, frame: Frame, q: Any) -> tuple[Any, Any]:
    """Return axes (3, 3, columns) and origin (3,) of a frame in the world, m."""
    if frame.body == WORLD:
        return frame.rotation, frame.translation
    body = configurations(model, q)[frame.body]
    return body.R_wb @ frame.rotation, body.p_wb + body.R_wb @ frame.translation


def frame_partial_velocities(model: Model, frame: Frame, q: Any) -> Any:
    """Return (6, n): column r is v^r at the frame's origin, then omega^r; world axes."""
    if frame.body == WORLD:
        return np.zeros((6, model.n))
    body = configurations(model, q)[frame.body]
    w = body.partial_angular_velocity
    v = body.partial_velocity_origin + w @ skew(body.R_wb @ frame.translation)
    return np.concatenate([v.T, w.T])


def frame_motion(model: Model, frame: Frame, q: Any, u: Any, udot: Any) -> tuple[Any, Any]:
    """Return velocity and acceleration (6,) at a frame's origin, linear first; world axes."""
    if frame.body == WORLD:
        return np.zeros(6), np.zeros(6)
    bodies = configurations(model, q)
    motion = motions(model, bodies, q, u, udot)[frame.body]
    r = bodies[frame.body].R_wb @ frame.translation
    v = motion.v + cross(motion.omega, r)
    a = _carried(motion.a, motion.omega, motion.alpha, r)
    return np.concatenate([v, motion.omega]), np.concatenate([a, motion.alpha])


def _carried(a: Any, omega: Any, alpha: Any, r: Any) -> Any:
    """Return the acceleration of the point at r from a point that accelerates by a."""
    return a + cross(alpha, r) + cross(omega, cross(omega, r))
