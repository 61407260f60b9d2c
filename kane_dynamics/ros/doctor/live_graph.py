"""The checks of `kane-dynamics doctor` for a live ROS graph."""

from collections.abc import Callable, Mapping, Sequence
from itertools import chain
import time
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from kane_dynamics.analysis.model_checks import (examine_efforts, Finding, Level,
                                                 listed)
from kane_dynamics.control.computed_torque import joints_that_follow
from kane_dynamics.identification.efforts import (actuated_joints, Efforts,
                                                  generalized_force)
from kane_dynamics.loop_tracking.driven_mechanism import driving_tracker
from kane_dynamics.loop_tracking.loop_error import LoopError
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.command_topic import (commanders, full_name,
                                                    several_commanders)
from kane_dynamics.ros.common.conversion import Array, NANO, nanoseconds
from kane_dynamics.ros.common.qos import EXAMINED_STATES
import numpy as np
from rcl_interfaces.srv import GetParameters
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
# Fast DDS sends missed discovery data with heartbeats, every 3 s: first the endpoints,
# then, with the next heartbeat, the names of their nodes.
DISCOVERY = 7.0  # s
ANSWER = 1.0  # s for the parameters of a controller
DIAGNOSTICS = 1.5  # s for a report of the nodes
WEIGHTLESS = 1e-3  # N m or N: below this gravity torque, zero efforts are plausible
NAMELESS = '_NODE_NAME_UNKNOWN_'


class ReceivedState(NamedTuple):
    """A joint state and its reception on the steady and the node's clock, ns."""

    steady: int
    now: int
    message: JointState


