"""A flexible mast on a sleigh with a knife edge: torque two ways, vibrations."""

import sys

from kane_dynamics import (ball, FlexibleLink, knife_edge, ModelBuilder,
                           natural_vibration, point_mass, Robot, simulate)
import numpy as np


def mast_on_a_sleigh():
    """Return the sleigh; a spring holds the mast upright, a load is at its top."""
    b = ModelBuilder('sleigh with a mast')
    b.body('sleigh', 'world', 'planar', inertial=ball(3.0, 0.4, at=(0.3, 0, 0)))
    b.beam('mast', 'sleigh',
           FlexibleLink(length=1.0, density=0.5, stiffness=30.0, modes=(1, 1),
                        direction=(0, 0, 1), up=(1, 0, 0)),
           axis=(0, 1, 0), stiffness=50.0)
    b.load('mast/tip', point_mass(0.3))
    return Robot(
        b.model(), constraints=[knife_edge('sleigh', (0, 1, 0), name='blade')],
        independent=['sleigh/x', 'sleigh/rz', 'mast', 'mast/mode_1', 'mast/mode_2'])


if __name__ == '__main__':
    sleigh = mast_on_a_sleigh()
    rng = np.random.default_rng(0)
    q = rng.uniform(-1.0, 1.0, 6) * [1, 1, 1, 0.3, 0.02, 0.02]
    u, udot = rng.uniform(-1.0, 1.0, (2, 5)) * [1, 1, 1, 0.1, 0.1]
    tau = sleigh.inverse_dynamics(q, u, udot)
    print(f'force along the blade {tau[0]:.6f} N; the definition of the equations '
          f'differs by {sleigh.verify():.1e}')
    run = simulate(sleigh, np.zeros(6), np.array([2.0, 1.5, 0, 0, 0]), 2.0, step=2e-4,
                   sample=0.02)
    total = run.energy.sum(axis=1)
    print(
        f'2 s of gliding: the mast leans by up to {np.abs(run.q[:, 3]).max():.4f} rad, '
        f'energy drift {np.abs(total - total[0]).max():.1e} J')
    free = Robot(sleigh.model)
    held = ['sleigh/x', 'sleigh/y', 'sleigh/rz']
    hertz = natural_vibration(free, np.zeros(6), held).frequencies / (2.0 * np.pi)
    print('natural frequencies on a fixed sleigh:', hertz.round(4).tolist(), 'Hz')
    if len(sys.argv) > 1:  # where to draw the picture
        from kane_dynamics.plot import plot_vibrations
        plot_vibrations(free, np.zeros(6), sys.argv[1],
                        held=held, title='A mast that bends')
