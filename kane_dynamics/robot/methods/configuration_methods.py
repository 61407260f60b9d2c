"""Neutral and random configurations of a robot, and its joint limits."""

from __future__ import annotations

import warnings

from kane_dynamics._util.checks import constant, integer
from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.text import SHORT
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError, InputError, ModelWarning
from kane_dynamics.mechanics.ball_joints import (angle_places, angles, balls, difference,
                                                 joint_speeds, moved, neutral,
                                                 on_unit_quaternions, require_unit)
from kane_dynamics.native.runtime.argument import Argument, checked
from kane_dynamics.robot.methods.constraint_methods import ConstraintMethods
from kane_dynamics.robot.methods.dispatch import Dispatch
from kane_dynamics.robot.parameters import JointLimits
import numpy as np
from numpy.typing import ArrayLike

NEARBY = 21  # initial guesses about 0 for loop closure
ON_LIMIT = 1e-9  # rad or m
TURN = 2.0 * np.pi
TRIES = 200  # random initial guesses for loop closure


def suspected_degrees(robot: Configurations, q: Array) -> str | None:
    """
    Return a description of positions, (n_q,) or (K, n_q), that look like degrees, else None.

    A revolute joint is suspected beyond two turns, or beyond a limit by more than a turn. For a
    joint without limits only the first row is checked, because it may turn without end.
    """
    rows, model = np.atleast_2d(q), robot.equations.model
    lower, upper = robot.limits.lower, robot.limits.upper
    words = []
    for j, name in enumerate(model.coordinate_names):
        free = np.isinf(lower[j]) and np.isinf(upper[j])
        values = rows[:1, j] if free else rows[:, j]
        value = float(values[np.argmax(np.abs(values))]) if len(values) else 0.0
        outside = max(lower[j] - values.min(initial=0.0), values.max(initial=0.0) - upper[j], 0.0)
        beyond = abs(value) > 2.0 * TURN and (free or outside > 0.0)
        if (beyond or outside > TURN) and name not in model.sliding:
            limits = '' if free else f' (limits {lower[j]:.4g} to {upper[j]:.4g})'
            words.append(f'{name} {value:.4g} rad{limits}')
    return f'far outside: {", ".join(words)}; expected rad: are these degrees?' if words else None


def outside_limits(robot: Configurations, q: Array) -> list[str]:
    """Return 'name value (limits lower to upper)' of each entry of q, (n_q,), beyond a limit."""
    lower, upper = robot.limits.lower, robot.limits.upper
    return [f'{name} {value:.4g} (limits {low:.4g} to {high:.4g})'
            for name, value, low, high in zip(robot.coordinate_names, q, lower, upper)
            if value < low - ON_LIMIT or value > high + ON_LIMIT]


def warn_of_degrees(robot: Configurations, q: Array, what: str, stacklevel: int = 3) -> None:
    """Warn if positions, (n_q,) or (K, n_q), look like degrees."""
    text = suspected_degrees(robot, q)
    if text is not None:
        warnings.warn(f'{what}: {text}', ModelWarning, stacklevel=stacklevel)


def random_generator(seed: int | np.random.Generator | None) -> np.random.Generator:
    """Return a random generator; raise InputError for an invalid seed."""
    try:
        return np.random.default_rng(seed)
    except (TypeError, ValueError):
        raise InputError(f'seed: {SHORT.repr(seed)}; expected an integer >= 0 or a '
                         'numpy.random.Generator') from None


