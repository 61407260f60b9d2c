"""Wrenches, contact and explanations over DDS: a node beside a plant at rest."""

import time

from geometry_msgs.msg import WrenchStamped
from kane_dynamics import Robot
from kane_dynamics_interfaces.srv import Explain
from node_process import DEEP, JOINTS, LATCHED, model, NAME, Process, URDF, wait_until
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool

Q = np.array([0.3, -0.4, 0.2])
STILL = np.zeros(3)
PUSH = np.array([4.0, -6.0, 2.0, 0.5, 0.2, -0.1])
THRESHOLD = 2.0


@pytest.fixture(scope='module')
def robot():
    return Robot(model(), wrench_frames=('c', 'b'))


@pytest.fixture(scope='module')
def module_node():
    process = Process(robot_description=f"'{URDF}'", state_timeout=1.0,
                      wrench__timeout=0.5,
                      wrench__frames='[c,b]', observer__enabled=True,
                      observer__threshold=THRESHOLD)
    yield process
    assert process.end()[0] == 0, process.log


class Ear:
    """Hears what the node publishes beside its torques."""

    def __init__(self, client):
        self.flags = []
        self.efforts = []
        self.pushes = []
        self.client = client
        self.open = [
            client.create_subscription(kind, f'{NAME}/{topic}', received_by.append, qos)
            for kind, topic, received_by, qos in (
                (Bool, 'collision', self.flags, LATCHED),
                (JointState, 'external_torques', self.efforts, DEEP),
                (WrenchStamped, 'external_wrench', self.pushes, DEEP))]

    def close(self):
        for subscription in self.open:
            self.client.destroy_subscription(subscription)


@pytest.fixture
def node(module_node, client):
    client.process = module_node
    client.connect()
    client.ear = Ear(client)
    yield client
    client.ear.close()


def wrench(numbers, frame, stamp=None):
    message = WrenchStamped()
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(
        time.time_ns() if stamp is None else stamp, 10**9)
    force = message.wrench.force
    torque = message.wrench.torque
    force.x, force.y, force.z, torque.x, torque.y, torque.z = map(float, numbers)
    return message


def world(robot, frame):
    R = robot.frame_pose(frame, Q)[:3, :3]
    return np.concatenate([R @ PUSH[:3], R @ PUSH[3:]])


def hold(node, effort, until, seconds=3.0):
    """Publish states at rest with efforts until something holds; return whether so."""
    message = JointState(name=list(JOINTS), position=Q.tolist(), velocity=[0.0] * 3,
                         effort=np.asarray(effort).tolist())
    end = time.monotonic() + seconds
    while not (done := until()) and time.monotonic() < end:
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(
            time.time_ns(), 10**9)
        node.states.publish(message)
        time.sleep(0.005)
    return done


def answers(node, expected):
    """Tell whether a state's torques are these; a state may be lost on the way."""
    tau = node.ask(Q, STILL)
    return tau is not None and np.allclose(tau, expected, rtol=1e-12)


def test_a_wrench_changes_the_commands_until_it_times_out(node, robot):
    gravity = robot.gravity_force(Q)
    publisher = node.create_publisher(WrenchStamped, f'{NAME}/wrench', 1)
    assert wait_until(lambda: publisher.get_subscription_count() == 1)
    rows = np.array([world(robot, 'c'), np.zeros(6)])
    expected = gravity - robot.external_force(Q, wrench=rows)

    def answer():
        publisher.publish(wrench(PUSH, 'c'))
        return answers(node, expected)
    assert wait_until(answer)
    for bad in (wrench(PUSH, 'claw'), wrench(PUSH * np.nan, 'c'),
                wrench(PUSH, 'c', time.time_ns() + 10**10), wrench(PUSH, 'c', 10**9)):
        publisher.publish(bad)
    assert wait_until(lambda: answers(node, gravity))
    words = ('frame not in wrench.frames', 'not finite', 'stamp in the future',
             'stale (older than wrench.timeout)', 'timed out after wrench.timeout')
    assert wait_until(lambda: {f'rejected: wrench: {word}' for word in words}
                      <= set(node.diagnostics[-1][2] if node.diagnostics else ()))
    node.destroy_publisher(publisher)


def test_without_velocities_there_is_no_collision(node, robot):
    assert node.adjust(mode='gravity_compensation').successful
    count_before = len(node.ear.flags)
    for k in range(100):
        node.send(Q + 0.3 * np.sin(0.3 * k))
        time.sleep(0.002)
    word = 'rejected: observer: no velocity'
    assert wait_until(lambda: node.diagnostics and word in node.diagnostics[-1][2])
    assert not any(flag.data for flag in node.ear.flags[count_before:])
    assert node.adjust(mode='inverse_dynamics').successful


