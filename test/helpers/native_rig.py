"""
Torque paths without a thread: with compiled laws, and with laws that Python evaluates.

The clock is manual, and the publishers are in Python.
"""

import math
import time
from typing import NamedTuple
from unittest.mock import patch

from kane_dynamics.ros.common.node_statistics import Statistics
from kane_dynamics.ros.loads.gravity_payload import GravityAndPayload
from kane_dynamics.ros.torque_path.python_rules import controller_rules
from kane_dynamics.ros.torque_path.torque_path import TorquePath
from node_values import node_values
import numpy as np

NANO = 10**9
EPOCH = 1000 * NANO  # small: `TorquePath` computes with stamps in s


def python_path(*arguments, **named):
    """Return a path with the laws of the controller, which Python evaluates."""
    return TorquePath(*arguments, rules=controller_rules, **named)


class Sink:
    """Keeps the bytes of the published messages."""

    def __init__(self):
        self.sent = []

    def publish(self, data):
        self.sent.append(data)


class Side:
    """One of the two paths, with what it published, counted and warned of."""

    def __init__(self, make, controller, values, clock, loops=None):
        self.commands, self.torques, self.stamped = Sink(), Sink(), Sink()
        self.statistics = Statistics()
        self.warnings = []
        self.loops = loops
        self.path = make(controller, self.commands, self.torques, clock, values,
                         self.statistics, lambda *words: self.warnings.append(words),
                         stamped=self.stamped, loops=loops)

    def outcome(self):
        path = self.path
        return {'dropped': dict(self.statistics.dropped),
                'faults': self.statistics.faults,
                'timeouts': self.statistics.timeouts, 'timed out': path.timed_out,
                'commanding': path.commanding, 'fault': path.fault,
                'lost': self.loops is not None and self.loops.lost,
                'commands': len(self.commands.sent), 'counted': self.statistics.commands,
                'clamped': self.statistics.clamped, 'known': path.known,
                'motion': path.active_motion.scheduled[0] is not None}


class Choices(NamedTuple):
    """
    What random steps may be.

    `steps` are their names with probabilities; `near` is how near both torques are,
    relative to their size and absolute.
    """

    steps: dict
    modes: tuple
    efforts: tuple
    rate: float
    near: float


class BothPaths:
    """
    Both paths with one clock; every step is compared.

    A subclass makes the sides (`side`) and sends states (`do_state`).
    """

    def __init__(self, choices, mode, seed, values, **settings):
        self.choices = choices
        self.rng = np.random.default_rng(seed)
        self.time = EPOCH
        self.steady = 1.0  # s
        action = self.rng.choice(['zero', 'hold'])
        self.values = node_values(
            {'mode': mode, 'state_check.grace': 0.02,
             'state_timeout': 0.1, 'state_check.action': action, **values})
        self.sides = [self.side(make, mode, **settings)
                      for make in (python_path, TorquePath)]
        for side in self.sides:
            side.path.start()

    def clock(self):
        return self.time

    def step(self):
        steps = self.choices.steps
        kind = self.rng.choice(list(steps), p=list(steps.values()))
        # How long a step takes on this machine is no stop of the paths.
        with patch.object(time, 'perf_counter', lambda: self.steady):
            getattr(self, f'do_{kind}', self.do_state)(kind)
        self.compare(kind)

    def send(self, data):
        for side in self.sides:
            side.path.on_state(data)

    def do_pause(self, kind):
        """Let no states come for 0.2 s: the paths run, stop, or stop in between."""
        looks = [10 * [20], [200], [80, 120]][self.rng.integers(3)]
        for milliseconds in looks:
            self.time += milliseconds * 1_000_000
            self.steady += 1e-3 * milliseconds
            for side in self.sides:
                side.path.check_timeout()

    def do_back(self, kind):
        self.time -= 5_000_000_000
        self.do_state('state')

    def do_mode(self, kind):
        self.change_mode(self.rng.choice(self.choices.modes))

    def change_mode(self, mode):
        for side in self.sides:
            side.path.active_motion.clear('mode')
            side.path.controller.update(mode=mode)
            side.path.set_limits(self.values | {'mode': mode})

    def do_effort(self, kind):
        effort = self.rng.choice(self.choices.efforts)
        rate = self.rng.choice([self.choices.rate, math.inf])
        for side in self.sides:
            side.path.controller.update(effort_limit=self.limits(side, effort),
                                        rate_limit=self.limits(side, rate))
            side.path.set_limits(self.values)

    def limits(self, side, largest):
        """Return limits of all joints; without motors, as the node states them."""
        motors = side.path.messages.of_all(np.ones(len(side.path.messages.joints)))
        return np.where(motors > 0.0, largest, math.inf)

    def do_loads(self, kind):
        loads = GravityAndPayload(self.rng.uniform(-9.0, 9.0, 3))
        for side in self.sides:
            side.path.set_loads(loads)

    def follow(self, motion, after):
        """Let both follow a motion from some time after now on, ns."""
        for side in self.sides:
            active = side.path.active_motion
            assert active.follow(motion, self.time + after, self.time, active.generation)

    def compare(self, kind):
        python, native = self.sides
        near = self.choices.near
        assert native.outcome() == python.outcome(), kind
        for name in ('commands', 'stamped', 'torques'):
            ours, theirs = (getattr(side, name).sent[-1:] for side in (native, python))
            for mine, expected in zip(ours, theirs, strict=True):
                np.testing.assert_allclose(self.numbers(mine), self.numbers(expected),
                                           rtol=near, atol=near)
                if name != 'commands':
                    assert mine[4:12] == expected[4:12], 'stamp'

    def numbers(self, data):
        """Return the torques of a message."""
        return np.frombuffer(data[-8 * len(self.sides[0].path.messages.joints):])
