"""C sources of the package: their LLVM texts, and the structures of Python."""

import ctypes
from pathlib import Path
import shutil
import subprocess

from kane_dynamics.native.python_call import entry
from kane_dynamics.native.runtime import loops, message_loop
import pytest

ROOT = Path(__file__).parents[3]
SOURCES = {module.SOURCE.path.stem: module.SOURCE
           for module in (entry, loops, message_loop)}


@pytest.mark.skipif(not shutil.which('clang-15') or not shutil.which('make'),
                    reason='no clang 15')
@pytest.mark.parametrize('name', SOURCES)
def test_the_llvm_text_is_what_clang_makes_of_the_source(name, tmp_path):
    path = SOURCES[name].path
    subprocess.run(['make', '-s', 'llvm-texts', f'LLVM_TEXTS={tmp_path}'], cwd=ROOT,
                   check=True)
    shipped = path.with_suffix('.ll')
    assert (tmp_path / shipped.relative_to(ROOT)).read_text() == shipped.read_text()


def test_an_installation_compiles_no_c_source():
    """Who has no clang installs the texts that the package has."""
    planned = subprocess.run(['make', '-n', 'install'], cwd=ROOT, check=True, text=True,
                             capture_output=True).stdout
    assert 'clang' not in planned


@pytest.mark.skipif(not shutil.which('gcc'), reason='no C compiler')
@pytest.mark.parametrize('name', SOURCES)
def test_the_structures_of_python_are_those_of_the_compiler(name, tmp_path):
    source = SOURCES[name]
    places = []
    lines = [f'#include "{source.path}"', '#include <stdio.h>', 'int main(void) {']
    for structure_name, structure in source.structures.items():
        places.append(('sizeof', structure_name, ctypes.sizeof(structure)))
        lines.append(f'printf("%zu\\n", sizeof({structure_name}));')
        for field, _ in structure._fields_:
            places.append((structure_name, field, getattr(structure, field).offset))
            place = f'__builtin_offsetof({structure_name}, {field})'
            lines.append(f'printf("%zu\\n", {place});')
    for constant, value in source.constants.items():
        places.append(('constant', constant, value))
        lines.append(f'printf("%d\\n", (int){constant});')
    program = tmp_path / 'places'
    text = tmp_path / 'places.c'
    text.write_text('\n'.join([*lines, 'return 0; }']))
    subprocess.run(['gcc', '-std=gnu11', '-Wall', '-Wextra', '-Werror', '-o',
                    str(program), str(text)], check=True)
    done = subprocess.run([str(program)], capture_output=True, text=True, check=True)
    of_compiler = map(int, done.stdout.split())
    for (structure, field, of_python), expected in zip(places, of_compiler, strict=True):
        assert of_python == expected, (structure, field)
