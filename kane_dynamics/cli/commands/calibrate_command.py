"""The command `calibrate`: gravity by held poses, or collision detection by a motion."""

from argparse import Namespace
import os
import sys
from typing import Any

from kane_dynamics._util.optional_imports import extra
from kane_dynamics._util.typing import Array, Flags
from kane_dynamics._util.whole_files import whole_file
from kane_dynamics.cli.commands.identify_command import recorded, stated_efforts
from kane_dynamics.cli.printing import (model_warnings, print_files, print_json,
                                        print_table, warn)
from kane_dynamics.cli.robot_options import every_joint, load_robot, source_of
from kane_dynamics.errors import InputError
from kane_dynamics.identification.collision_calibration import (calibrate_collision,
                                                                CollisionCalibration)
from kane_dynamics.identification.excitation.clearance import Clearance, DISTANCE
from kane_dynamics.identification.payload.recorded_motion import recorded_joints
from kane_dynamics.identification.poses.calibrate_poses import (calibrate_poses,
                                                                FEWEST, PoseCalibration,
                                                                proposed_poses)
from kane_dynamics.identification.poses.held_poses import HeldPoses, read_poses
from kane_dynamics.identification.result_files import written_links
from kane_dynamics.model.model import Inertial, Model
from kane_dynamics.robot.robot import Robot
from kane_dynamics.urdf.link_shapes import load_collision_shapes
import numpy as np
import yaml

DIGITS = 4  # significant digits of the node's parameters
SPARE = 3  # proposed poses for each that is held: some are not reached on a free way
WAY = 30  # configurations of a way that are judged
CURVES = ('coulomb', 'damping', 'offset')


def calibrate(options: Namespace) -> None:
    """Calibrate gravity and scales, or collision detection; print the result, or write it."""
    if (options.recording is None) == (options.live is None):
        raise InputError('POSES, --live: expected one of them')
    if options.collision:
        _calibrate_collision(options)
    else:
        _calibrate_gravity(options)


# Collision detection.

def _calibrate_collision(options: Namespace) -> None:
    """Calibrate collision detection; print the parameters of the node, or write them."""
    model, robot = load_robot(options)
    states = recorded(options, model, recorded_joints(robot))
    recording = stated_efforts(options).applied(robot, states)
    calibration = calibrate_collision(robot, recording, gain=options.gain,
                                      margin=options.margin, drift=options.drift,
                                      held=options.commands)
    # A file that the node reads as it is.
    parameters = node_parameters(calibration)
    for remark in remarks(calibration):
        warn(remark)
    if options.out:
        content = {'/**': {'ros__parameters': {'observer': parameters}}}
        with whole_file(options.out) as stream:
            stream.write(yaml.safe_dump(content, sort_keys=False,
                                        default_flow_style=None))
    # The same facts for JSON and for the printed table.
    data = {'joint_names': list(calibration.joint_names), 'rows': len(recording),
            'threshold': calibration.threshold, 'error': calibration.error,
            'error_time': calibration.error_time,
            'error_before': calibration.error_before,
            'coulomb': calibration.coulomb, 'damping': calibration.damping,
            'offset': calibration.offset, 'friction_speed': calibration.friction_speed,
            'suspected': list(calibration.suspected),
            'unmoved': list(calibration.unmoved),
            'held_out_alarms': calibration.held_out_alarms,
            'node_parameters': parameters,
            'files': [options.out] if options.out else []}
    if options.json:
        print_json(data)
    else:
        _print_collision(data)


def node_parameters(calibration: CollisionCalibration) -> dict[str, Any]:
    """Return the parameters `observer.*` of the node."""
    friction: dict[str, Any] = {}
    for name in CURVES:
        friction[name] = _rounded(getattr(calibration, name))
    friction['speed'] = _rounded(calibration.friction_speed)
    return {'enabled': True, 'gain': calibration.gain,
            'threshold': _rounded(calibration.threshold), 'friction': friction}


