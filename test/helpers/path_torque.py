"""The torque of a tree along a path, from the compiled limits at its vertices."""

from kane_dynamics.feasibility.path_limits import SIZES, vertex_kernel
import numpy as np


def torque_along(robot, q, first, second):
    """Return the factors of s'' and s'^2 in the torques, and the rest, (K, 3, n)."""
    no_limits = np.zeros((len(q), 3, robot.n))
    rows = vertex_kernel(robot)(q, first, second, first, first, no_limits)
    return rows[:, SIZES:].reshape(len(q), 3, robot.n)
