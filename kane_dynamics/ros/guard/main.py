"""
The program `torque_guard`: entry point, executor, shutdown.

Signals are handled before the long imports begin, which is why functions import here.
"""

from collections.abc import Sequence
import sys
from typing import Any

from kane_dynamics.ros.common.early_signals import exit_on_signal


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `torque_guard`; return the exit code."""
    exit_on_signal()
    # Imported late, so that signals are handled from the beginning.
    from kane_dynamics.ros.common.program_arguments import RosProgram, run_program
    program = RosProgram(
        'torque_guard', 'torque_guard',
        'Hold the arm when its dynamics node dies or hangs; all settings are those of '
        'that node.',
        ('--ros-args', '--ros-args -p node:=kane_dynamics -r __ns:=/left',
         '--ros-args -r commands:=/forward_effort_controller/commands'))
    return run_program(program, arguments, run_guard)


def run_guard(arguments: Sequence[str]) -> int:
    """Run the guard with checked arguments; return the exit code."""
    from kane_dynamics.ros.common.process import run_until_signal
    from kane_dynamics.ros.common.transport import leave_shared_memory
    # All imports are made while a signal still ends the process at once.
    import kane_dynamics.ros.guard.guard_node  # noqa: F401
    leave_shared_memory()
    return run_until_signal(spin_guard, arguments)


def spin_guard(stop: Any) -> None:
    """Make the guard and spin it until the future `stop`."""
    from kane_dynamics.ros.common.process import make_executor, spin
    from kane_dynamics.ros.guard.guard_node import GuardNode
    node = GuardNode()
    executor = make_executor(node)
    try:
        spin(node, executor, stop)
    # The arm must not keep the last torque of a guard that ends.
    finally:
        node.close()
        executor.shutdown()


if __name__ == '__main__':
    sys.exit(main())
