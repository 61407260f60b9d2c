"""
What a beam's modes add to the factored equations: integrals taken once, link axes.

With pseudo-inertia P(eta) of the bent beam as of a rigid body, p_i = dS/d eta_i the momentum per
unit of a mode's speed (S the first moment) and Q_i the angular momentum, rates by eta' alone::

    force   =  2 omega x p_i eta_i' + p_i eta_i'' + S''(eta', eta')
    moment  =  J' omega + omega x Q_i eta_i' + Q_i eta_i'' + Q_i' eta_i'
    modal i =  p_i . a + Q_i . alpha + m_ij eta_j'' + omega . (Q_i' - dQ_j/d eta_i eta_j')
               - 1/2 omega . dJ/d eta_i omega

(Boltzmann and Hamel's equations of the kinetic energy to the second power; `beams` has the sums.)
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from kane_dynamics.mechanics.algebra.vector import cross
from kane_dynamics.mechanics.recursive.link import Link
import numpy as np


def bent(links: Sequence[Link], q: Any) -> Sequence[Link]:
    """Return the links with the pseudo-inertias that beams have when bent."""
    if all(link.beam is None for link in links):
        return links
    return [link if link.beam is None else replace(
        link, pseudo_inertia=link.pseudo_inertia + Modes(link, q).pseudo_inertia)
        for link in links]


class Modes:
    """
    The modes of a link that is a beam, at one posture.

    Attributes
    ----------
    coordinates : tuple of int
        Places of eta in q.
    pseudo_inertia : (4, 4) array
        What bending adds.
    momentum, spin : lists of (3,) arrays
        p_i and Q_i.

    """

    def __init__(self, link: Link, q: Any) -> None:
        """Turn the integrals into link axes, about the link's origin."""
        beam: Any = link.beam
        T = link.body
        R, t = T[:3, :3], T[:3, 3]
        self.coordinates, self.mass = beam.coordinates, beam.mass
        self._places = list(beam.coordinates)
        eta = q[self._places]
        self._slope = np.array([T @ P @ T.T for P in beam.pseudo_slope])
        self._bend = np.array([[T @ P @ T.T for P in row] for row in beam.pseudo_curvature])
        self._spin_slope = np.array([
            [R @ x + np.cross(t, R @ P[:3, 3]) for x, P in zip(row, bend)]
            for row, bend in zip(beam.momentum_slope, beam.pseudo_curvature)])  # [j, i]
        spin = [R @ x + np.cross(t, R @ P[:3, 3])
                for x, P in zip(beam.momentum, beam.pseudo_slope)]
        m = len(eta)
        bend = [sum(self._bend[i, j] * eta[j] for j in range(m)) for i in range(m)]
        self._changes = [self._slope[i] + bend[i] for i in range(m)]  # dP/d eta_i
        self.pseudo_inertia = (sum(self._slope[i] * eta[i] for i in range(m))
                               + 0.5 * sum(bend[i] * eta[i] for i in range(m)))
        self.momentum = [change[:3, 3] for change in self._changes]
        self.spin = [spin[i] + sum(self._spin_slope[j, i] * eta[j] for j in range(m))
                     for i in range(m)]

    def inertia_force(self, motion: tuple[Any, Any, Any, Any], u: Any,
                      udot: Any) -> tuple[Any, Any, list[Any]]:
        """Return force, moment about the link's origin, and modal forces."""
        omega, alpha, a, _ = motion
        speed, gain = u[self._places], udot[self._places]
        m = range(len(speed))
        flow = sum(self.momentum[i] * speed[i] for i in m)
        change = sum(self._changes[i][:3, :3] * speed[i] for i in m)
        spin = sum(self.spin[i] * speed[i] for i in m)
        spin_rates = [sum(self._spin_slope[j, i] * speed[j] for j in m) for i in m]
        curved = sum(self._bend[i, j, :3, 3] * (speed[i] * speed[j]) for i in m for j in m)
        force = (2.0 * cross(omega, flow) + sum(self.momentum[i] * gain[i] for i in m) + curved)
        moment = (_spun(change, omega) + cross(omega, spin)
                  + sum(self.spin[i] * gain[i] + spin_rates[i] * speed[i] for i in m))
        spun = 0.5 * ((omega @ omega) * np.eye(3) - np.multiply.outer(omega, omega))
        modal = [self.momentum[i] @ a + self.spin[i] @ alpha + self.mass[i] @ gain
                 + omega @ (spin_rates[i] - sum(self._spin_slope[i, j] * speed[j] for j in m))
                 - np.sum(self._changes[i][:3, :3] * spun) for i in m]
        return force, moment, modal

    def twice_energy(self, omega: Any, v: Any, u: Any) -> Any:
        """Return twice what the modes' speeds add to the kinetic energy, J."""
        speed = u[self._places]
        flow = sum(p * x for p, x in zip(self.momentum, speed))
        spin = sum(Q * x for Q, x in zip(self.spin, speed))
        return 2.0 * (v @ flow + omega @ spin) + speed @ (self.mass @ speed)


def _spun(second_moment: Any, omega: Any) -> Any:
    """Return J omega, J = tr(S) 1 - S."""
    S = second_moment
    return (S[0, 0] + S[1, 1] + S[2, 2]) * omega - S @ omega
