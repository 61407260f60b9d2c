"""
Everything at once, for long: 500 Hz, rubbish, services, loads, parameters; starts.

KANE_DYNAMICS_SOAK_MINUTES is the time of the longest test, half an hour by default, and
KANE_DYNAMICS_STARTS the number of starts, 500 by default.
"""

from contextlib import closing
import os
from pathlib import Path
import random
import re
import signal
import subprocess
import sys
import threading
import time

from geometry_msgs.msg import Inertia, Vector3, Wrench, WrenchStamped
from kane_dynamics_interfaces.srv import (Explain, ForwardDynamics, GetDynamics,
                                          InverseDynamics, SetPayload, Simulate)
from node_process import JOINTS, model, NAME, Process, URDF, wait_until
import numpy as np
import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, Header
from test_node_load import resident

MINUTES = float(os.environ.get('KANE_DYNAMICS_SOAK_MINUTES', '30'))
STARTS = int(os.environ.get('KANE_DYNAMICS_STARTS', '500'))
# Joint states, 1/s.
RATE = 500.0
FAST = 2000.0
TIMEOUT = 0.5  # s
# s, of a state when its answer is sent: a busy machine may stop the node
OLDEST = TIMEOUT + 1.0
FEW = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
NANO = 10**9
# All that reads or writes memory beside the torque path.
FULLEST = {'mode': 'computed_torque', 'payload__frame': 'c', 'wrench__frames': '[c]',
           'observer__enabled': 'true', 'observer__torque': 'command',
           'estimator__enabled': 'true',
           'guard__enabled': 'true'}


