"""What `kane-dynamics doctor` finds in a configuration and in a live graph."""

from collections.abc import Mapping
from pathlib import Path
import time
from typing import Any

from kane_dynamics.errors import InputError, KaneError
from kane_dynamics.examination import examine_efforts, Finding, listed
from kane_dynamics.robot import Robot
from kane_dynamics.ros.conversion import NANO, nanoseconds
from kane_dynamics.ros.parameters import controller_settings, misspelt, read
from kane_dynamics.ros.specs import SPECS
import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo
from sensor_msgs.msg import JointState
import yaml

STATES = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
AT_REST = 1e-2  # rad/s or m/s: slower joints stand
SLOW = 50.0  # joint states a second: fewer are few for a torque loop
STALE = 0.1  # s: an older state comes too late for a torque
# A newcomer gets what it missed with the heartbeats of the others, every 3 s (Fast DDS): first
# who publishes and listens, then, with the next, how these nodes are called.
DISCOVERY = 7.0  # s
NAMELESS = '_NODE_NAME_UNKNOWN_'


def examine_configuration(path: Path, robot: Robot) -> list[Finding]:
    """
    Return what is wrong with a parameter file of the dynamics node for this robot.

    Raises
    ------
    InputError
        The file is no parameter file of ROS 2.

    """
    given = _parameters(path)
    known = {spec.name: spec for spec in SPECS}
    found = [Finding('problem', f'{path.name}: {remark}')
             for remark in misspelt(list(given), known)]
    values = {}
    for name, spec in known.items():
        try:
            values[name] = read(spec, given.get(name, spec.default))
        except InputError as error:
            found.append(Finding('problem', f'{path.name}: {error}'))
    if len(values) < len(known):
        return found
    joints = values['joints'] or robot.joint_names
    strangers = [name for name in joints if name not in robot.joint_names]
    if strangers:
        found.append(Finding('problem', f'{path.name}: joints that the URDF does not move: '
                             f'{listed(strangers)}; it moves {listed(robot.joint_names)}'))
    try:
        controller_settings(values, joints)
    except KaneError as error:
        found.append(Finding('problem', f'{path.name}: {error}'))
    if values['gravity'][2] > 0.0 or not np.isclose(np.linalg.norm(values['gravity']), 9.81, 0.01):
        found.append(Finding('doubt', f"{path.name}: gravity is {values['gravity'].tolist()}; on "
                             'the ground, with the base upright, it is [0, 0, -9.81]'))
    return found or [Finding('fine', f'{path.name}: every parameter is known and fits the arm')]


