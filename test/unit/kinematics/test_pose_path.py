"""Paths of poses: geodesics, circles, blends within deviation, frame limits."""

from itertools import pairwise

from kane_dynamics import (InputError, pose_error, pose_from, PoseLimits, PoseMotion,
                           PosePath)
import numpy as np
from numpy.testing import assert_allclose
import pytest
from scipy.spatial.transform import Rotation, Slerp

POSES = np.array(
    [pose_from((0.0, 0.0, 0.0)), pose_from((0.3, 0.0, 0.0), rpy=(0.3, 0.0, 0.0)),
     pose_from((0.3, 0.3, 0.0), rpy=(0.3, 1.0, 0.0)),
     pose_from((0.3, 0.3, 0.0), rpy=(0.0, 0.0, 1.5)), pose_from((0.0, 0.3, 0.1))])
LIMITS = PoseLimits((0.5, 2.0, 20.0), (2.0, 8.0, 80.0))


def norms(rows):
    """Return the norms of the linear and of the angular part, (2, N)."""
    return np.linalg.norm(rows.reshape(len(rows), 2, 3), axis=2).T


def test_between_two_poses_the_orientation_is_slerps_and_the_origin_on_the_chord():
    for start, end in pairwise(POSES):
        path = PosePath.through([start, end])
        share = np.linspace(0.0, 1.0, 21)
        poses = path.poses(share * path.length)
        slerp = Slerp([0.0, 1.0], Rotation.from_matrix([start[:3, :3], end[:3, :3]]))
        assert_allclose(poses[:, :3, :3], slerp(share).as_matrix(), atol=1e-14)
        chord = start[:3, 3] + share[:, None] * (end - start)[:3, 3]
        assert_allclose(poses[:, :3, 3], chord, atol=1e-15)


@pytest.mark.parametrize('path', [
    PosePath.through(POSES), PosePath.through(POSES, blend=0.02, blend_angle=0.2),
    PosePath.circle(POSES[0], (0.1, 0.2, 0.3), (1.0, 1.0, 1.0), turning=True),
    PosePath.joined([PosePath.arc(POSES[0], (0.1, 0.1, 0.0), POSES[1]),
                     PosePath.through(POSES[1:])], blend=0.02, blend_angle=0.2)])
def test_derivatives_are_those_of_the_poses_and_of_each_other(path):
    h = 1e-5
    s = np.linspace(2 * h, path.length - 2 * h, 300)
    # Away from the ends of the sections, where a derivative may jump.
    s = s[np.abs(s[:, None] - path._starts).min(axis=1) > 2 * h]
    first, second, third = path.derivatives(s)
    pose_after = path.poses(s + h)
    pose_before = path.poses(s - h)
    assert_allclose(pose_error(pose_before, pose_after) / (2 * h), first, atol=1e-7)
    for derivative, rate in ((0, second), (1, third)):
        difference = path.derivatives(s + h)[derivative] - path.derivatives(
            s - h)[derivative]
        assert_allclose(difference / (2 * h), rate, atol=1e-5 * (1 + np.abs(rate).max()))


def test_a_blend_passes_its_corner_at_the_stated_distance_and_joins_smoothly():
    corner = np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0], [0.4, 0.4, 0.0]])
    path = PosePath.through(corner, blend=0.02)
    (place, distance, angle, rests), = path.corners
    assert (place, angle, rests) == (0.5, 0.0, False)
    assert distance == pytest.approx(0.02, rel=1e-9)
    positions = path.poses(np.linspace(0.0, path.length, 20001))[:, :3, 3]
    # The distance from the corner is that stated; from the two lines it is smaller.
    assert np.linalg.norm(positions - corner[1], axis=1).min() == pytest.approx(
        0.02, rel=1e-6)
    from_lines = np.minimum(np.abs(positions[:, 1]), np.abs(positions[:, 0] - 0.4))
    assert from_lines.max() < 0.02
    # The half length of the blend is 32/5 of the deviation per difference of the
    # tangents.
    half = 32.0 / 5.0 * 0.02 / np.sqrt(2.0)
    assert path._starts[1] == pytest.approx(0.4 - half, rel=1e-6)
    for s in path._starts[1:-1]:
        sides = [path.derivatives([s + h]) for h in (-1e-9, 1e-9)]
        for left, right in zip(*sides):
            assert_allclose(left, right, atol=1e-4)


