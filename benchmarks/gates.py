"""The exit status of a benchmark."""

import sys

NO_GATES = '--no-gates'  # argument with which missed gates are printed and no failure


def exit_status(met: bool) -> int:
    """Return 1 if a gate was missed, unless gates do not count here."""
    return 0 if met or NO_GATES in sys.argv[1:] else 1
