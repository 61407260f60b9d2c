"""
Derivatives of inverse dynamics with eight joints in the lanes of one row.

From the links' rotations and positions on, everything is computed in lanes: in the world's axes,
about an origin that coincides with that of a light link at the end of the tree and moves with its
present velocity, uniformly. There, with (v, omega) the velocity and angular velocity of a link,
(a, alpha) their rates, minus gravity, and S_j = (sigma, s) the velocity for a unit rate of joint j
(x being the products of twists, v_j x S_j = (omega x sigma + v x s, omega x s)):

    d/dq_j: (da, chi) = a_j x S_j + v_j x (v_j x S_j),  delta = angular part of v_j x S_j
    d/du_j: (da, chi) = 2 v_j x S_j,                    delta = s

is the change da + chi x r + 2 delta x v_P of the acceleration of each point at r that joint j
carries. The torque of a joint i beyond j changes by f . da + n . chi + e . 2 delta, that of a
joint j by S_j . (F, N) with the wrench (F, N) that joint i changes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from kane_dynamics.mechanics.algebra.lanes import LANES, Lanes
from kane_dynamics.mechanics.algebra.vector import cross, symmetric
from kane_dynamics.mechanics.joint_lanes.tree_sums import TreeSums
from kane_dynamics.mechanics.recursive.inverse_dynamics import JointStep
from kane_dynamics.mechanics.recursive.link import Link
from kane_dynamics.model.model import WORLD
import numpy as np

UPPER = np.triu_indices(3)


@dataclass
class LaneMotion:
    """Axes and motion of the joints of one part; see the module for the symbols."""

    sigma: Any
    s: Any
    v: Any
    omega: Any

    def __post_init__(self) -> None:
        """Compute the rate of the axes, v x S: linear and angular."""
        self.slide, self.turn = self.rate(self.v, self.omega)

    def rate(self, v: Any, omega: Any) -> tuple[Any, Any]:
        """Return the product of a twist and S: linear and angular."""
        return cross(omega, self.sigma) + cross(v, self.s), cross(omega, self.s)


class JointRows:
    """
    Vectors of the joints of one part, whose dot products are the entries of the derivatives.

    Attributes
    ----------
    axis : (6,) array of rows
        S.
    by_q, by_u : (9,) arrays of rows
        da, chi and 2 delta for a unit displacement and for a unit rate.
    own : (9,) array of rows
        f, n and e.
    wrench_by_q, wrench_by_u : (6,) arrays of rows
        F and N.

    """

    def __init__(self, motion: LaneMotion, acceleration: Any, mass: Any, sums: Any,
                 factor: Any) -> None:
        """Compute the vectors from the sums of `_moments` over the subtrees."""
        sigma, s, slide, turn = motion.sigma, motion.s, motion.slide, motion.turn
        h, p, force, moment = sums[:3], sums[3:6], sums[6:9], sums[9:12]
        xx, xy, xz, yy, yz, zz = sums[12:18]
        inertia = np.array([[yy + zz, -xy, -xz], [-xy, xx + zz, -yz], [-xz, -yz, xx + yy]])
        V = sums[18:].reshape(3, 3)
        growth = np.array([[V[1, 1] + V[2, 2], -V[0, 1], -V[0, 2]],
                           [-V[1, 0], V[0, 0] + V[2, 2], -V[1, 2]],
                           [-V[2, 0], -V[2, 1], V[0, 0] + V[1, 1]]])

        def wrench(da: Any, chi: Any, delta: Any) -> Any:
            return np.concatenate([mass * da + cross(chi, h) + cross(delta, p),
                                   cross(h, da) + inertia @ chi + growth @ delta])
        da, chi = motion.rate(acceleration[:3], acceleration[3:])
        by_q = (da + cross(motion.omega, slide) + cross(motion.v, turn),
                chi + cross(motion.omega, turn), turn + turn)
        by_u = (slide + slide, turn + turn, s + s)
        moved = np.concatenate([cross(s, force), cross(s, moment) + cross(sigma, force)])
        self.axis = factor * np.concatenate([sigma, s])
        self.by_q, self.by_u = (factor * np.concatenate(field) for field in (by_q, by_u))
        self.own = factor * np.concatenate([
            mass * sigma + cross(s, h), cross(h, sigma) + inertia @ s,
            cross(p, sigma) + growth.T @ s])
        self.wrench_by_q = factor * (wrench(*by_q) + moved)
        self.wrench_by_u = factor * wrench(*by_u)


def inverse_dynamics_derivatives(links: Sequence[Link], q: Any, u: Any, udot: Any, gravity: Any,
                                 lanes: Any = Lanes) -> Any:
    """
    Return rows of dtau/dq, dtau/du and M of the links, (3, n, ceil(n / LANES)).

    Arguments as `inverse_dynamics`, but each coordinate moves one link; `lanes` has the functions
    of `Lanes`. Entry [m, r, g] holds row r of matrix m from column g LANES on.
    """
    tree = TreeSums(links, lanes)
    parts = _joint_rows(tree, links, q, u, udot, gravity)
    result = np.zeros((3, tree.n, len(parts)), dtype=object)
    for r in range(tree.n):
        near, lane = parts[r // LANES], r % LANES
        own, axis = (np.array([lanes.lane(x, lane) for x in row]) for row in (near.own, near.axis))
        for g, far in enumerate(parts):
            columns = range(g * LANES, (g + 1) * LANES)
            below = [c in tree.paths[r] for c in columns]
            above = [c != r and c < tree.n and r in tree.paths[c] for c in columns]
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


def _joint_rows(tree: TreeSums, links: Sequence[Link], q: Any, u: Any, udot: Any,
                gravity: Any) -> list[JointRows]:
    """Return the vectors of all joints."""
    def coordinates(x: Any) -> list[Any]:
        return tree.packed([link.multiplier * x[link.coordinate] for link in links])
    rotations, positions = _poses(tree, links, q)
    axes = [_axes(tree, k, *pose) for k, pose in enumerate(zip(rotations, positions))]
    motions = _motions(tree, axes, coordinates(u))
    rates = zip(motions, coordinates(u), coordinates(udot))
    accelerations = [x - np.array([*gravity, 0.0, 0.0, 0.0]) for x in tree.toward_root([
        np.concatenate([rate * joint.slide + growth * joint.sigma,
                        rate * joint.turn + growth * joint.s]) for joint, rate, growth in rates])]
    inertials = zip(*(tree.packed(x) for x in zip(*(
        (link.mass, link.first_moment, link.second_moment) for link in links))))
    sums = tree.over_subtrees([_moments(*given) for given in zip(
        rotations, positions, motions, accelerations, inertials)])
    return [JointRows(*given) for given in zip(motions, accelerations, _masses(tree, links), sums,
                                               tree.packed([x.multiplier for x in links]))]


def _poses(tree: TreeSums, links: Sequence[Link], q: Any) -> tuple[list[Any], list[Any]]:
    """Return rotation and position of the links from the origin of their tree, in parts."""
    rotations: list[Any] = []
    steps: list[Any] = []
    for link in links:
        step, parent = JointStep(link, q), link.parent
        R = np.eye(3) if parent == WORLD else rotations[parent]
        rotations.append(np.stack([step.outward(row) for row in R]))
        steps.append(R @ step.offset)
    return tree.packed(rotations), tree.from_origins(tree.packed(steps))


def _axes(tree: TreeSums, part: int, R: Any, p: Any) -> tuple[Any, Any]:
    """Return sigma and s of the joints of a part."""
    turning = [link.kind == 'revolute' for link in tree.links[part * LANES:(part + 1) * LANES]]
    z = R[:, 2]
    return tree.blended(turning, cross(p, z), z), tree.blended(turning, z, np.zeros(3))


def _motions(tree: TreeSums, axes: Sequence[tuple[Any, Any]], rates: Sequence[Any]
             ) -> list[LaneMotion]:
    """Return the motion of all joints."""
    linear = tree.from_origins([rate * sigma for (sigma, _), rate in zip(axes, rates)])
    angular = tree.toward_root([rate * s for (_, s), rate in zip(axes, rates)])
    return [LaneMotion(*axis, v, omega) for axis, v, omega in zip(axes, linear, angular)]


def _masses(tree: TreeSums, links: Sequence[Link]) -> list[Any]:
    """Return the mass that each joint carries."""
    masses = [link.mass for link in links]
    for i in reversed(range(len(links))):
        above = links[i].parent
        if above != WORLD:
            masses[above] = masses[above] + masses[i]
    return tree.packed(masses)


def _moments(R: Any, p: Any, motion: LaneMotion, acceleration: Any, inertial: Any) -> Any:
    """
    Return the moments of the links of one part about the origin, (27,).

    These are h = int r dm, P = int v dm, inertia force and moment, both negated, the upper
    triangle of S = int r r^T dm, and int v r^T dm.
    """
    mass, first, second = inertial
    v, omega, a, alpha = motion.v, motion.omega, acceleration[:3], acceleration[3:]
    own = R @ first
    h, S = own + mass * p, symmetric(R @ second @ R.T)
    S = S + symmetric(np.outer(p, own) + np.outer(h, p))
    P, trace = mass * v + cross(omega, h), S[0, 0] + S[1, 1] + S[2, 2]
    L = cross(h, v) + trace * omega - S @ omega
    force = mass * a + cross(alpha, h) + cross(omega, P)
    moment = (cross(h, a) + trace * alpha - S @ alpha + cross(v, P) + cross(omega, L))
    V = np.outer(v, h) + np.stack([cross(omega, column) for column in S], axis=1)
    return np.array([*h, *P, *force, *moment, *S[UPPER], *V.ravel()])
