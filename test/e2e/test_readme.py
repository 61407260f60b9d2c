"""What README and docs show works as it is written."""

import os
from pathlib import Path
import re
import shlex
import subprocess
import sys

import pytest

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / 'README.md').read_text(encoding='utf-8')
TEXTS = README, *(path.read_text(encoding='utf-8') for path in sorted(ROOT.glob('docs/*.md')))
BLOCKS = [block for text in TEXTS for block in re.findall(r'```python\n(.*?)```', text, re.DOTALL)]
COMMANDS = re.findall(r'^    kane-dynamics (.*)$', README, re.MULTILINE)


@pytest.mark.parametrize('block', BLOCKS)
def test_python_blocks_run(block, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'urdf').symlink_to(ROOT / 'urdf')
    exec(compile(block, 'README.md', 'exec'), {})


@pytest.mark.parametrize('command', COMMANDS)
def test_commands_run(command, tmp_path):
    (tmp_path / 'urdf').symlink_to(ROOT / 'urdf')
    done = subprocess.run([sys.executable, '-m', 'kane_dynamics.cli', *shlex.split(command)],
                          cwd=tmp_path, capture_output=True, text=True,
                          env={**os.environ, 'PYTHONPATH': os.pathsep.join(
                              [str(ROOT), os.environ.get('PYTHONPATH', '')])})
    assert done.returncode == 0, done.stderr
    assert done.stdout


def test_there_is_something_to_run():
    assert BLOCKS
    assert COMMANDS


def test_files_and_targets_that_it_names_exist():
    paths = re.findall(r'\]\(([^)#:]+)\)|`((?:config|urdf|kane_dynamics)/[\w./]+)`', README)
    for path in paths:
        assert (ROOT / (path[0] or path[1])).exists(), path
    makefile = (ROOT / 'Makefile').read_text(encoding='utf-8')
    for target in re.findall(r'(?:`|^    )make ([a-z-]+)', README, re.MULTILINE):
        assert re.search(rf'^[a-z -]*\b{target}\b[a-z -]*:', makefile, re.MULTILINE), target


def test_the_interface_table_is_the_nodes():
    pytest.importorskip('rclpy')
    source = ''.join(path.read_text(encoding='utf-8')
                     for path in (ROOT / 'kane_dynamics' / 'ros').glob('*.py'))
    table = README[README.index('| subscribes |'):README.index('`mode` chooses')]
    names = re.findall(r'`([~/\w]+)`', table)
    assert len(names) > 8
    for name in names:
        assert name.removeprefix('~/') in source, name
