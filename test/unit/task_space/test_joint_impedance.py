"""Joint impedance: the law, its energy and its settings, for trees and closed loops."""

from functools import cache

from kane_dynamics import InputError, JointImpedance, Robot, Terms
from linkages import five_bar, five_bar_at
from mechanisms import random_model
import numpy as np
import pytest
from stepping import stepped


@cache
def arm():
    """Return a random arm with friction, rotors and springs."""
    return Robot(random_model(7, 4, passive=True))


def test_the_torque_is_that_of_the_definition():
    robot = arm()
    law = JointImpedance(robot, stiffness=[100.0, 80.0, 60.0, 40.0], damping=8.0)
    q, u, q_d, u_d, udot_d = np.random.default_rng(0).normal(size=(5, robot.n))
    springs = robot.torque_terms(q, 0.0 * u, 0.0 * u)[4]
    expected = (robot.mass_matrix(q) @ udot_d + robot.coriolis_matrix(q, u) @ u_d
                + robot.gravity_force(q) + springs + robot.friction_force(u_d)
                + np.array([100.0, 80.0, 60.0, 40.0]) * (q_d - q) + 8.0 * (u_d - u))
    np.testing.assert_allclose(law.torque(q, u, q_d, u_d, udot_d), expected, rtol=1e-12)


def test_terms_of_the_model_are_switched_off_without_compiling():
    robot = arm()
    law = JointImpedance(robot, stiffness=100.0, damping=8.0)
    q, u, q_d, u_d, udot_d = np.random.default_rng(1).normal(size=(5, robot.n))
    law.update(compensate=Terms(gravity=False, coriolis=False, inertia=False, friction=False))
    springs = robot.torque_terms(q, 0.0 * u, 0.0 * u)[4]
    expected = springs + 100.0 * (q_d - q) + 8.0 * (u_d - u)
    np.testing.assert_allclose(law.torque(q, u, q_d, u_d, udot_d), expected, rtol=1e-12)


def test_on_the_exact_model_a_closed_loop_follows_its_motion():
    """With the errors at zero the accelerations are the desired ones."""
    robot = five_bar('left_crank', 'right_crank')
    law = JointImpedance(robot, stiffness=50.0, damping=5.0)
    q, u = five_bar_at(2.1, 1.05), np.array([0.3, -0.2])
    cranks = [robot.coordinate_names.index(name) for name in law.followed]
    rates = robot.joint_rates(q, u)[cranks]
    accelerations = np.array([1.0, -2.0])
    tau = law.torque(q, u, q[cranks], rates, accelerations)
    udot = robot.forward_dynamics(q, u, robot.generalized_force(tau, q))
    result = robot.joint_accelerations(q, u, udot)[cranks]
    np.testing.assert_allclose(result, accelerations, atol=1e-9)


@pytest.mark.slow
def test_the_energy_of_a_closed_loop_does_not_rise_while_the_target_rests():
    robot = five_bar('left_crank', 'right_crank')
    law = JointImpedance(robot, stiffness=50.0, damping=0.5)
    q, u = five_bar_at(2.1, 1.05), np.array([1.0, -2.0])
    target = np.array([2.3, 0.8])
    energies = []
    for _ in range(300):
        energies.append(robot.kinetic_energy(q, u) + law.energy(q, target))
        q, u = stepped(robot, lambda q, u: law.torque(q, u, target), q, u, 1e-3)
    assert np.diff(energies).max() < 0.0
    assert energies[-1] < 0.9 * energies[0]


@pytest.mark.parametrize('wrong, message', [
    ({'stiffness': -1.0}, 'stiffness of joint'), ({'damping': np.nan}, 'damping of joint'),
    ({'stiffness': [1.0]}, 'expected one number, or 4'), ({'compensate': True}, 'expected Terms'),
    ({'stifness': 1.0}, 'expected some of stiffness')])
def test_wrong_settings_change_nothing(wrong, message):
    robot = arm()
    law = JointImpedance(robot, stiffness=10.0, damping=1.0)
    q = np.full(robot.n, 0.3)
    before = law.torque(q, 0.0 * q, 0.0 * q)
    with pytest.raises(InputError, match=message):
        law.update(**wrong)
    np.testing.assert_array_equal(law.torque(q, 0.0 * q, 0.0 * q), before)


def test_wrong_states_are_refused():
    law = JointImpedance(arm(), stiffness=10.0, damping=1.0)
    with pytest.raises(InputError, match='q_d'):
        law.torque(np.zeros(4), np.zeros(4), np.zeros(3))
    with pytest.raises(InputError, match='u'):
        law.torque(np.zeros(4), np.full(4, np.nan), np.zeros(4))
