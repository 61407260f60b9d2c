"""A torque that does no work, brought into evidence: what the bearing of two rods carries."""

from kane_dynamics import ModelBuilder, rod
from kane_dynamics.mechanics.constrained import ConstrainedEquations
from kane_dynamics.mechanics.constraints import PointVelocity
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.mechanics.structure import structured
import numpy as np

m, L = 1.0, 0.3
b = ModelBuilder('two rods')
b.body('turn', 'world', 'revolute', axis=(0, 1, 0))
b.body('A', 'turn', 'revolute', axis=(1, 0, 0), matter=rod(2 * m, (0, 0, 0), (0, 0, 4 * L)))
b.body('B', 'A', 'revolute', at=(0, 0, 4 * L), matter=rod(m, (0, 0, 0), (0, -2 * L, 0)))
model = b.model()

bearing = PointVelocity('A', (1, 0, 0), axes='A', angular=True, name='bearing')  # u3 = 0
rods = ConstrainedEquations(Equations(model), structured(model, None, [bearing], ['turn', 'B']))
q, u, tau = np.array([0.4, 0.0, 0.9]), np.array([1.0, -2.0]), np.zeros(2)
udot = rods.forward_dynamics(q, u, tau, None, model.gravity, 0.0)
torque = rods.constraint_forces(q, u, udot, None, model.gravity, 0.0, np.zeros(3))
print('udot =', [round(float(x), 6) for x in udot])
print(f'bearing torque about a1 = {float(torque[0]):.6f} N m')
