"""Hybrid force control: contact without bouncing, a force kept along a motion."""

from dataclasses import replace
from functools import cache

from kane_dynamics import CartesianImpedance, HybridForce, InputError, load_urdf, Robot
from kane_dynamics._util.resources import resource_path
import numpy as np
import pytest

TOOL = 'tool0'
Q = np.array([0.3, -1.2, 1.5, -1.8, -1.5, 0.4])
K = np.array([2000.0, 2000, 2000, 100, 100, 100])


@cache
def ur10e():
    """Return the UR10e without friction and effort limits."""
    robot = Robot(load_urdf(resource_path('urdf', 'ur10e.urdf')), friction=False)
    robot.limits = replace(robot.limits, effort=np.full(6, np.inf))
    return robot


@pytest.mark.slow
def test_without_force_it_is_the_impedance_along_the_other_directions():
    robot = ur10e()
    pose = robot.frame_pose(TOOL, Q)
    pose[:3, 3] += [0.03, -0.02, 0.05]
    stiffness = K * [1, 1, 0, 1, 1, 1]
    hybrid = HybridForce(robot, TOOL, force_directions=['z'], stiffness=K)
    impedance = CartesianImpedance(robot, TOOL, stiffness=stiffness)
    at_rest = np.zeros(6)
    np.testing.assert_allclose(hybrid.torque(Q, at_rest, pose),
                               impedance.torque(Q, at_rest, pose), atol=1e-9)


def test_a_table_is_approached_slowly_and_pressed_with_the_force_along_a_circle():
    """At 1 kHz, the measured force one period old, a table of 3000 N/m."""
    robot = ur10e()
    law = HybridForce(robot, TOOL, force_directions=['z'], stiffness=K)
    start = robot.frame_pose(TOOL, Q)
    height = start[2, 3] - 0.02
    wrench = np.array([0, 0, -10.0, 0, 0, 0])
    measured = np.zeros(6)
    h = 1e-3
    q = Q
    u = np.zeros(6)
    force = 0.0
    forces = []
    speeds = []
    for k in range(2200):
        angle = max(0.0, 2.0 * np.pi * (k * h - 0.8))
        pose = start.copy()
        circle = 0.03 * np.array([np.cos(angle) - 1, np.sin(angle), 0])
        pose[:3, 3] += circle
        moves = float(angle > 0.0) * 2.0 * np.pi
        twist = 0.03 * moves * np.array([-np.sin(angle), np.cos(angle), 0, 0, 0, 0])
        acceleration = -0.03 * moves**2 * np.array(
            [np.cos(angle), np.sin(angle), 0, 0, 0, 0])
        tau = law.torque(q, u, pose, twist, acceleration, wrench,
                         measured=measured, elapsed=h)
        for _ in range(2):
            depth = height - robot.frame_pose(TOOL, q)[2, 3]
            force = 3000.0 * max(depth, 0.0)
            push = force * robot.jacobian(TOOL, q)[2]
            u = u + 0.5 * h * robot.forward_dynamics(q, u, tau + push)
            q = q + 0.5 * h * u
        measured = np.array([0, 0, force, 0, 0, 0])
        forces.append(force)
        speeds.append(robot.frame_velocity(TOOL, q, u)[2])
    forces = np.array(forces)
    contact = int(np.flatnonzero(forces)[0])
    assert min(speeds) > -0.052 and 300 < contact < 600
    assert (forces[contact:] > 0.0).all()  # no bouncing
    assert forces.max() < 20.0
    assert np.abs(forces[1300:] - 10.0).max() < 0.5


def test_an_unmodelled_force_is_removed_by_the_integral():
    robot = ur10e()
    law = HybridForce(robot, TOOL, force_directions=['z'], stiffness=K, force_gain=0.0)
    pose = robot.frame_pose(TOOL, Q)
    at_rest = np.zeros(6)
    wrench = np.array([0, 0, -10.0, 0, 0, 0])
    measured = np.array([0, 0, 8.0, 0, 0, 0])
    for _ in range(100):
        tau = law.torque(Q, at_rest, pose, None, None, wrench,
                         measured=measured, elapsed=0.01)
        tau[:] = 7.0  # the torques are the caller's
    assert law.integral[2] == pytest.approx(-4.0)  # 2 /s of an error of 2 N for 1 s
    for _ in range(1000):
        law.torque(Q, at_rest, pose, None, None, wrench, measured=measured, elapsed=0.01)
    assert law.integral[2] == pytest.approx(-5.0)  # half of the desired force at most
    law.reset()
    assert not law.integral.any()


