"""Run torque_guard: executor, shutdown."""

from kane_dynamics.ros.common.process import spin, start
from kane_dynamics.ros.guard.guard_node import GuardNode
from rclpy.task import Future


def run(stop: Future) -> int:
    """Run the guard until `stop`; return the exit code."""
    started = start(GuardNode, 'torque_guard')
    if started is None:
        return 1
    node, executor = started
    try:
        spin(node, executor, stop)
    finally:
        node.close()
        executor.shutdown()
    return 0
