"""The command `replay`: computed and measured torques of a recording."""

from argparse import Namespace
import math
from typing import Any

from kane_dynamics._util.whole_files import whole_file
from kane_dynamics.cli import pictures
from kane_dynamics.cli.commands import inspect_command
from kane_dynamics.cli.commands.identify_command import recorded, stated_efforts
from kane_dynamics.cli.shared import load, print_json, warn_degrees
from kane_dynamics.cli.tables import write_states
from kane_dynamics.identification.recordings.diagnosis import refuse_faulty
from kane_dynamics.identification.recordings.recording import Recording
from kane_dynamics.identification.recordings.torque_delay import torque_delays
from kane_dynamics.identification.regression import rms
from kane_dynamics.robot.robot import Robot
import numpy as np


def replay(options: Namespace) -> None:
    """Compare the measured torques of a recording with those of the equations of motion."""
    plot = pictures.plotter(options)  # errors early
    model, robot = load(options)
    efforts = stated_efforts(options)
    recording = efforts.applied(robot, recorded(options, model))
    warn_degrees(robot, recording.q, options.recording)
    data = compared(robot, recording, gravity_added=not efforts.gravity)
    if options.out:
        with whole_file(options.out) as stream:
            write_states(stream, recording.t, {
                'q': recording.q, 'u': recording.u, 'udot': recording.udot,
                'tau': data['computed']}, robot.joint_names)
    if plot is not None:
        plot.plot_replay(data['t'], data['measured'], data['computed'], robot.joint_names,
                         options.plot, prismatic=model.sliding, limits=robot.limits.effort,
                         title=f'{model.name}: measured and computed torque')
    data['files'] = [path for path in (options.out, options.plot) if path]
    (print_json if options.json else print_comparison)(data)


def compared(robot: Robot, recording: Recording, *, gravity_added: bool = False
             ) -> dict[str, Any]:
    """
    Return computed torques, their difference from the measured ones, and remarks.

    Raises
    ------
    InputError
        If positions, speeds and times contradict each other.

    """
    remarks = [fault.words for fault in refuse_faulty(
        robot.model, recording, ('impossible',), gravity_added=gravity_added)]
    delays = torque_delays(robot.model, recording)
    tau = robot.inverse_dynamics(recording.q, recording.u, recording.udot)
    error = recording.tau - tau
    return {'joint_names': list(robot.joint_names), 'rows': len(recording), 't': recording.t,
            'computed': tau, 'measured': recording.tau, 'rms_measured': rms(recording.tau),
            'rms_error': rms(error), 'mean_error': error.mean(axis=0),
            'largest_error': np.abs(error).max(axis=0),
            'torque_delay': np.where(delays.judged, delays.delay, np.nan).tolist(),
            'torque_delay_deviation': np.where(delays.judged, delays.deviation, np.nan).tolist(),
            'common_torque_delay': delays.common,
            'common_torque_delay_deviation': delays.common_deviation,
            'remarks': remarks}


def print_comparison(data: dict[str, Any]) -> None:
    """Print the result of `compared`, and the files."""
    print(f'{data["rows"]} rows over {data["t"][-1] - data["t"][0]:.6g} s; torques in N m or N')
    inspect_command.print_table(
        ['joint', 'RMS measured', 'RMS difference', 'mean difference', 'largest'],
        zip(data['joint_names'], data['rms_measured'], data['rms_error'], data['mean_error'],
            data['largest_error'], strict=True))
    common, deviation = data['common_torque_delay'], data['common_torque_delay_deviation']
    unknown = [name for name, delay in zip(data['joint_names'], data['torque_delay'], strict=True)
               if math.isnan(delay)]
    print('\ndelay of the torques after the motion: ' + (
        'cannot be judged' if math.isnan(common) else f'{common:.4f} +- {deviation:.1g} s' + (
            f'; cannot be judged: {", ".join(unknown)}' if unknown else '')))
    for remark in data['remarks']:
        print(f'\nremark: {remark}')
    for path in data['files']:
        print(f'wrote {path}')
