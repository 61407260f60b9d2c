"""The command `feasible`: torque, speed and power of a motion, its highest speed and timing."""

from argparse import Namespace
import math
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics._util.whole_files import whole_file
from kane_dynamics.cli import pictures
from kane_dynamics.cli.printing import print_files, print_json, print_table
from kane_dynamics.cli.robot_options import load_rigid, one_or_all, warn_degrees
from kane_dynamics.cli.tables import (QUANTITIES, read_motion, read_smooth_motion,
                                      write_states)
from kane_dynamics.errors import InputError
from kane_dynamics.feasibility import (Demand, demand, fastest, largest_payload,
                                       time_optimal, TimeOptimal)
from kane_dynamics.feasibility.samples import NONE
from kane_dynamics.feasibility.time_scale import LOWEST, TimeScale
from kane_dynamics.feasibility.torque_demand import demand_at
from kane_dynamics.model.elastic_model import with_motors_at_links
from kane_dynamics.motion.motion import Motion
from kane_dynamics.motion.smooth_motion import SmoothMotion
from kane_dynamics.robot.robot import Robot
import numpy as np


def feasible(options: Namespace) -> int:
    """Check a motion against the limits of the joints; return 1 if it exceeds one."""
    plot = pictures.plotter(options)  # errors early
    robot, bending = load_rigid(options, payload_frame=options.payload_frame)
    motion = _motion(options, robot)
    power = one_or_all(options.power)
    # A path without its timing is another question, with a result of its own.
    if options.time_optimal:
        if bending is not None:
            raise InputError('--time-optimal: given for an arm with beams, whose '
                             'deflection a path does not state; expected rigid links, '
                             'or the highest speed without --time-optimal')
        return _time_path(options, robot, motion, plot, power)
    conditions: dict[str, Any] = {'bending': bending, 'step': options.step, 'power': power}
    needed = demand(robot, motion, speed=options.speed, **conditions)
    scale = fastest(robot, motion, **conditions)
    data = {**demand_data(needed), 'speed': options.speed,
            'fastest': None if scale is None else vars(scale), 'payload': None,
            'files': []}
    # Feasible at no speed: the reason, found at rest.
    if scale is None:
        data['hopeless'] = _hopeless(robot, motion, conditions)
    if options.payload_frame and needed.fits:
        data['payload'] = vars(largest_payload(robot, motion, com=options.payload_com,
                                               speed=options.speed, **conditions))
    if options.out:
        _write_fitting(options.out, robot, motion, scale, conditions)
        data['files'].append(options.out)
    if plot is not None:
        plot.plot_demand(needed, options.plot, prismatic=robot.model.sliding,
                         title=f'{robot.model.name}: torque, speed and power against '
                               'the limits')
        data['files'].append(options.plot)
    if options.json:
        print_json(data)
    else:
        _print_demand(data)
    return 0 if data['fits'] else 1


def _motion(options: Namespace, robot: Robot) -> Motion | SmoothMotion:
    """Return the motion of the joints, with elastic joints that of their links."""
    if not robot.drives:
        motion = read_motion(options.motion, robot.speed_names)
        warn_degrees(robot, motion.positions, options.motion)
        return motion
    motors = {elastic.drive.motor for elastic in robot.drives}
    links = [name for name in robot.joint_names if name not in motors]
    smooth = read_smooth_motion(options.motion, links)
    positions = smooth.sample(smooth.times).q
    # The motors are where no spring is deflected.
    whole = np.zeros((len(positions), robot.n_q))
    whole[:, list(map(robot.joint_names.index, links))] = positions
    warn_degrees(robot, with_motors_at_links(robot.model, whole), options.motion)
    return smooth


def _hopeless(robot: Robot, motion: Motion | SmoothMotion, conditions: dict[str, Any]) -> str:
    """Return the reason why a motion is infeasible at every speed, as text."""
    slowest = demand(robot, motion, speed=LOWEST, **conditions)
    if slowest.excesses:
        return f'a limit is exceeded even at the lowest speed: {slowest.excesses[0]}'
    return 'at every speed some limit is exceeded'


def _write_fitting(path: str, robot: Robot, motion: Motion | SmoothMotion,
                   scale: TimeScale | None, conditions: dict[str, Any]) -> None:
    """Write the motion at the highest feasible speed as a table of states."""
    if scale is None:
        raise InputError('--out: no feasible speed; expected a motion with a highest '
                         'feasible speed')
    if math.isinf(scale.speed):
        raise InputError('--out: no limit of the speed; expected a motion with a '
                         'highest feasible speed')
    needed = demand_at(robot, motion, scale.speed, conditions['step'],
                       conditions['power'], NONE,
                       conditions['bending'])
    # Of two samples at one time keep the later; at both ends those of the motion, not of
    # rest.
    single = np.append(np.diff(needed.t[:-1]) > 1e-9 * needed.t[-1], [True, False])
    # A jump of udot has two values at its time. Without the column a reader interpolates
    # by cubics, which restores the motion, since motions with jumps consist of cubics.
    twice = np.flatnonzero(~single[1:-2]) + 1
    jump = np.abs(needed.udot[twice + 1] - needed.udot[twice]).max(initial=0.0)
    states = {'q': needed.q[single], 'u': needed.u[single]}
    if jump <= 1e-9 * np.abs(needed.udot).max(initial=0.0):
        states['udot'] = needed.udot[single]
    states['tau'] = needed.tau[single]
    with whole_file(path) as stream:
        write_states(stream, needed.t[single], states, robot.joint_names)


