"""The native torque path does what the interpreter's does, on random states."""

from collections import Counter
import ctypes
from functools import cache, partial
import gc
import math
import mmap
import struct
import threading
import time

import numpy as np
import pytest

pytest.importorskip('rclpy')

from kane_dynamics import Controller, load_urdf, Motion, Robot, Terms  # noqa: E402, I100
from kane_dynamics._util.resources import resource_path  # noqa: E402
from kane_dynamics.control import traced_laws  # noqa: E402
from kane_dynamics.control.terms import Mode  # noqa: E402
from kane_dynamics.control_cycle import cycle_results, cycle_rules  # noqa: E402
from kane_dynamics.control_cycle.cycle import Cycle, turning_joints  # noqa: E402
from kane_dynamics.native.runtime.message_loop import (Block, CONSTANTS,  # noqa: E402
                                                       Event)
from kane_dynamics.ros.common.cdr import (PreparedMessage, wrench_stamped,  # noqa: E402
                                          write_joint_state)
from kane_dynamics.ros.common.rcl_functions import (  # noqa: E402
    handle_address, message_of, SerializedMessage, UnsupportedError)
from kane_dynamics.ros.loads.gravity_payload import GravityAndPayload  # noqa: E402
from kane_dynamics.ros.loads.wrench_input import WrenchInput  # noqa: E402
from kane_dynamics.ros.modes.task_modes import (native_laws,  # noqa: E402
                                                NATIVE_MODES, TaskModes)
from kane_dynamics.ros.torque_path import native_loop  # noqa: E402
from kane_dynamics.ros.torque_path.drop_reasons import LEARNED  # noqa: E402
from kane_dynamics.ros.torque_path.torque_path import python_reason  # noqa: E402
from native_rig import BothPaths, Choices, NANO, Side  # noqa: E402
from node_values import node_values, update_laws  # noqa: E402

MODEL = load_urdf(resource_path('urdf', 'two_link.urdf'))
ROBOT = Robot(MODEL)
WITH_WRENCHES = Robot(MODEL, wrench_frames=tuple(body.name for body in MODEL.bodies))
NAMES = ROBOT.joint_names
MODES = (*map(str, traced_laws.MODES), *map(str, NATIVE_MODES))
STEPS = {'state': 0.55, 'jump': 0.05, 'far': 0.03, 'fast': 0.03, 'nan': 0.03,
         'stale': 0.02, 'ahead': 0.02, 'order': 0.02, 'pause': 0.02, 'back': 0.01,
         'motion': 0.04, 'gains': 0.03,
         'mode': 0.02, 'loads': 0.02, 'effort': 0.03, 'turn': 0.03, 'target': 0.05}
CHOICES = Choices(STEPS, MODES, efforts=(1.0, 10.0, math.inf), rate=20.0, near=1e-9)
CHANGED = ('mode', 'modes', 'blend_time', 'target.timeout', 'state_check.grace',
           'state_check.action', 'state_timeout')
TAKE = ctypes.CFUNCTYPE(ctypes.c_int, *[ctypes.c_void_p] * 4)
REST = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_uint)


def numbers(data):
    return np.frombuffer(data[-8 * len(NAMES):])


def message(q, u, stamp, names=NAMES):
    n = len(names)
    writer, (positions, velocities, _) = write_joint_state(names, '', (n, n, 0))
    prepared = PreparedMessage(writer, positions, n)
    prepared.numbers[:] = q
    prepared.doubles(velocities, n)[:] = u
    prepared.stamp(*divmod(stamp, NANO))
    return prepared.serialized()


