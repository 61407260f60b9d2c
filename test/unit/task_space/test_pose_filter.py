"""The target filter keeps its limits and reaches its goal."""

from copy import copy, deepcopy
from itertools import pairwise
import pickle

from hypothesis import given, settings, strategies as st
from kane_dynamics import InputError, pose_error, pose_exp, PoseFilter
import numpy as np
import pytest

LIMITS = {'linear_speed': 0.5, 'angular_speed': 1.0, 'linear_acceleration': 2.0,
          'angular_acceleration': 5.0}
TWISTS = st.lists(st.floats(-2.0, 2.0), min_size=6, max_size=6)


def norms(rows):
    """Return the largest linear and angular norms."""
    rows = np.array(rows)
    return [np.linalg.norm(rows[:, part], axis=1).max()
            for part in (slice(3), slice(3, 6))]


@pytest.mark.slow
@settings(max_examples=12, deadline=None)
@given(TWISTS, TWISTS, st.sampled_from([1e-3, 4e-3, 0.02]), st.sampled_from([0.0, 0.03]))
def test_limits_hold_while_the_goal_jumps_and_it_is_reached(first, second, h, smoothing):
    target = PoseFilter(**LIMITS, smoothing=smoothing)
    target.reset(np.eye(4))
    twists = [np.zeros(6)]
    accelerations = []
    poses = [np.eye(4)]
    for goal in (pose_exp(first), pose_exp(second)):
        for _ in range(int(0.5 / h)):
            state = target.step(goal, h)
            twists.append(state.twist)
            accelerations.append(state.acceleration)
            poses.append(state.pose)
    assert np.all(norms(twists) <= np.array([0.5, 1.0]) * (1 + 1e-12))
    # (T w)^2 where the axis of a smoothed rotation changes.
    turning = 1e-9 + (smoothing * LIMITS['angular_speed']) ** 2
    assert np.all(
        norms(accelerations) <= np.array([2.0 * (1 + 1e-9), 5.0 * (1 + turning)]))
    steps = [pose_error(a, b) / h for a, b in pairwise(poses)]
    np.testing.assert_allclose(steps, twists[1:], atol=1e-7)
    for _ in range(int(8.0 / h)):
        state = target.step(goal, h)
    np.testing.assert_allclose(state.pose, goal, atol=1e-9)
    np.testing.assert_allclose(state.pose[:3, :3] @ state.pose[:3, :3].T, np.eye(3),
                               atol=1e-14)


def test_a_goal_along_a_line_is_reached_without_overshoot_in_the_shortest_time():
    target = PoseFilter(**LIMITS)
    target.reset(np.eye(4))
    goal = pose_exp([0.5, 0, 0, 0, 0, 0])
    x = [target.step(goal, 1e-3).pose[0, 3] for _ in range(1500)]
    assert max(x) <= 0.5
    # 0.5 m at 0.5 m/s and 2 m/s^2 take 1.25 s.
    assert x[1150] < 0.497 and x[1270] > 0.4999


