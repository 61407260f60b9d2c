"""Hand guiding: gravity, a part of the friction, walls, planes and brakes."""

from dataclasses import replace
from functools import cache

from kane_dynamics import (FrictionError, HandGuiding, Inertial, InputError, Limits,
                           load_urdf, ModelBuilder, Robot)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.task_space.joint_speed_limits import CREEPING
from linkages import five_bar, five_bar_at
import numpy as np
import pytest
from stepping import stepped

FRICTION = {'joints': {name: {'damping': 2.0, 'friction': 1.5} for name in (
    'shoulder_pan_joint', 'shoulder_lift_joint', 'elbow_joint', 'wrist_1_joint',
    'wrist_2_joint', 'wrist_3_joint')}}
TOOL = 'tool0'
Q = np.array([0.3, -1.2, 1.5, -1.0, 1.2, 0.4])


@cache
def ur10e():
    """Return the UR10e with friction."""
    model = load_urdf(resource_path('urdf', 'ur10e.urdf'), supplement=FRICTION)
    return Robot(model, payload_frame=TOOL)


def test_at_rest_the_torque_is_that_of_gravity_and_payload():
    robot = ur10e().copy()
    robot.parameters.payload = Inertial(3.0, (0.0, 0.05, 0.1), 0.01 * np.eye(3))
    guiding = HandGuiding(robot)
    np.testing.assert_allclose(guiding.torque(Q, 0.0 * Q), robot.gravity_force(Q),
                               atol=1e-12)


def test_in_motion_a_part_of_the_friction_is_compensated():
    robot = ur10e()
    u = 0.2 * np.array([1.0, -1.0, 1.0, -1.0, 1.0, 1.0])
    tau = HandGuiding(robot, friction=0.75, damping=0.1).torque(Q, u)
    expected = robot.gravity_force(Q) + 0.75 * robot.friction_force(u) - 0.1 * u
    np.testing.assert_allclose(tau, expected, atol=1e-12)


def test_a_part_of_the_friction_beyond_the_model_is_compensated_and_updated():
    robot = ur10e()
    u = 0.2 * np.array([1.0, -1.0, 1.0, -1.0, 1.0, 0.0])
    error = FrictionError(robot.speed_names, coulomb=[0.5, -0.4, 0.3, 0.2, -0.1, 0.1],
                          damping=0.2, offset=0.1, friction_speed=0.02)
    guiding = HandGuiding(robot, friction=0.75, friction_error=error)
    plain = HandGuiding(robot, friction=0.75).torque(Q, u)
    np.testing.assert_allclose(guiding.torque(Q, u), plain + 0.75 * error.torque(u),
                               atol=1e-12)
    # An object that adapts is read at `update`.
    error.coulomb = error.coulomb + 1.0
    expected = plain + 0.75 * error.torque(u)
    assert np.abs(guiding.torque(Q, u) - expected).max() > 0.1
    guiding.update(friction_error=error)
    np.testing.assert_allclose(guiding.torque(Q, u), expected, atol=1e-12)
    guiding.update(friction_error=None)
    np.testing.assert_allclose(guiding.torque(Q, u), plain, atol=1e-12)


@pytest.mark.slow
def test_friction_beyond_the_model_of_a_closed_loop_is_that_of_its_speeds():
    robot = five_bar('left_crank', 'right_crank')
    q = five_bar_at(2.1, 1.05)
    u = np.array([0.3, -0.2])
    error = FrictionError(robot.speed_names, coulomb=[0.5, 0.3], damping=0.1)
    difference = (HandGuiding(robot, friction=0.5, friction_error=error).torque(q, u)
                  - HandGuiding(robot, friction=0.5).torque(q, u))
    np.testing.assert_allclose(robot.generalized_force(difference, q),
                               0.5 * error.torque(u), atol=1e-12)


