"""The lifecycle node: loads the URDF, compiles the robot, and runs the torque path."""

from collections.abc import Callable, Collection, Mapping
from functools import partial
from pathlib import Path
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from kane_dynamics.analysis.known_arms import words
from kane_dynamics.control.terms import Mode
from kane_dynamics.errors import InputError, KaneError
from kane_dynamics.model.plausible_sizes import upward_gravity
from kane_dynamics.native.machine_code.compiling import reported_to
from kane_dynamics.ros.common import realtime
from kane_dynamics.ros.common.configuration_files import (load_model, locked_joints,
                                                          resolve_path)
from kane_dynamics.ros.common.node_statistics import Statistics, status
from kane_dynamics.ros.common.qos import LATCHED, RELIABLE
from kane_dynamics.ros.common.service_errors import answer_service_errors, reported
from kane_dynamics.ros.common.throttle import ThrottledWarning
from kane_dynamics.ros.dynamics_node.configured_robot import (ACKNOWLEDGE_TIMEOUT,
                                                              ConfiguredRobot)
from kane_dynamics.ros.dynamics_node.manager_bond import ManagerBond
from kane_dynamics.ros.dynamics_node.node_diagnostics import (active_status, arm_figures, ERROR,
                                                              GraphLog, OK,
                                                              state_in_words, WARN)
from kane_dynamics.ros.dynamics_node.sim_time_watchdog import LOST_CLOCK, SimTimeWatchdog
from kane_dynamics.ros.inputs.trajectory_input import follow_trajectory
from kane_dynamics.ros.joint_trajectory_action.action_server import (
    JointTrajectoryAction)
from kane_dynamics.ros.parameters.arm_statement import examine_statement, payload_remark
from kane_dynamics.ros.parameters.command_form import EFFORT
from kane_dynamics.ros.parameters.live_parameters import LiveParameters
from kane_dynamics.ros.parameters.parameter_table import SPECS
from kane_dynamics.ros.services.motion_check import refuse_impossible
from kane_dynamics.ros.services.served_robot import ServedRobot
from kane_dynamics.ros.services.services import Services
from kane_dynamics.ros.torque_path.torque_path import TorquePath
from kane_dynamics_interfaces.srv import SetPayload
from rclpy.clock import Clock, ClockType, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from std_msgs.msg import String

BACK = JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1),
                     on_clock_change=False)
FEEDFORWARD = ('mode inverse_dynamics: feedforward without feedback; computed_torque, '
               'joint_impedance and cartesian_impedance have feedback')
LEAST_WITHOUT_ARM = 0.9  # s between two reports of a node that is not configured
# Scripts search the log for the word of the state, which this line must not have.
CONFIGURED = ('configured; commands begin with the transition `activate`, as by '
              '`ros2 lifecycle set {name} activate`; check the arm before')
