"""Promises of `kane-dynamics identify`, run as a process."""

import json
from pathlib import Path
import subprocess
import sys

from command_in_process import command
from kane_dynamics import load_urdf, plot, Robot
from kane_dynamics.cli import main
from kane_dynamics.identification import read_recording
from kane_dynamics.plot import plot_replay
import numpy as np
import pytest
from recordings import simulated
import yaml

URDF = Path(__file__).resolve().parents[2] / 'urdf' / 'two_link.urdf'


def process(*arguments):
    """Run the command."""
    return subprocess.run(
        [sys.executable, '-m', 'kane_dynamics.cli', 'identify', *arguments],
        capture_output=True, text=True, check=False, timeout=120)


def test_identify_finds_friction_and_writes_files_that_load(tmp_path):
    names = load_urdf(URDF).joint_names
    truth = load_urdf(URDF, supplement={'joints': {names[0]: {
        'damping': 1.5, 'friction': 2.0, 'friction_offset': -0.3}}})
    recording = simulated(truth, 1, 0.01)
    path = tmp_path / 'run.npz'
    out = tmp_path / 'better.urdf'
    np.savez(path, t=recording.t, q=recording.q, u=recording.u, tau=recording.tau)
    done = process(str(URDF), str(path), '--json', '--out', str(out))
    assert done.returncode == 0, done.stderr
    data = json.loads(done.stdout)
    assert abs(data['friction']['damping'][0] - 1.5) < 0.1
    assert abs(data['friction']['friction'][0] - 2.0) < 0.1
    assert abs(data['friction']['friction_offset'][0] + 0.3) < 0.02
    assert max(data['rms_held_out']) < 0.02 < max(data['rms_before'])
    better = load_urdf(out, supplement=tmp_path / 'better.supplement.yaml')
    tau = Robot(better).inverse_dynamics(recording.q, recording.u, recording.udot)
    assert np.sqrt(np.mean((tau - recording.tau)**2)) < 0.02
    table = process(str(URDF), str(path), '--friction-only')
    assert table.returncode == 0, table.stderr
    assert all(word in table.stdout
               for word in ('held out', '+-', 'condition number', names[1]))


@pytest.mark.parametrize('options', [(), ('--friction-only', '--unbounded'),
                                     ('--base-parameters',), ('--payload', 'tip')],
                         ids=' '.join)
def test_identify_draws_measured_torques_and_those_that_it_computes(
        tmp_path, monkeypatch, options):
    load = {'link': 'tip', 'mass': 0.8, 'com': [0.1, 0.0, 0.02],
            'inertia': {'iyy': 0.004}}
    carried = {'payload': load} if '--payload' in options else None
    recording = simulated(load_urdf(URDF, supplement=carried), 4, 0.01)
    path = tmp_path / 'run.npz'
    picture = tmp_path / 'torques.png'
    np.savez(path, t=recording.t, q=recording.q, u=recording.u, udot=recording.udot,
             tau=recording.tau)
    drawn = {}

    def keep(t, measured, computed, names, file, **_):
        drawn.update(t=t, measured=measured, computed=computed, names=names)
        return plot_replay(t, measured, computed, names, file)
    monkeypatch.setattr(plot, 'plot_replay', keep)
    done = command('identify', str(URDF), str(path), *options, '--plot', str(picture))
    assert done.returncode == 0, done.stderr
    assert f'wrote {picture}' in done.stdout
    assert picture.read_bytes().startswith(b'\x89PNG')
    np.testing.assert_array_equal(drawn['t'], recording.t)
    np.testing.assert_array_equal(drawn['measured'], recording.tau)
    # The recording has noise of 0.01 N m.
    assert np.abs(drawn['computed'] - recording.tau).max() < 0.06


def test_negative_friction_is_reported_and_written_to_no_file(tmp_path, capsys):
    model = load_urdf(URDF)
    recording = simulated(model, 1, 0.01)
    path = tmp_path / 'run.npz'
    out = tmp_path / 'out.urdf'
    tau = recording.tau - 0.5 * recording.u  # a motor that helps
    np.savez(path, t=recording.t, q=recording.q, u=recording.u, tau=tau)
    arguments = ['identify', str(URDF), str(path), '--friction-only', '--unbounded']
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert 'negative: ' in printed and 'expected values >= 0' in printed
    assert all(f'{name} damping' in printed for name in model.joint_names)
    assert main([*arguments, '--out', str(out)]) == 2
    assert 'expected a nonnegative number' in capsys.readouterr().err
    assert not out.exists()


