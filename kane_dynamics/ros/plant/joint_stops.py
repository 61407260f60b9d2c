"""Joint stops as rigid, inelastic, frictionless obstacles."""

from kane_dynamics._util.typing import Array
import numpy as np


def resolve_stops(x: Array, side: Array, inverse_mass: Array) -> Array:
    """
    Return joint speeds, or displacements past the stops, after the impulses of the stops.

    Each stop in contact exerts an impulse that points away from it and prevents motion into it.
    The impulses p and the remaining motion into the stops v solve the linear complementarity
    problem

        p >= 0,  v = s x - A p <= 0,  p . v = 0,  A = s M^-1 s.

    The mass matrix couples the impulses to all joints, and kinetic energy does not increase. As
    M^-1 is positive definite, the solution is unique, and Murty's least-index method finds it in a
    finite number of steps (Cottle, Pang, Stone, The Linear Complementarity Problem, section 4.7).

    Parameters
    ----------
    x : (n,) array
        Speeds before the impulses, or displacement past the nearest stop, negative inside.
    side : (n,) array
        1 for a joint at its upper stop, -1 at its lower stop, 0 otherwise.
    inverse_mass : (n, n) array
        M^-1 at the present configuration.

    Returns
    -------
    (n,) array

    """
    touching = np.flatnonzero(side)
    s = side[touching]
    A = s[:, None] * inverse_mass[np.ix_(touching, touching)] * s
    into = s * x[touching]
    active = into > 0.0
    while True:
        p = np.zeros(len(touching))
        p[active] = np.linalg.solve(A[np.ix_(active, active)], into[active])
        away = A @ p - into
        wrong = np.where(active, p < 0.0, away < -1e-12 * np.abs(into).max(initial=0.0))
        if not wrong.any():
            break
        least = int(np.argmax(wrong))
        active[least] = not active[least]
    after: Array = x - inverse_mass[:, touching] @ (s * p)
    after[touching[active]] = 0.0  # exact zero, so that rounding does not move the joint
    return after
