"""
The torque path: one joint state in, one command out, and zeros whenever that must stop.

It runs in the main thread alone. Messages come and go as bytes: those that leave are laid out
once, and each cycle writes numbers and stamp into them.
"""

from collections.abc import Callable
import time

from kane_dynamics.control.controller import Controller, Mode
from kane_dynamics.errors import InputError
from kane_dynamics.motion.motion import State
from kane_dynamics.ros.common.conversion import Array, NANO
from kane_dynamics.ros.common.node_statistics import Statistics
from kane_dynamics.ros.torque_path.active_motion import ActiveMotion
from kane_dynamics.ros.torque_path.cdr import joint_efforts, numbers
from kane_dynamics.ros.torque_path.cycle_observer import Cycle, CycleObserver
from kane_dynamics.ros.torque_path.gravity_payload import GravityAndPayload
from kane_dynamics.ros.torque_path.joint_state_reader import (JointStateReader, MISSING, NO_CLOCK,
                                                              OTHERS, time_fault)
from kane_dynamics.ros.torque_path.wrench_input import WrenchInput
from rclpy.publisher import Publisher

BEYOND = 'no finite torque'


class TorquePath:
    """
    Answers joint states with torques while it is running.

    Parameters
    ----------
    controller : Controller
    commands, torques : Publisher
        Of Float64MultiArray and of JointState; they are given serialised messages.
    now : callable
        Returns the node's clock, ns.
    timeout : float
        Age from which on a state is stale, s.
    statistics : Statistics
    warn : callable
        Takes the reason and the details of every state that was dropped.

    """

    def __init__(self, controller: Controller, commands: Publisher, torques: Publisher,
                 now: Callable[[], int], timeout: float, statistics: Statistics,
                 warn: Callable[[str, str], None]) -> None:
        joints = controller.robot.joint_names
        self.controller, self.statistics = controller, statistics
        self.running = False
        self.commanding = False  # whether torques other than our own zeros may be acting
        self.timed_out = False
        self.answered = 0.0  # when the last state was, s of `time.perf_counter`; 0: none yet
        self.course = ActiveMotion()
        self._commands, self._torques, self._now, self._warn = commands, torques, now, warn
        self._reader = JointStateReader(joints)
        self._command_message, self._torque_message = numbers(len(joints)), joint_efforts(joints)
        self.wrenches: WrenchInput | None = None
        self._watches: list[CycleObserver] = []
        self._loads: GravityAndPayload | None = None
        self._loads_in_force: GravityAndPayload | None = None
        self._heard = self._last_now = self._last_stamp = 0
        self.set_timeout(timeout)

    def set_timeout(self, timeout: float) -> None:
        """Change the age, s, from which on a state is stale."""
        self._timeout = round(timeout * NANO)

    def add_watch(self, watch: CycleObserver, need_effort: bool) -> None:
        """Let `watch` look on, at the efforts of the states too if it needs them."""
        self._watches.append(watch)
        self._reader.need_effort |= need_effort

    def desired(self, stamp: int) -> State | None:
        """Return q, u and udot from which a new motion may set out; None before any state."""
        state = self.course.desired(stamp)
        if state is None and self.answered:
            pose = self.controller.pose
            q = (self._reader.q if pose is None else pose).copy()
            state = q, 0.0 * q, 0.0 * q
        return state

    def take_others(self) -> set[tuple[str, ...]]:
        """Return the names of states of other joints alone that came since this was asked."""
        others, self._reader.others = self._reader.others, set()
        return others

    def set_loads(self, loads: GravityAndPayload) -> None:
        """Compute with `loads` from the next state on; safe from any thread."""
        self._loads = loads

    def start(self) -> None:
        """Answer states from now on; nothing is commanded before the first."""
        self.course.forget()
        self.timed_out, self.answered = False, 0.0
        self._last_now = self._heard = self._now()
        self._last_stamp = 0
        self.controller.stop()
        if self.wrenches is not None:
            self.wrenches.forget()
        for watch in self._watches:
            watch.start()
        self.running = True

    def stop(self) -> None:
        """Command zeros and answer no more states."""
        self.running = False
        self.course.forget()
        self.zero()
        for watch in self._watches:
            watch.stop()

    def zero(self) -> None:
        """Command zeros now, past every limit."""
        self.commanding = False
        self._torque_message.stamp(*divmod(max(self._now(), 0), NANO))
        self._publish(self.controller.stop().tau)

    def watch(self) -> None:
        """Command zeros, once, if no good state has come for too long."""
        now = self._clock()
        if self.running and now - self._heard > self._timeout and not self.timed_out:
            self.lose(f'none for {(now - self._heard) / NANO:.3f} s')

    def lose(self, why: str) -> None:
        """Command zeros until a good state comes, and follow no motion that is on its way."""
        self.timed_out = True
        forgotten = self.course.forget()
        if self.commanding:
            self.zero()
            self.statistics.timeouts += 1
            self._warn('no joint state', f'{why}: zeros are commanded until one comes'
                       + ', and the desired motion is forgotten' * forgotten)

    @property
    def now(self) -> int:
        """Return the node's clock, ns."""
        return self._now()

    @property
    def silence(self) -> float:
        """Seconds since the last good state, or since the start."""
        return (self._now() - self._heard) / NANO

    def on_state(self, data: bytes) -> None:
        """Answer one serialised JointState with torques for the moment of its stamp."""
        if not self.running:
            return
        began = time.perf_counter()
        now = self._clock()
        controller, reader = self.controller, self._reader
        fault = reader.read(data, controller.mode is not Mode.GRAVITY_COMPENSATION)
        stamp = reader.stamp or now
        if fault is not None:
            if fault is OTHERS and not self.timed_out:
                self.statistics.others += 1
            else:  # where no others come, names that are all strange are wrong
                self._drop(MISSING if fault is OTHERS else fault, reader.detail)
            return
        if not now:  # nothing would ever grow old
            self._drop(NO_CLOCK, 'use_sim_time is set, and no time has come yet')
            return
        late = time_fault(stamp, now, self._last_stamp, self._timeout)
        if late is not None:
            self._drop(*late)
            return
        # Between two cycles, so that all of one command is computed with the same loads.
        if self._loads is not self._loads_in_force:
            self._take_loads()
        motion, moment = self.course.at(stamp)
        try:
            external = None if self.wrenches is None else self.wrenches.torques(reader.q, now)
            command = controller.command_checked(stamp / NANO, reader.q, reader.u, motion, moment,
                                                 external)
        except InputError as error:  # the state is finite, but its torques are not
            self._drop(BEYOND, str(error))
            return
        self._heard, self._last_stamp = min(now, stamp), stamp
        self.timed_out, self.commanding, self.answered = False, True, began
        self._torque_message.stamp(reader.sec, reader.nanosec)
        self._publish(command.tau)
        self.statistics.command(time.perf_counter() - began, (now - stamp) / NANO,
                                command.limited)
        self.statistics.normal_road = reader.normal
        for watch in self._watches:  # last, so that no command waits for them
            watch.take(Cycle(stamp, reader, motion, moment, command.tau, external))

    def _take_loads(self) -> None:
        """Put gravity and payload into the kernels' parameters."""
        loads = self._loads
        if loads is not None:
            loads.apply(self.controller.robot)
            if self.controller.bending is not None:
                loads.apply(self.controller.bending.robot)
        self._loads_in_force = loads
        for watch in self._watches:
            watch.refresh()

    def _publish(self, tau: Array) -> None:
        """Send both messages, first the one that a controller waits for."""
        self._command_message.numbers[:] = tau
        self._commands.publish(self._command_message.serialized())
        self._torque_message.numbers[:] = tau
        self._torques.publish(self._torque_message.serialized())

    def _clock(self) -> int:
        """Return the node's time, ns; a jump backwards forgets the motion and all stamps."""
        now = self._now()
        if now < self._last_now:
            self.clock_jumped()
        self._last_now = now
        return now

    def clock_jumped(self) -> None:
        """Forget motions, wrenches and all stamps: they are of a time that is no more."""
        self.course.forget()
        self._heard = self._last_now = self._now()
        self._last_stamp = 0
        self.controller.stop()
        if self.wrenches is not None:
            self.wrenches.forget()
        self._warn('clock', 'it jumped backwards, or is another one now: the desired motion is '
                   'forgotten')

    def _drop(self, reason: str, detail: str) -> None:
        self.statistics.dropped[reason] += 1
        self._warn(reason, detail)
