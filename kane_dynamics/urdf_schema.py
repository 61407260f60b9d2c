"""
What a URDF may hold: elements, attributes, and numbers, checked before anyone converts them.

yourdfpy takes the first of several elements, fills in what is missing and lets any number pass
that float() knows. So everything is checked here first, and what is not used is noted.
"""

from dataclasses import dataclass, field
import math
import re

from kane_dynamics.errors import UrdfError
from kane_dynamics.tree import TYPES
from kane_dynamics.urdf_xml import Element

NUMBER = re.compile(r'[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?', re.ASCII)


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
                  ('name', 'type')),
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
# Elements that nobody takes for dynamics: no word is lost on them.
HARMLESS = {'visual', 'collision', 'material', 'gazebo', 'ros2_control', 'sensor', 'camera',
            'contact', 'self_collision_checking', 'verbose', 'group', 'disable_collisions'}
# <gazebo> elements that change a simulated robot's motion.
GAZEBO = {'springStiffness', 'springReference', 'spring_stiffness', 'spring_reference',
          'implicitSpringDamper', 'dampingFactor', 'damping', 'friction', 'turnGravityOff',
          'gravity', 'mu1', 'mu2', 'kp', 'kd', 'stopCfm', 'stopErp', 'fudgeFactor', 'maxVel',
          'joint', 'link'}


def check_schema(root: Element) -> list[str]:
    """
    Raise UrdfError for the first fault; return what is not used though it might seem to be.

    Raises
    ------
    UrdfError
        Names the link or joint, the element, the attribute, its value, and what is valid.
    """
    if root.tag != 'robot':
        raise UrdfError(f'the root element is <{root.tag}> (line {root.line}); valid: <robot>. '
                        'Other formats (SDF, MJCF) must be converted to URDF first')
    unused: list[str] = []
    _check(root, '', unused)
    for joint in root.all('joint'):
        _check_type(joint)
    if root.first('link') is None:
        raise UrdfError(f"robot '{root.attributes['name']}' has no <link>; valid: at least one")
    return unused


def _check(element: Element, owner: str, unused: list[str]) -> None:
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
    _check_attributes(element, rule, what, unused)
    for tag in rule.children:
        if tag not in MANY and sum(1 for _ in element.all(tag)) > 1:
            raise UrdfError(f'{what} has more than one <{tag}> (line {element.line}); valid: one')
    for tag in NEEDED.get(element.tag, ()):
        if element.first(tag) is None:
            raise UrdfError(f'{what} has no <{tag}> (line {element.line}); valid: exactly one')
    for child in element.children:
        if child.tag in rule.children:
            _check(child, owner, unused)
        else:
            _note_element(child, owner, unused)


def _check_attributes(element: Element, rule: Rule, what: str, unused: list[str]) -> None:
    """Check that required attributes are there and numbers are numbers."""
    for name in rule.required:
        if not element.attributes.get(name, '').strip():
            raise UrdfError(f"{what} has no attribute '{name}' (line {element.line}); it needs "
                            f"{', '.join(rule.required)}")
    for name, text in element.attributes.items():
        if name in rule.numbers:
            check_numbers(text, rule.numbers[name], f'{what} {name}', f' (line {element.line})')
        elif name not in rule.required + rule.optional and ':' not in name and name != 'xmlns':
            unused.append(f'{what} {name}')


def check_numbers(text: str, count: int, what: str, where: str = '') -> None:
    """Raise UrdfError unless a text is `count` finite decimal numbers, parted by blanks."""
    parts = text.split()
    if len(parts) != count or not all(
            NUMBER.fullmatch(part) and math.isfinite(float(part)) for part in parts):
        expected = ('one finite number, like 0.5 or 1e-3' if count == 1
                    else f'{count} finite numbers parted by blanks, like "0 0.5 1e-3"')
        hint = '; expand it with xacro first' if '${' in text else ''
        raise UrdfError(f"{what} is '{text}'{where}; expected {expected}{hint}")


def _check_type(joint: Element) -> None:
    """Raise UrdfError for a joint type that does not exist."""
    kind = joint.attributes['type']
    if kind not in TYPES:
        raise UrdfError(f"joint '{joint.attributes['name']}': type is '{kind}' (line "
                        f'{joint.line}); valid: {", ".join(TYPES)}')


def _note_element(element: Element, owner: str, unused: list[str]) -> None:
    """Note an element that is not read, unless nobody would expect it to be."""
    tag = element.tag
    if tag.startswith('xacro:'):
        raise UrdfError(f'{owner} holds <{tag}> (line {element.line}), which xacro would have '
                        'replaced; valid: the output of xacro')
    if tag == 'transmission':
        joints = [x.attributes.get('name', '?') for x in element.all('joint')]
        unused.append(f"<transmission> '{element.attributes.get('name', '?')}' of joint "
                      f"{', '.join(map(repr, joints)) or '?'}")
    elif tag == 'gazebo':
        found = [x.tag for x in element.children if x.tag in GAZEBO]
        if found:
            of = element.attributes.get('reference', '')
            unused.append(f"<gazebo reference='{of}'> {', '.join(f'<{x}>' for x in found)}")
    elif tag not in HARMLESS and ':' not in tag:
        unused.append(f'{owner}: <{tag}>')
