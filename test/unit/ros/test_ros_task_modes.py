"""The torque path in the modes of a law: targets, refusals, changes of mode, stops."""

import math
import time
from types import SimpleNamespace

from kane_dynamics._util.resources import resource_path
from kane_dynamics.kinematics.poses import rotation_exp, rotation_quaternion
import numpy as np
import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import (  # noqa: E402, I100
    PoseStamped, TransformStamped, TwistStamped, WrenchStamped)
from kane_dynamics.control.terms import Mode  # noqa: E402
from kane_dynamics.control_cycle import cycle_rules  # noqa: E402
from kane_dynamics.errors import InputError  # noqa: E402
from kane_dynamics.model.model import WORLD  # noqa: E402
from kane_dynamics.ros.common.configuration_files import load_model  # noqa: E402
from kane_dynamics.ros.common.node_statistics import Statistics  # noqa: E402
from kane_dynamics.ros.common.transform_tree import TransformTree  # noqa: E402
from kane_dynamics.ros.inputs.target_input import TargetInput  # noqa: E402
from kane_dynamics.ros.modes.task_modes import LAWS, TaskModes  # noqa: E402
from kane_dynamics.ros.parameters.parameter_table import LAW_MODES  # noqa: E402
from kane_dynamics.ros.torque_path.path_controller import (path_controller,  # noqa: E402
                                                           path_settings)
from kane_dynamics.ros.torque_path.torque_path import TorquePath  # noqa: E402
from node_values import node_values, update_laws  # noqa: E402
from rclpy.serialization import serialize_message  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402

NANO = 10**9
URDF = resource_path('urdf', 'two_link.urdf')
START = np.array([0.4, -0.9])
GOAL = np.array([0.55, -1.1])
STEP = 1_000_000  # ns
FRAME = 'tip'
ALL_MODES = tuple(mode for mode in Mode if mode is not Mode.MOTOR_SIDE)  # rigid joints


class Bytes:
    """Keeps what is published."""

    def publish(self, data):
        self.data = data


class Rig:
    """The torque path of a simulated arm, with a manual clock."""

    def __init__(self, mode='cartesian_impedance', frame=FRAME, urdf=URDF, start=START,
                 **changes):
        self.values = node_values({
            'mode': mode, 'modes': list(map(str, LAW_MODES)), 'cartesian.frame': frame,
            'limits.rate': math.inf,
            **{k.replace('__', '.'): v for k, v in changes.items()}})
        model = load_model(urdf, self.values, lambda warning: None)
        self.controller = path_controller(model, self.values, self._laws)
        self.robot = self.controller.robot
        self.now = 100 * NANO
        self.warnings = []
        self.refused = []
        self.commands = Bytes()
        self.path = TorquePath(self.controller, self.commands, Bytes(), lambda: self.now,
                               self.values, Statistics(), self._warn)
        self.path.add_observer(self, need_effort=False)
        law = self.modes.laws[Mode.CARTESIAN_IMPEDANCE]
        self.law = law
        self.targets = TargetInput(self.path, law.target, frame, self.values,
                                   self._refuse)
        self.q, self.u = np.array(start), np.zeros(self.robot.n)
        self.push = np.zeros(self.robot.n)
        self.taus = []
        self.path.start()

    def _laws(self, robot):
        self.modes = TaskModes(robot, self.values)
        return self.modes.laws

    def _warn(self, reason, detail):
        self.warnings.append((reason, detail))

    def _refuse(self, reason, detail):
        self.refused.append((reason, detail))

    start = stop = on_loads_changed = lambda self: None

    def on_cycle(self, cycle):
        self.taus.append(cycle.tau.copy())

    def adjust(self, **changes):
        """Change parameters as the node does."""
        dotted = {name.replace('__', '.'): value for name, value in changes.items()}
        checked = node_values(dotted)
        new = self.values | {name: checked[name] for name in dotted}
        self.modes.check_mode(new)
        for law in self.modes.laws.values():
            law.check(new)
        self.values = new
        if update_laws(self.modes, new):
            self.path.blend()
        self.controller.update(**path_settings(new, self.robot))
        self.path.set_limits(new)
        self.targets.update(new)

    def forget_states(self):
        """Compare the next state with no earlier one, as it is elsewhere."""
        self.path.change(cycle_rules.forgotten)

    def hand_back(self, torque):
        """Go on from the torques of torque_guard."""
        path = self.path
        now = float(self.now - path.time_of(0.0))
        event = cycle_rules.Event(now, now, 0.0, 0.0, 1.0, time.perf_counter() * NANO)
        path.change(cycle_rules.taken_back, event, torque, path.native.plan.settings)

    def state(self):
        """Pass the present state to the path; return the torque, or None."""
        message = JointState(name=list(self.robot.joint_names), position=self.q.tolist(),
                             velocity=self.u.tolist())
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(self.now, NANO)
        count_before = len(self.taus)
        self.path.on_state(serialize_message(message))
        return self.taus[-1] if len(self.taus) > count_before else None

    def run(self, seconds, each=lambda: None):
        """Simulate the arm under the commands."""
        for _ in range(round(seconds * NANO / STEP)):
            each()
            tau = self.state()
            tau = np.zeros(self.robot.n) if tau is None else tau
            udot = self.robot.forward_dynamics(self.q, self.u, tau + self.push)
            self.u = self.u + STEP / NANO * udot
            self.q = self.q + STEP / NANO * self.u
            self.now += STEP

    def pose(self, q=None):
        return self.robot.frame_pose(self.law.frame, self.q if q is None else q)

    def send_pose(self, pose, frame='', stamp=0):
        message = PoseStamped()
        message.header.frame_id = frame
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, NANO)
        p = message.pose.position
        r = message.pose.orientation
        p.x, p.y, p.z = pose[:3, 3].tolist()
        if np.isfinite(pose).all():
            r.x, r.y, r.z, r.w = rotation_quaternion(pose[:3, :3]).tolist()
        self.targets.on_pose(serialize_message(message))

    def error(self, q):
        return np.linalg.norm(self.pose()[:3, 3] - self.pose(q)[:3, 3])


