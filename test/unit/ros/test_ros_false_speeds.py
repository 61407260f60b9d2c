"""
Speeds of joint states that contradict the positions, judged by the motion of the arm.

Drivers lie about speeds in few ways, and all drivers have noise, filters, delays and a
resolution, which are no lie.
"""

from collections import Counter, deque
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('rclpy')

from false_states import FAULT, NANO, PERIOD  # noqa: E402, I100
from kane_dynamics import Controller, load_urdf, Robot  # noqa: E402
from kane_dynamics._util.resources import resource_path  # noqa: E402
from kane_dynamics.control_cycle.cycle_results import (  # noqa: E402
    ACCEPTED, FIRST, NOT_FINITE)
from kane_dynamics.control_cycle.state_judgement import (  # noqa: E402
    CheckSettings, judged, StateMemory)
from kane_dynamics.robot.parameters import JointLimits  # noqa: E402
from kane_dynamics.ros.common.node_statistics import Statistics  # noqa: E402
from kane_dynamics.ros.dynamics_node.node_diagnostics import (  # noqa: E402
    active_status, OK, WARN)
from kane_dynamics.ros.torque_path.torque_path import TorquePath  # noqa: E402
from native_rig import python_path  # noqa: E402
from node_values import node_values  # noqa: E402
from rclpy.serialization import serialize_message  # noqa: E402
from recordings import present, quiet, real  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from test_ros_false_states import Run, undisturbed, Unread  # noqa: E402

LENGTH = 700
LIES = {'always zero': lambda q, u: (q, 0.0 * u, 0),
        'wrong sign': lambda q, u: (q, -u, 0),
        'degrees': lambda q, u: (q, np.degrees(u), 0),
        'stuck': lambda q, u: (q, 0.0 * u + 500.0, 0)}


@pytest.mark.parametrize('make', [python_path, TorquePath])
@pytest.mark.parametrize('name', ['fr3', 'palletizer'])
@pytest.mark.parametrize('lie', LIES)
def test_an_arm_whose_speeds_lie_goes_on_along_its_motion(lie, name, make):
    run = Run(name, 'computed_torque', True, make=make, limited=True)
    rows = run.positions(LIES[lie], first=FAULT, count=LENGTH, length=LENGTH)
    calm = undisturbed(name, 'computed_torque', True, LENGTH)
    speeds = np.abs(np.diff(rows, axis=0)) * (NANO / PERIOD)
    moved = np.abs(rows - calm)
    # Overshoot beyond the motion, and the way back to it.
    fastest = np.abs(np.diff(calm, axis=0)).max() * (NANO / PERIOD)
    assert speeds.max() < 1.8 * fastest
    assert moved.max() < 0.08 and moved[-1].max() < 0.01
    assert run.path.false_speeds and run.path.fault == ''


def drivers():
    """Return how drivers change true speeds and positions, by name."""
    rng = np.random.default_rng(0)

    def noisy(q, u):
        return q + rng.normal(0.0, 2e-4, len(q)), u + rng.normal(0.0, 0.05, len(u)), 0

    def coarse(q, u):
        return np.round(q / 1e-3) * 1e-3, np.round(u / 0.05) * 0.05, 0

    def filtered(within):
        last = []

        def change(q, u):
            last[:] = [last[0] + (u - last[0]) * PERIOD / NANO / within if last else u]
            return q, last[0], 0
        return change

    def late(states):
        waiting = deque(maxlen=states)

        def change(q, u):
            waiting.append(u)
            return q, waiting[0], 0
        return change

    def differences(q, u):
        moved = q - before[-1] if before else 0.0 * q
        before.append(q)
        return q, moved * (NANO / PERIOD), 0
    before = []
    return {'noisy': noisy, 'coarse': coarse, 'filtered by 10 ms': filtered(0.01),
            'filtered by 20 ms': filtered(0.02), '10 ms late': late(6),
            'differences of positions': differences}


@pytest.mark.parametrize('name', ['fr3', 'palletizer'])
@pytest.mark.parametrize('driver', drivers())
def test_the_speeds_of_real_drivers_are_no_lie(driver, name):
    run = Run(name, 'computed_torque', True, limited=True)
    run.positions(drivers()[driver], first=0, count=LENGTH, length=LENGTH)
    assert run.path.false_speeds == () and not run.statistics.dropped


