"""Forward kinematics of frames: poses, Jacobians and their rates, velocities; world axes."""

from collections.abc import Sequence
from typing import Any

from kane_dynamics.mechanics.algebra.vector import cross
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
        self._links, self._q = links, q
        self._found: dict[int, tuple[Any, Any]] = {axes: (np.eye(3), np.zeros(3))}
        self._inward: dict[int, int] = {}  # of links and the world: the next link towards `axes`
        while axes != WORLD:
            self._inward[links[axes].parent] = axes
            axes = links[axes].parent

    def __getitem__(self, k: int) -> tuple[Any, Any]:
        """Return the axes (3, 3, columns) and the origin (3,) of a link or of the world, m."""
        if k not in self._found:
            if k in self._inward:
                self._found[k] = self._of_parent(self._inward[k])
            else:
                self._found[k] = self._of_child(k)
        return self._found[k]

    def _of_child(self, k: int) -> tuple[Any, Any]:
        """Return the pose of link k from that of its parent."""
        step = JointStep(self._links[k], self._q)
        R, p = self[self._links[k].parent]
        x, y, z = (R @ step.rotation).T
        turned = np.stack([step.c * x + step.s * y, step.c * y - step.s * x, z], axis=1)
        return turned, R @ step.offset + p

    def _of_parent(self, k: int) -> tuple[Any, Any]:
        """Return the pose of the parent of link k from that of link k."""
        step = JointStep(self._links[k], self._q)
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
    if frame.body == WORLD:
        return np.stack(columns, axis=1)
    poses = link_poses(links, q)
    motion = _motions(links, poses, q, u, np.zeros(len(q)).astype(object))
    r_f = poses[frame.body][0] @ frame_in_link(links, frame)[1]
    p_f = poses[frame.body][1] + r_f
    v_f = motion[frame.body][2] + cross(motion[frame.body][0], r_f)
    k = frame.body
    while k != WORLD:
        link, (R, p), (omega, _, v, _) = links[k], poses[k], motion[k]
        s = R @ Z
        turning = cross(omega, s)
        if link.kind == 'revolute':
            column = np.concatenate([cross(turning, p_f - p) + cross(s, v_f - v), turning])
        else:
            column = np.concatenate([turning, np.zeros(3)])
        for r, weight in link.partials(q):
            columns[r] = columns[r] + weight * column
        for r, rate in link.partial_rates(u):
            along = ([*cross(s, p_f - p), *s] if link.kind == 'revolute' else [*s, *np.zeros(3)])
            columns[r] = columns[r] + rate * np.array(along)
        k = link.parent
    return np.stack(columns, axis=1)


def frame_motion(links: Sequence[Link], frame: Frame, q: Any, u: Any, udot: Any) -> Any:
    """
    Return velocity and classical acceleration of a frame, (2, 6), linear then angular.

    World axes, at the frame's origin; gravity is not included.
    """
    if frame.body == WORLD:
        return np.zeros((2, 6))
    poses = link_poses(links, q)
    omega, alpha, v, a = _motions(links, poses, q, u, udot)[frame.body]
    v, a = _point_motion(omega, alpha, v, a, poses[frame.body][0] @ frame_in_link(links, frame)[1])
    return np.stack([np.concatenate([v, omega]), np.concatenate([a, alpha])])


def _motions(links: Sequence[Link], poses: Sequence[tuple[Any, Any]], q: Any, u: Any,
             udot: Any) -> list[tuple[Any, Any, Any, Any]]:
    """Return omega, alpha, v and a of all links' origins, world axes, without gravity."""
    motion: list[tuple[Any, Any, Any, Any]] = []
    zero = np.zeros(3)
    for link, (R, p) in zip(links, poses):
        omega, alpha, v, a, origin = zero, zero, zero, zero, zero
        if link.parent != WORLD:
            omega, alpha, v, a = motion[link.parent]
            origin = poses[link.parent][1]
        v, a = _point_motion(omega, alpha, v, a, p - origin)
        rate, acceleration = link.rate(q, u) * (R @ Z), link.acceleration(q, u, udot) * (R @ Z)
        if link.kind == 'revolute':
            motion.append((omega + rate, alpha + acceleration + cross(omega, rate), v, a))
        else:
            motion.append((omega, alpha, v + rate, a + acceleration + 2.0 * cross(omega, rate)))
    return motion


def _point_motion(omega: Any, alpha: Any, v: Any, a: Any, r: Any) -> tuple[Any, Any]:
    """Return velocity and acceleration of a body's point at r from its origin."""
    across = cross(omega, r)
    return v + across, a + cross(alpha, r) + cross(omega, across)
