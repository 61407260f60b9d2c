"""Warn of lengths, masses and gravity that do not fit a mechanism: millimeters, grams."""

import warnings

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ModelWarning
from kane_dynamics.model.model import Model
import numpy as np

NEAR = 1.0  # m: what is fixed on a mechanism may be so far away, however small that is
HEAVY = 10.0  # times the moving mass of the mechanism: more is no tool


def reach(model: Model) -> float:
    """Return the reach of the mechanism with all links stretched in one line, m."""
    return sum(float(np.linalg.norm(body.joint.translation)) for body in model.bodies)


def is_far(distance: float, links: float) -> bool:
    """Return whether a distance, m, exceeds the reach of all links, and `NEAR`."""
    return distance > max(links, NEAR)


def warn_of_distance(vector: Array, links: float, what: str, stacklevel: int) -> None:
    """Warn of a vector, m, that is far by `is_far`."""
    distance = float(np.linalg.norm(vector))
    if is_far(distance, links):
        warnings.warn(f'{what} {distance:.4g} m from its frame, and all links in one '
                      f'line reach {links:.4g} m; expected m', ModelWarning,
                      stacklevel=stacklevel + 1)


def warn_of_mass(mass: float, model: Model, what: str, stacklevel: int) -> None:
    """Warn of a mass, kg, much larger than that of the mechanism that carries it."""
    moving = sum(body.inertial.mass for body in model.bodies)
    if mass > HEAVY * moving > 0.0:
        warnings.warn(f'{what}: {mass:.5g} kg, on a mechanism that moves {moving:.5g} '
                      'kg; expected kg: are these grams?', ModelWarning,
                      stacklevel=stacklevel + 1)


def upward_gravity(gravity: Array) -> str:
    """Return the warning that gravity, (3,) m/s^2, points upwards; empty if it does not."""
    if gravity[2] <= 0.0:
        return ''
    return (f'gravity {gravity.tolist()} m/s^2 points upwards in the axes of the base; '
            'expected 0 0 -9.81, unless the arm hangs from a ceiling')