def test_a_blend_keeps_within_the_smaller_of_distance_and_angle_and_of_half_the_pieces():
    angles = PosePath.through(POSES, blend=1.0, blend_angle=0.03).corners
    assert max(corner.angle for corner in angles) == pytest.approx(0.03, rel=1e-9)
    wide = PosePath.through(POSES[:, :3, 3][[0, 1, 2, 4]], blend=1.0)
    assert all(not corner.rests and corner.distance < 0.1 for corner in wide.corners)
    assert [corner.rests for corner in PosePath.through(POSES, blend=0.0).corners] == [
        True] * 3
    # Points on one line are no corners.
    line = PosePath.through([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.4, 0.0, 0.0]])
    assert line.corners[0][1:] == (0.0, 0.0, False)
    assert PoseMotion(line, LIMITS).duration == pytest.approx(
        0.4 / 0.5 + 0.5 / 2 + 2 / 20)


def test_arcs_and_circles_are_those_of_their_closed_forms():
    arc = PosePath.arc(POSES[0], (0.15, 0.15, 0.0), pose_from((0.3, 0.0, 0.0)))
    assert arc.length == pytest.approx(np.pi * 0.15)
    positions = arc.poses(np.linspace(0.0, arc.length, 101))[:, :3, 3]
    angle = np.pi * np.linspace(0.0, 1.0, 101)
    circle = np.stack([0.15 - 0.15 * np.cos(angle), 0.15 * np.sin(angle), 0 * angle],
                      axis=1)
    assert_allclose(positions, circle, atol=1e-15)
    # More than half a circle, because `via` is on the longer arc.
    long = PosePath.arc((0.0, 0.0, 0.0), (0.2, 0.0, 0.0), (0.1, 0.1, 0.0))
    assert long.length == pytest.approx(1.5 * np.pi * 0.1)
    assert_allclose(long.poses([long.length / 1.5])[0, :3, 3], (0.2, 0.0, 0.0),
                    atol=1e-15)
    # A screw-free circle whose orientation turns with it returns to its start.
    turning = PosePath.circle(POSES[2], (0.0, 0.1, 0.0), (0.0, 0.0, 2.0), turning=True)
    assert_allclose(turning.poses([turning.length])[0], POSES[2], atol=1e-14)
    quarter = turning.poses([turning.length / 4])[0]
    turn = pose_from(rpy=(0.0, 0.0, np.pi / 2))[:3, :3]
    assert_allclose(quarter[:3, :3], turn @ POSES[2][:3, :3], atol=1e-14)
    offset = POSES[2][:3, 3] - (0.0, 0.1, 0.0)
    assert_allclose(quarter[:3, 3], turn @ offset + (0.0, 0.1, 0.0), atol=1e-14)


@pytest.mark.parametrize('path', [
    PosePath.through(POSES), PosePath.through(POSES, blend=0.01, blend_angle=0.2),
    PosePath.through(POSES, blend=0.2, blend_angle=1.0), PosePath.circle(
        POSES[0], (0.0, 0.1, 0.0), (0.0, 0.0, 1.0), 4.0 * np.pi, turning=True),
    PosePath.joined([PosePath.through([pose_from((-0.3, 0.0, 0.0)), POSES[0]]),
                     PosePath.circle(POSES[0], (0.0, 0.1, 0.0), (0.0, 0.0, 1.0)),
                     PosePath.through(POSES[:2])], blend=0.003)])
def test_speed_acceleration_and_jerk_are_within_their_limits_and_reach_one(path):
    motion = PoseMotion(path, LIMITS)
    t = np.linspace(0.0, motion.duration, 20001)
    states = motion.sample(t)
    bounds = np.array([LIMITS.linear, LIMITS.angular])
    uses = [norms(states.twist), norms(states.acceleration),
            norms(np.diff(states.acceleration, axis=0) / t[1])]
    largest = np.array([use.max(axis=1) for use in uses]).T
    assert (largest <= bounds * (1.0 + 1e-6)).all()
    assert (largest / bounds).max() > 0.6
    # Twist and acceleration are those of the poses.
    inner = slice(1, -1)
    slope = pose_error(states.pose[:-2], states.pose[2:]) / (2 * t[1])
    assert_allclose(slope, states.twist[inner], atol=1e-5)
    rate = (states.twist[2:] - states.twist[:-2]) / (2 * t[1])
    assert_allclose(rate, states.acceleration[inner], atol=0.05)
    assert not states.twist[[0, -1]].any() and not states.acceleration[[0, -1]].any()


