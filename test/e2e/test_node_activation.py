"""When a node with autostart begins to command: at once for simulated robots only."""

from graph import wait_until
import pytest
from std_msgs.msg import Float64MultiArray

PLANT = 'kane_dynamics.ros.plant.plant_main'


@pytest.fixture
def robot(client):
    """Return a client that does not subscribe to the commands."""
    client.listen(False)
    yield client
    client.listen(True)


def test_a_node_commands_the_plant_by_itself_and_a_controller_only_when_asked(robot, start):
    controller = robot.create_subscription(Float64MultiArray, 'commands', lambda message: None, 1)
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
    node.wait_for('active without torque_guard: if this process died', 5.0)


def test_a_node_without_urdf_says_what_it_waits_for_again_and_again(start):
    node = start(robot_description="''")
    words = ('waiting for a URDF on topic robot_description (/robot_description: no publisher), '
             'because the parameters urdf and robot_description are empty')
    node.wait_for(words)
    assert wait_until(lambda: node.log.count(words) > 1, 15.0)
