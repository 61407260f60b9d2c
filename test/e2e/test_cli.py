"""Promises of the command line, on an arm whose torques are known in closed form."""

import csv
import json
import subprocess
import sys

from kane_dynamics.cli import main
from kane_dynamics.simulation.trajectory import Trajectory
import numpy as np
import pytest

ARM = """<robot name="arm">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.5 0 0"/><mass value="2"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="fore"><inertial><mass value="1"/>
    <inertia ixx="0.05" iyy="0.05" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="lift" type="revolute"><parent link="base"/><child link="upper"/>
    <axis xyz="0 1 0"/><dynamics damping="0.5"/>
    <limit lower="-3" upper="3" velocity="4" effort="60"/></joint>
  <joint name="reach" type="prismatic"><parent link="upper"/><child link="fore"/>
    <origin xyz="0.8 0 0"/><axis xyz="1 0 0"/>
    <limit lower="-0.4" upper="0.4" velocity="2" effort="80"/></joint>
</robot>"""
STATE = (np.array([0.3, -1e-3]), np.array([0.5, -0.2]), np.array([1.0, 2.0]))
STATE_WORDS = ['--q', '0.3', '-1e-3', '--u', '0.5,-0.2', '--udot', '1', '2']


def expected(q, u, udot, damping=0.5):
    """Return the arm's inverse dynamics by hand, (..., 2)."""
    (q0, q1), (u0, u1), (a0, a1) = np.moveaxis(np.array([q, u, udot]), -1, 1)
    r = 0.8 + q1
    g = 9.81
    lift = ((0.65 + r ** 2) * a0 + 2 * r * u0 * u1 - g * (1.0 + r) * np.cos(q0)
            + damping * u0)
    return np.stack([lift, a1 - r * u0 ** 2 - g * np.sin(q0)], axis=-1)


@pytest.fixture
def urdf(tmp_path):
    """Return the path of the arm's URDF."""
    path = tmp_path / 'arm.urdf'
    path.write_text(ARM)
    return str(path)


@pytest.fixture
def answer(capsys):
    """Return a function that runs a command in this process and returns its JSON."""
    def run(*arguments):
        assert main([*arguments, '--json']) == 0
        return json.loads(capsys.readouterr().out)
    return run


def process(*arguments, text=None):
    """Run a command as a process of its own."""
    return subprocess.run([sys.executable, '-m', 'kane_dynamics.cli', *arguments],
                          input=text,
                          capture_output=True, text=True, check=False, timeout=120)


def rows(path):
    """Return a CSV file as columns by name."""
    with open(path, newline='') as file:
        lines = list(csv.DictReader(file))
    return {name: np.array([float(line[name]) for line in lines]) for name in lines[0]}


def write(path, **columns):
    """Write a CSV file; a dot in a column's name is given as two underscores."""
    with open(path, 'w', newline='') as file:
        writer = csv.writer(file)
        writer.writerow([name.replace('__', '.') for name in columns])
        writer.writerows(np.column_stack(list(columns.values())).tolist())
    return str(path)


def test_torque_prints_a_table_and_json_that_a_process_can_read(urdf):
    done = process('torque', urdf, *STATE_WORDS)
    assert done.returncode == 0 and done.stderr == ''
    header, lift, reach = (line.split() for line in done.stdout.splitlines())
    assert header == ['joint', 'torque', 'inertia', 'coriolis', 'gravity', 'friction',
                      'spring']
    assert lift[0] == 'lift' and lift[2:4] == ['N', 'm'] and reach[2] == 'N'
    assert float(lift[1]) == pytest.approx(expected(*STATE)[0], rel=1e-5)
    done = process('torque', '-', '--json', *STATE_WORDS, text=ARM)
    assert done.returncode == 0
    np.testing.assert_allclose(json.loads(done.stdout)['tau'], expected(*STATE),
                               rtol=1e-13)


def test_torque_terms_add_up_and_friction_can_be_left_out(urdf, answer):
    got = answer('torque', urdf, *STATE_WORDS)
    np.testing.assert_allclose(sum(map(np.array, got['terms'].values())), got['tau'])
    assert got['terms']['friction'] == [0.25, 0.0]
    bare = answer('torque', urdf, '--no-friction', *STATE_WORDS)
    np.testing.assert_allclose(bare['tau'], expected(*STATE, damping=0.0), rtol=1e-13)


def test_gravity_and_joints_choose_what_is_computed(urdf, answer):
    got = answer('torque', urdf, '--gravity', '0', '0', '0', '--joints', 'reach',
                 '--udot', '3')
    assert got['joint_names'] == ['reach'] and got['tau'] == pytest.approx([3.0])
    got = answer('torque', urdf, '--joints', 'reach,lift', '--q', '0.1', '0.3')
    np.testing.assert_allclose(got['tau'][::-1], expected([0.3, 0.1], [0, 0], [0, 0]))


