"""
The torque path by the message loop, whose rules and laws are compiled.

An executor runs the loop (`executors`): a thread, which the interpreter cannot delay, or
callbacks. This module passes it parameters, loads and motions as plans, and reads its
reports: statistics, warnings and observers run here and may lag behind a thread.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
import threading
import time
from typing import Any

from kane_dynamics.control.controller import Controller
from kane_dynamics.control.traced_laws import (Actuation, closed_loop_laws,
                                               controller_laws, MODES)
from kane_dynamics.control_cycle import cycle_results, cycle_rules
from kane_dynamics.control_cycle.arbitration import Arbitration
from kane_dynamics.control_cycle.cycle_results import NEVER
from kane_dynamics.control_cycle.cycle_rules import CycleSettings, PathState
from kane_dynamics.control_cycle.loop_rules import (initial_loops, LoopRules,
                                                    unpacked_loops)
from kane_dynamics.loop_tracking.loop_tracker import (LoopTracker, mirror, refusal,
                                                      search_array, search_of,
                                                      squared_limits)
from kane_dynamics.mechanics.constraints.conditioning import SINGULAR
from kane_dynamics.motion.motion import State
from kane_dynamics.native.runtime.message_loop import ELAPSED, HEARD, UNKNOWN
from kane_dynamics.ros.common.conversion import Array, NANO
from kane_dynamics.ros.common.lost_messages import LostMessages
from kane_dynamics.ros.common.stamped_numbers import MALFORMED, NOT_FINITE
from kane_dynamics.ros.loads.gravity_payload import GravityAndPayload
from kane_dynamics.ros.modes.task_modes import native_laws, NATIVE_MODES
from kane_dynamics.ros.parameters.command_form import EFFORT
from kane_dynamics.ros.torque_path.active_motion import ActiveMotion
from kane_dynamics.ros.torque_path.closed_loop_reader import (ClosedLoopReader,
                                                              commanded_joints)
from kane_dynamics.ros.torque_path.cycle_observer import GuardSide
from kane_dynamics.ros.torque_path.drop_reasons import LEARNED, REASONS
from kane_dynamics.ros.torque_path.executors import CallbackExecutor, ThreadExecutor
from kane_dynamics.ros.torque_path.joint_state_reader import (JointStateLayout,
                                                              MAX_LAYOUTS)
from kane_dynamics.ros.torque_path.native_loop import (CycleKernels, CyclePlan, LARGEST,
                                                       NativeLoop, Report)
from kane_dynamics.ros.torque_path.path_memory import PathMemory
from kane_dynamics.ros.torque_path.torque_path import TOO_LARGE_TORQUE, TorquePath
import numpy as np
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

LONGEST_WAIT = 0.2  # of the timeout, between two looks at the clock
LONGEST_LAG = 0.1  # s, that a new motion waits for a report of now
LOOK_AGAIN = 0.001  # s
ENDED = 'the native torque path ended'
TOO_LARGE = f'empty or more than {LARGEST} bytes; expected at most as many'
# The thread has judged with limits of its time.
CHANGED = 'compared with limits, or a state, that have changed since'


def python_reason(values: Mapping[str, Any], controller: Controller,
                  loops: ClosedLoopReader | None) -> str:
    """
    Return why a configuration needs the interpreter's torque path; empty if it does not.

    Parameters
    ----------
    values : mapping
        The node's parameters.
    controller : Controller
        Of the torque path.
    loops : ClosedLoopReader or None
        Of an arm with closed loops.

    """
    robot = controller.robot
    equations = robot.equations
    # The reasons in the order in which users would look for them.
    every_term = controller.compensate.complete
    modes = (*MODES, *NATIVE_MODES) if loops is None else MODES
    if equations.timed:
        return 'constraints that depend on time'
    scale = values['efforts.scale']
    if values['commands.form'] != EFFORT or (scale != 1.0).any():
        return 'commands.form or efforts.scale'
    if loops is None and not equations.in_joint_rates:
        return 'chosen speeds'
    if controller.bending is not None:
        return 'flexible links'
    if robot.model.balls:
        return 'ball joints'
    if equations.carries_loads and not every_term:
        return 'friction that depends on loads, with arm_compensates'
    if loops is not None and controller.compensate.arm is not None:
        return 'arm_gravity or arm_payload of an arm with closed loops'
    for mode in (values['mode'], *values['modes']):
        if mode not in modes:
            return f'mode {mode}' + ' of an arm with closed loops' * (loops is not None)
    return ''


class NativeTorquePath(TorquePath):
    """
    The torque path by the message loop; its interface is that of `TorquePath`.

    The attributes that describe the last cycle are those of the last report that was
    read.

    Parameters
    ----------
    controller : Controller
        Without constraints; the laws that it has are of `task_modes`.

    Other parameters are those of `TorquePath`.

    Attributes
    ----------
    native : NativeLoop
        The memory of the loop, and its functions.
    executor : CallbackExecutor or ThreadExecutor
        Runs the loop: callbacks, or a thread from its assignment on.
    lost_states : LostMessages
        Counts lost states by the publisher's numbers, in a thread.

    """

    def __init__(self, controller: Controller, *arguments: Any, **named: Any) -> None:
        # Plans are made in two threads. Held also while a motion is dropped.
        self._lock = threading.RLock()
        self._changes_last = False  # whether changes that belong together are under way
        super().__init__(controller, *arguments, **named)
        self.active_motion = ActiveMotion(self._replan)
        self.executor: CallbackExecutor | ThreadExecutor = CallbackExecutor(
            self.native, self._now, *self.messages.publishers)
        self._last = self._initial()  # as reported
        self._replay = 0, b''
        self._message_fault: str | None = None  # of the last report, by the reader
        self._layouts: list[JointStateLayout] = []  # that the thread knows
        self._counted: dict[str, int] = {}  # by the thread, as warned of
        self._noted = 0  # reports that were read since the start
        self.lost_states = LostMessages()

    def _make_memory(self) -> None:
        """Make the memory of the thread, and what computes in it."""
        self._laws = {} if self.loops else native_laws(self.controller)
        self.native = NativeLoop(self._kernels(), self.messages.joints)
        self._memory = PathMemory(self.native.shape)

    def _kernels(self) -> CycleKernels:
        """Return the rules and laws of the thread as kernels."""
        controller = self.controller
        robot = controller.robot
        terms = controller.compensate
        commanded = commanded_joints(robot, controller.followed)
        if self.loops is None:
            laws = controller_laws(robot, terms)
            laws |= {mode: law.traced() for mode, law in self._laws.items()}
            laws = {mode: law.beside(robot, terms.arm).of_joints(commanded)
                    for mode, law in laws.items()}
            return CycleKernels(robot, terms, laws, commanded=commanded)
        joints = Actuation(tuple(self._follow), commanded, controller.preload)
        # It explains why a desired configuration is refused.
        self._desired_loops = LoopTracker(robot, controller.followed,
                                          max_figure=SINGULAR)
        return CycleKernels(robot, terms, closed_loop_laws(robot, terms, joints),
                            LoopRules(robot, terms, joints), commanded)

    def compile(self, *, other_modes: bool = False) -> None:  # noqa: A003
        """Compile what commands of the mode need, or of the other modes."""
        kernels = self.native.kernels
        modes = [self.controller.mode]
        if other_modes:
            modes = [mode for mode in kernels.answers if mode not in modes]
        kernels.compile(modes, self._guard is not None)

    def use_guard(self, guard: GuardSide) -> None:
        """Ask torque_guard as `TorquePath`, by the loop."""
        self._guard = guard
        self.executor.ask(guard.requests)

    def hear(self, numbers: Array) -> None:
        """Note a message of torque_guard, and answer the state that waited for it."""
        if self.running:
            self.executor.hear(numbers)
            self._look_at_clock()

    @property
    def guard_seen(self) -> float:
        """Return when the thread heard torque_guard last, whether or not it is reported."""
        loop = self.native
        known = cycle_rules.unpacked_path(loop.path, loop.shape).arbitration
        return float(Arbitration(*known).seen)

    def close(self) -> None:
        """End what runs the loop."""
        self.executor.close()

    # What Python passes to the thread.

    def set_loads(self, loads: GravityAndPayload) -> None:
        """Use gravity and payload from the next cycle on; callable from any thread."""
        super().set_loads(loads)
        self._replan()

    def _replan(self) -> None:
        """Make what is valid now the plan of the next cycle; callable from any thread."""
        if not self.running:
            return
        with self._lock:
            if self._changes_last:
                return
            self.native.use(self._plan())

    @contextmanager
    def one_change(self) -> Iterator[None]:
        """Make the changes in a `with` block effective together, in any thread."""
        with self._lock:
            is_part = self._changes_last
            self._changes_last = True
            try:
                yield
            finally:
                self._changes_last = is_part
                self._replan()

    def _plan(self) -> CyclePlan:
        """Return the plan of the next cycle."""
        controller = self.controller
        parameters = controller.robot.parameters
        if self._loads is not None:
            parameters = self._loads.parameters_of(controller.robot)
        # Layouts of messages, the motions with times since the epoch, and the periods of
        # waiting.
        layouts = []
        for layout in self._layouts:
            if layout.has_velocity or not self.need_velocity:
                layouts.append(layout)
        motions = []
        for scheduled in self.active_motion.scheduled:
            if scheduled is not None:
                motion, start = scheduled
                scheduled = motion, start - self._epoch
            motions.append(scheduled)
        period = max(round(LONGEST_WAIT * self.states.timeout), NANO // 1000)
        longest = None
        if self._guard is not None:
            longest = round(self._begun.shortest)
        return CyclePlan(self.native, controller.mode, self._settings(), parameters.block,
                         layouts, motions, period, self._replay, longest)

    def _numbers(self) -> Array:
        """Return the settings of the law of the mode."""
        law = self._laws.get(self.controller.mode)
        return super()._numbers() if law is None else law.settings_numbers()

    def _settings(self) -> CycleSettings:
        """Return the numbers of a plan."""
        settings = super()._settings()
        law = np.zeros(self.native.shape.law)
        numbers = self._law_numbers
        own_law = self._laws.get(self.controller.mode)
        if own_law is not None:
            numbers = np.concatenate([numbers, own_law.order_numbers(self._epoch)])
        law[:len(numbers)] = numbers
        return settings._replace(
            drops=float(self._last.drops), wrench_timeout=self._wrench_timeout,
            wrenches=self._measured_wrenches(), loop_limits=self._loop_limits(), law=law)

    def _loop_limits(self) -> Array:
        """Return the limits of the measured and the desired closed loops."""
        if self.loops is None:
            return np.zeros(0)
        return np.concatenate([squared_limits(self.loops.tracker),
                               squared_limits(self._desired_loops)])

    @property
    def _wrench_timeout(self) -> float:
        """Return the age after which a measured wrench counts no more, ns."""
        return 0.0 if self.wrenches is None else float(self.wrenches.timeout)

    def _measured_wrenches(self) -> Array:
        """Return the latest wrench of each frame, as the rules use it."""
        frames = len(self.controller.robot.equations.wrench_frames)
        rows = np.zeros((frames, cycle_rules.WRENCH))
        rows[:, 0] = NEVER
        if self.wrenches is not None:
            # A copy, because the main thread may add a frame meanwhile.
            for row, (stamp, wrench) in list(self.wrenches.latest.items()):
                rows[row] = [stamp - self._epoch, *wrench]
        return rows.ravel()

    def _initial(self) -> PathState:
        """Return the state of the path at its start."""
        path = super()._initial()
        if self.loops is None:
            return path
        robot = self.controller.robot
        search = search_array(self.loops.tracker)
        return path._replace(loops=initial_loops(search, robot.n_q, robot.n))

    def law_changed(self) -> None:
        """Use new settings and targets of the mode's law from the next cycle on."""
        self._replan()

    # The life of the thread.

    def start(self) -> None:
        """Start; the first command follows the first states."""
        self.running = False
        super().start()
        # Counts and clocks begin again; what was not taken before is not reported.
        loop = self.native
        self._last = self._memory.path
        self._replay = 0, b''
        self._noted = 0
        self._counted = {'lost': 0, 'not_taken': loop.number('not_taken')}
        self._applied_loads = None
        loop.begin(self._epoch, self._last)
        loop.simulate_time(self.executor.hears_time)
        # States of a time in which the node did not command are dropped, because a
        # simulated arm may have been reset since; the layout of the last one is kept.
        self._idle.extend(self.executor.waiting_states())
        if self._idle and self._reader.read(self._idle[-1], self.need_velocity) in (
                None, NOT_FINITE):
            self._keep_layout(self._idle[-1])
        self._idle.clear()
        self._replan()
        warning = self.executor.start()
        if warning:
            self._warn('native torque path', warning)

    def stop(self, reason: str = 'the node was deactivated') -> None:
        """Stop the loop, then command zeros and ignore further states."""
        self.executor.stop()
        if self.running:
            self._read_all()
        super().stop(reason)

    def _look_at_clock(self) -> None:
        """Apply what is due without a state, if the thread does not."""
        if self.running:
            self.executor.look_at_clock()
            self.read_reports()

    def on_clock_jump(self) -> None:
        """Drop motions and stamps of the time before the jump, in the thread."""
        if not self.executor.hears_time:  # else the thread sees it
            self._counts['jumps'] += 1.0
            self._replan()
            self._look_at_clock()

    def interrupt(self, stamp: int, reason: str) -> bool:
        """End the desired motion in a stop from now on: reports of states may be late."""
        return super().interrupt(max(stamp, self.now), reason)

    def _end(self, reason: str) -> None:
        """Stop the path and report a fault, because the thread has ended by itself."""
        self.executor.stop()
        ended = f'{ENDED}: {reason}'
        super().stop(ended)
        self.ended = ended
        self._report_fault(ENDED, f'{reason}; commanding zeros; deactivate and activate '
                           'the node')

    # What the thread reports.

    def on_state(self, data: bytes) -> None:
        """Compute and publish the command for one serialized JointState."""
        if not self.running:
            self._idle.append(data)
            return
        self.executor.on_state(data)
        self.read_reports()

    def read_reports(self) -> None:
        """
        Count, warn and observe what the thread did; called in the main thread.

        Raises
        ------
        Exception
            The middleware refused a message; a thread has ended.

        """
        if not self.running:
            return
        self._read_all()
        if self.refused:
            raise self.executor.error or RuntimeError(
                'torques: refused by the middleware, code '
                f'{self.native.block.refused}; expected publishers that accept them')
        code = self.native.number('ended')
        if code:
            self._end(f'rcl returned {code}')

    def _read_all(self) -> None:
        """Read the reports and the counters of the thread."""
        # Loads first, so that reports are read with the parameters of their cycles.
        if self._loads is not self._applied_loads:
            self._apply_loads()
        while reports := self.native.reports():
            for report in reports:
                self._read(report)
            self._noted += len(reports)
        # Cycles that no report describes any more were answered nevertheless.
        self.statistics.unobserved += self._warn_of(
            'lost', 'cycles', 'answered, but not observed: the interpreter was busy')
        self._warn_of('not_taken', 'messages', 'not returned by the middleware')

    @property
    def refused(self) -> bool:
        """Return whether the middleware refused a message of the thread, which ended."""
        return bool(self.native.number('refused'))

    def _warn_of(self, counter: str, subject: str, words: str) -> int:
        """Warn of what a counter of the thread has counted since the last call."""
        count = self.native.number(counter)
        grown = count - self._counted[counter]
        self._counted[counter] = count
        if grown:
            self._warn(subject, f'{grown} {words}')
        return grown

    def _read(self, report: Report) -> None:
        """Read one report."""
        # Lost states are those that the thread did not see, by their sequence numbers.
        if report.lost > self._counted['lost']:
            self.lost_states.skip()
        is_of_state = report.kind not in (ELAPSED, HEARD)
        if is_of_state:
            self.lost_states.note_number(report.sequence)
        if report.kind == UNKNOWN:
            self._learn(report)
            return
        # Times of the thread count from the activation.
        now = round(report.event.now) + self._epoch
        dropped = self._note_drop(self._last, report.path, now)
        if self._guard is not None:
            self._note_guard(self._guard, self._last, report.path, dropped)
        if is_of_state:
            self._message_fault = self._reader.read(report.message, self.need_velocity)
        if self.loops is not None:
            self._mirror_loops(self.loops, report.path)
        if is_of_state:
            self._note_state(report, now)
        self._last = report.path
        self._memory.array[:] = report.numbers
        self._note_speeds()

    def _note_state(self, report: Report, now: int) -> None:
        """Count and observe what followed a state."""
        reason = int(report.path.reason)
        if reason == cycle_results.ACCEPTED:
            self._note_command(report, now)
        elif reason == cycle_results.WAITING:
            self._last_good = round(float(report.path.last_stamp)) + self._epoch
        elif reason != cycle_results.FIRST:
            self._note_dropped_state(report, reason, now)

    def _mirror_loops(self, loops: ClosedLoopReader, path: PathState) -> None:
        """Copy the closed loops of the thread."""
        robot = self.controller.robot
        memory = unpacked_loops(path.loops, robot.n_q, robot.n)
        loops.compare()
        mirror(loops.tracker, memory.measured)
        mirror(self._desired_loops, memory.desired)

    def _note_command(self, report: Report, now: int) -> None:
        """Count a command and call the observers."""
        path = report.path
        stamp = round(report.event.stamp) + self._epoch
        is_limited = bool((path.clamped > 0.5).any() or (path.rate_limited > 0.5).any())
        at = min(stamp, now)
        self._last_good = at
        self.statistics.command((report.end - report.begin) / NANO,
                                (now - stamp) / NANO, is_limited)
        self.statistics.full_parses = self._reader.full_parses
        motion = None
        if report.event.moving:
            motion, _ = self.active_motion.at(at)
        law = self._laws.get(self.controller.mode)
        # A report from before a change of the mode has the memory of another law.
        if law is not None and path.restarts == self._counts['restarts']:
            law.mirror(path.memory, self._epoch)
        external = None
        if self.wrenches is not None:  # it reports those that are stale
            external = self.wrenches.torques(self._reader.q, now)
        if self._observers:
            self._observe(path, at, motion, report.event.moment, external)

    def _clear_motion(self, reason: str, path: PathState) -> bool:
        """Drop the desired motion, as the thread did; return whether there was one."""
        # In one change: a plan of another thread that has the motion and the new count
        # of drops would let the arm follow it again.
        with self._lock:
            self._last = self._last._replace(drops=path.drops)
            return self.active_motion.clear(reason)

    def _note_dropped_state(self, report: Report, code: int, now: int) -> None:
        """Count and explain a state that was not answered."""
        path = report.path
        stamp = round(report.event.stamp) + self._epoch
        if code == cycle_results.OUT_OF_ORDER and report.message == self._replay[1]:
            # It came in order, but the thread answered other publishers meanwhile.
            self._drop(LEARNED, f'{len(report.message)} bytes; the next one of its '
                       'publisher is judged at once')
            return
        if code < cycle_results.NOT_FINITE:
            self._drop_stamp(code, stamp, now)
            return
        if code == cycle_results.NO_TORQUE:
            detail = TOO_LARGE_TORQUE
        elif code == cycle_results.NOT_FINITE and self._message_fault is not None:
            detail = self._reader.detail
        elif code == cycle_results.REFUSED:
            detail = self._refused_motion(path)
        elif code <= cycle_results.JUMP:
            memories = self._last.states, path.states
            detail = CHANGED
            if self.states.finds(code, *memories):
                detail = self.states.explain(code, *memories)
        else:
            assert self.loops is not None
            detail = refusal(self.loops.tracker).detail
        self._drop(REASONS[code], detail)
        if self._begins_fault(self._last, path):
            self._note_fault(bool(self._last.commanding), path, code, now)

    def _refused_motion(self, path: PathState) -> str:
        """Drop a motion, or a pose, without a torque; return the details."""
        robot = self.controller.robot
        # The search along the desired motion knows more than the law's torque.
        memory = unpacked_loops(path.loops, robot.n_q, robot.n)
        detail = ('closed loops: the actuators do not determine the motion there; expected '
                  'a configuration that is not singular')
        if not memory.tracking and search_of(self._desired_loops).outcome:
            detail = str(refusal(self._desired_loops))
        dropped = self._clear_motion(detail, path)
        return detail + '; desired motion dropped' * dropped

    def _learn(self, report: Report) -> None:
        """Learn the layout of a message and let the thread answer it, or drop it."""
        data = report.message
        if not data:
            self._drop(MALFORMED, TOO_LARGE)
            return
        reader = self._reader
        fault = reader.read(data, self.need_velocity)
        self.statistics.full_parses = reader.full_parses
        if fault is not None and fault is not NOT_FINITE:
            self._drop_message(fault)
            return
        if not any(layout.fits(data) for layout in reader.layouts):
            # Another encoding than plain little-endian CDR.
            data = serialize_message(deserialize_message(data, JointState))
            reader.read(data, self.need_velocity)
            if len(data) > LARGEST:
                self._drop(MALFORMED, TOO_LARGE)
                return
        self._keep_layout(data)
        number, _ = self._replay
        self._replay = number + 1, data
        self._replan()
        self.executor.on_state(data)

    def _keep_layout(self, data: bytes) -> None:
        """Let the thread know the layout of a message that was read last."""
        # The reader caches one layout of each length; two publishers may have the same.
        if not any(layout.fits(data) for layout in self._layouts):
            learned = [layout for layout in self._reader.layouts if layout.fits(data)]
            self._layouts = [*self._layouts, *learned][-MAX_LAYOUTS:]

    def idle_states(self) -> tuple[Array | None, float]:
        """Return positions and period before the start, as `TorquePath`."""
        self._idle.extend(self.executor.waiting_states())
        return super().idle_states()

    def catch_up(self) -> None:
        """
        Wait for the reports of all cycles until now, if the interpreter lagged behind.

        After a long pause of the interpreter the ring has old cycles, and the arm may be
        elsewhere by now: then also for one of now.
        """
        is_reader = threading.current_thread() is threading.main_thread()
        until = time.monotonic() + LONGEST_LAG
        written = self.native.number('head')
        while self.running and time.monotonic() < until:
            if is_reader:
                self.read_reports()
            age = self.now - self._epoch - self._last.last_now
            # After a timeout, the next report may be that of the first state.
            if self._noted >= written and (self.timed_out or age < self.states.timeout):
                return
            time.sleep(LOOK_AGAIN)

    def desired(self, stamp: int) -> State | None:
        """Return the initial q, u and udot of a new motion, as `TorquePath`."""
        self.catch_up()
        return super().desired(stamp)

    def measured(self) -> Array | None:
        """Return the last accepted positions, (n,), for other threads, as `TorquePath`."""
        self.catch_up()
        return super().measured()

    @property
    def _held_pose(self) -> Array | None:
        """Return the positions that the thread holds, (n,), or None."""
        path = self._last
        return path.pose if path.holding else None