@pytest.mark.parametrize('wrong, message', [
    ({'force_directions': 'z'}, 'force_directions'),
    ({'force_directions': []}, 'each once'),
    ({'force_directions': ['w']}, 'each once'), ({'force_gain': -1.0}, 'force_gain'),
    ({'approach_speed': 0.0}, 'approach_speed'),
    ({'integral_gain': np.inf}, 'integral_gain'),
    ({'force_directions': 3}, 'force_directions: 3; expected'),
    ({'stiffness': 'x'}, 'stiffness'), ({'stiffness': [1.0]}, 'stiffness'),
    ({'stiffness': [1.0, 1.0, np.nan, 1.0, 1.0, 1.0]}, 'stiffness'),
    ({'stiffness': [1.0, 1.0, -1.0, 1.0, 1.0, 1.0]}, 'eigenvalue')])
def test_wrong_settings_are_refused(wrong, message):
    with pytest.raises(InputError) as error:
        HybridForce(ur10e(), TOOL,
                    **{'force_directions': ['z'], 'stiffness': K, **wrong})
    assert message in str(error.value)


def test_wrong_calls_are_refused():
    law = HybridForce(ur10e(), TOOL, force_directions=['z'], stiffness=K)
    pose = ur10e().frame_pose(TOOL, Q)
    at_rest = np.zeros(6)
    for elapsed in (-1.0, np.nan, None, 'soon'):
        with pytest.raises(InputError, match='elapsed'):
            law.torque(Q, at_rest, pose, elapsed=elapsed)
    with pytest.raises(InputError, match='measured'):
        law.torque(Q, at_rest, pose, measured=[0.0])
    with pytest.raises(InputError, match="wrench: 'down'; expected 6 numbers"):
        law.torque(Q, at_rest, pose, wrench='down')


@pytest.mark.parametrize('approach', [0.2, 0.5, 4.0])
def test_a_moment_about_a_light_axis_is_kept_without_oscillation(approach):
    """At 1 kHz a damper of 2 N m at 0.2 rad/s turns back 2e-3 kg m^2."""
    tool = 'fr3_link8'
    robot = Robot(load_urdf(resource_path('urdf', 'fr3.urdf'), tip=tool), friction=False)
    q = np.array([0.3, -0.5, 0.1, -2.2, 0.1, 1.9, 0.8])
    u = np.zeros(7)
    h = 1e-3
    start = robot.frame_pose(tool, q)
    axis = start[:3, 2]
    law = HybridForce(robot, tool, axes='frame', force_directions=['rz'], stiffness=K,
                      approach_speed=[0.05] * 3 + [approach] * 3)
    wrench = np.concatenate([np.zeros(3), 2.0 * axis])
    speeds = []
    for _ in range(1500):
        turned = axis @ np.cross(start[:3, 0], robot.frame_pose(tool, q)[:3, 0])
        spring = 30.0 * np.arcsin(turned)
        tau = law.torque(q, u, start, wrench=wrench, elapsed=h,
                         measured=np.concatenate([np.zeros(3), -spring * axis]))
        for _ in range(4):
            turned = axis @ np.cross(start[:3, 0], robot.frame_pose(tool, q)[:3, 0])
            rate = axis @ robot.frame_velocity(tool, q, u)[3:]
            held = -(30.0 * np.arcsin(turned) + 0.2 * rate) * axis
            load = robot.jacobian(tool, q)[3:].T @ held
            u = u + 0.25 * h * robot.forward_dynamics(q, u, tau + load)
            q = q + 0.25 * h * u
        speeds.append(rate)
    assert max(speeds) < max(1.2 * approach, 3.2)
    assert np.abs(speeds[-300:]).max() < 1e-3
    assert 30.0 * np.arcsin(turned) == pytest.approx(2.0, rel=0.02)
