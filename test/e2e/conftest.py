"""What the tests of the node share: a ROS domain of their own, a node, a client."""

import os
import sys

import pytest
from ros_domain import own_domain

try:
    import kane_dynamics_interfaces  # noqa: F401
    import rclpy
except ImportError:
    rclpy = None
    collect_ignore_glob = ['test_node_*.py']

if rclpy is not None:
    # Before anything joins a domain: this run talks to itself alone.
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ['ROS_DOMAIN_ID'] = own_domain()
    os.environ.setdefault('AMENT_PREFIX_PATH', sys.prefix)


@pytest.fixture(scope='session')
def participant():
    """Return the one client of this run: discovery takes seconds, so it happens once."""
    import node_process
    client = node_process.start_client()
    yield client
    client.close()


@pytest.fixture
def client(participant):
    """Return the client as if it were new."""
    import node_process
    participant.joints = node_process.JOINTS
    participant.torques.clear()
    participant.commands.clear()
    participant.diagnostics.clear()
    return participant


@pytest.fixture
def start():
    """Return a function that starts nodes; they are ended with the test."""
    import node_process
    running = []

    def start(*arguments, **parameters):
        if not {'urdf', 'robot_description'} & set(parameters):
            parameters = {'robot_description': f"'{node_process.URDF}'", **parameters}
        process = node_process.Process(*arguments, **parameters)
        running.append(process)
        return process

    yield start
    node_process.end_all(running)
