"""Efforts filled in for trajectories of closed loops, compared with demand and power."""

from functools import cache

from kane_dynamics import fill_trajectory, InputError, Robot
from kane_dynamics.feasibility import demand
from kane_dynamics.mechanics.definition import nonholonomic
from linkages import at_angle, four_bar, four_bar_model, PIN, sleigh
import numpy as np
from palletizer import DRIVEN, palletizer, positions
import pytest

TIMES, CRANK = [0.0, 0.5, 1.0], [[0.8], [1.4], [1.0]]


@cache
def linkage(**options):
    """Return the four-bar with its crank independent."""
    return Robot(four_bar_model(), constraints=[PIN], independent=['crank'],
                 configuration=at_angle(0.8), **options)


def test_efforts_are_those_of_the_motion_between_points_within_the_tolerance():
    filled = fill_trajectory(linkage(), TIMES, CRANK, tolerance=0.05)
    assert filled.joint_names == ('crank',) and filled.inserted > 0
    asked = demand(linkage(), filled.motion, step=0.004)
    inside = (asked.t > 0.0) & (asked.t < 1.0)
    between = np.interp(asked.t, filled.times, filled.efforts[:, 0])
    assert np.abs(between - asked.tau[:, 0])[inside].max() < 0.06
    assert filled.effort_error[0] <= 0.05


def test_efforts_of_the_palletizer_are_those_of_the_definition():
    robot = palletizer()
    rng = np.random.default_rng(0)
    rows = rng.uniform((-0.5, 0.0, 0.0, -1.0), (0.5, 0.4, 0.4, 1.0), (3, 4))
    filled = fill_trajectory(robot, TIMES, rows, rows, rows)
    assert filled.joint_names == DRIVEN
    for row, effort in zip(rows, filled.efforts):
        expected = nonholonomic.inverse_dynamics(robot.mechanism, positions(robot, *row), row, row)
        np.testing.assert_allclose(effort, expected, rtol=0.0,
                                   atol=1e-9 * np.abs(expected).max())


def test_an_actuator_at_another_joint_has_the_power_of_that_at_the_crank():
    crank = fill_trajectory(linkage(), TIMES, CRANK)
    asked = demand(linkage(), crank.motion, step=0.5)
    k = np.flatnonzero(asked.t == 0.5)[0]
    rocker = fill_trajectory(linkage(), [0.0], asked.q[k:k + 1, 2:], asked.u[k:k + 1, 2:],
                             asked.udot[k:k + 1, 2:], joint_names=['rocker'], rest=asked.q[k])
    assert rocker.efforts[0, 0] * asked.u[k, 2] == pytest.approx(
        asked.tau[k, 0] * asked.u[k, 0], rel=1e-9)


def test_far_points_stay_on_the_branch_of_the_first():
    filled = fill_trajectory(linkage(), [0.0, 2.0], [[0.8], [0.8 + 2.0 * np.pi]])
    assert filled.efforts[1, 0] == pytest.approx(filled.efforts[0, 0], abs=1e-9)


@pytest.mark.parametrize(('robot', 'joints', 'words'), [
    (linkage(actuated=('rocker',)), ['crank'], 'joint_names: .* with actuators, rocker'),
    (four_bar('crank'), ['crank', 'rocker'], 'expected 1 of crank, coupler, rocker'),
    (sleigh(), ['body/x', 'body/rz'], 'is one of velocities')])
def test_trajectories_that_do_not_state_the_efforts_are_refused(robot, joints, words):
    with pytest.raises(InputError, match=words):
        fill_trajectory(robot, [0.0], [[0.8, 0.0][:len(joints)]], joint_names=joints)


def test_a_passive_joint_beyond_its_limit_is_named():
    robot = linkage().copy()
    limits = robot.limits
    upper = np.array([np.inf, np.inf, -3.0])
    robot.limits = type(limits)(limits.lower, upper, limits.velocity, limits.effort)
    with pytest.raises(InputError, match=r"joint 'rocker': positions from .* follow from"):
        fill_trajectory(robot, TIMES, CRANK)


def test_an_empty_list_of_joints_is_not_the_default():
    robot = palletizer()
    with pytest.raises(InputError, match='joint_names: '):
        fill_trajectory(robot, [0.0, 1.0], [[0.0] * 4, [0.1] * 4], joint_names=[])
