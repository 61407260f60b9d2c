"""
A seven-axis arm on a base with two driven wheels: the torques of wheels and joints.

The arm is the Franka Research 3 of `urdf/fr3.urdf`, which names its sources. Size and mass of base
and wheels are chosen, those of no particular machine.
"""

from pathlib import Path
import sys

from kane_dynamics import box, disc, load_urdf, ModelBuilder, Robot, Rolling, simulate
import numpy as np

radius, track = 0.1, 0.5  # of the wheels, and between them, m
b = ModelBuilder('mobile manipulator')
b.body('base', 'world', 'planar', at=(0, 0, radius), matter=box(30.0, (0.7, 0.45, 0.25)))
for name, side in (('left', 0.5), ('right', -0.5)):
    b.body(name, 'base', axis=(0, 1, 0), at=(0, side * track, 0),
           matter=disc(1.5, radius, axis=(0, 1, 0)))
b.mount(load_urdf(Path(__file__).parents[1] / 'urdf' / 'fr3.urdf',
                  locked={'fr3_finger_joint1': 0.02}), 'base', at=(0.15, 0, 0.125))
wheels = [Rolling(name, radius, axis=(0, 1, 0)) for name in ('left', 'right')]
arm = [f'fr3_joint{k}' for k in range(1, 8)]
robot = Robot(b.model(), constraints=wheels, independent=['left', 'right', *arm])

rest = np.array([0, -0.6, 0, -2.2, 0, 1.6, 0.8])
swing, rate, step = np.array([0.5, 0.4, 0.3, 0.4, 0.5, 0.3, 0.6]), 2.0, 1e-3  # rad, rad/s, s


def wanted(t):
    """Return wheel and joint speeds of the desired motion, and their rates."""
    pace, turn = 6.0 * np.sin(0.5 * t) ** 2, 2.0 * np.sin(rate * t)
    pace_rate, turn_rate = 3.0 * np.sin(t), 2.0 * rate * np.cos(rate * t)
    return (np.array([pace - turn, pace + turn, *swing * rate * np.sin(rate * t)]),
            np.array([pace_rate - turn_rate, pace_rate + turn_rate,
                      *swing * rate**2 * np.cos(rate * t)]))


def computed_torque(t, q, u):
    """Return the torques of wheels and joints for the desired motion."""
    u_d, udot_d = wanted(t + step / 2)  # constant during the step
    return robot.inverse_dynamics(q, u, udot_d + 20.0 * (u_d - u))


q0 = np.concatenate([np.zeros(5), rest])
run = simulate(robot, q0, wanted(0.0)[0], 6.0, step=step, torque=computed_torque,
               sample=0.01)
error = run.u - np.array([wanted(t)[0] for t in run.t])
side = np.abs(np.array([robot.frame_velocity('base', q, u)[:2] @ (-np.sin(q[2]), np.cos(q[2]))
                        for q, u in zip(run.q, run.u)])).max()
print('drives to x, y, heading =', run.q[-1, :3].round(3).tolist())
print(f'wheel and joint speeds follow to {np.abs(error).max():.1e} rad/s')
print(f'largest wheel torque {np.abs(run.tau[:, :2]).max():.2f} N m, joint torque '
      f'{np.abs(run.tau[:, 2:]).max():.1f} N m; the base slips sideways at {side:.0e} m/s')

if len(sys.argv) > 1:  # where to draw the picture
    from matplotlib import pyplot as plt
    figure, (above, wheel, joints) = plt.subplots(1, 3, figsize=(15, 4), layout='constrained')
    tip = np.array([robot.frame_pose('fr3_link8', q)[:2, 3] for q in run.q])
    above.plot(*run.q[:, :2].T, label='base')
    above.plot(*tip.T, label="arm's flange")
    above.set(xlabel='x [m]', ylabel='y [m]', aspect='equal', title='Seen from above')
    wheel.plot(run.t, run.tau[:, :2], label=robot.speed_names[:2])
    wheel.set(xlabel='time [s]', ylabel='torque [N m]', title='Wheels')
    joints.plot(run.t, run.tau[:, 2:], label=robot.speed_names[2:])
    joints.set(xlabel='time [s]', ylabel='torque [N m]', title='Arm')
    for axes in (above, wheel, joints):
        axes.legend(fontsize='small', loc='upper left', bbox_to_anchor=(1.0, 1.0))
    figure.savefig(sys.argv[1], dpi=110)
