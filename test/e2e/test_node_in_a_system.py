"""The node in a larger system: a lifecycle manager's bond (not in a wheel), QoS."""

import os
import signal
from types import SimpleNamespace

from lifecycle_msgs.msg import Transition
from message_package import imported_package
from node_process import wait_until
import pytest
from rclpy.qos import ReliabilityPolicy

pytestmark = pytest.mark.timeout(900)  # the package is built at the first run
STATUS = """
std_msgs/Header header
string id
string instance_id
bool active
float32 heartbeat_timeout
float32 heartbeat_period
"""


@pytest.fixture
def manager(client):
    """Return the other side of the bond: what it has heard."""
    with imported_package('bond', {'msg/Status.msg': STATUS}):
        from bond.msg import Status
        received = []
        subscription = client.create_subscription(Status, 'bond', received.append, 100)
        yield SimpleNamespace(heard=received)
        client.destroy_subscription(subscription)


def test_a_manager_hears_the_node_while_it_is_active_and_not_when_it_hangs(
        client, start, manager):
    node = start(bond='true')
    node.wait_for('active, mode', 120.0)
    received = manager.heard
    assert wait_until(lambda: len(received) > 5, 10.0)
    first = received[-1]
    assert (first.id, first.active) == ('kane_dynamics', True)
    assert first.heartbeat_timeout == 4.0
    assert first.heartbeat_period == pytest.approx(0.1)
    assert {message.instance_id for message in received} == {first.instance_id}
    # It says so when it is deactivated, and another bond begins when it is active again.
    assert client.transition(Transition.TRANSITION_DEACTIVATE)
    assert wait_until(lambda: not received[-1].active)
    count = len(received)
    assert not wait_until(lambda: len(received) > count, 0.5)
    assert client.transition(Transition.TRANSITION_ACTIVATE)
    assert wait_until(lambda: received[-1].active)
    assert received[-1].instance_id != first.instance_id
    # A node that hangs is silent.
    os.kill(node.pid, signal.SIGSTOP)
    try:
        def is_silent():  # once what was sent before has arrived
            count = len(received)
            return not wait_until(lambda: len(received) > count, 0.5)
        assert wait_until(is_silent)
        count = len(received)
    finally:
        os.kill(node.pid, signal.SIGCONT)
    assert wait_until(lambda: len(received) > count)
    assert node.end()[0] == 0
    assert wait_until(lambda: not received[-1].active)


def test_without_the_package_the_node_warns_and_works(start):
    node = start(bond='true')
    node.wait_for('active, mode', 120.0)
    assert "parameter 'bond': true without bond/Status" in node.log


def test_qos_of_states_and_commands_may_be_changed(client, start, tmp_path):
    parameters = tmp_path / 'qos.yaml'
    parameters.write_text("""
        /**:
          ros__parameters:
            arm_compensates: none
            qos_overrides:
              /joint_states: {subscription: {reliability: reliable, depth: 2}}
              /commands: {publisher: {reliability: best_effort}}
        """)
    node = start('--params-file', str(parameters), torque_path='auto')
    node.wait_for('active, mode', 120.0)
    assert 'torque path: python (qos_overrides)' in node.log
    assert 'unknown' not in node.log

    def of_node(endpoints, topic):
        return [end.qos_profile.reliability for end in endpoints(topic)
                if end.node_name == 'kane_dynamics']

    def has(reliability, endpoints, topic):
        # Endpoints are known before the name of their node; those of nodes that ended
        # before are listed for a time.
        assert wait_until(lambda: reliability in of_node(endpoints, topic), 30.0), (
            topic, of_node(endpoints, topic), node.log)
    has(ReliabilityPolicy.RELIABLE, client.get_subscriptions_info_by_topic,
        'joint_states')
    has(ReliabilityPolicy.BEST_EFFORT, client.get_publishers_info_by_topic, 'commands')
    # Other topics keep their profiles.
    torques = 'kane_dynamics/joint_torques'
    assert ReliabilityPolicy.BEST_EFFORT not in of_node(
        client.get_publishers_info_by_topic, torques)
    has(ReliabilityPolicy.RELIABLE, client.get_publishers_info_by_topic, torques)
    assert client.transition(Transition.TRANSITION_DEACTIVATE)
    assert client.transition(Transition.TRANSITION_CLEANUP)
    assert client.transition(Transition.TRANSITION_CONFIGURE), node.log[-500:]
