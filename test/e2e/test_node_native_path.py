"""The native torque path goes on at the full rate whatever the interpreter does."""

from contextlib import contextmanager
import ctypes
import os
from pathlib import Path
import time

import delayed_node
from geometry_msgs.msg import Point, PoseStamped, Quaternion
from kane_dynamics import load_urdf, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.kinematics.poses import rotation_quaternion
from kane_dynamics_interfaces.msg import TaskState
from lifecycle_msgs.msg import Transition
from node_process import DEEP, JOINTS, model, NAME, Process, wait_until
import numpy as np
from palletizer import DRIVEN, LOOPS, palletizer, positions, URDF as PALLETIZER
import pytest
from std_msgs.msg import String
import yaml

DELAYED = str(Path(delayed_node.__file__))
Q = np.array([0.3, -0.4, 0.2])
RATE = 200.0  # states/s
HOME = [0.0, -0.4, 0.0, -2.0, 0.0, 1.7, 0.8]  # of the FR3
FRAME = 'fr3_hand'
HOSTS = 'native', 'python'  # of the torque path


@pytest.fixture(scope='module')
def holding():
    """Return the torques that hold the pose Q."""
    return Robot(model()).gravity_force(Q)


@pytest.fixture
def node(start, client):
    process = start(
        program=[DELAYED, '--ros-args'], torque_path='native', state_timeout=0.5,
        activation='at_once', arm_compensates='none', limits__rate='.inf',
        state_check__speed_factor='.inf', state_check__position_margin='.inf')
    client.delay = client.create_publisher(String, f'{NAME}/delay', 1)
    process.wait_for('torque path: native')
    client.connect()
    assert wait_until(lambda: client.delay.get_subscription_count() == 1)
    yield process
    client.destroy_publisher(client.delay)


def send_for(client, seconds):
    """Publish states at the full rate; return their stamps."""
    stamps = []
    end = time.perf_counter() + seconds
    while time.perf_counter() < end:
        stamps.append(client.send(Q, np.zeros(3)))
        time.sleep(1.0 / RATE)
    return stamps


@contextmanager
def stopped_thread(thread):
    """Let the kernel stop one thread of a process for a block, as a debugger does."""
    seize = 0x4206
    interrupt = 0x4207
    detach = 17
    library = ctypes.CDLL(None, use_errno=True)
    library.ptrace.argtypes = [ctypes.c_long, ctypes.c_long, ctypes.c_void_p,
                               ctypes.c_void_p]
    library.ptrace.restype = ctypes.c_long

    def trace(request):
        if library.ptrace(request, thread, None, None):
            raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    try:
        trace(seize)
    except PermissionError:
        pytest.skip('this user may not trace processes')
    try:
        trace(interrupt)
        os.waitpid(thread, 0)
        yield
    finally:
        trace(detach)


def delay(client, node, what):
    client.delay.publish(String(data=what))
    node.wait_for(f'delayed: {what.split()[0]}', 10.0)


def longest_pause(client, stamps):
    """Return the longest time of states without an answer, ns: the sender may pause."""
    longest = 0
    first = None
    for stamp in stamps:
        if stamp in client.torques:
            first = None
            continue
        first = stamp if first is None else first
        longest = max(longest, stamp - first)
    return longest


def require_answers(client, stamps, holding):
    """States are answered with the right torque, in time; DDS may lose single ones."""
    wait_until(lambda: stamps[-1] in client.torques, 2.0)
    answered = [stamp for stamp in stamps if stamp in client.torques]
    assert longest_pause(client, stamps) < 0.1e9
    assert len(answered) > 0.95 * len(stamps), (len(answered), len(stamps))
    for stamp in answered:
        np.testing.assert_allclose(client.torques[stamp], holding, rtol=1e-12)


@pytest.mark.parametrize(('what', 'seconds'), [('lock 10', 9.0), ('collect 0', 3.0),
                                               ('callback 3', 2.5)])
def test_a_delayed_interpreter_delays_no_torque(node, client, holding, what, seconds):
    client.torques.clear()
    delay(client, node, what)
    stamps = send_for(client, seconds)
    require_answers(client, stamps, holding)
    # What nothing could observe meanwhile is reported afterwards.
    if what == 'lock 10':
        node.wait_for('answered, but not observed: the interpreter was busy', 10.0)
        client.diagnostics.clear()
        assert wait_until(lambda: any(int(values.get('cycles not observed', '0')) > 100
                                      for _, _, values in client.diagnostics), 5.0)


