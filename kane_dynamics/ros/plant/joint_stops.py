"""Joint stops as rigid, inelastic, frictionless obstacles."""

from kane_dynamics._util.typing import Array
import numpy as np


def pushed_back(x: Array, side: Array, inverse_mass: Array) -> Array:
    """
    Return speeds, or displacements past stops, after the stops have pushed them back.

    A push is an impulse on each joint that a stop reaches. It pushes away from the stop only, it
    leaves nothing that goes into the stop, and it acts only where something would otherwise: with
    the impulses p and what is left into the stops, v,

        p >= 0,  v = s x - A p <= 0,  p . v = 0,  A = s M^-1 s.

    Every other joint feels it through the mass matrix, and no kinetic energy is gained. M^-1 is
    positive definite, so that there is one solution, and Murty's least-index method finds it in a
    finite number of exchanges (Cottle, Pang, Stone, The Linear Complementarity Problem, section
    4.7).

    Parameters
    ----------
    x : (n,) array
        Before: speeds, or how far past its stop each joint is, negative where it is not.
    side : (n,) array
        1 for a joint that its upper stop may push, -1 for its lower one, 0 for none.
    inverse_mass : (n, n) array
        M^-1 at this position.

    Returns
    -------
    (n,) array

    """
    touching = np.flatnonzero(side)
    s = side[touching]
    A = s[:, None] * inverse_mass[np.ix_(touching, touching)] * s
    into = s * x[touching]
    struck = into > 0.0
    while True:
        p = np.zeros(len(touching))
        p[struck] = np.linalg.solve(A[np.ix_(struck, struck)], into[struck])
        away = A @ p - into
        wrong = np.where(struck, p < 0.0, away < -1e-12 * np.abs(into).max(initial=0.0))
        if not wrong.any():
            break
        least = int(np.argmax(wrong))
        struck[least] = not struck[least]
    after: Array = x - inverse_mass[:, touching] @ (s * p)
    after[touching[struck]] = 0.0  # exactly, lest rounding push the joint on
    return after
