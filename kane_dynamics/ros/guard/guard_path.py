"""The torques of the guard: gravity and damping, from the node's last torque."""

from collections.abc import Callable, Mapping
import time
from typing import Any

from kane_dynamics.control.controller import Controller, Mode
from kane_dynamics.control_cycle import cycle_rules
from kane_dynamics.control_cycle.arbitration import LOST, PERMITTED
from kane_dynamics.control_cycle.cycle import (LAST_HEARD, LAST_LOOK, LOOKED_AT, REASON,
                                               REFUSING, STOP_BEGAN)
from kane_dynamics.control_cycle.cycle_results import ACCEPTED, NEVER, NOT_FINITE
from kane_dynamics.control_cycle.cycle_rules import Event, GivenStop, PathState
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.ros.common.cdr import joint_state_of_efforts, STAMP, STAMP_AT
from kane_dynamics.ros.common.conversion import Array, NANO
from kane_dynamics.ros.common.node_statistics import Statistics
from kane_dynamics.ros.guard.node_watch import NodeWatch
from kane_dynamics.ros.loads.gravity_payload import GravityAndPayload
from kane_dynamics.ros.parameters.parameter_checks import controller_settings, per_joint
from kane_dynamics.ros.torque_path.closed_loop_reader import closed_loop_reader
from kane_dynamics.ros.torque_path.path_controller import rate_limit
from kane_dynamics.ros.torque_path.python_rules import (Compute, ControllerLaw, measured,
                                                        PythonRules)
from kane_dynamics.ros.torque_path.torque_path import TorquePath
import numpy as np
from rclpy.publisher import Publisher

CLOCK_JUMPS = PathState._fields.index('clock_jumps')
RAMP = 0.005  # s, in which the torque changes from the node's to the guard's
LATE = 1.5  # times state_timeout, after which the node should have commanded zeros


class NotedTorques:
    """
    A publisher that notes each of its messages.

    Parameters
    ----------
    publisher : Publisher
    note : callable
        Called after each message.

    """

    def __init__(self, publisher: Publisher, note: Callable[[], None]) -> None:
        self._publisher = publisher
        self._note = note

    def publish(self, data: bytes) -> None:
        """Publish a message, and note it."""
        self._publisher.publish(data)
        self._note()


def guard_settings(values: Mapping[str, Any], controller: Controller) -> dict[str, Any]:
    """
    Return the settings of the guard's Controller.

    Computed torque without position gain at zero desired speed is gravity, Coriolis
    force, and damping by the inertia: M(q) (-kd u) + h(q, u).
    """
    joints = controller.robot.joint_names
    follow = list(map(joints.index, controller.followed))
    return controller_settings(values, joints) | {
        'mode': Mode.COMPUTED_TORQUE, 'blend_time': 0.0, 'kp': 0.0,
        'rate_limit': rate_limit(values, controller.robot),
        'kd': per_joint(values, 'guard.damping', joints, 0.0)[follow]}


