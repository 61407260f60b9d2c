"""
The processes whose round trips are compared: the node, empty echo nodes, a load.

An echo is a node that answers each joint state with an array of the same size: in Python
on rclpy's default executor or on the EventsExecutor, or in C (echo.c). The load calls
the node's simulation service back to back. The arguments are `load` and a robot, or a
namespace and the name of an echo.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
import ctypes
import os
from pathlib import Path
import shutil
import signal
import subprocess
import sys
import threading

from kane_dynamics.demo.demo_settings import DemoRobot, FR3
from kane_dynamics_interfaces.srv import Simulate
import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

sys.path.append(str(Path(__file__).resolve().parents[1] / 'test' / 'helpers'))
from moved_palletizer import PALLETIZER  # noqa: E402, I100

ROBOTS = {'fr3': FR3, 'palletizer': PALLETIZER}
SHORT = 0.5  # s: before the falling palletizer comes to a dead point
OURS = 'node'
DEFAULT = 'echo, default executor'
EVENTS = 'echo, EventsExecutor'
IN_C = 'echo in C'
NAMESPACES = {OURS: '/ours', DEFAULT: '/default', EVENTS: '/events', IN_C: '/c'}
SOURCE = Path(__file__).with_name('echo.c')
LIBRARY = Path(__file__).resolve().parents[1] / 'build' / 'bench' / 'echo.so'
LIBRARIES = ('rcl', 'rcutils', 'rosidl_runtime_c', 'sensor_msgs__rosidl_typesupport_c',
             'sensor_msgs__rosidl_generator_c', 'std_msgs__rosidl_typesupport_c',
             'std_msgs__rosidl_generator_c')
REALTIME = ['-p', 'realtime.priority:=50', '-p', 'realtime.lock_memory:=true']
BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
RELIABLE = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)


def echo(namespace: str, executor: str) -> None:
    """Run an empty node: publish one array for each joint state."""
    if executor == IN_C:
        sys.exit(ctypes.CDLL(str(LIBRARY)).echo(namespace.encode()))
    rclpy.init()
    node = Node('echo', namespace=namespace)
    publisher = node.create_publisher(Float64MultiArray, 'commands', RELIABLE)
    node.create_subscription(
        JointState, 'joint_states',
        lambda message: publisher.publish(Float64MultiArray(data=message.position)),
        BEST_EFFORT)
    spinner = EventsExecutor() if executor == EVENTS else SingleThreadedExecutor()
    spinner.add_node(node)
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        spinner.spin_until_future_complete(Future(), 1e6)


def compile_echo() -> str:
    """Compile echo.c against the installed ROS; return why that fails, or ''."""
    if shutil.which('gcc') is None:
        return 'there is no gcc'
    prefixes = [Path(prefix) for prefix in (
        *os.environ.get('AMENT_PREFIX_PATH', '').split(':'), sys.prefix) if prefix]
    prefix = next((folder for folder in prefixes
                   if (folder / 'include/rcl/rcl/rcl.h').exists()), None)
    if prefix is None:
        return 'there are no headers of rcl in AMENT_PREFIX_PATH'
    LIBRARY.parent.mkdir(parents=True, exist_ok=True)
    done = subprocess.run(
        ['gcc', '-O2', '-fPIC', '-shared',
         *(f'-I{folder}' for folder in prefix.glob('include/*')),
         str(SOURCE), '-o', str(LIBRARY), f'-L{prefix}/lib', f'-Wl,-rpath,{prefix}/lib',
         *(f'-l{folder}' for folder in LIBRARIES)],
        capture_output=True, text=True, check=False)
    return f'gcc failed: {done.stderr[-2000:]}' if done.returncode else ''


def load(robot: DemoRobot) -> None:
    """Repeat simulations, from each line of standard input to the next."""
    rclpy.init()
    node = Node('load', namespace=NAMESPACES[OURS])
    client = node.create_client(Simulate, 'kane_dynamics/simulate')
    client.wait_for_service()
    enough = threading.Event()
    ended = threading.Event()

    def read() -> None:
        for _ in sys.stdin:
            (enough.clear if enough.is_set() else enough.set)()
        ended.set()
        enough.set()

    threading.Thread(target=read, daemon=True).start()
    done = 0
    request = Simulate.Request(joint_names=list(robot.positions),
                               position=list(robot.positions.values()),
                               duration=10.0 if robot.constraints is None else SHORT)
    print('ready', flush=True)
    while enough.wait() and not ended.is_set():
        future = client.call_async(request)
        rclpy.spin_until_future_complete(node, future)
        done += future.result().success
    print(done, flush=True)


@contextmanager
def contenders(
        robot: str, names: Sequence[str], *more: str) -> Iterator[subprocess.Popen[str]]:
    """Run these echoes and the node in a block; yield the process for simulations."""
    node = [sys.executable, '-m', 'kane_dynamics.ros.dynamics_node.main', '--ros-args',
            '-r', f'__ns:={NAMESPACES[OURS]}', '-p', 'state_timeout:=5.0',
            '-p', 'mode:=computed_torque', '-p', 'activation:=at_once',
            '-p', 'limits.rate:=.inf', *more]
    for key, value in ROBOTS[robot].parameters.items():
        node += ['-p', f'{key}:={value}']
    commands = [node] + [[sys.executable, __file__, NAMESPACES[name], name]
                         for name in names]
    running = [subprocess.Popen(command, stderr=subprocess.DEVNULL)
               for command in commands]
    loader = subprocess.Popen([sys.executable, __file__, 'load', robot],
                              stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        yield loader
    finally:
        assert loader.stdin is not None
        loader.stdin.close()  # which ends it, once its last request is answered
        for process in [loader, *running]:
            if process is not loader:
                process.send_signal(signal.SIGINT)
            try:
                process.wait(5.0)
            except subprocess.TimeoutExpired:
                process.kill()


if __name__ == '__main__':
    if sys.argv[1] == 'load':
        load(ROBOTS[sys.argv[2]])
    else:
        echo(*sys.argv[1:])
