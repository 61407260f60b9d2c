"""Every option of every command changes the result, or is refused."""

from functools import cache
import os
from pathlib import Path
import re
import shutil

from command_in_process import command
from kane_dynamics import load_urdf, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.cli.parser import COMMANDS, parsers
import numpy as np
import pytest
from recordings import simulated
from urdf_writer import chain

TWO_LINK = resource_path('urdf', 'two_link.urdf')
EXCITE = 'excite arm.urdf -o e.csv --starts 1 --harmonics 2 --duration 4 --floor none'
FEASIBLE = 'feasible arm.urdf --motion m.csv'
OPTIMAL = f'{FEASIBLE} --time-optimal --json'
IDENTIFY = 'identify arm.urdf r.csv'
CURRENT = '--efforts motor_current --torque-constants'
SLOW = 'excite arm.urdf -o e.csv --friction --loads 1 --floor none'
MOTION = ','.join(['t', *(f'{x}.joint{k}' for x in ('q', 'u', 'udot') for k in (1, 2))])
ONE = """joint_names: [joint1]
points:
- {time_from_start: 0.0, positions: [0.0]}
- {time_from_start: 1.0, positions: [1.0]}
"""
CALIBRATE = 'calibrate arm.urdf r.csv --collision'
POSES = 'calibrate arm.urdf poses.csv'
# A call of each command, which needs no robot and no node.
CALLS = {
    'torque': 'torque arm.urdf --motion m.csv',
    'simulate': 'simulate arm.urdf --duration 0.02',
    'sweep': 'sweep sweep.yaml -o s', 'inspect': 'inspect arm.urdf --json',
    'export': 'export arm.urdf -o c.c --kernel gravity_force inverse_dynamics',
    'equations': 'equations arm.urdf', 'identify': IDENTIFY, 'excite': EXCITE,
    'replay': 'replay arm.urdf r.csv', 'feasible': FEASIBLE,
    'fill': 'fill arm.urdf --motion m.csv', 'doctor': 'doctor arm.urdf',
    'view': 'view arm.urdf --motion m.csv --export v.html',
    'calibrate': CALIBRATE,
}
# Options that several commands have, with a value; the arm on which they have an effect.
SHARED = {
    '--xacro a:=1': 'arm', '--joints joint1': 'arm', '--base link1': 'arm',
    '--tip link1': 'arm', '--root-joint planar': 'arm', '--gravity 0 0 -99': 'arm',
    '--supplement s.yaml': 'arm', '--no-friction': 'rubbing', '--no-strict': 'bad',
    '--constraints c.yaml': 'arm', '--json': 'arm', '--verbose': 'gazebo',
    '--topic /states': 'arm', '--plot p.png': 'arm', '--cutoff 5': 'arm',
    '--derive-speeds': 'arm', '--resample 50': 'arm',
    '--efforts joint_torque': 'rubbing',
    '--efforts-without-gravity': 'arm', '--out o.csv': 'arm'}
