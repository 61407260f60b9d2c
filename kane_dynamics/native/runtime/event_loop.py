"""
The native loop over steps of a motion with events, such as joints that stick.

In its modes (the arguments of a step that are constant between two events) a motion is
followed by one of two step kernels, whose results tell whether the step is valid. In a
step that is not, kernels of a search follow it from event to event: each result of a
search is its next argument. `follow` runs the steps and the searches without the
interpreter.

A row is a state and two numbers. Of a regular step these are whether its begin and its
end are valid, 1 or 0. Of a step with events they are a result of the search and `EVENT`.
"""

from array import array
from collections.abc import Callable
import ctypes
from functools import cache
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.native.machine_code import llvm
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.runtime.loops import address

EVENT = 2.0  # the last number of the row of a step with events
NUMBER = 8  # bytes


class SearchPlaces(NamedTuple):
    """
    Places of what the loop reads and writes in the row of a search.

    Attributes
    ----------
    phase, passed, events, result, special, end : int
        The phase; the time in the step, and the number of events, both 0 at the
        beginning; a result; whether the modes need the second of the step kernels; and 0
        until the search ends, then 1 if it followed the whole step.
    modes, state : slice
        The modes as the step kernels need them, and the state.

    """

    phase: int
    passed: int
    events: int
    result: int
    special: int
    end: int
    modes: slice
    state: slice


class EventKernels(NamedTuple):
    """
    Kernels of steps and searches.

    Attributes
    ----------
    plain, special : Kernel
        Steps, with the arguments state, inputs and modes.
    early, late : Kernel
        Searches in a phase below 0.5, and in later ones, with the arguments
        search and inputs.

    """

    plain: Kernel
    special: Kernel
    early: Kernel
    late: Kernel


WORDS = ('plain', 'special', 'early', 'late', 'rows', 'width', 'size', 'inputs', 'stride',
         'search', 'modes', 'constants', 'count', 'limit', 'state', 'end',
         'kind', 'result', 'phase', 'events', 'passed', 'margin')

