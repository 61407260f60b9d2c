"""
Links of the recursive algorithms, and the link frames that minimize arithmetic.

A `Link` is a body with its joint along z. `linkage` makes links of a Model's bodies. A link
frame has its z axis along the joint axis, a constant pose in its parent, and a
pseudo-inertia P = int [r;1][r;1]^T dm (4 x 4: mass, first and second moment). The
following transformations do not change joint torques and make most constants 0 or 1,
which tracing folds:

* `merged`: a joint that rotates about the same axis as the beam section before it takes
  both rotations.
* `denavit_hartenberg`: the frame of a revolute link is moved along its axis to the
  common normal with its parent's axis, and rotated about its axis so that the pose of
  its (largest) child is an offset along z, an offset along x and a rotation about x, if
  that reduces the arithmetic.
* `regrouped`: inertia on a revolute joint's axis, and the second moment of a prismatic
  link, are moved to the parent. What remains are the base inertial parameters (Khalil &
  Dombre, Modeling, Identification and Control of Robots, ch. 9). A link without children
  is rotated about its axis until the y component of its first moment is zero.

Pseudo-inertias may hold traced values (a payload); everything else is numbers.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
import math
from typing import Any, Literal

from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.vector import quadratic
from kane_dynamics.mechanics.ball_joints import rotations
from kane_dynamics.model.beam import Beam, Deflection
from kane_dynamics.model.model import Model, WORLD
from kane_dynamics.model.placement import SNAP, snapped
import numpy as np

NEARLY_PARALLEL = 1e-4  # rad; the common normal of such axes is far: digits are lost
Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Link:
    """
    Body of the recursive algorithms; its joint rotates about or slides along the z axis.

    Attributes
    ----------
    parent : int
        Index of the parent link, -1 for the world.
    kind : 'revolute' or 'prismatic'
    pose : (4, 4) array
        Pose of the joint frame in the parent link at position 0, m.
    coordinate, multiplier, offset : int, float, float
        The joint's position is ``multiplier * q[coordinate] + offset``.
    pseudo_inertia : (4, 4) array
        Second moment, first moment and mass about the link's origin, link axes.
    body : (4, 4) array
        Pose of the model's body frame in link axes.
    deflection : Deflection, optional
        Joint position as a function of modal coordinates, for a section of a bending
        beam; `offset` is added, `coordinate` and `multiplier` are not used.
    beam : Beam, optional
        Modal integrals of a flexible link, in the axes of the body frame.
    modes : Modes, optional
        Modes of a flexible link at one configuration; set by `flexible_modes.bent`.
    is_ball : bool
        Whether the link is the first of a ball joint, whose rotation `posed` adds to its
        pose: its frame stays at the joint.
    rotation, translation : (3, 3), (3,) arrays
        Axes and origin of the joint frame in the parent link, parts of `pose`; m.
    mass, first_moment, second_moment : scalar, (3,), (3, 3) arrays
        Parts of `pseudo_inertia`: mass, mass times center of mass, int r r^T dm; kg, m.

    """

    parent: int
    kind: Literal['revolute', 'prismatic']
    pose: Array
    coordinate: int
    multiplier: float
    offset: float
    pseudo_inertia: Matrix
    body: Array
    deflection: Deflection | None = None
    beam: Beam | None = None
    modes: Any = None
    is_ball: bool = False
    rotation: Array = field(init=False)
    translation: Array = field(init=False)
    mass: Scalar = field(init=False)
    first_moment: Vector = field(init=False)
    second_moment: Matrix = field(init=False)

    def __post_init__(self) -> None:
        """Name the parts of the pose and of the pseudo-inertia."""
        P = self.pseudo_inertia
        self.__dict__.update(rotation=self.pose[:3, :3], translation=self.pose[:3, 3],
                             mass=P[3, 3], first_moment=P[:3, 3],
                             second_moment=P[:3, :3])

    def position(self, q: Vector) -> Scalar:
        """Return the position of the joint without `offset`, rad or m."""
        bending = self.deflection
        if bending is None:
            return self.multiplier * q[self.coordinate]
        # Of second order in the modal coordinates, which contains the shortening.
        eta = q[list(bending.coordinates)]
        return bending.slope @ eta + 0.5 * (eta @ (bending.curvature @ eta))

    def partials(self, q: Vector) -> list[tuple[int, Scalar]]:
        """Return the coefficients of the speeds in the joint's rate: (index, value)."""
        bending = self.deflection
        if bending is None:
            return [(self.coordinate, self.multiplier)]
        eta = q[list(bending.coordinates)]
        # d position / d eta = slope + curvature eta.
        weights = bending.slope + bending.curvature @ eta
        return list(zip(bending.coordinates, weights))

    def partial_rates(self, u: Vector) -> list[tuple[int, Scalar]]:
        """Return the time derivatives of the coefficients that are not constant."""
        bending = self.deflection
        if bending is None or not bending.curvature.any():
            return []
        eta_rate = u[list(bending.coordinates)]
        return list(zip(bending.coordinates, bending.curvature @ eta_rate))

    def rate(self, q: Vector, u: Vector) -> Scalar:
        """Return the rate of the joint, rad/s or m/s."""
        if self.deflection is None:
            return self.multiplier * u[self.coordinate]
        return sum(weight * u[k] for k, weight in self.partials(q))

    def acceleration(self, q: Vector, u: Vector, udot: Vector) -> Scalar:
        """Return the acceleration of the joint, rad/s^2 or m/s^2."""
        bending = self.deflection
        if bending is None:
            return self.multiplier * udot[self.coordinate]
        # As the rate, with udot for u, and what the coefficients' own rates add.
        eta_rate = u[list(bending.coordinates)]
        return self.rate(q, udot) + quadratic(bending.curvature, eta_rate)


