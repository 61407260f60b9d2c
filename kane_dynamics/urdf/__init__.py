"""Load URDF and its supplement into a Model; the only package that reads XML."""

from kane_dynamics.urdf.load import load_urdf

__all__ = ['load_urdf']
