"""The command `collision-thresholds`: collision detection calibrated to a recording."""

from argparse import Namespace
import sys
from typing import Any

from kane_dynamics._util.whole_files import whole_file
from kane_dynamics.cli.commands import inspect_command
from kane_dynamics.cli.commands.identify_command import recorded, stated_efforts
from kane_dynamics.cli.shared import load, print_json
from kane_dynamics.identification.collision_calibration import (calibrate_collision,
                                                                CollisionCalibration)
from kane_dynamics.identification.payload.recorded_motion import recorded_joints
import numpy as np
import yaml

DIGITS = 4  # significant digits of the node's parameters
CURVES = ('coulomb', 'damping', 'offset')


def collision_thresholds(options: Namespace) -> None:
    """Calibrate collision detection; print the parameters of the node, or write them."""
    model, robot = load(options)
    names = recorded_joints(robot)
    recording = stated_efforts(options).applied(
        robot, recorded(options, model, names if robot.constraint_names else None))
    found = calibrate_collision(robot, recording, gain=options.gain, margin=options.margin,
                                drift=options.drift, held=options.commands)
    parameters = node_parameters(found)
    for remark in remarks(found):
        print(f'kane-dynamics: warning: {remark}', file=sys.stderr)
    if options.out:
        text = yaml.safe_dump({'/**': {'ros__parameters': {'observer': parameters}}},
                              sort_keys=False, default_flow_style=None)
        with whole_file(options.out) as stream:
            stream.write(text)
    data = {'joint_names': list(found.joint_names), 'rows': len(recording),
            'threshold': found.threshold, 'error': found.error,
            'error_time': found.error_time, 'error_before': found.error_before,
            'coulomb': found.coulomb, 'damping': found.damping, 'offset': found.offset,
            'friction_speed': found.friction_speed, 'suspected': list(found.suspected),
            'unmoved': list(found.unmoved), 'held_out_alarms': found.held_out_alarms,
            'node_parameters': parameters, 'files': [options.out] if options.out else []}
    (print_json if options.json else print_data)(data)


def node_parameters(found: CollisionCalibration) -> dict[str, Any]:
    """Return the parameters `observer.*` of the node."""
    friction = {name: _rounded(getattr(found, name)) for name in CURVES}
    return {'gain': found.gain, 'threshold': _rounded(found.threshold),
            'friction': {**friction, 'speed': _rounded(found.friction_speed)}}


def remarks(found: CollisionCalibration) -> list[str]:
    """Return warnings about the recording."""
    lines = []
    for name in found.suspected:
        j = found.joint_names.index(name)
        lines.append(f"recording: external torque {found.error[j]:.3g} at joint '{name}' at "
                     f'{found.error_time[j]:.4g} s, far beyond all others; expected a recording '
                     'without contact and outliers')
    if found.unmoved:
        lines.append(f'recording: {", ".join(found.unmoved)} rest; expected a motion of every '
                     'joint, as thresholds hold for motions like the recorded one')
    if found.held_out_alarms:
        lines.append(f'recording: thresholds of its first half raise {found.held_out_alarms} '
                     'alarms in the second; expected a longer recording of all motions')
    return lines


def print_data(data: dict[str, Any]) -> None:
    """Print thresholds, errors and the friction beyond the model."""
    print(f'{data["rows"]} rows; largest external torque without contact, with the friction of '
          'the model and with the fitted one; N m or N')
    inspect_command.print_table(
        ['joint', 'as modelled', 'error', 'threshold', *CURVES, 'friction speed'],
        [[name, *(f'{data[key][j]:.3g}' for key in (
            'error_before', 'error', 'threshold', *CURVES, 'friction_speed'))]
         for j, name in enumerate(data['joint_names'])])
    print(f'\nalarms in the second half by thresholds of the first: {data["held_out_alarms"]}')
    if not data['files']:
        print('\nparameters of the node:')
        print(yaml.safe_dump({'observer': data['node_parameters']}, sort_keys=False,
                             default_flow_style=None).rstrip())
    for path in data['files']:
        print(f'wrote {path}')


def _rounded(values: Any) -> list[float]:
    """Return numbers with few significant digits."""
    return [float(f'{value:.{DIGITS}g}') for value in np.asarray(values).tolist()]
