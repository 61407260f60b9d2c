"""The robots, the torque path and the topics of a configured node."""

from collections.abc import Callable, Collection, Mapping
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
import time
from typing import Any

from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from kane_dynamics.control.controller import Controller, ModeLaw
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.control.terms import Mode
from kane_dynamics.errors import InputError, KaneError
from kane_dynamics.mechanics.friction import is_self_locking
from kane_dynamics.model.inertial import Inertial
from kane_dynamics.model.model import Model
from kane_dynamics.native.runtime.threads import run_concurrently
from kane_dynamics.robot.robot import Robot
from kane_dynamics.robot.verification import compile_verified
from kane_dynamics.ros.common.command_topic import CommanderCount
from kane_dynamics.ros.common.configuration_files import stated_contacts
from kane_dynamics.ros.common.lost_messages import LostMessages, with_info
from kane_dynamics.ros.common.node_statistics import Statistics
from kane_dynamics.ros.common.qos import (BEST_EFFORT, CLOCK, overridable, OVERRIDES,
                                          overrides_of, RELIABLE, SCENES,
                                          STATIC_TRANSFORMS, THREAD_STATES, TRANSFORMS,
                                          watched)
from kane_dynamics.ros.common.rcl_functions import (destroy_subscription_of_thread,
                                                    guard_condition,
                                                    subscription_of_thread,
                                                    UnsupportedError)
from kane_dynamics.ros.common.service_errors import reported
from kane_dynamics.ros.common.stamped_numbers import with_stamp
from kane_dynamics.ros.common.throttle import ThrottledWarning
from kane_dynamics.ros.common.transform_tree import tf_message_type, TransformTree
from kane_dynamics.ros.dynamics_node.guard_link import GuardLink, LoadsTopic
from kane_dynamics.ros.dynamics_node.live_limits import check_live_limits
from kane_dynamics.ros.guard.guard_messages import arm_digest, STATE
from kane_dynamics.ros.inputs.target_input import POSE, TargetInput, TWIST, WRENCH
from kane_dynamics.ros.loads.gravity_payload import (checked_payload, GravityAndPayload,
                                                     parameter_loads)
from kane_dynamics.ros.loads.wrench_input import WrenchFrames
from kane_dynamics.ros.modes.cartesian_mode import CartesianMode
from kane_dynamics.ros.modes.stability import instability
from kane_dynamics.ros.modes.task_modes import GROUPS, TaskModes
from kane_dynamics.ros.monitors.attached_objects import (AttachedObjects, scene_types,
                                                         SceneRequest)
from kane_dynamics.ros.monitors.drift_watch import DriftWatch
from kane_dynamics.ros.monitors.imu_gravity import GravityFromImu
from kane_dynamics.ros.monitors.optional_topics import (check_optional_topics,
                                                        OptionalTopics,
                                                        stamped_command_type)
from kane_dynamics.ros.monitors.task_state_topic import TaskStateTopic
from kane_dynamics.ros.parameters.live_parameters import Owner, owners_of
from kane_dynamics.ros.parameters.parameter_checks import integrator_of_simulations
from kane_dynamics.ros.parameters.task_settings import controlled_frame
from kane_dynamics.ros.services.request_kernels import (ANSWERS, compile_answers,
                                                        compile_simulations,
                                                        LaterKernels, shared_copy,
                                                        SIMULATIONS)
from kane_dynamics.ros.services.served_robot import ServedRobot
from kane_dynamics.ros.services.services import Services
from kane_dynamics.ros.services.trajectory_filling import FillSettings
from kane_dynamics.ros.torque_path.closed_loop_reader import (closed_loop_reader,
                                                              ClosedLoopReader,
                                                              command_fault,
                                                              commanded_joints)
from kane_dynamics.ros.torque_path.executors import ThreadExecutor
from kane_dynamics.ros.torque_path.native_loop import compile_loop
from kane_dynamics.ros.torque_path.path_controller import path_controller, path_settings
from kane_dynamics.ros.torque_path.state_check import speed_limits
from kane_dynamics.ros.torque_path.torque_path import python_reason, TorquePath
from kane_dynamics.simulation.contact import checked_contacts
from kane_dynamics.simulation.step_size import possible_integrators
from kane_dynamics_interfaces.msg import TaskState
import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNode
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float64MultiArray

