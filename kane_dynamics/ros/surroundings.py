"""Beside the torque path: wrenches that come in, contact that is found, torque explained."""

from collections.abc import Callable, Mapping
from typing import Any

from geometry_msgs.msg import WrenchStamped
from kane_dynamics.errors import InputError
from kane_dynamics.robot import Robot
from kane_dynamics.ros.contact import Contact, observed_frame, Outputs, settings
from kane_dynamics.ros.estimator import Estimator, estimator_settings
from kane_dynamics.ros.explainer import Explainer
from kane_dynamics.ros.services import Services
from kane_dynamics.ros.torque_path import TorquePath
from kane_dynamics.ros.wrenches import check_frames, Wrenches
from kane_dynamics_interfaces.msg import PayloadEstimate, TorqueExplanation
from rclpy.lifecycle import LifecycleNode
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool

# Of the sensor data profile: what came during a stall of some ms is answered late, not never.
BEST_EFFORT = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
RELIABLE = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
# Whoever comes late hears the flag as it is.
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def check_surroundings(values: Mapping[str, Any], robot: Robot) -> None:
    """Raise InputError unless the parameters wrench.* and observer.* fit a robot."""
    check_frames(robot.model, values['wrench.frames'])
    if robot.constraint_names:
        for name in ('observer.enabled', 'estimator.enabled', 'explanation.rate'):
            if values[name]:
                raise InputError(f"parameter '{name}' is {values[name]!r}, but an arm with "
                                 'constraints is not commanded; leave it at its default')
    if values['observer.enabled']:
        settings(values, robot)
        robot.model.frame(observed_frame(values, robot.model))
    if values['estimator.enabled']:
        estimator_settings(values, robot)


class Surroundings:
    """
    The topics of wrenches, contact and explanation, each where the parameters ask for it.

    Parameters
    ----------
    node : LifecycleNode
        Which owns the topics.
    server : Services
        In whose thread torques are explained.
    path : TorquePath
    values : mapping
        The node's parameters; `check_surroundings` has found them to fit.
    now : callable
        Returns the node's clock, ns.
    reject : callable
        Takes the reason and the details of every message that was not used.

    """

    def __init__(self, node: LifecycleNode, server: Services, path: TorquePath,
                 values: Mapping[str, Any], now: Callable[[], int],
                 reject: Callable[[str, str], None]) -> None:
        self._node, self._path = node, path
        self._publishers: list[Any] = []
        robot = path.controller.robot
        self.contact: Contact | None = None
        self._estimator: Estimator | None = None
        self._explainer: Explainer | None = None
        self._subscription: Any = None
        if values['observer.enabled']:
            self.contact = Contact(robot, values, Outputs(
                self._open(JointState, '~/external_torques', RELIABLE),
                self._open(WrenchStamped, '~/external_wrench', RELIABLE),
                self._open(Bool, '~/collision', LATCHED)), node.get_logger(),
                lambda reason, detail: reject(f'observer: {reason}', detail))
            path.add_watch(self.contact, need_effort=True)
        if values['wrench.frames']:
            path.wrenches = Wrenches(robot, now, values,
                                     lambda reason, detail: reject(f'wrench: {reason}', detail))
            self._subscription = node.create_subscription(
                WrenchStamped, '~/wrench', path.wrenches.take, BEST_EFFORT, raw=True)
        if values['estimator.enabled']:
            self._estimator = Estimator(
                robot, values, server,
                self._open(PayloadEstimate, '~/payload_estimate', RELIABLE),
                lambda reason, detail: reject(f'estimator: {reason}', detail))
            path.add_watch(self._estimator, need_effort=True)
        if values['explanation.rate']:
            self._explainer = Explainer(
                server, self._open(TorqueExplanation, '~/torque_by_source', RELIABLE),
                values['explanation.rate'], path.controller, path.wrenches,
                lambda reason, detail: reject(f'explanation: {reason}', detail))
            path.add_watch(self._explainer, need_effort=False)

    def _open(self, kind: Any, name: str, qos: QoSProfile) -> Any:
        publisher = self._node.create_lifecycle_publisher(kind, name, qos)
        self._publishers.append(publisher)
        return publisher

    def close(self) -> None:
        """Close the topics."""
        for watch in (self._estimator, self._explainer):
            if watch is not None:
                watch.close()
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
        for publisher in self._publishers:
            self._node.destroy_lifecycle_publisher(publisher)

    def update(self, values: Mapping[str, Any]) -> None:
        """Use checked parameters from the next state on."""
        if self.contact is not None:
            self.contact.update(values)
        if self._estimator is not None:
            self._estimator.update(values)
        if self._path.wrenches is not None:
            self._path.wrenches.update(values)

    @property
    def collision(self) -> str | None:
        """Return the joint of a collision, if there is one now."""
        return None if self.contact is None else self.contact.detector.joint

    def figures(self) -> dict[str, str]:
        """Return printable figures for the diagnostics."""
        return {} if self.contact is None else self.contact.figures()
