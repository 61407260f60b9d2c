"""Straight lines in task space: the frame stays on the line, and the torques follow from them."""

from pathlib import Path

from kane_dynamics import (absolute_rates, InputError, load_constraints, load_urdf, pose_error,
                           pose_from, Robot, straight_line)
import numpy as np
import pytest

URDFS = Path(__file__).resolve().parents[3] / 'urdf'
HOME = np.array([0.0, -1.2, 1.4, -1.77, -1.57, 0.0])


@pytest.fixture(scope='module')
def robot():
    return Robot(load_urdf(URDFS / 'ur10e.urdf'))


def test_the_frame_moves_on_the_line_turns_about_one_axis_and_rests_at_both_ends(robot):
    start = robot.frame_pose('tool0', HOME)
    target = pose_from((0.1, 0.3, -0.05), rpy=(0.0, 0.3, 0.2)) @ start
    target[:3, 3] = start[:3, 3] + [0.1, 0.3, -0.05]
    line = straight_line(robot, 'tool0', HOME, target, 2.0)
    assert line.joint_names == robot.joint_names and line.duration == 2.0
    q, u, _ = line.sample(np.linspace(0.0, 2.0, 301))
    poses = robot.frame_pose('tool0', q)
    along = target[:3, 3] - start[:3, 3]
    unit = along / np.linalg.norm(along)
    offset = poses[:, :3, 3] - start[:3, 3]
    across = offset - np.outer(offset @ unit, unit)
    assert np.linalg.norm(across, axis=1).max() < 1e-4
    assert (np.diff(offset @ unit) > -1e-9).all()
    assert np.abs(pose_error(poses[-1], target)).max() < 1e-6
    turns = np.array([pose_error(start, pose)[3:] for pose in poses[30:]])
    axis = turns[-1] / np.linalg.norm(turns[-1])
    assert np.linalg.norm(turns - np.outer(turns @ axis, axis), axis=1).max() < 1e-4
    assert np.abs(u[[0, -1]]).max() < 1e-9
    # Halfway in time is halfway on the line.
    middle = robot.frame_pose('tool0', line.sample(np.array([1.0]))[0])[0]
    np.testing.assert_allclose(middle[:3, 3], start[:3, 3] + 0.5 * along, atol=1e-5)


def test_a_closed_loop_moves_by_its_driving_joints():
    robot = Robot(load_urdf(URDFS / 'palletizer.urdf'),
                  **load_constraints(URDFS / 'palletizer.constraints.yaml'))
    q = robot.feasible_configuration()
    frame = 'tool'
    target = robot.frame_pose(frame, q)
    target[:3, 3] += [0.0, 0.0, -0.1]
    line = straight_line(robot, frame, q, target, 1.0)
    assert line.joint_names == robot.speed_names


def test_what_cannot_be_reached_is_named_with_its_share_of_the_line(robot):
    far = robot.frame_pose('tool0', HOME)
    far[:3, 3] += [3.0, 0.0, 0.0]
    with pytest.raises(InputError, match=r"'tool0' does not reach .* % of the line"):
        straight_line(robot, 'tool0', HOME, far, 2.0)
    with pytest.raises(InputError, match='duration: 0'):
        straight_line(robot, 'tool0', HOME, far, 0.0)
    with pytest.raises(InputError, match='points: 3; expected'):
        straight_line(robot, 'tool0', HOME, far, 1.0, points=3)


def test_the_start_is_one_configuration_within_the_limits(robot):
    target = robot.frame_pose('tool0', HOME)
    with pytest.raises(InputError, match=r'q: shape \(2, 6\); expected \(6,\)'):
        straight_line(robot, 'tool0', [HOME, HOME], target, 2.0)
    beyond = HOME + [0.0, 0.0, 5.0, 0.0, 0.0, 0.0]
    with pytest.raises(InputError, match=r"q: joint 'elbow_joint': position 6.4; expected "
                                         r'within its limits -3.14159 to 3.14159'):
        straight_line(robot, 'tool0', beyond, target, 2.0)


def test_a_closed_loop_with_other_speeds_than_joint_rates_is_refused_by_its_speeds():
    choices = load_constraints(URDFS / 'palletizer.constraints.yaml')
    choices.pop('independent', None)
    machine = Robot(load_urdf(URDFS / 'palletizer.urdf'), **choices, speeds=absolute_rates)
    q = machine.feasible_configuration()
    with pytest.raises(InputError, match=r"robot: constraints with the speeds \['.*; expected"):
        straight_line(machine, 'tool', q, machine.frame_pose('tool', q), 1.0)
