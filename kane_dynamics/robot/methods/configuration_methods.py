"""The methods of `Robot` for coordinates, speeds, constraints and configurations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
import warnings

from kane_dynamics._util.checks import constant, finite_row, finite_times, integer
from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.text import SHORT
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError, InputError, ModelWarning
from kane_dynamics.mechanics.ball_joints import (angle_places, angles, balls, difference,
                                                 joint_speeds, moved, neutral,
                                                 on_unit_quaternions, require_unit)
from kane_dynamics.mechanics.constraints.loop_closure import (closed_configuration,
                                                              defined_rows,
                                                              followed_configuration,
                                                              Rows)
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.model.elastic_model import with_motors_at_links
from kane_dynamics.model.model import Model
from kane_dynamics.native.backends.llvm_math import POSITION_LIMIT
from kane_dynamics.native.runtime.kernel import Argument, checked, Kernel, require_writable
from kane_dynamics.native.tracing.program import Shape
from kane_dynamics.robot.methods.dispatch import compiled, Dispatch
from kane_dynamics.robot.parameters import JointLimits
import numpy as np
from numpy.typing import ArrayLike

NEARBY = 21  # initial guesses about 0 for loop closure
ON_LIMIT = 1e-9  # rad or m
TURN = 2.0 * np.pi
TRIES = 200  # random initial guesses for loop closure


def suspected_degrees(robot: Configurations, q: Array) -> str | None:
    """
    Return a description of positions that look like degrees, else None.

    Positions are (n_q,) or (K, n_q), rad or m. A revolute joint is suspected beyond two
    turns, or beyond a limit by more than a turn. For a joint without limits only the
    first row is checked, because it may turn without end.
    """
    rows = np.atleast_2d(q)
    model = robot.equations.model
    lower, upper = robot.limits.lower, robot.limits.upper
    # Most positions are far from any suspicion, all joints at once.
    least = rows.min(axis=0, initial=0.0)
    largest = rows.max(axis=0, initial=0.0)
    may_be_degrees = np.maximum(largest, -least) > 2.0 * TURN
    may_be_degrees |= np.maximum(lower - least, largest - upper) > TURN
    if not may_be_degrees.any():
        return None

    words = []
    for j, name in enumerate(model.coordinate_names):
        without_limits = np.isinf(lower[j]) and np.isinf(upper[j])
        # Of a batch without limits the first row counts: later rows may have turned far.
        values = rows[:1, j] if without_limits else rows[:, j]
        if name in model.sliding or not len(values):
            continue
        value = float(values[np.argmax(np.abs(values))])
        # Far outside the limits: by a turn, or two turns of a joint without them.
        below = lower[j] - values.min(initial=0.0)
        above = values.max(initial=0.0) - upper[j]
        outside = max(below, above, 0.0)
        two_turns = abs(value) > 2.0 * TURN and (without_limits or outside > 0.0)
        if two_turns or outside > TURN:
            words.append(f'{name} {value:.4g} rad')
            if not without_limits:
                words[-1] += f' (limits {lower[j]:.4g} to {upper[j]:.4g})'
    if not words:
        return None
    return f'far outside: {", ".join(words)}; expected rad: are these degrees?'


def outside_limits(robot: Configurations, q: Array) -> list[str]:
    """Return 'name value (limits lower to upper)' of entries of q beyond a limit."""
    lower, upper = robot.limits.lower, robot.limits.upper
    beyond = (q < lower - ON_LIMIT) | (q > upper + ON_LIMIT)
    words = []
    for k in np.flatnonzero(beyond):
        name = robot.coordinate_names[k]
        words.append(f'{name} {q[k]:.4g} (limits {lower[k]:.4g} to {upper[k]:.4g})')
    return words


def warn_of_degrees(robot: Configurations, q: Array, what: str,
                    stacklevel: int = 3) -> None:
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


def sampling_range(robot: Configurations) -> tuple[Array, Array]:
    """Return the bounds of random configurations, (n_q,) each, rad or m."""
    model = robot.equations.model
    is_length = [name in model.sliding for name in model.coordinate_names]
    # Without limits: a turn, or 1 m; beams straight; quaternions of any direction.
    span = np.where(is_length, 1.0, np.pi)
    for k in model.modal_coordinates:
        span[model.places[k]] = 0.0
    for ball in balls(model):
        ball.quaternion(span)[...] = 1.0
    lower, upper = robot.limits.lower, robot.limits.upper
    # Without a limit, a span from the other limit, or from 0 without both. A limit beyond
    # all positions that calls accept stands for none in many files.
    unlimited_below = lower < -POSITION_LIMIT
    unlimited_above = upper > POSITION_LIMIT
    highest = np.where(unlimited_above, 0.0, upper)
    lowest = np.where(unlimited_below, 0.0, lower)
    return (np.where(unlimited_below, highest - span, lower),
            np.where(unlimited_above, lowest + span, upper))


def _of_coordinates(model: Model, by_joint: Array, none: float) -> Array:
    """Return values of coordinates, (n_q,), by joint; `none` in quaternions."""
    result = np.full(len(model.coordinate_names), none)
    result[angle_places(model)] = by_joint[angles(model)]
    return result


class Configurations(Dispatch):
    """
    The methods of `Robot` for coordinates, speeds, constraints and configurations.

    In joint rates without constraints, u = q' and the joint torques equal tau. Arguments
    are those of one state, or (N, ...) arrays of a batch: q (n_q,), the independent
    speeds u, udot and the generalized forces tau (n,), rad or m, s, N m or N; the time
    `t`, s, a float or (N,) array; and `out`, which is written to and returned.
    """

    model: Model
    _choices: dict[str, Any]

    @property
    def mechanism(self) -> Mechanism:
        """Speeds and constraints; by default joint rates and no constraints."""
        return self.equations.mechanism

    @property
    def speed_names(self) -> tuple[str, ...]:
        """Names of the entries of u, udot and tau: the independent speeds."""
        return tuple(self.equations.speed_names)

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """Names of the rows of the constraints, as in `constraint_forces`."""
        return self.mechanism.labels

    @property
    def configuration(self) -> Any:
        """Return the configuration at which speeds and rows were chosen, or None."""
        return self._choices['configuration']

    @property
    def actuated_names(self) -> tuple[str, ...]:
        """
        Names of the joints with actuators.

        Those of `Robot(actuated=)`; by default the joints whose rates are the
        independent speeds, and all joints where the speeds are no joint rates.
        """
        names = self.joint_names
        actuated = self.equations.actuated
        if actuated is not None:
            return tuple(names[k] for k in actuated)
        # Joints whose rates are independent speeds; with other speeds, all joints.
        independent = tuple(name for name in names if name in self.speed_names)
        return independent or names

    @compiled
    def joint_rates(self, q: ArrayLike, u: ArrayLike, *, t: ArrayLike = 0.0,
                    out: Array | None = None) -> Array:
        """Return q', (n_q,), of the independent speeds."""
        if self.equations.in_joint_rates:
            return self._same('joint_rates', 'u', u, out)
        return self._call('joint_rates', (q, u), out, t)

    @compiled
    def joint_torques(self, tau: ArrayLike, q: ArrayLike | None = None, *,
                      t: ArrayLike = 0.0,
                      out: Array | None = None) -> Array:
        """
        Return joint torques, (n_q,), whose generalized force is tau.

        Of ball joints the moments about the axes of the body, so that the order is
        `joint_names`.

        By default each entry of tau acts on its own independent speed without constraint
        forces; with `Robot(actuated=)`, the actuators have the torques of minimum norm,
        or of the least sum of weight times torque squared. ConstraintError where the
        actuators cannot produce every motion: the mechanism moves a thousand times as
        fast as they do, or faster.

        Robots in joint rates without constraints ignore q.
        """
        # Joint rates: the force is that of the joints. Otherwise it depends on the
        # configuration.
        if self.equations.in_joint_rates:
            return self._same('joint_torques', 'tau', tau, out)
        if q is None:
            raise InputError('q: missing; expected the configuration, on which the '
                             'joint torques of a robot with chosen speeds or '
                             'constraints depend')
        return self._call('joint_torques', (tau, q), out, t)

    def generalized_force(self, joint_torques: ArrayLike, q: ArrayLike, *,
                          t: ArrayLike = 0.0) -> Array:
        """
        Return the generalized force tau, (n,), of joint torques, (n_q,).

        This reverses `joint_torques`. For torques measured at all joints, zero at those
        without actuators, N m or N.
        """
        equations = self.equations
        if equations.in_joint_rates:
            # Speeds are joint rates: both forces are the same.
            return self._same('generalized_force', 'joint_torques', joint_torques, None)
        model = equations.model
        torques = Argument('joint_torques', (model.n,), model.joint_names)
        kernel = self._kernel('generalized_force', {'q': (equations.n_q,),
                                                    'joint_torques': torques},
                              (equations.n,))
        result: Array = kernel(*self._at_time((q, joint_torques), t))
        return result

    def constraint_forces(self, q: ArrayLike, u: ArrayLike, tau: ArrayLike, *,
                          wrench: ArrayLike | None = None, t: ArrayLike = 0.0,
                          out: Array | None = None) -> Array:
        """
        Return the force of every constraint row, (m,), as in `constraint_names`.

        These are the equations of auxiliary speeds (Kane & Levinson, chapter 4): a row's
        force acts along the velocity that the row constrains, N or N m. With the tau of
        inverse dynamics they are the forces in that motion. The forces of redundant rows
        are not unique: the result has minimum norm, with moments divided by
        `mechanism.length`. `wrench` is as in
        `inverse_dynamics`.
        """
        return self._loaded('constraint_forces', (q, u, tau), wrench, out, t)

    @compiled
    def constraint_residual(self, q: ArrayLike, *, t: ArrayLike = 0.0,
                            out: Array | None = None) -> Array:
        """Return the residuals of the rows, (m,), m or rad; 0 for velocity constraints."""
        return self._call('constraint_residual', (q,), out, t)

    @compiled
    def constraint_velocity_residual(self, q: ArrayLike, u: ArrayLike, *,
                                     t: ArrayLike = 0.0,
                                     out: Array | None = None) -> Array:
        """Return the velocity residual J q' - b of every row, (m,), m/s or rad/s."""
        return self._call('constraint_velocity_residual', (q, u), out, t)

    @compiled
    def joint_accelerations(self, q: ArrayLike, u: ArrayLike, udot: ArrayLike, *,
                            t: ArrayLike = 0.0, out: Array | None = None) -> Array:
        """
        Return q'', (n_q,), of all joints, dependent ones included.

        Of ball joints the angular accelerations about the axes of the body, so that the
        order is `joint_names`.
        """
        if self.equations.in_joint_rates:
            return self._same('joint_accelerations', 'udot', udot, out)
        return self._call('joint_accelerations', (q, u, udot), out, t)

    def closed_configuration(self, q: ArrayLike, *, t: float = 0.0,
                             fixed: Sequence[str] = (),
                             start: ArrayLike | None = None) -> Array:
        """
        Return the configuration near q, (n_q,), that satisfies all position constraints.

        With fixed coordinates and a start, it is on the branch of the start: the fixed
        coordinates move from there to their values in small steps, and other entries of
        q are ignored.

        Parameters
        ----------
        q : (n_q,) array_like
            Initial guess, rad or m.
        t : float
            Time, s.
        fixed : sequence of str
            Names of coordinates that keep their values.
        start : (n_q,) array_like, optional
            A nearly closed configuration; q itself, to stay on its branch. Default: the
            `configuration` of the robot, if one was given.

        Raises
        ------
        InputError
            A number is missing or not finite, or a start comes without fixed
            coordinates.
        ConstraintError
            None is found; names the constraint with the largest residual.

        """
        rows = self._compiled_rows()
        first = self.configuration
        if start is not None:
            first = finite_row(start, 'start', self.coordinate_names)
        # Coordinates that are to be held are moved step by step from a closed
        # configuration.
        if first is not None and len(fixed):
            return followed_configuration(self.mechanism, first, q, t=t, fixed=fixed,
                                          rows=rows)
        if start is not None:
            raise InputError(f'start: {first.tolist()}, without fixed; expected the '
                             'coordinates that move from there to their values in q')
        return closed_configuration(self.mechanism, q, t=t, fixed=fixed, rows=rows)

    def _compiled_rows(self) -> Rows | None:
        """Return the rows of the constraints in native code, if there are any."""
        if not self.constraint_names:  # a call that compiles nothing takes a quarter
            return None
        result = np.empty((len(self.constraint_names), self.equations.model.n + 2))
        kernel = self._kernel('closure_rows', {'q': (self.equations.n_q,)}, result.shape)
        arguments = [np.empty(argument.shape) for argument in kernel.arguments]
        compute = kernel.bind(arguments, result, 'Compute the rows.')

        def rows(q: Array, t: Any) -> tuple[Array, Array, Array]:
            # Only q is an argument where nothing depends on t.
            for array, value in zip(arguments, (q, t)):
                array[...] = value
            try:
                compute()
            except InputError:  # not finite: those of the definition say which row
                return defined_rows(self.mechanism)(q, float(t))
            return result[:, :-2], result[:, -2], result[:, -1]
        return rows

    def _kernel(self, name: str, inputs: dict[str, Shape | Argument],
                shape: Shape) -> Kernel:
        """Return the kernel of a method of the equations that is no quantity."""
        return self.kernels.compiled(getattr(self.equations, name), name, inputs, shape)

    def _same(self, quantity: str, name: str, value: Any, out: Array | None) -> Array:
        """Return a checked copy, for a robot in joint rates without constraints."""
        same = checked(Argument(name, (self.equations.n,), self.speed_names), value)
        if out is None:
            return same.copy()
        require_writable(quantity, out, same.shape)
        out[...] = same
        return out

    @lazy_property
    def limits(self) -> JointLimits:
        """Joint limits, initially the model's."""
        model = self.equations.model
        by_joint = np.empty((4, self.equations.tree.n))
        for k, joint in enumerate(model.coordinate_joints):
            limits = joint.limits
            by_joint[:, k] = limits.lower, limits.upper, limits.velocity, limits.effort
        lower, upper, velocity, effort = by_joint
        if model.balls:  # no position of a quaternion is outside
            lower = _of_coordinates(model, lower, -np.inf)
            upper = _of_coordinates(model, upper, np.inf)
        return JointLimits(lower, upper, velocity, effort)

    def neutral(self) -> Array:
        """
        Return the configuration at which every coordinate is 0, (n_q,), rad or m.

        The quaternions of ball joints are (0, 0, 0, 1), those of no rotation. Under
        constraints on positions it is a closed configuration nearby. It may be outside
        the limits, as in Pinocchio.

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
        # Random steps away from it, which grow from nothing.
        # 0 itself may be singular, as a stretched loop.
        for away in np.linspace(0.0, 1.0, NEARBY):
            try:
                return self.closed_configuration(moved(
                    model, zero, away * rng.uniform(-1.0, 1.0, model.n)))
            except ConstraintError as error:
                failure = failure or error
        assert failure is not None
        raise failure

    def feasible_configuration(self) -> Array:
        """
        Return a configuration within the limits, (n_q,), to start from.

        Commands and searches start from it. Every coordinate is 0 where its limits admit
        that, else the middle of its limits, or the only limit. Motors of elastic joints
        are where their springs are not deflected. With closed loops it is
        the closed configuration near those values; if that is outside the limits, a
        random one within them. A robot with a `configuration` starts there.

        Raises
        ------
        ConstraintError
            None is found that meets constraints and limits.

        """
        lower, upper = self.limits.lower, self.limits.upper
        if self.configuration is not None:
            return self.closed_configuration(self.configuration)
        # Zero, or the middle of limits that exclude it; then the modes of beams in
        # equilibrium.
        q = neutral(self.equations.model)
        for k in np.flatnonzero((q < lower) | (q > upper)):
            bounds = [bound for bound in (lower[k], upper[k]) if np.isfinite(bound)]
            q[k] = np.mean(bounds)
        try:
            q = self._relaxed(q)
        except ConstraintError:  # far from every closed configuration
            return self.random_configuration(0)
        inside = bool((q >= lower).all() and (q <= upper).all())
        return q if inside else self.random_configuration(0)

    def random_configuration(self, seed: int | np.random.Generator | None = None,
                             count: int | None = None) -> Array:
        """
        Return one random configuration within the limits, or several.

        One is (n_q,), several are (count, n_q). Uniform between the limits; without a
        limit, or with one beyond 1e12, within half a turn or 1 m of 0 or of the other
        limit. Modal coordinates are 0, rotations of ball joints uniform, motors of
        elastic joints where their springs are not deflected. Under constraints on
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
        lower, upper = sampling_range(self)
        # Constraints are met one by one, from random starts.
        if self.equations.in_joint_rates:
            shape = lower.shape if count is None else (count, len(lower))
            return self._relaxed(rng.uniform(lower, upper, shape))
        if count is None:
            return self._closed(rng, lower, upper)
        configurations = np.empty((count, len(lower)))
        # Each from random starts of its own, of which the same seed gives the same.
        for row in configurations:
            row[:] = self._closed(rng, lower, upper)
        return configurations

    def integrate(self, q: ArrayLike, u: ArrayLike, dt: float = 1.0, *,
                  t: ArrayLike = 0.0) -> Array:
        """
        Return the configuration after a time in which the joints move at constant rates.

        The rates are those of u at q: ball joints turn about an axis fixed in their
        bodies. With closed loops, the result is the closed configuration near it.

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
        model = self.equations.model
        dt = float(constant(dt, (), 'dt (s)', InputError))
        start = self._configuration('q', q)
        times = self._times(t, start.shape[:-1])
        # Quaternions by the exponential map, then all loops closed at the new time.
        rates = joint_speeds(model, start, self.joint_rates(start, u, t=times))
        with np.errstate(over='ignore', invalid='ignore'):  # an error below
            end = moved(model, start, dt * rates)
        if not np.isfinite(end).all():
            raise InputError(f'u, dt: too large, {SHORT.repr(u)} for {dt:g} s; expected a '
                             'motion to a configuration of finite numbers')
        return self._closed_all(end, times + dt)

    def difference(self, q0: ArrayLike, q1: ArrayLike, *, t: ArrayLike = 0.0) -> Array:
        """
        Return the speeds, (n,), that take q0 to q1 in 1 s: `integrate` undone.

        Of ball joints the rotation vector on the axes of the body, of at most pi rad.
        With chosen speeds they are the speeds of those joint rates at q0; under
        constraints the independent ones, so that `integrate` returns q1 up to terms of
        second order in the distance.

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
        start, end = self._configuration('q0', q0), self._configuration('q1', q1)
        if start.ndim == end.ndim and start.shape != end.shape:
            raise InputError(f'q0, q1: shapes {start.shape} and {end.shape}; expected '
                             'batches of one length')
        step = difference(model, start, end)
        if self.equations.in_joint_rates:
            return step
        # Speeds depend on the configuration and the time, so that each row is converted
        # by itself.
        batch = step.shape[:-1]
        times = np.broadcast_to(self._times(t, batch), batch).ravel()
        starts = np.broadcast_to(start, (*batch, self.n_q)).reshape(-1, self.n_q)
        steps = step.reshape(-1, model.n)
        speeds = [self._speeds_of(q, v, s) for q, v, s in zip(starts, steps, times)]
        return np.array(speeds).reshape(*batch, self.n)

    def _times(self, t: ArrayLike, batch: tuple[int, ...]) -> Array:
        """Return a checked time, () or as many as there are states; 0 if none matters."""
        times = finite_times(t)
        if not self.equations.time_inputs(times):
            return np.zeros(())
        if times.shape not in ((), batch):
            raise InputError(f't: shape {times.shape}; expected one time, or one for each '
                             f'state, {batch}')
        return times

    def _configuration(self, name: str, q: ArrayLike) -> Array:
        """Return a checked configuration, (n_q,) or (N, n_q), with unit quaternions."""
        argument = Argument(name, (self.n_q,), self.coordinate_names)
        return require_unit(self.model, checked(argument, q), name)

    def _speeds_of(self, q: Array, v: Array, t: float) -> Array:
        """Return the independent speeds of joint rates, (n_j,), at one configuration."""
        Y, Z = self.mechanism.state(q, t).speed_rows(self.speed_names)
        return np.asarray(Y @ v + Z, dtype=np.float64)

    def _relaxed(self, q: Array) -> Array:
        """Return closed configurations near q, springs of drives without deflection."""
        model = self.equations.model
        closed = self._closed_all(with_motors_at_links(model, q), 0.0)
        if not model.drives:
            return closed
        # Closing the loops has moved the links; constraints may hold motors, too.
        return self._closed_all(with_motors_at_links(model, closed), 0.0)

    def _closed_all(self, q: Array, t: Array | float) -> Array:
        """Return configurations, (n_q,) or (N, n_q), with closed loops."""
        constraint_rows = self._compiled_rows()
        if constraint_rows is None:  # all are closed, and there may be many
            return q
        times = np.broadcast_to(t, q.shape[:-1]).ravel()
        configurations = q.reshape(-1, self.n_q)
        # One by one, because closing loops is an iteration of its own for each.
        closed = []
        for configuration, time in zip(configurations, times):
            closed.append(closed_configuration(self.mechanism, configuration,
                                               t=float(time), rows=constraint_rows))
        return np.array(closed).reshape(q.shape)

    def _closed(self, rng: np.random.Generator, lower: Array, upper: Array) -> Array:
        """Return one random configuration that meets constraints and limits."""
        failure = ConstraintError(f'{TRIES} random configurations: none satisfies '
                                  'limits and constraints; expected limits within which '
                                  'the constraints can be satisfied')
        for _ in range(TRIES):
            # A random start need not close, and the closed one need not be within
            # limits.
            try:
                q = rng.uniform(lower, upper)
                # Normal entries are uniform on the sphere of quaternions.
                for ball in balls(self.equations.model):
                    ball.quaternion(q)[...] = rng.standard_normal(4)
                q = on_unit_quaternions(self.equations.model, q)
                q = self._relaxed(q)
            except ConstraintError as error:
                failure = error
                continue
            if (q >= self.limits.lower).all() and (q <= self.limits.upper).all():
                return q
        raise failure
