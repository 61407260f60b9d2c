"""The lifecycle node: it finds the URDF, compiles the robot, and wires the torque path."""

from collections.abc import Callable, Collection, Mapping
import gc
from pathlib import Path
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from kane_dynamics.errors import InputError, KaneError
from kane_dynamics.ros.common import realtime
from kane_dynamics.ros.common.configuration_files import load, located
from kane_dynamics.ros.common.node_statistics import Statistics
from kane_dynamics.ros.common.service_errors import guard_services
from kane_dynamics.ros.common.throttle import ThrottledWarning
from kane_dynamics.ros.dynamics_node.configured_robot import ACKNOWLEDGE, ConfiguredRobot
from kane_dynamics.ros.dynamics_node.node_diagnostics import report
from kane_dynamics.ros.parameters.live_parameters import LiveParameters
from kane_dynamics.ros.parameters.parameter_table import SPECS
from kane_dynamics.ros.services.services import Services
from kane_dynamics.ros.torque_path.sim_time_watchdog import LOST, SimTimeWatchdog
from kane_dynamics.ros.torque_path.trajectory_input import take_trajectory
from kane_dynamics_interfaces.srv import SetPayload
from rclpy.clock import Clock, ClockType, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

BACK = JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1),
                     on_clock_change=False)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class DynamicsNode(LifecycleNode):
    """
    The node `kane_dynamics`.

    Raises
    ------
    InputError
        A parameter given at start is not valid.

    """

    def __init__(self) -> None:
        super().__init__('kane_dynamics')
        guard_services(self)
        self._live = LiveParameters(self, SPECS, self._frozen, self._check_parameters,
                                    self._apply_parameters)
        self.statistics = Statistics()
        self.arm: ConfiguredRobot | None = None
        self._description = ''  # of the topic
        self._configured = False  # ever: what comes later is the operator's business
        self._warn = ThrottledWarning(self.get_logger())
        self._reported = time.monotonic()
        self._sources = 1  # publishers of joint states at the last report
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._simulated_time = bool(self.get_clock().ros_time_is_active)
        self._jumps = self.get_clock().create_jump_callback(
            BACK, post_callback=self._on_jump)  # lasts as long as it is kept
        self.clock = SimTimeWatchdog(self)
        self._timers_of_rate: list[Any] = []
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics',
                                                  QoSProfile(depth=1))
        self.create_subscription(String, 'robot_description', self._on_description, LATCHED)
        self.server = Services(self, self._on_trajectory, self._on_payload)
        self._set_timers()

    @property
    def values(self) -> dict[str, Any]:
        """Return the checked parameters by name."""
        return self._live.values

    @property
    def state(self) -> str:
        """Label of the lifecycle state."""
        return str(self._state_machine.current_state[1])

    def autostart(self) -> None:
        """Configure and activate, if that is wanted, was never done, and the URDF is known."""
        if not self.values['autostart'] or self._configured or self.state != 'unconfigured':
            return
        if not (self.values['robot_description'] or self.values['urdf'] or self._description):
            self.get_logger().info('waiting for a URDF on topic robot_description')
        elif self.trigger_configure() == SUCCESS and not self._unable():
            self.trigger_activate()

    def _urdf(self) -> str | Path:
        """Return the URDF, as text or path; empty if it is not known yet."""
        if self.values['robot_description'] or not self.values['urdf']:
            return str(self.values['robot_description'] or self._description)
        return located('urdf', self.values['urdf'])

    def _on_description(self, message: String) -> None:
        """Take the URDF from the topic, unless a parameter gives it."""
        if self.values['robot_description'] or self.values['urdf'] or (
                message.data == self._description):
            return
        self._description = message.data
        if self.state == 'active':
            self.statistics.rejected['robot_description'] += 1
            self.get_logger().error('a changed robot_description is refused while the node is '
                                    'active; deactivate it, clean up, and configure anew')
        elif self.state == 'inactive':
            self.get_logger().warning('the changed robot_description takes effect when the node '
                                      'is cleaned up and configured anew')
        else:
            self.autostart()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Load the URDF, compile and verify the kernels, and open the topics."""
        try:
            self._configure()
        except Exception as error:
            kind = '' if isinstance(error, KaneError) else f'{type(error).__name__}: '
            self.get_logger().error(f'not configured: {kind}{error}')
            self._release()
            return FAILURE
        self._configured = True
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to answer joint states."""
        if unable := self._unable():
            self.get_logger().error(f'not activated: {unable}')
            return FAILURE
        result = super().on_activate(state)
        assert self.arm is not None
        self.arm.path.start()
        self.get_logger().info(f'active, mode {self.values["mode"]}')
        return result

    def _unable(self) -> str:
        """Return why this arm cannot be commanded; empty: it can."""
        assert self.arm is not None
        names = self.arm.robot.constraint_names
        return '' if not names else (f'parameter constraints holds {", ".join(names)}: the node '
                                     'answers requests, but commands only arms without')

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Command zeros, then close the publishers."""
        self.halt()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget the robot."""
        self._release()
        return SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Command zeros if torques may be acting, and forget the robot."""
        self.halt()
        self._release()
        return SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Command zeros and fall back to unconfigured."""
        self.halt()
        self._release()
        return SUCCESS

    def halt(self) -> None:
        """Command zeros and wait, within bounds, until subscribers have them."""
        if self.arm is not None and not self.arm.halt():
            self.get_logger().error('zeros were commanded, but a subscriber of commands did not '
                                    f'acknowledge them within {ACKNOWLEDGE} s')

    def _configure(self) -> None:
        began = time.perf_counter()
        source = self._urdf()
        if not source:
            raise InputError("no URDF: set parameter 'robot_description' or 'urdf', or publish "
                             'on topic robot_description')
        log = self.get_logger()
        model = load(source, self.values, log.warning)
        self.statistics = Statistics()
        self.arm = ConfiguredRobot(self, self.server, model, self.values, self.statistics,
                                   self._warn)
        # What lives until cleanup need not be looked through by every collection.
        gc.collect()
        gc.freeze()
        realtime.apply(self.values, log.warning)
        joints = self.arm.robot.joint_names
        if model.flexible:
            modes = ', '.join(model.coordinate_names[k] for k in model.modal_coordinates)
            log.info(f'{modes} follow the load at once in what is commanded; to all else that the '
                     'node answers, the beams are rigid')
        log.info(f'{model.name}: {len(joints)} joints ({", ".join(joints)}), kernels ready in '
                 f'{time.perf_counter() - began:.2f} s, verified to {self.arm.verified:.1e}')
        if unable := self._unable():
            log.info(f'it stays inactive: {unable}')

    def _release(self) -> None:
        """Forget the robot and close its topics."""
        gc.unfreeze()
        realtime.collect_when_asked(False)
        arm, self.arm = self.arm, None
        if arm is not None:
            arm.close()

    def _on_trajectory(self, data: bytes, received: int) -> None:
        """Take a new desired motion; runs in the services' thread."""
        try:
            if self.arm is None or not self.arm.path.running:
                raise InputError(f'the node is {self.state}')
            if remark := take_trajectory(self.arm.path, data, received, self.values):
                self.get_logger().warning(f'joint_trajectory: {remark}')
        except KaneError as error:
            self.statistics.rejected['joint_trajectory'] += 1
            self.get_logger().error(f'joint_trajectory rejected: {error}')

    def _on_payload(self, request: SetPayload.Request) -> None:
        """Carry a payload; runs in the services' thread."""
        if self.arm is None:
            raise InputError('not configured')
        self.arm.set_payload(request)
        self.get_logger().info(f'payload: {request.payload.m:g} kg')

    def _frozen(self) -> str:
        """Return why only live parameters may change now; empty: all may."""
        return '' if self.state == 'unconfigured' else (
            f'it is used when the node configures, and that is {self.state}; deactivate it and '
            'clean up first')

    def _check_parameters(self, values: Mapping[str, Any], given: Collection[str]) -> None:
        if self.arm is not None:
            self.arm.check(values, given)

    def _apply_parameters(self, before: Mapping[str, Any], given: Collection[str]) -> None:
        """Apply what was checked; between two cycles, since both run in the main thread."""
        simulated = bool(self.get_clock().ros_time_is_active)
        exchanged, self._simulated_time = simulated != self._simulated_time, simulated
        if exchanged or any(before[name] != self.values[name]
                            for name in ('diagnostics_rate', 'state_timeout')):
            self._set_timers()
        if self.arm is not None:
            self.arm.update(self.values, given)
            if exchanged:
                self.arm.clock_jumped(exchanged=True)

    def _on_jump(self, jump: TimeJump) -> None:
        """Take notice of a clock that was set back as soon as that is known."""
        if self.arm is not None:
            self.arm.clock_jumped()

    def _set_timers(self) -> None:
        """
        Start watchdog and diagnostics.

        The watchdog looks at simulated time where that is used, however fast it goes: while it
        stands, nothing grows older; but somebody must be there to let it go on. Else it runs on
        steady time, which no one sets. So do the diagnostics always, in the services' thread: a
        report takes longer than a cycle may wait.
        """
        watched = self.get_clock() if self._simulated_time else self._steady
        for node, timer in self._timers_of_rate:
            node.destroy_timer(timer)
        watch = max(0.2 * self.values['state_timeout'], 1e-3)
        timers: list[tuple[Node, float, Callable[[], None], Clock]] = [
            (self, watch, self._watch, watched),
            (self.server, 1.0 / self.values['diagnostics_rate'], self._report, self._steady)]
        if self._simulated_time:
            timers.append((self, LOST / 4.0, self._watch_clock, self._steady))
        self._timers_of_rate = [(node, node.create_timer(period, callback, clock=clock))
                                for node, period, callback, clock in timers]
        self.server.spinner.wake()

    def _watch(self) -> None:
        if self.arm is not None:
            self.arm.path.watch()

    def _watch_clock(self) -> None:
        self.clock.look(None if self.arm is None else self.arm.path)

    def _report(self) -> None:
        now = time.monotonic()
        period, self._reported = now - self._reported, now
        self.clock.report()
        if self.arm is not None:
            self.arm.count_sources()
        message = DiagnosticArray(status=[report(self, period)])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)
        realtime.collect()
        sources = 1 if self.arm is None else self.arm.sources
        if sources > 1 and sources != self._sources:
            self.get_logger().warning(f'{sources} publishers on joint_states: torques follow '
                                      'whichever spoke last; stop all but one')
        self._sources = sources
