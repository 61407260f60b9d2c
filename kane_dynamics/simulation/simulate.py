"""
Forward simulation in native code.

One step of an integrator is traced with the robot's forward dynamics as a subroutine and compiled.
Its result is the next step's argument, so that calling the kernel along a buffer of states is the
loop over time, without the GIL. Many simulations go through it several at once.
"""

from collections.abc import Callable
from dataclasses import replace
import time
from typing import Any
import warnings

from kane_dynamics._util.checks import constant, positive_time
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError, ModelWarning
from kane_dynamics.robot.parameters import JointLimits
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.energy_balance import EnergyBalance
from kane_dynamics.simulation.limit_events import LimitEvents, LimitWatch
from kane_dynamics.simulation.simulation_arguments import (
    checked_torque, initial_states, MOST_STEPS, steps_per_sample, whole_steps)
from kane_dynamics.simulation.speed_switching import SwitchingInput
from kane_dynamics.simulation.step_kernels import state_names
from kane_dynamics.simulation.step_size import diverged_error, step_warning
from kane_dynamics.simulation.torque_input import evaluated_torque, torque_input
from kane_dynamics.simulation.trajectory import Trajectory
import numpy as np

CHUNK_SECONDS = 0.01  # of native code between two looks at progress: half of the promised bound
CHUNK_BYTES = 2**27  # of states between two looks, unless a single step of all takes more
FIRST_CHUNK = 256  # steps
LEAST_CHUNK = 8  # steps of many simulations, lest the looks take longer than the steps

Torque = Callable[[float, Array, Array], Any]
Progress = Callable[[float], bool | None]


def simulate(robot: Robot, q0: Any, u0: Any, duration: float, *, step: float = 1e-3,
             torque: Any = None, sample: float | None = None,
             progress: Progress | None = None, integrator: str = 'rk4',
             t0: float = 0.0) -> Trajectory:
    """
    Integrate the equations of motion with steps of one length.

    Conditions on positions, such as closed loops, are held: what a step misses is taken back after
    it, and the result tells what remains. Independent speeds that come to depend on each other
    give way to others on the way (`Trajectory.speed_changes`), unless the user named them.

    Parameters
    ----------
    robot : Robot
        Whose equations to integrate.
    q0, u0 : (n_q,), (n,) or (N, n_q), (N, n) array_like
        State at time 0, or N of them, each the start of a simulation; rad or m, and s.
    duration : float
        s; a whole number of steps.
    step : float
        s.
    torque : None, array, callable or ComputedTorque
        Nothing: zero torque. (n,): constant. (K, n) with at least one row a step: row k is held
        during step k. (N, K, n): a table for each of N initial states (the others serve all).
        ``torque(t, q, u)``: asked once a step and held; for a single initial state only, because
        Python would be called N times a step. `ComputedTorque`: evaluated continuously, with
        friction at the desired speed.
    sample : float, optional
        Time between the rows of the result, a whole number of steps. Default: about a thousand
        rows, or fewer where N initial states would then give more than a million. First and last
        state are always in.
    progress : callable, optional
        Called with the simulated time now and then (native code never runs for more than about
        20 ms in between, or eight steps of all N states); returning False ends the simulation
        there.
    integrator : {'rk4', 'implicit'}
        The fourth-order Runge-Kutta method; or a second-order Rosenbrock method to which
        friction, springs and beams set no longest step, for robots without constraints whose
        speeds are the joint rates (`mechanics.implicit`). Where the motion is smooth the first
        is more accurate; where joints stick, the second is the faster by orders.
    t0 : float
        Time at which the state is q0, u0, s: what depends on time begins there.

    Returns
    -------
    Trajectory
        Its arrays lead with N where N initial states are given. A simulation among N has the
        numbers that it has alone, to rounding; they do not depend on the other N - 1.

    Raises
    ------
    InputError
        Names the argument, the value and what is valid; also where the motion leaves the finite
        numbers, with the time and the joint.
    ConstraintError
        The motion comes to a kinematic singularity (a dead point); independent speeds that the
        user named become singular; constraints contradict each other; or a step opens a loop too
        far. Names the time, the configuration and the constraint.

    Warns
    -----
    ModelWarning
        The step is too long for the Runge-Kutta method with this friction, these springs or beams
        at the (first) initial posture: the motion near rest is not to be trusted (`longest_step`).
        The energy balance does not close within what the step explains: names the time at which
        that began. Both are in `Trajectory.warnings` too.

    """
    starts = initial_states(robot, q0, u0, t0 := float(constant(t0, (), 't0 (s)', InputError)))
    single, N = starts.ndim == 1, 1 if starts.ndim == 1 else len(starts)
    starts = starts.reshape(N, starts.shape[-1])
    step = positive_time(step, 'step')
    count = whole_steps('duration', positive_time(duration, 'duration'), step, MOST_STEPS)
    doubt = step_warning(robot, starts[0, :robot.n_q], step, integrator, t0) if N else None
    if doubt is not None:
        warnings.warn(doubt, ModelWarning, stacklevel=2)
    every = steps_per_sample(count, step, sample, N, single)
    if callable(torque) and not single:
        raise InputError('torque is a function, which is asked state by state; for '
                         f'{N} initial states give None, an array or a ComputedTorque')
    source: Any = torque_input(robot, step, 1 if callable(torque) else count,
                               None if callable(torque) else torque, None if single else N,
                               integrator, t0)
    watched = bool(robot.constraint_names)
    if watched:
        source = SwitchingInput(source, N, integrator, single)
    if callable(torque):
        kept, states, tau, events, balance = _run_callable(source, starts[0], count, every, torque,
                                                           progress, t0, integrator)
    else:
        kept, states, events, balance = _run_native(source, starts, single, count, every,
                                                    progress, t0, integrator)
    q, u, _ = (np.ascontiguousarray(part)
               for part in np.split(states, [robot.n_q, robot.n_q + robot.n], axis=2))
    if not callable(torque):
        tau = source.torques(kept, q, u)
    missed = balance.warning(single, doubt)
    if missed is not None:
        warnings.warn(missed, ModelWarning, stacklevel=2)
    arrays = {'q': q, 'u': u, 'tau': tau, **source.results(kept, states, tau)}
    arrays = {name: x[0] if single else x for name, x in arrays.items()}
    return Trajectory(t0 + kept * np.float64(step), **arrays,
                      joint_names=robot.joint_names, limit_events=events,
                      speed_names=robot.speed_names, constraint_names=robot.constraint_names,
                      warnings=tuple(text for text in (doubt, missed) if text is not None),
                      speed_changes=tuple(source.changes) if watched else ())


