"""The command `torque`: inverse dynamics of one state, or along a motion."""

from argparse import Namespace
import sys

from kane_dynamics._util.typing import Array
from kane_dynamics._util.whole_files import whole_file
from kane_dynamics.cli import pictures
from kane_dynamics.cli.commands.inspect_command import print_table
from kane_dynamics.cli.shared import (load, positions, print_json, torque_size, vector,
                                      warn_degrees, without_rounding)
from kane_dynamics.errors import InputError
from kane_dynamics.model.model import Model
from kane_dynamics.robot.robot import Robot, TORQUE_TERMS
import numpy as np


def torque(options: Namespace) -> None:
    """Print the torques of one state, or print or write those of a motion."""
    plot = pictures.plotter(options)
    if options.motion is None:
        for name in ('out', 'plot', 'step'):
            if getattr(options, name):
                raise InputError(f'--{name}: given without --motion; expected it with '
                                 '--motion only')
    model, robot = load(options)
    if options.motion is None:
        _print_state(options, model, robot)
        return
    if any(getattr(options, name) is not None for name in ('q', 'u', 'udot')):
        raise InputError('--motion: given with a state; expected no --q, --u and --udot with it')
    from kane_dynamics.cli.tables import (joint_rows, of_mechanism,  # slow import
                                          read_rows, read_trajectory, write_states)
    t, state = read_rows(options.motion, robot.speed_names, options.step)
    rows = joint_rows(robot, of_mechanism(options.motion, robot, t, state))
    warn_degrees(robot, rows['q'], options.motion)
    if plot is not None:
        pictures.draw(plot, options, robot, read_trajectory(options.motion, robot))
    if options.out:
        with whole_file(options.out) as stream:
            write_states(stream, t, rows, robot.joint_names)
    if options.json:
        print_json({'joint_names': robot.joint_names, 't': t, **rows})
    elif options.out or options.plot:
        if options.out:
            print(f'wrote {len(rows["tau"])} rows to {options.out}')
        if options.plot:
            print(f'wrote {options.plot}')
    elif sys.stdout.isatty():
        _print_largest(robot, t, rows['tau'])
    else:
        write_states(sys.stdout, t, rows, robot.joint_names)


def _print_largest(robot: Robot, t: Array | None, tau: Array) -> None:
    """Print the largest torque of each joint along a motion, for a terminal."""
    names, limits = robot.joint_names, robot.limits.effort
    tau = without_rounding(tau, torque_size(robot.model))
    rows = []
    for name, column, limit in zip(names, tau.T, limits, strict=True):
        k = int(np.argmax(np.abs(column)))
        share = f'{abs(column[k]) / limit:.0%}' if np.isfinite(limit) and limit > 0.0 else ''
        unit = 'N' if name in robot.model.sliding else 'N m'
        when = '' if t is None else f'{t[k]:.4g} s'
        rows.append([name, float(column[k]), unit, when, share])
    print_table(['joint', 'largest torque', '', 'at', 'of its limit'], rows)
    print(f'{len(tau)} rows; --out FILE writes them, a pipe prints them')


def _print_state(options: Namespace, model: Model, robot: Robot) -> None:
    """Print the torque of one state and its terms; with constraints, of the actuated joints."""
    q, *rates = positions(options, 'q', robot), *(
        vector(options, name, robot) for name in ('u', 'udot'))
    tau, *terms = (robot.joint_torques(each, q) for each in (
        robot.inverse_dynamics(q, *rates), *robot.torque_terms(q, *rates)))
    if options.json:
        closed = {'q': q, 'speed_names': robot.speed_names} if robot.constraint_names else {}
        print_json({'joint_names': robot.joint_names, **closed, 'tau': tau,
                    'terms': dict(zip(TORQUE_TERMS, terms, strict=True))})
        return
    slides = model.sliding
    rows = without_rounding(np.column_stack([tau, *terms]), torque_size(model))
    print_table(['joint', 'torque', '', *TORQUE_TERMS], [
        [name, row[0], 'N' if name in slides else 'N m', *row[1:]]
        for name, row in zip(robot.joint_names, rows, strict=True)
        if name in robot.actuated_names])
