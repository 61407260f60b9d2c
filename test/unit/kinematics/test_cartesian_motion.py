"""Motions of joints along paths of poses: the frame stays on the path throughout."""

from pathlib import Path

from kane_dynamics import (absolute_rates, cartesian_motion, InputError,
                           load_constraints, load_urdf, pose_error, pose_from,
                           PoseLimits, PoseMotion, PosePath, Robot)
from kane_dynamics.feasibility import time_optimal
import numpy as np
from numpy.testing import assert_allclose
import pinocchio
import pytest

URDFS = Path(__file__).resolve().parents[3] / 'urdf'
HOME = np.array([0.0, -1.2, 1.4, -1.77, -1.57, 0.0])
READY = np.array([0.0, -0.8, 0.0, -2.3, 0.0, 1.6, 0.8])
LIMITS = PoseLimits((0.5, 2.0, 20.0), (2.0, 8.0, 80.0))


@pytest.fixture(scope='module')
def robot():
    return Robot(load_urdf(URDFS / 'ur10e.urdf'))


@pytest.fixture(scope='module')
def fr3():
    return Robot(load_urdf(URDFS / 'fr3.urdf', tip='fr3_link8'))


@pytest.fixture(scope='module')
def palletizer():
    return Robot(load_urdf(URDFS / 'palletizer.urdf'),
                 **load_constraints(URDFS / 'palletizer.constraints.yaml'))


def corners(start):
    """Return four poses in a row, from that of a start."""
    turned = [pose_from((0.0, 0.2, 0.0), rpy=(0.2, 0.0, 0.0)),
              pose_from((0.1, 0.2, -0.1), rpy=(0.2, 0.3, 0.0)),
              pose_from((0.1, 0.0, 0.0), rpy=(0.0, 0.0, 0.2))]
    poses = [start]
    for change in turned:
        pose = start.copy()
        pose[:3, :3] = change[:3, :3] @ start[:3, :3]
        pose[:3, 3] += change[:3, 3]
        poses.append(pose)
    return poses


def random_times(motion, count=400):
    return np.random.default_rng(0).uniform(0.0, motion.duration, count)


@pytest.mark.parametrize('kind', ['line', 'position', 'corners', 'blended', 'circle'])
def test_the_frame_is_on_the_path_between_the_points_by_pinocchio_too(robot, kind):
    start = robot.frame_pose('tool0', HOME)
    path = {'line': lambda: PosePath.through(corners(start)[:2]),
            'position': lambda: PosePath.through([pose[:3, 3]
                                                  for pose in corners(start)[:2]]),
            'corners': lambda: PosePath.through(corners(start)),
            'blended': lambda: PosePath.through(corners(start),
                                                blend=0.02, blend_angle=0.1),
            'circle': lambda: PosePath.circle(start, start[:3, 3] + [0.0, 0.1, 0.0],
                                              (0.0, 0.3, 1.0))}[kind]()
    result = cartesian_motion(robot, 'tool0', HOME, path, LIMITS, tolerance=1e-6)
    t = random_times(result.motion)
    q, u, udot = result.motion.sample(t)
    desired = result.desired.sample(t)
    model = pinocchio.buildModelFromUrdf(str(URDFS / 'ur10e.urdf'))
    data = model.createData()
    frame = model.getFrameId('tool0')
    rows = slice(0, 6 if path.oriented else 3)
    for k in range(len(t)):
        pinocchio.forwardKinematics(model, data, q[k], u[k], udot[k])
        pinocchio.updateFramePlacement(model, data, frame)
        placement = data.oMf[frame].homogeneous
        assert np.abs(pose_error(placement, desired.pose[k])[rows]).max() < 1e-6
        axes = pinocchio.LOCAL_WORLD_ALIGNED
        twist = pinocchio.getFrameVelocity(model, data, frame, axes).vector
        rate = pinocchio.getFrameClassicalAcceleration(model, data, frame, axes).vector
        assert_allclose(twist[rows], desired.twist[k][rows], atol=1e-4)
        assert_allclose(rate[rows], desired.acceleration[k][rows], atol=5e-3)
    assert result.distance < 1e-6 and result.angle < 1e-6
    assert 0.0 < result.largest_speed < 1.0 and result.smallest_singular_value > 0.1
    assert result.motion.joint_names == robot.joint_names


