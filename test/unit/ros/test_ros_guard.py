"""
The dynamics node and torque_guard in one process, with a manual clock and topics.

Both sides are the ones of the real processes; a stopped process receives and sends
nothing.
"""

from collections import defaultdict, deque
from contextlib import ExitStack
from dataclasses import replace
from inspect import signature
import os
import re
import subprocess
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('rclpy')

from kane_dynamics import (  # noqa: E402, I100
    Closure, Controller, load_urdf, Motion, Robot)
from kane_dynamics._util.resources import resource_path  # noqa: E402
from kane_dynamics.model.inertial import Inertial  # noqa: E402
from kane_dynamics.ros.common.cdr import (  # noqa: E402
    float64_multi_array, write_joint_state)
from kane_dynamics.ros.common.cdr import PreparedMessage  # noqa: E402
from kane_dynamics.ros.common.node_statistics import Statistics  # noqa: E402
from kane_dynamics.ros.dynamics_node.guard_link import GuardLink  # noqa: E402
from kane_dynamics.ros.guard.configured_guard import ConfiguredGuard  # noqa: E402
from kane_dynamics.ros.guard.guard_messages import (  # noqa: E402
    arm_digest, loads_from_numbers, LOADS_LENGTH, loads_to_numbers)
from kane_dynamics.ros.guard.node_torques import NodeTorques  # noqa: E402
from kane_dynamics.ros.loads.gravity_payload import GravityAndPayload  # noqa: E402
from kane_dynamics.ros.parameters.parameter_checks import (  # noqa: E402
    controller_settings)
from kane_dynamics.ros.torque_path.torque_path import TorquePath  # noqa: E402
from native_rig import python_path  # noqa: E402
from node_values import node_values, UNCHECKED  # noqa: E402
from rclpy.serialization import serialize_message  # noqa: E402
from std_msgs.msg import Float64MultiArray  # noqa: E402

NANO = 10**9
DIGEST = 2.0**52 - 1.0
MODEL = load_urdf(resource_path('urdf', 'two_link.urdf'))
LEASE = 0.012
RATE = 500.0
TAU = np.zeros(2)
Q = np.array([0.4, -0.3])
MOTION = Motion.from_points([0.0, 20.0], [[0.4, -0.3], [5.0, -4.0]],
                            joint_names=MODEL.joint_names)


class Machine:
    """A clock and topics in memory, shared by two processes of one machine."""

    def __init__(self, monkeypatch):
        self.now = 1000.0
        monkeypatch.setattr(time, 'perf_counter', lambda: self.now)
        monkeypatch.setattr(time, 'time_ns', lambda: round(self.now * NANO))
        self.subscribers = defaultdict(list)
        self.commands = []  # (time, process, torque)
        self.queue = deque()

    def publish(self, topic, data):
        """Deliver a message after the callback that publishes it has returned."""
        self.queue += [(process, topic, callback, data)
                       for process, callback in self.subscribers[topic]]

    def deliver(self):
        while self.queue:
            process, topic, callback, data = self.queue.popleft()
            process.deliver(topic, callback, data)


class Process:
    """One process: a replacement of a node, with a queue while it is stopped."""

    def __init__(self, machine, name):
        self.machine = machine
        self.name = name
        self.running = True
        self.dead = False
        self.queue = {}
        self.log = []

    def deliver(self, topic, callback, data):
        if self.dead:
            return
        if not isinstance(data, bytes):
            data = serialize_message(data)
        if self.running:
            callback(data)
        else:
            self.queue[topic] = callback, data  # the latest message of each topic

    def resume(self):
        self.running = True
        queue = self.queue
        self.queue = {}
        for callback, data in queue.values():
            callback(data)

    def create_publisher(self, kind, topic, qos):
        topic = topic.replace('~', self.name).replace('dynamics', 'node')

        def publish(data):
            if topic == 'commands':
                message = float64_multi_array(2)
                assert message.read(data)
                self.machine.commands.append(
                    (self.machine.now, self.name, message.numbers.copy()))
            self.machine.publish(topic, data)
        return SimpleNamespace(publish=publish, wait_for_all_acked=lambda timeout: True,
                               get_subscription_count=lambda: 1)

    create_lifecycle_publisher = create_publisher

    def create_subscription(self, kind, topic, callback, qos, **options):
        topic = topic.replace('~', self.name)
        if len(signature(callback).parameters) == 2:  # like rclpy, with the information
            on_message = callback

            def callback(data):
                received = round(self.machine.now * NANO)
                on_message(data, {'received_timestamp': received})
        self.machine.subscribers[topic].append((self, callback))
        return (topic, callback)

    def create_timer(self, period, callback, clock):
        self.tick = callback

    def destroy_publisher(self, publisher):
        pass

    destroy_subscription = destroy_timer = destroy_publisher

    def get_clock(self):
        return SimpleNamespace(ros_time_is_active=False)

    def get_logger(self):
        return SimpleNamespace(
            **dict.fromkeys(('info', 'warning', 'error'), self.log.append))


