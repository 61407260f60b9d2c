"""
Kinetic and potential energies, and generalized forces from them by differentiation.

Poses are homogeneous 4x4 matrices; a body's kinetic energy is 1/2 tr(T' J T'^T) with its
pseudo-inertia J about its own origin (Uicker 1965, Kahn 1969). Passerello and Huston give
the generalized inertia forces

    F_r* = -( d/dt dKE/dq_r' - dKE/dq_r )                                 (for u = q')

which automatic differentiation evaluates. Everywhere q and u = q' are (n,) arrays, udot the rates
of u; rad or m, s. Energies of ball joints have q (n_q,) and the angular velocities in u. No
function is shared with `kane`, `kinematics` or `recursive`, so that this formulation is an
independent reference.
"""

from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.algebra.hyperdual import lifted, seeded
from kane_dynamics.mechanics.ball_joints import balls, joint_positions, require_angles
from kane_dynamics.mechanics.friction import friction_torque
from kane_dynamics.model.model import Joint, Model, WORLD
import numpy as np


def ball_matrix(p: Any) -> Any:
    """Return the rotation of a quaternion, (4, 4): its products with vectors from both sides."""
    x, y, z, w = p
    left = np.array([[w, -z, y, x], [z, w, -x, y], [-y, x, w, z], [-x, -y, -z, w]])
    right = np.array([[w, -z, y, -x], [z, w, -x, -y], [-y, x, w, -z], [x, y, z, w]])
    return (left @ right) * (1.0 / (p @ p))


def joint_matrices(model: Model, q: Any) -> list[Any]:
    """Return the pose of each body in its parent at the coordinates q, (n_q,); (4, 4) each."""
    at = joint_positions(model, q)
    found = [joint_matrix(body.joint, at) for body in model.bodies]
    for ball in balls(model):  # the three joints of a ball joint are at 0
        found[ball.body] = found[ball.body] @ ball_matrix(ball.quaternion(q))
    return found


def joint_matrix(joint: Joint, q: Any) -> Any:
    """Return the pose of a joint's body in its parent at the joint positions q, (4, 4)."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = joint.rotation, joint.translation
    K, KK = generator(joint)
    x = _position(joint, q)
    if joint.kind == 'prismatic':
        return T + (T @ K) * x
    return T + (T @ K) * np.sin(x) + (T @ KK) * (1.0 - np.cos(x))  # Rodrigues: T exp(K x)


def generator(joint: Joint) -> tuple[Array, Array]:
    """Return the (4, 4) generator K of the joint's motion exp(K x), and K K."""
    K = np.zeros((4, 4))
    if joint.kind == 'prismatic':
        K[:3, 3] = joint.axis
    else:
        x, y, z = joint.axis
        K[0, 1:3], K[1, 2] = (-z, y), -x
        K[:3, :3] -= K[:3, :3].T
    return K, K @ K


def poses(model: Model, q: Any) -> list[Any]:
    """Return the poses of all bodies in the world, (4, 4) each."""
    result: list[Any] = []
    for body, T in zip(model.bodies, joint_matrices(model, q)):
        result.append(T if body.parent == WORLD else result[body.parent] @ T)
    return result


def pose_rates(model: Model, q: Any, u: Any) -> list[Any]:
    """Return the time derivatives of the poses of all bodies, (4, 4) each."""
    here, matrices, at = poses(model, q), joint_matrices(model, q), joint_positions(model, q)
    result: list[Any] = []
    for i, body in enumerate(model.bodies):
        joint = body.joint
        # The generator K commutes with exp(K x).
        rate = (here[i] @ generator(joint)[0]) * _rate(joint, at, u)
        if body.parent != WORLD:
            rate = result[body.parent] @ matrices[i] + rate
        result.append(rate)
    return result


def kinetic_energy(model: Model, q: Any, u: Any) -> Any:
    """Return the kinetic energy of bodies and rotors, J."""
    twice: Any = 0.0
    for body, T in zip(model.bodies, pose_rates(model, q, u)):
        twice = twice + np.sum((T @ body.inertial.pseudo_inertia) * T)
        rate = body.joint.multiplier * u[body.joint.coordinate]
        twice = twice + body.joint.armature * (rate * rate)
    bent = [i for i, body in enumerate(model.bodies) if body.beam is not None]
    if bent:
        here, moved = poses(model, q), pose_rates(model, q, u)
        for i in bent:
            twice = twice + _bending(model.bodies[i].beam, here[i], moved[i],
                                     joint_positions(model, q), u)
    return 0.5 * twice


