"""Promises of physically consistent parameters: no physical ones are more probable."""

from kane_dynamics import box, Inertial, Robot
from kane_dynamics.identification.physical_consistency import (physical, prior_metric,
                                                               prior_parameters)
from kane_dynamics.mechanics.recursive.regressor import parameters_of
from mechanisms import random_model
import numpy as np
import pytest


def motion(rng, n):
    """Return q, u, udot of 10 s of random harmonics, (201, n) each."""
    t = np.linspace(0.0, 10.0, 201)[:, None]
    q, u, udot = np.zeros((3, 201, n))
    for w in 0.63 * np.arange(1.0, 5.0):
        size = rng.normal(size=n) * 0.5
        phase = rng.uniform(0.0, 6.0, n)
        q += size * np.sin(w * t + phase)
        u += size * w * np.cos(w * t + phase)
        udot -= size * w * w * np.sin(w * t + phase)
    return q, u, udot


@pytest.mark.parametrize('weight', [1.0, 1e-4, 1e-8])
@pytest.mark.parametrize('sigma', [1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize('seed', [3, 4, 5, 9])
def test_the_true_bodies_are_not_more_probable_than_those_that_are_found(
        seed, sigma, weight):
    """They are physical, and explain the torques but for their noise."""
    rng = np.random.default_rng(seed)
    model = random_model(seed, int(rng.integers(1, 4)), passive=False)
    robot = Robot(model)
    state = motion(rng, robot.n)
    Y = robot.regressor(*state)
    A = Y.reshape(-1, Y.shape[2]) / sigma
    b = robot.inverse_dynamics(*state).ravel() / sigma + rng.normal(size=len(A))
    prior = []
    for body in model.bodies:
        true = body.inertial
        com = true.com + 0.1 * rng.normal(size=3)
        prior.append(Inertial(true.mass * rng.uniform(0.5, 2.0), com,
                              true.inertia * rng.uniform(0.3, 2.0)))

    def improbability(x):
        distance = 0.0
        for inertial, parameters in zip(prior, x.reshape(-1, 10), strict=True):
            change = parameters - prior_parameters(inertial)
            distance += change @ prior_metric(inertial) @ change
        return np.sum((A @ x - b)**2) + weight * distance
    true = np.concatenate(
        [parameters_of(body.inertial.pseudo_inertia) for body in model.bodies])
    solution = physical(A, b, prior, np.zeros(0), weight)
    assert improbability(solution) <= improbability(true) * (1.0 + 1e-6)


def test_losses_that_nothing_determines_stay_small():
    """A zero column, and one twice another, beside a body of negative mass."""
    rng = np.random.default_rng(0)
    A = rng.normal(size=(40, 14))
    A[:, 12] = 0.0
    A[:, 13] = 2.0 * A[:, 11]
    x = np.concatenate([parameters_of(box(2.0, (0.1, 0.1, 0.2)).pseudo_inertia),
                        [0.3, 0.2, 0.0, 0.1]])
    x[0] = -1.0
    lowest = np.array([0.0, 0.0, 0.0, -np.inf])
    solution = physical(1e4 * A, 1e4 * A @ x, [box(1.0, (0.1, 0.2, 0.3))], lowest, 1e-4)
    assert np.abs(solution[10:]).max() < 10.0


@pytest.mark.parametrize('direction', [-1.0, 1.0])
@pytest.mark.parametrize('offset', [-2.0, 2.0])
def test_an_offset_that_looks_like_friction_is_found_where_friction_is_at_its_bound(
        direction, offset):
    """A joint that moves one way: friction and offset differ by a sign."""
    rng = np.random.default_rng(0)
    A = 1e4 * rng.normal(size=(60, 14))
    A[:, 13] = 1e4
    A[:, 11] = direction * A[:, 13]
    x = np.concatenate([parameters_of(box(2.0, (0.1, 0.1, 0.2)).pseudo_inertia),
                        [0.3, 0.0, 0.2, offset]])
    x[0] = -1.0  # no physical body: the program is needed
    lowest = np.array([0.0, 0.0, 0.0, -np.inf])
    solution = physical(A, A @ x, [box(1.0, (0.1, 0.2, 0.3))], lowest, 1e-4)
    # Without the column of friction the offset is the only explanation.
    without = np.delete(A, 11, axis=1)
    alone = physical(without, A @ x, [box(1.0, (0.1, 0.2, 0.3))], lowest[[0, 2, 3]],
                     1e-4)
    assert direction * solution[11] + solution[13] == pytest.approx(alone[12], abs=1e-3)
    np.testing.assert_allclose(solution[[10, 12]], alone[[10, 11]], atol=1e-3)
