"""The entry point of the plant node. It handles signals before the long imports begin."""

from collections.abc import Sequence
import sys

from kane_dynamics.ros.common.early_signals import exit_on_signal


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `plant_node`; return the exit code."""
    exit_on_signal()
    from kane_dynamics.ros.common.process import run_until_signal
    from kane_dynamics.ros.plant.plant_ticking import run
    return run_until_signal(run, arguments)


if __name__ == '__main__':
    sys.exit(main())
