"""The command line, `kane-dynamics`: arguments and exit codes; the work is in `commands`."""

import argparse
from collections.abc import Callable, Sequence
import difflib
import math
import re
import sys
from typing import Any, NoReturn

from kane_dynamics._util.resources import package_version
from kane_dynamics.cli.commands import bench_command, commands, torque_command
from kane_dynamics.cli.examples import EXAMPLES
from kane_dynamics.cli.pictures import add_plot, KINDS
from kane_dynamics.cli.shared import in_options
from kane_dynamics.cli.tables import STEP as SAMPLES
from kane_dynamics.errors import KaneError
from kane_dynamics.feasibility.samples import STEP
from kane_dynamics.identification.regression import STANDSTILL
from kane_dynamics.model.model import GRAVITY
from kane_dynamics.robot.export_c import DEFAULT_KERNELS
from kane_dynamics.simulation.step_kernels import INTEGRATORS

SYNONYMS = {  # of options, in other tools
    'qdd': 'udot', 'ddq': 'udot', 'acc': 'udot', 'acceleration': 'udot', 'accelerations': 'udot',
    'a': 'udot', 'qd': 'u', 'dq': 'u', 'velocity': 'u', 'velocities': 'u', 'v': 'u', 'speed': 'u',
    'position': 'q', 'positions': 'q', 'tau': 'torque', 'dt': 'step', 'timestep': 'step',
    'time': 'duration', 'output': 'out', 'tool': 'tip', 'ee': 'tip', 'end-effector': 'tip'}


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; return its exit code, 2 for bad usage or input, told on stderr."""
    given = list(sys.argv[1:] if argv is None else argv)
    parser = _parser()
    if not given:
        parser.print_help()
        return 0
    # A blank in front keeps argparse from reading a negative number like -1e-3 as an option.
    marked = {f' {a}': a for a in given if a.startswith('-') and _is_number(a)}
    options, rest = parser.parse_known_args([f' {a}' if f' {a}' in marked else a for a in given])
    for name, value in vars(options).items():  # where it was text after all, as given
        if isinstance(value, list):
            setattr(options, name, [marked.get(part, part) for part in value])
        elif isinstance(value, str):
            setattr(options, name, marked.get(value, value))
    options.rest = [marked.get(argument, argument) for argument in rest]
    if rest and options.command != 'demo':
        _unknown(parser, options)
    try:
        return int(options.run(options) or 0)
    except (KaneError, OSError) as error:
        print(f'kane-dynamics: error: {_in_words(parser, options.command, str(error))}',
              file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


class _Parser(argparse.ArgumentParser):
    """A parser that says what is wrong, and where the usage stands, instead of all usage first."""

    def error(self, message: str) -> NoReturn:
        """Print the message and leave with 2."""
        self.exit(2, f'kane-dynamics: error: {message}\nsee {self.prog} --help\n')


def _flags(parser: argparse.ArgumentParser, command: str) -> list[str]:
    """Return the options of a command."""
    return [flag for flag in _command(parser, command)._option_string_actions
            if flag.startswith('--')]


def _command(parser: argparse.ArgumentParser, command: str) -> argparse.ArgumentParser:
    """Return the parser of a command."""
    subs: Any = next(action.choices for action in parser._actions if action.dest == 'command')
    found: argparse.ArgumentParser = subs[command]
    return found


def _in_words(parser: argparse.ArgumentParser, command: str, text: str) -> str:
    """Return an error of the library with the command's own names of its arguments."""
    name = re.match(r'\w*', text)
    flag = '--' + name[0].replace('_', '-') if name else ''
    return ('--' if flag in _flags(parser, command) else '') + in_options(text)


def _unknown(parser: argparse.ArgumentParser, options: argparse.Namespace) -> NoReturn:
    """Refuse options that there are not, with what may be meant."""
    sub, known = _command(parser, options.command), _flags(parser, options.command)
    wrong = next((word for word in options.rest if word.startswith('--')), options.rest[0])
    meant = SYNONYMS.get(wrong.lstrip('-').replace('_', '-').lower())
    near = [f'--{meant}'] if f'--{meant}' in known else difflib.get_close_matches(wrong, known, 1)
    hint = f'; expected {near[0]}?' if near else ''
    sub.error(f'unrecognized arguments: {" ".join(options.rest)}{hint}')


