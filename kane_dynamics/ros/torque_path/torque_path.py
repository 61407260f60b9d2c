"""
The torque path: publishes one command for each joint state, and zeros when states stop.

An executor runs the message loop (`executors`): a thread, which the interpreter cannot
delay, or callbacks. This module passes it parameters, loads and motions as plans, and reads
its reports: statistics, warnings and observers run here and may lag behind a thread. A law
that cannot be compiled is evaluated by Python in callbacks (`python_rules`).
"""

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
import time
from typing import Any

from kane_dynamics.control.controller import Controller, Mode
from kane_dynamics.control.stopping import motion_to_rest
from kane_dynamics.control.torque_limiter import Command
from kane_dynamics.control.traced_laws import (Actuation, closed_loop_laws,
                                               controller_laws, MODES)
from kane_dynamics.control_cycle import cycle_results, cycle_rules
from kane_dynamics.control_cycle.arbitration import Arbitration, UNGUARDED
from kane_dynamics.control_cycle.cycle import (COMMANDED_AT, COMMANDING, Cycle, FAULT,
                                               LAST_HEARD, LAST_STAMP, PathMemory, PERIOD,
                                               PUBLISH, REQUEST, SENT_AT, STOP_BEGAN,
                                               TIMED_OUT)
from kane_dynamics.control_cycle.cycle_results import NEVER
from kane_dynamics.control_cycle.cycle_rules import (begun_stop, CycleSettings,
                                                     initial_path, NO_REQUEST, PathState)
from kane_dynamics.control_cycle.loop_rules import (initial_loops, LoopRules,
                                                    unpacked_loops)
from kane_dynamics.control_cycle.state_judgement import (COMPARISONS, SPEED_WINDOW,
                                                         UNLIMITED)
from kane_dynamics.loop_tracking.loop_tracker import (LoopTracker, mirror, refusal,
                                                      search_array, search_of,
                                                      squared_limits)
from kane_dynamics.mechanics.constraints.conditioning import SINGULAR
from kane_dynamics.motion.motion import Motion, State
from kane_dynamics.native.runtime.message_loop import ELAPSED, HEARD, UNKNOWN
from kane_dynamics.ros.common.cdr import STAMP, STAMP_AT
from kane_dynamics.ros.common.conversion import Array, NANO
from kane_dynamics.ros.common.lost_messages import LostMessages
from kane_dynamics.ros.common.node_statistics import Statistics
from kane_dynamics.ros.common.stamped_numbers import MALFORMED, NOT_FINITE
from kane_dynamics.ros.loads.gravity_payload import GravityAndPayload
from kane_dynamics.ros.loads.wrench_input import WrenchInput
from kane_dynamics.ros.modes.live_law import NativeLaw
from kane_dynamics.ros.modes.task_modes import native_laws, NATIVE_MODES
from kane_dynamics.ros.parameters.command_form import CommandForm, EFFORT, Reference
from kane_dynamics.ros.torque_path.active_motion import ActiveMotion
from kane_dynamics.ros.torque_path.closed_loop_reader import (ClosedLoopReader,
                                                              commanded_joints)
from kane_dynamics.ros.torque_path.command_messages import CommandMessages
from kane_dynamics.ros.torque_path.cycle_observer import (CycleObserver, GuardSide,
                                                          ObservedCycle)
from kane_dynamics.ros.torque_path.drop_reasons import (FALSE_SPEEDS, FOREIGN, LEARNED,
                                                        MISSING, REASONS)
from kane_dynamics.ros.torque_path.executors import CallbackExecutor, ThreadExecutor
from kane_dynamics.ros.torque_path.joint_state_reader import (JointStateLayout,
                                                              JointStateReader,
                                                              MAX_LAYOUTS)
from kane_dynamics.ros.torque_path.native_loop import (CyclePlan, LARGEST, NativeLoop,
                                                       Report)
from kane_dynamics.ros.torque_path.python_rules import controller_rules, PythonRules
from kane_dynamics.ros.torque_path.state_check import StateCheck
import numpy as np
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

IDLE = 11  # states before the start, whose median distance is their period
# Changes in `CycleSettings`, on which a rule acts where their number has grown
COUNTS = ('restarts', 'blends', 'jumps', 'silences')
LONGEST_WAIT = 0.2  # of the timeout, between two looks at the clock
LONGEST_LAG = 0.1  # s, that a new motion waits for a report of now
LOOK_AGAIN = 0.001  # s
# A reason with its details
CLOCK_JUMPED = 'clock', 'jumped backward or replaced; desired motion dropped'
TOO_LARGE_TORQUE = ('torques: not finite; expected a state, a motion and gains in a '
                    'physical range')
ENDED = 'the native torque path ended'
TOO_LARGE = f'empty or more than {LARGEST} bytes; expected at most as many'
# The thread has judged with limits of its time.
CHANGED = 'compared with limits, or a state, that have changed since'


