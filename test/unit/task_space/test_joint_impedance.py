"""Joint impedance: the law, its energy and its settings, for trees and closed loops."""

from functools import cache

from kane_dynamics import InputError, JointImpedance, load_urdf, Robot, Terms
from kane_dynamics._util.resources import resource_path
from kane_dynamics.task_space.modal_damping import damping_by_ratio
from kane_dynamics.task_space.sampled_spring import JointSpring, swing
from linkages import five_bar, five_bar_at
from mechanisms import random_model
import numpy as np
import pytest
from scipy.linalg import eigh, sqrtm
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
    law.update(
        compensate=Terms(gravity=False, coriolis=False, inertia=False, friction=False))
    springs = robot.torque_terms(q, 0.0 * u, 0.0 * u)[4]
    expected = springs + 100.0 * (q_d - q) + 8.0 * (u_d - u)
    np.testing.assert_allclose(law.torque(q, u, q_d, u_d, udot_d), expected, rtol=1e-12)


def test_on_the_exact_model_a_closed_loop_follows_its_motion():
    """With the errors at zero the accelerations are the desired ones."""
    robot = five_bar('left_crank', 'right_crank')
    law = JointImpedance(robot, stiffness=50.0, damping=5.0)
    q = five_bar_at(2.1, 1.05)
    u = np.array([0.3, -0.2])
    cranks = [robot.coordinate_names.index(name) for name in law.followed]
    rates = robot.joint_rates(q, u)[cranks]
    accelerations = np.array([1.0, -2.0])
    tau = law.torque(q, u, q[cranks], rates, accelerations)
    udot = robot.forward_dynamics(q, u, robot.generalized_force(tau, q))
    result = robot.joint_accelerations(q, u, udot)[cranks]
    np.testing.assert_allclose(result, accelerations, atol=1e-9)


def geometric_mean(A, B):
    """Return A (A^-1 B)^(1/2), the geometric mean of positive definite matrices."""
    return A @ np.real(sqrtm(np.linalg.solve(A, B)))


def damper_of(law, q, q_d):
    """Return the matrix D of a law, from its torques at unit rates."""
    n = law.robot.n
    law.update(
        compensate=Terms(gravity=False, coriolis=False, inertia=False, friction=False))
    at_rest = law.torque(q, np.zeros(n), q_d)
    return np.column_stack([at_rest - law.torque(q, unit, q_d) for unit in np.eye(n)])


def test_the_damper_by_ratio_is_the_geometric_mean_of_inertia_and_stiffness():
    robot = arm()
    stiffness = np.array([100.0, 80.0, 60.0, 40.0])
    law = JointImpedance(robot, stiffness=stiffness, damping_ratio=0.6)
    q = np.random.default_rng(2).normal(size=robot.n)
    M = robot.mass_matrix(q)
    expected = 1.2 * geometric_mean(np.diag(stiffness), M)
    np.testing.assert_allclose(damper_of(law, q, q), expected,
                               atol=1e-6 * expected.max())
    compared = damping_by_ratio(M, stiffness, np.full(4, 0.6))
    np.testing.assert_allclose(compared, expected, atol=1e-6 * expected.max())


def test_modes_of_joints_with_different_ratios_have_ratios_between_them():
    robot = arm()
    rng = np.random.default_rng(5)
    for _ in range(20):
        q = rng.normal(size=robot.n)
        stiffness = 10.0**rng.uniform(0.0, 3.0, 4)
        ratios = rng.permutation([0.1, 0.1, 1.0, 1.0])
        law = JointImpedance(robot, stiffness=stiffness, damping_ratio=ratios)
        M = robot.mass_matrix(q)
        D = damper_of(law, q, q)
        compared = damping_by_ratio(M, stiffness, ratios)
        np.testing.assert_allclose(D, compared, atol=1e-6 * compared.max())
        squares, modes = eigh(np.diag(stiffness), M)
        of_modes = np.diag(modes.T @ D @ modes) / (2.0 * np.sqrt(squares))
        assert of_modes.min() >= ratios.min() - 1e-6
        assert of_modes.max() <= ratios.max() + 1e-6


