"""Load URDF and its supplement into a Model; the only package that reads XML."""

from kane_dynamics.urdf.load import load_urdf
from kane_dynamics.urdf.xacro_file import expand_xacro

__all__ = ['expand_xacro', 'load_urdf']
