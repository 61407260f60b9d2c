"""The target of the controlled frame between two messages, and what it reaches."""

import math

from kane_dynamics import load_urdf, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.kinematics.poses import pose_error, pose_from, rotation_exp
from kane_dynamics.mechanics.constraints.yaml_file import load_constraints
from mechanisms import random_rotation
import numpy as np
import pytest

pytest.importorskip('rclpy')

from kane_dynamics.ros.modes import cartesian_cycle  # noqa: E402, I100
from kane_dynamics.ros.modes.cartesian_mode import CartesianMode  # noqa: E402
from kane_dynamics.ros.modes.cartesian_target import (CartesianTarget,  # noqa: E402
                                                      pose_of_numbers)
from kane_dynamics.ros.modes.pose_functions import (displaced,  # noqa: E402
                                                    displacement)
from kane_dynamics.ros.modes.target_reach import REACHED, TargetReach  # noqa: E402
from kane_dynamics.task_space.law_kernel import lanes_of_scalars  # noqa: E402
from node_values import node_values  # noqa: E402

NANO = 10**9
BEGIN = 50 * NANO
FR3_JOINTS = [f'fr3_joint{k}' for k in range(1, 8)]
HOME = np.array([0.0, -0.4, 0.0, -2.0, 0.0, 1.7, 0.8])


def random_pose(rng):
    pose = np.eye(4)
    pose[:3, :3] = random_rotation(rng)
    pose[:3, 3] = rng.uniform(-1.0, 1.0, 3)
    return pose


class Follower:
    """The target by the messages, from a pose on."""

    def __init__(self, pose, timeout):
        self.messages = CartesianTarget(timeout)
        self.go_to, self.press = self.messages.go_to, self.messages.press
        self.memory = cartesian_cycle.beginning(pose, np.zeros(2), self.orders)

    @property
    def orders(self):
        return self.messages.orders(BEGIN, math.inf, math.inf, np.ones(4))

    @property
    def pose(self):
        return self.memory.pose

    def move(self, twist, now, turns=False):
        self.messages.move(np.asarray(twist), turns, now)

    def advance(self, now, may_move):
        """Follow the messages up to a time."""
        posed = cartesian_cycle.at_latest_pose(self.memory, self.orders)
        self.memory, self.twist = cartesian_cycle.advanced(
            posed, self.orders, float(now - BEGIN), float(may_move))


def target_at(pose, timeout=0.5):
    return Follower(pose, timeout)


