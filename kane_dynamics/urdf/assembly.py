"""Merge the links of a URDF into the moving bodies of a Model."""

from collections.abc import Iterable
from dataclasses import replace
import heapq
import math
from typing import Any

from kane_dynamics._util.checks import constant
from kane_dynamics._util.text import listing
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ModelError, UrdfError
from kane_dynamics.model.ball_coordinates import quaternion_names
from kane_dynamics.model.inertial import principal_moments
from kane_dynamics.model.joint_expansion import Mimic, StatedJoint, StatedLimits
from kane_dynamics.model.model import (Body, Frame, Inertial, Joint, Limits, Model,
                                       ROUNDING, WORLD)
from kane_dynamics.model.placement import EYE, Placement, rotation_about, snapped
from kane_dynamics.model.plausible_sizes import is_far
from kane_dynamics.urdf.notices import Notices
from kane_dynamics.urdf.selection import Selection
from kane_dynamics.urdf.supplement import Supplement
from kane_dynamics.urdf.tree import UrdfTree
import numpy as np
from numpy.typing import ArrayLike

# The joint of each moving body, and where it is.
Moving = list[tuple[StatedJoint, Placement]]

UNLIMITED = Limits()
DEGREES = 12.6  # rad, two turns: a bound beyond it, up to 720, looks like degrees


def assemble_model(tree: UrdfTree, selection: Selection, supplement: Supplement,
                   gravity: ArrayLike, notices: Notices) -> Model:
    """Assemble the Model of a URDF's selection; ModelError names an impossible body."""
    placements, moving = _placements(selection)
    links = [name for name in placements if name in tree.links]
    riders = _riders(tree, selection, supplement, placements, len(moving), notices)
    _note_masses(tree, moving, riders, supplement, notices)
    _note_locked(selection, notices)
    _note_payload(supplement, moving, notices)
    _note_rest(supplement, moving, notices)

    # The coordinates: the free joints, outward from the base or in the order that is
    # asked for.
    singles = [single for single, _ in moving]
    names = [single.name for single in singles if single.name in selection.free]
    if selection.order is not None:
        names = list(selection.order)
    coordinates = {name: k for k, name in enumerate(names)}
    limits = _coordinate_limits(singles, selection, notices)

    # Bodies at the joints, each with the inertia of all links that ride on it.
    bodies = []
    for (single, placement), inertials in zip(moving, riders):
        joint = _joint(single, placement, selection, coordinates, supplement, limits)
        bodies.append(Body(single.child, placement.body, joint, _sum(inertials)))
    frames = []
    for name in links:
        placement = placements[name]
        frames.append(Frame(name, placement.body, placement.rotation,
                            placement.translation))
    # A joint with a quaternion begins with its rotation about x.
    rotations = {f'{joint.name}/wx' for joint in tree.joints if joint.kind == 'free'}
    balls = tuple(k for k, body in enumerate(bodies) if body.joint.name in rotations)
    names_of_q = quaternion_names(names, bodies, balls)
    return Model(tree.name, tuple(bodies), names_of_q, tuple(frames),
                 constant(gravity, (3,), 'gravity'), selection.base, _sum(riders[WORLD]),
                 balls)


def _note_locked(selection: Selection, notices: Notices) -> None:
    """Note joints that are locked outside their limits, as positions in degrees are."""
    for name, position in selection.positions.items():
        limits = selection.singles[name].limits
        if limits is None or limits.lower is None or limits.upper is None:
            continue
        is_stated = limits.lower < limits.upper
        inside = limits.lower - ROUNDING <= position <= limits.upper + ROUNDING
        if is_stated and not inside:
            notices.locked_outside.append(
                f'{name} at {position:g} ({limits.lower:g} to {limits.upper:g})')


def _note_rest(supplement: Supplement, moving: Moving, notices: Notices) -> None:
    """Note springs of revolute joints that rest beyond two turns, as angles in degrees do."""
    for single, _ in moving:
        rest = supplement.joints.get(single.name, {}).get('rest', 0.0)
        if single.kind != 'prismatic' and abs(rest) > DEGREES:
            notices.degree_rest.append(f'{single.name} {rest:g}')


def _note_payload(supplement: Supplement, moving: Moving, notices: Notices) -> None:
    """Note a payload far from its frame, as of millimeters."""
    if supplement.payload is None:
        return
    link, inertial = supplement.payload
    links = sum(float(np.linalg.norm(single.translation)) for single, _ in moving)
    distance = float(np.linalg.norm(inertial.com))
    if is_far(distance, links):
        notices.far_payload.append(f'{link} ({distance:.4g} m, {links:.4g} m)')


