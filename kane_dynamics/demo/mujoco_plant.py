"""
The simulated arm of the demo: MuJoCo, an independent engine, behind ROS topics.

It publishes ``joint_states`` at 500 Hz on an absolute schedule and applies the torques
of ``commands`` and of a soft servo, which tracks the motion received on ``desired``.
Stamps are simulated time; late ticks are caught up. A record of the run is written to a
file on request.

With the argument ``clock`` it publishes ``/clock`` instead, and simulated time stands
still until each state is answered: a machine that stalls does not let the arm fall.

With the argument ``elastic`` the joints have a motor and a spring each; joint states and
torques are those of the motors, and brakes hold the arm in place of the servo.
"""

from collections.abc import Sequence
from pathlib import Path
import re
import sys
import time
from typing import Any

from geometry_msgs.msg import WrenchStamped
from kane_dynamics._util.typing import Array
from kane_dynamics._util.whole_files import whole_file
from kane_dynamics.demo.demo_settings import (DemoRobot, ELASTIC_RATE, NODE, PLANT, RATE,
                                              ROBOTS)
from kane_dynamics.demo.two_mass_arm import TwoMassArm
from kane_dynamics.mechanics.constraints.yaml_file import load_constraints
from kane_dynamics.motion.motion import Motion
from kane_dynamics.ros.common.command_topic import SIMULATED_ROBOT
from kane_dynamics.ros.common.process import make_executor
from kane_dynamics.ros.loads.wrench_input import wrench_array
from kane_dynamics.urdf import load_urdf
import mujoco
import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64MultiArray
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory

SUBSTEPS = 4  # MuJoCo steps a tick
COLUMNS = ('t', 'q', 'u', 'command', 'servo', 'late', 'wrench', 'place')
ANSWER = 0.5  # s for which simulated time stands still at most
EPOCH = 1_000_000_000  # start of simulated time, ns
HOLD = 2000.0  # N/m or N m/rad: holds the joints that are not part of the arm
HOLD_DAMPING = 20.0  # N s/m or N m s/rad
BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


class MujocoArm:
    """
    The arm in MuJoCo: the URDF's bodies, joints, damping and friction; no contacts.

    Loops are closed by equality constraints of MuJoCo, which joins the origins of two
    frames.

    Parameters
    ----------
    robot : DemoRobot
    urdf : str, optional
        Another URDF text than that of the robot, for example with a payload.

    """

    rate = RATE
    has_servo = True

    def __init__(self, robot: DemoRobot, urdf: str | None = None) -> None:
        """Compile the URDF without geometry, which may refer to files."""
        self.robot = robot
        text = robot.urdf.read_text(encoding='utf-8') if urdf is None else urdf
        without_shapes = re.sub(r'<(visual|collision)\b.*?</\1>', '', text,
                                flags=re.DOTALL)
        spec = mujoco.MjSpec.from_string(without_shapes)
        spec.compiler.fusestatic = False  # frames of wrenches are links without mass
        if robot.constraints is not None:
            _close_loops(spec, robot.constraints)
        self.model = spec.compile()
        self.model.opt.timestep = 1.0 / (RATE * SUBSTEPS)
        self.model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        self.data = mujoco.MjData(self.model)
        # Indices in MuJoCo's coordinates and speeds of the joints with motors.
        self._q = [self.model.joint(name).qposadr[0] for name in robot.joints]
        self._u = [self.model.joint(name).dofadr[0] for name in robot.joints]
        # Positions at home by coordinate; joints without one, such as of a gripper, are
        # held.
        self._home: dict[int, float] = {}
        self._held = set(range(self.model.nv))
        for name, angle in robot.positions.items():
            joint = self.model.joint(name)
            self._home[joint.qposadr[0]] = angle
            self._held.discard(joint.dofadr[0])
        self.frame = self.model.body(robot.frame).id
        self.reset()

    def reset(self) -> None:
        """Put the arm at rest at home, without a wrench."""
        mujoco.mj_resetData(self.model, self.data)
        self.wrench = np.zeros(6)  # at the origin of the robot's frame, in world axes
        self.data.qpos[list(self._home)] = list(self._home.values())
        mujoco.mj_forward(self.model, self.data)

    @property
    def state(self) -> tuple[Array, Array]:
        """Return positions and velocities of the joints of the arm, rad and rad/s."""
        return self.data.qpos[self._q].copy(), self.data.qvel[self._u].copy()

    @property
    def place(self) -> Array:
        """Return the origin of the robot's frame, (3,), m, world axes."""
        return np.array(self.data.xpos[self.frame])

    def step(self, tau: Array) -> None:
        """Advance by one tick under joint torques, N m, and the wrench."""
        held = sorted(self._held)
        for _ in range(SUBSTEPS):
            force = self.data.qfrc_applied
            force[:] = 0.0
            force[self._u] = tau
            spring = -HOLD * self.data.qpos[held]
            force[held] = spring - HOLD_DAMPING * self.data.qvel[held]
            if self.wrench.any():
                mujoco.mj_applyFT(self.model, self.data, self.wrench[:3],
                                  self.wrench[3:], self.data.xpos[self.frame],
                                  self.frame, force)
            mujoco.mj_step(self.model, self.data)