def test_a_redundant_arm_moves_with_the_smallest_norm_of_speeds(fr3):
    target = fr3.frame_pose('fr3_link8', READY)
    target[:3, 3] += [0.1, 0.3, 0.1]
    result = cartesian_motion(fr3, 'fr3_link8', READY, target, LIMITS)
    t = random_times(result.motion)
    q, u, _ = result.motion.sample(t)
    inverse = np.linalg.pinv(fr3.jacobian('fr3_link8', q))
    least = np.einsum('kij,kj->ki', inverse, result.desired.sample(t).twist)
    assert_allclose(u, least, atol=1e-4)


def test_a_closed_loop_moves_by_its_driving_joints_and_stays_on_the_path(palletizer):
    q = palletizer.feasible_configuration()
    target = palletizer.frame_pose('tool', q)
    target[:3, 3] += [0.05, 0.0, -0.1]
    result = cartesian_motion(palletizer, 'tool', q, target, duration=1.0)
    assert result.motion.joint_names == palletizer.speed_names
    t = random_times(result.motion, 20)
    for q_driving, pose in zip(result.motion.positions_at(t),
                               result.desired.sample(t).pose):
        guess = q.copy()
        places = [palletizer.coordinate_names.index(name)
                  for name in palletizer.speed_names]
        guess[places] = q_driving
        closed = palletizer.closed_configuration(guess, fixed=palletizer.speed_names)
        error = pose_error(palletizer.frame_pose('tool', closed), pose)
        assert np.abs(error).max() < 1e-5


def test_chosen_speeds_of_a_tree_give_the_same_motion(robot):
    other_robot = Robot(load_urdf(URDFS / 'ur10e.urdf'), speeds=absolute_rates)
    start = robot.frame_pose('tool0', HOME)
    target = corners(start)[1]
    motions = [cartesian_motion(one_robot, 'tool0', HOME, target, LIMITS).motion
               for one_robot in (robot, other_robot)]
    t = random_times(motions[0], 50)
    for one, counterpart in zip(motions[0].sample(t), motions[1].sample(t)):
        assert_allclose(one, counterpart, atol=1e-6)


def test_time_optimal_keeps_to_the_path_and_uses_a_limit(robot):
    start = robot.frame_pose('tool0', HOME)
    path = PosePath.through(corners(start), blend=0.02, blend_angle=0.1)
    slow = cartesian_motion(robot, 'tool0', HOME, path, LIMITS, tolerance=1e-6)
    timing = time_optimal(robot, slow.motion)
    assert timing.duration < 0.5 * slow.motion.duration
    largest = max(use.max() for use in timing.uses.values())
    assert 0.99 < largest <= 1.0 + 1e-3
    # Each pose of the fast motion is next to one of the path.
    poses = robot.frame_pose('tool0',
                             timing.motion.positions_at(random_times(timing.motion, 60)))
    on_path = path.poses(np.linspace(0.0, path.length, 20001))
    for pose in poses:
        distance = np.linalg.norm(on_path[:, :3, 3] - pose[:3, 3], axis=1)
        nearest = on_path[int(distance.argmin())]
        # Of the samples of the path.
        assert np.abs(pose_error(pose, nearest)).max() < 2e-4


def test_reach_and_limits_and_singular_configurations_are_named_before_a_motion(
        robot, palletizer):
    start = robot.frame_pose('tool0', HOME)
    far = start.copy()
    far[0, 3] += 1.0
    with pytest.raises(InputError,
                       match=r"'tool0' does not reach at 3\S* % of the time, position "
                       r'\[1.21.* next to a singular .*; expected a path'):
        cartesian_motion(robot, 'tool0', HOME, far, LIMITS)

    wrist = HOME.copy()
    wrist[4] = -0.05
    target = robot.frame_pose('tool0', wrist)
    target[:3, 3] += [0.0, 0.3, 0.0]
    with pytest.raises(InputError,
                       match=r"joint 'wrist_1_joint': .* rad/s or m/s at .* next to a "
                       r'singular .* wrist_1_joint, wrist_3_joint move without '
                       r'the frame, which cannot move along .* velocity limit '
                       r'3.142'):
        cartesian_motion(robot, 'tool0', wrist, target, LIMITS)
    # Slowly enough it is feasible, and the result names the place.
    slow = cartesian_motion(robot, 'tool0', wrist, target, duration=10.0)
    assert slow.smallest_singular_value < 0.03 and slow.nearest_singular == 0.0

    q = palletizer.feasible_configuration()
    target = palletizer.frame_pose('tool', q)[:3, 3] + [3.0, 0.2, 0.0]
    with pytest.raises(InputError, match=r"joint 'lever_drive' at its lower limit -0.3"):
        cartesian_motion(palletizer, 'tool', q, target, duration=1.0)


