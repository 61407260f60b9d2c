"""
Joints as a URDF or the builder states them, expanded to one degree of freedom.

A floating, planar, spherical or universal joint becomes prismatic and revolute ones in
series, with documented names. So do ball and free joints, whose three rotations share a
quaternion.
"""

from dataclasses import dataclass, replace
import math

from kane_dynamics._util.typing import Array
from kane_dynamics.model.placement import snapped
import numpy as np

Part = tuple[str, str, Array]  # suffix of the name, kind and axis of a joint


@dataclass(frozen=True)
class Mimic:
    """Position = multiplier * position of joint `master` + offset."""

    master: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class StatedLimits:
    """Attributes of <limit>; None where not stated."""

    lower: float | None = None
    upper: float | None = None
    velocity: float | None = None
    effort: float | None = None


NO_LIMITS = StatedLimits(-math.inf, math.inf, math.inf, math.inf)


@dataclass(frozen=True, eq=False)
class StatedJoint:
    """
    Joint of a URDF or builder; its frame is at (rotation, translation) in the parent.

    `turns` are the axes of the successive rotations of a floating, spherical or
    universal joint. The last two kinds exist only in `ModelBuilder`.
    """

    name: str
    kind: str
    parent: str
    child: str
    rotation: Array
    translation: Array
    axis: Array
    limits: StatedLimits | None = None
    damping: float = 0.0
    friction: float = 0.0
    mimic: Mimic | None = None
    turns: str = 'xyz'


def expand_joint(joint: StatedJoint) -> list[StatedJoint]:
    """
    Expand a joint into joints of at most one degree of freedom, from the parent outward.

    Joints of at most one degree of freedom stay as they are. The parts of others have no
    limits; their intermediate bodies have the names of their joints.

    floating becomes <joint>/x /y /z, prismatic along the axes of the joint's frame in
    the parent, then <joint>/rx /ry /rz, revolute, each about an axis rotated by the
    previous ones. spherical and universal have rotations only; a second rotation about z
    is <joint>/rz2. planar becomes <joint>/x and <joint>/y, prismatic in the plane normal
    to the axis, and <joint>/rz about it. x is the projection of the joint frame's x axis
    on that plane (of its y axis, if the axis is along x), and y completes the
    right-handed (x, y, axis).

    ball becomes <joint>/wx /wy /wz about the axes of the child body; `Model.balls` says
    that they are not three angles but share a quaternion. free has <joint>/x /y /z
    before them.
    """
    if joint.kind == 'ball':
        parts = _along_or_about('/w', 'revolute')
    elif joint.kind == 'free':
        parts = _along_or_about('/', 'prismatic') + _along_or_about('/w', 'revolute')
    elif joint.kind == 'floating':
        parts = _along_or_about('/', 'prismatic') + _turns(joint.turns)
    elif joint.kind in ('spherical', 'universal'):
        parts = _turns(joint.turns)
    elif joint.kind == 'planar':
        parts = _in_plane(joint.axis)
    else:
        return [joint]
    # In series, from the parent outward; the child is the body of the last one.
    singles: list[StatedJoint] = []
    for suffix, kind, axis in parts:
        name = joint.name + suffix
        single = replace(joint, name=name, kind=kind, child=name, axis=axis,
                         limits=NO_LIMITS)
        if singles:  # all but the first begin at their parent's origin
            single = replace(single, parent=singles[-1].child, rotation=np.eye(3),
                             translation=np.zeros(3))
        singles.append(single)
    singles[-1] = replace(singles[-1], child=joint.child)
    return singles


def _along_or_about(prefix: str, kind: str) -> list[Part]:
    """Return joints along, or about, x, y and z."""
    return [(f'{prefix}{letter}', kind, axis) for letter, axis in zip('xyz', np.eye(3))]


def _in_plane(axis: Array) -> list[Part]:
    """Return the joints of a planar joint: along two axes, and about the normal."""
    # x is the projection of the frame's x axis, or of y where x is the normal.
    normal = axis / np.sqrt(axis @ axis)
    seed = np.array([1.0, 0.0, 0.0])
    if abs(normal[0]) > 1.0 - 1e-9:
        seed = np.array([0.0, 1.0, 0.0])
    x = seed - (seed @ normal) * normal
    x = snapped(x / np.sqrt(x @ x))
    y = snapped(np.cross(normal, x))
    return [('/x', 'prismatic', x), ('/y', 'prismatic', y), ('/rz', 'revolute', normal)]


def _turns(letters: str) -> list[Part]:
    """Return joints about successive axes; a second rotation about z is /rz2."""
    parts = []
    for k, letter in enumerate(letters):
        repetitions = letters[:k].count(letter)
        number = repetitions + 1 if repetitions else ''
        axis = np.eye(3)['xyz'.index(letter)]
        parts.append((f'/r{letter}{number}', 'revolute', axis))
    return parts
