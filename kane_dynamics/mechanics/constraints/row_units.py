"""Units for the comparison of constraint rows and coordinates."""

from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.constraints import Constraint, Coupling, PointVelocity, Prescribed
from kane_dynamics.model.model import Model, WORLD
import numpy as np


def length_of(model: Model) -> float:
    """
    Return the characteristic length, m, that scales moments to forces and angles to distances.

    It is the longest distance between neighbouring joints, or from a body to one of its frames;
    1 where there is none.
    """
    places = [body.joint.translation for body in model.bodies if body.parent != WORLD]
    places += [frame.translation for frame in model.frames if frame.body != WORLD]
    longest = max((float(np.linalg.norm(place)) for place in places), default=0.0)
    return longest if longest > 1e-9 else 1.0


def coordinate_units(model: Model) -> Array:
    """Return the unit of each coordinate, (n_q,): the length for sliding joints, 1 for others."""
    units = np.ones(len(model.coordinate_names))
    length = length_of(model)
    for name, place in zip(model.joint_names, model.places):
        if place is not None and name in model.sliding:
            units[place] = length
    return units


def turning_rows(constraint: Constraint, model: Model) -> list[bool]:
    """Return for each row of a constraint whether it constrains a rotation."""
    if isinstance(constraint, Coupling | Prescribed):
        return [constraint.joint not in model.sliding]
    if isinstance(constraint, PointVelocity):
        return [constraint.angular]
    return [label.rpartition('/')[2].startswith('turn_') for label in constraint.labels]