class Pair(BothPaths):
    """Both paths of an arm that is a tree, in all modes that are native."""

    def __init__(self, mode, seed, values=None, **settings):
        super().__init__(CHOICES, mode, seed, {
            'modes': list(NATIVE_MODES), 'blend_time': 0.05, 'target.timeout': 0.03,
            **(values or {})}, **settings)
        self.q = np.array([0.3, -0.2])

    @property
    def names(self):
        """Return the joints of the states."""
        return self.sides[0].path.controller.robot.joint_names

    def side(self, make, mode, **settings):
        values = self.values
        robot = (WITH_WRENCHES if values['wrench.frames'] else ROBOT).copy()
        modes = TaskModes(robot, values)
        controller = Controller(robot, mode=mode, blend_time=values['blend_time'],
                                laws=modes.laws, **settings)
        side = Side(make, controller, values, self.clock)
        side.modes = modes
        side.rejected = []
        if values['wrench.frames']:
            side.path.wrenches = WrenchInput(robot, self.clock, values,
                                             lambda *words: side.rejected.append(words))
            side.path.wrenches.changed = side.path.law_changed
        law = modes.laws.get(Mode.CARTESIAN_IMPEDANCE)
        if law is not None:
            side.target = law.target
            side.target.changed = side.path.law_changed
        return side

    def do_state(self, kind):
        self.time += int(self.rng.integers(1_000_000, 9_000_000))
        n = len(self.q)
        u = self.rng.uniform(-0.5, 0.5, n)
        self.q = self.q + 0.001 * u
        q = self.q.copy()
        age = 0
        if kind == 'jump':
            q[n - 1 - self.rng.integers(2)] += 0.7
        elif kind == 'far':
            q[-1] += 50.0
        elif kind == 'fast':
            u[n - 1 - self.rng.integers(2)] = 1e4
        elif kind == 'nan':
            q[self.rng.integers(n)] = self.rng.choice([math.nan, math.inf])
        elif kind == 'turn':
            q[-2] += 2.0 * math.pi
        age = {'stale': 300_000_000, 'ahead': -300_000_000, 'order': 30_000_000}.get(
            kind, 0)
        self.send(message(q, u, self.time - age, self.names))

    def do_motion(self, kind):
        motion = Motion.from_points([0.0, 0.1, 0.3], [self.q, self.q + 0.05, self.q],
                                    joint_names=self.names)
        self.follow(motion, 10_000_000)

    def do_gains(self, kind):
        kp = self.rng.uniform(1.0, 50.0)
        # Damping that is stated and damping by ratio follow each other.
        damping = [0.05 * kp, 0.1 * kp] if self.rng.random() < 0.5 else []
        self.values |= node_values({
            'joint_impedance.stiffness': [kp] * 2, 'joint_impedance.damping': damping,
            'joint_impedance.damping_ratio': [0.3, 1.2],
            'hand_guiding.damping': [0.1 * kp] * 2,
            'cartesian.stiffness': [10.0 * kp] * 6}) | {
                name: self.values[name] for name in CHANGED}
        for side in self.sides:
            side.path.controller.update(kp=kp)
            values = self.values | {'mode': side.path.controller.mode}
            if update_laws(side.modes, values):
                side.path.blend()
            side.path.set_limits(self.values)

    def do_target(self, kind):
        """Let a message ask for a pose, a twist or a wrench."""
        what = self.rng.choice(['pose', 'twist', 'wrench'])
        pose = ROBOT.frame_pose(ROBOT.frame_names[-1], self.q)
        pose[:3, 3] += self.rng.uniform(-0.1, 0.1, 3)
        numbers = self.rng.uniform(-0.3, 0.3, 6)
        turns = bool(self.rng.integers(2))
        for side in self.sides:
            if what == 'pose':
                side.target.go_to(pose, self.time)
            elif what == 'twist':
                side.target.move(numbers, turns, self.time)
            else:
                side.target.press(numbers, turns, self.time)

    def do_wrench(self, kind):
        """Let a sensor measure a wrench at a frame, with a stamp or too late."""
        frame = self.rng.choice([body.name for body in MODEL.bodies])
        stamp = self.time - int(self.rng.choice([0, 0, 0, 200_000_000]))
        measured = wrench_stamped(frame)
        measured.numbers[:] = self.rng.uniform(-9.0, 9.0, 6)
        measured.stamp(*divmod(stamp, NANO))
        for side in self.sides:
            side.path.wrenches.on_message(measured.serialized())

    def compare(self, kind):
        super().compare(kind)
        python, native = self.sides
        assert native.rejected == python.rejected


@pytest.mark.parametrize('compensate', [
    pytest.param(Terms(), id='every term'),
    pytest.param(Terms(friction=False, inertia=False),
                 id='some terms', marks=pytest.mark.slow)])
@pytest.mark.parametrize('mode', MODES)
def test_both_paths_give_the_same_commands_and_drop_the_same_states(mode, compensate):
    pair = Pair(mode, 3, compensate=compensate, rate_limit=400.0)
    for _ in range(400):
        pair.step()
    statistics = pair.sides[1].statistics
    assert statistics.commands > 100
    assert len(statistics.dropped) >= 5, 'every kind of fault'
    assert statistics.timeouts
    # What a person reads is the same too, but for the text of an overflow.
    texts = []
    for side in pair.sides:
        texts.append([text for text in side.warnings if text[0] != 'no finite torque'])
    assert texts[1] == texts[0]


@cache
def on_base(kind):
    """Return the arm on a heavy base that moves in a plane or in space."""
    ball = {'ixx': 2.0, 'iyy': 2.0, 'izz': 2.0}
    return Robot(load_urdf(
        resource_path('urdf', 'two_link.urdf'), root_joint=kind, supplement={
            'payload': {'link': 'base_link', 'mass': 40.0, 'inertia': ball}}))


