"""Online payload estimation: recursive least squares with standard deviations."""

from collections.abc import Sequence

from kane_dynamics._util.checks import constant, number, real_numbers
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.identification.payload.payload_equations import PayloadEquations
from kane_dynamics.identification.payload.payload_fit import load_deviations, with_belief
from kane_dynamics.identification.payload.payload_rows import PayloadRows
from kane_dynamics.model.model import Model
from kane_dynamics.native.runtime.kernel import Argument, checked
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

SMALLEST = 1e-12  # standard deviation of a torque, N m or N
DOUBT = 10.0  # of friction and offset that the model does not know, in deviations of torque
LARGEST = 1e100  # whose products over blocks do not overflow


class PayloadEstimator:
    """
    Mass and center of mass of a payload while the arm moves, by recursive least squares.

    It holds the normal equations of all samples, each forgotten with a time constant, so
    that a payload that is put down is noticed. The model error of each joint may include
    an offset, Coulomb friction and viscous friction of ten times `sigma`. The standard
    deviations include these, and the size and correlation of the residuals if they are
    larger than `sigma` (see `payload_equations`).

    Parameters
    ----------
    model : Model or Robot
        Of the arm alone, friction included. A robot has its own speeds and constraints;
        its payload is left out.
    frame : str
        In whose axes the payload is described.
    sigma : (m,) sequence of float
        Standard deviations of measured torque, N m or N; larger residuals count as they
        are. Of the joints; with chosen speeds or constraints of the joints of
        `Robot(actuated=)`, in the order of `Robot.actuated_names`, which may be more
        than the independent speeds, or else of the generalized forces of the speeds.
    memory : float
        Time constant of forgetting, in samples.

    Raises
    ------
    InputError
        No such frame, or a number is out of range.

    """

    def __init__(self, model: Model | Robot, frame: str, sigma: Sequence[float] | Array,
                 memory: float = 5000.0) -> None:
        """Start with zero mass and a weak prior."""
        self._rows = PayloadRows(model, frame)
        robot, n, count = self._rows.robot, self._rows.robot.n, len(self._rows.names)
        try:
            self._sigma = np.array(real_numbers(sigma))
        except (TypeError, ValueError):
            self._sigma = np.empty(0)
        if self._sigma.shape != (count,) or not (
                (self._sigma >= SMALLEST) & (self._sigma < np.inf)).all():
            raise InputError(f'sigma: {sigma!r}; expected {count} numbers of at least '
                             f'{SMALLEST:g}, of {", ".join(self._rows.names)}')
        self._arguments = [Argument('q', (robot.n_q,), robot.coordinate_names)]
        for name in ('u', 'udot', 'tau'):
            self._arguments.append(Argument(name, (n,), robot.speed_names))
        memory = number(memory, 'memory', 'more than 1 sample', lambda x: x > 1.0)
        self._kept = 1.0 - 1.0 / memory
        # Deviations of the belief: 10 kg, 1 kg m, 0.3 kg m^2.
        self._belief = np.diag(np.repeat([10.0, 1.0, 0.3], [1, 3, 6])**-2.0)
        # A joint at rest may be held by any torque up to its friction.
        self._doubt = np.hypot(DOUBT * self._sigma, self._rows.friction)
        self.reset()

    def reset(self) -> None:
        """Forget all samples."""
        self._equations = PayloadEquations(self._rows.friction_speed, self._doubt,
                                           self._belief, 1.0, self._kept,
                                           self._rows.shared)
        self._solved: tuple[Array, Array] | None = None

    def compile(self) -> None:  # noqa: A003
        """Compile the kernels now instead of at the first sample."""
        self._rows.compile()

    @property
    def gravity(self) -> Array:
        """Return gravity in world axes, (3,), m/s^2; it may be set for further samples."""
        return self._rows.robot.parameters.gravity

    @gravity.setter
    def gravity(self, value: ArrayLike) -> None:
        self._rows.robot.parameters.gravity = value

    def update(self, q: ArrayLike, u: ArrayLike, udot: ArrayLike, tau: ArrayLike, *,
               t: float = 0.0) -> None:
        """
        Update the estimate with one sample.

        Parameters
        ----------
        q, u, udot : (n_q,), (n,), (n,) array_like
            Measured positions, (independent) speeds and their rates; rad or m, s.
        tau : (n,) array_like
            Measured torques, N m or N. With chosen speeds or constraints they are dual
            to u, as `Robot.generalized_force` of joint torques.
        t : float
            Time, s, for functions of time.

        Raises
        ------
        InputError
            A shape is another, or a number not finite or too large; the estimate is as
            before.
        ConstraintError
            The constraints are not met, or the actuated joints do not determine the
            motion there; the estimate is as before.

        """
        state = []
        for argument, stated in zip(self._arguments, (q, u, udot, tau), strict=True):
            value = checked(argument, stated)
            if value.ndim != 1:
                raise InputError(f'{argument.name}: shape {value.shape}; expected one '
                                 f'sample, {argument.shape}')
            state.append(value)
        time = constant(t, (), 't (s)', InputError)
        with np.errstate(over='ignore', invalid='ignore'):  # asked for below
            Y, rates, left, held, acting = self._rows(state[0], state[1], state[2],
                                                      state[3], time)
            # A joint at rest may hold by friction what the model says it must hold by
            # torque.
            row = self._equations.row(Y, rates, left, self._sigma + held, acting)
        if not (np.abs(row) < LARGEST).all():
            raise InputError(f'tau: {state[3].tolist()}; expected torques and a motion '
                             'in a physical range')
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
        return load_deviations(x,
                               self.covariance)[1] if x[0] > 3.0 * self.mass_deviation else (
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
            self._solved = with_belief(*self._equations.solve(), self._belief,
                                       np.zeros(len(self._belief)))
        return self._solved
