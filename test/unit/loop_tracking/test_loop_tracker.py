"""Closed loops are tracked from measured joints."""

from kane_dynamics import (absolute_rates, knife_edge, ModelBuilder, Prescribed, Robot,
                           rod)
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.loop_tracking.loop_error import (BRANCH, CONTRADICTION, LoopError,
                                                    SINGULAR, UNKNOWN)
from kane_dynamics.loop_tracking.loop_tracker import (
    CLOSED, LEAP, LoopTracker, ROUNDING, SHARE, STRIDE, TIMED, valid)
from linkages import at_angle, five_bar, five_bar_at, four_bar, four_bar_model, PIN
import numpy as np
from palletizer import DRIVEN, palletizer, positions, SINGULAR_SHOULDER
import pytest


def four_bar_at(angle):
    return Robot(four_bar_model(), constraints=[PIN], independent=['crank'],
                 configuration=at_angle(angle))


def test_the_palletizer_is_closed_to_rounding_from_step_to_step():
    tracker = LoopTracker(palletizer(), DRIVEN)
    rng = np.random.default_rng(1)
    driven = np.zeros(4)
    for _ in range(300):
        rates = rng.uniform(-2.0, 2.0, 4)
        driven = np.clip(driven + 0.004 * rates, -0.4, 0.4)
        tracker.update(driven, rates)
        np.testing.assert_allclose(tracker.q, positions(palletizer(), *driven),
                                   atol=1e-12)
        np.testing.assert_allclose(tracker.u, rates, atol=1e-12)
        assert tracker.residual < 1e-12


def test_far_measurements_are_reached_on_the_same_branch():
    robot = four_bar_at(0.8)
    tracker = LoopTracker(robot, ['crank'])
    for angle in (0.8, 2.5, -3.0, 9.0):  # the crank turns
        tracker.update(np.array([angle]), np.zeros(1))
        expected = robot.closed_configuration(np.array([angle, 0.0, 0.0]),
                                              fixed=['crank'])
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
    tracker = LoopTracker(four_bar_at(0.8), ['crank'], tolerance=0.01)
    q = at_angle(0.8)
    tracker.update(q[:1], np.zeros(1), [1, 2], q[1:] + [2.0 * np.pi, 0.005])
    assert tracker.deviation == pytest.approx(0.005)
    assert reason(tracker, q[:1], np.zeros(1), [2], q[2:] + 0.02) == CONTRADICTION


def test_further_joints_that_were_not_finite_act_on_no_restart_and_no_other_joint():
    tracker = LoopTracker(four_bar_at(0.8), ['crank'], tolerance=0.01)
    q = at_angle(0.8)
    for change in (tracker.restart, lambda: tracker.update(q[:1] + 0.3, np.zeros(1))):
        tracker.measurement[:] = q[0], 0.0
        with pytest.raises(InputError, match=r'seen\[1\]: nan'):
            # As of a state that is refused.
            tracker.update_checked([1], np.array([np.nan]))
        change()
        assert tracker.known and tracker.residual < 1e-12
    np.testing.assert_allclose(tracker.q, at_angle(1.1), atol=1e-10)


def test_each_update_compares_the_joints_that_it_names():
    tracker = LoopTracker(four_bar_at(0.8), ['crank'], tolerance=0.01)
    q = at_angle(0.8)
    for others, values, deviation in (([1], q[1:2] + 4e-3, 4e-3),
                                      ([2], q[2:] - 3e-3, 3e-3),
                                      ((2, 1), q[:0:-1] + [1e-3, -2e-3], 2e-3),
                                      ((), None, 0.0)):
        tracker.update(q[:1], np.zeros(1), others, values)
        assert tracker.deviation == pytest.approx(deviation, abs=1e-11)
        assert tracker.residual < 1e-12
    assert reason(
        tracker, q[:1] + 1e-3, np.zeros(1), [1], q[1:2] - 0.02) == CONTRADICTION
    np.testing.assert_allclose(tracker.q, q, atol=1e-11)


def test_without_a_configuration_the_first_state_is_of_all_joints():
    tracker = LoopTracker(four_bar('crank'), ['crank'])
    q = at_angle(0.8)
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


def test_a_velocity_constraint_is_a_path_row():
    b = ModelBuilder('sleigh')
    b.body('body', kind='planar', inertial=rod(2.0, (0, 0, 0), (1, 0, 0)))
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
    q = np.array([0.1, 0.2, 0.3])
    rates = np.array([1.0, 2.0, 3.0])
    tracker.restart(q)
    tracker.update(q, rates)
    np.testing.assert_allclose(robot.joint_rates(q, tracker.u), rates, atol=1e-12)


