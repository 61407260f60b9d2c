"""A collision of an arm in MuJoCo is detected in time and named; no false alarm."""


import numpy as np
import pytest

pytest.importorskip('rclpy')
pytest.importorskip('mujoco')

from kane_dynamics import load_urdf, Robot  # noqa: E402, I100
from kane_dynamics.control.collision_detection import CollisionDetector  # noqa: E402
from kane_dynamics.control.momentum_observer import MomentumObserver  # noqa: E402
from kane_dynamics.demo.demo_settings import FR3, RATE  # noqa: E402
from kane_dynamics.demo.mujoco_plant import MujocoArm  # noqa: E402
import mujoco  # noqa: E402

# Every joint swings by itself, without a common period, at up to nine tenths of its
# speed limit.
AMPLITUDE = np.array([1.2, 0.6, 0.9, 0.7, 0.9, 0.9, 0.9])  # rad
OMEGA = np.array([1.9, 3.1, 2.3, 3.3, 4.9, 4.1, 4.7])  # rad/s
NOISE = np.array([1e-5, 5e-4])  # of positions, rad, and speeds, rad/s: of good encoders
# What the encoders' noise and the steps leave of a perfect model stays below half of
# these, N m.
THRESHOLD = np.array([0.6, 0.8, 0.6, 0.6, 0.1, 0.1, 0.05])
ROBOT = Robot(load_urdf(FR3.urdf, joints=list(FR3.joints)))


def wave(t):
    """Return the desired state; it swells from rest in a second."""
    swell = min(t, 1.0)
    return (FR3.home + AMPLITUDE * swell * np.sin(OMEGA * t), AMPLITUDE
            * (OMEGA * swell * np.cos(OMEGA * t) + (t < 1.0) * np.sin(OMEGA * t)),
            AMPLITUDE * (2.0 * (t < 1.0) * OMEGA * np.cos(OMEGA * t)
                         - OMEGA**2 * swell * np.sin(OMEGA * t)))


class Rig:
    """The demo's arm under feedforward and a servo, watched by observer and detector."""

    def __init__(self):
        self.arm = MujocoArm(FR3)
        self.observer = MomentumObserver(ROBOT, gain=50.0, held=True)
        self.detector = CollisionDetector(FR3.joints, THRESHOLD)
        self.chance = np.random.default_rng(0)
        self.ticks = 0
        self.fastest = np.zeros(7)
        self.largest = np.zeros(7)

    def push(self, link, force):
        """Apply a force, N in world axes, at a link's center of mass; return torques."""
        arm = self.arm
        body = self.arm.model.body(link).id
        arm.data.xfrc_applied[:] = 0.0
        arm.data.xfrc_applied[body, :3] = force
        jacobian = np.zeros((3, arm.model.nv))
        mujoco.mj_jacBodyCom(arm.model, arm.data, jacobian, None, body)
        return jacobian[:, arm._u].T @ np.array(force)

    def tick(self):
        """Advance by one period; return whether the flag has changed."""
        t = self.ticks / RATE
        self.ticks += 1
        q, u = self.arm.state
        self.fastest = np.maximum(self.fastest, np.abs(u))
        q += NOISE[0] * self.chance.normal(size=7)
        u += NOISE[1] * self.chance.normal(size=7)
        q_d, u_d, udot_d = wave(t)
        tau = ROBOT.inverse_dynamics(
            q_d, u_d, udot_d) + FR3.kp * (q_d - q) + FR3.kd * (u_d - u)
        changed = self.detector.update(t, self.observer.update(t, q, u, tau))
        self.largest = np.maximum(self.largest, np.abs(self.observer.torque))
        self.arm.step(tau)
        return changed


def require_no_alarm(seconds):
    rig = Rig()
    for _ in range(round(seconds * RATE)):
        rig.tick()
        assert not rig.detector.collision, (rig.ticks / RATE, rig.detector.joint)
    return rig


def test_fast_motion_raises_no_alarm():
    rig = require_no_alarm(20.0)
    assert (rig.fastest > 0.7 * ROBOT.limits.velocity).sum() >= 4, 'the motion is fast'
    assert (rig.largest < 0.5 * THRESHOLD).all(), rig.largest


@pytest.mark.slow
def test_five_minutes_of_fast_motion_raise_no_alarm():
    require_no_alarm(300.0)


@pytest.mark.parametrize('start', [1.5, 3.0, 4.7])
@pytest.mark.parametrize(('link', 'force'), [
    ('fr3_link7', (0.0, 0.0, -5.0)), ('fr3_link7', (0.0, 5.0, 0.0)),
    ('fr3_link5', (5.0, 0.0, 0.0)), ('fr3_link4', (0.0, 5.0, 0.0))])
def test_a_push_of_five_newtons_is_found_within_50_ms_and_the_joint_named(
        link, force, start):
    rig = Rig()
    for _ in range(round(start * RATE)):
        rig.tick()
    torque = rig.push(link, force)
    assert any(rig.tick() for _ in range(25)), 'found within 50 ms'
    assert rig.detector.collision
    share = np.abs(torque) / THRESHOLD
    assert share[FR3.joints.index(rig.detector.joint)] > 0.9 * share.max()
    touched = int(link[-1])
    assert set(rig.detector.beyond) <= set(
        FR3.joints[:touched]), 'no joint beyond that link'
    rig.push(link, (0.0, 0.0, 0.0))
    assert any(rig.tick() for _ in range(175)), 'and its end is found too'
    assert not rig.detector.collision
