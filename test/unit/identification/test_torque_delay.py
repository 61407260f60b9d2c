"""Delays of torques: each found within its deviation, none where none is."""

from dataclasses import replace
from functools import cache
from pathlib import Path

from kane_dynamics import load_urdf
from kane_dynamics.cli import main
from kane_dynamics.identification import diagnose, read_recording, torque_delays
from kane_dynamics.identification.presliding import dahl_friction
from mechanisms import with_inertials
import numpy as np
import pytest
from recordings import present, quiet, real, simulated

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
    assert delays.delay[5] > 0.003  # as it seems where friction follows the speed
    assert delays.friction_memory[5] and not delays.different.any()
    assert diagnose(model, sound) == []


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
