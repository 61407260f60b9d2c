"""Command line `kane-dynamics`: parser and exit codes; `commands` runs the subcommands."""

import argparse
from collections.abc import Sequence
import difflib
from importlib import import_module
import os
import re
import signal
import sys
from typing import Any, NoReturn

from kane_dynamics._util.resources import package_version
from kane_dynamics.cli.arguments import ADD
from kane_dynamics.cli.examples import EXAMPLES
from kane_dynamics.cli.wording import in_options
from kane_dynamics.errors import InputError, KaneError
from kane_dynamics.native.machine_code import compile_log

# Description of each command; its module and function in `cli.commands`.
COMMANDS = {
    'torque': ('Inverse dynamics of a state or of a motion', 'torque_command.torque'),
    'simulate': ('Forward dynamics over time', 'simulate_command.simulation'),
    'sweep': ('Many simulations with values that vary, as a table', 'sweep_command.sweep'),
    'inspect': ('Tree, masses, limits, operation counts', 'commands.inspect'),
    'jacobian': ('Pose and Jacobian of a frame', 'kinematics_command.jacobian'),
    'inverse-kinematics': ('Joint positions at which a frame has a pose',
                           'kinematics_command.inverse'),
    'bench': ('Times of calls on this machine', 'bench_command.bench'),
    'export': ('C99 source and header of the compiled dynamics', 'commands.export'),
    'equations': ('Mass matrix and bias in closed form', 'commands.equations'),
    'identify': ('Friction and inertials from a recording', 'identify_command.identification'),
    'excite': ('A motion to record for identify', 'excite_command.excitation'),
    'replay': ('Computed and measured torques of a recording', 'replay_command.replay'),
    'collision-thresholds': ('Collision detection calibrated to a recording without contact',
                             'collision_thresholds_command.collision_thresholds'),
    'feasible': ('Check of a motion against the limits of the joints',
                 'feasible_command.feasible'),
    'fill': ('Efforts for a trajectory of joint_trajectory_controller', 'fill_command.fill'),
    'doctor': ('Problems of a URDF, its node and its ROS graph', 'commands.doctor'),
    'view': ('The robot, its motion and its loads in the browser', 'view_command.view'),
    'demo': ('Feedforward on a simulated arm, live', 'commands.demo'),
}

SYNONYMS = {  # names of options in other tools
    'qdd': 'udot', 'ddq': 'udot', 'acc': 'udot', 'acceleration': 'udot', 'accelerations': 'udot',
    'a': 'udot', 'qd': 'u', 'dq': 'u', 'velocity': 'u', 'velocities': 'u', 'v': 'u', 'speed': 'u',
    'position': 'q', 'positions': 'q', 'tau': 'torque', 'dt': 'step', 'timestep': 'step',
    'time': 'duration', 'output': 'out', 'tool': 'tip', 'ee': 'tip', 'end-effector': 'tip'}


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; return its exit code: 2, with a message on stderr, for invalid input."""
    given = list(sys.argv[1:] if argv is None else argv)
    if sys.stdout is None:  # closed by the caller: nothing is printed
        sys.stdout = open(os.devnull, 'w', encoding='utf-8')  # noqa: SIM115
    parser = _parser(given[0] if given else '')
    if not given:
        parser.print_help()
        return 0
    if given == ['--version']:
        print(f'kane-dynamics {package_version()}')
        return 0
    # With a leading blank, argparse does not read a negative number like -1e-3 as an option.
    marked = {f' {a}': a for a in given if a.startswith('-') and _is_number(a)}
    options, rest = parser.parse_known_args([f' {a}' if f' {a}' in marked else a for a in given])
    for name, value in vars(options).items():  # restore texts as given
        if isinstance(value, list):
            setattr(options, name, [marked.get(part, part) for part in value])
        elif isinstance(value, str):
            setattr(options, name, marked.get(value, value))
    options.rest = [marked.get(argument, argument) for argument in rest]
    if rest and options.command != 'demo':
        _unknown(parser, options)
    try:
        if sys.stdout is None:
            raise InputError('standard output: closed; expected an open one')
        compile_log.on_stderr = True
        module, function = options.run.split('.')  # import only the chosen command
        commands = import_module(f'kane_dynamics.cli.commands.{module}')
        code = int(getattr(commands, function)(options) or 0)
        sys.stdout.flush()
        return code
    except BrokenPipeError:  # such as `| head`: the reader has closed it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + signal.SIGPIPE  # as of other programs
    except (KaneError, OSError) as error:
        text = str(error)
        if isinstance(error, OSError) and error.filename is not None:
            text = f"'{error.filename}': {str(error.strerror).lower()}"
        print(f'kane-dynamics: error: {_with_option_names(parser, options.command, text)}',
              file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    finally:
        compile_log.on_stderr = False


class _Parser(argparse.ArgumentParser):
    """Argument parser whose errors refer to --help instead of printing the whole usage."""

    def error(self, message: str) -> NoReturn:
        """Print the message and exit with code 2."""
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


def _with_option_names(parser: argparse.ArgumentParser, command: str, text: str) -> str:
    """Return an error of the library with arguments named as options of the command."""
    name = re.match(r'\w*', text)
    flag = '--' + name[0].replace('_', '-') if name else ''
    return ('--' if flag in _flags(parser, command) else '') + in_options(text)


def _unknown(parser: argparse.ArgumentParser, options: argparse.Namespace) -> NoReturn:
    """Exit with an error for unknown options; the message names the closest option."""
    sub, known = _command(parser, options.command), _flags(parser, options.command)
    wrong = next((word for word in options.rest if word.startswith('--')), options.rest[0])
    meant = SYNONYMS.get(wrong.lstrip('-').replace('_', '-').lower())
    near = [f'--{meant}'] if f'--{meant}' in known else difflib.get_close_matches(wrong, known, 1)
    hint = f'; expected {near[0]}?' if near else ''
    sub.error(f'unrecognized arguments: {" ".join(options.rest)}{hint}')


def _is_number(text: str) -> bool:
    """Return whether an argument is one number, or several separated by commas."""
    try:
        return bool([float(part) for part in text.split(',') if part])
    except ValueError:
        return False


def _parser(chosen: str) -> argparse.ArgumentParser:
    """Return the parser of all commands, with the arguments of the chosen one."""
    parser = _Parser('kane-dynamics', description="Manipulator dynamics by Kane's method, "
                     'compiled for one robot at a time.')
    parser.add_argument('--version', action='store_true', help='print the version')
    parsers = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')
    for name, (text, function) in COMMANDS.items():
        sub = parsers.add_parser(name, help=text, description=f'{text}.', epilog=EXAMPLES[name],
                                 formatter_class=argparse.RawDescriptionHelpFormatter,
                                 add_help=name != 'demo')
        sub.set_defaults(run=function)
        if name == chosen and name in ADD:
            ADD[name](sub)
    return parser
