"""A loop like joint_trajectory_controller in MuJoCo, alone and with filled efforts."""

from functools import cache

from effort_controller import EffortLoop, Gains
from kane_dynamics import load_urdf, Robot
from kane_dynamics.control.trajectory_feedforward import fill_trajectory
from kane_dynamics.demo.demo_settings import DURATION, FR3, RATE
import numpy as np
import pytest

pytest.importorskip('mujoco')

from kane_dynamics.demo.mujoco_plant import MujocoArm  # noqa: E402, I100

PERIOD = 1.0 / RATE


@cache
def filled(tolerance):
    motion = FR3.motion()
    return fill_trajectory(Robot(load_urdf(FR3.urdf, joints=FR3.joints)), motion.times,
                           motion.positions, tolerance=tolerance)


@cache
def error(tolerance, feedforward, ahead):
    """Return the RMS error of all joints in the demo's motion, rad."""
    arm = MujocoArm(FR3)
    loop = EffortLoop(Gains(p=FR3.kp, d=FR3.kd), ahead)
    points = (filled(tolerance))
    loop.accept(0.0, FR3.home, points.times, points.positions, points.velocities,
                points.accelerations, points.efforts if feedforward else None)
    errors = []
    for now in np.arange(0.0, DURATION, PERIOD):
        q, u = arm.state
        errors.append(q - loop.desired(now))
        arm.step(loop.update(now, PERIOD, q, u))
    return float(np.sqrt(np.mean(np.square(errors))))


# The time at which versions sample the effort.
@pytest.mark.parametrize('ahead', [0.0, PERIOD])
@pytest.mark.parametrize(('tolerance', 'factor'), [(None, 300.0), (0.01, 600.0)])
def test_filled_efforts_divide_the_tracking_error_of_the_loop_alone(
        tolerance, factor, ahead):
    alone = error(None, False, 0.0)
    helped = error(tolerance, True, ahead)
    points = 'inserted points' if tolerance else 'the points of the motion'
    print(f'{points}, effort sampled {1e3 * ahead:.0f} ms ahead: the error is divided '
          f'by {alone / helped:.0f}')
    assert 0.02 < alone < 0.2
    assert helped < alone / factor, (alone, helped)
