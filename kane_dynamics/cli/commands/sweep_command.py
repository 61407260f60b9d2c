"""The command `sweep`: read a description, run it, print a summary."""

from argparse import Namespace
from collections import Counter
from collections.abc import Mapping
from dataclasses import fields
import os
from pathlib import Path
import time
from typing import Any

from kane_dynamics._util.optional_imports import extra
from kane_dynamics._util.text import SHORT
from kane_dynamics._util.yaml_io import read_yaml
from kane_dynamics.cli.printing import (model_warnings, print_files, print_json,
                                        print_table)
from kane_dynamics.cli.robot_options import load_robot
from kane_dynamics.cli.tables import read_motion
from kane_dynamics.control.computed_torque import joints_that_follow
from kane_dynamics.errors import InputError, KaneError
from kane_dynamics.model.model import GRAVITY
from kane_dynamics.robot.robot import Robot
from kane_dynamics.sweep import read_table, run_sweep, Summary, Sweep
from kane_dynamics.urdf.xacro_file import argument_text

FILES = ('urdf', 'supplement', 'constraints', 'motion')  # relative to the sweep's file
ROBOT = ('urdf', 'xacro', 'supplement', 'constraints', 'base', 'tip', 'joints',
         'root_joint', 'gravity')
SWEEP = tuple(field.name for field in fields(Sweep) if field.init and field.name != 'model')
SHOWN = 5  # different errors in the summary


def read_sweep(path: str | os.PathLike[str], verbose: bool = False) -> Sweep:
    """
    Return the sweep described by a YAML or JSON file.

    Its entries are those of `Sweep`, where `motion` is the path of a CSV or YAML file,
    and those of the robot: `urdf`, `xacro` (a mapping of arguments), `supplement`,
    `constraints`, `base`, `tip`, `joints`, `root_joint`, `gravity`.

    Raises
    ------
    InputError
        If an entry is invalid; the message names the file, the entry and its value.

    """
    entries = _entries(path)
    try:
        robot = _robot(path, entries, verbose)
        chosen = {key: entries[key] for key in SWEEP if entries.get(key) is not None}
        if 'motion' in chosen:
            chosen['motion'] = read_motion(chosen['motion'], _followed_joints(robot))
        return Sweep(robot, **chosen)
    except KaneError as error:
        # The message of a file that the sweep names has that file's name.
        raise InputError(f'{path}: {error}') from None


def sweep(options: Namespace) -> int:
    """Run a sweep, or continue it, and print a summary; return 1 if all trials failed."""
    if options.plot is not None:
        plot = extra('kane_dynamics.plot', 'plot', '--plot')  # report errors early
        plot.check_path(options.plot)
    described = read_sweep(options.sweep, options.verbose)
    start = time.perf_counter()
    with model_warnings():
        run = run_sweep(described, options.out, workers=options.workers)
    data = _summary(options.out, run, time.perf_counter() - start)
    if options.json:
        print_json(data)
    else:
        _print_summary(data)
    if options.plot is not None:
        title = f'{described.robot.model.name}: sweep of {data["samples"]} trials'
        plot.plot_sweep(read_table(options.out).to_pydict(), options.plot, title=title)
        if not options.json:
            print_files([options.plot])
    return 0 if data['ok'] else 1


def _summary(folder: str, run: Summary, wall_time: float) -> dict[str, Any]:
    """Return the numbers of trials by their results, and the most frequent errors."""
    rows = read_table(folder).select(['ok', 'error', 'limit_events', 'energy_closes'])
    # Errors by their text, the most frequent first; those of equal number by name.
    errors = Counter(text for text in rows['error'].to_pylist() if text is not None)
    by_frequency = sorted(errors, key=lambda text: (-errors[text], text))
    # A trial that failed has no events.
    past_a_limit = 0
    for count in rows['limit_events'].to_pylist():
        past_a_limit += bool(count)
    return {'folder': str(folder), 'digest': run.digest, 'samples': rows.num_rows,
            'found': run.found, 'made': run.made, 'wall_time': wall_time,
            'ok': rows.num_rows - errors.total(), 'failed': errors.total(),
            'past_a_limit': past_a_limit,
            'energy_missed': rows['energy_closes'].to_pylist().count(False),
            'errors': {text: errors[text] for text in by_frequency[:SHOWN]}}


