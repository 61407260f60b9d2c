"""PD of motors around a computed motion: feedforward, loops, damping, rigid."""

from kane_dynamics import (Closure, Drive, ElasticFeedforward, InputError, load_urdf,
                           ModelBuilder, MotorSideControl, MotorTracking, Robot, rod,
                           simulate, SmoothMotion, with_drives)
from kane_dynamics._util.resources import resource_path
import numpy as np
import pytest

JOINTS = 'joint1', 'joint2'
RIGID = load_urdf(resource_path('urdf', 'two_link.urdf'), supplement={
    'joints': {name: {'armature': 0.1} for name in JOINTS}})
MOVE = SmoothMotion.from_points([0.0, 0.6], [[0.1, -0.2], [0.9, 0.5]],
                                joint_names=JOINTS)
TURN = SmoothMotion.from_points([0.0, 0.6], [[0.5], [2.0]], joint_names=['crank'])
STEP = 1e-3


def arm(damping=0.0, joints=JOINTS):
    """Return the two-link arm with elastic joints."""
    return Robot(with_drives(RIGID, {name: Drive(2000.0, damping) for name in joints}))


def four_bar(actuated=None, **options):
    """Return a four-bar with an elastic crank, and a motor at the coupler on request."""
    b = ModelBuilder('four-bar')
    b.body('crank', axis=(0, -1, 0), inertial=rod(0.6, (0, 0, 0), (0.3, 0, 0)),
           drive=Drive(900.0, rotor_inertia=0.2))
    b.body('coupler', 'crank', axis=(0, -1, 0), at=(0.3, 0, 0),
           inertial=rod(1.8, (0, 0, 0), (0.9, 0, 0)))
    b.body('rocker', 'coupler', axis=(0, -1, 0), at=(0.9, 0, 0),
           inertial=rod(1.4, (0, 0, 0), (0.7, 0, 0)))
    b.frame('end', 'rocker', at=(0.7, 0, 0))
    b.frame('ground', 'world', at=(1.0, 0, 0))
    robot = Robot(b.model(),
                  constraints=[Closure('end', 'ground', 'revolute', axis=(0, 1, 0))],
                  **options)
    return ElasticFeedforward(robot, actuated=actuated)


def start(control):
    """Return the state in which the motion begins."""
    robot = control.robot
    command = control.command
    links = []
    for name in RIGID.joint_names:
        if name in robot.coordinate_names:
            links.append(robot.coordinate_names.index(name))
    q = np.zeros(robot.n_q)
    if links:
        q[links] = command.link_position[0]
    else:
        q[:3] = command.link_position[0]
    for elastic in robot.drives:
        q[elastic.motor] = command.motor_position[0, elastic.link]
    return q


def largest_error(control, motion, joint=0, torque=None):
    """Return a link's largest error in a simulation with torques held for a step."""
    robot = control.robot
    run = simulate(robot, start(control), np.zeros(robot.n), 0.8, step=STEP,
                   torque=torque or control)
    expected = motion.sample(np.minimum(run.t, motion.duration))[0]
    return np.abs(run.q[:, joint] - expected[:, joint]).max()


def test_torques_are_those_of_the_law_of_trees():
    robot = arm()
    control = MotorTracking(ElasticFeedforward(robot), MOVE, kp=300.0, kd=[10.0, 5.0])
    law = MotorSideControl(robot, MOVE, kp=300.0, kd=[10.0, 5.0])
    rng = np.random.default_rng(0)
    assert control.joint_names == JOINTS
    for t in (0.0, 0.1234, 0.3, 0.6, 2.0):
        q, u = rng.uniform(-0.5, 0.5, (2, robot.n))
        expected = law(min(t, 0.6 - 1e-9), q, u)
        np.testing.assert_allclose(control(t, q, u), expected,
                                   atol=2e-4 * np.abs(expected).max())


def test_damped_drives_follow_their_exact_motion():
    robot = arm(damping=40.0)
    control = MotorTracking(ElasticFeedforward(robot), MOVE, kp=100.0, kd=3.0,
                            lead=0.5 * STEP)
    first_order = MotorSideControl(robot, MOVE, kp=100.0, kd=3.0)
    exact = largest_error(control, MOVE)
    assert exact < 1e-4
    assert exact < 0.1 * largest_error(control, MOVE, torque=first_order)


