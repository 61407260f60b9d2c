"""
The second derivation on paper: generalized forces by variations of vectors.

`energy_form.hamilton` runs over symbols. Possible displacements and rotations are
derivatives of finite poses by the coordinates, so no formula of Kane's kinematics is used.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from kane_dynamics.closed_forms.symbolic import as_scalars, unwrapped
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.mechanics.energy_form.finite_poses import poses
from kane_dynamics.mechanics.energy_form.hamilton import (HamiltonByVariations,
                                                          PossibleMotion)
import numpy as np
import sympy as sp


@dataclass(frozen=True, eq=False)
class SymbolicMotion:
    """
    An admissible motion of symbols, as `HamiltonByVariations` reads it.

    Attributes
    ----------
    model : Model
        With symbols for its constants.
    q, qdot, qddot : (n,) arrays of scalars
        Coordinates, their rates and accelerations.
    placed : list of (4, 4) SymPy matrices
        Poses of the bodies at q.
    short : callable
        Shortens an array to a SymPy matrix.

    """

    model: Any
    q: Any
    qdot: Any
    qddot: Any
    placed: list[Any]
    short: Callable[[Any], Any]

    @property
    def state(self) -> 'SymbolicMotion':
        """Return the geometry of the motion: itself."""
        return self

    def axes(self, body: int) -> Any:
        """Return the axes of a body, (3, 3, columns)."""
        return as_scalars(self.placed[body][:3, :3])

    def center_of_mass(self, body: int) -> PossibleMotion:
        """Return the possible motion of a body's center of mass and axes."""
        R = self.placed[body][:3, :3]
        com = sp.Matrix(list(map(unwrapped, self.model.bodies[body].inertial.com)))
        point = R * com + self.placed[body][:3, 3]
        displacement = []
        rotation = []
        for x in self._variables:
            # dR = [theta]x R.
            turn = R.diff(x) * R.T
            displacement.append(list(point.diff(x)))
            rotation.append([turn[2, 1], turn[0, 2], turn[1, 0]])
        rows = [self.short(as_scalars(sp.Matrix(r))) for r in (displacement, rotation)]
        rates = [self._rate(matrix) for matrix in rows]
        return PossibleMotion(as_scalars(rows[0]), as_scalars(rows[1]), *rates)

    @property
    def _variables(self) -> list[Any]:
        """Return the symbols of the coordinates; others are constants."""
        return [unwrapped(x) if isinstance(unwrapped(x), sp.Symbol) else sp.Dummy()
                for x in self.q]

    def _rate(self, matrix: Any) -> Any:
        """Return the time derivative of a function of the coordinates."""
        total: Any = np.zeros(matrix.shape)
        for x, rate in zip(self._variables, self.qdot):
            total = total + as_scalars(matrix.diff(x)) * rate
        return total


def forces_by_variations(model: Any, q: Any, qdot: Any, qddot: Any, variations: Any,
                         short: Callable[[Any], Any]) -> dict[str, Any]:
    """
    Return F* and the active force of gravity and springs, (k,) each, by name.

    Parameters
    ----------
    model : Model
        With symbols for its constants.
    q, qdot, qddot : (n,) arrays of scalars
        Coordinates, their rates and accelerations.
    variations : (n, k) array of scalars
        Variation of the coordinates for each of the k forces.
    short : callable
        Shortens an array to a SymPy matrix.

    """
    require_angles(model, 'variations of vectors')
    placed = [short(pose) for pose in poses(model, q)]
    motion: Any = SymbolicMotion(model, q, qdot, qddot, placed, short)
    principle = HamiltonByVariations()
    return {'inertia': short(principle.inertia_force(motion, variations)),
            'gravity and springs': short(principle.conservative_force(motion, variations))}
