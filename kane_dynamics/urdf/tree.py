"""
Links and joints of a URDF as a checked kinematic tree.

These records are the stage between XML and Model: joints may have any number of degrees
of freedom, and nothing is selected, locked or merged.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from kane_dynamics._util.text import listing
from kane_dynamics.errors import InputError, ModelError, UrdfError
from kane_dynamics.model.inertial import Inertial
from kane_dynamics.model.joint_expansion import expand_joint, Mimic, StatedJoint
import numpy as np

MOVING = ('revolute', 'continuous', 'prismatic')
TYPES = (*MOVING, 'fixed', 'floating', 'planar')
ROOT_KINDS = ('free', 'floating', 'planar')
ROOT_JOINT = 'root_joint'
ROOT_PARENT = 'world'
LARGEST = 1e60  # larger numbers overflow in products


@dataclass(frozen=True)
class UrdfTree:
    """Checked tree: inertials of links (or None), joints in URDF order, the root."""

    name: str
    links: dict[str, Inertial | None]
    joints: tuple[StatedJoint, ...]
    root: str


def build_tree(name: str, links: Sequence[tuple[str, Inertial | None]],
               joints: Sequence[StatedJoint]) -> UrdfTree:
    """
    Build the tree of links (names and inertials) and joints, and check it.

    Raises
    ------
    UrdfError
        If a name is not unique, or a joint refers to an unknown link.
    ModelError
        If the links do not form a tree; the message names them.

    """
    _check_unique('link', [link for link, _ in links])
    _check_unique('joint', [joint.name for joint in joints])
    by_name = dict(links)
    above: dict[str, StatedJoint] = {}  # the joint of each child
    for joint in joints:
        for what, link in (('parent', joint.parent), ('child', joint.child)):
            if link not in by_name:
                raise UrdfError(f"joint '{joint.name}': {what} '{link}' is no link; "
                                f'expected one of {listing(by_name)}')
        if joint.child in above:
            raise ModelError(f"link '{joint.child}': child of two joints, "
                             f"'{above[joint.child].name}' and '{joint.name}'; expected "
                             'one')
        above[joint.child] = joint
    # One root: several would be several robots.
    roots = [name for name in by_name if name not in above]
    if len(roots) > 1:
        raise ModelError(f'links {listing(roots)}: no parent; expected exactly one root '
                         'link, every other the child of a joint')
    _check_connected(by_name, above)
    return UrdfTree(name, by_name, tuple(joints), roots[0])


def _check_unique(what: str, names: Iterable[str]) -> None:
    """Raise UrdfError for names that are there more than once."""
    repeated = [repr(name) for name, count in Counter(names).items() if count > 1]
    if repeated:
        raise UrdfError(f'{what} names: {listing(repeated)} more than once; expected '
                        'unique names')


def _check_connected(links: Iterable[str], above: dict[str, StatedJoint]) -> None:
    """Raise ModelError if links form a loop."""
    sound: set[str] = set()  # links whose parents lead to the root
    for link in links:
        trail: dict[str, None] = {}  # an ordered set
        while link not in sound and link not in trail:
            trail[link] = None
            if link not in above:
                break
            link = above[link].parent
        if link in trail and link in above:  # back at a link of the trail
            names = list(trail)
            loop = names[names.index(link):]
            raise ModelError(f'links {listing([*loop, link])}: a loop, each the child '
                             'of the next; expected a tree, with loops cut')
        sound.update(trail)


def check_mimics(joints: Sequence[StatedJoint]) -> dict[str, Mimic]:
    """
    Return the root master of every mimic joint, with composed multiplier and offset.

    Raises
    ------
    UrdfError
        If a master does not exist or does not have one degree of freedom.
    ModelError
        If mimic joints form a cycle.

    """
    by_name = {joint.name: joint for joint in joints}
    resolved: dict[str, Mimic] = {}
    for joint in joints:
        # Inwards along the masters, up to a joint that mimics none or is resolved
        # already.
        trail: dict[str, None] = {}  # an ordered set
        name = joint.name
        while name not in resolved and (mimic := by_name[name].mimic) is not None:
            stated = by_name.get(mimic.master)
            if stated is None or stated.kind not in MOVING:
                fault = 'is no joint' if stated is None else f'is {stated.kind}'
                valid = [candidate.name for candidate in joints
                         if candidate.kind in MOVING and candidate.name != name]
                raise UrdfError(f"joint '{name}': <mimic> joint '{mimic.master}' "
                                f'{fault}; expected a joint that moves: '
                                f'{listing(valid)}')
            if name in trail:
                raise ModelError(f'joints {listing([*trail, name])}: mimic one another '
                                 'in a circle; expected a chain that ends at a joint '
                                 'without <mimic>')
            trail[name] = None
            name = mimic.master
        # Outwards again: q_follower = m (m' q + o') + o, with m' and o' of its master.
        for follower in reversed(trail):
            mimic = by_name[follower].mimic
            assert mimic is not None  # the trail contains only mimic joints
            master = resolved.get(mimic.master, Mimic(mimic.master))
            composed = Mimic(master.master, mimic.multiplier * master.multiplier,
                             mimic.multiplier * master.offset + mimic.offset)
            _check_mimic_numbers(follower, composed)
            resolved[follower] = composed
    return resolved


def _check_mimic_numbers(follower: str, mimic: Mimic) -> None:
    """Raise ModelError for a multiplier or an offset that overflows in products."""
    for key in ('multiplier', 'offset'):
        number = getattr(mimic, key)
        if not abs(number) < LARGEST:
            raise ModelError(f"joint '{follower}': <mimic> {key} is {number:g} through "
                             'its chain of masters; expected less than 1e60')


def with_root_joint(tree: UrdfTree, kind: str, base: Any = None,
                    moving: Any = None) -> UrdfTree:
    """
    Return the tree with a joint between a new link 'world' and the base link.

    Parameters
    ----------
    tree : UrdfTree
        Without that joint.
    kind : str
        One of `ROOT_KINDS`.
    base : str, optional
        The base link; by default the root.
    moving : sequence of str, optional
        The joints that the user chose to move.

    Raises
    ------
    InputError
        The kind or the base is unknown, 'world' names a link that stays, or the chosen
        joints leave out those of the new joint.

    """
    if kind not in ROOT_KINDS:
        raise InputError(f'root_joint: {kind!r}; expected one of fixed, '
                         f"{', '.join(ROOT_KINDS)}")
    base = tree.root if base is None else base
    if base not in tree.links:
        raise InputError(f'base: {base!r} is no link; expected one of '
                         f'{listing(tree.links)}')
    if base == ROOT_PARENT:
        children = [joint.child for joint in tree.joints if joint.parent == base]
        raise InputError(f"root_joint: '{kind}', and the base link is '{ROOT_PARENT}'; "
                         f'expected base= one of {listing(children)}')
    # Only links behind the base link remain.
    links, joints = _carried_by(tree, base)
    if ROOT_PARENT in links:
        raise InputError(f"root_joint: '{kind}', and a link behind '{base}' is "
                         f"'{ROOT_PARENT}'; expected another name of that link")
    if any(joint.name == ROOT_JOINT for joint in joints):
        raise InputError(f"root_joint: '{kind}', and a joint of the URDF is "
                         f"'{ROOT_JOINT}'; expected another name of that joint")
    # Last in the file's order; as the only joint at the root it still comes first in q.
    added = StatedJoint(ROOT_JOINT, kind, ROOT_PARENT, base, np.eye(3), np.zeros(3),
                        np.array([0.0, 0.0, 1.0]))
    parts = [single.name for single in expand_joint(added)]
    # If joints are selected, those of the new root joint must be among them.
    chosen = moving is not None and not isinstance(moving, str)
    if chosen and not set(parts) & set(moving):
        raise InputError(f"root_joint: '{kind}', and joints: without "
                         f"{', '.join(parts)}; expected them among the joints that move")
    return UrdfTree(tree.name, {ROOT_PARENT: None, **links}, (*joints, added),
                    ROOT_PARENT)


def _carried_by(tree: UrdfTree, base: str
                ) -> tuple[dict[str, Inertial | None], tuple[StatedJoint, ...]]:
    """Return the links that a base carries, with itself, and their joints."""
    # Outwards, one generation of links at a time.
    carried: set[str] = set()
    reached = {base}
    while reached:
        carried |= reached
        reached = {joint.child for joint in tree.joints if joint.parent in reached}
    joints = tuple(joint for joint in tree.joints if joint.parent in carried)
    links = {name: inertial for name, inertial in tree.links.items() if name in carried}
    return links, joints
