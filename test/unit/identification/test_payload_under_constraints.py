"""Payloads of closed loops: actuated joints other than the speeds, and noise."""

from functools import cache

from kane_dynamics import box, ConstraintError, InputError, Robot
from kane_dynamics.identification import identify_payload, PayloadEstimator, Recording
from kane_dynamics.loop_tracking.driven_mechanism import mechanism_motion
from kane_dynamics.mechanics.definition import nonholonomic
from kane_dynamics.model.model import with_payload
from kinds_of_mechanism import case
import numpy as np
from palletizer import DRIVEN, palletizer
import pytest

LOAD = box(20.0, (0.3, 0.2, 0.4), at=(0.05, 0.02, 0.25))
NOISE = 5.0
RUNS = 6


@cache
def carried():
    """Return t, the driving joints' motion, and torques by Kane's definition."""
    robot = palletizer()
    heavy = Robot(with_payload(robot.model, 'tool', LOAD), **robot.options)
    t = np.arange(0.0, 6.0, 0.05)
    w = np.array([0.7, 1.1, 1.3, 3.7])
    a = np.array([0.5, 0.3, 0.3, 1.0])
    s = np.sin(np.outer(t, w))
    c = np.cos(np.outer(t, w))
    state = a * s + [0.2, 0.1, -0.1, 0.5], a * w * c, -a * w**2 * s
    motion = mechanism_motion(robot, DRIVEN, t, *state)
    tau = np.array([nonholonomic.inverse_dynamics(heavy.mechanism, *sample)
                    for sample in zip(*motion)])
    return t, state, motion, tau


def recording(seed=None, noise=NOISE):
    """Return a recording of the palletizer's motors, in `actuated_names` order."""
    t, state, _, tau = carried()
    chance = 0.0 if seed is None else noise * np.random.default_rng(seed).normal(
        size=tau.shape)
    order = [DRIVEN.index(name) for name in palletizer().actuated_names]
    return Recording(t, *(x[:, order] for x in (*state, tau + chance)))


def test_exact_torques_of_the_motors_weigh_the_load_of_a_palletizer():
    payload = identify_payload(palletizer(), recording(), 'tool')
    assert abs(payload.inertial.mass - LOAD.mass) < 1e-4
    # The tool stays level: no force depends on the height of the load.
    np.testing.assert_allclose(payload.inertial.com[:2], LOAD.com[:2], atol=1e-3)
    assert payload.com_deviation[2] > 0.05
    assert payload.residual.max() < 1e-4


def identified_from_all_rows(seed):
    """Return mass, center of mass and deviations from all noisy rows."""
    payload = identify_payload(palletizer(), recording(seed), 'tool', torque_scale=0.0)
    return (payload.inertial.mass, payload.inertial.com, payload.mass_deviation,
            payload.com_deviation)


def estimated_by_sample(seed):
    """Return mass, center of mass and their deviations, sample by sample."""
    _, _, motion, tau = carried()
    estimator = PayloadEstimator(palletizer(), 'tool', np.full(4, NOISE), memory=2000.0)
    noisy = tau + NOISE * np.random.default_rng(seed).normal(size=tau.shape)
    for sample in zip(*motion, noisy):
        estimator.update(*sample)
    return (estimator.mass, estimator.com, estimator.mass_deviation,
            estimator.com_deviation)


@pytest.mark.parametrize('estimate', [identified_from_all_rows, estimated_by_sample])
def test_z_scores_of_a_closed_loop_are_near_1_with_white_noise(estimate):
    z_scores = []
    for seed in range(RUNS):
        mass, com, by_mass, by_com = estimate(seed)
        z_scores.append([(mass - LOAD.mass) / by_mass, *((com - LOAD.com) / by_com)[:2]])
    assert 0.3 < np.sqrt(np.square(z_scores).mean()) < 1.5


@cache
def rocking():
    """Return a four-bar in its crank's speed, with the actuator at its rocker."""
    robot = case('closed loop').robot
    options = {**robot.options, 'independent': ['crank'], 'actuated': ['rocker']}
    return robot.model, options, Robot(robot.model, **options)