class GuardPath:
    """
    Publishes damping torques while the guard acts; otherwise only checks the joint states.

    The torque is h(q, u) - M(q) (damping u). The difference from the last torque of the
    node fades out during `RAMP`, or during the longer time that a joint needs within its
    rate limit: joints that were limited one by one would throw lighter ones about. Then
    the limits of the node apply.

    It is a `PythonLaw` of a torque path, whose rules ask it who commands.

    Parameters
    ----------
    controller : Controller
    commands, torques : Publisher
        As for TorquePath.
    now : callable
        Returns the node's clock, ns.
    values : mapping
        The parameters of the dynamics node.
    statistics : Statistics
    warn : callable
        As for TorquePath.
    report : callable
        Called with level ('error' or 'info') and text of each change between watching
        and commanding.

    Attributes
    ----------
    path : TorquePath
        Judges states and publishes.
    watch : NodeWatch

    """

    def __init__(self, controller: Controller, commands: Publisher, torques: Publisher,
                 now: Callable[[], int], values: Mapping[str, Any],
                 statistics: Statistics,
                 warn: Callable[[str, str], None],
                 report: Callable[[str, str], None]) -> None:
        self.detail = ''
        self._controller = controller
        self._now = now
        self._warn = warn
        self._report = report
        self._pending_report = ''
        self._values = values
        # Those begun; stamp of the last one, ns; jumps of the clock until then
        self._takeovers = 0
        self._took_over = 0
        self._jumps = 0.0
        # N m; s
        self._offset = np.zeros(controller.robot.n_q)
        self._ramp = 0.0
        # Configuration, speeds and time, ns, of the arm by the model in a fault: since
        # the last valid state, under the commands since then. None if it is unknown.
        self._predicted: tuple[Array, Array, int] | None = None
        self._last_command = 0  # stamp of the last torque of the node, ns
        self.path = TorquePath(
            controller, commands, NotedTorques(torques, self._note_own), now, values,
            statistics, warn, loops=closed_loop_reader(controller, values),
            report_fault=lambda reason, detail: report('error',
                                                       f'joint states: {detail}'),
            rules=self._rules_of)
        joints = self.path.messages.joints
        self.watch = NodeWatch(values['guard.lease'], len(joints))
        self._node_torques = joint_state_of_efforts(joints)
        self.update(values)

    def _rules_of(self, path: TorquePath) -> PythonRules:
        """Return the rules of a path, which ask the guard who commands."""
        rules = PythonRules(path, self)
        self._answer = rules.answer
        rules.by_name |= {'permit': self._permit, 'answer': self._confirmed_answer}
        return rules

    def compile(self) -> None:  # noqa: A003
        """Compile what commands need."""
        self.path.compile()

    def update(self, values: Mapping[str, Any]) -> None:
        """Use checked parameters from the next state on."""
        self._values = values
        self._controller.update(**guard_settings(values, self._controller))
        if self.path.loops is not None:
            self.path.loops.update(values)
        self.path.set_limits(values)

    def set_loads(self, loads: GravityAndPayload) -> None:
        """Use gravity and payload of the dynamics node from the next state on."""
        self.path.set_loads(loads)

    def start(self) -> None:
        """Start to watch."""
        self.path.start()

    def stop(self) -> None:
        """Ignore further states; command zeros if the guard commands."""
        self.path.running = False
        if self.commanding:
            self.path.command_zeros()

    @property
    def commanding(self) -> bool:
        """Return whether a torque of the guard acts."""
        return self.path.commanding

    @property
    def timed_out(self) -> bool:
        """Return whether joint states have timed out."""
        return self.path.timed_out

    @property
    def fault(self) -> str:
        """Return why states are refused for longer than the grace time, if they are."""
        return self.path.fault

    @property
    def need_velocity(self) -> bool:
        """Return whether the node drops states without velocities."""
        return bool(self._values['mode'] != Mode.GRAVITY_COMPENSATION)

    def on_state(self, data: bytes) -> None:
        """Check one serialized JointState; command while the guard acts."""
        self.path.on_state(data)
        self.path.commanding = self.commanding and self.watch.acting
        if self._pending_report:  # after the command, which must not wait for the log
            text = self._pending_report
            self._pending_report = ''
            self._report('error', text)

    # The law.

    @property
    def pose(self) -> Array | None:
        """Return None: no pose is held."""
        return None

    def torque(self) -> Array:
        """Return the guard's torques at the state of the cycle, (n_q,)."""
        path = self.path
        loop = path.native
        controller = self._controller
        path.apply_loads()
        now, stamp = map(path.time_of, loop.event[:2])
        at = min(now, stamp)
        jumps = loop.memory.entries[CLOCK_JUMPS]
        if jumps != self._jumps:  # a ramp begins again
            self._jumps = jumps
            self._took_over = at
        continues = self._takeovers == self.watch.takeovers
        if not continues:
            self._takeovers = self.watch.takeovers
            # The node's torques are compared with it, which have the stamps of states.
            self._took_over = stamp
        elapsed = max(at - self._took_over, 0) / NANO
        # The guard's own law: h(q, u) - M(q) (damping u).
        try:
            tau = controller.torque(*measured(path), None, 0.0)
        except (InputError, ConstraintError):
            self._note_refusal()
            raise
        if not continues:
            # Begin with the last torque of the node. Its difference from the law ramps
            # down in the time that the slowest joint needs within its rate limit.
            self._offset = path.messages.of_all(self.watch.torque) - tau
            rate = controller.rate_limit
            needed = np.divide(np.abs(self._offset), rate, out=np.zeros(len(rate)),
                               where=rate > 0.0)
            self._ramp = max(RAMP, *needed.tolist())
            self._resume(Event(*loop.event[:len(Event._fields)].tolist()))
            silent = self.watch.silent_for * 1e3
            self._pending_report = f'no command for {silent:.1f} ms: holding the arm'
        if elapsed < self._ramp:
            tau = tau + (1.0 - elapsed / self._ramp) * self._offset
        return tau

    def begin_of_stop(self) -> Array:
        """Return where the model says that the arm is, and how fast; NaN if unknown."""
        if self._predicted is None:
            return np.full(len(self.path.native.stop_begin), np.nan)
        q, u, _ = self._predicted
        return self.path.reached_from(q, u, 0.0)

    def stop_torque(self) -> Array:
        """
        Return the torques of all joints in the stop, which a takeover begins.

        They are those of the normal law at the predicted state: the prediction has the
        limits of commands, and that they are constant between two states.
        """
        path = self.path
        loop = path.native
        live = loop.memory
        # The stop goes on from where the arm is predicted to be, without states.
        if live.entries[STOP_BEGAN] <= NEVER:
            live.path = cycle_rules.stopping(live.path, GivenStop(self.begin_of_stop()),
                                             loop.plan.settings, np.zeros(0))
        if self._predicted is not None:
            motion, elapsed = path.stop_of_now()
            q, u, _ = self._predicted
            try:
                return self._controller.torque(q, u, motion, elapsed)
            except (InputError, ConstraintError):  # along the stop alone
                pass
        return ControllerLaw(path).stop_torque()

    # The node.

    def on_torques(self, data: bytes) -> None:
        """Note a command of the node, a serialized JointState."""
        if not self._node_torques.read(data):
            self._warn('joint_torques', f'{len(data)} bytes; expected '
                       f'{self._node_torques.bytes.size}, with the joints of the '
                       'parameters')
            return
        path = self.path
        sec, nanosec = STAMP.unpack_from(data, STAMP_AT)
        stamp = sec * NANO + nanosec
        torque = self._node_torques.numbers.copy()
        now = time.perf_counter()
        if self.watch.acting:
            # Computed before the node hung
            if 0 < stamp <= self._took_over:
                return
            if not torque.any():
                self.on_stopped()
                return
            self._report('info',
                         'the dynamics node commands without a request; watching it')
        path.commanding = False
        if self.fault and torque.any() and not self.watch.armed:
            # The node was activated again and accepts the states.
            path.change(cycle_rules.forgotten)
        if path.loops is not None and path.loops.lost:
            path.restart_loops()  # the node knows the assembly mode again
        # It acts from its state on; a stamp ahead must not delay what follows.
        self._last_command = min(stamp or self._now(), self._now())
        if path.native.memory.entries[REFUSING] > 0.5:
            self._predict(self._last_command)
        self.watch.note_node_command(torque, now)

    def on_stopped(self) -> None:
        """Note that the node commanded zeros; that message itself may be lost."""
        if self.watch.acting:
            self.path.command_zeros()
            self._report('info', 'the dynamics node commands zeros; watching it')
        self.path.commanding = False
        self.watch.note_node_command(np.zeros(len(self.path.messages.joints)),
                                     time.perf_counter())

    def hand_over(self) -> bool:
        """Stop commanding; return whether the guard commanded."""
        acted = self.watch.acting
        self.path.commanding = False
        self.watch.wait_for_node(time.perf_counter())
        return acted

    def _note_own(self) -> None:
        """Note a torque of the guard; a command after zeros starts from them."""
        self.watch.note(self.path.native.memory.tau.copy(), True)
        if not self.commanding:
            self._offset = np.zeros(len(self._offset))

    def on_clock_jump(self) -> None:
        """Handle a backward jump of the clock."""
        self._write_permission()
        self.path.on_clock_jump()

    def check_timeout(self) -> None:
        """Command if states are stale or impossible and the node does not react."""
        path = self.path
        live = path.native.memory
        now = time.perf_counter()
        # After a stall of its own, states and torques may be in the queue.
        self.watch.tick(now)
        live.array[LOOKED_AT] = now * NANO
        live.array[LAST_LOOK] = self._event().now
        if self.watch.acting:
            self._write_permission()
            path.check_timeout()
            # The loss of liveliness began a takeover, and no valid state came since.
            if self.fault and self.watch.armed and not self.commanding:
                self._take_over_in_fault(now)
            return
        late = LATE * path.states.timeout
        # The node is silent, and the arm too, or its states are impossible: the guard
        # commands. A node that commands hears the states that this guard does not; they
        # may be as slow as the timeout, so that its silence counts when it is as long.
        if not self.watch.may_take_over(now):
            return
        node_is_silent = self.watch.silent(now) and now - self.watch.heard_at > late / NANO
        if node_is_silent and self._now() - path.time_of(live.entries[LAST_HEARD]) > late:
            self.watch.take_over(now)
            self._takeovers = self.watch.takeovers
            self._took_over = self._now()
            path.commanding = True
            self._write_permission()
            path.time_out('and no zeros from the dynamics node')
        elif self.fault and now - self.watch.waiting_since > late / NANO:
            # However long the lease is: the torque of before the fault acts meanwhile.
            self._take_over_in_fault(now)

    def _take_over_in_fault(self, now: float) -> None:
        """Command what the parameters say, from the next impossible state on."""
        self.watch.take_over(now)
        self._took_over = self._now()
        # The torque does not change until the next state, where another stop begins from
        # where the model says that the arm is.
        self._resume(self._event())
        self.path.change(lambda path: cycle_rules.resumed(
            path, 1.0, path.last_heard)._replace(stop_began=NEVER))
        self._report('error',
                     f'no command for {self.watch.silent_for * 1e3:.1f} ms, and joint '
                     f'states are impossible ({self.fault}): {self.path.reaction}')

    def _resume(self, event: Event) -> None:
        """Continue from the last torque of the node: the limit of the rate counts from it."""
        settings = self.path.native.plan.settings

        def taken_back(path: PathState) -> PathState:
            path = cycle_rules.at_time(path, event.now, settings)
            return cycle_rules.taken_back(path, event, self.watch.torque, settings)
        self.path.change_and_note(taken_back, event.now)

    def _event(self) -> Event:
        """Return the times of now."""
        now = float(self._now() - self.path.time_of(0.0))
        return Event(now, now, 0.0, 0.0, float(bool(self._now())),
                     time.perf_counter() * NANO)

    # Who commands, by `NodeWatch`.

    def _write_permission(self) -> None:
        """Let the rules know whether the guard commands."""
        self.path.native.memory.arbitration[PERMITTED] = self.watch.acting

    def _permit(self, compute: Compute) -> None:
        """Decide whether to command at a state that was judged; else the node may."""
        self._wait = compute
        live = self.path.native.memory
        code = live.entries[REASON]
        now = time.perf_counter()
        if code == ACCEPTED:
            permitted = self.watch.may_command(now)
        elif code >= NOT_FINITE:
            self._note_refusal()
            permitted = not self.commanding or self.watch.may_repeat(now)
        else:
            return
        live.arbitration[PERMITTED] = permitted
        compute()

    def _confirmed_answer(self, compute: Compute) -> None:
        """Command the guard's torque, if the guard still commands then."""
        loop = self.path.native
        self._answer(compute)
        if loop.result[REASON] == ACCEPTED and not self.watch.confirm(time.perf_counter()):
            loop.memory.arbitration[PERMITTED] = 0.0
            self._wait()

    # The motion that is not measured.

    def _note_refusal(self) -> None:
        """Let the model say where the arm is from the last accepted state on."""
        live = self.path.native.memory
        if live.entries[REFUSING] < 0.5:
            self._predicted = None
            if live.known:
                stamp = self.path.time_of(live.states.stamp)
                self._predicted = live.q.copy(), live.u.copy(), stamp
        self._predict(self.path.time_of(live.entries[LAST_HEARD]))

    def _predict(self, moment: int) -> None:
        """
        Predict the arm's motion in a fault up to a time, ns, under the last torque.

        Called before each change of the torque, so that every torque counts for as long
        as it acted.
        """
        if self._predicted is None:
            return
        q, u, since = self._predicted
        if moment <= since:
            return
        # Brakes may act while no motor does, and a guard that was stopped has missed
        # commands: the model knows neither.
        if not self.watch.armed or moment - since > LOST * NANO:
            self._predicted = None
            return
        # The node holds without feedback: the model's errors would grow without bound.
        if self._node_has_stopped_it:
            self._predicted = q, 0.0 * u, moment
            return
        try:
            q, u = self._controller.predicted_state(
                q, u, self.path.messages.of_all(self.watch.torque), (moment - since) / NANO)
        except (InputError, ConstraintError):  # no finite state, or singular loops
            self._predicted = None
            return
        self._predicted = q, u, moment

    @property
    def _node_has_stopped_it(self) -> bool:
        """Return whether the node's stop was over when it commanded last."""
        began = self.path.native.memory.entries[STOP_BEGAN]
        if began <= NEVER or self.watch.commanded_last:
            return False
        stopped = self.path.time_of(began) + self.path.states.stop_time * NANO
        return self._last_command > stopped
