"""What exists from configuring to cleaning up: the robots, the torque path and its topics."""

from collections.abc import Callable, Collection, Mapping
from contextlib import ExitStack
from dataclasses import replace
import threading
import time
from typing import Any

from kane_dynamics.control.controller import Controller
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.errors import InputError
from kane_dynamics.model.flexible_model import stiffened
from kane_dynamics.model.model import Model
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.configuration_files import load_choices
from kane_dynamics.ros.common.node_statistics import Statistics
from kane_dynamics.ros.monitors.imu_gravity import GravityFromImu
from kane_dynamics.ros.monitors.optional_topics import (BEST_EFFORT, check_optional_topics,
                                                        OptionalTopics, RELIABLE)
from kane_dynamics.ros.parameters.parameter_checks import controller_settings
from kane_dynamics.ros.services.services import Services
from kane_dynamics.ros.services.simulation_request import ServedRobot
from kane_dynamics.ros.torque_path.gravity_payload import (checked_payload, GravityAndPayload,
                                                           PayloadBounds, start_loads)
from kane_dynamics.ros.torque_path.torque_path import TorquePath
from kane_dynamics.ros.torque_path.wrench_input import WrenchFrames
from kane_dynamics.simulation.step_kernels import compile_simulation
import numpy as np
from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNode
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float64MultiArray

PAYLOAD = ('payload.mass', 'payload.com', 'payload.inertia')
ACKNOWLEDGE = 0.3  # s to wait for zeros to be acknowledged