FOLLOW = """
; The words of the table are WORDS. Return the number of steps, or its complement where the margin
; of the next state is not positive.
define i64 @follow(ptr %table, i64 %has.modes, double %fresh, double %known) {
start:
LOADS
  %slots = alloca [5 x ptr]
  %begins = icmp ne i64 %has.modes, 0
  br label %next
next:
  %i = phi i64 [0, %start], [%i.stepped, %stepped], [%i.done, %kept]
  %regular = phi i1 [false, %start], [true, %stepped], [false, %kept]
  %modes.known = phi i1 [%begins, %start], [true, %stepped], [true, %kept]
  %more = icmp slt i64 %i, %count
  br i1 %more, label %row, label %done
row:
  %row.offset = mul i64 %i, %width
  %row.at = getelementptr i8, ptr %rows, i64 %row.offset
  %after.at = getelementptr i8, ptr %row.at, i64 %width
  %input.offset = mul i64 %i, %stride
  %input.at = getelementptr i8, ptr %inputs, i64 %input.offset
  br i1 %modes.known, label %step, label %restart

; A regular step: the kernel of these modes. Its row ends with whether begin and end are valid.
step:
  %kind.value = load double, ptr %kind
  %is.special = fcmp une double %kind.value, 0.0
  %step.kernel = select i1 %is.special, ptr %special, ptr %plain
  store ptr %row.at, ptr %slots
  %slot.1 = getelementptr ptr, ptr %slots, i64 1
  store ptr %input.at, ptr %slot.1
  %slot.2 = getelementptr ptr, ptr %slots, i64 2
  store ptr %modes, ptr %slot.2
  %slot.3 = getelementptr ptr, ptr %slots, i64 3
  store ptr %constants, ptr %slot.3
  %slot.4 = getelementptr ptr, ptr %slots, i64 4
  store ptr %after.at, ptr %slot.4
  call void %step.kernel(ptr %slots)
  %begin.at = getelementptr i8, ptr %after.at, i64 %size
  %begin = load double, ptr %begin.at
  %end.at = getelementptr i8, ptr %begin.at, i64 8
  %ended = load double, ptr %end.at
  %begin.good = fcmp ogt double %begin, 0.5
  %end.good = fcmp ogt double %ended, 0.5
  %good = and i1 %begin.good, %end.good
  br i1 %good, label %stepped, label %invalid
stepped:
  %i.stepped = add i64 %i, 1
  br label %next

; An event in this step, before its beginning in the last step, or at its beginning.
invalid:
  %watched = icmp sge i64 %margin, 0
  br i1 %watched, label %watch, label %look
watch:
  %margin.at = getelementptr i8, ptr %after.at, i64 %margin
  %margin.value = load double, ptr %margin.at
  %regular.state = fcmp ogt double %margin.value, 0.0
  br i1 %regular.state, label %look, label %stop
; With a valid begin the event is within this step. Otherwise it may be in the last one, if that
; was regular, and else at the begin, from where the modes are found afresh.
look:
  br i1 %begin.good, label %within, label %before
within:
  %within.end = call double @search(ptr %table, ptr %row.at, ptr %input.at, double %known)
  br label %found
before:
  br i1 %regular, label %back, label %restart
back:
  %minus.width = sub i64 0, %width
  %last.at = getelementptr i8, ptr %row.at, i64 %minus.width
  %i.last = sub i64 %i, 1
  %minus.stride = sub i64 0, %stride
  %last.input.at = getelementptr i8, ptr %input.at, i64 %minus.stride
  %back.end = call double @search(ptr %table, ptr %last.at, ptr %last.input.at,
                                  double %known)
  %back.whole = fcmp oeq double %back.end, 1.0
  br i1 %back.whole, label %compare, label %found
compare:
  %back.events = load double, ptr %events
  %earlier = fcmp ogt double %back.events, 0.5
  br i1 %earlier, label %found, label %restart
restart:
  %restart.end = call double @search(ptr %table, ptr %row.at, ptr %input.at, double %fresh)
  br label %found
found:
  %target = phi ptr [%after.at, %within], [%row.at, %back], [%row.at, %compare],
                    [%after.at, %restart]
  %i.begun = phi i64 [%i, %within], [%i.last, %back], [%i.last, %compare], [%i, %restart]
  %status = phi double [%within.end, %within], [%back.end, %back], [%back.end, %compare],
                       [%restart.end, %restart]
  %whole = fcmp oeq double %status, 1.0
  br i1 %whole, label %kept, label %refused
; The search followed a whole step: its state and result are the row, marked if there was an event.
kept:
  call void @llvm.memcpy.p0.p0.i64(ptr %target, ptr %state, i64 %size, i1 false)
  %result.value = load double, ptr %result
  %result.at = getelementptr i8, ptr %target, i64 %size
  store double %result.value, ptr %result.at
  %count.of.events = load double, ptr %events
  %any.events = fcmp ogt double %count.of.events, 0.5
  %mark = select i1 %any.events, double 2.0, double 1.0
  %mark.at = getelementptr i8, ptr %result.at, i64 8
  store double %mark, ptr %mark.at
  %i.done = add i64 %i.begun, 1
  br label %next
stop:
  %i.stopped = xor i64 %i, -1
  ret i64 %i.stopped
refused:
  ret i64 %i.begun
done:
  ret i64 %i
}

; Follow a step by a search, from a phase on. Return how it ended, 0 at the limit of calls.
define internal double @search(ptr %table, ptr %row, ptr %input, double %first) {
start:
LOADS
  %slots = alloca [5 x ptr]
  call void @llvm.memcpy.p0.p0.i64(ptr %state, ptr %row, i64 %size, i1 false)
  store double %first, ptr %phase
  store double 0.0, ptr %passed
  store double 0.0, ptr %events
  store double 0.0, ptr %result
  store double 0.0, ptr %end
  br label %call
call:
  %i = phi i64 [0, %start], [%i.next, %again]
  %phase.value = load double, ptr %phase
  %is.early = fcmp olt double %phase.value, 0.5
  %kernel = select i1 %is.early, ptr %early, ptr %late
  store ptr %search, ptr %slots
  %slot.1 = getelementptr ptr, ptr %slots, i64 1
  store ptr %input, ptr %slot.1
  %slot.2 = getelementptr ptr, ptr %slots, i64 2
  store ptr %constants, ptr %slot.2
  %slot.3 = getelementptr ptr, ptr %slots, i64 3
  store ptr %search, ptr %slot.3
  call void %kernel(ptr %slots)
  %end.value = load double, ptr %end
  %ends = fcmp une double %end.value, 0.0
  %i.next = add i64 %i, 1
  br i1 %ends, label %done, label %again
again:
  %more = icmp slt i64 %i.next, %limit
  br i1 %more, label %call, label %done
done:
  ret double %end.value
}

declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)
"""