@pytest.fixture(scope='module')
def controller():
    """Return the controller of the node, with compiled kernels."""
    return Controller(Robot(MODEL))


class Pair:
    """A dynamics node and its guard on one machine, with a driver of joint states."""

    def __init__(self, monkeypatch, controller, native, period=0.002, **changes):
        self.native = native
        values = node_values(UNCHECKED)
        self.values = values | {'limits.rate': np.array(RATE), 'guard.lease': LEASE,
                                **changes}
        self.machine = Machine(monkeypatch)
        self.period = period
        self.q, self.u = Q.copy(), np.zeros(2)
        writer, offsets = write_joint_state(MODEL.joint_names, '', (2, 2, 0))
        self._state = PreparedMessage(writer, offsets[0], 2)
        self._speeds = self._state.doubles(offsets[1], 2)
        self.guard_process = Process(self.machine, 'guard')
        self.guard = ConfiguredGuard(
            self.guard_process,
            NodeTorques(self.guard_process, 'node'), MODEL, self.values,
            lambda *words: None, lambda level, text: self.guard_process.log.append(text),
            identity=1.0)
        self.controller = controller
        self.start_node()
        self.run(0.4)
        assert self.machine.commands[-1][1] == 'node'

    def start_node(self):
        process = self.node_process = Process(self.machine, 'node')
        self.controller.update(**controller_settings(self.values, MODEL.joint_names))
        self.controller.stop()
        self.path = (TorquePath if self.native else python_path)(
            self.controller, process.create_publisher(None, 'commands', None),
            process.create_publisher(None, '~/joint_torques', None),
            lambda: round(self.machine.now * NANO), self.values, Statistics(),
            lambda *words: None)
        self.link = GuardLink(process, self.path, LEASE, ExitStack(), 2)
        self.path.use_guard(self.link)
        self.path.start()
        process.create_subscription(None, 'joint_states', self.path.on_state, None)

    @property
    def number(self):
        """Return the number of the node's last request."""
        return self.path.arbitration.number

    def step(self, states=True):
        """Advance by one period of the joint states, in steps of the guard's timer."""
        machine = self.machine
        end = machine.now + self.period
        while machine.now < end - 1e-9:
            machine.now = min(machine.now + 0.002, end)
            if self.guard_process.running and not self.guard_process.dead:
                self.guard_process.tick()
                self.guard.path.check_timeout()
                if round(machine.now * 1000) % 100 < 2:
                    self.guard.send_heartbeat()
            if self.node_process.running and not self.node_process.dead:
                self.path.check_timeout()
            machine.deliver()
        if states:
            self._state.numbers[:], self._speeds[:] = self.q, self.u
            self._state.stamp(*divmod(round(machine.now * NANO), NANO))
            machine.publish('joint_states', self._state.serialized())
            machine.deliver()

    def run(self, seconds, states=True):
        for _ in range(round(seconds / self.period)):
            self.step(states)

    def voices(self, since=0.0):
        """Return the processes that commanded, in turn; no two did at once."""
        turns = []
        last = -1.0
        for now, name, _ in self.machine.commands:
            if now > since:
                if turns and turns[-1] != name:
                    assert now > last, 'two voices answer one state'
                if not turns or turns[-1] != name:
                    turns.append(name)
                last = now
        return turns

    def largest_step(self, since):
        """Return the largest torque step between commands, in units of the limit."""
        taus = [tau for now, _, tau in self.machine.commands if now >= since]
        return np.abs(np.diff(taus, axis=0)).max() / (RATE * self.period)


