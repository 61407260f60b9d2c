"""
A simulated arm under the torque path, with a false joint state and without it.

Each state in the place of which a false one comes moves the arm by less than 2 mrad, at
rest and in motion; faults that last end as configured. Time is simulated, so that both
runs are equal up to the fault.
"""

from functools import cache
import math
import time
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('rclpy')

from false_states import (  # noqa: E402, I100
    arm, changed, FALSE, FAULT, LONG, MOST, NANO, PERIOD, SHORT, simulated_arm)
from kane_dynamics import Controller  # noqa: E402
from kane_dynamics.ros.common.node_statistics import Statistics  # noqa: E402
from kane_dynamics.ros.guard.guard_path import GuardPath  # noqa: E402
from kane_dynamics.ros.parameters.parameter_checks import read  # noqa: E402
from kane_dynamics.ros.parameters.parameter_table import CONSTANTS, SPECS  # noqa: E402
from kane_dynamics.ros.torque_path.closed_loop_reader import (  # noqa: E402
    closed_loop_reader)
from kane_dynamics.ros.torque_path.path_controller import rate_limit  # noqa: E402
from kane_dynamics.ros.torque_path.torque_path import TorquePath  # noqa: E402
from native_rig import python_path  # noqa: E402
from node_values import node_values  # noqa: E402
from rclpy.serialization import deserialize_message, serialize_message  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from std_msgs.msg import Float64MultiArray  # noqa: E402

BEGIN = 40  # states at rest, in which the torque grows to that of gravity
SETTINGS = {'inverse_dynamics': {}, 'computed_torque': {'kp': 100.0, 'kd': 20.0},
            'gravity_compensation': {}}


class Run:
    """The arm under the torque path, tick by tick."""

    def __init__(self, name, mode, moving, torques=None, make=TorquePath, limited=False,
                 **checks):
        self.robot, _, motion = arm(name)
        self.arm = simulated_arm(name)
        values = node_values({f'state_check.{key}': x for key, x in checks.items()}
                             | {'mode': mode})
        limits = {'rate_limit': rate_limit(values, self.robot)} if limited else {}
        controller = Controller(self.robot, mode=mode, **SETTINGS[mode], **limits)
        self.time = 100 * NANO
        self.torque = None
        self.commands = 0
        self.statistics = Statistics()
        self.warnings = []
        self.path = make(
            controller, self, torques or Unread(), lambda: self.time, values,
            self.statistics, lambda *words: self.warnings.append(words),
            loops=closed_loop_reader(controller, values))
        self.path.start()
        for _ in range(BEGIN):
            self.state()
        if moving:
            active = self.path.active_motion
            assert active.follow(motion, self.time, self.time, active.generation)

    def publish(self, data):
        tau = np.array(deserialize_message(data, Float64MultiArray).data)
        self.torque = self.path.messages.of_all(tau)
        self.commands += 1

    def state(self, change=None):
        """Publish the state of the arm, changed if asked for."""
        self.time += PERIOD
        names = self.robot.joint_names
        message = JointState(name=list(names), position=self.arm.q.tolist(),
                             velocity=self.arm.u.tolist())
        age = 0
        if change is not None:
            q, u, age = change(np.array(message.position), np.array(message.velocity))
            message.position, message.velocity = q.tolist(), u.tolist()
        stamp = message.header.stamp
        stamp.sec, stamp.nanosec = divmod(self.time - age, NANO)
        self.receive(serialize_message(message))

    def receive(self, data):
        """Pass a serialized state to the torque path."""
        self.path.on_state(data)
        self.path.check_timeout()

    def positions(self, change=None, first=FAULT, count=1, length=SHORT):
        """Return the positions of all ticks, (K, n); `count` states are false."""
        rows = []
        for k in range(length):
            self.state(change if first <= k < first + count else None)
            for _ in range(2):
                self.arm.step(self.torque)
            rows.append(self.arm.q.copy())
        return np.array(rows)