def _print_summary(data: Mapping[str, Any]) -> None:
    """Print the summary of a sweep."""
    continued = f', {data["found"]} were in the folder before' if data['found'] else ''
    print(f'{data["made"]} simulations in {data["wall_time"]:.3g} s{continued}')
    table = [['ok', data['ok']], ['past a limit', data['past_a_limit']],
             ['failed', data['failed']]]
    if data['energy_missed']:
        table.append(['energy balance missed', data['energy_missed']])
    print_table(['', 'simulations'], table)
    for text, count in data['errors'].items():
        print(f'{count}: {text}')
    print(f'wrote {data["folder"]}')


def _entries(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the entries of a sweep's file, with the paths of other files resolved."""
    entries = read_yaml(path, 'sweep', InputError)
    if not isinstance(entries, dict):
        raise InputError(f'{path}: {SHORT.repr(entries)}; expected entries such as urdf '
                         'and samples')
    # Known entries alone, with those that every sweep needs.
    for key in entries:
        if key not in (*ROBOT, *SWEEP):
            raise InputError(f'{path}: unknown entry {key!r}; expected one of '
                             f'{", ".join((*ROBOT, *SWEEP))}')
    for key in ('urdf', 'samples'):
        if key not in entries:
            raise InputError(f"{path}: no '{key}'; expected urdf and samples")
    # Paths are relative to the file that states them.
    for key in FILES:
        name = entries.get(key)
        if name is None:
            continue
        if not isinstance(name, str):
            raise InputError(f'{path}: {key}: {name!r}; expected the path of a file')
        entries[key] = str(Path(path).parent / Path(name).expanduser())
    return entries


def _robot(path: Any, entries: Mapping[str, Any], verbose: bool) -> Robot:
    """Return the robot that the entries choose."""
    root_joint = entries.get('root_joint')
    # Options of a sweep's file are those of the command line, under the same names.
    _, robot = load_robot(Namespace(
        urdf=entries['urdf'], xacro=_assignments(entries.get('xacro')),
        supplement=entries.get('supplement'), constraints=entries.get('constraints'),
        base=entries.get('base'), tip=entries.get('tip'),
        joints=_names(entries.get('joints')),
        root_joint='fixed' if root_joint is None else root_joint,
        gravity=_gravity(entries.get('gravity')), no_strict=False, no_friction=False,
        verbose=verbose))
    return robot


def _followed_joints(robot: Robot) -> tuple[str, ...]:
    """Return the joints that a controller moves along a motion."""
    names = robot.model.coordinate_names
    return tuple(names[k] for k in joints_that_follow(robot))


def _names(joints: Any) -> list[str] | None:
    """Return joints as a list of names."""
    if joints is None:
        return None
    if isinstance(joints, list) and all(isinstance(name, str) for name in joints):
        return joints
    raise InputError(f'joints: {joints!r}; expected a list of names')


def _assignments(arguments: Any) -> list[str] | None:
    """Return the arguments of a xacro file as assignments NAME:=VALUE."""
    if arguments is None:
        return None
    if not isinstance(arguments, dict):
        raise InputError(f'xacro: {SHORT.repr(arguments)}; expected a mapping of the '
                         'arguments, such as {prefix: left_}')
    return [f'{name}:={argument_text(name, value)}' for name, value in arguments.items()]


def _gravity(gravity: Any) -> Any:
    """Return gravity as a tuple; `load_urdf` checks the numbers."""
    if gravity is None:
        return GRAVITY
    if not isinstance(gravity, list):
        raise InputError(f'gravity: {gravity!r}; expected three numbers, m/s^2')
    return tuple(gravity)
