"""Long chains: accelerations, mass matrix and its inverse are Pinocchio's."""

from kane_dynamics import Robot
from mechanisms import random_model
import numpy as np
import pinocchio as pin
import pytest


def pinocchio_chain(model):
    """Return a chain of revolute joints as Pinocchio's model."""
    peer = pin.Model()
    peer.gravity.linear = np.array(model.gravity)
    last = 0
    for body in model.bodies:
        joint = body.joint
        inertial = body.inertial
        placement = pin.SE3(np.array(joint.rotation), np.array(joint.translation))
        last = peer.addJoint(last, pin.JointModelRevoluteUnaligned(joint.axis),
                             placement, joint.name)
        inertia = pin.Inertia(inertial.mass, inertial.com, inertial.inertia)
        peer.appendBodyToJoint(last, inertia, pin.SE3.Identity())
    return peer


@pytest.mark.parametrize('n', [50, 200])
def test_accelerations_of_long_chains_are_pinocchios(n):
    model = random_model(7, n, prismatic=0.0, branching=0.0, passive=False)
    peer = pinocchio_chain(model)
    data = peer.createData()
    q, u, tau = np.random.default_rng(0).uniform(-2.0, 2.0, (3, n))
    expected = pin.aba(peer, data, q, u, tau)
    M = pin.crba(peer, data, q)
    condition = np.linalg.cond(np.triu(M) + np.triu(M, 1).T)
    accelerations = Robot(model).forward_dynamics(q, u, tau)
    error = np.abs(accelerations - expected).max() / np.abs(expected).max()
    assert error < 10.0 * np.finfo(float).eps * condition


def test_matrices_of_a_long_chain_are_pinocchios():
    n = 50
    model = random_model(7, n, prismatic=0.0, branching=0.0, passive=False)
    peer = pinocchio_chain(model)
    data = peer.createData()
    q = np.random.default_rng(0).uniform(-2.0, 2.0, n)
    robot = Robot(model)
    M = np.triu(pin.crba(peer, data, q))
    M = M + np.triu(M, 1).T
    assert np.abs(robot.mass_matrix(q) - M).max() < 1e-13 * np.abs(M).max()
    W = np.triu(pin.computeMinverse(peer, data, q))
    W = W + np.triu(W, 1).T
    error = np.abs(robot.inverse_mass_matrix(q) - W).max() / np.abs(W).max()
    assert error < 10.0 * np.finfo(float).eps * np.linalg.cond(M)
