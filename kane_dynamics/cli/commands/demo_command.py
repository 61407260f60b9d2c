"""The command `demo`."""

from argparse import Namespace

from kane_dynamics._util.optional_imports import extra


def demo(options: Namespace) -> int:
    """Run the demo with the arguments that follow."""
    demonstration = extra('kane_dynamics.demo', 'demo', 'the demo')
    return int(demonstration.main(options.unknown) or 0)
