"""
Contribution of a beam's modes to the recursive equations, from precomputed integrals.

A point of the bent beam is at t + f e + d from the link's origin, with its root at t,
f = x + c along the beam and the deflection d = sum_i phi_i eta_i across it. Along the
beam, f is linear: f = sum_a f_a b_a(x), where b_0 is constant, b_1 linear, and both are
orthonormal in mass. So all integrals follow from few sums, with v_ia = d f_a / d eta_i::

    D_a  =  int b_a d dm  =  sum_i F_ia eta_i,        F_ia = int b_a phi_i dm
    G_i  =  int phi_i d^T dm  =  sum_j eta_j int phi_i phi_j^T dm
    p_i  =  int b_0 dm (v_i0 e + F_i0),               the momentum per unit modal speed
    Q_i  =  t x p_i + e x (sum_a f_a F_ia - v_ia D_a) + int d x phi_i dm,
                                                      the angular momentum
    m_ij =  int phi_i . phi_j dm + sum_a v_ia v_ja

The pseudo-inertia of the bent beam enters as that of a rigid body. Relative to the link,
the points have the velocity r' = f' e + d' and the acceleration g = 2 omega x r' + r''.
With the weighted values g_a = int b_a g dm, the modes add::

    force   =  int g dm
    moment  =  t x force + e x (sum_a f_a g_a) + int d x g dm
    modal i =  int (v_i e + phi_i) . (a + U (t + f e + d) + g) dm

a is the acceleration of the link's origin and U its gradient. No term of these integrals
is left out, so that M is a Gram matrix: positive definite. All quantities are in link
axes. `definition.beams` has the reference formulation.

Beams with equally many modes can be computed together, each in a lane (`Lanes`).
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.vector import cross, quadratic, symmetric
from kane_dynamics.mechanics.recursive.link import Link
import numpy as np

BASIS = (0, 1)  # indices a of b_a


Motion = tuple[Vector, Vector, Vector, Matrix]  # omega, alpha, a, U
BeamForces = tuple[Vector, Vector, list[Scalar]]  # force, moment, modal forces


def bent(links: Sequence[Link], q: Vector) -> Sequence[Link]:
    """Return the links with the modes and the pseudo-inertias of the bent beams at q."""
    result = list(links)
    for k, link in enumerate(links):
        if link.beam is not None:
            beam = beam_integrals(link)
            modes = Modes(beam, q[list(beam.coordinates)])
            inertia = link.pseudo_inertia + modes.pseudo_inertia
            result[k] = replace(link, modes=modes, pseudo_inertia=inertia)
    return result


class BeamIntegrals(NamedTuple):
    """
    Constants of a beam, in link axes or its own; letters as in the module.

    Attributes
    ----------
    coordinates : tuple of int
        Indices of eta in q.
    t, e : (3,) arrays
        Root, and direction of the beam.
    shortening : (2, m, m) array
        d^2 f_a / d eta_i d eta_j.
    root_of_mass : float
        int b_0 dm.
    straight : (2,) array
        f of the straight beam.
    F, twist : (m, 2, 3), (m, 3) arrays
        F_ia, and the angular momentum of the twist per unit modal speed.
    products, mass : (m, m, 3, 3), (m, m) arrays
        int phi_i phi_j^T dm, and int phi_i . phi_j dm.

    """

    coordinates: tuple[int, ...]
    t: Vector
    e: Vector
    shortening: Any
    root_of_mass: Scalar
    straight: Vector
    F: Any
    twist: Matrix
    products: Any
    mass: Matrix


def beam_integrals(link: Link) -> BeamIntegrals:
    """Return the constants of the beam of a link in the link's axes."""
    R, t = link.body[:3, :3], link.body[:3, 3]
    own = own_integrals(link)
    return own._replace(t=t, e=R @ own.e, F=own.F @ R.T, twist=own.twist @ R.T,
                        products=R @ own.products @ R.T)


def own_integrals(link: Link) -> BeamIntegrals:
    """Return the constants of the beam of a link in the axes of its body."""
    beam: Any = link.beam
    root = link.body[:3, :3].T @ link.body[:3, 3]
    return BeamIntegrals(tuple(beam.coordinates), root, beam.direction, beam.axial,
                         beam.root_of_mass, beam.straight, beam.coupling,
                         beam.twist_momentum, beam.products, beam.mass)


