"""The node `plant`: a simulated robot with topics and services."""

from collections import Counter
from collections.abc import Collection, Mapping
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from kane_dynamics.control.quasi_static import flexible_robot
from kane_dynamics.errors import InputError, KaneError
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.cdr import PreparedMessage, STAMP, write_joint_state
from kane_dynamics.ros.common.command_topic import (CommanderCount, several_commanders)
from kane_dynamics.ros.common.configuration_files import (load_model, resolve_path,
                                                          robot_options)
from kane_dynamics.ros.common.conversion import NANO, vector
from kane_dynamics.ros.common.node_statistics import status
from kane_dynamics.ros.common.qos import RELIABLE, WRENCHES
from kane_dynamics.ros.common.service_errors import answer_service_errors
from kane_dynamics.ros.common.throttle import ThrottledWarning
from kane_dynamics.ros.loads.wrench_input import wrench_array
from kane_dynamics.ros.parameters.live_parameters import LiveParameters
from kane_dynamics.ros.plant.plant_parameters import SPECS
from kane_dynamics.ros.plant.plant_state import PlantState
from kane_dynamics.ros.plant.tick_schedule import TickSchedule
from rclpy.clock import Clock as RosClock, ClockType
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger

IDLE = 0.05  # s between two polls while paused
PLAIN_CDR = bytes((0, 1, 0, 0))  # encapsulation of a serialized message
EPOCH = NANO  # start of simulated time, ns; a stamp of zero means no stamp


