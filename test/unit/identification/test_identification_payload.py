"""Promises of payload identification, on a simulated arm that carries 2 kg."""

from dataclasses import replace
from functools import cache
from pathlib import Path

from kane_dynamics import box, Inertial, InputError, load_urdf, ModelBuilder, Robot
from kane_dynamics.identification import (diagnose, identify, identify_payload,
                                          PayloadEstimator, Recording, torque_delays)
from kane_dynamics.identification.payload import payload_fit
from kane_dynamics.identification.payload.payload_rows import PayloadRows
from kane_dynamics.mechanics.recursive.regressor import parameters_of
from kane_dynamics.model.model import with_payload
from mechanisms import random_inertial
import numpy as np
import pytest
from recordings import simulated

URDF = Path(__file__).resolve().parents[3] / 'urdf' / 'ur10e.urdf'
LOAD = Inertial(2.0, np.array([0.03, -0.02, 0.08]), np.diag([0.02, 0.015, 0.01]))
FRICTION = {joint: {'damping': 3.0, 'friction': 4.0}
            for joint in load_urdf(URDF).joint_names}
PAYLOAD = {'link': 'tool0', 'mass': LOAD.mass, 'com': LOAD.com.tolist(), 'inertia': dict(
    zip(('ixx', 'iyy', 'izz'), np.diag(LOAD.inertia).tolist()))}


@cache
def bare():
    """Return the arm without its load."""
    return load_urdf(URDF, supplement={'joints': FRICTION})


@cache
def recording():
    """Return ten seconds of the arm with its load, torques with noise of 0.5 N m."""
    return simulated(
        load_urdf(URDF, supplement={'joints': FRICTION, 'payload': PAYLOAD}), 2, 0.5,
        duration=10.0)


def test_payload_is_found_to_2_percent_and_5_mm_within_three_deviations():
    payload = identify_payload(bare(), recording(), 'tool0')
    assert abs(payload.inertial.mass - LOAD.mass) < min(0.04,
                                                        3.0 * payload.mass_deviation)
    off = np.abs(payload.inertial.com - LOAD.com)
    assert np.linalg.norm(off) < 0.005
    assert (off < 3.0 * payload.com_deviation).all()
    assert np.abs(payload.inertial.inertia - LOAD.inertia).max() < 0.01
    assert (np.abs(payload.inertial.inertia - LOAD.inertia)
            < 3.0 * payload.inertia_deviation).all()
    assert np.allclose(payload.held_out, 0.5, rtol=0.15)
    assert 1.0 < payload.condition < 1e3
    assert np.linalg.eigvalsh(payload.inertial.pseudo_inertia)[0] > 0.0
    assert np.allclose(payload.residual, 0.5, rtol=0.1)


def test_payload_is_exact_without_noise():
    clean = simulated(
        load_urdf(URDF, supplement={'joints': FRICTION, 'payload': PAYLOAD}), 2,
        duration=4.0)
    payload = identify_payload(bare(), clean, 'tool0').inertial
    assert payload.mass == pytest.approx(LOAD.mass, rel=1e-4)
    assert np.abs(payload.com - LOAD.com).max() < 1e-4
    assert np.abs(payload.inertia - LOAD.inertia).max() < 1e-4


def test_deviations_of_the_inertia_are_the_spread_over_noises():
    clean = simulated(
        load_urdf(URDF, supplement={'joints': FRICTION, 'payload': PAYLOAD}), 2,
        duration=2.0)
    inertias = []
    for seed in range(12):
        noise = 0.05 * np.random.default_rng(seed).normal(size=clean.tau.shape)
        inertias.append(
            identify_payload(bare(), replace(clean, tau=clean.tau + noise), 'tool0',
                             torque_scale=0.0))
    for spread, deviation in ((np.std([f.inertial.mass for f in inertias]),
                               inertias[0].mass_deviation),
                              (np.std([f.inertial.com for f in inertias], axis=0),
                               inertias[0].com_deviation),
                              (np.std([f.inertial.inertia for f in inertias], axis=0),
                               inertias[0].inertia_deviation)):
        assert 0.6 < np.median(spread / deviation) < 1.4


def test_motion_that_cannot_tell_the_payload_does_not_look_sure_of_it():
    still = recording().rows(slice(0, 200))
    still = replace(still, q=np.zeros_like(still.q), u=np.zeros_like(still.u),
                    udot=np.zeros_like(still.udot))
    payload = identify_payload(bare(), still, 'tool0')
    assert payload.condition > 1e6
    assert payload.inertia_deviation.max() > 0.1


def test_payload_is_known_within_ten_seconds_of_motion_and_its_loss_is_noticed():
    estimator = PayloadEstimator(bare(), 'tool0', np.full(6, 0.5), memory=500.0)
    assert np.isnan(estimator.com).all()
    recorded = recording()
    for k in range(len(recorded)):
        estimator.update(recorded.q[k], recorded.u[k], recorded.udot[k], recorded.tau[k])
    assert abs(estimator.mass - 2.0) < min(0.04, 3.0 * estimator.mass_deviation)
    assert np.linalg.norm(estimator.com - LOAD.com) < 0.005
    assert (np.abs(estimator.com - LOAD.com) < 3.0 * estimator.com_deviation).all()
    empty = simulated(bare(), 2, 0.5, duration=20.0)
    for k in range(len(empty)):
        estimator.update(empty.q[k], empty.u[k], empty.udot[k], empty.tau[k])
    assert abs(estimator.mass) < 0.1


