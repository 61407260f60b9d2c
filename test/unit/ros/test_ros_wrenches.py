"""Wrench input (sign, axes, rejected messages), and contact monitor."""

from dataclasses import replace
import math

import numpy as np
import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import WrenchStamped  # noqa: E402, I100
from kane_dynamics import Controller, load_urdf, Robot, Terms  # noqa: E402
from kane_dynamics._util.resources import resource_path  # noqa: E402
from kane_dynamics.errors import InputError  # noqa: E402
from kane_dynamics.ros.common.node_statistics import Statistics  # noqa: E402
from kane_dynamics.ros.common.stamped_numbers import (  # noqa: E402
    FUTURE, MALFORMED, NOT_FINITE, OUT_OF_ORDER)
from kane_dynamics.ros.loads import wrench_input  # noqa: E402
from kane_dynamics.ros.loads.gravity_payload import GravityAndPayload  # noqa: E402
from kane_dynamics.ros.loads.wrench_input import (  # noqa: E402
    FRAME, LARGE, largest_wrench, STALE, TIMED_OUT, WrenchInput)
from kane_dynamics.ros.monitors.contact_monitor import (ContactMonitor,  # noqa: E402
                                                        ContactPublishers)
from kane_dynamics.ros.monitors.optional_topics import (  # noqa: E402
    check_optional_topics)
from kane_dynamics.ros.parameters.parameter_checks import read  # noqa: E402
from kane_dynamics.ros.parameters.parameter_table import BY_NAME  # noqa: E402
from kane_dynamics.ros.torque_path.torque_path import TorquePath  # noqa: E402
from node_values import node_values, UNCHECKED  # noqa: E402
from rclpy.serialization import deserialize_message, serialize_message  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from std_msgs.msg import Float64MultiArray  # noqa: E402

MODEL = load_urdf(resource_path('urdf', 'two_link.urdf'))
FIRST, TIP = (body.name for body in MODEL.bodies)
ROBOT = Robot(MODEL, wrench_frames=(TIP, FIRST))
Q = np.array([0.7, -0.4])
NANO = 10**9


class Sink:
    """Keeps the published messages."""

    def __init__(self, kind):
        self.sent = []
        self.kind = kind

    def publish(self, message):
        self.sent.append(deserialize_message(message, self.kind)
                         if isinstance(message, bytes) else message)


class Log:
    """Keeps the log lines."""

    def __init__(self):
        self.lines = []
        self.info = self.warning = self.lines.append


class Rig:
    """A torque path with wrench input, contact monitor and a manual clock."""

    def __init__(self, mode='inverse_dynamics', arm_compensates=('none',), efforts=None,
                 rise=0.0, **changes):
        self.time, self.rejected, self.log = 100 * NANO, [], Log()
        changed = {f'observer.{name}': value for name, value in changes.items()}
        self.values = node_values(UNCHECKED | changed)
        self.values |= {'arm_compensates': arm_compensates, 'wrench.rise_time': rise,
                        'wrench.max_force': 1000.0, 'wrench.max_moment': 300.0} | {
            f'efforts.{name}': read(BY_NAME[f'efforts.{name}'], value)
            for name, value in (efforts or {}).items()}
        self.commands = Sink(Float64MultiArray)
        self.outputs = ContactPublishers(Sink(JointState), Sink(WrenchStamped),
                                         Sink(None))
        compensate = Terms(gravity='gravity' not in arm_compensates)
        self.path = TorquePath(
            Controller(ROBOT, mode=mode, compensate=compensate), self.commands,
            Sink(JointState),
            lambda: self.time, self.values, Statistics(), lambda *words: None)
        self.wrenches = self.path.wrenches = WrenchInput(ROBOT, lambda: self.time,
                                                         self.values, self.reject)
        self.wrenches.changed = self.path.law_changed
        self.contact = ContactMonitor(ROBOT, self.values, self.outputs, self.log,
                                      self.reject)
        self.path.add_observer(self.contact, need_effort=True)
        self.path.start()

    def reject(self, reason, detail):
        self.rejected.append(reason)

    def wrench(self, numbers, frame=TIP, age=0.0):
        message = WrenchStamped()
        message.header.frame_id = frame
        stamp = message.header.stamp
        stamp.sec, stamp.nanosec = divmod(self.time - round(age * NANO), NANO)
        force = message.wrench.force
        torque = message.wrench.torque
        force.x, force.y, force.z, torque.x, torque.y, torque.z = map(float, numbers)
        self.wrenches.on_message(serialize_message(message))

    def state(self, effort=(), after=0.01, q=Q):
        """Advance the clock, pass a state to the path, return the command."""
        self.time += round(after * NANO)
        message = JointState(name=list(ROBOT.joint_names), position=list(q),
                             velocity=[0.0, 0.0], effort=list(effort))
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(self.time, NANO)
        self.path.on_state(serialize_message(message))
        return np.array(self.commands.sent[-1].data)