def five_bar_tracker():
    robot = Robot(five_bar().model, constraints=five_bar().mechanism.constraints,
                  independent=('left_crank', 'right_crank'),
                  configuration=five_bar_at(2.0, 1.2))
    return LoopTracker(robot, ['left_crank', 'right_crank'])


def test_the_mode_is_unknown_after_a_singular_sample_far_from_the_last():
    truth = LoopTracker(four_bar_at(0.8), ['crank'])
    tracker = LoopTracker(four_bar_at(0.8), ['rocker'])
    reasons = []
    for angle in (2.0, 2.6, 3.1416, 3.7, 4.2):  # crank; the rocker reverses near 3.146
        truth.update(np.array([angle]), np.zeros(1))
        try:
            tracker.update(truth.q[2:], np.zeros(1))
            np.testing.assert_allclose(tracker.q, truth.q, atol=1e-9)
        except LoopError as error:
            reasons.append(error.reason)
            assert not tracker.known
    assert reasons == [SINGULAR, UNKNOWN, UNKNOWN]


def test_the_mode_is_unknown_where_the_branch_is_lost_next_to_a_far_sample():
    tracker = LoopTracker(four_bar_at(0.8), ['rocker'], max_figure=np.inf)
    # The crank points away from the ground.
    cosine = (0.9**2 + 0.7**2 - 1.3**2) / (2 * 0.9 * 0.7)
    assert reason(
        tracker, np.array([np.arccos(cosine) - np.pi + 0.01]), np.zeros(1)) == BRANCH
    assert not tracker.known


@pytest.mark.parametrize('bad', [np.nan, np.inf])
def test_numbers_that_are_not_finite_change_nothing(bad):
    tracker = LoopTracker(four_bar_at(0.8), ['crank'])
    q = at_angle(0.8)
    tracker.update(q[:1], np.ones(1))
    wrong = np.array([bad])
    state_before = (tracker.q.copy(), tracker.u.copy(), tracker.figure)
    for match, change in [
            ("measured of joint 'crank'", lambda: tracker.update(wrong, np.ones(1))),
            ("rates of joint 'crank'", lambda: tracker.update(q[:1], wrong)),
            ("values of joint 'rocker'",
             lambda: tracker.update(q[:1], np.ones(1), [2], wrong)),
            ('t:', lambda: tracker.update(q[:1], np.ones(1), t=bad)),
            ("start of joint 'coupler'", lambda: tracker.restart([0.8, bad, 2.0])),
            ('t:', lambda: tracker.restart(q, bad))]:
        with pytest.raises(InputError, match=match):
            change()
        assert tracker.known and tracker.figure == state_before[2]
        np.testing.assert_array_equal(tracker.q, state_before[0])
        np.testing.assert_array_equal(tracker.u, state_before[1])
    tracker.restart()
    tracker.update(q[:1] + 0.01, np.ones(1))
    np.testing.assert_allclose(tracker.q, at_angle(0.81), atol=1e-10)


def test_arguments_of_another_shape_are_refused_with_both_shapes():
    tracker = five_bar_tracker()
    q = tracker.q.copy()
    two = np.zeros(2)
    for match, change in [
            (r'measured: shape \(1,\); expected \(2,\)',
             lambda: tracker.update(np.array([1.6]), two)),
            (r'measured: shape \(\); expected \(2,\)', lambda: tracker.update(1.6, two)),
            (r'rates: shape \(1,\); expected \(2,\)',
             lambda: tracker.update(q[[0, 2]], np.zeros(1))),
            (r'values: shape \(0,\); expected \(1,\) \(left_bar\)',
             lambda: tracker.update(q[[0, 2]], two, [1])),
            (r'start: shape \(\); expected \(4,\)', lambda: tracker.restart(0.8))]:
        with pytest.raises(InputError, match=match):
            change()
        np.testing.assert_array_equal(tracker.q, q)
        assert tracker.known


def test_a_joint_given_twice_does_not_stand_for_another_in_the_first_state():
    tracker = LoopTracker(four_bar('crank'), ['crank'])
    q = at_angle(0.8)
    assert reason(tracker, q[:1], np.zeros(1), [2, 2], q[[2, 2]]) == UNKNOWN


