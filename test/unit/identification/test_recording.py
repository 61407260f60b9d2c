"""Recordings: every column belongs to the right joint, or is an error."""

from functools import cache
import json
from pathlib import Path

from kane_dynamics import InputError, load_urdf, Robot, simulate, Trajectory
from kane_dynamics.cli import main
from kane_dynamics.cli.tables import read_states
from kane_dynamics.identification import (excite, friction_motion, identify, ModelWatch,
                                          read_recording, Recording, rows)
import numpy as np
import pytest
from recordings import simulated

URDF = Path(__file__).resolve().parents[3] / 'urdf' / 'two_link.urdf'
NAMES = ('joint1', 'joint2')


@cache
def recording():
    """Return half a second of a two-link arm."""
    return simulated(load_urdf(URDF), 1, duration=0.5)


def table(path, header, rows):
    """Write a CSV file and return its path."""
    np.savetxt(path, rows, delimiter=',', header=','.join(header), comments='')
    return path


@cache
def counted(n, rows=4):
    """Return rows t, q1 ... qn, tau1 ... taun, each number its own."""
    columns = np.tile(np.arange(1.0, n + 1.0), (rows, 2))
    return ['t', *(f'{word}{k + 1}' for word in ('q', 'tau')
                   for k in range(n))], np.column_stack(
                       [np.arange(float(rows)), columns])


def test_recording_reads_alike_from_csv_and_npz(tmp_path):
    recorded = recording()
    arrays = {name: getattr(recorded, name) for name in ('q', 'u', 'udot', 'tau')}
    np.savez(tmp_path / 'a.npz', t=recorded.t, **arrays)
    header = ['t', *(f'{name}.{joint}' for name in arrays for joint in NAMES)]
    np.savetxt(tmp_path / 'a.csv', np.column_stack([recorded.t, *arrays.values()]),
               fmt='%.17g', delimiter=',', header=','.join(header), comments='')
    for path in (tmp_path / 'a.npz', tmp_path / 'a.csv'):
        read = read_recording(path, NAMES)
        for name in ('t', *arrays):
            assert np.array_equal(getattr(read, name), getattr(recorded, name))


@pytest.mark.parametrize(('wanted', 'numbers'), [
    ('abcd', [1, 2, 3, 4]), ('dcba', [4, 3, 2, 1]), ('db', [4, 2]), ('c', [3])])
def test_numbers_count_the_joints_of_the_robot_whichever_are_wanted(
        tmp_path, wanted, numbers):
    path = table(tmp_path / 'a.csv', *counted(4))
    read = read_recording(path, list(wanted), numbered='abcd')
    assert read.q[0].tolist() == read.tau[-1].tolist() == numbers
    rows = counted(4)[1]
    np.savez(tmp_path / 'a.npz', t=rows[:, 0], q=rows[:, 1:5], tau=rows[:, 5:])
    read = read_recording(tmp_path / 'a.npz', list(wanted), numbered='abcd')
    assert read.q[0].tolist() == numbers


def test_numbers_as_many_as_the_wanted_joints_count_these_from_the_base(tmp_path):
    path = table(tmp_path / 'a.csv', *counted(2))
    assert read_recording(path, ['d', 'b'], numbered='abcd').q[0].tolist() == [2.0, 1.0]
    for joints in ('bcd', 'b'):
        with pytest.raises(InputError,
                           match=r"'q': 2 numbered columns; expected .* all 4 of"):
            read_recording(path, list(joints), numbered='abcd')
    with pytest.raises(InputError,
                       match="'q': 2 numbered columns; expected one for each"):
        read_recording(path, ['a'])


