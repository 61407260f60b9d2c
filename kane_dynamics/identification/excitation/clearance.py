"""
Collision avoidance for exciting motions: heights above a floor, distances between links.

Links have the simple shapes of the URDF: boxes, cylinders and spheres. They count as the
capsules around them: the points within a radius of the segment along the longest side.
Pairs of bodies that a joint connects are left out, and pairs of shapes whose capsules touch
at rest.

The distance of two capsules is that of their segments less the radii (Ericson, Real-Time
Collision Detection (2005), section 5.1.9).
"""

from collections.abc import Sequence
import math
from typing import NamedTuple
import warnings

from kane_dynamics._util.checks import number
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ModelWarning
from kane_dynamics.kinematics.body_poses import model_size
from kane_dynamics.model.link_shapes import (LinkShape, shapes_of_bodies,
                                             warn_of_unknown_links)
from kane_dynamics.model.model import Model, WORLD
from kane_dynamics.robot.robot import Robot
import numpy as np

DISTANCE = 0.05  # m, between links
NEAR = 0.5  # of the distance at rest: links that are nearer than DISTANCE there keep so much
AIM = 0.02  # m: how much further away the search stays
UNIT = 0.1  # m: a shortfall that counts as much as twice a limit of the joints
SMALL = 1e-12  # m^2
STEP = 1e-6  # of differences, rad or m
CHANGES = 1e-9  # m: less is rounding


class Capsule(NamedTuple):
    """The capsule around a shape, in the axes of its body's frame, m."""

    name: str
    body: int
    center: Array
    half: Array  # from the center to the end of the capsule's segment
    radius: float