@pytest.mark.parametrize('angle', [0.83, 3.0])
def test_a_refused_measurement_leaves_the_last_configuration_and_speeds(angle):
    tracker = LoopTracker(four_bar_at(0.8), ['crank'])
    tracker.update(np.array([0.81]), np.array([0.5]))
    q = tracker.q.copy()
    u = tracker.u.copy()
    assert reason(
        tracker, np.array([angle]), np.ones(1), [2], np.zeros(1)) == CONTRADICTION
    np.testing.assert_array_equal(tracker.q, q)
    np.testing.assert_array_equal(tracker.u, u)
    np.testing.assert_array_equal(tracker.accepted[0], q)


@pytest.mark.parametrize('kind', [list, tuple, np.array])
def test_indices_of_further_joints_may_be_any_sequence(kind):
    robot = palletizer()
    driven = np.array([0.2, 0.3, -0.2, 0.5])
    whole = positions(robot, *driven)
    at_rest = np.zeros(4)
    places = kind([k for k, name in enumerate(robot.joint_names) if name not in DRIVEN])
    tracker = LoopTracker(robot, DRIVEN)
    tracker.known = False
    for turn in (0.0, 2.0 * np.pi):
        tracker.update(driven, at_rest, places, whole[list(places)] + turn)
        np.testing.assert_allclose(tracker.q, whole, atol=1e-12)
        assert tracker.deviation < 1e-12
    beyond = whole[list(places)]
    beyond[1] += 1.001 * tracker.tolerance
    assert reason(tracker, driven, at_rest, places, beyond) == CONTRADICTION


def test_a_restart_from_an_open_configuration_is_refused():
    tracker = LoopTracker(four_bar_at(0.8), ['crank'])
    with pytest.raises(LoopError, match=r'start: residual .* expected a nearly closed'):
        tracker.restart([0.8, 2.0, 2.0])
    assert not tracker.known
    np.testing.assert_allclose(tracker.q, at_angle(0.8), atol=1e-10)
    tracker.restart(at_angle(0.8))
    assert tracker.known


def test_a_restart_forgets_the_rates():
    tracker = LoopTracker(four_bar_at(0.8), ['crank'])
    tracker.update(np.array([0.8]), np.array([0.5]))
    tracker.restart()
    np.testing.assert_array_equal(tracker.u, [0.0])


def test_ball_joints_are_refused_by_name():
    b = ModelBuilder('ball')
    b.body('hand', kind='ball', inertial=rod(1.0, (0, 0, 0), (0, 0, 1)))
    with pytest.raises(InputError,
                       match=r"LoopTracker: a robot with ball joints \('hand'\)"):
        LoopTracker(Robot(b.model()), ['hand/wx'])


def random_walk(tracker, steps, length, others=()):
    """Update by random steps; yield q, u and the figures of each."""
    rng = np.random.default_rng(5)
    at = tracker.q[tracker.places].copy()
    for _ in range(steps):
        at += rng.uniform(-length, length, at.shape)
        values = positions(tracker.robot, *at)[list(others)] + 0.01 if others else None
        tracker.update(at, rng.normal(size=at.shape), others, values)
        yield (tracker.q.copy(), tracker.u.copy(),
               np.array([tracker.figure, tracker.residual, tracker.deviation]))


