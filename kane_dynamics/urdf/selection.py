"""Which joints of a URDF move, which stand still and where: base, tip, joints, locked, drop."""

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
import math
from typing import Any

from kane_dynamics._util.text import listing
from kane_dynamics.errors import InputError, UrdfError
from kane_dynamics.model.joint_expansion import expand_joint, Mimic, SingleJoint
from kane_dynamics.urdf.tree import check_mimics, UrdfTree


@dataclass(frozen=True)
class Selection:
    """
    What `select` decided, in terms of single-freedom joints.

    Attributes
    ----------
    base : str
        The link that is fixed in the world.
    behind : dict
        For every link or intermediate body that is kept, the joints that go outward from it.
    free : frozenset of str
        Joints with a coordinate of their own.
    followers : dict
        Mimic joints that move, each with the free joint that leads it.
    positions : dict
        Where the other joints stand, rad or m.
    order : tuple of str or None
        The order of the coordinates, where it was asked for.
    drop : frozenset of str
        Links without their inertial.
    singles : dict
        Every joint of the file by name.

    """

    base: str
    behind: dict[str, list[SingleJoint]]
    free: frozenset[str]
    followers: dict[str, Mimic]
    positions: dict[str, float]
    order: tuple[str, ...] | None
    drop: frozenset[str]
    singles: dict[str, SingleJoint]


def select(tree: UrdfTree, *, base: str | None = None, tip: str | None = None,
           joints: Sequence[str] | None = None, locked: Mapping[str, float] | None = None,
           drop: Sequence[str] = ()) -> Selection:
    """
    Return which joints move and where the others stand; arguments as of `load_urdf`.

    Raises
    ------
    InputError
        An argument names what does not exist or cannot serve; lists what is valid.

    """
    mimics = check_mimics(tree.joints)
    singles = _singles(tree)
    start = tree.root if base is None else _link(tree, base, 'base')
    behind = _kept(singles.values(), start)
    candidates = [s.name for listed in behind.values() for s in listed
                  if s.kind != 'fixed' and s.name not in mimics]
    if tip is not None:
        path = _path(singles.values(), start, _link(tree, tip, 'tip'))
        candidates = [name for name in candidates if name in path]
    candidates.sort(key=lambda name: singles[name].order)
    order = None if joints is None else _joints(joints, candidates, singles, mimics)
    free = frozenset(candidates if order is None else order)
    positions = _locked(locked or {}, singles, mimics, free if joints is not None else ())
    free -= positions.keys()
    followers = {}
    for name, mimic in mimics.items():
        if mimic.master in free and mimic.multiplier != 0.0:
            followers[name] = mimic
        else:
            positions[name] = (mimic.multiplier * positions.get(mimic.master, 0.0)
                               + mimic.offset)
    dropped = frozenset(_link(tree, name, 'drop') for name in _names(drop, 'drop'))
    return Selection(start, behind, free, followers, positions, order, dropped, singles)


def _singles(tree: UrdfTree) -> dict[str, SingleJoint]:
    """Return all joints expand_joint, by name; the names that expanding makes must be new."""
    singles: dict[str, SingleJoint] = {}
    taken = {joint.name for joint in tree.joints} | tree.links.keys()
    for index, joint in enumerate(tree.joints):
        parts = expand_joint(joint, index)
        for single in parts:
            if len(parts) > 1 and single.name in taken:
                raise UrdfError(f"joint '{joint.name}' is {joint.kind} and expands to "
                                f"'{single.name}', but a link or joint has that name; valid: "
                                'another name for it')
            singles[single.name] = single
    return singles


def _kept(singles: Iterable[SingleJoint], base: str) -> dict[str, list[SingleJoint]]:
    """Return, for the base and all that is behind it, the joints that go outward from it."""
    outward: dict[str, list[SingleJoint]] = {}
    for single in singles:
        outward.setdefault(single.parent, []).append(single)
    kept: dict[str, list[SingleJoint]] = {}
    waiting = [base]
    while waiting:
        name = waiting.pop()
        kept[name] = outward.get(name, [])
        waiting.extend(single.child for single in kept[name])
    return kept


def _path(singles: Iterable[SingleJoint], base: str, tip: str) -> set[str]:
    """Return the names of the joints between two links."""
    above = {single.child: single for single in singles}
    path, link = set(), tip
    while link != base:
        if link not in above:
            raise InputError(f"tip is '{tip}', which is not behind base '{base}'; valid: a link "
                             f"on a branch that starts at '{base}'")
        path.add(above[link].name)
        link = above[link].parent
    return path


def _link(tree: UrdfTree, name: Any, argument: str) -> str:
    """Return a link's name, or raise InputError listing the valid ones."""
    if not isinstance(name, str) or name not in tree.links:
        raise InputError(f'{argument} is {name!r}, and no such link exists; valid: '
                         f'{listing(tree.links)}')
    return name


def _names(given: Any, argument: str) -> list[Any]:
    """Return a collection of names as a list; a lone string is not one."""
    if isinstance(given, (str, bytes, Mapping)) or not isinstance(given, Collection):
        raise InputError(f'{argument} is {given!r}; valid: a list of names of type str')
    return list(given)


def _joints(joints: Any, candidates: list[str], singles: Mapping[str, SingleJoint],
            mimics: Mapping[str, Mimic]) -> tuple[str, ...]:
    """Return the names in `joints`, checked."""
    names = _names(joints, 'joints')
    if isinstance(joints, Set):
        raise InputError(f'joints is {joints!r}; valid: a list or tuple, as its order is that of '
                         'the coordinates')
    valid = set(candidates)
    for name in names:
        if not isinstance(name, str) or name not in valid:
            raise InputError(f'joints: {_fault(name, singles, mimics)}; valid: '
                             f'{listing(candidates)}')
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise InputError(f'joints names {listing(twice)} more than once; valid: each once')
    return tuple(names)


def _locked(locked: Any, singles: Mapping[str, SingleJoint], mimics: Mapping[str, Mimic],
            free: Collection[str]) -> dict[str, float]:
    """Return the positions in `locked`, checked."""
    if not isinstance(locked, Mapping):
        raise InputError(f'locked is {locked!r}; valid: a mapping of joint names to positions')
    positions = {}
    for name, value in locked.items():
        if name not in singles or singles[name].kind == 'fixed' or name in mimics:
            valid = [x for x, s in singles.items() if s.kind != 'fixed' and x not in mimics]
            raise InputError(f'locked: {_fault(name, singles, mimics)}; valid: {listing(valid)}')
        if name in free:
            raise InputError(f"locked: joint '{name}' is also in joints, the ones that move; "
                             'valid: in one of the two')
        try:
            number = float(value)
        except (TypeError, ValueError):
            number = math.nan
        if isinstance(value, (str, bool)) or not abs(number) < 1e60:
            raise InputError(f"locked: joint '{name}' is {value!r}; expected a finite number, "
                             'rad or m')
        positions[name] = number
    return positions


def _fault(name: Any, singles: Mapping[str, SingleJoint], mimics: Mapping[str, Mimic]) -> str:
    """Return why a name is not one of a joint that may move or be locked."""
    if not isinstance(name, str) or name not in singles:
        return f'{name!r} is no joint of one freedom'
    if name in mimics:
        return f"joint '{name}' mimics '{mimics[name].master}' and has no freedom of its own"
    fixed = singles[name].kind == 'fixed'
    return f"joint '{name}' is fixed" if fixed else f"joint '{name}' is not between base and tip"
