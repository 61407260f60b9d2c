"""The friction of commands at rest and at reversals is that of the stated choice."""

from dataclasses import replace
import math

from kane_dynamics import (CartesianImpedance, ComputedTorque, Controller,
                           controller_kernels, Drive, fill_trajectory, InputError,
                           JointImpedance, Mode, ModelBuilder, Motion, Robot, rod,
                           simulate, Terms, with_drives)
from kane_dynamics.control.elastic_feedforward import ElasticFeedforward
from kane_dynamics.control.traced_laws import Desired, mode_torque
from kane_dynamics.mechanics.friction import FEEDFORWARD
from kane_dynamics.model.elastic_model import link_side
from kane_dynamics.robot.feedforward_friction import feedforward_change
from kinds_of_mechanism import case, KINDS
import numpy as np
from numpy.testing import assert_allclose
import pytest

LAW = {'damping': 0.5, 'friction': 6.0, 'friction_backward': 5.0,
       'breakaway_friction': 8.0,
       'stribeck_speed': 0.05, 'friction_offset': 0.3, 'friction_speed': 0.02}
CHOICES = (*FEEDFORWARD, 0.08)
NO_GAINS = np.zeros(4)


def arm(choice, **law):
    """Return an arm of two links whose joints have every term of friction."""
    b = ModelBuilder('arm')
    properties = {'axis': (0, -1, 0), 'armature': 0.4, **LAW, **law}
    b.body('upper', inertial=rod(4.0, (0, 0, 0), (0.5, 0, 0)), **properties)
    b.body('fore', 'upper', at=(0.5, 0, 0), inertial=rod(2.0, (0, 0, 0), (0.4, 0, 0)),
           **properties)
    return Robot(b.model(), feedforward_friction=choice)


def direction(width, rate, acceleration, choice):
    """Return the direction of friction by the definition on the page on friction."""
    if choice == 'desired_speed':
        return math.tanh(rate / width)
    if choice == 'none':
        share = min(max(abs(rate) / width - 1.0, 0.0), 1.0)
        return share * math.tanh(rate / width)
    lead = width if choice == 'ahead' else choice  # s, for 1 rad/s^2
    return math.tanh(rate / width + math.tanh(lead * acceleration / width))


def friction(joint, rate, acceleration, choice, load=0.0):
    """Return the friction of a command of one joint by the definition, N m."""
    y = direction(joint.friction_speed, rate, acceleration, choice)
    backward = (joint.friction if joint.friction_backward is None
                else joint.friction_backward)
    excess = 0.0
    if joint.stribeck_speed:
        excess = joint.breakaway_friction - joint.friction
        excess *= math.exp(-(rate / joint.stribeck_speed)**2)
    level = 0.5 * (joint.friction + backward) + excess + joint.load_friction * abs(load)
    return (joint.damping * rate + joint.friction_offset + level * y
            + 0.5 * (joint.friction - backward) * y * y)


