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
from kane_dynamics.ros.common.node_statistics import Statistics  # noqa: E402
from kane_dynamics.ros.torque_path.closed_loop_reader import ClosedLoopReader  # noqa: E402
from kane_dynamics.ros.torque_path.gravity_payload import GravityAndPayload  # noqa: E402
from kane_dynamics.ros.torque_path.native_path import python_reason  # noqa: E402
from kane_dynamics.ros.torque_path.torque_path import TorquePath  # noqa: E402
from native_rig import native_path  # noqa: E402
from node_values import node_values  # noqa: E402
from palletizer import (DRIVEN, palletizer, positions, SINGULAR_SHOULDER)  # noqa: E402
from rclpy.serialization import serialize_message  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402

NANO = 10**9
EPOCH = 1000 * NANO
NEAR = {'rtol': 1e-7, 'atol': 1e-7}  # of torques of some 1000 N m
KINDS = {'driven': 0.3, 'all': 0.2, 'some': 0.08, 'jump': 0.03, 'fast': 0.02, 'nan': 0.03,
         'nan_other': 0.02, 'stale': 0.02, 'contradiction': 0.06, 'singular': 0.04,
         'pause': 0.02, 'back': 0.01, 'motion': 0.07, 'gains': 0.03, 'mode': 0.02,
         'loads': 0.02, 'effort': 0.03}


class Sink:
    """Keeps the bytes of the published messages."""

    def __init__(self):
        self.sent = []

    def publish(self, data):
        self.sent.append(data)


class Side:
    """One of the two paths, with what it published."""

    def __init__(self, make, mode, values, clock, robot, **settings):
        self.commands, self.torques, self.stamped = Sink(), Sink(), Sink()
        self.statistics = Statistics()
        self.warnings = []
        controller = Controller(robot.copy(), mode=mode, blend_time=0.05, **settings)
        self.loops = ClosedLoopReader(controller, values)
        self.path = make(controller, self.commands, self.torques, clock, values,
                         self.statistics, lambda *words: self.warnings.append(words),
                         stamped=self.stamped, loops=self.loops)
        self.path.start()

    def outcome(self):
        path = self.path
        return {'dropped': dict(self.statistics.dropped), 'faults': self.statistics.faults,
                'timeouts': self.statistics.timeouts, 'timed out': path.timed_out,
                'commanding': path.commanding, 'fault': path.fault, 'lost': self.loops.lost,
                'commands': len(self.commands.sent), 'counted': self.statistics.commands,
                'clamped': self.statistics.clamped, 'known': path.states.known,
                'motion': path.active_motion.scheduled[0] is not None}


