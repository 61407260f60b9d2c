"""The torque path of an arm with closed loops, without a ROS graph."""

from functools import cache
import time
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('rclpy')

from kane_dynamics import (  # noqa: E402, I100
    box, Controller, Motion, Robot, simulate, Terms)
from kane_dynamics.control.quasi_static import QuasiStatic  # noqa: E402
from kane_dynamics.loop_tracking.driven_mechanism import mechanism_motion  # noqa: E402
from kane_dynamics.loop_tracking.loop_error import (BRANCH, CONTRADICTION,  # noqa: E402
                                                    SINGULAR, UNKNOWN)
from kane_dynamics.mechanics.constraints.loop_closure import (  # noqa: E402
    closed_configuration)
from kane_dynamics.model.model import with_payload  # noqa: E402
from kane_dynamics.robot.robot import TORQUE_TERMS  # noqa: E402
from kane_dynamics.ros.common.node_statistics import Statistics  # noqa: E402
from kane_dynamics.ros.common.stamped_numbers import NOT_FINITE  # noqa: E402
from kane_dynamics.ros.doctor.live_graph import (  # noqa: E402
    examine_states, ReceivedState)
from kane_dynamics.ros.guard.guard_path import GuardPath  # noqa: E402
from kane_dynamics.ros.monitor_node.payload_monitor import PayloadMonitor  # noqa: E402
from kane_dynamics.ros.monitor_node.torque_samples import (  # noqa: E402
    MeasuredState, TorqueSample)
from kane_dynamics.ros.monitors.applied_torque import AppliedTorque  # noqa: E402
from kane_dynamics.ros.monitors.contact_monitor import (ContactMonitor,  # noqa: E402
                                                        ContactPublishers)
from kane_dynamics.ros.parameters.parameter_checks import read  # noqa: E402
from kane_dynamics.ros.parameters.parameter_table import CONSTANTS, SPECS  # noqa: E402
from kane_dynamics.ros.plant.plant_parameters import SPECS as PLANT_SPECS  # noqa: E402
from kane_dynamics.ros.plant.plant_state import PlantState  # noqa: E402
from kane_dynamics.ros.torque_path.closed_loop_reader import (  # noqa: E402
    ClosedLoopReader, commanded_joints)
from kane_dynamics.ros.torque_path.drop_reasons import (  # noqa: E402
    MISSING, NO_TORQUE, OUTSIDE, REFUSED, STALE, TWICE)
from kane_dynamics.ros.torque_path.torque_path import TorquePath  # noqa: E402
from native_rig import python_path  # noqa: E402
from node_values import monitor_values, node_values, UNCHECKED  # noqa: E402
from palletizer import (bending_palletizer, DRIVEN, palletizer, positions,  # noqa: E402
                        SINGULAR_SHOULDER)
from rclpy.serialization import deserialize_message, serialize_message  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from std_msgs.msg import Float64MultiArray  # noqa: E402

NANO = 10**9
VALUES = UNCHECKED
POSE = (0.2, 0.3, -0.1, 0.5)  # of the driven joints
MOTION = Motion.from_points([0.0, 2.0], [POSE, (0.5, 0.1, 0.2, -0.5)],
                            joint_names=DRIVEN)


class Publisher:
    """Keeps the published messages."""

    def __init__(self, kind):
        self.sent = []
        self.kind = kind
        self.last = b''

    def publish(self, message):
        self.last = message
        self.sent.append(deserialize_message(message, self.kind))


