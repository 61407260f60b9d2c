"""A disc that leans inward and rolls in a steady circle."""

from kane_dynamics import disc, ModelBuilder, Robot, Rolling
import numpy as np

m = 1.0
r = 0.3
lean = -0.4
turn = 2.0
b = ModelBuilder('rolling disc')
b.body('disc', 'world', 'floating', turns='zxy', inertial=disc(m, r, axis=(0, 1, 0)))
free = ['disc/rz', 'disc/rx', 'disc/ry']  # heading, lean, spin
rolls = Robot(b.model(), constraints=[Rolling('disc', r, axis=(0, 1, 0))],
              independent=free)


def lean_acceleration(spin):
    """Return the angular acceleration of the lean at a rate of spin."""
    q = np.array([0, 0, r * np.cos(lean), 0, lean, 0])
    u = np.array([turn, 0.0, spin])
    return rolls.forward_dynamics(q, u, np.zeros(3))[1]


# It is linear in the spin.
at_0 = lean_acceleration(0.0)
at_1 = lean_acceleration(1.0)
spin = at_0 / (at_0 - at_1)
print(f'spin = {spin:.6f} rad/s keeps the lean: its acceleration is '
      f'{lean_acceleration(spin):.1e}')
print(f'the contact point follows a circle of radius {abs(spin * r / turn):.6f} m')