def _is_number(text: str) -> bool:
    """Tell whether an argument is one number, or several with commas in between."""
    try:
        return bool([float(part) for part in text.split(',') if part])
    except ValueError:
        return False


def _parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    parser = _Parser('kane-dynamics', description="Manipulator dynamics by Kane's method, "
                     'compiled for one robot at a time.')
    parser.add_argument('--version', action='version', version=f'%(prog)s {package_version()}')
    parsers = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')

    def command(name: str, run: Callable[[Any], int | None], text: str, *, add_help: bool = True
                ) -> argparse.ArgumentParser:
        sub = parsers.add_parser(name, help=text, description=f'{text}.', epilog=EXAMPLES[name],
                                 formatter_class=argparse.RawDescriptionHelpFormatter,
                                 add_help=add_help)
        sub.set_defaults(run=run)
        return sub

    sub = command('torque', torque_command.torque, 'Inverse dynamics of a state or of a motion')
    _add_model(sub)
    for name, text in (('q', 'positions, rad or m'), ('u', 'speeds'), ('udot', 'accelerations')):
        sub.add_argument(f'--{name}', nargs='+', metavar='X', help=f'{text} (default: zeros)')
    _add_motion(sub, 'CSV or YAML file: its torques, row by row')
    sub.add_argument('--step', type=float, metavar='S', help='between samples of the motion '
                     f'(default: {SAMPLES:g} between points of a YAML file; rows of a CSV file)')
    sub.add_argument('--out', metavar='CSV', help='file for the torques of a motion')
    add_plot(sub, 'torque-by-source', *(kind for kind in KINDS if kind != 'torque-by-source'))
    sub = command('simulate', commands.simulation, 'Forward dynamics over time')
    _add_model(sub)
    sub.add_argument('--q0', nargs='+', metavar='X',
                     help="positions at the start (default: the motion's, else zeros)")
    sub.add_argument('--u0', nargs='+', metavar='X', help='speeds at the start (default: zeros)')
    sub.add_argument('--duration', type=float, metavar='S',
                     help="simulated seconds (default: the motion's, else 1)")
    sub.add_argument('--step', type=float, default=1e-3, metavar='S', help='default: 0.001')
    sub.add_argument('--integrator', choices=INTEGRATORS, default='rk4',
                     help='implicit: for friction, springs and beams that take a very short step')
    source = sub.add_mutually_exclusive_group()
    _add_motion(source, 'follow it by computed torque')
    source.add_argument('--torque', nargs='+', metavar='X', help='constant torques, or a CSV file')
    sub.add_argument('--kp', type=float, nargs='+', default=[100.0], metavar='X',
                     help='for --motion, one value or one per joint, 1/s^2; default: 100')
    sub.add_argument('--kd', type=float, nargs='+', default=[20.0], metavar='X',
                     help='for --motion, one value or one per joint, 1/s; default: 20')
    sub.add_argument('--out', metavar='FILE', help='.npz or .csv file for the trajectory')
    add_plot(sub, *KINDS, 'tracking')
    sub = command('sweep', commands.sweep, 'Many simulations with values that vary, as a table')
    sub.add_argument('sweep', metavar='YAML', help='what to simulate; see below')
    sub.add_argument('-o', '--out', required=True, metavar='FOLDER',
                     help='for the parquet files; new, or of this sweep')
    sub.add_argument('--workers', type=int, metavar='N', help='processes (default: all cores)')
    sub.add_argument('--dask', metavar='ADDRESS', help='of a Dask scheduler, to compute there')
    sub.add_argument('--json', action='store_true', help='print JSON')
    sub = command('inspect', commands.inspect, 'Tree, masses, limits, operation counts')
    _add_model(sub)
    sub.add_argument('--against', choices=['pinocchio'],
                     help='compare inverse dynamics at random states')
    sub.add_argument('--operations', action='store_true',
                     help='also the arithmetic operations of each compiled function')
    sub = command('bench', bench_command.bench, 'What calls take on this machine')
    _add_model(sub)
    sub = command('export', commands.export, 'C99 source and header of the compiled dynamics')
    _add_model(sub)
    sub.add_argument('-o', '--out', required=True, metavar='FILE.c',
                     help='the source; the header goes beside it')
    sub.add_argument('--kernel', nargs='+', default=DEFAULT_KERNELS, metavar='NAME',
                     help=f'default: {" ".join(DEFAULT_KERNELS)}')
    sub.add_argument('--wrench-frames', nargs='+', default=(), metavar='LINK',
                     help='links on which the environment may push')
    sub.add_argument('--payload-frame', metavar='LINK', help='link that carries a payload')
    sub = command('equations', commands.equations, 'Mass matrix and bias in closed form')
    _add_model(sub)
    sub.add_argument('--numbers', action='store_true',
                     help="the model's numbers instead of symbols for them")
    form = sub.add_mutually_exclusive_group()
    for name in ('latex', 'markdown', 'csv'):
        form.add_argument(f'--{name}', dest='format', action='store_const', const=name)
    sub.set_defaults(format='text')
    sub.add_argument('-o', '--out', metavar='FILE', help='write there instead of printing')
    sub = command('identify', commands.identify, 'Friction and inertials from a recording')
    _add_model(sub)
    _add_recording(sub)
    sub.add_argument('--friction-only', action='store_true',
                     help='leave the inertials as they are')
    sub.add_argument('--unbounded', action='store_true',
                     help='with --friction-only: let friction come out negative, by plain least '
                          'squares, where the rigid bodies leave something unexplained')
    sub.add_argument('--standstill', type=float, default=STANDSTILL, metavar='SPEED',
                     help='a slower joint says nothing; rad/s or m/s, default: %(default)g')
    sub.add_argument('--weight', type=float, metavar='W',
                     help="of the URDF's inertials as a prior (default: by cross-validation)")
    sub.add_argument('--base-parameters', action='store_true',
                     help='only what torques tell for certain, by plain least squares')
    sub.add_argument('--payload', metavar='LINK',
                     help='find what this link carries, the rest being known')
    sub.add_argument('-o', '--out', metavar='FILE',
                     help='write the identified model, a URDF; with --payload a supplement')
    sub = command('excite', commands.excite, 'A motion to record for identify')
    _add_model(sub)
    sub.add_argument('-o', '--out', metavar='CSV', required=True, help='write the motion')
    for name, kind, default, text in (
            ('duration', float, 10.0, 's'),
            ('periods', int, 1, 'number of equal periods in the duration'),
            ('harmonics', int, 5, 'sines and cosines of each joint'),
            ('share', float, 0.9, 'fraction of the limits to use'),
            ('seed', int, 0, 'of the motions that the search starts from'),
            ('starts', int, 2, 'how many of these'), ('rate', float, 100.0, 'rows a second')):
        sub.add_argument(f'--{name}', type=kind, default=default, metavar='X',
                         help=f'{text}; default: %(default)s')
    for name, unit in (('velocity', 'rad/s or m/s'), ('acceleration', 'rad/s^2 or m/s^2')):
        sub.add_argument(f'--{name}', type=float, nargs='+', default=[math.inf], metavar='X',
                         help=f'further limit, one value or one per joint, {unit}')
    sub.add_argument('--floor', type=float, metavar='Z',
                     help='height that the origin of no moving link goes below, m')
    sub = command('replay', commands.replay, 'Torques along a recording, beside those measured')
    _add_model(sub)
    _add_recording(sub)
    sub.add_argument('-o', '--out', metavar='CSV', help='write the motion and its torques')
    add_plot(sub, 'measured and computed torques')
    sub = command('feasible', commands.feasible, 'Whether a motion fits the motors')
    _add_model(sub)
    _add_motion(sub, 'CSV or YAML file', required=True)
    sub.add_argument('--speed', type=float, default=1.0, metavar='S',
                     help='judge the motion S times as fast as in the file')
    sub.add_argument('--power', type=float, nargs='+', default=[math.inf], metavar='W',
                     help='largest mechanical power, one value or one per joint (default: none)')
    sub.add_argument('--payload-frame', metavar='LINK', help='find the largest payload there')
    sub.add_argument('--payload-com', type=float, nargs=3, default=(0.0, 0.0, 0.0),
                     metavar=('X', 'Y', 'Z'), help='its mass centre in that frame, m')
    sub.add_argument('--step', type=float, default=STEP, metavar='S',
                     help='between samples, default: %(default)g')
    sub.add_argument('-o', '--out', metavar='CSV',
                     help='write the motion at the highest speed that fits')
    add_plot(sub, 'torque, speed and power')
    sub = command('doctor', commands.doctor, 'What is wrong with a URDF, its node, its graph')
    _add_model(sub)
    sub.add_argument('--config', metavar='YAML', help='parameters of the dynamics node')
    sub.add_argument('--live', type=float, metavar='S',
                     help='listen to the graph for so long, once its nodes are found')
    sub.add_argument('--namespace', default='', help='of the arm in the graph')
    sub.add_argument('--prefix', default='', help="of the arm's joints in the graph")
    for name, what in (('commands', 'torques'), ('joint_states', 'joint states')):
        sub.add_argument(f'--{name.replace("_", "-")}', default=name, metavar='TOPIC',
                         help=f'of the {what} in the graph; default: %(default)s')
    sub = command('view', commands.view, 'The robot, its motion and its loads in the browser')
    _add_model(sub)
    _add_motion(sub, '.npz, CSV or YAML file: a slider over time')
    sub.add_argument('--host', default='127.0.0.1', help='address to serve at; by default only '
                     'this machine sees the page')
    sub.add_argument('--port', type=int, default=8080, help='or the next free one; default: 8080')
    sub.add_argument('--no-open', action='store_true', help='open no browser')
    sub.add_argument('--export', metavar='FILE.html', help='write a page instead of serving one')
    command('demo', commands.demo, 'Feedforward on a simulated arm, live', add_help=False)
    return parser