def examine_graph(robot: Robot, seconds: float, namespace: str = '',
                  commands: str = 'commands', joint_states: str = 'joint_states',
                  efforts: Efforts | None = None,
                  locked: Mapping[str, float] | None = None) -> list[Finding]:
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
    locked : mapping of str to float, optional
        Joints that the robot has at 0, and how far from it they may be, rad or m.

    """
    # A node of its own, which leaves the graph when the examination ends.
    context = Context()
    rclpy.init(context=context)
    try:
        node = Node('kane_dynamics_doctor', namespace=namespace, context=context)
        examination = GraphExamination(robot, node, commands, joint_states)
        findings = examination.run(context, seconds, efforts)
        findings += examination.locked_elsewhere(locked or {})
        node.destroy_node()
        return findings
    finally:
        rclpy.try_shutdown(context=context)


class GraphExamination:
    """
    Listens to joint states, and lists the nodes at the ends of the topics.

    Parameters
    ----------
    robot : Robot
    node : Node
        A node of its own context.
    commands, joint_states : str
        Names of the topics.

    """

    def __init__(self, robot: Robot, node: Node, commands: str,
                 joint_states: str) -> None:
        self._robot = robot
        self._node = node
        self._commands = commands
        self._joint_states = joint_states
        self._received: list[ReceivedState] = []
        self._statuses: dict[str, DiagnosticStatus] = {}  # the latest, by name
        node.create_subscription(JointState, joint_states, self._on_state,
                                 EXAMINED_STATES)
        node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics,
                                 10)

    def _on_state(self, message: JointState) -> None:
        now = self._node.get_clock().now().nanoseconds
        self._received.append(ReceivedState(time.monotonic_ns(), now, message))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self._statuses[status.name] = status

    def run(self, context: Context, seconds: float,
            efforts: Efforts | None) -> list[Finding]:
        """Listen for some time, s, and return the findings."""
        node = self._node
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        _spin(executor, DISCOVERY, self._discovered)
        foreign: set[tuple[str, ...]] = set()
        # With a publisher of /clock, ages are those of simulated time: listen again.
        if _spin(executor, seconds, lambda: node.count_publishers('/clock') > 0):
            node.set_parameters([Parameter('use_sim_time', value=True)])
            _spin(executor, DISCOVERY, lambda: node.get_clock().now().nanoseconds > 0)
            foreign = self._foreign_names()
            self._received.clear()
            _spin(executor, seconds, lambda: False)
        # Nodes that were discovered only during that time have not been heard yet.
        if not self._all_named():
            _spin(executor, DISCOVERY, self._all_named)
            _spin(executor, seconds, lambda: False)
        order = self._controller_order(executor)
        # A node reports once a second.
        _spin(executor, DIAGNOSTICS, lambda: bool(self._statuses))
        executor.remove_node(node)
        foreign |= self._foreign_names()
        return [*examine_states(self._robot, self._received, seconds, efforts),
                *order, *self._diagnostics(),
                *self._state_publishers(len(foreign)), *self._command_ends(),
                *self._descriptions()]

    def locked_elsewhere(self, locked: Mapping[str, float]) -> list[Finding]:
        """Return a problem for joints that are far from 0, where the robot has them."""
        elsewhere = {}
        for state in self._received:
            for name, q in zip(state.message.name, state.message.position, strict=False):
                if abs(q) > locked.get(name, np.inf):
                    elsewhere[name] = f'{name} {q:.3g}'
        if not elsewhere:
            return []
        return [Finding('problem', 'joints that are locked at 0 are elsewhere: '
                        f'{listed(list(elsewhere.values()))}; expected them there, or among '
                        'the joints that move')]

    def _foreign_names(self) -> set[tuple[str, ...]]:
        """Return the name lists of joint states without any joint of the robot."""
        foreign = set()
        for state in self._received:
            names = tuple(state.message.name)
            if not set(names) & set(self._robot.joint_names):
                foreign.add(names)
        return foreign

    def _topic_ends(self) -> list[list[TopicEndpointInfo]]:
        """Return the endpoints of the topics of the torque path."""
        return [self._node.get_publishers_info_by_topic(self._joint_states),
                self._node.get_publishers_info_by_topic(self._commands),
                self._node.get_subscriptions_info_by_topic(self._commands)]

    def _all_named(self) -> bool:
        """Return whether the nodes of all endpoints are known by name."""
        every_end = chain.from_iterable(self._topic_ends())
        return all(end.node_name != NAMELESS for end in every_end)

    def _discovered(self) -> bool:
        """Return whether all topics of the torque path have ends of known nodes."""
        return all(self._topic_ends()) and self._all_named()

    def _state_publishers(self, foreign: int) -> list[Finding]:
        """Return a problem if more than one node publishes the joint states."""
        publishers, _, _ = self._topic_ends()
        if len(publishers) - foreign <= 1:
            return []
        of_others = f', {foreign} of other joints' if foreign else ''
        return [Finding('problem', f'{self._joint_states}: {len(publishers)} publishers'
                        f'{of_others}: {_names(publishers)}; expected one')]

    def _command_ends(self) -> list[Finding]:
        """Return the findings of the publishers and subscribers of commands."""
        # One publisher, one subscriber, and settings of both that fit.
        topic = self._commands
        _, publishers, subscribers = self._topic_ends()
        findings = []
        nodes = commanders(self._node, topic)
        if len(nodes) > 1:
            findings.append(Finding('problem', f'{topic}: {several_commanders(nodes)}'))
        elif not publishers:
            findings.append(Finding('warning', f'{topic}: no publisher; expected the '
                                    'dynamics node, with this topic of commands '
                                    '(--commands)'))
        if not subscribers:
            findings.append(Finding('warning', f'{topic}: no subscriber; expected an '
                                    'effort controller, with this topic of commands'))
        # Settings are compared only where there are two ends.
        if not publishers or not subscribers:
            return findings
        incompatible = _incompatible(publishers[0], subscribers)
        if incompatible:
            findings.append(Finding('problem', f'QoS of {topic}: incompatible with '
                                    f'{_names(incompatible)}; expected a reliable '
                                    'publisher and a volatile subscriber'))
        else:
            findings.append(Finding('fine', f'{topic}: from {_names(publishers)} to '
                                    f'{_names(subscribers)}'))
        return findings

    def _diagnostics(self) -> list[Finding]:
        """Return the diagnostics of the nodes that publish the commands."""
        _, publishers, _ = self._topic_ends()
        names = {full_name(end.node_name, end.node_namespace) for end in publishers}
        findings = []
        for status in self._statuses.values():
            node, _, _ = status.name.partition(':')
            if node not in names or status.level == DiagnosticStatus.OK:
                continue
            level: Level = 'problem'
            if status.level == DiagnosticStatus.WARN:
                level = 'warning'
            findings.append(Finding(level, f'/diagnostics of {status.name}: '
                                           f'{status.message}'))
        return findings

    def _controller_order(self, executor: SingleThreadedExecutor) -> list[Finding]:
        """Return a problem if the controller has other joints, or another order of them."""
        _, _, subscribers = self._topic_ends()
        ours = list(self._robot.actuated_names)
        findings = []
        for end in subscribers:
            name = full_name(end.node_name, end.node_namespace)
            joints = self._joints_of(name, executor)
            if joints and joints != ours:
                findings.append(Finding(
                    'problem', f"parameter 'joints' of {name}: {', '.join(joints)}; "
                    f'expected {", ".join(ours)}, the order of {self._commands}'))
        return findings

    def _joints_of(self, name: str, executor: SingleThreadedExecutor) -> list[str]:
        """Return parameter `joints` of a controller; empty if it has none or is silent."""
        client = self._node.create_client(GetParameters, f'{name}/get_parameters')
        try:
            if not _spin(executor, ANSWER, client.service_is_ready):
                return []
            future = client.call_async(GetParameters.Request(names=['joints']))
            if not _spin(executor, ANSWER, future.done):
                return []
            values = future.result().values  # none, if `joints` is not declared
            return list(values[0].string_array_value) if values else []
        finally:
            self._node.destroy_client(client)

    def _descriptions(self) -> list[Finding]:
        """Return the findings of the publishers of the URDF."""
        volatile = [end for end in
                    self._node.get_publishers_info_by_topic('robot_description')
                    if end.qos_profile.durability != DurabilityPolicy.TRANSIENT_LOCAL]
        if not volatile:
            return []
        return [Finding('problem', f'robot_description of {_names(volatile)}: volatile; '
                        'expected transient local durability, for nodes that start '
                        'later')]


def _spin(executor: SingleThreadedExecutor, seconds: float,
          enough: Callable[[], bool]) -> bool:
    """Spin for some time or until `enough` returns True; return its result."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if enough():
            return True
        executor.spin_once(timeout_sec=0.05)
    return enough()


