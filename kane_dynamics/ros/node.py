"""The lifecycle node: it finds the URDF, compiles the robot, and wires the torque path."""

import gc
from pathlib import Path
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from kane_dynamics.control import Controller
from kane_dynamics.errors import InputError, KaneError
from kane_dynamics.quantities import IN_LOOPS
from kane_dynamics.robot import Robot
from kane_dynamics.ros import parameters
from kane_dynamics.ros.conversion import motion_from_message, NANO, nanoseconds
from kane_dynamics.ros.diagnostics import Statistics
from kane_dynamics.ros.files import load, located
from kane_dynamics.ros.report import report
from kane_dynamics.ros.requests import Served
from kane_dynamics.ros.services import Services
from kane_dynamics.ros.torque_path import TorquePath
from kane_dynamics.stepping import compile_simulation
import numpy as np
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from trajectory_msgs.msg import JointTrajectory

# Of the sensor data profile: what came during a stall of some ms is answered late, not never.
BEST_EFFORT = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
RELIABLE = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
ACKNOWLEDGE = 0.3  # s to wait for zeros to be acknowledged
WARN_PERIOD = 1.0  # s between two warnings of one kind
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
        self.values = parameters.declare(self)
        self.statistics = Statistics()
        self.path: TorquePath | None = None
        self.robot: Robot | None = None
        self.verified = 0.0
        self._staged: dict[str, Any] = {}
        self._description = ''  # of the topic
        self._configured_from = ''
        self._warned: dict[str, float] = {}
        self._reported = time.monotonic()
        self._publishers_of_torque: list[Any] = []
        self._states: Any = None
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timers_of_rate: list[Any] = []
        for remark in parameters.misspelt(list(getattr(self, '_parameter_overrides', {}))):
            self.get_logger().warning(remark)
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._apply_parameters)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', RELIABLE)
        self.create_subscription(String, 'robot_description', self._on_description, LATCHED)
        self.server = Services(self, self._on_trajectory)
        self._set_timers()

    @property
    def state(self) -> str:
        """Label of the lifecycle state."""
        return str(self._state_machine.current_state[1])

    def autostart(self) -> None:
        """Configure and activate, if that is wanted and the URDF is known."""
        if not self.values['autostart'] or self.state != 'unconfigured':
            return
        if not (self.values['robot_description'] or self.values['urdf'] or self._description):
            self.get_logger().info('waiting for a URDF on topic robot_description')
        elif self.trigger_configure() == SUCCESS:
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
        if self.state == 'active':
            self.statistics.rejected['robot_description'] += 1
            self.get_logger().error('a changed robot_description is refused while the node is '
                                    'active; deactivate it, clean up, and configure anew')
            return
        self._description = message.data
        self.autostart()
        if self.state == 'inactive':
            self.get_logger().warning('the changed robot_description takes effect when the node '
                                      'is cleaned up and configured anew')

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Load the URDF, compile and verify the kernels, and open the topics."""
        try:
            self._configure()
        except Exception as error:
            kind = '' if isinstance(error, KaneError) else f'{type(error).__name__}: '
            self.get_logger().error(f'not configured: {kind}{error}')
            self._release()
            return FAILURE
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to answer joint states."""
        result = super().on_activate(state)
        assert self.path is not None
        self.path.start()
        self.get_logger().info(f'active, mode {self.values["mode"]}')
        return result

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
        if self.path is None or not self.path.running:
            return
        self.path.stop()
        if not self._publishers_of_torque[0].wait_for_all_acked(Duration(seconds=ACKNOWLEDGE)):
            self.get_logger().error('zeros were commanded, but a subscriber of commands did not '
                                    f'acknowledge them within {ACKNOWLEDGE} s')

    def _configure(self) -> None:
        began = time.perf_counter()
        source = self._urdf()
        if not source:
            raise InputError("no URDF: set parameter 'robot_description' or 'urdf', or publish "
                             'on topic robot_description')
        model = load(source, self.values, self.get_logger().warning)
        robot, beside = Robot(model), Robot(model)
        robot.compile(*IN_LOOPS)
        compile_simulation(beside)  # what both use it finds in the cache
        self.verified = robot.verify()
        self.robot, self.statistics = robot, Statistics()
        commands = self.create_lifecycle_publisher(Float64MultiArray, 'commands', RELIABLE)
        torques = self.create_lifecycle_publisher(JointState, '~/joint_torques', RELIABLE)
        self._publishers_of_torque = [commands, torques]
        clock = self.get_clock()
        self.path = TorquePath(
            Controller(robot, **parameters.controller_settings(self.values, robot.joint_names)),
            commands, torques, lambda: clock.now().nanoseconds, self.values['state_timeout'],
            self.statistics, self._warn)
        self._states = self.create_subscription(JointState, 'joint_states', self.path.on_state,
                                                BEST_EFFORT)
        self._serve(beside)
        # What lives until cleanup need not be looked through by every collection.
        gc.collect()
        gc.freeze()
        self.get_logger().info(
            f'{model.name}: {robot.n} joints ({", ".join(robot.joint_names)}), kernels ready in '
            f'{time.perf_counter() - began:.2f} s, verified to {self.verified:.1e}')

    def _release(self) -> None:
        """Forget the robot and close its topics."""
        gc.unfreeze()
        self.server.served = None
        self.path = self.robot = None
        if self._states is not None:
            self.destroy_subscription(self._states)
            self._states = None
        for publisher in self._publishers_of_torque:
            self.destroy_lifecycle_publisher(publisher)
        self._publishers_of_torque = []

    def _on_trajectory(self, message: JointTrajectory) -> None:
        """Take a new desired motion; runs in the services' thread."""
        path, robot = self.path, self.robot
        try:
            if path is None or robot is None or not path.running:
                raise InputError(f'the node is {self.state}')
            motion = motion_from_message(message, robot.joint_names,
                                         self.values['trajectory.max_points'])
            now = self.get_clock().now().nanoseconds
            start = nanoseconds(message.header.stamp) or now
            if start + motion.duration * NANO < now and start != now:
                raise InputError(f'it ended {(now - start) / NANO - motion.duration:.3f} s ago')
            path.set_motion(motion, start)
        except KaneError as error:
            self.statistics.rejected['joint_trajectory'] += 1
            self.get_logger().error(f'joint_trajectory rejected: {error}')

    def _serve(self, robot: Robot) -> None:
        """Let the services answer with `robot` and the present parameters."""
        self.server.max_waiting = self.values['simulation.max_waiting']
        self.server.served = Served.from_values(robot, self.values)

    def _check_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        """Check a set of changes as a whole; nothing is applied yet."""
        staged = dict(self.values)
        try:
            for change in changes:
                spec = parameters.BY_NAME.get(change.name)
                if spec is None:
                    continue
                value = parameters.read(change.name, change.value)
                if not spec.live and self.state != 'unconfigured' and not np.array_equal(
                        value, staged[change.name]):
                    raise InputError(f"parameter '{change.name}' is used when the node "
                                     f'configures, and it is {self.state}; deactivate it and '
                                     'clean up first')
                staged[change.name] = value
            if self.robot is not None:
                parameters.controller_settings(staged, self.robot.joint_names)
        except KaneError as error:
            return SetParametersResult(successful=False, reason=str(error))
        self._staged = staged
        return SetParametersResult(successful=True)

    def _apply_parameters(self, changes: list[Parameter]) -> None:
        """Apply what was checked; between two cycles, since both run in the main thread."""
        before, self.values = self.values, self._staged
        if before['diagnostics_rate'] != self.values['diagnostics_rate'] or (
                before['state_timeout'] != self.values['state_timeout']):
            self._set_timers()
        if self.path is None or self.robot is None or self.server.served is None:
            return
        self.path.set_timeout(self.values['state_timeout'])
        self.path.controller.update(
            **parameters.controller_settings(self.values, self.robot.joint_names))
        beside = self.server.served.robot
        for robot in (self.robot, beside):
            robot.parameters.gravity = self.values['gravity']
        self._serve(beside)

    def _set_timers(self) -> None:
        """
        Start watchdog and diagnostics, on steady time: a paused clock stops neither.

        The diagnostics run in the services' thread: a report takes longer than a cycle may wait.
        """
        for node, timer in self._timers_of_rate:
            node.destroy_timer(timer)
        watch = max(0.2 * self.values['state_timeout'], 1e-3)
        self._timers_of_rate = [
            (node, node.create_timer(period, callback, clock=self._steady))
            for node, period, callback in (
                (self, watch, self._watch),
                (self.server, 1.0 / self.values['diagnostics_rate'], self._report))]
        self.server.spinner.wake()

    def _watch(self) -> None:
        if self.path is not None:
            self.path.watch()

    def _warn(self, reason: str, detail: str) -> None:
        """Warn of a joint state that was dropped, once a second for each reason."""
        now = time.monotonic()
        if now - self._warned.get(reason, -WARN_PERIOD) >= WARN_PERIOD:
            self._warned[reason] = now
            self.get_logger().warning(f'joint states: {reason}: {detail}')

    def _report(self) -> None:
        now = time.monotonic()
        period, self._reported = now - self._reported, now
        message = DiagnosticArray(status=[report(self, period)])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)