class Modes:
    """
    Modes of a flexible link at one configuration; letters as in the module.

    Attributes
    ----------
    coordinates : tuple of int
        Indices of eta in q.
    pseudo_inertia : (4, 4) array
        Contribution of bending to the pseudo-inertia.
    momentum, spin : lists of (3,) arrays
        Momentum p_i and angular momentum Q_i per unit modal speed.
    mass : (m, m) array
        Modal mass m_ij.

    """

    def __init__(self, beam: BeamIntegrals, eta: Vector) -> None:
        """Evaluate the sums of the module at the modal coordinates, (m,)."""
        self.coordinates = beam.coordinates
        self._modes = range(len(eta))
        self._t = beam.t
        self._e = beam.e
        self._shortening = beam.shortening
        self._root_of_mass = beam.root_of_mass
        self._F = beam.F
        self._products = beam.products
        self._twist = beam.twist
        self._deflection_mass = beam.mass

        # The shape of the bent beam: v_i and f along it, D and G_i across it. f is of
        # second order in eta, so that f = x + 1/2 sum_i v_i eta_i.
        self._v = []
        self._G = []
        for i in self._modes:
            self._v.append(_sum(self._shortening[:, i].T, eta))
            self._G.append(_sum(self._products[i], eta))
        change_of_f = 0.5 * self._over_modes(self._v, eta)
        self._f = beam.straight + change_of_f
        self._D = _sum(self._F, eta)
        self.pseudo_inertia = self._added_inertia(change_of_f, beam.straight, eta)

        # Momenta per unit modal speed, p_i and Q_i.
        self.momentum: list[Vector] = []
        for v, F in zip(self._v, self._F):
            self.momentum.append(self._root_of_mass * (v[0] * self._e + F[0]))
        self.spin = [self._angular_momentum(i) for i in self._modes]

        # Modal mass: that of the deflection, and v_i . v_j of the motion along the beam.
        axial_mass = []
        for v_i in self._v:
            axial_mass.append([v_i @ v_j for v_j in self._v])
        self.mass = beam.mass + np.array(axial_mass)

    def _over_modes(self, values: Sequence[Any], factors: Vector) -> Any:
        """Return the sum of values of the modes, each times a factor."""
        return sum(values[i] * factors[i] for i in self._modes)

    def _added_inertia(self, change_of_f: Vector, straight: Array,
                       eta: Vector) -> Matrix:
        """Return the pseudo-inertia of the bent beam minus the straight one, (4, 4)."""
        e = self._e
        first = self._root_of_mass * (change_of_f[0] * e + self._D[0])
        # int r r^T dm with r = t + f e + d, of which t t^T and x^2 e e^T are the
        # straight beam's.
        mixed = (np.multiply.outer(e, self._f @ self._D)
                 + np.multiply.outer(self._t, first))
        along = change_of_f @ (self._f + straight)  # f^2 - x^2
        second = (mixed + mixed.T + along * np.multiply.outer(e, e)
                  + self._over_modes(self._G, eta))
        P = np.zeros((4, 4), dtype=object)
        P[:3, :3] = symmetric(second)
        P[:3, 3] = first
        P[3, :3] = first
        return P

    def _angular_momentum(self, i: int) -> Vector:
        """Return the angular momentum Q_i of mode i, that of its twist included."""
        across = self._f @ self._F[i] - self._v[i] @ self._D
        return (cross(self._t, self.momentum[i]) + cross(self._e, across)
                - _axial_vector(self._G[i]) + self._twist[i])

    def inertia_force(self, motion: Motion, eta_rate: Vector,
                      eta_acceleration: Vector) -> BeamForces:
        """Return force, moment about the link's origin, and modal forces."""
        omega, alpha, a, U = motion
        e, t, f, D = self._e, self._t, self._f, self._D

        # Rates of the shape.
        f_rate = self._over_modes(self._v, eta_rate)
        D_rate = _sum(self._F, eta_rate)
        f_acceleration = (self._over_modes(self._v, eta_acceleration)
                          + [quadratic(C, eta_rate) for C in self._shortening])
        D_acceleration = _sum(self._F, eta_acceleration)

        # g_a = 2 omega x (f_a' e + D_a') + f_a'' e + D_a'', first what is due to f.
        twice_e_rate = 2.0 * cross(omega, e)
        g_along = [f_rate[k] * twice_e_rate + f_acceleration[k] * e for k in BASIS]
        g = [g_along[k] + 2.0 * cross(omega, D_rate[k]) + D_acceleration[k]
             for k in BASIS]
        force = self._root_of_mass * g[0]
        moment = (cross(t, force) + cross(e, f[0] * g[0] + f[1] * g[1])
                  + cross(D[0], g_along[0]) + cross(D[1], g_along[1])
                  + self._moment_across(omega, eta_rate, eta_acceleration))

        # Modal forces. `line` are the accelerations of the beam's line, weighted by b_a;
        # `along` is their part along e, with that of the deflection.
        line = [g_along[k] + f[k] * (U @ e) for k in BASIS]
        line[0] = line[0] + self._root_of_mass * (a + U @ t)
        along = [e @ line[k] + (e @ U) @ D[k] - twice_e_rate @ D_rate[k] for k in BASIS]
        modal_forces = []
        for i in self._modes:
            of_line = (self._v[i] @ along
                       + self._F[i, 0] @ line[0] + self._F[i, 1] @ line[1])
            of_deflection = self._modal_force_across(i, omega, alpha, U,
                                                     eta_rate, eta_acceleration)
            modal_forces.append(of_line + of_deflection)
        return force, moment, modal_forces

    def _moment_across(self, omega: Vector, eta_rate: Vector,
                       eta_acceleration: Vector) -> Vector:
        """Return int d x (2 omega x d' + d'') dm and the moment of the twist."""
        G_rate = self._over_modes(self._G, eta_rate)  # int d' d^T dm
        trace = G_rate[0, 0] + G_rate[1, 1] + G_rate[2, 2]
        coriolis = 2.0 * (trace * omega - G_rate @ omega)
        axial_vectors = [_axial_vector(G) for G in self._G]
        relative = self._over_modes(axial_vectors, eta_acceleration)
        twisting = (cross(omega, _sum(self._twist, eta_rate))
                    + _sum(self._twist, eta_acceleration))
        return coriolis - relative + twisting

    def _modal_force_across(self, i: int, omega: Vector, alpha: Vector, U: Matrix,
                            eta_rate: Vector, eta_acceleration: Vector) -> Scalar:
        """Return int phi_i . (U d + 2 omega x d' + d'') dm and that of the twist."""
        products_rate = _sum(self._products[i], eta_rate)  # int phi_i d'^T dm
        return (np.sum(U * self._G[i]) - 2.0 * (omega @ _axial_vector(products_rate))
                + self._deflection_mass[i] @ eta_acceleration + self._twist[i] @ alpha)

    def twice_energy(self, omega: Vector, v: Vector, u: Vector) -> Scalar:
        """Return twice the contribution of the modal speeds to the kinetic energy, J."""
        eta_rate = u[list(self.coordinates)]
        momentum = self._over_modes(self.momentum, eta_rate)
        spin = self._over_modes(self.spin, eta_rate)
        f_rate = self._over_modes(self._v, eta_rate)
        return (2.0 * (v @ momentum + omega @ spin)
                + eta_rate @ (self._deflection_mass @ eta_rate) + f_rate @ f_rate)


def _axial_vector(A: Matrix) -> Vector:
    """Return int a x b dm of a matrix A = int a b^T dm."""
    return np.array([A[1, 2] - A[2, 1], A[2, 0] - A[0, 2], A[0, 1] - A[1, 0]])


def _sum(constants: Array, factors: Vector) -> Any:
    """Return the sum of constant arrays, each times a factor; zeros cost nothing."""
    result = np.zeros(constants.shape[1:], dtype=object)
    for i, *entry in np.argwhere(constants).tolist():
        place = tuple(entry)
        result[place] = result[place] + constants[i][place] * factors[i]
    return result
