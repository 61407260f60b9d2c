"""
Rows of lanes of a block of joints: their entries in memory, sums along the block.

A joint's quantity is in the lane of its place in the block. Vectors are arrays of rows.
"""

from collections.abc import Sequence
from typing import Any

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.lanes import LANES
import numpy as np


def packed_rows(entries: Vector, lanes: Any) -> Vector:
    """Return rows of lanes from their entries."""
    rows = [lanes.pack(list(row)) for row in entries.reshape(-1, LANES)]
    return np.array(rows, dtype=object)


def unpacked(rows: Sequence[Any], lanes: Any) -> list[Scalar]:
    """Return the entries of rows of lanes."""
    entries: list[Scalar] = []
    for row in rows:
        entries.extend(lanes.lane(row, k) for k in range(LANES))
    return entries


def of_joint(rows: Sequence[Any], joint: int, lanes: Any) -> Vector:
    """Return the values of one joint."""
    return np.array([lanes.lane(row, joint) for row in rows], dtype=object)


def composed(R: Matrix, p: Vector, lanes: Any) -> tuple[Matrix, Vector]:
    """Return rotations and positions of the links of a block from its beginning."""
    distance = 1
    while distance < LANES:
        # Products of twice as many steps; those of the first links are done.
        R_before = shifted(R.ravel(), distance, lanes).reshape(3, 3)
        # Joints without one at this distance are multiplied by 1 and shifted by 0.
        first = lanes.pack([float(k < distance) for k in range(LANES)])
        for k in range(3):
            R_before[k, k] = R_before[k, k] + first
        p = shifted(p, distance, lanes) + R_before @ p
        R = R_before @ R
        distance = 2 * distance
    return R, p


def sums(x: Vector, lanes: Any) -> Vector:
    """Return the sums over the joints of a block up to each one."""
    distance = 1
    while distance < LANES:
        x = x + shifted(x, distance, lanes)
        distance = 2 * distance
    return x


def sums_beyond(x: Vector, lanes: Any) -> Vector:
    """Return the sums over the joints of a block from each one on."""
    distance = 1
    while distance < LANES:
        x = x + shifted(x, -distance, lanes)
        distance = 2 * distance
    return x


def shifted(x: Vector, distance: int, lanes: Any) -> Vector:
    """Return the values of the joint at this distance before each; 0 if there is none."""
    places: list[tuple[int, int] | None] = []
    for source in range(-distance, LANES - distance):
        is_in_block = 0 <= source < LANES
        places.append((0, source) if is_in_block else None)
    return np.array([lanes.gathered([y], places) for y in x], dtype=object)


def sines(angles: Any, lanes: Any) -> tuple[Any, Any]:
    """Return rows of sines and cosines."""
    sine = []
    cosine = []
    for k in range(LANES):
        angle = lanes.lane(angles, k)
        sine.append(np.sin(angle))
        cosine.append(np.cos(angle))
    return lanes.pack(sine), lanes.pack(cosine)


def total(row: Any, lanes: Any) -> Scalar:
    """Return the sum of the lanes of a row."""
    half = LANES // 2
    while half:
        upper = [(0, k + half) if k < half else None for k in range(LANES)]
        row = row + lanes.gathered([row], upper)
        half = half // 2
    return lanes.lane(row, 0)


def symmetric_rows(rows: Sequence[Any], lanes: Any) -> list[Any]:
    """Return the rows of a symmetric matrix, the upper triangle from the lower one."""
    result = []
    for r, (row, column) in enumerate(zip(rows, lanes.transposed(rows))):
        lower = [k <= r for k in range(LANES)]
        result.append(lanes.blend(lower, row, column))
    return result
