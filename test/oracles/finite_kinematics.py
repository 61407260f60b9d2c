"""
Kinematics of the energy formulation, by automatic differentiation of finite poses.

The coordinates and the time are hyper-dual numbers with derivatives with respect to the
coordinates and along the motion. The derivatives of a frame's pose give its Jacobian
(possible displacements and rotations) and its rate; no formula for partial velocities is
used. No function is shared with `kane`, `kinematics` or `recursive`.
"""

from typing import Any

from hyperdual import joined, Parts, parts, seeded
from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.mechanics.constraints.mechanism import Mechanism, MechanismState
from kane_dynamics.mechanics.energy_form.finite_poses import poses
from kane_dynamics.mechanics.energy_form.hamilton import PossibleMotion
from kane_dynamics.model.model import Frame, WORLD
import numpy as np


class FiniteMechanismState(MechanismState):
    """
    State of a mechanism at one time, with independent kinematics.

    Parameters
    ----------
    mechanism : Mechanism
        Only its model and speeds are used.
    q, qdot : (n_q,) arrays of float
        Coordinates and their rates; rad or m, and s.
    t : float
        s.

    Notes
    -----
    Scalars are HyperDual. The variables are the coordinates, then the time; the
    direction is that of the motion. Derivatives with respect to the variables are NaN if
    unknown: in partial velocities and everything computed from them.

    """

    def __init__(self, mechanism: Mechanism, q: Array, qdot: Array, t: float) -> None:
        """Compute the poses of all bodies."""
        require_angles(mechanism.model, 'energy form')
        self.count = len(q) + 1
        variables = seeded([*q, t], [*qdot, 1.0], 0, self.count)
        super().__init__(mechanism.model, mechanism.speeds, variables[:-1],
                         variables[-1])
        self._poses = poses(self.model, self.q)

    def pose(self, frame: str | Frame) -> tuple[Any, Any]:
        """Return the axes (3, 3, columns) and the origin (3,) of a frame, m."""
        place = self._frame(frame)
        if place.body == WORLD:
            return place.rotation, place.translation
        T = self._poses[place.body]
        R_body = T[:3, :3]
        return R_body @ place.rotation, R_body @ place.translation + T[:3, 3]

    def partial_velocities(self, frame: str | Frame, at: Any = None) -> Any:
        """Return the Jacobian, (6, n_q), of a frame, or of its body's point at `at`."""
        R, p = self.pose(frame)
        possible = self.possible_motion(R, p)
        value = np.concatenate([possible.displacement, possible.rotation], axis=1).T
        rate = np.concatenate([possible.displacement_rate, possible.rotation_rate],
                              axis=1).T
        unknown = np.full((*value.shape, self.count), np.nan)
        J = joined(Parts(value, unknown, rate, unknown))
        if at is None:
            return J
        # The point at r from the frame's origin adds omega^r x r, written out: no
        # function is shared with the other formulations.
        r_x, r_y, r_z = at - p
        w_x, w_y, w_z = J[3:]
        carried = np.array([w_y * r_z - w_z * r_y, w_z * r_x - w_x * r_z,
                            w_x * r_y - w_y * r_x])
        return np.concatenate([J[:3] + carried, J[3:]])

    def possible_motion(self, R: Any, p: Any) -> PossibleMotion:
        """
        Return the possible motion of axes R, (3, 3), and a point p, (3,).

        One row per coordinate. The rotation theta of the axes is the vector of the skew
        matrix dR R^T.
        """
        n = self.model.n
        axes = parts(R, self.count)
        point = parts(p, self.count)
        # Gradients with respect to the speeds are the coefficients of the variation:
        # dR = [theta]x R.
        dR = np.moveaxis(axes.gradient, -1, 0)[:n]
        dR_rate = np.moveaxis(axes.gradient_rate, -1, 0)[:n]
        return PossibleMotion(
            displacement=point.gradient.T[:n],
            rotation=_vectors(dR @ axes.value.T),
            displacement_rate=point.gradient_rate.T[:n],
            rotation_rate=_vectors(dR_rate @ axes.value.T + dR @ axes.rate.T))

    def center_of_mass(self, body: int) -> PossibleMotion:
        """Return the possible motion of a body's center of mass and axes."""
        T = self._poses[body]
        R = T[:3, :3]
        com = R @ self.model.bodies[body].inertial.com + T[:3, 3]
        return self.possible_motion(R, com)

    def axes(self, body: int) -> Array:
        """Return the axes of a body as numbers, (3, 3, columns)."""
        return parts(self._poses[body][:3, :3], self.count).value


def _vectors(matrices: Array) -> Array:
    """Return the vectors theta of skew matrices [theta]x, (k, 3, 3)."""
    return np.stack([matrices[:, 2, 1], matrices[:, 0, 2], matrices[:, 1, 0]], axis=1)
