"""Joint stops as rigid, inelastic, frictionless obstacles."""

from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.errors import ConstraintError
import numpy as np

MOST_SETS = 2**12  # of active stops that are tried


def stop_impulses(into: Array, A: Array) -> tuple[Array, Flags]:
    """
    Return the impulses of stops in contact, (k,), and which of them act, (k,) bool.

    The impulses p and the remaining motion into the stops v solve the linear
    complementarity problem

        p >= 0,  v = into - A p <= 0,  p . v = 0.

    For a positive definite A the solution is unique, and Murty's least-index method
    finds it in a finite number of steps (Cottle, Pang, Stone, The Linear Complementarity
    Problem, section 4.7).

    Parameters
    ----------
    into : (k,) array
        Motion into each stop without the impulses.
    A : (k, k) array
        Motion away from each stop per unit of each impulse.

    """
    active = into > 0.0
    for _ in range(min(2**(len(into) + 2), MOST_SETS)):
        # Active stops end the motion into them; the others have no impulse.
        p = np.zeros(len(into))
        p[active] = np.linalg.solve(A[np.ix_(active, active)], into[active])
        away = A @ p - into
        # The sign of one of both is wrong. The first such stop changes sides.
        rounding = 1e-12 * np.abs(into).max(initial=0.0)
        wrong = np.where(active, p < 0.0, away < -rounding)
        if not wrong.any():
            return p, active
        least = int(np.argmax(wrong))
        active[least] = not active[least]
    raise ConstraintError(
        f'joint stops: the impulses of {len(into)} stops are not determined to '
        'rounding; expected stops that the constraints do not couple')


def resolve_stops(x: Array, side: Array, inverse_mass: Array) -> Array:
    """
    Return joint speeds, or displacements from the stops, after the stops' impulses.

    Each stop in contact exerts an impulse that points away from it and prevents motion
    into it: `stop_impulses` with A = s M^-1 s. The mass matrix couples the impulses to
    all joints, and kinetic energy does not increase.

    Parameters
    ----------
    x : (n,) array
        Speeds before the impulses, or displacements from the nearest stop.
    side : (n,) array
        1 for a joint at its upper stop, -1 at its lower stop, 0 otherwise.
    inverse_mass : (n, n) array
        M^-1 at the present configuration.

    Returns
    -------
    (n,) array

    """
    return _resolved(x, side, inverse_mass, np.zeros(len(x)))[0]


def _resolved(x: Array, side: Array, inverse_mass: Array,
              applied: Array) -> tuple[Array, Array]:
    """
    Return the result of `resolve_stops` and the motion into the stops that ended, (n,).

    `x` contains the effect of impulses `applied` of the stops, (n,), in place of which
    others act.
    """
    touching = np.flatnonzero(side)
    s = side[touching]
    p_applied = applied[touching]
    A = s[:, None] * inverse_mass[np.ix_(touching, touching)] * s

    # The impulses that are right for the motion without the applied ones.
    p, active = stop_impulses(s * x[touching] + A @ p_applied, A)
    resolved: Array = x - inverse_mass[:, touching] @ (s * (p - p_applied))
    resolved[touching[active]] = 0.0  # exact, so that rounding does not move the joint
    ended = np.zeros(len(x))
    ended[touching] = ended_motion(s * x[touching], A, p)
    return resolved, ended


def ended_motion(into: Array, A: Array, p: Array) -> Array:
    """
    Return the motion into each stop that its impulse ended, (k,), zero where none acts.

    Of a joint that only the impulses of other stops drive into its stop, it is that
    motion.
    """
    by_impulse = p * np.diag(A)
    motion = np.where(into > 0.0, into, by_impulse)
    ended: Array = np.where(p > 0.0, motion, 0.0)
    return ended


def nearest_stops(q: Array, lower: Array, upper: Array) -> tuple[Array, Array]:
    """
    Return the side of each joint's nearest stop and the displacement from it, (n,) each.

    The side is 1 for the upper and -1 for the lower stop, 0 for a joint without any;
    side times displacement is positive past the stop, rad or m.
    """
    nearer = np.where(upper - q < q - lower, upper, lower)
    stopped = np.isfinite(nearer)
    side = np.where(nearer == upper, 1.0, -1.0) * stopped
    return side, np.where(stopped, q - nearer, 0.0)


def stopped_state(q: Array, u: Array, inverse_mass: Array, lower: Array,
                  upper: Array, applied: Array) -> tuple[Array, Array, Array]:
    """
    Return the state of a tree with its joints past their stops moved back and stopped.

    Third, the speeds into the stops that their impulses ended, (n,), zero of the other
    joints.

    Both corrections use the mass matrix. Moving only the joints past their stops would
    keep displacements of the other joints that a stop prevents.

    Parameters
    ----------
    q, u : (n,) arrays
        rad or m, and s.
    inverse_mass : (n, n) array
        M^-1 at q.
    lower, upper : (n,) arrays
        The stops, rad or m; infinite where there is none.
    applied : (2, n) array
        Impulses of the stops, at least 0, whose effects on q and on u the state contains
        already. The corrections may reduce them to 0: a stop that pressed is left only
        against this pressure.

    """
    # Displacements: the joints past their stops, and what moves with them, back.
    side, away = nearest_stops(q, lower, upper)
    corrected, _ = _resolved(away, side, inverse_mass, applied[0])
    q = np.clip(q + (corrected - away), lower, upper)

    # Speeds: of the joints that are now at a stop, or that a stop pressed before.
    at_stop = np.where(q >= upper, 1.0, np.where(q <= lower, -1.0, 0.0))
    touching = np.where(applied[1] > 0.0, side, at_stop)
    u, ended = _resolved(u, touching, inverse_mass, applied[1])
    return q, u, ended
