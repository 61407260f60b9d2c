"""A dynamics node in its own process and a client of it, over DDS."""

from contextlib import contextmanager
import os
from pathlib import Path
import signal
import subprocess
import sys
import threading
import time

from diagnostic_msgs.msg import DiagnosticArray
from kane_dynamics.urdf import load_urdf
from lifecycle_msgs.srv import ChangeState, GetState
import numpy as np
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
import rclpy
from rclpy.action import ActionClient
from rclpy.exceptions import InvalidHandle
from rclpy.executors import (ExternalShutdownException, ShutdownException,
                             SingleThreadedExecutor)
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

NAME = '/kane_dynamics'
DYNAMICS_NODE = 'kane_dynamics.ros.dynamics_node.main'
JOINTS = ('turn', 'lift', 'reach')
TORQUE_PATH = os.environ.get('KANE_DYNAMICS_TEST_TORQUE_PATH', 'auto')
BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
DEEP = QoSProfile(depth=2000, reliability=ReliabilityPolicy.RELIABLE)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def _link(name, mass, x):
    return (f'<link name="{name}"><inertial><origin xyz="{x} 0.01 -0.02"/><mass '
            f'value="{mass}"/><inertia ixx="0.03" iyy="0.04" izz="0.05" ixy="0.001" '
            'ixz="0.002" iyz="0.003"/>'
            '</inertial></link>')


def _joint(name, kind, parent, child, axis, effort):
    return (f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child '
            f'link="{child}"/><origin xyz="0.1 0 0.3" rpy="0.2 0 0.1"/><axis '
            f'xyz="{axis}"/><dynamics damping="0.5" friction="0.2"/>'
            f'<limit lower="-3" upper="3" velocity="5" effort="{effort}"/></joint>')


URDF = ('<robot name="arm"><link name="base"/>'
        + _joint('turn', 'revolute', 'base', 'a', '0 0 1', 80) + _link('a', 3.0, 0.1)
        + _joint('lift', 'revolute', 'a', 'b', '0 1 0', 60) + _link('b', 2.0, 0.2)
        + _joint('reach', 'prismatic', 'b', 'c', '1 0 0', 90) + _link('c', 1.0, 0.0)
        + '</robot>')


def close(value, expected):
    """Return whether numbers agree to 1e-12 of the largest."""
    value = np.asarray(value)
    expected = np.asarray(expected)
    return np.abs(value - expected).max() <= 1e-12 * max(np.abs(expected).max(), 1.0)


def model():
    return load_urdf(URDF)


# Exit codes of processes that ended by a fault, which a log need not show.
FAULTS = [-number for number in (signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS,
                                 signal.SIGFPE, signal.SIGILL)]

# The states and motions of most tests are of no arm: they jump.
UNCHECKED = {'state_check__speed_factor': '.inf', 'state_check__position_margin': '.inf',
             'trajectory__start_tolerance': '.inf'}


class Process:
    """
    A node in its own process; by default the dynamics node.

    The dynamics node checks joint states as it does by default if `real_states` is true.
    `latest` is the one that was started last.
    """

    latest = None

    def __init__(self, *arguments, module=DYNAMICS_NODE, program=None, environment=None,
                 real_states=False, **parameters):
        if module == DYNAMICS_NODE and not program and not real_states:
            parameters = UNCHECKED | parameters
        command = [sys.executable, *(program or ['-m', module, '--ros-args'])]
        if module == DYNAMICS_NODE and program is None:
            # The client is no simulated robot; torques are compared with unlimited ones.
            choices = {'activation': 'at_once', 'limits__rate': '.inf',
                       'blend_time': '0.0', 'torque_path': TORQUE_PATH}
            if '--params-file' in arguments:  # what comes last is used
                del choices['activation']
                arguments = (*arguments, '-p', 'activation:=at_once')
            else:
                choices['arm_compensates'] = 'none'
            parameters = choices | parameters
        for name, value in parameters.items():
            if value is None:  # not stated
                continue
            command += ['-p', f'{name.replace("__", ".")}:={value}']
        self.log = ''
        Process.latest = self
        environment = os.environ | (environment or {}) | {
            'RCUTILS_LOGGING_BUFFERED_STREAM': '0',
            'PYTHONPATH': os.pathsep.join(filter(None, [
                str(Path(__file__).parents[2]), os.environ.get('PYTHONPATH', '')]))}
        self._process = subprocess.Popen(
            [*command, *arguments], stderr=subprocess.STDOUT,
            stdout=subprocess.PIPE, text=True, env=environment)
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self):
        for line in self._process.stdout:
            self.log += line

    @property
    def pid(self):
        return self._process.pid

    def alive(self):
        return self._process.poll() is None

    def wait_for(self, words, timeout=60.0):
        """Wait until the log contains some text."""
        wait_until(lambda: words in self.log or not self.alive(), timeout)
        assert words in self.log, self.log

    def end(self, number=signal.SIGINT, timeout=5.0):
        """Send a signal; return the exit code and the time until the exit, s."""
        began = time.monotonic()
        if self.alive():
            self._process.send_signal(number)
        try:
            code = self._process.wait(timeout)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
            raise
        finally:
            self._reader.join(1.0)
            self._process.stdout.close()
        return code, time.monotonic() - began


