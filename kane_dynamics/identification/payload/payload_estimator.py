"""What an arm carries, while it moves."""

from collections.abc import Sequence

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.identification.payload.payload_fit import (covariance_of, load_deviations,
                                                              PayloadRegressor)
from kane_dynamics.mechanics.friction import coulomb
from kane_dynamics.model.model import Model
from kane_dynamics.native.runtime.argument import Argument, checked
import numpy as np
from numpy.typing import ArrayLike


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
        self._arguments = [Argument(name, (model.n,), model.joint_names)
                           for name in ('q', 'u', 'udot', 'tau')]
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
        self._regressor.robot.parameters.gravity = value

    def update(self, q: ArrayLike, u: ArrayLike, udot: ArrayLike, tau: ArrayLike) -> None:
        """
        Take one sample, (n,) each; rad or m, s, N m or N.

        Raises
        ------
        InputError
            A shape is another, or a number not finite or too large; the estimate is as before.

        """
        state = [checked(argument, value) for argument, value in zip(
            self._arguments, (q, u, udot, tau), strict=True)]
        for argument, value in zip(self._arguments, state, strict=True):
            if value.ndim != 1:
                raise InputError(f'{argument.name} has shape {value.shape}; expected one sample, '
                                 f'{argument.shape}')
        # A joint at rest may hold by friction what the model says it must hold by torque.
        slip = np.abs(coulomb(state[1], self._friction_speed))
        sigma = self._sigma + (1.0 - slip) * self._friction
        Y = self._regressor(*state[:3]) / sigma[:, None]
        known = self._regressor.robot.inverse_dynamics(*state[:3])
        with np.errstate(over='ignore', invalid='ignore'):  # asked for below
            left = (state[3] - known) / sigma
            information = self._kept * self._information + Y.T @ Y
            weighted = self._kept * self._weighted + Y.T @ left
        if not (np.isfinite(information).all() and np.isfinite(weighted).all()):
            raise InputError(f'tau is {state[3].tolist()}; too large together with the motion')
        self._information, self._weighted = information, weighted

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
        return load_deviations(x, self.covariance)[1] if x[0] > 3.0 * self.mass_deviation else (
            np.full(3, np.nan))

    @property
    def covariance(self) -> Array:
        """Return the covariance of mass, first moments and inertia about the origin, (10, 10)."""
        return covariance_of(self._information + self._belief)

    @property
    def _parameters(self) -> Array:
        return np.asarray(np.linalg.solve(self._information + self._belief, self._weighted))
