"""
Damping by ratio, from the inertia and the stiffness at each state.

Every mode of a mass M with the stiffness J^T K J, K = F^T F, has the damping ratio zeta
with the damping matrix J^T D J, where

    D = 2 zeta F^T (F W F^T)^(-1/2) F,    W = J M^-1 J^T.

It is 2 zeta times the geometric mean of Lambda = W^-1 and K, the same as by double
diagonalization (A. Albu-Schaeffer et al., "Cartesian impedance control of redundant
robots", ICRA 2003), but without an inverse of W: where the frame loses a direction, D
grows as slowly as J falls, and J^T D J tends to zero.

The inverse square root is a sum of resolvents with the poles of Zolotarev's best
rational approximation (N. Hale, N. Higham, L. Trefethen, "Computing A^alpha, log(A), and
related matrix functions by contour integrals", SIAM J. Numer. Anal. 46, 2008). Each one
is positive definite, so that D is, too. The matrix is made tridiagonal first.
"""

from typing import Any

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.mechanics.algebra.lanes import LANES, Lanes
import numpy as np

SLOWEST = 1e-5  # modes slower than this fraction of the fastest are damped less
POLES = 24  # relative error of the inverse square root: 3e-7
TINY = 1e-280


def _resolvents() -> tuple[tuple[float, float], ...]:
    """Return shifts s and weights w: x^-1/2 = sum of w / (x + s), SLOWEST^2 <= x <= 1."""
    least = SLOWEST**2
    # The arithmetic-geometric mean gives the quarter period, Landen's transformation the
    # elliptic functions sn, cn and dn of the modulus sqrt(1 - least).
    means = [(1.0, SLOWEST, np.sqrt(1.0 - least))]
    while means[-1][2] > 1e-16:
        a, b, _ = means[-1]
        means.append((0.5 * (a + b), np.sqrt(a * b), 0.5 * (a - b)))
    quarter = 0.5 * np.pi / means[-1][0]
    pairs = []
    for k in range(POLES):
        t = (k + 0.5) * quarter / POLES
        angle = 2.0**(len(means) - 1) * means[-1][0] * t
        for a, _, c in reversed(means[1:]):
            angle = 0.5 * (angle + np.arcsin(c / a * np.sin(angle)))
        sn = np.sin(angle)
        cn = np.cos(angle)
        dn = np.sqrt(1.0 - (1.0 - least) * sn * sn)
        shift = least * (sn / cn)**2
        weight = 2.0 * quarter * SLOWEST / (np.pi * POLES) * dn / (cn * cn)
        pairs.append((float(shift), float(weight)))
    return tuple(pairs)


RESOLVENTS = _resolvents()


def inverse_root_times(B: Matrix, y: Vector, lanes: Any = Lanes) -> Vector:
    """
    Return (B + SLOWEST^2 trace(B))^(-1/2) y, over any scalar.

    Parameters
    ----------
    B : (k, k) array
        Symmetric, positive semidefinite.
    y : (k,) array
        Any vector.
    lanes : class or object
        The functions of `Lanes`: of the poles, as many as lanes are computed together.

    """
    scale = sum(B[r, r] for r in range(len(B)))
    largest = select(scale > TINY, scale, 1.0)  # zero for B = 0 alone
    # B = H T H with T tridiagonal; f(B) y = H f(T) H y.
    diagonal, beside, reflected = _tridiagonal(B * (1.0 / largest), y)

    # The inverse root as a sum of resolvents, sum w_j (T + shift_j)^-1, lanes at a time.
    sums: list[Any] = [0.0] * len(y)
    for first in range(0, POLES, LANES):
        resolvents = RESOLVENTS[first:first + LANES]
        # The spectrum begins at SLOWEST^2.
        shifts = lanes.pack([SLOWEST**2 + shift for shift, _ in resolvents])
        weights = lanes.pack([weight for _, weight in resolvents])
        solution = _shifted_solution(diagonal, beside, shifts, reflected.rotated, lanes)
        for k, row in enumerate(solution):
            sums[k] = sums[k] + weights * row
    total = []
    for row in sums:
        total.append(sum(lanes.lane(row, k) for k in range(LANES)))
    return (1.0 / np.sqrt(largest)) * reflected.back(np.array(total))


