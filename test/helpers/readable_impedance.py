"""Laws in the space of a frame, readable: NumPy's eigenvalues and inverses."""

from dataclasses import dataclass

from kane_dynamics import rotation_log
import numpy as np


@dataclass(frozen=True)
class ArmNumbers:
    """
    What the laws need of an arm at a state, in coordinates of u and world axes.

    `pose`, `J`, `J_rate` are of the frame.
    """

    M: np.ndarray
    C: np.ndarray
    gravity: np.ndarray
    J: np.ndarray
    J_rate: np.ndarray
    pose: np.ndarray


def arm_numbers(robot, frame, q, u):
    """Return the numbers of our robot; springs count as gravity."""
    at_rest = 0.0 * u
    springs = robot.torque_terms(q, at_rest, at_rest)[4]
    return ArmNumbers(robot.mass_matrix(q), robot.coriolis_matrix(q, u),
                      robot.gravity_force(q) + springs, robot.jacobian(frame, q),
                      robot.jacobian_rate(frame, q, u), robot.frame_pose(frame, q))


def both(R, x):
    """Return linear and angular components in the axes R."""
    return np.concatenate([R.T @ x[:3], R.T @ x[3:]])


def spring_gradient(error_pose, K, h=1e-5):
    """Return the gradient of 1/2 e K e by differences, order 4, in the pose's axes."""
    def energy(p, R):
        e = np.concatenate([p, rotation_log(R)])
        return 0.5 * e @ K @ e
    p = error_pose[:3, 3]
    R = error_pose[:3, :3]
    gradient = []
    for k in range(6):
        unit = np.eye(6)[k]
        values = [energy(p + s * h * unit[:3], turned(s * h * unit[3:]) @ R)
                  for s in (-2, -1, 1, 2)]
        gradient.append(
            (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * h))
    return np.array(gradient)


def turned(w):
    """Return the rotation by a small vector, by its series."""
    W = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    return np.eye(3) + W + W @ W / 2 + W @ W @ W / 6


def geometric_mean(A, B):
    """Return A # B of positive definite matrices."""
    root = matrix_root(A)
    inverse = np.linalg.inv(root)
    return root @ matrix_root(inverse @ B @ inverse) @ root


def matrix_root(A):
    """Return the symmetric square root."""
    values, vectors = np.linalg.eigh(A)
    return vectors @ np.diag(np.sqrt(values)) @ vectors.T


def cartesian_impedance(arm, u, target, K, ratio, *, axes=None, twist=None,
                        acceleration=None, wrench=None, null_rate=2.0, posture=None):
    """Return the torque of a regular arm, without friction, walls and limits."""
    zero = np.zeros(6)
    twist = zero if twist is None else twist
    acceleration = zero if acceleration is None else acceleration
    wrench = zero if wrench is None else wrench
    A = np.eye(3) if axes is None else axes
    M_inverse = np.linalg.inv(arm.M)
    Lambda = np.linalg.inv(arm.J @ M_inverse @ arm.J.T)
    J_bar = M_inverse @ arm.J.T @ Lambda
    u_r = J_bar @ twist
    udot_r = J_bar @ (acceleration - arm.J_rate @ u_r)

    # The spring, in the axes.
    error = np.eye(4)
    error[:3, 3] = A.T @ (arm.pose[:3, 3] - target[:3, 3])
    error[:3, :3] = A.T @ arm.pose[:3, :3] @ target[:3, :3].T @ A
    pull = -both(A.T, spring_gradient(error, K))

    # The damping, 2 zeta times the geometric mean of Lambda and K, in the axes.
    six = np.kron(np.eye(2), A)
    D = 2.0 * ratio * geometric_mean(six.T @ Lambda @ six, K)
    drag = -six @ D @ six.T @ arm.J @ (u - u_r)

    N = np.eye(len(u)) - J_bar @ arm.J
    null = -null_rate * arm.M @ N @ (u - u_r)
    if posture is not None:
        null = null + posture
    return (arm.M @ udot_r + arm.C @ u_r + arm.gravity + arm.J.T @ (pull + drag + wrench)
            + N.T @ null)
