"""The nodes that publish on a topic of commands."""

from types import SimpleNamespace

from kane_dynamics.ros.common.command_topic import CommanderCount
import pytest


class Graph:
    """A node's view of the publishers of one topic."""

    def __init__(self, *names):
        self.names = list(names)
        self.queries = 0

    def resolve_topic_name(self, topic):
        return f'/{topic}'

    def count_publishers(self, topic):
        return len(self.names)

    def get_publishers_info_by_topic(self, topic):
        self.queries += 1
        return [SimpleNamespace(node_namespace='/', node_name=name)
                for name in self.names]

    def get_publisher_names_and_types_by_node(self, name, namespace):
        return {'torque_guard': [('/arm/guard_state', ['x'])]}.get(name, [])


def test_a_second_commander_that_follows_another_is_named():
    graph = Graph('arm', 'first')
    count = CommanderCount(graph, 'commands')
    assert count.update() == ['/arm', '/first']
    graph.names = ['arm', 'second']
    assert count.update() == ['/arm', '/second']


@pytest.mark.parametrize('names', [('arm',), ('arm', 'torque_guard')])
def test_one_commander_is_asked_for_once_with_and_without_its_guard(names):
    graph = Graph(*names)
    count = CommanderCount(graph, 'commands')
    for _ in range(3):
        assert count.update() == ['/arm']
    assert graph.queries == 1
