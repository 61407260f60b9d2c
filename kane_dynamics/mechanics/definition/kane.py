"""
Reference formulation of Kane's equations, F_r + F_r* = 0, as sums over bodies.

`Robot.verify` compares the compiled kernels with it (Kane & Levinson, Dynamics: Theory
and Applications, 1985, chapters 4 to 6). World axes throughout; works on any scalar
type, including traced values and symbols.

For r = 1..n, over the bodies k, with R_k the resultant of the active forces at the
center of mass and T_k their torque:

    F_r  =   sum_k ( v_k^r . R_k + omega_k^r . T_k )
    F_r* = - sum_k ( v_k^r . m_k a_k*
                     + omega_k^r . (I_k alpha_k + omega_k x I_k omega_k) )

In the code the sum over k is a loop, and the index r is the row of an array. Everywhere
q, u and udot are (n,) arrays of scalars: coordinates, speeds and their rates; rad or m,
and s. With ball joints q has more entries, (n_q,).
"""

from collections.abc import Mapping
from typing import Any

from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.vector import cross
from kane_dynamics.mechanics.ball_joints import joint_positions
from kane_dynamics.mechanics.definition import beams
from kane_dynamics.mechanics.definition.kinematics import (Configuration, configurations,
                                                           frame_partial_velocities,
                                                           motions, position, rate)
from kane_dynamics.mechanics.elastic_joints import (damping_torque, drive_forces,
                                                    spring_torque)
from kane_dynamics.mechanics.friction import (carries_load, friction_torque,
                                              load_of_drive)
from kane_dynamics.model.model import Body, Joint, Model
import numpy as np

Wrenches = Mapping[str, tuple[Any, Any]]


def partial_velocities(model: Model, q: Vector, frame: str) -> Matrix:
    """
    Return the Jacobian (partial velocities) of a frame, (6, n), in world axes.

    Column r is v^r of the frame's origin, then omega^r; m or rad per unit of the speed.
    InputError if the frame does not exist.
    """
    return frame_partial_velocities(model, model.frame(frame), q)


def generalized_inertia_force(model: Model, q: Vector, u: Vector,
                              udot: Vector) -> Vector:
    """Return the generalized inertia force F_r* of bodies and rotors, (n,), N m or N."""
    force: Vector = np.zeros(model.n)
    bodies = configurations(model, q)
    body_motions = motions(model, bodies, q, u, udot)
    for body, configuration, motion in zip(model.bodies, bodies, body_motions):
        # -R* = m a* and -T* = I alpha + omega x I omega, at the center of mass
        mass_acceleration = body.inertial.mass * motion.a_com
        inertia = central_inertia(body, configuration)
        torque = inertia @ motion.alpha + cross(motion.omega, inertia @ motion.omega)
        force = force - (configuration.partial_velocity @ mass_acceleration
                         + configuration.partial_angular_velocity @ torque)

        # The rotor of the joint's drive, and what bending adds to the straight beam.
        force = force - on_coordinate(model, body.joint, rotor_torque(body.joint, udot))
        if body.beam is not None:
            x = joint_positions(model, q)
            force = force + beams.inertia_force(body.beam, configuration, motion,
                                                x, u, udot)
    return force