class ElasticMujocoArm:
    """
    The arm in MuJoCo with elastic joints; states and torques are those of the motors.

    Parameters
    ----------
    robot : DemoRobot
        With drives.

    """

    rate = ELASTIC_RATE
    has_servo = False  # brakes hold it instead

    def __init__(self, robot: DemoRobot) -> None:
        """Compile the links, the motors and the springs between them."""
        self.robot = robot
        model = load_urdf(robot.urdf, joints=robot.joints, supplement={'drives': robot.drives})
        text = robot.urdf.read_text(encoding='utf-8')
        self._arm = TwoMassArm(text, model, 1.0 / (self.rate * SUBSTEPS), 'RK4')
        stiffness = [drive['stiffness'] for drive in robot.drives.values()]

        # At rest the springs hold the links: forces of MuJoCo with springs at rest.
        n = len(robot.joints)
        none = np.zeros(2 * n)
        self._arm.put(np.tile(robot.home, 2), none)
        weight = self._arm.bias_forces()[:n]
        self._rest = np.concatenate([robot.home, robot.home + weight / stiffness])
        self._none = none
        self._motors = slice(n, 2 * n)
        self.reset()

    def reset(self) -> None:
        """Put the arm at rest with its links at home."""
        self.wrench = np.zeros(6)
        self._arm.put(self._rest, self._none)

    @property
    def state(self) -> tuple[Array, Array]:
        """Return positions and velocities of the motors, joint-side, rad and rad/s."""
        q, u = self._arm.state
        return q[self._motors], u[self._motors]

    @property
    def place(self) -> Array:
        """Return the origin of the robot's frame, (3,), m, world axes."""
        return self._arm.position(self.robot.frame)

    def step(self, tau: Array) -> None:
        """Advance by one tick under torques of the motors, joint-side, N m."""
        torques = self._none.copy()
        torques[self._motors] = tau
        self._arm.step(torques, SUBSTEPS)


def _close_loops(spec: Any, path: Path) -> None:
    """Join the frames of each closure of a constraints file; the pins are parallel."""
    for closure in load_constraints(path)['constraints']:
        for frame in (closure.first, closure.second):
            spec.body(frame).add_site(name=frame)
        # All but rigid: the constraint is restored within two steps.
        spec.add_equality(
            type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_SITE,
            name1=closure.first, name2=closure.second,
            solref=[2.0 / (RATE * SUBSTEPS), 1.0],
            solimp=[0.9999, 0.9999, 1e-3, 0.5, 2.0])


