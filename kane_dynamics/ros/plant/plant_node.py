"""The node `plant`: a simulated robot behind topics and services."""

from collections import Counter
from collections.abc import Collection, Mapping
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from kane_dynamics.errors import InputError, KaneError
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.configuration_files import load, located
from kane_dynamics.ros.common.conversion import NANO, vector
from kane_dynamics.ros.common.service_errors import guard_services
from kane_dynamics.ros.common.throttle import ThrottledWarning
from kane_dynamics.ros.monitors.optional_topics import RELIABLE
from kane_dynamics.ros.parameters.live_parameters import LiveParameters
from kane_dynamics.ros.plant.plant_diagnostics import report
from kane_dynamics.ros.plant.plant_parameters import SPECS
from kane_dynamics.ros.plant.plant_state import PlantState
from kane_dynamics.ros.plant.tick_schedule import TickSchedule
from kane_dynamics.ros.torque_path.cdr import Prepared, STAMP, write_joint_state
from kane_dynamics.ros.torque_path.wrench_input import wrench_array
from rclpy.clock import Clock as RosClock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger

WRENCHES = QoSProfile(depth=10)  # of several frames at once
IDLE = 0.05  # s between two looks while it stands still
PLAIN_CDR = bytes((0, 1, 0, 0))  # how a serialised message begins
EPOCH = NANO  # where a time of its own begins, ns: a stamp of zero would mean none