class Rig:
    """A torque path of the palletizer with a manual clock."""

    make = TorquePath

    def __init__(self, robot=None, checks=None, **settings):
        self.time, self.robot = 100 * NANO, robot or palletizer()
        self.commands, self.torques = Publisher(Float64MultiArray), Publisher(JointState)
        self.statistics = Statistics()
        self.details = []
        controller = Controller(self.robot, **settings)
        values = node_values(VALUES | (checks or {}))
        self.path = self.make(
            controller, self.commands, self.torques, lambda: self.time, values,
            self.statistics, lambda *words: self.details.append(words),
            loops=ClosedLoopReader(controller, values))
        self.path.start()

    def state(self, driven=POSE, rates=(0.0,) * 4, others=None, age=0.0,
              efforts=None):
        """Pass a state of the driven joints, and of others; return the new commands."""
        self.time += NANO // 500
        joints = dict(zip(DRIVEN, driven)) | (others or {})
        speeds = dict.fromkeys(joints, 0.0) | dict(zip(DRIVEN, rates))
        message = JointState(name=list(joints), position=list(joints.values()),
                             velocity=list(speeds.values()))
        if efforts is not None:
            message.effort = [efforts.get(name, 0.0) for name in joints]
        stamp = message.header.stamp
        stamp.sec, stamp.nanosec = divmod(self.time - round(age * NANO), NANO)
        count_before = len(self.commands.sent)
        self.path.on_state(serialize_message(message))
        return [np.array(sent.data) for sent in self.commands.sent[count_before:]]

    def complete(self, driven=POSE, **changes):
        """Return the other joints of a closed configuration."""
        q = dict(zip(self.robot.joint_names, positions(self.robot, *driven)))
        return {name: x for name, x in (q | changes).items() if name not in DRIVEN}

    def follow(self, motion=MOTION):
        active = self.path.active_motion
        assert active.follow(motion, self.time, self.time, active.generation)


@pytest.fixture(autouse=True, params=[TorquePath, python_path],
                ids=['compiled law', 'law in Python'])
def of_each_kind(request, monkeypatch):
    """Run each case with compiled laws, and with laws that Python evaluates."""
    monkeypatch.setattr(Rig, 'make', staticmethod(request.param))


@cache
def of_driven():
    return [palletizer().joint_names.index(name) for name in DRIVEN]


def gravity(driven=POSE):
    robot = palletizer()
    q = positions(robot, *driven)
    return robot.joint_torques(robot.gravity_force(q), q)[sorted(of_driven())]


def in_order(values):
    """Return values of DRIVEN in the order of the commands: that of the joints."""
    return np.array(values)[np.argsort(of_driven())]


@pytest.mark.parametrize('complete', [False, True])
def test_commands_are_the_torques_of_the_actuated_joints(complete):
    rig = Rig()
    command, = rig.state(others=rig.complete() if complete else None)
    np.testing.assert_allclose(command, gravity(), rtol=1e-9, atol=1e-9)
    torques = rig.torques.sent[-1]
    assert torques.name == [rig.robot.joint_names[k] for k in sorted(of_driven())]
    assert list(torques.effort) == list(command)


def test_the_configuration_is_unknown_until_a_state_is_accepted():
    rig = Rig()
    assert rig.path.measured() is None
    rig.state(others=rig.complete(elbow=2.0))
    assert rig.path.measured() is None
    rig.state()
    np.testing.assert_allclose(rig.path.measured(), positions(rig.robot, *POSE),
                               atol=1e-9)
    rig.path.start()
    assert rig.path.measured() is None


def test_feedforward_follows_the_motion_of_the_measured_joints():
    rig = Rig()
    rig.state()
    rig.follow()
    robot = rig.robot
    for k in range(1, 400):
        q_d, u_d, a_d = MOTION.sample(k * 0.002)
        command, = rig.state(q_d, u_d)
        if k % 80 == 0:  # u are the rates of the driven joints
            q = positions(robot, *q_d)
            u = dict(zip(DRIVEN, u_d))
            a = dict(zip(DRIVEN, a_d))
            tau = robot.inverse_dynamics(q, *([x[name] for name in robot.speed_names]
                                              for x in (u, a)))
            expected = robot.joint_torques(tau, q)[sorted(of_driven())]
            np.testing.assert_allclose(command, expected, rtol=1e-8, atol=1e-8)
    assert not rig.statistics.dropped


