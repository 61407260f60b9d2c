"""
A fast move of an FR3 whose gears yield, with rigid and with elastic feedforward.

The drives follow the same motion with the same gains. Feedforward that leaves the
springs out excites the vibration that remains; the elastic one leads the motors by the
deflections. `python examples/elastic_joints.py elastic.png` draws it.
"""

from pathlib import Path
import sys

from kane_dynamics import (Drive, load_urdf, MotorSideControl, Robot, simulate,
                           SmoothMotion, with_drives, with_rigid_joints)
import numpy as np

TIP = 'fr3_link7'
HOME = np.array([0.0, -0.4, 0.0, -2.0, 0.0, 1.7, 0.8])
MOVE = np.array([0.7, 0.4, -0.4, 0.5, 0.4, -0.4, 0.5])
# s
DURATION = 0.5
AFTER = 1.0
STEP = 1e-3
KP = np.array([600.0, 600.0, 600.0, 600.0, 250.0, 150.0, 50.0])
KD = np.array([30.0, 30.0, 30.0, 30.0, 10.0, 10.0, 5.0])

links = load_urdf(Path(__file__).parents[1] / 'urdf' / 'fr3.urdf', tip=TIP)
drives = {name: Drive(stiffness=14e3 if k < 4 else 3e3, damping=0.2, rotor_inertia=0.4)
          for k, name in enumerate(links.joint_names)}
elastic = Robot(with_drives(links, drives), friction=False)
rigid = Robot(with_rigid_joints(elastic.model), friction=False)
motion = SmoothMotion.from_points([0.0, DURATION], [HOME, HOME + MOVE],
                                  joint_names=links.joint_names)
n = rigid.n


by_elastic = MotorSideControl(elastic, motion, kp=KP, kd=KD)

# Every half step: what the drives follow, positions, speeds and torques of the motors.
halves = 0.5 * STEP * np.arange(round(2.0 * (DURATION + AFTER) / STEP) + 3)
q_d, u_d, udot_d = motion.sample(halves)[:3]
of_rigid = q_d, u_d, rigid.inverse_dynamics(q_d, u_d, udot_d)
command = by_elastic.command(halves)
of_elastic = command.positions, command.velocities, command.torques


def moved(positions, speeds, torques):
    """Return times and positions of the tip, m, of a move with these drives."""
    def drives_at(t, q, u):
        k = 2 * round(t / STEP)
        # A torque is held for the step: that of its middle is right on average.
        tau = torques[k + 1] + KP * (positions[k] - q[n:]) + KD * (speeds[k] - u[n:])
        return np.concatenate([np.zeros(n), tau])
    start = np.concatenate([HOME, of_elastic[0][0]])
    run = simulate(elastic, start, np.zeros(2 * n), DURATION + AFTER, step=STEP,
                   torque=drives_at)
    return run.t, elastic.frame_pose(TIP, run.q)[:, :3, 3]


def vibration(t, tip):
    """Return half of the distance between the farthest positions after the move, m."""
    afterwards = tip[t > DURATION + 0.1]
    return 0.5 * np.linalg.norm(np.ptp(afterwards, axis=0))


t, with_rigid = moved(*of_rigid)
_, with_elastic = moved(*of_elastic)
by_rigid = vibration(t, with_rigid)
by_elastic = vibration(t, with_elastic)
print(f'the tip vibrates by {1e3 * by_rigid:.2f} mm with the rigid feedforward, '
      f'{1e3 * by_elastic:.3f} mm with the elastic one')

if len(sys.argv) > 1:
    import matplotlib
    matplotlib.use('Agg')
    import matplotlib.pyplot as plt
    goal = rigid.frame_pose(TIP, HOME + MOVE)[:3, 3]
    figure, axes = plt.subplots(figsize=(8.0, 3.5), layout='constrained')
    for tip, label in ((with_rigid, 'rigid feedforward'),
                       (with_elastic, 'elastic feedforward')):
        axes.plot(t, 1e3 * np.linalg.norm(tip - goal, axis=1), label=label)
    axes.set(xlim=(DURATION - 0.05, t[-1]), xlabel='s',
             ylabel='distance to the goal, mm', title='Tip after a fast move')
    axes.set_ylim(0.0,
                  1.2e3 * np.linalg.norm(with_rigid[t > DURATION] - goal, axis=1).max())
    axes.legend()
    figure.savefig(sys.argv[1], dpi=130)
