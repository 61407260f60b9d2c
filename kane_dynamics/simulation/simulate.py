"""
Forward simulation in native code.

One step of an integrator is traced with the robot's forward dynamics as a subroutine and compiled.
The kernel runs along a buffer of states, where each result is the argument of the next step; this
loop over time is native and releases the GIL. Many simulations run in SIMD lanes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
import time
from typing import Any
import warnings

from kane_dynamics._util.attribute_hints import hinting
from kane_dynamics._util.checks import constant, positive_time
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError, ModelWarning
from kane_dynamics.native.backends.real_types import size_limit
from kane_dynamics.robot.methods.configuration_methods import warn_of_degrees
from kane_dynamics.robot.parameters import JointLimits
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.deflection_watch import DeflectionWatch
from kane_dynamics.simulation.discontinuities import JumpWatch
from kane_dynamics.simulation.energy_balance import EnergyBalance, Impact
from kane_dynamics.simulation.limit_events import LimitEvents, LimitWatch
from kane_dynamics.simulation.simulation_arguments import (
    checked_torque, initial_states, MOST_STEPS, require_arguments, steps_per_sample, whole_steps)
from kane_dynamics.simulation.speed_switching import SwitchingInput
from kane_dynamics.simulation.step_kernels import state_names
from kane_dynamics.simulation.step_size import diverged_error, stable_integrator
from kane_dynamics.simulation.stops.joint_stops import JointStops, require_stops
from kane_dynamics.simulation.torque_input import evaluated_torque, torque_input
from kane_dynamics.simulation.trajectory import Trajectory
import numpy as np

CHUNK_SECONDS = 0.01  # of native code between two progress reports: half of the documented bound
CHUNK_BYTES = 2**27  # of states in one chunk, unless a single step of all takes more
FIRST_CHUNK = 256  # steps
LEAST_CHUNK = 8  # steps of many simulations, so that checks take less time than the steps

Torque = Callable[[float, Array, Array], Any]
Progress = Callable[[float], bool | None]


@hinting
def simulate(robot: Robot, q0: Any, u0: Any, duration: float, *, step: float = 1e-3,
             torque: Any = None, sample: float | None = None,
             progress: Progress | None = None, integrator: str | None = None,
             t0: float = 0.0, stops: bool = False) -> Trajectory:
    """
    Integrate the equations of motion with steps of one length.

    Conditions on positions, such as closed loops, are corrected by one Newton step after every
    step; the trajectory holds the remaining residuals. Independent speeds that become singular are
    replaced by others during the simulation (`Trajectory.speed_changes`), unless the user named
    them.

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
        None: zero torque. (n,): constant. (K, n) with at least one row per step: row k is held
        during step k. (N, K, n): a table for each of N initial states (other forms apply to all).
        ``torque(t, q, u)``: evaluated once a step and held; for a single initial state only,
        because Python would be called N times a step. `ComputedTorque`: evaluated continuously,
        with friction at the desired speed.
    sample : float, optional
        Time between the rows of the result, a whole number of steps. Default: about a thousand
        rows, or fewer if N initial states would give more than a million. The first and the last
        state are always included.
    progress : callable, optional
        Called with the simulated time at intervals of about 20 ms at most, or of eight steps of
        all N states if those take longer; returning False ends the simulation there.
    integrator : {'rk4', 'implicit'}, optional
        The fourth-order Runge-Kutta method; or a second-order Rosenbrock method whose step
        friction, springs and beams do not limit (`mechanics.integrators.rosenbrock`). The first
        is more accurate for smooth motions; the second is faster by orders of magnitude where
        joints stick. By default 'rk4' if the step is stable at the (first) initial
        configuration (`longest_step`), else 'implicit', with a warning that says so.
    t0 : float
        Initial time, s, for functions of time.
    stops : bool
        Put rigid, inelastic, frictionless stops at the position limits: the impulse of a stop
        ends the motion into it and acts on all joints, in the space of the motions that the
        constraints admit. `Trajectory.stop_events` lists the impacts; each takes about a
        millisecond. While a joint presses against its stop, the force of the stop holds it within
        the steps, at the cost of a few free steps and at the order of the integrator.

    Returns
    -------
    Trajectory
        Its arrays have a leading axis N for N initial states. Each simulation of N equals the
        single simulation from its initial state, to rounding.

    Raises
    ------
    InputError
        Names the argument, the value and what is expected; also if the motion diverges (is not
        finite), with the time and the joint.
    ConstraintError
        The motion comes to a kinematic singularity (a dead point); independent speeds that the
        user named become singular; constraints contradict each other; a loop's residual after
        one step is too large; or a user-defined function jumps or is not finite. Names the time,
        the constraint, and the configuration or the size of the jump.

    Warns
    -----
    ModelWarning
        An initial position looks like degrees (see the page on limits).
        The step is too long for the Runge-Kutta method with this friction, these springs or beams
        at the (first) initial configuration (`longest_step`): 'implicit' is chosen by default,
        and with 'rk4' the motion near rest is inaccurate.
        The error of the energy balance is above that expected of the step: names the time of its
        begin.
        A beam bends further than its equations are meant for: names the time, the beam, the
        deflection and the admissible one. All three are in `Trajectory.warnings` too.

    """
    require_arguments(robot, t0, progress, integrator)
    starts = initial_states(robot, q0, u0, t0 := float(constant(t0, (), 't0 (s)', InputError)))
    single, N = starts.ndim == 1, 1 if starts.ndim == 1 else len(starts)
    starts = starts.reshape(N, starts.shape[-1])
    step = positive_time(step, 'step')
    count = whole_steps('duration', positive_time(duration, 'duration'), step, MOST_STEPS)
    warn_of_degrees(robot, starts[:, :robot.n_q], 'q0', stacklevel=4)
    jumps = JumpWatch(robot, starts, t0, step, count, single)
    bends = DeflectionWatch(robot, starts, t0)
    integrator, step_text = stable_integrator(robot, starts[:1, :robot.n_q], step, integrator, t0)
    if step_text is not None:
        warnings.warn(step_text, ModelWarning, stacklevel=3)
    every = steps_per_sample(count, step, sample, N, single)
    if callable(torque) and not single:
        raise InputError(f'torque: a function, with {N} initial states; expected None, an array '
                         'or a ComputedTorque')
    source: Any = torque_input(robot, step, 1 if callable(torque) else count,
                               None if callable(torque) else torque, None if single else N,
                               integrator, t0)
    if not isinstance(stops, bool | np.bool_):
        raise InputError(f'stops: {stops!r}; expected True or False')
    if stops:
        require_stops(robot, starts[:, :robot.n_q])
        source = replace(source, stops=JointStops(robot, step, t0))
    watched = bool(robot.constraint_names)
    if watched:
        source = SwitchingInput(source, N, integrator, single)
    if callable(torque):
        kept, states, tau, events, balance = _run_callable(source, starts[0], count, every, torque,
                                                           progress, t0, integrator, jumps, bends)
    else:
        kept, states, events, balance = _run_native(source, starts, single, count, every,
                                                    progress, t0, integrator, jumps, bends)
    q, u, _ = (np.ascontiguousarray(part)
               for part in np.split(states, [robot.n_q, robot.n_q + robot.n], axis=2))
    if not callable(torque):
        tau = source.torques(kept, q, u)
    missed = balance.warning(single, step_text if integrator == 'rk4' else None)
    bent = bends.warning(single)
    for text in filter(None, (missed, bent)):
        warnings.warn(text, ModelWarning, stacklevel=3)
    arrays = {'q': q, 'u': u, 'tau': tau, **source.results(kept, states, tau)}
    arrays = {name: x[0] if single else x for name, x in arrays.items()}
    hits = source.stops.events(single) if source.stops is not None else ()
    return Trajectory(t0 + kept * np.float64(step), **arrays,
                      joint_names=robot.joint_names, limit_events=events,
                      coordinate_names=robot.coordinate_names,
                      speed_names=robot.speed_names, constraint_names=robot.constraint_names,
                      warnings=tuple(filter(None, (step_text, missed, bent))),
                      speed_changes=tuple(source.changes) if watched else (), stop_events=hits)


def _run_native(source: Any, starts: Array, single: bool, count: int, every: int,
                progress: Progress | None, t0: float, integrator: str, jumps: JumpWatch,
                bends: DeflectionWatch) -> tuple[Array, Array, LimitEvents, EnergyBalance]:
    """Step in native chunks; return the kept steps, their states, events, energy balance."""
    robot, (N, size) = source.robot, starts.shape
    kept = np.append(np.arange(0, count, every), count)
    states = np.empty((N, len(kept), size))
    states[:, 0] = starts
    most = max(1, CHUNK_BYTES // starts.nbytes) if N else count
    done, least = 0, 1 if single else LEAST_CHUNK
    chunk = FIRST_CHUNK if single else LEAST_CHUNK
    watch = LimitWatch(robot.joint_names, _watched(source), starts, single,
                       robot.coordinate_names)
    balance = EnergyBalance(robot, source.step, starts, integrator, t0)
    while done < count:
        chunk = min(chunk, most, count - done)
        buffer = np.empty((N, chunk + 1, size))
        buffer[:, 0] = starts
        jumps.look_ahead(done, chunk)
        started = time.perf_counter()
        extremes = source.advance(buffer, done, single)
        took = time.perf_counter() - started
        t = t0 + (done + np.arange(1, chunk + 1)) * np.float64(source.step)
        bends.look(buffer[:, 1:], t, extremes)
        _finite(robot, buffer, done, source.step, single, bends)
        jumps.look_back(buffer, done)
        watch.look(buffer[:, 1:], t, extremes)
        balance.look(source.in_own_speeds(buffer, done), done, source.acting(buffer, done),
                     _impacts(source, done))
        here = slice(*np.searchsorted(kept, [done + 1, done + chunk + 1]))
        states[:, here] = buffer[:, kept[here] - done]
        starts = buffer[:, -1].copy()
        done += chunk
        if progress is not None and progress(t0 + done * source.step) is False:
            break
        chunk = max(least, min(4 * chunk, int(chunk * CHUNK_SECONDS / max(took, 1e-9))))
    return (*_ended(kept, states, done, starts), watch.events, balance)


def _ended(kept: Array, states: Array, done: int, last: Array) -> tuple[Array, Array]:
    """Return steps and states up to the end of a simulation, including its last state."""
    rows = int(np.searchsorted(kept, done, side='right'))
    if kept[rows - 1] < done:
        kept[rows], states[:, rows], rows = done, last, rows + 1
    return kept[:rows], states[:, :rows]


def _run_callable(source: Any, state: Array, count: int, every: int, torque: Torque,
                  progress: Progress | None, t0: float, integrator: str, jumps: JumpWatch,
                  bends: DeflectionWatch
                  ) -> tuple[Array, Array, Array, LimitEvents, EnergyBalance]:
    """Step with a Python torque function, evaluated before every step."""
    robot, step = source.robot, source.step
    n_q, n = robot.n_q, robot.n
    kept, states, taus = [], [], []
    watch = LimitWatch(robot.joint_names, _watched(source), state[None], True,
                       robot.coordinate_names)
    buffer = np.empty((1, FIRST_CHUNK + 1, len(state)))
    buffer[0, 0] = state
    asked = np.empty((1, FIRST_CHUNK, n))
    balance = EnergyBalance(robot, step, state[None], integrator, t0)
    reported = time.perf_counter()
    for k in range(count + 1):
        j = k % FIRST_CHUNK
        if j == 0 and k < count:
            jumps.look_ahead(k, min(FIRST_CHUNK, count - k))
        state = buffer[0, j].copy()
        t = t0 + k * step
        seen = (source.user_state(0, state, k) if isinstance(source, SwitchingInput) else
                (state[:n_q], state[n_q:n_q + n]))
        tau = checked_torque(robot, f'torque at {t:.6g} s',
                             evaluated_torque(torque, t, *(x.copy() for x in seen)))
        if k % every == 0 or k == count:
            kept.append(k)
            states.append(state)
            taus.append(tau)
        if k == count:
            break
        here, asked[0, j] = buffer[:, j:j + 2], tau
        if isinstance(source, SwitchingInput):
            source.torque = tau[None, None]
            source.advance(here, k, single=True)
        else:
            replace(source, torque=tau[None, None]).advance(here, k, single=True)
        if _diverged(robot, here[:, -1]).any():
            bends.look(buffer[:, 1:j + 2], t0 + np.arange(k - j + 1, k + 2) * step)
            _finite(robot, here, k, step, True, bends)
        if progress is not None and time.perf_counter() - reported > CHUNK_SECONDS:
            reported = time.perf_counter()
            if progress(t0 + (k + 1) * step) is False:
                count = k + 1
        if j + 1 == FIRST_CHUNK or k + 1 == count:
            jumps.look_back(buffer[:, :j + 2], k - j)
            times = t0 + np.arange(k - j + 1, k + 2) * np.float64(step)
            bends.look(buffer[:, 1:j + 2], times)
            watch.look(buffer[:, 1:j + 2], times)
            balance.look(source.in_own_speeds(buffer[:, :j + 2], k - j), k - j,
                         asked[:, :j + 1], _impacts(source, k - j))
            buffer[:, 0] = buffer[:, j + 1]
    return np.array(kept), np.array([states]), np.array([taus]), watch.events, balance


def _impacts(source: Any, done: int) -> Sequence[Impact]:
    """Return the energies lost in stops during the steps after `done`."""
    return () if source.stops is None else source.stops.settle(done)


def _watched(source: Any) -> JointLimits:
    """Return the limits to watch: of speeds in joint rates only, of positions without stops."""
    robot: Robot = source.robot
    limits, none = robot.limits, np.full(robot.n_q, np.inf)
    if source.stops is not None:
        limits = replace(limits, lower=-none, upper=none)
    return limits if robot.speed_names == robot.joint_names else replace(
        limits, velocity=np.full(robot.model.n, np.inf))


def _diverged(robot: Robot, states: Array) -> Any:
    """Return which entries of states are not finite, or positions that are too large."""
    most = np.full(states.shape[-1], np.finfo(float).max)
    most[:robot.n_q] = size_limit('q')
    return ~(np.abs(states) <= most)


def _finite(robot: Robot, buffer: Array, done: int, step: float, single: bool,
            bends: DeflectionWatch) -> None:
    """Raise InputError for a diverged motion (not finite, or positions too large); it stays so."""
    if not _diverged(robot, buffer[:, -1]).any():
        return
    at = _diverged(robot, buffer)
    k = int(np.argmax(at.any(axis=(0, 2))))
    i, j = (int(index) for index in np.argwhere(at[:, k])[0])
    which = 'the simulation' if single else f'simulation {i}'
    value = float(buffer[i, k, j])
    raise diverged_error(which, (done + k) * step, step, state_names(robot)[j], value,
                         bends.warning(single))
