"""Files of states: exact values, columns by name, errors that name the place."""

import io

from kane_dynamics.cli.tables import read_motion, read_rows, read_states, write_states
from kane_dynamics.errors import InputError
import numpy as np
import pytest

NAMES = ('lift', 'reach')
POINTS = """joint_names: [lift, reach]
points: [{{time_from_start: {{{}}}, positions: [0, 1], effort: []}},
         {{time_from_start: 4.5, positions: [2, 3]}}]"""


def file(tmp_path, text, name='states.csv'):
    """Write a file and return its path."""
    path = tmp_path / name
    path.write_text(text)
    return path


def test_written_states_are_read_back_exactly(tmp_path):
    t, q, tau = np.arange(3) / 3.0, *np.random.default_rng(0).normal(size=(2, 3, 2))
    stream = io.StringIO()
    write_states(stream, t, {'q': q, 'tau': tau}, NAMES)
    states = read_states(file(tmp_path, stream.getvalue()), NAMES)
    for got, written in ((states.t, t), (states.q, q), (states.tau, tau)):
        np.testing.assert_array_equal(got, written)
    assert states.u is None and states.udot is None


def test_columns_are_found_by_name_in_any_order_and_others_are_left_alone(tmp_path):
    path = file(tmp_path,
                '\ufeffnote,reach, time,q.lift,other\nx,1, 5,2,3\n\ny,4,6,7,8\n')
    states = read_states(path, NAMES)
    np.testing.assert_array_equal(states.q, [[2.0, 1.0], [7.0, 4.0]])
    np.testing.assert_array_equal(states.t, [5.0, 6.0])


@pytest.mark.parametrize(('text', 'words'), [
    ('', ['0 lines', 'header']),
    ('t,q.lift,q.reach\n', ['1 lines']),
    ('t,x\n0,1\n', ['q.lift', "['t', 'x']"]),
    ('t,q.lift\n0,1\n', ["no column 'q.reach'", 'q of other joints']),
    ('t,q.lift,q.reach\n0,1,2\n1,x,3\n', ['row 2', 'q.lift', "'x'"]),
    ('t,q.lift,q.reach\n0,1\n', ['row 1', 'q.reach', 'missing']),
])
def test_a_bad_csv_file_is_refused_by_place(tmp_path, text, words):
    with pytest.raises(InputError) as caught:
        read_states(file(tmp_path, text), NAMES)
    for word in ['states.csv', *words]:
        assert word in str(caught.value)


@pytest.mark.parametrize(('name', 'text', 'words'), [
    ('m.csv', 'q.lift,q.reach\n0,1\n', ["'t'"]),
    ('m.csv', 't,q.lift,q.reach\n0,1,2\n0,1,2\n', ['point 1', '0.0 s']),
    ('m.yaml', '[1, 2', ['m.yaml']),
    ('m.yaml', 'points: []', ['joint_names']),
    ('m.yaml', 'points: []\njoint_names: [lift, reach]', ['times', 'at least one']),
    ('m.yaml', 'points: 3\njoint_names: [lift, reach]', ['points', 'time_from_start']),
    ('m.yaml', 'joint_names: [lift]\npoints: [{time_from_start: 0, positions: [1]}]',
     ['reach']),
    ('m.yaml', 'joint_names: [lift, reach]\npoints: [{positions: [1, 2]}]',
     ['time_from_start']),
    ('m.yaml',
     'joint_names: [lift, reach]\npoints: [{time_from_start: soon, positions: [1, 2]}]',
     ['soon']),
    ('m.yaml', POINTS.format('sec: 1, nsec: 500000000'),
     ['point 0: time_from_start', "'nsec'", 'sec, nanosec']),
    ('m.yaml', POINTS.format('secs: 3'), ["'secs'", 'sec, nanosec']),
    ('m.yaml',
     POINTS.format('sec: 1').replace('positions: [0', 'velocity: [1, 1], positions: [0'),
     ['point 0', "'velocity'", 'velocities']),
    ('m.yaml', POINTS.format('sec: 1').replace('[lift, reach]', 'lr'),
     ['joint_names', "'lr'"]),
    ('m.yaml', 'joint_trajectory: 1\n' + POINTS.format('sec: 1'),
     ["'joint_trajectory'"]),
    ('m.yaml', POINTS.format('sec: 1') + '\npoints: []', ['more than once', 'points']),
])
def test_a_bad_motion_file_is_refused_by_name(tmp_path, name, text, words):
    with pytest.raises(InputError) as caught:
        read_motion(file(tmp_path, text, name), NAMES)
    for word in [name, *words]:
        assert word in str(caught.value)


@pytest.mark.parametrize(('second', 'words'), [
    ('0', 'after 1.0'), ('1', 'after 1.0'), ('nan', 'nan in row 2'),
    ('inf', 'inf in row 2')])
def test_rows_of_states_must_go_on_in_time(tmp_path, second, words):
    path = file(tmp_path,
                f't,lift,reach,u.lift,u.reach,udot.lift,udot.reach\n1{",0" * 6}\n'
                f'{second}{",0" * 6}\n')
    with pytest.raises(InputError, match=f"states.csv: column 't': .*{words}"):
        read_rows(str(path), NAMES)


def test_times_of_a_message_count_seconds_and_nanoseconds(tmp_path):
    path = file(tmp_path, POINTS.format('sec: 1, nanosec: 500000000'), 'm.yaml')
    assert read_motion(path, NAMES).times.tolist() == [1.5, 4.5]


def test_a_file_that_is_not_there_or_not_text_is_refused(tmp_path):
    with pytest.raises(InputError, match='nosuch'):
        read_states(tmp_path / 'nosuch.csv', NAMES)
    (tmp_path / 'binary.csv').write_bytes(b'\xff\xfe\x00')
    with pytest.raises(InputError, match='seems to be a binary file'):
        read_states(tmp_path / 'binary.csv', NAMES)


def test_a_message_as_ros2_prints_it_is_read_and_two_of_them_are_refused(tmp_path):
    message = (
        'joint_names: [j]\npoints:\n- positions: [0.0]\n  time_from_start: {sec: 0}\n'
        '- positions: [1.0]\n  time_from_start: {sec: 2}\n---\n')
    path = tmp_path / 'plan.yaml'
    path.write_text(message)
    assert read_motion(path, ['j']).duration == 2.0
    path.write_text(2 * message)
    with pytest.raises(InputError, match=': 2 YAML documents; expected one'):
        read_motion(path, ['j'])
