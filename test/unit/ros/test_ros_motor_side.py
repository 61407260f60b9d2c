"""Mode motor_side of the node: the law of `MotorSideControl`, by parameters."""

from functools import partial

import pytest

pytest.importorskip('rclpy')
from kane_dynamics import (  # noqa: E402, I100
    Drive, Inertial, InputError, Motion, MotorSideControl)
from kane_dynamics import Robot, SmoothMotion, StiffnessCurve, with_drives  # noqa: E402
from kane_dynamics import with_rigid_joints  # noqa: E402
from kane_dynamics.control.controller import Controller  # noqa: E402
from kane_dynamics.control.terms import Mode  # noqa: E402
from kane_dynamics.ros.common.node_statistics import Statistics  # noqa: E402
from kane_dynamics.ros.inputs.trajectory_input import follow_trajectory  # noqa: E402
from kane_dynamics.ros.modes.motor_side_mode import MotorSideMode  # noqa: E402
from kane_dynamics.ros.modes.task_modes import TaskModes  # noqa: E402
from kane_dynamics.ros.services.motion_check import refuse_impossible  # noqa: E402
from kane_dynamics.ros.torque_path.path_controller import path_controller  # noqa: E402
from kane_dynamics.ros.torque_path.torque_path import TorquePath  # noqa: E402
from node_process import model as rigid_model  # noqa: E402
from node_values import node_values, served_robot, UNCHECKED  # noqa: E402
import numpy as np  # noqa: E402
from numpy.testing import assert_allclose  # noqa: E402
from rclpy.serialization import serialize_message  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint  # noqa: E402

JOINTS = ('turn', 'lift', 'reach')
KP = np.array([300.0, 200.0, 2000.0])
KD = np.array([20.0, 15.0, 90.0])
GAINS = {'drives.kp': KP.tolist(), 'drives.kd': KD.tolist()}
DRIVES = {'turn': Drive(9e3, rotor_inertia=0.5, motor_effort=30.0),
          'lift': Drive(8e3, 0.5, rotor_inertia=0.4, friction={'damping': 2.0})}


def elastic(drives=DRIVES):
    return with_drives(rigid_model(), drives)


def law(changes=GAINS, model=None, payload_frame=None):
    model = model or elastic()
    robot = Robot(with_rigid_joints(model), payload_frame=payload_frame)
    return MotorSideMode(robot, node_values({'mode': 'motor_side', **changes}),
                         model), robot


def motion():
    smooth = SmoothMotion.from_points([0.0, 1.0], [[0.0, 0.0, 0.0], [0.4, -0.3, 0.1]],
                                      joint_names=JOINTS)
    t = np.linspace(0.0, 1.0, 21)
    return Motion.from_points(t, *smooth.sample(t)[:3], joint_names=JOINTS)


class Rig:
    """A torque path in a mode, at rest at zero, with a manual clock."""

    def __init__(self, mode):
        self.time = 100 * 10**9
        mode_law, robot = law()
        self.values = node_values(UNCHECKED)
        self.judge = partial(refuse_impossible, served_robot(robot, UNCHECKED))
        controller = Controller(robot, laws={Mode.MOTOR_SIDE: mode_law}, mode=mode)
        self.path = TorquePath(controller, Ignored(), Ignored(), lambda: self.time,
                               self.values, Statistics(), lambda *words: None)
        self.path.start()
        self.state()

    def state(self):
        """Pass a state to the path."""
        message = JointState(name=list(JOINTS), position=[0.0] * 3, velocity=[0.0] * 3)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(self.time, 10**9)
        self.path.on_state(serialize_message(message))

    def follow(self, t, points, stamp=0.0):
        """Send a trajectory, (K, 3, 3) or less, that begins after a time, s; 0: now."""
        message = JointTrajectory(joint_names=list(JOINTS))
        if stamp:
            begin = self.time + round(stamp * 1e9)
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(begin, 10**9)
        for time, point in zip(t, points, strict=True):
            point = dict(
                zip(('positions', 'velocities', 'accelerations'), map(list, point)))
            message.points.append(JointTrajectoryPoint(**point))
            stamp_of = message.points[-1].time_from_start
            stamp_of.sec, stamp_of.nanosec = divmod(round(time * 1e9), 10**9)
        follow_trajectory(self.path, serialize_message(message), 0, self.values,
                          self.judge)


class Ignored:
    """A publisher of nothing."""

    def publish(self, message):
        """Publish nothing."""


MOVE = SmoothMotion.from_points([0.0, 1.0], [[0.0, 0.0, 0.0], [0.4, -0.3, 0.1]],
                                joint_names=JOINTS)
DENSE = np.linspace(0.0, 1.0, 51)
ENDS = np.array([[0.0, 0.0, 0.0], [0.4, -0.3, 0.1]])
REST = np.zeros((2, 3))


def rows(times):
    """Return position, speed and acceleration of the smooth motion, (K, 3, 3)."""
    return np.stack(MOVE.sample(times)[:3], axis=1)


@pytest.mark.parametrize(('points', 'what'), [
    ((ENDS,), 'acceleration'), ((ENDS, REST), 'acceleration'),
    ((ENDS, REST, REST), 'jerk')], ids=['positions', 'cubic', 'quintic'])
def test_motions_whose_torque_rate_jumps_are_refused_in_this_mode_only(points, what):
    message = [0.0, 1.0], np.stack(points, axis=1)
    with pytest.raises(InputError, match=rf'motion: the {what} of joint .* jumps'):
        Rig('motor_side').follow(*message)
    Rig('computed_torque').follow(*message)


