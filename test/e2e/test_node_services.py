"""Every service and the action over DDS: the library's numbers, or why not."""

import math

from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Duration
from kane_dynamics import ComputedTorque, Motion, Robot, simulate
from kane_dynamics_interfaces.action import SimulateMotion
from kane_dynamics_interfaces.srv import (ForwardDynamics, GetDynamics, InverseDynamics,
                                          Simulate)
from node_process import close, JOINTS, model, Process, URDF, wait_until
import numpy as np
import pytest
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

Q = [0.3, -0.4, 0.2]
U = [0.5, 1.0, -0.3]
A = [1.0, -2.0, 0.5]
ORDER = [2, 0, 1]  # of a request that names the joints in another order
NAMES = [JOINTS[k] for k in ORDER]


def mixed(values):
    return [values[k] for k in ORDER]


@pytest.fixture(scope='module')
def robot():
    return Robot(model())


@pytest.fixture(scope='module')
def module_node():
    process = Process(robot_description=f"'{URDF}'")
    process.wait_for('active, mode')
    yield process
    assert process.end()[0] == 0


@pytest.fixture
def node(module_node, client):
    client.process = module_node
    return client


def positions(trajectory):
    return np.array([point.positions for point in trajectory.points])


def test_one_node_has_all_services_topics_and_actions(node):
    # A killed node of an earlier test is listed for 20 s.
    assert wait_until(lambda: node.get_node_names().count('kane_dynamics') == 1, 30.0)
    assert 'kane_dynamics_services' not in node.get_node_names()
    of_node = 'kane_dynamics', '/'
    services = dict(node.get_service_names_and_types_by_node(*of_node))
    for name in ('simulate', 'set_payload', 'get_state', 'set_parameters',
                 'simulate_motion/_action/send_goal'):
        assert f'/kane_dynamics/{name}' in services
    topics = dict(node.get_subscriber_names_and_types_by_node(*of_node))
    assert {'/joint_states', '/kane_dynamics/joint_trajectory'} <= topics.keys()


def test_inverse_dynamics_answers_in_the_order_of_the_request(node, robot):
    expected = robot.inverse_dynamics(np.array(Q), np.array(U), np.array(A))
    answer = node.call(InverseDynamics, 'inverse_dynamics', position=Q, velocity=U,
                       acceleration=A)
    assert answer.success, answer.message
    assert close(answer.effort, expected)
    assert list(answer.joint_names) == list(JOINTS)
    answer = node.call(InverseDynamics, 'inverse_dynamics', joint_names=NAMES,
                       position=mixed(Q), velocity=mixed(U), acceleration=mixed(A))
    assert list(answer.joint_names) == NAMES
    assert close(answer.effort, mixed(expected))
    for name, wrench in zip(NAMES, answer.joint_reactions, strict=True):
        parts = []
        for vector in (wrench.force, wrench.torque):
            for axis in 'xyz':
                parts.append(getattr(vector, axis))
        assert close(parts,
                     robot.joint_reaction(name, np.array(Q), np.array(U), np.array(A)))


def test_forward_dynamics_equals_that_of_the_library(node, robot):
    expected = robot.forward_dynamics(np.array(Q), np.array(U), np.array(A))
    answer = node.call(ForwardDynamics, 'forward_dynamics', joint_names=NAMES,
                       position=mixed(Q), velocity=mixed(U), effort=mixed(A))
    assert answer.success, answer.message
    assert close(answer.acceleration, mixed(expected))


def test_get_dynamics_equals_the_library_in_the_order_of_the_request(node, robot):
    q = np.array(Q)
    u = np.array(U)
    answer = node.call(GetDynamics, 'get_dynamics', joint_names=NAMES, position=mixed(Q),
                       velocity=mixed(U))
    assert answer.success, answer.message
    M = robot.mass_matrix(q)[np.ix_(ORDER, ORDER)]
    assert close(np.reshape(answer.mass_matrix, (3, 3)), M)
    assert close(answer.bias_force, mixed(robot.bias_force(q, u)))
    assert close(answer.gravity_force, mixed(robot.gravity_force(q)))
    assert close(answer.friction_force, mixed(robot.friction_force(u)))
    assert close(answer.kinetic_energy, robot.kinetic_energy(q, u))
    assert close(answer.potential_energy, robot.potential_energy(q))


