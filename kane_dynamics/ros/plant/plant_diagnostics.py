"""The diagnostics of the plant node."""

from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticStatus
from kane_dynamics.ros.common.node_statistics import status

if TYPE_CHECKING:
    from kane_dynamics.ros.plant.plant_node import PlantNode


def plant_status(node: 'PlantNode', speed: float) -> DiagnosticStatus:
    """Return the diagnostic status of a period at `speed` times real time."""
    plant, schedule = node.plant, node.schedule
    level, message = DiagnosticStatus.OK, f'running at {speed:.2f} times real time'
    if node.failure:
        level, message = DiagnosticStatus.ERROR, f'stopped until ~/reset: {node.failure}'
    elif node.paused:
        message = 'paused'
    elif plant.braked:
        message += ', brakes on until the first command'
    elif plant.timed_out:
        level = DiagnosticStatus.WARN
        message += f', no command for {plant.command_age:.2f} s'
    elif plant.arm.energy.warning:
        level, message = DiagnosticStatus.WARN, f'{message}; {plant.arm.energy.warning}'
    if not node.failure and schedule.worst > schedule.period:
        level = max(level, DiagnosticStatus.WARN)
        message += f', up to {schedule.worst * 1e-6:.1f} ms late'
    figures = {
        'joints': ', '.join(plant.arm.joint_names), 'speed': f'{speed:.3f}',
        'joint states': str(plant.ticks), 'overruns': str(schedule.overruns),
        'largest delay of a tick': f'{schedule.worst * 1e-6:.3f} ms',
        'skipped to catch up': f'{schedule.skipped:.3f} s', 'commands': str(node.received),
        'command timeouts': str(plant.timeouts), 'steps clamped': str(plant.arm.clamped),
        'steps at stops': str(plant.arm.stop_contacts),
        'energy balance': plant.arm.energy.warning or 'closes',
        'at a stop': ', '.join(plant.arm.at_stops) or 'none',
        'wrenches at': ', '.join(plant.arm.wrenches) or 'none',
        'joint states dropped': str(plant.states.dropped),
        'commands dropped': str(plant.commands.dropped)}
    figures |= {f'rejected: {what}': str(count) for what, count in node.rejected.items()}
    return status(f'{node.get_fully_qualified_name()}: simulated robot', plant.robot.model.name,
                  level, message, figures)