def _run_native(source: Any, starts: Array, single: bool, count: int, every: int,
                progress: Progress | None, t0: float, integrator: str
                ) -> tuple[Array, Array, LimitEvents, EnergyBalance]:
    """Step in native chunks; return the kept steps, their states, events, energy balance."""
    robot, (N, size) = source.robot, starts.shape
    kept = np.append(np.arange(0, count, every), count)
    states = np.empty((N, len(kept), size))
    states[:, 0] = starts
    most = max(1, CHUNK_BYTES // starts.nbytes) if N else count
    done, least = 0, 1 if single else LEAST_CHUNK
    chunk = FIRST_CHUNK if single else LEAST_CHUNK
    watch = LimitWatch(robot.joint_names, _watched(robot), starts, single)
    balance = EnergyBalance(robot, source.step, starts, integrator, t0)
    while done < count:
        chunk = min(chunk, most, count - done)
        buffer = np.empty((N, chunk + 1, size))
        buffer[:, 0] = starts
        started = time.perf_counter()
        extremes = source.advance(buffer, done, single)
        took = time.perf_counter() - started
        _finite(robot, buffer, done, source.step, single)
        watch.look(buffer[:, 1:],
                   t0 + (done + np.arange(1, chunk + 1)) * np.float64(source.step),
                   extremes)
        balance.look(source.in_own_speeds(buffer, done), done, source.acting(buffer, done))
        here = slice(*np.searchsorted(kept, [done + 1, done + chunk + 1]))
        states[:, here] = buffer[:, kept[here] - done]
        starts = buffer[:, -1].copy()
        done += chunk
        if progress is not None and progress(t0 + done * source.step) is False:
            break
        chunk = max(least, min(4 * chunk, int(chunk * CHUNK_SECONDS / max(took, 1e-9))))
    return (*_ended(kept, states, done, starts), watch.events, balance)


def _ended(kept: Array, states: Array, done: int, last: Array) -> tuple[Array, Array]:
    """Leave out the rows that a simulation ended early did not reach; its end is in."""
    rows = int(np.searchsorted(kept, done, side='right'))
    if kept[rows - 1] < done:
        kept[rows], states[:, rows], rows = done, last, rows + 1
    return kept[:rows], states[:, :rows]


def _run_callable(source: Any, state: Array, count: int, every: int, torque: Torque,
                  progress: Progress | None, t0: float, integrator: str
                  ) -> tuple[Array, Array, Array, LimitEvents, EnergyBalance]:
    """Ask for the torque before every step; Python in the loop."""
    robot, step = source.robot, source.step
    n_q, n = robot.n_q, robot.n
    kept, states, taus = [], [], []
    watch = LimitWatch(robot.joint_names, _watched(robot), state[None], single=True)
    buffer = np.empty((1, FIRST_CHUNK + 1, len(state)))
    buffer[0, 0] = state
    asked = np.empty((1, FIRST_CHUNK, n))
    balance = EnergyBalance(robot, step, state[None], integrator, t0)
    reported = time.perf_counter()
    for k in range(count + 1):
        j = k % FIRST_CHUNK
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
        _finite(robot, here, k, step, single=True)
        if progress is not None and time.perf_counter() - reported > CHUNK_SECONDS:
            reported = time.perf_counter()
            if progress(t0 + (k + 1) * step) is False:
                count = k + 1
        if j + 1 == FIRST_CHUNK or k + 1 == count:
            watch.look(buffer[:, 1:j + 2],
                       t0 + np.arange(k - j + 1, k + 2) * np.float64(step))
            balance.look(source.in_own_speeds(buffer[:, :j + 2], k - j), k - j,
                         asked[:, :j + 1])
            buffer[:, 0] = buffer[:, j + 1]
    return np.array(kept), np.array([states]), np.array([taus]), watch.events, balance


def _watched(robot: Robot) -> JointLimits:
    """Return the limits that a state shows: speeds of joints are in it where they are u."""
    if robot.speed_names == robot.joint_names:
        return robot.limits
    return replace(robot.limits, velocity=np.full(robot.n_q, np.inf))


def _finite(robot: Robot, buffer: Array, done: int, step: float, single: bool) -> None:
    """Raise where a motion has left the finite numbers; it never comes back."""
    if np.isfinite(buffer[:, -1]).all():
        return
    at = ~np.isfinite(buffer)
    k = int(np.argmax(at.any(axis=(0, 2))))
    i, j = (int(index) for index in np.argwhere(at[:, k])[0])
    which = 'the simulation' if single else f'simulation {i}'
    raise diverged_error(which, (done + k) * step, step, state_names(robot)[j])