# ---------------------------------------------------------------- placements of links

def _placements(selection: Selection) -> tuple[dict[str, Placement], Moving]:
    """
    Return the placements of all links, and the moving bodies in topological order.

    Ties are in the order of the URDF. Locked joints are followed at once, so that they
    do not affect the order.
    """
    placements = {selection.base: Placement(WORLD)}
    moving: Moving = []
    order = {name: k for k, name in enumerate(selection.singles)}
    ready: list[tuple[bool, int, StatedJoint]] = []  # a heap: locked joints first

    def reach(link: str) -> None:
        for single in selection.behind[link]:
            moves = single.name in selection.free or single.name in selection.followers
            heapq.heappush(ready, (moves, order[single.name], single))

    # From the base outward: a link is placed once its parent is.
    reach(selection.base)
    while ready:
        moves, _, single = heapq.heappop(ready)
        # The joint's origin, in the axes of the body that carries it.
        placement = placements[single.parent].frame(single.rotation, single.translation)
        if moves:
            moving.append((single, placement))
            placements[single.child] = Placement(len(moving) - 1)
        else:
            # A locked joint moves its child by its position, and merges it with the
            # parent.
            position = selection.positions.get(single.name, 0.0)
            displacement = _displacement(single, position)
            placements[single.child] = placement.frame(*displacement)
        reach(single.child)
    return placements, moving


def _displacement(single: StatedJoint, position: float) -> tuple[Array, Array]:
    """Return the pose of a joint's child in the joint's frame at a position."""
    if position == 0.0 or single.kind == 'fixed':
        return EYE, np.zeros(3)
    axis = single.axis / math.sqrt(single.axis @ single.axis)
    if single.kind == 'prismatic':
        return EYE, position * axis
    return snapped(rotation_about(axis, position)), np.zeros(3)


# ---------------------------------------------------------------- inertias

def _riders(tree: UrdfTree, selection: Selection, supplement: Supplement,
            placements: dict[str, Placement], moving: int,
            notices: Notices) -> list[list[Inertial]]:
    """Return the inertials of each moving body, in its axes; last, of the base."""
    riders: list[list[Inertial]] = [[] for _ in range(moving + 1)]

    def load(inertial: Inertial, placement: Placement) -> None:
        if placement.rotation is not EYE or placement.translation.any():
            inertial = inertial.moved(placement.rotation, placement.translation)
        riders[placement.body].append(inertial)  # the index of WORLD is -1

    # Links that are dropped have no inertia, but their frames stay.
    links = [name for name in placements if name in tree.links]
    for name in links:
        inertial = tree.links[name]
        if inertial is not None and name not in selection.drop:
            _check_inertia(name, inertial, notices)
            load(inertial, placements[name])
    if supplement.payload is not None:
        name, inertial = supplement.payload
        if name not in links:
            raise UrdfError(f"supplement: payload: link '{name}' is not part of the "
                            f'model; expected one of {listing(links)}')
        load(inertial, placements[name])
    return riders


def _check_inertia(link: str, inertial: Inertial, notices: Notices) -> None:
    """Note an impossible or singular inertia; an indefinite one is a fault."""
    # Indefinite inertias are errors; singular and impossible ones are listed in a
    # warning.
    moments = principal_moments(inertial.inertia, mass=inertial.mass)
    if moments.indefinite:
        if notices.strict:
            notices.fault(ModelError(
                f"link '{link}': <inertia> has principal moments {moments}; expected no "
                'negative moment, or strict=False (--no-strict) to load it'))
        notices.indefinite.append(link)
        return
    if inertial.mass > 0.0 and moments.singular:
        notices.singular.append(link)
    if moments.triangle:
        notices.triangle.append(link)


def _note_masses(tree: UrdfTree, moving: Moving, riders: list[list[Inertial]],
                 supplement: Supplement, notices: Notices) -> None:
    """Note moving links without <inertial> and moving bodies without mass."""
    for (single, _), inertials in zip(moving, riders):
        link = single.child
        if link not in tree.links:
            continue  # intermediate body of an expanded joint: massless by design
        if tree.links[link] is None:
            notices.no_inertial.append(link)
            continue
        # A link that is a rotor has the inertia of its joint.
        has_rotor = supplement.joints.get(single.name, {}).get('armature', 0.0) > 0.0
        if not has_rotor and not any(inertial.mass > 0.0 for inertial in inertials):
            notices.massless.append(link)


