"""The torque path of the guard: gravity and damping, from the node's last torque."""

from collections.abc import Callable, Mapping
import time
from typing import Any

from kane_dynamics._util.typing import Scalar
from kane_dynamics.control.controller import Controller, Mode
from kane_dynamics.control_cycle import cycle_rules
from kane_dynamics.control_cycle.arbitration import Arbitration, LOST, PERMITTED
from kane_dynamics.control_cycle.cycle_results import ACCEPTED, NEVER
from kane_dynamics.control_cycle.cycle_rules import GivenStop, PathState
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.motion.motion import Motion
from kane_dynamics.ros.common.cdr import joint_state_of_efforts, STAMP, STAMP_AT
from kane_dynamics.ros.common.conversion import Array, NANO
from kane_dynamics.ros.common.node_statistics import Statistics
from kane_dynamics.ros.guard.node_watch import NodeWatch
from kane_dynamics.ros.parameters.parameter_checks import controller_settings, per_joint
from kane_dynamics.ros.torque_path.closed_loop_reader import closed_loop_reader
from kane_dynamics.ros.torque_path.path_controller import rate_limit
from kane_dynamics.ros.torque_path.path_memory import LAST_LOOK, LOOKED_AT
from kane_dynamics.ros.torque_path.torque_path import TorquePath
import numpy as np
from rclpy.publisher import Publisher

NO_PARAMETERS = np.zeros(0)
RAMP = 0.005  # s, in which the torque changes from the node's to the guard's
LATE = 1.5  # times state_timeout, after which the node should have commanded zeros


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