def python_reason(values: Mapping[str, Any], controller: Controller,
                  loops: ClosedLoopReader | None) -> str:
    """
    Return why Python has to evaluate the law or the commands; empty if it need not.

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
    looped = loops is not None
    # The reasons in the order in which users would look for them.
    modes = MODES if looped else (*MODES, *NATIVE_MODES)
    if values['commands.form'] != EFFORT or (values['efforts.scale'] != 1.0).any():
        return 'commands.form or efforts.scale'
    if not looped and not robot.equations.in_joint_rates:
        return 'chosen speeds'
    if controller.bending is not None:
        return 'flexible links'
    if robot.equations.carries_loads and not controller.compensate.complete:
        return 'friction that depends on loads, with arm_compensates'
    if looped and controller.compensate.arm is not None:
        return 'arm_gravity or arm_payload of an arm with closed loops'
    for mode in (controller.mode, *controller.laws, values['mode'], *values['modes']):
        if mode not in modes:
            return f'mode {mode}' + ' of an arm with closed loops' * looped
    return ''


class TorquePath:
    """
    Computes a command for each joint state while it is running.

    The attributes that describe the last cycle are those of the last report that was read.

    Parameters
    ----------
    controller : Controller
    commands, torques : Publisher
        Publishers of Float64MultiArray and of JointState; they receive serialized
        messages.
    now : callable
        Returns the node's clock, ns.
    values : mapping
        The node's parameters; state_timeout, state_check.* and limits.velocity are used.
    statistics : Statistics
    warn : callable
        Called with the reason and the details of each dropped state.
    stamped : Publisher, optional
        Publisher of the commands with the stamp of their state.
    loops : ClosedLoopReader, optional
        Reads the states of an arm with closed loops.
    report_fault : callable, optional
        Called like `warn` where states are refused for longer than the grace time.
    rules : callable, optional
        Returns the rules of the path that Python evaluates, instead of the compiled laws of
        the controller.

    Attributes
    ----------
    native : NativeLoop
        The memory of the loop, and its functions.
    executor : CallbackExecutor or ThreadExecutor
        Runs the loop: callbacks, or a thread from its assignment on.
    rules : PythonRules or None
        Those that Python evaluates; None if the laws are compiled.
    lost_states : LostMessages
        Counts lost states by the publisher's numbers, in a thread.
    ended : str
        Why the path stopped by itself; empty if it did not, and after `stop`.
    false_speeds : tuple of str
        Joints whose speeds contradict their positions.
    failure : str
        Why the motion was stopped since the start, where the process has failed otherwise.

    """

    def __init__(self, controller: Controller, commands: Publisher, torques: Publisher,
                 now: Callable[[], int], values: Mapping[str, Any],
                 statistics: Statistics,
                 warn: Callable[[str, str], None], stamped: Publisher | None = None,
                 loops: ClosedLoopReader | None = None,
                 report_fault: Callable[[str, str], None] | None = None,
                 rules: Callable[['TorquePath'], PythonRules] | None = None) -> None:
        robot = controller.robot
        self.controller = controller
        self.statistics = statistics
        self.running = False
        self._changes_last = False  # whether changes that belong together are under way
        self._now = now
        self._warn = warn
        self._report_fault = report_fault or warn
        self._reader = loops or JointStateReader(robot.joint_names)
        self.loops = loops
        self.states = StateCheck(robot, self._reader.joints, self._reader.state, values)
        self._reader.judged = True
        commanded = commanded_joints(robot, controller.followed)
        self.form = CommandForm(robot, commanded, values)
        self._pose: Array | None = None  # that a drive holds without a motion
        # Torque of the drives with the last command, feedback included, its stamp and the
        # period of the states by then, ns; None where the rate limit counts from the torque
        # of the path.
        self._drive: tuple[Array, int, float] | None = None
        self.messages = CommandMessages(robot.joint_names, commanded, commands, torques,
                                        stamped, self.form.interfaces)
        self._follow = list(map(robot.joint_names.index, controller.followed))
        self.wrenches: WrenchInput | None = None
        self._guard: GuardSide | None = None
        self._begun = UNGUARDED  # what the guard was at the start
        self._observers: list[CycleObserver] = []
        self._idle: deque[bytes] = deque(maxlen=4 * IDLE)  # while it does not run
        self._failed: set[CycleObserver] = set()  # since the start
        self._observer_failure = ''  # that is to be raised
        self._loads: GravityAndPayload | None = None
        self._applied_loads: GravityAndPayload | None = None
        self._epoch = 0  # of the times in the memory, ns
        self._last_good = 0  # time of the last valid state, ns
        self._reason = ''  # of a fault
        self._silence_reason = ''
        self.ended = ''
        self.failure = ''
        self.false_speeds: tuple[str, ...] = ()
        self._counts = dict.fromkeys(COUNTS, 0.0)
        self._make_loop(values, rules)
        self.active_motion = ActiveMotion(self._replan)
        self.executor: CallbackExecutor | ThreadExecutor = CallbackExecutor(
            self.native, self._now, self._send_of_cycle)
        self._mode = controller.mode
        self._law_numbers = self._numbers()
        self._last = self._initial()  # as reported
        self._replay = 0, b''
        self._message_fault: str | None = None  # of the last report, by the reader
        self._layouts: list[JointStateLayout] = []  # that the loop knows
        self._counted: dict[str, int] = {}  # by the loop, as warned of
        self._noted = 0  # reports that were read since the start
        self.lost_states = LostMessages()
        self.set_limits(values)

    def _make_loop(self, values: Mapping[str, Any],
                   rules: Callable[['TorquePath'], PythonRules] | None) -> None:
        """Make the loop with its rules and laws, and the memory of its reports."""
        controller = self.controller
        robot = controller.robot
        terms = controller.compensate
        commanded = commanded_joints(robot, controller.followed)
        loops = None
        if self.loops is not None:
            joints = Actuation(tuple(self._follow), commanded, controller.preload)
            loops = LoopRules(robot, terms, joints)
            # It explains why a desired configuration is refused.
            self._desired_loops = LoopTracker(robot, controller.followed,
                                              max_figure=SINGULAR)
        self._laws: dict[Mode, NativeLaw] = {}
        laws = {}
        if rules is None and python_reason(values, controller, self.loops):
            rules = controller_rules
        self.rules: PythonRules | None = None
        if rules is not None:
            self.rules = rules(self)
        elif self.loops is not None:
            laws = closed_loop_laws(robot, terms, joints)
        else:
            self._laws = native_laws(controller)
            laws = controller_laws(robot, terms)
            laws |= {mode: law.traced() for mode, law in self._laws.items()}
            laws = {mode: law.beside(robot, terms.arm).of_joints(commanded)
                    for mode, law in laws.items()}
        by_name = {} if self.rules is None else self.rules.by_name
        cycle = Cycle(robot, terms, laws, loops, commanded, is_told='permit' in by_name)
        self.native = NativeLoop(cycle, self.messages.joints, by_name)
        self._memory = PathMemory(cycle.shape)

    def compile(self, *, other_modes: bool = False) -> None:  # noqa: A003
        """Compile what commands of the mode need, or of the other modes."""
        kernels = self.native.kernels
        modes = [self.controller.mode]
        if other_modes:
            modes = [mode for mode in kernels.answers if mode not in modes]
        kernels.compile(modes, self._guard is not None)

    # What Python passes to the loop.

    def set_limits(self, values: Mapping[str, Any]) -> None:
        """Judge states by checked parameters from the next one on."""
        self.states.update(values)
        self._replan()

    def set_loads(self, loads: GravityAndPayload) -> None:
        """Use gravity and payload from the next cycle on."""
        self._loads = loads
        self._replan()

    def law_changed(self) -> None:
        """Use new settings and targets of the mode's law from the next cycle on."""
        self._replan()

    def _replan(self) -> None:
        """Make what is valid now the plan of the next cycle."""
        if self.running and not self._changes_last:
            self.native.use(self._plan())

    @contextmanager
    def one_change(self) -> Iterator[None]:
        """Make the changes in a `with` block effective together."""
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

    def _count_changes(self) -> None:
        """Count a change of the mode or of the law's settings since the last call."""
        # The counters show the rules that their memory is of another law.
        mode = self.controller.mode
        numbers = self._numbers()
        if mode != self._mode:
            self._counts['restarts'] += 1.0
            self._counts['blends'] += 1.0
        elif not np.array_equal(numbers, self._law_numbers):
            self._counts['blends'] += 1.0
        self._mode = mode
        self._law_numbers = numbers

    def _settings(self) -> CycleSettings:
        """Count changes of the law, and return the settings of now, for the rules."""
        self._count_changes()
        controller = self.controller
        # A rate without a limit is a factor of 0 and an unlimited bound: the kernel has
        # no branch.
        rate = self.messages.of_commanded(controller.rate_limit)
        effort = self.messages.of_commanded(controller.effort_limit)
        is_limited = np.isfinite(rate)
        check = self.states
        # The settings of the law, and what messages ask it for.
        law = np.zeros(self.native.shape.law)
        numbers = self._law_numbers
        own_law = self._laws.get(controller.mode)
        if own_law is not None:
            numbers = np.concatenate([numbers, own_law.order_numbers(self._epoch)])
        if self.rules is None:
            law[:len(numbers)] = numbers
        return CycleSettings(
            timeout=float(check.timeout), grace=float(check.grace),
            holds=float(check.holds), stop_time=check.stop_time * NANO,
            compares=float(check.compares),
            compares_speeds=float(check.compares_speeds), blend_time=controller.blend_time * NANO,
            **self._counts, drops=float(self._last.drops),
            wrench_timeout=self._wrench_timeout,
            bounds=check.bounds.ravel(), turned=check.turned.copy(),
            effort=np.minimum(effort, UNLIMITED), slope=np.where(is_limited, rate, 0.0),
            free=np.where(is_limited, 0.0, UNLIMITED), wrenches=self._measured_wrenches(),
            loop_limits=self._loop_limits(), law=law)

    def _numbers(self) -> Array:
        """Return the settings of the law of the mode."""
        law = self._laws.get(self.controller.mode)
        if law is not None:
            return law.settings_numbers()
        return np.concatenate([self.controller.kp, self.controller.kd])

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
            for row, (stamp, wrench) in self.wrenches.latest.items():
                rows[row] = [stamp - self._epoch, *wrench]
        return rows.ravel()

    def blend(self) -> None:
        """Continue from the last command, as after a change of a law."""
        self._counts['blends'] += 1.0
        self._replan()

    # What the rules know of the path.

    @property
    def known(self) -> bool:
        """Return whether there is an accepted state."""
        return self._memory.known

    @property
    def commanding(self) -> bool:
        """Return whether the last command may be non-zero."""
        return self._memory.entries[COMMANDING] > 0.5

    @commanding.setter
    def commanding(self, commanding: bool) -> None:
        self._memory.array[COMMANDING] = self.native.path[COMMANDING] = commanding

    @property
    def timed_out(self) -> bool:
        """Return whether joint states have timed out."""
        return self._memory.entries[TIMED_OUT] > 0.5

    @property
    def last_update(self) -> float:
        """Return the time of the last command, s of `perf_counter`; 0: none yet."""
        return self._memory.entries[COMMANDED_AT] / NANO

    @property
    def fault(self) -> str:
        """Return why states are refused for longer than the grace time, if they are."""
        return self._reason if self._memory.entries[FAULT] > 0.5 else ''

    def time_of(self, time_of_path: float) -> int:
        """Return a time of the path on the node's clock, ns."""
        return round(time_of_path) + self._epoch

    @property
    def _last_heard(self) -> int:
        """Return the time of the last state in time, ns."""
        return round(self._memory.entries[LAST_HEARD]) + self._epoch

    def add_observer(self, observer: CycleObserver, need_effort: bool) -> None:
        """
        Call `observer` after each command.

        Read the efforts of states if it needs them.
        """
        # A new list, because a cycle may go through the present one.
        self._observers = [*self._observers, observer]
        self._reader.need_effort |= need_effort

    def remove_observer(self, observer: CycleObserver) -> None:
        """Stop calling `observer`."""
        self._observers = [other for other in self._observers if other is not observer]

    def catch_up(self) -> None:
        """
        Wait for the reports of all cycles until now, if the interpreter lagged behind.

        After a long pause of the interpreter the ring has old cycles, and the arm may be
        elsewhere by now: then also for one of now.
        """
        until = time.monotonic() + LONGEST_LAG
        written = self.native.number('head')
        while self.running and time.monotonic() < until:
            self.read_reports()
            age = self.now - self._epoch - self._last.last_now
            # After a timeout, the next report may be that of the first state.
            if self._noted >= written and (self.timed_out or age < self.states.timeout):
                return
            time.sleep(LOOK_AGAIN)

    def desired(self, stamp: int) -> State | None:
        """
        Return the initial q, u and udot of a new motion.

        The result is None before the first accepted state.
        """
        self.catch_up()
        state = self.active_motion.desired(stamp)
        if state is None and self.last_update and self.known:
            path = self._last
            q = path.pose if path.holding else self._accepted()[self._follow]
            state = q.copy(), 0.0 * q, 0.0 * q
        return state

    def measured(self) -> Array | None:
        """
        Return the last accepted positions, (n,).

        The result is None without a valid state, as before the first one.
        """
        self.catch_up()
        lost = self.loops is not None and self.loops.lost
        valid = self.running and self.last_update and self.known and not (
            lost or self.timed_out or self.fault)
        return self._accepted() if valid else None

    def measured_speeds(self) -> Array | None:
        """Return the speeds, (n,), of the state of `measured`."""
        return None if self.measured() is None else self._accepted_speeds()

    @property
    def period(self) -> float:
        """Return the mean time between two states, as the cycles measure it, s; 0: unknown."""
        return self._memory.entries[PERIOD] / NANO

    def idle_states(self) -> tuple[Array | None, float]:
        """
        Return the last positions, (n_q,), and the period of the states before the start.

        They are None and 0 s where too few states are known.
        """
        self._idle.extend(self.executor.waiting_states())
        # Other publishers, as of a gripper, send states to the topic as well.
        states = [data for data in self._idle if self._reader.read(data, False) is None]
        states = states[-IDLE:]
        if len(states) < IDLE:
            return None, 0.0
        self._reader.read(states[-1], False)
        stamps = []
        for data in states:
            sec, nanosec = STAMP.unpack_from(data, STAMP_AT)
            stamps.append(sec * NANO + nanosec)
        return self._reader.q.copy(), max(float(np.median(np.diff(stamps))) / NANO, 0.0)

    def _accepted(self) -> Array:
        """Return a copy of all positions in the last accepted state, (n_q,)."""
        return self._memory.q.copy()

    def _accepted_speeds(self) -> Array:
        """Return a copy of the speeds of the last accepted state, (n,)."""
        return self._memory.u.copy()

    def require_locked(self, locked: Mapping[str, float]) -> None:
        """Drop states in which joints that are locked at 0 are farther from it than stated."""
        self._reader.locked = locked

    def take_foreign_joints(self) -> set[tuple[str, ...]]:
        """Return and clear the name lists of states that contained other joints only."""
        foreign = self._reader.foreign_joints
        self._reader.foreign_joints = set()
        return foreign

    def take_parts(self) -> list[tuple[str, ...]]:
        """Return and clear the joints of states that together have all joints."""
        parts = self._reader.partial_joints
        self._reader.partial_joints = set()
        together = set().union(*parts)
        return sorted(parts) if together == set(self._reader.joints) else []

    # The life of the path.

    def start(self) -> None:
        """Start; the first command follows the first states."""
        self.running = False
        self.active_motion.clear('the node was activated')
        # Everything that refers to an earlier activation is forgotten.
        self.ended = ''
        self.failure = ''
        self._epoch = self._last_good = self._now()
        self._counts = dict.fromkeys(COUNTS, 0.0)
        self._memory.path = self._initial()
        self._pose = self._drive = None
        self.controller.stop()
        if self.loops is not None:
            self.loops.restart()
        if self.wrenches is not None:
            self.wrenches.clear()
        self._failed.clear()
        self._observer_failure = ''
        for observer in self._observers:
            observer.start()
        self.running = True
        self._start_loop()

    def _start_loop(self) -> None:
        """Let the loop begin with the initial state of the path and the plan of now."""
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

    def _initial(self) -> PathState:
        """Return the state of the path at its start."""
        if self._guard is not None:
            self._begun = self._guard.beginning()
        path = initial_path(self._memory.shape, 0.0, self._begun)
        return path if self.loops is None else self._with_new_loops(path)

    def _with_new_loops(self, path: PathState) -> PathState:
        """Return a path whose closed loops begin as the reader's."""
        assert self.loops is not None
        robot = self.controller.robot
        search = search_array(self.loops.tracker)
        return path._replace(loops=initial_loops(search, robot.n_q, robot.n))

    def restart_loops(self) -> None:
        """Begin with the assembly mode of the file, or of the next state."""
        if self.loops is not None:
            self.loops.restart()
            self.change(self._with_new_loops)

    def stop(self, reason: str = 'the node was deactivated') -> None:
        """Stop the loop, then command zeros and ignore further states, for a reason."""
        self.executor.stop()
        if self.running:
            self._read_all()
        self._stop_commands(reason)

    def _stop_commands(self, reason: str) -> None:
        """Command zeros, drop the motion, and ignore further states."""
        self.running = False
        self.ended = ''
        self.active_motion.clear(reason)
        self.command_zeros()
        for observer in self._observers:
            observer.stop()

    def command_zeros(self) -> None:
        """Command zeros immediately, without the rate limit."""
        self.change(cycle_rules.with_zeros, float(self._now() - self._epoch))

    def check_timeout(self) -> None:
        """Command zeros, once, if the last state in time has timed out."""
        self._look_at_clock()

    def _look_at_clock(self) -> None:
        """Apply what is due without a state, if the thread does not."""
        if self.running:
            self.executor.look_at_clock()
            self.read_reports()

    def time_out(self, reason: str) -> None:
        """Command zeros until the next valid state, and drop the desired motion."""
        self._silence_reason = reason
        self._counts['silences'] += 1.0
        self._replan()
        self._look_at_clock()

    def on_clock_jump(self) -> None:
        """Drop motions and stamps of the time before the jump, in the thread."""
        if not self.executor.hears_time:  # else the thread sees it
            self._counts['jumps'] += 1.0
            self._replan()
            self._look_at_clock()

    def _end(self, reason: str) -> None:
        """Stop the path and report a fault, because the thread has ended by itself."""
        self.executor.stop()
        ended = f'{ENDED}: {reason}'
        self._stop_commands(ended)
        self.ended = ended
        self._report_fault(ENDED, f'{reason}; commanding zeros; deactivate and activate '
                           'the node')

    def change(self, rule: Callable[..., PathState], *arguments: Any
               ) -> tuple[PathState, PathState]:
        """
        Change the path by a rule, and publish; return the path before and after.

        No thread runs the loop meanwhile.
        """
        # What the last cycle published is not published again.
        live = self.native.memory
        before = live.path._replace(publish=0.0, request=NO_REQUEST)
        path = rule(before, *arguments)
        live.path = path
        self._memory.array[:] = live.array
        self._last = self._memory.path
        entries = live.entries
        if entries[PUBLISH] > 0.5:
            self._send_of_cycle()
        if entries[REQUEST] > NO_REQUEST and self._guard is not None:
            self._guard.send(entries[REQUEST])
        return before, path

    def change_and_note(self, rule: Callable[[PathState], PathState], now: float) -> None:
        """Change the path as `change`, and say what happened, at a time of the path, ns."""
        last = self._last
        self._drive = None  # the rule may go on from a torque of another process
        _, path = self.change(rule)
        self._last_good = self.time_of(now)
        self._note_drop(last, path, self._last_good)

    def _send_of_cycle(self) -> None:
        """Publish the torques of the loop's memory."""
        self._send(round(self.native.memory.entries[SENT_AT]) + self._epoch)

    def _send(self, stamp: int) -> None:
        """Publish the torques of the cycle of now, with a stamp, ns."""
        tau = self.native.memory.tau
        command, torque = (tau, tau) if self.form.plain else self._command(tau, stamp)
        self.messages.publish(torque, *divmod(max(stamp, 0), NANO), command)

    def _command(self, tau: Array, stamp: int) -> tuple[Array | None, Array]:
        """
        Return the command of torques in its form, and the torque of the drives, (n,).

        The command is None for a position that is unknown.
        """
        form = self.form
        if form.kind == EFFORT:
            return np.asarray(tau / form.scale), tau
        live = self.native.memory
        if not live.known:
            return form.without_state(), tau
        of_commanded = self.messages.of_commanded
        q = of_commanded(live.q)
        u = of_commanded(live.u)
        acting = live.entries[COMMANDING] > 0.5
        desired = stop_speed = None
        if acting and live.entries[STOP_BEGAN] > NEVER:
            motion, elapsed = self.stop_of_now()
            stop_speed = of_commanded(motion.sample(elapsed)[1])
        # In the other modes the law has the whole feedback.
        faulty = live.entries[FAULT] > 0.5
        if acting and not faulty and self.controller.mode is Mode.INVERSE_DYNAMICS:
            state = self.active_motion.desired(min(stamp, self._now()))
            if state is not None:
                desired = of_commanded(state[0]), of_commanded(state[1])
                self._pose = None
            else:
                self._pose = q if self._pose is None else self._pose
                desired = self._pose, np.zeros_like(q)
        else:
            self._pose = None
        # The rate limit counts from the last torque of the drives, with their feedback, over
        # at most two periods of the states before this one.
        last, since, period = self._drive or (tau, stamp, 0.0)
        elapsed = min(max(stamp - since, 0), 2.0 * period) / NANO
        rate = of_commanded(self.controller.rate_limit)
        is_limited = np.isfinite(rate)
        change = np.where(is_limited, np.where(is_limited, rate, 0.0) * elapsed, np.inf)
        limit = of_commanded(self.controller.effort_limit)
        command, torque = form.numbers(tau, Reference(
            q, u, limit, last - change, last + change, desired, stop_speed), acting=acting)
        period = float(live.entries[PERIOD])
        self._drive = (torque, stamp, period) if acting else None
        return command, torque

    @property
    def arbitration(self) -> Arbitration | None:
        """Return the state of torque_guard as the path knows it; None without one."""
        if self._guard is None:
            return None
        return Arbitration(*self._memory.arbitration.tolist())

    @property
    def guard_seen(self) -> float:
        """Return when the thread heard torque_guard last, whether or not it is reported."""
        loop = self.native
        known = cycle_rules.unpacked_path(loop.path, loop.shape).arbitration
        return float(Arbitration(*known).seen)

    @property
    def need_velocity(self) -> bool:
        """Return whether states without velocities are dropped."""
        if self.rules is not None:
            return self.rules.need_velocity
        return self.controller.mode is not Mode.GRAVITY_COMPENSATION

    @property
    def now(self) -> int:
        """Return the node's clock, ns."""
        return self._now()

    @property
    def reaction(self) -> str:
        """Return the command while states are refused, and its end."""
        action = 'commanding zeros'
        if self.states.holds and self.known:
            action = 'stopping by the model and holding'
        return (f'{action} until states are valid again; deactivate and activate the '
                'node to begin from others')

    @property
    def state_age(self) -> float:
        """Return the time since the last valid state, or since the start, s."""
        return (self.now - self._last_good) / NANO

    def _note_guard(self, guard: GuardSide, before: PathState, path: PathState,
                    dropped: bool) -> None:
        """Say what happened between this process and torque_guard."""
        last = Arbitration(*before.arbitration.tolist())
        known = Arbitration(*path.arbitration.tolist())
        if known.returns > last.returns:
            self._drive = None  # the guard's torques came last
            guard.report_return(known.silent / NANO, dropped)
        if known.unanswered > last.unanswered:
            guard.report_silence()

    def use_guard(self, guard: GuardSide) -> None:
        """Ask torque_guard before each command that may follow one of its own."""
        self._guard = guard
        self.executor.ask(guard.requests)

    def hear(self, numbers: Array) -> None:
        """Note a message of torque_guard, and answer the state that waited for it."""
        if self.running:
            self.executor.hear(numbers)
            self._look_at_clock()

    def close(self) -> None:
        """End what runs the loop."""
        self.executor.close()

    # What the loop reports.

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
            raise self.native.error or RuntimeError(
                'torques: refused by the middleware, code '
                f'{self.native.block.refused}; expected publishers that accept them')
        code = self.native.number('ended')
        if code:
            self._end(f'rcl returned {code}')

    def _read_all(self) -> None:
        """Read the reports and the counters of the thread."""
        # Loads first, so that reports are read with the parameters of their cycles.
        self.apply_loads()
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
        # The plan that this makes has the new count of drops, and no motion.
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
            detail = self._law_detail or TOO_LARGE_TORQUE
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
        detail = self._law_detail or (
            'closed loops: the actuators do not determine the motion there; expected '
            'a configuration that is not singular')
        if self.rules is None and not memory.tracking and search_of(self._desired_loops).outcome:
            detail = str(refusal(self._desired_loops))
        dropped = self._clear_motion(detail, path)
        return detail + '; desired motion dropped' * dropped

    @property
    def _law_detail(self) -> str:
        """Return why a law that Python evaluates gave no torque; empty if it did."""
        return '' if self.rules is None else self.rules.detail

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

    def _observe(self, path: PathState, stamp: int, motion: Motion | None, moment: float,
                 external: Array | None) -> None:
        """Call the observers after a command."""
        of_all = self.messages.of_all
        tau = of_all(path.tau)
        clamped = of_all(path.clamped) > 0.5
        rate_limited = of_all(path.rate_limited) > 0.5
        command = Command(tau, clamped, rate_limited,
                          bool(clamped.any() or rate_limited.any()))
        cycle = ObservedCycle(stamp, self._reader, motion, moment, tau, external, command)
        for observer in self._observers:
            if observer in self._failed:
                continue
            try:
                observer.on_cycle(cycle)
            except Exception as error:
                self._failed.add(observer)
                self._observer_failure = (f'observer {type(observer).__name__}: '
                                          f'{type(error).__name__}: {error}')

    def raise_failure(self) -> None:
        """
        Raise, once, what an observer has raised; called outside of a cycle.

        Raises
        ------
        RuntimeError
            An observer has failed. It is not called again until the next start.

        """
        failure, self._observer_failure = self._observer_failure, ''
        if failure:
            raise RuntimeError(failure)

    # The stop in a fault, by the controller.

    def reached_from(self, q: Array, u: Array, elapsed: float) -> Array:
        """Return the state that the acting torque reaches some time after a state, (2 n,)."""
        last_heard = round(self.native.memory.entries[LAST_HEARD]) + self._epoch
        stop = self.controller.stopping_motion(q, u, self.acting(), elapsed,
                                               self.states.stop_time, last_heard / NANO)
        begin, speeds, _ = stop.sample(0.0)
        return np.concatenate([begin, speeds])

    def stop_of_now(self) -> tuple[Motion, float]:
        """Return the motion of the stop, and the time since its begin, s."""
        live = self.native.memory
        q, u, elapsed, duration = begun_stop(live.path, self.native.plan.settings)
        stop = motion_to_rest(q, u, duration, self.controller.followed)
        return stop, max(float(elapsed), 0.0)

    def acting(self) -> Array:
        """Return the torques of all joints that act, (n_q,)."""
        tau = self.native.memory.tau if self._drive is None else self._drive[0]
        return self.messages.of_all(tau)

    def apply_loads(self) -> None:
        """Set gravity and payload as parameters of the kernels, if they have changed."""
        if self._loads is self._applied_loads:
            return
        if self._loads is not None:
            self._loads.apply_to(self.controller)
        self._applied_loads = self._loads
        for observer in self._observers:
            observer.on_loads_changed()

    # What happened, for log, diagnostics and motions: from the path before and after.

    def _drop(self, reason: str, detail: str) -> None:
        """Count a dropped state and warn."""
        self.statistics.dropped[reason] += 1
        self._warn(reason, detail)

    def _drop_message(self, fault: str) -> None:
        """Count a message that says nothing about the arm, and warn."""
        if fault is FOREIGN and not self.timed_out:
            self.statistics.foreign_states += 1
        else:  # without other states, a state of other joints only is a fault
            self._drop(MISSING if fault is FOREIGN else fault, self._reader.detail)

    def _drop_stamp(self, code: int, stamp: int, now: int) -> None:
        """Count a state that is not answered because of its stamp, and explain it."""
        last = round(self._memory.entries[LAST_STAMP]) + self._epoch
        details = {
            cycle_results.NO_CLOCK: 'use_sim_time is true and no time was received',
            cycle_results.STALE: f'{(now - stamp) / NANO:.3f} s old',
            cycle_results.FUTURE: f'{(stamp - now) / NANO:.3f} s ahead of the clock',
            cycle_results.OUT_OF_ORDER: f'{(last - stamp) / NANO:.6f} s before it',
            cycle_results.UNEXPLAINED: f'{(stamp - last) / NANO:.3f} s after the last '
            'accepted state; expected speeds that explain the positions, or another '
            'state there'}
        self._drop(REASONS[code], details[code])

    def _note_fault(self, was_commanding: bool, path: PathState, code: int, now: int
                    ) -> None:
        """Count and explain the begin of a fault that lasts, which drops the motion."""
        reason = REASONS[code]
        self._reason = reason
        dropped = self._clear_motion(f'joint states are refused: {reason}', path)
        self.statistics.faults += 1
        if was_commanding:  # the fault changes commands
            lasted = now - self._epoch - float(path.refused_since)
            self._report_fault('fault', f'{reason} for {lasted / NANO:.3f} s; '
                               f'{self.reaction}' + ', desired motion dropped' * dropped)

    @property
    def speeds_unjudged(self) -> str:
        """Return why speeds cannot be compared with positions; empty where they are."""
        check = self.states
        if not check.compares_speeds:
            return ''  # no law uses them
        period = self.period
        seldom = (f'states each {1e3 * period:.3g} ms; expected less than '
                  f'{1e3 * min(SPEED_WINDOW / COMPARISONS, check.grace / NANO):.3g} ms, '
                  'because speeds are integrated over some states')
        if self.known and period and self._memory.path.states.comparisons <= COMPARISONS:
            return seldom
        unlimited = np.compress(check.bounds[3] == 0.0, self._reader.joints)
        if not len(unlimited):
            return ''
        return (f'no speed limit of {", ".join(unlimited)}; expected one in the URDF or in '
                'limits.velocity')

    def _note_speeds(self) -> None:
        """Report speeds that contradict the positions, once for each joint."""
        wrong = self._memory.wrong
        if wrong.sum() == len(self.false_speeds):
            return
        joints = tuple(name for name, is_wrong in zip(self._reader.joints, wrong.tolist())
                       if is_wrong > 0.5)
        if len(joints) > len(self.false_speeds):
            self._report_fault('velocities', f'{", ".join(joints)}: {FALSE_SPEEDS}')
        self.false_speeds = joints

    @staticmethod
    def _begins_fault(before: PathState, path: PathState) -> bool:
        """Return whether a lasting fault began with a refused state."""
        return bool(path.fault and not before.fault
                    and path.reason >= cycle_results.NOT_FINITE)

    def _note_drop(self, before: PathState, path: PathState, now: int) -> bool:
        """
        Drop the desired motion where the rules did, and say what happened.

        Return whether there was one.
        """
        dropped = False
        if path.drops == before.drops or self._begins_fault(before, path):
            return dropped
        # After a jump of the clock, the same cycle may drop what is scheduled again.
        if path.clock_jumps > before.clock_jumps:
            dropped = self._clear_motion('the clock jumped backward or was replaced', path)
            self._last_good = now
            if self.wrenches is not None:
                self.wrenches.clear()
            self._warn(*CLOCK_JUMPED)
        if path.dropped_by == cycle_rules.BY_GUARD:
            dropped |= self._clear_motion('torque_guard held the arm', path)
            self._pose = self._drive = None  # the arm may have moved since
        elif path.dropped_by == cycle_rules.BY_REFUSAL:  # the report of the fault was lost
            dropped |= self._clear_motion('joint states were refused', path)
        elif path.dropped_by == cycle_rules.BY_STALL:
            silence = (now - self._epoch - float(before.last_heard)) / NANO
            reason = f'none for {silence:.3f} s, while this process did not run'
            dropped |= self._clear_motion(f'joint states: {reason}', path)
            self._warn('no joint state', f'{reason}; going on from the torque that acts'
                       + ', desired motion dropped' * dropped)
        elif path.dropped_by == cycle_rules.BY_TIMEOUT:
            reason = f'none for {(now - self._last_heard) / NANO:.3f} s'
            if path.silences > before.silences:
                reason = self._silence_reason
            dropped |= self._clear_motion(f'joint states: {reason}', path)
            if before.commanding:
                self.statistics.timeouts += 1
                self._warn('no joint state', f'{reason}; commanding zeros until the next '
                           'one' + ', desired motion dropped' * dropped)
        return dropped  # by loops: with the reason of the state

    def interrupt(self, stamp: int, reason: str) -> bool:
        """
        End the desired motion in a stop from a time on, ns; return whether there was one.

        Called in the thread that reads states.
        """
        stamp = max(stamp, self.now)  # reports of states may be late
        motion, moment = self.active_motion.at(stamp)
        if motion is None:  # one that is to begin later must not
            return self.active_motion.clear(reason)
        # In one change: a thread that answers states never finds neither of the motions.
        stop = self.controller.interrupted(motion, moment, self.states.stop_time)
        self.active_motion.replace(stop, stamp, reason)
        return True
