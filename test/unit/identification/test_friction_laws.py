"""Identification chooses the friction law of an arm, the simplest within noise."""

from dataclasses import replace
from functools import cache
from pathlib import Path

from kane_dynamics import InputError, load_urdf, Robot
from kane_dynamics.identification import identify, Recording
from kane_dynamics.identification.friction_laws import (
    CandidateErrors, chosen_laws, clearly_smaller, LAW_NAMES, law_rows, LAWS, LENGTHS,
    period, phases, without_harm)
from kane_dynamics.identification.presliding import dahl_friction
from kane_dynamics.identification.regression import rows
import numpy as np
import pytest
from recordings import exciting

URDF = Path(__file__).resolve().parents[3] / 'urdf' / 'two_link.urdf'
LOSSES = {'damping': 1.5, 'friction': 2.0, 'friction_speed': 0.03, 'armature': 0.1}
NOISE = 0.05  # N m
TRAVEL = 0.004  # rad


@cache
def recording_of(law):
    """Return a recording of an arm with a law of friction, and the arm."""
    losses = dict(LOSSES)
    if 'load' in law:
        losses['load_friction'] = 0.15
    if 'quadratic' in law:
        losses['quadratic_damping'] = 1.2
    model = load_urdf(URDF, supplement={'joints': {'joint1': losses, 'joint2': losses}})
    t, q, u, udot = exciting(2, 3, duration=30.0, rate=100.0, harmonics=8)
    tau = Robot(model).inverse_dynamics(q, u, udot)
    if law == 'presliding':
        slip = np.tanh(u / LOSSES['friction_speed'])
        tau = tau + LOSSES['friction'] * (dahl_friction(q, [TRAVEL])[:, 0] - slip)
    noise = NOISE * np.random.default_rng(1).normal(size=tau.shape)
    return model, Recording(t, q, u, udot, tau + noise)


SLOW = ('quadratic', 'load and quadratic')


@pytest.mark.parametrize('law', [pytest.param(
    name, marks=pytest.mark.slow if name in SLOW else ()) for name in LAW_NAMES])
def test_the_law_of_the_arm_is_chosen_and_predicts_other_motion(law):
    _, recording = recording_of(law)
    identified = identify(load_urdf(URDF), recording, diagnosed=True)
    assert identified.laws == (law, law)
    assert (identified.held_out < 1.25 * NOISE).all()
    assert set(identified.candidates) == set(LAW_NAMES)
    chosen = identified.candidates[law].every
    for errors in identified.candidates.values():
        assert (chosen < 1.02 * errors.every).all()
    np.testing.assert_allclose(identified.losses[:, 1], 2.0, rtol=0.15)
    if 'load' in law:
        np.testing.assert_allclose(identified.load_friction, 0.15, rtol=0.15)
    if 'quadratic' in law:
        np.testing.assert_allclose(identified.quadratic_damping, 1.2, rtol=0.15)
    if law == 'presliding':
        np.testing.assert_allclose(identified.presliding, TRAVEL, rtol=0.4)
        # Bristles slide at the same friction after the same travel.
        for j, joint in enumerate(identified.model.coordinate_joints):
            travel = joint.friction / joint.presliding_stiffness
            assert travel == pytest.approx(identified.presliding[j])
    else:
        assert not identified.presliding.any()
        # The model has the law, and its torque is that of the fit.
        tau = Robot(identified.model).inverse_dynamics(recording.q, recording.u,
                                                       recording.udot)
        np.testing.assert_allclose(tau, identified.torque(recording), atol=1e-9)


def test_a_joint_for_which_the_law_of_the_arm_predicts_worse_has_coulomb_friction():
    plain = CandidateErrors(np.ones(4), np.array([1.0, 1.0, 1.0, np.nan]))
    richer = CandidateErrors(np.array([0.8, 1.06, 0.9, 0.9]),
                             np.array([1.0, 0.9, 1.06, np.nan]))
    laws = [LAWS[LAW_NAMES.index('presliding')]] * 4
    chosen_laws = without_harm(laws, {'coulomb': plain, 'presliding': richer})
    assert [law.name for law in chosen_laws] == ['presliding', 'coulomb', 'coulomb',
                                                 'presliding']


