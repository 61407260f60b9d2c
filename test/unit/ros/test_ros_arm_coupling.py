"""Two torque paths in mode arm_coupling, which receive each other's states."""

import math

from kane_dynamics._util.resources import resource_path
import numpy as np
import pytest

pytest.importorskip('rclpy')

from kane_dynamics.control.terms import Mode  # noqa: E402, I100
from kane_dynamics.errors import InputError  # noqa: E402
from kane_dynamics.ros.common.configuration_files import load_model  # noqa: E402
from kane_dynamics.ros.common.node_statistics import Statistics  # noqa: E402
from kane_dynamics.ros.modes.task_modes import TaskModes  # noqa: E402
from kane_dynamics.ros.monitors.coupling_topics import CouplingTopics  # noqa: E402
from kane_dynamics.ros.torque_path.path_controller import path_controller  # noqa: E402
from kane_dynamics.ros.torque_path.torque_path import TorquePath  # noqa: E402
from node_values import node_values  # noqa: E402
from rclpy.serialization import deserialize_message, serialize_message  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402

NANO = 10**9
STEP = 2_000_000  # ns
URDF = resource_path('urdf', 'two_link.urdf')
LEADER = np.array([0.4, -0.9])
FOLLOWER = np.array([0.1, -0.6])


class Side:
    """A simulated arm, its torque path, and the topics to its partner."""

    def __init__(self, start, **changes):
        self.values = node_values({
            'mode': 'arm_coupling', 'coupling.partner': 'partner',
            'limits.rate': math.inf, 'coupling.stiffness': 80.0, 'coupling.damping': 8.0,
            'coupling.align_speed': 1.0,
            **{key.replace('__', '.'): value for key, value in changes.items()}})
        model = load_model(URDF, self.values, lambda warning: None)
        self.controller = path_controller(model, self.values, self._laws)
        self.robot = self.controller.robot
        self.q, self.u, self.push = np.array(start), np.zeros(2), np.zeros(2)
        self.now = 100 * NANO
        self.sent = b''
        self.taus = []
        self.said = []
        self.refused = []
        self.mode = self.modes.laws[Mode.ARM_COUPLING]
        self.path = TorquePath(self.controller, self, self, lambda: self.now,
                               self.values,
                               Statistics(), lambda *words: self.refused.append(words))
        self.topics = CouplingTopics(self.robot, self.mode, self.values, Sent(self),
                                     self, lambda *words: self.refused.append(words))
        self.path.add_observer(self.topics, need_effort=True)
        self.path.add_observer(self, need_effort=False)
        self.path.start()

    def _laws(self, robot):
        self.modes = TaskModes(robot, self.values)
        return self.modes.laws

    start = stop = on_loads_changed = lambda self: None

    def on_cycle(self, cycle):
        self.taus.append(cycle.tau.copy())

    def publish(self, data):
        """Be the publisher of commands, which are read in `on_cycle`."""

    def info(self, words):
        self.said.append(words)

    warning = info

    def adjust(self, **changes):
        new = self.values | node_values({key.replace('__', '.'): value
                                         for key, value in changes.items()})
        new = self.values | {name: new[name] for name in
                             (key.replace('__', '.') for key in changes)}
        self.modes.check(new)
        self.values = new
        self.modes.update(new)

    def state(self):
        """Answer the present state, and let the command act for a step."""
        message = JointState(name=list(self.robot.joint_names), position=self.q.tolist(),
                             velocity=self.u.tolist())
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(self.now, NANO)
        self.path.on_state(serialize_message(message))
        tau = self.taus[-1] if self.taus else self.robot.gravity_force(self.q)
        udot = self.robot.forward_dynamics(self.q, self.u, tau + self.push)
        self.u = self.u + STEP / NANO * udot
        self.q = self.q + STEP / NANO * self.u
        self.now += STEP


class Sent:
    """Keeps the last message for the partner."""

    def __init__(self, side):
        self.side = side

    def publish(self, data):
        self.side.sent = data


def run(sides, seconds, exchange=True):
    for _ in range(round(seconds * NANO / STEP)):
        for side, partner in zip(sides, reversed(sides)):
            if exchange and partner.sent:
                side.topics.on_message(partner.sent)
        for side in sides:
            side.state()