def test_simulate_without_torques_equals_the_library(node, robot):
    expected = simulate(robot, Q, U, 0.5, step=1e-3, sample=0.01)
    answer = node.call(Simulate, 'simulate', joint_names=NAMES, position=mixed(Q),
                       velocity=mixed(U), duration=0.5, sample_period=0.01)
    assert answer.success, answer.message
    assert close(positions(answer.trajectory), expected.q[:, ORDER])
    assert list(answer.trajectory.joint_names) == NAMES
    last = answer.trajectory.points[-1]
    assert close(last.velocities, expected.u[-1, ORDER])
    assert close(last.accelerations, expected.udot[-1, ORDER])
    assert last.time_from_start == Duration(nanosec=500_000_000)
    assert close(answer.kinetic_energy, expected.energy[:, 0])
    assert close(answer.potential_energy, expected.energy[:, 1])
    assert [str(event) for event in expected.limit_events] == list(answer.limit_events)
    assert 0.0 < answer.wall_time < 1.0


def test_simulate_holds_each_row_of_a_table_for_its_period(node, robot):
    table = np.array([[5.0, 30.0, -3.0], [0.0, 20.0, 1.0], [1.0, 0.0, 0.0]])
    expected = simulate(robot, Q, np.zeros(3), 0.3, torque=np.repeat(table, 100, axis=0))
    answer = node.call(Simulate, 'simulate', joint_names=NAMES, position=mixed(Q),
                       duration=0.3,
                       torque_source=Simulate.Request.TABLE, torque_period=0.1,
                       torques=table[:, ORDER].ravel().tolist())
    assert answer.success, answer.message
    assert close(positions(answer.trajectory)[-1], expected.q[-1, ORDER])


def reference():
    message = JointTrajectory(joint_names=list(JOINTS))
    for t, target in ((0.0, Q), (0.4, [0.5, -0.2, 0.1])):
        message.points.append(JointTrajectoryPoint(
            positions=target, time_from_start=Duration(nanosec=round(t * 1e9))))
    return message


def test_simulate_follows_a_reference_by_computed_torque(node, robot):
    motion = Motion.from_points([0.0, 0.4], [Q, [0.5, -0.2, 0.1]], joint_names=JOINTS)
    expected = simulate(robot, Q, np.zeros(3), 0.5,
                        torque=ComputedTorque(robot, motion, 100.0, 20.0))
    answer = node.call(
        Simulate, 'simulate', joint_names=NAMES, position=mixed(Q), duration=0.5,
        torque_source=Simulate.Request.COMPUTED_TORQUE, reference=reference())
    assert answer.success, answer.message
    assert close(positions(answer.trajectory)[-1], expected.q[-1, ORDER])


@pytest.mark.parametrize(('words', 'fields'), [
    ('position: 2 entries; expected 3', {'position': [0.0, 0.0]}),
    ('expected finite numbers', {'position': [0.0, math.nan, 0.0]}),
    ("joint_names: 'lift' is missing", {'joint_names': ['turn', 'reach', 'wheel']}),
    ("joint_names: 'wheel' is unknown", {'joint_names': [*JOINTS, 'wheel']}),
    ('a joint is named twice', {'joint_names': [*JOINTS, 'lift']}),
    ('duration: 0 s; expected', {'duration': 0.0}),
    ('duration: nan', {'duration': math.nan}),
    ('duration: inf', {'duration': math.inf}),
    ('at most 3600 s', {'duration': 1e9}),
    ('at most 1000000',
     {'duration': 1.0, 'step': 1e-9}),
    ('at most 2000',
     {'duration': 10.0, 'sample_period': 1e-3}),
    ('step: -1 s; expected', {'step': -1.0}),
    ('step: 2 s; expected at most the duration', {'step': 2.0}),
    ('whole number of steps', {'duration': 0.5005}),
    ('torque_source: 9; expected', {'torque_source': 9}),
    ('torques: 4 entries', {'torque_source': 1, 'torques': [0.0] * 4}),
    ('at least 500', {'torque_source': 1, 'torques': [0.0] * 6}),
    ('row 0 of torques', {'torque_source': 1, 'torques': [math.nan] * 3}),
    ('0 points', {'torque_source': 2}),
    ("kp of joint 'turn': -1", {'torque_source': 2, 'reference': reference(),
                                'kp': [-1.0, 1.0, 1.0]}),
])
def test_an_invalid_simulation_request_is_answered_with_the_reason(node, words, fields):
    answer = node.call(Simulate, 'simulate',
                       **{'position': Q, 'duration': 0.5, **fields})
    assert not answer.success
    assert words in answer.message
    assert node.process.alive()