def test_a_path_through_a_singular_configuration_is_refused_and_along_it_is_followed(
        robot):
    # The wrist passes q5 = 0 with a motion that the frame lost there.
    wrist = HOME.copy()
    wrist[4] = 0.3
    states = []
    for angle in (0.3, -0.3):
        q = wrist.copy()
        q[4] = angle
        states.append(robot.frame_pose('tool0', q))
    with pytest.raises(InputError, match='next to a singular configuration'):
        cartesian_motion(robot, 'tool0', wrist, states[1], duration=4.0)
    # At q5 = 0 the first joint alone turns the frame about its axis: nothing is lost.
    aligned = HOME.copy()
    aligned[4] = 0.0
    base = robot.frame_pose('tool0', aligned)
    circle = PosePath.circle(base, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.5, turning=True)
    result = cartesian_motion(robot, 'tool0', aligned, circle, duration=2.0)
    assert result.smallest_singular_value < 1.0
    error = pose_error(robot.frame_pose('tool0', result.motion.positions[-1]),
                       circle.poses([circle.length])[0])
    assert np.abs(error).max() < 1e-8


@pytest.mark.parametrize(('change', 'message'), [
    ({'q': [HOME, HOME]}, r'q: shape \(2, 6\); expected \(6,\)'),
    ({'q': HOME + [0, 0, 5, 0, 0, 0]},
     r"q: joint 'elbow_joint': position 6.4; expected within"),
    ({'path': 'line'}, r'path: a str of shape'),
    ({'path': np.eye(3)}, r'path: a ndarray of shape \(3, 3\); expected'),
    ({'path': np.zeros(3), 'duration': None}, r'limits and duration'),
    ({'path': PosePath.through([[0, 0, 0], [1, 0, 0]])},
     r"q: 'tool0' is .* from the start"),
    ({'path': PoseMotion(PosePath.through([[0, 0, 0], [1, 0, 0]]), duration=1.0)},
     r'limits and duration: given for a PoseMotion'),
    ({'duration': 0.0}, r'duration: 0.0; expected'),
    ({'tolerance': -1.0}, r'tolerance: -1.0'),
    ({'tolerance': 1e-12}, r'tolerance: 1e-12; expected a number from 1e-09'),
    ({'frame': 'base_link'}, r"frame: 'base_link', which does not move"),
    ({'frame': 'tool9'}, r"frame 'tool9'|'tool9'")])
def test_invalid_arguments_are_named(robot, change, message):
    target = robot.frame_pose('tool0', HOME)
    target[1, 3] += 0.1
    arguments = {'frame': 'tool0', 'q': HOME, 'path': target, 'duration': 1.0, **change}
    frame = arguments.pop('frame')
    q = arguments.pop('q')
    path = arguments.pop('path')
    with pytest.raises(Exception, match=message) as caught:
        cartesian_motion(robot, frame, q, path, **arguments)
    assert type(caught.value).__name__ in ('InputError', 'ModelError')


def test_a_closed_loop_with_other_speeds_than_joint_rates_is_refused_by_its_speeds():
    choices = load_constraints(URDFS / 'palletizer.constraints.yaml')
    choices.pop('independent', None)
    machine = Robot(load_urdf(URDFS / 'palletizer.urdf'), **choices,
                    speeds=absolute_rates)
    q = machine.feasible_configuration()
    with pytest.raises(InputError,
                       match=r"robot: constraints with the speeds \['.*; expected"):
        cartesian_motion(machine, 'tool', q, machine.frame_pose('tool', q), duration=1.0)


def test_an_arm_with_beams_is_refused():
    arm = Robot(load_urdf(URDFS / 'two_link.urdf',
                          supplement=URDFS / 'two_link.bending.yaml'))
    with pytest.raises(InputError, match='robot: with beams; expected a rigid robot'):
        cartesian_motion(arm, arm.frame_names[-1], np.zeros(arm.n_q), np.eye(4),
                         duration=1.0)
