"""Closed loops on the native torque path: its answers are those of the interpreter's."""

from concurrent.futures import ThreadPoolExecutor
import math
import time

import numpy as np
import pytest

pytest.importorskip('rclpy')

from kane_dynamics import Controller, Motion  # noqa: E402, I100
from kane_dynamics.control.traced_laws import MODES  # noqa: E402
from kane_dynamics.loop_tracking.loop_error import CONTRADICTION  # noqa: E402
from kane_dynamics.ros.torque_path import torque_path  # noqa: E402
from kane_dynamics.ros.torque_path.closed_loop_reader import (  # noqa: E402
    ClosedLoopReader)
from native_rig import BothPaths, Choices, NANO, Side  # noqa: E402
from node_values import node_values  # noqa: E402
from palletizer import (DRIVEN, palletizer, positions, SINGULAR_SHOULDER)  # noqa: E402
from rclpy.serialization import serialize_message  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402

STEPS = {'driven': 0.3, 'all': 0.2, 'some': 0.08, 'jump': 0.03, 'fast': 0.02,
         'nan': 0.03,
         'nan_other': 0.02, 'stale': 0.02, 'contradiction': 0.06, 'singular': 0.04,
         'pause': 0.02, 'back': 0.01, 'motion': 0.07, 'gains': 0.03, 'mode': 0.02,
         'loads': 0.02, 'effort': 0.03}
# Torques are of some 1000 N m.
CHOICES = Choices(STEPS, tuple(map(str, MODES)),
                  efforts=(100.0, math.inf), rate=2000.0, near=1e-7)


class Pair(BothPaths):
    """Both paths of an arm with closed loops."""

    def __init__(self, mode, seed, values=None, robot=None, **settings):
        self.robot = robot or palletizer()
        super().__init__(CHOICES, mode, seed,
                         {'state_check.position_margin': 10.0, **(values or {})},
                         **settings)
        self.driven = np.array([0.2, 0.3, -0.1, 0.5])

    def side(self, make, mode, **settings):
        controller = Controller(self.robot.copy(),
                                mode=mode, blend_time=0.05, **settings)
        return Side(make, controller, self.values, self.clock,
                    ClosedLoopReader(controller, self.values))

    def do_state(self, kind):
        rng = self.rng
        period = int(rng.integers(1_000_000, 9_000_000))
        self.time += period
        rates = rng.uniform(-0.5, 0.5, 4)
        self.driven = np.clip(self.driven + 1e-9 * period * rates, -0.4, 0.6)
        driven = self.driven.copy()
        whole = dict(zip(self.robot.joint_names, positions(self.robot, *driven)))
        if kind == 'singular':
            driven[1] = SINGULAR_SHOULDER + rng.uniform(-0.003, 0.003)
        elif kind == 'jump':
            driven[rng.integers(4)] += 0.7
        elif kind == 'fast':
            rates[rng.integers(4)] = 1e4
        elif kind == 'nan':
            driven[rng.integers(4)] = rng.choice([math.nan, math.inf])
        joints = dict(zip(DRIVEN, driven))
        others = [name for name in whole if name not in DRIVEN]
        if kind == 'some':
            others = list(rng.choice(others, 2, replace=False))
        if kind in ('all', 'some', 'contradiction', 'nan_other'):
            joints |= {name: whole[name] for name in others}
        if kind == 'contradiction':
            joints[rng.choice(others)] += rng.choice([-1.0, 1.0]) * rng.uniform(
                0.05, 1.0)
        elif kind == 'nan_other':
            joints[rng.choice(others)] = math.nan
        names = list(rng.permutation(list(joints)))
        speeds = dict.fromkeys(joints, 0.0) | dict(zip(DRIVEN, rates))
        message = JointState(name=names, position=[joints[name] for name in names],
                             velocity=[speeds[name] for name in names])
        stamp = message.header.stamp
        age = 300_000_000 if kind == 'stale' else 0
        stamp.sec, stamp.nanosec = divmod(self.time - age, NANO)
        self.send(serialize_message(message))

    def stamped(self, names, positions):
        """Return a joint state at rest with the present time as its stamp."""
        message = JointState(name=list(names), position=positions,
                             velocity=[0.0] * len(positions))
        stamp = message.header.stamp
        stamp.sec, stamp.nanosec = divmod(self.time, NANO)
        return message

    def do_motion(self, kind):
        middle = self.driven + self.rng.uniform(-0.1, 0.1, 4)
        motion = Motion.from_points([0.0, 0.09, 0.3], [self.driven, middle, self.driven],
                                    joint_names=DRIVEN)
        self.follow(motion, 5_000_000)

    def do_gains(self, kind):
        kp = self.rng.uniform(1.0, 50.0)
        for side in self.sides:
            side.path.controller.update(kp=kp)
            side.path.set_limits(self.values)

    def compare(self, kind):
        super().compare(kind)
        python, native = self.sides
        if not self.sides[0].loops.lost:
            np.testing.assert_allclose(native.loops.q, python.loops.q, atol=1e-9)
            np.testing.assert_allclose(native.loops.u, python.loops.u, atol=1e-8)


