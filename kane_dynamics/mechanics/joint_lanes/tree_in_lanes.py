"""Quantities of trees, computed for several joints at once in lanes."""

from collections.abc import Callable
from functools import partial
from typing import Any

from kane_dynamics._util.typing import Matrix, Vector
from kane_dynamics.mechanics.algebra import ltdl
from kane_dynamics.mechanics.algebra.lanes import LANES, Lanes
from kane_dynamics.mechanics.algebra.vector import is_zero
from kane_dynamics.mechanics.joint_lanes.block_matrices import BlockMatrices
from kane_dynamics.mechanics.joint_lanes.branches import branches
from kane_dynamics.mechanics.joint_lanes.derivatives import (
    inverse_dynamics_derivatives, OF_RATES)
from kane_dynamics.mechanics.joint_lanes.forward_dynamics import forward_dynamics
from kane_dynamics.mechanics.joint_lanes.inverse import factorize, inverse_mass_matrix
from kane_dynamics.mechanics.joint_lanes.joint_blocks import (JointBlocks, LanesOf,
                                                              plain_lanes)
from kane_dynamics.mechanics.joint_lanes.regressor import regressor
from kane_dynamics.mechanics.joint_lanes.tree_sums import TreeSums
from kane_dynamics.mechanics.recursive.subroutines import one_by_one, Repeat
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
import numpy as np


FEW_PARTS = 3  # more parts of eight joints: derivatives by loops over them