def end_all(processes):
    """End processes, also those that ended before; none may have ended by a fault."""
    codes = [process.end(timeout=30.0)[0] for process in processes]  # on a busy machine
    for process, code in zip(processes, codes):
        assert code not in FAULTS, (code, process.log)


def prefer(pid, priority):
    """Schedule a process's threads before those of other programs, where allowed."""
    for task in os.listdir(f'/proc/{pid}/task'):
        try:
            if os.sched_getscheduler(
                    int(task)) & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER:
                os.sched_setscheduler(int(task), os.SCHED_FIFO, os.sched_param(priority))
        except OSError:
            break


def active_until_end(process):
    """Yield a node once it is active; it must then end without an error."""
    try:
        process.wait_for('active, mode', 120.0)
        yield process
    finally:
        code = process.end(timeout=30.0)[0]  # on a busy machine
    assert code == 0
    assert 'Traceback' not in process.log


def wait_until(condition, timeout=10.0):
    """Wait until a condition holds; return whether it does."""
    end = time.monotonic() + timeout
    while not (holds := condition()) and time.monotonic() < end:
        time.sleep(0.005)
    return holds


class Stall:
    """Measures the longest delay of a thread by the machine while a block runs."""

    def __enter__(self):
        self.longest, self._ended = 0.0, threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()
        return self

    def _look(self):
        start = time.perf_counter()
        while not self._ended.wait(0.005):
            now = time.perf_counter()
            self.longest = max(self.longest, now - start)
            start = now

    def __exit__(self, *error):
        self._ended.set()
        self._thread.join()


