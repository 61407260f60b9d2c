"""Operational-space control: errors decay as the gains say, the null space apart."""

from dataclasses import replace
from functools import cache

from kane_dynamics import (InputError, load_urdf, OperationalSpace, pose_error, pose_exp,
                           Robot)
from kane_dynamics._util.resources import resource_path
import numpy as np
from palletizer import joint_angles, palletizer
import pytest

TIP = 'fr3_link8'
Q = np.array([0.1, -0.7, 0.2, -2.3, 0.1, 1.5, 0.7])


@cache
def fr3():
    """Return the FR3 without friction and effort limits."""
    robot = Robot(load_urdf(resource_path('urdf', 'fr3.urdf'), tip=TIP), friction=False)
    robot.limits = replace(robot.limits, effort=np.full(7, np.inf))
    return robot


def accelerated(law, q, u, *target):
    """Return the acceleration of the frame on the exact model."""
    robot = law.robot
    udot = robot.forward_dynamics(q, u, law.torque(q, u, *target))
    return robot.frame_acceleration(TIP, q, u, udot)


def test_the_frame_accelerates_as_prescribed_whatever_the_posture():
    robot = fr3()
    rng = np.random.default_rng(0)
    u = rng.normal(size=7)
    twist = rng.normal(size=6)
    acceleration = rng.normal(size=6)
    target = robot.frame_pose(TIP, Q) @ pose_exp([0.02, 0.0, 0.03, 0.1, 0.2, 0.0])
    lag = twist - robot.frame_velocity(TIP, Q, u)
    error = pose_error(robot.frame_pose(TIP, Q), target)
    expected = acceleration + 25.0 * lag + 150.0 * error
    for settings in ({}, {'posture': Q + 1.0, 'posture_kp': 40.0}):
        law = OperationalSpace(robot, TIP, kp=150.0, kd=25.0, limit_stiffness=0.0,
                               **settings)
        result = accelerated(law, Q, u, target, twist, acceleration)
        np.testing.assert_allclose(result, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.slow
def test_the_posture_acts_where_the_frame_does_not_move():
    robot = fr3()
    law = OperationalSpace(robot, TIP, posture=Q + 0.3, limit_stiffness=0.0)
    pose = robot.frame_pose(TIP, Q)
    q = Q
    u = np.zeros(7)
    for _ in range(400):
        tau = law.torque(q, u, pose)
        u = u + 5e-3 * robot.forward_dynamics(q, u, tau)
        q = q + 5e-3 * u
    assert np.abs(pose_error(robot.frame_pose(TIP, q), pose)).max() < 1e-3
    M = robot.mass_matrix(q)
    J = robot.jacobian(TIP, q)
    N = np.eye(7) - np.linalg.inv(M) @ J.T @ np.linalg.inv(
        J @ np.linalg.inv(M) @ J.T) @ J
    pull = N.T @ M @ (Q + 0.3 - q)
    expected_torque = N.T @ M @ np.full(7, 0.3)
    assert np.abs(pull).max() < 0.05 * np.abs(expected_torque).max()


def test_through_half_a_turn_torques_do_not_jump():
    robot = fr3()
    law = OperationalSpace(robot, TIP, limit_stiffness=0.0)
    pose = robot.frame_pose(TIP, Q)
    at_rest = np.zeros(7)
    axis = np.array([0.2, 0.9, 0.4]) / np.sqrt(1.01)

    def feedback(angle):
        target = pose @ pose_exp(np.concatenate([np.zeros(3), angle * axis]))
        return law.torque(Q, at_rest, target) - robot.gravity_force(Q)
    largest = np.abs(feedback(2.7)).max()
    turns = np.array([feedback(angle) for angle in np.linspace(2.7, 3.58, 201)])
    assert np.abs(np.diff(turns, axis=0)).max() < 0.05 * largest
    assert np.abs(feedback(np.pi)).max() < 1e-9 * largest
    # On the other side the arm turns the other way.
    np.testing.assert_allclose(turns[-1], -feedback(2.0 * np.pi - 3.58),
                               atol=1e-9 * largest)


def test_torques_stay_finite_at_singular_configurations():
    robot = fr3()
    law = OperationalSpace(robot, TIP)
    for q in (np.zeros(7), np.array([0, 0, 0, 0, 0, np.pi / 2, 0])):
        pose = robot.frame_pose(TIP, q)
        pose[:3, 3] += 0.05
        tau = law.torque(q, 0.5 * np.ones(7), pose, np.ones(6), np.ones(6))
        assert np.abs(tau).max() < 1e3


@pytest.mark.slow
def test_a_closed_loop_accelerates_as_prescribed():
    robot = palletizer()
    angles = joint_angles(0.2, 0.3, 0.1, 0.4)
    q = robot.closed_configuration(
        [angles.get(name, 0.0) for name in robot.coordinate_names])
    free = Robot(robot.model, **{**robot.options, 'friction': False})
    free.limits = replace(free.limits, effort=np.full(free.n_q, np.inf))
    law = OperationalSpace(free, 'flange', limit_stiffness=0.0)
    u = np.array([0.2, -0.1, 0.1, 0.3])
    acceleration = np.array([0.5, -0.3, 0.2, 0.0, 0.0, 0.4])
    pose = free.frame_pose('flange', q)
    twist = free.frame_velocity('flange', q, u)
    tau = law.torque(q, u, pose, twist, acceleration)
    udot = free.forward_dynamics(q, u, free.generalized_force(tau, q))
    result = free.frame_acceleration('flange', q, u, udot)
    np.testing.assert_allclose(result, acceleration, atol=1e-8)


@pytest.mark.parametrize('wrong, message', [
    ({'kp': -1.0}, 'kp'), ({'kd': np.inf}, 'kd'),
    ({'posture_kp': 1.0}, 'without a posture'),
    ({'posture': [1.0]}, 'posture'), ({'stiffness': 1.0}, 'expected some of kp')])
def test_wrong_settings_change_nothing(wrong, message):
    law = OperationalSpace(fr3(), TIP)
    with pytest.raises(InputError) as error:
        law.update(**wrong)
    assert message in str(error.value)
