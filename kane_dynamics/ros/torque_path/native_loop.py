"""The memory and the thread of the native torque path."""

from collections.abc import Callable, Mapping, Sequence
import ctypes
from functools import partial
import os
import signal
from typing import Any, NamedTuple
from weakref import finalize

from kane_dynamics.control.terms import Mode
from kane_dynamics.control_cycle import cycle_rules
from kane_dynamics.control_cycle.arbitration import FIELDS
from kane_dynamics.control_cycle.cycle import Cycle, OF_GUARD, PathMemory, REASON
from kane_dynamics.control_cycle.cycle_results import NO_TORQUE
from kane_dynamics.control_cycle.cycle_rules import CycleSettings, PathState
from kane_dynamics.mechanics.algebra.flags import packed
from kane_dynamics.motion.motion import Motion, segment_table
from kane_dynamics.native.runtime import message_loop
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.runtime.message_loop import (Block, Event, INFORMATION_SIZE,
                                                       Layout, MotionTable, Output, Plan,
                                                       Rule, Slot)
from kane_dynamics.ros.common.cdr import (float64_multi_array, joint_command,
                                          joint_state_of_efforts, PreparedMessage,
                                          STAMP_AT)
from kane_dynamics.ros.common.conversion import Array
from kane_dynamics.ros.common.rcl_functions import message_of, RclLoop
from kane_dynamics.ros.common.realtime import named_threads
from kane_dynamics.ros.torque_path.joint_state_reader import JointStateLayout
import numpy as np
from numpy.typing import NDArray

SLOTS = 1024  # cycles that Python may lag behind
LARGEST = 8192  # bytes of a message
NAME = 'torque_path'  # of the thread
REFUSED = 1  # the code of what Python raised
RULE = ctypes.PYFUNCTYPE(None, ctypes.c_void_p)
# A rule that Python evaluates around its kernel, which it calls.
PythonRule = Callable[[Callable[[], object]], None]


