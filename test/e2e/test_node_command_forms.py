"""Each form of commands over DDS: a motion, a time-out, and the guard."""

import signal

from kane_dynamics import load_urdf, Robot
from node_process import JOINTS, NAME, URDF, wait_until
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

N = len(JOINTS)
STIFFNESS, DAMPING = 300.0, 20.0  # N m/rad or N/m, N m s/rad or N s/m
LIMIT = [60.0, 55.0, 80.0]  # N m or N, below those of the URDF
RATE = 500.0  # N m/s
GOAL = np.array([0.3, 0.25, 0.05])
FORMS = {'effort': {'mode': 'computed_torque'},
         'mit': {'commands__form': 'mit', 'commands__stiffness': STIFFNESS,
                 'commands__damping': DAMPING},
         'position_offset': {'commands__form': 'position_offset',
                             'commands__stiffness': STIFFNESS}}
SCALE = [0.5, -2.0, 1.0]
# A guard that acts in each stall of a busy machine ends the motion again and again.
pytestmark = pytest.mark.slow


class Arm:
    """Plant, node and guard with one form of commands, and what is seen of them."""

    def __init__(self, form, start, client):
        self.form = form
        self.client = client
        drives = dict(FORMS[form])
        mode = drives.pop('mode', 'inverse_dynamics')
        drives['efforts__scale'] = SCALE
        damping = {} if form == 'effort' else {'commands__damping': DAMPING}
        self.states = []
        client.create_subscription(
            JointState, 'joint_states',
            lambda m: self.states.append(np.array(m.position)), 10)
        self.of_guard = []
        client.create_subscription(
            JointState, '/torque_guard/joint_torques',
            lambda m: self.of_guard.append(np.array(m.effort)), 10)
        self.motions = client.create_publisher(JointTrajectory,
                                               f'{NAME}/joint_trajectory', 1)
        urdf = {'robot_description': f"'{URDF}'"}
        self.plant = start(module='kane_dynamics.ros.plant.main', **urdf, rate=250.0,
                           command_timeout=100.0, after_timeout='hold',
                           **(drives | damping))
        self.node = start(real_states=True, mode=mode, guard__enabled='true',
                          limits__effort=LIMIT, limits__rate=RATE, state_timeout=0.5,
                          gains__kp=100.0, gains__kd=20.0, **drives)
        self.guard = start(module='kane_dynamics.ros.guard.main')
        self.guard.wait_for('watching kane_dynamics', 120.0)
        self.node.wait_for('active, mode', 120.0)
        assert wait_until(lambda: len(client.commands) > 50 and self.states,
                          60.0), self.node.log
        assert wait_until(lambda: self.motions.get_subscription_count() > 0, 30.0)

    def move(self):
        """Move the arm to the goal."""
        message = JointTrajectory(joint_names=list(JOINTS))
        point = JointTrajectoryPoint(positions=GOAL.tolist(), velocities=[0.0] * N,
                                     accelerations=[0.0] * N)
        point.time_from_start.sec = 2
        message.points.append(point)
        # A stall of the machine lets the guard act, which ends the motion.
        for _ in range(5):
            self.motions.publish(message)
            if wait_until(self._rests_at_goal, 10.0):
                return
        raise AssertionError((self.at, self.node.log))

    def _rests_at_goal(self):
        recent = np.array(self.states[-200:])
        return (np.abs(recent - GOAL).max() < 0.03
                and np.ptp(recent, axis=0).max() < 2e-3)

    @property
    def at(self):
        """Return the last measured positions."""
        return self.states[-1]

    def command(self):
        """Return the rows of the last command."""
        numbers = np.array(self.client.commands[-1])
        return numbers.reshape(-1, N)


@pytest.mark.timeout(500)
@pytest.mark.parametrize('form', FORMS)
def test_a_form_moves_the_arm_within_limits_and_passes_to_the_guard(form, start, client):
    arm = Arm(form, start, client)
    arm.move()
    # The torques of the drives keep the limits of the node.
    torques = np.array(list(client.torques.values()))
    stamps = np.array(list(client.torques))
    assert (np.abs(torques) <= np.array(LIMIT) * (1.0 + 1e-9)).all()
    steps = np.abs(np.diff(torques, axis=0)) / np.diff(stamps)[:, None] * 1e9
    commanding = torques.any(axis=1)
    both = commanding[1:] & commanding[:-1]
    assert np.quantile(steps[both], 0.99) <= RATE * 2.1  # two periods at most

    # The node dies: the guard holds the weight in the same form.
    held = arm.at.copy()
    count = len(client.commands)
    arm.node.end(signal.SIGKILL)
    assert wait_until(lambda: len(arm.of_guard) > 100
                      and len(client.commands) > count + 100, 20.0), arm.guard.log
    weight = Robot(load_urdf(URDF)).gravity_force(arm.at)
    np.testing.assert_allclose(arm.of_guard[-1], weight, atol=0.5)
    rows = arm.command()
    if form == 'effort':
        np.testing.assert_allclose(rows[0] * SCALE, arm.of_guard[-1], atol=0.5)
    elif form == 'position_offset':
        np.testing.assert_allclose((rows[0] - arm.at) * STIFFNESS, weight, atol=2.0)
    else:
        q_d, _, stiffness, _, effort = rows
        np.testing.assert_allclose(q_d, arm.at, atol=0.01)
        assert not stiffness.any()
        np.testing.assert_allclose(effort * SCALE, weight, atol=0.5)
    assert np.abs(arm.at - held).max() < 0.1  # the joints have friction and damping


@pytest.mark.timeout(500)
@pytest.mark.parametrize('form', FORMS)
def test_without_states_a_form_commands_what_zero_torque_means(form, start, client):
    arm = Arm(form, start, client)
    arm.move()
    arm.guard.end()
    assert client.call(SetBool, '/plant_node/pause', 60.0, data=True).success
    assert wait_until(lambda: 'none for' in arm.node.log, 20.0), arm.node.log

    weight = Robot(load_urdf(URDF)).gravity_force(arm.at)

    def zero():
        rows = arm.command()
        if form == 'effort':
            return not rows.any()
        if form == 'position_offset':  # the servos keep the goal by which they hold
            offset = STIFFNESS * (rows[0] - arm.at)
            return np.allclose(offset, weight, atol=2.0)
        _, velocity, stiffness, damping, effort = rows
        return not (velocity.any() or stiffness.any() or effort.any()) and np.allclose(
            damping * np.abs(SCALE), DAMPING)
    assert wait_until(zero, 10.0), (arm.command(), arm.at, arm.node.log)
