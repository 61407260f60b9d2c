"""Identities of mechanics on random mechanisms."""

import energies
from hyperdual import seeded
from hypothesis import given
from kane_dynamics import Robot, simulate
from kane_dynamics.mechanics.definition import kane
from kinds_of_mechanism import case
from mechanisms import random_model, random_state
import numpy as np
import pytest
from strategies import robots_and_states

EPS = np.finfo(float).eps


def scale(robot, q, u, udot):
    """Return the size of the torque terms, to which rounding is relative."""
    return 1e-3 + np.abs(robot.torque_terms(q, u, udot)).max()


def rates(robot, q, u, udot):
    """Return dKE/dt and dPE/dt along the motion, by automatic differentiation."""
    path = seeded(q, u, 0, robot.n)
    kinetic = energies.kinetic_energy(robot.model, path, seeded(u, udot, 0, robot.n))
    return kinetic.rate, energies.potential_energy(robot.model, path).rate


@given(robots_and_states(1))
def test_mass_matrix_is_symmetric_and_positive_definite(drawn):
    robot, q = drawn
    M = robot.mass_matrix(q)
    assert np.array_equal(M, M.T)
    assert np.linalg.eigvalsh(M).min() > 0.0


@given(robots_and_states(1))
def test_inverse_mass_matrix_is_the_inverse(drawn):
    robot, q = drawn
    M = robot.mass_matrix(q)
    product = robot.inverse_mass_matrix(q) @ M
    assert np.abs(
        product - np.eye(robot.n)).max() < 10.0 * robot.n * EPS * np.linalg.cond(M)


@given(robots_and_states(2))
def test_kinetic_energy_is_half_u_m_u(drawn):
    robot, q, u = drawn
    M = robot.mass_matrix(q)
    assert robot.kinetic_energy(q, u) == pytest.approx(
        0.5 * u @ M @ u, rel=1e-11, abs=1e-12 * np.abs(M).max() * (u @ u))


@pytest.mark.parametrize('kind', ['tree', 'flexible', 'free and ball joints'])
def test_reference_dynamics_is_linear_in_the_reference_with_the_coriolis_matrix(kind):
    robot, q, u = (getattr(case(kind), name) for name in ('robot', 'q', 'u'))
    tree = robot.equations.tree
    parameters = robot.parameters.block
    reference, udot = np.random.default_rng(0).uniform(-2.0, 2.0, (2, robot.n))
    at_rest = tree.rigid_dynamics(q, 0.0 * u, 0.0 * u, None, parameters)
    expected = (robot.mass_matrix(q) @ udot + robot.coriolis_matrix(q, u) @ reference
                + at_rest)
    force = tree.reference_dynamics(q, u, reference, udot, parameters)
    np.testing.assert_allclose(np.asarray(force, float), np.asarray(expected, float),
                               rtol=0.0, atol=1e-12 * np.abs(expected).max())


@given(robots_and_states(2))
def test_rate_of_mass_matrix_less_twice_coriolis_is_skew(drawn):
    robot, q, u = drawn
    M = kane.mass_matrix(robot.model, seeded(q, u, 0, robot.n))
    rate = np.vectorize(lambda x: getattr(x, 'rate', 0.0), otypes=[float])(M)
    N = rate - 2.0 * robot.coriolis_matrix(q, u)
    size = np.abs(robot.mass_matrix(q)).max() * (1.0 + u @ u)
    np.testing.assert_allclose(N, -N.T, atol=1e-12 * size)


@given(robots_and_states(4, most=4))
def test_power_of_actuators_and_wrenches_minus_friction_is_the_rate_of_energy(drawn):
    robot, q, u, tau, _ = drawn
    push = np.resize([1.0, -2.0, 0.5, 0.3, 0.1, -0.7], (1, 6))
    udot = robot.forward_dynamics(q, u, tau, wrench=push)
    power = tau @ u - robot.friction_force(u) @ u
    power += push[0] @ robot.frame_velocity(robot.equations.wrench_frames[0].name, q, u)
    size = (scale(robot, q, u, udot) * np.linalg.cond(robot.mass_matrix(q))
            * (1.0 + np.abs(u).sum()))
    assert sum(rates(robot, q, u, udot)) == pytest.approx(power, rel=1e-11,
                                                          abs=100 * EPS * size)


@given(robots_and_states(1))
def test_gravity_and_springs_are_the_gradient_of_the_potential_energy(drawn):
    robot, q = drawn
    at_rest = np.zeros(robot.n)
    # Friction may have an offset.
    held = robot.bias_force(q, at_rest) - robot.friction_force(at_rest)
    springs = robot.torque_terms(q, np.zeros(robot.n), np.zeros(robot.n))[4]
    size = scale(robot, q, np.zeros(robot.n), np.zeros(robot.n))
    gradient = -energies.conservative_force(robot.model, q)
    np.testing.assert_allclose(held, gradient, rtol=1e-11, atol=1e-12 * size)
    np.testing.assert_allclose(robot.gravity_force(q) + springs, held, rtol=1e-11,
                               atol=1e-12 * size)