def test_presliding_is_left_out_of_joints_at_which_it_gains_nothing():
    plain = CandidateErrors(np.ones(2), np.ones(2))
    richer = CandidateErrors(np.array([0.99, 1.01]), np.ones(2))
    for name, second in (('presliding', 'coulomb'), ('load', 'load')):
        laws = without_harm([LAWS[LAW_NAMES.index(name)]] * 2,
                            {'coulomb': plain, name: richer})
        assert [law.name for law in laws] == [name, second]


def test_a_law_without_errors_does_no_harm():
    none = CandidateErrors(np.zeros(1), np.zeros(1))
    laws = [LAWS[LAW_NAMES.index('quadratic')]]
    with np.errstate(all='raise'):
        assert list(without_harm(laws, {'coulomb': none, 'quadratic': none})) == laws


def test_friction_speeds_of_laws_are_fitted_between_the_candidates():
    # Without noise the true speed leaves nothing, wherever it lies between candidates.
    _, recording = recording_of('load')
    model = load_urdf(URDF)
    for speed in (0.0274, 0.0431):
        losses = {**LOSSES, 'friction_speed': speed, 'load_friction': 0.15}
        arm = load_urdf(URDF,
                        supplement={'joints': {'joint1': losses, 'joint2': losses}})
        tau = Robot(arm).inverse_dynamics(recording.q, recording.u, recording.udot)
        exact = replace(recording, tau=tau)
        identified = identify(model, exact, friction='load', diagnosed=True)
        np.testing.assert_allclose(identified.friction_speed, speed, rtol=0.005)


def test_a_stated_law_is_that_of_all_joints_and_its_error_is_larger_where_it_is_wrong():
    _, recording = recording_of('load')
    stated = identify(load_urdf(URDF), recording, friction='coulomb', diagnosed=True)
    assert stated.laws == ('coulomb', 'coulomb') and stated.candidates == {}
    chosen = identify(load_urdf(URDF), recording, friction='load', diagnosed=True)
    assert (stated.held_out > 1.5 * chosen.held_out).any()


def test_bodies_and_offsets_follow_only_a_law_that_predicts_clearly_better():
    model = load_urdf(URDF)
    for law, follow in (('coulomb', False), ('quadratic', True)):
        _, recording = recording_of(law)
        plain = identify(model, recording, friction='coulomb', weight=1e3,
                         diagnosed=True)
        richer = identify(model, recording, friction='quadratic', weight=1e3,
                          diagnosed=True)
        size = 10 * len(model.bodies)
        unchanged = np.array_equal(richer.unknowns[:size], plain.unknowns[:size])
        kept_offsets = np.array_equal(richer.losses[:, 3], plain.losses[:, 3])
        assert unchanged == kept_offsets == (not follow)
        assert (richer.held_out < 1.25 * NOISE).all()


def test_a_law_that_gains_nothing_is_not_chosen_for_its_noise():
    # The load explains 4 %. The square of the rate explains nothing, with larger noise.
    noise = np.array([0.9, 1.1, 0.9, 1.1, 0.9, 1.1])[:, None] * np.ones((6, 3))
    errors = {'coulomb': np.ones((6, 3)), 'quadratic': noise,
              'load': np.full((6, 3), 0.96),
              'presliding': 2.0 * noise, 'load and quadratic': np.full((6, 3), 0.96)}
    laws = chosen_laws([errors[name] for name in LAW_NAMES], np.ones(3, dtype=bool))
    assert [law.name for law in laws] == ['load'] * 3


def test_a_joint_has_the_square_of_its_rate_only_where_it_gains():
    def candidate(*errors):
        return CandidateErrors(np.array(errors), np.array(errors))
    candidates = {'coulomb': candidate(1.0, 1.0, 1.0), 'load': candidate(0.8, 0.8, 0.8),
                  'quadratic': candidate(0.9, 0.995, 1.0),
                  'load and quadratic': candidate(0.7, 0.795, 0.9)}
    for name, simpler in (('quadratic', 'coulomb'), ('load and quadratic', 'load')):
        laws = without_harm([LAWS[LAW_NAMES.index(name)]] * 3, candidates)
        assert [law.name for law in laws] == [name, simpler, simpler]


