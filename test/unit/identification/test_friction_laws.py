"""Identification chooses the friction law of an arm, the simplest within noise."""

from dataclasses import replace
from functools import cache
from pathlib import Path

from kane_dynamics import InputError, load_urdf, Robot
from kane_dynamics.identification import identify, Recording
from kane_dynamics.identification.friction_laws import (
    Blocks, chosen_laws, clearly_smaller, costs_others, LAW_NAMES, law_rows, LawFit,
    LAWS, LENGTHS, period, phases, Prior, without_harm)
from kane_dynamics.identification.presliding import dahl_friction, first_rows
from kane_dynamics.identification.regression import rows, SPEEDS
from kane_dynamics.mechanics.recursive.regressor import inertial_parameters
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


def errors_of(**laws):
    """Return errors of all laws on 6 blocks: those given, else those of Coulomb."""
    blocks = 1.0 + 0.2 * np.array([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0])[:, None]
    plain = laws.get('coulomb', np.ones_like(next(iter(laws.values()))))
    return [blocks * np.atleast_2d(laws.get(name.replace(' ', '_'), plain))
            for name in LAW_NAMES]


def test_a_joint_has_the_law_of_the_arm_only_where_it_helps():
    alternating = np.array([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0])
    gains = np.tile(np.log([0.8, 1.2, 1.03, 1.2, 0.9]), (6, 1))
    gains[:, 3] += 0.5 * alternating  # larger on the mean, within its noise
    for name, expected in (('presliding', [True, False, False, False, True]),
                           ('load', [True, False, True, True, True])):
        laws = [LAWS[LAW_NAMES.index(name)]] * 5
        found = without_harm(laws, errors_of(**{name: np.exp(gains)}))
        assert [law.name == name for law in found] == expected


def test_presliding_of_a_joint_needs_a_gain_beyond_its_noise_or_that_of_alike_drives():
    alternating = np.array([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0])
    laws = [LAWS[LAW_NAMES.index('presliding')]] * 4
    noisy = -0.1 + 0.2 * alternating  # 1.1 standard errors
    for others, expected in ((0.0, 'coulomb'), (-0.1, 'presliding')):
        gains = np.full((6, 4), others)
        gains[:, 1] = noisy
        found = without_harm(laws, errors_of(presliding=np.exp(gains)))
        assert found[1].name == expected


def test_a_joint_has_another_law_than_the_arm_only_beyond_chance():
    noise = 0.05 * np.array([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0])
    # 2.3 and 13 standard errors.
    for gain, name in ((0.95, 'coulomb'), (0.75, 'quadratic')):
        of_joints = np.exp(noise[:, None] * np.array([1.0, -1.0, 1.0, -1.0]))
        quadratic = of_joints * np.array([1.1, 1.1, 1.1, gain])
        laws = chosen_laws(errors_of(quadratic=quadratic), np.ones(4, dtype=bool))
        assert [law.name for law in laws] == [*['coulomb'] * 3, name]


def test_a_motion_that_coulomb_friction_explains_exactly_has_no_other_law():
    model = load_urdf(URDF)
    t, q, u, udot = exciting(2, 3)
    exact = Recording(t, q, u, udot, Robot(model).inverse_dynamics(q, u, udot))
    with np.errstate(all='raise'):
        assert identify(model, exact, diagnosed=True).laws == ('coulomb', 'coulomb')


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


def test_a_friction_speed_below_all_moving_rows_stays_between_the_candidates():
    # Rows in motion are faster than 0.02 rad/s, where friction is then constant.
    _, recording = recording_of('load')
    losses = {**LOSSES, 'friction_speed': 1e-3, 'load_friction': 0.15}
    arm = load_urdf(URDF, supplement={'joints': {'joint1': losses, 'joint2': losses}})
    tau = Robot(arm).inverse_dynamics(recording.q, recording.u, recording.udot)
    identified = identify(load_urdf(URDF), replace(recording, tau=tau),
                          friction='load', diagnosed=True)
    assert (identified.friction_speed >= SPEEDS[0]).all()
    assert (identified.friction_speed < 0.01).all()


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
    errors = errors_of(load=[0.8, 0.8, 0.8], quadratic=[0.9, 0.995, 1.0],
                       load_and_quadratic=[0.7, 0.795, 0.9])
    for name, simpler in (('quadratic', 'coulomb'), ('load and quadratic', 'load')):
        laws = without_harm([LAWS[LAW_NAMES.index(name)]] * 3, errors)
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


