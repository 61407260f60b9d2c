"""
Contribution of a beam's modes to the recursive equations, from precomputed integrals.

A point of the bent beam is at t + f e + d from the link's origin, with its root at t, f = x + c
along the beam and the deflection d = sum_i phi_i eta_i across it. Along the beam, f is linear:
f = sum_a f_a b_a(x), where b_0 is constant, b_1 linear, and both are orthonormal in mass. So all
integrals follow from few sums, with v_ia = d f_a / d eta_i::

    D_a  =  int b_a d dm  =  sum_i F_ia eta_i,        F_ia = int b_a phi_i dm
    G_i  =  int phi_i d^T dm  =  sum_j eta_j int phi_i phi_j^T dm
    p_i  =  int b_0 dm (v_i0 e + F_i0),               the momentum per unit modal speed
    Q_i  =  t x p_i + e x (sum_a f_a F_ia - v_ia D_a) + int d x phi_i dm,    the angular momentum
    m_ij =  int phi_i . phi_j dm + sum_a v_ia v_ja

The pseudo-inertia of the bent beam enters as that of a rigid body. Relative to the link, the
points have the velocity r' = f' e + d' and the acceleration g = 2 omega x r' + r''. With the
weighted values g_a = int b_a g dm, the modes add::

    force   =  int g dm
    moment  =  t x force + e x (sum_a f_a g_a) + int d x g dm
    modal i =  int (v_i e + phi_i) . (a + U (t + f e + d) + g) dm

a is the acceleration of the link's origin and U its gradient. No term of these integrals is left
out, so that M is a Gram matrix: positive definite. All quantities are in link axes.
`definition.beams` has the reference formulation.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from kane_dynamics.mechanics.algebra.vector import cross, symmetric
from kane_dynamics.mechanics.recursive.link import Link
import numpy as np

BASIS = (0, 1)  # indices a of b_a


def bent(links: Sequence[Link], q: Any) -> Sequence[Link]:
    """Return the links with the modes and the pseudo-inertias of the bent beams at q."""
    result = []
    for link in links:
        if link.beam is not None:
            modes = Modes(link, q)
            link = replace(link, modes=modes,
                           pseudo_inertia=link.pseudo_inertia + modes.pseudo_inertia)
        result.append(link)
    return result


class Modes:
    """
    Modes of a flexible link at one configuration.

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

    def __init__(self, link: Link, q: Any) -> None:
        """Evaluate the sums of the module at the coordinates q, (n,)."""
        beam: Any = link.beam
        R, self._root = link.body[:3, :3], link.body[:3, 3]
        self.coordinates, self._places = beam.coordinates, list(beam.coordinates)
        self._count = len(self._places)
        # Constants in link axes.
        self._e, self._shortening = R @ beam.direction, beam.axial
        self._root_of_mass = beam.root_of_mass  # int b_0 dm
        self._coupling = beam.coupling @ R.T  # F_ia
        self._products = R @ beam.products @ R.T
        self._twist = beam.twist_momentum @ R.T
        self._modal_mass = beam.mass
        # Sums over the modes.
        eta = q[self._places]
        self._slopes = [_sum(self._shortening[:, i].T, eta) for i in range(self._count)]  # v_ia
        shortened = 0.5 * self._over_modes(self._slopes, eta)
        self._f = beam.straight + shortened
        self._moments = _sum(self._coupling, eta)  # D_a
        self._across = [_sum(self._products[i], eta) for i in range(self._count)]  # G_i
        self.pseudo_inertia = self._added_inertia(shortened, beam.straight, eta)
        self.momentum = [self._root_of_mass * (slope[0] * self._e + coupling[0])
                         for slope, coupling in zip(self._slopes, self._coupling)]
        self.spin = [self._angular_momentum(i) for i in range(self._count)]
        self.mass = beam.mass + np.array([[slope @ other for other in self._slopes]
                                          for slope in self._slopes])

    def _over_modes(self, values: Sequence[Any], factors: Any) -> Any:
        """Return the sum of values of the modes, each times a factor."""
        return sum(values[i] * factors[i] for i in range(self._count))

    def _added_inertia(self, shortened: Any, straight: Any, eta: Any) -> Any:
        """Return the pseudo-inertia of the bent beam minus that of the straight one, (4, 4)."""
        e = self._e
        first = self._root_of_mass * (shortened[0] * e + self._moments[0])
        mixed = (np.multiply.outer(e, self._f @ self._moments)
                 + np.multiply.outer(self._root, first))
        along = shortened @ (self._f + straight)  # f^2 - x^2
        second = (mixed + mixed.T + along * np.multiply.outer(e, e)
                  + self._over_modes(self._across, eta))
        P = np.zeros((4, 4), dtype=object)
        P[:3, :3], P[:3, 3], P[3, :3] = symmetric(second), first, first
        return P

    def _angular_momentum(self, i: int) -> Any:
        """Return Q_i, with that of the twist."""
        across = self._f @ self._coupling[i] - self._slopes[i] @ self._moments
        return (cross(self._root, self.momentum[i]) + cross(self._e, across)
                - _axial_vector(self._across[i]) + self._twist[i])

    def inertia_force(self, motion: tuple[Any, Any, Any, Any], u: Any,
                      udot: Any) -> tuple[Any, Any, list[Any]]:
        """Return force, moment about the link's origin, and modal forces."""
        omega, alpha, a, U = motion
        e, t, f, D = self._e, self._root, self._f, self._moments
        speed, gain = u[self._places], udot[self._places]
        f_rate, D_rate = self._over_modes(self._slopes, speed), _sum(self._coupling, speed)
        f_gain = self._over_modes(self._slopes, gain) + _quadratic(self._shortening, speed)
        D_gain = _sum(self._coupling, gain)
        turning = 2.0 * cross(omega, e)
        # The part of g_a along and due to the motion along e, then all of g_a.
        g_along = [f_rate[k] * turning + f_gain[k] * e for k in BASIS]
        g = [g_along[k] + 2.0 * cross(omega, D_rate[k]) + D_gain[k] for k in BASIS]
        force = self._root_of_mass * g[0]
        moment = (cross(t, force) + cross(e, f[0] * g[0] + f[1] * g[1])
                  + cross(D[0], g_along[0]) + cross(D[1], g_along[1])
                  + self._moment_across(omega, speed, gain))
        # Accelerations of the straight beam's line and of the motion along it, weighted by b_a.
        line = [g_along[k] + f[k] * (U @ e) for k in BASIS]
        line[0] = line[0] + self._root_of_mass * (a + U @ t)
        along = [e @ line[k] + (e @ U) @ D[k] - turning @ D_rate[k] for k in BASIS]
        modal = [self._slopes[i] @ along
                 + self._coupling[i, 0] @ line[0] + self._coupling[i, 1] @ line[1]
                 + self._modal_force_across(i, omega, alpha, U, speed, gain)
                 for i in range(self._count)]
        return force, moment, modal

    def _moment_across(self, omega: Any, speed: Any, gain: Any) -> Any:
        """Return int d x (2 omega x d' + d'') dm and the moment of the twist."""
        flow = self._over_modes(self._across, speed)  # int d' d^T dm
        coriolis = 2.0 * ((flow[0, 0] + flow[1, 1] + flow[2, 2]) * omega - flow @ omega)
        relative = self._over_modes([_axial_vector(G) for G in self._across], gain)
        twisting = cross(omega, _sum(self._twist, speed)) + _sum(self._twist, gain)
        return coriolis - relative + twisting

    def _modal_force_across(self, i: int, omega: Any, alpha: Any, U: Any, speed: Any,
                            gain: Any) -> Any:
        """Return int phi_i . (U d + 2 omega x d' + d'') dm and the modal force of the twist."""
        flow = _sum(self._products[i], speed)  # int phi_i d'^T dm
        return (np.sum(U * self._across[i]) - 2.0 * (omega @ _axial_vector(flow))
                + self._modal_mass[i] @ gain + self._twist[i] @ alpha)

    def twice_energy(self, omega: Any, v: Any, u: Any) -> Any:
        """Return twice the contribution of the modal speeds to the kinetic energy, J."""
        speed = u[self._places]
        momentum, spin = (self._over_modes(x, speed) for x in (self.momentum, self.spin))
        f_rate = self._over_modes(self._slopes, speed)
        return (2.0 * (v @ momentum + omega @ spin) + speed @ (self._modal_mass @ speed)
                + f_rate @ f_rate)


def _axial_vector(A: Any) -> Any:
    """Return int a x b dm of a matrix A = int a b^T dm."""
    return np.array([A[1, 2] - A[2, 1], A[2, 0] - A[0, 2], A[0, 1] - A[1, 0]])


def _sum(constants: Any, factors: Any) -> Any:
    """Return the sum of constant arrays, each times a factor; zeros cost nothing."""
    result = np.zeros(constants.shape[1:], dtype=object)
    for place in map(tuple, np.argwhere(constants).tolist()):
        entry = place[1:]
        result[entry] = result[entry] + constants[place] * factors[place[0]]
    return result


def _quadratic(constants: Any, x: Any) -> Any:
    """Return x^T C x of several symmetric matrices C, (k, m, m)."""
    i, j = np.triu_indices(len(x))
    twice = np.where(i == j, 1.0, 2.0)  # for the entries above the diagonal
    return _sum((twice * constants[:, i, j]).T, x[i] * x[j])
