"""The command `excite`: a motion to record for `identify`."""

from argparse import Namespace
from collections.abc import Sequence
from typing import Any

from kane_dynamics._util.progress import progress_bar
from kane_dynamics._util.whole_files import whole_file
from kane_dynamics.cli.printing import model_warnings, print_json, print_table, warn
from kane_dynamics.cli.robot_options import load_robot, one_or_all, source_of
from kane_dynamics.cli.tables import write_states
from kane_dynamics.errors import InputError
from kane_dynamics.identification.excitation.clearance import DISTANCE
from kane_dynamics.identification.excitation.friction_motion import friction_motion
from kane_dynamics.identification.excitation.optimal_excitation import Excitation, excite
from kane_dynamics.model.link_shapes import LinkShape
from kane_dynamics.model.model import Model
from kane_dynamics.urdf.link_shapes import load_collision_shapes
import numpy as np

LOADS = 3  # of a friction motion, unless stated
BAD_CONDITION = 1e3  # of the base parameters' equations, columns scaled to unit length


def excitation(options: Namespace) -> int:
    """Write an exciting motion for `identify`; return 1 if its links come nearer than stated."""
    model, _ = load_robot(options)
    if not 0.0 < options.rate < np.inf:
        raise InputError(f'--rate: {options.rate}; expected a positive, finite number '
                         'of Hz')
    # Distances are kept where there are shapes; only a stated one is checked
    # afterwards.
    with model_warnings():
        shapes = load_collision_shapes(source_of(options))
    distance_stated = 'distance' in options.stated
    distance = options.distance if distance_stated else DISTANCE
    if options.friction:
        return _friction(options, model, shapes, distance)
    with progress_bar('searching', 1.0) as progress:
        motion = excite(
            model, duration=options.duration, harmonics=options.harmonics,
            periods=options.periods, seed=options.seed, starts=options.starts,
            share=options.share, floor=options.floor, distance=distance, shapes=shapes,
            velocity=one_or_all(options.velocity),
            acceleration=one_or_all(options.acceleration), progress=progress)
    _write(motion, options.out, options.rate)

    # The motion is written in any case; a distance that was stated but missed is an error.
    too_near = None
    if distance_stated:
        too_near = missed_distance(motion, distance)
    for warning in (too_near, bad_condition(motion)):
        if warning is not None:
            warn(warning)
    start, _, _ = motion.sample(np.zeros(1))
    data = {'joint_names': list(motion.joint_names), 'condition': motion.condition,
            'start': start[0], 'uses': motion.uses, 'lowest': motion.lowest,
            'nearest': motion.nearest, 'files': [options.out]}
    if options.json:
        print_json(data)
    else:
        _print_data(data)
    return 0 if too_near is None else 1


def _friction(options: Namespace, model: Model, shapes: Sequence[LinkShape],
              distance: float | None) -> int:
    """Write a motion of slow reversals for `identify --friction-only`."""
    loads = LOADS if options.loads is None else options.loads
    motion = friction_motion(model, loads=loads, share=options.share,
                             seed=options.seed, floor=options.floor, shapes=shapes,
                             distance=distance)
    # Whole rows: the last one is at the end, where the arm rests.
    rows = int(np.ceil(motion.duration * options.rate - 1e-9)) + 1
    t = np.linspace(0.0, motion.duration, rows)
    states = dict(zip(('q', 'u', 'udot'), motion.sample(t), strict=True))
    with whole_file(options.out) as stream:
        write_states(stream, t, states, motion.joint_names)
    start = motion.sample(np.zeros(1))[0][0]
    data = {'joint_names': list(motion.joint_names), 'duration': motion.duration,
            'start': start, 'loads': loads, 'files': [options.out]}
    if options.json:
        print_json(data)
        return 0
    print(f'slow reversals under {loads} loads, {motion.duration:.0f} s; at rest '
          'at each reversal, at the start and the end:')
    print_table(['joint', 'starts at'],
                [[name, x] for name, x in zip(motion.joint_names, start)])
    print(f'wrote {options.out}')
    return 0


def missed_distance(motion: Excitation, distance: float | None) -> str | None:
    """Return a warning if links come nearer to each other than the stated distance, m."""
    if distance is None or motion.nearest is None:
        return None
    first, second, nearest = motion.nearest
    if nearest >= distance:
        return None
    return (f"--distance: {distance:g} m is missed, exit code 1: '{first}' and "
            f"'{second}' come to {nearest:.3f} m, because they are near each other at "
            'rest and keep half of their distance there; expected --distance '
            f'{nearest:.3f} or less, which these links keep')


def bad_condition(motion: Excitation) -> str | None:
    """Return a warning if the motion determines some parameters badly."""
    if motion.condition <= BAD_CONDITION:
        return None
    return (f'condition number: {motion.condition:.3g}; expected at most '
            f'{BAD_CONDITION:g} for accurate inertial parameters: a longer motion, more '
            'harmonics or starts, higher limits')


def _write(motion: Excitation, path: str, rate: float) -> None:
    """Write the motion as a table of states."""
    t = motion.motion(rate).times
    states = dict(zip(('q', 'u', 'udot'), motion.sample(t), strict=True))
    with whole_file(path) as stream:
        write_states(stream, t, states, motion.joint_names)


def _print_data(data: dict[str, Any]) -> None:
    """Print the properties of the motion."""
    print(f'condition number of the base parameters {data["condition"]:.3g}; at rest at '
          'the start and the end; shares of limits:')
    # A joint that does not use a limit gets a dash.
    table = []
    for j, name in enumerate(data['joint_names']):
        row = [name, data['start'][j]]
        for use in data['uses'].values():
            row.append(f'{100.0 * use[j]:.0f} %' if use[j] > 0.0 else '-')
        table.append(row)
    print_table(['joint', 'starts at', *data['uses']], table)
    if data['lowest'] is not None:
        link, height = data['lowest']
        print(f"lowest point: {height:.3f} m ('{link}'; the base is at 0)")
    if data['nearest'] is not None:
        first, second, distance = data['nearest']
        print(f"smallest distance between links: {distance:.3f} m ('{first}' and "
              f"'{second}')")
    for path in data['files']:
        print(f'wrote {path}')
