"""The checks of `kane-dynamics doctor` for a live ROS graph."""

from collections.abc import Callable
import time
from typing import NamedTuple

from kane_dynamics.analysis.model_checks import examine_efforts, Finding, listed
from kane_dynamics.control.computed_torque import joints_that_follow
from kane_dynamics.identification.efforts import Efforts
from kane_dynamics.loop_tracking.loop_error import LoopError
from kane_dynamics.loop_tracking.loop_tracker import LoopTracker
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.command_topic import commanders, several_commanders
from kane_dynamics.ros.common.conversion import Array, NANO, nanoseconds
from kane_dynamics.ros.common.qos import EXAMINED_STATES
import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo
from sensor_msgs.msg import JointState

AT_REST = 1e-2  # largest speed of a joint at rest, rad/s or m/s
SLOW = 50.0  # smallest acceptable rate of joint states, 1/s
STALE = 0.1  # largest acceptable age of a joint state, s
# Fast DDS sends missed discovery data with heartbeats, every 3 s: first the endpoints, then, with
# the next heartbeat, the names of their nodes.
DISCOVERY = 7.0  # s
WEIGHTLESS = 1e-3  # N m or N: below this gravity torque, zero efforts are plausible
NAMELESS = '_NODE_NAME_UNKNOWN_'


class ReceivedState(NamedTuple):
    """A joint state and its time of reception, on the steady and the node's clock, ns."""

    steady: int
    now: int
    message: JointState


def examine_graph(robot: Robot, seconds: float, namespace: str = '', commands: str = 'commands',
                  joint_states: str = 'joint_states',
                  efforts: Efforts | None = None) -> list[Finding]:
    """
    Subscribe to the topics of a live graph for some time and return the findings.

    Ages refer to /clock if it is published; rates always refer to the steady clock.

    Parameters
    ----------
    robot : Robot
        The robot of the joint states and commands.
    seconds : float
        Duration of the subscription, after up to 7 s of discovery.
    namespace : str
        Namespace of the arm.
    commands, joint_states : str
        Names of the topics, for example those of a controller.
    efforts : Efforts, optional
        The stated meaning of the efforts; default: not stated.

    """
    context = Context()
    rclpy.init(context=context)
    try:
        node = Node('kane_dynamics_doctor', namespace=namespace, context=context)
        received: list[ReceivedState] = []
        node.create_subscription(
            JointState, joint_states, lambda message: received.append(ReceivedState(
                time.monotonic_ns(), node.get_clock().now().nanoseconds, message)),
            EXAMINED_STATES)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        _spin(executor, DISCOVERY, lambda: _discovered(node, commands, joint_states))
        foreign: set[tuple[str, ...]] = set()
        if _spin(executor, seconds, lambda: node.count_publishers('/clock') > 0):
            node.set_parameters([Parameter('use_sim_time', value=True)])
            _spin(executor, DISCOVERY, lambda: node.get_clock().now().nanoseconds > 0)
            foreign = _foreign_names(robot, received)
            received.clear()
            _spin(executor, seconds, lambda: False)
        if not _named(_lines(node, commands, joint_states)):  # found only now, not heard yet
            _spin(executor, DISCOVERY, lambda: _named(_lines(node, commands, joint_states)))
            _spin(executor, seconds, lambda: False)
        found = [*examine_states(robot, received, seconds, efforts),
                 *_endpoint_findings(node, commands, joint_states,
                                     len(foreign | _foreign_names(robot, received)))]
        executor.remove_node(node)
        node.destroy_node()
        return found
    finally:
        rclpy.try_shutdown(context=context)


