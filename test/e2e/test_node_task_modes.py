"""Impedance and hand guiding over DDS: a seven-axis arm led, pushed and handed over."""


from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from kane_dynamics import load_urdf, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.kinematics.poses import rotation_quaternion
from kane_dynamics_interfaces.msg import TaskState
from node_process import DEEP, NAME, Process, wait_until
import numpy as np
import pytest
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

PLANT = 'kane_dynamics.ros.plant.main'
URDF = resource_path('urdf', 'fr3.urdf')
JOINTS = tuple(f'fr3_joint{k}' for k in range(1, 8))
HOME = [0.0, -0.4, 0.0, -2.0, 0.0, 1.7, 0.8]
FRAME = 'fr3_hand'
NANO = 10**9
RATE = 500  # states per second of simulated time
STIFFNESS = [800.0] * 3 + [15.0] * 3
pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]


class Arm:
    """The simulated arm, slower than real time, and what its node publishes."""

    def __init__(self, client):
        self.client = client
        joints = f'[{",".join(JOINTS)}]'
        self.plant = Process(module=PLANT, urdf=URDF, joints=joints, rate=RATE,
                             rate_factor=0.2,
                             publish_clock='true', initial__position=HOME,
                             wrench__frames=f'[{FRAME}]', wrench__timeout=100.0)
        self.node = Process(urdf=URDF, joints=joints, mode='cartesian_impedance',
                            modes='[joint_impedance,hand_guiding]',
                            cartesian__frame=FRAME,
                            cartesian__stiffness=STIFFNESS, use_sim_time='true',
                            state_timeout=1.0, limits__rate=1000.0, blend_time=0.1,
                            real_states=True, diagnostics_rate=20)
        self.states = []
        self.now = 0
        self.robot = Robot(load_urdf(URDF, joints=list(JOINTS)))
        self.publishers = {
            kind: client.create_publisher(kind, f'{NAME}/{topic}', 1)
            for kind, topic in ((PoseStamped, 'target_pose'),
                                (TwistStamped, 'target_twist'),
                                (WrenchStamped, 'target_wrench'))}
        self.push = client.create_publisher(WrenchStamped, '/plant_node/wrench', 1)
        self._open = [client.create_subscription(TaskState, f'{NAME}/task_state',
                                                 self.states.append, DEEP),
                      client.create_subscription(Clock, '/clock', self._on_clock, DEEP)]
        self.node.wait_for('active, mode')
        assert wait_until(lambda: len(self.states) > 3, 60.0), self.node.log

    def _on_clock(self, message):
        self.now = message.clock.sec * NANO + message.clock.nanosec

    def wait(self, seconds):
        """Wait for simulated time."""
        end = self.now + seconds * NANO
        assert wait_until(lambda: self.now >= end, 60.0 * max(seconds, 1.0))

    @property
    def state(self):
        """Return the next state of the frame."""
        count = len(self.states)
        assert wait_until(lambda: len(self.states) > count, 10.0), self.node.log
        return self.states[-1]

    def place(self):
        p = self.state.pose.position
        return np.array([p.x, p.y, p.z])

    def send(self, pose, frame=''):
        message = PoseStamped()
        message.header.frame_id = frame
        p = message.pose.position
        r = message.pose.orientation
        p.x, p.y, p.z = pose[:3, 3].tolist()
        r.x, r.y, r.z, r.w = rotation_quaternion(pose[:3, :3]).tolist()
        self.publishers[PoseStamped].publish(message)

    def load(self, force):
        """Let a force act on the frame, in world axes."""
        message = WrenchStamped()
        message.header.frame_id = FRAME
        q = [self.client_positions()[name] for name in JOINTS]
        rotation = self.robot.frame_pose(FRAME, q)[:3, :3]
        f = message.wrench.force
        f.x, f.y, f.z = (rotation.T @ force).tolist()
        self.push.publish(message)

    def client_positions(self):
        received = []
        subscription = self.client.create_subscription(JointState, 'joint_states',
                                                       received.append, DEEP)
        assert wait_until(lambda: received)
        self.client.destroy_subscription(subscription)
        return dict(zip(received[-1].name, received[-1].position))

    def close(self):
        for subscription in self._open:
            self.client.destroy_subscription(subscription)
        for publisher in (*self.publishers.values(), self.push):
            self.client.destroy_publisher(publisher)
        for process in (self.node, self.plant):
            assert process.end()[0] == 0
            assert 'Traceback' not in process.log


@pytest.fixture(scope='module')
def module_arm(participant):
    participant.joints = JOINTS
    arm = Arm(participant)
    yield arm
    arm.close()


@pytest.fixture
def arm(module_arm, client):
    """Return the arm at rest at home, in mode cartesian_impedance."""
    client.joints = JOINTS
    assert client.adjust(mode='cartesian_impedance',
                         cartesian__stiffness=STIFFNESS).successful
    module_arm.wait(0.3)
    home = module_arm.robot.frame_pose(FRAME, HOME)
    module_arm.send(home)
    assert wait_until(lambda: np.linalg.norm(module_arm.place() - home[:3, 3]) < 2e-4,
                      60.0), (
                          module_arm.place(), module_arm.node.log)
    module_arm.wait(0.3)
    module_arm.home = home
    return module_arm


def shifted(pose, x=0.0, y=0.0, z=0.0):
    result = pose.copy()
    result[:3, 3] += [x, y, z]
    return result


