"""The command `feasible`: torque, speed and power of a motion, its highest speed and timing."""

from argparse import Namespace
import math
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics._util.whole_files import whole_file
from kane_dynamics.cli import pictures
from kane_dynamics.cli.commands import inspect_command
from kane_dynamics.cli.shared import load_rigid, print_json, warn_degrees
from kane_dynamics.cli.tables import QUANTITIES, read_motion, write_states
from kane_dynamics.errors import InputError
from kane_dynamics.feasibility import (Demand, demand, fastest, largest_payload, time_optimal,
                                       TimeOptimal)
from kane_dynamics.feasibility.samples import NONE
from kane_dynamics.feasibility.time_scale import LOWEST, TimeScale
from kane_dynamics.feasibility.torque_demand import demand_at
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.robot import Robot
import numpy as np


def feasible(options: Namespace) -> int:
    """Check a motion against the limits of the joints; return 1 if it exceeds one."""
    plot = pictures.plotter(options)  # errors early
    robot, bending = load_rigid(options, payload_frame=options.payload_frame)
    motion = read_motion(options.motion, robot.speed_names)
    warn_degrees(robot, motion.positions, options.motion)
    given: dict[str, Any] = {
        'bending': bending, 'step': options.step,
        'power': options.power[0] if len(options.power) == 1 else options.power}
    if options.time_optimal:
        if bending is not None:
            raise InputError('--time-optimal: given for an arm with beams, whose deflection a '
                             'path does not state; expected rigid links, or the highest speed '
                             'without --time-optimal')
        return time_path(options, robot, motion, plot, given['power'])
    asked = demand(robot, motion, speed=options.speed, **given)
    scale = fastest(robot, motion, **given)
    data = {**as_data(asked), 'speed': options.speed, 'fastest': scale and vars(scale),
            'payload': None, 'files': []}
    if scale is None:
        data['hopeless'] = hopeless(robot, motion, given)
    if options.payload_frame and asked.fits:
        data['payload'] = vars(largest_payload(robot, motion, com=options.payload_com,
                                               speed=options.speed, **given))
    if options.out:
        write_fitting(options.out, robot, motion, scale, given)
        data['files'].append(options.out)
    if plot is not None:
        plot.plot_demand(asked, options.plot, prismatic=robot.model.sliding,
                         title=f'{robot.model.name}: torque, speed and power against the limits')
        data['files'].append(options.plot)
    (print_json if options.json else print_data)(data)
    return 0 if data['fits'] else 1


def hopeless(robot: Robot, motion: Motion, given: dict[str, Any]) -> str:
    """Return the reason why a motion is infeasible at every speed, as text."""
    still = demand(robot, motion, speed=LOWEST, **given)
    return (f'a limit is exceeded even at the lowest speed: {still.excesses[0]}' if still.excesses
            else 'at every speed some limit is exceeded')


def write_fitting(path: str, robot: Robot, motion: Motion, scale: TimeScale | None,
                  given: dict[str, Any]) -> None:
    """Write the motion at the highest feasible speed as a table of states."""
    if scale is None or math.isinf(scale.speed):
        reason = 'no feasible speed' if scale is None else 'no limit of the speed'
        raise InputError(f'--out: {reason}; expected a motion with a highest feasible speed')
    asked = demand_at(robot, motion, scale.speed, given['step'], given['power'], NONE,
                      given['bending'])
    # Of two samples at one time keep the later; at both ends those of the motion, not of rest.
    kept = np.append(np.diff(asked.t[:-1]) > 1e-9 * asked.t[-1], [True, False])
    # A jump of udot has two values at its time. Without the column a reader interpolates by
    # cubics, which restores the motion, since motions with jumps consist of cubics.
    twice = np.flatnonzero(~kept[1:-2]) + 1
    jump = np.abs(asked.udot[twice + 1] - asked.udot[twice]).max(initial=0.0)
    jumps = jump > 1e-9 * np.abs(asked.udot).max(initial=0.0)
    with whole_file(path) as stream:
        write_states(stream, asked.t[kept], {
            name: getattr(asked, name)[kept]
            for name in ('q', 'u', *(() if jumps else ('udot',)), 'tau')}, robot.joint_names)


def as_data(asked: Demand) -> dict[str, Any]:
    """Return peaks and their shares of the limits as plain data."""
    def peaks(values: Array) -> Array:
        return np.asarray(np.abs(values).max(axis=0))
    return {'joint_names': list(asked.joint_names), 'duration': float(asked.t[-1]),
            'samples': len(asked.t), 'fits': asked.fits,
            'torque': {'peak': peaks(asked.tau), 'rms': asked.torque_rms,
                       'limit': asked.limits.effort, 'use': asked.uses['effort']},
            'velocity': {'peak': peaks(asked.u), 'limit': asked.limits.velocity,
                         'use': asked.uses['velocity']},
            'power': {'peak': peaks(asked.power), 'limit': asked.power_limit,
                      'use': asked.uses['power'],
                      'peak_of_all': float(asked.power.sum(axis=1).max())},
            'position': {'lowest': asked.q.min(axis=0), 'highest': asked.q.max(axis=0),
                         'lower': asked.limits.lower, 'upper': asked.limits.upper},
            'excesses': [{**excess._asdict(), 'words': str(excess)}
                         for excess in asked.excesses]}


