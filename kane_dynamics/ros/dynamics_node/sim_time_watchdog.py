"""A watchdog of simulated time."""

import time

from kane_dynamics.ros.torque_path.torque_path import TorquePath
from rclpy.node import Node

LOST_CLOCK = 1.0  # s without progress of simulated time and without a publisher


class SimTimeWatchdog:
    """
    Monitors simulated time with the steady clock.

    While simulated time is paused, no message becomes stale. When its publisher disappears, no
    timeout on simulated time would ever expire; the watchdog then commands zeros.

    Attributes
    ----------
    warning : str
        Warning about the clock at the latest report; empty: the clock advances.

    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._now, self._moved = 0, time.perf_counter()
        self._reported = 0
        self.warning = ''

    def check(self, path: TorquePath | None) -> None:
        """Command zeros if the clock has stopped without a publisher and no states arrive."""
        now, steady = self._time(), time.perf_counter()
        if now != self._now:
            self._now, self._moved = now, steady
        elif path is not None and path.commanding and (
                steady - max(self._moved, path.last_update) > LOST_CLOCK) and (
                self._node.count_publishers('/clock') == 0):
            path.time_out('/clock has no publisher')

    def report(self) -> None:
        """Update `warning`."""
        before, self._reported = self._reported, self._time()
        self.warning = '' if before != self._reported else (
            '/clock does not advance' if before else 'no message on /clock')

    def _time(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)
