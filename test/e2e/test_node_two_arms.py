"""Two arms of one URDF in one graph, told apart by namespace and by prefix."""

import time

from geometry_msgs.msg import Inertia
from kane_dynamics import load_urdf, Robot
from kane_dynamics.model.inertial import Inertial
from kane_dynamics_interfaces.srv import GetDynamics, SetPayload
from node_process import DEEP, JOINTS, Process, URDF, wait_until
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool

# One is heavier and stands elsewhere, so that no torque of one could pass for the
# other's.
MASSES = {'left': '2.0', 'right': '5.0'}
POSES = {'left': [0.3, -0.4, 0.2], 'right': [-0.5, 0.6, 0.1]}


def urdf(side):
    return URDF.replace('value="2.0"', f'value="{MASSES[side]}"')


class Side:
    """A client of one arm."""

    def __init__(self, client, side):
        self.robot = Robot(load_urdf(urdf(side)))
        self.names = ()
        self.commands = []
        self.torques = {}
        self.states = {}
        for topic, kind, callback in (
                ('commands', Float64MultiArray,
                 lambda m: self.commands.append(list(m.data))),
                ('kane_dynamics/joint_torques', JointState, self._on_torques),
                ('joint_states', JointState, self._on_state)):
            client.create_subscription(kind, f'/{side}/{topic}', callback, DEEP)

    def _on_torques(self, message):
        self.names = tuple(message.name)
        self.torques[message.header.stamp.sec,
                     message.header.stamp.nanosec] = message.effort

    def _on_state(self, message):
        self.states[message.header.stamp.sec,
                    message.header.stamp.nanosec] = message.position

    def right_answers(self):
        """Return how many answers there are, each of this arm at its own state."""
        # Copied at once: the other thread goes on receiving.
        torques = self.torques.copy()
        both = [(self.states[stamp], tau) for stamp, tau in torques.items()
                if stamp in self.states]
        for q, tau in both:
            np.testing.assert_allclose(tau, self.robot.gravity_force(np.array(q)),
                                       rtol=1e-9)
        return len(both)


@pytest.fixture(scope='module')
def arms(participant):
    running = []
    for side in MASSES:
        common = {'robot_description': f"'{urdf(side)}'", 'prefix': f'{side}_'}
        namespace = ('-r', f'__ns:=/{side}')
        running += [
            Process(*namespace, real_states=True,
                    mode='gravity_compensation', state_timeout=0.5,
                    payload__frame='c', **common),
            Process(*namespace, module='kane_dynamics.ros.plant.main', rate=200,
                    initial__position=POSES[side], after_timeout='hold', **common)]
    yield {side: Side(participant, side) for side in MASSES}
    for process in running:
        assert process.end()[0] == 0
        assert 'Traceback' not in process.log


def test_the_torques_of_two_arms_do_not_mix(arms, client):
    for side, arm in arms.items():
        # Either topic may be discovered seconds before the other.
        assert wait_until(lambda arm=arm: len(
            arm.torques.copy().keys() & arm.states.copy().keys()) > 100, 60.0)
        assert arm.right_answers() > 50
        assert arm.names == tuple(f'{side}_{joint}' for joint in JOINTS)
        # Held by its own torques and no others, an arm stays where it is.
        np.testing.assert_allclose(list(arm.states.values())[-1], POSES[side], atol=5e-3)
        answer = client.call(GetDynamics, f'/{side}/kane_dynamics/get_dynamics',
                             position=POSES[side])
        assert answer.joint_names == list(arm.names)
        np.testing.assert_allclose(answer.gravity_force,
                                   arm.robot.gravity_force(np.array(POSES[side])),
                                   rtol=1e-9)


def test_a_timeout_of_one_arm_does_not_affect_the_other(arms, client):
    left = arms['left']
    right = arms['right']
    assert wait_until(lambda: right.torques, 60.0)
    assert client.call(SetBool, '/right/plant_node/pause', data=True).success
    assert wait_until(lambda: not any(right.commands[-1]), 3.0)
    left.commands.clear()
    time.sleep(0.3)
    assert len(left.commands) > 20
    assert all(map(any, left.commands))
    assert not any(right.commands[-1])
    left.right_answers()
    assert client.call(SetBool, '/right/plant_node/pause', data=False).success
    assert wait_until(lambda: any(right.commands[-1]), 3.0)


def test_frames_in_messages_have_the_prefix(arms, client):
    side = 'right'
    arm = arms['right']
    assert wait_until(lambda: arm.torques, 60.0)
    load = Inertia(m=1.0)
    answer = client.call(SetPayload, f'/{side}/kane_dynamics/set_payload', frame='c',
                         payload=load)
    assert not answer.success
    assert "no frame 'c'; expected one of " in answer.message
    assert 'right_c' in answer.message
    assert client.call(SetPayload, f'/{side}/kane_dynamics/set_payload', frame='right_c',
                       payload=load).success
    heavy = Robot(load_urdf(urdf(side)), payload_frame='c')
    heavy.parameters.payload = Inertial(1.0, np.zeros(3), np.zeros((3, 3)))
    answer = client.call(GetDynamics, f'/{side}/kane_dynamics/get_dynamics',
                         position=POSES[side])
    np.testing.assert_allclose(answer.gravity_force,
                               heavy.gravity_force(np.array(POSES[side])), rtol=1e-9)