class OnBase(Pair):
    """Both paths of an arm on a base whose joint has no motors."""

    def __init__(self, base, mode, seed):
        self.robot = on_base(base)
        super().__init__(mode, seed)
        self.q = np.append(np.full(self.robot.n - 2, 0.1), self.q)

    def side(self, make, mode, **settings):
        robot = self.robot.copy()
        controller = Controller(robot, mode=mode, blend_time=self.values['blend_time'],
                                **settings)
        side = Side(make, controller, self.values, self.clock)
        side.rejected = []
        return side

    def do_gains(self, kind):
        kp = self.rng.uniform(1.0, 50.0)
        for side in self.sides:
            side.path.controller.update(kp=kp)
            side.path.set_limits(self.values)

    def do_mode(self, kind):
        self.change_mode(self.rng.choice(list(map(str, traced_laws.MODES))))

    def do_target(self, kind):
        self.do_state('state')


@pytest.mark.filterwarnings('ignore:moving links without')  # the base has a payload
@pytest.mark.parametrize(('base', 'mode'), [
    ('planar', 'computed_torque'), ('planar', 'inverse_dynamics'),
    ('floating', 'computed_torque'),
    pytest.param('floating', 'gravity_compensation', marks=pytest.mark.slow)])
def test_both_paths_command_an_arm_on_a_base_without_motors_alike(base, mode):
    pair = OnBase(base, mode, 4)
    for _ in range(300):
        pair.step()
    _, native = pair.sides
    assert native.path.messages.joints == NAMES
    assert native.statistics.commands > 80
    assert len(native.statistics.dropped) >= 5, 'every kind of fault'
    assert not python_reason(pair.values | {'modes': []}, native.path.controller, None)


@pytest.mark.parametrize('mode', ['computed_torque', 'inverse_dynamics',
                                  'gravity_compensation', 'hand_guiding'])
def test_measured_wrenches_act_on_both_paths_as_long_as_they_are_in_time(mode):
    pair = Pair(mode, 5, {'wrench.frames': [body.name for body in MODEL.bodies],
                          'wrench.timeout': 0.05, 'wrench.rise_time': 0.0,
                          'modes': []})
    for step in range(200):
        if step % 10 < 3:
            pair.do_wrench('wrench')
        pair.do_state('state')
        if step % 50 == 49:
            pair.do_back('back')
        pair.compare(step)
    assert {'timed out after wrench.timeout', 'stale (older than wrench.timeout)'} <= {
        reason for reason, _ in pair.sides[1].rejected}
    external = pair.sides[1].path.wrenches
    for side in pair.sides:
        side.path.wrenches.clear()
        side.path.law_changed()
    pair.do_state('state')
    without = numbers(pair.sides[1].commands.sent[-1]).copy()
    pair.do_wrench('wrench')
    while not external.latest:
        pair.do_wrench('wrench')
    pair.do_state('state')
    pair.compare('wrench')
    changes = np.abs(numbers(pair.sides[1].commands.sent[-1]) - without).max() > 0.5
    assert changes == (mode in ('computed_torque', 'inverse_dynamics'))


@pytest.mark.slow  # compiles every law, of each choice
@pytest.mark.parametrize('mode', MODES)
def test_both_paths_have_the_same_friction_at_reversals(mode, monkeypatch):
    joints = {name: {'friction': 2.0, 'friction_speed': 0.05} for name in NAMES}
    model = load_urdf(resource_path('urdf', 'two_link.urdf'),
                      supplement={'joints': joints})
    commands = []
    for choice in ('desired_speed', 'ahead', 'none'):
        monkeypatch.setitem(globals(), 'ROBOT',
                            Robot(model, feedforward_friction=choice))
        pair = Pair(mode, 3)
        for _ in range(3):
            pair.do_motion('motion')
            for _ in range(10):
                pair.do_state('state')
                pair.compare('state')
        commands.append(np.array(list(map(numbers, pair.sides[1].commands.sent))))
    # These modes follow motions.
    if mode in ('inverse_dynamics', 'computed_torque', 'joint_impedance'):
        assert np.abs(np.diff(commands, axis=0)).max(axis=(1, 2)).min() > 0.5


@pytest.mark.parametrize(('mode', 'variants'), [
    ('cartesian_impedance',
     [{}, {'cartesian.frame': 'link1'}, {'cartesian.axes': 'frame'},
      {'cartesian.axes': 'base_link'}])])
