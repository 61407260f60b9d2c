"""Control of elastic joints: feedforward, passive, linearizing, torque feedback."""

from functools import cache

from kane_dynamics import (Coupling, Drive, InputError, JointTorqueFeedback,
                           LinkSideControl, load_urdf, ModelWarning, Motion,
                           MotorSideControl, Robot, simulate, SmoothMotion,
                           StiffnessCurve, with_drives)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.control.elastic_control import derivatives_of
import numpy as np
import pytest

TWO_LINK = resource_path('urdf', 'two_link.urdf')
RIGID = load_urdf(TWO_LINK)
NAMES = RIGID.joint_names
START = np.array([0.3, -0.8])
MOVE = np.array([0.5, 0.7])
DURATION = 0.5
# From rest to rest with four continuous derivatives, s from 0 to 1.
SHAPE = np.polynomial.Polynomial([0, 0, 0, 0, 0, 126, -420, 540, -315, 70])


def elastic(names=NAMES, **options):
    """Return a planar arm with elastic drives at joints."""
    options = {'stiffness': 300.0, 'rotor_inertia': 0.05} | options
    return with_drives(RIGID, {name: Drive(**options) for name in names})


@cache
def motion():
    """Return a smooth motion of the links."""
    t = np.linspace(0.0, DURATION, 201)
    s = t / DURATION
    q = START + np.outer(SHAPE(s), MOVE)
    u = np.outer(SHAPE.deriv(1)(s) / DURATION, MOVE)
    udot = np.outer(SHAPE.deriv(2)(s) / DURATION**2, MOVE)
    return Motion.from_points(t, q, u, udot, joint_names=NAMES)


def state_at(control, t=0.0):
    """Return q and u of links and motors on the motion at a time."""
    q, u, _ = motion().sample(t)
    command = control.command([t])
    return np.concatenate([q, command.positions[0]]), np.concatenate(
        [u, command.velocities[0]])


@pytest.mark.parametrize('kind', [Motion, SmoothMotion])
def test_a_motion_in_degrees_is_warned_of(kind):
    turned = SmoothMotion.from_points([0.0, 1.0, 2.0],
                                      [[0.0, 0.0], [90.0, 20.0], [0.0, 0.0]],
                                      joint_names=NAMES)
    if kind is Motion:
        t = np.linspace(0.0, 2.0, 201)
        turned = Motion.from_points(t, *turned.sample(t)[:3], joint_names=NAMES)
    with pytest.warns(ModelWarning,
                      match='motion: far outside: joint1 90 rad .* degrees'):
        MotorSideControl(Robot(elastic()), turned, kp=100.0, kd=10.0)


@pytest.mark.parametrize('options', [
    {}, pytest.param({'damping': 0.05, 'friction': {'damping': 0.3}},
                     marks=pytest.mark.slow),
    pytest.param({'stiffness': StiffnessCurve([0.02, 0.05], [4.0, 20.0])},
                 marks=pytest.mark.slow)], ids=['spring', 'damped', 'curve'])
def test_the_torques_of_the_feedforward_alone_move_the_links_along_the_motion(options):
    robot = Robot(elastic(**options))
    control = MotorSideControl(robot, motion(), kp=0.0, kd=0.0)
    step = 1e-4
    middles = step * (np.arange(round(DURATION / step)) + 0.5)
    tau = np.zeros((len(middles), 4))
    tau[:, 2:] = control.command(middles).torques
    run = simulate(robot, *state_at(control), DURATION, step=step, torque=tau)
    moved = run.q[:, :2] - motion().sample(run.t)[0]
    # With damping the acceleration of the motor lacks D / k times a third derivative.
    assert np.abs(moved).max() < (5e-5 if 'damping' in options else 5e-6)
    np.testing.assert_allclose(run.q[:, 2:], control.command(run.t).positions,
                               atol=5e-5)


def test_a_rigid_joint_beside_an_elastic_one_has_the_torque_of_its_own():
    robot = Robot(elastic(NAMES[1:]))
    control = MotorSideControl(robot, motion(), kp=0.0, kd=0.0)
    times = np.linspace(0.05, 0.45, 5)
    command = control.command(times)
    q, u, udot = motion().sample(times)
    rigid = Robot(RIGID).inverse_dynamics(q, u, udot)
    np.testing.assert_allclose(command.gear_torques, rigid, rtol=1e-12)
    np.testing.assert_allclose(command.torques[:, 0], rigid[:, 0], rtol=1e-12)
    np.testing.assert_allclose(command.positions[:, 0], q[:, 0], rtol=1e-12)


def test_the_motor_side_law_keeps_a_simulated_arm_on_the_motion_and_damps_its_errors():
    robot = Robot(elastic(damping=0.3))
    control = MotorSideControl(robot, motion(), kp=300.0, kd=10.0)
    q0, u0 = state_at(control)
    run = simulate(robot, q0, u0, 1.5, step=1e-3, torque=control)
    np.testing.assert_allclose(run.q[:, :2], motion().sample(run.t)[0], atol=2e-3)
    pushed = simulate(robot, q0 + 0.02, u0, 1.5, step=1e-3, torque=control)
    assert np.abs(pushed.q[-1] - run.q[-1]).max() < 0.25 * 0.02


