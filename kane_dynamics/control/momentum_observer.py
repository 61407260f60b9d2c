"""
Momentum observer: external joint torques from motion and actuation.

``p = M u`` obeys ``p' = tau + external - beta`` with ``beta = bias - (C + C^T) u``, so
that no acceleration is needed. The residual ``r = K (p - p(0) - integral(tau - beta + r)
dt)`` is then the external torque behind a first-order low-pass, ``r' = K (external -
r)``. Source: A. De Luca, R. Mattone, "Sensorless robot collision detection and hybrid
force/motion control", ICRA 2005.

With chosen speeds or constraints p are the momenta of the independent speeds, T^T M_q q'
with q' = T u + X, and beta includes the rate of T (`Equations.momentum_terms`).
Constraint forces do no work in an admissible motion and drop out.
"""

from __future__ import annotations

import math

from kane_dynamics._util.checks import (finite_row, instance, number,
                                        per_joint, real_numbers)
from kane_dynamics._util.fixed_attributes import guarded_class
from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.control.friction_error import checked_friction_error, FrictionError
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.mechanics.constraints.conditioning import guarded as nan_unless
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.robot import in_regular_speeds, Robot
import numpy as np
from numpy.typing import ArrayLike


def residual_step(residual: Vector, last_momentum: Vector, momentum: Vector, tau: Vector,
                  beta: Vector, elapsed: Scalar, forgotten: Vector) -> Vector:
    """
    Return the residual after a step, (n,), over any scalar.

    tau and beta are means over the step, and `forgotten` is exp(-K elapsed).
    """
    external = (momentum - last_momentum) / elapsed - tau + beta
    return forgotten * residual + (1.0 - forgotten) * external


def later_deflections(equations: Equations, q: Vector, mean_u: Vector, deflections: Vector,
                      tau: Vector, elapsed: Scalar, t: Scalar) -> Vector:
    """Return the deflections of bristles, (n_b,), after a time, s, at mean speeds, (n,)."""
    mean = equations.joint_motion(q, mean_u, equations.zeros, t)
    travel = mean.qdot * elapsed
    return equations.deflections_after(q, mean.qdot, deflections, tau, travel, t)


def friction_beyond_speeds(equations: Equations, q: Vector, u: Vector, tau: Vector,
                           deflections: Vector, t: Scalar) -> Vector:
    """
    Return the friction that beta lacks at a state, (n,).

    Beta has the smooth law without loads; tau are the torques of the motors, and
    `deflections` those of bristles, (n_b,).
    """
    motion = equations.joint_motion(q, u, equations.zeros, t)
    bent = deflections if equations.tree.bristles else None
    of_joints = equations.driven_friction(q, motion.qdot, tau, t, None, bent)
    return motion.projected(of_joints - equations.tree.friction_force(motion.qdot))


