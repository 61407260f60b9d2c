"""Select the moving and locked joints of a URDF by the options of `load_urdf`."""

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
import math
from typing import Any

from kane_dynamics._util.text import listing
from kane_dynamics.errors import InputError, UrdfError
from kane_dynamics.model.joint_expansion import expand_joint, Mimic, StatedJoint
from kane_dynamics.urdf.tree import check_mimics, ROOT_KINDS, UrdfTree


@dataclass(frozen=True)
class Selection:
    """
    Result of `select_joints`, in terms of joints of one degree of freedom.

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


def select_joints(tree: UrdfTree, *, base: str | None = None, tip: str | None = None,
                  joints: Sequence[str] | None = None,
                  locked: Mapping[str, float] | None = None,
                  drop: Sequence[str] = ()) -> Selection:
    """
    Return the moving joints and the positions of others; arguments as `load_urdf`.

    Raises
    ------
    InputError
        If an argument names an unknown or unsuitable link or joint; the message lists
        the valid ones.

    """
    mimics = check_mimics(tree.joints)
    singles = _singles(tree)
    start = tree.root if base is None else _link(tree, base, 'base')
    behind = _behind(singles.values(), start)

    # Which may move: those behind the base and, with a tip, on the path to it.
    candidates = [name for name, single in singles.items()
                  if single.parent in behind and single.kind != 'fixed'
                  and name not in mimics]
    if tip is not None:
        path = _path(singles.values(), start, _link(tree, tip, 'tip'))
        candidates = [name for name in candidates if name in path]

    # Which do: those that are asked for, or all but the locked ones.
    order = None
    requested: Collection[str] = ()
    if joints is not None:
        order = _joints(joints, candidates, singles, mimics)
        requested = order
    positions = _locked(locked or {}, singles, mimics, requested)
    free = frozenset(candidates if order is None else order) - positions.keys()
    _check_balls(tree, free, positions)

    # A mimic joint moves with its master, or is locked where a locked master has it.
    followers = {}
    for name, mimic in mimics.items():
        if mimic.master in free and mimic.multiplier != 0.0:
            followers[name] = mimic
        else:
            master_position = positions.get(mimic.master, 0.0)
            positions[name] = mimic.multiplier * master_position + mimic.offset
    dropped = frozenset(_link(tree, name, 'drop') for name in _names(drop, 'drop'))
    return Selection(start, behind, free, followers, positions, order, dropped, singles)


def _check_balls(tree: UrdfTree, free: frozenset[str],
                 positions: dict[str, float]) -> None:
    """Raise InputError for a ball joint that is locked in part, or at an angle."""
    for joint in tree.joints:
        if joint.kind != 'free':
            continue
        turns = [f'{joint.name}/w{letter}' for letter in 'xyz']
        locked = {}
        for name in turns:
            if name not in free:
                locked[name] = positions.get(name, 0.0)
        # Three rotations are one joint: free, or locked where they do not turn.
        in_part = 0 < len(locked) < 3
        if in_part or any(locked.values()):
            at = ', '.join(f'{name} {position:g}' for name, position in locked.items())
            raise InputError(f"joint '{joint.name}': locked: {at}; expected "
                             f"{', '.join(turns)} to move together, or locked at 0, or "
                             "floating='angles'")


def _singles(tree: UrdfTree) -> dict[str, StatedJoint]:
    """Return all joints by name, each of one degree of freedom; check new names."""
    singles: dict[str, StatedJoint] = {}
    # Names of parts must not collide with names in the file.
    taken = {joint.name for joint in tree.joints} | tree.links.keys()
    for joint in tree.joints:
        parts = expand_joint(joint)
        for single in parts:
            if len(parts) > 1 and single.name in taken:
                raise UrdfError(f"joint '{joint.name}': {joint.kind}, expands to "
                                f"'{single.name}', which names another link or joint; "
                                'expected a unique name')
            singles[single.name] = single
    return singles


def _behind(singles: Iterable[StatedJoint], base: str) -> dict[str, list[StatedJoint]]:
    """Return the joints beyond the base, by the link or body that carries them."""
    outward: dict[str, list[StatedJoint]] = {}
    for single in singles:
        outward.setdefault(single.parent, []).append(single)
    behind: dict[str, list[StatedJoint]] = {}
    waiting = [base]
    while waiting:
        name = waiting.pop()
        behind[name] = outward.get(name, [])
        waiting.extend(single.child for single in behind[name])
    return behind


def _path(singles: Iterable[StatedJoint], base: str, tip: str) -> set[str]:
    """Return the names of the joints between two links."""
    # Inwards from the tip, since each link has one parent.
    above = {single.child: single for single in singles}
    path = set()
    link = tip
    while link != base:
        if link not in above:
            raise InputError(f"tip: '{tip}', which is not behind base '{base}'; "
                             f"expected a link on a branch that starts at '{base}'")
        path.add(above[link].name)
        link = above[link].parent
    return path


def _link(tree: UrdfTree, name: Any, argument: str) -> str:
    """Return a link's name; InputError lists the valid ones if it is unknown."""
    if not isinstance(name, str) or name not in tree.links:
        hint = ''
        if argument == 'base' and name in ROOT_KINDS:
            hint = f'root_joint={name!r} for a base that moves, or '
        raise InputError(f'{argument}: {name!r} is no link; expected {hint}one of '
                         f'{listing(tree.links)}')
    return name


