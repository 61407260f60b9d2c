"""
Cost of a rest-to-rest motion for identification: condition number and exceeded limits.

With W the weighted equations of the base parameters, S = W^T W, and Z the same of W's
columns scaled to unit length, b of them, the worth of a motion is judged by

    - 1/(2 b) log det S + 1/2 log(b trace Z^-1).

The first term is the mean logarithm of the parameters' standard deviations, the second
the logarithm of the condition number of the scaled equations in the Frobenius norm,
which is smooth and not below the usual one. (Swevers et al., IEEE T-RA 13 (1997), for
the determinant; Gautier & Khalil, IJRR 11 (1992), for the condition number.) Its
gradient with respect to the entries of W has a closed form. The derivatives of W with
respect to the states of a sample are differences of the compiled regressor, and the
states are linear in the coefficients.
"""

import math

from kane_dynamics._util.checks import limit_per_joint
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.identification.base_regressor import base_parameters
from kane_dynamics.identification.excitation.clearance import Clearance
from kane_dynamics.identification.excitation.fourier_basis import FourierBasis
from kane_dynamics.identification.regression import FRICTION, without_losses
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.mechanics.friction import coulomb
from kane_dynamics.model.elastic_model import require_rigid_joints
from kane_dynamics.model.model import Model
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

SAMPLES = 16  # of a period, times its harmonics, while searching
FINER = 40  # likewise, of the distances between links, which narrow for short times
DENSE = 200  # likewise, when limits are checked
# Between samples a sum of sines rises above the largest by no more (Ehlich & Zeller,
# Math. Z. 86 (1964)).
BETWEEN = 1.0 / math.cos(math.pi / DENSE)
STEP = 1e-6  # of the differences
GUARD = 0.98  # of the share of limits that the search aims at


