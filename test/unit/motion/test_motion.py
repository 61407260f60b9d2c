"""Motion: interpolation as in joint_trajectory_controller, and its error messages."""

from kane_dynamics.errors import InputError
from kane_dynamics.motion.motion import Motion
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

NAMES = ('shoulder', 'elbow', 'wrist')
TIMES = np.array([0.0, 0.3, 0.45, 1.2, 2.0])


def points(seed=1, count=5):
    """Return random positions, velocities and accelerations of `count` points."""
    return np.random.default_rng(seed).normal(size=(3, count, len(NAMES)))


def motion(kind, times=TIMES, **options):
    """Return a motion through random points with the derivatives of `kind`."""
    return Motion.from_points(times, *points(count=len(times))[:kind], joint_names=NAMES,
                              **options)


@pytest.mark.parametrize('kind', [1, 2, 3])
def test_passes_through_every_given_number(kind):
    m = motion(kind)
    for i, t in enumerate(TIMES[:-1]):
        for sampled, stated in zip(m.sample(t)[:kind], points()[:kind], strict=True):
            np.testing.assert_allclose(sampled, stated[i], rtol=0, atol=1e-13)


@pytest.mark.parametrize('kind', [1, 2, 3])
def test_reaches_the_end_of_every_segment_with_the_given_derivatives(kind):
    m = motion(kind)
    for i, t in enumerate(TIMES[1:], 1):
        end = m.sample(np.nextafter(t, 0.0))
        for sampled, stated in zip(end[:kind], points(), strict=False):
            np.testing.assert_allclose(sampled, stated[i], rtol=0, atol=1e-11)


@pytest.mark.parametrize('kind', [1, 2, 3])
def test_derivatives_match_finite_differences(kind):
    m = motion(kind)
    e = 1e-6
    t = np.random.default_rng(0).uniform(0.01, 1.99, 50)
    t = t[np.abs(t[:, None] - TIMES).min(axis=1) > 2 * e]
    q_left, u_left, _ = m.sample(t - e)
    q_right, u_right, _ = m.sample(t + e)
    _, u, udot = m.sample(t)
    np.testing.assert_allclose((q_right - q_left) / (2 * e), u, atol=1e-6)
    np.testing.assert_allclose((u_right - u_left) / (2 * e), udot, atol=1e-5)


@pytest.mark.parametrize(('kind', 'continuous'), [(1, 3), (2, 2), (3, 3)])
def test_is_as_smooth_at_inner_points_as_promised(kind, continuous):
    m = motion(kind)
    for t in TIMES[1:-1]:
        for k in range(continuous):
            left = m.sample(np.nextafter(t, 0.0))[k]
            right = m.sample(t)[k]
            np.testing.assert_allclose(left, right, rtol=0, atol=1e-10)


def test_positions_only_are_the_clamped_cubic_spline():
    m = motion(1)
    peer = CubicSpline(TIMES, points()[0], bc_type='clamped')
    t = np.linspace(0.0, 1.999, 101)
    for k, got in enumerate(m.sample(t)):
        np.testing.assert_allclose(got, peer(t, k), rtol=1e-12, atol=1e-12)


