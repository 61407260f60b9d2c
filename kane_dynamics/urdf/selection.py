"""Select the moving and locked joints of a URDF by base, tip, joints, locked and drop."""

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
import math
from typing import Any

from kane_dynamics._util.text import listing
from kane_dynamics.errors import InputError, UrdfError
from kane_dynamics.model.joint_expansion import expand_joint, Mimic, StatedJoint
from kane_dynamics.urdf.tree import check_mimics, UrdfTree


@dataclass(frozen=True)
class Selection:
    """
    Result of `select`, in terms of joints of one degree of freedom.

    Attributes
    ----------
    base : str
        The link fixed in the world.
    behind : dict
        Outward joints of every link or intermediate body that is kept.
    free : frozenset of str
        Joints with their own coordinate.
    followers : dict
        Moving mimic joints, each with its free master joint.
    positions : dict
        Positions of the locked joints, rad or m.
    order : tuple of str or None
        The requested order of the coordinates, if any.
    drop : frozenset of str
        Links whose inertial is removed.
    singles : dict
        Every joint of the file by name, in the order of the file.

    """

    base: str
    behind: dict[str, list[StatedJoint]]
    free: frozenset[str]
    followers: dict[str, Mimic]
    positions: dict[str, float]
    order: tuple[str, ...] | None
    drop: frozenset[str]
    singles: dict[str, StatedJoint]


def select(tree: UrdfTree, *, base: str | None = None, tip: str | None = None,
           joints: Sequence[str] | None = None, locked: Mapping[str, float] | None = None,
           drop: Sequence[str] = ()) -> Selection:
    """
    Return the moving joints and the positions of the others; arguments as in `load_urdf`.

    Raises
    ------
    InputError
        If an argument names an unknown or unsuitable link or joint; the message lists the valid
        ones.

    """
    mimics = check_mimics(tree.joints)
    singles = _singles(tree)
    start = tree.root if base is None else _link(tree, base, 'base')
    behind = _kept(singles.values(), start)
    candidates = [name for name, s in singles.items()
                  if s.parent in behind and s.kind != 'fixed' and name not in mimics]
    if tip is not None:
        path = _path(singles.values(), start, _link(tree, tip, 'tip'))
        candidates = [name for name in candidates if name in path]
    order = None if joints is None else _joints(joints, candidates, singles, mimics)
    free = frozenset(candidates if order is None else order)
    positions = _locked(locked or {}, singles, mimics, free if joints is not None else ())
    free -= positions.keys()
    _check_balls(tree, free, positions)
    followers = {}
    for name, mimic in mimics.items():
        if mimic.master in free and mimic.multiplier != 0.0:
            followers[name] = mimic
        else:
            positions[name] = (mimic.multiplier * positions.get(mimic.master, 0.0)
                               + mimic.offset)
    dropped = frozenset(_link(tree, name, 'drop') for name in _names(drop, 'drop'))
    return Selection(start, behind, free, followers, positions, order, dropped, singles)


def _check_balls(tree: UrdfTree, free: frozenset[str], positions: dict[str, float]) -> None:
    """Raise InputError for a joint with a quaternion that is locked in part, or at an angle."""
    for joint in tree.joints:
        turns = [f'{joint.name}/w{s}' for s in 'xyz'] if joint.kind == 'free' else []
        locked = [name for name in turns if name not in free]
        if 0 < len(locked) < 3 or any(positions.get(name, 0.0) for name in locked):
            at = ', '.join(f'{name} {positions.get(name, 0.0):g}' for name in locked)
            raise InputError(f"joint '{joint.name}': locked: {at}; expected {', '.join(turns)} to "
                             "move together, or locked at 0, or floating='angles'")


def _singles(tree: UrdfTree) -> dict[str, StatedJoint]:
    """Return all joints, expanded to one degree of freedom, by name; check the new names."""
    singles: dict[str, StatedJoint] = {}
    taken = {joint.name for joint in tree.joints} | tree.links.keys()
    for joint in tree.joints:
        parts = expand_joint(joint)
        for single in parts:
            if len(parts) > 1 and single.name in taken:
                raise UrdfError(f"joint '{joint.name}': {joint.kind}, expands to "
                                f"'{single.name}', which names another link or joint; expected "
                                'a unique name')
            singles[single.name] = single
    return singles