def homogeneous(rotation: Any = None, translation: Any = None) -> Array:
    """Return the homogeneous transformation r -> R r + p, (4, 4)."""
    T = np.eye(4)
    if rotation is not None:
        T[:3, :3] = rotation
    if translation is not None:
        T[:3, 3] = translation
    return T


def inverse_pose(T: Array) -> Array:
    """Return the inverse of a pose."""
    R, p = T[:3, :3], T[:3, 3]
    return homogeneous(R.T, -R.T @ p)


def about_z(angle: float) -> Array:
    """Return the pose of a rotation about z, (4, 4); multiples of pi/2 are exact."""
    c, s = snapped(np.array([math.cos(angle), math.sin(angle)]))
    return homogeneous([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def linkage(model: Model) -> tuple[Link, ...]:
    """Return a model's bodies as links: same origins, z along the joint axes."""
    turns: list[Array] = []
    links: list[Link] = []
    for k, body in enumerate(model.bodies):
        # C turns z onto the joint's axis, so that rotations are about z alone.
        joint = body.joint
        C = homogeneous(_turn_to_z(joint.axis))
        turns.append(C)
        # The joint's pose from the parent's turned axes to its own: C_p^T pose C.
        parent_turn = np.eye(4) if body.parent == WORLD else turns[body.parent]
        pose = parent_turn.T @ homogeneous(joint.rotation, joint.translation) @ C
        links.append(Link(
            parent=body.parent, kind=joint.kind, pose=_snapped_pose(pose),
            coordinate=joint.coordinate, multiplier=joint.multiplier,
            offset=joint.offset, body=C.T,
            pseudo_inertia=C.T @ body.inertial.pseudo_inertia @ C,
            deflection=joint.deflection, beam=body.beam, is_ball=k in model.balls))
    return tuple(links)


def merged(links: Sequence[Link]) -> tuple[Link, ...]:
    """
    Merge joints that rotate about the same axis as the beam section that carries them.

    If a beam bends in the plane of motion of the joint at its end, the sum of the
    section's and the joint's angle is used as one angle. The section stays for its other
    children.
    """
    result = list(links)
    for i, link in enumerate(links):
        if link.parent == WORLD:
            continue
        section = links[link.parent]
        # A joint at the end of a section that rotates about the bending axis adds its
        # angle to the slope: both are one rotation.
        bending = section.deflection
        if bending is None or not _turns_about_axis_of(link, section):
            continue
        sense = link.rotation[2, 2]
        # The slope of the section at its end,
        # and the angle of the joint, about one axis.
        deflection = Deflection((*bending.coordinates, link.coordinate),
                                np.append(sense * bending.slope, link.multiplier),
                                np.pad(sense * bending.curvature, (0, 1)))
        result[i] = replace(link, parent=section.parent,
                            pose=_snapped_pose(section.pose @ link.pose),
                            offset=sense * section.offset + link.offset,
                            deflection=deflection)
    return tuple(result)


def _turns_about_axis_of(link: Link, section: Link) -> bool:
    """Return whether a link's joint rotates about the joint axis of its section."""
    if link.kind != 'revolute' or section.kind != 'revolute':
        return False
    if link.is_ball or link.deflection is not None:
        return False
    parallel = abs(link.rotation[2, 2]) == 1.0
    return bool(parallel and not link.translation[:2].any())


def carrying(links: Sequence[Link], body: int, pose: Array,
             pseudo_inertia: Matrix) -> tuple[Link, ...]:
    """Return the links with a pseudo-inertia added in a frame at a pose on a body."""
    T = links[body].body @ pose
    loaded = links[body].pseudo_inertia + T @ pseudo_inertia @ T.T
    result = list(links)
    result[body] = replace(links[body], pseudo_inertia=loaded)
    return tuple(result)


def posed(links: Sequence[Link], model: Model, q: Vector,
          free: Collection[int] = ()) -> tuple[Link, ...]:
    """
    Return the links with the rotations of the ball joints at q, (n_q,), in their poses.

    The bodies in `free` (see `free_bodies`) are rotated before their slides, not after
    them, so that these are along their own axes.
    """
    result = list(links)
    for k, R in rotations(model, q).items():
        first = k - 3 if k in free else k
        link, joint = links[first], model.bodies[first].joint
        # The constant pose is inner @ outer, with the joint's frame after `inner`: there
        # the rotation of q is put between both.
        parent_body = np.eye(4) if link.parent == WORLD else links[link.parent].body
        joint_pose = homogeneous(joint.rotation, joint.translation)
        inner = _snapped_pose(parent_body @ joint_pose)
        outer = _snapped_pose(inverse_pose(inner) @ link.pose)
        turned = inner[:3, :3] @ R
        rotation = turned @ outer[:3, :3]
        translation = inner[:3, 3] + turned @ outer[:3, 3]
        pose = np.eye(4).astype(object)
        pose[:3, :3] = rotation
        pose[:3, 3] = translation
        result[first] = replace(link, pose=pose)
    return tuple(result)


def _turn_to_z(axis: Array) -> Array:
    """Return a rotation C with C z = axis; a permutation of axes if possible."""
    axis = snapped(axis)
    k = int(np.argmax(np.abs(axis)))
    # Not `max == 1`, which is true for an axis that is off by 1e-8.
    if np.count_nonzero(axis) == 1:
        C = np.roll(np.eye(3), k - 2, axis=0)
        return C if axis[k] > 0.0 else C @ np.diag([1.0, -1.0, -1.0])
    across = Z if k != 2 else np.array([1.0, 0.0, 0.0])  # not along the axis
    x = np.cross(axis, across)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)


def _moved(link: Link, G: Array) -> Link:
    """Return a link with its frame moved by the pose G, a screw about z."""
    back = inverse_pose(G)
    angle = math.atan2(G[1, 0], G[0, 0])
    return replace(link, pose=_snapped_pose(link.pose @ homogeneous(None, G[:3, 3])),
                   offset=math.remainder(link.offset + angle, 2.0 * math.pi),
                   pseudo_inertia=back @ link.pseudo_inertia @ back.T,
                   body=back @ link.body)


def denavit_hartenberg(links: Sequence[Link]) -> tuple[Link, ...]:
    """
    Move frames of revolute links along and about their z axis (see the module).

    Each link uses the combination of translation and rotation with the fewest constants.
    """
    children: dict[int, list[int]] = {}
    largest: dict[int, int] = {}  # of the children, the one with the largest subtree
    size = [1] * len(links)  # of the subtrees
    for i in reversed(range(len(links))):
        parent = links[i].parent
        children.setdefault(parent, []).insert(0, i)
        if parent != WORLD:
            size[parent] += size[i]
            # Of equal ones the first, which comes last here.
            if parent not in largest or size[i] >= size[largest[parent]]:
                largest[parent] = i

    # Outward, so that the frame of the parent is final when a link's is chosen.
    result = list(links)
    for i, link in enumerate(links):
        if link.kind != 'revolute' or link.is_ball:
            continue
        # To the common normals: with the parent's axis along z, with the child's about z.
        shift = 0.0
        angle = 0.0
        if link.parent != WORLD:
            shift = _shift_to_normal(result[i])
        if i in largest:
            child = result[largest[i]]
            angle = _angle_to_normal(child)
            if link.parent == WORLD and child.kind == 'revolute':
                along_axis = _shift_to_normal(child) * child.rotation[:, 2]
                on_normal = child.translation + along_axis
                shift = float(on_normal[2])
        family = (i, *children.get(i, ()))
        nearby = [result[k] for k in family]
        choices = []
        for turn in (angle, 0.0):
            for rise in (shift, 0.0):
                choices.append(_with_frame_moved(nearby, turn, rise))
        best = min(choices, key=_number_of_constants)
        for k, chosen in zip(family, best):
            result[k] = chosen
    return tuple(map(_untwisted, result))


def _with_frame_moved(family: Sequence[Link], angle: float, shift: float) -> list[Link]:
    """Rotate the first link's frame about z and move it along; its children stay."""
    G = about_z(angle)
    G[2, 3] = shift
    result = [_moved(family[0], G)]
    for child in family[1:]:
        result.append(replace(child, pose=_snapped_pose(inverse_pose(G) @ child.pose)))
    return result


def _number_of_constants(links: Sequence[Link]) -> int:
    """Return the number of entries of the links' poses that cause a multiplication."""
    count = 0
    for link in links:
        pose = _untwisted(link).pose
        count += int(np.sum(~np.isin(pose[:3, :3], (0.0, 1.0, -1.0))))
        count += int(np.sum(pose[:3, 3] != 0.0))
    return count


def _angle_to_normal(child: Link) -> float:
    """Return the angle about z to the common normal with a child's joint axis."""
    # The common normal of both axes; of parallel ones, the line to the child's origin.
    z, p = child.rotation[:, 2], child.translation
    x = np.cross(Z, z)
    if np.linalg.norm(x) <= NEARLY_PARALLEL and child.kind == 'revolute':
        x = np.array([p[0], p[1], 0.0])
    if np.linalg.norm(x) < 1e-9:  # the axes coincide
        return 0.0
    # A normal has two directions: the smaller angle is chosen.
    angle = math.atan2(x[1], x[0])
    half = math.pi / 2.0 + 1e-9
    if angle > half:
        angle -= math.pi
    elif angle <= -half:
        angle += math.pi
    return angle


def _shift_to_normal(child: Link) -> float:
    """Return the distance along a child's axis from its origin to the normal with z."""
    z, p = child.rotation[:, 2], child.translation
    x = np.cross(Z, z)
    square = float(x @ x)
    if square > NEARLY_PARALLEL**2:  # p + t z = height Z + a x
        return -float(np.cross(Z, p) @ x) / square
    return -float(p[2] * np.sign(z[2]))


def _untwisted(link: Link) -> Link:
    """Move a rotation about z from a revolute link's constant pose to its offset."""
    R = link.rotation
    if (link.kind != 'revolute' or link.is_ball or abs(R[0, 2]) > 1e-9
            or math.hypot(R[0, 0], R[0, 1]) < 1e-6):
        return link
    # R = R_0 R_z(angle), where the first row of R_0 is x:
    # R_z moves through the joint's own rotation.
    angle = math.atan2(-R[0, 1], R[0, 0])
    return replace(link, pose=_snapped_pose(link.pose @ about_z(-angle)),
                   offset=math.remainder(link.offset + angle, 2.0 * math.pi))


def regrouped(links: Sequence[Link]) -> tuple[Link, ...]:
    """Move inertia to the parents where it does not affect joint torques (see above)."""
    # A link without children is rotated about its axis.
    result = list(map(_align_with_com, links))
    for link in links:
        if link.parent != WORLD:
            result[link.parent] = links[link.parent]

    # Inward: a link's parameters are regrouped after those of its children are added.
    for i in reversed(range(len(links))):
        link = result[i]
        # Mass and its moments along z do not resist a rotation about z, and second
        # moments do not resist a translation.
        part = slice(2, 4) if link.kind == 'revolute' else slice(0, 3)
        # What does not resist moves to the parent, in its axes; the rest stays.
        inert = np.zeros((4, 4)).astype(link.pseudo_inertia.dtype)
        inert[part, part] = link.pseudo_inertia[part, part]
        base = link.pseudo_inertia.copy()
        base[part, part] = 0.0
        result[i] = replace(link, pseudo_inertia=_without_rounding(base))
        if link.parent != WORLD:
            T = link.pose if link.kind == 'revolute' else homogeneous(link.rotation)
            parent = result[link.parent]
            regrouped_inertia = parent.pseudo_inertia + T @ inert @ T.T
            result[link.parent] = replace(parent, pseudo_inertia=regrouped_inertia)
    return tuple(result)


def _align_with_com(link: Link) -> Link:
    """Rotate a revolute link about z until its com or a principal axis is on x."""
    P = _without_rounding(link.pseudo_inertia)
    if link.kind != 'revolute' or P.dtype == object:
        return link
    # x and y of the center of mass,
    # and the product of inertia, vanish by a turn about z.
    x, y, xy = P[0, 3], P[1, 3], P[0, 1]
    angle = 0.0
    if x != 0.0 and y != 0.0:
        angle = math.atan2(y, x)
    elif x == y == 0.0 != xy:
        angle = 0.5 * math.atan2(2.0 * xy, P[0, 0] - P[1, 1])
    return _moved(link, about_z(angle))


def _snapped_pose(pose: Array) -> Array:
    """Return a pose with rounding errors of zeros and ones removed."""
    translation = np.where(np.abs(pose[:3, 3]) < SNAP, 0.0, pose[:3, 3])
    return homogeneous(snapped(pose[:3, :3]), translation)


def _without_rounding(P: Matrix) -> Matrix:
    """Return a pseudo-inertia with rounding errors of zeros removed."""
    if P.dtype == object:
        return P
    largest = float(np.abs(P).max(initial=0.0))
    return np.where(np.abs(P) < 1e-14 * largest, 0.0, P)