def _names(value: Any, argument: str) -> list[Any]:
    """Return a collection of names as a list; raise InputError for a single string."""
    if isinstance(value, (str, bytes, Mapping)) or not isinstance(value, Collection):
        raise InputError(f'{argument}: {value!r}; expected a list of names of type str')
    return list(value)


def _joints(joints: Any, candidates: list[str], singles: Mapping[str, StatedJoint],
            mimics: Mapping[str, Mimic]) -> tuple[str, ...]:
    """Check the argument `joints` and return its names."""
    # A set has no order, and the order of the joints is that of all arrays.
    names = _names(joints, 'joints')
    if isinstance(joints, Set):
        raise InputError(f'joints: {joints!r}; expected a list or tuple, whose order is '
                         'that of the coordinates')
    valid = set(candidates)
    for name in names:
        if not isinstance(name, str) or name not in valid:
            raise InputError(f'joints: {_fault(name, singles, mimics)}; expected some '
                             f'of {listing(candidates)}')

    # A joint has one place in the order of the coordinates.
    repeated = [name for name, count in Counter(names).items() if count > 1]
    if repeated:
        raise InputError(f'joints: {listing(repeated)} more than once; expected each '
                         'once')
    return tuple(names)


def _locked(locked: Any, singles: Mapping[str, StatedJoint], mimics: Mapping[str, Mimic],
            free: Collection[str]) -> dict[str, float]:
    """Check the argument `locked` and return its positions by joint."""
    if not isinstance(locked, Mapping):
        raise InputError(f'locked: {locked!r}; expected a mapping of joint names to '
                         'positions')
    valid = [name for name, single in singles.items()
             if single.kind != 'fixed' and name not in mimics]
    positions = {}
    for name, value in locked.items():
        if name not in valid:
            raise InputError(f'locked: {_fault(name, singles, mimics)}; expected some '
                             f'of {listing(valid)}')
        if name in free:
            raise InputError(f"locked: joint '{name}' is also in joints, the ones that "
                             'move; expected it in one of the two')
        # Text and truth values convert to numbers, but are mistakes here.
        try:
            number = float(value)
        except (TypeError, ValueError):
            number = math.nan
        if isinstance(value, (str, bool)) or not abs(number) < 1e60:
            raise InputError(f"locked: joint '{name}': {value!r}; expected a finite "
                             'number, rad or m')
        positions[name] = number
    return positions


def _fault(name: Any, singles: Mapping[str, StatedJoint],
           mimics: Mapping[str, Mimic]) -> str:
    """Return why a name is not that of a joint that can move or be locked."""
    if not isinstance(name, str) or name not in singles:
        return f'{name!r} is no joint of one degree of freedom'
    if name in mimics:
        return f"joint '{name}' mimics '{mimics[name].master}' and has no coordinate"
    if singles[name].kind == 'fixed':
        return f"joint '{name}' is fixed"
    return f"joint '{name}' is not between base and tip"
