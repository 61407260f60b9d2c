"""What the check of stability says is compared with the motion of a sampled arm."""

from pathlib import Path
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('rclpy')

from kane_dynamics import Controller, Drive, load_urdf, Robot  # noqa: E402, I100
from kane_dynamics import with_drives, with_rigid_joints  # noqa: E402
from kane_dynamics._util.resources import resource_path  # noqa: E402
from kane_dynamics.control.elastic_control import ElasticArm  # noqa: E402
from kane_dynamics.control.terms import Mode  # noqa: E402
from kane_dynamics.errors import ConstraintError  # noqa: E402
from kane_dynamics.ros.common.node_statistics import Statistics  # noqa: E402
from kane_dynamics.ros.dynamics_node.configured_robot import ConfiguredRobot  # noqa: E402
from kane_dynamics.ros.modes.stability import instability  # noqa: E402
from kane_dynamics.ros.modes.task_modes import TaskModes  # noqa: E402
from kane_dynamics.ros.torque_path.torque_path import TorquePath  # noqa: E402
from native_rig import python_path  # noqa: E402
from node_process import model as rigid_model  # noqa: E402
from node_values import node_values  # noqa: E402
from rclpy.serialization import serialize_message  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402

PROGRAM = """
import sys
import time
from collections import Counter
import rclpy
from kane_dynamics.ros.dynamics_node.node import DynamicsNode
from kane_dynamics.ros.dynamics_node.node_diagnostics import active_status, ERROR
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState

given = ('urdf:=URDF', 'arm_compensates:=none', 'activation:=on_request',
         'torque_path:=TORQUE_PATH', 'mode:=computed_torque', 'gains.kd:=280.0')
rclpy.init(args=['--ros-args', *[x for one in given for x in ('-p', one)]])
node = DynamicsNode()
node.trigger_configure()
sender = rclpy.create_node('sender')
states = sender.create_publisher(JointState, 'joint_states', qos_profile_sensor_data)
executor = SingleThreadedExecutor()
executor.add_node(node)

def send(count, period=0.004):
    for _ in range(count):
        message = JointState(name=list(node.arm.robot.joint_names),
                             position=[0.3, -0.2], velocity=[0.0, 0.0])
        now = time.time_ns()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, 10**9)
        states.publish(message)
        until = time.monotonic() + period
        while time.monotonic() < until:
            executor.spin_once(0.001)
    node.arm.path.check_timeout()

while not states.get_subscription_count():
    time.sleep(0.01)
node.trigger_activate()  # before the first state
said = [node.state]
send(60)
node.trigger_activate()
said += [node.state]
result, = node.set_parameters([Parameter('gains.kd', value=20.0)])
node.trigger_activate()
send(60)
said += [node.state, result.successful]
for value in (280.0, 30.0):
    result, = node.set_parameters([Parameter('gains.kd', value=value)])
    said += [result.successful, 'swings up' in result.reason]
said += [node.get_parameter('gains.kd').value]
# States come less often, with which these gains throw the arm.
send(40, 0.06)
said += [node.get_parameter('mode').value, str(node.arm.path.controller.mode)]
level, words = active_status(node.arm, 16.0, Counter(), 0.0)
said += [level == ERROR, 'mode computed_torque ended' in words]
result, = node.set_parameters([Parameter('mode', value='computed_torque')])
said += [result.successful]
send(60)
result, = node.set_parameters([Parameter('mode', value='computed_torque')])
said += [result.successful, node.arm.left_mode]
print(said)
node.halt()
rclpy.shutdown()
"""
ROBOT = Robot(load_urdf(resource_path('urdf', 'fr3.urdf'),
                        joints=[f'fr3_joint{k}' for k in range(1, 8)]))
HOME = np.array([0.0, -0.7, 0.0, -2.2, 0.0, 1.6, 0.8])
STATES = 400


