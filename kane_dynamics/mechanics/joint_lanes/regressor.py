"""Joint torque regressor of large trees, with the joints that carry a body in lanes."""

from collections.abc import Sequence
from typing import Any

from kane_dynamics.mechanics.algebra.lanes import LANES, Lanes
from kane_dynamics.mechanics.recursive.inverse_dynamics import JointStep, link_motion, LinkMotion
from kane_dynamics.mechanics.recursive.link import Link
from kane_dynamics.mechanics.recursive.regressor import (link_state, on_joint, outward,
                                                         own_partial, PARAMETERS)
from kane_dynamics.model.model import WORLD
import numpy as np


def regressor(links: Sequence[Link], q: Any, u: Any, udot: Any, gravity: Any,
              lanes: Any = Lanes) -> Any:
    """
    Return the regressor, (n, 10 n_bodies).

    Arguments as `kane_dynamics.mechanics.recursive.regressor`, but each coordinate moves one link;
    `lanes` has the functions of `Lanes`.
    """
    motion: list[LinkMotion] = []
    paths: list[list[Link]] = []  # to each link: the links whose joints carry it, its own last
    partials: list[list[Any]] = []  # of each link: those joints' partial velocities, (6,) of rows
    Y: Any = np.zeros((len(q), len(PARAMETERS) * len(links)), dtype=object)
    for k, link in enumerate(links):
        step, root = JointStep(link, q), link.parent == WORLD
        motion.append(link_motion(link, step, motion, q, u, udot, gravity))
        paths.append([*([] if root else paths[link.parent]), link])
        moved = [] if root else [outward(step, rows) for rows in partials[link.parent]]
        partials.append(_with_own(moved, own_partial(link), len(paths[k]) - 1, lanes))
        state = link_state(step, motion[k])
        for g, rows in enumerate(partials[k]):
            joints = paths[k][g * LANES:(g + 1) * LANES]
            factor = lanes.pack([joint.multiplier for joint in joints])
            entries = factor * on_joint(link, rows, state)
            for c in range(0, len(PARAMETERS), LANES):
                tile = lanes.transposed(entries[c:c + LANES])
                for joint, row in zip(joints, tile):
                    for place in range(c, min(c + LANES, len(PARAMETERS))):
                        Y[joint.coordinate, len(PARAMETERS) * k + place] = lanes.lane(
                            row, place - c)
    return Y


def _with_own(moved: Sequence[Any], own: Any, depth: int, lanes: Any) -> list[Any]:
    """Return the partial velocities of a link's carriers with those of its own joint added."""
    block, lane = divmod(depth, LANES)
    mask = [k == lane for k in range(LANES)]
    before = moved[block] if lane else np.zeros(6)
    return [*moved[:block], np.array([lanes.blend(mask, x, y) for x, y in zip(own, before)])]
