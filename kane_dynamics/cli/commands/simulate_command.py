"""The command `simulate`: forward dynamics over time."""

from argparse import Namespace
import math
import time
from typing import Any

from kane_dynamics._util.checks import increasing
from kane_dynamics._util.progress import progress_bar
from kane_dynamics._util.typing import Array
from kane_dynamics.cli import pictures
from kane_dynamics.cli.commands.inspect_command import print_table
from kane_dynamics.cli.shared import (load, model_warnings, positions, print_json, split, vector,
                                      without_rounding)
from kane_dynamics.cli.tables import read_motion, read_states
from kane_dynamics.control.computed_torque import ComputedTorque
from kane_dynamics.errors import InputError
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.simulate import simulate
import numpy as np

_MOST_EVENTS = 10  # printed; --json has all


def simulation(options: Namespace) -> None:
    """Simulate; save and plot on request; print a summary."""
    if options.out and not options.out.endswith(('.npz', '.csv')):
        raise InputError(f"--out: '{options.out}'; expected a name that ends in .npz or .csv")
    plot = pictures.plotter(options)  # report errors early
    _, robot = load(options)
    with model_warnings(verbose=options.verbose):
        q0, u0, duration, source = _plan(options, robot)
    start = time.perf_counter()
    with progress_bar('simulating', duration) as progress, (
            model_warnings(verbose=options.verbose)):
        result = simulate(robot, q0, u0, duration, step=options.step, torque=source,
                          progress=progress, integrator=options.integrator, stops=options.stops)
    wall = time.perf_counter() - start
    if options.out:
        (result.save_npz if options.out.endswith('.npz') else result.save_csv)(options.out)
    if plot is not None:
        pictures.draw(plot, options, robot, result, getattr(source, 'motion', None))
    before, after = result.energy[[0, -1]].sum(axis=1).tolist()
    events = [str(event) for event in (*result.limit_events, *result.stop_events)]
    constrained = {'speed_names': robot.speed_names, 'drift': result.drift} if (
        robot.constraint_names) else {}
    if options.json:
        print_json({'joint_names': robot.joint_names, **constrained,
                    'duration': float(result.t[-1]), 'wall_time': wall, 'q': result.q[-1],
                    'u': result.u[-1], 'tau': result.tau[-1], 'energy_before': before,
                    'energy_after': after,
                    'limit_events': [str(event) for event in result.limit_events],
                    'stop_events': [str(event) for event in result.stop_events]})
        return
    print(f'{result.t[-1]:g} s in steps of {options.step:g} s took {wall:.3g} s; energy went '
          f'from {before:.6g} J to {after:.6g} J')
    last = [without_rounding(rows[-1]) for rows in (result.q, result.u, result.tau)]
    if constrained:
        print(f'largest residual of the constraints: {result.drift:.3g} m or rad, or per s')
        print_table(['joint', 'q'], zip(robot.joint_names, last[0], strict=True))
        print_table(['independent joint', 'u', 'tau'], zip(robot.speed_names, *last[1:],
                                                           strict=True))
    elif robot.n_q > robot.n:  # quaternions
        print_table(['coordinate', 'q'], zip(robot.coordinate_names, last[0], strict=True))
        print_table(['speed', 'u', 'tau'], zip(robot.speed_names, *last[1:], strict=True))
    else:
        print_table(['joint', 'q', 'u', 'tau'], zip(robot.joint_names, *last, strict=True))
    more = len(events) - _MOST_EVENTS
    for line in [*events[:_MOST_EVENTS], *([f'... {more} more: see --json'] if more > 0 else []),
                 *(f'wrote {path}' for path in (options.out, options.plot) if path)]:
        print(line)


def _plan(options: Namespace, robot: Robot) -> tuple[Array, Array, float, Any]:
    """Return q0, u0, duration and torque source of a simulation."""
    duration, step = options.duration, options.step
    source: Any = None
    q_d = u_d = None
    if options.motion:
        motion = read_motion(options.motion, robot.speed_names)
        q_d, u_d, _ = motion.sample(0.0)
        gains = [gain[0] if len(gain) == 1 else gain for gain in (options.kp, options.kd)]
        source = ComputedTorque(robot, motion, *gains)
        if duration is None and motion.duration > 0.0 and step > 0.0:
            duration = math.ceil(motion.duration / step - 1e-6) * step
    duration = 1.0 if duration is None else duration
    if options.torque:
        tokens = split(options.torque)
        require_own_actuators(robot)
        source = (_held(tokens[0], robot, duration, step)
                  if len(tokens) == 1 and tokens[0].endswith('.csv')
                  else vector(options, 'torque', robot))
    u0 = u_d if options.u0 is None and u_d is not None else vector(options, 'u0', robot)
    return positions(options, 'q0', robot, q_d), u0, duration, source


def require_own_actuators(robot: Robot) -> None:
    """Raise InputError unless each independent joint has the actuator whose torque is given."""
    if set(robot.actuated_names) != set(robot.speed_names):
        raise InputError(f'--torque: given for actuators at {", ".join(robot.actuated_names)}; '
                         'expected constraints whose actuated joints are the independent ones, '
                         f'{", ".join(robot.speed_names)}')


def _held(path: str, robot: Robot, duration: float, step: float) -> Array:
    """Return the torques of a file as one row per step."""
    states = read_states(path, robot.speed_names)
    if states.tau is None:
        raise InputError(f"{path}: no columns 'tau.<joint>'; expected the torques of the joints "
                         f'{", ".join(robot.speed_names)}')
    if states.t is None or not step > 0.0:
        return states.tau
    increasing(states.t, len(states.tau), f"{path}: column 't'")
    now = np.arange(max(1, round(duration / step))) * step
    rows = np.searchsorted(states.t, now + 1e-6 * step, side='right') - 1
    return states.tau[np.maximum(rows, 0)]
