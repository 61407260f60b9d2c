"""The command `identify`: tables, JSON, pictures, and files for load_urdf."""

from argparse import Namespace
from collections.abc import Callable, Sequence
import contextlib
from dataclasses import dataclass, replace
import io
import os
from pathlib import Path
import sys
from typing import Any

from kane_dynamics._util.progress import progress_bar
from kane_dynamics._util.typing import Array
from kane_dynamics._util.whole_files import whole_file
from kane_dynamics.analysis.known_arms import EffortKind
from kane_dynamics.cli import pictures
from kane_dynamics.cli.printing import as_json, print_json, print_table, warn
from kane_dynamics.cli.robot_options import (every_joint, load_robot, one_or_all,
                                             source_of, warn_degrees)
from kane_dynamics.errors import InputError
from kane_dynamics.identification.drives.drive_recording import read_drive_recording
from kane_dynamics.identification.drives.identify_drives import (DriveIdentification,
                                                                 identify_drives)
from kane_dynamics.identification.efforts import Efforts
from kane_dynamics.identification.fit import Identification, identify
from kane_dynamics.identification.friction_laws import COULOMB, CoupledMotor, phases
from kane_dynamics.identification.payload.payload_fit import identify_payload, Payload
from kane_dynamics.identification.payload.recorded_motion import (recorded_joints,
                                                                  recorded_motion)
from kane_dynamics.identification.recordings.diagnosis import refuse_faulty
from kane_dynamics.identification.recordings.reader import (positions_by_name,
                                                            read_recording)
from kane_dynamics.identification.recordings.recording import Recording
from kane_dynamics.identification.regression import FRICTION, LOWEST, rms
from kane_dynamics.identification.result_files import (six, written, written_drives,
                                                       written_payload)
from kane_dynamics.mechanics.recursive.regressor import inertial_parameters, PARAMETERS
from kane_dynamics.model.model import Model, with_payload
from kane_dynamics.robot.robot import Robot
from kane_dynamics.urdf.mjcf_text import mjcf_text
import numpy as np

AXES = 'xyz'
DRIVE_NUMBERS = ('stiffness', 'damping', 'rotor_inertia', 'skew', 'torque_delay')
KNOWN = 0.05  # m, of a center of mass that is printed
NEAR = 0.1  # rad or m, of locked joints: computed at 0 in place of their positions
FURTHER = ('fast_damping', 'load_friction', 'presliding')  # terms of friction laws


@dataclass(frozen=True)
class Outcome:
    """The result of a fit: what is printed, and the torques that the picture compares."""

    data: dict[str, Any]
    t: Array
    measured: Array
    computed: Array
    before: Array | None = None
    border: float | None = None


def identification(options: Namespace) -> None:
    """Identify a model or a payload; print it, draw or write it on request."""
    if options.drives:
        _identify_drives(options)
        return
    # A missing library is an error before the fit, which may take minutes.
    plot = pictures.plotter(options)  # errors early
    model, robot = load_robot(options)
    if options.payload:
        fit, printed, title = _fit_payload, print_payload, 'of the arm with its payload'
        outcome = fit(options, robot)
    else:
        _require_tree_torques(options)
        printed, title = print_model, 'of the identified model'
        outcome = _fit_model(options, model)
    # All kinds of fits have the measured and the computed torque for the picture.
    data = outcome.data
    if plot is not None:
        names = data['joint_names']
        plot.plot_replay(outcome.t, outcome.measured, outcome.computed, names,
                         options.plot, prismatic=model.sliding,
                         limits=_effort_limits(robot, names), before=outcome.before,
                         border=outcome.border,
                         title=f'{model.name}: measured torque, and torque {title}')
        data['files'] = [*data['files'], options.plot]
    if options.report:
        _write_report(options, model.name, printed, data)
        data['files'] = [*data['files'], options.report]
    if options.json:
        print_json(data)
    else:
        printed(data)


def _write_report(options: Namespace, name: str, printed: Callable[[dict[str, Any]], None],
                  data: dict[str, Any]) -> None:
    """Write what is printed, and the picture, as Markdown."""
    text = io.StringIO()
    with contextlib.redirect_stdout(text):
        printed(data)
    with whole_file(options.report) as stream:
        stream.write(f'# {name}: {options.recording}\n\n```text\n{text.getvalue()}```\n')
        if options.plot:
            picture = os.path.relpath(options.plot, Path(options.report).parent)
            stream.write(f'\n![measured and computed torques]({picture})\n')


