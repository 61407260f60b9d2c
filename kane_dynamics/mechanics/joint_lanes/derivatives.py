"""
Derivatives of inverse dynamics with eight joints in the lanes of one row.

From the links' rotations and positions on, everything is computed in lanes: in the
world's axes, about an origin that coincides with that of a light link at the end of the
tree and moves with its present velocity, uniformly. There, with (v, omega) the velocity
and angular velocity of a link, (a, alpha) their rates, minus gravity, and S_j = (sigma,
s) the velocity for a unit rate of joint j (x being the products of twists, v_j x S_j =
(omega x sigma + v x s, omega x s)):

    d/dq_j: (da, chi) = a_j x S_j + v_j x (v_j x S_j),  delta = angular part of v_j x S_j
    d/du_j: (da, chi) = 2 v_j x S_j,                    delta = s

is the change da + chi x r + 2 delta x v_P of the acceleration of each point at r that
joint j carries. The torque of a joint i beyond j changes by f . da + n . chi + e . 2
delta, that of a joint j by S_j . (F, N) with the wrench (F, N) that joint i changes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from kane_dynamics._util.typing import Matrix, Vector
from kane_dynamics.mechanics.algebra.lanes import LANES, Lanes
from kane_dynamics.mechanics.algebra.vector import cross
from kane_dynamics.mechanics.joint_lanes.link_momenta import link_momenta
from kane_dynamics.mechanics.joint_lanes.tree_sums import TreeSums
from kane_dynamics.mechanics.recursive.inverse_dynamics import JointStep
from kane_dynamics.mechanics.recursive.link import Link
from kane_dynamics.model.model import WORLD
import numpy as np

UPPER = np.triu_indices(3)


@dataclass
class LaneMotion:
    """Axes and motion of the joints of one part; see the module for the symbols."""

    sigma: Vector
    s: Vector
    v: Vector
    omega: Vector

    def __post_init__(self) -> None:
        """Compute the rate of the axes, v x S: linear and angular."""
        self.slide, self.turn = self.rate(self.v, self.omega)

    def rate(self, v: Vector, omega: Vector) -> tuple[Vector, Vector]:
        """Return the product of a twist and S: linear and angular."""
        linear = cross(omega, self.sigma) + cross(v, self.s)
        return linear, cross(omega, self.s)


class JointRows:
    """
    Vectors of the joints of one part: dot products are entries of the derivatives.

    Attributes
    ----------
    axis : (6,) array of rows
        S.
    by_q, by_u : (9,) arrays of rows
        da, chi and 2 delta for a unit displacement and for a unit rate.
    force : (9,) array of rows
        f, n and e.
    wrench_by_q, wrench_by_u : (6,) arrays of rows
        F and N.

    """

    def __init__(self, motion: LaneMotion, acceleration: Vector, mass: Any, sums: Vector,
                 factor: Any) -> None:
        """Compute the vectors from the sums of `_moments` over the subtrees."""
        sigma = motion.sigma
        s = motion.s
        slide = motion.slide
        turn = motion.turn

        # Moments of the bodies that the joint carries; I = trace(S) 1 - S, and the same
        # of V = int v r^T dm.
        h, p, force, moment, second, V = np.split(sums, [3, 6, 9, 12, 18])
        xx, xy, xz, yy, yz, zz = second
        inertia = np.array([[yy + zz, -xy, -xz],
                            [-xy, xx + zz, -yz],
                            [-xz, -yz, xx + yy]])
        V = V.reshape(3, 3)
        growth = np.array([[V[1, 1] + V[2, 2], -V[0, 1], -V[0, 2]],
                           [-V[1, 0], V[0, 0] + V[2, 2], -V[1, 2]],
                           [-V[2, 0], -V[2, 1], V[0, 0] + V[1, 1]]])

        def wrench(da: Vector, chi: Vector, delta: Vector) -> Vector:
            linear = mass * da + cross(chi, h) + cross(delta, p)
            angular = cross(h, da) + inertia @ chi + growth @ delta
            return np.concatenate([linear, angular])

        # Changes of the accelerations: the formulas of the module's text.
        da, chi = motion.rate(acceleration[:3], acceleration[3:])
        by_q = (da + cross(motion.omega, slide) + cross(motion.v, turn),
                chi + cross(motion.omega, turn), turn + turn)
        by_u = (slide + slide, turn + turn, s + s)

        # A displacement also moves the bodies, and with them their wrench.
        moved = np.concatenate([cross(s, force), cross(s, moment) + cross(sigma, force)])
        self.axis = factor * np.concatenate([sigma, s])
        self.by_q = factor * np.concatenate(by_q)
        self.by_u = factor * np.concatenate(by_u)
        f = mass * sigma + cross(s, h)
        n = cross(h, sigma) + inertia @ s
        e = cross(p, sigma) + growth.T @ s
        self.force = factor * np.concatenate([f, n, e])
        self.wrench_by_q = factor * (wrench(*by_q) + moved)
        self.wrench_by_u = factor * wrench(*by_u)


def inverse_dynamics_derivatives(links: Sequence[Link], q: Vector, u: Vector,
                                 udot: Vector, gravity: Vector,
                                 lanes: Any = Lanes) -> Any:
    """
    Return rows of dtau/dq, dtau/du and M of the links, (3, n, ceil(n / LANES)).

    Arguments as `inverse_dynamics`, but each coordinate moves one link; `lanes` has the
    functions of `Lanes`. Entry [m, r, g] holds row r of matrix m from column g LANES on.
    """
    tree = TreeSums(links, lanes)
    parts = _joint_rows(tree, links, q, u, udot, gravity)
    result = np.zeros((3, tree.n, len(parts)), dtype=object)
    for r in range(tree.n):
        # The vectors of joint r alone: the same value in all lanes.
        rows = parts[r // LANES]
        lane = r % LANES
        force = np.array([lanes.lane(row, lane) for row in rows.force])
        axis = np.array([lanes.lane(row, lane) for row in rows.axis])
        for g, part in enumerate(parts):
            columns = range(g * LANES, (g + 1) * LANES)
            carriers = [c in tree.paths[r] for c in columns]
            carried = [c != r and c < tree.n and r in tree.paths[c] for c in columns]
            entries: Any = np.zeros(3)
            if any(carried):
                # The wrench that a joint beyond changes, on the axis of r.
                products = [axis @ part.wrench_by_q, axis @ part.wrench_by_u,
                            axis @ part.force[:6]]
                entries = _blended(carried, products, entries, lanes)
            if any(carriers):
                # The accelerations that a joint toward the root changes.
                products = [force @ part.by_q, force @ part.by_u, force[:6] @ part.axis]
                entries = _blended(carriers, products, entries, lanes)
            result[:, r, g] = entries
    return result


def _blended(mask: Sequence[bool], rows: Sequence[Any], others: Sequence[Any],
             lanes: Any) -> list[Any]:
    """Return the lanes of `rows` where the mask is true, of `others` elsewhere."""
    return [lanes.blend(mask, row, other) for row, other in zip(rows, others)]


def _joint_rows(tree: TreeSums, links: Sequence[Link], q: Vector, u: Vector,
                udot: Vector, gravity: Vector) -> list[JointRows]:
    """Return the vectors of all joints."""
    def rates_of_joints(x: Vector) -> list[Any]:
        return tree.packed([link.multiplier * x[link.coordinate] for link in links])

    # Poses of the links, axes and velocities of the joints, in the world's axes.
    rotations, positions = _poses(tree, links, q)
    axes = []
    for k, (R, p) in enumerate(zip(rotations, positions)):
        axes.append(_axes(tree, k, R, p))
    rates = rates_of_joints(u)
    motions = _motions(tree, axes, rates)

    # Accelerations minus gravity: sums of S u' + (v x S) u toward the root.
    growths = rates_of_joints(udot)
    steps = []
    for motion, rate, growth in zip(motions, rates, growths):
        linear = rate * motion.slide + growth * motion.sigma
        angular = rate * motion.turn + growth * motion.s
        steps.append(np.concatenate([linear, angular]))
    weight = np.array([*gravity, 0.0, 0.0, 0.0])
    accelerations = [x - weight for x in tree.toward_root(steps)]

    # Moments of the links, and their sums over what each joint carries.
    inertials = zip(tree.packed([link.mass for link in links]),
                    tree.packed([link.first_moment for link in links]),
                    tree.packed([link.second_moment for link in links]))
    moments = map(_moments, rotations, positions, motions, accelerations, inertials)
    sums = tree.over_subtrees(list(moments))
    masses = _masses(tree, links)
    multipliers = tree.packed([link.multiplier for link in links])
    return list(map(JointRows, motions, accelerations, masses, sums, multipliers))


def _poses(tree: TreeSums, links: Sequence[Link],
           q: Vector) -> tuple[list[Matrix], list[Vector]]:
    """Return rotation and position of the links from their tree's origin, in parts."""
    rotations: list[Matrix] = []
    steps: list[Vector] = []
    for link in links:
        step = JointStep(link, q)
        R = np.eye(3) if link.parent == WORLD else rotations[link.parent]
        rotations.append(np.stack([step.outward(row) for row in R]))
        steps.append(R @ step.offset)
    return tree.packed(rotations), tree.from_origins(tree.packed(steps))


