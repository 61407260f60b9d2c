"""A simulated arm with dynamics node and torque_guard, whose commands are recorded."""

from contextlib import ExitStack
from itertools import pairwise
import os
from pathlib import Path
import signal
import time
from typing import NamedTuple

from kane_dynamics import Controller, load_urdf, Robot
from kane_dynamics.demo.demo_settings import FR3, PLANT
from kane_dynamics.ros.common.transport import without_shared_memory
from kane_dynamics.ros.plant.simulated_arm import SimulatedArm
from node_process import DEEP, JOINTS, NAME, prefer, Process, TORQUE_PATH, URDF
import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import Empty
from std_srvs.srv import SetBool
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

PERIOD = 0.002  # s, of the plant
DAMPING = 20.0  # 1/s
REACTION = 0.020  # s, of the guard at most
SAG = 0.5  # degrees, at most
HELD = 0.6  # s for which the guard holds the arm
NODE = 'kane_dynamics.ros.dynamics_node.main'


class Command(NamedTuple):
    """A command: who sent it, stamp of its state, system time (ns), torques."""

    source: str
    stamp: int
    time: int  # of sending for the guard, of reception for the node
    tau: np.ndarray


class Recorder(Node):
    """Records the commands of node and guard, by their topics, and the joint states."""

    def __init__(self):
        super().__init__('recorder')
        # states: (stamp, q, u)
        self.commands = []
        self.states = []
        self.create_subscription(
            JointState, f'{NAME}/joint_torques',
            lambda message: self._keep('node', message, time.time_ns()), DEEP)
        self._of_guard = Node('recorder_of_guard')
        self._of_guard.create_subscription(
            JointState, '/torque_guard/joint_torques', lambda message, info: self._keep(
                'guard', message, info['source_timestamp']), DEEP)
        self.create_subscription(JointState, 'joint_states', self._on_state,
                                 qos_profile_sensor_data)
        self.motions = self.create_publisher(JointTrajectory, f'{NAME}/joint_trajectory',
                                             1)
        self.block = self.create_publisher(Empty, f'{NAME}/block', 1)
        self._executor = EventsExecutor()
        self._executor.add_node(self)
        # The other gives no times of sending.
        self._slow_executor = SingleThreadedExecutor()
        self._slow_executor.add_node(self._of_guard)

    def _keep(self, source, message, when):
        self.commands.append(
            Command(source, _stamp(message), when, np.array(message.effort)))

    def _on_state(self, message):
        self.names = tuple(message.name)
        self.states.append((_stamp(message), np.array(message.position),
                            np.array(message.velocity)))

    def spin(self, seconds):
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            self._executor.spin_until_future_complete(Future(),
                                                      max(min(left, 0.01), 1e-4))
            for _ in range(10):  # it executes one callback
                self._slow_executor.spin_once(0.0)

    def spin_until(self, condition, timeout=30.0):
        end = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < end, f'not within {timeout} s'
            self.spin(0.005)

    def of(self, source):
        return [command for command in self.commands if command.source == source]

    def forget(self):
        self.commands.clear()
        self.states.clear()

    def close(self):
        self._executor.shutdown()
        self._slow_executor.shutdown()
        self._of_guard.destroy_node()
        self.destroy_node()


