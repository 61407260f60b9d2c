"""The command `fill`: efforts for trajectories of joint_trajectory_controller."""

from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from kane_dynamics._util.whole_files import whole_file
from kane_dynamics.cli.printing import print_files, print_json, print_table, warn
from kane_dynamics.cli.robot_options import load_rigid, one_or_all, warn_degrees
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.control.terms import NO_TERM, Terms
from kane_dynamics.control.trajectory_feedforward import fill_trajectory, FilledTrajectory
from kane_dynamics.errors import InputError
from kane_dynamics.robot.robot import Robot
import numpy as np


def fill(options: Namespace) -> None:
    """Fill in trajectories; print or write them."""
    from kane_dynamics.cli.trajectory_files import read_points  # slow import
    robot, bending = load_rigid(options,
                                feedforward_friction=options.feedforward_friction)
    trajectories = read_points(options.motion, robot.speed_names, options.topic)
    is_bag = trajectories[0].message is not None
    if options.out:
        # Before the work, which may take a while.
        _check_out(options.out, is_bag)
    _warn_of_arm(robot, options.without)
    filled = []
    # Of several trajectories, the error names the one.
    for k, points in enumerate(trajectories):
        _warn_of_degrees(robot, points, options.motion)
        try:
            filled.append(_filled(options, robot, bending, points))
        except InputError as error:
            where = f'trajectory {k}: ' if len(trajectories) > 1 else ''
            raise InputError(f'{options.motion}: {where}{error}') from None
    if options.out:
        _write(options.out, trajectories, filled)
    if options.json:
        print_json([vars(trajectory) for trajectory in filled])
        return
    for trajectory in filled:
        _print(trajectory, robot)
    print_files([options.out] if options.out else [])


def _check_out(out: str, is_bag: bool) -> None:
    """Raise InputError for the name of a file that the trajectories are not written to."""
    suffix = Path(out).suffix
    if is_bag and suffix != '':
        raise InputError(f"--out: '{out}'; expected the folder of a new bag")
    if not is_bag and suffix not in ('.yaml', '.yml', '.csv'):
        raise InputError(f"--out: '{out}'; expected a .yaml or .csv file")


def _write(out: str, trajectories: Sequence[Any],
           filled: Sequence[FilledTrajectory]) -> None:
    """Write a bag with all trajectories, or a file with the only one."""
    from kane_dynamics.cli.tables import write_states  # slow imports
    from kane_dynamics.cli.trajectory_files import write_bag, write_yaml
    if trajectories[0].message is not None:
        write_bag(Path(out), trajectories, filled)
        return
    first = filled[0]
    with whole_file(out) as stream:
        if Path(out).suffix == '.csv':
            states = {'q': first.positions, 'u': first.velocities,
                      'udot': first.accelerations, 'tau': first.efforts}
            write_states(stream, first.times, states, first.joint_names)
        else:
            write_yaml(stream, first)


def _warn_of_arm(robot: Robot, without: Sequence[str]) -> None:
    """Print a warning unless the terms left out are those that the arm itself adds."""
    from kane_dynamics.analysis.known_arms import arms_named, contradiction  # reads a file
    rows = arms_named(robot.model.name, robot.model.joint_names)
    text = contradiction(rows, tuple(without) or (NO_TERM,))
    if text:
        warn(text.replace('arm_compensates:', '--without:'))


def _warn_of_degrees(robot: Robot, points: Any, file: str) -> None:
    """Print a warning if positions of the robot's joints look like degrees."""
    rows = points.rows[0]
    if any(len(row) != len(points.joint_names) for row in rows):
        return  # an error of the trajectory, which is raised when it is filled
    columns = {name: k for k, name in enumerate(points.joint_names)}
    q = np.zeros((len(rows), len(robot.joint_names)))
    for j, name in enumerate(robot.joint_names):
        if name in columns:
            q[:, j] = [row[columns[name]] for row in rows]
    warn_degrees(robot, q, file)


def _filled(options: Namespace, robot: Robot, bending: QuasiStatic | None,
            points: Any) -> FilledTrajectory:
    """Return one filled trajectory."""
    return fill_trajectory(
        robot, points.times, *points.rows, joint_names=points.joint_names,
        rest=options.pose,
        tolerance=options.tolerance and one_or_all(options.tolerance),
        compensate=Terms.beside({*options.without} or {NO_TERM}),
        clip=options.clip, bending=bending)


def _print(filled: FilledTrajectory, robot: Robot) -> None:
    """Print the largest efforts of a trajectory."""
    print(f'{len(filled.times)} points in {filled.times[-1]:g} s, {filled.inserted} '
          'inserted')
    header = ['joint', 'largest effort', 'limit']
    largest = np.abs(filled.efforts).max(axis=0)
    columns = [largest, [robot.limits.effort[robot.joint_names.index(name)]
                         for name in filled.joint_names]]
    if filled.effort_error is not None:
        header.append('error between points')
        columns.append(filled.effort_error)
    print_table(header, zip(filled.joint_names, *columns, strict=True))
