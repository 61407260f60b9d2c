"""
A tree of links with the least arithmetic in it, equivalent to a Model's tree of bodies.

A link is a body as the recursions see it: in axes of its own, whose z is the joint's axis, with a
constant placement in its parent and a pseudo-inertia P = int [r;1][r;1]^T dm (4 x 4: the moments
of mass up to the second). Further changes that no joint torque can notice make most of its
numbers 0 or 1, which tracing then folds away:

* `merged`: a joint that turns about the same axis as the beam's section it is on takes both turns;
* `denavit_hartenberg`: each revolute link's frame slid along its own axis to the common normal
  with its parent's, and turned about it so that the way to its (largest) child is an offset along
  its z, one along its x, and a turn about x, where that is less arithmetic;
* `regrouped`: matter on a revolute joint's axis moves the same in the parent, and so does the
  second moment of a prismatic link: both are handed to the parent. What stays are the base
  inertial parameters (Khalil & Dombre, Modeling, Identification and Control of Robots, ch. 9).
  A link that carries no other is turned about its axis until y is free of its first moment.

Pseudo-inertias may hold traced values (a payload); everything else here is numbers.
"""

from collections.abc import Sequence
from dataclasses import replace
import math
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.recursive.link import homogeneous, inverse, Link
from kane_dynamics.model.beam import Deflection
from kane_dynamics.model.model import Model, WORLD
import numpy as np

SNAP = 1e-14  # entries this close to 0, 1 or -1 are rounding; coarser would cost accuracy
NEARLY_PARALLEL = 1e-4  # rad: the common normal of such axes lies far off, at a loss of digits
Z = np.array([0.0, 0.0, 1.0])


def snap(array: Array) -> Array:
    """Return the array with entries within `SNAP` of 0, 1, -1 put there."""
    result = np.array(array, dtype=np.float64)
    for value in (0.0, 1.0, -1.0):
        result[np.abs(result - value) < SNAP] = value
    return result


