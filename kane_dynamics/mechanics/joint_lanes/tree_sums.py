"""Sums over the joints of a tree whose quantities are in lanes, in the order of coordinates."""

from collections.abc import Sequence
from typing import Any

from kane_dynamics.mechanics.algebra.lanes import LANES
from kane_dynamics.mechanics.recursive.link import Link
from kane_dynamics.model.model import WORLD
import numpy as np


class TreeSums:
    """
    Packs quantities of a tree's joints and sums them along the tree.

    A quantity is a list of `parts`: arrays of rows, each of `LANES` joints in the order of their
    coordinates, zero after the last one.

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
        self.lanes, self.n = lanes, len(links)
        self._place = np.argsort([link.coordinate for link in links]).tolist()
        self.links = [links[i] for i in self._place]
        self.parents = [-1 if link.parent == WORLD else links[link.parent].coordinate
                        for link in self.links]
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
        return [np.array([self.lanes.pack(entries) for entries in zip(
            *by_coordinate[k:k + LANES], strict=True)]).reshape(shape)[()]
            for k in range(0, self.n, LANES)]

    def at(self, parts: Sequence[Any], sources: Sequence[int]) -> list[Any]:
        """Return the values of joint sources[r] at each joint r; 0 where that is negative."""
        # The lanes after a single part's last joint are 0: a permutation needs no other zeros.
        none = (0, LANES - 1) if self.n < LANES else None
        places = [none if k < 0 else divmod(k, LANES) for k in sources]
        places += [none] * (len(parts) * LANES - self.n)
        return [np.array([self.lanes.gathered(rows, places[k:k + LANES])
                          for rows in zip(*parts)]) for k in range(0, self.n, LANES)]

    def toward_root(self, parts: Sequence[Any]) -> list[Any]:
        """Return the sums over the joints that carry each joint, itself included."""
        return self._along(parts, self.parents)

    def from_origins(self, parts: Sequence[Any]) -> list[Any]:
        """
        Return the sums of steps from parent to link, on the way from the origin to each link.

        The origin of a tree is its last link on the longest path. Steps between it and the root,
        which may be much longer than those beyond, are not part of sums that do not need them.
        """
        after, way = [-1] * self.n, list(self.parents)
        on_path = [False] * self.n
        for r in self.origins():
            for link, before in zip(self.paths[r], [-1, *self.paths[r]]):
                after[link] = way[link] = before
                on_path[link] = True
        steps = [-x for x in self.at(parts, after)]
        if not all(on_path):
            masks = [[not on for on in on_path[k:k + LANES]] for k in range(0, self.n, LANES)]
            steps = [self.blended(mask, x, y) for mask, x, y in zip(masks, parts, steps)]
        return self._along(steps, way)

    def blended(self, mask: Sequence[bool], x: Any, y: Any) -> Any:
        """Return arrays of one part with the lanes of `x` where the mask is true, else of `y`."""
        mask = [*mask, *[mask[0]] * (LANES - len(mask))]
        return np.array([self.lanes.blend(mask, a, b) for a, b in zip(x, y)])

    def _along(self, parts: Sequence[Any], way: Sequence[int]) -> list[Any]:
        """Return the sums over each joint and those after it, way[r] after r."""
        # After each turn, the sums are those of twice as many joints.
        sums, source = list(parts), list(way)
        while max(source) >= 0:
            sums = [x + y for x, y in zip(sums, self.at(sums, source))]
            source = [source[k] if k >= 0 else -1 for k in source]
        return sums

    def over_subtrees(self, parts: Sequence[Any]) -> list[Any]:
        """Return the sums over the joints that each joint carries, itself included."""
        sums, distance = list(parts), 1
        while distance < max(map(len, self.paths)):
            below: list[list[int]] = [[] for _ in range(self.n)]
            for r, path in enumerate(self.paths):
                if len(path) > distance:
                    below[path[distance]].append(r)
            before, distance = sums, 2 * distance
            for k in range(max(map(len, below))):
                more = self.at(before, [found[k] if len(found) > k else -1 for found in below])
                sums = [x + y for x, y in zip(sums, more)]
        return sums

    def origins(self) -> list[int]:
        """Return the last joint of the longest path in each tree."""
        deepest: dict[int, int] = {}
        for r, path in enumerate(self.paths):
            if len(path) > len(self.paths[deepest.setdefault(path[-1], r)]):
                deepest[path[-1]] = r
        return list(deepest.values())
