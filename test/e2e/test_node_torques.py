"""The torque path over DDS: right torques, and none from anything that is not right."""

import math
import time

from kane_dynamics import Controller, Motion, Robot
from kane_dynamics.ros.parameters.parameter_table import SPECS
from lifecycle_msgs.msg import Transition
from node_process import JOINTS, model, URDF, wait_until
import numpy as np
import pytest
from rcl_interfaces.msg import Parameter as ParameterMessage, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters
from rclpy.parameter import Parameter

GENERATOR = np.random.default_rng(7)


@pytest.fixture(scope='module')
def robot():
    return Robot(model())


@pytest.fixture(scope='module')
def module_node():
    from node_process import Process
    process = Process(robot_description=f"'{URDF}'", state_timeout=1.0)
    yield process
    code, seconds = process.end()
    assert code == 0
    assert seconds < 2.0


@pytest.fixture
def node(module_node, client):
    """Return a client of a node that is as it was at its start."""
    assert client.adjust(
        mode='inverse_dynamics', state_timeout=1.0, limits__effort=math.inf,
        gravity=[0.0, 0.0, -9.81]).successful
    client.connect()
    client.transition(Transition.TRANSITION_DEACTIVATE)
    client.transition(Transition.TRANSITION_ACTIVATE)
    client.connect()
    client.process = module_node
    return client


def close(value, expected):
    return np.abs(value - expected).max() <= 1e-12 * max(np.abs(expected).max(), 1.0)


def states(count):
    return [(GENERATOR.uniform(-1, 1, 3), GENERATOR.uniform(-1, 1, 3))
            for _ in range(count)]


def test_without_a_motion_the_torques_hold_gravity_at_the_measured_pose(node, robot):
    for q, u in states(20):
        assert close(node.ask(q, u), robot.gravity_force(q))


def test_commands_equal_the_efforts_of_joint_torques(node, robot):
    q = np.array([0.3, -0.4, 0.2])
    tau = node.ask(q, np.zeros(3))
    assert node.names == JOINTS
    assert wait_until(lambda: node.commands and node.commands[-1] == tau.tolist())


@pytest.mark.parametrize('mode', ['inverse_dynamics', 'computed_torque'])
def test_along_a_motion_the_torques_equal_those_of_the_library(node, robot, mode):
    # Gains that are stable with these states, each 20 ms or more.
    assert node.adjust(mode=mode, limits__effort=math.inf, gains__kp=9.0,
                       gains__kd=3.0).successful
    points = [(0.0, [0, 0, 0]), (0.6, [0.5, -0.4, 0.3]), (1.5, [0.1, 0.2, -0.2])]
    start = time.time_ns() + 50_000_000
    node.follow(points, start=start)
    motion = Motion.from_points(*zip(*points), joint_names=JOINTS)
    controller = Controller(robot, mode=mode, kp=9.0, kd=3.0)
    time.sleep(0.1)
    assert 'rejected' not in node.process.log.splitlines()[-1]
    for q, u in states(30):
        stamp = time.time_ns()
        expected = controller.command(
            stamp / 1e9, q, u, motion, (stamp - start) / 1e9).tau
        assert close(node.ask(q, u, stamp=stamp), expected)
        time.sleep(0.02)


def test_gravity_changes_at_run_time(node, robot):
    tilted = Robot(model())
    tilted.parameters.gravity = [3.0, 0.0, -9.0]
    assert node.adjust(gravity=[3.0, 0.0, -9.0]).successful
    q = np.array([0.3, -0.4, 0.2])
    assert close(node.ask(q, np.zeros(3)), tilted.gravity_force(q))


def test_joints_are_mapped_by_name_and_others_ignored(node, robot):
    q = np.array([0.3, -0.4, 0.2])
    tau = node.ask([9.0, q[2], q[0], 8.0, q[1]], np.zeros(5),
                   ['gripper', 'reach', 'turn', 'wheel', 'lift'])
    assert close(tau, robot.gravity_force(q))


