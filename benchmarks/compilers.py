"""The compilers of peers: gcc, and clang from the package index."""

from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
import platform
import re
import shutil
import subprocess
import sys


@dataclass(frozen=True)
class Compiler:
    """Name with version, and the commands for C and for C++."""

    name: str
    c: tuple[str, ...]
    cpp: tuple[str, ...]


@cache
def compilers() -> tuple[Compiler, ...]:
    """Return gcc, if it is installed, and the clang of the package `ziglang`."""
    found = []
    if shutil.which('gcc') and shutil.which('g++'):
        found.append(Compiler(f'gcc {_output("gcc", "-dumpfullversion")}', ('gcc',),
                              ('g++',)))
    if find_spec('ziglang'):
        zig = (sys.executable, '-m', 'ziglang')
        # 'clang version 22.1.8', then further lines.
        version = _output(*zig, 'cc', '--version').split()[2]
        found.append(Compiler(f'clang {version}', (*zig, 'cc'), (*zig, 'c++')))
    return tuple(found)


@cache
def target(compiler: Compiler) -> str:
    """Return the processor for which a compiler's -march=native compiles."""
    command = (*compiler.c, '-march=native', '-E', '-v', '-x', 'c', '/dev/null')
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    # Of the compiler proper's command, which also names temporary files.
    named = re.findall(r'-(?:target-cpu |march=)(\S+)', done.stderr)
    return f'{platform.machine()} {" ".join(dict.fromkeys(named))}'


def _output(*command: str) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return done.stdout.strip()
