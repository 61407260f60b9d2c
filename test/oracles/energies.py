"""
Kinetic and potential energies, and generalized forces from them by differentiation.

Poses are homogeneous 4x4 matrices; a body's kinetic energy is 1/2 tr(T' J T'^T) with its
pseudo-inertia J about its own origin (Uicker 1965, Kahn 1969). Passerello and Huston
give the generalized inertia forces

    F_r* = -( d/dt dKE/dq_r' - dKE/dq_r )                                 (for u = q')

which automatic differentiation evaluates. Everywhere q and u = q' are (n,) arrays, udot
the rates of u; rad or m, s. Energies of ball joints have q (n_q,) and the angular
velocities in u. No function is shared with `kane`, `kinematics` or `recursive`, so that
this formulation is an independent reference.
"""

from hyperdual import lifted, seeded
from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.mechanics.ball_joints import joint_positions, require_angles
from kane_dynamics.mechanics.elastic_joints import spring_energy
from kane_dynamics.mechanics.energy_form import finite_poses
from kane_dynamics.mechanics.friction import friction_torque
from kane_dynamics.model.beam import Beam
from kane_dynamics.model.model import Joint, Model, WORLD
import numpy as np


def pose_rates(model: Model, q: Vector, u: Vector) -> list[Matrix]:
    """Return the time derivatives of the poses of all bodies, (4, 4) each."""
    body_poses = finite_poses.poses(model, q)
    matrices = finite_poses.joint_matrices(model, q)
    positions = joint_positions(model, q)
    result: list[Matrix] = []
    for i, body in enumerate(model.bodies):
        # The generator K commutes with exp(K x), so it multiplies from the right.
        K, _ = finite_poses.generator(body.joint)
        rate = (body_poses[i] @ K) * _rate(body.joint, positions, u)
        if body.parent != WORLD:
            rate = result[body.parent] @ matrices[i] + rate
        result.append(rate)
    return result


def kinetic_energy(model: Model, q: Vector, u: Vector) -> Scalar:
    """Return the kinetic energy of bodies and rotors, J."""
    twice: Scalar = 0.0
    body_rates = pose_rates(model, q, u)
    for body, T_rate in zip(model.bodies, body_rates):
        joint = body.joint
        # tr(T' J T'^T), then the rotor of the drive.
        twice = twice + np.sum((T_rate @ body.inertial.pseudo_inertia) * T_rate)
        rate = joint.multiplier * u[joint.coordinate]
        twice = twice + joint.armature * (rate * rate)
    # Bending adds the kinetic energy of the bent beam less that of the straight one.
    if model.flexible:
        positions = joint_positions(model, q)
        body_poses = finite_poses.poses(model, q)
        for body, T, T_rate in zip(model.bodies, body_poses, body_rates):
            if body.beam is not None:
                twice = twice + _bending(body.beam, T, T_rate, positions, u)
    return 0.5 * twice


def _bending(beam: Beam, T: Matrix, T_rate: Matrix, q: Vector, u: Vector) -> Scalar:
    """
    Return twice the contribution of bending to the kinetic energy, J, by quadrature.

    It is v . v of the bent beam minus that of the straight one, which is a rigid body.
    """
    modes = list(beam.coordinates)
    eta = q[modes]
    eta_rate = u[modes]
    R = T[:3, :3]
    R_rate = T_rate[:3, :3]
    total: Scalar = 0.0
    for x, dm, phi, H in zip(beam.points, beam.weights, beam.shapes, beam.shortening):
        # The deflection and its rate, in the axes of the body.
        axial = (H @ eta) @ eta * -0.5
        axial_rate = -((H @ eta) @ eta_rate)
        deflection = eta @ phi + beam.direction * axial
        deflection_rate = eta_rate @ phi + beam.direction * axial_rate

        # With v = v_0 + dv, v . v - v_0 . v_0 = (2 v_0 + dv) . dv.
        v_0 = R_rate @ x + T_rate[:3, 3]
        dv = R_rate @ deflection + R @ deflection_rate
        total = total + dm * ((2.0 * v_0 + dv) @ dv)
    return total + _twisting(beam, R, R_rate, eta_rate)


def _twisting(beam: Beam, R: Matrix, R_rate: Matrix, eta_rate: Vector) -> Scalar:
    """
    Return twice the contribution of torsion to the kinetic energy, J.

    A section turns by theta = psi . eta about the beam's direction e. Its second
    moment S is that of a disc, which does not change in this rotation E(theta). So
    tr((R E)' S (R E)'^T) is the same with R' + theta' R K in place of (R E)', where
    K = E'(0) = [e]x.
    """
    e = beam.direction
    K = np.cross(np.eye(3), e)
    total: Scalar = 0.0
    for spin, psi in zip(beam.spins, beam.twists):
        if psi.any():
            S = 0.5 * spin * (np.eye(3) - np.outer(e, e))
            twisted_rate = R_rate + (R @ K) * (psi @ eta_rate)
            twisted = np.sum((twisted_rate @ S) * twisted_rate)
            total = total + twisted - np.sum((R_rate @ S) * R_rate)
    return total


