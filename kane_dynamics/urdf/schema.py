"""
Check the elements, attributes and numbers of a URDF before conversion.

yourdfpy uses the first of several elements, replaces missing values by defaults and
accepts any number that float() accepts. So all of them are checked here first. What may
change a number and is not understood is an error, with ``strict=False`` a warning; other
unused elements and attributes are noted.

URDF 1.0, 1.1 (`quat_xyzw`, capsules) and 1.2 (limits of acceleration and jerk) are read,
as urdfdom 6 reads them.
"""

from dataclasses import dataclass, field
import math
import re
import sys

from kane_dynamics._util.orientation import UNIT_LENGTH
from kane_dynamics.errors import UrdfError
from kane_dynamics.urdf.document import Element
from kane_dynamics.urdf.notices import Notices
from kane_dynamics.urdf.tree import MOVING, TYPES

NUMBER = re.compile(r'[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?', re.ASCII)
LONGEST = 1000  # characters of a name or number
ZEROS = re.compile(r'\s*([+-]?0*\.?0*([eE][+-]?\d+)?\s*)*')
FULL_TURN = 6.3  # rad, a little over 2 pi: larger angles of an origin look like degrees
LARGEST = 1e60  # larger numbers overflow in products; larger limits mean 'none'


@dataclass(frozen=True)
class Rule:
    """Rule for an element: children, required attributes, and counts of numbers."""

    children: tuple[str, ...] = ()
    required: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()
    numbers: dict[str, int] = field(default_factory=dict)


INERTIA = ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')
RULES = {
    'robot': Rule(('link', 'joint'), ('name',), ('version',)),
    'link': Rule(('inertial',), ('name',), ('type',)),
    'inertial': Rule(('origin', 'mass', 'inertia')),
    'mass': Rule(required=('value',), numbers={'value': 1}),
    'inertia': Rule(required=INERTIA, numbers=dict.fromkeys(INERTIA, 1)),
    'joint': Rule(('parent', 'child', 'origin', 'axis', 'limit', 'dynamics', 'mimic'),
                  ('name',), ('type',)),
    'parent': Rule(required=('link',)),
    'child': Rule(required=('link',)),
    'origin': Rule(numbers={'xyz': 3, 'rpy': 3, 'quat_xyzw': 4}),
    'axis': Rule(required=('xyz',), numbers={'xyz': 3}),
    'limit': Rule(numbers=dict.fromkeys(('lower', 'upper', 'velocity', 'effort'), 1)),
    'dynamics': Rule(numbers={'damping': 1, 'friction': 1}),
    'mimic': Rule(required=('joint',), numbers={'multiplier': 1, 'offset': 1}),
}
VERSIONS = ('1.0', '1.1', '1.2')
# Elements whose attributes are numbers of the model: an unknown one is an error.
NUMERIC = ('origin', 'axis', 'mass', 'inertia', 'limit', 'mimic', 'dynamics')
# Attributes of these that change no number of ours: limits of other quantities, and
# numbers of single drivers that no reader of URDF uses (Franka, KUKA LWR).
UNRELATED = {
    'limit': ('acceleration', 'deceleration', 'jerk', 'k_velocity', 'k_position',
              'soft_lower_limit', 'soft_upper_limit', 'current', 'command_effort',
              'gear_velocity', 'twist'),
    'dynamics': ('K', 'D', 'mu_coulomb', 'mu_viscous')}
# The lower triangle of an inertia repeats the upper one, and no reader of URDF uses it.
MIRRORED = {'iyx': 'ixy', 'izx': 'ixz', 'izy': 'iyz'}
MANY = ('link', 'joint')
NEEDED = {'inertial': ('mass',), 'joint': ('parent', 'child')}
POINT_MASS = dict.fromkeys(INERTIA, '0')
CHILDREN = {tag: rule.children for tag, rule in RULES.items()}
# Elements and attributes that do not concern dynamics: no warning.
HARMLESS = {'visual', 'collision', 'material', 'gazebo', 'ros2_control', 'sensor',
            'camera', 'contact', 'self_collision_checking', 'collision_checking',
            'self_filter', 'verbose', 'group', 'disable_collisions', 'xmlns',
            'dont_collapse'}
# <gazebo> elements that change a simulated robot's motion.
GAZEBO = {'springStiffness', 'springReference', 'spring_stiffness', 'spring_reference',
          'implicitSpringDamper', 'dampingFactor', 'damping', 'friction',
          'turnGravityOff', 'gravity', 'stopCfm', 'stopErp', 'fudgeFactor', 'maxVel',
          'joint', 'link'}
