"""
Joints as a URDF or the builder states them, and their expansion to one degree of freedom.

A floating, planar, spherical or universal joint becomes prismatic and revolute ones in series,
with documented names. So do ball and free joints, whose three rotations share a quaternion.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

from kane_dynamics._util.typing import Array
from kane_dynamics.model.placement import snapped
import numpy as np


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
    Joint of a URDF or builder; (rotation, translation) is the pose of its frame in the parent.

    `turns` are the axes of the successive rotations of a floating, spherical or universal joint.
    The last two kinds exist only in `ModelBuilder`.
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

    Joints of at most one degree of freedom stay as they are. The parts of others have no limits;
    their intermediate bodies have the names of their joints.

    floating becomes <joint>/x /y /z, prismatic along the axes of the joint's frame in the parent,
    then <joint>/rx /ry /rz, revolute, each about an axis rotated by the previous ones. spherical
    and universal have rotations only; a second rotation about z is <joint>/rz2. planar becomes
    <joint>/x and <joint>/y, prismatic in the plane normal to the axis, and <joint>/rz about it. x
    is the projection of the joint frame's x axis on that plane (of its y axis, if the axis is
    along x), and y completes the right-handed (x, y, axis).

    ball becomes <joint>/wx /wy /wz about the axes of the child body; `Model.balls` says that they
    are not three angles but share a quaternion. free has <joint>/x /y /z before them.
    """
    eye = np.eye(3)
    if joint.kind in ('ball', 'free'):
        parts = [(f'/{s}', 'prismatic', eye[k]) for k, s in enumerate('xyz')] * (
            joint.kind == 'free') + [(f'/w{s}', 'revolute', eye[k]) for k, s in enumerate('xyz')]
    elif joint.kind == 'floating':
        parts = [(f'/{s}', 'prismatic', eye[k]) for k, s in enumerate('xyz')] + _turns(joint.turns)
    elif joint.kind in ('spherical', 'universal'):
        parts = _turns(joint.turns)
    elif joint.kind == 'planar':
        normal = joint.axis / np.sqrt(joint.axis @ joint.axis)
        seed = eye[0] if abs(normal[0]) < 1.0 - 1e-9 else eye[1]
        x = seed - (seed @ normal) * normal
        x = snapped(x / np.sqrt(x @ x))
        parts = [('/x', 'prismatic', x), ('/y', 'prismatic', snapped(np.cross(normal, x))),
                 ('/rz', 'revolute', normal)]
    else:
        return [joint]
    singles, parent = [], joint.parent
    for k, (suffix, kind, axis) in enumerate(parts):
        name = joint.name + suffix
        child = name if k < len(parts) - 1 else joint.child
        R, p = (joint.rotation, joint.translation) if k == 0 else (eye, np.zeros(3))
        singles.append(replace(joint, name=name, kind=kind, parent=parent, child=child, rotation=R,
                               translation=p, axis=axis, limits=NO_LIMITS))
        parent = child
    return singles


def places(n: int, balls: Sequence[int]) -> tuple[int | None, ...]:
    """
    Return the index in q of each of n degrees of freedom; None for those of ball joints.

    `balls` are the first degrees of freedom of the ball joints, whose entries in q are one more.
    """
    turning = {first + k for first in balls for k in range(3)}
    return tuple(None if r in turning else r + sum(first < r for first in balls)
                 for r in range(n))


def quaternion_names(names: Sequence[str], balls: Sequence[int]) -> tuple[str, ...]:
    """Return the names of q from those of u: /qx /qy /qz /qw of a ball joint for /wx /wy /wz."""
    found: list[str] = []
    for r, name in enumerate(names):
        if r in balls:
            found += [f"{name.removesuffix('/wx')}/q{s}" for s in 'xyzw']
        elif not any(first < r < first + 3 for first in balls):
            found.append(name)
    return tuple(found)


def _turns(axes: str) -> list[tuple[str, str, Array]]:
    """Return suffix, kind and axis of successive rotations."""
    again = [axes[:k].count(s) for k, s in enumerate(axes)]
    return [(f'/r{s}{count + 1 if count else ""}', 'revolute', np.eye(3)['xyz'.index(s)])
            for s, count in zip(axes, again)]