def test_a_target_pose_is_reached_within_the_limits_of_the_target(arm):
    goal = shifted(arm.home, 0.06, 0.1, -0.08)
    arm.send(goal)
    speeds = []
    assert wait_until(lambda: speeds.append(arm.state) or np.linalg.norm(
        arm.place() - goal[:3, 3]) < 2e-4, 60.0)
    assert all(not state.saturated or state.saturated == ['speed of the target']
               for state in speeds[5:]), speeds[-1]
    state = arm.state
    assert state.mode == 'cartesian_impedance' and state.header.frame_id == FRAME
    assert state.manipulability > 0.05 and state.smallest_singular_value > 0.1


@pytest.mark.parametrize('rate', [5.0, 50.0])
def test_a_stream_is_followed_and_its_last_pose_is_held(arm, rate):
    began = arm.now
    period = 1.0 / rate
    errors = []

    def pose_at(t):
        return shifted(arm.home, y=0.08 * np.sin(1.5 * t),
                       z=0.05 * (np.cos(1.5 * t) - 1.0))
    for k in range(round(2.0 * rate)):
        due = began + k * period * NANO
        assert wait_until(lambda due=due: arm.now >= due, 60.0)
        arm.send(pose_at(k * period))
        state = arm.states[-1]
        desired = np.array(
            [state.desired_pose.position.y, state.desired_pose.position.z])
        times = ((state.header.stamp.sec * NANO + state.header.stamp.nanosec - began)
                 / NANO)
        late = np.array([pose_at(max(times - period - lag, 0.0))[1:3, 3]
                         for lag in np.arange(0.0, 0.1, 0.005)])
        errors.append(np.linalg.norm(late - desired, axis=1).min())
    assert max(errors[3:]) < 0.01
    last = pose_at((round(2.0 * rate) - 1) * period)
    arm.wait(1.0)
    assert np.linalg.norm(arm.place() - last[:3, 3]) < 1e-3
    assert arm.state.target_age > 0.5
    arm.wait(1.0)
    assert np.linalg.norm(arm.place() - last[:3, 3]) < 1e-3


def test_the_deflection_is_that_of_the_stiffness_and_the_arm_returns(arm):
    resting_place = arm.place()
    arm.load(np.array([0.0, 16.0, 0.0]))
    arm.wait(2.0)
    np.testing.assert_allclose(arm.place() - resting_place, [0.0, 16.0 / 800.0, 0.0],
                               atol=4e-4)
    force = arm.state.wrench.force
    np.testing.assert_allclose([force.x, force.y, force.z], [0.0, -16.0, 0.0], atol=0.3)
    arm.load(np.zeros(3))
    arm.wait(2.0)
    np.testing.assert_allclose(arm.place(), resting_place, atol=3e-4)


def test_modes_change_live_without_a_jump_of_torque(arm):
    client = arm.client
    arm.load(np.array([0.0, 12.0, -8.0]))  # so that the springs are stretched
    arm.wait(0.5)
    client.torques.clear()
    modes = ['joint_impedance', 'computed_torque', 'hand_guiding', 'cartesian_impedance',
             'gravity_compensation', 'joint_impedance', 'cartesian_impedance']
    for mode in modes:
        assert client.adjust(mode=mode).successful
        arm.wait(0.12)
    arm.load(np.zeros(3))
    stamps = sorted(client.torques)
    torques = np.array([client.torques[stamp] for stamp in stamps])
    steps = np.abs(np.diff(torques, axis=0)).max(axis=1)
    periods = np.diff(stamps) / NANO
    assert len(stamps) > 0.1 * RATE * len(modes)
    # The limit of the rate allows 2 N m in a period of 2 ms.
    assert (steps / periods).max() < 500.0


@pytest.mark.parametrize(('change', 'reason', 'words'), [
    (lambda arm: arm.send(arm.home, 'nowhere'), 'unknown frame', "frame_id 'nowhere'"),
    (lambda arm: arm.send(arm.home, FRAME), 'unknown frame', 'which moves'),
    (lambda arm: arm.send(shifted(arm.home, x=0.9)), 'too far',
     'expected at most 0.5 m'),
    (lambda arm: arm.send(shifted(arm.home, x=0.3, z=0.35)), 'out of reach',
     'comes within')])
def test_a_target_is_refused_with_the_reason(arm, change, reason, words):
    def count():
        arm.client.diagnostics.clear()
        key = f'rejected: target_pose: {reason}'
        assert wait_until(lambda: any('rate' in values for _, _, values in
                                      arm.client.diagnostics))
        return int(arm.client.diagnostics[-1][2].get(key, 0))
    count_before = count()
    change(arm)
    assert wait_until(lambda: count() == count_before + 1, 10.0)
    assert words in arm.node.log
    arm.wait(0.3)
    assert np.linalg.norm(arm.place() - arm.home[:3, 3]) < 5e-4


def test_a_twist_moves_the_target_and_ends_by_itself(arm):
    message = TwistStamped()
    message.header.frame_id = FRAME  # along the axes of the hand, which looks down
    message.twist.linear.z = 0.05
    arm.publishers[TwistStamped].publish(message)
    arm.wait(2.0)
    moved = arm.place() - arm.home[:3, 3]
    expected = 0.5 * 0.05 * arm.home[:3, 2]
    np.testing.assert_allclose(moved, expected, atol=4e-3)


def test_stiffness_changes_live(arm):
    resting_place = arm.place()
    arm.load(np.array([0.0, 8.0, 0.0]))
    assert arm.client.adjust(cartesian__stiffness=[400.0] * 3 + [15.0] * 3).successful
    arm.wait(2.0)
    np.testing.assert_allclose((arm.place() - resting_place)[1], 0.02, atol=1e-3)
    arm.load(np.zeros(3))
    answer = arm.client.adjust(cartesian__stiffness=[-1.0] * 6)
    assert not answer.successful and 'cartesian.stiffness' in answer.reason
