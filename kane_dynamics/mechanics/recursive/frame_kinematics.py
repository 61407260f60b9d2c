"""Forward kinematics of frames: poses, Jacobians and their rates, velocities."""

from collections.abc import Container, Sequence
from typing import NamedTuple

from kane_dynamics._util.typing import Array, Matrix, Vector
from kane_dynamics.mechanics.algebra.vector import cross, rate_tensor
from kane_dynamics.mechanics.recursive.inverse_dynamics import JointStep
from kane_dynamics.mechanics.recursive.link import homogeneous, Link, Z
from kane_dynamics.model.model import Frame, WORLD
import numpy as np

Pose = tuple[Matrix, Vector]  # axes (3, 3, columns) and origin (3,), m


def link_poses(links: Sequence[Link], q: Vector) -> list[Pose]:
    """Return axes (3, 3, columns) and origin (3,) of all links in the world, m."""
    poses = LinkPoses(links, q)
    return [poses[k] for k in range(len(links))]


class LinkPoses:
    """
    Poses of links, as `link_poses`, each computed at its first use.

    Parameters
    ----------
    links : sequence of Link
    q : (n,) array
        rad or m.
    axes : int
        The link in whose axes, and from whose origin, the poses are; WORLD by default.
        Then `poses[WORLD]` is the pose of the world.

    """

    def __init__(self, links: Sequence[Link], q: Vector, axes: int = WORLD) -> None:
        """Store the links and the coordinates."""
        self.links = links
        self.q = q
        self.axes = axes
        self._poses: dict[int, Pose] = {axes: (np.eye(3), np.zeros(3))}
        # From the world and the links between it and `axes`:
        # the next link toward `axes`.
        self.inward: dict[int, int] = {}
        k = axes
        while k != WORLD:
            parent = links[k].parent
            self.inward[parent] = k
            k = parent

    def __getitem__(self, k: int) -> Pose:
        """Return axes (3, 3, columns) and origin (3,) of a link or of the world, m."""
        # From the nearest known link: away from `axes` through a joint, toward the world
        # through the inverse of one.
        for i in self.missing(self._poses, k):
            if i in self.inward:
                self._poses[i] = self._of_parent(self.inward[i])
            else:
                self._poses[i] = self._of_child(i)
        return self._poses[k]

    def missing(self, computed: Container[int], k: int) -> list[int]:
        """Return the links up to link k that are not computed, in order from `axes`."""
        path: list[int] = []
        while k not in computed:
            path.append(k)
            k = self.inward[k] if k in self.inward else self.links[k].parent
        return path[::-1]

    def _of_child(self, k: int) -> Pose:
        """Return the pose of link k from that of its parent."""
        step = JointStep(self.links[k], self.q)
        R, p = self[self.links[k].parent]
        x, y, z = (R @ step.rotation).T
        # The joint rotates x and y about z.
        turned = np.stack([step.c * x + step.s * y, step.c * y - step.s * x, z], axis=1)
        return turned, R @ step.offset + p

    def _of_parent(self, k: int) -> Pose:
        """Return the pose of the parent of link k from that of link k."""
        step = JointStep(self.links[k], self.q)
        R, p = self[k]
        x, y, z = R.T
        # The rotation by the opposite angle.
        turned = np.stack([step.c * x - step.s * y, step.s * x + step.c * y, z], axis=1)
        R = turned @ step.rotation.T
        return R, p - R @ step.offset


def frame_in_link(links: Sequence[Link], frame: Frame) -> tuple[Array, Array]:
    """Return the constant axes and origin of a frame in its link, or in the world."""
    T = homogeneous(frame.rotation, frame.translation)
    if frame.body != WORLD:
        T = links[frame.body].body @ T
    return T[:3, :3], T[:3, 3]


def frame_axes(links: Sequence[Link], frame: Frame, poses: LinkPoses) -> Pose:
    """Return axes (3, 3, columns) and origin (3,) of a frame, m, in the poses' axes."""
    R, p = frame_in_link(links, frame)
    R_wl, p_wl = poses[frame.body]
    return R_wl @ R, R_wl @ p + p_wl


