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
from kane_dynamics.model.ball_coordinates import quaternion_names
from kane_dynamics.model.beam import renumbered
from kane_dynamics.model.builder import ModelBuilder
from kane_dynamics.model.drive import StiffnessCurve
from kane_dynamics.model.inertial import Inertial
from kane_dynamics.model.model import Body, Frame, Joint, Model, ROUNDING, WORLD
from kane_dynamics.model.placement import EYE, ORIGIN, Placement, rotation_about, snapped
from kane_dynamics.model.plausible_sizes import reach, warn_of_distance, warn_of_mass
import numpy as np
from numpy.typing import ArrayLike

Poses = Mapping[str, ArrayLike]


def with_tool(model: Model, on: str, name: str, inertial: Inertial, *,
              at: ArrayLike = ORIGIN,
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
        Pose of the tool's frame in frame `on`: m, and roll, pitch, yaw about fixed axes,
        rad.
    quaternion : (4,) array_like, optional
        Orientation as x, y, z, w, instead of `rpy`.
    frames : mapping of str to (3,) array_like, optional
        Further frames, such as a tool center point: their origins in the tool's frame,
        m, with its axes. `ModelBuilder.from_model` adds frames with other axes.

    Raises
    ------
    ModelError
        A frame is unknown or exists already, or the inertia is impossible.
    InputError
        `frames` is no mapping.

    Warns
    -----
    ModelWarning
        The tool is far away, or heavy, for this mechanism, as of millimeters and grams.
        It sits at an offset along a beam on the frame of the beam's root, which does not
        bend.

    """
    origins = {} if frames is None else frames
    _require_mapping(origins, 'frames', 'frame names to positions')
    # The model's own frames and joints stay; the tool is one more body, merged with its
    # parent.
    builder = ModelBuilder.from_model(model)
    builder.body(name, on, 'fixed',
                           at=at, rpy=rpy, quaternion=quaternion, inertial=inertial)
    for frame, origin in origins.items():
        builder.frame(frame, name, at=origin)
    # Values in millimetres or grams are seen by the reach and the mass of the arm.
    links = reach(model)
    what = f"tool '{name}'"
    warn_of_mass(inertial.mass, model, what, stacklevel=2)
    warn_of_distance(inertial.com, links, f'{what}: center of mass', stacklevel=2)
    pose_position = np.asarray(at, dtype=np.float64)
    warn_of_distance(pose_position, links, f'{what}: at', stacklevel=2)
    for frame, origin in origins.items():
        position = np.asarray(origin, dtype=np.float64)
        warn_of_distance(position, links, f"{what}: frame '{frame}'", stacklevel=2)
    return builder.model()


def with_model(model: Model, other: Model, on: str, *, at: ArrayLike = ORIGIN,
               rpy: ArrayLike = ORIGIN, quaternion: ArrayLike | None = None,
               prefix: str = '') -> Model:
    """
    Return a model that carries another one, such as an arm with a gripper.

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
        New names by present ones. A body has the frame of its name, which is renamed
        with it.

    Raises
    ------
    InputError
        `names` is no mapping, a name is unknown, or a new one is no text.
    ModelError
        Two joints, bodies or frames would have one name.

    """
    instance(model, Model, 'model')
    _require_mapping(names, 'names', 'present names to new ones')
    # Coordinates of several degrees of freedom have names of their own.
    known = {model.name, model.base_name, *model.coordinate_names, *model.joint_names}
    for frame in model.frames:
        known.add(frame.name)
    for body in model.bodies:
        known |= {body.name, body.joint.name}
    # A name that nothing has would change nothing: it is refused.
    for name, new in names.items():
        if name not in known:
            raise InputError(f'names: {name!r} is no joint, body or frame; expected '
                             f'some of {listing(sorted(known))}')
        if not isinstance(new, str) or not new:
            raise InputError(f'names: {new!r} for {name!r}; expected a text')

    def new_name(name: str) -> str:
        return names.get(name, name)
    return replace(model.renamed(new_name), name=new_name(model.name))


def with_locked(model: Model, positions: Mapping[str, float]) -> Model:
    """
    Return a model in which some joints, and joints that mimic them, are locked.

    Their bodies become parts of the bodies that carry them, with their mass. A beam on a
    locked joint is clamped there, and keeps its modes. Where the link or the motor of an
    elastic joint is locked, the spring and damper of its drive act on the other one.

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
        `positions` is no mapping; a joint is unknown, a part of a ball joint or a mode
        of a beam, or mimics another; a position is not finite; no joint would be left;
        or the link or motor alone of a drive is locked that has a stiffness curve or
        whose other joint has a spring.

    """
    instance(model, Model, 'model')
    held = _checked_positions(model, positions)
    # Coordinates that stay, and bodies that are kept or become parts of their carriers.
    free = [k for k in range(model.n) if k not in held]
    if not free:
        raise InputError(f'positions: all joints, {listing(positions)}; expected at '
                         'least one joint that moves')
    merger = _Merger(model.base_inertial, free)
    for body in _without_locked_drives(model, held):
        joint = body.joint
        if joint.coordinate in held and joint.deflection is None:
            position = joint.multiplier * held[joint.coordinate] + joint.offset
            merger.lock(body, position)
        else:
            merger.keep(body)
    # The parts of a ball joint stay together: none of them can be locked.
    balls = tuple(merger.placements[first].body for first in model.balls)
    names = [model.joint_names[k] for k in free]
    return replace(model, bodies=tuple(merger.bodies),
                   coordinate_names=quaternion_names(names, merger.bodies, balls),
                   frames=tuple(map(merger.frame, model.frames)),
                   base_inertial=merger.base_inertial, balls=balls)


def _without_locked_drives(model: Model, held: Mapping[int, float]) -> list[Body]:
    """Return the bodies with joint springs for the drives of which one side is held."""
    bodies = {body.joint.name: body for body in model.bodies}
    for name, drive, link, motor in model.drives:
        # Both sides move: the drive stays.
        if link not in held and motor not in held:
            continue
        joint = replace(bodies[name].joint, drive=None)
        bodies[name] = replace(bodies[name], joint=joint)

        # With one side held, the drive is a spring and a damper of the other side.
        if link in held and motor in held:
            continue
        if link in held:
            moving, held_position = drive.motor, held[link]
        else:
            moving, held_position = name, held[motor]
        joint = bodies[moving].joint
        if isinstance(drive.stiffness, StiffnessCurve) or joint.stiffness:
            raise InputError(f"positions: only one side of the elastic joint '{name}', "
                             'which has a stiffness curve or a spring; expected its link '
                             'and its motor, or neither')
        # The joint's position is its multiplier times the coordinate.
        r = joint.multiplier
        of_drive = drive.damping / (r * r)
        fast = joint.fast_damping
        joint = replace(joint, stiffness=drive.stiffness / (r * r),
                        rest=r * held_position, damping=joint.damping + of_drive,
                        fast_damping=None if fast is None else fast + of_drive)
        bodies[moving] = replace(bodies[moving], joint=joint)
    return list(bodies.values())


class _Merger:
    """Builds the bodies of a model with locked joints: each body behind one is merged."""

    def __init__(self, base_inertial: Inertial, free: list[int]) -> None:
        """Begin with the base; `free` are the coordinates that stay."""
        self.base_inertial = base_inertial
        self.bodies: list[Body] = []
        self.placements: list[Placement] = []  # of the model's bodies on these
        self._free = free

    def keep(self, body: Body) -> None:
        """Add a body whose joint moves, on its carrier of the result."""
        # Its carrier may be merged, so that the joint has another pose on another body.
        carrier = self._joint_placement(body)
        joint = replace(body.joint, rotation=carrier.rotation,
                        translation=carrier.translation,
                        coordinate=self._number(body.joint.coordinate),
                        deflection=renumbered(body.joint.deflection, self._number))
        self._add(replace(body, parent=carrier.body, joint=joint,
                          beam=renumbered(body.beam, self._number)))

    def lock(self, body: Body, position: float) -> None:
        """Make a body a part of its carrier, with the joint at a position, rad or m."""
        # Where the joint holds the body, in the axes of its carrier.
        displacement = _displacement(body.joint, position)
        placement = self._joint_placement(body).frame(*displacement)
        if body.beam is not None:
            self._clamp(body, placement)
            return
        # The body's inertia goes to the one that carries it, or to the base.
        inertial = body.inertial.moved(placement.rotation, placement.translation)
        if placement.body == WORLD:
            self.base_inertial = self.base_inertial + inertial
        else:
            carrier = self.bodies[placement.body]
            inertial = carrier.inertial + inertial
            self.bodies[placement.body] = replace(carrier, inertial=inertial)
        self.placements.append(placement)

    def frame(self, frame: Frame) -> Frame:
        """Return a frame of the model on the bodies of the result."""
        placement = self._on(frame.body).frame(frame.rotation, frame.translation)
        return replace(frame, body=placement.body, rotation=placement.rotation,
                       translation=placement.translation)

    def _clamp(self, body: Body, placement: Placement) -> None:
        """Add a beam with its root fixed, by a joint with multiplier 0."""
        # The modes need a body of their own, whose joint does not move.
        beam = renumbered(body.beam, self._number)
        assert beam is not None
        joint = Joint(body.joint.name, 'revolute', np.array([0.0, 0.0, 1.0]),
                      placement.rotation, placement.translation, beam.coordinates[0],
                      multiplier=0.0)
        self._add(replace(body, parent=placement.body, joint=joint, beam=beam))

    def _add(self, body: Body) -> None:
        self.bodies.append(body)
        self.placements.append(Placement(len(self.bodies) - 1))

    def _joint_placement(self, body: Body) -> Placement:
        return self._on(body.parent).frame(body.joint.rotation, body.joint.translation)

    def _on(self, body: int) -> Placement:
        return Placement(WORLD) if body == WORLD else self.placements[body]

    def _number(self, coordinate: int) -> int:
        return self._free.index(coordinate)


def _checked_positions(model: Model, positions: Mapping[str, float]) -> dict[int, float]:
    """Return the positions by coordinate."""
    _require_mapping(positions, 'positions', 'joint names to positions')
    # Modes and parts of a ball have no position that could be locked.
    without_position = {model.joint_names[k] for k in model.modal_coordinates}
    for first in model.balls:
        # The three bodies of a ball joint.
        without_position |= {body.joint.name for body in model.bodies[first:first + 3]}
    valid = [name for name in model.joint_names if name not in without_position]
    held = {}
    for name, position in positions.items():
        if name not in valid:
            raise InputError(f'positions: {name!r} is no joint with a position of its '
                             f'own; expected some of {listing(valid)}')
        held[model.joint_names.index(name)] = number(
            position, 'position of joint '
                      f"'{name}'", 'a finite number, rad or m', math.isfinite)
    _warn_of_limits(model, held)
    return held


def _require_mapping(value: Any, what: str, expected: str) -> None:
    """Raise InputError for anything but a mapping."""
    if not isinstance(value, Mapping):
        raise InputError(f'{what}: {SHORT.repr(value)}; expected a mapping of '
                         f'{expected}')


def _warn_of_limits(model: Model, held: Mapping[int, float]) -> None:
    """Warn of locked positions outside the limits of their joints."""
    outside = []
    for body in model.bodies:
        joint = body.joint
        # Of a joint and those that mimic it, the joint's limits count.
        position = held.get(joint.coordinate)
        if position is None or joint.name != model.joint_names[joint.coordinate]:
            continue
        low = joint.limits.lower
        high = joint.limits.upper
        if not low - ROUNDING <= position <= high + ROUNDING:
            outside.append(f"'{joint.name}' at {position:g}, limits {low:g} to {high:g}")
    if outside:
        warnings.warn(f'positions: outside the limits: {"; ".join(outside)}; expected '
                      'rad or m within them', ModelWarning, stacklevel=4)


def _displacement(joint: Joint, position: float) -> tuple[Array, Array]:
    """Return the pose of a joint's body in the joint's frame at a position."""
    if joint.kind == 'prismatic':
        return EYE, position * joint.axis
    return snapped(rotation_about(joint.axis, position)), np.zeros(3)
