"""Command line `kane-dynamics`: parser and exit codes; `commands` runs the subcommands."""

import argparse
from collections.abc import Sequence
import difflib
import errno
from importlib import import_module
import os
import re
import sys
from typing import Any, NoReturn

from kane_dynamics._util.broken_pipe import without_broken_pipe
from kane_dynamics._util.resources import package_version
from kane_dynamics.cli.arguments import ADD
from kane_dynamics.cli.examples import EXAMPLES
from kane_dynamics.cli.wording import in_options
from kane_dynamics.errors import KaneError
from kane_dynamics.native.machine_code import compiling

# Description of each command; its module and function in `cli.commands`.
COMMANDS = {
    'torque': ('Inverse dynamics of a state or of a motion', 'torque_command.torque'),
    'simulate': ('Forward dynamics over time', 'simulate_command.simulation'),
    'sweep': ('Many simulations with values that vary, as a table',
              'sweep_command.sweep'),
    'inspect': ('Tree, masses, limits, operation counts', 'inspect_command.inspect'),
    'jacobian': ('Pose and Jacobian of a frame', 'kinematics_command.jacobian'),
    'inverse-kinematics': ('Joint positions at which a frame has a pose',
                           'kinematics_command.inverse'),
    'cartesian': ('A motion in which a frame follows lines and arcs',
                  'cartesian_command.cartesian'),
    'bench': ('Times of calls on this machine', 'bench_command.bench'),
    'export': ('C99 source and header of the compiled dynamics',
               'export_command.export'),
    'equations': ('Mass matrix and bias in closed form', 'export_command.equations'),
    'identify': ('Friction and inertials from a recording',
                 'identify_command.identification'),
    'excite': ('A motion to record for identify', 'excite_command.excitation'),
    'replay': ('Computed and measured torques of a recording', 'replay_command.replay'),
    'watch': ('Changes of an arm that its model does not describe', 'watch_command.watch'),
    'collision-thresholds': ('Collision detection calibrated to a recording',
                             'collision_thresholds_command.collision_thresholds'),
    'feasible': ('Check of a motion against the limits of the joints',
                 'feasible_command.feasible'),
    'fill': ('Efforts for a trajectory of joint_trajectory_controller',
             'fill_command.fill'),
    'doctor': ('Problems of a URDF, its node and its ROS graph',
               'doctor_command.doctor'),
    'send': ('A motion for the running node, and how well the arm follows it',
             'send_command.send'),
    'view': ('The robot, its motion and its loads in the browser', 'view_command.view'),
    'demo': ('Feedforward on a simulated arm, live', 'demo_command.demo'),
}

SYNONYMS = {  # names of options in other tools
    'qdd': 'udot', 'ddq': 'udot', 'acc': 'udot', 'acceleration': 'udot',
    'accelerations': 'udot', 'a': 'udot',
    'qd': 'u', 'dq': 'u', 'velocity': 'u', 'velocities': 'u', 'v': 'u', 'speed': 'u',
    'position': 'q', 'positions': 'q', 'tau': 'torque', 'dt': 'step', 'timestep': 'step',
    'time': 'duration', 'output': 'out', 'tool': 'tip', 'ee': 'tip',
    'end-effector': 'tip'}
# Names of commands in other tools, and what is a part of a command here.
COMMAND_SYNONYMS = {
    'ik': 'inverse-kinematics', 'jac': 'jacobian', 'fk': 'inspect --frames',
    'frames': 'inspect --frames', 'info': 'inspect', 'show': 'view', 'check': 'doctor',
    'validate': 'doctor', 'id': 'torque', 'rnea': 'torque', 'dynamics': 'torque',
    'gravity': 'torque', 'sim': 'simulate', 'fd': 'simulate', 'export-c': 'export',
    'plot': '--plot of torque, simulate, identify and others',
    'constraints': '--constraints of torque, simulate and others',
    'payload': 'identify --payload', 'time-optimal': 'feasible'}


INVALID = 2  # exit code of invalid input
INTERRUPTED = 130  # exit code after Ctrl-C


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; return its exit code: 2, with a message on stderr, for invalid input."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if sys.stdout is None:  # closed by the caller: nothing is printed
        sys.stdout = open(os.devnull, 'w', encoding='utf-8')  # noqa: SIM115
    return without_broken_pipe(lambda: _main(arguments))