class CyclePlan:
    """
    The numbers and functions of a cycle; immutable, but for the row of the motion.

    Parameters
    ----------
    loop : NativeLoop
    mode : Mode
    settings : CycleSettings
    parameters : array
        Block of the robot's parameters.
    layouts : sequence of JointStateLayout
    motions : pair of (Motion, start in ns since the epoch) or None
        The active and the next one.
    period : int
        Longest time between two looks at the clock, ns.
    replay : (int, bytes)
        Number and bytes of a message to answer as if it was received.
    longest : int or None
        Longest computation of a command, ns, after which torque_guard is asked again;
        None: there is no torque_guard.

    """

    def __init__(self, loop: 'NativeLoop', mode: Mode, settings: CycleSettings,
                 parameters: Array, layouts: Sequence[JointStateLayout],
                 motions: Sequence[tuple[Motion, int] | None], period: int,
                 replay: tuple[int, bytes], longest: int | None = None) -> None:
        kernels = loop.kernels
        shape = kernels.shape
        self._shape = shape
        self._further = kernels.further
        self.settings = settings
        self._kept: list[Any] = [kernels]
        numbers = packed(settings)
        block = parameters.copy()
        number, message = replay
        data = np.frombuffer(message, dtype=np.uint8).copy()
        at_rest = np.zeros((6, 3 * shape.n))
        known = (Layout * len(layouts))(*map(self._layout, layouts))
        current, following = motions
        plan = Plan(period=period, layouts=self._kept_at(known), layout_count=len(layouts),
                    replay=number, replay_data=self._at(data), replay_length=len(message),
                    motion=self._motion(current), next_motion=self._motion(following),
                    rest=self._at(at_rest))
        called = dict(kernels.by_name)
        if kernels.answers:
            called['answer'] = kernels.answers[mode]
        if mode in kernels.aims:
            called['aim'] = kernels.aims[mode]
        # Kernels of the guard are called only where there is one.
        if longest is None:
            for name in OF_GUARD:
                if name not in loop.python_rules:
                    del called[name]
        else:
            plan.longest = longest

        # A kernel is called with a table of the addresses of its arguments and result.
        arrays = {'path': loop.path, 'event': loop.event, 'state': loop.state,
                  'row': at_rest, 'numbers': loop.heard, 'settings': numbers,
                  'torque': loop.torque, 'begin': loop.stop_begin}
        for name, kernel in called.items():
            addresses = [self._at(arrays[key]) for key in kernels.inputs[name]]
            addresses += [self._at(block), self._at(loop.result)]
            table = self._at(np.array(addresses, dtype=np.int64))
            setattr(plan, name, Rule(loop.function(name, kernel), table))
        self.address = self._kept_at(plan)

    def _at(self, array: NDArray[Any]) -> int:
        """Keep an array and return its address."""
        self._kept.append(array)
        return int(array.ctypes.data)

    def _kept_at(self, structure: Any) -> int:
        """Keep a structure of ctypes and return its address."""
        self._kept.append(structure)
        return ctypes.addressof(structure)

    def _layout(self, layout: JointStateLayout) -> Any:
        """Return the structure of a layout."""
        shape = self._shape
        length = len(layout.buffer)
        mask = np.frombuffer(layout.mask.to_bytes(length, 'little'), dtype=np.uint8)
        expected = (layout.expected & layout.mask).to_bytes(length, 'little')
        # Places of the joints' entries in the message, and where they go in the state.
        entries = layout.index
        places = np.arange(len(entries))
        constants = np.zeros(shape.state)
        if shape.loops:
            # Positions of further joints, which are compared with the closed loops.
            further = self._further[list(layout.others.places)]
            entries = np.concatenate([entries, layout.others.entries])
            places = np.concatenate([places, 2 * shape.n + further])
            constants[2 * shape.n + shape.joints + further] = 1.0
        offsets = layout.positions_at + 8 * entries.astype(np.int64)
        return Layout(length, self._at(mask), self._at(np.frombuffer(expected, np.uint8)),
                      len(offsets), self._at(offsets), self._at(places.astype(np.int64)),
                      self._at(constants))

    def _motion(self, scheduled: tuple[Motion, int] | None) -> int:
        """Return the address of the structure of a motion; 0 without one."""
        if scheduled is None:
            return 0
        motion, start = scheduled
        # Segments as a table, which the loop evaluates.
        table = segment_table(motion)
        return self._kept_at(MotionTable(
            start, len(table.times), self._at(table.times), self._at(table.origins),
            self._at(table.rates), self._at(table.rows), table.rows[0].size))


class Report(NamedTuple):
    """
    One cycle of the thread, as the ring states it.

    Attributes
    ----------
    kind : int
        `ANSWERED`, `UNKNOWN`, `ELAPSED` or `HEARD` of `message_loop`.
    lost : int
        Reports that found the ring full, so far.
    begin, end : int
        Steady time of the cycle, ns.
    sequence : int
        The publisher's number of the message.
    event : Event
        A structure of `message_loop`.
    path : PathState
    numbers : array
        The `PathState` as an array.
    message : bytes

    """

    kind: int
    lost: int
    begin: int
    end: int
    sequence: int
    event: Any
    path: PathState
    numbers: Array
    message: bytes


def compile_loop() -> None:
    """Compile the loop of the thread, which is that of every robot."""
    message_loop.message_loop()