class ConfiguredRobot:
    """
    One configured arm.

    Each thread that computes has a robot of its own: the torque path, the services, the
    simulations. What may change while they run goes to each as one record, which it puts into its
    kernels between two pieces of work. Beams bend in the torques that are commanded, as
    `QuasiStatic` has it; to all else they are rigid.

    Parameters
    ----------
    node : LifecycleNode
        Which owns the topics.
    server : Services
    model : Model
    values : mapping
        The node's parameters.
    statistics : Statistics
    warn : callable
        Takes the reason and the details of every message that was dropped.

    Raises
    ------
    KaneError
        The robot cannot be compiled or verified, or a parameter does not fit it. Nothing has been
        opened then.

    """

    def __init__(self, node: LifecycleNode, server: Services, model: Model,
                 values: Mapping[str, Any], statistics: Statistics,
                 warn: Callable[[str, str], None]) -> None:
        choices = load_choices(values)
        bending = QuasiStatic(Robot(model, **choices)) if model.flexible else None
        model = stiffened(model)
        self.values, self._node, self._server, self._warn = values, node, server, warn
        self._statistics, self._clock = statistics, node.get_clock()
        self._simulated_time = bool(self._clock.ros_time_is_active)
        self._lock = threading.Lock()  # of the loads, which two threads change
        self.loads: GravityAndPayload = start_loads(model, values)
        self._by_service = False  # whether the payload is that of ~/set_payload
        self.sources = 1  # publishers of joint states, but those of other joints
        self._others: set[tuple[str, ...]] = set()
        self.gravity_source = GravityFromImu(
            model, values['imu.frame'], float((values['gravity'] ** 2).sum() ** 0.5),
            values['imu.time_constant'], lambda gravity: self._change(gravity=gravity)
        ) if values['imu.topic'] else None
        self.robot = Robot(model, **choices)
        check_optional_topics(values, self.robot)
        compile_simulation(self.robot, values['simulation.integrator'], 'external_force',
                           'body_torques')
        self._for_requests, self._for_simulations = self.robot.copy(), self.robot.copy()
        self._request_frames = WrenchFrames(self._for_requests)
        self.verified = max(robot.verify() for robot in (
            self.robot, *([bending.robot] if bending else [])))
        controller = Controller(self.robot, bending=bending,
                                **controller_settings(values, self.robot.joint_names))
        if not self.robot.constraint_names:
            controller.compile()
        with ExitStack() as opened:
            self._open(controller, opened)
            self._opened = opened.pop_all()
        server.spinner.wake()

    def _open(self, controller: Controller, opened: ExitStack) -> None:
        """Open the topics; `opened` closes them."""
        node, server, values, warn = self._node, self._server, self.values, self._warn

        def publisher(kind: Any, name: str, qos: QoSProfile) -> Any:
            result = node.create_lifecycle_publisher(kind, name, qos)
            opened.callback(node.destroy_lifecycle_publisher, result)
            return result
        self._commands = publisher(Float64MultiArray, 'commands', RELIABLE)
        self.path = TorquePath(
            controller, self._commands, publisher(JointState, '~/joint_torques', RELIABLE),
            self._now, values['state_timeout'], self._statistics,
            lambda reason, detail: warn(f'joint states: {reason}', detail))
        self.surroundings = OptionalTopics(node, server, self.path, values, self._now,
                                           self._reject, publisher, opened)
        self._distribute()
        self._states = node.create_subscription(JointState, 'joint_states', self.path.on_state,
                                                BEST_EFFORT, raw=True)
        opened.callback(node.destroy_subscription, self._states)
        if self.gravity_source is not None:
            imu = server.create_subscription(
                Imu, node.resolve_topic_name(values['imu.topic']), self._on_imu, BEST_EFFORT)
            opened.callback(server.destroy_subscription, imu)

    def _now(self) -> int:
        """Return the node's clock, ns; the system's own is the same where none is simulated."""
        return int(self._clock.now().nanoseconds) if self._simulated_time else time.time_ns()

    def clock_jumped(self, *, exchanged: bool = False) -> None:
        """Take notice that the node's clock was set back, or was exchanged for another."""
        self._simulated_time = bool(self._clock.ros_time_is_active)
        if self.path.running:
            self.path.clock_jumped()
            if exchanged:  # states of the other clock's stamps may all be refused
                self.path.lose('the clock is another one now')

    def count_sources(self) -> None:
        """Count who publishes joint states of this arm: more than one is one too many."""
        publishers = int(self._states.get_publisher_count())
        before, self._others = self._others, self.path.take_others()  # some speak but seldom
        self.sources = max(publishers - len(before | self._others), min(publishers, 1))

    def halt(self) -> bool:
        """Command zeros; return whether, within bounds, every subscriber has them."""
        if not self.path.running:
            return True
        self.path.stop()
        return bool(self._commands.wait_for_all_acked(Duration(seconds=ACKNOWLEDGE)))

    def close(self) -> None:
        """Close the topics and let the services answer that nothing is configured."""
        self._server.served = None
        self._opened.close()

    def check(self, values: Mapping[str, Any], given: Collection[str]) -> None:
        """Raise InputError if these parameters, of which some are given anew, do not fit."""
        controller_settings(values, self.robot.joint_names)
        start_loads(self.robot.model, values)
        check_optional_topics(values, self.robot)
        if self.gravity_source is not None and (
                values['gravity'] != self.values['gravity']).any():
            raise InputError("parameter 'gravity' is not used while imu.topic is set: its "
                             'direction comes from there')
        if self._by_service and 'payload.mass' not in given and any(
                name in given for name in PAYLOAD):
            raise InputError('the payload is that of the last ~/set_payload, of which the '
                             "parameters do not know; set 'payload.mass' with the others")

    def update(self, values: Mapping[str, Any], given: Collection[str]) -> None:
        """Use checked parameters, some given anew, from the next cycle and request on."""
        before, self.values = self.values, values
        if before['mode'] != values['mode'] and self.path.course.forget():
            self._warn('mode', 'it has changed: the desired motion is forgotten')
        self.path.set_timeout(values['state_timeout'])
        self.path.controller.update(**controller_settings(values, self.robot.joint_names))
        if self.gravity_source is not None:
            self.gravity_source.time_constant = values['imu.time_constant']
        self.surroundings.update(values)
        loads = start_loads(self.robot.model, values)
        changes: dict[str, Any] = {}
        if not np.array_equal(before['gravity'], values['gravity']):
            changes['gravity'] = loads.gravity
        if any(name in given for name in PAYLOAD):
            changes['payload'], self._by_service = loads.payload, False
        self._change(**changes)

    def set_payload(self, request: Any) -> None:
        """
        Carry what a SetPayload request says; runs in the services' thread.

        Every state that comes after the answer is computed with it.

        Raises
        ------
        InputError
            Names the field, its value and what is valid.

        """
        given = request.payload
        payload = checked_payload(
            self.robot.model, PayloadBounds.from_values(self.values), request.frame, given.m,
            (given.com.x, given.com.y, given.com.z),
            (given.ixx, given.ixy, given.ixz, given.iyy, given.iyz, given.izz))
        self._by_service = True
        self._change(payload=payload)

    def _on_imu(self, message: Imu) -> None:
        assert self.gravity_source is not None
        try:
            self.gravity_source.take(message, self._now())
        except InputError as error:
            self._reject('imu', str(error))

    def _reject(self, reason: str, detail: str) -> None:
        """Count and tell that a message was not used."""
        self._statistics.rejected[reason] += 1
        self._warn(reason, detail)

    def _change(self, **changes: Any) -> None:
        """Replace some of the loads and hand them, with the parameters, to all threads."""
        with self._lock:
            self.loads = replace(self.loads, **changes)
            self._distribute()

    def _distribute(self) -> None:
        self.path.set_loads(self.loads)
        self._server.max_waiting = self.values['simulation.max_waiting']
        self._server.served = ServedRobot.from_values(self._for_requests, self._for_simulations,
                                                      self.loads, self.values,
                                                      self._request_frames)
