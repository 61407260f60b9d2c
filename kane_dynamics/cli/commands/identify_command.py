"""The command `identify`: tables, JSON, and files for load_urdf."""

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
import sys
from typing import Any

from kane_dynamics._util.progress import progress_bar
from kane_dynamics._util.whole_files import whole_file
from kane_dynamics.analysis.known_arms import EffortKind
from kane_dynamics.cli.commands import inspect_command
from kane_dynamics.cli.shared import (as_json, every_joint, load, print_json, source_of,
                                      warn_degrees)
from kane_dynamics.errors import InputError
from kane_dynamics.identification.base_regressor import base_error, base_speeds, fit_base
from kane_dynamics.identification.efforts import Efforts
from kane_dynamics.identification.fit import Identification, identify
from kane_dynamics.identification.payload.payload_fit import identify_payload
from kane_dynamics.identification.payload.recorded_motion import recorded_joints
from kane_dynamics.identification.recordings.diagnosis import refuse as refuse_unlike
from kane_dynamics.identification.recordings.reader import read_recording
from kane_dynamics.identification.recordings.recording import Recording
from kane_dynamics.identification.regression import FRICTION, LOWEST, rms, rows
from kane_dynamics.identification.result_files import six, written, written_payload
from kane_dynamics.identification.solvers import on_one_processor
from kane_dynamics.mechanics.recursive.regressor import inertial_parameters, PARAMETERS
from kane_dynamics.model.model import Model
from kane_dynamics.robot.robot import Robot
import numpy as np


def recorded(options: Namespace, model: Model, joints: Sequence[str] | None = None) -> Recording:
    """Return the recording of all joints, or of some, resampled and filtered on request."""
    every = every_joint(options) or (None if joints is None else model.joint_names)
    recording = read_recording(options.recording, joints or model.joint_names, options.topic,
                               numbered=every)
    if options.resample is not None:
        recording = recording.resampled(options.resample)
    elif options.cutoff is not None and recording.uneven:
        step = np.diff(recording.t)
        print(f'kane-dynamics: note: rows are {step.min():g} to {step.max():g} s apart; resampled '
              f'at {1.0 / step.mean():.4g} Hz (--resample)', file=sys.stderr)
    return recording if options.cutoff is None else recording.filtered(options.cutoff)


def stated_efforts(options: Namespace) -> Efforts:
    """Return what the efforts of a recording are, by the options."""
    return Efforts(options.efforts or EffortKind.MOTOR_TORQUE,
                   not options.efforts_without_gravity, options.torque_constants)


def checked(options: Namespace, model: Model) -> Recording:
    """
    Return the recording with torques on the joints; print warnings.

    Raise InputError if it contradicts the model.
    """
    efforts = stated_efforts(options)
    recording = efforts.applied(Robot(model), recorded(options, model))
    levels = () if options.as_recorded else ('impossible', 'wrong')
    try:
        found = refuse_unlike(model, recording, levels, gravity_added=not efforts.gravity)
    except InputError as error:
        raise InputError(f'{error} (--as-recorded fits it unchanged)') from None
    for finding in found:
        print(f'kane-dynamics: warning: {finding.words}', file=sys.stderr)
    return recording


def to_fit(options: Namespace, model: Model) -> tuple[Model, Recording]:
    """
    Return model and recording for a fit of the model.

    Efforts without gravity are fitted without gravity: that of the given model, by which the
    recording is checked, is not to be believed.
    """
    recording = checked(options, model)
    if stated_efforts(options).gravity:
        return model, recording
    weight = Robot(model).gravity_force(recording.q)
    return (replace(model, gravity=np.zeros(3)),
            replace(recording, tau=recording.tau - weight))


def identification(options: Namespace) -> None:
    """Identify a model, base parameters or a payload; print it, or write it on request."""
    model, robot = load(options)
    if options.payload and not options.base_parameters:
        (print_json if options.json else print_payload)(run_payload(options, robot))
        return
    if options.constraints:
        raise InputError('--constraints: given without --payload; expected both, as the other '
                         'fits take recordings of trees')
    if stated_efforts(options).kind is EffortKind.EXTERNAL_TORQUE:
        raise InputError('--efforts external_torque: the torques of the arm itself are no part of '
                         'it; expected other efforts, or --payload')
    run, printed = (run_base, print_base) if options.base_parameters else (run_model, print_data)
    data = run(options, model)
    (print_json if options.json else printed)(data)


