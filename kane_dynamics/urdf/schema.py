"""
Check the elements, attributes and numbers of a URDF before conversion.

yourdfpy uses the first of several elements, replaces missing values by defaults and
accepts any number that float() accepts. So all of them are checked here first, and
unused ones are noted.
"""

from dataclasses import dataclass, field
import re
import sys

from kane_dynamics.errors import UrdfError
from kane_dynamics.urdf.document import Element
from kane_dynamics.urdf.notices import Notices
from kane_dynamics.urdf.tree import MOVING, TYPES

NUMBER = re.compile(r'[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?', re.ASCII)
LONGEST = 1000  # characters of a name or number
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
    'origin': Rule(numbers={'xyz': 3, 'rpy': 3}),
    'axis': Rule(required=('xyz',), numbers={'xyz': 3}),
    'limit': Rule(numbers=dict.fromkeys(('lower', 'upper', 'velocity', 'effort'), 1)),
    'dynamics': Rule(numbers={'damping': 1, 'friction': 1}),
    'mimic': Rule(required=('joint',), numbers={'multiplier': 1, 'offset': 1}),
}
MANY = ('link', 'joint')
NEEDED = {'inertial': ('mass', 'inertia'), 'joint': ('parent', 'child')}
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

    Raises
    ------
    UrdfError
        If an element is invalid; the message names the link or joint, element and
        attribute.

    """
    if root.tag != 'robot':
        raise UrdfError(f'root element: <{root.tag}> (line {root.line}); expected '
                        '<robot>: MJCF is read by load_mjcf, SDF must be converted '
                        'first')
    # Elements by the schema, then what it cannot state: joints, and that there are
    # links.
    _check(root, '', notices)
    for joint in root.find_all('joint'):
        _check_joint(joint)
    if root.first('link') is None:
        raise UrdfError(f"robot '{root.attributes['name']}': no <link>; expected at "
                        'least one')


def _check(element: Element, owner: str, notices: Notices) -> None:
    """Check an element and its children; `owner` is the link or joint in messages."""
    rule = RULES[element.tag]
    # Links and joints are named in messages; other elements by the one that has them.
    if element.tag in ('robot', *MANY):
        if not element.attributes.get('name', '').strip():
            raise UrdfError(f'<{element.tag}> (line {element.line}): name '
                            f'{element.attributes.get("name")!r}; expected a nonempty '
                            'name')
        owner = f"{element.tag} '{element.attributes['name']}'"
        what = owner
    else:
        what = f'{owner}: <{element.tag}>'
    _check_attributes(element, owner, what, notices)
    if element.tag == 'origin':
        # Angles of more than a turn are most likely degrees.
        angles = element.attributes.get('rpy', '').split()
        if any(abs(float(angle)) > FULL_TURN for angle in angles):
            notices.degree_rpy.append(f"{owner} ({element.attributes['rpy']})")
    for tag in rule.children:
        if tag not in MANY and len(list(element.find_all(tag))) > 1:
            raise UrdfError(f'{what}: more than one <{tag}> (line {element.line}); '
                            'expected one')
    for tag in NEEDED.get(element.tag, ()):
        if element.first(tag) is None:
            raise UrdfError(f'{what}: no <{tag}> (line {element.line}); expected '
                            'exactly one')
    # What no rule knows is noted, not refused: files have elements of many programs.
    for child in element.children:
        if child.tag in rule.children:
            _check(child, owner, notices)
        else:
            _note_element(child, owner, notices)


def _check_attributes(element: Element, owner: str, what: str, notices: Notices) -> None:
    """Check required attributes and the format of numbers."""
    rule = RULES[element.tag]
    for name in rule.required:
        if not element.attributes.get(name, '').strip():
            raise UrdfError(f"{what}: no attribute '{name}' (line {element.line}); "
                            f"expected {', '.join(rule.required)}")
    for name, text in element.attributes.items():
        if len(text) > LONGEST:
            raise UrdfError(f'<{element.tag}> (line {element.line}): {name} has '
                            f"{len(text)} characters, '{text[:40]}...'; expected at "
                            f'most {LONGEST}')
        if name in rule.numbers:
            _check_numbers(element, text, rule.numbers[name], f'{what} {name}')
        # Attributes with a prefix belong to other tools.
        elif name not in (*rule.required, *rule.optional, *HARMLESS) and ':' not in name:
            notices.not_used(f"<{element.tag}> attribute '{name}'", owner)


def _check_numbers(element: Element, text: str, count: int, what: str) -> None:
    """Raise UrdfError if a text is not `count` finite decimal numbers."""
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
    raise UrdfError(f"{what}: '{text}' (line {element.line}); expected {expected}")


def _check_joint(joint: Element) -> None:
    """Raise UrdfError for an unknown joint type, or one that cannot have <mimic>."""
    what = f"joint '{joint.attributes['name']}'"
    kind = joint.attributes.get('type')
    if kind not in TYPES:
        raise UrdfError(f'{what}: type {kind!r} (line {joint.line}); expected one of '
                        f'{", ".join(TYPES)}')
    if kind not in (*MOVING, 'fixed') and joint.first('mimic') is not None:
        raise UrdfError(f'{what}: {kind} with <mimic> (line {joint.line}); expected '
                        f'<mimic> only on types {", ".join(MOVING)}')


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
