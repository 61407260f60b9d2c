"""
A native thread that answers serialized messages without the interpreter.

The thread waits for messages, runs a cycle of compiled rules for each of them, publishes
the result, and reports each cycle in a ring that Python reads when it can. It never
takes the interpreter's lock and allocates nothing. The functions of the middleware are
passed by their addresses, so that this module knows no middleware.

Memory that both sides use has the layouts below; each entry is a word of 8 bytes.

- The block: pointers, counters and functions, written before the thread starts. Only
  `PLAN`, `STOP` and `SIMULATED` are written by Python afterwards, and `TAIL` by the reader.
- A plan: what Python may change while the thread runs. It is never changed itself: Python
  writes a new one and then its address into the block. The thread reads the address once
  a cycle and states in `IN_USE` which one it uses, so that one cycle uses one
  consistent plan, and Python knows which ones are free.
- A layout of messages: what is equal in all messages of a publisher, and where the
  numbers are.
- A motion: polynomials of its segments, with one constant segment before and one after.
- An output: a publisher with its message, and where its numbers and its stamp are.
- An input: a subscription beside that of the states, and what receives its messages.

Where the middleware fails to return a message, the thread rests shortly, so that it does
not spin, and counts the failure. After many of one subscription in a row it ends, as where
it cannot wait: it publishes zeros and states the code in `ENDED`.
"""

import ctypes
from functools import cache
import re
from typing import Any

from kane_dynamics.native.machine_code import llvm

# Words of the block.
BLOCK = ('PLAN', 'IN_USE', 'STOP', 'ENDED', 'RING', 'SLOTS', 'SLOT_SIZE', 'HEAD', 'TAIL',
         'LOST', 'EPOCH', 'WAIT_SET', 'SUBSCRIPTION', 'GUARD', 'CLEAR',
         'ADD_SUBSCRIPTION', 'ADD_GUARD', 'WAIT', 'TAKE', 'PUBLISH', 'CLOCK',
         'CLOCK_HANDLE', 'STEADY', 'TAKEN', 'INFO', 'OUTPUTS',
         'OUTPUT_COUNT', 'PATH', 'RESULT', 'PATH_SIZE', 'EVENT', 'STATE', 'STATE_COUNT',
         'TAU', 'TAU_COUNT', 'REPLAYED', 'CYCLES', 'UNSENT', 'BEGAN', 'LARGEST',
         # Of the clock's messages, if it is simulated, and of those of torque_guard.
         'CLOCK_INPUT', 'SIMULATED', 'SIMULATED_TIME', 'GUARD_INPUT', 'GUARD_LENGTH',
         'GUARD_AT', 'GUARD_NUMBERS', 'GUARD_BYTES', 'REQUEST_TO', 'REQUEST_MESSAGE',
         'REQUEST_NUMBER', 'KEPT', 'KEPT_LENGTH',
         # Failures of the middleware to return a message: all, those of the states in a
         # row, and the code with which the thread ends; how it rests.
         'NOT_TAKEN', 'FAILURES', 'BROKEN', 'REST_FOR')
# Words of a plan. `REPLAY` numbers a message that Python passes to the thread.
PLAN = ('PERIOD', 'LAYOUTS', 'LAYOUT_COUNT', 'REPLAY', 'REPLAY_DATA', 'REPLAY_LENGTH',
        'JUDGE', 'JUDGE_TABLE', 'ANSWER', 'ANSWER_TABLE', 'REFUSE', 'REFUSE_TABLE',
        # With closed loops: of the measured and of the desired configuration, and the
        # torque of a stop.
        'CLOSE', 'CLOSE_TABLE', 'CLOSING', 'CLOSING_TABLE', 'AIM', 'AIM_TABLE', 'AIMING',
        'AIMING_TABLE', 'HOLD', 'HOLD_TABLE',
        'ELAPSE', 'ELAPSE_TABLE', 'PERMIT', 'PERMIT_TABLE', 'CONFIRM', 'CONFIRM_TABLE',
        'HEAR', 'HEAR_TABLE', 'LONGEST', 'MOTION', 'NEXT_MOTION', 'REST')
OUTPUT = ('PUBLISHER', 'BYTES', 'NUMBERS', 'STAMP_TO')
INPUT = ('FROM', 'INTO', 'INFO_OF', 'FAILURES_OF')
LAYOUT = ('LENGTH', 'MASK', 'EXPECTED', 'COUNT', 'OFFSETS', 'PLACES', 'CONSTANTS')
MOTION = ('START', 'KNOTS', 'TIMES', 'ORIGINS', 'RATES', 'ROWS', 'ROW_SIZE')
# Words of a slot of the ring, before the event, the state of the path and the message.
SLOT = ('KIND', 'MESSAGE_LENGTH', 'ALL_LOST', 'BEGIN', 'END', 'SEQUENCE', 'NOTHING',
        'MESSAGE_AT')
ANSWERED, UNKNOWN, ELAPSED, HEARD = range(4)  # kinds of slots
# Doubles of an event.
NOW, STAMP, MOVING, X, TICKING, STEADILY, MOMENT = range(7)
# Doubles of the state of the path that the loop itself reads.
REASON, DOES_PUBLISH, SENT_AT, REQUEST, RETRIES, SEARCHING = range(6)
WAITS = 2.0  # the reason of a state that is kept until torque_guard answers
ROW_PLACE = 3  # place of the row of the motion in the table of the answer
MESSAGE = 4  # bytes of encapsulation before the stamp of a message
CLOCK_LENGTH = 12  # bytes of a message of /clock
SEQUENCE_AT = 2  # word of the publisher's sequence number in the message info
TAKE_LIMIT = 64  # messages in a row before the time is looked at
NOTHING_TAKEN = 401  # the code of rcl if there is no message
PAUSE = 1000  # us, after a failure to take a message
MOST_FAILURES = 1000  # of a subscription in a row, after which the thread ends
WORDS = {'block': BLOCK, 'plan': PLAN, 'layout': LAYOUT, 'motion': MOTION,
         'upcoming': MOTION, 'slot': SLOT, 'output': OUTPUT, 'input': INPUT}

