"""
Constraints on the motion of a mechanism, each as a velocity that is zero or prescribed.

Every constraint is rows J(q, t) q' = b(q, t). A row is a component of a Jacobian
(partial velocities; Kane & Levinson, chapter 2). Rows of a position constraint (a closed
loop, a wheel on the ground) also have a constraint residual; the row is its time
derivative where the loop is closed.

All functions here run over any scalar. World axes, SI units.
"""

from typing import Any, get_args

from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.constraints.constraint_types.closure import Closure
from kane_dynamics.mechanics.constraints.constraint_types.constraint_rows import (
    ConstraintRows, Geometry)
from kane_dynamics.mechanics.constraints.constraint_types.position_constraints import (
    Coupling, Prescribed)
from kane_dynamics.mechanics.constraints.constraint_types.rolling import Rolling
from kane_dynamics.mechanics.constraints.constraint_types.velocity_constraints import (
    DependentSpeeds, knife_edge, PointVelocity)

Constraint = PointVelocity | Rolling | DependentSpeeds | Closure | Coupling | Prescribed

__all__ = ['Closure', 'Constraint', 'Coupling', 'DependentSpeeds', 'Geometry',
           'PointVelocity', 'Prescribed', 'Rolling', 'ConstraintRows',
           'checked_constraints', 'checked_names', 'knife_edge']


def checked_constraints(value: Any) -> tuple[Constraint, ...]:
    """Return a sequence of constraints as a tuple; else raise ConstraintError."""
    types = get_args(Constraint)
    valid = ', '.join(kind.__name__ for kind in types)
    # Two mistakes that look like sequences: a name, and a constraint without brackets.
    if isinstance(value, str):
        raise ConstraintError(f'constraints: {value!r}; expected a sequence of {valid}')
    if isinstance(value, types):
        raise ConstraintError(f'constraints: a {type(value).__name__}; expected a '
                              'sequence, such as [pin]')
    try:
        constraints = tuple(value)
    except TypeError:
        constraints = (value,)
    # The place in the sequence names a wrong entry.
    for k, constraint in enumerate(constraints):
        if not isinstance(constraint, types):
            raise ConstraintError(f'constraints[{k}]: {constraint!r}; expected one of '
                                  f'{valid}')
    return constraints


def checked_names(value: Any, what: str) -> tuple[str, ...] | None:
    """Return names as a tuple, None unchanged; ConstraintError for anything else."""
    if value is None:
        return None
    # A text alone would be read as a sequence of letters.
    if isinstance(value, str):
        raise ConstraintError(f'{what}: {value!r}; expected a sequence of names, such '
                              f"as ['{value}']")
    names = tuple(value) if hasattr(value, '__iter__') else (value,)
    if not all(isinstance(name, str) for name in names):
        raise ConstraintError(f'{what}: {value!r}; expected a sequence of names, such '
                              "as ['crank']")
    return names
