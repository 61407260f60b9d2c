"""
Physically consistent inertial parameters, by an interior point method.

A body's parameters are physical if and only if its pseudo-inertia P is positive
semidefinite (Wensing, Kim & Slotine, RA-L 3 (2018)). Parameters that are not
identifiable are determined by the distance from the initial model: with P0 = L L^T and P
= L (1 + Z) L^T the distance is |Z|^2, the second-order term of the Riemannian distance
between P and P0, which is independent of frame and units (Lee, Wensing & Park, IEEE T-RO
36 (2020)). Z also scales the program: 1 + Z >= 0. If the unconstrained minimum satisfies
this, least squares with bounds on friction are enough; a barrier keeps to the cone otherwise.
"""

from collections.abc import Sequence

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.identification.regression import triangle
from kane_dynamics.identification.solvers import scientific
from kane_dynamics.mechanics.recursive.regressor import parameters_of, pseudo_inertia_of
from kane_dynamics.model.model import Inertial
import numpy as np
from numpy.typing import NDArray

SMALLEST = 1e-4  # lower bound of the eigenvalues of 1 + Z
FLOOR = 1e-6  # lower bound of P0's eigenvalues, relative to the largest, for thin bodies
COMBINED = 1e-13  # of a column's length: the rounding of a combination of the columns before it
TINY = 1e-300
FIRST_BARRIER, FALL = 10.0, 0.03  # relative to the mean square of the right side; a step
LAST_BARRIER, ROUNDING = 1e-5, 1e-24  # in squares of standard deviations; of all squares
TO_BOUND = 0.7  # share of the way to a bound that a step takes
EDGE = 1e-13  # least eigenvalue of M: nearer to the cone's edge is rounding
MOST_STEPS = 200
MASSLESS = 1e-3  # kg m^2 and kg, eigenvalues for P0 = 0
# An orthonormal basis of symmetric matrices: |Z|^2 is that of the coefficients.
SYMMETRIC = np.zeros((10, 4, 4))
for _k, (_r, _s) in enumerate(zip(*np.tril_indices(4), strict=True)):
    SYMMETRIC[_k, _r, _s] = SYMMETRIC[_k, _s,
                                      _r] = 1.0 if _r == _s else 1.0 / np.sqrt(2.0)


def prior_metric(prior: Inertial) -> Array:
    """Return G, (10, 10): the distance |Z|^2 from the prior is dp^T G dp for a change dp."""
    # With the prior's pseudo-inertia P = L L^T, a change dP has Z = L^-1 dP L^-T.
    inverse = np.linalg.inv(_root(prior.pseudo_inertia))
    columns = []
    for unit in np.eye(10):
        change = inverse @ pseudo_inertia_of(unit) @ inverse.T
        columns.append(change.ravel())
    Z = np.column_stack(columns)
    return np.asarray(Z.T @ Z)


def prior_parameters(prior: Inertial) -> Array:
    """Return the ten parameters of the prior with eigenvalues of at least `FLOOR`."""
    L = _root(prior.pseudo_inertia)
    return parameters_of(L @ L.T)


def physical(A: Array, b: Array, prior: Sequence[Inertial], lowest: Array, weight: float
             ) -> Array:
    """
    Return the x that minimizes |A x - b|^2 + weight * sum |Z|^2 with physical bodies.

    Parameters
    ----------
    A, b : (m, 10 bodies + losses), (m,) arrays
        Equations, each divided by its standard deviation.
    prior : sequence of Inertial
        Inertials of the initial model.
    lowest : (losses,) array
        Lower bounds of the friction and armature of joints; -inf for none.
    weight : float
        Positive weight of the distance from the prior.

    Raises
    ------
    InputError
        If the search finds no optimum.

    """
    size = 10 * len(prior)
    # By Z of each body: P = L (1 + Z) L^T, so its parameters are linear in Z.
    starts = []
    changes = []
    columns = []
    for k, inertial in enumerate(prior):
        L = _root(inertial.pseudo_inertia)
        change = np.column_stack([parameters_of(L @ unit @ L.T) for unit in SYMMETRIC])
        starts.append(parameters_of(L @ L.T))
        changes.append(change)
        columns.append(A[:, 10 * k:10 * k + 10] @ change)
    # |A x - b|^2 in the new unknowns, with the nearness to the prior as further rows.
    start = np.concatenate(starts)
    data = np.column_stack([*columns, A[:, size:], b - A[:, :size] @ start])
    nearness = np.hstack([np.sqrt(weight) * np.eye(size),
                          np.zeros((size, len(lowest) + 1))])
    R = triangle(np.vstack([data, nearness]))
    # The least squares are physical as a rule; only otherwise the constrained problem
    # is solved.
    x = _unconstrained(R, len(prior), lowest)
    if x is None:
        x = _inside(R, len(prior), lowest, weight)
    for k, change in enumerate(changes):
        start[10 * k:10 * k + 10] += change @ x[10 * k:10 * k + 10]
    return np.concatenate([start, np.maximum(x[size:], lowest)])