class GuardedRun(Run):
    """The same with a guard, which receives the states and torques of a node."""

    def __init__(self, monkeypatch, name):
        self.dead = False
        self.guard = None
        super().__init__(name, 'computed_torque', True,
                         SimpleNamespace(publish=self.hear), action='hold')
        monkeypatch.setattr(time, 'perf_counter', lambda: self.time / NANO)
        values = CONSTANTS | {spec.name: read(spec, spec.default) for spec in SPECS}
        values |= node_values({'state_check.action': 'hold', 'mode': 'computed_torque'})
        self.reports = []
        self.guard = GuardPath(Controller(self.robot), self, Unread(), lambda: self.time,
                               values, Statistics(), lambda *words: None,
                               lambda *words: self.reports.append(words))
        self.guard.start()
        self.guard.watch.known = True

    def hear(self, data):
        """Pass serialized torques of the node to the guard."""
        if self.guard is not None:
            self.guard.on_torques(data)

    def receive(self, data):
        """Pass a serialized state to the guard, and to the node if it lives."""
        if self.guard is not None:
            self.guard.watch.tick(self.time / NANO)
            self.guard.on_state(data)
            self.guard.check_timeout()
        if not self.dead:
            super().receive(data)

    def rows(self, count, change=None):
        """Return positions and largest joint speeds at some states, (K, n) and (K,)."""
        q = self.positions(change, first=0, count=count, length=count)
        return q, np.abs(np.diff(q, axis=0)).max(axis=1) * (NANO / PERIOD)


class Unread:
    """Stands for a publisher without subscribers."""

    def publish(self, data):
        pass


@cache
def undisturbed(name, mode, moving, length=SHORT):
    return Run(name, mode, moving).positions(length=length)


EACH = [(name, fault) for name, faults in FALSE.items() for fault in faults]


def check_false_state(name, fault, mode, moving, length):
    reason, change = FALSE[name][fault]
    run = Run(name, mode, moving)
    rows = run.positions(change, length=length)
    away = np.abs(rows - undisturbed(name, mode, moving, length))
    assert away[:FAULT].max() == 0.0
    assert away.max() < MOST
    assert run.statistics.dropped == {reason: 1}
    assert run.statistics.faults == run.statistics.timeouts == 0


@pytest.mark.parametrize(('mode', 'moving'), [('inverse_dynamics', False),
                                              ('computed_torque', True)])
@pytest.mark.parametrize(('name', 'fault'), EACH)
def test_a_false_state_moves_the_arm_by_less_than_2_mrad(name, fault, mode, moving):
    check_false_state(name, fault, mode, moving, SHORT)


@pytest.mark.parametrize('make', [python_path, TorquePath])
@pytest.mark.parametrize(('name', 'joint'), [('fr3', 1), ('fr3', 5),
                                             ('palletizer', 'shoulder')])
@pytest.mark.parametrize('speed', [0.3, -0.5, 1.0, -3.0])
def test_one_false_speed_below_its_limit_moves_the_arm_by_less_than_2_mrad(
        name, joint, speed, make):
    run = Run(name, 'computed_torque', True, make=make, limited=True)
    calm = Run(name, 'computed_torque', True, make=make, limited=True).positions()
    rows = run.positions(changed(joint, 0.0, speed, names=run.robot.joint_names))
    assert np.abs(rows - calm).max() < MOST
    assert not run.statistics.dropped and not run.path.false_speeds


