"""Build a `Model` in Python: bodies, joints, inertias, frames."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from kane_dynamics._util.attribute_hints import guarded
from kane_dynamics._util.checks import constant, instance
from kane_dynamics._util.text import listing
from kane_dynamics.errors import ModelError
from kane_dynamics.model.builder_checks import (check_ball_property, check_inertial,
                                                check_moments, check_properties, checked_turns,
                                                direction, pose)
from kane_dynamics.model.flexible_link import AssumedModes, FlexibleLink
from kane_dynamics.model.joint_expansion import expand_joint, StatedJoint
from kane_dynamics.model.model import Body, GRAVITY, Inertial, Joint, Model
from kane_dynamics.model.model_assembly import ModelAssembly, NOTHING, ORIGIN
from kane_dynamics.model.placement import Placement
import numpy as np
from numpy.typing import ArrayLike

KINDS = ('revolute', 'prismatic', 'universal', 'spherical', 'ball', 'planar', 'floating', 'free',
         'fixed')


@guarded
class ModelBuilder(ModelAssembly):
    """
    Builder of mechanisms: add bodies outward from 'world', then call `model`.

    Bodies, inertias and constraints are attached to frames by name. 'world' is a frame, every body
    is a frame of the same name, and `frame` adds further ones.

    Parameters
    ----------
    name : str
    gravity : (3,) array
        m/s^2, world axes.
    strict : bool
        Raise an error for moments of inertia that no rigid body can have. If False, they are
        accepted, and `model` warns about them.

    Examples
    --------
    A pendulum on a cart with a spring:

    >>> b = ModelBuilder('cart')
    >>> b.body('cart', 'world', 'prismatic', axis=(1, 0, 0), inertial=point_mass(2), stiffness=50)
    >>> b.body('rod', 'cart', 'revolute', axis=(0, 1, 0), inertial=rod(1, (0, 0, 0), (0, 0, -0.5)))
    >>> robot = Robot(b.model())

    """

    def __init__(self, name: str = 'mechanism', *, gravity: ArrayLike = GRAVITY,
                 strict: bool = True) -> None:
        """Create a mechanism without bodies."""
        super().__init__(name, constant(gravity, (3,), 'gravity'), strict)
        self._shapes: dict[str, tuple[AssumedModes, tuple[int, ...]]] = {}

    @classmethod
    def from_model(cls, model: Model, *, strict: bool = True) -> ModelBuilder:
        """
        Return a builder that goes on from a model, such as one of `load_urdf`.

        Its frames and bodies carry further ones, by name; the world is called `model.base_name`.

        Parameters
        ----------
        model : Model
            With bodies, joints and frames of any kind.
        strict : bool
            As of the class, for what is added.

        """
        instance(model, Model, 'model')
        builder = cls(model.name, gravity=model.gravity, strict=strict)
        builder._continue(model)
        return builder

    def body(self, name: str, on: str = 'world', kind: str = 'revolute', *,
             axis: ArrayLike = (0.0, 0.0, 1.0), at: ArrayLike = ORIGIN, rpy: ArrayLike = ORIGIN,
             quaternion: ArrayLike | None = None,
             inertial: Inertial = NOTHING, joint: str | None = None, turns: str = 'xyz',
             mimic: str | None = None, multiplier: float = 1.0, offset: float = 0.0,
             **properties: Any) -> None:
        """
        Add a body and its joint.

        Parameters
        ----------
        name : str
            Name of the body and of its frame.
        on : str
            The frame to which the joint is attached.
        kind : str
            revolute, prismatic; or a joint with more degrees of freedom, which is expanded to
            joints <joint>/x and so on: universal (two rotations) and spherical (three), about
            the axes in `turns`; floating (/x, /y, /z, then three rotations); planar (/x, /y in
            the plane normal to the axis, then /rz about it); or fixed, part of its carrier. ball
            rotates by a unit quaternion, with the angular velocity /wx, /wy, /wz on the body's
            axes as speeds; free is /x, /y, /z, then a ball: no singular configuration.
        axis : (3,) array
            Axis of a revolute, prismatic or planar joint, in the joint's axes.
        at, rpy : (3,) arrays
            Pose of the joint in frame `on`: m, and roll, pitch, yaw about its fixed x, y, z, rad.
        quaternion : (4,) array, optional
            Orientation as x, y, z, w, instead of `rpy`.
        inertial : Inertial
            Inertia of the body in its axes, which are those of the joint at position 0.
        joint : str, optional
            Name of the joint. Default: that of the body.
        turns : str
            Axes of successive rotations, each rotated by the previous ones.
        mimic : str, optional
            A joint of one degree of freedom that this one follows: its position is `multiplier`
            times that joint's position + `offset`. It has no entry in q; its limits of position
            and velocity bound those of that joint too, its limit of effort does not count.
        multiplier, offset : float
            Of a joint that mimics another; offset in rad or m.
        **properties
            Properties of a joint of one degree of freedom: limits, damping, friction,
            friction_speed, friction_offset, armature, stiffness, rest. For other joints, see
            `joint`.

        Raises
        ------
        ModelError
            If a name exists already or is unknown, or a value is invalid; the message names it.

        """
        joint = name if joint is None else joint
        what = f"joint '{joint}'"
        if kind not in KINDS:
            raise ModelError(f"{what}: kind '{kind}'; expected one of {', '.join(KINDS)}")
        turns = checked_turns(turns, 2 if kind == 'universal' else 3, what)
        R, p = pose(at, rpy, what, quaternion)
        singles = expand_joint(StatedJoint(joint, kind, on, name, R, p, direction(axis, what),
                                           turns=turns))
        if properties and len(singles) > 1:
            names = ', '.join(single.name for single in singles)
            raise ModelError(f"{what}: {', '.join(properties)} of {len(singles)} degrees of "
                             f'freedom; expected joint() for one of {names}')
        check_properties(joint, properties)
        placement = self._placement(on, what)
        self._check_new(name)
        check_inertial(name, inertial)  # before anything is added
        if self.strict:
            check_moments(name, inertial)
        mimic_fields = self._mimic_fields(what, kind, mimic, multiplier, offset)
        if kind == 'fixed':
            if properties:
                raise ModelError(f'{what}: {", ".join(properties)} of a fixed joint; expected no '
                                 'property, since it does not move')
            self._placements[name] = placement.frame(R, p)
            self.load(name, inertial)
            return
        for single in singles:
            self._check_joint(single.name)
        if kind in ('ball', 'free'):
            self._balls.append(len(self._bodies) + len(singles) - 3)
        for single in singles:
            placement = placement.frame(single.rotation, single.translation)
            self._bodies.append(Body(single.child, placement.body, Joint(
                single.name, 'prismatic' if single.kind == 'prismatic' else 'revolute',
                single.axis, placement.rotation, placement.translation,
                **{'coordinate': len(self._coordinates), **mimic_fields, **properties})))
            if not mimic_fields:
                self._coordinates.append(single.name)
            placement = Placement(len(self._bodies) - 1)
        self._placements[name] = placement
        self.load(name, inertial)

    def beam(self, name: str, on: str, link: FlexibleLink, kind: str = 'revolute',
             **options: Any) -> None:
        """
        Add a flexible body (beam) and its joint.

        Frame `name` is at the root and `name/tip` at the other end; `section` adds frames between
        them. Modal coordinates are called `name/mode_1`, `name/twist_1` and so on.

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
        shape = link.checked(name)
        inertial = options.pop('inertial', NOTHING)
        first = len(self._coordinates)
        if kind == 'fixed' and shape.count:
            self._clamp(name, on, first, **options)
            self.load(name, inertial + shape.inertial)
        else:
            self.body(name, on, kind, inertial=inertial + shape.inertial, **options)
            first = len(self._coordinates)
        coordinates = tuple(range(first, first + shape.count))
        self._coordinates += shape.names
        self._shapes[name] = shape, coordinates
        if shape.count:
            body = self._placements[name].body
            self._bodies[body] = replace(self._bodies[body], beam=shape.beam(coordinates))
        self.section(f'{name}/tip', name, shape.length)

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
        if of not in self._shapes:
            raise ModelError(f"no beam '{of}'; expected one of {listing(list(self._shapes))}")
        shape, coordinates = self._shapes[of]
        if not 0.0 < at <= shape.length:
            raise ModelError(f"frame '{name}': {at} m on beam '{of}'; expected 0 to "
                             f'{shape.length:g} m')
        self._check_new(name)
        placement = self._placements[of].frame(np.eye(3), at * shape.axes[0])
        if coordinates:
            for part, moves, axis, deflection in shape.deflections(at, coordinates):
                self._bodies.append(Body(f'{name}/{part}', placement.body, Joint(
                    f'{name}/{part}', moves, axis, placement.rotation, placement.translation,
                    coordinates[0], deflection=deflection)))
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
        check_properties(name, properties)
        body = self._bodies[k := names.index(name)]
        if any(first <= k < first + 3 for first in self._balls):
            check_ball_property(name, properties)
        self._bodies[k] = replace(body, joint=replace(body.joint, **properties))

    def _clamp(self, name: str, on: str, coordinate: int, **options: Any) -> None:
        """Add a body clamped to its parent, by a joint with multiplier 0."""
        self.body(name, on, 'fixed', **options)
        joint = options.get('joint') or name
        self._check_joint(joint)
        placement = self._placements[name]
        self._bodies.append(Body(name, placement.body, Joint(
            joint, 'revolute', np.array([0.0, 0.0, 1.0]), placement.rotation,
            placement.translation, coordinate, multiplier=0.0)))
        self._placements[name] = Placement(len(self._bodies) - 1)

    def _mimic_fields(self, what: str, kind: str, mimic: str | None, multiplier: float,
                      offset: float) -> dict[str, Any]:
        """Return coordinate, multiplier and offset of a mimic joint; empty for other joints."""
        if mimic is None:
            if (multiplier, offset) != (1.0, 0.0):
                raise ModelError(f'{what}: multiplier {multiplier}, offset {offset} without '
                                 'mimic; expected the joint that it follows')
            return {}
        if kind not in ('revolute', 'prismatic'):
            raise ModelError(f'{what}: a {kind} joint mimics {mimic!r}; expected kind revolute or '
                             'prismatic')
        masters = {body.joint.name: body.joint for k, body in enumerate(self._bodies)
                   if body.joint.deflection is None and body.joint.multiplier
                   and not any(first <= k < first + 3 for first in self._balls)}
        if mimic not in masters:
            raise ModelError(f'{what}: mimic: {mimic!r}; expected one of {listing(masters)}')
        ratio, shift = (float(constant(value, (), f'{what}: {word}')) for value, word in (
            (multiplier, 'multiplier'), (offset, 'offset')))
        if not ratio:
            raise ModelError(f'{what}: multiplier: 0; expected another number')
        master = masters[mimic]
        return {'coordinate': master.coordinate, 'multiplier': ratio * master.multiplier,
                'offset': ratio * master.offset + shift}
