"""The command lines of the nodes: nothing that is given is ignored."""

import os
import re
import subprocess
import sys

from kane_dynamics.errors import InputError
from kane_dynamics.ros.common.parameter_files import parameter_blocks, takes_effect
from kane_dynamics.ros.common.program_arguments import (check_arguments, INVALID,
                                                        RosProgram, run_program,
                                                        split_arguments)
import pytest

NODES = {'kane_dynamics': 'kane_dynamics.ros.dynamics_node.main',
         'torque_guard': 'kane_dynamics.ros.guard.main',
         'plant_node': 'kane_dynamics.ros.plant.main'}
PROGRAM = RosProgram('kane_dynamics', 'kane_dynamics', 'Publish torques.',
                     ('--ros-args -p urdf:=arm.urdf',))


def check(*arguments):
    check_arguments(PROGRAM, *split_arguments(arguments))


def refusal(*arguments):
    with pytest.raises(InputError) as raised:
        check(*arguments)
    return str(raised.value)


def run(module, *arguments, code=None, **options):
    """Run a node; return its exit code and output."""
    command = ['-m', module] if code is None else ['-c', code]
    environment = {**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)}
    done = subprocess.run([sys.executable, *command, *arguments],
                          env=environment, text=True,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False,
                          timeout=60, **options)
    return done.returncode, done.stdout


@pytest.mark.parametrize(('arguments', 'intended'), [
    (('-p', 'urdf:=a.urdf'), '-p urdf:=a.urdf'), (('urdf:=a.urdf',), '-p urdf:=a.urdf'),
    (('a.urdf',), '-p urdf:=a.urdf'), (('a.urdf.xacro',), '-p urdf:=a.urdf.xacro'),
    (('arm.yaml',), '--params-file arm.yaml'),
    (('--urdf', 'a.urdf'), '-p NAME:=VALUE ...'),
    (('--ros-args', '-p', 'mode:=x', '--', 'a.urdf'), '-p urdf:=a.urdf')])
def test_arguments_outside_of_ros_args_are_refused_with_what_was_meant(
        arguments, intended):
    words = refusal(*arguments)
    assert ('outside of --ros-args; expected kane_dynamics --ros-args '
            + intended in words)


def test_positional_arguments_after_ros_args_are_refused():
    assert "argument 'a.urdf': after --ros-args; expected" in refusal(
        '--ros-args', 'a.urdf')
    assert "without ':='; expected -p NAME:=VALUE" in refusal(
        '--ros-args', '-p', 'urdf=a')


def test_parameters_of_another_node_are_refused():
    words = refusal('--ros-args', '-p', 'other_node:urdf:=a.urdf')
    assert 'a parameter of node other_node; expected one of /kane_dynamics' in words
    check('--ros-args', '-p', 'kane_dynamics:urdf:=a.urdf', '-p', 'mode:=x', '-r',
          'a:=b')
    check('--ros-args', '-r', '__node:=left', '-p', 'left:urdf:=a.urdf', '--log-level',
          'info', '--log-file-name', 'left')


def test_a_parameter_given_twice_is_refused(tmp_path):
    words = refusal('--ros-args', '-p', 'arm_compensates:=none', '-p',
                    'kane_dynamics:arm_compensates:=[gravity]')
    assert "parameter 'arm_compensates' given twice; expected it once" in words
    path = tmp_path / 'arm.yaml'
    path.write_text('/**: {ros__parameters: {mode: x, mode: y}}\n')
    assert 'given more than once: mode' in refusal('--ros-args', '--params-file',
                                                   str(path))


def test_numbers_of_a_parameter_file_are_those_that_ros_reads(tmp_path):
    path = tmp_path / 'arm.yaml'
    path.write_text('/**: {ros__parameters: {gains: {kp: 1e2, kd: [2.5e1, -.5E-1]}}}\n')
    parameters = parameter_blocks(path)['/**']
    assert parameters == {'gains.kp': 100.0, 'gains.kd': [25.0, -0.05]}


@pytest.mark.parametrize(('block', 'remappings', 'good'), [
    ('kane_dynamics', (), True), ('/**', (), True), ('/*', (), True),
    ('other_node', (), False),
    ('left/kane_dynamics', (), False), ('left/kane_dynamics', ('__ns:=/left',), True),
    ('kane_dynamics', ('__ns:=/left',), False),
    ('/**/kane_dynamics', ('__ns:=/a/b',), True),
    ('arm', ('__node:=arm',), True), ('kane_dynamics', ('__node:=arm',), False),
    # A rule may name the node to which it applies; the first rule counts.
    ('kane_dynamics', ('other:__node:=arm',), True),
    ('arm', ('other:__node:=arm',), False),
    ('arm', ('kane_dynamics:__node:=arm',), True),
    ('arm', ('__node:=arm', '__node:=b'), True),
    ('kane_dynamics', ('other:__ns:=/left',), True),
    ('left/arm', ('__node:=arm', 'arm:__ns:=/left'), True)])
def test_a_parameter_file_needs_parameters_of_the_node(
        tmp_path, block, remappings, good):
    path = tmp_path / 'arm.yaml'
    path.write_text(f'{block}: {{ros__parameters: {{mode: x}}}}\n'
                    'other: {ros__parameters: {mode: x}}\n')
    arguments = ['--ros-args', '--params-file', str(path)]
    arguments += [argument for rule in remappings for argument in ('-r', rule)]
    if good:
        check(*arguments)
    else:
        assert 'the node of kane_dynamics, or of /**' in refusal(*arguments)


