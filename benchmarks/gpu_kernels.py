"""
Registers and spilled bytes of GPU kernels of the FR3, by NVIDIA's assembler.

Stack and spills are those of a kernel and of its subroutines together.

A test compares them with gpu_kernels.json, which `--record` writes; they hold for the
versions of LLVM and of the assembler that they were recorded with. The assembler,
`ptxas`, comes with the package nvidia-cuda-nvcc-cu12 or is on the PATH.
"""

import argparse
from collections.abc import Sequence
from functools import cache
from importlib.util import find_spec
import json
from pathlib import Path
import re
import shutil
import subprocess
import sys
import tempfile
from typing import Any

from kane_dynamics import load_urdf, Robot
from kane_dynamics.gpu import function, rollout
from kane_dynamics.native.machine_code import llvm

FILE = Path(__file__).with_name('gpu_kernels.json')
URDF = Path(__file__).resolve().parents[1] / 'urdf' / 'fr3.urdf'
TARGETS = ('sm_80', 'sm_90')
DTYPES = ('float64', 'float32')
QUANTITIES = ('inverse_dynamics', 'forward_dynamics', 'mass_matrix',
              'inverse_dynamics_derivatives', 'forward_dynamics_derivatives')
COLUMNS = ('registers', 'stack', 'spill_stores', 'spill_loads')


@cache
def assembler() -> str | None:
    """Return the path of ptxas, or None if it is not installed."""
    spec = find_spec('nvidia')
    for folder in spec.submodule_search_locations or () if spec else ():
        for path in sorted(Path(folder).glob('*/bin/ptxas')):
            return str(path)
    return shutil.which('ptxas')


def versions() -> dict[str, str]:
    """Return the versions of LLVM and of the assembler."""
    done = subprocess.run([str(assembler()), '--version'],
                          check=True, capture_output=True, text=True, timeout=60)
    match = re.search(r'V([\d.]+)', done.stdout)
    return {'llvm': llvm.fingerprint().rpartition('|')[2],
            'ptxas': match[1] if match else ''}


def assembled(ptx: str, target: str) -> list[int]:
    """Return `COLUMNS` of a kernel, assembled for a device; RuntimeError if refused."""
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder, 'kernel.ptx')
        source.write_text(ptx, encoding='utf-8')
        done = subprocess.run([str(assembler()), '-v', f'-arch={target}', str(source),
                               '-o', str(Path(folder, 'kernel.cubin'))],
                              capture_output=True, text=True, timeout=300)
    if done.returncode:
        raise RuntimeError(
            f'ptxas: {done.stderr}; expected that it assembles the kernel')
    frames = re.findall(
        r'properties for (\w+)\s+(\d+) bytes stack frame, (\d+) bytes spill '
        r'stores, (\d+) bytes spill loads', done.stderr)
    registers = re.search(r'Used (\d+) registers', done.stderr)
    if registers is None or 'kernel' not in [frame[0] for frame in frames]:
        raise RuntimeError(
            f'ptxas: {done.stderr}; expected the properties of the kernel')
    return [int(registers[1]),
            *(sum(int(frame[k]) for frame in frames) for k in (1, 2, 3))]


def robot() -> Robot:
    """Return the FR3, seven axes."""
    return Robot(load_urdf(URDF, tip='fr3_link7'))


def texts() -> dict[str, str]:
    """Return the PTX of every kernel by name."""
    arm = robot()
    text_by_target = {}
    for dtype in DTYPES:
        for name in QUANTITIES:
            text_by_target[f'{name} {dtype}'] = function(arm, name, dtype=dtype).ptx
        text_by_target[f'rollout {dtype}'] = rollout(arm, dtype=dtype).ptx
    return text_by_target


def measured(targets: Sequence[str] = TARGETS) -> dict[str, list[int]]:
    """Return `COLUMNS` of every kernel for some targets."""
    return {f'{name} {target}': assembled(ptx, target)
            for name, ptx in texts().items() for target in targets}


def recorded() -> dict[str, Any]:
    """Return the content of the file."""
    record: dict[str, Any] = json.loads(FILE.read_text(encoding='utf-8'))
    return record


def main() -> int:
    """Print the table; with `--record`, write the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--record', action='store_true', help='write gpu_kernels.json')
    arguments = parser.parse_args()
    if assembler() is None:
        print('NOT RUN: ptxas is not installed')
        return 1
    rows = measured()
    print(f'{"kernel":50}{"".join(f"{column:>14}" for column in COLUMNS)}')
    for name, row in rows.items():
        print(f'{name:50}{"".join(f"{x:14}" for x in row)}')
    if arguments.record:
        lines = ',\n'.join(f'  {json.dumps(name)}: {json.dumps(row)}'
                           for name, row in rows.items())
        FILE.write_text(f'{{\n "columns": {json.dumps(COLUMNS)},\n "versions": '
                        f'{json.dumps(versions())},\n "kernels": {{\n{lines}\n }}\n}}\n',
                        encoding='utf-8')
        print(f'written to {FILE}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
