"""The command `excite`: a motion to record for `identify`."""

from argparse import Namespace
import sys
from typing import Any

from kane_dynamics._util.progress import progress_bar
from kane_dynamics._util.whole_files import whole_file
from kane_dynamics.cli.commands import inspect_command
from kane_dynamics.cli.shared import load, model_warnings, print_json, source_of
from kane_dynamics.cli.tables import write_states
from kane_dynamics.errors import InputError
from kane_dynamics.identification.excitation.optimal_excitation import Excitation, excite
from kane_dynamics.urdf.link_shapes import load_collision_shapes
import numpy as np

BAD_CONDITION = 1e3  # of the base parameters' equations, columns scaled to unit length


def excitation(options: Namespace) -> None:
    """Compute and write an exciting motion for `identify`."""
    model, _ = load(options)
    if not 0.0 < options.rate < np.inf:
        raise InputError(f'--rate: {options.rate}; expected a positive, finite number of Hz')
    with model_warnings():
        shapes = load_collision_shapes(source_of(options))
    with progress_bar('searching', 1.0) as progress:
        found = excite(
            model, duration=options.duration, harmonics=options.harmonics,
            periods=options.periods, seed=options.seed, starts=options.starts,
            share=options.share, floor=options.floor, distance=options.distance, shapes=shapes,
            progress=progress,
            **{name: values[0] if len(values) == 1 else values for name, values in (
                ('velocity', options.velocity), ('acceleration', options.acceleration))})
    write(found, options.out, options.rate)
    for remark in remarks(found, options.distance):
        print(f'kane-dynamics: warning: {remark}', file=sys.stderr)
    q, _, _ = found.sample(np.zeros(1))
    (print_json if options.json else print_data)({
        'joint_names': list(found.joint_names), 'condition': found.condition, 'start': q[0],
        'uses': found.uses, 'lowest': found.lowest, 'nearest': found.nearest,
        'files': [options.out]})


def remarks(found: Excitation, distance: float | None) -> list[str]:
    """Return what the motion does not reach: the stated distance, a good condition number."""
    lines = []
    if distance is not None and found.nearest is not None and found.nearest[2] < distance:
        first, second, nearest = found.nearest
        lines.append(f"distance: {nearest:.3f} m between '{first}' and '{second}', which are near "
                     f'each other at rest; expected {distance:g} m, which is kept by links that '
                     'are further apart there')
    if found.condition > BAD_CONDITION:
        lines.append(f'condition number: {found.condition:.3g}; expected at most '
                     f'{BAD_CONDITION:g} for accurate inertial parameters: a longer motion, more '
                     'harmonics or starts, higher limits')
    return lines


def write(found: Excitation, path: str, rate: float) -> None:
    """Write the motion as a table of states."""
    t = found.motion(rate).times
    with whole_file(path) as stream:
        write_states(stream, t, dict(zip(('q', 'u', 'udot'), found.sample(t), strict=True)),
                     found.joint_names)


def print_data(data: dict[str, Any]) -> None:
    """Print the properties of the motion."""
    print(f'condition number of the base parameters {data["condition"]:.3g}; at rest at the start '
          'and the end; shares of limits:')
    inspect_command.print_table(
        ['joint', 'starts at', *data['uses']],
        [[name, data['start'][j], *(f'{100.0 * use[j]:.0f} %' if use[j] > 0.0 else '-'
                                    for use in data['uses'].values())]
         for j, name in enumerate(data['joint_names'])])
    if data['lowest'] is not None:
        link, height = data['lowest']
        print(f"lowest point: {height:.3f} m ('{link}'; the base is at 0)")
    if data['nearest'] is not None:
        first, second, distance = data['nearest']
        print(f"smallest distance between links: {distance:.3f} m ('{first}' and '{second}')")
    for path in data['files']:
        print(f'wrote {path}')
