"""
Native loop that calls a kernel repeatedly.

A kernel is ``void kernel(double **pointers)``: arguments first, result last.
"""

from array import array
from collections.abc import Callable, Sequence
import ctypes
from functools import cache
import sys
from typing import Any

from kane_dynamics.native.machine_code import llvm, object_cache
import numpy as np
from numpy.typing import NDArray

POINTER_SLOTS = 32  # limit on the arguments, defaults and result of one kernel together

SUPPORT = """
; Call a kernel N times and advance each pointer by its stride (bytes) after each call. If the
; result of one call is the argument of the next, this integrates over time. The words of the table
; are the kernel, N, the number of pointers, the pointers and the strides.
define void @repeat(ptr %table) {
start:
  %kernel = load ptr, ptr %table
  %N.at = getelementptr i64, ptr %table, i64 1
  %N = load i64, ptr %N.at
  %slots.at = getelementptr i64, ptr %table, i64 2
  %slots = load i64, ptr %slots.at
  %pointers = getelementptr i64, ptr %table, i64 3
  %strides = getelementptr i64, ptr %pointers, i64 %slots
  %own = alloca [SLOTS x ptr]
  %size = mul i64 %slots, 8
  call void @llvm.memcpy.p0.p0.i64(ptr %own, ptr %pointers, i64 %size, i1 false)
  %any = icmp sgt i64 %N, 0
  br i1 %any, label %state, label %done
state:
  %i = phi i64 [0, %start], [%i.next, %moved]
  call void %kernel(ptr %own)
  br label %move
move:
  %k = phi i64 [0, %state], [%k.next, %move]
  %at = getelementptr ptr, ptr %own, i64 %k
  %old = load ptr, ptr %at
  %stride.at = getelementptr i64, ptr %strides, i64 %k
  %stride = load i64, ptr %stride.at
  %new = getelementptr i8, ptr %old, i64 %stride
  store ptr %new, ptr %at
  %k.next = add i64 %k, 1
  %k.more = icmp slt i64 %k.next, %slots
  br i1 %k.more, label %move, label %moved
moved:
  %i.next = add i64 %i, 1
  %more = icmp slt i64 %i.next, %N
  br i1 %more, label %state, label %done
done:
  ret void
}

declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)
"""


@cache
def support() -> llvm.Code:
    """Return the machine code of `SUPPORT`."""
    text = SUPPORT.replace('SLOTS', str(POINTER_SLOTS))
    return llvm.Code(object_cache.fetch(object_cache.key('support', text),
                                        lambda: llvm.assemble(text, 2, optimise=True)))


@cache
def _repeat(release_gil: bool) -> Callable[..., None]:
    prototype = ctypes.CFUNCTYPE if release_gil else ctypes.PYFUNCTYPE
    function: Callable[..., None] = support().function('repeat', prototype(
        None, ctypes.c_void_p))
    return function


def _address_reader() -> Callable[[NDArray[Any]], int]:
    """Return `address`; `ctypes.data`, which takes ten times as long, where objects differ."""
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
    Call a kernel `count` times and advance each pointer by its stride (bytes) after each call.

    More than one call releases the GIL. A single call keeps it, because reacquiring it beside a
    busy Python thread takes milliseconds. The caller provides memory that is large enough.
    """
    table = array('q', (kernel, count, len(pointers), *pointers, *strides))
    _repeat(count > 1)(table.buffer_info()[0])