def load(numbers, frame=TIP):
    """Return the joint torques of a wrench in axes of its frame, by the Jacobian."""
    R = ROBOT.frame_pose(frame, Q)[:3, :3]
    world = np.concatenate([R @ numbers[:3], R @ numbers[3:]])
    return ROBOT.jacobian(frame, Q).T @ world


PUSH = np.array([3.0, -2.0, 5.0, 0.5, 1.5, -0.2])


@pytest.mark.parametrize('mode', ['inverse_dynamics', 'computed_torque'])
def test_the_command_compensates_known_wrenches(mode):
    rig = Rig(mode)
    gravity = rig.state()
    rig.wrench(PUSH)
    rig.wrench(2.0 * PUSH, FIRST)
    np.testing.assert_allclose(rig.state(),
                               gravity - load(PUSH) - load(2.0 * PUSH, FIRST),
                               rtol=1e-12)


def test_gravity_compensation_does_not_compensate_wrenches():
    rig = Rig('gravity_compensation')
    gravity = rig.state()
    rig.wrench(PUSH)
    np.testing.assert_array_equal(rig.state(), gravity)


def test_a_single_wrench_moves_nothing_and_a_false_one_little():
    rig = Rig(rise=0.5)
    gravity = rig.state()
    rig.wrench([1000.0, 0, 0, 0, 0, 0])
    np.testing.assert_array_equal(rig.state(), gravity)
    # 1000 N in 0.5 s: 10 ms later at most 20 N.
    rig.wrench([900.0, 0, 0, 0, 0, 0])
    expected = gravity - load(np.array([20.0, 0, 0, 0, 0, 0]))
    np.testing.assert_allclose(rig.state(), expected, rtol=1e-12)
    # After a timeout it begins again, also without a state in between.
    rig.state(after=0.2)
    for pause in (0.0, 0.15):
        rig.time += round(pause * NANO)
        rig.wrench([900.0, 0, 0, 0, 0, 0])
        np.testing.assert_array_equal(rig.state(), gravity)


@pytest.mark.parametrize('name', ['two_link', 'fr3', 'ur10e'])
def test_the_effort_limits_hold_the_largest_wrench_by_default(name):
    model = load_urdf(resource_path('urdf', f'{name}.urdf'))
    tip = model.bodies[-1].name
    robot = Robot(model, wrench_frames=(tip,))
    values = node_values(UNCHECKED)
    force, moment = largest_wrench(robot, values)
    # Independently: the Jacobian of Robot, at other configurations.
    J = robot.jacobian(tip, robot.random_configuration(1, 2000))
    for rows, largest in ((slice(0, 3), force), (slice(3, 6), moment)):
        per_unit = np.linalg.norm(J[:, rows], axis=1).max(axis=0)
        with np.errstate(divide='ignore'):
            held = (robot.limits.effort / per_unit).min()
        assert 0.95 * held <= largest <= 1.1 * held
    halved = largest_wrench(robot, values | {'limits.effort': 0.5 * robot.limits.effort})
    np.testing.assert_allclose(halved, [0.5 * force, 0.5 * moment])
    stated = largest_wrench(robot, values | {'wrench.max_force': 7.0})
    np.testing.assert_allclose(stated, [7.0, moment])


