"""
The equations of a payload beside unknown friction and offsets, with correlated residuals.

The torque that a model of the arm leaves at joint j is

    left_j = Y_j x + offset_j + coulomb_j tanh(u_j / u_s) + damping_j u_j + e_j,

x the payload's ten parameters. The three further unknowns of a joint are what the
model's friction and the torque's zero may be wrong by; they have a standard deviation
each, and are eliminated joint by joint (Schur complement). Where the motion cannot
separate them from the payload, they widen its covariance.

More actuators than independent speeds may work against each other: only T_a^T times
their torques is known, with the rates T_a of the actuators per unit of each speed. The
rows are then L^-1 T_a^T times those above, as many as speeds, with L L^T = T_a^T Sigma
T_a, the covariance of their noise: white noise of the actuators is white in the rows.
Each row depends on the unknowns of all actuators, which are eliminated together.

The residual e_j is not white: friction, filters and elasticity correlate it. Its
variance counts as that of sums over blocks of 1, 2, 4, ... rows, divided by their
length: constant for white residuals, growing up to the correlation time for others
(Flyvbjerg & Petersen, J. Chem. Phys. 91 (1989)). Where it grows, the largest counts,
with an allowance for the few blocks it is of, and no joint's grows less than the joints'
do on average.
"""

from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.friction import coulomb
import numpy as np

LOAD, OWN = 10, 3  # unknowns of the payload, and of each joint: offset, Coulomb, damping
LEVELS = 11  # blocks of up to 1024 rows
FEWEST = 6.0  # blocks whose sums have a variance, beside those that the unknowns take
SURE = 2.0  # deviations of a variance: residuals correlate where it grows by more
WIDER = 4.0  # deviations by which the variance of correlated ones is taken larger than found
ROUNDS = 4  # of reweighting
ROUNDING = 1e-7  # of the RMS of a joint's torque: no residual is known to be smaller


