"""
Hand-written machine code around any kernel: the loop that repeats one.

A kernel is ``void kernel(double **pointers)``, its arguments first, its result last.
"""

from collections.abc import Callable, Sequence
import ctypes
from functools import cache

from kane_dynamics.native.machine_code import llvm, object_cache
import numpy as np

POINTER_SLOTS = 16  # most arguments, defaults and result together, of one kernel

SUPPORT = """
; Call `kernel` N times, moving each pointer by its stride (bytes) in between. When the result of
; one call is the argument of the next, this is a loop over time.
define void @repeat(ptr %kernel, ptr %pointers, ptr %strides, i64 %slots, i64 %N) {
start:
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
    """Return the machine code of `SUPPORT`, from the cache if it is there."""
    text = SUPPORT.replace('SLOTS', str(POINTER_SLOTS))
    return llvm.Code(object_cache.fetch(object_cache.key('support', text),
                                        lambda: llvm.assemble(text, 2, optimise=True)))


@cache
def _repeat(release_gil: bool) -> Callable[..., None]:
    prototype = ctypes.CFUNCTYPE if release_gil else ctypes.PYFUNCTYPE
    function: Callable[..., None] = support().function('repeat', prototype(
        None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64))
    return function


def repeat(kernel: llvm.Address, pointers: Sequence[int], strides: Sequence[int],
           count: int) -> None:
    """
    Call a kernel `count` times, each pointer moving by its stride (bytes) after every call.

    More than one call releases the GIL; a single one keeps it, because to take it back beside a
    busy Python thread costs milliseconds. The caller keeps the memory alive and large enough.
    """
    own = np.array(pointers, dtype=np.uint64)
    steps = np.array(strides, dtype=np.int64)
    _repeat(count > 1)(kernel, own.ctypes.data, steps.ctypes.data, len(own), count)
