"""Feasibility: peaks, highest speed and largest payload, compared with brute force."""

from dataclasses import replace
from functools import cache
import math

from kane_dynamics import (Inertial, InputError, Limits, ModelBuilder, ModelError,
                           Motion, point_mass, Robot, simulate)
from kane_dynamics.feasibility import demand, Excess, fastest, largest_payload
from kane_dynamics.feasibility.samples import sampled, STEP
from kane_dynamics.robot.parameters import JointLimits
from linkages import at_angle, four_bar, four_bar_model, PIN, sleigh
from mechanisms import random_model, with_joints
import numpy as np
import pytest

STEPS = {'step': 0.005}
SPEEDS = np.geomspace(1e-3, 100.0, 1500)


@cache
def arm():
    """Return a robot with friction, springs, slides, a mimic, and a load."""
    model = random_model(5, 3, mimics=1, branching=0.0)
    limited = with_joints(model, limits=Limits(effort=150.0))
    return Robot(limited, payload_frame='frame2')


def limited(effort, velocity=math.inf, reach=math.inf):
    """Return the arm with other limits."""
    robot = arm()
    robot.parameters.payload = None
    robot.limits = JointLimits(*(np.full(3, float(x)) for x in (-reach, reach)),
                               np.full(3, float(velocity)), np.full(3, float(effort)))
    return robot


def motion(seed, duration=2.0):
    """Return a random motion of the arm through five points."""
    rng = np.random.default_rng(seed)
    return Motion.from_points(np.linspace(0.0, duration, 5),
                              rng.uniform(-1.0, 1.0, (5, 3)),
                              joint_names=arm().joint_names)


def allowed(robot, course, speeds, power=math.inf, step=0.02, more=()):
    """Return the speeds at which the arm keeps its limits, by all torques."""
    _, q, u, udot = sampled(robot, course, step, np.asarray(more, dtype=float))
    s = speeds[:, None, None]
    at = [np.broadcast_to(x, (len(speeds), *q.shape)).reshape(-1, 3)
          for x in (q, s * u, s**2 * udot)]
    tau = robot.inverse_dynamics(*at).reshape(len(speeds), -1)
    rates = (s * u).reshape(len(speeds), -1)
    effort = robot.limits.effort[0]
    velocity = robot.limits.velocity[0]
    return ((np.abs(tau) <= effort) & (np.abs(rates) <= velocity)
            & (np.abs(tau * rates) <= power)).all(axis=1)


@pytest.mark.parametrize(('effort', 'velocity', 'power'), [
    (60.0, math.inf, math.inf), (25.0, math.inf, math.inf), (60.0, 3.0, math.inf),
    (60.0, 8.0, 20.0), (1000.0, math.inf, 5.0)])
@pytest.mark.parametrize('seed', [0, 1, *(
    pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3))])
def test_no_higher_speed_keeps_the_limits_and_the_one_found_does(
        seed, effort, velocity, power):
    robot = limited(effort, velocity)
    course = motion(seed)
    time_scale = fastest(robot, course, power=power, **STEPS)
    allowed_speeds = SPEEDS[allowed(robot, course, SPEEDS, power)]
    if time_scale is None:
        assert not allowed(robot, course, np.array([1e-6])).any()  # cannot hold the arm
        return
    # Satisfied at the samples, but not between them.
    for speed in allowed_speeds[allowed_speeds > time_scale.speed]:
        assert not allowed(robot, course, np.array([speed]), power, 1e-4).any()
    asked = demand(robot, course, speed=time_scale.speed, power=power, **STEPS)
    assert asked.fits
    assert (asked.uses[time_scale.limit][robot.joint_names.index(time_scale.joint)]
            == pytest.approx(1.0))
    assert time_scale.speed == pytest.approx(
        fastest(robot, course, power=power, step=1e-4).speed, rel=1e-9)
    above = allowed(robot, course, time_scale.speed * (1.0 + np.array([1e-6, 1e-3])),
                    power, 1e-4)
    assert not above.any()


@cache
def pendulum():
    """Return a pendulum of 1 kg and 1 m, and one free turn of it, end to end."""
    builder = ModelBuilder('pendulum')
    builder.body('bob', axis=(0.0, 1.0, 0.0), inertial=point_mass(1.0, (0.0, 0.0, -1.0)))
    robot = Robot(builder.model(), payload_frame='bob')
    free = simulate(robot, [0.0], [8.0], 1.2, step=1e-3)
    whole = slice(0, int(np.searchsorted(free.q[:, 0], 2.0 * math.pi)))
    return robot, Motion.from_points(free.t[whole], free.q[whole], free.u[whole],
                                     free.udot[whole], joint_names=robot.joint_names)


