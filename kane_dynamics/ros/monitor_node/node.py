"""The node that estimates the payload and watches over the model, beside the torques."""

from collections import Counter
from pathlib import Path
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from kane_dynamics.errors import InputError, KaneError
from kane_dynamics.ros.common.configuration_files import (load_model, resolve_path,
                                                          robot_options)
from kane_dynamics.ros.common.node_statistics import status
from kane_dynamics.ros.common.qos import BEST_EFFORT, LATCHED, RECORDED_STATES, RELIABLE
from kane_dynamics.ros.common.throttle import ThrottledWarning
from kane_dynamics.ros.guard.guard_messages import (arm_digest, LOADS, loads_from_numbers,
                                                    LOADS_LENGTH)
from kane_dynamics.ros.loads.gravity_payload import GravityAndPayload, parameter_loads
from kane_dynamics.ros.loads.wrench_input import check_frames
from kane_dynamics.ros.monitor_node.model_watch_monitor import ModelWatchMonitor
from kane_dynamics.ros.monitor_node.monitor_parameters import ALL, SPECS
from kane_dynamics.ros.monitor_node.payload_monitor import PayloadMonitor
from kane_dynamics.ros.monitor_node.torque_samples import TorqueSample, TorqueSamples
from kane_dynamics.ros.parameters.arm_statement import examine_statement
from kane_dynamics.ros.parameters.parameter_checks import (declare, read,
                                                           unknown_parameters,
                                                           with_prefix)
from kane_dynamics.ros.parameters.parameter_table import BY_NAME
from kane_dynamics_interfaces.msg import PayloadEstimate
import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String


