"""
The energy road's geometry: what constraints and energies ask, by differentiating finite poses.

Nothing here knows a partial velocity beforehand. The coordinates and the time are hyper-dual:
they carry the derivatives by themselves and along the motion, so a pose does too, and possible
displacements and rotations of a frame are read off its derivatives. No function is shared with
`kane`, `kinematics` or `recursive`.
"""

from dataclasses import dataclass
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.algebra.hyperdual import joined, Parts, parts, seeded
from kane_dynamics.mechanics.constraints.mechanism import Mechanism, MechanismState
from kane_dynamics.mechanics.energy_form.energies import poses
from kane_dynamics.model.model import WORLD
import numpy as np


@dataclass(frozen=True, eq=False)
class PossibleMotion:
    """
    How a point and the axes that it carries can move, world axes; one row for each variation.

    Attributes
    ----------
    displacement, rotation : (k, 3) arrays
        m and rad, per unit of the variation.
    displacement_rate, rotation_rate : (k, 3) arrays
        Their time derivatives along the motion, the variations being steady.

    """

    displacement: Array
    rotation: Array
    displacement_rate: Array
    rotation_rate: Array

    def along(self, directions: Array) -> 'PossibleMotion':
        """Return the motion for variations of the coordinates, the columns of (n_q, k)."""
        return PossibleMotion(directions.T @ self.displacement, directions.T @ self.rotation,
                              directions.T @ self.displacement_rate,
                              directions.T @ self.rotation_rate)


class FiniteMechanismState(MechanismState):
    """
    A mechanism at one posture and time, moving, with a geometry of its own.

    Parameters
    ----------
    mechanism : Mechanism
        Its model and speeds are used, nothing that it computes.
    q, qdot : (n_q,) arrays of float
        Coordinates and their rates; rad or m, and s.
    t : float
        s.

    Notes
    -----
    Scalars are HyperDual: variables are the coordinates and then the time, the direction is that
    of the motion. Derivatives by the variables are NaN where they are not known, which is in
    partial velocities and in what is made of them.

    """

    def __init__(self, mechanism: Mechanism, q: Array, qdot: Array, t: float) -> None:
        """Find all poses."""
        self.count = len(q) + 1
        variables = seeded([*q, t], [*qdot, 1.0], 0, self.count)
        super().__init__(mechanism.model, mechanism.speeds, variables[:-1], variables[-1])
        self._bodies = poses(self.model, self.q)

    def pose(self, frame: str) -> tuple[Any, Any]:
        """Return axes (3, 3, columns) and origin (3,) of a frame, m."""
        at = self.model.frame(frame)
        R, p = at.rotation, at.translation
        if at.body != WORLD:
            T = self._bodies[at.body]
            R, p = T[:3, :3] @ R, T[:3, :3] @ p + T[:3, 3]
        return R, p

    def partial_velocities(self, frame: str) -> Any:
        """Return (6, n_q): linear at the frame's origin, then angular, per unit joint rate."""
        here = self.possible_motion(*self.pose(frame))
        value = np.concatenate([here.displacement, here.rotation], axis=1).T
        rate = np.concatenate([here.displacement_rate, here.rotation_rate], axis=1).T
        unknown = np.full((*value.shape, self.count), np.nan)
        return joined(Parts(value, unknown, rate, unknown))

    def possible_motion(self, R: Any, p: Any) -> PossibleMotion:
        """
        Return how axes R, (3, 3), and a point p, (3,), move as each coordinate is varied.

        A variation dR of the axes is theta x R: theta is read off dR R^T, which is skew.
        """
        n = self.model.n
        axes, point = parts(R, self.count), parts(p, self.count)
        turns = np.moveaxis(axes.gradient, -1, 0)[:n]
        turn_rates = np.moveaxis(axes.gradient_rate, -1, 0)[:n]
        return PossibleMotion(
            point.gradient.T[:n], _vectors(turns @ axes.value.T), point.gradient_rate.T[:n],
            _vectors(turn_rates @ axes.value.T + turns @ axes.rate.T))

    def mass_centre(self, body: int) -> PossibleMotion:
        """Return the possible motion of a body's mass centre and axes."""
        T = self._bodies[body]
        return self.possible_motion(
            T[:3, :3], T[:3, :3] @ self.model.bodies[body].inertial.com + T[:3, 3])

    def axes(self, body: int) -> Array:
        """Return a body's axes, (3, 3, columns), as numbers."""
        return parts(self._bodies[body][:3, :3], self.count).value


def _vectors(matrices: Array) -> Array:
    """Return the vectors of skew matrices, (k, 3, 3): theta of [theta]x."""
    return np.stack([matrices[:, 2, 1], matrices[:, 0, 2], matrices[:, 1, 0]], axis=1)