@pytest.mark.slow
def test_the_motor_side_law_feeds_no_energy_into_an_arm_at_a_resting_target():
    robot = Robot(elastic(), friction=False)
    resting = Motion.from_points([0.0], [START], joint_names=NAMES)
    kp = 40.0
    kd = 3.0
    control = MotorSideControl(robot, resting, kp=kp, kd=kd)
    target = control.command([0.0])
    theta = target.positions[0]
    torque = target.torques[0]
    q0 = np.concatenate([START + [0.2, -0.3], theta + 0.1])
    run = simulate(robot, q0, [1.0, -1.0, 0.5, 2.0], 0.2, step=1e-4, torque=control)
    # Of the arm, of the PD's spring, less the work of the constant feedforward.
    error = run.q[:, 2:] - theta
    stored = run.energy.sum(axis=1) + 0.5 * kp * (error**2).sum(axis=1) - error @ torque
    assert np.diff(stored).max() < 1e-4 * np.ptp(stored)
    assert stored[-1] < stored[0] - 1.0


def test_link_side_control_gives_the_links_the_fourth_derivative_that_it_wants():
    robot = Robot(elastic(), friction=False)
    w = 20.0
    control = LinkSideControl(robot, motion(), bandwidth=w)
    rng = np.random.default_rng(0)
    q = np.concatenate([START, START]) + 0.02 * rng.normal(size=4)
    u = 0.3 * rng.normal(size=4)
    t = 0.2
    tau = control(t, q, u)
    # Derivatives of the links' acceleration along the motion under this torque.
    h = 2e-4
    backward = simulate(robot, q, -u, h, step=h / 20.0, sample=h, torque=tau)
    forward = simulate(robot, q, u, h, step=h / 20.0, sample=h, torque=tau)
    back = backward.udot[-1, :2]
    present = forward.udot[0, :2]
    ahead = forward.udot[-1, :2]
    jerk = (ahead - back) / (2.0 * h)
    snap = (ahead - 2.0 * present + back) / h**2
    desired = derivatives_of(motion(), np.array([t]))[0]
    commanded = desired[4] + (
        w**4 * (desired[0] - q[:2]) + 4.0 * w**3 * (desired[1] - u[:2])
        + 6.0 * w**2 * (desired[2] - present) + 4.0 * w * (desired[3] - jerk))
    np.testing.assert_allclose(snap, commanded,
                               rtol=2e-3, atol=2e-3 * np.abs(commanded).max())


@pytest.mark.slow
def test_errors_of_link_side_control_decay_with_four_equal_poles():
    robot = Robot(elastic(), friction=False)
    w = 20.0
    e0 = 0.01
    resting = Motion.from_points([0.0], [START], joint_names=NAMES)
    control = LinkSideControl(robot, resting, bandwidth=w)
    # The links begin beside the target, with the deflection that holds them there.
    q = START - e0
    beside = Motion.from_points([0.0], [q], joint_names=NAMES)
    theta = MotorSideControl(robot, beside, kp=0.0, kd=0.0).command([0.0]).positions[0]
    run = simulate(robot, np.concatenate([q, theta]), np.zeros(4), 0.3, step=1e-4,
                   torque=control, sample=0.01)
    x = w * run.t
    expected = e0 * np.exp(-x) * (1.0 + x + x**2 / 2.0 + x**3 / 6.0)
    np.testing.assert_allclose(START - run.q[:, :2], np.tile(expected, (2, 1)).T,
                               atol=0.01 * e0)


def test_a_smooth_motion_has_the_command_of_the_motion_through_its_points():
    robot = Robot(elastic())
    smooth = SmoothMotion.from_points(motion().times[::10], motion().positions[::10],
                                      joint_names=NAMES)
    times = np.linspace(0.1, 0.4, 7)
    expected = MotorSideControl(robot, motion(), kp=0.0, kd=0.0).command(times)
    command = MotorSideControl(robot, smooth, kp=0.0, kd=0.0).command(times)
    np.testing.assert_allclose(command.positions, expected.positions, atol=1e-4)
    np.testing.assert_allclose(command.torques, expected.torques, rtol=1e-2)


def test_torque_feedback_gives_the_motors_the_stated_inertia():
    model = elastic(damping=0.4)
    robot = Robot(model)
    feedback = JointTorqueFeedback(robot, inertia=[0.01, 0.2])
    inertias = dict(zip(NAMES, [0.01, 0.2]))
    shaped = Robot(with_drives(RIGID, {name: Drive(300.0, 0.4, rotor_inertia=value)
                                       for name, value in inertias.items()}))
    rng = np.random.default_rng(1)
    q, u = rng.normal(size=(2, 4))
    torque = rng.normal(size=2)
    udot = robot.forward_dynamics(q, u, feedback.torque(q, u, torque))
    expected = shaped.forward_dynamics(q, u, [0.0, 0.0, *torque])
    np.testing.assert_allclose(udot, expected, rtol=1e-12)