def test_a_law_of_another_frame_is_not_answered_from_the_cache(mode, variants):
    """The cache is on disk: the law before can be that of an earlier configuration."""
    for variant in variants:
        stiffness = {'cartesian.stiffness': [100.0, 900.0, 0.0, 0.0, 0.0, 0.0]}
        pair = Pair(mode, 3, stiffness | variant)
        for step in range(20):
            pair.do_state('state')
            if step == 5:
                pair.do_target('target')
            pair.compare(variant)


@pytest.mark.parametrize('message', ['move', 'press'])
def test_twist_and_wrench_end_when_the_clock_jumps_backward(message):
    pair = Pair('cartesian_impedance', 3)
    pair.time += 100 * NANO
    for _ in range(3):
        pair.do_state('state')
    for side in pair.sides:
        getattr(side.target, message)(np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0]), False,
                                      pair.time)
    pair.do_state('state')
    acting = [side.path.controller.laws[Mode.CARTESIAN_IMPEDANCE].snapshot(pair.time)
              for side in pair.sides]
    assert all(np.abs(np.concatenate(snapshot.detail[:2])).max() > 0.0
               for snapshot in acting)
    pair.do_back('back')
    for _ in range(60):
        pair.do_state('state')
        pair.compare(message)
    for side in pair.sides:
        law = side.path.controller.laws[Mode.CARTESIAN_IMPEDANCE]
        pose = law.snapshot(pair.time).desired
        twist, wrench, _ = law.snapshot(pair.time).detail
        assert np.abs(np.concatenate([twist, wrench])).max() < 1e-3
        assert law.snapshot(pair.time).target_age == -1.0
        measured = ROBOT.frame_pose(law.frame, pair.q)
        assert np.abs(pose - measured).max() < 0.02


def test_a_posture_that_equals_the_default_is_blended_in():
    """The other settings stay, but the torque of the posture changes."""
    pair = Pair('cartesian_impedance', 3, {'cartesian.posture_stiffness': [30.0, 30.0]})
    for _ in range(5):
        pair.do_state('state')
    torque_before = numbers(pair.sides[0].commands.sent[-1]).copy()
    pair.values = pair.values | node_values(
        {'cartesian.posture': ROBOT.neutral().tolist(),
         'cartesian.posture_stiffness': [30.0, 30.0]}) | {
        name: pair.values[name] for name in CHANGED}
    for side in pair.sides:
        if update_laws(side.modes, pair.values):
            side.path.blend()
        side.path.set_limits(pair.values)
    for _ in range(20):
        pair.do_state('state')
        pair.compare('posture')
    assert np.abs(numbers(pair.sides[0].commands.sent[-1]) - torque_before).max() > 0.1


def test_no_memory_of_another_law_is_read_as_that_of_the_frame():
    pair = Pair('joint_impedance', 3)
    for _ in range(3):
        pair.do_state('state')
    pair.time += 1_000_000
    path = pair.sides[1].path
    path.native.call('cycle', message(pair.q, np.zeros(2), pair.time))
    path.controller.update(mode='cartesian_impedance')
    path.set_limits(pair.values)
    path.read_reports()
    law = path.controller.laws[Mode.CARTESIAN_IMPEDANCE]
    assert law.snapshot(pair.time).desired is None
    described = law.describe(pair.q, np.zeros(2), law.snapshot(pair.time))
    assert not described.saturated and not described.wrench.any()
    pair.time += 1_000_000
    path.on_state(message(pair.q, np.zeros(2), pair.time))
    np.testing.assert_allclose(law.snapshot(pair.time).desired,
                               ROBOT.frame_pose(law.frame, pair.q), atol=1e-12)


@pytest.mark.parametrize('mode', ['computed_torque', 'joint_impedance', 'hand_guiding'])
def test_the_compiled_rules_equal_the_readable_ones(mode):
    """The functions of `cycle_rules` on floats give what the thread's memory holds."""
    pair = Pair(mode, 6)
    path = pair.sides[1].path
    loop = path.native
    robot = path.controller.robot
    laws = traced_laws.controller_laws(robot, path.controller.compensate)
    laws |= {mode: law.traced() for mode, law in native_laws(path.controller).items()}
    stop = cycle_rules.ModelStop(robot, path.controller.compensate, range(robot.n))
    compared = Counter()
    for _ in range(60):
        pair.step()
        state_before = cycle_rules.unpacked_path(loop.path.copy(), loop.shape)
        pair.do_state(pair.rng.choice(['state', 'state', 'jump', 'far', 'fast']))
        settings = path._settings()
        event = Event.from_buffer(loop.event)
        event = cycle_rules.Event(event.now, event.stamp, 0.0, 0.0, 1.0, event.steady)
        judged = cycle_rules.judge(state_before, event, loop.state.copy(), settings,
                                   turning_joints(robot, NAMES))
        state_after = cycle_rules.unpacked_path(loop.path.copy(), loop.shape)
        if path.active_motion.scheduled != (None, None):
            continue
        parameters = path.controller.robot.parameters.block
        if state_after.reason >= cycle_results.NOT_FINITE:
            expected = cycle_rules.refuse(stop, judged, event, settings, parameters)
        elif state_after.reason == cycle_results.ACCEPTED:
            expected = cycle_rules.answer(
                robot, laws[path.controller.mode], judged, event, loop.state.copy(),
                np.zeros((6, 6)), settings, parameters, parameters[3:])
        else:
            expected = judged
        np.testing.assert_allclose(cycle_rules.packed(state_after),
                                   cycle_rules.packed(expected), rtol=1e-9, atol=1e-9)
        compared[int(state_after.reason)] += 1
    assert compared[cycle_results.ACCEPTED] > 10
    refused = range(cycle_results.NOT_FINITE, cycle_results.REFUSED)
    assert any(compared[code] for code in refused)