def _require_tree_torques(options: Namespace) -> None:
    """Raise InputError for efforts that only the fit of a payload takes."""
    if stated_efforts(options).kind is EffortKind.EXTERNAL_TORQUE:
        raise InputError('--efforts external_torque: excludes the torques of the arm itself, '
                         'which are identified; expected other efforts, or --payload')


def _effort_limits(robot: Robot, names: Sequence[str]) -> Array:
    """Return the effort limits of some joints."""
    places = list(map(robot.joint_names.index, names))
    return np.asarray(robot.limits.effort)[places]


# The recording that a fit takes.

def recorded(options: Namespace, model: Model,
             joints: Sequence[str] | None = None) -> Recording:
    """Return the recording of all joints, or of some, resampled and filtered on request."""
    # Columns by number count through the joints of the robot, also those not asked for.
    numbered = every_joint(options)
    if numbered is None and joints is not None:
        numbered = model.joint_names
    recording = read_recording(options.recording, joints or model.joint_names,
                               options.topic, numbered=numbered)
    if numbered is not None:
        locked = [joint for joint in numbered if joint not in model.joint_names]
        _warn_locked(options.recording, locked)
    if options.derive_speeds:
        recording = recording.with_derived_speeds()
    if options.resample is not None:
        recording = recording.resampled(options.resample)
    # Filters need equal times; the user learns what was done.
    elif options.cutoff is not None and recording.uneven:
        step = np.diff(recording.t)
        print(f'kane-dynamics: note: rows are {step.min():g} to {step.max():g} s apart; '
              f'resampled at {1.0 / step.mean():.4g} Hz (--resample)', file=sys.stderr)
    return recording if options.cutoff is None else recording.filtered(options.cutoff)


def _warn_locked(path: str, locked: Sequence[str]) -> None:
    """Warn of locked joints that are elsewhere in a recording."""
    elsewhere = []
    for joint, q in positions_by_name(path, locked).items():
        if np.abs(q).max() > NEAR:
            elsewhere.append(f"'{joint}' ({q.min():.3g} to {q.max():.3g})")
    if elsewhere:
        warn(f'{path}: joints that are computed at 0 are elsewhere: {", ".join(elsewhere)}; '
             'expected all joints that are not at 0 among --joints')


def stated_efforts(options: Namespace) -> Efforts:
    """Return the meaning of the efforts of a recording, by the options."""
    constants = options.torque_constants and one_or_all(options.torque_constants)
    return Efforts(options.efforts or EffortKind.MOTOR_TORQUE,
                   not options.efforts_without_gravity, constants)


def examined_recording(options: Namespace, model: Model) -> Recording:
    """
    Return the recording with torques on the joints; print warnings.

    Raise InputError if it contradicts the model.
    """
    efforts = stated_efforts(options)
    recording = efforts.applied(Robot(model), recorded(options, model))
    _examine(options, model, recording)
    return recording


def _examine(options: Namespace, model: Model, recording: Recording) -> None:
    """Print warnings of a recording; raise InputError if it contradicts the model."""
    # Faults that no fit corrects are errors, the others warnings.
    refused = () if options.as_recorded else ('impossible', 'wrong')
    try:
        faults = refuse_faulty(model, recording, refused,
                               gravity_added=options.efforts_without_gravity,
                               without_effort=options.without_effort or ())
    except InputError as error:
        raise InputError(f'{error} (--without-effort JOINT leaves out the efforts of a joint, '
                         '--as-recorded fits all unchanged)') from None
    for fault in faults:
        warn(fault.words)


def _without_doubtful_gravity(options: Namespace,
                              model: Model) -> tuple[Model, Recording]:
    """
    Return model and recording for a fit of the model.

    Efforts without gravity are fitted without gravity: that of the given model, by which
    the recording is checked, is not to be believed.
    """
    recording = examined_recording(options, model)
    if stated_efforts(options).gravity:
        return model, recording
    weight = Robot(model).gravity_force(recording.q)
    return (replace(model, gravity=np.zeros(3)),
            replace(recording, tau=recording.tau - weight))


# A model.

