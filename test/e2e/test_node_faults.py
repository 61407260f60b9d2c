"""
Faults of a plant, a network or an operator, and what the node does then.

Faults of single messages (order, names, NaN, lengths, stamps) stand in
test_node_torques.py, those of URDFs in test_node_lifecycle.py.
"""

import os
from pathlib import Path
import signal
import time

from kane_dynamics import Robot
from kane_dynamics.ros.common.transport import without_shared_memory
from kane_dynamics_interfaces.srv import InverseDynamics, Simulate
from lifecycle_msgs.msg import Transition
from node_process import BEST_EFFORT, JOINTS, model, NAME, UNCHECKED, URDF, wait_until
import numpy as np
import pytest
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Empty, Float64MultiArray, String

Q = np.array([0.3, -0.4, 0.2])
SECOND = 10**9


def close(value, expected):
    return value is not None and np.abs(value - expected).max() <= 1e-12 * np.abs(
        expected).max()


@pytest.fixture(scope='module')
def holding():
    """Return the torques that hold the pose Q."""
    return Robot(model()).gravity_force(Q)


def test_a_lost_plant_gives_zeros_and_a_restart_with_another_joint_order_is_accepted(
        client, start, holding):
    start(state_timeout=0.2)
    client.connect()
    assert close(client.ask(Q, np.zeros(3)), holding)
    client.destroy_publisher(client.states)
    assert wait_until(lambda: client.commands[-1] == [0.0, 0.0, 0.0], 2.0)
    client.states = client.create_publisher(JointState, 'joint_states', BEST_EFFORT)
    client.connect()
    order = [2, 0, 1]
    assert close(client.ask(Q[order], np.zeros(3), [JOINTS[k] for k in order]), holding)


@pytest.mark.parametrize('torque_path', ['native', 'python'])
@pytest.mark.parametrize('action', ['zero', 'hold'])
def test_after_a_failed_callback_the_arm_is_free_or_held_as_state_check_says(
        client, start, holding, action, torque_path, monkeypatch):
    helpers = Path(__file__).parents[1] / 'helpers'
    # In a colcon workspace the package itself is found by this variable.
    monkeypatch.setenv('PYTHONPATH', str(helpers), prepend=os.pathsep)
    node = start(module='blocked_node', activation='at_once', arm_compensates='none',
                 limits__rate='.inf', torque_path=torque_path,
                 state_check__action=action, state_timeout=5.0, **UNCHECKED)
    client.connect()
    assert close(client.ask(Q, np.zeros(3)), holding)
    failures = client.create_publisher(Empty, f'{NAME}/fail', 1)
    assert wait_until(failures.get_subscription_count)
    failures.publish(Empty())
    node.wait_for('callback failed: RuntimeError: on purpose')
    if action == 'zero':
        assert wait_until(lambda: not any(client.commands[-1]), 2.0)
    else:
        count = len(client.commands)
        assert close(client.ask(Q, np.zeros(3)), holding)
        assert np.array(client.commands[count:]).any(axis=1).all()
    client.destroy_publisher(failures)


@pytest.mark.parametrize('discovery', ['LOCALHOST', 'OFF'])
def test_with_its_guard_a_node_that_dies_blocks_no_publisher_for_it_has_no_shared_memory(
        client, start, holding, monkeypatch, discovery):
    assert 'fastrtps_port' in Path(
        '/proc/self/maps').read_text(), 'this process has some'
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', discovery)
    node = start(environment=without_shared_memory(), guard__enabled='true')
    node.wait_for('active, mode')
    assert 'fastrtps_port' not in Path(f'/proc/{node.pid}/maps').read_text()
    if discovery == 'LOCALHOST':
        client.connect()
        assert close(client.ask(Q, np.zeros(3)), holding)


def test_transports_that_a_user_chose_remain(monkeypatch):
    monkeypatch.setenv('FASTDDS_BUILTIN_TRANSPORTS', 'LARGE_DATA')
    assert without_shared_memory() == {}


