"""The largest payload with which a Research 3 tracks a motion, known or unknown."""

import sys
from tempfile import TemporaryDirectory

from kane_dynamics import load_urdf, Motion
from kane_dynamics._util.resources import resource_path
from kane_dynamics.sweep import read_table, run_sweep, Sweep
import numpy as np

# kg; RMS tracking error, rad
heaviest = 8.0
allowed = 0.05
joints = [f'fr3_joint{k}' for k in range(1, 8)]
model = load_urdf(resource_path('urdf', 'fr3.urdf'), joints=joints)
limits = np.array([joint.limits.effort for joint in model.coordinate_joints])
poses = [[0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.7], [0.8, 0.3, 0.2, -1.4, 0.2, 2.0, 0.2]]
motion = Motion.from_points([0.0, 1.0], poses, np.zeros((2, 7)), np.zeros((2, 7)),
                            joint_names=joints)
masses = np.linspace(0.0, heaviest, 41)

sweep = Sweep(model, samples=4 * len(masses), motion=motion, payload={
    'frame': 'fr3_hand_tcp', 'mass': {'grid': masses.tolist()}, 'gyration': 0.03},
              controller={
                  'kind': 'computed_torque', 'kp': {'grid': [100.0, 400.0]}, 'kd': 30.0,
                  'known_payload': {'grid': [0.0, 1.0]}})
with TemporaryDirectory() as folder:
    run_sweep(sweep, folder, workers=1)
    table = {name: np.array(column)
             for name, column in read_table(folder).to_pydict().items()}
error = np.max([table[f'rms_error.{joint}'] for joint in joints], axis=0)
load = np.max(
    [table[f'peak_torque.{joint}'] / limit for joint, limit in zip(joints, limits)],
    axis=0)


def carried(known, kp):
    """Return the rows of one controller, and the largest mass it tracks in limits."""
    rows = (table['known_payload'] == known) & (table['kp'] == kp)
    good = (error[rows] <= allowed) & (load[rows] <= 1.0)
    first_bad = len(good) if good.all() else int(np.argmin(good))
    return rows, masses[first_bad - 1] if first_bad else 0.0


for known, kp, words in ((0.0, 100.0, 'ignored, kp 100'),
                         (0.0, 400.0, 'ignored, kp 400'),
                         (1.0, 100.0, 'known, kp 100')):
    rows, heaviest_carried = carried(known, kp)
    print(f'payload {words}: up to {heaviest_carried:.1f} kg; at 3 kg off by '
          f'{np.interp(3.0, masses, error[rows]):.4f} rad, torques at '
          f'{np.interp(3.0, masses, load[rows]):.0%} of their limits')

if len(sys.argv) > 1:  # where to draw the picture
    from matplotlib import pyplot as plt
    figure, (above, below) = plt.subplots(2, sharex=True, figsize=(7, 6),
                                          layout='constrained')
    for known, kp, style in ((0.0, 100.0, 'C0-'), (0.0, 400.0, 'C1-'),
                             (1.0, 100.0, 'C2--')):
        rows, heaviest_carried = carried(known, kp)
        name = f'{"known" if known else "ignored"}, kp {kp:.0f}'
        above.plot(masses, error[rows], style, label=name)
        below.plot(masses, 100.0 * load[rows], style, label=name)
        above.axvline(heaviest_carried, color=style[:2], linewidth=0.7)
    above.axhline(allowed, color='grey', linewidth=0.7)
    below.axhline(100.0, color='grey', linewidth=0.7)
    above.set(ylabel='worst RMS error [rad]', title='Payload that a Research 3 tracks')
    below.set(xlabel='payload [kg]', ylabel='worst peak torque [% of limit]')
    below.legend(title='payload', loc='lower right')
    figure.savefig(sys.argv[1], dpi=110)
