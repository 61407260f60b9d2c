"""The command `feasible --time-optimal`: the fastest timing of the path of a motion."""

from argparse import Namespace
from typing import Any

from kane_dynamics.cli.commands import inspect_command
from kane_dynamics.cli.shared import print_json
from kane_dynamics.cli.tables import write_states
from kane_dynamics.errors import InputError
from kane_dynamics.feasibility import time_optimal, TimeOptimal
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.robot import Robot
import numpy as np


def time_path(options: Namespace, robot: Robot, motion: Motion, plot: Any, power: Any) -> int:
    """Compute the fastest timing of the path of a motion; write, plot and print it."""
    for name, given in (('--speed', options.speed != 1.0),
                        ('--payload-frame', options.payload_frame is not None)):
        if given:
            raise InputError(f'{name}: given with --time-optimal; expected one of them')
    timing = time_optimal(robot, motion, power=power, acceleration=options.acceleration[0] if len(
        options.acceleration) == 1 else options.acceleration)
    data = as_data(timing, motion)
    if options.out:
        write_timing(options.out, timing)
        data['files'].append(options.out)
    if plot is not None:
        plot.plot_timing(timing, options.plot,
                         title=f'{robot.model.name}: use of the limits by the fastest timing')
        data['files'].append(options.plot)
    (print_json if options.json else print_data)(data)
    return 0


def write_timing(path: str, timing: TimeOptimal) -> None:
    """Write the points of a timing as a table of states."""
    motion = timing.motion
    at = motion.times.copy()
    at[-1] = np.nextafter(at[-1], -np.inf)  # at its very end a motion is at rest
    q, u, udot = motion.sample(at)
    with open(path, 'w', encoding='utf-8', newline='') as stream:
        write_states(stream, motion.times, {'q': q, 'u': u, 'udot': udot, 'tau': timing.tau},
                     motion.joint_names)


def as_data(timing: TimeOptimal, motion: Motion) -> dict[str, Any]:
    """Return a timing as plain data."""
    return {'joint_names': list(timing.motion.joint_names), 'duration': timing.duration,
            'points': len(timing.motion.times), 'given_duration': motion.duration,
            'uses': {name: use.max(axis=0) for name, use in timing.uses.items()},
            'active': [active._asdict() for active in timing.active], 'files': []}


def print_data(data: dict[str, Any]) -> None:
    """Print the result of `feasible --time-optimal`."""
    print(f'fastest timing {data["duration"]:.6g} s, of a path given in '
          f'{data["given_duration"]:.6g} s; {data["points"]} points')
    inspect_command.print_table(['from, s', 'to, s', 'limit reached', 'joint'], [
        [f'{active["start"]:.4f}', f'{active["end"]:.4f}', active['limit'], active['joint']]
        for active in data['active']])
    for path in data['files']:
        print(f'wrote {path}')
