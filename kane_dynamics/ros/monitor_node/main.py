"""The program `monitor_node`: entry point, executor, shutdown."""

from collections.abc import Sequence
import sys
from typing import Any

from kane_dynamics.ros.common.early_signals import exit_on_signal


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `monitor_node`; return the exit code."""
    exit_on_signal()
    # Imported late, so that signals are handled from the beginning.
    from kane_dynamics.ros.common.program_arguments import RosProgram, run_program
    program = RosProgram(
        'monitor_node', 'monitor_node',
        'Estimate the payload of an arm and watch over its model, from its topics or a '
        'bag.',
        ('--ros-args --params-file arm.yaml',
         '--ros-args --params-file arm.yaml -p watch.reference:=sound.npz'))
    return run_program(program, arguments, run_monitor)


def run_monitor(arguments: Sequence[str]) -> int:
    """Run the node with checked arguments; return the exit code."""
    from kane_dynamics.ros.common.process import run_until_signal
    # All imports are made while a signal still ends the process at once.
    import kane_dynamics.ros.monitor_node.node  # noqa: F401
    return run_until_signal(spin_monitor, arguments)


def spin_monitor(stop: Any) -> None:
    """Make the node and spin it until the future `stop`."""
    from kane_dynamics.ros.common.process import make_executor, spin
    from kane_dynamics.ros.monitor_node.node import MonitorNode
    node = MonitorNode()
    executor = make_executor(node)
    try:
        spin(node, executor, stop)
    finally:
        executor.shutdown()


if __name__ == '__main__':
    sys.exit(main())
