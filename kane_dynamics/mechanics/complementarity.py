"""
One boxed linear complementarity problem, for forces and for impulses of rows.

    w = A x + b,  lower <= x <= upper,
    x at lower: w >= 0,  x at upper: w <= 0,  between: w = 0

Joint stops, friction of joints at rest and contacts are rows of it. For a positive
definite A the solution is unique, and Murty's least-index method finds it in a finite
number of exchanges (Cottle, Pang, Stone, The Linear Complementarity Problem, section
4.7). Rows may be redundant: A is made regular, so that they share with the least sum of
squares, and one step of refinement takes out the error of that.

The two tangents of a contact have a disc in place of a box: their force is at most mu
times the normal force, so that its size depends on the result. `with_discs` solves this
to rounding, with the disc itself and not with a polygon.
"""

from collections.abc import Sequence
from itertools import product
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.integrators.held_joints import REGULAR
import numpy as np

ROUNDING = 1e-12  # of w, relative to the largest entry of b
BLOCKS = 20  # exchanges of all wrong rows at once, before one at a time
MOST_SETS = 2**12  # sets of rows at their bounds that are tried
ROUNDS, SWEEPS, STEPS = 20, 30, 30  # of sweeps, then Newton's method
LENGTHS = 1.0, 0.5, 0.2, 0.05, 0.01  # of a step of Newton's method
REDUNDANT = 1e-9  # as `SETTLED`, of redundant rows that contradict each other to rounding
SETTLED = 1e-14  # residual of the projections, relative to the largest force
# Of b, relative to its largest entry, in directions that no force changes: rounding of the
# distances of rows that touch, times restitution, which is not known better.
CONTRADICTION = 1e-6


class Disc(NamedTuple):
    """Rows of the normal and of both tangents of a contact, and its friction mu."""

    normal: int
    first: int
    second: int
    friction: float


def lcp(A: Array, b: Array, lower: Array, upper: Array) -> Array:
    """
    Return the solution x, (k,), of the boxed linear complementarity problem.

    Parameters
    ----------
    A : (k, k) array
        Positive semidefinite, or a P-matrix.
    b, lower, upper : (k,) arrays
        The bounds may be infinite; b is in the range of A where they are.

    Raises
    ------
    ConstraintError
        No solution was found: the forces of the rows are not determined.

    """
    k = len(b)
    at_bound = np.zeros(k, dtype=int)  # -1 at lower, 1 at upper, 0 between
    for trial in range(MOST_SETS):
        x, changed = _exchanged(A, b, lower, upper, at_bound)
        wrong = changed != at_bound
        if not wrong.any():
            return x
        if trial >= BLOCKS:
            wrong &= np.arange(k) == np.argmax(wrong)
        at_bound = np.where(wrong, changed, at_bound)

    # Of no P-matrix, as where friction jams a contact that slides: all sets.
    if 3**k <= MOST_SETS:
        for combination in product((-1, 0, 1), repeat=k):
            at_bound = np.array(combination)
            x, changed = _exchanged(A, b, lower, upper, at_bound)
            if np.isfinite(x).all() and np.array_equal(changed, at_bound):
                return x
    raise ConstraintError(f'contacts and stops: the forces of {k} rows are not determined '
                          'to rounding; expected rows that do not contradict each other, '
                          'and less friction of contacts')


def _exchanged(A: Array, b: Array, lower: Array, upper: Array, at_bound: Any
               ) -> tuple[Array, Any]:
    """Return x with the rows at their bounds, and `at_bound` with all wrong rows changed."""
    x = np.where(at_bound < 0, lower, np.where(at_bound > 0, upper, 0.0))
    free = at_bound == 0
    if not np.isfinite(x).all():
        return x, np.where(np.isfinite(x), at_bound, 0)
    x[free] = held(A[np.ix_(free, free)], b[free] + A[free][:, ~free] @ x[~free])
    w = A @ x + b
    rounding = ROUNDING * np.abs(b).max(initial=0.0)
    changed = np.where(free & (x < lower), -1, np.where(free & (x > upper), 1, at_bound))
    leaves = ((at_bound < 0) & (w < -rounding)) | ((at_bound > 0) & (w > rounding))
    return x, np.where(leaves, 0, changed)


def held(A: Array, b: Array) -> Array:
    """Return x with A x + b = 0, (k,), of minimum norm where A is singular."""
    if not len(b):
        return np.zeros(0)
    size = float(np.trace(A)) or 1.0
    regular = A + REGULAR * size * np.eye(len(b))
    x = -np.linalg.solve(regular, b)
    return np.asarray(x - np.linalg.solve(regular, A @ x + b))


