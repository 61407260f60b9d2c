"""Efforts for machines with more actuators than independent speeds: a five-bar."""

from kane_dynamics import fill_trajectory, InputError, Robot
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.loop_tracking.loop_error import CONTRADICTORY_POINT, LoopError
from kane_dynamics.mechanics.definition import nonholonomic
from linkages import five_bar, five_bar_at, five_bar_partial_rates
import numpy as np
from palletizer import bending_palletizer, DRIVEN
import pytest

CRANKS = ('left_crank', 'right_crank')
MOTORS = (*CRANKS, 'right_bar')
TIMES = [0.0, 0.4, 1.0]
ROWS = np.array([[2.0, 1.0], [2.3, 1.2], [2.1, 0.8]])
START = five_bar_at(*ROWS[0])
WIDE = 10.0  # rad, from the closed loops


def filled(robot, **options):
    return fill_trajectory(robot, TIMES, ROWS, rest=START, **options)


def columns(robot, result):
    return [robot.joint_names.index(name) for name in result.joint_names]


@pytest.mark.parametrize('weights', [(), (1.0, 2.0, 0.25)])
def test_the_efforts_are_the_smallest_of_those_with_the_force_of_the_definition(weights):
    robot = five_bar(*MOTORS, weights=weights)
    result = filled(robot, loop_tolerance=WIDE)
    alone = filled(five_bar(*CRANKS))
    assert result.joint_names == MOTORS and result.inserted == 0
    places = columns(robot, result)
    root = np.sqrt(weights or (1.0, 1.0, 1.0))
    for cranks, rates, accelerations, efforts in zip(
            ROWS, alone.velocities, alone.accelerations, result.efforts, strict=True):
        q = five_bar_at(*cranks)
        force = nonholonomic.inverse_dynamics(robot.mechanism, q, rates, accelerations)
        # The least norm of root * tau with T^T tau = force, by the pseudoinverse.
        T = five_bar_partial_rates(q)[places]
        expected = np.linalg.pinv(T.T / root) @ force / root
        np.testing.assert_allclose(efforts, expected,
                                   rtol=0.0, atol=1e-9 * np.abs(force).max())


def test_positions_velocities_and_accelerations_are_those_of_the_closed_loop():
    robot = five_bar(*MOTORS)
    step = 1e-4
    result = filled(robot, loop_tolerance=WIDE)
    alone = filled(five_bar(*CRANKS))
    places = columns(robot, result)
    for k, (cranks, rates) in enumerate(zip(ROWS, alone.velocities, strict=True)):
        q = five_bar_at(*cranks)
        np.testing.assert_allclose(result.positions[k], q[places], atol=1e-9)
        np.testing.assert_allclose(result.velocities[k],
                                   (five_bar_partial_rates(q) @ rates)[places],
                                   atol=1e-9)
        near = [five_bar_at(*(cranks + s * rates + 0.5 * s**2 * alone.accelerations[k]))
                for s in (-step, 0.0, step)]
        second = (near[0] - 2.0 * near[1] + near[2]) / step**2
        np.testing.assert_allclose(result.accelerations[k], second[places], atol=1e-6)


@pytest.mark.parametrize('tolerance', [1e-3, 1e-5])
def test_points_are_inserted_until_all_motors_keep_to_the_loop_between_points(tolerance):
    robot = five_bar(*MOTORS)
    result = filled(robot, loop_tolerance=tolerance)
    assert result.inserted > 0 and set(TIMES) <= set(result.times)
    assert result.effort_error is None
    moved = result.motion.sample(np.linspace(0.0, 1.0, 2001))[0]
    closed = np.array([five_bar_at(*row[:2])
                       for row in moved])[:, columns(robot, result)]
    assert 0.05 * tolerance < np.abs(moved - closed).max() <= 1.05 * tolerance
    coarse = filled(robot, loop_tolerance=WIDE)
    moved = coarse.motion.sample(np.linspace(0.0, 1.0, 2001))[0]
    closed = np.array([five_bar_at(*row[:2])
                       for row in moved])[:, columns(robot, result)]
    assert np.abs(moved - closed).max() > tolerance