PAYLOAD = ('payload.mass', 'payload.com', 'payload.inertia')
# Parameters by which feedback may become unstable
FEEDBACK = ('mode', 'gains.', 'joint_impedance.', 'cartesian.', 'walls.',
            'hand_guiding.')
# Between two joint states, s, with which gains have to be stable while none is known.
UNKNOWN_PERIOD = 0.01
MORE_SELDOM = 1.1  # periods of states at which stability is judged again
ACKNOWLEDGE_TIMEOUT = 0.3  # s
STAMPED = 4  # place of the publisher of stamped commands in the arguments of a path
REPORT_PERIOD = 0.005  # s, between two looks at the reports of the native torque path


class ConfiguredRobot:
    """
    The resources of a configured node, from configure to cleanup.

    The torque path, requests and the worker of simulations have one robot each. Gravity
    and payload are passed to each as one record, which it applies between two cycles or
    requests. Commanded torques, filled trajectories, inverse dynamics and
    the torques of the monitors include the quasi-static deflection of flexible links
    (`QuasiStatic`); all other results treat these links as rigid.

    Parameters
    ----------
    node : LifecycleNode
        Owner of the topics.
    server : Services
    model : Model
    values : mapping
        The node's parameters.
    statistics : Statistics
    warn : ThrottledWarning
        Logs the reason and the details of each dropped message, and lasting faults as
        errors.

    Attributes
    ----------
    fault : str
        Why this arm cannot be commanded; empty if it can.
    later_kernels : LaterKernels
        Those of simulations and path timing, once they are started.
    torque_path : str
        What computes the commands: native, or python with the reason.
    drift : DriftWatch or None
        Of an arm that can be commanded.
    owners : list of Owner
        The parts that read live parameters.
    left_mode : str
        Why the node ended the feedback of a mode; empty once a mode is set or the path
        starts.

    Raises
    ------
    KaneError
        The robot cannot be compiled or verified, or a parameter does not fit it. No
        topic is open then.

    """

    def __init__(self, node: LifecycleNode, server: Services, model: Model,
                 values: Mapping[str, Any], statistics: Statistics,
                 warn: ThrottledWarning) -> None:
        self.values = values
        # The controller's model has rigid links; of a flexible arm, `bending` is the
        # other.
        self._elastic = model if model.drives else None
        controller = path_controller(model, values, self._laws_of)
        self._digest = arm_digest(model, controller.robot.options['constraints'])
        self.robot = controller.robot
        bending = controller.bending
        model = self.robot.model
        self._node = node
        self._server = server
        self._warn = warn
        self.statistics = statistics
        self._clock = node.get_clock()
        self._simulated_time = bool(self._clock.ros_time_is_active)
        self.loads: GravityAndPayload = parameter_loads(model, values)
        self._stated_payload = self.loads.payload  # by parameter or ~/set_payload
        self._attached_payload = Inertial()  # of the objects of MoveIt
        self._payload_from_service = False  # whether ~/set_payload set the payload
        self.state_publishers = 1  # publishers of joint states of this arm
        self.all_state_publishers = 1  # with those of other joints only
        # Joints of states that have a part each
        self.parts_of_states: list[tuple[str, ...]] = []
        self.left_mode = ''
        # Period of the states, and steady time, when stability was judged last, s
        self._judged = 0.0, 0.0
        self._suspected = False  # whether feedback was unstable at the last look
        self.lost_states = LostMessages()
        self._commanders = CommanderCount(node, 'commands')
        self._foreign_joints: set[tuple[str, ...]] = set()
        self._answers = True  # whether the last state was answered, or refused
        self._transforms: TransformTree | None = None
        if values['tf.enabled']:
            self._transforms = TransformTree(
                model, self._now, values['tf.timeout'],
                lambda reason, detail: self._reject(f'tf: {reason}', detail))
        self.attached_objects: AttachedObjects | None = None
        self.gravity_source: GravityFromImu | None = None
        if values['imu.topic']:
            magnitude = float(np.linalg.norm(values['gravity']))
            self.gravity_source = GravityFromImu(
                model, magnitude, values['imu.time_constant'],
                lambda gravity: self._change(gravity=gravity), self._transforms)
        # Check the parameters before the long compilation.
        self._qos_is_overridden = self._examine_overrides()
        check_optional_topics(values, self.robot)
        FillSettings.from_values(values, self.robot.joint_names)
        locks = self._require_sticking(self.robot)
        self._contacts = stated_contacts('simulation.contacts', values)
        checked_contacts(self.robot, self._contacts)
        self.fault = command_fault(controller)
        loops = None
        if not self.fault:
            loops = closed_loop_reader(controller, values)
        # The compiled laws need no interpreter; it may run their loop nevertheless.
        self._untraced = self.fault or python_reason(values, controller, loops)
        self._needs_interpreter = self._reason_for_interpreter()
        if self._needs_interpreter and not self.fault:
            self._refuse_native(self._needs_interpreter)
        self._compile_first(controller)
        # Torque path, requests and worker have their own robots, whose kernels are shared.
        self._for_requests = shared_copy(self.robot)
        self._for_simulations = shared_copy(self.robot)
        self._bending_for_requests: QuasiStatic | None = None
        if bending is not None:
            self._bending_for_requests = QuasiStatic(shared_copy(bending.robot))
        self.later_kernels = LaterKernels(
            {ANSWERS: partial(self._answer_kernels, locks),
             SIMULATIONS: partial(self._simulation_kernels, locks)},
            node.get_logger().info, node.get_logger().error)
        self._request_frames = WrenchFrames(self._for_requests, self._transforms)
        with ExitStack() as opened:
            self._open(controller, loops, opened)
            self._opened = opened.pop_all()

    def _examine_overrides(self) -> bool:
        """Return whether qos_overrides change a topic; warn of those that do not."""
        node = self._node
        # Other topics have fixed profiles, on which the torque path depends.
        topics = [node.resolve_topic_name('joint_states') + '.subscription']
        if not self.values['guard.enabled']:
            topics.append(node.resolve_topic_name('commands') + '.publisher')
        initial = {name: parameter.value
                   for name, parameter in node._parameter_overrides.items()}
        overrides = overrides_of(initial, topics)
        for name in overrides.unused:
            node.get_logger().warning(
                f"parameter '{name}': not used; expected history, depth or reliability "
                f'of {", ".join(topics)}')
        return bool(overrides.used)

    def _laws_of(self, robot: Robot) -> Mapping[Mode, ModeLaw]:
        """Return the laws of the modes that fit the robot of the torque path."""
        self.modes = TaskModes(robot, self.values, self._elastic)
        return self.modes.laws

    def _compile_first(self, controller: Controller) -> None:
        """Compile what commands need first, on all processors, and verify it."""
        robots = [self.robot]
        if controller.bending is not None:
            robots.append(controller.bending.robot)
        # The rules of the loop are compiled with the path.
        jobs: list[Callable[[], object]] = [compile_loop]
        if self._untraced and not self.fault:
            jobs += [self.modes.compile, controller.compile]
        jobs += [partial(compile_verified, robot) for robot in robots]
        run_concurrently(jobs)
        self.verified = max(robot.verify() for robot in robots)

    def _answer_kernels(self, locks: bool) -> None:
        """Compile what other modes need, and requests that are answered at once."""
        if not self.fault:
            self.path.compile(other_modes=True)
        self.modes.compile_descriptions()
        robots = [self._for_requests]
        if self._bending_for_requests is not None:
            robots.append(self._bending_for_requests.robot)
        compile_answers(robots, locks)

    def _simulation_kernels(self, locks: bool) -> None:
        """Compile what simulations need, so that none compiles itself."""
        values = self.values
        integrators = possible_integrators(
            self.robot, integrator_of_simulations(values, 'simulation.integrator'))
        compile_simulations(self._for_simulations, integrators,
                            values['simulation.sticking'], values['simulation.stops'],
                            locks, self._contacts)

    def _require_sticking(self, robot: Robot) -> bool:
        """Return whether drives lock themselves; InputError if they cannot be simulated."""
        names = [body.joint.name for body in robot.model.bodies
                 if robot.friction and is_self_locking(body.joint)]
        if names and not self.values['simulation.sticking']:
            raise InputError("parameter 'simulation.sticking': false, with self-locking "
                             f'drives (load_friction_backdriven) of {", ".join(names)}; '
                             'expected true, because simulations with the smooth law of '
                             'friction do not determine their motion')
        return bool(names)

    def _open(self, controller: Controller, loops: ClosedLoopReader | None,
              opened: ExitStack) -> None:
        """Open the topics and register them with `opened`."""
        node = self._node
        values = self.values
        warn = self._warn

        def publisher(kind: Any, name: str, qos: QoSProfile, **options: Any) -> Any:
            result = node.create_lifecycle_publisher(kind, name, qos, **options)
            opened.callback(node.destroy_lifecycle_publisher, result)
            return result

        # The guard watches the liveliness of the commands.
        guarded = values['guard.enabled'] and not self.fault
        qos = overridable(RELIABLE)
        options: dict[str, Any] = {'qos_overriding_options': OVERRIDES}
        if guarded:
            qos = watched(values['guard.lease'])
            options = {}
        self._commands = publisher(Float64MultiArray, 'commands', qos, **options)
        torques = publisher(JointState, '~/joint_torques', qos if guarded else RELIABLE)
        stamped = None
        if values['stamped_commands']:
            stamped = publisher(stamped_command_type(values), 'stamped_commands', RELIABLE)

        # The path with its inputs; what it lacks is refused with a reason.
        self.path, self._states = self._open_path(controller, torques, opened, (
            self._now, values, self.statistics,
            lambda reason, detail: warn(f'joint states: {reason}', detail), stamped,
            loops, lambda reason, detail: warn.error(f'joint states: {reason}', detail)))
        self.optional_topics = OptionalTopics(node, self.path, values, self._now,
                                              self._reject, publisher, opened,
                                              self._transforms)
        self._targets: TargetInput | None = None
        self.drift: DriftWatch | None = None
        if not self.fault:
            self._open_task_topics(publisher, opened)
            self.drift = DriftWatch(
                node, self.path,
                [self.robot.joint_names[k]
                 for k in commanded_joints(self.robot, controller.followed)],
                self._now, lambda: self._commands.get_subscription_count() > 0,
                node.get_logger())
            opened.callback(self.drift.close)
        self._loads_topic = LoadsTopic(node, self._digest, opened)
        self.guard: GuardLink | None = None
        if guarded:
            self.guard = GuardLink(node, self.path, values['guard.lease'], opened,
                                   len(self.path.messages.joints))
            self.path.use_guard(self.guard)
        if not self.fault:  # an arm that is never commanded has no cycle
            self.path.compile()
        # Gravity of a mobile base comes from its IMU.
        self.path.set_loads(self.loads)
        self._distribute()
        if self.gravity_source is not None:
            imu = node.create_subscription(
                Imu, values['imu.topic'], reported(self._on_imu, node.get_logger()),
                BEST_EFFORT)
            opened.callback(node.destroy_subscription, imu)
        if self._transforms is not None:
            self._open_transforms(self._transforms, opened)
        if values['attached_objects.topic']:
            self._open_scene(values['attached_objects.topic'], opened)
        self.owners = self._owners_of_parameters()

    def _open_transforms(self, transforms: TransformTree, opened: ExitStack) -> None:
        """Subscribe to the transforms of tf2."""
        node = self._node
        try:
            kind = tf_message_type()
        except InputError as error:
            node.get_logger().warning(str(error))
            return
        for topic, static, qos in (('/tf', False, TRANSFORMS),
                                   ('/tf_static', True, STATIC_TRANSFORMS)):
            opened.callback(node.destroy_subscription, node.create_subscription(
                kind, topic, partial(reported(transforms.on_message, node.get_logger()),
                                     static=static), qos))

    def _open_scene(self, topic: str, opened: ExitStack) -> None:
        """Subscribe to the scene of MoveIt."""
        node = self._node
        try:
            scene, request = scene_types()
        except InputError as error:
            node.get_logger().warning(str(error))
            return
        objects = AttachedObjects(
            self.robot.model, self.values, self._check_attached, self._attach,
            lambda reason, detail: self._reject(f'MoveIt: {reason}', detail))
        self.attached_objects = objects
        # The scene reports later changes, the request the present state.
        topic = node.resolve_topic_name(topic)
        on_scene = reported(objects.on_scene, node.get_logger())
        opened.callback(node.destroy_subscription, node.create_subscription(
            scene, topic, on_scene, SCENES))
        # Objects may be attached already; the scene may begin later.
        opened.callback(SceneRequest(node, request, topic, on_scene).close)

    def _open_path(self, controller: Controller, torques: Publisher, opened: ExitStack,
                   arguments: tuple[Any, ...]) -> tuple[TorquePath, Any]:
        """Open the torque path and its subscription, as parameter torque_path says."""
        node = self._node
        # In a thread where possible; otherwise in callbacks, with the reason, unless the
        # thread is asked for.
        path = TorquePath(controller, self._commands, torques, *arguments)
        reason = self._needs_interpreter
        if not reason:
            try:
                states = self._open_thread(path, torques, opened, arguments[STAMPED])
                self.torque_path = 'native'
                return path, states
            except UnsupportedError as error:
                reason = str(error)
                self._refuse_native(reason)
        self.torque_path = f'python ({reason})'
        states = node.create_subscription(
            JointState, 'joint_states', with_info(self._on_state),
            overridable(BEST_EFFORT), raw=True, qos_overriding_options=OVERRIDES)
        opened.callback(node.destroy_subscription, states)
        return path, states

    def _refuse_native(self, reason: str) -> None:
        """Raise InputError if the native torque path is asked for, which is not possible."""
        if self.values['torque_path'] == 'native':
            raise InputError(f"parameter 'torque_path': native, with {reason}; expected auto "
                             'or python, because the interpreter has to compute the commands')

    def _reason_for_interpreter(self) -> str:
        """Return why the interpreter runs the loop; empty if it need not."""
        if self.values['torque_path'] == 'python':
            return 'torque_path: python'
        return self._untraced or 'qos_overrides' * self._qos_is_overridden

    def _open_thread(self, path: TorquePath, torques: Publisher, opened: ExitStack,
                     stamped: Publisher | None) -> Any:
        """
        Let a thread run the loop of a path; return the subscription of its states.

        UnsupportedError where rcl is another one.
        """
        node = self._node
        # The thread publishes through these.
        publishers = [self._commands, torques]
        if stamped is not None:
            publishers.append(stamped)
        # What is opened is closed again if a later part fails.
        with ExitStack() as entities:
            def subscribe(kind: Any, topic: str, qos: QoSProfile, needed: bool) -> Any:
                if not needed:
                    return None
                subscription = subscription_of_thread(node, kind, topic, qos)
                entities.callback(destroy_subscription_of_thread, node, subscription)
                return subscription
            states = subscribe(JointState, 'joint_states', THREAD_STATES, True)
            guard = subscribe(Float64MultiArray, f'~/{STATE}', RELIABLE,
                              self.values['guard.enabled'])
            clock = subscribe(ClockMessage, '/clock', CLOCK, self._simulated_time)
            wake = guard_condition(node.context)
            entities.callback(wake.destroy_when_not_in_use)
            path.executor = ThreadExecutor(path.native, node, states, guard, clock, wake,
                                           publishers)
            path.lost_states = self.lost_states
            entities.callback(path.close)
            # The interpreter reads reports of the thread at its own pace.
            timer = node.create_timer(REPORT_PERIOD, path.read_reports,
                                      clock=Clock(clock_type=ClockType.STEADY_TIME))
            entities.callback(node.destroy_timer, timer)
            opened.push(entities.pop_all())
        return states

    def _open_task_topics(self, publisher: Callable[..., Any],
                          opened: ExitStack) -> None:
        """Open the topics of the controlled frame."""
        node = self._node
        values = self.values
        controller = self.path.controller
        rate = values['task_state.rate']
        frame = controlled_frame(values, self.robot.model)
        if rate and controller.laws:
            # Observers of the path publish at their own rates, behind the torques.
            topic = TaskStateTopic(node,
                                   publisher(TaskState, '~/task_state', RELIABLE), rate,
                                   frame, controller, self.modes.laws)
            opened.callback(topic.close)
            self.path.add_observer(topic, need_effort=False)
        law = self.modes.laws.get(Mode.CARTESIAN_IMPEDANCE)
        if not isinstance(law, CartesianMode):
            return
        # Messages of targets reach the law as bytes, behind checks of their own.
        targets = TargetInput(self.path, law.target, frame, values, self._reject,
                              self._transforms)
        self._targets = targets
        for kind, name, callback in ((PoseStamped, POSE, targets.on_pose),
                                     (TwistStamped, TWIST, targets.on_twist),
                                     (WrenchStamped, WRENCH, targets.on_wrench)):
            opened.callback(node.destroy_subscription, node.create_subscription(
                kind, f'~/{name}', callback, BEST_EFFORT, raw=True))

    def _on_state(self, data: bytes, info: Mapping[str, Any]) -> None:
        received = self._now() if self._simulated_time else info['received_timestamp']
        self._answers = False
        # First: the command must not wait for the count.
        self.path.on_state(with_stamp(data, received))
        self._answers = True
        self.lost_states.note(info)

    def _now(self) -> int:
        """
        Return the node's clock, ns.

        Read the system clock directly unless time is simulated.
        """
        if self._simulated_time:
            return int(self._clock.now().nanoseconds)
        return time.time_ns()

    def on_clock_jump(self) -> None:
        """Handle a backward jump of the node's clock."""
        if self.path.running:
            self.path.on_clock_jump()

    @property
    def commanders(self) -> list[str]:
        """Return the names of the nodes that publish on `commands`, but the guard."""
        return self._commanders.names

    def count_publishers(self) -> None:
        """
        Update `commanders` and `state_publishers`.

        Publishers of other joints only do not count.
        """
        self._commanders.update()
        publishers = int(self._states.get_publisher_count())
        # A publisher of other joints may pause. Which one ended is unknown, so all are
        # forgotten.
        if publishers < self.all_state_publishers:
            self._foreign_joints = set()
        self.all_state_publishers = publishers
        self._foreign_joints |= self.path.take_foreign_joints()
        self.state_publishers = max(publishers - len(self._foreign_joints),
                                    min(publishers, 1))
        self.parts_of_states = self.path.take_parts()

    def halt(self) -> bool:
        """
        Command zeros.

        Return whether all subscribers acknowledge them within the timeout.
        """
        if not self.path.running:
            return True
        self.path.stop()
        timeout = Duration(seconds=ACKNOWLEDGE_TIMEOUT)
        return bool(self._commands.wait_for_all_acked(timeout))

    def hold_after(self, reason: str) -> bool:
        """
        Bring the arm to rest and hold it after a failure; return whether that is possible.

        A path that fails at a state is silent from then on, so that torque_guard takes
        over.
        """
        path = self.path
        if path.refused or not self._answers:
            path.ended = reason
            path.running = self.guard is None or bool(self.guard.warning)
            return not path.running
        if not path.failure:
            path.interrupt(path.now, reason)
        path.failure = reason
        return True

    def close(self) -> None:
        """Close the topics; services then answer that the node is not configured."""
        self._server.served = None
        self.later_kernels.close()
        self._opened.close()

    def check(self, values: Mapping[str, Any], changed: Collection[str]) -> None:
        """Raise InputError unless parameters, of which `changed` are set, fit."""
        for owner in owners_of(self.owners, changed):
            owner.check(values)
        check_live_limits(self.path, self.robot, self.values, values, changed)
        if any(name in changed for name in PAYLOAD):
            loads = parameter_loads(self.robot.model, values)
            self._require_carried(loads.payload, self._attached_payload)
        if self.gravity_source is not None and (
                values['gravity'] != self.values['gravity']).any():
            raise InputError("parameter 'gravity': new value; expected none while "
                             'imu.topic is set, which gives the direction')
        # The parameters that are not set do not describe the payload of the service.
        partly = 'payload.mass' not in changed and any(name in changed
                                                       for name in PAYLOAD)
        if self._payload_from_service and partly:
            raise InputError('parameters payload.*: payload set by ~/set_payload; '
                             "expected 'payload.mass' in the same request")
        self._refuse_unstable(values, changed)

    def instability_at_start(self) -> str:
        """Return why the mode is unstable at the rate of the states; empty if unknown."""
        if self.fault:
            return ''
        q, period = self.path.idle_states()
        controller = self.path.controller
        computed = controller.mode is Mode.COMPUTED_TORQUE
        if computed and (q is None or not period):
            words = instability(controller, self.modes.laws, controller.mode, np.zeros(0),
                                UNKNOWN_PERIOD)
            return words and f'no joint states yet, so judged at an assumed rate: {words}'
        # The configuration of closed loops is known from the first cycle on.
        if q is None or not period or not (computed or self.path.loops is None):
            if controller.mode in self.modes.laws:
                self._warn('mode', f'{controller.mode}: its stability cannot be judged '
                           'before the first joint states; it is judged with them')
            return ''
        return instability(controller, self.modes.laws, controller.mode, q, period)

    def leave_unstable_mode(self) -> str:
        """
        Return why feedback that acts has to end now; empty if it need not.

        It is judged each second, and at once where states come more seldom. Two looks have
        to agree: the distance of two states alone may be that of a start or a pause.
        """
        path = self.path
        period = path.period
        q = path.measured()
        if self.fault or q is None or not period:
            return ''
        last_period, last_time = self._judged
        now = time.monotonic()
        if period < MORE_SELDOM * last_period and now - last_time < 1.0:
            return ''
        mode = path.controller.mode
        try:
            words = instability(path.controller, self.modes.laws, mode, q, period)
        except (KaneError, np.linalg.LinAlgError):  # at a singular configuration
            return ''
        if words and not self._suspected:
            self._suspected = True
            return ''
        self._judged = period, now
        self._suspected = False
        if words:
            self.left_mode = f'mode {mode} ended, gravity_compensation since then: {words}'
        return words and self.left_mode

    def _refuse_unstable(self, values: Mapping[str, Any], changed: Collection[str]) -> None:
        """Raise InputError for feedback that is unstable at the rate of the states."""
        if not any(name.startswith(FEEDBACK) for name in changed):
            return
        path = self.path
        period = path.period
        q = path.measured()
        if self.fault or q is None or not period:
            return
        law = self.modes.laws.get(Mode(values['mode']))
        settings = path_settings(values, self.robot)
        # The law is asked with the new settings, before any cycle uses them.
        with path.one_change():
            if law is not None:
                law.update(values)
            try:
                words = instability(path.controller, self.modes.laws,
                                    Mode(values['mode']), q, period,
                                    (settings['kp'], settings['kd']))
            finally:
                if law is not None:
                    law.update(self.values)
        if words:
            raise InputError(words)

    def update(self, values: Mapping[str, Any], changed: Collection[str]) -> None:
        """Use checked parameters, of which `changed` are set, from the next cycle on."""
        # In one change: no cycle has the old law without its motion, or half of the rest.
        with self.path.one_change():
            self._update(values, changed)

    def _update(self, values: Mapping[str, Any], changed: Collection[str]) -> None:
        """Use checked parameters, part by part."""
        previous = self.values
        self.values = values
        if 'mode' in changed and values['mode'] != str(Mode.GRAVITY_COMPENSATION):
            self.left_mode = ''
        self._loads_topic.new_parameters()
        if previous['mode'] != values['mode'] and self.path.active_motion.clear(
                'the mode changed'):
            self._warn('mode', 'changed; desired motion dropped')
        for owner in owners_of(self.owners, changed):
            owner.use(values)
        # Only loads whose parameters changed, since services set them too.
        changes: dict[str, Any] = {}
        if not np.array_equal(previous['gravity'], values['gravity']):
            changes['gravity'] = values['gravity']
        if any(name in changed for name in PAYLOAD):
            self._stated_payload = parameter_loads(self.robot.model, values).payload
            changes['payload'] = self._whole_payload()
            self._payload_from_service = False
        self._change(**changes)

    def _owners_of_parameters(self) -> list[Owner]:
        """Return the parts that read live parameters, in the order in which they change."""
        robot, path, modes = self.robot, self.path, self.modes
        owners = []
        # Closed loops and laws, then the controller, limits and loads.
        if path.loops is not None:
            owners.append(Owner({'closure'}, bool, path.loops.update))
        owners.append(Owner({'mode'}, modes.check_mode))
        for mode, law in modes.laws.items():
            owners.append(Owner(GROUPS[mode], law.check, partial(self._update_law, mode)))
        owners += [
            Owner({'mode', 'gains', 'limits', 'blend_time'},
                  lambda values: path_settings(values, robot),
                  lambda values: path.controller.update(**path_settings(values, robot))),
            Owner({'mode', 'limits', 'state_timeout', 'state_check'},
                  lambda values: speed_limits(robot, values), path.set_limits),
            Owner({'feedforward', 'limits'},
                  lambda values: FillSettings.from_values(values, robot.joint_names)),
            Owner({'mode', 'limits', 'wrench', 'observer', 'efforts', 'state_timeout',
                   'payload', 'attached_objects'},
                  lambda values: check_optional_topics(values, robot),
                  self.optional_topics.update),
            Owner({'gravity', 'payload'},
                  lambda values: parameter_loads(robot.model, values))]
        if self._targets is not None:
            owners.append(Owner({'target', 'cartesian'}, bool, self._targets.update))
        if self.attached_objects is not None:
            owners.append(Owner({'attached_objects', 'payload'}, bool,
                                self.attached_objects.update))
        return owners

    def _update_law(self, mode: Mode, values: Mapping[str, Any]) -> None:
        """Use checked parameters in a law; blend the torques if it is that of the mode."""
        if self.modes.laws[mode].update(values) and mode == values['mode']:
            self.path.blend()

    def set_payload(self, request: Any) -> None:
        """
        Use the payload of a SetPayload request from the next state on.

        Raises
        ------
        InputError
            A field is invalid, or the node has no payload frame.

        """
        inertia = request.payload
        com = inertia.com
        payload = checked_payload(
            self.robot.model, self.values, request.frame, inertia.m,
            (com.x, com.y, com.z),
            (inertia.ixx, inertia.ixy, inertia.ixz, inertia.iyy, inertia.iyz,
             inertia.izz))
        # Objects that a planning scene attaches are carried in addition.
        self._require_carried(payload, self._attached_payload)
        self._payload_from_service = True
        self._stated_payload = payload
        self._change(payload=self._whole_payload())

    def _check_attached(self, objects: Inertial) -> None:
        """Raise InputError if the arm may not carry attached objects beside its payload."""
        self._require_carried(self._stated_payload, objects)

    def _attach(self, objects: Inertial) -> None:
        """Use the payload of attached objects from the next state on."""
        self._attached_payload = objects
        self._change(payload=self._whole_payload())
        self._node.get_logger().info(f'attached objects: {objects.mass:.4g} kg')

    def _whole_payload(self) -> Inertial | None:
        """Return the payload that was stated, and that of attached objects."""
        attached = self._attached_payload
        if not attached.mass:
            return self._stated_payload
        return attached if self._stated_payload is None else self._stated_payload + attached

    def _require_carried(self, stated: Inertial | None, attached: Inertial) -> None:
        """Raise InputError if two payloads together exceed payload.max_mass."""
        if stated is None or not attached.mass:
            return  # each alone has been checked
        mass = stated.mass + attached.mass
        limit = self.values['payload.max_mass']
        if mass > limit:
            raise InputError(f'payload: {mass:g} kg with attached objects; expected at most '
                             f'{limit:g} kg (parameter payload.max_mass)')

    def _on_imu(self, message: Imu) -> None:
        assert self.gravity_source is not None
        try:
            self.gravity_source.update(message, self._now())
        except InputError as error:
            self._reject('imu', str(error))

    def _reject(self, reason: str, detail: str) -> None:
        """Count a rejected message and warn."""
        self.statistics.rejected[reason] += 1
        self._warn(reason, detail)

    def _change(self, **changes: Any) -> None:
        """Replace some of the loads and pass loads and parameters on."""
        with self.path.one_change():
            if changes:
                self.loads = replace(self.loads, **changes)
                self.path.set_loads(self.loads)
            self._distribute()

    def _distribute(self) -> None:
        """Pass loads and parameters to the services and other nodes."""
        self._loads_topic.publish(self.loads)
        self._server.max_waiting = self.values['simulation.max_waiting']
        self._server.served = ServedRobot(self._for_requests, self._for_simulations,
                                          self.loads, self.values, self._request_frames,
                                          self._bending_for_requests, self.path.measured,
                                          self.path.measured_speeds,
                                          self.later_kernels.require, self._contacts)
