"""The command `identify`: a table for people, JSON for programs, files for load_urdf."""

from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from kane_dynamics.cli import inspection
from kane_dynamics.errors import InputError
from kane_dynamics.identification.equations import FRICTION
from kane_dynamics.identification.files import written
from kane_dynamics.identification.fit import Identification, identify
from kane_dynamics.identification.recording import read_recording, Recording
from kane_dynamics.model import Model
from kane_dynamics.progress import progress_bar


def recorded(options: Namespace, model: Model) -> Recording:
    """Return the recording that the arguments name, filtered if they say so."""
    recording = read_recording(options.recording, model.joint_names, options.topic)
    return recording if options.cutoff is None else recording.filtered(options.cutoff)


def run(options: Namespace, source: str | bytes, model: Model) -> dict[str, Any]:
    """Identify, write what --out asks for, and return the result as plain data."""
    recording = recorded(options, model)
    with progress_bar('identifying', 1.0) as progress:
        found = identify(model, recording, friction_only=options.friction_only,
                         weight=options.weight, standstill=options.standstill,
                         progress=progress)
    files = write_files(source, found.model, options.out) if options.out else ()
    return {**as_data(found, recording), 'files': files}


def as_data(found: Identification, recording: Recording) -> dict[str, Any]:
    """Return the result as plain data."""
    joints = found.model.coordinate_joints
    return {
        'joint_names': list(found.model.joint_names), 'rows': len(recording),
        'rms_before': found.before, 'rms_fitted': found.fitted, 'rms_held_out': found.held_out,
        'friction': {name: [getattr(joint, name) for joint in joints]
                     for name in (*FRICTION, 'friction_speed')},
        'standard_deviations': dict(zip(FRICTION, found.deviations.T.tolist(), strict=True)),
        'masses': {body.name: body.inertial.mass for body in found.model.bodies},
        'condition': found.condition, 'prior_weight': found.weight}


def print_data(data: dict[str, Any]) -> None:
    """Print what `as_data` returned."""
    print(f'{data["rows"]} rows: fitted to the first half, judged on the second; RMS of torque '
          'error')
    inspection.print_table(['joint', 'before', 'fitted', 'held out'], zip(
        data['joint_names'], data['rms_before'], data['rms_fitted'], data['rms_held_out'],
        strict=True))
    print()
    deviations = data['standard_deviations']
    inspection.print_table(
        ['joint', *(word for name in FRICTION for word in (name, '+-')), 'sets in at'],
        [[joint, *(word for name in FRICTION
                   for word in (data['friction'][name][k], f'{deviations[name][k]:.1g}')),
          data['friction']['friction_speed'][k]]
         for k, joint in enumerate(data['joint_names'])])
    print(f'\ncondition number {data["condition"]:.3g}, weight of the prior '
          f'{data["prior_weight"]:g}')
    for path in data['files']:
        print(f'wrote {path}')


def write_files(source: str | bytes, model: Model, out: str) -> Sequence[str]:
    """Write <out>.urdf and <out>.supplement.yaml; return their names."""
    urdf, supplement = written(source, model)
    stem = out.removesuffix('.urdf')
    if not Path(stem).name:
        raise InputError(f"--out is '{out}'; expected the name of a URDF to write")
    paths = f'{stem}.urdf', f'{stem}.supplement.yaml'
    for path, text in zip(paths, (urdf, supplement), strict=True):
        Path(path).write_text(text, encoding='utf-8')
    return paths