def test_a_motion_is_compared_with_the_one_that_it_replaces():
    rig = Rig('motor_side')
    rig.follow(DENSE, rows(DENSE))
    # The rest of the same motion, half a second later, goes on with its derivatives.
    later_points = DENSE[25:]
    rig.follow(later_points - later_points[0], rows(later_points), stamp=later_points[0])
    with pytest.raises(InputError, match=r'velocity .* where the motion sets out'):
        rig.follow(DENSE, rows(DENSE), stamp=later_points[0] + 0.2)
    # A point of its own would stop the arm at once; after the motion it rests there.
    hold = np.stack([MOVE.sample(0.7)[0], REST[0], REST[0]])
    with pytest.raises(InputError, match=r'velocity .* where the motion sets out'):
        rig.follow([0.0], [hold], stamp=0.7)
    rig.follow([0.0], [[ENDS[1], REST[0], REST[0]]], stamp=DENSE[-1])
    # Of a motion that has begun already, what is past does not count.
    other_rig = Rig('motor_side')
    with pytest.raises(InputError, match=r'where the motion sets out \(0\.3 s\)'):
        other_rig.follow(DENSE, rows(DENSE), stamp=-0.3)


@pytest.mark.parametrize('lead', [0.0, 0.01])
def test_the_torques_are_those_of_motor_side_control(lead):
    mode, _ = law(GAINS | {'drives.lead': lead})
    robot = Robot(elastic())
    control = MotorSideControl(robot, motion(), kp=KP, kd=KD)
    motors = control.arm.motors
    state = np.random.default_rng(1).normal(size=(2, robot.n))
    torques = mode.torque(state[0, motors], state[1, motors], motion(), 0.4, 0.4)
    expected = control(0.4, *state)[motors]
    expected += control.command([0.4 + lead]).torques[0] - control.command(
        [0.4]).torques[0]
    assert_allclose(torques, expected, rtol=1e-12)


@pytest.mark.parametrize('side', ['motor', 'link'])
def test_the_first_pose_is_held_in_equilibrium(side):
    mode, _ = law(GAINS | {'drives.sensor_side': side})
    robot = Robot(elastic())
    links = np.array([0.3, -0.7, 0.1])
    gravity = robot.inverse_dynamics(np.append(links, links[:2]), *np.zeros((2, 5)))
    motors = links + np.array([gravity[0] / 9e3, gravity[1] / 8e3, 0.0])
    measured = motors if side == 'motor' else links
    torques = mode.torque(measured, np.zeros(3), None, 0.0, 0.0)
    assert_allclose(torques, gravity[:3], rtol=0, atol=1e-4 * np.abs(gravity).max())
    assert_allclose(mode.pose, links, atol=1e-6)


def test_gravity_and_payload_of_the_torque_path_count():
    mode, robot = law(payload_frame='c')
    q = np.array([0.3, -0.7, 0.1])
    u = np.zeros(3)
    bare = mode.torque(q, u, None, 0.0, 0.0)
    robot.parameters.payload = Inertial(2.0, np.zeros(3), np.zeros((3, 3)))
    mode.restart()  # the deflection is another one
    loaded = mode.torque(q, u, None, 0.0, 0.0)
    assert loaded[1] - bare[1] == pytest.approx(
        robot.gravity_force(q)[1] - Robot(robot.model).gravity_force(q)[1], rel=1e-2)
    robot.parameters.gravity = (0.0, 0.0, 0.0)
    assert_allclose(mode.torque(q, u, motion(), -1.0, 0.0), KP * -q, rtol=1e-9)


def test_default_gains_are_shares_of_the_stiffness_and_critical_damping():
    mode, _ = law({'drives.kp': [], 'drives.kd': []},
                  elastic(DRIVES | {'reach': Drive(1e5, rotor_inertia=4.0)}))
    kp, kd = mode._gains
    assert_allclose(kp, [360.0, 320.0, 4000.0])
    assert_allclose(kd, 2.0 * np.sqrt(kp * [0.5, 0.4, 4.0]))


def test_commands_are_limited_by_the_motors():
    controller = path_controller(elastic(), node_values({'mode': 'computed_torque'}))
    assert controller.robot.joint_names == JOINTS
    assert_allclose(controller.robot.limits.effort, [30.0, 60.0, 90.0])


def test_other_modes_take_the_joints_for_rigid():
    controller = path_controller(elastic(), node_values({'mode': 'inverse_dynamics'}))
    expected = Robot(with_rigid_joints(elastic())).mass_matrix(np.zeros(3))
    assert_allclose(controller.robot.mass_matrix(np.zeros(3)), expected)


@pytest.mark.parametrize(('call', 'words'), [
    (lambda: TaskModes(Robot(rigid_model()), node_values({'mode': 'motor_side'})),
     'mode motor_side: an arm without drives'),
    (lambda: law({}), "'drives.kp': empty, and joint 'reach' has no drive"),
    (lambda: law(GAINS | {'drives.kp': [1.0, 2.0]}), "'drives.kp': 2 entries"),
    (lambda: law(model=elastic({'turn': Drive(StiffnessCurve([1e-3, 1e-2], [0.0, 9.0]),
                                              rotor_inertia=0.5)})),
     'a dead zone of 0.001'),
])
def test_arms_and_parameters_that_do_not_fit_are_refused(call, words):
    with pytest.raises(InputError, match=words):
        call()


def test_arms_that_compensate_terms_are_refused():
    values = node_values({'mode': 'motor_side', **GAINS}) | {
        'arm_compensates': ('gravity',)}
    model = elastic()
    with pytest.raises(InputError, match=r'arm_compensates.*expected none'):
        MotorSideMode(Robot(with_rigid_joints(model)), values, model)
    assert Mode.MOTOR_SIDE.follows_motions
    assert Mode.MOTOR_SIDE.is_stiff