def rocking_samples(count=400):
    """Return states of the linkage and the rocker's torque by Kane's definition."""
    model, options, robot = rocking()
    heavy = Robot(with_payload(model, 'tool', LOAD), **options)
    t = 0.01 * np.arange(count)
    state = (0.8 + 0.5 * np.sin(2.0 * t), np.cos(2.0 * t), -2.0 * np.sin(2.0 * t))
    motion = mechanism_motion(robot, ['crank'], t, *(x[:, None] for x in state))
    force = [nonholonomic.inverse_dynamics(heavy.mechanism, *sample)
             for sample in zip(*motion)]
    T = np.array(
        [nonholonomic.joint_motion(heavy.mechanism, q, np.ones(1), np.zeros(1))[0]
         for q in motion.q])
    return (t, motion, np.array(force),
            np.array(force) / T[:, [robot.joint_names.index('rocker')]])


def test_noise_of_an_actuator_counts_at_its_joint_not_at_the_independent_speed():
    """The rocker turns slower than the crank, by a ratio that varies."""
    robot = rocking()[-1]
    _, motion, _, torque = rocking_samples()
    deviations = []
    for seed in range(RUNS):
        noisy = torque + 2.0 * np.random.default_rng(seed).normal(size=torque.shape)
        estimator = PayloadEstimator(robot, 'tool', [2.0], memory=1e5)
        for q, u, udot, actual in zip(*motion, noisy):
            torques = np.zeros(robot.n_q)
            torques[robot.joint_names.index('rocker')] = actual[0]
            estimator.update(q, u, udot, robot.generalized_force(torques, q))
        deviations.append((estimator.mass - LOAD.mass) / estimator.mass_deviation)
    assert 0.3 < np.sqrt(np.square(deviations).mean()) < 1.5


def test_recording_of_the_actuated_joint_alone_is_completed_by_the_loop():
    robot = rocking()[-1]
    t, motion, _, torque = rocking_samples()
    rate = robot.joint_rates(motion.q, motion.u)
    slope = robot.joint_accelerations(*motion)
    at = [robot.joint_names.index('rocker')]
    payload = identify_payload(robot, Recording(
        t, motion.q[:, at], rate[:, at], slope[:, at], torque), 'tool')
    assert payload.residual.max() < 1e-3 * np.abs(torque).max()


def test_a_payload_that_cannot_be_estimated_is_refused_by_name():
    robot = palletizer()
    rolling = case('nonholonomic').robot
    model, options, _ = rocking()
    shared = Robot(model, **{**options, 'actuated': ['crank', 'rocker']})
    zero = np.zeros((30, 1))
    with pytest.raises(InputError,
                       match=r'sigma: .*; expected 2 numbers of at least 1e-12, of '
                       'crank, roc'):
        PayloadEstimator(shared, 'tool', [1.0])
    with pytest.raises(InputError,
                       match=r'sigma: \[1\.0\]; expected 4 numbers of at least '
                       '1e-12, of swiv'):
        PayloadEstimator(robot, 'tool', [1.0])
    with pytest.raises(InputError,
                       match=r'sigma: .*inf.*; expected 4 numbers of at least '
                       '1e-12, of swiv'):
        PayloadEstimator(robot, 'tool', [1.0, np.inf, 1.0, 1.0])
    with pytest.raises(InputError, match="constraint 'runner' is one of velocities"):
        identify_payload(rolling, Recording(np.arange(30.0), *[zero] * 4), 'tool')
    with pytest.raises(InputError,
                       match='recording: 1 joints; expected 4: swivel, shoulder'):
        identify_payload(robot, Recording(np.arange(30.0), *[zero] * 4), 'tool')
    estimator = PayloadEstimator(robot, 'tool', np.ones(4))
    _, _, (Q, U, _), tau = carried()
    estimator.update(Q[0], U[0], U[0], tau[0])
    estimate_before = estimator.covariance
    with pytest.raises(ConstraintError, match='its residual is'):
        estimator.update(Q[0] + np.linspace(0.0, 0.5, robot.n_q), U[0], U[0], tau[0])
    with pytest.raises(InputError, match=r't .s.: nan'):
        estimator.update(Q[0], U[0], U[0], tau[0], t=np.nan)
    assert np.array_equal(estimator.covariance, estimate_before)
