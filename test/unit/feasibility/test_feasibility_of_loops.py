"""Highest speeds of closed loops, compared with the demand at every speed."""

from dataclasses import replace
from functools import cache
import math

from kane_dynamics import InputError, Limits, Motion, Robot, Speeds
from kane_dynamics.feasibility import demand, fastest
from linkages import at_angle, four_bar_model, PIN
import numpy as np
import pytest

COURSE = Motion.from_points([0.0, 0.4, 1.0], [[0.8], [1.5], [1.0]],
                            joint_names=['crank'])
EFFORT = 14.0  # N m


@cache
def linkage(shared=False, friction=1.5):
    """Return the four-bar with friction everywhere; crank, or rocker too, driven."""
    model = four_bar_model()
    rows = []
    for body in model.bodies:
        rows.append(
            replace(body, joint=replace(body.joint, friction=friction, damping=0.2,
                                        limits=Limits(effort=EFFORT, velocity=30.0))))
    bodies = tuple(rows)
    return Robot(replace(model, bodies=bodies), constraints=[PIN], independent=['crank'],
                 actuated={'crank': 1.0, 'rocker': 3.0} if shared else None,
                 configuration=at_angle(0.8))


@pytest.mark.parametrize('power', [math.inf, 20.0])
@pytest.mark.parametrize('shared', [False, True])
def test_no_higher_speed_of_a_closed_loop_keeps_the_limits_and_the_one_found_does(
        shared, power):
    robot = linkage(shared)
    arguments = {'step': 0.01, 'power': power}
    time_scale = fastest(robot, COURSE, **arguments)
    assert 1e-3 < time_scale.speed < 100.0
    assert demand(robot, COURSE, speed=time_scale.speed, **arguments).fits
    for above in (1.00001, 1.01, 1.3, 2.0, 5.0):
        assert not demand(
            robot, COURSE, speed=above * time_scale.speed, **arguments).fits
    assert time_scale.joint in robot.actuated_names
    if not shared and power == math.inf:
        assert time_scale.joint == 'crank' and time_scale.limit == 'effort'


def test_friction_of_passive_pins_slows_the_crank():
    assert fastest(linkage(), COURSE, step=0.01).speed < fastest(
        linkage(friction=0.0), COURSE, step=0.01).speed


def test_speeds_that_prescribe_a_velocity_cannot_be_scaled():
    model = four_bar_model()
    shifted = Robot(model,
                    speeds=Speeds(lambda q, t: np.eye(3), lambda q, t: np.ones(3)))
    course = Motion.from_points([0.0, 1.0], [[0.0] * 3, [1.0] * 3],
                                joint_names=model.joint_names)
    with pytest.raises(InputError,
                       match='robot: speeds or constraints that are functions'):
        fastest(shifted, course)
