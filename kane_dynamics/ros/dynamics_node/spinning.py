"""
Run the dynamics node: executors, threads, shutdown.

The torque path spins in the main thread on the EventsExecutor, whose overhead for each message is
an order of magnitude lower than that of the other executors; the services spin in a second thread.
Signals do not interrupt callbacks, and the node commands zeros before it exits.
"""

import threading
from typing import Any

from kane_dynamics.ros.common.process import SPIN_TIMEOUT, start
from kane_dynamics.ros.dynamics_node.node import DynamicsNode
from rclpy.task import Future


def spin(node: DynamicsNode, executor: Any, stop: Future) -> None:
    """Spin until `stop`; if a callback fails, command zeros and continue."""
    while not stop.done():
        try:
            executor.spin_until_future_complete(stop, SPIN_TIMEOUT)
        except Exception as error:
            node.get_logger().fatal(f'callback failed: {type(error).__name__}: {error}')
            if node.state == 'active':
                node.trigger_deactivate()


def run(stop: Future) -> int:
    """Run the node until `stop`; return the exit code."""
    started = start(DynamicsNode, 'dynamics_node')
    if started is None:
        return 1
    node, executor = started
    thread = threading.Thread(target=node.server.spin, name='services', daemon=True)
    thread.start()
    try:
        node.autostart()
        spin(node, executor, stop)
    finally:
        node.halt()
        node.server.stop()
        thread.join(timeout=1.0)
        executor.shutdown()
    return 0