def wrong_speeds(q, change, rate, fastest=2.6):
    """Return whose speeds are called wrong in a motion, (K, n), changed by joint."""
    n = q.shape[1]
    u = np.gradient(q, 1.0 / rate, axis=0)
    measured, stated = change(q, u)
    ones = np.ones(n)
    bounds = np.concatenate([-100.0 * ones, 100.0 * ones, 1.2 * fastest * ones,
                             1.2 * fastest * ones, (0.01 + 0.0024 * fastest) * ones])
    period = NANO / rate
    settings = CheckSettings(0.1 * NANO, 0.05 * NANO, 1.5 * period, 1.0, 1.0,
                             np.zeros(n), bounds)
    memory = StateMemory.empty(n)
    for k, state in enumerate(np.hstack([measured, stated])):
        _, memory = judged(memory, k * period, state, settings)
        memory = memory.kept(k * period, state)
    return memory.wrong.astype(bool)


def swings(rate, duration, frequencies):
    """Return motions that stop and turn, with the largest speed 1 rad/s, (K, n)."""
    t = np.arange(0.0, duration, 1.0 / rate)[:, None]
    frequencies = np.array(frequencies)
    return np.sin(2.0 * np.pi * frequencies * t) / (2.0 * np.pi * frequencies)


def test_speeds_by_a_constant_factor_are_found():
    factors = np.array([0.5, 0.6, 1.6, 1.9, 1.0])
    for frequency in (0.2, 1.0):
        q = swings(100, 10.0, [frequency] * len(factors))
        wrong = wrong_speeds(q, lambda q, u: (q, factors * u), 100)
        assert wrong.tolist() == [True, True, True, True, False]


@pytest.mark.parametrize('rate', [100, 400])
def test_filters_delays_noise_and_resolution_are_no_factor(rate):
    rng = np.random.default_rng(2)

    def change(q, u):
        q, u = q.copy(), u.copy()
        for j, within in ((0, 0.05), (1, 0.1), (2, 0.05)):  # filters of first order
            for k in range(1, len(u)):
                u[k, j] = u[k - 1, j] + (u[k, j] - u[k - 1, j]) / (1.0 + within * rate)
        u[:, 3] = np.roll(u[:, 3], round(0.05 * rate))
        q[:, 4:6] = np.round(q[:, 4:6] / 1e-3) * 1e-3
        q[:, 6:] += rng.normal(0.0, 3e-4, q[:, 6:].shape)
        u[1:, 5:] = np.diff(q[:, 5:], axis=0) * rate
        return q, u
    q = swings(rate, 12.0, [0.3, 0.3, 1.0, 1.0, 0.2, 0.2, 0.2, 1.0])
    q[:, 7] = 0.0  # at rest
    assert not wrong_speeds(q, change, rate).any()


@pytest.mark.parametrize('rate', [50, 100, 125, 500])
def test_exact_speeds_are_used_as_they_are_however_fast_they_change(rate):
    fastest = 4.0
    bounds = np.array([-10.0, 10.0, fastest, fastest, 0.01 + 0.002 * fastest])
    period = NANO / rate
    settings = CheckSettings(0.1 * NANO, 0.05 * NANO, 1.5 * period, 1.0, 1.0,
                             np.zeros(1), bounds)
    memory = StateMemory.empty(1)
    for k in range(3 * rate):
        angle = 12.0 * k / rate  # up to 21.6 rad/s^2
        state = np.array([0.15 * np.sin(angle), 1.8 * np.cos(angle)])
        _, memory = judged(memory, k * period, state, settings)
        memory = memory.kept(k * period, state)
        assert memory.trusted[0] == state[1]


@pytest.mark.parametrize(('recording', 'urdf', 'n'), [
    ('panda_unisa.csv', 'fer_hand.urdf', 7), ('ur10_unisa.csv', 'ur10.urdf', 6)])
def test_states_of_a_recorded_arm_are_accepted_and_lies_are_found(recording, urdf, n):
    if not present(recording, urdf):
        pytest.skip('no recording of a real arm here')
    data, file, joints = real(recording, urdf, n)
    robot = Robot(quiet(file, joints=list(joints)))
    table = np.genfromtxt(data, delimiter=',', names=True)
    columns = [[table[f'{letter}{k}'] for k in range(1, n + 1)] for letter in 'qv']
    q, u = np.swapaxes(np.array(columns), 1, 2)
    stamps = NANO + np.round(table['t'] * NANO).astype(int)

    def false_speeds(factor):
        now = [int(stamps[0])]
        values = node_values({'mode': 'computed_torque'})
        path = TorquePath(Controller(robot, mode='computed_torque'), Unread(), Unread(),
                          lambda: now[0], values, Statistics(), lambda *words: None)
        path.start()
        for stamp, position, speed in zip(stamps.tolist(), q.tolist(), factor * u):
            now[0] = stamp
            message = JointState(name=list(joints), position=position,
                                 velocity=speed.tolist())
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, NANO)
            path.on_state(serialize_message(message))
        return path.false_speeds, path.statistics.dropped
    assert false_speeds(1.0) == ((), {})
    for factor in (0.0, -1.0, 0.5, 1.9):
        wrong, _ = false_speeds(factor)
        assert set(wrong) >= set(joints[:3])