class Clearance:
    """
    Heights of links above a floor and distances between them.

    Parameters
    ----------
    model : Model
        The arm.
    shapes : sequence of LinkShape
        Boxes, cylinders and spheres of its links; a rod replaces a link without any.
    floor : float or None
        Height in the world, m; None for no floor.
    distance : float or None
        Least distance between links, m; None for none.

    """

    def __init__(self, model: Model, shapes: Sequence[LinkShape], floor: float | None,
                 distance: float | None) -> None:
        """Select the shapes that may reach the floor, and the pairs of shapes that may collide."""
        warn_of_unknown_links(model, shapes, stacklevel=4)
        self.robot = Robot(model)
        self.floor = floor
        limits = self.robot.limits
        at_zero = np.clip(np.zeros(model.n), limits.lower, limits.upper)
        self._frames = {frame.body: frame for frame in reversed(model.frames)}
        self.shapes = []
        for body, visual in shapes_of_bodies(model, shapes, model_size(model, at_zero)):
            if body in self._frames:
                self.shapes.append(self._capsule(model, body, visual))
        self._bodies = sorted({shape.body for shape in self.shapes})

        # Pairs of bodies that no joint connects. A parent comes before its children.
        parents = [body.parent for body in model.bodies]
        pairs = []
        for i, first in enumerate(self.shapes):
            for j, second in enumerate(self.shapes):
                if first.body > second.body and parents[first.body] != second.body:
                    pairs.append((i, j))
        self.pairs = np.array(pairs, dtype=int).reshape(-1, 2)
        self.needed = np.zeros(0)

        # Shapes that touch at rest are left out, and all of them without a distance.
        at_rest = self.distances(at_zero[None])[0]
        least = np.inf if distance is None else 0.0
        apart = at_rest > least
        self.pairs = self.pairs[apart]
        self.needed = np.minimum(distance or 0.0, NEAR * at_rest[apart])

        # What no joint changes does not count: a link that turns about the vertical
        # stays as high as it is, a hub that turns about its own axis as far away.
        spread = np.random.default_rng(0).uniform(-1.0, 1.0, (20, model.n))
        configurations = np.vstack([at_zero, at_zero + spread])
        varying = np.ptp(self.distances(configurations), axis=0) > CHANGES
        self.pairs = self.pairs[varying]
        self.needed = self.needed[varying]
        self.moving = [k for k, shape in enumerate(self.shapes) if shape.body != WORLD]
        height_changes = np.ptp(self.heights(configurations), axis=0)
        self.moving = [k for k, change in zip(self.moving, height_changes, strict=True)
                       if change > CHANGES]

    def _capsule(self, model: Model, body: int, shape: LinkShape) -> Capsule:
        """Return the capsule of a shape, given in its body's axes, in those of its frame."""
        frame = self._frames[body]
        R = frame.rotation.T @ shape.pose[:3, :3]
        center = frame.rotation.T @ (shape.pose[:3, 3] - frame.translation)
        sizes = np.asarray(shape.size, dtype=float)
        # Its axis is the longest direction, its radius covers the others.
        half = np.zeros(3)
        radius = float(sizes[0])
        if shape.kind == 'box':
            k = int(np.argmax(sizes))
            half[k] = 0.5 * sizes[k]
            radius = 0.5 * float(np.linalg.norm(np.delete(sizes, k)))
        elif shape.kind == 'cylinder':
            half[2] = 0.5 * sizes[1]
        name = model.base_name if body == WORLD else model.bodies[body].name
        return Capsule(shape.link or name, body, center, R @ half, radius)

    def _segments(self, q: Array) -> tuple[Array, Array]:
        """Return centers of the shapes and halves of their segments, (N, shapes, 3) each."""
        poses = {}
        for body in self._bodies:
            frame = self._frames[body]
            # A shape on the base does not move: one pose stands for all configurations.
            if body == WORLD:
                fixed = np.eye(4)
                fixed[:3, :3] = frame.rotation
                fixed[:3, 3] = frame.translation
                poses[body] = np.broadcast_to(fixed, (len(q), 4, 4))
            else:
                poses[body] = self.robot.frame_pose(frame.name, q)
        centers, halves = [], []
        for shape in self.shapes:
            R, p = poses[shape.body][:, :3, :3], poses[shape.body][:, :3, 3]
            centers.append(R @ shape.center + p)
            halves.append(R @ shape.half)
        return np.stack(centers, axis=1), np.stack(halves, axis=1)

    def heights(self, q: Array) -> Array:
        """Return the heights of the k movable shapes in the world, (N, k), m, for q (N, n)."""
        centers, halves = (part[:, self.moving, 2] for part in self._segments(q))
        radii = np.array([self.shapes[k].radius for k in self.moving])
        return np.asarray(centers - np.abs(halves) - radii)

    def distances(self, q: Array) -> Array:
        """Return the distance between the capsules of each pair, (N, pairs), m, for q (N, n)."""
        centers, halves = self._segments(q)
        i, j = self.pairs.T
        first, second = closest_points(centers[:, i], halves[:, i], centers[:, j],
                                       halves[:, j])
        radii = np.array([shape.radius for shape in self.shapes])
        return np.asarray(np.linalg.norm(first - second, axis=2) - radii[i] - radii[j])

    def room(self, q: Array) -> Array:
        """Return heights and distances beyond those needed, (N, k + pairs), m, for q (N, n)."""
        floor = -np.inf if self.floor is None else self.floor
        return np.hstack([self.heights(q) - floor, self.distances(q) - self.needed])

    def shortfall(self, q: Array) -> Array:
        """Return the squared shortfall of room for q (N, n), (N,), in units of `UNIT`."""
        short = np.maximum(AIM - self.room(q), 0.0) / UNIT
        return np.asarray(np.sum(short**2, axis=1))

    def shortfall_slope(self, q: Array) -> Array:
        """Return the derivatives of `shortfall` by q, (N, n), by differences."""
        slope = np.zeros_like(q)
        squares = self.shortfall(q)
        short = squares > 0.0
        moved = q[short][:, None] + STEP * np.eye(q.shape[1])
        if short.any():
            ahead = self.shortfall(moved.reshape(-1, q.shape[1])).reshape(-1, q.shape[1])
            slope[short] = (ahead - squares[short, None]) / STEP
        return slope

    def lowest(self, q: Array) -> tuple[str, float] | None:
        """Return the lowest link along a periodic motion's samples, and its height, m."""
        if not self.moving:
            return None
        low = lower_bounds(self.heights(q))
        k = int(low.argmin())
        return self.shapes[self.moving[k]].name, float(low[k])

    def nearest(self, q: Array) -> tuple[str, str, float] | None:
        """Return the two links with the smallest distance along samples, and that distance, m."""
        if not len(self.pairs):
            return None
        near = lower_bounds(self.distances(q))
        i, j = self.pairs[int(near.argmin())]
        return self.shapes[j].name, self.shapes[i].name, float(near.min())

    def broken(self, q: Array) -> str | None:
        """Describe the clearance that a periodic motion violates; return None if there is none."""
        lowest = self.lowest(q)
        if self.floor is not None and lowest is not None and lowest[1] < self.floor:
            return f"link '{lowest[0]}' above {self.floor:g} m"
        # The pair that lacks most of the distance it needs.
        if len(self.pairs):
            surplus = lower_bounds(self.distances(q)) - self.needed
            k = int(surplus.argmin())
            if surplus[k] < 0.0:
                i, j = self.pairs[k]
                return (f"links '{self.shapes[j].name}' and '{self.shapes[i].name}' "
                        f'{self.needed[k]:.3g} m apart')
        return None


