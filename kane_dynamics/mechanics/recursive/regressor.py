"""
Joint torque regressor: inverse dynamics is linear in the bodies' inertial parameters.

Each body has ten parameters about its origin, in body axes and in Pinocchio's order:

    m, m c_x, m c_y, m c_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz

c is the center of mass and I the inertia about the body's origin. With a the
acceleration of the origin minus gravity and U = [alpha]x + [omega]x [omega]x, a body's
inertia force m a + U (m c) and moment (m c) x a + I alpha + omega x I omega are linear
in the parameters. The Jacobian (partial velocities) of the body's origin maps both to
generalized forces.
"""

from collections.abc import Sequence

from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.vector import cross
from kane_dynamics.mechanics.recursive.inverse_dynamics import (JointStep, link_motion,
                                                                LinkMotion, ZERO)
from kane_dynamics.mechanics.recursive.link import Link, Z
from kane_dynamics.mechanics.recursive.subroutines import directly, Share
from kane_dynamics.model.model import Model, WORLD
import numpy as np

PARAMETERS = ('m', 'mx', 'my', 'mz', 'Ixx', 'Ixy', 'Iyy', 'Ixz', 'Iyz', 'Izz')
# Rows and columns of the six independent entries of a symmetric tensor, in that order.
ENTRIES = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))


def inertial_parameters(model: Model) -> Array:
    """Return the inertial parameters of all bodies, (10 n_bodies,); kg, m."""
    by_body = [parameters_of(body.inertial.pseudo_inertia) for body in model.bodies]
    return np.array(by_body).ravel()


def parameters_of(P: Array) -> Array:
    """Return the ten parameters of a pseudo-inertia (4, 4), or of any symmetric matrix."""
    about_origin = np.trace(P[:3, :3]) * np.eye(3) - P[:3, :3]
    return np.array([P[3, 3], *P[:3, 3], *(about_origin[r, s] for r, s in ENTRIES)])


def pseudo_inertia_of(parameters: Array) -> Array:
    """Return the pseudo-inertia (4, 4) of ten parameters."""
    xx, xy, yy, xz, yz, zz = parameters[4:]
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    first = parameters[1:4, None]
    return np.block([[0.5 * np.trace(inertia) * np.eye(3) - inertia, first],
                     [first.T, parameters[:1, None]]])


def regressor(links: Sequence[Link], q: Vector, u: Vector, udot: Vector, gravity: Vector,
              share: Share = directly) -> Matrix:
    """
    Return the regressor Y, (n, 10 n_bodies): inverse dynamics is Y times the parameters.

    Arguments as `inverse_dynamics`; the links have their origins at the model's joints
    (`link.linkage`). `share` evaluates repeated parts, possibly as subroutines
    (see `subroutines`).
    """
    motions: list[LinkMotion] = []
    # Of each link, by the joint that moves it: partial velocities, (6,).
    partials: list[dict[int, Vector]] = []
    Y: list[list[Scalar]] = [[0.0] * (10 * len(links)) for _ in range(len(q))]
    for k, link in enumerate(links):
        step = JointStep(link, q)
        motions.append(link_motion(link, step, motions, q, u, udot, gravity))
        state = link_state(step, motions[k])

        # Outward pass: the partial velocities for this joint, and for those toward the
        # root, which are transformed from the parent; then their entries of Y.
        joint_partial = joint_partial_velocity(link)
        entries = regressor_entries(link, joint_partial, state)
        columns = {k: np.concatenate([joint_partial, entries])}
        if link.parent != WORLD:
            def from_parent(partial: Vector, state: Vector, link: Link = link,
                            step: JointStep = step) -> Vector:
                moved = outward_partial(step.at(state[0], state[1], state[2:5]), partial)
                return np.concatenate([moved, regressor_entries(link, moved, state)])

            for j, partial in partials[link.parent].items():
                columns[j] = share(f'body_{k}', from_parent, partial, state)
        # Rows of Y: joints that share a coordinate add up.
        partials.append({j: column[:6] for j, column in columns.items()})
        for j, column in columns.items():
            row = Y[links[j].coordinate]
            for c, entry in enumerate(column[6:], start=10 * k):
                row[c] = row[c] + links[j].multiplier * entry
    return np.array(Y)


def link_state(step: JointStep, motion: LinkMotion) -> Vector:
    """Return sine, cosine and offset of a link's joint and its motion, (23,)."""
    omega, alpha, a, U = motion
    return np.concatenate([[step.s, step.c], step.offset, omega, alpha, a, U.ravel()])


def joint_partial_velocity(link: Link) -> Vector:
    """Return the partial velocities of a link for its joint, (6,): angular, linear."""
    return np.concatenate([Z, ZERO] if link.kind == 'revolute' else [ZERO, Z])


def outward_partial(step: JointStep, partial: Vector) -> Vector:
    """Return partial velocities, (6,), of a link from those of its parent."""
    s, v = partial[:3], partial[3:]
    angular = step.outward(s)
    linear = step.outward(v + cross(s, step.offset))
    return np.concatenate([angular, linear])


def regressor_entries(link: Link, partial: Vector, state: Vector) -> Vector:
    """
    Return the regressor entries of one joint and one body, (10,).

    Parameters
    ----------
    link : Link
        The link.
    partial : (6,) array of scalars
        Partial velocities of the link for the joint: angular s, then linear v of its
        origin.
    state : array of scalars
        `link_state`.

    """
    C = link.body[:3, :3].T  # link axes to body axes
    s = C @ partial[:3]
    v = C @ partial[3:]
    omega = C @ state[5:8]
    alpha = C @ state[8:11]
    a = C @ state[11:14]
    U = C @ state[14:].reshape(3, 3) @ C.T

    # Coefficients of the first moment h = m c: v . U h + s . (h x a)
    first = U.T @ v + cross(a, s)
    # Coefficients of I: s . I alpha + s . (omega x I omega) = s . I alpha + b . I omega
    b = cross(s, omega)
    second = np.outer(s, alpha) + np.outer(b, omega)
    inertia = []
    for r, c in ENTRIES:
        inertia.append(second[r, r] if r == c else second[r, c] + second[c, r])
    return np.array([v @ a, *first, *inertia])
