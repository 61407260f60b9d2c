"""A four-bar linkage, cut at the rocker's end: crank torque, pin forces, free motion."""

from kane_dynamics import Closure, ModelBuilder, Robot, rod, simulate
import numpy as np

b = ModelBuilder('four-bar')
carrier = 'world'
joint = (0, 0, 0)
for name, length in (('crank', 0.3), ('coupler', 0.9), ('rocker', 0.7)):
    end = (length, 0, 0)
    b.body(name, carrier, 'revolute', axis=(0, -1, 0), at=joint,
           inertial=rod(2 * length, (0, 0, 0), end))
    carrier = name
    joint = end
b.frame('end', 'rocker', at=joint)
b.frame('ground', 'world', at=(1, 0, 0))
pin = Closure('end', 'ground', 'revolute', axis=(0, 1, 0), name='pin')
linkage = Robot(b.model(), constraints=[pin], independent=['crank'])

q = linkage.closed_configuration((0.8, 0.0, -1.5), fixed=['crank'])
u = np.array([5.0])
tau = linkage.inverse_dynamics(q, u, np.zeros(1))
forces = linkage.constraint_forces(q, u, tau)
print('closed at q =', q.round(6).tolist())
print(f'crank torque at a steady 5 rad/s = {tau[0]:.6f} N m')
print('pin force =', dict(zip(linkage.constraint_names, forces.round(6).tolist())))
run = simulate(linkage, q, u, 10.0)
energy = run.energy.sum(axis=1)
print(f'10 s of free motion: energy drift {np.abs(energy - energy[0]).max():.1e} J, '
      f'loop closed to {run.drift:.1e} m')
