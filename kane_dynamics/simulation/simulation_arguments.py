"""The arguments of `simulate`, checked: initial states, numbers of steps and of samples."""

import math
from typing import Any

from kane_dynamics._util.checks import instance, positive_time
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.ball_joints import require_unit
from kane_dynamics.mechanics.constraints.conditioning import loosened
from kane_dynamics.mechanics.integrators import integrator_of
from kane_dynamics.native.runtime.argument import Argument, checked
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.step_kernels import margin_count
import numpy as np

CLOSED = 1e-8  # rad or lengths: largest constraint residual of an initial configuration
MOST_STEPS = 100_000_000
MOST_SAMPLES = 1_000_000
DEFAULT_SAMPLES = 1000


def require_arguments(robot: Any, t0: Any, progress: Any, integrator: Any) -> None:
    """Raise InputError for arguments of `simulate` of a wrong kind and limits that are NaN."""
    instance(robot, Robot, 'robot')
    if isinstance(t0, bool | np.bool_):
        raise InputError(f't0: {t0!r}; expected a finite number, s')
    if not (progress is None or callable(progress)):
        raise InputError(f'progress: {progress!r}; expected None or a function of the time')
    if integrator is not None:
        integrator_of(integrator)
    for name, low, high in zip(robot.coordinate_names, robot.limits.lower, robot.limits.upper):
        if math.isnan(low) or math.isnan(high):
            raise InputError(f"limits: of joint '{name}' {low:g} to {high:g}; expected numbers, "
                             'infinite where there is no limit')


def initial_states(robot: Robot, q0: Any, u0: Any, t0: float) -> Array:
    """Return the initial state or states, (size,) or (N, size), entries as `state_names`."""
    q = checked(Argument('q0', (robot.n_q,), robot.coordinate_names), q0)
    u = checked(Argument('u0', (robot.n,), robot.speed_names), u0)
    q = require_unit(robot.model, q, 'q0')
    if q.shape[:-1] != u.shape[:-1]:
        raise InputError(f'q0: shape {q.shape}, u0: shape {u.shape}; expected ({robot.n_q},) and '
                         f'({robot.n},), or (N, {robot.n_q}) and (N, {robot.n})')
    if robot.constraint_names and q.size:
        residual = np.abs(np.atleast_2d(robot.constraint_residual(q, t=t0)))
        in_units = residual / robot.mechanism.row_units
        i, k = np.unravel_index(np.argmax(in_units), residual.shape)
        if in_units[i, k] > loosened(robot.mechanism, CLOSED):
            which = '' if q.ndim == 1 else f' of state {i}'
            raise InputError(f"q0{which}: the residual of '{robot.constraint_names[k]}' is "
                             f'{residual[i, k]:.3g} (m or rad); expected a closed configuration, '
                             'as robot.closed_posture(q0)')
    time = np.full((*q.shape[:-1], 1 if robot.equations.timed else 0), t0)
    margins = np.ones((*q.shape[:-1], margin_count(robot)))
    return np.concatenate([q, u, time, margins], axis=-1)


def steps_per_sample(count: int, step: float, sample: Any, N: int, single: bool) -> int:
    """Return the number of steps between two rows; InputError for too many rows."""
    if sample is None:
        rows = max(2, min(DEFAULT_SAMPLES, MOST_SAMPLES // max(N, 1) - 1))
        every = max(1, -(-count // rows))
    else:
        every = whole_steps('sample', positive_time(sample, 'sample'), step, MOST_STEPS)
    rows = count // every + 1
    if N * (rows + 1) > MOST_SAMPLES:
        which = '' if single else f' for each of {N} initial states'
        remedy = 'a longer sample' if single else 'a longer sample or fewer states'
        raise InputError(f'sample: {rows} rows{which}, from {count} steps sampled every {every}; '
                         f'expected at most {MOST_SAMPLES}{"" if single else " together"}: '
                         f'{remedy}')
    return every


def checked_torque(robot: Robot, name: str, value: Any) -> Array:
    """Return the torques of one state, (n,); InputError names them."""
    array = checked(Argument(name, (robot.n,), robot.speed_names), value)
    if array.ndim != 1:
        raise InputError(f'{name}: shape {array.shape}; expected ({robot.n},)')
    return array


def whole_steps(name: str, value: float, step: float, most: int) -> int:
    """Return a time as a number of steps; InputError unless it is whole and in bounds."""
    count = round(value / step) if math.isfinite(value / step) else 0
    if count < 1 or abs(value / step - count) > 1e-6 * max(1, count):
        raise InputError(f'{name}: {value} s, {value / step:.6g} steps of {step} s; expected a '
                         'whole number of steps')
    if count > most:
        raise InputError(f'{name}: {value} s, {count} steps of {step} s; expected at most '
                         f'{most}')
    return count
