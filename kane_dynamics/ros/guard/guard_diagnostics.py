"""The diagnostics of torque_guard."""

import time
from typing import Protocol

from diagnostic_msgs.msg import DiagnosticStatus
from kane_dynamics.ros.common.node_statistics import status
from kane_dynamics.ros.guard.configured_guard import ConfiguredGuard


class DiagnosedGuard(Protocol):
    """The attributes of the guard that its diagnostics use."""

    guard: ConfiguredGuard | None
    reason: str
    refused: bool
    target: str

    def get_fully_qualified_name(self) -> str:
        """Return the fully qualified name of the node."""


def guard_status(node: DiagnosedGuard, period: float) -> DiagnosticStatus:
    """Close a reporting period of `period` seconds and return the diagnostic status."""
    guard = node.guard
    name = f'{node.get_fully_qualified_name()}: guard'
    if guard is None:
        level = DiagnosticStatus.ERROR if node.refused else DiagnosticStatus.WARN
        return status(name, '', level, node.reason, {})
    watch = guard.path.watch
    _, _, figures = guard.statistics.period(period)
    level, message = DiagnosticStatus.OK, f'watching {node.target}'
    if watch.acting:
        level = DiagnosticStatus.ERROR
        silent = time.perf_counter() - watch.waiting_since
        message = (f'{node.target} is silent for {silent:.1f} s: '
                   + ('no joint states, commanding zeros; check the driver' if guard.path.timed_out
                      else 'the guard holds the arm; restart the node and activate it'))
    elif not watch.armed:
        message += ', which commands no torque'
    figures |= {'takeovers': str(watch.takeovers), 'node alive': str(guard.node_alive),
                'missed deadlines': str(guard.missed_deadlines),
                'last silence before a takeover': f'{watch.silent_for * 1e3:.1f} ms',
                'kernels verified to': f'{guard.verified:.1e}'}
    return status(name, guard.robot.model.name, level, message, figures)
