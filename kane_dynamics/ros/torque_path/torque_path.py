"""
The torque path: publishes one command for each joint state, and zeros when states stop.

It runs in the main thread only and works on serialized messages.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
import time
from typing import Any

from kane_dynamics.control.controller import Controller, Mode
from kane_dynamics.control.torque_limiter import Command
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.loop_tracking.loop_error import BRANCH, CONTRADICTION
from kane_dynamics.motion.motion import Motion, State
from kane_dynamics.ros.common.conversion import Array, NANO
from kane_dynamics.ros.common.node_statistics import Statistics
from kane_dynamics.ros.torque_path.active_motion import ActiveMotion
from kane_dynamics.ros.torque_path.arbitration import Arbitration
from kane_dynamics.ros.torque_path.closed_loop_reader import (ClosedLoopReader,
                                                              commanded_joints)
from kane_dynamics.ros.torque_path.command_messages import CommandMessages
from kane_dynamics.ros.torque_path.cycle_observer import Arbiter, Cycle, CycleObserver
from kane_dynamics.ros.torque_path.gravity_payload import GravityAndPayload
from kane_dynamics.ros.torque_path.joint_state_reader import (FOREIGN, JointStateReader,
                                                              MISSING, NO_CLOCK,
                                                              NOT_FINITE, time_fault)
from kane_dynamics.ros.torque_path.state_check import (FIRST, JUMP, OUTSIDE, StateCheck,
                                                       TOO_FAST)
from kane_dynamics.ros.torque_path.wrench_input import WrenchInput
from rclpy.publisher import Publisher

NO_TORQUE, REFUSED = 'no finite torque', 'closed loop without a torque'
# Reasons with their details
WITHOUT_CLOCK = NO_CLOCK, 'use_sim_time is true and no time was received'
CLOCK_JUMPED = 'clock', 'jumped backward or replaced; desired motion dropped'
# Reasons that show a false state: after a fault that lasts, states must come back to the
# last accepted one. Other reasons are of the arm or of the motion.
FALSE = frozenset((NOT_FINITE, JUMP, TOO_FAST, OUTSIDE, CONTRADICTION, BRANCH))


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
    fault : str
        Why states are refused, for longer than the grace time; empty if they are not.
    ended : str
        Why the path stopped by itself; empty if it did not, and after `stop`.

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
        self.commanding = False  # whether the last command may be non-zero
        self.timed_out = False
        # Time of the last command, s of `perf_counter`; 0: none yet
        self.last_update = 0.0
        self.active_motion = ActiveMotion()
        self._now = now
        self._warn = warn
        self._report_fault = report_fault or warn
        self._reader = loops or JointStateReader(robot.joint_names)
        self.loops = loops
        self.states = StateCheck(robot, self._reader.joints, self._reader.state, values)
        self._reader.judged = True
        commanded = commanded_joints(robot, controller.followed)
        self.messages = CommandMessages(robot.joint_names, commanded, commands, torques,
                                        stamped)
        self._follow = [robot.joint_names.index(name) for name in controller.followed]
        self.wrenches: WrenchInput | None = None
        self.arbiter: Arbiter | None = None
        self._waiting = b''  # the last state, if the arbiter denied a command
        self._observers: list[CycleObserver] = []
        self._loads: GravityAndPayload | None = None
        self._applied_loads: GravityAndPayload | None = None
        self._last_good = self._last_heard = self._last_now = self._last_stamp = 0
        self._refused_since = 0  # since when states are refused, ns; 0: they are not
        self.fault = ''
        self.ended = ''
        # The motion that brings the arm to rest in a fault, and its begin, ns.
        self._stop: tuple[Motion, int] | None = None
        self.set_limits(values)

    def set_limits(self, values: Mapping[str, Any]) -> None:
        """Judge states by checked parameters from the next one on."""
        self._timeout = round(values['state_timeout'] * NANO)
        self._grace = round(values['state_check.grace'] * NANO)
        self._holds = values['state_check.action'] == 'hold'
        self._stop_time = float(values['state_check.stop_time'])
        self.states.update(values)

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
        """Call `observer` no more; callable from the thread that added it."""
        self._observers = [other for other in self._observers if other is not observer]

    def catch_up(self) -> None:
        """Do nothing: what this path knows is of now."""

    def desired(self, stamp: int) -> State | None:
        """
        Return the initial q, u and udot of a new motion.

        The result is None before the first accepted state.
        """
        state = self.active_motion.desired(stamp)
        if state is None and self.last_update and self.states.known:
            pose = self._held_pose
            q = self._accepted()[self._follow] if pose is None else pose.copy()
            state = q, 0.0 * q, 0.0 * q
        return state

    @property
    def _held_pose(self) -> Array | None:
        """Return the positions of the joints that follow which are held, (n,), or None."""
        return self.controller.pose

    def measured(self) -> Array | None:
        """
        Return the last accepted positions, (n,), for other threads.

        The result is None without a valid state, as before the first one.
        """
        lost = self.loops is not None and self.loops.lost
        valid = self.running and self.last_update and self.states.known and not (
            lost or self.timed_out or self.fault)
        return self._accepted() if valid else None

    def _accepted(self) -> Array:
        """Return a copy of all positions in the last accepted state, (n_q,)."""
        if self.loops is not None:
            return self.loops.q.copy()
        return self.states.accepted[:len(self._reader.joints)].copy()

    def _accepted_speeds(self) -> Array:
        """Return a copy of the speeds of the last accepted state, (n,)."""
        return self.states.speeds if self.loops is None else self.loops.u.copy()

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
        self.timed_out = False
        self.last_update = 0.0
        self._last_now = self._last_good = self._last_heard = self._now()
        self._last_stamp = 0
        self._forget_states()
        self.controller.stop()
        if self.loops is not None:
            self.loops.restart()
        if self.wrenches is not None:
            self.wrenches.clear()
        for observer in self._observers:
            observer.start()
        if self.arbiter is not None:
            self.arbiter.start()
        self.running = True

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
        self.commanding = False
        self._publish(self.controller.stop().tau, *divmod(max(self._now(), 0), NANO))
        if self.arbiter is not None:
            self.arbiter.note_zeros()

    def check_timeout(self) -> None:
        """Command zeros, once, if the last state in time has timed out."""
        now = self._clock()
        late = now - self._last_heard > self._timeout
        if self.running and late and not self.timed_out:
            self.time_out(f'none for {(now - self._last_heard) / NANO:.3f} s')

    def time_out(self, reason: str) -> None:
        """Command zeros until the next valid state, and drop the desired motion."""
        if self.commanding and self.arbiter is not None and not self.arbiter.may_stop(
                time.perf_counter()):
            return  # another process may hold the arm; the next check decides
        self.timed_out = True
        self._forget_states()
        dropped = self.active_motion.clear(f'joint states: {reason}')
        if self.commanding:
            self.command_zeros()
            self._report_timeout(reason, dropped)

    @property
    def arbitration(self) -> Arbitration | None:
        """Return what a thread that follows the rules of the arbiter knows."""
        return None

    @property
    def guard_seen(self) -> float:
        """Return when such a thread heard torque_guard last, steady ns; 0: never."""
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
        """Return what is commanded while states are refused, and until when."""
        action = 'commanding zeros'
        if self._holds:
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
            return
        # 1. Read and judge the state.
        began = time.perf_counter()
        now = self._clock()
        stamp = self._accept(data, now)
        if stamp is None:
            return
        if self.arbiter is not None and not self.arbiter.may_command(began):
            self._keep(stamp, now)
            self._waiting = data
            return
        # 2. Compute the command. New loads are applied between two cycles, so that each
        # command is computed with consistent ones.
        if self._loads is not self._applied_loads:
            self._apply_loads()
        reader = self._reader
        motion, moment = self.active_motion.at(stamp)
        try:
            external = None if self.wrenches is None else self.wrenches.torques(reader.q,
                                                                                now)
            command = self._command(stamp, motion, moment, external)
        except InputError as error:  # the torques of a finite state overflowed
            self._refuse(NO_TORQUE, str(error), now)
            return
        except ConstraintError as error:
            dropped = self.active_motion.clear(str(error))
            self._refuse(REFUSED, str(error) + '; desired motion dropped' * dropped, now)
            return
        # 3. Publish it, unless the guard may have taken over meanwhile.
        self._keep(stamp, now)
        if self.arbiter is not None and not self.arbiter.confirm(time.perf_counter()):
            return
        self.timed_out = False
        self.commanding = True
        self.last_update = began
        self._waiting = b''
        self._publish(command.tau, reader.sec, reader.nanosec)
        self.statistics.command(time.perf_counter() - began, (now - stamp) / NANO,
                                command.limited)
        self.statistics.full_parses = reader.full_parses
        # After the command, which must not wait for them
        for observer in self._observers:
            observer.on_cycle(Cycle(stamp, reader, motion, moment, command.tau,
                                    external, command))

    def retry(self) -> None:
        """Answer the latest state, if the arbiter denied its command."""
        data = self._waiting
        self._waiting = b''
        if data:
            self.on_state(data)

    def _accept(self, data: bytes, now: int) -> int | None:
        """Read a serialized state; return its stamp, ns, or None if it is dropped."""
        reader = self._reader
        # Faults of the message: it says nothing about the arm, not even that it is
        # heard.
        fault = reader.read(data, self.need_velocity)
        stamp = reader.stamp or now
        if fault is not None and fault is not NOT_FINITE:
            self._drop_message(fault)
            return None
        if not now:  # no timeout would ever expire
            self._drop(*WITHOUT_CLOCK)
            return None
        stamp_fault = time_fault(stamp, now, self._last_stamp, self._timeout)
        if stamp_fault is not None:
            self._drop(*stamp_fault)
            return None
        # Faults of the numbers: the arm is heard, and the last command goes on for a
        # time.
        self._last_heard = moment = min(stamp, now)
        if fault is not None:
            self._refuse(fault, reader.detail, now)
            return None
        # Before the loops are closed, so that a false state does not move them.
        fault = self.states.reason(moment)
        if fault is not None:
            if fault is not FIRST:
                self._refuse(fault, self.states.detail, now)
            return None
        fault = reader.complete(moment)
        if fault is not None:
            self._refuse(fault, reader.detail, now)
            return None
        return stamp

    def _keep(self, stamp: int, now: int) -> None:
        """Keep the state as the last accepted one."""
        # A stamp ahead must not delay the next state
        self._last_good = moment = min(stamp, now)
        self._last_stamp = moment
        self.states.accept()
        if self._refused_since:
            self._refused_since = 0
            self.fault = ''
            self._stop = None

    def _command(self, stamp: int, motion: Motion | None, moment: float,
                 external: Array | None) -> Command:
        """Return the command at the latest state."""
        return self.controller.command_checked(stamp / NANO, self._reader.q,
                                               self._reader.u, motion, moment, external)

    def resume(self, tau: Array) -> bool:
        """
        Continue from commands of another process; return whether a motion was dropped.

        As after a pause of the joint states, the desired motion is dropped if the last
        command is older than the timeout. The first change of torque is that of one
        period of the states.
        """
        # As if the states until now had been answered here.
        self._last_good = self._last_heard = self._now()
        self.commanding = True
        self.messages.resume(tau)
        self.controller.resume(self._last_stamp / NANO if self._last_stamp else None,
                               self.messages.of_all(tau))
        # A process that was silent for longer than the timeout missed a part of its
        # motion.
        silent = time.perf_counter() - self.last_update if self.last_update else 0.0
        return silent > self._timeout / NANO and self.active_motion.clear(
            'torque_guard held the arm')

    def _apply_loads(self) -> None:
        """Set gravity and payload as parameters of the kernels."""
        if self._loads is not None:
            self._loads.apply_to(self.controller)
        self._applied_loads = self._loads
        for observer in self._observers:
            observer.on_loads_changed()

    def _publish(self, tau: Array, sec: int, nanosec: int) -> None:
        self.messages.publish(tau, sec, nanosec)

    def _clock(self) -> int:
        """Return the node's time, ns; handle a backward jump."""
        now = self._now()
        if now < self._last_now:
            self.on_clock_jump()
        self._last_now = now
        return now

    def on_clock_jump(self) -> None:
        """Drop motions, wrenches and stamps, which refer to the time before the jump."""
        self.active_motion.clear('the clock jumped backward or was replaced')
        self._last_good = self._last_heard = self._last_now = self._now()
        self._last_stamp = 0
        self._forget_states()
        # The torque that acts stays: from zero the limit of its rate would let the arm
        # fall. The limit counts from the next stamp on.
        acting = self.messages.last if self.commanding else 0.0 * self.messages.last
        self.controller.resume(None, acting)
        if self.wrenches is not None:
            self.wrenches.clear()
        self._warn(*CLOCK_JUMPED)

    def on_clock_replaced(self) -> None:
        """Use another clock, whose stamps have nothing in common with those before."""
        self.on_clock_jump()
        self.time_out('clock replaced')

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

    def _report_timeout(self, reason: str, dropped: bool) -> None:
        """Count a timeout of the states, and warn; a motion may have been dropped."""
        self.statistics.timeouts += 1
        self._warn('no joint state', f'{reason}; commanding zeros until the next one'
                   + ', desired motion dropped' * dropped)

    def _report_lasting_fault(self, lasted: float, commanding: bool, dropped: bool
                              ) -> None:
        """Count a fault that has lasted some time, ns; report it if it changes commands."""
        self.statistics.faults += 1
        if commanding:
            self._report_fault('fault', f'{self.fault} for {lasted / NANO:.3f} s; '
                               f'{self.reaction}' + ', desired motion dropped' * dropped)

    def _forget_states(self) -> None:
        """Compare the next state with none before it."""
        self.states.forget()
        self._refused_since = 0
        self.fault = ''
        self._stop = None

    def _refuse(self, reason: str, detail: str, now: int) -> None:
        """
        Refuse a state; the last command goes on during the grace time.

        After it the torques are zero, or bring the arm to rest, as configured.
        """
        self._refused_since = self._refused_since or now
        self._drop(reason, detail)
        if now - self._refused_since > self._grace and not self.fault:
            self._give_up(reason, now)
        if not self.commanding:
            return
        if self.arbiter is not None and not self.arbiter.may_repeat(time.perf_counter()):
            return
        if not self.fault:
            # The limit of the rate counts from here on: the torque did not change until
            # now.
            self.controller.limit(self._last_heard / NANO, self.messages.last)
            self.messages.repeat()
        elif self._holds:
            self._hold(self._last_heard)
        else:
            self.command_zeros()

    def _give_up(self, reason: str, now: int) -> None:
        """End the desired motion, as states are refused for longer than the grace."""
        self.fault = reason
        dropped = self.active_motion.clear(f'joint states are refused: {reason}')
        if reason in FALSE:
            self.states.freeze()
        if self.commanding and self._holds:
            # The torque continues, but the pose that was held is left: meanwhile the arm
            # can have moved, and the position gain would throw it back.
            self.controller.resume(self._last_heard / NANO, self.messages.last)
        if self._holds and self.states.known:
            self._begin_stop(reason in FALSE)
        if self.loops is not None:
            self.loops.give_up()
        self._report_lasting_fault(now - self._refused_since, self.commanding, dropped)

    def interrupt(self, stamp: int, reason: str) -> bool:
        """
        End the desired motion in a stop from a time on, ns; return whether there was one.

        Called in the thread that reads states.
        """
        motion, moment = self.active_motion.at(stamp)
        if motion is None:  # one that is to begin later must not
            return self.active_motion.clear(reason)
        # In one change: a thread that answers states never finds neither of the motions.
        stop = self.controller.interrupted(motion, moment, self._stop_time)
        self.active_motion.replace(stop, stamp, reason)
        return True

    def _begin_stop(self, false_states: bool) -> None:
        """Plan how the arm comes to rest, from where the model says that it is now."""
        moment = self._last_heard
        try:
            stop = self._stopping_motion(moment)
        except (InputError, ConstraintError):  # no finite state, or singular loops
            stop = self._rest()
        self._stop = stop, moment
        if false_states:  # the next accepted state is near where the arm comes to rest
            self.states.expect(stop.positions[-1])

    def _stopping_motion(self, moment: int) -> Motion:
        """Return the stop from where the last torque has brought the arm by a time, ns."""
        elapsed = (moment - self.states.stamp) / NANO
        return self.controller.stopping_motion(self._accepted(), self._accepted_speeds(),
                                               self._acting(), elapsed, self._stop_time,
                                               moment / NANO)

    def _rest(self) -> Motion:
        """Return the motion that rests at the last accepted state."""
        return Motion.from_points([0.0], [self._accepted()[self._follow]],
                                  joint_names=self.controller.followed)

    def _acting(self) -> Array:
        """Return the torques of all joints that act, (n_q,)."""
        return self.messages.last

    def _hold(self, moment: int) -> None:
        """Command the torque that brings the arm to rest, at a time, ns."""
        if not self.states.known:
            self.messages.repeat()
            return
        if self._stop is None:  # parameter state_check.action has changed since
            self._stop = self._rest(), moment
        stop, began = self._stop
        elapsed = max(moment - began, 0) / NANO
        try:
            tau = self.controller.motion_torque(self._accepted(), stop, elapsed,
                                                moment / NANO)
            command = self.controller.limit(moment / NANO, tau)
        except (InputError, ConstraintError):  # the loops are singular there
            self.messages.repeat()
            return
        self._publish(command.tau, *divmod(moment, NANO))
