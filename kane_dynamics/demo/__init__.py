"""A live demonstration: a MuJoCo arm, the dynamics node, a director, and plots."""

from collections.abc import Sequence

__all__ = ['main']


def main(arguments: Sequence[str] = ()) -> int:
    """Run the demo; see `director`."""
    from kane_dynamics.demo.director import run_demo
    return run_demo(arguments)