@pytest.mark.parametrize('make', [python_path, TorquePath])
def test_where_speeds_cannot_be_judged_the_diagnostics_say_so(make):
    limited = Robot(load_urdf(resource_path('urdf', 'two_link.urdf')))
    free = limited.copy()
    limits = limited.limits
    free.limits = JointLimits(limits.lower, limits.upper, [np.inf, 2.0], limits.effort)

    def message(robot, mode, period):
        now = [NANO]
        values = node_values({'mode': mode})
        path = make(Controller(robot, mode=mode), Unread(), Unread(), lambda: now[0],
                    values, Statistics(), lambda *words: None)
        path.start()
        for k in range(40):
            now[0] += round(period * NANO)
            state = JointState(name=list(robot.joint_names), position=[0.01 * k, 0.2],
                               velocity=[0.01 / period, 0.0])
            state.header.stamp.sec, state.header.stamp.nanosec = divmod(now[0], NANO)
            path.on_state(serialize_message(state))
        parts = SimpleNamespace(collision=None, model_change=None)
        arm = SimpleNamespace(path=path, guard=None, drift=None, left_mode='',
                              commanders=[], state_publishers=1, parts_of_states=[],
                              optional_topics=parts)
        return active_status(arm, 100.0, Counter(), 0.0)
    level, words = message(limited, 'computed_torque', 0.01)
    assert level == OK and 'cannot judge' not in words
    level, words = message(limited, 'computed_torque', 0.06)
    assert level == WARN
    assert 'cannot judge whether velocities fit positions: states each 60 ms' in words
    level, words = message(free, 'computed_torque', 0.01)
    assert level == WARN and 'no speed limit of joint1; expected one' in words
    level, words = message(free, 'gravity_compensation', 0.06)
    assert level == OK


@pytest.mark.parametrize('rate', [100, 500])
@pytest.mark.parametrize('absent', [0, 1])
def test_a_speed_that_is_nan_is_derived_from_the_positions_of_its_joint(rate, absent):
    fastest = 4.0
    limit = np.full(2, fastest)
    bounds = np.concatenate([-10.0 + 0.0 * limit, 10.0 + 0.0 * limit, limit, limit,
                             0.01 + 0.002 * limit])
    period = NANO / rate
    settings = CheckSettings(0.1 * NANO, 0.05 * NANO, 1.5 * period, 1.0, 1.0,
                             np.zeros(2), bounds)
    memory = StateMemory.empty(2)
    for k in range(2 * rate):
        angle = 3.0 * k / rate
        u = np.array([0.9 * np.cos(angle), -0.6 * np.cos(angle)])
        state = np.concatenate([[0.3 * np.sin(angle), -0.2 * np.sin(angle)], u])
        state[2 + absent] = np.nan
        fault, memory = judged(memory, k * period, state, settings)
        assert fault == (FIRST if k == 0 else ACCEPTED)
        memory = memory.kept(k * period, state)
        other = 1 - absent
        assert memory.trusted[other] == u[other]
        # The mean over the last period and the 10 ms of the filter is late by both.
        if k > rate // 5:
            late = 0.5 * period / NANO + 0.01
            assert abs(memory.trusted[absent] - u[absent]) < 3.0 * late
        assert np.isfinite(memory.accepted).all()
    assert not memory.wrong.any()


@pytest.mark.parametrize(('place', 'value'), [(0, np.nan), (2, np.inf), (3, -np.inf)])
def test_a_position_that_is_nan_and_an_infinite_speed_are_no_state(place, value):
    bounds = np.repeat([-10.0, 10.0, 4.0, 4.0, 0.02], 2)
    settings = CheckSettings(0.1 * NANO, 0.05 * NANO, 0.1 * NANO, 1.0, 1.0, np.zeros(2),
                             bounds)
    state = np.array([0.1, 0.2, 0.0, 0.0])
    _, memory = judged(StateMemory.empty(2), 0.0, state, settings)
    state[place] = value
    assert judged(memory, 1e6, state, settings)[0] == NOT_FINITE


@pytest.mark.parametrize('make', [python_path, TorquePath])
def test_an_arm_without_measured_speeds_follows_its_motion(make):
    run = Run('fr3', 'computed_torque', True, make=make, limited=True)
    rows = run.positions(lambda q, u: (q, np.nan * u, 0), first=0, count=LENGTH,
                         length=LENGTH)
    calm = undisturbed('fr3', 'computed_torque', True, LENGTH)
    assert np.abs(calm - calm[0]).max() > 0.1
    assert np.abs(rows - calm).max() < 0.02
    assert run.path.false_speeds == () and not run.statistics.dropped
