"""
Derivatives of inverse dynamics of large trees, with eight joints in the lanes of one row.

The vectors of `kane_dynamics.mechanics.recursive.derivatives` are transformed to the world's axes
and origin once per joint instead of from link to link. There, with S_j the motion of the joint's
axis, (c_j, d_j) its accelerations for q and u, (f, n, e)_i the vectors of row i and (F, N)_i the
wrenches of column i,

    row i, column j:  f . da + n . chi + e . delta     (j carries i, or is i)
    row j, column i:  S_j . (F, N)                     (j carries i)

are dot products of scalars of one joint and rows of other joints. To move a link's vectors at p,
whose origin has the velocity w: n + p x f, e + 2 w x f, N + p x F, da - chi x p - 2 delta x w.
"""

from collections.abc import Iterable, Sequence
from dataclasses import fields
from typing import Any

from kane_dynamics.mechanics.algebra.lanes import LANES, Lanes
from kane_dynamics.mechanics.algebra.vector import cross
from kane_dynamics.mechanics.recursive.derivatives import (add_to_parent, column_wrenches,
                                                           CompositeBody, link_states,
                                                           LinkState, row_vectors, single_link)
from kane_dynamics.mechanics.recursive.link import Link
from kane_dynamics.model.model import WORLD
import numpy as np

NONE = np.zeros(3)
KINDS = ('revolute', 'prismatic')


class JointRows:
    """
    Vectors of up to `LANES` joints, in the world's axes and about its origin.

    Attributes
    ----------
    axis : (6,) array of rows
        Linear and angular velocity for a unit rate: S.
    by_q, by_u : (9,) arrays of rows
        da, chi and delta for a unit displacement and for a unit rate.
    own : (9,) array of rows
        f, n and e.
    wrench_by_q, wrench_by_u : (6,) arrays of rows
        F and N.

    """

    def __init__(self, states: Sequence[LinkState], bodies: Sequence[CompositeBody],
                 poses: Sequence[Any], lanes: Any) -> None:
        """Pack and transform the vectors of some links; `poses` are R, p and w of each."""
        def packed(arrays: Sequence[Any]) -> Any:
            rows = [lanes.pack(entries) for entries in zip(*map(np.ravel, arrays), strict=True)]
            return np.array(rows).reshape(np.shape(arrays[0]))[()]
        R, p, w = (packed(arrays) for arrays in zip(*poses))
        motion = tuple(packed(arrays) for arrays in zip(*(state.motion for state in states)))
        body = CompositeBody(*(packed([getattr(body, field.name) for body in bodies])
                               for field in fields(CompositeBody)))
        links = [state.link for state in states]
        factor = packed([link.multiplier for link in links])
        turning = [link.kind == 'revolute' for link in links]
        turning += [turning[0]] * (LANES - len(turning))

        def of_kind(revolute: Any, prismatic: Any) -> Any:
            return np.array([lanes.blend(turning, x, y) for x, y in zip(revolute, prismatic)])

        def moved(da: Any, chi: Any, delta: Any) -> Any:
            about_origin = da - cross(chi, p) - 2.0 * cross(delta, w)
            return factor * np.concatenate([about_origin, chi, delta])

        omega, _, a, U = motion
        along, across = R[:, 2], R @ np.array([omega[1], -omega[0], 0.0])  # s, omega x s
        turned, centripetal = R @ np.array([a[1], -a[0], 0.0]), R @ U[:, 2]
        self.axis = factor * of_kind([*cross(p, along), *along], [*along, *NONE])
        self.by_q = of_kind(moved(turned, centripetal, across),
                            moved(centripetal, NONE, NONE))
        self.by_u = of_kind(moved(NONE, 2.0 * across, along),
                            moved(2.0 * across, NONE, NONE))
        f, n, e = (R @ v for v in of_kind(*(row_vectors(kind, body)
                                            for kind in KINDS)).reshape(3, 3))
        self.own = factor * np.concatenate([f, n + cross(p, f), e + 2.0 * cross(w, f)])
        F, N, F_u, N_u = (R @ v for v in of_kind(*(column_wrenches(kind, motion, body)
                                                   for kind in KINDS)).reshape(4, 3))
        self.wrench_by_q = factor * np.concatenate([F, N + cross(p, F)])
        self.wrench_by_u = factor * np.concatenate([F_u, N_u + cross(p, F_u)])