def _add_motion(sub: Any, text: str, **options: Any) -> None:
    """Add --motion, and --trajectory as another name of it."""
    sub.add_argument('--motion', '--trajectory', metavar='FILE', help=text, **options)


def _add_recording(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('recording', metavar='RECORDING', help='CSV or npz file, or a ROS 2 bag')
    parser.add_argument('--topic', help='of the joint states in a bag (default: its only one)')
    parser.add_argument('--cutoff', type=float, metavar='HZ',
                        help='filter q and tau without delay, and make u and udot from q')


def _add_model(sub: argparse.ArgumentParser) -> None:
    """Add the arguments that choose the robot, and --json."""
    sub.add_argument('urdf', metavar='URDF', help="path of the URDF, or '-' for standard input")
    group = sub.add_argument_group('robot')
    group.add_argument('--joints', nargs='+', metavar='NAME',
                       help='joints that move, in the order of all numbers')
    group.add_argument('--base', metavar='LINK', help='first link of the part that moves')
    group.add_argument('--tip', metavar='LINK', help='last link of the part that moves')
    group.add_argument('--gravity', nargs=3, type=float, default=GRAVITY, metavar=('X', 'Y', 'Z'),
                       help='m/s^2; default: 0 0 -9.81')
    group.add_argument('--supplement', metavar='YAML',
                       help='springs, armature and friction that a URDF cannot say')
    group.add_argument('--no-friction', action='store_true', help='leave damping and friction out')
    group.add_argument('--no-strict', action='store_true',
                       help='warn of impossible inertias instead of refusing them')
    sub.add_argument('--json', action='store_true', help='print JSON')
    sub.add_argument('-v', '--verbose', action='store_true',
                     help='print all warnings, with every name')