def test_the_modes_of_the_table_are_those_with_a_law():
    assert set(LAWS) == set(LAW_MODES)


@pytest.mark.parametrize('mode', LAW_MODES)
def test_a_mode_holds_the_arm_against_gravity(mode):
    rig = Rig(mode)
    rig.state()  # the first state has no answer
    rig.now += STEP
    rig.run(1.0)
    np.testing.assert_allclose(rig.q, START, atol=1e-6)
    np.testing.assert_allclose(rig.taus[-1], rig.robot.gravity_force(rig.q), atol=1e-3)


def test_an_operator_leads_the_arm_up_to_its_limits():
    """Friction is compensated in part, and fast motion and walls resist."""
    rig = Rig('hand_guiding', hand_guiding__max_speed=0.3)
    rig.state()
    rig.now += STEP
    rig.push = np.array([4.0, 0.0])
    rig.run(1.5)
    fast = rig.u[0]
    described = rig.modes.laws[Mode.HAND_GUIDING].describe(rig.q, rig.u, None)
    assert 'speed of joint1' in described.saturated
    rig.adjust(hand_guiding__max_speed=9.0)
    rig.q, rig.u = START.copy(), np.zeros(2)
    rig.forget_states()
    rig.run(1.5)
    assert 0.3 < fast < 0.7 < rig.u[0]


def test_a_target_pose_is_reached_without_a_jump_of_torque():
    rig = Rig()
    rig.run(0.5)
    rig.send_pose(rig.pose(GOAL))
    first = len(rig.taus)
    rig.run(3.0)
    assert not rig.refused and rig.error(GOAL) < 1e-4
    steps = np.abs(np.diff(rig.taus[first - 1:], axis=0))
    # N m in 1 ms: the acceleration of the target comes within some 50 ms. The spring
    # alone would make 60 N at once.
    assert steps.max() < 0.25