class DesignCriterion:
    """
    The cost of a motion and its use of limits, by its coefficients (size, n).

    Parameters
    ----------
    model, share, velocity, acceleration
        As in `excite`.
    basis : FourierBasis
        Of the motion.
    clearance : Clearance, optional
        Of the arm's shapes.

    """

    def __init__(self, model: Model, basis: FourierBasis, share: float,
                 velocity: ArrayLike, acceleration: ArrayLike,
                 clearance: Clearance | None = None) -> None:
        """Store the limits, and sample the Fourier basis."""
        require_angles(model, 'excitation')
        require_rigid_joints(model)
        self.model = model
        self.basis = basis
        self.share = share
        self.robot = Robot(model)
        self.rigid = Robot(without_losses(model))

        # Limits of speed: the stricter of the robot's and the stated one; a design needs
        # a finite one.
        names = model.joint_names
        limits = self.robot.limits
        stated = limit_per_joint(velocity, 'velocity', names)
        self.velocity = np.minimum(limits.velocity, stated)
        self.acceleration = limit_per_joint(acceleration, 'acceleration', names)
        for name, speed, acceleration_limit in zip(names, self.velocity,
                                                   self.acceleration, strict=True):
            if not 0.0 < speed < math.inf or acceleration_limit == 0.0:
                raise InputError(f"joint '{name}': limits {speed} of speed and "
                                 f'{acceleration_limit} of acceleration; expected '
                                 'positive ones, and a finite speed (velocity=)')
        self.effort = limits.effort
        # A joint that is bounded on one side gets a turn from there.
        lower = np.where(np.isfinite(limits.lower), limits.lower,
                         limits.upper - 2.0 * math.pi)
        upper = np.where(np.isfinite(limits.upper), limits.upper,
                         limits.lower + 2.0 * math.pi)
        free = ~np.isfinite(lower)
        lower = np.where(free, 0.0, lower)
        self.middle = np.where(free, 0.0, 0.5 * (lower + upper))
        self.reach = np.where(free, math.inf, 0.5 * (upper - lower))

        # The base parameters, and the torques by which residuals are weighted.
        self.speeds = np.array([joint.friction_speed for joint in model.coordinate_joints])
        self.columns = base_parameters(model, self.speeds).columns
        self.sigma = np.where(np.isfinite(self.effort), self.effort, 1.0)
        # Samples for the search, denser ones for the check, and the finest for extremes.
        self.clearance = clearance
        self.grid = self._matrices(SAMPLES)
        self.dense = self._matrices(DENSE)
        self.finer = self._matrices(FINER)[0]

    def _matrices(self, density: int) -> tuple[Array, Array, Array]:
        count = density * self.basis.harmonics
        return self.basis.at(np.arange(float(count)) * (self.basis.period / count))

    def regressor(self, q: Array, u: Array, udot: Array) -> Array:
        """Return W of states (N, n): the weighted equations of the base parameters, (N, n, b)."""
        n = self.model.n
        # Columns of bodies from the regressor, then those of friction and rotors.
        inertial = 10 * len(self.model.bodies)
        whole = self.columns[self.columns < inertial]
        W = np.zeros((len(q), n, len(self.columns)))
        W[:, :, :len(whole)] = self.rigid.regressor(q, u, udot)[:, :, whole]
        losses = np.stack([u, coulomb(u, self.speeds), udot, np.ones_like(u)], axis=2)
        for column in range(len(whole), len(self.columns)):
            j, kind = divmod(int(self.columns[column]) - inertial, len(FRICTION))
            W[:, j, column] = losses[:, j, kind]
        # Equations of all joints with the same noise.
        return W / self.sigma[:, None]

    def condition(self, p: Array) -> float:
        """Return the condition number, columns scaled to unit length."""
        W = self.regressor(*(matrix @ p for matrix in self.grid))
        W = W.reshape(-1, W.shape[2])
        return float(np.linalg.cond(W / np.linalg.norm(W, axis=0)))

    def cost(self, p: Array, weight: float) -> tuple[float, Array]:
        """Return `worth` plus weighted squared excesses over limits, and the gradient."""
        states = np.stack([matrix @ p for matrix in self.grid])  # q, u, udot
        W = self.regressor(*states)
        value, G = worth(W)
        if math.isinf(value):
            return value, np.zeros_like(p)
        excess = self._excess(*states)
        penalty = float(excess.mean())
        # Differences along every component of q, u and udot: all 3 n displaced motions are
        # computed at once.
        n = self.model.n
        component = np.arange(3 * n)
        part, joint = np.divmod(component, n)
        displaced = np.repeat(states[:, None], 3 * n, axis=1)
        displaced[part, component, :, joint] += STEP
        displaced = displaced.reshape(3, -1, n)
        change = self.regressor(*displaced).reshape(3 * n, *W.shape) - W
        slopes = np.einsum('msjc,sjc->ms', change, G)
        of_excess = self._excess(*displaced).reshape(3 * n, -1) - excess
        slopes += weight / len(excess) * of_excess
        gradient = np.zeros_like(p)
        for matrix, slope in zip(self.grid, slopes.reshape(3, n, -1) / STEP, strict=True):
            gradient += matrix.T @ slope.T
        if self.clearance is not None:
            q = self.finer @ p
            penalty += float(self.clearance.shortfall(q).mean())
            by_q = self.clearance.shortfall_slope(q) / len(q)
            gradient += weight * (self.finer.T @ by_q)
        return value + weight * penalty, gradient

    def _excess(self, q: Array, u: Array, udot: Array) -> Array:
        """Return the squared excess of each sample beyond the share of limits, (N,)."""
        excess = np.zeros(len(q))
        for use in self._uses(q, u, udot).values():
            beyond = np.maximum(np.abs(use) - GUARD * self.share, 0.0)
            excess += np.sum(beyond**2, axis=1)
        return excess

    def _uses(self, q: Array, u: Array, udot: Array) -> dict[str, Array]:
        """Return each quantity relative to its limit, (N, n) arrays."""
        return {'position': (q - self.middle) / self.reach,
                'velocity': u / self.velocity,
                'acceleration': udot / self.acceleration,
                'effort': self.robot.inverse_dynamics(q, u, udot) / self.effort}

    def broken(self, p: Array) -> str | None:
        """Describe the limit that a motion exceeds; return None if it satisfies all."""
        for name, use in self.uses(p).items():
            j = int(use.argmax())
            if use[j] > self.share:
                return f"the {name} limit of joint '{self.model.joint_names[j]}'"
        return None if self.clearance is None else self.clearance.broken(self.dense[0] @ p)

    def uses(self, p: Array) -> dict[str, Array]:
        """Return the largest share of each limit that a motion uses at any time, (n,) arrays."""
        largest = {}
        for name, use in self._uses(*(matrix @ p for matrix in self.dense)).items():
            largest[name] = BETWEEN * np.abs(use).max(axis=0)
        return largest


def worth(W: Array) -> tuple[float, Array]:
    """Return the cost of equations (N, n, b), infinite if they are singular, and its gradient."""
    norms = np.linalg.norm(W, axis=(0, 1))
    if not norms.all():
        return math.inf, np.zeros_like(W)
    # Products sample by sample: a BLAS would share large ones among threads that wait
    # longer for each other on a busy machine than they work.
    scaled, size = W / norms, len(norms)
    try:
        L = np.linalg.cholesky(np.matmul(scaled.transpose(0, 2, 1), scaled).sum(axis=0))
    except np.linalg.LinAlgError:
        return math.inf, np.zeros_like(W)
    inverse = np.linalg.inv(L)
    inverse = inverse.T @ inverse
    trace = float(np.trace(inverse))
    by_scaled = scaled @ (inverse @ inverse / -trace)
    by_scaled -= scaled * np.sum(scaled * by_scaled, axis=(0, 1))  # lengths do not count here
    slope = (by_scaled - scaled @ (inverse / size)) / norms
    value = 0.5 * math.log(trace * size) - float(np.log(np.diag(L) * norms).sum()) / size
    return value, slope