def largest_change(side, since):
    return np.abs(np.diff(side.taus[since:], axis=0)).max()


@pytest.fixture(scope='module')
def sides():
    return Side(LEADER), Side(FOLLOWER)


def test_the_arms_engage_follow_and_lose_each_other_without_a_jump(sides):
    leader, follower = sides
    run(sides, 0.2)
    for side, start in zip(sides, (LEADER, FOLLOWER)):
        np.testing.assert_allclose(side.q, start, atol=1e-6)  # alone
        assert side.mode.snapshot(
            0).detail == ('alone: parameter coupling.engaged is false',)
        side.adjust(coupling__engaged=True)
    begin = len(leader.taus) - 1
    run(sides, 1.5)
    np.testing.assert_allclose(leader.q, follower.q, atol=5e-3)
    leader.push = np.array([3.0, 0.0])
    run(sides, 0.5)
    leader.push = np.zeros(2)
    run(sides, 0.3)
    assert abs(follower.q[0] - LEADER[0]) > 0.05
    np.testing.assert_allclose(leader.q, follower.q, atol=0.02)
    run(sides, 1.4, exchange=False)  # as if a node were gone
    for side in sides:
        # The springs would give 24 N m at once. The observer passes the force on.
        assert largest_change(side, begin) < 1.0
        assert not side.mode.law.engaged and np.abs(side.u).max() < 2e-3
        engaged, alone = side.said
        assert engaged == 'coupled: the arm follows its partner'
        assert alone.startswith('coupling: alone, partner: no state for 0.10')
        assert alone.endswith('set coupling.engaged false, then true, to engage again')
    run(sides, 0.3)  # states come again: the arms do not engage by themselves
    assert not any(side.mode.law.engaged for side in sides)
    for side in sides:
        side.adjust(coupling__engaged=False)
        side.adjust(coupling__engaged=True)
    run(sides, 0.1)
    assert all(side.mode.law.engaged for side in sides)
    leader.adjust(coupling__engaged=False)
    run(sides, 0.1)
    assert not leader.mode.law.engaged and follower.mode.law.engaged
    # An arm that was stopped begins alone, whatever the parameter says.
    follower.path.stop()
    follower.path.start()
    run(sides, 0.1)
    assert follower.mode.snapshot(0).detail == ('alone: this arm: began again',)
    assert not leader.refused and not follower.refused


def test_a_partner_feels_the_torque_at_its_joints(sides):
    leader = sides[0]
    for side in sides:
        side.adjust(coupling__engaged=False)
    leader.push = np.array([2.0, -1.0])
    run(sides, 0.5, exchange=False)
    message = deserialize_message(leader.sent, JointState)
    leader.push = np.zeros(2)
    assert list(message.name) == list(leader.robot.joint_names)
    np.testing.assert_allclose(message.effort, [2.0, -1.0], atol=0.02)
    np.testing.assert_allclose(message.position, leader.q, atol=1e-2)
    assert (message.header.stamp.sec * NANO + message.header.stamp.nanosec == leader.now
            - STEP)


@pytest.mark.parametrize(('change', 'words'), [
    ({'name': ['a']}, 'other number of joints'), ({'effort': []}, 'no external torque'),
    ({'velocity': []}, 'no velocity'), ({'position': [math.nan, 0.0]}, 'not finite')])
def test_states_of_a_partner_that_are_of_no_use_are_refused(change, words):
    side = Side(LEADER)
    fields = {'name': ['a', 'b'], 'position': [0.0, 0.0], 'velocity': [0.0, 0.0],
              'effort': [0.0, 0.0]} | change
    side.topics.on_message(serialize_message(JointState(**fields)))
    assert [reason for reason, _ in side.refused] == [words]
    assert side.mode.partner is None
    side.topics.on_message(b'\x00\x01')
    assert len(side.refused) == 2


@pytest.mark.parametrize(('changes', 'words'), [
    ({'coupling__partner': ''}, "parameter 'coupling.partner': empty; expected"),
    ({'coupling__scale': 0.0}, "scale of joint 'joint1': 0"),
    ({'coupling__stiffness': [1.0, 2.0, 3.0]}, 'coupling.stiffness')])
def test_parameters_that_do_not_fit_the_arm_are_refused(changes, words):
    with pytest.raises(InputError, match=words):
        Side(LEADER, **changes)
