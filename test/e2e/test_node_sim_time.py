"""The node beside a simulated robot that keeps the time: pause, slow, fast, jumps."""

import math
import time

from kane_dynamics import Robot
from lifecycle_msgs.msg import Transition
from node_process import DEEP, model, Process, Stall, URDF, wait_until
import numpy as np
import pytest
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

START = np.array([0.3, -0.4, 0.2])
NANO = 10**9
PERIOD = 0.005  # s of simulated time between two states


class Pair:
    """A dynamics node and a simulated robot, seen by a client."""

    def __init__(self, client):
        self.client = client
        self.times = []
        self.states = []
        self._open = [
            client.create_subscription(JointState, 'joint_states', self._on_state, DEEP),
            client.create_subscription(Clock, '/clock', lambda m: self.times.append(
                m.clock.sec * NANO + m.clock.nanosec), DEEP)]

    def _on_state(self, message):
        stamp = message.header.stamp
        self.states.append(
            (stamp.sec * NANO + stamp.nanosec, np.array(message.position)))

    def close(self):
        for subscription in self._open:
            self.client.destroy_subscription(subscription)

    def adjust(self, **parameters):
        assert self.client.adjust('/plant_node', **parameters).successful

    def pause(self, on):
        assert self.client.call(SetBool, '/plant_node/pause', data=on).success

    def reset(self):
        assert self.client.call(Trigger, '/plant_node/reset').success

    def answered(self, count=10, timeout=10.0):
        """Wait until the node answers states of now, and return the last torques."""
        torques = self.client.torques
        torques.clear()
        assert wait_until(lambda: sum(map(np.any, list(torques.values()))) >= count,
                          timeout), (
                              len(torques), self.client.diagnostics[-1:],
                              self.node.log[-1500:])
        return list(torques.values())[-1]

    def zeros(self):
        return sum(not any(command) for command in self.client.commands)

    def silence_before_zeros(self):
        """Let the plant fall silent; return the simulated time from there to zeros."""
        torques = self.client.torques
        torques.clear()
        self.adjust(dropout__states=1.0)
        assert wait_until(lambda: torques and not list(torques.values())[-1].any())
        zeros = list(torques)[-1]
        last = self.states[-1][0]
        self.adjust(dropout__states=0.0)
        return (zeros - last) / NANO


@pytest.fixture(scope='module')
def processes():
    node = Process(real_states=True, robot_description=f"'{URDF}'", use_sim_time='true',
                   mode='gravity_compensation', state_timeout=0.1, diagnostics_rate=10)
    plant = Process(module='kane_dynamics.ros.plant.main', robot_description=f"'{URDF}'",
                    publish_clock='true', rate=1.0 / PERIOD,
                    initial__position=START.tolist())
    yield node
    for process in (node, plant):
        assert process.end()[0] == 0
        assert 'Traceback' not in process.log, process.log


@pytest.fixture
def pair(processes, client):
    pair = Pair(client)
    pair.node = processes
    pair.adjust(rate_factor=1.0, dropout__states=0.0, reset_clock=False)
    pair.pause(False)
    # The arm jumps: the node must be inactive, since no real arm jumps.
    client.transition(Transition.TRANSITION_DEACTIVATE)
    pair.reset()
    assert client.transition(Transition.TRANSITION_ACTIVATE)
    pair.client.adjust(mode='gravity_compensation', state_timeout=0.1)
    pair.answered()
    yield pair
    pair.close()


def test_the_node_holds_the_simulated_arm(pair):
    for _ in range(3):  # a stall of 15 ms at the reset lets any arm fall by as much
        pair.states.clear()
        # The arm is at rest.
        assert wait_until(lambda: len(pair.states) > 200 and np.abs(
            pair.states[-1][1] - pair.states[-100][1]).max() < 1e-7)
        if np.abs(pair.states[-1][1] - START).max() < 2e-3:
            break
        pair.reset()
    np.testing.assert_allclose(pair.states[-1][1], START, atol=2e-3)
    np.testing.assert_allclose(pair.answered(),
                               Robot(model()).gravity_force(pair.states[-1][1]),
                               rtol=1e-3)


def test_while_time_is_paused_there_are_no_commands_and_no_timeouts(pair):
    pair.pause(True)
    time.sleep(0.1)
    pair.client.commands.clear()
    pair.client.diagnostics.clear()
    time.sleep(0.5)  # five timeouts of real time
    assert not pair.client.commands
    # Between the plant's own reports.
    assert any(message.endswith('; /clock does not advance')
               for _, message, _ in pair.client.diagnostics)
    pair.pause(False)
    pair.answered()
    assert pair.zeros() == 0


@pytest.mark.parametrize('speed', [0.05, 10.0])
def test_the_timeout_is_in_simulated_time(pair, speed):
    timeout = 0.02 if speed < 1.0 else 5.0
    assert pair.client.adjust(state_timeout=timeout).successful
    pair.adjust(rate_factor=speed)
    pair.answered(3)
    pair.client.commands.clear()
    count = len(pair.states)
    time.sleep(0.6)
    assert pair.zeros() == 0, 'between two states lie 0.1 s of ours, 5 ms of theirs'
    assert len(pair.states) > count
    # The timeout, the watchdog's fifth of it, a period before and after; and 0.1 s of
    # ours.
    longest = 2.0 * PERIOD + 1.2 * timeout + 0.1 * speed
    for _ in range(3):
        with Stall() as stall:
            silence = pair.silence_before_zeros()
        assert silence > timeout
        # A stall of that is no fault of the node.
        if silence <= longest or stall.longest < 0.04:
            break
        pair.answered(3)
    assert silence <= longest
    pair.answered(3)


def test_after_a_backward_jump_the_node_follows_later_motions(pair):
    assert pair.client.adjust(mode='inverse_dynamics', state_timeout=3.0,
                              trajectory__start_tolerance=math.inf).successful
    pair.client.follow([(0.0, [0, 0, 0]), (60.0, [1, 1, 0.1])])
    hold = Robot(model()).gravity_force(START)
    assert wait_until(lambda: np.abs(pair.answered(1) - hold).max() > 1.0)
    count_before = pair.node.log.count('jumped backward or replaced')
    # No state comes for a while, and the next look of the watchdog lies 0.6 s ahead.
    pair.adjust(dropout__states=1.0, reset_clock=True)
    pair.reset()
    assert wait_until(lambda: pair.times[-1] < 2 * NANO)
    pair.client.follow([(0.0, [0.5, 0.6, 0.1]), (60.0, [0.5, 0.6, 0.1])])
    time.sleep(0.1)
    pair.adjust(dropout__states=0.0, rate_factor=0.1)
    there = Robot(model()).gravity_force(np.array([0.5, 0.6, 0.1]))
    # The motion is followed after its check, which takes longer on a busy machine.
    assert wait_until(lambda: np.allclose(pair.answered(3), there, rtol=1e-9, atol=0.0))
    assert pair.node.log.count('jumped backward or replaced') == count_before + 1
    pair.reset()
    assert wait_until(lambda: np.abs(pair.answered(1) - hold).max() < 0.5), (
        'a jump forgets a motion')
