"""The bearing torque of two rods: a noncontributing torque, by an auxiliary speed."""

from kane_dynamics import ModelBuilder, PointVelocity, Robot, rod
import numpy as np

m = 1.0
L = 0.3
b = ModelBuilder('two rods')
b.body('turn', 'world', 'revolute', axis=(0, 1, 0))
b.body('A', 'turn', 'revolute', axis=(1, 0, 0),
       inertial=rod(2 * m, (0, 0, 0), (0, 0, 4 * L)))
b.body('B', 'A', 'revolute', at=(0, 0, 4 * L),
       inertial=rod(m, (0, 0, 0), (0, -2 * L, 0)))
bearing = PointVelocity('A', (1, 0, 0), axes='A', angular=True, name='bearing')  # u3 = 0
rods = Robot(b.model(), constraints=[bearing], independent=['turn', 'B'])

q = np.array([0.4, 0.0, 0.9])
u = np.array([1.0, -2.0])
tau = np.zeros(2)
udot = rods.forward_dynamics(q, u, tau)
torque = rods.constraint_forces(q, u, tau)
print('udot =', udot.round(6).tolist())
print(f'bearing torque about a1 = {torque[0]:.6f} N m')
