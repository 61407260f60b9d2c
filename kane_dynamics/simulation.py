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
from kane_dynamics.model import Array
from kane_dynamics.native.kernels import Argument, checked, Kernel
from kane_dynamics.native.support import repeat
from kane_dynamics.robot import Robot
from kane_dynamics.stepping import step_kernel
from kane_dynamics.trajectory import LimitEvent, LimitWatch, Trajectory
import numpy as np

MOST_STEPS = 100_000_000
MOST_SAMPLES = 1_000_000
DEFAULT_SAMPLES = 1000
CHUNK_SECONDS = 0.01  # of native code between two looks at progress: half of the promised bound
FIRST_CHUNK = 256

Torque = Callable[[float, Array, Array], Any]
Progress = Callable[[float], bool | None]


@dataclass(frozen=True)
class _Source:
    """A native step and where its inputs come from."""

    kernel: Kernel
    step: float
    constants: Array  # gains and step, then the robot's parameters
    torque: Any  # ComputedTorque, or rows of torques; a single row serves all steps

    def inputs(self, done: int, count: int) -> tuple[Array, int]:
        """Return the inputs of `count` steps from `done` on, and their stride in bytes."""
        if isinstance(self.torque, ComputedTorque):
            halves: Array = np.arange(2 * done, 2 * (done + count) + 1) * np.float64(
                0.5 * self.step)
            rows = np.concatenate(self.torque.motion.sample(halves), axis=1)
            return rows, 2 * rows.strides[0]
        if len(self.torque) == 1:
            return self.torque, 0
        return self.torque[done:], self.torque.strides[0]


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
        source = _source(robot, step, count, torque)
        kept, states, events = _run_native(robot, source, state, count, every, progress)
        taus = _torques(robot, source, kept, states)
    n = robot.n
    q, u = np.ascontiguousarray(states[:, :n]), np.ascontiguousarray(states[:, n:])
    energy = np.stack([robot.kinetic_energy(q, u), robot.potential_energy(q)], axis=1)
    return Trajectory(kept * step, q, u, robot.forward_dynamics(q, u, taus), taus, energy,
                      robot.joint_names, tuple(events))


def _source(robot: Robot, step: float, count: int, torque: Any) -> _Source:
    """Compile the step for a torque source and lay out its inputs."""
    block = robot.parameters.block
    if isinstance(torque, ComputedTorque):
        if torque.motion.joint_names != robot.joint_names:
            raise InputError(f'the motion is of the joints {list(torque.motion.joint_names)}; '
                             f'expected {list(robot.joint_names)}')
        return _Source(step_kernel(robot, feedback=True), step,
                       np.concatenate([torque.kp, torque.kd, [step], block]), torque)
    table = _table(robot, torque, count)
    return _Source(step_kernel(robot, feedback=False), step, np.concatenate([[step], block]),
                   table)


def _run_native(robot: Robot, source: _Source, state: Array, count: int, every: int,
                progress: Progress | None) -> tuple[Array, Array, list[LimitEvent]]:
    """Step in native chunks; return the kept step numbers, their states, and the events."""
    kept, states, done, chunk = [0], [state], 0, FIRST_CHUNK
    watch = LimitWatch(robot.joint_names, robot.limits, state)
    while done < count:
        chunk = min(chunk, count - done)
        buffer = np.empty((chunk + 1, len(state)))
        buffer[0] = state
        started = time.perf_counter()
        rows, stride = source.inputs(done, chunk)
        repeat(source.kernel.address,
               [buffer.ctypes.data, rows.ctypes.data, source.constants.ctypes.data,
                buffer[1:].ctypes.data],
               [buffer.strides[0], stride, 0, buffer.strides[0]], chunk)
        took = time.perf_counter() - started
        _finite(robot, buffer, done, source.step)
        numbers = done + np.arange(1, chunk + 1)
        watch.look(buffer[1:], numbers * np.float64(source.step))
        chosen = (numbers % every == 0) | (numbers == count)
        kept.extend(numbers[chosen].tolist())
        states.extend(buffer[1:][chosen])
        state = buffer[-1].copy()
        done += chunk
        if progress is not None and progress(done * source.step) is False:
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
    source = _source(robot, step, 1, None)
    kept, states, taus = [], [], []
    watch = LimitWatch(robot.joint_names, robot.limits, state)
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
        repeat(source.kernel.address, [state.ctypes.data, tau.ctypes.data,
                                       source.constants.ctypes.data, after.ctypes.data],
               [0] * 4, 1)
        _finite(robot, np.stack([state, after]), k, step)
        watch.look(after[None], np.array([(k + 1) * step]))
        state = after
        if progress is not None and time.perf_counter() - reported > CHUNK_SECONDS:
            reported = time.perf_counter()
            if progress((k + 1) * step) is False:
                break
    return np.array(kept), np.array(states), np.array(taus), watch.events


def _torques(robot: Robot, source: _Source, kept: Array, states: Array) -> Array:
    """Return the torques that acted at the kept steps, (K, n)."""
    torque, n = source.torque, robot.n
    if not isinstance(torque, ComputedTorque):
        return np.ascontiguousarray(torque[np.minimum(kept, len(torque) - 1)])
    q, u = np.ascontiguousarray(states[:, :n]), np.ascontiguousarray(states[:, n:])
    q_d, u_d, udot_d = torque.motion.sample(kept * np.float64(source.step))
    wanted = udot_d + torque.kd * (u_d - u) + torque.kp * (q_d - q)
    return (robot.inverse_dynamics(q, u, wanted) - robot.friction_force(u)
            + robot.friction_force(u_d))


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
    count = round(value / step) if math.isfinite(value / step) else 0
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