@pytest.fixture(params=[False, True], ids=['python', 'native'])
def pair(request, monkeypatch, controller):
    """Return a function that starts a node, of either torque path, with its guard."""
    return lambda **changes: Pair(monkeypatch, controller, request.param, **changes)


def test_after_a_kill_the_guard_commands_gravity_within_two_periods_of_the_lease(pair):
    both = pair()
    killed = both.machine.now
    both.node_process.dead = True
    both.run(0.1)
    first = next(command for command in both.machine.commands if command[1] == 'guard')
    assert first[0] - killed <= LEASE + 2 * 0.002 + 1e-9
    gravity = Robot(MODEL).gravity_force(Q)
    np.testing.assert_allclose(both.machine.commands[-1][2], gravity, rtol=1e-12)
    assert both.largest_step(killed) <= 1.0


def test_the_guard_damps_motion_and_starts_from_the_last_torque_of_the_node(pair):
    both = pair(**{'limits.rate': np.array(np.inf)})
    both.path.active_motion.follow(MOTION, round(both.machine.now * NANO), 0,
                                   both.path.active_motion.generation)
    both.run(0.1)
    both.u = np.array([0.5, -0.2])
    last = both.machine.commands[-1][2]
    both.node_process.dead = True
    both.run(0.014)
    guard = [tau for _, name, tau in both.machine.commands if name == 'guard']
    np.testing.assert_allclose(guard[0], last, atol=1e-12)
    both.run(0.1)
    robot = Robot(MODEL)
    expected = robot.inverse_dynamics(Q, both.u, -20.0 * both.u) - robot.friction_force(
        both.u)
    np.testing.assert_allclose(both.machine.commands[-1][2], expected, rtol=1e-9)


def test_the_guard_damps_alone_where_the_arm_holds_itself(pair):
    both = pair(arm_compensates=('gravity', 'friction'))
    both.u = np.array([0.5, -0.2])
    both.run(0.1)
    both.path.active_motion.follow(MOTION, round(both.machine.now * NANO), 0,
                                   both.path.active_motion.generation)
    both.run(0.1)
    both.node_process.dead = True
    both.run(0.3)
    robot = Robot(MODEL)
    damping = robot.inverse_dynamics(Q, both.u, -20.0 * both.u)
    damping = damping - robot.gravity_force(Q) - robot.friction_force(both.u)
    assert both.machine.commands[-1][1] == 'guard'
    np.testing.assert_allclose(both.machine.commands[-1][2], damping, rtol=1e-9)
    both.u = np.zeros(2)
    both.run(0.1)
    assert both.machine.commands[-1][1] == 'guard'
    assert np.abs(both.machine.commands[-1][2]).max() < 1e-12


def test_the_guard_changes_all_torques_in_step_with_the_slowest(pair):
    """Joints that reach torques one by one would throw the lighter ones."""
    rate = np.array([0.1, 2.0]) * RATE
    both = pair(**{'limits.rate': rate})
    both.run(1.0)  # reaches its torques
    both.u = np.array([0.5, -0.2])
    last = both.machine.commands[-1][2]
    both.node_process.dead = True
    both.run(1.0)
    taken = np.array([tau for _, name, tau in both.machine.commands if name == 'guard'])
    share = (taken - last) / (taken[-1] - last)
    np.testing.assert_allclose(share[:, 0], share[:, 1], atol=1e-9)
    assert (np.abs(np.diff(taken, axis=0)) <= rate * both.period * (1.0 + 1e-9)).all()
    assert ((share > 0.1) & (share < 0.9)).any(axis=0).all()


def test_a_node_that_returns_gets_the_topic_without_step_and_without_two_voices(pair):
    both = pair()
    began = both.machine.now
    both.node_process.running = False
    both.run(0.5)
    both.node_process.resume()
    both.run(0.2)
    assert both.voices(began) == ['guard', 'node']
    assert both.largest_step(began) <= 1.0 + 1e-9
    both.node_process.dead = True
    both.run(0.3)
    both.start_node()
    both.run(0.3)
    assert both.voices(began) == ['guard', 'node', 'guard', 'node']
    assert both.largest_step(began) <= 1.0 + 1e-9