def test_a_motion_has_the_stated_duration_and_rests_outside_it():
    motion = PoseMotion(PosePath.through(POSES[:2]), duration=2.0)
    assert motion.duration == 2.0
    middle = motion.sample(1.0)
    assert_allclose(middle.pose[:3, 3], (0.15, 0.0, 0.0), atol=1e-12)
    for t, pose in ((-1.0, POSES[0]), (5.0, POSES[1])):
        state = motion.sample(t)
        assert_allclose(state.pose, pose, atol=1e-12)
        assert not state.twist.any() and not state.acceleration.any()


@pytest.mark.parametrize(('make', 'message'), [
    (lambda: PosePath.through([POSES[0]] * 2), r'poses 0 and 1: equal; expected'),
    (lambda: PosePath.through([POSES[0], pose_from((1, 0, 0), rpy=(np.pi, 0, 0))]),
     r'poses 0 and 1: half a turn apart; expected'),
    (lambda: PosePath.through(np.zeros((2, 4))), r'poses: shape \(2, 4\); expected'),
    (lambda: PosePath.through([[0, 0, 0], [1, np.nan, 0]]),
     r'position 1: .*nan.*; expected'),
    (lambda: PosePath.through(POSES).poses([np.nan]), r's: \[nan\]; expected'),
    (lambda: PosePath.through('line'),
     r'poses: of several shapes, or not of numbers; expected'),
    (lambda: PosePath.through(POSES[:1]), r'poses: one; expected two or more'),
    (lambda: PosePath.arc((0, 0, 0), (1, np.nan, 0), (2, 0, 0)),
     r"via of coordinate 'y': nan"),
    (lambda: PosePath.through(POSES, blend=-1.0), r'blend: -1.0; expected'),
    (lambda: PosePath.through(POSES, blend_angle=np.inf), r'blend_angle: inf; expected'),
    (lambda: PosePath.arc((0, 0, 0), (1, 0, 0), (2, 0, 0)), r'via: .* on a line'),
    (lambda: PosePath.circle((0, 0, 0), (0, 0, 1), (0, 0, 1)), r'start: .* on the axis'),
    (lambda: PosePath.circle((0, 0, 0), (0, 1, 1), (0, 0, 0)), r'axis: .*; expected'),
    (lambda: PosePath.circle((0, 0, 0), (0, 1, 1), (0, 0, 1), 0.0),
     r'angle: 0.0; expected'),
    (lambda: PosePath.joined([]), r'paths: \[\]; expected'),
    (lambda: PosePath.joined([PosePath.through(POSES[:2]), PosePath.through(POSES[2:])]),
     r'path 1 begins 0.3 m and'),
    (lambda: PosePath.joined([PosePath.through(POSES[:2]),
                              PosePath.through(POSES[:2, :3, 3])]),
     r'paths: of poses and of'),
    (lambda: PoseLimits((1.0, 2.0)), r'linear: .*; expected speed, acceleration, jerk'),
    (lambda: PoseLimits((1.0, 2.0, 3.0), (0.0, 1.0, 1.0)), r'angular: .*; expected'),
    (lambda: PoseMotion(PosePath.through(POSES)),
     r'limits and duration: neither is given'),
    (lambda: PoseMotion(PosePath.through(POSES), PoseLimits((1, 2, 3))),
     r'limits: no angular ones'),
    (lambda: PoseMotion(POSES, LIMITS), r'path: a ndarray; expected a PosePath'),
    (lambda: PoseMotion(PosePath.through(POSES), duration=0.0),
     r'duration: 0.0; expected'),
    (lambda: PoseMotion(PosePath.through(POSES), duration=1.0).sample(np.nan),
     r't: nan')])
def test_invalid_arguments_are_named(make, message):
    with pytest.raises(InputError, match=message):
        make()
