"""Results of public methods that no other test asks for by itself."""

from functools import cache
import math

from kane_dynamics import (Bending, CollisionDetector, Controller, HybridForce, Inertial,
                           Limits, load_urdf, ModelBuilder, MomentumObserver, Motion,
                           plot, Robot, rod, SmoothMotion)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.identification import DriveRecording, Efforts
from kane_dynamics.optimal_control import TrajectoryOptimizer
import numpy as np
from numpy.testing import assert_allclose, assert_array_equal
import pytest


@cache
def arm():
    return Robot(load_urdf(resource_path('urdf', 'two_link.urdf')))


Q, U, UDOT = np.array([[0.3, -0.5], [0.7, 0.2], [1.0, -2.0]])
MOTION = Motion.from_points([0.0, 0.5, 1.2], [[0.0, 0.0], [0.4, -0.3], [0.1, 0.5]],
                            np.zeros((3, 2)), joint_names=('joint1', 'joint2'))


def test_wave_numbers_are_roots_of_the_frequency_equations():
    for k in range(4):
        x = Bending.clamped_free().wave_number(k, 2.0)
        assert abs(math.cos(x) + 1.0 / math.cosh(x)) < 1e-9
        x = Bending.pinned_free().wave_number(k, 2.0)
        assert abs(math.tan(x) - math.tanh(x)) < 1e-9


def test_a_tuned_detector_has_the_new_thresholds_and_a_reset_one_no_flag():
    detector = CollisionDetector(('a', 'b'), 1.0, confirm=0.0)
    detector.tune([5.0, 2.0], confirm=0.0, release=0.5, clear=0.0)
    assert not detector.update(0.0, np.array([4.0, 1.0]))
    assert detector.update(0.1, np.array([4.0, 3.0])) and detector.joint == 'b'
    detector.reset()
    assert not detector.collision and detector.joint is None and detector.beyond == ()


def test_a_tuned_observer_has_the_new_gain_and_keeps_its_estimate():
    robot = arm()
    observer = MomentumObserver(robot, gain=5.0, max_gap=1.0)
    contact = np.array([2.0, -1.0])
    tau = robot.gravity_force(Q) - contact  # which the contact holds
    times = np.arange(0.0, 0.2001, 1e-3)
    for t in times:
        estimate = observer.update(t, Q, np.zeros(2), tau)
    assert_allclose(estimate, contact * -np.expm1(-5.0 * 0.2), rtol=0.02)
    observer.tune(20.0, 1.0)
    for t in times[1:]:
        estimate = observer.update(0.2 + t, Q, np.zeros(2), tau)
    assert_allclose(estimate, contact * -np.expm1(-5.0 * 0.2 - 20.0 * 0.2), rtol=0.02)


def test_the_energy_of_a_spring_is_the_work_of_its_force():
    robot = Robot(load_urdf(resource_path('urdf', 'ur10e.urdf')))
    law = HybridForce(robot, 'tool0', force_directions=['z'],
                      stiffness=[800.0] * 3 + [50.0] * 3)
    q = np.array([0.3, -1.2, 1.4, -0.8, 0.5, 0.2])
    pose = robot.frame_pose('tool0', q)
    assert law.energy(q, pose) == pytest.approx(0.0, abs=1e-12)
    pose[0, 3] += 0.01
    assert law.energy(q, pose) == pytest.approx(0.5 * 800.0 * 0.01**2, rel=1e-9)


def test_an_inertial_is_that_of_its_parameters():
    inertial = rod(2.0, (0.1, 0.2, 0.0), (0.5, -0.1, 0.3))
    again = Inertial.from_parameters(inertial.parameters)
    assert again.mass == pytest.approx(2.0, rel=1e-14)
    assert_allclose(again.com, inertial.com, atol=1e-14)
    assert_allclose(again.inertia, inertial.inertia, atol=1e-14)


def test_limits_with_a_follower_are_those_that_both_satisfy():
    limits = Limits(-1.0, 2.0, 3.0, 40.0)
    narrowed = limits.with_follower(Limits(-1.0, 1.0, 1.0, 5.0), -2.0, 0.5)
    # -2 q + 0.5 is from -1 to 1, and its rate at most 1.
    assert narrowed == Limits(-0.25, 0.75, 0.5, 40.0)
    assert limits.with_follower(Limits(8.0, 9.0), 1.0, 0.0) is None


