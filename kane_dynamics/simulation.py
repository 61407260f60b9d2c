"""
Forward simulation in native code.

One Runge-Kutta step is traced with the robot's forward dynamics as a subroutine and compiled.
Its result is the next step's argument, so that calling the kernel along a buffer of states is the
loop over time, without the GIL.
"""

from collections.abc import Callable
from dataclasses import dataclass
import math
import time
from typing import Any

from kane_dynamics.control import ComputedTorque
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.integration import runge_kutta_4
from kane_dynamics.model import Array
from kane_dynamics.native.entry import repeat
from kane_dynamics.native.expression import call
from kane_dynamics.native.kernels import Argument, checked, Kernel
from kane_dynamics.native.program import Program, trace_program
from kane_dynamics.robot import Robot
from kane_dynamics.trajectory import LimitEvent, Trajectory
import numpy as np

MOST_STEPS = 100_000_000
MOST_SAMPLES = 1_000_000
DEFAULT_SAMPLES = 1000
CHUNK_SECONDS = 0.01  # of native code between two looks at progress: half of the promised bound
FIRST_CHUNK = 256

Torque = Callable[[float, Array, Array], Any]
Progress = Callable[[float], bool | None]


@dataclass
class _Run:
    """One simulation on its way: the native step, its inputs a step, and what is kept."""

    robot: Robot
    kernel: Kernel
    constants: Array  # the kernel's block: gains and h, then the robot's parameters
    step: float
    inputs: Array  # one row a step; a single row serves all steps
    input_stride: int  # bytes from one step's input to the next


