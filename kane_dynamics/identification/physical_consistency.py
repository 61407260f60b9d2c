"""
Physically consistent inertial parameters by semidefinite programming.

A body's parameters are physical if and only if its pseudo-inertia P is positive
semidefinite (Wensing, Kim & Slotine, RA-L 3 (2018)). Parameters that are not
identifiable are determined by the distance from the initial model: with P0 = L L^T and P
= L (1 + Z) L^T the distance is |Z|^2, the second-order term of the Riemannian distance
between P and P0, which is independent of frame and units (Lee, Wensing & Park, IEEE T-RO
36 (2020)). Z also scales the program: 1 + Z >= 0. If the unconstrained minimum satisfies
this, least squares with bounds on friction are enough.
"""

from collections.abc import Sequence
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.identification.regression import triangle
from kane_dynamics.identification.solvers import scientific
from kane_dynamics.mechanics.recursive.regressor import parameters_of, pseudo_inertia_of
from kane_dynamics.model.model import Inertial
import numpy as np

SMALLEST = 1e-4  # lower bound of the eigenvalues of 1 + Z
FLOOR = 1e-6  # lower bound of P0's eigenvalues, relative to the largest, for thin bodies
REGULARIZATION = 1e-12  # of Clarabel's linear systems; its 1e-8 hides a prior of small weight
# Shares of the way to the boundary of the cones that a step of the solver takes. With its
# own 0.99 it may stall just before the optimum if data and prior differ much in weight.
STEPS = (0.99, 0.9, 0.7)
COMBINED = 1e-13  # of a column's length: the rounding of a combination of the columns before it
MASSLESS = 1e-3  # kg m^2 and kg, eigenvalues for P0 = 0
# An orthonormal basis of symmetric matrices: |Z|^2 is that of the coefficients.
# Its order is that of semidefinite matrices in Clarabel: the lower triangle, row by row.
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
        If the solver finds no optimum; the message contains its status.

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
        x = _nearest(R, len(prior), lowest)
    if x is None:
        x = _constrained(R, len(prior), lowest, weight)
    for k, change in enumerate(changes):
        start[10 * k:10 * k + 10] += change @ x[10 * k:10 * k + 10]
    return np.concatenate([start, np.maximum(x[size:], lowest)])


