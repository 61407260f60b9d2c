"""What /diagnostics says about the node: one status, in words and in figures."""

from typing import Protocol

from diagnostic_msgs.msg import DiagnosticStatus
from kane_dynamics.ros.common.node_statistics import Statistics, status
from kane_dynamics.ros.dynamics_node.configured_robot import ConfiguredRobot
from kane_dynamics.ros.torque_path.sim_time_watchdog import SimTimeWatchdog


class Reporting(Protocol):
    """What a report is made of."""

    state: str
    statistics: Statistics
    arm: ConfiguredRobot | None
    clock: SimTimeWatchdog
    values: dict[str, object]

    def get_fully_qualified_name(self) -> str:
        """Return namespace and name."""


def report(node: Reporting, period: float) -> DiagnosticStatus:
    """Close a reporting period of `period` seconds and return what to publish about it."""
    rate, dropped, figures = node.statistics.period(period)
    arm = node.arm
    level, message = DiagnosticStatus.WARN, node.state
    if arm is not None and arm.path.running:
        level, message = DiagnosticStatus.OK, f'active, {rate:.0f} commands a second'
        if arm.path.timed_out:
            level = DiagnosticStatus.ERROR
            message = (f'no good joint state for {arm.path.silence:.2f} s: '
                       + ('zeros are commanded' if arm.path.answered else
                          'nothing is commanded yet'))
        if dropped:
            level = max(level, DiagnosticStatus.WARN)
            message += f', {dropped.total()} dropped: ' + ', '.join(dropped)
        if node.clock.remark:
            level = max(level, DiagnosticStatus.WARN)
        if arm.surroundings.collision is not None:
            level = max(level, DiagnosticStatus.WARN)
            message += f"; collision at joint '{arm.surroundings.collision}'"
        if arm.sources > 1:
            level = max(level, DiagnosticStatus.WARN)
            message += f'; {arm.sources} publishers on joint_states'
    elif node.state == 'inactive':
        level = DiagnosticStatus.OK
    message += node.clock.remark and f'; {node.clock.remark}'
    figures['state'] = node.state
    if arm is not None:
        payload = arm.loads.payload
        figures |= {'mode': str(node.values['mode']), 'joints': ', '.join(arm.robot.joint_names),
                    'kernels verified to': f'{arm.verified:.1e}',
                    'gravity': ' '.join(f'{g:.3f}' for g in arm.loads.gravity) + ' m/s^2',
                    'payload': f'{0.0 if payload is None else payload.mass:g} kg',
                    'publishers of joint states': str(arm.sources)}
        figures |= arm.surroundings.figures()
    return status(f'{node.get_fully_qualified_name()}: torques',
                  arm.robot.model.name if arm is not None else '', level, message, figures)
