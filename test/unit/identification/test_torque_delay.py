"""Delays of torques: each found within its deviation, none where none is."""

from dataclasses import replace
from functools import cache
from pathlib import Path

from kane_dynamics import load_urdf, Robot
from kane_dynamics.cli import main
from kane_dynamics.identification import (diagnose, read_recording, Recording,
                                          torque_delays)
from kane_dynamics.identification.presliding import dahl_friction
from kane_dynamics.identification.recordings.torque_delay import _common, TorqueDelays
from mechanisms import with_inertials
import numpy as np
import pytest
from recordings import exciting, present, quiet, real, simulated

URDF = Path(__file__).resolve().parents[3] / 'urdf' / 'ur10e.urdf'
LOSSES = {'damping': 3.0, 'friction': 4.0, 'armature': 0.2, 'friction_offset': 1.0}
REAL = {'panda': ('panda_unisa.csv', 'fer_hand.urdf', 7),
        'ur10': ('ur10_unisa.csv', 'ur10.urdf', 6)}


@cache
def recorded(name):
    """Return a model and a recording: a real one, or of an arm with other masses."""
    if name in REAL:
        if not present(*REAL[name][:2]):
            pytest.skip('no recordings of real arms here')
        path, urdf, joints = real(*REAL[name])
        return quiet(urdf, joints=joints), read_recording(str(path), joints)
    model = load_urdf(URDF)
    rng = np.random.default_rng(0)
    truth = load_urdf(URDF,
                      supplement={'joints': dict.fromkeys(model.joint_names, LOSSES)})
    truth = with_inertials(truth, lambda inertial: replace(
        inertial, mass=inertial.mass * rng.uniform(0.7, 1.4)))
    return model, simulated(truth, 2, {'noisy': 0.5, 'exact': 0.0}[name], duration=10.0)


def late(r, delay, joints=slice(None)):
    """Return the recording with torques of some joints delayed."""
    tau = r.tau.copy()
    tau[:, joints] = np.column_stack([np.interp(r.t - delay, r.t, x)
                                      for x in r.tau.T])[:, joints]
    return replace(r, tau=tau).rows(
        slice(np.searchsorted(r.t, r.t[0] + max(delay, 0.0)), None))


@cache
def delay_as_recorded(name):
    """Return the common delay of a recording's torques; a real arm may have one."""
    return torque_delays(*recorded(name)).common if name in REAL else 0.0


@pytest.mark.parametrize('name, delay', [
    ('panda', 0.02), ('ur10', 0.05), ('noisy', 0.01), ('noisy', 0.05), ('exact', 0.02),
    *(pytest.param(*case, marks=pytest.mark.slow) for case in (
        ('panda', 0.01), ('panda', 0.05), ('ur10', 0.01), ('ur10', 0.02),
        ('noisy', 0.02),
        ('exact', 0.01), ('exact', 0.05)))])
def test_common_delay_of_torques_is_found_within_its_deviation(name, delay):
    model, r = recorded(name)
    delays = torque_delays(model, late(r, delay))
    assert delays.delayed and not delays.different.any()
    assert abs(delays.common - delay_as_recorded(name) - delay) < 0.003
    assert abs(delays.common - delay) < 3.0 * delays.common_deviation
    words = [f.words for f in diagnose(model, late(r, delay))]
    assert len(words) == 1 and 's) after the motion' in words[0]


@pytest.mark.parametrize('name', ['panda', 'ur10', 'noisy', 'exact'])
def test_recording_without_delay_has_none(name):
    model, r = recorded(name)
    delays = torque_delays(model, r)
    assert not (delays.delayed or delays.different.any())
    assert diagnose(model, r) == []


@pytest.mark.parametrize('joint', [0, 2, 5, *(
    pytest.param(joint, marks=pytest.mark.slow) for joint in (1, 3, 4))])
def test_delay_of_one_joint_is_that_joints(joint):
    model, r = recorded('noisy')
    delays = torque_delays(model, late(r, 0.03, joint))
    assert list(np.flatnonzero(delays.different)) == [joint] and not delays.delayed
    assert abs(delays.delay[joint] - 0.03) < 3.0 * delays.deviation[joint]
    words, = (f.words for f in diagnose(model, late(r, 0.03, joint)))
    assert f"efforts of joint '{model.joint_names[joint]}' come 0.0" in words


@pytest.mark.parametrize('length', [0.01, 0.03])
def test_presliding_friction_of_a_small_joint_is_no_delay_of_its_own(length):
    model, r = recorded('noisy')
    tau = r.tau.copy()
    # Joint 6 has friction with a memory in place of that of its speed.
    tau[:, 5] += 4.0 * (dahl_friction(r.q, [length])[:, 0, 5]
                        - np.tanh(r.u[:, 5] / 0.05))
    sound = replace(r, tau=tau)
    delays = torque_delays(model, sound)
    # Without this friction among the terms, the torque would seem to be late.
    assert abs(delays.delay[5]) < 3.0 * delays.deviation[5]
    assert delays.friction_memory[5] and not delays.different.any()
    assert diagnose(model, sound) == []