def with_discs(A: Array, b: Array, lower: Array, upper: Array,
               discs: Sequence[Disc]) -> Array:
    """
    Return the solution of `lcp` with the tangents of contacts in discs.

    A force at the edge of its disc is opposite to the slip w of its tangents. Sweeps over
    the rows (projected Gauss-Seidel) find which forces are at their bounds; Newton's
    method for the projections (Alart and Curnier, 1991) then ends at rounding.
    """
    b = consistent(A, b)
    # Where no force leaves its disc, all contacts stick or are open.
    low, high = lower.copy(), upper.copy()
    tangents = [row for disc in discs for row in (disc.first, disc.second)]
    low[tangents], high[tangents] = -np.inf, np.inf
    x = lcp(A, b, low, high)
    if all(np.hypot(x[first], x[second]) <= friction * x[normal]
           for normal, first, second, friction in discs):
        return x

    projection = _Projection(A, b, lower, upper, discs)
    x = np.zeros(len(b))
    for _ in range(ROUNDS):
        for _ in range(SWEEPS):
            x = projection.swept(x)
        x, converged = projection.newton(x)
        if converged:
            return projection.bounded(x)
    if projection.residual(x) <= REDUNDANT:
        return projection.bounded(x)
    raise ConstraintError(f'contacts: the friction of {len(discs)} contacts is not '
                          'determined: the law has no solution or several '
                          "(Painleve's paradox); expected less friction")


def consistent(A: Array, b: Array) -> Array:
    """
    Return b, (k,), without the little that redundant rows contradict each other.

    Of four corners of a box that land on an edge, with two at rest to rounding, the rebounds
    are not quite those of a rigid body, and no impulses give them. A larger contradiction
    stays in b.
    """
    if not len(b):
        return b
    directions = still_directions(A)
    contradiction = directions @ (directions.T @ b)
    if np.abs(contradiction).max() > CONTRADICTION * np.abs(b).max():
        return b
    return np.asarray(b - contradiction)


def still_directions(A: Array) -> Array:
    """Return the directions, the columns of (k, r), in which A x is zero for every x."""
    left, sizes, _ = np.linalg.svd(A)
    return np.asarray(left[:, sizes <= REGULAR * sizes[0]])


class _Projection:
    """The problem of `with_discs` as a fixed point: x is the projection of x - w / scale."""

    def __init__(self, A: Array, b: Array, lower: Array, upper: Array,
                 discs: Sequence[Disc]) -> None:
        """Store the problem."""
        self.A, self.b, self.lower, self.upper = A, b, lower, upper
        self.discs = discs
        self.scale = np.maximum(np.diag(A).copy(), 1e-300)
        tangents = []
        for _, first, second, _ in discs:
            both = [first, second]
            self.scale[both] = max(np.linalg.norm(A[np.ix_(both, both)], 2), 1e-300)
            tangents += both
        self.boxed = [row for row in range(len(b)) if row not in tangents]

    def swept(self, x: Array) -> Array:
        """Return x after the projection of one row, or one disc, after the other."""
        x = x.copy()
        for row in self.boxed:
            w = self.A[row] @ x + self.b[row]
            x[row] = min(max(x[row] - w / self.scale[row], self.lower[row]),
                         self.upper[row])
        for normal, first, second, friction in self.discs:
            both = [first, second]
            trial = x[both] - (self.A[both] @ x + self.b[both]) / self.scale[both]
            size = float(np.linalg.norm(trial))
            radius = friction * max(0.0, float(x[normal]))
            x[both] = trial if size <= radius else trial * (radius / size)
        return x

    def _linearized(self, x: Array) -> tuple[Array, Array]:
        """Return the residuals of all projections and their derivatives with respect to x."""
        k = len(x)
        trial = x - (self.A @ x + self.b) / self.scale
        of_trial = np.eye(k) - self.A / self.scale[:, None]
        # Between its bounds a row has x = trial; at one of them x is the bound.
        residual = x - np.clip(trial, self.lower, self.upper)
        between = (trial > self.lower) & (trial < self.upper)
        slope = np.eye(k) - between[:, None] * of_trial
        for normal, first, second, friction in self.discs:
            both = [first, second]
            size = float(np.linalg.norm(trial[both]))
            radius = friction * max(0.0, float(x[normal]))
            if size <= radius:
                residual[both] = x[both] - trial[both]
                slope[both] = np.eye(k)[both] - of_trial[both]
                continue
            along = trial[both] / size
            residual[both] = x[both] - radius * along
            across = (np.eye(2) - np.outer(along, along)) * (radius / size)
            slope[both] = np.eye(k)[both] - across @ of_trial[both]
            if x[normal] > 0.0:
                slope[both, normal] -= friction * along
        return residual, slope

    def residual(self, x: Array) -> float:
        """Return the largest residual of the projections, relative to the largest force."""
        return float(np.abs(self._linearized(x)[0]).max() / max(np.abs(x).max(), 1e-300))

    def bounded(self, x: Array) -> Array:
        """Return x with the rows that have a box inside it."""
        x[self.boxed] = np.clip(x, self.lower, self.upper)[self.boxed]
        return x

    def newton(self, x: Array) -> tuple[Array, bool]:
        """Return x after Newton's method, and whether it has converged."""
        for _ in range(STEPS):
            residual, slope = self._linearized(x)
            size = np.abs(residual).max()
            if size <= SETTLED * np.abs(x).max(initial=0.0):
                return x, True
            change = np.linalg.lstsq(slope, residual, rcond=REGULAR)[0]
            for length in LENGTHS:
                trial = x - length * change
                if np.abs(self._linearized(trial)[0]).max() < size:
                    break
            else:
                return x, bool(size <= 1e3 * SETTLED * np.abs(x).max(initial=0.0))
            x = trial
        return x, False
