"""Simulated time: whether it goes on, and whether anybody is there to let it go on."""

import time

from kane_dynamics.ros.torque_path.torque_path import TorquePath
from rclpy.node import Node

LOST = 1.0  # s that simulated time may stand when nobody publishes it


class SimTimeWatchdog:
    """
    Looks at a node's clock from the outside, by the steady one.

    A clock that stands is a pause, in which nothing grows older. One that nobody publishes any
    more stands for ever, and no timeout by it would ever come.

    Attributes
    ----------
    remark : str
        What to tell of the clock since the report before; empty: it goes on.

    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._now, self._moved = 0, time.perf_counter()
        self._reported = 0
        self.remark = ''

    def look(self, path: TorquePath | None) -> None:
        """Command zeros if the clock stands, nobody publishes it, and no states come."""
        now, steady = self._time(), time.perf_counter()
        if now != self._now:
            self._now, self._moved = now, steady
        elif path is not None and path.commanding and (
                steady - max(self._moved, path.answered) > LOST) and (
                self._node.count_publishers('/clock') == 0):
            path.lose('nobody publishes /clock any more')

    def report(self) -> None:
        """Renew the remark."""
        before, self._reported = self._reported, self._time()
        self.remark = '' if before != self._reported else (
            'the clock stands' if before else 'nothing has come on /clock')

    def _time(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)
