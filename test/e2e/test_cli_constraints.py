"""Promises of --constraints: commands compute the closed loops of a file."""

import csv
import json
import re

from command_in_process import command
from kane_dynamics import box, load_constraints, load_urdf, Robot
from kane_dynamics.cli.tables import read_motion
from kane_dynamics.feasibility import time_optimal
from kane_dynamics.loop_tracking.driven_mechanism import mechanism_motion
from kane_dynamics.mechanics.definition import nonholonomic
from kane_dynamics.model.model import with_payload
from kane_dynamics.simulation.trajectory import Trajectory
import numpy as np
from palletizer import DRIVEN, LOOPS, palletizer, positions, URDF
import pytest
from urdf_writer import chain
import yaml

ARM = [str(URDF), '--constraints', str(LOOPS)]
AT = [0.2, 0.3, 0.1, -0.4]
RATES = [0.5, -0.3, 0.2, 1.0]
ACCELERATIONS = [1.0, 2.0, -1.0, 0.3]
WEAK = (
    """<robot name="skate"><link name="base"/><link name="skate"><inertial><mass value="2"/>
  <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="on" type="planar"><parent link="base"/><child link="skate"/>
<axis xyz="0 0 1"/></joint></robot>""")  # noqa: E501


def words(name, values):
    """Return an option and its values."""
    return [f'--{name}', *(repr(float(x)) for x in values)]


def answer(*arguments):
    """Return the JSON of a command that succeeds."""
    done = command(*arguments, '--json')
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def expected(q, u, udot):
    """Return the motors' torques by Kane's definition, in the order of the joints."""
    robot = palletizer()
    tau = np.zeros(robot.n_q)
    tau[[robot.joint_names.index(name)
         for name in DRIVEN]] = nonholonomic.inverse_dynamics(
             robot.mechanism, q, np.array(u), np.array(udot))
    return tau


def test_a_loop_that_is_open_at_zero_says_where_it_starts(tmp_path):
    urdf = tmp_path / 'arm.urdf'
    urdf.write_text(chain(2))
    loops = tmp_path / 'loops.yaml'
    files = str(urdf), '--constraints', str(loops)
    gear = {'joint': 'j2', 'ratios': {'j1': 2.0}, 'offset': 0.7}
    content = {'constraints': {'gear': {'coupling': gear}}}
    loops.write_text(yaml.safe_dump(content))
    done = command('torque', *files)
    assert done.returncode == 0
    said, _, values = done.stderr.partition(' elsewhere: ')
    assert said == ('kane-dynamics: --q: 0 is no closed configuration within the '
                    'limits; these joints start')
    start = dict(re.findall(r'(\w+) (\S+?),?\s', values))
    assert float(start['j2']) - 2.0 * float(start['j1']) == pytest.approx(0.7, abs=1e-3)
    gear['offset'] = 0.0
    loops.write_text(yaml.safe_dump(content))
    assert not command('torque', *files).stderr


@pytest.fixture
def motion(tmp_path):
    """Return the path of a motion of the motors, with rows at rest and in motion."""
    path = tmp_path / 'motion.csv'
    with open(path, 'w', newline='') as file:
        writer = csv.writer(file)
        writer.writerow(['t', *(f'{what}.{name}' for what in ('q', 'u', 'udot')
                                for name in DRIVEN)])
        writer.writerow([0.0, *AT, *RATES, *ACCELERATIONS])
        writer.writerow([0.1, *np.add(AT, 0.02), *RATES, *ACCELERATIONS])
    return str(path)


@pytest.mark.parametrize('every', [False, True])
def test_torque_closes_the_loops_of_the_given_state_and_is_of_the_motors(every):
    q = positions(palletizer(), *AT)
    result = answer('torque', *ARM, *words('q', q if every else AT), *words('u', RATES),
                    *words('udot', ACCELERATIONS))
    tau = expected(q, RATES, ACCELERATIONS)
    np.testing.assert_allclose(result['q'], q, atol=1e-9)
    np.testing.assert_allclose(result['tau'], tau, atol=1e-9 * np.abs(tau).max())
    np.testing.assert_allclose(np.sum(list(result['terms'].values()), axis=0),
                               result['tau'], atol=1e-9 * np.abs(tau).max())
    table = command('torque', *ARM).stdout.splitlines()
    assert sorted(line.split()[0] for line in table[1:]) == sorted(DRIVEN)