def test_a_turn_that_only_a_swing_passes_has_no_speed():
    # Tau = (1 - s^2) m g l sin q: less than 3 N m near s = 1 only.
    robot, turn = pendulum()
    robot.limits = replace(robot.limits, effort=np.array([3.0]))
    assert demand(robot, turn).fits
    assert fastest(robot, turn) is None
    robot.limits = replace(robot.limits, effort=np.array([10.0]))
    assert fastest(robot, turn).speed == pytest.approx(math.sqrt(1.0 + 10.0 / 9.81),
                                                       rel=1e-5)


def test_demand_at_a_speed_equals_that_of_the_scaled_motion():
    robot = limited(100.0)
    course = motion(1)
    a = demand(robot, course, speed=1.7, step=0.0201)
    b = demand(robot, course.scaled(1.7), step=0.0201 / 1.7)
    assert np.allclose(a.t, b.t, atol=1e-12)
    assert np.allclose(a.tau, b.tau, rtol=1e-9, atol=1e-9)
    assert a.torque_rms == pytest.approx(b.torque_rms)
    assert np.allclose(a.torque_rms, np.sqrt(np.mean(b.tau**2, axis=0)), rtol=0.05)


def test_both_sides_of_an_acceleration_jump_are_checked():
    corner = Motion.from_points([0.0, 1.0, 2.0], [[0.0] * 3, [1.0] * 3, [0.0] * 3],
                                [[0.0] * 3, [0.5] * 3, [0.0] * 3],
                                joint_names=arm().joint_names)
    t, _, _, udot = sampled(arm(), corner, 0.3)
    at = np.flatnonzero(np.isclose(t, 1.0))
    assert np.allclose(udot[at], [[-4.0] * 3, [-8.0] * 3])


@pytest.mark.parametrize('seed', range(3))
@pytest.mark.parametrize('power', [math.inf, 60.0])
def test_largest_payload_fits_and_any_more_does_not(seed, power):
    # The model's own effort.
    robot = limited(150.0)
    course = motion(seed, 6.0)
    com = (0.1, 0.0, 0.2)
    inertia = 0.01 * np.eye(3)
    robot.parameters.payload = Inertial(1e3)
    payload_bound = largest_payload(robot, course,
                                    com=com, inertia=inertia, power=power, **STEPS)
    assert robot.parameters.payload.mass == 1e3
    assert 0.1 < payload_bound.mass < 100.0
    for factor, fits in ((1.0, True), (1.0 + 1e-6, False)):
        mass = factor * payload_bound.mass
        robot.parameters.payload = Inertial(mass, np.array(com), mass * inertia)
        asked = demand(robot, course, power=power, **STEPS)
        assert asked.fits == fits
    worst = max(asked.excesses, key=lambda excess: abs(excess.value) / excess.bound)
    assert (worst.joint, worst.limit,
            worst.t) == (payload_bound.joint, payload_bound.limit,
                         pytest.approx(payload_bound.t, abs=STEPS['step']))
    # An excess is reported at a sample; the limit is reached between samples.
    robot.parameters.payload = Inertial(payload_bound.mass, np.array(com),
                                        payload_bound.mass * inertia)
    q, u, udot = course.sample(payload_bound.t)
    joint = robot.joint_names.index(payload_bound.joint)
    tau = robot.inverse_dynamics(q, u, udot)[joint]
    reached = {'effort': abs(tau) / 150.0, 'power': abs(tau * u[joint]) / power}
    assert reached[payload_bound.limit] == pytest.approx(1.0, rel=1e-8)


def test_excess_text_has_enough_digits_to_differ_from_the_bound():
    assert str(Excess('j', 'power', 1.0, 100.0000321, 100.0)).endswith(
        'power 100.00003 at 1 s; power limit 100')
    assert str(Excess('j', 'effort', 1.0, 51.23456, 50.0)).endswith(
        'torque 51.23 at 1 s; effort limit 50')


def test_payload_of_an_infeasible_motion_is_rejected_by_name():
    with pytest.raises(InputError,
                       match=r"without a payload: joint 'joint\d': torque .* at "):
        largest_payload(limited(1.0), motion(0), **STEPS)


def test_payload_with_impossible_inertia_is_rejected():
    with pytest.raises(ModelError,
                       match="'payload': principal moments of inertia are 1, 1, 5"):
        largest_payload(limited(math.inf), motion(0),
                        inertia=np.diag([1.0, 1.0, 5.0]), **STEPS)


