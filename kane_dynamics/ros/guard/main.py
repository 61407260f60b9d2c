"""The entry point of torque_guard. It handles signals before the long imports begin."""

from collections.abc import Sequence
import sys

from kane_dynamics.ros.common.early_signals import exit_on_signal


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `torque_guard`; return the exit code."""
    exit_on_signal()
    from kane_dynamics.ros.common.process import run_until_signal
    from kane_dynamics.ros.common.transport import leave_shared_memory
    from kane_dynamics.ros.guard.guarding import run
    leave_shared_memory()
    return run_until_signal(run, arguments)


if __name__ == '__main__':
    sys.exit(main())
