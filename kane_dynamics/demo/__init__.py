"""A live demonstration: three processes, a simulated arm that is not ours, and a picture."""

from collections.abc import Sequence

__all__ = ['main']


def main(arguments: Sequence[str] = ()) -> int:
    """Run the demo; see `director`."""
    from kane_dynamics.demo.director import run
    return run(arguments)
