"""The node torque_guard: follows the dynamics node's configuration, and guards it."""

from collections.abc import Mapping
from pathlib import Path
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from kane_dynamics.analysis.model_checks import listed
from kane_dynamics.control_cycle.arbitration import FIELDS, LOST
from kane_dynamics.errors import KaneError
from kane_dynamics.ros.common import realtime
from kane_dynamics.ros.common.configuration_files import (load_model, resolve_path,
                                                          robot_options)
from kane_dynamics.ros.common.node_statistics import status
from kane_dynamics.ros.common.qos import LATCHED, RELIABLE
from kane_dynamics.ros.common.service_errors import answer_service_errors
from kane_dynamics.ros.common.throttle import ThrottledWarning
from kane_dynamics.ros.guard.configured_guard import ConfiguredGuard
from kane_dynamics.ros.guard.guard_messages import (arm_digest, HEARTBEAT_PERIOD, LOADS,
                                                    loads_from_numbers, LOADS_LENGTH,
                                                    NodeLoads, STATE)
from kane_dynamics.ros.guard.node_parameters import (NodeParameters, SHARED,
                                                     SIMULATED_TIME)
from kane_dynamics.ros.guard.node_torques import NodeTorques
from kane_dynamics.ros.parameters.parameter_checks import FOREIGN
import numpy as np
from rclpy.clock import Clock, ClockType, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import Float64MultiArray, String

BACK = JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1),
                     on_clock_change=False)
FIXED = tuple(spec.name for spec in SHARED if not spec.live)
DIFFERENT = ('{model}: another arm than that of {target}, so this guard does not hold '
             'it; expected the same URDF, supplement and constraints for both processes')
ANOTHER = ('another torque_guard guards this arm, so this one commands nothing until '
           'that one ends; expected one guard for each arm')
PERIOD = 0.02  # s between two checks of the joint states and of the dynamics node
ALONE = 5.0  # s from the start without a node, after which no process holds the arm
REMINDER = 10.0  # s between two log lines that say why the guard does not guard


