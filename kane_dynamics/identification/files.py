"""An identified model as files: a URDF, and a supplement for what a URDF cannot say."""

import os
from typing import Any

from kane_dynamics.errors import InputError
from kane_dynamics.model import Model, WORLD
from kane_dynamics.urdf.rewrite import rewritten
import yaml

PASSIVE = ('damping', 'friction', 'friction_speed', 'friction_offset', 'armature', 'stiffness',
           'rest')


def written(source: str | bytes | os.PathLike[str], model: Model) -> tuple[str, str]:
    """
    Return the texts of a URDF and of its supplement that together say what a model says.

    `load_urdf(urdf, supplement=supplement, ...)` with the arguments of the first load returns the
    model's dynamics. A moving body's whole inertial stands at its first link; links that are
    fixed or locked to it lose theirs, as does a payload of the former supplement.

    Parameters
    ----------
    source : path, or str or bytes of XML
        The URDF that the model came from.
    model : Model
        What to say.

    Raises
    ------
    InputError
        A body of the model is no link: floating and planar joints cannot be written.
    UrdfError
        The URDF cannot be read, or is not the model's.

    """
    links = {frame.name for frame in model.frames}
    bodies = {body.name: body for body in model.bodies}
    strange = sorted(set(bodies) - links)
    if strange:
        raise InputError(f'bodies {strange} are no links of the URDF; a model with floating or '
                         'planar joints cannot be written')
    riders = [frame.name for frame in model.frames
              if frame.body != WORLD and frame.name not in bodies]
    urdf = rewritten(source, {name: body.inertial for name, body in bodies.items()}, riders, {
        body.joint.name: (body.joint.damping, body.joint.friction) for body in model.bodies})
    joints: dict[str, dict[str, Any]] = {
        body.joint.name: {key: getattr(body.joint, key) for key in PASSIVE}
        for body in model.bodies}
    return urdf, yaml.safe_dump({'joints': joints}, sort_keys=False)
