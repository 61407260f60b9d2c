"""Identification of simulated arms with known parameters, and of real arms."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace

import clarabel
from kane_dynamics import (Inertial, InputError, load_urdf, ModelError, ModelWarning,
                           Robot)
from kane_dynamics.identification import (base_parameters, identify,
                                          physical_consistency, read_recording,
                                          Recording, rows)
from kane_dynamics.identification.base_regressor import true_unknowns
from kane_dynamics.identification.physical_consistency import physical
from kane_dynamics.identification.regression import (
    bounded, friction_columns, full_regressor, LOWEST)
from kane_dynamics.identification.result_files import written
from kane_dynamics.mechanics.recursive.regressor import inertial_parameters, PARAMETERS
from mechanisms import with_inertials
import mujoco
import numpy as np
import pytest
from recordings import exciting, from_mujoco, present, quiet, real, simulated

URDF = Path(__file__).resolve().parents[3] / 'urdf' / 'ur10e.urdf'
SUPPLEMENT = {'joints': {joint: {
    'armature': 0.2, 'damping': 3.0, 'friction': 4.0, 'friction_speed': 0.05,
    'friction_offset': 0.5} for joint in load_urdf(URDF).joint_names}}
REAL = {'panda': (('panda_unisa.csv', 'fer_hand.urdf', 7),
                  [.29, .79, .28, .22, .40, .20, .06]),
        'ur10': (('ur10_unisa.csv', 'ur10.urdf', 6), [3.0, 2.6, 2.0, .57, .34, 1.9])}
DAMPING = np.array([3.0, 3.0, 2.0, -2.0, 1.0, 0.5])  # in MuJoCo; a motor helps one
REAL = {name: arm for name, arm in REAL.items() if present(*arm[0][:2])} | {
    'mujoco': (None, [.53] * 6)}  # of which .5 is noise


@cache
def arm():
    """Return a six-axis arm with friction and armature."""
    return load_urdf(URDF, supplement=SUPPLEMENT)


@cache
def inaccurate_arm():
    """Return the arm of an inaccurate URDF: other masses, no friction."""
    rng = np.random.default_rng(3)
    plain = load_urdf(URDF)
    return with_inertials(plain, lambda inertial: Inertial(
        inertial.mass * rng.uniform(0.6, 1.5),
        inertial.com + rng.normal(size=3) * 0.02,
        inertial.inertia * rng.uniform(0.5, 2.0)))


@cache
def noisy():
    """Return a recording of the arm, its torques with noise of 0.5 N m."""
    return simulated(arm(), 0, 0.5)


@cache
def identified_arm():
    """Return the identified arm."""
    return identify(inaccurate_arm(), noisy())


@cache
def recorded(name):
    """Return model, recording and its reference torques of an arm."""
    if name == 'mujoco':
        with TemporaryDirectory() as folder:
            path = from_mujoco(Path(folder), URDF, (DAMPING, 4.0), 0.5)
            return (URDF, np.genfromtxt(path, delimiter=',', names=True),
                    load_urdf(URDF), read_recording(path, load_urdf(URDF).joint_names))
    path, urdf, joints = real(*REAL[name][0])
    model = quiet(urdf, joints)
    return (urdf, np.genfromtxt(path, delimiter=',', names=True), model,
            read_recording(path, joints))


def test_base_parameters_of_a_noisy_arm_are_within_three_deviations():
    base, values, deviations = identified_arm().base
    off = (values - base.B @ true_unknowns(arm())) / deviations
    assert np.abs(off).max() < 3.0
    assert 0.7 < off.std() < 1.3  # neither boasting nor timid
    assert len(base.names) == len(set(base.names)) == len(values)


def test_base_parameters_reproduce_every_torque():
    base = base_parameters(inaccurate_arm(), np.full(6, 0.05))
    values = base.B @ true_unknowns(arm())
    recording = simulated(arm(), 5, duration=2.0)
    X = full_regressor(rows(inaccurate_arm(), recording), np.full(6, 0.05))
    error = X[:, :, base.columns] @ values - recording.tau
    assert np.abs(error).max() < 1e-8 * np.abs(recording.tau).max()


def test_identified_friction_speeds_are_those_of_the_arm():
    assert np.allclose(identified_arm().friction_speed, 0.05, rtol=0.15)


def test_identified_bodies_are_physical_and_files_reproduce_their_torques(tmp_path):
    short = noisy().rows(slice(0, 400))  # too short a motion to tell much
    identified = identify(inaccurate_arm(), short, weight=1e-3)
    for body in identified.model.bodies:
        assert np.linalg.eigvalsh(body.inertial.pseudo_inertia)[0] > 0.0
    for joint in identified.model.coordinate_joints:
        assert min(joint.damping, joint.friction, joint.armature) >= 0.0
    urdf, supplement, _ = written(URDF, identified.model)
    path = tmp_path / 'arm.supplement.yaml'
    path.write_text(supplement)
    again = load_urdf(urdf, supplement=path)
    _, *state = exciting(6, 7, duration=0.2)
    tau = Robot(identified.model).inverse_dynamics(*state)
    assert np.abs(Robot(again).inverse_dynamics(*state) - tau).max() < 1e-12 * np.abs(
        tau).max()


@pytest.mark.parametrize(('factor', 'share'), [(1.2, 1.0), (1e-4, None)])
def test_left_out_fingers_keep_mass_so_that_they_can_still_move(factor, share):
    """The identified URDF has the identified dynamics, also read by MuJoCo."""
    hand = URDF.with_name('human_hand.urdf')
    names = load_urdf(hand).joint_names
    chosen = names[:2]
    model = load_urdf(hand, joints=chosen)
    scaled_model = with_inertials(model, lambda inertial: Inertial.from_pseudo_inertia(
        factor * inertial.pseudo_inertia))
    if share is None:
        with pytest.warns(ModelWarning, match='behind locked joints: heavier'):
            urdf, _, _ = written(hand, scaled_model)
    else:
        urdf, _, _ = written(hand, scaled_model)
    _, *state = exciting(2, 7, duration=0.2)
    tau = Robot(scaled_model, friction=False).inverse_dynamics(*state)
    again = Robot(load_urdf(urdf, joints=chosen), friction=False).inverse_dynamics(
        *state)
    assert np.abs(again - tau).max() < 1e-12 * np.abs(tau).max()
    whole = load_urdf(urdf)
    assert whole.joint_names == names
    originals = {body.name: body.inertial.mass for body in load_urdf(hand).bodies}
    for body in whole.bodies:
        assert body.inertial.mass > 0.0
        assert np.linalg.eigvalsh(body.inertial.pseudo_inertia)[0] > 0.0
        if share and body.name not in {moving.name for moving in scaled_model.bodies}:
            assert body.inertial.mass == pytest.approx(originals[body.name])
    Robot(whole).forward_dynamics(*np.zeros((3, len(names))))
    assert mujoco.MjModel.from_xml_string(urdf).nv == len(names)


def test_bounded_friction_is_never_below_its_bound():
    """The solver exceeds bounds by rounding errors; a damping of -1e-16 is invalid."""
    rng = np.random.default_rng(0)
    for seed in range(20):
        u = rng.normal(size=(200, 1))
        tau = -0.3 * u + 0.1 * rng.normal(size=u.shape)
        still = Recording(np.arange(200.0), u, u, 0.1 * rng.normal(size=u.shape), tau)
        x = bounded(friction_columns(still, 0, 0.05), tau[:, 0], LOWEST)
        assert (x >= LOWEST).all(), seed


def test_identified_arm_predicts_what_it_has_not_seen():
    identified = identified_arm()
    assert (identified.held_out < 0.55).all()  # of which 0.5 is noise
    assert (identified.before > 2.0).all()


def test_single_parameters_that_torques_determine_are_within_three_deviations():
    identified = identified_arm()
    determined = np.isfinite(identified.inertial_deviations)
    base = base_parameters(arm(), np.full(6, 0.05))
    names = []
    for body in arm().bodies:
        for name in PARAMETERS:
            names.append(f'{body.name}.{name}')
    alone = [name for name in names if name in base.names]
    assert [name for name, yes in zip(names, determined.ravel()) if yes] == alone
    assert 'wrist_3_link.mx' in alone and 'wrist_3_link.m' not in alone
    off = (inertial_parameters(identified.model) - inertial_parameters(arm())).reshape(
        -1, 10)
    assert np.abs(
        off[determined] / identified.inertial_deviations[determined]).max() < 3.0


def heavier(model, factor):
    """Return the model with other masses."""
    return with_inertials(model, lambda inertial: Inertial(
        factor * inertial.mass, 1.1 * inertial.com, 1.3 * inertial.inertia))


@pytest.mark.parametrize(('seed', 'weight'), [(0, None), (10, None), (20, 1000.0)])
def test_stated_deviations_hold_although_the_urdf_is_wrong(seed, weight):
    """Friction speeds, deviations with the bias of the prior, and the held-out error."""
    small = URDF.with_name('two_link.urdf')
    truth = heavier(load_urdf(small, supplement={'joints': {
        'joint1': {'damping': 1.5, 'friction': 2.0},
        'joint2': {'damping': 0.8, 'friction': 1.0}}}), 1.25)
    identified = identify(load_urdf(small), simulated(truth, seed, 0.05, duration=12.0),
                          weight=weight)
    assert np.allclose(identified.friction_speed, 0.05, rtol=0.15)
    off = (identified.losses - [[1.5, 2.0, 0.0, 0.0],
                                [0.8, 1.0, 0.0, 0.0]]) / identified.deviations
    determined = np.isfinite(identified.inertial_deviations)
    off = np.append(
        off,
        ((inertial_parameters(identified.model) - inertial_parameters(truth)).reshape(
            -1, 10) / identified.inertial_deviations)[determined])
    assert off.std() > 0.3 and np.abs(off).max() < 4.0
    assert (identified.held_out < 0.1).all()  # of which 0.05 is noise


def test_exact_recording_of_an_arm_whose_masses_are_known_gives_its_friction_exactly():
    recorded = simulated(arm(), 4, duration=5.0)
    identified = identify(load_urdf(URDF), recorded)
    assert identified.held_out.max() < 1e-8 * np.abs(recorded.tau).max()
    assert [joint.damping
            for joint in identified.model.coordinate_joints] == pytest.approx([3.0] * 6)


def equations(data):
    """Return the equations A x = b of the rows in motion, for noise of 0.5 N m."""
    A = full_regressor(data, np.full(6, 0.05))[data.moving]
    b = (data.recording.tau - data.rest)[data.moving]
    return A / 0.5, b / 0.5


def test_physical_parameters_are_those_of_the_semidefinite_program(monkeypatch):
    A, b = equations(rows(inaccurate_arm(), noisy().rows(slice(0, 400))))
    prior = [body.inertial for body in inaccurate_arm().bodies]
    direct = physical(A, b, prior, np.tile(LOWEST, 6), 100.0)
    for name in ('_unconstrained', '_nearest'):
        monkeypatch.setattr(physical_consistency, name, lambda *_: None)
    program = physical(A, b, prior, np.tile(LOWEST, 6), 100.0)
    misses = [np.linalg.norm(A @ x - b) for x in (direct, program)]
    assert misses[0] == pytest.approx(misses[1], rel=1e-6)
    assert np.abs(direct - program).max() < 1e-3 * np.abs(direct).max()
    assert not np.array_equal(direct, program)


@pytest.mark.parametrize('stalls', [1, 2, 3])
def test_a_program_that_stalls_is_solved_with_shorter_steps_or_refused(
        stalls, monkeypatch):
    A, b = equations(rows(inaccurate_arm(), noisy().rows(slice(0, 400))))
    prior = [body.inertial for body in inaccurate_arm().bodies]
    program = A, b, prior, np.tile(LOWEST, 6), 100.0
    for name in ('_unconstrained', '_nearest'):
        monkeypatch.setattr(physical_consistency, name, lambda *_: None)
    expected = physical(*program)
    shares = []
    solver = clarabel.DefaultSolver

    def stalling(*arguments):
        shares.append(arguments[-1].max_step_fraction)
        if len(shares) <= stalls:
            return SimpleNamespace(solve=lambda: SimpleNamespace(status='AlmostSolved'))
        return solver(*arguments)
    monkeypatch.setattr(clarabel, 'DefaultSolver', stalling)
    if stalls < 3:
        x = physical(*program)
        assert np.linalg.norm(A @ x - b) == pytest.approx(
            np.linalg.norm(A @ expected - b), rel=1e-6)
    else:
        with pytest.raises(InputError,
                           match=r'^weight: 100 .*AlmostSolved; expected a larger'):
            physical(*program)
    assert shares == sorted(shares, reverse=True) and len(shares) == min(stalls + 1, 3)


@pytest.mark.slow
@pytest.mark.parametrize('weight', [1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize('name', REAL)
def test_a_prior_of_small_weight_predicts_as_well(name, weight):
    _, _, model, recording = recorded(name)
    identified = identify(model, recording, weight=weight, friction='coulomb',
                          diagnosed=True)
    usual = identify(model, recording, weight=0.01, friction='coulomb', diagnosed=True)
    assert (identified.held_out < 1.1 * usual.held_out).all()


@pytest.mark.parametrize('name', REAL)
def test_rigid_body_torque_of_a_recording_is_the_references(name):
    urdf, columns, model, recording = recorded(name)
    reference = np.column_stack(
        [columns[f'tau_pin_{urdf.stem}_{k + 1}'] for k in range(model.n)])
    tau = Robot(model, friction=False).inverse_dynamics(recording.q, recording.u,
                                                        recording.udot)
    assert np.abs(tau - reference).max() < 1e-8


@pytest.mark.parametrize('name', REAL)
def test_identified_arm_beats_the_reference_residuals_of_a_real_recording(name):
    _, _, model, recording = recorded(name)
    held_out = identify(model, recording).held_out
    reference = np.array(REAL[name][1])
    # Negative friction; and of the UR10 one law for the arm costs the fifth joint 6 %.
    worse = {'mujoco': [3], 'ur10': [4]}.get(name, [])
    assert np.flatnonzero(held_out >= reference).tolist() == worse
    if name == 'ur10':
        assert held_out[4] < 1.06 * reference[4]


@cache
def with_friction_alone(name, bounded):
    """Return friction fitted to the first half of a recording, tested on the second."""
    _, _, model, recording = recorded(name)
    return identify(model, recording, friction_only=True, bounded=bounded)


@pytest.mark.parametrize('name', REAL)
def test_friction_alone_beats_the_reference_residuals_of_a_real_recording(name):
    """The reference is plain least squares too."""
    assert (with_friction_alone(name, False).held_out.round(2) <= REAL[name][1]).all()


# The Panda's fourth joint rubs less the faster it turns, in the eyes of a URDF whose
# masses are a little off: least squares gives it a negative damping. Without, .233 N m
# are left of that joint.
BOUNDED = {'panda': [3], 'ur10': [], 'mujoco': [3]}


@pytest.mark.parametrize('name', REAL)
def test_dissipative_friction_beats_the_reference_residuals_but_at_one_joint(name):
    identified = with_friction_alone(name, True)
    reference = np.array(REAL[name][1])
    assert (identified.losses[:, :3] >= 0.0).all()
    assert identified.model.coordinate_joints[0].damping == identified.losses[0, 0]
    worse = np.flatnonzero(identified.held_out.round(2) > reference)
    assert worse.tolist() == BOUNDED[name]
    if name != 'mujoco':
        assert (identified.held_out[worse] < reference[worse] + 0.015).all()


@pytest.mark.parametrize('name', [name for name in REAL if BOUNDED[name]])
def test_negative_friction_is_reported_and_refused_as_a_model(name):
    identified = with_friction_alone(name, False)
    assert identified.losses[3, 0] < -5.0 * identified.deviations[3, 0]
    with pytest.raises(ModelError, match=r"joint '\w+': \w+ -.*; expected a nonneg"):
        _ = identified.model
    with pytest.raises(InputError, match='only with friction_only'):
        identify(identified.given, noisy(), bounded=False)


def test_filter_neither_delays_nor_weakens_slow_motion():
    t, q, u, udot = exciting(2, 8, rate=200.0)
    rng = np.random.default_rng(9)
    raw = Recording(t, q + 1e-4 * rng.normal(size=q.shape), u, udot, q)
    clean = raw.filtered(8.0)
    inner = slice(100, -100)
    assert np.abs(clean.u - u)[inner].max() < 0.01
    assert np.abs(clean.udot - udot)[inner].max() < 0.3
    assert np.abs(clean.tau - q)[inner].max() < 1e-3


def test_uneven_rows_are_resampled_and_a_measured_speed_needs_one_derivative():
    """Rows 2 to 8 ms apart, noisy encoders: the arm is found as from even rows."""
    t, q, u, udot = exciting(2, 8, rate=1000.0)
    rng = np.random.default_rng(9)
    indices = np.cumsum(rng.integers(1, 9, len(t)))
    indices = indices[indices < len(t)]
    raw = Recording(t[indices], q[indices] + 1e-4 * rng.normal(size=(len(indices), 2)),
                    u[indices] + 1e-3 * rng.normal(size=(len(indices), 2)),
                    udot[indices], q[indices])
    assert raw.uneven and not raw.resampled().uneven
    assert np.diff(raw.resampled(100.0).t) == pytest.approx(0.01)
    recordings = [replace(raw, derived=derived).filtered(20.0)
                  for derived in (('u', 'udot'), ())]
    off = []
    for filtered in recordings:
        true = [np.interp(filtered.t, t, column) for column in udot.T]
        # Without the ends, where a filter has no samples on one side.
        off.append(np.abs(filtered.udot - np.column_stack(true))[50:-50].std())
    assert off[1] < 0.05 and off[1] < 0.5 * off[0]
    for rate in (0.0, np.inf, np.nan):
        with pytest.raises(InputError, match=r'rate: .*; expected a finite number'):
            raw.resampled(rate)


def test_noise_of_accelerations_is_measured():
    recorded = noisy()
    noise = np.random.default_rng(0).normal(size=recorded.udot.shape)
    size = np.sqrt(np.mean(recorded.udot**2, axis=0))
    assert (recorded.acceleration_noise() < 0.01).all()
    for share in (0.1, 0.5):
        noisier = replace(recorded, udot=recorded.udot * np.sqrt(1.0 - share**2)
                          + share * size * noise)
        assert np.allclose(noisier.acceleration_noise(), share, rtol=0.1)


def test_joint_that_never_moves_is_an_error():
    still = replace(noisy(), u=np.zeros_like(noisy().u))
    with pytest.raises(InputError, match='moves in 0 rows'):
        identify(arm(), still, diagnosed=True)


def test_a_joint_that_hardly_moves_is_named():
    recorded = noisy()
    still = recorded.u.copy()
    still[5:, 2] = 0.0
    words = f"joint '{arm().joint_names[2]}': moves in .* rows of the fit; expected"
    with pytest.raises(InputError, match=words):
        identify(inaccurate_arm(), replace(recorded, u=still), diagnosed=True)