@pytest.mark.parametrize('make', [python_path, TorquePath])
@pytest.mark.parametrize(('ahead', 'silent'), [
    pytest.param(95 * NANO // 1000, 0, id='95 ms ahead'),
    pytest.param(0, 20, id='after 40 ms')])
@pytest.mark.parametrize(('name', 'joint'), [('fr3', 1), ('palletizer', 'shoulder')])
def test_one_message_changes_the_torque_by_at_most_two_periods_of_its_rate(
        name, joint, ahead, silent, make):
    # Without limits of speed no other rule helps.
    run = Run(name, 'computed_torque', True, make=make, limited=True,
              speed_factor=math.inf)
    run.positions(length=FAULT)
    run.time += silent * PERIOD
    before = run.torque.copy()
    run.state(changed(joint, 0.0, 3.0, -ahead, run.robot.joint_names))
    assert run.statistics.dropped == {}
    joints = run.path._follow
    change = np.abs(run.torque - before)[joints]
    allowed = run.path.controller.rate_limit[joints] * PERIOD / NANO
    assert (change < 2.01 * allowed).all() and (change > 0.5 * allowed).any()


@pytest.mark.slow
@pytest.mark.parametrize('moving', [False, True], ids=['at rest', 'in motion'])
@pytest.mark.parametrize('mode', ['inverse_dynamics', 'computed_torque'])
@pytest.mark.parametrize(('name', 'fault'), EACH)
def test_a_false_state_moves_the_arm_by_less_than_2_mrad_for_long(
        name, fault, mode, moving):
    check_false_state(name, fault, mode, moving, LONG)


@pytest.mark.parametrize(('name', 'fault'), [x for x in EACH if x[1] != 'small jump'])
def test_three_false_states_in_a_row_are_counted_and_the_arm_goes_on(name, fault):
    reason, change = FALSE[name][fault]
    run = Run(name, 'computed_torque', True)
    rows = run.positions(change, count=3)
    assert run.statistics.dropped == {reason: 3}
    assert np.abs(rows - undisturbed(name, 'computed_torque', True)).max() < MOST
    assert run.statistics.faults == run.statistics.timeouts == 0


@pytest.mark.parametrize(('name', 'fault'),
                         [('fr3', 'jump'), ('palletizer', 'contradiction')])
def test_an_arm_in_motion_comes_to_rest_in_a_fault_that_lasts(name, fault):
    reason, change = FALSE[name][fault]
    run = Run(name, 'computed_torque', True, action='hold')
    rows = run.positions(change, count=180, length=FAULT + 180)
    speeds = np.abs(np.diff(rows, axis=0)) * (NANO / PERIOD)
    assert run.path.fault == reason
    fastest = speeds[:FAULT + 26].max()
    assert fastest > 0.5, 'it moved'
    assert speeds[FAULT + 155:FAULT + 170].max() < 0.03 * fastest, 'the stop has ended'
    farthest = np.abs(rows[FAULT:] - rows[FAULT]).max()
    assert (farthest
            < fastest * (0.052 + 0.5 * 0.25) * 1.05), 'grace time, then half the stop'
    held = run.positions(length=100)
    assert run.path.fault == '' and np.abs(held - rows[-1]).max() < MOST


@pytest.mark.parametrize('action', ['zero', 'hold'])
@pytest.mark.parametrize(('name', 'fault'), [
    ('fr3', 'jump'), ('fr3', 'degrees'), ('fr3', 'not finite'), ('palletizer', 'jump'),
    ('palletizer', 'contradiction'), ('palletizer', 'another assembly mode')])
def test_a_fault_that_lasts_ends_in_zeros_or_the_arm_is_held(name, fault, action):
    reason, change = FALSE[name][fault]
    run = Run(name, 'inverse_dynamics', False, action=action)
    rows = run.positions(change, count=60, length=FAULT + 60)
    assert run.statistics.faults == 1 and run.path.fault == reason
    moved = np.abs(rows - rows[0])
    assert (moved[:FAULT + 26].max()
            < MOST), 'during the grace time the last command goes on'
    if action == 'zero':
        assert not run.torque.any() and moved.max() > 5.0 * MOST
        return
    assert moved.max() < MOST
    dropped = run.statistics.dropped.total()
    again = run.positions(length=40)
    assert run.path.fault == '' and run.statistics.dropped.total() == dropped
    assert np.abs(again - rows[-1]).max() < MOST


@pytest.mark.parametrize(('name', 'fault', 'before'), [
    pytest.param('fr3', 'jump', 75, id='fr3, in the stop'),
    pytest.param('palletizer', 'contradiction', 10, id='palletizer, in the grace time'),
    pytest.param('palletizer', 'not finite', 75, id='palletizer, in the stop'),
    pytest.param('palletizer', 'another assembly mode', 140,
                 id='palletizer, at the end of the stop')])
def test_the_guard_stops_an_arm_whose_node_dies_in_a_fault_that_lasts(
        monkeypatch, name, fault, before):
    reason, change = FALSE[name][fault]
    run = GuardedRun(monkeypatch, name)
    _, moving = run.rows(FAULT)
    assert moving[-1] > 0.5
    run.rows(before, change)
    run.dead = True
    # The last torque acts in the silence of 1.5 state_timeout.
    begin, silent = run.rows(80, change)
    stop, _ = run.rows(140, change)
    assert run.guard.watch.acting and run.guard.fault == reason, run.reports
    # The stop moves the arm by half its time, 0.25 s, times the speeds at its begin.
    assert np.abs(stop - begin[-1]).max() < 0.125 * silent[-1] * 1.1 + MOST
    later_rows, _ = run.rows(60, change)
    assert np.abs(later_rows - stop[-1]).max() < MOST
    # True states end the fault.
    _, slow = run.rows(80)
    assert run.guard.fault == ''
    assert slow[-1] < 5e-3