@guarded_class
class MomentumObserver:
    """
    Estimator of the external torques, dual to the independent speeds.

    The residual is advanced from sample to sample by its exact solution for a constant
    external torque, ``r = a r + (1 - a) (dp/dt - mean(tau) + mean(beta))`` with ``a =
    exp(-K dt)``, which is stable for every step and does not drift. Its time constant is
    1/K: the estimate of a constant torque reaches 63 % after 1/K and 95 % after 3/K.
    Model errors count as external torque: unmodelled friction, and static friction at
    rest. Of joints with presliding friction the observer carries the deflections of the
    bristles, from zero after a reset: their friction is right once the joint has slid.

    Parameters
    ----------
    robot : Robot
        Its `parameters` are read at each sample; call `refresh` when they have changed.
    gain : float or (n,) array_like
        K, 1/s, positive; one for each independent speed.
    max_gap : float
        Longest time between two samples, s; after a longer one the observer restarts.
    held : bool
        False if `tau` is a torque measured together with the state, True if it is a
        command that acts from this sample to the next.
    friction_error : FrictionError, optional
        Friction beyond that of the model, which is then no part of the estimate. It
        adapts to the estimate and may be replaced at any time.

    Attributes
    ----------
    torque : (n,) array
        The estimate at the last sample, N m or N, with ``M udot + bias = tau + torque``.
        Zero after a reset. Changes of the array change no later estimate.

    Raises
    ------
    InputError
        A number is invalid; names it. The friction is that of other joints.

    """

    def __init__(self, robot: Robot, *, gain: ArrayLike = 50.0, max_gap: float = 0.1,
                 held: bool = False,
                 friction_error: FrictionError | None = None) -> None:
        """Compile the kernels; the estimate starts at zero with the first sample."""
        instance(robot, Robot, 'robot')
        if friction_error is not None:
            checked_friction_error(friction_error, robot.speed_names)
        self.robot = robot
        self.held = held
        self.friction_error = friction_error
        kernel = _momentum_kernel(robot)
        self._momentum_terms = kernel.entry('', kernel)  # compiles
        tree = robot.equations.tree
        self._further_friction: Kernel | None = None
        if tree.carries_loads or tree.bristles:
            self._further_friction = _further_friction_kernel(robot)
        self._q = np.zeros(robot.n_q)
        self._u = np.zeros(robot.n)
        self._t: float | None = None
        # Of the last sample.
        self._tau = np.zeros(robot.n)
        self._friction = np.zeros(robot.n)  # that beta lacks
        self._deflections = np.zeros(len(tree.bristles))
        self._momentum = np.zeros(robot.n)
        self._beta = np.zeros(robot.n)
        self.reset()
        self.tune(gain, max_gap)

    @property
    def torque(self) -> Array:
        """Return a copy of the estimate at the last sample, (n,)."""
        return self._residual.copy()

    def tune(self, gain: ArrayLike, max_gap: float) -> None:
        """Change the gain, 1/s, and `max_gap`, s; the estimate continues."""
        gains = per_joint(gain, 'gain', self.robot.speed_names)
        if not gains.all():
            joint = self.robot.speed_names[int(np.flatnonzero(gains == 0.0)[0])]
            raise InputError(f"gain of joint '{joint}': 0; expected a positive number, "
                             '1/s')
        max_gap = number(max_gap, 'max_gap', 'a positive time in s', lambda x: x > 0.0)
        self._gain = gains
        self._max_gap = max_gap

    def reset(self) -> None:
        """Reset; the estimate starts at zero with the next sample."""
        self._t = None
        self._residual = np.zeros(self.robot.n)
        self._deflections = np.zeros_like(self._deflections)
        if self.friction_error is not None:
            self.friction_error.forget_motion()

    def refresh(self) -> None:
        """Adapt to a changed payload or gravity; the estimate does not jump."""
        if self._t is not None:
            self._momentum, self._beta = self._terms(self._t)

    def update(self, t: float, q: ArrayLike, u: ArrayLike, tau: ArrayLike) -> Array:
        """
        Update with one sample and return `torque`.

        A sample with the stamp of the last one is ignored; an earlier one, or one more
        than `max_gap` later, restarts the observer.

        Parameters
        ----------
        t : float
            Stamp of the sample, s on any clock.
        q, u : (n_q,), (n,) array_like
            Measured positions, and speeds (under constraints the independent ones), rad
            or m, s.
        tau : (n,) array_like
            Torques of the actuators, N m or N, as defined by `held`; dual to u, as
            `Robot.generalized_force` of joint torques. Known external torques may be
            added; the estimate then excludes them.

        Raises
        ------
        InputError, ConstraintError
            A number is missing or not finite, or a loop is open or singular; the
            observer is then reset.

        """
        try:
            t = number(t, 't', 'a finite time in s', math.isfinite)
        except InputError:
            self.reset()
            raise
        # The time since the last sample; None for the first, also after a long pause.
        elapsed = None if self._t is None else t - self._t
        if elapsed == 0.0:
            return self.torque
        if elapsed is not None and not 0.0 < elapsed <= self._max_gap:
            self.reset()
            elapsed = None
        last_u = self._u
        try:
            torques = self._checked(q, u, tau)
            friction = self._friction_beyond(torques, last_u, elapsed, t)
            momentum, beta = self._terms(t)
        except (InputError, ConstraintError):
            self.reset()
            raise
        # One step of the residual. tau of a held command acted since the last sample;
        # measured torques, friction and beta change linearly in between.
        if elapsed is not None:
            forgotten = np.exp(-self._gain * elapsed)
            mean_torque = self._tau if self.held else 0.5 * (self._tau + torques)
            mean_torque = mean_torque - 0.5 * (self._friction + friction)
            mean_beta = 0.5 * (self._beta + beta)
            self._residual = residual_step(self._residual, self._momentum, momentum,
                                           mean_torque, mean_beta, elapsed, forgotten)
            if self.friction_error is not None:
                self.friction_error.adapt(elapsed, forgotten, self._u, self._residual)
        self._t = t
        self._tau = torques
        self._friction = friction
        self._momentum = momentum
        self._beta = beta
        return self.torque

    def hold(self, tau: ArrayLike) -> None:
        """
        Set the torque from the last sample to the next, (n,), where `held` is True.

        For a controller whose command depends on the estimate: `update` with the torque
        that is still held, then `hold` with the new one.
        """
        torques = finite_row(tau, 'tau', self.robot.speed_names)
        if not self.held:
            raise InputError('hold: called with held=False; expected an observer made '
                             'with held=True')
        self._tau = torques.copy()  # callers may reuse their array

    def _checked(self, q: ArrayLike, u: ArrayLike, tau: ArrayLike) -> Array:
        """Store a checked state and return the checked torques, (n,)."""
        robot = self.robot
        self._q = _row(q, 'q', robot.n_q)
        self._u = _row(u, 'u', robot.n)
        torques = _row(tau, 'tau', robot.n)
        if not np.isfinite(torques).all():
            raise InputError(f'tau: {torques.tolist()}; expected finite numbers')
        return torques

    def _friction_beyond(self, tau: Array, last_u: Array, elapsed: float | None, t: float
                         ) -> Array:
        """Return the friction that beta lacks at the stored state, (n,)."""
        # Both are friction that beta, the observer's model, does not contain.
        friction = np.zeros(self.robot.n)
        if self.friction_error is not None:
            friction = self.friction_error.torque(self._u)
        if self._further_friction is None:
            return friction
        # Bristles deflect with the mean rate since the last update.
        mean_u = self._u
        if elapsed is not None:
            mean_u = 0.5 * (last_u + self._u)
        time = self.robot.equations.time_inputs(t)
        results = self._further_friction(self._q, self._u, tau - friction, mean_u,
                                         self._deflections, elapsed or 0.0, *time)
        n = self.robot.n
        self._deflections = results[n:]
        return np.asarray(friction + results[:n])

    def _terms(self, t: float) -> tuple[Array, Array]:
        """Return p and beta, (n,) each, at the stored state and the time t, s."""
        time = self.robot.equations.time_inputs(t)
        momentum, beta = self._momentum_terms(self._q, self._u, *time)
        return momentum, beta


