"""What an arm carries: from a recording, or while it moves."""

from collections.abc import Sequence
from dataclasses import dataclass

from kane_dynamics.errors import InputError
from kane_dynamics.identification.physical import (parameters_of, physical, prior_metric,
                                                   pseudo_inertia_of)
from kane_dynamics.identification.recording import Recording
from kane_dynamics.mechanics.regressor import ENTRIES
from kane_dynamics.model import Array, Frame, Inertial, Model, WORLD
from kane_dynamics.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

# A ball of 1 kg around the frame: where the search starts, and what is hardly believed.
START = Inertial(1.0, np.zeros(3), 0.01 * np.eye(3))
BELIEF = 1e-3


@dataclass(frozen=True, eq=False)
class Payload:
    """
    An estimated payload.

    Attributes
    ----------
    inertial : Inertial
        In the axes of the payload's frame; physical.
    mass_deviation : float
        Standard deviation of the mass, kg, if the rows' residuals are independent.
    com_deviation : (3,) array
        Of the mass centre, m.
    inertia_deviation : (3, 3) array
        Of the inertia about it, kg m^2.
    residual : (n,) array
        RMS of the torque that it leaves unexplained, N m or N.
    held_out : (n,) array
        RMS of what a payload fitted to the first half of the rows leaves of the second half.
    condition : float
        Condition number of the weighted equations, columns scaled to unit length; infinite if the
        motion does not tell all ten parameters.

    """

    inertial: Inertial
    mass_deviation: float
    com_deviation: Array
    inertia_deviation: Array
    residual: Array
    held_out: Array
    condition: float


class PayloadRegressor:
    """
    The torque of a payload as a linear function of its ten parameters.

    Parameters
    ----------
    model : Model
        Without the payload; its friction counts as known.
    frame : str
        In whose axes the payload is described, about whose origin.

    Raises
    ------
    InputError
        There is no such frame, or no joint moves it.

    """

    def __init__(self, model: Model, frame: str) -> None:
        """Find the body that carries the frame."""
        where: Frame = model.frame(frame)
        if where.body == WORLD:
            raise InputError(f"frame '{frame}' is fixed in the world; a payload needs one that "
                             'joints move')
        self.robot = Robot(model)
        self._columns = slice(10 * where.body, 10 * where.body + 10)
        T = np.block([[where.rotation, where.translation[:, None]], [np.zeros(3), np.ones(1)]])
        self._to_body = np.column_stack([
            parameters_of(T @ pseudo_inertia_of(unit) @ T.T) for unit in np.eye(10)])

    def __call__(self, q: ArrayLike, u: ArrayLike, udot: ArrayLike) -> Array:
        """Return Y, (n, 10) or (N, n, 10): the payload's torque is Y times its parameters."""
        Y = self.robot.regressor(q, u, udot)
        return np.asarray(Y[..., self._columns] @ self._to_body)


def identify_payload(model: Model, recording: Recording, frame: str) -> Payload:
    """
    Return the payload that explains what the model leaves of measured torques.

    Parameters
    ----------
    model : Model
        Of the arm alone, friction included.
    recording : Recording
        Of the arm with the payload.
    frame : str
        In whose axes the payload is described.

    Raises
    ------
    InputError
        No such frame, or the recording is not of the model's joints.

    """
    if recording.tau.shape[1] != model.n:
        raise InputError(f'the recording is of {recording.tau.shape[1]} joints, the model has '
                         f'{model.n}: {", ".join(model.joint_names)}')
    regressor = PayloadRegressor(model, frame)
    state = recording.q, recording.u, recording.udot
    Y = regressor(*state)
    left = recording.tau - regressor.robot.inverse_dynamics(*state)
    x, sigma = _fitted(Y, left)
    middle = len(left) // 2
    early, _ = _fitted(Y[:middle], left[:middle])
    A = (Y / sigma[:, None]).reshape(-1, 10)
    # The belief keeps what the motion does not tell from looking certain.
    covariance = _covariance(A.T @ A + BELIEF * prior_metric(START))
    mass, com = _deviations(x, covariance)
    lengths = np.linalg.norm(A, axis=0)
    condition = float(np.linalg.cond(A / lengths)) if lengths.all() else np.inf
    return Payload(Inertial.from_pseudo_inertia(pseudo_inertia_of(x)), mass, com,
                   _inertia_deviation(x, covariance), sigma,
                   _rms(left[middle:] - Y[middle:] @ early), condition)


def _fitted(Y: Array, left: Array) -> tuple[Array, Array]:
    """Return the physical parameters that fit torques, (10,), and the RMS of what they leave."""
    sigma = np.ones(left.shape[1])
    for _ in range(4):
        A = (Y / sigma[:, None]).reshape(-1, 10)
        x = physical(A, (left / sigma).reshape(-1), [START], 0, BELIEF)
        sigma = np.maximum(_rms(left - Y @ x), 1e-9)
    return x, sigma


def _rms(error: Array) -> Array:
    """Return the root of the mean square of each column."""
    return np.asarray(np.sqrt(np.mean(error**2, axis=0)))