def _incompatible(publisher: TopicEndpointInfo,
                  subscribers: list[TopicEndpointInfo]) -> list[TopicEndpointInfo]:
    """Return the subscribers whose QoS does not match that of a volatile publisher."""
    # A subscriber that asks for more than the publisher offers gets nothing.
    unreliable = publisher.qos_profile.reliability != ReliabilityPolicy.RELIABLE
    incompatible = []
    for end in subscribers:
        qos = end.qos_profile
        needs_reliable = qos.reliability == ReliabilityPolicy.RELIABLE
        if qos.durability == DurabilityPolicy.TRANSIENT_LOCAL or (
                unreliable and needs_reliable):
            incompatible.append(end)
    return incompatible


def examine_states(robot: Robot, received: list[ReceivedState], seconds: float,
                   efforts: Efforts | None = None) -> list[Finding]:
    """Return the findings of the joint states received within some time."""
    if not received:
        return [Finding('problem',
                        f'joint states: none within {seconds:g} s; expected a '
                        'driver with the same ROS_DOMAIN_ID, namespace and topic '
                        '(--joint-states)')]
    # States are judged by those with all joints that are needed.
    needed = needed_joints(robot)
    complete = []
    published: set[str] = set()
    for state in received:
        published.update(state.message.name)
        if set(needed) <= set(state.message.name):
            complete.append(state)
    if not complete:
        missing = [name for name in needed if name not in published]
        expected = 'all joints' if needed == robot.joint_names else listed(needed)
        return [Finding('problem', f'joint states: {listed(missing)} missing among '
                        f'{listed(sorted(published))}; expected {expected}')]
    return [*_times(complete), *_numbers(robot, complete[-1].message, efforts)]


def needed_joints(robot: Robot) -> tuple[str, ...]:
    """Return the joints that every joint state needs: all, or with closed loops some."""
    return tuple(robot.joint_names[k] for k in joints_that_follow(robot))


def _times(received: list[ReceivedState]) -> list[Finding]:
    """Return the findings of rate and stamps."""
    # From first to last, because states were also received during discovery.
    span = max(received[-1].steady - received[0].steady, 1)
    rate = (len(received) - 1) * NANO / span
    words = f'{rate:.3g} joint states/s with all joints'
    findings = [Finding('fine' if rate > SLOW else 'warning', words)]
    stamped = [state for state in received if nanoseconds(state.message.header.stamp)]
    if not stamped:
        return [*findings, Finding('warning', 'stamps of joint states: zero; expected '
                                   'stamps, without which state_timeout cannot detect '
                                   'delays')]
    # Without a message on /clock, the time of reception is zero.
    timed = [state for state in stamped if state.now]
    if not timed:
        return [*findings, Finding('problem', '/clock: a publisher but no message; '
                                   'expected time, which nodes with use_sim_time wait '
                                   'for')]
    ages = [state.now - nanoseconds(state.message.header.stamp) for state in timed]
    age = float(np.median(ages)) / NANO
    if abs(age) > STALE:
        findings.append(Finding('problem', f'stamps of joint states: {age:.3g} s old on '
                                'arrival; expected the same clock and the same '
                                'use_sim_time'))
    return findings


