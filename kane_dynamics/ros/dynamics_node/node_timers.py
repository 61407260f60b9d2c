"""The timers of the dynamics node: watchdogs and diagnostics."""

from collections.abc import Callable
import time
from typing import Any, TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray
from kane_dynamics.ros.common import realtime
from kane_dynamics.ros.common.commanders import several_commanders
from kane_dynamics.ros.common.qos import RELIABLE
from kane_dynamics.ros.dynamics_node.node_diagnostics import (in_parts, node_status,
                                                              SEVERAL_STATES)
from kane_dynamics.ros.dynamics_node.sim_time_watchdog import LOST_CLOCK
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

if TYPE_CHECKING:
    from kane_dynamics.ros.dynamics_node.node import DynamicsNode


LEAST_WITHOUT_ARM = 0.9  # s between two reports of a node that is not configured
REMINDER = 10.0  # s between two log lines that say what the node waits for


class NodeTimers:
    """
    Runs the watchdogs and publishes the diagnostics of the dynamics node.

    Parameters
    ----------
    node : DynamicsNode

    """

    def __init__(self, node: 'DynamicsNode') -> None:
        self._node = node
        self._reported = self._reminded = time.monotonic()
        self._state_publishers = 1  # at the last report
        self._commanders: list[str] = []
        self._reported_parts = False
        self._unguarded = False
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timers: list[Any] = []
        self._diagnostics = node.create_publisher(DiagnosticArray, '/diagnostics', RELIABLE)

    def start(self, simulated_time: bool) -> None:
        """
        Start the timers, or restart them after a change of clock or parameters.

        The watchdog of joint states uses the node's clock if time is simulated, because no state
        becomes stale while simulated time is paused; a second watchdog then monitors the clock.
        Otherwise it uses steady time. Diagnostics use steady time in the services' thread, because
        they take longer than a cycle may wait.
        """
        node, values = self._node, self._node.values
        for owner, timer in self._timers:
            owner.destroy_timer(timer)
        timers: list[tuple[Node, float, Callable[[], None], Clock]] = [
            (node, max(0.2 * values['state_timeout'], 1e-3), self._check_timeout,
             node.get_clock() if simulated_time else self._steady),
            (node.server, 1.0 / values['diagnostics_rate'], self._publish_diagnostics,
             self._steady)]
        if simulated_time:
            timers.append((node, LOST_CLOCK / 4.0, self._check_sim_time, self._steady))
        self._timers = [(owner, owner.create_timer(period, callback, clock=clock))
                        for owner, period, callback, clock in timers]
        node.server.spinner.wake()

    def _check_timeout(self) -> None:
        if self._node.arm is not None:
            self._node.arm.path.check_timeout()

    def _check_sim_time(self) -> None:
        arm = self._node.arm
        self._node.sim_time.check(None if arm is None else arm.path)

    def _publish_diagnostics(self) -> None:
        node, now = self._node, time.monotonic()
        period = now - self._reported
        if node.arm is None and period < LEAST_WITHOUT_ARM:
            return  # kernels may be compiled now, with which the reports would compete
        self._reported = now
        node.sim_time.report()
        if node.arm is not None:
            node.arm.count_publishers()
        message = DiagnosticArray(status=[node_status(node, period)])
        message.header.stamp = node.get_clock().now().to_msg()
        self._diagnostics.publish(message)
        realtime.collect_if_disabled()
        self._log_changes()

    def _log_changes(self) -> None:
        """Log what concerns other nodes: once, when it begins and when the guard is found."""
        log, arm = self._node.get_logger(), self._node.arm
        now = time.monotonic()
        if now - self._reminded > REMINDER:
            self._reminded = now
            if waiting := self._node.waiting_for:
                log.warning(f'{self._node.state}: {waiting}')
        publishers = 1 if arm is None else arm.state_publishers
        if publishers > 1 and publishers != self._state_publishers:
            log.warning(f'{publishers} {SEVERAL_STATES}')
        self._state_publishers = publishers
        if arm is not None and arm.parts_of_states and not self._reported_parts:
            self._reported_parts = True
            log.error(in_parts(arm.parts_of_states))
        commanders = [] if arm is None else arm.commanders
        if len(commanders) > 1 and commanders != self._commanders:
            log.error(f'commands: {several_commanders(commanders)}')
        self._commanders = commanders
        guard = None if arm is None else arm.guard
        if guard is not None and guard.overdue and bool(guard.warning) != self._unguarded:
            self._unguarded = bool(guard.warning)
            log.warning(guard.warning) if guard.warning else log.info('torque_guard watches')