def test_replay_of_chosen_joints_compares_each_with_its_own_column(tmp_path, capsys):
    recorded = recording()
    path = table(tmp_path / 'a.csv',
                 ['t', *(f'{w}{k}' for w in ('q', 'v', 'a', 'tau') for k in (1, 2))],
                 np.column_stack([recorded.t, recorded.q, recorded.u, recorded.udot,
                                  recorded.tau]))
    assert main(['replay', str(URDF), str(path), '--json', '--joints', 'joint2',
                 'joint1']) == 0
    data = json.loads(capsys.readouterr().out)
    assert np.allclose(data['measured'], recorded.tau[:, ::-1])
    assert max(data['rms_error']) < 1e-12


def test_saved_simulation_is_a_recording_in_any_order_of_joints(tmp_path):
    robot = Robot(load_urdf(URDF))
    motion = simulate(robot, [0.1, 0.2], [0.0, 0.0], 0.05, step=0.01)
    motion.save_npz(tmp_path / 'a.npz')
    read = read_recording(tmp_path / 'a.npz', NAMES[::-1])
    for name in ('q', 'u', 'udot', 'tau'):
        assert np.array_equal(getattr(read, name), getattr(motion, name)[:, ::-1])
    with pytest.raises(InputError,
                       match=r"joints \['joint1', 'joint2'\]; expected also \['j3'\]"):
        read_recording(tmp_path / 'a.npz', ['joint1', 'j3'])


@pytest.mark.parametrize(('text', 'words'), [
    ('q1,tau1\n1,2\n', "expected a column 't'"),
    ('t,q1\n1,2\n2,3\n3,4\n', "no 'tau'"),
    ('t,q1,tau1\n1,2,x\n', 'expected named columns of numbers'),
    ('t,q1,tau1\n1,2,0\n1,2,0\n2,1,0\n',
     'row 2, after 1.0; expected times that increase'),
    ('t,q1,tau1\n1,2,0\n2,nan,0\n3,1,0\n', 'not finite in row 2'),
    ('t,q1,tau1\n1,2,0\n2,2,0\ninf,1,0\n', 't: inf in row 3; expected a finite time'),
    ('t,q1,tau1\n', ': 0 rows; expected 3'),
    ('t,q1,q1,tau1\n1,2,3,0\n', r"several columns \['q1'\]"),
    ('t,time,q1,tau1\n1,2,3,0\n', "'t' and 'time'"),
    ('t,q1,q3,tau1,tau2\n1,2,3,0,0\n2,2,3,0,0\n3,2,3,0,0\n', r"no columns \['q2'\]"),
])
def test_bad_recording_is_named(tmp_path, text, words):
    path = tmp_path / 'bad.csv'
    path.write_text(text)
    with pytest.raises(InputError, match=words) as caught:
        read_recording(path, ['joint', 'other'] if 'q3' in text else ['joint'])
    assert 'bad.csv' in str(caught.value)


def test_columns_of_one_name_are_refused_where_states_are_read_too(tmp_path):
    path = table(tmp_path / 'a.csv', ['t', 'q.j', 'q.j'], np.zeros((2, 3)))
    with pytest.raises(InputError, match=r"a.csv: several columns \['q.j'\]"):
        read_states(path, ['j'])


