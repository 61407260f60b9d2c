"""The Chaplygin sleigh: a blade behind or ahead of the center of mass cannot slip."""

from kane_dynamics import box, knife_edge, ModelBuilder, Robot
import numpy as np

b = ModelBuilder('sleigh')
b.body('sleigh', 'world', 'planar', inertial=box(3.0, (1.0, 0.4, 0.1), at=(0.3, 0, 0)))
glides = Robot(b.model(), constraints=[knife_edge('sleigh', (0, 1, 0), name='blade')],
               independent=['sleigh/x', 'sleigh/rz'])

q = np.zeros(3)
none = np.zeros(2)
for u in (np.array([2.0, 1.0]), np.array([-2.0, 1.0])):
    udot = glides.forward_dynamics(q, u, none)
    side = glides.constraint_forces(q, u, none)
    print(f'at {u[0]:+} m/s: acceleration {udot[0]:.6f} m/s^2, {udot[1]:.6f} rad/s^2, '
          f'side force {side[0]:.6f} N')
