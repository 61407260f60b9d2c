"""Lifecycle, sources of the URDF, and shutdown: zeros, exit code 0, within 2 s."""

import signal

from kane_dynamics._util.resources import resource_path
from kane_dynamics_interfaces.srv import GetDynamics, Simulate
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from node_process import NAME, URDF, wait_until
import numpy as np
import pytest
from std_msgs.msg import String

POSE = [0.3, -0.4, 0.2]
READY = 'kernels of answers and simulations ready'
NOT_CONFIGURED = 'node: not configured; expected a configured node'


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_gives_zeros_and_exit_code_0_within_2_s(client, start, number):
    node = start()
    client.connect()
    assert client.ask(POSE, np.zeros(3)).any()
    assert wait_until(lambda: client.commands and any(client.commands[-1]))
    client.call(Simulate, 'simulate', position=POSE, duration=1.0)
    code, seconds = node.end(number)
    assert code == 0, node.log
    assert seconds < 2.0
    assert wait_until(lambda: client.commands[-1] == [0.0, 0.0, 0.0])
    assert 'Traceback' not in node.log


def test_a_signal_before_the_urdf_is_known_gives_exit_code_0(start):
    node = start(robot_description="''")
    node.wait_for('waiting for a URDF')
    code, seconds = node.end(signal.SIGTERM)
    assert (code, seconds < 2.0) == (0, True)


def test_without_autostart_the_node_waits_for_transitions(client, start):
    start(autostart='false')
    assert client.state() == 'unconfigured'
    answer = client.call(GetDynamics, 'get_dynamics', position=POSE)
    assert (answer.success, answer.message) == (False, NOT_CONFIGURED)
    answer = client.call(Simulate, 'simulate', position=POSE, duration=1.0)
    assert (answer.success, answer.message) == (False, NOT_CONFIGURED)
    assert client.transition(Transition.TRANSITION_CONFIGURE)
    assert client.call(GetDynamics, 'get_dynamics', position=POSE).success
    assert client.rest() is None, 'an inactive node commands nothing'
    assert client.transition(Transition.TRANSITION_ACTIVATE)
    client.connect()
    assert client.ask(POSE, np.zeros(3)).any()
    assert client.transition(Transition.TRANSITION_ACTIVE_SHUTDOWN)
    assert wait_until(lambda: client.commands[-1] == [0.0, 0.0, 0.0])
    assert client.state() == 'finalized'


def test_transitions_of_several_clients_at_once_are_done_one_after_the_other(
        client, start):
    node = start(autostart='false')
    name = f'{NAME}/change_state'
    clients = [client.create_client(ChangeState, name) for _ in range(3)]
    assert wait_until(lambda: all(one.service_is_ready() for one in clients))
    transitions = (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE,
                   Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP)
    answers = []
    for k in range(24):
        # Each client is one transition further than the one before it.
        for place, one in enumerate(clients):
            transition = Transition(id=transitions[(k + place) % 4])
            answers.append(one.call_async(ChangeState.Request(transition=transition)))
        if k % 4 == 3:
            wait_until(lambda: all(answer.done() for answer in answers), 5.0)
    assert wait_until(lambda: client.state() in ('unconfigured', 'inactive', 'active'))
    assert 'callback failed' not in node.log, node.log
    code, _ = node.end(signal.SIGTERM)
    assert code == 0, node.log


@pytest.fixture
def cold(start, tmp_path):
    """Return a node that has just begun to command, with no kernels cached."""
    node = start(urdf=resource_path('urdf', 'fr3.urdf'),
                 environment={'KANE_DYNAMICS_CACHE': str(tmp_path / 'cache')})
    node.wait_for('active, mode')
    assert READY not in node.log
    return node


def test_a_request_that_comes_before_its_kernels_waits_for_them(client, cold):
    q = np.zeros(8).tolist()
    assert client.call(GetDynamics, 'get_dynamics', position=q).success
    answer = client.call(Simulate, 'simulate', timeout=100.0, position=q, duration=0.1)
    assert answer.success, answer.message
    cold.wait_for(READY)


def test_a_node_is_cleaned_up_configured_and_ended_while_kernels_compile(client, cold):
    for transition in ('DEACTIVATE', 'CLEANUP', 'CONFIGURE', 'ACTIVATE'):
        assert client.transition(getattr(Transition,
                                         f'TRANSITION_{transition}')), transition
    code, _ = cold.end()
    assert code == 0, cold.log
    assert 'Traceback' not in cold.log