@pytest.mark.parametrize(('kind', 'name', 'words', 'fields'), [
    (InverseDynamics, 'inverse_dynamics', 'acceleration: 0 entries',
     {'position': Q, 'velocity': U}),
    (ForwardDynamics, 'forward_dynamics', 'effort: 1 entries',
     {'position': Q, 'effort': [1.0]}),
    (GetDynamics, 'get_dynamics', 'position: 0 entries', {}),
    (GetDynamics, 'get_dynamics', 'velocity: [',
     {'position': Q, 'velocity': [math.inf] * 3}),
])
def test_an_invalid_request_is_answered_with_the_reason(node, kind, name, words, fields):
    answer = node.call(kind, name, **fields)
    assert not answer.success
    assert words in answer.message


class Goal:
    """One goal of the action."""

    def __init__(self, node, **fields):
        self.feedback = []
        self._node = node
        self._handle, self._result = node.send_goal(
            SimulateMotion, 'simulate_motion', position=Q,
            feedback_callback=lambda message: self.feedback.append(message.feedback),
            **fields)

    def cancel(self):
        self._node.on_spinner(self._handle.cancel_goal_async)

    def result(self, timeout=20.0):
        assert wait_until(self._result.done, timeout)
        return self._result.result().status, self._result.result().result


def test_the_action_publishes_feedback_and_its_result_equals_the_library(node, robot):
    goal = Goal(node, duration=300.0, sample_period=1.0)
    status, result = goal.result()
    assert status == GoalStatus.STATUS_SUCCEEDED, result.message
    assert result.success
    expected = simulate(robot, Q, np.zeros(3), 2.0, sample=1.0)
    assert close(positions(result.trajectory)[:3], expected.q)
    assert len(result.trajectory.points) == 301
    assert goal.feedback
    times = [feedback.simulated_time for feedback in goal.feedback]
    assert times == sorted(times)
    assert all(0.0 <= feedback.progress <= 1.0 for feedback in goal.feedback)


def test_a_cancelled_goal_returns_the_points_so_far(node):
    goal = Goal(node, duration=1000.0, step=1e-3)
    assert wait_until(lambda: goal.feedback and goal.feedback[-1].simulated_time > 0.0)
    goal.cancel()
    status, result = goal.result()
    assert status == GoalStatus.STATUS_CANCELED
    assert not result.success
    assert 'cancelled at' in result.message
    assert result.trajectory.points


def test_an_invalid_goal_is_aborted_with_the_reason(node):
    status, result = Goal(node, duration=-1.0).result()
    assert status == GoalStatus.STATUS_ABORTED
    assert not result.success
    assert 'duration: -1 s; expected' in result.message


def test_a_full_queue_answers_that_it_is_busy(node):
    # One runs and eight wait.
    long = [Goal(node, duration=1000.0) for _ in range(10)]
    answers = [request.result(30.0)[1] for request in long[9:]]
    assert not answers[0].success
    assert 'busy' in answers[0].message
    assert node.call(GetDynamics, 'get_dynamics',
                     position=Q).success, 'short requests still go'
    for request in long[:9]:
        request.cancel()
        request.result()
