"""The command `torque`: inverse dynamics of one state, or along a motion."""

from argparse import Namespace
import sys
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics._util.whole_files import whole_file
from kane_dynamics.cli import pictures
from kane_dynamics.cli.printing import print_json, print_table, without_rounding
from kane_dynamics.cli.robot_options import (load_robot, positions, speed_vector,
                                             torque_size, warn_degrees)
from kane_dynamics.robot.robot import Robot, TORQUE_TERMS
import numpy as np


def torque(options: Namespace) -> None:
    """Print the torques of one state, or print or write those of a motion."""
    plot = pictures.plotter(options)  # errors early
    _, robot = load_robot(options)
    if options.motion is None:
        _print_state(options, robot)
    else:
        _along_motion(options, robot, plot)


def _along_motion(options: Namespace, robot: Robot, plot: Any) -> None:
    """Print, write or draw the torques along a motion."""
    from kane_dynamics.cli.tables import (joint_rows, load_trajectory, of_mechanism,
                                          read_rows, write_states)
    t, state = read_rows(options.motion, robot.speed_names, options.step)
    rows = joint_rows(robot, of_mechanism(options.motion, robot, t, state))
    warn_degrees(robot, rows['q'], options.motion)
    if plot is not None:
        pictures.draw(plot, options, robot, load_trajectory(options.motion, robot))
    if options.out:
        with whole_file(options.out) as stream:
            write_states(stream, t, rows, robot.joint_names)
    if options.json:
        print_json({'joint_names': robot.joint_names, 't': t, **rows})
        return
    if options.out:
        print(f'wrote {len(rows["tau"])} rows to {options.out}')
    if options.plot:
        print(f'wrote {options.plot}')
    if options.out or options.plot:
        return
    if sys.stdout.isatty():
        _print_largest(robot, t, rows['tau'])
    else:
        write_states(sys.stdout, t, rows, robot.joint_names)


def _unit(robot: Robot, joint: str) -> str:
    """Return the unit of the effort of a joint."""
    return 'N' if joint in robot.model.sliding else 'N m'


def _print_largest(robot: Robot, t: Array | None, tau: Array) -> None:
    """Print the largest torque of each joint along a motion, for a terminal."""
    tau = without_rounding(tau, torque_size(robot.model))
    table = []
    for j, name in enumerate(robot.joint_names):
        k = int(np.argmax(np.abs(tau[:, j])))
        limit = robot.limits.effort[j]
        share = ''
        if np.isfinite(limit) and limit > 0.0:
            share = f'{abs(tau[k, j]) / limit:.0%}'
        time = '' if t is None else f'{t[k]:.4g} s'
        table.append([name, float(tau[k, j]), _unit(robot, name), time, share])
    print_table(['joint', 'largest torque', '', 'at', 'of its limit'], table)
    print(f'{len(tau)} rows; --out FILE writes them, a pipe prints them')


def _print_state(options: Namespace, robot: Robot) -> None:
    """Print the torque of one state and its terms; with constraints, of the actuated joints."""
    q = positions(options, 'q', robot)
    u = speed_vector(options, 'u', robot)
    udot = speed_vector(options, 'udot', robot)
    tau = robot.joint_torques(robot.inverse_dynamics(q, u, udot), q)
    terms = [robot.joint_torques(term, q) for term in robot.torque_terms(q, u, udot)]
    if options.json:
        print_json({'joint_names': robot.joint_names, 'q': q,
                    'speed_names': robot.speed_names, 'tau': tau,
                    'terms': dict(zip(TORQUE_TERMS, terms, strict=True))})
        return
    rows = without_rounding(np.column_stack([tau, *terms]), torque_size(robot.model))
    table = []
    for name, row in zip(robot.joint_names, rows, strict=True):
        if name in robot.actuated_names:
            table.append([name, row[0], _unit(robot, name), *row[1:]])
    print_table(['joint', 'torque', '', *TORQUE_TERMS], table)