def fastest(mode, period, changes):
    """Return the words, and the speed of an arm whose torques act one period late."""
    values = node_values({'mode': str(mode), **changes})
    laws = TaskModes(ROBOT, values).laws
    controller = Controller(ROBOT, mode=mode, kp=values['gains.kp'],
                            kd=values['gains.kd'], laws=laws)
    words = instability(controller, laws, mode, HOME, period)
    q, u = HOME.copy(), np.zeros(7)
    acting = controller.torque(q, u, None, 0.0)  # the pose that is held
    u[:] = 1e-3 * np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0])
    size = []
    for _ in range(STATES):
        torque = controller.torque(q, u, None, 0.0)
        for _ in range(10):
            u = u + 0.1 * period * ROBOT.forward_dynamics(q, u, acting)
            q = q + 0.1 * period * u
        acting = torque
        size.append(np.abs(u).max())
        if size[-1] > 1.0:
            break
    return words, size[-1]


@pytest.mark.parametrize(('mode', 'period', 'changes', 'share'), [
    (Mode.COMPUTED_TORQUE, 0.004, {'gains.kp': 100.0, 'gains.kd': 280.0}, 'gains.kd'),
    (Mode.COMPUTED_TORQUE, 0.008, {'gains.kp': 9000.0, 'gains.kd': 90.0}, 'gains.kp'),
    (Mode.JOINT_IMPEDANCE, 0.005, {}, 'stiffness')])
def test_a_law_that_is_called_unstable_throws_the_arm_and_the_share_it_names_does_not(
        mode, period, changes, share):
    words, speed = fastest(mode, period, changes)
    assert 'swings up' in words and share in words
    assert speed > 0.5
    part = float(words.split('at most ')[1].split('%')[0]) / 100.0
    stable = {name: 0.9 * part * value for name, value in changes.items()}
    if mode is Mode.JOINT_IMPEDANCE:
        stable = {'joint_impedance.stiffness': (0.9 * part * 5.0
                                                * ROBOT.limits.effort).tolist()}
    words, speed = fastest(mode, period, stable)
    assert words == '' and speed < 0.01


@pytest.mark.parametrize(('name', 'value', 'gain'), [
    ('cartesian.posture_stiffness', 1e4, 'posture stiffness'),
    ('cartesian.null_damping', 400.0, 'null-space damping')])
def test_springs_of_the_null_space_are_judged_by_the_motion_they_make(name, value, gain):
    weak = {'cartesian.stiffness': [100.0] * 3 + [3.0] * 3}
    words, speed = fastest(Mode.CARTESIAN_IMPEDANCE, 0.004, {**weak, name: value})
    assert f'% of the {gain}' in words and speed > 0.5
    share = float(words.split('at most ')[1].split('%')[0]) / 100.0
    words, speed = fastest(Mode.CARTESIAN_IMPEDANCE, 0.004,
                           {**weak, name: 0.9 * share * value})
    assert words == '' and speed < 0.02


