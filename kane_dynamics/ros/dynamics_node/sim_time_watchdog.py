"""A watchdog of simulated time."""

import time

from kane_dynamics.ros.torque_path.torque_path import TorquePath
from rclpy.node import Node

LOST_CLOCK = 1.0  # s without progress of simulated time and without a publisher


class SimTimeWatchdog:
    """
    Monitors simulated time with the steady clock.

    While simulated time is paused, no message becomes stale. When its publisher
    disappears, no timeout on simulated time would ever expire; the watchdog then
    commands zeros.

    Attributes
    ----------
    warning : str
        Warning about the clock at the latest report; empty: the clock advances.

    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._now = 0  # simulated time when it was last checked, ns
        self._advanced_at = time.perf_counter()
        self._reported = 0  # simulated time at the latest report, ns
        self.warning = ''

    def check(self, path: TorquePath | None) -> None:
        """Command zeros if the clock has lost its publisher and no states arrive."""
        now = self._time()
        steady = time.perf_counter()
        if now != self._now:
            self._now = now
            self._advanced_at = steady
            return
        if path is None or not path.commanding:
            return
        # A paused simulator keeps its publisher, and the torques go on.
        silent = steady - max(self._advanced_at, path.last_update)
        if silent > LOST_CLOCK and self._node.count_publishers('/clock') == 0:
            path.time_out('/clock has no publisher')

    def report(self) -> None:
        """Update `warning`."""
        previous = self._reported
        self._reported = self._time()
        if self._reported != previous:
            self.warning = ''
        elif self._reported:
            self.warning = '/clock does not advance'
        else:
            self.warning = 'no message on /clock'

    def _time(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)
