"""
Mechanism as data: a tree of bodies with joints, inertial properties and frames.

A `Model` is immutable. Every joint has one degree of freedom: joints with more
(floating, planar) are expanded, joints with none (fixed, locked) are merged when a model
is created. Bodies are in topological order, parents first, so that one pass over them is
an outward recursion. A ball joint is three bodies whose joints share a quaternion in q.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
import hashlib
import math
from typing import Literal

from kane_dynamics._util.checks import constant
from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.frozen import freeze, plain_record
from kane_dynamics._util.notebook import html_table
from kane_dynamics._util.text import SHORT, short
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError, ModelError
from kane_dynamics.model.ball_coordinates import check_balls, places
from kane_dynamics.model.beam import Beam, Deflection
from kane_dynamics.model.drive import Drive, ElasticJoint
from kane_dynamics.model.inertial import Inertial
import numpy as np

__all__ = ['Array',
           'Body', 'Frame', 'GRAVITY', 'Inertial', 'Joint', 'Limits', 'Model', 'WORLD',
           'constant', 'freeze', 'with_payload']

GRAVITY = (0.0, 0.0, -9.81)
ROUNDING = 1e-9  # relative tolerance for equal bounds of a mimic joint and its master
# The fields of `Joint` of its friction law, but for the speed of its smoothing.
FRICTION = ('damping', 'fast_damping', 'damping_speed', 'friction', 'friction_backward',
            'breakaway_friction', 'stribeck_speed', 'load_friction',
            'load_friction_backdriven', 'friction_offset', 'presliding_stiffness',
            'presliding_damping')
POSITIVE = ('friction_speed', 'damping_speed')
NONNEGATIVE = ('damping', 'fast_damping', 'friction', 'friction_backward',
               'breakaway_friction', 'stribeck_speed', 'load_friction',
               'load_friction_backdriven', *POSITIVE, 'presliding_stiffness',
               'presliding_damping', 'armature', 'stiffness')
WORLD = -1  # parent index of a body, or body index of a frame, fixed in the world


@dataclass(frozen=True)
class Limits:
    """Limits of a joint: position (rad, m), velocity (rad/s, m/s), effort (N m, N)."""

    lower: float = -math.inf
    upper: float = math.inf
    velocity: float = math.inf
    effort: float = math.inf

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ('lower', 'upper', 'velocity', 'effort'):
            value = getattr(self, name)
            is_number = isinstance(value, int | float | np.integer | np.floating)
            least = -math.inf if name in ('lower', 'upper') else 0.0
            if not is_number or not value >= least:  # NaN passes no comparison
                expected = 'a number' if least else 'a number >= 0'
                raise ModelError(f'limits: {name}: {value!r}; expected {expected}')
        if self.lower > self.upper:
            raise ModelError(f'limits: lower {self.lower:g}, upper {self.upper:g}; '
                             'expected lower <= upper')

    def with_follower(self, other: Limits, multiplier: float,
                      offset: float) -> Limits | None:
        """
        Return these limits narrowed by the limits of a joint that mimics this one.

        The other joint is at multiplier times this one's position plus offset. Its
        effort limit does not count: the torque is this joint's. None if no position
        satisfies both limits.
        """
        # Bounds of the follower in positions of this joint; a negative multiplier swaps
        # them.
        bounds = ((other.lower - offset) / multiplier,
                  (other.upper - offset) / multiplier)
        lower = -_least(-self.lower, -min(bounds))
        upper = _least(self.upper, max(bounds))
        velocity = _least(self.velocity, other.velocity / abs(multiplier))
        if lower >= upper:
            return None
        return Limits(lower, upper, velocity, self.effort)


def _least(bound: float, other: float) -> float:
    """Return the lower of two upper bounds; the first if they differ by rounding."""
    if math.isclose(bound, other, rel_tol=ROUNDING):
        return bound
    return min(bound, other)


@dataclass(frozen=True, eq=False)
class Joint:
    """
    Joint of one degree of freedom between a body and its parent.

    Its position is ``multiplier * q[coordinate] + offset``. A mimic joint shares the
    coordinate of its master; other joints have multiplier 1 and offset 0.

    Parameters
    ----------
    name : str
    kind : 'revolute' or 'prismatic'
    axis : (3,) array
        Direction in the joint's (and the body's) frame; it is normalized.
    rotation, translation : (3, 3), (3,) arrays
        Pose of the joint frame in the parent body's frame at position 0 (columns are the
        joint frame's axes), m.
    coordinate : int
        Index into u and tau, and into q of a model without ball joints (`Model.places`).
    multiplier, offset : float
    limits : Limits
    damping : float
        Viscous friction, N m s/rad or N s/m: friction over rate near standstill.
    fast_damping : float, optional
        Viscous friction over rate at rates far above `damping_speed`. Below `damping`,
        friction flattens as of lubricated gears; above, it grows faster than the rate.
        Default: `damping`.
    damping_speed : float
        Rate at which viscous friction over rate is the mean of both, rad/s or m/s,
        positive.
    friction : float
        Coulomb friction at positive rates, N m or N, smoothed as ``friction *
        tanh(rate / friction_speed)``.
    friction_backward : float, optional
        Coulomb friction at negative rates, N m or N. Default: `friction`.
    breakaway_friction : float, optional
        Friction of a joint at rest, N m or N, at least `friction`; at negative rates it
        exceeds Coulomb friction by as much. Default: as Coulomb friction.
    stribeck_speed : float
        Rate, rad/s or m/s, at which friction has fallen from breakaway friction to
        Coulomb friction and 1/e of the difference; 0 if it falls at once. Then the
        smooth law has no breakaway friction.
    load_friction : float
        Friction per unit of load, as a fraction: the load is the motor's torque less
        friction (`mechanics.friction`). It acts where the motor drives the load.
    load_friction_backdriven : float, optional
        As `load_friction`, where the load drives the motor; 1 or more for a
        self-locking drive. Default: `load_friction`.
    friction_speed : float
        rad/s or m/s, positive.
    friction_offset : float
        Constant torque added to friction, N m or N, such as the offset of a torque
        sensor.
    presliding_stiffness : float
        Stiffness of the contact before it slides, N m/rad or N/m: in `simulate`, friction
        then has a state of its own, the deflection of bristles. 0: none.
    presliding_damping : float
        Of the deflection's rate, N m s/rad or N s/m (LuGre); 0 in Dahl's law.
    armature : float
        Rotor inertia reflected through the gear, kg m^2 or kg.
    stiffness, rest : float
        Stiffness and rest position of a joint spring, N m/rad or N/m; rad or m.
    deflection : Deflection, optional
        For a section of a bending beam: the joint's position is `offset` plus this
        function of the modal coordinates.
    drive : Drive, optional
        Of an elastic joint, between this joint and that of its motor: `with_drives`.

    Raises
    ------
    ModelError
        If a value is invalid; the message names the joint and the value.

    """

    name: str
    kind: Literal['revolute', 'prismatic']
    axis: Array
    rotation: Array = field(default_factory=lambda: np.eye(3))
    translation: Array = field(default_factory=lambda: np.zeros(3))
    coordinate: int = 0
    multiplier: float = 1.0
    offset: float = 0.0
    limits: Limits = Limits()
    damping: float = 0.0
    fast_damping: float | None = None
    damping_speed: float = 1.0
    friction: float = 0.0
    friction_backward: float | None = None
    breakaway_friction: float | None = None
    stribeck_speed: float = 0.0
    load_friction: float = 0.0
    load_friction_backdriven: float | None = None
    friction_speed: float = 0.05
    friction_offset: float = 0.0
    presliding_stiffness: float = 0.0
    presliding_damping: float = 0.0
    armature: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    deflection: Deflection | None = None
    drive: Drive | None = None

    def __post_init__(self) -> None:
        """Check the numbers and make them read-only."""
        # Checks in the order of the fields; numbers become arrays that cannot be
        # written.
        what = f"joint '{self.name}'"
        if self.kind not in ('revolute', 'prismatic'):
            raise ModelError(f"{what}: kind '{self.kind}'; expected revolute or "
                             'prismatic')
        axis = constant(self.axis, (3,), f'{what}: axis')
        length = math.hypot(*axis)  # does not overflow
        if length < 1e-12:
            raise ModelError(f'{what}: axis {axis.tolist()}; expected a nonzero vector')
        if abs(length - 1.0) > 1e-15:  # a unit vector keeps its digits
            axis = constant(axis / length, (3,), f'{what}: axis')
        freeze(self, 'axis', axis)
        freeze(self, 'rotation', _checked_rotation(self.rotation, what))
        freeze(self, 'translation',
                     constant(self.translation, (3,), f'{what}: translation'))
        for name in ('multiplier', 'offset', 'rest', 'friction_offset'):
            freeze(self, name, float(constant(getattr(self, name), (), f'{what}: '
                                                                       f'{name}')))
        for name in NONNEGATIVE:
            stated = getattr(self, name)
            if stated is None:  # as the quantity in the other direction
                continue
            value = float(constant(stated, (), f'{what}: {name}'))
            if value < 0.0:
                raise ModelError(f'{what}: {name} {value}; expected a nonnegative '
                                 'number')
            if name in POSITIVE and value == 0.0:
                raise ModelError(f'{what}: {name} 0; expected a positive number')
            freeze(self, name, value)
        if self.drive is not None and not isinstance(self.drive, Drive):
            raise ModelError(f'{what}: drive: {SHORT.repr(self.drive)}; expected a Drive')
        breakaway = self.breakaway_friction
        if breakaway is not None and breakaway < self.friction:
            raise ModelError(f'{what}: breakaway_friction {breakaway}; expected at least '
                             f'the friction, {self.friction}')
        self._require_presliding_law(what)

    def _require_presliding_law(self, what: str) -> None:
        """Raise ModelError for bristles without a friction at which they slide."""
        if not self.presliding_stiffness:
            if self.presliding_damping:
                raise ModelError(f'{what}: presliding_damping {self.presliding_damping} '
                                 'without presliding_stiffness; expected both')
            return
        for name in ('friction', 'friction_backward'):
            if getattr(self, name) == 0.0:
                raise ModelError(f'{what}: presliding_stiffness '
                                 f'{self.presliding_stiffness} and {name} 0; expected a '
                                 'positive friction, at which the deflection ends')

    def __repr__(self) -> str:
        """Return kind, axis and what differs from a free, ideal joint, on one line."""
        preposition = 'about' if self.kind == 'revolute' else 'along'
        words = [f'{self.kind} {preposition} {self.axis.round(6).tolist()}']
        if self.limits != Limits():
            words.append(f'{self.limits.lower:.6g} to {self.limits.upper:.6g}')
        # Only numbers that differ from those of an ideal joint.
        defaults = {parameter.name: parameter.default for parameter in fields(self)}
        for name in (*FRICTION, 'armature', 'stiffness'):
            if getattr(self, name) != defaults[name]:
                words.append(f'{name} {getattr(self, name):.6g}')
        if self.drive is not None:
            words.append(f"driven by '{self.drive.motor}'")
        return f"<Joint '{self.name}': {', '.join(words)}>"


@dataclass(frozen=True, eq=False)
class Body:
    """Body: name, index of its parent (WORLD: -1), joint, inertial and beam."""

    name: str
    parent: int
    joint: Joint
    inertial: Inertial = field(default_factory=Inertial)
    beam: Beam | None = None

    def __repr__(self) -> str:
        """Return name, joint, parent and mass on one line."""
        carrier = 'the base' if self.parent == WORLD else f'body {self.parent}'
        bends = ', a beam' if self.beam is not None else ''
        return (f"<Body '{self.name}': {self.inertial.mass:.6g} kg{bends}, "
                f"{self.joint.kind} joint '{self.joint.name}' on {carrier}>")


@dataclass(frozen=True, eq=False)
class Frame:
    """Named frame with pose (rotation, translation) on body `body` (or WORLD)."""

    name: str
    body: int
    rotation: Array = field(default_factory=lambda: np.eye(3))
    translation: Array = field(default_factory=lambda: np.zeros(3))

    def __repr__(self) -> str:
        """Return name and place on one line."""
        carrier = 'the base' if self.body == WORLD else f'body {self.body}'
        turned = '' if np.array_equal(self.rotation, np.eye(3)) else ', rotated'
        return (f"<Frame '{self.name}': at {self.translation.round(6).tolist()} m of "
                f'{carrier}{turned}>')


@dataclass(frozen=True, eq=False)
class Model:
    """
    Kinematic tree of rigid bodies and beams on a fixed base.

    Parameters
    ----------
    name : str
    bodies : tuple of Body
        The moving bodies, parents before children.
    coordinate_names : tuple of str
        Names of the entries of q, in order: free joints and modes of beams; four for a
        ball joint.
    frames : tuple of Frame
        All named frames; each link of a URDF is one.
    gravity : (3,) array
        m/s^2, world axes.
    base_name : str
    base_inertial : Inertial
        Inertial of the fixed root link, which does not affect the dynamics.
    balls : tuple of int
        The first of the three bodies of every ball joint, in the order of q. Their
        joints are revolute about x, y and z with one origin. q holds the quaternion (x,
        y, z, w) of the third body in the joint's frame, u its relative angular velocity
        on its own axes.

    Raises
    ------
    ModelError
        If the bodies do not form a tree in topological order, or names are not unique.

    """

    name: str
    bodies: tuple[Body, ...]
    coordinate_names: tuple[str, ...]
    frames: tuple[Frame, ...] = ()
    gravity: Array = field(default_factory=lambda: np.array(GRAVITY))
    base_name: str = 'world'
    base_inertial: Inertial = field(default_factory=Inertial)
    balls: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        """Check the consistency of bodies, joints, coordinates and frames."""
        for name in ('bodies', 'coordinate_names', 'frames', 'balls'):
            freeze(self, name, tuple(getattr(self, name)))
        freeze(self, 'frames', tuple(map(self._checked_frame, self.frames)))
        freeze(self, 'gravity', constant(self.gravity, (3,), 'gravity'))

        # The topology first: all else relies on parents that come before children.
        self._check_topology()
        check_balls(self.bodies, self.balls)
        self._check_coordinates()
        self._check_load_friction()
        self._check_motors()
        _check_unique('body', [body.name for body in self.bodies])
        _check_unique('joint', [body.joint.name for body in self.bodies])
        _check_unique('coordinate', self.coordinate_names)
        _check_unique('frame', [frame.name for frame in self.frames])

    def _checked_frame(self, frame: Frame) -> Frame:
        """Return a frame with read-only arrays; raise ModelError for a wrong one."""
        what = f"frame '{frame.name}'"
        bodies = len(self.bodies)
        is_index = isinstance(frame.body, int | np.integer)
        if not is_index or not WORLD <= frame.body < bodies:
            raise ModelError(f'{what}: body {frame.body!r}; expected the index of one of '
                             f'{bodies} bodies, or {WORLD} for the base')
        rotation = _checked_rotation(frame.rotation, what)
        translation = constant(frame.translation, (3,), f'{what}: translation')
        return replace(frame, rotation=rotation, translation=translation)

    def _check_topology(self) -> None:
        """Raise ModelError unless parents and coordinates of all bodies exist."""
        n = self.n
        # Parents before children, so that one pass outward reaches every body.
        for i, body in enumerate(self.bodies):
            if not WORLD <= body.parent < i:
                raise ModelError(f"body '{body.name}': index {i} with parent "
                                 f'{body.parent}; expected parents before children')
            if not 0 <= body.joint.coordinate < n:
                raise ModelError(f"joint '{body.joint.name}': coordinate "
                                 f'{body.joint.coordinate}; expected 0 to {n - 1}')

    def _check_coordinates(self) -> None:
        """Raise ModelError for a coordinate that moves neither a joint nor a mode."""
        used = {body.joint.coordinate for body in self.bodies}
        used.update(self.modal_coordinates)
        for k, name in enumerate(self.joint_names):
            if k not in used:
                raise ModelError(f"coordinate '{name}': moves no joint; expected at "
                                 'least one')

    def _check_motors(self) -> None:
        """Raise ModelError for a drive without the joint of its motor."""
        names = set(self.joint_names)
        for body in self.bodies:
            joint = body.joint
            if joint.drive is not None and joint.drive.motor not in names:
                raise ModelError(f"joint '{joint.name}': a drive with the motor joint "
                                 f"'{joint.drive.motor}', which the model lacks; "
                                 'expected with_drives to add drive and motor')

    def _check_load_friction(self) -> None:
        """Raise ModelError for load friction of a joint that has no drive of its own."""
        # Names of joints that have a coordinate of their own.
        names = set(self.joint_names)
        for body in self.bodies:
            joint = body.joint
            loaded = joint.load_friction or joint.load_friction_backdriven
            if loaded and joint.name not in names:
                raise ModelError(f"joint '{joint.name}': load friction {loaded:g} of a "
                                 'joint that mimics another; expected it at the joint '
                                 'with the drive')

    @property
    def n(self) -> int:
        """Return the number of degrees of freedom: entries of q, less one per ball."""
        return len(self.coordinate_names) - len(self.balls)

    @lazy_property
    def places(self) -> tuple[int | None, ...]:
        """Return the index in q of each degree of freedom; None for ball joints."""
        return places(self.n, [self.bodies[b].joint.coordinate for b in self.balls])

    @lazy_property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the free joints, in the order of u and tau (and q without balls)."""
        # Parts of a ball joint have no entry of q that would name them.
        names_of_ball_parts = {}
        for first in self.balls:
            for body in self.bodies[first:first + 3]:
                names_of_ball_parts[body.joint.coordinate] = body.joint.name
        names = []
        for freedom, place in enumerate(self.places):
            if place is None:
                names.append(names_of_ball_parts[freedom])
            else:
                names.append(self.coordinate_names[place])
        return tuple(names)

    @lazy_property
    def coordinate_joints(self) -> tuple[Joint, ...]:
        """Joints of the entries of u, never mimic joints; a mode has no limits."""
        names = self.joint_names
        by_name = {body.joint.name: body.joint for body in self.bodies}
        # Modes move no joint of a body: a record of their own, along the beam.
        for body in self.bodies:
            if body.beam is None:
                continue
            for k in body.beam.coordinates:
                mode = Joint(names[k], 'prismatic', body.beam.direction, coordinate=k)
                by_name[names[k]] = mode
        return tuple(by_name[name] for name in names)

    @lazy_property
    def drives(self) -> tuple[ElasticJoint, ...]:
        """Elastic joints with their drives, and the indices of link and motor in u."""
        coordinates = {body.joint.name: body.joint.coordinate for body in self.bodies}
        elastic = []
        for body in self.bodies:
            joint = body.joint
            if joint.drive is not None:
                # The motor is a joint of its own, named by the drive.
                motor = coordinates[joint.drive.motor]
                elastic.append(ElasticJoint(joint.name, joint.drive, joint.coordinate,
                                            motor))
        return tuple(elastic)

    @lazy_property
    def modal_coordinates(self) -> tuple[int, ...]:
        """Return the indices in q of the modal coordinates of beams."""
        indices: list[int] = []
        for body in self.bodies:
            if body.beam is not None:
                indices += body.beam.coordinates
        return tuple(indices)

    @lazy_property
    def sliding(self) -> frozenset[str]:
        """Names of the coordinates that are lengths, with units m and N."""
        named_joints = zip(self.joint_names, self.coordinate_joints)
        return frozenset(name for name, joint in named_joints
                         if joint.kind == 'prismatic')

    @property
    def floating_base(self) -> tuple[str, ...]:
        """Return the six joints of a free or floating base on the world, if any."""
        if len(self.bodies) < 6:
            return ()
        # The six come from one joint of the file, whose name they share.
        stated_name = self.bodies[0].joint.name.rpartition('/')[0]
        kinds = 3 * ['prismatic'] + 3 * ['revolute']
        names = []
        for index, (body, kind) in enumerate(zip(self.bodies, kinds)):
            joint = body.joint
            follows = body.parent == index - 1  # the first on the world, which is -1
            is_part = bool(stated_name) and joint.name.startswith(f'{stated_name}/')
            if not (follows and is_part and joint.kind == kind):
                return ()
            names.append(joint.name)
        return tuple(names)

    @property
    def flexible(self) -> bool:
        """Return whether any body is a beam."""
        return any(body.beam is not None for body in self.bodies)

    def __repr__(self) -> str:
        """Return name, size and joints on one line."""
        return (f"<Model '{self.name}': {len(self.bodies)} moving bodies on "
                f"'{self.base_name}', q of {short(self.coordinate_names)}>")

    def _repr_html_(self) -> str:
        """Return joints, limits and masses as a table for notebooks."""
        rows = []
        for body in self.bodies:
            # The name of the body that carries the joint, or of the base.
            carrier = self.base_name
            if body.parent != WORLD:
                carrier = self.bodies[body.parent].name
            limits = body.joint.limits
            rows.append([body.joint.name, body.joint.kind, carrier, body.name,
                         body.inertial.mass, limits.lower, limits.upper, limits.velocity,
                         limits.effort])
        return html_table(f'{self.name}: {self.n} degrees of freedom, base '
                          f'{self.base_name}',
                          ['joint',
                           'kind', 'from', 'to', 'mass [kg]', 'lower', 'upper', 'speed',
                           'effort'], rows)

    def frame(self, name: str) -> Frame:
        """Return the frame of this name; raise InputError that lists the valid names."""
        for frame in self.frames:
            if frame.name == name:
                return frame
        valid = ', '.join(sorted(frame.name for frame in self.frames)) or 'none'
        # A joint in place of a frame is a frequent mistake.
        moved = [body.name for body in self.bodies if body.joint.name == name]
        hint = f"'{moved[0]}', which this joint moves, or " if moved else ''
        raise InputError(f"no frame '{name}'; expected {hint}one of {valid}")

    def prefixed(self, prefix: str) -> Model:
        """Return the model with a prefix of all names of joints, bodies and frames."""
        return self.renamed(lambda name: prefix + name)

    def renamed(self, new_name: Callable[[str], str]) -> Model:
        """Return the model with a new name of the base, each joint, body and frame."""
        bodies = []
        for body in self.bodies:
            # Drives name their motors' joints, which are renamed too.
            joint = replace(body.joint, name=new_name(body.joint.name))
            if joint.drive is not None:
                drive = replace(joint.drive, motor=new_name(joint.drive.motor))
                joint = replace(joint, drive=drive)
            bodies.append(replace(body, name=new_name(body.name), joint=joint))
        frames = [replace(frame, name=new_name(frame.name)) for frame in self.frames]
        return replace(self, bodies=tuple(bodies), frames=tuple(frames),
                       coordinate_names=tuple(map(new_name, self.coordinate_names)),
                       base_name=new_name(self.base_name))

    def path(self, body: int) -> Iterator[int]:
        """Yield `body` and its ancestors up to the base."""
        while body != WORLD:
            yield body
            body = self.bodies[body].parent

    def digest(self) -> str:
        """Return a hash of everything that affects the dynamics, including names."""
        text = repr(plain_record(self))
        return hashlib.sha256(text.encode()).hexdigest()


