"""Payload and gravity over DDS: every thread uses them from the answer on."""

import math

from geometry_msgs.msg import Inertia, Vector3
from kane_dynamics import Robot, simulate
from kane_dynamics.model.inertial import Inertial
from kane_dynamics_interfaces.srv import (GetDynamics, InverseDynamics, SetPayload,
                                          Simulate)
from node_process import close, model, URDF, wait_until
import numpy as np
import pytest

Q = [0.3, -0.4, 0.2]
COM = (0.05, 0.02, -0.03)
MOMENTS = (0.02, 0.001, -0.002, 0.025, 0.003, 0.03)
XX, XY, XZ, YY, YZ, ZZ = MOMENTS


def loaded(mass, gravity=(0.0, 0.0, -9.81)):
    """Return a robot that carries the payload of these tests."""
    robot = Robot(model(), payload_frame='c')
    robot.parameters.gravity = gravity
    if mass:
        robot.parameters.payload = Inertial(
            mass, np.array(COM), np.array([[XX, XY, XZ], [XY, YY, YZ], [XZ, YZ, ZZ]]))
    return robot


def payload(mass, com=COM):
    if mass == 0.0:
        return Inertia()
    return Inertia(m=mass, com=Vector3(x=com[0], y=com[1], z=com[2]), ixx=XX, ixy=XY,
                   ixz=XZ, iyy=YY, iyz=YZ, izz=ZZ)


@pytest.fixture(scope='module')
def module_node():
    from node_process import Process
    process = Process(robot_description=f"'{URDF}'", state_timeout=1.0,
                      payload__frame='c',
                      payload__mass=1.0, payload__com=f'[{",".join(map(str, COM))}]',
                      payload__inertia=f'[{",".join(map(str, MOMENTS))}]')
    yield process
    assert process.end()[0] == 0


@pytest.fixture
def node(module_node, client):
    client.process = module_node
    client.connect()
    return client


def test_the_payload_parameters_apply_from_the_start(node):
    assert close(node.ask(Q, np.zeros(3)), loaded(1.0).gravity_force(np.array(Q)))


@pytest.mark.parametrize('mass', [2.5, 0.0, 1.5])
def test_torques_services_and_simulations_use_the_payload_after_the_response(node, mass):
    robot = loaded(mass)
    answer = node.call(SetPayload, 'set_payload', payload=payload(mass))
    assert answer.success, answer.message
    assert close(node.ask(Q, np.zeros(3)), robot.gravity_force(np.array(Q)))
    answer = node.call(InverseDynamics, 'inverse_dynamics',
                       position=Q, acceleration=[1.0] * 3)
    assert close(answer.effort,
                 robot.inverse_dynamics(np.array(Q), np.zeros(3), np.ones(3)))
    answer = node.call(Simulate, 'simulate', position=Q, duration=0.1)
    expected = simulate(robot, Q, np.zeros(3), 0.1)
    assert close(answer.trajectory.points[-1].positions, expected.q[-1])


@pytest.mark.parametrize(('words', 'fields'), [
    ('mass: -1 kg', {'payload': payload(-1.0)}),
    ('mass: nan', {'payload': payload(math.nan)}),
    ('at most 2 m from the frame', {'payload': payload(1.0, (0.0, 3.0, 0.0))}),
    ("'a', not fixed to the body of payload.frame 'c'",
     {'frame': 'a', 'payload': payload(1.0)}),
    ("no frame 'claw'", {'frame': 'claw', 'payload': payload(1.0)}),
])
def test_an_invalid_payload_is_refused_with_the_reason_and_changes_nothing(
        node, words, fields):
    torque_before = node.ask(Q, np.zeros(3))
    answer = node.call(SetPayload, 'set_payload', **fields)
    assert not answer.success
    assert words in answer.message
    assert (node.ask(Q, np.zeros(3)) == torque_before).all()


def test_gravity_changes_with_a_payload_and_for_services(node):
    assert node.call(SetPayload, 'set_payload', payload=payload(1.5)).success
    assert node.adjust(gravity=[3.0, 0.0, -9.0]).successful
    robot = loaded(1.5, (3.0, 0.0, -9.0))
    assert close(node.ask(Q, np.zeros(3)), robot.gravity_force(np.array(Q)))
    answer = node.call(GetDynamics, 'get_dynamics', position=Q)
    assert close(answer.gravity_force, robot.gravity_force(np.array(Q)))
    assert node.adjust(gravity=[0.0, 0.0, -9.81]).successful


def test_payload_parameters_are_applied_together_or_not_at_all(node):
    assert node.call(SetPayload, 'set_payload', payload=payload(2.5)).success
    assert node.adjust(gains__kp=90.0).successful
    assert close(node.ask(Q, np.zeros(3)), loaded(2.5).gravity_force(np.array(Q))), (
        'other parameters must not change the payload')
    refused = node.adjust(payload__com=[0.0, 0.0, 0.1])  # without a mass
    assert "payload set by ~/set_payload; expected 'payload.mass' in" in refused.reason
    refused = node.adjust(payload__mass=0.5,
                          payload__inertia=[1.0, 0.0, 0.0, 0.1, 0.0, 0.1])
    assert not refused.successful
    assert "parameters 'payload.*': inertia: principal moments" in refused.reason
    refused = node.adjust(payload__max_mass=0.5, payload__mass=0.6)
    assert "'payload.*': mass: 0.6 kg; expected 0 to 0.5 kg" in refused.reason
    assert close(node.ask(Q, np.zeros(3)), loaded(2.5).gravity_force(np.array(Q)))
    assert node.adjust(payload__mass=1.5).successful
    assert close(node.ask(Q, np.zeros(3)), loaded(1.5).gravity_force(np.array(Q)))
    answer = node.call(GetDynamics, 'get_dynamics', position=Q)
    assert close(answer.gravity_force, loaded(1.5).gravity_force(np.array(Q)))
    assert node.call(SetPayload, 'set_payload', payload=payload(2.5)).success
    # Equal to the parameter, not to the payload.
    assert node.adjust(payload__mass=1.5).successful
    assert close(node.ask(Q, np.zeros(3)), loaded(1.5).gravity_force(np.array(Q)))
    assert node.adjust(payload__mass=1.0, gains__kp=100.0).successful


def test_no_command_mixes_two_payloads_while_they_alternate(node):
    expected = [loaded(mass).gravity_force(np.array(Q)) for mass in (0.5, 3.0)]
    service = node.create_client(SetPayload, '/kane_dynamics/set_payload')
    assert service.wait_for_service(10.0)
    pending = []
    torques_seen = set()
    for k in range(300):
        # Queues of requests and answers hold ten.
        waiting = [request for request in pending if not request.done()]
        if len(waiting) < 5:
            mass = (0.5, 3.0)[len(pending) % 2]
            pending.append(service.call_async(SetPayload.Request(payload=payload(mass))))
        # Before the state is sent: until then the last payload holds.
        begun = pending[0].done()
        tau = node.ask(Q, np.zeros(3))
        if k > 10 and begun:
            matches = [close(tau, held) for held in expected]
            assert any(matches), tau
            torques_seen.add(matches.index(True))
    for request in pending:
        assert wait_until(request.done)
        assert request.result().success
    assert torques_seen == {0, 1}