class PlantNode(Node):
    """
    The plant node.

    Raises
    ------
    KaneError
        A parameter or the URDF is invalid.

    """

    def __init__(self) -> None:
        super().__init__('plant_node')
        self._live = LiveParameters(
            self, SPECS, lambda: 'expected no change; restart the node',
            self._check, self._changed)
        values = self.values
        log = self.get_logger()
        self._warn = ThrottledWarning(log)
        self.rejected: Counter[str] = Counter()
        self.received = 0
        self.failure = self._imbalance = ''
        self.paused: bool = values['start_paused']
        robot = self._load()
        # The simulation, and the schedule of its ticks in wall time.
        self.plant = PlantState(robot, values, self._actuated)
        self.schedule = TickSchedule(self.plant.period / values['rate_factor'])
        self._set_up_messages()
        self._states = self.create_publisher(JointState, 'joint_states', RELIABLE)
        # Topics and services.
        self._clock_out = self.create_publisher(Clock, '/clock', RELIABLE) if (
            values['publish_clock']) else None
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics',
                                                  RELIABLE)
        self.create_subscription(Float64MultiArray, 'commands', self._on_command,
                                 RELIABLE)
        self._commanders = CommanderCount(self, 'commands')
        self.create_subscription(WrenchStamped, '~/wrench', self._on_wrench, WRENCHES)
        self.create_service(Trigger, '~/reset', self._on_reset)
        self.create_service(SetBool, '~/pause', self._on_pause)
        self.create_service(Trigger, '~/step', self._on_step)
        answer_service_errors(self)
        self._steady = RosClock(clock_type=ClockType.STEADY_TIME)
        self._timer: Any = None
        self._start_diagnostics()
        # One line says what is simulated.
        joints = self.plant.arm.joint_names
        modes = [robot.coordinate_names[k] for k in robot.model.modal_coordinates]
        drives = [elastic.name for elastic in robot.drives]
        log.info(f'{robot.model.name}: {len(joints)} joints ({", ".join(joints)}), '
                 + f'flexible modes {", ".join(modes)}, ' * bool(modes)
                 + f'drives of {", ".join(drives)}, ' * bool(drives)
                 + f'{values["rate"]:g} joint states/s' + ', paused' * self.paused)
        if self.plant.arm.integrator_choice:
            log.info(f'rate and substeps: {self.plant.arm.integrator_choice}')
        if (warning := self.plant.arm.step_warning()) is not None:
            log.warning(f'rate and substeps: {warning}')

    @property
    def values(self) -> dict[str, Any]:
        """Return the checked parameters by name."""
        return self._live.values

    def _load(self) -> Robot:
        """Return the robot that the parameters describe."""
        values = self.values
        # The text has precedence over the path, as in the dynamics node.
        source = values['robot_description'] or (
            values['urdf'] and resolve_path('urdf', values['urdf']))
        if not source:
            raise InputError("URDF: none; expected parameter 'robot_description' or "
                             "'urdf'")
        model = load_model(source, values, self.get_logger().warning)
        options = robot_options(values)
        self._actuated = options.get('actuated', ())
        return flexible_robot(model, options)

    def _set_up_messages(self) -> None:
        """Build the layout of the joint state; each tick writes only its numbers."""
        arm = self.plant.arm
        names = self.values['measured'] or arm.joint_names
        if unknown := [name for name in names if name not in arm.joint_names]:
            raise InputError(f"parameter 'measured': {', '.join(unknown)}; expected "
                             f'joints of {", ".join(arm.joint_names)}')
        # Measured joints may be fewer than those of the arm, in any order.
        self._measured = list(map(arm.joint_names.index, names))
        n = len(names)
        writer, offsets = write_joint_state(names, '', (n, n, n))
        self._message = PreparedMessage(writer, offsets[0], n)
        self._columns = [self._message.doubles(offset, n) for offset in offsets]

    def poll(self) -> float:
        """
        Execute the tick that is due, if any.

        Return the time until the next one, s.
        """
        if self.paused or self.failure:
            # For nodes that start while the plant is paused
            self._publish_time(self._now())
            return IDLE
        now = time.monotonic_ns()
        if now >= self.schedule.due:
            due = self.schedule.due
            self.schedule.tick(now)
            self._tick(time.time_ns() - (now - due))
        return max(self.schedule.due - time.monotonic_ns(), 0) / NANO

    def _now(self) -> int:
        """Return simulated time, ns."""
        return EPOCH + self.plant.time

    def _tick(self, system: int) -> None:
        """
        Advance by one period.

        `system` is the system time at which the tick was due, ns.
        """
        stamp = system if self._clock_out is None else self._now()
        self._publish_time(stamp)
        try:
            # Measurements may be late or lost, so that a tick publishes none or several.
            arrived = self.plant.tick(stamp)
        except KaneError as error:
            self.failure = str(error)
            self.get_logger().error(f'stopped until ~/reset: {error}')
            return
        for measurement in arrived:
            self._message.stamp(*divmod(measurement.stamp, NANO))
            for column, numbers in zip(self._columns, measurement[1:], strict=True):
                column[:] = numbers[self._measured]
            self._states.publish(self._message.serialized())

    def _publish_time(self, stamp: int) -> None:
        """Publish simulated time if publish_clock is true."""
        if self._clock_out is not None:
            self._clock_out.publish(PLAIN_CDR + STAMP.pack(*divmod(stamp, NANO)))

    def _on_command(self, message: Float64MultiArray) -> None:
        try:
            numbers = vector(message.data, None, self.plant.form.count, 'commands')
        except InputError as error:
            self._reject('commands', error)
            return
        self.received += 1
        self.plant.command(numbers)

    def _on_wrench(self, message: WrenchStamped) -> None:
        try:
            self.plant.apply_wrench(message.header.frame_id, wrench_array(message))
        except InputError as error:
            self._reject('wrench', error)

    def _reject(self, topic: str, error: KaneError) -> None:
        """Count a rejected message and warn."""
        self.rejected[topic] += 1
        self._warn(f'{topic} rejected', str(error))

    def _on_reset(self, request: Trigger.Request,
                  response: Trigger.Response) -> Trigger.Response:
        """Reset the arm to its initial state."""
        reset_clock = self.values['reset_clock'] and self._clock_out is not None
        if reset_clock:
            # Time restarts only where the plant is the clock.
            self.plant.reset_time()
        else:
            self.plant.reset()
        self.failure = ''
        self.schedule.start(time.monotonic_ns())
        self._reported = time.monotonic(), self.plant.ticks
        if reset_clock:
            self._publish_time(self._now())
        response.success = True
        response.message = 'at rest at ' + ', '.join(f'{q:g}' for q in self.plant.arm.q)
        return response

    def _on_pause(self, request: SetBool.Request,
                  response: SetBool.Response) -> SetBool.Response:
        """Pause or resume."""
        self.paused = request.data
        self.schedule.start(time.monotonic_ns())
        response.success = True
        response.message = 'paused' if self.paused else 'running'
        return response

    def _on_step(self, request: Trigger.Request,
                 response: Trigger.Response) -> Trigger.Response:
        """Advance by one tick while paused."""
        if not self.paused:
            response.message = 'plant: running; expected paused by ~/pause'
        else:
            self._tick(time.time_ns())
            response.success = not self.failure
            reached = f'{self.plant.time / NANO:g} s after the start'
            response.message = self.failure or reached
        return response

    def _check(self, values: Mapping[str, Any], given: Collection[str]) -> None:
        PlantState.check(self.plant.robot, values)

    def _changed(self, before: Mapping[str, Any], given: Collection[str]) -> None:
        """
        Apply checked parameters.

        Ticks run in the same thread and do not interleave.
        """
        values = self.values
        self.plant.update(values)
        if before['rate_factor'] != values['rate_factor']:
            self.schedule.start(time.monotonic_ns(), self.plant.period
                                / values['rate_factor'])
        if before['diagnostics_rate'] != values['diagnostics_rate']:
            self._start_diagnostics()

    def _start_diagnostics(self) -> None:
        if self._timer is not None:
            self.destroy_timer(self._timer)
        self._reported = time.monotonic(), self.plant.ticks
        self._timer = self.create_timer(1.0 / self.values['diagnostics_rate'],
                                        self._publish_diagnostics, clock=self._steady)

    def _publish_diagnostics(self) -> None:
        now = time.monotonic()
        then, ticks = self._reported
        self._reported = now, self.plant.ticks
        # The speed is that of the ticks since the last diagnostics.
        speed = (self.plant.ticks - ticks) * self.plant.period / NANO / (now - then)
        message = DiagnosticArray(status=[self._status(speed)])
        stamp = message.header.stamp
        stamp.sec, stamp.nanosec = divmod(
            time.time_ns() if self._clock_out is None else self._now(), NANO)
        self._diagnostics.publish(message)
        self.schedule.worst = 0
        if (warning := self.plant.arm.energy.warning) != self._imbalance:
            self._imbalance = warning
            if warning:
                self.get_logger().warning(warning)
        self._warn_of_others()

    def _warn_of_others(self) -> None:
        """Warn of further nodes that publish the time or command the arm."""
        clocks = 0
        if self._clock_out is not None:
            clocks = self.count_publishers('/clock')
        if clocks > 1:
            self._warn('clock', f'{clocks} publishers on /clock; expected one node with '
                       'publish_clock')
        if len(sources := self._commanders.update()) > 1:
            self._warn('commands', several_commanders(sources))

    def _status(self, speed: float) -> DiagnosticStatus:
        """Return the diagnostic status of a period at `speed` times real time."""
        plant = self.plant
        schedule = self.schedule
        level, message = self._state_in_words(speed)
        if not self.failure and schedule.worst > schedule.period:
            level = max(level, DiagnosticStatus.WARN)
            message += f', up to {schedule.worst * 1e-6:.1f} ms late'
        # A key for each figure that users look for first.
        figures = {
            'joints': ', '.join(plant.arm.joint_names),
            'speed': f'{speed:.3f}',
            'joint states': str(plant.ticks),
            'overruns': str(schedule.overruns),
            'largest delay of a tick': f'{schedule.worst * 1e-6:.3f} ms',
            'skipped to catch up': f'{schedule.skipped:.3f} s',
            'commands': str(self.received),
            'command timeouts': str(plant.timeouts),
            'steps clamped': str(plant.arm.clamped),
            'steps at stops': str(plant.arm.stop_contacts),
            'energy balance': plant.arm.energy.warning or 'closes',
            'at a stop': ', '.join(plant.arm.at_stops) or 'none',
            'sticking': ', '.join(plant.arm.stuck) or 'none',
            'in contact': ', '.join(plant.arm.touching) or 'none',
            'wrenches at': ', '.join(plant.arm.wrenches) or 'none',
            'joint states dropped': str(plant.states.dropped),
            'commands dropped': str(plant.commands.dropped)}
        for topic, count in self.rejected.items():
            figures[f'rejected: {topic}'] = str(count)
        return status(f'{self.get_fully_qualified_name()}: simulated robot',
                      plant.robot.model.name, level, message, figures)

    def _state_in_words(self, speed: float) -> tuple[bytes, str]:
        """Return level and message of the simulation, without delays of its ticks."""
        # The most severe state first.
        plant = self.plant
        running = f'running at {speed:.2f} times real time'
        if self.failure:
            return DiagnosticStatus.ERROR, f'stopped until ~/reset: {self.failure}'
        if self.paused:
            return DiagnosticStatus.OK, 'paused'
        if plant.braked:
            return DiagnosticStatus.OK, f'{running}, brakes on until the first command'
        if plant.timed_out:
            age = f'{plant.command_age:.2f} s'
            return DiagnosticStatus.WARN, f'{running}, no command for {age}'
        if plant.arm.energy.warning:
            return DiagnosticStatus.WARN, f'{running}; {plant.arm.energy.warning}'
        return DiagnosticStatus.OK, running
