"""
Links and joints as a URDF states them, and what makes them a tree.

The records here stand between the XML and the Model: joints may still have any number of
freedoms, and nothing has been chosen, locked or merged yet.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from kane_dynamics.errors import ModelError, UrdfError
from kane_dynamics.model.model import Array, Inertial
import numpy as np

MOVING = ('revolute', 'continuous', 'prismatic')
TYPES = (*MOVING, 'fixed', 'floating', 'planar')
SNAP = 1e-14


@dataclass(frozen=True, eq=False)
class UrdfLink:
    """A link: its name, and its inertial in link axes if it states one."""

    name: str
    inertial: Inertial | None = None


@dataclass(frozen=True)
class Mimic:
    """Position = multiplier * position of joint `master` + offset."""

    master: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class StatedLimits:
    """What <limit> says; None where it is silent."""

    lower: float | None = None
    upper: float | None = None
    velocity: float | None = None
    effort: float | None = None


@dataclass(frozen=True, eq=False)
class UrdfJoint:
    """
    A joint of a URDF; (rotation, translation) place its frame in the parent link.

    `turns` are the axes of the successive turns of a floating, spherical or universal joint; the
    last two kinds are not URDF's, but `build` has them.
    """

    name: str
    kind: str
    parent: str
    child: str
    rotation: Array
    translation: Array
    axis: Array
    limits: StatedLimits | None = None
    damping: float = 0.0
    friction: float = 0.0
    mimic: Mimic | None = None
    turns: str = 'xyz'


@dataclass(frozen=True)
class Single:
    """
    A joint of one freedom (or none: kind 'fixed'), as `expanded` makes them of any joint.

    `child_name` names the body behind it: a link, or one that stands between the freedoms of a
    floating or planar joint. `order` sorts by place in the URDF.
    """

    name: str
    kind: str
    axis: Array
    rotation: Array
    translation: Array
    parent: str
    child: str
    order: tuple[int, int]
    source: UrdfJoint


@dataclass(frozen=True)
class UrdfTree:
    """A checked tree: links by name, joints in URDF order, and the one root."""

    name: str
    links: dict[str, UrdfLink]
    joints: tuple[UrdfJoint, ...]
    root: str


def listing(names: Iterable[str], most: int = 40) -> str:
    """Return names for an error message, cut where there are very many."""
    found = list(names)
    text = ', '.join(found[:most]) or 'none'
    return text if len(found) <= most else f'{text}, ... and {len(found) - most} more'


def snapped(values: Any) -> Array:
    """
    Return an array with entries within `SNAP` of 0, 1 or -1 made exact.

    Rotations by multiples of pi/2 then fold away. The bound is far below any angle that was
    rounded in decimal (3.14159265359 misses pi by 2e-13): what a file says stays.
    """
    array = np.array(values, dtype=np.float64)
    whole = np.rint(array)
    exact = (np.abs(array - whole) < SNAP) & (np.abs(whole) <= 1.0)
    array[exact] = whole[exact] + 0.0  # + 0.0 turns -0.0 into 0.0
    return array


def build_tree(name: str, links: Sequence[UrdfLink], joints: Sequence[UrdfJoint]) -> UrdfTree:
    """
    Return links and joints as a tree.

    Raises
    ------
    UrdfError
        A name is given twice, or a joint joins a link that does not exist.
    ModelError
        What they form is no tree; names the links.

    """
    for what, names in (('link', [x.name for x in links]), ('joint', [x.name for x in joints])):
        twice = [repr(x) for x, count in Counter(names).items() if count > 1]
        if twice:
            raise UrdfError(f'{what} names must be unique; given more than once: '
                            f'{listing(twice)}')
    by_name = {link.name: link for link in links}
    above: dict[str, UrdfJoint] = {}
    for joint in joints:
        for what, link in (('parent', joint.parent), ('child', joint.child)):
            if link not in by_name:
                raise UrdfError(f"joint '{joint.name}': {what} is '{link}', and no such link "
                                f'exists; valid: {listing(by_name)}')
        if joint.child in above:
            raise ModelError(f"link '{joint.child}' is the child of two joints, "
                             f"'{above[joint.child].name}' and '{joint.name}'; valid: one")
        above[joint.child] = joint
    roots = [name for name in by_name if name not in above]
    if len(roots) > 1:
        raise ModelError(f'links {listing(roots)} have no parent; valid: exactly one root link, '
                         'every other the child of a joint')
    _check_connected(by_name, above)
    return UrdfTree(name, by_name, tuple(joints), roots[0])


def _check_connected(links: dict[str, UrdfLink], above: dict[str, UrdfJoint]) -> None:
    """Raise ModelError if going up from some link never ends."""
    sound: set[str] = set()
    for link in links:
        trail: dict[str, None] = {}
        while link not in sound and link not in trail:
            trail[link] = None
            if link not in above:
                break
            link = above[link].parent
        if link in trail and link in above:
            names = list(trail)
            loop = names[names.index(link):]
            raise ModelError(f'links {listing([*loop, link])} form a loop, each the child of the '
                             'next; valid: a tree, whose loops are cut')
        sound.update(trail)


def check_mimics(joints: Sequence[UrdfJoint]) -> dict[str, Mimic]:
    """
    Return for every mimic joint its root master, with composed multiplier and offset.

    Raises
    ------
    UrdfError
        A master does not exist or has not one freedom.
    ModelError
        Joints mimic one another in a circle.

    """
    by_name = {joint.name: joint for joint in joints}
    resolved: dict[str, Mimic] = {}
    for joint in joints:
        trail: dict[str, None] = {}
        name = joint.name
        while name not in resolved and (mimic := by_name[name].mimic) is not None:
            master = by_name.get(mimic.master)
            if master is None or master.kind not in MOVING:
                fault = ('no such joint exists' if master is None
                         else f'that joint is {master.kind}')
                valid = listing(x.name for x in joints if x.kind in MOVING and x.name != name)
                raise UrdfError(f"joint '{name}': <mimic> joint is '{mimic.master}', and {fault}; "
                                f'valid: {valid}')
            if name in trail:
                raise ModelError(f'joints {listing([*trail, name])} mimic one another in a '
                                 'circle; valid: a chain that ends at a joint without <mimic>')
            trail[name] = None
            name = mimic.master
        for follower in reversed(trail):
            mimic = by_name[follower].mimic
            assert mimic is not None  # the trail holds followers only
            onward = resolved.get(mimic.master, Mimic(mimic.master))
            resolved[follower] = Mimic(onward.master, mimic.multiplier * onward.multiplier,
                                       mimic.multiplier * onward.offset + mimic.offset)
            for key in ('multiplier', 'offset'):
                if not abs(getattr(resolved[follower], key)) < 1e60:
                    raise ModelError(f"joint '{follower}': <mimic> {key} is "
                                     f'{getattr(resolved[follower], key):g} through its chain of '
                                     'masters; valid: below 1e60')
    return resolved


def expanded(joint: UrdfJoint, index: int) -> list[Single]:
    """
    Return a joint as joints of at most one freedom, outward.

    floating becomes <joint>/x /y /z, prismatic along the axes of the joint's frame in the parent,
    then <joint>/rx /ry /rz, revolute, each about an axis of the frame that the one before has
    turned; spherical and universal have turns only, and a second turn about z is <joint>/rz2.
    planar becomes <joint>/x and <joint>/y, prismatic in the plane normal to the axis, and
    <joint>/rz about it; x is the direction of the joint frame's x axis in that plane (of its y
    axis, where the axis lies along x), and y completes the right-handed (x, y, axis).
    """
    eye = np.eye(3)
    if joint.kind == 'floating':
        parts = [(f'/{s}', 'prismatic', eye[k]) for k, s in enumerate('xyz')] + _turns(joint.turns)
    elif joint.kind in ('spherical', 'universal'):
        parts = _turns(joint.turns)
    elif joint.kind == 'planar':
        normal = joint.axis / np.sqrt(joint.axis @ joint.axis)
        seed = eye[0] if abs(normal[0]) < 1.0 - 1e-9 else eye[1]
        x = seed - (seed @ normal) * normal
        x = snapped(x / np.sqrt(x @ x))
        parts = [('/x', 'prismatic', x), ('/y', 'prismatic', snapped(np.cross(normal, x))),
                 ('/rz', 'revolute', normal)]
    else:
        kind = {'continuous': 'revolute'}.get(joint.kind, joint.kind)
        parts = [('', kind, joint.axis)]
    singles, parent = [], joint.parent
    for k, (suffix, kind, axis) in enumerate(parts):
        name = joint.name + suffix
        child = name if k < len(parts) - 1 else joint.child
        pose = (joint.rotation, joint.translation) if k == 0 else (eye, np.zeros(3))
        singles.append(Single(name, kind, axis, *pose, parent, child, (index, k), joint))
        parent = child
    return singles


def _turns(axes: str) -> list[tuple[str, str, Array]]:
    """Return suffix, kind and axis of successive turns."""
    again = [axes[:k].count(s) for k, s in enumerate(axes)]
    return [(f'/r{s}{count + 1 if count else ""}', 'revolute', np.eye(3)['xyz'.index(s)])
            for s, count in zip(axes, again)]
