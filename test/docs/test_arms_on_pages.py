"""Every shipped configuration, page and command states what its arm compensates."""

import re

from documents import PAGES, path_in_checkout, ROOT
from kane_dynamics.cli.examples import EXAMPLES
import pytest

pytest.importorskip('rclpy')

from arm_statements import (  # noqa: E402, I100
    faults, starts_of_page, starts_of_parameters, starts_of_text)

TEXTS = {name: (ROOT / name).read_text(encoding='utf-8')
         for name in ('launch/kane_dynamics.launch.py', 'CONTRIBUTING.md')}
TEXTS['help of the commands'] = '\n'.join(EXAMPLES.values())
CONFIGURATIONS = sorted((ROOT / 'config').glob('*.yaml'))


@pytest.mark.parametrize('path', CONFIGURATIONS, ids=path_in_checkout)
def test_a_shipped_configuration_agrees_with_the_table_of_arms(path):
    start, = starts_of_parameters(path.read_text(), path.name)
    assert 'arm_compensates' in start.parameters
    assert faults(start) == []


@pytest.mark.parametrize('page', PAGES, ids=path_in_checkout)
def test_nodes_that_a_page_starts_agree_with_the_table_of_arms(page):
    assert [fault for start in starts_of_page(page) for fault in faults(start)] == []


@pytest.mark.parametrize('name', TEXTS)
def test_commands_in_other_texts_agree_with_the_table_of_arms(name):
    starts = starts_of_text(TEXTS[name], name)
    assert [fault for start in starts for fault in faults(start)] == []


def test_every_command_that_starts_a_node_is_found():
    """The words `kane_dynamics --ros-args` and the launch file are as many as starts."""
    pages = [path.read_text(encoding='utf-8') for path in PAGES]
    text = '\n'.join([*pages, *TEXTS.values()])
    program = r'(?:(?:dynamics|plant)_node --ros-args|ros2 launch kane_dynamics )'
    lines = re.findall(rf'^[^#\n]*{program}.*$', text, re.MULTILINE)
    commands = [line for line in lines if '`' not in line]
    starts = []
    for page in PAGES:
        starts += starts_of_page(page)
    for name, words in TEXTS.items():
        starts += starts_of_text(words, name)
    blocks = {start.where.split(': ', 1)[1] for start in starts if ': ' in start.where}
    assert len(commands) > 10
    for line in commands:
        words = line.strip().removeprefix('$ ').rstrip('\\').split()
        assert any(command.split()[:len(words) - 2] == words[:len(words) - 2]
                   for command in blocks), line


YAML = """```yaml
# arm.yaml
/**:
  ros__parameters:
    urdf: urdf/ur10e.urdf
    {statement}
```
"""
TWO_LINES = """```console
$ .venv/bin/kane_dynamics --ros-args -p urdf:=urdf/ur10e.urdf \\
    -p arm_compensates:=none
```
"""
LAUNCH = 'ros2 launch kane_dynamics kane_dynamics.launch.py '


@pytest.mark.parametrize(
    ('text', 'words'),
    [(YAML.format(statement='mode: computed_torque'), 'not stated'),
     (YAML.format(statement='arm_compensates: [none]'), 'count twice'),
     (YAML.format(statement='arm_compensates: [friction]'), 'count twice'),
     (YAML.format(statement='arm_compensates: [gravity]'), 'expected gravity, friction'),
     (f'```sh\n{LAUNCH}params_file:=ur10e.yaml arm_compensates:=none\n```\n',
      'count twice'),
     (f'```sh\n{LAUNCH}urdf:=urdf/ur10e.urdf\n```\n', 'not stated'),
     (f'```sh\n{LAUNCH}params_file:=two_link.yaml urdf:=urdf/fr3.urdf\n```\n',
      'count twice'),
     (TWO_LINES, 'count twice'),
     ('```sh\nplant_node --ros-args -p urdf:=urdf/ur10e.urdf\n```\n', 'count twice'),
     (('```sh\nros2 run kane_dynamics kane_dynamics --ros-args -p '
       'urdf:=my_arm.urdf\n```\n'), 'not stated')])
def test_a_page_that_starts_an_arm_with_gravity_twice_is_found(text, words, tmp_path):
    page = tmp_path / 'page.md'
    page.write_text(text)
    contradictions = []
    for start in starts_of_page(page):
        contradictions += faults(start)
    assert len(contradictions) == 1
    assert words in contradictions[0]


def test_an_arm_of_the_reader_and_a_right_statement_are_no_faults(tmp_path):
    page = tmp_path / 'page.md'
    page.write_text(YAML.format(statement='arm_compensates: [gravity, friction]')
                    + f'```sh\n{LAUNCH}params_file:=$PWD/arm.yaml plant:=plant.yaml\n'
                    + f'{LAUNCH}params_file:=/my/arm.yaml\n'
                    + 'kane_dynamics --ros-args -p '
                    'urdf:=arm.urdf -p arm_compensates:=none\n```\n')
    starts = starts_of_page(page)
    assert len(starts) == 5
    assert [fault for start in starts for fault in faults(start)] == []
