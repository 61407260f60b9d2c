"""Demand, largest payload and highest speed of arms with beams, bent in equilibrium."""

from dataclasses import replace
from functools import cache
import math

from kane_dynamics import (Inertial, InputError, load_urdf, Motion, QuasiStatic, Robot,
                           stiffened)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.feasibility import demand, fastest, largest_payload
import numpy as np
from palletizer import bending_palletizer, DRIVEN, positions
import pytest
import yaml

URDF = resource_path('urdf', 'two_link.urdf')
BENDING = resource_path('urdf', 'two_link.bending.yaml')
REACH = Motion.from_points([0.0, 0.8, 1.5], [[0.3, -0.4], [0.9, 0.3], [0.5, 0.6]],
                           joint_names=['joint1', 'joint2'])
STEP = 0.02
COM = (0.02, 0.0, 0.01)


@cache
def arm():
    """Return an arm with beams that carry a payload, and its rigid model."""
    model = load_urdf(URDF, supplement=BENDING)
    return (QuasiStatic(Robot(model, payload_frame='tip')),
            Robot(stiffened(model), payload_frame='tip'))


def test_the_torque_is_that_of_the_arm_in_equilibrium_at_every_sample():
    bending, rigid = arm()
    asked = demand(rigid, REACH, speed=1.3, step=STEP, bending=bending)
    np.testing.assert_array_equal(asked.tau, bending.inverse_dynamics(
        asked.q, asked.u, asked.udot))
    assert np.abs(
        asked.tau - demand(rigid, REACH, speed=1.3, step=STEP).tau).max() > 1e-3


@pytest.mark.parametrize('power', [math.inf, 20.0])
def test_no_higher_speed_keeps_the_limits_and_the_one_found_does(power):
    bending, rigid = arm()
    arguments = {'step': STEP, 'power': power, 'bending': bending}
    time_scale = fastest(rigid, REACH, **arguments)
    assert demand(rigid, REACH, speed=time_scale.speed, **arguments).fits
    for above in (1.00001, 1.01, 1.1, 1.5):
        assert not demand(rigid, REACH, speed=above * time_scale.speed, **arguments).fits
    assert abs(time_scale.speed / fastest(rigid, REACH, step=STEP, power=power).speed
               - 1.0) > 1e-4


@cache
def arm_with_weaker_beams(stiffness, strength):
    """Return the arm with weaker beams and stronger motors without limits of speed."""
    data = yaml.safe_load(BENDING.read_text())
    for beam in data['beams'].values():
        beam['stiffness'] *= stiffness
    model = load_urdf(URDF, supplement=data)
    rigid = Robot(stiffened(model))
    rigid.limits = replace(rigid.limits, effort=strength * rigid.limits.effort,
                           velocity=np.full(2, np.inf))
    return QuasiStatic(Robot(model)), rigid


@pytest.mark.parametrize('stiffness, strength', [(0.05, 1.0), (0.1, 3.0), (0.3, 10.0),
                                                 (1.0, 30.0)])
def test_the_highest_speed_is_found_where_deflections_change_it_much(
        stiffness, strength):
    bending, rigid = arm_with_weaker_beams(stiffness, strength)
    arguments = {'step': STEP, 'bending': bending}
    time_scale = fastest(rigid, REACH, **arguments)
    assert time_scale.limit == 'effort'
    for share, fits in ((0.98, True), (1.0, True), (1.0001, False), (1.02, False)):
        assert demand(
            rigid, REACH, speed=share * time_scale.speed, **arguments).fits == fits


def test_a_speed_that_only_the_stiffness_bounds_is_refused():
    bending, rigid = arm_with_weaker_beams(0.1, 100.0)
    with pytest.raises(InputError,
                       match='load on the beams of two_link: no equilibrium found'):
        fastest(rigid, REACH, step=STEP, bending=bending)


def test_the_largest_payload_fits_and_any_more_does_not():
    bending, rigid = arm()
    payload_bound = largest_payload(rigid, REACH, com=COM, step=STEP, bending=bending)
    stiff = largest_payload(rigid, REACH, com=COM, step=STEP)
    assert abs(payload_bound.mass / stiff.mass - 1.0) > 1e-4
    for mass, fits in ((payload_bound.mass, True), (1.00001 * payload_bound.mass, False),
                       (1.1 * payload_bound.mass, False)):
        robot = bending.robot.copy()
        robot.parameters.payload = Inertial(mass, COM, np.zeros((3, 3)))
        asked = demand(rigid, REACH, step=STEP, bending=QuasiStatic(robot))
        assert asked.fits == fits
    worst = max(asked.excesses, key=lambda excess: abs(excess.value / excess.bound))
    assert (worst.joint, worst.limit) == (payload_bound.joint, payload_bound.limit)
    assert bending.robot.parameters.payload is None


def test_the_highest_speed_of_closed_loops_is_that_of_the_demand():
    flexible, rigid = bending_palletizer()
    bending = QuasiStatic(flexible)
    course = Motion.from_points([0.0, 1.0],
                                [[0.0, 0.1, -0.3, 0.0], [0.4, 0.3, 0.0, 0.5]],
                                [[0.0] * 4] * 2, [[0.0] * 4] * 2, joint_names=DRIVEN)
    arguments = {'step': 0.1, 'bending': bending}
    time_scale = fastest(rigid, course, **arguments)
    assert demand(rigid, course, speed=time_scale.speed, **arguments).fits
    assert not demand(rigid, course, speed=1.0001 * time_scale.speed, **arguments).fits
    q = np.array([positions(rigid, *row) for row in course.positions])
    still = np.zeros((2, 4))
    asked = demand(rigid, course, speed=1e-6, **arguments)
    driven = [rigid.joint_names.index(name) for name in bending.speed_names]
    np.testing.assert_allclose(asked.tau[[0, -1]][:, driven], bending.inverse_dynamics(
        q, still, still), atol=1e-6)


def test_other_models_and_weak_beams_are_refused():
    bending, rigid = arm()
    ur = Robot(load_urdf(resource_path('urdf', 'ur10e.urdf')))
    other_motion = Motion.from_points([0.0, 1.0], [[0.0] * 6, [0.1] * 6],
                                      joint_names=ur.joint_names)
    for call in (demand, fastest):
        with pytest.raises(InputError,
                           match=r"bending: for a robot with joints .'joint1',"):
            call(ur, other_motion, bending=bending)
        with pytest.raises(InputError, match='bending: a Robot; expected a QuasiStatic'):
            call(rigid, REACH, bending=rigid)
    with pytest.raises(InputError,
                       match='load on the beams of two_link: no equilibrium found'):
        demand(rigid, REACH, speed=1000.0, bending=bending)
