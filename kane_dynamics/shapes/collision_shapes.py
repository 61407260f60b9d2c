"""Collision shapes of a URDF's links as boxes, cylinders and spheres."""

from collections.abc import Iterator
from dataclasses import replace
import os

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.urdf.visuals import load_collisions, load_visuals, Visual
import numpy as np


def load_collision_shapes(source: str | bytes | os.PathLike[str]) -> tuple[Visual, ...]:
    """
    Return simple shapes that contain the links of a URDF.

    Links without `<collision>` have their `<visual>` shapes. A mesh becomes the box around it
    along its file's axes.

    Parameters
    ----------
    source : path, or str or bytes of XML
        As `load_urdf` takes it.

    Warns
    -----
    ModelWarning
        Meshes were not found; they are left out.

    Raises
    ------
    UrdfError
        The URDF is malformed.
    InputError
        The file of a mesh cannot be read.

    """
    shapes = load_collisions(source)
    covered = {shape.link for shape in shapes}
    shapes += tuple(shape for shape in load_visuals(source) if shape.link not in covered)
    return tuple(_simple(shapes))


def _simple(shapes: tuple[Visual, ...]) -> Iterator[Visual]:
    """Yield the shapes, boxes for meshes."""
    for shape in shapes:
        if shape.kind != 'mesh':
            yield shape
            continue
        low, high = _corners(shape) * shape.size
        pose = shape.pose.copy()
        pose[:3, 3] += pose[:3, :3] @ (0.5 * (low + high))
        yield replace(shape, kind='box', size=np.abs(high - low), pose=pose, file=None)


def _corners(shape: Visual) -> Array:
    """Return the corners of the box around a mesh, (2, 3), unscaled."""
    import trimesh  # yourdfpy depends on it; it takes a second to import
    try:
        corners = trimesh.load_scene(shape.file, ignore_broken=True).bounds
    except Exception as error:  # each of many formats fails in its own way
        raise InputError(f'{shape.file}: {error}; expected a readable mesh') from error
    if corners is None:
        raise InputError(f'{shape.file}: holds no points; expected a mesh')
    return np.asarray(corners)
