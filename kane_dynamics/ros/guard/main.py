"""The entry point of torque_guard. It handles signals before the long imports begin."""

from collections.abc import Sequence
import sys

from kane_dynamics.ros.common.early_signals import exit_on_signal


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `torque_guard`; return the exit code."""
    exit_on_signal()
    from kane_dynamics.ros.common.program_arguments import Program, run_program
    program = Program(
        'torque_guard', 'torque_guard',
        'Hold the arm when its dynamics node dies or hangs; all settings are those of that node.',
        ('--ros-args', '--ros-args -p node:=kane_dynamics -r __ns:=/left',
         '--ros-args -r commands:=/forward_effort_controller/commands'))
    return run_program(program, arguments, run_guard)


def run_guard(arguments: Sequence[str]) -> int:
    """Run the guard with checked arguments; return the exit code."""
    from kane_dynamics.ros.common.process import run_until_signal
    from kane_dynamics.ros.common.transport import leave_shared_memory
    from kane_dynamics.ros.guard.guarding import run
    leave_shared_memory()
    return run_until_signal(run, arguments)


if __name__ == '__main__':
    sys.exit(main())