def test_a_trajectory_of_the_motors_has_their_positions_and_efforts():
    robot = Robot(elastic())
    control = MotorSideControl(robot, motion(), kp=0.0, kd=0.0)
    filled = control.trajectory(0.05)
    assert filled.joint_names == NAMES
    assert filled.effort_error.max() <= 0.05
    between = np.linspace(0.0, DURATION, 997)[1:-1]
    command = control.command(between)
    efforts = np.stack([np.interp(between, filled.times, column)
                        for column in filled.efforts.T], axis=1)
    assert np.abs(efforts - command.torques).max() < 0.06
    np.testing.assert_allclose(filled.motion.sample(between)[0], command.positions,
                               atol=1e-5)
    # The motors lead the links by the deflection under gravity.
    sag = filled.positions[0] - START
    np.testing.assert_allclose(300.0 * sag, Robot(RIGID).gravity_force(START), rtol=1e-9)


def test_a_trajectory_for_encoders_at_links_has_their_positions_and_equal_efforts():
    control = MotorSideControl(Robot(elastic()), motion(), kp=0.0, kd=0.0)
    of_motors = control.trajectory(0.05)
    of_links = control.trajectory(0.05, sensor_side='link')
    q, u, udot = motion().sample(of_links.times)
    np.testing.assert_array_equal(of_links.efforts, of_motors.efforts)
    np.testing.assert_allclose(of_links.positions, q, rtol=1e-12)
    np.testing.assert_allclose(of_links.velocities, u, atol=1e-12)
    np.testing.assert_allclose(of_links.accelerations, udot, atol=1e-12)


ENDS = [START, START + MOVE]
AT_REST = np.zeros((2, 2))


@pytest.mark.parametrize(('points', 'what'), [
    (([0.0, 0.5, 1.0], [*ENDS, START]), 'acceleration'),
    (([0.0, 1.0], ENDS, AT_REST), 'acceleration'),
    (([0.0, 1.0], ENDS, AT_REST, AT_REST), 'jerk'),
    (([0.0, 1.0], ENDS, [[0.0, 0.0], [0.3, 0.0]], AT_REST), 'speed')],
    ids=['spline', 'cubic', 'quintic', 'moving end'])
def test_motions_whose_torque_rate_jumps_are_refused(points, what):
    jumping = Motion.from_points(*points, joint_names=NAMES)
    for law, options in ((MotorSideControl, {'kp': 1.0, 'kd': 1.0}),
                         (LinkSideControl, {})):
        with pytest.raises(InputError, match=f'motion: the {what} of joint .* jumps'):
            law(Robot(elastic()), jumping, **options)


@pytest.mark.parametrize(('make', 'text'), [
    (lambda: MotorSideControl(Robot(RIGID), motion(), kp=1.0, kd=1.0), 'rigid joints'),
    (lambda: LinkSideControl(Robot(elastic(NAMES[1:])), motion()),
     'a drive at every joint'),
    (lambda: LinkSideControl(Robot(elastic(
        stiffness=StiffnessCurve([0.01, 0.02], [0.0, 5.0]))), motion()),
     'a dead zone of 0.01'),
    (lambda: MotorSideControl(Robot(elastic(full_coupling=True, rotor_inertia=1e-4)),
                              motion(), kp=1.0, kd=1.0), 'full_coupling'),
    (lambda: MotorSideControl(Robot(elastic()), 3, kp=1.0, kd=1.0), 'motion: '),
    (lambda: MotorSideControl(Robot(elastic()), motion(), kp=-1.0, kd=1.0), 'kp'),
    (lambda: JointTorqueFeedback(Robot(elastic()), inertia=0.0), 'inertia: 0'),
    (lambda: LinkSideControl(Robot(elastic()), motion(), bandwidth=np.nan), 'bandwidth'),
    (lambda: MotorSideControl(Robot(elastic(), constraints=[
        Coupling(NAMES[0], {NAMES[1]: 1.0})]), motion(), kp=1.0, kd=1.0), 'constraints'),
    (lambda: MotorSideControl(Robot(elastic()), motion(),
                              kp=1.0, kd=1.0).trajectory(0.0), 'tolerance'),
    (lambda: MotorSideControl(Robot(elastic()), motion(), kp=1.0, kd=1.0).trajectory(
        0.1, sensor_side='gear'), "sensor_side: 'gear'; expected 'motor' or 'link'"),
    (lambda: MotorSideControl(Robot(elastic()), motion(),
                              kp=1.0, kd=1.0).command([np.nan]), 'times'),
    (lambda: MotorSideControl(Robot(elastic()), motion(), kp=1.0, kd=1.0).command(0.1),
     'times')])
def test_invalid_arguments_are_named(make, text):
    with pytest.raises(InputError, match=text):
        make()
