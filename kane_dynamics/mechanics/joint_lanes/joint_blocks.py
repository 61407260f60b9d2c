"""
Blocks of joints in series, in lanes: constants, poses, and inertia of what they carry.

Each block has world axes about the origin of its last link. Then nothing rotates or
shifts within a block, and numbers are not larger than those of a few links, however long
the chain is. Poses within a block are products of those before, in as many turns as
doubling takes; inertias are sums in as many turns.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.lanes import LANES, Lanes
from kane_dynamics.mechanics.algebra.vector import cross
from kane_dynamics.mechanics.joint_lanes.block_rows import (composed, of_joint,
                                                            packed_rows, sines,
                                                            sums_beyond)
from kane_dynamics.mechanics.joint_lanes.branches import (Branch, branches, Column,
                                                          Columns)
from kane_dynamics.mechanics.recursive.link import Link
from kane_dynamics.mechanics.recursive.subroutines import Repeat
import numpy as np

LanesOf = Callable[[Scalar], Any]
UPPER = np.triu_indices(3)
LAST = LANES - 1
TWIST = 6  # lanes of a twist or a wrench; forward dynamics uses the next one too
MOMENTS = 9  # first moment, and the upper triangle of the second one


def plain_lanes(scalar: Scalar) -> Any:
    """Return the functions of lanes for any scalar."""
    return Lanes


class BlockPose(NamedTuple):
    """
    Poses of the links of a block, in world axes about the origin of its last link.

    Attributes
    ----------
    R, p : (3, 3), (3,) arrays of rows
        Rotations and positions.
    D : (3,) array
        From the origin of the link before the block to that of its last link.
    sigma, axis : (3,) arrays of rows
        Twists for unit rates of the joints: linear and angular.
    inertial : list of rows
        Mass, first moment, and the upper triangle of the second one, in link axes.

    """

    R: Matrix
    p: Vector
    D: Vector
    sigma: Vector
    axis: Vector
    inertial: list[Any]

    def link_moments(self) -> tuple[Any, Vector, Matrix]:
        """Return mass, first and second moment of the links in their own axes."""
        mass = self.inertial[0]
        first = np.array(self.inertial[1:4], dtype=object)
        xx, xy, xz, yy, yz, zz = self.inertial[4:]
        second = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=object)
        return mass, first, second


class Bodies(NamedTuple):
    """
    The links from each joint of a block to its end, as one body.

    Attributes
    ----------
    S : (6,) array of rows
        Twists for unit rates of the joints.
    mass : row
        Of the body.
    moments : (9 + k,) array of rows
        Its first moment, the upper triangle of the second one, and further sums.
    rotors : row
        Inertia of rotors.

    """

    S: Vector
    mass: Any
    moments: Vector
    rotors: Any


class JointBlocks:
    """
    The joints of a tree in blocks, for loops over the blocks of each branch.

    Parameters
    ----------
    links : sequence of Link
        Parents before children, each moved by a coordinate of its own, with multiplier
        1.
    armature : (n,) array
        Inertia of rotors.
    lanes_of : callable
        Takes a scalar and returns an object with the functions of `Lanes` for its type.
    repeat : callable
        `one_by_one`, or the same as a loop.

    Attributes
    ----------
    coordinates : list of int
        Of the links.
    branches : list of Branch
        Of the tree, parents before children.
    constants, rotors : Columns
        Tables for `pose`, and of masses and rotors for `carried`.

    """

    def __init__(self, links: Sequence[Link], armature: Vector, lanes_of: LanesOf,
                 repeat: Repeat) -> None:
        """Collect the constants of the joints."""
        self.lanes_of = lanes_of
        self.repeat = repeat
        self.coordinates = [link.coordinate for link in links]
        self.branches = branches(links)
        rotors = [armature[coordinate] for coordinate in self.coordinates]
        masses = [link.mass for link in links]

        # Joints that fill blocks are at rest, without mass, and accelerate nothing.
        self.constants = Columns(self.branches, [*_placement(links), *_inertial(links)])
        self.rotors = Columns(self.branches, [(masses, 0.0), (rotors, 1.0)])

    def by_blocks(self, branch: Branch, x: Vector) -> Matrix:
        """Return entries of coordinates in blocks, (blocks, LANES)."""
        return branch.by_blocks([x[c] for c in self.coordinates], 0.0)

    def pose(self, before: Vector, x: Any, table: Vector, lanes: Any) -> BlockPose:
        """
        Return the poses of a block.

        Parameters
        ----------
        before : (9,) array
            Rotation of the link before the block.
        x : row
            Positions of the joints.
        table : array
            Row of `constants`.
        lanes : object
            The functions of lanes.

        """
        constants = self.constants.rows(table, lanes)
        offset, turning, sliding = constants[:3]
        rotation = np.array(constants[3:12], dtype=object).reshape(3, 3)
        translation = np.array(constants[12:15], dtype=object)

        # Each link in the axes of the one before, then all in those before the block.
        s, c = sines(turning * x + offset, lanes)
        R = np.stack([c * rotation[:, 0] + s * rotation[:, 1],
                      c * rotation[:, 1] - s * rotation[:, 0],
                      rotation[:, 2]], axis=1)
        p = translation + rotation[:, 2] * (sliding * x)
        R, p = composed(R, p, lanes)

        # World axes, about the origin of the last link.
        to_world = before.reshape(3, 3)
        R = to_world @ R
        p = to_world @ p
        D = of_joint(p, LAST, lanes)
        p = p - D
        z = R[:, 2]
        sigma = turning * cross(p, z) + sliding * z
        return BlockPose(R, p, D, sigma, turning * z, constants[15:])

    def bodies(self, entries: Vector, table: Vector, lanes: Any) -> Bodies:
        """
        Return the bodies that the joints of a block carry.

        Parameters
        ----------
        entries : array
            Of rows: twists of the joints, first and second moments of the links, and
            further quantities to be summed.
        table : array
            Row of `rotors`.
        lanes : object
            The functions of lanes.

        """
        mass, rotors = self.rotors.rows(table, lanes)
        rows = packed_rows(entries, lanes)
        of_links = np.array([mass, *rows[TWIST:]], dtype=object)
        summed = sums_beyond(of_links, lanes)
        return Bodies(rows[:TWIST], summed[0], summed[1:], rotors)


def _placement(links: Sequence[Link]) -> list[Column]:
    """Return columns of offsets, kinds, rotations and translations of joints."""
    offsets = []
    turning = []
    sliding = []
    rotations = []
    translations = []
    for link in links:
        # The kind is a factor, 0 or 1, so that one loop serves both kinds.
        is_turning = link.kind == 'revolute'
        offsets.append(link.offset)
        turning.append(float(is_turning))
        sliding.append(float(not is_turning))
        rotations.append(link.rotation)
        translations.append(link.translation)
    return [(offsets, 0.0), (turning, 0.0), (sliding, 0.0),
            *_columns(rotations, np.eye(3)), *_columns(translations, np.zeros(3))]


def _inertial(links: Sequence[Link]) -> list[Column]:
    """Return columns of masses, and of first and second moments in link axes."""
    masses = []
    first = []
    second = []
    for link in links:
        masses.append(link.mass)
        first.append(link.first_moment)
        second.append(link.second_moment[UPPER])
    return [(masses, 0.0), *_columns(first, np.zeros(3)),
            *_columns(second, np.zeros(len(UPPER[0])))]


def _columns(arrays: Sequence[Any], filled: Any) -> list[Column]:
    """Return a column for each entry of the arrays, padded with that of `filled`."""
    entries = [np.ravel(array) for array in arrays]
    result: list[Column] = []
    for k, value in enumerate(np.ravel(filled)):
        result.append(([row[k] for row in entries], float(value)))
    return result


def block_mass_matrix(F: Vector, S: Vector, lanes: Any) -> list[Any]:
    """Return the rows M_jk = F_j . S_k, which are valid for joints k up to j."""
    return [of_joint(F, joint, lanes) @ S for joint in range(LANES)]


class Elimination(NamedTuple):
    """
    The equations M x = b of a block, eliminated from the last joint on.

    Attributes
    ----------
    rows, scaled : (LANES, ...) arrays
        Right sides after elimination, and divided by the pivots.
    G : list of rows
        Joint j has x_j = scaled_j - sum G_jk x_k over the joints k before it.

    """

    rows: Any
    scaled: Any
    G: list[Any]


def eliminated(M: Sequence[Any], rotors: Any, rows: Any, lanes: Any) -> Elimination:
    """Eliminate the joints of a block; `rows` has the right sides of each."""
    M = list(M)
    rows = rows.copy()
    scaled = np.empty_like(rows)
    G: list[Any] = [None] * LANES
    for joint in reversed(range(LANES)):
        # The pivot M_jj with the joint's rotor, which no other joint accelerates.
        pivot = lanes.lane(M[joint], joint) + lanes.lane(rotors, joint)
        reciprocal = 1.0 / pivot
        G[joint] = reciprocal * M[joint]
        scaled[joint] = reciprocal * rows[joint]
        # Joints before lose M_jk / M_jj of the row.
        for k in reversed(range(joint)):
            factor = lanes.lane(M[joint], k)
            M[k] = M[k] - factor * G[joint]
            rows[k] = rows[k] - factor * scaled[joint]
    return Elimination(rows, scaled, G)


def inertia_rows(mass: Any, moments: Sequence[Any]) -> list[list[Any]]:
    """Return the rows of inertias: wrenches for the unit rates of a twist."""
    # [m 1, -[h]x; [h]x, I], with the first moment h and I = tr(S) 1 - S.
    x, y, z = moments[:3]
    xx, xy, xz, yy, yz, zz = moments[3:]
    return [[mass, 0.0, 0.0, 0.0, z, -y],
            [0.0, mass, 0.0, -z, 0.0, x],
            [0.0, 0.0, mass, y, -x, 0.0],
            [0.0, -z, y, yy + zz, -xy, -xz],
            [z, 0.0, -x, -xy, xx + zz, -yz],
            [-y, x, 0.0, -xz, -yz, xx + yy]]


def shifted_wrenches(rows: Sequence[Any], D: Vector) -> Vector:
    """Return wrenches (6,) of rows about the origin that is D before theirs."""
    force = np.array(rows[:3], dtype=object)
    moment = np.array(rows[3:], dtype=object) + cross(D, force)
    return np.concatenate([force, moment])


def shifted_inertia(rows: Sequence[Any], D: Vector, lanes: Any) -> Vector:
    """Return the rows of an inertia about the origin that is D before theirs."""
    x, y, z = D
    # A twist about that origin is one about theirs with omega x D less: columns.
    back = [0.0] * 3
    over = lanes.pack([*back, y, z, x, 0.0, 0.0])
    under = lanes.pack([*back, z, x, y, 0.0, 0.0])
    columns = []
    for row in rows:
        columns.append(row + lanes.gathered([row], _places(3, (2, 0, 1))) * over
                       - lanes.gathered([row], _places(3, (1, 2, 0))) * under)
    return shifted_wrenches(columns, D)


def _places(begin: int, sources: tuple[int, int, int]) -> list[tuple[int, int] | None]:
    """Return the places of a gather that puts three lanes of a row after `begin`."""
    places: list[tuple[int, int] | None] = [None] * LANES
    for k, source in enumerate(sources):
        places[begin + k] = (0, source)
    return places
