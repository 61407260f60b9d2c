"""
Forward dynamics in linear time: articulated inertias, by blocks of joints in lanes.

A motion without accelerations of the joints takes wrenches that the joints beyond hand
on. The rest of their torques accelerates articulated inertias: with the axis S of a
joint and the articulated inertia K of what it carries, K S / (S . K S) of its torque
goes to the joints before it, and K loses K S (K S)^T / (S . K S) (Featherstone, Rigid
Body Dynamics Algorithms, ch. 7; Angeles' decoupled natural orthogonal complement
factors M in the same order).

In lanes, the six entries of a row of K have the wrench beside them. One sum of products
with the axis then gives both K S and the torque that the wrench takes, and one outer
product hands both to the joint before. Three loops go over the blocks of `joint_blocks`:

* outward, the motion, in lanes of joints;
* inward, K and the wrench, joint by joint;
* outward, the accelerations.
"""

from collections.abc import Sequence
from typing import Any

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.lanes import LANES
from kane_dynamics.mechanics.algebra.vector import cross
from kane_dynamics.mechanics.joint_lanes.block_rows import (of_joint, packed_rows, sums,
                                                            total, unpacked)
from kane_dynamics.mechanics.joint_lanes.joint_blocks import (block_mass_matrix,
                                                              BlockPose, eliminated,
                                                              inertia_rows,
                                                              JointBlocks, LanesOf, LAST,
                                                              MOMENTS, plain_lanes,
                                                              shifted_inertia, TWIST,
                                                              UPPER)
from kane_dynamics.mechanics.joint_lanes.link_momenta import link_momenta
from kane_dynamics.mechanics.recursive.link import Link
from kane_dynamics.mechanics.recursive.subroutines import one_by_one, Repeat
import numpy as np

CARRIED_MOTION = 18  # rotation, angular velocity and acceleration, acceleration
BEGIN = 24  # of the rows among the results of `motion`: those of D are before it
AXES = slice(BEGIN, BEGIN + 6 * LANES)
BODIES = slice(BEGIN, BEGIN + 21 * LANES)
CARRIED_ROWS = TWIST * LANES


def forward_dynamics(links: Sequence[Link], q: Vector, u: Vector, torque: Vector,
                     armature: Vector, gravity: Vector,
                     lanes_of: LanesOf = plain_lanes,
                     repeat: Repeat = one_by_one) -> Vector:
    """
    Return the accelerations of the joints, (n,).

    Parameters
    ----------
    q, u : (n,) arrays of scalars
        Coordinates and their rates.
    torque : (n,) array of scalars
        Of the joints: what accelerates them, beside gravity.
    gravity : (3,) array of scalars
        m/s^2, world axes.
    links, armature, lanes_of, repeat
        As of `JointBlocks`.

    """
    # The three passes of the articulated-body algorithm (ABA): motion outward, inertia
    # inward, accelerations outward.
    blocks = JointBlocks(links, armature, lanes_of, repeat)
    loops = ForwardDynamics(blocks)
    motions = loops.motions(q, u, gravity)
    shares = loops.shares(motions, torque)
    return loops.accelerations(motions, shares)


