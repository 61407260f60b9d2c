"""
Inverse dynamics of trees: Kane's equations in recursive Newton-Euler form (RNEA).

In a tree, the partial angular velocity of all bodies outboard of joint j is the joint's axis s
(revolute) or zero (prismatic), and the partial velocity of a point r is s x (r - p_j) or s. So
Kane's double sum over bodies and speeds factors into an outward pass for motions, an inward pass
that sums inertia forces and moments over subtrees, and one dot product with the axis per joint
(Angeles, Ma & Rojas, Computers & Mathematics with Applications 17, 1989). All quantities are in
link axes (see `link_frames`), where the joint axis is z.

Gravity enters as an acceleration -g of the base. A mimic joint adds its multiplier times its axis
to the partial velocities of its coordinate.
"""

from collections.abc import Sequence
from copy import copy
from typing import Any

from kane_dynamics.mechanics.algebra.vector import (cross, inertia_moment, is_zero, rate_tensor,
                                                    rotated_about_z, sin_cos, symmetric)
from kane_dynamics.mechanics.recursive.flexible_modes import bent
from kane_dynamics.mechanics.recursive.link import Link
from kane_dynamics.model.model import WORLD
import numpy as np

Z = np.array([0.0, 0.0, 1.0])
REST = np.array([0.0, 0.0, 0.0])
AT_REST = np.zeros((3, 3))
# In link axes: omega, alpha, acceleration of the origin minus gravity, U = `rate_tensor`.
LinkMotion = tuple[Any, Any, Any, Any]


class JointStep:
    """Transform from a parent link to a link at one joint position: rotation and offset."""

    def __init__(self, link: Link, q: Any) -> None:
        """Evaluate the transform at the coordinates q, (n,)."""
        angle = link.position(q)
        self.partials = link.partials(q)
        self.rotation = link.rotation
        self.axis = link.rotation @ Z
        self.turns = link.kind == 'revolute'
        if self.turns:
            self.s, self.c = sin_cos(angle, link.offset)
            self.offset: Any = link.translation
        else:
            self.s, self.c = 0.0, 1.0
            self.offset = link.translation + self.axis * (angle + link.offset)

    def at(self, s: Any, c: Any, offset: Any) -> 'JointStep':
        """Return the transform at another position: its sine, cosine and offset."""
        other = copy(self)
        other.s, other.c, other.offset = s, c, offset
        return other

    def inward(self, v: Any) -> Any:
        """Transform a vector from link axes to the parent's axes."""
        x, y, z = v
        return self.rotation @ np.array([self.c * x - self.s * y, self.s * x + self.c * y, z])

    def outward(self, v: Any) -> Any:
        """Transform a vector from the parent's axes to link axes."""
        x, y, z = self.rotation.T @ v
        return np.array([self.c * x + self.s * y, self.c * y - self.s * x, z])

    def inward_tensor(self, S: Any) -> Any:
        """Transform a symmetric tensor from link axes to the parent's axes."""
        turned = rotated_about_z(S, self.s, self.c) if self.turns else S
        return symmetric(self.rotation @ turned @ self.rotation.T)


def link_motion(link: Link, step: JointStep, before: Sequence[LinkMotion], q: Any, u: Any,
                udot: Any, gravity: Any) -> LinkMotion:
    """Return the motion of a link from those of its predecessors; see `LinkMotion`."""
    rate, acceleration = link.rate(q, u), link.acceleration(q, u, udot)
    omega, alpha, a, U = (REST, REST, -gravity, AT_REST) if link.parent == WORLD else (
        before[link.parent])
    U_z = step.outward(U @ step.axis)
    omega, alpha, a = step.outward(omega), step.outward(alpha), step.outward(a + U @ step.offset)
    across = np.array([omega[1] * rate, -omega[0] * rate, 0.0])  # omega x (rate z)
    if link.kind == 'prismatic':
        a = a + 2.0 * across + acceleration * Z
        return omega, alpha, a, rate_tensor(omega, alpha)
    omega = omega + rate * Z
    if sum(not is_zero(x) for x in step.axis) > 1:
        alpha = alpha + across + acceleration * Z
        return omega, alpha, a, rate_tensor(omega, alpha)
    # The joint's axis is fixed in both links, so U z is the parent's, rotated to link axes;
    # alpha follows from it.
    x, y, z = omega
    alpha = np.array([y * z - U_z[1], U_z[0] - x * z, alpha[2] + acceleration])
    U = rate_tensor(omega, alpha)
    return omega, alpha, a, np.stack([U[:, 0], U[:, 1], U_z], axis=1)