def frame_pose(links: Sequence[Link], frame: Frame, q: Vector) -> Matrix:
    """Return the pose of a frame in the world, (4, 4)."""
    R, p = frame_axes(links, frame, LinkPoses(links, q))
    upper = np.concatenate([R, p[:, None]], axis=1)
    return np.concatenate([upper, np.array([[0.0, 0.0, 0.0, 1.0]])])


def partial_velocities(links: Sequence[Link], frame: Frame, q: Vector,
                       at: Vector | None = None,
                       poses: LinkPoses | None = None) -> Matrix:
    """
    Return the Jacobian (partial velocities) of a frame, (6, n): linear, then angular.

    With `at`, (3,), m, it is that of the point of the frame's body at this place.
    Vectors are in world axes, or in those of `poses`.

    With s_r the axis and p_r the origin of a joint between the base and the frame, its
    column is s_r x (p - p_r), s_r if revolute and s_r, 0 if prismatic. All other columns
    are zero.
    """
    columns: list[Vector] = [np.zeros(6)] * len(q)
    poses = poses or LinkPoses(links, q)
    _, p_f = frame_in_link(links, frame)
    k = frame.body
    if k != WORLD:
        R, p = poses[k]
        p_f = R @ p_f + p if at is None else at
    # From the body of the frame to the root; joints that share a coordinate add up.
    while k != WORLD:
        link = links[k]
        R, p = poses[k]
        # Joint axis s. Revolute: v^r = s x (p_f - p), omega^r = s. Prismatic: v^r = s,
        # omega^r = 0.
        s = R @ Z
        if link.kind == 'revolute':
            column = np.concatenate([cross(s, p_f - p), s])
        else:
            column = np.concatenate([s, np.zeros(3)])
        for r, weight in link.partials(q):
            columns[r] = columns[r] + weight * column
        k = link.parent
    return np.reshape(columns, (len(q), 6)).T  # also without joints


def partial_velocity_rates(links: Sequence[Link], frame: Frame, q: Vector,
                           u: Vector) -> Matrix:
    """
    Return the time derivative of `partial_velocities`, (6, n), for q' = u.

    With omega the angular velocity of the joint's link, the rate of its axis is
    s' = omega x s, and that of the column s x r of a revolute joint is s' x r + s x r'.
    """
    columns: list[Vector] = [np.zeros(6)] * len(q)
    poses = LinkPoses(links, q)
    motions = LinkMotions(poses, u, np.zeros(len(q)).astype(object))
    # Velocities of the frame's origin and of the joints' origins, in world axes.
    R, p = poses[frame.body]
    r_f = R @ frame_in_link(links, frame)[1]
    p_f = p + r_f
    v_f, _ = motions[frame.body].of_point(r_f)
    k = frame.body
    while k != WORLD:
        link = links[k]
        R, p = poses[k]
        motion = motions[k]
        # Axes turn with their links, s' = omega x s, and both ends of the lever move.
        s = R @ Z
        s_rate = cross(motion.omega, s)
        if link.kind == 'revolute':
            column = np.concatenate([cross(s, p_f - p), s])
            linear = cross(s_rate, p_f - p) + cross(s, v_f - motion.v)
            column_rate = np.concatenate([linear, s_rate])
        else:
            column = np.concatenate([s, np.zeros(3)])
            column_rate = np.concatenate([s_rate, np.zeros(3)])
        for r, weight in link.partials(q):
            columns[r] = columns[r] + weight * column_rate
        # The weights of a beam's modes change with its shape.
        for r, weight_rate in link.partial_rates(u):
            columns[r] = columns[r] + weight_rate * column
        k = link.parent
    return np.reshape(columns, (len(q), 6)).T  # also without joints


def frame_motion(frame: Frame, poses: LinkPoses, u: Vector, udot: Vector) -> Matrix:
    """
    Return velocity and classical acceleration of a frame, (2, 6), linear then angular.

    They are of its origin, relative to the axes of `poses` and in these; gravity is not
    included.
    """
    motion = LinkMotions(poses, u, udot)[frame.body]
    R, _ = poses[frame.body]
    v, a = motion.of_point(R @ frame_in_link(poses.links, frame)[1])
    velocity = np.concatenate([v, motion.omega])
    acceleration = np.concatenate([a, motion.alpha])
    return np.stack([velocity, acceleration])


