"""Laws in the space of a frame with the numbers of Pinocchio."""

from dataclasses import replace
from functools import cache
from importlib.metadata import files

from kane_dynamics import (CartesianImpedance, HandGuiding, JointImpedance,
                           OperationalSpace, pose_error, pose_exp, Robot, TaskSpace)
from kane_dynamics._util.resources import resource_path
import numpy as np
import pinocchio as pin
from pinocchio_robot import Peer
import pytest
from readable_impedance import ArmNumbers, cartesian_impedance

FRAMES = {'ur10e': 'tool0', 'xarm7': 'link7'}
K = np.array([2000.0, 1500.0, 1000.0, 20.0, 60.0, 100.0])


@cache
def arm(name):
    """Return our robot and Pinocchio's of a URDF; no friction, limits, rotors."""
    path = resource_path('urdf', 'ur10e.urdf')
    if name == 'xarm7':
        path, = (file.locate() for file in files('example-robot-data')
                 if file.name == 'xarm7.urdf')
    peer = Peer(path)
    robot = Robot(peer.model, friction=False)
    free = np.full(robot.n, np.inf)
    robot.limits = replace(robot.limits, effort=free, lower=-free, upper=free,
                           velocity=free)
    return robot, peer


def coriolis_matrix(peer, q, u):
    """Return Christoffel's matrix: half the derivative of the Coriolis force by u."""
    gravity = peer.pin.gravity.copy()
    peer.pin.gravity = pin.Motion.Zero()
    pin.computeRNEADerivatives(peer.pin, peer.data, peer.position(q), peer.G @ u,
                               np.zeros(peer.pin.nv))
    peer.pin.gravity = gravity
    return 0.5 * peer.G.T @ peer.data.dtau_dv @ peer.G


def jacobian(peer, frame, q, u):
    """Return the Jacobian in world axes, and its rate."""
    pin.computeJointJacobiansTimeVariation(peer.pin, peer.data, peer.position(q),
                                           peer.G @ u)
    pin.updateFramePlacements(peer.pin, peer.data)
    index = peer.pin.getFrameId(frame)
    axes = pin.LOCAL_WORLD_ALIGNED
    J = pin.getFrameJacobian(peer.pin, peer.data, index, axes)
    rate = pin.getFrameJacobianTimeVariation(peer.pin, peer.data, index, axes)
    return J @ peer.G, rate @ peer.G


def numbers(peer, frame, q, u):
    """Return what the readable law needs."""
    J, J_rate = jacobian(peer, frame, q, u)
    return ArmNumbers(peer.mass_matrix(q), coriolis_matrix(peer, q, u),
                      peer.gravity_force(q), J, J_rate, peer.frame_pose(frame, q))


@pytest.mark.parametrize('name', FRAMES)
def test_cartesian_impedance(name):
    robot, peer = arm(name)
    frame = FRAMES[name]
    law = CartesianImpedance(robot, frame, stiffness=K, damping_ratio=0.9,
                             singular_mass=1e9, null_damping=2.0)
    rng = np.random.default_rng(0)
    # Slow modes, near singular configurations, are damped less than their ratio.
    regular = [TaskSpace(robot, frame).at(q).mass < 500.0 for q in peer.q]
    assert sum(regular) > 4
    for q, u in zip(peer.q[regular], peer.u[regular], strict=True):
        twist, acceleration, wrench = rng.normal(size=(3, 6))
        step = np.concatenate([0.1 * rng.normal(size=3), rng.uniform(-1.4, 1.4, 3)])
        target = peer.frame_pose(frame, q) @ pose_exp(step)
        reference = numbers(peer, frame, q, u)
        expected = cartesian_impedance(reference, u, target, np.diag(K), 0.9,
                                       twist=twist,
                                       acceleration=acceleration, wrench=wrench)
        tau = law.torque(q, u, target, twist, acceleration, wrench)
        np.testing.assert_allclose(tau, expected, atol=3e-5 * np.abs(expected).max())


@pytest.mark.parametrize('name', FRAMES)
def test_joint_impedance_and_hand_guiding(name):
    robot, peer = arm(name)
    law = JointImpedance(robot, stiffness=70.0, damping=6.0)
    guiding = HandGuiding(robot)
    rng = np.random.default_rng(1)
    for q, u in zip(peer.q[:4], peer.u[:4], strict=True):
        q_d, u_d, udot_d = rng.normal(size=(3, robot.n))
        expected = (peer.mass_matrix(q) @ udot_d + coriolis_matrix(peer, q, u) @ u_d
                    + peer.gravity_force(q) + 70.0 * (q_d - q) + 6.0 * (u_d - u))
        tau = law.torque(q, u, q_d, u_d, udot_d)
        np.testing.assert_allclose(tau, expected, atol=1e-10 * np.abs(expected).max())
        gravity = peer.gravity_force(q)
        np.testing.assert_allclose(guiding.torque(q, 0.0 * u), gravity,
                                   atol=1e-10 * np.abs(gravity).max())


@pytest.mark.parametrize('name', FRAMES)
def test_operational_space_and_its_quantities(name):
    """By Pinocchio's forward dynamics: the frame accelerates as prescribed."""
    robot, peer = arm(name)
    frame = FRAMES[name]
    law = OperationalSpace(robot, frame, singular_mass=1e9, posture=np.zeros(robot.n))
    space = TaskSpace(robot, frame, singular_mass=1e9)
    rng = np.random.default_rng(2)
    for q, u in zip(peer.q[:4], peer.u[:4], strict=True):
        reference = numbers(peer, frame, q, u)
        M_inverse = np.linalg.inv(reference.M)
        Lambda = np.linalg.inv(reference.J @ M_inverse @ reference.J.T)
        direct = space.at(q, u)
        size = np.linalg.cond(Lambda) * 1e-13
        np.testing.assert_allclose(direct.inertia, Lambda,
                                   atol=size * np.abs(Lambda).max())
        mu = Lambda @ (reference.J @ M_inverse @ peer.bias_force(q, u)
                       - reference.J_rate @ u)
        np.testing.assert_allclose(direct.bias, mu, atol=size * np.abs(mu).max())

        twist, acceleration = rng.normal(size=(2, 6))
        target = reference.pose @ pose_exp(0.1 * rng.normal(size=6))
        udot = peer.forward_dynamics(q, u, law.torque(q, u, target, twist, acceleration))
        result = peer.frame_acceleration(frame, q, u, udot)
        expected = (acceleration + 20.0 * (twist - peer.frame_velocity(frame, q, u))
                    + 100.0 * pose_error(reference.pose, target))
        np.testing.assert_allclose(result, expected, atol=1e-7 * np.abs(expected).max())