@pytest.mark.parametrize('period', [0.2, 0.02, 0.001])
def test_a_stream_of_poses_is_followed_and_its_last_one_is_held(period):
    rig = Rig(cartesian__stiffness=[4000.0] * 3 + [50.0] * 3, cartesian__max_force=200.0)
    rig.run(0.2)
    start = rig.now
    errors = []

    def path_at(t):
        return START + 0.5 * (1.0 - math.cos(0.8 * t)) * (GOAL - START)

    def send():
        if (rig.now - start) % round(period * NANO) == 0:
            rig.send_pose(rig.pose(path_at((rig.now - start) / NANO)))
        late = max((rig.now - start) / NANO - period, 0.0)
        errors.append(rig.error(path_at(late)))
    rig.run(2.0, send)
    assert not rig.refused
    assert max(errors) < 4e-3
    last = rig.now
    rig.run(1.5)
    assert rig.error(path_at((last - start) / NANO)) < 1e-3 + 0.1 * period


def test_targets_may_be_in_frames_that_tf_places_on_the_world():
    rig = Rig()
    of_map = np.array(
        [[0.0, -1.0, 0.0, 0.4], [1.0, 0.0, 0.0, -0.2], [0.0, 0.0, 1.0, 0.1],
         [0.0, 0.0, 0.0, 1.0]])
    base = next(frame for frame in rig.robot.model.frames if frame.body == WORLD)
    assert np.array_equal(base.rotation, np.eye(3)) and not base.translation.any()
    transforms = TransformTree(rig.robot.model, lambda: rig.now, 0.5, rig._refuse)
    message = TransformStamped(child_frame_id='map')
    message.header.frame_id = base.name
    p = message.transform.translation
    r = message.transform.rotation
    p.x, p.y, p.z = of_map[:3, 3]
    r.z = r.w = np.sqrt(0.5)
    transforms.on_message(SimpleNamespace(transforms=[message]), static=True)
    message.child_frame_id = 'camera'
    message.header.frame_id = FRAME
    transforms.on_message(SimpleNamespace(transforms=[message]), static=True)
    rig.targets = TargetInput(rig.path, rig.law.target, FRAME, rig.values, rig._refuse,
                              transforms)
    rig.state()
    rig.now += STEP
    rig.run(0.05)
    goal = rig.pose(rig.q + 0.02)
    rig.send_pose(np.linalg.inv(of_map) @ goal, frame='map')
    assert not rig.refused
    rig.run(3.0)
    assert np.abs(rig.pose() - goal).max() < 2e-3
    rig.send_pose(goal, frame='camera')
    assert "'camera', which moves" in rig.refused[-1][1]
    rig.send_pose(goal, frame='attic')
    assert "frame 'attic'; expected" in rig.refused[-1][1]


def test_a_target_twist_moves_the_frame_until_it_is_stale():
    rig = Rig(target__timeout=0.2)
    rig.run(0.2)
    q_rate = np.array([0.3, -0.4])
    message = TwistStamped()
    v = rig.robot.frame_velocity(FRAME, rig.q, q_rate)
    message.twist.linear.x, message.twist.linear.y, message.twist.linear.z = v[:3]
    message.twist.angular.x, message.twist.angular.y, message.twist.angular.z = v[3:]
    pose_before = rig.pose().copy()
    rig.targets.on_twist(serialize_message(message))
    rig.run(2.0)
    assert not rig.refused
    moved = rig.pose()[:3, 3] - pose_before[:3, 3]
    np.testing.assert_allclose(moved, 0.2 * v[:3], atol=0.02 * np.linalg.norm(v[:3]))
    held = rig.q.copy()
    rig.run(0.5)
    np.testing.assert_allclose(rig.q, held, atol=1e-3)


def test_a_target_wrench_is_exerted_and_ends_when_it_is_stale():
    rig = Rig(target__timeout=0.3, wrench__rise_time=0.0)
    rig.run(0.3)
    message = WrenchStamped()
    message.wrench.force.x = 12.0
    without = rig.taus[-1]
    rig.targets.on_wrench(serialize_message(message))
    with_wrench = rig.state()
    expected = rig.robot.jacobian(FRAME, rig.q).T @ [12.0, 0, 0, 0, 0, 0]
    np.testing.assert_allclose(with_wrench - without, expected, atol=0.05)
    rig.push = -expected  # what a wall would do
    rig.run(0.2)
    np.testing.assert_allclose(rig.q, START, atol=5e-3)
    rig.push = np.zeros(2)
    rig.run(2.0)
    assert rig.error(START) < 1e-3 and not rig.refused


