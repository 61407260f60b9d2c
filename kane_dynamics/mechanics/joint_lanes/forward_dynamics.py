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
product hands both to the joint before. Three loops go over blocks of `LANES` joints:

* outward, the motion, in lanes of joints: rotations, positions and velocities within a
  block are products and sums of those before, in as many turns as doubling takes;
* inward, K and the wrench, joint by joint;
* outward, the accelerations.

Each block has world axes about the origin of its last link, which moves with its
velocity, uniformly. Then nothing rotates or shifts within a block, and numbers are not
larger than those of a few links, however long the chain is.
"""

from collections.abc import Callable, Sequence
from typing import Any

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.lanes import LANES, Lanes
from kane_dynamics.mechanics.algebra.vector import cross
from kane_dynamics.mechanics.joint_lanes.branches import (Branch, branches, Column,
                                                          Columns)
from kane_dynamics.mechanics.joint_lanes.link_momenta import link_momenta
from kane_dynamics.mechanics.recursive.link import Link
from kane_dynamics.mechanics.recursive.subroutines import one_by_one, Repeat
import numpy as np

LanesOf = Callable[[Scalar], Any]
UPPER = np.triu_indices(3)
LAST = LANES - 1
TWIST = 6  # lanes of a twist or a wrench; the next one has the force or the torque
IN_TWIST = [k < TWIST for k in range(LANES)]
BEYOND = [k == TWIST for k in range(LANES)]
CARRIED_MOTION = 18  # rotation, angular velocity and acceleration, acceleration
BEGIN = 24  # of the rows among the results of `motion`: those of D are before it
AXES = slice(BEGIN, BEGIN + 6 * LANES)
BODIES = slice(BEGIN, BEGIN + 21 * LANES)
CARRIED_ROWS = TWIST * LANES


def plain_lanes(scalar: Scalar) -> Any:
    """Return the functions of lanes for any scalar."""
    return Lanes


def forward_dynamics(links: Sequence[Link], q: Vector, u: Vector, torque: Vector,
                     armature: Vector, gravity: Vector,
                     lanes_of: LanesOf = plain_lanes,
                     repeat: Repeat = one_by_one) -> Vector:
    """
    Return the accelerations of the joints, (n,).

    Parameters
    ----------
    links : sequence of Link
        Parents before children, each moved by a coordinate of its own, with multiplier
        1.
    q, u : (n,) arrays of scalars
        Coordinates and their rates.
    torque : (n,) array of scalars
        Of the joints: what accelerates them, beside gravity.
    armature : (n,) array
        Inertia of rotors.
    gravity : (3,) array of scalars
        m/s^2, world axes.
    lanes_of : callable
        Takes a scalar and returns an object with the functions of `Lanes` for its type.
    repeat : callable
        `one_by_one`, or the same as a loop.

    """
    blocks = JointBlocks(links, armature, lanes_of, repeat)
    motions = blocks.motions(q, u, gravity)
    shares = blocks.shares(motions, torque)
    return blocks.accelerations(motions, shares)


class JointBlocks:
    """
    The three loops, for each branch of a tree.

    Parameters
    ----------
    links, armature, lanes_of, repeat
        As of `forward_dynamics`.

    """

    def __init__(self, links: Sequence[Link], armature: Vector, lanes_of: LanesOf,
                 repeat: Repeat) -> None:
        """Collect the constants of the joints."""
        self.lanes_of = lanes_of
        self.repeat = repeat
        self.coordinates = [link.coordinate for link in links]
        self.branches = branches(links)

        # Each with the value of joints that fill blocks: at rest, without mass.
        turning = [float(link.kind == 'revolute') for link in links]
        sliding = [1.0 - x for x in turning]
        rotations = [link.rotation for link in links]
        translations = [link.translation for link in links]
        placement: list[Column] = [([link.offset for link in links], 0.0),
                                   (turning, 0.0), (sliding, 0.0)]
        for i, j in np.ndindex(3, 3):
            placement.append((_entries(rotations, i, j), float(i == j)))
        for i in range(3):
            placement.append((_entries(translations, i), 0.0))
        masses: Column = [link.mass for link in links], 0.0
        inertial = [masses]
        first = [link.first_moment for link in links]
        second = [link.second_moment for link in links]
        for i in range(3):
            inertial.append((_entries(first, i), 0.0))
        for i, j in zip(*(index.tolist() for index in UPPER)):
            inertial.append((_entries(second, i, j), 0.0))
        self.constants = Columns(self.branches, [*placement, *inertial])
        rotors = [armature[link.coordinate] for link in links]
        self.rotors = Columns(self.branches, [masses, (rotors, 1.0)])

    def _by_blocks(self, branch: Branch, x: Vector) -> Matrix:
        """Return entries of coordinates in blocks, (blocks, LANES)."""
        return branch.by_blocks([x[c] for c in self.coordinates], 0.0)

    # Outward: motion without accelerations of the joints.

    def motions(self, q: Vector, u: Vector, gravity: Vector) -> list[Matrix]:
        """Return the results of `motion` for each branch, (blocks, 18 + ...)."""
        base = np.concatenate([np.eye(3).ravel(), np.zeros(6), -gravity])
        results: list[Matrix] = []
        for branch, table in zip(self.branches, self.constants.tables):
            carry = base
            if branch.parent is not None:
                carry = results[branch.parent][-1, :CARRIED_MOTION]
            results.append(self.repeat('motion', self.motion, carry,
                                       self._by_blocks(branch, q),
                                       self._by_blocks(branch, u), table))
        return results

    def motion(self, carry: Vector, q: Vector, u: Vector, table: Vector) -> Vector:
        """Return motion, inertia and wrenches of a block, from the link before it."""
        lanes = self.lanes_of(carry[0])
        constants = self.constants.rows(table, lanes)
        offset, turning, sliding = constants[:3]
        rotation = np.array(constants[3:12], dtype=object).reshape(3, 3)
        translation = np.array(constants[12:15], dtype=object)
        before = carry[:9].reshape(3, 3)
        omega_before, alpha_before, a_before = np.split(carry[9:], 3)

        # Poses in the axes of the link before, then in those of the world, about the
        # origin of the last link.
        x = lanes.pack(list(q))
        rate = lanes.pack(list(u))
        s, c = _sines(turning * x + offset, lanes)
        R = np.stack([c * rotation[:, 0] + s * rotation[:, 1],
                      c * rotation[:, 1] - s * rotation[:, 0],
                      rotation[:, 2]], axis=1)
        p = translation + rotation[:, 2] * (sliding * x)
        R, p = _composed(R, p, lanes)
        R = before @ R
        p = before @ p
        D = np.array([lanes.lane(y, LAST) for y in p])
        p = p - D

        # Axes, and velocities from the first one's; the last one's is zero.
        z = R[:, 2]
        sigma = turning * cross(p, z) + sliding * z
        axis = turning * z
        omega = omega_before + _sums(rate * axis, lanes)
        travel = _sums(rate * sigma, lanes)
        v_last = np.array([lanes.lane(y, LAST) for y in travel])
        v = travel - v_last

        # Accelerations: of the link before about this origin, then sums of (v x S) u.
        a_first = (a_before + cross(alpha_before, D)
                   + cross(omega_before, cross(omega_before, D))
                   + cross(omega_before, v_last))
        slide = cross(omega, sigma) + cross(v, axis)
        turn = cross(omega, axis)
        a = a_first + _sums(rate * slide, lanes)
        alpha = alpha_before + _sums(rate * turn, lanes)

        moments = _moments(R, p, (v, omega, a, alpha), constants[15:])
        last = []
        for y in (*R.ravel(), *omega, *alpha, *a):
            last.append(lanes.lane(y, LAST))
        filled = [0.0] * (BEGIN - CARRIED_MOTION - 3)
        rows = _unpacked([*sigma, *axis, *moments], lanes)
        return np.array([*last, *D, *filled, *rows])

    # Inward: articulated inertia and wrench.

    def shares(self, motions: Sequence[Matrix], torque: Vector) -> list[Matrix]:
        """Return the results of `share` for each branch, (blocks, 48 + ...)."""
        results: list[Any] = [None] * len(self.branches)
        for k in reversed(range(len(self.branches))):
            branch = self.branches[k]
            carry = np.zeros(CARRIED_ROWS).astype(object)
            for child in branch.children:
                carry = carry + results[child][0, :CARRIED_ROWS]
            blocks = motions[k]
            results[k] = self.repeat(
                'share', self.share, carry, blocks[:, CARRIED_MOTION:BEGIN],
                blocks[:, BODIES], self._by_blocks(branch, torque),
                self.rotors.tables[k], reverse=True)
        return results

    def share(self, carry: Vector, step: Vector, bodies: Vector, torque: Vector,
              table: Vector) -> Vector:
        """
        Return what a block hands on, then V and G of its joints, 16 rows by columns.

        Joint k has the acceleration -V_k . (a, 1) - sum G_kj udot_j over the joints j of
        the block before it, with the acceleration a of the link before the block.
        """
        lanes = self.lanes_of(carry[0])
        mass, rotors = self.rotors.rows(table, lanes)
        of_joints = _packed_rows(bodies, lanes)
        S = of_joints[:TWIST]
        beyond = carry.reshape(TWIST, LANES)

        # The links from each joint to the end of the block as one body, and wrenches.
        moments = _sums_beyond(np.array([mass, *of_joints[TWIST:]], dtype=object), lanes)
        mass, wrench = moments[0], moments[10:] + beyond[:, TWIST]
        # Wrenches for a unit acceleration of each joint; M within the block.
        F = _accelerating_wrench(mass, moments[1:10], S) + beyond[:, :TWIST] @ S
        missing = S @ wrench - lanes.pack(list(torque))
        M = []
        for joint in range(LANES):
            M.append(np.array([lanes.lane(row, joint) for row in F], dtype=object) @ S)
        E = lanes.transposed([*F, missing, 0.0])

        # Eliminate the joints from the end on; those before lose M_jk / M_jj of each row.
        V: list[Any] = [None] * LANES
        G: list[Any] = [None] * LANES
        for joint in reversed(range(LANES)):
            pivot = lanes.lane(M[joint], joint) + lanes.lane(rotors, joint)
            reciprocal = 1.0 / pivot
            G[joint] = reciprocal * M[joint]
            V[joint] = reciprocal * E[joint]
            for k in reversed(range(joint)):
                factor = lanes.lane(M[joint], k)
                M[k] = M[k] - factor * G[joint]
                E[k] = E[k] - factor * V[joint]

        # The link before the block gets the rest of the inertia, and of the wrench.
        inertia = _inertia_rows(mass, moments[1:10])
        rows = _packed_rows(carry, lanes)
        for k, entries in enumerate(inertia):
            first = [lanes.lane(x, 0) for x in (*entries, moments[10 + k])]
            rows[k] = rows[k] + lanes.pack(first)
            for joint in range(LANES):
                rows[k] = rows[k] - lanes.lane(E[joint], k) * V[joint]
        rows = _shifted(rows, step[:3], lanes)
        of_joints = [*lanes.transposed(V), *lanes.transposed(G)]
        return np.array(_unpacked([*rows, *of_joints], lanes))

    # Outward: accelerations.

    def accelerations(self, motions: Sequence[Matrix],
                      shares: Sequence[Matrix]) -> Vector:
        """Return the accelerations of all joints, (n,)."""
        base = np.zeros(TWIST).astype(object)
        results: list[Matrix] = []
        udot: list[Scalar] = [0.0] * len(self.coordinates)
        for k, branch in enumerate(self.branches):
            carry = base
            if branch.parent is not None:
                carry = results[branch.parent][-1, :TWIST]
            result = self.repeat('acceleration', self.acceleration, carry,
                                 motions[k][:, CARRIED_MOTION:BEGIN],
                                 motions[k][:, AXES], shares[k][:, CARRIED_ROWS:])
            results.append(result)
            for link, value in zip(branch.links, result[:, TWIST:].flat):
                udot[self.coordinates[link]] = value
        return np.array(udot)

    def acceleration(self, carry: Vector, step: Vector, axes: Vector,
                     table: Vector) -> Vector:
        """Return the acceleration of a block's last link, and those of its joints."""
        lanes = self.lanes_of(carry[0])
        S = _packed_rows(axes, lanes)
        V, G = np.split(_packed_rows(table, lanes), 2)

        # About the origin of the block, the link before it has alpha x D in addition.
        linear = carry[:3] + cross(carry[3:], step[:3])
        a = np.array([*linear, *carry[3:]], dtype=object)
        forced = V[TWIST] + V[:TWIST] @ a
        udot = []
        for joint in range(LANES):
            udot.append(-lanes.lane(forced, joint))
            forced = forced + G[joint] * udot[joint]
        of_joints = lanes.pack(udot)
        gained = [_total(row * of_joints, lanes) for row in S]
        return np.array([*(a + np.array(gained, dtype=object)), *udot])