def test_simulated_time_may_pause_and_jump_forward_and_backward(client, start, holding):
    node = start(use_sim_time='true', state_timeout=0.5)
    node.wait_for('active, mode')
    assert wait_until(lambda: client.motions.get_subscription_count())
    client.follow([(0.0, [0, 0, 0]), (50.0, [1, 1, 0.1])])
    node.wait_for(
        'joint_trajectory rejected: use_sim_time: true without a message on /clock')
    publisher = client.create_publisher(Clock, '/clock', 1)

    def at(seconds):
        message = Clock()
        message.clock.sec, message.clock.nanosec = divmod(round(seconds * SECOND),
                                                          SECOND)
        publisher.publish(message)
        time.sleep(0.05)
        return round(seconds * SECOND)

    assert wait_until(
        lambda: client.ask(Q, np.zeros(3), stamp=at(100.0), timeout=0.1) is not None)
    client.follow([(0.0, [0, 0, 0]), (50.0, [1, 1, 0.1])], start=at(100.0))
    assert wait_until(
        lambda: not close(client.ask(Q, np.zeros(3), stamp=at(100.1), timeout=0.1),
                          holding))
    count = len(client.commands)
    time.sleep(0.8)  # paused clock: no timeout, and the same stamp is valid
    assert len(client.commands) == count
    assert client.ask(Q, np.zeros(3), stamp=round(100.1 * SECOND)) is not None
    client.torques.clear()
    assert close(client.ask(Q, np.zeros(3), stamp=at(50.0)),
                 holding), 'the motion is dropped'
    node.wait_for('jumped backward')
    assert client.ask(Q, np.zeros(3), stamp=at(5000.0)) is not None
    assert client.ask(Q, np.zeros(3), stamp=round(60.0 * SECOND), timeout=0.2) is None
    assert wait_until(lambda: any(client.commands[-1]))
    client.destroy_publisher(publisher)  # not a pause: the publisher is gone
    assert wait_until(lambda: not any(client.commands[-1]), 5.0)
    node.wait_for('/clock has no publisher; commanding zeros')


def test_an_active_node_keeps_its_clock_and_the_limits_that_it_needs(
        client, start, holding):
    start(state_timeout=5.0)
    client.connect()
    assert close(client.ask(Q, np.zeros(3)), holding)
    for name, value, words in (
            ('use_sim_time', True, 'expected no change while the node is active'),
            ('limits.effort', 1e-300, 'expected at least'),
            ('limits.velocity', 1e-300, 'expected at least'),
            ('limits.rate', 1e-300, 'expected at least')):
        answer = client.adjust(**{name.replace('.', '__'): value})
        assert not answer.successful
        assert words in answer.reason
        assert close(client.ask(Q, np.zeros(3)), holding)


def test_a_second_publisher_of_joint_states_gives_a_warning(client, start):
    node = start(state_timeout=60.0)
    client.connect()
    second = client.create_publisher(JointState, 'joint_states', BEST_EFFORT)
    node.wait_for('2 publishers on joint_states: expected one with joints of this arm',
                  5.0)
    client.diagnostics.clear()
    assert wait_until(
        lambda: any('2 publishers on joint_states' in message and level != b'\0'
                    for level, message, _ in client.diagnostics), 5.0)
    client.destroy_publisher(second)
    client.diagnostics.clear()
    assert wait_until(lambda: any(values.get('publishers of joint states') == '1'
                                  for _, _, values in client.diagnostics), 5.0)
    # A publisher of other joints does not count.
    gripper = client.create_publisher(JointState, 'joint_states', BEST_EFFORT)
    client.diagnostics.clear()

    def three_reports():
        gripper.publish(JointState(name=['finger'], position=[0.0], velocity=[0.0]))
        time.sleep(0.1)
        return len(client.diagnostics) >= 4 and client.rest() is not None
    assert wait_until(three_reports)
    assert client.diagnostics[-1][2]['publishers of joint states'] == '1'
    assert client.diagnostics[-1][2]['states dropped'] == '0'
    client.destroy_publisher(gripper)


def test_joint_states_in_parts_are_reported_once_with_the_reason(client, start):
    node = start(state_timeout=60.0)
    client.connect()
    words = ('joint_states: in parts, [reach] and [turn, lift], which give no torques; '
             'expected all')

    def reported():
        client.send([0.0, 0.0], [0.0, 0.0], names=('turn', 'lift'))
        client.send([0.0], [0.0], names=('reach',))
        time.sleep(0.05)
        return words in node.log and any(words in message
                                         for _, message, _ in client.diagnostics)
    assert wait_until(reported), node.log
    client.diagnostics.clear()
    assert wait_until(lambda: reported() and len(client.diagnostics) > 2)
    assert node.log.count(words) == 1


