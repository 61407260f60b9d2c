"""Closed loops are tracked from measured joints."""

from kane_dynamics import absolute_rates, knife_edge, ModelBuilder, Prescribed, Robot, rod
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.kinematics.loop_tracker import (BRANCH, CONTRADICTION, LoopError, LoopTracker,
                                                   SINGULAR, UNKNOWN)
from linkages import at_angle, five_bar, five_bar_at, four_bar, four_bar_model, PIN
import numpy as np
from palletizer import DRIVEN, palletizer, positions
import pytest


def four_bar_at(angle):
    return Robot(four_bar_model(), constraints=[PIN], independent=['crank'],
                 configuration=at_angle(angle))


def test_the_palletizer_is_closed_to_rounding_from_step_to_step():
    tracker, rng = LoopTracker(palletizer(), DRIVEN), np.random.default_rng(1)
    driven = np.zeros(4)
    for _ in range(300):
        rates = rng.uniform(-2.0, 2.0, 4)
        driven = np.clip(driven + 0.004 * rates, -0.4, 0.4)
        tracker.update(driven, rates)
        np.testing.assert_allclose(tracker.q, positions(palletizer(), *driven), atol=1e-12)
        np.testing.assert_allclose(tracker.u, rates, atol=1e-12)
        assert tracker.residual < 1e-12


def test_far_measurements_are_reached_on_the_same_branch():
    robot = four_bar_at(0.8)
    tracker = LoopTracker(robot, ['crank'])
    for angle in (0.8, 2.5, -3.0, 9.0):  # the crank turns
        tracker.update(np.array([angle]), np.zeros(1))
        expected = robot.closed_posture(np.array([angle, 0.0, 0.0]), fixed=['crank'])
        np.testing.assert_allclose(tracker.q, expected, atol=1e-10)


def test_speeds_follow_from_rates_of_joints_that_are_not_independent():
    robot = four_bar_at(0.8)
    q = at_angle(0.8)
    rates = robot.joint_rates(q, np.array([1.7]))
    tracker = LoopTracker(robot, ['rocker'])
    tracker.update(q[2:], rates[2:])
    np.testing.assert_allclose(tracker.u, [1.7], rtol=1e-10)
    np.testing.assert_allclose(tracker.q, q, atol=1e-11)


def test_two_branches_of_the_five_bar_stay_apart():
    up = five_bar_at(2.0, 1.2)
    robot = Robot(five_bar().model, constraints=five_bar().mechanism.constraints,
                  independent=('left_crank', 'right_crank'), configuration=up)
    tracker = LoopTracker(robot, ['left_crank', 'right_crank'])
    for angle in np.linspace(0.0, 6.0, 200):
        cranks = np.array([2.0 + 0.2 * np.sin(angle), 1.2 + 0.2 * np.cos(angle)])
        tracker.update(cranks, np.zeros(2))
        np.testing.assert_allclose(tracker.q, five_bar_at(*cranks), atol=1e-10)


def reason(tracker, *arguments):
    with pytest.raises(LoopError) as caught:
        tracker.update(*arguments)
    return caught.value.reason


def test_a_loop_that_cannot_close_keeps_the_last_configuration():
    robot = four_bar_at(0.8)
    tracker = LoopTracker(robot, ['rocker'])  # rocks between two dead points
    start = tracker.q.copy()
    assert reason(tracker, start[2:] - 1.5, np.zeros(1)) in (SINGULAR, BRANCH)
    tracker.update(start[2:], np.zeros(1))
    np.testing.assert_allclose(tracker.q, start, atol=1e-10)


@pytest.mark.parametrize('step', [1e-3, 0.02])
def test_a_dead_point_is_not_passed_unnoticed(step):
    tracker = LoopTracker(four_bar_at(0.8), ['rocker'])
    angle = tracker.q[2]
    reasons = []
    for _ in range(round(1.5 / step)):
        angle -= step
        try:
            tracker.update(np.array([angle]), np.zeros(1))
        except LoopError as error:
            reasons.append(error.reason)
    assert reasons[0] in (SINGULAR, BRANCH) and set(reasons[1:]) == {UNKNOWN}
    assert reason(tracker, np.array([tracker.q[2] + 0.1]), np.zeros(1)) == UNKNOWN
    tracker.restart()
    tracker.update(at_angle(0.8)[2:], np.zeros(1))


def test_further_joints_are_compared_modulo_a_turn():
    tracker, q = LoopTracker(four_bar_at(0.8), ['crank'], tolerance=0.01), at_angle(0.8)
    tracker.update(q[:1], np.zeros(1), [1, 2], q[1:] + [2.0 * np.pi, 0.005])
    assert tracker.deviation == pytest.approx(0.005)
    assert reason(tracker, q[:1], np.zeros(1), [2], q[2:] + 0.02) == CONTRADICTION


def test_without_a_configuration_the_first_state_is_of_all_joints():
    tracker, q = LoopTracker(four_bar('crank'), ['crank']), at_angle(0.8)
    assert reason(tracker, q[:1], np.zeros(1)) == UNKNOWN
    tracker.update(q[:1], np.zeros(1), [1, 2], q[1:] + 1e-3)
    np.testing.assert_allclose(tracker.q, q, atol=1e-11)
    tracker.update(q[:1] + 0.01, np.zeros(1))
    np.testing.assert_allclose(tracker.q, at_angle(0.81), atol=1e-10)


def test_joints_driven_in_time_are_closed_at_their_time():
    robot = Robot(four_bar_model(), constraints=[
        PIN, Prescribed('crank', lambda t: 0.8 + 0.3 * t)], configuration=at_angle(0.8))
    tracker = LoopTracker(robot, [])
    tracker.update(np.zeros(0), np.zeros(0), t=0.1)
    np.testing.assert_allclose(tracker.q, at_angle(0.83), atol=1e-9)


def test_rows_of_velocities_are_told():
    b = ModelBuilder('sleigh')
    b.body('body', kind='planar', matter=rod(2.0, (0, 0, 0), (1, 0, 0)))
    robot = Robot(b.model(), constraints=[knife_edge('body', (0, 1, 0), name='runner')])
    assert LoopTracker(robot, robot.joint_names[::2]).path_rows == ('runner',)


def test_invalid_joints_are_refused():
    with pytest.raises(InputError, match=r'measured: .*; expected 1 of the joints'):
        LoopTracker(four_bar('crank'), ['crank', 'rocker'])
    with pytest.raises(InputError, match='without constraints; expected closed loops'):
        LoopTracker(Robot(four_bar_model()), ['crank'])
    assert issubclass(LoopError, ConstraintError)


def test_chosen_speeds_of_a_tree_follow_from_all_joints():
    robot = Robot(four_bar_model(), speeds=absolute_rates)
    tracker = LoopTracker(robot, robot.joint_names)
    q, rates = np.array([0.1, 0.2, 0.3]), np.array([1.0, 2.0, 3.0])
    tracker.restart(q)
    tracker.update(q, rates)
    np.testing.assert_allclose(robot.joint_rates(q, tracker.u), rates, atol=1e-12)