class PlantNode(Node):
    """
    The simulated robot.

    Raises
    ------
    KaneError
        A parameter is not valid, or the URDF is not.

    """

    def __init__(self) -> None:
        super().__init__('plant')
        self._live = LiveParameters(
            self, SPECS, lambda: 'it is used at the start only; start the node anew',
            self._check, self._changed)
        values, log = self.values, self.get_logger()
        self._warn = ThrottledWarning(log)
        self.rejected: Counter[str] = Counter()
        self.received = 0
        self.failure = ''
        self.paused: bool = values['start_paused']
        robot = self._load()
        self.plant = PlantState(robot, values)
        self.pace = TickSchedule(self.plant.period / values['rate_factor'])
        self._set_up_messages()
        self._states = self.create_publisher(JointState, 'joint_states', RELIABLE)
        self._clock_out = self.create_publisher(Clock, '/clock', RELIABLE) if (
            values['publish_clock']) else None
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics',
                                                  QoSProfile(depth=1))
        self._commands = self.create_subscription(Float64MultiArray, 'commands', self._on_command,
                                                  RELIABLE)
        self.create_subscription(WrenchStamped, '~/wrench', self._on_wrench, WRENCHES)
        self.create_service(Trigger, '~/reset', self._on_reset)
        self.create_service(SetBool, '~/pause', self._on_pause)
        self.create_service(Trigger, '~/step', self._on_step)
        guard_services(self)
        self._steady = RosClock(clock_type=ClockType.STEADY_TIME)
        self._timer: Any = None
        self._start_reports()
        joints = self.plant.arm.joint_names
        modes = robot.joint_names[len(joints):]
        log.info(f'{robot.model.name}: {len(joints)} joints ({", ".join(joints)}), '
                 + f'beams bend in {", ".join(modes)}, ' * bool(modes)
                 + f'{values["rate"]:g} joint states a second' + ', paused' * self.paused)
        if self.plant.arm.doubt is not None:
            log.warning(f'rate and substeps: {self.plant.arm.doubt}')

    @property
    def values(self) -> dict[str, Any]:
        """Return the checked parameters by name."""
        return self._live.values

    def _load(self) -> Robot:
        values = self.values
        source = values['robot_description'] or (values['urdf'] and located('urdf',
                                                                            values['urdf']))
        if not source:
            raise InputError("no URDF: set parameter 'robot_description' or 'urdf'")
        model = load(source, values, self.get_logger().warning)
        return Robot(model, payload_frame=values['payload.frame'] or None,
                     wrench_frames=values['wrench.frames'])

    def _set_up_messages(self) -> None:
        """Lay out what is sent in every tick, so that only numbers remain to be written."""
        names = self.plant.arm.joint_names
        n = len(names)
        writer, offsets = write_joint_state(names, '', (n, n, n))
        self._message = Prepared(writer, offsets[0], n)
        self._columns = [self._message.doubles(offset, n) for offset in offsets]

    def poll(self) -> float:
        """Do the tick that is due, if one is; return the seconds until the next may be."""
        if self.paused or self.failure:
            self._tell_time(self._now())  # for those who begin to listen while it stands
            return IDLE
        now = time.monotonic_ns()
        if now >= self.pace.due:
            due = self.pace.due
            self.pace.tick(now)
            self._tick(time.time_ns() - (now - due))
        return max(self.pace.due - time.monotonic_ns(), 0) / NANO

    def _now(self) -> int:
        """Return the time on a clock of its own, ns."""
        return EPOCH + self.plant.time

    def _tick(self, system: int) -> None:
        """Go one period on; `system` is the system's time at which that was due, ns."""
        stamp = system if self._clock_out is None else self._now()
        self._tell_time(stamp)
        try:
            arrived = self.plant.tick(stamp)
        except KaneError as error:
            self.failure = str(error)
            self.get_logger().error(f'the arm stands still until ~/reset: {error}')
            return
        for measurement in arrived:
            self._message.stamp(*divmod(measurement.stamp, NANO))
            for column, numbers in zip(self._columns, measurement[1:], strict=True):
                column[:] = numbers
            self._states.publish(self._message.serialized())

    def _tell_time(self, stamp: int) -> None:
        if self._clock_out is not None:
            self._clock_out.publish(PLAIN_CDR + STAMP.pack(*divmod(stamp, NANO)))

    def _on_command(self, message: Float64MultiArray) -> None:
        try:
            tau = vector(message.data, None, len(self.plant.arm.joint_names), 'commands')
        except InputError as error:
            self._reject('commands', error)
            return
        self.received += 1
        self.plant.command(tau)

    def _on_wrench(self, message: WrenchStamped) -> None:
        try:
            self.plant.push(message.header.frame_id, wrench_array(message))
        except InputError as error:
            self._reject('wrench', error)

    def _reject(self, topic: str, error: KaneError) -> None:
        self.rejected[topic] += 1
        self._warn(f'{topic} rejected', str(error))

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Put the arm back to its start."""
        back = self.values['reset_clock'] and self._clock_out is not None
        if back:
            self.plant.rewind()
        else:
            self.plant.reset()
        self.failure = ''
        self.pace.start(time.monotonic_ns())
        self._reported = time.monotonic(), self.plant.ticks
        if back:
            self._tell_time(self._now())
        response.success = True
        response.message = 'at rest at ' + ', '.join(f'{q:g}' for q in self.plant.arm.q)
        return response

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        """Stand still, or go on from there."""
        self.paused = request.data
        self.pace.start(time.monotonic_ns())
        response.success = True
        response.message = 'paused' if self.paused else 'running'
        return response

    def _on_step(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Go one tick on while paused."""
        if not self.paused:
            response.message = 'it is running; ~/pause it first'
        else:
            self._tick(time.time_ns())
            response.success = not self.failure
            response.message = self.failure or f'{self.plant.time / NANO:g} s after the start'
        return response

    def _check(self, values: Mapping[str, Any], given: Collection[str]) -> None:
        PlantState.check(self.plant.robot, values)

    def _changed(self, before: Mapping[str, Any], given: Collection[str]) -> None:
        """Use checked parameters; between two ticks, since both run in the main thread."""
        values = self.values
        self.plant.update(values)
        if before['rate_factor'] != values['rate_factor']:
            self.pace.start(time.monotonic_ns(), self.plant.period / values['rate_factor'])
        if before['diagnostics_rate'] != values['diagnostics_rate']:
            self._start_reports()

    def _start_reports(self) -> None:
        if self._timer is not None:
            self.destroy_timer(self._timer)
        self._reported = time.monotonic(), self.plant.ticks
        self._timer = self.create_timer(1.0 / self.values['diagnostics_rate'], self._report,
                                        clock=self._steady)

    def _report(self) -> None:
        now, (then, ticks) = time.monotonic(), self._reported
        self._reported = now, self.plant.ticks
        speed = (self.plant.ticks - ticks) * self.plant.period / NANO / (now - then)
        message = DiagnosticArray(status=[report(self, speed)])
        stamp = message.header.stamp
        stamp.sec, stamp.nanosec = divmod(
            time.time_ns() if self._clock_out is None else self._now(), NANO)
        self._diagnostics.publish(message)
        self.pace.worst = 0
        if self._clock_out is not None and (clocks := self.count_publishers('/clock')) > 1:
            self._warn('clock', f'{clocks} publishers on /clock; one at most may have '
                       'publish_clock')
        if (sources := self._commands.get_publisher_count()) > 1:
            self._warn('commands', f'{sources} publishers: the arm follows whichever spoke last')
