"""Merge the links of a URDF into the moving bodies of a Model."""

import heapq
import math
from typing import Any

from kane_dynamics._util.checks import constant
from kane_dynamics._util.text import listing
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ModelError, UrdfError
from kane_dynamics.model.ball_coordinates import quaternion_names
from kane_dynamics.model.inertial import principal_moments
from kane_dynamics.model.joint_expansion import StatedJoint
from kane_dynamics.model.model import Body, Frame, Inertial, Joint, Limits, Model, WORLD
from kane_dynamics.model.placement import EYE, Placement, rotation_about, snapped
from kane_dynamics.urdf.limits import coordinate_limits, UNLIMITED
from kane_dynamics.urdf.notices import Notices
from kane_dynamics.urdf.selection import Selection
from kane_dynamics.urdf.supplement import Supplement
from kane_dynamics.urdf.tree import UrdfTree
import numpy as np
from numpy.typing import ArrayLike


Moving = list[tuple[StatedJoint, Placement]]  # the joint of each moving body, and where it is


def assemble(tree: UrdfTree, selection: Selection, supplement: Supplement, gravity: ArrayLike,
             notices: Notices, *, strict: bool) -> Model:
    """Assemble the Model of the selected part of a URDF; ModelError names an impossible body."""
    placements, moving = _placements(selection)
    links = [name for name in placements if name in tree.links]
    parts: list[list[Inertial]] = [[] for _ in (*moving, 'base')]  # of each body, then of WORLD
    for name in links:
        inertial = tree.links[name]
        if inertial is not None and name not in selection.drop:
            check_inertial(name, inertial, notices, strict)
            _load(inertial, placements[name], parts)
    if supplement.payload is not None:
        name, inertial = supplement.payload
        if name not in placements or name not in tree.links:
            raise UrdfError(f"supplement: payload: link '{name}' is not part of the model; "
                            f'expected one of {listing(links)}')
        _load(inertial, placements[name], parts)
    _note_masses(tree, moving, parts, notices)
    names = [single.name for single, _ in moving if single.name in selection.free]
    names = list(selection.order) if selection.order is not None else names
    index = {name: k for k, name in enumerate(names)}
    limits = coordinate_limits([single for single, _ in moving], selection, notices)
    bodies = [Body(single.child, placement.body,
                   _joint(single, placement, selection, index, supplement, limits), _sum(riders))
              for (single, placement), riders in zip(moving, parts)]
    frames = [Frame(name, at.body, at.rotation, at.translation)
              for name, at in ((name, placements[name]) for name in links)]
    turning = {f'{joint.name}/wx' for joint in tree.joints if joint.kind == 'free'}
    balls = tuple(k for k, body in enumerate(bodies) if body.joint.name in turning)
    return Model(tree.name, tuple(bodies),
                 quaternion_names(names, [bodies[k].joint.coordinate for k in balls]),
                 tuple(frames), constant(gravity, (3,), 'gravity'), selection.base,
                 _sum(parts[WORLD]), balls)


def _placements(selection: Selection) -> tuple[dict[str, Placement], Moving]:
    """
    Return the placements of all links, and the moving bodies in topological order.

    Ties are in the order of the URDF. Locked joints are followed at once, so that they do not
    affect the order.
    """
    placements = {selection.base: Placement(WORLD)}
    moving: Moving = []
    order = {name: k for k, name in enumerate(selection.singles)}
    ready: list[tuple[bool, int, StatedJoint]] = []

    def reach(name: str) -> None:
        for single in selection.behind[name]:
            moves = single.name in selection.free or single.name in selection.followers
            heapq.heappush(ready, (moves, order[single.name], single))

    reach(selection.base)
    while ready:
        moves, _, single = heapq.heappop(ready)
        placement = placements[single.parent].frame(single.rotation, single.translation)
        if moves:
            moving.append((single, placement))
            placements[single.child] = Placement(len(moving) - 1)
        else:
            position = selection.positions.get(single.name, 0.0)
            placements[single.child] = placement.frame(*_motion(single, position))
        reach(single.child)
    return placements, moving


def _motion(single: StatedJoint, position: float) -> tuple[Array, Array]:
    """Return the pose of a joint's child in the joint's frame at a position."""
    if position == 0.0 or single.kind == 'fixed':
        return EYE, np.zeros(3)
    axis = single.axis / math.sqrt(single.axis @ single.axis)
    if single.kind == 'prismatic':
        return EYE, position * axis
    return snapped(rotation_about(axis, position)), np.zeros(3)


def _load(inertial: Inertial, placement: Placement, parts: list[list[Inertial]]) -> None:
    """Add the inertial of a link to the parts of the body that carries it."""
    if placement.rotation is not EYE or placement.translation.any():
        inertial = inertial.moved(placement.rotation, placement.translation)
    parts[placement.body].append(inertial)


def _sum(parts: list[Inertial]) -> Inertial:
    """Return the combined inertial of rigidly connected parts."""
    total = Inertial()
    for part in parts:
        total = total + part
    return total


def _joint(single: StatedJoint, placement: Placement, selection: Selection, index: dict[str, int],
           supplement: Supplement, limits: dict[str, Limits]) -> Joint:
    """Return the joint of a moving body."""
    mimic = selection.followers.get(single.name)
    own: dict[str, Any] = {'damping': single.damping, 'friction': single.friction,
                           **supplement.joints.get(single.name, {})}
    return Joint(
        single.name, 'prismatic' if single.kind == 'prismatic' else 'revolute', single.axis,
        placement.rotation, placement.translation,
        index[single.name if mimic is None else mimic.master],
        1.0 if mimic is None else mimic.multiplier, 0.0 if mimic is None else mimic.offset,
        limits.get(single.name, UNLIMITED), **own)


def _note_masses(tree: UrdfTree, moving: Moving, parts: list[list[Inertial]],
                 notices: Notices) -> None:
    """Note moving links without <inertial> and moving bodies without mass."""
    for (single, _), riders in zip(moving, parts):
        link = single.child
        if link not in tree.links:
            continue  # intermediate body of an expanded joint: massless by design
        if tree.links[link] is None:
            notices.no_inertial.append(link)
        elif not any(inertial.mass > 0.0 for inertial in riders):
            notices.massless.append(link)


def check_inertial(link: str, inertial: Inertial, notices: Notices, strict: bool) -> None:
    """Note an impossible or singular inertia; ModelError if it is indefinite and `strict`."""
    found = principal_moments(inertial.inertia, mass=inertial.mass)
    if found.indefinite:
        if strict:
            raise ModelError(f"link '{link}': <inertia> has principal moments {found}; expected "
                             'no negative moment, or strict=False to load it')
        notices.indefinite.append(link)
        return
    if inertial.mass > 0.0 and found.singular:
        notices.singular.append(link)
    if found.triangle:
        notices.triangle.append(link)