def run_model(options: Namespace, model: Model) -> dict[str, Any]:
    """Identify a model, write --out, and return the result as plain data."""
    if options.unbounded and not options.friction_only:
        raise InputError('--unbounded: given without --friction-only; expected both')
    model, recording = to_fit(options, model)
    with progress_bar('identifying', 1.0) as progress:
        found = identify(model, recording, friction_only=options.friction_only,
                         bounded=not options.unbounded, weight=options.weight,
                         standstill=options.standstill, diagnosed=True,
                         progress=progress)
    files = write_files(source_of(options), found.model, options.out) if options.out else ()
    return {**as_data(found, recording), 'files': files}


@on_one_processor
def run_base(options: Namespace, model: Model) -> dict[str, Any]:
    """Estimate base parameters by weighted least squares; return the result as plain data."""
    refuse(options, '--base-parameters')
    if options.out or options.payload:
        raise InputError('--base-parameters: given with --out or --payload; expected neither, '
                         'since base parameters are no model')
    model, recording = to_fit(options, model)
    data = rows(model, recording, options.standstill)
    first, second = data.half(second=False), data.half(second=True)
    speeds = base_speeds(first, model)
    found = fit_base(first, model, speeds)
    return {'joint_names': list(model.joint_names), 'rows': len(recording),
            'names': list(found.base.names), 'values': found.values,
            'standard_deviations': found.deviations, 'condition': found.condition,
            'friction_speed': speeds, 'rms_fitted': found.sigma,
            'rms_held_out': rms(base_error(found, second, speeds))}


def print_base(data: dict[str, Any]) -> None:
    """Print the result of `run_base`."""
    print(f'{data["rows"]} rows: fitted to the first half, validated on the second')
    inspect_command.print_table(['value', '+-', 'base parameter'], [
        (value, f'{deviation:.1g}', name) for name, value, deviation in zip(
            data['names'], data['values'], data['standard_deviations'], strict=True)])
    print()
    inspect_command.print_table(['joint', 'RMS fitted', 'held out'], zip(
        data['joint_names'], data['rms_fitted'], data['rms_held_out'], strict=True))
    print(f'\ncondition number {data["condition"]:.3g}')


def refuse(options: Namespace, kind: str) -> None:
    """Raise InputError if an option is given that the chosen kind of fit does not use."""
    for given, name in ((options.friction_only, '--friction-only'),
                        (options.unbounded, '--unbounded'),
                        (options.weight is not None, '--weight'),
                        (options.no_friction, '--no-friction')):
        if given:
            raise InputError(f'{kind}: given with {name}; expected it without {name}')


def run_payload(options: Namespace, robot: Robot) -> dict[str, Any]:
    """Identify a payload, write --out, and return the result as plain data."""
    refuse(options, '--payload')
    names = recorded_joints(robot)
    if robot.constraint_names:  # the torques of single joints of a loop are not those of a tree
        recording = stated_efforts(options).applied(
            robot, recorded(options, robot.model, names))
        every = np.zeros((len(recording), robot.n_q))
        every[:, [robot.joint_names.index(name) for name in names]] = recording.q
        warn_degrees(robot, every, options.recording)
    else:
        recording = checked(options, robot.model)
    found = identify_payload(robot, recording, options.payload)
    load = found.inertial
    if options.out:
        if not options.out.endswith(('.yaml', '.yml')):
            raise InputError(f"--out: '{options.out}'; expected a name that ends in .yaml, since "
                             'with --payload it is a supplement')
        text = written_payload(options.supplement, options.payload, load)
        with whole_file(options.out) as stream:
            stream.write(text)
    return {
        'joint_names': list(names), 'rows': len(recording), 'frame': options.payload,
        'mass': load.mass, 'com': load.com, 'inertia': load.inertia,
        'standard_deviations': {'mass': found.mass_deviation, 'com': found.com_deviation,
                                'inertia': found.inertia_deviation},
        'rms_residual': found.residual, 'rms_held_out': found.held_out,
        'condition': found.condition,
        'node_parameters': {'payload.frame': options.payload, 'payload.mass': load.mass,
                            'payload.com': load.com, 'payload.inertia': six(load)},
        'files': [options.out] if options.out else []}


