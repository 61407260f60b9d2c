"""A four-bar linkage with a flexible coupler: torque two ways, free motion."""

import sys

from kane_dynamics import Closure, FlexibleLink, ModelBuilder, Robot, rod, simulate
import numpy as np


def flexible_four_bar():
    """Return the linkage; its light coupler bends in the plane of the motion."""
    b = ModelBuilder('flexible four-bar')
    b.body('crank', 'world', axis=(0, -1, 0), inertial=rod(0.6, (0, 0, 0), (0.3, 0, 0)))
    b.beam('coupler', 'crank',
           FlexibleLink(length=0.9, density=1.0, stiffness=30.0, modes=(2, 0),
                        up=(0, 0, 1), damping=1e-3), axis=(0, -1, 0), at=(0.3, 0, 0))
    b.body('rocker', 'coupler/tip', axis=(0, -1, 0),
           inertial=rod(1.4, (0, 0, 0), (0.7, 0, 0)))
    b.frame('end', 'rocker', at=(0.7, 0, 0))
    b.frame('ground', 'world', at=(1, 0, 0))
    pin = Closure('end', 'ground', 'revolute', axis=(0, 1, 0))
    return Robot(b.model(), constraints=[pin],
                 independent=['crank', 'coupler/mode_1', 'coupler/mode_2'])


if __name__ == '__main__':
    linkage = flexible_four_bar()
    crank = ['crank', 'coupler/mode_1', 'coupler/mode_2']
    q = linkage.closed_configuration((0.8, 0, 0, 0, -1.5), fixed=crank)
    u = np.array([5.0, 0.2, -0.1])
    udot = np.array([2.0, -1.0, 3.0])
    tau = linkage.inverse_dynamics(q, u, udot)
    print(f'crank torque {tau[0]:.6f} N m; the definition of the equations '
          f'differs by {linkage.verify():.1e}')
    run = simulate(linkage, q, np.array([10.0, 0, 0]), 1.0, step=1e-4, sample=0.02)
    print(f'1 s of free motion: first mode up to {np.abs(run.q[:, 2]).max():.4f}, '
          f'loop closed to {run.drift:.1e} m')
    if len(sys.argv) > 1:  # where to draw the picture
        from kane_dynamics.plot import plot_bending
        plot_bending(linkage.model, run.q[:25:4], run.t[:25:4], sys.argv[1],
                     title='A four-bar whose coupler bends')
