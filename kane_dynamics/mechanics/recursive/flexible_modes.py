"""
Contribution of a beam's modes to the recursive equations, from precomputed integrals.

The pseudo-inertia P(eta) of the bent beam enters as that of a rigid body. The modes add, with
p_i = dS/d eta_i the momentum per unit modal speed (S the first moment), Q_i the angular momentum
per unit modal speed, and ' the time derivative due to eta' alone::

    force   =  2 omega x p_i eta_i' + p_i eta_i'' + S''(eta', eta')
    moment  =  J' omega + omega x Q_i eta_i' + Q_i eta_i'' + Q_i' eta_i'
    modal i =  p_i . a + Q_i . alpha + m_ij eta_j'' + omega . (Q_i' - dQ_j/d eta_i eta_j')
               - 1/2 omega . dJ/d eta_i omega

These are the Boltzmann-Hamel equations of the kinetic energy to second order. All quantities are
in link axes. `definition.beams` has the reference formulation.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from kane_dynamics.mechanics.algebra.vector import cross
from kane_dynamics.mechanics.recursive.link import Link
import numpy as np


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

    """

    def __init__(self, link: Link, q: Any) -> None:
        """Transform the integrals to link axes about the link's origin."""
        beam: Any = link.beam
        T = link.body
        R, t = T[:3, :3], T[:3, 3]
        self.coordinates, self.mass = beam.coordinates, beam.mass
        self._places = list(beam.coordinates)
        eta = q[self._places]
        self._slope, self._bend = (T @ P @ T.T for P in (beam.pseudo_slope, beam.pseudo_curvature))
        spin, self._spin_slope = (  # the slopes by [j, i]
            h @ R.T + np.cross(t, P[..., :3, 3] @ R.T) for h, P in (
                (beam.momentum, beam.pseudo_slope), (beam.momentum_slope, beam.pseudo_curvature)))
        m = len(eta)
        bend = [_symmetric_sum(row, eta) for row in self._bend]
        self._changes = [self._slope[i] + bend[i] for i in range(m)]  # dP/d eta_i
        self.pseudo_inertia = (_symmetric_sum(self._slope, eta)
                               + 0.5 * sum(bend[i] * eta[i] for i in range(m)))
        self.momentum = [change[:3, 3] for change in self._changes]
        self.spin = [spin[i] + _sum(self._spin_slope[:, i], eta) for i in range(m)]

    def inertia_force(self, motion: tuple[Any, Any, Any, Any], u: Any,
                      udot: Any) -> tuple[Any, Any, list[Any]]:
        """Return force, moment about the link's origin, and modal forces."""
        omega, alpha, a, _ = motion
        speed, gain = u[self._places], udot[self._places]
        m = range(len(speed))
        flow = sum(self.momentum[i] * speed[i] for i in m)
        change = sum(self._changes[i][:3, :3] * speed[i] for i in m)
        spin = sum(self.spin[i] * speed[i] for i in m)
        spin_rates = [_sum(self._spin_slope[:, i], speed) for i in m]
        curved = _sum(self._bend[:, :, :3, 3].reshape(-1, 3),
                      np.multiply.outer(speed, speed).ravel())
        force = (2.0 * cross(omega, flow) + sum(self.momentum[i] * gain[i] for i in m) + curved)
        moment = (_angular_momentum(change, omega) + cross(omega, spin)
                  + sum(self.spin[i] * gain[i] + spin_rates[i] * speed[i] for i in m))
        spun = 0.5 * ((omega @ omega) * np.eye(3) - np.multiply.outer(omega, omega))
        modal = [self.momentum[i] @ a + self.spin[i] @ alpha + self.mass[i] @ gain
                 + omega @ (spin_rates[i] - _sum(self._spin_slope[i], speed))
                 - np.sum(self._changes[i][:3, :3] * spun) for i in m]
        return force, moment, modal

    def twice_energy(self, omega: Any, v: Any, u: Any) -> Any:
        """Return twice the contribution of the modal speeds to the kinetic energy, J."""
        speed = u[self._places]
        flow = sum(p * x for p, x in zip(self.momentum, speed))
        spin = sum(Q * x for Q, x in zip(self.spin, speed))
        return 2.0 * (v @ flow + omega @ spin) + speed @ (self.mass @ speed)


def _sum(constants: Any, factors: Any) -> Any:
    """Return the sum of constant arrays, each times a factor; zeros cost nothing."""
    result = np.zeros(constants.shape[1:], dtype=object)
    for place in map(tuple, np.argwhere(constants).tolist()):
        entry = place[1:]
        result[entry] = result[entry] + constants[place] * factors[place[0]]
    return result


def _symmetric_sum(constants: Any, factors: Any) -> Any:
    """Return `_sum` of symmetric matrices."""
    upper = _sum(np.triu(constants), factors)
    return np.triu(upper) + np.triu(upper, 1).T


def _angular_momentum(second_moment: Any, omega: Any) -> Any:
    """Return J omega with the inertia J = tr(S) 1 - S."""
    S = second_moment
    return (S[0, 0] + S[1, 1] + S[2, 2]) * omega - S @ omega