def test_durations_of_cycles_and_of_an_empty_loop_are_measured():
    pair = Pair('gravity_compensation', 1)
    path = pair.sides[1].path
    pair.do_state('state')
    pair.do_state('state')
    sent = len(pair.sides[1].commands.sent)
    loop = path.native
    data = message(pair.q, np.zeros(2), pair.time)
    cycles = loop.durations(data, 20)
    assert len(pair.sides[1].commands.sent) == sent + 20
    empty = loop.durations(data, 20, works=False)
    assert len(pair.sides[1].commands.sent) == sent + 20
    assert (cycles > 0).all()
    assert len(empty) == 20
    assert np.median(empty) < np.median(cycles)


def test_a_full_ring_counts_what_nothing_observed():
    pair = Pair('gravity_compensation', 1)
    side = pair.sides[1]
    pair.do_state('state')
    pair.do_state('state')
    stamped = message(pair.q, np.zeros(2), pair.time)
    for _ in range(native_loop.SLOTS + 7):
        side.path.native.call('cycle', stamped)
    side.path.read_reports()
    assert side.path.native.number('lost') == 7
    assert side.statistics.unobserved == 7
    assert side.warnings[-1][0] == 'cycles'


def in_motion():
    """Return both paths while they follow a motion."""
    pair = Pair('computed_torque', 1, {'state_check.action': 'zero'})
    for _ in range(2):
        pair.do_state('state')
    pair.follow(
        Motion.from_points([0.0, 1.0], [pair.q, pair.q + 0.5], joint_names=NAMES), 0)
    return pair


def test_a_motion_does_not_come_back_if_the_report_of_its_fault_was_lost():
    pair = in_motion()
    side = pair.sides[1]

    def answer(data):
        side.path.native.call('cycle', data)

    for _ in range(native_loop.SLOTS):  # nothing reads the reports meanwhile
        answer(message(pair.q, np.zeros(2), pair.time))
    for _ in range(4):  # longer than the grace time
        pair.time += 10_000_000
        answer(message(pair.q + 1.0, np.zeros(2), pair.time))
    assert side.path.native.number('lost')
    side.path.read_reports()
    pair.time += 10_000_000
    answer(message(pair.q, np.zeros(2), pair.time))
    side.path.read_reports()
    assert side.path.active_motion.scheduled == (None, None)
    assert side.path.active_motion.reason == 'joint states were refused'


def test_a_stale_state_is_counted_as_such_if_the_timeout_grows_before_it_is_reported():
    pair = in_motion()
    for late, stamp in (('stale', pair.time - 300_000_000),
                        ('future', pair.time + 300_000_000),
                        ('before', pair.time - 50_000_000)):
        side = pair.sides[1]
        count_before = side.statistics.dropped.total()
        side.path.native.call('cycle', message(pair.q, np.zeros(2), stamp))
        side.path.set_limits(
            pair.values | {'state_timeout': 0.01 if late == 'before' else 1.0})
        side.path.read_reports()
        side.path.set_limits(pair.values)
        assert side.statistics.dropped.total() == count_before + 1
        assert late in side.warnings[-1][0]


def test_a_stop_replaces_the_motion_without_a_plan_that_has_neither(monkeypatch):
    pair = in_motion()
    path = pair.sides[1].path
    scheduled = []
    use = path.native.use
    monkeypatch.setattr(path.native, 'use', lambda plan: (
        scheduled.append(path.active_motion.scheduled), use(plan)))
    moving = path.active_motion.desired(pair.time + 500_000_000)
    stamp = pair.time
    pair.time += 500_000_000  # the report of the collision is late
    assert path.interrupt(stamp, 'collision')
    assert scheduled and all(current is not None for current, _ in scheduled)
    begun = path.active_motion.desired(pair.time)
    np.testing.assert_allclose(begun[:2], moving[:2], atol=1e-12)
    _, at_rest, _ = path.active_motion.desired(pair.time + NANO)
    np.testing.assert_allclose(at_rest, 0.0, atol=1e-12)


