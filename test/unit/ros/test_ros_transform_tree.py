"""Frames that only tf2 knows, on the bodies of the model."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import TransformStamped, WrenchStamped  # noqa: E402, I100
from kane_dynamics import load_urdf, Robot  # noqa: E402
from kane_dynamics._util.resources import resource_path  # noqa: E402
from kane_dynamics.errors import InputError  # noqa: E402
from kane_dynamics.model.model import Frame, WORLD  # noqa: E402
from kane_dynamics.ros.common.transform_tree import (  # noqa: E402
    MOST_FRAMES, TransformTree)
from kane_dynamics.ros.loads.wrench_input import (  # noqa: E402
    SHARED, WrenchFrames, WrenchInput)
from kane_dynamics.ros.monitors.imu_gravity import GravityFromImu  # noqa: E402
from node_values import node_values  # noqa: E402
from rclpy.serialization import serialize_message  # noqa: E402
from sensor_msgs.msg import Imu  # noqa: E402

MODEL = load_urdf(resource_path('urdf', 'two_link.urdf'))
FIRST, TIP = (body.name for body in MODEL.bodies)
BASE = next(frame.name for frame in MODEL.frames if frame.body == WORLD)
NANO = 10**9


class Rig:
    """A tree with a manual clock."""

    def __init__(self):
        self.time = 100 * NANO
        self.rejected = []
        self.tree = TransformTree(MODEL, lambda: self.time, 0.5,
                                  lambda *words: self.rejected.append(': '.join(words)))

    def hear(self, parent, child, pose=None, age=0.0, *, static=True, stamp=None):
        message = TransformStamped(child_frame_id=child)
        message.header.frame_id = parent
        moment = self.time - round(age * NANO) if stamp is None else stamp
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(moment, NANO)
        p = message.transform.translation
        r = message.transform.rotation
        numbers = pose_numbers(np.eye(4) if pose is None else pose)
        p.x, p.y, p.z, r.x, r.y, r.z, r.w = numbers
        self.tree.on_message(SimpleNamespace(transforms=[message]), static=static)

    def pose(self, name):
        frame = self.tree.frame(name)
        pose = np.eye(4)
        pose[:3, :3] = frame.rotation
        pose[:3, 3] = frame.translation
        return frame.body, pose

    def refused(self, name):
        with pytest.raises(InputError) as error:
            self.tree.frame(name)
        return str(error.value)


def random_pose(seed):
    """Return a random pose by Rodrigues' formula."""
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    angle = rng.uniform(0.2, 2.5)
    K = np.array(
        [[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    pose = np.eye(4)
    pose[:3, :3] += np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K
    pose[:3, 3] = rng.uniform(-1.0, 1.0, 3)
    return pose


def pose_numbers(pose):
    """Return position and quaternion, for angles below pi."""
    R = pose[:3, :3]
    w = 0.5 * np.sqrt(max(1.0 + np.trace(R), 0.0))
    x, y, z = (R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]) / (4.0 * w)
    return [*pose[:3, 3].tolist(), x, y, z, w]


def placed(name):
    frame = MODEL.frame(name)
    pose = np.eye(4)
    pose[:3, :3] = frame.rotation
    pose[:3, 3] = frame.translation
    return frame.body, pose


def test_frames_are_found_below_beside_and_above_those_of_the_model():
    rig = Rig()
    A, B, C, D = map(random_pose, range(4))
    rig.hear(TIP, 'bracket', A)
    rig.hear('bracket', 'sensor', B)
    rig.hear('map', BASE, C)
    rig.hear('map', 'camera', D)
    body, tip = placed(TIP)
    _, base = placed(BASE)
    inverse = np.linalg.inv(C)
    for name, on, pose in (('sensor', body, tip @ A @ B), ('map', WORLD, base @ inverse),
                           ('camera', WORLD, base @ inverse @ D), (TIP, body, tip)):
        at, value = rig.pose(name)
        assert at == on
        np.testing.assert_allclose(value, pose, atol=1e-12)


def test_the_model_knows_its_own_frames_better():
    rig = Rig()
    rig.hear(BASE, TIP, random_pose(1), static=False)
    np.testing.assert_array_equal(rig.pose(TIP)[1], placed(TIP)[1])


def test_transforms_of_tf_become_stale_and_static_ones_do_not():
    rig = Rig()
    rig.hear(TIP, 'bracket')
    rig.hear('bracket', 'probe', static=False)
    rig.time += round(0.4 * NANO)
    rig.pose('probe')
    rig.time += round(0.2 * NANO)
    assert rig.refused('probe') == (
        "frame 'probe': the transform of 'probe' in 'bracket' is 0.6 s old; expected "
        'at most 0.5 s, or a static one')
    rig.time += 10**6 * NANO
    rig.pose('bracket')


def test_late_messages_are_not_used_unless_the_clock_jumped_back():
    rig = Rig()
    new = random_pose(1)
    old = random_pose(2)
    rig.hear(TIP, 'probe', new, static=False)
    rig.hear(TIP, 'probe', old, age=0.1, static=False)
    np.testing.assert_allclose(rig.pose('probe')[1], placed(TIP)[1] @ new, atol=1e-12)
    rig.time -= 50 * NANO
    rig.hear(TIP, 'probe', old, static=False)
    np.testing.assert_allclose(rig.pose('probe')[1], placed(TIP)[1] @ old, atol=1e-12)
    # A stamp of zero is the time of receipt.
    rig.hear(TIP, 'probe', new, static=False, stamp=0)
    np.testing.assert_allclose(rig.pose('probe')[1], placed(TIP)[1] @ new, atol=1e-12)


def test_frames_without_a_way_to_the_model_are_refused():
    rig = Rig()
    rig.hear('island', 'hut')
    assert rig.refused('hut').startswith(
        "frame 'hut', whose transforms end at 'island'; expected")
    assert rig.refused('nowhere').startswith(
        "frame 'nowhere'; expected a frame of the model")
    assert TIP in rig.refused('nowhere')


@pytest.mark.parametrize('parent, child, numbers, reason', [
    ('', 'a', None, 'an empty name'), ('a', '', None, 'an empty name'),
    ('a', 'a', None, 'a cycle'), ('a', 'b', np.nan, 'expected finite numbers'),
    ('a', 'b', 0.0, 'quaternion of length 1')])
def test_transforms_that_are_none_are_rejected(parent, child, numbers, reason):
    rig = Rig()
    pose = np.eye(4)
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id = parent
    message.transform.rotation.w = 1.0 if numbers is None else numbers
    rig.tree.on_message(SimpleNamespace(transforms=[message]), static=True)
    assert reason in rig.rejected[0]
    assert not pose[3, :3].any()


def test_a_cycle_is_rejected_and_a_frame_may_move_to_another_parent():
    rig = Rig()
    rig.hear(TIP, 'a')
    rig.hear('a', 'b')
    rig.hear('b', 'c')
    rig.hear('c', 'a')
    assert rig.rejected == [
        "transform: transform of 'a' in 'c': a cycle; expected a tree of frames"]
    pose = random_pose(3)
    rig.hear(FIRST, 'b', pose)
    body, value = rig.pose('c')
    assert body == placed(FIRST)[0]
    np.testing.assert_allclose(value, placed(FIRST)[1] @ pose, atol=1e-12)


def test_the_number_of_frames_is_bounded():
    rig = Rig()
    message = SimpleNamespace(transforms=[])
    for k in range(MOST_FRAMES + 2):
        transform = TransformStamped(child_frame_id=f'f{k}')
        transform.header.frame_id = TIP
        message.transforms.append(transform)
    rig.tree.on_message(message, static=True)
    assert len(rig.rejected) == 2


def test_a_wrench_has_the_torques_of_a_robot_that_declares_its_frame():
    rig = Rig()
    pose = random_pose(5)
    rig.hear(TIP, 'sensor', pose)
    body, at = rig.pose('sensor')
    model = replace(MODEL,
                    frames=(*MODEL.frames, Frame('sensor', body, at[:3, :3], at[:3, 3])))
    declared = Robot(model, wrench_frames=('sensor',))
    robot = Robot(MODEL, wrench_frames=(FIRST, TIP))
    q = np.array([0.7, -0.4])
    wrench = np.array([3.0, -2.0, 5.0, 0.5, 1.5, -0.2])
    frames = WrenchFrames(robot, rig.tree)
    row, moved = frames.placed('sensor', wrench)
    assert row == 1
    np.testing.assert_allclose(
        robot.external_force(q, wrench=frames.in_world(q, [(row, moved)])),
        declared.external_force(
            q, wrench=WrenchFrames(declared).in_world(q, [(0, wrench)])), atol=1e-12)
    with pytest.raises(InputError, match='on a body without a frame of wrench'):
        frames.placed(BASE, wrench)


def test_a_declared_frame_has_the_wrench_of_one_frame_at_a_time():
    rig = Rig()
    rig.hear(TIP, 'left')
    rig.hear(TIP, 'right')
    rejected = []
    wrenches = WrenchInput(Robot(MODEL, wrench_frames=(TIP,)), lambda: rig.time,
                           node_values({}),
                           lambda reason, detail: rejected.append(reason), rig.tree)

    def press(frame):
        message = WrenchStamped()
        message.header.frame_id = frame
        message.wrench.force.x = 1.0
        wrenches.on_message(serialize_message(message))
    press('left')
    press('left')
    assert not rejected
    press('right')
    press(TIP)
    assert rejected == [SHARED, SHARED]
    rig.time += 2 * wrenches.timeout
    press('right')
    assert len(rejected) == 2


def test_the_direction_of_gravity_follows_from_an_imu_that_tf_places():
    rig = Rig()
    used = []
    pose = random_pose(7)
    source = GravityFromImu(MODEL, 9.81, 0.1, used.append, rig.tree)
    message = Imu()
    message.header.frame_id = 'imu'
    force = pose[:3, :3].T @ placed(BASE)[1][:3, :3].T @ np.array([0.0, 0.0, 9.81])
    a = message.linear_acceleration
    a.x, a.y, a.z = force
    with pytest.raises(InputError, match="frame 'imu'; expected a frame of the model"):
        source.update(message, rig.time)
    rig.hear(BASE, 'imu', pose)
    for _ in range(30):
        rig.time += NANO // 100
        source.update(message, rig.time)
    np.testing.assert_allclose(used[-1], [0.0, 0.0, -9.81], atol=1e-9)
    rig.hear(TIP, 'imu', pose)
    with pytest.raises(InputError, match="'imu', which moves"):
        source.update(message, rig.time)
