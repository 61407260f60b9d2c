"""
The nodes at both ends of a topic of commands.

Several dynamics nodes must not command one arm, and a node commands a robot without
being asked only if the robot is simulated. Queries for the names of nodes hold the
interpreter's lock and so delay the torque path; they are made only after the number of
publishers or subscribers changed.
"""

import time

from rclpy.node import Node, NodeNameNonExistentError

UNKNOWN = '_UNKNOWN_'  # part of the name of a node that is not known yet
HIDDEN = '_'  # first letter of the names of hidden nodes, as of the ros2 command line
RECORDERS = ('rosbag2_recorder', 'foxglove_bridge')  # nodes that move nothing
GUARD_STATE = 'guard_state'  # a topic that only torque_guard publishes
SIMULATED_ROBOT = 'simulated_robot'  # a topic that simulated robots publish
IDENTIFICATION = 0.2  # s for which the topics of a new subscriber may be unknown
NAMING = 1.0  # s for which its name may be unknown; it comes late on a busy machine


def commanders(node: Node, topic: str) -> list[str]:
    """
    Return the full names of the nodes that publish on a topic, without torque_guard.

    A name appears once for each publisher. Only one guard is left out.
    """
    publishers = node.get_publishers_info_by_topic(node.resolve_topic_name(topic))
    names = [full_name(end.node_name, end.node_namespace) for end in publishers]
    # One node alone commands, guard or not.
    if len(names) < 2:
        return names
    # The guard is known by the state that it publishes.
    for name in names:
        namespace, _, bare_name = name.rpartition('/')
        if _publishes(node, bare_name, namespace or '/', GUARD_STATE):
            names.remove(name)
            break
    return names


class CommanderCount:
    """
    The number of publishers of a topic, and their names if there are several.

    Parameters
    ----------
    node : Node
    topic : str

    """

    def __init__(self, node: Node, topic: str) -> None:
        self._node = node
        self._topic = node.resolve_topic_name(topic)
        self._count = 0
        self.names: list[str] = []

    def update(self) -> list[str]:
        """Return the names; those that are not known yet are asked for again."""
        count = self._node.count_publishers(self._topic)
        # Of several, one may end and another begin between two updates.
        unsettled = len(self.names) > 1 or any(UNKNOWN in name for name in self.names)
        if count != self._count or unsettled:
            self._count = count
            self.names = commanders(self._node, self._topic)
        return self.names


def several_commanders(names: list[str]) -> str:
    """Return the warning about more than one publisher on a topic of commands."""
    return (f'{len(names)} publishers ({", ".join(sorted(names))}); expected one '
            'dynamics node with its torque_guard, stop the others (a killed one is '
            'listed for 20 s)')


def not_simulated(node: Node, topic: str) -> str:
    """
    Return why commands on a topic might reach a real robot; empty if they cannot.

    A simulated robot publishes a topic whose last name is ``simulated_robot``. Hidden
    nodes and recorders (rosbag2, Foxglove) do not count.

    Parameters
    ----------
    node : Node
        Node that would publish.
    topic : str
        Name of the topic.

    Returns
    -------
    str
        Empty if all nodes that subscribe to the topic, at least one, are simulated
        robots.

    """
    topic = node.resolve_topic_name(topic)
    subscribers = _subscribers(node, topic)
    if not subscribers:
        return f'nothing subscribes to {topic}'
    real_robot = _first_real(node, subscribers)
    return real_robot and f'{real_robot} subscribes to {topic}'


class SubscriberWatch:
    """
    Watches a command topic for subscribers other than simulated robots.

    Parameters
    ----------
    node : Node
    topic : str

    """

    def __init__(self, node: Node, topic: str) -> None:
        self._node = node
        self._topic = node.resolve_topic_name(topic)
        self._count = -1  # subscribers when they were last examined; -1: not yet
        self._examined_at = 0.0  # s
        self._unidentified_since = 0.0  # s; 0: every subscriber is a simulated robot

    def real_subscriber(self) -> str:
        """
        Return the name of a subscriber that is not a simulated robot; empty without one.

        Call it several times within `IDENTIFICATION`.
        """
        now = time.monotonic()
        count = self._node.count_subscribers(self._topic)
        # One may end and another begin between two calls, so they are examined now and
        # then.
        if count == self._count and now - self._examined_at < IDENTIFICATION:
            return ''
        self._count = count
        self._examined_at = now
        real_robot = _first_real(self._node, _subscribers(self._node, self._topic))
        if not real_robot:
            self._unidentified_since = 0.0
            return ''
        # Name and topics of a new node arrive after its subscription.
        self._count = -1
        self._unidentified_since = self._unidentified_since or now
        allowed = NAMING if UNKNOWN in real_robot else IDENTIFICATION
        return real_robot if now - self._unidentified_since > allowed else ''


def full_name(name: str, namespace: str) -> str:
    """Return the full name of a node."""
    return f"{namespace.rstrip('/')}/{name}"


def _subscribers(node: Node, topic: str) -> list[tuple[str, str]]:
    """Return names and namespaces of the nodes that may move something."""
    nodes = set()
    for end in node.get_subscriptions_info_by_topic(topic):
        hidden = end.node_name.startswith(HIDDEN) and UNKNOWN not in end.node_name
        if not hidden and end.node_name not in RECORDERS:
            nodes.add((end.node_name, end.node_namespace))
    return sorted(nodes)


def _first_real(node: Node, subscribers: list[tuple[str, str]]) -> str:
    """
    Return the full name of the first node that is no simulated robot.

    The name is empty if all of them are.
    """
    for name, namespace in subscribers:
        if not _publishes(node, name, namespace, SIMULATED_ROBOT):
            return full_name(name, namespace)
    return ''


def _publishes(node: Node, name: str, namespace: str, last_name: str) -> bool:
    """Return whether a node publishes a topic with this last part of its name."""
    try:
        topics = node.get_publisher_names_and_types_by_node(name, namespace)
    # It ended, or its name is unknown yet
    except (NodeNameNonExistentError, RuntimeError):
        return False
    return any(topic.rpartition('/')[2] == last_name for topic, _ in topics)