@pytest.mark.parametrize(('change', 'words'), [
    ({'tau': np.array([np.nan, *np.zeros(5)])},
     r"tau\[0\] \(joint 'shoulder_pan_joint'\): nan"),
    ({'tau': 3.0}, r'tau: shape \(\)'), ({'tau': np.zeros(5)}, r'tau: shape \(5,\)'),
    ({'tau': ['a'] * 6}, 'tau: dtype'), ({'u': np.full(6, np.inf)}, r'u\[0\] .*: inf'),
    ({'tau': np.full(6, 1e308)}, 'in a physical range'),
    ({name: np.zeros((2, 6)) for name in ('q', 'u', 'udot', 'tau')},
     'expected one sample')])
def test_sample_that_is_none_is_refused_and_leaves_the_estimate_as_it_was(change, words):
    estimator = PayloadEstimator(bare(), 'tool0', np.full(6, 0.5))
    recorded = recording()
    sample = {name: getattr(recorded, name)[7] for name in ('q', 'u', 'udot', 'tau')}
    estimator.update(**sample)
    estimate_before = estimator.mass, estimator.covariance
    with pytest.raises(InputError, match=words):
        estimator.update(**{**sample, **change})
    assert estimator.mass == estimate_before[0] > 0.0
    assert np.array_equal(estimator.covariance, estimate_before[1])


def test_recording_that_does_not_tell_the_mass_is_refused():
    for count in (0, 3, 19):
        with pytest.raises(InputError,
                           match=f'recording: {count} rows; expected at least 20'):
            identify_payload(bare(), recording().rows(slice(0, count)), 'tool0')
    small = load_urdf(URDF.with_name('two_link.urdf'))
    hanging = Recording(np.arange(30.0), np.tile([np.pi / 2, 0.0], (30, 1)),
                        *np.zeros((2, 30, 2)),
                        0.1 * np.random.default_rng(0).normal(size=(30, 2)))
    with pytest.raises(InputError,
                       match=r"the mass at 'tip' is not identifiable.* is 31\.6 kg"):
        identify_payload(small, hanging, 'tip')


def pendulum_recording(load, noise, seed):
    """Return a one-link model with a tool, and 10 s of motion with a load."""
    b = ModelBuilder('pendulum')
    b.body('link', axis=(0, 1, 0), inertial=box(2.0, (0.4, 0.1, 0.1), at=(0.2, 0, 0)))
    b.frame('tool', 'link', at=(0.3, 0.05, 0.0))
    model = b.model()
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 10.0, 401)
    w = 2.0 * np.pi * np.array([0.1, 0.2, 0.3])
    size = rng.uniform(0.2, 0.5, 3)
    phase = rng.uniform(0.0, 6.0, 3)
    angle = np.outer(t, w) + phase
    motion = [(np.sin(angle) @ size)[:, None], (np.cos(angle) @ (size * w))[:, None],
              (-np.sin(angle) @ (size * w**2))[:, None]]
    tau = Robot(with_payload(model, 'tool', load)).inverse_dynamics(*motion)
    return model, Recording(t, *motion, tau + noise * np.abs(tau).max() * rng.normal(
        size=tau.shape))


@pytest.mark.parametrize('noise', [0.0, 1e-5, 1e-3])
@pytest.mark.parametrize('seed', [0, 1, 2, 3, 7, 10])
def test_parameters_that_one_joint_does_not_show_keep_their_prior(
        noise, seed):
    load = random_inertial(np.random.default_rng(seed))
    model, motion = pendulum_recording(load, noise, seed)
    payload = identify_payload(model, motion, 'tool')
    assert 1.0 < payload.mass_deviation < 5.0  # kg
    assert abs(payload.inertial.mass - load.mass) < 2.0 * payload.mass_deviation
    assert np.linalg.eigvalsh(payload.inertial.pseudo_inertia)[0] > 0.0
    carried = Robot(with_payload(model, 'tool', payload.inertial))
    error = carried.inverse_dynamics(motion.q, motion.u, motion.udot) - motion.tau
    assert np.abs(error).max() < (1e-3 + 5.0 * noise) * np.abs(motion.tau).max()


@pytest.mark.parametrize('noise', [0.0, 1e-4])
@pytest.mark.parametrize('seed', range(3))
def test_no_physical_load_is_nearer_to_the_belief_than_the_estimate(
        noise, seed, monkeypatch):
    """The load that is carried explains the torques too: it cannot be more probable."""
    load = random_inertial(np.random.default_rng(seed))
    model, motion = pendulum_recording(load, noise, seed)
    problems = []

    def spied(information, weighted, belief):
        x, covariance = solved(information, weighted, belief)
        problems.append((information, weighted, belief, x))
        return x, covariance
    solved = payload_fit._solved
    monkeypatch.setattr(payload_fit, '_solved', spied)
    identify_payload(model, motion, 'tool')
    carried = parameters_of(load.pseudo_inertia)
    for *problem, x in problems:
        assert improbability(x, *problem) <= improbability(
            carried, *problem) * (1.0 + 1e-6)