def inverse_dynamics_derivatives(links: Sequence[Link], q: Any, u: Any, udot: Any, gravity: Any,
                                 lanes: Any = Lanes) -> Any:
    """
    Return rows of dtau/dq, dtau/du and M of the links, (3, n, ceil(n / LANES)).

    Arguments as `inverse_dynamics`, but each coordinate moves one link; `lanes` has the functions
    of `Lanes`. Entry [m, r, g] holds row r of matrix m from column g LANES on.
    """
    states, poses = _outward(link_states(links, q, u, udot, gravity))
    carriers, bodies = _carriers(links), _composite_bodies(states)
    place = np.argsort([link.coordinate for link in links])  # links by coordinate
    parts = [place[k:k + LANES] for k in range(0, len(place), LANES)]
    blocks = [JointRows([states[i] for i in part], [bodies[i] for i in part],
                        [poses[i] for i in part], lanes) for part in parts]
    result = np.zeros((3, len(place), len(blocks)), dtype=object)
    for r in range(len(place)):
        near, lane = blocks[r // LANES], r % LANES
        own, axis = (np.array([lanes.lane(x, lane) for x in row]) for row in (near.own, near.axis))
        for g, far in enumerate(blocks):
            here = slice(g * LANES, (g + 1) * LANES)
            below, above = _mask(carriers[r, here]), _mask(
                carriers[here, r] & ~carriers[r, here])
            entries: Any = np.zeros(3)
            if any(above):
                entries = _blended(above, [axis @ far.wrench_by_q, axis @ far.wrench_by_u,
                                           axis @ far.own[:6]], entries, lanes)
            if any(below):
                entries = _blended(below, [own @ far.by_q, own @ far.by_u,
                                           own[:6] @ far.axis], entries, lanes)
            result[:, r, g] = entries
    return result


def _blended(mask: Sequence[bool], rows: Sequence[Any], others: Sequence[Any],
             lanes: Any) -> list[Any]:
    return [lanes.blend(mask, row, other) for row, other in zip(rows, others)]


def _mask(chosen: Any) -> list[bool]:
    """Return the lanes of some coordinates, False after the last one."""
    return [*map(bool, chosen), *[False] * (LANES - len(chosen))]


def _carriers(links: Sequence[Link]) -> Any:
    """Return whether coordinate s moves the link of coordinate r, (n, n) booleans."""
    found = np.zeros((len(links), len(links)), dtype=bool)
    for link in links:
        if link.parent != WORLD:
            found[link.coordinate] = found[links[link.parent].coordinate]
        found[link.coordinate, link.coordinate] = True
    return found


def _outward(states: Iterable[LinkState]) -> tuple[list[LinkState], list[tuple[Any, Any, Any]]]:
    """Return the states, and R, position and velocity of the origins of all links; world axes."""
    passed: list[LinkState] = []
    poses: list[tuple[Any, Any, Any]] = []
    for state in states:
        R, p, w = np.eye(3), NONE, NONE
        if state.link.parent != WORLD:
            R, p, w = poses[state.link.parent]
        passed.append(state)
        poses.append((np.stack([state.step.outward(row) for row in R]),
                      p + R @ state.step.offset, w + R @ state.velocity))
    return passed, poses


def _composite_bodies(states: Sequence[LinkState]) -> list[CompositeBody]:
    """Return the composite body of every joint; a link's own is computed where it is needed."""
    bodies: dict[int, CompositeBody] = {}

    def body(i: int) -> CompositeBody:
        if i not in bodies:
            bodies[i] = single_link(states[i].link, states[i].motion)
        return bodies[i]
    for i in reversed(range(len(states))):
        state = states[i]
        if state.link.parent == WORLD:
            body(i)
        else:
            add_to_parent(state, body(i), body(state.link.parent))
    return [bodies[i] for i in range(len(states))]