def generalized_active_force(model: Model, q: Vector, u: Vector, *,
                             tau: Vector | None = None, gravity: Vector | None = None,
                             friction: bool = True,
                             wrenches: Wrenches | None = None,
                             loads: Vector | None = None) -> Vector:
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
    loads : (n,) array of scalars, optional
        Loads that the drives transmit, on which friction may depend. Default: none.

    """
    g = model.gravity if gravity is None else gravity
    force: Vector = np.zeros(model.n)
    x = joint_positions(model, q)
    for body, configuration in zip(model.bodies, configurations(model, q)):
        joint = body.joint
        # Gravity m g acts at the center of mass;
        # springs and friction act along the joint.
        force = force + configuration.partial_velocity @ (body.inertial.mass * g)
        force = force - on_coordinate(model, joint, joint_spring_torque(joint, x))
        if friction:
            load = 0.0 if loads is None else loads[joint.coordinate]
            torque = friction_torque(joint, rate(joint, u), load)
            force = force - on_coordinate(model, joint, torque)
        if body.beam is not None:
            force = force + beams.weight(body.beam, configuration, x, g)
            force = force + beams.modal_force(body.beam, x, u, friction)
    if model.drives:
        force = force - drive_forces(model, x, spring_torque)
        if friction:
            force = force - drive_forces(model, u, damping_torque)
    # A force counts by the partial velocity of its point, a moment by the partial
    # angular velocity of its body.
    if wrenches is not None:
        for frame, (force_at_frame, moment) in wrenches.items():
            jacobian = frame_partial_velocities(model, model.frame(frame), q)
            force = force + jacobian[:3].T @ force_at_frame + jacobian[3:].T @ moment
    if tau is not None:
        force = force + tau
    return force


def inverse_dynamics(model: Model, q: Vector, u: Vector, udot: Vector, *,
                     gravity: Vector | None = None, friction: bool = True,
                     wrenches: Wrenches | None = None) -> Vector:
    """Return tau, (n,), such that F_r + F_r* = 0; arguments as in the two sums."""
    inertia_force = generalized_inertia_force(model, q, u, udot)
    loads = None
    if friction and any(carries_load(body.joint) for body in model.bodies):
        # The load of a drive is the torque of the motion without friction, and the damping
        # of the drive.
        force = generalized_active_force(model, q, u, gravity=gravity, friction=False,
                                         wrenches=wrenches)
        loads = drive_forces(model, u, damping_torque) - (force + inertia_force)
    active_force = generalized_active_force(model, q, u, gravity=gravity,
                                            friction=friction, wrenches=wrenches,
                                            loads=loads)
    return -(active_force + inertia_force)


def bias_force(model: Model, q: Vector, u: Vector, *, gravity: Vector | None = None,
               friction: bool = True) -> Vector:
    """Return the bias force h(q, u), (n,): M udot + h = tau + external."""
    at_rest = np.zeros(model.n)
    return inverse_dynamics(model, q, u, at_rest, gravity=gravity, friction=friction)


def gravity_force(model: Model, q: Vector, *, gravity: Vector | None = None) -> Vector:
    """Return the gravity compensation torque, (n,)."""
    g = model.gravity if gravity is None else gravity
    force: Vector = np.zeros(model.n)
    x = joint_positions(model, q)
    # F_r of gravity is the sum of v^r . m g; the torque that holds it is the opposite.
    for body, configuration in zip(model.bodies, configurations(model, q)):
        force = force - configuration.partial_velocity @ (body.inertial.mass * g)
        if body.beam is not None:
            force = force - beams.weight(body.beam, configuration, x, g)
    return force


def mass_matrix(model: Model, q: Vector) -> Matrix:
    """Return M_rs = sum_k (m v^r . v^s + omega^r . I omega^s) and rotors, (n, n)."""
    M: Matrix = np.zeros((model.n, model.n))
    x = joint_positions(model, q)
    for body, configuration in zip(model.bodies, configurations(model, q)):
        # Row r of `v` and `omega` is a partial velocity,
        # so that the sums are matrix products.
        v = configuration.partial_velocity
        omega = configuration.partial_angular_velocity
        inertia = central_inertia(body, configuration)
        M = M + body.inertial.mass * (v @ v.T) + omega @ inertia @ omega.T

        joint = body.joint
        rotor_inertia = on_coordinate(model, joint, joint.multiplier * joint.armature)
        M = M + np.diag(rotor_inertia)
        if body.beam is not None:
            M = M + beams.mass_matrix(body.beam, configuration, x)
    return M


def forward_dynamics(model: Model, q: Array, u: Array, tau: Array, *,
                     gravity: Array | None = None, friction: bool = True,
                     wrenches: Wrenches | None = None) -> Array:
    """Return udot, (n,), from M udot = F_r + F_r* at udot = 0; numbers only."""
    loads = None
    if friction:
        loads = loads_of_drives(model, u, tau)
    # F_r + F_r* = 0, and F_r* is -M udot plus its value at udot = 0.
    active_force = generalized_active_force(model, q, u, tau=tau, gravity=gravity,
                                            friction=friction, wrenches=wrenches,
                                            loads=loads)
    inertia_force_at_zero = generalized_inertia_force(model, q, u, np.zeros(model.n))
    return np.linalg.solve(mass_matrix(model, q), active_force + inertia_force_at_zero)


def loads_of_drives(model: Model, u: Array, tau: Array) -> Array:
    """Return the loads that drives transmit, (n,), under motor torques; numbers only."""
    loads = np.array(tau, dtype=np.float64)
    for body in model.bodies:
        joint = body.joint
        if carries_load(joint):
            k = joint.coordinate
            # Joints that mimic this one have friction, too, which depends on no load.
            unloaded: Scalar = 0.0
            for mimic in model.bodies:
                if mimic is not body and mimic.joint.coordinate == k:
                    torque = friction_torque(mimic.joint, rate(mimic.joint, u))
                    unloaded += mimic.joint.multiplier * torque
            loads[k] = load_of_drive(joint, rate(joint, u), tau[k] - unloaded)
    return loads


def central_inertia(body: Body, configuration: Configuration) -> Matrix:
    """Return a body's inertia about its center of mass, (3, 3), world axes, kg m^2."""
    return configuration.R_wb @ body.inertial.inertia @ configuration.R_wb.T


def rotor_torque(joint: Joint, udot: Vector) -> Scalar:
    """Return the joint torque that accelerates the rotor, N m or N."""
    return joint.armature * rate(joint, udot)


def joint_spring_torque(joint: Joint, q: Vector) -> Scalar:
    """Return the torque that balances the joint's spring, N m or N."""
    return joint.stiffness * (position(joint, q) - joint.rest)


def on_coordinate(model: Model, joint: Joint, torque: Scalar) -> Vector:
    """Return the generalized force of a joint torque, (n,): the multiplier times it."""
    return (joint.multiplier * np.eye(model.n)[joint.coordinate]) * torque
