"""
Joint torque regressor: inverse dynamics is linear in the bodies' inertial parameters.

Each body has ten parameters about its origin, in body axes and in Pinocchio's order:

    m, m c_x, m c_y, m c_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz

c is the center of mass and I the inertia about the body's origin. With a the acceleration of the
origin minus gravity and U = [alpha]x + [omega]x [omega]x, a body's inertia force m a + U (m c) and
moment (m c) x a + I alpha + omega x I omega are linear in the parameters. The Jacobian (partial
velocities) of the body's origin maps both to generalized forces.
"""

from collections.abc import Sequence
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.algebra.vector import cross
from kane_dynamics.mechanics.recursive.inverse_dynamics import (JointStep, link_motion, LinkMotion,
                                                                REST, Z)
from kane_dynamics.mechanics.recursive.link import Link
from kane_dynamics.mechanics.recursive.subroutines import directly, Share
from kane_dynamics.model.model import Model, WORLD
import numpy as np

PARAMETERS = ('m', 'mx', 'my', 'mz', 'Ixx', 'Ixy', 'Iyy', 'Ixz', 'Iyz', 'Izz')
# Rows and columns of the six independent entries of a symmetric tensor, in that order.
ENTRIES = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))


def inertial_parameters(model: Model) -> Array:
    """Return the inertial parameters of all bodies, (10 n_bodies,), as `PARAMETERS`; kg, m."""
    result = []
    for body in model.bodies:
        P = body.inertial.pseudo_inertia
        about_origin = np.trace(P[:3, :3]) * np.eye(3) - P[:3, :3]
        result.append([P[3, 3], *P[:3, 3], *(about_origin[r, s] for r, s in ENTRIES)])
    return np.array(result).reshape(-1)


def regressor(links: Sequence[Link], q: Any, u: Any, udot: Any, gravity: Any,
              share: Share = directly) -> Any:
    """
    Return the regressor Y, (n, 10 n_bodies): inverse dynamics is Y times the parameters.

    Arguments as `inverse_dynamics`; the links have their origins at the model's joints
    (`link_frames.linkage`). `share` evaluates repeated parts, possibly as subroutines (see
    `subroutines`).
    """
    n = len(q)
    motion: list[LinkMotion] = []
    partials: list[dict[int, Any]] = []  # per joint that moves the link: s and v, (6,)
    Y: list[list[Any]] = [[0.0] * (10 * len(links)) for _ in range(n)]
    for k, link in enumerate(links):
        step = JointStep(link, q)
        motion.append(link_motion(link, step, motion, q, u, udot, gravity))
        state, own = link_state(step, motion[k]), own_partial(link)
        columns = {k: np.concatenate([own, on_joint(link, own, state)])}
        if link.parent != WORLD:
            def below(passed: Any, state: Any, link: Link = link, step: JointStep = step) -> Any:
                moved = outward(step.at(state[0], state[1], state[2:5]), passed)
                return np.concatenate([moved, on_joint(link, moved, state)])
            columns |= {j: share(f'body_{k}', below, passed, state)
                        for j, passed in partials[link.parent].items()}
        partials.append({j: column[:6] for j, column in columns.items()})
        for j, column in columns.items():
            row, factor = links[j].coordinate, links[j].multiplier
            for c, x in enumerate(column[6:]):
                Y[row][10 * k + c] = Y[row][10 * k + c] + factor * x
    return np.array(Y)


def link_state(step: JointStep, motion: LinkMotion) -> Any:
    """Return the state of a link, (23,): sine, cosine and offset of its joint, its motion."""
    omega, alpha, a, U = motion
    return np.concatenate([[step.s, step.c], step.offset, omega, alpha, a, U.ravel()])


def own_partial(link: Link) -> Any:
    """Return the partial velocities of a link for its own joint, (6,): angular, linear."""
    return np.concatenate([Z, REST] if link.kind == 'revolute' else [REST, Z])


def outward(step: JointStep, partial: Any) -> Any:
    """Return partial velocities, (6,), of a link from those of its parent."""
    s, v = partial[:3], partial[3:]
    return np.concatenate([step.outward(s), step.outward(v + cross(s, step.offset))])


def on_joint(link: Link, partial: Any, state: Any) -> Any:
    """
    Return the regressor entries of one joint and one body, (10,).

    Parameters
    ----------
    link : Link
        The link.
    partial : (6,) array of scalars
        Partial velocities of the link for the joint: angular s, then linear v of its origin.
    state : array of scalars
        `link_state`.

    """
    C = link.body[:3, :3].T  # link axes to body axes
    s, v, omega, alpha, a = (C @ x for x in (partial[:3], partial[3:], state[5:8], state[8:11],
                                             state[11:14]))
    U = C @ state[14:].reshape(3, 3) @ C.T
    first = U.T @ v + cross(a, s)  # v . U h + s . (h x a)
    b = cross(s, omega)  # s . (omega x I omega) = (s x omega) . I omega
    second = np.outer(s, alpha) + np.outer(b, omega)
    inertia = [second[r, r] if r == c else second[r, c] + second[c, r] for r, c in ENTRIES]
    return np.array([v @ a, *first, *inertia])