class NativeLoop:
    """
    The thread that answers joint states, with the memory that it shares with Python.

    Parameters
    ----------
    kernels : Cycle
    joints : sequence of str
        The commanded joints.
    python_rules : mapping of str to PythonRule, optional
        The rules of a plan that Python evaluates; the loop runs in callbacks then.

    Attributes
    ----------
    memory, next : PathMemory
        The state of the path in the cycle of now, and the result of the last rule.
    event, state : arrays
        Times of the cycle, and the measured state.
    torque, stop_begin : arrays
        What Python gives to the kernels of its rules.
    error : Exception or None
        What Python has raised in a cycle since the start.

    """

    def __init__(self, kernels: Cycle, joints: Sequence[str],
                 python_rules: Mapping[str, PythonRule] | None = None) -> None:
        shape = kernels.shape
        self.kernels = kernels
        self.shape = shape
        self._code = message_loop.message_loop()
        self._write = message_loop.write_number()
        self._read = message_loop.read_number()
        self.block = Block()

        # What the rules read and write.
        self.memory = PathMemory(shape)
        self.path = self.memory.array
        self.next = PathMemory(shape)  # the result of a rule
        self.result = self.next.array
        self.event = np.zeros(len(Event._fields_))
        self.state = np.zeros(shape.state)
        self.heard = np.zeros(FIELDS + shape.commanded)  # the last message of torque_guard
        self.torque = np.zeros(shape.commanded)
        self.stop_begin = np.zeros(2 * shape.n)
        self.python_rules = dict(python_rules or {})
        self.error: Exception | None = None
        self._callbacks: dict[str, Any] = {}  # of the rules of Python, and their kernels

        # What the thread publishes.
        self.command = float64_multi_array(shape.commanded)
        self.torques = joint_state_of_efforts(joints)
        self.stamped = joint_command(joints, 'effort')
        self.request = float64_multi_array(1)

        # What it needs beside.
        head = ctypes.sizeof(Slot) + self.path.nbytes
        self._ring = np.zeros((SLOTS, head + LARGEST), dtype=np.uint8)
        self._information = np.zeros((3, INFORMATION_SIZE), dtype=np.int64)  # of each input
        self._waiting = np.zeros(LARGEST, dtype=np.uint8)  # a state that waits
        self._used: list[Any] = []  # memory of fields that are addresses
        self._plans: list[CyclePlan] = []
        self._functions: dict[str, Any] = {}  # of the loop, that Python has called
        self._end: Callable[[], object] = bool
        self._wake: Callable[[], None] = lambda: None
        library = ctypes.CDLL(None)
        self._library = library
        self._describe_memory()
        self.publish_to(0, 0)

    def function(self, name: str, kernel: Kernel) -> Any:
        """Return the address of a rule's function: its kernel, or Python around it."""
        rule = self.python_rules.get(name)
        if rule is None:
            return kernel.address
        if name not in self._callbacks:
            compute = RULE(int(kernel.address))
            self._callbacks[name] = RULE(partial(self._evaluate, rule, compute)), compute
        return function_address(self._callbacks[name][0])

    def _evaluate(self, rule: PythonRule, compute: Callable[[int], object], table: int
                  ) -> None:
        """Evaluate a rule in Python; what it raises ends the path after the cycle."""
        try:
            rule(partial(compute, table))
        except Exception as error:
            self.fail(error)
            self.keep(NO_TORQUE)

    def fail(self, error: Exception) -> None:
        """Note what Python raised in a cycle, as a message that was refused."""
        self.error = error
        self.block.refused = REFUSED

    def keep(self, reason: int) -> None:
        """Let the state of the path be as it was, with a reason to refuse the state."""
        self.result[:] = self.path
        self.result[REASON] = reason

    @property
    def plan(self) -> CyclePlan:
        """Return the latest plan."""
        return self._plans[-1]

    @property
    def address(self) -> int:
        """Return the address of the block."""
        return ctypes.addressof(self.block)

    def _describe_memory(self) -> None:
        """Write the addresses and sizes of the memory into the block."""
        from_guard = float64_multi_array(len(self.heard))
        # Addresses stay valid because these arrays live as long as the loop.
        self.set_fields(ring=self._ring.ctypes.data, slots=SLOTS,
                        slot_size=self._ring.shape[1], largest=LARGEST,
                        kept=self._waiting.ctypes.data)
        self.set_fields(path=self.path.ctypes.data, result=self.result.ctypes.data,
                        path_size=len(self.path), torque_count=self.shape.commanded,
                        torques=self.path[cycle_rules.SCALARS:].ctypes.data)
        self.set_fields(event=self.event.ctypes.data, state=self.state.ctypes.data,
                        state_size=len(self.state))
        self.set_fields(guard_length=from_guard.bytes.size,
                        guard_at=from_guard.bytes.size - from_guard.numbers.nbytes,
                        guard_numbers=self.heard.ctypes.data, guard_count=len(self.heard))
        self.set_fields(rest_for=function_address(self._library.usleep))
        for inputs, information in zip(
                (self.block.states, self.block.clock_messages, self.block.guard_messages),
                self._information):
            inputs.information = information.ctypes.data
        self.ask(0)

    def _output(self, publisher: int, message: PreparedMessage, stamp_at: int) -> Any:
        """Return the structure of a publisher with its message, which is kept."""
        structure = message_of(message.bytes)
        self._used.append(structure)
        stamp = message.bytes.ctypes.data + stamp_at if stamp_at else 0
        return Output(publisher, ctypes.addressof(structure), message.numbers.ctypes.data,
                      stamp)

    def publish_to(self, commands: int, torques: int, stamped: int | None = None) -> None:
        """Publish the torques by these publishers, by the addresses of their handles."""
        outputs = [self._output(commands, self.command, 0)]  # which has no stamp
        if stamped is not None:
            outputs.append(self._output(stamped, self.stamped, STAMP_AT))
        outputs.append(self._output(torques, self.torques, STAMP_AT))
        table = (Output * len(outputs))(*outputs)
        self._used.append(table)
        self.set_fields(outputs=ctypes.addressof(table), output_count=len(outputs))

    def ask(self, publisher: int) -> None:
        """Publish requests to torque_guard by the publisher of this address."""
        self.set_fields(request=self._output(publisher, self.request, 0))

    def connect(self, rcl: RclLoop, guard_input: int | None = None,
                clock_input: int | None = None) -> None:
        """
        Use the first subscription of `rcl` for states, and publish by rcl.

        `guard_input` and `clock_input` are the places of those of torque_guard and of
        /clock.
        """
        self._wake = rcl.wake
        block = self.block
        # Inputs that this node does not have keep their address of zero.
        for inputs, place in ((block.states, 0), (block.guard_messages, guard_input),
                              (block.clock_messages, clock_input)):
            if place is not None:
                inputs.subscription = rcl.subscriptions[place]
                inputs.taken = ctypes.addressof(rcl.taken[place])
        self.set_fields(steady=function_address(self._library.clock_gettime))
        self.set_fields(wait_set=ctypes.addressof(rcl.wait_set), wake=rcl.guard,
                        clock_handle=rcl.clock,
                        clear=rcl.address('rcl_wait_set_clear'),
                        add_subscription=rcl.address('rcl_wait_set_add_subscription'),
                        add_guard_condition=rcl.address('rcl_wait_set_add_guard_condition'),
                        wait=rcl.address('rcl_wait'),
                        take=rcl.address('rcl_take_serialized_message'),
                        publish=rcl.address('rcl_publish_serialized_message'),
                        clock=rcl.address('rcl_clock_get_now'))

    def simulate_time(self, is_simulated: bool) -> None:
        """Use the time of the messages of /clock, or that of the clock."""
        self.publish_number('simulated', int(is_simulated))

    def set_fields(self, **fields: Any) -> None:
        """Set fields of the block, which the thread reads when it starts."""
        for name, value in fields.items():
            setattr(self.block, name, value)

    def number(self, name: str) -> int:
        """
        Return a number of the block, before everything read afterwards.

        Among them are `head`, the number of reports since the start of the thread; `lost`,
        those that found the ring full; `refused`, the code with which the middleware
        refused a message, or 0; `not_taken`, its failures to return a message; and
        `ended`, the code of rcl with which the thread ended by itself, or 0.
        """
        return int(self._read(self.address + getattr(Block, name).offset))

    def publish_number(self, name: str, value: int) -> None:
        """Set a number of the block after everything written before."""
        self._write(self.address + getattr(Block, name).offset, value)

    def begin(self, epoch: int, path: PathState) -> None:
        """Prepare a start at a time of the node's clock, ns."""
        self.path[:] = packed(path)
        self.event[:] = 0.0
        self.error = None
        self._plans = []
        self.set_fields(epoch=epoch, stop=0, ended=0, head=0, tail=0, lost=0, replayed=0,
                        plan=0, in_use=0, kept_length=0, simulated_time=epoch, broken=0,
                        refused=0)
        for inputs in (self.block.states, self.block.clock_messages,
                       self.block.guard_messages):
            inputs.failures = 0

    def use(self, plan: CyclePlan) -> None:
        """Use a plan from the next cycle on; free those that no cycle uses any more."""
        self._plans.append(plan)
        self.publish_number('plan', plan.address)
        self._wake()
        in_use = self.number('in_use')
        addresses = [earlier.address for earlier in self._plans]
        if in_use in addresses:
            del self._plans[:addresses.index(in_use)]

    def start_thread(self) -> None:
        """
        Start the thread, with the scheduling of the calling one; signals stay to Python.

        Raises
        ------
        OSError
            The system starts no thread.

        """
        # Signals are blocked while the thread starts, so that it inherits the mask.
        thread = ctypes.c_ulong()
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())
        try:
            code = self._library.pthread_create(
                ctypes.byref(thread), None, ctypes.c_void_p(self._code.address('run')),
                ctypes.c_void_p(self.address))
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        if code:
            raise OSError(code, os.strerror(code))
        self._library.pthread_setname_np(thread, NAME.encode())
        stop = self.address + Block.stop.offset
        # It ends before its memory does, also when the interpreter exits without a stop.
        self._end = finalize(self, _end_thread, os.getpid(), thread, self._library,
                             self._write, stop, self._wake, dict(vars(self)))

    def scheduled_as_main(self) -> None:
        """Schedule the thread as the main thread; OSError if it is not permitted."""
        main = os.getpid()
        policy = os.sched_getscheduler(main)
        parameters = os.sched_getparam(main)
        for thread in named_threads(NAME):
            os.sched_setscheduler(thread, policy, parameters)

    def stop_thread(self) -> None:
        """Stop the thread and wait for its end; a forked process has none."""
        self._end()

    def reports(self) -> list[Report]:
        """Return the cycles since the last call, and free their slots."""
        head = self.number('head')
        tail = self.number('tail')
        reports = [self._report(self._ring[k % SLOTS]) for k in range(tail, head)]
        self.publish_number('tail', head)
        return reports

    def _report(self, memory: NDArray[np.uint8]) -> Report:
        """Return the report in a slot: its structure, the path, then the message."""
        slot = Slot.from_buffer_copy(memory)
        begin = ctypes.sizeof(Slot)
        end = begin + self.path.nbytes
        path = memory[begin:end].view(np.float64).copy()
        message = memory[end:end + slot.length].tobytes()
        return Report(slot.kind, slot.lost, slot.begin, slot.end, slot.sequence, slot.event,
                      self.memory.record(path), path, message)

    def call(self, function: str, message: bytes = b'') -> None:
        """
        Call a function of the loop in the calling thread, with the latest plan.

        They are `cycle` and `hear`, with a message, and `look_at_time`.
        """
        if function not in self._functions:
            self._functions[function] = self._code.function(function, ctypes.PYFUNCTYPE(
                None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int64))
        plan = self._plans[-1]
        self._functions[function](self.address, plan.address, message, len(message))
        # Those before are in use no more.
        del self._plans[:self._plans.index(plan)]

    def durations(self, message: bytes, count: int, works: bool = True) -> NDArray[np.int64]:
        """
        Answer a message many times, without the GIL; return each duration, ns.

        The reports are freed first. Without `works` the same loop does nothing else than
        to read the clocks.
        """
        # Reports of earlier cycles are skipped, so that the ring does not fill up.
        self.publish_number('tail', self.number('head'))
        durations = np.zeros(count, dtype=np.int64)
        data = ctypes.create_string_buffer(message, len(message))
        run = self._code.function('repeat_cycles', ctypes.CFUNCTYPE(
            None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64,
            ctypes.c_void_p, ctypes.c_bool))
        run(self.address, ctypes.addressof(data), len(message), count,
            durations.ctypes.data, works)
        return durations


def function_address(function: Any) -> int:
    """Return the address of a function of ctypes."""
    return int(ctypes.cast(function, ctypes.c_void_p).value or 0)


def _end_thread(process: int, thread: ctypes.c_ulong, library: ctypes.CDLL,
                write: Callable[[int, int], None], stop: int, wake: Callable[[], None],
                kept: object) -> None:
    """Stop the thread and wait for its end; a forked process has none."""
    if process == os.getpid():
        write(stop, 1)
        wake()
        library.pthread_join(thread, None)
