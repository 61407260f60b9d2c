"""Write identified models: a URDF, and a supplement for properties that URDF lacks."""

from collections.abc import Sequence
import os
from pathlib import Path
from typing import Any
import warnings

from kane_dynamics.errors import InputError, ModelWarning
from kane_dynamics.identification.friction_laws import COUPLED_SPEED, CoupledMotor
from kane_dynamics.model.model import FRICTION, Inertial, Joint, Model, WORLD
from kane_dynamics.urdf import load_urdf
from kane_dynamics.urdf.rewritten_urdf import rewritten
from kane_dynamics.urdf.supplement import INERTIA_KEYS, read_supplement
import numpy as np
import yaml

PASSIVE = (*FRICTION, 'friction_speed', 'armature', 'stiffness', 'rest')
OF_SOME = ('fast_damping', 'damping_speed', 'friction_backward', 'breakaway_friction',
           'stribeck_speed',
           'load_friction', 'load_friction_backdriven', 'presliding_stiffness',
           'presliding_damping')  # written if not the default


def written(source: str | bytes | os.PathLike[str], model: Model,
            motors: Sequence[CoupledMotor] = ()) -> tuple[str, str, str]:
    """
    Return the texts of a URDF, of its supplement and constraints that describe a model.

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
    motors : sequence of CoupledMotor
        Each is written as a joint of a link without mass, whose position is the sum or the
        difference of those of two joints by a constraint; without any, the text of the
        constraints is empty.

    Raises
    ------
    InputError
        If a body of the model is no link: floating and planar joints cannot be written.
    UrdfError
        If the URDF cannot be read, or is not that of the model.

    """
    inertials, riders = _inertials(source, model)

    # The URDF has damping and friction, the supplement all other properties.
    losses = {}
    joints: dict[str, dict[str, Any]] = {}
    for body in model.bodies:
        joint = body.joint
        losses[joint.name] = joint.damping, joint.friction
        joints[joint.name] = _passive(joint)
    urdf = rewritten(source, inertials, riders, losses)
    if not motors:
        return urdf, yaml.safe_dump({'joints': joints}, sort_keys=False), ''
    end = urdf.rindex('</robot>')
    elements = []
    constraints = {}
    for motor in motors:
        elements.append(_motor_elements(motor, model.base_name))
        joints[motor.name] = {'armature': motor.inertia, 'friction_speed': COUPLED_SPEED}
        ratios = dict(zip(motor.joints, (1.0, motor.sign), strict=True))
        constraints[motor.name] = {'coupling': {'joint': motor.name, 'ratios': ratios}}
    names = list(model.joint_names)
    options = {'constraints': constraints, 'independent': names, 'actuated': names}
    return (urdf[:end] + ''.join(elements) + urdf[end:],
            yaml.safe_dump({'joints': joints}, sort_keys=False),
            yaml.safe_dump(options, sort_keys=False))


def _motor_elements(motor: CoupledMotor, base: str) -> str:
    """Return the XML of a motor that turns with two joints: a joint of a massless link."""
    return (f'  <link name="{motor.name}_rotor">\n    <inertial>\n      <mass value="0"/>\n'
            '      <inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/>\n'
            f'    </inertial>\n  </link>\n  <joint name="{motor.name}" type="continuous">\n'
            f'    <parent link="{base}"/>\n    <child link="{motor.name}_rotor"/>\n'
            '    <axis xyz="0 0 1"/>\n'
            f'    <dynamics damping="{motor.damping!r}" friction="{motor.friction!r}"/>\n'
            '  </joint>\n')


def written_links(source: str | bytes | os.PathLike[str], model: Model,
                  supplement: str | os.PathLike[str] | None = None) -> str:
    """
    Return the text of a supplement with the inertials of a model.

    Parameters
    ----------
    source, model
        As of `written`, which has the same inertials.
    supplement : path, optional
        Former supplement; its comments are lost. Its payload is part of the model, and
        is left out.

    """
    content = _former(supplement)
    content.pop('payload', None)
    inertials, riders = _inertials(source, model)
    links: dict[str, Any] = {}
    for name, inertial in inertials.items():
        moments = dict(zip(INERTIA_KEYS, six(inertial), strict=True))
        links[name] = {'mass': float(inertial.mass), 'com': inertial.com.tolist(),
                       'inertia': moments}
    for name in riders:
        links[name] = {'mass': 0.0}
    return yaml.safe_dump({**content, 'links': links}, sort_keys=False,
                          default_flow_style=None)