def test_a_thread_that_ends_by_itself_ends_the_path_until_it_is_started_again():
    pair = in_motion()
    side = pair.sides[1]
    path = side.path
    path.native.set_fields(ended=1)
    path.read_reports()
    assert not path.running
    assert path.active_motion.scheduled == (None, None)
    assert path.ended == 'the native torque path ended: rcl returned 1'
    assert path.active_motion.reason == path.ended
    assert not numbers(side.commands.sent[-1]).any()
    assert [reason for reason, _ in side.warnings].count(
        'the native torque path ended') == 1
    path.read_reports()  # once
    assert path.measured() is None
    count = len(side.commands.sent)
    pair.do_state('state')
    assert len(side.commands.sent) == count
    path.start()
    for _ in range(3):
        pair.do_state('state')
    assert len(side.commands.sent) > count
    assert not path.ended


class Middleware:
    """Stands for rcl: each message is a returned code or a state's bytes."""

    def __init__(self, loop, messages):
        self.messages = list(messages)
        self.rests = []
        self._kept = (SerializedMessage * 2)()
        self._functions = []
        nothing = self._word(TAKE, lambda *words: 0)
        loop.set_fields(
            clear=nothing, add_subscription=nothing, add_guard_condition=nothing,
            wait=nothing, take=self._word(TAKE, self.take),
            rest_for=self._word(REST, self.rest))
        loop.block.states.subscription = 1
        loop.block.states.taken = ctypes.addressof(self._kept)
        self._stop = partial(loop.publish_number, 'stop', 1)

    def _word(self, kind, function):
        """Return the address of a function, which is kept."""
        self._functions.append(kind(function))
        return native_loop.function_address(self._functions[-1])

    def rest(self, microseconds):
        self.rests.append(microseconds)
        return 0

    def take(self, subscription, taken, info, allocation):
        if not self.messages:
            self._stop()
            return CONSTANTS['NOTHING_TAKEN']
        message = self.messages.pop(0)
        if isinstance(message, int):
            return message
        self._bytes = np.frombuffer(message, dtype=np.uint8).copy()
        self._kept[0] = message_of(self._bytes)
        return 0


def taken_in_a_thread(messages):
    """Return the native side of a pair, with no message left to read."""
    pair = Pair('gravity_compensation', 1)
    pair.do_state('state')
    pair.do_state('state')
    side = pair.sides[1]
    loop = side.path.native
    middleware = Middleware(loop, messages(message(pair.q, np.zeros(2), pair.time)))
    loop._code.function('run', ctypes.CFUNCTYPE(None, ctypes.c_void_p))(
        loop.address)
    return side, middleware


def test_a_failure_to_take_messages_is_reported_and_the_thread_rests():
    failed = [1] * 7
    side, middleware = taken_in_a_thread(
        lambda state: [*failed, state, *failed, CONSTANTS['NOTHING_TAKEN']])
    count_before = side.statistics.commands
    side.path.read_reports()
    assert side.statistics.commands == count_before + 1
    assert middleware.rests == [CONSTANTS['PAUSE']] * 14
    assert side.path.running
    assert side.warnings[-1] == ('messages', '14 not returned by the middleware')


def test_failures_to_take_messages_that_last_end_the_path():
    count = CONSTANTS['MOST_FAILURES']
    side, middleware = taken_in_a_thread(
        lambda state: [10] * (count - 1) + [state] + [10] * count + [state])
    assert len(middleware.messages) == 1, 'ended'
    assert not numbers(side.commands.sent[-1]).any()
    side.path.read_reports()
    assert side.path.ended == 'the native torque path ended: rcl returned 10'
    side.path.stop()
    assert not side.path.ended
    side.path.start()
    assert side.path.native.number('ended') == 0


def test_a_refused_publication_is_raised_on_both_paths():
    pair = in_motion()

    def refuse(data):
        raise RuntimeError('refused')
    for side in pair.sides:
        side.torques.publish = refuse
        pair.time += 1_000_000
        with pytest.raises(RuntimeError, match='refused'):
            side.path.on_state(message(pair.q, np.zeros(2), pair.time))
        del side.torques.publish
        count = len(side.torques.sent)
        side.path.stop()
        assert not numbers(side.commands.sent[-1]).any()
        assert len(side.torques.sent) == count + 1
        side.path.start()
        side.path.on_state(message(pair.q, np.zeros(2), pair.time))