def test_a_target_wrench_grows_with_the_time_between_its_messages():
    rig = Rig(target__timeout=0.3)
    rig.run(0.3)
    message = WrenchStamped()
    message.wrench.force.x = 60.0  # cartesian.max_force
    without = rig.taus[-1]
    rig.targets.on_wrench(serialize_message(message))
    np.testing.assert_allclose(rig.state(), without, atol=1e-3)
    began = rig.now
    rig.run(0.1)
    elapsed = (rig.now - began) / NANO
    without = rig.taus[-1]
    rig.targets.on_wrench(serialize_message(message))
    expected = rig.robot.jacobian(FRAME, rig.q).T @ [120.0 * elapsed, 0, 0, 0, 0, 0]
    np.testing.assert_allclose(rig.state() - without, expected, atol=0.2)


@pytest.mark.parametrize('first', ALL_MODES)
def test_changes_of_mode_are_continuous(first):
    rig = Rig(first)
    rig.push = np.array([3.0, -1.0])  # so that springs are stretched
    rig.run(0.2)
    for second in ALL_MODES:
        torque_before = rig.taus[-1]
        rig.adjust(mode=str(second))
        torque_after = rig.state()
        np.testing.assert_allclose(torque_after, torque_before, atol=0.2)
        rig.run(0.05)
    steps = np.abs(np.diff(rig.taus[5:], axis=0))
    assert steps.max() < 0.6


@pytest.mark.parametrize(('mode', 'changes'), [
    ('cartesian_impedance', {'cartesian__stiffness': [1500.0] * 6}),
    ('cartesian_impedance', {'cartesian__damping_ratio': 0.1}),
    ('joint_impedance', {'joint_impedance__stiffness': 1.0}),
    ('joint_impedance', {'joint_impedance__damping': 4.0})])
def test_changes_of_settings_are_continuous_and_act(mode, changes):
    rig = Rig(mode)
    rig.push = np.array([6.0, -2.0])
    rig.run(0.4)
    place = rig.q.copy()
    torque_before = rig.taus[-1]
    rig.adjust(**changes)
    np.testing.assert_allclose(rig.state(), torque_before, atol=0.2)
    rig.run(1.0)
    if 'stiffness' in next(iter(changes)):
        assert np.abs(rig.q - place).max() > 1e-3


def test_an_arm_that_adds_terms_itself_gets_commands_without_them():
    for mode in LAW_MODES:
        whole = Rig(mode)
        without = Rig(mode, arm_compensates=['gravity'])
        for rig in (whole, without):
            rig.state()
            rig.now += STEP
            rig.state()
        gravity = whole.robot.gravity_force(START)
        np.testing.assert_allclose(whole.taus[-1] - without.taus[-1], gravity, rtol=1e-9)


def refusal(rig, send):
    """Return reason and detail of the one message that is refused."""
    moved_at = rig.law.target.moved_at
    send()
    (reason, detail), = rig.refused
    assert rig.law.target.moved_at == moved_at
    return reason, detail


@pytest.mark.parametrize(('change', 'reason', 'words'), [
    (lambda rig, pose: rig.send_pose(pose, frame='nowhere'), 'unknown frame',
     "frame_id 'nowhere'; expected '' or world"),
    (lambda rig, pose: rig.send_pose(pose, frame=FRAME), 'unknown frame', 'which moves'),
    (lambda rig, pose: rig.send_pose(shifted(pose, 2.0)), 'too far',
     'expected at most 0.5 m and 1.6 rad'),
    (lambda rig, pose: rig.send_pose(shifted(pose, 0.3)), 'out of reach',
     "'tip' comes within "),
    (lambda rig, pose: rig.send_pose(turned(pose)), 'out of reach', 'rad of it'),
    (lambda rig, pose: rig.send_pose(pose, stamp=rig.now - NANO), 'stale',
     '1.000 s old'),
    (lambda rig, pose: rig.send_pose(pose, stamp=rig.now + NANO), 'stamp in the future',
     '1.000 s ahead'),
    (lambda rig, pose: rig.send_pose(np.full((4, 4), np.nan)), 'not finite', 'nan'),
    (lambda rig, pose: rig.targets.on_pose(b'\0\1\0\0'), 'malformed',
     'valid encoding'),
])
def test_a_pose_is_refused_with_the_reason(change, reason, words):
    rig = Rig()
    rig.run(0.05)
    state, detail = refusal(rig, lambda: change(rig, rig.pose()))
    assert state.startswith(f'target_pose: {reason}')
    assert words in detail
    rig.run(0.3)
    assert rig.error(START) < 5e-3