def test_displacements_are_those_of_the_library():
    rng = np.random.default_rng(0)
    for angle in (0.0, 1e-9, 1e-4, 1.0, 3.0, math.pi - 1e-6, None):
        start = random_pose(rng)
        goal = random_pose(rng)
        if angle is not None:
            axis = rng.normal(size=3)
            goal[:3, :3] = rotation_exp(
                angle / np.linalg.norm(axis) * axis) @ start[:3, :3]
        step = displacement(start, goal)
        np.testing.assert_allclose(step, pose_error(start, goal), rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(displaced(start, step), goal, atol=1e-12)
        half = displaced(start, step, 0.5)
        np.testing.assert_allclose(displacement(start, half), 0.5 * step,
                                   rtol=1e-8, atol=1e-12)


def test_half_a_turn_is_finite():
    start = np.eye(4)
    for axis in np.eye(3):
        goal = pose_from(rpy=math.pi * axis)
        assert np.linalg.norm(displacement(start, goal)) == pytest.approx(math.pi)


def test_the_pose_of_a_message_is_in_its_frame():
    rng = np.random.default_rng(1)
    frame = random_pose(rng)
    position = rng.normal(size=3)
    quaternion = rng.normal(size=4)
    unit = quaternion / np.linalg.norm(quaternion)
    expected = frame @ pose_from(position, quaternion=unit)
    numbers = np.concatenate([position, quaternion])
    np.testing.assert_allclose(pose_of_numbers(numbers, frame), expected, atol=1e-12)


@pytest.mark.parametrize('rate', [5.0, 30.0, 1000.0])
def test_poses_of_a_stream_are_interpolated_with_one_period_of_delay(rate):
    """Along a straight line and about one axis, at constant speed."""
    velocity = np.array([0.1, -0.05, 0.02])
    turn = np.array([0.0, 0.3, 0.4])

    def pose_at(t):
        return displaced(np.eye(4), np.concatenate([t * velocity, t * turn]))
    target = target_at(pose_at(0.0))
    period = 1.0 / rate
    stamps = []
    errors = []
    count = max(10, round(0.5 * rate))
    for k in range(count):
        message = BEGIN + round(k * period * NANO)
        target.go_to(pose_at(k * period), message)
        for part in np.arange(0.0, 1.0, 0.25):
            now = message + round(part * period * NANO)
            target.advance(now, True)
            if k < 2:
                continue
            expected = pose_at((k - 1 + part) * period)
            errors.append(np.abs(displacement(target.pose, expected)).max())
            np.testing.assert_allclose(target.twist, [*velocity, *turn],
                                       rtol=1e-4, atol=1e-9)
            stamps.append(now)
    assert max(errors) < 1e-6
    # No further pose: the last one is held.
    target.advance(stamps[-1] + NANO, True)
    np.testing.assert_allclose(target.pose, pose_at((count - 1) * period), atol=1e-9)
    assert not target.twist.any()


def test_a_single_pose_is_the_target_at_once():
    goal = random_pose(np.random.default_rng(2))
    target = target_at(np.eye(4))
    target.go_to(goal, BEGIN)
    target.advance(BEGIN, True)
    np.testing.assert_array_equal(target.pose, goal)
    assert not target.twist.any()


def test_a_twist_moves_the_target_until_it_is_stale():
    twist = np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.5])
    target = target_at(np.eye(4), timeout=0.2)
    target.advance(BEGIN, True)
    target.move(twist, BEGIN)
    for k in range(1, 401):
        target.advance(BEGIN + k * 1_000_000, True)
        assert target.twist.any() == (k <= 200)
    expected = displaced(np.eye(4), 0.2 * twist)
    np.testing.assert_allclose(target.pose, expected, atol=1e-9)


def test_a_twist_in_the_frames_own_axes_turns_with_the_target():
    target = target_at(np.eye(4), timeout=9.0)
    target.advance(BEGIN, True)
    target.move([0.1, 0.0, 0.0, 0.0, 0.0, 1.0], BEGIN, turns=True)
    steps = 4000
    for k in range(1, steps + 1):  # once around a circle
        target.advance(BEGIN + round(k * 2.0 * math.pi / steps * NANO), True)
    np.testing.assert_allclose(target.pose, np.eye(4), atol=2e-3)


def test_a_target_that_may_not_move_is_held():
    target = target_at(np.eye(4))
    target.advance(BEGIN, True)
    target.move(np.ones(6), BEGIN)
    target.advance(BEGIN + NANO // 10, False)
    np.testing.assert_array_equal(target.pose, np.eye(4))
    assert not target.twist.any()


def test_a_pose_beside_a_stream_of_twists_corrects_the_target_at_once():
    twist = np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0])
    target = target_at(np.eye(4))
    for k in range(50):
        now = BEGIN + k * 20_000_000
        target.move(twist, now)
        target.go_to(displaced(np.eye(4), 0.02 * k * twist), now)
        target.advance(now, True)
    np.testing.assert_allclose(target.pose[0, 3], 0.02 * 49 * 0.1, atol=1e-9)


