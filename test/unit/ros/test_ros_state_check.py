"""One false joint state moves nothing: which are refused, what is commanded."""

import math
import time

from hypothesis import assume, given, settings, strategies as st
import numpy as np
import pytest

pytest.importorskip('rclpy')

from kane_dynamics import Controller, load_urdf, Motion, Robot  # noqa: E402, I100
from kane_dynamics._util.resources import resource_path  # noqa: E402
from kane_dynamics.control_cycle import cycle_results  # noqa: E402
from kane_dynamics.control_cycle.state_judgement import (  # noqa: E402
    CheckSettings, judged, StateMemory)
from kane_dynamics.errors import InputError  # noqa: E402
from kane_dynamics.mechanics.algebra.flags import packed  # noqa: E402
from kane_dynamics.ros.common.node_statistics import Statistics  # noqa: E402
from kane_dynamics.ros.common.stamped_numbers import (  # noqa: E402
    FUTURE, NOT_FINITE, OUT_OF_ORDER)
from kane_dynamics.ros.guard.guard_path import GuardPath  # noqa: E402
from kane_dynamics.ros.torque_path.drop_reasons import (  # noqa: E402
    JUMP, OUTSIDE, REASONS, STALE, TOO_FAST, UNEXPLAINED)
from kane_dynamics.ros.torque_path.state_check import StateCheck  # noqa: E402
from kane_dynamics.ros.torque_path.torque_path import TorquePath  # noqa: E402
from native_rig import python_path  # noqa: E402
from node_values import node_values  # noqa: E402
from rclpy.serialization import deserialize_message, serialize_message  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from std_msgs.msg import Float64MultiArray  # noqa: E402

NANO = 10**9
PERIOD = NANO // 500
ARM = Robot(load_urdf(resource_path('urdf', 'fr3.urdf'),
                      joints=[f'fr3_joint{k}' for k in range(1, 8)]))
HOME = np.array([0.0, -0.7, 0.0, -2.2, 0.0, 1.6, 0.8])
LIMITS = ARM.limits
REST = np.zeros(7)
FIRST = 'first state'


class Rig:
    """The torque path of an arm with its defaults and a manual clock."""

    make = TorquePath

    def __init__(self, mode='computed_torque', rate_limit=math.inf, **checks):
        self.time = 100 * NANO
        self.commands = []
        self.warnings = []
        self.faults = []
        self.statistics = Statistics()
        values = node_values({f'state_check.{name}': x for name, x in checks.items()}
                             | {'mode': mode})
        self.path = self.make(
            Controller(ARM, mode=mode, rate_limit=rate_limit), self, Unread(),
            lambda: self.time, values, self.statistics,
            lambda *words: self.warnings.append(words),
            report_fault=lambda *words: self.faults.append(words))
        self.path.start()

    def publish(self, data):
        self.commands.append(np.array(deserialize_message(data, Float64MultiArray).data))

    def state(self, q=HOME, u=REST, *, after=PERIOD, age=0):
        """Pass a state; return the commands that follow."""
        self.time += after
        message = JointState(name=list(ARM.joint_names), position=list(q),
                             velocity=list(u))
        stamp = message.header.stamp
        stamp.sec, stamp.nanosec = divmod(self.time - age, NANO)
        count_before = len(self.commands)
        self.path.on_state(serialize_message(message))
        return self.commands[count_before:]

    def begin(self, q=HOME):
        """Pass two states that agree; return the command at the second."""
        assert self.state(q) == []
        command, = self.state(q)
        return command


@pytest.fixture(autouse=True, params=[TorquePath, python_path],
                ids=['compiled law', 'law in Python'])
def of_each_kind(request, monkeypatch):
    """Run each case with compiled laws, and with laws that Python evaluates."""
    monkeypatch.setattr(Rig, 'make', staticmethod(request.param))


class Unread:
    """Stands for a publisher without subscribers."""

    def publish(self, data):
        pass


