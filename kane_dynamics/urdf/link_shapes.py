"""Shapes of the links of a URDF: as drawn, as stated for collisions, and simple ones."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
import os
from pathlib import Path
from typing import Any
import warnings

from kane_dynamics._util.deferred_import import forks_wait
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError, ModelWarning
from kane_dynamics.model.link_shapes import LinkShape
from kane_dynamics.urdf.document import Element, parse, read_source
from kane_dynamics.urdf.schema import CHILDREN
import numpy as np

_CHILDREN = {**CHILDREN, 'robot': ('material', *CHILDREN['robot']),
             'visual': ('origin', 'geometry', 'material'), 'material': ('color',),
             'collision': ('origin', 'geometry'),
             'geometry': ('box', 'cylinder', 'sphere', 'mesh')}
_DEPTH = 5  # robot / link / visual / geometry / box
_SIZES = {'box': ('size',), 'cylinder': ('radius', 'length'), 'sphere': ('radius',),
          'mesh': ('scale',)}
_SHARES = ('AMENT_PREFIX_PATH', 'CMAKE_PREFIX_PATH')

Source = str | bytes | os.PathLike[str]


def load_visuals(source: Source) -> tuple[LinkShape, ...]:
    """
    Return the visual shapes of a URDF's links; mesh files are located, not opened.

    A mesh is searched as a path, with or without the package name beside the URDF and in
    every parent folder, and in share/ of AMENT_PREFIX_PATH and CMAKE_PREFIX_PATH.

    Parameters
    ----------
    source : path, or str or bytes of XML
        As in `load_urdf`; for XML without a path, meshes beside the URDF are not found.

    Warns
    -----
    ModelWarning
        If meshes are not found; they are omitted.

    Raises
    ------
    UrdfError
        If the URDF is malformed.

    """
    return _load(source, 'visual')


def load_collisions(source: Source) -> tuple[LinkShape, ...]:
    """Return the collision shapes of a URDF's links; arguments as for `load_visuals`."""
    return _load(source, 'collision')


def load_collision_shapes(source: Source) -> tuple[LinkShape, ...]:
    """
    Return simple shapes that contain the links of a URDF: boxes, cylinders and spheres.

    Links without `<collision>` have their `<visual>` shapes. A mesh becomes the box
    around it along its file's axes.

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
    simple = []
    for shape in shapes:
        if shape.kind == 'mesh':
            shape = _box_around(shape)
        simple.append(shape)
    return tuple(simple)


def _load(source: Source, tag: str) -> tuple[LinkShape, ...]:
    """Return the shapes in all elements of a tag."""
    unread = 'visual' if tag == 'collision' else 'collision'
    root = parse(read_source(source), depth=_DEPTH, unread=(unread,))
    capsules = _as_cylinders(root, tag)
    with forks_wait():
        from kane_dynamics.urdf.model_reader import read_robot  # slow imports
    robot = read_robot(root, {**_CHILDREN, 'link': (tag,)})
    colors = {material.name: material.color for material in robot.materials or ()}
    folders = list(_mesh_folders(source))
    shapes = []
    missing = set()
    for link, stated in zip(robot.links, root.find_all('link'), strict=True):
        records = getattr(link, f'{tag}s') or ()
        for element, owner in zip(records, stated.find_all(tag), strict=True):
            # A mesh is a file beside the URDF or in a package; without it the link is a
            # rod.
            shape = _shape(link.name, element, owner, colors)
            if shape is not None and shape.kind == 'mesh':
                name = element.geometry.mesh.filename
                shape = replace(shape, file=_mesh_file(name, folders))
                if shape.file is None:
                    missing.add(name)
                    continue
            if shape is not None:
                shapes.append(shape)
                if id(owner) in capsules:
                    shapes += _ends(shape)
    if missing:
        warnings.warn(f'{len(missing)} meshes not found: links without another shape '
                      'are drawn as rods; expected the URDF inside its package or the '
                      'workspace in AMENT_PREFIX_PATH; missing: '
                      f'{", ".join(sorted(missing))}', ModelWarning,
                      stacklevel=3)
    return tuple(shapes)


def _pose(element: Any, owner: Element) -> Array:
    """Return the pose of a shape in the link's axes, (4, 4)."""
    from kane_dynamics.urdf.model_reader import origin_pose  # slow imports
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = origin_pose(element.origin, owner)
    return pose


def _as_cylinders(root: Element, tag: str) -> set[int]:
    """Make capsules cylinders, as yourdfpy knows none; return the ids of their owners."""
    capsules = set()
    for link in root.find_all('link'):
        for owner in link.find_all(tag):
            geometry = owner.first('geometry')
            capsule = None if geometry is None else geometry.first('capsule')
            if capsule is not None:
                capsule.tag = 'cylinder'
                capsules.add(id(owner))
    return capsules