TEXT = """
; The clock, ns since the epoch of the path; the event says whether it runs.
define i64 @now(ptr %block) {
start:
  %time = alloca i64
  store i64 0, ptr %time
  %simulated.at = getelementptr i64, ptr %block, i64 SIMULATED
  %simulated = load atomic i64, ptr %simulated.at acquire, align 8
  %is.simulated = icmp ne i64 %simulated, 0
  br i1 %is.simulated, label %message, label %clock
message:
  %latest = number %block.SIMULATED_TIME
  store i64 %latest, ptr %time
  br label %read
clock:
  %function = pointer %block.CLOCK
  %handle = pointer %block.CLOCK_HANDLE
  %_ = call i32 %function(ptr %handle, ptr %time)
  br label %read
read:
  %all = load i64, ptr %time
  %runs = icmp ne i64 %all, 0
  %ticking = uitofp i1 %runs to double
  call void @set_event(ptr %block, i64 TICKING, double %ticking)
  %epoch = number %block.EPOCH
  %since = sub i64 %all, %epoch
  %since.ns = sitofp i64 %since to double
  call void @set_event(ptr %block, i64 NOW, double %since.ns)
  ret i64 %since
}

; Steady time, ns, of which reports have the duration of a cycle.
define i64 @steady(ptr %block) {
  %time = alloca [2 x i64]
  %clock = pointer %block.STEADY
  %_ = call i32 %clock(i32 1, ptr %time)
  %s = load i64, ptr %time
  %ns.at = getelementptr i64, ptr %time, i64 1
  %ns = load i64, ptr %ns.at
  %s.ns = mul i64 %s, 1000000000
  %all = add i64 %s.ns, %ns
  ret i64 %all
}

; The same, for the rules.
define i64 @steady_event(ptr %block) {
  %all = call i64 @steady(ptr %block)
  %all.ns = sitofp i64 %all to double
  call void @set_event(ptr %block, i64 STEADILY, double %all.ns)
  ret i64 %all
}

; Let a rule compute the next state of the path.
define void @step(ptr %block, ptr %rule, ptr %table) {
  call void %rule(ptr %table)
  call void @keep_result(ptr %block)
  ret void
}

; Let a rule search a configuration of closed loops, call by call.
define void @search(ptr %block, ptr %rule, ptr %table) {
start:
  br label %turn
turn:
  %needs = call double @of_path(ptr %block, i64 SEARCHING)
  %goes.on = fcmp ogt double %needs, 0.5
  br i1 %goes.on, label %once, label %done
once:
  call void @step(ptr %block, ptr %rule, ptr %table)
  br label %turn
done:
  ret void
}

define void @keep_result(ptr %block) {
  %path = pointer %block.PATH
  %result = pointer %block.RESULT
  %entries = number %block.PATH_SIZE
  %bytes = mul i64 %entries, 8
  call void @llvm.memcpy.p0.p0.i64(ptr %path, ptr %result, i64 %bytes, i1 false)
  ret void
}

define void @set_event(ptr %block, i64 %k, double %value) {
  %event = pointer %block.EVENT
  %at = getelementptr double, ptr %event, i64 %k
  store double %value, ptr %at
  ret void
}

define double @of_path(ptr %block, i64 %k) {
  %path = pointer %block.PATH
  %at = getelementptr double, ptr %path, i64 %k
  %value = load double, ptr %at
  ret double %value
}

; Publish the torques, and a request to torque_guard, if the cycle says so.
define void @send(ptr %block) {
start:
  %does = call double @of_path(ptr %block, i64 DOES_PUBLISH)
  %yes = fcmp ogt double %does, 0.5
  br i1 %yes, label %write, label %asks
write:
  %count = number %block.OUTPUT_COUNT
  br label %each
each:
  %k = phi i64 [0, %write], [%k.next, %each]
  call void @send_to(ptr %block, i64 %k)
  %k.next = add i64 %k, 1
  %more = icmp slt i64 %k.next, %count
  br i1 %more, label %each, label %asks
asks:
  %request = call double @of_path(ptr %block, i64 REQUEST)
  %any = fcmp ogt double %request, -0.5
  %to = pointer %block.REQUEST_TO
  %known = icmp ne ptr %to, null
  %both = and i1 %any, %known
  br i1 %both, label %ask, label %done
ask:
  %number.at = pointer %block.REQUEST_NUMBER
  store double %request, ptr %number.at
  %message = pointer %block.REQUEST_MESSAGE
  call void @publish(ptr %block, ptr %to, ptr %message)
  br label %done
done:
  ret void
}

; Copy the torques and their stamp into the message of an output, and publish it.
define void @send_to(ptr %block, i64 %k) {
start:
  %outputs = pointer %block.OUTPUTS
  %output.place = mul i64 %k, OUTPUT_WORDS
  %output = getelementptr i64, ptr %outputs, i64 %output.place
  %path = pointer %block.PATH
  %tau.place = number %block.TAU
  %tau = getelementptr double, ptr %path, i64 %tau.place
  %n = number %block.TAU_COUNT
  %bytes = mul i64 %n, 8
  %numbers = pointer %output.NUMBERS
  call void @llvm.memcpy.p0.p0.i64(ptr %numbers, ptr %tau, i64 %bytes, i1 false)
  %stamp.at = pointer %output.STAMP_TO
  %stamped = icmp ne ptr %stamp.at, null
  br i1 %stamped, label %stamps, label %publishes
stamps:
  %sent = call double @of_path(ptr %block, i64 SENT_AT)
  %sent.ns = fptosi double %sent to i64
  %epoch = number %block.EPOCH
  %stamp = add i64 %sent.ns, %epoch
  %s = sdiv i64 %stamp, 1000000000
  %s.ns = mul i64 %s, 1000000000
  %ns = sub i64 %stamp, %s.ns
  %s.32 = trunc i64 %s to i32
  %ns.32 = trunc i64 %ns to i32
  store i32 %s.32, ptr %stamp.at
  %ns.at = getelementptr i32, ptr %stamp.at, i64 1
  store i32 %ns.32, ptr %ns.at
  br label %publishes
publishes:
  %to = pointer %output.PUBLISHER
  %message = pointer %output.BYTES
  call void @publish(ptr %block, ptr %to, ptr %message)
  ret void
}

; Publish a message; count it if the middleware refuses it.
define void @publish(ptr %block, ptr %to, ptr %message) {
  %function = pointer %block.PUBLISH
  %code = call i32 %function(ptr %to, ptr %message, ptr null)
  %bad = icmp ne i32 %code, 0
  %bad.64 = zext i1 %bad to i64
  %unsent = number %block.UNSENT
  %unsent.then = add i64 %unsent, %bad.64
  %unsent.then -> %block.UNSENT
  ret void
}

; Report a cycle in the ring, without a message that a slot cannot hold; count it if the
; ring is full.
define void @report(ptr %block, i64 %kind, ptr %data, i64 %all.length) {
start:
  %largest = number %block.LARGEST
  %fits = icmp ule i64 %all.length, %largest
  %length = select i1 %fits, i64 %all.length, i64 0
  %head = number %block.HEAD
  %tail.at = getelementptr i64, ptr %block, i64 TAIL
  %tail = load atomic i64, ptr %tail.at acquire, align 8
  %used = sub i64 %head, %tail
  %slots = number %block.SLOTS
  %free = icmp slt i64 %used, %slots
  br i1 %free, label %write, label %full
full:
  %lost = number %block.LOST
  %lost.then = add i64 %lost, 1
  %lost.then -> %block.LOST
  ret void
write:
  %ring = pointer %block.RING
  %place = urem i64 %head, %slots
  %size = number %block.SLOT_SIZE
  %offset = mul i64 %place, %size
  %slot = getelementptr i8, ptr %ring, i64 %offset
  %kind -> %slot.KIND
  %length -> %slot.MESSAGE_LENGTH
  %all.lost = number %block.LOST
  %all.lost -> %slot.ALL_LOST
  %began = number %block.BEGAN
  %began -> %slot.BEGIN
  %end = call i64 @steady(ptr %block)
  %end -> %slot.END
  %info = pointer %block.INFO
  %sequence.at = getelementptr i64, ptr %info, i64 SEQUENCE_AT
  %sequence = load i64, ptr %sequence.at
  %sequence -> %slot.SEQUENCE
  %event = pointer %block.EVENT
  %event.to = getelementptr i64, ptr %slot, i64 SLOT_WORDS
  call void @llvm.memcpy.p0.p0.i64(ptr %event.to, ptr %event, i64 EVENT_BYTES, i1 false)
  %path = pointer %block.PATH
  %path.to = getelementptr i8, ptr %event.to, i64 EVENT_BYTES
  %entries = number %block.PATH_SIZE
  %bytes = mul i64 %entries, 8
  call void @llvm.memcpy.p0.p0.i64(ptr %path.to, ptr %path, i64 %bytes, i1 false)
  %message.to = getelementptr i8, ptr %path.to, i64 %bytes
  call void @llvm.memcpy.p0.p0.i64(ptr %message.to, ptr %data, i64 %length, i1 false)
  %head.at = getelementptr i64, ptr %block, i64 HEAD
  %head.then = add i64 %head, 1
  store atomic i64 %head.then, ptr %head.at release, align 8
  ret void
}

; Return whether a message has a layout: whether its bytes are equal where the mask is 1.
define i1 @matches(ptr %layout, ptr %data, i64 %length) {
start:
  %expected.length = number %layout.LENGTH
  %same = icmp eq i64 %expected.length, %length
  %mask = pointer %layout.MASK
  %expected = pointer %layout.EXPECTED
  br i1 %same, label %byte, label %no
byte:
  %k = phi i64 [0, %start], [%k.next, %byte]
  %all = phi i8 [0, %start], [%all.next, %byte]
  %data.at = getelementptr i8, ptr %data, i64 %k
  %mask.at = getelementptr i8, ptr %mask, i64 %k
  %expected.at = getelementptr i8, ptr %expected, i64 %k
  %x = load i8, ptr %data.at
  %m = load i8, ptr %mask.at
  %e = load i8, ptr %expected.at
  %masked = and i8 %x, %m
  %difference = xor i8 %masked, %e
  %all.next = or i8 %all, %difference
  %k.next = add i64 %k, 1
  %more = icmp slt i64 %k.next, %length
  br i1 %more, label %byte, label %decide
decide:
  %equal = icmp eq i8 %all.next, 0
  ret i1 %equal
no:
  ret i1 false
}

; Copy the numbers of a message into the state; what the layout lacks is constant.
define void @gather(ptr %block, ptr %layout, ptr %data) {
start:
  %state = pointer %block.STATE
  %n = number %block.STATE_COUNT
  %bytes = mul i64 %n, 8
  %constants = pointer %layout.CONSTANTS
  call void @llvm.memcpy.p0.p0.i64(ptr %state, ptr %constants, i64 %bytes, i1 false)
  %count = number %layout.COUNT
  %offsets = pointer %layout.OFFSETS
  %places = pointer %layout.PLACES
  br label %number
number:
  %k = phi i64 [0, %start], [%k.next, %number]
  %offset.at = getelementptr i64, ptr %offsets, i64 %k
  %offset = load i64, ptr %offset.at
  %from = getelementptr i8, ptr %data, i64 %offset
  %x = load double, ptr %from, align 1
  %place.at = getelementptr i64, ptr %places, i64 %k
  %place = load i64, ptr %place.at
  %to = getelementptr double, ptr %state, i64 %place
  store double %x, ptr %to
  %k.next = add i64 %k, 1
  %more = icmp slt i64 %k.next, %count
  br i1 %more, label %number, label %done
done:
  ret void
}

; Pass the segment of the motion at a time to the answer.
define void @find_segment(ptr %block, ptr %plan, i64 %stamp) {
start:
  %current = pointer %plan.MOTION
  %upcoming = pointer %plan.NEXT_MOTION
  %scheduled = icmp ne ptr %upcoming, null
  br i1 %scheduled, label %look, label %choose
look:
  %upcoming.start = number %upcoming.START
  %begun = icmp sge i64 %stamp, %upcoming.start
  br label %choose
choose:
  %next = phi i1 [false, %start], [%begun, %look]
  %motion = select i1 %next, ptr %upcoming, ptr %current
  %none = icmp eq ptr %motion, null
  br i1 %none, label %rest, label %search
rest:
  %rest.row = pointer %plan.REST
  call void @set_event(ptr %block, i64 MOVING, double 0.0)
  br label %pass
search:
  %motion.start = number %motion.START
  %since = sub i64 %stamp, %motion.start
  %since.ns = sitofp i64 %since to double
  %t = fdiv double %since.ns, 1.0e9
  call void @set_event(ptr %block, i64 MOVING, double 1.0)
  call void @set_event(ptr %block, i64 MOMENT, double %t)
  %knots = number %motion.KNOTS
  %times = pointer %motion.TIMES
  br label %bisect
bisect:  ; the number of knots up to t lies between low and high
  %low = phi i64 [0, %search], [%low.next, %half]
  %high = phi i64 [%knots, %search], [%high.next, %half]
  %open = icmp slt i64 %low, %high
  br i1 %open, label %half, label %found
half:
  %sum = add i64 %low, %high
  %middle = lshr i64 %sum, 1
  %time.at = getelementptr double, ptr %times, i64 %middle
  %time = load double, ptr %time.at
  %before = fcmp olt double %t, %time
  %above = add i64 %middle, 1
  %low.next = select i1 %before, i64 %low, i64 %above
  %high.next = select i1 %before, i64 %middle, i64 %high
  br label %bisect
found:
  %origins = pointer %motion.ORIGINS
  %origin.at = getelementptr double, ptr %origins, i64 %low
  %origin = load double, ptr %origin.at
  %rates = pointer %motion.RATES
  %rate.at = getelementptr double, ptr %rates, i64 %low
  %rate = load double, ptr %rate.at
  %from.origin = fsub double %t, %origin
  %x = fmul double %from.origin, %rate
  call void @set_event(ptr %block, i64 X, double %x)
  %rows = pointer %motion.ROWS
  %row.size = number %motion.ROW_SIZE
  %row.offset = mul i64 %low, %row.size
  %row.found = getelementptr double, ptr %rows, i64 %row.offset
  br label %pass
pass:
  %row = phi ptr [%rest.row, %rest], [%row.found, %found]
  %table = pointer %plan.ANSWER_TABLE
  %row.at = getelementptr ptr, ptr %table, i64 ROW_PLACE
  store ptr %row, ptr %row.at
  %aim.table = pointer %plan.AIM_TABLE
  %aims = icmp ne ptr %aim.table, null
  br i1 %aims, label %pass.too, label %done
pass.too:
  %aim.row.at = getelementptr ptr, ptr %aim.table, i64 ROW_PLACE
  store ptr %row, ptr %aim.row.at
  br label %done
done:
  ret void
}

; Answer one message: read and judge it, compute the command, publish it, report.
define void @cycle(ptr %block, ptr %plan, ptr %data, i64 %length) {
start:
  %began = call i64 @steady_event(ptr %block)
  %began -> %block.BEGAN
  %now = call i64 @now(ptr %block)
  %cycles = number %block.CYCLES
  %cycles.then = add i64 %cycles, 1
  %cycles.then -> %block.CYCLES
  %layouts = pointer %plan.LAYOUTS
  %layout.count = number %plan.LAYOUT_COUNT
  br label %candidate
candidate:
  %k = phi i64 [0, %start], [%k.next, %other]
  %left = icmp slt i64 %k, %layout.count
  br i1 %left, label %compare, label %unknown
compare:
  %layout.offset = mul i64 %k, LAYOUT_WORDS
  %layout = getelementptr i64, ptr %layouts, i64 %layout.offset
  %is = call i1 @matches(ptr %layout, ptr %data, i64 %length)
  br i1 %is, label %known, label %other
other:
  %k.next = add i64 %k, 1
  br label %candidate
unknown:  ; Python learns the layout and passes the message again
  call void @report(ptr %block, i64 UNKNOWN, ptr %data, i64 %length)
  ret void
known:
  call void @gather(ptr %block, ptr %layout, ptr %data)
  %header = call i64 @first_time(ptr %data)
  %epoch = number %block.EPOCH
  %since = sub i64 %header, %epoch
  %stamped = icmp ne i64 %header, 0
  %stamp = select i1 %stamped, i64 %since, i64 %now
  %stamp.ns = sitofp i64 %stamp to double
  call void @set_event(ptr %block, i64 STAMP, double %stamp.ns)
  %judge = pointer %plan.JUDGE
  %judge.table = pointer %plan.JUDGE_TABLE
  call void @step(ptr %block, ptr %judge, ptr %judge.table)
  %close = pointer %plan.CLOSE
  %has.loops = icmp ne ptr %close, null
  %reason.heard = call double @of_path(ptr %block, i64 REASON)
  %plausible = fcmp olt double %reason.heard, 0.5
  %closes = and i1 %has.loops, %plausible
  br i1 %closes, label %loops, label %closed
loops:
  %close.table = pointer %plan.CLOSE_TABLE
  call void @step(ptr %block, ptr %close, ptr %close.table)
  %closing = pointer %plan.CLOSING
  %closing.table = pointer %plan.CLOSING_TABLE
  call void @search(ptr %block, ptr %closing, ptr %closing.table)
  br label %closed
closed:
  %permit = pointer %plan.PERMIT
  %guarded = icmp ne ptr %permit, null
  br i1 %guarded, label %asks, label %judged
asks:
  %permit.table = pointer %plan.PERMIT_TABLE
  call void @step(ptr %block, ptr %permit, ptr %permit.table)
  br label %judged
judged:
  %reason.judged = call double @of_path(ptr %block, i64 REASON)
  %possible = fcmp olt double %reason.judged, 0.5
  br i1 %possible, label %command, label %impossible
command:
  %ahead = icmp slt i64 %now, %stamp
  %moment = select i1 %ahead, i64 %now, i64 %stamp
  call void @find_segment(ptr %block, ptr %plan, i64 %moment)
  %aim = pointer %plan.AIM
  %aiming = pointer %plan.AIMING
  %aiming.table = pointer %plan.AIMING_TABLE
  %aims = icmp ne ptr %aim, null
  br i1 %aims, label %aimed, label %compute
aimed:
  %aim.table = pointer %plan.AIM_TABLE
  call void @step(ptr %block, ptr %aim, ptr %aim.table)
  call void @search(ptr %block, ptr %aiming, ptr %aiming.table)
  %reason.aimed = call double @of_path(ptr %block, i64 REASON)
  %reachable = fcmp olt double %reason.aimed, 0.5
  br i1 %reachable, label %compute, label %impossible
compute:
  %answer = pointer %plan.ANSWER
  %answer.table = pointer %plan.ANSWER_TABLE
  call void %answer(ptr %answer.table)
  br i1 %guarded, label %measures, label %computed
measures:  ; a thread that was interrupted meanwhile asks again
  %computed.at = call i64 @steady_event(ptr %block)
  %took = sub i64 %computed.at, %began
  %longest = number %plan.LONGEST
  %late = icmp sgt i64 %took, %longest
  br i1 %late, label %confirms, label %computed
confirms:
  %confirm = pointer %plan.CONFIRM
  %confirm.table = pointer %plan.CONFIRM_TABLE
  call void @step(ptr %block, ptr %confirm, ptr %confirm.table)
  %reason.confirmed = call double @of_path(ptr %block, i64 REASON)
  %confirmed = fcmp olt double %reason.confirmed, 0.5
  br i1 %confirmed, label %computes, label %impossible
computes:  ; the result was overwritten
  call void %answer(ptr %answer.table)
  br label %computed
computed:
  call void @keep_result(ptr %block)
  %reason = call double @of_path(ptr %block, i64 REASON)
  %good = fcmp olt double %reason, 0.5
  br i1 %good, label %answered, label %refused
answered:
  %nothing = add i64 0, 0
  %nothing -> %block.KEPT_LENGTH
  br label %finish
impossible:
  %reason.then = call double @of_path(ptr %block, i64 REASON)
  %waits = fcmp oeq double %reason.then, WAITS
  %largest = number %block.LARGEST
  %fits = icmp ule i64 %length, %largest
  %keeps = and i1 %waits, %fits
  br i1 %keeps, label %keep, label %refused
keep:
  %kept = pointer %block.KEPT
  call void @llvm.memmove.p0.p0.i64(ptr %kept, ptr %data, i64 %length, i1 false)
  %length -> %block.KEPT_LENGTH
  br label %refused
refused:
  %refuse = pointer %plan.REFUSE
  %refuse.table = pointer %plan.REFUSE_TABLE
  call void @step(ptr %block, ptr %refuse, ptr %refuse.table)
  %hold = pointer %plan.HOLD
  %holds = icmp ne ptr %hold, null
  br i1 %holds, label %stop, label %finish
stop:
  %stop.search = pointer %plan.AIMING
  %stop.table = pointer %plan.AIMING_TABLE
  call void @search(ptr %block, ptr %stop.search, ptr %stop.table)
  %hold.table = pointer %plan.HOLD_TABLE
  call void @step(ptr %block, ptr %hold, ptr %hold.table)
  br label %finish
finish:
  call void @send(ptr %block)
  call void @report(ptr %block, i64 ANSWERED, ptr %data, i64 %length)
  ret void
}

; Look at the time between messages: zeros, if states stay away.
define void @look_at_time(ptr %block, ptr %plan) {
start:
  %steady = call i64 @steady_event(ptr %block)
  %now = call i64 @now(ptr %block)
  %drops = call double @of_path(ptr %block, i64 DROPS)
  %elapse = pointer %plan.ELAPSE
  %table = pointer %plan.ELAPSE_TABLE
  call void @step(ptr %block, ptr %elapse, ptr %table)
  call void @send(ptr %block)
  %drops.then = call double @of_path(ptr %block, i64 DROPS)
  %changed = fcmp one double %drops, %drops.then
  br i1 %changed, label %tell, label %done
tell:
  %path = pointer %block.PATH
  call void @report(ptr %block, i64 ELAPSED, ptr %path, i64 0)
  br label %done
done:
  ret void
}

; Hear torque_guard, and answer the state that waited for it.
define void @hear(ptr %block, ptr %plan, ptr %data, i64 %length) {
start:
  %expected = number %block.GUARD_LENGTH
  %same = icmp eq i64 %expected, %length
  br i1 %same, label %read, label %done
read:
  %began = call i64 @steady_event(ptr %block)
  %began -> %block.BEGAN
  %now = call i64 @now(ptr %block)
  %offset = number %block.GUARD_AT
  %from = getelementptr i8, ptr %data, i64 %offset
  %numbers = pointer %block.GUARD_NUMBERS
  %bytes = number %block.GUARD_BYTES
  call void @llvm.memcpy.p0.p0.i64(ptr %numbers, ptr %from, i64 %bytes, i1 false)
  %hear = pointer %plan.HEAR
  %table = pointer %plan.HEAR_TABLE
  call void @step(ptr %block, ptr %hear, ptr %table)
  call void @send(ptr %block)
  call void @report(ptr %block, i64 HEARD, ptr %data, i64 0)
  %retries = call double @of_path(ptr %block, i64 RETRIES)
  %again = fcmp ogt double %retries, 0.5
  %kept.length = number %block.KEPT_LENGTH
  %any = icmp sgt i64 %kept.length, 0
  %answers = and i1 %again, %any
  br i1 %answers, label %answer, label %done
answer:
  %nothing = add i64 0, 0
  %nothing -> %block.KEPT_LENGTH
  %kept = pointer %block.KEPT
  call void @cycle(ptr %block, ptr %plan, ptr %kept, i64 %kept.length)
  br label %done
done:
  ret void
}

; The time, ns, with which a message begins: of its header, or of /clock.
define i64 @first_time(ptr %data) {
start:
  %s.at = getelementptr i8, ptr %data, i64 MESSAGE
  %s.32 = load i32, ptr %s.at, align 1
  %ns.at = getelementptr i8, ptr %s.at, i64 4
  %ns.32 = load i32, ptr %ns.at, align 1
  %s = sext i32 %s.32 to i64
  %ns = zext i32 %ns.32 to i64
  %s.ns = mul i64 %s, 1000000000
  %time = add i64 %s.ns, %ns
  ret i64 %time
}

; Read the simulated time of a message of /clock.
define void @hear_clock(ptr %block, ptr %plan, ptr %data, i64 %length) {
start:
  %enough = icmp sge i64 %length, CLOCK_LENGTH
  br i1 %enough, label %read, label %done
read:
  %time = call i64 @first_time(ptr %data)
  %time -> %block.SIMULATED_TIME
  br label %done
done:
  ret void
}

; Return whether a message was taken. After a failure the thread rests; `failures` counts
; those of a subscription in a row.
define i1 @was_taken(ptr %block, i32 %code, ptr %failures) {
start:
  switch i32 %code, label %failed [i32 0, label %taken
                                   i32 NOTHING_TAKEN, label %none]
taken:
  store i64 0, ptr %failures
  ret i1 true
none:
  ret i1 false
failed:
  %all = number %block.NOT_TAKEN
  %all.then = add i64 %all, 1
  %all.then -> %block.NOT_TAKEN
  %count = load i64, ptr %failures
  %count.then = add i64 %count, 1
  store i64 %count.then, ptr %failures
  %rest = pointer %block.REST_FOR
  %_ = call i32 %rest(i32 PAUSE)
  %few = icmp slt i64 %count.then, MOST_FAILURES
  br i1 %few, label %none, label %breaks
breaks:
  %broken = zext i32 %code to i64
  %broken -> %block.BROKEN
  ret i1 false
}

; Take all messages of an input, if there is one, and pass each to a function.
define void @take_all(ptr %block, ptr %plan, ptr %input, ptr %use) {
start:
  %none = icmp eq ptr %input, null
  br i1 %none, label %done, label %begin
begin:
  %from = pointer %input.FROM
  %into = pointer %input.INTO
  %info = pointer %input.INFO_OF
  %failures = pointer %input.FAILURES_OF
  %taker = pointer %block.TAKE
  br label %take
take:
  %k = phi i64 [0, %begin], [%k.next, %taken]
  %code = call i32 %taker(ptr %from, ptr %into, ptr %info, ptr null)
  %took = call i1 @was_taken(ptr %block, i32 %code, ptr %failures)
  br i1 %took, label %taken, label %done
taken:
  %data = load ptr, ptr %into
  %length.at = getelementptr i64, ptr %into, i64 1
  %length = load i64, ptr %length.at
  call void %use(ptr %block, ptr %plan, ptr %data, i64 %length)
  %k.next = add i64 %k, 1
  %few = icmp slt i64 %k.next, TAKE_LIMIT
  br i1 %few, label %take, label %done
done:
  ret void
}

; Wait for the subscription of an input too, if there is one.
define i32 @add_input(ptr %block, ptr %input) {
start:
  %none = icmp eq ptr %input, null
  br i1 %none, label %done, label %adds
adds:
  %set = pointer %block.WAIT_SET
  %add = pointer %block.ADD_SUBSCRIPTION
  %from = pointer %input.FROM
  %code = call i32 %add(ptr %set, ptr %from, ptr null)
  ret i32 %code
done:
  ret i32 0
}

; State which plan is in use, after the last read of the one before, which Python may free.
define void @state_plan(ptr %block, ptr %plan) {
  %at = getelementptr i64, ptr %block, i64 IN_USE
  %number = ptrtoint ptr %plan to i64
  store atomic i64 %number, ptr %at release, align 8
  ret void
}

; The thread: wait, answer the messages that are there, look at the time.
define ptr @run(ptr %block) {
start:
  br label %turn
turn:
  %plan.at = getelementptr i64, ptr %block, i64 PLAN
  %plan = load atomic ptr, ptr %plan.at acquire, align 8
  call void @state_plan(ptr %block, ptr %plan)
  %stop.at = getelementptr i64, ptr %block, i64 STOP
  %stop = load atomic i64, ptr %stop.at acquire, align 8
  %stops = icmp ne i64 %stop, 0
  br i1 %stops, label %end, label %replays
replays:
  %replay = number %plan.REPLAY
  %replayed = number %block.REPLAYED
  %again = icmp ne i64 %replay, %replayed
  br i1 %again, label %replaying, label %waits
replaying:
  %replay -> %block.REPLAYED
  %replay.data = pointer %plan.REPLAY_DATA
  %replay.length = number %plan.REPLAY_LENGTH
  call void @cycle(ptr %block, ptr %plan, ptr %replay.data, i64 %replay.length)
  br label %waits
waits:
  %set = pointer %block.WAIT_SET
  %subscription = pointer %block.SUBSCRIPTION
  %guard = pointer %block.GUARD
  %clear = pointer %block.CLEAR
  %clear.code = call i32 %clear(ptr %set)
  %add = pointer %block.ADD_SUBSCRIPTION
  %add.code = call i32 %add(ptr %set, ptr %subscription, ptr null)
  %clock.input = pointer %block.CLOCK_INPUT
  %clock.code = call i32 @add_input(ptr %block, ptr %clock.input)
  %guard.input = pointer %block.GUARD_INPUT
  %input.code = call i32 @add_input(ptr %block, ptr %guard.input)
  %add.guard = pointer %block.ADD_GUARD
  %guard.code = call i32 %add.guard(ptr %set, ptr %guard, ptr null)
  %wait = pointer %block.WAIT
  %period = number %plan.PERIOD
  %wait.code = call i32 %wait(ptr %set, i64 %period)
  ; 0: something is ready, 2: the time is over
  %other.codes = and i32 %wait.code, -3
  %set.codes = or i32 %clear.code, %add.code
  %input.codes = or i32 %clock.code, %input.code
  %both.codes = or i32 %set.codes, %input.codes
  %all.codes = or i32 %both.codes, %guard.code
  %bad.codes = or i32 %all.codes, %other.codes
  %bad = icmp ne i32 %bad.codes, 0
  %bad.64 = zext i32 %bad.codes to i64
  br i1 %bad, label %fail, label %reads
reads:
  ; The plan again, because it may have changed while the thread waited.
  %fresh = load atomic ptr, ptr %plan.at acquire, align 8
  call void @state_plan(ptr %block, ptr %fresh)
  ; The time first: states are not ahead of it then.
  call void @take_all(ptr %block, ptr %fresh, ptr %clock.input, ptr @hear_clock)
  br label %take
take:
  %taken.count = phi i64 [0, %reads], [%taken.next, %answered]
  %taker = pointer %block.TAKE
  %message = pointer %block.TAKEN
  %info = pointer %block.INFO
  %take.code = call i32 %taker(ptr %subscription, ptr %message, ptr %info, ptr null)
  %failures = pointer %block.FAILURES
  %took = call i1 @was_taken(ptr %block, i32 %take.code, ptr %failures)
  br i1 %took, label %answered, label %look
answered:
  %data = load ptr, ptr %message
  %length.at = getelementptr i64, ptr %message, i64 1
  %length = load i64, ptr %length.at
  call void @cycle(ptr %block, ptr %fresh, ptr %data, i64 %length)
  %taken.next = add i64 %taken.count, 1
  %few = icmp slt i64 %taken.next, TAKE_LIMIT
  br i1 %few, label %take, label %look
look:
  call void @take_all(ptr %block, ptr %fresh, ptr %guard.input, ptr @hear)
  call void @look_at_time(ptr %block, ptr %fresh)
  %broken = number %block.BROKEN
  %breaks = icmp ne i64 %broken, 0
  br i1 %breaks, label %fail, label %turn
fail:  ; no state can come any more: zeros
  %code = phi i64 [%bad.64, %waits], [%broken, %look]
  %path = pointer %block.PATH
  %tau.place = number %block.TAU
  %tau = getelementptr double, ptr %path, i64 %tau.place
  %n = number %block.TAU_COUNT
  %tau.bytes = mul i64 %n, 8
  call void @llvm.memset.p0.i64(ptr %tau, i8 0, i64 %tau.bytes, i1 false)
  %does.at = getelementptr double, ptr %path, i64 DOES_PUBLISH
  store double 1.0, ptr %does.at
  %request.at = getelementptr double, ptr %path, i64 REQUEST
  store double 0.0, ptr %request.at
  call void @send(ptr %block)
  %code -> %block.ENDED
  br label %end
end:
  ret ptr null
}

; Answer a message again and again, with the present time as its stamp, for measurements. Without
; `works` only the clocks are read.
define void @repeat_cycles(ptr %block, ptr %data, i64 %length, i64 %count, ptr %durations,
                           i1 zeroext %works) {
start:
  %plan = pointer %block.PLAN
  %any = icmp sgt i64 %count, 0
  br i1 %any, label %message, label %done
message:
  %k = phi i64 [0, %start], [%k.next, %finish]
  %before = call i64 @steady(ptr %block)
  %now = call i64 @now(ptr %block)
  %epoch = number %block.EPOCH
  %stamp = add i64 %now, %epoch
  %s = sdiv i64 %stamp, 1000000000
  %s.ns = mul i64 %s, 1000000000
  %ns = sub i64 %stamp, %s.ns
  %s.32 = trunc i64 %s to i32
  %ns.32 = trunc i64 %ns to i32
  %s.at = getelementptr i8, ptr %data, i64 MESSAGE
  store i32 %s.32, ptr %s.at, align 1
  %ns.at = getelementptr i8, ptr %s.at, i64 4
  store i32 %ns.32, ptr %ns.at, align 1
  br i1 %works, label %work, label %finish
work:
  call void @cycle(ptr %block, ptr %plan, ptr %data, i64 %length)
  br label %finish
finish:
  %after = call i64 @steady(ptr %block)
  %took = sub i64 %after, %before
  %to = getelementptr i64, ptr %durations, i64 %k
  store i64 %took, ptr %to
  %k.next = add i64 %k, 1
  %more = icmp slt i64 %k.next, %count
  br i1 %more, label %message, label %done
done:
  ret void
}

; A publisher that publishes nothing, for measurements of the cycle alone.
define i32 @publish_nothing(ptr %publisher, ptr %message, ptr %allocation) {
  ret i32 0
}

; Write a word after everything before it.
define void @write_word(ptr %to, i64 %value) {
  store atomic i64 %value, ptr %to release, align 8
  ret void
}

; Read a word before everything after it.
define i64 @read_word(ptr %from) {
  %value = load atomic i64, ptr %from acquire, align 8
  ret i64 %value
}

declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)
declare void @llvm.memmove.p0.p0.i64(ptr, ptr, i64, i1)
declare void @llvm.memset.p0.i64(ptr, i8, i64, i1)
"""
EVENT_LENGTH = 8
DROPS = 'DROPS'
_READ = re.compile(r'^  %([\w.]+) = (pointer|number) %(\w+)\.([A-Z_]+)$', re.MULTILINE)
_WRITE = re.compile(r'^  %([\w.]+) -> %(\w+)\.([A-Z_]+)$', re.MULTILINE)