def test_torques_along_a_motion_of_the_motors_are_those_of_the_definition(
        motion, tmp_path):
    result = answer('torque', *ARM, '--motion', motion, '--plot',
                    str(tmp_path / 'p.svg'))
    for k, at in enumerate((AT, np.add(AT, 0.02))):
        q = positions(palletizer(), *at)
        tau = expected(q, RATES, ACCELERATIONS)
        np.testing.assert_allclose(result['q'][k], q, atol=1e-9)
        np.testing.assert_allclose(result['tau'][k], tau, atol=1e-9 * np.abs(tau).max())


def test_simulate_keeps_the_loops_closed_and_follows_a_motion(motion, tmp_path):
    file = tmp_path / 'run.npz'
    result = answer('simulate', *ARM, '--motion', motion, '--out', str(file), '--plot',
                    str(tmp_path / 'p.svg'), '--plot-of', 'tracking')
    run = Trajectory.load_npz(file)
    assert result['speed_names'] == list(DRIVEN) and result['drift'] < 1e-9
    np.testing.assert_allclose(run.q[0], positions(palletizer(), *AT), atol=1e-9)
    driven = [run.joint_names.index(name) for name in DRIVEN]
    np.testing.assert_allclose(run.q[-1], positions(palletizer(), *run.q[-1][driven]),
                               atol=1e-9)


def test_inspect_states_degrees_of_freedom_motors_and_residual():
    result = answer('inspect', *ARM)['constraints']
    assert result['degrees_of_freedom'] == 4 and result['redundant'] == []
    assert result['independent'] == list(DRIVEN)
    assert sorted(result['actuated']) == sorted(DRIVEN)
    assert len(result['rows']) == 6 and result['residual'] < 1e-9
    of_tree = answer('inspect', str(URDF))['constraints']
    assert of_tree['rows'] == of_tree['redundant'] == [] and of_tree['residual'] is None
    assert of_tree['degrees_of_freedom'] == len(of_tree['independent'])
    assert 'constraints' not in command('inspect', str(URDF)).stdout
    text = command('inspect', *ARM).stdout
    assert text.startswith('palletizer: 4 degrees of freedom') and 'level_1/side' in text


def test_doctor_examines_the_motors_under_the_loops(tmp_path):
    weak = tmp_path / 'weak.urdf'
    text = URDF.read_text()
    assert 'effort="8000"' in text
    weak.write_text(text.replace('effort="8000"', 'effort="200"'))
    good = command('doctor', *ARM)
    assert good.returncode == 0
    assert 'cannot judge: whether the motors hold the arm: effort limits' in good.stdout
    bad = command('doctor', str(weak), '--constraints', str(LOOPS))
    assert bad.returncode == 1 and 'actuators cannot hold the arm' in bad.stdout
    config = tmp_path / 'arm.yaml'
    config.write_text('/**:\n  ros__parameters:\n'
                      f'    constraints: {LOOPS}\n    joint_names: []\n')
    assert 'random closed configurations' in command(
        'doctor', str(weak), '--config', str(config)).stdout


def test_feasible_has_the_torques_of_the_motors_only(motion):
    record = json.loads(command('feasible', *ARM, '--motion', motion, '--json').stdout)
    peaks = dict(zip(record['joint_names'], record['torque']['peak']))
    assert {name for name, peak in peaks.items() if peak > 0.0} == set(DRIVEN)
    assert (record['fastest'] is None
            or record['fastest']['joint'] in palletizer().joint_names)


def test_fastest_timing_has_all_joints_and_is_that_of_the_library(motion, tmp_path):
    out = tmp_path / 'fastest.csv'
    result = answer('feasible', *ARM, '--motion', motion, '--time-optimal', '--out',
                    str(out))
    expected_timing = time_optimal(palletizer(), read_motion(motion, DRIVEN))
    assert result['joint_names'] == list(palletizer().joint_names)
    assert result['duration'] == pytest.approx(expected_timing.duration, rel=1e-9)
    again = read_motion(out, DRIVEN)
    assert again.duration == pytest.approx(result['duration'], rel=1e-9)
    at = again.times[::101][:-1]
    for one, reference in zip(again.sample(at), expected_timing.motion.sample(at)):
        np.testing.assert_allclose(one, reference, rtol=1e-6, atol=1e-4)
    done = command('feasible', *ARM, '--motion', motion, '--time-optimal', '--jerk', '9')
    assert done.returncode != 0 and 'with a limit of jerk or torque rate' in done.stderr


def test_filled_efforts_are_those_of_the_motors(motion):
    (result,) = answer('fill', *ARM, '--motion', motion)
    assert result['joint_names'] == list(DRIVEN)
    tau = expected(positions(palletizer(), *AT), RATES, ACCELERATIONS)
    places = [palletizer().joint_names.index(name) for name in DRIVEN]
    np.testing.assert_allclose(result['efforts'][0], tau[places],
                               atol=1e-9 * np.abs(tau).max())


