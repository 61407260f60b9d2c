"""
Link frames that minimize arithmetic: a tree of links equivalent to a Model's tree of bodies.

A link frame has its z axis along the joint axis, a constant pose in its parent, and a
pseudo-inertia P = int [r;1][r;1]^T dm (4 x 4: mass, first and second moment). The following
transformations do not change joint torques and make most constants 0 or 1, which tracing folds:

* `merged`: a joint that rotates about the same axis as the beam section before it takes both
  rotations.
* `denavit_hartenberg`: the frame of a revolute link is moved along its axis to the common normal
  with its parent's axis, and rotated about its axis so that the pose of its (largest) child is an
  offset along z, an offset along x and a rotation about x, if that reduces the arithmetic.
* `regrouped`: inertia on a revolute joint's axis, and the second moment of a prismatic link, are
  moved to the parent. The rest are the base inertial parameters (Khalil & Dombre, Modeling,
  Identification and Control of Robots, ch. 9). A link without children is rotated about its axis
  until the y component of its first moment is zero.

Pseudo-inertias may hold traced values (a payload); everything else is numbers.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace
import math
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.ball_joints import rotations
from kane_dynamics.mechanics.recursive.link import homogeneous, inverse, Link
from kane_dynamics.model.beam import Deflection
from kane_dynamics.model.model import Model, WORLD
from kane_dynamics.model.placement import SNAP, snapped
import numpy as np

NEARLY_PARALLEL = 1e-4  # rad; the common normal of such axes is far away, which loses digits
Z = np.array([0.0, 0.0, 1.0])


def about_z(angle: float) -> Array:
    """Return the pose of a rotation about z, (4, 4); multiples of pi/2 are exact."""
    c, s = snapped(np.array([math.cos(angle), math.sin(angle)]))
    return homogeneous([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def linkage(model: Model) -> tuple[Link, ...]:
    """Return a model's bodies as links: same origins, z along the joint axes."""
    turns = [homogeneous(_turn_to_z(body.joint.axis)) for body in model.bodies]
    links: list[Link] = []
    for body, C in zip(model.bodies, turns):
        joint = body.joint
        above = np.eye(4) if body.parent == WORLD else turns[body.parent]
        pose = above.T @ homogeneous(joint.rotation, joint.translation) @ C
        links.append(Link(body.parent, joint.kind, _clean(pose), joint.coordinate,
                          joint.multiplier, joint.offset,
                          C.T @ body.inertial.pseudo_inertia @ C, C.T, joint.deflection,
                          body.beam, turned=len(links) in model.balls))
    return tuple(links)


def merged(links: Sequence[Link]) -> tuple[Link, ...]:
    """
    Merge joints that rotate about the same axis as the beam section that carries them.

    If a beam bends in the plane of motion of the joint at its end, the sum of the section's and
    the joint's angle is used as one angle. The section stays for its other children.
    """
    result = list(links)
    for i, link in enumerate(links):
        if link.parent == WORLD or (section := links[link.parent]).deflection is None:
            continue
        sense, bent = link.rotation[2, 2], section.deflection
        if (link.turned or link.deflection is not None
                or (link.kind, section.kind) != ('revolute', 'revolute')
                or abs(sense) != 1.0 or link.translation[:2].any()):
            continue
        result[i] = replace(
            link, parent=section.parent, pose=_clean(section.pose @ link.pose),
            offset=sense * section.offset + link.offset,
            deflection=Deflection((*bent.coordinates, link.coordinate),
                                  np.append(sense * bent.slope, link.multiplier),
                                  np.pad(sense * bent.curvature, (0, 1))))
    return tuple(result)


def carrying(links: Sequence[Link], body: int, pose: Array,
             pseudo_inertia: Any) -> tuple[Link, ...]:
    """Return the links with a pseudo-inertia added, given in a frame at this pose on a body."""
    T = links[body].body @ pose
    added = links[body].pseudo_inertia + T @ pseudo_inertia @ T.T
    return (*links[:body], replace(links[body], pseudo_inertia=added), *links[body + 1:])