STABILITY_PERIOD = 0.1  # s between two looks at the rate of the states
SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class DynamicsNode(LifecycleNode):
    """
    The lifecycle node `kane_dynamics`.

    Attributes
    ----------
    arm : ConfiguredRobot or None
        The robot, from configure to cleanup.
    server : Services
        Services and topics of requests.
    statistics : Statistics
        Counters since the node was configured.

    Raises
    ------
    InputError
        An initial parameter is invalid.

    """

    def __init__(self) -> None:
        super().__init__('kane_dynamics')
        answer_service_errors(self)
        self._live = LiveParameters(self, SPECS, self._frozen, self._check_parameters,
                                    self._apply_parameters)
        self.statistics = Statistics()
        self.arm: ConfiguredRobot | None = None
        self._bond: ManagerBond | None = None  # with a lifecycle manager
        self._description = ''  # URDF from the topic
        self._was_configured = False  # autostart configures the node once
        self._configure_fault = ''
        self._warn = ThrottledWarning(self.get_logger())
        self._graph_log = GraphLog(self.get_logger())
        self._simulated_time = bool(self.get_clock().ros_time_is_active)
        self._jumps = self.get_clock().create_jump_callback(
            BACK, post_callback=self._on_jump)  # active while referenced
        self._sim_time = SimTimeWatchdog(self)
        self.create_subscription(String, 'robot_description', self._on_description,
                                 LATCHED)
        self.server = Services(
            self, self._on_trajectory, self._on_payload,
            lambda reason: self._reject_trajectory('trajectory', reason))
        self.trajectory_action: JointTrajectoryAction | None = None
        try:
            self.trajectory_action = JointTrajectoryAction(
                self, self.server, self._accepting,
                lambda reason: self._reject_trajectory('follow_joint_trajectory', reason))
        except InputError as error:
            self.get_logger().info(str(error))
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(STABILITY_PERIOD, self._leave_unstable_mode, clock=self._steady)
        self._reported_at = time.monotonic()
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics',
                                                  RELIABLE)
        self._timers_of_parameters: list[Any] = []
        self._start_timers()

    @property
    def values(self) -> dict[str, Any]:
        """Return the checked parameters by name."""
        return self._live.values

    @property
    def state(self) -> str:
        """Return the label of the lifecycle state."""
        return str(self._state_machine.current_state[1])

    # Start: the URDF becomes known, autostart configures.

    def autostart(self) -> None:
        """Configure once, if autostart is true and the URDF is known, and activate."""
        if not self._may_autostart:
            return
        if not self._has_urdf:
            self.get_logger().info(self.waiting_for)
            return
        if self.trigger_configure() != SUCCESS or self._activation_fault():
            return
        if self.values['activation'] == 'at_once':
            self.trigger_activate()
        else:
            self.get_logger().info(CONFIGURED.format(name=self.get_fully_qualified_name()))

    @property
    def _may_autostart(self) -> bool:
        """Return whether autostart is still to configure the node."""
        return (self.values['autostart'] and not self._was_configured
                and self.state == 'unconfigured')

    @property
    def _is_simulated(self) -> bool:
        """Return whether the arm is simulated, which needs no guard, by the parameters."""
        return self._simulated_time or bool(self.values['activation'] == 'at_once')

    @property
    def _has_urdf(self) -> bool:
        return bool(self.values['robot_description'] or self.values['urdf']
                    or self._description)

    @property
    def waiting_for(self) -> str:
        """Return the reason for which a node with autostart waits; empty if it does not wait."""
        if not self._may_autostart:
            return ''
        if self._has_urdf:
            return self._configure_fault and f'not configured: {self._configure_fault}'
        topic = self.resolve_topic_name('robot_description')
        publishers = self.count_publishers(topic)
        topic_state = 'no publisher'
        if publishers:
            topic_state = (f'{publishers} publishers, but no message; expected '
                           'durability transient local')
        return (f'waiting for a URDF on topic robot_description ({topic}: '
                f'{topic_state}), because the parameters urdf and robot_description are '
                'empty')

    def _leave_unstable_mode(self) -> None:
        """End feedback that turns out to be unstable: states come late, or more seldom."""
        if self.arm is not None and (reason := self.arm.leave_unstable_mode()):
            self.get_logger().error(reason)
            self.set_parameters([Parameter('mode', value=str(Mode.GRAVITY_COMPENSATION))])

    def _urdf(self) -> str | Path:
        """Return the URDF as text or path; empty if it is unknown."""
        if self.values['robot_description'] or not self.values['urdf']:
            return str(self.values['robot_description'] or self._description)
        return resolve_path('urdf', self.values['urdf'])

    def _on_description(self, message: String) -> None:
        """Store the URDF from the topic, unless a parameter gives it."""
        # A parameter has precedence over the topic.
        if self.values['robot_description'] or self.values['urdf']:
            return
        if message.data == self._description:
            return
        self._description = message.data
        # An active node keeps its robot; an inactive one is configured by hand; others
        # at once.
        if self.state == 'active':
            self.statistics.rejected['robot_description'] += 1
            self.get_logger().error('robot_description: changed while the node is '
                                    'active and ignored; deactivate, clean up and '
                                    'configure the node to use it')
        elif self.state == 'inactive':
            self.get_logger().warning('robot_description: changed; clean up and '
                                      'configure the node to use it')
        else:
            self.autostart()

    # Transitions of the lifecycle.

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Load the URDF, compile and verify the kernels, and open the topics."""
        try:
            self._configure()
        except Exception as error:
            # Errors of the library explain themselves; of others the kind helps.
            kind = '' if isinstance(error, KaneError) else f'{type(error).__name__}: '
            self._configure_fault = f'{kind}{error}'
            self.get_logger().error(f'not configured: {self._configure_fault}')
            self._release()
            return FAILURE
        self._was_configured = True
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start the torque path."""
        assert self.arm is not None
        if fault := self._activation_fault() or self.arm.instability_at_start():
            self.get_logger().error(f'not activated: {fault}')
            return FAILURE
        result = super().on_activate(state)
        # The torque path first: states may arrive from here on.
        self.arm.left_mode = ''
        try:
            self.arm.path.start()
        except Exception as error:  # rclpy would go to `on_error` without a word
            self.get_logger().error(f'not activated: {type(error).__name__}: {error}')
            raise
        if self._bond is not None:
            self._bond.form()
        self.get_logger().info(f'active, mode {self.values["mode"]}')
        if (self.values['mode'] == Mode.INVERSE_DYNAMICS
                and self.values['commands.form'] == EFFORT):
            self.get_logger().info(FEEDFORWARD)
        if self.arm.guard is None and not self._is_simulated:
            self.get_logger().warning(
                'active without torque_guard: if this process died, the last torque '
                'would stay; expected guard.enabled: true and a torque_guard, as the '
                'launch file starts them')
        return result

    def _activation_fault(self) -> str:
        """Return why this arm cannot be commanded; empty if it can."""
        assert self.arm is not None
        return self.arm.fault

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Command zeros, then deactivate the publishers."""
        self.halt()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release the robot."""
        self._release()
        return SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Command zeros and release the robot."""
        self.halt()
        self._release()
        return SUCCESS

    on_error = on_shutdown  # the node is then unconfigured

    def halt(self) -> None:
        """Command zeros and wait, with a timeout, until subscribers acknowledge them."""
        if self._bond is not None:
            self._bond.end()
        if self.arm is not None and not self.arm.halt():
            self.get_logger().error('commands: zeros not acknowledged by a subscriber '
                                    f'within {ACKNOWLEDGE_TIMEOUT} s')

    def on_failure(self, reason: str) -> None:
        """
        React to a failed callback of the main thread as `state_check.action` says.

        `zero` deactivates the node. With `hold` the arm comes to rest and is held: by the
        torque path, or where it has failed itself, by torque_guard.
        """
        if self.state != 'active' or self.arm is None:
            return
        holds = False
        if self.values['state_check.action'] == 'hold':
            try:
                holds = self.arm.hold_after(reason)
            except Exception as error:
                self.get_logger().fatal(f'no stop: {type(error).__name__}: {error}')
        if not holds:
            self.trigger_deactivate()
            # The diagnostics state the reason until the next activation.
            self.arm.path.ended = f'{reason}; deactivated'

    def stop_compiling(self) -> None:
        """End requests that wait for kernels, and the compiler after the present one."""
        if self.arm is not None:
            self.arm.later_kernels.close()

    def end_requests(self) -> None:
        """End the goals and the requests of a node that has halted."""
        if self.trajectory_action is not None:
            self.trajectory_action.close()
        self.server.stop()

    # What the transitions do.

    def _configure(self) -> None:
        """Load, compile and verify the robot, and apply the real-time settings."""
        began = time.perf_counter()
        source = self._urdf()
        if not source:
            raise InputError("URDF: none; expected parameter 'robot_description' or "
                             "'urdf', or a "
                             'message on topic robot_description')
        log = self.get_logger()
        model = load_model(source, self.values, log.warning)
        contradictions = examine_statement(self.values, model)
        self._warn_of_gravity()
        self.statistics = Statistics()
        with reported_to(log.info):
            self.arm = ConfiguredRobot(self, self.server, model, self.values,
                                       self.statistics, self._warn)
        if self.values['joints'] or self.values['base'] or self.values['tip']:
            locked = locked_joints(source, self.values['prefix'], model)
            self.arm.path.require_locked(locked)
        if self.values['bond']:
            self._open_bond()
        realtime.exclude_existing_objects()
        realtime.apply_realtime_settings(self.values, log.warning)
        joints = self.arm.robot.joint_names
        if model.flexible:
            modes = ', '.join(model.coordinate_names[k] for k in model.modal_coordinates)
            log.info('commands, filled trajectories, ~/inverse_dynamics, observer and '
                     f'payload estimate include the quasi-static deflection {modes}; '
                     'other services treat flexible links as rigid')
        log.info(f'{model.name}: {len(joints)} joints ({", ".join(joints)}), kernels '
                 f'of commands ready in {time.perf_counter() - began:.2f} s, verified to '
                 f'{self.arm.verified:.1e}')
        log.info(f'torque path: {self.arm.torque_path}')
        added = words(self.values['arm_compensates'])
        log.info(f'the arm adds {added} to commanded efforts itself')
        for contradiction in contradictions:
            if self._is_simulated:
                log.info(contradiction)
            else:
                log.warning(contradiction)
        if fault := self._activation_fault():
            log.info(f'the node remains inactive: {fault}')
        # Last, since commands come first.
        self.arm.later_kernels.start()

    def _warn_of_gravity(self) -> None:
        """Log a warning if the stated gravity points upwards."""
        upward = upward_gravity(self.values['gravity'])
        # An IMU measures the direction.
        if upward and not self.values['imu.topic']:
            self.get_logger().warning(f"parameter 'gravity': {upward}")

    def _open_bond(self) -> None:
        """Prepare the bond with a lifecycle manager; warn where its package is missing."""
        try:
            self._bond = ManagerBond(self)
        except InputError as error:
            self.get_logger().warning(str(error))

    def _release(self) -> None:
        """Release the robot and close its topics."""
        realtime.release()
        if self._bond is not None:
            self._bond.close()
        self._bond = None
        arm = self.arm
        self.arm = None
        if arm is not None:
            arm.close()

    # Messages and requests.

    def _accepting(self) -> tuple[TorquePath, ServedRobot]:
        """Return as `_running`; InputError also while a collision stops the arm."""
        running = self._running()
        assert self.arm is not None
        joint = self.arm.optional_topics.collision
        if joint is not None and self.values['observer.action'] == 'stop':
            raise InputError(f"collision at joint '{joint}'; expected none while "
                             'observer.action is stop')
        return running

    def _running(self) -> tuple[TorquePath, ServedRobot]:
        """Return the torque path and the robot of requests; InputError if not active."""
        arm = self.arm
        served = self.server.served
        if arm is None or served is None or not arm.path.running:
            state = self.state
            if arm is not None and arm.path.ended:
                state = arm.path.ended
            raise InputError(f'node: {state}; expected active')
        return arm.path, served

    def _on_trajectory(self, data: bytes, received: int) -> None:
        """Schedule a new desired motion."""
        # Trajectories are refused before the torque path hears of them.
        try:
            path, served = self._accepting()
            served.apply_loads()
            warning = follow_trajectory(path, data, received, self.values,
                                        partial(refuse_impossible, served))
            if warning:
                self.get_logger().warning(f'joint_trajectory: {warning}')
        except KaneError as error:
            self._reject_trajectory('joint_trajectory', str(error))

    def _reject_trajectory(self, topic: str, reason: str) -> None:
        """Count a rejected trajectory and log the reason."""
        self.statistics.rejected[topic] += 1
        self.get_logger().error(f'{topic} rejected: {reason}')

    def _on_payload(self, request: SetPayload.Request) -> str:
        """Set the payload; return the remark on it."""
        if self.arm is None:
            raise InputError('node: not configured; expected a configured node')
        self.arm.set_payload(request)
        self.get_logger().info(f'payload: {request.payload.m:g} kg')
        return payload_remark(self.values)

    # Parameters and clock.

    def _frozen(self) -> str:
        """Return why only live parameters may change now; empty if all may."""
        return '' if self.state == 'unconfigured' else (
            f'expected no change while the node is {self.state}; deactivate it and '
            'clean up first')

    def _check_parameters(self, values: Mapping[str, Any],
                          changed: Collection[str]) -> None:
        """Raise KaneError unless new parameters fit the robot."""
        if self.arm is not None:
            self.arm.check(values, changed)

    def _apply_parameters(self, previous: Mapping[str, Any],
                          changed: Collection[str]) -> None:
        """
        Apply checked parameters.

        Cycles run in the same thread and do not interleave.
        """
        simulated_time = bool(self.get_clock().ros_time_is_active)
        clock_replaced = simulated_time != self._simulated_time
        self._simulated_time = simulated_time
        # The watchdog's period follows from the timeout, on the clock that the states
        # have.
        periods_changed = any(previous[name] != self.values[name]
                              for name in ('diagnostics_rate', 'state_timeout'))
        if clock_replaced or periods_changed:
            self._start_timers()
        if self.arm is not None:
            self.arm.update(self.values, changed)
            if 'gravity' in changed:
                self._warn_of_gravity()

    def _on_jump(self, jump: TimeJump) -> None:
        """Handle a backward jump of the clock."""
        if self.arm is not None:
            self.arm.on_clock_jump()

    # Timers: watchdogs and diagnostics.

    def _start_timers(self) -> None:
        """
        Start the timers, or restart them after a change of clock or parameters.

        The watchdog of joint states uses the node's clock if time is simulated, because
        no state becomes stale while simulated time is paused; a second watchdog then
        monitors the clock. Otherwise it uses steady time, like diagnostics.
        """
        for timer in self._timers_of_parameters:
            self.destroy_timer(timer)
        self._timers_of_parameters = []
        # Several looks within the timeout; a simulated clock that stands stops the
        # watchdog, which another timer reports.
        watchdog_period = max(0.2 * self.values['state_timeout'], 1e-3)
        watchdog_clock = self.get_clock() if self._simulated_time else self._steady
        self._start_timer(watchdog_period, self._check_timeout, watchdog_clock)
        self._start_timer(1.0 / self.values['diagnostics_rate'],
                          reported(self._publish_diagnostics, self.get_logger()),
                          self._steady)
        if self._simulated_time:
            self._start_timer(LOST_CLOCK / 4.0, self._check_sim_time, self._steady)

    def _start_timer(self, period: float, callback: Callable[[], None],
                     clock: Clock) -> None:
        """Start a timer that a change of parameters restarts."""
        timer = self.create_timer(period, callback, clock=clock)
        self._timers_of_parameters.append(timer)

    def _check_timeout(self) -> None:
        if self.arm is not None:
            self.arm.path.check_timeout()
            self.arm.path.raise_failure()

    def _check_sim_time(self) -> None:
        self._sim_time.check(None if self.arm is None else self.arm.path)

    def _publish_diagnostics(self) -> None:
        """Close a reporting period."""
        now = time.monotonic()
        period = now - self._reported_at
        if self.arm is None and period < LEAST_WITHOUT_ARM:
            return  # kernels may be compiled now, with which the reports would compete
        self._reported_at = now
        self._sim_time.report()
        if self.arm is not None:
            self.arm.count_publishers()
        message = DiagnosticArray(status=[self._status(period)])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)
        self._graph_log.update(self.state, self.waiting_for, self.arm)

    def _status(self, period: float) -> DiagnosticStatus:
        """Return the diagnostic status of a reporting period, s."""
        arm = self.arm
        state = self.state
        waiting_for = self.waiting_for
        rate, dropped, figures = self.statistics.period(period)
        lost_share = 0.0
        figures['states lost'] = '0'
        if arm is not None:
            lost_share, figures['states lost'] = arm.lost_states.period(
                arm.all_state_publishers)
        # From the most to the least that the node has: a torque path, its end, a wait,
        # a state.
        if arm is not None and arm.path.running:
            level, message = active_status(arm, rate, dropped, lost_share)
        elif arm is not None and arm.path.ended:
            level = ERROR
            message = arm.path.ended
        elif waiting_for:
            level = WARN
            message = f'{state}: {waiting_for}'
        elif state == 'inactive':
            level = OK
            message = state_in_words(state)
        else:
            level = WARN
            message = state_in_words(state)
        if self._sim_time.warning:
            level = max(level, WARN)
            message += f'; {self._sim_time.warning}'
        figures['state'] = state
        hardware = ''
        if arm is not None:
            figures |= arm_figures(arm, str(self.values['mode']))
            hardware = arm.robot.model.name
        return status(f'{self.get_fully_qualified_name()}: torques', hardware, level,
                      message, figures)