class Pair:
    """Both paths of an arm with closed loops, with one clock; every step is compared."""

    def __init__(self, mode, seed, values=None, robot=None, **settings):
        self.rng = np.random.default_rng(seed)
        self.time = EPOCH
        self.robot = robot or palletizer()
        self.values = node_values({
            'mode': mode, 'state_check.grace': 0.02, 'state_timeout': 0.1,
            'state_check.action': self.rng.choice(['zero', 'hold']),
            'state_check.position_margin': 10.0, **(values or {})})
        self.sides = [Side(make, mode, self.values, lambda: self.time, self.robot, **settings)
                      for make in (TorquePath, native_path)]
        self.driven = np.array([0.2, 0.3, -0.1, 0.5])
        self.rates = np.zeros(4)

    def step(self):
        kind = self.rng.choice(list(KINDS), p=list(KINDS.values()))
        getattr(self, f'do_{kind}', self.do_state)(kind)
        self.compare(kind)

    def do_state(self, kind):
        rng = self.rng
        period = int(rng.integers(1_000_000, 9_000_000))
        self.time += period
        self.rates = rng.uniform(-0.5, 0.5, 4)
        self.driven = np.clip(self.driven + 1e-9 * period * self.rates, -0.4, 0.6)
        driven, rates = self.driven.copy(), self.rates.copy()
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
            joints[rng.choice(others)] += rng.choice([-1.0, 1.0]) * rng.uniform(0.05, 1.0)
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

    def send(self, data):
        for side in self.sides:
            side.path.on_state(data)

    def stamped(self, names, positions):
        """Return a joint state at rest with the present time as its stamp."""
        message = JointState(name=list(names), position=positions,
                             velocity=[0.0] * len(positions))
        stamp = message.header.stamp
        stamp.sec, stamp.nanosec = divmod(self.time, NANO)
        return message

    def do_pause(self, kind):
        self.time += 200_000_000
        for side in self.sides:
            side.path.check_timeout()

    def do_back(self, kind):
        self.time -= 5_000_000_000
        self.do_state('driven')

    def do_motion(self, kind):
        self.follow(self.driven + self.rng.uniform(-0.1, 0.1, 4))

    def follow(self, middle, duration=0.3):
        motion = Motion.from_points([0.0, 0.3 * duration, duration],
                                    [self.driven, middle, self.driven], joint_names=DRIVEN)
        for side in self.sides:
            active = side.path.active_motion
            assert active.follow(motion, self.time + 5_000_000, self.time, active.generation)

    def do_gains(self, kind):
        kp = self.rng.uniform(1.0, 50.0)
        for side in self.sides:
            side.path.controller.update(kp=kp)
            side.path.set_limits(self.values)

    def do_mode(self, kind):
        mode = self.rng.choice(list(map(str, MODES)))
        for side in self.sides:
            side.path.active_motion.clear('mode')
            side.path.controller.update(mode=mode)
            side.path.set_limits(self.values | {'mode': mode})

    def do_effort(self, kind):
        effort = self.rng.choice([100.0, 5000.0])
        rate = self.rng.choice([2000.0, math.inf])
        for side in self.sides:
            side.path.controller.update(effort_limit=effort, rate_limit=rate)
            side.path.set_limits(self.values)

    def do_loads(self, kind):
        loads = GravityAndPayload(self.rng.uniform(-9.0, 9.0, 3))
        for side in self.sides:
            side.path.set_loads(loads)

    def compare(self, kind):
        python, native = self.sides
        assert native.outcome() == python.outcome(), kind
        for name in ('commands', 'stamped', 'torques'):
            ours, theirs = (getattr(side, name).sent[-1:] for side in (native, python))
            for mine, expected in zip(ours, theirs, strict=True):
                count = 8 * len(native.path.messages.joints)
                np.testing.assert_allclose(np.frombuffer(mine[-count:]),
                                           np.frombuffer(expected[-count:]), **NEAR)
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


def test_a_motion_after_the_first_command_waits_for_its_report():
    pair = Pair('computed_torque', 3)
    _, side = pair.sides
    path = side.path
    pair.send(serialize_message(pair.stamped(DRIVEN, list(pair.driven))))
    pair.time += 2_000_000
    path.native.answer(serialize_message(pair.stamped(DRIVEN, list(pair.driven))))
    assert len(side.commands.sent) == 1 and not path.last_update
    with ThreadPoolExecutor(1) as services:
        begin = services.submit(path.desired, pair.time)
        time.sleep(0.02)
        path.read_reports()
        q, _, _ = begin.result(5.0)
    np.testing.assert_allclose(q, pair.driven)


@pytest.mark.parametrize(('clock', 'moved', 'lost'), [(0, 0.0, False), (0, 1e-4, True),
                                                      (-5 * NANO, 0.0, False),
                                                      (-5 * NANO, 1e-4, True)])
def test_states_without_time_between_them_are_of_a_fast_arm_if_they_differ(clock, moved, lost):
    """A fast arm can be at a singular configuration soon, where its assembly mode is lost."""
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
    assert not python_reason(node_values(), controller)
    assert python_reason(node_values({'modes': ['joint_impedance']}), controller) == (
        'mode joint_impedance of an arm with closed loops')
