"""`Link`: a body as the recursions see it, and poses as (4, 4) matrices."""

from dataclasses import dataclass
from typing import Any, Literal

from kane_dynamics._util.typing import Array
from kane_dynamics.model.beam import Beam, Deflection
import numpy as np


@dataclass(frozen=True, eq=False)
class Link:
    """
    A body as the recursions see it: its joint turns about, or slides along, its z axis.

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
        About the link's origin, in link axes: second moment, first moment, mass.
    body : (4, 4) array
        Pose of the model's body frame in link axes.
    deflection : Deflection, optional
        What the joint's position is instead, besides `offset`, where a beam bends.
    beam : Beam, optional
        What modes add to the pseudo-inertia, in the axes of the body frame.

    """

    parent: int
    kind: Literal['revolute', 'prismatic']
    pose: Array
    coordinate: int
    multiplier: float
    offset: float
    pseudo_inertia: Any
    body: Array
    deflection: Deflection | None = None
    beam: Beam | None = None

    def position(self, q: Any) -> Any:
        """Return how far the joint is from where `offset` puts it, rad or m."""
        bent = self.deflection
        if bent is None:
            return self.multiplier * q[self.coordinate]
        eta = q[list(bent.coordinates)]
        return bent.slope @ eta + 0.5 * (eta @ (bent.curvature @ eta))

    def partials(self, q: Any) -> list[tuple[int, Any]]:
        """Return the coefficients of the speeds in the joint's rate: (place, coefficient)."""
        bent = self.deflection
        if bent is None:
            return [(self.coordinate, self.multiplier)]
        weights = bent.slope + bent.curvature @ q[list(bent.coordinates)]
        return list(zip(bent.coordinates, weights))

    def partial_rates(self, u: Any) -> list[tuple[int, Any]]:
        """Return the time derivatives of those of `partials` that change."""
        bent = self.deflection
        if bent is None or not bent.curvature.any():
            return []
        return list(zip(bent.coordinates, bent.curvature @ u[list(bent.coordinates)]))

    def rate(self, q: Any, u: Any) -> Any:
        """Return the joint's rate, rad/s or m/s."""
        if self.deflection is None:
            return self.multiplier * u[self.coordinate]
        return sum(weight * u[k] for k, weight in self.partials(q))

    def growth(self, q: Any, u: Any, udot: Any) -> Any:
        """Return the joint's acceleration."""
        bent = self.deflection
        if bent is None:
            return self.multiplier * udot[self.coordinate]
        speed = u[list(bent.coordinates)]
        return self.rate(q, udot) + speed @ (bent.curvature @ speed)

    @property
    def rotation(self) -> Array:
        """Axes of the joint frame in the parent link, (3, 3)."""
        return self.pose[:3, :3]

    @property
    def translation(self) -> Array:
        """Origin of the joint frame in the parent link, (3,), m."""
        return self.pose[:3, 3]

    @property
    def mass(self) -> Any:
        """Mass, kg."""
        return self.pseudo_inertia[3, 3]

    @property
    def first_moment(self) -> Any:
        """Mass times mass centre, (3,), kg m."""
        return self.pseudo_inertia[:3, 3]

    @property
    def second_moment(self) -> Any:
        """Int r r^T dm, (3, 3), kg m^2."""
        return self.pseudo_inertia[:3, :3]


def homogeneous(rotation: Any = None, translation: Any = None) -> Array:
    """Return the (4, 4) matrix that maps [r; 1] by r -> R r + p."""
    T = np.eye(4)
    if rotation is not None:
        T[:3, :3] = rotation
    if translation is not None:
        T[:3, 3] = translation
    return T


def inverse(T: Array) -> Array:
    """Return the inverse of a pose."""
    return homogeneous(T[:3, :3].T, -T[:3, :3].T @ T[:3, 3])