def _entries(arrays: Sequence[Any], *place: int) -> list[Any]:
    """Return one entry of each array."""
    return [array[place] for array in arrays]


def _composed(R: Matrix, p: Vector, lanes: Any) -> tuple[Matrix, Vector]:
    """Return rotations and positions of the links of a block from its beginning."""
    distance = 1
    while distance < LANES:
        # Products of twice as many steps, but for the first links, which are done.
        R_before = _moved(R.ravel(), distance, lanes).reshape(3, 3)
        p_before = _moved(p, distance, lanes)
        later = [k >= distance for k in range(LANES)]
        p = _blended(later, p_before + R_before @ p, p, lanes)
        product = (R_before @ R).ravel()
        R = _blended(later, product, R.ravel(), lanes).reshape(3, 3)
        distance = 2 * distance
    return R, p


def _sums(x: Vector, lanes: Any) -> Vector:
    """Return the sums over the joints of a block up to each one."""
    distance = 1
    while distance < LANES:
        x = x + _moved(x, distance, lanes)
        distance = 2 * distance
    return x


def _sums_beyond(x: Vector, lanes: Any) -> Vector:
    """Return the sums over the joints of a block from each one on."""
    distance = 1
    while distance < LANES:
        x = x + _moved(x, -distance, lanes)
        distance = 2 * distance
    return x