def test_states_that_the_node_does_not_read_in_time_are_counted_and_reported(
        client, start):
    node = start(state_timeout=60.0)
    client.connect()
    assert client.rest() is not None
    client.diagnostics.clear()
    assert wait_until(lambda: any(values['states lost'].isdigit()
                                  for _, _, values in client.diagnostics), 5.0)
    lost_before = int(client.diagnostics[-1][2]['states lost'])
    os.kill(node.pid, signal.SIGSTOP)
    try:
        for _ in range(500):
            client.send(Q)
    finally:
        os.kill(node.pid, signal.SIGCONT)
    client.diagnostics.clear()
    assert wait_until(
        lambda: any('of the joint states lost: the node or the network' in message
                    and level == b'\1' and int(values['states lost']) > lost_before
                    for level, message, values in client.diagnostics), 5.0)


def test_a_second_node_that_commands_is_reported_in_log_and_diagnostics(client, start):
    node = start(state_timeout=60.0)
    client.connect()
    client.diagnostics.clear()
    second = client.create_publisher(Float64MultiArray, 'commands', 1)
    try:
        node.wait_for(
            'commands: 2 publishers (/client, /kane_dynamics); expected one dynamics '
            'node', 10.0)
        assert wait_until(
            lambda: any('commands: 2 publishers' in message and level == b'\2'
                        for level, message, _ in client.diagnostics), 5.0)
    finally:
        client.destroy_publisher(second)
    start(state_timeout=60.0)  # a second node of the same name
    node.wait_for('commands: 2 publishers (/kane_dynamics, /kane_dynamics)', 60.0)


def test_overflowing_states_give_no_command_and_the_next_state_does(
        client, start, holding):
    start(state_timeout=1.0)
    client.connect()
    for k in range(3):
        q = Q.copy()
        q[k] = 1e308
        answer = client.ask(q, np.zeros(3), timeout=0.2)
        limit = Robot(model()).limits.effort
        assert answer is None or (np.abs(answer) <= limit).all()
    assert client.ask(
        Q, [1e308] * 3) is not None, 'gravity alone does not depend on the speed'
    assert close(client.ask(Q, np.zeros(3)), holding)


def test_after_sigkill_the_last_command_stays_until_a_new_node_starts(
        client, start, holding):
    node = start(state_timeout=0.2)
    client.connect()
    assert close(client.ask(Q, np.zeros(3)), holding)
    assert wait_until(lambda: client.commands and any(client.commands[-1]))
    assert node.end(signal.SIGKILL)[0] == -signal.SIGKILL
    count = len(client.commands)
    time.sleep(0.6)
    # No zeros are published: a controller needs its own timeout.
    assert len(client.commands) == count
    assert any(client.commands[-1])
    start(state_timeout=0.2)
    client.connect()
    assert close(client.ask(Q, np.zeros(3)), holding)


def test_deactivation_during_a_motion_commands_zeros_and_drops_it(
        client, start, holding):
    start(state_timeout=1.0)
    client.connect()
    client.follow([(0.0, [0, 0, 0]), (20.0, [1.0, 1.0, 0.2])])
    assert wait_until(lambda: not close(client.ask(Q, np.zeros(3)), holding), 3.0)
    assert client.transition(Transition.TRANSITION_DEACTIVATE)
    assert wait_until(lambda: client.commands[-1] == [0.0, 0.0, 0.0])
    assert client.transition(Transition.TRANSITION_ACTIVATE)
    client.connect()
    assert close(client.ask(Q, np.zeros(3)), holding)


def test_a_flood_of_requests_is_answered_in_order_and_the_rest_refused_as_busy(
        client, start, holding):
    start(state_timeout=1.0)
    client.connect()
    # With the default depth, a client loses responses that arrive faster than it reads
    # them.
    deep = QoSProfile(depth=200)
    simulations = client.create_client(Simulate, f'{NAME}/simulate', qos_profile=deep)
    torques = client.create_client(InverseDynamics, f'{NAME}/inverse_dynamics',
                                   qos_profile=deep)

    def answered(requests):
        return all(one_request.done() for one_request in requests)
    assert simulations.wait_for_service(10.0) and torques.wait_for_service(10.0)
    request = Simulate.Request(position=Q.tolist(), duration=1000.0)
    pending = [simulations.call_async(request) for _ in range(60)]
    state = InverseDynamics.Request(position=Q.tolist(), acceleration=[0.0] * 3)
    short = [torques.call_async(state) for _ in range(60)]
    assert close(client.ask(Q, np.zeros(3)), holding)
    assert wait_until(lambda: answered(short), 20.0)
    assert not pending[3].done(), 'short requests do not wait for simulations'
    for one_request in short:
        assert close(np.array(one_request.result().effort), holding)
    assert wait_until(lambda: answered(pending), 60.0)
    served = []
    for k, one_request in enumerate(pending):
        answer = one_request.result()
        if answer.success:
            served.append(k)
        else:
            assert 'busy' in answer.message
    assert served[:4] == [0, 1, 2, 3]
    assert len(served) < 30


