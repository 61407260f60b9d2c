"""The robot, the topics and the torque path of torque_guard."""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from functools import partial
import time
from typing import Any

from kane_dynamics.control.terms import Mode
from kane_dynamics.control_cycle.arbitration import FIELDS, LOST, STOPPED
from kane_dynamics.model.model import Model
from kane_dynamics.native.runtime.threads import run_concurrently
from kane_dynamics.robot.verification import compile_verified
from kane_dynamics.ros.common.cdr import float64_multi_array
from kane_dynamics.ros.common.lost_messages import with_info
from kane_dynamics.ros.common.node_statistics import Statistics
from kane_dynamics.ros.common.qos import BEST_EFFORT, RELIABLE
from kane_dynamics.ros.common.stamped_numbers import with_stamp
from kane_dynamics.ros.guard.guard_messages import arm_digest, REQUEST, STATE
from kane_dynamics.ros.guard.guard_path import GuardPath
from kane_dynamics.ros.guard.node_torques import NodeTorques
from kane_dynamics.ros.loads.gravity_payload import GravityAndPayload
from kane_dynamics.ros.torque_path.closed_loop_reader import commanded_joints
from kane_dynamics.ros.torque_path.path_controller import path_controller
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

ACKNOWLEDGE_TIMEOUT = 0.3  # s
HEARTBEATS = 3  # heartbeats before the first takeover
TICKS = 3  # in a lease, by which the guard notes its own stalls