def test_speeds_beyond_the_limit_are_braked_with_the_inertia():
    robot = ur10e()
    u = np.array([0.0, 0.0, 0.7, 0.0, -0.2, 0.0])
    tau = HandGuiding(robot, speed_limit=0.5).torque(Q, u) - HandGuiding(robot).torque(
        Q, u)
    expected = np.zeros(6)
    expected[2] = -20.0 * robot.mass_matrix(Q)[2, 2] * 0.2
    np.testing.assert_allclose(tau, expected, atol=1e-9)


@pytest.mark.parametrize('speeds', ['stated', 'unstated', 'none'])
def test_a_joint_that_a_hand_throws_at_its_limit_comes_there_slowly(speeds):
    robot = Robot(ur10e().model, friction=False)
    upper = robot.limits.upper.copy()
    upper[2] = Q[2] + 0.4
    robot.limits = replace(robot.limits, upper=upper)
    if speeds == 'unstated':
        robot.limits = replace(robot.limits, velocity=np.full(6, np.inf))
    guiding = HandGuiding(robot, limit_stiffness=0.0,
                          speed_limit=np.inf if speeds == 'none' else None)
    q = Q
    u = np.array([0.0, 0.0, 2.0, 0.0, 0.0, 0.0])
    arrival = 0.0
    for _ in range(600):
        q, u = stepped(robot, guiding.torque, q, u, 1e-3)
        if q[2] > upper[2]:
            arrival = u[2]
            break
    creeping = CREEPING * (upper[2] - robot.limits.lower[2])
    assert (arrival < 1.5 * creeping) == (speeds != 'none')


def test_brakes_before_joint_limits_take_energy_out_of_every_motion():
    robot = ur10e()
    rng = np.random.default_rng(0)
    free = HandGuiding(robot, limit_stiffness=0.0, speed_limit=np.inf)
    braked = HandGuiding(robot, limit_stiffness=0.0, speed_limit=1e6)
    acted = 0
    for _ in range(100):
        q = rng.uniform(robot.limits.lower, robot.limits.upper)
        u = rng.uniform(-20.0, 20.0, 6)
        brake = braked.torque(q, u) - free.torque(q, u)
        assert (brake * u < 1e-6).all()
        acted += bool(np.abs(brake).max() > 1e-6)
    assert acted > 10


@pytest.mark.slow
def test_the_frame_is_braked_along_its_velocity():
    robot = ur10e()
    u = np.array([0.5, 0.4, 0.3, 0.0, 0.2, 0.1])
    J = robot.jacobian(TOOL, Q)[:3]
    v = J @ u
    speed = np.linalg.norm(v)
    mass = speed**2 / (v @ J @ robot.inverse_mass_matrix(Q) @ J.T @ v)
    guiding = HandGuiding(robot, frame=TOOL, frame_speed=0.5 * speed)
    tau = guiding.torque(Q, u) - HandGuiding(robot).torque(Q, u)
    np.testing.assert_allclose(tau, J.T @ (-20.0 * mass * 0.5 * v), atol=1e-9)


def test_a_plane_pushes_the_frame_back_and_moves_at_run_time():
    robot = ur10e()
    height = robot.frame_pose(TOOL, Q)[2, 3]
    guiding = HandGuiding(robot, frame=TOOL, planes=[[0, 0, 1, height + 0.005]],
                          plane_stiffness=1000.0)
    at_rest = 0.0 * Q
    push = guiding.torque(Q, at_rest) - HandGuiding(robot).torque(Q, at_rest)
    np.testing.assert_allclose(push, robot.jacobian(TOOL, Q)[2] * 5.0, atol=1e-9)
    guiding.update(planes=[[0, 0, 1, height - 0.1]])
    np.testing.assert_allclose(guiding.torque(Q, at_rest), robot.gravity_force(Q),
                               atol=1e-12)


