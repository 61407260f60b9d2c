"""Mode cartesian_impedance: the controlled frame on a spring to its target."""

from collections.abc import Callable, Mapping
from typing import Any

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.control.traced_laws import LawInput, TracedLaw
from kane_dynamics.control_cycle.cycle_results import NEVER
from kane_dynamics.mechanics.algebra.flags import packed
from kane_dynamics.model.model import WORLD
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.robot import Robot
from kane_dynamics.robot.robot_function import identifier
from kane_dynamics.ros.common.conversion import NANO
from kane_dynamics.ros.modes.cartesian_cycle import (CartesianCycle, memory_size,
                                                     ORDERS_SIZE, target_of,
                                                     unpacked_memory)
from kane_dynamics.ros.modes.cartesian_target import CartesianTarget
from kane_dynamics.ros.modes.live_law import NativeLaw, WALL
from kane_dynamics.ros.modes.task_description import TaskDescription, TaskSnapshot
from kane_dynamics.ros.parameters.task_settings import (cartesian_settings,
                                                        controlled_frame, differ,
                                                        target_limits)
from kane_dynamics.task_space.cartesian_impedance import (CartesianImpedance,
                                                          compile_state, impedance_law,
                                                          joints_at_walls,
                                                          null_space_spring,
                                                          posture_place, wall_slopes)
from kane_dynamics.task_space.joint_speed_limits import LONGEST_PERIOD
from kane_dynamics.task_space.law_kernel import (lanes_of_single_states,
                                                 LanesOf, Law, law_kernel, settings_of)
from kane_dynamics.task_space.pose_filter import LIMITS
from kane_dynamics.task_space.sampled_spring import JointSpring, spring_of_joints
import numpy as np

NEAR = 0.999  # of a limit of the target, above which it is reported


