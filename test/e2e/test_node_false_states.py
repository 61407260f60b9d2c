"""The node on a simulated arm over DDS: false joint states between true ones."""

import math
import time

from kane_dynamics import load_urdf, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.demo.demo_settings import FR3
from kane_dynamics.loop_tracking.loop_error import CONTRADICTION
from kane_dynamics.ros.common.stamped_numbers import FUTURE, NOT_FINITE, OUT_OF_ORDER
from kane_dynamics.ros.torque_path.drop_reasons import JUMP, OUTSIDE, STALE, TOO_FAST
from node_process import BEST_EFFORT, Process, wait_until
import numpy as np
from palletizer import DRIVEN, LOOPS, palletizer, URDF
import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool

PLANT = 'kane_dynamics.ros.plant.main'
TWO_LINK = resource_path('urdf', 'two_link.urdf')
MOST = 2e-3  # rad
GAINS = {'mode': 'computed_torque', 'gains__kp': 100.0, 'gains__kd': 20.0}


class Arm:
    """An arm that the node commands, with false states between those of its plant."""

    def __init__(self, client, start, measured, plant, **parameters):
        self.client = client
        self.joints = measured
        self.states = []
        self.plant = plant
        self.node = start(real_states=True, diagnostics_rate=20.0, state_timeout=0.5,
                          **GAINS, **parameters)
        client.joints = measured
        self.false = client.create_publisher(JointState, 'joint_states', BEST_EFFORT)
        self._listening = client.create_subscription(
            JointState, 'joint_states', self._on_state,
            QoSProfile(depth=200, reliability=ReliabilityPolicy.BEST_EFFORT))

    def _on_state(self, message):
        if not message.header.frame_id:  # not a false one
            self.names = list(message.name)
            self.states.append((time.monotonic(), np.array(message.position),
                                np.array(message.velocity)))

    def close(self):
        self.client.destroy_publisher(self.false)
        self.client.destroy_subscription(self._listening)
        self.plant.end()

    def wait(self):
        self.node.wait_for('active, mode', 120.0)
        assert wait_until(lambda: self.states and self.client.commands
                          and self.client.motions.get_subscription_count(), 60.0)
        assert wait_until(lambda: any(self.client.commands[-1]), 10.0)
        time.sleep(0.5)
        # No fault: the native path learns the layout of this publisher.
        self.publish(self.joints[0])
        time.sleep(0.2)

    def drops(self, reason):
        """Return how many states the diagnostics count for a reason."""
        count = len(self.client.diagnostics)
        assert wait_until(lambda: len(self.client.diagnostics) > count + 2)
        values = [x for _, _, x in self.client.diagnostics if 'states dropped' in x]
        return int(values[-1].get(f'states dropped: {reason}', 0))

    def place(self):
        return self.states[-1][1]

    def publish(self, joint, by=0.0, speed=0.0, age=0.0, factor=1.0):
        """Publish the last state with a fault."""
        _, q, u = self.states[-1]
        message = JointState(name=self.names, position=(factor * q).tolist(),
                             velocity=u.tolist())
        k = self.names.index(joint)
        message.position[k] += by
        message.velocity[k] += speed
        message.header.frame_id = 'false'
        stamp = time.time_ns() - round(age * 1e9)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        self.false.publish(message)

    def check_refused(self, reason, **fault):
        """
        Publish a false state; its reason is counted, once for each that arrives.

        It is published again after 4 s: on a busy machine a state may be lost (best
        effort).
        """
        count_before = self.drops(reason)
        published = 0
        while self.drops(reason) == count_before and published < 3:
            self.publish(**fault)
            published += 1
            wait_until(lambda: self.drops(reason) > count_before, 4.0)
        counted = self.drops(reason) - count_before
        assert 1 <= counted <= published, (reason, fault, counted, self.node.log[-2000:])

    def check_each(self, faults):
        """Publish each false state; the arm stays, and the reason is counted."""
        for reason, fault in faults:
            held = self.place()
            count = len(self.states)
            self.check_refused(reason, **fault)
            moved = np.abs([q - held for _, q, _ in self.states[count:]]).max()
            assert moved < MOST, (reason, fault, moved)


@pytest.fixture
def two_link(client, start):
    joints = load_urdf(TWO_LINK).joint_names
    plant = Process(module=PLANT, urdf=TWO_LINK, initial__position=[0.3, -0.4],
                    after_timeout='hold')
    arm = Arm(client, start, joints, plant, urdf=TWO_LINK)
    yield arm
    arm.close()


def rests(arm):
    place_before = arm.place()
    time.sleep(0.1)
    return np.abs(arm.place() - place_before).max() < 1e-6


