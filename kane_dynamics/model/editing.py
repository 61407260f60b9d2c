"""
Change a model without its XML: attach tools and models, lock joints, rename.

Each function returns a new model. `ModelBuilder.from_model` adds anything else.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
import math
from typing import Any
import warnings

from kane_dynamics._util.checks import instance, number
from kane_dynamics._util.text import listing, SHORT
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError, ModelWarning
from kane_dynamics.model.builder import ModelBuilder
from kane_dynamics.model.inertial import Inertial
from kane_dynamics.model.joint_expansion import quaternion_names
from kane_dynamics.model.model import Body, Joint, Model, ROUNDING, WORLD
from kane_dynamics.model.model_assembly import ORIGIN
from kane_dynamics.model.placement import EYE, Placement, rotation_about, snapped
import numpy as np
from numpy.typing import ArrayLike

Poses = Mapping[str, ArrayLike]


def with_tool(model: Model, on: str, name: str, inertial: Inertial, *, at: ArrayLike = ORIGIN,
              rpy: ArrayLike = ORIGIN, quaternion: ArrayLike | None = None,
              frames: Poses | None = None) -> Model:
    """
    Return a model with a tool fixed on a frame, such as a gripper on a flange.

    Parameters
    ----------
    model : Model
        The mechanism.
    on : str
        The frame that carries the tool.
    name : str
        Name of the tool and of its frame.
    inertial : Inertial
        Of the tool, from the origin and in the axes of its frame.
    at, rpy : (3,) array_like
        Pose of the tool's frame in frame `on`: m, and roll, pitch, yaw about fixed axes, rad.
    quaternion : (4,) array_like, optional
        Orientation as x, y, z, w, instead of `rpy`.
    frames : mapping of str to (3,) array_like, optional
        Further frames, such as a tool center point: their origins in the tool's frame, m, with its
        axes. `ModelBuilder.from_model` adds frames with other axes.

    Raises
    ------
    ModelError
        A frame is unknown or exists already, or the inertia is impossible.
    InputError
        `frames` is no mapping.

    """
    origins = {} if frames is None else frames
    _require_mapping(origins, 'frames', 'frame names to positions')
    builder = ModelBuilder.from_model(model)
    builder.body(name, on, 'fixed', at=at, rpy=rpy, quaternion=quaternion, inertial=inertial)
    for frame, origin in origins.items():
        builder.frame(frame, name, at=origin)
    return builder.model()


def with_model(model: Model, other: Model, on: str, *, at: ArrayLike = ORIGIN,
               rpy: ArrayLike = ORIGIN, quaternion: ArrayLike | None = None,
               prefix: str = '') -> Model:
    """
    Return a model that carries another one, such as an arm with a gripper that has joints.

    Parameters
    ----------
    model : Model
        Its gravity is that of the result.
    other : Model
        Its base is fixed on the frame `on`; its joints come last in q.
    on, at, rpy, quaternion
        As in `with_tool`, the pose of the base of `other`.
    prefix : str
        Prefix of the names of its bodies, joints and frames.

    Raises
    ------
    ModelError
        A name exists already; choose a prefix.
    InputError
        `other` is no model, or the prefix is no text.

    """
    instance(other, Model, 'other')
    instance(prefix, str, 'prefix')
    builder = ModelBuilder.from_model(model)
    builder.mount(other, on, at=at, rpy=rpy, quaternion=quaternion, prefix=prefix)
    return builder.model()


def with_names(model: Model, names: Mapping[str, str]) -> Model:
    """
    Return a model with other names of joints, bodies or frames.

    Parameters
    ----------
    model : Model
        The mechanism.
    names : mapping of str to str
        New names by present ones. A body has the frame of its name, which is renamed with it.

    Raises
    ------
    InputError
        `names` is no mapping, a name is unknown, or a new one is no text.
    ModelError
        Two joints, bodies or frames would have one name.

    """
    instance(model, Model, 'model')
    _require_mapping(names, 'names', 'present names to new ones')
    known = {model.name, model.base_name, *model.coordinate_names, *model.joint_names,
             *(frame.name for frame in model.frames)}
    for body in model.bodies:
        known |= {body.name, body.joint.name}
    for name, new in names.items():
        if name not in known:
            raise InputError(f'names: {name!r} is no joint, body or frame; expected some of '
                             f'{listing(sorted(known))}')
        if not isinstance(new, str) or not new:
            raise InputError(f'names: {new!r} for {name!r}; expected a text')

    def called(name: str) -> str:
        return names.get(name, name)
    bodies = [replace(body, name=called(body.name),
                      joint=replace(body.joint, name=called(body.joint.name)))
              for body in model.bodies]
    return replace(
        model, name=called(model.name), base_name=called(model.base_name), bodies=tuple(bodies),
        coordinate_names=tuple(called(name) for name in model.coordinate_names),
        frames=tuple(replace(frame, name=called(frame.name)) for frame in model.frames))


def with_locked(model: Model, positions: Mapping[str, float]) -> Model:
    """
    Return a model in which some joints are locked; joints that mimic them are locked too.

    Their bodies become parts of the bodies that carry them, with their mass. A beam on a locked
    joint is clamped there, and keeps its modes.

    Parameters
    ----------
    model : Model
        The mechanism.
    positions : mapping of str to float
        Position of each locked joint, rad or m.

    Warns
    -----
    ModelWarning
        A position is outside the limits of its joint, as degrees are.

    Raises
    ------
    InputError
        `positions` is no mapping; a joint is unknown, a part of a ball joint or a mode of a beam,
        or mimics another; a position is not finite; or no joint would be left.

    """
    instance(model, Model, 'model')
    held = _checked_positions(model, positions)
    kept = [k for k in range(model.n) if k not in held]
    if not kept:
        raise InputError(f'positions: all joints, {listing(positions)}; expected at least one '
                         'joint that moves')
    places: list[Placement] = []  # of each body of the model, on the bodies of the result
    bodies: list[Body] = []
    moved = {}  # indices of the bodies that stay
    base_inertial = model.base_inertial
    for index, body in enumerate(model.bodies):
        carrier = Placement(WORLD) if body.parent == WORLD else places[body.parent]
        joint = body.joint
        placement = carrier.frame(joint.rotation, joint.translation)
        if joint.coordinate in held and joint.deflection is None:
            position = joint.multiplier * held[joint.coordinate] + joint.offset
            placement = placement.frame(*_displacement(joint, position))
            if body.beam is not None:
                # The modes need a body of their own, whose joint does not move.
                bodies.append(_clamped(body, placement, kept))
                places.append(Placement(len(bodies) - 1))
                continue
            inertial = body.inertial.moved(placement.rotation, placement.translation)
            if placement.body == WORLD:
                base_inertial = base_inertial + inertial
            else:
                owner = bodies[placement.body]
                bodies[placement.body] = replace(owner, inertial=owner.inertial + inertial)
        else:
            moved[index] = len(bodies)
            bodies.append(_reindexed(body, placement, kept))
            placement = Placement(len(bodies) - 1)
        places.append(placement)
    frames = []
    for frame in model.frames:
        carrier = Placement(WORLD) if frame.body == WORLD else places[frame.body]
        placement = carrier.frame(frame.rotation, frame.translation)
        frames.append(replace(frame, body=placement.body, rotation=placement.rotation,
                              translation=placement.translation))
    balls = tuple(moved[ball] for ball in model.balls)
    names = quaternion_names([model.joint_names[k] for k in kept],
                             [bodies[ball].joint.coordinate for ball in balls])
    return replace(model, bodies=tuple(bodies), coordinate_names=names, frames=tuple(frames),
                   base_inertial=base_inertial, balls=balls)


def _checked_positions(model: Model, positions: Mapping[str, float]) -> dict[int, float]:
    """Return the positions by coordinate."""
    _require_mapping(positions, 'positions', 'joint names to positions')
    parts = {model.bodies[ball + k].joint.name for ball in model.balls for k in range(3)}
    modes = {model.joint_names[k] for k in model.modal_coordinates}
    held = {}
    for name, position in positions.items():
        if name not in model.joint_names or name in parts | modes:
            valid = [joint for joint in model.joint_names if joint not in parts | modes]
            raise InputError(f'positions: {name!r} is no joint with a position of its own; '
                             f'expected some of {listing(valid)}')
        held[model.joint_names.index(name)] = number(
            position, f"position of joint '{name}'", 'a finite number, rad or m', math.isfinite)
    _warn_of_limits(model, held)
    return held


def _require_mapping(value: Any, what: str, expected: str) -> None:
    """Raise InputError for anything but a mapping."""
    if not isinstance(value, Mapping):
        raise InputError(f'{what}: {SHORT.repr(value)}; expected a mapping of {expected}')


def _warn_of_limits(model: Model, held: Mapping[int, float]) -> None:
    """Warn of locked positions outside the limits of their joints."""
    outside = []
    for body in model.bodies:
        joint = body.joint
        position = held.get(joint.coordinate)
        if position is None or joint.name != model.joint_names[joint.coordinate]:
            continue
        low, high = joint.limits.lower, joint.limits.upper
        if not low - ROUNDING <= position <= high + ROUNDING:
            outside.append(f"'{joint.name}' at {position:g}, limits {low:g} to {high:g}")
    if outside:
        warnings.warn(f'positions: outside the limits: {"; ".join(outside)}; expected rad or m '
                      'within them', ModelWarning, stacklevel=4)


def _displacement(joint: Joint, position: float) -> tuple[Array, Array]:
    """Return the pose of a joint's body in the joint's frame at a position."""
    if joint.kind == 'prismatic':
        return EYE, position * joint.axis
    return snapped(rotation_about(joint.axis, position)), np.zeros(3)


def _clamped(body: Body, placement: Placement, kept: list[int]) -> Body:
    """Return a beam with its root fixed, by a joint with multiplier 0 as of `ModelBuilder`."""
    beam: Any = body.beam
    coordinates = tuple(kept.index(k) for k in beam.coordinates)
    joint = Joint(body.joint.name, 'revolute', np.array([0.0, 0.0, 1.0]), placement.rotation,
                  placement.translation, coordinates[0], multiplier=0.0)
    return replace(body, parent=placement.body, joint=joint,
                   beam=replace(beam, coordinates=coordinates))


def _reindexed(body: Body, placement: Placement, kept: list[int]) -> Body:
    """Return a body on its carrier of the result, with the indices of the kept coordinates."""
    def shifted(bent: Any) -> Any:
        return bent and replace(bent, coordinates=tuple(kept.index(k) for k in bent.coordinates))
    joint = replace(body.joint, rotation=placement.rotation, translation=placement.translation,
                    coordinate=kept.index(body.joint.coordinate),
                    deflection=shifted(body.joint.deflection))
    return replace(body, parent=placement.body, joint=joint, beam=shifted(body.beam))
