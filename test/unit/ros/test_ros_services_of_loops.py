"""Services of machines with closed loops use the request's configuration."""

from functools import cache
from types import SimpleNamespace

from kane_dynamics import Closure, InputError, Robot
from linkages import at_angle, four_bar, four_bar_model, PIN
import numpy as np
import pytest

pytest.importorskip('rclpy')

from kane_dynamics.ros.services.joint_order import (  # noqa: E402, I100
    close_loops, MOST_MOVED)
from kane_dynamics.ros.services.service_calls import inverse_dynamics  # noqa: E402
from kane_dynamics_interfaces.srv import InverseDynamics  # noqa: E402

CRANK = 0.8  # rad


@cache
def branches():
    """Return the two closed configurations at one angle of the crank."""
    return at_angle(CRANK), four_bar('crank').closed_configuration((CRANK, -2.5, 2.0),
                                                                   fixed=['crank'])


@cache
def served():
    """Return the four-bar linkage with a given assembly mode, the first one."""
    return Robot(four_bar_model(), constraints=[PIN], independent=['crank'],
                 configuration=branches()[0])


@pytest.mark.parametrize('branch', [0, 1])
@pytest.mark.parametrize('turns', [0, 3])
def test_inverse_dynamics_is_that_of_the_requested_assembly_mode(branch, turns):
    q = branches()[branch] + (2.0 * np.pi * turns, 0.0, 0.0)
    response = InverseDynamics.Response()
    inverse_dynamics(SimpleNamespace(robot=served(), bending=None),
                     InverseDynamics.Request(
                         position=(q + (0.0, 1e-4, -1e-4)).tolist(), velocity=[0.5],
                         acceleration=[2.0]), response)
    expected = four_bar('crank').inverse_dynamics(branches()[branch], [0.5], [2.0])
    np.testing.assert_allclose(response.effort, [*expected, 0.0, 0.0],
                               rtol=1e-8, atol=1e-8)
    other_branch = four_bar('crank').inverse_dynamics(branches()[1 - branch], [0.5],
                                                      [2.0])
    assert abs(other_branch[0] - expected[0]) > 0.1


def test_independent_joints_keep_their_values():
    q = branches()[1] + (1e-3, 2e-3, -1e-3)
    closed = close_loops(served(), q)
    assert closed[0] == q[0]
    assert np.abs(served().constraint_residual(closed)).max() < 1e-11
    assert 0.0 < np.abs(closed - branches()[1]).max() < 0.01


def test_open_loops_are_refused_by_name():
    words = r"position: residual .* of constraint 'pin/.*at most 0\.01"
    with pytest.raises(InputError, match=words):
        close_loops(served(), branches()[0] + (0.0, 0.05, 0.0))


def test_loops_that_close_far_away_are_refused_though_their_residual_is_small():
    model = four_bar_model(bars=(0.3, 0.7, 0.605))
    ends = Closure('end', 'ground', 'spherical', name='pin')
    robot = Robot(model, constraints=[ends], independent=['crank'])
    closed = robot.closed_configuration((np.pi, -np.pi + 0.2, -0.4), fixed=['crank'])
    straight = np.array([np.pi, -np.pi, 0.0])  # near the dead point
    assert np.abs(closed - straight).max() > MOST_MOVED
    between = straight + 0.1 * (closed - straight)
    assert np.abs(robot.constraint_residual(between)).max() < 0.01
    with pytest.raises(InputError,
                       match=r"closing the loops moves 'rocker' by 0\.\d+ rad or m"):
        close_loops(robot, between)