def with_gear_friction(model, seed):
    """Return a recording of gears with Stribeck and load friction, 6 ms late."""
    delay = 0.006
    t, q, u, udot = exciting(model.n, seed, rate=1000.0, duration=12.0, speed=1.0)
    rigid = Robot(model, friction=False).inverse_dynamics(q, u, udot)
    size = 0.3 * np.sqrt(np.mean(rigid**2, axis=0)) + 0.5
    level = size * (1.0 + 0.4 * np.exp(-(u / 0.03)**2)) + 0.06 * np.abs(rigid)
    tau = rigid + level * np.tanh(u / 0.004) + size * u
    rng = np.random.default_rng(seed)
    tau = tau + 0.02 * size * rng.normal(size=tau.shape)
    # One row in five; the torques are those of some rows before.
    rows = np.arange(200, len(t), 5)
    late_rows = rows - round(1000.0 * delay)
    sound = Recording(t[rows], q[rows], u[rows], udot[rows], tau[rows])
    return sound, replace(sound, tau=tau[late_rows]), delay


@pytest.mark.parametrize('seed', [0, pytest.param(1, marks=pytest.mark.slow),
                                  pytest.param(2, marks=pytest.mark.slow)])
def test_friction_of_gears_is_no_delay_and_hides_none(seed):
    # With fewer terms of friction the torque seemed early.
    model, _ = recorded('exact')
    sound, late_by_six, delay = with_gear_friction(model, seed)
    delays = torque_delays(model, sound)
    assert not (delays.delayed or delays.different.any())
    assert abs(delays.common) < max(2.0 * delays.common_deviation, 0.0005)
    delays = torque_delays(model, late_by_six)
    assert delays.delayed
    assert abs(delays.common - delay) < max(2.0 * delays.common_deviation, 0.0005)


def test_interruptions_do_not_hide_a_delay():
    model, r = recorded('noisy')
    with_delay = late(r, 0.01)
    # Messages of 0.3 s are lost, three times.
    lost = np.zeros(len(with_delay), dtype=bool)
    for begin in (200, 450, 700):
        lost[begin:begin + 30] = True
    delays = torque_delays(model, with_delay.rows(~lost))
    assert delays.delayed and not delays.different.any()
    assert abs(delays.common - 0.01) < 3.0 * delays.common_deviation < 0.003


def test_a_delay_of_few_joints_is_not_that_of_the_arm():
    delay = np.array([0.03, 0.03, 0.03, 0.03])
    few = np.array([0.005, np.inf, np.inf, np.inf])
    half = np.array([0.005, 0.005, np.inf, np.inf])
    memory = np.ones(4, dtype=bool)
    assert not TorqueDelays(delay, few, 0.03, 0.005, memory).delayed
    assert TorqueDelays(delay, half, 0.03, 0.004, memory).delayed


@pytest.mark.parametrize('duration', [1.0, 2.0, 3.0])
@pytest.mark.parametrize('seed', range(3))
def test_delay_of_a_short_motion_is_unknown(duration, seed):
    model = load_urdf(URDF, supplement={'joints': dict.fromkeys(
        load_urdf(URDF).joint_names, LOSSES)})
    r = simulated(model, seed, 0.5, duration=duration, speed=0.8)
    assert not torque_delays(model, r).judged.any()


def test_joints_that_contradict_each_other_widen_the_deviation_of_their_delay():
    alike = _common(np.array([0.01, 0.01, 0.01]), np.full(3, 0.002))
    different = _common(np.array([0.006, 0.01, 0.014]), np.full(3, 0.002))
    assert alike[0] == pytest.approx(0.01) and different[0] == pytest.approx(0.01)
    # The variance of one joint's delay, of which a quarter does not average out.
    assert alike[1] == pytest.approx(0.002 * np.sqrt(0.75 / 3.0 + 0.25))
    assert different[1] == pytest.approx(2.0 * alike[1])


def test_joint_without_motion_or_torque_of_its_own_cannot_be_judged(tmp_path, capsys):
    model, r = recorded('noisy')
    q = r.q.copy()
    u = r.u.copy()
    udot = r.udot.copy()
    tau = r.tau.copy()
    q[:, 5] = 0.3
    u[:, 5] = 0.0
    udot[:, 5] = 0.0
    tau[:, 4] = np.random.default_rng(1).normal(size=len(r))
    still = replace(r, q=q, u=u, udot=udot, tau=tau)
    delays = torque_delays(model, still)
    assert list(delays.judged) == [True] * 4 + [False] * 2 and not delays.delayed
    assert torque_delays(model, late(still, 0.02)).delayed
    path = tmp_path / 'still.npz'
    np.savez(path, t=r.t, q=q, u=u, udot=udot, tau=tau)
    assert main(['replay', str(URDF), str(path)]) == 0
    assert 'cannot be judged: wrist_2_joint, wrist_3_joint' in capsys.readouterr().out
