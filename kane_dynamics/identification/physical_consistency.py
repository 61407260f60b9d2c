"""
Inertial parameters that some distribution of mass could have, by semidefinite programming.

A body's parameters are physical if and only if its pseudo-inertia P is positive semidefinite
(Wensing, Kim & Slotine, RA-L 3 (2018)). What torques cannot tell is settled by nearness to the
model that one began with: with P0 = L L^T and P = L (1 + Z) L^T the distance is |Z|^2, the second
order of the Riemannian distance between P and P0 and as free of the choice of frame and units as
that is (Lee, Wensing & Park, IEEE T-RO 36 (2020)). Z also scales the program: 1 + Z >= 0. Where
that holds at the minimum without it, least squares with bounds on friction are enough.
"""

from collections.abc import Sequence

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.identification.regression import LOWEST, triangle
from kane_dynamics.identification.solvers import scientific
from kane_dynamics.mechanics.recursive.regressor import ENTRIES
from kane_dynamics.model.model import Inertial
import numpy as np

SMALLEST = 1e-4  # eigenvalue of 1 + Z: no body comes nearer to impossible than that
FLOOR = 1e-6  # of P0's eigenvalues, relative to the largest: thin and massless bodies get some
MASSLESS = 1e-3  # kg m^2 and kg, where P0 is zero
# An orthonormal basis of symmetric matrices: |Z|^2 is that of the coefficients.
SYMMETRIC = np.array([(np.outer(e, f) + np.outer(f, e)) / (2.0 if r == s else np.sqrt(2.0))
                      for r, e in enumerate(np.eye(4)) for s, f in enumerate(np.eye(4)[:r + 1])])


def parameters_of(P: Array) -> Array:
    """Return the ten parameters of a pseudo-inertia (4, 4), or of any symmetric matrix."""
    about_origin = np.trace(P[:3, :3]) * np.eye(3) - P[:3, :3]
    return np.array([P[3, 3], *P[:3, 3], *(about_origin[r, s] for r, s in ENTRIES)])


def pseudo_inertia_of(parameters: Array) -> Array:
    """Return the pseudo-inertia (4, 4) of ten parameters."""
    inertia = np.empty((3, 3))
    for (r, s), value in zip(ENTRIES, parameters[4:], strict=True):
        inertia[r, s] = inertia[s, r] = value
    first = parameters[1:4, None]
    return np.block([[0.5 * np.trace(inertia) * np.eye(3) - inertia, first],
                     [first.T, parameters[:1, None]]])


def prior_metric(prior: Inertial) -> Array:
    """Return G, (10, 10): the distance |Z|^2 of parameters p from the prior's is dp G dp."""
    inverse = np.linalg.inv(_root(prior.pseudo_inertia))
    Z = np.column_stack([(inverse @ pseudo_inertia_of(unit) @ inverse.T).ravel()
                         for unit in np.eye(10)])
    return np.asarray(Z.T @ Z)


def prior_parameters(prior: Inertial) -> Array:
    """Return the ten parameters from which distance counts: the prior's, thin bodies lifted."""
    L = _root(prior.pseudo_inertia)
    return parameters_of(L @ L.T)


