"""Splines of degree five and seven: points, rest, continuity, derivatives."""

from kane_dynamics import InputError, Motion, SmoothMotion
import numpy as np
from numpy.testing import assert_allclose
import pytest

NAMES = ('a', 'b')
TIMES = np.array([0.3, 1.0, 1.4, 2.5, 3.1])
POINTS = np.random.default_rng(2).normal(size=(5, 2))


@pytest.mark.parametrize('degree', [5, 7])
@pytest.mark.parametrize('count', [2, 3, 5])
def test_it_passes_the_points_and_rests_at_both_ends(degree, count):
    motion = SmoothMotion.from_points(TIMES[:count], POINTS[:count], joint_names=NAMES,
                                      degree=degree)
    assert motion.degree == degree and motion.duration == TIMES[count - 1]
    states = motion.sample(TIMES[:count])
    assert_allclose(states.q, POINTS[:count], rtol=0, atol=1e-12)
    for order in range(1, (degree + 1) // 2 + 1):
        size = np.abs(
            motion.sample(np.linspace(*TIMES[[0, count - 1]], 99))[order]).max()
        assert_allclose(states[order][[0, -1]], 0.0, atol=1e-10 * size)
    at_start = motion.sample(0.0)
    at_end = motion.sample(99.0)
    assert_allclose(at_start.q, POINTS[0], atol=1e-15)
    assert_allclose(at_end.q, POINTS[count - 1], atol=1e-12)
    assert not np.any(at_start[1:]) and not np.any(at_end[1:])


@pytest.mark.parametrize('degree', [5, 7])
def test_derivatives_to_the_degree_less_one_are_continuous(degree):
    motion = SmoothMotion.from_points(TIMES, POINTS, joint_names=NAMES, degree=degree)
    inner = motion.times[1:-1]
    for order in range(5):
        left, right = (motion.sample(inner + d)[order] for d in (-1e-9, 1e-9))
        size = np.abs(motion.sample(np.linspace(0.3, 3.1, 99))[order]).max()
        assert_allclose(left, right, rtol=0, atol=1e-6 * size)


def test_each_derivative_is_that_of_the_one_before():
    motion = SmoothMotion.from_points(TIMES, POINTS, joint_names=NAMES)
    t = np.linspace(0.4, 3.0, 40)
    h = 1e-5
    for order in range(4):
        difference = (motion.sample(t + h)[order] - motion.sample(t - h)[order]) / (
            2 * h)
        expected = motion.sample(t)[order + 1]
        assert_allclose(difference, expected, rtol=0, atol=1e-5 * np.abs(expected).max())
    one = motion.sample(1.7)
    assert one.q.shape == (2,) and one.snap.shape == (2,)
    assert_allclose(motion.sample([1.7]).jerk[0], one.jerk)


def test_a_polynomial_with_these_ends_is_reproduced():
    """Of degree seven, three zero derivatives at both ends: the least order."""
    t = np.linspace(0.0, 1.0, 9)
    smooth = 35 * t**4 - 84 * t**5 + 70 * t**6 - 20 * t**7
    motion = SmoothMotion.from_points(t, smooth[:, None], joint_names=['a'], degree=5)
    x = np.linspace(0.0, 1.0, 101)
    assert np.abs(motion.sample(x).q[:, 0]
                  - (35 * x**4 - 84 * x**5 + 70 * x**6 - 20 * x**7)).max() < 2e-4


def test_a_thousand_points_and_long_times_are_accurate():
    t = 100.0 + np.linspace(0.0, 1e3, 1000)
    q = np.sin(0.05 * t)[:, None]
    motion = SmoothMotion.from_points(t, q, joint_names=['a'])
    assert_allclose(motion.sample(t).q, q, rtol=0, atol=1e-10)
    middle = np.linspace(300.0, 900.0, 77)
    assert_allclose(motion.sample(middle).snap[:, 0], 0.05**4 * np.sin(0.05 * middle),
                    rtol=0, atol=1e-3 * 0.05**4)


def test_motions_whose_jerk_jumps_are_refused():
    spline = Motion.from_points(TIMES, POINTS, joint_names=NAMES)
    with pytest.raises(InputError, match=r'the jerk of joint|the acceleration of joint'):
        SmoothMotion.from_motion(spline)
    quintic = Motion.from_points([0.0, 1.0], [[0.0], [1.0]], [[0.0], [0.0]],
                                 [[0.0], [0.0]], joint_names=['a'])
    with pytest.raises(InputError, match="the jerk of joint 'a' jumps by 60 at point"):
        SmoothMotion.from_motion(quintic)
    still = Motion.from_points([0.0, 1.0], [[0.5], [0.5]], joint_names=['a'])
    assert_allclose(SmoothMotion.from_motion(still).sample(0.4).q, 0.5)


@pytest.mark.parametrize('change, message', [
    ({'degree': 6}, 'degree: 6; expected 5 or 7'),
    ({'times': [0.0]}, 'positions'),
    ({'times': [0.0, 0.0]}, 'point 1: time 0.0'),
    ({'positions': [[0.0], [np.nan]]}, 'nan'),
    ({'joint_names': ['a', 'b']}, 'expected'),
    ({'times': [0.0, 1e-300], 'positions': [[0.0], [1e300]]}, 'overflow'),
])
def test_bad_arguments_are_named(change, message):
    arguments = {'times': [0.0, 1.0], 'positions': [[0.0], [1.0]], 'joint_names': ['a']}
    with pytest.raises(InputError, match=message):
        SmoothMotion.from_points(**{**arguments, **change})
    motion = SmoothMotion.from_points(**arguments)
    with pytest.raises(InputError, match='expected finite times'):
        motion.sample(np.nan)


def test_a_scaled_motion_has_the_derivatives_of_the_faster_one():
    motion = SmoothMotion.from_points([1.0, 2.0, 4.0], [[0.0], [1.0], [-0.5]],
                                      joint_names=['a'])
    t = np.linspace(1.0, 4.0, 13)
    expected = motion.sample(t)
    for factor in (1e-6, 0.5, 3.0, 1e6):
        for order, values in enumerate(motion.scaled(factor).sample(t / factor)):
            size = factor**order * np.abs(expected[order]).max()
            assert_allclose(values, factor**order * expected[order], rtol=0,
                            atol=1e-9 * size)
    for factor in (0.0, -1.0, np.nan, np.inf, 1e-300, 1e300, True):
        with pytest.raises(InputError, match=r'speed: .*; expected a number from 1e-06'):
            motion.scaled(factor)


def test_a_motion_between_two_points_is_refused_for_what_jumps():
    # Speeds vanish at both points but for rounding, which is no jump.
    motion = Motion.from_points([0.0, 0.6], [[0.1, -0.2], [0.9, 0.5]],
                                joint_names=['a', 'b'])
    with pytest.raises(InputError, match="acceleration of joint 'a' jumps by 13"):
        SmoothMotion.from_motion(motion)
