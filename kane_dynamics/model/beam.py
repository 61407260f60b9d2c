"""
Flexible links as data: Euler-Bernoulli beams with assumed modes.

A section of a beam is at ``rho = x e + d + c e``: x along the beam's direction e, the
deflection ``d = sum_i phi_i(x) eta_i`` across it, and the foreshortening ``c = -1/2
eta^T H(x) eta`` with ``H_ij = int_0^x phi_i' . phi_j'``, without which a rotating beam
would soften (Kane, Ryan & Banerjee, JGCD 10, 1987). Attached bodies move exactly with
their section. It turns by the slopes of d, and about e by the roll that bending in two
planes causes (see `flexible_link`).

The mass of the beam moves likewise, except that its c is the linear function of x with
the same mean and first moment in mass. To second order in eta and eta', the kinetic
energy and the weight depend on these two only. The kinetic energy is exactly that of
these points, so that M is a Gram matrix and positive definite for every eta. All
integrals are computed once.

Sections may rotate about e by the twist ``theta = sum_i psi_i(x) eta_i``. Their inertia
is that of a round section: rho I_p about e and half of that across it. So torsion adds
rho I_p (omega . e theta' + 1/2 theta'^2) per length to the kinetic energy, for any
angle. The rotation of e by bending and the roll act on attached bodies; they are
neglected in the rotary inertia of the sections.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array
import numpy as np

Bent = TypeVar('Bent', 'Beam', 'Deflection')
ADMISSIBLE = 0.1  # of the length; the kinematics are of second order in the slope


@dataclass(frozen=True, eq=False)
class Deflection:
    """
    Joint position as a function of modal coordinates: ``a . eta + 1/2 eta^T B eta``.

    Parameters
    ----------
    coordinates : tuple of int
        Indices of eta in q.
    slope : (m,) array
    curvature : (m, m) array

    """

    coordinates: tuple[int, ...]
    slope: Array
    curvature: Array


@dataclass(frozen=True, eq=False)
class Beam:
    """
    Modal integrals of a flexible body, in addition to the inertial of the straight beam.

    Attributes
    ----------
    coordinates : tuple of int
        Indices of the modal coordinates in q, (m,).
    straight : (2,) array
        Coefficients of x in the functions b_0(x) and b_1(x): a constant and a linear
        one, orthonormal in mass.
    axial : (2, m, m) array
        -int H_ij b_a dm: second derivatives of the coefficients of c in b_0 and b_1.
    coupling : (m, 2, 3) array
        int phi_i b_a dm.
    products : (m, m, 3, 3) array
        int phi_i phi_j^T dm.
    twist_momentum : (m, 3) array
        Angular momentum of torsion per unit modal speed.
    mass, stiffness, damping : (m, m) arrays
        Modal mass, stiffness and damping.
    root_of_mass : float
        int b_0 dm, kg^(1/2).
    points, weights : (g, 3), (g,) arrays
        Quadrature points along the beam, m, and their masses, kg.
    shapes, shortening : (g, m, 3), (g, m, m) arrays
        phi at the points, and H of the foreshortening that is linear in x.
    twists, spins : (g, m), (g,) arrays
        psi at the points, and the sections' moments of inertia about e, kg m^2.
    direction : (3,) array
        Unit vector e along the beam.

    """

    coordinates: tuple[int, ...]
    straight: Array
    axial: Array
    coupling: Array
    products: Array
    twist_momentum: Array
    mass: Array
    stiffness: Array
    damping: Array
    root_of_mass: float
    points: Array
    weights: Array
    shapes: Array
    shortening: Array
    twists: Array
    spins: Array
    direction: Array

    @property
    def length(self) -> float:
        """Return the length, m: twice the distance from root to center of mass."""
        return 2.0 * float(self.straight[0]) / self.root_of_mass

    @property
    def admissible_deflection(self) -> float:
        """Return the largest deflection across the beam for which it is meant, m."""
        return ADMISSIBLE * self.length

    @lazy_property
    def peaks(self) -> Array:
        """Return the largest magnitude of each mode's shape along the beam, (m,)."""
        return np.asarray(np.linalg.norm(self.shapes, axis=2).max(axis=0))

    def displacement(self, eta: Array) -> tuple[Array, Array]:
        """Return d and c e at the quadrature points, (g, 3) each; any scalar type."""
        across = np.einsum('gmk,m->gk', self.shapes, eta)
        along = -0.5 * np.einsum('gij,i,j->g', self.shortening, eta, eta)
        return across, np.multiply.outer(along, self.direction)


def renumbered(bent: Bent | None, new_index: Callable[[int], int]) -> Bent | None:
    """Return a beam or a deflection with other indices of its modal coordinates."""
    if bent is None:
        return None
    coordinates = tuple(new_index(k) for k in bent.coordinates)
    return replace(bent, coordinates=coordinates)
