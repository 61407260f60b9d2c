"""
Native loops over kernels: one state after the other, or a batch in lanes and threads.

A kernel is ``void kernel(double **pointers)``: arguments first, result last. `repeat`
calls it for one state after the other. `run_batch` calls a lane kernel for blocks of
states, which threads share.

The machine code starts the threads and joins them before it returns. No exception,
signal, fork or shutdown of the interpreter can come between, so no thread outlives the
call whose memory it uses.

The last block of a batch is filled by repeating its last state, whose result is then
written several times with equal bits. So a result depends only on its own state, not on
its position.
"""

from array import array
from collections.abc import Callable, Sequence
import ctypes
from functools import cache
from pathlib import Path
import sys
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import CompileError
from kane_dynamics.native.backends import llvm_simd
from kane_dynamics.native.machine_code import llvm
from kane_dynamics.native.machine_code.c_source import CSource
from kane_dynamics.native.runtime.threads import run_in_threads, THREAD_WORK
import numpy as np
from numpy.typing import NDArray

SOURCE = CSource(Path(__file__).with_suffix('.c'))
# The limit on the arguments, defaults and result of one kernel together, and the flags of
# `run_batch` for non-finite numbers.
POINTER_SLOTS, BAD_INPUT, BAD_RESULT = map(SOURCE.constants.__getitem__, (
    'POINTER_SLOTS', 'BAD_INPUT', 'BAD_RESULT'))
# Seconds for the lanes of a kernel, by its address and the number of steps.
PACES: dict[object, float] = {}
PROBE_CALLS = 64  # kernel calls timed to decide on the number of threads


def loops() -> llvm.Code:
    """Return the machine code of `loops.c`."""
    return SOURCE.code


@cache
def _repeat(release_gil: bool) -> Callable[..., None]:
    prototype = ctypes.CFUNCTYPE if release_gil else ctypes.PYFUNCTYPE
    function: Callable[..., None] = loops().function('repeat', prototype(
        None, ctypes.c_void_p))
    return function


def _address_reader() -> Callable[[NDArray[Any]], int]:
    """Return `address`; the slower `ctypes.data` where objects differ."""
    word = ctypes.c_size_t.from_address
    offset = object.__basicsize__
    probe = np.zeros(1)
    if sys.implementation.name == 'cpython' and word(id(probe) + offset).value == (
            probe.ctypes.data):
        return lambda array: word(id(array) + offset).value
    return lambda array: array.ctypes.data


address = _address_reader()  # of the first entry of an array


def repeat(kernel: llvm.Address, pointers: Sequence[int], strides: Sequence[int],
           count: int) -> None:
    """
    Call a kernel `count` times; after a call, advance pointers by their strides (bytes).

    More than one call releases the GIL. A single call keeps it, because reacquiring it
    beside a busy Python thread takes milliseconds. The caller provides memory that is
    large enough.
    """
    table = array('q', (kernel, count, len(pointers), *pointers, *strides))
    _repeat(count > 1)(table.buffer_info()[0])


class Strided(NamedTuple):
    """
    Address and strides of an argument or a result; the caller keeps the memory alive.

    Attributes
    ----------
    address : int
        Address of the first state's row at the first step.
    lane, step : int
        Bytes between states and between steps; 0 where they share a row.
    numbers : int
        Address of the number of each state's row, int64; 0 where it is that of the
        state.

    """

    address: int
    lane: int = 0
    step: int = 0
    numbers: int = 0


@cache
def _run_job() -> Callable[..., None]:
    """Return `run_job` as a function that releases the GIL."""
    prototype = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64)
    function: Callable[..., None] = loops().function('run_job', prototype)
    return function


def most_of_one_thread(kernel: llvm.Address) -> int:
    """Return the number of states that `run_batch` computes in one thread."""
    width = llvm_simd.width()
    pace = PACES.get((kernel, 1), 0.0)  # s for as many states as lanes
    return width * (int(THREAD_WORK / pace) if pace else PROBE_CALLS)


def run_batch(kernel: llvm.Address, rows: Sequence[tuple[int, int, int, int]],
              count: int, *, steps: int = 1, extremes: tuple[Array, Array] | None = None,
              width: int | None = None) -> int:
    """
    Call a lane kernel for `count` states and one or more steps, without the GIL.

    Parameters
    ----------
    kernel : address
        Address of the lane kernel.
    rows : sequence of Strided, or of tuples like it
        The kernel's arguments in order, then its result. If the result of a step is the
        argument of the next, this integrates over time.
    count, steps : int
        Numbers of states and of steps.
    extremes : two (count, size) arrays, optional
        Updated with the minimum and maximum of each state's results over the steps.
    width : int, optional
        Lanes of the kernel. Default: those of this processor.

    Returns
    -------
    int
        Combination of `BAD_INPUT` and `BAD_RESULT`; 0 if all numbers are finite.

    """
    # The table of arguments has an address and a stride for each row.
    if len(rows) > POINTER_SLOTS:
        raise CompileError(f'kernel: {len(rows) - 1} arguments; expected at most '
                           f'{POINTER_SLOTS - 1}')
    entries: list[int] = []
    for row in rows:
        entries += row
    table = array('q', entries)
    width = width or llvm_simd.width()
    # The extremes of states are optional: addresses of 0 mean none.
    function = _run_job()
    address, _ = table.buffer_info()
    low = high = size = 0
    if extremes is not None:
        lowest, highest = extremes
        low = lowest.ctypes.data
        high = highest.ctypes.data
        size = lowest.shape[1]

    # The fields of a `job`; the last one is the result.
    def work(begin: int, end: int, threads: int) -> int:
        job = array('q', (kernel, address, len(rows), size, low, high, begin, end, steps,
                          width, 0))
        function(job.buffer_info()[0], threads)
        return job[-1]
    # The pace of a first part decides on the number of threads.
    probe = max(1, PROBE_CALLS // steps)
    return run_in_threads(work, count, width, probe, PACES, (kernel, steps))
