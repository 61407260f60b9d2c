"""Viewer of a robot in the browser: shapes, motion, and loads at its joints."""

from kane_dynamics.view.window import Window

__all__ = ['Window']
