"""Identification chooses the friction law of an arm, the simplest within noise."""

from dataclasses import replace
from functools import cache
from pathlib import Path

from kane_dynamics import Inertial, InputError, load_urdf, Robot
from kane_dynamics.identification import identify, Recording
from kane_dynamics.identification.friction_laws import (
    Blocks, first_within_noise, LAW_NAMES, law_rows, LawFit, LAWS,
    LENGTHS, period, phases, Prior)
from kane_dynamics.identification.presliding import dahl_friction, first_rows
from kane_dynamics.identification.regression import rows, SPEEDS
from kane_dynamics.identification.result_files import written
from kane_dynamics.mechanics.constraints.yaml_file import load_constraints
from kane_dynamics.mechanics.recursive.regressor import inertial_parameters
import numpy as np
import pytest
from recordings import exciting
import yaml

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
    if 'curved' in law:
        losses.update(fast_damping=0.2, damping_speed=0.3)
    model = load_urdf(URDF, supplement={'joints': {'joint1': losses, 'joint2': losses}})
    t, q, u, udot = exciting(2, 3, duration=30.0, rate=100.0, harmonics=8)
    tau = Robot(model).inverse_dynamics(q, u, udot)
    if law == 'presliding':
        slip = np.tanh(u / LOSSES['friction_speed'])
        tau = tau + LOSSES['friction'] * (dahl_friction(q, [TRAVEL])[:, 0] - slip)
    noise = NOISE * np.random.default_rng(1).normal(size=tau.shape)
    return model, Recording(t, q, u, udot, tau + noise)


SLOW = ('load and curved',)


@pytest.mark.parametrize('law', [pytest.param(
    name, marks=pytest.mark.slow if name in SLOW else ()) for name in LAW_NAMES])
def test_the_law_of_the_arm_is_chosen_and_predicts_other_motion(law):
    _, recording = recording_of(law)
    identified = identify(load_urdf(URDF), recording, diagnosed=True)
    assert identified.law == law
    assert (identified.held_out < 1.25 * NOISE).all()
    assert set(identified.candidates) == set(LAW_NAMES)
    chosen = identified.candidates[law].every
    for errors in identified.candidates.values():
        assert (chosen < 1.02 * errors.every).all()
    np.testing.assert_allclose(identified.losses[:, 1], 2.0, rtol=0.15)
    if 'load' in law:
        np.testing.assert_allclose(identified.load_friction, 0.15, rtol=0.15)
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


def test_a_motion_that_coulomb_friction_explains_exactly_has_no_other_law():
    model = load_urdf(URDF)
    t, q, u, udot = exciting(2, 3)
    exact = Recording(t, q, u, udot, Robot(model).inverse_dynamics(q, u, udot))
    with np.errstate(all='raise'):
        assert identify(model, exact, diagnosed=True).law == 'coulomb'


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
    assert stated.law == 'coulomb' and stated.candidates == {}
    chosen = identify(load_urdf(URDF), recording, friction='load', diagnosed=True)
    assert (stated.held_out > 1.5 * chosen.held_out).any()


def test_masses_that_are_not_fitted_are_not_taken_for_friction_of_the_load():
    model, recording = recording_of('load')
    identified = identify(model, recording, friction_only=True, diagnosed=True)
    assert identified.law == 'coulomb'


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
    assert chosen.law == 'presliding'
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
        'load_friction': 0.2, 'fast_damping': 0.5,
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
     "friction: 'glue'; expected one of select, coulomb, curved"),
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
    shapes = np.column_stack([np.full(n, LOSSES['friction_speed']), np.ones(n)])
    start = LawFit(LAWS[0], inertial_parameters(model).ravel(), np.zeros((n, 6)),
                   np.zeros((0, 3)), shapes, np.full(n, NOISE))
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