@pytest.mark.parametrize('choice', CHOICES)
@pytest.mark.parametrize('load_friction', [0.0, 0.1])
def test_every_law_commands_the_friction_of_the_choice(choice, load_friction):
    robot = arm(choice, load_friction=load_friction)
    joints = [body.joint for body in robot.model.bodies]
    rigid = Robot(robot.model, friction=False)
    laws = {mode: Controller(robot, mode=mode, kp=0.0, kd=0.0)
            for mode in ('inverse_dynamics', 'computed_torque')}
    partial = Controller(robot, mode='computed_torque', kp=0.0, kd=0.0,
                         compensate=Terms(gravity=False))
    impedance = JointImpedance(robot, stiffness=0.0, damping=0.0)
    exported, *_ = controller_kernels(robot)
    parameters = robot.parameters.block
    rng = np.random.default_rng(1)
    for _ in range(8):
        q_d, q = rng.uniform(-1.0, 1.0, (2, 2))
        u_d, u = 0.03 * rng.normal(size=(2, 2))
        udot_d = rng.normal(size=2)
        # A motion that begins in this state.
        rows = [np.array([x, x]) for x in (q_d, u_d, udot_d)]
        motion = Motion.from_points([0.0, 1.0], *rows, joint_names=robot.joint_names)

        def expected(q, u, rigid=rigid, udot_d=udot_d, u_d=u_d):
            load = rigid.inverse_dynamics(q, u, udot_d)
            return load + [friction(joint, *x, choice, on_drive)
                           for joint, *x, on_drive in zip(joints, u_d, udot_d, load)]
        at_desired = expected(q_d, u_d)
        at_measured = expected(q, u)
        commands = {mode: law.torque(q, u, motion, 0.0) for mode, law in laws.items()}
        assert_allclose(commands['inverse_dynamics'], at_desired, atol=1e-11)
        assert_allclose(commands['computed_torque'], at_measured, atol=1e-11)
        assert_allclose(exported(q, u, q_d, u_d, udot_d, NO_GAINS), at_measured,
                        atol=1e-11)
        assert_allclose(fill_trajectory(robot, motion.times, *rows).efforts[0],
                        at_desired, atol=1e-11)
        filled = fill_trajectory(robot, motion.times, *rows,
                                 compensate=Terms(inertia=False))
        terms = robot.torque_terms(q_d, u_d, udot_d)
        assert_allclose(filled.efforts[0], at_desired - terms[0], atol=1e-11)
        if not load_friction:  # whose load is without the terms that are left out
            assert_allclose(partial.torque(q, u, motion, 0.0) + robot.gravity_force(q),
                            at_measured, atol=1e-11)
        # At the desired state the Coriolis terms of the impedance are those of the
        # model.
        tau = impedance.torque(q_d, u_d, q_d, u_d, udot_d)
        assert_allclose(tau, at_desired, atol=1e-11)
        # The functions of the native torque path, on floats.
        desired = Desired(q_d, u_d, udot_d, 1.0)
        for mode, tau in commands.items():
            traced = mode_torque(robot, Mode(mode), Terms(), q, u, desired, NO_GAINS,
                                 parameters, None)
            assert_allclose(np.asarray(traced, dtype=float), tau, atol=1e-11)


@pytest.mark.parametrize('choice', ['ahead', 'none'])
@pytest.mark.parametrize('kind', KINDS)
def test_the_friction_of_commands_is_that_of_the_joint_motion(kind, choice):
    mechanism = case(kind)
    slow = replace(mechanism, u=0.03 * mechanism.u, udot=mechanism.udot)
    robot = Robot(slow.robot.model,
                  **{**slow.robot.options, 'feedforward_friction': choice})
    change = feedforward_change(robot, slow.q, slow.u, slow.udot, **slow.t)
    rates, accelerations = slow.joint_motion
    expected = np.zeros(len(rates))
    for body in robot.model.bodies:
        joint = body.joint
        if joint.coordinate is not None:
            k = joint.coordinate
            m = joint.multiplier
            of_choice = friction(joint, m * rates[k], m * accelerations[k], choice)
            of_speed = friction(joint, m * rates[k], m * accelerations[k],
                                'desired_speed')
            expected[k] += m * (of_choice - of_speed)
    assert np.abs(expected).max() > 0.01
    assert_allclose(change, slow.T.T @ expected, atol=1e-11)


@pytest.mark.parametrize('choice', CHOICES)
def test_noise_of_the_measured_speed_moves_no_friction_at_rest(choice):
    robot = arm(choice)
    rigid = Robot(robot.model, friction=False)
    controller = Controller(robot, mode='computed_torque')
    bare = Controller(rigid, mode='computed_torque')
    impedance = JointImpedance(robot, stiffness=50.0, damping=5.0)
    smooth = JointImpedance(rigid, stiffness=50.0, damping=5.0)
    q = np.array([0.3, -0.4])
    at_rest = np.zeros(2)
    controller.torque(q, at_rest, None, 0.0)
    bare.torque(q, at_rest, None, 0.0)
    offset = [0.3, 0.3]  # which is no friction of a direction
    for u in 0.1 * np.random.default_rng(0).normal(size=(20, 2)):
        assert_allclose(
            controller.torque(q, u, None, 0.0) - bare.torque(q, u, None, 0.0), offset,
            atol=1e-12)
        assert_allclose(impedance.torque(q, u, q) - smooth.torque(q, u, q), offset,
                        atol=1e-12)


