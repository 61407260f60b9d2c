"""Which shapes are drawn on which body."""

from collections.abc import Iterator, Sequence

from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.definition.kinematics import configurations
from kane_dynamics.model.model import Model, WORLD
from kane_dynamics.urdf.visuals import Visual
import numpy as np

LINK, JOINT = np.array([0.72, 0.75, 0.79]), np.array([0.38, 0.42, 0.48])  # colours
_THICK = 0.02  # of a rod that stands for a link, in units of the robot's size


def body_poses(model: Model, q: Array) -> Array:
    """
    Return the pose of every body, (n_bodies + 1, 4, 4), m; the last one is the fixed world's.

    Parameters
    ----------
    model : Model
        The mechanism.
    q : (n,) array
        Coordinates, rad or m.

    """
    poses = np.tile(np.eye(4), (len(model.bodies) + 1, 1, 1))
    for pose, body in zip(poses, configurations(model, q)):
        pose[:3, :3], pose[:3, 3] = body.R_wb, body.p_wb
    return poses


def bounds(model: Model, q: Array) -> tuple[Array, Array]:
    """Return the corners of the box around all bodies and frames at q, (3,) each, m."""
    poses = body_poses(model, q)
    points = [poses[:, :3, 3]]
    points += [(poses[f.body] @ np.append(f.translation, 1.0))[None, :3] for f in model.frames]
    cloud = np.concatenate(points)
    return cloud.min(axis=0), cloud.max(axis=0)


def size(model: Model, q: Array) -> float:
    """Return the diagonal of `bounds`, m; 1 for a robot all in one point."""
    low, high = bounds(model, q)
    return float(np.linalg.norm(high - low)) or 1.0


def link_shapes(model: Model, visuals: Sequence[Visual],
                thickness: float) -> list[tuple[int, Visual]]:
    """
    Return (body, shape in its axes) pairs; rods stand for bodies that look like nothing.

    Parameters
    ----------
    model : Model
        The mechanism.
    visuals : sequence of Visual
        Of a URDF's links; those of links that are not in the model are left out.
    thickness : float
        The robot's size, m, which the rods' radius goes by.

    """
    frames = {frame.name: frame for frame in model.frames}
    shown = []
    for visual in visuals:
        frame = frames.get(visual.link)
        if frame is not None:
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = frame.rotation, frame.translation
            shown.append((frame.body, Visual(visual.link, visual.kind, visual.size,
                                             pose @ visual.pose, visual.color, visual.file)))
    seen = {body for body, _ in shown}
    for body in range(WORLD, len(model.bodies)):
        if body not in seen:
            shown += [(body, rod) for rod in _rods(model, body, _THICK * thickness)]
    return shown


def _rods(model: Model, body: int, radius: float) -> Iterator[Visual]:
    """Yield rods from a body's origin to the joints that it carries, or to its far end."""
    if body != WORLD:
        yield _shape('sphere', [1.3 * radius], np.eye(4), JOINT)
    ends = [child.joint.translation for child in model.bodies if child.parent == body]
    if not ends and body != WORLD:
        places = [frame.translation for frame in model.frames if frame.body == body]
        places.append(model.bodies[body].inertial.com)
        ends = [max(places, key=lambda place: float(place @ place))]
    for end in ends:
        length = float(np.linalg.norm(end))
        if length > radius:
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = _turned(end / length), 0.5 * end
            yield _shape('cylinder', [radius, length], pose, LINK)


def _turned(z: Array) -> Array:
    """Return axes, (3, 3), whose third is z."""
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _shape(kind: str, sizes: Sequence[float], pose: Array, color: Array) -> Visual:
    return Visual('', kind, np.array(sizes), pose, color)  # type: ignore[arg-type]
