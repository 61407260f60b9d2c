"""Forward kinematics of frames: poses, Jacobians and their rates, velocities; world axes."""

from collections.abc import Container, Sequence
from typing import Any, NamedTuple

from kane_dynamics.mechanics.algebra.vector import cross, rate_tensor
from kane_dynamics.mechanics.recursive.inverse_dynamics import JointStep
from kane_dynamics.mechanics.recursive.link import Link
from kane_dynamics.mechanics.recursive.link_frames import Z
from kane_dynamics.model.model import Frame, WORLD
import numpy as np


def link_poses(links: Sequence[Link], q: Any) -> list[tuple[Any, Any]]:
    """Return the axes (3, 3, columns) and the origin (3,) of all links in the world, m."""
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
        The link in whose axes, and from whose origin, the poses are; WORLD by default. Then
        `poses[WORLD]` is the pose of the world.

    """

    def __init__(self, links: Sequence[Link], q: Any, axes: int = WORLD) -> None:
        """Store the links and the coordinates."""
        self.links, self.q, self.axes = links, q, axes
        self._found: dict[int, tuple[Any, Any]] = {axes: (np.eye(3), np.zeros(3))}
        self.inward: dict[int, int] = {}  # of links and the world: the next link towards `axes`
        while axes != WORLD:
            self.inward[links[axes].parent] = axes
            axes = links[axes].parent

    def __getitem__(self, k: int) -> tuple[Any, Any]:
        """Return the axes (3, 3, columns) and the origin (3,) of a link or of the world, m."""
        for each in self.between(self._found, k):
            self._found[each] = (self._of_parent(self.inward[each]) if each in self.inward
                                 else self._of_child(each))
        return self._found[k]

    def between(self, found: Container[int], k: int) -> list[int]:
        """Return the links from those found to link k, without the former, away from `axes`."""
        way: list[int] = []
        while k not in found:
            way.append(k)
            k = self.inward[k] if k in self.inward else self.links[k].parent
        return way[::-1]

    def _of_child(self, k: int) -> tuple[Any, Any]:
        """Return the pose of link k from that of its parent."""
        step = JointStep(self.links[k], self.q)
        R, p = self[self.links[k].parent]
        x, y, z = (R @ step.rotation).T
        turned = np.stack([step.c * x + step.s * y, step.c * y - step.s * x, z], axis=1)
        return turned, R @ step.offset + p

    def _of_parent(self, k: int) -> tuple[Any, Any]:
        """Return the pose of the parent of link k from that of link k."""
        step = JointStep(self.links[k], self.q)
        R, p = self[k]
        x, y, z = R.T
        R = np.stack([step.c * x - step.s * y, step.s * x + step.c * y, z],
                     axis=1) @ step.rotation.T
        return R, p - R @ step.offset


def frame_in_link(links: Sequence[Link], frame: Frame) -> tuple[Any, Any]:
    """Return the constant axes and origin of a frame in its link (in the world if fixed)."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = frame.rotation, frame.translation
    if frame.body != WORLD:
        T = links[frame.body].body @ T
    return T[:3, :3], T[:3, 3]


def frame_axes(links: Sequence[Link], frame: Frame,
               poses: LinkPoses) -> tuple[Any, Any]:
    """Return axes (3, 3, columns) and origin (3,) of a frame, m, in the axes of the poses."""
    R, p = frame_in_link(links, frame)
    R_wl, p_wl = poses[frame.body]
    return R_wl @ R, R_wl @ p + p_wl


def frame_pose(links: Sequence[Link], frame: Frame, q: Any) -> Any:
    """Return the pose of a frame in the world, (4, 4)."""
    R, p = frame_axes(links, frame, LinkPoses(links, q))
    return np.concatenate([np.concatenate([R, p[:, None]], axis=1),
                           np.array([[0.0, 0.0, 0.0, 1.0]])])


def partial_velocities(links: Sequence[Link], frame: Frame, q: Any, at: Any = None,
                       poses: LinkPoses | None = None) -> Any:
    """
    Return the Jacobian (partial velocities) of a frame, (6, n): linear, then angular.

    With `at`, (3,), m, it is that of the point of the frame's body at this place. Vectors are in
    world axes, or in those of `poses`.

    With s_r the axis and p_r the origin of a joint between the base and the frame, its column is
    s_r x (p - p_r), s_r if revolute and s_r, 0 if prismatic. All other columns are zero.
    """
    columns: list[Any] = [np.zeros(6)] * len(q)
    poses = poses or LinkPoses(links, q)
    _, p_f = frame_in_link(links, frame)
    k = frame.body
    if k != WORLD:
        p_f = poses[k][0] @ p_f + poses[k][1] if at is None else at
    while k != WORLD:
        link, (R, p) = links[k], poses[k]
        s = R @ Z
        if link.kind == 'revolute':
            column = np.concatenate([cross(s, p_f - p), s])
        else:
            column = np.concatenate([s, np.zeros(3)])
        for r, weight in link.partials(q):
            columns[r] = columns[r] + weight * column
        k = link.parent
    return np.stack(columns, axis=1)


