"""QR factorization of the equations of one joint, for any friction speed."""

from dataclasses import dataclass

from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.friction import coulomb
import numpy as np


@dataclass(frozen=True, eq=False)
class Factor:
    """
    QR factorization of the equations of one joint, without the column of Coulomb friction.

    Attributes
    ----------
    places : (k,) array of int
        Unknowns of the columns of R; the torque is the last.
    coulomb : int
        The unknown whose column is missing.
    u : (N,) array
        Speeds of the rows, rad/s or m/s.
    Q, R : (N, k), (k, k) arrays

    """

    places: Array
    coulomb: int
    u: Array
    Q: Array
    R: Array

    def with_coulomb(self, speed: float, columns: int) -> Array:
        """Return R with a column of Coulomb friction, at the friction speed `speed`."""
        slip = coulomb(self.u, speed)
        along = np.zeros(self.Q.shape[1])
        for _ in range(2):  # twice: the second pass removes rounding errors
            share = self.Q.T @ slip
            slip -= self.Q @ share
            along += share
        full = np.zeros((len(along) + 1, columns))
        full[:-1, self.places] = self.R
        full[:-1, self.coulomb] = along
        full[-1, self.coulomb] = np.linalg.norm(slip)
        return full
