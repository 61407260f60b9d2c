"""Robots beyond the instruction cache: every kernel gives Kane's numbers."""

from benchmarks.big_robots import human_hand, two_hands
from definition import Definition, relative_error
from kane_dynamics import Robot
import numpy as np
import pytest


@pytest.fixture(scope='module', params=[
    human_hand, pytest.param(two_hands, marks=pytest.mark.slow)])
def robot(request):
    """Return a hand, or a tree of 50 axes with two of them."""
    return Robot(request.param())


@pytest.fixture(scope='module')
def states(robot):
    """Return a few q, u and udot."""
    return np.random.default_rng(5).uniform(-1.0, 1.0, (3, 3, robot.n))


def test_every_kernel_compiles_and_is_the_definitions(robot, states):
    robot.compile()
    assert robot.verify(2) < 1e-9
    by_definition = Definition(robot.model)
    q = states[0, 0]
    M = by_definition.mass_matrix(q)
    error = relative_error(robot.inverse_mass_matrix(q) @ M, np.eye(robot.n))
    assert error < 1e-15 * np.linalg.cond(M)


def test_products_with_the_inverse_mass_matrix_undo_inverse_dynamics(robot, states):
    for q, u, udot in states:
        tau = robot.inverse_dynamics(q, u, udot)
        by_q, by_u, M = robot.inverse_dynamics_derivatives(q, u, udot)
        forward_q, forward_u, W = robot.forward_dynamics_derivatives(q, u, tau)
        tolerance = 1e-13 * np.linalg.cond(M)
        for product, expected in ((M @ forward_q, -by_q), (M @ forward_u, -by_u)):
            assert np.abs(product - expected).max() < tolerance * np.abs(expected).max()
        assert np.abs(M @ W - np.eye(robot.n)).max() < tolerance


@pytest.mark.slow
def test_a_batch_takes_shared_parts_along():
    robot = Robot(human_hand())
    states = np.random.default_rng(5).uniform(-1.0, 1.0, (3, 3, robot.n))
    for name in ('inverse_dynamics_derivatives', 'forward_dynamics_derivatives'):
        together = getattr(robot, name)(*states.transpose(1, 0, 2))
        for k, state in enumerate(states):
            for one, many in zip(getattr(robot, name)(*state), together):
                assert relative_error(many[k], one) < 1e-9
    assert relative_error(robot.regressor(*states.transpose(1, 0, 2))[1],
                          robot.regressor(*states[1])) < 1e-13