def _kept(singles: Iterable[StatedJoint], base: str) -> dict[str, list[StatedJoint]]:
    """Return the outward joints of the base and of every link and body beyond it."""
    outward: dict[str, list[StatedJoint]] = {}
    for single in singles:
        outward.setdefault(single.parent, []).append(single)
    kept: dict[str, list[StatedJoint]] = {}
    waiting = [base]
    while waiting:
        name = waiting.pop()
        kept[name] = outward.get(name, [])
        waiting.extend(single.child for single in kept[name])
    return kept


def _path(singles: Iterable[StatedJoint], base: str, tip: str) -> set[str]:
    """Return the names of the joints between two links."""
    above = {single.child: single for single in singles}
    path, link = set(), tip
    while link != base:
        if link not in above:
            raise InputError(f"tip: '{tip}', which is not behind base '{base}'; expected a link "
                             f"on a branch that starts at '{base}'")
        path.add(above[link].name)
        link = above[link].parent
    return path


def _link(tree: UrdfTree, name: Any, argument: str) -> str:
    """Return a link's name; raise InputError that lists the valid ones if it is unknown."""
    if not isinstance(name, str) or name not in tree.links:
        raise InputError(f'{argument}: {name!r} is no link; expected one of '
                         f'{listing(tree.links)}')
    return name


def _names(given: Any, argument: str) -> list[Any]:
    """Return a collection of names as a list; raise InputError for a single string."""
    if isinstance(given, (str, bytes, Mapping)) or not isinstance(given, Collection):
        raise InputError(f'{argument}: {given!r}; expected a list of names of type str')
    return list(given)


def _joints(joints: Any, candidates: list[str], singles: Mapping[str, StatedJoint],
            mimics: Mapping[str, Mimic]) -> tuple[str, ...]:
    """Check the argument `joints` and return its names."""
    names = _names(joints, 'joints')
    if isinstance(joints, Set):
        raise InputError(f'joints: {joints!r}; expected a list or tuple, whose order is that of '
                         'the coordinates')
    valid = set(candidates)
    for name in names:
        if not isinstance(name, str) or name not in valid:
            raise InputError(f'joints: {_fault(name, singles, mimics)}; expected some of '
                             f'{listing(candidates)}')
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise InputError(f'joints: {listing(twice)} more than once; expected each once')
    return tuple(names)


def _locked(locked: Any, singles: Mapping[str, StatedJoint], mimics: Mapping[str, Mimic],
            free: Collection[str]) -> dict[str, float]:
    """Check the argument `locked` and return its positions by joint."""
    if not isinstance(locked, Mapping):
        raise InputError(f'locked: {locked!r}; expected a mapping of joint names to positions')
    positions = {}
    for name, value in locked.items():
        if name not in singles or singles[name].kind == 'fixed' or name in mimics:
            valid = [x for x, s in singles.items() if s.kind != 'fixed' and x not in mimics]
            raise InputError(f'locked: {_fault(name, singles, mimics)}; expected some of '
                             f'{listing(valid)}')
        if name in free:
            raise InputError(f"locked: joint '{name}' is also in joints, the ones that move; "
                             'expected it in one of the two')
        try:
            number = float(value)
        except (TypeError, ValueError):
            number = math.nan
        if isinstance(value, (str, bool)) or not abs(number) < 1e60:
            raise InputError(f"locked: joint '{name}': {value!r}; expected a finite number, "
                             'rad or m')
        positions[name] = number
    return positions


def _fault(name: Any, singles: Mapping[str, StatedJoint], mimics: Mapping[str, Mimic]) -> str:
    """Return why a name is not that of a joint that can move or be locked."""
    if not isinstance(name, str) or name not in singles:
        return f'{name!r} is no joint of one degree of freedom'
    if name in mimics:
        return f"joint '{name}' mimics '{mimics[name].master}' and has no coordinate"
    fixed = singles[name].kind == 'fixed'
    return f"joint '{name}' is fixed" if fixed else f"joint '{name}' is not between base and tip"