def test_the_stopped_thread_of_the_interpreter_stops_no_torque(node, client, holding):
    client.torques.clear()
    with stopped_thread(node.pid):
        stamps = send_for(client, 3.0)
        log = node.log
        require_answers(client, stamps, holding)
        assert node.log == log, 'nothing of Python runs'
    assert client.adjust(state_timeout=0.4).successful, 'it runs again'


def test_the_lease_of_the_guard_holds_while_another_thread_holds_the_lock(
        start, client, holding):
    node = start(program=[DELAYED, '--ros-args'], torque_path='native',
                 state_timeout=0.5,
                 activation='at_once', arm_compensates='none', limits__rate='.inf',
                 state_check__speed_factor='.inf', guard__enabled='true',
                 guard__lease=0.05, state_check__position_margin='.inf')
    guard = Process(module='kane_dynamics.ros.guard.main')
    client.delay = client.create_publisher(String, f'{NAME}/delay', 1)
    try:
        node.wait_for('torque path: native')
        guard.wait_for('watching kane_dynamics')
        client.connect()
        assert wait_until(lambda: client.delay.get_subscription_count() == 1)
        send_for(client, 1.0)
        client.torques.clear()
        taken_over = guard.log.count('commanding')
        delay(client, node, 'lock 5')
        require_answers(client, send_for(client, 4.0), holding)
        assert guard.log.count('commanding') == taken_over, guard.log
        # States that pause longer than the lease: the node asks before it goes on, and
        # the guard answers, all without Python.
        for _ in range(3):
            time.sleep(0.2)
            client.torques.clear()
            require_answers(client, send_for(client, 0.2), holding)
    finally:
        client.destroy_publisher(client.delay)
        guard.end(timeout=20.0)


def test_closed_loops_are_followed_while_another_thread_holds_the_lock(start, client):
    robot = palletizer()
    names = robot.joint_names
    node = start(program=[DELAYED, '--ros-args'], torque_path='native',
                 state_timeout=0.5,
                 urdf=PALLETIZER, constraints=LOOPS, state_check__speed_factor='.inf',
                 activation='at_once', arm_compensates='none', limits__rate='.inf')
    client.delay = client.create_publisher(String, f'{NAME}/delay', 1)

    def send(k, kind):
        """Send the state of a slow motion; return its stamp and its torques."""
        driven = 0.2 + 0.1 * np.sin(0.02 * k * np.array([1.0, 0.8, -0.7, 0.5]))
        q = positions(robot, *driven)
        if kind == 'driven':
            return client.send(driven, np.zeros(4), DRIVEN), q
        whole = q.copy()
        if kind == 'contradiction':
            whole[names.index('elbow')] += 0.1
        return client.send(whole, np.zeros(len(whole)), names), q
    try:
        node.wait_for('torque path: native', 120.0)
        assert wait_until(lambda: client.delay.get_subscription_count() == 1)
        client.joints = DRIVEN
        client.connect()
        for kind in ['driven', 'all'] * 50:  # their layouts are learned
            send(0, kind)
            time.sleep(0.005)
        client.torques.clear()
        delay(client, node, 'lock 5')
        sent = []
        for k in range(300):
            kind = ('driven', 'all', 'contradiction')[k % 3]
            sent.append((*send(k, kind), kind))
            time.sleep(0.01)
        wait_until(lambda: sent[-2][0] in client.torques, 2.0)
        torques = dict(client.torques)
        assert 'contradict' not in node.log, 'the interpreter still sleeps'
        commanded = [k for k, name in enumerate(names) if name in DRIVEN]
        answered = 0
        for stamp, q, kind in sent:
            if kind == 'contradiction':
                assert stamp not in torques
            elif stamp in torques:
                answered += 1
                held = robot.joint_torques(robot.gravity_force(q), q)[commanded]
                np.testing.assert_allclose(torques[stamp], held, rtol=1e-9, atol=1e-9)
        assert answered > 180, answered  # of 200
        node.wait_for('measured joints contradict the closed loop', 10.0)
    finally:
        client.destroy_publisher(client.delay)


def test_zeros_follow_the_last_state_while_another_thread_holds_the_lock(node, client):
    send_for(client, 0.2)
    delay(client, node, 'lock 5')
    send_for(client, 0.2)
    assert wait_until(lambda: any(client.commands[-1]), 1.0)
    assert wait_until(lambda: not any(client.commands[-1]), 4.0)
    assert 'commanding zeros' not in node.log, 'the interpreter still sleeps'
    node.wait_for('no joint state: none for', 10.0)