def test_exciting_motion_is_within_the_limits_and_its_recording_identifies_the_arm(
        tmp_path, capsys):
    motion = str(tmp_path / 'motion.csv')
    recording = str(tmp_path / 'recording.csv')
    supplement = tmp_path / 'truth.yaml'
    supplement.write_text('joints: {joint2: {damping: 0.7, friction: 1.1}}')

    def answer(*arguments):
        assert main([arguments[0], str(URDF), *arguments[1:], '--json']) == 0
        return json.loads(capsys.readouterr().out)
    result = answer('excite', '--out', motion, '--starts', '1', '--velocity', '3',
                    '--rate', '200', '--floor', 'none')
    assert result['condition'] < 30.0 and max(result['uses']['velocity']) <= 0.9
    assert answer('feasible', '--motion', motion)['fits']
    answer('torque', '--motion', motion, '--supplement', str(supplement), '--out',
           recording)
    clean = read_recording(recording, load_urdf(URDF).joint_names)
    noise = 0.01 * np.random.default_rng(0).normal(size=clean.tau.shape)
    np.savez(tmp_path / 'noisy.npz', t=clean.t, q=clean.q, tau=clean.tau + noise)
    got = answer('identify', str(tmp_path / 'noisy.npz'))
    assert got['friction']['damping'][1] == pytest.approx(0.7, rel=0.02)
    assert got['friction']['friction'][1] == pytest.approx(1.1, rel=0.02)
    assert max(got['rms_held_out']) < 0.02
    result = answer('identify', str(tmp_path / 'noisy.npz'), '--base-parameters')
    base = result['base_parameters']
    damping = base['names'].index('joint2.damping')
    assert base['values'][damping] == pytest.approx(
        0.7, abs=3.0 * base['standard_deviations'][damping])
    assert max(result['rms_held_out']) < 0.02
    assert main(['identify', str(URDF), str(tmp_path / 'noisy.npz'),
                 '--base-parameters']) == 0
    assert 'joint2.damping' in capsys.readouterr().out
    assert main(['excite', str(URDF), '--out', motion, '--velocity', '3', '--floor',
                 'none']) == 0
    assert 'at rest at the start and the end' in capsys.readouterr().out


def test_efforts_without_gravity_identify_the_same_friction(tmp_path):
    friction = {'joint1': {'damping': 0.7, 'friction': 1.1}}
    model = load_urdf(URDF, supplement={'joints': friction})
    recording = simulated(model, 4, 0.01)
    weight = Robot(model).gravity_force(recording.q)
    path = tmp_path / 'run.npz'

    def damping(tau, *options):
        np.savez(path, t=recording.t, q=recording.q, u=recording.u, udot=recording.udot,
                 tau=tau)
        done = command('identify', str(URDF), str(path), '--friction-only', '--json',
                       *options)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)['friction']['damping']
    np.testing.assert_allclose(
        damping(recording.tau - weight, '--efforts-without-gravity'),
        damping(recording.tau), atol=1e-6)
    done = command('identify', str(URDF), str(path), '--efforts-without-gravity')
    assert 'fit the torques with gravity twice' in done.stderr
    done = command('identify', str(URDF), str(path), '--efforts', 'external_torque')
    assert 'expected other efforts, or --payload' in done.stderr


def test_payload_is_found_and_written_as_a_supplement_and_for_the_node(tmp_path, capsys):
    friction = {'joint1': {'damping': 0.7, 'friction': 1.1}}
    load = {'link': 'tip', 'mass': 0.8, 'com': [0.1, 0.0, 0.02],
            'inertia': {'iyy': 0.004}}
    recording = simulated(
        load_urdf(URDF, supplement={'joints': friction, 'payload': load}), 4, 0.01)
    known = tmp_path / 'known.yaml'
    out = tmp_path / 'load.yaml'
    known.write_text(yaml.safe_dump({'joints': friction}))
    np.savez(tmp_path / 'run.npz', t=recording.t, q=recording.q, u=recording.u,
             udot=recording.udot, tau=recording.tau)
    arguments = ['identify', str(URDF), str(tmp_path / 'run.npz'), '--payload', 'tip',
                 '--supplement', str(known), '--out', str(out)]
    assert main([*arguments, '--json']) == 0
    data = json.loads(capsys.readouterr().out)
    assert data['mass'] == pytest.approx(0.8,
                                         abs=3.0 * data['standard_deviations']['mass'])
    assert data['node_parameters']['payload.com'] == data['com']
    assert data['node_parameters']['payload.inertia'][3] == data['inertia'][1][1]
    assert np.allclose(data['rms_held_out'], 0.01, rtol=0.2)
    loaded = load_urdf(URDF, supplement=out)
    assert yaml.safe_load(out.read_text())['joints'] == friction
    tau = Robot(loaded).inverse_dynamics(recording.q, recording.u, recording.udot)
    assert np.sqrt(np.mean((tau - recording.tau)**2)) < 0.011
    assert main(arguments) == 0
    assert 'payload.frame: tip' in capsys.readouterr().out
    second = str(tmp_path / 'second.yaml')
    for change, words in ((['--supplement', str(out), '--out', second],
                           'has a payload already'),
                          (['--out', 'load.urdf'], 'ends in .yaml')):
        assert main([*arguments, *change]) == 2
        assert words in capsys.readouterr().err