def test_a_frame_at_rest_on_its_target_has_no_friction_in_its_command():
    robot = arm('ahead', friction_offset=0.0)
    rigid = Robot(robot.model, friction=False)
    law = CartesianImpedance(robot, 'fore', stiffness=[500.0] * 3 + [30.0] * 3)
    bare = CartesianImpedance(rigid, 'fore', stiffness=[500.0] * 3 + [30.0] * 3)
    q = np.array([0.3, -0.9])
    pose = robot.frame_pose('fore', q)
    for u in 0.1 * np.random.default_rng(0).normal(size=(10, 2)):
        assert_allclose(law.torque(q, u, pose), bare.torque(q, u, pose), atol=1e-12)
    # A target that begins to move has friction before the rate of the joints.
    begins = [x.torque(q, [0.0, 0.0], pose, acceleration=[1.0, 0.0, 1.0, 0.0, 0.0, 0.0])
              for x in (law, bare)]
    assert np.abs(np.subtract(*begins)).max() > 1.0


@pytest.mark.parametrize('choice', CHOICES)
def test_the_friction_of_a_command_is_continuous_and_bounded(choice):
    joint = arm(choice).model.bodies[0].joint
    rates = np.linspace(-0.1, 0.1, 4001)
    for acceleration in (-30.0, -0.5, 0.0, 0.5, 30.0):
        y = [direction(joint.friction_speed, rate, acceleration, choice)
             for rate in rates]
        assert np.abs(y).max() <= 1.0
        # The steepest slope of tanh is one over the width, that of a share three times.
        assert np.abs(
            np.diff(y)).max() < 3.0 * (rates[1] - rates[0]) / joint.friction_speed
        # No sign but that of the rate farther from rest than the width.
        away = np.abs(rates) > 1.001 * joint.friction_speed
        assert (np.sign(y)[away] == np.sign(rates)[away]).all()


def tracking_error(choice, width):
    """Return the largest error at reversals with exact friction, rad, (2,)."""
    robot = arm(choice, friction_speed=width)
    t = np.linspace(0.0, 2.0, 201)[:, None]
    size = np.array([0.5, 0.7])
    w = 2.0 * np.pi * np.array([0.5, 0.75])
    motion = Motion.from_points(
        t[:, 0], size * (1.0 - np.cos(w * t)), size * w * np.sin(w * t),
        size * w**2 * np.cos(w * t), joint_names=robot.joint_names)
    trajectory = simulate(robot, [0.0, 0.0], [0.0, 0.0], 2.0,
                          torque=ComputedTorque(robot, motion), step=2e-3, sticking=True)
    desired = motion.sample(np.minimum(trajectory.t, 2.0))[0]
    return np.abs(trajectory.q - desired).max(axis=0)


@pytest.mark.parametrize('width', [0.01, 0.05])
def test_friction_ahead_lessens_the_error_of_joints_that_stick_at_reversals(width):
    of_speed = tracking_error('desired_speed', width)
    assert (tracking_error('ahead', width) < 0.8 * of_speed).all()
    assert (tracking_error('none', width) > 1.4 * of_speed).all()


@pytest.mark.parametrize('choice', CHOICES)
def test_elastic_feedforward_has_the_choice_on_both_sides_of_the_drive(choice):
    robot = arm(choice)
    law = {'friction': 2.0, 'friction_speed': 0.03}
    drives = dict.fromkeys(robot.joint_names,
                           Drive(900.0, rotor_inertia=0.3, friction=law))
    elastic = Robot(with_drives(robot.model, drives), feedforward_friction=choice)
    feedforward = ElasticFeedforward(elastic)
    motors = []
    for body in elastic.model.bodies:
        if body.joint.name not in drives:
            motors.append(body.joint)
    rng = np.random.default_rng(2)
    q, udot, jerk, snap = rng.normal(size=(4, 2))
    u = 0.02 * rng.normal(size=2)
    gear, _, _, _, speed, acceleration, motor = feedforward(q, u, udot, jerk, snap)
    load = Robot(link_side(elastic.model), friction=False).inverse_dynamics(q, u, udot)
    for k, (link, drive) in enumerate(zip(robot.model.bodies, motors, strict=True)):
        assert_allclose(gear[k], load[k] + friction(link.joint, u[k], udot[k], choice),
                        atol=1e-10)
        of_motor = friction(drive, speed[k], acceleration[k], choice)
        assert_allclose(motor[k], 0.3 * acceleration[k] + gear[k] + of_motor, atol=1e-9)


@pytest.mark.parametrize('choice',
                         ['ahaed', True, None, 0.0, -0.1, math.nan, math.inf, [0.1]])
def test_other_choices_are_refused(choice):
    with pytest.raises(InputError,
                       match=r'feedforward_friction: .*; expected one of desired'):
        arm(choice)


def test_numbers_of_numpy_are_times():
    assert arm(np.int64(1)).equals(arm(1.0))
