"""
Leader and follower over DDS: two nodes, two simulated arms, four processes.

That no torque jumps is tested in test/unit/ros/test_ros_arm_coupling.py: here a busy
machine delays states and commands of arms that move in real time.
"""

import os
import re
import signal

from geometry_msgs.msg import WrenchStamped
from kane_dynamics import load_urdf, Robot
from kane_dynamics._util.resources import resource_path
from node_process import BEST_EFFORT, DEEP, Process, wait_until
import numpy as np
import pytest
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from sensor_msgs.msg import JointState

PLANT = 'kane_dynamics.ros.plant.main'
URDF = resource_path('urdf', 'two_link.urdf')
JOINTS = ['joint1', 'joint2']
CONSTANTS = np.array([6.0, 2.0])  # N m/A
RESOLUTION = 0.05  # A, of the measured currents
WALL = np.array([-4.0, 0.0, -6.0])  # N in the world, on the tip of the follower
# N/m and N s/m, of the hand on the tip of the leader: soft, as it is late.
HOLD = (40.0, 8.0)
TORQUE_ERROR = 0.5  # N m, of estimates with these currents; the wall has 3 to 6 N m
START = {'leader': [0.4, -0.9], 'follower': [0.1, -0.6]}
pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]


class Side:
    """
    One arm: its simulation, its node, and what both publish.

    An arm with currents has these as the efforts of its joint states.
    """

    def __init__(self, client, name, partner, with_currents=False):
        namespace = ['-r', f'__ns:=/{name}']
        common = {'urdf': URDF, 'joints': '[joint1,joint2]'}
        states = 'joint_states'
        renamed = []
        efforts = {'observer__torque': 'command'}
        if with_currents:
            states = 'measured'
            renamed = ['-r', 'joint_states:=measured']
            efforts = {'observer__torque': 'effort', 'efforts__kind': 'motor_current',
                       'efforts__constants': CONSTANTS.tolist()}
            # Of a busy client the latest state, not those that wait.
            driver = client.create_publisher(JointState, f'/{name}/joint_states',
                                             BEST_EFFORT)
            client.create_subscription(
                JointState, f'/{name}/measured',
                lambda message: driver.publish(in_currents(message)), BEST_EFFORT)
        self.plant = Process(*namespace, *renamed, module=PLANT, rate=200,
                             wrench__frames='[tip]', wrench__timeout=0.3,
                             initial__position=START[name], command_timeout=2.0,
                             **common)
        self.node = Process(*namespace, mode='arm_coupling', state_timeout=2.0,
                            coupling__partner=f'/{partner}/kane_dynamics/coupling_state',
                            coupling__stiffness=20.0, coupling__damping='[8.0,0.8]',
                            coupling__observer_gain=20.0, coupling__reflection=0.5,
                            coupling__timeout=0.4, coupling__align_speed=1.0,
                            blend_time=0.1, **efforts, **common)
        self.client = client
        self.states = []
        self.torques = []
        self.estimates = []
        self.push = client.create_publisher(WrenchStamped, f'/{name}/plant/wrench', 1)
        self.parameters = AsyncParameterClient(client, f'/{name}/kane_dynamics')
        client.create_subscription(JointState, f'/{name}/{states}', self.states.append,
                                   DEEP)
        client.create_subscription(JointState, f'/{name}/kane_dynamics/joint_torques',
                                   self.torques.append, DEEP)
        client.create_subscription(JointState, f'/{name}/kane_dynamics/coupling_state',
                                   self.estimates.append, DEEP)

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
        future = self.parameters.set_parameters(
            [Parameter('coupling.engaged', value=engaged)])
        assert wait_until(future.done, 20.0), self.node.log
        assert future.result().results[0].successful

    def lead(self, force):
        message = WrenchStamped()
        message.header.frame_id = 'tip'
        message.wrench.force.x, message.wrench.force.y, message.wrench.force.z = force
        self.push.publish(message)

    def press(self, robot, force):
        """Exert a force (3,) in world axes at the tip; return its joint torques."""
        self.lead((robot.frame_pose('tip', self.q)[:3, :3].T @ force).tolist())
        return robot.jacobian('tip', self.q)[:3].T @ force


def wait(seconds):
    wait_until(lambda: False, seconds)