def test_wrenches_need_a_bound_where_efforts_have_none():
    free = ROBOT.copy()
    free.limits = replace(ROBOT.limits, effort=np.full(2, np.inf))
    with pytest.raises(InputError, match=r"'wrench.max_force': 0, and no effort limit"):
        largest_wrench(free, node_values(UNCHECKED))


def test_a_timeout_unloads_its_frame_only():
    rig = Rig()
    gravity = rig.state()
    rig.wrench(PUSH, FIRST)
    rig.state(after=0.06)
    rig.wrench(PUSH)
    np.testing.assert_allclose(rig.state(after=0.06), gravity - load(PUSH), rtol=1e-12)
    assert rig.rejected == [TIMED_OUT]
    np.testing.assert_array_equal(rig.state(after=0.06), gravity)
    assert rig.rejected == [TIMED_OUT, TIMED_OUT]


@pytest.mark.parametrize(('reason', 'given'), [
    (STALE, {'age': 0.2}), (FUTURE, {'age': -0.2}), (OUT_OF_ORDER, {'age': 0.05}),
    (FRAME, {'frame': 'claw'}), (FRAME, {'frame': ''}),
    (NOT_FINITE, {'numbers': [0, 0, 0, 0, math.nan, 0]}),
    (NOT_FINITE, {'numbers': [math.inf, 0, 0, 0, 0, 0]}),
    (LARGE, {'numbers': [0, 0, 1e308, 0, 0, 0]}),
    (LARGE, {'numbers': [0, 0, 0, -301, 0, 0]})])
def test_an_invalid_wrench_is_rejected_with_the_reason_and_the_last_one_stays(
        reason, given):
    rig = Rig()
    rig.wrench(PUSH)
    torque_before = rig.state(after=0.0)
    rig.wrench(**{'numbers': 9.0 * PUSH, **given})
    assert rig.rejected == [reason]
    np.testing.assert_array_equal(rig.state(after=0.001), torque_before)


def test_malformed_messages_are_rejected_and_what_rclpy_reads_is_accepted():
    rig = Rig()
    gravity = rig.state()
    message = WrenchStamped()
    message.header.frame_id = TIP
    message.wrench.force.x = 4.0
    data = serialize_message(message)
    for end in range(len(data)):
        rig.wrenches.on_message(data[:end])
    assert set(rig.rejected) == {MALFORMED}
    np.testing.assert_array_equal(rig.state(), gravity)
    rig.wrenches.on_message(data)  # without a stamp: time of reception
    np.testing.assert_allclose(rig.state(), gravity - load(np.eye(6)[0] * 4.0),
                               rtol=1e-12)


def test_fixed_and_unknown_frames_are_refused_by_name():
    values = node_values()
    for name, words in (('claw', "no frame 'claw'"), (MODEL.base_name, 'does not move')):
        with pytest.raises(InputError, match=words):
            wrench_input.check_frames(MODEL, [name])
    with pytest.raises(InputError, match="no frame 'claw'"):
        check_optional_topics(
            values | {'observer.enabled': True, 'cartesian.frame': 'claw'}, ROBOT)


def gravity():
    return ROBOT.gravity_force(Q)


def test_measured_efforts_give_external_torques_wrench_and_collision():
    rig = Rig(threshold=[1.0, 0.5], rate=1e4)
    push = np.array([2.5, -0.8])
    assert [flag.data for flag in rig.outputs.collision.sent] == [False]
    for _ in range(50):
        rig.state(gravity() - push)
    published = np.array(rig.outputs.torques.sent[-1].effort)
    np.testing.assert_allclose(published, push, rtol=1e-6)
    message = rig.outputs.wrench.sent[-1]
    assert message.header.frame_id == TIP
    w = message.wrench
    recovered = np.array(
        [w.force.x, w.force.y, w.force.z, w.torque.x, w.torque.y, w.torque.z])
    np.testing.assert_allclose(load(recovered), push, rtol=1e-6)
    assert [flag.data for flag in rig.outputs.collision.sent] == [False, True]
    assert rig.contact.figures()['collision'] in ROBOT.joint_names
    assert any("collision at joint '" in line for line in rig.log.lines)
    for _ in range(50):
        rig.state(gravity())
    assert [flag.data for flag in rig.outputs.collision.sent] == [False, True, False]
    assert rig.contact.figures()['collision'] == 'none'