def _fit_model(options: Namespace, model: Model) -> Outcome:
    """Identify a model, and write --out."""
    # Efforts may lack the weight that the arm compensates: the fit takes it into
    # account.
    model, recording = _without_doubtful_gravity(options, model)
    with progress_bar('identifying', 1.0) as progress:
        result = identify(model, recording, test=_test(options, model),
                          friction_only=options.friction_only,
                          bounded=not options.unbounded, weight=options.weight,
                          standstill=options.standstill, friction=options.friction,
                          coupled=options.coupled or (),
                          without_effort=options.without_effort or (), diagnosed=True,
                          progress=progress)
    files: Sequence[str] = ()
    if options.out:
        files = write_model(source_of(options), result.model, options.out, result.coupled)
    data = {**model_data(result, recording), 'files': list(files)}
    if options.base_parameters:
        base, values, deviations = result.base
        data['base_parameters'] = {'names': list(base.names), 'values': values,
                                   'standard_deviations': deviations}
    before = Robot(model).inverse_dynamics(recording.q, recording.u, recording.udot)
    border = None
    if options.test is None:
        border = float(recording.t[np.argmax(phases(recording) >= 0.5)])
    return Outcome(data, recording.t, recording.tau, result.torque(recording), before, border)


def _test(options: Namespace, model: Model) -> Recording | None:
    """Return the recording of --test, read by the same options; None without one."""
    if options.test is None:
        return None
    stated = Namespace(**{**vars(options), 'recording': options.test})
    return _without_doubtful_gravity(stated, model)[1]


def _coupled_data(result: Identification) -> list[dict[str, Any]]:
    """Return the coupled motors as plain data."""
    return [{**motor._asdict(), 'joints': list(motor.joints)} for motor in result.coupled]


def model_data(result: Identification, recording: Recording) -> dict[str, Any]:
    """Return an identified model as plain data."""
    # With bounds removed the friction may be negative, and there is no identified model.
    bodies = (result.given if result.friction_only else result.model).bodies
    friction = dict(zip(FRICTION, result.losses.T.tolist(), strict=True))
    friction['friction_speed'] = result.friction_speed.tolist()
    for name in FURTHER:
        friction[name] = getattr(result, name).tolist()
    # The errors of all laws of friction that were tried, on rows in motion and on all.
    candidates = {}
    for law, errors in result.candidates.items():
        candidates[law] = {'rms': errors.every, 'rms_moving': errors.moving}
    return {
        'joint_names': list(result.given.joint_names), 'rows': len(recording),
        'rms_before': result.before, 'rms_fitted': result.fitted,
        'rms_held_out': result.held_out, 'rms_fitted_moving': result.fitted_moving,
        'rms_held_out_moving': result.held_out_moving, 'friction': friction,
        'rms_torque_deviation': rms(result.torque_deviation(recording)),
        'law': result.law, 'candidates': candidates, 'tested': result.tested,
        'coupled': _coupled_data(result),
        'suspected': [list(pair) for pair in result.suspected],
        'standard_deviations': dict(zip(FRICTION, result.deviations.T.tolist(),
                                        strict=True)),
        'inertials': _identifiable(result),
        'masses': {body.name: body.inertial.mass for body in bodies},
        'condition': result.condition, 'prior_weight': result.weight}


def _identifiable(result: Identification) -> dict[str, dict[str, dict[str, float]]]:
    """Return value and deviation of the inertial parameters that are identifiable one by one."""
    if result.friction_only:
        return {}
    values = inertial_parameters(result.model).reshape(-1, 10)
    table: dict[str, dict[str, dict[str, float]]] = {}
    for body, row, deviations in zip(result.model.bodies, values,
                                     result.inertial_deviations, strict=True):
        table[body.name] = {}
        for name, value, deviation in zip(PARAMETERS, row, deviations, strict=True):
            if np.isfinite(deviation):
                table[body.name][name] = {'value': float(value),
                                          'deviation': float(deviation)}
    return table


