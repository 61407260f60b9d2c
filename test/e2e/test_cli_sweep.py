"""Promises of `kane-dynamics sweep` as processes: kills lose nothing."""

from contextlib import contextmanager, suppress
import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

from kane_dynamics.cli import main
from kane_dynamics.cli.commands.sweep_command import read_sweep
from kane_dynamics.sweep import read_table, run_sweep
import pytest

URDF = Path(__file__).resolve().parents[2] / 'urdf' / 'two_link.urdf'
FILE = """
urdf: {urdf}
samples: {samples}
seed: 5
duration: {duration}
step: 1e-3
chunk: 25
q0: {{each: {{uniform: [-1, 1]}}}}
payload: {{frame: tip, mass: {{uniform: [0, 2]}}, com: [{{uniform: [0, 0.1]}}, 0, 0]}}
friction: {{uniform: [0.5, 2]}}
controller: {{kind: {{choice: [computed_torque, none]}}, kp: {{loguniform: [50, 500]}}}}
"""


def command(*arguments):
    """Return the arguments of the command."""
    return [sys.executable, '-m', 'kane_dynamics.cli', 'sweep', *map(str, arguments)]


@pytest.fixture(scope='module')
def long(tmp_path_factory):
    """Return the file of a sweep that takes a second, and its table by one process."""
    folder = tmp_path_factory.mktemp('long')
    path = folder / 'sweep.yaml'
    path.write_text(FILE.format(urdf=URDF, samples=500, duration=40.0))
    assert run_sweep(read_sweep(path), folder / 'table', workers=1).made == 500
    return path, read_table(folder / 'table')


def parts(folder):
    """Return the part files that are there."""
    return sorted(folder.glob('part-*.parquet'))


def words_of(pid):
    """Return a process's command; nothing if it has ended."""
    with suppress(OSError):
        return Path(f'/proc/{pid}/cmdline').read_bytes()
    return b''


def children(process):
    """Return the process numbers of a process's workers."""
    processes = []
    for pid in Path(
            f'/proc/{process.pid}/task/{process.pid}/children').read_text().split():
        if b'spawn_main' in words_of(pid):
            processes.append(int(pid))
    return processes


@contextmanager
def under_way(path, folder, *options):
    """Start the command; yield it when some rows are there, but not all."""
    with subprocess.Popen(command(path, '--out', folder, *options),
                          stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, text=True) as process:
        try:
            deadline = time.monotonic() + 60.0
            while not parts(folder):
                assert process.poll() is None and time.monotonic() < deadline
                time.sleep(0.01)
            assert len(parts(folder)) < 20
            yield process
        finally:
            process.kill()


def gone(pids, within):
    """Return whether processes end by themselves."""
    deadline = time.monotonic() + within
    while time.monotonic() < deadline:
        if not any(map(words_of, pids)):
            return True
        time.sleep(0.05)
    return False


def test_a_killed_worker_loses_no_row(long, tmp_path):
    path, expected = long
    with under_way(path, tmp_path / 'out', '--workers', 2) as process:
        os.kill(children(process)[0], signal.SIGKILL)
        output, errors = process.communicate(timeout=100)
    assert process.returncode == 0 and errors == '' and '500 simulations' in output
    assert read_table(tmp_path / 'out').equals(expected)


def test_a_killed_command_is_carried_on_and_leaves_no_worker_behind(
        long, tmp_path, capsys):
    path, expected = long
    with under_way(path, tmp_path / 'out', '--workers', 2) as process:
        workers = children(process)
        process.kill()
        process.wait()
    assert len(workers) == 2 and gone(workers, 20.0)
    parts_before = len(parts(tmp_path / 'out'))
    assert 0 < parts_before < 20
    assert main(['sweep', str(path), '--out', str(tmp_path / 'out'), '--workers', '1',
                 '--json']) == 0
    printed = json.loads(capsys.readouterr().out)
    assert (printed['found'], printed['made']) == (25 * parts_before,
                                                   500 - 25 * parts_before)
    assert (printed['samples'], printed['ok'], printed['failed']) == (500, 500, 0)
    assert read_table(tmp_path / 'out').equals(expected)