def test_a_law_that_fails_is_a_fault_like_a_refused_publication():
    pair = in_motion()
    side, _ = pair.sides
    path = side.path

    def fail():
        raise ValueError('this law fails')
    path.rules._law.torque = fail
    last = numbers(side.commands.sent[-1])
    pair.time += 1_000_000
    with pytest.raises(ValueError, match='this law fails'):
        path.on_state(message(pair.q, np.zeros(2), pair.time))
    assert path.refused
    # The last command is repeated at most.
    np.testing.assert_array_equal(numbers(side.commands.sent[-1]), last)
    path.stop()
    assert not numbers(side.commands.sent[-1]).any()
    del path.rules._law.torque
    path.start()
    assert not path.refused


def test_no_cycle_has_a_part_of_changes_that_belong_together():
    pair = in_motion()
    path = pair.sides[1].path
    plan = path.native._plans[-1]
    with path.one_change():
        path.controller.update(kp=1.0)
        path.set_loads(GravityAndPayload(np.ones(3)))
        path.law_changed()
        with path.one_change():
            path.set_limits(pair.values)
        assert path.native._plans[-1] is plan
    assert path.native._plans[-1] is not plan


def test_a_new_motion_waits_for_a_report_of_now():
    """After a long pause of the interpreter the ring has old cycles alone."""
    pair = in_motion()
    side = pair.sides[1]
    side.path.active_motion.clear('test')
    loop = side.path.native
    for _ in range(native_loop.SLOTS + 5):
        loop.call('cycle', message(pair.q, np.zeros(2), pair.time))
    for _ in range(200):  # lost, while the arm moves
        pair.time += 1_000_000
        pair.q = pair.q + 1e-4
        loop.call('cycle', message(pair.q, np.zeros(2), pair.time))
    side.path.controller.update(mode='gravity_compensation')  # holds no pose
    side.path.set_limits(pair.values | {'mode': 'gravity_compensation'})

    stops = threading.Event()

    def answer_on():
        while not stops.wait(0.005):
            loop.call('cycle', message(pair.q, np.zeros(2), pair.time))
    states = threading.Thread(target=answer_on)
    states.start()
    q, _, _ = side.path.desired(pair.time)
    stops.set()
    states.join()
    np.testing.assert_allclose(q, side.path.measured())
    np.testing.assert_allclose(q, pair.q)


def test_a_motion_that_is_to_begin_later_is_dropped_by_a_collision():
    pair = Pair('computed_torque', 1)
    pair.do_state('state')
    pair.do_state('state')
    pair.do_motion('motion')  # begins in 10 ms
    for side in pair.sides:
        assert side.path.interrupt(pair.time, 'collision')
        assert side.path.active_motion.scheduled == (None, None)


