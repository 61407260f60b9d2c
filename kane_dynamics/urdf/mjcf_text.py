"""The text of an MJCF file, the format of MuJoCo, that describes a model."""

from collections.abc import Sequence
import math
import warnings
from xml.etree import ElementTree

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError, ModelWarning
from kane_dynamics.model.model import Body, Joint, Model, WORLD
import numpy as np

KINDS = {'revolute': 'hinge', 'prismatic': 'slide'}
# Terms of friction that MuJoCo lacks, with their values in a joint without them.
LACKING = ('fast_damping', 'friction_backward', 'breakaway_friction', 'load_friction',
           'load_friction_backdriven', 'friction_offset', 'presliding_stiffness')


def mjcf_text(model: Model, tendons: Sequence[tuple[str, dict[str, float],
                                                    dict[str, float]]] = ()) -> str:
    """
    Return an MJCF file with the bodies, joints, frames (as sites) and limits of a model.

    Friction is MuJoCo's frictionloss, which acts in full at any rate. `load_mjcf` of the
    text returns a model with the same dynamics.

    Parameters
    ----------
    model : Model
        Tree of rigid bodies with a joint of one coordinate each. Mimic joints become
        equality constraints, which MuJoCo satisfies nearly.
    tendons : sequence of (str, dict, dict)
        Names, coefficients by joint, and attributes, of fixed tendons: motors that turn with
        several joints.

    Raises
    ------
    InputError
        The model has ball joints, beams, or elastic joints.

    Warns
    -----
    ModelWarning
        Naming the joints with terms of friction that MuJoCo lacks.

    """
    if model.flexible or model.balls or model.drives:
        raise InputError('model: with beams, ball joints or elastic joints; expected a tree '
                         'of rigid bodies with a joint of one coordinate each')
    lacking = [body.joint.name for body in model.bodies if _has_other_friction(body.joint)]
    if lacking:
        warnings.warn(f'MJCF: friction of {", ".join(lacking)} is written as damping and '
                      'Coulomb friction; expected these alone, since MuJoCo has no other '
                      'terms', ModelWarning, stacklevel=2)
    root = ElementTree.Element('mujoco', model=model.name)
    ElementTree.SubElement(root, 'compiler', angle='radian', autolimits='true')
    ElementTree.SubElement(root, 'option', gravity=_numbers(model.gravity))
    elements = {WORLD: ElementTree.SubElement(root, 'worldbody')}
    for number, body in enumerate(model.bodies):
        elements[number] = _body(elements[body.parent], body)
    for frame in model.frames:
        ElementTree.SubElement(elements[frame.body], 'site', name=frame.name,
                               pos=_numbers(frame.translation),
                               xyaxes=_numbers(frame.rotation[:, :2].T.ravel()))
    mimics = [body.joint for body in model.bodies
              if body.joint.name not in model.coordinate_names]
    if mimics:
        equalities = ElementTree.SubElement(root, 'equality')
    for joint in mimics:
        ElementTree.SubElement(
            equalities, 'joint', joint1=joint.name,
            joint2=model.coordinate_names[joint.coordinate],
            polycoef=_numbers([joint.offset, joint.multiplier, 0.0, 0.0, 0.0]))
    if tendons:
        of_motors = ElementTree.SubElement(root, 'tendon')
    for name, coefficients, attributes in tendons:
        texts = {key: repr(float(value)) for key, value in attributes.items()}
        tendon = ElementTree.SubElement(of_motors, 'fixed', {'name': name, **texts})
        for of_joint, coefficient in coefficients.items():
            ElementTree.SubElement(tendon, 'joint', joint=of_joint, coef=repr(coefficient))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding='unicode') + '\n'


def _has_other_friction(joint: Joint) -> bool:
    """Return whether a joint has terms of friction that MuJoCo lacks."""
    return any(getattr(joint, name) not in (None, getattr(Joint, name)) for name in LACKING)


def _body(parent: ElementTree.Element, body: Body) -> ElementTree.Element:
    """Return the element of a body, with its joint and inertial."""
    joint, inertial = body.joint, body.inertial
    element = ElementTree.SubElement(
        parent, 'body', name=body.name, pos=_numbers(joint.translation),
        xyaxes=_numbers(joint.rotation[:, :2].T.ravel()))
    attributes = {'name': joint.name, 'type': KINDS[joint.kind],
                  'axis': _numbers(joint.axis)}
    for key, value in (('damping', joint.damping), ('frictionloss', joint.friction),
                       ('armature', joint.armature), ('stiffness', joint.stiffness),
                       ('springref', joint.rest)):
        if value:
            attributes[key] = repr(float(value))
    limits = joint.limits
    if math.isfinite(limits.lower) and math.isfinite(limits.upper):
        attributes['range'] = _numbers([limits.lower, limits.upper])
    if math.isfinite(limits.effort):
        attributes['actuatorfrcrange'] = _numbers([-limits.effort, limits.effort])
    ElementTree.SubElement(element, 'joint', attributes)
    if inertial.mass > 0.0:
        moments = inertial.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        ElementTree.SubElement(element, 'inertial', pos=_numbers(inertial.com),
                               mass=repr(float(inertial.mass)),
                               fullinertia=_numbers(moments))
    return element


def _numbers(values: Sequence[float] | Array) -> str:
    """Return numbers with all digits."""
    return ' '.join(repr(float(value)) for value in np.asarray(values))
