"""Promises of exciting motions: better than random, within limits, at rest."""

from contextlib import nullcontext
from dataclasses import replace
from functools import cache
import math
from pathlib import Path

from kane_dynamics import (ComputedTorque, InputError, load_urdf, ModelWarning, Robot,
                           simulate)
from kane_dynamics.identification import base_parameters, excite, Recording, rows
from kane_dynamics.identification.base_regressor import true_unknowns
from kane_dynamics.identification.excitation.clearance import clearance_of
from kane_dynamics.identification.excitation.design_criterion import DesignCriterion
from kane_dynamics.identification.excitation.fourier_basis import FourierBasis
from kane_dynamics.identification.excitation.optimal_excitation import (largest_motion,
                                                                        random_motion)
from kane_dynamics.identification.regression import full_regressor
from mechanisms import with_bodies
import numpy as np
import pytest
from scipy.stats import chi2
import threadpoolctl

FOLDER = Path(__file__).resolve().parents[3] / 'urdf'
FLOOR = 0.05
SHARE = 0.8


@cache
def arm():
    """Return a six-axis arm with friction and armature."""
    urdf = FOLDER / 'ur10e.urdf'
    return load_urdf(urdf, supplement={'joints': {joint: {
        'armature': 0.2, 'damping': 3.0, 'friction': 4.0}
        for joint in load_urdf(urdf).joint_names}})


@cache
def exciting_motion():
    """Return a motion for the arm."""
    return excite(arm(), starts=1, share=SHARE, floor=FLOOR, distance=None)


def design(model, floor=None):
    """Return what motions of ten seconds are judged by."""
    clearance = clearance_of(model, None, floor, None)
    return DesignCriterion(model, FourierBasis(10.0, 5), SHARE, math.inf, math.inf,
                           clearance)


def test_condition_number_is_less_than_half_of_that_of_random_motions_in_limits():
    judge = design(arm())
    rng = np.random.default_rng(1)
    others = [largest_motion(judge, random_motion(judge, rng))[0] for _ in range(30)]
    conditions = [judge.condition(p) for p in others]
    motion = exciting_motion()
    assert motion.condition == pytest.approx(judge.condition(motion.coefficients))
    assert motion.condition < 0.5 * np.median(conditions)
    assert motion.condition < min(conditions)
    assert judge.cost(exciting_motion().coefficients,
                      0.0)[0] < min(judge.cost(p, 0.0)[0] for p in others)


def test_limits_are_kept_between_the_samples_of_the_search():
    t = np.random.default_rng(0).uniform(0.0, 10.0, 20_000)
    q, u, udot = exciting_motion().sample(t)
    robot = Robot(arm())
    limits = robot.limits
    tau = robot.inverse_dynamics(q, u, udot)
    for values, bound in ((q, limits.upper), (-q, -limits.lower),
                          (np.abs(u), limits.velocity),
                          (np.abs(tau), limits.effort)):
        assert (values.max(axis=0) <= SHARE * bound).all()
    assert (np.abs(u).max(axis=0) > 0.5 * SHARE * limits.velocity).all()
    assert min(robot.frame_pose(frame, q)[:, 2, 3].min()
               for frame in ('forearm_link', 'wrist_1_link', 'wrist_3_link')) >= FLOOR


def test_motion_starts_and_ends_at_rest_at_one_place():
    q, u, udot = exciting_motion().sample(np.array([0.0, 10.0]))
    assert np.abs(u).max() < 1e-12 and np.abs(udot).max() < 1e-12
    assert np.allclose(q[0], q[1], atol=1e-12)
    t = np.linspace(0.0, 10.0, 777)
    for sampled, exact in zip(exciting_motion().motion().sample(t),
                              exciting_motion().sample(t)):
        assert np.abs(sampled - exact)[:-1].max() < 2e-4


def test_series_is_its_own_derivatives():
    basis = FourierBasis(3.0, 4)
    t = np.linspace(0.1, 2.9, 50)
    h = 1e-5
    ahead, behind, at = (basis.at(t + d) for d in (h, -h, 0.0))
    assert np.allclose((ahead[0] - behind[0]) / (2 * h), at[1], atol=1e-7)
    assert np.allclose((ahead[1] - behind[1]) / (2 * h), at[2], atol=1e-6)


@pytest.mark.parametrize('weight', [0.0, 100.0])
def test_slope_of_the_cost_is_that_of_its_differences(weight):
    judge = design(arm(), 0.3)
    rng = np.random.default_rng(2)
    judge.effort = 0.2 * judge.effort  # so that every kind of limit is passed
    p = 1.5 * random_motion(judge, rng)
    direction = rng.normal(size=p.shape)
    rise = (judge.cost(p + 1e-5 * direction, weight)[0]
            - judge.cost(p - 1e-5 * direction, weight)[0]) / 2e-5
    assert np.sum(judge.cost(p, weight)[1] * direction) == pytest.approx(rise, rel=1e-3)