def print_payload(data: dict[str, Any]) -> None:
    """Print the result of `run_payload`."""
    deviations = data['standard_deviations']
    print(f"{data['rows']} rows; payload in axes of '{data['frame']}', condition number "
          f'{data["condition"]:.3g}')
    moments = [(f'inertia {"xyz"[r]}{"xyz"[s]} [kg m^2]', data['inertia'][r, s],
                deviations['inertia'][r, s]) for r in range(3) for s in range(r, 3)]
    inspect_command.print_table(['', 'value', '+-'], [(name, value, f'{deviation:.1g}') for (
        name, value, deviation) in (
        ('mass [kg]', data['mass'], deviations['mass']),
        *((f'center of mass {axis} [m]', *pair) for axis, *pair in zip(
            'xyz', data['com'], deviations['com'], strict=True)), *moments)])
    print()
    inspect_command.print_table(['joint', 'RMS residual', 'held out'], zip(
        data['joint_names'], data['rms_residual'], data['rms_held_out'], strict=True))
    print('\nparameters of the node:')
    for name, value in data['node_parameters'].items():
        print(f'  {name}: {as_json(value) if not isinstance(value, str) else value}')
    for path in data['files']:
        print(f'wrote {path}')


def as_data(found: Identification, recording: Recording) -> dict[str, Any]:
    """Return the result as plain data."""
    bodies = (found.given if found.friction_only else found.model).bodies
    return {
        'joint_names': list(found.given.joint_names), 'rows': len(recording),
        'rms_before': found.before, 'rms_fitted': found.fitted, 'rms_held_out': found.held_out,
        'rms_fitted_moving': found.fitted_moving, 'rms_held_out_moving': found.held_out_moving,
        'friction': {**dict(zip(FRICTION, found.losses.T.tolist(), strict=True)),
                     'friction_speed': found.friction_speed.tolist()},
        'standard_deviations': dict(zip(FRICTION, found.deviations.T.tolist(), strict=True)),
        'inertials': _identifiable(found),
        'masses': {body.name: body.inertial.mass for body in bodies},
        'condition': found.condition, 'prior_weight': found.weight}


def _identifiable(found: Identification) -> dict[str, dict[str, dict[str, float]]]:
    """Return value and deviation of the inertial parameters that are identifiable one by one."""
    if found.friction_only:
        return {}
    values = inertial_parameters(found.model).reshape(-1, 10)
    return {body.name: {
        name: {'value': float(value), 'deviation': float(deviation)}
        for name, value, deviation in zip(PARAMETERS, row, deviations, strict=True)
        if np.isfinite(deviation)} for body, row, deviations in zip(
            found.model.bodies, values, found.inertial_deviations, strict=True)}


def print_data(data: dict[str, Any]) -> None:
    """Print the result of `as_data`."""
    print(f'{data["rows"]} rows: fitted to the first half, validated on the second; RMS of '
          'torque error, of all rows and of those in motion')
    inspect_command.print_table(
        ['joint', 'before', 'fitted', 'held out', 'fitted, moving', 'held out, moving'], zip(
            data['joint_names'], data['rms_before'], data['rms_fitted'], data['rms_held_out'],
            data['rms_fitted_moving'], data['rms_held_out_moving'], strict=True))
    print()
    deviations = data['standard_deviations']
    inspect_command.print_table(
        ['joint', *(word for name in FRICTION for word in (name, '+-')), 'friction speed'],
        [[joint, *(word for name in FRICTION
                   for word in (data['friction'][name][k], f'{deviations[name][k]:.1g}')),
          data['friction']['friction_speed'][k]]
         for k, joint in enumerate(data['joint_names'])])
    negative = [f'{joint} {name}' for name, lowest in zip(FRICTION, LOWEST, strict=True)
                for joint, value in zip(data['joint_names'], data['friction'][name], strict=True)
                if value < lowest]
    if negative:
        print(f'\nnegative: {", ".join(negative)}; expected values >= 0\n'
              'Inertials or torques of these joints are wrong; no model can be written.')
    known = [(f'{body}.{name}', pair['value'], f'{pair["deviation"]:.1g}')
             for body, row in data['inertials'].items() for name, pair in row.items()]
    if known:
        print('\ninertial parameters that are identifiable one by one; kg, m, about the origin')
        inspect_command.print_table(['parameter', 'value', '+-'], known)
    print(f'\ncondition number {data["condition"]:.3g}, weight of the prior '
          f'{data["prior_weight"]:g}')
    for path in data['files']:
        print(f'wrote {path}')


def write_files(source: str | bytes, model: Model, out: str) -> Sequence[str]:
    """Write <out>.urdf and <out>.supplement.yaml; return their names."""
    urdf, supplement = written(source, model)
    stem = out.removesuffix('.urdf')
    if not Path(stem).name:
        raise InputError(f"--out: '{out}'; expected the name of a URDF to write")
    paths = f'{stem}.urdf', f'{stem}.supplement.yaml'
    for path, text in zip(paths, (urdf, supplement), strict=True):
        with whole_file(path) as stream:
            stream.write(text)
    return paths
