"""
Inverse dynamics of trees: Kane's equations in recursive Newton-Euler form (RNEA).

In a tree, the partial angular velocity of all bodies outboard of joint j is the joint's
axis s (revolute) or zero (prismatic), and the partial velocity of a point r is
s x (r - p_j) or s. So Kane's double sum over bodies and speeds factors into an outward
pass for motions, an inward pass that sums inertia forces and moments over subtrees, and
one dot product with the axis per joint (Angeles, Ma & Rojas, Computers & Mathematics
with Applications 17, 1989). All quantities are in link axes (see `link`), where
the joint axis is z.

Gravity enters as an acceleration -g of the base. A mimic joint adds its multiplier times
its axis to the partial velocities of its coordinate.
"""

from collections.abc import Sequence
from copy import copy

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.vector import (cross, inertia_moment, is_zero,
                                                    rate_tensor, rotated_about_z,
                                                    sin_cos, symmetric)
from kane_dynamics.mechanics.recursive.link import Link, Z
from kane_dynamics.model.model import WORLD
import numpy as np

ZERO = np.array([0.0, 0.0, 0.0])
# In link axes: omega, alpha, acceleration of the origin minus gravity, and U, the
# `rate_tensor`.
LinkMotion = tuple[Vector, Vector, Vector, Matrix]


class JointStep:
    """Transform from a parent link to a link at one joint position: rotation, offset."""

    def __init__(self, link: Link, q: Vector) -> None:
        """Evaluate the transform at the coordinates q, (n,)."""
        position = link.position(q)
        self.partials = link.partials(q)
        self.rotation = link.rotation
        self.axis = link.rotation @ Z
        self.turns = link.kind == 'revolute'
        # A revolute joint turns by the angle and keeps its offset;
        # a prismatic one moves it.
        if self.turns:
            self.s, self.c = sin_cos(position, link.offset)
            self.offset: Vector = link.translation
        else:
            self.s, self.c = 0.0, 1.0
            self.offset = link.translation + self.axis * (position + link.offset)

    def at(self, s: Scalar, c: Scalar, offset: Vector) -> 'JointStep':
        """Return the transform at another position: its sine, cosine and offset."""
        moved = copy(self)
        moved.s = s
        moved.c = c
        moved.offset = offset
        return moved

    def inward(self, v: Vector) -> Vector:
        """Transform a vector from link axes to the parent's axes."""
        x, y, z = v
        turned = np.array([self.c * x - self.s * y, self.s * x + self.c * y, z])
        return self.rotation @ turned

    def outward(self, v: Vector) -> Vector:
        """Transform a vector from the parent's axes to link axes."""
        x, y, z = self.rotation.T @ v
        return np.array([self.c * x + self.s * y, self.c * y - self.s * x, z])

    def inward_tensor(self, S: Matrix) -> Matrix:
        """Transform a symmetric tensor from link axes to the parent's axes."""
        turned = rotated_about_z(S, self.s, self.c) if self.turns else S
        return symmetric(self.rotation @ turned @ self.rotation.T)

    def inward_wrench(self, force: Vector, moment: Vector) -> tuple[Vector, Vector]:
        """Transform a force, and a moment about the origin, to the parent link."""
        force = self.inward(force)
        moment = self.inward(moment)
        return force, moment + cross(self.offset, force)


def link_motion(link: Link, step: JointStep, motions: Sequence[LinkMotion], q: Vector,
                u: Vector, udot: Vector, gravity: Vector,
                base_alpha: Vector = ZERO) -> LinkMotion:
    """Return the motion of a link from those of the links before; see `LinkMotion`."""
    rate = link.rate(q, u)
    acceleration = link.acceleration(q, u, udot)
    if link.parent == WORLD:
        omega, alpha, a, U = ZERO, base_alpha, -gravity, rate_tensor(ZERO, base_alpha)
    else:
        omega, alpha, a, U = motions[link.parent]

    # Motion of the point of the parent at the link's origin, in link axes.
    U_z = step.outward(U @ step.axis)
    omega = step.outward(omega)
    alpha = step.outward(alpha)
    a = step.outward(a + U @ step.offset)
    across = np.array([omega[1] * rate, -omega[0] * rate, 0.0])  # omega x (rate z)

    # Motion of the joint. A slide adds a Coriolis acceleration.
    if link.kind == 'prismatic':
        a = a + 2.0 * across + acceleration * Z
        return omega, alpha, a, rate_tensor(omega, alpha)
    omega = omega + rate * Z
    if list(map(is_zero, step.axis)).count(False) > 1:
        alpha = alpha + across + acceleration * Z
        return omega, alpha, a, rate_tensor(omega, alpha)

    # The axis is along one of the parent's. It is fixed in both links, so that U z is
    # the parent's, rotated to link axes; alpha follows from it with less arithmetic.
    x, y, z = omega
    alpha = np.array([y * z - U_z[1], U_z[0] - x * z, alpha[2] + acceleration])
    U = rate_tensor(omega, alpha)
    return omega, alpha, a, np.stack([U[:, 0], U[:, 1], U_z], axis=1)


def inertia_wrench(link: Link, motion: LinkMotion) -> tuple[Vector, Vector]:
    """Return the negated inertia force and moment about the origin of a rigid link."""
    omega, _, a, U = motion
    # int (a + U r) dm = m a + U h, and int r x (a + U r) dm about the origin.
    h = link.first_moment
    force = link.mass * a + U @ h
    moment = inertia_moment(link.second_moment, omega, U) + cross(h, a)
    return force, moment