def test_drives_with_feedback_pass_to_the_guard_and_back_without_a_step(monkeypatch,
                                                                        controller):
    stiffness = 40.0
    both = Pair(monkeypatch, controller, native=False, **{
        'commands.form': 'position_offset', 'commands.stiffness': np.array(stiffness)})
    both.path._pose = Q + 0.1  # the drives hold against a wrong model
    both.run(0.4)
    began = both.machine.now

    def torques():
        taus = [stiffness * (aim - at) for (now, _, aim), (when, at) in zip(
            both.machine.commands[-len(places):], places) if now >= began]
        return np.array(taus)
    places = []

    def run(seconds, speed=0.0):
        for _ in range(round(seconds / both.period)):
            both.q = both.q + speed * both.period
            before = len(both.machine.commands)
            both.step()
            places.extend([(both.machine.now, both.q)]
                          * (len(both.machine.commands) - before))
    run(0.01)
    gravity = Robot(MODEL).gravity_force(Q)
    assert np.abs(torques()[0] - gravity).max() > 3.0
    both.node_process.running = False
    run(0.3)
    np.testing.assert_allclose(torques()[-1], gravity, atol=1e-9)
    run(0.3, speed=0.2)  # the arm yields to a hand while the guard acts
    both.node_process.resume()
    run(0.3)
    assert both.voices(began) == ['node', 'guard', 'node']
    assert np.abs(np.diff(torques(), axis=0)).max() <= RATE * both.period * (1.0 + 1e-9)
    gravity = Robot(MODEL).gravity_force(both.q)
    np.testing.assert_allclose(torques()[-1], gravity, atol=1e-9)


def test_drives_with_feedback_pass_to_the_guard_and_back_soon_without_a_step(monkeypatch,
                                                                             controller):
    stiffness = 40.0
    both = Pair(monkeypatch, controller, native=False, **{
        'commands.form': 'position_offset', 'commands.stiffness': np.array(stiffness)})
    both.path._pose = Q + 0.1  # the drives hold against a wrong model
    both.run(0.4)
    began = both.machine.now
    for _ in range(2):
        both.node_process.running = False
        both.run(0.03)  # less than the timeout of states
        both.node_process.resume()
        both.run(0.03)
    assert both.voices(began) == ['guard', 'node', 'guard', 'node']
    aims = [aim for now, _, aim in both.machine.commands if now >= began]
    steps = np.abs(np.diff(aims, axis=0)) * stiffness
    assert 0.0 < steps.max() <= RATE * both.period * (1.0 + 1e-9)


def test_zeros_that_the_guard_denied_do_not_follow_its_torques(pair):
    both = pair()
    both.node_process.running = False
    both.run(0.1)
    resumed = both.machine.now
    both.node_process.resume()
    both.path.time_out('/clock has no publisher')
    both.run(0.3)
    assert both.voices(resumed) == ['node']
    assert all(tau.any() for now, _, tau in both.machine.commands if now >= resumed)
    assert both.largest_step(resumed) <= 1.0 + 1e-9


@pytest.mark.parametrize(('length', 'kept'), [(0.05, True), (0.5, False)])
def test_a_motion_survives_a_short_stall_only(pair, length, kept):
    both = pair()
    both.path.active_motion.follow(MOTION, round(both.machine.now * NANO), 0,
                                   both.path.active_motion.generation)
    both.run(0.05)
    both.node_process.running = False
    both.run(length)
    both.node_process.resume()
    both.run(0.05)
    assert both.machine.commands[-1][1] == 'node'
    assert ((both.path.active_motion.desired(round(both.machine.now * NANO)) is not None)
            is kept)


def test_zeros_of_the_node_are_no_reason_to_take_over(pair):
    both = pair()
    both.path.stop()
    began = both.machine.now
    both.run(1.0)
    assert both.voices(began) == []
    assert not both.machine.commands[-1][2].any()


def test_zeros_of_a_returning_node_end_the_guards_commands(pair):
    both = pair()
    both.node_process.running = False
    both.run(0.3)
    both.node_process.running = True
    both.path.stop()  # a shutdown, before the node reads any message
    both.run(0.3)
    assert not both.machine.commands[-1][2].any()
    assert not both.guard.path.watch.acting


def test_states_that_stop_are_no_reason_to_take_over_and_give_zeros_of_the_node(pair):
    both = pair()
    began = both.machine.now
    both.run(0.5, states=False)
    assert both.voices(began) == ['node']
    assert not both.machine.commands[-1][2].any()
    both.run(0.1)
    assert both.voices(began) == ['node']
    assert both.machine.commands[-1][2].any()