def home_moved(joint, by):
    q = HOME.copy()
    q[joint] += by
    return q


FALSE = {
    'jump': (JUMP, {'q': home_moved(1, 1.0)}),
    'small jump': (JUMP, {'q': home_moved(4, -0.08)}),
    'velocity': (TOO_FAST, {'u': home_moved(3, 500.0) - HOME}),
    'degrees': (OUTSIDE, {'q': np.degrees(HOME)}),
    'beyond a limit': (OUTSIDE, {'q': home_moved(0, 3.1)}),
    'not finite': (NOT_FINITE, {'q': home_moved(2, math.nan)}),
    'infinite velocity': (NOT_FINITE, {'u': home_moved(2, math.inf)}),
    'stale': (STALE, {'q': home_moved(1, 0.5), 'age': NANO // 5}),
    'future': (FUTURE, {'q': home_moved(1, 0.5), 'age': -NANO // 5}),
    'disordered': (OUT_OF_ORDER, {'q': home_moved(1, 0.5), 'age': NANO // 20}),
}


@pytest.mark.parametrize('mode',
                         ['inverse_dynamics', 'computed_torque', 'gravity_compensation'])
@pytest.mark.parametrize('fault', FALSE)
def test_after_a_false_state_the_last_command_goes_on_and_the_state_is_counted(
        fault, mode):
    rig = Rig(mode)
    reason, state = FALSE[fault]
    held = rig.begin()
    for count in range(1, 4):  # the last stays, or is repeated
        assert all((command == held).all() for command in rig.state(**state))
        assert rig.statistics.dropped == {reason: count}
        assert rig.path.measured().tolist() == HOME.tolist()
    command, = rig.state()
    np.testing.assert_array_equal(command, held)
    assert rig.path.fault == ''


@pytest.mark.parametrize('fault', FALSE)
def test_a_motion_after_a_false_state_sets_out_from_the_last_accepted_one(fault):
    rig = Rig('inverse_dynamics')
    _, state = FALSE[fault]
    rig.begin()
    rig.state(**state)
    np.testing.assert_array_equal(rig.path.desired(rig.time)[0], HOME)


@pytest.mark.parametrize('fault', ['jump', 'velocity', 'degrees', 'not finite'])
def test_a_false_first_state_gives_no_command_and_the_next_two_do(fault):
    rig = Rig()
    reason, state = FALSE[fault]
    rig.state(**state)
    assert rig.commands == [] and rig.path.measured() is None
    for _ in range(2):
        rig.state()
    command, = rig.state()
    np.testing.assert_allclose(command, ARM.gravity_force(HOME), rtol=1e-9, atol=1e-12)
    assert set(rig.statistics.dropped) == {reason}


def test_the_second_of_two_states_that_disagree_is_refused_with_its_distance():
    rig = Rig()
    rig.state()
    rig.state(HOME + [0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0])
    reason, detail = rig.warnings[-1]
    assert reason is JUMP
    assert detail.startswith(
        "'fr3_joint3' moved by 0.5 rad or m in 0.0020 s; expected at most")


@pytest.mark.parametrize('fault',
                         ['jump', 'small jump', 'degrees', 'not finite'])
@pytest.mark.parametrize('action', ['zero', 'hold'])
def test_a_fault_that_lasts_ends_after_the_grace_time_as_configured(fault, action):
    rig = Rig(action=action, grace=0.02)
    reason, state = FALSE[fault]
    held = rig.begin()
    motion = Motion.from_points([0.0, 2.0], [HOME, HOME + 0.1],
                                joint_names=ARM.joint_names)
    active = rig.path.active_motion
    assert active.follow(motion, rig.time, rig.time, active.generation)
    for _ in range(11):  # 0 to 20 ms
        command, = rig.state(**state)
        np.testing.assert_array_equal(command, held)
    assert rig.path.fault == ''
    commands = [command for _ in range(2000) for command in rig.state(**state)]
    assert rig.path.fault == reason and active.desired(rig.time) is None
    assert rig.statistics.faults == 1 and rig.path.measured() is None
    if action == 'zero':
        zeros, = commands  # once; a jump does not become possible as time passes
        assert not zeros.any()
    else:
        assert len(commands) == 2000
        np.testing.assert_allclose(commands[-1], ARM.gravity_force(HOME), rtol=1e-12)
    command, = rig.state()
    np.testing.assert_allclose(command, held, rtol=1e-9, atol=1e-12)
    assert rig.path.fault == '' and rig.path.measured() is not None


@pytest.mark.parametrize('mode', ['computed_torque', 'gravity_compensation'])
@pytest.mark.parametrize('action', ['zero', 'hold'])
@pytest.mark.parametrize('offset', [0.035, 0.1, -0.25, 0.28])
def test_an_offset_of_an_encoder_does_not_become_possible_as_time_passes(
        offset, action, mode):
    """The joint may move that far in the grace time, but its speed is 0."""
    rig = Rig(mode, action=action)
    there = home_moved(1, offset)
    held = rig.begin()
    commands = [command for _ in range(2000) for command in rig.state(there)]
    assert rig.path.fault == JUMP and rig.statistics.dropped == {JUMP: 2000}
    assert rig.statistics.faults == 1
    if action == 'hold':
        np.testing.assert_allclose(commands, np.tile(held, (2000, 1)),
                                   rtol=1e-9, atol=1e-12)
    else:
        assert not commands[-1].any()
    assert any("'fr3_joint2' still is" in detail for _, detail in rig.warnings)
    command, = rig.state()
    np.testing.assert_allclose(command, held, rtol=1e-9, atol=1e-12)
    assert rig.path.fault == ''


@pytest.mark.parametrize('action', ['zero', 'hold'])
def test_after_the_grace_time_an_arm_that_moves_does_not_make_an_offset_possible(action):
    """Zeros let the arm fall, until the false position is the last accepted one."""
    rig = Rig(action=action)
    q = HOME.copy()
    speed = np.zeros(7)
    rig.begin()
    for k in range(200):
        if k > 50:
            speed[1] += 10.0 * PERIOD / NANO
            q = q + speed * PERIOD / NANO
        rig.state(q - 0.05 * np.eye(7)[1], speed)
    assert q[1] - HOME[1] > 0.4
    assert rig.path.fault == JUMP and rig.statistics.dropped == {JUMP: 200}
    command, = rig.state()
    np.testing.assert_allclose(command, ARM.gravity_force(HOME), rtol=1e-9, atol=1e-9)


def test_a_joint_with_late_positions_is_accepted_when_its_speed_explains_them():
    """The driver repeats a position for 30 ms, newly stamped, in motion."""
    rig = Rig('inverse_dynamics')
    q = HOME.copy()
    speed = np.zeros(7)
    speed[1] = 1.6
    rig.begin()
    for k in range(100):
        q[1] += speed[1] * PERIOD / NANO
        if not 40 <= k < 55:
            shown = q.copy()
        rig.state(shown, speed)
    assert 1 <= rig.statistics.dropped[JUMP] < 20 and rig.path.fault == ''
    np.testing.assert_array_equal(rig.path.measured(), q)


def test_after_zeros_states_elsewhere_need_an_activation():
    rig = Rig()
    there = home_moved(1, 1.0)
    rig.begin()
    for _ in range(1000):
        rig.state(there)
    assert not rig.commands[-1].any() and rig.statistics.faults == 1
    rig.path.stop()
    rig.path.start()
    command = rig.begin(there)
    np.testing.assert_allclose(command, ARM.gravity_force(there), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize('action', ['zero', 'hold'])
def test_torques_do_not_climb_from_zero_after_a_fault_that_did_not_end_in_zeros(action):
    rig = Rig('gravity_compensation', rate_limit=100.0, action=action)
    rig.begin()
    for _ in range(1000):
        held = rig.state()[0]
    np.testing.assert_allclose(held, ARM.gravity_force(HOME), rtol=1e-12)
    for lasting in (1, 5, 20):
        for _ in range(lasting):
            rig.state(home_moved(1, 1.0))
        command, = rig.state()
        np.testing.assert_array_equal(command, held)
    for _ in range(60):
        rig.state(home_moved(1, 1.0))
    command, = rig.state()
    if action == 'hold':
        np.testing.assert_array_equal(command, held)
    else:
        # From zeros within the limit of the rate.
        assert np.abs(command).max() <= 0.2 + 1e-9


@pytest.mark.parametrize('lasting', [1, 10, 60])
def test_the_rate_of_torques_is_limited_while_states_are_refused_and_after_it(lasting):
    rig = Rig('gravity_compensation', rate_limit=100.0, action='hold')
    rig.begin()
    for _ in range(1000):
        rig.state()
    begun = len(rig.commands) - 1
    for _ in range(lasting):
        rig.state(home_moved(1, 1.0))
    near = home_moved(1, 0.01 * min(lasting, 10))
    for _ in range(10):
        rig.state(near)
    changes = np.abs(np.diff(rig.commands[begun:], axis=0))
    assert len(changes) == lasting + 10
    assert changes[lasting:].max() > 0.1
    assert changes.max() <= 100.0 * PERIOD / NANO + 1e-9


def test_a_jump_of_the_clock_or_a_pause_of_the_states_begins_with_new_ones():
    rig = Rig()
    there = home_moved(1, 1.0)
    rig.begin()
    rig.time -= NANO  # a simulator begins again elsewhere
    assert rig.state(there) == []
    command, = rig.state(there)
    np.testing.assert_allclose(command, ARM.gravity_force(there), rtol=1e-9, atol=1e-12)
    rig.time += NANO // 5
    rig.path.check_timeout()
    assert not rig.commands[-1].any()
    np.testing.assert_allclose(rig.begin(), ARM.gravity_force(HOME),
                               rtol=1e-9, atol=1e-12)
    assert not rig.statistics.dropped


def test_a_first_state_older_than_the_timeout_does_not_confirm_a_false_one():
    rig = Rig()
    rig.begin()
    rig.time += NANO // 5
    rig.path.check_timeout()
    assert rig.state() == []  # one state, and again none for seconds
    assert rig.state(home_moved(1, 1.0), after=5 * NANO) == []
    assert rig.state() == [] and rig.statistics.dropped == {JUMP: 1}
    command, = rig.state()
    np.testing.assert_allclose(command, ARM.gravity_force(HOME), rtol=1e-9, atol=1e-12)


def test_after_a_jump_of_the_clock_no_motion_sets_out_from_where_the_arm_was():
    rig = Rig()
    rig.begin()
    rig.time -= NANO
    rig.path.check_timeout()
    assert rig.path.desired(rig.time) is None
    rig.begin(home_moved(1, 1.0))
    np.testing.assert_array_equal(rig.path.desired(rig.time)[0], home_moved(1, 1.0))


def test_after_a_jump_of_the_clock_the_torque_continues_within_the_limit_of_its_rate():
    """A limited torque that began again from zero would let the arm fall."""
    rig = Rig('gravity_compensation', rate_limit=100.0)
    rig.begin()
    for _ in range(1000):
        held, = rig.state()
    np.testing.assert_allclose(held, ARM.gravity_force(HOME), rtol=1e-12)
    rig.time -= NANO
    assert rig.state() == []  # the first state is compared with the next one
    for _ in range(3):
        np.testing.assert_array_equal(rig.state(), [held])
    rig.time += NANO // 5
    rig.path.check_timeout()  # zeros, after which the torque begins from zero
    rig.time -= NANO
    rig.state()
    assert np.abs(rig.state()[0]).max() <= 0.2 + 1e-9


def test_a_stop_that_begins_at_the_time_of_one_before_a_jump_of_the_clock_is_another():
    rig = Rig(action='hold', grace=0.02)
    began = rig.time
    for q in (HOME, home_moved(1, 1.0)):
        rig.time = began  # a simulator begins again elsewhere
        rig.begin(q)
        for _ in range(100):
            commands = rig.state(home_moved(3, 1.0))
        assert rig.path.fault == JUMP
        np.testing.assert_allclose(commands, [ARM.gravity_force(q)], rtol=1e-12,
                                   atol=1e-12)


@pytest.mark.parametrize('before', ['pause', 'stop of the process', 'jump of the clock'])
def test_the_arm_is_not_held_by_the_model_where_nothing_says_where_it_is(
        before, monkeypatch):
    """The torque that acted before went on for as long as states were refused."""
    rig = Rig(action='hold')
    monkeypatch.setattr(time, 'perf_counter', lambda: rig.time / NANO)
    rig.begin()
    rig.path.check_timeout()
    if before == 'pause':
        # A position that no speed explains.
        assert rig.state(home_moved(1, 0.3), after=9 * NANO // 100) == []
    elif before == 'stop of the process':
        rig.time += NANO
        rig.path.check_timeout()
    else:
        rig.time -= NANO
        rig.path.on_clock_jump()
        rig.path.check_timeout()
    # Its encoder fails for good.
    rig.commands.clear()
    for _ in range(40):
        rig.state(home_moved(2, math.nan))
    assert rig.commands[0].any() and not rig.commands[-1].any()
    (_, words), = rig.faults
    assert 'commanding zeros until states are valid again' in words
    # The arm is back.
    assert rig.state() == []
    command, = rig.state()
    assert command.any() and rig.path.fault == ''


@pytest.mark.parametrize('action', ['zero', 'hold'])
def test_a_fault_is_reported_as_an_error_once_it_lasts_longer_than_the_grace_time(
        action):
    rig = Rig(action=action, grace=0.02)
    reason, state = FALSE['jump']
    rig.begin()
    for _ in range(11):  # 0 to 20 ms
        rig.state(**state)
    assert rig.faults == []
    for _ in range(100):
        rig.state(**state)
    (kind, detail), = rig.faults
    assert kind == 'fault' and detail.startswith(f'{reason} for 0.0')
    rig.state()
    rig.state(**state)
    assert len(rig.faults) == 1


@pytest.mark.parametrize('action', ['zero', 'hold'])
def test_after_a_fault_an_arm_that_moved_is_held_where_it_is(action):
    rig = Rig(action=action)
    rig.begin()
    for _ in range(60):
        rig.state(home_moved(1, 1.0))
    assert rig.path.fault == JUMP
    sunk = home_moved(1, 0.1)
    command, = rig.state(sunk)
    np.testing.assert_allclose(command, ARM.gravity_force(sunk), rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(rig.path.desired(rig.time)[0], sunk)


def test_a_stamp_ahead_of_the_clock_does_not_delay_the_next_state():
    rig = Rig()
    rig.begin()
    assert len(rig.state(age=-NANO // 20)) == 1
    assert len(rig.state()) == 1 and not rig.statistics.dropped


def test_states_of_a_slow_publisher_may_be_far_apart():
    rig = Rig()
    q = HOME.copy()
    u = REST.copy()
    rig.begin()
    u[1] = 0.9 * LIMITS.velocity[1]
    rig.state(q, u)
    rig.state(q, u)  # the second state of a speed that jumps
    for _ in range(10):
        q[1] += 0.09 * u[1]
        assert len(rig.state(q, u, after=9 * NANO // 100)) == 1


def test_after_a_pause_a_position_without_speeds_that_explain_it_needs_a_second_state():
    rig = Rig()
    held = rig.begin()
    pause = 9 * NANO // 100
    far = home_moved(1, 0.3)
    # A single false one is not answered; the true one after it is, from the second on.
    assert rig.state(far, after=pause) == []
    assert all((command == held).all() for command in rig.state())
    np.testing.assert_array_equal(rig.state(), [held])
    assert rig.statistics.dropped == {UNEXPLAINED: 1, JUMP: 1}
    (reason, words), *_ = rig.warnings
    assert reason == UNEXPLAINED and words.startswith('0.090 s after the last')
    # An arm that was moved meanwhile.
    assert rig.state(far, after=pause) == []
    assert len(rig.state(far)) == 1
    # Short pauses, and motions within the noise, change nothing.
    assert len(rig.state(home_moved(1, 0.26), after=4 * NANO // 100)) == 1
    assert len(rig.state(home_moved(1, 0.265), after=pause)) == 1
    assert rig.path.fault == '' and rig.path.known


class JudgedStates:
    """States of a robot, judged by the rule of both torque paths on numbers."""

    def __init__(self, robot, checks):
        values = {f'state_check.{name}': x for name, x in checks.items()}
        self.state = np.zeros(2 * robot.n)
        self.settings = StateCheck(robot, robot.joint_names, self.state,
                                   node_values(values))
        self.memory = StateMemory.empty(robot.n)
        self.detail = ''

    def reason(self, stamp):
        """Return why the state with this stamp, ns, is refused, or None."""
        check = self.settings
        settings = CheckSettings(NANO // 10, check.grace, check.grace, check.compares,
                                 1.0, check.turned, check.bounds.ravel())
        outcome, memory_after = judged(self.memory, stamp, self.state, settings)
        if outcome >= cycle_results.NOT_FINITE:
            self.detail = check.explain(int(outcome), self.memory, memory_after)
        self.memory = StateMemory.of(packed(memory_after))
        self._kept = self.memory.kept(stamp, self.state.copy())
        return FIRST if outcome == cycle_results.FIRST else REASONS.get(int(outcome))

    def accept(self):
        """Keep the state that was judged last as the last accepted one."""
        self.memory = self._kept

    def forget(self):
        self.memory = self.memory.forgotten()


def check(robot=ARM, **checks):
    states = JudgedStates(robot, checks)
    return states.state, states


FRACTION = st.floats(-1.0, 1.0)


@settings(max_examples=150, deadline=None)
@given(st.lists(FRACTION, min_size=14, max_size=14),
       st.lists(FRACTION, min_size=7, max_size=7), st.floats(1e-6, 0.3))
def test_states_of_an_arm_within_its_limits_are_accepted(numbers, changes, elapsed):
    state, state_check = check()
    place = np.array(numbers[:7])
    speed = np.array(numbers[7:])
    change = np.array(changes)
    q = LIMITS.lower + 0.5 * (place + 1.0) * (LIMITS.upper - LIMITS.lower)
    state[:] = np.concatenate([q, speed * LIMITS.velocity])
    assert state_check.reason(NANO) is FIRST and state_check.reason(NANO) is None
    q_after = np.clip(q + change * LIMITS.velocity * elapsed, LIMITS.lower, LIMITS.upper)
    state[:7] = q_after
    # After a pause, positions that the speeds do not explain count from the second on.
    predicted = speed * LIMITS.velocity * elapsed
    allowed = 0.01 + 0.002 * 2.0 * LIMITS.velocity + 0.5 * np.abs(predicted)
    off = np.abs(q_after - q - predicted) - allowed
    assume(np.abs(off).min() > 1e-9)
    reason = UNEXPLAINED if elapsed > 0.05 and off.max() > 0.0 else None
    assert state_check.reason(NANO + round(elapsed * NANO)) is reason
    assert state_check.reason(NANO + round(elapsed * NANO)) is None


@settings(max_examples=150, deadline=None)
@given(st.lists(FRACTION, min_size=7, max_size=7), st.integers(0, 6),
       st.floats(1e-6, 0.1), st.floats(1.001, 1e3), st.sampled_from([-1.0, 1.0]))
def test_a_joint_that_moved_farther_than_it_can_is_refused(
        places, joint, elapsed, excess, sign):
    state, state_check = check(position_margin=math.inf)
    state[:7] = LIMITS.lower + 0.5 * (np.array(places) + 1.0) * (LIMITS.upper
                                                                 - LIMITS.lower)
    state_check.reason(NANO)
    state_check.reason(NANO)
    state_check.accept()
    stamp = NANO + round(elapsed * NANO)
    allowed = 0.01 + 2.0 * LIMITS.velocity[joint] * (0.002 + (stamp - NANO) / NANO)
    state[joint] += sign * 0.999 * allowed
    before = state_check.memory
    assert state_check.reason(stamp) in (None, UNEXPLAINED)
    state_check.memory = before
    state[joint] += sign * (excess - 0.999) * allowed
    assert state_check.reason(stamp) is JUMP
    assert f"'{ARM.joint_names[joint]}' moved by" in state_check.detail


@settings(max_examples=150, deadline=None)
@given(st.lists(FRACTION, min_size=7, max_size=7),
       st.lists(FRACTION, min_size=7, max_size=7),
       st.integers(1, 24), st.lists(st.floats(0.015, 1.0), min_size=24, max_size=24),
       st.integers(0, 6), st.sampled_from([-1.0, 1.0]))
def test_after_false_states_of_an_arm_in_motion_the_first_true_one_is_accepted(
        begin, end, count, jumps, joint, sign):
    """Speeds change from one to another in up to 50 ms, with up to 80 rad/s^2."""
    state, state_check = check(position_margin=math.inf)
    first = np.array(begin) * LIMITS.velocity
    last = np.array(end) * LIMITS.velocity
    last = first + np.clip(last - first, -4.0, 4.0) * count / 24
    state[:] = np.concatenate([HOME, first])
    state_check.reason(NANO)
    state_check.reason(NANO)
    state_check.accept()
    for k in range(1, count + 2):
        time = k * PERIOD / NANO
        share = k / (count + 1)
        u = first + share * (last - first)
        state[:] = np.concatenate([HOME + 0.5 * (first + u) * time, u])
        stamp = NANO + k * PERIOD
        if k <= count:
            bound = 0.01 + 2.0 * LIMITS.velocity[joint] * (0.002 + time)
            moved = state[joint] - HOME[joint]
            state[joint] += sign * (bound + abs(moved) + jumps[k - 1])
            assert state_check.reason(stamp) is JUMP
    assert state_check.reason(stamp) is None


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 6), st.floats(1.001, 1e6), st.sampled_from([-1.0, 1.0]),
       st.booleans())
def test_a_joint_beyond_a_bound_is_refused(joint, excess, sign, fast):
    state, state_check = check()
    state[:7] = HOME
    state_check.reason(NANO)
    if fast:
        state[7 + joint] = sign * excess * 2.0 * LIMITS.velocity[joint]
    else:
        bound = (LIMITS.upper if sign > 0.0 else LIMITS.lower)[joint]
        state[joint] = bound + sign * excess * 0.2
    assert state_check.reason(NANO + PERIOD) is (TOO_FAST if fast else OUTSIDE)
    assert f"'{ARM.joint_names[joint]}'" in state_check.detail


def test_degrees_are_named_as_such():
    state, state_check = check()
    state[:7] = np.degrees(HOME)
    assert state_check.reason(NANO) is OUTSIDE
    assert 'if these are degrees' in state_check.detail


def test_joints_without_limits_are_not_compared_with_them():
    robot = Robot(load_urdf(
        '<robot name="spindle"><link name="base"/><link name="a"><inertial><mass '
        'value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" '
        'iyz="0"/></inertial></link>'
        '<joint name="turn" type="continuous"><parent link="base"/><child link="a"/>'
        '<axis xyz="0 0 1"/></joint></robot>'))
    state, state_check = check(robot)
    for position, speed in ((0.0, 0.0), (1e6, 1e6), (-1e11, 0.0)):
        state[:] = position, speed
        assert state_check.reason(NANO) is None
        state_check.accept()
    state[:] = -1e13, 0.0  # sines are not defined beyond
    assert state_check.reason(NANO) is OUTSIDE
    state_check.settings.update(node_values({'limits.velocity': 2.0}))
    state[:] = 0.0, 0.0
    state_check.forget()
    state_check.reason(NANO)
    state[0] = 3.0
    assert state_check.reason(NANO) is JUMP  # with a limit in the parameters it is
    state_check.forget()
    state[0] = 3.1
    state_check.reason(NANO)
    state[0] -= 2.0 * math.pi  # a driver that publishes the angle between -pi and pi
    assert state_check.reason(NANO) is None
    state_check.settings.update(
        node_values({'limits.velocity': 2.0, 'mode': 'computed_torque'}))
    state_check.accept()
    state[0] += 2.0 * math.pi
    # A whole turn would be an error of the position.
    assert state_check.reason(NANO) is JUMP


def test_a_speed_limit_for_another_number_of_joints_is_refused():
    values = node_values({'limits.velocity': [1.0, 2.0]})
    with pytest.raises(InputError,
                       match=r"parameter 'limits\.velocity': 2 entries; expected one"):
        StateCheck(ARM, ARM.joint_names, np.zeros(14), values)


@pytest.mark.parametrize('action', ['zero', 'hold'])
def test_the_guard_takes_over_from_a_node_that_died_while_states_are_impossible(
        action, monkeypatch):
    now = [1000.0]
    monkeypatch.setattr(time, 'perf_counter', lambda: now[0])
    rig = Rig()
    there = home_moved(1, 1.0)
    reports = []
    values = node_values({'state_check.action': action})
    guard = GuardPath(Controller(ARM), rig, Unread(), lambda: rig.time, values,
                      Statistics(),
                      lambda *words: None, lambda *words: reports.append(words))
    guard.start()
    guard.watch.known = True
    torques = guard.path.messages._torque_message
    rig.path = guard
    gravity = ARM.gravity_force(HOME)
    torques.numbers[:] = gravity
    guard.on_torques(torques.serialized())
    rig.state(), rig.state()
    for _ in range(100):
        guard.on_torques(torques.serialized())  # of a node that lives, and holds
        assert rig.state(there) == []
        guard.check_timeout()
    assert guard.fault == JUMP and not guard.watch.acting and not reports
    for _ in range(100):  # 0.2 s without a command of the node
        now[0] += 0.002
        guard.watch.tick(now[0])
    guard.check_timeout()
    assert guard.watch.acting and 'position jumped' in reports[-1][1]
    command, = rig.state(there)
    if action == 'hold':
        np.testing.assert_allclose(command, gravity, rtol=1e-9, atol=1e-12)
    else:
        assert not command.any() and rig.state(there) == []


def test_the_guard_accepts_what_the_node_accepts_after_an_activation():
    rig = Rig()
    there = home_moved(1, 1.0)
    guard = GuardPath(Controller(ARM), Unread(), Unread(), lambda: rig.time,
                      node_values(),
                      Statistics(), lambda *words: None, lambda *words: None)
    guard.start()
    rig.path, node = guard, rig.path
    torques = node.messages._torque_message
    torques.numbers[:] = ARM.gravity_force(HOME)
    guard.on_torques(torques.serialized())
    rig.state(), rig.state()
    for _ in range(100):
        rig.state(there)
    assert guard.fault == JUMP and not guard.watch.acting
    guard.on_torques(torques.serialized())  # the node holds
    assert guard.fault == JUMP
    torques.numbers[:] = 0.0
    guard.on_torques(torques.serialized())
    torques.numbers[:] = ARM.gravity_force(there)
    guard.on_torques(torques.serialized())
    assert guard.fault == ''
    rig.state(there), rig.state(there)
    assert guard.path.known