def link_forces(link: Link, motion: LinkMotion, u: Vector,
                udot: Vector) -> tuple[Vector, Vector, list[tuple[int, Scalar]]]:
    """Return `inertia_wrench` of a link or beam, and modal forces with indices in q."""
    force, moment = inertia_wrench(link, motion)
    modes = link.modes
    if modes is None:
        return force, moment, []
    indices = list(modes.coordinates)
    bending_force, bending_moment, modal = modes.inertia_force(
        motion, u[indices], udot[indices])
    return force + bending_force, moment + bending_moment, list(zip(indices, modal))


def inverse_dynamics(links: Sequence[Link], q: Vector, u: Vector, udot: Vector,
                     gravity: Vector, base_alpha: Vector = ZERO) -> Vector:
    """
    Return the joint forces for a motion by RNEA: -F_r* minus F_r of gravity.

    Parameters
    ----------
    links : sequence of Link
        Parents before children; beams are bent as at q (`flexible_modes.bent`).
    q, u, udot : (n,) arrays of scalars
        Coordinates, their rates and accelerations; rad or m, s.
    gravity : (3,) array of scalars
        m/s^2, world axes.
    base_alpha : (3,) array of scalars
        Angular acceleration of the base about the world's origin, rad/s^2, world axes.

    Returns
    -------
    (n,) array
        Generalized forces, N m or N.

    """
    tau: list[Scalar] = [0.0] * len(q)
    # All sines and cosines come first in the program, where they share vectors.
    steps: list[JointStep] = []
    for link in links:
        steps.append(JointStep(link, q))

    # Outward pass: the motion of each link, and the force and moment that it takes.
    motions: list[LinkMotion] = []
    wrenches: list[tuple[Vector, Vector]] = []
    for link, step in zip(links, steps):
        motion = link_motion(link, step, motions, q, u, udot, gravity, base_alpha)
        motions.append(motion)
        force, moment, modal_forces = link_forces(link, motion, u, udot)
        wrenches.append((force, moment))
        for k, modal_force in modal_forces:
            tau[k] = tau[k] + modal_force

    # Inward pass: the wrench of a subtree, projected on the axis of the joint that
    # carries it, is the joint's torque. Then it is added to the wrench of the parent.
    for i in reversed(range(len(links))):
        link, step = links[i], steps[i]
        force, moment = wrenches[i]
        joint_torque = moment[2] if step.turns else force[2]
        for k, weight in step.partials:
            tau[k] = tau[k] + weight * joint_torque
        if link.parent != WORLD:
            wrenches[link.parent] = add_to_parent(step, wrenches[i],
                                                  wrenches[link.parent])
    return np.array(tau)


def add_to_parent(step: JointStep, wrench: tuple[Vector, Vector],
                  parent_wrench: tuple[Vector, Vector]) -> tuple[Vector, Vector]:
    """Return the parent's wrench plus that of a link."""
    force = step.inward(wrench[0])
    moment = step.inward(wrench[1])
    return (parent_wrench[0] + force,
            parent_wrench[1] + (moment + cross(step.offset, force)))


def velocities(links: Sequence[Link], q: Vector,
               u: Vector) -> list[tuple[Vector, Vector]]:
    """Return (omega, v of the origin) of all links in link axes, rad/s and m/s."""
    result: list[tuple[Vector, Vector]] = []
    for link in links:
        step = JointStep(link, q)
        rate = link.rate(q, u)
        # The velocity of the parent's point at the link's origin, then the joint's.
        omega, v = ZERO, ZERO
        if link.parent != WORLD:
            omega, v = result[link.parent]
            v = v + cross(omega, step.offset)
        # In the axes of the link, where the joint adds its rate along z.
        omega = step.outward(omega)
        v = step.outward(v)
        if link.kind == 'revolute':
            result.append((omega + rate * Z, v))
        else:
            result.append((omega, v + rate * Z))
    return result


def kinetic_energy(links: Sequence[Link], q: Vector, u: Vector) -> Scalar:
    """Return the kinetic energy sum 1/2 int v . v dm of all links, J."""
    twice: Scalar = 0.0
    for link, (omega, v) in zip(links, velocities(links, q, u)):
        if link.modes is not None:
            twice = twice + link.modes.twice_energy(omega, v, u)
        # int |v + omega x r|^2 dm = m v.v + 2 v . (omega x h) + omega . I omega, where
        # I = trace(S) - S.
        S, h = link.second_moment, link.first_moment
        trace = S[0, 0] + S[1, 1] + S[2, 2]
        twice = (twice + link.mass * (v @ v) + 2.0 * (v @ cross(omega, h))
                 + trace * (omega @ omega) - omega @ (S @ omega))
    return 0.5 * twice


def potential_energy(links: Sequence[Link], q: Vector, gravity: Vector) -> Scalar:
    """Return the potential energy -sum m g . p*, J, zero at the world's origin."""
    return -(gravity @ first_moment(links, q)[1])


def first_moment(links: Sequence[Link], q: Vector) -> tuple[Scalar, Vector]:
    """Return the mass of all links, kg, and sum m p*, (3,), kg m, world axes."""
    moments = []
    for link in links:
        moments.append((link.mass, link.first_moment))
    total_mass: Scalar = 0.0
    total_moment: Vector = ZERO
    # Inward pass: masses and first moments of subtrees.
    for i in reversed(range(len(links))):
        mass, h = moments[i]
        step = JointStep(links[i], q)
        # About the parent's origin: h + m r, in the parent's axes.
        h = step.inward(h) + mass * step.offset
        parent = links[i].parent
        if parent == WORLD:
            total_mass = total_mass + mass
            total_moment = total_moment + h
        else:
            parent_mass, parent_h = moments[parent]
            moments[parent] = (parent_mass + mass, parent_h + h)
    return total_mass, total_moment
