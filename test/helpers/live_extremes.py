"""
Set each live parameter of a node to the ends of its range while its arm moves.

Each line on standard output is one case: what the node answered, and how the arm moved
meanwhile. Time is simulated. The argument is the path of a URDF with two joints.
"""

import json
import math
import sys

from kane_dynamics import load_urdf, Motion, Robot
from kane_dynamics.ros.dynamics_node.configured_robot import ConfiguredRobot
from kane_dynamics.ros.dynamics_node.node import DynamicsNode
from kane_dynamics.ros.parameters.parameter_table import SPECS
import numpy as np
import rclpy
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

URDF, = sys.argv[1:]
PERIOD = 2_000_000  # ns
DT = PERIOD * 1e-9
SUBSTEPS = 2
REST, BEFORE, WITH, AFTER = 60, 40, 150, 60  # states
HOME = np.array([0.3, 0.5])
PUSH = np.array([0.3, -0.3])  # rad/s, where no motion is followed
MODES = {'joint_impedance': 'joint_impedance', 'cartesian': 'cartesian_impedance',
         'target': 'cartesian_impedance', 'walls': 'cartesian_impedance',
         'hand_guiding': 'hand_guiding'}
FOLLOW = ('computed_torque', 'joint_impedance')
given = (f'urdf:={URDF}', 'arm_compensates:=none', 'activation:=on_request',
         'torque_path:=python', 'mode:=computed_torque', 'payload.frame:=tip',
         'observer.enabled:=true', 'wrench.frames:=[tip]',
         'modes:=[joint_impedance, cartesian_impedance, hand_guiding]')
clock = [1000 * 10**9]
ConfiguredRobot._now = lambda self: clock[0]
rclpy.init(args=['--ros-args', *[x for one in given for x in ('-p', one)]])
node = DynamicsNode()
node.trigger_configure()
robot = Robot(load_urdf(URDF))
path = node.arm.path
node.trigger_activate()
joints = robot.joint_names
effort = robot.limits.effort
motion = Motion.from_points([0.0, 0.5, 1.0, 2.0],
                            [HOME, HOME + [0.25, -0.25], HOME, HOME + [0.25, -0.25]],
                            joint_names=joints)
sent = [np.zeros(2)]


class Commands:
    """Keeps the last command for the arm."""

    def publish(self, data):
        sent[0] = path.messages.of_all(np.frombuffer(data[-16:]).copy())


path.messages.publishers = Commands(), *path.messages.publishers[1:]


class Arm:
    """The arm, and the largest figures of its motion and of its torques."""

    def __init__(self):
        self.q, self.u = HOME.copy(), np.zeros(2)
        self.free = False
        self.speed = self.rate = self.over = 0.0

    def state(self):
        """Send a state, and move by the command that answers it."""
        clock[0] += PERIOD
        message = JointState(name=list(joints), position=self.q.tolist(),
                             velocity=self.u.tolist())
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(clock[0], 10**9)
        before = sent[0]
        path.check_timeout()
        path.on_state(bytes(serialize_message(message)))
        tau = sent[0]
        rate = np.abs(tau - before) / DT
        self.rate = max(self.rate, float(max(rate / (20.0 * effort))))
        self.over = max(self.over, float(max(np.abs(tau) / effort)))
        if not self.free:
            return
        for _ in range(SUBSTEPS):
            self.u = self.u + DT / SUBSTEPS * robot.forward_dynamics(self.q, self.u, tau)
            self.q = self.q + DT / SUBSTEPS * self.u
        self.speed = max(self.speed, float(max(abs(self.u))))

    def states(self, count):
        """Send states; an arm that is lost moves no further."""
        for _ in range(count):
            self.state()
            if not np.isfinite(self.u).all() or self.speed > 50.0:
                return


def run(name, mode, value):
    """Return the figures of one case."""
    if path.running:
        path.stop()
    assert node.set_parameters_atomically([Parameter('mode', value=mode)]).successful
    path.start()
    sent[0] = np.zeros(2)
    arm = Arm()
    arm.states(REST)
    arm.rate = 0.0
    arm.free = True
    active = path.active_motion
    if mode in FOLLOW:
        assert active.follow(motion, clock[0], clock[0], active.generation)
    else:
        arm.u = PUSH.copy()
    arm.states(BEFORE)
    old = node.get_parameter(name) if name else None
    reason = back = ''
    if name:
        result = node.set_parameters_atomically([Parameter(name, value=value)])
        reason = result.reason or ('refused' * (not result.successful))
    if not reason:
        arm.states(WITH)
        if name:
            result = node.set_parameters_atomically([old])
            back = result.reason
            arm.states(AFTER)
            if back:
                path.stop()
                assert node.set_parameters_atomically([old]).successful
        else:
            arm.states(AFTER)
    return {'name': name, 'mode': mode, 'value': repr(value), 'reason': reason,
            'back': back, 'speed': arm.speed, 'rate': arm.rate, 'over': arm.over,
            'fault': path.fault or path.failure, 'commanding': bool(path.commanding)}


def values_of(spec):
    """Return the ends of the range of a parameter, and values next to zero."""
    if spec.kind == 'flag':
        return [True, False]
    if spec.kind == 'text':
        return [] if spec.name == 'mode' else list(spec.choices)
    if spec.kind == 'count':
        return [int(spec.low), int(min(spec.high, 2**62))]
    if spec.kind in ('names', 'floats'):
        return []
    low = spec.low
    high = spec.high
    numbers = {1e-300, -1e300 if low == -math.inf else low,
               1e300 if high == math.inf else high}
    if low < 0.0:
        numbers.add(-1e-300)
    if spec.infinite:
        numbers.add(math.inf)
    numbers = sorted(numbers)
    size = {'vector': 3, 'six': 6}.get(spec.kind)
    return [[x] * size for x in numbers] if size else numbers


modes = ['computed_torque', 'joint_impedance', 'cartesian_impedance', 'hand_guiding']
for mode in modes:
    print(json.dumps(run('', mode, None)), flush=True)
for spec in SPECS:
    if not spec.live:
        continue
    mode = MODES.get(spec.name.split('.')[0], 'computed_torque')
    for value in values_of(spec):
        print(json.dumps(run(spec.name, mode, value)), flush=True)
node.halt()
rclpy.shutdown()