def test_a_known_wrench_is_not_a_collision():
    rig = Rig(threshold=0.1)
    for _ in range(100):
        rig.wrench(PUSH)
        rig.state(gravity() - load(PUSH))
    assert np.abs(np.array(rig.outputs.torques.sent[-1].effort)).max() < 1e-9
    assert not rig.contact.detector.collision


@pytest.mark.parametrize('gravity_by_arm', [False, True])
def test_without_efforts_the_observer_uses_the_command_and_the_terms_of_the_arm(
        gravity_by_arm):
    rig = Rig(arm_compensates=('gravity',) if gravity_by_arm else ('none',),
              threshold=0.1)
    for _ in range(100):
        rig.state(effort=(math.nan, math.nan))  # as of drivers without torque sensors
    assert np.abs(np.array(rig.outputs.torques.sent[-1].effort)).max() < 1e-9


@pytest.mark.parametrize(('efforts', 'reported'), [
    ({}, lambda tau: tau), ({'gravity': False}, lambda tau: tau - gravity()),
    ({'kind': 'motor_current', 'constants': [4.0, 0.5]}, lambda tau: tau / [4.0, 0.5]),
    ({'kind': 'joint_torque', 'gravity': False}, lambda tau: tau - gravity())])
def test_the_observer_finds_an_external_torque_from_every_kind_of_effort(
        efforts, reported):
    rig = Rig(threshold=0.1, torque='effort', efforts=efforts)
    for _ in range(5):
        rig.state(reported(gravity()))
    assert np.abs(np.array(rig.outputs.torques.sent[-1].effort)).max() < 1e-9
    for _ in range(100):
        rig.state(reported(gravity() - load(PUSH)))
    np.testing.assert_allclose(rig.outputs.torques.sent[-1].effort, load(PUSH),
                               rtol=1e-6)
    assert rig.contact.detector.collision
    assert rig.rejected == []


@pytest.mark.parametrize(('efforts', 'factor'), [
    ({}, 0.1), ({'gravity': False}, 1.0), ({}, 20.0), ({}, -1.0)])
def test_efforts_that_contradict_their_meaning_at_rest_are_named_once(efforts, factor):
    rig = Rig(threshold=0.1, torque='effort', efforts=efforts)
    for _ in range(5):
        rig.state(factor * gravity())
    assert rig.rejected == ['efforts contradict the model']


@pytest.mark.parametrize('garbage', [1e224, -1e5])
def test_an_effort_that_no_motor_has_is_dropped_and_counted(garbage):
    rig = Rig(threshold=0.1, torque='effort')
    weight = ROBOT.gravity_force(Q)
    for k in range(200):
        effort = weight + [garbage * (k == 50), 0.0]
        rig.state(effort=effort)
        assert not rig.contact.detector.collision
    assert rig.rejected == ['effort beyond its limit']
    assert np.abs(np.array(rig.outputs.torques.sent[-1].effort)).max() < 1e-9


def test_kinds_of_effort_that_the_observer_cannot_use_are_refused():
    for efforts, words in (({'kind': 'external_torque'},
                            'external_torque, which observer and'),
                           ({'kind': 'motor_current'}, 'without constants'),
                           ({'kind': 'motor_current', 'constants': [1.0, 2.0, 3.0]},
                            '3 entries; expected one number, or one')):
        with pytest.raises(InputError, match=words):
            Rig(efforts=efforts)
    Rig(torque='command', efforts={'kind': 'external_torque'})