def improbability(x, information, weighted, belief):
    """Return the squared misfit of parameters with rows and belief, in deviations."""
    values, V = payload_fit.in_beliefs(information, belief)
    known = values > 0.0
    misfit = (belief @ V[:, known]).T @ x - V[:, known].T @ weighted / values[known]
    change = x - parameters_of(payload_fit.START.pseudo_inertia)
    return values[known] @ misfit**2 + change @ belief @ change


@pytest.mark.parametrize('sigma', [1e-2, 1e-6, 1e-12])
@pytest.mark.parametrize('seed', range(2))
def test_an_estimate_is_not_sure_of_what_one_joint_does_not_tell_however_exact(
        sigma, seed):
    """The belief's deviation of the mass is 10 kg: a joint knows one moment of mass."""
    load = random_inertial(np.random.default_rng(seed))
    model, motion = pendulum_recording(load, 0.0, seed)
    estimator = PayloadEstimator(model, 'tool', [sigma])
    for sample in zip(motion.q, motion.u, motion.udot, motion.tau, strict=True):
        estimator.update(*sample)
    assert 1.0 < estimator.mass_deviation < 10.0
    assert abs(estimator.mass - load.mass) < 3.0 * estimator.mass_deviation
    assert np.diag(estimator.covariance).min() > 0.0


def test_a_load_that_no_joint_carries_is_refused():
    b = ModelBuilder('slides')
    b.body('slide', kind='prismatic', axis=(0, 1, 0), inertial=box(1.0, (0.1, 0.1, 0.1)))
    b.frame('tool', 'slide')
    steady = Recording(np.arange(30.0), *np.zeros((4, 30, 1)))
    with pytest.raises(InputError, match=r"the mass at 'tool' is not identifiable"):
        identify_payload(b.model(), steady, 'tool')


@pytest.mark.parametrize(('change', 'words'), [
    ({'frame': 'base_link'}, 'fixed in the world'), ({'frame': 'none'}, 'no frame'),
    ({'sigma': [1.0]}, 'expected 6 numbers of at least 1e-12'),
    ({'memory': 0.5}, 'more than 1 sample'),
    ({'sigma': 'a'}, "sigma: 'a'; expected 6 numbers"),
    ({'memory': 'a'}, "memory: 'a'; expected")])
def test_invalid_arguments_of_the_payload_estimator_are_refused(change, words):
    with pytest.raises(InputError, match=words):
        PayloadEstimator(
            **{'model': bare(), 'frame': 'tool0', 'sigma': np.ones(6), **change})


@pytest.mark.parametrize('function', [diagnose, identify, torque_delays])
def test_a_recording_of_another_model_is_refused_by_name(function):
    model = bare()
    recorded = recording()
    for arguments, words in (
            ((recorded, model), 'model: a Recording; expected a Model'),
            ((model, None), 'recording: a NoneType; expected a Recording'),
            ((model, recorded.rows(slice(1))), 'recording: 1 rows; expected at')):
        with pytest.raises(InputError, match=words):
            function(*arguments)
    with pytest.raises(InputError, match='recording: a str; expected a Recording'):
        identify_payload(model, 'tool0', recorded)


def test_recording_of_other_joints_is_refused():
    of_five_joints = replace(recording(), **{name: getattr(recording(), name)[:, :5]
                                             for name in ('q', 'u', 'udot', 'tau')})
    with pytest.raises(InputError, match='recording: 5 joints; expected 6: '):
        identify_payload(bare(), of_five_joints, 'tool0')


@pytest.mark.parametrize(('law', 'level'), [
    ({'friction': 3.0}, 3.0), ({'friction': 3.0, 'friction_backward': 5.0}, 5.0),
    ({'friction': 3.0, 'breakaway_friction': 4.0, 'stribeck_speed': 0.1}, 4.0),
    ({'friction': 3.0, 'load_friction': 0.1}, 3.0 + 0.1 * 20.0),
    ({'friction': 3.0, 'load_friction': 0.1, 'load_friction_backdriven': 0.2},
     3.0 + 0.2 * 20.0)])
def test_all_friction_that_holds_a_joint_at_rest_is_known_to_hold_it(law, level):
    model = load_urdf(URDF, supplement={'joints': {'elbow_joint': law}})
    rows = PayloadRows(model, 'tool0')
    elbow = model.joint_names.index('elbow_joint')
    q = np.full(6, 0.3)
    tau = np.full(6, -20.0)
    still = np.zeros(6)
    fast = np.ones(6)
    at_rest = rows(q, still, np.zeros(6), tau)
    assert at_rest.held[elbow] == pytest.approx(level, rel=1e-12)
    assert at_rest.held.sum() == pytest.approx(level, rel=1e-12)
    assert rows(q, fast, np.zeros(6), tau).held.max() < 1e-9