class MonitorNode(Node):
    """
    The node `monitor_node`: listens to an arm, or to a bag that is played back.

    It estimates the payload if payload.frame is set, and compares the arm with its model
    if watch.reference is set. It commands nothing.

    Raises
    ------
    KaneError
        A parameter is invalid, or does not fit the robot.

    """

    def __init__(self) -> None:
        super().__init__('monitor_node')
        log = self.get_logger()
        defaults = {name: read(spec, spec.default) for name, spec in BY_NAME.items()}
        self.values = with_prefix(defaults | declare(self, ALL))
        known = {*BY_NAME, *(spec.name for spec in SPECS)}
        for warning in unknown_parameters(list(self._parameter_overrides), known):
            log.warning(warning)
        values = self.values
        if not values['payload.frame'] and not values['watch.reference']:
            raise InputError('parameters: neither payload.frame nor watch.reference; '
                             'expected one of them, which says what to look for')
        self._warn = ThrottledWarning(log)
        self._rejected: Counter[str] = Counter()
        self._samples: TorqueSamples | None = None
        self._payload: PayloadMonitor | None = None
        self._watch: ModelWatchMonitor | None = None
        self._count = 0  # samples since the last diagnostics
        self._reported = time.monotonic()
        self._estimates = self.create_publisher(PayloadEstimate, '~/payload_estimate',
                                                RELIABLE)
        self._reports = self.create_publisher(DiagnosticArray, '~/model_watch', LATCHED)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', RELIABLE)
        # In steady time: a simulated clock that stands must not stop the diagnostics.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1.0 / values['estimator.rate'], self._publish_estimate,
                          clock=steady)
        self.create_timer(1.0 / values['diagnostics_rate'], self._publish_diagnostics,
                          clock=steady)
        if values['robot_description']:
            self._build(values['robot_description'])
        elif values['urdf']:
            self._build(resolve_path('urdf', values['urdf']))
        else:
            log.info('waiting for a URDF on topic robot_description')
            self.create_subscription(String, 'robot_description', self._on_description,
                                     LATCHED)

    def _on_description(self, message: String) -> None:
        """Build the robot from the first URDF of the topic."""
        if self._samples is not None:
            return
        try:
            self._build(message.data)
        except KaneError as error:
            self.get_logger().error(f'robot_description: {error}')

    def _build(self, source: str | Path) -> None:
        """Load and compile the robot, and subscribe to the messages of the arm."""
        values = self.values
        log = self.get_logger()
        model = load_model(source, values, log.warning)
        # The efforts are always used here.
        for contradiction in examine_statement(values | {'observer.enabled': True}, model):
            log.warning(contradiction)
        check_frames(model, values['wrench.frames'])
        samples = TorqueSamples(model, values, self._now, self._reject)
        robot = samples.robot
        self._digest = arm_digest(model, robot_options(values).get('constraints'))
        watched_for = []
        if values['payload.frame']:
            check_frames(robot.model, [values['payload.frame']], 'payload.frame')
            self._payload = PayloadMonitor(robot, values, self._reject)
            watched_for.append('payload')
        if values['watch.reference']:
            if samples.bending is not None:
                raise InputError("parameter 'watch.reference': for an arm with beams; "
                                 'expected rigid links, whose torque is linear in their '
                                 'parameters')
            self._watch = ModelWatchMonitor(robot, values, self._reports.publish, log,
                                            self._reject)
            watched_for.append('changes of the model')
        self._samples = samples
        self._use_loads(parameter_loads(robot.model, values))
        target = values['node']
        self.create_subscription(JointState, 'joint_states', self._on_state,
                                 RECORDED_STATES, raw=True)
        self.create_subscription(JointState, f'{target}/joint_torques', self._on_torques,
                                 RECORDED_STATES)
        self.create_subscription(Float64MultiArray, f'{target}/{LOADS}', self._on_loads,
                                 LATCHED)
        if values['wrench.frames']:
            self.create_subscription(WrenchStamped, f'{target}/wrench',
                                     samples.wrenches.on_message, BEST_EFFORT, raw=True)
        log.info(f'{model.name}: listening for {" and ".join(watched_for)}')

    def _now(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _reject(self, reason: str, detail: str) -> None:
        """Count what cannot be used, and warn."""
        self._rejected[reason] += 1
        self._warn(reason, detail)

    def _on_state(self, data: bytes) -> None:
        assert self._samples is not None
        self._use(self._samples.of_state(data))

    def _on_torques(self, message: JointState) -> None:
        assert self._samples is not None
        self._use(self._samples.of_torques(message))

    def _use(self, sample: TorqueSample | None) -> None:
        """Add a sample to what is estimated."""
        if sample is None:
            return
        self._count += 1
        for monitor in (self._payload, self._watch):
            if monitor is not None:
                monitor.add(sample)

    def _on_loads(self, message: Float64MultiArray) -> None:
        """Use gravity and payload of the dynamics node, if it moves this arm."""
        if len(message.data) != LOADS_LENGTH:
            self._reject(LOADS, f'{len(message.data)} numbers; expected {LOADS_LENGTH}, '
                         'from a node of the same version')
            return
        stated = loads_from_numbers(np.array(message.data))
        if stated.digest != self._digest:
            self._reject(LOADS, f"of another arm than that of '{self.values['node']}'; "
                         'expected the same URDF, supplement and parameters of the arm')
            return
        self._use_loads(stated.loads)

    def _use_loads(self, loads: GravityAndPayload) -> None:
        """Set gravity and payload of the robots from the next sample on."""
        assert self._samples is not None
        loads.apply(self._samples.robot)
        if self._samples.bending is not None:
            loads.apply(self._samples.bending.robot)
        for monitor in (self._payload, self._watch):
            if monitor is not None:
                monitor.on_loads_changed()

    def _publish_estimate(self) -> None:
        message = None if self._payload is None else self._payload.message()
        if message is not None:
            self._estimates.publish(message)

    def _publish_diagnostics(self) -> None:
        """Publish the status of the reporting period that ends now."""
        now = time.monotonic()
        figures = {'samples': f'{self._count / (now - self._reported):.1f} 1/s'}
        self._reported = now
        for reason, count in self._rejected.items():
            figures[f'rejected: {reason}'] = str(count)
        level = DiagnosticStatus.OK
        message = 'listening'
        if self._samples is None:
            level = DiagnosticStatus.WARN
            message = 'waiting for a URDF on topic robot_description'
        elif not self._count:
            level = DiagnosticStatus.WARN
            message = 'no state with a known torque; check the topics and observer.torque'
        if self._watch is not None:
            figures |= self._watch.figures()
            if self._watch.alarm is not None:
                level = DiagnosticStatus.WARN
                message = (f'model watch: {self._watch.alarm}: identify the arm again, or '
                           'check it')
        self._count = 0
        name = '' if self._samples is None else self._samples.robot.model.name
        array = DiagnosticArray(status=[status(
            f'{self.get_fully_qualified_name()}: monitor', name, level, message, figures)])
        array.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(array)
