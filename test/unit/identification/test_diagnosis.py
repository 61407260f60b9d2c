"""Diagnosis of recordings: each fault is named with its joints; a good one has none."""

from dataclasses import replace
from functools import cache
import json
from pathlib import Path
import re

from kane_dynamics import Inertial, load_urdf, Robot
from kane_dynamics.cli import main
from kane_dynamics.identification import diagnose, read_recording, Recording
from kane_dynamics.model.model import with_payload
from mechanisms import with_inertials
import numpy as np
import pytest
from recordings import present, quiet, real, simulated

URDF = Path(__file__).resolve().parents[3] / 'urdf' / 'ur10e.urdf'
FRICTION = {joint: {'damping': 3.0, 'friction': 4.0, 'armature': 0.2,
                    'friction_offset': 1.0} for joint in load_urdf(URDF).joint_names}


@cache
def model():
    """Return the arm of the URDF, without friction."""
    return load_urdf(URDF)


@cache
def good_recording():
    """Return a recording of the arm with friction and noise."""
    return simulated(load_urdf(URDF, supplement={'joints': FRICTION}), 2, 0.5,
                     duration=10.0)


def turned(r, names, joint=3):
    """Return the recording with some quantities of a joint reversed."""
    sign = np.where(np.arange(r.q.shape[1]) == joint, -1.0, 1.0)
    return replace(r, **{name: getattr(r, name) * sign for name in names})


def exchanged(r, names, a=1, b=2):
    """Return the recording with some quantities of two joints exchanged."""
    order = np.arange(6)
    order[[a, b]] = b, a
    return replace(r, **{name: getattr(r, name)[:, order] for name in names})


def gravity(r):
    """Return the gravity force of the joints."""
    return Robot(model()).gravity_force(r.q)


STATE = ('q', 'u', 'udot')


def changed(r, name, joint, change):
    """Return the recording with another quantity of a joint."""
    values = getattr(r, name).copy()
    values[:, joint] = change(values[:, joint])
    return replace(r, **{name: values})


