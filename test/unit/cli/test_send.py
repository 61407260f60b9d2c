"""`kane-dynamics send` says which joints did not follow the motion."""

from kane_dynamics.cli.commands.send_command import did_not_follow
import numpy as np


def test_a_joint_that_rests_follows_unless_it_moves():
    # A spline through equal positions moves by rounding, and an arm holds by its
    # feedback.
    travel = np.array([0.3, 0.3, 0.0, 2e-16, 0.0])
    largest_error = np.array([1e-4, 0.2, 0.0, 4e-5, 0.05])
    lost = did_not_follow(travel, largest_error)
    assert lost.tolist() == [False, True, False, False, True]
