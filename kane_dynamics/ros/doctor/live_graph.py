"""What `kane-dynamics doctor` finds in a live graph."""

from collections.abc import Callable
import time
from typing import NamedTuple

from kane_dynamics.analysis.model_checks import examine_efforts, Finding, listed
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import Array, NANO, nanoseconds
import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo
from sensor_msgs.msg import JointState

STATES = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
AT_REST = 1e-2  # rad/s or m/s: slower joints stand
SLOW = 50.0  # joint states a second: fewer are few for a torque loop
STALE = 0.1  # s: an older state comes too late for a torque
# A newcomer gets what it missed with the heartbeats of the others, every 3 s (Fast DDS): first
# who publishes and listens, then, with the next, how these nodes are called.
DISCOVERY = 7.0  # s
WEIGHTLESS = 1e-3  # N m or N: an arm that asks less of its motors may measure zeros
NAMELESS = '_NODE_NAME_UNKNOWN_'


class Topics(NamedTuple):
    """How the topics of the torque path are called in the graph."""

    commands: str
    joint_states: str


class Heard(NamedTuple):
    """A joint state and when it came: by the steady clock and by the node's, ns."""

    steady: int
    now: int
    message: JointState


def examine_graph(robot: Robot, seconds: float, namespace: str = '', commands: str = 'commands',
                  joint_states: str = 'joint_states') -> list[Finding]:
    """
    Listen to a live graph for some time; return what is wrong in it.

    Where somebody publishes /clock, ages are by that; rates are by the steady clock.

    Parameters
    ----------
    robot : Robot
        That joint states and commands are for.
    seconds : float
        How long to listen, after the up to 7 s that finding the others' nodes takes.
    namespace : str
        Of the arm.
    commands, joint_states : str
        Topics; they may be the controller's own.

    """
    topics = Topics(commands, joint_states)
    context = Context()
    rclpy.init(context=context)
    try:
        node = Node('kane_dynamics_doctor', namespace=namespace, context=context)
        heard: list[Heard] = []
        node.create_subscription(
            JointState, topics.joint_states, lambda message: heard.append(
                Heard(time.monotonic_ns(), node.get_clock().now().nanoseconds, message)), STATES)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        _spin(executor, DISCOVERY, lambda: _discovered(node, topics))
        strangers: set[tuple[str, ...]] = set()
        if _spin(executor, seconds, lambda: node.count_publishers('/clock') > 0):
            node.set_parameters([Parameter('use_sim_time', value=True)])
            _spin(executor, DISCOVERY, lambda: node.get_clock().now().nanoseconds > 0)
            strangers = _strangers(robot, heard)
            heard.clear()
            _spin(executor, seconds, lambda: False)
        found = [*examine_states(robot, heard, seconds),
                 *_lines(node, topics, len(strangers | _strangers(robot, heard)))]
        executor.remove_node(node)
        node.destroy_node()
        return found
    finally:
        rclpy.try_shutdown(context=context)


