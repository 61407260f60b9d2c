"""Quantities of trees, computed for several joints at once in lanes."""

from collections.abc import Callable
from functools import partial
from typing import Any

from kane_dynamics.mechanics.algebra import ltdl
from kane_dynamics.mechanics.algebra.lanes import LANES, Lanes
from kane_dynamics.mechanics.joint_lanes.derivatives import inverse_dynamics_derivatives
from kane_dynamics.mechanics.joint_lanes.inverse import factorize, inverse_mass_matrix
from kane_dynamics.mechanics.joint_lanes.regressor import regressor
from kane_dynamics.mechanics.joint_lanes.tree_sums import TreeSums
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
import numpy as np


class TreeInLanes:
    """
    The matrices of `TreeEquations` that take many joints' vectors; its methods have their names.

    Parameters
    ----------
    equations : TreeEquations
        Of rigid bodies, each moved by a coordinate of its own: see `suits`.
    lanes : callable
        Takes a scalar of q and returns an object with the functions of `Lanes` for its type.

    """

    def __init__(self, equations: TreeEquations,
                 lanes: Callable[[Any], Any] = lambda scalar: Lanes) -> None:
        """Store the equations."""
        self.equations, self._lanes = equations, lanes

    @staticmethod
    def suits(equations: TreeEquations) -> bool:
        """Return whether every body is rigid and has its own coordinate (no mimic joint)."""
        model = equations.model
        return not model.flexible and len(model.bodies) == equations.n == equations.n_q

    def inverse_mass_matrix(self, q: Any, parameters: Any) -> Any:
        """Return the inverse mass matrix, (n, n)."""
        lanes, equations = self._lanes(q[0]), self.equations
        factors = equations.factors(q, parameters, partial(
            factorize, lanes=lanes, rows=self._mass_matrix(q, parameters))
            if self._long_branches() else ltdl.factorize)
        return inverse_mass_matrix(factors, equations.order, lanes)

    def _mass_matrix(self, q: Any, parameters: Any) -> Any:
        """Return the mass matrix, (n, n), from the rows of the derivatives."""
        none = self.equations.zeros
        return self._matrix(self._derivative_rows(q, none, none, parameters)[2], q)

    def _long_branches(self) -> bool:
        """Return whether more than half of the lanes are used if L is computed in rows."""
        rank = {r: k for k, r in enumerate(self.equations.order)}
        paths = [[rank[r] for r in path]
                 for path in TreeSums(self.equations.geometry, Lanes).paths]
        entries = sum(len(path) * (len(path) - 1) / 2 for path in paths)
        blocks = {path[0]: len({k // LANES for k in path}) for path in paths}
        return entries > LANES / 2 * sum(blocks[k] for path in paths for k in path[1:])

    def coriolis_matrix(self, q: Any, u: Any, parameters: Any) -> Any:
        """Return the Coriolis matrix, (n, n)."""
        none, links = np.zeros(3).astype(object), self.equations.base_links(parameters)
        by_u = inverse_dynamics_derivatives(links, q, u, self.equations.zeros, none,
                                            self._lanes(q[0]))[1]
        return self._matrix(0.5 * by_u, q)

    def inverse_dynamics_derivatives(self, q: Any, u: Any, udot: Any, parameters: Any) -> Any:
        """Return dtau/dq, dtau/du and M, (3, n, n)."""
        rows = self._derivative_rows(q, u, udot, parameters)
        return np.array([self._matrix(matrix, q) for matrix in rows])

    def forward_dynamics_derivatives(self, q: Any, u: Any, tau: Any, parameters: Any) -> Any:
        """Return dudot/dq, dudot/du and dudot/dtau = M^-1, (3, n, n), no external wrenches."""
        equations = self.equations
        udot = equations.forward_dynamics(q, u, tau, None, parameters)
        by_q, by_u, _ = self._derivative_rows(q, u, udot, parameters)
        L, reciprocal = equations.factors(q, parameters)
        negated = L, [-x for x in reciprocal]  # factors of -M
        return np.array([*(self._matrix(ltdl.solve(negated, equations.order, rows), q)
                           for rows in (by_q, by_u)), self.inverse_mass_matrix(q, parameters)])

    def _derivative_rows(self, q: Any, u: Any, udot: Any, parameters: Any) -> Any:
        """Return rows of dtau/dq, dtau/du and M, with springs, friction and armature."""
        lanes, links = self._lanes(q[0]), self.equations.base_links(parameters)
        rows = inverse_dynamics_derivatives(links, q, u, udot, parameters[:3], lanes)
        for m, diagonal in enumerate(self.equations.joint_slopes(u)):
            for r, slope in enumerate(diagonal):
                block = [slope if k == r % LANES else 0.0 for k in range(LANES)]
                rows[m, r, r // LANES] = rows[m, r, r // LANES] + lanes.pack(block)
        return rows

    def regressor(self, q: Any, u: Any, udot: Any, parameters: Any) -> Any:
        """Return the joint torque regressor, (n, 10 n_bodies)."""
        return regressor(self.equations.joint_links, q, u, udot, parameters[:3],
                         self._lanes(q[0]))

    def _matrix(self, rows: Any, q: Any) -> Any:
        """Return the scalars of rows, (n, n)."""
        lane, n = self._lanes(q[0]).lane, len(rows)
        return np.array([[lane(row[c // LANES], c % LANES) for c in range(n)] for row in rows])
