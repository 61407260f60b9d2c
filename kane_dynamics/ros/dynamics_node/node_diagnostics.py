"""The diagnostics of the dynamics node."""

from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticStatus
from kane_dynamics.ros.common.node_statistics import status

if TYPE_CHECKING:
    from kane_dynamics.ros.dynamics_node.node import DynamicsNode


def node_status(node: 'DynamicsNode', period: float) -> DiagnosticStatus:
    """Close a reporting period of `period` seconds and return its diagnostic status."""
    rate, dropped, figures = node.statistics.period(period)
    arm = node.arm
    level, message = DiagnosticStatus.WARN, node.state
    if arm is not None and arm.path.running:
        level, message = DiagnosticStatus.OK, f'active, {rate:.0f} commands/s'
        if arm.path.timed_out:
            level = DiagnosticStatus.ERROR
            message = (f'no valid joint state for {arm.path.state_age:.2f} s: '
                       + ('commanding zeros' if arm.path.last_update else 'no commands yet'))
        if dropped:
            level = max(level, DiagnosticStatus.WARN)
            message += f', {dropped.total()} dropped: ' + ', '.join(dropped)
        if node.sim_time.warning:
            level = max(level, DiagnosticStatus.WARN)
        if arm.optional_topics.collision is not None:
            level = max(level, DiagnosticStatus.WARN)
            message += f"; collision at joint '{arm.optional_topics.collision}'"
        if arm.state_publishers > 1:
            level = max(level, DiagnosticStatus.WARN)
            message += f'; {arm.state_publishers} publishers on joint_states'
    elif node.state == 'inactive':
        level = DiagnosticStatus.OK
    message += node.sim_time.warning and f'; {node.sim_time.warning}'
    figures['state'] = node.state
    if arm is not None:
        payload = arm.loads.payload
        figures |= {'mode': str(node.values['mode']), 'joints': ', '.join(arm.robot.joint_names),
                    'kernels verified to': f'{arm.verified:.1e}',
                    'gravity': ' '.join(f'{g:.3f}' for g in arm.loads.gravity) + ' m/s^2',
                    'payload': f'{0.0 if payload is None else payload.mass:g} kg',
                    'publishers of joint states': str(arm.state_publishers)}
        figures |= arm.optional_topics.figures()
    return status(f'{node.get_fully_qualified_name()}: torques',
                  arm.robot.model.name if arm is not None else '', level, message, figures)
