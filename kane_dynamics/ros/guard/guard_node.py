"""The node torque_guard: follows the configuration of the dynamics node, and guards it."""

from collections.abc import Mapping
from pathlib import Path
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from kane_dynamics.errors import KaneError
from kane_dynamics.ros.common import realtime
from kane_dynamics.ros.common.configuration_files import load_model, resolve_path
from kane_dynamics.ros.common.qos import LATCHED, RELIABLE
from kane_dynamics.ros.common.service_errors import answer_service_errors
from kane_dynamics.ros.common.throttle import ThrottledWarning
from kane_dynamics.ros.guard.configured_guard import ConfiguredGuard
from kane_dynamics.ros.guard.guard_diagnostics import guard_status
from kane_dynamics.ros.guard.node_parameters import NodeParameters, SHARED, SIMULATED_TIME
from kane_dynamics.ros.torque_path.gravity_payload import GravityAndPayload
from kane_dynamics.ros.torque_path.guard_messages import (HEARTBEAT_PERIOD, LOADS,
                                                          loads_from_numbers, LOADS_LENGTH)
import numpy as np
from rclpy.clock import Clock, ClockType, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import Float64MultiArray, String

BACK = JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1),
                     on_clock_change=False)
FIXED = tuple(spec.name for spec in SHARED if not spec.live)
PERIOD = 0.02  # s between two checks of the joint states and of the dynamics node


class GuardNode(Node):
    """
    The node `torque_guard`.

    It reads the parameters of the dynamics node whenever ~/loads of that node has a new id, and
    builds the same robot. While its torque acts, a new configuration waits.
    """

    def __init__(self) -> None:
        super().__init__('torque_guard')
        answer_service_errors(self)
        self.target = str(self.declare_parameter('node', 'kane_dynamics').value)
        self.guard: ConfiguredGuard | None = None
        self.reason = (f'no message on {self.target}/{LOADS}; expected a configured node with '
                       'guard.enabled true')
        self._warn = ThrottledWarning(self.get_logger())
        self._description = ''
        self._configuration = 0.0
        self._loads: GravityAndPayload | None = None
        self._values: Mapping[str, Any] = {}
        self._next: Mapping[str, Any] | None = None  # parameters that wait
        self._source = NodeParameters(self, self.target, self._on_parameters)
        self._jumps = self.get_clock().create_jump_callback(BACK, post_callback=self._on_jump)
        self.create_subscription(String, 'robot_description', self._on_description, LATCHED)
        self.create_subscription(Float64MultiArray, f'{self.target}/{LOADS}', self._on_loads,
                                 LATCHED)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', RELIABLE)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._reported = time.monotonic()
        self.create_timer(HEARTBEAT_PERIOD, self._heartbeat, clock=steady)
        self.create_timer(PERIOD, self._check, clock=steady)

    def _on_description(self, message: String) -> None:
        """Store the URDF from the topic; use it with the next configuration."""
        self._description = message.data
        if self._values and self.guard is None:
            self._next = self._values

    def _on_loads(self, message: Float64MultiArray) -> None:
        """Use gravity and payload; read the parameters if their id is new."""
        if len(message.data) != LOADS_LENGTH:
            self._warn(LOADS, f'{len(message.data)} numbers; expected {LOADS_LENGTH}, from a node '
                       'of the same version')
            return
        configuration, self._loads = loads_from_numbers(np.array(message.data))
        if configuration != self._configuration:
            self._configuration = configuration
            self._source.request()
        elif self.guard is not None:
            self.guard.set_loads(self._loads)

    def _on_parameters(self, values: Mapping[str, Any]) -> None:
        self._next = values
        self._check()

    def _check(self) -> None:
        """Apply a waiting configuration, unless the guard commands; check the joint states."""
        self._source.poll()
        if self.guard is not None:
            self.guard.path.check_timeout()
        if self._next is not None and not (self.guard and self.guard.path.watch.holding):
            values, self._next = self._next, None
            try:
                self._configure(values)
            except Exception as error:
                kind = '' if isinstance(error, KaneError) else f'{type(error).__name__}: '
                self.reason = f'not configured: {kind}{error}'
                self.get_logger().error(self.reason)
                self.close()

    def _configure(self, values: Mapping[str, Any]) -> None:
        """Build the robot if it changed, and use the parameters."""
        before, self._values = self._values, values
        simulated = values[SIMULATED_TIME]
        if self.get_parameter(SIMULATED_TIME).value != simulated:
            self.set_parameters([Parameter(SIMULATED_TIME, value=simulated)])
        same = self.guard is not None and all(
            np.array_equal(before[name], values[name]) for name in (*FIXED, SIMULATED_TIME))
        if not same:
            self.close()
            self._build(values)
        if self.guard is not None:
            self.guard.path.update(values)
            if self._loads is not None:
                self.guard.set_loads(self._loads)

    def _build(self, values: Mapping[str, Any]) -> None:
        """Compile the robot and open the topics; `reason` says why not."""
        began, log = time.perf_counter(), self.get_logger()
        source: str | Path = values['robot_description'] or (
            resolve_path('urdf', values['urdf']) if values['urdf'] else self._description)
        self.reason = ('guard.enabled of the dynamics node is false; expected true'
                       if not values['guard.enabled'] else
                       'waiting for a URDF on topic robot_description' if not source else '')
        if self.reason:
            log.warning(self.reason)
            return
        model = load_model(source, values, lambda warning: None)  # the node logs them
        self.guard = ConfiguredGuard(self, self.target, model, values, self._warn, log.error)
        realtime.exclude_existing_objects()
        realtime.apply_realtime_settings(values, log.warning)
        log.info(f'{model.name}: watching {self.target}, kernels ready in '
                 f'{time.perf_counter() - began:.2f} s, verified to {self.guard.verified:.1e}')
        self.guard.send_heartbeat()

    def close(self) -> None:
        """Close the topics; command zeros first if the guard commands."""
        realtime.release()
        guard, self.guard = self.guard, None
        if guard is not None:
            guard.close()

    def _on_jump(self, jump: TimeJump) -> None:
        if self.guard is not None:
            self.guard.on_clock_jump()

    def _heartbeat(self) -> None:
        """Send a heartbeat, and the diagnostics when they are due."""
        if self.guard is not None:
            self.guard.send_heartbeat()
        now = time.monotonic()
        period = now - self._reported
        if period < 1.0 / self._values.get('diagnostics_rate', 1.0) - 0.5 * HEARTBEAT_PERIOD:
            return
        self._reported = now
        message = DiagnosticArray(status=[guard_status(self, period)])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)
        realtime.collect_if_disabled()