def moved(pose, displacement):
    """Return a pose moved by a displacement, (3,), in the world."""
    result = pose.copy()
    result[:3, 3] += displacement
    return result


def test_a_stream_that_ends_at_the_edge_makes_no_target_beyond_it():
    rig = Rig(frame='tool0', urdf=resource_path('urdf', 'ur10e.urdf'),
              start=[0.3, -0.6, 0.7, -1.77, -1.57, 0.0])
    rig.run(0.01)
    start = rig.pose()
    outwards = start[:3, 3] * [1.0, 1.0, 0.0]
    outwards /= np.linalg.norm(outwards)
    edge = 0.0
    while max(rig.targets._reach.remaining(moved(start, edge * outwards), rig.q)) < 1e-4:
        edge += 0.002
    rig.targets.clear()
    # At 0.25 m/s, the limit, a target that leaves the last pose at 2 m/s^2 needs 16 mm.
    began = rig.now
    ways = []

    def send():
        since = rig.now - began
        if since % (10 * STEP) == 0:
            rig.send_pose(moved(start, 0.25 * since / NANO * outwards))
        snapshot = rig.law.snapshot(rig.now)
        ways.append((snapshot.desired[:3, 3] - start[:3, 3]) @ outwards)
    rig.run(edge / 0.25 + 1.0, send)
    assert {reason for reason, _ in rig.refused} == {'target_pose: out of reach'}
    assert max(ways) <= edge
    assert 'further on, at which the target stops from its speed' in rig.refused[0][1]
    assert ways[-1] > edge - 0.02, 'the target stops where it just can'


def test_stamps_after_a_backward_jump_of_the_clock_are_of_the_new_time():
    rig = Rig()
    rig.run(0.05)
    rig.send_pose(rig.pose(), stamp=rig.now)
    rig.now -= 5 * NANO
    rig.run(0.05)
    rig.send_pose(rig.pose(), stamp=rig.now)
    assert not rig.refused
    rig.send_pose(rig.pose(), stamp=rig.now - STEP)
    assert 'before the latest one' in rig.refused[-1][0]


def shifted(pose, distance):
    result = pose.copy()
    result[:3, 3] += distance * pose[:3, 3] / np.linalg.norm(pose[:3, 3])
    return result


def turned(pose):
    result = pose.copy()
    result[:3, :3] = rotation_exp(0.5 * pose[:3, 0]) @ pose[:3, :3]
    return result


def test_targets_are_refused_in_another_mode_and_when_nothing_runs():
    rig = Rig('joint_impedance')
    rig.run(0.05)
    assert refusal(
        rig, lambda: rig.send_pose(rig.pose()))[0] == 'target_pose: other mode'
    rig.refused.clear()
    rig.path.stop()
    assert refusal(
        rig, lambda: rig.send_pose(rig.pose()))[0] == 'target_pose: node not active'
    rig = Rig()
    assert refusal(
        rig, lambda: rig.send_pose(rig.pose()))[0] == 'target_pose: no joint state'


@pytest.mark.parametrize(('kind', 'topic'),
                         [(TwistStamped, 'twist'), (WrenchStamped, 'wrench')])
def test_twists_and_wrenches_above_the_limits_are_refused(kind, topic):
    rig = Rig()
    rig.run(0.05)
    message = kind()
    send = rig.targets.on_twist
    if topic == 'twist':
        message.twist.angular.x = 99.0
    else:
        message.wrench.torque.x = 99.0
        send = rig.targets.on_wrench
    reason, detail = refusal(rig, lambda: send(serialize_message(message)))
    assert reason == f'target_{topic}: too large' and 'expected at most' in detail