@pytest.mark.parametrize('mode', MODES)
def test_both_paths_close_the_loops_and_refuse_the_same_states(mode):
    pair = Pair(mode, 3, rate_limit=4e5)
    for _ in range(300):
        pair.step()
    dropped = pair.sides[1].statistics.dropped
    assert pair.sides[1].statistics.commands > 100
    assert dropped[CONTRADICTION] > 3
    python, native = (side.warnings for side in pair.sides)
    assert [reason for reason, _ in native] == [reason for reason, _ in python]


@pytest.mark.parametrize('mode', MODES)
def test_a_motion_begins_at_the_joints_that_follow(mode):
    pair = Pair(mode, 3)
    for _ in range(3):
        pair.do_state('driven')
    python, native = (side.path.desired(pair.time) for side in pair.sides)
    assert native[0].shape == (len(DRIVEN),)
    np.testing.assert_allclose(native, python, atol=1e-12)


@pytest.fixture
def patient(monkeypatch):
    """Let a motion wait longer for a report than a busy machine delays its reader."""
    monkeypatch.setattr(torque_path, 'LONGEST_LAG', 5.0)


def test_a_motion_after_the_first_command_waits_for_its_report(patient):
    pair = Pair('computed_torque', 3)
    _, side = pair.sides
    path = side.path
    pair.send(serialize_message(pair.stamped(DRIVEN, list(pair.driven))))
    pair.time += 2_000_000
    path.native.call('cycle', serialize_message(pair.stamped(DRIVEN, list(pair.driven))))
    assert len(side.commands.sent) == 1 and not path.last_update
    with ThreadPoolExecutor(1) as services:
        begin = services.submit(path.desired, pair.time)
        time.sleep(0.02)
        path.read_reports()
        q, _, _ = begin.result(5.0)
    np.testing.assert_allclose(q, pair.driven)


def test_refusals_after_a_timeout_wait_for_the_reports_of_new_states(
        patient):
    pair = Pair('computed_torque', 3)
    path = pair.sides[1].path
    pair.do_state('driven')
    pair.do_pause('pause')
    assert path.timed_out
    for _ in range(2):
        pair.time += 2_000_000
        path.native.call('cycle',
                         serialize_message(pair.stamped(DRIVEN, list(pair.driven))))
    assert path.timed_out, 'not reported'
    with ThreadPoolExecutor(1) as services:
        caught_up = services.submit(path.catch_up)
        time.sleep(0.02)
        path.read_reports()
        caught_up.result(5.0)
    assert not path.timed_out


@pytest.mark.parametrize(('clock', 'moved', 'lost'), [(0, 0.0, False), (0, 1e-4, True),
                                                      (-5 * NANO, 0.0, False),
                                                      (-5 * NANO, 1e-4, True)])
def test_states_without_time_between_them_are_of_a_fast_arm_if_they_differ(
        clock, moved, lost):
    """A fast arm may soon be at a singularity, where its assembly mode is lost."""
    pair = Pair('computed_torque', 3, values={'state_check.speed_factor': math.inf})

    def send(shoulder):
        pair.send(serialize_message(pair.stamped(DRIVEN, [0.0, shoulder, -0.1, 0.5])))
        pair.compare('driven')
    for _ in range(3):
        pair.time += 5_000_000
        send(0.2)
    pair.time += clock
    send(0.2 + moved)
    pair.time += 1_000_000
    send(SINGULAR_SHOULDER)
    assert [side.loops.lost for side in pair.sides] == [lost, lost]


def test_limits_of_the_modes_are_named():
    controller = Controller(palletizer())
    loops = ClosedLoopReader(controller, node_values())
    assert not torque_path.python_reason(node_values(), controller, loops)
    reason = torque_path.python_reason(node_values({'modes': ['joint_impedance']}),
                                       controller, loops)
    assert reason == 'mode joint_impedance of an arm with closed loops'
