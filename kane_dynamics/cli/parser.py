"""Command line `kane-dynamics`: parser and exit codes; `commands` runs the subcommands."""

import argparse
from collections.abc import Sequence
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
from kane_dynamics.cli.option_rules import check_options
from kane_dynamics.errors import KaneError
from kane_dynamics.native.machine_code import compiling

# Description of each command; its module and function in `cli.commands`.
COMMANDS = {
    'torque': ('Inverse dynamics of a state or of a motion', 'torque_command.torque'),
    'simulate': ('Forward dynamics over time', 'simulate_command.simulation'),
    'sweep': ('Many simulations with values that vary, as a table',
              'sweep_command.sweep'),
    'inspect': ('Tree, masses, limits, operation counts', 'inspect_command.inspect'),
    'export': ('C99 source and header of the compiled dynamics',
               'export_command.export'),
    'equations': ('Mass matrix and bias in closed form', 'export_command.equations'),
    'identify': ('Friction and inertials from a recording',
                 'identify_command.identification'),
    'excite': ('A motion to record for identify', 'excite_command.excitation'),
    'replay': ('Measured and computed torques, and what has changed', 'replay_command.replay'),
    'calibrate': ('Gravity by held poses; collision detection by a motion',
                  'calibrate_command.calibrate'),
    'feasible': ('Check of a motion against the limits of the joints',
                 'feasible_command.feasible'),
    'fill': ('Efforts for a trajectory of joint_trajectory_controller',
             'fill_command.fill'),
    'doctor': ('Problems of a URDF, its node and its ROS graph',
               'doctor_command.doctor'),
    'send': ('A motion for the running node, and how well the arm follows it',
             'send_command.send'),
    'view': ('The robot, its motion and its loads in the browser', 'view_command.view'),
}

INVALID = 2  # exit code of invalid input
INTERRUPTED = 130  # exit code after Ctrl-C
# Words that argparse takes for a value, not for an option, though they begin with '-'.
NEGATIVE = re.compile(r'-\.?\d|-inf|-nan')


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; return its exit code: 2, with a message on stderr, for invalid input."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if sys.stdout is None:  # closed by the caller: nothing is printed
        sys.stdout = open(os.devnull, 'w', encoding='utf-8')  # noqa: SIM115
    return without_broken_pipe(lambda: _main(arguments))


def _main(arguments: list[str]) -> int:
    """Parse the arguments and run the command; return its exit code."""
    parser, command = parsers(arguments[0] if arguments else '')
    if not arguments:
        parser.print_help()
        return 0
    if arguments == ['--version']:
        print(f'kane-dynamics {package_version()}')
        return 0
    options, unknown = parser.parse_known_args(arguments)
    # argparse ends an optional file at the first option: `calibrate URDF --collision FILE`.
    if unknown and not unknown[0].startswith('-') and not getattr(options, 'recording', 1):
        options.recording = unknown.pop(0)
    if unknown and command is not None:
        command.error(f'unrecognized arguments: {" ".join(unknown)}')
    # A mistake of the user is one line, no traceback; a closed pipe is the caller's.
    try:
        with compiling.reported_to(_on_stderr):
            options.stated = _stated(command, arguments)
            check_options(options)
            return _run(options)
    except (KaneError, OSError) as error:
        if isinstance(error, BrokenPipeError) or _of_full_output(error):
            raise
        print(f'kane-dynamics: error: {_text_of(error)}', file=sys.stderr)
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


def _stated(command: argparse.ArgumentParser | None,
            arguments: Sequence[str]) -> dict[str, str]:
    """Return the options among the arguments, as they are written, by their names."""
    stated: dict[str, str] = {}
    if command is None:
        return stated
    for word in arguments:
        flag = word.partition('=')[0]
        action = command._option_string_actions.get(flag)
        if action is not None:
            stated[action.dest] = flag
    return stated


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

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **{**options, 'allow_abbrev': False})
        self._negative_number_matcher = NEGATIVE  # argparse's own lacks -1e-3 and -1,-2

    def error(self, message: str) -> NoReturn:
        """Print the message and exit with code 2."""
        self.exit(INVALID, f'kane-dynamics: error: {message}\nsee {self.prog} --help\n')


def parsers(chosen: str) -> tuple[argparse.ArgumentParser, argparse.ArgumentParser | None]:
    """Return the parser of all commands, and that of the chosen one with its arguments."""
    parser = _Parser('kane-dynamics', description="Manipulator dynamics by Kane's "
                     'method, compiled for one robot at a time.')
    parser.add_argument('--version', action='store_true', help='print the version')
    parsers = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')
    command = None
    # Only the chosen command needs its arguments, some of which import much.
    for name, (text, function) in COMMANDS.items():
        sub = parsers.add_parser(name, help=text, description=f'{text}.',
                                 epilog=EXAMPLES[name],
                                 formatter_class=argparse.RawDescriptionHelpFormatter)
        sub.set_defaults(run=function)
        if name == chosen:
            command = sub
            ADD[name](sub)
    return parser, command