class GuardNode(Node):
    """
    The node `torque_guard`.

    It reads the parameters of the dynamics node whenever ~/loads of that node has a new
    id, and builds the same robot. While its torque acts, a new configuration waits. It
    refuses to guard an arm of other equations of motion, and one that another guard
    guards already.
    """

    def __init__(self) -> None:
        super().__init__('torque_guard')
        answer_service_errors(self)
        self.target = str(self.declare_parameter('node', 'kane_dynamics').value)
        self._warn_of_ignored_parameters()
        self._torques = NodeTorques(self, self.target)
        self.guard: ConfiguredGuard | None = None
        self.reason = (f'no message on {self.target}/{LOADS}; expected a configured '
                       'node with guard.enabled true')
        self.get_logger().info(f'not guarding yet: {self.reason}')
        self._warn = ThrottledWarning(self.get_logger())
        self._description = ''
        self._configuration = 0.0
        self._loads: NodeLoads | None = None
        self.refused = False  # whether this guard refuses to guard
        # The start, on a clock that is never set back; microseconds are exact in a
        # double.
        self._identity = float(time.monotonic_ns() // 1000)
        self._other_heard = -LOST  # time of the last message of another guard, s
        self._values: Mapping[str, Any] = {}
        self._next: Mapping[str, Any] | None = None  # parameters that wait
        self._source = NodeParameters(self, self.target, self._on_parameters)
        self._jumps = self.get_clock().create_jump_callback(BACK,
                                                            post_callback=self._on_jump)
        self.create_subscription(String, 'robot_description', self._on_description,
                                 LATCHED)
        self.create_subscription(Float64MultiArray, f'{self.target}/{LOADS}',
                                 self._on_loads, LATCHED)
        self.create_subscription(Float64MultiArray, f'{self.target}/{STATE}',
                                 self._on_guard_state, RELIABLE)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics',
                                                  RELIABLE)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._started = self._reported = self._reminded = time.monotonic()
        self.create_timer(HEARTBEAT_PERIOD, self._heartbeat, clock=steady)
        self.create_timer(PERIOD, self._check, clock=steady)

    def _warn_of_ignored_parameters(self) -> None:
        """Log parameters that the guard does not have."""
        overrides = getattr(self, '_parameter_overrides', {})
        ignored = [name for name in overrides
                   if name != 'node' and name.partition('.')[0] not in FOREIGN]
        if ignored:
            self.get_logger().warning(
                f'parameters {listed(ignored)}: ignored, since the guard reads them '
                'from '
                f"{self.target}; expected 'node' alone")

    def _on_description(self, message: String) -> None:
        """Store the URDF from the topic; use it with the next configuration."""
        self._description = message.data
        if self._values and self.guard is None:
            self._next = self._values

    def _on_loads(self, message: Float64MultiArray) -> None:
        """Use gravity and payload; read the parameters if their id is new."""
        if len(message.data) != LOADS_LENGTH:
            self._warn(LOADS,
                       f'{len(message.data)} numbers; expected {LOADS_LENGTH}, from a '
                       'node of the same version')
            return
        self._loads = loads_from_numbers(np.array(message.data))
        # An unknown number means that the node has new parameters.
        if self._loads.configuration != self._configuration:
            self._configuration = self._loads.configuration
            self._source.request()
        elif self.guard is not None:
            self.guard.set_loads(self._loads.loads)

    def _on_guard_state(self, message: Float64MultiArray) -> None:
        """Stop guarding if another guard is to guard the same arm."""
        if len(message.data) < FIELDS or message.data[FIELDS - 1] == self._identity:
            return  # of this guard
        # The older one goes on; one that was stopped, from whose torque the arm has moved
        # away, yields to any.
        watch = None if self.guard is None else self.guard.path.watch
        now = time.perf_counter()
        if watch is not None:
            watch.tick(now)
            if message.data[FIELDS - 1] > self._identity and not watch.listens(now):
                return
        self._other_heard = now
        if self.guard is not None:
            self._refuse(ANOTHER)
            self._next = self._next or self._values
            guard = self.guard
            self.guard = None
            guard.abandon()

    def _another_guards(self) -> bool:
        """Return whether another guard, which lives, guards the arm."""
        guards = time.perf_counter() - self._other_heard < LOST
        if guards and not self.refused:
            self._refuse(ANOTHER)
        return guards

    def _refuse(self, reason: str) -> None:
        """Report that this guard does not guard."""
        self.refused = True
        self.reason = reason
        self._reminded = time.monotonic()
        self.get_logger().error(reason)

    def _on_parameters(self, values: Mapping[str, Any]) -> None:
        self._next = values
        self._check()

    def _check(self) -> None:
        """
        Apply a waiting configuration, unless the guard commands.

        Check the joint states.
        """
        self._source.poll()
        if self.guard is not None:
            self.guard.path.check_timeout()
        # A guard that acts is not replaced, and a first one only appears if no other
        # guards the arm.
        holding = self.guard is not None and self.guard.path.watch.holding
        if self._next is not None and not holding and (self.guard or
                                                       not self._another_guards()):
            values = self._next
            self._next = None
            try:
                self._configure(values)
            except Exception as error:
                reason = str(error)
                if not isinstance(error, KaneError):
                    reason = f'{type(error).__name__}: {error}'
                self._refuse(f'not configured: {reason}')
                self.close()

    def _configure(self, values: Mapping[str, Any]) -> None:
        """Build the robot if it changed, and use the parameters."""
        previous = self._values
        self._values = values
        simulated = values[SIMULATED_TIME]
        if self.get_parameter(SIMULATED_TIME).value != simulated:
            self.set_parameters([Parameter(SIMULATED_TIME, value=simulated)])
        digest = None if self._loads is None else self._loads.digest
        same_arm = self.guard is not None and self.guard.digest == digest
        # Parameters that are not live need a new robot.
        if not same_arm or not all(np.array_equal(previous[name], values[name])
                                   for name in (*FIXED, SIMULATED_TIME)):
            self.close()
            self._build(values)
        if self.guard is not None:
            self.guard.path.update(values)
            if self._loads is not None:
                self.guard.set_loads(self._loads.loads)

    def _build(self, values: Mapping[str, Any]) -> None:
        """Compile the robot and open the topics; `reason` says why not."""
        began = time.perf_counter()
        log = self.get_logger()
        source: str | Path = values['robot_description'] or (
            resolve_path('urdf', values['urdf']) if values['urdf']
            else self._description)
        self.refused = False
        self.reason = ('guard.enabled of the dynamics node is false; expected true'
                       if not values['guard.enabled'] else
                       'waiting for a URDF on topic robot_description' if not source
                       else '')
        if self.reason:
            log.warning(self.reason)
            return
        # The node says which arm it moves: another one must not be guarded with this
        # model.
        model = load_model(source, values, lambda warning: None)  # the node logs them
        digest = arm_digest(model, robot_options(values).get('constraints'))
        if self._loads is not None and digest != self._loads.digest:
            self._refuse(DIFFERENT.format(model=model.name, target=self.target))
            return
        self.guard = ConfiguredGuard(self, self._torques, model, values, self._warn,
                                     self._report, self._identity)
        realtime.exclude_existing_objects()
        realtime.apply_realtime_settings(values, log.warning)
        log.info(f'{model.name}: watching {self.target}, kernels ready in '
                 f'{time.perf_counter() - began:.2f} s, verified to '
                 f'{self.guard.verified:.1e}')
        self.guard.send_heartbeat()

    def _report(self, level: str, text: str) -> None:
        """Log a change between watching and commanding, as 'error' or 'info'."""
        # A line of code that logs keeps its first severity: rclpy raises for another one.
        log = self.get_logger()
        if level == 'error':
            log.error(text)
        else:
            log.info(text)

    def close(self) -> None:
        """Close the topics; command zeros first if the guard commands."""
        realtime.release()
        guard = self.guard
        self.guard = None
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
        if self.guard is None and now - self._reminded > REMINDER:
            self._reminded = now
            self.get_logger().warning(f'not guarding: {self.reason}')
        # Heartbeats are more frequent than diagnostics.
        period = now - self._reported
        if period < 1.0 / self._values.get('diagnostics_rate',
                                           1.0) - 0.5 * HEARTBEAT_PERIOD:
            return
        self._reported = now
        message = DiagnosticArray(status=[self._status(period)])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)

    def _is_arm_left_alone(self) -> bool:
        """Return whether an arm is there, and no node since this guard started."""
        return bool(self._loads is None and time.monotonic() - self._started > ALONE
                    and self.count_publishers('joint_states')
                    and self.count_subscribers('commands'))

    def _status(self, period: float) -> DiagnosticStatus:
        """Close a reporting period, s, and return the diagnostic status."""
        name = f'{self.get_fully_qualified_name()}: guard'
        guard = self.guard
        if guard is None:
            level = DiagnosticStatus.WARN
            message = self.reason
            if self.refused:
                level = DiagnosticStatus.ERROR
            elif self._is_arm_left_alone():
                level = DiagnosticStatus.ERROR
                message += '; joint states are published, and no process holds the arm'
            return status(name, '', level, message, {})
        # Silent, or watching without torque, or watching.
        watch = guard.path.watch
        level = DiagnosticStatus.OK
        message = f'watching {self.target}'
        # The more severe state decides the level.
        if watch.acting:
            level = DiagnosticStatus.ERROR
            silent = time.perf_counter() - watch.waiting_since
            action = 'the guard holds the arm; restart the node and activate it'
            if guard.path.timed_out:
                action = 'no joint states, commanding zeros; check the driver'
            message = f'{self.target} is silent for {silent:.1f} s: {action}'
        elif not watch.armed:
            message += ', which commands no torque'
        _, _, figures = guard.statistics.period(period)
        figures |= {'takeovers': str(watch.takeovers),
                    'node alive': str(guard.node_alive),
                    'last silence before a takeover': f'{watch.silent_for * 1e3:.1f} ms',
                    'kernels verified to': f'{guard.verified:.1e}'}
        return status(name, guard.robot.model.name, level, message, figures)
