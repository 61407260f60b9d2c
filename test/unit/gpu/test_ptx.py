"""PTX of kernels: accepted by NVIDIA's assembler, with registers on record."""

from pathlib import Path
import re

from benchmarks import gpu_kernels
from kane_dynamics import gpu
from kane_dynamics.native.backends.gpu_kernel import kernel_text
from kane_dynamics.native.backends.llvm_math import FLOAT
from kane_dynamics.native.machine_code import llvm
from kinds_of_mechanism import case, KINDS
import pytest

needs_ptxas = pytest.mark.skipif(gpu_kernels.assembler() is None, reason=(
    'ptxas is not installed: pip install nvidia-cuda-nvcc-cu12'))


@needs_ptxas
@pytest.mark.parametrize('target', [
    'sm_90', pytest.param('sm_80', marks=pytest.mark.slow)])
def test_registers_and_spills_are_those_on_record(target):
    recorded = gpu_kernels.recorded()
    sizes = gpu_kernels.measured([target])
    assert recorded['columns'] == list(gpu_kernels.COLUMNS)
    rows = {name: row for name, row in recorded['kernels'].items()
            if name.endswith(target)}
    assert rows.keys() == sizes.keys()
    # Other versions allocate otherwise.
    if recorded['versions'] == gpu_kernels.versions():
        assert sizes == rows, 'if that is meant, run benchmarks/gpu_kernels.py --record'


def test_the_page_shows_what_is_on_record():
    text = (Path(__file__).parents[3] / 'docs' / 'how_to' / 'gpu.md').read_text(
        encoding='utf-8')
    shown = re.findall(r'^\| ([\w -]+) \| (\d+) / (\d+) \| (\d+) / (\d+) \|$', text,
                       re.MULTILINE)
    rows = gpu_kernels.recorded()['kernels']
    expected = []
    for name in (*gpu_kernels.QUANTITIES, 'rollout'):
        for dtype in gpu_kernels.DTYPES:
            registers, _, spilled, _ = rows[f'{name} {dtype} sm_90']
            expected += [registers, spilled]
    assert [int(x) for row in shown for x in row[1:]] == expected


def test_inverse_and_forward_dynamics_on_record_spill_nothing():
    rows = gpu_kernels.recorded()['kernels']
    for name, (registers, *memory) in rows.items():
        if name.split()[0] in ('inverse_dynamics', 'forward_dynamics', 'mass_matrix'):
            assert memory == [0, 0, 0], name
            assert registers <= 128, name  # of 65536: four blocks on a multiprocessor


@needs_ptxas
@pytest.mark.parametrize('kind', KINDS)
def test_kernels_of_every_kind_of_mechanism_are_assembled(kind):
    robot = case(kind).robot
    for text in (gpu.function(robot, 'forward_dynamics', parameters='gravity').ptx,
                 gpu.rollout(robot, dtype='float32').ptx):
        assert gpu_kernels.assembled(text, 'sm_80')[0] <= 255


def test_text_is_ptx_that_calls_no_library():
    for kind in KINDS:
        for dtype in ('float64', 'float32'):
            text = gpu.rollout(case(kind).robot, dtype=dtype).ptx
            assert '.target sm_75' in text and '.entry kernel(' in text
            assert '.extern' not in text
            # Exact quotients, no flushing.
            assert 'approx' not in text and '.ftz' not in text
            assert ('.b64' if dtype == 'float64' else 'fma.rn.f32') in text


def test_text_does_not_depend_on_what_was_compiled_before():
    text = kernel_text(case('tree').robot.kernels.program('mass_matrix'), FLOAT)
    text_before = llvm.ptx(text)
    with llvm._in_program_order():
        pass
    assert llvm.ptx(text) == text_before
