"""The memory and the thread of the native torque path."""

from collections.abc import Callable, Mapping, Sequence
import ctypes
import os
from pathlib import Path
import signal
from typing import Any, NamedTuple
from weakref import finalize

from kane_dynamics.control.terms import Mode, Terms
from kane_dynamics.control.traced_laws import TracedLaw
from kane_dynamics.motion.motion import Motion, segment_table
from kane_dynamics.native.runtime import message_loop
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import Array
from kane_dynamics.ros.torque_path import cycle_rules
from kane_dynamics.ros.torque_path.cdr import (float64_multi_array, joint_command,
                                               joint_state_of_efforts, PreparedMessage,
                                               STAMP_AT)
from kane_dynamics.ros.torque_path.cycle_rules import (CycleSettings, Event, EVENT_SIZE,
                                                       PathState)
from kane_dynamics.ros.torque_path.guard_messages import FIELDS
from kane_dynamics.ros.torque_path.joint_state_reader import JointStateLayout
from kane_dynamics.ros.torque_path.rcl_functions import message_of, RclLoop
from kane_dynamics.task_space.law_kernel import identifier
import numpy as np
from numpy.typing import NDArray

Words = NDArray[np.int64]
SLOTS = 1024  # cycles that Python may lag behind
LARGEST = 8192  # bytes of a message
NAME = b'torque_path'  # of the thread
INFO_SIZE = 256  # bytes, more than a message info has
DROPS = PathState._fields.index('drops')


class Rules(NamedTuple):
    """The compiled rules of `cycle_rules`."""

    judge: Kernel
    answers: dict[Mode, Kernel]
    refuse: Kernel
    elapse: Kernel
    permit: Kernel
    confirm: Kernel
    hear: Kernel


class LawSizes(NamedTuple):
    """The largest memory and the most settings of some laws."""

    memory: int
    settings: int


def sizes_of(laws: Mapping[Mode, TracedLaw]) -> LawSizes:
    """Return what is enough for each of the laws."""
    memories = [law.memory for law in laws.values()]
    settings = [law.settings for law in laws.values()]
    return LawSizes(max(memories), max(settings))