@pytest.mark.parametrize(('text', 'words'), [
    (None, 'no such file or directory; expected a readable file'),
    ('{', 'expected YAML'),
    ('kane_dynamics: {mode: x}', 'no ros__parameters; expected'),
    ('', 'no ros__parameters')])
def test_an_unusable_parameter_file_is_named_with_the_reason(tmp_path, text, words):
    path = tmp_path / 'arm.yaml'
    if text is not None:
        path.write_text(text)
    reason = refusal('--ros-args', '--params-file', str(path))
    assert reason.startswith(f"parameter file '{path}': ")
    assert words in reason


def test_blocks_have_full_names_and_dotted_parameters(tmp_path):
    path = tmp_path / 'arm.yaml'
    path.write_text(
        'left: {kane_dynamics: {ros__parameters: {gains: {kp: 1.0}, mode: x}}}')
    assert parameter_blocks(path) == {
        '/left/kane_dynamics': {'gains.kp': 1.0, 'mode': 'x'}}
    assert not takes_effect('/left/*', '/left')
    assert takes_effect('/left/**', '/left/arm/node')


@pytest.mark.parametrize('name', NODES)
def test_help_has_usage_and_examples_that_are_valid(name):
    code, text = run(NODES[name], '--help')
    assert code == 0
    assert text.startswith(f'usage: {name} --ros-args')
    examples = re.findall(rf'^  {name} (.*)$', text, re.MULTILINE)
    assert examples
    if name == 'kane_dynamics':  # without one of both it does not configure
        assert all('arm_compensates' in x or 'params-file' in x for x in examples)
    for example in examples:
        arguments = [part for part in example.split() if not part.endswith('.yaml')]
        check(*(part for part in arguments if part != '--params-file'))


@pytest.mark.parametrize('rules', [
    ('other:__node:=arm',), ('kane_dynamics:__node:=arm',), ('__node:=arm', '__node:=b'),
    ('__node:=arm', 'arm:__ns:=/left'), ('__node:=arm', 'kane_dynamics:__ns:=/left'),
    ('__name:=arm', 'other:__ns:=/a', '__ns:=/b')])
def test_the_name_of_the_node_is_that_which_rcl_gives_it(rules):
    rclpy = pytest.importorskip('rclpy')
    from rclpy.context import Context
    context = Context()
    arguments = ['--ros-args', *(word for rule in rules for word in ('-r', rule))]
    rclpy.init(args=arguments, context=context)
    try:
        node = rclpy.create_node('kane_dynamics', context=context)
        name = node.get_fully_qualified_name()
        node.destroy_node()
    finally:
        rclpy.try_shutdown(context=context)
    check(*arguments, '-p', f'{name}:mode:=x')
    with pytest.raises(InputError, match=f'expected one of {name}'):
        check(*arguments, '-p', 'nowhere:mode:=x')


@pytest.mark.parametrize(('name', 'parameter', 'value'), [
    ('kane_dynamics', 'state_timeout', 'fast'), ('plant_node', 'rate', '-1.0'),
    ('torque_guard', 'node', '3')])
def test_an_invalid_parameter_ends_with_the_code_that_is_not_started_again(
        name, parameter, value):
    code, text = run(NODES[name], '--ros-args', '-p', f'{parameter}:={value}')
    assert code == INVALID
    reason, = text.splitlines()
    assert reason.startswith(f'{name}: ') and f"'{parameter}'" in reason


@pytest.mark.parametrize('name', NODES)
def test_a_node_with_an_ignored_argument_ends_with_one_line(name):
    code, text = run(NODES[name], 'arm.urdf')
    assert code == 2
    assert text.count('\n') == 1
    assert text.startswith(
        f"{name}: argument 'arm.urdf': outside of --ros-args; expected ")


def test_arguments_that_rclpy_refuses_end_with_the_reason():
    code, text = run(NODES['kane_dynamics'], '--ros-args', '-r', '__node:=a/b')
    assert code == 2
    assert 'Traceback' not in text
    assert ("kane_dynamics: arguments: failed to initialize rcl: Couldn't parse remap"
            in text)


def test_without_rclpy_the_reason_is_one_line():
    code, text = run('', code=f"""
import sys
sys.modules['rclpy'] = None
from {NODES['kane_dynamics']} import main
sys.exit(main(['kane_dynamics', '--ros-args']))""")
    assert code == 2
    assert text == ("kane_dynamics: 'rclpy' is not installed; expected ROS 2 with this "
                    'package, from a sourced workspace or pip install '
                    "'kane_dynamics[ros]'\n")


def test_closed_standard_streams_are_no_sockets_of_the_node(tmp_path):
    code = f"""
import os, sys
sys.path[:0] = {[str(path) for path in sys.path]!r}
from kane_dynamics.ros.common.parameter_files import parameter_blocks
from kane_dynamics.ros.common.program_arguments import RosProgram, run_program
def run(arguments):
    with open({str(tmp_path / 'result')!r}, 'w') as file:
        file.write(' '.join(os.readlink(f'/proc/self/fd/{{k}}') for k in range(3)))
    return 0
sys.exit(run_program(RosProgram('a', 'b', '', ()), ['a'], run))"""
    script = f'exec {sys.executable} - 0<&- 1>&- 2>&-'
    program = tmp_path / 'program.py'
    program.write_text(code)
    subprocess.run(['sh', '-c', script.replace(' - ', f' {program} ')],
                   check=True, timeout=60)
    assert (tmp_path / 'result').read_text() == ' '.join([os.devnull] * 3)


def test_a_program_returns_the_exit_code_of_its_node(capsys):
    assert run_program(PROGRAM, ['kane_dynamics'], lambda arguments: 5) == 5
    assert capsys.readouterr().out == ''