def follow(kernels: EventKernels, places: SearchPlaces, search: Array, rows: Array,
           inputs: Array, constants: Array, *, phases: tuple[float, float], limit: int,
           has_modes: bool = False, margin: int | None = None) -> tuple[int, bool]:
    """
    Compute the rows of steps one after the other, through their events, without the GIL.

    Nothing is checked.

    Parameters
    ----------
    kernels : EventKernels
        Of steps and searches.
    places : SearchPlaces
        Of the entries of `search`.
    search : float64 array
        The row of a search; holds the modes after the last computed row.
    rows : (K + 1, size + 2) float64 array
        The first row has the first state; the others are computed.
    inputs : float64 array
        Of all K steps, or (1, ...) of one that all share; rows are C-contiguous.
    constants : float64 array
        The last argument of all kernels.
    phases : two floats
        Phases from which a search begins: with modes that it finds itself, and with
        those of the last row.
    limit : int
        Number of calls in one search.
    has_modes : bool
        Whether `search` has the modes of the first row. Otherwise a search follows the
        first step.
    margin : int, optional
        Place of a number in states that is positive in all that are accepted.

    Returns
    -------
    int
        Number of steps that were computed: fewer than K if a search does not follow the
        next one.
    bool
        Whether the next state was not accepted; it is in its row.

    """
    begin = address(search)

    # The addresses of entries in the row of the search.
    def at(place: Any) -> int:
        start = place.start if isinstance(place, slice) else place
        return begin + NUMBER * int(start)
    state_bytes = NUMBER * (rows.shape[1] - 2)
    stride = inputs.strides[0] if len(inputs) > 1 else 0
    margin_bytes = -1 if margin is None else NUMBER * margin
    table = array('q', (
        # In the order of WORDS.
        *(kernel.address for kernel in kernels), address(rows), rows.strides[0],
        state_bytes, address(inputs), stride, begin, at(places.modes), address(constants),
        len(rows) - 1, limit, at(places.state), at(places.end), at(places.special),
        at(places.result), at(places.phase), at(places.events), at(places.passed),
        margin_bytes))
    # The complement says that the next state was not accepted.
    count = _follow()(table.buffer_info()[0], has_modes, *phases)
    if count < 0:
        return ~count, True
    return count, False


@cache
def _library() -> llvm.Code:
    """Return the machine code of `FOLLOW`."""
    pointers = set(WORDS) - {'width', 'size', 'stride', 'count', 'limit', 'margin'}
    # Load every word of the table under its name.
    loads = []
    for place, word in enumerate(WORDS):
        kind = 'ptr' if word in pointers else 'i64'
        loads.append(f'  %word.{place} = getelementptr i64, ptr %table, i64 {place}')
        loads.append(f'  %{word} = load {kind}, ptr %word.{place}')
    text = FOLLOW.replace('LOADS', '\n'.join(loads)).replace('WORDS', ', '.join(WORDS))
    return llvm.library('event_loop', text)


@cache
def _follow() -> Callable[..., int]:
    prototype = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p, ctypes.c_int64,
                                 ctypes.c_double, ctypes.c_double)
    function: Callable[..., int] = _library().function('follow', prototype)
    return function
