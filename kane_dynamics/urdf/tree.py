"""
Links and joints of a URDF as a checked kinematic tree.

These records are the stage between XML and Model: joints may have any number of degrees of
freedom, and nothing is selected, locked or merged.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from kane_dynamics._util.text import listing
from kane_dynamics.errors import ModelError, UrdfError
from kane_dynamics.model.inertial import Inertial
from kane_dynamics.model.joint_expansion import Mimic, StatedJoint

MOVING = ('revolute', 'continuous', 'prismatic')
TYPES = (*MOVING, 'fixed', 'floating', 'planar')


@dataclass(frozen=True)
class UrdfTree:
    """Checked tree: the inertials of links (or None), joints in URDF order, and the root."""

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
    for what, names in (('link', [x for x, _ in links]), ('joint', [x.name for x in joints])):
        twice = [repr(x) for x, count in Counter(names).items() if count > 1]
        if twice:
            raise UrdfError(f'{what} names: {listing(twice)} more than once; expected unique '
                            'names')
    by_name = dict(links)
    above: dict[str, StatedJoint] = {}
    for joint in joints:
        for what, link in (('parent', joint.parent), ('child', joint.child)):
            if link not in by_name:
                raise UrdfError(f"joint '{joint.name}': {what} '{link}' is no link; expected one "
                                f'of {listing(by_name)}')
        if joint.child in above:
            raise ModelError(f"link '{joint.child}': child of two joints, "
                             f"'{above[joint.child].name}' and '{joint.name}'; expected one")
        above[joint.child] = joint
    roots = [name for name in by_name if name not in above]
    if len(roots) > 1:
        raise ModelError(f'links {listing(roots)}: no parent; expected exactly one root link, '
                         'every other the child of a joint')
    _check_connected(by_name, above)
    return UrdfTree(name, by_name, tuple(joints), roots[0])


def _check_connected(links: Iterable[str], above: dict[str, StatedJoint]) -> None:
    """Raise ModelError if links form a loop."""
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
            raise ModelError(f'links {listing([*loop, link])}: a loop, each the child of the '
                             'next; expected a tree, with loops cut')
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
        trail: dict[str, None] = {}
        name = joint.name
        while name not in resolved and (mimic := by_name[name].mimic) is not None:
            master = by_name.get(mimic.master)
            if master is None or master.kind not in MOVING:
                fault = 'is no joint' if master is None else f'is {master.kind}'
                valid = listing(x.name for x in joints if x.kind in MOVING and x.name != name)
                raise UrdfError(f"joint '{name}': <mimic> joint '{mimic.master}' {fault}; "
                                f'expected a joint that moves: {valid}')
            if name in trail:
                raise ModelError(f'joints {listing([*trail, name])}: mimic one another in a '
                                 'circle; expected a chain that ends at a joint without <mimic>')
            trail[name] = None
            name = mimic.master
        for follower in reversed(trail):
            mimic = by_name[follower].mimic
            assert mimic is not None  # the trail contains only mimic joints
            onward = resolved.get(mimic.master, Mimic(mimic.master))
            resolved[follower] = Mimic(onward.master, mimic.multiplier * onward.multiplier,
                                       mimic.multiplier * onward.offset + mimic.offset)
            for key in ('multiplier', 'offset'):
                if not abs(getattr(resolved[follower], key)) < 1e60:
                    raise ModelError(f"joint '{follower}': <mimic> {key} is "
                                     f'{getattr(resolved[follower], key):g} through its chain of '
                                     'masters; expected less than 1e60')
    return resolved
