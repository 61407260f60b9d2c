"""
Inverse dynamics as a linear function of the bodies' inertial parameters.

Ten numbers a body, about its own origin and in its own axes, in the order that Pinocchio uses:

    m, m c_x, m c_y, m c_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz

c being the mass centre and I the inertia about the body's origin. With a the acceleration of the
origin less gravity and U = [alpha]x + [omega]x [omega]x, a body's inertia force m a + U (m c) and
moment (m c) x a + I alpha + omega x I omega are linear in them; the partial velocities of the
body's origin make generalized forces of both.
"""

from collections.abc import Sequence
from typing import Any

from kane_dynamics.mechanics.linkage import Link
from kane_dynamics.mechanics.recursive import link_motion, Motion, Step, Z
from kane_dynamics.mechanics.vector import cross
from kane_dynamics.model import Array, Model, WORLD
import numpy as np

PARAMETERS = ('m', 'mx', 'my', 'mz', 'Ixx', 'Ixy', 'Iyy', 'Ixz', 'Iyz', 'Izz')
# Rows and columns of the six independent entries of a symmetric tensor, in that order.
ENTRIES = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))


def inertial_parameters(model: Model) -> Array:
    """Return all bodies' parameters, (10 n_bodies,), in the order of `PARAMETERS`; kg, m."""
    result = []
    for body in model.bodies:
        P = body.inertial.pseudo_inertia
        about_origin = np.trace(P[:3, :3]) * np.eye(3) - P[:3, :3]
        result.append([P[3, 3], *P[:3, 3], *(about_origin[r, s] for r, s in ENTRIES)])
    return np.array(result).reshape(-1)


def regressor(links: Sequence[Link], q: Any, u: Any, udot: Any, gravity: Any) -> Any:
    """
    Return Y, (n, 10 n_bodies): the links' inverse dynamics are Y times the parameters.

    Parameters
    ----------
    links : sequence of Link
        Whose origins are those of the model's bodies (`linkage.linkage`).
    q, u, udot : (n,) arrays of scalars
        Coordinates, speeds and their rates; rad or m, s.
    gravity : (3,) array of scalars
        m/s^2, world axes.

    """
    n, steps = len(q), [Step(link, q) for link in links]
    motion: list[Motion] = []
    partials: list[dict[int, tuple[Any, Any]]] = []  # of each joint that moves a link: s, v
    Y: list[list[Any]] = [[0.0] * (10 * len(links)) for _ in range(n)]
    for k, (link, step) in enumerate(zip(links, steps)):
        motion.append(link_motion(link, step, motion, u, udot, gravity))
        here = {}
        if link.parent != WORLD:
            for j, (s, v) in partials[link.parent].items():
                here[j] = step.outward(s), step.outward(v + cross(s, step.offset))
        none = np.zeros(3)
        here[k] = (Z, none) if link.kind == 'revolute' else (none, Z)
        partials.append(here)
        C = link.body[:3, :3].T  # link axes to body axes
        omega, alpha, a = (C @ x for x in motion[k][:3])
        U = C @ motion[k][3] @ C.T
        for j, (s, v) in here.items():
            row, factor = links[j].coordinate, links[j].multiplier
            for c, x in enumerate(_on_joint(C @ s, C @ v, omega, alpha, a, U)):
                Y[row][10 * k + c] = Y[row][10 * k + c] + factor * x
    return np.array(Y)


def _on_joint(s: Any, v: Any, omega: Any, alpha: Any, a: Any, U: Any) -> list[Any]:
    """Return what unit parameters of a body ask of a joint with partial velocities s and v."""
    first = U.T @ v + cross(a, s)  # v . U h + s . (h x a)
    b = cross(s, omega)  # s . (omega x I omega) = (s x omega) . I omega
    second = np.outer(s, alpha) + np.outer(b, omega)
    inertia = [second[r, r] if r == c else second[r, c] + second[c, r] for r, c in ENTRIES]
    return [v @ a, *first, *inertia]
