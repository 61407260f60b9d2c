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
import sys
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import CompileError
from kane_dynamics.native.backends import llvm_simd
from kane_dynamics.native.machine_code import llvm
from kane_dynamics.native.runtime.threads import run_in_threads, THREAD_WORK
import numpy as np
from numpy.typing import NDArray

POINTER_SLOTS = 32  # limit on the arguments, defaults and result of one kernel together
# Flags of `run_batch` for non-finite numbers. That of inputs is also set where several
# positions come near their limit: callers look at the numbers then.
BAD_INPUT, BAD_RESULT = 1, 2
# Seconds for the lanes of a kernel, by its address and the number of steps.
PACES: dict[object, float] = {}
PROBE_CALLS = 64  # kernel calls timed to decide on the number of threads
STACK = 2**23  # bytes of a thread's stack

PIECES = 64  # of each share of a batch
# Of the calling thread to join another before it sleeps: some 50 us, in which most end. A
# processor that has slept takes longer than that to wake up.
TRIES = 20_000

# Words of a job: the arguments of `run_batch` in order, of which those two are named, then
# the flags, which are the result, and what the threads need.
BEGIN, END, FLAGS, PIECE, SHARES, COUNT = 6, 7, 9, 10, 11, 12
WORDS = 13
# Words of a share: begin of what is left, end, job, thread; a cache line.
SHARE = 8

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
  %i = phi i64 [0, %start], [%i.next, %state]
  call void %kernel(ptr %own)
  call void @advance(ptr %own, ptr %strides, i64 %slots)
  %i.next = add i64 %i, 1
  %more = icmp slt i64 %i.next, %N
  br i1 %more, label %state, label %done
done:
  ret void
}

; Advance each pointer by its stride, bytes.
define internal void @advance(ptr %own, ptr %strides, i64 %slots) alwaysinline {
start:
  br label %move
move:
  %k = phi i64 [0, %start], [%k.next, %move]
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
  ret void
}

declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)
"""


@cache
def support() -> llvm.Code:
    """Return the machine code of `SUPPORT`."""
    text = SUPPORT.replace('SLOTS', str(POINTER_SLOTS))
    return llvm.library('support', text)


@cache
def _repeat(release_gil: bool) -> Callable[..., None]:
    prototype = ctypes.CFUNCTYPE if release_gil else ctypes.PYFUNCTYPE
    function: Callable[..., None] = support().function('repeat', prototype(
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


RUN_BATCH = """
; Run states begin <= i < end through `steps` calls of a lane kernel. The table holds, for each
; argument and for the result, an address, the bytes between states and between steps, and null or
; the address of the numbers of the states' rows. If `low` is not null, each state's row of `low`
; and `high` is updated with the minimum and maximum of every entry of its results.
define i64 @run_batch(ptr %kernel, ptr %table, i64 %slots, i64 %size, ptr noalias %low,
                  ptr noalias %high, i64 %begin, i64 %end, i64 %steps) {
start:
  %rows = alloca [SLOTS x <W x ptr>], align 64
  %firsts = alloca [SLOTS x <W x ptr>], align 64
  %states = alloca <W x i64>, align 64
  %distances = alloca [SLOTS x i64]
  %bad = alloca [2 x <W x i64>], align 64
  store [2 x <W x i64>] zeroinitializer, ptr %bad
  %last = sub i64 %end, 1
  %last.lane = insertelement <W x i64> poison, i64 %last, i32 0
  %last.lanes = shufflevector <W x i64> %last.lane, <W x i64> poison, <W x i32> zeroinitializer
  %result = sub i64 %slots, 1
  %result.rows = getelementptr <W x ptr>, ptr %rows, i64 %result
  %watched = icmp ne ptr %low, null
  %is.single = icmp eq i64 %steps, 1
  br label %regard
regard:
  ; Whether the rows of no argument are numbered, and the bytes between the rows of full blocks.
  %r = phi i64 [0, %start], [%r.next, %regard]
  %r.plain = phi i1 [true, %start], [%plain, %regard]
  %r.row = getelementptr [ROW x i64], ptr %table, i64 %r
  %r.stride.at = getelementptr i64, ptr %r.row, i64 1
  %r.stride = load i64, ptr %r.stride.at
  %r.distance = mul i64 %r.stride, W
  %r.distance.at = getelementptr i64, ptr %distances, i64 %r
  store i64 %r.distance, ptr %r.distance.at
  %r.numbers.at = getelementptr i64, ptr %r.row, i64 3
  %r.numbers = load ptr, ptr %r.numbers.at
  %r.unnumbered = icmp eq ptr %r.numbers, null
  %plain = and i1 %r.plain, %r.unnumbered
  %r.next = add i64 %r, 1
  %r.more = icmp slt i64 %r.next, %slots
  br i1 %r.more, label %regard, label %regarded
regarded:
  %is.short = and i1 %plain, %is.single
  br label %block
block:
  %b = phi i64 [%begin, %regarded], [%b.next, %block.done]
  %b.lane = insertelement <W x i64> poison, i64 %b, i32 0
  %b.lanes = shufflevector <W x i64> %b.lane, <W x i64> poison, <W x i32> zeroinitializer
  %open = add <W x i64> %b.lanes, LANE_NUMBERS
  %state = call <W x i64> @llvm.smin.vWi64(<W x i64> %open, <W x i64> %last.lanes)
  store <W x i64> %state, ptr %states
  ; The rows of a full block are as far from those of the block before in every lane.
  %b.end = add i64 %b, W
  %is.full = icmp sle i64 %b.end, %end
  %is.later = icmp sgt i64 %b, %begin
  %follows = and i1 %is.full, %is.later
  %is.shift = and i1 %follows, %is.short
  br i1 %is.shift, label %shift, label %place
shift:
  ; Most batches: every block but the first and the last.
  %h = phi i64 [0, %block], [%h.next, %shift]
  %h.at = getelementptr <W x ptr>, ptr %rows, i64 %h
  %h.before = load <W x ptr>, ptr %h.at
  %h.distance.at = getelementptr i64, ptr %distances, i64 %h
  %h.distance = load i64, ptr %h.distance.at
  %h.following = getelementptr i8, <W x ptr> %h.before, i64 %h.distance
  store <W x ptr> %h.following, ptr %h.at
  %h.next = add i64 %h, 1
  %h.more = icmp slt i64 %h.next, %slots
  br i1 %h.more, label %shift, label %step
place:
  %k = phi i64 [0, %block], [%k.next, %stored]
  %row = getelementptr [ROW x i64], ptr %table, i64 %k
  %stride.at = getelementptr i64, ptr %row, i64 1
  %stride = load i64, ptr %stride.at
  %first.at = getelementptr <W x ptr>, ptr %firsts, i64 %k
  %own.at = getelementptr <W x ptr>, ptr %rows, i64 %k
  %numbers.at = getelementptr i64, ptr %row, i64 3
  %numbers = load ptr, ptr %numbers.at
  %numbered = icmp ne ptr %numbers, null
  br i1 %numbered, label %look, label %unnumbered
unnumbered:
  br i1 %follows, label %follow, label %placed
follow:
  %before = load <W x ptr>, ptr %first.at
  %distance.at = getelementptr i64, ptr %distances, i64 %k
  %distance = load i64, ptr %distance.at
  %following = getelementptr i8, <W x ptr> %before, i64 %distance
  br label %stored
look:
  %number.at = getelementptr i64, ptr %numbers, <W x i64> %state
  %number = call <W x i64> @llvm.masked.gather.vWi64.vWp0(<W x ptr> %number.at, i32 8,
                                                          <W x i1> EVERY, <W x i64> poison)
  br label %placed
placed:
  %place.state = phi <W x i64> [%state, %unnumbered], [%number, %look]
  %address = load ptr, ptr %row
  %stride.lane = insertelement <W x i64> poison, i64 %stride, i32 0
  %stride.lanes = shufflevector <W x i64> %stride.lane, <W x i64> poison, <W x i32> zeroinitializer
  %offset = mul <W x i64> %place.state, %stride.lanes
  %placed.rows = getelementptr i8, ptr %address, <W x i64> %offset
  br label %stored
stored:
  %own = phi <W x ptr> [%placed.rows, %placed], [%following, %follow]
  store <W x ptr> %own, ptr %first.at
  store <W x ptr> %own, ptr %own.at
  %k.next = add i64 %k, 1
  %k.more = icmp slt i64 %k.next, %slots
  br i1 %k.more, label %place, label %step
step:
  %s = phi i64 [0, %stored], [0, %shift], [%s.next, %move]
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

RUN_JOB = """
; Run a job (words as `run_job` says) in `count` threads, one of which is this one; return when all
; have ended. Each thread computes a share, piece by piece, then pieces that are left of the shares
; of others: a thread that starts late, or whose processor has other work, delays no other, and if
; threads do not start, the others do their work.
define void @run_job(ptr %job, i64 %count) {
start:
  %attributes = alloca [32 x i64]
  %shares = alloca [SHARE x i64], i64 %count, align 64
  %begin.at = getelementptr i64, ptr %job, i64 BEGIN
  %begin = load i64, ptr %begin.at
  %end.at = getelementptr i64, ptr %job, i64 END
  %end = load i64, ptr %end.at
  %size = sub i64 %end, %begin
  %pieces = mul i64 %count, PIECES
  %piece.states = sdiv i64 %size, %pieces
  %piece.blocks = sdiv i64 %piece.states, W
  %piece.more = add i64 %piece.blocks, 1
  %piece = mul i64 %piece.more, W
  %piece.at = getelementptr i64, ptr %job, i64 PIECE
  store i64 %piece, ptr %piece.at
  %flags.at = getelementptr i64, ptr %job, i64 FLAGS
  store i64 0, ptr %flags.at
  %shares.at = getelementptr i64, ptr %job, i64 SHARES
  store ptr %shares, ptr %shares.at
  %count.at = getelementptr i64, ptr %job, i64 COUNT
  store i64 %count, ptr %count.at
  ; Shares of whole blocks of lanes.
  %blocks.open = add i64 %size, LAST
  %blocks = sdiv i64 %blocks.open, W
  br label %divide
divide:
  %d = phi i64 [0, %start], [%d.next, %divide]
  %d.begin = phi i64 [%begin, %start], [%d.end, %divide]
  %d.next = add i64 %d, 1
  %d.product = mul i64 %blocks, %d.next
  %d.block = sdiv i64 %d.product, %count
  %d.states = mul i64 %d.block, W
  %d.open = add i64 %begin, %d.states
  %d.end = call i64 @llvm.smin.i64(i64 %d.open, i64 %end)
  %d.share = getelementptr [SHARE x i64], ptr %shares, i64 %d
  store i64 %d.begin, ptr %d.share
  %d.end.at = getelementptr i64, ptr %d.share, i64 1
  store i64 %d.end, ptr %d.end.at
  %d.job.at = getelementptr i64, ptr %d.share, i64 2
  store ptr %job, ptr %d.job.at
  %d.more = icmp slt i64 %d.next, %count
  br i1 %d.more, label %divide, label %threads
threads:
  %bare = call i32 @pthread_attr_init(ptr %attributes)
  %sized = call i32 @pthread_attr_setstacksize(ptr %attributes, i64 STACK)
  br label %create
create:
  %c = phi i64 [1, %threads], [%c.next, %created]
  %c.more = icmp slt i64 %c, %count
  br i1 %c.more, label %new, label %work
new:
  %c.share = getelementptr [SHARE x i64], ptr %shares, i64 %c
  %c.at = getelementptr i64, ptr %c.share, i64 3
  %c.error = call i32 @pthread_create(ptr %c.at, ptr %attributes, ptr @run_pieces, ptr %c.share)
  %c.failed = icmp ne i32 %c.error, 0
  br i1 %c.failed, label %work, label %created
created:
  %c.next = add i64 %c, 1
  br label %create
work:
  %own = call ptr @run_pieces(ptr %shares)
  br label %join
join:
  %j = phi i64 [1, %work], [%j.next, %joined]
  %tries = phi i64 [TRIES, %work], [%tries.left, %joined]
  %j.more = icmp slt i64 %j, %c
  br i1 %j.more, label %other, label %done
other:
  %j.share = getelementptr [SHARE x i64], ptr %shares, i64 %j
  %j.at = getelementptr i64, ptr %j.share, i64 3
  %j.thread = load i64, ptr %j.at
  br label %look
look:
  %tries.left = phi i64 [%tries, %other], [%tries.next, %again]
  %j.running = call i32 @pthread_tryjoin_np(i64 %j.thread, ptr null)
  %j.runs = icmp ne i32 %j.running, 0
  br i1 %j.runs, label %again, label %joined
again:
  %tries.next = sub i64 %tries.left, 1
  %patient = icmp sgt i64 %tries.left, 0
  br i1 %patient, label %look, label %wait
wait:
  %j.error = call i32 @pthread_join(i64 %j.thread, ptr null)
  br label %joined
joined:
  %j.next = add i64 %j, 1
  br label %join
done:
  %cleared = call i32 @pthread_attr_destroy(ptr %attributes)
  ret void
}

; Take pieces of a thread's own share, then of those after it, around.
define internal ptr @run_pieces(ptr %share) {
start:
  %job.at = getelementptr i64, ptr %share, i64 2
  %job = load ptr, ptr %job.at
ARGUMENTS
  %piece.at = getelementptr i64, ptr %job, i64 PIECE
  %piece = load i64, ptr %piece.at
  %shares.at = getelementptr i64, ptr %job, i64 SHARES
  %shares = load ptr, ptr %shares.at
  %count.at = getelementptr i64, ptr %job, i64 COUNT
  %count = load i64, ptr %count.at
  %after = getelementptr [SHARE x i64], ptr %shares, i64 %count
  br label %choose
choose:
  %k = phi i64 [0, %start], [%k.next, %next]
  %chosen = phi ptr [%share, %start], [%chosen.next, %next]
  %flags.before = phi i64 [0, %start], [%flags, %next]
  %end.at = getelementptr i64, ptr %chosen, i64 1
  %end = load i64, ptr %end.at
  br label %take
take:
  %flags = phi i64 [%flags.before, %choose], [%flags.next, %run]
  %begin = atomicrmw add ptr %chosen, i64 %piece monotonic
  %stop.open = add i64 %begin, %piece
  %stop = call i64 @llvm.smin.i64(i64 %stop.open, i64 %end)
  %left = icmp slt i64 %begin, %end
  br i1 %left, label %run, label %next
run:
  %flags.piece = call i64 @run_batch(PASSED)
  %flags.next = or i64 %flags, %flags.piece
  br label %take
next:
  %k.next = add i64 %k, 1
  %following = getelementptr [SHARE x i64], ptr %chosen, i64 1
  %around = icmp eq ptr %following, %after
  %chosen.next = select i1 %around, ptr %shares, ptr %following
  %k.more = icmp slt i64 %k.next, %count
  br i1 %k.more, label %choose, label %done
done:
  %flags.at = getelementptr i64, ptr %job, i64 FLAGS
  %flags.others = atomicrmw or ptr %flags.at, i64 %flags monotonic
  ret ptr null
}

declare i64 @llvm.smin.i64(i64, i64)
declare i32 @pthread_attr_init(ptr)
declare i32 @pthread_attr_setstacksize(ptr, i64)
declare i32 @pthread_attr_destroy(ptr)
declare i32 @pthread_create(ptr, ptr, ptr, ptr)
declare i32 @pthread_join(i64, ptr)
declare i32 @pthread_tryjoin_np(i64, ptr)
"""


def run_job(width: int) -> str:
    """Return `RUN_JOB`, to be added to the module of `run_batch`."""
    # The words of a job are the arguments of `run_batch`, in order.
    kinds = ['ptr', 'ptr', 'i64', 'i64', 'ptr', 'ptr', 'i64', 'i64', 'i64']
    arguments = []
    passed = []
    for k, kind in enumerate(kinds):
        if k in (BEGIN, END):
            continue
        arguments += [f'  %at{k} = getelementptr i64, ptr %job, i64 {k}',
                      f'  %given{k} = load {kind}, ptr %at{k}']
    # A thread computes a piece of the states, in place of the job's own begin and end.
    for k, kind in enumerate(kinds):
        passed.append(f'{kind} %given{k}')
    passed[BEGIN] = 'i64 %begin'
    passed[END] = 'i64 %stop'
    # A name that holds another is replaced before it: PIECES before PIECE.
    text = RUN_JOB.replace('ARGUMENTS', '\n'.join(arguments))
    text = text.replace('PASSED', ', '.join(passed))
    for name, number in (('PIECES', PIECES), ('PIECE', PIECE), ('STACK', STACK),
                         ('FLAGS', FLAGS), ('BEGIN', BEGIN), ('END', END),
                         ('TRIES', TRIES), ('SHARES', SHARES), ('SHARE', SHARE), ('COUNT', COUNT),
                         ('LAST', width - 1)):
        text = text.replace(name, str(number))
    return text


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


ROW = len(Strided._fields)  # words of a row of the table


@cache
# Constants of the number of lanes, then the types that contain it.
def batch_driver(width: int) -> llvm.Code:
    """Return the machine code of `RUN_BATCH` and of its threads."""
    counting = '<' + ', '.join(f'i64 {lane}' for lane in range(width)) + '>'
    text = RUN_BATCH.replace('LANE_NUMBERS', counting)
    text = text.replace('SLOTS', str(POINTER_SLOTS)).replace('ROW', str(ROW))
    text = text.replace('EVERY', '<' + ', '.join(['i1 true'] * width) + '>')
    for name in ('<W x', 'vWi64', 'vWp0'):
        text = text.replace(name, name.replace('W', str(width)))
    text = (text + run_job(width)).replace(', W\n', f', {width}\n')
    return llvm.library('run_batch', text)


@cache
def _driver_function(width: int) -> Callable[..., None]:
    """Return `run_job` as a function that releases the GIL."""
    prototype = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64)
    function: Callable[..., None] = batch_driver(width).function('run_job', prototype)
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
    function = _driver_function(width)
    address, _ = table.buffer_info()
    low = high = size = 0
    if extremes is not None:
        lowest, highest = extremes
        low = lowest.ctypes.data
        high = highest.ctypes.data
        size = lowest.shape[1]

    # Each thread has its own words: the limits of its part, then flags.
    def work(begin: int, end: int, threads: int) -> int:
        job = array('q', (kernel, address, len(rows), size, low, high, begin, end, steps,
                          *[0] * (WORDS - FLAGS)))
        function(job.buffer_info()[0], threads)
        return job[FLAGS]
    # The pace of a first part decides on the number of threads.
    probe = max(1, PROBE_CALLS // steps)
    return run_in_threads(work, count, width, probe, PACES, (kernel, steps))
