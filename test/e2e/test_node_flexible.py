"""An arm whose links bend, simulated by the plant; the node knows of its bending."""

import time

from kane_dynamics import (Controller, load_urdf, Motion, QuasiStatic, Robot, simulate,
                           stiffened)
from kane_dynamics._util.resources import resource_path
from node_process import DEEP, Process, wait_until
import numpy as np
from sensor_msgs.msg import JointState

URDF = resource_path('urdf', 'two_link.urdf')
JOINTS = ('joint1', 'joint2')
POINTS = ((0.0, (0.4, 0.3)), (1.6, (0.6, 0.1)))
REST = [(0.0, 0.0)] * 2
BENDING = resource_path('urdf', 'two_link.bending.yaml')
# Twice as stiff, a delay of two periods makes the bending arm oscillate.
GAINS = {'kp': 25.0, 'kd': 10.0}


def error_of_rigid_feedforward(motion):
    """Return the mean error of the joints, rad, of the arm led as if rigid."""
    model = load_urdf(URDF, supplement=BENDING)
    arm = Robot(model)
    controller = Controller(Robot(stiffened(model)), mode='computed_torque', **GAINS)
    q = np.array(POINTS[0][1])
    at_rest = np.zeros(2)
    run = simulate(arm, np.append(q, QuasiStatic(arm).modes(q, at_rest, at_rest)),
                   np.zeros(7), 1.6,
                   step=1e-3, sample=0.01, torque=lambda t, q, u: np.append(
                       controller.command(t, q[:2], u[:2], motion).tau, np.zeros(5)))
    return np.abs(run.q[:, :2] - [motion.sample(t)[0] for t in run.t]).mean()


def test_quasi_static_feedforward_is_better_than_rigid_feedforward(client, start):
    plant = Process(
        module='kane_dynamics.ros.plant.main', after_timeout='hold', urdf=URDF,
        rate=200, substeps=5, supplement=BENDING, initial__position=list(POINTS[0][1]))
    node = start(real_states=True, urdf=URDF, supplement=BENDING, mode='computed_torque',
                 gains__kp=GAINS['kp'], gains__kd=GAINS['kd'])
    states = []
    listening = client.create_subscription(
        JointState, 'joint_states', lambda m: states.append(
            (m.header.stamp.sec * 10**9 + m.header.stamp.nanosec, np.array(m.position))),
        DEEP)
    motion = Motion.from_points(*zip(*POINTS), REST, joint_names=JOINTS)
    try:
        plant.wait_for(
            '2 joints (joint1, joint2), flexible modes link1/mode_1, link1/mode_2, '
            'link2/mode_1, link2/mode_2, link2/twist_1, 200 joint states', 60.0)
        node.wait_for('active, mode', 60.0)
        # A motion that comes before the first joint state is refused.
        assert wait_until(lambda: client.motions.get_subscription_count() > 0 and states
                          and client.commands)
        assert len(states[0][1]) == 2  # modes are the plant's own business
        began = time.time_ns() + 300_000_000
        client.joints = JOINTS
        client.follow(POINTS, start=began, velocities=REST)
        assert wait_until(lambda: states[-1][0] > began + 16 * 10**8)
        assert plant.alive()
        assert 'stopped until' not in plant.log
        assert 'rejected' not in node.log
    finally:
        client.destroy_subscription(listening)
        plant.end()
    errors = []
    for stamp, q in states:
        if 0 <= stamp - began <= 16 * 10**8:
            errors.append(np.abs(q - motion.sample((stamp - began) * 1e-9)[0]))
    assert len(errors) > 100
    assert np.mean(errors) < 0.25 * error_of_rigid_feedforward(motion)