def _stamp(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


class Arm(NamedTuple):
    """An arm with its motion: positions home + amplitude sin(2 t + phase)."""

    urdf: str
    joints: tuple
    home: np.ndarray
    amplitude: np.ndarray
    rate: float  # largest rate of torque, N m/s


PLANT_ARM = Arm(URDF, JOINTS, np.zeros(3), np.array([0.6, 0.4, 0.1]), 2000.0)


def mujoco_arm():
    """Return the arm of the demo."""
    return Arm(FR3.urdf.read_text(), FR3.joints, FR3.home, np.full(7, 0.25), 1000.0)


class Rig:
    """
    Plant, node and guard as processes, and a recorder in this one.

    Parameters
    ----------
    folder : Path
        Folder for the URDF.
    arm : Arm
    mujoco : bool
        Simulate the arm by MuJoCo, else by plant_node.
    node : str
        Module of the dynamics node.
    arm_compensates : str
        What the arm adds itself, for plant_node and the node.

    """

    def __init__(self, folder: Path, arm=PLANT_ARM, *, mujoco=False, node=NODE,
                 arm_compensates='none', **parameters):
        if not rclpy.ok():
            rclpy.init()
        urdf = folder / 'arm.urdf'
        urdf.write_text(arm.urdf)
        self.arm = arm
        self._mujoco = mujoco
        self._module = node
        self.urdf = {'urdf': str(urdf)}
        self.parameters = {
            'activation': 'at_once', 'arm_compensates': arm_compensates,
            'mode': 'computed_torque', 'guard__enabled': 'true',
            'limits__rate': arm.rate,
            'gains__kp': 400.0, 'gains__kd': 40.0, 'realtime__priority': 20,
            'realtime__keep_awake': 'true',
            'torque_path': TORQUE_PATH, **parameters}
        if mujoco:  # its joint states have no fingers
            self.parameters['joints'] = f'[{",".join(arm.joints)}]'
        self.recorder = Recorder()
        self._watches = [
            Process(program=[str(Path(__file__).with_name('stall_watch.py')), str(k)])
            for k in sorted(os.sched_getaffinity(0))]
        self.failed_at = 0  # system time, ns
        self.plant = Process(program=[
            '-m', 'kane_dynamics.demo.mujoco_plant',
            str(folder / 'record.npz')]) if mujoco else Process(
            module='kane_dynamics.ros.plant.main', **self.urdf, command_timeout=100.0,
            after_timeout='hold', arm_compensates=arm_compensates)
        self.start_node()
        self.start_guard()

    def start_node(self):
        self.node = Process(module=self._module, real_states=True,
                            environment=without_shared_memory(),
                            **self.urdf, **self.parameters)

    def start_guard(self):
        self.guard = Process(module='kane_dynamics.ros.guard.main')

    def wait(self):
        """Wait until the node commands alone, for 100 states."""
        recorder = self.recorder
        for words, process in (('watching kane_dynamics', self.guard),
                               ('active', self.node)):
            recorder.spin_until(lambda p=process, w=words: w in p.log or not p.alive(),
                                120.0)
            assert words in process.log, self.logs()
        recorder.spin_until(lambda: recorder.states and len(recorder.of('node')) > 20
                            and recorder.motions.get_subscription_count() > 0, 90.0)
        # Switch the servo off that held the arm; a reset would be a jump.
        if self._mujoco:
            client = recorder.create_client(SetBool, f'{PLANT}/servo')
            recorder.spin_until(client.service_is_ready)
            future = client.call_async(SetBool.Request(data=False))
            recorder.spin_until(future.done)
            self._mujoco = False
        for process, priority in ((self.plant, 25), (self.guard, 22), (self.node, 18)):
            prefer(process.pid, priority)
        recorder.forget()
        recorder.spin_until(lambda: len(recorder.commands) > 100 and all(
            command.source == 'node' for command in recorder.commands[-100:]), 90.0)

    def move(self):
        """Start a motion and wait until the arm moves."""
        self.wait()
        recorder = self.recorder
        arm = self.arm
        names = recorder.names
        q0 = recorder.states[-1][1][[names.index(joint) for joint in arm.joints]]
        message = JointTrajectory(joint_names=list(arm.joints))
        for k in range(301):
            t = 0.1 * k
            grow = np.sin(0.5 * np.pi * min(t, 1.0)) ** 2
            q = q0 + grow * (arm.home - q0 + arm.amplitude * np.sin(
                2.0 * t + np.arange(len(q0))))
            point = JointTrajectoryPoint(positions=q.tolist())
            point.time_from_start.sec, point.time_from_start.nanosec = divmod(
                round(t * 1e9), 10**9)
            message.points.append(point)
        for _ in range(5):  # a new node may not be discovered yet
            recorder.motions.publish(message)
            recorder.spin(1.2)
            if self.moving():
                break
        recorder.forget()
        recorder.spin(0.2)

    def moving(self):
        """Return whether the arm moves and only the node commands."""
        recent = self.recorder.commands[-50:]
        return (len(recent) == 50 and all(command.source == 'node' for command in recent)
                and np.abs(self.recorder.states[-1][2]).max() > 0.2)

    def fail(self, number):
        """Send a signal to the node or block its main thread; return the time, ns."""
        self.failed_at = began = time.time_ns()
        if number is None:
            self.recorder.block.publish(Empty())
        else:
            os.kill(self.node.pid, number)
        return began

    def stalled(self, seconds):
        """Return whether a processor stalled between before and after the failure."""
        first = self.failed_at - 50_000_000
        last = self.failed_at + round(seconds * 1e9)
        stalls = []
        for watch in self._watches:
            for line in watch.log.splitlines():
                stalls.append(line.split())
        return any(int(start) < last and int(end) > first for start, end in stalls)

    def logs(self):
        return '\n'.join(f'--- {name}\n{process.log}' for name, process in (
            ('node', self.node), ('guard', self.guard), ('plant', self.plant)))

    def close(self):
        self.recorder.close()
        # One that does not end by itself fails the test, after all others have ended.
        with ExitStack() as ends:
            for process in (*self._watches, self.node, self.guard, self.plant):
                if process.alive():
                    os.kill(process.pid, signal.SIGCONT)
                    ends.callback(process.end, timeout=60.0)


def ideal_stop(model, states, failed, taken_over):
    """
    Return the index of the failure and the positions of an ideal stop from there on.

    Until the takeover the joints keep their speeds; then the guard's law acts without
    ramp.
    """
    k = next(i for i, (stamp, _, _) in enumerate(states) if stamp >= failed)
    robot = Robot(model)
    arm = SimulatedArm(robot, PERIOD / 2)
    law = Controller(robot, mode='computed_torque', kp=0.0, kd=DAMPING)
    arm.reset(states[k][1])
    arm.u[:] = states[k][2]
    positions = [arm.q.copy()]
    for earlier, later in pairwise(stamp for stamp, _, _ in states[k:]):
        # A busy recorder loses states: as many periods as the stamps are apart.
        for period in range(round((later - earlier) * 1e-9 / PERIOD)):
            if earlier + period * PERIOD * 1e9 < taken_over:
                arm.q[:] += PERIOD * arm.u
                continue
            tau = law.command(0.0, arm.q, arm.u).tau
            for _ in range(2):
                arm.step(tau)
        positions.append(arm.q.copy())
    return k, np.array(positions)


def sag(rig, failed, taken_over):
    """Return the largest distance from the ideal stop, degrees; stamps in ns."""
    recorder = rig.recorder
    arm = rig.arm
    order = [recorder.names.index(joint) for joint in arm.joints]
    states = [(stamp, q[order], u[order]) for stamp, q, u in recorder.states]
    k, ideal = ideal_stop(load_urdf(arm.urdf, joints=list(arm.joints)), states, failed,
                          taken_over)
    actual = np.array([q for _, q, _ in states[k:]])
    return float(np.degrees(np.abs(actual - ideal).max()))


def largest_step(commands, rate):
    """
    Return the largest change of torque between two commands, in units of the rate limit.

    Zeros, which are commanded when states are stale, have no rate limit.
    """
    ordered = sorted(commands, key=lambda each: each.stamp)
    return max(float(np.abs(later.tau - earlier.tau).max())
               / (rate * max((later.stamp - earlier.stamp) * 1e-9, PERIOD))
               for earlier, later in pairwise(ordered)
               if earlier.tau.any() and later.tau.any())


def turns(commands):
    """Return who commanded, in the order of the states, without repetitions."""
    ordered = sorted(commands, key=lambda each: each.stamp)
    return [each.source for k, each in enumerate(ordered)
            if k == 0 or ordered[k - 1].source != each.source]


def trial(rig, number):
    """Let the node fail in motion and return; return reaction, sag, step, commanders."""
    # A stall of the machine while the arm starts is not what is tried.
    for _ in range(10):
        rig.move()
        if rig.moving():
            break
    assert rig.moving(), rig.logs()
    recorder = rig.recorder
    failed = rig.fail(number)
    recorder.spin(HELD)
    # The machine may have stalled the node before, too.
    guard = [command for command in recorder.of('guard') if command.time >= failed]
    assert guard, rig.logs()
    # A message that blocks the main thread arrives after some commands.
    began = max(failed, max(command.stamp for command in recorder.of('node')
                            if command.stamp <= guard[0].stamp))
    reaction = (guard[0].time - failed) * 1e-9
    far = sag(rig, began, guard[0].stamp)
    held = recorder.states[-1][1]
    n = len(recorder.of('node'))
    recorder.spin(0.1)
    drift = float(np.degrees(np.abs(recorder.states[-1][1] - held).max()))
    if number == signal.SIGKILL:
        rig.node.end(signal.SIGKILL)
        rig.start_node()
    elif number == signal.SIGSTOP:
        os.kill(rig.node.pid, signal.SIGCONT)
    recorder.spin_until(lambda: len(recorder.of('node')) > n + 50, 90.0)
    return (reaction, far + drift, largest_step(recorder.commands, rig.arm.rate),
            turns([command for command in recorder.commands
                   if command.time >= failed - PERIOD * 1e9]))


def took_over_in_time(reaction, far, step, voices):
    """Return whether the guard took over in time, and gave back without a step."""
    return (reaction <= REACTION and far <= SAG and step <= 1.01
            and voices[:3] == ['node', 'guard', 'node'])
