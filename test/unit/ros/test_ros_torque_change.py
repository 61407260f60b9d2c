"""
The change of the torque, on all paths, for stamps, speeds and silences drawn at random.

The bound is computed here, from the clock and the times of the states alone.
"""

from itertools import pairwise
import time
from types import SimpleNamespace

from hypothesis import given, settings, strategies as st
import numpy as np
import pytest

pytest.importorskip('rclpy')

from kane_dynamics import Controller, load_urdf, Robot  # noqa: E402, I100
from kane_dynamics._util.resources import resource_path  # noqa: E402
from kane_dynamics.ros.common.cdr import (PreparedMessage,  # noqa: E402
                                          write_joint_state)
from kane_dynamics.ros.common.node_statistics import Statistics  # noqa: E402
from kane_dynamics.ros.guard.guard_path import GuardPath  # noqa: E402
from kane_dynamics.ros.torque_path.torque_path import TorquePath  # noqa: E402
from native_rig import python_path  # noqa: E402
from node_values import node_values, UNCHECKED  # noqa: E402

NANO = 10**9
MS = 10**6
ROBOT = Robot(load_urdf(resource_path('urdf', 'two_link.urdf')))
RATE = 100.0  # N m/s
PERIOD = 2 * MS  # of the states, ns; they come up to a tenth earlier or later
REGULAR = 12  # states between two faults


def simple_path(make):
    """Return a function that makes a path of the node."""
    def path(commands, clock):
        controller = Controller(ROBOT, mode='computed_torque', kp=100.0, kd=20.0,
                                rate_limit=RATE)
        return make(controller, commands, SimpleNamespace(publish=bool), clock,
                    node_values({**UNCHECKED, 'mode': 'computed_torque'}), Statistics(),
                    lambda *words: None)
    return path


def guard_path(commands, clock):
    """Return the path of a guard whose node has died with a torque that acts."""
    values = node_values({**UNCHECKED, 'mode': 'computed_torque', 'limits.rate': RATE})
    path = GuardPath(Controller(ROBOT), commands, SimpleNamespace(publish=bool), clock,
                     values, Statistics(), lambda *words: None, lambda *words: None)
    path.watch.known = True
    path.watch.note_node_command(np.array([3.0, 1.0]), time.perf_counter())
    return path


PATHS = {'interpreter': simple_path(python_path), 'native': simple_path(TorquePath),
         'guard': guard_path}


class Rig:
    """A path with a manual clock, which keeps times and torques of its commands."""

    def __init__(self, kind):
        self.now = 1000 * NANO
        self.rows = []  # clock, age of the state, torques
        self.path = PATHS[kind](self, lambda: self.now)
        self.path.start()
        message, (positions, velocities, _) = write_joint_state(ROBOT.joint_names, '',
                                                                (2, 2, 0))
        self.message = PreparedMessage(message, positions, 2)
        self.u = self.message.doubles(velocities, 2)

    def publish(self, data):
        """Keep a command."""
        self.rows.append((self.now, self.age, np.frombuffer(data[-16:]).copy()))

    def state(self, gap, age=0, u=0.0):
        """Let a state come after a time, with a stamp of some age, ns."""
        self.now += gap
        self.age = age
        self.u[:] = u
        self.message.stamp(*divmod(self.now - age, NANO))
        self.path.on_state(self.message.serialized())
        self.path.check_timeout()


speeds = st.floats(-300.0, 300.0)
regular = st.tuples(st.integers(round(0.9 * PERIOD), round(1.1 * PERIOD)), speeds)
faults = st.tuples(st.integers(0, 90 * MS),  # silence
                   st.integers(-95 * MS, 95 * MS),  # age: ahead of the clock or old
                   speeds)
episodes = st.lists(st.tuples(faults, st.lists(regular, min_size=REGULAR,
                                               max_size=REGULAR)),
                    min_size=1, max_size=6)


@pytest.mark.parametrize('kind', list(PATHS))
@given(episodes)
@settings(max_examples=40, deadline=None)
def test_no_stamp_and_no_silence_lets_the_torque_change_faster_than_its_rate(
        kind, drawn):
    with pytest.MonkeyPatch.context() as patch:
        steady = SimpleNamespace(now=1.0)
        patch.setattr(time, 'perf_counter', lambda: steady.now)
        rig = Rig(kind)
        steps = [(PERIOD, 0, 0.0)] * (2 * REGULAR)
        for fault, states in drawn:
            steps.append(fault)
            steps += [(gap, 0, u) for gap, u in states]
        for gap, age, u in steps:
            steady.now += gap / NANO
            rig.state(gap, age, u)
    rows = rig.rows
    assert len(rows) > REGULAR, 'it commands'
    rows = rows[next(k for k, row in enumerate(rows) if row[2].any()):]
    # Two periods; each fault and the state after it may have raised the measured one
    # by an eighth, and a part is left of the faults before.
    two_periods = 2.0 * 1.3 * 1.1 * PERIOD
    for (_, _, before), (_, _, after) in pairwise(rows):
        assert np.abs(after - before).max() <= RATE * two_periods / NANO
    # And none runs ahead of the clock.
    for k, (began, age, before) in enumerate(rows):
        for now, _, after in rows[k + 1:]:
            elapsed = now - began + max(age, 0)
            assert np.abs(after - before).max() <= RATE * elapsed / NANO + 1e-9


@pytest.mark.parametrize('kind', list(PATHS))
def test_the_torque_still_changes_at_its_rate_where_states_come_as_they_should(kind):
    with pytest.MonkeyPatch.context() as patch:
        steady = SimpleNamespace(now=1.0)
        patch.setattr(time, 'perf_counter', lambda: steady.now)
        rig = Rig(kind)
        rng = np.random.default_rng(0)
        for k in range(200):
            # Times that vary by half, and a speed that asks for more and more.
            gap = int(PERIOD * rng.uniform(0.5, 1.5))
            steady.now += gap / NANO
            rig.state(gap, 0, -3.0 * k)
    (began, _, before), (now, _, after) = rig.rows[50], rig.rows[-1]
    changed = np.abs(after - before).max()
    assert changed == pytest.approx(RATE * (now - began) / NANO, rel=0.02)
