"""
Generate LLVM IR of a function by CasADi's conventions for functions in shared libraries.

For a function f these are `f` itself, which takes arrays of pointers to the nonzeros of
arguments and results, null for zeros and for a result that is not wanted; and `f_n_in`,
`f_name_in`, `f_sparsity_in`, the same for results, and `f_work`, which describe it. A
result is NaN where the kernel's is, and where a position is too large for sines and
cosines.
"""

from bisect import bisect_left
from collections.abc import Sequence
import math

from kane_dynamics.native.backends.llvm_math import literal, size_limit
from kane_dynamics.native.backends.llvm_scalar import module_text
from kane_dynamics.native.tracing.matrix_function import Block, MatrixFunction

KERNEL = 'kernel'
KINDS = 'name', 'sparsity'
COPY = '@llvm.memcpy.p0.p0.i64'
ABS = '@llvm.fabs.f64'


def casadi_text(function: MatrixFunction) -> str:
    """Return the text of a module with a function and its descriptions."""
    kernel = module_text(function.program, KERNEL)
    kernel = kernel.replace('define void', 'define internal void')
    lines = [kernel, *_evaluation(function)]
    for end, blocks in (('in', function.inputs), ('out', function.outputs)):
        lines += _description(f'{function.name}_', end, blocks)
    # The sizes of arg, res, iw and w that CasADi allocates: the results are computed in
    # w.
    sizes = (len(function.inputs), len(function.outputs), 0,
             len(function.program.outputs))
    work = 'ptr %arg, ptr %res, ptr %iw, ptr %w'
    lines.append(f'define i32 @{function.name}_work({work}) {{')
    for name, size in zip(('arg', 'res', 'iw', 'w'), sizes):
        lines.append(f'  store i64 {size}, ptr %{name}')
    lines += ['  ret i32 0', '}']
    return '\n'.join(lines)


def _evaluation(function: MatrixFunction) -> list[str]:
    """Return the function: it computes all results in work space, and copies them."""
    size = 8 * len(function.program.outputs)
    signature = 'ptr %arg, ptr %res, ptr %iw, ptr %w, i32 %mem'
    # Arguments that are null are zeros, which are read from a shared array.
    read = [k for k, block in enumerate(function.inputs) if block.places]
    longest = max((len(block.places) for block in function.inputs), default=1)
    lines = [f'@zeros = internal constant [{max(longest, 1)} x double] zeroinitializer',
             'declare double @llvm.fabs.f64(double)',
             f'declare void {COPY}(ptr, ptr, i64, i1)',
             f'define i32 @{function.name}({signature}) {{',
             f'  %args = alloca [{len(read) + 1} x ptr]']
    # The pointers to the arguments that the program reads, with zeros in place of null.
    for place, k in enumerate(read):
        lines += [f'  %from{k} = getelementptr ptr, ptr %arg, i64 {k}',
                  f'  %given{k} = load ptr, ptr %from{k}',
                  f'  %null{k} = icmp eq ptr %given{k}, null',
                  f'  %in{k} = select i1 %null{k}, ptr @zeros, ptr %given{k}',
                  f'  %slot{k} = getelementptr ptr, ptr %args, i64 {place}',
                  f'  store ptr %in{k}, ptr %slot{k}']
    lines += _check(function, read)
    lines += [f'  %result = getelementptr ptr, ptr %args, i64 {len(read)}',
              '  store ptr %w, ptr %result', f'  call void @{KERNEL}(ptr %args)',
              '  br i1 %invalid, label %spoil, label %results',
              'spoil:',  # bytes of ones are NaN
              f'  call void @llvm.memset.p0.i64(ptr %w, i8 -1, i64 {size}, i1 false)',
              '  br label %results', 'results:']
    # Copy what is wanted: results with a pointer, one after the other in w.
    offset = 0
    for k, block in enumerate(function.outputs):
        size = 8 * len(block.places)
        copied = f'ptr %out{k}, ptr %from.w{k}'
        if size:
            lines += [f'  %to{k} = getelementptr ptr, ptr %res, i64 {k}',
                      f'  %out{k} = load ptr, ptr %to{k}',
                      f'  %unwanted{k} = icmp eq ptr %out{k}, null',
                      f'  br i1 %unwanted{k}, label %next{k}, label %copy{k}',
                      f'copy{k}:',
                      f'  %from.w{k} = getelementptr i8, ptr %w, i64 {offset}',
                      f'  call void {COPY}({copied}, i64 {size}, i1 false)',
                      f'  br label %next{k}', f'next{k}:']
        offset += size
    return [*lines, '  ret i32 0', '}']


def _check(function: MatrixFunction, read: Sequence[int]) -> list[str]:
    """Return the code that sets `%invalid`: an argument is beyond its limit."""
    # The chain of all comparisons; each adds one position to `worst`.
    lines = []
    worst = 'false'
    for k in read:
        # Positions beyond their limit have lost the angle.
        block = function.inputs[k]
        limit = size_limit(block.name)
        if not math.isfinite(limit):
            continue
        for place in range(len(block.places)):
            value = f'%check{k}.{place}'
            lines += [f'  {value}.at = getelementptr double, ptr %in{k}, i64 {place}',
                      f'  {value}.load = load double, ptr {value}.at',
                      f'  {value}.size = call double {ABS}(double {value}.load)',
                      f'  {value}.over = fcmp ogt double {value}.size, {literal(limit)}',
                      f'  {value} = or i1 {worst}, {value}.over']
            worst = value
    return [*lines, f'  %invalid = or i1 {worst}, false']


def _description(prefix: str, end: str, blocks: Sequence[Block]) -> list[str]:
    """Return the functions for number, names, sparsity of arguments or results."""
    count = len(blocks)
    lines = [f'define i64 @{prefix}n_{end}() {{', f'  ret i64 {count}', '}']
    # Constants of each argument or result: its name, and its compressed columns.
    for k, block in enumerate(blocks):
        pattern = _compressed(block)
        numbers = ', '.join(f'i64 {x}' for x in pattern)
        letters = len(block.name) + 1
        name, sparsity = (f'@{kind}.{end}.{k} = internal constant' for kind in KINDS)
        lines += [f'{name} [{letters} x i8] c"{block.name}\\00"',
                  f'{sparsity} [{len(pattern)} x i64] [{numbers}]']
    # A function that looks up the constant of number k, null beyond the last.
    for kind in KINDS:
        entries = ', '.join(f'ptr @{kind}.{end}.{k}' for k in range(count))
        lines += [f'@{kind}.{end} = internal constant [{count} x ptr] [{entries}]',
                  f'define ptr @{prefix}{kind}_{end}(i64 %k) {{',
                  f'  %known = icmp ult i64 %k, {count}',
                  '  %place = select i1 %known, i64 %k, i64 0',
                  f'  %at = getelementptr ptr, ptr @{kind}.{end}, i64 %place',
                  '  %found = load ptr, ptr %at',
                  '  %result = select i1 %known, ptr %found, ptr null',
                  '  ret ptr %result', '}']
    return lines


def _compressed(block: Block) -> list[int]:
    """Return rows, columns, where each column begins, and the row of each nonzero."""
    rows, columns = block.shape
    # Places ascend column by column: a column begins behind all that are before it.
    begins = [bisect_left(block.places, rows * column) for column in range(columns + 1)]
    return [rows, columns, *begins, *(place % rows for place in block.places)]
