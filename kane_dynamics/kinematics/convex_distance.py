"""
Distances between convex shapes by the algorithm of Gilbert, Johnson and Keerthi, many at a time.

The distance of two convex shapes is that of the origin from the set of their differences
(Gilbert, Johnson & Keerthi, IEEE J. Robotics and Automation 4 (1988); van den Bergen, J.
Graphics Tools 4 (1999)). A simplex of at most four points of that set moves towards the
origin: its point nearest to the origin is v, and the point of the set farthest along -v
joins it, until none is farther than v. All pairs of shapes iterate together; those that
have ended are left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.model.link_shapes import LinkShape
import numpy as np
from numpy.typing import NDArray

ITERATIONS = 200  # round shapes need tens of them
CLOSE = 1e-10  # relative error of the squared distance
TOUCHING = 1e-24  # m^2: squared distance of shapes that touch
FLAT = 1e-14  # relative determinant of a simplex without area or volume
Rows = NDArray[np.intp]  # numbers of rows
SUBSETS = tuple(subset for size in range(1, 5) for subset in combinations(range(4),
                                                                          size))


@dataclass(frozen=True, eq=False)
class ConvexShapes:
    """
    Boxes, cylinders and spheres in one form: the sum of a box, a disc about z, and a ball.

    Attributes
    ----------
    half : (k, 3) array
        Half the edges of the box, m.
    disc, ball : (k,) arrays
        Radii, m.

    """

    half: Array
    disc: Array
    ball: Array

    @classmethod
    def of(cls, shapes: Sequence[LinkShape]) -> 'ConvexShapes':
        """Return the shapes of links; none is a mesh."""
        # A shape is the sum of a box, a disc and a ball, of which two have no size.
        half = np.zeros((len(shapes), 3))
        disc = np.zeros(len(shapes))
        ball = np.zeros(len(shapes))
        for k, shape in enumerate(shapes):
            if shape.kind == 'box':
                half[k] = 0.5 * np.asarray(shape.size)
            elif shape.kind == 'cylinder':
                disc[k] = shape.size[0]
                half[k, 2] = 0.5 * shape.size[1]
            else:
                ball[k] = shape.size[0]
        return cls(half, disc, ball)

    def __getitem__(self, chosen: Rows) -> 'ConvexShapes':
        """Return some of the shapes."""
        return ConvexShapes(self.half[chosen], self.disc[chosen], self.ball[chosen])

    def farthest(self, direction: Array) -> Array:
        """Return the farthest points along directions, (k, 3), before rounding by balls."""
        points = np.where(direction >= 0.0, self.half, -self.half)
        across = direction[:, :2]
        length = np.linalg.norm(across, axis=1, keepdims=True)
        points[:, :2] += self.disc[:, None] * across / np.maximum(length,
                                                                  np.finfo(float).tiny)
        return points


def convex_distances(first: ConvexShapes, first_poses: Array, second: ConvexShapes,
                     second_poses: Array) -> tuple[Array, Array, Array]:
    """
    Return the distances of k pairs of shapes, and their nearest points.

    Parameters
    ----------
    first, second : ConvexShapes
        The k first shapes, and the k second ones.
    first_poses, second_poses : (k, 4, 4) arrays
        m.

    Returns
    -------
    distances : (k,) array
        m; 0 where the shapes touch or overlap.
    points_of_first, points_of_second : (k, 3) arrays
        In the axes of the poses, m; any common region's points where the shapes overlap.

    """
    points = _Differences(first, first_poses, second, second_poses)
    count = len(first.half)
    corners = np.zeros((count, 4, 3))  # of the simplexes; first minus second
    parts = np.zeros((count, 4, 3))  # the points of the first shapes in them
    weights = np.zeros((count, 4))  # of the corners, in v; 0 for those that are not in use
    toward = first_poses[:, :3, 3] - second_poses[:, :3, 3]
    corners[:, 0], parts[:, 0] = points.farthest(np.arange(count), -toward)
    weights[:, 0] = 1.0
    v = corners[:, 0].copy()
    active = np.arange(count)
    for _ in range(ITERATIONS):
        squares = np.sum(v[active]**2, axis=1)
        corner, part = points.farthest(active, -v[active])
        # No point of the set is nearer to the origin than v.w / |v|.
        gain = squares - np.sum(v[active] * corner, axis=1)
        going = (squares > TOUCHING) & (gain > CLOSE * squares)
        active = active[going]
        if not len(active):
            break
        # A corner without weight is free: the nearest point of a simplex lies in a
        # facet, or the origin is inside, which has ended.
        free = np.argmin(weights[active], axis=1)
        corners[active, free] = corner[going]
        parts[active, free] = part[going]
        used = weights[active] > 0.0
        used[np.arange(len(active)), free] = True
        weights[active] = _nearest_weights(corners[active], used)
        nearest = np.einsum('ki,kij->kj', weights[active], corners[active])
        v[active] = nearest
        # Rounding ends the approach when a step does not shorten v.
        shorter = np.sum(nearest**2, axis=1) < squares[going]
        active = active[shorter]
    core = np.linalg.norm(v, axis=1)
    core[core**2 <= TOUCHING] = 0.0  # rounding of an origin inside of the simplex
    on_first = np.einsum('ki,kij->kj', weights, parts)
    # The balls reach towards each other along v.
    unit = v / np.maximum(core, np.sqrt(TOUCHING))[:, None]
    distances = np.maximum(core - first.ball - second.ball, 0.0)
    return (distances, on_first - first.ball[:, None] * unit,
            on_first - v + second.ball[:, None] * unit)


@dataclass(frozen=True, eq=False)
class _Differences:
    """Differences of the points of two shapes, without their balls."""

    first: ConvexShapes
    first_poses: Array
    second: ConvexShapes
    second_poses: Array

    def farthest(self, pairs: Rows, direction: Array) -> tuple[Array, Array]:
        """Return the farthest differences of pairs along (k, 3), and their first points."""
        on_first = _farthest(self.first[pairs], self.first_poses[pairs], direction)
        on_second = _farthest(self.second[pairs], self.second_poses[pairs], -direction)
        return on_first - on_second, on_first


def _farthest(shapes: ConvexShapes, poses: Array, direction: Array) -> Array:
    """Return the points of placed shapes that are farthest along directions, (k, 3)."""
    R = poses[:, :3, :3]
    own_axes = np.einsum('kij,ki->kj', R, direction)
    points = np.einsum('kij,kj->ki', R, shapes.farthest(own_axes))
    return np.asarray(points + poses[:, :3, 3])


def _nearest_weights(corners: Array, used: Flags) -> Array:
    """
    Return the weights of simplexes' corners, (k, 4), at their points nearest to the origin.

    Of every subset of the corners the point of its plane nearest to the origin counts if
    it lies within the subset; the nearest of these points is that of the simplex.
    """
    count = len(corners)
    best = np.full(count, np.inf)
    weights = np.zeros((count, 4))
    # The nearest point is inside one of the corners, edges, faces or the volume: try
    # every subset.
    for subset in SUBSETS:
        chosen = corners[:, subset]
        between, of_subset = _plane_weights(chosen)
        inside = between & used[:, subset].all(axis=1)
        point = np.einsum('ki,kij->kj', of_subset, chosen)
        square = np.sum(point**2, axis=1)
        # Of the subsets with the point inside them, the one nearest to the origin.
        nearer = np.flatnonzero(inside & (square < best))
        best[nearer] = square[nearer]
        weights[nearer] = 0.0
        weights[nearer[:, None], np.array(subset)] = of_subset[nearer]
    return weights


def _plane_weights(corners: Array) -> tuple[Flags, Array]:
    """Return whether the nearest point of the corners' plane is between them, and its weights."""
    count, size, _ = corners.shape
    weights = np.ones((count, size))
    if size == 1:
        return np.ones(count, dtype=bool), weights

    # Minimise |origin + edges w|^2: the normal equations with the Gram matrix of the
    # edges.
    origin = corners[:, 0]
    edges = corners[:, 1:] - origin[:, None]
    gram = np.einsum('kia,kja->kij', edges, edges)
    right = -np.einsum('kia,ka->ki', edges, origin)
    # Edges that are nearly parallel have no plane; a smaller subset has the point then.
    scale = np.prod(np.einsum('kii->ki', gram), axis=1)
    determinant = np.linalg.det(gram)
    regular = determinant > FLAT * scale
    gram[~regular] = np.eye(size - 1)
    weights[:, 1:] = np.linalg.solve(gram, right[:, :, None])[:, :, 0]
    weights[:, 0] = 1.0 - weights[:, 1:].sum(axis=1)
    return regular & (weights > 0.0).all(axis=1), weights
