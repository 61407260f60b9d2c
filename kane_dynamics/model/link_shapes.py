"""Shapes of links, as they are drawn and as they collide; rods where none are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal
import warnings

from kane_dynamics._util.text import listing
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ModelWarning
from kane_dynamics.model.model import Model, WORLD
import numpy as np

Kind = Literal['box', 'cylinder', 'sphere', 'mesh']

LINK_COLOR = np.array([0.72, 0.75, 0.79])
JOINT_COLOR = np.array([0.38, 0.42, 0.48])
ROD_RADIUS = 0.02  # in units of the robot's size


@dataclass(frozen=True, eq=False)
class LinkShape:
    """
    Shape of a link.

    Attributes
    ----------
    link : str
        The link.
    kind : 'box', 'cylinder', 'sphere' or 'mesh'
    size : (k,) array
        Edge lengths of a box, radius and length (along z) of a cylinder, radius of a
        sphere, m; scale factors of a mesh.
    pose : (4, 4) array
        Pose in the link's axes, m.
    color : (3,) array or None
        Red, green, blue, from 0 to 1.
    file : Path or None
        File of a mesh.

    """

    link: str
    kind: Kind
    size: Array
    pose: Array
    color: Array | None = None
    file: Path | None = None


def shapes_of_bodies(model: Model, shapes: Sequence[LinkShape],
                     size: float) -> list[tuple[int, LinkShape]]:
    """
    Return (body, shape in its axes) pairs; bodies without shapes are rods.

    Parameters
    ----------
    model : Model
        The mechanism.
    shapes : sequence of LinkShape
        Shapes of the links of a URDF; links that are not in the model are ignored.
    size : float
        Size of the robot, m; the radius of rods is proportional to it.

    """
    # Shapes of frames, in the axes of the frame's body.
    frames = {frame.name: frame for frame in model.frames}
    placed = []
    bodies_with_shapes = set()
    for shape in shapes:
        frame = frames.get(shape.link)
        if frame is not None:
            pose = _pose(frame.rotation, frame.translation) @ shape.pose
            placed.append((frame.body, replace(shape, pose=pose)))
            bodies_with_shapes.add(frame.body)

    # All other bodies, and the base, as rods.
    for body in range(WORLD, len(model.bodies)):
        if body not in bodies_with_shapes:
            for rod in _rods(model, body, ROD_RADIUS * size):
                placed.append((body, rod))
    return placed


def warn_of_unknown_links(model: Model, shapes: Sequence[LinkShape], stacklevel: int) -> None:
    """Warn of shapes whose link the model does not have: nothing of them is compared."""
    known = {frame.name for frame in model.frames}
    unknown = sorted({shape.link for shape in shapes} - known)
    if unknown:
        warnings.warn(f'shapes: the model has no link {listing(unknown)}; left out; '
                      'expected names of its links', ModelWarning, stacklevel=stacklevel + 1)


def _rods(model: Model, body: int, radius: float) -> Iterator[LinkShape]:
    """Yield rods from a body's origin to its outward joints, or to its far end."""
    if body != WORLD:
        yield LinkShape('', 'sphere', np.array([1.3 * radius]), np.eye(4), JOINT_COLOR)
    # To each joint that it carries; the last body of a chain to its farthest point.
    ends = [child.joint.translation for child in model.bodies if child.parent == body]
    if not ends and body != WORLD:
        points = [frame.translation for frame in model.frames if frame.body == body]
        points.append(model.bodies[body].inertial.com)
        ends = [max(points, key=np.linalg.norm)]
    for end in ends:
        length = float(np.linalg.norm(end))
        if length > radius:
            pose = _pose(_axes_about(end / length), 0.5 * end)
            yield LinkShape('', 'cylinder', np.array([radius, length]), pose, LINK_COLOR)


def _pose(rotation: Array, translation: Array) -> Array:
    """Return a pose, (4, 4)."""
    pose = np.eye(4)
    pose[:3, :3] = rotation
    pose[:3, 3] = translation
    return pose


def _axes_about(z: Array) -> Array:
    """Return axes, (3, 3), the third of which is z."""
    # The coordinate axis that is farthest from z gives the best conditioned normal.
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)
