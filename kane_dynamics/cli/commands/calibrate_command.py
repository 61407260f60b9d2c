"""The command `calibrate`: collision detection calibrated to a recording."""

from argparse import Namespace
from typing import Any

from kane_dynamics._util.whole_files import whole_file
from kane_dynamics.cli.commands.identify_command import recorded, stated_efforts
from kane_dynamics.cli.printing import print_files, print_json, print_table, warn
from kane_dynamics.cli.robot_options import load_robot, uncertainty_of
from kane_dynamics.identification.collision_calibration import (calibrate_collision,
                                                                CollisionCalibration)
from kane_dynamics.identification.payload.recorded_motion import recorded_joints
import numpy as np
import yaml

DIGITS = 4  # significant digits of the node's parameters
CURVES = ('coulomb', 'damping', 'offset')


def calibrate(options: Namespace) -> None:
    """Calibrate collision detection; print the parameters of the node, or write them."""
    model, robot = load_robot(options)
    states = recorded(options, model, recorded_joints(robot))
    recording = stated_efforts(options).applied(robot, states)
    calibration = calibrate_collision(robot, recording, gain=options.gain,
                                      margin=options.margin, drift=options.drift,
                                      held=options.commands,
                                      uncertainty=uncertainty_of(options, model))
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
        _print_data(data)


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


def _print_data(data: dict[str, Any]) -> None:
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