def _axes(tree: TreeSums, part: int, R: Matrix, p: Vector) -> tuple[Vector, Vector]:
    """Return sigma and s of the joints of a part."""
    links = tree.links[part * LANES:(part + 1) * LANES]
    turning = [link.kind == 'revolute' for link in links]
    z = R[:, 2]
    sigma = tree.blended(turning, cross(p, z), z)
    s = tree.blended(turning, z, np.zeros(3))
    return sigma, s


def _motions(tree: TreeSums, axes: Sequence[tuple[Vector, Vector]],
             rates: Sequence[Any]) -> list[LaneMotion]:
    """Return the motion of all joints."""
    linear = [rate * sigma for (sigma, _), rate in zip(axes, rates)]
    v = tree.from_origins(linear)
    angular = [rate * s for (_, s), rate in zip(axes, rates)]
    omega = tree.toward_root(angular)
    sigmas, s = zip(*axes)
    return list(map(LaneMotion, sigmas, s, v, omega))


def _masses(tree: TreeSums, links: Sequence[Link]) -> list[Any]:
    """Return the mass that each joint carries."""
    masses = [link.mass for link in links]
    for i in reversed(range(len(links))):
        parent = links[i].parent
        if parent != WORLD:
            masses[parent] = masses[parent] + masses[i]
    return tree.packed(masses)


def _moments(R: Matrix, p: Vector, motion: LaneMotion, acceleration: Vector,
             inertial: tuple[Any, Vector, Matrix]) -> Vector:
    """
    Return the moments of the links of one part about the origin, (27,).

    These are h = int r dm, P = int v dm, inertia force and moment, both negated, the
    upper triangle of S = int r r^T dm, and int v r^T dm.
    """
    mass, first, second = inertial
    v = motion.v
    omega = motion.omega
    a, alpha = np.split(acceleration, 2)

    h, S, P, force, moment = link_momenta(R, p, mass, first, second,
                                          (v, omega, a, alpha))

    # v of a point at r is v + omega x r.
    V = np.outer(v, h) + np.stack([cross(omega, column) for column in S], axis=1)
    return np.array([*h, *P, *force, *moment, *S[UPPER], *V.ravel()])
