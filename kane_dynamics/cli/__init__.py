"""The command line, `kane-dynamics`."""

from kane_dynamics.cli.parser import main

__all__ = ['main']
