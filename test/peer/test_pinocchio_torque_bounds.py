"""Torque bounds are those of Pinocchio's regressor, with the box as weights."""

from kane_dynamics import Robot, Uncertainty
from kane_dynamics._util.resources import resource_path
import numpy as np
import pinocchio as pin
from pinocchio_robot import Peer
import pytest


@pytest.mark.parametrize('name', ['ur10e', 'fr3'])  # the fingers of the FR3 mimic
def test_bounds_are_the_absolute_regressor_of_pinocchio_times_the_box(name):
    peer = Peer(resource_path('urdf', f'{name}.urdf'))
    model = peer.model
    robot = Robot(model, friction=False)
    box = Uncertainty.of(model, mass=0.1, com=0.02, inertia=0.2)
    places = [peer.pin.getJointId(body.joint.name) - 1 for body in model.bodies]
    rng = np.random.default_rng(0)
    for q, u, udot in rng.uniform(-2.0, 2.0, (20, 3, model.n)):
        lower, upper = robot.torque_bounds(q, u, udot, box)
        Y = pin.computeJointTorqueRegressor(peer.pin, peer.data, peer.G @ q + peer.g,
                                            peer.G @ u, peer.G @ udot)
        of_bodies = (peer.G.T @ Y).reshape(model.n, -1, 10)[:, places]
        deviation = np.abs(of_bodies.reshape(model.n, -1)) @ np.ravel(box.inertial)
        torque = robot.inverse_dynamics(q, u, udot)
        slack = 1e-9 * np.abs(torque).max()
        np.testing.assert_allclose(upper, torque + deviation, rtol=1e-9, atol=slack)
        np.testing.assert_allclose(lower, torque - deviation, rtol=1e-9, atol=slack)