def print_model(data: dict[str, Any]) -> None:
    """Print the result of `model_data`."""
    judged = 'the test recording' if data['tested'] else 'the second half'
    fitted = 'to all rows' if data['tested'] else 'to the first half'
    print(f'{data["rows"]} rows, all of them fitted; held out: a fit {fitted}, judged on '
          f'{judged}; RMS of torque error, N m or N, of all rows and of those in motion')
    errors = ('rms_before', 'rms_held_out', 'rms_fitted', 'rms_held_out_moving',
              'rms_fitted_moving')
    print_table(['joint', 'before', 'held out', 'fitted', 'held out, moving',
                 'fitted, moving'],
                zip(data['joint_names'], *(data[name] for name in errors), strict=True))
    print()
    deviations = ', '.join(f'{x:.2g}' for x in data['rms_torque_deviation'])
    print(f'standard deviation of the torques by uncertain values: {deviations} N m or N\n')
    _print_laws(data)
    _print_friction(data)
    # Parameters that the motion determines alone, not only in combinations.
    identifiable = []
    for body, row in data['inertials'].items():
        for name, pair in row.items():
            identifiable.append((f'{body}.{name}', pair['value'],
                                 f'{pair["deviation"]:.1g}'))
    if identifiable:
        print('\ninertial parameters that are identifiable one by one; kg, m, about the origin')
        print_table(['parameter', 'value', '+-'], identifiable)
    if 'base_parameters' in data:
        columns = data['base_parameters']
        spread = [f'{deviation:.1g}' for deviation in columns['standard_deviations']]
        print()
        print_table(['value', '+-', 'base parameter'],
                    zip(columns['values'], spread, columns['names'], strict=True))
    print(f'\ncondition number {data["condition"]:.3g}, weight of the prior '
          f'{data["prior_weight"]:g}')
    _print_files(data)


def _print_laws(data: dict[str, Any]) -> None:
    """Print the errors of all laws of friction, and what the chosen ones add."""
    if data['candidates']:
        print('laws of friction: RMS of torque error, N m or N, on blocks that the fit left '
              'out, of all rows / in motion')
        table = []
        for k, joint in enumerate(data['joint_names']):
            errors = []
            for of_law in data['candidates'].values():
                errors.append(f'{of_law["rms"][k]:.3g} / {of_law["rms_moving"][k]:.3g}')
            table.append([joint, *errors])
        print_table(['joint', *data['candidates']], table)
        print(f'chosen: {data["law"]}\n')
    # What the chosen law adds to Coulomb and viscous friction.
    further = []
    for k, joint in enumerate(data['joint_names']):
        further.append([joint, *[data['friction'][name][k] for name in FURTHER]])
    if data['law'] != COULOMB.name:
        print('further terms; revolute: N m s/rad, 1, and the travel of presliding in rad; '
              'prismatic: N s/m, 1, m')
        print_table(['joint', *FURTHER], further)
        print()
    if data['coupled']:
        print('coupled motors: friction and inertia on the sum or difference of two joints')
        print_table(['joints', 'sign', 'damping', 'friction', 'inertia'],
                    [[f'{row["joints"][0]}, {row["joints"][1]}', row['sign'],
                      row['damping'], row['friction'], row['inertia']]
                     for row in data['coupled']])
        print()
    for first, second, share in data['suspected']:
        print(f"'{first}', '{second}': a motor that turns with both would explain "
              f'{100.0 * share:.0f} % of their errors (--coupled {first} {second})\n')


def _print_friction(data: dict[str, Any]) -> None:
    """Print friction and armature with their deviations, and name the negative ones."""
    header = ['joint']
    for name in FRICTION:
        header += [name, '+-']
    table = []
    negative = []
    for k, joint in enumerate(data['joint_names']):
        row = [joint]
        for name, lowest in zip(FRICTION, LOWEST, strict=True):
            value = data['friction'][name][k]
            row += [value, f'{data["standard_deviations"][name][k]:.1g}']
            if value < lowest:
                negative.append(f'{joint} {name}')
        table.append([*row, data['friction']['friction_speed'][k]])
    print('friction and armature; revolute: N m s/rad, N m, kg m^2, N m, rad/s; prismatic: '
          'N s/m, N, kg, N, m/s')
    print_table([*header, 'friction speed'], table)
    if negative:
        print(f'\nnegative: {", ".join(negative)}; expected values >= 0\n'
              'Inertials or torques of these joints are wrong; no model can be written.')