def test_a_renamed_model_has_the_new_names_and_the_same_dynamics():
    model = arm().model
    for other, name in ((model.prefixed('left_'), 'left_{}'.format),
                        (model.renamed(str.upper), str.upper)):
        assert other.joint_names == tuple(map(name, model.joint_names))
        assert [frame.name for frame in other.frames] == [
            name(frame.name) for frame in model.frames]
        assert_array_equal(Robot(other).inverse_dynamics(Q, U, UDOT),
                           arm().inverse_dynamics(Q, U, UDOT))


def test_velocities_and_polynomials_of_a_motion_are_those_of_its_samples():
    t = np.linspace(-0.1, 1.3, 29)
    q, u, _ = MOTION.sample(t)
    assert_allclose(MOTION.velocities_at(t), u, atol=1e-14)
    for name, column in zip(MOTION.joint_names, q.T):
        polynomial = MOTION.joint_polynomial(name)
        assert_allclose([polynomial(x) for x in t], column, atol=1e-13)
    shares = np.array([0.2, 0.6])
    begins = MOTION.times[:-1, None]
    places = begins + shares * np.diff(MOTION.times)[:, None]
    assert_allclose(MOTION.velocities_inside(shares),
                    MOTION.sample(places.ravel())[1].reshape(2, 2, 2), atol=1e-13)


def test_a_motion_with_rest_ends_at_rest_at_its_last_point():
    motion = SmoothMotion.from_points([0.0, 1.0], [[0.0], [0.6]], joint_names=['a'])
    longer = motion.with_rest(0.5)
    assert longer.duration == pytest.approx(1.5)
    for t in (1.0, 1.2, 1.5):
        state = longer.sample(np.array([t]))
        assert_allclose(state.q, 0.6, atol=1e-12)
        assert_allclose(state.u, 0.0, atol=1e-9)
    assert_allclose(longer.sample(np.array([0.4])).q, motion.sample(np.array([0.4])).q,
                    atol=1e-12)


def test_a_recording_of_the_motor_side_is_that_of_the_joint_side_even_in_time():
    t = np.linspace(0.0, 2.0, 400)**1.1
    joint = np.sin(t)[:, None]
    recording = DriveRecording.from_motor_side(t, -50.0 * joint, -50.0,
                                               motor_torque=0.1 * joint)
    assert_allclose(recording.theta, joint, rtol=1e-14)
    assert_allclose(recording.motor_torque, -5.0 * joint, rtol=1e-14)
    even = recording.resampled()
    assert np.ptp(np.diff(even.t)) < 1e-12
    assert_allclose(even.theta[:, 0], np.sin(even.t), atol=1e-7)


def test_the_share_of_the_weight_that_efforts_hold():
    efforts = Efforts('joint_torque')
    weight = arm().gravity_force(Q)
    for share in (0.0, 0.5, 1.0):
        held = efforts.share_of_weight(arm(), Q, share * weight)
        assert held == pytest.approx(share, abs=1e-14)
    wheel = ModelBuilder('wheel')
    wheel.body('wheel', axis=(0, 0, 1), inertial=rod(1.0, (0, 0, 0), (1, 0, 0)))
    assert efforts.share_of_weight(Robot(wheel.model()), [0.0], [1.0]) is None


def test_torques_of_a_controller_without_feedback_are_those_of_the_model():
    control = Controller(arm(), mode='computed_torque')
    assert_allclose(control.gravity_torque(Q), arm().gravity_force(Q), atol=1e-12)
    desired = MOTION.sample(np.array([0.3]))
    assert_allclose(control.motion_torque(Q, MOTION, 0.3),
                    arm().inverse_dynamics(*(row[0] for row in desired)), atol=1e-12)


def test_a_tried_solution_is_the_solution_or_none():
    problems = [TrajectoryOptimizer(arm(), nodes=5, interval=0.02, torque_limits=50.0)
                for _ in range(2)]
    plan, tried = problems[0].solve(Q, U), problems[1].try_solve(Q, U)
    assert_array_equal(plan.tau, tried.tau)
    assert problems[1].try_solve(Q, [1e200, 0.0]) is None


def test_a_path_of_a_picture_is_checked_before_the_work():
    assert plot.check_path('picture.png') is None