@pytest.mark.parametrize('given', ['everything', 'positions'])
def test_torque_of_a_trajectory_is_that_of_each_row(urdf, tmp_path, given, capsys):
    t = np.linspace(0.0, 2.0, 401)
    q = 0.3 * np.stack([np.cos(2 * t), np.cos(3 * t)], axis=1)
    u = 0.3 * np.stack([-2 * np.sin(2 * t), -3 * np.sin(3 * t)], axis=1)
    udot = 0.3 * np.stack([-4 * np.cos(2 * t), -9 * np.cos(3 * t)], axis=1)
    columns = {'t': t, 'q__lift': q[:, 0], 'q__reach': q[:, 1]}
    if given == 'everything':
        columns |= {'u__lift': u[:, 0], 'u__reach': u[:, 1],
                    'udot__reach': udot[:, 1], 'udot__lift': udot[:, 0]}
    path = write(tmp_path / 'motion.csv', **columns)
    assert main(['torque', urdf, '--motion', path, '--out',
                 str(tmp_path / 'o.csv')]) == 0
    got = rows(tmp_path / 'o.csv')
    tau = np.stack([got['tau.lift'], got['tau.reach']], axis=1)
    # Splines rest at the ends.
    inner = slice(None) if given == 'everything' else slice(20, -20)
    np.testing.assert_allclose(tau[inner], expected(q, u, udot)[inner], rtol=0,
                               atol=1e-12 if given == 'everything' else 1e-3)
    capsys.readouterr()
    assert main(['torque', urdf, '--motion', path]) == 0
    assert capsys.readouterr().out == (tmp_path / 'o.csv').read_text()


def test_torque_reads_a_joint_trajectory_in_yaml(urdf, tmp_path, answer):
    path = tmp_path / 'motion.yaml'
    path.write_text("""
joint_names: [reach, other, lift]
points:
- {time_from_start: 0.0, positions: [0.1, 9, 0.2], velocities: [0.3, 9, 0.4],
   accelerations: [0.5, 9, 0.6]}
- {time_from_start: {sec: 1, nanosec: 500000000}, positions: [0.2, 9, 0.3],
   velocities: [1.0, 9, 1.1], accelerations: [1.2, 9, 1.3]}
""")
    got = answer('torque', urdf, '--motion', str(path))
    assert (got['t'][0], got['t'][-1]) == (0.0, 1.5)
    np.testing.assert_allclose([got['tau'][0], got['tau'][-1]], expected(
        [[0.2, 0.1], [0.3, 0.2]], [[0.4, 0.3], [1.1, 1.0]], [[0.6, 0.5], [1.3, 1.2]]),
                               rtol=1e-9)


def test_simulate_saves_draws_and_sums_up_as_a_process(urdf, tmp_path):
    done = process(
        'simulate', urdf, '--q0', '0.5', '0.1', '--duration', '0.5', '--no-friction',
        '--out', str(tmp_path / 'fall.npz'), '--plot', str(tmp_path / 'fall.png'))
    assert done.returncode == 0 and done.stderr == ''
    trajectory = Trajectory.load_npz(tmp_path / 'fall.npz')
    total = trajectory.energy.sum(axis=1)
    assert trajectory.t[-1] == pytest.approx(0.5) and np.ptp(total) < 1e-9
    assert (tmp_path / 'fall.png').read_bytes().startswith(b'\x89PNG')
    assert 'energy' in done.stdout and f'{trajectory.q[-1, 0]:.6g}' in done.stdout
    assert any("joint 'reach' passes" in line for line in done.stdout.splitlines())


def test_simulate_holds_a_constant_torque_or_the_rows_of_a_file(urdf, tmp_path, answer):
    start = ['simulate', urdf, '--q0', '0.2', '0', '--duration', '0.2']
    one = answer(*start, '--torque', '-5', '1')
    path = write(tmp_path / 'tau.csv', t=[0.0, 0.1], tau__lift=[-5.0, -5.0],
                 tau__reach=[1.0, 1.0])
    assert answer(*start, '--torque', path)['q'] == one['q']
    path = write(tmp_path / 'tau.csv', t=[0.0, 0.1], tau__lift=[-5.0, 9.0],
                 tau__reach=[1.0, 1.0])
    other_result = answer(*start, '--torque', path, '--out', str(tmp_path / 'out.csv'))
    assert other_result['q'][0] > one['q'][0]
    got = rows(tmp_path / 'out.csv')
    np.testing.assert_array_equal(got['tau.lift'],
                                  np.where(got['t'] < 0.0999, -5.0, 9.0))