def test_the_highest_speed_of_a_robot_without_limits_is_infinite():
    robot = limited(math.inf)
    assert demand(robot, motion(0), **STEPS).fits
    assert fastest(robot, motion(0), **STEPS).speed == math.inf
    assert fastest(robot, motion(0), most=2.0, **STEPS).speed == 2.0
    payload_bound = largest_payload(*pendulum(), **STEPS)
    assert (payload_bound.mass, payload_bound.joint) == (math.inf, None)


def test_motor_without_torque_fits_no_motion():
    robot = limited(0.0)
    asked = demand(robot, motion(0), **STEPS)
    assert not asked.fits and (asked.uses['effort'] == math.inf).all()
    assert fastest(robot, motion(0), **STEPS) is None
    assert fastest(limited(math.inf, velocity=0.0), motion(0), **STEPS) is None


def test_configuration_that_cannot_be_held_is_named_at_the_lowest_speed():
    robot = limited(float(np.abs(demand(limited(math.inf), motion(0), speed=1e-6,
                                        **STEPS).tau).max()) * 0.99)
    assert fastest(robot, motion(0), **STEPS) is None
    assert demand(robot, motion(0), speed=1e-6, **STEPS).excesses[0].limit == 'effort'


def test_position_beyond_its_limit_is_infeasible_at_any_speed():
    robot = limited(math.inf, reach=0.1)
    assert fastest(robot, motion(0), **STEPS) is None
    assert {excess.limit for excess in demand(robot, motion(0), **STEPS).excesses} == {
        'lower', 'upper'}


def test_motion_of_one_point_demands_the_holding_torque():
    point = Motion.from_points([0.0], [[0.1, 0.2, 0.3]], joint_names=arm().joint_names)
    robot = limited(1000.0)
    asked = demand(robot, point)
    hold = robot.inverse_dynamics([0.1, 0.2, 0.3], np.zeros(3), np.zeros(3))
    assert np.allclose(asked.tau, hold) and np.allclose(asked.torque_rms, np.abs(hold))
    assert fastest(robot, point).speed == math.inf


def test_demand_includes_friction_unless_the_robot_has_none():
    with_friction = arm()
    without = Robot(arm().model, friction=False)
    difference = demand(with_friction, motion(2), step=0.5).tau - demand(
        without, motion(2), step=0.5).tau
    assert np.abs(difference).max() > 0.1
    assert fastest(without, motion(2), step=0.5) is not None


@pytest.mark.parametrize(('change', 'words'), [
    ({'step': 0.0}, 'step: 0 s; expected'), ({'step': 1e-9}, 'samples of a motion'),
    ({'speed': -1.0}, 'speed: -1.0; expected'),
    ({'power': -1.0}, "power of joint 'joint0': -1.0")])
def test_invalid_feasibility_arguments_are_rejected(change, words):
    with pytest.raises(InputError, match=words):
        demand(limited(1.0), motion(0), **{'step': STEP, **change})
    with pytest.raises(InputError, match=r'most: 0\.0; expected'):
        fastest(limited(1.0), motion(0), most=0.0)


def test_unsuitable_robots_and_motions_are_rejected():
    other_motion = Motion.from_points([0.0], [[0.0]], joint_names=['other'])
    with pytest.raises(InputError, match=r"motion: joints \['other'\]; expected"):
        demand(arm(), other_motion)


def test_the_largest_payload_of_a_closed_loop_takes_the_motor_to_its_limit():
    robot = Robot(four_bar_model(), constraints=[PIN], independent=['crank'],
                  payload_frame='middle', configuration=at_angle(0.8))
    robot.limits = replace(robot.limits, effort=np.array([40.0, math.inf, math.inf]))
    course = Motion.from_points([0.0, 0.5], [[0.8], [1.3]], joint_names=['crank'])
    bound = largest_payload(robot, course, step=0.02)
    assert (bound.joint, bound.limit) == ('crank', 'effort')
    robot.parameters.payload = Inertial(bound.mass, np.zeros(3), np.zeros((3, 3)))
    asked = demand(robot, course, step=0.02)
    assert asked.joint_names == ('crank', 'coupler', 'rocker')
    assert asked.uses['effort'][0] == pytest.approx(1.0)
    np.testing.assert_array_equal(asked.tau[:, 1:], 0.0)


def test_motions_that_do_not_determine_a_mechanism_are_refused():
    two = Motion.from_points([0.0], [[0.8, 0.0]], joint_names=['crank', 'coupler'])
    with pytest.raises(InputError,
                       match='expected 1 of crank, coupler, rocker, as many as ind'):
        demand(four_bar('crank'), two)
    path = Motion.from_points([0.0], [[0.0, 0.0]], joint_names=['body/x', 'body/rz'])
    with pytest.raises(InputError, match="constraint 'runner' is one of velocities"):
        demand(sleigh(), path)
