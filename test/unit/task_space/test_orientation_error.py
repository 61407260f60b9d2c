"""The orientation error is the logarithm, with a smooth energy through half a turn."""

from itertools import pairwise

from hypothesis import given, settings, strategies as st
from kane_dynamics import rotation_exp
from kane_dynamics.task_space.orientation_error import (FADE, orientation_error,
                                                        pose_difference)
import numpy as np
import pytest

K = np.diag([20.0, 60.0, 100.0])
AXES = st.tuples(*3 * [st.floats(-1.0, 1.0)]).map(np.array).filter(
    lambda n: np.linalg.norm(n) > 0.1).map(lambda n: n / np.linalg.norm(n))


def energy(R):
    """Return the energy of a rotation on unequal springs, J."""
    phi = orientation_error(R).vector
    return 0.5 * phi @ K @ phi


def gradient(R, h=1e-4):
    """Return the gradient of the energy along rotations about the fixed axes."""
    steps = []
    for x in np.eye(3):
        steps.append(
            -energy(rotation_exp(2 * h * x) @ R) + 8 * energy(rotation_exp(h * x) @ R)
            - 8 * energy(rotation_exp(-h * x) @ R)
            + energy(rotation_exp(-2 * h * x) @ R))
    return np.array(steps) / (12 * h)


@settings(max_examples=60, deadline=None)
@given(AXES, st.floats(0.0, FADE))
def test_up_to_the_fading_the_error_is_the_logarithm(n, angle):
    error = orientation_error(rotation_exp(angle * n))
    np.testing.assert_allclose(error.vector, angle * n, atol=1e-13)


@settings(max_examples=100, deadline=None)
@given(AXES,
       st.one_of(st.floats(0.0, np.pi),
                 st.sampled_from([0.0, 1e-9, 0.039, 0.041, FADE, np.pi - 1e-7, np.pi])))
def test_the_moment_is_the_gradient_of_the_energy_at_every_angle(n, angle):
    R = rotation_exp(angle * n)
    error = orientation_error(R)
    np.testing.assert_allclose(error.moment(K @ error.vector), gradient(R), atol=3e-6)


@settings(max_examples=60, deadline=None)
@given(AXES, st.floats(0.0, 3.1), AXES)
def test_the_rate_is_that_of_the_error(n, angle, w):
    R = rotation_exp(angle * n)
    h = 1e-5
    ahead, behind = (orientation_error(rotation_exp(s * h * w) @ R).vector
                     for s in (1, -1))
    np.testing.assert_allclose(orientation_error(R).rate(w), (ahead - behind) / (2 * h),
                               atol=1e-8)


@pytest.mark.parametrize('n',
                         [np.eye(3)[k] for k in range(3)] + [np.array([0.6, 0.0, 0.8])])
def test_through_half_a_turn_the_moment_does_not_jump_and_vanishes_about_the_axis(n):
    angles = np.pi + np.linspace(-1e-6, 1e-6, 5)
    moments = []
    for angle in angles:
        error = orientation_error(rotation_exp(angle * n))
        moments.append(error.moment(K @ error.vector))
    assert np.ptp(moments, axis=0).max() < 0.02  # of moments up to 300 N m
    assert abs(moments[2] @ n) < 1e-9


def test_the_difference_of_poses_is_displacement_and_rotation_from_the_target_in_axes():
    turn, at_target = rotation_exp([0.3, -0.2, 0.1]), rotation_exp([0.5, 0.4, -0.6])
    axes = rotation_exp([-0.2, 0.7, 0.3])
    pose, target = np.eye(4), np.eye(4)
    pose[:3, :3], target[:3, :3] = axes @ turn @ axes.T @ at_target, at_target
    displacement = np.array([0.1, -0.2, 0.4])
    target[:3, 3] = [1.0, 2.0, -3.0]
    pose[:3, 3] = target[:3, 3] + axes @ displacement
    moved, error = pose_difference(pose, target, axes)
    np.testing.assert_allclose(moved, displacement, atol=1e-14)
    np.testing.assert_allclose(error.vector, [0.3, -0.2, 0.1], atol=1e-14)


@pytest.mark.slow
def test_a_closed_motion_neither_gains_nor_loses_energy():
    """The spring -K phi, which is no gradient, would leak joules here."""
    def path(s):
        return rotation_exp([2.5 * np.sin(s), 1.5 * np.cos(s), 1.0]) @ rotation_exp(
            [0.0, 0.8 * np.sin(2 * s), 0.0])
    s = np.linspace(0.0, 2.0 * np.pi, 4001)
    work = naive = 0.0
    for a, b in pairwise(s):
        R = path(0.5 * (a + b))
        error = orientation_error(R)
        w = orientation_error(path(b) @ path(a).T).vector
        work += error.moment(K @ error.vector) @ w
        naive += K @ error.vector @ w
    assert abs(work) < 1e-4 and abs(naive) > 1.0