def test_simulate_follows_a_motion_from_its_first_point(urdf, tmp_path, answer):
    path = write(tmp_path / 'motion.csv', t=[0.0, 0.5, 1.0003], q__lift=[0.3, -0.4, 0.6],
                 q__reach=[0.0, 0.2, -0.2])
    got = answer('simulate', urdf, '--motion', path, '--kp', '400', '100', '--kd', '40')
    assert got['duration'] == pytest.approx(1.001)
    np.testing.assert_allclose(got['q'], [0.6, -0.2], atol=1e-5)
    off = answer('simulate', urdf, '--motion', path, '--q0', '0.2', '0', '--kp', '400',
                 '--kd', '40')
    np.testing.assert_allclose(off['q'], [0.6, -0.2], atol=1e-3)


def test_plot_of_chooses_the_picture(urdf, tmp_path, monkeypatch):
    import kane_dynamics.plot as plot
    drawn = []
    for name in ('tracking', 'energy', 'torque_by_source', 'phase'):
        monkeypatch.setattr(plot, f'plot_{name}',
                            lambda *given, name=name, **_: drawn.append((name, given)))
    path = write(tmp_path / 'motion.csv', t=[0.0, 0.5], q__lift=[0.3, -0.4],
                 q__reach=[0.0, 0.2])
    assert main(['torque', urdf, '--motion', path, '--plot', 'a.png']) == 0
    name, (_, trajectory, file) = drawn.pop()
    assert (name, file) == ('torque_by_source', 'a.png')
    np.testing.assert_allclose(trajectory.tau, expected(trajectory.q, trajectory.u,
                                                        trajectory.udot), rtol=1e-12)
    run = ['simulate', urdf, '--motion', path, '--kp', '900', '--kd', '60', '--plot',
           'b.svg']
    for what in ('energy', 'phase', 'tracking'):
        assert main([*run, '--plot-of', what]) == 0
        assert drawn[-1][0] == what and 'b.svg' in drawn[-1][1]
    (t, desired, actual), = drawn[-1][1][0].values()
    np.testing.assert_allclose(desired, actual, atol=1e-3)
    assert desired[-1] == pytest.approx([-0.4, 0.2]) and t[-1] == pytest.approx(0.5)


def test_torques_written_by_torque_drive_simulate_along_the_same_motion(
        urdf, tmp_path, answer):
    t = np.linspace(0.0, 1.0, 1001)
    path = write(tmp_path / 'm.csv', t=t, q__lift=0.3 * np.cos(2 * t),
                 q__reach=0.1 * np.sin(t),
                 u__lift=-0.6 * np.sin(2 * t), u__reach=0.1 * np.cos(t),
                 udot__lift=-1.2 * np.cos(2 * t), udot__reach=-0.1 * np.sin(t))
    main(['torque', urdf, '--motion', path, '--out', str(tmp_path / 'tau.csv')])
    end = process('simulate', urdf, '--torque', str(tmp_path / 'tau.csv'), '--q0', '0.3',
                  '0', '--u0', '0', '0.1', '--json')
    np.testing.assert_allclose(json.loads(end.stdout)['q'],
                               [0.3 * np.cos(2.0), 0.1 * np.sin(1.0)], atol=2e-2)


def test_inspect_tells_tree_masses_limits_and_operations(urdf, answer):
    done = process('inspect', urdf)
    assert done.returncode == 0
    for words in ('2 degrees of freedom', '3 kg', 'lift', '-3 to 3', 'reach',
                  'prismatic',
                  'range [rad, m]', 'speed [rad/s, m/s]', 'effort [N m, N]'):
        assert words in done.stdout
    assert 'multiplications' not in done.stdout
    table = process('inspect', urdf, '--operations').stdout
    assert 'inverse_dynamics' in table and 'multiplications' in table
    facts = answer('inspect', urdf)
    assert [body['mass'] for body in facts['bodies']] == [2.0, 1.0]
    assert facts['bodies'][1]['limits']['effort'] == 80.0
    assert facts['operations']['inverse_dynamics']['multiplications'] > 0


def test_inspect_reports_warnings_and_unlimited_joints_are_null_in_json(
        tmp_path, answer):
    path = tmp_path / 'arm.urdf'
    path.write_text(ARM.replace('effort="60"', 'effort="0"'))
    facts = answer('inspect', str(path))
    assert any('lift' in warning for warning in facts['warnings'])
    assert facts['bodies'][0]['limits']['effort'] is None


