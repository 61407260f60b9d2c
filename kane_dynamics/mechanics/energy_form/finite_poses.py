"""
Poses of all bodies as finite displacements, (4, 4) matrices, from the joint positions.

No function is shared with `kane`, `kinematics` or `recursive`, so that a formulation which
differentiates these poses is independent of them.
"""

from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.mechanics.ball_joints import balls, joint_positions
from kane_dynamics.model.model import Joint, Model, WORLD
import numpy as np


def ball_matrix(quaternion: Vector) -> Matrix:
    """Return the rotation of a quaternion, (4, 4): its products with vectors."""
    x, y, z, w = quaternion
    # p v p*: multiplication by p from the left and by its conjugate from the right.
    left = np.array([[w, -z, y, x], [z, w, -x, y], [-y, x, w, z], [-x, -y, -z, w]])
    right = np.array([[w, -z, y, -x], [z, w, -x, -y], [-y, x, w, -z], [x, y, z, w]])
    return (left @ right) * (1.0 / (quaternion @ quaternion))


def joint_matrices(model: Model, q: Vector) -> list[Matrix]:
    """Return the poses of the bodies in their parents at q, (n_q,); (4, 4) each."""
    positions = joint_positions(model, q)
    matrices = [joint_matrix(body.joint, positions) for body in model.bodies]
    for ball in balls(model):  # the three joints of a ball joint are at 0
        rotation = ball_matrix(ball.quaternion(q))
        matrices[ball.body] = matrices[ball.body] @ rotation
    return matrices


def joint_matrix(joint: Joint, q: Vector) -> Matrix:
    """Return the pose of a joint's body in its parent at joint positions q, (4, 4)."""
    T = np.block([[joint.rotation, joint.translation[:, None]],
                  [np.array([[0.0, 0.0, 0.0, 1.0]])]])
    K, K_squared = generator(joint)
    x = joint_position(joint, q)
    if joint.kind == 'prismatic':
        return T + (T @ K) * x
    # Rodrigues: T exp(K x)
    return T + (T @ K) * np.sin(x) + (T @ K_squared) * (1.0 - np.cos(x))


def generator(joint: Joint) -> tuple[Array, Array]:
    """Return the (4, 4) generator K of the joint's motion exp(K x), and K K."""
    K = np.zeros((4, 4))
    # exp(K x) is a translation by x along the axis, or a rotation by x about it.
    if joint.kind == 'prismatic':
        K[:3, 3] = joint.axis
    else:
        x, y, z = joint.axis
        K[:3, :3] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
    return K, K @ K


def poses(model: Model, q: Vector) -> list[Matrix]:
    """Return the poses of all bodies in the world, (4, 4) each."""
    result: list[Matrix] = []
    for body, T in zip(model.bodies, joint_matrices(model, q)):
        if body.parent == WORLD:
            result.append(T)
        else:
            result.append(result[body.parent] @ T)
    return result


def joint_position(joint: Joint, q: Vector) -> Scalar:
    """Return the position of a joint, rad or m."""
    deflection = joint.deflection
    if deflection is None:
        return joint.multiplier * q[joint.coordinate] + joint.offset
    eta = q[list(deflection.coordinates)]
    second_order = 0.5 * ((deflection.curvature @ eta) @ eta)
    return deflection.slope @ eta + second_order + joint.offset