def remarks(calibration: CollisionCalibration) -> list[str]:
    """Return warnings about the recording."""
    lines = []
    # What makes thresholds too high, or valid for less than the user may think.
    for name in calibration.suspected:
        j = calibration.joint_names.index(name)
        lines.append(f'recording: external torque {calibration.error[j]:.3g} at joint '
                     f"'{name}' at {calibration.error_time[j]:.4g} s, far beyond all "
                     'others; expected a recording without contact and outliers')
    if calibration.unmoved:
        lines.append(f'recording: {", ".join(calibration.unmoved)} rest; expected a '
                     'motion of every joint, as thresholds hold for motions like the '
                     'recorded one')
    if calibration.held_out_alarms:
        lines.append('recording: thresholds of its first half raise '
                     f'{calibration.held_out_alarms} alarms in the second; expected a '
                     'longer recording of all motions')
    return lines


def _print_collision(data: dict[str, Any]) -> None:
    """Print thresholds, errors and the friction beyond the model."""
    print(f'{data["rows"]} rows; largest external torque without contact, with the '
          'friction of the model and with the fitted one; N m or N')
    columns = ('error_before', 'error', 'threshold', *CURVES, 'friction_speed')
    table = []
    for j, name in enumerate(data['joint_names']):
        table.append([name, *(f'{data[column][j]:.3g}' for column in columns)])
    print_table(['joint', 'as modelled', 'error', 'threshold', *CURVES,
                 'friction speed'], table)
    print(f'\nalarms in the second half by thresholds of the first: {data["held_out_alarms"]}')
    if not data['files']:
        print('\nparameters of the node:')
        content = {'observer': data['node_parameters']}
        print(yaml.safe_dump(content, sort_keys=False, default_flow_style=None).rstrip())
    print_files(data['files'])


def _rounded(values: Any) -> list[float]:
    """Return numbers with few significant digits."""
    return [float(f'{value:.{DIGITS}g}') for value in np.asarray(values).tolist()]


# Gravity.

def _calibrate_gravity(options: Namespace) -> None:
    """Calibrate gravity by held poses; print the result, and write the supplement."""
    model, _ = load_robot(options)
    numbered = every_joint(options)

    def poses(path: str) -> HeldPoses:
        return read_poses(path, model.joint_names, options.topic, numbered=numbered)
    if options.save:
        held = _live_poses(options, model)
        _save(options.save, held, model)
        if options.json:
            print_json({'poses': len(held), 'files': [options.save]})
        else:
            print(f'{len(held)} held poses')
            print_files([options.save])
        return
    loaded = None
    load = None
    if options.loaded:
        com = np.array(options.load_com)
        load = options.load, Inertial(options.load_mass, com, np.zeros((3, 3)))
        loaded = poses(options.loaded)
    if options.live is not None:
        empty = _live_poses(options, model)
    else:
        empty = poses(options.recording)
    result = calibrate_poses(model, empty, loaded=loaded, load=load)
    for remark in gravity_remarks(result):
        warn(remark)
    files = []
    if options.out:
        files = write_calibration(options, result)
    data = gravity_data(result, len(empty) + (0 if loaded is None else len(loaded)), files)
    if options.json:
        print_json(data)
    else:
        print_gravity(data)


def _live_poses(options: Namespace, model: Model) -> HeldPoses:
    """Lead the arm through poses, and return how it holds them."""
    leading = extra('kane_dynamics.ros.common.pose_leader', 'ros', '--live')
    if options.live < FEWEST:
        raise InputError(f'--live: {options.live} poses; expected at least {FEWEST}')
    with model_warnings():
        shapes = load_collision_shapes(source_of(options))
        clearance = Clearance(model, shapes, options.floor, DISTANCE)
    limits = Robot(model).limits

    def separate(q: Array) -> Flags:
        return np.asarray((clearance.room(q) > 0.0).all(axis=1))
    poses = proposed_poses(model, SPARE * options.live, 2.0 * leading.SIDE, separate)

    def free(start: Array, end: Array) -> bool:
        share = np.linspace(0.0, 1.0, WAY)[:, None]
        sides = end + leading.SIDE * np.array([[-1.0], [1.0]])
        return bool(separate(np.vstack([start + share * (end - start), sides])).all())
    leader = leading.PoseLeader(model.joint_names, options.topic or 'joint_states',
                                options.move, _announce if options.move else _ask)
    try:
        found: HeldPoses = leader.lead(poses, options.live, limits.velocity, free)
    finally:
        leader.close()
    return found