def with_payload(model: Model, frame: str, payload: Inertial) -> Model:
    """
    Return the model with a payload attached.

    Parameters
    ----------
    model : Model
        The mechanism.
    frame : str
        Name of the frame in whose axes and from whose origin the payload is given.
    payload : Inertial
        Inertial properties of the payload.

    Raises
    ------
    InputError
        If the frame does not exist; the message lists the valid ones.

    """
    at = model.frame(frame)
    # In the axes of the body that carries the frame, where inertias add.
    moved = payload.moved(at.rotation, at.translation)
    if at.body == WORLD:
        return replace(model, base_inertial=model.base_inertial + moved)
    bodies = list(model.bodies)
    carrier = bodies[at.body]
    bodies[at.body] = replace(carrier, inertial=carrier.inertial + moved)
    return replace(model, bodies=tuple(bodies))


def _checked_rotation(value: Array, what: str) -> Array:
    """Return a read-only rotation matrix, (3, 3); raise ModelError for anything else."""
    R = constant(value, (3, 3), f'{what}: rotation')
    # Orthonormal to rounding of a file's digits, and no reflection.
    if np.abs(R @ R.T - np.eye(3)).max() > 1e-9 or np.linalg.det(R) < 0.0:
        raise ModelError(f'{what}: rotation {R.tolist()}; expected a rotation matrix')
    return R


def _check_unique(what: str, names: Sequence[str]) -> None:
    """Raise ModelError for names that are there more than once."""
    repeated = [name for name, count in Counter(names).items() if count > 1]
    if repeated:
        raise ModelError(f'{what} names: {sorted(repeated)} more than once; expected '
                         'unique names')
