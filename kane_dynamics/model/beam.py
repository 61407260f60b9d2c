"""
Flexible links as data: Euler-Bernoulli beams in assumed modes, and what their modes move.

A point of a beam is at ``rho = x e + d + c e``: x along the beam's direction e, the deflection
``d = sum_i phi_i(x) eta_i`` across it, and the foreshortening ``c = -1/2 eta^T H(x) eta`` with
``H_ij = int_0^x phi_i' . phi_j'``, without which a turning beam would soften (Kane, Ryan &
Banerjee, JGCD 10, 1987). The kinetic energy is kept to the second order in eta and eta' of the
beam itself; what hangs on the beam moves with it exactly. All integrals are taken once.

Sections may turn about e by the twist ``theta = sum_i psi_i(x) eta_i``. They are round as to their
inertia, rho I_p about e and half of that across it; so twist adds rho I_p (omega . e theta' +
1/2 theta'^2) to the kinetic energy of a length, whatever its size. That e leans where the beam
bends counts in what hangs on a section; in the section's own rotary inertia it is left out.
"""

from dataclasses import dataclass

from kane_dynamics._util.typing import Array
import numpy as np


@dataclass(frozen=True, eq=False)
class Deflection:
    """
    How a joint's position depends on modal coordinates: ``a . eta + 1/2 eta^T B eta``.

    Parameters
    ----------
    coordinates : tuple of int
        Places of eta in q.
    slope : (m,) array
    curvature : (m, m) array

    """

    coordinates: tuple[int, ...]
    slope: Array
    curvature: Array


@dataclass(frozen=True, eq=False)
class Beam:
    """
    What a body's modes add to its inertial, which is that of the straight beam; body axes.

    Attributes
    ----------
    coordinates : tuple of int
        Places of the modal coordinates in q, (m,).
    pseudo_slope : (m, 4, 4) array
        The pseudo-inertia's slope by each modal coordinate, at rest.
    pseudo_curvature : (m, m, 4, 4) array
        Its second derivatives.
    momentum : (m, 3) array
        int rho x phi_i dm at rest, or of twist: angular momentum per unit of each modal speed.
    momentum_slope : (m, m, 3) array
        [j, i]: int phi_j x phi_i dm.
    mass, stiffness, damping : (m, m) arrays
        Of the modes themselves.
    points, weights : (g, 3), (g,) arrays
        Quadrature along the beam: places, m, and masses, kg.
    shapes, shortening : (g, m, 3), (g, m, m) arrays
        phi and H there.
    twists, spins : (g, m), (g,) arrays
        psi there, and the sections' moments of inertia about e, kg m^2.
    direction : (3,) array
        e.

    """

    coordinates: tuple[int, ...]
    pseudo_slope: Array
    pseudo_curvature: Array
    momentum: Array
    momentum_slope: Array
    mass: Array
    stiffness: Array
    damping: Array
    points: Array
    weights: Array
    shapes: Array
    shortening: Array
    twists: Array
    spins: Array
    direction: Array

    def displacement(self, eta: Array) -> tuple[Array, Array]:
        """Return d and c e at the quadrature points, (g, 3) each, over any scalar."""
        first = np.einsum('gmk,m->gk', self.shapes, eta)
        second = -0.5 * np.einsum('gij,i,j->g', self.shortening, eta, eta)
        return first, np.multiply.outer(second, self.direction)