def print_data(data: dict[str, Any]) -> None:
    """Print the result of `feasible`."""
    def percent(use: float, limit: float) -> str:
        return '-' if math.isinf(limit) else f'{100.0 * use:.1f} %'
    torque, velocity, power = data['torque'], data['velocity'], data['power']
    print(f'{data["duration"]:.6g} s, {data["samples"]} samples; rad or m, s, N m or N, W')
    inspect_command.print_table(
        ['joint', 'peak torque', 'of limit', 'RMS torque', 'peak speed', 'of limit', 'peak power'],
        [[name, torque['peak'][j], percent(torque['use'][j], torque['limit'][j]),
          torque['rms'][j], velocity['peak'][j],
          percent(velocity['use'][j], velocity['limit'][j]), power['peak'][j]]
         for j, name in enumerate(data['joint_names'])])
    print(f'\npeak power of all joints together {power["peak_of_all"]:.4g} W')
    print('the motion is feasible' if data['fits'] else 'the motion is NOT feasible:')
    for excess in data['excesses']:
        print(f'  {excess["words"]}')
    print(_speed_in_words(data))
    if data['payload']:
        print('largest payload ' + _bound_in_words(data['payload'], 'mass', ' kg'))
    for path in data['files']:
        print(f'wrote {path}')


def _speed_in_words(data: dict[str, Any]) -> str:
    """Return the highest feasible speed as text."""
    if data['fastest'] is None:
        return f'feasible at no speed: {data["hopeless"]}'
    return 'highest feasible speed: ' + _bound_in_words(
        data['fastest'], 'speed', ' times that of the file')


def _bound_in_words(found: dict[str, Any], name: str, unit: str) -> str:
    """Return a number and the limit that bounds it as text."""
    if math.isinf(found[name]):
        return 'unbounded'
    by = '' if found['joint'] is None else (
        f", bounded by the {found['limit']} limit of '{found['joint']}' at {found['t']:.4g} s")
    return f'{found[name]:.6g}{unit}{by}'


def time_path(options: Namespace, robot: Robot, motion: Motion, plot: Any, power: Any) -> int:
    """Compute the fastest timing of the path of a motion; write, plot and print it."""
    for name, given in (('--speed', options.speed != 1.0),
                        ('--payload-frame', options.payload_frame is not None)):
        if given:
            raise InputError(f'{name}: given with --time-optimal; expected one of them')
    limits = {name: given[0] if len(given) == 1 else given for name, given in (
        ('acceleration', options.acceleration), ('jerk', options.jerk),
        ('torque_rate', options.torque_rate))}
    timing = time_optimal(robot, motion, power=power, **limits)
    data = timing_data(timing, motion)
    if options.out:
        write_timing(options.out, timing)
        data['files'].append(options.out)
    if plot is not None:
        plot.plot_timing(timing, options.plot,
                         title=f'{robot.model.name}: use of the limits by the fastest timing')
        data['files'].append(options.plot)
    (print_json if options.json else print_timing)(data)
    return 0


def write_timing(path: str, timing: TimeOptimal) -> None:
    """Write the points of a timing as a table of states."""
    t, *states = timing.points
    with whole_file(path) as stream:
        write_states(stream, t, dict(zip(QUANTITIES, (*states, timing.tau))),
                     timing.joint_names)


def timing_data(timing: TimeOptimal, motion: Motion) -> dict[str, Any]:
    """Return a timing as plain data."""
    return {'joint_names': list(timing.joint_names), 'duration': timing.duration,
            'points': len(timing.motion.times), 'given_duration': motion.duration,
            'uses': {name: use.max(axis=0) for name, use in timing.uses.items()},
            'active': [active._asdict() for active in timing.active], 'files': []}


def print_timing(data: dict[str, Any]) -> None:
    """Print the result of `feasible --time-optimal`."""
    print(f'fastest timing {data["duration"]:.6g} s, of a path given in '
          f'{data["given_duration"]:.6g} s; {data["points"]} points')
    inspect_command.print_table(['from, s', 'to, s', 'limit reached', 'joint'], [
        [f'{active["start"]:.4f}', f'{active["end"]:.4f}', active['limit'], active['joint']]
        for active in data['active']])
    for path in data['files']:
        print(f'wrote {path}')