def test_the_simplest_law_within_one_standard_error_of_the_best_is_chosen():
    noise = np.array([-0.1, 0.1, -0.1, 0.1, -0.1, 0.1])[:, None] * np.ones((6, 3))
    plain = np.ones((6, 3))
    # 1 % better with noise of 4 %; then 10 % better.
    assert first_within_noise([plain, 0.99 * np.exp(noise), 1.1 * plain]) == 0
    assert first_within_noise([plain, 0.9 * np.exp(noise), 0.9 * plain]) == 1
    assert first_within_noise([plain, 1.2 * plain, 0.9 * plain]) == 2


def test_the_weight_of_the_prior_is_no_worse_than_a_usual_one_on_another_motion():
    # A model whose masses are right, and one whose masses are wrong by up to half.
    _, recording = recording_of('load')
    arm, _ = recording_of('load')
    t, q, u, udot = exciting(2, 8, duration=10.0, rate=50.0)
    other = Recording(t, q, u, udot, Robot(arm).inverse_dynamics(q, u, udot))
    for factor in (1.0, 1.5):
        given = load_urdf(URDF)
        given = replace(given, bodies=tuple(replace(
            body, inertial=Inertial(factor * body.inertial.mass, body.inertial.com,
                                    factor * body.inertial.inertia))
            for body in given.bodies))
        errors = []
        for weight in (None, 10.0):
            fit = identify(given, recording.rows(slice(0, 500)), weight=weight,
                           test=other, friction='load', diagnosed=True)
            errors.append(np.log(fit.held_out).mean())
        assert errors[0] < errors[1] + 0.02


@pytest.mark.parametrize('fast', [0.05, 6.0])
def test_friction_that_flattens_or_grows_is_predicted_in_another_motion(fast):
    losses = {**LOSSES, 'damping': 3.0 if fast < 1.0 else 0.5, 'fast_damping': fast,
              'damping_speed': 0.5}
    arm = load_urdf(URDF, supplement={'joints': {'joint1': losses, 'joint2': losses}})
    recordings = []
    for seed in (3, 4):
        t, q, u, udot = exciting(2, seed, duration=20.0, rate=100.0, harmonics=8)
        noise = NOISE * np.random.default_rng(seed).normal(size=q.shape)
        recordings.append(Recording(t, q, u, udot,
                                    Robot(arm).inverse_dynamics(q, u, udot) + noise))
    fit, test = recordings
    given = load_urdf(URDF)
    chosen = identify(given, fit, test=test, diagnosed=True)
    plain = identify(given, fit, test=test, friction='coulomb', diagnosed=True)
    assert chosen.law == 'curved' and chosen.tested
    assert (chosen.held_out < 1.1 * NOISE).all()
    assert (plain.held_out > 1.3 * NOISE).any()
    # Passive at all rates, as written.
    for joint in chosen.model.coordinate_joints:
        assert joint.damping >= 0.0 and joint.fast_damping >= 0.0