class Traffic:
    """
    What is sent, and what has come back.

    Few answers wait to be read, so that a busy machine does not make them late here.
    """

    def __init__(self, client, process):
        self.client = client
        self.process = process
        # (stamp, time of sending, both ns, torque)
        self.torques = []
        self.commands = []
        client.listen(False)
        self.subscriptions = [
            client.create_subscription(JointState, f'{NAME}/joint_torques',
                                       self._on_torques, FEW),
            client.create_subscription(Float64MultiArray, 'commands',
                                       lambda m: self.commands.append(list(m.data)),
                                       FEW)]
        self.chance = random.Random(0)
        self.limits = model().coordinate_joints
        self.sent = self.bad = self.asked = self.changed = 0
        self.faults = []

    def _on_torques(self, message, info):
        stamp = message.header.stamp.sec * NANO + message.header.stamp.nanosec
        self.torques.append((stamp, info['source_timestamp'], np.array(message.effort)))

    def close(self):
        for subscription in self.subscriptions:
            self.client.destroy_subscription(subscription)
        self.client.listen(True)

    def run(self, seconds, rate=RATE):
        """Drive states and rubbish from here, and requests from another thread."""
        stop = threading.Event()
        asking = threading.Thread(target=self._requests, args=(stop,))
        asking.start()
        due = time.monotonic()
        end = time.monotonic() + seconds
        while time.monotonic() < end and self.process.alive():
            self._state()
            if self.chance.random() < 0.05:
                self._rubbish()
            if self.sent % round(rate) == 0:
                self._judge()
            due += 1.0 / rate
            time.sleep(max(0.0, due - time.monotonic()))
        stop.set()
        asking.join(30.0)
        assert not asking.is_alive(), 'a request was never answered'

    def _state(self):
        t = time.time()
        self.client.send(0.5 * np.sin(t + np.arange(3)), 0.5 * np.cos(t + np.arange(3)))
        self.sent += 1

    def _rubbish(self):
        """Send a joint state or a motion that nothing must come of."""
        self.bad += 1
        send = self.client.send
        now = time.time_ns()
        chance = self.chance.randrange(7)
        if chance == 0:
            send([np.nan, 0.0, 0.0], np.zeros(3))
        elif chance == 1:
            send([1e308] * 3, [1e308] * 3)
        elif chance == 2:
            send([0.1, 0.2], [0.0, 0.0], names=JOINTS)
        elif chance == 3:
            send(np.zeros(3), np.zeros(3), names=('turn', 'turn', 'stranger'))
        elif chance == 4:
            send(np.zeros(3), np.zeros(3), stamp=now - 10 * NANO)
        elif chance == 5:
            send(np.zeros(3), np.zeros(3), stamp=now + 10 * NANO)
        else:
            self.client.follow([(0.1, [np.inf, 0.0, 0.0])])

    def _judge(self):
        """Hold what came back to the limits of efforts and of age."""
        torques = self.torques
        self.torques = []
        commands = self.commands
        self.commands = []
        limits = np.array([joint.limits.effort for joint in self.limits]) + 1e-9
        for stamp, sent, tau in torques.copy():
            if not (np.abs(tau) <= limits).all():
                self.faults.append(f'torque {tau} beyond {limits}')
            if sent - stamp > OLDEST * NANO:
                self.faults.append(
                    f'an answer to a state of {(sent - stamp) / NANO:.1f} s ago')
        for command in list(commands):
            if not (np.isfinite(command).all() and (np.abs(command) <= limits).all()):
                self.faults.append(f'command {command}')
        if not torques:
            self.faults.append('a second without an answer')

    def _requests(self, stop):
        """Ask, change loads and parameters, good and bad; each must be answered."""
        chance = random.Random(1)
        at_rest = [0.0] * 3
        while not stop.is_set() and self.process.alive():
            good = chance.random() < 0.7
            q = []
            for _ in range(3):
                q.append(chance.uniform(-1.0, 1.0) if good else np.nan)
            kind, name, fields = chance.choice([
                (InverseDynamics, 'inverse_dynamics',
                 {'velocity': at_rest, 'acceleration': at_rest}),
                (ForwardDynamics, 'forward_dynamics',
                 {'velocity': at_rest, 'effort': at_rest}),
                (GetDynamics, 'get_dynamics', {'velocity': at_rest}),
                (Explain, 'explain', {'velocity': at_rest, 'acceleration': at_rest}),
                (Simulate, 'simulate', {'velocity': at_rest, 'duration': 0.2}),
                (SetPayload, 'set_payload', None), (None, 'parameters', None)])
            if kind is None:
                self._parameters(chance, good)
                continue
            if kind is SetPayload:
                fields = {'payload': Inertia(m=chance.uniform(0.1, 3.0) if good
                                             else -1.0, com=Vector3(x=0.05), ixx=0.01,
                                             iyy=0.01, izz=0.01)}
            else:
                fields = {'position': q, **fields}
            answer = self.client.call(kind, name, **fields)
            self.asked += 1
            if answer.success != good:
                self.faults.append(
                    f'{name} of {fields}: {answer.success}, {answer.message}')
            time.sleep(chance.uniform(0.0, 0.02))

    def _parameters(self, chance, good):
        change = chance.choice([
            {'limits__rate': chance.uniform(100.0, 1000.0)},
            {'gains__kd': chance.uniform(10.0, 20.0)},
            {'gravity': [0.0, 0.0, -chance.uniform(5.0, 10.0)]}] if good else [
            {'state_timeout': -1.0}, {'mode': 'fly'}, {'gravity': [0.0, np.nan, 0.0]},
            {'gains__kd': 10.0, 'limits__rate': -5.0}])
        answer = self.client.adjust(**change)
        self.changed += 1
        if answer.successful != good or (not good and not answer.reason):
            self.faults.append(
                f'parameters {change}: {answer.successful}, {answer.reason!r}')


def traced(log):
    """Return whether a log shows an uncaught exception or damaged memory."""
    return any(words in log for words in ('Traceback', 'internal error',
                                          'Fatal Python error', 'Debug memory block'))


def interrupted_first(code, log):
    """Return whether SIGINT came while Python started, before the node's handler."""
    ours = {Path(name).name
            for name in re.findall(r'File "(.*/kane_dynamics/.*?)"', log)}
    return (code == -signal.SIGINT and log.rstrip().endswith('\nKeyboardInterrupt')
            and ours <= {'__init__.py', 'main.py', 'early_signals.py'})