class GuardPath(TorquePath):
    """
    Publishes damping torques while the guard acts; otherwise only checks the joint states.

    The torque is h(q, u) - M(q) (damping u). The difference from the last torque of the
    node fades out during `RAMP`, or during the longer time that a joint needs within its
    rate limit: joints that were limited one by one would throw lighter ones about. Then
    the limits of the node apply.

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

    """

    def __init__(self, controller: Controller, commands: Publisher, torques: Publisher,
                 now: Callable[[], int], values: Mapping[str, Any],
                 statistics: Statistics,
                 warn: Callable[[str, str], None],
                 report: Callable[[str, str], None]) -> None:
        super().__init__(
            controller, commands, torques, now, values, statistics, warn,
            loops=closed_loop_reader(controller, values),
            report_fault=lambda reason, detail: report('error',
                                                       f'joint states: {detail}'))
        joints = self.messages.joints
        self.watch = NodeWatch(values['guard.lease'], len(joints))
        self._asks = True
        self._keep_waiting, = self._rules.bound({'WAIT': cycle_rules.waiting})
        self._report = report
        self._pending_report = ''
        self._node_torques = joint_state_of_efforts(joints)
        # Those begun; stamp of the last one, ns
        self._takeovers = 0
        self._took_over = 0
        # N m; s
        self._offset = np.zeros(controller.robot.n_q)
        self._ramp = 0.0
        # Configuration, speeds and time, ns, of the arm by the model in a fault: since
        # the last valid state, under the commands since then. None if it is unknown.
        self._predicted: tuple[Array, Array, int] | None = None
        self._last_command = 0  # stamp of the last torque of the node, ns
        self.update(values)

    def update(self, values: Mapping[str, Any]) -> None:
        """Use checked parameters from the next state on."""
        self._values = values
        self.controller.update(**guard_settings(values, self.controller))
        self.set_limits(values)
        if self.loops is not None:
            self.loops.update(values)

    @property
    def need_velocity(self) -> bool:
        """Return whether the node drops states without velocities."""
        return bool(self._values['mode'] != Mode.GRAVITY_COMPENSATION)

    def on_state(self, data: bytes) -> None:
        """Check one serialized JointState; command while the guard acts."""
        super().on_state(data)
        self.commanding = self.commanding and self.watch.acting
        if self._pending_report:  # after the command, which must not wait for the log
            text = self._pending_report
            self._pending_report = ''
            self._report('error', text)

    def _torque(self, stamp: int, motion: Motion | None, moment: float,
                external: Array | None) -> Array:
        """Return the guard's torques at the latest state."""
        controller = self.controller
        reader = self._reader
        # Without velocities there is no damping.
        mode = Mode.COMPUTED_TORQUE if reader.has_velocity else Mode.GRAVITY_COMPENSATION
        if controller.mode is not mode:
            controller.update(mode=mode)
        continues = self._takeovers == self.watch.takeovers
        if not continues:
            self._takeovers = self.watch.takeovers
            # The node's torques are compared with it, which have the stamps of states.
            self._took_over = self._reader.stamp or stamp
        elapsed = max(stamp - self._took_over, 0) / NANO
        # The guard's own law: h(q, u) - M(q) (damping u).
        tau = controller.torque(reader.q, reader.u, None, 0.0)
        if not continues:
            # Begin with the last torque of the node. Its difference from the law ramps
            # down in the time that the slowest joint needs within its rate limit.
            self._offset = self.messages.of_all(self.watch.torque) - tau
            rate = controller.rate_limit
            needed = np.divide(np.abs(self._offset), rate, out=np.zeros(len(rate)),
                               where=rate > 0.0)
            self._ramp = max(RAMP, *needed.tolist())
            self._resume()
            silent = self.watch.silent_for * 1e3
            self._pending_report = f'no command for {silent:.1f} ms: holding the arm'
        if elapsed < self._ramp:
            tau = tau + (1.0 - elapsed / self._ramp) * self._offset
        return tau

    def on_torques(self, data: bytes) -> None:
        """Note a command of the node, a serialized JointState."""
        if not self._node_torques.read(data):
            self._warn('joint_torques', f'{len(data)} bytes; expected '
                       f'{self._node_torques.bytes.size}, with the joints of the '
                       'parameters')
            return
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
        self.commanding = False
        if self.fault and torque.any() and not self.watch.armed:
            # The node was activated again and accepts the states.
            self._change(cycle_rules.forgotten)
        if self.loops is not None and self.loops.lost:
            self.loops.restart()  # the node knows the assembly mode again
        # It acts from its state on; a stamp ahead must not delay what follows.
        self._last_command = min(stamp or self._now(), self._now())
        if self._refusing:
            self._predict(self._last_command)
        self.watch.note_node_command(torque, now)

    def on_stopped(self) -> None:
        """Note that the node commanded zeros; that message itself may be lost."""
        if self.watch.acting:
            self.command_zeros()
            self._report('info', 'the dynamics node commands zeros; watching it')
        self.commanding = False
        self.watch.note_node_command(np.zeros(len(self.messages.joints)),
                                     time.perf_counter())

    def hand_over(self) -> bool:
        """Stop commanding; return whether the guard commanded."""
        acted = self.watch.acting
        self.commanding = False
        self.watch.wait_for_node(time.perf_counter())
        return acted

    def check_timeout(self) -> None:
        """Command if states are stale or impossible and the node does not react."""
        now = time.perf_counter()
        # After a stall of its own, states and torques may be in the queue.
        self.watch.tick(now)
        self._memory.array[LOOKED_AT] = now * NANO
        self._memory.array[LAST_LOOK] = self._now() - self._epoch
        if self.watch.acting:
            super().check_timeout()
            # The loss of liveliness began a takeover, and no valid state came since.
            if self.fault and self.watch.armed and not self.commanding:
                self._take_over_in_fault(now)
            return
        late = LATE * self.states.timeout
        # The node is silent, and the arm too, or its states are impossible: the guard
        # commands. A node that commands hears the states that this guard does not; they
        # may be as slow as the timeout, so that its silence counts when it is as long.
        if not self.watch.may_take_over(now):
            return
        node_is_silent = self.watch.silent(now) and now - self.watch.heard_at > late / NANO
        if node_is_silent and self._now() - self._last_heard > late:
            self.watch.take_over(now)
            self._takeovers = self.watch.takeovers
            self._took_over = self._now()
            self.commanding = True
            self.time_out('and no zeros from the dynamics node')
        elif self.fault and now - self.watch.waiting_since > late / NANO:
            # However long the lease is: the torque of before the fault acts meanwhile.
            self._take_over_in_fault(now)

    def _take_over_in_fault(self, now: float) -> None:
        """Command what the parameters say, from the next impossible state on."""
        self.watch.take_over(now)
        self._took_over = self._now()
        # The torque does not change until the next state, where another stop begins from
        # where the model says that the arm is.
        self._resume()
        self._change(lambda path: cycle_rules.resumed(path, 1.0, path.last_heard)._replace(
            stop_began=NEVER))
        self._report('error',
                     f'no command for {self.watch.silent_for * 1e3:.1f} ms, and joint '
                     f'states are impossible ({self.fault}): {self.reaction}')

    def _resume(self) -> None:
        """Continue from the last torque of the node: the limit of the rate counts from it."""
        now = self._now()
        settings = self._rules.settings
        event = self._event(now)

        def taken_back(path: PathState) -> PathState:
            path = cycle_rules.at_time(path, event.now, settings)
            return cycle_rules.taken_back(path, event, self.watch.torque, settings)
        self.controller.stop()
        before, path = self._change(taken_back)
        self._last_good = now
        self._note_drop(before, path, now)

    # Who commands, by `NodeWatch`.

    def _permitted(self, code: int) -> bool:
        """Decide whether to command at a state with this result; False: the node may."""
        now = time.perf_counter()
        if code == ACCEPTED:
            permitted = self.watch.may_command(now)
        else:
            permitted = not self.commanding or self.watch.may_repeat(now)
        self._memory.arbitration[PERMITTED] = permitted
        return code != ACCEPTED or permitted

    def _confirmed(self, began: float) -> bool:
        """Return whether the guard still commands."""
        return self.watch.confirm(time.perf_counter())

    def _wait(self, data: bytes, stamp: int, now: int) -> None:
        """Keep a state that the node answers."""
        self._keep_waiting()
        self._rules.keep()
        super()._wait(data, stamp, now)

    def _decide_zeros(self, known: Arbitration, steady: Scalar) -> Arbitration:
        """Command zeros if the guard commands."""
        return known._replace(permitted=float(self.watch.acting))

    # The motion that is not measured.

    def _refuse(self, code: int, detail: str, now: int) -> None:
        """Refuse a state; the model says where the arm is meanwhile."""
        if not self._refusing:
            self._predicted = self._last_accepted
        self._predict(self._last_heard)
        super()._refuse(code, detail, now)

    @property
    def _last_accepted(self) -> tuple[Array, Array, int] | None:
        """Return the last accepted state and its time, ns; None without one."""
        if not self.known:
            return None
        stamp = round(float(self._memory.path.states.stamp)) + self._epoch
        return self._accepted(), self._accepted_speeds(), stamp

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
            q, u = self.controller.predicted_state(q, u, self._acting(),
                                                   (moment - since) / NANO, since / NANO)
        except (InputError, ConstraintError):  # no finite state, or singular loops
            self._predicted = None
            return
        self._predicted = q, u, moment

    @property
    def _node_has_stopped_it(self) -> bool:
        """Return whether the node's stop was over when it commanded last."""
        began = float(self._memory.path.stop_began)
        if began <= NEVER or self.watch.commanded_last:
            return False
        return self._last_command - self._epoch - began > self.states.stop_time * NANO

    def _begin_of_stop(self) -> Array:
        """Return where the model says that the arm is, and how fast; nan if unknown."""
        if self._predicted is None:
            return np.full(2 * len(self._follow), np.nan)
        q, u, _ = self._predicted
        return self._reached_from(q, u, 0.0)

    def _stop_torque(self) -> Array:
        """
        Return the torques of all joints in the stop, which a takeover begins.

        They are those of the normal law at the predicted state: the prediction has the
        limits of commands, and that they are constant between two states.
        """
        # The stop goes on from where the arm is predicted to be, without states.
        path = self._memory.path
        if path.stop_began <= NEVER:
            stop = GivenStop(self._begin_of_stop())
            self._memory.path = cycle_rules.stopping(path, stop, self._rules.settings,
                                                     NO_PARAMETERS)
        if self._predicted is None:
            return super()._stop_torque()
        motion, elapsed = self._stop_of_now()
        q, u, _ = self._predicted
        controller = self.controller
        if controller.mode is not Mode.COMPUTED_TORQUE:
            controller.update(mode=Mode.COMPUTED_TORQUE)
        try:
            torque = controller.torque(q, u, motion, elapsed, None, self._last_heard / NANO)
        except (InputError, ConstraintError):  # along the stop alone
            return super()._stop_torque()
        return torque

    def _acting(self) -> Array:
        """Return the torques of all joints that act, (n_q,): those of the commander."""
        return self.messages.of_all(self.watch.torque)

    def _send(self, stamp: int) -> None:
        """Publish the torques, and note them; a command after zeros starts from them."""
        super()._send(stamp)
        self.watch.note(self._memory.tau.copy(), True)
        if not self.commanding:
            self._offset = np.zeros(len(self._offset))

    def _note_drop(self, before: PathState, path: PathState, now: int) -> bool:
        """Say what happened; after a jump of the clock, a ramp begins again."""
        if path.clock_jumps > before.clock_jumps:
            self._took_over = now
        return super()._note_drop(before, path, now)

    def stop(self, reason: str = '') -> None:
        """Ignore further states; command zeros if the guard commands."""
        self.running = False
        if self.commanding:
            self.command_zeros()
