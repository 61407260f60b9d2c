"""Trajectories of the palletizer, an arm with three closed loops, filled in over DDS."""

import re

from kane_dynamics.control.trajectory_feedforward import fill_trajectory
from kane_dynamics.loop_tracking.loop_error import CONTRADICTORY_POINT, SINGULAR
from kane_dynamics.mechanics.definition import nonholonomic
from node_process import active_until_end, DEEP, NAME, Process, wait_until
import numpy as np
from palletizer import (DRIVEN, LOOPS, palletizer, positions,
                        SINGULAR_SHOULDER, URDF)
import pytest
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

TIMES = [0.0, 0.8, 1.6]
POINTS = np.array([[0.1, 0.2, -0.1, 0.3], [0.3, 0.4, -0.2, 0.6], [0.5, 0.3, -0.2, 1.0]])
ORDER = [2, 0, 3, 1]  # of the message
DRIVING = [DRIVEN[k] for k in ORDER]


@pytest.fixture(scope='module')
def module_node(tmp_path_factory):
    palletizer().compile()
    # Its limits exclude what is singular.
    urdf = tmp_path_factory.mktemp('arm') / 'wide.urdf'
    urdf.write_text(
        re.sub(r'lower="\S*" upper="\S*" velocity="\S*"', 'lower="-3" upper="3" '
               'velocity="99"', URDF.read_text(encoding='utf-8')), encoding='utf-8')
    yield from active_until_end(
        Process(urdf=urdf, constraints=LOOPS, diagnostics_rate=20, state_timeout=60.0))


@pytest.fixture
def filler(module_node, client):
    client.joints = DRIVEN
    filled = []
    publisher = client.create_publisher(JointTrajectory, f'{NAME}/trajectory', 1)
    subscription = client.create_subscription(
        JointTrajectory, f'{NAME}/trajectory_with_effort', filled.append, DEEP)
    assert wait_until(lambda: publisher.get_subscription_count()
                      and subscription.get_publisher_count())
    yield publisher, filled
    client.destroy_subscription(subscription)
    client.destroy_publisher(publisher)


def whole(driven):
    """Return rows of all joints in an order that is not the robot's, and their names."""
    names = palletizer().joint_names[::-1]
    return names, np.array([positions(palletizer(), *row)[::-1] for row in driven])


def trajectory(names, rows, times=TIMES):
    message = JointTrajectory(joint_names=list(names))
    for t, row in zip(times, rows, strict=True):
        point = JointTrajectoryPoint(positions=np.asarray(row).tolist())
        point.time_from_start.sec, point.time_from_start.nanosec = divmod(
            round(t * 1e9), 10**9)
        message.points.append(point)
    return message


def rejected(node, publisher, message, words):
    count_before = len(node.log)
    publisher.publish(message)
    assert wait_until(
        lambda: f'trajectory rejected: {words}' in node.log[count_before:]), node.log


def test_the_topic_returns_the_efforts_of_the_driven_joints_in_the_order_of_the_message(
        filler, module_node):
    publisher, filled = filler
    robot = palletizer()
    publisher.publish(trajectory(DRIVING, POINTS[:, ORDER]))
    assert wait_until(lambda: filled), module_node.log
    expected = fill_trajectory(robot, TIMES, POINTS[:, ORDER], joint_names=DRIVING)
    message, = filled
    assert list(message.joint_names) == DRIVING
    for point, driven, u, udot, effort in zip(
            message.points, POINTS, expected.velocities,
            expected.accelerations, expected.efforts):
        np.testing.assert_allclose(point.effort, effort, rtol=1e-9, atol=1e-9)
        back = [DRIVING.index(name) for name in DRIVEN]
        by_definition = nonholonomic.inverse_dynamics(
            robot.mechanism, positions(robot, *driven), u[back], udot[back])
        np.testing.assert_allclose(point.effort, by_definition[ORDER], rtol=0.0,
                                   atol=1e-9 * np.abs(by_definition).max())


def test_a_trajectory_of_all_joints_is_that_of_the_driven_ones(filler, module_node):
    publisher, filled = filler
    names, rows = whole(POINTS)
    publisher.publish(trajectory(names, rows))
    assert wait_until(lambda: filled), module_node.log
    joints = [name for name in names if name in DRIVEN]
    assert list(filled[0].joint_names) == joints
    order = [DRIVEN.index(name) for name in joints]
    expected = fill_trajectory(palletizer(), TIMES, POINTS, joint_names=DRIVEN)
    for field, array in (('positions', expected.positions),
                         ('effort', expected.efforts)):
        np.testing.assert_allclose([getattr(point, field) for point in filled[0].points],
                                   array[:, order], rtol=1e-9, atol=1e-9)


def test_a_later_trajectory_begins_at_the_measured_joints(filler, module_node, client):
    publisher, filled = filler
    client.joints = DRIVEN
    assert wait_until(
        lambda: client.ask(POINTS[0], np.zeros(4), timeout=0.3) is not None)
    publisher.publish(trajectory(DRIVING, POINTS[1:, ORDER], TIMES[1:]))
    assert wait_until(lambda: filled), module_node.log
    np.testing.assert_allclose(filled[0].points[0].positions, POINTS[0, ORDER],
                               atol=1e-12)
    robot = palletizer()
    q = positions(robot, *POINTS[0])
    expected = nonholonomic.inverse_dynamics(robot.mechanism, q, np.zeros(4),
                                             np.zeros(4))
    np.testing.assert_allclose(filled[0].points[0].effort, expected[ORDER],
                               rtol=1e-8, atol=1e-8)


def test_refusals_are_named(filler, module_node):
    publisher, filled = filler
    names, rows = whole(POINTS)
    rows[1, names.index('triangle_pin')] -= 0.05
    rejected(module_node, publisher, trajectory(names, rows),
             f"{CONTRADICTORY_POINT}: at point 1 (0.8 s): 'triangle_pin' at")
    singular = POINTS[:, ORDER].copy()
    singular[2, DRIVING.index('shoulder')] = SINGULAR_SHOULDER - 0.1
    rejected(module_node, publisher, trajectory(DRIVING, singular),
             f'{SINGULAR}: after point 1 (at ')
    rejected(module_node, publisher, trajectory(DRIVING[:3], POINTS[:, ORDER[:3]]),
             f'joint_names: {DRIVING[:3]}; expected the joints with actuators')
    assert not filled