class ConfiguredGuard:
    """
    The resources of the guard for one configuration of the dynamics node.

    Parameters
    ----------
    node : Node
        The guard.
    torques : NodeTorques
        Those of the dynamics node.
    model : Model
    values : mapping
        Parameters of the dynamics node.
    warn : callable
        Called with the reason and the details of each dropped state.
    report : callable
        Called with level ('error' or 'info') and text of each change between watching
        and commanding.
    identity : float
        Number of this guard, which no other one has.

    Raises
    ------
    KaneError
        The robot cannot be compiled or verified.

    """

    def __init__(self, node: Node, torques: NodeTorques, model: Model,
                 values: Mapping[str, Any], warn: Callable[[str, str], None],
                 report: Callable[[str, str], None], identity: float) -> None:
        self._identity = identity
        # The guard holds in modes of its own.
        controller = path_controller(model, {**values, 'mode': Mode.COMPUTED_TORQUE})
        # The digest says whether node and guard have the same arm.
        self.digest = arm_digest(model, controller.robot.options['constraints'])
        self.robot = controller.robot
        self.statistics = Statistics()
        robots = [self.robot]
        if controller.bending is not None:
            robots.append(controller.bending.robot)
        run_concurrently([controller.compile,
                          *(partial(compile_verified, robot) for robot in robots)])
        self.verified = max(robot.verify() for robot in robots)
        self._clock = node.get_clock()
        self._simulated_time = bool(self._clock.ros_time_is_active)
        self.node_alive = False
        self._heartbeats = 0
        self._message = float64_multi_array(FIELDS + len(commanded_joints(
            self.robot, controller.followed)))
        self._request = float64_multi_array(1)
        # What was opened is closed again if a later part cannot be.
        with ExitStack() as opened:
            self._open(node, torques, controller, values, warn, report, opened)
            self._opened = opened.pop_all()
        self.path.compile()
        self.path.start()

    def _open(self, node: Node, torques: NodeTorques, controller: Any,
              values: Mapping[str, Any], warn: Callable[[str, str], None],
              report: Callable[[str, str], None], opened: ExitStack) -> None:
        """Open the topics and register them with `opened`."""
        target = torques.target

        def publisher(kind: Any, name: str) -> Any:
            result = node.create_publisher(kind, name, RELIABLE)
            opened.callback(node.destroy_publisher, result)
            return result

        def subscribe(kind: Any, name: str, callback: Any, qos: Any) -> None:
            opened.callback(node.destroy_subscription, node.create_subscription(
                kind, name, callback, qos, raw=True))
        # What it commands and says.
        self._commands = publisher(Float64MultiArray, 'commands')
        self._state = publisher(Float64MultiArray, f'{target}/{STATE}')
        self.path = GuardPath(controller, self._commands,
                              publisher(JointState, '~/joint_torques'),
                              self.now, values, self.statistics, warn, report)
        self._report = report
        timer = node.create_timer(values['guard.lease'] / TICKS, self._tick,
                                  clock=Clock(clock_type=ClockType.STEADY_TIME))
        opened.callback(node.destroy_timer, timer)
        # What it hears: the arm, and the node's torques with their liveliness.
        subscribe(JointState, 'joint_states', with_info(self._on_state), BEST_EFFORT)
        opened.callback(torques.hear(values['guard.lease'], self))
        subscribe(Float64MultiArray, f'{target}/{REQUEST}', self._on_request, RELIABLE)

    def _on_state(self, data: bytes, info: Mapping[str, Any]) -> None:
        received = self.now() if self._simulated_time else info['received_timestamp']
        self.path.on_state(with_stamp(data, received))

    def _tick(self) -> None:
        """Note that the guard runs; report it if the guard was stopped before."""
        watch = self.path.watch
        watch.tick(time.perf_counter())
        if watch.stopped_for > 0.0:
            self._report('warning',
                         f'torque_guard did not run for {watch.stopped_for:.2f} s; '
                         f'listening for {LOST:g} s whether another guard holds the arm')
            watch.stopped_for = 0.0

    def now(self) -> int:
        """Return the clock of both nodes, ns."""
        if self._simulated_time:
            return int(self._clock.now().nanoseconds)
        return time.time_ns()

    def on_clock_jump(self) -> None:
        """Handle a backward jump of the clock."""
        self.path.on_clock_jump()

    def set_loads(self, loads: GravityAndPayload) -> None:
        """Use gravity and payload of the dynamics node from the next state on."""
        self.path.set_loads(loads)

    def send_heartbeat(self) -> None:
        """Send the state of the guard to the dynamics node."""
        self._send(0.0, self.path.watch.acting)
        # A node that does not know of the guard would not ask it.
        self._heartbeats += self._state.get_subscription_count() > 0
        self.path.watch.known |= self._heartbeats >= HEARTBEATS

    def _send(self, number: float, acting: bool) -> None:
        """
        Send the state of the guard, as the answer to a request.

        While it listens it sends none.
        """
        watch = self.path.watch
        now = time.perf_counter()
        watch.tick(now)
        # Another guard acts, or has just acted: its states are the ones that count.
        if watch.listens(now):
            return
        self._message.numbers[:FIELDS] = (number, acting, watch.commanded_last,
                                          self._identity)
        self._message.numbers[FIELDS:] = watch.torque
        self._state.publish(self._message.serialized())

    def _on_request(self, data: bytes) -> None:
        """Hand the topic over to the dynamics node, and answer."""
        if not self._request.read(data):
            return
        if self._request.numbers[0] == STOPPED:
            self.path.on_stopped()
            return
        acted = self.path.hand_over()
        self._send(float(self._request.numbers[0]), acted)
        if acted:
            self._report('info', 'the dynamics node is back; watching it')

    def on_torques(self, data: bytes) -> None:
        """Note a command of the node, a serialized JointState."""
        self.path.on_torques(data)

    def on_liveliness(self, alive: bool) -> None:
        """Note whether the node is alive; take over from one that is not."""
        self.node_alive = alive
        if not alive:
            now = time.perf_counter()
            self.path.watch.tick(now)
            self.path.watch.check(now, lost=True)

    def abandon(self) -> None:
        """Close the topics without zeros, because another guard commands."""
        self.path.hand_over()
        self.close()

    def close(self) -> None:
        """Command zeros if the guard commands, then close the topics."""
        acting = self.path.commanding
        self.path.stop()
        if acting and not self._commands.wait_for_all_acked(
                Duration(seconds=ACKNOWLEDGE_TIMEOUT)):
            self._report('error',
                         'commands: zeros not acknowledged by a subscriber within '
                         f'{ACKNOWLEDGE_TIMEOUT} s')
        self._opened.close()