def write_model(source: str | bytes, model: Model, out: str,
                motors: Sequence[CoupledMotor] = ()) -> list[str]:
    """
    Write <out>.urdf and <out>.supplement.yaml, or an MJCF file; return their names.

    With coupled motors there is also <out>.constraints.yaml; in MJCF they are tendons.
    """
    if out.endswith('.xml'):
        tendons = []
        for motor in motors:
            tendons.append((motor.name, dict(zip(motor.joints, (1.0, motor.sign))),
                            {'damping': motor.damping, 'frictionloss': motor.friction,
                             'armature': motor.inertia}))
        with whole_file(out) as stream:
            stream.write(mjcf_text(model, tendons))
        return [out]
    texts = dict(zip(('urdf', 'supplement.yaml', 'constraints.yaml'),
                     written(source, model, motors), strict=True))
    stem = out.removesuffix('.urdf')
    if not Path(stem).name:
        raise InputError(f"--out: '{out}'; expected the name of a URDF to write")
    paths = []
    for ending, text in texts.items():
        if text:
            paths.append(f'{stem}.{ending}')
            with whole_file(paths[-1]) as stream:
                stream.write(text)
    return paths


# Drives of elastic joints.

def _identify_drives(options: Namespace) -> None:
    """Identify the drives of elastic joints; print them, and write --out."""
    if options.out and not options.out.endswith(('.yaml', '.yml')):
        raise InputError(f"--out: '{options.out}'; expected a name that ends in .yaml, "
                         'since with --drives it is a supplement')
    _, robot = load_robot(options)
    ratio = np.array(one_or_all(options.ratio or [1.0]))
    # With closed loops, the joints with drives are those with actuators.
    recording = read_drive_recording(options.recording, recorded_joints(robot), ratio)
    result = identify_drives(robot, recording, skew=options.skew)
    files = []
    if options.out:
        text = written_drives(options.supplement, result.supplement())
        with whole_file(options.out) as stream:
            stream.write(text)
        files.append(options.out)
    # The result, for JSON or as tables.
    data = drive_data(result, files)
    if options.json:
        print_json(data)
    else:
        print_drives(data)


def drive_data(result: DriveIdentification, files: list[str]) -> dict[str, Any]:
    """Return identified drives as plain data; undetermined numbers are None."""
    data: dict[str, Any] = {'joint_names': list(result.joint_names),
                            'source': result.source}
    # JSON has no infinity: numbers that the data leave open are null.
    for name in DRIVE_NUMBERS:
        for key in (name, f'{name}_deviation'):
            numbers: list[float | None] = []
            for value in getattr(result, key):
                numbers.append(float(value) if np.isfinite(value) else None)
            data[key] = numbers
    return {**data, 'skew_share': result.skew_share,
            'misfit': result.misfit, 'undetermined': result.undetermined, 'files': files}


def print_drives(data: dict[str, Any]) -> None:
    """Print the identified drives, and what the data do not determine."""
    print(f'drives, joint-side, by {data["source"]}; N m/rad, N m s/rad, kg m^2, s')
    header = ['joint']
    for name in DRIVE_NUMBERS:
        header += [name.replace('_', ' '), '+-']
    table = []
    for k, joint in enumerate(data['joint_names']):
        row = [joint]
        for name in DRIVE_NUMBERS:
            value = data[name][k]
            deviation = data[f'{name}_deviation'][k]
            row += ['-', '-'] if value is None else [value, f'{deviation:.1g}']
        table.append(row)
    print_table(header, table)
    # The encoders' delay looks like a deflection: the user learns how much of it.
    for joint, share in zip(data['joint_names'], data['skew_share'], strict=True):
        if share > 0.05:
            print(f"'{joint}': the delay of the link's encoder moves the measured deflection "
                  f'by {share:.0%} of its size; it is removed')
    if data['undetermined']:
        print('\nnot determined by the recording')
        for name, reason in data['undetermined'].items():
            print(f'{name}: {reason}')
    _print_files(data)


# A payload.

def _fit_payload(options: Namespace, robot: Robot) -> Outcome:
    """Identify a payload, and write --out."""
    names = recorded_joints(robot)
    recording = stated_efforts(options).applied(robot,
                                                recorded(options, robot.model, names))
    # The torques of single joints of a loop are not those of the tree.
    if robot.constraint_names:
        q = np.zeros((len(recording), robot.n_q))
        q[:, list(map(robot.joint_names.index, names))] = recording.q
        warn_degrees(robot, q, options.recording)
        payload = identify_payload(robot, recording, options.payload)
    else:
        payload = _examined_payload(options, robot, recording)
    if options.out:
        _write_payload(options, payload)
    data = {**payload_data(payload, options.payload), 'joint_names': list(names),
            'rows': len(recording), 'files': [options.out] if options.out else []}
    # Torques of the arm with this payload, for the picture.
    carrying = robot.with_payload(options.payload, payload.inertial)
    q, u, udot, _, _ = recorded_motion(carrying, names, recording)
    of_joints = carrying.joint_torques(carrying.inverse_dynamics(q, u, udot), q)
    computed = of_joints[:, list(map(robot.joint_names.index, names))]
    return Outcome(data, recording.t, recording.tau, computed)


