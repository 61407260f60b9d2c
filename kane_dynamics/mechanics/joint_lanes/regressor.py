"""Joint torque regressor of large trees, with the joints that carry a body in lanes."""

from collections.abc import Sequence
from typing import Any

from kane_dynamics._util.typing import Matrix, Vector
from kane_dynamics.mechanics.algebra.lanes import LANES, Lanes
from kane_dynamics.mechanics.recursive.inverse_dynamics import (
    JointStep, link_motion, LinkMotion)
from kane_dynamics.mechanics.recursive.link import Link
from kane_dynamics.mechanics.recursive.regressor import (joint_partial_velocity,
                                                         link_state, outward_partial,
                                                         PARAMETERS, regressor_entries)
from kane_dynamics.model.model import WORLD
import numpy as np


def regressor(links: Sequence[Link], q: Vector, u: Vector, udot: Vector, gravity: Vector,
              lanes: Any = Lanes) -> Matrix:
    """
    Return the regressor, (n, 10 n_bodies).

    Arguments as `kane_dynamics.mechanics.recursive.regressor`, but each coordinate moves
    one link; `lanes` has the functions of `Lanes`.
    """
    n_parameters = len(PARAMETERS)
    motion: list[LinkMotion] = []
    # Of each link: the links whose joints carry it, itself last, and the partial
    # velocities of these joints, (6,) of rows.
    paths: list[list[Link]] = []
    partials: list[list[Vector]] = []
    Y: Matrix = np.zeros((len(q), n_parameters * len(links)), dtype=object)
    for k, link in enumerate(links):
        step = JointStep(link, q)
        motion.append(link_motion(link, step, motion, q, u, udot, gravity))

        # Partial velocities of the parent's carriers, moved to this link, and its own.
        path: list[Link] = []
        moved: list[Vector] = []
        if link.parent != WORLD:
            path = list(paths[link.parent])
            moved = [outward_partial(step, rows) for rows in partials[link.parent]]
        of_joint = joint_partial_velocity(link)
        partials.append(_appended(moved, of_joint, len(path), lanes))
        paths.append([*path, link])

        # Their dot products with the link's wrench for a unit of each parameter.
        state = link_state(step, motion[k])
        for g, rows in enumerate(partials[k]):
            joints = paths[k][g * LANES:(g + 1) * LANES]
            # Nothing reads lanes without a joint: equal factors are one number.
            factors = [joint.multiplier for joint in joints]
            factors += factors[:1] * (LANES - len(factors))
            factor = lanes.pack(factors)
            entries = factor * regressor_entries(link, rows, state)
            _place(Y[:, n_parameters * k:n_parameters * (k + 1)], entries, joints, lanes)
    return Y


def _place(columns: Matrix, entries: Vector, joints: Sequence[Link], lanes: Any) -> None:
    """Write the entries of joints to the columns of a link, by blocks of parameters."""
    for begin in range(0, len(entries), LANES):
        tile = lanes.transposed(entries[begin:begin + LANES])
        end = min(begin + LANES, len(entries))
        for joint, row in zip(joints, tile):
            for place in range(begin, end):
                columns[joint.coordinate, place] = lanes.lane(row, place - begin)


def _appended(moved: Sequence[Vector], partial: Vector, depth: int,
              lanes: Any) -> list[Vector]:
    """Return the partial velocities of a link's carriers with its own joint's added."""
    # The joint's lane in the last block; a first lane begins a new block.
    block, lane = divmod(depth, LANES)
    present = np.zeros(6)
    if lane:
        present = moved[block]
    mask = [k == lane for k in range(LANES)]
    rows = [lanes.blend(mask, x, y) for x, y in zip(partial, present)]
    return [*moved[:block], np.array(rows)]