def _save(path: str, poses: HeldPoses, model: Model) -> None:
    """Write poses as a table."""
    header = ','.join(f'{word}.{name}' for word in ('q', 'tau', 'approach')
                      for name in model.joint_names)
    with whole_file(path) as stream:
        np.savetxt(stream, np.hstack([poses.q, poses.effort, poses.approach]),
                   fmt='%.9g', delimiter=',', header=header, comments='')


def _announce(text: str) -> None:
    """Print what the arm does now."""
    print(text, file=sys.stderr, flush=True)


def _ask(text: str) -> None:
    """Print what a person has to do, and wait for the Enter key."""
    print(f'{text}; then press Enter', file=sys.stderr, flush=True)
    if not sys.stdin.readline():
        raise InputError('standard input: closed; expected the Enter key at each pose, or '
                         '--move TOPIC')


def write_calibration(options: Namespace, result: PoseCalibration) -> list[str]:
    """Write the supplement, and the node's parameters that load it; return their names."""
    text = written_links(source_of(options), result.model, options.supplement)
    stem = options.out.removesuffix('.yaml')
    parameters = {'supplement': os.path.abspath(options.out),
                  'efforts': {'scale': _rounded(result.scale)}}
    content = {'/**': {'ros__parameters': parameters}}
    files = [options.out, f'{stem}.node.yaml']
    texts = text, yaml.safe_dump(content, sort_keys=False, default_flow_style=None)
    for path, written in zip(files, texts, strict=True):
        with whole_file(path) as stream:
            stream.write(written)
    return files


def gravity_remarks(result: PoseCalibration) -> list[str]:
    """Return remarks on scales that the poses do not determine."""
    lines = []
    if result.not_told_apart:
        lines.append('scales of efforts and masses cannot be told apart at '
                     f'{", ".join(result.not_told_apart)}: the result has the masses nearest '
                     'to those of the model; expected further poses with a known load '
                     '(--loaded) for true masses. Torques that hold the arm are right '
                     'nevertheless, if the node takes both the supplement and efforts.scale')
    weightless = np.array(result.model.joint_names)[~result.sees_gravity]
    if len(weightless):
        lines.append(f'{", ".join(weightless.tolist())}: gravity does not load these joints '
                     'in any pose; their scales are not known')
    return lines


def gravity_data(result: PoseCalibration, count: int, files: list[str]) -> dict[str, Any]:
    """Return a calibration as plain data; deviations that are not known are None."""
    deviations = [float(x) if np.isfinite(x) else None for x in result.scale_deviation]
    masses = {body.name: body.inertial.mass for body in result.model.bodies}
    return {'joint_names': list(result.model.joint_names), 'poses': count,
            'scale': result.scale, 'scale_deviation': deviations,
            'offset': result.offset, 'offset_deviation': result.offset_deviation,
            'friction': result.friction, 'rms_before': result.before,
            'rms_held_out': result.held_out, 'parameters': list(result.parameters),
            'values': result.values, 'standard_deviations': result.deviations,
            'masses': masses, 'not_told_apart': list(result.not_told_apart),
            'further_poses': result.further_poses, 'files': files}


def print_gravity(data: dict[str, Any]) -> None:
    """Print scales, offsets, friction, errors, parameters, and poses that would help."""
    print(f'{data["poses"]} held poses; RMS of torque error before and, of poses left out '
          'of the fit, after; N m or N')
    table = []
    for j, name in enumerate(data['joint_names']):
        deviation = data['scale_deviation'][j]
        scale = '?' if deviation is None else f'{deviation * abs(data["scale"][j]):.1g}'
        low, high = data['friction'][j]
        table.append([name, data['rms_before'][j], data['rms_held_out'][j],
                      f'{data["scale"][j]:.4g}', scale, f'{data["offset"][j]:.3g}',
                      f'{data["offset_deviation"][j]:.1g}', f'{low:.2g} to {high:.2g}'])
    print_table(['joint', 'before', 'held out', 'torque per effort', '+-', 'offset', '+-',
                 'friction at rest'], table)
    print('\nmasses and first moments that the joints see; kg, kg m')
    print_table(['value', '+-', 'combination'],
                zip(data['values'], (f'{x:.1g}' for x in data['standard_deviations']),
                    data['parameters'], strict=True))
    print('\nfurther poses that would help most, rad or m; check that the way is free')
    print_table(data['joint_names'], np.round(data['further_poses'], 2).tolist())
    print_files(data['files'])
