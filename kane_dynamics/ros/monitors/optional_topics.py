"""The optional topics: wrenches and contact."""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from importlib import import_module
from typing import Any

from geometry_msgs.msg import WrenchStamped
from kane_dynamics.errors import InputError
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.qos import BEST_EFFORT, LATCHED, RELIABLE
from kane_dynamics.ros.common.transform_tree import TransformTree
from kane_dynamics.ros.loads.wrench_input import (check_frames, largest_wrench,
                                                  WrenchInput)
from kane_dynamics.ros.monitors.applied_torque import stated_efforts
from kane_dynamics.ros.monitors.attached_objects import check_attached_objects
from kane_dynamics.ros.monitors.contact_monitor import (ContactMonitor,
                                                        ContactPublishers,
                                                        friction_settings,
                                                        observer_settings)
from kane_dynamics.ros.parameters.command_form import INTERFACES
from kane_dynamics.ros.parameters.task_settings import controlled_frame
from kane_dynamics.ros.torque_path.torque_path import TorquePath
from rclpy.exceptions import InvalidTopicNameException
from rclpy.lifecycle import LifecycleNode
from rclpy.qos import QoSProfile
from rclpy.validate_topic_name import validate_topic_name
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool


def stamped_command_type(values: Mapping[str, Any]) -> Any:
    """
    Return the message type of stamped commands, of control_msgs.

    Raise InputError if not installed.
    """
    one = len(INTERFACES[values['commands.form']]) == 1
    name = 'JointCommand' if one else 'DynamicInterfaceGroupValues'
    try:
        return getattr(import_module('control_msgs.msg'), name)
    except (ImportError, AttributeError) as error:
        raise InputError("parameter 'stamped_commands': true without "
                         f'control_msgs/{name} ({error}); expected false, or an '
                         'installed package control_msgs with that message') from None


def _check_topic(parameter: str, name: str) -> None:
    """Raise InputError unless a parameter is the name of a topic."""
    try:
        validate_topic_name(name)
    except InvalidTopicNameException:
        raise InputError(f"parameter '{parameter}': '{name}'; expected the name of a "
                         'topic') from None


def check_optional_topics(values: Mapping[str, Any], robot: Robot) -> None:
    """Raise InputError unless the parameters of the optional topics fit a robot."""
    # Each group of parameters is checked by the part that will use it.
    if values['stamped_commands']:
        stamped_command_type(values)
    if values['imu.topic']:
        _check_topic('imu.topic', values['imu.topic'])
    if values['attached_objects.topic']:
        _check_topic('attached_objects.topic', values['attached_objects.topic'])
    check_attached_objects(values)
    check_frames(robot.model, values['wrench.frames'])
    largest_wrench(robot, values)
    if values['payload.frame']:
        check_frames(robot.model, [values['payload.frame']], 'payload.frame')
    if values['observer.enabled']:
        observer_settings(values, robot)
        friction_settings(values, robot)
        check_frames(robot.model, [controlled_frame(values, robot.model)],
                     'cartesian.frame')
        stated_efforts(values, robot)


class OptionalTopics:
    """
    Opens the optional topics that the parameters enable.

    Parameters
    ----------
    node : LifecycleNode
        Owner of the topics.
    path : TorquePath
    values : mapping
        The node's parameters, checked by `check_optional_topics`.
    now : callable
        Returns the node's clock, ns.
    reject : callable
        Called with the reason and the details of each rejected message.
    publisher : callable
        Creates a publisher from type, name and QoS.
    opened : ExitStack
        Closes the topics.
    transforms : TransformTree or None
        Finds frames of wrenches that are not declared.

    """

    def __init__(self, node: LifecycleNode, path: TorquePath,
                 values: Mapping[str, Any], now: Callable[[], int],
                 reject: Callable[[str, str], None],
                 publisher: Callable[[Any, str, QoSProfile], Any],
                 opened: ExitStack, transforms: TransformTree | None) -> None:
        self._path = path
        self._action = values['observer.action']
        self._log = node.get_logger()
        robot = path.controller.robot
        bending = path.controller.bending
        self.contact: ContactMonitor | None = None
        if values['observer.enabled']:
            self.contact = ContactMonitor(robot, values, ContactPublishers(
                publisher(JointState, '~/external_torques', RELIABLE),
                publisher(WrenchStamped, '~/external_wrench', RELIABLE),
                publisher(Bool, '~/collision', LATCHED)), node.get_logger(),
                lambda reason, detail: reject(f'observer: {reason}', detail), bending,
                self._on_collision)
            path.add_observer(self.contact, need_effort=True)
        # Wrenches are part of the torques, not an observer.
        if values['wrench.frames']:
            path.wrenches = WrenchInput(robot, now, values,
                                        lambda reason,
                                        detail: reject(f'wrench: {reason}', detail),
                                        transforms)
            path.wrenches.changed = path.law_changed
            opened.callback(node.destroy_subscription, node.create_subscription(
                WrenchStamped, '~/wrench', path.wrenches.on_message, BEST_EFFORT,
                raw=True))

    def update(self, values: Mapping[str, Any]) -> None:
        """Use checked parameters from the next state on."""
        self._action = values['observer.action']
        if self.contact is not None:
            self.contact.update(values)
        if self._path.wrenches is not None:
            self._path.wrenches.update(values)

    def _on_collision(self, stamp: int, joint: str) -> None:
        """Stop the desired motion, if parameter observer.action says so."""
        if self._action == 'stop' and self._path.interrupt(
                stamp, f"collision at joint '{joint}'"):
            self._log.error(f"collision at joint '{joint}': desired motion stopped "
                            '(observer.action: stop)')

    @property
    def collision(self) -> str | None:
        """Return the joint of the present collision, if any."""
        return None if self.contact is None else self.contact.detector.joint

    def figures(self) -> dict[str, str]:
        """Return the entries for the diagnostics."""
        return {} if self.contact is None else self.contact.figures()
