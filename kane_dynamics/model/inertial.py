"""Inertial properties of a body (mass, center of mass, inertia), and their checks."""

from __future__ import annotations

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
    Inertial properties of a body: mass, center of mass and central inertia.

    Parameters
    ----------
    mass : float
        kg, nonnegative.
    com : (3,) array
        Center of mass from the body's origin, in body axes, m.
    inertia : (3, 3) array
        Inertia tensor about the center of mass, in body axes, kg m^2; symmetric.

    Raises
    ------
    ModelError
        If a value is not finite, the mass is negative, or the tensor is not symmetric.

    """

    mass: float = 0.0
    com: Array = field(default_factory=lambda: np.zeros(3))
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))

    def __post_init__(self) -> None:
        """Check and freeze the numbers."""
        freeze(self, 'mass', float(constant(self.mass, (), 'mass')))
        if self.mass < 0.0:
            raise ModelError(f'mass: {self.mass} kg; expected a nonnegative number')
        freeze(self, 'com', constant(self.com, (3,), 'center of mass'))
        inertia = constant(self.inertia, (3, 3), 'inertia')
        if np.abs(inertia - inertia.T).max() > 1e-9 * max(np.abs(inertia).max(), 1e-300):
            raise ModelError(f'inertia: {inertia.tolist()}; expected a symmetric tensor')
        symmetric = 0.5 * (inertia + inertia.T)  # of files with rounded numbers
        freeze(self, 'inertia', constant(symmetric, (3, 3), 'inertia'))

    def __repr__(self) -> str:
        """Return mass, center of mass and moments on one line."""
        com = self.com.round(6).tolist()
        moments = ', '.join(f'{moment:.4g}' for moment in np.diag(self.inertia).tolist())
        return f'<Inertial: {self.mass:.6g} kg at {com} m, moments {moments} kg m^2>'

    @property
    def pseudo_inertia(self) -> Array:
        """
        Return the pseudo-inertia about the body's origin, int [r;1][r;1]^T dm, (4, 4).

        Its blocks are the second moment, the first moment m c, and the mass.
        Pseudo-inertias of rigidly connected bodies add up. Source: Wensing, Kim &
        Slotine, RA-L 3 (2018).
        """
        second = (0.5 * np.trace(self.inertia) * np.eye(3) - self.inertia
                  + self.mass * np.outer(self.com, self.com))
        first = self.mass * self.com[:, None]
        return np.block([[second, first], [first.T, np.array([[self.mass]])]])

    @property
    def parameters(self) -> Array:
        """
        Return the ten inertial parameters, (10,), about the body's origin.

        Mass, mass times center of mass, and the integrals of xx, xy, xz, yy, yz and zz
        over the mass; kg, kg m, kg m^2. Functions with the parameter 'payload' take them
        in this order.
        """
        P = self.pseudo_inertia
        mass = P[3, 3]
        first_moment = P[:3, 3]
        second_moments = P[np.triu_indices(3)]  # xx, xy, xz, yy, yz, zz
        return np.array([mass, *first_moment, *second_moments])

    @classmethod
    def from_parameters(cls, parameters: ArrayLike) -> Inertial:
        """Return the inertial with these ten `parameters`; ModelError if impossible."""
        m, hx, hy, hz, xx, xy, xz, yy, yz, zz = constant(parameters, (10,), 'parameters')
        if m == 0.0 and (hx or hy or hz):
            raise ModelError(f'parameters: mass times center of mass {hx:g}, {hy:g}, '
                             f'{hz:g} kg m without mass; expected a mass')
        return cls.from_pseudo_inertia([
            [xx, xy, xz, hx], [xy, yy, yz, hy], [xz, yz, zz, hz], [hx, hy, hz, m]])

    @classmethod
    def from_pseudo_inertia(cls, pseudo: ArrayLike) -> Inertial:
        """Return the inertial with this pseudo-inertia about the origin, (4, 4)."""
        # Inverse of `pseudo_inertia`, with the parallel axis theorem for second moments.
        P = constant(pseudo, (4, 4), 'pseudo-inertia')
        mass = P[3, 3]
        com = P[:3, 3] / mass if mass > 0.0 else np.zeros(3)
        central = P[:3, :3] - mass * np.outer(com, com)
        return cls(mass, com, np.trace(central) * np.eye(3) - central)

    def moved(self, rotation: ArrayLike, translation: ArrayLike) -> Inertial:
        """Return the inertial in axes in which its present frame has the pose (R, p)."""
        R = constant(rotation, (3, 3), 'rotation')
        p = constant(translation, (3,), 'translation')
        if (np.abs(R) > 1.0 + 1e-6).any():
            raise ModelError(f'rotation: {R.tolist()}; expected a rotation matrix')
        return Inertial(self.mass, R @ self.com + p, R @ self.inertia @ R.T)

    def __add__(self, other: Inertial) -> Inertial:
        """Return the combined inertial of two rigidly connected bodies in one frame."""
        if other.mass == 0.0 and not other.inertia.any():
            return self  # avoids rounding
        if self.mass == 0.0 and not self.inertia.any():
            return other
        mass = self.mass + other.mass
        com = self.com
        if mass > 0.0:
            com = (self.mass * self.com + other.mass * other.com) / mass
        # Parallel axis theorem, from each center of mass to the common one.
        inertia = np.zeros((3, 3))
        for part in (self, other):
            d = part.com - com
            offset_inertia = part.mass * (d @ d * np.eye(3) - np.outer(d, d))
            inertia = inertia + part.inertia + offset_inertia
        return Inertial(mass, com, inertia)


class PrincipalMoments(NamedTuple):
    """
    Principal moments of an inertia tensor, and whether they are physically possible.

    Attributes
    ----------
    moments : tuple of float
        In ascending order, kg m^2.
    indefinite : bool
        The smallest moment is negative, beyond rounding.
    singular : bool
        The smallest moment is zero: a point mass or a thin rod, which is legal.
    triangle : bool
        The largest moment exceeds the sum of the other two, which is impossible.

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
    Return the principal moments of a central inertia tensor, with their checks.

    Parameters
    ----------
    inertia : (3, 3) array
        About the center of mass, kg m^2; symmetric.
    mass : float
        kg; the tolerance includes the inertia of this mass at a distance of one
        micrometer.
    rounding : float
        Tolerance relative to the largest moment.

    """
    a, b, c = np.linalg.eigvalsh(np.asarray(inertia, dtype=np.float64)).tolist()
    # Moments of real files are rounded, and tiny bodies have almost none.
    noise = rounding * max(abs(a), abs(c)) + 1e-12 * mass
    exceeds_the_others = c > (a + b) * (1.0 + 1e-6) + noise
    return PrincipalMoments((a, b, c), indefinite=a < -noise,
                            singular=-noise <= a <= noise,
                            triangle=exceeds_the_others)


def check_moments(on: str, inertial: Inertial) -> None:
    """Raise ModelError, which names the body, for impossible principal moments."""
    moments = principal_moments(inertial.inertia)
    if not moments.possible:
        raise ModelError(f"'{on}': principal moments of inertia are {moments}; expected "
                         'none negative or larger than the sum of the others')
