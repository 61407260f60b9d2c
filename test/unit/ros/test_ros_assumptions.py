"""Answers of the services about beams and stops, without a ROS graph."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('rclpy')

from kane_dynamics import load_urdf, QuasiStatic, Robot, stiffened  # noqa: E402, I100
from kane_dynamics._util.resources import resource_path  # noqa: E402
from kane_dynamics.ros.loads.gravity_payload import GravityAndPayload  # noqa: E402
from kane_dynamics.ros.loads.wrench_input import WrenchFrames  # noqa: E402
from kane_dynamics.ros.monitors.applied_torque import AppliedTorque  # noqa: E402
from kane_dynamics.ros.services.served_robot import (QUASI_STATIC, RIGID,  # noqa: E402
                                                     ServedRobot)
from kane_dynamics.ros.services.service_calls import (  # noqa: E402
    explain, forward_dynamics, get_dynamics, inverse_dynamics)
from kane_dynamics.ros.services.simulation_request import SimulationRequest  # noqa: E402
from kane_dynamics_interfaces.srv import (  # noqa: E402
    Explain, ForwardDynamics, GetDynamics, InverseDynamics, Simulate)
from node_values import node_values  # noqa: E402

URDF = resource_path('urdf', 'two_link.urdf')
STATE = {'position': [0.4, 0.3], 'velocity': [0.5, -0.2]}


@cache
def served(bending=True, **changes):
    model = load_urdf(URDF, supplement=resource_path('urdf', 'two_link.bending.yaml'))
    robot = Robot(stiffened(model))
    values = node_values() | {
        name.replace('__', '.'): value for name, value in changes.items()}
    return ServedRobot(robot, robot, GravityAndPayload(robot.parameters.gravity), values,
                       WrenchFrames(robot),
                       QuasiStatic(Robot(model)) if bending else None)


def test_inverse_dynamics_includes_the_deflection_and_says_so():
    answers = []
    for bending in (True, False):
        response = InverseDynamics.Response()
        inverse_dynamics(served(bending), InverseDynamics.Request(
            **STATE, acceleration=[1.0, 2.0]), response)
        answers.append(response)
    flexible, rigid = answers
    assert (flexible.message, rigid.message) == (QUASI_STATIC, '')
    q, u = (np.array(x) for x in STATE.values())
    expected = served().bending.inverse_dynamics(q, u, np.array([1.0, 2.0]))
    np.testing.assert_allclose(flexible.effort, expected, rtol=1e-12)
    assert np.abs(np.subtract(flexible.effort, rigid.effort)).max() > 1e-3


@pytest.mark.parametrize(('call', 'kind', 'more'), [
    (forward_dynamics, ForwardDynamics, {'effort': [1.0, 1.0]}),
    (get_dynamics, GetDynamics, {}),
    (explain, Explain, {'acceleration': [1.0, 2.0]})])
def test_other_answers_say_that_beams_are_rigid(call, kind, more):
    for bending, expected in ((True, RIGID), (False, '')):
        response = kind.Response()
        call(served(bending), kind.Request(**STATE, **more), response)
        assert response.message == expected


def test_the_observer_has_the_torque_without_that_of_the_deflection():
    arm = served()
    rejected = []
    torque = AppliedTorque(arm.robot, arm.values, lambda *words: rejected.append(words),
                           arm.bending)
    q, u = (np.array(x) for x in STATE.values())
    measured = arm.bending.inverse_dynamics(q, u, np.zeros(2))
    state = SimpleNamespace(q=q, u=u, effort=measured, has_velocity=True,
                            has_effort=True)
    torques = torque.torque(state, measured, None)
    rigid = arm.robot.inverse_dynamics(q, u, np.zeros(2))
    np.testing.assert_allclose(torques, rigid, rtol=1e-12)
    assert np.abs(measured - rigid).max() > 1e-3
    state.u = np.array([900.0, 0.0])
    assert torque.torque(state, measured, None) is None
    (reason, detail), = rejected
    assert reason == 'no deflection' and 'no equilibrium found' in detail


@pytest.mark.parametrize('stops', [False, True])
def test_simulations_have_stops_if_the_parameter_says_so(stops):
    request = Simulate.Request(position=[0.1, 0.1], duration=1.0, sample_period=0.01,
                               torque_source=Simulate.Request.TABLE, torque_period=1.0,
                               torques=[200.0, 0.0])
    response = SimpleNamespace()
    simulation = SimulationRequest.from_request(request, served(simulation__stops=stops))
    simulation.run(response, lambda t: True)
    limits = served().robot.limits
    largest = max(point.positions[0] for point in response.trajectory.points)
    assert RIGID in response.message
    assert (largest <= limits.upper[0] + 1e-9) == stops
    assert ('hits its upper stop' in response.message) == stops


def test_simulations_have_exact_friction_if_the_parameter_says_so():
    request = Simulate.Request(position=[0.1, 0.1], duration=0.1, sample_period=0.01,
                               torque_source=Simulate.Request.ZERO)
    simulation = SimulationRequest.from_request(request,
                                                served(simulation__sticking=True))
    assert simulation.sticking
    response = SimpleNamespace()
    simulation.run(response, lambda t: True)
    assert len(response.trajectory.points) == 11