@given(robots_and_states(1))
def test_gravity_is_the_slope_of_the_compiled_potential_energy(drawn):
    robot, q = drawn
    h = 1e-3
    at_rest = np.zeros(robot.n)
    # Friction may have an offset.
    held = robot.bias_force(q, at_rest) - robot.friction_force(at_rest)
    for r, e in enumerate(np.eye(robot.n)):
        samples = [robot.potential_energy(q + k * h * e) for k in (-2, -1, 1, 2)]
        slope = (samples[0] - 8.0 * samples[1] + 8.0 * samples[2] - samples[3]) / (
            12.0 * h)
        assert slope == pytest.approx(held[r],
                                      rel=1e-8, abs=1e-8 * (1.0 + np.ptp(samples) / h))


@given(robots_and_states(3))
def test_forward_dynamics_of_inverse_dynamics_is_the_identity(drawn):
    robot, q, u, udot = drawn
    M = robot.mass_matrix(q)
    tolerance = 10.0 * EPS * np.linalg.cond(M) * np.abs(udot).max(initial=1.0)
    rounding = 100.0 * EPS * np.linalg.norm(np.linalg.inv(M), 2) * scale(
        robot, q, u, udot)
    tau = robot.inverse_dynamics(q, u, udot)
    np.testing.assert_allclose(robot.forward_dynamics(q, u, tau), udot, rtol=0.0,
                               atol=tolerance + rounding)


@given(robots_and_states(3))
def test_equations_of_motion_hold_with_their_parts(drawn):
    robot, q, u, udot = drawn
    tau = robot.inverse_dynamics(q, u, udot)
    size = scale(robot, q, u, udot)
    for parts in (robot.mass_matrix(q) @ udot + robot.bias_force(q, u),
                  robot.torque_terms(q, u, udot).sum(axis=0)):
        np.testing.assert_allclose(parts, tau, rtol=1e-11, atol=1e-12 * size)


@given(robots_and_states(1))
def test_partial_velocities_are_finite_differences_of_poses(drawn):
    robot, q = drawn
    frame = robot.model.frames[-1].name
    h = 1e-3
    pose = robot.frame_pose(frame, q)
    partials = robot.jacobian(frame, q)
    for r, e in enumerate(np.eye(robot.n)):
        T = [robot.frame_pose(frame, q + k * h * e) for k in (-2, -1, 1, 2)]
        rate = (T[0] - 8.0 * T[1] + 8.0 * T[2] - T[3]) / (12.0 * h)
        spin = rate[:3, :3] @ pose[:3, :3].T
        np.testing.assert_allclose(
            partials[:, r], [*rate[:3, 3], spin[2, 1], spin[0, 2], spin[1, 0]],
            atol=1e-8)


@given(robots_and_states(3))
def test_velocity_is_partials_times_speeds_and_acceleration_its_rate(drawn):
    robot, q, u, udot = drawn
    frame = robot.model.frames[-1].name
    h = 1e-3

    def velocity(t):
        return robot.frame_velocity(frame, q + t * (u + 0.5 * t * udot), u + t * udot)
    partials = robot.jacobian(frame, q)
    np.testing.assert_allclose(velocity(0.0), partials @ u,
                               atol=1e-12 * (1 + np.abs(u).sum()))
    v = [velocity(k * h) for k in (-2, -1, 1, 2)]
    acceleration = robot.frame_acceleration(frame, q, u, udot)
    np.testing.assert_allclose((v[0] - 8.0 * v[1] + 8.0 * v[2] - v[3]) / (12.0 * h),
                               acceleration,
                               atol=1e-6 * (1.0 + np.abs(acceleration).max()))


@given(robots_and_states(3))
def test_generalized_force_of_a_wrench_is_the_transposed_jacobian_times_it(drawn):
    robot, q, u, udot = drawn
    push = np.random.default_rng(1).normal(size=(1, 6))
    partials = robot.jacobian(robot.equations.wrench_frames[0].name, q)
    difference = (robot.inverse_dynamics(q, u, udot)
                  - robot.inverse_dynamics(q, u, udot, wrench=push))
    np.testing.assert_allclose(difference, partials.T @ push[0],
                               atol=1e-12 * scale(robot, q, u, udot))


@pytest.mark.parametrize('seed', range(4))
def test_energy_drift_of_the_simulation_falls_at_the_integrators_order(seed):
    model = random_model(seed, 4, passive=False, mimics=seed % 2)
    robot = Robot(model)
    q, u, _ = 0.5 * random_state(model, seed)

    def drift(step):
        total = simulate(robot, q, u, 0.512, step=step).energy.sum(axis=1)
        return np.abs(total - total[0]).max() / np.abs(robot.kinetic_energy(q, u))
    coarse, fine = drift(0.004), drift(0.002)
    assert coarse < 1e-4
    # 2^4 = 16 in the limit; 2^3 would be a fault.
    assert fine < max(coarse / 12.0, 1e-13)
