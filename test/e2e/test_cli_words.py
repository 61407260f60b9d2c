"""Promises of what the command line says: mistakes, faulty files, and motions."""

import csv
import json
import math
import os
from pathlib import Path
import re
import signal
import subprocess
import sys

from kane_dynamics import (ComputedTorque, Controller, load_urdf, ModelWarning, Motion,
                           Robot, simulate)
from kane_dynamics.analysis.model_checks import Finding, print_findings
from kane_dynamics.cli import main
from kane_dynamics.cli.tables import load_trajectory, read_motion
from kane_dynamics.urdf.link_shapes import load_visuals
import numpy as np
import pytest
from urdf_writer import chain, joint, LIMIT, link, robot

CHECKOUT = Path(__file__).resolve().parents[2]
A = link('a')
B = link('b')
C = link('c')
ARM = robot(A, B, C, joint('j1', 'a', 'b', limit=LIMIT),
            joint('j2', 'b', 'c', limit=LIMIT))
POINTS = """
joint_names: [j1, j2]
points:
- {time_from_start: 0.0, positions: [0.0, 0.0]}
- {time_from_start: 1.0, positions: [0.8, -0.5]}
- {time_from_start: 2.0, positions: [0.1, 0.4]}
"""


@pytest.fixture
def files(tmp_path):
    """Return a folder with an arm and a motion of three points."""
    (tmp_path / 'arm.urdf').write_text(ARM)
    (tmp_path / 'motion.yaml').write_text(POINTS)
    return tmp_path


def run_command(capsys, *arguments, code=0):
    """Run a command; return what it printed and its complaints."""
    try:
        left = main([str(word) for word in arguments])
    except SystemExit as end:
        left = end.code
    out = capsys.readouterr()
    assert left == code, out.err
    return out.out, out.err


def test_no_arguments_print_the_help_and_version_the_version(capsys):
    out, err = run_command(capsys)
    assert out.startswith('usage: kane-dynamics') and 'simulate' in out and not err
    out, _ = run_command(capsys, '--version')
    assert out.split()[0] == 'kane-dynamics' and out.split()[1].count('.') == 2


def test_an_impossible_inertia_names_the_option_that_accepts_it(tmp_path, capsys):
    (tmp_path / 'bad.urdf').write_text(
        robot(A, link('b', 1, (-1, 1, 1)), joint('j', 'a', 'b')))
    _, err = run_command(capsys, 'inspect', tmp_path / 'bad.urdf', code=2)
    assert '--no-strict' in err


@pytest.mark.parametrize(('text', 'words'), [
    ('0,0.1,0.2\n1,0.3,0.4\n', r'no header line .*expected t,q.j1'),
    ('t,q.j1\n0,0.1\n1,0.3\n',
     r"no column 'q.j2', but q of other joints; expected q.<joint>")])
def test_a_csv_file_without_the_columns_says_which(files, capsys, text, words):
    (files / 'motion.csv').write_text(text)
    _, err = run_command(capsys, 'torque', files / 'arm.urdf', '--motion',
                         files / 'motion.csv', code=2)
    assert re.search(words, err)


def test_the_points_of_a_motion_are_sampled(files, capsys):
    arm = Robot(load_urdf(ARM))
    out, _ = run_command(capsys, 'torque', files / 'arm.urdf', '--motion',
                         files / 'motion.yaml', '--json')
    got = {}
    for key, value in json.loads(out).items():
        if key != 'joint_names':
            got[key] = np.array(value)
    assert len(got['t']) == 201 and np.diff(got['t']).max() < 0.0101
    motion = read_motion(files / 'motion.yaml', arm.joint_names)
    q, u, udot = motion.sample(np.minimum(got['t'], math.nextafter(2.0, 0.0)))
    np.testing.assert_allclose(got['tau'], arm.inverse_dynamics(q, u, udot), atol=1e-12)
    assert np.abs(got['u']).max() > 0.5, 'the speed between the points is in it'
    assert np.abs(np.diff(got['tau'],
                          axis=0)).max(axis=1)[-1] < 0.2, 'nor does it jump at the end'
    out, _ = run_command(capsys, 'torque', files / 'arm.urdf', '--motion',
                         files / 'motion.yaml', '--step', '0.5', '--json')
    assert json.loads(out)['t'] == [0.0, 0.5, 1.0, 1.5, 2.0]


def test_a_picture_of_a_csv_motion_shows_what_is_between_its_rows(files):
    (files / 'motion.csv').write_text('t,q.j1,q.j2\n0,0,0\n1,0.8,-0.5\n2,0.1,0.4\n')
    arm = Robot(load_urdf(ARM))
    shown = load_trajectory(str(files / 'motion.csv'), arm)
    assert len(shown.t) == 201 and np.abs(shown.u).max() > 0.5


