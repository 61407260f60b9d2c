"""The watch of constraints judges states; it does not change them."""

from copy import copy

from kane_dynamics import Robot
from kane_dynamics.robot.kernel_set import KernelSet
from kane_dynamics.simulation.step_kernels import state_layout, step_kernel
from linkages import at_angle, four_bar
import numpy as np
import pytest


def unwatched(robot):
    """Return a robot with the constraints of another one, whose kernels watch nothing."""
    other = Robot(robot.model, constraints=robot.mechanism.constraints,
                  independent=robot.speed_names)
    equations = copy(other.equations)
    equations.watched = False
    vars(other).update(equations=equations,
                       kernels=KernelSet(equations, None, other.parameters.block))
    return other


def state_after_a_step(robot, q, u, h):
    """Return q and u after a step without torque."""
    layout = state_layout(robot)
    state = np.ones(layout.size)
    state[layout.q], state[layout.u] = q, u
    after = np.empty((1, layout.size))
    constants = np.concatenate([[h], robot.parameters.block])
    step_kernel(robot, False).scan([state[None], np.zeros((1, 1, robot.n))], after,
                                   constants=constants)
    return after[0, layout.q], after[0, layout.u]


@pytest.mark.parametrize('angle', [0.4, 1.3])
def test_steps_without_the_watch_close_loops_too(angle):
    watched = four_bar('crank')
    q, u, h = at_angle(angle), np.array([6.0]), 0.02
    closed, rates = state_after_a_step(watched, q, u, h)
    same, same_rates = state_after_a_step(unwatched(watched), q, u, h)
    np.testing.assert_allclose(same, closed, atol=1e-14)
    np.testing.assert_allclose(same_rates, rates, rtol=1e-13)
    # Runge-Kutta alone leaves the loop open by far more.
    assert np.abs(watched.constraint_residual(closed)).max() < 1e-9
