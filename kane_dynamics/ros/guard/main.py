"""The entry point of torque_guard."""

from collections.abc import Sequence
import sys

from kane_dynamics.ros.common.process import make_executor, run_until_signal, SPIN_TIMEOUT
from kane_dynamics.ros.guard.guard_node import GuardNode
from rclpy.task import Future


def run(stop: Future) -> int:
    """Run the guard until `stop`; return the exit code."""
    node = GuardNode()
    executor = make_executor()
    executor.add_node(node)
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


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `torque_guard`; return the exit code."""
    return run_until_signal(run, arguments)


if __name__ == '__main__':
    sys.exit(main())
