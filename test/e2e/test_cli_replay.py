"""Promises of `kane-dynamics replay`, run as a process on files and bags."""

from dataclasses import replace
import json
from pathlib import Path
import re
import subprocess
import sys

from command_in_process import command
from kane_dynamics import load_urdf, Robot
from kane_dynamics.identification import diagnose
import numpy as np
import pytest
from recordings import simulated
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores

URDF = Path(__file__).resolve().parents[2] / 'urdf' / 'two_link.urdf'
TYPES = get_typestore(Stores.ROS2_JAZZY)


def process(*arguments):
    """Run the command."""
    return subprocess.run(
        [sys.executable, '-m', 'kane_dynamics.cli', 'replay', *arguments],
        capture_output=True, text=True, check=False, timeout=120)


def bag(path, recording, names, effort, storage=StoragePlugin.MCAP):
    """Write joint states, with a joint more than the arm has, in another order."""
    kind = 'sensor_msgs/msg/JointState'
    State = TYPES.types[kind]
    Header = TYPES.types['std_msgs/msg/Header']
    Time = TYPES.types['builtin_interfaces/msg/Time']
    order = ['gripper', *reversed(names)]

    def laid_out(row):
        return np.concatenate([[0.25], row[::-1]])
    with Writer(path, version=9, storage_plugin=storage) as writer:
        connection = writer.add_connection('/arm/joint_states', kind, typestore=TYPES)
        for k, t in enumerate(recording.t):
            stamp = 10**18 + round(t * 1e9)
            message = State(Header(Time(stamp // 10**9, stamp % 10**9), ''), order,
                            laid_out(recording.q[k]), laid_out(recording.u[k]),
                            laid_out(effort[k]) if effort is not None else np.zeros(0))
            writer.write(connection, stamp, TYPES.serialize_cdr(message, kind))


@pytest.fixture(scope='module')
def recording():
    return simulated(load_urdf(URDF), 3, 0.01, duration=5.0)


@pytest.mark.parametrize('storage', [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_replay_of_a_bag_finds_the_torques_that_were_measured(
        tmp_path, recording, storage):
    names = load_urdf(URDF).joint_names
    bag(tmp_path / 'run', recording, names, recording.tau, storage)
    done = process(str(URDF), str(tmp_path / 'run'), '--json')
    assert done.returncode == 0, done.stderr
    data = json.loads(done.stdout)
    assert data['joint_names'] == list(names)
    assert max(data['rms_error']) < 0.05 < min(data['rms_measured'])
    assert data['remarks'] == []


def test_replay_writes_draws_and_tells_what_efforts_lack(tmp_path, recording):
    robot = Robot(load_urdf(URDF))
    bag(tmp_path / 'run', recording, robot.joint_names,
        recording.tau - robot.gravity_force(recording.q))
    picture = tmp_path / 'torques.png'
    table = tmp_path / 'torques.csv'
    done = process(str(URDF), str(tmp_path / 'run' / 'run.mcap'), '--plot', str(picture),
                   '--out', str(table))
    assert done.returncode == 0, done.stderr
    assert 'fit the torques without gravity' in done.stdout
    assert picture.stat().st_size > 10_000
    assert f'tau.{robot.joint_names[0]}' in table.read_text().splitlines()[0]
    np.savez(tmp_path / 'run.npz', t=recording.t, q=recording.q, u=recording.u,
             udot=recording.udot, tau=-recording.tau)
    done = process(str(URDF), str(tmp_path / 'run.npz'))
    assert 'opposite sign' in done.stdout


@pytest.mark.parametrize(('sign', 'weight', 'words'), [
    (1.0, 1.0, []), (-1.0, 1.0, ['opposite sign']),
    (1.0, 0.0, ['fit the torques without']),
    (-1.0, 0.0, ['opposite sign .* and fit these without gravity']),
    (0.0, 1.0, ['are all 0'])])
def test_remarks_tell_each_way_in_which_efforts_are_wrong(
        recording, sign, weight, words):
    gravity = Robot(load_urdf(URDF)).gravity_force(recording.q)
    measured = sign * (recording.tau - (1.0 - weight) * gravity)
    findings = [finding.words for finding in diagnose(load_urdf(URDF),
                                                      replace(recording, tau=measured))]
    assert len(findings) == len(words)
    assert all(re.search(*pair) for pair in zip(words, findings, strict=True))


def test_replay_takes_the_stated_kind_of_efforts_and_remarks_on_a_wrong_one(
        tmp_path, recording):
    weight = Robot(load_urdf(URDF)).gravity_force(recording.q)
    path = tmp_path / 'run.npz'
    constants = np.array([4.0, -0.5])

    def replayed(effort, *options):
        np.savez(path, t=recording.t, q=recording.q, u=recording.u, udot=recording.udot,
                 tau=effort)
        done = command('replay', str(URDF), str(path), '--json', *options)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)
    without = replayed(recording.tau - weight, '--efforts-without-gravity')
    currents = replayed(recording.tau / constants, '--efforts', 'motor_current',
                        '--torque-constants', '4', '-0.5')
    for data in (without, currents):
        assert max(data['rms_error']) < 0.05
        assert data['remarks'] == []
    twice = replayed(recording.tau, '--efforts-without-gravity')
    assert 'fit the torques with gravity twice' in twice['remarks'][0]


def test_replay_refuses_bags_that_cannot_be_compared(tmp_path, recording):
    bag(tmp_path / 'run', recording, load_urdf(URDF).joint_names, None)
    for arguments, words in (
            ([], 'joint states without effort'),
            (['--topic', '/joint_states'],
             "no topic '/joint_states' of sensor_msgs/msg/JointS"),
            (['--joints', 'missing'], 'missing')):
        done = command('replay', str(URDF), str(tmp_path / 'run'), *arguments)
        assert done.returncode == 2
        assert words in done.stderr


def test_joints_that_are_locked_and_move_in_the_recording_are_named(tmp_path, recording):
    path = tmp_path / 'run.npz'
    np.savez(path, t=recording.t, q=recording.q, tau=recording.tau,
             joint_names=np.array(['joint1', 'joint2']))
    done = command('replay', str(URDF), str(path), '--joints', 'joint1', '--cutoff', '8')
    low, high = recording.q[:, 1].min(), recording.q[:, 1].max()
    assert (f"joints that are computed at 0 are elsewhere: 'joint2' ({low:.3g} to "
            f'{high:.3g})') in done.stderr
    table = np.column_stack([recording.t, recording.q, recording.tau])
    for scale, warned in ((1.0, True), (1e-3, False)):
        table[:, 2] = scale * recording.q[:, 1]
        np.savetxt(tmp_path / 'run.csv', table, delimiter=',', comments='',
                   header='t,q.joint1,q.joint2,tau.joint1,tau.joint2')
        done = command('replay', str(URDF), str(tmp_path / 'run.csv'), '--joints',
                       'joint1', '--cutoff', '8')
        assert ('are elsewhere' in done.stderr) == warned
        assert done.returncode == 0, done.stderr


def test_speeds_are_derived_from_the_positions_on_request(tmp_path, recording):
    path = tmp_path / 'run.npz'
    late = np.roll(recording.u, 15, axis=0)
    np.savez(path, t=recording.t, q=recording.q, u=late, tau=recording.tau)
    errors = {}
    for option in ((), ('--derive-speeds',)):
        done = command('replay', str(URDF), str(path), '--json', '--cutoff', '10',
                       *option)
        data = json.loads(done.stdout)
        named = any('after the changes of the positions' in remark
                    for remark in data['remarks'])
        assert named == (not option)
        errors[option] = max(data['rms_error'])
    assert errors['--derive-speeds',] < 0.2 * errors[()]


def written(path, recording, **changes):
    """Write a recording, with changed entries, as npz; return its path."""
    changed = replace(recording, **changes)
    np.savez(path, t=changed.t, q=changed.q, u=changed.u, udot=changed.udot,
             tau=changed.tau)
    return str(path)


def test_what_has_changed_since_a_reference_is_named(tmp_path, recording):
    sound = written(tmp_path / 'sound.npz', recording)
    again = simulated(load_urdf(URDF), 3, 0.01, duration=5.0)
    offset = written(tmp_path / 'today.npz', again, tau=again.tau + [0.0, 0.5])
    done = command('replay', str(URDF), offset, '--reference', sound, '--json',
                   '--smallest', '0.1')
    data = json.loads(done.stdout)
    assert done.returncode == 1
    assert [(alarm['joint'], alarm['cause']) for alarm in data['alarms']] == [
        ('joint2', 'offset')]
    assert data['alarms'][0]['size'] == pytest.approx(0.5, abs=0.02)
    done = command('replay', str(URDF), sound, '--reference', sound)
    assert done.returncode == 0
    assert 'as it describes the reference' in done.stdout


def test_a_change_that_is_no_alarm_is_not_called_sound(tmp_path, recording):
    sound = written(tmp_path / 'sound.npz', recording)
    heavier = simulated(load_urdf(URDF), 3, 0.01, duration=5.0)
    changed = written(tmp_path / 'today.npz', heavier, tau=heavier.tau + [0.0, 0.1])
    done = command('replay', str(URDF), changed, '--reference', sound,
                   '--smallest', '20')
    assert done.returncode == 0
    assert 'larger difference than in the reference: joint2' in done.stdout
    assert '20 of the friction' in done.stdout and 'as it describes' not in done.stdout


def test_what_cannot_be_compared_with_a_reference_is_refused(tmp_path, recording):
    sound = written(tmp_path / 'sound.npz', recording)
    other = written(tmp_path / 'mNm.npz', recording, tau=1e3 * recording.tau)
    done = command('replay', str(URDF), sound, '--reference', other)
    assert done.returncode == 2
    assert '--reference: recording: efforts of all joints' in done.stderr
    assert 'mN m?' in done.stderr
    # At rest nothing shows friction or the rotor, and one pose no mass.
    still = np.zeros_like(recording.q)
    q = np.tile(recording.q[0], (len(recording), 1))
    weight = Robot(load_urdf(URDF)).gravity_force(q)
    resting = written(tmp_path / 'rest.npz', recording, q=q, u=still, udot=still,
                      tau=weight)
    done = command('replay', str(URDF), resting, '--reference', sound)
    assert done.returncode == 2
    assert 'cannot judge, at rest: joint1, joint2' in done.stdout
