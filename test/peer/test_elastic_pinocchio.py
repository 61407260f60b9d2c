"""Fourth-order inverse dynamics of an elastic FR3: Pinocchio with polynomials."""

import warnings

from differentiated import taylor_motion, time_derivatives
from kane_dynamics import Drive, ElasticFeedforward, load_urdf, Robot, with_drives
import numpy as np
from numpy.testing import assert_allclose
from pinocchio_fr3 import pinocchio_fr3
import pytest

JOINTS = [f'fr3_joint{k}' for k in range(1, 8)]


@pytest.mark.parametrize('seed', range(5))
def test_all_outputs_are_those_of_pinocchio(seed):
    pinocchio, peer, data = pinocchio_fr3()
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        rigid = load_urdf('urdf/fr3.urdf', joints=JOINTS)
    K = 1e4
    B = 0.6
    robot = Robot(
        with_drives(rigid, {name: Drive(K, rotor_inertia=B) for name in JOINTS}),
        friction=False)
    rates = np.random.default_rng(seed).normal(size=(5, 7))
    motion = taylor_motion(*rates)
    torque = time_derivatives(lambda t: pinocchio.rnea(peer, data, *motion(t)), 2)
    motor = rates[:3] + torque / K
    expected = [*torque, *motor, B * motor[2] + torque[0]]
    for row, reference in zip(ElasticFeedforward(robot)(*rates), expected):
        assert_allclose(row, reference, rtol=0, atol=1e-9 * np.abs(reference).max())
