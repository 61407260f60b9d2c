"""
Momentum observer: external joint torques from motion and actuation.

``p = M u`` obeys ``p' = tau + external - beta`` with ``beta = bias - (C + C^T) u``, so that no
acceleration is needed. The residual ``r = K (p - p(0) - integral(tau - beta + r) dt)`` is then
the external torque behind a first-order low-pass, ``r' = K (external - r)``. Source: A. De Luca,
R. Mattone, "Sensorless robot collision detection and hybrid force/motion control", ICRA 2005.

With chosen speeds or constraints p are the momenta of the independent speeds, T^T M_q q' with
q' = T u + X, and beta includes the rate of T (`Equations.momentum_terms`). Constraint
forces do no work in an admissible motion and drop out.
"""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import Any

from kane_dynamics._util.attribute_hints import guarded
from kane_dynamics._util.checks import finite_row, instance, per_joint
from kane_dynamics._util.text import listing
from kane_dynamics._util.typing import Array
from kane_dynamics.control.friction_error import FrictionError
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.mechanics.constraints.conditioning import guarded as nan_unless
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

OBSERVED = ('mass_matrix', 'bias_force', 'coriolis_matrix')  # quantities that it evaluates


def residual_step(residual: Any, last_momentum: Any, momentum: Any, tau: Any, beta: Any,
                  elapsed: Any, forgotten: Any) -> Any:
    """
    Return the residual after a step, (n,), over any scalar.

    tau and beta are means over the step, and `forgotten` is exp(-K elapsed).
    """
    external = (momentum - last_momentum) / elapsed - tau + beta
    return forgotten * residual + (1.0 - forgotten) * external


