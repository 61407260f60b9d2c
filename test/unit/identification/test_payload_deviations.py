"""Promises of a payload's standard deviations: z scores near 1 over seeds."""

from functools import cache
from pathlib import Path

from kane_dynamics import Inertial, load_urdf, Robot
from kane_dynamics.identification import identify_payload, PayloadEstimator, Recording
import numpy as np
import pytest
from recordings import exciting
from scipy.signal import lfilter

URDF = Path(__file__).resolve().parents[3] / 'urdf' / 'ur10e.urdf'
LOAD = Inertial(2.0, np.array([0.03, -0.02, 0.08]), np.diag([0.02, 0.015, 0.01]))
NOISE = 0.5
RUNS = 10


@cache
def arm():
    """Return the arm alone, as the estimators know it."""
    return load_urdf(URDF)


@cache
def carrying():
    """Return the robot that is measured."""
    inertia = dict(zip(('ixx', 'iyy', 'izz'), np.diag(LOAD.inertia).tolist(),
                       strict=True))
    return Robot(load_urdf(URDF, supplement={'payload': {
        'link': 'tool0', 'mass': LOAD.mass, 'com': LOAD.com.tolist(),
        'inertia': inertia}}))


def coloured(rng, shape, correlation=0.98):
    """Return first-order noise of deviation NOISE, correlated over 0.5 s, N m."""
    white = rng.normal(size=shape) * np.sqrt(1.0 - correlation**2)
    white[0] = rng.normal(size=shape[1])
    return NOISE * lfilter([1.0], [1.0, -correlation], white, axis=0)


def measured(seed, *, unknown, duration=10.0, noise=NOISE):
    """Return a recording; `unknown` adds friction, offsets and coloured noise."""
    rng = np.random.default_rng(seed)
    t, q, u, udot = exciting(6, seed, duration=duration)
    tau = carrying().inverse_dynamics(q, u, udot) + noise * rng.normal(size=q.shape)
    if 'friction' in unknown:
        tau += rng.uniform(0.0, 8.0, 6) * np.tanh(u / 0.02)
    if 'offset' in unknown:
        tau += 3.0 * rng.normal(size=6)
    if 'colour' in unknown:
        tau += coloured(rng, tau.shape)
    return Recording(t, q, u, udot, tau)


def estimated_by_sample(recording):
    """Return mass, center of mass and their deviations, estimated sample by sample."""
    estimator = PayloadEstimator(arm(), 'tool0', np.full(6, NOISE), memory=2000.0)
    for sample in zip(recording.q, recording.u, recording.udot, recording.tau,
                      strict=True):
        estimator.update(*sample)
    return (estimator.mass, estimator.com, estimator.mass_deviation,
            estimator.com_deviation)


def identified_from_all_rows(recording):
    """Return mass, center of mass and their deviations, identified from all rows."""
    payload = identify_payload(arm(), recording, 'tool0', torque_scale=0.0)
    return (payload.inertial.mass, payload.inertial.com, payload.mass_deviation,
            payload.com_deviation)


def scores(estimate, unknown, **motion):
    """Return the rms z score of mass and center of mass over seeded runs."""
    z_scores = []
    for seed in range(RUNS):
        mass, com, by_mass, by_com = estimate(measured(seed, unknown=unknown, **motion))
        z_scores.append([(mass - LOAD.mass) / by_mass, *((com - LOAD.com) / by_com)])
    squares = np.square(z_scores)
    return np.sqrt(squares[:, 0].mean()), np.sqrt(squares[:, 1:].mean())


@pytest.mark.parametrize('estimate', [estimated_by_sample, identified_from_all_rows])
def test_z_scores_are_near_1_with_white_noise(estimate):
    for score in scores(estimate, ()):
        assert 0.5 < score < 1.5


@pytest.mark.parametrize(('estimate', 'unknown'), [
    *(pytest.param(identified_from_all_rows, (unknown,), marks=pytest.mark.slow)
      for unknown in ('friction', 'offset', 'colour')),
    (identified_from_all_rows, ('friction', 'offset', 'colour')),
    (estimated_by_sample, ('friction', 'offset', 'colour')),
    pytest.param(estimated_by_sample, ('friction', 'offset'), marks=pytest.mark.slow)])
def test_z_scores_are_below_1_5_with_friction_offsets_and_coloured_noise(
        estimate, unknown):
    for score in scores(estimate, unknown):
        assert score < 1.5


def test_noise_that_is_larger_than_told_widens_the_deviation_alike():
    for score in scores(estimated_by_sample, (), noise=4.0 * NOISE):
        assert 0.5 < score < 1.5


def test_arm_at_rest_with_unknown_offsets_is_not_sure_of_the_mass():
    rng = np.random.default_rng(0)
    tau = carrying().gravity_force(np.full(6, 0.3))
    zero = np.zeros((500, 6))
    tau = tau + [0.0, 3.0, 3.0, 1.0, 1.0, 1.0] + NOISE * rng.normal(size=zero.shape)
    mass, _, deviation, _ = estimated_by_sample(
        Recording(0.01 * np.arange(500), zero + 0.3, zero, zero, tau))
    assert abs(mass - LOAD.mass) > 0.05
    assert abs(mass - LOAD.mass) < 1.5 * deviation


def test_arm_at_rest_with_exact_sensors_weighs_the_load_to_50_grams():
    """Possible sensor offsets hide a load at rest; exact sensors have none."""
    q = np.full(6, 0.3)
    zero = np.zeros(6)
    estimator = PayloadEstimator(arm(), 'tool0', np.full(6, 0.01), memory=30.0)
    for _ in range(50):
        estimator.update(q, zero, zero, carrying().gravity_force(q))
    assert abs(estimator.mass - LOAD.mass) < min(0.05, 3.0 * estimator.mass_deviation)


def test_the_deviation_of_a_mass_covers_a_wrong_torque_constant():
    t, q, u, udot = exciting(6, 5, duration=10.0)
    alone = Robot(arm()).inverse_dynamics(q, u, udot)
    loaded = carrying().inverse_dynamics(q, u, udot)
    tau = alone + 1.08 * (loaded - alone)
    payload = identify_payload(arm(), Recording(t, q, u, udot, tau), 'tool0')
    assert abs(payload.inertial.mass - LOAD.mass) < 2.0 * payload.mass_deviation
    noise = np.random.default_rng(1).normal(size=q.shape)
    empty = identify_payload(arm(), Recording(t, q, u, udot, alone + noise), 'tool0')
    assert payload.is_present and not empty.is_present
    assert np.isinf(empty.com_deviation).all()
