"""Sums over the joints of a tree whose quantities are in lanes, by coordinate."""

from collections.abc import Sequence
from typing import Any

from kane_dynamics._util.typing import Vector
from kane_dynamics.mechanics.algebra.lanes import LANES
from kane_dynamics.mechanics.recursive.link import Link
from kane_dynamics.model.model import WORLD
import numpy as np


class TreeSums:
    """
    Packs quantities of a tree's joints and sums them along the tree.

    A quantity is a list of `parts`: arrays of rows, each of `LANES` joints in the order
    of their coordinates, zero after the last one.

    Parameters
    ----------
    links : sequence of Link
        Parents before children, each moved by a coordinate of its own.
    lanes : object
        Has the functions of `Lanes`.

    Attributes
    ----------
    n : int
        Number of joints.
    links : list of Link
        By coordinate.
    paths : list of lists of int
        Coordinates of the joints that carry each joint: its own first, the root's last.

    """

    def __init__(self, links: Sequence[Link], lanes: Any) -> None:
        """Find the paths."""
        self.lanes = lanes
        self.n = len(links)
        # Links may have their coordinates in any order.
        self._place = np.argsort([link.coordinate for link in links]).tolist()
        self.links = [links[i] for i in self._place]
        self.parents: list[int] = []  # coordinates of parents' joints; -1 for the world
        for link in self.links:
            if link.parent == WORLD:
                self.parents.append(-1)
            else:
                self.parents.append(links[link.parent].coordinate)
        self.paths: list[list[int]] = []
        for r in range(self.n):
            path = [r]
            while self.parents[path[-1]] >= 0:
                path.append(self.parents[path[-1]])
            self.paths.append(path)

    def packed(self, values: Sequence[Any]) -> list[Any]:
        """Return the parts of arrays of one shape, given in the order of the links."""
        shape = np.shape(values[0])
        by_coordinate = [np.ravel(values[i]) for i in self._place]
        parts = []
        for k in range(0, self.n, LANES):
            entries = zip(*by_coordinate[k:k + LANES], strict=True)
            rows = np.array(list(map(self.lanes.pack, entries)))
            parts.append(rows.reshape(shape)[()])
        return parts

    def at(self, parts: Sequence[Vector], sources: Sequence[int]) -> list[Vector]:
        """Return the values of joint sources[r] at each joint r; 0 if negative."""
        # The lanes after a single part's last joint are 0:
        # a permutation needs no other zeros.
        zero = (0, LANES - 1) if self.n < LANES else None
        places = [zero] * (len(parts) * LANES)
        for r, source in enumerate(sources):
            if source >= 0:
                places[r] = divmod(source, LANES)
        result = []
        for k in range(0, self.n, LANES):
            in_part = places[k:k + LANES]
            gathered = [self.lanes.gathered(rows, in_part) for rows in zip(*parts)]
            result.append(np.array(gathered))
        return result

    def toward_root(self, parts: Sequence[Vector]) -> list[Vector]:
        """Return the sums over the joints that carry each joint, itself included."""
        return self._along(parts, self.parents)

    def from_origins(self, parts: Sequence[Vector]) -> list[Vector]:
        """
        Return the sums of steps from parent to link, from the origin to each link.

        The origin of a tree is its last link on the longest path. Steps between it and
        the root, which may be much longer than those beyond, are not part of sums that
        do not need them.
        """
        # Between the origin and the root, the path runs from child to parent, and its
        # step is the child's, backward.
        child = [-1] * self.n
        previous = list(self.parents)
        on_path = [False] * self.n
        for r in self.origins():
            path = self.paths[r]
            for link, link_nearer in zip(path, [-1, *path]):
                child[link] = link_nearer
                previous[link] = link_nearer
                on_path[link] = True
        backward = [-x for x in self.at(parts, child)]
        if all(on_path):
            return self._along(backward, previous)

        # All other links are reached forward, by their own step.
        steps = []
        for k, forward, back in zip(range(0, self.n, LANES), parts, backward):
            mask = [not on for on in on_path[k:k + LANES]]
            steps.append(self.blended(mask, forward, back))
        return self._along(steps, previous)

    def blended(self, mask: Sequence[bool], x: Vector, y: Vector) -> Vector:
        """Return arrays of one part: of `x` where the mask is true, else of `y`."""
        mask = [*mask, *[mask[0]] * (LANES - len(mask))]
        return np.array([self.lanes.blend(mask, a, b) for a, b in zip(x, y)])

    def _along(self, parts: Sequence[Vector], previous: Sequence[int]) -> list[Vector]:
        """Return for each joint the sum over it and all joints before it, by `previous`."""
        # After each turn, the sums are those of twice as many joints.
        sums = list(parts)
        source = list(previous)
        while max(source) >= 0:
            farther = self.at(sums, source)
            sums = [x + y for x, y in zip(sums, farther)]
            source = [source[k] if k >= 0 else -1 for k in source]
        return sums

    def over_subtrees(self, parts: Sequence[Vector]) -> list[Vector]:
        """Return the sums over the joints that each joint carries, itself included."""
        # After each turn, the sums are those of joints up to twice the distance.
        sums = list(parts)
        distance = 1
        while distance < max(map(len, self.paths)):
            below: list[list[int]] = [[] for _ in range(self.n)]
            for r, path in enumerate(self.paths):
                if len(path) > distance:
                    below[path[distance]].append(r)

            # Joints may carry several at this distance: the k-th of each at once.
            nearer = sums
            for k in range(max(map(len, below))):
                sources = [joints[k] if k < len(joints) else -1 for joints in below]
                farther = self.at(nearer, sources)
                sums = [x + y for x, y in zip(sums, farther)]
            distance = 2 * distance
        return sums

    def origins(self) -> list[int]:
        """Return the last joint of the longest path in each tree."""
        deepest: dict[int, int] = {}
        for r, path in enumerate(self.paths):
            root = path[-1]
            deepest.setdefault(root, r)
            if len(path) > len(self.paths[deepest[root]]):
                deepest[root] = r
        return list(deepest.values())
