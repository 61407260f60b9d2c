"""A change of the control law: the torque goes on from the last command."""

import math

from kane_dynamics import Controller, InputError, load_urdf, Mode, Motion, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.control.torque_blend import TorqueBlend
import numpy as np
import pytest

ROBOT = Robot(load_urdf(resource_path('urdf', 'two_link.urdf')))
Q = np.array([0.3, -0.2])
U = np.array([0.1, 0.4])
STEP = 0.001


class ConstantLaw:
    """The law of a mode whose torque is given."""

    pose = None

    def __init__(self, tau):
        self.tau = np.array(tau)
        self.restarts = 0

    def restart(self):
        self.restarts += 1

    def torque(self, q, u, motion, moment, t):
        return self.tau


def commands(controller, count, first=0, **arguments):
    """Return the torques at successive stamps."""
    return np.array([controller.command(STEP * (first + k), Q, U, **arguments).tau
                     for k in range(count)])


def controller(blend_time=0.1, **settings):
    laws = {Mode.JOINT_IMPEDANCE: ConstantLaw([3.0, -1.0]),
            Mode.CARTESIAN_IMPEDANCE: ConstantLaw([0, 0])}
    return Controller(ROBOT, blend_time=blend_time, laws=laws, **settings)


@pytest.mark.parametrize('first',
                         ['computed_torque', 'joint_impedance', 'gravity_compensation'])
@pytest.mark.parametrize('second',
                         ['joint_impedance', 'cartesian_impedance', 'inverse_dynamics'])
def test_a_change_of_mode_is_continuous_and_ends_at_the_new_law(first, second):
    motion = Motion.from_points([0.0, 2.0], [[0.0, 0.0], [1.0, -1.0]],
                                joint_names=ROBOT.joint_names)
    control = controller(mode=first, kp=400.0)
    follows = motion if Mode(first).follows_motions else None
    torque_before = commands(control, 20, motion=follows)[-1]
    control.update(mode=second)
    torque_after = commands(control, 150, first=20)
    np.testing.assert_allclose(torque_after[0], torque_before, rtol=0, atol=1e-12)
    alone = controller(mode=second).command(0.0, Q, U).tau
    np.testing.assert_allclose(torque_after[101:], np.broadcast_to(alone, (49, 2)),
                               rtol=1e-12)
    # The slope of the cubic is at most 1.5 times the difference over the time.
    largest = 1.5 * np.abs(torque_before - alone) / 0.1 * STEP
    assert (np.abs(np.diff(torque_after, axis=0)) <= largest + 1e-9).all()


def test_a_change_of_gains_is_continuous():
    control = controller(mode='computed_torque', kp=100.0)
    control.command(0.0, Q, U)  # the pose that is held
    moved = Q + 0.1
    torque_before = control.command(STEP, moved, U).tau
    control.update(kp=900.0)
    np.testing.assert_allclose(control.command(2 * STEP, moved, U).tau, torque_before,
                               atol=1e-12)
    control.update(kp=900.0)  # no change: no new beginning
    late = control.command(0.2, moved, U).tau
    expected = Controller(ROBOT, mode='computed_torque', kp=900.0)
    expected.command(0.0, Q, U)
    np.testing.assert_array_equal(late, expected.command(0.2, moved, U).tau)


def test_without_blend_time_a_new_law_acts_at_once():
    control = controller(blend_time=0.0)
    commands(control, 3)
    control.update(mode='joint_impedance')
    assert control.command(0.01, Q, U).tau.tolist() == [3.0, -1.0]


def test_the_limits_act_after_the_blend():
    control = controller(effort_limit=2.0, rate_limit=1.0)
    commands(control, 3)
    control.update(mode='joint_impedance')
    torques = commands(control, 4000, first=3)
    assert np.abs(np.diff(torques, axis=0)).max() <= 1.0 * STEP * (1 + 1e-9)
    assert torques[-1].tolist() == [2.0, -1.0]


def test_a_stop_ends_a_blend_and_restarts_the_law():
    control = controller(mode='joint_impedance')
    commands(control, 2)
    control.update(mode='cartesian_impedance')
    law = control.laws[Mode.CARTESIAN_IMPEDANCE]
    assert law.restarts == 1
    control.stop()
    assert law.restarts == 2
    assert control.command(0.01, Q, U).tau.tolist() == [0.0, 0.0]


def test_a_refused_state_does_not_spoil_a_blend():
    blend = TorqueBlend()
    blend.duration = 1.0
    blend.begin()
    last = np.array([1.0, 2.0])
    assert np.isnan(blend.apply(0.0, np.array([np.nan, 0.0]), last)).any()
    np.testing.assert_array_equal(blend.apply(0.1, np.zeros(2), last), last)


def test_a_clock_that_jumps_back_begins_the_blend_again():
    blend = TorqueBlend()
    blend.duration = 1.0
    blend.begin()
    last = np.array([1.0, 2.0])
    blend.apply(50.0, np.zeros(2), last)
    np.testing.assert_array_equal(blend.apply(3.0, np.zeros(2), last), last)
    assert blend.apply(3.5, np.zeros(2), last).tolist() == [0.5, 1.0]
    assert blend.apply(4.0, np.zeros(2), last).tolist() == [0.0, 0.0]
    assert not blend.active


def test_a_mode_without_a_law_is_refused():
    with pytest.raises(InputError, match=r'mode: .cartesian_impedance.; expected one of '
                       'inverse_dynamics, computed_torque, gravity_compensation'):
        Controller(ROBOT, mode='cartesian_impedance')


@pytest.mark.parametrize('value', [-1.0, math.nan, math.inf])
def test_an_invalid_blend_time_is_refused(value):
    with pytest.raises(InputError, match=r'blend_time: .*; expected a finite time'):
        Controller(ROBOT, blend_time=value)