def _numbers(robot: Robot, message: JointState,
             efforts: Efforts | None) -> list[Finding]:
    """Return the findings of the values of one joint state."""
    names = tuple(name for name in robot.joint_names if name in message.name)
    q = _column(message, message.position, names)
    u = _column(message, message.velocity, names)
    if q is None or u is None:
        missing = 'position' if q is None else 'velocity'
        return [Finding('problem', f'joint states: no {missing}; expected positions and '
                        'velocities')]
    findings = []
    # Joint states that the node would drop.
    absent = np.isnan(u)
    if absent.any():
        findings.append(Finding('warning', f'velocities of {listed(_not_finite(names, u))}: '
                                'not finite; the dynamics node then uses speeds from '
                                'positions'))
    for quantity, values in (('positions', q), ('velocities', np.where(absent, 0.0, u))):
        bad = _not_finite(names, values)
        if bad:
            findings.append(Finding('problem',
                                    f'{quantity} of {listed(bad)}: not finite; '
                                    'expected finite numbers, as the dynamics node '
                                    'drops other states'))
    # Positions of a URDF in other units, or of another arm, are outside its limits.
    places = list(map(robot.joint_names.index, names))
    with np.errstate(invalid='ignore'):
        outside = (q < robot.limits.lower[places]) | (q > robot.limits.upper[places])
    if outside.any():
        beyond = np.array(names)[outside].tolist()
        findings.append(Finding('problem', f'positions of {listed(beyond)}: outside the '
                                'limits of the URDF; expected the URDF of this arm, in '
                                'rad'))
    of_loops, configuration = _closed(robot, names, q)
    findings += of_loops
    # Efforts are compared with the weight at the configuration of all joints.
    actuated = actuated_joints(robot)
    if configuration is None or not set(actuated) <= set(names):
        return findings
    rates = _column(message, message.velocity, actuated)
    assert rates is not None  # as for all names
    effort = _column(message, message.effort, actuated)
    return findings + _efforts(robot, configuration, rates, effort, efforts)


def _column(message: JointState, values: Sequence[float],
            names: Sequence[str]) -> Array | None:
    """Return one field of a message for some joints; None if it is missing."""
    if len(values) != len(message.name):
        return None
    index = list(map(list(message.name).index, names))
    return np.array(values, dtype=np.float64)[index]


def _closed(robot: Robot, names: tuple[str, ...],
            q: Array) -> tuple[list[Finding], Array | None]:
    """Return the findings of closed loops, if any, and all positions; None if they are open."""
    # As the node does at each state: loops from the measured joints, compared with the
    # others.
    tracker = driving_tracker(robot, needed_joints(robot))
    if tracker is None:
        return [], q
    places = list(map(robot.joint_names.index, names))
    further = [k for k in places if k not in tracker.places]
    whole = np.zeros(robot.n_q)
    whole[places] = q
    try:
        tracker.update(whole[tracker.places], np.zeros(robot.n), further, whole[further])
    except LoopError as error:
        return [Finding('problem', str(error))], None
    closed = Finding('fine',
                     f'closed loops: residual {tracker.residual:.1e}, conditioning '
                     f'{tracker.figure:.3g}, measured joints within '
                     f'{tracker.deviation:.2g}')
    return [closed], tracker.q


def _efforts(robot: Robot, q: Array, u: Array, effort: Array | None,
             efforts: Efforts | None) -> list[Finding]:
    """Return the findings of the efforts of the actuators, with their rates."""
    # Missing efforts are no fault: they are needed at rest only, where they show the
    # model.
    if effort is None:
        return [Finding('warning',
                        'efforts of joint states: none; the momentum observer then '
                        'uses the command')]
    if names := _not_finite(actuated_joints(robot), effort):
        return [Finding('warning',
                        f'efforts of {listed(names)}: not finite; the momentum '
                        'observer then uses the command')]
    finite = np.isfinite(q).all() and np.isfinite(u).all()
    if not finite or np.abs(u).max(initial=0.0) >= AT_REST:
        return []
    # What efforts mean is stated, guessed from gravity, or cannot be seen.
    expects_zero = efforts is not None and not efforts.gravity
    if efforts is not None and (expects_zero or effort.any()):
        words = efforts.contradiction(robot, q, effort)
        return [Finding('problem', words)] if words else [
            Finding('fine', f'efforts at rest fit {efforts}')]
    if effort.any():
        return examine_efforts(robot, q, generalized_force(robot, effort, q))
    if np.abs(robot.gravity_force(q)).max(initial=0.0) < WEIGHTLESS:
        return []
    return [Finding('warning',
                    'efforts at rest: all zero, with brakes, without measurement, or of an '
                    'arm that reports them without gravity; expected observer.torque: '
                    'command if the driver does not measure efforts, because auto uses '
                    'them, or efforts.gravity: false if they lack gravity')]


def _not_finite(names: tuple[str, ...], values: Array) -> list[str]:
    """Return the joints whose values are not finite."""
    return [name for name, good in zip(names, np.isfinite(values)) if not good]


def _names(ends: list[TopicEndpointInfo]) -> str:
    """Return the names of the nodes of these endpoints, as text."""
    return listed('an unnamed node' if end.node_name == NAMELESS else end.node_name
                  for end in ends)
