"""Online payload estimation: recursive least squares with standard deviations."""

from collections.abc import Sequence

from kane_dynamics._util.checks import number
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.identification.payload.payload_equations import PayloadEquations
from kane_dynamics.identification.payload.payload_fit import (covariance_of, load_deviations,
                                                              PayloadRegressor)
from kane_dynamics.mechanics.friction import coulomb
from kane_dynamics.model.model import Model
from kane_dynamics.native.runtime.argument import Argument, checked
import numpy as np
from numpy.typing import ArrayLike

DOUBT = 10.0  # of friction and offset that the model does not know, in deviations of torque
LARGEST = 1e100  # whose products over blocks do not overflow


class PayloadEstimator:
    """
    Mass and center of mass of a payload while the arm moves, by recursive least squares.

    It holds the normal equations of all samples, each forgotten with a time constant, so that a
    payload that is put down is noticed. The model error of each joint may include an offset,
    Coulomb friction and viscous friction of ten times `sigma`. The standard deviations include
    these, and the size and correlation of the residuals if they are larger than `sigma` (see
    `payload_equations`).

    Parameters
    ----------
    model : Model
        Of the arm alone, friction included.
    frame : str
        In whose axes the payload is described.
    sigma : (n,) sequence of float
        Standard deviations of measured torque, N m or N; larger residuals count as they are.
    memory : float
        Time constant of forgetting, in samples.

    Raises
    ------
    InputError
        No such frame, or a number is out of range.

    """

    def __init__(self, model: Model, frame: str, sigma: Sequence[float] | Array,
                 memory: float = 5000.0) -> None:
        """Start with zero mass and a weak prior."""
        self._regressor = PayloadRegressor(model, frame)
        try:
            self._sigma = np.array(sigma, dtype=np.float64)
        except (TypeError, ValueError):
            self._sigma = np.empty(0)
        if self._sigma.shape != (model.n,) or not (self._sigma > 0.0).all():
            raise InputError(f'sigma: {sigma!r}; expected {model.n} positive numbers')
        self._arguments = [Argument(name, (model.n,), model.joint_names)
                           for name in ('q', 'u', 'udot', 'tau')]
        memory = number(memory, 'memory', 'more than 1 sample', lambda x: x > 1.0)
        self._kept = 1.0 - 1.0 / memory
        joints = model.coordinate_joints
        self._friction, self._friction_speed = (
            np.array([getattr(joint, name) for joint in joints])
            for name in ('friction', 'friction_speed'))
        # Deviations of the belief: 10 kg, 1 kg m, 0.3 kg m^2.
        self._belief = np.diag(np.repeat([10.0, 1.0, 0.3], [1, 3, 6])**-2.0)
        # A joint at rest may be held by any torque up to its friction.
        self._doubt = np.hypot(DOUBT * self._sigma, self._friction)
        self._model = model
        self.reset()

    def reset(self) -> None:
        """Forget all samples."""
        self._equations = PayloadEquations(self._model, self._doubt, self._belief, 1.0,
                                           self._kept)
        self._solved: tuple[Array, Array] | None = None

    @property
    def gravity(self) -> Array:
        """Return gravity in world axes, (3,), m/s^2; it may be set for further samples."""
        return self._regressor.robot.parameters.gravity

    @gravity.setter
    def gravity(self, value: ArrayLike) -> None:
        self._regressor.robot.parameters.gravity = value

    def update(self, q: ArrayLike, u: ArrayLike, udot: ArrayLike, tau: ArrayLike) -> None:
        """
        Update the estimate with one sample, (n,) each; rad or m, s, N m or N.

        Raises
        ------
        InputError
            A shape is another, or a number not finite or too large; the estimate is as before.

        """
        state = [checked(argument, value) for argument, value in zip(
            self._arguments, (q, u, udot, tau), strict=True)]
        for argument, value in zip(self._arguments, state, strict=True):
            if value.ndim != 1:
                raise InputError(f'{argument.name}: shape {value.shape}; expected one sample, '
                                 f'{argument.shape}')
        # A joint at rest may hold by friction what the model says it must hold by torque.
        slip = np.abs(coulomb(state[1], self._friction_speed))
        sigma = self._sigma + (1.0 - slip) * self._friction
        known = self._regressor.robot.inverse_dynamics(*state[:3])
        with np.errstate(over='ignore', invalid='ignore'):  # asked for below
            row = self._equations.row(self._regressor(*state[:3]), state[1], state[3] - known,
                                      sigma)
        if not (np.abs(row) < LARGEST).all():
            raise InputError(f'tau: {state[3].tolist()}; expected torques and a motion in a '
                             'physical range')
        self._equations.add(row)
        self._solved = None

    @property
    def mass(self) -> float:
        """Return the mass, kg; noise may make a very small one negative."""
        return float(self._parameters[0])

    @property
    def com(self) -> Array:
        """Return the center of mass in the frame's axes, (3,), m; NaN without a clear mass."""
        x = self._parameters
        return np.asarray(x[1:4] / x[0]) if x[0] > 3.0 * self.mass_deviation else np.full(
            3, np.nan)

    @property
    def mass_deviation(self) -> float:
        """Return the standard deviation of the mass, kg."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def com_deviation(self) -> Array:
        """Return the standard deviation of the center of mass, (3,), m; NaN as `com`."""
        x = self._parameters
        return load_deviations(x, self.covariance)[1] if x[0] > 3.0 * self.mass_deviation else (
            np.full(3, np.nan))

    @property
    def covariance(self) -> Array:
        """Return the covariance of mass, first moments and inertia about the origin, (10, 10)."""
        return self._solution[1]

    @property
    def _parameters(self) -> Array:
        return self._solution[0]

    @property
    def _solution(self) -> tuple[Array, Array]:
        """Return the parameters and their covariance."""
        if self._solved is None:
            information, weighted = self._equations.solve()
            information = information + self._belief
            x: Array = np.asarray(np.linalg.solve(information, weighted))
            self._solved = x, covariance_of(information)
        return self._solved
