"""Frames of `inspect`, and output that fits a terminal."""

import json
import sys

from kane_dynamics import load_urdf, pose_from, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.cli import main
import numpy as np
from numpy.testing import assert_allclose
import pytest

URDF = str(resource_path('urdf', 'ur10e.urdf'))


def answer(capsys, *arguments):
    """Return the exit code and what a command prints as JSON."""
    code = main([*arguments, '--json'])
    return code, json.loads(capsys.readouterr().out)


def test_inspect_lists_the_frames_with_their_places(capsys):
    assert main(['inspect', URDF, '--frames']) == 0
    printed = capsys.readouterr().out
    rows = [line.split() for line in printed.partition('frames, on')[2].splitlines()[2:]]
    robot = Robot(load_urdf(URDF))
    assert [row[0] for row in rows] == list(robot.frame_names)
    _, data = answer(capsys, 'inspect', URDF)
    q = robot.random_configuration(1)
    for frame in data['frames']:
        body = robot.frame_pose(frame['body'], q)
        assert_allclose(body @ pose_from(frame['position'], rpy=frame['rpy']),
                        robot.frame_pose(frame['frame'], q), atol=1e-14)


def test_torques_of_a_motion_do_not_flood_a_terminal(tmp_path, capsys, monkeypatch):
    robot = Robot(load_urdf(URDF))
    motion = tmp_path / 'motion.csv'
    q = np.linspace(0.0, 1.0, 300)[:, None] * [0.2, -1.0, 1.0, 0.0, 0.3, 0.0]
    lines = [','.join(['t', *robot.joint_names])]
    lines += [','.join(map(repr, [0.01 * k, *row])) for k, row in enumerate(q.tolist())]
    motion.write_text('\n'.join(lines))
    assert main(['torque', URDF, '--motion', str(motion)]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 301  # a pipe takes the rows
    monkeypatch.setattr(sys.stdout, 'isatty', lambda: True, raising=False)
    assert main(['torque', URDF, '--motion', str(motion), '--out',
                 str(tmp_path / 'o.csv')]) == 0
    capsys.readouterr()
    monkeypatch.setattr(sys.stdout, 'isatty', lambda: True, raising=False)
    assert main(['torque', URDF, '--motion', str(motion)]) == 0
    printed = capsys.readouterr().out
    table = np.genfromtxt(tmp_path / 'o.csv', delimiter=',', names=True, deletechars='')
    lift = table['tau.shoulder_lift_joint']
    row = next(line.split()
               for line in printed.splitlines() if line.startswith('shoulder_lift'))
    assert len(printed.splitlines()) == 8
    assert float(row[1]) == pytest.approx(lift[np.argmax(np.abs(lift))], rel=1e-5)
