"""Two steppers find the same transitions between sticking and sliding."""

from kane_dynamics import Robot, simulate
from kinds_of_mechanism import case, KINDS, torque_of
import numpy as np
import pytest
from test_trajectory_fields import with_friction

EVERY_TIME = ('closed loop', 'flexible')


@pytest.mark.parametrize('integrator', ['rk4', 'implicit'])
@pytest.mark.parametrize('kind', [
    kind if kind in EVERY_TIME else pytest.param(kind, marks=pytest.mark.slow)
    for kind in KINDS])
def test_both_steppers_have_the_same_transitions_of_friction(kind, integrator):
    one = case(kind)
    # Both have the error of the integrator, of order four and two.
    error = {'rk4': 1e-9, 'implicit': 1e-8}[integrator]
    for level in (0.2, 3.0, 40.0):
        robot = Robot(with_friction(one.robot.model, level),
                      **one.robot.options | {'configuration': one.q})
        old, new = (simulate(robot, one.q, 0.3 * one.u, 0.3, t0=one.time, sample=0.02,
                             torque=torque_of(robot), sticking=True, _stepper=stepper,
                             integrator=integrator) for stepper in ('old', 'rows'))
        np.testing.assert_allclose(new.q, old.q, atol=error)
        np.testing.assert_allclose(new.u, old.u, atol=10.0 * error)
        np.testing.assert_array_equal(new.sticking, old.sticking)