def physical(A: Array, b: Array, prior: Sequence[Inertial], joints: int, weight: float
             ) -> Array:
    """
    Return the x that minimises |A x - b|^2 + weight * sum |Z|^2 with every body physical.

    Parameters
    ----------
    A, b : (m, 10 bodies + 4 joints), (m,) arrays
        Equations; each divided by its standard deviation.
    prior : sequence of Inertial
        The bodies to begin with, and to stay near to.
    joints : int
        How many joints have friction and armature among the unknowns, none of them negative but
        for offsets.
    weight : float
        Positive: how much nearness to the prior counts.

    Raises
    ------
    InputError
        The solver finds no optimum; says what it reports.

    """
    count = len(prior)
    roots = [_root(inertial.pseudo_inertia) for inertial in prior]
    free = _unconstrained(A, b, roots, joints, weight)
    if free is not None:
        return free
    cp = scientific('cvxpy')
    Z = [cp.Variable((4, 4), symmetric=True) for _ in prior]
    losses = cp.Variable(4 * joints) if joints else None
    scale = np.maximum(np.linalg.norm(A[:, 10 * count:], axis=0), 1e-12)
    columns, start = [], np.zeros(0)
    for k, L in enumerate(roots):
        change = np.column_stack([parameters_of(L @ unit.reshape(4, 4) @ L.T)
                                  for unit in np.eye(16)])  # of the parameters with Z's entries
        columns.append(A[:, 10 * k:10 * k + 10] @ change)
        start = np.concatenate([start, parameters_of(L @ L.T)])
    left = b - A[:, :10 * count] @ start
    made = sum(C @ cp.vec(z, order='C') for C, z in zip(columns, Z, strict=True))
    limits = [np.eye(4) + z >> SMALLEST * np.eye(4) for z in Z]
    if losses is not None:
        made = made + (A[:, 10 * count:] / scale) @ losses
        bounded = np.flatnonzero(np.isfinite(np.tile(LOWEST, joints)))
        limits.append(losses[bounded] >= 0.0)
    size = max(float(np.linalg.norm(left)), 1e-12)
    cost = (cp.sum_squares((made - left) / size)
            + weight / size**2 * sum(cp.sum_squares(z) for z in Z))
    problem = cp.Problem(cp.Minimize(cost), limits)
    try:
        problem.solve(solver=cp.CLARABEL)
    except cp.SolverError as error:
        raise InputError(f'no physical parameters found: {error}') from None
    if problem.status != 'optimal':
        raise InputError(f'no physical parameters found: the solver reports {problem.status}')
    found = [parameters_of(L @ (np.eye(4) + 0.5 * (z.value + z.value.T)) @ L.T)
             for L, z in zip(roots, Z, strict=True)]
    lost = np.zeros(0)
    if losses is not None:
        lost = np.maximum(losses.value / scale, np.tile(LOWEST, joints))
    return np.concatenate([*found, lost])


def _unconstrained(A: Array, b: Array, roots: Sequence[Array], joints: int, weight: float
                   ) -> Array | None:
    """
    Return the minimum without regard to the bodies, None if one of them is not physical then.

    The problem is convex: where this is physical it is the answer, and more accurate than that of
    an interior point method, which stops short where data and prior differ much in weight.
    """
    size = 10 * len(roots)
    changes = [np.column_stack([parameters_of(L @ unit @ L.T) for unit in SYMMETRIC])
               for L in roots]
    start = np.concatenate([parameters_of(L @ L.T) for L in roots])
    by_Z = [A[:, 10 * k:10 * k + 10] @ change for k, change in enumerate(changes)]
    nearness = np.hstack([np.sqrt(weight) * np.eye(size), np.zeros((size, 4 * joints + 1))])
    R = triangle(np.vstack([
        np.column_stack([*by_Z, A[:, size:], b - A[:, :size] @ start]), nearness]))
    lengths = np.linalg.norm(R[:, :-1], axis=0)
    lengths[lengths == 0.0] = 1.0
    lowest = np.concatenate([np.full(size, -np.inf), np.tile(LOWEST, joints)])
    found = scientific('scipy.optimize').lsq_linear(R[:, :-1] / lengths, R[:, -1], method='bvls',
                                                    bounds=(lowest, np.inf))
    x = np.maximum(found.x / lengths, lowest)
    Z = x[:size].reshape(-1, 10)
    least = np.linalg.eigvalsh(np.eye(4) + np.tensordot(Z, SYMMETRIC, axes=1)).min()
    if not found.success or least < SMALLEST:
        return None
    moved = [change @ z for change, z in zip(changes, Z, strict=True)]
    return np.concatenate([start + np.concatenate(moved), x[size:]])


def _root(P: Array) -> Array:
    """Return L with L L^T = P, its eigenvalues lifted off zero."""
    values, vectors = np.linalg.eigh(P)
    top = float(values[-1])
    return np.asarray(vectors * np.sqrt(np.maximum(values, FLOOR * top if top > 0.0
                                                   else MASSLESS)))