def test_stale_states_give_zeros_of_the_guard_when_the_node_is_dead(pair):
    both = pair()
    both.node_process.dead = True
    both.run(0.1)
    assert both.machine.commands[-1][2].any()
    both.run(0.2, states=False)
    assert not both.machine.commands[-1][2].any()
    both.run(0.1)
    assert both.machine.commands[-1][2].any(), 'fresh states are used again'
    again = pair()
    again.node_process.dead = True
    again.run(0.2, states=False)  # node and states end together
    assert again.machine.commands[-1][1] == 'guard'
    assert not again.machine.commands[-1][2].any()


def test_states_that_stop_at_a_jump_of_the_clock_give_zeros_of_the_guard(
        pair, monkeypatch):
    both = pair()
    both.node_process.dead = True
    monkeypatch.setattr(time, 'time_ns',
                        lambda: round((both.machine.now - 100.0) * NANO))
    both.guard.on_clock_jump()
    both.run(0.2, states=False)
    commands = []
    for command in both.machine.commands:
        if command[1] == 'guard':
            commands.append(command[1:])
    assert len(commands) == 1
    np.testing.assert_array_equal(commands[0][1], TAU)


def test_a_node_that_gets_no_states_does_not_command_zeros_while_the_guard_holds_the_arm(
        pair):
    both = pair()
    both.node_process.dead = True
    both.run(0.2)
    began = both.machine.now
    both.start_node()
    both.machine.subscribers['joint_states'].pop()  # not discovered yet
    both.run(1.0)
    assert set(both.voices(began)) == {'guard'}
    assert all(tau.any() for now, _, tau in both.machine.commands if now > began)


@pytest.mark.parametrize('period', [0.002, 0.08])
def test_a_guard_that_gets_no_states_leaves_the_command_to_a_node_that_has_them(
        pair, period):
    both = pair(period=period)
    began = both.machine.now
    subscribers = both.machine.subscribers['joint_states']
    subscribers[:] = [subscriber for subscriber in subscribers
                      if subscriber[0] is both.node_process]
    both.run(1.0)
    assert both.voices(began) == ['node']
    assert all(tau.any() for now, _, tau in both.machine.commands if now > began)
    both.node_process.dead = True
    both.run(0.2)
    assert both.machine.commands[-1][1] == 'guard'
    assert not both.machine.commands[-1][2].any()


def test_slow_states_neither_trigger_the_guard_nor_blind_it(pair):
    both = pair(period=0.02)
    began = both.machine.now
    both.run(1.0)
    assert both.voices(began) == ['node']
    both.node_process.dead = True
    killed = both.machine.now
    both.run(0.1)
    first = next(now for now, name, _ in both.machine.commands if name == 'guard')
    assert first - killed <= 2 * 0.02 + 1e-9


def test_heartbeats_that_the_thread_has_heard_are_not_missed_by_a_paused_interpreter(
        pair):
    both = pair()
    both.run(0.3)
    both.link._known = both.link._known._replace(seen=both.link._known.seen - 2.0 * NANO)
    assert not both.link.warning


def test_a_dead_guard_changes_nothing_but_the_warning(pair):
    both = pair()
    assert both.link.warning == ''
    both.guard_process.dead = True
    both.run(1.0)
    assert 'start torque_guard' in both.link.warning
    began = both.machine.now
    both.node_process.running = False
    both.run(0.05)
    both.node_process.resume()
    both.step()
    assert both.voices(began) == ['node'], 'no wait for a dead guard'


def test_a_node_without_guard_commands_after_the_discovery_timeout(pair):
    both = pair()
    both.guard_process.dead = True
    both.node_process.dead = True
    both.start_node()
    began = both.machine.now
    both.run(3.4)
    assert both.voices(began) == []
    both.run(0.2)
    assert both.voices(began) == ['node']


def test_random_stalls_of_both_processes_never_give_two_voices_or_a_step(pair):
    both = pair()
    rng = np.random.default_rng(7)
    began = both.machine.now
    for _ in range(60):
        stalled = [process for process in (both.node_process, both.guard_process)
                   if rng.random() < 0.6]
        for process in stalled:
            process.running = False
        both.run(0.002 * rng.integers(1, 60))
        rng.shuffle(stalled)
        for process in stalled:
            process.resume()
        both.run(0.002 * rng.integers(1, 60))
    assert {'node', 'guard'} <= set(both.voices(began))
    assert both.largest_step(began) <= 1.0 + 1e-9


