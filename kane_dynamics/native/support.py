"""
Hand-written machine code around kernels: the loop that repeats one, and the fast entry.

Both are generic: a kernel is ``void kernel(double **pointers)``, its arguments first, its result
last, and what else they need to know of it they read from memory.
"""

from collections.abc import Callable, Sequence
import ctypes
from functools import cache

from kane_dynamics.native import cache as object_cache, llvm
import numpy as np

POINTER_SLOTS = 16  # most arguments, defaults and result together, of one kernel

# What the table of 64-bit words holds that an entry carries as its `self`, in order.
TABLE = ('KERNEL', 'NDARRAY', 'FLOAT64', 'FALLBACK', 'VECTORCALL', 'NEW_ARRAY', 'NEW_FLOAT',
         'N_ARGUMENTS', 'LENGTHS', 'N_DEFAULTS', 'DEFAULTS', 'RESULT_NDIM', 'RESULT_SHAPE',
         'RESULT_SIZE', 'RELEASE')

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

; PyObject *entry(PyObject *self, PyObject *const *args, Py_ssize_t nargs, PyObject *kwnames)
define ptr @entry(ptr %self, ptr %args, i64 %nargs, ptr %kwnames) {
start:
  %pointers = alloca [SLOTS x ptr]
  %scalar = alloca double
  %table.at = getelementptr i8, ptr %self, i64 16
  %table = load ptr, ptr %table.at
  %kernel.at = getelementptr ptr, ptr %table, i64 KERNEL
  %kernel = load ptr, ptr %kernel.at
  %ndarray.at = getelementptr ptr, ptr %table, i64 NDARRAY
  %ndarray = load ptr, ptr %ndarray.at
  %float64.at = getelementptr ptr, ptr %table, i64 FLOAT64
  %float64 = load ptr, ptr %float64.at
  %expected.at = getelementptr i64, ptr %table, i64 N_ARGUMENTS
  %expected = load i64, ptr %expected.at
  %lengths.at = getelementptr ptr, ptr %table, i64 LENGTHS
  %lengths = load ptr, ptr %lengths.at
  %no.keywords = icmp eq ptr %kwnames, null
  %count.ok = icmp eq i64 %nargs, %expected
  %call.ok = and i1 %no.keywords, %count.ok
  br i1 %call.ok, label %argument, label %slow
argument:
  %k = phi i64 [0, %start], [%k.next, %finite]
  %o.at = getelementptr ptr, ptr %args, i64 %k
  %o = load ptr, ptr %o.at
  %type.at = getelementptr i8, ptr %o, i64 8
  %type = load ptr, ptr %type.at
  %type.ok = icmp eq ptr %type, %ndarray
  br i1 %type.ok, label %array, label %slow
array:
  %data.at = getelementptr i8, ptr %o, i64 16
  %data = load ptr, ptr %data.at
  %nd.at = getelementptr i8, ptr %o, i64 24
  %nd = load i32, ptr %nd.at
  %descr.at = getelementptr i8, ptr %o, i64 56
  %descr = load ptr, ptr %descr.at
  %flags.at = getelementptr i8, ptr %o, i64 64
  %flags = load i32, ptr %flags.at
  %nd.ok = icmp eq i32 %nd, 1
  %descr.ok = icmp eq ptr %descr, %float64
  %layout = and i32 %flags, 257
  %layout.ok = icmp eq i32 %layout, 257
  %ok.1 = and i1 %nd.ok, %descr.ok
  %ok.2 = and i1 %ok.1, %layout.ok
  br i1 %ok.2, label %length, label %slow
length:
  %dims.at = getelementptr i8, ptr %o, i64 32
  %dims = load ptr, ptr %dims.at
  %dim = load i64, ptr %dims
  %length.at = getelementptr i64, ptr %lengths, i64 %k
  %wanted = load i64, ptr %length.at
  %length.ok = icmp eq i64 %dim, %wanted
  %slot = getelementptr ptr, ptr %pointers, i64 %k
  store ptr %data, ptr %slot
  br i1 %length.ok, label %scan, label %slow
scan:                                             ; an exponent of all ones is inf or nan
  %j = phi i64 [0, %length], [%j.next, %scan]
  %worst = phi i64 [0, %length], [%worst.next, %scan]
  %word.at = getelementptr i64, ptr %data, i64 %j
  %word = load i64, ptr %word.at
  %shifted = shl i64 %word, 1
  %larger = icmp ugt i64 %shifted, %worst
  %worst.next = select i1 %larger, i64 %shifted, i64 %worst
  %j.next = add i64 %j, 1
  %j.more = icmp slt i64 %j.next, %dim
  br i1 %j.more, label %scan, label %finite
finite:
  %finite.ok = icmp ult i64 %worst.next, -9007199254740992
  %k.next = add i64 %k, 1
  %k.more = icmp slt i64 %k.next, %nargs
  %go.on = and i1 %finite.ok, %k.more
  br i1 %go.on, label %argument, label %checked
checked:
  br i1 %finite.ok, label %defaults, label %slow
defaults:
  %n.defaults.at = getelementptr i64, ptr %table, i64 N_DEFAULTS
  %n.defaults = load i64, ptr %n.defaults.at
  %from = getelementptr ptr, ptr %table, i64 DEFAULTS
  %defaults.at = load ptr, ptr %from
  %to = getelementptr ptr, ptr %pointers, i64 %nargs
  %size = mul i64 %n.defaults, 8
  call void @llvm.memcpy.p0.p0.i64(ptr %to, ptr %defaults.at, i64 %size, i1 false)
  %result.at = getelementptr ptr, ptr %to, i64 %n.defaults
  %ndim.at = getelementptr i64, ptr %table, i64 RESULT_NDIM
  %ndim = load i64, ptr %ndim.at
  %is.scalar = icmp eq i64 %ndim, 0
  br i1 %is.scalar, label %give.scalar, label %give.array
give.scalar:
  store ptr %scalar, ptr %result.at
  call void %kernel(ptr %pointers)
  %number = load double, ptr %scalar
  %number.word = load i64, ptr %scalar
  %number.shifted = shl i64 %number.word, 1
  %number.ok = icmp ult i64 %number.shifted, -9007199254740992
  br i1 %number.ok, label %give.float, label %slow
give.float:
  %new.float.at = getelementptr ptr, ptr %table, i64 NEW_FLOAT
  %new.float = load ptr, ptr %new.float.at
  %float = call ptr %new.float(double %number)
  ret ptr %float
give.array:
  %shape.at = getelementptr ptr, ptr %table, i64 RESULT_SHAPE
  %shape = load ptr, ptr %shape.at
  %new.array.at = getelementptr ptr, ptr %table, i64 NEW_ARRAY
  %new.array = load ptr, ptr %new.array.at
  %ndim.32 = trunc i64 %ndim to i32
  %out = call ptr %new.array(ptr %ndarray, i32 %ndim.32, ptr %shape, i32 12, ptr null, ptr null,
                             i32 0, i32 0, ptr null)
  %made = icmp ne ptr %out, null
  br i1 %made, label %run, label %failed
run:
  %out.data.at = getelementptr i8, ptr %out, i64 16
  %out.data = load ptr, ptr %out.data.at
  store ptr %out.data, ptr %result.at
  call void %kernel(ptr %pointers)
  %words.at = getelementptr i64, ptr %table, i64 RESULT_SIZE
  %words = load i64, ptr %words.at
  br label %rescan
rescan:
  %m = phi i64 [0, %run], [%m.next, %rescan]
  %bad = phi i64 [0, %run], [%bad.next, %rescan]
  %result.word.at = getelementptr i64, ptr %out.data, i64 %m
  %result.word = load i64, ptr %result.word.at
  %result.shifted = shl i64 %result.word, 1
  %result.larger = icmp ugt i64 %result.shifted, %bad
  %bad.next = select i1 %result.larger, i64 %result.shifted, i64 %bad
  %m.next = add i64 %m, 1
  %m.more = icmp slt i64 %m.next, %words
  br i1 %m.more, label %rescan, label %judge
judge:
  %result.ok = icmp ult i64 %bad.next, -9007199254740992
  br i1 %result.ok, label %good, label %discard
good:
  ret ptr %out
discard:                                          ; the fallback computes it again and explains
  %release.at = getelementptr ptr, ptr %table, i64 RELEASE
  %release = load ptr, ptr %release.at
  call void %release(ptr %out)
  br label %slow
failed:
  ret ptr null
slow:
  %fallback.at = getelementptr ptr, ptr %table, i64 FALLBACK
  %fallback = load ptr, ptr %fallback.at
  %vectorcall.at = getelementptr ptr, ptr %table, i64 VECTORCALL
  %vectorcall = load ptr, ptr %vectorcall.at
  %answer = call ptr %vectorcall(ptr %fallback, ptr %args, i64 %nargs, ptr %kwnames)
  ret ptr %answer
}
declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)
"""


@cache
def support() -> llvm.Code:
    """Return the machine code of `SUPPORT`, from the cache if it is there."""
    text = SUPPORT.replace('SLOTS', str(POINTER_SLOTS))
    for slot, name in enumerate(TABLE):
        text = text.replace(f'i64 {name}\n', f'i64 {slot}\n')
    return llvm.Code(object_cache.fetch(object_cache.key('support', text),
                                        lambda: llvm.assemble(text, 2, optimise=True)))


@cache
def _repeat(release_gil: bool) -> Callable[..., None]:
    prototype = ctypes.CFUNCTYPE if release_gil else ctypes.PYFUNCTYPE
    return prototype(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64,
                     ctypes.c_int64)(support().address('repeat'))


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