class CartesianMode(NativeLaw):
    """
    The law of mode cartesian_impedance, with its target.

    The target begins at the pose of the frame at the first state. What messages make of
    it moves within limits of speed and acceleration, so that no message makes a jump of
    torque.

    Parameters
    ----------
    robot : Robot
        The robot of the torque path.
    values : mapping
        The node's parameters; cartesian.*, walls.* and target.* are used.

    Attributes
    ----------
    frame : str
        The controlled frame.
    target : CartesianTarget
        By the messages, before the limits.

    Raises
    ------
    InputError
        A parameter does not fit the robot.

    """

    pose: Array | None = None  # no joint positions are held
    longest_period = LONGEST_PERIOD

    def __init__(self, robot: Robot, values: Mapping[str, Any]) -> None:
        self.frame = controlled_frame(values, robot.model)
        self._robot = robot
        self._axes = values['cartesian.axes']
        self._settings = cartesian_settings(values, robot)
        self.law = self._law_with(robot.neutral())
        self._numbers = self._numbers_of_law()
        # A law of its own checks settings that the path does not use yet, and another one
        # describes the states of other threads.
        self._trial = self._law_with(robot.neutral())
        self._describing = self._law_with(robot.neutral())
        self._described = robot.neutral(), self._settings
        self.target = CartesianTarget(values['target.timeout'])
        self._use_target_limits(values)
        # Arguments of the cycle, where they change from cycle to cycle.
        self._memory = np.zeros(memory_size(robot.n_q))
        self._orders = np.zeros(ORDERS_SIZE)
        self._ordered: tuple[int, int] | None = None  # the epoch and the count of orders
        self._epoch = 0
        self._clock = np.array([0.0, 1.0])  # stamp, and whether the law begins
        self.restart()

    def _law_with(self, posture: Array) -> CartesianImpedance:
        """Return a law with the present settings."""
        return CartesianImpedance(self._robot, self.frame, axes=self._axes,
                                  **{'posture': posture, **self._settings})

    def _numbers_of_law(self) -> Array:
        """Return the settings of the law, and whether they state a posture."""
        return np.append(settings_of(self.law), float('posture' in self._settings))

    @lazy_property
    def _cycle(self) -> Callable[..., Array]:
        """Return the entry point of the cycle: torques, then the next memory."""
        robot = self._robot

        def cycle_of(choice: Robot, lanes_of: LanesOf) -> Law:
            cycle = self._cycle_of(choice, lanes_of)

            # A row is torques, then the memory that the next cycle gets.
            def row(q: Vector, u: Vector, clock: Vector, memory: Vector, settings: Vector,
                    orders: Vector, *, t: Scalar, parameters: Vector) -> Vector:
                stamp, begins = clock
                return np.concatenate(cycle.torque(q, u, stamp, begins, memory, settings,
                                                   orders, t=t, parameters=parameters))
            return row
        # The memory of a cycle is an argument, so that the cycle is a function without
        # state.
        joints = len(robot.joint_names)
        memory = memory_size(robot.n_q)
        inputs = {'q': (robot.n_q,), 'u': (robot.n,), 'clock': (2,),
                  'memory': (memory,), 'settings': self._numbers.shape,
                  'orders': (ORDERS_SIZE,)}
        kernel = law_kernel(robot, cycle_of, identifier('cartesian_cycle', self.frame,
                                                        self._axes), inputs,
                            (joints + memory,))
        return kernel.entry('', kernel)

    def _cycle_of(self, robot: Robot, lanes_of: LanesOf) -> CartesianCycle:
        """Return the traced cycle in the speeds of a robot."""
        frame = robot.model.frame(self.frame)

        def frame_pose(q: Vector, t: Scalar) -> Matrix:
            return robot.equations.frame_pose(frame, q, t)
        return CartesianCycle(frame_pose, impedance_law(self.law, robot, lanes_of),
                              posture_place(self.law))

    def _use_target_limits(self, values: Mapping[str, Any]) -> None:
        """Use the parameters of the target."""
        self.target.timeout = values['target.timeout']
        limits = target_limits(values)
        self._limits = np.array([limits[name] for name in LIMITS])
        self._farthest = values['target.max_distance']
        self._widest = values['target.max_angle']

    def check(self, values: Mapping[str, Any]) -> None:
        """Raise InputError unless parameters fit the arm."""
        # A law of its own checks the settings, which that of the path does not use yet.
        settings = cartesian_settings(values, self._robot)
        if differ(settings, self._settings):
            self._trial.update(**{'posture': self._robot.neutral(), **settings})

    def update(self, values: Mapping[str, Any]) -> bool:
        """Use checked parameters; return whether a setting of the law changes."""
        settings = cartesian_settings(values, self._robot)
        changed = differ(settings, self._settings)
        self._settings = settings
        self._use_target_limits(values)
        # Orders are written again into the settings, as limits of the target may have
        # changed.
        self._ordered = None
        if changed:
            self.law.update(**{'posture': self._robot.neutral(), **settings})
            self._numbers = self._numbers_of_law()
        return changed

    def compile(self) -> None:  # noqa: A003
        """Compile the cycle; the native torque path has one of its own."""
        self._cycle  # noqa: B018

    def compile_description(self) -> None:
        """Compile what describes a state."""
        compile_state(self._describing)

    @property
    def begins(self) -> bool:
        """Return whether the law begins at the next state, and follows no earlier pose."""
        return bool(self._clock[1])

    def restart(self) -> None:
        """Begin at the pose of the frame at the next state."""
        self._clock[1] = 1.0

    def torque(self, q: Array, u: Array, motion: Motion | None, moment: float,
               t: float) -> Array:
        """Return joint torques (n_q,) towards the target at stamp t, s."""
        # Times relative to the epoch, since nanoseconds since 1970 have more digits than
        # a double.
        stamp = round(t * NANO)
        if self._clock[1]:
            self._epoch = stamp
        self._clock[0] = stamp - self._epoch
        times = self._robot.equations.time_inputs(t)
        # Orders change rarely: they are numbers again only after a change.
        if self._ordered != (self._epoch, self.target.changes):
            self._orders = self.order_numbers(self._epoch)
            self._ordered = self._epoch, self.target.changes
        row = self._cycle(q, u, self._clock, self._memory, self._numbers, self._orders,
                          *times)
        self._clock[1] = 0.0
        n = len(self._robot.joint_names)
        self._memory = row[n:]
        return row[:n]

    def snapshot(self, stamp: int) -> TaskSnapshot:
        """Return the record of the last cycle; empty before the first one."""
        # No cycle has run with the memory yet.
        if self._clock[1]:
            return TaskSnapshot()
        memory = unpacked_memory(self._memory.copy(), self._robot.n_q)
        # Without a target the age has no meaning.
        age = -1.0
        if memory.posed_at > NEVER or self.target.twists > memory.twists:
            age = (stamp - self.target.moved_at) / NANO
        pose, twist, _ = target_of(memory.followed)
        return TaskSnapshot(pose, age, (twist, memory.wrench, memory.posture))

    def describe(self, q: Array, u: Array, snapshot: TaskSnapshot) -> TaskDescription:
        """Return the wrench of the law at a state, and what is at its limit."""
        if snapshot.desired is None:
            return TaskDescription()
        twist, wrench, posture = snapshot.detail
        self._describe_with(posture)
        state = self._describing.state(q, u, snapshot.desired, twist)
        saturated = []

        # The names of limits that bound the law at this state.
        for what, scale in zip(('force', 'moment'), state.spring_scale):
            if scale < 1.0:
                saturated.append(f'{what} of the spring')
        if state.effort_scale < 1.0:
            saturated.append('effort of the task')
        if state.speed_scale < 1.0 or state.braking > 0.0:
            saturated.append('speed of the joints')
        if state.regularization > 0.0:
            saturated.append('singular configuration')
        for joint in joints_at_walls(self._describing, q):
            saturated.append(f'wall of {joint}')
        # The target itself may be as fast as its limits allow.
        for what, part, limit in (('speed', twist[:3], self._limits[0]),
                                  ('angular speed', twist[3:], self._limits[1])):
            if np.sqrt(part @ part) > NEAR * limit:
                saturated.append(f'{what} of the target')
        total = in_world(self._rotation(snapshot.desired), state.wrench) + wrench
        return TaskDescription(total, tuple(saturated))

    def _describe_with(self, posture: Array) -> None:
        """Give a posture, (n_q,), and the settings to the law of other threads."""
        described = self._described
        self._described = posture, self._settings
        if not np.array_equal(posture, described[0]) or self._settings is not described[1]:
            self._describing.update(**{'posture': posture, **self._settings})

    def springs(self, q: Array) -> dict[str, JointSpring]:
        """
        Return the springs and dampers at q, (n_q,), with target and posture there.

        They are J^T K J and J^T D J of the frame; damper and spring in its null space; and
        the walls.
        """
        robot = self._robot
        self._describe_with(q)
        pose = robot.frame_pose(self.frame, q)
        rotation = self._rotation(pose)
        jacobian = robot.jacobian(self.frame, q)
        along, about = np.split(jacobian, 2)
        J = np.concatenate([rotation.T @ along, rotation.T @ about])
        stiffness = J.T @ (self._settings['stiffness'][:, None] * J)
        # The damper follows from inertia and spring: its wrench at unit speeds states it.
        wrenches = [self._describing.state(q, speeds, pose).wrench
                    for speeds in np.eye(robot.n)]
        # The frame's spring, those of its null space, then the walls.
        frame = JointSpring(stiffness, -J.T @ np.stack(wrenches, axis=1), by_ratio=True)
        posture, damping = null_space_spring(self._describing, q, J)
        return {
            'stiffness': frame,
            'null-space damping': JointSpring(np.zeros_like(damping), damping, False),
            'posture stiffness': JointSpring(posture, np.zeros_like(posture), False),
            WALL: spring_of_joints(robot, q, *wall_slopes(self._describing, q))}

    def _rotation(self, desired: Array) -> Array:
        """Return the axes of the law as columns, in the world, for a desired pose."""
        if self._axes == 'world':
            return np.eye(3)
        if self._axes == 'frame':
            return desired[:3, :3]
        model = self._robot.model
        reference = model.frame(self._axes)
        # Axes fixed to the world, or turned with the body of the controlled frame.
        if reference.body == WORLD:
            return reference.rotation
        return desired[:3, :3] @ model.frame(self.frame).rotation.T @ reference.rotation

    # On the native torque path.

    def traced(self) -> TracedLaw:
        """Return the law for an arm in joint rates."""
        cycle = self._cycle_of(self._robot, lanes_of_single_states)
        size = len(self.settings_numbers())

        # The same cycle as of `torque`; its memory is the path's.
        def torque(at: LawInput) -> tuple[Vector, Vector]:
            return cycle.torque(at.q, at.u, at.stamp, at.begins, at.memory,
                                at.settings[:size], at.settings[size:], t=0.0,
                                parameters=at.parameters)
        return TracedLaw(torque, size + ORDERS_SIZE, memory_size(self._robot.n_q),
                         variant=(self.frame, self._axes))

    def settings_numbers(self) -> Array:
        """Return the settings of the law, and whether they state a posture."""
        return self._numbers

    def order_numbers(self, epoch: int) -> Array:
        """Return the orders of messages to the target as numbers, with times since epoch, ns."""
        orders = self.target.orders(epoch, self._farthest, self._widest, self._limits)
        return np.asarray(packed(orders), dtype=np.float64)

    def mirror(self, memory: Array, epoch: int) -> None:
        """Keep the target of a cycle of the native thread."""
        self._memory = memory[:len(self._memory)]
        self._epoch = epoch
        self._clock[1] = 0.0


def in_world(rotation: Array, six: Array) -> Array:
    """Return linear and angular components, (6,), of those in axes."""
    return np.concatenate([rotation @ six[:3], rotation @ six[3:]])
