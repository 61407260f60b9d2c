"""
Forward kinematics in world axes: poses, Jacobians, velocities, accelerations.

Reference formulation after Kane & Levinson, Dynamics: Theory and Applications (1985),
chapter 2, written for readability; `recursive` is the compiled formulation. Works on any
scalar type.

A partial velocity is the coefficient of a speed u_r in a velocity: a column of the
Jacobian. The partial velocities of a body are the rows of an (n, 3) array, so that omega
= sum_r omega^r u_r is ``u @ partial_angular_velocity``.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from kane_dynamics._util.typing import Matrix, Scalar, Vector
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

    R_wb: Matrix
    p_wb: Vector
    p_com: Vector
    axis: Vector
    partial_angular_velocity: Matrix
    partial_velocity_origin: Matrix
    partial_velocity: Matrix


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

    omega: Vector
    alpha: Vector
    v: Vector
    a: Vector
    v_com: Vector
    a_com: Vector


def position(joint: Joint, q: Vector) -> Scalar:
    """Return the position of a joint, rad or m."""
    deflection = joint.deflection
    if deflection is None:
        return joint.multiplier * q[joint.coordinate] + joint.offset
    eta = q[list(deflection.coordinates)]
    second_order = 0.5 * (eta @ deflection.curvature @ eta)
    return joint.offset + deflection.slope @ eta + second_order


def partials(joint: Joint, q: Vector) -> Vector:
    """Return the derivative of a joint's rate with respect to the speeds, (n,)."""
    n = len(q)
    deflection = joint.deflection
    if deflection is None:
        return joint.multiplier * np.eye(n)[joint.coordinate]
    modes = list(deflection.coordinates)
    # d position / d eta = slope + curvature eta.
    return (deflection.slope + deflection.curvature @ q[modes]) @ np.eye(n)[modes]


def rate(joint: Joint, u: Vector) -> Scalar:
    """Return a rigid joint's rate from u, or its acceleration from udot."""
    return joint.multiplier * u[joint.coordinate]


def joint_acceleration(joint: Joint, q: Vector, u: Vector, udot: Vector) -> Scalar:
    """Return the acceleration of a joint, rad/s^2 or m/s^2."""
    deflection = joint.deflection
    if deflection is None:
        return rate(joint, udot)
    # The coefficients of the modal speeds change with the shape: eta'^T curvature eta'.
    modal_speeds = u[list(deflection.coordinates)]
    return partials(joint, q) @ udot + modal_speeds @ deflection.curvature @ modal_speeds


def configurations(model: Model, q: Vector) -> tuple[Configuration, ...]:
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
    A body has the partial velocities of its parent at the joint, v^r + omega^r x r. Its
    joint adds its multiplier times its axis to the partial angular velocity (revolute)
    or the partial velocity (prismatic) of its coordinate. The axes of a ball joint are
    those of its body.

    """
    bodies: list[Configuration] = []
    ball_rotations = rotations(model, q)
    q = joint_positions(model, q)
    for k, body in enumerate(model.bodies):
        joint = body.joint

        # The body starts from its parent; the world is at rest at the origin.
        if body.parent == WORLD:
            R = np.eye(3)
            p = np.zeros(3)
            w = np.zeros((model.n, 3))
            v = np.zeros((model.n, 3))
        else:
            parent = bodies[body.parent]
            R = parent.R_wb
            p = parent.p_wb
            w = parent.partial_angular_velocity
            v = parent.partial_velocity_origin

        # The joint's fixed frame: r leads from the parent's origin to the body's.
        r = R @ joint.translation
        R = R @ joint.rotation
        if k in ball_rotations:
            R = R @ ball_rotations[k]
        axis = R @ joint.axis

        # The joint's motion: a rotation about the axis, or a translation along it.
        x = position(joint, q)
        joint_partials = np.outer(partials(joint, q), axis)
        if joint.kind == 'revolute':
            v = v + w @ skew(r)  # rows omega^r x r
            w = w + joint_partials
            R = R @ axis_rotation(joint.axis, np.sin(x), np.cos(x))
        else:
            r = r + x * axis
            v = v + w @ skew(r) + joint_partials

        p = p + r
        com = R @ body.inertial.com
        v_com = v + w @ skew(com)
        bodies.append(Configuration(R, p, p + com, axis, w, v, v_com))
    return tuple(bodies)


def motions(model: Model, bodies: Sequence[Configuration], q: Vector, u: Vector,
            udot: Vector) -> tuple[BodyMotion, ...]:
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
    Velocities are sums of partial velocities times speeds. Accelerations are propagated
    from body to body with the centripetal and Coriolis terms. The axes of a ball joint
    turn with its body: the angular velocity w on them has the derivative w' + omega x w,
    where omega may be that of the ball joint's parent, since w x w = 0.

    """
    result: list[BodyMotion] = []
    q = joint_positions(model, q)
    ball_parents = _ball_parents(model)
    for k, (body, configuration) in enumerate(zip(model.bodies, bodies)):
        joint = body.joint

        # The parent's point at the body's origin; the world is at rest.
        omega_parent = np.zeros(3)
        if body.parent == WORLD:
            alpha = np.zeros(3)
            a = np.zeros(3)
        else:
            parent = result[body.parent]
            omega_parent = parent.omega
            alpha = parent.alpha
            r = configuration.p_wb - bodies[body.parent].p_wb
            a = _point_acceleration(parent.a, omega_parent, alpha, r)

        # The joint adds its acceleration along the axis, and the axis turns with the
        # parent; the axes of a ball joint turn with its body (see the notes).
        relative_velocity = (partials(joint, q) @ u) * configuration.axis
        acceleration = joint_acceleration(joint, q, u, udot)
        relative_acceleration = acceleration * configuration.axis
        omega_axis = omega_parent
        if k in ball_parents:
            ball_parent = ball_parents[k]
            if ball_parent == WORLD:
                omega_axis = np.zeros(3)
            else:
                omega_axis = result[ball_parent].omega
        if joint.kind == 'revolute':
            alpha = alpha + relative_acceleration + cross(omega_axis, relative_velocity)
        else:
            coriolis = 2.0 * cross(omega_axis, relative_velocity)
            a = a + relative_acceleration + coriolis

        # Velocities are sums of partial velocities times speeds.
        omega = u @ configuration.partial_angular_velocity
        v = u @ configuration.partial_velocity_origin
        v_com = u @ configuration.partial_velocity
        com = configuration.p_com - configuration.p_wb
        a_com = _point_acceleration(a, omega, alpha, com)
        result.append(BodyMotion(omega, alpha, v, a, v_com, a_com))
    return tuple(result)


