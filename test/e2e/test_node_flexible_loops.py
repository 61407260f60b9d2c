"""The palletizer with arms that bend: beams together with closed loops, over DDS."""

import time

from driven_palletizer import tracking_errors
from kane_dynamics import QuasiStatic
from kane_dynamics.control.trajectory_feedforward import fill_trajectory
from kane_dynamics.ros.services.served_robot import QUASI_STATIC, RIGID
from kane_dynamics_interfaces.srv import (Explain, ForwardDynamics, GetDynamics,
                                          InverseDynamics)
from node_process import DEEP, wait_until
import numpy as np
from palletizer import BEAMS, bending_palletizer, DRIVEN, LOOPS, positions, URDF
import pytest
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
import yaml

END = (0.4, 0.3, -0.2, 1.0)


@pytest.fixture(scope='module')
def files(tmp_path_factory):
    supplement = tmp_path_factory.mktemp('beams') / 'beams.yaml'
    supplement.write_text(yaml.safe_dump(BEAMS), encoding='utf-8')
    flexible, rigid = bending_palletizer()
    rigid.compile()
    flexible.compile('inverse_dynamics', 'torque_terms', 'gravity_force')
    return {'urdf': URDF, 'constraints': LOOPS, 'supplement': supplement}


def driven_places():
    """Return the indices of the driven joints in the order of the commands."""
    return sorted(bending_palletizer()[1].joint_names.index(name) for name in DRIVEN)


def test_commands_services_and_observer_use_the_deflection_or_say_what_they_assume(
        client, start, files):
    flexible, rigid = bending_palletizer()
    bent = QuasiStatic(flexible)
    order = driven_places()
    node = start(observer__enabled=True, observer__torque='effort', observer__gain=100.0,
                 state_timeout=30.0, cartesian__frame='tool', **files)
    node.wait_for('active, mode', 120.0)
    assert 'quasi-static deflection lower_arm/mode_1, upper_arm/mode_1' in node.log
    client.joints = DRIVEN
    at = (0.2, 0.3, -0.1, 0.5)
    q = positions(rigid, *at)
    none = np.zeros(4)
    assert wait_until(lambda: client.ask(at, none, timeout=0.3) is not None,
                      60.0), node.log
    held = rigid.joint_torques(bent.gravity_force(q), q)[order]
    straight = rigid.joint_torques(rigid.gravity_force(q), q)[order]
    assert np.abs(held - straight).max() > 0.5
    np.testing.assert_allclose(client.ask(at, none), held, rtol=1e-8, atol=1e-7)

    estimates = []
    client.create_subscription(JointState, '/kane_dynamics/external_torques',
                               lambda m: estimates.append(np.array(m.effort)), DEEP)
    state = JointState(name=list(DRIVEN), position=at, velocity=[0.0] * 4)
    names = [rigid.joint_names[k] for k in order]
    state.effort = [held[names.index(name)] for name in DRIVEN]
    for _ in range(100):
        state.header.stamp.sec, state.header.stamp.nanosec = divmod(
            time.time_ns(), 10**9)
        client.states.publish(state)
        time.sleep(0.01)
    assert wait_until(lambda: len(estimates) > 5)
    assert np.abs(estimates[-1]).max() < 0.1 * np.abs(held - straight).max()

    def observer_says():
        return [values.get('observer: flexible links', '')
                for _, _, values in client.diagnostics]
    assert wait_until(lambda: 'quasi-static deflection' in ' '.join(observer_says()))

    u = np.array([0.2, -0.1, 0.3, 0.4])
    udot = np.array([1.0, 0.5, -1.0, 2.0])
    speeds = [DRIVEN.index(name) for name in rigid.joint_names if name in DRIVEN]
    arguments = {'joint_names': rigid.joint_names, 'position': q.tolist(),
                 'velocity': u[speeds].tolist()}
    answer = client.call(InverseDynamics, 'inverse_dynamics',
                         acceleration=udot[speeds].tolist(), **arguments)
    assert answer.success and answer.message == QUASI_STATIC
    np.testing.assert_allclose(
        answer.effort, rigid.joint_torques(bent.inverse_dynamics(q, u, udot), q),
        rtol=1e-8, atol=1e-7)
    for kind, name, further_fields in (
            (ForwardDynamics, 'forward_dynamics', {'effort': [0.0] * 4}),
            (GetDynamics, 'get_dynamics', {}),
            (Explain, 'explain', {'acceleration': [0.0] * 4})):
        answer = client.call(kind, name, **arguments, **further_fields)
        assert answer.success and answer.message == RIGID, answer.message

    rows = np.array([at, END])
    filled = []
    publisher = client.create_publisher(JointTrajectory, '/kane_dynamics/trajectory', 1)
    subscription = client.create_subscription(
        JointTrajectory, '/kane_dynamics/trajectory_with_effort', filled.append, DEEP)
    assert wait_until(lambda: publisher.get_subscription_count()
                      and subscription.get_publisher_count())
    message = JointTrajectory(joint_names=list(DRIVEN))
    for t, row in zip((0.0, 1.5), rows):
        point = JointTrajectoryPoint(positions=row.tolist())
        point.time_from_start.sec, point.time_from_start.nanosec = int(t), round(
            t % 1.0 * 1e9)
        message.points.append(point)
    publisher.publish(message)
    assert wait_until(lambda: filled), node.log
    expected = fill_trajectory(rigid, [0.0, 1.5], rows, joint_names=DRIVEN, bending=bent)
    np.testing.assert_allclose([point.effort for point in filled[0].points],
                               expected.efforts, rtol=1e-8, atol=1e-6)


def test_the_node_moves_the_bending_plant(client, start, files):
    errors = tracking_errors(client, start, files,
                             'flexible modes lower_arm/mode_1, upper_arm/mode_1', END,
                             (25.0, 10.0), rate=200, substeps=10)
    assert len(errors) > 50
    assert np.mean(errors) < 0.02
