"""The C loop of the native torque path: its rules and memory."""

from inspect import signature
from pathlib import Path
import shutil
import subprocess

from kane_dynamics.control_cycle import cycle_results, cycle_rules
from kane_dynamics.control_cycle.loop_rules import LoopRules
from kane_dynamics.native.runtime import message_loop
from kane_dynamics.native.runtime.message_loop import CONSTANTS, SOURCE
import pytest

ROOT = Path(__file__).parents[3]
FEED = ROOT / 'test' / 'helpers' / 'message_loop_feed.c'
FOLDER = SOURCE.path.parent
GCC = ('gcc', '-std=gnu11', '-Wall', '-Wextra', '-Werror', '-I', str(FOLDER))


def test_the_loop_and_the_rules_have_the_same_numbers():
    for structure, record in ((message_loop.PathHead, cycle_rules.PathState),
                              (message_loop.Event, cycle_rules.Event)):
        names = [name for name, _ in structure._fields_]
        common = min(len(names), len(record._fields))
        assert names[:common] == list(record._fields[:common])
    assert CONSTANTS['WAITING'] == cycle_results.WAITING
    for rule in (cycle_rules.answer, LoopRules.aim):
        arguments = [*signature(rule).parameters]
        assert arguments.index('row') - arguments.index('path') == CONSTANTS['ROW_PLACE']


@pytest.mark.skipif(not shutil.which('gcc'), reason='no C compiler')
@pytest.mark.parametrize('sanitizer', ['address,undefined', 'thread'])
def test_a_random_feed_of_messages_and_plans_finds_no_wrong_memory(sanitizer, tmp_path):
    program = tmp_path / 'feed'
    built = subprocess.run(
        [*GCC, '-O1', '-g', '-fno-sanitize-recover=all', f'-fsanitize={sanitizer}', '-o',
         str(program), str(FEED), '-lpthread'],
        capture_output=True, text=True, check=False)
    if 'cannot find -l' in built.stderr or 'cannot find lib' in built.stderr:
        pytest.skip('this compiler has no sanitizers')
    assert built.returncode == 0, built.stderr
    done = subprocess.run([str(program)], capture_output=True, text=True, timeout=300,
                          check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith('answered')