def _bending(beam: Any, T: Any, T_rate: Any, q: Any, u: Any) -> Any:
    """
    Return twice the contribution of bending to the kinetic energy, J, by quadrature.

    It is v . v of the bent beam minus that of the straight one, which is a rigid body.
    """
    eta, speed = (x[list(beam.coordinates)] for x in (q, u))
    total: Any = 0.0
    for x, dm, phi, H in zip(beam.points, beam.weights, beam.shapes, beam.shortening):
        shorter, rate = (H @ eta) @ eta * -0.5, -((H @ eta) @ speed)
        v_0 = T_rate[:3, :3] @ x + T_rate[:3, 3]
        moved = (T_rate[:3, :3] @ (eta @ phi + beam.direction * shorter)
                 + T[:3, :3] @ (speed @ phi + beam.direction * rate))
        total = total + dm * ((2.0 * v_0 + moved) @ moved)
    return total + _twisting(beam, T[:3, :3], T_rate[:3, :3], speed)


def _twisting(beam: Any, R: Any, R_rate: Any, speed: Any) -> Any:
    """
    Return twice the contribution of torsion to the kinetic energy, J.

    The second moment S of a round section does not change in a rotation E(theta) about the beam.
    So tr((R E)' S (R E)'^T) equals the same expression with R' + theta' R K, K = E'(0).
    """
    e = beam.direction
    K = np.cross(np.eye(3), e)
    total: Any = 0.0
    for spin, psi in zip(beam.spins, beam.twists):
        if psi.any():
            S = 0.5 * spin * (np.eye(3) - np.outer(e, e))
            turned = R_rate + (R @ K) * (psi @ speed)
            total = total + np.sum((turned @ S) * turned) - np.sum((R_rate @ S) * R_rate)
    return total


def _position(joint: Joint, q: Any) -> Any:
    bent = joint.deflection
    if bent is None:
        return joint.multiplier * q[joint.coordinate] + joint.offset
    eta = q[list(bent.coordinates)]
    return bent.slope @ eta + 0.5 * ((bent.curvature @ eta) @ eta) + joint.offset


def _rate(joint: Joint, q: Any, u: Any) -> Any:
    bent = joint.deflection
    if bent is None:
        return joint.multiplier * u[joint.coordinate]
    eta, speed = (x[list(bent.coordinates)] for x in (q, u))
    return bent.slope @ speed + (bent.curvature @ eta) @ speed


def potential_energy(model: Model, q: Any, *, gravity: Any = None) -> Any:
    """Return the potential energy of gravity (zero at the world's origin) and springs, J."""
    g = model.gravity if gravity is None else gravity
    total: Any = 0.0
    here, q = poses(model, q), joint_positions(model, q)
    for body, T in zip(model.bodies, here):
        first_moment = T @ body.inertial.pseudo_inertia[:, 3]
        total = total - g @ first_moment[:3]
        joint = body.joint
        stretch = joint.multiplier * q[joint.coordinate] + joint.offset - joint.rest
        total = total + 0.5 * joint.stiffness * (stretch * stretch)
        beam = body.beam
        if beam is not None:
            eta = q[list(beam.coordinates)]
            total = total + 0.5 * ((beam.stiffness @ eta) @ eta)
            for dm, phi, H in zip(beam.weights, beam.shapes, beam.shortening):
                d = eta @ phi + beam.direction * ((H @ eta) @ eta * -0.5)
                total = total - dm * (g @ (T[:3, :3] @ d))
    return total


def generalized_inertia_force(model: Model, q: Array, u: Array, udot: Array) -> Array:
    """Return F_r* = -(d/dt dKE/dq' - dKE/dq), (n,), N m or N, by automatic differentiation."""
    require_angles(model, 'energy form')
    n = model.n
    energy = lifted(kinetic_energy(model, seeded(q, u, 0, 2 * n),
                                   seeded(u, udot, n, 2 * n)), 2 * n)
    return energy.gradient[:n] - energy.gradient_rate[n:]


def conservative_force(model: Model, q: Array) -> Array:
    """Return -dPE/dq, (n,): the generalized active force of gravity and springs, N m or N."""
    require_angles(model, 'energy form')
    n = model.n
    energy = potential_energy(model, seeded(q, np.zeros(n), 0, n))
    return -lifted(energy, n).gradient


def friction_force(model: Model, u: Array) -> Array:
    """
    Return the generalized active force of damping and Coulomb friction, (n,), N m or N.

    The virtual power of a joint is -(d x' + mu tanh(x'/x_s') + offset) times the variation of
    its rate x'.
    """
    force = np.zeros(model.n)
    for body in model.bodies:
        joint = body.joint
        rate = joint.multiplier * u[joint.coordinate]
        force[joint.coordinate] -= friction_torque(joint, rate) * joint.multiplier
        if body.beam is not None:
            modes = list(body.beam.coordinates)
            force[modes] -= body.beam.damping @ u[modes]
    return force


def mass_matrix(model: Model, q: Array) -> Array:
    """Return the mass matrix M_rs = d2 KE / dq_r' dq_s', (n, n), by differentiation."""
    n = model.n
    rows = []
    for unit in np.eye(n):  # direction of the second derivative, at u = 0
        energy = lifted(kinetic_energy(model, q, seeded(np.zeros(n), unit, 0, n)), n)
        rows.append(energy.gradient_rate)
    return np.array(rows)
