"""The nodes at a topic of commands: publishers, and simulated robots that subscribe."""

from types import SimpleNamespace

from kane_dynamics.ros.common import command_topic
from kane_dynamics.ros.common.command_topic import (
    CommanderCount, not_simulated, SubscriberWatch)
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
        return {'torque_guard': [('/arm/guard_state', ['x'])],
                'plant': [('/plant/simulated_robot', ['x'])]}.get(name, [])

    def get_subscriptions_info_by_topic(self, topic):
        return self.get_publishers_info_by_topic(topic)


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


@pytest.mark.parametrize(('names', 'reason'), [
    ((), 'nothing subscribes to /commands'),
    (('_ros2cli_1',), 'nothing subscribes to /commands'),
    (('plant',), ''), (('plant', '_ros2cli_1'), ''), (('plant', 'rosbag2_recorder'), ''),
    (('controller',), '/controller subscribes to /commands'),
    (('plant', 'controller'), '/controller subscribes to /commands'),
    (('_NODE_NAME_UNKNOWN_', 'plant'), '/_NODE_NAME_UNKNOWN_ subscribes to /commands')])
def test_only_a_topic_whose_subscribers_are_all_simulated_robots_is_simulated(
        names, reason):
    assert not_simulated(Graph(*names), 'commands') == reason


@pytest.mark.parametrize(('name', 'allowed'),
                         [('controller', 0.2), ('_NODE_NAME_UNKNOWN_', 1.0)])
def test_a_new_subscriber_has_a_short_time_to_show_that_it_is_a_simulated_robot(
        name, allowed, monkeypatch):
    now = 100.0
    monkeypatch.setattr(command_topic.time, 'monotonic', lambda: now)
    graph = Graph('plant')
    graph.count_subscribers = graph.count_publishers
    watch = SubscriberWatch(graph, 'commands')
    assert watch.real_subscriber() == ''
    graph.names.append(name)
    assert watch.real_subscriber() == ''
    now += 0.9 * allowed
    assert watch.real_subscriber() == ''
    now += 0.2 * allowed
    assert watch.real_subscriber() == f'/{name}'
