"""
Joints as a URDF or the builder states them, and their expansion to one degree of freedom.

A floating, planar, spherical or universal joint becomes prismatic and revolute ones in series,
with documented names.
"""

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
    """
    eye = np.eye(3)
    if joint.kind == 'floating':
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


def _turns(axes: str) -> list[tuple[str, str, Array]]:
    """Return suffix, kind and axis of successive rotations."""
    again = [axes[:k].count(s) for k, s in enumerate(axes)]
    return [(f'/r{s}{count + 1 if count else ""}', 'revolute', np.eye(3)['xyz'.index(s)])
            for s, count in zip(axes, again)]
