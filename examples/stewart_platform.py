"""
A Stewart platform: forces of its six legs along a motion of Tsai's example.

Figures and motions: L.-W. Tsai, "Solving the Inverse Dynamics of a Stewart-Gough
Manipulator by the Principle of Virtual Work", ASME Journal of Mechanical Design 122
(2000), 3-9, as coded in github.com/houchangmeng/Stewart-Platform-Related-Code
(example_inverse_dynamics.m). The article shows its forces as curves. The library's
forces are compared with the same principle of virtual work, programmed in a test, and
not with these curves. The inertia of a leg about its own axis is 0 here: in the article
legs do not turn about their axes.

Each leg is a universal joint at the base, a cylinder and a piston, which a ball joint
(closure `spherical`) joins to the platform. The speeds of the platform are independent:
then the joints of each leg follow from its own closure alone.
"""

from kane_dynamics import Closure, Inertial, ModelBuilder, Robot
import numpy as np

feet = np.array([[-2.120, 1.374, 0], [-2.380, 1.224, 0], [-2.380, -1.224, 0],
                 [-2.120, -1.374, 0], [0, -0.150, 0], [0, 0.150, 0]])  # m, in the world
tops = np.array([[0.170, 0.595, -0.4], [-0.600, 0.150, -0.4], [-0.600, -0.150, -0.4],
                 [0.170, -0.595, -0.4], [0.430, -0.445, -0.4], [0.430, 0.445, -0.4]])
# Of cylinder and piston alike.
mass = 0.1
inertia = np.diag([1 / 160, 1 / 160, 0])
center = 0.5

b = ModelBuilder('stewart platform', gravity=(0, 0, -9.80665))
b.body('platform', kind='free', inertial=Inertial(1.5, np.zeros(3), 0.08 * np.eye(3)))
legs = []
closures = []
for k, (foot, top) in enumerate(zip(feet, tops), 1):
    b.body(f'cylinder {k}', 'world', 'universal', at=foot,
           inertial=Inertial(mass, np.array([0, 0, center]), inertia))
    b.body(f'leg {k}', f'cylinder {k}', 'prismatic', axis=(0, 0, 1),
           inertial=Inertial(mass, np.array([0, 0, -center]), inertia))
    b.frame(f'top {k}', 'platform', at=top)
    closures.append(Closure(f'leg {k}', f'top {k}', 'spherical', name=f'joint {k}'))
    legs.append(f'leg {k}')
platform = [f'platform/{part}' for part in ('x', 'y', 'z', 'wx', 'wy', 'wz')]
robot = Robot(b.model(), constraints=closures, independent=platform, actuated=legs)
lengths = [robot.coordinate_names.index(leg) for leg in legs]
forces = [robot.joint_names.index(leg) for leg in legs]
rate = 3.0  # rad/s


def shift(t):
    """Return the pose, speeds and accelerations of the first motion: along (1, 1, 1)."""
    s = 0.2 * np.sin(rate * t)
    c = 0.2 * rate * np.cos(rate * t)
    return ([-1.5 + s, s, 1 + s, 0, 0, 0, 1], np.array([c, c, c, 0, 0, 0]),
            -rate**2 * np.array([s, s, s, 0, 0, 0]))


def turn(t):
    """Return the second motion's pose, speeds and accelerations: rotation about z."""
    a = np.pi / 6 * np.sin(rate * t)
    v = np.pi / 6 * rate * np.cos(rate * t)
    return ([-1.5, 0, 1, 0, 0, np.sin(a / 2), np.cos(a / 2)],
            np.array([0, 0, 0, 0, 0, v]), np.array([0, 0, 0, 0, 0, -rate**2 * a]))


def closed(pose):
    """Return the configuration with the platform at `pose`, by the legs' geometry."""
    x, y, z, w = pose[3:]
    R = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                  [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                  [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])
    leg = pose[:3] + tops @ R.T - feet
    length = np.linalg.norm(leg, axis=1)
    angles = np.arctan2(-leg[:, 1], leg[:, 2]), np.arcsin(leg[:, 0] / length), length
    return np.concatenate([pose, np.transpose(angles).ravel()])


def leg_forces(motion, t):
    """Return configuration, speeds, accelerations and leg forces, N, at time t."""
    pose, u, udot = motion(t)
    q = closed(pose)
    return q, u, udot, robot.joint_torques(robot.inverse_dynamics(q, u, udot), q)[forces]


if __name__ == '__main__':
    residual = 0.0
    for motion in (shift, turn):
        print(
            f'{motion.__name__}: t [s], forces of the legs [N], positive in compression')
        for t in np.linspace(0.0, 2 * np.pi / rate, 9):
            q, u, _, force = leg_forces(motion, t)
            residual = max(residual, np.abs(robot.constraint_residual(q)).max())
            print(f'{t:7.3f}', ''.join(f'{x:9.4f}' for x in force))
    print(f'the geometry of the legs closes the loops to {residual:.0e} m')

    times = np.linspace(0.0, np.pi / 2 / rate, 41)
    power = []
    energy = []
    for t in times:  # while the platform turns by 30 degrees
        q, u, _, force = leg_forces(turn, t)
        power.append(force @ robot.joint_rates(q, u)[lengths])
        energy.append(robot.kinetic_energy(q, u) + robot.potential_energy(q))
    simpson = np.array([1, *[4, 2] * 19, 4, 1]) * times[1] / 3
    print(f'work of the legs {simpson @ power:.6f} J, gain of energy '
          f'{energy[-1] - energy[0]:.6f} J')
