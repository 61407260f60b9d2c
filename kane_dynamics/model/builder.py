"""A `Model` built in a few lines of Python: bodies, joints, matter, frames."""

from dataclasses import replace
from typing import Any

from kane_dynamics._util.checks import constant
from kane_dynamics._util.text import listing
from kane_dynamics.errors import ModelError
from kane_dynamics.model.builder_checks import (check_moments, check_properties, checked_turns,
                                                direction, further, pose)
from kane_dynamics.model.flexible_link import AssumedModes, FlexibleLink
from kane_dynamics.model.joint_expansion import expand_joint, StatedJoint
from kane_dynamics.model.model import Body, Frame, GRAVITY, Inertial, Joint, Model, WORLD
from kane_dynamics.model.placement import Placement
import numpy as np
from numpy.typing import ArrayLike

KINDS = ('revolute', 'prismatic', 'universal', 'spherical', 'planar', 'floating')
ORIGIN = (0.0, 0.0, 0.0)
NOTHING = Inertial()


class ModelBuilder:
    """
    A mechanism in the making: add bodies outward from 'world', then take the `model`.

    Every body is a frame of the same name, and so are 'world' and what `frame` adds: places that
    bodies, matter and constraints are attached to by name.

    Parameters
    ----------
    name : str
    gravity : (3,) array
        m/s^2, world axes.

    Examples
    --------
    A pendulum on a cart that a spring holds:

    >>> b = ModelBuilder('cart')
    >>> b.body('cart', 'world', 'prismatic', axis=(1, 0, 0), matter=point_mass(2), stiffness=50)
    >>> b.body('rod', 'cart', 'revolute', axis=(0, 1, 0), matter=rod(1, (0, 0, 0), (0, 0, -0.5)))
    >>> robot = Robot(b.model())

    """

    def __init__(self, name: str = 'mechanism', *, gravity: ArrayLike = GRAVITY) -> None:
        """Start with the world alone."""
        self.name = name
        self.gravity = constant(gravity, (3,), 'gravity')
        self._bodies: list[Body] = []
        self._coordinates: list[str] = []
        self._places = {'world': Placement(WORLD)}
        self._base = NOTHING
        self._shapes: dict[str, tuple[AssumedModes, tuple[int, ...]]] = {}

    def body(self, name: str, on: str = 'world', kind: str = 'revolute', *,
             axis: ArrayLike = (0.0, 0.0, 1.0), at: ArrayLike = ORIGIN, rpy: ArrayLike = ORIGIN,
             matter: Inertial = NOTHING, joint: str | None = None, turns: str = 'xyz',
             **properties: Any) -> None:
        """
        Add a body and the joint that carries it.

        Parameters
        ----------
        name : str
            Of the body and of its frame.
        on : str
            The frame that carries the joint.
        kind : str
            revolute, prismatic; or of more freedoms, which become single ones named
            <joint>/x and so on: universal (two turns) and spherical (three), about the axes that
            `turns` lists; floating (/x, /y, /z, then three turns); planar (/x, /y in the plane
            across the axis, then /rz about it).
        axis : (3,) array
            Of a revolute, prismatic or planar joint, in the joint's axes.
        at, rpy : (3,) arrays
            Where the joint is in the carrier's axes: m, and roll, pitch, yaw about its fixed
            x, y, z, rad.
        matter : Inertial
            In the body's axes, which are the joint's at zero.
        joint : str, optional
            Name of the joint; the body's by default.
        turns : str
            Axes of successive turns, each about axes that the one before has turned.
        **properties
            Of a `Joint` of one freedom: limits, damping, friction, friction_speed,
            friction_offset, armature, stiffness, rest; for joints of more freedoms see `joint`.

        Raises
        ------
        ModelError
            A name is taken or unknown, or a value is not possible; names it.

        """
        joint = name if joint is None else joint
        what = f"joint '{joint}'"
        if kind not in KINDS:
            raise ModelError(f"{what}: kind is '{kind}'; valid: {', '.join(KINDS)}; what does not "
                             'move is a frame')
        turns = checked_turns(turns, 2 if kind == 'universal' else 3, what)
        R, p = pose(at, rpy, what)
        singles = expand_joint(StatedJoint(joint, kind, on, name, R, p, direction(axis, what),
                                           turns=turns), 0)
        if properties and len(singles) > 1:
            names = ', '.join(single.name for single in singles)
            raise ModelError(f"{what} has {len(singles)} freedoms: give {', '.join(properties)} "
                             f'by joint() to one of {names}')
        check_properties(joint, properties)
        check_moments(name, matter)
        place = self._place(on, what)
        self._check_new(name)
        for single in singles:
            self._check_joint(single.name)
        for single in singles:
            place = place.frame(single.rotation, single.translation)
            self._bodies.append(Body(single.child, place.body, Joint(
                single.name, 'prismatic' if single.kind == 'prismatic' else 'revolute',
                single.axis, place.rotation, place.translation, len(self._coordinates),
                **properties)))
            self._coordinates.append(single.name)
            place = Placement(len(self._bodies) - 1)
        self._places[name] = place
        self.load(name, matter)

    def beam(self, name: str, on: str, link: FlexibleLink, kind: str = 'revolute',
             **options: Any) -> None:
        """
        Add a body that bends, and the joint that carries it.

        Frame `name` is its root's; `name/tip` moves and turns with the other end, `section` adds
        frames between. Modal coordinates are called `name/mode_1`, `name/twist_1` and so on.

        Parameters
        ----------
        name : str
            Of the body.
        on : str
            The frame that carries the joint.
        link : FlexibleLink
            The beam; `matter` adds what its root carries.
        kind, **options
            As for `body`, whose errors are also this one's.

        """
        shape = link.checked(name)
        matter = options.pop('matter', NOTHING)
        self.body(name, on, kind, matter=matter + shape.inertial, **options)
        first = len(self._coordinates)
        coordinates = tuple(range(first, first + shape.count))
        self._coordinates += shape.names
        self._shapes[name] = shape, coordinates
        if shape.count:
            body = self._places[name].body
            self._bodies[body] = replace(self._bodies[body], beam=shape.beam(coordinates))
        self.section(f'{name}/tip', name, shape.length)

    def section(self, name: str, of: str, at: float) -> None:
        """
        Add a frame that moves and turns with a section of a beam.

        Parameters
        ----------
        name : str
            Of the frame.
        of : str
            The beam.
        at : float
            How far from its root, m; ModelError if it is not on the beam.

        """
        if of not in self._shapes:
            raise ModelError(f"no beam '{of}'; valid: {listing(list(self._shapes))}")
        shape, coordinates = self._shapes[of]
        if not 0.0 < at <= shape.length:
            raise ModelError(f"frame '{name}': {at} m is not on beam '{of}', which is "
                             f'{shape.length:g} m long')
        self._check_new(name)
        place = self._places[of].frame(np.eye(3), at * shape.axes[0])
        if coordinates:
            for part, moves, axis, deflection in shape.deflections(at, coordinates):
                self._bodies.append(Body(f'{name}/{part}', place.body, Joint(
                    f'{name}/{part}', moves, axis, place.rotation, place.translation,
                    coordinates[0], deflection=deflection)))
                place = Placement(len(self._bodies) - 1)
        self._places[name] = place

    def joint(self, name: str, **properties: Any) -> None:
        """
        Set properties of a joint that exists: limits, damping, stiffness and so on.

        Parameters
        ----------
        name : str
            A joint of one freedom, such as 'base/rx' of a floating one.
        **properties
            As for `body`.

        """
        names = [body.joint.name for body in self._bodies]
        if name not in names:
            raise ModelError(f"no joint '{name}'; valid: {listing(names)}")
        check_properties(name, properties)
        body = self._bodies[k := names.index(name)]
        self._bodies[k] = replace(body, joint=replace(body.joint, **properties))

    def load(self, on: str, matter: Inertial) -> None:
        """
        Attach more matter, given in the axes of a frame.

        Raises
        ------
        ModelError
            No such frame, or no matter has these moments of inertia; names the frame.

        """
        place = self._place(on, 'load')
        check_moments(on, matter)
        moved = matter.moved(place.rotation, place.translation)
        if place.body == WORLD:
            self._base = self._base + moved
        else:
            body = self._bodies[place.body]
            self._bodies[place.body] = replace(body, inertial=body.inertial + moved)

    def frame(self, name: str, on: str, *, at: ArrayLike = ORIGIN,
              rpy: ArrayLike = ORIGIN) -> None:
        """Add a frame fixed on another, at a point, m, and roll, pitch, yaw, rad."""
        self._check_new(name)
        self._places[name] = self._place(on, f"frame '{name}'").frame(
            *pose(at, rpy, f"frame '{name}'"))

    def mount(self, model: Model, on: str, *, at: ArrayLike = ORIGIN, rpy: ArrayLike = ORIGIN,
              prefix: str = '') -> None:
        """
        Attach a whole model, such as an arm that `load_urdf` returned.

        Parameters
        ----------
        model : Model
            Its gravity is left aside; its frames can carry further bodies.
        on : str
            Frame that carries its base.
        at, rpy : (3,) arrays
            Where its base is in the carrier's axes, m and rad.
        prefix : str
            Put before every name of its bodies, joints and frames.

        Raises
        ------
        ModelError
            A name is taken; choose a prefix.

        """
        base = self._place(on, f"model '{model.name}'").frame(*pose(at, rpy, 'mount'))
        names = {prefix + frame.name for frame in model.frames} | {prefix + model.base_name}
        for name in sorted(names):
            self._check_new(name)
        for body in model.bodies:
            self._check_joint(prefix + body.joint.name)
        first, joints = len(self._bodies), len(self._coordinates)
        for body in model.bodies:
            joint = replace(body.joint, name=prefix + body.joint.name,
                            coordinate=joints + body.joint.coordinate,
                            deflection=further(body.joint.deflection, joints))
            parent = first + body.parent
            if body.parent == WORLD:
                place = base.frame(joint.rotation, joint.translation)
                parent = place.body
                joint = replace(joint, rotation=place.rotation, translation=place.translation)
            self._bodies.append(Body(prefix + body.name, parent, joint, body.inertial,
                                     further(body.beam, joints)))
        self._coordinates += [prefix + name for name in model.coordinate_names]
        self._places[prefix + model.base_name] = base
        for frame in model.frames:
            start = base if frame.body == WORLD else Placement(first + frame.body)
            self._places[prefix + frame.name] = start.frame(frame.rotation, frame.translation)
        self.load(prefix + model.base_name, model.base_inertial)

    def model(self) -> Model:
        """Return what has been built; ModelError while nothing in it moves."""
        if not self._bodies:
            raise ModelError(f"mechanism '{self.name}' has no body; add one with body()")
        frames = [Frame(name, place.body, place.rotation, place.translation)
                  for name, place in self._places.items()]
        return Model(self.name, tuple(self._bodies), tuple(self._coordinates), tuple(frames),
                     self.gravity, 'world', self._base)

    def _place(self, on: str, what: str) -> Placement:
        if on not in self._places:
            raise ModelError(f"{what}: no body or frame '{on}'; valid: {listing(self._places)}")
        return self._places[on]

    def _check_new(self, name: str) -> None:
        if name in self._places:
            raise ModelError(f"body or frame '{name}' exists; names must be unique")

    def _check_joint(self, name: str) -> None:
        if name in (body.joint.name for body in self._bodies):
            raise ModelError(f"joint '{name}' exists; names must be unique")