def test_positions_only_from_a_moving_start_keep_its_velocity():
    q0 = np.array([0.1, 0.2, 0.3])
    u0 = np.array([1.0, -1.0, 0.5])
    times = np.array([0.5, 1.0, 1.7])
    m = motion(1, times, start=(q0, u0, None))
    peer = CubicSpline([0.0, *times], np.vstack([q0, points(count=3)[0]]),
                       bc_type=((1, u0), (1, np.zeros(3))))
    t = np.linspace(0.0, 1.699, 50)
    np.testing.assert_allclose(m.sample(t)[2], peer(t, 2), rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize('kind', [2, 3])
def test_starts_from_the_given_state_when_the_first_point_is_later(kind):
    start = tuple(np.random.default_rng(5).normal(size=(3, 3)))
    m = motion(kind, np.array([0.5, 1.0]), start=start)
    for got, stated in zip(m.sample(0.0)[:kind], start, strict=False):
        np.testing.assert_allclose(got, stated, rtol=0, atol=1e-14)
    np.testing.assert_allclose(m.sample(0.5)[0], points(count=2)[0][0], atol=1e-14)


def test_start_does_not_matter_when_the_first_point_is_at_once():
    m = motion(2, start=(np.ones(3), np.ones(3), None))
    np.testing.assert_array_equal(m.sample(0.1), motion(2).sample(0.1))


@pytest.mark.parametrize('kind', [1, 2, 3])
def test_rests_before_the_first_and_after_the_last_point(kind):
    m = motion(kind, np.array([0.5, 1.0]))
    q = points(count=2)[0]
    for t, expected in ((-1.0, q[0]), (0.49, q[0]), (1.0, q[1]), (1e9, q[1])):
        got = m.sample(t)
        np.testing.assert_array_equal(got[0], expected)
        assert not got[1].any() and not got[2].any()


def test_one_point_alone_is_a_pose_and_from_a_start_a_segment():
    pose = Motion.from_points([0.0], [[1.0, 2.0, 3.0]], joint_names=NAMES)
    np.testing.assert_array_equal(pose.sample(0.0)[0], [1.0, 2.0, 3.0])
    segment = Motion.from_points([2.0], [[1.0, 2.0, 3.0]], joint_names=NAMES,
                                 start=(np.zeros(3), None, None))
    np.testing.assert_allclose(segment.sample(1.0)[0], [0.5, 1.0, 1.5])


@pytest.mark.parametrize('kind', [1, 2, 3])
def test_array_of_times_gives_the_same_as_each_time(kind):
    m = motion(kind, TIMES + 0.2)
    t = np.array([-1.0, 0.2, 0.5, 0.6, 1.0, 2.2, 3.0])
    many = m.sample(t)
    for i, value in enumerate(t):
        for k in range(3):
            assert many[k].flags.c_contiguous and many[k].shape == (len(t), 3)
            np.testing.assert_allclose(m.sample(value)[k], many[k][i],
                                       rtol=1e-13, atol=1e-12)


def test_order_picks_and_reorders_joints_and_start_follows_it():
    m = Motion.from_points([1.0], [[1.0, 2.0, 3.0]], joint_names=NAMES,
                           order=['wrist', 'shoulder'], start=([30.0, 10.0], None, None))
    assert m.joint_names == ('wrist', 'shoulder') and m.n == 2
    np.testing.assert_array_equal(m.sample(1.0)[0], [3.0, 1.0])
    np.testing.assert_array_equal(m.sample(0.0)[0], [30.0, 10.0])


def test_empty_rows_of_a_message_mean_not_given():
    m = Motion.from_points(TIMES, points()[0], [[]] * 5, [], joint_names=NAMES)
    np.testing.assert_array_equal(m.sample(0.7), motion(1).sample(0.7))


def test_a_returned_sample_is_the_callers_own():
    m = motion(1)
    m.sample(5.0)[0][:] = 7.0
    m.sample(0.1)[0][:] = 7.0
    np.testing.assert_array_equal(m.sample(5.0)[0], points()[0][-1])
    np.testing.assert_array_equal(m.sample(0.1), motion(1).sample(0.1))


NAN_ROW = [[0.0, 0.0, 0.0], [0.0, np.nan, 0.0]]
ZERO = [[0.0] * 3] * 2


@pytest.mark.parametrize(('arguments', 'options', 'words'), [
    (([0.0, 0.0], ZERO), {}, ['point 1', '0.0 s', 'more than']),
    (([1.0, 0.5], ZERO), {}, ['point 1', '0.5', '1.0']),
    (([-1.0, 0.5], ZERO), {}, ['point 0', '-1.0', '>= 0']),
    (([0.0, np.inf], ZERO), {}, ['point 1', 'inf', 'finite']),
    (([], []), {}, ['times', 'at least one']),
    ((['a', 'b'], ZERO), {}, ['times', 'one number per point']),
    (([0.0, 1.0], NAN_ROW), {}, ['point 1', "'elbow'", 'nan', 'finite']),
    (([0.0, 1.0], [[0.0] * 3]), {}, ['positions', '1 rows', 'expected 2']),
    (([0.0, 1.0], [[], []]), {}, ['positions', 'shoulder']),
    (([0.0, 1.0], [[0.0] * 3, [0.0]]), {},
     ['point 1', 'positions', 'expected (3,)', 'wrist']),
    (([0.0, 1.0], 5.0), {}, ['positions', '5.0', '3 numbers']),
    (([0.0, 1.0], ZERO, [[0.0] * 3, []]), {}, ['point 1', 'velocities']),
    (([0.0, 1.0], ZERO, None, ZERO), {}, ['accelerations', 'without velocities']),
    (([0.0, 1.0], ZERO, NAN_ROW), {}, ['point 1', 'velocities', "'elbow'"]),
    (([0.0, 1.0], ZERO), {'joint_names': ['a', 'a', 'b']}, ['joint_names', 'different']),
    (([0.0, 1.0], ZERO), {'order': ['wrist', 'hand']}, ['expected', 'hand', 'elbow']),
    (([1.0, 2.0], ZERO), {'start': (['a', 'b', 'c'], None, None)},
     ['start', "'a'", '3']),
    (([1.0, 2.0], ZERO), {'start': ([0.0, 0.0], None, None)},
     ['start', 'positions', '3']),
    (([1.0, 2.0], ZERO), {'start': ([0.0] * 3, [0, 0, np.inf], None)},
     ['start', 'velocities', "'wrist'", 'inf']),
])
def test_bad_points_are_refused_by_name_value_and_what_is_valid(
        arguments, options, words):
    with pytest.raises(InputError) as caught:
        Motion.from_points(*arguments, **{'joint_names': NAMES, **options})
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize('t',
                         [np.nan, np.inf, np.array([0.0, np.nan]), np.zeros((2, 2))])
def test_a_time_that_is_not_finite_is_refused(t):
    with pytest.raises(InputError, match='expected'):
        motion(1).sample(t)


def test_points_too_far_apart_for_finite_numbers_are_refused():
    with pytest.raises(InputError, match='overflow; expected a finite motion'):
        Motion.from_points([0.0, 1.0], [[1e308], [-1e308]], joint_names=['a'])
    with pytest.raises(InputError, match='overflow; expected a finite motion'):
        Motion.from_points([0.0, 5e-324], [[0.0], [1.0]], joint_names=['a'])


def test_numbers_of_a_motion_are_read_only():
    t = np.array([0.0, 1.0, 2.5])
    names = ('a', 'b')
    table = np.ones((2, 6, 2))
    for motion in (Motion.from_points(t, np.eye(3)[:, :2], joint_names=names),
                   Motion(names, t.copy(), np.ones((3, 2)), table.copy()),
                   Motion(names, t.copy(), np.ones((3, 2)), table.copy)):
        for array in (motion.times, motion.positions, motion.coefficients):
            with pytest.raises(ValueError, match='read-only'):
                array[0] = 2.0


def test_coefficients_that_another_thread_has_just_stored_are_not_called():
    table = np.ones((1, 6, 1))

    class Interrupted(Motion):
        """A motion whose coefficients another thread stores after each read."""

        @property
        def _coefficients(self):
            coefficients = self.stored
            self.stored = table
            return coefficients

        @_coefficients.setter
        def _coefficients(self, coefficients):
            self.stored = coefficients

    motion = Interrupted(('a',), np.array([0.0, 1.0]), np.ones((2, 1)), table.copy)
    assert np.array_equal(motion.coefficients, table)