@pytest.mark.parametrize('command', [
    ['torque', 'ARM', '--q', '0', '-90'],
    ['simulate', 'ARM', '--q0', '45', '0', '--step', '0.1', '--duration', '0.1'],
    ['torque', 'ARM', '--motion', 'degrees.csv'],
    ['feasible', 'ARM', '--motion', 'degrees.csv'],
    ['replay', 'ARM', 'degrees.csv']])
def test_positions_far_outside_get_asked_whether_they_are_degrees(
        files, capsys, command):
    t = np.linspace(0.0, 1.0, 50)
    with open(files / 'degrees.csv', 'w', newline='') as stream:
        rows = csv.writer(stream)
        rows.writerow(['t', 'q.j1', 'q.j2', 'tau.j1', 'tau.j2'])
        rows.writerows(np.column_stack([t, 90.0 * t, -45.0 * t, t, t]).tolist())
    names = {'ARM': files / 'arm.urdf', 'degrees.csv': files / 'degrees.csv'}
    main([str(names.get(word, word)) for word in command])
    err = ''.join(capsys.readouterr())
    assert 'are these degrees?' in err
    assert 'rad (limits -1 to 1)' in err or command[0] == 'replay'


def test_library_asks_once_whether_positions_are_degrees(files):
    arm = Robot(load_urdf(files / 'arm.urdf'))
    motion = Motion.from_points([0.0, 1.0], [[0.0, 0.0], [90.0, 0.0]],
                                joint_names=('j1', 'j2'))
    controller = Controller(arm)
    asked = 'j1 90 rad .*are these degrees'
    for call in (lambda: simulate(arm, [90.0, 0.0], [0.0, 0.0], 0.01),
                 lambda: simulate(arm, [[0.0, 0.0], [90.0, 0.0]], np.zeros((2, 2)),
                                  0.01),
                 lambda: ComputedTorque(arm, motion),
                 lambda: controller.command(0.0, [0.0, 0.0], [0.0, 0.0], motion)):
        with pytest.warns(ModelWarning, match=asked) as caught:
            call()
        assert len(caught) == 1
    controller.command(0.1, [0.0, 0.0], [0.0, 0.0], motion)  # warnings are errors


@pytest.mark.parametrize('arguments', [
    ['torque', 'arm.urdf', '--motion', 'motion.yaml', '--step', '1e-4'],
    ['inspect', '--help'],
    ['--version'], ['inspect', 'arm.urdf']], ids=' '.join)
def test_broken_pipe_is_quiet(files, arguments):
    # As `| head` when the reader has ended: the pipe is closed before anything is
    # written.
    reading, writing = os.pipe()
    os.close(reading)
    try:
        done = subprocess.run(
            [sys.executable, '-m', 'kane_dynamics.cli', *arguments], cwd=files,
            stdout=writing, stderr=subprocess.PIPE, check=False,
            env={**os.environ, 'PYTHONPATH': str(CHECKOUT), 'PYTHONUNBUFFERED': ''})
    finally:
        os.close(writing)
    assert done.stderr == b''
    assert done.returncode == 128 + signal.SIGPIPE


def test_error_in_yaml_is_one_line(files, capsys):
    (files / 'motion.yaml').write_text(
        'joint_names: [j1, j2\npoints:\n- {positions: [0}\n')
    _, err = run_command(capsys, 'torque', files / 'arm.urdf', '--motion',
                         files / 'motion.yaml', code=2)
    assert err.count('\n') == 1 and 'not valid YAML: while parsing' in err


def test_out_has_a_short_name_in_every_command(files, capsys):
    out = files / 'out.csv'
    for words in (['simulate', '--duration', '0.01'], ['torque', '--motion',
                                                       str(files / 'motion.yaml')]):
        run_command(capsys, words[0], files / 'arm.urdf', *words[1:], '-o', out)
        assert out.read_text().startswith('t,')
        out.unlink()


def test_one_problem_is_counted_as_one(capsys):
    print_findings(
        [Finding('problem', 'x'), Finding('warning', 'y'), Finding('warning', 'z')])
    printed = capsys.readouterr().out
    assert printed.endswith('1 problem, 2 warnings, 0 cannot judge, 0 fine\n')


def test_positions_a_little_beyond_the_limits_are_named_and_not_taken_for_degrees(
        files, capsys):
    _, err = run_command(capsys, 'torque', files / 'arm.urdf', '--q', '0.4', '-3.1')
    assert err == ('kane-dynamics: warning: --q: outside the limits: j2 -3.1 '
                   '(limits -1 to 1)\n')
    _, err = run_command(capsys, 'torque', files / 'arm.urdf', '--q', '1.0', '-1.0')
    assert not err


