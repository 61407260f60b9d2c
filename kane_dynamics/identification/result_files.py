"""Write identified models: a URDF, and a supplement for properties that URDF lacks."""

import os
from pathlib import Path
from typing import Any
import warnings

from kane_dynamics.errors import InputError, ModelWarning
from kane_dynamics.model.model import Inertial, Model, WORLD
from kane_dynamics.urdf import load_urdf
from kane_dynamics.urdf.rewritten_urdf import rewritten
from kane_dynamics.urdf.supplement import INERTIA_KEYS, read_supplement
import numpy as np
import yaml

PASSIVE = ('damping', 'friction', 'friction_speed', 'friction_offset', 'armature', 'stiffness',
           'rest')


def written(source: str | bytes | os.PathLike[str], model: Model) -> tuple[str, str]:
    """
    Return the texts of a URDF and of its supplement that describe a model.

    `load_urdf(urdf, supplement=supplement, ...)` with the arguments of the first load
    returns a model with the same dynamics. The first link of a moving body gets its
    whole inertial; links fixed to it, and a payload of the former supplement, get none.
    Links behind locked joints keep theirs, so that these joints can still move, and the
    first link gets the rest. If the rest is no possible inertia, they keep half of the
    largest possible fraction.

    Warns
    -----
    ModelWarning
        If links behind locked joints keep less than they had; the message names them.

    Parameters
    ----------
    source : path, or str or bytes of XML
        The URDF that the model came from.
    model : Model
        Model to write.

    Raises
    ------
    InputError
        If a body of the model is no link: floating and planar joints cannot be written.
    UrdfError
        If the URDF cannot be read, or is not that of the model.

    """
    links = {frame.name for frame in model.frames}
    bodies = {body.name: body for body in model.bodies}
    strange = sorted(set(bodies) - links)
    if strange:
        raise InputError(f'bodies {strange}: no links of the URDF; expected a model '
                         'without floating or planar joints')
    inertials = _link_inertials(source, model)
    riders = [frame.name for frame in model.frames
              if frame.body != WORLD and frame.name not in inertials]
    urdf = rewritten(source, inertials, riders, {
        body.joint.name: (body.joint.damping, body.joint.friction) for body in model.bodies})
    joints: dict[str, dict[str, Any]] = {
        body.joint.name: {key: getattr(body.joint, key) for key in PASSIVE}
        for body in model.bodies}
    return urdf, yaml.safe_dump({'joints': joints}, sort_keys=False)


def _link_inertials(source: str | bytes | os.PathLike[str], model: Model) -> dict[str, Inertial]:
    """Return the inertials of all links that joints of the URDF move, also locked joints."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', ModelWarning)
        whole = load_urdf(source, strict=False)  # merges fixed joints only
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
            warnings.warn(f'links {heavy} behind locked joints: heavier than their '
                          f"identified body '{body.name}'; they keep {share:.1%} of "
                          'their inertials; expected at most the inertia of the body',
                          ModelWarning, stacklevel=3)
        found[body.name] = Inertial.from_pseudo_inertia(total - share * theirs)
        for name in heavy:
            found[name] = Inertial.from_pseudo_inertia(share * given[name].pseudo_inertia)
    return found


def written_payload(supplement: str | os.PathLike[str] | None, link: str, payload: Inertial
                    ) -> str:
    """
    Return the text of a supplement with the payload of a link.

    Parameters
    ----------
    supplement : path, optional
        Former supplement; its comments are lost.
    link : str
        Link in whose axes, about whose origin, the payload is given.
    payload : Inertial
        Payload of the link.

    Raises
    ------
    InputError
        If the supplement has a payload already.

    """
    if read_supplement(supplement).payload is not None:
        raise InputError(f"supplement '{supplement}': has a payload already; expected "
                         'none, since the identified payload would be added to it')
    known: Any = {} if supplement is None else yaml.safe_load(Path(supplement).read_bytes())
    moments = dict(zip(INERTIA_KEYS, six(payload), strict=True))
    return yaml.safe_dump({**(known or {}), 'payload': {
        'link': link, 'mass': payload.mass, 'com': payload.com.tolist(), 'inertia': moments}},
        sort_keys=False)


def six(payload: Inertial) -> list[float]:
    """Return the inertia as ixx, ixy, ixz, iyy, iyz, izz: the order of supplement and node."""
    return [float(payload.inertia[r, s]) for r, s in zip(*np.triu_indices(3), strict=True)]