def test_the_arm_is_held_where_the_guard_left_it():
    """As the guard hands back: the torque goes on, and the target is the pose there."""
    rig = Rig()
    rig.run(0.2)
    rig.send_pose(rig.pose(GOAL))
    rig.run(0.3)
    rig.q, rig.u = rig.q + [0.2, 0.1], np.zeros(2)
    torque = rig.robot.gravity_force(rig.q)
    rig.forget_states()
    rig.hand_back(torque)
    held = rig.q.copy()
    rig.run(1.0)
    np.testing.assert_allclose(rig.q, held, atol=5e-3)


def test_stale_states_end_the_target():
    rig = Rig()
    rig.run(0.2)
    rig.send_pose(rig.pose(GOAL))
    rig.run(0.1)
    rig.now += NANO
    rig.path.check_timeout()
    assert rig.path.timed_out
    rig.u = np.zeros(2)
    place = rig.q.copy()
    rig.run(1.0)
    np.testing.assert_allclose(rig.q, place, atol=1e-2)


def test_a_mode_that_is_not_configured_is_refused():
    rig = Rig(modes=[])
    with pytest.raises(
            InputError, match=r'joint_impedance.; expected one of '
            r'inverse_dynamics, .*cartesian_impedance, or to configure the node'):
        rig.adjust(mode='joint_impedance')


@pytest.mark.parametrize(('changes', 'words'), [
    ({'cartesian__frame': 'nowhere'}, 'mode cartesian_impedance: .*nowhere'),
    ({'cartesian__axes': 'nowhere'}, 'nowhere'),
    ({'cartesian__stiffness': [-1.0] * 6}, r'cartesian.stiffness.*at least 0'),
    ({'cartesian__posture': [0.0] * 3}, 'cartesian.posture.*3 entries'),
    ({'joint_impedance__stiffness': [1.0] * 3}, 'joint_impedance.stiffness.*3 entries'),
    ({'walls__margin': 50.0}, 'margin')])
def test_parameters_that_do_not_fit_the_arm_are_refused(changes, words):
    with pytest.raises(InputError, match=words):
        Rig(frame=changes.pop('cartesian__frame', FRAME), **changes)


def test_the_description_names_what_is_saturated():
    rig = Rig(cartesian__max_force=5.0)
    rig.push = np.array([20.0, 0.0])
    rig.run(0.3)
    snapshot = rig.law.snapshot(rig.now)
    described = rig.law.describe(rig.q, rig.u, snapshot)
    assert 'force of the spring' in described.saturated
    assert np.linalg.norm(described.wrench[:3]) > 1.0
    assert snapshot.target_age == -1.0


def test_the_description_names_the_joints_at_their_walls():
    rig = Rig(cartesian__stiffness=[100.0] * 6, walls__margin=0.1)
    rig.run(0.01)
    described = rig.law.describe(rig.q, rig.u, rig.law.snapshot(rig.now))
    assert not any('wall' in what for what in described.saturated)
    near = rig.q.copy()
    near[1] = rig.robot.limits.lower[1] + 0.05
    described = rig.law.describe(near, rig.u, rig.law.snapshot(rig.now))
    assert [what for what in described.saturated if 'wall' in what] == ['wall of joint2']


def test_hand_guiding_compensates_friction_beyond_the_model():
    rig = Rig('hand_guiding', hand_guiding__friction=0.5)
    law = rig.modes.laws[Mode.HAND_GUIDING]
    u = np.array([0.1, -0.2])
    torque_before = law.torque(rig.q, u, None, 0.0, 0.0)
    values = {'observer__friction__coulomb': [0.4, 0.2],
              'observer__friction__damping': [0.1, 0.3],
              'observer__friction__offset': [0.05, 0.0],
              'observer__friction__speed': 0.02}
    rig.adjust(**values)
    error = [0.05, 0.0] + np.array([0.4,
                                    0.2]) * np.tanh(u / 0.02) + np.array([0.1, 0.3]) * u
    np.testing.assert_allclose(law.torque(rig.q, u, None, 0.0, 0.0),
                               torque_before + 0.5 * error, atol=1e-12)
    rig.adjust(**values)
    assert not law.update(rig.values), 'nothing changed'
    with pytest.raises(InputError, match=r'observer\.friction\.coulomb'):
        rig.adjust(observer__friction__coulomb=[0.1] * 3)
