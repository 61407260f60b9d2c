"""
The torque path: publishes one command for each joint state, and zeros when states stop.

It runs in the main thread only and works on serialized messages.
"""

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
import time
from typing import Any

from kane_dynamics._util.typing import Scalar
from kane_dynamics.control.controller import Controller, Mode
from kane_dynamics.control.stopping import motion_to_rest
from kane_dynamics.control.torque_limiter import Command
from kane_dynamics.control_cycle import cycle_results, cycle_rules
from kane_dynamics.control_cycle.arbitration import (Arbitration, before_zeros,
                                                     UNANSWERED, UNGUARDED)
from kane_dynamics.control_cycle.cycle_results import NEVER
from kane_dynamics.control_cycle.cycle_rules import (begun_stop, CycleSettings, Event,
                                                     initial_path, NO_REQUEST, PathShape,
                                                     PathState)
from kane_dynamics.control_cycle.state_judgement import (COMPARISONS, SPEED_WINDOW,
                                                         UNLIMITED)
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.motion.motion import Motion, State
from kane_dynamics.ros.common.cdr import STAMP, STAMP_AT
from kane_dynamics.ros.common.conversion import Array, NANO
from kane_dynamics.ros.common.node_statistics import Statistics
from kane_dynamics.ros.common.stamped_numbers import NOT_FINITE
from kane_dynamics.ros.loads.gravity_payload import GravityAndPayload
from kane_dynamics.ros.loads.wrench_input import WrenchInput
from kane_dynamics.ros.parameters.command_form import (CommandForm, EFFORT,
                                                       POSITION, Reference)
from kane_dynamics.ros.torque_path.active_motion import ActiveMotion
from kane_dynamics.ros.torque_path.closed_loop_reader import (ClosedLoopReader,
                                                              commanded_joints)
from kane_dynamics.ros.torque_path.command_messages import CommandMessages
from kane_dynamics.ros.torque_path.cycle_observer import (Cycle, CycleObserver,
                                                          GuardSide)
from kane_dynamics.ros.torque_path.drop_reasons import (FALSE_SPEEDS, FOREIGN, MISSING,
                                                        REASONS)
from kane_dynamics.ros.torque_path.joint_state_reader import JointStateReader
from kane_dynamics.ros.torque_path.path_memory import (COMMANDED_AT, COMMANDING,
                                                       CycleRules, DROPS, FAULT,
                                                       LAST_HEARD, LAST_STAMP, LAW_KNOWN,
                                                       PathMemory, PERIOD, PUBLISH,
                                                       REASON,
                                                       REFUSING, REQUEST, SENT_AT,
                                                       STOP_BEGAN, STOPS, TIMED_OUT)
from kane_dynamics.ros.torque_path.state_check import StateCheck
import numpy as np
from rclpy.publisher import Publisher

IDLE = 11  # states before the start, whose median distance is their period
# Changes in `CycleSettings`, on which a rule acts where their number has grown
COUNTS = ('restarts', 'blends', 'jumps', 'silences')
# A reason with its details
CLOCK_JUMPED = 'clock', 'jumped backward or replaced; desired motion dropped'
TOO_LARGE_TORQUE = ('torques: not finite; expected a state, a motion and gains in a '
                    'physical range')