def partial_velocity_rates(links: Sequence[Link], frame: Frame, q: Any, u: Any) -> Any:
    """
    Return the time derivative of the Jacobian (`partial_velocities`), (6, n), for q' = u.

    With omega the angular velocity of the joint's link, the rate of its axis is s' = omega x s,
    and that of the column s x r of a revolute joint is s' x r + s x r'.
    """
    columns: list[Any] = [np.zeros(6)] * len(q)
    poses = LinkPoses(links, q)
    motions = LinkMotions(poses, u, np.zeros(len(q)).astype(object))
    r_f = poses[frame.body][0] @ frame_in_link(links, frame)[1]
    p_f = poses[frame.body][1] + r_f
    v_f = motions[frame.body].of_point(r_f)[0]
    k = frame.body
    while k != WORLD:
        link, (R, p), motion = links[k], poses[k], motions[k]
        s = R @ Z
        turning = cross(motion.omega, s)
        if link.kind == 'revolute':
            column = np.concatenate([cross(turning, p_f - p) + cross(s, v_f - motion.v), turning])
        else:
            column = np.concatenate([turning, np.zeros(3)])
        for r, weight in link.partials(q):
            columns[r] = columns[r] + weight * column
        for r, rate in link.partial_rates(u):
            along = ([*cross(s, p_f - p), *s] if link.kind == 'revolute' else [*s, *np.zeros(3)])
            columns[r] = columns[r] + rate * np.array(along)
        k = link.parent
    return np.stack(columns, axis=1)


def frame_motion(frame: Frame, poses: LinkPoses, u: Any, udot: Any) -> Any:
    """
    Return velocity and classical acceleration of a frame's origin, (2, 6), linear then angular.

    They are relative to the axes of `poses` and in these; gravity is not included.
    """
    motion = LinkMotions(poses, u, udot)[frame.body]
    v, a = motion.of_point(poses[frame.body][0] @ frame_in_link(poses.links, frame)[1])
    return np.stack([np.concatenate([v, motion.omega]), np.concatenate([a, motion.alpha])])


class LinkMotion(NamedTuple):
    """
    Motion of a link: angular velocity and acceleration, and those of its origin, (3,) each.

    `U` is the acceleration gradient of `rate_tensor`.
    """

    omega: Any
    alpha: Any
    v: Any
    a: Any
    U: Any

    def of_point(self, r: Any) -> tuple[Any, Any]:
        """Return velocity and acceleration of the link's point at r, (3,), from its origin."""
        return self.v + cross(self.omega, r), self.a + self.U @ r


class LinkMotions:
    """
    Motions of links relative to the axes of `poses`, in these, each computed at its first use.

    Parameters
    ----------
    poses : LinkPoses
    u, udot : (n,) arrays
        Rates and accelerations of the coordinates; rad or m, s.

    """

    def __init__(self, poses: LinkPoses, u: Any, udot: Any) -> None:
        """Store the poses and the motion of the coordinates."""
        self._poses, self._u, self._udot = poses, u, udot
        rest = np.zeros(3)
        self._found = {poses.axes: LinkMotion(rest, rest, rest, rest, np.zeros((3, 3)))}

    def __getitem__(self, k: int) -> LinkMotion:
        """Return the motion of a link or of the world."""
        inward = self._poses.inward
        for each in self._poses.between(self._found, k):
            self._found[each] = (self._of_parent(inward[each]) if each in inward
                                 else self._of_child(each))
        return self._found[k]

    def _of_child(self, k: int) -> LinkMotion:
        """Return the motion of link k from that of its parent."""
        parent = self._poses.links[k].parent
        before, (rate, acceleration) = self[parent], self._of_joint(k)
        v, a = before.of_point(self._poses[k][1] - self._poses[parent][1])
        across = cross(before.omega, rate)
        if self._poses.links[k].kind == 'revolute':
            return _motion(before.omega + rate, before.alpha + acceleration + across, v, a)
        return _motion(before.omega, before.alpha, v + rate, a + acceleration + 2.0 * across)

    def _of_parent(self, k: int) -> LinkMotion:
        """Return the motion of the parent of link k from that of link k."""
        parent = self._poses.links[k].parent
        after, (rate, acceleration) = self[k], self._of_joint(k)
        across = cross(after.omega, rate)
        if self._poses.links[k].kind == 'revolute':
            at = _motion(after.omega - rate, after.alpha - acceleration - across, after.v, after.a)
        else:
            at = _motion(after.omega, after.alpha, after.v - rate,
                         after.a - acceleration - 2.0 * across)
        v, a = at.of_point(self._poses[parent][1] - self._poses[k][1])
        return at._replace(v=v, a=a)

    def _of_joint(self, k: int) -> tuple[Any, Any]:
        """Return rate and acceleration of a joint along its axis, (3,) each."""
        link, s = self._poses.links[k], self._poses[k][0] @ Z
        q, u, udot = self._poses.q, self._u, self._udot
        return link.rate(q, u) * s, link.acceleration(q, u, udot) * s


def _motion(omega: Any, alpha: Any, v: Any, a: Any) -> LinkMotion:
    return LinkMotion(omega, alpha, v, a, rate_tensor(omega, alpha))
