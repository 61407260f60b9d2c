"""
A bond with a lifecycle manager, as that of Nav2, which notices when the node hangs or dies.

Both sides publish bond/Status with the id of the bond, the name of the node, and an
instance of their own. The node's messages come from its main thread.
"""

from importlib import import_module
from typing import Any
import uuid

from kane_dynamics.errors import InputError
from kane_dynamics.ros.common.qos import BOND
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode

TOPIC = 'bond'
PERIOD = 0.1  # s between two messages
TIMEOUT = 4.0  # s without a message, after which the bond is broken


def bond_status_type() -> Any:
    """
    Return the message type bond/Status.

    Raise InputError if not installed.
    """
    try:
        return import_module('bond.msg').Status
    except (ImportError, AttributeError) as error:
        raise InputError(f"parameter 'bond': true without bond/Status ({error}); expected "
                         'false, or an installed package bond') from None


class ManagerBond:
    """
    Publishes the node's side of the bond while it is active.

    Parameters
    ----------
    node : LifecycleNode

    Raises
    ------
    InputError
        The package bond is not installed.

    """

    def __init__(self, node: LifecycleNode) -> None:
        self._type = bond_status_type()
        self._node = node
        self._publisher = node.create_publisher(self._type, TOPIC, BOND)
        self._instance = ''  # empty without a bond
        self._timer = node.create_timer(PERIOD, self._publish,
                                        clock=Clock(clock_type=ClockType.STEADY_TIME))

    def form(self) -> None:
        """Begin a bond, as the node has been activated."""
        self._instance = str(uuid.uuid4())
        self._publish()

    def end(self) -> None:
        """End the bond, as the node is active no more."""
        if self._instance:
            self._publish(active=False)
        self._instance = ''

    def close(self) -> None:
        """Leave the topic."""
        self._node.destroy_timer(self._timer)
        self._node.destroy_publisher(self._publisher)

    def _publish(self, active: bool = True) -> None:
        if not self._instance:
            return
        message = self._type(id=self._node.get_name(), instance_id=self._instance,
                             active=active, heartbeat_timeout=TIMEOUT,
                             heartbeat_period=PERIOD)
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)
