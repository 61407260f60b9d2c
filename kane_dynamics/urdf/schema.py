"""
What a URDF may hold: elements, attributes, and numbers, checked before anyone converts them.

yourdfpy takes the first of several elements, fills in what is missing and lets any number pass
that float() knows. So everything is checked here first, and what is not used is noted.
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
LARGEST = 1e60  # beyond it products overflow; only limits may be larger, for 'none'


@dataclass(frozen=True)
class Rule:
    """An element: its children, the attributes it must have, and numbers with their counts."""

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
# Elements and attributes that nobody takes for dynamics: no word is lost on them.
HARMLESS = {'visual', 'collision', 'material', 'gazebo', 'ros2_control', 'sensor', 'camera',
            'contact', 'self_collision_checking', 'collision_checking', 'self_filter', 'verbose',
            'group', 'disable_collisions', 'xmlns', 'dont_collapse'}
# <gazebo> elements that change a simulated robot's motion.
GAZEBO = {'springStiffness', 'springReference', 'spring_stiffness', 'spring_reference',
          'implicitSpringDamper', 'dampingFactor', 'damping', 'friction', 'turnGravityOff',
          'gravity', 'stopCfm', 'stopErp', 'fudgeFactor', 'maxVel',
          'joint', 'link'}
XACRO = 'xacro FILE.urdf.xacro > FILE.urdf'


def check_schema(root: Element, notices: Notices) -> None:
    """
    Raise UrdfError for the first fault; note what is not used though it might seem to be.

    Raises
    ------
    UrdfError
        Names the link or joint, the element, the attribute, its value, and what is valid.

    """
    if root.tag != 'robot':
        raise UrdfError(f'the root element is <{root.tag}> (line {root.line}); valid: <robot>. '
                        'Other formats (SDF, MJCF) must be converted to URDF first')
    _check(root, '', notices)
    for joint in root.find_all('joint'):
        _check_joint(joint)
    if root.first('link') is None:
        raise UrdfError(f"robot '{root.attributes['name']}' has no <link>; valid: at least one")


def _check(element: Element, owner: str, notices: Notices) -> None:
    """Check an element, and what is below it; `owner` is the text that names it."""
    rule = RULES[element.tag]
    if element.tag in ('robot', *MANY):
        if not element.attributes.get('name', '').strip():
            raise UrdfError(f'a <{element.tag}> (line {element.line}) has the name '
                            f'{element.attributes.get("name")!r}; valid: a name that is not empty')
        owner = f"{element.tag} '{element.attributes['name']}'"
        what = owner
    else:
        what = f'{owner}: <{element.tag}>'
    _check_attributes(element, owner, what, notices)
    for tag in rule.children:
        if tag not in MANY and sum(1 for _ in element.find_all(tag)) > 1:
            raise UrdfError(f'{what} has more than one <{tag}> (line {element.line}); valid: one')
    for tag in NEEDED.get(element.tag, ()):
        if element.first(tag) is None:
            raise UrdfError(f'{what} has no <{tag}> (line {element.line}); valid: exactly one')
    for child in element.children:
        if child.tag in rule.children:
            _check(child, owner, notices)
        else:
            _note_element(child, owner, notices)


def _check_attributes(element: Element, owner: str, what: str, notices: Notices) -> None:
    """Check that required attributes are there and numbers are numbers."""
    rule = RULES[element.tag]
    for name in rule.required:
        if not element.attributes.get(name, '').strip():
            raise UrdfError(f"{what} has no attribute '{name}' (line {element.line}); it needs "
                            f"{', '.join(rule.required)}")
    for name, text in element.attributes.items():
        if len(text) > LONGEST:
            raise UrdfError(f'<{element.tag}> (line {element.line}): {name} is {len(text)} '
                            f"characters long, '{text[:40]}...'; valid: at most {LONGEST}")
        if name in rule.numbers:
            _check_numbers(element, text, rule.numbers[name], f'{what} {name}')
        elif name not in rule.required + rule.optional and ':' not in name and (
                name not in HARMLESS):
            notices.not_used(f"<{element.tag}> attribute '{name}'", owner)


def _check_numbers(element: Element, text: str, count: int, what: str) -> None:
    """Raise UrdfError unless a text is `count` finite decimal numbers, separated by spaces."""
    largest = sys.float_info.max if element.tag == 'limit' else LARGEST
    parts = text.split()
    if len(parts) != count or not all(
            NUMBER.fullmatch(part) and abs(float(part)) <= largest for part in parts):
        expected = ('one finite number, like 0.5 or 1e-3' if count == 1
                    else f'{count} finite numbers separated by spaces, like "0 0.5 1e-3"')
        hint = (f'; expand it with xacro first: {XACRO}' if '${' in text else '')
        raise UrdfError(f"{what} is '{text}' (line {element.line}); expected {expected}{hint}")


def _check_joint(joint: Element) -> None:
    """Raise UrdfError for a joint type that does not exist, or that cannot mimic."""
    what, kind = f"joint '{joint.attributes['name']}'", joint.attributes.get('type')
    if kind not in TYPES:
        raise UrdfError(f'{what}: type is {kind!r} (line {joint.line}); valid: '
                        f'{", ".join(TYPES)}')
    if kind not in (*MOVING, 'fixed') and joint.first('mimic') is not None:
        raise UrdfError(f'{what} is {kind} and has <mimic> (line {joint.line}); valid: on a joint '
                        f'that is {", ".join(MOVING)}')


def _note_element(element: Element, owner: str, notices: Notices) -> None:
    """Note an element that is not read, unless nobody would expect it to be."""
    tag = element.tag
    if tag.startswith('xacro:'):
        raise UrdfError(f'{owner} holds <{tag}> (line {element.line}), which xacro replaces; '
                        f'expected the output of xacro: {XACRO}')
    if tag == 'transmission':
        names = [x.attributes.get('name', '?') for x in element.find_all('joint')]
        for name in names or [element.attributes.get('name', '?')]:
            notices.not_used('<transmission>', name)
    elif tag == 'gazebo':
        for child in element.children:
            if child.tag in GAZEBO:
                notices.not_used(f'<gazebo> <{child.tag}>',
                                 element.attributes.get('reference', owner))
    elif tag not in HARMLESS and ':' not in tag:
        notices.not_used(f'<{tag}>', owner)
