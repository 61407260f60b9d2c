"""Every field of the result of `simulate` is true at its time, for every kind of mechanism."""

from dataclasses import replace

from kane_dynamics import absolute_rates, Robot, simulate
from kinds_of_mechanism import case, KINDS, PAIRS
from linkages import five_bar, five_bar_at, four_bar_model, PIN, sleigh
import numpy as np
import pytest
from trajectory_fields import check_fields, partial_rates

PRESSED = ('upper', 'crank', 'cart/x', 'craft/x')
EVERY_TIME = ('closed loop', 'flexible')  # of the pairs; compiling all takes minutes
SOME = [*((kind,) for kind in KINDS), EVERY_TIME, *(
    pytest.param(pair, marks=pytest.mark.slow) for pair in PAIRS if pair != EVERY_TIME)]


def torque_of(robot):
    """Return a torque of moderate size, other for each speed; modes have none."""
    return np.array([0.0 if 'mode' in name else 1.0 + k
                     for k, name in enumerate(robot.speed_names)])


@pytest.mark.parametrize('kinds', SOME, ids=' and '.join)
def test_every_field_is_that_of_the_definition(kinds):
    one = case(*kinds)
    torque = torque_of(one.robot)
    run = simulate(one.robot, one.q, one.u, 0.02, step=5e-4, t0=one.time, torque=torque)
    check_fields(one.robot, run, torque=torque)
    assert not run.stop_forces.any()


@pytest.mark.parametrize('kinds', SOME, ids=' and '.join)
def test_every_field_is_that_of_the_definition_with_a_pressed_joint(kinds):
    one = case(*kinds)
    robot = one.robot.copy()
    T = partial_rates(one.mechanism, one.q, one.time)
    moved = [name for name, row in zip(robot.joint_names, T) if np.abs(row).max() > 0.1]
    joint = next(name for name in PRESSED if name in moved)
    k = robot.joint_names.index(joint)
    place = robot.coordinate_names.index(joint)
    # An inelastic impact on the stop leaves the joint at rest.
    along = np.linalg.solve(robot.mass_matrix(one.q, **one.t), T[k])
    rate = robot.joint_rates(one.q, one.u, **one.t)[place]
    u = one.u - along * rate / (T[k] @ along)
    lower = robot.limits.lower.copy()
    lower[place] = one.q[place]
    robot.limits = replace(robot.limits, lower=lower)
    torque = -100.0 * T[k]
    run = simulate(robot, one.q, u, 0.001, step=1e-4, t0=one.time, torque=torque, stops=True)
    assert (run.stop_forces[1:, k] > 1.0).all()
    check_fields(robot, run, torque=torque)


CHANGING = {
    'four-bar': {}, 'kept rows': {'redundant': 'kept'}, 'absolute rates': {
        'speeds': absolute_rates}, 'actuated crank': {'actuated': ['crank']},
    'redundant actuators': {'actuated': {'crank': 1.0, 'rocker': 3.0}}}


@pytest.mark.parametrize('name', [
    'four-bar', 'kept rows',
    *(pytest.param(name, marks=pytest.mark.slow) for name in (
        'absolute rates', 'actuated crank', 'redundant actuators'))])
def test_fields_stay_those_of_the_users_speeds_after_speed_changes(name):
    robot = Robot(four_bar_model(bars=(0.5, 0.9, 0.5)), constraints=[PIN], **CHANGING[name])
    q = robot.closed_configuration((0.8, 0.0, -1.5))
    torque = np.array([2.0])
    run = simulate(robot, q, [1.0], 1.5, torque=torque, sample=0.01)
    assert run.speed_changes
    check_fields(robot, run, samples=40, torque=torque)


def test_fields_of_a_nonholonomic_body_are_right_after_speed_changes():
    robot = sleigh()
    torque = np.array([0.7, 0.1])
    run = simulate(robot, np.zeros(3), [0.3, 1.7], 3.0, torque=torque, sample=0.05)
    assert run.speed_changes
    check_fields(robot, run, samples=30, torque=torque)


def test_fields_are_right_after_speed_changes_with_a_joint_at_its_stop():
    robot = Robot(four_bar_model(bars=(0.5, 0.9, 0.5)), constraints=[PIN])
    q = robot.closed_configuration((0.8, 0.0, -1.5))
    robot.limits = replace(robot.limits, lower=np.array([-1.2, -np.inf, -np.inf]))
    run = simulate(robot, q, [1.0], 1.5, torque=np.array([2.0]), sample=0.01, stops=True)
    assert run.speed_changes
    assert run.stop_forces.any()
    check_fields(robot, run, samples=40)


@pytest.mark.parametrize('integrator', ['rk4', 'implicit'])
def test_accelerations_and_constraint_forces_of_pressed_stops(integrator):
    robot = five_bar('left_crank', 'right_crank').copy()
    q = five_bar_at(2.2, 0.9)
    robot.limits = replace(robot.limits, upper=np.array([2.2, np.inf, np.inf, np.inf]))
    run = simulate(robot, q, np.zeros(2), 0.05, torque=np.array([60.0, 5.0]), stops=True,
                   integrator=integrator, sample=0.005)
    assert (run.stop_forces[:, 0] < -1.0).all()
    assert np.abs(run.udot[:, 0]).max() < 1e-8
    check_fields(robot, run)


def test_batches_have_the_stop_forces_of_single_simulations():
    robot = case('tree').robot.copy()
    q = np.array([[0.4, -0.7], [0.39, -0.7]])
    robot.limits = replace(robot.limits, lower=np.array([0.39, -6.0]))
    u, torque = np.zeros((2, 2)), np.array([-40.0, 1.0])
    run = simulate(robot, q, u, 0.1, torque=torque, stops=True, sample=0.005)
    for k, (start, speed) in enumerate(zip(q, u)):
        alone = simulate(robot, start, speed, 0.1, torque=torque, stops=True, sample=0.005)
        np.testing.assert_allclose(run.stop_forces[k], alone.stop_forces, atol=1e-9)
        np.testing.assert_array_equal(run.state(k).stop_forces, run.stop_forces[k])
        check_fields(robot, run.state(k), torque=torque)
    assert run.stop_forces[1, 0, 0] > 1.0