def test_the_cycle_on_floats_is_the_compiled_one():
    """Poses, twists, wrenches of all kinds; torque and memory always agree."""
    robot = Robot(load_urdf(resource_path('urdf', 'fr3.urdf'), joints=FR3_JOINTS))
    values = node_values({'mode': 'cartesian_impedance', 'cartesian.frame': 'fr3_hand'})
    mode = CartesianMode(robot, values)
    cycle = mode._cycle_of(robot, lanes_of_scalars)
    rng = np.random.default_rng(5)
    q = HOME.copy()
    u = np.zeros(7)
    for k in range(60):
        now = BEGIN + k * 4_000_000
        if k % 7 == 3:
            pose = robot.frame_pose('fr3_hand', HOME)
            pose[:3, 3] += rng.uniform(-0.1, 0.1, 3)
            mode.target.go_to(pose, now - 1_000_000)
        if k % 20 == 10:
            mode.target.move(rng.uniform(-0.1, 0.1, 6), k > 30, now)
        if k % 20 == 12:
            mode.target.press(rng.uniform(-5.0, 5.0, 6), k > 30, now)
        memory_before = mode._memory.copy()
        begins = mode._clock[1]
        tau = mode.torque(q, u, None, 0.0, now / NANO)
        expected, memory = cycle.torque(q, u, mode._clock[0], begins, memory_before,
                                        mode.settings_numbers(), mode._orders, t=0.0,
                                        parameters=robot.parameters.block)
        np.testing.assert_allclose(tau, expected, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(mode._memory, memory, rtol=1e-9, atol=1e-9)
        u = rng.uniform(-0.05, 0.05, 7)
        q = q + 0.004 * u
    twist, wrench, _ = mode.snapshot(now).detail
    assert twist.any() and wrench.any()


def test_a_wrench_ends_when_it_is_stale_and_a_restart_forgets_all():
    robot = Robot(load_urdf(resource_path('urdf', 'two_link.urdf')))
    values = node_values({'mode': 'cartesian_impedance', 'target.timeout': 0.2})
    mode = CartesianMode(robot, values)
    q = np.array([0.4, -0.9])

    def wrench_at(now):
        mode.torque(q, np.zeros(2), None, 0.0, now / NANO)
        return mode.snapshot(now).detail[1].tolist()
    assert wrench_at(BEGIN) == [0.0] * 6
    mode.target.press(np.arange(6.0), False, BEGIN)
    assert wrench_at(BEGIN + NANO // 10) == list(range(6))
    assert wrench_at(BEGIN + NANO) == [0.0] * 6
    mode.target.press(np.arange(6.0), False, BEGIN + NANO)
    assert wrench_at(BEGIN + NANO) == list(range(6))
    mode.restart()
    assert wrench_at(BEGIN + NANO + 1) == [0.0] * 6


def test_a_pose_is_reached_within_the_limits_alone():
    robot = Robot(load_urdf(resource_path('urdf', 'fr3.urdf'), joints=FR3_JOINTS))
    reach = TargetReach(robot, 'fr3_hand')
    limits = robot.limits
    rng = np.random.default_rng(3)
    reached = 0
    for _ in range(50):
        q = np.clip(HOME + rng.uniform(-0.6, 0.6, 7), limits.lower, limits.upper)
        reach.restart()
        reached += max(reach.remaining(robot.frame_pose('fr3_hand', q), HOME)) <= REACHED
    assert reached >= 49  # from one start
    far = robot.frame_pose('fr3_hand', HOME).copy()
    far[0, 3] += 1.0
    distance, _ = reach.remaining(far, HOME)
    assert distance > 0.3
    # Beyond a joint limit: the elbow would have to bend more.
    near = robot.frame_pose('fr3_hand', HOME).copy()
    near[:3, 3] = [0.05, 0.0, 0.45]
    assert max(reach.remaining(near, HOME)) > REACHED


def test_a_pose_is_reached_with_closed_loops():
    """The palletizer's tool stays level: it cannot tilt, and moves in its space."""
    options = load_constraints(resource_path('urdf', 'palletizer.constraints.yaml'))
    robot = Robot(load_urdf(resource_path('urdf', 'palletizer.urdf')), **options)
    names = robot.joint_names

    def closed(**joints):
        guess = np.zeros(len(names))
        for name, value in joints.items():
            guess[names.index(name)] = value
        return robot.closed_configuration(guess,
                                          fixed=list(joints), start=np.zeros(len(names)))
    start = closed(swivel=0.0, shoulder=0.2, lever_drive=0.1, turn=0.0)
    goal = robot.frame_pose('tool',
                            closed(swivel=0.4, shoulder=0.4, lever_drive=-0.1, turn=0.8))
    reach = TargetReach(robot, 'tool')
    assert max(reach.remaining(goal, start)) <= REACHED
    tilted = goal.copy()
    tilted[:3, :3] = rotation_exp([0.0, 0.3, 0.0]) @ goal[:3, :3]
    _, angle = reach.remaining(tilted, start)
    assert angle > 0.1
