"""
The simulated arm of the demo: MuJoCo, an independent engine, behind ROS topics.

It publishes ``joint_states`` at 500 Hz on an absolute schedule and applies the torques
of ``commands`` and of a soft servo, which tracks the motion received on ``desired``.
Stamps are simulated time; late ticks are caught up. A record of the run is written to a
file on request.
"""

from pathlib import Path
import re
import sys
import time
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics._util.whole_files import whole_file
from kane_dynamics.demo.demo_settings import DemoRobot, FR3, NODE, PLANT, RATE
from kane_dynamics.mechanics.constraints.yaml_file import load_constraints
from kane_dynamics.motion.motion import Motion
from kane_dynamics.ros.common.process import make_executor
import mujoco
import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory

SUBSTEPS = 4  # MuJoCo steps a tick
COLUMNS = ('t', 'q', 'u', 'command', 'servo', 'late')
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
        self.reset()

    def reset(self) -> None:
        """Put the arm at rest at home."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[list(self._home)] = list(self._home.values())
        mujoco.mj_forward(self.model, self.data)

    @property
    def state(self) -> tuple[Array, Array]:
        """Return positions and velocities of the joints of the arm, rad and rad/s."""
        return self.data.qpos[self._q].copy(), self.data.qvel[self._u].copy()

    def step(self, tau: Array) -> None:
        """Advance by one tick under joint torques, N m."""
        held = sorted(self._held)
        for _ in range(SUBSTEPS):
            force = self.data.qfrc_applied
            force[:] = 0.0
            force[self._u] = tau
            spring = -HOLD * self.data.qpos[held]
            force[held] = spring - HOLD_DAMPING * self.data.qvel[held]
            mujoco.mj_step(self.model, self.data)


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

    def __init__(self, arm: MujocoArm, record: str) -> None:
        """Open topics and services; `record` is the file that ~/save writes."""
        super().__init__(PLANT.strip('/'))
        self.arm = arm
        self._robot = arm.robot
        self._record = record
        self._motion: Motion | None = None
        self._started = 0.0
        self.now = 0.0  # time of the last state, s
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
        self.create_subscription(JointTrajectory, 'desired', self._on_desired, latched)
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
        self._publisher.publish(message)
        late = (time.time_ns() - stamp) * 1e-9
        self._rows.append((t - self._started, q, u, self._command, servo, late))
        self._applied_servo = servo

    def step(self) -> None:
        """Advance by one tick under the last command and the servo."""
        self.arm.step(self._command + self._applied_servo)

    def _servo(self, t: float, q: Array, u: Array) -> Array:
        """Return the torque of the soft servo, N m."""
        if not self._servo_on:
            return np.zeros(len(self._robot.joints))
        q_d = self._robot.home
        u_d = np.zeros(len(self._robot.joints))
        if self._motion is not None:
            q_d, u_d, _ = self._motion.sample(t - self._started)
        return self._robot.kp * (q_d - q) + self._robot.kd * (u_d - u)

    def _on_command(self, message: Float64MultiArray) -> None:
        self._command = np.array(message.data)

    def _switch_servo(self, request: Any, response: Any) -> Any:
        """Switch the servo, and begin the record."""
        self._servo_on = request.data
        self._begin_record(self.now)
        response.success = True
        return response

    def _on_torques(self, message: JointState) -> None:
        """Record the latency from a state to its torques."""
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        sent = self._sent.pop(stamp, None)
        if sent is not None:
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


def main(record: str) -> None:
    """Run the arm until a signal, at the rate of the states; late ticks are caught up."""
    rclpy.init()
    plant = MujocoPlant(MujocoArm(FR3), record)
    executor = make_executor(plant)
    period = round(1e9 / RATE)
    tick = time.time_ns()
    never: Future[None] = Future()
    try:
        while rclpy.ok():
            plant.publish_state(tick)
            plant.step()
            tick += period
            left = max(1e-5, (tick - time.time_ns()) * 1e-9)
            executor.spin_until_future_complete(never, timeout_sec=left)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        plant.destroy_node()
        rclpy.try_shutdown()


if __name__ == '__main__':
    main(sys.argv[1])