def _main(arguments: list[str]) -> int:
    """Parse the arguments and run the command; return its exit code."""
    chosen = arguments[0] if arguments else ''
    parser = _parser(chosen)
    if not arguments:
        parser.print_help()
        return 0
    if arguments == ['--version']:
        print(f'kane-dynamics {package_version()}')
        return 0
    options = _options(parser, arguments)
    if options.unknown and options.command != 'demo':
        _refuse_unknown(parser, options)
    # A mistake of the user is one line, no traceback; a closed pipe is the caller's.
    try:
        with compiling.reported_to(_on_stderr):
            return _run(options)
    except (KaneError, OSError) as error:
        if isinstance(error, BrokenPipeError) or _of_full_output(error):
            raise
        text = _with_option_names(parser, options.command, _text_of(error))
        print(f'kane-dynamics: error: {text}', file=sys.stderr)
        return INVALID
    except KeyboardInterrupt:
        return INTERRUPTED


def _on_stderr(text: str) -> None:
    """Print a line on a slow compilation."""
    print(f'kane-dynamics: {text}', file=sys.stderr)


def _run(options: argparse.Namespace) -> int:
    """Import the chosen command, and no other; run it and return its exit code."""
    from kane_dynamics.cli.printing import printed_warnings
    module, function = options.run.split('.')
    commands = import_module(f'kane_dynamics.cli.commands.{module}')
    with printed_warnings(verbose=getattr(options, 'verbose', False)):
        code = getattr(commands, function)(options)
    return 0 if code is None else int(code)


def _options(parser: argparse.ArgumentParser,
             arguments: list[str]) -> argparse.Namespace:
    """
    Return the options; `unknown` has the arguments that the command does not know.

    argparse reads a negative number like -1e-3 as an option, unless it begins with a
    blank.
    """
    words = []
    for argument in arguments:
        # A blank before negative numbers keeps them from being read as options.
        is_negative = argument.startswith('-') and _is_number(argument)
        words.append(f' {argument}' if is_negative else argument)
    if arguments[0].startswith('-') and arguments[0] not in ('-h', '--help'):
        parser.error(f"'{arguments[0]}' before the command; expected one of "
                     f'{", ".join(COMMANDS)}, or --help, --version')
    options, unknown = parser.parse_known_args(words)
    options.unknown = unknown
    for name, value in vars(options).items():
        setattr(options, name, _without_blanks(value))
    return options


def _without_blanks(value: Any) -> Any:
    """Return a value of an option without the blanks before negative numbers."""
    if isinstance(value, list):
        return list(map(_without_blanks, value))
    if isinstance(value, str) and value.startswith(' -') and _is_number(value[1:]):
        return value[1:]
    return value


def _of_full_output(error: KaneError | OSError) -> bool:
    """Return whether standard output cannot take all: errors of files name the file."""
    return (isinstance(error, OSError) and error.errno == errno.ENOSPC
            and error.filename is None)


def _text_of(error: KaneError | OSError) -> str:
    """Return the message of an error; that of the system is led by the file's name."""
    if isinstance(error, OSError) and error.filename is not None:
        return (f"'{error.filename}': {str(error.strerror).lower()}; expected the path "
                'of a file that can be read, or written in an existing folder')
    return str(error)


class _Parser(argparse.ArgumentParser):
    """Argument parser whose errors refer to --help instead of printing the whole usage."""

    def error(self, message: str) -> NoReturn:
        """Print the message and exit with code 2."""
        text = _as_expected(message)
        self.exit(INVALID, f'kane-dynamics: error: {text}\nsee {self.prog} --help\n')


