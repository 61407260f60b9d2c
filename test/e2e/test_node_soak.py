"""Half an hour of everything at once: states at 500 Hz, rubbish, services, loads, parameters."""

import os
import random
import threading
import time

from geometry_msgs.msg import Inertia, Vector3
from graph import JOINTS, model, Process, URDF, wait_until
from kane_dynamics_interfaces.srv import (Explain, ForwardDynamics, GetDynamics, InverseDynamics,
                                          SetPayload, Simulate)
import numpy as np
import pytest
from test_node_load import resident

MINUTES = float(os.environ.get('KANE_DYNAMICS_SOAK_MINUTES', '30'))
RATE = 500.0
TIMEOUT = 0.5  # s
NANO = 10**9


class Traffic:
    """What is sent, and what has come back."""

    def __init__(self, client, process):
        self.client, self.process = client, process
        self.chance = random.Random(0)
        self.limits = model().coordinate_joints
        self.sent = self.bad = self.asked = self.changed = 0
        self.faults = []

    def run(self, seconds):
        """Drive states and rubbish from here, and requests from another thread."""
        stop = threading.Event()
        asking = threading.Thread(target=self._requests, args=(stop,))
        asking.start()
        due, end = time.monotonic(), time.monotonic() + seconds
        while time.monotonic() < end and self.process.alive():
            self._state()
            if self.chance.random() < 0.05:
                self._rubbish()
            if self.sent % 500 == 0:
                self._judge()
            due += 1.0 / RATE
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
        send, now = self.client.send, time.time_ns()
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
        now = time.time_ns()
        client = self.client
        torques, client.torques = client.torques, type(client.torques)()
        commands, client.commands = client.commands, []
        most = np.array([joint.limits.effort for joint in self.limits]) + 1e-9
        for stamp, tau in torques.copy().items():
            if not (np.abs(tau) <= most).all():
                self.faults.append(f'torque {tau} beyond {most}')
            if stamp < now - 5 * NANO:  # a second of traffic, and what a busy machine adds
                self.faults.append(f'an answer to a state of {(now - stamp) / NANO:.1f} s ago')
        for command in list(commands):
            if not (np.isfinite(command).all() and (np.abs(command) <= most).all()):
                self.faults.append(f'command {command}')
        if not torques:
            self.faults.append('a second without an answer')

    def _requests(self, stop):
        """Ask, change loads and parameters, good and bad; each must be answered."""
        chance, rest = random.Random(1), [0.0] * 3
        while not stop.is_set() and self.process.alive():
            good = chance.random() < 0.7
            q = [chance.uniform(-1.0, 1.0) if good else np.nan for _ in range(3)]
            kind, name, fields = chance.choice([
                (InverseDynamics, 'inverse_dynamics', {'velocity': rest, 'acceleration': rest}),
                (ForwardDynamics, 'forward_dynamics', {'velocity': rest, 'effort': rest}),
                (GetDynamics, 'get_dynamics', {'velocity': rest}),
                (Explain, 'explain', {'velocity': rest, 'acceleration': rest}),
                (Simulate, 'simulate', {'velocity': rest, 'duration': 0.2}),
                (SetPayload, 'set_payload', None), (None, 'parameters', None)])
            if kind is None:
                self._parameters(chance, good)
                continue
            if kind is SetPayload:
                fields = {'payload': Inertia(m=chance.uniform(0.1, 3.0) if good else -1.0,
                                             com=Vector3(x=0.05), ixx=0.01, iyy=0.01, izz=0.01)}
            else:
                fields = {'position': q, **fields}
            answer = self.client.call(kind, name, **fields)
            self.asked += 1
            if answer.success != good:
                self.faults.append(f'{name} of {fields}: {answer.success}, {answer.message}')
            time.sleep(chance.uniform(0.0, 0.02))

    def _parameters(self, chance, good):
        change = chance.choice([
            {'limits__rate': chance.uniform(100.0, 1000.0)},
            {'compensate__friction': chance.random() < 0.5},
            {'gravity': [0.0, 0.0, -chance.uniform(5.0, 10.0)]}] if good else [
            {'state_timeout': -1.0}, {'mode': 'fly'}, {'gravity': [0.0, np.nan, 0.0]},
            {'compensate__friction': True, 'limits__rate': -5.0}])
        answer = self.client.adjust(**change)
        self.changed += 1
        if answer.successful != good or (not good and not answer.reason):
            self.faults.append(f'parameters {change}: {answer.successful}, {answer.reason!r}')


@pytest.mark.slow
@pytest.mark.timeout(60 * MINUTES + 300)
def test_half_an_hour_of_everything_leaves_the_node_as_it_was(client):
    process = Process(robot_description=f"'{URDF}'", mode='gravity_compensation',
                      state_timeout=TIMEOUT, payload__frame='c')
    try:
        process.wait_for('active, mode')
        client.connect()
        traffic = Traffic(client, process)
        traffic.run(60.0)  # what is made once has been made
        before = resident(process.pid)
        traffic.run(60.0 * MINUTES)
        after = resident(process.pid)
        # When states stop, zeros come and stay.
        assert wait_until(lambda: client.commands and not any(client.commands[-1]), 5.0)
        print(f'{traffic.sent} states, {traffic.bad} bad ones, {traffic.asked} requests, '
              f'{traffic.changed} changes; {before:.1f} to {after:.1f} MB')
        assert traffic.faults == []
        assert process.alive()
        assert 'Traceback' not in process.log
        assert 'internal error' not in process.log
        assert after < 1.02 * before
    finally:
        code, _ = process.end()
    assert code == 0