def compiled_rules(robot: Robot, terms: Terms, laws: Mapping[Mode, TracedLaw]) -> Rules:
    """Compile the rules of a cycle for a robot in joint rates, with its laws by mode."""
    n = robot.n
    sizes = sizes_of(laws)
    frames = len(robot.equations.wrench_frames)
    # Names distinguish kernels, so that terms, sizes and variants are part of them.
    weights = ''.join(str(int(weight)) for weight in terms.weights)
    label = f'{weights}_{sizes.memory}_{sizes.settings}'
    event_shape = (EVENT_SIZE,)
    state_shape = (2 * n,)
    path_shape = (cycle_rules.path_size(n, sizes.memory),)
    settings_shape = (cycle_rules.settings_size(n, sizes.settings, frames),)
    row_shape = (6, 3 * n)

    def judge(path: Any, event: Any, state: Any, settings: Any) -> Any:
        return cycle_rules.packed(cycle_rules.judge(
            cycle_rules.unpacked_path(path, n), Event(*event), state,
            cycle_rules.unpacked_settings(settings, n, frames)))

    def answer_of(mode: Mode) -> Kernel:
        def answer(path: Any, event: Any, state: Any, row: Any, settings: Any,
                   parameters: Any, limits: Any) -> Any:
            return cycle_rules.packed(cycle_rules.answer(
                robot, laws[mode], cycle_rules.unpacked_path(path, n), Event(*event), state, row,
                cycle_rules.unpacked_settings(settings, n, frames), parameters, limits))
        # A law of another frame or other axes must not be found in the cache.
        name = identifier(f'answer_{mode}_{label}', *laws[mode].variant)
        return robot.compiled(answer, name=name, path=path_shape, event=event_shape,
                              state=state_shape, row=row_shape, settings=settings_shape,
                              shape=path_shape)

    def refuse(path: Any, event: Any, settings: Any, parameters: Any) -> Any:
        return cycle_rules.packed(cycle_rules.refuse(
            robot, terms, cycle_rules.unpacked_path(path, n), Event(*event),
            cycle_rules.unpacked_settings(settings, n, frames), parameters))

    def elapse(path: Any, event: Any, settings: Any) -> Any:
        return cycle_rules.packed(cycle_rules.elapse(
            cycle_rules.unpacked_path(path, n), Event(*event),
            cycle_rules.unpacked_settings(settings, n, frames)))

    def permit(path: Any, event: Any, state: Any) -> Any:
        return cycle_rules.packed(cycle_rules.permit(
            cycle_rules.unpacked_path(path, n), Event(*event), state))

    def confirm(path: Any, event: Any, state: Any) -> Any:
        return cycle_rules.packed(cycle_rules.confirm(
            cycle_rules.unpacked_path(path, n), Event(*event), state))

    def hear(path: Any, event: Any, numbers: Any, settings: Any) -> Any:
        return cycle_rules.packed(cycle_rules.hear(
            cycle_rules.unpacked_path(path, n), Event(*event), numbers,
            cycle_rules.unpacked_settings(settings, n, frames)))
    return Rules(
        robot.compiled(judge, name=f'judge_{label}', path=path_shape, event=event_shape,
                       state=state_shape, settings=settings_shape, shape=path_shape),
        {mode: answer_of(mode) for mode in laws},
        robot.compiled(refuse, name=f'refuse_{label}', path=path_shape, event=event_shape,
                       settings=settings_shape, shape=path_shape),
        robot.compiled(elapse, name=f'elapse_{label}', path=path_shape, event=event_shape,
                       settings=settings_shape, shape=path_shape),
        robot.compiled(permit, name=f'permit_{label}', path=path_shape, event=event_shape,
                       state=state_shape, shape=path_shape),
        robot.compiled(confirm, name=f'confirm_{label}', path=path_shape,
                       event=event_shape, state=state_shape, shape=path_shape),
        robot.compiled(hear, name=f'hear_{label}', path=path_shape, event=event_shape,
                       numbers=(FIELDS + n,), settings=settings_shape, shape=path_shape))


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
        rules = loop.rules
        self._kept: list[Any] = [rules]
        numbers = cycle_rules.packed(settings)
        block = parameters.copy()
        number, message = replay
        data = np.frombuffer(message, dtype=np.uint8).copy()
        at_rest = np.zeros((6, 3 * loop.n))
        layout_words = [self._layout(layout) for layout in layouts]
        words = {'PERIOD': period,
                 'LAYOUTS': self._words(layout_words), 'LAYOUT_COUNT': len(layouts),
                 'REPLAY': number, 'REPLAY_DATA': self._at(data),
                 'REPLAY_LENGTH': len(message),
                 'MOTION': self._motion(motions[0]), 'NEXT_MOTION': self._motion(motions[1]),
                 'REST': self._at(at_rest)}

        # A kernel is called with a table of the addresses of its arguments and result.
        path, event, state = loop.path, loop.event, loop.state
        arguments = {'JUDGE': (rules.judge, [path, event, state, numbers]),
                     'ANSWER': (rules.answers[mode], [path, event, state, at_rest, numbers]),
                     'REFUSE': (rules.refuse, [path, event, numbers]),
                     'ELAPSE': (rules.elapse, [path, event, numbers])}
        if longest is not None:
            words['LONGEST'] = longest
            arguments |= {'PERMIT': (rules.permit, [path, event, state]),
                          'CONFIRM': (rules.confirm, [path, event, state]),
                          'HEAR': (rules.hear, [path, event, loop.heard, numbers])}
        for name, (kernel, arrays) in arguments.items():
            addresses = [self._at(array) for array in (*arrays, block, loop.result)]
            words[name] = kernel.address
            words[f'{name}_TABLE'] = self._words(addresses)
        self.address = self._words([words.get(name, 0) for name in message_loop.PLAN])

    def _words(self, numbers: Sequence[Any]) -> int:
        """Keep numbers as words of 64 bits and return their address."""
        return self._at(np.array(numbers, dtype=np.int64))

    def _at(self, array: NDArray[Any]) -> int:
        """Keep an array and return its address."""
        self._kept.append(array)
        return int(array.ctypes.data)

    def _layout(self, layout: JointStateLayout) -> list[int]:
        """Return the words of a layout."""
        length = len(layout.buffer)
        mask = np.frombuffer(layout.mask.to_bytes(length, 'little'), dtype=np.uint8)
        expected = (layout.expected & layout.mask).to_bytes(length, 'little')
        offsets = layout.positions_at + 8 * layout.index.astype(np.int64)
        return [length, self._at(mask), self._at(np.frombuffer(expected, np.uint8)),
                len(offsets), self._at(offsets)]

    def _motion(self, scheduled: tuple[Motion, int] | None) -> int:
        """Return the address of the words of a motion; 0 without one."""
        if scheduled is None:
            return 0
        motion, start = scheduled
        table = segment_table(motion)
        words = [start, len(table.times), self._at(table.times),
                 self._at(table.origins), self._at(table.rates), self._at(table.rows),
                 table.rows[0].size]
        return self._at(np.array(words, dtype=np.int64))


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
    event : (8,) array
    path : PathState
    message : bytes

    """

    kind: int
    lost: int
    begin: int
    end: int
    sequence: int
    event: Array
    path: PathState
    message: bytes


class NativeLoop:
    """
    The thread that answers joint states, with the memory that it shares with Python.

    Parameters
    ----------
    robot : Robot
        In joint rates.
    terms : Terms
        Terms of the command.
    laws : mapping of Mode to TracedLaw

    """

    def __init__(self, robot: Robot, terms: Terms, laws: Mapping[Mode, TracedLaw]
                 ) -> None:
        n = robot.n
        self.n = n
        self.sizes = sizes_of(laws)
        self.rules = compiled_rules(robot, terms, laws)
        self._code = message_loop.message_loop(DROPS)
        self._write = message_loop.write_word(DROPS)
        self._read = message_loop.read_word(DROPS)
        self.block: Words = np.zeros(len(message_loop.BLOCK), dtype=np.int64)
        path_size = cycle_rules.path_size(n, self.sizes.memory)
        self.path = np.zeros(path_size)
        self.result = np.zeros(path_size)
        self.event = np.zeros(message_loop.EVENT_LENGTH)
        self.state = np.zeros(2 * n)
        self.heard = np.zeros(FIELDS + n)  # the last message of torque_guard
        self._info = np.zeros(INFO_SIZE, dtype=np.uint8)
        self._kept = np.zeros(LARGEST, dtype=np.uint8)  # a state that waits
        head = 8 * (len(message_loop.SLOT) + message_loop.EVENT_LENGTH + len(self.path))
        self._ring = np.zeros((SLOTS, head + LARGEST), dtype=np.uint8)
        self.command = float64_multi_array(n)
        self.torques = joint_state_of_efforts(robot.joint_names)
        self.stamped = joint_command(robot.joint_names, 'effort')
        self.request = float64_multi_array(1)
        from_guard = float64_multi_array(FIELDS + n)
        self._used: list[Any] = []  # memory of words that are addresses
        self._plans: list[CyclePlan] = []
        self._end: Callable[[], object] = bool
        self._wake: Callable[[], None] = lambda: None
        library = ctypes.CDLL(None)
        self._library = library
        self._set(RING=self._ring.ctypes.data, SLOTS=SLOTS, SLOT_SIZE=self._ring.shape[1],
                  STEADY=ctypes.cast(library.clock_gettime, ctypes.c_void_p).value,
                  INFO=self._info.ctypes.data, PATH=self.path.ctypes.data,
                  RESULT=self.result.ctypes.data, PATH_SIZE=len(self.path),
                  EVENT=self.event.ctypes.data, STATE=self.state.ctypes.data,
                  STATE_COUNT=2 * n, TAU=cycle_rules.SCALARS, TAU_COUNT=n,
                  LARGEST=LARGEST, KEPT=self._kept.ctypes.data,
                  GUARD_LENGTH=from_guard.bytes.size,
                  GUARD_AT=from_guard.bytes.size - from_guard.numbers.nbytes,
                  GUARD_NUMBERS=self.heard.ctypes.data, GUARD_BYTES=self.heard.nbytes,
                  REQUEST_MESSAGE=self._message(self.request),
                  REQUEST_NUMBER=self.request.numbers.ctypes.data,
                  PUBLISH=self._code.address('publish_nothing'))
        self.publish_to(0, 0)

    def _message(self, message: PreparedMessage) -> int:
        """Return the address of the structure of a message, which is kept."""
        structure = message_of(message.bytes)
        self._used.append(structure)
        return ctypes.addressof(structure)

    def publish_to(self, commands: int, torques: int, stamped: int | None = None) -> None:
        """Publish the torques by these publishers, by the addresses of their handles."""
        outputs = [(commands, self.command, 0)]
        if stamped is not None:
            outputs.append((stamped, self.stamped, STAMP_AT))
        outputs.append((torques, self.torques, STAMP_AT))
        rows = []
        for publisher, message, stamp_at in outputs:
            stamp = message.bytes.ctypes.data + stamp_at if stamp_at else 0
            rows.append([publisher, self._message(message), message.numbers.ctypes.data,
                         stamp])
        table = np.array(rows, dtype=np.int64)
        self._used.append(table)
        self._set(OUTPUTS=table.ctypes.data, OUTPUT_COUNT=len(rows))

    def connect(self, rcl: RclLoop, guard_input: int | None = None,
                clock_input: int | None = None) -> None:
        """
        Use the first subscription of `rcl` for states, and publish by rcl.

        `guard_input` and `clock_input` are the places of those of torque_guard and of
        /clock.
        """
        self._wake = rcl.wake
        self.use_clock(rcl.address('rcl_clock_get_now'), rcl.clock)
        self._set(PUBLISH=rcl.address('rcl_publish_serialized_message'))
        for name, place in (('GUARD_INPUT', guard_input), ('CLOCK_INPUT', clock_input)):
            if place is not None:
                self._set(**{name: self._input(rcl, place)})
        self._set(WAIT_SET=ctypes.addressof(rcl.wait_set),
                  SUBSCRIPTION=rcl.subscriptions[0],
                  GUARD=rcl.guard, TAKEN=ctypes.addressof(rcl.taken[0]),
                  CLEAR=rcl.address('rcl_wait_set_clear'),
                  ADD_SUBSCRIPTION=rcl.address('rcl_wait_set_add_subscription'),
                  ADD_GUARD=rcl.address('rcl_wait_set_add_guard_condition'),
                  WAIT=rcl.address('rcl_wait'),
                  TAKE=rcl.address('rcl_take_serialized_message'))

    def use_clock(self, function: int, handle: int) -> None:
        """Use the clock of a handle, as `rcl_clock_get_now` reads it."""
        self._set(CLOCK=function, CLOCK_HANDLE=handle)

    def use_publisher(self, function: int) -> None:
        """Publish by a function like `rcl_publish_serialized_message`."""
        self._set(PUBLISH=function)

    def ask_by(self, publisher: int) -> None:
        """Publish requests to torque_guard, by the address of a publisher's handle."""
        self._set(REQUEST_TO=publisher)

    def simulate_time(self, is_simulated: bool) -> None:
        """Use the time of the messages of /clock, or that of the clock."""
        self._publish_word('SIMULATED', int(is_simulated))

    def _input(self, rcl: RclLoop, place: int) -> int:
        """Return the address of the words of a subscription beside that of the states."""
        info = np.zeros(INFO_SIZE, dtype=np.uint8)
        words = np.array([rcl.subscriptions[place], ctypes.addressof(rcl.taken[place]),
                          info.ctypes.data], dtype=np.int64)
        self._used += [info, words]
        return int(words.ctypes.data)

    def _set(self, **words: int | None) -> None:
        """Set words of the block."""
        for name, value in words.items():
            self.block[message_loop.BLOCK.index(name)] = value or 0

    def _get(self, name: str) -> int:
        """Return a word of the block before everything read afterwards."""
        place = message_loop.BLOCK.index(name)
        return int(self._read(self.block.ctypes.data + 8 * place))

    def _publish_word(self, name: str, value: int) -> None:
        """Set a word of the block after everything written before."""
        place = message_loop.BLOCK.index(name)
        self._write(self.block.ctypes.data + 8 * place, value)

    def begin(self, epoch: int, path: PathState) -> None:
        """Prepare a start at a time of the node's clock, ns."""
        self.path[:] = cycle_rules.packed(path)
        self.event[:] = 0.0
        self._plans = []
        self._set(EPOCH=epoch, STOP=0, ENDED=0, HEAD=0, TAIL=0, LOST=0, REPLAYED=0,
                  PLAN=0, IN_USE=0, KEPT_LENGTH=0, SIMULATED_TIME=epoch)

    def use(self, plan: CyclePlan) -> None:
        """Use a plan from the next cycle on; free those that no cycle uses any more."""
        self._plans.append(plan)
        self._publish_word('PLAN', plan.address)
        self._wake()
        in_use = self._get('IN_USE')
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
        thread = ctypes.c_ulong()
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())
        try:
            code = self._library.pthread_create(
                ctypes.byref(thread), None, ctypes.c_void_p(self._code.address('run')),
                ctypes.c_void_p(self.block.ctypes.data))
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        if code:
            raise OSError(code, os.strerror(code))
        self._library.pthread_setname_np(thread, NAME)
        stop = self.block.ctypes.data + 8 * message_loop.BLOCK.index('STOP')
        # It ends before its memory does, also when the interpreter exits without a stop.
        self._end = finalize(self, _end_thread, os.getpid(), thread, self._library,
                             self._write, stop, self._wake, dict(vars(self)))

    def scheduled_as_main(self) -> None:
        """Schedule the thread as the main thread; OSError if it is not permitted."""
        main = os.getpid()
        policy = os.sched_getscheduler(main)
        parameters = os.sched_getparam(main)
        for task in Path('/proc/self/task').iterdir():
            if (task / 'comm').read_bytes().strip() == NAME:
                os.sched_setscheduler(int(task.name), policy, parameters)

    def stop_thread(self) -> None:
        """Stop the thread and wait for its end; a forked process has none."""
        self._end()

    @property
    def code_of_end(self) -> int:
        """Return the code of rcl with which the thread ended by itself; 0: it runs."""
        return self._get('ENDED')

    @property
    def lost(self) -> int:
        """Return the number of reports that found the ring full."""
        return self._get('LOST')

    @property
    def unsent(self) -> int:
        """Return the number of commands that the middleware refused."""
        return self._get('UNSENT')

    def reports(self) -> list[Report]:
        """Return the cycles since the last call, and free their slots."""
        head = self._get('HEAD')
        tail = self._get('TAIL')
        reports = [self._report(self._ring[k % SLOTS]) for k in range(tail, head)]
        self._publish_word('TAIL', head)
        return reports

    def _report(self, slot: NDArray[np.uint8]) -> Report:
        words = slot[:8 * len(message_loop.SLOT)].view(np.int64).tolist()
        named = dict(zip(message_loop.SLOT, words))
        at = 8 * len(message_loop.SLOT)
        numbers = message_loop.EVENT_LENGTH + len(self.path)
        doubles = slot[at:at + 8 * numbers].view(np.float64).copy()
        event, path = np.split(doubles, [message_loop.EVENT_LENGTH])
        begin = at + 8 * numbers
        message = slot[begin:begin + named['MESSAGE_LENGTH']].tobytes()
        return Report(named['KIND'], named['ALL_LOST'], named['BEGIN'], named['END'],
                      named['SEQUENCE'], event, cycle_rules.unpacked_path(path, self.n),
                      message)

    def answer(self, message: bytes) -> None:
        """Run one cycle in the calling thread, with the latest plan, for tests."""
        run = self._code.function('cycle', ctypes.PYFUNCTYPE(
            None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int64))
        run(self.block.ctypes.data, self._plans[-1].address, message, len(message))

    def hear(self, message: bytes) -> None:
        """Hear torque_guard in the calling thread, for tests."""
        run = self._code.function('hear', ctypes.PYFUNCTYPE(
            None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int64))
        run(self.block.ctypes.data, self._plans[-1].address, message, len(message))

    def look_at_time(self) -> None:
        """Look at the time in the calling thread, for tests."""
        run = self._code.function('look_at_time', ctypes.PYFUNCTYPE(
            None, ctypes.c_void_p, ctypes.c_void_p))
        run(self.block.ctypes.data, self._plans[-1].address)

    def durations(self, message: bytes, count: int, works: bool = True) -> Words:
        """
        Answer a message many times, without the GIL; return each duration, ns.

        The reports are freed first. Without `works` the same loop does nothing else than
        to read the clocks.
        """
        self._publish_word('TAIL', self._get('HEAD'))
        durations = np.zeros(count, dtype=np.int64)
        data = ctypes.create_string_buffer(message, len(message))
        run = self._code.function('repeat_cycles', ctypes.CFUNCTYPE(
            None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64,
            ctypes.c_void_p, ctypes.c_bool))
        run(self.block.ctypes.data, ctypes.addressof(data), len(message), count,
            durations.ctypes.data, works)
        return durations


def _end_thread(process: int, thread: ctypes.c_ulong, library: ctypes.CDLL,
                write: Callable[[int, int], None], stop: int, wake: Callable[[], None],
                kept: object) -> None:
    """Let the thread stop and wait for its end; a forked process has none."""
    if process == os.getpid():
        write(stop, 1)
        wake()
        library.pthread_join(thread, None)
