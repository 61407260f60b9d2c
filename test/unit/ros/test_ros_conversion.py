"""Conversion of messages and arrays, and the statistics of a node."""

import os
from pathlib import Path
import subprocess
import sys

from builtin_interfaces.msg import Duration
from kane_dynamics.errors import InputError
from kane_dynamics.model.builder import ModelBuilder
from kane_dynamics.model.primitive_inertias import point_mass
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import duration, order, trajectory_message
from kane_dynamics.ros.common.node_statistics import Statistics
from kane_dynamics.simulation.trajectory import Trajectory
import numpy as np
import pytest

JOINTS = ('a', 'b', 'c')


def test_the_order_of_equal_lists_is_none():
    assert order([], JOINTS, 'names') is None
    assert order(JOINTS, JOINTS, 'names') is None
    assert order(['c', 'a', 'b'], JOINTS, 'names').tolist() == [1, 2, 0]
    for names in (['a', 'b'], ['a', 'b', 'c', 'd'], ['a', 'b', 'c', 'c']):
        with pytest.raises(InputError, match=r'names: .*; expected each of a, b, c '
                           'once, or an empty list'):
            order(names, JOINTS, 'names')


@pytest.mark.parametrize(('seconds', 'expected'), [
    (0.0, (0, 0)), (1.5, (1, 500_000_000)), (0.9999999999, (1, 0)),
    (3600.000001, (3600, 1000))])
def test_durations_are_rounded_to_the_nanosecond(seconds, expected):
    assert duration(seconds) == Duration(sec=expected[0], nanosec=expected[1])


def test_a_trajectory_message_follows_the_given_order():
    rows = np.arange(6.0).reshape(2, 3)
    trajectory = Trajectory(t=np.array([0.0, 0.25]), q=rows, u=rows + 10, udot=rows + 20,
                            tau=rows + 30, energy=np.zeros((2, 2)), joint_names=JOINTS)
    model = ModelBuilder('arm')
    for name, carrier in zip(JOINTS, ('world', 'link_a', 'link_b')):
        model.body(f'link_{name}', carrier, joint=name, inertial=point_mass(1.0))
    message = trajectory_message(trajectory, Robot(model.model()), ['c', 'a', 'b'])
    last = message.points[1]
    assert list(message.joint_names) == ['c', 'a', 'b']
    assert list(last.positions) == [5, 3, 4]
    assert list(last.velocities) == [15, 13, 14]
    assert list(last.accelerations) == [25, 23, 24]
    assert list(last.effort) == [35, 33, 34]
    assert last.time_from_start == Duration(nanosec=250_000_000)


def test_statistics_count_one_period():
    statistics = Statistics()
    for k in range(200):
        statistics.command(1e-6 * (k + 1), 1e-3, k % 2 == 0)
    statistics.dropped['not finite'] += 3
    rate, dropped, values = statistics.period(2.0)
    assert (rate, dropped) == (100.0, {'not finite': 3})
    latencies = [values[f'callback latency {which}'] for which in ('p50', 'p99', 'max')]
    assert latencies == ['100 us', '198 us', '200 us']
    assert values['commands clamped'] == '100'
    assert values['states dropped: not finite'] == '3'
    assert statistics.period(1.0)[:2] == (0.0, {})


def test_the_first_report_imports_nothing_as_imports_hold_up_the_commands():
    program = """
import sys
from kane_dynamics.ros.common.node_statistics import Statistics, status
statistics, before = Statistics(), set(sys.modules)
statistics.command(1e-6, 1e-3, False)
status('', '', b'0', '', statistics.period(1.0)[2])
print(*set(sys.modules) - before)
"""
    environment = dict(os.environ, PYTHONPATH=str(Path(__file__).parents[3]))
    done = subprocess.run([sys.executable, '-c', program],
                          capture_output=True, text=True, env=environment, check=True)
    assert not done.stdout.split()
