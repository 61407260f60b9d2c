"""
A satellite with an arm: it turns while the arm moves, and its momenta stay.

Sizes and masses are chosen, those of no particular machine.
"""

from kane_dynamics import box, ModelBuilder, Robot, simulate
from kane_dynamics.mechanics.definition import kane
import numpy as np

b = ModelBuilder('satellite', gravity=(0, 0, 0))
b.body('bus', kind='free', matter=box(200.0, (1.2, 1.0, 1.4), at=(0.03, 0.02, 0.03)))
on, at = 'bus', (0.6, 0.0, 0.0)
for k, axis in enumerate([(0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0)], 1):
    b.body(f'joint{k}', on, axis=axis, at=at,
           matter=box(9.0 - k, (0.4, 0.1, 0.1), at=(0.2, 0.0, 0.02)))
    on, at = f'joint{k}', (0.4, 0.0, 0.0)
robot = Robot(b.model())


def momenta(q, u):
    """Return momentum, kg m/s, and angular momentum about the world's origin, kg m^2/s."""
    P, H = np.zeros((2, 3))
    bodies = kane.configurations(robot.model, q)
    for body, here in zip(robot.model.bodies, bodies):
        p = body.inertial.mass * (u @ here.partial_velocity)
        spin = kane.central_inertia(body, here) @ (u @ here.partial_angular_velocity)
        P, H = P + p, H + np.cross(here.p_com, p) + spin
    return np.concatenate([P, H])


q = robot.neutral()
q[7:] = 0.3, -0.5, 0.8, 0.2, 0.4, -0.3
u = np.array([0.01, -0.02, 0.005, 0.02, -0.03, 0.01, 0.05, 0.08, -0.06, 0.1, 0.05, -0.1])
run = simulate(robot, q, u, 60.0, step=2e-3, sample=1.0)

found = np.array([momenta(*state) for state in zip(run.q, run.u)])
turned = robot.difference(run.q[0], run.q[-1])[3:6]
print(f'after 60 s the bus has turned by {np.degrees(np.linalg.norm(turned)):.3f} degrees')
for name, rows in (('momentum', found[:, :3]), ('angular momentum', found[:, 3:])):
    change = np.abs(rows - rows[0]).max() / np.linalg.norm(rows[0])
    print(f'{name} {np.linalg.norm(rows[0]):.6f}, constant to 1e-12 of it: {change < 1e-12}')
