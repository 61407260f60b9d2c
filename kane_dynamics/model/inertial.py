"""Mass, mass centre and inertia of a body, and the checks that all constants pass."""

from dataclasses import dataclass, field
from typing import NamedTuple

from kane_dynamics._util.checks import constant
from kane_dynamics._util.frozen import freeze
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ModelError
import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True, eq=False)
class Inertial:
    """
    Mass, mass centre and central inertia of a body.

    Parameters
    ----------
    mass : float
        kg, not negative.
    com : (3,) array
        Mass centre from the body's origin, in body axes, m.
    inertia : (3, 3) array
        Inertia tensor about the mass centre, in body axes, kg m^2; symmetric.

    Raises
    ------
    ModelError
        A value is not finite, the mass is negative, or the tensor is not symmetric.

    """

    mass: float = 0.0
    com: Array = field(default_factory=lambda: np.zeros(3))
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))

    def __post_init__(self) -> None:
        """Check and freeze the numbers."""
        freeze(self, 'mass', float(constant(self.mass, (), 'mass')))
        if self.mass < 0.0:
            raise ModelError(f'mass is {self.mass} kg; a mass must not be negative')
        freeze(self, 'com', constant(self.com, (3,), 'mass centre'))
        inertia = constant(self.inertia, (3, 3), 'inertia')
        if np.abs(inertia - inertia.T).max() > 1e-9 * max(np.abs(inertia).max(), 1e-300):
            raise ModelError(f'inertia is {inertia.tolist()}; an inertia tensor is symmetric')
        freeze(self, 'inertia', constant(0.5 * (inertia + inertia.T), (3, 3), 'inertia'))

    @property
    def pseudo_inertia(self) -> Array:
        """
        Return the (4, 4) pseudo-inertia about the body's origin, int [r;1][r;1]^T dm.

        Its blocks are the second moment, the first moment m c, and the mass, so that inertials of
        bodies that move together simply add. Source: Wensing, Kim & Slotine, RA-L 3 (2018).
        """
        second = (0.5 * np.trace(self.inertia) * np.eye(3) - self.inertia
                  + self.mass * np.outer(self.com, self.com))
        first = self.mass * self.com[:, None]
        return np.block([[second, first], [first.T, np.array([[self.mass]])]])

    @classmethod
    def from_pseudo_inertia(cls, pseudo: ArrayLike) -> 'Inertial':
        """Return the inertial whose (4, 4) pseudo-inertia about the body's origin is given."""
        P = np.asarray(pseudo, dtype=np.float64)
        mass = P[3, 3]
        com = P[:3, 3] / mass if mass > 0.0 else np.zeros(3)
        central = P[:3, :3] - mass * np.outer(com, com)
        return cls(mass, com, np.trace(central) * np.eye(3) - central)

    def moved(self, rotation: ArrayLike, translation: ArrayLike) -> 'Inertial':
        """Return the same matter seen from a frame in which this one sits at (R, p)."""
        R, p = np.asarray(rotation), np.asarray(translation)
        return Inertial(self.mass, R @ self.com + p, R @ self.inertia @ R.T)

    def __add__(self, other: 'Inertial') -> 'Inertial':
        """Return the inertial of both, welded together in one frame."""
        if other.mass == 0.0 and not other.inertia.any():
            return self  # keeps the numbers of the larger part free of rounding
        if self.mass == 0.0 and not self.inertia.any():
            return other
        mass = self.mass + other.mass
        com = (self.mass * self.com + other.mass * other.com) / mass if mass > 0.0 else self.com
        inertia = np.zeros((3, 3))
        for part in (self, other):
            d = part.com - com
            inertia = inertia + part.inertia + part.mass * (d @ d * np.eye(3) - np.outer(d, d))
        return Inertial(mass, com, inertia)


class PrincipalMoments(NamedTuple):
    """
    Principal moments of an inertia tensor, and whether a body can have them.

    Attributes
    ----------
    moments : tuple of float
        In ascending order, kg m^2.
    indefinite : bool
        The smallest is negative, beyond rounding.
    singular : bool
        The smallest is zero: a point mass or a thin rod, which is legal.
    triangle : bool
        The largest exceeds the sum of the other two, which no distribution of mass has.

    """

    moments: tuple[float, float, float]
    indefinite: bool
    singular: bool
    triangle: bool

    @property
    def possible(self) -> bool:
        """Return whether a rigid body can have these moments."""
        return not (self.indefinite or self.triangle)

    def __str__(self) -> str:
        """Return the moments with their unit."""
        return '{:g}, {:g}, {:g} kg m^2'.format(*self.moments)


def principal_moments(inertia: ArrayLike, *, mass: float = 0.0,
                      rounding: float = 1e-9) -> PrincipalMoments:
    """
    Return the principal moments of a central inertia tensor and what is impossible about them.

    Parameters
    ----------
    inertia : (3, 3) array
        About the center of mass, kg m^2; symmetric.
    mass : float
        kg; allows for what this mass has a micrometre off the axis.
    rounding : float
        Relative to the largest moment; what the numbers were rounded to.

    """
    a, b, c = np.linalg.eigvalsh(np.asarray(inertia, dtype=np.float64)).tolist()
    noise = rounding * max(abs(a), abs(c)) + 1e-12 * mass
    return PrincipalMoments((a, b, c), a < -noise, -noise <= a <= noise,
                            c > (a + b) * (1.0 + 1e-6) + noise)