class TorquePath:
    """
    Computes a command for each joint state while it is running.

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
        Publisher of JointCommand, for commands with the stamp of their state.
    loops : ClosedLoopReader, optional
        Reads the states of an arm with closed loops.
    report_fault : callable, optional
        Called like `warn` where states are refused for longer than the grace time.

    Attributes
    ----------
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
                 report_fault: Callable[[str, str], None] | None = None) -> None:
        robot = controller.robot
        self.controller = controller
        self.statistics = statistics
        self.running = False
        self.active_motion = ActiveMotion()
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
        # Torque of the drives with the last command, feedback included, and its stamp, ns;
        # None where the rate limit counts from the torque of the path.
        self._drive: tuple[Array, int] | None = None
        self.messages = CommandMessages(robot.joint_names, commanded, commands, torques,
                                        stamped, self.form.count, self.form.interface)
        self._follow = list(map(robot.joint_names.index, controller.followed))
        self.wrenches: WrenchInput | None = None
        self._guard: GuardSide | None = None
        self._begun = UNGUARDED  # what the guard was at the start
        self._asks = False  # whether another process may command meanwhile
        self._waiting = b''  # the last state, if it waits for torque_guard
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
        # When the last stop by the controller began, and its motion.
        self._stop: tuple[float, Motion | None] = NEVER, None
        self._make_memory()
        self._mode = controller.mode
        self._law_numbers = self._numbers()
        self.set_limits(values)

    def _make_memory(self) -> None:
        """Make the memory, and what computes in it."""
        robot = self.controller.robot
        reader = self._reader
        shape = PathShape(len(reader.joints), len(self.messages.joints), robot.n_q)
        self._memory = PathMemory(shape)
        self._rules = CycleRules(robot, self._memory, reader.joints, reader.state)

    def set_limits(self, values: Mapping[str, Any]) -> None:
        """Judge states by checked parameters from the next one on."""
        self.states.update(values)
        self._replan()

    def _replan(self) -> None:
        """Use the settings of now from the next cycle on."""
        self._rules.use(self._settings())

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
        # This path evaluates motions, wrenches, closed loops and the law by itself.
        nothing = np.zeros(0)
        return CycleSettings(
            timeout=float(check.timeout), grace=float(check.grace),
            holds=float(check.holds), stop_time=check.stop_time * NANO,
            compares=float(check.compares),
            compares_speeds=float(check.compares_speeds), blend_time=controller.blend_time * NANO,
            **self._counts, drops=0.0, wrench_timeout=0.0,
            bounds=check.bounds.ravel(), turned=check.turned.copy(),
            effort=np.minimum(effort, UNLIMITED), slope=np.where(is_limited, rate, 0.0),
            free=np.where(is_limited, 0.0, UNLIMITED), wrenches=nothing,
            loop_limits=nothing, law=nothing)

    def _numbers(self) -> Array:
        """Return the settings of the law of the mode."""
        return np.concatenate([self.controller.kp, self.controller.kd])

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
        self._memory.array[COMMANDING] = commanding

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

    @property
    def _refusing(self) -> bool:
        """Return whether the last state in time was refused."""
        return self._memory.entries[REFUSING] > 0.5

    @property
    def _last_heard(self) -> int:
        """Return the time of the last state in time, ns."""
        return round(self._memory.entries[LAST_HEARD]) + self._epoch

    @contextmanager
    def one_change(self) -> Iterator[None]:
        """Make the changes in a `with` block effective together: the thread waits."""
        yield

    def add_observer(self, observer: CycleObserver, need_effort: bool) -> None:
        """
        Call `observer` after each command; callable from any thread.

        Read the efforts of states if it needs them.
        """
        # A new list, because a cycle may go through the present one.
        self._observers = [*self._observers, observer]
        self._reader.need_effort |= need_effort

    def remove_observer(self, observer: CycleObserver) -> None:
        """Stop calling `observer`; callable from the thread that added it."""
        self._observers = [other for other in self._observers if other is not observer]

    def catch_up(self) -> None:
        """Do nothing: what this path knows is of now."""

    def desired(self, stamp: int) -> State | None:
        """
        Return the initial q, u and udot of a new motion.

        The result is None before the first accepted state.
        """
        state = self.active_motion.desired(stamp)
        if state is None and self.last_update and self.known:
            pose = self._held_pose
            q = self._accepted()[self._follow] if pose is None else pose.copy()
            state = q, 0.0 * q, 0.0 * q
        return state

    @property
    def _held_pose(self) -> Array | None:
        """Return the positions of the joints that follow which are held, (n,), or None."""
        begins = self._memory.entries[LAW_KNOWN] < 0.5
        return None if begins else self.controller.pose

    def measured(self) -> Array | None:
        """
        Return the last accepted positions, (n,), for other threads.

        The result is None without a valid state, as before the first one.
        """
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
        if self.loops is not None:
            return self.loops.q.copy()
        return self._memory.accepted[:len(self._reader.joints)].copy()

    def _accepted_speeds(self) -> Array:
        """Return a copy of the speeds of the last accepted state, (n,)."""
        if self.loops is not None:
            return self.loops.u.copy()
        return self._memory.accepted[len(self._reader.joints):].copy()

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

    def law_changed(self) -> None:
        """Do nothing: the law reads what it was asked for in each cycle."""

    def set_loads(self, loads: GravityAndPayload) -> None:
        """Use gravity and payload from the next state on; callable from any thread."""
        self._loads = loads

    def start(self) -> None:
        """Start; the first command follows the first state."""
        self.active_motion.clear('the node was activated')
        # Everything that refers to an earlier activation is forgotten.
        self.ended = ''
        self.failure = ''
        self._epoch = self._last_good = self._now()
        self._counts = dict.fromkeys(COUNTS, 0.0)
        self._memory.path = self._initial()
        self._stop = NEVER, None
        self._waiting = b''
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
        self._replan()
        self.running = True

    def _initial(self) -> PathState:
        """Return the state of the path at its start."""
        if self._guard is not None:
            self._begun = self._guard.beginning()
        return initial_path(self._memory.shape, 0.0, self._begun)

    @property
    def refused(self) -> bool:
        """Return whether the middleware refused a message that no callback publishes."""
        return False

    def stop(self, reason: str = 'the node was deactivated') -> None:
        """Command zeros and ignore further states, for a reason."""
        self.running = False
        self.ended = ''
        self.active_motion.clear(reason)
        self.command_zeros()
        for observer in self._observers:
            observer.stop()

    def command_zeros(self) -> None:
        """Command zeros immediately, without the rate limit."""
        self.controller.stop()
        self._change(cycle_rules.with_zeros, float(self._now() - self._epoch))

    def check_timeout(self) -> None:
        """Command zeros, once, if the last state in time has timed out."""
        self._look_at_clock()

    def _look_at_clock(self) -> None:
        """Apply what is due without a state: a jump, a timeout, and what was asked for."""
        if not self.running:
            return
        now = self._now()
        before, path = self._change(cycle_rules.elapse, self._event(now),
                                    self._rules.settings, self._decide_zeros)
        self._note_drop(before, path, now)
        if self._guard is not None:
            self._note_guard(self._guard, before, path, dropped=False)

    def _decide_zeros(self, known: Arbitration, steady: Scalar) -> Arbitration:
        """Decide whether this process may command zeros."""
        return before_zeros(known, steady)

    def time_out(self, reason: str) -> None:
        """Command zeros until the next valid state, and drop the desired motion."""
        self._silence_reason = reason
        self._counts['silences'] += 1.0
        self._replan()
        self._look_at_clock()

    def on_clock_jump(self) -> None:
        """Drop motions, wrenches and stamps, which refer to the time before the jump."""
        self.controller.stop()
        self._counts['jumps'] += 1.0
        self._replan()
        self._look_at_clock()

    def _change(self, rule: Callable[..., PathState], *arguments: Any
                ) -> tuple[PathState, PathState]:
        """Change the path by a rule, and publish; return the path before and after."""
        # What the last cycle published is not published again.
        before = self._memory.path._replace(publish=0.0, request=NO_REQUEST)
        path = rule(before, *arguments)
        self._memory.path = path
        if before.law_known > path.law_known:
            self.controller.stop()
        self._publish()
        return before, path

    def _publish(self) -> None:
        """Publish what a rule has commanded, if anything."""
        entries = self._memory.entries
        if entries[PUBLISH] > 0.5:
            self._send(round(entries[SENT_AT]) + self._epoch)
        if entries[REQUEST] > NO_REQUEST and self._guard is not None:
            self._guard.send(entries[REQUEST])

    def _send(self, stamp: int) -> None:
        """Publish the torques of the path, with a stamp, ns."""
        tau = self._memory.tau
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
        if not self.known:
            return None if form.kind == POSITION else np.zeros(form.count), tau
        of_commanded = self.messages.of_commanded
        q = of_commanded(self._accepted())
        u = of_commanded(self._accepted_speeds())
        acting = self.commanding
        desired = stop_speed = None
        if acting and self._memory.entries[STOP_BEGAN] > NEVER:
            motion, elapsed = self._stop_of_now()
            stop_speed = of_commanded(motion.sample(elapsed)[1])
        # In the other modes the law has the whole feedback.
        if acting and not self.fault and self.controller.mode is Mode.INVERSE_DYNAMICS:
            state = self.active_motion.desired(min(stamp, self._now()))
            if state is not None:
                desired = of_commanded(state[0]), of_commanded(state[1])
                self._pose = None
            else:
                self._pose = q if self._pose is None else self._pose
                desired = self._pose, np.zeros_like(q)
        else:
            self._pose = None
        # The rate limit counts from the last torque of the drives, with their feedback.
        last, since = self._drive or (tau, stamp)
        elapsed = min(max(stamp - since, 0) / NANO, 2.0 * self.period)
        rate = of_commanded(self.controller.rate_limit)
        is_limited = np.isfinite(rate)
        change = np.where(is_limited, np.where(is_limited, rate, 0.0) * elapsed, np.inf)
        limit = of_commanded(self.controller.effort_limit)
        command, torque = form.numbers(tau, Reference(
            q, u, limit, last - change, last + change, desired, stop_speed), acting=acting)
        self._drive = (torque, stamp) if acting else None
        return command, torque

    @property
    def arbitration(self) -> Arbitration | None:
        """Return the state of torque_guard as the path knows it; None without one."""
        if self._guard is None:
            return None
        return Arbitration(*self._memory.arbitration.tolist())

    @property
    def guard_seen(self) -> float:
        """Return when a thread of the path heard torque_guard last, steady ns; 0: never."""
        return 0.0

    @property
    def need_velocity(self) -> bool:
        """Return whether states without velocities are dropped."""
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

    def on_state(self, data: bytes) -> None:
        """Compute and publish the command for one serialized JointState."""
        if not self.running:
            self._idle.append(data)
            return
        # 1. Read and judge the state.
        began = time.perf_counter()
        now = self._now()
        reader = self._reader
        # Faults of the message: it says nothing about the arm, not even that it is
        # heard.
        fault = reader.read(data, self.need_velocity)
        if fault is not None and fault is not NOT_FINITE:
            self._drop_message(fault)
            return
        stamp = reader.stamp or now
        if not self._accept(fault, stamp, now, began):
            return
        rules = self._rules
        if self._asks and not self._permitted(cycle_results.ACCEPTED):
            self._wait(data, stamp, now)
            return
        # 2. Compute the command. New loads are applied between two cycles, so that each
        # command is computed with consistent ones.
        if self._loads is not self._applied_loads:
            self._apply_loads()
        # What comes next never runs ahead of the clock, whatever the message says.
        at = min(stamp, now)
        motion, moment = self.active_motion.at(at)
        try:
            external = None if self.wrenches is None else self.wrenches.torques(reader.q,
                                                                                now)
            torque = self._torque(at, motion, moment, external)
        except InputError as error:  # the torques of a finite state overflowed
            self._refuse(cycle_results.NO_TORQUE, str(error), now)
            return
        except ConstraintError as error:
            dropped = self.active_motion.clear(str(error))
            self._refuse(cycle_results.REFUSED,
                         str(error) + '; desired motion dropped' * dropped, now)
            return
        try:
            rules.answer(self.messages.of_commanded(torque))
        except InputError:
            self._refuse(cycle_results.NO_TORQUE, TOO_LARGE_TORQUE, now)
            return
        # 3. Publish it, unless the guard may have taken over meanwhile.
        if self._asks and not self._confirmed(began):
            self._wait(data, stamp, now)
            return
        rules.keep()
        self._waiting = b''
        self._send(stamp)
        self._last_good = at
        clamped, rate_limited = self._memory.limited
        is_limited = any(clamped.tolist()) or any(rate_limited.tolist())
        self.statistics.command(time.perf_counter() - began, (now - stamp) / NANO,
                                is_limited)
        self.statistics.full_parses = reader.full_parses
        # After the command, which must not wait for them
        self._note_speeds()
        if self._observers:
            self._observe(self._memory.path, at, motion, moment, external)

    def _observe(self, path: PathState, stamp: int, motion: Motion | None, moment: float,
                 external: Array | None) -> None:
        """Call the observers after a command."""
        of_all = self.messages.of_all
        tau = of_all(path.tau)
        clamped = of_all(path.clamped) > 0.5
        rate_limited = of_all(path.rate_limited) > 0.5
        command = Command(tau, clamped, rate_limited,
                          bool(clamped.any() or rate_limited.any()))
        cycle = Cycle(stamp, self._reader, motion, moment, tau, external, command)
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

    def _torque(self, stamp: int, motion: Motion | None, moment: float,
                external: Array | None) -> Array:
        """Return the torques of the law at the latest state, (n_q,)."""
        return self.controller.torque(self._reader.q, self._reader.u, motion, moment,
                                      external, stamp / NANO)

    def _wait(self, data: bytes, stamp: int, now: int) -> None:
        """Keep the message of a state that waits for torque_guard."""
        self._last_good = min(stamp, now)
        self._waiting = data

    # Who commands, this process or torque_guard.

    def use_guard(self, guard: GuardSide) -> None:
        """Ask torque_guard before each command that may follow one of its own."""
        self._guard = guard
        self._asks = True
        self._permit, = self._rules.bound({'PERMIT': cycle_rules.permit})

    def _permitted(self, code: int) -> bool:
        """Decide whether to command at a state with this result; False: the state waits."""
        assert self._guard is not None
        memory = self._memory
        memory.array[REASON] = code
        if code == cycle_results.NOT_FINITE:
            self._reader.state.fill(0.0)  # kernels accept finite numbers only
        unanswered = memory.arbitration[UNANSWERED]
        self._permit()
        self._rules.keep()
        if memory.arbitration[UNANSWERED] > unanswered:
            self._guard.report_silence()
        waits = memory.entries[REASON] == cycle_results.WAITING
        if waits:
            self._publish()
        return not waits

    def _confirmed(self, began: float) -> bool:
        """Return whether the computation was not interrupted; else the state waits."""
        steady = time.perf_counter()
        if (steady - began) * NANO < self._begun.shortest:
            return True
        event = self._rules.event._replace(steady=steady * NANO)
        _, path = self._change(cycle_rules.confirm, event, self._reader.state)
        return bool(path.reason != cycle_results.WAITING)

    def hear(self, numbers: Array) -> None:
        """Note a message of torque_guard, and answer the state that waited for it."""
        if self._guard is None or not self.running:
            return
        now = self._now()
        before, path = self._change(cycle_rules.hear, self._event(now), numbers,
                                    self._rules.settings)
        dropped = self._note_drop(before, path, now)
        self._note_guard(self._guard, before, path, dropped)
        waiting = self._waiting
        if path.retries and waiting:
            self._waiting = b''
            self.on_state(waiting)
        self._look_at_clock()

    @staticmethod
    def _note_guard(guard: GuardSide, before: PathState, path: PathState, dropped: bool
                    ) -> None:
        """Say what happened between this process and torque_guard."""
        last = Arbitration(*before.arbitration.tolist())
        known = Arbitration(*path.arbitration.tolist())
        if known.returns > last.returns:
            guard.report_return(known.silent / NANO, dropped)
        if known.unanswered > last.unanswered:
            guard.report_silence()

    def _accept(self, fault: str | None, stamp: int, now: int, began: float) -> bool:
        """Judge the state that was read; return whether it is to be answered."""
        rules = self._rules
        rules.begin(now - self._epoch, stamp - self._epoch, bool(now), began)
        code = rules.judge(fault is None)
        # A backward jump of the clock drops the motion, before the state is answered.
        if rules.next.entries[DROPS] != self._memory.entries[DROPS]:
            self.controller.stop()
            self._note_drop(self._memory.path, rules.next.path, now)
        if code < cycle_results.NOT_FINITE:
            rules.keep()
            self._reader._u[:] = self._memory.trusted
            if code > cycle_results.FIRST:
                self._drop_stamp(code, stamp, now)
            return code == cycle_results.ACCEPTED and self._complete(stamp, now)
        # Faults of the numbers: the arm is heard, and the last command goes on for a
        # time.
        detail = self._reader.detail
        if fault is None:
            detail = self.states.explain(code, self._memory.states, rules.next.states)
        rules.keep()
        if self._asks:
            self._permitted(code)
        self._refuse(code, detail, now)
        return False

    def _complete(self, stamp: int, now: int) -> bool:
        """Close the loops of an accepted state; return whether that is possible."""
        # After the check, so that a false state does not move them.
        fault = self._reader.complete(min(stamp, now))
        if fault is None:
            return True
        if self._asks:
            self._permitted(fault)
        self._refuse(fault, self._reader.detail, now)
        return False

    def _refuse(self, code: int, detail: str, now: int) -> None:
        """Refuse a state: command what `cycle_rules.refuse` says."""
        rules = self._rules
        was_commanding = self.commanding
        rules.refuse(code)
        begins = rules.next.entries[FAULT] > self._memory.entries[FAULT]
        if begins and self.states.holds and self.known:
            # The model says where the arm is by now, which the rules do not evaluate.
            begin = self._begin_of_stop()
            if np.isfinite(begin).all():
                rules.refuse(code, begin)
        if begins:
            self._give_up()
        rules.keep()
        if self._memory.entries[STOPS] > 0.5:
            self._command_stop()
        self._publish()
        self._drop(REASONS[code], detail)
        if begins:
            self._note_fault(was_commanding, self._memory.path, code, now)

    def _give_up(self) -> None:
        """Restart the law; closed loops may have passed a singular configuration."""
        # Before a jump of the clock, another stop may have begun at the same time.
        self._stop = NEVER, None
        if self.commanding:
            self.controller.stop()
        if self.loops is not None:
            self.loops.give_up()

    # The stop in a fault, by the controller.

    def _begin_of_stop(self) -> Array:
        """Return where the arm is and how fast, (2 n,); nan if it is unknown."""
        last = self._memory.states
        elapsed = (self._memory.entries[LAST_HEARD] - float(last.stamp)) / NANO
        return self._reached_from(self._accepted(), self._accepted_speeds(), elapsed)

    def _reached_from(self, q: Array, u: Array, elapsed: float) -> Array:
        """Return the state that the acting torque reaches some time after a state, (2 n,)."""
        try:
            stop = self.controller.stopping_motion(q, u, self._acting(), elapsed,
                                                   self.states.stop_time,
                                                   self._last_heard / NANO)
        except (InputError, ConstraintError):  # no finite state, or singular loops
            return np.full(2 * len(self._follow), np.nan)
        begin, speeds, _ = stop.sample(0.0)
        return np.concatenate([begin, speeds])

    def _command_stop(self) -> None:
        """Command the torque that brings the arm to rest, or else the last torque."""
        try:
            self._rules.stop(self.messages.of_commanded(self._stop_torque()))
        except (InputError, ConstraintError):  # not finite, or the loops are singular there
            return
        self._rules.keep()

    def _stop_torque(self) -> Array:
        """Return the torques of all joints that bring the arm to rest, (n_q,)."""
        stop, elapsed = self._stop_of_now()
        return self.controller.motion_torque(self._accepted(), stop, elapsed,
                                             self._last_heard / NANO)

    def _stop_of_now(self) -> tuple[Motion, float]:
        """Return the motion of the stop, and the time since its begin, s."""
        entries = self._memory.entries
        began, stop = self._stop
        if stop is None or began != entries[STOP_BEGAN] or began <= NEVER:
            began = entries[STOP_BEGAN]
            q, u, _, duration = begun_stop(self._memory.path, self._rules.settings)
            stop = motion_to_rest(q, u, duration, self.controller.followed)
            self._stop = began, stop
        return stop, max((entries[LAST_HEARD] - began) / NANO, 0.0)

    def _acting(self) -> Array:
        """Return the torques of all joints that act, (n_q,)."""
        tau = self._memory.tau if self._drive is None else self._drive[0]
        return self.messages.of_all(tau)

    def _event(self, now: int) -> Event:
        """Return the times of a look at the clock."""
        time_of_path = float(now - self._epoch)
        return Event(time_of_path, time_of_path, 0.0, 0.0, float(bool(now)),
                     time.perf_counter() * NANO)

    def _apply_loads(self) -> None:
        """Set gravity and payload as parameters of the kernels."""
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

    def _clear_motion(self, reason: str, path: PathState) -> bool:
        """Drop the desired motion, as the rules did; return whether there was one."""
        return self.active_motion.clear(reason)

    def interrupt(self, stamp: int, reason: str) -> bool:
        """
        End the desired motion in a stop from a time on, ns; return whether there was one.

        Called in the thread that reads states.
        """
        motion, moment = self.active_motion.at(stamp)
        if motion is None:  # one that is to begin later must not
            return self.active_motion.clear(reason)
        # In one change: a thread that answers states never finds neither of the motions.
        stop = self.controller.interrupted(motion, moment, self.states.stop_time)
        self.active_motion.replace(stop, stamp, reason)
        return True
