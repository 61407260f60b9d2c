"""
The process around the node: signals, executors, threads, and an orderly end.

The torque path spins in the main thread on the EventsExecutor (an order of magnitude less overhead
a message than the other executors), the services in a second thread. SIGINT and SIGTERM only
write to a pipe, which a third thread reads, so that no callback is ever cut short and the last
thing that the node does is to command zeros.
"""

from collections.abc import Sequence
import os
import signal
import sys
import threading
from typing import Any

from kane_dynamics.errors import KaneError
from kane_dynamics.ros.node import DynamicsNode
import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

SIGNALS = (signal.SIGINT, signal.SIGTERM)
# Seconds for which a thread may keep the interpreter while the torque path waits for it.
SWITCH_INTERVAL = 5e-5
FOREVER = 1e6  # s; without a finite timeout the EventsExecutor's spin does not wait


def make_executor() -> Any:
    """Return the fastest executor that this rclpy has."""
    try:
        from rclpy.experimental.events_executor import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor()
    return EventsExecutor()


def stop_on_signal(stop: Future) -> None:
    """
    Let SIGINT and SIGTERM complete `stop`, and nothing else.

    The interpreter's C handler writes each signal's number to the pipe at once, whatever the main
    thread is doing; the Python handlers have nothing left to do. (Blocking the signals and waiting
    for them would not do: threads that libraries made at import do not inherit the mask.)
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    for number in SIGNALS:
        signal.signal(number, lambda number, frame: None)
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)

    def wait() -> None:
        os.read(reading, 1)
        stop.set_result(True)

    threading.Thread(target=wait, name='signals', daemon=True).start()


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
    stop = Future()
    stop_on_signal(stop)
    rclpy.init(args=None if arguments is None else list(arguments),
               signal_handler_options=SignalHandlerOptions.NO)
    try:
        return run(stop)
    finally:
        rclpy.try_shutdown()


if __name__ == '__main__':
    sys.exit(main())
