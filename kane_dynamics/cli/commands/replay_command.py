"""The command `replay`: torques along a recording, beside those that were measured."""

from argparse import Namespace
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.cli.commands import inspect_command
from kane_dynamics.cli.tables import write_states
from kane_dynamics.identification.recordings.recording import Recording
from kane_dynamics.robot.robot import Robot
import numpy as np

CLEARLY = 0.5  # of the error with gravity, or with the other sign: so much better is a finding


def run(options: Namespace, robot: Robot, recording: Recording) -> dict[str, Any]:
    """Compare, write what --out asks for, and return the result as plain data."""
    data = compared(robot, recording)
    if options.out:
        with open(options.out, 'w', encoding='utf-8', newline='') as stream:
            write_states(stream, recording.t, {
                'q': recording.q, 'u': recording.u, 'udot': recording.udot,
                'tau': data['computed']}, robot.joint_names)
    return {**data, 'files': [path for path in (options.out, options.plot) if path]}


def compared(robot: Robot, recording: Recording) -> dict[str, Any]:
    """Return computed torques, their difference from the measured ones, and what that tells."""
    tau = robot.inverse_dynamics(recording.q, recording.u, recording.udot)
    error = recording.tau - tau
    return {'joint_names': list(robot.joint_names), 'rows': len(recording), 't': recording.t,
            'computed': tau, 'measured': recording.tau, 'rms_measured': rms(recording.tau),
            'rms_error': rms(error), 'mean_error': error.mean(axis=0),
            'largest_error': np.abs(error).max(axis=0),
            'remarks': remarks(recording.tau, tau, robot.gravity_force(recording.q))}


def remarks(measured: Array, computed: Array, gravity: Array) -> list[str]:
    """Return what whole arms get wrong: no efforts, their sign, gravity left to the arm itself."""
    if not measured.any():
        return ['the measured efforts are all 0: the recording has none']
    moving = computed - gravity
    turned = 'the measured efforts have the opposite sign of torques on the joints'
    without = ('without gravity: the arm holds its weight by itself, or reports efforts without '
               'it')
    errors = [(float(np.linalg.norm(measured - model)), words) for model, words in (
        (-computed, turned),
        (moving, f'the measured efforts fit the torques {without}'),
        (-moving, f'{turned}, and fit these {without}'))]
    error, words = min(errors, key=lambda each: each[0])
    return [words] if error < CLEARLY * np.linalg.norm(measured - computed) else []


def rms(values: Array) -> Array:
    """Return the root mean square of each column."""
    result: Array = np.sqrt(np.mean(values * values, axis=0))
    return result


def print_comparison(data: dict[str, Any]) -> None:
    """Print what `run` returned."""
    print(f'{data["rows"]} rows over {data["t"][-1] - data["t"][0]:.6g} s; torques in N m or N')
    inspect_command.print_table(
        ['joint', 'RMS measured', 'RMS difference', 'mean difference', 'largest'],
        zip(data['joint_names'], data['rms_measured'], data['rms_error'], data['mean_error'],
            data['largest_error'], strict=True))
    for remark in data['remarks']:
        print(f'\nremark: {remark}')
    for path in data['files']:
        print(f'wrote {path}')
