"""
External joint torques from motion and actuation alone, by the generalized momentum.

``p = M u`` obeys ``p' = tau + external - beta`` with ``beta = bias - (C + C^T) u``, so that no
acceleration is needed. The residual ``r = K (p - p(0) - integral(tau - beta + r) dt)`` is then
the external torque behind a first-order low-pass, ``r' = K (external - r)``. Source: A. De Luca,
R. Mattone, "Sensorless robot collision detection and hybrid force/motion control", ICRA 2005.
"""

import math

from kane_dynamics._util.checks import per_joint
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

OBSERVED = ('mass_matrix', 'bias_force', 'coriolis_matrix')  # what an observer computes with


class MomentumObserver:
    """
    Estimates the torques that the environment exerts on the joints.

    The residual is advanced from sample to sample by its exact solution for a constant external
    torque, ``r = a r + (1 - a) (dp/dt - mean(tau) + mean(beta))`` with ``a = exp(-K dt)``, which
    is stable for every step and has no integral that could drift. It lags by 1/K: a constant
    torque is found to 63 % after 1/K and to 95 % after 3/K. Whatever the model lacks counts as
    external: unmodelled friction, and at rest all that static friction can hold.

    Parameters
    ----------
    robot : Robot
        With joint rates for speeds and without constraints. Its `parameters` are read at each
        sample; call `refresh` when they have changed.
    gain : float or (n,) array_like
        K, 1/s, positive.
    max_gap : float
        Time between two samples, s, beyond which nothing is known of what lies between and the
        observer starts anew.
    held : bool
        How `tau` is sampled: False for a torque measured together with the state, True for a
        command that acts from this sample to the next.

    Attributes
    ----------
    torque : (n,) array
        The estimate at the last sample, N m or N: what the environment does to the joints, so that
        ``M udot + bias = tau + torque``. Zero after a reset.

    Raises
    ------
    InputError
        The robot is not of that kind, or a number is not valid: names it and its value.

    """

    def __init__(self, robot: Robot, *, gain: ArrayLike = 50.0, max_gap: float = 0.1,
                 held: bool = False) -> None:
        """Compile what is needed; the first sample starts the estimate at zero."""
        if isinstance(robot.equations, ConstrainedEquations):
            raise InputError('the robot has chosen speeds or constraints; the momentum observer '
                             'takes one with joint rates for speeds and none')
        self.robot, self.held = robot, held
        self._workspace = robot.bind()
        self._mass_matrix, self._bias, self._coriolis = (
            getattr(self._workspace, name) for name in OBSERVED)
        self._t: float | None = None
        self._tau = self._momentum = self._beta = np.zeros(robot.n)
        self.reset()
        self.tune(gain, max_gap)

    def tune(self, gain: ArrayLike, max_gap: float) -> None:
        """Change gain, 1/s, and largest gap, s; the estimate carries on."""
        checked = per_joint(gain, 'gain', self.robot.joint_names)
        if not checked.all():
            joint = self.robot.joint_names[int(np.flatnonzero(checked == 0.0)[0])]
            raise InputError(f"gain of joint '{joint}' is 0; expected a positive number, 1/s")
        if not max_gap > 0.0:
            raise InputError(f'max_gap is {max_gap}; expected a positive time in s')
        self._gain, self._max_gap = checked, max_gap

    def reset(self) -> None:
        """Forget all samples; the next one starts the estimate at zero."""
        self._t = None
        self.torque = np.zeros(self.robot.n)

    def refresh(self) -> None:
        """Take a change of the robot's payload or gravity for what it is, not for a push."""
        if self._t is not None:
            self._momentum, self._beta = self._terms()

    def update(self, t: float, q: ArrayLike, u: ArrayLike, tau: ArrayLike) -> Array:
        """
        Take one sample and return `torque`.

        A sample of the same time as the last changes nothing; one from before it, or after a gap
        longer than `max_gap`, starts the observer anew.

        Parameters
        ----------
        t : float
            Stamp of the sample, s on any clock.
        q, u : (n,) array_like
            Measured positions and speeds, rad or m and s.
        tau : (n,) array_like
            Torques of the actuators, N m or N, as `held` says. Known external torques may be
            added: the estimate is then of what is beyond them.

        Raises
        ------
        InputError
            A number is missing or not finite; the observer has been reset then.

        """
        if not math.isfinite(t):
            self.reset()
            raise InputError(f't is {t}; expected a finite time in s')
        elapsed = None if self._t is None else t - self._t
        if elapsed == 0.0:
            return self.torque
        if elapsed is not None and not 0.0 < elapsed <= self._max_gap:
            self.reset()
            elapsed = None
        try:
            torques = self._take(q, u, tau)
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

    def _take(self, q: ArrayLike, u: ArrayLike, tau: ArrayLike) -> Array:
        """Put the state into the workspace, which checks its numbers; return tau, (n,)."""
        arrays = []
        for name, values in (('q', q), ('u', u), ('tau', tau)):
            array = np.array(values, dtype=np.float64)
            if array.shape != (self.robot.n,):
                raise InputError(f'{name} has shape {array.shape}; expected ({self.robot.n},)')
            arrays.append(array)
        self._workspace.q[:], self._workspace.u[:], torques = arrays
        if not np.isfinite(torques).all():
            raise InputError(f'tau is {torques.tolist()}; expected finite numbers')
        return torques

    def _terms(self) -> tuple[Array, Array]:
        """Return p and beta, (n,) each, at the state of the workspace."""
        u, C = self._workspace.u, self._coriolis()
        return self._mass_matrix() @ u, self._bias() - (C @ u + u @ C)