def test_recording_of_the_motion_gives_all_parameters_within_their_covariance():
    robot = Robot(arm())
    course = exciting_motion().motion(200.0)
    q, u, _ = exciting_motion().sample(np.zeros(1))
    run = simulate(robot, q[0], u[0], 10.0, step=1e-3, sample=5e-3,
                   torque=ComputedTorque(robot, course, 400.0, 40.0))
    noise = 0.5 * np.random.default_rng(3).normal(size=run.tau.shape)
    recording = Recording(run.t, run.q, run.u, run.udot, run.tau + noise)
    speeds = np.full(6, 0.05)
    base = base_parameters(arm(), speeds)
    X = full_regressor(rows(arm(), recording), speeds)[:, :, base.columns]
    X = X.reshape(-1, len(base.columns)) / 0.5
    estimate = np.linalg.lstsq(X, recording.tau.ravel() / 0.5, rcond=None)[0]
    # The squared error by the inverse covariance is chi-squared: 58 numbers together.
    off = X @ (estimate - base.B @ true_unknowns(arm()))
    low, high = chi2.interval(0.99, len(base.columns))
    assert low < off @ off < high


@cache
def small():
    """Return an arm of two joints."""
    return load_urdf(FOLDER / 'two_link.urdf')


def test_same_seed_gives_the_same_motion_and_another_does_not():
    again = []
    for seed in (1, 1, 2):
        again.append(excite(small(), seed=seed, velocity=2.0, harmonics=2,
                            distance=None).coefficients)
    assert np.array_equal(again[0], again[1]) and not np.allclose(again[0], again[2])


def test_further_limits_of_speed_and_acceleration_are_kept():
    got = excite(small(), velocity=[1.0, 2.0], acceleration=1.5, periods=2, starts=1,
                 share=1.0, distance=None)
    _, u, udot = got.sample(np.linspace(0.0, 10.0, 5000))
    assert (np.abs(u).max(axis=0) <= [1.0, 2.0]).all() and np.abs(udot).max() <= 1.5
    assert np.abs(udot).max() > 1.3
    assert got.motion().duration == 10.0 and got.basis.period == 5.0


@pytest.mark.parametrize(('change', 'words'), [
    ({'duration': 0.0}, 'duration: 0'),
    ({'harmonics': 1}, 'harmonics: 1; expected an integer'),
    ({'floor': float('nan')}, 'floor: nan; expected a finite height'),
    ({'share': 1.1}, 'share: 1.1'),
    ({'starts': 0}, 'starts: 0; expected an integer >= 1'),
    ({'seed': -1}, 'seed: -1; expected'),
    ({'periods': 1.5}, 'periods: 1.5; expected an integer'),
    ({'duration': 1e300}, r'duration: 1e\+300; expected'),
    ({'duration': 'a'}, "duration: 'a'"),
    ({'harmonics': 10**9}, 'harmonics: 1000000000; expected an integer from 2 to 1000'),
    ({'floor': 'a'}, "floor: 'a'; expected a finite height"),
    ({'distance': 'a'}, "distance: 'a'; expected a finite"),
    ({'share': None}, 'share: None'),
    ({'velocity': 0.0}, 'limits 0.0 of speed'),
    ({'acceleration': 0.0}, 'of acceleration'),
    ({'velocity': 1.0, 'floor': 100.0}, "motion: none satisfies link '.*' above 100 m")])
def test_an_invalid_search_for_an_exciting_motion_is_refused(change, words):
    with pytest.raises(InputError, match=words):
        excite(small(), **{'starts': 1, 'distance': None, **change})


def test_arm_that_cannot_hold_itself_is_refused_by_joint():
    def weakened(body):
        limits = replace(body.joint.limits, effort=1e-3)
        return replace(body, joint=replace(body.joint, limits=limits))
    weak = with_bodies(small(), weakened)
    with pytest.raises(InputError,
                       match="motion: none satisfies the effort limit of joint '"):
        excite(weak, starts=1, velocity=1.0, distance=None)


def test_search_without_shapes_says_that_links_are_not_kept_apart_and_uses_one_thread(
        monkeypatch):
    threads = []

    def limited(count):
        threads.append(count)
        return nullcontext()
    monkeypatch.setattr(threadpoolctl, 'threadpool_limits', limited)
    with pytest.warns(ModelWarning,
                      match='links are not kept apart.*load_collision_shapes'):
        excite(small(), velocity=2.0, harmonics=2, starts=1)
    assert threads == [1]
