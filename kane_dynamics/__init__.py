"""Manipulator dynamics by Kane's method, compiled for one robot at a time."""

from kane_dynamics.errors import (CompileError, ConstraintError, InputError, KaneError,
                                  ModelError, ModelWarning, UrdfError)
from kane_dynamics.model import Body, Frame, Inertial, Joint, Limits, Model
from kane_dynamics.robot import Robot

__all__ = ['Body', 'CompileError', 'ConstraintError', 'Frame', 'Inertial', 'InputError', 'Joint',
           'KaneError', 'Limits', 'Model', 'ModelError', 'ModelWarning', 'Robot', 'UrdfError']