class TreeInLanes:
    """
    Matrices of `TreeEquations`, by the same names, computed for several joints at once.

    Parameters
    ----------
    equations : TreeEquations
        Of rigid bodies, each moved by a coordinate of its own: see `suits`.
    lanes : callable
        Takes a scalar of q and returns an object with the functions of `Lanes` for its
        type.
    repeat : callable
        `one_by_one`, or the same as a loop.

    """

    def __init__(self, equations: TreeEquations, lanes: LanesOf = plain_lanes,
                 repeat: Repeat = one_by_one) -> None:
        """Store the equations."""
        self.equations = equations
        self._lanes = lanes
        self._repeat = repeat

    @staticmethod
    def suits(equations: TreeEquations) -> bool:
        """Return whether every body is rigid and has a coordinate (no mimic joint)."""
        model = equations.model
        if model.flexible or equations.carries_loads:
            return False
        return len(model.bodies) == equations.n == equations.n_q

    def forward_dynamics(self, q: Vector, u: Vector, tau: Vector, wrench: Any,
                         parameters: Vector) -> Vector:
        """Return udot, (n,), in linear time by articulated inertias."""
        equations = self.equations
        # Friction, springs and wrenches act on the joints; gravity accelerates the base.
        torque = (equations.drive_loads(u, tau) - equations.spring_force(q)
                  + equations.external_force(q, wrench))
        return forward_dynamics(equations.base_links(parameters), q, u, torque,
                                equations.rotor_inertia, parameters[:3], self._lanes,
                                self._repeat)

    @staticmethod
    def has_long_branches(equations: TreeEquations, of_block: int) -> bool:
        """
        Return whether `forward_dynamics` takes fewer instructions here than by CRBA.

        `of_block` is their number for one block of joints. By CRBA and LTDL, these are
        about 200 for each joint, 30 for each pair of joints that carry one another, and
        2 for each three. A joint without inertia of its own needs the mass matrix to
        recognize a singular one.
        """
        if not TreeInLanes._eliminates_by_blocks(equations):
            return False
        links = equations.geometry
        blocks = sum(branch.blocks for branch in branches(links))
        # Estimated instructions of CRBA and LTDL: quadratic in the depth of each joint.
        instructions = 0
        for path in TreeSums(links, Lanes).paths:
            depth = len(path)
            instructions += 200 + 30 * depth + depth * depth
        return blocks * of_block < instructions

    @staticmethod
    def fills_blocks(equations: TreeEquations) -> bool:
        """Return whether matrices by blocks use at least two thirds of their lanes."""
        if not (TreeInLanes.suits(equations)
                and TreeInLanes._eliminates_by_blocks(equations)):
            return False
        blocks = sum(branch.blocks for branch in branches(equations.geometry))
        return 3 * equations.n >= 2 * LANES * blocks

    @staticmethod
    def _eliminates_by_blocks(equations: TreeEquations) -> bool:
        """Return whether the joints of blocks can be eliminated one after the other."""
        if equations.without_own_inertia:
            return False
        return all(link.multiplier == 1.0 for link in equations.geometry)

    def inverse_mass_matrix(self, q: Vector, parameters: Vector) -> Matrix:
        """Return the inverse mass matrix, (n, n)."""
        lanes = self._lanes(q[0])
        equations = self.equations
        factorization: Callable[..., Any] = ltdl.factorize
        # Rows of M that are in lanes already are factorized a block at a time.
        if self._long_branches():
            rows = self.mass_matrix(q, parameters)
            factorization = partial(factorize, lanes=lanes, rows=rows)
        M = equations.mass_matrix(q, parameters)
        factors = equations.factors(M, factorized=factorization)
        return inverse_mass_matrix(factors, equations.order, lanes)

    def mass_matrix(self, q: Vector, parameters: Vector) -> Matrix:
        """Return the mass matrix, (n, n), from the rows of the derivatives."""
        zeros = self.equations.zeros
        # Without loops: terms of the velocities are zeros that a loop would compute.
        _, _, M = self._derivative_rows(q, zeros, zeros, parameters, loops=False)
        return self._matrix(M, q)

    def mass_matrix_by_blocks(self, q: Vector, parameters: Vector) -> Matrix:
        """Return the mass matrix, (n, n), by blocks of joints in series."""
        return self._block_matrices(q, parameters).mass_matrix()

    def inverse_mass_matrix_by_blocks(self, q: Vector, parameters: Vector) -> Matrix:
        """Return the inverse mass matrix, (n, n), by articulated inertias."""
        return self._block_matrices(q, parameters).inverse_mass_matrix()

    def _block_matrices(self, q: Vector, parameters: Vector) -> BlockMatrices:
        """Return the loops over blocks of joints at a configuration."""
        equations = self.equations
        blocks = JointBlocks(equations.base_links(parameters), equations.rotor_inertia,
                             self._lanes, self._repeat)
        return BlockMatrices(blocks, q)

    def _long_branches(self) -> bool:
        """Return whether rows of L use more than half of their lanes."""
        rank = {r: k for k, r in enumerate(self.equations.order)}
        paths = []
        for path in TreeSums(self.equations.geometry, Lanes).paths:
            paths.append([rank[r] for r in path])

        # Blocks of lanes of each joint's row.
        blocks = {path[0]: len({k // LANES for k in path}) for path in paths}

        # Eliminating a joint changes the rows of all that carry it:
        # these entries, in these lanes.
        entries = 0
        lanes = 0
        for path in paths:
            entries += len(path) * (len(path) - 1) // 2
            lanes += LANES * sum(blocks[k] for k in path[1:])
        return 2 * entries > lanes

    def coriolis_matrix(self, q: Vector, u: Vector, parameters: Vector) -> Matrix:
        """Return the Coriolis matrix, (n, n)."""
        no_gravity = np.zeros(3).astype(object)
        links = self.equations.base_links(parameters)
        repeat = self._repeat if self._has_loops() else None
        # Half of dtau/du, which is linear in u.
        _, by_u, _ = inverse_dynamics_derivatives(links, q, 0.5 * u, self.equations.zeros,
                                                  no_gravity, self._lanes, repeat,
                                                  OF_RATES)
        return self._matrix(by_u, q)

    def inverse_dynamics_derivatives(self, q: Vector, u: Vector, udot: Vector,
                                     parameters: Vector) -> Matrix:
        """Return dtau/dq, dtau/du and M, (3, n, n)."""
        rows = self._derivative_rows(q, u, udot, parameters)
        return np.array([self._matrix(matrix, q) for matrix in rows])

    def forward_dynamics_derivatives(self, q: Vector, u: Vector, tau: Vector,
                                     parameters: Vector) -> Matrix:
        """Return dudot/dq, dudot/du and M^-1, (3, n, n), without external wrenches."""
        equations = self.equations
        udot = equations.forward_dynamics(q, u, tau, None, parameters)
        by_q, by_u, _ = self._derivative_rows(q, u, udot, parameters)

        # dudot/dx = -M^-1 dtau/dx, with the factors of -M.
        M = equations.mass_matrix(q, parameters)
        L, reciprocal = equations.factors(M)
        negated = L, [-x for x in reciprocal]
        results = []
        for rows in (by_q, by_u):
            results.append(self._matrix(ltdl.solve(negated, equations.order, rows), q))
        results.append(self.inverse_mass_matrix(q, parameters))
        return np.array(results)

    def _has_loops(self) -> bool:
        """Return whether derivatives are computed by loops over parts of the tree."""
        return self.equations.n > FEW_PARTS * LANES

    def _derivative_rows(self, q: Vector, u: Vector, udot: Vector,
                         parameters: Vector, loops: bool = True) -> Any:
        """Return rows of dtau/dq, dtau/du and M, with springs, friction and armature."""
        lanes = self._lanes(q[0])
        links = self.equations.base_links(parameters)
        repeat = self._repeat if loops and self._has_loops() else None
        rows = inverse_dynamics_derivatives(links, q, u, udot, parameters[:3],
                                            self._lanes, repeat)
        # Springs, friction and armature are added by blocks of lanes;
        # blocks of zeros add nothing.
        for m, slopes in enumerate(self.equations.joint_slopes(q, u)):
            for r, row in enumerate(slopes):
                for block in range(rows.shape[2]):
                    entries = list(row[block * LANES:(block + 1) * LANES])
                    if all(map(is_zero, entries)):
                        continue
                    entries += [0.0] * (LANES - len(entries))
                    rows[m, r, block] = rows[m, r, block] + lanes.pack(entries)
        return rows

    def regressor(self, q: Vector, u: Vector, udot: Vector,
                  parameters: Vector) -> Matrix:
        """Return the joint torque regressor, (n, 10 n_bodies)."""
        return regressor(self.equations.joint_links, q, u, udot, parameters[:3],
                         self._lanes(q[0]))

    def _matrix(self, rows: Any, q: Vector) -> Matrix:
        """Return the scalars of rows, (n, n)."""
        lanes = self._lanes(q[0])
        n = len(rows)
        entries = []
        for row in rows:
            entries.append([lanes.lane(row[c // LANES], c % LANES) for c in range(n)])
        return np.array(entries)