def _spin(executor: SingleThreadedExecutor, seconds: float, enough: Callable[[], bool]) -> bool:
    """Take what comes for some time or until it is enough; return whether it is."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if enough():
            return True
        executor.spin_once(timeout_sec=0.05)
    return enough()


def _strangers(robot: Robot, heard: list[Heard]) -> set[tuple[str, ...]]:
    """Return the lists of names without our joints: who publishes one does not share ours."""
    return {names for each in heard
            if not set(names := tuple(each.message.name)) & set(robot.joint_names)}


def examine_states(robot: Robot, heard: list[Heard], seconds: float) -> list[Finding]:
    """Return what the joint states say that came within some time."""
    if not heard:
        return [Finding('problem', f'no joint state came within {seconds:g} s: is the driver '
                        'running, on the same ROS_DOMAIN_ID, namespace and topic '
                        '(--joint-states)?')]
    complete = [each for each in heard if set(robot.joint_names) <= set(each.message.name)]
    if not complete:
        seen = sorted({name for each in heard for name in each.message.name})
        missing = [name for name in robot.joint_names if name not in seen]
        return [Finding('problem', f'no joint state names all joints: {listed(missing)} missing; '
                        f'they name {listed(seen)}')]
    return [*_times(complete), *_numbers(robot, complete[-1].message)]


def _times(heard: list[Heard]) -> list[Finding]:
    """Return what rate and stamps say."""
    # Between the first and the last: they also came while the nodes were being found.
    rate = (len(heard) - 1) * NANO / max(heard[-1].steady - heard[0].steady, 1)
    found = [Finding('fine' if rate > SLOW else 'doubt',
                     f'{rate:.3g} joint states a second name all joints')]
    stamped = [(each.now, stamp) for each in heard
               if (stamp := nanoseconds(each.message.header.stamp))]
    if not stamped:
        return [*found, Finding('doubt', 'the stamps of joint states are zero: how late they come '
                                'is not to be known, and state_timeout does not notice it')]
    ages = [(now - stamp) / NANO for now, stamp in stamped if now]
    if not ages:
        return [*found, Finding('problem', 'somebody publishes /clock, but nothing came on it: '
                                'a node with use_sim_time waits for ever')]
    age = float(np.median(ages))
    if abs(age) > STALE:
        found.append(Finding('problem', f'the stamps of joint states are {age:.3g} s old when '
                             'they come: clocks differ, or use_sim_time does'))
    return found


def _numbers(robot: Robot, message: JointState) -> list[Finding]:
    """Return what the numbers of one joint state say."""
    index = [list(message.name).index(name) for name in robot.joint_names]
    q, u, effort = (np.array(values, dtype=np.float64)[index]
                    if len(values) == len(message.name) else None
                    for values in (message.position, message.velocity, message.effort))
    if q is None or u is None:
        return [Finding('problem', 'joint states come without '
                        f'{"position" if q is None else "velocity"}')]
    found = [Finding('problem', f'{what} that are not finite: {listed(names)}; the dynamics node '
                     'drops such states')
             for what, values in (('positions', q), ('velocities', u))
             if (names := _not_finite(robot, values))]
    with np.errstate(invalid='ignore'):
        beyond = [name for name, outside in zip(
            robot.joint_names, (q < robot.limits.lower) | (q > robot.limits.upper)) if outside]
    if beyond:
        found.append(Finding('problem', f'joints stand outside the limits of the URDF: '
                             f'{listed(beyond)}; is it the URDF of this arm, in rad?'))
    return found + _efforts(robot, q, u, effort)


def _efforts(robot: Robot, q: Array, u: Array, effort: Array | None) -> list[Finding]:
    """Return what the efforts of one joint state say."""
    if effort is None:
        return [Finding('doubt', 'joint states come without efforts: the momentum observer then '
                        'goes by the command')]
    if names := _not_finite(robot, effort):
        return [Finding('doubt', f'efforts that are not finite: {listed(names)}; the momentum '
                        'observer then goes by the command')]
    if robot.constraint_names or not np.isfinite([q, u]).all() or (
            np.abs(u).max(initial=0.0) >= AT_REST):
        return []
    if effort.any():
        return examine_efforts(robot, q, effort)
    if np.abs(robot.gravity_force(q)).max(initial=0.0) < WEIGHTLESS:
        return []
    return [Finding('doubt', 'at rest all efforts are zero: brakes hold the arm, or the driver '
                    'does not measure them; then set observer.torque: command, for auto takes '
                    'them for measured')]


def _not_finite(robot: Robot, values: Array) -> list[str]:
    """Return the joints whose numbers are not finite."""
    return [name for name, good in zip(robot.joint_names, np.isfinite(values)) if not good]


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


def _discovered(node: Node, topics: Topics) -> bool:
    """Return whether each line of the torque path has both ends, and each end a name."""
    lines = (_publishers(node, topics.joint_states), _publishers(node, topics.commands),
             _subscribers(node, topics.commands))
    return all(lines) and all(end.node_name != NAMELESS for line in lines for end in line)


def _lines(node: Node, topics: Topics, strangers: int) -> list[Finding]:
    """Return who publishes and who listens on the topics of the torque path."""
    found = []
    states = _publishers(node, topics.joint_states)
    if len(states) - strangers > 1:
        others = f', {strangers} of them for other joints' if strangers else ''
        found.append(Finding('problem', f'{len(states)} publishers share {topics.joint_states}'
                             f'{others}: {_names(states)}'))
    given, taken = _publishers(node, topics.commands), _subscribers(node, topics.commands)
    if len(given) > 1:
        found.append(Finding('problem', f'{len(given)} publishers share {topics.commands}: '
                             f'{_names(given)}'))
    elif not given:
        found.append(Finding('doubt', f'nobody publishes {topics.commands}: is the dynamics node '
                             'running, and this the topic of its commands (--commands)?'))
    if not taken:
        found.append(Finding('doubt', f'nobody listens to {topics.commands}: is the effort '
                             'controller loaded, and the topic remapped to its own?'))
    if given and taken:
        deaf = [end for end in taken
                if end.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
                or (end.qos_profile.reliability == ReliabilityPolicy.RELIABLE
                    and given[0].qos_profile.reliability != ReliabilityPolicy.RELIABLE)]
        found.append(Finding('problem', f'the QoS of {topics.commands} keeps them from '
                             f'{_names(deaf)}') if deaf else
                     Finding('fine', f'{_names(given)} commands {_names(taken)}'))
    volatile = [end for end in _publishers(node, 'robot_description')
                if end.qos_profile.durability != DurabilityPolicy.TRANSIENT_LOCAL]
    if volatile:
        found.append(Finding('problem', f'robot_description from {_names(volatile)} is not '
                             'latched (transient local): a node that starts later never gets it'))
    return found
