"""The torques of the dynamics node, which torque_guard hears with their liveliness."""

from collections.abc import Callable
from typing import Any, Protocol

from kane_dynamics.ros.common.qos import watched
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from sensor_msgs.msg import JointState


class TorqueListener(Protocol):
    """Hears the dynamics node."""

    def on_torques(self, data: bytes) -> None:
        """Note a command, a serialized JointState."""

    def on_liveliness(self, alive: bool) -> None:
        """Note whether the node is alive."""


class TorqueSubscription:
    """A subscription whose listener may change."""

    def __init__(self) -> None:
        self.listener: TorqueListener | None = None
        self.alive = False

    def on_torques(self, data: bytes) -> None:
        """Pass a message on."""
        if self.listener is not None:
            self.listener.on_torques(data)

    def on_liveliness(self, event: Any) -> None:
        """Pass on whether the node is alive."""
        self.alive = event.alive_count > 0
        if self.listener is not None:
            self.listener.on_liveliness(self.alive)

    def forget(self) -> None:
        """Pass nothing on."""
        self.listener = None


class NodeTorques:
    """
    Subscriptions to ~/joint_torques of the dynamics node, one of each lease.

    A subscription is kept until the process ends, and used again by the next guard: where
    one with event callbacks is destroyed while an event waits, the EventsExecutor ends
    the process with a segmentation fault (github.com/ros2/rclpy/issues/1644).

    Parameters
    ----------
    node : Node
        The guard.
    target : str
        Name of the dynamics node.

    """

    def __init__(self, node: Node, target: str) -> None:
        self.target = target
        self._node = node
        self._subscriptions: dict[float, TorqueSubscription] = {}

    def hear(self, lease: float, listener: TorqueListener) -> Callable[[], None]:
        """
        Pass messages and events to a listener; return a function that ends it.

        `lease` is that which the dynamics node offers, s.
        """
        if lease not in self._subscriptions:
            self._subscriptions[lease] = self._subscribe(lease)
        subscription = self._subscriptions[lease]
        subscription.listener = listener
        if subscription.alive:
            listener.on_liveliness(True)
        return subscription.forget

    def _subscribe(self, lease: float) -> TorqueSubscription:
        """Subscribe without a listener."""
        subscription = TorqueSubscription()
        # Without the default callbacks: one that is not used may be incompatible.
        events = SubscriptionEventCallbacks(liveliness=subscription.on_liveliness,
                                            use_default_callbacks=False)
        self._node.create_subscription(
            JointState, f'{self.target}/joint_torques', subscription.on_torques,
            watched(lease, watching=True), raw=True, event_callbacks=events)
        return subscription
