"""Loops over the parts of a tree: eight joints each, whose quantities are in lanes."""

from collections.abc import Callable, Sequence
from typing import Any

from kane_dynamics._util.typing import Matrix, Vector
from kane_dynamics.mechanics.algebra.lanes import LANES
from kane_dynamics.mechanics.joint_lanes.block_rows import packed_rows, unpacked
from kane_dynamics.mechanics.joint_lanes.joint_blocks import LanesOf
from kane_dynamics.mechanics.recursive.subroutines import Repeat
import numpy as np

Rows = Sequence[Any]


def of_each_part(name: str, function: Callable[..., Rows], tables: Sequence[Sequence[Rows]],
                 lanes: Any, lanes_of: LanesOf, repeat: Repeat) -> list[Vector]:
    """
    Return rows of each part by a loop, so that code does not grow with their number.

    Parameters
    ----------
    name : str
        Identifies the function, as for `repeat`.
    function : callable
        Takes the functions of lanes and, from each table, the rows of a part; returns
        rows.
    tables : sequence
        Each has rows for each part. Several loops may have the same.
    lanes : object
        The functions of lanes of these rows.
    lanes_of, repeat
        As of `JointBlocks`.

    """
    # Constants stay in the code; numbers and computed rows become arrays.
    split = [_SplitTable(parts, lanes) for parts in tables]
    arrays: list[Matrix] = []
    for table in split:
        arrays += [table.numbers, table.computed]

    def step(carry: Vector, *entries: Vector) -> Vector:
        step_lanes = lanes_of(np.concatenate(entries)[0])
        # The rows of one part, put together from its entries in both arrays.
        rows = []
        for k, table in enumerate(split):
            rows.append(table.rows(entries[2 * k], entries[2 * k + 1], step_lanes))
        return np.array(unpacked(function(step_lanes, *rows), step_lanes))

    nothing = np.zeros(0).astype(object)
    results = repeat(name, step, nothing, *arrays)
    return [packed_rows(result, lanes) for result in results]


class _SplitTable:
    """
    Rows of each part, by what is known of them before a loop.

    A row with one number in all parts is a constant of the step. Rows of other numbers
    are a table that nothing computes.

    Attributes
    ----------
    numbers, computed : (parts, LANES k) arrays
        Entries of rows that are not constants.

    """

    def __init__(self, parts: Sequence[Rows], lanes: Any) -> None:
        """Split the rows."""
        entries = [unpacked(rows, lanes) for rows in parts]
        table = np.array(entries, dtype=object).reshape(len(parts), -1, LANES)
        self._constants: list[float | None] = []
        self._is_computed: list[bool] = []
        # Rows of three kinds: one number for all parts,
        # other numbers, and computed entries.
        for k in range(table.shape[1]):
            row = table[:, k].ravel().tolist()
            computed = not all(isinstance(x, (int, float)) for x in row)
            is_constant = not computed and len(set(row)) == 1
            self._constants.append(row[0] if is_constant else None)
            self._is_computed.append(computed)
        numbers = []
        for constant, computed in zip(self._constants, self._is_computed):
            numbers.append(constant is None and not computed)
        self.numbers = table[:, numbers].reshape(len(parts), -1)
        self.computed = table[:, self._is_computed].reshape(len(parts), -1)

    def rows(self, numbers: Vector, computed: Vector, lanes: Any) -> list[Any]:
        """Return the rows of one part from its entries."""
        # Rows are in the order of the table, whatever array they come from.
        of_numbers = iter(packed_rows(numbers, lanes))
        of_computed = iter(packed_rows(computed, lanes))
        rows: list[Any] = []
        for constant, is_computed in zip(self._constants, self._is_computed):
            if constant is not None:
                rows.append(constant)
            elif is_computed:
                rows.append(next(of_computed))
            else:
                rows.append(next(of_numbers))
        return rows


def joint_by_joint(rows: Rows, lanes: Any) -> list[Any]:
    """
    Return rows of joints from rows whose lanes are joints.

    These are the first joint's entries, in as many rows as they fill, then those of the
    others.
    """
    # A transposed block of rows has a row for each joint.
    columns = []
    for begin in range(0, len(rows), LANES):
        columns.append(lanes.transposed(rows[begin:begin + LANES]))
    of_joints: list[Any] = []
    for joint in range(LANES):
        of_joints.extend(column[joint] for column in columns)
    return of_joints


def row_by_row(of_joints: Rows, count: int, lanes: Any) -> Vector:
    """Return `count` rows whose lanes are joints, from rows of joints."""
    in_joint = len(of_joints) // LANES
    rows: list[Any] = []
    for k in range(in_joint):
        rows.extend(lanes.transposed(of_joints[k::in_joint]))
    return np.array(rows[:count], dtype=object)