def _examined_payload(options: Namespace, robot: Robot, recording: Recording) -> Payload:
    """Return the payload of a tree after a check of the recording with this payload."""
    model = robot.model
    try:
        payload = identify_payload(robot, recording, options.payload)
    except InputError:
        _examine(options, model, recording)  # a fault of the recording is the reason
        raise
    # The empty arm does not describe the torques of a loaded one.
    _examine(options, with_payload(model, options.payload, payload.inertial), recording)
    mass = payload.inertial.mass
    moving_mass = sum(body.inertial.mass for body in model.bodies)
    if mass > moving_mass and not options.as_recorded:
        raise InputError(f'recording: {mass:.4g} kg of payload, more than the {moving_mass:.4g} '
                         'kg of the arm that move; expected efforts in N m or N '
                         '(--as-recorded fits it unchanged)')
    return payload


def _write_payload(options: Namespace, payload: Payload) -> None:
    """Write the supplement with the payload."""
    if not options.out.endswith(('.yaml', '.yml')):
        raise InputError(f"--out: '{options.out}'; expected a name that ends in .yaml, "
                         'since with --payload it is a supplement')
    text = written_payload(options.supplement, options.payload, payload.inertial)
    with whole_file(options.out) as stream:
        stream.write(text)


def payload_data(payload: Payload, frame: str) -> dict[str, Any]:
    """Return an identified payload as plain data."""
    inertial = payload.inertial
    return {
        'frame': frame, 'is_present': payload.is_present, 'mass': inertial.mass,
        'com': inertial.com,
        'inertia': inertial.inertia,
        'standard_deviations': {'mass': payload.mass_deviation,
                                'com': [float(x) if np.isfinite(x) else None
                                        for x in payload.com_deviation],
                                'inertia': payload.inertia_deviation},
        'rms_residual': payload.residual, 'rms_held_out': payload.held_out,
        'condition': payload.condition,
        'node_parameters': {'payload.frame': frame, 'payload.mass': inertial.mass,
                            'payload.com': inertial.com,
                            'payload.inertia': six(inertial)}}


def print_payload(data: dict[str, Any]) -> None:
    """Print the payload, its deviations, and the parameters of the node."""
    print(f"{data['rows']} rows; payload in axes of '{data['frame']}', condition number "
          f'{data["condition"]:.3g}')
    if not data['is_present']:
        print(f'no payload: {data["mass"]:.3g} kg is within its deviation')
    # Mass, center of mass and inertia, each with its standard deviation.
    deviations = data['standard_deviations']
    table = [('mass [kg]', data['mass'], f'{deviations["mass"]:.1g}')]
    for k, axis in enumerate(AXES):
        deviation = deviations['com'][k]
        is_known = deviation is not None and deviation < KNOWN
        table.append((f'center of mass {axis} [m]', data['com'][k] if is_known else '-',
                      f'{deviation:.1g}' if is_known else '-'))
    for r, s in zip(*np.triu_indices(3), strict=True):
        table.append((f'inertia {AXES[r]}{AXES[s]} [kg m^2]', data['inertia'][r, s],
                      f'{deviations["inertia"][r, s]:.1g}'))
    print_table(['', 'value', '+-'], table)
    print()
    print_table(['joint', 'RMS residual', 'held out'],
                zip(data['joint_names'], data['rms_residual'], data['rms_held_out'],
                    strict=True))
    # The same numbers, as the node reads them.
    print('\nparameters of the node:')
    for name, value in data['node_parameters'].items():
        text = value if isinstance(value, str) else as_json(value)
        print(f'  {name}: {text}')
    _print_files(data)


def _print_files(data: dict[str, Any]) -> None:
    """Print the names of the files that were written."""
    for path in data['files']:
        print(f'wrote {path}')
