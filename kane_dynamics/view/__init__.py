"""A robot in the browser: its shape, its motion, and what acts at its joints."""

from kane_dynamics.view.window import Window

__all__ = ['Window']
