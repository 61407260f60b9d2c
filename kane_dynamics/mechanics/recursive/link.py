"""Link: a body of the recursive algorithms, with its joint along z; (4, 4) poses."""

from dataclasses import dataclass
from typing import Any, Literal

from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.model.beam import Beam, Deflection
import numpy as np


@dataclass(frozen=True, eq=False)
class Link:
    """
    Body of the recursive algorithms; its joint rotates about or slides along the z axis.

    Attributes
    ----------
    parent : int
        Index of the parent link, -1 for the world.
    kind : 'revolute' or 'prismatic'
    pose : (4, 4) array
        Pose of the joint frame in the parent link at position 0, m.
    coordinate, multiplier, offset : int, float, float
        The joint's position is ``multiplier * q[coordinate] + offset``.
    pseudo_inertia : (4, 4) array
        Second moment, first moment and mass about the link's origin, link axes.
    body : (4, 4) array
        Pose of the model's body frame in link axes.
    deflection : Deflection, optional
        Joint position as a function of modal coordinates, for a section of a bending
        beam; `offset` is added, `coordinate` and `multiplier` are not used.
    beam : Beam, optional
        Modal integrals of a flexible link, in the axes of the body frame.
    modes : Modes, optional
        Modes of a flexible link at one configuration; set by `flexible_modes.bent`.
    turned : bool
        Whether the link is the first of a ball joint, whose rotation `link_frames.posed`
        adds to its pose: its frame stays at the joint.

    """

    parent: int
    kind: Literal['revolute', 'prismatic']
    pose: Array
    coordinate: int
    multiplier: float
    offset: float
    pseudo_inertia: Matrix
    body: Array
    deflection: Deflection | None = None
    beam: Beam | None = None
    modes: Any = None
    turned: bool = False

    def position(self, q: Vector) -> Scalar:
        """Return the position of the joint without `offset`, rad or m."""
        bending = self.deflection
        if bending is None:
            return self.multiplier * q[self.coordinate]
        # Of second order in the modal coordinates, which contains the shortening.
        eta = q[list(bending.coordinates)]
        return bending.slope @ eta + 0.5 * (eta @ (bending.curvature @ eta))

    def partials(self, q: Vector) -> list[tuple[int, Scalar]]:
        """Return the coefficients of the speeds in the joint's rate: (index, value)."""
        bending = self.deflection
        if bending is None:
            return [(self.coordinate, self.multiplier)]
        eta = q[list(bending.coordinates)]
        # d position / d eta = slope + curvature eta.
        weights = bending.slope + bending.curvature @ eta
        return list(zip(bending.coordinates, weights))

    def partial_rates(self, u: Vector) -> list[tuple[int, Scalar]]:
        """Return the time derivatives of the coefficients that are not constant."""
        bending = self.deflection
        if bending is None or not bending.curvature.any():
            return []
        eta_rate = u[list(bending.coordinates)]
        return list(zip(bending.coordinates, bending.curvature @ eta_rate))

    def rate(self, q: Vector, u: Vector) -> Scalar:
        """Return the rate of the joint, rad/s or m/s."""
        if self.deflection is None:
            return self.multiplier * u[self.coordinate]
        return sum(weight * u[k] for k, weight in self.partials(q))

    def acceleration(self, q: Vector, u: Vector, udot: Vector) -> Scalar:
        """Return the acceleration of the joint, rad/s^2 or m/s^2."""
        bending = self.deflection
        if bending is None:
            return self.multiplier * udot[self.coordinate]
        # As the rate, with udot for u, and what the coefficients' own rates add.
        eta_rate = u[list(bending.coordinates)]
        return self.rate(q, udot) + eta_rate @ (bending.curvature @ eta_rate)

    @property
    def rotation(self) -> Array:
        """Axes of the joint frame in the parent link, (3, 3)."""
        return self.pose[:3, :3]

    @property
    def translation(self) -> Array:
        """Origin of the joint frame in the parent link, (3,), m."""
        return self.pose[:3, 3]

    @property
    def mass(self) -> Scalar:
        """Mass, kg."""
        return self.pseudo_inertia[3, 3]

    @property
    def first_moment(self) -> Vector:
        """First moment: mass times center of mass, (3,), kg m."""
        return self.pseudo_inertia[:3, 3]

    @property
    def second_moment(self) -> Matrix:
        """Second moment int r r^T dm, (3, 3), kg m^2."""
        return self.pseudo_inertia[:3, :3]


def homogeneous(rotation: Any = None, translation: Any = None) -> Array:
    """Return the homogeneous transformation r -> R r + p, (4, 4)."""
    T = np.eye(4)
    if rotation is not None:
        T[:3, :3] = rotation
    if translation is not None:
        T[:3, 3] = translation
    return T


def inverse(T: Array) -> Array:
    """Return the inverse of a pose."""
    R, p = T[:3, :3], T[:3, 3]
    return homogeneous(R.T, -R.T @ p)