# Options of one command: a call, and what is added to it.
OWN = [
    ('inspect long.urdf', '--verbose'), ('doctor long.urdf', '--verbose'),
    ('sweep gazebo.yaml -o s', '--verbose'), ('inspect arm.urdf', '--frames'),
    ('inspect arm.urdf', '--operations'),
    ('inspect arm.urdf', '--against pinocchio'), ('inspect arm.urdf', '--json'),
    ('torque arm.urdf', '--q 0 1'), ('torque arm.urdf --q 0 1', '--u 0 1'),
    ('torque arm.urdf', '--udot 0 1'), ('torque arm.urdf', '--motion m.csv'),
    (CALLS['torque'], '--step 0.1'),
    (f'{CALLS["torque"]} --plot p.png', '--plot-of energy'),
    (CALLS['simulate'], '--q0 0 1'), (CALLS['simulate'], '--u0 0 1'),
    (CALLS['simulate'], '--step 0.01'), (CALLS['simulate'], '--integrator implicit'),
    ('simulate arm.urdf', '--duration 0.5'), ('simulate rubbing.urdf', '--sticking'),
    ('simulate arm.urdf --u0 6 0', '--stops'), (CALLS['simulate'], '--torque 1 1'),
    (CALLS['simulate'], '--motion m.csv'), (CALLS['simulate'], '--contacts p.yaml'),
    (f'{CALLS["simulate"]} --motion m.csv --q0 0 1', '--kp 1'),
    (f'{CALLS["simulate"]} --motion m.csv --u0 0 1', '--kd 1'),
    (f'{CALLS["simulate"]} --plot p.png', '--plot-of energy'),
    (CALLS['sweep'], '--workers 0'),
    (CALLS['sweep'], '--plot p.png'), ('sweep sweep.yaml', '--out s'),
    ('export arm.urdf -o c.c', '--kernel mass_matrix'), (CALLS['export'], '--float32'),
    (CALLS['export'], '--no-self-test'), (CALLS['export'], '--wrench-frames link2'),
    (CALLS['export'], '--payload-frame link2'), ('export arm.urdf', '--out c.c'),
    (CALLS['equations'], '--numbers'), (CALLS['equations'], '--latex'),
    (CALLS['equations'], '--markdown'),
    (CALLS['equations'], '--out e.txt'), (CALLS['equations'], '--axes world'),
    (CALLS['equations'], '--points tip'), (CALLS['equations'], '--auxiliary joint1:x'),
    (CALLS['equations'], '--energy'), (CALLS['equations'], '--c'),
    (CALLS['equations'], '--python'),
    (IDENTIFY, f'{CURRENT} 2'), (f'{IDENTIFY} {CURRENT} 2 2', '--torque-constants 1'),
    (f'replay arm.urdf r.csv {CURRENT} 2 2', '--torque-constants 1'),
    ('identify arm.urdf reversed.csv', '--as-recorded'), (IDENTIFY, '--friction-only'),
    (IDENTIFY, '--friction viscous'), (f'{IDENTIFY} --friction-only', '--unbounded'),
    (IDENTIFY, '--standstill 0.5'), (IDENTIFY, '--weight 1'),
    (IDENTIFY, '--test r.csv'), (IDENTIFY, '--coupled joint1 joint2'),
    (IDENTIFY, '--without-effort joint2'), (IDENTIFY, '--base-parameters'),
    (IDENTIFY, '--payload tip'), (IDENTIFY, '--drives'),
    (IDENTIFY, '--out better.urdf'), (IDENTIFY, '--report r.md'),
    ('replay arm.urdf r.csv', '--reference r.csv'),
    ('calibrate arm.urdf r.csv', '--collision'), (CALIBRATE, '--gain 20'),
    (POSES, '--loaded loaded.csv --load link2'), (POSES, '--out g.yaml'),
    (f'{POSES} --loaded loaded.csv', '--load link2 --load-mass 0.5'),
    (f'{POSES} --loaded loaded.csv --load link2', '--load-mass 0.5'),
    (f'{POSES} --loaded loaded.csv --load link2 --load-mass 0.5', '--load-com 0 1 1'),
    (CALIBRATE, '--margin 2'),
    ('calibrate rubbing.urdf rubbing.csv --collision', '--drift 0.3'),
    (CALIBRATE, '--commands'),
    (CALIBRATE, '--out t.yaml'),
    (f'{CALIBRATE} {CURRENT} 2 2', '--torque-constants 1'),
    (EXCITE, '--duration 5'), (EXCITE, '--periods 2'), (EXCITE, '--harmonics 3'),
    (EXCITE, '--share 0.5'), (EXCITE, '--seed 1'), (EXCITE, '--starts 2'),
    (EXCITE, '--rate 50'), (EXCITE, '--velocity 1'), (EXCITE, '--acceleration 1'),
    (EXCITE, '--floor -0.5'),
    (EXCITE, '--friction'),
    (SLOW, '--loads 2'), (SLOW, '--share 0.5'), (SLOW, '--seed 1'),
    (SLOW, '--rate 50'),
    (FEASIBLE, '--speed 2'), (FEASIBLE, '--power 1'),
    (FEASIBLE, '--time-optimal'), (OPTIMAL, '--acceleration 1'), (OPTIMAL, '--jerk 9'),
    (OPTIMAL, '--torque-rate 9'), (OPTIMAL, '--power 1'),
    (FEASIBLE, '--payload-frame tip'),
    (OPTIMAL, '--step 0.5'),
    (f'{FEASIBLE} --payload-frame tip', '--payload-com 0 0 9'), (FEASIBLE, '--step 0.5'),
    ('feasible arm.urdf', '--motion m.csv'),
    (CALLS['fill'], '--tolerance 0.1'),
    ('fill arm.urdf --motion one.yaml', '--rest 0 1'),
    (CALLS['fill'], '--without gravity'), (CALLS['fill'], '--out f.csv'),
    ('fill rubbing.urdf --motion m.csv --json', '--feedforward-friction ahead'),
    ('fill arm.urdf --motion fast.csv', '--clip'), ('fill arm.urdf', '--motion m.csv'),
    (CALLS['doctor'], '--config none.yaml'),
    ('view arm.urdf --export v.html', '--motion m.csv'),
    ('view arm.urdf --host nowhere --no-open', '--export v.html'),
]
# What acts in a running ROS graph, in a browser, on recordings of drives, or on arms
# with many links: the tests of these options use them.
ELSEWHERE = {
    'calibrate': {'--floor', '--live', '--move', '--save'},
    'identify': {'--ratio', '--skew'}, 'replay': {'--smallest'},
    'excite': {'--distance'},
    'doctor': {'--live', '--namespace', '--prefix', '--commands', '--joint-states',
               '--efforts', '--efforts-without-gravity', '--torque-constants'},
    'view': {'--host', '--port', '--no-open'}}