def test_a_file_names_others_beside_it_and_json_will_do(tmp_path, capsys):
    (tmp_path / 'arm.urdf').write_text(URDF.read_text())
    (tmp_path / 'arm.yaml').write_text('joints: {joint1: {damping: 2.0}}')
    (tmp_path / 'there.csv').write_text('t,q.joint2,q.joint1\n0,0.1,0.2\n0.1,0.3,0.4\n')
    path = tmp_path / 'sweep.json'
    path.write_text(json.dumps({
        'urdf': 'arm.urdf', 'supplement': 'arm.yaml', 'motion': 'there.csv',
        'samples': 2, 'joints': ['joint2', 'joint1'], 'gravity': [0, 0, -1.62],
        'duration': 0.1, 'friction': {'grid': [1, 2]}, 'controller': 'computed_torque'}))
    assert main(['sweep', str(path), '-o', str(tmp_path / 'out'), '--workers', '1']) == 0
    assert '2 simulations in' in capsys.readouterr().out
    exact, rubbing = read_table(tmp_path / 'out').to_pylist()
    assert [exact[f'q0.joint{k}'] for k in (2, 1)] == [0.1, 0.2]
    assert [exact[f'q.joint{k}'] for k in (2, 1)] == pytest.approx([0.3, 0.4], abs=1e-6)
    # At its very end the motion is at rest, which the end of the last step includes.
    assert exact['rms_error.joint1'] < 1e-5 < 1e-3 < rubbing['rms_error.joint1']


@pytest.mark.parametrize('change, words', [
    ('samples: 500', "no 'urdf'; expected"),
    (f'urdf: {URDF}\nsamples: 10\nsample: 3',
     "unknown entry 'sample'; expected one of urdf"),
    (f'urdf: {URDF}\nsamples: 10\nsamples: 20', 'given more than once: samples'),
    (f'urdf: {URDF}\nsamples: 10\nfriction: {{uniform: [2, 1]}}',
     'expected [low, high]'),
    ('urdf: none.urdf\nsamples: 10', 'none.urdf'),
    ('- 1', 'expected entries such as urdf')])
def test_a_bad_file_is_exit_code_2_and_says_what_and_where(
        tmp_path, capsys, change, words):
    path = tmp_path / 'sweep.yaml'
    path.write_text(change)
    assert main(['sweep', str(path), '--out', str(tmp_path / 'out')]) == 2
    printed = capsys.readouterr().err
    assert words in printed and str(tmp_path) in printed
    assert not (tmp_path / 'out').exists()


def test_a_sweep_has_a_floating_base_on_request(tmp_path, capsys):
    path = tmp_path / 'sweep.yaml'
    path.write_text(f'urdf: {URDF}\nroot_joint: free\nsamples: 1\n')
    robot = read_sweep(path).robot
    assert robot.n == 6 + 2 and robot.n_q == 7 + 2
    path.write_text(f'urdf: {URDF}\nroot_joint: loose\nsamples: 1\n')
    assert main(['sweep', str(path), '--out', str(tmp_path / 'out')]) == 2
    assert (
        "sweep.yaml: root_joint: 'loose'; expected one of fixed, free, floating, planar"
        in capsys.readouterr().err)


def test_a_sweep_is_drawn(tmp_path, capsys):
    path = tmp_path / 'sweep.yaml'
    picture = tmp_path / 'sweep.png'
    path.write_text(FILE.format(urdf=URDF, samples=8, duration=0.01))
    assert main(['sweep', str(path), '--out', str(tmp_path / 'table'), '--workers', '1',
                 '--plot', str(picture)]) == 0
    assert picture.read_bytes().startswith(b'\x89PNG')
    assert 'found in the table' not in capsys.readouterr().out
    assert main(['sweep', str(path), '--out', str(tmp_path / 'table'), '--workers',
                 '1']) == 0
    assert ', 8 were in the folder before' in capsys.readouterr().out