def test_springs_of_the_frame_and_of_its_null_space_are_those_of_the_law():
    """Central differences of the torques of the law itself."""
    values = node_values({'mode': 'cartesian_impedance',
                          'cartesian.posture_stiffness': 20.0})
    mode = TaskModes(ROBOT, values).laws[Mode.CARTESIAN_IMPEDANCE]
    springs = mode.springs(HOME)
    springs.pop('stiffness of its wall')
    mode.law.update(posture=HOME)
    at_rest = np.zeros(7)
    pose = ROBOT.frame_pose(mode.frame, HOME)
    h = 1e-6
    for k, e in enumerate(h * np.eye(7)):
        gravity = ROBOT.gravity_force(HOME + e) - ROBOT.gravity_force(HOME - e)
        stretched = (mode.law.torque(HOME - e, at_rest, pose)
                     - mode.law.torque(HOME + e, at_rest, pose) + gravity)
        np.testing.assert_allclose(stretched / (2 * h),
                                   sum(x.stiffness[:, k] for x in springs.values()),
                                   rtol=1e-5, atol=1e-3)
        damped = (mode.law.torque(HOME, -e, pose) - mode.law.torque(HOME, e, pose))
        np.testing.assert_allclose(damped / (2 * h),
                                   sum(x.damping[:, k] for x in springs.values()),
                                   rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize('mode', [Mode.HAND_GUIDING, Mode.CARTESIAN_IMPEDANCE])
@pytest.mark.parametrize('period', [0.01, 0.03])
def test_brakes_of_fast_joints_need_a_rate_of_states_and_throw_the_arm_below_it(
        mode, period):
    """Joints begin three times as fast as a speed limit, without springs."""
    values = node_values({'mode': str(mode), 'walls.stiffness': 0.0,
                          'cartesian.stiffness': [0.0] * 6,
                          'cartesian.null_damping': 0.0,
                          'cartesian.posture_stiffness': 0.0})
    laws = TaskModes(ROBOT, values).laws
    controller = Controller(ROBOT, mode=mode, laws=laws)
    words = instability(controller, laws, mode, HOME, period)
    assert ('brakes of fast joints' in words) == (period > 0.011)
    limits = 0.2 * ROBOT.limits.velocity
    laws[mode].law.update(speed_limit=limits)
    pose = [ROBOT.frame_pose('fr3_link7', HOME)] * (mode is not Mode.HAND_GUIDING)
    q, u = HOME.copy(), 3.0 * limits * np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0])
    acting = ROBOT.gravity_force(q)
    speeds = []
    for _ in range(round(1.5 / period)):
        torque = laws[mode].law.torque(q, u, *pose)
        for _ in range(100):
            u = u + 0.01 * period * ROBOT.forward_dynamics(q, u, acting)
            q = q + 0.01 * period * u
        acting = torque
        speeds.append(np.abs(u).max())
    assert (max(speeds) > 10.0) if words else (speeds[-1] < 1.2 * limits.max())


DRIVEN = with_drives(rigid_model(), {
    'turn': Drive(9e3, rotor_inertia=0.5, damping=40.0),
    'lift': Drive(8e3, rotor_inertia=0.4, damping=40.0)})


def fastest_on_drives(period, changes):
    """Return the words, and the largest and last speed of an arm on drives."""
    values = node_values({'mode': 'motor_side', **changes})
    robot = Robot(with_rigid_joints(DRIVEN))
    laws = TaskModes(robot, values, DRIVEN).laws
    controller = Controller(robot, mode='motor_side', laws=laws)
    q = np.array([0.2, -0.4, 0.1])
    words = instability(controller, laws, Mode.MOTOR_SIDE, q, period)
    elastic = Robot(DRIVEN)
    arm = ElasticArm(elastic)
    measured = arm.links if values['drives.sensor_side'] == 'link' else arm.motors
    # At rest, with the deflections of gravity.
    kernel = elastic.compiled(arm.motor_command, motion=(5, 3), name='command',
                              shape=(5, 3))
    command = kernel(np.vstack([q, np.zeros((4, 3))]))
    state = np.zeros((2, elastic.n))
    state[0, arm.links] = q
    state[0, arm.motors] = command[0]
    acting = laws[Mode.MOTOR_SIDE].torque(*state[:, measured], None, 0.0, 0.0)
    state[1] = 1e-4
    size = []
    for _ in range(4000):
        torque = laws[Mode.MOTOR_SIDE].torque(*state[:, measured], None, 0.0, 0.0)
        for _ in range(10):
            state[1] += 0.1 * period * elastic.forward_dynamics(
                *state, arm.in_tau(acting).astype(float))
            state[0] += 0.1 * period * state[1]
        acting = torque
        size.append(np.abs(state[1]).max())
        if size[-1] > 0.1:
            break
    return words, max(size), size[-1]


@pytest.mark.parametrize(('side', 'kp', 'kd'), [
    ('motor', 300.0, 900.0), ('link', 3000.0, 300.0)])