def posed(links: Sequence[Link], model: Model, q: Any,
          free: Collection[int] = ()) -> tuple[Link, ...]:
    """
    Return the links with the rotations of the ball joints at q, (n_q,), in constant poses.

    The bodies in `free` (see `free_bodies`) are rotated before their slides, not after them, so
    that these are along their own axes.
    """
    result = list(links)
    for k, R in rotations(model, q).items():
        first = k - 3 if k in free else k
        link, joint = links[first], model.bodies[first].joint
        above = np.eye(4) if link.parent == WORLD else links[link.parent].body
        before = _clean(above @ homogeneous(joint.rotation, joint.translation))
        after = _clean(inverse(before) @ link.pose)
        R = before[:3, :3] @ R
        pose = np.eye(4).astype(object)
        pose[:3] = np.concatenate([R @ after[:3, :3],
                                   (before[:3, 3] + R @ after[:3, 3])[:, None]], axis=1)
        result[first] = replace(link, pose=pose)
    return tuple(result)


def _turn_to_z(axis: Array) -> Array:
    """Return a rotation C with C z = axis; a permutation of axes if possible."""
    axis = snapped(axis)
    k = int(np.argmax(np.abs(axis)))
    if np.count_nonzero(axis) == 1:  # not `max == 1`: true for an axis that is off by 1e-8
        C = np.roll(np.eye(3), k - 2, axis=0)
        return C if axis[k] > 0.0 else C @ np.diag([1.0, -1.0, -1.0])
    x = np.cross(axis, Z if k != 2 else np.array([1.0, 0.0, 0.0]))
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)


def _moved(link: Link, G: Array) -> Link:
    """Return a link with its frame moved by the pose G, a screw about z."""
    back = inverse(G)
    return replace(link, pose=_clean(link.pose @ homogeneous(None, G[:3, 3])),
                   offset=math.remainder(link.offset + math.atan2(G[1, 0], G[0, 0]),
                                         2.0 * math.pi),
                   pseudo_inertia=back @ link.pseudo_inertia @ back.T, body=back @ link.body)


def denavit_hartenberg(links: Sequence[Link]) -> tuple[Link, ...]:
    """
    Move frames of revolute links along and about their z axis (see the module).

    Each link uses the combination of translation and rotation with the fewest constants.
    """
    links = merged(links)
    result = list(links)
    children = [[k for k, link in enumerate(links) if link.parent == i]
                for i in range(len(links))]
    size = [1] * len(links)
    for i in reversed(range(len(links))):
        if links[i].parent != WORLD:
            size[links[i].parent] += size[i]
    for i, link in enumerate(links):
        if link.kind != 'revolute' or link.turned:
            continue
        shift, angle = (_slide(result[i]) if link.parent != WORLD else 0.0), 0.0
        if children[i]:
            child = result[max(children[i], key=lambda k: size[k])]
            angle = _turn_to_normal(child)
            if link.parent == WORLD and child.kind == 'revolute':
                shift = float((child.translation + _slide(child) * child.rotation[:, 2])[2])
        near = [result[k] for k in (i, *children[i])]
        choices = [_with_frame_moved(near, turn, rise)
                   for turn in (angle, 0.0) for rise in (shift, 0.0)]
        best = min(choices, key=_constants)
        for k, chosen in zip((i, *children[i]), best):
            result[k] = chosen
    return tuple(_untwisted(link) for link in result)


def _with_frame_moved(near: Sequence[Link], angle: float, shift: float) -> list[Link]:
    """Rotate a link's frame about its z axis and move it along; keep its children in place."""
    G = about_z(angle)
    G[2, 3] = shift
    return [_moved(near[0], G), *(replace(child, pose=_clean(inverse(G) @ child.pose))
                                  for child in near[1:])]


def _constants(links: Sequence[Link]) -> int:
    """Return the number of entries of the links' poses that cause a multiplication."""
    poses = [_untwisted(link).pose[:3] for link in links]
    return sum(int(np.sum(~np.isin(pose[:, :3], (0.0, 1.0, -1.0))) + np.sum(pose[:, 3] != 0.0))
               for pose in poses)