def _spin(executor: SingleThreadedExecutor, seconds: float, enough: Callable[[], bool]) -> bool:
    """Spin for some time or until `enough` returns True; return its result."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if enough():
            return True
        executor.spin_once(timeout_sec=0.05)
    return enough()


def _foreign_names(robot: Robot, received: list[ReceivedState]) -> set[tuple[str, ...]]:
    """Return the name lists of joint states without any joint of the robot."""
    return {names for each in received
            if not set(names := tuple(each.message.name)) & set(robot.joint_names)}


def examine_states(robot: Robot, received: list[ReceivedState], seconds: float,
                   efforts: Efforts | None = None) -> list[Finding]:
    """Return the findings of the joint states received within some time."""
    if not received:
        return [Finding('problem', f'joint states: none within {seconds:g} s; expected a driver '
                        'with the same ROS_DOMAIN_ID, namespace and topic '
                        '(--joint-states)')]
    needed = needed_joints(robot)
    complete = [each for each in received if set(needed) <= set(each.message.name)]
    if not complete:
        seen = sorted({name for each in received for name in each.message.name})
        missing = [name for name in needed if name not in seen]
        return [Finding('problem', f'joint states: {listed(missing)} missing among '
                        f'{listed(seen)}; expected '
                        + ('all joints' if needed == robot.joint_names else listed(needed)))]
    return [*_times(complete), *_numbers(robot, complete[-1].message, efforts)]


def needed_joints(robot: Robot) -> tuple[str, ...]:
    """Return the joints that every joint state needs: all, or with closed loops some."""
    return tuple(robot.joint_names[k] for k in joints_that_follow(robot))


def _times(received: list[ReceivedState]) -> list[Finding]:
    """Return the findings of rate and stamps."""
    # From first to last, because states were also received during discovery.
    rate = (len(received) - 1) * NANO / max(received[-1].steady - received[0].steady, 1)
    found = [Finding('fine' if rate > SLOW else 'warning',
                     f'{rate:.3g} joint states/s with all joints')]
    stamped = [(each.now, stamp) for each in received
               if (stamp := nanoseconds(each.message.header.stamp))]
    if not stamped:
        return [*found, Finding('warning', 'stamps of joint states: zero; expected stamps, '
                                'without which state_timeout cannot detect delays')]
    ages = [(now - stamp) / NANO for now, stamp in stamped if now]
    if not ages:
        return [*found, Finding('problem', '/clock: a publisher but no message; expected time, '
                                'which nodes with use_sim_time wait for')]
    age = float(np.median(ages))
    if abs(age) > STALE:
        found.append(Finding('problem', f'stamps of joint states: {age:.3g} s old on arrival; '
                             'expected the same clock and the same use_sim_time'))
    return found


def _numbers(robot: Robot, message: JointState, efforts: Efforts | None) -> list[Finding]:
    """Return the findings of the values of one joint state."""
    names = tuple(name for name in robot.joint_names if name in message.name)
    index = [list(message.name).index(name) for name in names]
    q, u, effort = (np.array(values, dtype=np.float64)[index]
                    if len(values) == len(message.name) else None
                    for values in (message.position, message.velocity, message.effort))
    if q is None or u is None:
        return [Finding('problem', f'joint states: no {"position" if q is None else "velocity"}; '
                        'expected positions and velocities')]
    found = [Finding('problem', f'{what} of {listed(bad)}: not finite; expected finite numbers, '
                     'as the dynamics node drops other states')
             for what, values in (('positions', q), ('velocities', u))
             if (bad := _not_finite(names, values))]
    places = [robot.joint_names.index(name) for name in names]
    with np.errstate(invalid='ignore'):
        beyond = [name for name, outside in zip(
            names, (q < robot.limits.lower[places]) | (q > robot.limits.upper[places])) if outside]
    if beyond:
        found.append(Finding('problem', f'positions of {listed(beyond)}: outside the limits of '
                             'the URDF; expected the URDF of this arm, in rad'))
    if robot.constraint_names:
        return found + _loops(robot, names, q)
    return found + _efforts(robot, q, u, effort, efforts)


def _loops(robot: Robot, names: tuple[str, ...], q: Array) -> list[Finding]:
    """Return the findings of the closed loops, from the measured joints."""
    tracker = LoopTracker(robot, needed_joints(robot))
    places = [robot.joint_names.index(name) for name in names]
    further = [k for k in places if k not in tracker.places]
    whole = np.zeros(robot.n_q)
    whole[places] = q
    try:
        tracker.update(whole[tracker.places], np.zeros(robot.n), further, whole[further])
    except LoopError as error:
        return [Finding('problem', str(error))]
    return [Finding('fine', f'closed loops: residual {tracker.residual:.1e}, conditioning '
                    f'{tracker.figure:.3g}, measured joints within {tracker.deviation:.2g}')]


def _efforts(robot: Robot, q: Array, u: Array, effort: Array | None,
             efforts: Efforts | None) -> list[Finding]:
    """Return the findings of the efforts of one joint state."""
    if effort is None:
        return [Finding('warning', 'efforts of joint states: none; the momentum observer then '
                        'uses the command')]
    if names := _not_finite(robot.joint_names, effort):
        return [Finding('warning', f'efforts of {listed(names)}: not finite; the momentum '
                        'observer then uses the command')]
    if not np.isfinite([q, u]).all() or (
            np.abs(u).max(initial=0.0) >= AT_REST):
        return []
    if effort.any() and efforts is not None:
        words = efforts.contradiction(robot, q, effort)
        return [Finding('problem', words)] if words else [
            Finding('fine', f'efforts at rest fit {efforts}')]
    if effort.any():
        return examine_efforts(robot, q, effort)
    if np.abs(robot.gravity_force(q)).max(initial=0.0) < WEIGHTLESS:
        return []
    return [Finding('warning', 'efforts at rest: all zero, with brakes or without measurement; '
                    'expected observer.torque: command if the driver does not measure '
                    'efforts, because auto uses them')]


def _not_finite(names: tuple[str, ...], values: Array) -> list[str]:
    """Return the joints whose values are not finite."""
    return [name for name, good in zip(names, np.isfinite(values)) if not good]


def _names(ends: list[TopicEndpointInfo]) -> str:
    """Return the names of the nodes of these endpoints, as text."""
    return listed('an unnamed node' if end.node_name == NAMELESS else end.node_name
                  for end in ends)


def _lines(node: Node, commands: str, joint_states: str) -> list[list[TopicEndpointInfo]]:
    """Return the endpoints of the topics of the torque path."""
    return [node.get_publishers_info_by_topic(joint_states),
            node.get_publishers_info_by_topic(commands),
            node.get_subscriptions_info_by_topic(commands)]


def _named(lines: list[list[TopicEndpointInfo]]) -> bool:
    """Return whether the nodes of all endpoints are known by name."""
    return all(end.node_name != NAMELESS for line in lines for end in line)


def _discovered(node: Node, commands: str, joint_states: str) -> bool:
    """Return whether all topics of the torque path have endpoints with known node names."""
    lines = _lines(node, commands, joint_states)
    return all(lines) and _named(lines)


def _endpoint_findings(node: Node, commands: str, joint_states: str,
                       foreign: int) -> list[Finding]:
    """Return the findings of the publishers and subscribers of the torque path."""
    found = []
    states = node.get_publishers_info_by_topic(joint_states)
    if len(states) - foreign > 1:
        others = f', {foreign} of other joints' if foreign else ''
        found.append(Finding('problem', f'{joint_states}: {len(states)} publishers'
                             f'{others}: {_names(states)}; expected one'))
    given = node.get_publishers_info_by_topic(commands)
    taken = node.get_subscriptions_info_by_topic(commands)
    if len(sources := commanders(node, commands)) > 1:
        found.append(Finding('problem', f'{commands}: {several_commanders(sources)}'))
    elif not given:
        found.append(Finding('warning', f'{commands}: no publisher; expected the dynamics '
                             'node, with this topic of commands (--commands)'))
    if not taken:
        found.append(Finding('warning', f'{commands}: no subscriber; expected an effort '
                             'controller, with this topic of commands'))
    if given and taken:
        unreliable = given[0].qos_profile.reliability != ReliabilityPolicy.RELIABLE
        incompatible = [
            end for end in taken
            if end.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
            or (unreliable and end.qos_profile.reliability == ReliabilityPolicy.RELIABLE)]
        found.append(Finding('problem', f'QoS of {commands}: incompatible with '
                             f'{_names(incompatible)}; expected a reliable publisher and a '
                             'volatile subscriber') if incompatible else
                     Finding('fine', f'{commands}: from {_names(given)} to '
                             f'{_names(taken)}'))
    volatile = [end for end in node.get_publishers_info_by_topic('robot_description')
                if end.qos_profile.durability != DurabilityPolicy.TRANSIENT_LOCAL]
    if volatile:
        found.append(Finding('problem', f'robot_description of {_names(volatile)}: volatile; '
                             'expected transient local durability, for nodes that start later'))
    return found