def before_a_closed_page(data):
    """Return the address of bytes before unreadable memory, and their owner."""
    page = mmap.PAGESIZE
    size = page * (len(data) // page + 1)
    memory = mmap.mmap(-1, size + page)
    start = ctypes.addressof(ctypes.c_char.from_buffer(memory))
    assert ctypes.CDLL(None).mprotect(ctypes.c_void_p(start + size), page, 0) == 0
    memory[size - len(data):size] = data
    return start + size - len(data), memory


def damaged(data, rng):
    """Return a message that is cut, longer, of other bytes or numbers, or big endian."""
    kind = rng.integers(5)
    if kind == 0:
        return data[:rng.integers(len(data))]
    if kind == 1:
        return data + rng.bytes(rng.choice([1, 7, 9000, 2**17]))
    if kind == 2:
        return rng.bytes(rng.integers(300))
    if kind == 3:
        return b'\0\0' + data[2:]
    changed = bytearray(data)
    for _ in range(rng.integers(1, 5)):
        struct.pack_into('<I', changed, rng.integers(len(data) // 4) * 4,
                         rng.choice([0, 1, 2**31, 2**32 - 1, rng.integers(2**32)]))
    return bytes(changed)


def test_no_message_is_read_beyond_its_end_or_ends_the_path():
    pair = Pair('computed_torque', 2)
    path = pair.sides[1].path
    loop = path.native
    cycle = loop._code.function('cycle', ctypes.PYFUNCTYPE(
        None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64))
    rng = np.random.default_rng(0)
    for _ in range(400):
        pair.time += 1_000_000
        data = damaged(message(pair.q, np.zeros(2), pair.time), rng)
        address, memory = before_a_closed_page(data)
        cycle(loop.address, loop._plans[-1].address, address, len(data))
        path.read_reports()
        del memory
    count = len(pair.sides[1].commands.sent)
    path.stop()
    path.start()
    for _ in range(3):
        pair.time += 1_000_000
        path.on_state(message(pair.q, np.zeros(2), pair.time))
    assert len(pair.sides[1].commands.sent) > count
    assert sum(pair.sides[1].statistics.dropped.values()) > 100


def test_a_known_message_larger_than_a_slot_is_not_copied_into_the_ring():
    pair = Pair('gravity_compensation', 1)
    path = pair.sides[1].path
    pair.do_state('state')
    data = message(pair.q, np.zeros(2), pair.time)
    path.native.set_fields(largest=len(data) - 1)
    path.native._ring[:] = 0
    path.native.call('cycle', data)
    assert path.native.reports()[-1].message == b''
    assert data[20:] not in path.native._ring.tobytes()


def test_two_publishers_of_one_length_are_both_answered_at_once():
    pair = Pair('gravity_compensation', 1)
    path = pair.sides[1].path
    for step in range(8):
        pair.time += 1_000_000
        data = message(pair.q, np.zeros(2), pair.time)
        if step % 2:  # the same joints in another order
            writer, (positions, velocities, _) = write_joint_state(
                NAMES[::-1], '', (2, 2, 0))
            prepared = PreparedMessage(writer, positions, 2)
            prepared.numbers[:] = pair.q[::-1]
            prepared.doubles(velocities, 2)[:] = 0.0
            prepared.stamp(*divmod(pair.time, NANO))
            assert len(prepared.serialized()) == len(data)
            data = prepared.serialized()
        path.native.call('cycle', data)
        kinds = {report.kind for report in path.native.reports()} if step > 3 else {0}
        assert kinds == {0}, 'answered, not unknown'
        if step <= 3:
            path.native.publish_number('tail', path.native.number('head') - 1)
            path.read_reports()


def test_the_first_message_of_a_layout_behind_newer_states_is_counted_by_its_name():
    pair = Pair('gravity_compensation', 1)
    side = pair.sides[1]
    loop = side.path.native
    for _ in range(3):
        pair.do_state('state')
    late = message(pair.q, np.zeros(2), pair.time + 1) + bytes(8)  # another layout
    pair.time += 1_000_000
    loop.call('cycle', late)
    loop.call('cycle', message(pair.q, np.zeros(2), pair.time))
    side.path.read_reports()
    assert side.statistics.dropped == {LEARNED: 1}


def test_the_thread_ends_before_its_memory_does():
    laws = traced_laws.controller_laws(ROBOT, Terms())
    loop = native_loop.NativeLoop(Cycle(ROBOT, Terms(), laws), NAMES)
    stop_at = loop.address + Block.stop.offset
    ended = threading.Event()

    @ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p)
    def run(block):
        while not ctypes.c_int64.from_address(stop_at).value:
            time.sleep(0.001)
        ended.set()
        return 0

    class Code:
        """The code of a thread that waits for its stop."""

        def address(self, name):
            return ctypes.cast(run, ctypes.c_void_p).value
    loop._code = Code()
    loop.start_thread()
    del loop
    gc.collect()
    assert ended.is_set()


def test_an_observer_that_fails_is_raised_once_by_both_paths_and_torques_go_on():
    pair = Pair('gravity_compensation', 1)

    class Faulty:
        """An observer that fails."""

        def start(self):
            pass

        def on_loads_changed(self):
            pass

        def on_cycle(self, cycle):
            raise ValueError('broken')
    for side in pair.sides:
        side.path.add_observer(Faulty(), need_effort=False)
    for _ in range(3):
        pair.do_state('state')
    pair.compare('state')
    for side in pair.sides:
        with pytest.raises(RuntimeError, match='observer Faulty: ValueError: broken'):
            side.path.raise_failure()
        side.path.raise_failure()
    pair.do_state('state')
    for side in pair.sides:
        side.path.raise_failure()


def test_a_configuration_on_the_interpreters_path_has_a_stated_reason():
    controller = Controller(ROBOT)
    assert not python_reason(node_values(), controller, None)
    for name in ('guard.enabled', 'stamped_commands'):
        assert not python_reason(node_values({name: True}), controller, None)
    for changes in ({'mode': 'motor_side'},
                    {'modes': ['hand_guiding', 'motor_side']}):
        assert python_reason(
            node_values(changes), controller, None) == 'mode motor_side'
    for mode in NATIVE_MODES:
        assert not python_reason(node_values({'mode': mode}), controller, None)


def test_an_entity_without_an_address_is_refused():
    with pytest.raises(UnsupportedError, match='no handle with an address; expected'):
        handle_address(object())