def test_a_command_whose_computation_was_interrupted_waits_for_the_guard(
        pair, monkeypatch):
    both = pair()
    machine = both.machine
    sent = len(machine.commands)
    asked = []
    machine.subscribers['node/guard_request'].append((both.node_process, asked.append))
    began = machine.now = machine.now + 0.002
    later = began + 0.03
    times = iter([began])
    monkeypatch.setattr(time, 'perf_counter', lambda: next(times, later))
    both._state.stamp(*divmod(round(began * NANO), NANO))
    both.path.on_state(both._state.serialized())
    assert len(machine.commands) == sent, 'not commanded'
    monkeypatch.setattr(time, 'perf_counter', lambda: machine.now)
    machine.now = later
    machine.deliver()
    assert len(asked) == 1
    both.run(0.1)
    assert both.voices(began)[-1] == 'node'
    assert both.largest_step(began) <= 1.0 + 1e-9


@pytest.mark.parametrize('seconds', [0.05, 0.2, 1.0])
def test_a_guard_that_was_stopped_leaves_the_command_to_the_node(pair, seconds):
    both = pair()
    stopped = both.machine.now
    both.guard_process.running = False
    both.run(seconds)
    # Its timers may be ready before its messages: states and torques of the node.
    both.guard.path.check_timeout()
    both.machine.deliver()
    both.guard_process.resume()
    both.run(0.5)
    assert both.voices(stopped) == ['node']
    assert not both.guard.path.watch.takeovers


def test_a_state_that_waited_before_an_activation_is_not_answered_after_it(pair):
    both = pair()

    def activate_without_a_guard():
        both.path.stop()
        both.link._known = both.link._known._replace(seen=0.0)
        both.path.start()
    both.guard_process.running = False
    activate_without_a_guard()
    began = both.machine.now
    both.step()
    assert not any(now > began for now, _, _ in both.machine.commands), 'the state waits'
    activate_without_a_guard()
    # The guard is found, hands the topic over, and no new state comes.
    sent = len(both.machine.commands)
    both.guard_process.resume()
    both.guard.send_heartbeat()
    both.run(0.02, states=False)
    assert not both.path.arbitration.asked, 'the guard has answered'
    assert len(both.machine.commands) == sent
    both.run(0.1)
    assert both.machine.commands[-1][1] == 'node'
    assert both.machine.commands[-1][2].any()


def test_loads_arrive_as_they_were_sent():
    payload = Inertial(1.5, np.array([0.1, 0.2, 0.3]),
                       np.array([[3.0, 0.1, 0.2], [0.1, 4.0, 0.3], [0.2, 0.3, 5.0]]))
    for sent in (payload, None):
        number, loads, digest = loads_from_numbers(np.array(
            loads_to_numbers(7.0, GravityAndPayload(np.array([0.1, 0.2, -9.8]), sent),
                             DIGEST)))
        assert (number, digest) == (7.0, DIGEST)
        np.testing.assert_array_equal(loads.gravity, [0.1, 0.2, -9.8])
        assert (loads.payload is None) == (sent is None)
        if sent is not None:
            assert loads.payload.mass == sent.mass
            np.testing.assert_array_equal(loads.payload.com, sent.com)
            np.testing.assert_array_equal(loads.payload.inertia, sent.inertia)


def test_the_guard_uses_the_loads_of_the_node(pair):
    both = pair()
    both.guard.set_loads(GravityAndPayload(np.array([0.0, 0.0, -5.0])))
    both.node_process.dead = True
    both.run(0.2)
    gravity = Robot(MODEL).gravity_force(Q) * 5.0 / 9.81
    np.testing.assert_allclose(both.machine.commands[-1][2], gravity, rtol=1e-12)


def test_the_digest_of_an_arm_changes_with_its_equations_but_not_with_gravity():
    digest = arm_digest(MODEL, None)
    assert 0.0 < digest == int(digest) < 2.0**53
    assert digest == arm_digest(replace(MODEL, gravity=np.array([0.0, 0.0, -5.0])), ())
    heavier = load_urdf(
        resource_path('urdf', 'two_link.urdf').read_text().replace('2.4', '2.5'))
    assert digest != arm_digest(heavier, None)
    digests = {digest}
    for axis in ((0.0, 1.0, 0.0), (0.0, 1.0, 1e-9)):
        pin = Closure('upper_arm', 'tool', kind='inline', axis=axis)
        digests.add(arm_digest(MODEL, [pin]))
    assert len(digests) == 3


