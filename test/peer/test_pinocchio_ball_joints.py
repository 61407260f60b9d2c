"""Ball and free joints against Pinocchio's spherical joints and free-flyer."""

from functools import cache

from ball_trees import peer_of, random_ball_tree
from kane_dynamics import box, ModelBuilder, Robot, rod
import numpy as np
import pinocchio as pin
import pytest

SEEDS = range(2)


def assert_close(value, expected, relative=1e-11):
    size = max(1.0, np.abs(expected).max())
    np.testing.assert_allclose(value, expected, rtol=0.0, atol=relative * size)


@cache
def robot_of(seed):
    return Robot(random_ball_tree(seed))


def states(seed, count=4):
    robot = robot_of(seed)
    rng = np.random.default_rng(seed)
    q = robot.random_configuration(rng, count)
    return zip(q, *rng.uniform(-2.0, 2.0, (2, count, robot.n)))


@pytest.mark.parametrize('seed', SEEDS)
def test_dynamics_of_trees_with_ball_joints_are_pinocchios(seed):
    robot = robot_of(seed)
    peer = peer_of(random_ball_tree(seed))
    data = peer.createData()
    for q, u, udot in states(seed):
        tau = pin.rnea(peer, data, q, u, udot)
        assert_close(robot.inverse_dynamics(q, u, udot), tau)
        M = pin.crba(peer, data, q)
        M = np.triu(M) + np.triu(M, 1).T
        assert_close(robot.mass_matrix(q), M)
        assert_close(robot.inverse_mass_matrix(q) @ M, np.eye(robot.n),
                     1e-14 * np.linalg.cond(M))
        assert_close(robot.forward_dynamics(q, u, tau), udot, 1e-14 * np.linalg.cond(M))
        assert_close(robot.gravity_force(q),
                     pin.computeGeneralizedGravity(peer, data, q))
        assert_close(robot.kinetic_energy(q, u),
                     pin.computeKineticEnergy(peer, data, q, u))
        assert_close(robot.potential_energy(q),
                     pin.computePotentialEnergy(peer, data, q))
        assert_close(robot.center_of_mass(q), pin.centerOfMass(peer, data, q))
        assert_close(robot.centroidal_momentum_matrix(q), pin.ccrba(peer, data, q, u))
        assert_close(robot.centroidal_momentum(q, u), data.hg.vector)
        rate = pin.computeCentroidalMomentumTimeVariation(peer, data, q, u, udot)
        assert_close(robot.centroidal_momentum_rate(q, u, udot), rate.vector)


@pytest.mark.parametrize('seed', [1])
def test_frames_behind_ball_joints_are_pinocchios(seed):
    robot = robot_of(seed)
    peer = peer_of(random_ball_tree(seed))
    data = peer.createData()
    tool = peer.getFrameId('frame:tool')
    for q, u, udot in states(seed, 2):
        pin.forwardKinematics(peer, data, q, u, udot)
        pin.computeJointJacobiansTimeVariation(peer, data, q, u)
        pin.updateFramePlacements(peer, data)
        world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        assert_close(robot.frame_pose('tool', q), data.oMf[tool].homogeneous)
        assert_close(robot.jacobian('tool', q),
                     pin.getFrameJacobian(peer, data, tool, world))
        assert_close(robot.jacobian_rate('tool', q, u),
                     pin.getFrameJacobianTimeVariation(peer, data, tool, world))
        assert_close(robot.frame_acceleration('tool', q, u, udot),
                     pin.getFrameClassicalAcceleration(peer, data, tool, world).vector)


@pytest.mark.parametrize('seed', [0])
def test_derivatives_along_the_joints_are_pinocchios(seed):
    """The slope in q times dq'/du is the derivative in the tangent space."""
    robot = robot_of(seed)
    peer = peer_of(random_ball_tree(seed))
    data = peer.createData()
    for q, u, udot in states(seed, 2):
        by_q, by_u, _ = robot.inverse_dynamics_derivatives(q, u, udot)
        along = robot.derivative('joint_rates', q, u, by='u')
        expected = pin.computeRNEADerivatives(peer, data, q, u, udot)
        assert_close(by_q @ along, expected[0], 1e-10)
        assert_close(by_u, expected[1], 1e-10)


@pytest.mark.parametrize('seed', SEEDS)
def test_integrate_and_difference_are_pinocchios(seed):
    robot = robot_of(seed)
    peer = peer_of(random_ball_tree(seed))
    for q, u, _ in states(seed):
        ahead = pin.integrate(peer, q, 0.7 * u)
        assert_close(robot.integrate(q, u, 0.7), ahead, 1e-14)
        assert_close(robot.difference(q, ahead), pin.difference(peer, q, ahead), 1e-13)


def test_a_free_flying_arm_is_pinocchios_free_flyer():
    """Its linear velocity is on the body's axes, ours on those of the joint's frame."""
    b = ModelBuilder('satellite')
    b.body('base', kind='free',
           inertial=box(30.0, (1.0, 0.8, 0.6), at=(0.1, 0.05, -0.02)))
    b.body('arm', 'base', at=(0.5, 0, 0), axis=(0, 1, 0),
           inertial=rod(3, (0, 0, 0), (0.7, 0, 0)))
    robot = Robot(b.model())
    peer = pin.Model()
    on = 0
    for name, kind, at in (('base', pin.JointModelFreeFlyer(), (0.0, 0.0, 0.0)),
                           ('arm', pin.JointModelRY(), (0.5, 0.0, 0.0))):
        on = peer.addJoint(on, kind, pin.SE3(np.eye(3), np.array(at)), name)
        inertial = next(body.inertial
                        for body in robot.model.bodies if body.name == name)
        peer.appendBodyToJoint(
            on, pin.Inertia(inertial.mass, inertial.com, inertial.inertia),
            pin.SE3.Identity())
    data = peer.createData()
    rng = np.random.default_rng(0)
    q = robot.random_configuration(1)
    u, udot = rng.uniform(-1.0, 1.0, (2, robot.n))
    R = robot.frame_pose('base', q)[:3, :3]
    v = u.copy()
    a = udot.copy()
    v[:3] = R.T @ u[:3]
    a[:3] = R.T @ udot[:3] - np.cross(u[3:6], v[:3])
    tau = pin.rnea(peer, data, q, v, a)
    assert_close(robot.inverse_dynamics(q, u, udot),
                 np.concatenate([R @ tau[:3], tau[3:]]))
