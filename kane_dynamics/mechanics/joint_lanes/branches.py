"""
Branches of a tree: joints in series, in blocks of as many as a row of lanes has.

A branch ends at the last joint, or where several follow. Blocks at its end are filled
with joints that do not move, whose links have no mass.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from kane_dynamics._util.typing import Matrix, Vector
from kane_dynamics.mechanics.algebra.lanes import LANES
from kane_dynamics.mechanics.recursive.link import Link
from kane_dynamics.model.model import WORLD
import numpy as np


# Values of the links, and that of joints that fill the last block.
Column = tuple[Sequence[Any], float]


@dataclass
class Branch:
    """
    Joints in series.

    Attributes
    ----------
    parent : int or None
        Number of the branch that carries it; None for the world.
    links : list of int
        Indices of its links, the first one nearest to the world.
    children : list of int
        Numbers of the branches that it carries.

    """

    parent: int | None
    links: list[int]
    children: list[int] = field(default_factory=list)

    @property
    def blocks(self) -> int:
        """Return the number of blocks."""
        return -(-len(self.links) // LANES)

    def by_blocks(self, values: Sequence[Any], filled: Any) -> Matrix:
        """Return a value of each link, by its index, in blocks: (blocks, LANES)."""
        entries = [values[k] for k in self.links]
        entries += [filled] * (self.blocks * LANES - len(entries))
        return np.array(entries, dtype=object).reshape(self.blocks, LANES)


def branches(links: Sequence[Link]) -> list[Branch]:
    """Return the branches of a tree, parents before children."""
    parents = [link.parent for link in links]
    result: list[Branch] = []
    number: dict[int, int] = {}  # of the branch of each link
    for k, parent in enumerate(parents):
        # An only child continues the branch of its parent; others begin one.
        if parent != WORLD and parents.count(parent) == 1:
            number[k] = number[parent]
            result[number[k]].links.append(k)
            continue
        number[k] = len(result)
        carrier = None if parent == WORLD else number[parent]
        if carrier is not None:
            result[carrier].children.append(number[k])
        result.append(Branch(carrier, [k]))
    return result


class Columns:
    """
    Constants of joints, in columns of one table; columns with one value are left out.

    Parameters
    ----------
    branches : sequence of Branch
    columns : sequence of Column

    Attributes
    ----------
    tables : list of (blocks, LANES m) arrays
        Of the columns that are left, for each branch.

    """

    def __init__(self, branches: Sequence[Branch], columns: Sequence[Column]) -> None:
        """Find the columns with one value."""
        self._constants: list[float | None] = []
        parts: list[list[Matrix]] = [[] for _ in branches]
        for values, filled in columns:
            blocks = [branch.by_blocks(values, filled) for branch in branches]
            constant = _common_value(blocks)
            self._constants.append(constant)
            # A column with one value in all blocks stays a constant of the program.
            if constant is None:
                for part, block in zip(parts, blocks):
                    part.append(block)
        self.tables: list[Matrix] = []
        for branch, part in zip(branches, parts):
            empty = np.zeros((branch.blocks, 0), dtype=object)
            self.tables.append(np.concatenate([empty, *part], axis=1))

    def rows(self, row: Vector, lanes: Any) -> list[Any]:
        """Return all columns of one block as rows of lanes, from a row of a table."""
        result = []
        begin = 0
        for constant in self._constants:
            # A constant column has no entries in the row.
            if constant is not None:
                result.append(constant)
                continue
            result.append(lanes.pack(list(row[begin:begin + LANES])))
            begin += LANES
        return result


def _common_value(blocks: Sequence[Matrix]) -> float | None:
    """Return the number that all entries are, or None."""
    values = set()
    for block in blocks:
        for x in block.flat:
            # An expression is computed, whatever its value.
            if not isinstance(x, (int, float)):
                return None
            values.add(float(x))
    return values.pop() if len(values) == 1 else None