def _rate(joint: Joint, q: Vector, u: Vector) -> Scalar:
    """Return the rate of a joint, rad/s or m/s."""
    deflection = joint.deflection
    if deflection is None:
        return joint.multiplier * u[joint.coordinate]
    # The angle is slope . eta + 1/2 eta . curvature eta: its time derivative.
    modes = list(deflection.coordinates)
    eta = q[modes]
    eta_rate = u[modes]
    return deflection.slope @ eta_rate + (deflection.curvature @ eta) @ eta_rate


def potential_energy(model: Model, q: Vector, *,
                     gravity: Vector | None = None) -> Scalar:
    """Return the potential energy of gravity (zero at the origin) and springs, J."""
    g = model.gravity if gravity is None else gravity
    total: Scalar = 0.0
    body_poses = finite_poses.poses(model, q)
    q = joint_positions(model, q)
    for body, T in zip(model.bodies, body_poses):
        # Gravity: -g . (m p_com); the last column of J is the first moment.
        first_moment = T @ body.inertial.pseudo_inertia[:, 3]
        total = total - g @ first_moment[:3]

        joint = body.joint
        stretch = joint.multiplier * q[joint.coordinate] + joint.offset - joint.rest
        total = total + 0.5 * joint.stiffness * (stretch * stretch)
        if body.beam is not None:
            # Beams bend: the strain energy, and the weight at the deflected places.
            total = total + _beam_energy(body.beam, T, q, g)
    # Springs between motor and link of elastic joints.
    for _, drive, link, motor in model.drives:
        total = total + spring_energy(drive, q[motor] - q[link])
    return total


def _beam_energy(beam: Beam, T: Matrix, q: Vector, g: Vector) -> Scalar:
    """Return the potential energy of elasticity, and of weight by bending, J."""
    eta = q[list(beam.coordinates)]
    total = 0.5 * ((beam.stiffness @ eta) @ eta)
    for dm, phi, H in zip(beam.weights, beam.shapes, beam.shortening):
        deflection = eta @ phi + beam.direction * ((H @ eta) @ eta * -0.5)
        total = total - dm * (g @ (T[:3, :3] @ deflection))
    return total


def generalized_inertia_force(model: Model, q: Array, u: Array, udot: Array) -> Array:
    """Return F_r* = -(d/dt dKE/dq' - dKE/dq), (n,), N m or N, by hyper-dual numbers."""
    require_angles(model, 'energy form')
    n = model.n
    q_moving = seeded(q, u, 0, 2 * n)
    u_moving = seeded(u, udot, n, 2 * n)
    energy = lifted(kinetic_energy(model, q_moving, u_moving), 2 * n)
    return energy.gradient[:n] - energy.gradient_rate[n:]


def conservative_force(model: Model, q: Array) -> Array:
    """Return -dPE/dq, (n,): the active force of gravity and springs, N m or N."""
    require_angles(model, 'energy form')
    n = model.n
    energy = potential_energy(model, seeded(q, np.zeros(n), 0, n))
    return -lifted(energy, n).gradient


def friction_force(model: Model, u: Array, loads: Array | None = None) -> Array:
    """
    Return the generalized active force of damping and Coulomb friction, (n,), N m or N.

    The virtual power of a joint is minus its friction torque times the variation of its
    rate. `loads`, (n,), are those of the drives; none by default.
    """
    force = np.zeros(model.n)
    # Friction of joints; of one that mimics another, it acts through its multiplier.
    for body in model.bodies:
        joint = body.joint
        rate = joint.multiplier * u[joint.coordinate]
        load = 0.0 if loads is None else loads[joint.coordinate]
        force[joint.coordinate] -= friction_torque(joint, rate, load) * joint.multiplier
        # Damping of the modes of a beam.
        if body.beam is not None:
            modes = list(body.beam.coordinates)
            force[modes] -= body.beam.damping @ u[modes]
    # Damping of drives acts between motor and link with opposite signs.
    for _, drive, link, motor in model.drives:
        torque = drive.damping * (u[motor] - u[link])
        force[motor] -= torque
        force[link] += torque
    return force


def mass_matrix(model: Model, q: Array) -> Array:
    """Return the mass matrix M_rs = d2 KE / dq_r' dq_s', (n, n), by differentiation."""
    n = model.n
    rows = []
    for unit in np.eye(n):  # direction of the second derivative, at u = 0
        u = seeded(np.zeros(n), unit, 0, n)
        energy = lifted(kinetic_energy(model, q, u), n)
        rows.append(energy.gradient_rate)
    return np.array(rows)
