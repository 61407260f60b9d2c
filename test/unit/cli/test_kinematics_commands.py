"""Commands for frames, Jacobians and inverse kinematics; output that fits a terminal."""

import json
import sys

from kane_dynamics import inverse_kinematics, load_urdf, pose_from, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.cli import main
import numpy as np
from numpy.testing import assert_allclose
import pytest

URDF = str(resource_path('urdf', 'ur10e.urdf'))
Q = ['0.1', '-1.2', '1.4', '0.3', '0.5', '0']


def answer(capsys, *arguments):
    """Return the exit code and what a command prints as JSON."""
    code = main([*arguments, '--json'])
    return code, json.loads(capsys.readouterr().out)


@pytest.mark.parametrize('axes', ['world', 'frame'])
def test_the_jacobian_is_that_of_the_library(axes, capsys):
    code, data = answer(capsys, 'jacobian', URDF, 'tool0', '--q', *Q, '--axes', axes)
    robot = Robot(load_urdf(URDF))
    q = np.array(Q, dtype=float)
    assert code == 0
    assert_allclose(data['jacobian'], robot.jacobian('tool0', q, axes=axes), atol=1e-15)
    assert_allclose(pose_from(np.array(data['pose'])[:3, 3],
                              quaternion=data['quaternion']),
                    robot.frame_pose('tool0', q), atol=1e-14)
    assert_allclose(pose_from(np.array(data['pose'])[:3, 3], rpy=data['rpy']),
                    robot.frame_pose('tool0', q), atol=1e-14)
    assert main(['jacobian', URDF, 'tool0', '--q', *Q]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith('tool0: at ') and len(lines) == 9
    assert main(['jacobian', URDF, 'tool9']) == 2
    assert "no frame 'tool9'; expected one of" in capsys.readouterr().err


def test_rounding_errors_of_a_pose_and_of_a_singular_configuration_are_zero(capsys):
    assert main(['jacobian', URDF, 'tool0', '--q', '0', '-1', '1', '0', '0', '0']) == 0
    lines = capsys.readouterr().out.splitlines()
    assert 'roll, pitch, yaw 1.5708, 0, -3.14159 rad' in lines[0]
    assert lines[-1].endswith(', 0') and 'e-' not in ''.join(lines)


def test_inverse_kinematics_reaches_what_it_can_and_says_what_it_cannot(capsys):
    pose = ['--position', '0.5', '0.2', '0.4', '--rpy', '3.14159', '0', '0.3']
    code, data = answer(capsys, 'inverse-kinematics', URDF, 'tool0', *pose)
    robot = Robot(load_urdf(URDF))
    target = pose_from((0.5, 0.2, 0.4), rpy=(3.14159, 0.0, 0.3))
    assert code == 0 and data['converged']
    assert_allclose(robot.frame_pose('tool0', data['q']), target, atol=1e-7)
    assert_allclose(data['q'], inverse_kinematics(robot, 'tool0', target).q, atol=1e-12)
    assert main(['inverse-kinematics', URDF, 'tool0', '--position', '9', '0', '0']) == 1
    assert 'not reached: 7.' in capsys.readouterr().out
    code, data = answer(capsys, 'inverse-kinematics', URDF, 'tool0', '--position', '0.5',
                        '0.2', '0.4', '--quaternion', '1', '0', '0', '0', '--q0', *Q)
    assert code == 0 and data['distance'] < 1e-8 and data['angle'] < 1e-8


def test_a_warning_has_the_form_of_the_command_line_and_names_no_source(capsys):
    assert main(['inverse-kinematics', URDF, 'tool0', '--position', '500', '200',
                 '300']) == 1
    _, line = capsys.readouterr().err.splitlines()  # behind a note of the supplement
    assert line.startswith('kane-dynamics: warning: target: 615')
    assert line.endswith('mm?')


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


def test_cartesian_writes_a_motion_along_its_path_and_names_what_is_missing(
        capsys, tmp_path):
    home = ['0', '-1.2', '1.4', '-1.77', '-1.57', '0']
    out = tmp_path / 'motion.csv'
    path = ['--to', '0.7', '0.3', '0.5', '--via', '0.75', '0.1', '0.5',
            '--to', '0.7', '-0.1', '0.5', '-2.4', '0', '0', '--blend', '0.01']
    code, data = answer(capsys, 'cartesian', URDF, 'tool0', '--q', *home, *path, '-o',
                        str(out))
    assert code == 0 and data['files'] == [str(out)] and data['distance'] < 1e-5
    corner, = data['corners']
    assert corner['distance'] <= 0.01 and not corner['rests']
    robot = Robot(load_urdf(URDF))
    end = robot.frame_pose('tool0', data['end'])
    assert_allclose(end, pose_from((0.7, -0.1, 0.5), rpy=(-2.4, 0.0, 0.0)), atol=1e-8)
    header, *rows = out.read_text().splitlines()
    assert header.startswith('t,q.shoulder_pan_joint,')
    assert len(rows) > 100 * data['duration']
    assert_allclose([float(x) for x in rows[-1].split(',')[1:7]], data['end'],
                    atol=1e-12)
    assert main(['cartesian', URDF, 'tool0', '--q', *home, '--to', '0.7', '0.3', '0.5',
                 '--free', '--duration', '2']) == 0
    assert capsys.readouterr().out.startswith('2 s; distance from the path')
    for arguments, message in (
            ([], '--to: missing'),
            (['--to', '1', '2'], '--to: 2 numbers; expected 3 or 6'),
            (['--via', '1', '2', '3'], '--to: missing'),
            (['--via', '1', '2', '3', '--via', '1', '2', '3'], '--via: two in a row'),
            (['--to', '2', '0', '0.5'], "'tool0' does not reach"),
            (['--to', '0.7', '0.3', '0.5', '--rate', '0'], '--rate: 0.0; expected'),
            (['--to', '0.7', '0.3', '0.5', '--linear', '0', '1', '1'], 'linear: ')):
        assert main(['cartesian', URDF, 'tool0', '--q', *home, *arguments]) == 2
        assert message in capsys.readouterr().err
