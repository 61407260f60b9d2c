"""
Leader and follower over DDS: two nodes, two simulated arms, four processes.

That no torque jumps is tested in test/unit/ros/test_ros_arm_coupling.py: here a busy machine
delays states and commands of arms that move in real time.
"""

import os
import re
import signal

from geometry_msgs.msg import WrenchStamped
from kane_dynamics._util.resources import resource_path
from node_process import DEEP, Process, wait_until
import numpy as np
import pytest
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from sensor_msgs.msg import JointState

PLANT = 'kane_dynamics.ros.plant.main'
URDF = resource_path('urdf', 'two_link.urdf')
START = {'leader': [0.4, -0.9], 'follower': [0.1, -0.6]}
pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]


class Side:
    """One arm: its simulation, its node, and what both publish."""

    def __init__(self, client, name, partner):
        namespace = ['-r', f'__ns:=/{name}']
        common = {'urdf': URDF, 'joints': '[joint1,joint2]'}
        self.plant = Process(*namespace, module=PLANT, rate=200, wrench__frames='[tip]',
                             wrench__timeout=0.3, initial__position=START[name],
                             command_timeout=2.0, **common)
        self.node = Process(*namespace, mode='arm_coupling', state_timeout=2.0,
                            coupling__partner=f'/{partner}/kane_dynamics/coupling_state',
                            coupling__stiffness=20.0, coupling__damping='[8.0,0.8]',
                            coupling__observer_gain=20.0, coupling__reflection=0.5,
                            coupling__timeout=0.4, coupling__align_speed=1.0,
                            blend_time=0.1, **common)
        self.client, self.states, self.torques = client, [], []
        self.push = client.create_publisher(WrenchStamped, f'/{name}/plant/wrench', 1)
        self.parameters = AsyncParameterClient(client, f'/{name}/kane_dynamics')
        client.create_subscription(JointState, f'/{name}/joint_states', self.states.append, DEEP)
        client.create_subscription(JointState, f'/{name}/kane_dynamics/joint_torques',
                                   self.torques.append, DEEP)

    @property
    def q(self):
        return np.array(self.states[-1].position)

    @property
    def engaged(self):
        """Return whether the node logged last that it is coupled."""
        reports = re.findall('coupled: the arm follows|coupling: alone', self.node.log)
        return bool(reports) and reports[-1].startswith('coupled')

    def set(self, engaged):  # noqa: A003
        assert self.parameters.wait_for_services(20.0)
        future = self.parameters.set_parameters([Parameter('coupling.engaged', value=engaged)])
        assert wait_until(future.done, 20.0), self.node.log
        assert future.result().results[0].successful

    def lead(self, force):
        message = WrenchStamped()
        message.header.frame_id = 'tip'
        message.wrench.force.x, message.wrench.force.z = force
        self.push.publish(message)


def wait(seconds):
    wait_until(lambda: False, seconds)


def test_a_follower_goes_where_the_leader_is_led_and_a_lost_side_is_harmless(participant):
    leader = Side(participant, 'leader', 'follower')
    follower = Side(participant, 'follower', 'leader')
    sides = leader, follower
    try:
        for side in sides:
            side.node.wait_for('active, mode', 150.0)
            assert wait_until(lambda side=side: len(side.torques) > 50, 60.0), side.node.log
        for side, start in zip(sides, START.values()):
            np.testing.assert_allclose(side.q, start, atol=2e-3)  # each holds its position
        for side in sides:
            side.set(True)
        assert wait_until(lambda: all(side.engaged for side in sides), 20.0), leader.node.log

        # They come together. A hand leads the leader; the follower has no other command.
        assert wait_until(lambda: np.abs(leader.q - follower.q).max() < 0.02, 40.0)
        met = follower.q
        for _ in range(60):
            leader.lead((4.0, 2.0))
            wait(0.02)
        moved = np.abs(follower.q - met).max()
        assert moved > 0.1, (met, follower.q)
        assert wait_until(lambda: np.abs(leader.q - follower.q).max() < 0.05, 20.0)

        # The leader's node hangs: the follower comes to rest and holds.
        os.kill(leader.node.pid, signal.SIGSTOP)
        try:
            follower.node.wait_for('coupling: alone, partner: no state for 0.4', 20.0)
            wait(2.5)
            rest = follower.q
            wait(0.5)
            np.testing.assert_allclose(follower.q, rest, atol=5e-3)
        finally:
            os.kill(leader.node.pid, signal.SIGCONT)
        assert wait_until(lambda: not leader.engaged, 20.0), leader.node.log
        # They engage again only on request.
        wait(0.5)
        assert not follower.engaged
        for side in sides:
            side.set(False)
            side.set(True)
        assert wait_until(lambda: all(side.engaged for side in sides), 20.0), leader.node.log
    finally:
        for side in sides:
            for process in (side.node, side.plant):
                assert process.end(timeout=30.0)[0] == 0
                assert 'Traceback' not in process.log