def demand_data(needed: Demand) -> dict[str, Any]:
    """Return peaks and their shares of the limits as plain data."""
    # Plain data of numbers and texts, from which both the JSON and the table are
    # printed.
    def peaks(values: Array) -> Array:
        return np.asarray(np.abs(values).max(axis=0))
    return {'joint_names': list(needed.joint_names), 'duration': float(needed.t[-1]),
            'samples': len(needed.t), 'fits': needed.fits,
            'torque': {'peak': peaks(needed.tau), 'rms': needed.torque_rms,
                       'limit': needed.limits.effort, 'use': _torque_uses(needed)},
            'velocity': {'peak': peaks(needed.u), 'limit': needed.limits.velocity,
                         'use': needed.uses['velocity']},
            'power': {'peak': peaks(needed.power), 'limit': needed.power_limit,
                      'use': needed.uses['power'],
                      'peak_of_all': float(_motor_power(needed).max())},
            'position': {'lowest': needed.q.min(axis=0), 'highest': needed.q.max(axis=0),
                         'lower': needed.limits.lower, 'upper': needed.limits.upper},
            'excesses': [{**excess._asdict(), 'words': str(excess)}
                         for excess in needed.excesses]}


def _torque_uses(needed: Demand) -> Array:
    """Return the used shares of the limits of motors, and of the gears of elastic links."""
    uses = needed.uses
    return np.maximum(uses['effort'], uses['gear']) if needed.gears else uses['effort']


def _motor_power(needed: Demand) -> Array:
    """Return the power of all motors together, (N,), W; gears only transmit it."""
    with_motor = ~np.isin(needed.joint_names, needed.gears)
    return np.asarray(needed.power[:, with_motor].sum(axis=1))


def _print_demand(data: dict[str, Any]) -> None:
    """Print the demand of a motion, its highest speed and the largest payload."""
    torque = data['torque']
    velocity = data['velocity']
    power = data['power']
    print(f'{data["duration"]:.6g} s, {data["samples"]} samples; rad or m, s, N m or N, '
          'W')
    table = []
    for j, name in enumerate(data['joint_names']):
        table.append([name, torque['peak'][j], _percent(torque, j), torque['rms'][j],
                      velocity['peak'][j], _percent(velocity, j), power['peak'][j]])
    print_table(['joint', 'peak torque', 'of limit', 'RMS torque', 'peak speed',
                 'of limit',
                 'peak power'], table)
    print(f'\npeak power of all joints together {power["peak_of_all"]:.4g} W')
    print('the motion is feasible' if data['fits'] else 'the motion is NOT feasible:')
    for excess in data['excesses']:
        print(f'  {excess["words"]}')
    # The answers to what a user asks next: how fast, and with how much payload.
    if data['fastest'] is None:
        print(f'feasible at no speed: {data["hopeless"]}')
    else:
        speed = _bound_in_words(data['fastest'], 'speed', ' times that of the file')
        print(f'highest feasible speed: {speed}')
    if data['payload']:
        print('largest payload ' + _bound_in_words(data['payload'], 'mass', ' kg'))
    print_files(data['files'])


def _percent(quantity: dict[str, Any], j: int) -> str:
    """Return the used share of a joint's limit as text."""
    return '-' if math.isinf(quantity['limit'][j]) else f'{100.0 * quantity["use"][j]:.1f} %'


def _bound_in_words(bound: dict[str, Any], name: str, unit: str) -> str:
    """Return a number and the limit that bounds it as text."""
    if math.isinf(bound[name]):
        return 'unbounded'
    text = f'{bound[name]:.6g}{unit}'
    if bound['joint'] is None:
        return text
    return (f"{text}, bounded by the {bound['limit']} limit of '{bound['joint']}' at "
            f'{bound["t"]:.4g} s')


# The fastest timing of a path.

def _time_path(options: Namespace, robot: Robot, motion: Motion | SmoothMotion,
               plot: Any, power: Any) -> int:
    """Compute the fastest timing of the path of a motion; write, plot and print it."""
    timing = time_optimal(robot, motion, power=power,
                          acceleration=one_or_all(options.acceleration),
                          jerk=one_or_all(options.jerk),
                          torque_rate=one_or_all(options.torque_rate))
    # The files come before the print, which names them.
    data = timing_data(timing, motion)
    if options.out:
        _write_timing(options.out, timing)
        data['files'].append(options.out)
    if plot is not None:
        plot.plot_timing(timing, options.plot,
                         title=f'{robot.model.name}: use of the limits by the fastest '
                               'timing')
        data['files'].append(options.plot)
    if options.json:
        print_json(data)
    else:
        _print_timing(data)
    return 0


def _write_timing(path: str, timing: TimeOptimal) -> None:
    """Write the points of a timing as a table of states."""
    t, q, u, udot = timing.points
    states = dict(zip(QUANTITIES, (q, u, udot, timing.tau), strict=True))
    with whole_file(path) as stream:
        write_states(stream, t, states, timing.joint_names)


def timing_data(timing: TimeOptimal, motion: Motion | SmoothMotion) -> dict[str, Any]:
    """Return a timing as plain data."""
    return {'joint_names': list(timing.joint_names), 'duration': timing.duration,
            'points': len(timing.motion.times), 'given_duration': motion.duration,
            'uses': {name: use.max(axis=0) for name, use in timing.uses.items()},
            'active': [active._asdict() for active in timing.active], 'files': []}


def _print_timing(data: dict[str, Any]) -> None:
    """Print the result of `feasible --time-optimal`."""
    print(f'fastest timing {data["duration"]:.6g} s, of a path given in '
          f'{data["given_duration"]:.6g} s; {data["points"]} points')
    table = []
    for active in data['active']:
        table.append([f'{active["start"]:.4f}', f'{active["end"]:.4f}', active['limit'],
                      active['joint']])
    print_table(['from, s', 'to, s', 'limit reached', 'joint'], table)
    print_files(data['files'])
