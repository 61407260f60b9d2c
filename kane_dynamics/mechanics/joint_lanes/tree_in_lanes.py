"""Matrices of trees, computed for several joints at once in lanes."""

from collections.abc import Callable
from functools import partial
from typing import Any

from kane_dynamics._util.typing import Matrix, Vector
from kane_dynamics.mechanics.algebra import ltdl
from kane_dynamics.mechanics.algebra.lanes import LANES, Lanes
from kane_dynamics.mechanics.algebra.vector import is_zero
from kane_dynamics.mechanics.joint_lanes.derivatives import inverse_dynamics_derivatives
from kane_dynamics.mechanics.joint_lanes.inverse import factorize, inverse_mass_matrix
from kane_dynamics.mechanics.joint_lanes.regressor import regressor
from kane_dynamics.mechanics.joint_lanes.tree_sums import TreeSums
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
import numpy as np


class TreeInLanes:
    """
    Matrices of `TreeEquations`, by the same names, computed for several joints at once.

    Parameters
    ----------
    equations : TreeEquations
        Of rigid bodies, each moved by a coordinate of its own: see
        `TreeEquations.has_simple_joints`.
    lanes : callable
        Takes a scalar of q and returns an object with the functions of `Lanes` for its
        type.

    """

    def __init__(self, equations: TreeEquations,
                 lanes: Callable[[Any], Any] = lambda scalar: Lanes) -> None:
        """Store the equations."""
        self.equations = equations
        self._lanes = lanes

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
        _, _, M = self._derivative_rows(q, zeros, zeros, parameters)
        return self._matrix(M, q)

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
        # Half of dtau/du, which is linear in u.
        _, by_u, _ = inverse_dynamics_derivatives(links, q, 0.5 * u, self.equations.zeros,
                                                  no_gravity, self._lanes(q[0]))
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

    def _derivative_rows(self, q: Vector, u: Vector, udot: Vector,
                         parameters: Vector) -> Any:
        """Return rows of dtau/dq, dtau/du and M, with springs, friction and armature."""
        lanes = self._lanes(q[0])
        links = self.equations.base_links(parameters)
        rows = inverse_dynamics_derivatives(links, q, u, udot, parameters[:3], lanes)
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