def test_malformed_messages_give_no_command_and_are_counted(client, start, holding):
    start(state_timeout=1.0)
    client.connect()
    good = serialize_message(
        JointState(name=list(JOINTS), position=[0.0] * 3, velocity=[0.0] * 3))
    count_before = len(client.torques)
    for data in (b'\0\1\0\0', good[:40], good[:4] + b'\xff' * 60,
                 b'\0\1\0\0' + bytes(12)):
        client.states.publish(data)
        time.sleep(0.02)
    assert close(client.ask(Q, np.zeros(3)), holding)
    assert len(client.torques) == count_before + 1
    client.diagnostics.clear()
    assert wait_until(lambda: any('states dropped: malformed message' in values
                                  for _, _, values in client.diagnostics), 3.0)


def test_a_urdf_above_the_size_limit_is_refused(client, start):
    node = start(robot_description="''")
    node.wait_for('waiting for a URDF')
    with client.describing() as publisher:
        publisher.publish(
            String(data='<robot name="x">' + ' ' * 10_000_000 + '</robot>'))
        node.wait_for('not configured: URDF: 10000024 bytes; expected at most 10000000')
        publisher.publish(String(data=URDF))
        node.wait_for('active, mode')


def test_real_time_settings_are_applied_or_refused_with_a_warning(client, start):
    node = start(realtime__priority=10, realtime__cpus='[0]',
                 realtime__lock_memory='true',
                 realtime__keep_awake='true')
    node.wait_for('active, mode')
    client.connect()
    policies = {}
    for task in os.listdir(f'/proc/{node.pid}/task'):
        with open(f'/proc/{node.pid}/task/{task}/comm') as file:
            name = file.read().strip()
        policies[name, int(task)] = os.sched_getscheduler(
            int(task)) & ~os.SCHED_RESET_ON_FORK
    if 'realtime.priority 10: refused' not in node.log:
        assert policies[next(key
                             for key in policies if key[1] == node.pid)] == os.SCHED_FIFO
        assert {policy for (name, _), policy in policies.items()
                if name.startswith('dds.')} == {
                    os.SCHED_FIFO}
        assert os.SCHED_OTHER in policies.values(), 'only the torque path is scheduled'
    if 'realtime.lock_memory: refused' not in node.log:
        with open(f'/proc/{node.pid}/status') as file:
            locked = next(line for line in file if line.startswith('VmLck'))
        assert int(locked.split()[1]) > 10_000
    if 'realtime.keep_awake: refused' not in node.log:
        opened = [os.path.realpath(f'/proc/{node.pid}/fd/{file}')
                  for file in os.listdir(f'/proc/{node.pid}/fd')]
        assert opened.count('/dev/cpu_dma_latency') == 1


def test_a_self_locking_drive_needs_exact_friction_in_simulations(
        client, start, tmp_path):
    supplement = tmp_path / 'locks.yaml'
    supplement.write_text(
        'joints:\n  lift: {load_friction: 0.6, load_friction_backdriven: 2.0}\n')
    node = start(supplement=str(supplement))
    node.wait_for("parameter 'simulation.sticking': false, with self-locking drives "
                  '(load_friction_backdriven) of lift; expected true', 60.0)
    node.end()
    node = start(supplement=str(supplement), simulation__sticking='true')
    client.connect(120.0)
    assert client.ask(Q, np.zeros(3)) is not None
    answer = client.call(Simulate, 'simulate', joint_names=list(JOINTS),
                         position=Q.tolist(), velocity=[0.0] * 3, duration=0.2)
    assert answer.success, answer.message
    lift = [point.positions[answer.trajectory.joint_names.index('lift')]
            for point in answer.trajectory.points]
    assert np.ptp(lift) < 1e-9, 'no load moves it'
