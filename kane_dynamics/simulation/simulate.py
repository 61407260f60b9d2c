"""
Forward simulation in native code.

One step of an integrator is traced with the robot's forward dynamics as a subroutine and
compiled. The kernel runs along a buffer of states, where each result is the argument of
the next step; this loop over time is native and releases the GIL. Many simulations run
in SIMD lanes.

`simulate` checks its arguments, chooses the steps and what watches them, and lets
`stepping.run` compute the states.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
import math
from typing import Any
import warnings

from kane_dynamics._util.checks import constant, instance, positive_time
from kane_dynamics._util.typing import Array
from kane_dynamics.control.computed_torque import joints_that_follow, law_kernel
from kane_dynamics.errors import InputError, ModelWarning
from kane_dynamics.mechanics.ball_joints import joint_speeds, require_unit
from kane_dynamics.mechanics.constraints.conditioning import loosened
from kane_dynamics.mechanics.integrators import integrator_of
from kane_dynamics.native.runtime.kernel import Argument, checked
from kane_dynamics.native.runtime.loops import loops
from kane_dynamics.native.runtime.threads import run_concurrently
from kane_dynamics.robot.kernel_set import CONSTRAINED, IN_LOOPS
from kane_dynamics.robot.methods.configuration_methods import warn_of_degrees
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.callable_steps import CallableSteps
from kane_dynamics.simulation.contact import checked_contacts, Contact, require_open
from kane_dynamics.simulation.deflection_watch import DeflectionWatch
from kane_dynamics.simulation.discontinuities import JumpWatch
from kane_dynamics.simulation.energy_balance import compile_balance, EnergyBalance
from kane_dynamics.simulation.limit_events import LimitWatch
from kane_dynamics.simulation.observers import DivergenceWatch, Observer
from kane_dynamics.simulation.presliding import require_no_bristles, SettlingWatch
from kane_dynamics.simulation.row_modes import require_stops
from kane_dynamics.simulation.speed_choice import ConstrainedSteps
from kane_dynamics.simulation.step_kernels import (deflections_of, state_layout,
                                                   step_kernel)
from kane_dynamics.simulation.step_size import stable_integrator, without_coulomb
from kane_dynamics.simulation.stepper import RowSteps
from kane_dynamics.simulation.stepping import Progress, run, Steps
from kane_dynamics.simulation.torque_input import torque_input
from kane_dynamics.simulation.trajectory import ContactEvent, StopEvent, Trajectory
import numpy as np

CLOSED = 1e-8  # rad or lengths: largest constraint residual of an initial configuration
TIME_ROUNDING = 0.01  # largest spacing of floating-point times, of a step
MOST_STEPS = 100_000_000
MOST_SAMPLES = 1_000_000
DEFAULT_SAMPLES = 1000
# Quantities that `simulate` computes for all rows of its result at once.
AFTERWARDS = ('forward_dynamics', 'constraint_forces', 'constraint_residual',
              'constraint_velocity_residual')


def simulate(robot: Robot, q0: Any, u0: Any, duration: float, *, step: float = 1e-3,
             torque: Any = None, sample: float | None = None,
             progress: Progress | None = None, integrator: str | None = None,
             t0: float = 0.0, stops: bool = False, sticking: bool = False,
             bristles0: Any = None, contacts: Sequence[Contact] = ()) -> Trajectory:
    """
    Integrate the equations of motion with steps of one length.

    Conditions on positions, such as closed loops, are corrected by one Newton step after
    every step; the trajectory holds the remaining residuals. What is integrated are the
    joint rates, in whichever independent speeds are well conditioned: u may become
    singular on the way.

    Parameters
    ----------
    robot : Robot
        The robot to simulate.
    q0, u0 : (n_q,), (n,) or (N, n_q), (N, n) array_like
        Initial state, or N initial states of N simulations; rad or m, and s.
    duration : float
        s; a whole number of steps.
    step : float
        s.
    torque : None, array, callable or ComputedTorque
        None: zero torque. (n,): constant. (K, n) with at least one row per step: row k
        is held during step k. (N, K, n): a table for each of N initial states (other
        forms apply to all). ``torque(t, q, u)``: evaluated once a step and held; for a
        single initial state only, because Python would be called N times a step.
        `ComputedTorque`: evaluated continuously, with friction at the desired speed; the
        desired acceleration may jump between two steps, and within one at the cost of
        the integrator's order.
    sample : float, optional
        Time between the rows of the result, a whole number of steps. Default: about a
        thousand rows, or fewer if N initial states would give more than a million. The
        first and the last state are always included.
    progress : callable, optional
        Called with the simulated time at intervals of about 20 ms at most, or of eight
        steps of all N states if those take longer; returning False ends the simulation
        there.
    integrator : {'rk4', 'implicit'}, optional
        The fourth-order Runge-Kutta method; or a second-order Rosenbrock method whose
        step friction, springs and beams do not limit
        (`mechanics.integrators.rosenbrock`). The first is more accurate for smooth
        motions; the second is faster by orders of magnitude where joints stick. By
        default 'rk4' if the step is stable at the (first) initial configuration
        (`longest_step`), else 'implicit', with a warning that says so; 'implicit' if
        joints have bristles.
    t0 : float
        Initial time, s, for functions of time.
    stops : bool
        Put rigid, inelastic, frictionless stops at the position limits: the impulse of a
        stop ends the motion into it and acts on all joints, in the space of the motions
        that the constraints admit. `Trajectory.stop_events` lists the impacts, whose
        times are found to the order of the integrator; each takes some milliseconds of
        computation. While a joint presses against its stop, the force of the stop holds
        it within the steps.
    sticking : bool
        Set-valued Coulomb friction in place of the smooth law: a joint sticks while the
        torque that it needs is below breakaway friction (`Trajectory.sticking`), and
        slides otherwise. The times of transition are found to the order of the
        integrator; each takes some milliseconds of computation. Refused for joints with
        `presliding_stiffness`, which have bristles in place of the smooth law.
    bristles0 : (n_b,) or (N, n_b) array_like, optional
        Initial deflections of the bristles, rad or m (`Trajectory.bristles`). Default:
        none.

    contacts : sequence of Contact
        Rigid contacts of points of the robot with surfaces, with friction and
        restitution (`Trajectory.contact_forces`, `contact_modes`, `contact_events`). The
        times at which they change are found to the order of the integrator; each takes
        some milliseconds. Joint stops and joints that stick are then found in the same
        way, within the steps.

    Returns
    -------
    Trajectory
        Its arrays have a leading axis N for N initial states. Each simulation of N
        equals the single simulation from its initial state, to rounding.

    Raises
    ------
    InputError
        Names the argument, the value and what is expected; also if the motion diverges
        (is not finite), with the time and the joint.
    ConstraintError
        The forces of contacts are not determined (Painleve's paradox). The motion comes to
        a kinematic singularity (a dead point); constraints contradict each other; a loop's
        residual after one step is too large; or a user-defined function jumps or is not
        finite. Names the time, the constraint, and the configuration or the size of the
        jump.

    Warns
    -----
    ModelWarning
        An initial position looks like degrees (see the page on limits). The step is too
        long for the Runge-Kutta method with this friction, these springs or beams at the
        (first) initial configuration (`longest_step`): 'implicit' is chosen by default,
        and with 'rk4' the motion near rest is inaccurate. The error of the energy
        balance is above that expected of the step: names the time of its begin. A beam
        bends further than its equations are meant for: names the time, the beam, the
        deflection and the admissible one. All three are in `Trajectory.warnings` too.

    """
    _require_arguments(robot, progress, integrator, stops, sticking)
    start, step = _checked_times(t0, step)
    states = initial_states(robot, q0, u0, start, bristles0)
    single = states.ndim == 1
    states = np.atleast_2d(states)
    count = whole_steps('duration', positive_time(duration, 'duration'), step)
    every = steps_per_sample(count, step, sample, len(states), single)
    warn_of_degrees(robot, states[:, :robot.n_q], 'q0', stacklevel=3)

    # What watches the states, in this order. Jumps of user-defined functions are looked
    # for before the first evaluation of the dynamics, which may not be finite.
    observers: list[Observer] = []
    if robot.equations.tree.flexible:
        observers.append(DeflectionWatch(robot, single))
    observers.append(DivergenceWatch(robot, step, single, *observers))
    if robot.equations.timed:
        observers.append(JumpWatch(robot, states, start, step, count, single))

    # The step must be stable for everything but Coulomb friction that sticks.
    if sticking:
        require_no_bristles(robot, 'sticking')
    smooth = without_coulomb(robot) if sticking else robot
    integrator, step_text = stable_integrator(smooth, states[:1, :robot.n_q], step,
                                              integrator, start)
    if step_text is not None:
        warnings.warn(step_text, ModelWarning, stacklevel=2)
    rows = _row_steps(robot, step, start, states, stops, sticking, contacts)

    # With the Runge-Kutta method, a step that is too long explains errors of the energy.
    cause = step_text if integrator == 'rk4' else None
    limits = LimitWatch(robot, len(states), single, stops)
    balance = EnergyBalance(robot, step, states, integrator, start, single=single,
                            cause=cause, friction=rows)
    observers += [limits, balance]
    if robot.equations.tree.bristles and integrator == 'rk4':
        observers.append(SettlingWatch(robot, step, single))

    # Compute the states.
    steps = _steps(robot, states, single, step, count, every, torque, integrator, start,
                   progress is not None, rows)
    samples = run(steps, states, count, every, observers, progress)

    texts = [] if step_text is None else [step_text]
    for observer in reversed(observers):
        text = observer.warning()
        if text is not None:
            warnings.warn(text, ModelWarning, stacklevel=2)
            texts.append(text)

    # The quantities of the result, at the sampled states.
    arrays = steps.results(samples)
    if robot.equations.tree.bristles:
        arrays['bristles'] = np.ascontiguousarray(deflections_of(robot, samples.states))
    if single:
        arrays = {name: x[0] for name, x in arrays.items()}
    stop_events: tuple[StopEvent, ...] = ()
    contact_names: tuple[str, ...] = ()
    contact_events: tuple[ContactEvent, ...] = ()
    if rows is not None:
        stop_events = rows.events(single, StopEvent)
        contact_names = rows.contact_names
        contact_events = rows.events(single, ContactEvent)
    return Trajectory(start + samples.steps * np.float64(step), **arrays,
                      joint_names=robot.joint_names, limit_events=limits.events,
                      coordinate_names=robot.coordinate_names,
                      speed_names=robot.equations.speed_names,
                      bristle_names=robot.equations.tree.bristle_names,
                      constraint_names=robot.equations.mechanism.labels,
                      warnings=tuple(texts),
                      stop_events=stop_events, contact_names=contact_names,
                      contact_events=contact_events)


def _row_steps(robot: Robot, step: float, start: float, states: Array, stops: bool,
               sticking: bool, contacts: Any) -> RowSteps | None:
    """
    Return the steps of rows with modes; None without stops, friction and contacts.

    Raises
    ------
    InputError
        A contact is not valid, or is inside its surface; a joint is past its stop.

    """
    if not (stops or sticking or contacts):
        return None
    touching = checked_contacts(robot, contacts)
    require_open(robot, touching, states[:, :robot.n_q])
    if stops:
        require_stops(robot, states[:, :robot.n_q])
    rows = RowSteps(robot, step, start, stops, sticking, touching)
    return rows if rows.any_rows else None


def _steps(robot: Robot, states: Array, single: bool, step: float, count: int,
           every: int, torque: Any, integrator: str, start: float,
           in_time: bool, rows: RowSteps | None) -> Steps:
    """
    Return the steps of simulations from states, (N, size); arguments as of `simulate`.

    `in_time` says that progress is reported.
    """
    if callable(torque) and not single:
        raise InputError(f'torque: a function, with {len(states)} initial states; '
                         'expected None, an array or a ComputedTorque')
    # The torques, known before the steps or computed by a law within them.
    source = torque_input(robot, step, count, torque, None if single else len(states),
                          integrator, start, smooth=rows is None)

    # Constrained robots may need other independent speeds along the way.
    if robot.equations.watched:
        steps: Steps = ConstrainedSteps(source, rows, len(states))
    else:
        steps = Steps(source, rows)
    if callable(torque):
        return CallableSteps(steps, torque, every, in_time)
    return steps


def _require_arguments(robot: Any, progress: Any, integrator: Any, stops: Any,
                       sticking: Any) -> None:
    """Raise InputError for arguments of `simulate` of a wrong kind and limits that are NaN."""
    instance(robot, Robot, 'robot')
    if not robot.n_q:
        raise InputError('robot: no joints; expected at least one')
    if not (progress is None or callable(progress)):
        raise InputError(f'progress: {progress!r}; expected None or a function of the '
                         'time')
    if integrator is not None:
        integrator_of(integrator)
    # Numbers such as 1 are refused: they could be meant as a count or a time.
    for name, value in (('stops', stops), ('sticking', sticking)):
        if not isinstance(value, bool | np.bool_):
            raise InputError(f'{name}: {value!r}; expected True or False')

    # Infinite limits are legal, NaN would disable every comparison.
    for name, low, high in zip(robot.coordinate_names, robot.limits.lower,
                               robot.limits.upper):
        if math.isnan(low) or math.isnan(high):
            raise InputError(f"limits: of joint '{name}' {low:g} to {high:g}; expected "
                             'numbers, infinite where there is no limit')


def _checked_times(t0: Any, step: Any) -> tuple[float, float]:
    """Return the initial time and the step, s; InputError if times of steps would round."""
    # Times of steps are t0 + k step, whose rounding must stay far below a step.
    if isinstance(t0, bool | np.bool_):
        raise InputError(f't0: {t0!r}; expected a finite number, s')
    start = float(constant(t0, (), 't0 (s)', InputError))
    step = positive_time(step, 'step')
    spacing = float(np.spacing(abs(start)))
    if spacing > TIME_ROUNDING * step:
        raise InputError(f't0: {start:g} s, where floating-point times are {spacing:.2g} s '
                         f'apart; expected at most {TIME_ROUNDING:g} of the step of '
                         f'{step:g} s')
    return start, step


def initial_states(robot: Robot, q0: Any, u0: Any, t0: float,
                   bristles0: Any = None) -> Array:
    """Return the initial state or states, (size,) or (N, size), entries as `state_names`."""
    # Configurations and speeds: one of each, or as many of both.
    q = checked(Argument('q0', (robot.n_q,), robot.coordinate_names), q0)
    u = checked(Argument('u0', (robot.n,), robot.equations.speed_names), u0)
    if robot.model.balls:
        q = require_unit(robot.model, q, 'q0')
    if q.shape[:-1] != u.shape[:-1]:
        raise InputError(f'q0: shape {q.shape}, u0: shape {u.shape}; expected '
                         f'({robot.n_q},) and ({robot.n},), or (N, {robot.n_q}) and (N, '
                         f'{robot.n})')

    # Loops must be closed at the start, since the steps only keep them closed.
    if robot.equations.watched and q.size:
        rows = np.atleast_2d(q)
        time = robot.equations.time_inputs(np.full(len(rows), t0))
        kernel = robot.kernels.kernel('constraint_residual')
        residual = np.abs(kernel(rows, *time))
        # Lengths and angles are compared in units of their own; the message has those
        # of the row.
        in_units = residual / robot.mechanism.closure_units
        i, k = np.unravel_index(np.argmax(in_units), residual.shape)
        if in_units[i, k] > loosened(robot.mechanism, CLOSED):
            which = '' if q.ndim == 1 else f' of state {i}'
            raise InputError(f"q0{which}: the residual of '{robot.constraint_names[k]}' "
                             f'is {residual[i, k]:.3g} (m or rad); expected a closed '
                             'configuration, as robot.closed_configuration(q0)')

    # The entries of a state, of which some are absent: time, bristles, margin.
    layout = state_layout(robot)
    states = np.zeros((*q.shape[:-1], layout.size))
    states[..., layout.q] = q
    states[..., layout.v] = _joint_speeds(robot, q, u, t0)
    states[..., layout.time] = t0
    if bristles0 is not None:
        shape = states[..., layout.deflections].shape
        states[..., layout.deflections] = _stated_deflections(robot, bristles0, shape)
    states[..., layout.without_margin:] = 1.0
    return states


def _joint_speeds(robot: Robot, q: Array, u: Array, t0: float) -> Array:
    """Return the joint rates, (..., n_j), at initial configurations and speeds."""
    if robot.mechanism.in_joint_speeds:
        return u
    times = t0 if q.ndim == 1 else np.full(len(q), t0)
    rates: Array = joint_speeds(robot.model, q, robot.joint_rates(q, u, t=times))
    return rates


def _stated_deflections(robot: Robot, bristles0: Any, shape: tuple[int, ...]) -> Array:
    """Return stated deflections of bristles; InputError for a shape other than this one."""
    names = robot.equations.tree.bristle_names
    # A robot without bristles has nothing to start.
    if not names:
        raise InputError('bristles0: deflections for a robot without presliding_stiffness; '
                         'expected None')
    # One state, or one for each simulation.
    z = checked(Argument('bristles0', (len(names),), names), bristles0)
    if z.shape != shape and z.ndim > 1:
        single = (len(names),)
        expected = f'{single}' if shape == single else f'{single} or {shape}'
        raise InputError(f'bristles0: shape {z.shape}; expected {expected}')
    return np.broadcast_to(z, shape)


def whole_steps(name: str, value: float, step: float) -> int:
    """Return a time as a number of steps; InputError unless it is whole and in bounds."""
    # A quotient that overflows is no whole number of steps.
    count = round(value / step) if math.isfinite(value / step) else 0
    if count < 1 or abs(value / step - count) > 1e-6 * max(1, count):
        raise InputError(f'{name}: {value} s, {value / step:.6g} steps of {step} s; '
                         'expected a whole number of steps')
    if count > MOST_STEPS:
        raise InputError(f'{name}: {value} s, {count} steps of {step} s; expected at '
                         f'most {MOST_STEPS}')
    return count


def steps_per_sample(count: int, step: float, sample: Any, N: int, single: bool) -> int:
    """Return the number of steps between two rows; InputError for too many rows."""
    if sample is None:
        # By default as many rows as are useful, less if many simulations share the
        # memory.
        rows = max(2, min(DEFAULT_SAMPLES, MOST_SAMPLES // max(N, 1) - 1))
        every = max(1, -(-count // rows))
    else:
        every = whole_steps('sample', positive_time(sample, 'sample'), step)
    rows = count // every + 1

    # The rows of all simulations are allocated at once: a clear message instead of an
    # exhausted memory.
    if N * (rows + 1) > MOST_SAMPLES:
        which, together, remedy = '', '', 'a longer sample'
        if not single:
            which, together = f' for each of {N} initial states', ' together'
            remedy = 'a longer sample or fewer states'
        raise InputError(f'sample: {rows} rows{which}, from {count} steps sampled every '
                         f'{every}; expected at most {MOST_SAMPLES}{together}: {remedy}')
    return every


def compile_simulation(robot: Robot, integrator: str = 'rk4', *names: str) -> None:
    """
    Compile every kernel of `simulate` in advance, except those for many simulations at once.

    Computed torque is that of the joints that follow motions by default, if there are
    any. `names` are further quantities to compile concurrently.

    Raises
    ------
    InputError
        The integrator is unknown.

    """
    loops()  # of steps and of batches
    jobs: list[Callable[[], Any]] = [partial(step_kernel, robot, False, integrator)]
    with suppress(InputError):  # no joints follow by default
        followed = joints_that_follow(robot)
        jobs.append(partial(step_kernel, robot, True, integrator, None, followed))
        jobs.append(lambda: law_kernel(robot, followed).compile_lanes())
    jobs.append(partial(compile_balance, robot))
    for name in loop_kernels(robot):
        jobs.append(partial(robot.compile, name, batches=name in AFTERWARDS))
    jobs += [partial(robot.compile, name) for name in names]
    run_concurrently(jobs)


def loop_kernels(robot: Robot) -> list[str]:
    """Return the names of the kernels of control and simulation of this robot."""
    known = dict.fromkeys((*IN_LOOPS, *CONSTRAINED))
    return [name for name in known if name in robot.kernels.names]