def _parameters(path: Path) -> dict[str, Any]:
    """Return the parameters in a file by their dotted names, whatever node they are for."""
    try:
        data = yaml.safe_load(path.read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise InputError(f'{path}: {error}') from None
    blocks = [block['ros__parameters'] for block in (data or {}).values()
              if isinstance(block, Mapping) and isinstance(block.get('ros__parameters'), Mapping)
              ] if isinstance(data, Mapping) else []
    if not blocks:
        raise InputError(f'{path}: no ros__parameters under the name of a node, or /**')
    result: dict[str, Any] = {}

    def flatten(prefix: str, block: Mapping[str, Any]) -> None:
        for key, value in block.items():
            if isinstance(value, Mapping):
                flatten(f'{prefix}{key}.', value)
            else:
                result[f'{prefix}{key}'] = value
    for block in blocks:
        flatten('', block)
    return result


def examine_graph(robot: Robot, seconds: float, namespace: str = '') -> list[Finding]:
    """
    Listen to a live graph for some time; return what is wrong in it.

    Parameters
    ----------
    robot : Robot
        That joint states and commands are for.
    seconds : float
        How long to listen, after the up to 7 s that finding the others' nodes takes.
    namespace : str
        Of the arm.

    """
    context = Context()
    rclpy.init(context=context)
    try:
        node = Node('kane_dynamics_doctor', namespace=namespace, context=context)
        heard: list[tuple[int, JointState]] = []
        node.create_subscription(
            JointState, 'joint_states',
            lambda message: heard.append((node.get_clock().now().nanoseconds, message)), STATES)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        end = time.monotonic() + DISCOVERY
        while time.monotonic() < end and not _discovered(node):
            executor.spin_once(timeout_sec=0.05)
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            executor.spin_once(timeout_sec=0.05)
        found = [*_states(robot, heard, seconds), *_lines(node)]
        executor.remove_node(node)
        node.destroy_node()
        return found
    finally:
        rclpy.try_shutdown(context=context)


def _states(robot: Robot, heard: list[tuple[int, JointState]], seconds: float) -> list[Finding]:
    """Return what the joint states that came say."""
    if not heard:
        return [Finding('problem', f'no joint state came within {seconds:g} s: is the driver '
                        'running, on the same ROS_DOMAIN_ID and namespace?')]
    found = []
    complete = [(at, message) for at, message in heard
                if set(robot.joint_names) <= set(message.name)]
    if not complete:
        seen = sorted({name for _, message in heard for name in message.name})
        missing = [name for name in robot.joint_names if name not in seen]
        return [Finding('problem', f'no joint state names all joints: {listed(missing)} missing; '
                        f'they name {listed(seen)}')]
    came = np.array([at for at, _ in complete])
    # Between the first and the last: they also came while the nodes were being found.
    rate = (len(came) - 1) * NANO / max(int(came[-1] - came[0]), 1)
    found.append(Finding('fine' if rate > SLOW else 'doubt',
                         f'{rate:.3g} joint states a second name all joints'))
    ages = (came - [nanoseconds(message.header.stamp) for _, message in complete]) / NANO
    if np.median(ages) > STALE or np.median(ages) < -STALE:
        found.append(Finding('problem', f'the stamps of joint states are {np.median(ages):.3g} s '
                             'old when they come: clocks differ, or use_sim_time does'))
    message = complete[-1][1]
    index = [list(message.name).index(name) for name in robot.joint_names]
    q, u, effort = (np.array(values, dtype=np.float64)[index]
                    if len(values) == len(message.name) else None
                    for values in (message.position, message.velocity, message.effort))
    if q is None or u is None:
        return [*found, Finding('problem', 'joint states come without '
                                f'{"position" if q is None else "velocity"}')]
    beyond = [name for name, x, low, high in zip(robot.joint_names, q, robot.limits.lower,
                                                 robot.limits.upper) if not low <= x <= high]
    if beyond:
        found.append(Finding('problem', f'joints stand outside the limits of the URDF: '
                             f'{listed(beyond)}; is it the URDF of this arm, in rad?'))
    if effort is None:
        return [*found, Finding('doubt', 'joint states come without efforts: the momentum '
                                'observer then goes by the command')]
    if np.abs(u).max(initial=0.0) < AT_REST and effort.any():
        found += examine_efforts(robot, q, effort)
    return found


def _publishers(node: Node, topic: str) -> list[TopicEndpointInfo]:
    ends: list[TopicEndpointInfo] = node.get_publishers_info_by_topic(
        node.resolve_topic_name(topic))
    return ends


def _subscribers(node: Node, topic: str) -> list[TopicEndpointInfo]:
    ends: list[TopicEndpointInfo] = node.get_subscriptions_info_by_topic(
        node.resolve_topic_name(topic))
    return ends


def _names(ends: list[TopicEndpointInfo]) -> str:
    """Return how the nodes of these publishers or subscribers are called, in words."""
    return listed('a program without a node' if end.node_name == NAMELESS else end.node_name
                  for end in ends)


def _discovered(node: Node) -> bool:
    """Return whether each line of the torque path has both ends, and each end a name."""
    lines = (_publishers(node, 'joint_states'), _publishers(node, 'commands'),
             _subscribers(node, 'commands'))
    return all(lines) and all(end.node_name != NAMELESS for line in lines for end in line)


def _lines(node: Node) -> list[Finding]:
    """Return who publishes and who listens on the topics of the torque path."""
    found = []
    states = _publishers(node, 'joint_states')
    if len(states) > 1:
        found.append(Finding('problem', f'{len(states)} publishers share joint_states: '
                             f'{_names(states)}'))
    given, taken = _publishers(node, 'commands'), _subscribers(node, 'commands')
    if len(given) > 1:
        found.append(Finding('problem', f'{len(given)} publishers share commands: '
                             f'{_names(given)}'))
    elif not given:
        found.append(Finding('doubt', 'nobody publishes commands: is the dynamics node running?'))
    if not taken:
        found.append(Finding('doubt', 'nobody listens to commands: is the effort controller '
                             'loaded, and the topic remapped to its own?'))
    if given and taken:
        deaf = [end for end in taken
                if end.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
                or (end.qos_profile.reliability == ReliabilityPolicy.RELIABLE
                    and given[0].qos_profile.reliability != ReliabilityPolicy.RELIABLE)]
        found.append(Finding('problem', f'the QoS of commands keeps them from {_names(deaf)}')
                     if deaf else
                     Finding('fine', f'{_names(given)} commands {_names(taken)}'))
    volatile = [end for end in _publishers(node, 'robot_description')
                if end.qos_profile.durability != DurabilityPolicy.TRANSIENT_LOCAL]
    if volatile:
        found.append(Finding('problem', f'robot_description from {_names(volatile)} is not '
                             'latched (transient local): a node that starts later never gets it'))
    return found
