"""Mass, mass centre and inertia of a body, and the checks that all constants pass."""

from dataclasses import dataclass, field
from typing import Any

from kane_dynamics.errors import ModelError
import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def constant(value: ArrayLike, shape: tuple[int, ...], what: str) -> Array:
    """Return `value` as a finite, read-only float array of `shape`, or raise ModelError."""
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise ModelError(f'{what} is {value!r}; expected {shape} finite numbers') from None
    if array.shape != shape or not np.isfinite(array).all():
        raise ModelError(f'{what} is {value!r}; expected finite numbers of shape {shape}')
    array.flags.writeable = False
    return array


def freeze(record: Any, name: str, value: Any) -> None:
    """Set a field of a frozen dataclass while it is being made."""
    object.__setattr__(record, name, value)


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
