"""
A seven-axis arm on a base with two driven wheels: the torques of wheels and joints.

Figures: the arm is the FR3 of urdf/ (urdf/README.md has its sources). The base is PAL
Robotics' PMB-2, from its description (github.com/pal-robotics/pmb2_robot,
base.urdf.xacro and wheel.urdf.xacro of pmb2_description): base and wheels, without
casters and suspensions. Ours: the place of the arm on the base, and wheels whose centers
of mass are on their axles (2 mm off).
"""

from pathlib import Path
import sys

from kane_dynamics import Inertial, load_urdf, ModelBuilder, Robot, Rolling, simulate
import numpy as np

# Of the wheels, and between them, m.
radius = 0.0985
track = 0.4044
base = Inertial(24.73813, np.array([0.00144, 0.00003, 0.06711]), np.array(
    [[0.50215676906, 0.00014630224, -0.00851406322],
     [0.00014630224, 0.41873574615, 0.00001868612],
     [-0.00851406322, 0.00001868612, 0.64067017495]]))
wheel = Inertial(1.82362, np.zeros(3),
                 np.diag([0.00499743171, 0.00839239692, 0.00499741733]))

b = ModelBuilder('mobile manipulator')
b.body('base', 'world', 'planar', at=(0, 0, radius), inertial=base)
for name, side in (('left', 0.5), ('right', -0.5)):
    b.body(name, 'base', axis=(0, 1, 0), at=(0, side * track, 0), inertial=wheel)
b.mount(load_urdf(Path(__file__).parents[1] / 'urdf' / 'fr3.urdf',
                  locked={'fr3_finger_joint1': 0.02}), 'base', at=(0.1, 0, 0.2))
rolling = [Rolling(name, radius, axis=(0, 1, 0)) for name in ('left', 'right')]
arm = [f'fr3_joint{k}' for k in range(1, 8)]
robot = Robot(b.model(), constraints=rolling, independent=['left', 'right', *arm])

arm_at_rest = np.array([0, -0.6, 0, -2.2, 0, 1.6, 0.8])
# rad, rad/s, s
swing = np.array([0.5, 0.4, 0.3, 0.4, 0.5, 0.3, 0.6])
rate = 2.0
step = 1e-3


def wanted(t):
    """Return wheel and joint speeds of the desired motion, and their rates."""
    pace = 6.0 * np.sin(0.5 * t) ** 2
    turn = 2.0 * np.sin(rate * t)
    pace_rate = 3.0 * np.sin(t)
    turn_rate = 2.0 * rate * np.cos(rate * t)
    return (np.array([pace - turn, pace + turn, *swing * rate * np.sin(rate * t)]),
            np.array([pace_rate - turn_rate, pace_rate + turn_rate,
                      *swing * rate**2 * np.cos(rate * t)]))


def computed_torque(t, q, u):
    """Return the torques of wheels and joints for the desired motion."""
    u_d, udot_d = wanted(t + step / 2)  # constant during the step
    return robot.inverse_dynamics(q, u, udot_d + 20.0 * (u_d - u))


q0 = np.concatenate([np.zeros(5), arm_at_rest])
run = simulate(robot, q0, wanted(0.0)[0], 6.0, step=step, torque=computed_torque,
               sample=0.01)
error = run.u - np.array([wanted(t)[0] for t in run.t])
side = np.abs(
    np.array([robot.frame_velocity('base', q, u)[:2] @ (-np.sin(q[2]), np.cos(q[2]))
              for q, u in zip(run.q, run.u)])).max()
print('drives to x, y, heading =', run.q[-1, :3].round(3).tolist())
print(f'wheel and joint speeds follow to {np.abs(error).max():.1e} rad/s')
print(
    f'largest wheel torque {np.abs(run.tau[:, :2]).max():.2f} N m, joint torque '
    f'{np.abs(run.tau[:, 2:]).max():.1f} N m; the base slips sideways at {side:.0e} m/s')

if len(sys.argv) > 1:  # where to draw the picture
    from matplotlib import pyplot as plt
    figure, (above, wheels, joints) = plt.subplots(1, 3,
                                                   figsize=(15, 4), layout='constrained')
    tip = np.array([robot.frame_pose('fr3_link8', q)[:2, 3] for q in run.q])
    above.plot(*run.q[:, :2].T, label='base')
    above.plot(*tip.T, label="arm's flange")
    above.set(xlabel='x [m]', ylabel='y [m]', aspect='equal', title='Seen from above')
    wheels.plot(run.t, run.tau[:, :2], label=robot.speed_names[:2])
    wheels.set(xlabel='time [s]', ylabel='torque [N m]', title='Wheels')
    joints.plot(run.t, run.tau[:, 2:], label=robot.speed_names[2:])
    joints.set(xlabel='time [s]', ylabel='torque [N m]', title='Arm')
    for axes in (above, wheels, joints):
        axes.legend(fontsize='small', loc='upper left', bbox_to_anchor=(1.0, 1.0))
    figure.savefig(sys.argv[1], dpi=110)
