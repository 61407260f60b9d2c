"""
Mass matrix and its inverse, by blocks of joints in lanes.

The entries of either matrix for the joints of a block B and those of a block J beyond
are A_B P, where the columns of P are wrenches at the last link of B, one for each joint
of J. From block to block toward the root, P changes by the same matrix for all joints
beyond: P_before = T_B P. Both matrices then take n^2 / 2 products of six numbers, and
6 n^2 / 16 for the changes of P, for any length of the chain by the same code.

Of the mass matrix, P are the wrenches that accelerate composite bodies, A_B the twists
of the joints, and T_B shifts wrenches. Of the inverse, P are the wrenches of articulated
bodies that unit torques of the joints of J hand on; with the mass matrix M_B of the
articulated block, F_B = K S_B and the compliance C of the link before,

    P_B = M_B^-1 F_B,   T_B = 1 - F_B M_B^-1 S_B^T,   A_B = P_B^T C T_B - M_B^-1 S_B^T.

Joints of M_B move against each other with M_B^-1 + P_B^T C P_B, and the last link has
the compliance T_B^T C T_B + S_B M_B^-1 S_B^T, the inverse of the inertia that a wrench
feels (Lilly & Orin 1993; Featherstone, Rigid Body Dynamics Algorithms, ch. 7, has T_B of
one joint).
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Matrix, Vector
from kane_dynamics.mechanics.algebra.lanes import LANES
from kane_dynamics.mechanics.algebra.vector import cross, is_zero, symmetric
from kane_dynamics.mechanics.joint_lanes.block_rows import (of_joint, packed_rows,
                                                            symmetric_rows, unpacked)
from kane_dynamics.mechanics.joint_lanes.joint_blocks import (block_mass_matrix,
                                                              eliminated, inertia_rows,
                                                              JointBlocks, LAST,
                                                              shifted_inertia,
                                                              shifted_wrenches, TWIST,
                                                              UPPER)
from kane_dynamics.mechanics.joint_lanes.link_momenta import link_momenta
import numpy as np

Step = Callable[..., Vector]
Tables = Sequence[Sequence[Matrix]]  # of each branch, the tables of a step

ROTATION = 9
BEGIN = 16  # of the rows among the results of `place`; D is before them
WRENCHES = TWIST * LANES  # entries of six rows
TILE = LANES * LANES
FORCES = slice(BEGIN, BEGIN + 3 * LANES)  # of P among the results of `_composite`
MOMENTS_OF_P = slice(FORCES.stop, BEGIN + WRENCHES)
BODY = 10  # mass and moments


class Beyond(NamedTuple):
    """
    The loop from a block to the root that computes tiles A_B P.

    Attributes
    ----------
    name : str
    step : callable
        Takes the part of P that changes, the fixed one, and a row of each table.
    changing, fixed : list of arrays
        Parts of P for the blocks of each branch.
    tables : list of tuples of arrays
        Of each branch.

    """

    name: str
    step: Step
    changing: Sequence[Matrix]
    fixed: Sequence[Matrix]
    tables: Tables


class Beside(NamedTuple):
    """
    Loops outward over branches that do not carry a block.

    Attributes
    ----------
    compliances : list of arrays
        Of the last link of each branch.
    tables : list of tuples of arrays
        Of each branch.

    """

    compliances: Sequence[Vector]
    tables: Tables


class ArticulatedBlocks(NamedTuple):
    """
    Articulated bodies of the blocks of one branch, as rows; see the module.

    Attributes
    ----------
    P, T : arrays
        About the origin of the link before each block.
    compliance : array
        S M^-1 S^T.
    inverse : array
        M^-1 S^T, then M^-1.

    """

    P: Matrix
    T: Matrix
    compliance: Matrix
    inverse: Matrix

    @staticmethod
    def of_factors(rows: Matrix) -> 'ArticulatedBlocks':
        """Return them from the results of `_factors`, which begin with the inertia."""
        _, *parts = np.split(rows, np.cumsum([WRENCHES] * 4), axis=1)
        return ArticulatedBlocks(*parts)


class BlockMatrices:
    """
    Loops over the blocks of a tree, at one configuration.

    Parameters
    ----------
    blocks : JointBlocks
    q : (n,) array of scalars

    """

    def __init__(self, blocks: JointBlocks, q: Vector) -> None:
        """Place the links."""
        self.blocks = blocks
        self.lanes = blocks.lanes_of
        # From the root outward:
        # a branch begins with the rotation that its parent ends with.
        self.placements: list[Matrix] = []
        for branch, table in zip(blocks.branches, blocks.constants.tables):
            carry = np.eye(3).ravel()
            if branch.parent is not None:
                carry = self.placements[branch.parent][-1, :ROTATION]
            self.placements.append(blocks.repeat('place', self._place, carry,
                                                 blocks.by_blocks(branch, q), table))
        # A row has the rotation, then D with its filling,
        # then the rows of twists and moments.
        self.steps = [x[:, ROTATION:BEGIN] for x in self.placements]
        self.bodies = [x[:, BEGIN:] for x in self.placements]

    def _place(self, carry: Vector, q: Vector, table: Vector) -> Vector:
        """Return the last rotation of a block, D, then twists and moments."""
        lanes = self.lanes(carry[0])
        pose = self.blocks.pose(carry, lanes.pack(list(q)), table, lanes)
        # Only first and second moments are needed:
        # at rest, all momenta and forces vanish.
        mass, first, second = pose.link_moments()
        at_rest = (np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3))
        link = link_momenta(pose.R, pose.p, mass, first, second, at_rest)
        last = of_joint(pose.R.ravel(), LAST, lanes)
        # The rows begin at a multiple of the lanes.
        filled = [0.0] * (BEGIN - ROTATION - 3)
        rows = [*pose.sigma, *pose.axis, *link.h, *link.S[UPPER]]
        return np.array([*last, *pose.D, *filled, *unpacked(rows, lanes)])

    # Mass matrix: composite bodies.

    def mass_matrix(self) -> Matrix:
        """Return the mass matrix with rotors, (n, n)."""
        # Inward: composite bodies, with the tiles of joints of the same block.
        results = self._inward('composite', self._composite, BODY)
        M = self._by_tiles([x[:, -TILE:] for x in results])

        # Forces do not change where wrenches are shifted.
        moments = [x[:, MOMENTS_OF_P] for x in results]
        forces = [x[:, FORCES] for x in results]
        tables = [(x[:, :WRENCHES], step) for x, step in zip(self.bodies, self.steps)]
        self._place_beyond(M, Beyond('composite_tile', self._composite_tile, moments,
                                     forces, tables))
        return M

    def _composite(self, carry: Vector, step: Vector, entries: Vector,
                   table: Vector) -> Vector:
        """
        Return the composite body that a block hands on, its wrenches, and its tile of M.

        Wrenches and body are about the origin of the link before.
        """
        lanes = self.lanes(carry[0])
        D = step[:3]
        bodies = self.blocks.bodies(entries, table, lanes)
        S = bodies.S
        # Composite body of each joint:
        # the links from it to the end of the block, and all beyond.
        mass = bodies.mass + carry[0]
        moments = bodies.moments + carry[1:]
        # Wrenches F = I S that accelerate it, and M_jk = S_j . F_k with the rotors.
        F = np.array(inertia_rows(mass, moments), dtype=object) @ S
        M = symmetric_rows(block_mass_matrix(F, S, lanes), lanes)
        if not is_zero(bodies.rotors):
            for joint in range(LANES):
                alone = [k == joint for k in range(LANES)]
                M[joint] = M[joint] + lanes.blend(alone, bodies.rotors, 0.0)

        # All links of the block and beyond, by the parallel axis theorem.
        m, *h_and_second = of_joint([mass, *moments], 0, lanes)
        h = np.array(h_and_second[:3])
        h_before = h + m * D
        change = symmetric(np.outer(D, h) + np.outer(h_before, D))
        second = np.array(h_and_second[3:]) + change[UPPER]
        handed = [m, *h_before, *second, *[0.0] * (BEGIN - BODY)]
        return np.array([*handed, *unpacked([*shifted_wrenches(F, D), *M], lanes)])

    def _composite_tile(self, carry: Vector, forces: Vector, axes: Vector,
                        step: Vector) -> Vector:
        """Return moments handed on by a block, and torques on its joints."""
        lanes = self.lanes(carry[0])
        force = packed_rows(forces, lanes)
        moment = packed_rows(carry, lanes)
        # About the origin of the link before: the moment of the force is added.
        handed = moment + cross(step[:3], force)
        A = axes.reshape(TWIST, LANES).T
        return _tile(handed, A, np.concatenate([force, moment]), lanes)

    # Inverse: articulated bodies.

    def inverse_mass_matrix(self) -> Matrix:
        """Return the inverse mass matrix, (n, n)."""
        # Inward: articulated bodies, with P and T of their blocks.
        factors = self._inward('factors', self._factors, WRENCHES)
        bodies = [ArticulatedBlocks.of_factors(rows) for rows in factors]

        # Outward: compliances of the last links, A, and the tiles of the same block.
        compliances = []
        A = []
        tiles = []
        for rows in self._responses(bodies):
            compliances.append(rows[-1, :WRENCHES])
            A.append(rows[:, WRENCHES:WRENCHES + TILE])
            tiles.append(rows[:, -TILE:])
        result = self._by_tiles(tiles)

        # Inward again, from each block: tiles A P of the blocks that carry it, and outward
        # those of the blocks beside it. No part of P is fixed.
        P = [body.P for body in bodies]
        T = [body.T for body in bodies]
        fixed = [rows[:, :0] for rows in factors]
        beyond = Beyond('response_tile', self._response_tile, P, fixed, list(zip(A, T)))
        self._place_beyond(result, beyond, Beside(compliances, list(zip(P, T))))
        return result

    def _factors(self, carry: Vector, step: Vector, entries: Vector,
                 table: Vector) -> Vector:
        """
        Return the articulated inertias and responses of a block, in rows.

        These are the inertia that the block hands on, P and T about the origin of the
        link before, then S M^-1 S^T, M^-1 S^T and M^-1 of the block.
        """
        lanes = self.lanes(carry[0])
        D = step[:3]
        beyond = carry.reshape(TWIST, LANES)[:, :TWIST]
        bodies = self.blocks.bodies(entries, table, lanes)
        S = bodies.S
        inertia = inertia_rows(bodies.mass, bodies.moments)
        # Wrenches F = K S for unit accelerations,
        # K being the inertia of links and of all beyond.
        F = np.array(inertia, dtype=object) @ S + beyond @ S
        M = block_mass_matrix(F, S, lanes)

        # M^-1 times F^T, S^T and 1, side by side.
        units = [lanes.pack(row.tolist()) for row in np.eye(LANES)]
        sides = [lanes.transposed([*F, 0.0, 0.0]), lanes.transposed([*S, 0.0, 0.0]), units]
        rows = np.array(sides, dtype=object).T
        rows, scaled, G = eliminated(M, bodies.rotors, rows, lanes)
        # Back substitution, from the first joint on.
        solved = scaled.copy()
        for joint in range(LANES):
            for k in range(joint):
                solved[joint] = solved[joint] - lanes.lane(G[joint], k) * solved[k]
        X, N, W = solved.T

        # The inertia K - F M^-1 F^T that the block hands on, about the origin of the link
        # before: F M^-1 F^T is a sum of products of eliminated and scaled rows.
        handed = packed_rows(carry, lanes)
        for k, of_wrench in enumerate(inertia):
            handed[k] = handed[k] + lanes.pack(of_joint(of_wrench, 0, lanes).tolist())
            for joint in range(LANES):
                handed[k] = handed[k] - lanes.lane(rows[joint, 0], k) * scaled[joint, 0]
        handed = shifted_inertia(handed, D, lanes)

        # T = 1 - F M^-1 S^T, and the compliance S M^-1 S^T of the block by itself.
        P = lanes.transposed(X)[:TWIST]
        T = []
        C = []
        for k in range(TWIST):
            T.append(units[k] - of_lanes(F[k], lanes) @ N)
            C.append(of_lanes(S[k], lanes) @ N)
        return np.array(unpacked([*handed, *shifted_wrenches(P, D),
                                  *shifted_wrenches(T, D), *C, *N, *W], lanes))

    def _responses(self, bodies: Sequence[ArticulatedBlocks]) -> list[Matrix]:
        """Return the results of `_response` for each branch."""
        results: list[Matrix] = []
        # The world does not yield to wrenches.
        base = np.zeros(WRENCHES).astype(object)
        for branch, body in zip(self.blocks.branches, bodies):
            carry = base
            if branch.parent is not None:
                carry = results[branch.parent][-1, :WRENCHES]
            results.append(self.blocks.repeat('response', self._response, carry, *body))
        return results

    def _response(self, carry: Vector, wrenches: Vector, changes: Vector,
                  compliance: Vector, inverse: Vector) -> Vector:
        """Return the compliance of the last link, A, and the tile of the inverse."""
        lanes = self.lanes(carry[0])
        before = carry.reshape(TWIST, LANES)[:, :TWIST]
        P = packed_rows(wrenches, lanes)
        T = packed_rows(changes, lanes)
        N, W = np.split(packed_rows(inverse, lanes), 2)
        # The compliance C of the link before: C P and C T.
        by_torque = before @ P
        by_wrench = before @ T
        # A = P^T C T - M^-1 S^T, and the tile P^T C P + M^-1.
        A = []
        tile = []
        for joint in range(LANES):
            wrench = of_joint(P, joint, lanes)
            A.append(wrench @ by_wrench - N[joint])
            tile.append(wrench @ by_torque + W[joint])
        # The compliance of the last link, T^T C T + S M^-1 S^T.
        C = packed_rows(compliance, lanes)
        for k in range(TWIST):
            C[k] = C[k] + of_joint(T, k, lanes) @ by_wrench
        return np.array(unpacked([*C, *A, *symmetric_rows(tile, lanes)], lanes))

    def _response_tile(self, carry: Vector, nothing: Vector, responses: Vector,
                       changes: Vector) -> Vector:
        """Return wrenches handed on by a block, and accelerations of its joints."""
        lanes = self.lanes(carry[0])
        P = packed_rows(carry, lanes)
        T = changes.reshape(TWIST, LANES)[:, :TWIST]
        A = responses.reshape(LANES, LANES)[:, :TWIST]
        return _tile(T @ P, A, P, lanes)

    def _compliant(self, carry: Vector, compliance: Vector) -> Vector:
        """Return the accelerations of a link, against wrenches that act on it."""
        lanes = self.lanes(carry[0])
        C = compliance.reshape(TWIST, LANES)[:, :TWIST]
        return np.array(unpacked(C @ packed_rows(carry, lanes), lanes))

    def _beside(self, carry: Vector, wrenches: Vector, changes: Vector) -> Vector:
        """Return accelerations handed outward by a block, and those of its joints."""
        lanes = self.lanes(carry[0])
        a = packed_rows(carry, lanes)
        T = changes.reshape(TWIST, LANES)[:, :TWIST]
        P = wrenches.reshape(TWIST, LANES)
        return _tile(T.T @ a, P.T, a, lanes)

    # Both: loops from the ends to the root, and tiles of the matrix.

    def _inward(self, name: str, step: Step, carried: int) -> list[Matrix]:
        """Return the results of a step from the ends to the root, for each branch."""
        blocks = self.blocks
        results: list[Any] = [None] * len(blocks.branches)
        # A branch begins with the sum of what the branches at its end hand on.
        for k in reversed(range(len(blocks.branches))):
            carry = np.zeros(carried).astype(object)
            for child in blocks.branches[k].children:
                carry = carry + results[child][0, :carried]
            results[k] = blocks.repeat(name, step, carry, self.steps[k], self.bodies[k],
                                       blocks.rotors.tables[k], reverse=True)
        return results

    def _by_tiles(self, diagonal: Sequence[Matrix]) -> Matrix:
        """Return a matrix with the tiles of all blocks by themselves, (n, n)."""
        n = len(self.blocks.coordinates)
        result = np.zeros((n, n), dtype=object)
        for branch, tiles in enumerate(diagonal):
            for block, entries in enumerate(tiles):
                joints = self._joints(branch, block)
                _write(result, joints, joints, entries)
        return result

    def _place_beyond(self, result: Matrix, beyond: Beyond,
                      beside: Beside | None = None) -> None:
        """
        Write the tiles of different blocks.

        With `beside`, also those of blocks that do not carry one another.
        """
        name, step, changing, fixed, tables = beyond
        for branch, of_blocks in enumerate(changing):
            for block, carry in enumerate(of_blocks):
                columns = self._joints(branch, block)
                last = branch
                # P is carried from branch to branch:
                # each gets the tiles of all its blocks.
                for carrier, count in self._toward_root(branch, block):
                    if beside is not None and carrier != branch:
                        self._place_beside(result, columns, carry, carrier, last, beside)
                    last = carrier
                    if not count:
                        continue
                    # A block of the same branch is carried only by those before it.
                    same = np.repeat(fixed[branch][block][None], count, axis=0)
                    carriers = [table[:count] for table in tables[carrier]]
                    rows = self.blocks.repeat(name, step, carry, same, *carriers,
                                              reverse=True)
                    self._write_tiles(result, rows, carrier, columns)
                    # The next branch toward the root begins where this one ends.
                    carry = rows[0, :len(carry)]

    def _place_beside(self, result: Matrix, columns: Sequence[int], wrenches: Vector,
                      carrier: int, last: int, beside: Beside) -> None:
        """Write tiles of the branches that a branch carries, before one of them."""
        children = self.blocks.branches[carrier].children
        # Every pair of branches is met from both sides; one side writes both tiles.
        earlier = children[:children.index(last)]
        if not earlier:
            return
        repeat = self.blocks.repeat
        # The wrenches accelerate the last link by C P;
        # the branches beside follow it outward.
        compliance = beside.compliances[carrier]
        a = repeat('compliant', self._compliant, wrenches, compliance[None])[0]
        accelerations = dict.fromkeys(earlier, a)
        pending = list(earlier)
        while pending:
            branch = pending.pop()
            rows = repeat('beside', self._beside, accelerations[branch],
                          *beside.tables[branch])
            self._write_tiles(result, rows, branch, columns)
            for child in self.blocks.branches[branch].children:
                accelerations[child] = rows[-1, :WRENCHES]
                pending.append(child)

    def _write_tiles(self, result: Matrix, rows: Matrix, branch: int,
                     columns: Sequence[int]) -> None:
        """Write the tiles of blocks of a branch, and their transposes."""
        for block, entries in enumerate(rows):
            joints = self._joints(branch, block)
            tile, transposed = np.split(entries[-2 * TILE:], 2)
            _write(result, joints, columns, tile)
            _write(result, columns, joints, transposed)

    def _toward_root(self, branch: int, block: int) -> Iterator[tuple[int, int]]:
        """Yield branches that carry a block, and how many of their blocks do."""
        yield branch, block
        parent = self.blocks.branches[branch].parent
        while parent is not None:
            yield parent, self.blocks.branches[parent].blocks
            parent = self.blocks.branches[parent].parent

    def _joints(self, branch: int, block: int) -> list[int]:
        """Return the coordinates of a block's joints."""
        links = self.blocks.branches[branch].links[block * LANES:(block + 1) * LANES]
        return [self.blocks.coordinates[link] for link in links]


def of_lanes(row: Any, lanes: Any) -> Vector:
    """Return the scalars of a row, (LANES,)."""
    return np.array([lanes.lane(row, k) for k in range(LANES)], dtype=object)


def _tile(handed: Sequence[Any], A: Matrix, P: Vector, lanes: Any) -> Vector:
    """Return the entries of wrenches, of A P and of its transpose."""
    tile = A @ P
    return np.array(unpacked([*handed, *tile, *lanes.transposed(tile)], lanes))


def _write(result: Matrix, rows: Sequence[int], columns: Sequence[int],
           entries: Vector) -> None:
    """Write a tile, without the joints that fill blocks."""
    tile = entries.reshape(LANES, LANES)
    result[np.ix_(rows, columns)] = tile[:len(rows), :len(columns)]