def _as_expected(message: str) -> str:
    """Return an error of argparse in the form of the library: what was given, what is expected."""
    message = re.sub(r'^argument (?:-\w/)?', '', message)

    # Each pattern is one of argparse's messages.
    choice = re.fullmatch(r"(.*?): invalid choice: '(.*?)' \(choose from (.*)\)",
                          message)
    if choice is not None:
        name, value, listed = choice.groups()
        choices = re.findall(r"'(.*?)'", listed)
        near = difflib.get_close_matches(value, choices, 1)
        if name == 'COMMAND' and value in COMMAND_SYNONYMS:
            near = [COMMAND_SYNONYMS[value]]
        hint = ''
        if near:
            hint = f'{near[0]}, or '
        return f"{name}: '{value}'; expected {hint}one of {', '.join(choices)}"
    number = re.fullmatch(r"(.*?): invalid (float|int) value: '(.*)'", message)
    if number is not None:
        kind = {'float': 'a number', 'int': 'an integer'}[number[2]]
        return f"{number[1]}: '{number[3]}'; expected {kind}"
    missing = re.fullmatch(r'the following arguments are required: (.*)', message)
    if missing is not None:
        expected = 'it'
        if ', ' in missing[1]:
            expected = 'all of them'
        return f'{missing[1]}: missing; expected {expected}'
    excluded = re.fullmatch(r'(.*?): not allowed with argument (.*)', message)
    if excluded is not None:
        return f'{excluded[1]}: given with {excluded[2]}; expected one of them'
    return message


def _command(parser: argparse.ArgumentParser, command: str) -> argparse.ArgumentParser:
    """Return the parser of a command."""
    commands: Any = next(action.choices for action in parser._actions
                         if action.dest == 'command')
    sub: argparse.ArgumentParser = commands[command]
    return sub


def _flags(parser: argparse.ArgumentParser, command: str) -> list[str]:
    """Return the options of a command."""
    actions = _command(parser, command)._option_string_actions
    return [flag for flag in actions if flag.startswith('--')]


def _positionals(parser: argparse.ArgumentParser, command: str) -> list[str]:
    """Return the names of the arguments of a command that are no options."""
    return [str(action.metavar or action.dest).upper()
            for action in _command(parser, command)._actions
            if not action.option_strings]


def _with_option_names(parser: argparse.ArgumentParser, command: str, text: str) -> str:
    """Return an error of the library with arguments named as options of the command."""
    name = re.split(r'\W', text, maxsplit=1)[0]
    flag = '--' + name.replace('_', '-')
    if flag in _flags(parser, command):
        text = flag + text[len(name):]
    return in_options(text)


def _refuse_unknown(parser: argparse.ArgumentParser,
                    options: argparse.Namespace) -> NoReturn:
    """Exit with an error for unknown options; the message names the closest option."""
    flags = _flags(parser, options.command)
    # The first option, which a value may precede.
    first = options.unknown[0]
    for word in reversed(options.unknown):
        if word.startswith('--'):
            first = word
    synonym = SYNONYMS.get(first.lstrip('-').replace('_', '-').lower())
    nearest = difflib.get_close_matches(first, flags, 1)
    if f'--{synonym}' in flags:
        nearest = [f'--{synonym}']
    hint = 'expected no further ones'
    positional = first.lstrip('-').upper()
    if positional in _positionals(parser, options.command):
        hint = f'expected {positional} without --{first.lstrip("-")}'
    elif first == '--payload' and '--supplement' in flags:
        hint = "expected --supplement FILE with the entry 'payload'"
    elif nearest:
        hint = f'expected {nearest[0]}?'
    _command(parser, options.command).error(
        f'unrecognized arguments: {" ".join(options.unknown)}; {hint}')


def _is_number(text: str) -> bool:
    """Return whether an argument is one number, or several separated by commas."""
    parts = [part for part in text.split(',') if part]
    try:
        for part in parts:
            float(part)
    except ValueError:
        return False
    return bool(parts)


def _parser(chosen: str) -> argparse.ArgumentParser:
    """Return the parser of all commands, with the arguments of the chosen one."""
    parser = _Parser('kane-dynamics', description="Manipulator dynamics by Kane's "
                     'method, compiled for one robot at a time.')
    parser.add_argument('--version', action='store_true', help='print the version')
    parsers = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')
    # Only the chosen command needs its arguments, some of which import much.
    for name, (text, function) in COMMANDS.items():
        sub = parsers.add_parser(name, help=text, description=f'{text}.',
                                 epilog=EXAMPLES[name],
                                 formatter_class=argparse.RawDescriptionHelpFormatter,
                                 add_help=name != 'demo')
        sub.set_defaults(run=function)
        if name == chosen and name in ADD:
            ADD[name](sub)
    return parser
