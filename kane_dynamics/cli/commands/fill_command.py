"""The command `fill`: efforts for trajectories of joint_trajectory_controller."""

from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
import sys
from typing import Any

from kane_dynamics._util.whole_files import whole_file
from kane_dynamics.cli.commands.inspect_command import print_table
from kane_dynamics.cli.shared import load_rigid, print_json, warn_degrees
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.control.terms import NO_TERM, Terms
from kane_dynamics.control.trajectory_feedforward import fill_trajectory, FilledTrajectory
from kane_dynamics.errors import InputError
from kane_dynamics.robot.robot import Robot
import numpy as np


def fill(options: Namespace) -> None:
    """Fill in trajectories; print or write them."""
    from kane_dynamics.cli.tables import write_states  # slow imports
    from kane_dynamics.cli.trajectory_files import read_points, write_bag, write_yaml
    robot, bending = load_rigid(options)
    given = read_points(options.motion, robot.speed_names, options.topic)
    is_bag = given[0].message is not None
    kind = Path(options.out).suffix if options.out else ''
    if options.out and (kind != '' if is_bag else kind not in ('.yaml', '.yml', '.csv')):
        raise InputError(f"--out: '{options.out}'; expected "
                         + ('the folder of a new bag' if is_bag else 'a .yaml or .csv file'))
    _warn_of_arm(robot, options.without)
    filled = []
    for k, points in enumerate(given):
        _warn_of_degrees(robot, points, options.motion)
        try:
            filled.append(_filled(options, robot, bending, points))
        except InputError as error:
            where = f'trajectory {k}: ' if len(given) > 1 else ''
            raise InputError(f'{options.motion}: {where}{error}') from None
    if options.out and is_bag:
        write_bag(Path(options.out), given, filled)
    elif options.out:
        with whole_file(options.out) as stream:
            if kind == '.csv':
                each = filled[0]
                write_states(stream, each.times, {
                    'q': each.positions, 'u': each.velocities, 'udot': each.accelerations,
                    'tau': each.efforts}, each.joint_names)
            else:
                write_yaml(stream, filled[0])
    if options.json:
        print_json([vars(each) for each in filled])
        return
    for each in filled:
        _print(each, robot)
    if options.out:
        print(f'wrote {options.out}')


def _warn_of_arm(robot: Robot, without: Sequence[str]) -> None:
    """Print a warning if a known arm adds other terms itself than those that are left out."""
    from kane_dynamics.analysis.known_arms import arms_named, contradiction  # reads a file
    rows = arms_named(robot.model.name, robot.model.joint_names)
    if wrong := contradiction(rows, tuple(without) or (NO_TERM,)):
        words = wrong.replace('arm_compensates:', '--without:')
        print(f'kane-dynamics: warning: {words}', file=sys.stderr)


def _warn_of_degrees(robot: Robot, points: Any, file: str) -> None:
    """Print a warning if positions of the robot's joints look like degrees."""
    rows = points.rows[0]
    if all(len(row) == len(points.joint_names) for row in rows):
        at = {name: k for k, name in enumerate(points.joint_names)}
        warn_degrees(robot, np.array([[row[at[name]] if name in at else 0.0
                                       for name in robot.joint_names] for row in rows]), file)


def _filled(options: Namespace, robot: Robot, bending: QuasiStatic | None,
            points: Any) -> FilledTrajectory:
    """Return one filled trajectory."""
    tolerance = options.tolerance
    return fill_trajectory(
        robot, points.times, *points.rows, joint_names=points.joint_names, rest=options.pose,
        tolerance=tolerance[0] if tolerance and len(tolerance) == 1 else tolerance,
        compensate=Terms(**dict.fromkeys(options.without, False)), clip=options.clip,
        bending=bending)


def _print(filled: FilledTrajectory, robot: Robot) -> None:
    """Print the largest efforts of a trajectory."""
    print(f'{len(filled.times)} points in {filled.times[-1]:g} s, {filled.inserted} inserted')
    columns = ['joint', 'largest effort', 'limit']
    limits = [robot.limits.effort[robot.joint_names.index(name)] for name in filled.joint_names]
    rows: list[list[Any]] = [[name, *pair] for name, *pair in zip(
        filled.joint_names, np.abs(filled.efforts).max(axis=0).tolist(), limits)]
    if filled.effort_error is not None:
        columns.append('error between points')
        rows = [[*row, error] for row, error in zip(rows, filled.effort_error.tolist())]
    print_table(columns, rows)
