"""The command `watch`: changes of an arm that its model does not describe."""

from argparse import Namespace
from typing import Any

from kane_dynamics.cli.commands.identify_command import recorded, stated_efforts
from kane_dynamics.cli.printing import print_json, print_table
from kane_dynamics.cli.robot_options import load_robot
from kane_dynamics.identification.model_watch import ModelWatch, WatchReport


def watch(options: Namespace) -> int:
    """Compare a recording with a model and a sound recording; return 1 if it has alarms."""
    model, robot = load_robot(options)
    efforts = stated_efforts(options)
    recording = efforts.applied(robot, recorded(options, model))
    # The reference is read by the same options as the recording.
    stated = options.recording
    options.recording = options.reference
    reference = efforts.applied(robot, recorded(options, model))
    options.recording = stated
    model_watch = ModelWatch(model, reference, false_alarms=options.false_alarms)
    report = model_watch.report(recording)
    data = report_data(report)
    if options.json:
        print_json(data)
    else:
        _print_report(data, options.false_alarms)
    return 1 if report.alarms else 0


def report_data(report: WatchReport) -> dict[str, Any]:
    """Return a report as plain data."""
    alarms = [{**alarm._asdict(), 'words': str(alarm)} for alarm in report.alarms]
    return {'joint_names': list(report.joint_names), 'residual': report.residual,
            'reference': report.reference, 'alarms': alarms}


def _print_report(data: dict[str, Any], false_alarms: float) -> None:
    """Print residuals and alarms."""
    print('RMS of measured minus computed torque, N m or N')
    print_table(['joint', 'recording', 'reference'],
                zip(data['joint_names'], data['residual'], data['reference'], strict=True))
    print()
    for alarm in data['alarms']:
        print(alarm['words'])
    if not data['alarms']:
        print('the model describes the recording as it describes the reference')
    print(f'at most {100.0 * false_alarms:g} % of sound recordings have an alarm')