def coupled_wrist(sign=1.0):
    """Return a recording of an arm whose second motor turns with both joints."""
    arm = load_urdf(URDF, supplement={'joints': {'joint1': LOSSES, 'joint2': LOSSES}})
    t, q, u, udot = exciting(2, 3, duration=20.0, rate=100.0, harmonics=8)
    rate, change = u @ [1.0, sign], udot @ [1.0, sign]
    motor = 1.2 * rate + 2.5 * np.tanh(rate / 0.05) + 0.15 * change
    tau = Robot(arm).inverse_dynamics(q, u, udot) + np.outer(motor, [1.0, sign])
    noise = NOISE * np.random.default_rng(1).normal(size=tau.shape)
    return Recording(t, q, u, udot, tau + noise)


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_a_coupled_wrist_is_suspected_and_found_when_it_is_named(sign):
    recording = coupled_wrist(sign)
    model = load_urdf(URDF)
    plain = identify(model, recording, friction='coulomb', diagnosed=True)
    assert [pair[:2] for pair in plain.suspected] == [('joint1', 'joint2')]
    named = identify(model, recording, friction='coulomb', diagnosed=True,
                     coupled=[('joint1', 'joint2')])
    motor, = named.coupled
    assert (motor.joints, motor.sign) == (('joint1', 'joint2'), sign)
    assert named.suspected == ()
    # The rotor's inertia and that of the second link cannot be told apart.
    assert not (named.inertial_deviations > 10.0).any()
    np.testing.assert_allclose([motor.damping, motor.friction], [1.2, 2.5], rtol=0.1)
    assert (named.held_out < 1.1 * NOISE).all()
    assert (plain.held_out > 3.0 * named.held_out).all()
    error = recording.tau - named.torque(recording)
    np.testing.assert_allclose(np.sqrt(np.mean(error**2, axis=0)), named.fitted)


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_the_written_model_has_the_coupled_motors_of_the_fit(sign, tmp_path):
    recording = coupled_wrist(sign)
    named = identify(load_urdf(URDF), recording, friction='coulomb', diagnosed=True,
                     coupled=[('joint1', 'joint2')])
    urdf, supplement, constraints = written(URDF, named.model, named.coupled)
    (tmp_path / 'a.urdf').write_text(urdf)
    loaded = load_urdf(tmp_path / 'a.urdf', supplement=yaml.safe_load(supplement))
    options = load_constraints(yaml.safe_load(constraints))
    q = recording.q
    motor = q @ [1.0, sign]
    for robot in (named.robot, Robot(loaded, **options)):
        order = list(map([*named.given.joint_names, named.coupled[0].name].index,
                         robot.coordinate_names))
        of_all = np.column_stack([q, motor])[:, order]
        torque = robot.inverse_dynamics(of_all, recording.u, recording.udot)
        np.testing.assert_allclose(torque, named.torque(recording), atol=1e-9)
        # Forward dynamics has the rotor that couples both joints.
        udot = robot.forward_dynamics(of_all, recording.u, torque)
        np.testing.assert_allclose(udot, recording.udot, atol=1e-8)


def test_joints_without_a_coupled_motor_are_not_suspected():
    _, recording = recording_of('coulomb')
    plain = identify(load_urdf(URDF), recording, friction='coulomb', diagnosed=True)
    assert plain.suspected == ()
    with pytest.raises(InputError, match='expected two of joint1, joint2'):
        identify(load_urdf(URDF), recording, coupled=[('joint1', 'wrist')])


def test_the_written_model_is_fitted_to_all_rows_and_judged_on_rows_left_out():
    _, recording = recording_of('coulomb')
    given = load_urdf(URDF)
    result = identify(given, recording, friction='coulomb', weight=10.0, diagnosed=True)
    in_first = phases(recording) < 0.5
    first, second = recording.rows(in_first), recording.rows(~in_first)
    tested = identify(given, first, test=second, friction='coulomb', weight=10.0,
                      diagnosed=True)
    np.testing.assert_allclose(result.held_out, tested.held_out, rtol=1e-6)
    whole = identify(given, recording, test=second, friction='coulomb', weight=10.0,
                     diagnosed=True)
    np.testing.assert_allclose(result.unknowns, whole.unknowns, atol=1e-3)
    assert np.abs(result.unknowns - tested.unknowns).max() > 1e-3


def test_stated_deviations_of_predicted_torques_cover_their_errors():
    arm, recording = recording_of('coulomb')
    t, q, u, udot = exciting(2, 9, duration=10.0, rate=50.0)
    truth = Robot(arm).inverse_dynamics(q, u, udot)
    other = Recording(t, q, u, udot, truth)
    result = identify(load_urdf(URDF), recording, friction='coulomb', diagnosed=True)
    deviation = result.torque_deviation(other)
    errors = np.abs(result.torque(other) - truth)
    assert np.mean(errors < 2.0 * deviation) > 0.9
    assert (deviation.mean(axis=0) < 0.5 * NOISE).all()