def _row(values: ArrayLike, name: str, count: int) -> Array:
    """Return a copy of `count` numbers; InputError for another shape."""
    try:
        array = np.array(real_numbers(values))
    except (TypeError, ValueError):
        raise InputError(f'{name}: {values!r}; expected ({count},) numbers') from None
    if array.shape != (count,):
        raise InputError(f'{name}: shape {array.shape}; expected ({count},)')
    return array


def _further_friction_kernel(robot: Robot) -> Kernel:
    """
    Return the kernel of friction that depends on loads and on bristles.

    Its arguments are a state, the torques, the mean speeds since the last sample, the
    deflections of the bristles then and the time since. It returns what the friction at the
    state exceeds that of speeds alone by, (n,), and the deflections, (n_b,).
    """
    equations = robot.equations
    bristles = len(equations.tree.bristles)

    def friction(q: Vector, u: Vector, tau: Vector, mean_u: Vector, deflections: Vector,
                 elapsed: Scalar, t: Scalar) -> Vector:
        later = deflections
        # The deflections after the time since the last update, by the law of bristles.
        if bristles:
            later = later_deflections(equations, q, mean_u, deflections, tau, elapsed, t)
        beyond = friction_beyond_speeds(equations, q, u, tau, later, t)
        return np.concatenate([beyond, later])
    row = (robot.n,)
    return robot.compiled(friction, name='further_friction', q=(robot.n_q,), u=row, tau=row,
                          mean_u=row, deflections=(bristles,), elapsed=(),
                          shape=(robot.n + bristles,))


def _momentum_kernel(robot: Robot) -> Kernel:
    """Return the kernel of `Equations.momentum_terms`."""
    equations = robot.equations

    def terms(q: Vector, u: Vector, t: Scalar, parameters: Vector,
              limits: Vector) -> Matrix:
        result = equations.momentum_terms(q, u, parameters, t)
        if not equations.watched:  # a tree has no singular or open configuration
            return result
        return nan_unless(result, equations.margin(q, t, limits))

    # In a state that is singular for these speeds, another choice answers.
    def reason(state: dict[str, Array]) -> Kernel | None:
        """Return the kernel in speeds that are regular at a state, or None."""
        regular = in_regular_speeds(robot, state)
        return None if regular is None else _momentum_kernel(regular)
    return robot.kernels.compiled(terms, 'momentum_terms',
                                  {'q': (robot.n_q,), 'u': (robot.n,)}, (2, robot.n),
                                  reason=reason)