class PayloadEquations:
    """
    Least-squares equations of a payload, accumulated row by row.

    The unknowns of the actuators are in groups of rows that depend on the same ones: one
    row for each actuator, or one group of all rows.

    Parameters
    ----------
    speeds : (m,) array
        Speed at which the friction of each actuator sets in, rad/s or m/s.
    uncertainty : (m,) array
        Standard deviation of what the model's friction and the torque's zero are wrong
        by, N m or N; of viscous friction, per rad/s or m/s.
    belief : (10, 10) array
        Inverse covariance of the payload's parameters before any row.
    least : float
        Least variance of a row that is divided by its own deviation; 1 where that one is
        the measurement's, 0 where it is not known.
    kept : float
        Factor by which each further row makes those before it count less.
    shared : int
        Number of independent speeds that the actuators, more than these, move together;
        0 for one row for each actuator.

    """

    def __init__(self, speeds: Array, uncertainty: Array, belief: Array,
                 least: float = 0.0,
                 kept: float = 1.0, shared: int = 0) -> None:
        """Start without rows."""
        self._speeds = speeds
        groups, rows = (1, shared) if shared else (len(speeds), 1)
        known = np.repeat(uncertainty**-2.0, OWN).reshape(groups, -1)
        self._uncertainty = known[:, :, None] * np.eye(known.shape[1])
        self._belief, self._least, self._kept = belief, least, kept
        size = LOAD + known.shape[1] + 1
        self._products = np.zeros((LEVELS, groups, rows, size, size))  # of sums over blocks
        self._counts = np.zeros(LEVELS)  # blocks
        self._pending: list[Array | None] = [None] * LEVELS
        self._variance = np.ones((groups, rows))

    def row(self, Y: Array, u: Array, left: Array, sigma: Array | float = 1.0,
            acting: Array | None = None) -> Array:
        """
        Return the equations of one sample, divided by deviations, (groups, rows, unknowns + 1).

        Parameters
        ----------
        Y, u, left : (m, 10), (m,), (m,) arrays
            As in `Rows`.
        sigma : float or (m,) array
            Deviations, N m or N.
        acting : (m, n) array, optional
            Rates of the actuators per unit of each speed, if these share the load.

        """
        # Friction of the joint itself: offset, Coulomb, viscous.
        own = np.stack([np.ones_like(u), coulomb(u, self._speeds), u], axis=1)
        deviations = np.broadcast_to(sigma, u.shape)[:, None]
        if acting is None:
            row = np.concatenate([Y, own, left[:, None]], axis=1)
            return np.asarray(row / deviations)[:, None]
        # Coupled joints: rows are whitened, so that the errors of all are independent.
        weighted = acting * deviations
        white = np.linalg.solve(np.linalg.cholesky(weighted.T @ weighted), acting.T)
        coupled = (white[:, :, None] * own).reshape(len(white), -1)
        return np.concatenate([white @ Y, coupled, (white @ left)[:, None]],
                              axis=1)[None]

    def add(self, row: Array) -> None:
        """Add the equations of one sample."""
        # Level k has sums of 2^k successive rows. Two of its blocks are one of the next
        # level; a first one waits for the second.
        block = row
        # Level k has sums of 2^k consecutive rows, which forget at the same pace in
        # time.
        for level in range(LEVELS):
            weight = self._kept**(2**level)
            self._products[level] *= weight
            self._products[level] += block[..., :, None] * block[..., None, :]
            self._counts[level] = weight * self._counts[level] + 1.0
            first_of_two = self._pending[level]
            # Two blocks of a level make one of the next; the first one waits.
            if first_of_two is None:
                self._pending[level] = block
                return
            self._pending[level] = None
            block = first_of_two + block

    def solve(self) -> tuple[Array, Array]:
        """
        Return the information of the rows about the payload, and their right-hand side.

        Returns
        -------
        information : (10, 10) array
            Inverse covariance by the rows alone, the joints' own unknowns eliminated.
        weighted : (10,) array
            The best fit x to the rows alone solves information @ x = weighted.

        """
        for _ in range(ROUNDS):
            information, weighted, own = self._reduced()
            x: Array = np.asarray(np.linalg.solve(information + self._belief, weighted))
            self._variance = self._residual_variance(x,
                                                     own[:, :, -1] - own[:, :, :-1] @ x)
        return self._reduced()[:2]

    def _reduced(self) -> tuple[Array, Array, Array]:
        """Return the results of `solve`, and the friction unknowns as functions of the payload."""
        G = (self._products[0] / self._variance[:, :, None, None]).sum(axis=1)
        x, own, others = slice(LOAD), slice(LOAD, -1), [*range(LOAD), -1]
        by_x = np.linalg.solve(G[:, own, own] + self._uncertainty,
                               G[:, own][:, :, others])
        reduced = (G[:, x][:, :, others] - G[:, x, own] @ by_x).sum(axis=0)
        return 0.5 * (reduced[:, :-1] + reduced[:, :-1].T), reduced[:, -1], by_x

    def _residual_variance(self, x: Array, own: Array) -> Array:
        """Return the variance of sums of residuals per row, the largest over blocks."""
        shape, rows = self._variance.shape, self._variance.size
        z = np.concatenate([np.tile(-x, (len(own), 1)), -own, np.ones((len(own), 1))],
                           axis=1)
        squares = np.einsum('ja,ljrab,jb->ljr', z, self._products, z).reshape(LEVELS,
                                                                              rows)
        free = self._counts - (own.size + LOAD) / rows
        enough = free > FEWEST
        total = self._products[0, ..., -1, -1].ravel() / max(self._counts[0], 1.0)
        rounding = np.maximum(ROUNDING**2 * total, 1e-18)
        least = np.maximum(self._least, rounding)
        variance = squares[enough] / (free * 2.0**np.arange(LEVELS))[enough, None]
        variance = np.maximum(variance, rounding)  # exact samples leave rounding, of any growth
        if len(variance) > 1:
            unsure = np.sqrt(2.0 / free[enough, None])[1:]
            # What blocks beyond the correlation time miss of the limit goes by 1 /
            # length.
            limit = np.maximum(variance[1:], 2.0 * variance[1:] - variance[:-1])
            limit *= 1.0 + WIDER * unsure
            correlated = variance[1:] > (1.0 + SURE * unsure) * variance[0]
            # The few blocks of one joint may happen to be small: all joints' mean counts
            # too.
            growth = np.where(correlated, limit, variance[0]).max(axis=0) / variance[0]
            variance = variance[:1] * np.maximum(growth, growth.mean())
        return np.asarray(np.maximum(variance.max(axis=0, initial=0.0),
                                     least).reshape(shape))
