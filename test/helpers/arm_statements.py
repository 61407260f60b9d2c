"""
What pages, parameter files and commands state of the arms that they start.

A start is a dynamics node or a simulated arm with its URDF and its statement
arm_compensates, merged from parameter files and arguments as ROS 2 merges them.
"""

from itertools import pairwise
from pathlib import Path
import re
import shlex
from typing import NamedTuple

from documents import blocks, ROOT
from kane_dynamics.analysis.known_arms import arms_named, contradiction
from kane_dynamics.control.terms import stated_terms
from kane_dynamics.ros.plant.plant_parameters import SPECS as PLANT_SPECS
from ros_lines import flat
import yaml

DEFAULTS = {'plant_node': {'arm_compensates': next(
    spec.default for spec in PLANT_SPECS if spec.name == 'arm_compensates')}}
NODES = {'kane_dynamics', 'plant_node'}


class Start(NamedTuple):
    """A node that a line or a file starts."""

    where: str
    executable: str
    parameters: dict
    complete: bool  # whether every parameter file is known


def faults(start):
    """Return what is wrong with a start: nothing stated, or a contradiction."""
    parameters = DEFAULTS.get(start.executable, {}) | start.parameters
    if 'arm_compensates' not in parameters:
        return [
            f'{start.where}: arm_compensates is not stated'] if start.complete else []
    stated = stated_terms(parameters['arm_compensates'], start.where)
    rows = arms_named(robot_name(parameters.get('urdf', '')))
    wrong = contradiction(rows, stated)
    return [f'{start.where}: {wrong}'] if wrong else []


def robot_name(urdf):
    """Return the name of the robot in a URDF; the file's name if it is a reader's."""
    path = ROOT / urdf.removeprefix('package://kane_dynamics/')
    if path.is_file():
        return re.search(r'<robot[^>]*\bname="([^"]*)"', path.read_text())[1]
    return Path(urdf).stem


def starts_of_page(page):
    """Return the starts of a page: its parameter files, and its commands."""
    files = {block.file: block.text for block in blocks(page) if block.file}
    starts = []
    for block in blocks(page):
        if block.language == 'yaml':
            starts += starts_of_parameters(block.text, f'{page.name}, line {block.line}')
        if block.language in ('sh', 'console'):
            starts += starts_of_text(block.text, page.name, files)
    return starts


def starts_of_text(text, where, files=None):
    """Return the starts of the commands in a text."""
    starts = []
    for line in re.sub(r'\\+\n\s*', ' ', text).splitlines():
        if re.search(r'kane_dynamics --ros-args|plant_node|kane_dynamics\.launch\.py',
                     line):
            starts += starts_of_line(line.strip().removeprefix('$ '), where, files or {})
    return starts


def starts_of_line(line, where, files):
    """Return the starts of one command."""
    words = list(shlex.split(line, comments=True))
    where = f'{where}: {line}'
    names = [word.rsplit('/', 1)[-1] for word in words]
    if 'kane_dynamics.launch.py' in names and 'launch' in names:
        return launched(words[names.index('kane_dynamics.launch.py') + 1:], where, files)
    # The last one, because `ros2 run` has the name of the package before it.
    executable = next((name for name in reversed(names) if name in NODES), None)
    if executable is None or '--ros-args' not in words:
        return []
    parameters = {}
    complete = True
    for flag, value in pairwise(words):
        if flag == '--params-file':
            content, known = of_file(value, files)
            parameters = parameters | content
            complete = complete and known
        elif flag in ('-p', '--param'):
            name, _, text = value.partition(':=')
            parameters[name] = yaml.safe_load(text)
    return [Start(where, executable, parameters, complete)]


def launched(words, where, files):
    """Return the starts of the launch file with some arguments."""
    arguments = dict(word.split(':=', 1) for word in words if ':=' in word)
    shared = {}
    for name in ('urdf', 'arm_compensates'):
        if name in arguments:
            shared[name] = arguments[name]
    starts = []
    for argument, executable in (
            ('params_file', 'kane_dynamics'), ('plant', 'plant_node')):
        if argument in arguments or executable == 'kane_dynamics':
            content, known = of_file(arguments[argument],
                                     files) if argument in arguments else ({}, True)
            starts.append(Start(where, executable, content | shared, known))
    return starts


def of_file(name, files):
    """Return a file's parameters and whether it is known: shipped, or on the page."""
    base = name.rsplit('/', 1)[-1]
    if base in files:
        return parameters_of(files[base]), True
    shipped = ROOT / 'config' / base
    if shipped.is_file():
        return parameters_of(shipped.read_text()), True
    return {}, False


def parameters_of(text):
    """Return the parameters of the last node in a parameter file."""
    return [parameters for _, parameters in _nodes(text)][-1]


def _nodes(text):
    """Return the names of nodes and their flat parameters."""
    data = yaml.safe_load(text)
    if not isinstance(data, dict):
        return []
    return [(str(name), dict(flat(content['ros__parameters'])))
            for name, content in data.items() if isinstance(content, dict)
            and isinstance(content.get('ros__parameters'), dict)]


def starts_of_parameters(text, where):
    """Return the starts of a parameter file: the nodes whose parameters name a URDF."""
    starts = []
    for name, parameters in _nodes(text):
        plant = (name.rsplit('/', 1)[-1] == 'plant_node'
                 or 'hold_until_command' in parameters)
        if 'urdf' in parameters:
            executable = 'plant_node' if plant else 'kane_dynamics'
            starts.append(Start(f'{where}, {name}', executable, parameters, True))
    return starts