XACRO = 'xacro FILE.urdf.xacro > FILE.urdf, or load a file whose name ends in .xacro'


def check_schema(root: Element, notices: Notices) -> None:
    """
    Check all elements; note unused elements that a user might expect to be used.

    Faults are collected in the notices: the message of each names the link or joint,
    element and attribute. With ``strict=False``, an <inertial> without <inertia> becomes
    that of a point mass.

    Raises
    ------
    UrdfError
        If there are faults.

    """
    if root.tag != 'robot':
        raise UrdfError(f'root element: <{root.tag}> (line {root.line}); expected '
                        '<robot>: MJCF is read by load_mjcf, SDF must be converted '
                        'first')
    version = root.attributes.get('version', VERSIONS[0]).strip()
    if version not in VERSIONS:
        notices.not_understood(f"version '{version}'", '<robot>', root.line,
                               f'one of {", ".join(VERSIONS)}')
    if version == VERSIONS[0]:
        _refuse_quaternions(root, notices)
    # Elements by the schema, then what it cannot state: joints, and that there are
    # links.
    _check(root, '', notices)
    for joint in root.find_all('joint'):
        _check_joint(joint, notices)
    if root.first('link') is None:
        name = root.attributes.get('name', '')
        notices.fault(UrdfError(f"robot '{name}': no <link>; expected at least one"))
    notices.refuse_faults()


def _refuse_quaternions(element: Element, notices: Notices) -> None:
    """Refuse `quat_xyzw` in a file of URDF 1.0, whose readers ignore it."""
    if element.tag == 'origin' and 'quat_xyzw' in element.attributes:
        notices.not_understood("attribute 'quat_xyzw'", '<origin>', element.line,
                               'rpy, or <robot version="1.1">')
        del element.attributes['quat_xyzw']
    for child in element.children:
        _refuse_quaternions(child, notices)


def _check(element: Element, owner: str, notices: Notices) -> None:
    """Check an element and its children; `owner` is the link or joint in messages."""
    rule = RULES[element.tag]
    # Links and joints are named in messages; other elements by the one that has them.
    if element.tag in ('robot', *MANY):
        if not element.attributes.get('name', '').strip():
            notices.fault(UrdfError(f'<{element.tag}> (line {element.line}): name '
                                    f'{element.attributes.get("name")!r}; expected a '
                                    'nonempty name'))
            return
        owner = f"{element.tag} '{element.attributes['name']}'"
        what = owner
    else:
        what = f'{owner}: <{element.tag}>'
    if element.tag == 'inertial' and element.first('inertia') is None:
        notices.not_understood('no <inertia>', what, element.line,
                               '<inertia>, or strict=False for a point mass')
        element.children.append(Element('inertia', dict(POINT_MASS), element.line))
    _check_attributes(element, owner, what, notices)
    for tag in rule.children:
        if tag not in MANY and len(list(element.find_all(tag))) > 1:
            notices.fault(UrdfError(f'{what}: more than one <{tag}> (line '
                                    f'{element.line}); expected one'))
    for tag in NEEDED.get(element.tag, ()):
        if element.first(tag) is None:
            notices.fault(UrdfError(f'{what}: no <{tag}> (line {element.line}); expected '
                                    'exactly one'))
    # An element that no rule knows is noted, not refused: files have elements of many
    # programs.
    for child in element.children:
        if child.tag in rule.children:
            _check(child, owner, notices)
        else:
            _note_element(child, owner, notices)


def _check_attributes(element: Element, owner: str, what: str, notices: Notices) -> None:
    """Check required attributes, the format of numbers, and unknown attributes."""
    rule = RULES[element.tag]
    for name in rule.required:
        if not element.attributes.get(name, '').strip():
            notices.fault(UrdfError(f"{what}: no attribute '{name}' (line "
                                    f'{element.line}); expected '
                                    f'{", ".join(rule.required)}'))
    for name, text in element.attributes.items():
        if len(text) > LONGEST:
            notices.fault(UrdfError(
                f'<{element.tag}> (line {element.line}): {name} has {len(text)} '
                f"characters, '{text[:40]}...'; expected at most {LONGEST}"))
        elif name in rule.numbers:
            _check_numbers(element, text, rule.numbers[name], f'{what} {name}', notices)
        # Attributes with a prefix belong to other tools.
        elif name not in (*rule.required, *rule.optional, *HARMLESS) and ':' not in name:
            _check_unknown(element, name, owner, what, notices)
    if element.tag == 'origin':
        _check_orientation(element, owner, what, notices)