@pytest.mark.parametrize(('reason', 'arguments'), [
    ('joint missing', {'q': [0, 0], 'u': [0, 0], 'names': ['turn', 'lift']}),
    ('joint named twice', {'q': [0] * 4, 'u': [0] * 4, 'names': [*JOINTS, 'turn']}),
    ('not finite', {'q': [0, math.nan, 0], 'u': [0, 0, 0]}),
    ('not finite', {'q': [0, 0, 0], 'u': [0, -math.inf, 0]}),
    ('no velocity', {'q': [0, 0, 0]}),
    ('arrays of unequal length', {'q': [0, 0], 'u': [0, 0, 0]}),
    ('arrays of unequal length', {'q': [0, 0, 0], 'u': [0]}),
    ('arrays of unequal length', {'q': [0, 0, 0, 0], 'u': [0, 0, 0]}),
    ('no velocity', {'q': [], 'u': [], 'names': []}),
    ('stale (older than state_timeout)',
     {'q': [0, 0, 0], 'u': [0, 0, 0], 'shift': -3.0}),
    ('stamp in the future', {'q': [0, 0, 0], 'u': [0, 0, 0], 'shift': 3.0}),
])
def test_an_invalid_state_gives_no_command_and_is_counted(node, reason, arguments):
    arguments = dict(arguments)
    stamp = time.time_ns() + int(arguments.pop('shift', 0.0) * 1e9)
    reason = 'joint missing' if arguments.get('names') == [] else reason
    node.diagnostics.clear()
    assert node.ask(stamp=stamp, timeout=0.1, **arguments) is None
    assert node.rest() is not None, 'the next valid state must give a command'
    assert wait_until(lambda: any(f'states dropped: {reason}' in values
                                  for _, _, values in node.diagnostics), 3.0)


def test_non_finite_torques_are_not_commanded(node):
    assert node.adjust(mode='computed_torque').successful
    assert node.ask([0, 0, 0], [1e200, 1e200, 1e200], timeout=0.1) is None
    assert node.rest() is not None


def test_gravity_compensation_needs_no_velocity(node, robot):
    assert node.adjust(mode='gravity_compensation').successful
    q = np.array([0.3, -0.4, 0.2])
    assert close(node.ask(q), robot.gravity_force(q))


def test_torques_are_clamped_to_the_limit(node, robot):
    q = np.array([0.3, -0.4, 0.2])
    free = robot.gravity_force(q)
    limit = 0.5 * np.abs(free).max()
    # A limit is set where it holds the arm: in the configuration of the least torque.
    configurations = robot.random_configuration(0, 1000)
    torques = np.abs(robot.gravity_force(configurations)).max(axis=1)
    assert torques.min() < limit
    node.ask(configurations[torques.argmin()], np.zeros(3))
    assert node.adjust(limits__effort=limit).successful
    node.diagnostics.clear()
    assert close(node.ask(q, np.zeros(3)), np.clip(free, -limit, limit))

    def clamped():
        return sum(int(values.get('commands clamped', 0))
                   for _, _, values in node.diagnostics)
    assert wait_until(lambda: clamped() > 0, 3.0)


def test_a_timeout_commands_zeros_once_and_shows_in_the_diagnostics(node):
    assert node.adjust(state_timeout=0.1).successful
    node.diagnostics.clear()
    assert node.ask([0.3, -0.4, 0.2], np.zeros(3)).any()
    count_before = len(node.commands)
    assert wait_until(lambda: len(node.commands) > count_before, 0.5)
    assert node.commands[-1] == [0.0, 0.0, 0.0]
    count = len(node.commands)
    assert wait_until(lambda: any('no valid joint state' in message and level == b'\x02'
                                  for level, message, _ in node.diagnostics), 3.0)
    assert len(node.commands) == count, 'zeros must come once'
    assert node.ask([0.3, -0.4,
                     0.2], np.zeros(3)).any(), 'the next state must give a command'


def test_deactivation_commands_zeros_and_ends_the_commands(node):
    assert node.ask([0.3, -0.4, 0.2], np.zeros(3)).any()
    assert node.transition(Transition.TRANSITION_DEACTIVATE)
    assert wait_until(lambda: node.commands[-1] == [0.0, 0.0, 0.0])
    assert node.rest() is None
    assert node.transition(Transition.TRANSITION_ACTIVATE)
    assert wait_until(lambda: node.rest() is not None)


@pytest.mark.parametrize(('words', 'arguments'), [
    ('lift missing; expected each of turn, lift, reach once',
     {'points': [(1.0, [0, 0])], 'names': ['turn', 'reach']}),
    ('point 1: time_from_start 1 s; expected more than that of point 0',
     {'points': [(1.0, [0] * 3), (1.0, [1] * 3)]}),
    ('point 0: positions [', {'points': [(1.0, [0, math.nan, 0])]}),
    ('point 1: 2 positions; expected', {'points': [(1.0, [0] * 3), (2.0, [0] * 2)]}),
    ('positions of the trajectory: none', {'points': [(1.0, [])]}),
    ('end of the motion: ', {'points': [(1.0, [0] * 3)], 'start': 10**9}),
])
def test_an_invalid_trajectory_is_rejected_with_the_reason(
        node, robot, words, arguments):
    count = node.process.log.count(words)
    node.follow(**arguments)
    assert wait_until(
        lambda: node.process.log.count(words) > count), node.process.log[-2000:]
    q = np.array([0.3, -0.4, 0.2])
    assert close(node.ask(q, np.zeros(3)),
                 robot.gravity_force(q)), 'it must not be followed'