def test_exported_c_is_that_of_the_closed_loops(tmp_path):
    answer('export', *ARM, '-o', str(tmp_path / 'arm.c'), '--kernel', 'inverse_dynamics')
    robot = Robot(load_urdf(URDF), **load_constraints(LOOPS))
    (tmp_path / 'again').mkdir()
    source, _ = robot.export_c(tmp_path / 'again' / 'arm.c', ['inverse_dynamics'])
    assert source.read_text() == (tmp_path / 'arm.c').read_text()


def test_positions_of_few_joints_do_not_state_those_of_a_knife_edge(tmp_path):
    urdf = tmp_path / 'skate.urdf'
    file = tmp_path / 'skate.yaml'
    urdf.write_text(WEAK)
    file.write_text(
        'constraints: {blade: {knife_edge: {frame: skate, direction: [0, 1, 0]}}}\n')
    arguments = [str(urdf), '--constraints', str(file)]
    done = command('torque', *arguments, '--q', '0', '1')
    assert done.returncode == 2
    assert '--q: 2 numbers; expected 3, in the order' in done.stderr
    assert answer('torque', *arguments, '--q', '0', '0', '0.3')['tau'] == [0.0, 0.0, 0.0]


@pytest.mark.parametrize('kind', ['.npz', '.csv'])
def test_identify_finds_the_load_of_a_closed_loop_from_its_motors(kind, tmp_path):
    load = box(20.0, (0.3, 0.2, 0.4), at=(0.05, 0.02, 0.25))
    robot = Robot(load_urdf(URDF), **load_constraints(LOOPS))
    heavy = Robot(with_payload(robot.model, 'tool', load), **load_constraints(LOOPS))
    t = np.arange(0.0, 6.0, 0.03)
    w = np.array([0.7, 1.1, 1.3, 3.7])
    a = np.array([0.5, 0.3, 0.3, 1.0])
    s = np.sin(np.outer(t, w))
    c = np.cos(np.outer(t, w))
    state = [a * s + [0.2, 0.1, -0.1, 0.5], a * w * c, -a * w**2 * s]
    tau = np.array(
        [nonholonomic.inverse_dynamics(heavy.mechanism, positions(robot, *q), u, udot)
         for q, u, udot in zip(*state, strict=True)])
    columns = dict(zip(('q', 'u', 'udot', 'tau'), (*state, tau), strict=True))
    path = tmp_path / f'run{kind}'
    out = tmp_path / 'load.yaml'
    if kind == '.npz':
        np.savez(path, t=t, **columns, joint_names=DRIVEN)
    else:
        header = ['t', *(f'{name}.{joint}' for name in columns for joint in DRIVEN)]
        np.savetxt(path, np.column_stack([t, *columns.values()]),
                   delimiter=',', comments='', header=','.join(header))
    data = answer('identify', *ARM, str(path), '--payload', 'tool', '--out', str(out))
    assert data['joint_names'] == list(robot.actuated_names)
    assert data['mass'] == pytest.approx(load.mass, abs=1e-4)
    np.testing.assert_allclose(data['com'][:2], load.com[:2], atol=1e-3)
    loaded = Robot(load_urdf(URDF, supplement=out), **load_constraints(LOOPS))
    for q, u, udot, torque in list(zip(*columns.values(), strict=True))[::40]:
        np.testing.assert_allclose(
            loaded.inverse_dynamics(positions(robot, *q), u, udot), torque,
            atol=1e-3 * np.abs(tau).max())
    done = command('identify', *ARM, str(path), '--payload', 'tool')
    assert done.returncode == 0
    mass = re.search(r'payload.mass: ([0-9.]+)', done.stdout).group(1)
    assert float(mass) == pytest.approx(load.mass, abs=1e-4)


def test_torques_of_actuators_elsewhere_are_refused(tmp_path):
    file = tmp_path / 'moved.yaml'
    file.write_text(
        LOOPS.read_text().replace('actuated: [swivel, shoulder, lever_drive, turn]',
                                  'actuated: [swivel, elbow, lever_drive, turn]'))
    done = command('simulate', str(URDF), '--constraints', str(file), '--torque',
                   *'1234')
    assert done.returncode == 2 and '--torque: given for actuators at' in done.stderr


def test_independent_positions_in_degrees_are_suspected_before_the_loops_are_closed():
    done = command('torque', *ARM, '--q', '20', '30', '10', '0')
    assert done.returncode == 2
    assert 'degrees' in done.stderr.splitlines()[0]