@pytest.mark.parametrize('others', [(), (2, 3)])
def test_a_search_ends_where_small_measurements_lead(others, monkeypatch):
    small, far = (LoopTracker(palletizer(), DRIVEN) for _ in range(2))
    monkeypatch.setattr(small._step, 'search_from',
                        lambda known: pytest.fail('a search'))
    walk = random_walk(small, 300, 0.004, others)
    reached = [(q[small.places], q, u) for q, u, _ in walk]
    for measured, q, u in reached[::60]:
        assert np.abs(measured - far.q[far.places]).max() < 0.5
        values = q[list(others)] + 2.0 * np.pi if others else None
        far.update(measured, small.robot.joint_rates(q, u)[far.places], others, values)
        np.testing.assert_allclose(far.q, q, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(far.u, u, rtol=1e-10, atol=1e-12)
        assert far.deviation < 1e-12


def accepted_part(step):
    return np.concatenate(
        [step.search.q, step.search.T, step.search.u, [step.accepted_figure]])


def test_a_call_that_is_refused_leaves_the_state_to_the_bit():
    tracker = LoopTracker(palletizer(), DRIVEN)
    tracker.update(tracker.q[tracker.places] + 0.001, np.ones(4))
    step = tracker._step
    state = accepted_part(step)
    at = tracker.q[tracker.places]
    for change, others, values in [(0.2, (), None), (0.001, (2,), np.array([1.0])),
                                   (0.001, (2,), np.array([1e200]))]:
        step.measured[:] = at + change
        step.compare(others, values)
        assert not step.follow()
        np.testing.assert_array_equal(accepted_part(step), state)
    tracker.update(at + 0.001, np.ones(4))
    assert (accepted_part(step) != state).any()


def test_a_call_is_valid_within_all_limits_alone():
    figures = {'motion': 1e-6, 'independent_residual': 1e-24, 'residual': 1e-8,
               'figure': 4.0, 'step': 1e-6, 'deviation': 1e-6}
    limits = (1e-4, 1e-4, 100.0)

    def check(timed=False, last_figure=4.0, **changes):
        return valid(list((figures | changes).values()), last_figure, limits, timed)
    assert check() == check(last_figure=0.0) == check(step=0.0, motion=0.0) == 1.0
    bounds = {'independent_residual': CLOSED**2, 'residual': 1e-4, 'deviation': 1e-4,
              'figure': 100.0}
    for name, bound in bounds.items():
        assert check(**{name: 0.99 * bound}) == 1.0
        assert check(**{name: 1.01 * bound}) == 0.0
    assert check(last_figure=0.0, step=0.99 * STRIDE**2) == 1.0
    assert check(last_figure=0.0, step=1.01 * STRIDE**2) == 0.0
    assert check(last_figure=1e4, step=0.99e-4 * SHARE**2) == 1.0
    assert check(last_figure=1e4, step=1.01e-4 * SHARE**2) == 0.0
    assert check(motion=0.99 * 4e-6 * LEAP**2) == 1.0
    assert check(motion=1.01 * 4e-6 * LEAP**2) == 0.0
    assert check(step=0.0, motion=0.99 * 4.0 * (LEAP * ROUNDING)**2) == 1.0
    assert check(step=0.0, motion=1.01 * 4.0 * (LEAP * ROUNDING)**2) == 0.0
    assert check(timed=True, motion=0.99 * TIMED**2) == 1.0
    assert check(timed=True, motion=1.01 * TIMED**2) == 0.0
    for name in figures:
        assert check(**{name: np.nan}) == check(**{name: np.inf}) == 0.0


@pytest.mark.parametrize('values', ['none', 'consistent'])
def test_no_deviation_is_reported_of_a_refused_singular_configuration(values):
    tracker = LoopTracker(palletizer(), DRIVEN)
    at = tracker.q[tracker.places].copy()
    at[1] = SINGULAR_SHOULDER
    others = [2, 3] if values == 'consistent' else ()
    measured = positions(palletizer(), *at)[others] if others else None
    assert reason(tracker, at, np.zeros(4), others, measured) == SINGULAR
    assert tracker.deviation < 1e-9
    tracker.restart()
    assert tracker.deviation == 0.0


def test_a_measurement_may_be_lists_or_parts_of_the_last_one():
    tracker = LoopTracker(palletizer(), DRIVEN)
    at = (tracker.q[tracker.places] + 0.001).tolist()
    tracker.update(at, [0.001, 0.002, 0.003, 0.004])
    np.testing.assert_allclose(tracker.q[tracker.places], at, atol=1e-15)
    positions_before, rates = np.split(tracker.measurement, 2)
    expected = 0.5 * (positions_before + rates), positions_before.copy()
    tracker.update(expected[0], positions_before)
    np.testing.assert_array_equal(tracker.measurement, np.concatenate(expected))
    tracker.update(rates, positions_before)  # exchanged
    np.testing.assert_array_equal(tracker.measurement,
                                  np.concatenate([expected[1], expected[0]]))


def test_a_negative_limit_refuses_everything():
    tracker = LoopTracker(palletizer(), DRIVEN)
    at = tracker.q[tracker.places] + 0.001
    tracker.tolerance = -0.02
    assert reason(tracker, at, np.zeros(4), [2],
                  positions(palletizer(), *at)[[2]]) == CONTRADICTION
    tracker.max_figure = -200.0
    assert reason(tracker, at, np.zeros(4)) == SINGULAR


def test_limits_may_be_infinite(monkeypatch):
    tracker = LoopTracker(palletizer(), DRIVEN, tolerance=np.inf, max_figure=np.inf)
    monkeypatch.setattr(tracker._step, 'search_from',
                        lambda known: pytest.fail('a search'))
    at = tracker.q[tracker.places] + 0.001
    tracker.update(at, np.zeros(4), [2], np.array([50.0]))
    np.testing.assert_allclose(tracker.q[tracker.places], at, atol=1e-15)