def test_the_node_follows_the_first_of_two_guards(pair):
    both = pair()
    message = float64_multi_array(6)
    message.numbers[:] = both.number, True, True, 2.0, 50.0, 50.0  # of a second guard
    began = both.machine.now
    both.node_process.running = False
    both.run(0.05)
    both.node_process.resume()
    both.machine.publish('node/guard_state', message.serialized())
    both.run(0.2)
    assert both.voices(began) == ['guard', 'node']
    assert both.largest_step(began) <= 1.0 + 1e-9


def test_a_guard_that_was_stopped_listens_before_it_commands_from_its_old_torque(pair):
    """Another guard may have held the arm meanwhile, from torques unknown here."""
    both = pair()
    both.node_process.dead = True
    both.run(0.3)
    assert both.guard.path.watch.acting
    heartbeats = []
    Process(both.machine, 'listener').create_subscription(
        None, 'node/guard_state', heartbeats.append, None)
    both.guard_process.running = False
    both.run(1.0)
    resumed = both.machine.now
    both.guard_process.resume()
    both.run(0.45)
    assert both.voices(resumed) == [] and not heartbeats
    assert any('did not run for 1.0' in line for line in both.guard_process.log)
    both.run(0.2)
    assert both.voices(resumed) == ['guard'] and heartbeats  # no other one was heard
    taken = next(now for now, _, _ in both.machine.commands if now >= resumed)
    assert both.largest_step(taken) <= 1.0 + 1e-9


def test_a_subscription_with_events_is_used_again_and_never_destroyed():
    """Where it is destroyed while an event waits, rclpy ends the process."""
    created = []
    received = []

    def subscribe(*arguments, **options):
        created.append(arguments)
    torques = NodeTorques(SimpleNamespace(create_subscription=subscribe), 'node')

    def listener(name):
        return SimpleNamespace(
            on_torques=lambda data: received.append((name, data)),
            on_liveliness=lambda alive: received.append((name, alive)))
    forget = torques.hear(0.02, listener('first'))
    (_, topic, on_torques, _), = created
    assert topic == 'node/joint_torques'
    on_torques(b'1')
    on_torques.__self__.on_liveliness(SimpleNamespace(alive_count=1))
    forget()
    on_torques(b'2')
    torques.hear(0.02, listener('second'))
    on_torques(b'3')
    torques.hear(0.03, listener('third'))
    assert len(created) == 2
    assert received == [('first', b'1'), ('first', True), ('second', True),
                        ('second', b'3')]


def test_a_message_of_loads_is_a_float64_multi_array():
    data = loads_to_numbers(1.0, GravityAndPayload(np.zeros(3)), 5.0)
    assert len(Float64MultiArray(data=data).data) == LOADS_LENGTH


def test_a_parameter_of_the_wrong_type_ends_the_guard_with_one_line():
    done = subprocess.run(
        [sys.executable, '-m',
         'kane_dynamics.ros.guard.main', '--ros-args', '-p', 'node:=3'],
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)}, capture_output=True,
        text=True, timeout=60.0)
    assert done.returncode == 2
    assert re.fullmatch("torque_guard: .*'node'.*\n", done.stderr)


def test_the_guard_logs_a_return_and_then_a_takeover():
    # The logger of ROS refuses another severity from a line of code that has logged.
    from kane_dynamics.ros.guard.guard_node import GuardNode
    import rclpy.logging
    logger = rclpy.logging.get_logger('guard_reports')
    node = SimpleNamespace(get_logger=lambda: logger)
    for level in ('info', 'error', 'info'):
        GuardNode._report(node, level, 'a report')


