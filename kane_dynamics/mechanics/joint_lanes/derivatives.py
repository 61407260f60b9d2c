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


@dataclass
class LaneBodies:
    """
    The links of one part, and the masses that their joints carry.

    Attributes
    ----------
    R, p : (3, 3), (3,) arrays of rows
        Rotations and positions.
    motion : LaneMotion
    acceleration : (6,) array of rows
        Linear and angular, minus gravity.
    inertial : (10,) array of rows
        Mass, first moment, and the upper triangle of the second one, in link axes.
    carried_mass, multiplier : rows

    """

    R: Matrix
    p: Vector
    motion: LaneMotion
    acceleration: Vector
    inertial: Vector
    carried_mass: Any
    multiplier: Any


@dataclass
class JointRows:
    """
    Vectors of the joints of one part: dot products are entries of the derivatives.

    Attributes
    ----------
    axis : (6,) array of rows
        S.
    force : (9,) array of rows
        f, n and e.
    by_q, by_u : (9,) arrays of rows
        da, chi and 2 delta for a unit displacement and for a unit rate.
    wrench_by_q, wrench_by_u : (6,) arrays of rows
        F and N.

    """

    axis: Vector
    force: Vector
    by_q: Vector
    by_u: Vector
    wrench_by_q: Vector
    wrench_by_u: Vector


def joint_vectors(body: LaneBodies, sums: Vector) -> JointRows:
    """Return the vectors from the sums of `_moments` over the subtrees."""
    motion = body.motion
    acceleration = body.acceleration
    mass = body.carried_mass
    factor = body.multiplier
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
    f = mass * sigma + cross(s, h)
    n = cross(h, sigma) + inertia @ s
    e = cross(p, sigma) + growth.T @ s
    return JointRows(axis=factor * np.concatenate([sigma, s]),
                     force=factor * np.concatenate([f, n, e]),
                     by_q=factor * np.concatenate(by_q),
                     by_u=factor * np.concatenate(by_u),
                     wrench_by_q=factor * (wrench(*by_q) + moved),
                     wrench_by_u=factor * wrench(*by_u))


def inverse_dynamics_derivatives(links: Sequence[Link], q: Vector, u: Vector,
                                 udot: Vector, gravity: Vector,
                                 lanes: Any = Lanes) -> Any:
    """
    Return rows of dtau/dq, dtau/du and M of the links, (3, n, ceil(n / LANES)).

    Arguments as `inverse_dynamics`, but each coordinate moves one link; `lanes` has the
    functions of `Lanes`. Entry [m, r, g] holds row r of matrix m from column g LANES on.
    """
    # Motion of the links outward, sums of their moments over subtrees inward.
    tree = TreeSums(links, lanes)
    bodies = _bodies(tree, links, q, u, udot, gravity)
    sums = tree.over_subtrees([_moments(body) for body in bodies])
    parts = list(map(joint_vectors, bodies, sums))
    # Entries: dot products of the vectors of joint r with those of a part's joints.
    result = np.zeros((3, tree.n, len(parts)), dtype=object)
    for r in range(tree.n):
        # The vectors of joint r alone: the same value in all lanes.
        rows = parts[r // LANES]
        lane = r % LANES
        force = np.array([lanes.lane(row, lane) for row in rows.force])
        axis = np.array([lanes.lane(row, lane) for row in rows.axis])
        for g, part in enumerate(parts):
            # Columns of joints toward the root, r included, and of joints beyond r.
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


def _bodies(tree: TreeSums, links: Sequence[Link], q: Vector, u: Vector,
            udot: Vector, gravity: Vector) -> list[LaneBodies]:
    """Return places, motion and inertia of the links, in parts."""
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

    # Constants of the links, as rows of each part.
    inertial = []
    multipliers = []
    for link in links:
        inertial.append([link.mass, *link.first_moment, *link.second_moment[UPPER]])
        multipliers.append(link.multiplier)
    columns = (rotations, positions, motions, accelerations, tree.packed(inertial),
               _masses(tree, links), tree.packed(multipliers))
    return [LaneBodies(*of_part) for of_part in zip(*columns, strict=True)]


def _poses(tree: TreeSums, links: Sequence[Link],
           q: Vector) -> tuple[list[Matrix], list[Vector]]:
    """Return rotation and position of the links from their tree's origin, in parts."""
    rotations: list[Matrix] = []
    steps: list[Vector] = []
    for link in links:
        step = JointStep(link, q)
        R_parent = np.eye(3)
        if link.parent != WORLD:
            R_parent = rotations[link.parent]
        # R_parent R_joint by rows: each is a row of R_parent in the link's axes.
        rows = [step.outward(row) for row in R_parent]
        rotations.append(np.stack(rows))
        steps.append(R_parent @ step.offset)
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
    # v at the origin: sums of sigma q' from the tree's origin, which is at rest. omega:
    # sums of s q' from the root.
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


def _moments(body: LaneBodies) -> Vector:
    """
    Return the moments of the links of one part about the origin, (27,).

    These are h = int r dm, P = int v dm, inertia force and moment, both negated, the
    upper triangle of S = int r r^T dm, and int v r^T dm.
    """
    mass = body.inertial[0]
    first = body.inertial[1:4]
    xx, xy, xz, yy, yz, zz = body.inertial[4:]
    second = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=object)
    v = body.motion.v
    omega = body.motion.omega
    a, alpha = np.split(body.acceleration, 2)

    # From the link's axes and origin to the world's; I omega = trace(S) omega - S omega.
    h_of_link = body.R @ first
    h = h_of_link + mass * body.p
    S = symmetric(body.R @ second @ body.R.T)
    S = S + symmetric(np.outer(body.p, h_of_link) + np.outer(h, body.p))
    trace = S[0, 0] + S[1, 1] + S[2, 2]

    # Linear and angular momentum, and their rates.
    P = mass * v + cross(omega, h)
    L = cross(h, v) + trace * omega - S @ omega
    force = mass * a + cross(alpha, h) + cross(omega, P)
    moment = cross(h, a) + trace * alpha - S @ alpha + cross(v, P) + cross(omega, L)

    # v of a point at r is v + omega x r.
    V = np.outer(v, h) + np.stack([cross(omega, column) for column in S], axis=1)
    return np.array([*h, *P, *force, *moment, *S[UPPER], *V.ravel()])
