"""Checks of a page's ROS commands and files that need no installation."""

import ast
import importlib
from itertools import pairwise
import re
import shlex

from documents import ROOT
from kane_dynamics.ros.monitor_node import monitor_parameters
from kane_dynamics.ros.parameters.parameter_checks import read
from kane_dynamics.ros.parameters.parameter_table import SPECS
from kane_dynamics.ros.plant import plant_parameters as plant_specs
import yaml

TABLES = {'kane_dynamics': {spec.name: spec for spec in SPECS},
          'plant_node': {spec.name: spec for spec in plant_specs.SPECS},
          'torque_guard': {},
          'monitor_node': {spec.name: spec for spec in monitor_parameters.ALL}}
EXECUTABLES = {'kane_dynamics': 'kane_dynamics', 'plant_node': 'plant_node',
               'torque_guard': 'torque_guard', 'monitor_node': 'monitor_node'}
FOREIGN = {'use_sim_time'}  # of every node
ELSEWHERE = {'security', 'controller_manager'}  # verbs and packages that are not ours
SOURCE = ''.join(path.read_text(encoding='utf-8')
                 for path in (ROOT / 'kane_dynamics' / 'ros').rglob('*.py'))


def check_line(line):
    """Raise AssertionError if a shell line names what this package does not have."""
    words = shlex.split(line, comments=True)
    while words and re.fullmatch(r'\w+=\S*', words[0]):
        words = words[1:]
    if not words:
        return
    program = words[0].rsplit('/', 1)[-1]
    if program in EXECUTABLES:
        check_arguments(program, *words[1:])
    elif program == 'make':
        makefile = (ROOT / 'Makefile').read_text(encoding='utf-8')
        assert re.search(rf'^[a-z -]*\b{words[1]}\b[a-z -]*:', makefile,
                         re.MULTILINE), line
    elif program == 'ros2' and not ELSEWHERE & set(words[1:3]):
        CHECKS[' '.join(words[1:3])](*words[3:])


def check_launch(file, *arguments):
    """Raise AssertionError unless the launch file takes these arguments."""
    declared = launch_arguments(file)
    for name, _, value in (argument.partition(':=') for argument in arguments):
        assert name in declared, f'{file} has no argument {name!r}'
        if name in ('params_file', 'plant') and '/' not in value:
            assert (ROOT / 'config' / value).is_file(), value


def launch_arguments(file):
    """Return the names of the arguments that a launch file of ours declares."""
    tree = ast.parse((ROOT / 'launch' / file).read_text(encoding='utf-8'))
    return next(ast.literal_eval(node.value) for node in tree.body
                if isinstance(node, ast.Assign) and node.targets[0].id == 'ARGUMENTS')


def check_launch_file(text):
    """Raise AssertionError if a page's launch file passes an unknown argument."""
    names = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Dict):
            for key in node.keys:
                names.append(ast.literal_eval(key))
    assert names
    assert set(names) <= set(launch_arguments('kane_dynamics.launch.py')), names


def check_arguments(executable, *arguments):
    """Raise AssertionError unless an executable's parameters are right."""
    specs = TABLES[EXECUTABLES[executable]]
    for flag, value in pairwise(arguments):
        if flag in ('-p', '--param'):
            name, _, value_given = value.partition(':=')
            check_parameter(specs, name, yaml.safe_load(value_given))


def check_parameter(specs, name, value):
    """Raise AssertionError or InputError unless the parameter and value are valid."""
    if name not in FOREIGN:
        assert name in specs, f'no parameter {name!r}'
        read(specs[name], value)


def check_set(node, name, value):
    """Raise AssertionError unless a live parameter may be set to that."""
    specs = TABLES[node.rsplit('/', 1)[-1]]
    check_parameter(specs, name, yaml.safe_load(value))
    assert specs[name].live, f'{name} is not live'


def check_topic(name, *_):
    """Raise AssertionError unless a topic is one of ours."""
    assert f"{name.rsplit('/', 1)[-1]}'" in SOURCE, name


def check_call(name, kind, request='{}', *_):
    """Raise AssertionError unless a service or action has that type and these fields."""
    package, folder, cls = kind.split('/')
    interface = getattr(importlib.import_module(f'{package}.{folder}'), cls)
    if package == 'kane_dynamics_interfaces':
        check_topic(name)
    filled(getattr(interface, 'Request', None) or interface.Goal,
           yaml.safe_load(request))


def check_publication(*arguments):
    """Raise AssertionError unless the topic is ours, with that message and fields."""
    name, kind, values = (word for word in arguments if not word.startswith('--'))
    check_topic(name)
    package, folder, cls = kind.split('/')
    filled(getattr(importlib.import_module(f'{package}.{folder}'), cls),
           yaml.safe_load(values))


def filled(kind, values):
    """Return a message of a type with values by field; KeyError for an unknown one."""
    message = kind()
    for name, value in values.items():
        if isinstance(value, dict):
            message.get_fields_and_field_types()[name]
            value = filled(type(getattr(message, name)), value)
        setattr(message, name, value)
    return message


CHECKS = {'launch kane_dynamics': check_launch, 'run kane_dynamics': check_arguments,
          'param set': check_set, 'topic echo': check_topic, 'topic hz': check_topic,
          'topic pub': check_publication,
          'service call': check_call, 'action send_goal': check_call,
          'lifecycle set': lambda node, transition: None}


def check_prose(text):
    """Raise AssertionError if a text speaks of a parameter that neither node has."""
    known = set()
    for table in TABLES.values():
        for name in table:
            known.add(name)
    groups = {name.split('.')[0] for name in known if '.' in name}
    for group, remainder in re.findall(r'`(\w+)\.([\w.]+|\*)', text):
        if group in groups and remainder != '*':
            assert f'{group}.{remainder}' in known, f'no parameter {group}.{remainder}'


def flat(tree, prefix=''):
    """Yield (name, value) of nested parameters, names joined by dots."""
    for name, value in tree.items():
        if isinstance(value, dict):
            yield from flat(value, f'{prefix}{name}.')
        else:
            yield prefix + name, value


def check_yaml(text):
    """Raise AssertionError if a parameter file names a parameter that our nodes lack."""
    for node, content in yaml.safe_load(text).items():
        name = 'kane_dynamics' if node == '/**' else str(node).rsplit('/', 1)[-1]
        if name in TABLES and isinstance(content, dict):
            for parameter, value in flat(content['ros__parameters']):
                check_parameter(TABLES[name], parameter, value)
