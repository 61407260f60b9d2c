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
is positive definite, so that D is, too.
"""

from typing import Any

from kane_dynamics._util.typing import Array, Matrix, Vector
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.lanes import LANES, Lanes
from kane_dynamics.mechanics.algebra.ltdl import factorize, solve
import numpy as np

RATIO = 0.7  # default damping ratio of the laws
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


def joint_damping(W: Matrix, stiffness: Vector, ratio: Vector, rates: Vector,
                  lanes: Any = Lanes) -> Vector:
    """
    Return the force of a damper by ratio at joints with springs, (n,), over any scalar.

    It is D times the rates, for J = 1 and a spring at each joint. With the ratios Z of
    the joints D is twice the geometric mean of inertia and Z K Z. Since that mean grows
    with Z, each mode has a ratio from the smallest to the largest of Z.

    Parameters
    ----------
    W : (n, n) array
        Inverse of the inertia of the joints, 1/(kg m^2) or 1/kg.
    stiffness, ratio : (n,) arrays
        N m/rad or N/m; damping ratios.
    rates : (n,) array
        rad/s or m/s.
    lanes : class or object
        As of `inverse_root_times`.

    """
    F = ratio * np.sqrt(stiffness)
    modes = F[:, None] * W * F
    return 2.0 * F * inverse_root_times(modes, F * rates, lanes)


def damping_by_ratio(M: Array, stiffness: Array, ratio: Array) -> Array:
    """
    Return the matrix of the damper by ratio at joints with springs, (n, n).

    It is that of `joint_damping`, by the eigenvalues of F M^-1 F.
    """
    F = ratio * np.sqrt(stiffness)
    modes = F[:, None] * np.linalg.inv(M) * F
    squares, vectors = np.linalg.eigh(modes)
    slowest = SLOWEST**2 * squares.sum()
    if slowest <= 0.0:  # no springs, or no damping
        return np.zeros_like(modes)
    roots = np.sqrt(np.maximum(squares, 0.0) + slowest)
    scaled = F[:, None] * vectors
    return np.asarray(2.0 * (scaled / roots) @ scaled.T)


def inverse_root_times(B: Matrix, y: Vector, lanes: Any = Lanes) -> Vector:
    """
    Return (B + SLOWEST^2 trace(B))^(-1/2) y, over any scalar.

    Parameters
    ----------
    B : (k, k) array
        Symmetric, positive semidefinite; its lower triangle is read.
    y : (k,) array
        Any vector.
    lanes : class or object
        The functions of `Lanes`: of the poles, as many as lanes are computed together.

    """
    k = len(y)
    order = list(range(k))
    scale = sum(B[r, r] for r in range(k))
    largest = select(scale > TINY, scale, 1.0)  # zero for B = 0 alone
    scaled = B * (1.0 / largest)

    # sum w_j (scaled + shift_j)^-1 y, a row of poles at a time. The spectrum begins at
    # SLOWEST^2.
    sums: Any = 0.0
    for first in range(0, POLES, LANES):
        poles = RESOLVENTS[first:first + LANES]
        shifts = lanes.pack([SLOWEST**2 + shift for shift, _ in poles])
        weights = lanes.pack([weight for _, weight in poles])
        factors = factorize(scaled + np.diag([shifts] * k), order)
        sums = sums + weights * solve(factors, order, y)

    # The sum over the lanes.
    by_lane = lanes.transposed(list(sums))
    total = sum(by_lane[1:], by_lane[0])
    roots = np.array([lanes.lane(total, r) for r in order])
    return (1.0 / np.sqrt(largest)) * roots
