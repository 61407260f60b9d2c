"""What /diagnostics says about the plant: one status, in words and in figures."""

from collections import Counter
from typing import Protocol

from diagnostic_msgs.msg import DiagnosticStatus
from kane_dynamics.ros.common.node_statistics import status
from kane_dynamics.ros.plant.plant_state import PlantState
from kane_dynamics.ros.plant.tick_schedule import TickSchedule


class Reporting(Protocol):
    """What a report is made of."""

    plant: PlantState
    pace: TickSchedule
    paused: bool
    failure: str
    received: int
    rejected: Counter[str]

    def get_fully_qualified_name(self) -> str:
        """Return namespace and name."""


def report(node: Reporting, speed: float) -> DiagnosticStatus:
    """Return what to publish about a period at `speed` times real time."""
    plant, pace = node.plant, node.pace
    level, message = DiagnosticStatus.OK, f'running at {speed:.2f} times real time'
    if node.failure:
        level, message = DiagnosticStatus.ERROR, f'it stands until ~/reset: {node.failure}'
    elif node.paused:
        message = 'paused'
    elif plant.held:
        message += ', held by brakes until a command comes'
    elif plant.late:
        level = DiagnosticStatus.WARN
        message += f', no command for {plant.silence:.2f} s'
    if not node.failure and pace.worst > pace.period:
        level = max(level, DiagnosticStatus.WARN)
        message += f', up to {pace.worst * 1e-6:.1f} ms late'
    figures = {
        'joints': ', '.join(plant.arm.joint_names), 'speed': f'{speed:.3f}',
        'joint states': str(plant.ticks), 'overruns': str(pace.overruns),
        'largest delay of a tick': f'{pace.worst * 1e-6:.3f} ms',
        'skipped to catch up': f'{pace.skipped:.3f} s', 'commands': str(node.received),
        'command timeouts': str(plant.timeouts), 'steps clamped': str(plant.arm.clamped),
        'steps at stops': str(plant.arm.blows),
        'at a stop': ', '.join(plant.arm.at_stops) or 'none',
        'pushed': ', '.join(plant.arm.wrenches) or 'none',
        'joint states lost on request': str(plant.states.lost),
        'commands lost on request': str(plant.commands.lost)}
    figures |= {f'rejected: {what}': str(count) for what, count in node.rejected.items()}
    return status(f'{node.get_fully_qualified_name()}: simulated robot', plant.robot.model.name,
                  level, message, figures)
