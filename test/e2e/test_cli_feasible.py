"""Promises of `kane-dynamics feasible`: what fits, and how much it may carry."""

import json
import math
from pathlib import Path
import re
import subprocess
import sys

from kane_dynamics import load_urdf, Motion, Robot, SmoothMotion
from kane_dynamics.cli import main
from kane_dynamics.feasibility import demand, fastest, largest_payload
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


def answer(capsys, *arguments, urdf=URDF):
    """Return exit code and JSON of the command, run in this process."""
    code = main(['feasible', str(urdf), *arguments, '--json'])
    return code, json.loads(capsys.readouterr().out)


def test_a_motion_beyond_the_limits_is_named_and_exits_1(trajectory, tmp_path):
    picture = tmp_path / 'use.png'
    done = subprocess.run(
        [sys.executable, '-m', 'kane_dynamics.cli', 'feasible', str(URDF),
         '--motion', trajectory, '--plot', str(picture)],
        capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 1, done.stderr
    assert 'is NOT feasible' in done.stdout
    assert 'highest feasible speed: 0.' in done.stdout
    assert "joint 'shoulder_lift_joint': speed" in done.stdout
    assert picture.read_bytes().startswith(b'\x89PNG')


@pytest.mark.parametrize('jumps', [False, True])
def test_motion_written_at_the_highest_speed_fits_with_no_room_left(
        trajectory, tmp_path, capsys, jumps):
    velocities = None
    urdf = URDF
    # cubics, whose accelerations jump where they, and so the efforts, are largest
    if jumps:
        velocities = np.zeros((4, 6))
        urdf = tmp_path / 'swift.urdf'
        urdf.write_text(re.sub('velocity="[^"]*"', 'velocity="100"', URDF.read_text()))
        header = ','.join(['t', *(f'{what}.{name}' for what in 'qu' for name in NAMES)])
        np.savetxt(trajectory, np.column_stack([TIMES, POINTS, velocities]),
                   delimiter=',', comments='', header=header)
    out = str(tmp_path / 'fits.csv')
    power = [] if jumps else ['--power', '100']
    code, data = answer(capsys, '--motion', trajectory, *power, '--out', out,
                        urdf=urdf)
    expected = fastest(Robot(load_urdf(urdf)), Motion.from_points(
        TIMES, POINTS, velocities, joint_names=NAMES),
                       power=math.inf if jumps else 100.0)
    assert code == 1 and expected.limit == ('effort' if jumps else 'power')
    assert data['fastest']['speed'] == pytest.approx(expected.speed)
    code, again = answer(capsys, '--motion', out, *power, urdf=urdf)
    assert code == 0 and again['fits'] and not again['excesses']
    assert again['fastest']['speed'] == pytest.approx(1.0, abs=1e-8)
    assert again['duration'] == pytest.approx(1.5 / expected.speed)


def test_payload_is_that_of_the_slower_motion(trajectory, capsys):
    load = ['--payload-frame', 'tool0', '--payload-com', '0', '0', '0.1']
    code, data = answer(capsys, '--motion', trajectory, '--speed', '0.2', *load)
    assert code == 0 and 1.0 < data['payload']['mass'] < 100.0
    assert data['payload']['joint'] in NAMES and data['payload']['limit'] == 'effort'
    code, data = answer(capsys, '--motion', trajectory, *load, '--power', '1000')
    assert code == 1 and data['payload'] is None  # too fast without any
    assert data['power']['limit'] == [1000.0] * 6


def test_motion_that_fits_at_no_speed_says_why(trajectory, capsys):
    main(['feasible', str(URDF), '--motion', trajectory, '--gravity', '0', '0',
          '-100'])
    assert 'at no speed: a limit is exceeded even at the lowest speed: joint' in (
        capsys.readouterr().out)
    assert main(['feasible', str(URDF), '--motion', trajectory, '--gravity', '0',
                 '0', '-100', '--out', 'none.csv']) == 2
    assert 'no feasible speed' in capsys.readouterr().err


def test_fastest_timing_is_written_and_satisfies_the_limits(
        trajectory, tmp_path, capsys):
    out = str(tmp_path / 'fastest.csv')
    picture = str(tmp_path / 'timing.png')
    code, data = answer(capsys, '--motion', trajectory, '--time-optimal', '--out',
                        out, '--plot', picture)
    assert code == 0 and data['files'] == [out, picture]
    assert data['active']
    assert {active['joint'] for active in data['active']} <= set(NAMES)
    code, checked = answer(capsys, '--motion', out)
    assert code == 0 and checked['fits']
    assert checked['duration'] == pytest.approx(data['duration'], rel=1e-9)
    _, scaled = answer(capsys, '--motion', trajectory)
    assert data['duration'] < 0.9 * 1.5 / scaled['fastest']['speed']


def test_fastest_timing_keeps_limits_of_jerk_and_torque_rate(
        trajectory, capsys, tmp_path):
    code, free = answer(capsys, '--motion', trajectory, '--time-optimal')
    out = str(tmp_path / 'fastest.csv')
    code, data = answer(capsys, '--motion', trajectory, '--time-optimal', '--jerk',
                        '300', '--torque-rate', '500', '--out', out)
    assert code == 0 and data['duration'] > free['duration']
    assert 0.99 < max(*data['uses']['jerk'], *data['uses']['torque_rate']) <= 1.0
    code, checked = answer(capsys, '--motion', out)
    assert code == 0 and checked['fits']
    assert main(['feasible', str(URDF), '--motion', trajectory, '--time-optimal',
                 '--jerk', '-1']) != 0
    assert 'jerk of joint' in capsys.readouterr().err


def test_drives_of_a_supplement_are_compared_with_the_limits_of_motors_and_gears(
        tmp_path, capsys):
    """Positions alone are a smooth motion of links; speeds need a continuous jerk."""
    driven = NAMES[:3]
    drive = {'stiffness': 20000.0, 'rotor_inertia': 2.0, 'gear_effort': 300.0}
    supplement = tmp_path / 'drives.yaml'
    supplement.write_text(json.dumps({'drives': dict.fromkeys(driven, drive)}))
    path = tmp_path / 'motion.csv'
    fast = tmp_path / 'fast.csv'
    table = np.column_stack([[0.0, 1.0, 2.0], 0.3 * POINTS[:3]])
    np.savetxt(path, table, delimiter=',', comments='', header=','.join(['t', *NAMES]))
    arguments = ('--supplement', str(supplement), '--motion', str(path))
    code, data = answer(capsys, *arguments, '--payload-frame', 'tool0', '--out',
                        str(fast))
    robot = Robot(load_urdf(URDF, supplement=supplement))
    motion = SmoothMotion.from_points(table[:, 0], table[:, 1:], joint_names=NAMES)
    assert code == 0 and data['joint_names'][6:] == [f'{name}_motor' for name in driven]
    scale = fastest(robot, motion)
    assert data['fastest']['speed'] == pytest.approx(scale.speed)
    assert data['torque']['use'][0] == pytest.approx(data['torque']['peak'][0] / 300.0)
    carrying = Robot(robot.model, payload_frame='tool0')
    assert data['payload']['mass'] == pytest.approx(
        largest_payload(carrying, motion).mass)
    header, *rows = fast.read_text().splitlines()
    assert 'q.shoulder_pan_joint_motor' in header
    assert float(rows[-1].split(',')[0]) == pytest.approx(2.0 / scale.speed)
    # Of links and motors, only the latter have motors whose power counts.
    needed = demand(robot, motion)
    assert data['power']['peak_of_all'] == pytest.approx(
        needed.power[:, 3:].sum(axis=1).max())

    with_speeds = tmp_path / 'speeds.csv'
    np.savetxt(with_speeds, np.column_stack([table, np.zeros((3, 6))]), delimiter=',',
               comments='',
               header=','.join(['t', *NAMES, *(f'u.{name}' for name in NAMES)]))
    assert main(['feasible', str(URDF), '--supplement', str(supplement), '--motion',
                 str(with_speeds)]) == 2
    assert 'speeds.csv: motion: the' in capsys.readouterr().err
