"""
Check the command line of a node before it starts.

rclpy ignores arguments that are not behind ``--ros-args``, and parameters of other
nodes: a node would run without them, and wait for ever for a URDF that they name.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
import os
from pathlib import Path
import sys

from kane_dynamics._util.broken_pipe import without_broken_pipe
from kane_dynamics.errors import InputError, KaneError
from kane_dynamics.ros.common.parameter_files import (parameter_blocks, takes_effect,
                                                      WILDCARD)

ROS_ARGUMENTS = '--ros-args'
# Exit code of an invalid command line or configuration, which no further start mends.
INVALID = 2
OPTIONS_OF_ROS = ('-p', '--param', '-r', '--remap', '--params-file', '-e', '--enclave',
                  '--log-level', '--log-config-file', '--log-file-name')


@dataclass(frozen=True)
class RosProgram:
    """
    A program that runs one node.

    Attributes
    ----------
    name, node : str
        Names of the executable and of its node.
    purpose : str
        One sentence for the help.
    examples : tuple of str
        Command lines for the help, without the program.

    """

    name: str
    node: str
    purpose: str
    examples: tuple[str, ...]

    @property
    def help_text(self) -> str:
        """Return the text for --help."""
        usage = '--ros-args [-p NAME:=VALUE] [--params-file FILE] [-r FROM:=TO] ...'
        lines = [f'usage: {self.name} {usage}', '', self.purpose,
                 f'Parameter files name the node, {self.node}, or {WILDCARD}.', '',
                 'examples:']
        lines += [f'  {self.name} {example}' for example in self.examples]
        return '\n'.join(lines)


def run_program(program: RosProgram, arguments: Sequence[str] | None,
                run: Callable[[Sequence[str]], int]) -> int:
    """
    Check the command line, then run the program; return its exit code.

    It is `INVALID` if an argument, a parameter or a file is invalid; the reason is
    printed.

    Parameters
    ----------
    program : Program
        The program.
    arguments : sequence of str, optional
        The program and its arguments; default: those of this process.
    run : callable
        Imports what the node needs, and runs it with the arguments.

    """
    _open_standard_streams()
    command_line = list(sys.argv if arguments is None else arguments)
    outside, ros_arguments = split_arguments(command_line[1:])
    # Help needs no ROS.
    if {'-h', '--help'} & {*outside, *ros_arguments}:
        return without_broken_pipe(lambda: _print_help(program))
    try:
        check_arguments(program, outside, ros_arguments)
        return run(command_line)
    except KaneError as error:
        print(f'{program.name}: {error}', file=sys.stderr)
    # Only missing packages of ROS have this remedy.
    except ModuleNotFoundError as error:
        package = str(error.name).partition('.')[0]
        if package == 'kane_dynamics':
            raise
        print(f"{program.name}: '{package}' is not installed; expected ROS 2 with this "
              'package, '
              "from a sourced workspace or pip install 'kane_dynamics[ros]'",
              file=sys.stderr)
    return INVALID


def _print_help(program: RosProgram) -> int:
    """Print the help text; return the exit code."""
    print(program.help_text)
    return 0


def _open_standard_streams() -> None:
    """
    Open the standard streams that are closed.

    Else a socket gets the number to which logs are written.
    """
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number


def split_arguments(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the arguments outside and behind ``--ros-args``, which ``--`` ends."""
    outside: list[str] = []
    ros_arguments: list[str] = []
    # `active` is the list to which the following arguments belong.
    active = outside
    for argument in arguments:
        if argument == ROS_ARGUMENTS:
            active = ros_arguments
        elif argument == '--' and active is ros_arguments:
            active = outside
        else:
            active.append(argument)
    return outside, ros_arguments