def test_a_missing_torque_source_gives_a_reason_and_no_estimate():
    rig = Rig(torque='effort')
    rig.state(gravity())
    sent = len(rig.outputs.torques.sent)
    rig.state()
    assert rig.rejected == ['no effort']
    assert len(rig.outputs.torques.sent) == sent


def test_a_change_of_the_torque_source_resets_the_observer():
    rig = Rig(threshold=0.1)
    for k in range(60):
        rig.state(gravity() if k < 30 else ())
        assert not rig.contact.detector.beyond
    # Only the efforts contain the external torque, from this state on.
    rig.state(gravity() - 5.0)
    assert not rig.contact.detector.beyond


def test_the_observer_gets_new_gravity_before_the_next_state():
    rig = Rig()
    gravity_before = ROBOT.parameters.gravity
    gravities = []
    rig.contact.on_loads_changed = lambda: gravities.append(
        (ROBOT.parameters.gravity[2], rig.time))
    try:
        rig.state()
        rig.path.set_loads(GravityAndPayload(np.array([0.0, 0.0, -3.0])))
        rig.state()
        rig.state()
    finally:
        ROBOT.parameters.gravity = gravity_before
    assert gravities == [(-3.0, 100 * NANO + 2 * NANO // 100)]


def test_a_backward_clock_jump_drops_the_wrenches():
    rig = Rig()
    unloaded = rig.state()
    rig.wrench(PUSH)
    np.testing.assert_array_equal(rig.state(after=-50.0), unloaded)
    rig.wrench(PUSH)  # accepted, although its stamp precedes the last one
    np.testing.assert_allclose(rig.state(), unloaded - load(PUSH), rtol=1e-12)
    assert rig.rejected == []


def test_the_rate_limits_the_messages_but_not_the_flag():
    rig = Rig(threshold=[0.1, 0.1], rate=10.0, confirm=0.0)
    for k in range(101):
        rig.state(gravity() - (1.0 if k == 55 else 0.0), after=0.01)
    assert 10 <= len(rig.outputs.torques.sent) <= 12
    assert len(rig.outputs.wrench.sent) == len(rig.outputs.torques.sent)
    assert [flag.data for flag in rig.outputs.collision.sent] == [False, True, False]


def test_without_thresholds_no_flag_is_published_and_the_log_says_what_is_expected():
    rig = Rig(confirm=0.0)
    for _ in range(20):
        rig.state(gravity() - 20.0, after=0.01)
    assert rig.outputs.torques.sent
    assert not rig.outputs.collision.sent
    assert 'calibrate --collision' in ' '.join(rig.log.lines)
    assert rig.contact.figures()['collision'].startswith(
        'not detected: observer.threshold: empty')
    rig.contact.update(rig.values | {'observer.threshold': np.array(1.0)})
    assert [flag.data for flag in rig.outputs.collision.sent] == [False]
    rig.state(gravity() - 20.0, after=0.01)
    assert [flag.data for flag in rig.outputs.collision.sent] == [False, True]


def test_stated_friction_beyond_the_model_is_no_external_torque():
    offset = np.array([0.4, -0.3])
    rig = Rig(threshold=[0.1, 0.1], confirm=0.0, **{'friction.offset': offset.tolist()})
    for _ in range(50):
        rig.state(gravity() + offset, after=0.01)
    assert not rig.contact.detector.collision
    assert [flag.data for flag in rig.outputs.collision.sent] == [False]


def test_other_parameters_leave_the_adapted_friction():
    rig = Rig(threshold=[0.1, 0.1])
    friction = rig.contact._observer.friction_error
    rig.contact.update(rig.values | {'observer.clear': 0.3})
    assert rig.contact._observer.friction_error is friction
    rig.contact.update(rig.values | {'observer.friction.coulomb': np.array([0.2, 0.1])})
    assert rig.contact._observer.friction_error.coulomb.tolist() == [0.2, 0.1]