def test_rows_far_apart_stay_in_the_assembly_mode_of_the_file(tmp_path):
    path = tmp_path / 'far.csv'
    path.write_text(
        't,swivel,shoulder,lever_drive,turn\n0,0,0,0,0\n1,0.3,0.2,0.1,1\n2,0,0,0,0\n')
    q = np.array(answer('torque', *ARM, '--motion', str(path))['q'])
    assert np.abs(q[2] - q[0]).max() <= 1e-9  # not turned by 2 pi


def test_rows_without_times_are_those_of_rows_with_times(tmp_path):
    timed = tmp_path / 'timed.csv'
    lines = ['t']
    for what in ('q', 'u', 'udot'):
        for name in DRIVEN:
            lines[0] += f',{what}.{name}'
    for k in range(3):
        row = [k, *np.multiply(AT, 1.0 + 0.1 * k), *RATES, *ACCELERATIONS]
        lines.append(','.join(map(str, row)))
    timed.write_text('\n'.join(lines) + '\n')
    untimed = tmp_path / 'untimed.csv'
    without_times = [line.partition(',')[2] for line in lines]
    untimed.write_text('\n'.join(without_times) + '\n')
    of_times = answer('torque', *ARM, '--motion', str(timed))
    of_rows = answer('torque', *ARM, '--motion', str(untimed))
    assert of_rows['t'] is None and of_rows['tau'] == of_times['tau']
    # A row that the loops cannot reach is named by its number.
    broken = tmp_path / 'broken.csv'
    head, first, *_ = untimed.read_text().splitlines()
    far = ','.join(map(str, [0.0, 3.0, -3.0, 0.0, *RATES, *ACCELERATIONS]))
    broken.write_text(f'{head}\n{first}\n{far}\n')
    done = command('torque', *ARM, '--motion', str(broken))
    assert done.returncode == 2 and 'motion: row 1' in done.stderr


def test_an_empty_constraints_file_is_named(tmp_path):
    empty = tmp_path / 'loops.yaml'
    empty.touch()
    done = command('inspect', str(URDF), '--constraints', str(empty))
    assert done.returncode == 2
    assert f"constraints '{empty}': an empty file; expected" in done.stderr


def test_drives_of_loops_are_identified(tmp_path):
    # Motors of the palletizer lead its driven joints by the torques that its links need.
    frictionless = palletizer(friction=False, independent=DRIVEN, actuated=None)
    t = 2e-3 * np.arange(3000)
    frequency = np.array(
        [[1.1, 1.7, 1.3, 1.9], [4.3, 5.9, 5.1, 6.1], [11.0, 13.0, 12.0, 14.0]])
    size = np.array([[0.4], [0.05], [0.006]])
    phase = t[:, None, None] * frequency
    center = np.array([0.0, 0.4, 0.0, 0.0])  # of swivel, shoulder, lever and turn
    q = center + (size * np.sin(phase)).sum(axis=1)
    u = (size * frequency * np.cos(phase)).sum(axis=1)
    udot = -(size * frequency**2 * np.sin(phase)).sum(axis=1)
    motion = mechanism_motion(frictionless, DRIVEN, t, q, u, udot)
    torque = frictionless.inverse_dynamics(*motion)
    stiffness = np.array([4e5, 6e5, 5e5, 2e3])
    noise = np.random.default_rng(4).normal(size=(2, *q.shape))
    columns = {'theta': q + torque / stiffness + 2e-6 * noise[0],
               'q': q + 2e-6 * noise[1]}
    names = palletizer().actuated_names
    order = [DRIVEN.index(name) for name in names]
    recording = tmp_path / 'drives.npz'
    out = tmp_path / 'drives.yaml'
    np.savez(recording, t=t, **{key: value[:, order] for key, value in columns.items()})
    done = command('identify', str(URDF), str(recording), '--drives', '--constraints',
                   str(LOOPS), '--skew', '0', '--out', str(out), '--json')
    assert done.returncode == 0, done.stderr
    data = json.loads(done.stdout)
    assert data['joint_names'] == list(names)
    np.testing.assert_allclose(data['stiffness'], stiffness[order], rtol=0.02)
    # The result is a supplement of the same mechanism, whose rotors have no inertia yet.
    written = yaml.safe_load(out.read_text(encoding='utf-8'))['drives']
    assert list(written) == list(names)
    supplement = {'drives': {name: drive | {'rotor_inertia': 1.0}
                             for name, drive in written.items()}}
    assert [drive.name
            for drive in load_urdf(URDF, supplement=supplement).drives] == list(names)