class Client(Node):
    """Publishes joint states, keeps the received messages, and calls services."""

    def __init__(self, joints=JOINTS):
        super().__init__('client')
        self.joints = joints
        self.torques = {}  # by stamp, ns
        self.names = ()
        self.commands = []
        self.diagnostics = []
        self.states = self.create_publisher(JointState, 'joint_states', BEST_EFFORT)
        self.motions = self.create_publisher(JointTrajectory, f'{NAME}/joint_trajectory',
                                             1)
        self._subscriptions_of_torques = []
        self.listen(True)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics,
                                 DEEP)
        self.spinner = SingleThreadedExecutor()
        self.spinner.add_node(self)
        self._ended = False
        self._service_clients = {}
        self._discovered = {}  # by service, the servers that have answered
        self._action_clients = {}
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    @contextmanager
    def describing(self):
        """Publish the URDF while a block runs; its latched message ends with it."""
        publisher = self.create_publisher(String, 'robot_description', LATCHED)
        try:
            yield publisher
        finally:
            self.destroy_publisher(publisher)

    def _spin(self):
        while not self._ended:
            try:
                self.spinner.spin_once(timeout_sec=0.5)
            except (ExternalShutdownException, ShutdownException):
                return
            except InvalidHandle:  # an entity was destroyed during the call
                continue

    def close(self):
        self._ended = True
        self.spinner.wake()
        self._thread.join(2.0)
        self.spinner.shutdown()
        self.destroy_node()

    def listen(self, on):
        """Subscribe to torques and commands, or unsubscribe."""
        for subscription in self._subscriptions_of_torques:
            self.destroy_subscription(subscription)
        self._subscriptions_of_torques = [
            self.create_subscription(JointState, f'{NAME}/joint_torques',
                                     self._on_torques, DEEP),
            self.create_subscription(Float64MultiArray, 'commands',
                                     lambda m: self.commands.append(list(m.data)), DEEP),
        ] if on else []

    def _on_torques(self, message):
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        self.torques[stamp] = np.array(message.effort)
        self.names = tuple(message.name)

    def _on_diagnostics(self, message):
        for status in message.status:
            self.diagnostics.append((status.level, status.message,
                                     {pair.key: pair.value for pair in status.values}))

    def send(self, q, u=None, names=None, stamp=None):
        """Publish a joint state; return its stamp."""
        stamp = time.time_ns() if stamp is None else stamp
        message = JointState(name=list(self.joints if names is None else names))
        message.position = list(map(float, q))
        if u is not None:
            message.velocity = list(map(float, u))
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        self.states.publish(message)
        return stamp

    def ask(self, q, u=None, names=None, stamp=None, timeout=2.0):
        """Publish a joint state; return its torques, or None."""
        stamp = self.send(q, u, names, stamp)
        wait_until(lambda: stamp in self.torques, timeout)
        return self.torques.get(stamp)

    def rest(self, stamp=None):
        return self.ask(np.zeros(len(self.joints)), np.zeros(len(self.joints)),
                        stamp=stamp, timeout=0.3)

    def connect(self, timeout=60.0):
        """Wait until the node computes torques."""
        assert wait_until(lambda: self.rest() is not None, timeout), (
            'the node publishes no torques; log: '
            f'{Process.latest and Process.latest.log}')

    def _service_client(self, kind, name, timeout):
        if name not in self._service_clients:
            self._service_clients[name] = self.create_client(kind, name)
        assert self._service_clients[name].wait_for_service(timeout), name
        return self._service_clients[name]

    def _await_discovery(self, name, timeout):
        """
        Wait until the process of a service has discovered this client.

        `wait_for_service` tells what this side has discovered. A server that has not
        discovered the client's reader sends its answer nowhere, after 0.1 s
        (rmw_fastrtps), and a busy machine discovers later than that. Endpoints are
        announced reliably and in order, so that the answer to a client that is made last
        shows that all others are discovered. Only the first call of a process's service
        waits for it, by reading no parameters, repeatedly.
        """
        # The publishers of a service's answers are new with each process.
        rows = []
        for publisher in self.get_publishers_info_by_topic(f'rr{name}Reply',
                                                           no_mangle=True):
            rows.append(bytes(publisher.endpoint_gid))
        servers = frozenset(rows)
        if servers and self._discovered.get(name) == servers:
            return
        node, _, _ = name.rpartition('/')
        probe = self.create_client(GetParameters, f'{node}/get_parameters')
        answers = []

        def answered():
            if not answers or time.monotonic() - answers[-1][0] > 1.0:
                answers.append(
                    (time.monotonic(), probe.call_async(GetParameters.Request())))
            return any(future.done() for _, future in answers)
        try:
            assert probe.wait_for_service(timeout), f'{node} has no parameters'
            assert wait_until(answered,
                              timeout), f'{node} does not answer get_parameters'
        finally:
            self.destroy_client(probe)
        self._discovered[name] = servers

    def call(self, kind, name, timeout=20.0, **fields):
        """Call a service; return its response."""
        name = name if name.startswith('/') else f'{NAME}/{name}'
        client = self._service_client(kind, name, timeout)
        self._await_discovery(name, timeout)
        future = client.call_async(kind.Request(**fields))
        assert wait_until(future.done, timeout), f'{name} does not answer'
        return future.result()

    def on_spinner(self, function):
        """
        Return what a function returns that runs where messages are taken.

        A goal's answer that comes before its request is noted is lost in an action
        client, which locks nothing; on the thread that takes the answers it cannot come
        before.
        """
        task = self.spinner.create_task(function)
        assert wait_until(task.done), 'the client does not spin'
        return task.result()

    def send_goal(self, kind, name, feedback_callback=None, **fields):
        """Send a goal; return its handle and the future of its result."""
        name = name if name.startswith('/') else f'{NAME}/{name}'
        # kept: an executor cannot bear that one is destroyed
        if name not in self._action_clients:
            self._action_clients[name] = ActionClient(self, kind, name)
        client = self._action_clients[name]
        assert client.wait_for_server(20.0), name
        sent = self.on_spinner(lambda: client.send_goal_async(
            kind.Goal(**fields), feedback_callback=feedback_callback))
        assert wait_until(sent.done), f'{name} does not answer'
        handle = sent.result()
        assert handle.accepted
        return handle, self.on_spinner(handle.get_result_async)

    def transition(self, number):
        request = ChangeState.Request()
        request.transition.id = number
        return self.call(ChangeState, 'change_state',
                         transition=request.transition).success

    def state(self, timeout=20.0):
        """
        Return the lifecycle state; ask again where no node answers.

        The services of a killed node are seen until its lease ends, so that a request
        can be sent before the node that follows it is known.
        """
        answers = []

        def answered():
            if not answers or time.monotonic() - answers[-1][0] > 1.0:
                answers.append((time.monotonic(), client.call_async(GetState.Request())))
            return any(future.done() for _, future in answers)

        client = self._service_client(GetState, f'{NAME}/get_state', timeout)
        assert wait_until(answered, timeout), 'get_state does not answer'
        return next(future for _, future in reversed(answers)
                    if future.done()).result().current_state.label

    def adjust(self, node=NAME, /, **parameters):
        """Set parameters of a node together; return the result."""
        messages = [Parameter(name.replace('__', '.'), value=value).to_parameter_msg()
                    for name, value in parameters.items()]
        assert all(isinstance(message, ParameterMessage) for message in messages)
        return self.call(SetParametersAtomically, f'{node}/set_parameters_atomically',
                         parameters=messages).result

    def follow(self, points, names=None, start=None, velocities=None):
        """Publish a desired motion; points is a list of (time, positions)."""
        message = JointTrajectory(
            joint_names=list(self.joints if names is None else names))
        if start is not None:
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(start, 10**9)
        for k, (t, positions) in enumerate(points):
            point = JointTrajectoryPoint(positions=[float(x) for x in positions])
            if velocities is not None:
                point.velocities = [float(x) for x in velocities[k]]
            point.time_from_start.sec, point.time_from_start.nanosec = divmod(
                round(t * 1e9), 10**9)
            message.points.append(point)
        self.motions.publish(message)


def start_client(joints=JOINTS):
    if not rclpy.ok():
        rclpy.init()
    return Client(joints)
