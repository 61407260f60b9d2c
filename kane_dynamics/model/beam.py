"""
Flexible links as data: Euler-Bernoulli beams with assumed modes.

A point of a beam is at ``rho = x e + d + c e``: x along the beam's direction e, the deflection
``d = sum_i phi_i(x) eta_i`` across it, and the foreshortening ``c = -1/2 eta^T H(x) eta`` with
``H_ij = int_0^x phi_i' . phi_j'``, without which a rotating beam would soften (Kane, Ryan &
Banerjee, JGCD 10, 1987). The kinetic energy of the beam is of second order in eta and eta';
attached bodies move exactly with their section. All integrals are computed once.

Sections may rotate about e by the twist ``theta = sum_i psi_i(x) eta_i``. Their inertia is that of
a round section: rho I_p about e and half of that across it. So torsion adds rho I_p (omega . e
theta' + 1/2 theta'^2) per length to the kinetic energy, for any angle. The rotation of e by
bending acts on attached bodies; it is neglected in the rotary inertia of the sections.
"""

from dataclasses import dataclass

from kane_dynamics._util.typing import Array
import numpy as np


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
    pseudo_slope : (m, 4, 4) array
        Derivatives of the pseudo-inertia with respect to the modal coordinates, undeformed.
    pseudo_curvature : (m, m, 4, 4) array
        Its second derivatives.
    momentum : (m, 3) array
        int rho x phi_i dm, undeformed (or of torsion): angular momentum per unit modal speed.
    momentum_slope : (m, m, 3) array
        [j, i]: int phi_j x phi_i dm.
    mass, stiffness, damping : (m, m) arrays
        Modal mass, stiffness and damping.
    points, weights : (g, 3), (g,) arrays
        Quadrature points along the beam, m, and their masses, kg.
    shapes, shortening : (g, m, 3), (g, m, m) arrays
        phi and H at the points.
    twists, spins : (g, m), (g,) arrays
        psi at the points, and the sections' moments of inertia about e, kg m^2.
    direction : (3,) array
        Unit vector e along the beam.

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
        """Return d and c e at the quadrature points, (g, 3) each; any scalar type."""
        first = np.einsum('gmk,m->gk', self.shapes, eta)
        second = -0.5 * np.einsum('gij,i,j->g', self.shortening, eta, eta)
        return first, np.multiply.outer(second, self.direction)
