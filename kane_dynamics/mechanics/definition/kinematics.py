"""
Forward kinematics of all bodies in world axes: poses, Jacobians, velocities, accelerations.

Reference formulation after Kane & Levinson, Dynamics: Theory and Applications (1985), chapter 2,
written for readability; `recursive` is the compiled formulation. Works on any scalar type.

A partial velocity is the coefficient of a speed u_r in a velocity: a column of the Jacobian. The
partial velocities of a body are the rows of an (n, 3) array, so that omega = sum_r omega^r u_r is
``u @ partial_angular_velocity``.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from kane_dynamics.mechanics.algebra.vector import axis_rotation, cross, skew
from kane_dynamics.mechanics.ball_joints import joint_positions, rotations
from kane_dynamics.model.model import Frame, Joint, Model, WORLD
import numpy as np


@dataclass(frozen=True, eq=False)
class Configuration:
    """
    Pose and Jacobian (partial velocities) of a body; a function of q.

    Attributes
    ----------
    R_wb, p_wb : (3, 3), (3,) arrays
        Axes (columns) and origin of the body in the world, m.
    p_com : (3,) array
        Center of mass in the world, m.
    axis : (3,) array
        Axis of the body's joint, world axes.
    partial_angular_velocity : (n, 3) array
        Row r: omega^r.
    partial_velocity_origin, partial_velocity : (n, 3) arrays
        Row r: v^r of the body's origin, and of its center of mass.

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
    Velocity and acceleration of a body; a function of q, u and udot.

    Attributes
    ----------
    omega, alpha : (3,) arrays
        Angular velocity and acceleration, rad/s and rad/s^2.
    v, a : (3,) arrays
        Velocity and acceleration of the body's origin, m/s and m/s^2.
    v_com, a_com : (3,) arrays
        Velocity and acceleration of its center of mass, m/s and m/s^2.

    """

    omega: Any
    alpha: Any
    v: Any
    a: Any
    v_com: Any
    a_com: Any


def position(joint: Joint, q: Any) -> Any:
    """Return the position of a joint, rad or m."""
    bent = joint.deflection
    if bent is None:
        return joint.multiplier * q[joint.coordinate] + joint.offset
    eta = q[list(bent.coordinates)]
    return joint.offset + bent.slope @ eta + 0.5 * (eta @ bent.curvature @ eta)


def partials(joint: Joint, q: Any) -> Any:
    """Return the derivative of a joint's rate with respect to the speeds, (n,)."""
    bent = joint.deflection
    if bent is None:
        return joint.multiplier * np.eye(len(q))[joint.coordinate]
    places = list(bent.coordinates)
    return (bent.slope + bent.curvature @ q[places]) @ np.eye(len(q))[places]


def rate(joint: Joint, u: Any) -> Any:
    """Return a rigid joint's rate from the speeds, or its acceleration from their rates."""
    return joint.multiplier * u[joint.coordinate]


