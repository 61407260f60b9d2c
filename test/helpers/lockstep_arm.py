"""An arm in MuJoCo that a node commands over DDS in lockstep, torque by torque."""

import time
from typing import NamedTuple

from geometry_msgs.msg import PoseStamped
from kane_dynamics.kinematics.poses import rotation_quaternion
from kane_dynamics_interfaces.msg import TaskState
from node_process import BEST_EFFORT, DEEP, NAME
import numpy as np
from rcl_interfaces.srv import GetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

NANO = 10**9
PERIOD = 10**6  # ns between two joint states
EARLIEST = NANO  # stamp of the first state; 0 would say that no clock runs


class Cycle(NamedTuple):
    """One period: its state and the node's torques, in the robot's order."""

    time: float  # s since the first state
    q: np.ndarray
    u: np.ndarray
    tau: np.ndarray


class LockstepArm:
    """
    A simulated arm that publishes /clock and joint states, and applies the answers.

    A busy machine makes it slower and changes nothing else.

    Parameters
    ----------
    plant
        With `state` and `step(tau)`, and `robot`, whose joints it has.

    """

    def __init__(self, plant):
        self.plant = plant
        self.joints = plant.robot.joint_names
        self.node = Node('lockstep_arm')
        self._states = self.node.create_publisher(JointState, 'joint_states',
                                                  BEST_EFFORT)
        self._clock = self.node.create_publisher(Clock, '/clock', BEST_EFFORT)
        self._targets = self.node.create_publisher(PoseStamped, f'{NAME}/target_pose', 1)
        self._torques = self.node.create_subscription(
            JointState, f'{NAME}/joint_torques', lambda message: None, DEEP)
        self._task_states = self.node.create_subscription(
            TaskState, f'{NAME}/task_state', lambda message: None, DEEP)
        # A service of the thread of the node that takes targets and publishes task
        # states.
        self._asking = Node('lockstep_asking')
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._asking)
        self._parameters = self._asking.create_client(GetParameters,
                                                      f'{NAME}/get_parameters')
        self.task_states = []
        self.unanswered = 0
        self._stamp = EARLIEST

    @property
    def time(self):
        """Return simulated time since the first state, s."""
        return (self._stamp - EARLIEST) / NANO

    def connect(self, timeout=60.0, targets=True):
        """Hold the arm under its weight until the node answers, and hears targets."""
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            hears = self._targets.get_subscription_count() or not targets
            if hears and self.cycle(0.1).tau is not None:
                self.unanswered = 0
                return
        raise AssertionError('the node publishes no torques')

    def cycle(self, patience=5.0):
        """Publish the state, wait for its torques, and advance by one period."""
        q, u = self.plant.state
        now = self.time
        clock = Clock()
        message = JointState(name=list(self.joints), position=q.tolist(),
                             velocity=u.tolist())
        for stamp in (clock.clock, message.header.stamp):
            stamp.sec, stamp.nanosec = divmod(self._stamp, NANO)
        self._clock.publish(clock)
        self._states.publish(message)
        tau = self._answer(time.monotonic() + patience)
        self._stamp += PERIOD
        if tau is None:
            self.unanswered += 1
            self.plant.step(self.plant.robot.gravity_force(q))
        else:
            self.plant.step(tau)
        self._take_task_states()
        return Cycle(now, q, u, tau)

    def _answer(self, end):
        """Return the torques for the present state in our order; None without any."""
        while time.monotonic() < end:
            taken = self._torques.handle.take_message(JointState, False)
            if taken is None:
                time.sleep(0.0)
                continue
            message = taken[0]
            stamp = message.header.stamp
            if stamp.sec * NANO + stamp.nanosec == self._stamp:
                efforts = dict(zip(message.name, message.effort, strict=True))
                return np.array([efforts[name] for name in self.joints])
        return None

    def _take_task_states(self):
        while (taken := self._task_states.handle.take_message(TaskState,
                                                              False)) is not None:
            self.task_states.append(taken[0])

    def send_target(self, pose):
        """Publish a pose (4, 4) of the controlled frame in the world."""
        message = PoseStamped()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(
            self._stamp, NANO)
        p = message.pose.position
        r = message.pose.orientation
        p.x, p.y, p.z = pose[:3, 3].tolist()
        r.x, r.y, r.z, r.w = rotation_quaternion(pose[:3, :3]).tolist()
        self._targets.publish(message)

    def wait_for_node(self, patience=20.0):
        """
        Wait until the node has taken what was published before.

        Its torques do not wait for the interpreter, which takes targets and publishes
        task states: on a busy machine both would be late by many periods of the arm.
        """
        assert self._parameters.wait_for_service(patience)
        future = self._parameters.call_async(GetParameters.Request())
        self._executor.spin_until_future_complete(future, patience)
        assert future.done()

    def close(self):
        """Leave the graph."""
        self._executor.shutdown()
        self._asking.destroy_node()
        self.node.destroy_node()
