"""The command `replay`: measured and computed torques, and what of the arm has changed."""

from argparse import Namespace
import math
from typing import Any

from kane_dynamics._util.whole_files import whole_file
from kane_dynamics.cli import pictures
from kane_dynamics.cli.commands.identify_command import recorded, stated_efforts
from kane_dynamics.cli.printing import print_files, print_json, print_table
from kane_dynamics.cli.robot_options import load_robot, warn_degrees
from kane_dynamics.cli.tables import write_states
from kane_dynamics.errors import InputError
from kane_dynamics.identification.model_watch import ModelWatch
from kane_dynamics.identification.recordings.diagnosis import refuse_faulty
from kane_dynamics.identification.recordings.recording import Recording
from kane_dynamics.identification.recordings.torque_delay import torque_delays
from kane_dynamics.identification.regression import rms
from kane_dynamics.model.model import Model
from kane_dynamics.robot.robot import Robot
import numpy as np


def replay(options: Namespace) -> int:
    """
    Compare measured torques with computed ones.

    Return 1 if the arm has changed since a reference, 2 if no joint could be judged.
    """
    plot = pictures.plotter(options)  # errors early
    model, robot = load_robot(options)
    efforts = stated_efforts(options)
    # Torques on the joints, whatever the efforts of the recording are.
    recording = efforts.applied(robot, recorded(options, model))
    warn_degrees(robot, recording.q, options.recording)
    data = compared(robot, recording, gravity_added=not efforts.gravity)
    if options.reference:
        data |= _changes(options, model, recording)
    if options.out:
        states = {'q': recording.q, 'u': recording.u, 'udot': recording.udot,
                  'tau': data['computed']}
        with whole_file(options.out) as stream:
            write_states(stream, recording.t, states, robot.joint_names)
    if plot is not None:
        plot.plot_replay(data['t'], data['measured'], data['computed'],
                         robot.joint_names, options.plot, prismatic=model.sliding,
                         limits=robot.limits.effort,
                         title=f'{model.name}: measured and computed torque')
    data['files'] = [path for path in (options.out, options.plot) if path]
    if options.json:
        print_json(data)
    else:
        _print_comparison(data)
    if data.get('alarms'):
        return 1
    return 2 if data.get('not_judged') == list(model.joint_names) else 0


def _changes(options: Namespace, model: Model, recording: Recording) -> dict[str, Any]:
    """Return the changes since a reference, and the joints that cannot be judged."""
    # The reference is read by the same options as the recording, and has to be sound.
    efforts = stated_efforts(options)
    references = []
    for path in options.reference:
        stated = Namespace(**{**vars(options), 'recording': path})
        reference = efforts.applied(Robot(model), recorded(stated, model))
        try:
            refuse_faulty(model, reference, gravity_added=not efforts.gravity)
        except InputError as error:
            raise InputError(f'--reference: {error}') from None
        references.append(reference)
    watch = ModelWatch(model, references, smallest=options.smallest)
    report = watch.report(recording)
    alarms = [{**alarm._asdict(), 'words': str(alarm)} for alarm in report.alarms]
    return {'reference_rms': report.reference, 'alarms': alarms,
            'not_judged': np.array(model.joint_names)[~report.judged].tolist(),
            'smallest': watch.smallest,
            'larger': np.array(model.joint_names)[report.larger].tolist()}


def compared(robot: Robot, recording: Recording, *, gravity_added: bool = False
             ) -> dict[str, Any]:
    """
    Return computed torques, their difference from the measured ones, and remarks.

    Raises
    ------
    InputError
        If positions, speeds and times contradict each other.

    """
    # Faults that make a comparison meaningless are errors.
    faults = refuse_faulty(robot.model, recording, ('impossible',),
                           gravity_added=gravity_added)
    delays = torque_delays(robot.model, recording)
    tau = robot.inverse_dynamics(recording.q, recording.u, recording.udot)
    error = recording.tau - tau
    return {'joint_names': list(robot.joint_names), 'rows': len(recording),
            't': recording.t,
            'computed': tau, 'measured': recording.tau,
            'rms_measured': rms(recording.tau),
            'rms_error': rms(error), 'mean_error': error.mean(axis=0),
            'largest_error': np.abs(error).max(axis=0),
            'torque_delay': np.where(delays.judged, delays.delay, np.nan).tolist(),
            'torque_delay_deviation': np.where(delays.judged, delays.deviation,
                                               np.nan).tolist(),
            'common_torque_delay': delays.common,
            'common_torque_delay_deviation': delays.common_deviation,
            'contradicts_model': any(fault.level == 'wrong' for fault in faults),
            'remarks': [fault.words for fault in faults]}


def _print_comparison(data: dict[str, Any]) -> None:
    """Print the result of `compared`, and the files."""
    print(f'{data["rows"]} rows over {data["t"][-1] - data["t"][0]:.6g} s; torques in N '
          'm or N')
    columns = ('joint_names', 'rms_measured', 'rms_error', 'mean_error', 'largest_error')
    print_table(['joint', 'RMS measured', 'RMS difference', 'mean difference',
                 'largest'],
                zip(*(data[name] for name in columns), strict=True))
    print(f'\ndelay of the torques after the motion: {_delay_in_words(data)}')
    for remark in data['remarks']:
        print(f'\nremark: {remark}')
    if 'alarms' in data:
        _print_changes(data)
    print_files(data['files'])


def _print_changes(data: dict[str, Any]) -> None:
    """Print what of the arm has changed since the reference."""
    print('\nRMS of measured minus computed torque, N m or N')
    print_table(['joint', 'recording', 'reference'],
                zip(data['joint_names'], data['rms_error'], data['reference_rms'],
                    strict=True))
    for alarm in data['alarms']:
        print(alarm['words'])
    at_rest = data['not_judged']
    if len(at_rest) == len(data['joint_names']):
        print('cannot judge: the arm rests, or hardly moves; expected a motion')
    elif not data['alarms']:
        _print_without_alarm(data)
    if at_rest:
        print(f'cannot judge, at rest: {", ".join(at_rest)}')


def _print_without_alarm(data: dict[str, Any]) -> None:
    """Print that joints in motion are as in the reference, or what is below an alarm."""
    if not data['larger']:
        print('the model describes the joints in motion as it describes the reference')
        return
    print(f'no alarm, but a larger difference than in the reference: '
          f'{", ".join(data["larger"])}; a change is an alarm from '
          f'{data["smallest"]:.2g} of the friction of its joint on (--smallest)')


def _delay_in_words(data: dict[str, Any]) -> str:
    """Return the common delay, and the joints whose delay is unknown, as text."""
    delay = data['common_torque_delay']
    if math.isnan(delay):
        return 'cannot be judged'
    text = f'{delay:.4f} +- {data["common_torque_delay_deviation"]:.1g} s'
    unknown = []
    for name, of_joint in zip(data['joint_names'], data['torque_delay'], strict=True):
        if math.isnan(of_joint):
            unknown.append(name)
    if unknown:
        text += f'; cannot be judged: {", ".join(unknown)}'
    if data['contradicts_model']:
        text += '; unreliable, because torques contradict the model (below)'
    return text