class MujocoPlant(Node):
    """The arm behind ROS topics and services."""

    def __init__(self, arm: MujocoArm | ElasticMujocoArm, record: str,
                 publishes_clock: bool) -> None:
        """Open topics and services; `record` is the file that ~/save writes."""
        super().__init__(PLANT.strip('/'))
        self.clock: Any = None
        if publishes_clock:
            self.clock = self.create_publisher(Clock, '/clock', 1)
        self.answered: Future[None] = Future()  # the last state
        self.is_answering = False  # whether a node answers states
        self.arm = arm
        self._robot = arm.robot
        self._record = record
        self._motion: Motion | None = None
        self._started = 0.0
        self.now = 0.0  # time of the last state, s
        self._last_stamp = 0
        self._servo_on = True
        self._command = np.zeros(len(self._robot.joints))
        self._rows: list[tuple[Any, ...]] = []
        self._sent: dict[int, int] = {}
        self._latencies: list[tuple[float, float]] = []  # time in the motion, latency, s
        self._message = JointState(name=list(arm.robot.joints))
        self._publisher = self.create_publisher(JointState, 'joint_states', BEST_EFFORT)
        reliable = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
        self.create_subscription(Float64MultiArray, 'commands', self._on_command,
                                 reliable)
        self.create_subscription(JointState, f'{NODE}/joint_torques',
                                 self._on_torques, BEST_EFFORT)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._simulated = self.create_publisher(Bool, f'~/{SIMULATED_ROBOT}', latched)
        self._simulated.publish(Bool(data=True))  # so that the node activates itself
        self.create_subscription(JointTrajectory, 'desired', self._on_desired, latched)
        self.create_subscription(WrenchStamped, '~/wrench', self._on_wrench, reliable)
        self.create_service(SetBool, '~/reset', self._reset)
        self.create_service(SetBool, '~/servo', self._switch_servo)
        self.create_service(Trigger, '~/save', self._save)

    def publish_state(self, stamp: int) -> None:
        """Publish the state at `stamp`, ns."""
        self.now = stamp * 1e-9
        q, u = self.arm.state
        t = stamp * 1e-9
        servo = self._servo(t, q, u)
        message = self._message
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        message.position = q.tolist()
        message.velocity = u.tolist()
        self._sent[stamp] = time.perf_counter_ns()
        self._last_stamp = stamp
        if self.clock is not None:
            self.answered = Future()
            self.clock.publish(Clock(clock=message.header.stamp))
        self._publisher.publish(message)
        late = (time.time_ns() - stamp) * 1e-9
        self._rows.append((t - self._started, q, u, self._command, servo, late,
                           self.arm.wrench, self.arm.place))
        self._applied_servo = servo

    def step(self) -> None:
        """Advance by one tick under the last command, unless brakes hold the arm."""
        braked = self._servo_on or not self.is_answering
        if self.arm.has_servo or not braked:
            self.arm.step(self._command + self._applied_servo)

    def _servo(self, t: float, q: Array, u: Array) -> Array:
        """Return the torque of the soft servo, N m."""
        if not (self._servo_on and self.arm.has_servo):
            return np.zeros(len(self._robot.joints))
        q_d = self._robot.home
        u_d = np.zeros(len(self._robot.joints))
        if self._motion is not None:
            q_d, u_d, _ = self._motion.sample(t - self._started)
        return self._robot.kp * (q_d - q) + self._robot.kd * (u_d - u)

    def _on_command(self, message: Float64MultiArray) -> None:
        self._command = np.array(message.data)

    def _on_wrench(self, message: WrenchStamped) -> None:
        """Apply a wrench, in world axes, until the next one."""
        self.arm.wrench = wrench_array(message)

    def _switch_servo(self, request: Any, response: Any) -> Any:
        """Switch the servo, or the brakes, and begin the record."""
        self._servo_on = request.data
        self._begin_record(self.now)
        response.success = True
        return response

    def _on_torques(self, message: JointState) -> None:
        """Record the latency from a state to its torques."""
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        sent = self._sent.pop(stamp, None)
        if sent is not None:
            self._command = np.array(message.effort)
            self.is_answering = True
            if stamp == self._last_stamp and not self.answered.done():
                self.answered.set_result(None)
            self._latencies.append((stamp * 1e-9 - self._started,
                                    (time.perf_counter_ns() - sent) * 1e-9))

    def _on_desired(self, message: JointTrajectory) -> None:
        start = message.header.stamp
        self._begin_record(start.sec + start.nanosec * 1e-9)
        self._motion = Motion.from_points(
            [p.time_from_start.sec + p.time_from_start.nanosec * 1e-9
             for p in message.points],
            [p.positions for p in message.points], joint_names=message.joint_names,
            order=self._robot.joints)

    def _reset(self, request: Any, response: Any) -> Any:
        """Reset the arm to rest at home, switch the servo, and drop the motion."""
        self.arm.reset()
        self._motion = None
        self._servo_on = request.data
        self.is_answering = False
        self._begin_record(self.now)
        response.success = True
        return response

    def _begin_record(self, start: float) -> None:
        """Start a new record with times relative to `start`."""
        self._started = start
        self._rows.clear()
        self._sent.clear()
        self._latencies.clear()

    def _save(self, request: Any, response: Any) -> Any:
        """Write the record, and the latencies, to the file."""
        columns: Any = {}
        for name, values in zip(COLUMNS, zip(*self._rows)):
            columns[name] = np.array(values)
        latency = np.array(self._latencies).reshape(-1, 2)
        with whole_file(self._record, binary=True) as file:
            np.savez(file, latency=latency, started=self._started, **columns)
        response.success = True
        response.message = self._record
        return response


def main(arguments: Sequence[str]) -> None:
    """
    Run the arm until a signal.

    Arguments: name of the robot, record file, and options: clock, elastic.
    """
    name, record, *options = arguments
    kind = ElasticMujocoArm if 'elastic' in options else MujocoArm
    arm = kind(ROBOTS[name])
    rclpy.init()
    plant = MujocoPlant(arm, record, 'clock' in options)
    executor = make_executor(plant)
    try:
        if plant.clock is None:
            _run_in_real_time(plant, executor)
        else:
            _run_by_answers(plant, executor)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        plant.destroy_node()
        rclpy.try_shutdown()


def _run_in_real_time(plant: MujocoPlant, executor: Any) -> None:
    """Tick at the rate of the states; late ticks are caught up."""
    period = round(1e9 / RATE)
    tick = time.time_ns()
    never: Future[None] = Future()
    while rclpy.ok():
        plant.publish_state(tick)
        plant.step()
        tick += period
        left = max(1e-5, (tick - time.time_ns()) * 1e-9)
        executor.spin_until_future_complete(never, timeout_sec=left)


def _run_by_answers(plant: MujocoPlant, executor: Any) -> None:
    """Step in real time or slower: each step waits for the answer to the last state."""
    rate = plant.arm.rate
    period = round(1e9 / rate)
    tick = EPOCH
    due = time.monotonic()
    never: Future[None] = Future()
    while rclpy.ok():
        plant.publish_state(tick)
        if plant.is_answering:
            executor.spin_until_future_complete(plant.answered, timeout_sec=ANSWER)
            plant.is_answering = plant.answered.done()
        due = max(due + 1.0 / rate, time.monotonic())
        left = max(1e-5, due - time.monotonic())
        executor.spin_until_future_complete(never, timeout_sec=left)
        plant.step()
        tick += period


if __name__ == '__main__':
    main(sys.argv[1:])