class RelativeMotion(NamedTuple):
    """
    Motion of a link: angular velocity and acceleration, and those of its origin, (3,).

    `U` is the acceleration gradient of `rate_tensor`.
    """

    omega: Vector
    alpha: Vector
    v: Vector
    a: Vector
    U: Matrix

    def of_point(self, r: Vector) -> tuple[Vector, Vector]:
        """Return velocity and acceleration of the link's point at r, from its origin."""
        return self.v + cross(self.omega, r), self.a + self.U @ r


class LinkMotions:
    """
    Motions of links relative to the axes of `poses`, in these, computed at first use.

    Parameters
    ----------
    poses : LinkPoses
    u, udot : (n,) arrays
        Rates and accelerations of the coordinates; rad or m, s.

    """

    def __init__(self, poses: LinkPoses, u: Vector, udot: Vector) -> None:
        """Store the poses and the motion of the coordinates."""
        self._poses = poses
        self._u = u
        self._udot = udot
        zero = np.zeros(3)
        at_rest = RelativeMotion(zero, zero, zero, zero, np.zeros((3, 3)))
        self._motions = {poses.axes: at_rest}

    def __getitem__(self, k: int) -> RelativeMotion:
        """Return the motion of a link or of the world."""
        inward = self._poses.inward
        for i in self._poses.missing(self._motions, k):
            if i in inward:
                self._motions[i] = self._of_parent(inward[i])
            else:
                self._motions[i] = self._of_child(i)
        return self._motions[k]

    def _of_child(self, k: int) -> RelativeMotion:
        """Return the motion of link k from that of its parent."""
        link = self._poses.links[k]
        parent = self[link.parent]
        rate, acceleration = self._of_joint(k)
        # The parent's point at the link's origin, then the motion of the joint.
        v, a = parent.of_point(self._origin(k) - self._origin(link.parent))
        # The axis s turns with the parent:
        # (rate s)' = acceleration s + omega x (rate s).
        across = cross(parent.omega, rate)
        if link.kind == 'revolute':
            omega = parent.omega + rate
            alpha = parent.alpha + acceleration + across
            return _motion(omega, alpha, v, a)
        v = v + rate
        a = a + acceleration + 2.0 * across
        return _motion(parent.omega, parent.alpha, v, a)

    def _of_parent(self, k: int) -> RelativeMotion:
        """Return the motion of the parent of link k from that of link k."""
        link = self._poses.links[k]
        child = self[k]
        rate, acceleration = self._of_joint(k)
        # The motion of the joint taken off, then the parent's point at its own origin.
        across = cross(child.omega, rate)
        omega, alpha, v, a, _ = child
        if link.kind == 'revolute':
            omega = child.omega - rate
            alpha = child.alpha - acceleration - across
        else:
            v = child.v - rate
            a = child.a - acceleration - 2.0 * across
        without_joint = _motion(omega, alpha, v, a)
        v, a = without_joint.of_point(self._origin(link.parent) - self._origin(k))
        return without_joint._replace(v=v, a=a)

    def _origin(self, k: int) -> Vector:
        """Return the origin of a link, (3,), m."""
        return self._poses[k][1]

    def _of_joint(self, k: int) -> tuple[Vector, Vector]:
        """Return rate and acceleration of a joint along its axis, (3,) each."""
        link = self._poses.links[k]
        q = self._poses.q
        s = self._poses[k][0] @ Z
        rate = link.rate(q, self._u) * s
        acceleration = link.acceleration(q, self._u, self._udot) * s
        return rate, acceleration


def _motion(omega: Vector, alpha: Vector, v: Vector, a: Vector) -> RelativeMotion:
    """Return the motion with its acceleration gradient."""
    return RelativeMotion(omega, alpha, v, a, rate_tensor(omega, alpha))
