"""A four-bar linkage, its loop cut at the rocker's end: crank torque and pin forces."""

from kane_dynamics import ModelBuilder, rod
from kane_dynamics.mechanics.constrained import ConstrainedEquations
from kane_dynamics.mechanics.constraints import Closure
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.mechanics.structure import closed_posture, structured
import numpy as np

b = ModelBuilder('four-bar')
carrier, joint = 'world', (0, 0, 0)
for name, length in (('crank', 0.3), ('coupler', 0.9), ('rocker', 0.7)):
    end = (length, 0, 0)
    b.body(name, carrier, 'revolute', axis=(0, -1, 0), at=joint,
           matter=rod(2 * length, (0, 0, 0), end))
    carrier, joint = name, end
b.frame('end', 'rocker', at=joint)
b.frame('ground', 'world', at=(1, 0, 0))
model = b.model()

loop = structured(model, None, [Closure('end', 'ground', 'revolute', axis=(0, 1, 0))], ['crank'])
linkage = ConstrainedEquations(Equations(model), loop)
q, u, udot = closed_posture(loop, (0.8, 0.0, -1.5), fixed=['crank']), np.array([5.0]), np.zeros(1)
tau = linkage.inverse_dynamics(q, u, udot, None, model.gravity, 0.0)
pin = linkage.constraint_forces(q, u, udot, None, model.gravity, 0.0, np.array([tau[0], 0, 0]))
print('closed at q =', q.round(6).tolist())
print(f'crank torque at a steady 5 rad/s = {float(tau[0]):.6f} N m')
print('pin force =', {label: round(float(x), 6) for label, x in zip(loop.labels, pin)})