def message_loop_text(drops: int) -> str:
    """
    Return the LLVM IR of the loop.

    `drops` is the place in the state of the path that counts dropped motions.
    """
    writes = iter(range(len(TEXT)))

    # The text names words of records: `%name = number %record.WORD`.
    def read(match: re.Match[str]) -> str:
        """Return a load of a named word."""
        name, kind, record, word = match.groups()
        place = WORDS[record].index(word)
        of_llvm = 'ptr' if kind == 'pointer' else 'i64'
        return (f'  %{name}.word = getelementptr i64, ptr %{record}, i64 {place}\n'
                f'  %{name} = load {of_llvm}, ptr %{name}.word')

    def write(match: re.Match[str]) -> str:
        """Return a store to a named word."""
        name, record, word = match.groups()
        place = WORDS[record].index(word)
        at = f'%to.{next(writes)}'
        return (f'  {at} = getelementptr i64, ptr %{record}, i64 {place}\n'
                f'  store i64 %{name}, ptr {at}')
    # Loads and stores of words, then the numbers of the names in capitals.
    text = _WRITE.sub(write, _READ.sub(read, TEXT))
    for name, value in _numbers(drops).items():
        text = re.sub(rf'(?<![\w%.]){name}\b', str(value), text)
    return text


def _numbers(drops: int) -> dict[str, int | float]:
    """Return the numbers of the names in capitals."""
    words = ('PLAN', 'IN_USE', 'STOP', 'HEAD', 'TAIL', 'SIMULATED')
    numbers = {name: BLOCK.index(name) for name in words}
    return numbers | {
        'DOES_PUBLISH': DOES_PUBLISH, 'SENT_AT': SENT_AT, 'REASON': REASON, 'DROPS': drops,
        'SEQUENCE_AT': SEQUENCE_AT, 'SLOT_WORDS': len(SLOT),
        'EVENT_BYTES': 8 * EVENT_LENGTH, 'LAYOUT_WORDS': len(LAYOUT), 'MOVING': MOVING,
        'MOMENT': MOMENT, 'X': X, 'NOW': NOW, 'STAMP': STAMP, 'TICKING': TICKING,
        'ROW_PLACE': ROW_PLACE, 'UNKNOWN': UNKNOWN, 'ANSWERED': ANSWERED,
        'ELAPSED': ELAPSED, 'HEARD': HEARD, 'MESSAGE': MESSAGE, 'STEADILY': STEADILY,
        'CLOCK_LENGTH': CLOCK_LENGTH, 'TAKE_LIMIT': TAKE_LIMIT, 'REQUEST': REQUEST,
        'RETRIES': RETRIES, 'SEARCHING': SEARCHING, 'WAITS': WAITS, 'OUTPUT_WORDS': len(OUTPUT),
        'NOTHING_TAKEN': NOTHING_TAKEN, 'PAUSE': PAUSE, 'MOST_FAILURES': MOST_FAILURES}


@cache
def message_loop(drops: int) -> llvm.Code:
    """Return the machine code of the loop; arguments as of `message_loop_text`."""
    return llvm.library('message_loop', message_loop_text(drops))


@cache
def write_word(drops: int) -> Any:
    """Return a function of an address and a number that publishes a word to the thread."""
    return message_loop(drops).function('write_word', ctypes.PYFUNCTYPE(
        None, ctypes.c_void_p, ctypes.c_int64))


@cache
def read_word(drops: int) -> Any:
    """Return a function that reads a word of the thread at an address."""
    return message_loop(drops).function('read_word', ctypes.PYFUNCTYPE(
        ctypes.c_int64, ctypes.c_void_p))