def joint_acceleration(joint: Joint, q: Any, u: Any, udot: Any) -> Any:
    """Return the acceleration of a joint, rad/s^2 or m/s^2."""
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
    q : (n_q,) array of scalars
        Coordinates, rad or m.

    Notes
    -----
    A body has the partial velocities of its parent at the joint, v^r + omega^r x r. Its joint
    adds its multiplier times its axis to the partial angular velocity (revolute) or the partial
    velocity (prismatic) of its coordinate. The axes of a ball joint are those of its body.

    """
    bodies: list[Configuration] = []
    turned, q = rotations(model, q), joint_positions(model, q)
    for k, body in enumerate(model.bodies):
        joint = body.joint
        R, p, w, v = np.eye(3), np.zeros(3), np.zeros((model.n, 3)), np.zeros((model.n, 3))
        if body.parent != WORLD:
            parent = bodies[body.parent]
            R, p = parent.R_wb, parent.p_wb
            w, v = parent.partial_angular_velocity, parent.partial_velocity_origin
        r = R @ joint.translation
        R = R @ joint.rotation
        if k in turned:
            R = R @ turned[k]
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
    q, u, udot : (n_q,), (n,), (n,) arrays of scalars
        Coordinates, speeds and their rates.

    Notes
    -----
    Velocities are sums of partial velocities times speeds. Accelerations are propagated from
    body to body with the centripetal and Coriolis terms. The axes of a ball joint turn with its
    body: the angular velocity w on them has the derivative w' + omega x w, where omega may be
    that of the carrier, since w x w = 0.

    """
    result: list[BodyMotion] = []
    q, carriers = joint_positions(model, q), {
        first + k: model.bodies[first].parent for first in model.balls for k in range(3)}
    for k, (body, here) in enumerate(zip(model.bodies, bodies)):
        joint = body.joint
        alpha, a, omega_parent, r = np.zeros(3), np.zeros(3), np.zeros(3), here.p_wb
        if body.parent != WORLD:
            parent = result[body.parent]
            alpha, a, omega_parent = parent.alpha, parent.a, parent.omega
            r = here.p_wb - bodies[body.parent].p_wb
        a = _point_acceleration(a, omega_parent, alpha, r)
        relative = (partials(joint, q) @ u) * here.axis
        along = joint_acceleration(joint, q, u, udot) * here.axis
        if k in carriers:
            omega_parent = result[carriers[k]].omega if carriers[k] != WORLD else np.zeros(3)
        if joint.kind == 'revolute':
            alpha = alpha + along + cross(omega_parent, relative)
        else:
            a = a + along + 2.0 * cross(omega_parent, relative)
        omega = u @ here.partial_angular_velocity
        result.append(BodyMotion(
            omega, alpha, u @ here.partial_velocity_origin, a, u @ here.partial_velocity,
            _point_acceleration(a, omega, alpha, here.p_com - here.p_wb)))
    return tuple(result)


def frame_pose(model: Model, frame: Frame, q: Any,
               bodies: Sequence[Configuration] | None = None) -> tuple[Any, Any]:
    """
    Return the axes (3, 3, columns) and the origin (3,) of a frame in the world, m.

    `bodies` are the `configurations`, if they are known already.
    """
    if frame.body == WORLD:
        return frame.rotation, frame.translation
    body = (bodies or configurations(model, q))[frame.body]
    return body.R_wb @ frame.rotation, body.p_wb + body.R_wb @ frame.translation


def frame_partial_velocities(model: Model, frame: Frame, q: Any, at: Any = None,
                             bodies: Sequence[Configuration] | None = None) -> Any:
    """
    Return the frame Jacobian, (6, n): column r is v^r, then omega^r; world axes.

    With `at`, (3,), m, it is that of the point of the frame's body at this place; `bodies` as for
    `frame_pose`.
    """
    if frame.body == WORLD:
        return np.zeros((6, model.n))
    body = (bodies or configurations(model, q))[frame.body]
    w = body.partial_angular_velocity
    r = body.R_wb @ frame.translation if at is None else at - body.p_wb
    v = body.partial_velocity_origin + w @ skew(r)
    return np.concatenate([v.T, w.T])


def frame_motion(model: Model, frame: Frame, q: Any, u: Any, udot: Any) -> tuple[Any, Any]:
    """Return velocity and acceleration (6,) of a frame, linear first; world axes."""
    if frame.body == WORLD:
        return np.zeros(6), np.zeros(6)
    bodies = configurations(model, q)
    motion = motions(model, bodies, q, u, udot)[frame.body]
    r = bodies[frame.body].R_wb @ frame.translation
    v = motion.v + cross(motion.omega, r)
    a = _point_acceleration(motion.a, motion.omega, motion.alpha, r)
    return np.concatenate([v, motion.omega]), np.concatenate([a, motion.alpha])


def _point_acceleration(a: Any, omega: Any, alpha: Any, r: Any) -> Any:
    """Return the acceleration of a point at r from a point with acceleration a."""
    return a + cross(alpha, r) + cross(omega, cross(omega, r))