def _ends(cylinder: LinkShape) -> list[LinkShape]:
    """Return the spheres at both ends of a cylinder, with which it is a capsule."""
    radius, length = cylinder.size
    ends = []
    for z in (-0.5 * length, 0.5 * length):
        pose = cylinder.pose.copy()
        pose[:3, 3] += z * pose[:3, 2]
        ends.append(replace(cylinder, kind='sphere', size=np.array([radius]), pose=pose))
    return ends


def _shape(link: str, element: Any, owner: Element,
           colors: Mapping[str, Any]) -> LinkShape | None:
    """Convert yourdfpy's record, without the file of a mesh; None without shape."""
    stated = [kind for kind in _SIZES if getattr(element.geometry, kind, None)]
    if not stated:
        return None
    kind = stated[0]
    geometry = getattr(element.geometry, kind)

    # Lengths, or for a mesh its scale: one number for all axes, by default 1.
    numbers = []
    for name in _SIZES[kind]:
        number = getattr(geometry, name)
        numbers.append(1.0 if number is None else number)
    size = np.hstack(numbers)
    if kind == 'mesh':
        size = np.broadcast_to(size, 3)
    return LinkShape(link, kind, size, _pose(element, owner),  # type: ignore[arg-type]
                     _color(getattr(element, 'material', None), colors))


def _color(material: Any, colors: Mapping[str, Any]) -> Array | None:
    """Return the color of a material, stated with it or by the robot under its name."""
    if not material:
        return None
    color = material.color or colors.get(material.name)
    return None if color is None else np.asarray(color.rgba[:3])


def _mesh_folders(source: Source) -> Iterator[Path]:
    """Yield the folders where meshes may be: that of the URDF and its parents."""
    is_xml = isinstance(source, bytes) or str(source).lstrip().startswith('<')
    if not is_xml:
        file = Path(os.fspath(source)).resolve()  # type: ignore[arg-type]
        yield from file.parents


def _mesh_file(name: str, folders: list[Path]) -> Path | None:
    """Return the path of a file named in a URDF, or None if it does not exist."""
    scheme, _, path = name.rpartition('://')
    package = ''
    if scheme == 'package':
        package, _, path = path.partition('/')
    # In this order: as it is, beside the URDF and above it, in installed packages.
    candidates = []
    if Path(path).is_absolute():
        candidates.append(Path(path))
    for folder in folders:
        candidates += [folder / package / path, folder / path]
    # Installed packages, by the prefixes of ament and catkin.
    for variable in _SHARES:
        for prefix in os.environ.get(variable, '').split(os.pathsep):
            if prefix:
                candidates.append(Path(prefix) / 'share' / package / path)
    return next((candidate for candidate in candidates if candidate.is_file()), None)


def _box_around(mesh: LinkShape) -> LinkShape:
    """Return the box around a mesh along its file's axes."""
    low, high = _corners(mesh) * mesh.size
    pose = mesh.pose.copy()
    pose[:3, 3] += pose[:3, :3] @ (0.5 * (low + high))
    return replace(mesh, kind='box', size=np.abs(high - low), pose=pose, file=None)


def shape_volume(shape: LinkShape) -> float:
    """
    Return the volume of a shape, m^3; of an open mesh that of its convex hull.

    Raises
    ------
    InputError
        The file of a mesh cannot be read.

    """
    size = shape.size
    if shape.kind == 'box':
        return float(np.prod(size))
    if shape.kind == 'cylinder':
        return float(np.pi * size[0]**2 * size[1])
    if shape.kind == 'sphere':
        return float(4.0 / 3.0 * np.pi * size[0]**3)
    mesh = _mesh(shape).to_mesh()
    solid = mesh if mesh.is_watertight else mesh.convex_hull
    return float(abs(solid.volume * np.prod(size)))


def _corners(mesh: LinkShape) -> Array:
    """Return the corners of the box around a mesh, (2, 3), unscaled."""
    return np.asarray(_mesh(mesh).bounds)


def _mesh(shape: LinkShape) -> Any:
    """Return the scene of a mesh's file, which has points."""
    import trimesh  # yourdfpy depends on it; it takes a second to import
    try:
        scene = trimesh.load_scene(shape.file, ignore_broken=True)
    except Exception as error:  # each of many formats fails in its own way
        raise InputError(f'{shape.file}: {error}; expected a readable mesh') from error
    if scene.bounds is None:
        raise InputError(f'{shape.file}: holds no points; expected a mesh')
    return scene
