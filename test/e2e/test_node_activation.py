"""When a node with autostart begins to command: when it is activated."""

from lifecycle_msgs.msg import Transition
from node_process import wait_until

PLANT = 'kane_dynamics.ros.plant.main'


def test_a_node_commands_only_when_it_is_activated_and_says_so(client, start):
    plant = start(module=PLANT)
    node = start(activation=None, guard__enabled=False)
    node.wait_for('configured; commands begin with the transition `activate`')
    plant.wait_for('joint states/s')
    assert client.state() == 'inactive' and 'active' not in node.log.replace(
        'activate', '')
    assert not client.commands
    assert client.transition(Transition.TRANSITION_ACTIVATE)
    node.wait_for('active without torque_guard: if this process died', 5.0)
    node.wait_for('mode inverse_dynamics: feedforward without feedback')
    assert wait_until(lambda: client.commands, 10.0)


def test_a_node_of_a_simulated_arm_activates_itself_if_it_is_asked_to(client, start):
    start(module=PLANT).wait_for('joint states/s')
    node = start(activation='at_once', guard__enabled=False)
    node.wait_for('active, mode inverse_dynamics')
    assert wait_until(lambda: client.commands, 10.0)
    assert 'active without torque_guard' not in node.log  # harmless for simulated robots


def test_a_node_without_urdf_says_what_it_waits_for_again_and_again(start):
    node = start(robot_description="''")
    words = ('waiting for a URDF on topic robot_description (/robot_description: no '
             'publisher), because the parameters urdf and robot_description are empty')
    node.wait_for(words)
    assert wait_until(lambda: node.log.count(words) > 1, 15.0)
