"""Distances between the links of a robot, and from obstacles: checks for self-collision."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from kane_dynamics._util.checks import instance, real_numbers
from kane_dynamics._util.text import listing
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.kinematics.convex_distance import convex_distances, ConvexShapes
from kane_dynamics.model.link_shapes import (LinkShape, shapes_of_bodies,
                                             warn_of_unknown_links)
from kane_dynamics.model.model import Model, WORLD
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike, NDArray

KINDS = {'box': 3, 'cylinder': 2, 'sphere': 1}  # and the number of their sizes
CHUNK = 20_000  # pairs of shapes that are computed at a time


@dataclass(frozen=True, eq=False)
class NearestLinks:
    """
    The two links, or the link and the obstacle, that are nearest to each other.

    Attributes
    ----------
    distance : float
        m; 0 where they touch or overlap.
    links : (str, str)
        The two links; an obstacle comes last.
    points : (2, 3) array
        The nearest points of the two, world axes, m.
    row : int
        The row of a batch of configurations; 0 of a single one.

    """

    distance: float
    links: tuple[str, str]
    points: Array
    row: int = 0


class LinkDistances:
    """
    Distances between the links of a robot, and between links and obstacles.

    Links have simple shapes: boxes, cylinders, spheres, as `load_collision_shapes`
    returns them, with boxes around meshes. The distances of these shapes are exact;
    those of what they contain are not smaller. A link without a shape is a rod between
    its joints.

    Links that a joint connects are not compared, nor are shapes of links that overlap in
    the rest configuration, such as boxes around the meshes of neighbors: `left_out` names
    these pairs. Obstacles are compared with all moving links.

    Parameters
    ----------
    robot : Robot
        A robot of any kind; its links are rigid.
    shapes : sequence of LinkShape
        Shapes of its links.
    obstacles : sequence of LinkShape
        Shapes in world axes; `link` is the name of the obstacle.
    ignored : collection of (str, str)
        Further pairs of links, or of a link and an obstacle, that are not compared.
    rest : (n_q,) array_like, optional
        The rest configuration, rad or m; default: `Robot.feasible_configuration`.

    Attributes
    ----------
    pairs : tuple of (str, str)
        Compared pairs: two links, or a link and an obstacle.
    left_out : tuple of (str, str)
        Pairs of links whose shapes overlap in the rest configuration.

    Warns
    -----
    ModelWarning
        A shape is of a link that the model does not have, and is left out.

    Raises
    ------
    InputError
        An argument is invalid, or a name in `ignored` is unknown: names it.

    """

    def __init__(self, robot: Robot, shapes: Sequence[LinkShape],
                 obstacles: Sequence[LinkShape] = (), *,
                 ignored: Collection[tuple[str, str]] = (),
                 rest: ArrayLike | None = None) -> None:
        """Place the shapes on the bodies, and choose the pairs to compare."""
        instance(robot, Robot, 'robot')
        _check_shapes(shapes, 'shapes')
        _check_shapes(obstacles, 'obstacles')
        self._robot = robot
        model = robot.model
        warn_of_unknown_links(model, shapes, stacklevel=2)
        q_rest = robot.feasible_configuration() if rest is None else np.asarray(rest,
                                                                                dtype=float)
        self._place(model, shapes, obstacles, q_rest)
        self._shape_pairs = self._pairs_to_compare(model, ignored)

        # Links that overlap at rest are neighbors, of which no distance says anything. An
        # obstacle that overlaps a link at rest can be entered from other configurations.
        distances, _, _ = self._shape_distances(q_rest[None])
        is_link = self._shape_pairs[:, 1] < self._links
        overlapping = is_link & (distances[0] == 0.0)
        self.left_out = self._named(self._shape_pairs[overlapping])
        self._shape_pairs = self._shape_pairs[~overlapping]
        self.pairs = self._named(self._shape_pairs)
        # Several shapes of one link are compared with those of another: one distance a
        # pair of links.
        numbers = {pair: k for k, pair in enumerate(self.pairs)}
        self._pair_numbers = []
        for i, j in self._shape_pairs:
            self._pair_numbers.append(numbers[self._name_pair(i, j)])

    def __call__(self, q: ArrayLike) -> Array:
        """
        Return the distance of every pair, (len(pairs),) or (N, len(pairs)), m, 0 where they touch.

        Parameters
        ----------
        q : (n_q,) or (N, n_q) array_like
            Coordinates, rad or m.

        """
        states, single = self._states(q)
        distances, _, _ = self._shape_distances(states)
        by_pair = np.full((len(states), len(self.pairs)), np.inf)
        # A link may have several shapes: the nearest ones count.
        for column, pair in enumerate(self._pair_numbers):
            by_pair[:, pair] = np.minimum(by_pair[:, pair], distances[:, column])
        return by_pair[0] if single else by_pair

    def smallest(self, q: ArrayLike) -> Array:
        """Return the smallest of all distances, () or (N,), m; infinite if there is no pair."""
        distances = self(q)
        return np.asarray(distances.min(axis=-1, initial=np.inf))

    def nearest(self, q: ArrayLike) -> NearestLinks:
        """
        Return the two links that are nearest to each other at q, (n_q,), or at any q of (N, n_q).

        Raises
        ------
        InputError
            There is no pair to compare, or q is invalid.

        """
        if not self.pairs:
            raise InputError('pairs: none to compare; expected shapes of links that are '
                             'not neighbors, or obstacles')
        # Distances of all pairs at all configurations: the least of the whole array.
        states, _ = self._states(q)
        distances, first, second = self._shape_distances(states)
        state, pair = np.unravel_index(int(distances.argmin()), distances.shape)
        points = np.stack([first[state, pair], second[state, pair]])
        return NearestLinks(float(distances[state, pair]),
                            self._name_pair(*self._shape_pairs[pair]), points,
                            int(state))

    def _place(self, model: Model, shapes: Sequence[LinkShape],
               obstacles: Sequence[LinkShape],
               rest: Array) -> None:
        """Collect the shapes of the bodies, then the obstacles, with names and bodies."""
        placed = shapes_of_bodies(model, shapes, _size(self._robot, rest))
        # A body's own axes are those of its frames less their poses on it.
        self._frames = {frame.body: frame for frame in reversed(model.frames)}
        self._shapes: list[LinkShape] = []
        self._names: list[str] = []
        self._bodies: list[int] = []
        for body, shape in placed:
            if body != WORLD and body not in self._frames:
                continue  # a part of a joint, such as a section of a beam
            name = model.base_name if body == WORLD else model.bodies[body].name
            self._shapes.append(shape)
            self._names.append(shape.link or name)
            self._bodies.append(body)
        self._links = len(self._shapes)
        # Obstacles are fixed to the world, after all links, so that an index tells
        # which is which.
        for shape in obstacles:
            if shape.link in self._names[:self._links]:
                raise InputError(f"obstacles: '{shape.link}' is a link of the robot; "
                                 'expected another name')
            self._shapes.append(shape)
            self._names.append(shape.link)
            self._bodies.append(WORLD)
        self._convex = ConvexShapes.of(self._shapes)

    def _pairs_to_compare(self, model: Model, ignored: Collection[tuple[str, str]]
                          ) -> NDArray[np.intp]:
        """Return the pairs of shapes whose bodies are no neighbors, (p, 2)."""
        # Both orders of a pair that the user leaves out.
        without = set()
        for first, second in ignored:
            for name in (first, second):
                if name not in self._names:
                    raise InputError(f"ignored: '{name}' has no shape; expected names "
                                     f'of {listing(dict.fromkeys(self._names))}')
            without |= {(first, second), (second, first)}
        # Links are neighbors if no other link with a shape is between them.
        with_shapes = set(self._bodies)
        carriers = {body: _carrier(model, body, with_shapes) for body in self._bodies}
        pairs = []
        for j, body in enumerate(self._bodies):
            is_obstacle = j >= self._links
            for i in range(min(j, self._links)):
                other = self._bodies[i]
                if body == other:
                    continue
                neighbors = carriers[body] == other or carriers[other] == body
                # The base and what it carries are neighbors; an obstacle is a neighbor
                # of none.
                if neighbors and not is_obstacle:
                    continue
                if (self._names[i], self._names[j]) not in without:
                    pairs.append((i, j))
        return np.array(pairs, dtype=np.intp).reshape(-1, 2)

    def _states(self, q: ArrayLike) -> tuple[Array, bool]:
        """Return q as (N, n_q), and whether it was one state; frames check the numbers."""
        try:
            states = real_numbers(q)
        except (TypeError, ValueError):
            raise InputError(f'q: {q!r}; expected (n_q,) or (N, n_q) numbers') from None
        return np.atleast_2d(states), states.ndim == 1

    def _shape_distances(self, q: Array) -> tuple[Array, Array, Array]:
        """Return distances (N, p) of the pairs of shapes, and nearest points (N, p, 3)."""
        poses = self._shape_poses(q)
        i, j = self._shape_pairs.T
        shape = (len(q), len(i))
        distances = np.zeros(shape)
        first, second = np.zeros((2, *shape, 3))
        # Rows in blocks, so that memory stays bounded; each pair of each row is one
        # problem.
        at_a_time = max(1, CHUNK // max(len(i), 1))
        for begin in range(0, len(q), at_a_time):
            rows = slice(begin, begin + at_a_time)
            count = len(q[rows])
            results = convex_distances(
                self._convex[np.tile(i, count)], poses[rows][:, i].reshape(-1, 4, 4),
                self._convex[np.tile(j, count)], poses[rows][:, j].reshape(-1, 4, 4))
            distances[rows] = results[0].reshape(count, -1)
            first[rows] = results[1].reshape(count, -1, 3)
            second[rows] = results[2].reshape(count, -1, 3)
        return distances, first, second

    def _shape_poses(self, q: Array) -> Array:
        """Return the poses of all shapes, (N, k, 4, 4)."""
        of_bodies = {WORLD: np.broadcast_to(np.eye(4), (len(q), 4, 4))}
        # A body's pose follows from that of one of its frames.
        for body in set(self._bodies) - {WORLD}:
            frame = self._frames[body]
            on_body = np.eye(4)
            on_body[:3, :3] = frame.rotation
            on_body[:3, 3] = frame.translation
            of_bodies[body] = self._robot.frame_pose(frame.name,
                                                     q) @ np.linalg.inv(on_body)
        poses = [of_bodies[body] @ shape.pose
                 for body, shape in zip(self._bodies, self._shapes, strict=True)]
        return np.stack(poses, axis=1)

    def _name_pair(self, i: int, j: int) -> tuple[str, str]:
        """Return the names of two shapes."""
        return self._names[i], self._names[j]

    def _named(self, shape_pairs: NDArray[np.intp]) -> tuple[tuple[str, str], ...]:
        """Return the names of pairs of shapes, each pair once."""
        return tuple(dict.fromkeys(self._name_pair(i, j) for i, j in shape_pairs))


def _carrier(model: Model, body: int, with_shapes: Collection[int]) -> int:
    """Return the nearest body towards the base that has a shape, or WORLD."""
    while body != WORLD:
        body = model.bodies[body].parent
        if body in with_shapes:
            return body
    return WORLD


def _size(robot: Robot, q: Array) -> float:
    """Return the diagonal of the box around all frames at q, m; 1 if they coincide."""
    origins = np.stack([robot.frame_pose(frame, q)[:3, 3] for frame in robot.frame_names])
    return float(np.linalg.norm(np.ptp(origins, axis=0))) or 1.0


def _check_shapes(shapes: Sequence[LinkShape], what: str) -> None:
    """Raise InputError unless these are boxes, cylinders and spheres."""
    if isinstance(shapes, LinkShape) or not isinstance(shapes, Sequence):
        raise InputError(f'{what}: a {type(shapes).__name__}; expected a sequence of '
                         'LinkShape, such as of load_collision_shapes')
    for shape in shapes:
        instance(shape, LinkShape, what)
        # Each kind has a number of sizes: a box 3, a cylinder 2, a sphere 1.
        sizes = np.asarray(shape.size, dtype=np.float64)
        if shape.kind not in KINDS:
            raise InputError(f"{what}: '{shape.link}': kind '{shape.kind}'; expected "
                             f'one of {", ".join(KINDS)}: load_collision_shapes makes '
                             'boxes of meshes')
        number = KINDS[shape.kind]
        if sizes.shape != (number,) or not (np.isfinite(sizes) & (sizes >= 0.0)).all():
            raise InputError(f"{what}: '{shape.link}': size {sizes.tolist()} of a "
                             f'{shape.kind}; expected {number} finite numbers >= 0, m')
        # The pose of the shape on its link.
        pose = np.asarray(shape.pose, dtype=np.float64)
        if pose.shape != (4, 4) or not np.isfinite(pose).all():
            raise InputError(f"{what}: '{shape.link}': pose of shape {pose.shape}; "
                             'expected a finite (4, 4) array, such as of pose_from')
