"""Efforts filled in for trajectories of closed loops, compared with demand and power."""

from functools import cache

from kane_dynamics import fill_trajectory, InputError, Robot
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.feasibility import demand
from kane_dynamics.loop_tracking.loop_error import (BRANCH, CONTRADICTORY_POINT,
                                                    LoopError, SINGULAR)
from kane_dynamics.mechanics.definition import nonholonomic
from linkages import at_angle, four_bar, four_bar_model, PIN, sleigh
import numpy as np
from palletizer import (bending_palletizer, DRIVEN, palletizer, positions,
                        SINGULAR_SHOULDER)
import pytest

TIMES = [0.0, 0.5, 1.0]
CRANK = [[0.8], [1.4], [1.0]]


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
        expected = nonholonomic.inverse_dynamics(robot.mechanism, positions(robot, *row),
                                                 row, row)
        np.testing.assert_allclose(effort, expected, rtol=0.0,
                                   atol=1e-9 * np.abs(expected).max())


def test_an_actuator_at_another_joint_has_the_power_of_that_at_the_crank():
    crank = fill_trajectory(linkage(), TIMES, CRANK)
    asked = demand(linkage(), crank.motion, step=0.5)
    k = np.flatnonzero(asked.t == 0.5)[0]
    rocker = fill_trajectory(
        linkage(), [0.0], asked.q[k:k + 1, 2:], asked.u[k:k + 1, 2:],
        asked.udot[k:k + 1, 2:], joint_names=['rocker'], rest=asked.q[k])
    assert rocker.efforts[0, 0] * asked.u[k, 2] == pytest.approx(
        asked.tau[k, 0] * asked.u[k, 0], rel=1e-9)


def test_far_points_stay_on_the_branch_of_the_first():
    filled = fill_trajectory(linkage(), [0.0, 2.0], [[0.8], [0.8 + 2.0 * np.pi]])
    assert filled.efforts[1, 0] == pytest.approx(filled.efforts[0, 0], abs=1e-9)


@pytest.mark.parametrize(('robot', 'joints', 'words'), [
    (linkage(actuated=('rocker',)), ['crank'], 'joint_names: .* with actuators, rocker'),
    (four_bar('crank'), ['coupler', 'rocker'],
     'expected 1 joints that .* motion, crank, alone or'),
    (sleigh(), ['body/x', 'body/rz'], 'is one of velocities')])
def test_trajectories_that_do_not_state_the_efforts_are_refused(robot, joints, words):
    with pytest.raises(InputError, match=words):
        fill_trajectory(robot, [0.0], [[0.8, 0.0][:len(joints)]], joint_names=joints)


def test_a_passive_joint_beyond_its_limit_is_named():
    robot = linkage().copy()
    limits = robot.limits
    upper = np.array([np.inf, np.inf, -3.0])
    robot.limits = type(limits)(limits.lower, upper, limits.velocity, limits.effort)
    with pytest.raises(InputError,
                       match=r"joint 'rocker': positions from .* follow from"):
        fill_trajectory(robot, TIMES, CRANK)


def test_an_empty_list_of_joints_is_not_the_default():
    robot = palletizer()
    with pytest.raises(InputError, match='joint_names: '):
        fill_trajectory(robot, [0.0, 1.0], [[0.0] * 4, [0.1] * 4], joint_names=[])


def closed_rows(driven):
    """Return joint names in another order than the robot's, and closed rows."""
    names = palletizer().joint_names[::-1]
    return names, np.array([positions(palletizer(), *row)[::-1] for row in driven])


def test_a_trajectory_of_all_joints_has_the_efforts_of_the_driven_ones():
    driven = np.array(
        [[0.0, 0.0, 0.0, 0.0], [0.3, 0.2, -0.1, 0.4], [0.5, 0.3, -0.2, 1.0]])
    names, rows = closed_rows(driven)
    filled = fill_trajectory(palletizer(), TIMES, rows,
                             joint_names=names, tolerance=[50.0] * 10)
    assert filled.joint_names == tuple(name for name in names if name in DRIVEN)
    order = [DRIVEN.index(name) for name in filled.joint_names]
    expected = fill_trajectory(palletizer(), TIMES, driven,
                               joint_names=DRIVEN, tolerance=50.0)
    for field in ('positions', 'velocities', 'accelerations', 'efforts'):
        np.testing.assert_allclose(getattr(filled, field),
                                   getattr(expected, field)[:, order],
                                   rtol=1e-12, atol=1e-10)
    np.testing.assert_allclose(filled.effort_error, expected.effort_error[order],
                               rtol=1e-9)


