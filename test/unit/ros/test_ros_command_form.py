"""Promises of the forms of commands: effort with scale, MIT mode, position offset."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from held_arms import held_arm  # noqa: E402, I100
from kane_dynamics import load_urdf, Motion, Robot  # noqa: E402
from kane_dynamics.control_cycle import cycle_rules  # noqa: E402
from kane_dynamics.errors import InputError  # noqa: E402
from kane_dynamics.ros.common.cdr import Reader  # noqa: E402
from kane_dynamics.ros.common.node_statistics import Statistics  # noqa: E402
from kane_dynamics.ros.parameters.parameter_checks import read  # noqa: E402
from kane_dynamics.ros.plant.plant_parameters import SPECS  # noqa: E402
from kane_dynamics.ros.plant.plant_state import PlantState  # noqa: E402
from kane_dynamics.ros.torque_path.path_controller import path_controller  # noqa: E402
from kane_dynamics.ros.torque_path.torque_path import TorquePath  # noqa: E402
from node_values import node_values  # noqa: E402
from rclpy.serialization import deserialize_message, serialize_message  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from std_msgs.msg import Float64MultiArray  # noqa: E402

NANO = 10**9
N = 5
# Geared servos: the inertia of their rotors is larger than that of the last links.
ROTORS = {'joints': {f'j{k + 1}': {'armature': 0.1} for k in range(N)}}
MODEL = load_urdf(held_arm(N, np.random.default_rng(3)).urdf(), supplement=ROTORS)
START = np.array([0.2, -0.5, 0.7, 0.3, -0.4])
STIFF, DAMPING = 50.0, 4.0  # N m/rad, N m s/rad
SCALE = [0.5, -2.0, 1.0, 1.5, 0.8]
MOTION = Motion.from_points([0.0, 1.0, 2.0], [START, START + 0.3, START],
                            joint_names=MODEL.joint_names)


class Commands:
    """Keeps the numbers of the last command."""

    numbers = None

    def publish(self, data):
        self.numbers = np.array(deserialize_message(data, Float64MultiArray).data)


class Ignored:
    """Keeps the bytes of the last message."""

    def publish(self, data):
        self.data = data


class Loop:
    """A torque path and a simulated arm with servos, cycle by cycle."""

    def __init__(self, form, mode='inverse_dynamics', scale=(), plant_scale=None,
                 stamped=False, **stated):
        drives = {'commands.form': form, 'efforts.scale': list(scale)}
        if form != 'effort':
            drives |= {'commands.stiffness': STIFF, 'commands.damping': DAMPING}
        changes = {**drives, 'initial.position': START.tolist(), 'rate': 500.0}
        if plant_scale is not None:
            changes['efforts.scale'] = list(plant_scale)
        specs = {spec.name: spec for spec in SPECS}
        values = {name: read(spec, changes.get(name, spec.default))
                  for name, spec in specs.items()}
        self.plant = PlantState(Robot(MODEL), values)
        self.commands = Commands()
        self.stamped = Ignored()
        self.time = NANO
        stated = node_values({**drives, 'mode': mode, **stated})
        self.path = TorquePath(path_controller(MODEL, stated), self.commands, Ignored(),
                               lambda: self.time, stated, Statistics(),
                               lambda *words: None,
                               stamped=self.stamped if stamped else None)
        self.path.start()

    def run(self, seconds):
        """Run cycles; return the positions, (k, n)."""
        rows = []
        for _ in range(round(500 * seconds)):
            self.time += NANO // 500
            for state in self.plant.tick(self.time):
                message = JointState(
                    name=list(MODEL.joint_names), position=state.q.tolist(),
                    velocity=state.u.tolist(), effort=state.effort.tolist())
                stamp = message.header.stamp
                stamp.sec, stamp.nanosec = divmod(state.stamp, NANO)
                self.path.on_state(serialize_message(message))
            if self.commands.numbers is not None:
                self.plant.command(self.commands.numbers)
            rows.append(self.plant.arm.measured[0].copy())
        return np.array(rows)

    def follow(self):
        """Follow the motion from now on."""
        active = self.path.active_motion
        assert active.follow(MOTION, self.time, self.time, active.generation)


def sag_without_offset():
    """Return how far servos that are told the start alone sag, by the weight, (n,)."""
    loop = Loop('position_offset')
    for _ in range(2000):
        loop.plant.command(START)
        list(loop.plant.tick(loop.plant.time))
    return np.abs(loop.plant.arm.measured[0] - START)


@pytest.mark.parametrize('form', ['position_offset', 'mit'])
def test_a_servo_sags_at_least_20_times_less_with_the_command(form):
    sag = sag_without_offset()
    assert sag.max() > 0.05
    loop = Loop(form)
    loop.run(4.0)
    assert np.abs(loop.plant.arm.measured[0] - START).max() < sag.max() / 20.0


@pytest.mark.parametrize('form', ['position_offset', 'mit'])
@pytest.mark.parametrize('scale', [(), SCALE])
def test_a_motion_is_followed_by_the_feedback_of_the_drives(form, scale):
    loop = Loop(form, scale=scale)
    loop.run(0.5)
    loop.follow()
    q = loop.run(2.0)
    desired = np.array([MOTION.sample(k / 500.0)[0] for k in range(len(q))])
    # A servo whose damping acts against the motion lags by damping over stiffness.
    lag = DAMPING / STIFF * np.abs(MOTION.sample(0.5)[1]).max()
    assert np.abs(q - desired).max() < (1.3 * lag if form == 'position_offset' else 5e-3)


@pytest.mark.parametrize('mode', ['computed_torque', 'gravity_compensation'])
@pytest.mark.parametrize('form', ['position_offset', 'mit'])
def test_other_modes_command_their_torque_through_the_drive(form, mode):
    loop = Loop(form, mode)
    loop.run(1.0)
    torque = loop.path._memory.tau.copy()
    weight = Robot(MODEL).gravity_force(loop.plant.arm.measured[0])
    np.testing.assert_allclose(torque, weight, atol=0.05)
    q, u = loop.plant.arm.measured
    applied = loop.plant.form.torque(loop.commands.numbers, q, u)
    np.testing.assert_allclose(applied, torque, atol=0.05)
    assert np.abs(q - START).max() < (0.02 if mode == 'computed_torque' else 0.2)


def test_the_scale_acts_on_commands_and_on_reported_efforts():
    plain = Loop('effort', 'computed_torque')
    scaled = Loop('effort', 'computed_torque', scale=SCALE)
    for loop in (plain, scaled):
        loop.follow()
    np.testing.assert_allclose(scaled.run(1.0), plain.run(1.0), atol=1e-9)
    np.testing.assert_allclose(scaled.commands.numbers * SCALE, plain.commands.numbers,
                               rtol=1e-6, atol=1e-6)
    effort = scaled.plant.arm.effort.copy()
    measured = next(iter(scaled.plant.tick(scaled.time)))
    np.testing.assert_allclose(measured.effort * SCALE, effort)


def test_a_stop_holds_position_servos_and_leaves_no_torque_to_mit():
    position = Loop('position_offset')
    position.run(0.5)
    position.path.stop()
    q = position.path._accepted()
    np.testing.assert_allclose(position.commands.numbers, q, atol=1e-12)
    mit = Loop('mit', scale=SCALE)
    mit.run(0.5)
    before = mit.commands.numbers.reshape(5, -1)
    np.testing.assert_allclose(before[2] * np.abs(SCALE), STIFF)
    mit.path.stop()
    _, velocity, stiffness, damping, torque = mit.commands.numbers.reshape(5, -1)
    assert not velocity.any() and not stiffness.any() and not torque.any()
    np.testing.assert_allclose(damping * np.abs(SCALE), DAMPING)


def test_the_damping_of_mit_acts_without_a_state():
    loop = Loop('mit', scale=SCALE)
    loop.path.stop()
    rows = loop.commands.numbers.reshape(5, -1)
    assert not rows[[0, 1, 2, 4]].any()
    np.testing.assert_allclose(rows[3] * np.abs(SCALE), DAMPING)


def test_a_position_that_is_unknown_is_not_commanded():
    loop = Loop('position_offset')
    loop.path.stop()
    assert loop.commands.numbers is None


@pytest.mark.parametrize('form', ['position_offset', 'mit'])
def test_the_torque_of_a_drive_stays_within_the_limit(form):
    loop = Loop(form)
    loop.run(0.5)
    limit = loop.path.controller.effort_limit
    far = loop.plant.arm.measured[0] + 3.0
    loop.path._pose = far  # as of a motion that left the arm behind
    loop.run(0.002)
    torque = loop.path.form.torque(loop.commands.numbers, loop.path._accepted(),
                                   loop.path._accepted_speeds())
    damped = torque + (DAMPING * loop.path._accepted_speeds()
                       if form == 'position_offset' else 0.0)
    assert (np.abs(damped) <= limit * (1.0 + 1e-9)).all()


@pytest.mark.parametrize(('changes', 'words'), [
    ({'commands.form': 'mit'}, r"'commands.stiffness'.*expected the positive stiffness"),
    ({'commands.form': 'position_offset', 'commands.stiffness': [1.0, 2.0]},
     r'expected one number'),
    ({'efforts.scale': [1.0, 0.0, 1.0, 1.0, 1.0]}, r"scale' of joint 'j2': 0; expected"),
])
def test_a_form_that_does_not_fit_is_refused(changes, words):
    stated = node_values(changes)
    with pytest.raises(InputError, match=words):
        TorquePath(path_controller(MODEL, stated), Commands(), Ignored(), lambda: NANO,
                   stated, Statistics(), lambda *words: None)


def shown_torque(loop):
    """Return the torque of the drives at the accepted state, (n,)."""
    path = loop.path
    u = path._accepted_speeds()
    torque = path.form.torque(loop.commands.numbers, path._accepted(), u)
    return torque + (DAMPING * u if path.form.kind == 'position_offset' else 0.0)


@pytest.mark.parametrize('form', ['position_offset', 'mit'])
@pytest.mark.parametrize('event', ['motion begins off the arm', 'silence',
                                   'mode changes', 'guard'])
def test_the_torque_of_a_drive_stays_within_the_rate_limit(form, event):
    loop = Loop(form)
    loop.run(0.5)
    path = loop.path
    rate = path.controller.rate_limit
    before = shown_torque(loop)
    if event in ('motion begins off the arm', 'silence'):
        points = [START + 0.5, START + 0.6]
        motion = Motion.from_points([0.0, 2.0], points, joint_names=MODEL.joint_names)
        active = path.active_motion
        assert active.follow(motion, loop.time, loop.time, active.generation)
    elif event == 'mode changes':
        path._pose = path._accepted() + 0.6  # the drives hold against a wrong model
        loop.run(0.2)
        before = shown_torque(loop)
        path.controller.update(mode='computed_torque')
        path.set_limits(node_values({'mode': 'computed_torque'}))
    else:  # torque_guard held the arm, which moved
        path._pose = path._accepted() + 0.3
        path._note_drop(path._memory.path, path._memory.path._replace(
            drops=path._memory.path.drops + 1.0, dropped_by=float(cycle_rules.BY_GUARD)),
            loop.time)
    for k in range(30):
        if event == 'silence' and k == 3:  # no state for 40 ms, while the torque grows
            loop.time += 40 * NANO // 1000
            list(loop.plant.tick(loop.time))
        loop.run(0.002)
        after = shown_torque(loop)
        assert (np.abs(after - before) <= rate * 0.004 * (1.0 + 1e-6) + 1e-9).all()
        before = after
    if event == 'guard':
        np.testing.assert_allclose(path._pose, path._accepted(), atol=0.02)


def test_the_damping_of_mit_acts_in_a_fault():
    loop = Loop('mit', **{'state_check.action': 'hold'})
    loop.run(0.3)
    loop.follow()
    loop.run(0.5)
    for _ in range(100):  # states that are not finite
        loop.time += NANO // 500
        message = JointState(name=list(MODEL.joint_names), position=[np.nan] * N,
                             velocity=[0.0] * N)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(loop.time, NANO)
        loop.path.on_state(serialize_message(message))
    assert loop.path.fault and loop.path.commanding
    _, velocity, stiffness, damping, torque = loop.commands.numbers.reshape(5, -1)
    assert not stiffness.any() and torque.any()
    np.testing.assert_allclose(damping, DAMPING)
    speed = np.abs(velocity).max()
    assert 0.0 < speed < np.abs(MOTION.sample(0.5)[1]).max()  # of the stop


@pytest.mark.parametrize(('form', 'interface'), [('effort', b'effort'),
                                                 ('position_offset', b'position')])
def test_stamped_commands_are_the_commands(form, interface):
    loop = Loop(form, scale=SCALE, stamped=True)
    loop.run(0.5)
    stamped = loop.stamped.data
    np.testing.assert_array_equal(np.frombuffer(stamped[-8 * N:]), loop.commands.numbers)
    assert interface in stamped
    assert np.abs(loop.commands.numbers - loop.path._memory.tau).max() > 0.1


def test_stamped_mit_commands_have_five_interfaces_of_each_joint():
    loop = Loop('mit', scale=SCALE, stamped=True)
    loop.run(0.5)
    reader = Reader(loop.stamped.data)
    stamp = reader.pair()
    assert stamp[0] * NANO + stamp[1] == loop.time
    assert (reader.text(), reader.texts()) == ('', list(MODEL.joint_names))
    assert reader.word() == N
    interfaces = ['position', 'velocity', 'stiffness', 'damping', 'effort']
    for of_joint in loop.commands.numbers.reshape(5, N).T:
        assert reader.texts() == interfaces
        np.testing.assert_array_equal(reader.doubles(), of_joint)
    assert reader.offset == len(loop.stamped.data)
    assert np.abs(loop.commands.numbers.reshape(5, N)[[0, 2, 3, 4]]).min() > 0.0
