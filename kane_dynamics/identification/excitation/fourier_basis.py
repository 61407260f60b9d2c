"""
Finite Fourier series that start and end at rest, with analytic derivatives.

With w = 2 pi / period and k = 1 ... H harmonics a joint moves as

    u(t) = sum a_k cos(k w t) + b_k sin(k w t),

q its integral and udot its derivative (Swevers et al., IEEE T-RA 13 (1997)). Rest at the
start, and so at the end of each period, takes sum a_k = 0 for the speed and sum k b_k =
0 for the acceleration: a_1 and b_1 follow from the others, which are free, as is the
center of q.
"""

from dataclasses import dataclass

from kane_dynamics._util.typing import Array
import numpy as np


@dataclass(frozen=True)
class FourierBasis:
    """
    The motions of rest-to-rest Fourier series: q, u and udot are matrices times coefficients.

    Attributes
    ----------
    period : float
        s.
    harmonics : int
        2 or more.

    """

    period: float
    harmonics: int

    @property
    def size(self) -> int:
        """Return the number of coefficients of a joint: the center, then a_k and b_k, k > 1."""
        return 2 * self.harmonics - 1

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """
        Return Q, U and A, (N, size) each, with q = Q p, u = U p and udot = A p.

        Of a joint's coefficients p, the center p[0] has the unit of q, all others that of u.
        """
        k = np.arange(1.0, self.harmonics + 1.0)
        w = 2.0 * np.pi / self.period * k
        s, c = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
        # Of a_k and of b_k, which counts by k for even sizes: integral, value,
        # derivative.
        parts = [(s / w, -c / (w * k)), (c, s / k), (-s * w, c * (w / k))]
        # The sums over all k vanish at the start: k = 1 follows from the others.
        matrices = []
        for of_a, of_b in parts:
            matrices.append(np.hstack([np.zeros((len(t), 1)), of_a[:, 1:] - of_a[:, :1],
                                       of_b[:, 1:] - of_b[:, :1]]))
        Q, U, A = matrices
        Q[:, 0] = 1.0
        return Q, U, A