def _unconstrained(R: Array, bodies: int, lowest: Array) -> Array | None:
    """
    Return the minimum without constraints on the bodies; None if a body is not physical.

    The columns of R are those of Z, body by body, of the losses with bounds `lowest`,
    and the right-hand side. The problem is convex: a physical minimum is the solution,
    and more accurate than that of an interior point method, which stops early if data
    and prior differ much in weight.
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


def _nearest(R: Array, bodies: int, lowest: Array) -> Array | None:
    """
    Return the minimum by semidefinite programming in units of its own deviations.

    With the minimum x0 without constraints, the cost of x = x0 + R_x^-1 w is |w|^2 and a
    constant: the program is of size 1 in every direction, however much data and prior
    differ in weight. None where the solver does not find it, as where x0 is far away.
    """
    clarabel = scientific('clarabel')
    sparse = scientific('scipy.sparse')
    solve_triangular = scientific('scipy.linalg').solve_triangular
    count = R.shape[1] - 1
    size = 10 * bodies
    # A loss whose column is a combination of those before it is zero. Offsets come first:
    # friction of a joint that moves one way looks like them, and is at its bound then.
    bounds = np.concatenate([np.full(size, -np.inf), lowest])
    order = np.argsort(np.isfinite(bounds), kind='stable')
    bounds = bounds[order]
    R = triangle(R[:, [*order, count]])
    lengths = np.linalg.norm(R[:, :count], axis=0)
    lengths[lengths == 0.0] = 1.0
    diagonal = np.zeros(count)
    diagonal[:len(R)] = np.diag(R)[:count]
    combined = np.abs(diagonal) <= COMBINED * lengths
    combined[:size] = False
    R = triangle(np.vstack([R, np.diag([*lengths, 1.0])[np.flatnonzero(combined)]]))
    x0 = solve_triangular(R[:count, :count], R[:count, -1])
    root = solve_triangular(R[:count, :count], np.eye(count))

    # Bounds of losses, then 1 + Z of each body: SMALLEST is its least eigenvalue.
    bounded = np.isfinite(bounds)
    identity = np.tile([(1.0 - SMALLEST) * np.trace(unit) for unit in SYMMETRIC], bodies)
    by_w = np.concatenate([root[bounded], root[:size]])
    above = np.concatenate([x0[bounded] - bounds[bounded], x0[:size] + identity])
    cones = [clarabel.NonnegativeConeT(int(bounded.sum())),
             *[clarabel.PSDTriangleConeT(4)] * bodies]
    w, _ = _minimum(sparse.eye(count, format='csc'), sparse.csc_matrix(-by_w), above, cones)
    if w is None:
        return None
    x = np.empty(count)
    x[order] = x0 + root @ w
    return x


def _constrained(R: Array, bodies: int, lowest: Array, weight: float) -> Array:
    """
    Return the minimum by semidefinite programming; arguments as in `_unconstrained`.

    `weight`, that of the prior in R, is named in the error. The variables are Z, the
    losses and the residual r = R x - z; s = b - A x lies in the cones. The basis of Z is
    that of semidefinite matrices in Clarabel.
    """
    clarabel = scientific('clarabel')
    sparse = scientific('scipy.sparse')
    rows = len(R)
    count = R.shape[1] - 1
    size = 10 * bodies
    # Columns and right side of unit size, for the solver's tolerances.
    R = R / max(float(np.linalg.norm(R[:, -1])), 1e-12)
    scale = np.ones(count)
    scale[size:] = np.maximum(np.linalg.norm(R[:, size:-1], axis=0), 1e-12)
    by_x = R[:, :-1] / scale
    bounded = size + np.flatnonzero(np.isfinite(lowest))
    # Minimise |y|^2 / 2 with the equations y = R x - r, bounds of losses, and a positive
    # semidefinite pseudo-inertia of each body.
    A = sparse.bmat([[by_x, -sparse.eye(rows)],
                     [-sparse.eye(count, format='csr')[bounded], None],
                     [-sparse.eye(size, count), None]], format='csc')
    # SMALLEST of the prior's size is the least eigenvalue.
    identity = np.array([(1.0 - SMALLEST) * np.trace(unit) for unit in SYMMETRIC])
    above = np.concatenate([R[:, -1], np.zeros(len(bounded)), np.tile(identity, bodies)])
    cones = [clarabel.ZeroConeT(rows), clarabel.NonnegativeConeT(len(bounded)),
             *[clarabel.PSDTriangleConeT(4)] * bodies]
    P = sparse.block_diag([sparse.csc_matrix((count, count)), sparse.eye(rows)],
                          format='csc')
    x, status = _minimum(P, A, above, cones)
    if x is None:
        raise InputError(
            f'weight: {weight:.3g} of the prior, with which the search for physical '
            f"parameters ends with the solver's status {status}; expected a larger weight")
    return np.asarray(x[:count]) / scale


def _minimum(P: Any, A: Any, above: Array, cones: Sequence[Any]
             ) -> tuple[Array | None, str]:
    """Return the x of the least x^T P x / 2 with above - A x in the cones, and the status."""
    clarabel = scientific('clarabel')
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.static_regularization_constant = REGULARIZATION
    for step in STEPS:
        settings.max_step_fraction = step
        solver = clarabel.DefaultSolver(P, np.zeros(A.shape[1]), A, above, cones, settings)
        solution = solver.solve()
        status = str(solution.status)
        if status == 'Solved':
            return np.asarray(solution.x), status
    return None, status


def _root(P: Array) -> Array:
    """Return L with L L^T = P, with eigenvalues of at least `FLOOR`."""
    values, vectors = np.linalg.eigh(P)
    largest = float(values[-1])
    floor = FLOOR * largest if largest > 0.0 else MASSLESS
    return np.asarray(vectors * np.sqrt(np.maximum(values, floor)))