@pytest.mark.slow
@pytest.mark.timeout(60 * MINUTES + 300)
def test_half_an_hour_of_everything_leaves_the_node_as_it_was(client):
    process = Process(robot_description=f"'{URDF}'", mode='gravity_compensation',
                      state_timeout=TIMEOUT, payload__frame='c')
    try:
        process.wait_for('active, mode')
        client.connect()
        with closing(Traffic(client, process)) as traffic:
            traffic.run(60.0)  # what is made once has been made
            memory_before = resident(process.pid)
            traffic.run(60.0 * MINUTES)
            memory_after = resident(process.pid)
            # When states stop, zeros come and stay.
            assert wait_until(lambda: traffic.commands and not any(traffic.commands[-1]),
                              5.0)
        print(
            f'{traffic.sent} states, {traffic.bad} bad ones, {traffic.asked} requests, '
            f'{traffic.changed} changes; {memory_before:.1f} to {memory_after:.1f} MB')
        assert traffic.faults == []
        assert process.alive()
        assert not traced(process.log)
        assert memory_after < 1.02 * memory_before
    finally:
        code, _ = process.end(timeout=60.0)  # with the allocators of the tests
    assert code == 0


@pytest.fixture
def poisoned(monkeypatch):
    """Let the allocators of nodes overwrite what is freed, and check around blocks."""
    monkeypatch.setenv('PYTHONMALLOC', 'debug')
    monkeypatch.setenv('MALLOC_PERTURB_', '2')


@pytest.mark.slow
@pytest.mark.timeout(60 * MINUTES + 300)
def test_everything_switched_on_lives_through_ten_minutes_at_500_hz_and_one_at_2_khz(
        client, poisoned):
    process = Process(robot_description=f"'{URDF}'", state_timeout=TIMEOUT, **FULLEST)
    try:
        process.wait_for('active, mode', 300.0)
        client.connect()
        with closing(Traffic(client, process)) as traffic:
            traffic.run(20.0 * MINUTES)
            traffic.run(2.0 * MINUTES, FAST)
        print(
            f'{traffic.sent} states, {traffic.bad} bad ones, {traffic.asked} requests, '
            f'{traffic.changed} changes')
        assert traffic.faults == []
        assert process.alive() and not traced(process.log)
    finally:
        code, _ = process.end(timeout=60.0)  # with the allocators of the tests
    assert code == 0


@pytest.mark.slow
@pytest.mark.timeout(60 * STARTS)
def test_the_fullest_configuration_starts_works_and_ends_500_times_on_a_busy_machine(
        client, poisoned):
    chance = random.Random(0)
    wrenches = client.create_publisher(WrenchStamped, f'{NAME}/wrench', 1)
    wrench = WrenchStamped(header=Header(frame_id='c'),
                           wrench=Wrench(force=Vector3(x=1.0, z=-2.0)))
    burning = [subprocess.Popen(['nice', sys.executable, '-c', 'while True: pass'])
               for _ in range(os.cpu_count())]
    answered = 0
    try:
        for k in range(STARTS):
            process = Process(robot_description=f"'{URDF}'", state_timeout=TIMEOUT,
                              **FULLEST)
            try:
                if k % 5 == 4:  # a signal at some moment of the start
                    time.sleep(chance.uniform(0.5, 6.0))
                else:
                    process.wait_for('active, mode', 300.0)
                    client.connect()
                    client.torques.clear()
                    for _ in range(chance.randrange(100, 300)):
                        wrench.header.stamp = client.get_clock().now().to_msg()
                        wrenches.publish(wrench)
                        client.send(0.5 * np.sin(time.time() + np.arange(3)),
                                    np.zeros(3))
                        time.sleep(1.0 / RATE)
                    answered += len(client.torques) >= 50
            finally:
                code, _ = process.end(chance.choice([signal.SIGINT, signal.SIGTERM]),
                                      300.0)
            assert code == 0 or (k % 5 == 4
                                 and code in (-signal.SIGINT, -signal.SIGTERM)), (
                                     k, code, process.log)
            assert not traced(process.log) or (
                k % 5 == 4 and interrupted_first(code, process.log)), (k, process.log)
    finally:
        for child in burning:
            child.kill()
            child.wait()
        client.destroy_publisher(wrenches)
    assert answered == STARTS - STARTS // 5