class _Reflections:
    """Householder reflections H_1 ... H_k, and a vector that they have reflected."""

    def __init__(self, y: Vector) -> None:
        self.rotated = y
        self._parts: list[tuple[Vector, Scalar]] = []

    def append(self, v: Vector, weight: Scalar) -> None:
        """Reflect by 1 - weight v v^T."""
        self._parts.append((v, weight))
        self.rotated = self.rotated - (weight * (v @ self.rotated)) * v

    def back(self, x: Vector) -> Vector:
        """Return a vector in the axes before the reflections."""
        for v, weight in reversed(self._parts):
            x = x - (weight * (v @ x)) * v
        return x


def _tridiagonal(B: Matrix, y: Vector) -> tuple[Vector, Vector, _Reflections]:
    """Return diagonal, secondary diagonal and y of Q B Q^T, by Householder reflections."""
    n = len(B)
    A = np.array(B, dtype=object)
    reflections = _Reflections(y)
    for k in range(n - 2):
        # The reflection of the column below the diagonal onto its first entry. The sign
        # of alpha avoids a difference of equal numbers.
        column = A[k + 1:, k]
        length = np.sqrt(column @ column)
        alpha = select(column[0] < 0.0, length, -length)
        v = np.zeros(n).astype(object)
        v[k + 1:] = column
        v[k + 1] = column[0] - alpha
        square = length * (length + select(column[0] < 0.0, -column[0], column[0]))
        weight = select(square > TINY, 1.0 / select(square > TINY, square, 1.0), 0.0)
        reflections.append(v, weight)

        # H A H with p = weight A v and r = p - weight / 2 (p . v) v.
        p = weight * (A @ v)
        r = p - (0.5 * weight * (p @ v)) * v
        A = _less_symmetric(A, v, r)
    diagonal = np.array([A[k, k] for k in range(n)])
    beside = np.array([A[k + 1, k] for k in range(n - 1)])
    return diagonal, beside, reflections


def _less_symmetric(A: Matrix, v: Vector, r: Vector) -> Matrix:
    """Return A - v r^T - r v^T of a symmetric A, each entry computed once."""
    result = A.copy()
    for i in range(len(A)):
        for j in range(i + 1):
            entry = A[i, j] - v[i] * r[j] - r[i] * v[j]
            result[i, j] = entry
            result[j, i] = entry
    return result


def _shifted_solution(diagonal: Vector, beside: Vector, shifts: Any, y: Vector,
                      lanes: Any) -> list[Any]:
    """
    Return (T + shift)^-1 y for a tridiagonal T and a row of shifts: rows, (k,).

    By elimination with the leading minors m_k, of which the pivots are the quotients:
    the reciprocals of all minors take one division.
    """
    n = len(diagonal)
    minors: list[Any] = [1.0, diagonal[0] + shifts]
    for k in range(1, n):
        square = beside[k - 1] * beside[k - 1]
        minors.append((diagonal[k] + shifts) * minors[k] - square * minors[k - 1])

    # Forward: the right-hand side of row k times the minor before it.
    right = [y[0]]
    for k in range(1, n):
        right.append(minors[k] * y[k] - beside[k - 1] * right[k - 1])

    # Backward.
    reciprocals = _reciprocals(minors[1:], lanes)
    x: list[Any] = [right[n - 1] * reciprocals[n - 1]]
    for k in reversed(range(n - 1)):
        x.append((right[k] - beside[k] * (minors[k] * x[-1])) * reciprocals[k])
    return x[::-1]


def _reciprocals(values: list[Any], lanes: Any) -> list[Any]:
    """Return the reciprocals of rows of nonzero numbers, with one division per lane."""
    products = values[:1]
    for value in values[1:]:
        products.append(products[-1] * value)
    reciprocal = lanes.pack([1.0 / lanes.lane(products[-1], k) for k in range(LANES)])
    result: list[Any] = []
    for k in reversed(range(1, len(values))):
        result.append(reciprocal * products[k - 1])
        reciprocal = reciprocal * values[k]
    result.append(reciprocal)
    return result[::-1]