def _moved(x: Vector, distance: int, lanes: Any) -> Vector:
    """Return the values of the joint at this distance before each; 0 if there is none."""
    sources = range(-distance, LANES - distance)
    places = [(0, k) if 0 <= k < LANES else None for k in sources]
    return np.array([lanes.gathered([y], places) for y in x], dtype=object)


def _blended(mask: Sequence[bool], x: Vector, y: Vector, lanes: Any) -> Vector:
    """Return the entries of x where the mask is true, of y elsewhere."""
    pairs = zip(x, y)
    return np.array([lanes.blend(mask, a, b) for a, b in pairs], dtype=object)


def _sines(angles: Any, lanes: Any) -> tuple[Any, Any]:
    """Return rows of sines and cosines."""
    sines = []
    cosines = []
    for k in range(LANES):
        angle = lanes.lane(angles, k)
        sines.append(np.sin(angle))
        cosines.append(np.cos(angle))
    return lanes.pack(sines), lanes.pack(cosines)


def _moments(R: Matrix, p: Vector, motion: tuple[Vector, Vector, Vector, Vector],
             inertial: Sequence[Any]) -> list[Any]:
    """Return h = int r dm, the upper triangle of int r r^T dm, force and moment."""
    mass = inertial[0]
    first = np.array(inertial[1:4], dtype=object)
    xx, xy, xz, yy, yz, zz = inertial[4:]
    second = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=object)
    link = link_momenta(R, p, mass, first, second, motion)
    return [*link.h, *link.S[UPPER], *link.force, *link.moment]