def test_feedback_on_drives_is_judged_with_their_elasticity(side, kp, kd):
    """A rigid arm hides what is unstable: the rotors, and links that are measured."""
    settings = {'drives.sensor_side': side, 'drives.kp': kp, 'drives.kd': kd}
    words, largest, _ = fastest_on_drives(1e-3, settings)
    assert 'swings up' in words and 'drives.kd' in words and largest > 0.1
    share = 0.9 * float(words.split('at most ')[1].split('%')[0]) / 100.0
    words, largest, last = fastest_on_drives(1e-3, {
        **settings, 'drives.kp': share * kp, 'drives.kd': share * kd})
    assert words == '' and last < 0.5 * largest


def test_modes_without_feedback_are_stable_at_any_rate():
    controller = Controller(ROBOT)
    for mode in (Mode.GRAVITY_COMPENSATION, Mode.INVERSE_DYNAMICS):
        assert instability(controller, {}, mode, HOME, 10.0) == ''


@pytest.mark.parametrize('make', [python_path, TorquePath])
def test_the_rate_before_the_start_is_that_of_the_arm_beside_a_gripper(make):
    values = node_values({'mode': 'computed_torque'})
    path = make(Controller(ROBOT, mode='computed_torque'), None, None, lambda: 0, values,
                Statistics(), lambda *words: None)
    for k in range(40):
        for joints, late in ((ROBOT.joint_names, 0), (['finger'], 3_000_000)):
            message = JointState(name=list(joints), position=[0.01 * k] * len(joints))
            message.header.stamp.nanosec = 10_000_000 * (k + 1) + late
            path.on_state(serialize_message(message))
    q, period = path.idle_states()
    assert period == pytest.approx(0.01, rel=1e-12) and np.array_equal(q, [0.39] * 7)


@pytest.mark.parametrize('torque_path', ['native', 'python'])
def test_unstable_gains_are_neither_activated_nor_set_live(torque_path):
    program = PROGRAM.replace('URDF', str(resource_path('urdf', 'two_link.urdf')))
    done = subprocess.run(
        [sys.executable, '-c', program.replace('TORQUE_PATH', torque_path)],
        capture_output=True, text=True, timeout=200, cwd=Path(__file__).parents[3])
    said = ("['inactive', 'inactive', 'active', True, False, True, True, False, 30.0, "
            "'gravity_compensation', 'gravity_compensation', True, True, "
            "False, True, '']")
    assert done.stdout.strip() == said, done.stdout + done.stderr
    assert 'not activated: computed_torque: joint' in done.stderr
    assert 'not activated: no joint states yet' in done.stderr


def test_a_single_long_period_ends_no_mode_and_what_cannot_be_judged_raises_nothing():
    controller = Controller(ROBOT, mode=Mode.COMPUTED_TORQUE, kp=100.0, kd=30.0)
    path = SimpleNamespace(period=0.09, measured=lambda: HOME, controller=controller)
    arm = SimpleNamespace(path=path, modes=SimpleNamespace(laws={}), fault='',
                          left_mode='', _judged=(0.0, 0.0), _suspected=False)
    said = []
    # The first two states were far apart; later all are.
    for path.period in (0.09, 0.001, 0.09, 0.09):
        said.append(ConfiguredRobot.leave_unstable_mode(arm))
    assert said[:3] == ['', '', ''] and 'swings up' in said[3]

    def singular(q):
        raise ConstraintError('constraints: singular')
    controller = SimpleNamespace(mode=Mode.JOINT_IMPEDANCE, robot=ROBOT)
    arm.path = SimpleNamespace(period=0.5, measured=lambda: HOME, controller=controller)
    arm.modes.laws[Mode.JOINT_IMPEDANCE] = SimpleNamespace(springs=singular)
    assert ConfiguredRobot.leave_unstable_mode(arm) == ''