@pytest.mark.parametrize(('lower', 'upper', 'asked'), [
    (-180, 180, True), (-90, 90, True), (0, 360, True), (-6.2832, 6.2832, False),
    (-12.566, 12.566, False), (-1e9, 1e9, False)])
def test_limits_of_many_turns_get_asked_whether_they_are_degrees(
        tmp_path, capsys, lower, upper, asked):
    limit = f'<limit lower="{lower}" upper="{upper}" velocity="1" effort="1"/>'
    (tmp_path / 'arm.urdf').write_text(robot(A, B, joint('j', 'a', 'b', limit=limit)))
    _, err = run_command(capsys, 'torque', tmp_path / 'arm.urdf')
    assert ('degrees?' in err) == asked
    slide = robot(A, B, joint('j', 'a', 'b', 'prismatic', limit=limit))
    (tmp_path / 'arm.urdf').write_text(slide)
    assert 'degrees' not in run_command(capsys, 'torque',
                                        tmp_path / 'arm.urdf')[1], 'metres may be many'


def test_missing_inertials_leave_the_tree_and_are_a_problem(tmp_path, capsys):
    path = tmp_path / 'arm.urdf'
    path.write_text(robot(A, B, link('c', None), joint('j1', 'a', 'b', limit=LIMIT),
                          joint('j2', 'b', 'c', limit=LIMIT)))
    for options in ([], ['--operations'], ['--json']):
        out, _ = run_command(capsys, 'inspect', path, *options)
        assert 'j1' in out and 'j2' in out and 'no mass moves with j2' in out
    out, _ = run_command(capsys, 'doctor', path, code=1)
    assert 'problem: URDF: moving links without <inertial>' in out
    assert 'problem: no mass moves with j2' in out and '2 problems' in out


def test_warnings_are_a_line_a_kind_and_verbose_names_all(tmp_path, capsys):
    path = tmp_path / 'arm.urdf'
    path.write_text(chain(40, limit=''))
    _, err = run_command(capsys, 'torque', path)
    assert len(err.splitlines()) == 1
    assert len(err) < 250
    assert 'more (--verbose names all)' in err
    _, err = run_command(capsys, 'torque', path, '--verbose')
    assert 'more (--verbose' not in err and all(f'j{k}' in err for k in range(1, 41))


def test_transmissions_and_gazebo_are_mentioned_only_on_request(tmp_path, capsys):
    path = tmp_path / 'arm.urdf'
    path.write_text(
        robot(A, B, joint('j', 'a', 'b', limit=LIMIT),
              '<transmission name="t"><joint name="j"/></transmission>',
              '<gazebo reference="j"><springStiffness>1</springStiffness></gazebo>'))
    assert not run_command(capsys, 'torque', path)[1]
    assert '<transmission>: j' in run_command(capsys, 'torque', path, '-v')[1]
    assert '<transmission>: j' in run_command(capsys, 'inspect', path)[0]


def test_missing_meshes_say_what_to_do():
    mesh = ('<visual><geometry><mesh '
            'filename="package://lost/{}.stl"/></geometry></visual>')
    links = [link(name).replace('</link>', mesh.format(name) + '</link>')
             for name in 'ab']
    with pytest.warns(UserWarning,
                      match='2 meshes not found: .*expected the URDF inside its '
                      'package or the workspace in AMENT_PREFIX_PATH'):
        load_visuals(robot(*links, joint('j', 'a', 'b', limit=LIMIT)))


def test_rounding_errors_are_printed_as_zero(tmp_path, capsys):
    path = tmp_path / 'arm.urdf'
    path.write_text(ARM)
    out, _ = run_command(capsys, 'torque', path, '--q', '0.1', '0.2', '--gravity',
                         '1e-17', '9', '0')
    assert 'e-1' not in out


def test_a_torque_function_of_another_signature_or_without_result_is_named():
    arm = Robot(load_urdf(ARM))
    for torque, words in ((lambda q: q, r'torque\(t, q, u\)'),
                          (lambda t, q, u: None, 'None')):
        with pytest.raises(ValueError, match=words):
            simulate(arm, [0.0, 0.0], [0.0, 0.0], 0.01, torque=torque)


@pytest.mark.parametrize(('redirection', 'code', 'words'), [
    ('- <&-', 2, "error: URDF: '-', and standard input is closed"),
    ('urdf/two_link.urdf >&-', 0, '')])
def test_closed_streams_are_no_traceback(redirection, code, words):
    program = f'{sys.executable} -m kane_dynamics.cli torque {redirection}'
    done = subprocess.run(['bash', '-c', program],
                          capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == code
    assert words in done.stderr and 'Traceback' not in done.stderr