IN_GRAPH = ('send',)


@cache
def result(arguments):
    """Return what a command prints, without its times, and the files that it writes."""
    before = {path: path.read_bytes() for path in Path().rglob('*') if path.is_file()}
    done = command(*arguments.split())
    out = re.sub(r'(took |simulations in |"wall_time": )[\d.e-]+', '', done.stdout)
    said = [line for line in done.stderr.splitlines() if 'compil' not in line]
    files = {}
    for path in Path().rglob('*'):
        if path.is_file() and path.read_bytes() != before.get(path):
            files[str(path)] = path.read_bytes()
            path.unlink()
    shutil.rmtree('s', ignore_errors=True)
    return done.returncode, out, said, files


@pytest.fixture(scope='module', autouse=True)
def folder(tmp_path_factory):
    """Change to a folder with arms, motions, recordings and other files."""
    former = Path.cwd()
    os.chdir(tmp_path_factory.mktemp('options'))
    urdf = TWO_LINK.read_text()
    spring = '<gazebo reference="joint1"><springStiffness>1</springStiffness></gazebo>'
    files = {
        'arm.urdf': urdf,
        'rubbing.urdf': urdf.replace('<axis',
                                     '<dynamics damping="1" friction="2"/><axis'),
        'bad.urdf': urdf.replace('ixx="0.00135"', 'ixx="-0.00135"'),
        'gazebo.urdf': urdf.replace('</robot>', f'{spring}</robot>'),
        's.yaml': 'joints: {joint1: {armature: 0.1, stiffness: 5, rest: 1}}\n',
        'c.yaml': 'constraints: {one: {coupling: {joint1: 1, joint2: 1}}}\n',
        'p.yaml': 'contacts: {tool: {frame: tip, plane: {point: [0, 0, -0.001]}}}\n',
        'one.yaml': ONE,
        'gazebo.yaml': 'urdf: gazebo.urdf\nsamples: 1\nstep: 0.01\nduration: 0.1\n',
        'long.urdf': chain(40, limit=''),
        'm.csv': f'{MOTION}\n0,0,0,0,0,1,1\n1,0.3,-0.2,0.1,0.1,0,0\n2,0,0,0,0,0,0\n',
        'fast.csv': f'{MOTION}\n0,0,0,0,0,80,0\n1,0.3,-0.2,0,0,0,0\n',
        'sweep.yaml': 'urdf: arm.urdf\nsamples: 2\nstep: 0.01\nduration: 0.1\n'}
    for name, text in files.items():
        Path(name).write_text(text)
    for name, urdf, sign in (('r', 'arm.urdf', 1.0), ('reversed', 'arm.urdf', -1.0),
                             ('rubbing', 'rubbing.urdf', 1.0)):
        model = load_urdf(urdf)
        recording = simulated(model, 1, 0.01)
        names = [f'{x}.joint{k}' for x in ('q', 'u', 'tau') for k in (1, 2)]
        table = np.column_stack([recording.t, recording.q, recording.u,
                                 sign * recording.tau])
        np.savetxt(f'{name}.csv', table, delimiter=',', header=','.join(['t', *names]),
                   comments='')
    robot = Robot(load_urdf('arm.urdf'), friction=False)
    for name, factor in (('poses', 1.0), ('loaded', 1.3)):
        q = np.random.default_rng(0).uniform(-1.5, 1.5, (12, 2))
        np.savetxt(f'{name}.csv', np.hstack([q, factor * robot.gravity_force(q)]),
                   delimiter=',', header='q1,q2,tau1,tau2', comments='')
    yield
    os.chdir(former)


def cases():
    """Return calls, and what is added to each."""
    calls = list(OWN)
    tried = {(call.split()[0], option) for call, option in OWN}
    for name, call in CALLS.items():
        for option, arm in SHARED.items():
            if option.split()[0] in options_of(name) and (name, option) not in tried:
                calls.append((call.replace('arm.urdf', f'{arm}.urdf'), option))
    return calls


def options_of(name):
    """Return the long options of a command."""
    _, parser = parsers(name)
    return {option for option in parser._option_string_actions if option[:2] == '--'}


@pytest.mark.parametrize(('call', 'option'), cases())
def test_an_option_changes_the_result_or_is_refused(call, option):
    assert result(f'{call} {option}') != result(call)


@pytest.mark.parametrize('name', sorted({*COMMANDS} - {*IN_GRAPH}))
def test_every_option_is_tried(name):
    tried = set(ELSEWHERE.get(name, ())) | {'--help'}
    for call, option in cases():
        if call.split()[0] == name:
            tried |= {word for word in f'{call} {option}'.split() if word[:2] == '--'}
    assert not options_of(name) - tried