def test_an_impossible_inertia_is_refused_unless_no_strict_makes_it_a_warning(
        tmp_path, capsys):
    path = tmp_path / 'arm.urdf'
    path.write_text(ARM.replace('ixx="0.05"', 'ixx="-0.05"'))
    assert main(['torque', str(path)]) == 2
    assert 'fore' in capsys.readouterr().err
    assert main(['torque', str(path), '--no-strict']) == 0
    error = capsys.readouterr().err
    assert error.startswith('kane-dynamics: warning: ') and 'fore' in error


MIMIC = ARM.replace('</robot>', """
  <link name="finger"><inertial><mass value="0.5"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="finger" type="continuous"><parent link="fore"/><child link="finger"/>
    <axis xyz="0 0 1"/><origin xyz="0.1 0.2 0"/><mimic joint="reach" multiplier="2" offset="0.3"/>
  </joint></robot>""")  # noqa: E501


@pytest.mark.parametrize('text', [ARM, MIMIC], ids=['plain', 'mimic'])
@pytest.mark.parametrize('part',
                         [[], ['--joints', 'reach'], ['--gravity', '1', '2', '3']])
def test_inspect_agrees_with_pinocchio(tmp_path, text, part, answer):
    pytest.importorskip('pinocchio')
    (tmp_path / 'arm.urdf').write_text(text)
    against = answer('inspect', str(tmp_path / 'arm.urdf'), '--against', 'pinocchio',
                     *part)['against']
    assert against['agrees'] and against['states'] >= 20


def test_inspect_exits_1_when_the_peer_differs(urdf, monkeypatch, capsys):
    pin = pytest.importorskip('pinocchio')
    rnea = pin.rnea
    monkeypatch.setattr(pin, 'rnea', lambda *given: rnea(*given) * (1.0 + 1e-9))
    assert main(['inspect', urdf, '--against', 'pinocchio']) == 1
    assert 'DIFFERS' in capsys.readouterr().out


def test_names_that_look_like_numbers_are_names(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / '2025_11').write_text(
        ARM.replace('"fore"', '"-2"').replace('"base"', '"1"'))
    (tmp_path / '20251102').write_text('t,lift,reach\n0,0,-1e-3\n1,0,0\n')
    for out in ('5', '-6'):
        assert main(['torque', '2025_11', '--base', '1', '--tip', '-2', '--motion',
                     '20251102', '--out', out]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        '-6', '20251102', '2025_11', '5']
    assert rows(tmp_path / '5')['q.reach'].tolist() == [-1e-3, 0.0]
    assert main(['export', '2025_11', '--wrench-frames', '-2', '--payload-frame', '1',
                 '--kernel', 'gravity_force', '-o', 'arm.c']) == 0


@pytest.mark.parametrize('arguments',
                         [['--help'], ['torque', '--help'], ['simulate', '-h']])
def test_help_exits_0(arguments, capsys):
    with pytest.raises(SystemExit) as left:
        main(arguments)
    assert left.value.code == 0 and 'usage: kane-dynamics' in capsys.readouterr().out


@pytest.mark.parametrize(('module', 'arguments', 'words'), [
    ('matplotlib', ['simulate', '--plot', 'x.png'],
     ["'matplotlib'", 'kane_dynamics[plot]']),
    ('viser', ['view'], ["'viser'", 'kane_dynamics[view]']),
    ('pinocchio', ['inspect', '--against', 'pinocchio'],
     ['Pinocchio', 'pip install pin']),
])
def test_a_missing_extra_is_named_with_what_to_install(urdf, module, arguments, words,
                                                       monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, module, None)
    for name in [name for name in sys.modules
                 if name.startswith(('kane_dynamics.plot', 'kane_dynamics.view'))]:
        monkeypatch.delitem(sys.modules, name)
    assert main([arguments[0], urdf, *arguments[1:]]) == 2
    error = capsys.readouterr().err
    for word in words:
        assert word in error


def test_a_malformed_urdf_leaves_no_traceback(tmp_path):
    (tmp_path / 'bad.urdf').write_text('<robot><link name="a">')
    done = process('inspect', str(tmp_path / 'bad.urdf'))
    assert done.returncode == 2
    assert done.stderr.startswith('kane-dynamics: error: ')
    assert 'Traceback' not in done.stderr


@pytest.mark.parametrize('words',
                         [['--help'], ['torque', '--help'], ['torque', 'missing.urdf']])
def test_a_command_imports_no_other_commands_libraries(words):
    program = """
import sys
from kane_dynamics.cli import main
try:
    main(sys.argv[1:])
except SystemExit:
    pass
print(*(name for name in sys.modules if name in {
    'scipy', 'yaml', 'yourdfpy', 'pyarrow', 'kane_dynamics.identification',
    'kane_dynamics.sweep'}))
"""
    done = subprocess.run([sys.executable, '-c', program, *words],
                          check=True, timeout=60, capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == ''