def _unconstrained(R: Array, bodies: int, lowest: Array) -> Array | None:
    """
    Return the minimum without constraints on the bodies; None if a body is not physical.

    The columns of R are those of Z, body by body, of the losses with bounds `lowest`,
    and the right-hand side. The problem is convex: a physical minimum is the solution.
    """
    # Columns of equal length: their units differ by orders of magnitude.
    lengths = np.linalg.norm(R[:, :-1], axis=0)
    lengths[lengths == 0.0] = 1.0
    bounds = np.concatenate([np.full(10 * bodies, -np.inf), lowest])
    solution = scientific('scipy.optimize').lsq_linear(
        R[:, :-1] / lengths, R[:, -1], method='bvls', bounds=(bounds, np.inf))
    x = solution.x / lengths
    # A body is physical if 1 + Z is positive definite.
    Z = np.tensordot(x[:10 * bodies].reshape(-1, 10), SYMMETRIC, axes=1)
    smallest = np.linalg.eigvalsh(np.eye(4) + Z).min()
    return x if solution.success and smallest >= SMALLEST else None


def _inside(R: Array, bodies: int, lowest: Array, weight: float) -> Array:
    """
    Return the minimum by an interior point method; arguments as in `_unconstrained`.

    `weight`, that of the prior in R, is named in the error. The cost has barriers, for M = 1
    + Z - SMALLEST of each body and the distance s of each loss from its bound,

        |R x - z|^2 / 2 - m (sum log det M + sum log s),

    of a factor m that falls to zero. With M = L L^T, a step of Newton's method is the least
    squares of R and of rows m^(1/2) L^-1 dZ L^-T = m^(1/2) and m^(1/2) ds / s = m^(1/2), so
    that nothing is squared (Boyd & Vandenberghe, Convex Optimization (2004), chapter 11).
    """
    solve = scientific('scipy.linalg').lstsq
    size = 10 * bodies
    independent = _independent(R, size, lowest)
    A, z, lowest = R[:, independent], R[:, -1], lowest[independent[size:] - size]
    count = len(independent)
    # Losses in units in which their columns have the length 1.
    unit = np.ones(count)
    unit[size:] = np.linalg.norm(A[:, size:], axis=0)
    A = A / unit
    bounded = size + np.flatnonzero(np.isfinite(lowest))
    bounds = lowest[bounded - size] * unit[bounded]
    squares = float(z @ z)
    x = np.zeros(count)
    x[bounded] = bounds + np.sqrt(squares / len(R)) + TINY
    barrier = FIRST_BARRIER * squares / len(R)
    last = max(LAST_BARRIER, ROUNDING * squares)
    target = np.concatenate([np.tile(np.trace(SYMMETRIC, axis1=1, axis2=2), bodies),
                             np.ones(len(bounded))])
    for _ in range(MOST_STEPS):
        rows = np.zeros((size + len(bounded), count))
        Z = np.tensordot(x[:size].reshape(-1, 10), SYMMETRIC, axes=1)
        M = Z + (1.0 - SMALLEST) * np.eye(4)
        if np.linalg.eigvalsh(M).min() < EDGE:
            break
        inverses = np.linalg.inv(np.linalg.cholesky(M))
        for k, inverse in enumerate(inverses):
            changes = inverse @ SYMMETRIC @ inverse.T
            block = slice(10 * k, 10 * k + 10)
            rows[block, block] = np.tensordot(SYMMETRIC, changes, axes=([1, 2], [1, 2]))
        rows[size + np.arange(len(bounded)), bounded] = 1.0 / (x[bounded] - bounds)
        R_step = triangle(np.vstack([np.column_stack([A, z - A @ x]),
                                     np.sqrt(barrier) * np.column_stack([rows, target])]))
        step = solve(R_step[:, :-1], R_step[:, -1], lapack_driver='gelsy')[0]
        # The largest share of the step that stays inside of all bounds.
        relative = rows @ step
        change = np.tensordot(relative[:size].reshape(-1, 10), SYMMETRIC, axes=1)
        least = min(float(np.linalg.eigvalsh(change).min()),
                    float(relative[size:].min(initial=0.0)))
        share = min(1.0, TO_BOUND / max(-least, TINY))
        x = x + share * step
        if share == 1.0:
            if barrier <= last:
                break
            barrier = max(FALL * barrier, last)
    else:
        raise InputError(f'weight: {weight:.3g} of the prior, with which the search for '
                         f'physical parameters takes more than {MOST_STEPS} steps; expected '
                         'a larger weight')
    solution = np.zeros(R.shape[1] - 1)
    solution[independent] = x / unit
    return solution


def _independent(R: Array, size: int, lowest: Array) -> NDArray[np.intp]:
    """
    Return the columns of bodies, and of losses that are no combination of others before them.

    Offsets come first: friction of a joint that moves one way looks like them.
    """
    bounds = np.concatenate([np.full(size, -np.inf), lowest])
    order = np.argsort(np.isfinite(bounds), kind='stable')
    distance = np.zeros(len(order))
    diagonal = np.abs(np.diag(triangle(R[:, order])))
    distance[order[:len(diagonal)]] = diagonal
    distance[:size] = np.inf
    return np.flatnonzero(distance > COMBINED * np.linalg.norm(R[:, :-1], axis=0))


def _root(P: Array) -> Array:
    """Return L with L L^T = P, with eigenvalues of at least `FLOOR`."""
    values, vectors = np.linalg.eigh(P)
    largest = float(values[-1])
    floor = FLOOR * largest if largest > 0.0 else MASSLESS
    return np.asarray(vectors * np.sqrt(np.maximum(values, floor)))
