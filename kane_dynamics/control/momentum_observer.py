"""
Momentum observer: external joint torques from motion and actuation.

``p = M u`` obeys ``p' = tau + external - beta`` with ``beta = bias - (C + C^T) u``, so that no
acceleration is needed. The residual ``r = K (p - p(0) - integral(tau - beta + r) dt)`` is then
the external torque behind a first-order low-pass, ``r' = K (external - r)``. Source: A. De Luca,
R. Mattone, "Sensorless robot collision detection and hybrid force/motion control", ICRA 2005.
"""

import math

from kane_dynamics._util.attribute_hints import guarded
from kane_dynamics._util.checks import per_joint
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

OBSERVED = ('mass_matrix', 'bias_force', 'coriolis_matrix')  # quantities that it evaluates


@guarded
class MomentumObserver:
    """
    Estimator of the external joint torques.

    The residual is advanced from sample to sample by its exact solution for a constant external
    torque, ``r = a r + (1 - a) (dp/dt - mean(tau) + mean(beta))`` with ``a = exp(-K dt)``, which
    is stable for every step and does not drift. Its time constant is 1/K: the estimate of a
    constant torque reaches 63 % after 1/K and 95 % after 3/K. Model errors count as external
    torque: unmodelled friction, and static friction at rest.

    Parameters
    ----------
    robot : Robot
        With joint rates for speeds and without constraints. Its `parameters` are read at each
        sample; call `refresh` when they have changed.
    gain : float or (n,) array_like
        K, 1/s, positive.
    max_gap : float
        Longest time between two samples, s; after a longer one the observer restarts.
    held : bool
        False if `tau` is a torque measured together with the state, True if it is a command that
        acts from this sample to the next.

    Attributes
    ----------
    torque : (n,) array
        The estimate at the last sample, N m or N, with ``M udot + bias = tau + torque``. Zero
        after a reset.

    Raises
    ------
    InputError
        The robot has chosen speeds or constraints, or a number is invalid; names it.

    """

    def __init__(self, robot: Robot, *, gain: ArrayLike = 50.0, max_gap: float = 0.1,
                 held: bool = False) -> None:
        """Compile the kernels; the estimate starts at zero with the first sample."""
        if isinstance(robot.equations, ConstrainedEquations):
            raise InputError('robot: chosen speeds or constraints; expected a robot in joint '
                             'rates without constraints')
        self.robot, self.held = robot, held
        self._workspace = robot.bind()
        self._mass_matrix, self._bias, self._coriolis = (
            getattr(self._workspace, name) for name in OBSERVED)
        self._t: float | None = None
        self._tau = self._momentum = self._beta = np.zeros(robot.n)
        self.reset()
        self.tune(gain, max_gap)

    def tune(self, gain: ArrayLike, max_gap: float) -> None:
        """Change the gain, 1/s, and `max_gap`, s; the estimate continues."""
        checked = per_joint(gain, 'gain', self.robot.joint_names)
        if not checked.all():
            joint = self.robot.joint_names[int(np.flatnonzero(checked == 0.0)[0])]
            raise InputError(f"gain of joint '{joint}': 0; expected a positive number, 1/s")
        if not max_gap > 0.0:
            raise InputError(f'max_gap: {max_gap}; expected a positive time in s')
        self._gain, self._max_gap = checked, max_gap

    def reset(self) -> None:
        """Reset; the estimate starts at zero with the next sample."""
        self._t = None
        self.torque = np.zeros(self.robot.n)

    def refresh(self) -> None:
        """Adapt to a changed payload or gravity of the robot; the estimate does not jump."""
        if self._t is not None:
            self._momentum, self._beta = self._terms()

    def update(self, t: float, q: ArrayLike, u: ArrayLike, tau: ArrayLike) -> Array:
        """
        Update with one sample and return `torque`.

        A sample with the stamp of the last one is ignored; an earlier one, or one more than
        `max_gap` later, restarts the observer.

        Parameters
        ----------
        t : float
            Stamp of the sample, s on any clock.
        q, u : (n,) array_like
            Measured positions and speeds, rad or m and s.
        tau : (n,) array_like
            Torques of the actuators, N m or N, as defined by `held`. Known external torques may
            be added; the estimate then excludes them.

        Raises
        ------
        InputError
            A number is missing or not finite; the observer is then reset.

        """
        if not math.isfinite(t):
            self.reset()
            raise InputError(f't: {t}; expected a finite time in s')
        elapsed = None if self._t is None else t - self._t
        if elapsed == 0.0:
            return self.torque
        if elapsed is not None and not 0.0 < elapsed <= self._max_gap:
            self.reset()
            elapsed = None
        try:
            torques = self._set_state(q, u, tau)
            momentum, beta = self._terms()
        except InputError:
            self.reset()
            raise
        if elapsed is not None:
            forgotten = np.exp(-self._gain * elapsed)
            drive = self._tau if self.held else 0.5 * (self._tau + torques)
            external = ((momentum - self._momentum) / elapsed - drive
                        + 0.5 * (self._beta + beta))
            self.torque = forgotten * self.torque + (1.0 - forgotten) * external
        self._t, self._tau, self._momentum, self._beta = t, torques, momentum, beta
        return self.torque

    def _set_state(self, q: ArrayLike, u: ArrayLike, tau: ArrayLike) -> Array:
        """Write the state to the workspace, which checks it; return tau, (n,)."""
        arrays = []
        for name, values in (('q', q), ('u', u), ('tau', tau)):
            array = np.array(values, dtype=np.float64)
            if array.shape != (self.robot.n,):
                raise InputError(f'{name}: shape {array.shape}; expected ({self.robot.n},)')
            arrays.append(array)
        self._workspace.q[:], self._workspace.u[:], torques = arrays
        if not np.isfinite(torques).all():
            raise InputError(f'tau: {torques.tolist()}; expected finite numbers')
        return torques

    def _terms(self) -> tuple[Array, Array]:
        """Return p and beta, (n,) each, at the state of the workspace."""
        u, C = self._workspace.u, self._coriolis()
        return self._mass_matrix() @ u, self._bias() - (C @ u + u @ C)
