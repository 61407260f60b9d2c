"""`kane-dynamics send` says which joints did not follow the motion."""

from types import SimpleNamespace

from kane_dynamics.cli.commands.send_command import did_not_follow, print_tracking
import numpy as np


def test_a_joint_that_rests_follows_unless_it_moves():
    # A spline through equal positions moves by rounding, and an arm holds by its
    # feedback.
    travel = np.array([0.3, 0.3, 0.0, 2e-16, 0.0])
    largest_error = np.array([1e-4, 0.2, 0.0, 4e-5, 0.05])
    lost = did_not_follow(travel, largest_error)
    assert lost.tolist() == [False, True, False, False, True]


def test_the_travel_of_a_joint_that_rests_is_zero(capsys):
    print_tracking(SimpleNamespace(states=100, joint_names=('a', 'b'),
                                   travel=np.array([0.3, 9e-16]),
                                   largest_error=np.array([1e-4, 2e-5]),
                                   commanders=('/arm/node', '/other')))
    printed = capsys.readouterr()
    _, _, moved, rests, holders, _ = printed.out.splitlines()
    assert holders == 'held by /arm/node, /other'
    assert '2 nodes command the arm; expected one' in printed.err
    assert moved.split() == ['a', '0.3', '0.0001']
    assert rests.split() == ['b', '0', '2e-05']
