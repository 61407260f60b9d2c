"""
Run the dynamics node: executors, threads, shutdown.

The torque path spins in the main thread on the EventsExecutor, whose overhead for each message is
an order of magnitude lower than that of the other executors; the services spin in a second thread.
Signals do not interrupt callbacks, and the node commands zeros before it exits.
"""

import threading

from kane_dynamics.ros.common.process import spin, start
from kane_dynamics.ros.dynamics_node.node import DynamicsNode
from rclpy.task import Future


def run(stop: Future) -> int:
    """Run the node until `stop`; return the exit code."""
    started = start(DynamicsNode, 'dynamics_node')
    if started is None:
        return 1
    node, executor = started

    def command_zeros() -> None:
        if node.state == 'active':
            node.trigger_deactivate()

    thread = threading.Thread(target=node.server.spin, name='services', daemon=True)
    thread.start()
    try:
        node.autostart()
        spin(node, executor, stop, failed=command_zeros)
    finally:
        node.halt()
        node.server.stop()
        thread.join(timeout=1.0)
        executor.shutdown()
    return 0
