"""From URDF, and the supplement beside it, to a Model: the only part that reads XML."""

from kane_dynamics.urdf.load import load_urdf

__all__ = ['load_urdf']
