"""The C loop of the native torque path: its shipped text, structures and memory."""

from inspect import signature
from pathlib import Path
import shutil
import subprocess

from kane_dynamics.control_cycle import cycle_results, cycle_rules
from kane_dynamics.control_cycle.loop_rules import LoopRules
from kane_dynamics.native.runtime import message_loop
from kane_dynamics.native.runtime.message_loop import CONSTANTS, SOURCE, STRUCTURES
import pytest

ROOT = Path(__file__).parents[3]
FEED = ROOT / 'test' / 'helpers' / 'message_loop_feed.c'
GCC = ('gcc', '-std=gnu11', '-Wall', '-Wextra', '-Werror', '-I', str(SOURCE.parent))


@pytest.mark.skipif(not shutil.which('clang-15') or not shutil.which('make'),
                    reason='no clang 15')
def test_the_llvm_text_is_what_clang_makes_of_the_source(tmp_path):
    made = tmp_path / 'message_loop.ll'
    subprocess.run(['make', '-s', 'message-loop', f'LOOP_TEXT={made}'], cwd=ROOT,
                   check=True)
    assert made.read_text() == SOURCE.with_suffix('.ll').read_text()


@pytest.mark.skipif(not shutil.which('gcc'), reason='no C compiler')
def test_the_structures_of_python_are_those_of_the_compiler(tmp_path):
    places = []
    lines = ['#include <stdio.h>', f'#include "{SOURCE.name}"', 'int main(void) {']
    for name, structure in STRUCTURES.items():
        places.append(('sizeof', name, message_loop.ctypes.sizeof(structure)))
        lines.append(f'printf("%zu\\n", sizeof({name}));')
        for field, _ in structure._fields_:
            places.append((name, field, getattr(structure, field).offset))
            lines.append(f'printf("%zu\\n", __builtin_offsetof({name}, {field}));')
    for name, value in CONSTANTS.items():
        places.append(('constant', name, value))
        lines.append(f'printf("%d\\n", (int){name});')
    program = tmp_path / 'places'
    source = tmp_path / 'places.c'
    source.write_text('\n'.join([*lines, 'return 0; }']))
    subprocess.run([*GCC, '-o', str(program), str(source)], check=True)
    done = subprocess.run([str(program)], capture_output=True, text=True, check=True)
    of_compiler = map(int, done.stdout.split())
    for (structure, field, of_python), expected in zip(places, of_compiler, strict=True):
        assert of_python == expected, (structure, field)


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