@pytest.mark.parametrize('rate', [100.0, 1000.0])
def test_bristles_of_a_recording_that_begins_in_motion_are_bent(rate):
    model = load_urdf(URDF)
    t, q, u, udot = exciting(2, 3, duration=4.0, rate=rate)
    recording = Recording(t, q, u, udot, np.zeros_like(q))
    whole = law_rows(rows(model, recording))
    longest = np.zeros(2, dtype=int)
    for k in np.linspace(0.3, 0.9, 13, endpoint=False) * len(t):
        row = int(k)
        later = law_rows(rows(model, recording.rows(slice(row, None))))
        for j in range(2):
            # What a joint has slid since it last reversed, in the whole recording.
            reversals = np.flatnonzero(np.diff(np.sign(u[:row + 1, j])))
            last = reversals[-1] if len(reversals) else 0
            short = np.abs(q[row, j] - q[last, j]) > 8.0 * LENGTHS
            longest[j] = max(longest[j], short.sum())
            first = later.dahl[0, short, j]
            np.testing.assert_allclose(first, whole.dahl[row, short, j], atol=0.02)
            np.testing.assert_allclose(first, np.sign(u[row, j]), atol=0.02)
    assert (longest > 10).all()


def test_bristles_of_a_joint_at_rest_are_straight_when_a_recording_begins():
    model = load_urdf(URDF)
    t, q, u, udot = exciting(2, 3, duration=1.0)
    u[0, 0] = 0.01
    first = law_rows(rows(model, Recording(t, q, u, udot, np.zeros_like(q)))).dahl[0]
    assert not first[:, 0].any() and first[:, 1].all()


def test_bristles_remember_nothing_of_another_motion_in_the_same_recording():
    model = load_urdf(URDF)
    t, q, u, udot = exciting(2, 3, duration=4.0)
    alone = Recording(t, q, u, udot, np.zeros_like(q))
    other = exciting(2, 4, duration=4.0)
    both = [np.concatenate(pair) for pair in zip((q, u, udot), other[1:])]
    times = np.arange(len(both[0])) * 0.01
    whole = law_rows(rows(model, Recording(times, *both, np.zeros_like(both[0]))))
    np.testing.assert_array_equal(whole.dahl[:len(t)], law_rows(rows(model, alone)).dahl)
    second = Recording(*other, np.zeros_like(q))
    np.testing.assert_array_equal(whole.dahl[len(t):],
                                  law_rows(rows(model, second)).dahl)


@pytest.mark.parametrize('rate', [100.0, 1000.0])
def test_steps_of_a_coarse_encoder_begin_no_motion(rate):
    # 12 bits a turn, 1.5 mrad: in slow motion most rows are equal.
    resolution = 2.0 * np.pi / 2**12
    for speed in (0.02, 0.1, 1.0):
        t, q, _, _ = exciting(2, 3, duration=8.0, rate=rate, speed=speed)
        measured = resolution * np.round(q / resolution)
        assert np.abs(np.diff(measured, axis=0)).max() > LENGTHS[0]
        np.testing.assert_array_equal(first_rows(t, measured, LENGTHS[0]), [0])
        # A motion that is joined to it begins again.
        joined = np.concatenate([measured, measured[::-1] + 0.1])
        times = np.arange(len(joined)) / rate
        begins = first_rows(times, joined, LENGTHS[0])
        np.testing.assert_array_equal(begins, [0, len(t)])


def test_presliding_of_slow_motion_is_found_with_a_coarse_encoder():
    t, q, u, udot = exciting(2, 3, duration=20.0, rate=300.0, speed=0.15)
    arm = load_urdf(URDF, supplement={'joints': {'joint1': LOSSES, 'joint2': LOSSES}})
    presliding = dahl_friction(q, [TRAVEL])[:, 0]
    smooth = np.tanh(u / LOSSES['friction_speed'])
    noise = NOISE * np.random.default_rng(1).normal(size=q.shape)
    tau = Robot(arm).inverse_dynamics(q, u, udot) + noise
    tau += LOSSES['friction'] * (presliding - smooth)
    resolution = 2.0 * np.pi / 2**12
    measured = resolution * np.round(q / resolution)
    recording = Recording(t, measured, u, udot, tau)
    chosen = identify(load_urdf(URDF), recording, diagnosed=True)
    plain = identify(load_urdf(URDF), recording, friction='coulomb', diagnosed=True)
    assert chosen.laws == ('presliding', 'presliding')
    np.testing.assert_allclose(chosen.presliding, TRAVEL, rtol=0.3)
    assert (chosen.held_out < 0.4 * plain.held_out).all()


def test_motions_without_speeds_begin_again_where_they_are_joined():
    # Differences of positions are as fast as the jump itself.
    model = load_urdf(URDF)
    parts = [exciting(2, seed, duration=4.0) for seed in (3, 4)]
    q = np.concatenate([part[1] for part in parts])
    t = np.arange(len(q)) * 0.01
    u = np.gradient(q, t, axis=0)
    udot = np.gradient(u, t, axis=0)
    joined = Recording(t, q, u, udot, np.zeros_like(q), derived=('u', 'udot'))
    half = len(parts[0][1])
    later = law_rows(rows(model, joined.rows(slice(half, None))))
    np.testing.assert_array_equal(law_rows(rows(model, joined)).dahl[half:], later.dahl)


