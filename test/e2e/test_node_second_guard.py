"""A guard refuses an arm that another guard holds, and one of other equations."""

import os
from pathlib import Path
import signal
import time

from lifecycle_msgs.msg import Transition
from node_process import NAME, URDF, wait_until
import numpy as np
from std_msgs.msg import Empty, String

GUARD = 'kane_dynamics.ros.guard.main'
WATCHING = 'watching kane_dynamics'
HOLDING = 'holding the arm'
ANOTHER = 'another torque_guard guards this arm'


def guards(start, **parameters):
    return start(module=GUARD, **parameters)


def publish_states(client, condition, seconds=30.0):
    """
    Publish joint states at rest until a condition holds; return whether it does.

    The time is no promise of the guard: a busy machine delays whole processes by
    seconds.
    """
    at_rest = np.zeros(len(client.joints))
    end = time.monotonic() + seconds
    while not (holds := condition()) and time.monotonic() < end:
        client.send(at_rest, at_rest)
        time.sleep(0.004)
    return holds


def test_a_second_guard_waits_until_the_first_one_ends_and_one_of_another_arm_refuses(
        client, start):
    """The URDF comes by topic, where it changes while the node is active."""
    with client.describing() as description:
        description.publish(String(data=URDF))
        client.process = start(robot_description="''", guard__enabled=True)
        first = guards(start)
        first.wait_for(WATCHING)
        client.connect()
        second = guards(start)
        second.wait_for(ANOTHER)
        watched = second.log.count(WATCHING)  # until it finds the first one
        # States are best effort, and one may be lost.
        assert wait_until(lambda: client.rest() is not None)
        first.end(signal.SIGKILL)
        assert wait_until(lambda: second.log.count(WATCHING) > watched, 30.0), second.log
        description.publish(
            String(data=URDF.replace('mass value="3.0"', 'mass value="9.0"')))
        client.process.wait_for('robot_description: changed while the node is active')
        second.end(signal.SIGKILL)
        third = guards(start)
        third.wait_for('another arm than that of kane_dynamics')
        assert WATCHING not in third.log


def test_the_guard_holds_the_arm_of_an_interpreter_whose_torque_path_failed(
        client, start, monkeypatch):
    """The process lives on, says why, and commands nothing more."""
    helpers = Path(__file__).parents[1] / 'helpers'
    monkeypatch.setenv('PYTHONPATH', str(helpers), prepend=os.pathsep)
    node = client.process = start(module='blocked_node', guard__enabled=True,
                                  torque_path='python', state_check__action='hold',
                                  mode='computed_torque', arm_compensates='none',
                                  activation='at_once', state_timeout=2.0)
    guard = guards(start)
    guard.wait_for(WATCHING)
    client.connect()
    failures = client.create_publisher(Empty, f'{NAME}/fail_path', 1)
    assert wait_until(failures.get_subscription_count)
    publish_states(client, lambda: False, 1.0)
    torque = np.array(client.commands[-1])
    assert np.abs(torque).max() > 1.0
    failures.publish(Empty())
    assert publish_states(client, lambda: HOLDING in guard.log), guard.log
    node.wait_for('callback failed: RuntimeError: on purpose')
    assert node.alive()
    count = len(client.commands)
    publish_states(client, lambda: False, 1.0)
    held = np.array(client.commands[count:])
    # One process commands, and what it commands holds the weight.
    assert len(held) > 20, guard.log
    assert np.abs(held - torque).max() < 0.1 * np.abs(torque).max(), guard.log + node.log
    client.destroy_publisher(failures)


def test_a_guard_that_was_stopped_yields_to_the_one_that_holds_the_arm(client, start):
    """The older guard would continue from a torque of long ago."""
    # A busy machine delays the states, which must not end the guard's torque.
    node = client.process = start(guard__enabled=True, state_timeout=2.0)
    first = guards(start)
    first.wait_for(WATCHING)
    client.connect()
    os.kill(first.pid, signal.SIGSTOP)
    try:
        second = guards(start)
        second.wait_for(WATCHING)
        # Node and both guards, unless the first one was stopped for too long to be
        # listed.
        wait_until(lambda: client.states.get_subscription_count() >= 3, 5.0)
        publish_states(client, lambda: False, 1.0)
        node.end(signal.SIGKILL)
        assert publish_states(client,
                              lambda: HOLDING in second.log), second.log
        os.kill(first.pid, signal.SIGCONT)
        assert publish_states(client, lambda: ANOTHER in first.log), first.log
        publish_states(client, lambda: False, 1.0)
        assert 'torque_guard did not run for' in first.log
        assert HOLDING not in first.log and ANOTHER not in second.log
    finally:
        os.kill(first.pid, signal.SIGCONT)


def test_a_guard_that_starts_without_a_node_says_that_no_process_holds_the_arm(
        client, start):
    """It knows no torque."""
    node = client.process = start(guard__enabled=True, state_timeout=2.0)
    client.connect()
    node.end(signal.SIGKILL)
    guard = guards(start)
    client.diagnostics.clear()
    assert publish_states(client, lambda: any(
        level == b'\x02' and 'no process holds the arm' in message
        for level, message, _ in client.diagnostics)), guard.log


def test_a_second_guard_does_not_hold_an_arm_that_was_deactivated_after_the_first_died(
        client, start):
    """It knows the torques that it has heard since then alone."""
    client.process = start(guard__enabled=True, state_timeout=2.0)
    first = guards(start)
    first.wait_for(WATCHING)
    client.connect()
    second = guards(start)
    second.wait_for(ANOTHER)
    watched = second.log.count(WATCHING)
    publish_states(client, lambda: False, 1.0)
    assert np.any(client.commands[-1])
    first.end(signal.SIGKILL)
    assert client.transition(Transition.TRANSITION_DEACTIVATE)
    assert publish_states(client, lambda: second.log.count(WATCHING) > watched)
    count = len(client.commands)
    publish_states(client, lambda: False, 2.0)
    assert HOLDING not in second.log, second.log
    assert not np.any(client.commands[count:])