class ForwardDynamics:
    """The three loops, for each branch of a tree."""

    def __init__(self, blocks: JointBlocks) -> None:
        """Store the joints."""
        self.blocks = blocks

    # Outward: motion without accelerations of the joints.

    def motions(self, q: Vector, u: Vector, gravity: Vector) -> list[Matrix]:
        """Return the results of `motion` for each branch, (blocks, 18 + ...)."""
        blocks = self.blocks
        # The world does not move, and accelerates against gravity.
        base = np.concatenate([np.eye(3).ravel(), np.zeros(6), -gravity])
        results: list[Matrix] = []
        for branch, table in zip(blocks.branches, blocks.constants.tables):
            carry = base
            if branch.parent is not None:
                carry = results[branch.parent][-1, :CARRIED_MOTION]
            results.append(blocks.repeat('motion', self.motion, carry,
                                         blocks.by_blocks(branch, q),
                                         blocks.by_blocks(branch, u), table))
        return results

    def motion(self, carry: Vector, q: Vector, u: Vector, table: Vector) -> Vector:
        """Return motion, inertia and wrenches of a block, from the link before it."""
        lanes = self.blocks.lanes_of(carry[0])
        omega_before, alpha_before, a_before = np.split(carry[9:], 3)
        pose = self.blocks.pose(carry[:9], lanes.pack(list(q)), table, lanes)
        D, sigma, axis = pose.D, pose.sigma, pose.axis
        rate = lanes.pack(list(u))

        # Velocities from the first one's; the last one's is zero.
        omega = omega_before + sums(rate * axis, lanes)
        travel = sums(rate * sigma, lanes)
        v_last = of_joint(travel, LAST, lanes)
        v = travel - v_last

        # Accelerations: of the link before about this origin, then sums of (v x S) u.
        a_first = (a_before + cross(alpha_before, D)
                   + cross(omega_before, cross(omega_before, D))
                   + cross(omega_before, v_last))
        slide = cross(omega, sigma) + cross(v, axis)
        turn = cross(omega, axis)
        a = a_first + sums(rate * slide, lanes)
        alpha = alpha_before + sums(rate * turn, lanes)

        # Moments of the links, and what the next block goes on from.
        moments = _moments(pose, (v, omega, a, alpha))
        last = of_joint([*pose.R.ravel(), *omega, *alpha, *a], LAST, lanes)
        filled = [0.0] * (BEGIN - CARRIED_MOTION - 3)
        rows = unpacked([*sigma, *axis, *moments], lanes)
        return np.array([*last, *D, *filled, *rows])

    # Inward: articulated inertia and wrench.

    def shares(self, motions: Sequence[Matrix], torque: Vector) -> list[Matrix]:
        """Return the results of `share` for each branch, (blocks, 48 + ...)."""
        blocks = self.blocks
        results: list[Any] = [None] * len(blocks.branches)
        for k in reversed(range(len(blocks.branches))):
            branch = blocks.branches[k]
            # A branch begins with the sum of what the branches at its end hand on.
            carry = np.zeros(CARRIED_ROWS).astype(object)
            for child in branch.children:
                carry = carry + results[child][0, :CARRIED_ROWS]
            motion = motions[k]
            results[k] = blocks.repeat(
                'share', self.share, carry, motion[:, CARRIED_MOTION:BEGIN],
                motion[:, BODIES], blocks.by_blocks(branch, torque),
                blocks.rotors.tables[k], reverse=True)
        return results

    def share(self, carry: Vector, step: Vector, entries: Vector, torque: Vector,
              table: Vector) -> Vector:
        """
        Return the rows carried inward, then V and G of the block's joints, 16 rows by columns.

        Joint k has the acceleration -V_k . (a, 1) - sum G_kj udot_j over the joints j of
        the block before it, with the acceleration a of the link before the block.
        """
        lanes = self.blocks.lanes_of(carry[0])
        beyond = carry.reshape(TWIST, LANES)
        bodies = self.blocks.bodies(entries, table, lanes)
        mass, moments, S = bodies.mass, bodies.moments, bodies.S
        inertia = inertia_rows(mass, moments[:MOMENTS])

        # Wrenches for a unit acceleration of each joint; beside them the torque that is
        # missing without accelerations.
        F = np.array(inertia, dtype=object) @ S + beyond[:, :TWIST] @ S
        wrench = moments[MOMENTS:] + beyond[:, TWIST]
        missing = S @ wrench - lanes.pack(list(torque))
        M = block_mass_matrix(F, S, lanes)
        E = np.array(lanes.transposed([*F, missing, 0.0]), dtype=object)
        E, V, G = eliminated(M, bodies.rotors, E, lanes)

        # The link before the block gets the rest of the inertia, and of the wrench.
        rows = packed_rows(carry, lanes)
        for k, of_wrench in enumerate(inertia):
            rows[k] = rows[k] + lanes.pack(of_joint([*of_wrench, moments[MOMENTS + k]],
                                                    0, lanes).tolist())
            for joint in range(LANES):
                rows[k] = rows[k] - lanes.lane(E[joint], k) * V[joint]
        rows = shifted_inertia(rows, step[:3], lanes)
        of_joints = [*lanes.transposed(V), *lanes.transposed(G)]
        return np.array(unpacked([*rows, *of_joints], lanes))

    # Outward: accelerations.

    def accelerations(self, motions: Sequence[Matrix],
                      shares: Sequence[Matrix]) -> Vector:
        """Return the accelerations of all joints, (n,)."""
        blocks = self.blocks
        # The world does not accelerate here: gravity is part of the wrenches.
        base = np.zeros(TWIST).astype(object)
        results: list[Matrix] = []
        udot: list[Scalar] = [0.0] * len(blocks.coordinates)
        # Outward: a branch begins with the acceleration of the one that carries it.
        for k, branch in enumerate(blocks.branches):
            carry = base
            if branch.parent is not None:
                carry = results[branch.parent][-1, :TWIST]
            result = blocks.repeat('acceleration', self.acceleration, carry,
                                   motions[k][:, CARRIED_MOTION:BEGIN],
                                   motions[k][:, AXES], shares[k][:, CARRIED_ROWS:])
            results.append(result)
            for link, value in zip(branch.links, result[:, TWIST:].flat):
                udot[blocks.coordinates[link]] = value
        return np.array(udot)

    def acceleration(self, carry: Vector, step: Vector, axes: Vector,
                     table: Vector) -> Vector:
        """Return the acceleration of a block's last link, and those of its joints."""
        lanes = self.blocks.lanes_of(carry[0])
        S = packed_rows(axes, lanes)
        V, G = np.split(packed_rows(table, lanes), 2)

        # About the origin of the block, the link before it has alpha x D in addition.
        linear = carry[:3] + cross(carry[3:], step[:3])
        a = np.array([*linear, *carry[3:]], dtype=object)
        # u'_j = -(G a + bias)_j from the first joint on;
        # each one accelerates those after it.
        forced = V[TWIST] + V[:TWIST] @ a
        udot = []
        for joint in range(LANES):
            udot.append(-lanes.lane(forced, joint))
            forced = forced + G[joint] * udot[joint]
        of_joints = lanes.pack(udot)
        gained = [total(row * of_joints, lanes) for row in S]
        return np.array([*(a + np.array(gained, dtype=object)), *udot])


def _moments(pose: BlockPose, motion: tuple[Vector, Vector, Vector, Vector]) -> list[Any]:
    """Return h = int r dm, the upper triangle of int r r^T dm, force and moment."""
    mass, first, second = pose.link_moments()
    link = link_momenta(pose.R, pose.p, mass, first, second, motion)
    return [*link.h, *link.S[UPPER], *link.force, *link.moment]