def _check_unknown(element: Element, name: str, owner: str, what: str,
                   notices: Notices) -> None:
    """Refuse an unknown attribute that may change a number; note any other."""
    text = element.attributes[name]
    mirrored = MIRRORED.get(name) if element.tag == 'inertia' else None
    if mirrored and _are_equal(text, element.attributes.get(mirrored, '')):
        return
    changes_no_number = (element.tag not in NUMERIC or ZEROS.fullmatch(text)
                         or mirrored or name in UNRELATED.get(element.tag, ()))
    if changes_no_number:
        notices.not_used(f"<{element.tag}> attribute '{name}'", owner)
        return
    rule = RULES[element.tag]
    expected = ', '.join(dict.fromkeys((*rule.required, *rule.numbers)))
    notices.not_understood(f"attribute '{name}' = '{text}'", what, element.line,
                           expected)


def _are_equal(text: str, other: str) -> bool:
    """Return whether two texts are the same number."""
    both = NUMBER.fullmatch(text.strip()) and NUMBER.fullmatch(other.strip())
    return bool(both) and float(text) == float(other)


def _check_orientation(origin: Element, owner: str, what: str, notices: Notices) -> None:
    """Refuse two orientations of an origin, and quaternions that are not of length 1."""
    angles = origin.attributes.get('rpy', '').split()
    parts = origin.attributes.get('quat_xyzw', '').split()
    if notices.faults:
        return  # these texts may not be numbers
    # Angles of more than a turn are most likely degrees.
    if any(abs(float(angle)) > FULL_TURN for angle in angles):
        notices.degree_rpy.append(f"{owner} ({origin.attributes['rpy']})")
    if not parts:
        return
    if 'rpy' in origin.attributes:
        notices.fault(UrdfError(f'{what}: rpy and quat_xyzw (line {origin.line}); '
                                'expected one of them'))
    length = math.hypot(*map(float, parts))
    if abs(length - 1.0) > UNIT_LENGTH:
        notices.fault(UrdfError(f'{what} quat_xyzw: length {length:.6g} (line '
                                f'{origin.line}); expected 1, in the order x, y, z, w'))


def _check_numbers(element: Element, text: str, count: int, what: str,
                   notices: Notices) -> None:
    """Refuse a text that is not `count` finite decimal numbers."""
    # Limits may be as large as a double, which means none; other numbers may not.
    largest = sys.float_info.max if element.tag == 'limit' else LARGEST
    parts = text.split()
    valid = len(parts) == count
    for part in parts:
        valid = valid and NUMBER.fullmatch(part) is not None and abs(float(part)) <= largest
    if valid:
        return
    expected = 'one finite number, like 0.5 or 1e-3'
    if count > 1:
        expected = f'{count} finite numbers separated by spaces, like "0 0.5 1e-3"'
    # The most common cause of text in place of numbers.
    if '${' in text:
        expected += f'; expand it with xacro first: {XACRO}'
    notices.fault(UrdfError(f"{what}: '{text}' (line {element.line}); expected "
                            f'{expected}'))


def _check_joint(joint: Element, notices: Notices) -> None:
    """Refuse an unknown joint type, or one that cannot have <mimic>."""
    what = f"joint '{joint.attributes.get('name', '')}'"
    kind = joint.attributes.get('type')
    if kind not in TYPES:
        notices.fault(UrdfError(f'{what}: type {kind!r} (line {joint.line}); expected '
                                f'one of {", ".join(TYPES)}'))
    elif kind not in (*MOVING, 'fixed') and joint.first('mimic') is not None:
        notices.fault(UrdfError(f'{what}: {kind} with <mimic> (line {joint.line}); '
                                f'expected <mimic> only on types {", ".join(MOVING)}'))


def _note_element(element: Element, owner: str, notices: Notices) -> None:
    """Note an unused element, unless it is known not to concern dynamics."""
    tag = element.tag
    if tag.startswith('xacro:'):
        raise UrdfError(f'{owner}: <{tag}> (line {element.line}); expected the output '
                        f'of xacro, which replaces this element: {XACRO}')
    # Transmissions and extensions of Gazebo are named by the joint or link that they are
    # of.
    if tag == 'transmission':
        names = [joint.attributes.get('name',
                                      '?') for joint in element.find_all('joint')]
        if not names:
            names = [element.attributes.get('name', '?')]
        for name in names:
            notices.not_used('<transmission>', name)
    elif tag == 'gazebo':
        for child in element.children:
            if child.tag in GAZEBO:
                notices.not_used(f'<gazebo> <{child.tag}>',
                                 element.attributes.get('reference', owner))
    elif tag not in HARMLESS and ':' not in tag:
        notices.not_used(f'<{tag}>', owner)
