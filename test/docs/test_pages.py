"""Blocks of README and docs work as written, and names in them exist."""

import pkgutil
import re

from documents import (blocks, compare, PAGES, path_in_checkout, ROOT, starts_nodes,
                       work_through)
from kane_dynamics.errors import InputError
import pytest
import yaml

README = ROOT / 'README.md'
LANGUAGES = {'c', 'python', 'console', 'sh', 'text', 'yaml', 'xml'}
OPTIONAL = ('torch', 'jax')  # without which the pages that import them are left out
pages = pytest.mark.parametrize('page', PAGES, ids=path_in_checkout)


@pytest.mark.timeout(300)  # a page may start a dozen processes
@pytest.mark.parametrize('page', [page for page in PAGES if not starts_nodes(page)],
                         ids=path_in_checkout)
def test_code_on_a_page_prints_the_output_that_the_page_shows(page, tmp_path):
    for library in OPTIONAL:
        if re.search(rf'^import {library}$', page.read_text(encoding='utf-8'),
                     re.MULTILINE):
            pytest.importorskip(library)
    work_through(page, tmp_path)


@pages
def test_every_block_is_run_or_says_why_not(page):
    for block in blocks(page):
        assert block.language in LANGUAGES, block.text
        assert bool(block.reason) == (block.language == 'sh'), block.text
        # A command compiles the file.
        assert block.file or block.language != 'c', block.text
    assert not re.search(r'^    (?:\$ |kane-dynamics |make |ros2 )', page.read_text(),
                         re.MULTILINE), 'a command outside of a block'


@pages
def test_ros_commands_and_parameters_exist(page):
    pytest.importorskip('rclpy')
    from ros_lines import check_launch_file, check_line, check_prose, check_yaml
    check_prose(page.read_text(encoding='utf-8'))
    for block in blocks(page):
        if block.language in ('sh', 'console'):
            for line in block.text.replace('\\\n', ' ').splitlines():
                if block.language == 'sh' or line.startswith('$ '):
                    check_line(line.removeprefix('$ '))
        if block.file and block.file.endswith('.launch.py'):
            check_launch_file(block.text)
        if block.language == 'yaml':
            yaml.safe_load(block.text)
            check_yaml(block.text)


@pytest.mark.parametrize('line', [
    'ros2 launch kane_dynamics kane_dynamics.launch.py configuration:=ur10e.yaml',
    'ros2 launch kane_dynamics kane_dynamics.launch.py params_file:=ur10f.yaml',
    'ros2 param set /kane_dynamics gains.kq 1.0',
    'ros2 param set /kane_dynamics gains.kp -1.0',
    'ros2 param set /kane_dynamics urdf a.urdf', 'kane_dynamics --ros-args -p mod:=a',
    'ros2 topic echo /kane_dynamics/joint_torque', 'ros2 run kane_dynamics dynamic_node',
    'ros2 service call /x/set_payload kane_dynamics_interfaces/srv/SetPayload "{m: 1}"',
    'make document'])
def test_a_line_that_is_wrong_is_found(line):
    pytest.importorskip('rclpy')
    from ros_lines import check_line
    with pytest.raises((AssertionError, AttributeError, InputError, KeyError)):
        check_line(line)


def test_wrong_words_and_numbers_are_found(tmp_path):
    page = tmp_path / 'page.md'
    for text in ('```python\nprint(1.5)\n```\n\n```text\n1.4\n```\n',
                 '```console\n$ echo 1.5 m\n1.4 m\n```\n', '```console\n$ false\n```\n',
                 '```python\n1 / 0\n```\n'):
        page.write_text(text)
        (tmp_path / str(len(text))).mkdir()
        with pytest.raises((AssertionError, ZeroDivisionError)):
            work_through(page, tmp_path / str(len(text)))
    compare('a ... 2\nb', 'a 1\nx 2\n\nb\n', 'what is left out')


def test_there_is_something_to_run():
    languages = []
    for page in PAGES:
        for block in blocks(page):
            languages.append(block.language)
    assert languages.count('python') > 5
    assert languages.count('console') > 5


def test_readme_names_files_that_exist():
    paths = re.findall(r'\]\(([^)#:]+)\)|`((?:config|urdf|kane_dynamics)/[\w./]+)`',
                       README.read_text(encoding='utf-8'))
    for path in paths:
        assert (ROOT / (path[0] or path[1])).exists(), path


def test_the_interface_table_is_the_nodes():
    pytest.importorskip('rclpy')
    source = ''.join(path.read_text(encoding='utf-8')
                     for path in (ROOT / 'kane_dynamics' / 'ros').rglob('*.py'))
    text = (ROOT / 'docs' / 'node.md').read_text(encoding='utf-8')
    table = text[text.index('| subscribes |'):text.index('selects the control law')]
    names = re.findall(r'`([~/\w]+)`', table)
    assert len(names) > 8
    for name in names:
        assert name.removeprefix('~/') in source, name


def test_theory_names_functions_and_tests_that_exist():
    text = (ROOT / 'docs' / 'theory.md').read_text(encoding='utf-8')
    functions = re.findall(r'\{py:\w+\}`~?([\w.]+)`', text)
    assert len(functions) > 30
    for name in functions:
        assert pkgutil.resolve_name(name) is not None
    tests = re.findall(r'`(test/[\w/]+\.py)::(\w+)`', text)
    assert len(tests) > 20
    for path, name in tests:
        assert f'def {name}(' in (ROOT / path).read_text(encoding='utf-8'), (path, name)