class PayloadEstimator:
    """
    Mass and mass centre of a payload while the arm moves, by recursive least squares.

    It holds the normal equations of all samples, each forgotten with a time constant, so that a
    payload that is put down is noticed.

    Parameters
    ----------
    model : Model
        Of the arm alone, friction included.
    frame : str
        In whose axes the payload is described.
    sigma : (n,) sequence of float
        Standard deviations of measured torque, N m or N.
    memory : float
        Time constant of forgetting, in samples.

    Raises
    ------
    InputError
        No such frame, or a number is out of range.

    """

    def __init__(self, model: Model, frame: str, sigma: Sequence[float] | Array,
                 memory: float = 5000.0) -> None:
        """Start from no payload, hardly believed."""
        self._regressor = PayloadRegressor(model, frame)
        self._sigma = np.asarray(sigma, dtype=np.float64)
        if self._sigma.shape != (model.n,) or not (self._sigma > 0.0).all():
            raise InputError(f'sigma is {sigma!r}; expected {model.n} positive numbers')
        if not memory > 1.0:
            raise InputError(f'memory is {memory:g}; expected more than 1 sample')
        self._kept = 1.0 - 1.0 / memory
        joints = model.coordinate_joints
        self._friction, self._friction_speed = (
            np.array([getattr(joint, name) for joint in joints])
            for name in ('friction', 'friction_speed'))
        # Deviations of the belief: 10 kg, 1 kg m, 0.3 kg m^2.
        self._belief = np.diag(np.repeat([10.0, 1.0, 0.3], [1, 3, 6])**-2.0)
        self.reset()

    def reset(self) -> None:
        """Forget all samples."""
        self._information = np.zeros((10, 10))
        self._weighted = np.zeros(10)

    @property
    def gravity(self) -> Array:
        """Return gravity in world axes, (3,), m/s^2; it may be set, for the samples to come."""
        return self._regressor.robot.parameters.gravity

    @gravity.setter
    def gravity(self, value: ArrayLike) -> None:
        self._regressor.robot.parameters.gravity = np.asarray(value, dtype=np.float64)

    def update(self, q: ArrayLike, u: ArrayLike, udot: ArrayLike, tau: ArrayLike) -> None:
        """Take one sample, (n,) each; rad or m, s, N m or N."""
        # A joint at rest may hold by friction what the model says it must hold by torque.
        slip = np.abs(np.tanh(np.asarray(u) / self._friction_speed))
        sigma = self._sigma + (1.0 - slip) * self._friction
        Y = self._regressor(q, u, udot) / sigma[:, None]
        left = (np.asarray(tau) - self._regressor.robot.inverse_dynamics(q, u, udot)) / sigma
        self._information = self._kept * self._information + Y.T @ Y
        self._weighted = self._kept * self._weighted + Y.T @ left

    @property
    def mass(self) -> float:
        """Return the mass, kg; noise may make a very small one negative."""
        return float(self._parameters[0])

    @property
    def com(self) -> Array:
        """Return the mass centre in the frame's axes, (3,), m; NaN while the mass is not known."""
        x = self._parameters
        return np.asarray(x[1:4] / x[0]) if x[0] > 3.0 * self.mass_deviation else np.full(
            3, np.nan)

    @property
    def mass_deviation(self) -> float:
        """Return the standard deviation of the mass, kg: the confidence in it."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def com_deviation(self) -> Array:
        """Return the standard deviation of the mass centre, (3,), m; NaN as `com`."""
        x = self._parameters
        return _deviations(x, self.covariance)[1] if x[0] > 3.0 * self.mass_deviation else (
            np.full(3, np.nan))

    @property
    def covariance(self) -> Array:
        """Return the covariance of mass, first moments and inertia about the origin, (10, 10)."""
        return _covariance(self._information + self._belief)

    @property
    def _parameters(self) -> Array:
        return np.asarray(np.linalg.solve(self._information + self._belief, self._weighted))


def _covariance(information: Array) -> Array:
    """Return the inverse of an information matrix, scaled for accuracy."""
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    return np.asarray(np.linalg.pinv(information / np.outer(scale, scale))
                      / np.outer(scale, scale))


def _deviations(x: Array, covariance: Array) -> tuple[float, Array]:
    """Return standard deviations of mass and mass centre, by the latter's linearization."""
    slope = np.column_stack([-x[1:4] / x[0]**2, np.eye(3) / x[0]])
    return (float(np.sqrt(covariance[0, 0])),
            np.sqrt(np.diag(slope @ covariance[:4, :4] @ slope.T)))


def _inertia_deviation(x: Array, covariance: Array) -> Array:
    """Return standard deviations of the inertia about the mass centre, (3, 3), likewise."""
    mass, h, one = x[0], x[1:4], np.eye(3)
    slopes = [(h @ h * one - np.outer(h, h)) / mass**2]
    slopes += [(np.outer(e, h) + np.outer(h, e) - 2.0 * (e @ h) * one) / mass for e in one]
    for r, s in ENTRIES:
        unit = np.zeros((3, 3))
        unit[r, s] = unit[s, r] = 1.0
        slopes.append(unit)
    J = np.array(slopes)
    return np.asarray(np.sqrt(np.einsum('irs,ij,jrs->rs', J, covariance, J)))
