"""What the commands refuse: one table of arguments and of what the error says."""

import os
from pathlib import Path

from command_in_process import command
from kane_dynamics import load_urdf
from kane_dynamics._util.resources import resource_path
import numpy as np
import pytest
from recordings import simulated

TWO_LINK = str(resource_path('urdf', 'two_link.urdf'))
PALLETIZER = (f'{resource_path("urdf", "palletizer.urdf")} --constraints '
              f'{resource_path("urdf", "palletizer.constraints.yaml")}')
POINTS = """
joint_names: [joint1, joint2]
points:
- {time_from_start: 0.0, positions: [0.0, 0.0]}
- {time_from_start: 1.0, positions: [0.8, -0.5]}
"""
SWEEP = 'urdf: arm.urdf\nsamples: 2\nstep: 0.01\n'

REFUSED = [
    # Words that are no options, commands or numbers.
    ('torque arm.urdf --qdd 1 1', 'unrecognized arguments: --qdd 1 1'),
    ('feasible arm.urdf --motion m.yaml --accel 1', 'unrecognized arguments: --accel 1'),
    ('torque arm.urdf --payload 5', 'unrecognized arguments: --payload 5'),
    ('inspec arm.urdf', "invalid choice: 'inspec' (choose from"),
    ('--verson', 'arguments are required: COMMAND'),
    ('simulate arm.urdf --step 1ms', "argument --step: invalid float value: '1ms'"),
    ('simulate arm.urdf --integrator euler',
     "invalid choice: 'euler' (choose from 'rk4'"),
    ('identify arm.urdf r.csv --efforts amps', "invalid choice: 'amps' (choose from"),
    ('excite arm.urdf -o e.csv --floor -1m', "'-1m'; expected a number of m, or none"),
    ('equations arm.urdf --latex --json', '--latex: given with --json'),
    ('send arm.urdf', 'one of the arguments --motion --by is required'),
    # Numbers.
    ('torque arm.urdf --q 0 one', "--q: 'one'; expected 2 numbers, in the order joint1"),
    ('torque arm.urdf --u 0', '--u: 1 numbers; expected 2, in the order joint1, joint2'),
    (f'torque {PALLETIZER} --q 0 0 0',
     '--q: 3 numbers; expected 4, in the order swivel'),
    (f'torque {PALLETIZER} --q nan .3 .1 0', 'expected 10 finite numbers'),
    (f'torque {PALLETIZER} --q 1e9 .3 .1 0', 'expected moves of at most 1000 rad'),
    ('torque arm.urdf --q 1 nan', "(joint 'joint2'): nan; expected a finite number"),
    ('torque arm.urdf --joints elbow', "'elbow'"),
    ('simulate arm.urdf --torque 1', '--torque: 1 numbers; expected 2'),
    ('simulate arm.urdf --duration -1', 'duration: -1 s'),
    ('simulate arm.urdf --duration 0', 'duration: 0 s'),
    ('simulate arm.urdf --step 0', 'step: 0 s'),
    ('fill arm.urdf --motion m.yaml --feedforward-friction ahaed',
     "feedforward_friction: 'ahaed'; expected one of desired_speed"),
    ('doctor arm.urdf --live 0', '--live: 0.0; expected a positive, finite time in s'),
    ('identify arm.urdf r.csv --resample 1e6',
     'rate: 1e+06 Hz for rows at 100 Hz; expected at most 1000 Hz'),
    ('identify arm.urdf r.csv --efforts motor_current --torque-constants 0',
     "constants of joint 'joint1': 0; expected another number"),
    ('replay arm.urdf r.csv --efforts motor_current',
     'motor_current without constants; expected the torque constants'),
    # Options that would have no effect.
    ('torque arm.urdf --step 0.1', '--step: given without --motion; expected both'),
    ('torque arm.urdf --motion m.yaml --plot-of energy',
     '--plot-of: given without --plot'),
    ('torque arm.urdf --motion m.yaml --q 0 0',
     '--q: given with --motion; expected one'),
    ('simulate arm.urdf --kp 100', '--kp: given without --motion'),
    ('feasible arm.urdf --motion m.yaml --jerk 10',
     '--jerk: given without --time-optimal'),
    ('feasible arm.urdf --motion m.yaml --payload-com 0 0 1',
     '--payload-com: given without --payload-frame'),
    ('feasible arm.urdf --motion m.yaml --time-optimal --speed 1',
     '--speed: given with --time-optimal; expected one of them'),
    ('excite arm.urdf -o e.csv --friction --duration 20',
     '--duration: given with --friction'),
    ('excite arm.urdf -o e.csv --loads 2', '--loads: given without --friction'),
    ('identify arm.urdf r.csv --topic /joint_states',
     "topic: '/joint_states' for the file 'r.csv'; expected it for"),
    ('fill arm.urdf --motion m.yaml --topic /plan', "--topic: '/plan' for a file"),
    (f'identify {PALLETIZER} r.csv',
     '--constraints: given without --payload or --drives'),
    ('identify arm.urdf r.csv --payload tip --weight 1',
     '--weight: given with --payload'),
    (f'inspect {PALLETIZER} --against pinocchio', '--constraints: given with --against'),
    ('inspect arm.urdf --xacro a:=1', 'expected it with a file whose name has .xacro'),
    ('equations arm.urdf --json --latex', '--latex: given with --json'),
    ('view arm.urdf --export v.html --port 1', '--port: given with --export'),
    ('send arm.urdf --motion m.yaml --duration 1', '--duration: given without --by'),
    ('doctor arm.urdf --prefix left_', '--prefix: given without --live or --config'),
    ('sweep motion_alone.yaml -o s',
     'motion: given without a controller; expected both'),
    # Results that would replace an input.
    ('identify arm.urdf r.csv --out arm.urdf', "--out: 'arm.urdf' is the input urdf"),
    ('identify arm.urdf r.csv --out arm',
     "'arm.urdf' is the input urdf; expected another"),
    ('identify arm.urdf r.csv --supplement s.supplement.yaml --out s',
     "'s.supplement.yaml' is the input supplement; expected another file"),
    ('fill arm.urdf --motion m.yaml --out ./m.yaml',
     "--out: './m.yaml' is the input motion"),
    ('torque arm.urdf --motion m.csv --plot m.csv', "'m.csv' is the input motion"),
    ('replay arm.urdf r.csv --out link.csv', "'link.csv' is the input recording"),
    # Files that are missing.
    ('torque no.urdf', "no such file: 'no.urdf'"),
    ('torque package://arms/arm.urdf', "an address: 'package://arms/arm.urdf'"),
    ('torque arm.urdf --motion no.csv', "no such file: 'no.csv'"),
    ('torque arm.urdf --motion no.yaml', "no such file: 'no.yaml'"),
    ('torque arm.urdf --supplement no.yaml', "no such file: 'no.yaml'"),
    ('torque arm.urdf --constraints no.yaml', "no such file: 'no.yaml'"),
    ('replay arm.urdf no.csv', "no such file: 'no.csv'"),
    ('replay arm.urdf no.mcap', "no such file: 'no.mcap'"),
    ('fill arm.urdf --motion m.yaml -o no/f.yaml', "'no/f.yaml': no such file"),
    # Files of the wrong kind.
    ('torque r.csv', "'r.csv': seems to be a CSV file with the columns t, q.joint1"),
    ('torque m.yaml', "'m.yaml': seems to be a YAML file; expected a URDF"),
    ('torque array.npy', 'seems to be one NumPy array (.npy); expected a URDF'),
    ('identify r.csv arm.urdf', "'r.csv': seems to be a CSV file"),
    ('replay arm.urdf arm.urdf', 'arm.urdf: seems to be a URDF; expected a CSV file'),
    ('replay arm.urdf m.yaml', 'm.yaml: seems to be a YAML file; expected a CSV file'),
    ('replay arm.urdf array.npy', 'seems to be one NumPy array (.npy); expected a CSV'),
    ('torque arm.urdf --motion arm.urdf', 'seems to be a URDF; expected a CSV file'),
    ('torque arm.urdf --supplement r.csv', 'seems to be a CSV file with the columns t,'),
    ('sweep arm.urdf -o s', "'arm.urdf': seems to be a URDF; expected a YAML mapping"),
    # Columns with other names.
    ('replay arm.urdf other.csv', "first named 'q.joint1' or 'q1', found t, q.shoulder"),
    ('replay arm.urdf other.npz', "first named 'q.joint1' or 'q1', found pos, t"),
    ('torque arm.urdf --motion other.csv',
     "names like 'q.joint1', found ['t', 'q.shoulder'"),
    ('torque arm.urdf --motion torques.csv',
     'expected both for a motion, found tau.joint1, tau.joint2'),
    ('identify arm.urdf r.csv --payload joint2',
     "no frame 'joint2'; expected 'link2', which this joint moves, or one of"),
    # Names of results.
    ('simulate arm.urdf --plot x.txt', "'x.txt'; expected"),
    ('simulate arm.urdf --plot x.png --plot-of tracking', 'tracking without --motion'),
    ('view arm.urdf --export v.txt', "--export: 'v.txt'; expected a name that ends in"),
    ('simulate arm.urdf -o t.xlsx',
     "--out: 't.xlsx'; expected a name that ends in .npz or"),
    ('torque arm.urdf --motion m.yaml -o t.xlsx',
     "--out: 't.xlsx'; expected a name that ends in .csv"),
    ('fill arm.urdf --motion m.yaml -o f.txt',
     "--out: 'f.txt'; expected a .yaml or .csv"),
]


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Return a folder with an arm, motions, a recording and other files."""
    folder = tmp_path_factory.mktemp('refusals')
    model = load_urdf(TWO_LINK)
    recording = simulated(model, 1, 0.01)
    table = np.column_stack([recording.t, recording.q, recording.u, recording.tau])
    names = ['t']
    for quantity in ('q', 'u', 'tau'):
        names += [f'{quantity}.{joint}' for joint in model.joint_names]
    header = ','.join(names)
    write = {'arm.urdf': Path(TWO_LINK).read_text(), 'm.yaml': POINTS,
             'motion_alone.yaml': f'{SWEEP}motion: m.yaml\n',
             's.supplement.yaml': 'joints: {joint1: {damping: 1}}\n',
             'm.csv': 't,q.joint1,q.joint2\n0,0,0\n1,1,1\n',
             'torques.csv': 'tau.joint1,tau.joint2\n0,0\n1,1\n'}
    for name, text in write.items():
        (folder / name).write_text(text)
    others = header.replace('joint1', 'shoulder').replace('joint2', 'elbow')
    for name, columns in (('r.csv', header), ('other.csv', others)):
        np.savetxt(folder / name, table, delimiter=',', header=columns, comments='')
    (folder / 'link.csv').symlink_to(folder / 'r.csv')
    np.save(folder / 'array.npy', table)
    np.savez(folder / 'other.npz', t=recording.t, pos=recording.q)
    return folder


@pytest.mark.parametrize(('arguments', 'words'), REFUSED)
def test_a_mistake_is_one_error_that_says_what_is_expected_and_changes_no_file(
        folder, monkeypatch, arguments, words):
    monkeypatch.chdir(folder)
    before = {name: Path(name).read_bytes() for name in os.listdir()}
    done = command(*arguments.split())
    assert done.returncode == 2
    lines = done.stderr.splitlines()
    errors = [line for line in lines if line.startswith('kane-dynamics: error: ')]
    assert len(errors) == 1 and words in errors[0], lines
    assert {name: Path(name).read_bytes() for name in os.listdir()} == before