def _inertials(source: str | bytes | os.PathLike[str],
               model: Model) -> tuple[dict[str, Inertial], list[str]]:
    """Return the inertials of links that joints move, and the links that have none then."""
    links = {frame.name for frame in model.frames}
    strange = sorted({body.name for body in model.bodies} - links)
    if strange:
        raise InputError(f'bodies {strange}: no links of the URDF; expected a model '
                         'without floating or planar joints')
    inertials = _link_inertials(source, model)
    # Frames behind fixed joints ride on a body: its inertia covers them.
    riders = [frame.name for frame in model.frames
              if frame.body != WORLD and frame.name not in inertials]
    return inertials, riders


def _passive(joint: Joint) -> dict[str, float]:
    """Return the passive properties of a joint for a supplement."""
    properties = {}
    for key in PASSIVE:
        value = getattr(joint, key)
        if key in OF_SOME and value == getattr(Joint, key):
            continue
        properties[key] = value
    return properties


def _link_inertials(source: str | bytes | os.PathLike[str],
                    model: Model) -> dict[str, Inertial]:
    """Return the inertials of all links that joints of the URDF move, also locked joints."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', ModelWarning)
        whole = load_urdf(source, strict=False)  # merges fixed joints only
    stated = {body.name: body.inertial for body in whole.bodies}
    inertials = {body.name: body.inertial for body in model.bodies}
    for number, body in enumerate(model.bodies):
        # Links behind locked joints are parts of the body: they keep their stated
        # inertials, and the link of the body gets the rest.
        heavy = []
        of_locked = np.zeros((4, 4))
        for frame in model.frames:
            is_locked = (frame.body == number and frame.name in stated
                         and frame.name != body.name)
            if is_locked and stated[frame.name].mass > 0.0:
                heavy.append(frame.name)
                on_body = stated[frame.name].moved(frame.rotation, frame.translation)
                of_locked += on_body.pseudo_inertia
        if not heavy:
            continue
        total = body.inertial.pseudo_inertia
        # The largest share s for which total - s of_locked is positive semidefinite.
        root = np.linalg.inv(np.linalg.cholesky(total))
        largest_share = 1.0 / float(np.linalg.eigvalsh(root @ of_locked @ root.T)[-1])
        share = 1.0 if largest_share > 1.0 else 0.5 * largest_share
        if share < 1.0:
            warnings.warn(f'links {heavy} behind locked joints: heavier than their '
                          f"identified body '{body.name}'; they keep {share:.1%} of "
                          'their inertials; expected at most the inertia of the body',
                          ModelWarning, stacklevel=3)
        inertials[body.name] = Inertial.from_pseudo_inertia(total - share * of_locked)
        for name in heavy:
            inertials[name] = Inertial.from_pseudo_inertia(share * stated[name].pseudo_inertia)
    return inertials


def written_payload(supplement: str | os.PathLike[str] | None, link: str,
                    payload: Inertial
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
    # The payload of a supplement is part of the model that was identified.
    content = _former(supplement)
    if content.get('payload') is not None:
        raise InputError(f"supplement '{supplement}': has a payload already; expected "
                         'none, since the identified payload would be added to it')
    moments = dict(zip(INERTIA_KEYS, six(payload), strict=True))
    load = {'link': link, 'mass': payload.mass, 'com': payload.com.tolist(),
            'inertia': moments}
    return yaml.safe_dump({**content, 'payload': load}, sort_keys=False)


def written_drives(supplement: str | os.PathLike[str] | None, drives: str) -> str:
    """
    Return the text of a supplement with drives that replace those of a former one.

    Parameters
    ----------
    supplement : path, optional
        Former supplement; its comments are lost.
    drives : str
        Text of a supplement of drives alone.

    """
    content = _former(supplement)
    former = content.get('drives') or {}
    content['drives'] = {**former, **yaml.safe_load(drives)['drives']}
    return yaml.safe_dump(content, sort_keys=False)


def _former(supplement: str | os.PathLike[str] | None) -> dict[str, Any]:
    """Return the content of a supplement, empty without one; raise of an invalid one."""
    if supplement is None:
        return {}
    read_supplement(supplement)
    return yaml.safe_load(Path(supplement).read_bytes()) or {}


def six(payload: Inertial) -> list[float]:
    """Return the inertia as ixx, ixy, ixz, iyy, iyz, izz: the order of supplement and node."""
    return [float(moment) for moment in payload.inertia[np.triu_indices(3)]]