def _sum(inertials: list[Inertial]) -> Inertial:
    """Return the combined inertial of rigidly connected parts."""
    total = Inertial()
    for inertial in inertials:
        total = total + inertial
    return total


# ---------------------------------------------------------------- joints and
# limits

def _joint(single: StatedJoint, placement: Placement, selection: Selection,
           coordinates: dict[str, int], supplement: Supplement,
           limits: dict[str, Limits]) -> Joint:
    """Return the joint of a moving body."""
    # A joint that mimics none has itself as its master.
    mimic = selection.followers.get(single.name, Mimic(single.name))
    properties: dict[str, Any] = {'damping': single.damping, 'friction': single.friction}
    properties |= supplement.joints.get(single.name, {})
    return Joint(
        single.name, 'prismatic' if single.kind == 'prismatic' else 'revolute',
        single.axis,
        placement.rotation, placement.translation, coordinates[mimic.master],
        mimic.multiplier,
        mimic.offset, limits.get(single.name, UNLIMITED), **properties)


def _coordinate_limits(singles: Iterable[StatedJoint], selection: Selection,
                       notices: Notices) -> dict[str, Limits]:
    """
    Return the limits of the coordinates by name.

    A mimic joint is at ``multiplier * q + offset``, so its position and velocity limits
    bound q too. Its effort limit is not used: the master's limit bounds the torque of
    both.
    """
    limits = {}
    followers = []
    for single in singles:
        mimic = selection.followers.get(single.name)
        if mimic is not None:
            followers.append((single, mimic))
        else:
            limits[single.name] = _limits(single, notices)
    # Followers last, because they narrow the limits of their master.
    for single, mimic in followers:
        limits[mimic.master] = _narrowed(limits[mimic.master], single, mimic, notices)
    return limits


def _limits(single: StatedJoint, notices: Notices) -> Limits:
    """Return a joint's limits, infinite where missing or invalid, with notices."""
    name = single.name
    stated = single.limits
    continuous = single.kind == 'continuous'
    if stated is None:
        if not continuous:
            notices.no_limit.append(name)
        return UNLIMITED
    missing = [key for key in ('velocity', 'effort') if getattr(stated, key) is None]
    # One sided limits are legal, none at all are missing.
    if stated.lower is None and stated.upper is None and not continuous:
        missing = ['lower', 'upper', *missing]
    if missing:
        notices.no_limit.append(f'{name} ({", ".join(missing)})')
    return _sensible(single, stated, notices)


def _sensible(single: StatedJoint, stated: StatedLimits, notices: Notices) -> Limits:
    """Return the stated limits, infinite where invalid, with notices."""
    name = single.name
    # A limit of 0 would forbid all motion; URDF exporters write it for "not known".
    zero = [key for key in ('velocity', 'effort') if getattr(stated, key) == 0.0]
    if zero:
        notices.zero_limit.append(f'{name} ({", ".join(zero)})')
    lower = -math.inf
    upper = math.inf
    if stated.lower is not None or stated.upper is not None:
        if single.kind == 'continuous':
            notices.not_used('<limit> lower and upper of a continuous joint', name)
        else:
            # URDF: the default is 0 if only the other one is stated.
            lower = stated.lower or 0.0
            upper = stated.upper or 0.0
            largest = max(abs(lower), abs(upper))
            if single.kind == 'revolute' and DEGREES < largest <= 720.0:
                notices.degrees.append(f'{name} ({lower:g} to {upper:g})')
            if lower >= upper:
                notices.bad_limit.append(f'{name} ({lower:g} to {upper:g})')
                lower = -math.inf
                upper = math.inf
    return Limits(lower, upper, stated.velocity or math.inf, stated.effort or math.inf)


def _narrowed(master: Limits, single: StatedJoint, mimic: Mimic,
              notices: Notices) -> Limits:
    """Return the limits of a master combined with those of its mimic joint."""
    if single.limits is None:
        return master
    limits = _sensible(single, single.limits, notices)
    # The torque of a mimic joint is its master's, which has the limit.
    if limits.effort not in (math.inf, master.effort):
        notices.not_used("<limit> effort of a mimic joint, whose torque is its master's",
                         single.name)
    # Positions that both can reach; if there are none, the master's limits stay.
    common = master.with_follower(limits, mimic.multiplier, mimic.offset)
    if common is None:
        notices.no_room.append(f'{single.name} ({limits.lower:g} to {limits.upper:g})')
        speed_alone = replace(limits, lower=-math.inf, upper=math.inf)
        common = master.with_follower(speed_alone, mimic.multiplier, mimic.offset)
    return common or master