@pytest.mark.parametrize(('words', 'values'), [
    ("'mode': 'fly'; expected", {'mode': 'fly'}),
    ('Parameter state_timeout out of range', {'state_timeout': -1.0}),
    ('Parameter state_timeout out of range', {'state_timeout': math.nan}),
    ('2 entries; expected one number, or one for each of the 3 joints',
     {'gains__kp': [1.0, 2.0]}),
    ("'gains.kd': [", {'gains__kd': [1.0, -2.0, 3.0]}),
    ("'gains.kp': []", {'gains__kp': []}),
    ('Parameter diagnostics_rate out of range', {'diagnostics_rate': 1e-12}),
    ('clean up first', {'urdf': '/some/other.urdf'}),
    ('clean up first', {'joints': ['lift']}),
    ('clean up first', {'arm_compensates': ['gravity']}),
    ('none alone', {'arm_compensates': ['gravity', 'none']}),
    ("'gravity': [", {'gravity': [0.0, 1.0]}),
    ('', {'autostart': False}),
])
def test_an_invalid_parameter_is_refused_with_the_reason_and_changes_nothing(
        node, robot, words, values):
    answer = node.adjust(limits__effort=1e-3, **values)
    assert not answer.successful
    assert words in answer.reason
    q = np.array([0.3, -0.4, 0.2])
    assert close(node.ask(q, np.zeros(3)), robot.gravity_force(q))


BAD = {'text': 3, 'flag': 2.5, 'number': -1e12, 'count': 0.5, 'names': 'one',
       'vector': [1.0], 'six': [1.0], 'numbers': 1, 'floats': 'one',
       'per_joint': [np.nan], 'terms': 'weight'}


def test_live_parameters_may_be_set_while_active_and_invalid_values_are_refused_by_name(
        node):
    parameters_before = node.call(GetParameters, 'get_parameters',
                                  names=[spec.name for spec in SPECS])
    for spec in SPECS:
        name = spec.name.replace('.', '__')
        if spec.live:
            assert node.adjust(**{name: spec.default}).successful
        answer = node.adjust(**{'state_timeout': 0.7, name: BAD[spec.kind]})
        assert not answer.successful
        assert spec.name in answer.reason
        # The ranges of the descriptor are judged by rclpy, in its words.
        words = f'expected {spec.constraint}', f'Parameter {spec.name} out of range'
        assert spec.read_only or any(map(answer.reason.__contains__, words))
    assert node.adjust(state_timeout=1.0, state_check__speed_factor=math.inf,
                       trajectory__start_tolerance=math.inf, blend_time=0.0).successful
    parameters_after = node.call(GetParameters, 'get_parameters',
                                 names=[spec.name for spec in SPECS])
    for spec, old, new in zip(SPECS, parameters_before.values, parameters_after.values):
        assert spec.live or old == new, spec.name
    assert node.rest() is not None


def test_every_parameter_has_a_description(node):
    answer = node.call(DescribeParameters, 'describe_parameters',
                       names=[spec.name for spec in SPECS])
    assert all(descriptor.description and descriptor.additional_constraints
               for descriptor in answer.descriptors)


def test_an_impossible_request_is_answered_and_does_not_stop_the_torque_path(node):
    q = [0.3, -0.4, 0.2]
    for number in (Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_CONFIGURE, 99):
        assert not node.transition(number)
    good = Parameter('state_timeout', value=0.9).to_parameter_msg()
    garbled = ParameterMessage(name='state_timeout', value=ParameterValue(type=77))
    results = node.call(SetParameters, 'set_parameters',
                        parameters=[good, garbled]).results
    assert [result.successful for result in results] == [True, False]
    assert results[1].reason
    assert node.state() == 'active'
    assert node.ask(q, np.zeros(3)).any()


def test_a_mode_change_or_an_empty_trajectory_ends_the_motion(node, robot):
    q = np.array([0.3, -0.4, 0.2])
    assert node.adjust(mode='computed_torque').successful

    def followed():
        return wait_until(lambda: np.abs(node.ask(q, np.zeros(3))
                                         - robot.gravity_force(q)).max() > 1.0)

    def held():
        return wait_until(
            lambda: close(node.ask(q, np.zeros(3)), robot.gravity_force(q)))
    node.follow([(0.0, q), (0.5, q + 0.5)])
    assert followed()
    node.follow([])
    assert held()
    node.follow([(0.0, q), (0.5, q + 0.5)])
    assert followed()
    assert node.adjust(mode='gravity_compensation').successful
    words = 'gravity_compensation; expected a mode that follows'
    count_before = node.process.log.count(words)
    node.follow([(0.0, q), (0.5, q + 0.5)])
    assert wait_until(lambda: node.process.log.count(words) > count_before)
    assert node.adjust(mode='computed_torque').successful
    assert held()
