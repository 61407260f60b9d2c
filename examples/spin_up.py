"""A beam is spun up: it lags, stiffens and returns; else it diverges."""

import sys
import warnings

from kane_dynamics import (FlexibleLink, ModelBuilder, ModelWarning, Prescribed, Robot,
                           simulate)
import numpy as np

# rad/s reached after so many s (Kane, Ryan & Banerjee, 1987)
final = 6.0
duration = 15.0


def turn(t):
    """Return the angle of the hub, rad."""
    w = 2.0 * np.pi / duration
    return final / duration * (0.5 * t * t + (np.cos(w * t) - 1.0) / w**2)


def spun(foreshortening, until):
    """Return the simulation and the deflection of the tip, m."""
    b = ModelBuilder('spin-up', gravity=(0, 0, 0))
    b.beam('beam', 'world',
           FlexibleLink(length=10.0, density=1.2, stiffness=14000.0, modes=(3, 0),
                        foreshortening=foreshortening))
    robot = Robot(b.model(), constraints=[Prescribed('beam', turn, name='hub')])
    run = simulate(robot, np.zeros(4), np.zeros(3), until, sample=0.05)
    root, tip = (np.array([robot.frame_pose(name, q) for q in run.q])
                 for name in ('beam', 'beam/tip'))
    beside = np.einsum('tk,tk->t', root[:, :3, 1], (tip - root)[:, :3, 3])
    return run, beside


run, beside = spun(True, duration)
with warnings.catch_warnings():
    # It bends by more than a tenth of its length.
    warnings.simplefilter('ignore', ModelWarning)
    without, astray = spun(False, 12.0)
lag = int(np.argmin(beside))
print(f'lags by up to {-beside[lag]:.3f} m at {run.t[lag]:.1f} s, ends at '
      f'{beside[-1]:+.4f} m')
print(f'torque of the hub up to {np.abs(run.constraint_forces).max():.1f} N m')
print(f'without foreshortening the deflection is {np.abs(astray).max():.0f} m at 12 s')

if len(sys.argv) > 1:  # where to draw the picture
    from matplotlib import pyplot as plt
    figure, axes = plt.subplots(figsize=(7, 4), layout='constrained')
    axes.plot(run.t, beside, label='with foreshortening')
    axes.plot(without.t, astray, '--', label='without')
    axes.set(xlabel='time [s]', ylabel='deflection of the tip [m]', ylim=(-1.5, 1.5),
             title='A 10 m beam brought to 6 rad/s')
    axes.legend()
    figure.savefig(sys.argv[1], dpi=110)