def test_points_that_contradict_the_loops_are_named():
    names, rows = closed_rows([[0.0] * 4, [0.3, 0.2, -0.1, 0.4], [0.5, 0.3, -0.2, 1.0]])
    rows[1, names.index('rod_1_pin')] += 0.03
    with pytest.raises(LoopError,
                       match=r"at point 1 \(0.5 s\): 'rod_1_pin' at 0.23") as caught:
        fill_trajectory(palletizer(), TIMES, rows, joint_names=names)
    assert caught.value.reason == CONTRADICTORY_POINT
    fill_trajectory(palletizer(), TIMES, rows, joint_names=names, loop_tolerance=0.04)


@pytest.mark.parametrize('beyond', [0.0, -0.3])
def test_a_singular_configuration_between_points_is_named(beyond):
    row = [0.0, SINGULAR_SHOULDER + beyond, 0.0, 0.0]
    with pytest.raises(LoopError, match='near a singular configuration: ') as caught:
        fill_trajectory(unlimited(), [0.0, 1.0], [[0.0] * 4, row], joint_names=DRIVEN,
                        max_figure=200.0)
    assert caught.value.reason == SINGULAR


def unlimited():
    """Return the palletizer without limits of position and velocity."""
    robot = palletizer().copy()
    infinite = np.full(robot.n_q, np.inf)
    robot.limits = type(robot.limits)(-infinite, infinite, infinite, infinite)
    return robot


@pytest.mark.parametrize('every', [False, True])
def test_the_assembly_mode_is_that_of_the_given_configuration(every):
    robot = linkage()
    elbow_across, moved = (four_bar('crank').closed_configuration((angle, -1.9, 2.1),
                                                                  fixed=['crank'])
                           for angle in (0.8, 0.9))  # the elbow on the other side
    columns = slice(None) if every else slice(1)
    rows = np.array([elbow_across, moved])[:, columns]
    names = robot.joint_names[columns]
    filled = fill_trajectory(robot, [0.0, 1.0], rows, joint_names=names, rest=moved)
    for q, u, udot, effort in zip((elbow_across, moved), filled.velocities,
                                  filled.accelerations, filled.efforts):
        expected = nonholonomic.inverse_dynamics(robot.mechanism, q, u, udot)
        np.testing.assert_allclose(effort, expected, rtol=1e-9)
    there = fill_trajectory(robot, [0.0, 1.0], [[0.8], [0.9]])
    assert np.abs(filled.efforts - there.efforts).max() > 0.1
    with pytest.raises(LoopError, match='contradicts the closed loop: at point 0'):
        fill_trajectory(robot, [0.0, 1.0], [elbow_across, moved],
                        joint_names=robot.joint_names)


def test_driving_joints_for_which_the_loops_stay_open_are_refused():
    at = np.array(at_angle(0.8))
    with pytest.raises(LoopError, match=r'closed loop .*: after point 0') as caught:
        fill_trajectory(linkage(), [0.0, 1.0], [at[2:], at[2:] + 1.5],
                        joint_names=['rocker'],
                        rest=at)  # no crank turns the rocker that far
    assert caught.value.reason in (SINGULAR, BRANCH)


def test_beams_are_those_of_the_same_joints_and_speeds_with_actuators_at_these():
    flexible, rigid = bending_palletizer()
    bent = QuasiStatic(flexible)
    rows = np.array([[0.2, 0.3, -0.2, 0.5]])
    filled = fill_trajectory(rigid, [0.0], rows, joint_names=DRIVEN, bending=bent)
    np.testing.assert_allclose(filled.efforts[0],
                               bent.gravity_force(positions(rigid, *rows[0])), rtol=1e-9)
    reverse = Robot(rigid.model, **{**rigid.options, 'independent': DRIVEN[::-1]})
    with pytest.raises(InputError,
                       match=r"bending: .* speeds .'swivel', .* and .'turn', 'lever"):
        fill_trajectory(reverse, [0.0], rows, joint_names=DRIVEN, bending=bent)
    others = ['swivel', 'shoulder', 'elbow', 'turn']
    for actuated in (None, others):
        robot = Robot(rigid.model, **{**rigid.options, 'actuated': actuated})
        with pytest.raises(InputError,
                           match=r"joint_names: .*'elbow'.*, the independent joints"):
            fill_trajectory(robot, [0.0], [[0.2, 0.3, -0.5, 0.5]], joint_names=others,
                            bending=bent)