def test_a_gain_is_clear_beyond_a_tenth_and_two_standard_errors():
    others = np.ones((6, 2))
    assert clearly_smaller(0.8 * others, others)
    assert not clearly_smaller(0.95 * others, others)
    unequal = np.array([0.2, 1.0, 1.1, 1.0, 1.1, 1.0])[:, None] * others
    assert not clearly_smaller(unequal, others)


def test_masses_that_are_not_fitted_are_not_taken_for_friction_of_the_load():
    model, recording = recording_of('load')
    identified = identify(model, recording, friction_only=True, diagnosed=True)
    assert identified.laws == ('coulomb', 'coulomb')


def test_bristles_of_a_recording_that_begins_in_motion_are_bent():
    model, recording = recording_of('presliding')
    k = int(np.argmax(np.abs(recording.u).min(axis=1)))
    whole = law_rows(rows(model, recording))
    later = law_rows(rows(model, recording.rows(slice(k, None))))
    # The first row has the friction that it has in the whole recording, for short
    # travels.
    least = np.abs(recording.q[k + 1] - recording.q[k]).min()
    short = [length for length in range(len(LENGTHS)) if 5.0 * LENGTHS[length] < least]
    assert short
    np.testing.assert_allclose(later.dahl[0, short], whole.dahl[k, short], atol=0.02)
    np.testing.assert_allclose(np.abs(later.dahl[0, short]), 1.0, atol=0.02)


def test_repeated_motion_is_no_test_of_a_fit():
    t = np.arange(0.0, 20.0, 0.01)
    w = 2.0 * np.pi / 5.0
    q = np.column_stack([np.sin(w * t), np.cos(2.0 * w * t) + 0.3 * np.sin(w * t)])
    u = np.gradient(q, t, axis=0)
    udot = np.zeros_like(q)
    periodic = Recording(t, q, u, udot, np.zeros_like(q))
    assert period(periodic) == pytest.approx(5.0, abs=0.015)
    place = phases(periodic)
    first = place < 0.5
    # Both halves hold rows of all periods, and no position with its speed is in both.
    assert first[:250].all() and not first[260:490].any() and first[510:740].all()
    t, q, u, udot = exciting(2, 3, duration=9.0)
    single = Recording(t, q, u, udot, np.zeros_like(q))
    assert period(single) is None
    assert (phases(single) < 0.5).sum() == len(t) // 2


def test_an_identified_model_has_no_term_of_the_given_model_that_was_not_fitted():
    _, recording = recording_of('coulomb')
    model = load_urdf(URDF, supplement={'joints': {'joint1': {
        'friction': 1.0, 'breakaway_friction': 3.0, 'stribeck_speed': 0.1,
        'load_friction': 0.2, 'quadratic_damping': 0.5,
        'presliding_stiffness': 50.0, 'presliding_damping': 0.1}}})
    identified = identify(model, recording, friction='coulomb', diagnosed=True)
    for joint in identified.model.coordinate_joints:
        assert joint.presliding_stiffness == joint.presliding_damping == 0.0
    assert (identified.held_out < 1.25 * NOISE).all()
    tau = Robot(identified.model).inverse_dynamics(recording.q, recording.u,
                                                   recording.udot)
    np.testing.assert_allclose(tau, identified.torque(recording), atol=1e-9)


@pytest.mark.parametrize(('arguments', 'words'), [
    ({'friction': 'glue'},
     "friction: 'glue'; expected one of select, coulomb, quadratic"),
    ({'friction': 'load', 'friction_only': True, 'bounded': False},
     "friction: 'load' with bounded=False; expected 'coulomb'")])
def test_unknown_laws_are_refused(arguments, words):
    _, recording = recording_of('coulomb')
    with pytest.raises(InputError, match=words):
        identify(load_urdf(URDF), replace(recording), diagnosed=True, **arguments)