@pytest.fixture
def hosts_node(start, client, request):
    """Return a node on a torque path, with a reaction to faults."""
    host, action = request.param
    node = start(program=[DELAYED, '--ros-args'], torque_path=host, state_timeout=0.5,
                 activation='at_once', arm_compensates='none', limits__rate='.inf',
                 state_check__speed_factor='.inf', state_check__position_margin='.inf',
                 state_check__action=action)
    client.delay = client.create_publisher(String, f'{NAME}/delay', 1)
    node.wait_for('active, mode')
    client.connect()
    assert wait_until(lambda: client.delay.get_subscription_count() == 1)
    yield node, action
    client.destroy_publisher(client.delay)


@pytest.mark.parametrize('hosts_node', [
    ('native', 'zero'), ('native', 'hold'), ('python', 'zero'), ('python', 'hold')],
    indirect=True)
def test_after_a_failed_observer_the_arm_is_free_or_held_as_state_check_says(
        hosts_node, client):
    node, action = hosts_node
    delay(client, node, 'observer 0')
    send_for(client, 0.2)
    reason = 'callback failed: RuntimeError: observer Faulty: ValueError: this observer'
    node.wait_for(reason, 5.0)
    client.commands.clear()
    client.diagnostics.clear()
    stamps = send_for(client, 1.0)
    assert any(stamp in client.torques for stamp in stamps[50:]) == (action == 'hold')
    assert any(map(any, client.commands[-50:])) == (action == 'hold')
    assert node.log.count(reason) == 1
    assert wait_until(lambda: any('observer Faulty' in message and level == b'\x02'
                                  for level, message, _ in client.diagnostics), 3.0)


def moving_torques(client):
    """Return the stamps of torques that are not zero."""
    return [stamp for stamp, torque in client.torques.items() if torque.any()]


@pytest.mark.parametrize('hosts_node', [(host, 'hold') for host in HOSTS],
                         indirect=True)
def test_a_state_without_a_stamp_that_waited_too_long_moves_nothing(hosts_node, client):
    node, _ = hosts_node
    # The native thread waits for Python at a new layout.
    names = client.joints[::-1]
    assert client.ask(Q, np.zeros(3)) is not None
    delay(client, node, 'callback 1.0')
    client.torques.clear()
    client.send(Q, np.zeros(3), names, stamp=0)
    node.wait_for('joint states: stale', 5.0)
    assert not moving_torques(client)  # at most the zeros after state_timeout
    # One that does not wait is answered, as of the time of its reception.
    begin = time.time_ns()
    client.send(Q, np.zeros(3), names, stamp=0)
    assert wait_until(lambda: moving_torques(client), 2.0)
    assert begin < min(moving_torques(client)) < time.time_ns()


@pytest.mark.parametrize('guarded', [False, True])
@pytest.mark.parametrize('host', ['native', 'python'])
def test_after_a_refused_command_the_arm_is_free_or_held_by_its_guard(
        start, client, host, guarded):
    action = 'hold' if guarded else 'zero'
    node = start(program=[DELAYED, '--ros-args'], torque_path=host, state_timeout=5.0,
                 activation='at_once', arm_compensates='none', limits__rate='.inf',
                 state_check__speed_factor='.inf', state_check__position_margin='.inf',
                 state_check__action=action, guard__enabled=guarded)
    if guarded:
        guard = start(module='kane_dynamics.ros.guard.main')
        guard.wait_for('watching kane_dynamics')
    client.delay = client.create_publisher(String, f'{NAME}/delay', 1)
    try:
        node.wait_for('active, mode')
        client.connect()
        assert wait_until(lambda: client.delay.get_subscription_count() == 1)
        send_for(client, 0.2)
        assert wait_until(lambda: client.commands and any(client.commands[-1]), 1.0)
        delay(client, node, 'refuse 0')
        send_for(client, 0.2)
        node.wait_for('callback failed: RuntimeError: ', 5.0)
        if guarded:
            assert client.state() == 'active'
            assert wait_until(lambda: send_for(client, 0.1)
                              and 'holding the arm' in guard.log, 5.0)
            assert any(client.commands[-1])
        else:
            assert wait_until(lambda: client.state() == 'inactive', 5.0)
            assert wait_until(lambda: not any(client.commands[-1]), 1.0)
    finally:
        client.destroy_publisher(client.delay)


def test_the_node_ends_while_the_native_thread_works(node, client):
    send_for(client, 0.2)
    code, seconds = node.end()
    assert code == 0
    assert seconds < 2.0
    assert wait_until(lambda: not any(client.commands[-1]), 1.0)