def spike(r, joint):
    """Return the recording with one effort of a joint wrong by 500 N m."""
    tau = r.tau.copy()
    tau[len(r) // 3, joint] += 500.0
    return replace(r, tau=tau)


def frozen(r, joint):
    """Return the recording with the efforts of a joint constant for 2 s."""
    tau = r.tau.copy()
    rows = np.flatnonzero((r.t >= 4.0) & (r.t < 6.0))
    tau[rows, joint] = tau[rows[0], joint]
    return replace(r, tau=tau)


def idle(r, joint):
    """Return the recording with nothing but crosstalk in the efforts of a joint."""
    tau = r.tau.copy()
    crosstalk = 1e-3 * tau[:, joint - 1]
    tau[:, joint] = np.where(np.arange(len(r)) % 10, 0.0, crosstalk)
    return replace(r, tau=tau)


def late(r, joint):
    """Return the recording with speeds of joints behind a filter of the first order."""
    share = 1.0 - np.exp(-np.median(np.diff(r.t)) / 0.15)
    u = r.u.copy()
    for k in range(1, len(u)):
        u[k, joint] = u[k - 1, joint] + share * (r.u[k, joint] - u[k - 1, joint])
    return replace(r, u=u)


def interruption(r, start=4.0):
    """Return the recording without one second."""
    rows = (r.t < start) | (r.t >= start + 1.0)
    return replace(r, **{name: getattr(r, name)[rows] for name in ('t', *STATE, 'tau')})


# Faults of one joint; each names it, and no other joint.
JOINT_FAULTS = {
    'reversed': (lambda r, j: changed(r, 'tau', j, lambda tau: -tau), 'opposite sign'),
    'tenth': (lambda r, j: changed(r, 'tau', j, lambda tau: 0.1 * tau),
              'times the torques'),
    'mN m': (lambda r, j: changed(r, 'tau', j, lambda tau: 1e3 * tau), 'mN m'),
    'spike': (spike, 'have 1 outliers'),
    'frozen': (frozen, 'are constant from'),
    'idle': (idle, 'stay near one value while'),
    'late speeds': (late, 'speeds of .* after the changes of the positions'),
    'zero': (lambda r, j: changed(r, 'tau', j, lambda tau: 0.0 * tau),
             'are constant from'),
    'reversed positions': (lambda r, j: turned(r, STATE, j), 'positions of .* opposite'),
    'degrees': (lambda r, j: changed(r, 'q', j, np.degrees), 'degrees'),
    'reversed speeds': (lambda r, j: changed(r, 'u', j, lambda u: -u),
                        'negative derivative')}
FR3 = URDF.with_name('fr3.urdf')
TWO_LINK = URDF.with_name('two_link.urdf')
FR3_FRICTION = dict(zip([f'fr3_joint{k}' for k in range(1, 8)], [
    {'damping': d, 'friction': mu, 'armature': 0.1, 'friction_offset': offset}
    for d, mu, offset in ((.5, .6, .2), (.5, .7, -.2), (.4, .5, .2), (.4, .6, .1),
                          (.15, .35, .05), (.15, .3, -.05), (.1, .25, .02))],
                        strict=True))
FAULTS = {
    'interruption': (interruption, 'remark',
                     r'times: interruption of 1\.01 s after 3\.99 s; expected'),
    'reversed efforts': (lambda r: turned(r, ['tau']), 'wrong',
                         "efforts of joint 'wrist_1_joint' have the opposite sign"),
    'reversed positions': (lambda r: turned(r, STATE, 1), 'wrong',
                           ('positions of joint '
                            "'shoulder_lift_joint' have the opposite sign")),
    'reversed joint': (lambda r: turned(r, [*STATE, 'tau'], 2), 'wrong',
                       ('positions and '
                        "efforts of joint 'elbow_joint' have the opposite sign")),
    'all reversed': (lambda r: replace(r, tau=-r.tau), 'wrong',
                     'efforts of all joints have the opposite sign'),
    'one fifteenth': (lambda r: replace(r, tau=r.tau / 15.0), 'wrong',
                      'efforts of all joints are about 0.0'),
    'mN m': (lambda r: replace(r, tau=r.tau * 1000.0), 'wrong', 'mN m'),
    'mN m of one': (lambda r: replace(r,
                                      tau=r.tau * np.where(np.arange(6) == 1, 1e3, 1.0)),
                    'wrong', "efforts of joint 'shoulder_lift_joint' are about"),
    'without gravity': (lambda r: replace(r, tau=r.tau - gravity(r)), 'wrong',
                        'efforts of all joints fit the torques without gravity'),
    'reversed last joint': (lambda r: turned(r, STATE, 5), 'wrong',
                            ('efforts of joint '
                             "'wrist_3_joint' have .*; or the positions of that")),
    'exchanged efforts': (lambda r: exchanged(r, ['tau']), 'wrong',
                          ('efforts of joints '
                           "'shoulder_lift_joint', 'elbow_joint' are exchanged")),
    'exchanged joints': (lambda r: exchanged(r, [*STATE, 'tau']), 'wrong',
                         "^joints 'shoulder_lift_joint', 'elbow_joint' are exchanged"),
    'no efforts': (lambda r: replace(r, tau=0.0 * r.tau), 'wrong', 'efforts are all 0'),
    'degrees': (lambda r: replace(r, **{name: np.degrees(getattr(r, name))
                                        for name in STATE}),
                'impossible', 'are these degrees'),
    'speeds in degrees': (lambda r: replace(r, u=np.degrees(r.u)), 'impossible',
                          'speeds of all joints are 57.3 times .* degrees a second'),
    'milliseconds': (lambda r: replace(r, t=1e3 * r.t), 'impossible',
                     'speeds of all joints .* times in milliseconds'),
    'milliseconds, no speeds': (lambda r: replace(r, t=1e3 * r.t, derived=('u', 'udot')),
                                'impossible', 'rows are 10 s apart; .* milliseconds'),
    'reversed speed': (lambda r: turned(r, ['u']), 'impossible',
                       "speeds of joint 'wrist_1_joint' are the negative derivative"),
    'exchanged speeds': (lambda r: exchanged(r, ['u'], 4, 5),
                         'impossible', ('speeds of '
                                        "joint 'wrist_2_joint' are the derivative .* "
                                        "'wrist_3_joint'")),
    'late speeds': (lambda r: late(r, slice(None)), 'remark',
                    r'^speeds of all joints come 0\.1\d*( to 0\.1\d*)? s after'),
    'delay': (lambda r: replace(r.rows(slice(10, None)), tau=r.tau[:-10]), 'remark',
              r'come 0\.[01]\d* .*after the motion'),
    'noise': (lambda r: replace(r, udot=r.udot + 30.0 * np.random.default_rng(0).normal(
        size=r.q.shape)), 'remark',
              'accelerations of all joints are noise to .*--cutoff'),
}


@pytest.mark.parametrize('fault', FAULTS)
def test_fault_of_a_recording_is_named(fault):
    change, level, words = FAULTS[fault]
    findings = diagnose(model(), change(good_recording()))
    assert {finding.level for finding in findings} == {level}
    matching = [finding.words for finding in findings]
    assert any(re.search(words, words_of_finding)
               for words_of_finding in matching), matching


def names_joint_alone(model, r, joint, words):
    """Return whether a fault is named with its joint, and no other joint with it."""
    others = [f"'{name}'" for k, name in enumerate(model.joint_names) if k != joint]
    findings = [finding.words for finding in diagnose(model, r)]
    right = []
    for f in findings:
        if re.search(words, f) and f"'{model.joint_names[joint]}'" in f:
            right.append(f)
    return bool(right) and not any(other_joint in f for f in findings
                                   for other_joint in others)


@pytest.mark.parametrize(('fault', 'joint'), [
    ('reversed', 5), ('tenth', 4), ('mN m', 5),
    ('spike', 1), ('frozen', 3), ('idle', 2), ('late speeds', 1), ('zero', 2),
    ('degrees', 1)])
def test_fault_of_a_joint_is_named_with_that_joint_only(fault, joint):
    change, words = JOINT_FAULTS[fault]
    assert names_joint_alone(model(), change(good_recording(), joint), joint, words)


def resting(r, joint, share, stiction):
    """Return the recording with a joint at rest for a share of the rows, by stiction."""
    rows = round(share * len(r))
    state = {name: getattr(r, name).copy() for name in STATE}
    for name, values in state.items():
        values[rows:, joint] = values[:len(r) - rows, joint]
        values[:rows, joint] = values[0, joint] if name == 'q' else 0.0
    truth = Robot(load_urdf(URDF, supplement={'joints': FRICTION}))
    tau = truth.inverse_dynamics(state['q'], state['u'], state['udot'])
    tau[:rows, joint] += stiction
    noise = np.random.default_rng(0).normal(scale=0.05, size=tau.shape)
    return replace(r, **state, tau=tau + noise)


@pytest.mark.parametrize('joint', [2, 5])
@pytest.mark.parametrize('share', [0.8, 1.0])
def test_stiction_at_rest_is_no_offset_of_torques(joint, share):
    # Coulomb friction is 4 N m, and so is breakaway friction.
    r = resting(good_recording(), joint, share, 3.5)
    words = [finding.words for finding in diagnose(model(), r)]
    assert not [w for w in words if 'offset' in w], words


def test_a_recording_at_rest_without_noise_has_no_wrong_torques():
    count = 300
    q = np.tile([0.1, -1.2, 0.8, -0.6, 0.4, 0.2], (count, 1))
    zero = np.zeros_like(q)
    r = Recording(0.01 * np.arange(count), q, zero, zero, gravity(replace(
        good_recording(), t=0.01 * np.arange(count), q=q, u=zero, udot=zero, tau=zero)))
    assert not [finding for finding in diagnose(model(), r) if finding.level == 'wrong']


@cache
def fr3_recording():
    """Return an arm's model and a recording with other masses and friction."""
    arm = load_urdf(FR3, joints=list(FR3_FRICTION))
    truth = load_urdf(FR3, joints=list(FR3_FRICTION),
                      supplement={'joints': FR3_FRICTION})
    rng = np.random.default_rng(3)
    truth = with_inertials(truth, lambda inertial: replace(
        inertial, mass=inertial.mass * rng.uniform(0.9, 1.1)))
    return arm, simulated(truth, 3, 0.05, duration=20.0, speed=1.5)


# Rigid bodies need no torque of the UR10's last joint, which at a tenth has less
# friction.
HIDDEN_IN_UR10 = {('tenth', 5)}
REAL = {'ur10': (('ur10_unisa.csv', 'ur10.urdf', 6), HIDDEN_IN_UR10),
        'panda': (('panda_unisa.csv', 'fer_hand.urdf', 7), set())}
REAL = {name: arm for name, arm in REAL.items() if present(*arm[0][:2])}


def model_and_recording(name):
    """Return an arm's model and a recording: simulated FR3, real UR10 or Panda."""
    if name == 'fr3':
        return fr3_recording()
    path, urdf, joints = real(*REAL[name][0])
    return quiet(urdf, joints), read_recording(path, joints)


@cache
def missed_faults(name):
    """Return the faults of an arm not named with their joint alone, and the joints."""
    model, r = model_and_recording(name)
    misses = set()
    for fault, (change, words) in JOINT_FAULTS.items():
        for joint in range(model.n):
            if not names_joint_alone(model, change(r, joint), joint, words):
                misses.add((fault, joint))
    return misses


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize('name', ['fr3', *REAL])
def test_a_sound_recording_has_no_remark(name):
    assert diagnose(*model_and_recording(name)) == []


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize('name', REAL)
def test_all_faults_that_the_torques_of_a_real_arm_show_are_named(name):
    assert missed_faults(name) <= REAL[name][1]


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_ninety_of_hundred_faults_are_named_also_those_that_the_torques_hide(capsys):
    counts = []
    for name in ('fr3', *REAL):
        total = model_and_recording(name)[0].n * len(JOINT_FAULTS)
        counts.append((total - len(missed_faults(name)), total))
    with capsys.disabled():
        print('\nfaults named of all:', ', '.join(f'{right} of {total}'
                                                  for right, total in counts))
    named, total = np.sum(counts, axis=0)
    assert named >= 0.9 * total
    assert counts[0][0] >= 0.9 * counts[0][1], 'of the FR3'


@pytest.mark.parametrize('seed', [2, 3, 4])
def test_good_recording_of_an_arm_with_friction_and_other_masses_is_not_remarked_on(
        seed):
    truth = load_urdf(URDF, supplement={'joints': FRICTION})
    rng = np.random.default_rng(seed)
    truth = with_inertials(truth, lambda inertial: replace(
        inertial, mass=inertial.mass * rng.uniform(0.7, 1.4)))
    assert diagnose(model(), simulated(truth, seed, 0.5, duration=10.0)) == []


@pytest.mark.parametrize('seed', [2, 7, 8, 10])
def test_wrong_centers_of_mass_are_no_offset_of_positions(seed):
    # Wrists with them have torques like those of an offset of 0.06 to 0.4 rad.
    truth = load_urdf(FR3, joints=list(FR3_FRICTION),
                      supplement={'joints': FR3_FRICTION})
    rng = np.random.default_rng(seed)

    def wrong(inertial):
        mass = inertial.mass * rng.uniform(0.7, 1.4)
        com = inertial.com + rng.uniform(-0.03, 0.03, 3)
        return replace(inertial, mass=mass, com=com)
    r = simulated(with_inertials(truth, wrong), seed, 0.05, duration=20.0, speed=1.5)
    assert diagnose(load_urdf(FR3, joints=list(FR3_FRICTION)), r) == []


def test_identify_refuses_what_replay_remarks_on_and_both_what_cannot_be(
        tmp_path, capsys):
    def saved(name, r):
        path = tmp_path / name
        np.savez(path, t=r.t, q=r.q, u=r.u, udot=r.udot, tau=r.tau)
        return str(path)
    wrong = saved('wrong.npz', turned(good_recording(), ['tau']))
    assert main(['replay', str(URDF), wrong, '--json']) == 0
    assert 'opposite sign' in json.loads(capsys.readouterr().out)['remarks'][0]
    arguments = ['identify', str(URDF), wrong, '--friction-only']
    assert main(arguments) == 2
    assert "'wrist_1_joint' have the opposite sign" in capsys.readouterr().err
    assert main([*arguments, '--as-recorded']) == 0
    assert 'warning: efforts of joint' in capsys.readouterr().err
    impossible = saved('impossible.npz',
                       replace(good_recording(), t=1e3 * good_recording().t))
    for command in ('replay', 'identify'):
        assert main([command, str(URDF), impossible]) == 2
        assert 'milliseconds' in capsys.readouterr().err


@pytest.mark.parametrize('factor', [4.0, -4.0, 10.0, -10.0])
def test_units_of_all_joints_and_of_one_are_named_as_their_product(factor):
    efforts = good_recording().tau / 20.0
    efforts[:, 2] *= factor
    findings = diagnose(model(), replace(good_recording(), tau=efforts))
    words = [finding.words for finding in findings]
    named = {}
    for finding in words:
        about = float(re.search(r'are about (\S+) times', finding)[1])
        for joint in re.findall(r"'(\w+)'", finding):
            assert joint not in named, words
            named[joint] = about
    expected = dict.fromkeys(model().joint_names, 0.05)
    expected['elbow_joint'] *= factor
    assert named == pytest.approx(expected, rel=0.3)


def test_a_sign_that_all_joints_have_and_one_has_twice_is_that_of_the_others():
    efforts = -good_recording().tau
    efforts[:, 1] *= -1.0
    findings = diagnose(model(), replace(good_recording(), tau=efforts))
    words = [finding.words for finding in findings]
    reversed_joints = set(re.findall(r"'(\w+)'", ' '.join(words)))
    assert reversed_joints == set(model().joint_names) - {'shoulder_lift_joint'}
    assert all('have the opposite sign' in finding for finding in words)


def test_speeds_that_are_derived_from_the_positions_are_not_late():
    behind = late(good_recording(), slice(None))
    derived = behind.with_derived_speeds()
    assert derived.derived == ('u', 'udot')
    np.testing.assert_allclose(derived.u[5:-5], good_recording().u[5:-5], atol=5e-3)
    assert diagnose(model(), derived.filtered(10.0)) == []


def test_speeds_of_a_joint_that_rests_in_the_longest_stretch_are_not_late():
    r = interruption(good_recording(), start=1.0)
    later = r.t > 1.5
    rests = replace(
        r, q=np.where(later[:, None], r.q[later][0], r.q),
        u=np.where(later[:, None], 0.0, r.u))
    words = [finding.words for finding in diagnose(model(), rests)]
    assert not any(finding.startswith('speeds of') for finding in words), words


def test_limits_that_are_too_low_are_no_fault_of_the_efforts():
    # URDFs often have placeholders as limits, such as 10 N m.
    bodies = []
    for body in model().bodies:
        limits = replace(body.joint.limits, effort=10.0)
        bodies.append(replace(body, joint=replace(body.joint, limits=limits)))
    low = replace(model(), bodies=tuple(bodies))
    assert diagnose(low, good_recording()) == []
    thousand = replace(good_recording(), tau=1e3 * good_recording().tau)
    assert 'mN m' in diagnose(low, thousand)[0].words


@pytest.mark.parametrize('rows', [3, 5, 12, 29])
def test_torques_of_a_few_rows_show_no_fault(rows):
    arm = load_urdf(TWO_LINK)
    r = simulated(arm, 1, 0.05, duration=10.0, speed=0.5).rows(slice(0, rows))
    assert not [f.words for f in diagnose(arm, r) if f.level == 'wrong']


def test_speeds_that_come_before_the_positions_are_those_of_filtered_positions():
    r = good_recording()
    late_positions = np.column_stack([np.interp(r.t - 0.1, r.t, q) for q in r.q.T])
    words = [f.words for f in diagnose(model(), replace(r, q=late_positions))]
    early = [w for w in words if 'before the changes of the positions' in w]
    assert early and 'as if the positions were filtered' in early[0]


def test_efforts_of_short_accelerations_alone_are_not_idle():
    # Without gravity and friction, a joint at constant speed needs no torque.
    weightless = replace(load_urdf(TWO_LINK), gravity=np.zeros(3))
    t = np.arange(0.0, 20.0, 0.01)
    phase = np.outer(t, [0.9, 1.3])
    u = 0.5 * np.tanh(30.0 * np.sin(phase))
    q = 0.01 * np.cumsum(u, axis=0)
    udot = np.gradient(u, t, axis=0)
    tau = Robot(weightless).inverse_dynamics(q, u, udot)
    assert diagnose(weightless, Recording(t, q, u, udot, tau)) == []
    tau[:, 1] = np.where(np.arange(len(t)) % 10, 0.0, 1e-3 * tau[:, 0])
    with_weight = load_urdf(TWO_LINK)
    tau[:, 0] = Robot(with_weight).inverse_dynamics(q, u, udot)[:, 0]
    findings = diagnose(with_weight, Recording(t, q, u, udot, tau))
    words = [finding.words for finding in findings]
    assert any("'joint2' stay near one value" in finding for finding in words), words


def test_late_speeds_are_not_torques_that_come_early():
    findings = diagnose(model(), late(good_recording(), slice(None)))
    words = [finding.words for finding in findings]
    assert not any('motion that they belong to' in finding for finding in words), words


def test_an_effort_that_is_doubled_is_remarked_on_with_its_joint():
    for joint in (1, 2):
        doubled = changed(good_recording(), 'tau', joint, lambda tau: 2.0 * tau)
        findings = diagnose(model(), doubled)
        words = [f.words for f in findings if model().joint_names[joint] in f.words]
        assert any('times the torques' in w for w in words), findings


@pytest.mark.parametrize('mass', [2.0, 6.0])
def test_a_payload_that_the_model_does_not_have_is_the_first_explanation(mass):
    truth = load_urdf(URDF, supplement={'joints': FRICTION})
    tool = Inertial(mass, (0.0, 0.02, 0.08), 0.01 * np.eye(3))
    loaded = with_payload(truth, 'tool0', tool)
    findings = diagnose(model(), simulated(loaded, 3, 0.3, duration=10.0))
    words = ' '.join(finding.words for finding in findings)
    assert [finding.level for finding in findings] == ['remark'], words
    kilograms = float(re.search(r'about ([\d.]+) kg more', words)[1])
    assert kilograms == pytest.approx(mass, rel=0.15)
    assert 'identify --payload' in words


@pytest.mark.parametrize('joint', [1, 2])
def test_efforts_of_a_joint_at_rest_judge_no_sign_and_no_scale(joint):
    # Stiction holds the weight in part, or acts the other way.
    for stiction in (-3.5, 3.5):
        r = resting(good_recording(), joint, 1.0, stiction)
        tau = r.tau.copy()
        tau[:, joint] *= -0.3
        findings = diagnose(model(), replace(r, tau=tau))
        name = model().joint_names[joint]
        words = [f.words for f in findings if name in f.words]
        assert not [w for w in words if 'sign' in w or 'times' in w], words


def test_one_bad_joint_is_left_out_by_name_and_the_others_are_fitted(tmp_path, capsys):
    sound = good_recording()
    dead = changed(sound, 'tau', 3, lambda tau: 0.0 * tau)
    path = tmp_path / 'dead.npz'
    np.savez(path, t=dead.t, q=dead.q, u=dead.u, udot=dead.udot, tau=dead.tau)
    arguments = ['identify', str(URDF), str(path), '--friction', 'coulomb', '--json']
    assert main(arguments) == 2
    assert '--without-effort' in capsys.readouterr().err
    assert main([*arguments, '--without-effort', 'wrist_1_joint']) == 0
    left_out = json.loads(capsys.readouterr().out)
    others = [0, 1, 2, 4, 5]
    held_out = np.array(left_out['rms_held_out'], dtype=float)
    before = np.array(left_out['rms_before'])
    assert (held_out[others] < 0.3 * before[others]).all()
    assert left_out['rms_held_out'][3] is None
