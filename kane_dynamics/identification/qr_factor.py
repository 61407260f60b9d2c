"""One joint's equations factorized once, for any speed at which Coulomb friction sets in."""

from dataclasses import dataclass

from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.friction import coulomb
import numpy as np


@dataclass(frozen=True, eq=False)
class Factor:
    """
    Q R of one joint's equations but for the column of Coulomb friction.

    Attributes
    ----------
    places : (k,) array of int
        Which unknowns the columns of R belong to; the torque counts as the last.
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
        """Return R of all columns, that of Coulomb friction at `speed` put in its place."""
        slip = coulomb(self.u, speed)
        along = np.zeros(self.Q.shape[1])
        for _ in range(2):  # the second time takes away the rounding of the first
            share = self.Q.T @ slip
            slip -= self.Q @ share
            along += share
        full = np.zeros((len(along) + 1, columns))
        full[:-1, self.places] = self.R
        full[:-1, self.coulomb] = along
        full[-1, self.coulomb] = np.linalg.norm(slip)
        return full
