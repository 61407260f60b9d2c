"""
Print by how much chosen laws of friction predict recordings of real arms better.

Each recording is fitted on one half and judged on the other, both ways, once with
Coulomb friction alone and once with the laws that identification chooses. The ratio of
the RMS torque errors is printed for each joint, all rows and rows in motion, with the
geometric mean of both ways.

    python benchmarks/friction_laws.py arm.urdf recording.csv [arm2.urdf arm2.csv ...]
"""

from dataclasses import replace
import sys
import warnings

from kane_dynamics import load_urdf, ModelWarning
from kane_dynamics.identification import identify, read_recording
import numpy as np


def exchanged(recording):
    """Return the recording with its halves exchanged."""
    middle = len(recording) // 2
    step = float(np.median(np.diff(recording.t)))
    t = recording.t
    columns = {}
    for name in ('q', 'u', 'udot', 'tau'):
        values = getattr(recording, name)
        columns[name] = np.concatenate([values[middle:], values[:middle]])
    times = np.concatenate(
        [t[middle:] - t[middle], t[:middle] - t[0] + t[-1] - t[middle] + step])
    return replace(recording, t=times, **columns)


def compare(urdf, path, joints):
    """Print the ratios of one recording; return their geometric mean."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', ModelWarning)
        names = load_urdf(urdf).joint_names
        model = load_urdf(urdf, joints=names[:joints or len(names)])
    recording = read_recording(path, model.joint_names)
    ratios = []
    for split in (recording, exchanged(recording)):
        plain = identify(model, split, friction='coulomb', diagnosed=True)
        chosen = identify(model, split, diagnosed=True)
        ratios.append((chosen.held_out / plain.held_out,
                       chosen.held_out_moving / plain.held_out_moving))
        print(f'{path}: {chosen.law}; weight of the prior {chosen.weight:g}')
        print(f'  held out, N m: {plain.held_out.round(4)} with Coulomb friction, '
              f'{chosen.held_out.round(4)} with these laws')
    every, moving = np.exp(np.log(ratios).mean(axis=0))
    print(f'  ratio: {every.round(3)}, in motion {moving.round(3)}; of all joints '
          f'{np.exp(np.log(every).mean()):.4f}, in motion '
          f'{np.exp(np.log(moving).mean()):.4f}')


if __name__ == '__main__':
    if len(sys.argv) < 3 or len(sys.argv) % 2 == 0:
        sys.exit(__doc__)
    for urdf, path in zip(sys.argv[1::2], sys.argv[2::2]):
        with open(path) as stream:
            header = stream.readline().strip().split(',')
        compare(urdf, path,
                sum(name.startswith('tau') and name[3:].isdigit() for name in header))