def _accelerating_wrench(mass: Any, moments: Sequence[Any], S: Vector) -> Vector:
    """Return the wrenches that accelerate bodies by unit twist rates S, (6,)."""
    return np.array(_inertia_rows(mass, moments), dtype=object) @ S


def _inertia_rows(mass: Any, moments: Sequence[Any]) -> list[list[Any]]:
    """Return the rows of inertias: wrenches for the unit rates of a twist."""
    x, y, z = moments[:3]
    xx, xy, xz, yy, yz, zz = moments[3:]
    return [[mass, 0.0, 0.0, 0.0, z, -y],
            [0.0, mass, 0.0, -z, 0.0, x],
            [0.0, 0.0, mass, y, -x, 0.0],
            [0.0, -z, y, yy + zz, -xy, -xz],
            [z, 0.0, -x, -xy, xx + zz, -yz],
            [-y, x, 0.0, -xz, -yz, xx + yy]]


def _packed_rows(entries: Vector, lanes: Any) -> Vector:
    """Return rows of lanes from their entries."""
    rows = [lanes.pack(list(row)) for row in entries.reshape(-1, LANES)]
    return np.array(rows, dtype=object)


def _unpacked(rows: Sequence[Any], lanes: Any) -> list[Scalar]:
    """Return the entries of rows of lanes."""
    entries: list[Scalar] = []
    for row in rows:
        entries.extend(lanes.lane(row, k) for k in range(LANES))
    return entries


def _shifted(rows: Vector, D: Vector, lanes: Any) -> Vector:
    """Return an inertia and its wrench about the origin that is D before theirs."""
    x, y, z = D
    # A twist about that origin is one about theirs with omega x D less: columns.
    back = [0.0] * 3
    over = lanes.pack([*back, y, z, x, 0.0, 0.0])
    under = lanes.pack([*back, z, x, y, 0.0, 0.0])
    columns = []
    for row in rows:
        columns.append(row + lanes.gathered([row], _places(3, (2, 0, 1))) * over
                       - lanes.gathered([row], _places(3, (1, 2, 0))) * under)
    force = np.array(columns[:3], dtype=object)
    # The moment has D x force in addition: rows.
    moment = np.array(columns[3:], dtype=object) + cross(D, force)
    return np.concatenate([force, moment])


def _places(begin: int, sources: tuple[int, int, int]) -> list[tuple[int, int] | None]:
    """Return the places of a gather that puts three lanes of a row after `begin`."""
    places: list[tuple[int, int] | None] = [None] * LANES
    for k, source in enumerate(sources):
        places[begin + k] = (0, source)
    return places


def _total(row: Any, lanes: Any) -> Scalar:
    """Return the sum of the lanes of a row."""
    half = LANES // 2
    while half:
        upper = [(0, k + half) if k < half else None for k in range(LANES)]
        row = row + lanes.gathered([row], upper)
        half = half // 2
    return lanes.lane(row, 0)