def clearance_of(model: Model, shapes: Sequence[LinkShape] | None, floor: float | None,
                 distance: float | None) -> Clearance | None:
    """
    Return the clearance of links above a floor and apart; None without floor and shapes.

    Without shapes links are rods, which are kept above a floor, not apart.
    """
    if floor is not None:
        floor = number(floor, 'floor', 'a finite height, m', math.isfinite)
    if distance is not None:
        distance = number(distance, 'distance', 'a finite number >= 0, m',
                          lambda x: 0.0 <= x < math.inf)
    if shapes is not None:
        return Clearance(model, shapes, floor, distance)
    if distance is not None:
        warnings.warn('shapes: None, so links are not kept apart, and are rods above a '
                      "floor; expected shapes=load_collision_shapes('arm.urdf'), or "
                      'distance=None', ModelWarning, stacklevel=3)
    return None if floor is None else Clearance(model, (), floor, None)


def lower_bounds(values: Array) -> Array:
    """
    Return lower bounds of periodic functions, (k,), at and between their samples, (N, k).

    Between samples h apart a function falls below both by h^2 max|f''| / 8, and a change
    of slope from one side to the other by no more than a quarter of the second
    difference.
    """
    second = np.roll(values, 1, axis=0) - 2.0 * values + np.roll(values, -1, axis=0)
    return np.asarray(values.min(axis=0) - 0.25 * np.abs(second).max(axis=0))


def closest_points(center_1: Array, half_1: Array, center_2: Array, half_2: Array
                   ) -> tuple[Array, Array]:
    """Return the closest points of segments center +- half, (..., 3) each, m."""
    def dot(x: Array, y: Array) -> Array:
        return np.asarray(np.sum(x * y, axis=-1, keepdims=True))
    # The distance of center +- half is quadratic in s and t, each from -1 to 1: minimise
    # along s without bounds, then clip t, then s once more.
    r = center_1 - center_2
    a, e = np.maximum(dot(half_1, half_1), SMALL), np.maximum(dot(half_2, half_2), SMALL)
    b, c, f = dot(half_1, half_2), dot(half_1, r), dot(half_2, r)
    determinant = a * e - b * b
    # Parallel segments have no unique s; the middle serves as well as any.
    parallel = determinant < 1e-9 * a * e
    s = np.clip(np.where(parallel, 0.0, (b * f - c * e) / np.where(parallel, 1.0,
                                                                   determinant)),
                -1.0, 1.0)
    t = np.clip((b * s + f) / e, -1.0, 1.0)
    s = np.clip((b * t - c) / a, -1.0, 1.0)
    return center_1 + s * half_1, center_2 + t * half_2
