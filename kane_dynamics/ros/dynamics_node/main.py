"""
The process around the node: signals, executors, threads, and an orderly end.

The torque path spins in the main thread on the EventsExecutor (an order of magnitude less overhead
a message than the other executors), the services in a second thread. No signal cuts a callback
short, and the last thing that the node does is to command zeros.
"""

from collections.abc import Sequence
import sys
import threading
from typing import Any

from kane_dynamics.errors import KaneError
from kane_dynamics.ros.common.process import make_executor, run_until_signal
from kane_dynamics.ros.dynamics_node.node import DynamicsNode
from rclpy.exceptions import ParameterException
from rclpy.task import Future

# Seconds for which a thread may keep the interpreter while the torque path waits for it.
SWITCH_INTERVAL = 5e-5
FOREVER = 1e6  # s; without a finite timeout the EventsExecutor's spin does not wait


def spin(node: DynamicsNode, executor: Any, stop: Future) -> None:
    """Serve until `stop`; a callback that fails commands zeros but does not end the node."""
    while not stop.done():
        try:
            executor.spin_until_future_complete(stop, FOREVER)
        except Exception as error:
            node.get_logger().fatal(f'a callback failed: {type(error).__name__}: {error}')
            if node.state == 'active':
                node.trigger_deactivate()


def run(stop: Future) -> int:
    """Run the node until `stop`; return the exit code."""
    try:
        node = DynamicsNode()
    except (KaneError, ParameterException) as error:
        print(f'dynamics_node: {error}', file=sys.stderr)
        return 1
    executor = make_executor()
    executor.add_node(node)
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


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `dynamics_node`; return the exit code."""
    sys.setswitchinterval(SWITCH_INTERVAL)
    return run_until_signal(run, arguments)


if __name__ == '__main__':
    sys.exit(main())
