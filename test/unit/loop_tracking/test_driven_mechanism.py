"""Closed configurations for motions of driving joints against those by circles."""

from kane_dynamics import Closure, Motion, Prescribed, Robot
from kane_dynamics.errors import InputError
from kane_dynamics.feasibility import demand
from kane_dynamics.loop_tracking.driven_mechanism import (driving_tracker,
                                                          mechanism_motion)
from kane_dynamics.loop_tracking.loop_error import LoopError
from linkages import at_angle, five_bar, five_bar_at, four_bar_model, PIN
import numpy as np
import pytest

TIP = Closure('left_tip', 'right_tip', 'revolute', axis=(0, 1, 0), name='tip')


def turned(t):
    """Return the angle of the right crank as a function of time, rad."""
    return 1.3 + 0.6 * np.sin(3.0 * t)


def closed_at(q):
    """Return the five-bar linkage with the assembly mode of a configuration."""
    return Robot(five_bar().model, constraints=[TIP], configuration=q)


@pytest.mark.parametrize('interval', [0.01, 0.4])
def test_loops_close_along_rows_that_are_far_apart_in_time_too(interval):
    """The function of time turns a crank by up to 0.6 rad from row to row."""
    robot = Robot(five_bar().model, constraints=[TIP, Prescribed('right_crank', turned)],
                  independent=['left_crank'],
                  configuration=five_bar_at(2.0, turned(0.0)))
    t = np.arange(0.0, 4.0, interval)
    left = (2.0 + 0.3 * np.sin(t))[:, None]
    motion = mechanism_motion(robot, ['left_crank'], t, left, 0.3 * np.cos(t)[:, None],
                              -0.3 * np.sin(t)[:, None])
    expected = [five_bar_at(*cranks) for cranks in zip(left[:, 0], turned(t))]
    np.testing.assert_allclose(motion.q, expected, atol=1e-12)
    np.testing.assert_array_equal(motion.q[:, 0], left[:, 0])


def test_order_of_driving_joints_is_free_and_their_positions_are_kept():
    cranks = np.array([2.0, 1.2]) + np.linspace(0.0, 0.5, 20)[:, None] * [1.0, -0.7]
    t = np.linspace(0.0, 1.0, 20)
    none = np.zeros((20, 2))
    robot = closed_at(five_bar_at(*cranks[0]))
    one = mechanism_motion(robot, ['left_crank', 'right_crank'], t, cranks, none, none)
    swapped = mechanism_motion(robot, ['right_crank', 'left_crank'], t, cranks[:, ::-1],
                               none, none)
    np.testing.assert_array_equal(one.q, swapped.q)
    np.testing.assert_array_equal(one.q[:, [0, 2]], cranks)
    np.testing.assert_allclose(one.q, [five_bar_at(*angles) for angles in cranks],
                               atol=1e-12)


def test_a_motion_of_no_rows_and_of_one_row_have_as_many_configurations():
    q = five_bar_at(2.0, 1.2)
    none = np.zeros((1, 2))
    robot = closed_at(q)
    for rows in (0, 1):
        motion = mechanism_motion(robot, ['left_crank', 'right_crank'], np.zeros(rows),
                                  q[None, [0, 2]][:rows], none[:rows], none[:rows])
        np.testing.assert_allclose(motion.q, q[None][:rows], atol=1e-12)


def test_demand_beyond_a_dead_point_names_the_time():
    """The rocker cannot drive the crank past the dead point, in line with coupler."""
    robot = Robot(four_bar_model(), constraints=[PIN], independent=['crank'],
                  configuration=at_angle(0.8))
    rocker = at_angle(0.8)[2]
    motion = Motion.from_points([0.0, 1.0], [[rocker], [rocker + 2.5]],
                                joint_names=['rocker'])
    with pytest.raises(LoopError, match=r'^closed loop .*: motion: at 0\.\d+ s: '):
        demand(robot, motion)


@pytest.mark.parametrize('joints',
                         [['left_crank', 'elbow'], ['left_crank', 'left_crank'],
                          ['left_crank', 'right_crank', 'right_crank']])
def test_unknown_and_repeated_driving_joints_are_refused_as_given(joints):
    with pytest.raises(InputError, match=str(joints).replace('[', r'\[')):
        driving_tracker(five_bar(), joints)
