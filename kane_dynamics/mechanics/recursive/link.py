"""Link: a body of the recursive algorithms, with its joint axis along z; (4, 4) poses."""

from dataclasses import dataclass
from typing import Any, Literal

from kane_dynamics._util.typing import Array
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
        Joint position as a function of modal coordinates, for a section of a bending beam;
        `offset` is added, `coordinate` and `multiplier` are not used.
    beam : Beam, optional
        Modal integrals of a flexible link, in the axes of the body frame.
    modes : Modes, optional
        Modes of a flexible link at one configuration; set by `flexible_modes.bent`.
    turned : bool
        Whether the link is the first of a ball joint, whose rotation `link_frames.posed` adds to
        its pose: its frame stays at the joint.

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
    modes: Any = None
    turned: bool = False

    def position(self, q: Any) -> Any:
        """Return the position of the joint without `offset`, rad or m."""
        bent = self.deflection
        if bent is None:
            return self.multiplier * q[self.coordinate]
        eta = q[list(bent.coordinates)]
        return bent.slope @ eta + 0.5 * (eta @ (bent.curvature @ eta))

    def partials(self, q: Any) -> list[tuple[int, Any]]:
        """Return the coefficients of the speeds in the joint's rate: (index, coefficient)."""
        bent = self.deflection
        if bent is None:
            return [(self.coordinate, self.multiplier)]
        weights = bent.slope + bent.curvature @ q[list(bent.coordinates)]
        return list(zip(bent.coordinates, weights))

    def partial_rates(self, u: Any) -> list[tuple[int, Any]]:
        """Return the time derivatives of the coefficients that are not constant."""
        bent = self.deflection
        if bent is None or not bent.curvature.any():
            return []
        return list(zip(bent.coordinates, bent.curvature @ u[list(bent.coordinates)]))

    def rate(self, q: Any, u: Any) -> Any:
        """Return the rate of the joint, rad/s or m/s."""
        if self.deflection is None:
            return self.multiplier * u[self.coordinate]
        return sum(weight * u[k] for k, weight in self.partials(q))

    def acceleration(self, q: Any, u: Any, udot: Any) -> Any:
        """Return the acceleration of the joint, rad/s^2 or m/s^2."""
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
        """First moment: mass times center of mass, (3,), kg m."""
        return self.pseudo_inertia[:3, 3]

    @property
    def second_moment(self) -> Any:
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
    return homogeneous(T[:3, :3].T, -T[:3, :3].T @ T[:3, 3])
