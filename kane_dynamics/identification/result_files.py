"""What was identified as files: a URDF, and a supplement for what a URDF cannot say."""

import os
from pathlib import Path
from typing import Any
import warnings

from kane_dynamics.errors import InputError, ModelWarning
from kane_dynamics.model.model import Inertial, Model, WORLD
from kane_dynamics.urdf import load_urdf
from kane_dynamics.urdf.rewrite import rewritten
from kane_dynamics.urdf.supplement import INERTIA_KEYS, read_supplement
import numpy as np
import yaml

PASSIVE = ('damping', 'friction', 'friction_speed', 'friction_offset', 'armature', 'stiffness',
           'rest')


def written(source: str | bytes | os.PathLike[str], model: Model) -> tuple[str, str]:
    """
    Return the texts of a URDF and of its supplement that together say what a model says.

    `load_urdf(urdf, supplement=supplement, ...)` with the arguments of the first load returns the
    model's dynamics. A moving body's whole inertial stands at its first link; links that are
    fixed to it lose theirs, as does a payload of the former supplement. Links that joints move
    which the model has locked keep theirs, so that these joints can still move, and the body's
    first link has the rest. Where that would leave it no possible inertia, the share of them that
    leaves half of the possible is kept.

    Warns
    -----
    ModelWarning
        Links behind locked joints keep less than they had; names them.

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
    inertials = _parted(source, model)
    riders = [frame.name for frame in model.frames
              if frame.body != WORLD and frame.name not in inertials]
    urdf = rewritten(source, inertials, riders, {
        body.joint.name: (body.joint.damping, body.joint.friction) for body in model.bodies})
    joints: dict[str, dict[str, Any]] = {
        body.joint.name: {key: getattr(body.joint, key) for key in PASSIVE}
        for body in model.bodies}
    return urdf, yaml.safe_dump({'joints': joints}, sort_keys=False)


def _parted(source: str | bytes | os.PathLike[str], model: Model) -> dict[str, Inertial]:
    """Return the inertials of all links that joints of the URDF move, locked ones or not."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', ModelWarning)
        whole = load_urdf(source, strict=False)  # its fixed joints merge, no other does
    given = {body.name: body.inertial for body in whole.bodies}
    found = {body.name: body.inertial for body in model.bodies}
    for number, body in enumerate(model.bodies):
        locked = {frame.name: frame for frame in model.frames
                  if frame.body == number and frame.name in given and frame.name != body.name}
        heavy = [name for name in locked if given[name].mass > 0.0]
        if not heavy:
            continue
        total = body.inertial.pseudo_inertia
        theirs = sum(given[name].moved(locked[name].rotation,
                                       locked[name].translation).pseudo_inertia for name in heavy)
        # The largest share s for which total - s theirs is positive semidefinite.
        root = np.linalg.inv(np.linalg.cholesky(total))
        most = 1.0 / float(np.linalg.eigvalsh(root @ theirs @ root.T)[-1])
        share = 1.0 if most > 1.0 else 0.5 * most
        if share < 1.0:
            warnings.warn(f"links {heavy} behind locked joints: heavier than body '{body.name}', "
                          f'which carries them, was found to be; they keep {share:.1%} of their '
                          'inertials', ModelWarning, stacklevel=3)
        found[body.name] = Inertial.from_pseudo_inertia(total - share * theirs)
        for name in heavy:
            found[name] = Inertial.from_pseudo_inertia(share * given[name].pseudo_inertia)
    return found


def written_payload(supplement: str | os.PathLike[str] | None, link: str, payload: Inertial
                    ) -> str:
    """
    Return the text of a supplement that also says what a link carries.

    Parameters
    ----------
    supplement : path, optional
        What was known before; its comments are lost.
    link : str
        In whose axes, and about whose origin, the payload is given.
    payload : Inertial
        What it carries.

    Raises
    ------
    InputError
        The supplement has a payload already.

    """
    if read_supplement(supplement).payload is not None:
        raise InputError(f"supplement '{supplement}' has a payload already; a recording tells "
                         'what the arm carries besides: take it out first')
    known: Any = {} if supplement is None else yaml.safe_load(Path(supplement).read_bytes())
    moments = dict(zip(INERTIA_KEYS, six(payload), strict=True))
    return yaml.safe_dump({**(known or {}), 'payload': {
        'link': link, 'mass': payload.mass, 'com': payload.com.tolist(), 'inertia': moments}},
        sort_keys=False)


def six(payload: Inertial) -> list[float]:
    """Return the inertia as ixx, ixy, ixz, iyy, iyz, izz: the order of supplement and node."""
    return [float(payload.inertia[r, s]) for r, s in zip(*np.triu_indices(3), strict=True)]
