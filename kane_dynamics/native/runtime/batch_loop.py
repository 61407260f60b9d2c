"""
Batches: native loop that runs a lane kernel over blocks of states, shared by threads.

The machine code starts the threads and joins them before it returns. No exception, signal, fork or
shutdown of the interpreter can come between, so no thread outlives the call whose memory it uses.

The last block is filled by repeating its last state, whose result is then written several times
with equal bits. So a result depends only on its own state, not on its position in the batch.
"""

from array import array
from collections.abc import Callable, Sequence
import ctypes
from functools import cache, reduce
from itertools import chain
from operator import or_
from typing import NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import CompileError
from kane_dynamics.native.backends import llvm_simd
from kane_dynamics.native.machine_code import llvm, object_cache
from kane_dynamics.native.runtime.loop_support import POINTER_SLOTS
from kane_dynamics.native.runtime.thread_ir import FLAGS, run_shares, WORDS
from kane_dynamics.native.runtime.threads import Range, run_in_threads

BAD_INPUT, BAD_RESULT = 1, 2  # flags of `run_batch` for non-finite numbers
PROBE_CALLS = 64  # kernel calls timed to decide on the number of threads

RUN_BATCH = """
; Run states begin <= i < end through `steps` calls of a lane kernel. The table holds, for each
; argument and for the result, an address, the bytes between states and between steps, and null or
; the address of the numbers of the states' rows. If `low` is not null, each state's row of `low`
; and `high` is updated with the minimum and maximum of every entry of its results.
define i64 @run_batch(ptr %kernel, ptr %table, i64 %slots, i64 %size, ptr noalias %low,
                  ptr noalias %high, i64 %begin, i64 %end, i64 %steps) {
start:
  %rows = alloca [SLOTS x <W x ptr>], align 64
  %states = alloca <W x i64>, align 64
  %bad = alloca [2 x <W x i64>], align 64
  store [2 x <W x i64>] zeroinitializer, ptr %bad
  %last = sub i64 %end, 1
  %last.lane = insertelement <W x i64> poison, i64 %last, i32 0
  %last.lanes = shufflevector <W x i64> %last.lane, <W x i64> poison, <W x i32> zeroinitializer
  %result = sub i64 %slots, 1
  %result.rows = getelementptr <W x ptr>, ptr %rows, i64 %result
  %watched = icmp ne ptr %low, null
  br label %block
block:
  %b = phi i64 [%begin, %start], [%b.next, %block.done]
  %b.lane = insertelement <W x i64> poison, i64 %b, i32 0
  %b.lanes = shufflevector <W x i64> %b.lane, <W x i64> poison, <W x i32> zeroinitializer
  %open = add <W x i64> %b.lanes, COUNTING
  %state = call <W x i64> @llvm.smin.vWi64(<W x i64> %open, <W x i64> %last.lanes)
  store <W x i64> %state, ptr %states
  br label %place
place:
  %k = phi i64 [0, %block], [%k.next, %placed]
  %row = getelementptr [ROW x i64], ptr %table, i64 %k
  %address = load ptr, ptr %row
  %numbers.at = getelementptr i64, ptr %row, i64 3
  %numbers = load ptr, ptr %numbers.at
  %numbered = icmp ne ptr %numbers, null
  br i1 %numbered, label %look, label %placed
look:
  %number.at = getelementptr i64, ptr %numbers, <W x i64> %state
  %number = call <W x i64> @llvm.masked.gather.vWi64.vWp0(<W x ptr> %number.at, i32 8,
                                                          <W x i1> EVERY, <W x i64> poison)
  br label %placed
placed:
  %place.state = phi <W x i64> [%state, %place], [%number, %look]
  %stride.at = getelementptr i64, ptr %row, i64 1
  %stride = load i64, ptr %stride.at
  %stride.lane = insertelement <W x i64> poison, i64 %stride, i32 0
  %stride.lanes = shufflevector <W x i64> %stride.lane, <W x i64> poison, <W x i32> zeroinitializer
  %offset = mul <W x i64> %place.state, %stride.lanes
  %own = getelementptr i8, ptr %address, <W x i64> %offset
  %own.at = getelementptr <W x ptr>, ptr %rows, i64 %k
  store <W x ptr> %own, ptr %own.at
  %k.next = add i64 %k, 1
  %k.more = icmp slt i64 %k.next, %slots
  br i1 %k.more, label %place, label %step
step:
  %s = phi i64 [0, %placed], [%s.next, %move]
  call void %kernel(ptr %rows, ptr %bad)
  br i1 %watched, label %watch, label %step.done
watch:
  %lane = phi i64 [0, %step], [%lane.next, %watch.done]
  %i.at = getelementptr i64, ptr %states, i64 %lane
  %i = load i64, ptr %i.at
  %first = mul i64 %i, %size
  %x.row.at = getelementptr ptr, ptr %result.rows, i64 %lane
  %x.row = load ptr, ptr %x.row.at
  %low.row = getelementptr double, ptr %low, i64 %first
  %high.row = getelementptr double, ptr %high, i64 %first
  br label %widen
widen:
  %j = phi i64 [0, %watch], [%j.next, %widen]
  %x.at = getelementptr double, ptr %x.row, i64 %j
  %x = load double, ptr %x.at
  %low.at = getelementptr double, ptr %low.row, i64 %j
  %low.old = load double, ptr %low.at
  %high.at = getelementptr double, ptr %high.row, i64 %j
  %high.old = load double, ptr %high.at
  %less = fcmp olt double %x, %low.old
  %more = fcmp ogt double %x, %high.old
  %low.new = select i1 %less, double %x, double %low.old
  %high.new = select i1 %more, double %x, double %high.old
  store double %low.new, ptr %low.at
  store double %high.new, ptr %high.at
  %j.next = add i64 %j, 1
  %j.more = icmp slt i64 %j.next, %size
  br i1 %j.more, label %widen, label %watch.done
watch.done:
  %lane.next = add i64 %lane, 1
  %lane.more = icmp slt i64 %lane.next, W
  br i1 %lane.more, label %watch, label %step.done
step.done:
  %s.next = add i64 %s, 1
  %s.more = icmp slt i64 %s.next, %steps
  br i1 %s.more, label %move, label %block.done
move:
  %m = phi i64 [0, %step.done], [%m.next, %move]
  %m.row = getelementptr [ROW x i64], ptr %table, i64 %m
  %by.at = getelementptr i64, ptr %m.row, i64 2
  %by = load i64, ptr %by.at
  %m.at = getelementptr <W x ptr>, ptr %rows, i64 %m
  %here = load <W x ptr>, ptr %m.at
  %there = getelementptr i8, <W x ptr> %here, i64 %by
  store <W x ptr> %there, ptr %m.at
  %m.next = add i64 %m, 1
  %m.more = icmp slt i64 %m.next, %slots
  br i1 %m.more, label %move, label %step
block.done:
  %b.next = add i64 %b, W
  %b.more = icmp slt i64 %b.next, %end
  br i1 %b.more, label %block, label %judge
judge:
  %of.input = load <W x i64>, ptr %bad
  %of.result.at = getelementptr <W x i64>, ptr %bad, i64 1
  %of.result = load <W x i64>, ptr %of.result.at
  %input.bits = call i64 @llvm.vector.reduce.or.vWi64(<W x i64> %of.input)
  %result.bits = call i64 @llvm.vector.reduce.or.vWi64(<W x i64> %of.result)
  %input.bad = icmp ne i64 %input.bits, 0
  %result.bad = icmp ne i64 %result.bits, 0
  %input.flag = select i1 %input.bad, i64 1, i64 0
  %result.flag = select i1 %result.bad, i64 2, i64 0
  %flags = or i64 %input.flag, %result.flag
  ret i64 %flags
}
declare <W x i64> @llvm.smin.vWi64(<W x i64>, <W x i64>)
declare i64 @llvm.vector.reduce.or.vWi64(<W x i64>)
declare <W x i64> @llvm.masked.gather.vWi64.vWp0(<W x ptr>, i32, <W x i1>, <W x i64>)
"""


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
        Address of the number of each state's row, int64; 0 where it is that of the state.

    """

    address: int
    lane: int = 0
    step: int = 0
    numbers: int = 0


ROW = len(Strided._fields)  # words of a row of the table


@cache
def driver(width: int) -> llvm.Code:
    """Return the machine code of `RUN_BATCH` and of its threads."""
    counting = '<' + ', '.join(f'i64 {lane}' for lane in range(width)) + '>'
    text = RUN_BATCH.replace('COUNTING', counting).replace('SLOTS', str(POINTER_SLOTS)).replace(
        'ROW', str(ROW))
    text = text.replace('EVERY', '<' + ', '.join(['i1 true'] * width) + '>')
    for name in ('<W x', 'vWi64', 'vWp0'):
        text = text.replace(name, name.replace('W', str(width)))
    text = text.replace(', W\n', f', {width}\n') + run_shares()
    return llvm.Code(object_cache.fetch(object_cache.key('run_batch', text),
                                        lambda: llvm.assemble(text, 2, optimise=True)))


@cache
def _driver_function(width: int) -> Callable[..., None]:
    """Return `run_shares` as a function that releases the GIL."""
    function: Callable[..., None] = driver(width).function('run_shares', ctypes.CFUNCTYPE(
        None, ctypes.c_void_p, ctypes.c_int64))
    return function


def run_batch(kernel: llvm.Address, rows: Sequence[tuple[int, int, int, int]], count: int, *,
              steps: int = 1, extremes: tuple[Array, Array] | None = None,
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
    if len(rows) > POINTER_SLOTS:
        raise CompileError(f'kernel: {len(rows) - 1} arguments; expected at most '
                           f'{POINTER_SLOTS - 1}')
    table = array('q', chain.from_iterable(rows))
    width = width or llvm_simd.width()
    function = _driver_function(width)
    address, _ = table.buffer_info()
    low = high = size = 0
    if extremes is not None:
        lowest, highest = extremes
        low = lowest.ctypes.data
        high = highest.ctypes.data
        size = lowest.shape[1]

    def work(ranges: Sequence[Range]) -> int:
        shares = array('q')  # a row of words for each thread, which writes its flags there
        for begin, end in ranges:
            shares.extend((kernel, address, len(rows), size, low, high, begin, end, steps,
                           *[0] * (WORDS - FLAGS)))
        function(shares.buffer_info()[0], len(ranges))
        return reduce(or_, shares[FLAGS::WORDS])
    return run_in_threads(work, count, width, max(1, PROBE_CALLS // steps))
