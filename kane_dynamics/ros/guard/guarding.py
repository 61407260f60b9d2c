"""Run torque_guard: executor, shutdown."""

from kane_dynamics.ros.common.process import SPIN_TIMEOUT, start
from kane_dynamics.ros.guard.guard_node import GuardNode
from rclpy.task import Future


def run(stop: Future) -> int:
    """Run the guard until `stop`; return the exit code."""
    started = start(GuardNode, 'torque_guard')
    if started is None:
        return 1
    node, executor = started
    try:
        while not stop.done():
            try:
                executor.spin_until_future_complete(stop, SPIN_TIMEOUT)
            except Exception as error:
                node.get_logger().fatal(f'callback failed: {type(error).__name__}: {error}')
    finally:
        node.close()
        executor.shutdown()
    return 0