def test_rigid_joints_beside_elastic_ones_are_controlled():
    robot = arm(joints=['joint1'])
    control = MotorTracking(ElasticFeedforward(robot), MOVE, kp=200.0, kd=10.0,
                            lead=0.5 * STEP)
    assert control.joint_names == JOINTS
    assert largest_error(control, MOVE) < 1e-4
    assert largest_error(control, MOVE, joint=1) < 1e-4


@pytest.mark.parametrize('options', [
    {}, {'independent': ('rocker', 'crank_motor')}, {'actuated': ('crank', 'rocker')}])
def test_the_motor_of_a_loop_moves_its_crank(options):
    # Without actuators beside the drive, with other speeds, and with a motor at the
    # rocker.
    feedforward = four_bar(**options)
    control = MotorTracking(feedforward, TURN, kp=200.0, kd=10.0, lead=0.5 * STEP)
    assert control.joint_names == options.get('actuated', ('crank',))
    assert largest_error(control, TURN) < 2e-5


@pytest.mark.parametrize(('control', 'motion'), [
    (lambda: MotorTracking(ElasticFeedforward(arm(damping=5.0)), MOVE, kp=1.0, kd=1.0),
     MOVE),
    (lambda: MotorTracking(four_bar(), TURN, kp=1.0, kd=1.0), TURN)],
                         ids=['damped', 'loop'])
def test_a_trajectory_follows_the_motion_of_the_motors_within_the_tolerance(
        control, motion):
    control = control()
    rows = control.command
    driven = len(control.joint_names)
    filled = control.trajectory(0.1)
    assert filled.joint_names == control.joint_names
    assert len(filled.times) < len(rows.time) / 3
    assert filled.inserted > 0
    assert filled.effort_error.max() <= 0.1
    for k in range(driven):
        efforts = np.interp(rows.time, filled.times, filled.efforts[:, k])
        assert np.abs(efforts - rows.motor_torque[:, k]).max() <= 0.1
    moved = filled.motion.sample(rows.time)[0]
    # Between its points the motors differ by less than that torque deflects the springs.
    np.testing.assert_allclose(moved, rows.motor_position[:, :driven], rtol=0,
                               atol=0.1 / 2000.0)
    # It ends with the motion, at rest, and of the links it is the motion itself.
    np.testing.assert_allclose(filled.velocities[-1], 0.0, atol=1e-9)
    of_links = control.trajectory(0.1, sensor_side='link')
    np.testing.assert_array_equal(of_links.efforts, filled.efforts)
    for actual, expected in zip((of_links.positions, of_links.velocities,
                                 of_links.accelerations), motion.sample(of_links.times)):
        np.testing.assert_allclose(actual, expected,
                                   atol=1e-9 * (1.0 + np.abs(expected).max()))


def test_arguments_are_checked():
    feedforward = four_bar()
    turn = TURN
    with pytest.raises(InputError, match='feedforward'):
        MotorTracking(feedforward.robot, turn, kp=1.0, kd=1.0)
    with pytest.raises(InputError, match='kp'):
        MotorTracking(feedforward, turn, kp=[1.0, 2.0], kd=1.0)
    with pytest.raises(InputError, match='lead'):
        MotorTracking(feedforward, turn, kp=1.0, kd=1.0, lead=-1.0)
    with pytest.raises(InputError, match='step'):
        MotorTracking(feedforward, turn, kp=1.0, kd=1.0, step=0.0)
    for step in (1e-300, 1e-320):  # also where the number of rows is no finite number
        with pytest.raises(InputError, match=f'step: {step:g} .* 10000000 rows'):
            MotorTracking(feedforward, turn, kp=1.0, kd=1.0, step=step)
    with pytest.raises(InputError, match='motion'):
        MotorTracking(feedforward, MOVE, kp=1.0, kd=1.0)
    control = MotorTracking(feedforward, turn, kp=1.0, kd=1.0)
    at_rest = np.zeros(control.robot.n)
    count = len(control.trajectory(0.1).times)
    assert len(control.trajectory(0.1, max_points=count).times) == count
    with pytest.raises(InputError, match=f'needs more than {count - 1} points'):
        control.trajectory(0.1, max_points=count - 1)
    with pytest.raises(InputError, match='max_points: 0'):
        control.trajectory(0.1, max_points=0)
    with pytest.raises(InputError, match=r'q: .*crank_motor'):
        control(0.1, control.command.link_position[0, :1], at_rest)
    with pytest.raises(InputError, match='t: nan'):
        control(np.nan, np.zeros(control.robot.n_q), at_rest)