@pytest.fixture
def description(client):
    with client.describing() as publisher:
        yield publisher


def test_a_changed_urdf_on_the_topic_is_used_at_the_next_configuration(
        client, start, description):
    node = start(robot_description="''")
    node.wait_for('waiting for a URDF')
    description.publish(String(data='<robot name="x"><link name="l"'))
    node.wait_for('not configured: ')
    assert client.state() == 'unconfigured'
    description.publish(String(data=URDF))
    node.wait_for('active, mode')
    client.connect()
    torque_before = client.ask(POSE, np.zeros(3))
    heavier = URDF.replace('value="2.0"', 'value="4.0"')
    description.publish(String(data=heavier))
    node.wait_for('robot_description: changed while the node is active and ignored')
    assert (client.ask(POSE, np.zeros(3)) == torque_before).all()
    assert client.transition(Transition.TRANSITION_DEACTIVATE)
    description.publish(String(data=URDF))
    node.wait_for('changed; clean up and configure the node')
    description.publish(String(data=heavier))
    assert wait_until(lambda: node.log.count('changed; clean up and') == 2)
    assert client.transition(Transition.TRANSITION_CLEANUP)
    assert client.adjust(imu__topic='no topic!').successful
    assert not client.transition(Transition.TRANSITION_CONFIGURE)
    assert client.adjust(imu__topic='').successful
    for step in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
        assert client.transition(step)
    client.connect()
    assert np.abs(client.ask(POSE,
                             np.zeros(3))).max() > 1.2 * np.abs(torque_before).max()
    # What failed to open has left nothing behind.
    assert wait_until(lambda: client.count_publishers('commands') == 1), (
        client.get_publishers_info_by_topic('commands'))


def test_an_invalid_urdf_leaves_the_node_unconfigured_with_the_reason(client, start):
    node = start(urdf='/no/such/file.urdf')
    node.wait_for('not configured: ')
    assert '/no/such/file.urdf' in node.log
    assert client.state() == 'unconfigured'


@pytest.mark.parametrize(('words', 'parameters'), [
    ("parameter 'mode': 'fly'; expected one of inverse_dynamics", {'mode': 'fly'}),
    ("parameter 'state_timeout': 0", {'state_timeout': 0.0}),
    ("parameter 'gravity': 'down'", {'gravity': 'down'}),
    ('autostart', {'autostart': 3}),
])
def test_an_invalid_initial_parameter_ends_the_process_with_the_reason(
        start, words, parameters):
    node = start(**parameters)
    assert wait_until(lambda: not node.alive(), 60.0)
    assert node.end()[0] == 2  # which launch does not start again
    assert words in node.log


def test_an_unknown_parameter_gives_a_warning(start):
    node = start(robot_description="''", state_timout=0.2)
    node.wait_for("parameter 'state_timout': unknown and ignored; expected "
                  "'state_timeout'")


def test_names_follow_namespace_and_remapping(client, start):
    node = start('-r', '__ns:=/left', '-r', 'commands:=effort_controller/commands')
    node.wait_for('active, mode')
    assert client.call(GetDynamics, '/left/kane_dynamics/get_dynamics',
                       position=POSE).success
    topics = dict(client.get_topic_names_and_types())
    assert {'/left/effort_controller/commands', '/left/joint_states',
            '/left/kane_dynamics/joint_torques', '/diagnostics'} <= set(topics)


@pytest.mark.parametrize(('name', 'words'), [
    ('fr3.yaml', 'the arm adds gravity and friction to commanded efforts itself'),
    ('ur10e.yaml', 'the arm adds gravity and friction to commanded efforts itself'),
    ('two_link.yaml', 'the arm adds nothing to commanded efforts itself')])
def test_every_shipped_configuration_starts_a_node(start, name, words):
    node = start('--params-file', str(resource_path('config', name)),
                 robot_description='""')
    node.wait_for('active, mode ')
    assert words in node.log
    warnings = [line for line in node.log.splitlines() if '[WARN]' in line]
    assert len(warnings) <= 1
    assert all('active without torque_guard' in line for line in warnings)
    assert 'unknown and ignored' not in node.log
    assert node.end()[0] == 0
