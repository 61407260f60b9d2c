"""
A delta robot carries 6 kg over the 25-305-25 mm cycle: torques of its three arms.

Figures: Autonox24 RL5-1450-6kg with three axes, from the simulation model of Alikoc,
Sustr, Zitek, Rehorik, Burget and Lomakin, "Motion Modelling and Simulation of a 5-Axis
Industrial Delta Robot" (github.com/testbedCIIRC/delta-robot-public: lengths in
Basic_3DoF_Delta_Dynamic_Param.m, masses in RL5_6kg_Inertia_Mass.m). Ours: the arm's
center of mass is on the line from shoulder to elbow (the file has it 27 mm off), its
moment about that line is 0 (the arm never turns about it), pins are point masses, the
payload is a point mass at the platform, and the cycle takes 0.35 s.

The two rods of a forearm move in parallel, and the platform does not rotate. So both
rods have the same velocity at corresponding points: one body with the mass of both is
exact, and three sliding joints carry the platform.
"""

from kane_dynamics import Closure, Inertial, ModelBuilder, point_mass, Robot
import numpy as np

# Radii of axes and corners, lengths, m.
shoulder = 0.330
corner = 0.125
upper = 0.420
fore = 1.055
pin = 0.226  # kg; one at each elbow, one at each corner
arm = Inertial(
    3.696, np.array([0.2463, 0.0, 0.0]),
    np.diag([0.0, 1.0, 1.0]) * (0.208218 - 3.47 * 0.17224**2 - 0.226 * 0.42**2))
rods = Inertial(2 * 0.525, np.array([0.0, 0.0, -0.5275]),
                2 * np.diag([0.043009, 0.0430094, 5.22934e-5]))
gear = 55**2 * 2.07e-4  # kg m^2, of the gearbox at the arm
moving = point_mass(2.916 + 3 * pin + 6.0)  # platform, pins and payload

b = ModelBuilder('delta robot')
b.body('along x', 'world', 'prismatic', axis=(1, 0, 0), joint='x')
b.body('along y', 'along x', 'prismatic', axis=(0, 1, 0), joint='y')
b.body('platform', 'along y', 'prismatic', axis=(0, 0, 1), joint='z', inertial=moving)
turns = 2 * np.pi / 3 * np.arange(3)
arms = []
ends = []
for k, turn in enumerate(turns, 1):
    b.frame(f'side {k}', 'world', rpy=(0, 0, turn))
    b.body(f'arm {k}', f'side {k}', axis=(0, 1, 0), at=(shoulder, 0, 0), armature=gear,
           inertial=arm + point_mass(pin, (upper, 0, 0)))
    b.body(f'forearm {k}', f'arm {k}', 'universal',
           at=(upper, 0, 0), turns='yx', inertial=rods)
    b.frame(f'wrist {k}', f'forearm {k}', at=(0, 0, -fore))
    b.frame(f'corner {k}',
            'platform', at=corner * np.array([np.cos(turn), np.sin(turn), 0]))
    ends.append(Closure(f'wrist {k}', f'corner {k}', 'spherical', name=f'end {k}'))
    arms.append(f'arm {k}')
robot = Robot(b.model(), constraints=ends, independent=['x', 'y', 'z'], actuated=arms)
driven = [robot.coordinate_names.index(name) for name in arms]

# s, m
duration = 0.35
travel = 0.305
lift = 0.025
depth = 0.95
# Of the line of the cycle, seen from above.
heading = np.array([np.cos(0.4), np.sin(0.4)])


def path(t):
    """Return position, velocity and acceleration of the platform, (3,) each."""
    s = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])(
        np.polynomial.Polynomial([0, 1 / duration]))  # from 0 to 1, at rest at both ends
    along = travel * (s - 0.5)
    z = 64 * lift * (s * (1 - s))**3 - depth
    return [np.array([*along.deriv(k)(t) * heading, z.deriv(k)(t)]) for k in range(3)]


def arm_angles(p):
    """Return the arms' angles with the platform at p: closed form, elbows outward."""
    out = p[0] * np.cos(turns) + p[1] * np.sin(turns) + corner - shoulder  # of the axes
    side = p[1] * np.cos(turns) - p[0] * np.sin(turns)
    c = (out**2 + side**2 + p[2]**2 + upper**2 - fore**2) / (2 * upper)
    return np.arctan2(-p[2], out) - np.arccos(c / np.hypot(out, p[2]))


times = np.linspace(0.0, duration, 101)
q = np.zeros(robot.n_q)
rows = []
for t in times:
    p, u, udot = path(t)
    q = robot.closed_configuration([*p, *q[3:]], fixed=['x', 'y', 'z'])
    tau = robot.joint_torques(robot.inverse_dynamics(q, u, udot), q)[driven]
    rows.append((q, u, udot, tau, robot.joint_rates(q, u)[driven] @ tau,
                 robot.kinetic_energy(q, u) + robot.potential_energy(q)))
qs, us, udots, taus, power, energy = map(np.array, zip(*rows))

print('  t [s]    x [m]    z [m]   torques of the arms [N m], positive downward')
for k in range(0, 101, 20):
    print(f'{times[k]:7.3f}{qs[k, 0]:9.4f}{qs[k, 2]:9.4f}',
          ''.join(f'{x:10.3f}' for x in taus[k]))
error = np.abs(qs[:, driven] - [arm_angles(p) for p in qs[:, :3]]).max()
print(f'arm angles from loop closure and from the closed form differ by {error:.1e} rad')
simpson = np.array([1, *[4, 2] * 24, 4, 1]) * duration / 300.0
work = simpson @ power[:51]
gain = energy[50] - energy[0]
print(f'up to {times[50]:.3f} s the torques do {work:.5f} J, the energy grows by '
      f'{gain:.5f} J')