def _ball_parents(model: Model) -> dict[int, int]:
    """Return the parent of every ball joint, by each of the joint's three bodies."""
    parents = {}
    for first in model.balls:
        for k in range(first, first + 3):
            parents[k] = model.bodies[first].parent
    return parents


def frame_pose(model: Model, frame: Frame, q: Vector,
               bodies: Sequence[Configuration] | None = None) -> tuple[Matrix, Vector]:
    """
    Return the axes (3, 3, columns) and the origin (3,) of a frame in the world, m.

    `bodies` are the `configurations`, if they are known already.
    """
    if frame.body == WORLD:
        return frame.rotation, frame.translation
    body = (bodies or configurations(model, q))[frame.body]
    return body.R_wb @ frame.rotation, body.p_wb + body.R_wb @ frame.translation


def frame_partial_velocities(model: Model, frame: Frame, q: Vector,
                             at: Vector | None = None,
                             bodies: Sequence[Configuration] | None = None) -> Matrix:
    """
    Return the frame Jacobian, (6, n): column r is v^r, then omega^r; world axes.

    With `at`, (3,), m, it is that of the point of the frame's body at this place;
    `bodies` as for `frame_pose`.
    """
    if frame.body == WORLD:
        return np.zeros((6, model.n))
    body = (bodies or configurations(model, q))[frame.body]
    w = body.partial_angular_velocity
    if at is None:
        r = body.R_wb @ frame.translation
    else:
        r = at - body.p_wb
    # v^r = v_O^r + omega^r x r, with a row for each r.
    v = body.partial_velocity_origin + w @ skew(r)
    return np.concatenate([v.T, w.T])


def frame_motion(model: Model, frame: Frame, q: Vector, u: Vector,
                 udot: Vector) -> tuple[Vector, Vector]:
    """Return velocity and acceleration (6,) of a frame, linear first; world axes."""
    if frame.body == WORLD:
        return np.zeros(6), np.zeros(6)
    bodies = configurations(model, q)
    motion = motions(model, bodies, q, u, udot)[frame.body]
    r = bodies[frame.body].R_wb @ frame.translation
    v = motion.v + cross(motion.omega, r)
    a = _point_acceleration(motion.a, motion.omega, motion.alpha, r)
    return np.concatenate([v, motion.omega]), np.concatenate([a, motion.alpha])


def _point_acceleration(a: Vector, omega: Vector, alpha: Vector, r: Vector) -> Vector:
    """Return the acceleration of a point at r from a point with acceleration a."""
    return a + cross(alpha, r) + cross(omega, cross(omega, r))