def test_the_arm_moves_neither_by_false_states_nor_by_impossible_motions(two_link):
    arm = two_link
    arm.wait()
    first, second = arm.joints
    arm.check_each([(JUMP, {'joint': first, 'by': 1.0}),
                    (TOO_FAST, {'joint': second, 'speed': 500.0}),
                    (OUTSIDE, {'joint': second, 'by': 40.0}),
                    (OUTSIDE, {'joint': first, 'factor': 57.3}),
                    (NOT_FINITE, {'joint': first, 'by': math.nan}),
                    (STALE, {'joint': first, 'by': 0.5, 'age': 1.0}),
                    (FUTURE, {'joint': first, 'by': 0.5, 'age': -1.0}),
                    (OUT_OF_ORDER, {'joint': first, 'by': 0.5, 'age': 0.1})])
    q = arm.place()
    for points, reason in (([(0.0, q), (2.0, q + 40.0)], 'if these are degrees'),
                           ([(0.0, q + 0.5), (2.0, q)], 'the motion sets out at'),
                           ([(0.0, q), (0.01, q + 0.3)], '1.2 times its limit')):
        count_before = arm.node.log.count('joint_trajectory rejected')
        arm.client.follow(points)
        assert wait_until(
            lambda n=count_before: arm.node.log.count('joint_trajectory rejected') > n)
        assert reason in arm.node.log.splitlines()[-1]
    assert np.abs(arm.place() - q).max() < MOST
    arm.client.follow([(0.0, q), (2.0, q + 0.2)])
    assert wait_until(lambda: np.abs(arm.place() - q).max() > 0.05, 5.0)
    arm.check_refused(JUMP, joint=first, by=1.0)
    jumps = arm.drops(JUMP)
    assert wait_until(lambda: np.abs(arm.place() - q - 0.2).max() < 5e-3, 5.0)
    # A moving arm would be stopped elsewhere.
    assert wait_until(lambda: rests(arm), 10.0)
    assert arm.drops(JUMP) == jumps
    # An encoder breaks, and stays broken.
    assert arm.client.adjust(state_check__action='hold').successful
    assert arm.client.call(SetBool, '/plant_node/pause', data=True).success
    held = Robot(load_urdf(TWO_LINK)).gravity_force(arm.place())
    end = time.monotonic() + 0.4
    while time.monotonic() < end:
        arm.publish(first, by=40.0)
        time.sleep(0.005)
    assert f'fault: {OUTSIDE} for 0.0' in arm.node.log
    assert ('stopping by the model and holding until states are valid again'
            in arm.node.log)
    np.testing.assert_allclose(arm.client.commands[-1], held, atol=1e-3)
    assert any('joint states impossible' in words
               for _, words, _ in arm.client.diagnostics)


def test_no_false_state_of_a_palletizer_moves_it(client, start):
    plant = Process(module=PLANT, urdf=URDF, constraints=LOOPS, rate=250, substeps=4,
                    after_timeout='hold')
    arm = Arm(client, start, DRIVEN, plant, urdf=URDF, constraints=LOOPS)
    try:
        palletizer().compile()
        arm.wait()
        arm.check_each([(JUMP, {'joint': 'shoulder', 'by': 1.2}),
                        (OUTSIDE, {'joint': 'shoulder', 'by': 2.0}),
                        (CONTRADICTION, {'joint': 'elbow', 'by': 0.05}),
                        (NOT_FINITE, {'joint': 'turn', 'by': math.nan}),
                        (STALE, {'joint': 'shoulder', 'by': 0.5, 'age': 1.0})])
    finally:
        arm.close()


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_no_false_state_moves_an_arm_of_mujoco(client, start, tmp_path):
    pytest.importorskip('mujoco')
    urdf = FR3.urdf
    plant = Process(program=['-m', 'kane_dynamics.demo.mujoco_plant',
                             str(tmp_path / 'record.npz')])
    joints = [name for name in load_urdf(urdf).joint_names if 'finger' not in name]
    arm = Arm(client, start, joints, plant, urdf=urdf, joints=f'[{",".join(joints)}]')
    try:
        arm.node.wait_for('active, mode', 120.0)
        # A reset would be a jump, which an active node refuses: the servo ends where it
        # holds.
        assert client.call(SetBool, '/plant/servo', data=False).success
        arm.wait()
        assert wait_until(lambda: rests(arm), 10.0)
        arm.check_each([
            (JUMP, {'joint': joints[1], 'by': 1.0}),
            (TOO_FAST, {'joint': joints[3], 'speed': 90.0}),
            (OUTSIDE, {'joint': joints[0], 'by': 40.0}),
            (NOT_FINITE, {'joint': joints[2], 'by': math.nan}),
            (STALE, {'joint': joints[1], 'by': 0.5, 'age': 1.0})])
    finally:
        arm.close()
