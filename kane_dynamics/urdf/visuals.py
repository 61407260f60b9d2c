"""Visual and collision shapes of the links of a URDF; mesh files are located, not opened."""

from dataclasses import dataclass
import os
from pathlib import Path
from typing import Any, Literal
import warnings

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ModelWarning
from kane_dynamics.urdf.document import parse, read_source
from kane_dynamics.urdf.model_reader import read_robot
from kane_dynamics.urdf.schema import CHILDREN
import numpy as np

_CHILDREN = {**CHILDREN, 'robot': ('material', *CHILDREN['robot']), 'link': ('visual',),
             'visual': ('origin', 'geometry', 'material'), 'material': ('color',),
             'collision': ('origin', 'geometry'),
             'geometry': ('box', 'cylinder', 'sphere', 'mesh')}
_DEPTH = 5  # robot / link / visual / geometry / box
_SIZES = {'box': ('size',), 'cylinder': ('radius', 'length'), 'sphere': ('radius',),
          'mesh': ('scale',)}
_SHARES = ('AMENT_PREFIX_PATH', 'CMAKE_PREFIX_PATH')


@dataclass(frozen=True, eq=False)
class Visual:
    """
    Visual shape of a link.

    Attributes
    ----------
    link : str
        The link.
    kind : 'box', 'cylinder', 'sphere' or 'mesh'
    size : (k,) array
        Edge lengths of a box, radius and length (along z) of a cylinder, radius of a sphere, m;
        scale factors of a mesh.
    pose : (4, 4) array
        Pose in the link's axes, m.
    color : (3,) array or None
        Red, green, blue, from 0 to 1.
    file : Path or None
        File of a mesh.

    """

    link: str
    kind: Literal['box', 'cylinder', 'sphere', 'mesh']
    size: Array
    pose: Array
    color: Array | None = None
    file: Path | None = None


def load_visuals(source: str | bytes | os.PathLike[str]) -> tuple[Visual, ...]:
    """
    Return the visual shapes of a URDF's links.

    A mesh is searched as a path, with or without the package name beside the URDF and in every
    parent folder, and in share/ of AMENT_PREFIX_PATH and CMAKE_PREFIX_PATH.

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


def load_collisions(source: str | bytes | os.PathLike[str]) -> tuple[Visual, ...]:
    """Return the collision shapes of a URDF's links; arguments as for `load_visuals`."""
    return _load(source, 'collision')


def _load(source: str | bytes | os.PathLike[str], tag: str) -> tuple[Visual, ...]:
    """Return the shapes in all elements of a tag."""
    other = 'visual' if tag == 'collision' else 'collision'
    robot = read_robot(parse(read_source(source), depth=_DEPTH, unread=(other,)),
                       {**_CHILDREN, 'link': (tag,)})
    colors = {material.name: material.color for material in robot.materials or ()}
    is_path = not isinstance(source, bytes) and not str(source).lstrip().startswith('<')
    here = Path(os.fspath(source)).resolve().parent if is_path else None  # type: ignore[arg-type]
    found, missing = [], set()
    for link in robot.links:
        for visual in getattr(link, f'{tag}s') or ():
            shape = _visual(link.name, visual, colors, here)
            if shape is None:
                continue
            if shape.kind == 'mesh' and shape.file is None:
                missing.add(visual.geometry.mesh.filename)
            else:
                found.append(shape)
    if missing:
        warnings.warn(f'{len(missing)} meshes not found: links without another shape are drawn '
                      'as rods; expected the URDF inside its package or the workspace in '
                      f'AMENT_PREFIX_PATH; missing: {", ".join(sorted(missing))}', ModelWarning,
                      stacklevel=3)
    return tuple(found)


def _visual(link: str, visual: Any, colors: dict[str, Any], here: Path | None) -> Visual | None:
    """Convert yourdfpy's record; return None if it has no shape."""
    for kind, names in _SIZES.items():
        shape = getattr(visual.geometry, kind, None)
        if shape is None:
            continue
        size = np.hstack([1.0 if (x := getattr(shape, name)) is None else x for name in names])
        if kind == 'mesh':
            size = np.broadcast_to(size, 3)
        pose = np.eye(4) if visual.origin is None else visual.origin
        material = getattr(visual, 'material', None)
        color = material and (material.color or colors.get(material.name))
        return Visual(link, kind, size, pose,  # type: ignore[arg-type]
                      np.asarray(color.rgba[:3]) if color is not None else None,
                      _found(shape.filename, here) if kind == 'mesh' else None)
    return None


def _found(name: str, here: Path | None) -> Path | None:
    """Return the path of a file named in a URDF, or None if it does not exist."""
    scheme, _, rest = name.rpartition('://')
    package, _, inside = rest.partition('/') if scheme == 'package' else ('', '', rest)
    candidates = [Path(inside)] if Path(inside).is_absolute() else []
    for folder in (here, *here.parents) if here else ():
        candidates += [folder / package / inside, folder / inside]
    for variable in _SHARES:
        candidates += [Path(prefix) / 'share' / package / inside
                       for prefix in os.environ.get(variable, '').split(os.pathsep) if prefix]
    return next((path for path in candidates if path.is_file()), None)