def in_currents(message):
    """Return a joint state whose efforts are currents, A, in steps of the resolution."""
    currents = np.array(message.effort) / CONSTANTS
    message.effort = (RESOLUTION * np.round(currents / RESOLUTION)).tolist()
    return message


def press_together(leader, follower):
    """
    Hold the leader by hand while a wall presses the follower, until both are balanced.

    Return the torques of hand and wall, and both estimates of them.
    """
    robot = Robot(load_urdf(URDF, joints=JOINTS))
    stiffness, damping = HOLD
    held = robot.frame_pose('tip', leader.q)[:3, 3]
    balanced = 0
    for _ in range(750):
        q = leader.q
        u = np.array(leader.states[-1].velocity)
        stretch = held - robot.frame_pose('tip', q)[:3, 3]
        force = stiffness * stretch - damping * robot.frame_velocity('tip', q, u)[:3]
        of_hand = leader.press(robot, force)
        of_wall = follower.press(robot, WALL)
        wait(0.02)
        estimates = [np.array(side.estimates[-1].effort) for side in (leader, follower)]
        errors = np.array(
            [of_hand + of_wall, estimates[0] - of_hand, estimates[1] - of_wall])
        balanced = balanced + 1 if np.abs(errors).max() < TORQUE_ERROR else 0
        if balanced == 20:
            break
    return of_hand, of_wall, *estimates


@pytest.mark.parametrize('measured', ['commands', 'currents'])
def test_a_follower_goes_where_the_leader_is_led_and_a_lost_side_is_harmless(
        participant, measured):
    leader = Side(participant, 'leader', 'follower', measured == 'currents')
    follower = Side(participant, 'follower', 'leader', measured == 'currents')
    sides = leader, follower
    try:
        for side in sides:
            side.node.wait_for('active, mode', 150.0)
            assert wait_until(lambda side=side: len(side.torques) > 50,
                              60.0), side.node.log
        for side, start in zip(sides, START.values()):
            # Each holds its position.
            np.testing.assert_allclose(side.q, start, atol=2e-3)
        for side in sides:
            side.set(True)
        assert wait_until(lambda: all(side.engaged for side in sides),
                          20.0), leader.node.log

        # They come together. A hand leads the leader; the follower has no other command.
        assert wait_until(lambda: np.abs(leader.q - follower.q).max() < 0.02, 40.0)
        met = follower.q

        def has_followed():
            leader.lead((4.0, 0.0, 2.0))
            wait(0.02)
            return np.abs(follower.q - met).max() > 0.1
        assert wait_until(has_followed, 20.0), (met, follower.q)
        assert wait_until(lambda: np.abs(leader.q - follower.q).max() < 0.05, 20.0)

        # A wall presses the follower: both sides estimate it, and the hand holds it.
        of_hand, of_wall, at_leader, at_follower = press_together(leader, follower)
        print(f'\n{measured}: hand {of_hand}, estimate {at_leader}, wall {of_wall}, '
              f'estimate {at_follower} N m')
        assert np.abs(of_wall).max() > 4.0 * TORQUE_ERROR
        np.testing.assert_allclose(of_hand, -of_wall, atol=TORQUE_ERROR)
        np.testing.assert_allclose(at_leader, of_hand, atol=TORQUE_ERROR)
        np.testing.assert_allclose(at_follower, of_wall, atol=TORQUE_ERROR)

        # The leader's node hangs: the follower comes to rest and holds.
        os.kill(leader.node.pid, signal.SIGSTOP)
        try:
            follower.node.wait_for('coupling: alone, partner: no state for 0.4', 20.0)
            wait(2.5)
            resting_place = follower.q
            wait(0.5)
            np.testing.assert_allclose(follower.q, resting_place, atol=5e-3)
        finally:
            os.kill(leader.node.pid, signal.SIGCONT)
        assert wait_until(lambda: not leader.engaged, 20.0), leader.node.log
        # They engage again only on request.
        wait(0.5)
        assert not follower.engaged
        for side in sides:
            side.set(False)
            side.set(True)
        assert wait_until(lambda: all(side.engaged for side in sides),
                          20.0), leader.node.log
    finally:
        for side in sides:
            for process in (side.node, side.plant):
                assert process.end(timeout=30.0)[0] == 0
                assert 'Traceback' not in process.log