@guarded
class MomentumObserver:
    """
    Estimator of the external joint torques, or generalized forces of the independent speeds.

    The residual is advanced from sample to sample by its exact solution for a constant external
    torque, ``r = a r + (1 - a) (dp/dt - mean(tau) + mean(beta))`` with ``a = exp(-K dt)``, which
    is stable for every step and does not drift. Its time constant is 1/K: the estimate of a
    constant torque reaches 63 % after 1/K and 95 % after 3/K. Model errors count as external
    torque: unmodelled friction, and static friction at rest.

    Parameters
    ----------
    robot : Robot
        Its `parameters` are read at each sample; call `refresh` when they have changed.
    gain : float or (n,) array_like
        K, 1/s, positive; one for each independent speed.
    max_gap : float
        Longest time between two samples, s; after a longer one the observer restarts.
    held : bool
        False if `tau` is a torque measured together with the state, True if it is a command that
        acts from this sample to the next.
    friction_error : FrictionError, optional
        Friction beyond that of the model, which is then no part of the estimate. It adapts to the
        estimate and may be replaced at any time.

    Attributes
    ----------
    torque : (n,) array
        The estimate at the last sample, N m or N, with ``M udot + bias = tau + torque``. Zero
        after a reset.

    Raises
    ------
    InputError
        A number is invalid; names it. The friction is that of other joints.

    """

    def __init__(self, robot: Robot, *, gain: ArrayLike = 50.0, max_gap: float = 0.1,
                 held: bool = False, friction_error: FrictionError | None = None) -> None:
        """Compile the kernels; the estimate starts at zero with the first sample."""
        if friction_error is not None:
            instance(friction_error, FrictionError, 'friction_error')
            if friction_error.joint_names != robot.speed_names:
                raise InputError(f'friction_error: of {listing(friction_error.joint_names)}; '
                                 f'expected {listing(robot.speed_names)}')
        self.robot, self.held, self.friction_error = robot, held, friction_error
        self._workspace = robot.bind()
        self._momentum_terms: Callable[..., Array] | None = None
        if not robot.equations.in_joint_rates:
            self._momentum_terms = _momentum_kernel(robot)
        else:
            self._mass_matrix, self._bias, self._coriolis = (
                getattr(self._workspace, name) for name in OBSERVED)
        self._t: float | None = None
        self._tau = self._momentum = self._beta = np.zeros(robot.n)
        self.reset()
        self.tune(gain, max_gap)

    def tune(self, gain: ArrayLike, max_gap: float) -> None:
        """Change the gain, 1/s, and `max_gap`, s; the estimate continues."""
        checked = per_joint(gain, 'gain', self.robot.speed_names)
        if not checked.all():
            joint = self.robot.speed_names[int(np.flatnonzero(checked == 0.0)[0])]
            raise InputError(f"gain of joint '{joint}': 0; expected a positive number, 1/s")
        if not max_gap > 0.0:
            raise InputError(f'max_gap: {max_gap}; expected a positive time in s')
        self._gain, self._max_gap = checked, max_gap

    def reset(self) -> None:
        """Reset; the estimate starts at zero with the next sample."""
        self._t = None
        self.torque = np.zeros(self.robot.n)
        if self.friction_error is not None:
            self.friction_error.forget_motion()

    def refresh(self) -> None:
        """Adapt to a changed payload or gravity of the robot; the estimate does not jump."""
        if self._t is not None:
            self._momentum, self._beta = self._terms(self._t)

    def update(self, t: float, q: ArrayLike, u: ArrayLike, tau: ArrayLike) -> Array:
        """
        Update with one sample and return `torque`.

        A sample with the stamp of the last one is ignored; an earlier one, or one more than
        `max_gap` later, restarts the observer.

        Parameters
        ----------
        t : float
            Stamp of the sample, s on any clock.
        q, u : (n_q,), (n,) array_like
            Measured positions, and speeds (under constraints the independent ones), rad or m, s.
        tau : (n,) array_like
            Torques of the actuators, N m or N, as defined by `held`; dual to u, as
            `Robot.generalized_force` of joint torques. Known external torques may be added; the
            estimate then excludes them.

        Raises
        ------
        InputError, ConstraintError
            A number is missing or not finite, or a loop is open or singular; the observer is then
            reset.

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
            momentum, beta = self._terms(t)
        except (InputError, ConstraintError):
            self.reset()
            raise
        if elapsed is not None:
            forgotten = np.exp(-self._gain * elapsed)
            drive = self._tau if self.held else 0.5 * (self._tau + torques)
            self.torque = residual_step(self.torque, self._momentum, momentum, drive,
                                        0.5 * (self._beta + beta), elapsed, forgotten)
            if self.friction_error is not None:
                self.friction_error.adapt(elapsed, forgotten, self._workspace.u, self.torque)
        self._t, self._tau, self._momentum, self._beta = t, torques, momentum, beta
        return self.torque

    def hold(self, tau: ArrayLike) -> None:
        """
        Set the torque that acts from the last sample to the next, (n,), where `held` is True.

        For a controller whose command depends on the estimate: `update` with the torque that is
        still held, then `hold` with the new one.
        """
        torques = finite_row(tau, 'tau', self.robot.speed_names)
        if not self.held:
            raise InputError('held: False; expected an observer with held=True, whose torque is '
                             'a command')
        self._tau = torques

    def _set_state(self, q: ArrayLike, u: ArrayLike, tau: ArrayLike) -> Array:
        """Write the state to the workspace, which checks it; return tau, (n,)."""
        arrays = []
        for name, values in (('q', q), ('u', u), ('tau', tau)):
            array = np.array(values, dtype=np.float64)
            count = self.robot.n_q if name == 'q' else self.robot.n
            if array.shape != (count,):
                raise InputError(f'{name}: shape {array.shape}; expected ({count},)')
            arrays.append(array)
        self._workspace.q[:], self._workspace.u[:], torques = arrays
        if not np.isfinite(torques).all():
            raise InputError(f'tau: {torques.tolist()}; expected finite numbers')
        if self.friction_error is not None:
            torques -= self.friction_error.torque(self._workspace.u)
        return torques

    def _terms(self, t: float) -> tuple[Array, Array]:
        """Return p and beta, (n,) each, at the state of the workspace and the time t, s."""
        if self._momentum_terms is not None:
            time = [t] if self.robot.equations.timed else []
            found = self._momentum_terms(self._workspace.q, self._workspace.u, *time)
            return found[0], found[1]
        u, C = self._workspace.u, self._coriolis()
        return self._mass_matrix() @ u, self._bias() - (C @ u + u @ C)


def _momentum_kernel(robot: Robot) -> Kernel:
    """Return the kernel of `Equations.momentum_terms`."""
    equations, sets = robot.equations, robot.speed_sets
    mechanism = equations.mechanism

    def terms(q: Any, u: Any, t: Any, parameters: Any, limits: Any) -> Any:
        result = equations.momentum_terms(q, u, parameters, t)
        if not equations.watched:
            return result
        return nan_unless(result, equations.margin(q, t, limits))

    def reason(state: dict[str, Array]) -> Kernel | None:
        other = sets.instead(mechanism, state)
        if other is None or other.equations.in_joint_rates:
            return None
        choice = other.equations.mechanism
        return _momentum_kernel(robot.in_choice(choice.free, choice.kept))
    return robot.kernels.compiled(terms, 'momentum_terms', {'q': (robot.n_q,), 'u': (robot.n,)},
                                  (2, robot.n), reason=reason)