def test_states_that_came_while_the_node_was_inactive_are_not_judged(start, client):
    node = start(torque_path='native', real_states=True, state_timeout=1.0,
                 mode='gravity_compensation', arm_compensates='none')
    node.wait_for('torque path: native')
    node.wait_for('active, mode')
    client.connect()

    def is_held(q):
        client.send(q, np.zeros(3))
        time.sleep(1.0 / RATE)
        expected = Robot(model()).gravity_force(q)
        return client.commands and np.allclose(client.commands[-1], expected, rtol=1e-9)
    assert wait_until(lambda: is_held(np.zeros(3))), node.log
    assert client.transition(Transition.TRANSITION_DEACTIVATE)
    for _ in range(30):
        client.send(np.zeros(3), np.zeros(3))
        time.sleep(1.0 / RATE)
    assert client.transition(Transition.TRANSITION_ACTIVATE)
    # The arm was moved meanwhile, as by hand or by the reset of a simulation.
    assert wait_until(lambda: is_held(Q)), node.log
    assert 'position jumped' not in node.log


@pytest.fixture
def elastic(tmp_path):
    """Return parameters of a node with elastic joints in mode motor_side."""
    supplement = tmp_path / 'drives.yaml'
    drive = {'stiffness': 1e4, 'rotor_inertia': 0.5}
    supplement.write_text(yaml.safe_dump({'drives': dict.fromkeys(JOINTS, drive)}))
    return {'supplement': supplement, 'modes': '[motor_side]'}


def test_the_native_path_is_refused_for_a_mode_without_native_code(start, elastic):
    node = start(torque_path='native', **elastic)
    node.wait_for("parameter 'torque_path': native, with mode motor_side; expected "
                  'auto or python')
    assert 'active, mode' not in node.log


def test_a_mode_without_native_code_runs_on_the_interpreter(start, client, elastic,
                                                            holding):
    node = start(**elastic)
    node.wait_for('active, mode')
    client.connect()
    np.testing.assert_allclose(client.ask(Q, np.zeros(3)), holding, rtol=1e-12)


def test_a_mode_that_the_node_is_not_configured_for_is_refused(start, client):
    node = start(torque_path='native', modes='[joint_impedance]')
    client.connect()
    node.wait_for('torque path: native')
    answer = client.adjust(mode='cartesian_impedance')
    assert not answer.successful
    assert "'cartesian_impedance'; expected one of" in answer.reason
    assert client.adjust(mode='joint_impedance').successful
    assert client.adjust(mode='computed_torque').successful


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_modes_of_a_frame_run_natively_and_follow_targets(start, client):
    joints = [f'fr3_joint{k}' for k in range(1, 8)]
    listed = f'[{",".join(joints)}]'
    urdf = resource_path('urdf', 'fr3.urdf')
    start(module='kane_dynamics.ros.plant.main', urdf=urdf, joints=listed, rate=500,
          initial__position=HOME, command_timeout=100.0)
    node = start(urdf=urdf, joints=listed, mode='cartesian_impedance',
                 modes='[joint_impedance,hand_guiding]', cartesian__frame=FRAME,
                 torque_path='native', state_timeout=5.0,
                 joint_impedance__stiffness=[20.0] * 7)
    node.wait_for('torque path: native', 120.0)
    states = []
    subscription = client.create_subscription(TaskState, f'{NAME}/task_state',
                                              states.append, DEEP)
    targets = client.create_publisher(PoseStamped, f'{NAME}/target_pose', 1)
    try:
        assert wait_until(lambda: states and targets.get_subscription_count(),
                          60.0), node.log
        robot = Robot(load_urdf(urdf, joints=joints))
        goal = robot.frame_pose(FRAME, HOME)
        goal[:3, 3] += [0.05, 0.08, -0.06]
        message = PoseStamped()
        message.pose.position = Point(**dict(zip('xyz', goal[:3, 3].tolist())))
        message.pose.orientation = Quaternion(
            **dict(zip('xyzw', rotation_quaternion(goal[:3, :3]).tolist())))
        targets.publish(message)

        def distance():
            p = states[-1].pose.position
            return np.linalg.norm(goal[:3, 3] - [p.x, p.y, p.z])
        assert wait_until(lambda: distance() < 5e-4, 30.0), (distance(), node.log)
        assert states[-1].target_age > 0.0
        time.sleep(1.0)  # the arm comes to rest, where the next mode holds it
        for mode in ('joint_impedance', 'cartesian_impedance', 'hand_guiding'):
            assert client.adjust(mode=mode).successful
            assert wait_until(lambda mode=mode: states[-1].mode == mode, 10.0)
            time.sleep(0.5)
            # A stall of the machine moves an arm that an operator may lead.
            assert mode == 'hand_guiding' or distance() < 2e-3, mode
    finally:
        client.destroy_subscription(subscription)
        client.destroy_publisher(targets)
