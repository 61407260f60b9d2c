"""
The nodes that publish on a topic of commands: several must not command one arm.

Queries for the names of nodes hold the interpreter's lock; they are made only after the
number of publishers changed.
"""

from rclpy.node import Node, NodeNameNonExistentError

UNKNOWN = '_UNKNOWN_'  # part of the name of a node that is not known yet
GUARD_STATE = 'guard_state'  # a topic that only torque_guard publishes


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


def full_name(name: str, namespace: str) -> str:
    """Return the full name of a node."""
    return f"{namespace.rstrip('/')}/{name}"


def _publishes(node: Node, name: str, namespace: str, last_name: str) -> bool:
    """Return whether a node publishes a topic with this last part of its name."""
    try:
        topics = node.get_publisher_names_and_types_by_node(name, namespace)
    # It ended, or its name is unknown yet
    except (NodeNameNonExistentError, RuntimeError):
        return False
    return any(topic.rpartition('/')[2] == last_name for topic, _ in topics)
