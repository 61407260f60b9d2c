"""
Joints as a URDF or a builder states them, expanded into joints of one degree of freedom.

A floating, planar, spherical or universal joint becomes prismatic and revolute ones in series,
with documented names.
"""

from dataclasses import dataclass

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
    """What <limit> says; None where it is silent."""

    lower: float | None = None
    upper: float | None = None
    velocity: float | None = None
    effort: float | None = None


@dataclass(frozen=True, eq=False)
class StatedJoint:
    """
    A joint of a URDF; (rotation, translation) place its frame in the parent link.

    `turns` are the axes of the successive turns of a floating, spherical or universal joint; the
    last two kinds are not URDF's, but `build` has them.
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


@dataclass(frozen=True)
class SingleJoint:
    """
    A joint of one freedom (or none: kind 'fixed'), as `expand_joint` makes them of any joint.

    `child_name` names the body behind it: a link, or one that stands between the freedoms of a
    floating or planar joint. `order` sorts by place in the URDF.
    """

    name: str
    kind: str
    axis: Array
    rotation: Array
    translation: Array
    parent: str
    child: str
    order: tuple[int, int]
    source: StatedJoint


def expand_joint(joint: StatedJoint, index: int) -> list[SingleJoint]:
    """
    Return a joint as joints of at most one freedom, outward.

    floating becomes <joint>/x /y /z, prismatic along the axes of the joint's frame in the parent,
    then <joint>/rx /ry /rz, revolute, each about an axis of the frame that the one before has
    turned; spherical and universal have turns only, and a second turn about z is <joint>/rz2.
    planar becomes <joint>/x and <joint>/y, prismatic in the plane normal to the axis, and
    <joint>/rz about it; x is the direction of the joint frame's x axis in that plane (of its y
    axis, where the axis lies along x), and y completes the right-handed (x, y, axis).
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
        kind = {'continuous': 'revolute'}.get(joint.kind, joint.kind)
        parts = [('', kind, joint.axis)]
    singles, parent = [], joint.parent
    for k, (suffix, kind, axis) in enumerate(parts):
        name = joint.name + suffix
        child = name if k < len(parts) - 1 else joint.child
        pose = (joint.rotation, joint.translation) if k == 0 else (eye, np.zeros(3))
        singles.append(SingleJoint(name, kind, axis, *pose, parent, child, (index, k), joint))
        parent = child
    return singles


def _turns(axes: str) -> list[tuple[str, str, Array]]:
    """Return suffix, kind and axis of successive turns."""
    again = [axes[:k].count(s) for k, s in enumerate(axes)]
    return [(f'/r{s}{count + 1 if count else ""}', 'revolute', np.eye(3)['xyz'.index(s)])
            for s, count in zip(axes, again)]
