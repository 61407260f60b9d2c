"""
Constraints on the motion of a mechanism, each as a velocity that is zero or prescribed.

Every constraint is rows J(q, t) q' = b(q, t). A row is a component of a Jacobian (partial
velocities; Kane & Levinson, chapter 2). Rows of a position constraint (a closed
loop, a wheel on the ground) also have a constraint residual; the row is its time derivative where
the loop is closed.

All functions here run over any scalar. World axes, SI units.
"""

from typing import Any, get_args

from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.constraints.constraint_types.closure import Closure
from kane_dynamics.mechanics.constraints.constraint_types.constraint_rows import (ConstraintRows,
                                                                                  Geometry)
from kane_dynamics.mechanics.constraints.constraint_types.position_constraints import (Coupling,
                                                                                       Prescribed)
from kane_dynamics.mechanics.constraints.constraint_types.rolling import Rolling
from kane_dynamics.mechanics.constraints.constraint_types.velocity_constraints import (
    DependentSpeeds, knife_edge, PointVelocity)

Constraint = PointVelocity | Rolling | DependentSpeeds | Closure | Coupling | Prescribed

__all__ = ['Closure', 'Constraint', 'Coupling', 'DependentSpeeds', 'Geometry', 'PointVelocity',
           'Prescribed', 'Rolling', 'ConstraintRows', 'checked_constraints', 'checked_names',
           'knife_edge']


def checked_constraints(given: Any) -> tuple[Constraint, ...]:
    """Return a sequence of constraints as a tuple; else raise ConstraintError."""
    kinds = get_args(Constraint)
    valid = ', '.join(kind.__name__ for kind in kinds)
    if isinstance(given, kinds):
        raise ConstraintError(f'constraints: a {type(given).__name__}; expected a sequence, '
                              'such as [pin]')
    try:
        found = () if isinstance(given, str) else tuple(given)
    except TypeError:
        found = (given,)
    for k, each in enumerate(found):
        if not isinstance(each, kinds):
            raise ConstraintError(f'constraints[{k}]: {each!r}; expected one of {valid}')
    if isinstance(given, str):
        raise ConstraintError(f'constraints: {given!r}; expected a sequence of {valid}')
    return found


def checked_names(given: Any, what: str) -> tuple[str, ...] | None:
    """Return a sequence of names as a tuple, or None unchanged; else raise ConstraintError."""
    if given is None:
        return None
    names = () if isinstance(given, str) else tuple(given) if hasattr(given, '__iter__') else (
        given,)
    if isinstance(given, str) or not all(isinstance(name, str) for name in names):
        raise ConstraintError(f'{what}: {given!r}; expected a sequence of names, such as '
                              f"['{given if isinstance(given, str) else 'crank'}']")
    return names