def simulate(robot: Robot, q0: Any, u0: Any, duration: float, *, step: float = 1e-3,
             torque: Any = None, sample: float | None = None,
             progress: Progress | None = None) -> Trajectory:
    """
    Integrate the equations of motion with the fourth-order Runge-Kutta method.

    Parameters
    ----------
    robot : Robot
        Whose equations to integrate.
    q0, u0 : (n,) array_like
        State at time 0; rad or m, and s.
    duration : float
        s; a whole number of steps.
    step : float
        s.
    torque : None, array, callable or ComputedTorque
        Nothing: zero torque. (n,): constant. (K, n) with at least one row a step: row k is held
        during step k. ``torque(t, q, u)``: asked once a step and held. `ComputedTorque`:
        evaluated continuously, with friction at the desired speed.
    sample : float, optional
        Time between the rows of the result, a whole number of steps. Default: about a thousand
        rows. First and last state are always in.
    progress : callable, optional
        Called with the simulated time now and then (native code never runs for more than about
        20 ms in between); returning False ends the simulation there.

    Returns
    -------
    Trajectory

    Raises
    ------
    InputError
        Names the argument, the value and what is valid; also where the motion leaves the finite
        numbers, with the time and the joint.

    """
    state = np.concatenate([_vector(robot, 'q0', q0), _vector(robot, 'u0', u0)])
    step = _positive('step', step)
    count = _whole('duration', _positive('duration', duration), step, MOST_STEPS)
    every = (max(1, -(-count // DEFAULT_SAMPLES)) if sample is None
             else _whole('sample', _positive('sample', sample), step, MOST_STEPS))
    if count // every + 2 > MOST_SAMPLES:
        raise InputError(f'{count} steps sampled every {every} would give {count // every + 1} '
                         f'rows; at most {MOST_SAMPLES}: choose a longer sample time')
    if callable(torque):
        kept, states, taus, events = _run_callable(robot, state, count, step, every, torque,
                                                   progress)
    else:
        run = _prepared(robot, step, count, torque)
        kept, states, events = _run_native(run, state, count, every, progress)
        taus = _torques(robot, torque, run, kept, states)
    n = robot.n
    q, u = np.ascontiguousarray(states[:, :n]), np.ascontiguousarray(states[:, n:])
    energy = np.stack([robot.kinetic_energy(q, u), robot.potential_energy(q)], axis=1)
    return Trajectory(kept * step, q, u, robot.forward_dynamics(q, u, taus), taus, energy,
                      robot.joint_names, tuple(events))


def _prepared(robot: Robot, step: float, count: int, torque: Any) -> _Run:
    """Compile the step for a torque source and lay out its inputs."""
    if isinstance(torque, ComputedTorque):
        if torque.motion.joint_names != robot.joint_names:
            raise InputError(f'the motion is of the joints {list(torque.motion.joint_names)}; '
                             f'expected {list(robot.joint_names)}')
        halves: Array = np.arange(2 * count + 1) * np.float64(0.5 * step)
        inputs = np.concatenate(torque.motion.sample(halves), axis=1)
        kernel = _kernel(robot, 'step_computed_torque', 3, [torque.kp, torque.kd])
        constants = np.concatenate([torque.kp, torque.kd, [step], robot.parameters.block])
        return _Run(robot, kernel, constants, step, inputs, 2 * inputs.strides[0])
    inputs = _table(robot, torque, count)
    constants = np.concatenate([[step], robot.parameters.block])
    kernel = _kernel(robot, 'step_held_torque', 1, [])
    return _Run(robot, kernel, constants, step, inputs,
                inputs.strides[0] if len(inputs) > 1 else 0)


def _kernel(robot: Robot, name: str, rows: int, gains: list[Array]) -> Kernel:
    """Return the kernel of one step: state and rows of inputs in, next state out."""
    n = robot.n
    width = n if rows == 1 else 3 * n
    arguments = [Argument('state', (2 * n,)), Argument('inputs', (rows, width))]
    block = np.zeros(len(gains) * n + 1 + len(robot.parameters.block))
    return robot.kernels.extra(name, lambda: _step_program(robot, name, rows, len(gains)),
                               arguments, block, (2 * n,))


def _step_program(robot: Robot, name: str, rows: int, n_gains: int) -> Program:
    """Trace one step, with the robot's dynamics as subroutines."""
    n = robot.n
    forward = robot.kernels.program('forward_dynamics')
    no_wrench = robot.kernels.no_wrench
    wrench = [no_wrench] if len(no_wrench) else []
    rigid = robot.kernels.rigid_program() if n_gains else None

    def step(state: Any, inputs: Any, constants: Any) -> Any:
        gains, h, parameters = np.split(constants, [n_gains * n, n_gains * n + 1])

        def udot(q: Any, u: Any, given: Any) -> Any:
            tau = given
            if rigid is not None:
                (kp, kd), (q_d, u_d, udot_d) = np.split(gains, 2), np.split(given, 3)
                wanted = udot_d + kd * (u_d - u) + kp * (q_d - q)
                tau = (np.array(call(rigid, q, u, wanted, *wrench, parameters))
                       + robot.equations.friction_force(u_d))
            return np.array(call(forward, q, u, tau, *wrench, parameters))
        moments = (inputs[0], inputs[0], inputs[0]) if rows == 1 else inputs
        q, u = runge_kutta_4(udot, state[:n], state[n:], moments, h[0])
        return np.concatenate([q, u])
    width = n if rows == 1 else 3 * n
    block = n_gains * n + 1 + len(robot.parameters.block)
    return trace_program(name, step, [('state', (2 * n,)), ('inputs', (rows, width)),
                                      ('constants', (block,))])


def _run_native(run: _Run, state: Array, count: int, every: int,
                progress: Progress | None) -> tuple[Array, Array, list[LimitEvent]]:
    """Step in native chunks; return the kept step numbers, their states, and the events."""
    kept, states, done, chunk = [0], [state], 0, FIRST_CHUNK
    watch = _LimitWatch(run.robot, state)
    while done < count:
        chunk = min(chunk, count - done)
        buffer = np.empty((chunk + 1, len(state)))
        buffer[0] = state
        row = run.inputs.ctypes.data + done * run.input_stride
        started = time.perf_counter()
        repeat(run.kernel.address,
               [buffer.ctypes.data, row, run.constants.ctypes.data, buffer[1:].ctypes.data],
               [buffer.strides[0], run.input_stride, 0, buffer.strides[0]], chunk)
        took = time.perf_counter() - started
        _finite(run.robot, buffer, done, run.step)
        numbers = done + np.arange(1, chunk + 1)
        watch.look(buffer[1:], numbers * np.float64(run.step))
        chosen = (numbers % every == 0) | (numbers == count)
        kept.extend(numbers[chosen].tolist())
        states.extend(buffer[1:][chosen])
        state = buffer[-1].copy()
        done += chunk
        if progress is not None and progress(done * run.step) is False:
            break
        chunk = max(1, min(4 * chunk, int(chunk * CHUNK_SECONDS / max(took, 1e-9))))
    if kept[-1] != done:
        kept.append(done)
        states.append(state)
    return np.array(kept), np.array(states), watch.events


def _run_callable(robot: Robot, state: Array, count: int, step: float, every: int,
                  torque: Torque, progress: Progress | None
                  ) -> tuple[Array, Array, Array, list[LimitEvent]]:
    """Ask for the torque before every step; Python in the loop."""
    n = robot.n
    run = _prepared(robot, step, 1, np.zeros(n))
    kept, states, taus = [], [], []
    watch = _LimitWatch(robot, state)
    reported = time.perf_counter()
    for k in range(count + 1):
        tau = _vector(robot, f'torque at {k * step:.6g} s',
                      torque(k * step, state[:n].copy(), state[n:].copy()))
        if k % every == 0 or k == count:
            kept.append(k)
            states.append(state)
            taus.append(tau)
        if k == count:
            break
        after = np.empty_like(state)
        repeat(run.kernel.address, [state.ctypes.data, tau.ctypes.data,
                                    run.constants.ctypes.data, after.ctypes.data], [0] * 4, 1)
        _finite(robot, np.stack([state, after]), k, step)
        watch.look(after[None], np.array([(k + 1) * step]))
        state = after
        if progress is not None and time.perf_counter() - reported > CHUNK_SECONDS:
            reported = time.perf_counter()
            if progress((k + 1) * step) is False:
                break
    return np.array(kept), np.array(states), np.array(taus), watch.events


def _torques(robot: Robot, torque: Any, run: _Run, kept: Array, states: Array) -> Array:
    """Return the torques that acted at the kept steps, (K, n)."""
    n = robot.n
    if not isinstance(torque, ComputedTorque):
        rows = np.minimum(kept, len(run.inputs) - 1)
        return np.ascontiguousarray(run.inputs[rows])
    q, u = np.ascontiguousarray(states[:, :n]), np.ascontiguousarray(states[:, n:])
    q_d, u_d, udot_d = np.split(run.inputs[2 * kept], 3, axis=1)
    wanted = udot_d + torque.kd * (u_d - u) + torque.kp * (q_d - q)
    return (robot.inverse_dynamics(q, u, wanted) - robot.friction_force(u)
            + robot.friction_force(u_d))


class _LimitWatch:
    """Finds the steps at which a joint passes a limit that it kept before."""

    def __init__(self, robot: Robot, state: Array) -> None:
        self.events: list[LimitEvent] = []
        self._names, limits, n = robot.joint_names, robot.limits, robot.n
        self._bounds = {
            'lower': (slice(0, n), limits.lower, -1.0),
            'upper': (slice(0, n), limits.upper, 1.0),
            'velocity': (slice(n, 2 * n), limits.velocity, 0.0)}
        self._beyond = {name: np.zeros(n, dtype=bool) for name in self._bounds}
        self.look(state[None], np.zeros(1))

    def look(self, states: Array, t: Array) -> None:
        """Add the crossings among further states (K, 2 n) at times t (K,)."""
        found = []
        for name, (part, bound, sign) in self._bounds.items():
            x = states[:, part]
            beyond = (np.abs(x) if sign == 0.0 else sign * x) > (bound if sign == 0.0
                                                                 else sign * bound)
            before = np.concatenate([self._beyond[name][None], beyond[:-1]])
            found += [LimitEvent(float(t[k]), self._names[j], name, float(x[k, j]),
                                 float(bound[j])) for k, j in np.argwhere(beyond & ~before)]
            self._beyond[name] = beyond[-1]
        self.events += sorted(found, key=lambda event: event.t)


def _vector(robot: Robot, name: str, value: Any) -> Array:
    array = checked(Argument(name, (robot.n,), robot.coordinate_names), value)
    if array.ndim != 1:
        raise InputError(f'{name} has shape {array.shape}; expected ({robot.n},)')
    return array


def _table(robot: Robot, torque: Any, count: int) -> Array:
    """Return a torque given as None, (n,) or (K, n) as rows, (1, n) serving all steps."""
    if torque is None:
        return np.zeros((1, robot.n))
    table = checked(Argument('torque', (robot.n,), robot.coordinate_names), torque)
    if table.ndim == 1:
        return table[None].copy()
    if len(table) < count:
        raise InputError(f'torque has {len(table)} rows; expected at least {count}, one a step')
    return table


def _positive(name: str, value: Any) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not (math.isfinite(number) and number > 0.0):
        raise InputError(f'{name} is {value!r}; expected a positive, finite time in s')
    return number


def _whole(name: str, value: float, step: float, most: int) -> int:
    """Return how many steps a time is; InputError unless that is a whole number in bounds."""
    count = round(value / step)
    if count < 1 or abs(value / step - count) > 1e-6 * max(1, count):
        raise InputError(f'{name} is {value} s, {value / step:.6g} steps of {step} s; expected a '
                         'whole number of steps')
    if count > most:
        raise InputError(f'{name} is {value} s, {count} steps of {step} s; at most {most} steps')
    return count


def _finite(robot: Robot, buffer: Array, done: int, step: float) -> None:
    """Raise where the motion has left the finite numbers."""
    if np.isfinite(buffer[-1]).all():
        return
    k = int(np.argmax(~np.isfinite(buffer).all(axis=1)))
    j = int(np.argmax(~np.isfinite(buffer[k]))) % robot.n
    raise InputError(f'the simulation leaves the finite numbers at {(done + k) * step:.6g} s, '
                     f"joint '{robot.joint_names[j]}' first: is the mass matrix singular there, "
                     f'or the step of {step} s too long?')