def inertia_wrench(link: Link, motion: LinkMotion) -> tuple[Any, Any]:
    """Return the negated inertia force and moment of a rigid link about its origin; link axes."""
    omega, _, a, U = motion
    h = link.first_moment
    return (link.mass * a + U @ h,
            inertia_moment(link.second_moment, omega, U) + cross(h, a))


def link_forces(link: Link, motion: LinkMotion, u: Any,
                udot: Any) -> tuple[Any, Any, list[tuple[int, Any]]]:
    """Return `inertia_wrench` of a link or beam, and modal forces with their indices in q."""
    force, moment = inertia_wrench(link, motion)
    if link.modes is None:
        return force, moment, []
    more, turning, modal = link.modes.inertia_force(motion, u, udot)
    return force + more, moment + turning, list(zip(link.modes.coordinates, modal))


def inverse_dynamics(links: Sequence[Link], q: Any, u: Any, udot: Any, gravity: Any) -> Any:
    """
    Return the joint forces for a motion by RNEA: -F_r* minus F_r of gravity.

    Parameters
    ----------
    links : sequence of Link
        Parents before children.
    q, u, udot : (n,) arrays of scalars
        Coordinates, their rates and accelerations; rad or m, s.
    gravity : (3,) array of scalars
        m/s^2, world axes.

    Returns
    -------
    (n,) array
        Generalized forces, N m or N.

    """
    links = bent(links, q)
    steps = [JointStep(link, q) for link in links]
    motion: list[LinkMotion] = []
    wrench: list[tuple[Any, Any]] = []
    tau = [0.0] * len(q)
    for link, step in zip(links, steps):
        motion.append(link_motion(link, step, motion, q, u, udot, gravity))
        force, moment, modal = link_forces(link, motion[-1], u, udot)
        wrench.append((force, moment))
        for k, along in modal:
            tau[k] = tau[k] + along
    for i in reversed(range(len(links))):
        link, step, (force, moment) = links[i], steps[i], wrench[i]
        along = moment[2] if link.kind == 'revolute' else force[2]
        for k, weight in step.partials:
            tau[k] = tau[k] + weight * along
        if link.parent != WORLD:
            force, moment = step.inward(force), step.inward(moment)
            above = wrench[link.parent]
            wrench[link.parent] = (above[0] + force,
                                   above[1] + (moment + cross(step.offset, force)))
    return np.array(tau)


def velocities(links: Sequence[Link], q: Any, u: Any) -> list[tuple[Any, Any]]:
    """Return (omega, v of the origin) of all links in link axes, rad/s and m/s."""
    result: list[tuple[Any, Any]] = []
    for link in links:
        step, rate = JointStep(link, q), link.rate(q, u)
        omega, v = REST, REST
        if link.parent != WORLD:
            omega, v = result[link.parent]
            v = v + cross(omega, step.offset)
        omega, v = step.outward(omega), step.outward(v)
        if link.kind == 'revolute':
            result.append((omega + rate * Z, v))
        else:
            result.append((omega, v + rate * Z))
    return result


def kinetic_energy(links: Sequence[Link], q: Any, u: Any) -> Any:
    """Return the kinetic energy sum 1/2 int v . v dm of all links, J."""
    twice: Any = 0.0
    links = bent(links, q)
    for link, (omega, v) in zip(links, velocities(links, q, u)):
        if link.modes is not None:
            twice = twice + link.modes.twice_energy(omega, v, u)
        S, h = link.second_moment, link.first_moment
        spin = S[0, 0] + S[1, 1] + S[2, 2]
        twice = (twice + link.mass * (v @ v) + 2.0 * (v @ cross(omega, h))
                 + spin * (omega @ omega) - omega @ (S @ omega))
    return 0.5 * twice


def potential_energy(links: Sequence[Link], q: Any, gravity: Any) -> Any:
    """Return the potential energy of gravity -sum m g . p*, J, zero at the world's origin."""
    return -(gravity @ first_moment(links, q)[1])


def first_moment(links: Sequence[Link], q: Any) -> tuple[Any, Any]:
    """Return the mass of all links, kg, and sum m p*, (3,), kg m, world axes."""
    links = bent(links, q)
    moments = [(link.mass, link.first_moment) for link in links]
    whole: Any = 0.0
    total: Any = REST
    for i in reversed(range(len(links))):
        mass, h = moments[i]
        step = JointStep(links[i], q)
        h = step.inward(h) + mass * step.offset
        if links[i].parent == WORLD:
            whole, total = whole + mass, total + h
        else:
            above = moments[links[i].parent]
            moments[links[i].parent] = (above[0] + mass, above[1] + h)
    return whole, total
