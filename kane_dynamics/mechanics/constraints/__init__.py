"""
Constraints on the motion of a mechanism, each stated as a velocity that vanishes or is given.

Every constraint is rows J(q, t) q' = b(q, t). A row is a component of partial velocities, so
nothing is differentiated by hand (Kane & Levinson, sections 2.13 and 2.14). Rows that come from
a condition on positions (a closed loop, a wheel on the ground) also tell the gap by which that
condition is missed, whose rate the row is.

All functions here run over any scalar. World axes, SI units.
"""

from kane_dynamics.mechanics.constraints.constraint_rows import ConstraintRows, Geometry
from kane_dynamics.mechanics.constraints.position_constraints import Closure, Coupling, Prescribed
from kane_dynamics.mechanics.constraints.velocity_constraints import (DependentSpeeds, knife_edge,
                                                                      PointVelocity, Rolling)

Constraint = PointVelocity | Rolling | DependentSpeeds | Closure | Coupling | Prescribed

__all__ = ['Closure', 'Constraint', 'Coupling', 'DependentSpeeds', 'Geometry', 'PointVelocity',
           'Prescribed', 'Rolling', 'ConstraintRows', 'knife_edge']