@pytest.mark.parametrize('damage', ['empty', 'single', 'short', 'objects', 'text'])
def test_damaged_npz_is_named_by_all_who_read_one(tmp_path, damage):
    path = tmp_path / 'bad.npz'
    np.savez(path, t=np.arange(3.0),
             q=np.array([{}]) if damage == 'objects' else np.zeros(300))
    content = path.read_bytes()
    if damage == 'single':
        with path.open('wb') as stream:
            np.save(stream, np.zeros(3))
    elif damage == 'text':
        path.write_text('t,q.joint1\n')
    elif damage != 'objects':
        path.write_bytes(content[:0 if damage == 'empty' else len(content) // 2])
    for reader in (lambda: read_recording(path, NAMES),
                   lambda: Trajectory.load_npz(path)):
        with pytest.raises(InputError,
                           match=r'bad\.npz.*expected an npz file') as caught:
            reader()
        assert 'pickle' not in str(caught.value)  # which would run what is in the file


@pytest.mark.parametrize(('change', 'words'), [
    ({'t': np.arange(4.0)}, "'q': 3 rows; expected 4"),
    ({'t': np.arange(3.0)[:, None]}, r"'t': shape \(3, 1\)"),
    ({'t': np.arange(3.0) + 1j}, "'t': dtype complex128"),
    ({'q': np.zeros((1, 3, 2))}, r"'q': shape \(1, 3, 2\); expected \(N, n\)"),
    ({'joint_names': np.array(['joint1'])}, r"expected also \['joint2'\]"),
    ({'joint_names': np.array(NAMES), 'speed_names': np.array(['w1', 'w2'])},
     'speeds .*; expected those of the joints')])
def test_arrays_that_do_not_fit_together_are_refused_in_words(tmp_path, change, words):
    np.savez(tmp_path / 'a.npz', **{'t': np.arange(3.0), 'q': np.zeros((3, 2)),
                                    'tau': np.zeros((3, 2)), **change})
    with pytest.raises(InputError, match=words):
        read_recording(tmp_path / 'a.npz', NAMES)


def test_recording_takes_lists_and_refuses_what_is_no_real_number():
    zeros = [[0.0]] * 3
    assert Recording([0, 1, 2], *[zeros] * 4).tau.shape == (3, 1)
    for part, words in (([[0.0], [1.0], []], 'rectangular'),
                        ([[1j]] * 3, 'dtype complex'),
                        ([['a']] * 3, 'dtype <U1'),
                        ([0.0] * 3, r'shapes \(3,\) and \(3,\)')):
        with pytest.raises(InputError, match=words):
            Recording([0, 1, 2], zeros, zeros, zeros, part)


def test_arms_with_beams_are_refused_where_torques_must_be_linear_in_parameters():
    arm = load_urdf(URDF, supplement=URDF.with_name('two_link.bending.yaml'))
    t = np.arange(300) * 0.01
    q = 0.1 * np.sin(np.outer(t, np.arange(1, arm.n + 1)))
    u = np.gradient(q, t, axis=0)
    recording = Recording(t, q, u, np.gradient(u, t, axis=0), q)
    calls = (lambda: identify(arm, recording), lambda: rows(arm, recording),
             lambda: excite(arm), lambda: friction_motion(arm),
             lambda: ModelWatch(arm, recording))
    for call in calls:
        with pytest.raises(InputError, match='model: with beams; expected rigid links'):
            call()


@pytest.mark.parametrize(('separator', 'words'), [(';', 'semicolons'), ('\t', 'tabs')])
def test_tables_without_commas_are_named(tmp_path, separator, words):
    path = tmp_path / 'run.csv'
    path.write_text('\n'.join(separator.join(line) for line in (
        ('t', 'q.joint1', 'q.joint2'), ('0,0', '0,1', '0,2'), ('0,1', '0,2', '0,3'))))
    with pytest.raises(InputError,
                       match=rf'columns separated by {words}; expected commas'):
        read_recording(path, NAMES)


def test_the_proposed_cutoff_is_above_the_motion_and_below_the_noise():
    t = np.arange(0.0, 20.0, 0.002)
    rng = np.random.default_rng(0)
    q = np.column_stack([np.sin(np.pi * t), 0.3 * np.sin(4.0 * np.pi * t)])
    u = np.gradient(q, t, axis=0) + 0.05 * rng.normal(size=q.shape)
    noisy = Recording(t, q, u, np.gradient(u, t, axis=0), 0.0 * q)
    assert 4.0 < noisy.proposed_cutoff() < 20.0
    filtered = noisy.filtered(noisy.proposed_cutoff())
    exact = np.gradient(np.gradient(q, t, axis=0), t, axis=0)
    error = np.sqrt(np.mean((filtered.udot - exact)[200:-200]**2, axis=0))
    assert (error < 0.1 * np.sqrt(np.mean(exact**2, axis=0))).all()