@pytest.mark.parametrize('n', [2, 7])
def test_noise_alone_gives_one_of_six_arms_a_joint_with_another_law(n):
    # Errors of left-out blocks that differ by noise, of laws with a load alike.
    rng = np.random.default_rng(8)
    count = 2000
    chosen = 0
    logarithms = np.zeros((len(LAWS), 6, n))
    loaded = np.ones(n, dtype=bool)
    load = LAW_NAMES.index('load')
    for _ in range(count):
        logarithms = 0.1 * rng.normal(size=logarithms.shape)
        logarithms[LAW_NAMES.index('load and quadratic')] += logarithms[load]
        laws = chosen_laws(list(np.exp(logarithms)), loaded)
        chosen += any(law.name != 'coulomb' for law in laws)
    assert chosen < count / 6.0
    # A gain in all blocks is that of the law.
    logarithms[load] -= 0.6
    laws = chosen_laws(list(np.exp(logarithms)), loaded)
    assert {law.name for law in laws} == {'load'}


def test_loads_of_single_joints_may_cost_no_other_joint_a_twentieth():
    load, coulomb = (LAWS[LAW_NAMES.index(name)] for name in ('load', 'coulomb'))
    plain = np.ones((6, 3))
    laws = coulomb, load, coulomb
    # Others count by their mean over the blocks, the joint with the load not at all.
    uneven = np.array([0.5, 1.6, 1.0, 1.0, 1.0, 0.9])
    for of_third, expected in ((1.03, False), (1.08, True)):
        errors = np.column_stack([np.ones(6), 2.0 * uneven, of_third * uneven**0.1])
        assert costs_others(laws, errors, plain) == expected


def test_the_load_of_one_joint_is_found():
    # The first joint is horizontal here: gravity loads both.
    losses = {'joint1': LOSSES, 'joint2': {**LOSSES, 'load_friction': 0.3}}
    arm = load_urdf(URDF, supplement={'joints': losses})
    t, q, u, udot = exciting(2, 5, duration=20.0, speed=2.0)
    tau = Robot(arm).inverse_dynamics(q, u, udot)
    noise = np.random.default_rng(3).normal(size=q.shape)
    recording = Recording(t, q, u, udot, tau + NOISE * noise)
    identified = identify(load_urdf(URDF), recording, diagnosed=True)
    assert identified.laws[1] == 'load'
    assert identified.load_friction[1] == pytest.approx(0.3, abs=0.03)
    assert (identified.held_out < 1.25 * NOISE).all()


def test_the_law_of_an_arm_gains_in_most_blocks():
    # The same mean gain over six blocks, of one block alone or of all.
    plain = np.ones((6, 3))
    lucky = np.array([0.4, 1.0, 1.02, 0.98, 1.01, 1.0])[:, None] * plain
    steady = np.array([0.86, 0.85, 0.87, 0.84, 0.86, 0.85])[:, None] * plain
    for errors, name in ((lucky, 'coulomb'), (steady, 'load')):
        candidates = dict.fromkeys(LAW_NAMES, 1.2 * plain)
        candidates.update({'coulomb': plain, 'load': errors})
        laws = chosen_laws(list(candidates.values()), np.ones(3, dtype=bool))
        assert [law.name for law in laws] == [name] * 3


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


def test_a_prior_counts_as_much_for_all_blocks_but_one_as_for_all():
    # Blocks are copies of one recording. With the weight in proportion to their number,
    # the errors on a block that is left out do not depend on that number.
    model, recording = recording_of('coulomb')
    part = recording.rows(slice(0, 400))
    n = model.n
    start = LawFit((LAWS[0],) * n, inertial_parameters(model).ravel(), np.zeros((n, 6)),
                   np.full(n, LOSSES['friction_speed']), np.full(n, NOISE))
    errors = []
    for count in (2, 4):
        columns = [np.concatenate([getattr(part, name)] * count)
                   for name in ('q', 'u', 'udot', 'tau')]
        times = np.arange(count * len(part)) * 0.01
        data = law_rows(rows(model, Recording(times, *columns)))
        block = np.repeat(np.arange(count), len(part))
        blocks = Blocks(data, [block == k for k in range(count)], start)
        errors.append(blocks.errors(Prior(model, 1e3 * count))[0][0])
    np.testing.assert_allclose(errors[1], errors[0], rtol=1e-6)
    other = blocks.errors(Prior(model, 1e3 * count / (1.0 - 1.0 / count)))[0][0]
    assert np.abs(other / errors[1] - 1.0).max() > 1e-4
