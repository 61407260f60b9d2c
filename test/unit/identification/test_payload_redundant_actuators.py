"""Payloads of machines with more actuators than speeds: a five-bar, three motors."""

from functools import cache

from kane_dynamics import box, InputError, Robot
from kane_dynamics.identification import identify_payload, PayloadEstimator, Recording
from kane_dynamics.identification.payload.payload_rows import PayloadRegressor
from kane_dynamics.loop_tracking.driven_mechanism import mechanism_motion
from kane_dynamics.mechanics.definition import nonholonomic
from kane_dynamics.mechanics.friction import coulomb
from kane_dynamics.model.model import with_payload
from linkages import five_bar, five_bar_at, five_bar_partial_rates
import numpy as np
import pytest

CRANKS = ('left_crank', 'right_crank')
MOTORS = ('left_crank', 'right_crank', 'right_bar')  # in the robot's order
LOAD = box(3.0, (0.2, 0.1, 0.1), at=(0.05, 0.0, 0.04))
RUNS = 12
SIGMA = np.array([0.3, 2.0, 0.6])  # N m


@cache
def arm():
    robot = five_bar(*MOTORS)
    return Robot(robot.model,
                 **{**robot.options, 'configuration': five_bar_at(2.0, 1.0)})


@cache
def carried():
    """Return t, the motion, T of the motors, least-norm torques by the definition."""
    robot = arm()
    heavy = Robot(with_payload(robot.model, 'left_tip', LOAD), **robot.options)
    t = np.arange(0.0, 6.0, 0.03)
    w = np.array([2.1, 3.3])
    a = np.array([0.5, 0.4])
    s = np.sin(np.outer(t, w))
    c = np.cos(np.outer(t, w))
    motion = mechanism_motion(robot, CRANKS, t, a * s + [2.0, 1.0], a * w * c,
                              -a * w**2 * s)
    places = [robot.joint_names.index(name) for name in MOTORS]
    T = np.array([five_bar_partial_rates(q)[places] for q in motion.q])
    force = np.array([nonholonomic.inverse_dynamics(heavy.mechanism, *sample)
                      for sample in zip(*motion, strict=True)])
    return t, motion, T, np.einsum('kna,kn->ka', np.linalg.pinv(T), force)


def preloaded(tau, T, rng):
    """Return torques of motors that work against each other by 20 N m."""
    against = np.linalg.svd(T)[0][:, :, 2]  # no force: T^T against = 0
    return tau + 20.0 * rng.normal(size=(len(tau), 1)) * against


def estimated_by_sample(seed=None):
    """Return the estimate from all samples, with motor noise unless the seed is None."""
    _, motion, T, tau = carried()
    rng = np.random.default_rng(seed)
    noise = 0.0 if seed is None else SIGMA * rng.normal(size=tau.shape)
    force = np.einsum('kan,ka->kn', T, preloaded(tau + noise, T, rng))
    estimator = PayloadEstimator(arm(), 'left_tip', SIGMA, memory=1e9)
    for sample in zip(*motion, force, strict=True):
        estimator.update(*sample)
    return estimator


def test_the_covariance_is_that_of_samples_with_an_unknown_preload_each():
    """Its rows are the motors' without their part along the unknown preload."""
    _, motion, T, _ = carried()
    estimator = estimated_by_sample()
    robot = arm()
    # offset, Coulomb and viscous friction that the model may lack
    model_error = 10.0 * SIGMA
    information = np.zeros((19, 19))
    information[:10, :10] = np.diag(np.repeat([10.0, 1.0, 0.3], [1, 3, 6])**-2.0)
    information[10:, 10:] = np.diag(np.repeat(model_error, 3)**-2.0)
    Y = PayloadRegressor(robot, 'left_tip')(*motion)
    for acting, forces, u in zip(T, Y, motion.u, strict=True):
        rates = acting @ u
        unknown = np.zeros((3, 9))
        for k, rate in enumerate(rates):
            unknown[k, 3 * k:3 * k + 3] = 1.0, float(coulomb(rate, 0.05)), rate
        rows = np.hstack([np.linalg.pinv(acting).T @ forces, unknown]) / SIGMA[:, None]
        along = np.linalg.svd(acting)[0][:, 2] / SIGMA
        rows -= np.outer(along, along @ rows) / (along @ along)
        information += rows.T @ rows
    expected = np.linalg.inv(information)[:10, :10]
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(estimator.covariance / np.outer(scale, scale),
                               expected / np.outer(scale, scale), atol=1e-6)


def test_z_scores_are_near_1_with_white_noise_of_the_motors():
    z_scores = []
    for seed in range(RUNS):
        estimator = estimated_by_sample(seed)
        assert estimator.mass_deviation < 0.2 * LOAD.mass
        z_scores.append((estimator.mass - LOAD.mass) / estimator.mass_deviation)
    assert 0.5 < np.sqrt(np.square(z_scores).mean()) < 1.5


def recording(seed, scale=0.0):
    t, motion, T, tau = carried()
    rng = np.random.default_rng(seed)
    places = [arm().joint_names.index(name) for name in MOTORS]
    noise = scale * SIGMA * rng.normal(size=tau.shape)
    return Recording(t, motion.q[:, places], np.einsum('kan,kn->ka', T, motion.u),
                     arm().joint_accelerations(*motion)[:, places],
                     preloaded(tau + noise, T, rng))


def test_a_recording_of_motors_that_work_against_each_other_weighs_the_load():
    payload = identify_payload(arm(), recording(0), 'left_tip')
    assert abs(payload.inertial.mass - LOAD.mass) < 2e-3 * LOAD.mass
    # In the plane; no force of the mechanism depends on the offset out of it.
    np.testing.assert_allclose(payload.inertial.com[[0, 2]], LOAD.com[[0, 2]], atol=2e-3)
    assert payload.residual.shape == (3,) and payload.residual.max() < 1e-3


def test_z_scores_of_recordings_are_near_1():
    scores = []
    for seed in range(RUNS):
        payload = identify_payload(arm(), recording(seed, 1.0), 'left_tip',
                                   torque_scale=0.0)
        scores.append((payload.inertial.mass - LOAD.mass) / payload.mass_deviation)
    assert 0.4 < np.sqrt(np.square(scores).mean()) < 1.5


def test_a_recorded_motor_that_contradicts_the_loop_is_named():
    recorded = recording(0)
    q = recorded.q.copy()
    q[40, 2] += 0.05
    with pytest.raises(InputError,
                       match=r"'right_bar' at .* at 1.2 s; expected .* follows from"):
        identify_payload(arm(), Recording(recorded.t, q, recorded.u, recorded.udot,
                                          recorded.tau), 'left_tip')


def test_motors_without_the_independent_joints_are_refused():
    robot = Robot(arm().model, **{**arm().options, 'actuated': ('left_crank', 'left_bar',
                                                                'right_bar')})
    with pytest.raises(InputError,
                       match=r'drive the others, left_crank, right_crank, among'):
        identify_payload(robot, recording(0), 'left_tip')