def test_the_tolerance_of_efforts_holds_for_every_motor():
    robot = five_bar(*MOTORS)
    coarse = filled(robot, tolerance=0.05)
    fine = filled(robot, tolerance=0.01)
    assert fine.inserted > coarse.inserted > 0
    assert (coarse.effort_error <= 0.05).all()
    between = np.array([np.interp(fine.times, coarse.times, row)
                        for row in coarse.efforts.T]).T
    assert (np.abs(between - fine.efforts).max(axis=0)
            <= 1.05 * coarse.effort_error).all()
    # A motor that is not among the joints of the trajectory has the smallest tolerance
    # of these.
    assert (filled(robot, tolerance=[0.05, 1e3]).effort_error <= [0.05, 1e3, 0.05]).all()


def test_a_trajectory_of_all_motors_is_that_of_the_cranks_and_must_fit_the_loop():
    robot = five_bar(*MOTORS)
    names = ('right_bar', *CRANKS[::-1])
    q = np.array([five_bar_at(*row) for row in ROWS])
    rows = q[:, [robot.joint_names.index(name) for name in names]]
    result = fill_trajectory(robot, TIMES, rows, joint_names=names, rest=START,
                             loop_tolerance=WIDE)
    assert result.joint_names == names
    expected = filled(robot, loop_tolerance=WIDE)
    order = [expected.joint_names.index(name) for name in names]
    for field in ('positions', 'velocities', 'accelerations', 'efforts'):
        np.testing.assert_allclose(getattr(result, field),
                                   getattr(expected, field)[:, order],
                                   rtol=1e-9, atol=1e-9)
    rows[1, 0] += 0.03
    with pytest.raises(LoopError, match=r"at point 1 .* 'right_bar' at") as caught:
        fill_trajectory(robot, TIMES, rows, joint_names=names, rest=START)
    assert caught.value.reason == CONTRADICTORY_POINT


def test_other_joints_may_drive_the_same_motion():
    robot = five_bar(*MOTORS)
    names = ['left_bar', 'right_crank']
    expected = filled(robot, loop_tolerance=WIDE)
    q = np.array([five_bar_at(*row) for row in ROWS])
    T = [five_bar_partial_rates(row) for row in q]
    step = 1e-4
    u = np.array(
        [t @ rates for t, rates in zip(T, expected.velocities[:, :2], strict=True)])
    udot = []
    for row, rates, accelerations in zip(ROWS, expected.velocities[:, :2],
                                         expected.accelerations[:, :2], strict=True):
        near = [five_bar_at(*(row + s * rates + 0.5 * s**2 * accelerations))
                for s in (-step, 0.0, step)]
        udot.append((near[0] - 2.0 * near[1] + near[2]) / step**2)
    places = [robot.joint_names.index(name) for name in names]
    result = fill_trajectory(robot, TIMES, q[:, places], u[:, places],
                             np.array(udot)[:, places], joint_names=names, rest=START,
                             loop_tolerance=WIDE)
    assert result.joint_names == ('right_crank', 'left_crank', 'right_bar')
    np.testing.assert_allclose(result.efforts[:, [1, 0, 2]], expected.efforts, atol=1e-5)


@pytest.mark.parametrize(('field', 'words'), [
    ('velocity', "joint 'right_bar': velocity "),
    ('effort', "joint 'right_bar': effort "),
    ('upper', "joint 'right_bar': positions? ")])
def test_limits_of_a_motor_that_follows_are_checked(field, words):
    robot = five_bar(*MOTORS).copy()
    limits = robot.limits
    values = {name: getattr(limits, name).copy()
              for name in ('lower', 'upper', 'velocity', 'effort')}
    values[field][robot.joint_names.index('right_bar')] = 0.05
    robot.limits = type(limits)(**values)
    with pytest.raises(InputError, match=words):
        filled(robot)


def test_joints_that_do_not_determine_the_motion_are_refused():
    with pytest.raises(InputError,
                       match=r'expected 2 joints that .*, left_crank, right_crank, a'):
        fill_trajectory(five_bar(*MOTORS), [0.0], [[2.0]], joint_names=['left_crank'])


def test_beams_need_actuators_at_the_independent_joints_alone():
    flexible, rigid = bending_palletizer()
    robot = Robot(rigid.model, **{**rigid.options, 'actuated': (*DRIVEN, 'elbow')})
    with pytest.raises(InputError,
                       match=r"actuated: .*'elbow'.*, the independent joints"):
        fill_trajectory(robot, [0.0], [[0.2, 0.3, -0.2, 0.5]], joint_names=DRIVEN,
                        bending=QuasiStatic(flexible))
