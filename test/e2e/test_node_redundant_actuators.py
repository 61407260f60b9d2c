"""Trajectories of a palletizer with a motor more than degrees of freedom, over DDS."""

from kane_dynamics import load_constraints, load_urdf, Robot
from kane_dynamics.mechanics.definition import nonholonomic
from node_process import DEEP, NAME, Process, wait_until
import numpy as np
from palletizer import CONSTRAINTS, DRIVEN, positions, URDF
import pytest
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
import yaml

TIMES = [0.0, 0.8, 1.6]
POINTS = np.array([[0.1, 0.2, -0.1, 0.3], [0.3, 0.4, -0.2, 0.6], [0.5, 0.3, -0.2, 1.0]])
MOTORS = {**dict.fromkeys(DRIVEN, 1.0), 'elbow': 0.5}


@pytest.fixture(scope='module')
def node_and_robot(tmp_path_factory):
    arguments = {**CONSTRAINTS, 'actuated': MOTORS}
    robot = Robot(load_urdf(URDF), **load_constraints(arguments))
    robot.compile()
    path = tmp_path_factory.mktemp('arm') / 'redundant.constraints.yaml'
    path.write_text(yaml.safe_dump(arguments), encoding='utf-8')
    process = Process(urdf=URDF, constraints=path, diagnostics_rate=20,
                      state_timeout=60.0)
    try:
        process.wait_for('active, mode', 120.0)
        yield process, robot
    finally:
        code = process.end()[0]
    assert code == 0
    assert 'Traceback' not in process.log


def require_shared(robot, answer):
    """Compare the efforts of some points with the least norm of Kane's definition."""
    names = list(answer.joint_names)
    assert sorted(names) == sorted(MOTORS)
    places = [robot.joint_names.index(name) for name in names]
    q, u, udot, effort = (np.array([getattr(point, field) for point in answer.points])
                          for field in (
                              'positions', 'velocities', 'accelerations', 'effort'))
    driven = [names.index(name) for name in DRIVEN]
    root = np.sqrt([MOTORS[name] for name in names])
    for k in range(len(q)):
        at = positions(robot, *q[k, driven])
        np.testing.assert_allclose(q[k], at[places], atol=1e-9)
        force = nonholonomic.inverse_dynamics(robot.mechanism, at, u[k, driven],
                                              udot[k, driven])
        # The loops are parallelograms: each joint's rate is a constant sum of the driven
        # rates.
        T = np.array([positions(robot, *row) for row in np.eye(4)]).T[places]
        np.testing.assert_allclose(u[k], T @ u[k, driven], atol=1e-8)
        expected = np.linalg.pinv(T.T / root) @ force / root
        np.testing.assert_allclose(effort[k], expected, rtol=0.0,
                                   atol=1e-8 * np.abs(force).max())


def test_filled_trajectories_have_the_efforts_of_all_motors(node_and_robot, client):
    _, robot = node_and_robot
    filled = []
    publisher = client.create_publisher(JointTrajectory, f'{NAME}/trajectory', 1)
    subscription = client.create_subscription(
        JointTrajectory, f'{NAME}/trajectory_with_effort', filled.append, DEEP)
    assert wait_until(lambda: publisher.get_subscription_count()
                      and subscription.get_publisher_count())
    assert client.adjust(feedforward__tolerance=20.0).successful
    message = JointTrajectory(joint_names=list(DRIVEN))
    for t, row in zip(TIMES, POINTS):
        point = JointTrajectoryPoint(positions=row.tolist())
        point.time_from_start.nanosec = round(t * 1e9) % 10**9
        point.time_from_start.sec = int(t)
        message.points.append(point)
    publisher.publish(message)
    assert wait_until(lambda: filled)
    answer, = filled
    assert list(answer.joint_names) == [*DRIVEN, 'elbow']
    assert len(answer.points) > len(POINTS)
    require_shared(robot, answer)
