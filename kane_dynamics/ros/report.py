"""What /diagnostics says about the node: one status, in words and in figures."""

from typing import Protocol

from diagnostic_msgs.msg import DiagnosticStatus
from kane_dynamics.robot import Robot
from kane_dynamics.ros.diagnostics import Statistics, status
from kane_dynamics.ros.torque_path import TorquePath


class Reporting(Protocol):
    """What a report is made of."""

    state: str
    statistics: Statistics
    path: TorquePath | None
    robot: Robot | None
    verified: float
    values: dict[str, object]

    def get_fully_qualified_name(self) -> str:
        """Return namespace and name."""


def report(node: Reporting, period: float) -> DiagnosticStatus:
    """Close a reporting period of `period` seconds and return what to publish about it."""
    rate, dropped, figures = node.statistics.period(period)
    robot, path = node.robot, node.path
    level, message = DiagnosticStatus.WARN, node.state
    if path is not None and path.running:
        level, message = DiagnosticStatus.OK, f'active, {rate:.0f} commands a second'
        if path.timed_out:
            level = DiagnosticStatus.ERROR
            message = (f'no joint state for {path.silence:.2f} s: '
                       + ('zeros are commanded' if node.statistics.commands else
                          'nothing is commanded yet'))
        elif dropped:
            level = DiagnosticStatus.WARN
            message += f', {dropped} joint states dropped'
    elif node.state == 'inactive':
        level = DiagnosticStatus.OK
    figures['state'] = node.state
    if robot is not None:
        figures |= {'mode': str(node.values['mode']), 'joints': ', '.join(robot.joint_names),
                    'kernels verified to': f'{node.verified:.1e}'}
    return status(f'{node.get_fully_qualified_name()}: torques',
                  robot.model.name if robot is not None else '', level, message, figures)