def test_a_moving_goal_is_followed_without_a_lag_when_its_velocity_is_known():
    target = PoseFilter(**LIMITS)
    target.reset(np.eye(4))
    velocity = np.array([0.2, 0.1, 0.0, 0.0, 0.0, 0.3])
    for k in range(2000):
        goal = np.eye(4)
        goal[:3, 3] = velocity[:3] * 1e-3 * (k + 1)
        angle = 0.3e-3 * (k + 1)
        goal[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        state = target.step(goal, 1e-3, velocity)
    assert np.abs(pose_error(state.pose, goal)).max() < 1e-3
    np.testing.assert_allclose(state.twist, velocity, atol=1e-3)


def test_a_start_in_motion_keeps_its_velocity_at_first():
    target = PoseFilter(**LIMITS)
    target.reset(np.eye(4), [0.4, 0, 0, 0, 0, 0])
    state = target.step(np.eye(4), 1e-3)
    assert state.twist[0] == pytest.approx(0.398)


def test_smoothing_makes_the_acceleration_continuous_and_the_target_late():
    plain = PoseFilter(**LIMITS)
    smooth = PoseFilter(**LIMITS, smoothing=0.03)
    goal = pose_exp([0.3, -0.2, 0.1, 0.4, -0.5, 0.2])
    poses = [np.eye(4)]
    twists = [np.zeros(6)]
    accelerations = [np.zeros(6)]
    followed = [0.0]
    for target in (plain, smooth):
        target.reset(np.eye(4))
    for _ in range(4000):
        followed.append(plain.step(goal, 1e-3).pose[0, 3])
        state = smooth.step(goal, 1e-3)
        poses.append(state.pose)
        twists.append(state.twist)
        accelerations.append(state.acceleration)
    # One motion: each is the rate of the one before.
    np.testing.assert_allclose([pose_error(a, b) / 1e-3 for a, b in pairwise(poses)],
                               twists[1:], atol=1e-9)
    np.testing.assert_allclose(np.diff(twists, axis=0) / 1e-3, accelerations[1:],
                               atol=1e-9)
    # A step of acceleration by at most twice its limit comes within the time constant.
    steps = norms(np.diff(accelerations, axis=0))
    assert np.all(steps <= 2.0 * np.array([2.0, 5.0]) * 1e-3 / 0.03)
    np.testing.assert_allclose(state.pose, goal, atol=1e-9)
    # p_s + T p_s' = p
    late = np.array([pose[0, 3] for pose in poses]) + 0.03 * np.array(twists)[:, 0]
    np.testing.assert_allclose(late, followed, atol=1e-12)


def test_a_smoothed_start_in_motion_goes_on_from_its_pose():
    target = PoseFilter(**LIMITS, smoothing=0.03)
    target.reset(np.eye(4), [0.4, 0, 0, 0, 0, 0.9])
    np.testing.assert_array_equal(target.state.pose, np.eye(4))
    state = target.step(pose_exp([0.4, 0, 0, 0, 0, 0.9]), 1e-3)
    np.testing.assert_allclose(pose_error(np.eye(4), state.pose),
                               [0.4e-3, 0, 0, 0, 0, 0.9e-3], atol=1e-6)


def test_limits_change_while_the_target_moves():
    target = PoseFilter(**LIMITS)
    target.reset(np.eye(4))
    target.tune(linear_speed=0.1)
    for _ in range(1000):
        state = target.step(pose_exp([1.0, 0, 0, 0, 0, 0]), 1e-3)
    assert state.twist[0] == pytest.approx(0.1)


def test_wrong_numbers_are_refused_and_change_nothing():
    target = PoseFilter(**LIMITS)
    with pytest.raises(InputError, match='before reset'):
        target.step(np.eye(4), 1e-3)
    target.reset(np.eye(4))
    state_before = target.state
    for goal, elapsed, twist in ((2.0 * np.eye(4), 1e-3, None), (np.eye(3), 1e-3, None),
                                 (np.eye(4), -1.0, None), (np.eye(4), np.nan, None),
                                 (np.eye(4), 'soon', None), (np.eye(4), None, None),
                                 (np.eye(4), 1e-3, [np.nan] * 6),
                                 (np.eye(4), 1e-3, [0.0]),
                                 (np.full((4, 4), np.nan), 1e-3, None)):
        with pytest.raises(InputError, match='expected'):
            target.step(goal, elapsed, twist)
    for name in LIMITS:
        for value in (0.0, -1.0, np.inf, np.nan, 'x'):
            with pytest.raises(InputError, match=name):
                target.tune(**{name: value})
    with pytest.raises(InputError, match='speed'):
        target.tune(speed=1.0)
    for value in (-1.0, np.inf, np.nan, 'x'):
        with pytest.raises(InputError, match='smoothing'):
            PoseFilter(**LIMITS, smoothing=value)
    for pose, twist in ((np.eye(3), None), (np.eye(4), [1.0]),
                        (np.eye(4), [np.inf] * 6)):
        with pytest.raises(InputError, match='expected'):
            target.reset(pose, twist)
    np.testing.assert_array_equal(target.state.pose, state_before.pose)
    assert target.step(np.eye(4), 0.0).pose is not None


def test_a_changed_result_does_not_move_the_target():
    smooth = PoseFilter(linear_speed=0.2, angular_speed=1.0, linear_acceleration=1.0,
                        angular_acceleration=4.0)
    smooth.reset(np.eye(4))
    smooth.step(np.eye(4), 0.01).pose[0, 3] = 1.0
    smooth.state.twist[0] = 1.0
    np.testing.assert_array_equal(smooth.state.pose, np.eye(4))
    np.testing.assert_array_equal(smooth.state.twist, np.zeros(6))


@pytest.mark.parametrize('smoothing', [0.0, 0.02])
@pytest.mark.parametrize('copied',
                         [copy, deepcopy, lambda x: pickle.loads(pickle.dumps(x))],
                         ids=['copy', 'deepcopy', 'pickle'])
def test_a_copy_goes_on_from_the_same_target_by_itself(copied, smoothing):
    goal = np.eye(4)
    goal[0, 3] = 0.3
    moving = PoseFilter(**LIMITS, smoothing=smoothing)
    moving.reset(np.eye(4))
    moving.step(goal, 0.01)
    duplicate = copied(moving)
    duplicate.tune(linear_speed=0.1)
    for _ in range(50):
        duplicate.step(goal, 0.01)
    np.testing.assert_array_equal(copied(moving).step(goal, 0.01).pose,
                                  moving.step(goal, 0.01).pose)
    assert moving.state.pose[0, 3] < duplicate.state.pose[0, 3]