@pytest.mark.slow
def test_energy_falls_on_walls_and_planes_and_with_full_compensation_of_friction():
    """Thrown at a plane and a joint limit, with friction wholly compensated."""
    robot = ur10e()
    joints = robot.model.joint_names
    lower = robot.limits.lower.copy()
    upper = robot.limits.upper.copy()
    upper[2] = Q[2] + 0.1
    robot = robot.copy()
    robot.limits = replace(robot.limits, lower=lower, upper=upper)
    height = robot.frame_pose(TOOL, Q)[2, 3]
    guiding = HandGuiding(robot, frame=TOOL, planes=[[0, 0, 1, height - 0.1]],
                          frame_speed=0.3, friction=1.0)
    q = Q
    u = np.array([0.4, 0.5, 1.0, 0.2, -0.5, 0.3])
    energies = []
    depth = 0.0
    for _ in range(400):
        stored = guiding.energy(q)
        depth = max(depth, stored)
        energies.append(robot.kinetic_energy(q, u) + stored)
        q, u = stepped(robot, guiding.torque, q, u, 1e-3)
    assert depth > 0.1 and len(joints) == 6
    assert np.diff(energies).max() < 1e-9


@pytest.mark.slow
def test_a_closed_loop_is_held_against_gravity():
    robot = five_bar('left_crank', 'right_crank')
    q = five_bar_at(2.1, 1.05)
    at_rest = np.zeros(2)
    tau = HandGuiding(robot).torque(q, at_rest)
    np.testing.assert_allclose(
        robot.forward_dynamics(q, at_rest, robot.generalized_force(tau, q)),
        at_rest, atol=1e-9)


def test_torques_are_clamped():
    tau = HandGuiding(ur10e(), effort_limit=20.0).torque(Q, 0.0 * Q)
    assert np.abs(tau).max() == 20.0


@pytest.mark.parametrize('wrong, message', [
    ({'friction': 1.1}, 'from 0 to 1'), ({'damping': -1.0}, 'damping'),
    ({'planes': [[0, 0, 2, 1]]}, 'normals'), ({'planes': [[0, 0, 1]]}, '(k, 4)'),
    ({'planes': 'floor'}, 'planes'), ({'frame_speed': 1.0}, 'without a frame'),
    ({'frame': 'nowhere'}, 'nowhere'), ({'frame': 'base_link'}, 'does not move'),
    ({'friction_error': FrictionError(['a'])}, 'friction_error: of a; expected'),
    ({'friction_error': 0.1}, 'friction_error'),
    ({'plane_stiffness': -1.0}, 'plane_stiffness'),
    ({'speed_limit': [1.0]}, 'speed_limit')])
def test_wrong_settings_are_refused(wrong, message):
    with pytest.raises(InputError) as error:
        HandGuiding(ur10e(), **wrong)
    assert message in str(error.value)


def test_the_number_of_planes_stays():
    guiding = HandGuiding(ur10e(), frame=TOOL, planes=[[0, 0, 1, 0.0]])
    with pytest.raises(InputError, match='expected 1'):
        guiding.update(planes=[[0, 0, 1, 0], [0, 1, 0, 0]])


@pytest.mark.parametrize('speed', [1.0, 2.0, 2.5, 4.0, 6.0])
def test_a_joint_too_fast_for_its_torque_passes_its_limit_by_no_more_than_stated(speed):
    """docs/limits.md: above 2 a T by at most v^2 / (2 a) - T v, else never."""
    builder = ModelBuilder('one joint')
    effort = 10.0
    inertia = 1.0
    builder.body('link', axis=(0, 0, 1), limits=Limits(-4.0, 4.0, effort=effort),
                 inertial=Inertial(1.0, np.zeros(3), inertia * np.eye(3)))
    guiding = HandGuiding(Robot(builder.model()))
    q = np.zeros(1)
    u = np.array([speed])
    step = 1e-3
    for _ in range(6000):
        u = u + step * guiding.torque(q, u) / inertia
        q = q + step * u
        a = effort / inertia
        assert q[0] - 4.0 <= max(0.0, speed**2 / (2.0 * a) - 0.1 * speed)
    assert (speed > 2.0 * a * 0.1) or q[0] < 4.0