class MovingArm:
    """Two links without friction between the processes, moved by whichever commands."""

    def __init__(self, both):
        self.both, self.robot, self.q, self.u = both, Robot(MODEL), Q.copy(), np.zeros(2)
        motion = Motion.from_points([0.0, 1.0], [Q, Q + [1.0, -1.0]],
                                    joint_names=MODEL.joint_names)
        both.path.active_motion.follow(motion, round(both.machine.now * NANO), 0,
                                       both.path.active_motion.generation)

    def run(self, seconds, false=False):
        """Return the positions and speeds (K, 2) of all periods, false or true."""
        rows = []
        for _ in range(round(seconds / self.both.period)):
            torque = self.both.machine.commands[-1][2]
            self._move(torque)
            self.both.q, self.both.u = np.full(2, np.nan) if false else self.q, self.u
            self.both.step()
            rows.append((self.q, self.u))
        return np.array(rows).swapaxes(0, 1)

    def _move(self, torque):
        """Move for one period, in a step of Runge and Kutta, whose order is four."""
        def rate(state):
            q, u = state
            return np.array([u, self.robot.forward_dynamics(q, u, torque)])
        h = self.both.period
        state = np.array([self.q, self.u])
        k_1 = rate(state)
        k_2 = rate(state + 0.5 * h * k_1)
        k_3 = rate(state + 0.5 * h * k_2)
        k_4 = rate(state + h * k_3)
        self.q, self.u = state + h / 6.0 * (k_1 + 2.0 * k_2 + 2.0 * k_3 + k_4)


IN_FAULT = pytest.mark.parametrize('before', [0.02, 0.15, 0.28], ids=[
    'in the grace time', 'in the stop', 'at the end of the stop'])


@IN_FAULT
# s; a long one changes nothing in a fault
@pytest.mark.parametrize('lease', [LEASE, 1.0])
def test_the_guard_stops_an_arm_whose_node_dies_while_states_are_false(
        pair, before, lease):
    both = pair(**{'limits.rate': np.array(np.inf), 'state_check.action': 'hold',
                   'mode': 'computed_torque', 'guard.lease': lease})
    arm = MovingArm(both)
    arm.run(0.4)
    assert np.abs(arm.u).max() > 1.0
    arm.run(before, false=True)
    both.node_process.dead = True
    died = both.machine.now
    # The last torque acts in the silence of 1.5 state_timeout.
    arm.run(0.16, false=True)
    begin = arm.q.copy()
    fastest = np.abs(arm.u).max()
    q, u = arm.run(0.84, false=True)
    assert both.voices(died) == ['guard']
    # The stop moves the arm by half its time, 0.25 s, times the speeds at its begin.
    assert np.abs(q - begin).max() < 0.125 * fastest + 2e-3
    assert np.abs(u[-1]).max() < 5e-3
    np.testing.assert_allclose(both.machine.commands[-1][2],
                               arm.robot.gravity_force(arm.q), atol=0.02)


@IN_FAULT
def test_the_guard_commands_zeros_in_a_fault_if_so_configured(pair, before):
    both = pair(**{'limits.rate': np.array(np.inf), 'state_check.action': 'zero',
                   'mode': 'computed_torque'})
    arm = MovingArm(both)
    arm.run(0.4)
    arm.run(before, false=True)
    both.node_process.dead = True
    died = both.machine.now
    arm.run(0.2, false=True)
    # Zeros of the node leave nothing to take over.
    assert both.voices(died) == (['guard'] if before < 0.05 else [])
    assert not both.machine.commands[-1][2].any()


def test_the_guard_returns_to_measured_states_after_a_stop_by_the_model(pair):
    both = pair(**{'limits.rate': np.array(np.inf), 'state_check.action': 'hold',
                   'mode': 'computed_torque'})
    arm = MovingArm(both)
    arm.run(0.4)
    arm.run(0.02, false=True)
    both.node_process.dead = True
    arm.run(0.6, false=True)
    assert both.guard.path.fault
    arm.run(0.5)
    assert not both.guard.path.fault
    assert np.abs(arm.u).max() < 1e-3


def test_the_guard_stops_an_arm_whose_states_become_false_right_after_its_node_died(
        pair):
    """Liveliness is lost and the takeover begins, but there is no valid state."""
    both = pair(**{'limits.rate': np.array(np.inf), 'state_check.action': 'hold',
                   'mode': 'computed_torque'})
    arm = MovingArm(both)
    arm.run(0.4)
    both.node_process.dead = True
    arm.run(0.006)
    arm.run(0.006, false=True)
    both.guard.on_liveliness(False)
    assert both.guard.path.watch.acting
    arm.run(1.0, false=True)
    assert both.machine.commands[-1][1] == 'guard'
    assert np.abs(arm.u).max() < 5e-3
