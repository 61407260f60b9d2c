"""Simulated robots in the ROS graph: the only ones that a node commands without being asked."""

import time

from kane_dynamics.ros.common.commanders import UNKNOWN
from rclpy.node import Node, NodeNameNonExistentError

SIMULATED_ROBOT = 'simulated_robot'  # a topic that simulated robots publish
HIDDEN = '_'  # first letter of the names of hidden nodes, such as those of the ros2 command line
IDENTIFICATION = 0.2  # s for which a new subscriber may be unknown: discovery finds its name later


def not_simulated(node: Node, topic: str) -> str:
    """
    Return why a topic of commands is not known to be of simulated robots only.

    A simulated robot publishes a topic whose last name is ``simulated_robot``. Hidden nodes do
    not count.

    Parameters
    ----------
    node : Node
        Node that would publish.
    topic : str
        Name of the topic.

    Returns
    -------
    str
        Empty if all nodes that subscribe to the topic, at least one, are simulated robots.

    """
    topic = node.resolve_topic_name(topic)
    names = _subscribers(node, topic)
    if not names:
        return f'nothing subscribes to {topic}'
    real = _first_real(node, names)
    return real and f'{real} subscribes to {topic}'


class SubscriberWatch:
    """
    Watches for a subscriber of a topic that is no simulated robot.

    Parameters
    ----------
    node : Node
    topic : str

    """

    def __init__(self, node: Node, topic: str) -> None:
        self._node, self._topic = node, node.resolve_topic_name(topic)
        self._count = -1  # subscribers when they were last examined; -1: not yet
        self._examined = 0.0
        self._unknown_since = 0.0  # since when a subscriber is not known to be simulated, s

    def real_subscriber(self) -> str:
        """
        Return the name of a subscriber that is no simulated robot; empty without one.

        Call it several times within `IDENTIFICATION`. The graph is asked for names only when the
        number of subscribers changed, and once in that time, since this delays the torque path.
        """
        now, count = time.monotonic(), self._node.count_subscribers(self._topic)
        if count == self._count and now - self._examined < IDENTIFICATION:
            return ''
        self._count, self._examined = count, now
        real = _first_real(self._node, _subscribers(self._node, self._topic))
        if not real:
            self._unknown_since = 0.0
            return ''
        self._count = -1  # examine them at the next call again
        self._unknown_since = self._unknown_since or now
        return real if now - self._unknown_since > IDENTIFICATION else ''


def _subscribers(node: Node, topic: str) -> list[tuple[str, str]]:
    """Return names and namespaces of the nodes that subscribe to a topic, without hidden ones."""
    return sorted({(end.node_name, end.node_namespace)
                   for end in node.get_subscriptions_info_by_topic(topic)
                   if not end.node_name.startswith(HIDDEN) or UNKNOWN in end.node_name})


def _first_real(node: Node, names: list[tuple[str, str]]) -> str:
    """Return the full name of the first node that is no simulated robot; empty without one."""
    for name, namespace in names:
        if not _is_simulated(node, name, namespace):
            return f"{namespace.rstrip('/')}/{name}"
    return ''


def _is_simulated(node: Node, name: str, namespace: str) -> bool:
    """Return whether a node publishes the topic of simulated robots."""
    try:
        topics = node.get_publisher_names_and_types_by_node(name, namespace)
    except (NodeNameNonExistentError, RuntimeError):  # it ended
        return False
    return any(topic.rpartition('/')[2] == SIMULATED_ROBOT for topic, _ in topics)
