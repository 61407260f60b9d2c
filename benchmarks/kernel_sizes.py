"""
Arithmetic and machine code of every kernel of the shipped robots: `make kernel-sizes`.

Both are the same on every machine, without noise. A test compares them with
kernel_sizes.json, which this program writes; the bytes are those for one fixed processor
and for the version of LLVM that they were recorded with.
"""

import json
from pathlib import Path
import sys
from typing import Any
import warnings

from kane_dynamics import load_urdf, ModelError, Robot
from kane_dynamics.native.backends.llvm_scalar import module_text
from kane_dynamics.native.machine_code import llvm
from kane_dynamics.native.runtime.kernel import SYMBOL

FILE = Path(__file__).with_name('kernel_sizes.json')
ROBOTS = Path(__file__).resolve().parents[1] / 'urdf'
COLUMNS = ('multiplications', 'additions', 'divisions', 'functions', 'bytes')


def llvm_version() -> str:
    """Return the version of LLVM in use."""
    return llvm.fingerprint().rpartition('|')[2]


def measured(path: Path) -> dict[str, list[int]]:
    """Return `COLUMNS` of every kernel that a robot has."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        robot = Robot(load_urdf(path))
    sizes = {}
    for name in robot.kernels.names:
        try:
            program = robot.kernels.program(name)
        except ModelError:
            continue  # no forward dynamics with massless joints
        count = program.operation_count()
        sizes[name] = [*(getattr(count, column) for column in COLUMNS[:-1]),
                       llvm.code_size(module_text(program, SYMBOL))]
    return sizes


def robots() -> dict[str, Path]:
    """Return the shipped URDFs by name."""
    return {path.stem: path for path in sorted(ROBOTS.glob('*.urdf'))}


def recorded() -> dict[str, Any]:
    """Return the content of the file."""
    record: dict[str, Any] = json.loads(FILE.read_text(encoding='utf-8'))
    return record


def text(sizes: dict[str, dict[str, list[int]]]) -> str:
    """Return the file's text, one line per kernel, so that a change is one line."""
    lines = ['{', f' "columns": {json.dumps(COLUMNS)},',
             f' "cpu": "{llvm.REFERENCE_CPU}",',
             f' "llvm": "{llvm_version()}",', ' "sizes": {']
    for robot, kernels in sizes.items():
        lines.append(f'  "{robot}": {{')
        lines += [
            f'   "{name}": {json.dumps(row)}{"," if name != list(kernels)[-1] else ""}'
            for name, row in kernels.items()]
        lines.append('  }' + (',' if robot != list(sizes)[-1] else ''))
    return '\n'.join([*lines, ' }', '}', ''])


def main() -> int:
    """Measure every shipped robot and write the file."""
    FILE.write_text(text({name: measured(path) for name, path in robots().items()}),
                    encoding='utf-8')
    print(f'written to {FILE}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
