"""Promises for arms that compensate gravity for a base and a payload they were told."""

from kane_dynamics import Controller, load_urdf, Mode, Robot, stiffened, Terms
from kane_dynamics._util.resources import resource_path
from kane_dynamics.control.arm_gravity import ArmGravity
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.control.traced_laws import controller_laws, Desired, LawInput
from kane_dynamics.errors import InputError
from kane_dynamics.model.inertial import Inertial
from kane_dynamics.motion.motion import Motion
import numpy as np
import pytest

UR10E = resource_path('urdf', 'ur10e.urdf')
UPRIGHT = np.array([0.0, 0.0, -9.81])
TILTED = 9.81 * np.array([np.sin(0.4), 0.0, -np.cos(0.4)])
LOAD = Inertial(2.0, np.array([0.0, 0.02, 0.1]), np.zeros((3, 3)))
Q = np.array([0.3, -1.2, 1.5, 0.4, 0.9, -0.6])
SETTINGS = {'kp': 50.0, 'kd': 10.0}


def arm(gravity=TILTED, payload=LOAD):
    """Return a robot with a gravity and a payload at its tool."""
    robot = Robot(load_urdf(UR10E, gravity=gravity), payload_frame='tool0')
    robot.parameters.payload = payload
    return robot


def believed(gravity=UPRIGHT, payload=None):
    """Return the torque terms of commands to an arm that compensates this gravity."""
    return Terms(arm=ArmGravity.of(gravity, payload))


def own_torque(gravity=UPRIGHT, payload=None, q=Q):
    """Return the torque that the arm adds, by a robot of its own."""
    return arm(gravity, payload).gravity_force(q)


@pytest.mark.parametrize('mode', [Mode.GRAVITY_COMPENSATION, Mode.COMPUTED_TORQUE,
                                  Mode.INVERSE_DYNAMICS])
@pytest.mark.parametrize('moving', [False, True])
def test_command_and_torque_of_the_arm_are_the_torque_of_the_model(mode, moving):
    u = np.full(6, 0.1)
    motion = None
    if moving:
        motion = Motion.from_points([0.0, 1.0], [Q, Q + 0.2],
                                    joint_names=arm().joint_names)
    whole = Controller(arm(), mode=mode, **SETTINGS)
    beside = Controller(arm(), mode=mode, compensate=believed(), **SETTINGS)
    for t in (0.0, 0.4):
        expected = whole.command(t, Q, u, motion).tau - own_torque()
        np.testing.assert_allclose(beside.command(t, Q, u, motion).tau, expected,
                                   atol=1e-10)


def test_a_tilted_arm_that_compensates_as_if_upright_gets_the_difference():
    controller = Controller(arm(payload=None), mode=Mode.GRAVITY_COMPENSATION,
                            compensate=believed())
    tau = controller.command(0.0, Q).tau
    difference = own_torque(TILTED - UPRIGHT)
    assert np.abs(difference).max() > 5.0
    np.testing.assert_allclose(tau, difference, atol=1e-10)
    np.testing.assert_allclose(controller.gravity_torque(Q), difference, atol=1e-10)


def test_a_payload_that_changes_is_commanded_in_the_next_cycle():
    robot = arm(UPRIGHT, LOAD)
    controller = Controller(robot, mode=Mode.GRAVITY_COMPENSATION,
                            compensate=believed(payload=LOAD))
    np.testing.assert_allclose(controller.command(0.0, Q).tau, 0.0, atol=1e-10)
    robot.parameters.payload = None
    expected = -(own_torque(payload=LOAD) - own_torque())
    np.testing.assert_allclose(controller.command(0.1, Q).tau, expected, atol=1e-10)
    assert np.abs(expected).max() > 5.0


@pytest.mark.parametrize('mode', [Mode.GRAVITY_COMPENSATION, Mode.COMPUTED_TORQUE,
                                  Mode.INVERSE_DYNAMICS])
def test_the_law_of_the_native_path_is_that_of_the_controller(mode):
    robot = arm()
    terms = believed(payload=LOAD)
    law = controller_laws(robot, terms)[mode].beside(robot, terms.arm)
    u = np.full(6, 0.1)
    at = LawInput(q=Q, u=u, stamp=0.0, desired=Desired(Q, 0 * u, 0 * u, 0.0), begins=1.0,
                  memory=np.zeros(0), settings=np.repeat([50.0, 10.0], 6),
                  parameters=robot.parameters.block, limits=np.zeros(0))
    tau, _ = law.torque(at)
    controller = Controller(robot, mode=mode, compensate=terms, **SETTINGS)
    np.testing.assert_allclose(np.asarray(tau, float),
                               controller.command(0.0, Q, u).tau, atol=1e-9)


def test_the_arm_falls_as_predicted_where_its_own_gravity_is_wrong():
    terms = believed()
    controller = Controller(arm(), mode=Mode.GRAVITY_COMPENSATION, compensate=terms)
    robot = arm()
    still = np.zeros(6)
    # Without a command the torque of the arm acts alone.
    q, u = controller.predicted_state(Q, still, still, 1e-3)
    acceleration = robot.forward_dynamics(Q, still, own_torque())
    np.testing.assert_allclose(u, 1e-3 * acceleration, rtol=2e-2, atol=1e-5)
    assert np.abs(u).max() > 1e-3
    np.testing.assert_allclose(q, Q, atol=1e-4)


def test_efforts_of_trajectories_are_without_the_torque_of_the_arm():
    robot = arm()
    u = np.full(6, 0.3)
    udot = np.full(6, -0.5)
    tau = believed().inverse_dynamics(robot, Q, u, udot)
    whole = robot.inverse_dynamics(Q, u, udot)
    np.testing.assert_allclose(tau, whole - own_torque(), atol=1e-10)
    tau = believed().whole_inverse_dynamics(robot, Q, u, udot)
    np.testing.assert_allclose(tau, whole, atol=1e-10)


def test_the_torque_of_an_arm_with_flexible_links_is_refused():
    model = load_urdf(resource_path('urdf', 'two_link.urdf'),
                      supplement=resource_path('urdf', 'two_link.bending.yaml'))
    bending = QuasiStatic(Robot(model))
    rigid = Robot(stiffened(model))
    still = np.zeros(2)
    with pytest.raises(InputError, match=r'^arm: given for flexible links; expected'):
        believed().inverse_dynamics(bending, still, still, still)
    with pytest.raises(InputError, match=r'^compensate\.arm: given for flexible links'):
        Controller(rigid, bending=bending, compensate=believed())