def test_external_torques_wrench_and_collision_are_published(node, robot):
    ear = node.ear
    gravity = robot.gravity_force(Q)
    push = np.array([0.5, 5.0, -1.0])
    assert hold(node, gravity, lambda: bool(ear.efforts))
    assert wait_until(
        lambda: [flag.data for flag in ear.flags] == [False]), 'it is latched'
    assert hold(node, gravity - push, lambda: len(ear.flags) > 1)
    assert ear.flags[-1].data
    assert hold(node, gravity - push, lambda: np.allclose(ear.efforts[-1].effort, push,
                                                          rtol=1e-3))
    assert list(ear.efforts[-1].name) == list(JOINTS)
    assert hold(node, gravity - push, lambda: (node.diagnostics[-1][2].get('collision')
                                               if node.diagnostics else None) == 'lift')
    assert "collision at joint 'lift'" in node.diagnostics[-1][1]
    assert "collision at joint 'lift'" in node.process.log
    published = ear.pushes[-1]
    assert published.header.frame_id == 'c'
    force = published.wrench.force
    torque = published.wrench.torque
    R = robot.frame_pose('c', Q)[:3, :3]
    rows = np.zeros((2, 6))
    rows[0] = [*(R @ [force.x, force.y, force.z]), *(R @ [torque.x, torque.y, torque.z])]
    np.testing.assert_allclose(robot.external_force(Q, wrench=rows), push,
                               rtol=0.01, atol=0.01)
    assert hold(node, gravity, lambda: not ear.flags[-1].data)
    assert [flag.data for flag in ear.flags] == [False, True, False]


def test_a_collision_stops_the_motion_and_refuses_others_until_it_ends(node, robot):
    gravity = robot.gravity_force(Q)
    log = node.process
    assert node.adjust(observer__action='stop').successful
    try:
        node.follow([(0.0, Q), (60.0, Q + 1.0)])
        assert not hold(node, gravity, lambda: False, 0.5)
        assert not answers(node, gravity), 'the motion is followed'
        pushed = gravity - 3.0 * THRESHOLD
        assert hold(node, pushed,
                    lambda: 'desired motion stopped' in log.log), log.log[-500:]
        assert "collision at joint 'turn': desired motion stopped" in log.log
        refused = "joint_trajectory rejected: collision at joint 'turn'"
        node.follow([(0.0, Q), (60.0, Q + 1.0)])
        assert hold(node, pushed, lambda: refused in log.log)
        # After the stop the arm is held; when the collision has ended, motions are
        # followed.
        flags = node.ear.flags
        assert hold(node, gravity, lambda: flags and not flags[-1].data)
        assert not hold(node, gravity, lambda: False, 0.3), 'to the end of the stop'
        torque_before = node.torques[max(node.torques)]
        assert not hold(node, gravity, lambda: False, 0.3)
        np.testing.assert_allclose(node.torques[max(node.torques)], torque_before,
                                   atol=1e-9)
        rejected = log.log.count('joint_trajectory rejected')
        node.follow([(0.0, Q), (1.0, Q + 0.5)])
        moving = robot.gravity_force(Q + 0.5)
        assert hold(node, gravity,
                    lambda: np.allclose(node.torques[max(node.torques)], moving,
                                        rtol=1e-9), 5.0)
        assert log.log.count('joint_trajectory rejected') == rejected
    finally:
        assert node.adjust(observer__action='report').successful


def test_explain_answers_in_the_order_of_the_request(node, robot):
    u = np.array([0.5, -1.0, 0.3])
    udot = np.array([1.0, 2.0, -1.0])
    order = [2, 0, 1]
    rows = np.array([world(robot, 'c'), np.zeros(6)])
    expected = robot.explain(Q, u, udot, wrench=rows)
    answer = node.call(Explain, 'explain', joint_names=[JOINTS[k] for k in order],
                       position=Q[order].tolist(), velocity=u[order].tolist(),
                       acceleration=udot[order].tolist(), wrenches=[wrench(PUSH, 'c')])
    assert answer.success, answer.message
    why = answer.explanation
    assert list(why.joint_names) == [JOINTS[k] for k in order]
    assert (list(why.sources), list(why.bodies)) == (list(expected.sources),
                                                     list(expected.bodies))
    np.testing.assert_allclose(np.reshape(why.by_source, (-1, 3)),
                               expected.by_source[:, order], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(np.reshape(why.by_body, (-1, 3)),
                               expected.by_body[:, order], rtol=1e-12, atol=1e-12)
    assert why.joint_power == pytest.approx(float(expected.torque @ u))
    assert abs(why.power_residual) < 1e-8 * abs(why.energy_rate)


@pytest.mark.parametrize(('words', 'pushes'), [
    ("frame_id: 'claw'; expected c, b", [wrench(PUSH, 'claw')]),
    ("wrenches: two at frame 'b'; expected one", [wrench(PUSH, 'b'), wrench(PUSH, 'b')]),
    ('finite', [wrench(PUSH * np.inf, 'b')])])
def test_an_invalid_wrench_in_a_request_is_refused_with_the_reason(node, words, pushes):
    answer = node.call(Explain, 'explain', position=Q.tolist(), acceleration=[0.0] * 3,
                       wrenches=pushes)
    assert not answer.success
    assert words in answer.message


def test_deactivation_clears_the_flag_and_an_invalid_threshold_is_refused(node, robot):
    answer = node.adjust(observer__threshold=[1.0, 2.0])
    assert not answer.successful
    assert ('2 entries; expected one number, or one for each of the 3 joints'
            in answer.reason)
    ear = node.ear
    gravity = robot.gravity_force(Q)
    assert hold(node, gravity - 5.0, lambda: bool(ear.flags) and ear.flags[-1].data)
    assert node.transition(4)
    assert wait_until(lambda: not ear.flags[-1].data)
    assert node.transition(3)
    node.connect()
