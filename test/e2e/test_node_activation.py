"""When a node with autostart begins to command: at once for simulated robots only."""

import time

from lifecycle_msgs.msg import Transition
from node_process import wait_until
import pytest
import rclpy
from std_msgs.msg import Float64MultiArray

PLANT = 'kane_dynamics.ros.plant.main'


@pytest.fixture
def robot(client):
    """Return a client that does not subscribe to the commands."""
    client.listen(False)
    yield client
    client.listen(True)


def test_a_node_commands_the_plant_by_itself_and_a_controller_only_when_asked(
        robot, start):
    controller = robot.create_subscription(Float64MultiArray, 'commands',
                                           lambda message: None, 1)
    plant = start(module=PLANT)
    node = start(activation='simulated', guard__enabled=False)
    node.wait_for('configured; commands begin once only simulated robots subscribe')
    plant.wait_for('joint states/s')
    node.wait_for('/client subscribes to /commands; activation is simulated', 20.0)
    assert wait_until(lambda: any('inactive: /client subscribes to /commands' in message
                                  and level == b'\1'
                                  for level, message, _ in robot.diagnostics), 5.0)
    assert ': active' not in node.log
    robot.destroy_subscription(controller)
    node.wait_for('active, mode inverse_dynamics', 10.0)
    assert 'active without torque_guard' not in node.log  # harmless for simulated robots


def test_a_node_that_commands_the_plant_by_itself_stops_when_a_controller_subscribes(
        robot, start):
    node = start(activation='simulated', guard__enabled=False)
    start(module=PLANT)
    node.wait_for('active, mode inverse_dynamics', 60.0)
    # Hidden nodes and further simulated robots may subscribe.
    hidden = rclpy.create_node('_ros2cli_7')
    hidden.create_subscription(Float64MultiArray, 'commands', lambda message: None, 1)
    start('-r', '__node:=second', module=PLANT).wait_for('joint states/s')
    assert wait_until(lambda: robot.count_subscribers('commands') == 3, 15.0)
    time.sleep(0.6)
    assert robot.state() == 'active' and 'deactivated' not in node.log
    hidden.destroy_node()
    received = []
    controller = robot.create_subscription(
        Float64MultiArray, 'commands',
        lambda message: received.append(list(message.data)), 10)
    node.wait_for(
        'deactivated: /client subscribes to /commands and is no simulated robot; '
        'expected simulated robots alone', 15.0)
    assert wait_until(lambda: robot.state() == 'inactive')
    assert not any(received[-1])
    count = len(received)
    assert wait_until(
        lambda: any(message.startswith('inactive: deactivated: /client subscribes')
                    and level == b'\1' for level, message, _ in robot.diagnostics))
    robot.destroy_subscription(controller)
    time.sleep(0.5)
    assert robot.state() == 'inactive' and len(received) == count
    # On request the node commands any robot.
    controller = robot.create_subscription(
        Float64MultiArray, 'commands',
        lambda message: received.append(list(message.data)), 10)
    assert robot.transition(Transition.TRANSITION_ACTIVATE)
    time.sleep(1.0)
    assert robot.state() == 'active' and any(received[-1])
    node.wait_for('active without torque_guard: if this process died', 5.0)
    robot.destroy_subscription(controller)


def test_a_node_without_urdf_says_what_it_waits_for_again_and_again(start):
    node = start(robot_description="''")
    words = ('waiting for a URDF on topic robot_description (/robot_description: no '
             'publisher), because the parameters urdf and robot_description are empty')
    node.wait_for(words)
    assert wait_until(lambda: node.log.count(words) > 1, 15.0)