def check_arguments(program: RosProgram, outside: Sequence[str],
                    ros_arguments: Sequence[str]) -> None:
    """
    Check the arguments of a program.

    Parameters
    ----------
    program : Program
        The program.
    outside, ros_arguments : sequence of str
        Arguments outside and behind ``--ros-args``.

    Raises
    ------
    InputError
        An argument would be ignored, or a parameter file is unusable or of other nodes.

    """
    if outside:
        raise InputError(f"argument '{outside[0]}': outside of {ROS_ARGUMENTS}; "
                         f'expected {program.name} {ROS_ARGUMENTS} {_intended(outside)}')
    options = _options(ros_arguments)
    node = _node_name(program, options)
    names = set()
    # Options of ROS are checked by ROS itself; those with files and values here.
    for option, value in options:
        if not option:
            raise InputError(f"argument '{value}': after {ROS_ARGUMENTS}; expected "
                             f'{program.name} {ROS_ARGUMENTS} {_intended([value])}')
        if option == '--params-file':
            _check_file(program, Path(value), node)
        elif option in ('-p', '--param'):
            name = _checked_parameter(value, node)
            if name in names:
                raise InputError(f"argument '-p {value}': parameter '{name}' given twice; "
                                 'expected it once')
            names.add(name)


def _intended(outside: Sequence[str]) -> str:
    """Return the arguments that were probably meant."""
    # The most likely meaning by the form of the first argument.
    first = outside[0]
    if first in OPTIONS_OF_ROS:
        return ' '.join(outside)
    if ':=' in first:
        return f'-p {first}'
    if first.endswith(('.yaml', '.yml')):
        return f'--params-file {first}'
    if first.endswith(('.urdf', '.xacro')):
        return f'-p urdf:={first}'
    return '-p NAME:=VALUE ... (see --help)'


def _options(ros_arguments: Sequence[str]) -> list[tuple[str, str]]:
    """
    Return options of ROS with their values.

    An argument without option has an empty one.
    """
    options = []
    pending = ''
    for argument in ros_arguments:
        if pending:
            options.append((pending, argument))
            pending = ''
        elif argument in OPTIONS_OF_ROS:
            pending = argument
        elif not argument.startswith('-'):
            options.append(('', argument))
    return options  # rclpy refuses other options, and those without a value


def _node_name(program: RosProgram, options: Sequence[tuple[str, str]]) -> str:
    """Return the full name of the node after the remappings of the options."""
    rules = [value.partition(':=') for option, value in options
             if option in ('-r', '--remap')]
    name = _remapped(program.node, ('__node', '__name'), rules) or program.node
    namespace = _remapped(name, ('__ns',), rules).rstrip('/')
    return f'{namespace}/{name}'


def _remapped(node: str, keys: Collection[str],
              rules: Sequence[tuple[str, str, str]]) -> str:
    """
    Return the value of the first rule for a key, as rcl chooses it; empty without one.

    A rule may name the node to which it applies: ``kane_dynamics:__ns:=/left``.
    """
    for rule, _, value in rules:
        target, _, key = rule.rpartition(':')
        if key in keys and target in ('', node):
            return value
    return ''


def _check_file(program: RosProgram, path: Path, node: str) -> None:
    """Raise InputError unless a file has parameters of the node."""
    blocks = parameter_blocks(path)
    if not any(takes_effect(block, node) for block in blocks):
        raise InputError(f"parameter file '{path}': parameters of {', '.join(blocks)}; "
                         f'expected those of {node}, the node of {program.name}, or of '
                         f'{WILDCARD}')


def _checked_parameter(rule: str, node: str) -> str:
    """Return the name of a parameter; InputError if it has no value or is of another node."""
    target, separator, _ = rule.partition(':=')
    block, _, name = target.rpartition(':')
    if not separator:
        raise InputError(f"argument '-p {rule}': without ':='; expected -p NAME:=VALUE")
    if block and not takes_effect(block, node) and block != node.rpartition('/')[2]:
        raise InputError(f"argument '-p {rule}': a parameter of node {block}; "
                         f'expected one of {node}')
    return name
