"""Poses of all bodies, and the box around them."""

from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.definition.kinematics import configurations
from kane_dynamics.model.model import Model
import numpy as np


def body_poses(model: Model, q: Array) -> Array:
    """
    Return the poses of all bodies, then of the world, (n_bodies + 1, 4, 4), m.

    Parameters
    ----------
    model : Model
        The mechanism.
    q : (n,) array
        Coordinates, rad or m.

    """
    poses = np.tile(np.eye(4), (len(model.bodies) + 1, 1, 1))
    for pose, body in zip(poses, configurations(model, q)):
        pose[:3, :3] = body.R_wb
        pose[:3, 3] = body.p_wb
    return poses


def model_bounds(model: Model, q: Array) -> tuple[Array, Array]:
    """Return the corners of the box around all bodies and frames at q, (3,) each, m."""
    poses = body_poses(model, q)
    points = list(poses[:, :3, 3])
    for frame in model.frames:
        carrier = poses[frame.body]
        points.append(carrier[:3, :3] @ frame.translation + carrier[:3, 3])
    cloud = np.array(points)
    return cloud.min(axis=0), cloud.max(axis=0)


def model_size(model: Model, q: Array) -> float:
    """Return the diagonal of `model_bounds`, m; 1 if all points coincide."""
    low, high = model_bounds(model, q)
    return float(np.linalg.norm(high - low)) or 1.0
