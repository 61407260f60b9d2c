"""The Chaplygin sleigh: a blade that cannot slip sideways, behind or before the mass centre."""

from kane_dynamics import box, ModelBuilder
from kane_dynamics.mechanics.constrained import ConstrainedEquations
from kane_dynamics.mechanics.constraints import knife_edge
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.mechanics.structure import structured
import numpy as np

b = ModelBuilder('sleigh')
b.body('sleigh', 'world', 'planar', matter=box(3.0, (1.0, 0.4, 0.1), at=(0.3, 0, 0)))
model = b.model()
glides = ConstrainedEquations(Equations(model), structured(
    model, None, [knife_edge('sleigh', (0, 1, 0), name='blade')], ['sleigh/x', 'sleigh/rz']))

q, none = np.zeros(3), np.zeros(2)
for u in ((2.0, 1.0), (-2.0, 1.0)):  # forward, the mass centre ahead: the turn dies out
    udot = glides.forward_dynamics(q, np.array(u), none, None, model.gravity, 0.0).astype(float)
    side = glides.constraint_forces(q, np.array(u), udot, None, model.gravity, 0.0, np.zeros(3))
    print(f'at {u[0]:+} m/s: speeds up by {udot[0]:.6f} m/s^2, turn by {udot[1]:.6f} rad/s^2, '
          f'side force {float(side[0]):.6f} N')
