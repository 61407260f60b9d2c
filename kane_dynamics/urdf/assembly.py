"""Merge the links of a URDF into the moving bodies of a Model."""

from dataclasses import dataclass, field
import heapq
import math
from typing import Any

from kane_dynamics._util.checks import constant
from kane_dynamics._util.text import listing
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ModelError, UrdfError
from kane_dynamics.model.inertial import principal_moments
from kane_dynamics.model.joint_expansion import SingleJoint
from kane_dynamics.model.model import Body, Frame, Inertial, Joint, Limits, Model, WORLD
from kane_dynamics.model.placement import EYE, Placement, rotation_about, snapped
from kane_dynamics.urdf.limits import coordinate_limits, UNLIMITED
from kane_dynamics.urdf.notices import Notices
from kane_dynamics.urdf.selection import Selection
from kane_dynamics.urdf.supplement import Supplement
from kane_dynamics.urdf.tree import UrdfLink, UrdfTree
import numpy as np
from numpy.typing import ArrayLike


@dataclass
class Moving:
    """Moving body under construction: its joint, its placement and its merged inertials."""

    single: SingleJoint
    place: Placement
    riders: list[Inertial] = field(default_factory=list)


def assemble(tree: UrdfTree, selection: Selection, supplement: Supplement, gravity: ArrayLike,
             notices: Notices, *, strict: bool) -> Model:
    """
    Assemble the Model of the selected part of a URDF.

    Raises
    ------
    ModelError
        If a body or joint is physically impossible; the message names it.

    """
    places, moving = _place(selection)
    links = [tree.links[name] for name in places if name in tree.links]
    base: list[Inertial] = []
    kept = [x for x in links if x.inertial is not None and x.name not in selection.drop]
    check_inertials(kept, notices, strict)
    for link in kept:
        assert link.inertial is not None
        _load(link.inertial, places[link.name], moving, base)
    if supplement.payload is not None:
        name, inertial = supplement.payload
        if name not in places or name not in tree.links:
            raise UrdfError(f"supplement: payload: link '{name}' is not part of the model; "
                            f'expected one of {listing(x.name for x in links)}')
        _load(inertial, places[name], moving, base)
    _note_masses(tree, selection, moving, notices)
    names = [m.single.name for m in moving if m.single.name in selection.free]
    names = list(selection.order) if selection.order is not None else names
    index = {name: k for k, name in enumerate(names)}
    limits = coordinate_limits([m.single for m in moving], selection, notices)
    bodies = [Body(m.single.child, m.place.body, _joint(m, selection, index, supplement, limits),
                   _sum(m.riders)) for m in moving]
    frames = [Frame(x.name, places[x.name].body, places[x.name].rotation,
                    places[x.name].translation) for x in links]
    return Model(tree.name, tuple(bodies), tuple(names), tuple(frames),
                 constant(gravity, (3,), 'gravity'), selection.base, _sum(base))


def _place(selection: Selection) -> tuple[dict[str, Placement], list[Moving]]:
    """
    Return the placements of all links, and the moving bodies in topological order.

    Ties are in the order of the URDF. Locked joints are followed at once, so that they do not
    affect the order.
    """
    places = {selection.base: Placement(WORLD)}
    moving: list[Moving] = []
    ready: list[tuple[bool, tuple[int, int], SingleJoint]] = []

    def reach(name: str) -> None:
        for single in selection.behind[name]:
            moves = single.name in selection.free or single.name in selection.followers
            heapq.heappush(ready, (moves, single.order, single))

    reach(selection.base)
    while ready:
        moves, _, single = heapq.heappop(ready)
        place = places[single.parent].frame(single.rotation, single.translation)
        if moves:
            moving.append(Moving(single, place))
            places[single.child] = Placement(len(moving) - 1)
        else:
            position = selection.positions.get(single.name, 0.0)
            places[single.child] = place.frame(*_motion(single, position))
        reach(single.child)
    return places, moving


def _motion(single: SingleJoint, position: float) -> tuple[Array, Array]:
    """Return the pose of a joint's child in the joint's frame at a position."""
    if position == 0.0 or single.kind == 'fixed':
        return EYE, np.zeros(3)
    axis = single.axis / math.sqrt(single.axis @ single.axis)
    if single.kind == 'prismatic':
        return EYE, position * axis
    return snapped(rotation_about(axis, position)), np.zeros(3)


def _load(inertial: Inertial, place: Placement, moving: list[Moving],
          base: list[Inertial]) -> None:
    """Add the inertial of a link to the body that carries it."""
    if place.rotation is not EYE or place.translation.any():
        inertial = inertial.moved(place.rotation, place.translation)
    if place.body == WORLD:
        base.append(inertial)
    else:
        moving[place.body].riders.append(inertial)


def _sum(parts: list[Inertial]) -> Inertial:
    """Return the combined inertial of rigidly connected parts."""
    total = Inertial()
    for part in parts:
        total = total + part
    return total


def _joint(body: Moving, selection: Selection, index: dict[str, int], supplement: Supplement,
           limits: dict[str, Limits]) -> Joint:
    """Return the joint of a moving body."""
    single, source = body.single, body.single.source
    mimic = selection.followers.get(single.name)
    own: dict[str, Any] = {'damping': source.damping, 'friction': source.friction,
                           **supplement.joints.get(single.name, {})}
    return Joint(
        single.name, 'prismatic' if single.kind == 'prismatic' else 'revolute', single.axis,
        body.place.rotation, body.place.translation,
        index[single.name if mimic is None else mimic.master],
        1.0 if mimic is None else mimic.multiplier, 0.0 if mimic is None else mimic.offset,
        limits.get(single.name, UNLIMITED), **own)


def _note_masses(tree: UrdfTree, selection: Selection, moving: list[Moving],
                 notices: Notices) -> None:
    """Note moving links without <inertial> and moving bodies without mass."""
    for body in moving:
        link = tree.links.get(body.single.child)
        if link is None:
            continue  # intermediate body of an expanded joint: massless by design
        if link.inertial is None:
            notices.no_inertial.append(link.name)
        elif not any(inertial.mass > 0.0 for inertial in body.riders):
            notices.massless.append(link.name)


def check_inertials(links: list[UrdfLink], notices: Notices, strict: bool) -> None:
    """
    Note impossible and singular inertias.

    Raises
    ------
    ModelError
        If an inertia is indefinite and `strict` is set; the message names the link.

    """
    for link in links:
        assert link.inertial is not None
        found = principal_moments(link.inertial.inertia, mass=link.inertial.mass)
        if found.indefinite:
            if strict:
                raise ModelError(
                    f"link '{link.name}': <inertia> has principal moments {found}; expected no "
                    'negative moment, or strict=False to load it')
            notices.indefinite.append(link.name)
            continue
        if link.inertial.mass > 0.0 and found.singular:
            notices.singular.append(link.name)
        if found.triangle:
            notices.triangle.append(link.name)
