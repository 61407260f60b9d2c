"""A node's executor: rclpy's fast one wherever it is, and a warning elsewhere."""

import sys
from types import ModuleType, SimpleNamespace

from kane_dynamics.ros.common.process import events_executor, make_executor
import pytest
import rclpy.executors
from rclpy.executors import SingleThreadedExecutor


@pytest.fixture
def node():
    warnings = []
    return SimpleNamespace(warnings=warnings,
                           get_logger=lambda: SimpleNamespace(warning=warnings.append))


@pytest.fixture
def executors(monkeypatch):
    """Make executors that only note their node; return the nodes."""
    added = []
    monkeypatch.setattr(SingleThreadedExecutor, '__init__', lambda self: None)
    monkeypatch.setattr(SingleThreadedExecutor, 'add_node',
                        lambda self, node: added.append(node))
    monkeypatch.setattr(SingleThreadedExecutor, '__del__', lambda self: None,
                        raising=False)
    return added


class Events:

    def __init__(self):
        self.nodes = []

    def add_node(self, node):
        self.nodes.append(node)


def test_the_executor_of_this_rclpy_is_found():
    assert events_executor().__name__ == 'EventsExecutor'


@pytest.mark.parametrize('home', ['rclpy.experimental', 'rclpy.executors'])
def test_the_events_executor_is_found_beside_the_others_too(monkeypatch, node, home):
    monkeypatch.setitem(sys.modules, 'rclpy.experimental',
                        ModuleType('rclpy.experimental'))
    monkeypatch.setattr(sys.modules[home], 'EventsExecutor', Events, raising=False)
    assert make_executor(node).nodes == [node]
    assert not node.warnings


def test_another_executor_is_never_used_without_a_warning(monkeypatch, node, executors):
    monkeypatch.setitem(sys.modules, 'rclpy.experimental', None)
    assert not hasattr(rclpy.executors, 'EventsExecutor')
    assert isinstance(make_executor(node), SingleThreadedExecutor)
    assert executors == [node]
    assert len(node.warnings) == 1
    assert 'without EventsExecutor; expected 7.1.4 or newer' in node.warnings[0]
