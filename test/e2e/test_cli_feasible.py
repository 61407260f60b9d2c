"""Promises of `kane-dynamics feasible`: what fits, what would, and how much it may carry."""

import json
from pathlib import Path
import subprocess
import sys

from kane_dynamics import load_urdf, Motion, Robot
from kane_dynamics.cli import main
from kane_dynamics.feasibility import fastest
import numpy as np
import pytest

URDF = Path(__file__).resolve().parents[2] / 'urdf' / 'ur10e.urdf'
NAMES = load_urdf(URDF).joint_names
TIMES = [0.0, 0.5, 1.0, 1.5]
POINTS = np.random.default_rng(0).uniform(-1.0, 1.0, (4, 6))


@pytest.fixture
def trajectory(tmp_path):
    """Return the path of a motion that is too fast."""
    path = tmp_path / 'motion.csv'
    np.savetxt(path, np.column_stack([TIMES, POINTS]), delimiter=',', comments='',
               header=','.join(['t', *(f'q.{name}' for name in NAMES)]))
    return str(path)


def answer(capsys, *arguments):
    """Return exit code and JSON of the command, run in this process."""
    code = main(['feasible', str(URDF), *arguments, '--json'])
    return code, json.loads(capsys.readouterr().out)


def test_what_does_not_fit_is_named_and_exits_1_as_a_process(trajectory, tmp_path):
    picture = tmp_path / 'use.png'
    done = subprocess.run([sys.executable, '-m', 'kane_dynamics.cli', 'feasible', str(URDF),
                           '--trajectory', trajectory, '--plot', str(picture)],
                          capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 1, done.stderr
    assert 'does NOT fit' in done.stdout and 'highest speed that fits: 0.' in done.stdout
    assert "joint 'shoulder_lift_joint': speed" in done.stdout
    assert picture.read_bytes().startswith(b'\x89PNG')


def test_motion_written_at_the_highest_speed_fits_with_no_room_left(trajectory, tmp_path, capsys):
    out = str(tmp_path / 'fits.csv')
    code, data = answer(capsys, '--trajectory', trajectory, '--out', out)
    expected = fastest(Robot(load_urdf(URDF)),
                       Motion.from_points(TIMES, POINTS, joint_names=NAMES))
    assert code == 1 and data['fastest']['speed'] == pytest.approx(expected.speed)
    code, again = answer(capsys, '--trajectory', out, '--step', '0.002',
                         '--speed', str(1.0 - 1e-9))
    assert code == 0 and again['fits'] and not again['excesses']
    assert again['fastest']['speed'] == pytest.approx(1.0, abs=1e-6)
    assert again['duration'] == pytest.approx(1.5 / expected.speed)


def test_payload_is_that_of_the_slower_motion(trajectory, capsys):
    load = ['--payload-frame', 'tool0', '--payload-com', '0', '0', '0.1']
    code, data = answer(capsys, '--trajectory', trajectory, '--speed', '0.2', *load)
    assert code == 0 and 1.0 < data['payload']['mass'] < 100.0
    assert data['payload']['joint'] in NAMES and data['payload']['limit'] == 'effort'
    code, data = answer(capsys, '--trajectory', trajectory, *load, '--power', '1000')
    assert code == 1 and data['payload'] is None  # too fast without any
    assert data['power']['limit'] == [1000.0] * 6


def test_motion_that_fits_at_no_speed_says_why(trajectory, capsys):
    main(['feasible', str(URDF), '--trajectory', trajectory, '--gravity', '0', '0', '-100'])
    assert 'at no speed: hardly moving it passes a limit already: joint' in (
        capsys.readouterr().out)
    assert main(['feasible', str(URDF), '--trajectory', trajectory, '--gravity', '0', '0', '-100',
                 '--out', 'none.csv']) == 2
    assert 'none does' in capsys.readouterr().err