class Configurations(ConstraintMethods, Dispatch):
    """The methods of `Robot` that return configurations."""

    @lazy_property
    def limits(self) -> JointLimits:
        """Joint limits, initially those of the model."""
        model = self.equations.model
        limits = [joint.limits for joint in model.coordinate_joints]
        found = {name: np.array([getattr(limit, name) for limit in limits])
                 for name in ('lower', 'upper', 'velocity', 'effort')}
        if model.balls:  # no position of a quaternion is outside
            for name, none in (('lower', -np.inf), ('upper', np.inf)):
                of_q = np.full(len(model.coordinate_names), none)
                of_q[angle_places(model)] = found[name][angles(model)]
                found[name] = of_q
        return JointLimits(**found)

    def neutral(self) -> Array:
        """
        Return the configuration at which every coordinate is 0, (n_q,), rad or m.

        The quaternions of ball joints are (0, 0, 0, 1), those of no rotation. Under constraints
        on positions it is a closed configuration nearby. It may be outside the limits, as in
        Pinocchio.

        Raises
        ------
        ConstraintError
            None is found; names the constraint with the largest residual.

        """
        model = self.equations.model
        zero = neutral(model)
        if self.equations.in_joint_rates:
            return zero
        rng, failure = np.random.default_rng(0), None
        for away in np.linspace(0.0, 1.0, NEARBY):  # 0 itself may be singular, as a stretched loop
            try:
                return self.closed_posture(moved(
                    model, zero, away * rng.uniform(-1.0, 1.0, model.n)))
            except ConstraintError as error:
                failure = failure or error
        assert failure is not None
        raise failure

    def feasible_configuration(self) -> Array:
        """
        Return a configuration within the limits, (n_q,), from which commands and searches start.

        Every coordinate is 0 where its limits admit that, else the middle of its limits, or the
        only limit. With closed loops it is the closed configuration near those values; if that is
        outside the limits, a random one within them. A robot with a `configuration` starts there.

        Raises
        ------
        ConstraintError
            None is found that meets constraints and limits.

        """
        lower, upper = self.limits.lower, self.limits.upper
        if self.configuration is not None:
            stated: Array = np.asarray(self.configuration, dtype=np.float64)
            return self.closed_posture(stated) if self.constraint_names else stated.copy()
        q = neutral(self.equations.model)
        for k in np.flatnonzero((q < lower) | (q > upper)):
            bounds = [bound for bound in (lower[k], upper[k]) if np.isfinite(bound)]
            q[k] = np.mean(bounds)
        if not self.constraint_names:
            return q
        try:
            q = self.closed_posture(q)
        except ConstraintError:  # far from every closed configuration
            return self.random_configuration(0)
        inside = bool((q >= lower).all() and (q <= upper).all())
        return q if inside else self.random_configuration(0)

    def random_configuration(self, seed: int | np.random.Generator | None = None,
                             count: int | None = None) -> Array:
        """
        Return a random configuration within the limits, (n_q,), or several, (count, n_q).

        Uniform between the limits; without a limit, within half a turn or 1 m of 0 or of the other
        limit. Modal coordinates are 0, rotations of ball joints uniform. Under constraints on
        positions, a uniform configuration is the initial guess for loop closure.

        Parameters
        ----------
        seed : int or numpy.random.Generator, optional
            The same seed returns the same configuration.
        count : int, optional
            Number of configurations; by default one, as an (n_q,) array.

        Raises
        ------
        InputError
            The seed or the count is invalid.
        ConstraintError
            None is found that meets constraints and limits.

        """
        if count is not None:
            count = integer(count, 'count', 0)
        rng = random_generator(seed)
        lower, upper = self.sampling_range()
        if self.equations.in_joint_rates:
            return rng.uniform(lower, upper, (*(() if count is None else (count,)), len(lower)))
        if count is None:
            return self._closed(rng, lower, upper)
        return np.array([self._closed(rng, lower, upper) for _ in range(count)]).reshape(
            count, len(lower))

    def integrate(self, q: ArrayLike, u: ArrayLike, dt: float = 1.0, *,
                  t: ArrayLike = 0.0) -> Array:
        """
        Return the configuration after a time in which the joints move at constant rates.

        The rates are those of u at q: ball joints turn about an axis fixed in their bodies. With
        closed loops, the result is the closed configuration near it.

        Parameters
        ----------
        q, u : (n_q,), (n,) or (N, n_q), (N, n) arrays
            Configuration and speeds; rad or m, and s.
        dt : float
            s.
        t : float or (N,) array
            Time, s; ignored unless speeds or constraints depend on it.

        Returns
        -------
        (n_q,) or (N, n_q) array
            Quaternions have the length 1.

        Raises
        ------
        InputError
            Names the argument, what was given and what is expected.
        ConstraintError
            Loops do not close.

        """
        model, dt = self.equations.model, float(constant(dt, (), 'dt (s)', InputError))
        start = checked(Argument('q', (self.n_q,), self.coordinate_names), q)
        start = require_unit(model, start, 'q')
        rates = joint_speeds(model, start, self.joint_rates(start, u, t=t))
        end = moved(model, start, dt * rates)
        return self._closed_all(end, np.asarray(t) + dt)

    def difference(self, q0: ArrayLike, q1: ArrayLike, *, t: ArrayLike = 0.0) -> Array:
        """
        Return the speeds, (n,), that take q0 to q1 in 1 s: `integrate` undone.

        Of ball joints the rotation vector on the axes of the body, of at most pi rad. With chosen
        speeds they are the speeds of those joint rates at q0; under constraints the independent
        ones, so that `integrate` returns q1 up to terms of second order in the distance.

        Parameters
        ----------
        q0, q1 : (n_q,) or (N, n_q) arrays
            Configurations, rad or m; one and a batch too.
        t : float or (N,) array
            Time, s; ignored unless speeds depend on it.

        Raises
        ------
        InputError
            Names the argument, what was given and what is expected.

        """
        model = self.equations.model
        first, last = (require_unit(model, checked(
            Argument(name, (self.n_q,), self.coordinate_names), q), name)
            for name, q in (('q0', q0), ('q1', q1)))
        step = difference(model, first, last)
        if self.equations.in_joint_rates:
            return step
        times = np.broadcast_to(t, step.shape[:-1]).ravel()
        starts = np.broadcast_to(first, (*step.shape[:-1], self.n_q))
        rows = [self._speeds_of(*each) for each in zip(
            starts.reshape(-1, self.n_q), step.reshape(-1, model.n), times)]
        return np.array(rows).reshape(*step.shape[:-1], self.n)

    def _speeds_of(self, q: Array, v: Array, t: float) -> Array:
        """Return the independent speeds of joint rates, (n_j,), at one configuration."""
        Y, Z = self.mechanism.state(q, t).speed_rows(self.speed_names)
        return np.asarray(Y @ v + Z, dtype=np.float64)

    def _closed_all(self, q: Array, t: Array) -> Array:
        """Return configurations, (n_q,) or (N, n_q), with closed loops."""
        if not self.constraint_names:
            return q
        times = np.broadcast_to(t, q.shape[:-1]).ravel()
        return np.array([self.closed_posture(row, t=float(s)) for row, s in zip(
            q.reshape(-1, self.n_q), times)]).reshape(q.shape)

    def sampling_range(self) -> tuple[Array, Array]:
        """Return the bounds of random configurations, (n_q,) each, rad or m."""
        model = self.equations.model
        span = np.array([1.0 if name in model.sliding else np.pi
                         for name in model.coordinate_names])
        modes = set(model.modal_coordinates)
        span[[place for k, place in enumerate(model.places)
              if k in modes and place is not None]] = 0.0
        for ball in balls(model):
            ball.quaternion(span)[...] = 1.0
        lower, upper = self.limits.lower, self.limits.upper
        left, right = np.isinf(lower), np.isinf(upper)
        return (np.where(left, np.where(right, 0.0, upper) - span, lower),
                np.where(right, np.where(left, 0.0, lower) + span, upper))

    def _closed(self, rng: np.random.Generator, lower: Array, upper: Array) -> Array:
        """Return one random configuration that meets constraints and limits."""
        failure = ConstraintError(f'{TRIES} random configurations: none satisfies limits and '
                                  'constraints; expected limits within which the constraints '
                                  'can be satisfied')
        for _ in range(TRIES):
            try:
                q = rng.uniform(lower, upper)
                for ball in balls(self.equations.model):  # uniform on the sphere of quaternions
                    ball.quaternion(q)[...] = rng.standard_normal(4)
                q = self.closed_posture(on_unit_quaternions(self.equations.model, q))
            except ConstraintError as error:
                failure = error
                continue
            if (q >= self.limits.lower).all() and (q <= self.limits.upper).all():
                return q
        raise failure
