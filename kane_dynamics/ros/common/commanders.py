"""The nodes that publish on a topic of commands."""

from rclpy.node import Node, NodeNameNonExistentError

UNKNOWN = '_UNKNOWN_'  # part of the name of a node that is not known yet
GUARD_STATE = 'guard_state'  # a topic that only torque_guard publishes


def commanders(node: Node, topic: str) -> list[str]:
    """
    Return the full names of the nodes that publish on a topic, without torque_guard.

    A name appears once for each publisher. Only one guard is left out.
    """
    names = [f'{end.node_namespace.rstrip("/")}/{end.node_name}'
             for end in node.get_publishers_info_by_topic(node.resolve_topic_name(topic))]
    if len(names) < 2:
        return names
    guard = next((name for name in names if _is_guard(node, name)), None)
    if guard is not None:
        names.remove(guard)
    return names


class CommanderCount:
    """
    The number of publishers of a topic, and the name of one.

    The graph is asked for the name only after the number changed: a query for names holds the
    interpreter's lock, which delays the torque path.

    Parameters
    ----------
    node : Node
    topic : str

    """

    def __init__(self, node: Node, topic: str) -> None:
        self._node, self._topic = node, node.resolve_topic_name(topic)
        self._count = 0
        self.names: list[str] = []

    def update(self) -> list[str]:
        """Return the names; those that are not known yet are asked for again."""
        count = self._node.count_publishers(self._topic)
        # Of several, one may end and another begin between two updates.
        if count != self._count or len(self.names) > 1 or any(
                UNKNOWN in name for name in self.names):
            self._count, self.names = count, commanders(self._node, self._topic)
        return self.names


def several_commanders(names: list[str]) -> str:
    """Return the warning about more than one publisher on a topic of commands."""
    return (f'{len(names)} publishers ({", ".join(sorted(names))}); expected one dynamics node '
            'with its torque_guard, stop the others (a killed one is listed for 20 s)')


def _is_guard(node: Node, name: str) -> bool:
    namespace, _, bare = name.rpartition('/')
    try:
        topics = node.get_publisher_names_and_types_by_node(bare, namespace or '/')
    except (NodeNameNonExistentError, RuntimeError):  # it ended, or its name is not known yet
        return False
    return any(topic.rpartition('/')[2] == GUARD_STATE for topic, _ in topics)
