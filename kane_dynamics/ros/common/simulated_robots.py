"""Simulated robots in the ROS graph: the only ones that a node commands without being asked."""

from kane_dynamics.ros.common.commanders import UNKNOWN
from rclpy.node import Node, NodeNameNonExistentError

SIMULATED_ROBOT = 'simulated_robot'  # a topic that simulated robots publish
HIDDEN = '_'  # first letter of the names of hidden nodes, such as those of the ros2 command line


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
    names = {(end.node_name, end.node_namespace)
             for end in node.get_subscriptions_info_by_topic(topic)
             if not end.node_name.startswith(HIDDEN) or UNKNOWN in end.node_name}
    if not names:
        return f'nothing subscribes to {topic}'
    for name, namespace in sorted(names):
        if not _is_simulated(node, name, namespace):
            return f"{namespace.rstrip('/')}/{name} subscribes to {topic}"
    return ''


def _is_simulated(node: Node, name: str, namespace: str) -> bool:
    """Return whether a node publishes the topic of simulated robots."""
    try:
        topics = node.get_publisher_names_and_types_by_node(name, namespace)
    except (NodeNameNonExistentError, RuntimeError):  # it ended
        return False
    return any(topic.rpartition('/')[2] == SIMULATED_ROBOT for topic, _ in topics)
