"""A block on a spring carries a pendulum: model, simulation, energy drift."""

from kane_dynamics import ModelBuilder, point_mass, Robot, simulate
import numpy as np

b = ModelBuilder('spring-mass-pendulum')
b.body('block', 'world', 'prismatic', axis=(1, 0, 0), inertial=point_mass(2.0),
       stiffness=50.0)
b.body('pendulum', 'block', 'revolute', axis=(0, -1, 0),
       inertial=point_mass(1.0, (0, 0, -0.5)))

robot = Robot(b.model())
q = np.array([0.1, 0.6])
u = np.zeros(2)
print('M =', robot.mass_matrix(q).round(6).tolist())
print('udot =', robot.forward_dynamics(q, u, np.zeros(2)).round(6).tolist())
swing = simulate(robot, q, u, duration=2.0)
energy = swing.energy.sum(axis=1)
print(f'after 2 s: q = {swing.q[-1].round(6).tolist()}, energy drift '
      f'{np.ptp(energy):.1e} J')