def test_computed_torque_holds_the_first_pose():
    rig = Rig(mode='computed_torque', kp=100.0, kd=20.0)
    first, = rig.state()
    np.testing.assert_allclose(first, gravity(), rtol=1e-9, atol=1e-9)
    near = np.array(POSE) + [0.0, 0.01, 0.0, 0.0]
    second, = rig.state(near)
    M = rig.robot.mass_matrix(positions(rig.robot, *near))
    expected = gravity(near) - 100.0 * 0.01 * in_order(M[1])
    np.testing.assert_allclose(second, expected, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize('mode',
                         ['inverse_dynamics', 'computed_torque', 'gravity_compensation'])
def test_after_contradictory_joints_the_last_command_goes_on(mode):
    rig = Rig(mode=mode)
    held, = rig.state()
    if mode != 'gravity_compensation':
        rig.follow()
    away = rig.complete(elbow=rig.complete()['elbow'] + 0.03)
    for _ in range(3):
        again, = rig.state(others=away)
        assert again.tolist() == held.tolist()
    assert rig.statistics.dropped == {CONTRADICTION: 3}
    assert "'elbow' at" in rig.details[0][1]
    assert rig.path.active_motion.desired(
        rig.time) is not None or mode == 'gravity_compensation'
    rig.path.active_motion.clear('test')
    near = rig.complete(elbow=rig.complete()['elbow'] + 0.01)
    command, = rig.state(others=near)
    np.testing.assert_allclose(command, gravity(), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(rig.path.loops.tracker.deviation, 0.01, rtol=1e-6)


@pytest.mark.parametrize('action', ['zero', 'hold'])
def test_a_contradiction_that_lasts_ends_in_zeros_or_holds_as_configured(action):
    rig = Rig(checks={'state_check.action': action})
    rig.state()
    rig.follow()
    away = rig.complete(elbow=rig.complete()['elbow'] + 0.03)
    commands = [command for _ in range(40) for command in rig.state(others=away)]
    assert rig.path.fault == CONTRADICTION and rig.statistics.faults == 1
    assert rig.path.active_motion.desired(rig.time) is None
    if action == 'zero':
        assert [bool(command.any()) for command in commands] == [True] * 26 + [False]
    else:
        assert len(commands) == 40
        np.testing.assert_allclose(commands[-1], gravity(), rtol=1e-9, atol=1e-9)
    command, = rig.state()
    np.testing.assert_allclose(command, gravity(), rtol=1e-9, atol=1e-9)
    assert rig.path.fault == ''


@pytest.mark.parametrize('mode', ['computed_torque', 'gravity_compensation'])
@pytest.mark.parametrize('value', [1e100, 1e154, -1e200, 1e308])
@pytest.mark.parametrize('field', ['a further joint', 'a driven joint'])
def test_after_a_finite_position_beyond_reason_the_last_command_goes_on(
        field, value, mode):
    rig = Rig(mode=mode)
    held, = rig.state()
    further = next(iter(rig.complete()))
    again, = (rig.state(others={further: value}) if field == 'a further joint' else
              rig.state((value, *POSE[1:])))
    assert again.tolist() == held.tolist()
    (reason, detail), = rig.details
    name = further if field == 'a further joint' else DRIVEN[0]
    assert reason == (CONTRADICTION if field == 'a further joint' else OUTSIDE)
    assert f"'{name}'" in detail and f'{value:.6g}' in detail
    command, = rig.state()
    np.testing.assert_allclose(command, gravity(), rtol=1e-9, atol=1e-9)
    assert len(rig.details) == 1


@pytest.mark.parametrize('value', [1e154, -1e200, 1e308])
def test_a_state_whose_rates_give_no_finite_torque_is_dropped(value):
    rig = Rig(mode='computed_torque', kp=100.0, kd=20.0)
    held, = rig.state()
    again, = rig.state(rates=(value, 0.0, 0.0, 0.0))
    assert again.tolist() == held.tolist()
    assert rig.statistics.dropped == {NO_TORQUE: 1}
    command, = rig.state()
    np.testing.assert_allclose(command, gravity(), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize('value', [1e100, -1e308])
def test_torques_of_gravity_do_not_depend_on_rates(value):
    rig = Rig(mode='gravity_compensation')
    command, = rig.state(rates=(value, 0.0, 0.0, 0.0))
    np.testing.assert_allclose(command, gravity(), rtol=1e-9, atol=1e-9)


def test_one_false_state_beyond_a_singularity_does_not_lose_the_assembly_mode():
    rig = Rig()
    rig.state()
    held, = rig.state()
    again, = rig.state((0.2, SINGULAR_SHOULDER - 0.5, -0.1, 0.5))
    assert again.tolist() == held.tolist()
    assert rig.statistics.dropped == {SINGULAR: 1}
    command, = rig.state()
    np.testing.assert_allclose(command, gravity(), rtol=1e-9, atol=1e-9)


def approach(rig, end, speed=2.0):
    """Pass states of a shoulder at 2 rad/s; `speed` is the reported one."""
    commands = []
    for shoulder in np.arange(0.3, end, -0.004):
        commands += rig.state((0.2, shoulder, -0.1, 0.5), (0.0, -speed, 0.0, 0.0))
    return commands


def test_past_a_singular_configuration_the_assembly_mode_is_unknown():
    rig = Rig()
    commands = approach(rig, SINGULAR_SHOULDER - 0.15)
    assert set(rig.statistics.dropped) == {SINGULAR, UNKNOWN}
    assert rig.statistics.dropped[SINGULAR] == 1
    assert not commands[-1].any() and rig.state() == []
    command, = rig.state(others=rig.complete())  # all joints show the mode
    np.testing.assert_allclose(command, gravity(), rtol=1e-9, atol=1e-9)
    assert len(rig.state()) == 1


@pytest.mark.parametrize('speed', [2.0, 0.0])  # zero: as of a driver without velocities
def test_a_short_visit_to_a_singularity_makes_the_assembly_mode_unknown(speed):
    rig = Rig()
    approach(rig, SINGULAR_SHOULDER, speed)
    assert rig.statistics.dropped[SINGULAR] == 1
    dropped = rig.statistics.dropped.total()
    # Within the grace time.
    for shoulder in SINGULAR_SHOULDER + np.arange(0.01, 0.1, 0.01):
        rig.state((0.2, shoulder, -0.1, 0.5), (0.0, speed, 0.0, 0.0))
    assert rig.statistics.dropped.total() == dropped + 9
    assert rig.statistics.dropped[SINGULAR] == 1


def test_without_a_given_assembly_mode_the_first_state_needs_all_joints():
    robot = palletizer(configuration=None)
    names = palletizer().joint_names
    start = positions(robot, *POSE)
    # The other intersection of two circles; the loop behind it turns along.
    for name, angle in (('triangle_pin', -3.0), ('rod_1_pin', 0.5), ('wrist_pin', -3.0),
                        ('rod_2_pin', 3.0)):
        start[names.index(name)] += angle
    flipped = closed_configuration(robot.mechanism, start, fixed=DRIVEN)
    assert np.abs(flipped - positions(robot, *POSE)).max() > 0.1
    mode = {name: x for name, x in zip(names, flipped) if name not in DRIVEN}
    rig = Rig(robot)
    assert rig.state() == [] and rig.statistics.dropped == {UNKNOWN: 1}
    for command, in (rig.state(others=mode), rig.state()):
        expected = robot.joint_torques(robot.gravity_force(flipped), flipped)
        np.testing.assert_allclose(command, expected[sorted(of_driven())],
                                   rtol=1e-9, atol=1e-9)
    with_mode = Rig()  # the file states another mode
    assert with_mode.state(others=mode) == []
    assert with_mode.statistics.dropped == {CONTRADICTION: 1}


def test_lost_and_late_states_are_named_and_give_no_torque():
    rig = Rig()
    held, = rig.state()
    assert rig.state(age=0.2) == []
    message = JointState(name=list(DRIVEN[:3]), position=[0.0] * 3, velocity=[0.0] * 3)
    rig.path.on_state(serialize_message(message))
    again, = rig.state(others=rig.complete(elbow=np.nan))
    assert again.tolist() == held.tolist()
    assert rig.statistics.dropped == {STALE: 1, MISSING: 1, NOT_FINITE: 1}
    rig.time += NANO // 5
    rig.path.check_timeout()
    assert not np.array(rig.commands.sent[-1].data).any()
    command, = rig.state((0.4, 0.1, 0.2, 0.0))  # it moved meanwhile
    np.testing.assert_allclose(command, gravity((0.4, 0.1, 0.2, 0.0)),
                               rtol=1e-9, atol=1e-9)


def test_a_motion_into_a_singular_configuration_is_dropped_and_the_pose_held():
    rig = Rig()
    rig.state()
    end = (0.2, SINGULAR_SHOULDER - 0.2, -0.1, 0.5)
    rig.follow(Motion.from_points([0.0, 1.0], [POSE, end], joint_names=DRIVEN))
    for _ in range(500):
        rig.state()
        if rig.statistics.dropped:
            break
    assert rig.statistics.dropped == {REFUSED: 1}
    assert rig.path.active_motion.desired(rig.time) is None
    command, = rig.state()
    np.testing.assert_allclose(command, gravity(), rtol=1e-9, atol=1e-9)


def test_each_reason_has_its_own_text():
    assert len({BRANCH, CONTRADICTION, SINGULAR, UNKNOWN, REFUSED}) == 5


def all_values(**changes):
    values = CONSTANTS | {spec.name: read(spec, spec.default) for spec in SPECS}
    return values | {'arm_compensates': ('none',)} | changes


def test_the_guard_holds_an_arm_with_closed_loops(monkeypatch):
    rig = Rig()
    monkeypatch.setattr(time, 'perf_counter', lambda: rig.time / NANO)
    held, = rig.state()
    values = all_values(**{'limits.rate': np.array(np.inf)},
                        **UNCHECKED)
    controller = Controller(palletizer())
    guard = GuardPath(controller, rig.commands, rig.torques, lambda: rig.time, values,
                      Statistics(), lambda *words: None, lambda *words: None)
    guard.start()
    guard.on_torques(rig.torques.last)
    guard.watch.known, rig.path = True, guard
    commands = []
    for _ in range(12):
        commands += rig.state()
    assert 3 <= len(commands) <= 6  # after the lease
    np.testing.assert_allclose(commands, [held] * len(commands), rtol=1e-9, atol=1e-9)
    moving, = rig.state(rates=(0.0, 0.1, 0.0, 0.0))
    robot = palletizer()
    q = positions(palletizer(), *POSE)
    # Of DRIVEN, which are the independent speeds in order.
    u = np.array([0.0, 0.1, 0.0, 0.0])
    tau = robot.bias_force(q, u) - robot.mass_matrix(q) @ (20.0 * u)
    friction = robot.torque_terms(q, u, 0.0 * u)[TORQUE_TERMS.index('friction')]
    expected = robot.joint_torques(tau - friction, q)[sorted(of_driven())]
    np.testing.assert_allclose(moving, expected, rtol=1e-9, atol=1e-9)
    false = [command for _ in range(30)
             for command in rig.state(others=rig.complete(elbow=1.0))]
    np.testing.assert_array_equal(false[:26], [moving] * 26)
    assert not false[26].any() and len(false) == 27


class Broken:
    """Collects the messages of a monitor, serialized or not."""

    def __init__(self):
        self.sent = []

    def publish(self, message):
        self.sent.append(message)


@pytest.mark.parametrize('kind, gravity_reported', [
    ('motor_torque', True), ('motor_torque', False), ('joint_torque', True),
    ('joint_torque', False), ('motor_current', True), ('motor_current', False)])
@pytest.mark.parametrize('measured', [False, True])
def test_the_observer_estimates_the_external_torque_of_the_independent_joints(
        measured, kind, gravity_reported):
    rig = Rig()
    topics = ContactPublishers(Broken(), Broken(), Broken())
    constants = np.array([4.0, 5.0, 2.0, 3.0] if kind == 'motor_current' else [])
    values = all_values(
        **{'observer.threshold': np.array(30.0), 'cartesian.frame': 'tool',
           'efforts.kind': kind, 'efforts.gravity': gravity_reported,
           'efforts.constants': constants})
    rejected = []
    monitor = ContactMonitor(
        rig.robot, values, topics,
        SimpleNamespace(warning=rejected.append, info=rejected.append),
        lambda *words: rejected.append(words))
    rig.path.add_observer(monitor, need_effort=True)
    rig.path.stop()
    rig.path.start()
    external = np.array([0.0, 50.0, 0.0, 0.0])
    names = rig.robot.joint_names
    torque = dict(zip([names[k] for k in sorted(of_driven())],
                      gravity() * gravity_reported))
    torque['shoulder'] -= 50.0 * measured  # at rest, so something else holds the rest
    if kind == 'motor_current':
        torque = dict(zip(torque, np.array([*torque.values()]) / constants))
    for _ in range(200):
        rig.state(efforts=torque if measured else None)
    assert not [words for words in rejected if not isinstance(words, str)]
    np.testing.assert_allclose(monitor._observer.torque, external * measured, atol=1e-3)
    assert monitor.detector.joint == ('shoulder' if measured else None)
    published = deserialize_message(topics.torques.sent[-1], JointState)
    assert tuple(published.name) == rig.robot.speed_names
    assert len(topics.wrench.sent) == len(topics.torques.sent)


@pytest.mark.parametrize('off', [None, 'friction', 'gravity', 'coriolis'])
def test_torque_of_deflected_beams_is_that_of_the_rigid_model_whatever_the_arm_adds(off):
    flexible, rigid = bending_palletizer()
    bent = QuasiStatic(flexible)
    at_rest = np.zeros(4)
    q = positions(rigid, *POSE)
    u = np.array([0.1, -0.2, 0.3, 0.4])
    values = all_values(
        **{'observer.torque': 'command', 'arm_compensates': (off or 'none',)})
    terms = Terms(**({off: False} if off else {}))
    command = np.zeros(rigid.n_q)
    command[[rigid.joint_names.index(name) for name in DRIVEN]] = (
        terms.weights @ bent.torque_terms(q, u, at_rest))
    state = SimpleNamespace(has_velocity=True, has_effort=False, q=q, u=u)
    torques = AppliedTorque(
        rigid, values, lambda *words: pytest.fail(str(words)), bent).torque(
            state, command, None)
    expected = rigid.inverse_dynamics(q, u, at_rest)
    assert np.abs(bent.inverse_dynamics(q, u, at_rest) - expected).max() > 0.1
    np.testing.assert_allclose(torques, expected, atol=1e-6)


def test_the_doctor_examines_the_joints_that_are_needed():
    robot = palletizer()
    q = positions(palletizer(), *POSE)
    complete = dict(zip(robot.joint_names, q))

    def findings(joints, sign=1.0):
        """Return the texts of findings at rest, by level; efforts hold the weight."""
        names = [robot.joint_names[k] for k in sorted(of_driven())]
        held = dict(zip(names, gravity()))
        message = JointState(name=list(joints), position=list(joints.values()),
                             velocity=[0.0] * len(joints),
                             effort=[sign * held.get(name, 0.0) for name in joints])
        message.header.stamp.sec = 1000
        received = [ReceivedState(k * 10_000_000, 1000 * NANO, message)
                    for k in range(100)]
        texts = {}
        for finding in examine_states(robot, received, 1.0):
            texts.setdefault(finding.level, []).append(finding.words)
        return texts
    driven = {name: complete[name] for name in DRIVEN}
    for joints in (driven, complete):
        texts = findings(joints)
        assert list(texts) == ['fine']
        assert 'closed loops: residual' in '\n'.join(texts['fine'])
        assert 'at rest the measured efforts hold 100% of the weight' in texts['fine']
        assert 'opposite sign' in '\n'.join(findings(joints, -1.0)['problem'])
    open_loop = complete | {'elbow': 1.0}
    assert "'elbow' at" in '\n'.join(findings(open_loop)['problem'])
    (words,) = findings({'swivel': 0.0})['problem']
    assert words.startswith(
        'joint states: shoulder, lever_drive, turn missing among swivel')


def test_a_passive_joint_that_is_named_twice_drops_the_state():
    rig = Rig()
    names = [*DRIVEN, 'elbow', 'elbow']
    rig.path.on_state(serialize_message(JointState(
        name=names, position=[*POSE, -0.4, -0.4], velocity=[0.0] * 6)))
    assert rig.statistics.dropped == {TWICE: 1}


def test_the_plant_moves_as_simulated_and_stays_closed_at_its_stops():
    robot = palletizer()
    values = {spec.name: read(spec, spec.default) for spec in PLANT_SPECS}
    arm = PlantState(robot, values).arm
    np.testing.assert_allclose(arm.q, positions(robot, 0.0, 0.0, 0.0, 0.0), atol=1e-10)
    start = positions(robot, *POSE)
    arm.reset(start)
    torques = robot.joint_torques(robot.gravity_force(start), start)
    torques[of_driven()] += [50.0, 40.0, -30.0, 5.0]
    run = simulate(robot, start, np.zeros(4), 0.2, step=1e-3,
                   torque=lambda t, q, u: robot.generalized_force(torques, q))
    for _ in range(200):
        arm.step(torques)
    # Simulate varies T in a step.
    np.testing.assert_allclose(arm.q, run.q[-1], atol=1e-5)
    np.testing.assert_allclose(arm.u, robot.joint_rates(run.q[-1], run.u[-1]), atol=1e-4)
    for _ in range(1500):  # it falls onto its stops
        arm.step(0.0 * torques)
    assert arm.at_stops and arm.stop_contacts and arm.energy.warning == ''
    assert np.abs(robot.constraint_residual(arm.q)).max() < 1e-9
    assert (arm.q >= arm.lower - 1e-9).all() and (arm.q <= arm.upper + 1e-9).all()


# Of the motors in the robot's order.
@pytest.mark.parametrize(('further', 'sigma'), [
    ((), []), (('elbow',), [20.0, 20.0, 20.0, 2.0, 20.0])])
def test_the_payload_is_estimated_from_the_torques_of_the_motors(further, sigma):
    load = box(20.0, (0.3, 0.2, 0.4), at=(0.05, 0.02, 0.25))
    robot = palletizer(actuated=(*DRIVEN, *further))
    heavy = Robot(with_payload(robot.model, 'tool', load), **robot.options)
    values = monitor_values({'payload.frame': 'tool',
                             'estimator.torque_deviation': sigma})
    rejected = []
    monitor = PayloadMonitor(robot, values, lambda *words: rejected.append(words))
    applied = AppliedTorque(robot, values, lambda *words: rejected.append(words))
    motors = list(commanded_joints(robot, robot.speed_names))
    times = 0.01 * np.arange(900)
    w = np.array([0.7, 1.1, 1.3, 3.7])
    a = np.array([0.5, 0.3, 0.3, 1.0])
    s = np.sin(np.outer(times, w))
    c = np.cos(np.outer(times, w))
    motion = mechanism_motion(robot, DRIVEN, times, a * s + POSE, a * w * c,
                              -a * w**2 * s)
    efforts = heavy.joint_torques(heavy.inverse_dynamics(*motion), motion.q)[:, motors]
    for k, (q, u, effort) in enumerate(zip(motion.q, motion.u, efforts)):
        torque = applied.torque(MeasuredState(q, u, effort, has_effort=True), None, None)
        monitor.add(TorqueSample(NANO + k * NANO // 100, q, u, torque))
    published = [monitor.message()]
    assert not rejected
    assert abs(published[-1].mass - load.mass) < 0.02 * load.mass
    assert published[-1].mass_deviation < 0.1 * load.mass
    assert abs(published[-1].com.x - load.com[0]) < 5e-3
    assert abs(published[-1].com.y - load.com[1]) < 5e-3
