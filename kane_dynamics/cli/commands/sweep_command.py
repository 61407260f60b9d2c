"""The command `sweep`: read a description, run it, print a summary."""

from argparse import Namespace
from collections.abc import Mapping
from dataclasses import fields
import os
from pathlib import Path
import time
from typing import Any

from kane_dynamics._util.optional_imports import extra
from kane_dynamics._util.text import SHORT
from kane_dynamics._util.yaml_io import read_yaml
from kane_dynamics.cli.commands import inspect_command
from kane_dynamics.cli.shared import load, model_warnings, print_json
from kane_dynamics.cli.tables import read_motion
from kane_dynamics.control.constrained_law import joints_that_follow
from kane_dynamics.errors import InputError
from kane_dynamics.model.model import GRAVITY
from kane_dynamics.sweep import read_table, run_sweep, Sweep
from kane_dynamics.urdf.xacro_file import argument_text
import numpy as np

FILES = ('urdf', 'supplement', 'constraints', 'motion')  # relative to the sweep's file
ROBOT = ('urdf', 'xacro', 'supplement', 'constraints', 'base', 'tip', 'joints', 'gravity')
SWEEP = tuple(field.name for field in fields(Sweep) if field.init and field.name != 'model')
SHOWN = 5  # different errors in the summary


def read_sweep(path: str | os.PathLike[str], verbose: bool = False) -> Sweep:
    """
    Return the sweep described by a YAML or JSON file.

    Its entries are those of `Sweep`, where `motion` is the path of a CSV or YAML file, and those
    of the robot: `urdf`, `xacro` (a mapping of arguments), `supplement`, `constraints`, `base`,
    `tip`, `joints`, `gravity`.

    Raises
    ------
    KaneError
        If an entry is invalid; the message names the file, the entry and its value.

    """
    given = _content(path)
    for key in given:
        if key not in (*ROBOT, *SWEEP):
            raise InputError(f'{path}: unknown entry {key!r}; expected one of '
                             f'{", ".join((*ROBOT, *SWEEP))}')
    for key in ('urdf', 'samples'):
        if key not in given:
            raise InputError(f"{path}: no '{key}'; expected urdf and samples")
    for key in FILES:
        if given.get(key) is not None:
            if not isinstance(given[key], str):
                raise InputError(f'{path}: {key}: {given[key]!r}; expected the path of a file')
            given[key] = str(Path(path).parent / Path(given[key]).expanduser())
    _, robot = load(Namespace(
        urdf=given['urdf'], xacro=_assignments(path, given.get('xacro')),
        supplement=given.get('supplement'), constraints=given.get('constraints'),
        base=given.get('base'), tip=given.get('tip'), joints=_names(path, given.get('joints')),
        gravity=_gravity(path, given.get('gravity')), no_strict=False, no_friction=False,
        verbose=verbose))
    chosen = {key: given[key] for key in SWEEP if given.get(key) is not None}
    if 'motion' in chosen:
        chosen['motion'] = read_motion(chosen['motion'], tuple(
            robot.model.coordinate_names[k] for k in joints_that_follow(robot)))
    try:
        return Sweep(robot, **chosen)
    except InputError as error:
        raise InputError(f'{path}: {error}') from None


def sweep(options: Namespace) -> None:
    """Run a sweep, or continue it, and print a summary of its table."""
    if options.plot is not None:
        plot = extra('kane_dynamics.plot', 'plot', '--plot')  # report errors early
        plot.check_path(options.plot)
    wanted = read_sweep(options.sweep, options.verbose)
    start = time.perf_counter()
    with model_warnings():
        done = run_sweep(wanted, options.out, workers=options.workers, dask=options.dask)
    wall = time.perf_counter() - start
    rows = read_table(options.out).select(['ok', 'error', 'limit_events', 'energy_closes'])
    errors = [text for text in rows['error'].to_pylist() if text is not None]
    kinds = sorted(set(errors), key=lambda text: (-errors.count(text), text))
    passed = np.array([count or 0 for count in rows['limit_events'].to_pylist()])
    data = {'folder': str(options.out), 'digest': done.digest, 'samples': rows.num_rows,
            'found': done.found, 'made': done.made, 'wall_time': wall,
            'ok': rows.num_rows - len(errors), 'failed': len(errors),
            'past_a_limit': int((passed > 0).sum()),
            'energy_missed': rows['energy_closes'].to_pylist().count(False),
            'errors': {text: errors.count(text) for text in kinds[:SHOWN]}}
    (print_json if options.json else print_result)(data)
    if options.plot is not None:
        plot.plot_sweep(read_table(options.out).to_pydict(), options.plot,
                        title=f'{wanted.robot.model.name}: sweep of {rows.num_rows} trials')


def print_result(data: Mapping[str, Any]) -> None:
    """Print the summary of a sweep."""
    before = f', {data["found"]} were in the folder before' if data['found'] else ''
    print(f'{data["made"]} simulations in {data["wall_time"]:.3g} s{before}')
    inspect_command.print_table(['', 'simulations'], [
        ['ok', data['ok']], ['past a limit', data['past_a_limit']], ['failed', data['failed']],
        *([['energy balance missed', data['energy_missed']]] if data['energy_missed'] else [])])
    for text, count in data['errors'].items():
        print(f'{count}: {text}')
    print(f'wrote {data["folder"]}')


def _content(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the entries of a file."""
    found = read_yaml(path, 'sweep', InputError)
    if not isinstance(found, dict):
        raise InputError(f'{path}: {SHORT.repr(found)}; expected entries such as urdf and samples')
    return found


def _names(path: Any, joints: Any) -> list[str] | None:
    """Return joints as a list of names."""
    if joints is None or (isinstance(joints, list) and all(isinstance(x, str) for x in joints)):
        return joints
    raise InputError(f'{path}: joints: {joints!r}; expected a list of names')


def _assignments(path: Any, arguments: Any) -> list[str] | None:
    """Return the arguments of a xacro file as assignments NAME:=VALUE."""
    if arguments is None:
        return None
    if not isinstance(arguments, dict):
        raise InputError(f'{path}: xacro: {SHORT.repr(arguments)}; expected a mapping of the '
                         'arguments, such as {prefix: left_}')
    return [f'{name}:={argument_text(name, value)}' for name, value in arguments.items()]


def _gravity(path: Any, gravity: Any) -> Any:
    """Return gravity as a tuple; `load_urdf` checks the numbers."""
    if gravity is None:
        return GRAVITY
    if not isinstance(gravity, list):
        raise InputError(f'{path}: gravity: {gravity!r}; expected three numbers, m/s^2')
    return tuple(gravity)