def test_every_mode_of_a_closed_loop_has_the_damping_ratio():
    robot = five_bar('left_crank', 'right_crank')
    stiffness = np.array([50.0, 20.0])
    law = JointImpedance(robot, stiffness=stiffness, damping_ratio=0.3)
    q = five_bar_at(2.1, 1.05)
    cranks = [robot.coordinate_names.index(name) for name in law.followed]
    law.update(
        compensate=Terms(gravity=False, coriolis=False, inertia=False, friction=False))
    rates = np.column_stack([robot.joint_rates(q, unit)[cranks] for unit in np.eye(2)])
    K = rates.T @ np.diag(stiffness) @ rates
    inverse = np.linalg.inv(robot.mass_matrix(q))
    rows = []
    for unit in np.eye(2):
        rows.append(robot.generalized_force(law.torque(q, np.zeros(2), q[cranks])
                                            - law.torque(q, unit, q[cranks]), q))
    D = np.column_stack(rows)
    motion = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ K, -inverse @ D]])
    roots = np.linalg.eigvals(motion)
    np.testing.assert_allclose(-roots.real / np.abs(roots), 0.3, atol=1e-6)


def test_kinds_of_damping_change_live():
    robot = arm()
    law = JointImpedance(robot, stiffness=100.0)
    q, u = np.random.default_rng(3).normal(size=(2, robot.n))
    by_ratio = law.torque(q, u, q)
    law.update(damping=3.0, damping_ratio=None)
    stated = JointImpedance(robot, stiffness=100.0, damping=3.0)
    np.testing.assert_array_equal(law.torque(q, u, q), stated.torque(q, u, q))
    law.update(damping=None, damping_ratio=0.7)
    np.testing.assert_array_equal(law.torque(q, u, q), by_ratio)
    without = JointImpedance(robot, stiffness=0.0)
    still = JointImpedance(robot, stiffness=0.0, damping=0.0)
    np.testing.assert_array_equal(without.torque(q, u, q), still.torque(q, u, q))


def test_an_fr3_does_not_swing_up_at_500_hz():
    """The node's default stiffness, torques a period late, at random states."""
    robot = Robot(load_urdf(resource_path('urdf', 'fr3.urdf'), tip='fr3_link7'))
    stiffness = 5.0 * np.array(robot.limits.effort)
    rng = np.random.default_rng(4)
    by_joint = 0
    for _ in range(100):
        q = rng.uniform(robot.limits.lower, robot.limits.upper)
        M = robot.mass_matrix(q)
        damping = damping_by_ratio(M, stiffness, np.full(7, 0.7))
        assert not swing(M, JointSpring(np.diag(stiffness), damping,
                                        True), 0.002).swings_up
        of_joints = np.diag(1.4 * np.sqrt(stiffness * np.diag(M)))
        by_joint += swing(M, JointSpring(np.diag(stiffness), of_joints,
                                         True), 0.002).swings_up
    assert by_joint > 20, 'the inertia of each joint alone is no measure'


@pytest.mark.slow
def test_the_energy_of_a_closed_loop_does_not_rise_while_the_target_rests():
    robot = five_bar('left_crank', 'right_crank')
    law = JointImpedance(robot, stiffness=50.0, damping=0.5)
    q = five_bar_at(2.1, 1.05)
    u = np.array([1.0, -2.0])
    target = np.array([2.3, 0.8])
    energies = []
    for _ in range(300):
        energies.append(robot.kinetic_energy(q, u) + law.energy(q, target))
        q, u = stepped(robot, lambda q, u: law.torque(q, u, target), q, u, 1e-3)
    assert np.diff(energies).max() < 0.0
    assert energies[-1] < 0.9 * energies[0]


@pytest.mark.parametrize('wrong, message', [
    ({'stiffness': -1.0}, 'stiffness of joint'),
    ({'damping': np.nan}, 'damping of joint'),
    ({'stiffness': [1.0]}, 'expected one number, or 4'),
    ({'compensate': True}, 'expected Terms'),
    ({'damping_ratio': 0.5}, 'both given'),
    ({'damping': None, 'damping_ratio': -1.0}, 'damping_ratio of joint'),
    ({'stifness': 1.0}, 'expected some of stiffness')])
def test_wrong_settings_change_nothing(wrong, message):
    robot = arm()
    law = JointImpedance(robot, stiffness=10.0, damping=1.0)
    q = np.full(robot.n, 0.3)
    torque_before = law.torque(q, 0.0 * q, 0.0 * q)
    with pytest.raises(InputError, match=message):
        law.update(**wrong)
    np.testing.assert_array_equal(law.torque(q, 0.0 * q, 0.0 * q), torque_before)


def test_wrong_states_are_refused():
    law = JointImpedance(arm(), stiffness=10.0, damping=1.0)
    with pytest.raises(InputError, match='q_d'):
        law.torque(np.zeros(4), np.zeros(4), np.zeros(3))
    with pytest.raises(InputError, match='u'):
        law.torque(np.zeros(4), np.full(4, np.nan), np.zeros(4))