def _turn_to_normal(child: Link) -> float:
    """Return the angle about z to the common normal with a child's joint axis."""
    z, p = child.rotation[:, 2], child.translation
    x = np.cross(Z, z)
    if np.linalg.norm(x) <= NEARLY_PARALLEL and child.kind == 'revolute':
        x = np.array([p[0], p[1], 0.0])
    if np.linalg.norm(x) < 1e-9:  # the axes coincide
        return 0.0
    angle = math.atan2(x[1], x[0])
    half = math.pi / 2.0 + 1e-9
    if angle > half:
        angle -= math.pi
    elif angle <= -half:
        angle += math.pi
    return angle


def _slide(child: Link) -> float:
    """Return the distance along its axis from a child's origin to the common normal with z."""
    z, p = child.rotation[:, 2], child.translation
    x = np.cross(Z, z)
    square = float(x @ x)
    if square > NEARLY_PARALLEL**2:  # p + t z = height Z + a x
        return -float(np.cross(Z, p) @ x) / square
    return -float(p[2] * np.sign(z[2]))


def _untwisted(link: Link) -> Link:
    """Move a rotation about z from a revolute link's constant pose to its offset."""
    R = link.rotation
    if (link.kind != 'revolute' or link.turned or abs(R[0, 2]) > 1e-9
            or math.hypot(R[0, 0], R[0, 1]) < 1e-6):
        return link
    angle = math.atan2(-R[0, 1], R[0, 0])
    return replace(link, pose=_clean(link.pose @ about_z(-angle)),
                   offset=math.remainder(link.offset + angle, 2.0 * math.pi))


def regrouped(links: Sequence[Link]) -> tuple[Link, ...]:
    """Move inertia to the parents where it does not affect joint torques (see the module)."""
    carrying_none = set(range(len(links))).difference(link.parent for link in links)
    result = [_align_with_com(link) if i in carrying_none else link
              for i, link in enumerate(links)]
    for i in reversed(range(len(links))):
        link = result[i]
        moved = np.zeros((4, 4)).astype(link.pseudo_inertia.dtype)
        part = slice(2, 4) if link.kind == 'revolute' else slice(0, 3)
        moved[part, part] = link.pseudo_inertia[part, part]
        rest = link.pseudo_inertia.copy()
        rest[part, part] = 0.0
        result[i] = replace(link, pseudo_inertia=_without_rounding(rest))
        if link.parent != WORLD:
            T = link.pose if link.kind == 'revolute' else homogeneous(link.rotation)
            above = result[link.parent]
            result[link.parent] = replace(
                above, pseudo_inertia=above.pseudo_inertia + T @ moved @ T.T)
    return tuple(result)


def _align_with_com(link: Link) -> Link:
    """Rotate a revolute link about its axis until its center of mass or principal axis is on x."""
    P = _without_rounding(link.pseudo_inertia)
    if link.kind != 'revolute' or P.dtype == object:
        return link
    x, y, xy = P[0, 3], P[1, 3], P[0, 1]
    angle = 0.0
    if x != 0.0 and y != 0.0:
        angle = math.atan2(y, x)
    elif x == y == 0.0 != xy:
        angle = 0.5 * math.atan2(2.0 * xy, P[0, 0] - P[1, 1])
    return _moved(link, about_z(angle))


def _clean(pose: Array) -> Array:
    """Return a pose with rounding errors of zeros and ones removed."""
    translation = np.where(np.abs(pose[:3, 3]) < SNAP, 0.0, pose[:3, 3])
    return homogeneous(snapped(pose[:3, :3]), translation)


def _without_rounding(P: Any) -> Any:
    """Return a pseudo-inertia with rounding errors of zeros removed."""
    if P.dtype == object:
        return P
    return np.where(np.abs(P) < 1e-14 * float(np.abs(P).max(initial=0.0)), 0.0, P)
