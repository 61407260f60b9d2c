"""Build a `Model` in Python: bodies, joints, inertias, frames, mounted models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any
import warnings

from kane_dynamics._util.checks import constant, instance
from kane_dynamics._util.fixed_attributes import closest, guarded_class
from kane_dynamics._util.text import listing
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ModelError, ModelWarning
from kane_dynamics.model.ball_coordinates import (check_ball_property, is_ball_part,
                                                  quaternion_names)
from kane_dynamics.model.beam import renumbered
from kane_dynamics.model.drive import Drive
from kane_dynamics.model.elastic_model import with_drives
from kane_dynamics.model.flexible_link import AssumedModes, FlexibleLink
from kane_dynamics.model.inertial import check_moments, Inertial
from kane_dynamics.model.joint_expansion import expand_joint, StatedJoint
from kane_dynamics.model.model import (Body, Frame, FRICTION, GRAVITY, Joint, Limits,
                                       Model, WORLD)
from kane_dynamics.model.placement import ORIGIN, Placement, stated_pose
import numpy as np
from numpy.typing import ArrayLike

KINDS = ('revolute',
         'prismatic', 'universal', 'spherical', 'ball', 'planar', 'floating', 'free',
         'fixed')
PROPERTIES = ('limits',
              *FRICTION, 'friction_speed', 'armature', 'stiffness', 'rest', 'drive')
# Those of `ModelBuilder.body` beside the properties of its joint.
ARGUMENTS = ('on', 'kind', 'axis', 'at', 'rpy', 'quaternion', 'inertial', 'joint', 'turns',
             'mimic', 'multiplier')
MASSLESS = Inertial()
ALONG = 0.01  # of a beam's length: what is nearer to its root may be a hub
Z = (0.0, 0.0, 1.0)


@guarded_class
class ModelBuilder:
    """
    Builder of mechanisms: add bodies outward from 'world', then call `model`.

    Bodies, inertias and constraints are attached to frames by name. 'world' is a frame,
    every body is a frame of the same name, and `frame` adds further ones.

    Parameters
    ----------
    name : str
    gravity : (3,) array
        m/s^2, world axes.
    strict : bool
        Raise an error for moments of inertia that no rigid body can have. If False, they
        are accepted, and `model` warns about them.

    Examples
    --------
    A pendulum on a cart with a spring:

    >>> b = ModelBuilder('cart')
    >>> b.body('cart', 'world', 'prismatic', axis=(1, 0, 0), inertial=point_mass(2),
    ...        stiffness=50)
    >>> b.body('rod', 'cart', 'revolute', axis=(0, 1, 0),
    ...        inertial=rod(1, (0, 0, 0), (0, 0, -0.5)))
    >>> robot = Robot(b.model())

    """

    def __init__(self, name: str = 'mechanism', *, gravity: ArrayLike = GRAVITY,
                 strict: bool = True) -> None:
        """Create a mechanism without bodies."""
        self.name = name
        self.gravity = constant(gravity, (3,), 'gravity')
        self.strict = strict
        self._bodies: list[Body] = []
        self._coordinates: list[str] = []  # names of the degrees of freedom
        self._balls: list[int] = []  # as `Model.balls`
        self._placements = {'world': Placement(WORLD)}  # of the frames
        self._base_name = 'world'
        self._base_inertial = MASSLESS
        self._beams: dict[str, tuple[AssumedModes, tuple[int, ...]]] = {}
        self._impossible: list[str] = []  # bodies with inertias that strict=True refuses

    @classmethod
    def from_model(cls, model: Model, *, strict: bool = True) -> ModelBuilder:
        """
        Return a builder that goes on from a model, such as one of `load_urdf`.

        Its frames and bodies carry further ones, by name; the world is called
        `model.base_name`.

        Parameters
        ----------
        model : Model
            With bodies, joints and frames of any kind.
        strict : bool
            As of the class, for what is added.

        """
        instance(model, Model, 'model')
        # Bodies are immutable, so that the builder shares those of the model.
        builder = cls(model.name, gravity=model.gravity, strict=strict)
        builder._base_name = model.base_name
        builder._base_inertial = model.base_inertial
        builder._bodies = list(model.bodies)
        builder._coordinates = list(model.joint_names)
        builder._balls = list(model.balls)
        # Every frame of the model is a place to attach to.
        builder._placements = {model.base_name: Placement(WORLD)}
        for frame in model.frames:
            builder._placements[frame.name] = Placement(frame.body, frame.rotation,
                                                        frame.translation)
        return builder

    def body(self, name: str, on: str = 'world', kind: str = 'revolute', *,
             axis: ArrayLike = Z, at: ArrayLike = ORIGIN, rpy: ArrayLike = ORIGIN,
             quaternion: ArrayLike | None = None, inertial: Inertial = MASSLESS,
             joint: str | None = None, turns: str = 'xyz', mimic: str | None = None,
             multiplier: float = 1.0, offset: float = 0.0, **properties: Any) -> None:
        """
        Add a body and its joint.

        Parameters
        ----------
        name : str
            Name of the body and of its frame.
        on : str
            The frame to which the joint is attached.
        kind : str
            revolute, prismatic; or a joint with more degrees of freedom, which is
            expanded to joints <joint>/x and so on: universal (two rotations) and
            spherical (three), about the axes in `turns`; floating (/x, /y, /z, then
            three rotations); planar (/x, /y in the plane normal to the axis, then /rz
            about it); or fixed, part of its carrier. ball rotates by a unit quaternion,
            with the angular velocity /wx, /wy, /wz on the body's axes as speeds; free is
            /x, /y, /z, then a ball: no singular configuration.
        axis : (3,) array
            Axis of a revolute, prismatic or planar joint, in the joint's axes.
        at, rpy : (3,) arrays
            Pose of the joint in frame `on`: m, and roll, pitch, yaw about its fixed x,
            y, z, rad.
        quaternion : (4,) array, optional
            Orientation as x, y, z, w, instead of `rpy`.
        inertial : Inertial
            Inertia of the body in its axes, which are those of the joint at position 0.
        joint : str, optional
            Name of the joint. Default: that of the body.
        turns : str
            Axes of successive rotations, each rotated by the previous ones.
        mimic : str, optional
            A joint of one degree of freedom that this one follows: its position is
            `multiplier` times that joint's position + `offset`. It has no entry in q;
            its limits of position and velocity bound those of that joint too, its limit
            of effort does not count.
        multiplier, offset : float
            Of a joint that mimics another; offset in rad or m.
        **properties
            Properties of a joint of one degree of freedom: limits, armature, stiffness,
            rest, drive (of an elastic joint), and its friction law as of `Joint`:
            damping, fast_damping, damping_speed, friction, friction_backward,
            breakaway_friction, stribeck_speed, load_friction, load_friction_backdriven,
            friction_speed, friction_offset, presliding_stiffness, presliding_damping. For
            other joints, see `joint`.

        Raises
        ------
        ModelError
            If a name exists already or is unknown, or a value is invalid; the message
            names it.

        """
        # Everything is checked before anything is added: a refused body changes nothing.
        joint_name = name if joint is None else joint
        what = f"joint '{joint_name}'"
        if kind not in KINDS:
            raise ModelError(f"{what}: kind '{kind}'; expected one of "
                             f"{', '.join(KINDS)}")
        number_of_turns = 2 if kind == 'universal' else 3
        turns = _checked_turns(turns, number_of_turns, what)

        # A joint of several degrees of freedom becomes joints in series.
        R, p = stated_pose(at, rpy, what, quaternion)
        stated = StatedJoint(joint_name, kind, on, name, R, p, _direction(axis, what),
                             turns=turns)
        singles = expand_joint(stated)
        single_names = [single.name for single in singles]
        _check_properties(joint_name, properties, single_names, ARGUMENTS)
        placement = self._placement(on, what)
        self._check_new(name)
        _check_inertial(name, inertial)
        if self.strict:
            check_moments(name, inertial)
        attached = placement.frame(R, p)
        self._warn_of_root(attached.body, attached.translation, what)
        mimic_fields = self._mimic_fields(what, kind, mimic, multiplier, offset)

        # All is checked; from here on the builder changes.
        if kind == 'fixed':
            if properties:
                raise ModelError(f'{what}: {", ".join(properties)} of a fixed joint; '
                                 'expected no property, since it does not move')
            self._placements[name] = attached
        else:
            for single in singles:
                self._check_joint(single.name)
            # The last three joints in series are the parts of a ball.
            if kind in ('ball', 'free'):
                self._balls.append(len(self._bodies) + len(singles) - 3)
            fields = {**mimic_fields, **properties}
            self._placements[name] = self._add_joints(singles, placement, fields)
        self.load(name, inertial)

    def beam(self, name: str, on: str, link: FlexibleLink, kind: str = 'revolute',
             **options: Any) -> None:
        """
        Add a flexible body (beam) and its joint.

        Frame `name` is at the root and `name/tip` at the other end; `section` adds
        frames between them. Modal coordinates are called `name/mode_1`, `name/twist_1`
        and so on.

        Parameters
        ----------
        name : str
            Name of the body.
        on : str
            The frame to which the joint is attached.
        link : FlexibleLink
            The beam; `inertial` adds inertia at its root.
        kind, **options
            As in `body`, including its errors.

        """
        # Modes of bending are coordinates behind those of the joint.
        modes = link.assumed_modes(name)
        inertial = options.pop('inertial', MASSLESS) + modes.inertial
        if kind == 'fixed' and modes.count:
            self._clamp(name, on, **options)
            self.load(name, inertial)
        else:
            self.body(name, on, kind, inertial=inertial, **options)
        first = len(self._coordinates)
        coordinates = tuple(range(first, first + modes.count))
        self._coordinates += modes.names
        self._beams[name] = modes, coordinates
        if modes.count:
            body = self._placements[name].body
            bent = replace(self._bodies[body], beam=modes.beam(coordinates))
            self._bodies[body] = bent
        # The tip is a section, which bends with the beam.
        self.section(f'{name}/tip', name, modes.length)

    def section(self, name: str, of: str, at: float) -> None:
        """
        Add a frame at a section of a beam.

        Parameters
        ----------
        name : str
            Name of the frame.
        of : str
            The beam.
        at : float
            Distance from its root, m; ModelError if it is not on the beam.

        """
        if of not in self._beams:
            raise ModelError(f"no beam '{of}'; expected one of "
                             f'{listing(list(self._beams))}')
        modes, coordinates = self._beams[of]
        if not 0.0 < at <= modes.length:
            raise ModelError(f"frame '{name}': {at} m on beam '{of}'; expected 0 to "
                             f'{modes.length:g} m')
        self._check_new(name)
        # On the straight beam first; without modes the section is a frame of its body.
        placement = self._placements[of].frame(np.eye(3), at * modes.axes[0])
        if coordinates:
            # The section moves by massless bodies in series, one for each of its
            # deflections.
            for part, kind, axis, deflection in modes.deflections(at, coordinates):
                joint = Joint(f'{name}/{part}', kind, axis, placement.rotation,
                              placement.translation, coordinates[0],
                              deflection=deflection)
                self._bodies.append(Body(joint.name, placement.body, joint))
                placement = Placement(len(self._bodies) - 1)
        self._placements[name] = placement

    def joint(self, name: str, **properties: Any) -> None:
        """
        Set properties of an existing joint: limits, damping, stiffness and so on.

        Parameters
        ----------
        name : str
            A joint of one degree of freedom, such as 'base/rx' of a floating joint.
        **properties
            As in `body`.

        """
        names = [body.joint.name for body in self._bodies]
        if name not in names:
            raise ModelError(f"no joint '{name}'; expected one of {listing(names)}")
        _check_properties(name, properties)
        index = names.index(name)
        if is_ball_part(index, self._balls):
            check_ball_property(name, properties)
        drive = self._bodies[index].joint.drive
        if 'drive' in properties and drive is not None and drive.motor:
            raise ModelError(f"joint '{name}': drive: the joint has the motor "
                             f"'{drive.motor}'; expected a joint without one")
        # Bodies are immutable records: the changed one takes the place.
        body = self._bodies[index]
        self._bodies[index] = replace(body, joint=replace(body.joint, **properties))

    def load(self, on: str, inertial: Inertial) -> None:
        """
        Add inertia, given in the axes of a frame.

        Raises
        ------
        ModelError
            If the frame does not exist, or the moments of inertia are impossible.

        """
        placement = self._placement(on, 'load')
        _check_inertial(on, inertial)
        try:
            check_moments(on, inertial)
        except ModelError:
            if self.strict:
                raise
            self._impossible.append(on)
        # In the axes of the body, where inertias add up.
        moved = inertial.moved(placement.rotation, placement.translation)
        # Elsewhere on the body, its frame was warned of.
        if inertial.mass and not placement.translation.any():
            self._warn_of_root(placement.body, moved.com, f"inertia on '{on}'")
        if placement.body == WORLD:
            self._base_inertial = self._base_inertial + moved
        else:
            body = self._bodies[placement.body]
            self._bodies[placement.body] = replace(body, inertial=body.inertial + moved)

    def frame(self, name: str, on: str, *, at: ArrayLike = ORIGIN,
              rpy: ArrayLike = ORIGIN,
              quaternion: ArrayLike | None = None) -> None:
        """
        Add a frame fixed in another.

        Parameters
        ----------
        name, on : str
            The new frame, and the one in which it is fixed.
        at, rpy : (3,) arrays
            Its pose: m, and roll, pitch, yaw about fixed axes, rad.
        quaternion : (4,) array, optional
            Orientation as x, y, z, w, instead of `rpy`.

        """
        what = f"frame '{name}'"
        self._check_new(name)
        # Frames are kept on bodies: several in a row become one placement.
        carrier = self._placement(on, what)
        R, p = stated_pose(at, rpy, what, quaternion)
        placement = carrier.frame(R, p)
        self._warn_of_root(placement.body, placement.translation, what)
        self._placements[name] = placement

    def mount(self, model: Model, on: str, *, at: ArrayLike = ORIGIN,
              rpy: ArrayLike = ORIGIN,
              quaternion: ArrayLike | None = None, prefix: str = '') -> None:
        """
        Attach a whole model, such as an arm from `load_urdf`.

        Parameters
        ----------
        model : Model
            The model; its gravity is ignored. Further bodies can be attached to its
            frames.
        on : str
            Frame to which its base is attached.
        at, rpy : (3,) arrays
            Pose of its base in frame `on`, m and rad.
        quaternion : (4,) array, optional
            Orientation as x, y, z, w, instead of `rpy`.
        prefix : str
            Prefix of the names of its bodies, joints and frames.

        Raises
        ------
        ModelError
            If a name exists already; choose a prefix.

        """
        carrier = self._placement(on, f"model '{model.name}'")
        R, p = stated_pose(at, rpy, 'mount', quaternion)
        base = carrier.frame(R, p)
        self._warn_of_root(base.body, base.translation, f"model '{model.name}'")
        # Names first: a clash leaves the builder as it was.
        mounted = model.prefixed(prefix)
        for name in sorted({mounted.base_name,
                            *(frame.name for frame in mounted.frames)}):
            self._check_new(name)
        for body in mounted.bodies:
            self._check_joint(body.joint.name)

        # Indices of bodies and of degrees of freedom go on from those that exist.
        first_body = len(self._bodies)
        first_freedom = len(self._coordinates)

        def number(coordinate: int) -> int:
            return first_freedom + coordinate
        for body in mounted.bodies:
            joint = replace(body.joint, coordinate=number(body.joint.coordinate),
                            deflection=renumbered(body.joint.deflection, number))
            parent = first_body + body.parent
            if body.parent == WORLD:
                placement = base.frame(joint.rotation, joint.translation)
                parent = placement.body
                joint = replace(joint, rotation=placement.rotation,
                                translation=placement.translation)
            beam = renumbered(body.beam, number)
            self._bodies.append(Body(body.name, parent, joint, body.inertial, beam))
        self._coordinates += mounted.joint_names
        self._balls += [first_body + body for body in mounted.balls]
        self._placements[mounted.base_name] = base
        # Frames of the model's base are on the body that carries it.
        for frame in mounted.frames:
            on_body = base if frame.body == WORLD else Placement(first_body + frame.body)
            placement = on_body.frame(frame.rotation, frame.translation)
            self._placements[frame.name] = placement
        self.load(mounted.base_name, mounted.base_inertial)

    def model(self) -> Model:
        """Return the model; raise ModelError if it has no body."""
        if not self._bodies:
            raise ModelError(f"mechanism '{self.name}': no body; expected at least one")
        if self._impossible:
            names = ', '.join(dict.fromkeys(self._impossible))
            warnings.warn('inertias that no rigid body can have, accepted by '
                          f'strict=False: {names}', ModelWarning, stacklevel=2)
        # Placements and frames are the same, by name.
        frames = [Frame(name, placement.body, placement.rotation, placement.translation)
                  for name, placement in self._placements.items()]
        coordinates = quaternion_names(self._coordinates, self._bodies, self._balls)
        # Drives come last: their motors have coordinates behind all others.
        drives = {}
        bodies = []
        for body in self._bodies_with_common_limits():
            joint = body.joint
            if joint.drive is not None and not joint.drive.motor:
                drives[joint.name] = joint.drive
                body = replace(body, joint=replace(joint, drive=None))
            bodies.append(body)
        model = Model(self.name, tuple(bodies), coordinates, tuple(frames), self.gravity,
                      self._base_name, self._base_inertial, tuple(self._balls))
        return with_drives(model, drives)

    def _add_joints(self, singles: Sequence[StatedJoint], placement: Placement,
                    fields: dict[str, Any]) -> Placement:
        """Add the bodies of joints in series; return the placement of the last one."""
        for single in singles:
            # A revolute part of a ball joint, too, is a joint of one degree of freedom.
            kind: Any = 'prismatic' if single.kind == 'prismatic' else 'revolute'
            carrier = placement.frame(single.rotation, single.translation)
            joint = Joint(single.name, kind, single.axis, carrier.rotation,
                          carrier.translation,
                          **{'coordinate': len(self._coordinates), **fields})
            self._bodies.append(Body(single.child, carrier.body, joint))
            if 'coordinate' not in fields:  # as of a joint that mimics another
                self._coordinates.append(single.name)
            placement = Placement(len(self._bodies) - 1)
        return placement

    def _clamp(self, name: str, on: str, **options: Any) -> None:
        """Add a body clamped to its parent, by a joint with multiplier 0."""
        self.body(name, on, 'fixed', **options)
        joint_name = options.get('joint') or name
        self._check_joint(joint_name)
        placement = self._placements[name]
        # A joint with multiplier 0 does not move with any coordinate.
        joint = Joint(joint_name, 'revolute', np.array(Z), placement.rotation,
                      placement.translation, len(self._coordinates), multiplier=0.0)
        self._bodies.append(Body(name, placement.body, joint))
        self._placements[name] = Placement(len(self._bodies) - 1)

    def _mimic_fields(self, what: str, kind: str, mimic: str | None, multiplier: float,
                      offset: float) -> dict[str, Any]:
        """Return coordinate, multiplier and offset of a mimic joint, else nothing."""
        if mimic is None:
            if (multiplier, offset) != (1.0, 0.0):
                raise ModelError(f'{what}: multiplier {multiplier}, offset {offset} '
                                 'without mimic; expected the joint that it follows')
            return {}
        if kind not in ('revolute', 'prismatic'):
            raise ModelError(f'{what}: a {kind} joint mimics {mimic!r}; expected kind '
                             'revolute or prismatic')
        # Joints that others can follow: no joints of beams, none that are fixed, no
        # parts of balls.
        masters = {body.joint.name: body.joint for index, body in enumerate(self._bodies)
                   if body.joint.deflection is None and body.joint.multiplier
                   and not is_ball_part(index, self._balls)}
        if not isinstance(mimic, str) or mimic not in masters:
            raise ModelError(f'{what}: mimic: {mimic!r}; expected one of '
                             f'{listing(masters)}')
        ratio = float(constant(multiplier, (), f'{what}: multiplier'))
        shift = float(constant(offset, (), f'{what}: offset'))
        if not ratio:
            raise ModelError(f'{what}: multiplier: 0; expected a nonzero number')
        # The master may itself mimic a joint; both then share that joint's coordinate.
        master = masters[mimic]
        return {'coordinate': master.coordinate, 'multiplier': ratio * master.multiplier,
                'offset': ratio * master.offset + shift}

    def _bodies_with_common_limits(self) -> tuple[Body, ...]:
        """Return the bodies; limits of mimic joints narrow those of their masters."""
        bodies = list(self._bodies)
        masters = {body.joint.name: index for index, body in enumerate(bodies)
                   if body.joint.name in self._coordinates}
        for body in self._bodies:
            joint = body.joint
            # Joints of sections and of clamped beams follow no other one.
            index = masters.get(self._coordinates[joint.coordinate])
            follows = joint.deflection is None and joint.multiplier != 0.0
            if index is None or not follows or joint.name in masters:
                continue
            master = bodies[index].joint
            # The position of the master is within both limits: its own, and those of its
            # follower through q_follower = multiplier q + offset.
            limits = master.limits.with_follower(joint.limits, joint.multiplier,
                                                 joint.offset)
            if limits is None:
                raise ModelError(
                    f"joint '{joint.name}': limits {joint.limits.lower:g} to "
                    f'{joint.limits.upper:g}, which exclude all positions of '
                    f"'{master.name}', the joint that it follows; expected limits with "
                    'a common range')
            bodies[index] = replace(bodies[index], joint=replace(master, limits=limits))
        return tuple(bodies)

    def _placement(self, on: str, what: str) -> Placement:
        """Return the placement of a frame; raise ModelError for an unknown name."""
        if not isinstance(on, str) or on not in self._placements:
            raise ModelError(f"{what}: no body or frame '{on}'; expected one of "
                             f'{listing(self._placements)}')
        return self._placements[on]

    def _warn_of_root(self, index: int, place: Array, what: str) -> None:
        """Warn of a place along a beam, in the axes of its root, which does not bend."""
        beam = None if index == WORLD else self._bodies[index].beam
        if beam is None:
            return
        # Places near the root move with it; farther along the beam bends.
        along = float(place @ beam.direction)
        length = float((beam.points @ beam.direction).max())
        if along > ALONG * length:
            link = self._bodies[index].name
            warnings.warn(f"{what}: {along:.4g} m along beam '{link}' in the axes of "
                          'its root, which does not bend; expected the frame '
                          f"'{link}/tip', or one of "
                          'ModelBuilder.section', ModelWarning, stacklevel=4)

    def _check_new(self, name: str) -> None:
        if not isinstance(name, str) or not name:
            raise ModelError(f'name of a body or frame: {name!r}; expected a text')
        if name in self._placements:
            raise ModelError(f"body or frame '{name}': exists already; expected a "
                             'unique name')

    def _check_joint(self, name: str) -> None:
        if name in (body.joint.name for body in self._bodies):
            raise ModelError(f"joint '{name}': exists already; expected a unique name")


def _checked_turns(turns: str, count: int, what: str) -> str:
    """Return the first `count` rotation axes; ModelError if two in a row are equal."""
    if isinstance(turns, str) and count == 2:
        turns = turns[:2]  # the default has three
    valid = isinstance(turns, str) and len(turns) == count and set(turns) <= set('xyz')
    if not valid or any(a == b for a, b in pairwise(turns)):
        raise ModelError(f"{what}: turns '{turns}'; expected x, y or z for each "
                         'rotation, different from the previous one')
    return turns


def _check_properties(joint: str, properties: dict[str, Any],
                      single_names: Sequence[str] = (),
                      arguments: Sequence[str] = ()) -> None:
    """
    Raise ModelError for an unknown property, or for one of several joints at once.

    `arguments` are those of the call beside the properties, which may be meant too.
    """
    if properties and len(single_names) > 1:
        raise ModelError(f"joint '{joint}': {', '.join(properties)} of "
                         f'{len(single_names)} degrees of freedom; expected joint() for '
                         f'one of {", ".join(single_names)}')
    # A misspelled name is answered with the one that was meant.
    unknown = sorted(set(properties) - set(PROPERTIES))
    if unknown:
        meant = closest(unknown[0], (*arguments, *PROPERTIES))
        expected = meant or f'one of {", ".join(PROPERTIES)}'
        raise ModelError(f"joint '{joint}': no property '{unknown[0]}'; expected "
                         f'{expected}')
    limits = properties.get('limits')
    if limits is not None and not isinstance(limits, Limits):
        raise ModelError(f"joint '{joint}': limits: {limits!r}; expected Limits(lower, "
                         'upper, velocity, effort)')
    drive = properties.get('drive')
    if isinstance(drive, Drive):  # without the motor that it has in another model
        properties['drive'] = replace(drive, motor='')


def _check_inertial(on: str, inertial: Inertial) -> None:
    """Raise ModelError for what is no Inertial."""
    if not isinstance(inertial, Inertial):
        raise ModelError(f"'{on}': inertial properties: a {type(inertial).__name__}; "
                         'expected an Inertial (inertial=), such as of rod, disc, ball, '
                         'box, point_mass')


def _direction(axis: ArrayLike, what: str) -> Array:
    """Return a direction; raise ModelError for the zero vector."""
    vector = constant(axis, (3,), f'{what}: axis')
    if not vector.any():
        raise ModelError(f'{what}: axis {vector.tolist()}; expected a nonzero vector')
    return vector