def about_z(angle: float) -> Array:
    """Return the pose turned about z; whole quarter turns are exact."""
    c, s = snap(np.array([math.cos(angle), math.sin(angle)]))
    return homogeneous([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def linkage(model: Model) -> tuple[Link, ...]:
    """Return a model's bodies as links: the same origins, axes turned so that joints are z."""
    turns = [homogeneous(_turn_to_z(body.joint.axis)) for body in model.bodies]
    links = []
    for body, C in zip(model.bodies, turns):
        joint = body.joint
        above = np.eye(4) if body.parent == WORLD else turns[body.parent]
        pose = above.T @ homogeneous(joint.rotation, joint.translation) @ C
        links.append(Link(body.parent, joint.kind, _clean(pose), joint.coordinate,
                          joint.multiplier, joint.offset,
                          C.T @ body.inertial.pseudo_inertia @ C, C.T, joint.deflection,
                          body.beam))
    return tuple(links)


def merged(links: Sequence[Link]) -> tuple[Link, ...]:
    """
    Return the links with joints that turn about the same axis as the section they are on.

    Where a beam bends in the plane in which the joint at its end moves, one angle, the sum of
    the section's and the joint's, serves both. The section stays, for what else is on it.
    """
    result = list(links)
    for i, link in enumerate(links):
        if link.parent == WORLD or (section := links[link.parent]).deflection is None:
            continue
        sense, bent = link.rotation[2, 2], section.deflection
        if (link.deflection is not None or (link.kind, section.kind) != ('revolute', 'revolute')
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
    """Return the links with matter added that is given in a frame with this pose on a body."""
    T = links[body].body @ pose
    added = links[body].pseudo_inertia + T @ pseudo_inertia @ T.T
    return (*links[:body], replace(links[body], pseudo_inertia=added), *links[body + 1:])


def _turn_to_z(axis: Array) -> Array:
    """Return the rotation C with C z = axis; a permutation of axes where that is possible."""
    axis = snap(axis)
    k = int(np.argmax(np.abs(axis)))
    if np.count_nonzero(axis) == 1:  # an axis off by 1e-8 has a largest entry of 1 too
        C = np.roll(np.eye(3), k - 2, axis=0)
        return C if axis[k] > 0.0 else C @ np.diag([1.0, -1.0, -1.0])
    x = np.cross(axis, Z if k != 2 else np.array([1.0, 0.0, 0.0]))
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)


def _moved(link: Link, G: Array) -> Link:
    """Return a link with its frame changed by the pose G on the link, a screw about z."""
    back = inverse(G)
    return replace(link, pose=_clean(link.pose @ homogeneous(None, G[:3, 3])),
                   offset=math.remainder(link.offset + math.atan2(G[1, 0], G[0, 0]),
                                         2.0 * math.pi),
                   pseudo_inertia=back @ link.pseudo_inertia @ back.T, body=back @ link.body)


def denavit_hartenberg(links: Sequence[Link]) -> tuple[Link, ...]:
    """
    Slide and turn revolute links' frames about their own z, of `merged` links (see the module).

    Of both, either and neither, a link takes what leaves the fewest constants near it.
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
        if link.kind != 'revolute':
            continue
        shift, angle = (_slide(result[i]) if link.parent != WORLD else 0.0), 0.0
        if children[i]:
            child = result[max(children[i], key=lambda k: size[k])]
            angle = _turn_to_normal(child)
            if link.parent == WORLD and child.kind == 'revolute':
                shift = float((child.translation + _slide(child) * child.rotation[:, 2])[2])
        near = [result[k] for k in (i, *children[i])]
        choices = [_changed(near, turn, rise) for turn in (angle, 0.0) for rise in (shift, 0.0)]
        best = min(choices, key=_constants)
        for k, chosen in zip((i, *children[i]), best):
            result[k] = chosen
    return tuple(_untwisted(link) for link in result)


def _changed(near: Sequence[Link], angle: float, shift: float) -> list[Link]:
    """Turn a link's frame about its z and slide it along; its children, which follow, stay."""
    G = about_z(angle)
    G[2, 3] = shift
    return [_moved(near[0], G), *(replace(child, pose=_clean(inverse(G) @ child.pose))
                                  for child in near[1:])]


def _constants(links: Sequence[Link]) -> int:
    """Count the entries of the ways to links that cost a multiplication each time."""
    poses = [_untwisted(link).pose[:3] for link in links]
    return sum(int(np.sum(~np.isin(pose[:, :3], (0.0, 1.0, -1.0))) + np.sum(pose[:, 3] != 0.0))
               for pose in poses)


def _turn_to_normal(child: Link) -> float:
    """Return the angle about z of the common normal with a child's joint axis."""
    z, p = child.rotation[:, 2], child.translation
    x = np.cross(Z, z)
    if np.linalg.norm(x) <= NEARLY_PARALLEL and child.kind == 'revolute':
        x = np.array([p[0], p[1], 0.0])
    if np.linalg.norm(x) < 1e-9:  # the axes are one
        return 0.0
    angle = math.atan2(x[1], x[0])
    half = math.pi / 2.0 + 1e-9
    if angle > half:
        angle -= math.pi
    elif angle <= -half:
        angle += math.pi
    return angle


def _slide(child: Link) -> float:
    """Return how far along its axis a child's origin is from the common normal with z."""
    z, p = child.rotation[:, 2], child.translation
    x = np.cross(Z, z)
    square = float(x @ x)
    if square > NEARLY_PARALLEL**2:  # p + t z = height Z + a x
        return -float(np.cross(Z, p) @ x) / square
    return -float(p[2] * np.sign(z[2]))


def _untwisted(link: Link) -> Link:
    """Move a turn about z out of a revolute link's constant rotation into its offset."""
    R = link.rotation
    if link.kind != 'revolute' or abs(R[0, 2]) > 1e-9 or math.hypot(R[0, 0], R[0, 1]) < 1e-6:
        return link
    angle = math.atan2(-R[0, 1], R[0, 0])
    return replace(link, pose=_clean(link.pose @ about_z(-angle)),
                   offset=math.remainder(link.offset + angle, 2.0 * math.pi))


def regrouped(links: Sequence[Link]) -> tuple[Link, ...]:
    """Hand to each parent the matter that moves with it just as well (see the module)."""
    carrying_none = set(range(len(links))).difference(link.parent for link in links)
    result = [_turned_to_matter(link) if i in carrying_none else link
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


def _turned_to_matter(link: Link) -> Link:
    """Turn a revolute link about its axis until its mass centre, or a principal axis, is on x."""
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
    """Return a pose with what rounding left where zeros and ones belong put there."""
    translation = np.where(np.abs(pose[:3, 3]) < SNAP, 0.0, pose[:3, 3])
    return homogeneous(snap(pose[:3, :3]), translation)


def _without_rounding(P: Any) -> Any:
    """Return a pseudo-inertia with what rounding left where zeros belong cleared."""
    if P.dtype == object:
        return P
    return np.where(np.abs(P) < 1e-14 * float(np.abs(P).max(initial=0.0)), 0.0, P)
