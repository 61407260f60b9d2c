"""The watch of constraints judges states; it does not change them."""

from copy import copy

from kane_dynamics import Robot
from kane_dynamics.robot.kernel_set import KernelSet
from kane_dynamics.simulation.step_kernels import state_layout, step_kernel
from linkages import at_angle, four_bar
import numpy as np
import pytest


def unwatched(robot):
    """Return a robot with another one's constraints and unwatched kernels."""
    other_robot = Robot(robot.model, constraints=robot.mechanism.constraints,
                        independent=robot.speed_names)
    equations = copy(other_robot.equations)
    equations.watched = False
    vars(other_robot).update(
        equations=equations,
        kernels=KernelSet(equations, None, other_robot.parameters.block))
    return other_robot


def state_after_a_step(robot, q, u, h):
    """Return q and the joint rates after a step without torque."""
    layout = state_layout(robot)
    state = np.ones(layout.size)
    state[layout.q] = q
    state[layout.v] = robot.joint_rates(q, u)
    state_after = np.empty((1, layout.size))
    constants = np.concatenate([[h], robot.parameters.block])
    step_kernel(robot, False).scan([state[None], np.zeros((1, 1, robot.n))], state_after,
                                   constants=constants)
    return state_after[0, layout.q], state_after[0, layout.v]


@pytest.mark.parametrize('angle', [0.4, 1.3])
def test_steps_without_the_watch_close_loops_too(angle):
    watched = four_bar('crank')
    q = at_angle(angle)
    u = np.array([6.0])
    h = 0.02
    closed, rates = state_after_a_step(watched, q, u, h)
    same, same_rates = state_after_a_step(unwatched(watched), q, u, h)
    np.testing.assert_allclose(same, closed, atol=1e-14)
    np.testing.assert_allclose(same_rates, rates, rtol=1e-13)
    # Runge-Kutta alone leaves the loop open by far more.
    assert np.abs(watched.constraint_residual(closed)).max() < 1e-9
