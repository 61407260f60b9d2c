"""Every field of a result of `simulate` is true at its time, for every mechanism."""

from dataclasses import replace

from kane_dynamics import (absolute_rates, ComputedTorque, longest_step, Motion, Robot,
                           simulate)
from kinds_of_mechanism import case, elastic_case, KINDS, PAIRS, torque_of
from linkages import five_bar, five_bar_at, four_bar_model, PIN, sleigh
import numpy as np
import pytest
from trajectory_fields import check_fields, partial_rates

PRESSED = ('upper', 'crank', 'cart/x', 'craft/x')
EVERY_TIME = ('closed loop', 'flexible')  # of the pairs; compiling all takes minutes
SOME = [*((kind,) for kind in KINDS), EVERY_TIME, *(
    pytest.param(pair, marks=pytest.mark.slow) for pair in PAIRS if pair != EVERY_TIME)]


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
    run = simulate(robot, one.q, u, 0.001, step=1e-4, t0=one.time, torque=torque,
                   stops=True)
    assert (run.stop_forces[1:, k] > 1.0).all()
    check_fields(robot, run, torque=torque)


def some_kinds(*every_time):
    """Return all kinds and pairs; those not of the quick run are marked slow."""
    return [kinds if kinds in every_time else pytest.param(kinds, marks=pytest.mark.slow)
            for kinds in (*((kind,) for kind in KINDS), *PAIRS)]


def with_friction(model, level):
    """Return a model with stronger friction in the joints that have some."""
    bodies = []
    for body in model.bodies:
        bodies.append(
            replace(body, joint=replace(body.joint, friction=level, stribeck_speed=0.2,
                                        breakaway_friction=1.1 * level))
            if body.joint.friction else body)
    return replace(model, bodies=tuple(bodies))


@pytest.mark.parametrize('integrator', [
    'rk4', pytest.param('implicit', marks=pytest.mark.slow)])
@pytest.mark.parametrize('kinds', some_kinds(('closed loop',)), ids=' and '.join)
def test_every_field_is_that_of_exact_friction(kinds, integrator):
    one = case(*kinds)
    # In motion throughout; coming to rest; at rest from nearly the beginning.
    for level in (0.2, 3.0, 40.0):
        robot = Robot(with_friction(one.robot.model, level),
                      **one.robot.options | {'configuration': one.q})
        torque = torque_of(robot)
        run = simulate(robot, one.q, 0.3 * one.u, 0.3, step=1e-3, t0=one.time,
                       torque=torque, sticking=True, integrator=integrator, sample=0.02)
        check_fields(robot, run, samples=16, tolerance=1e-7, torque=torque,
                     sticking=True)
        if level == 40.0:
            assert run.sticking.any()


@pytest.mark.slow
@pytest.mark.parametrize('sticking', [True, False], ids=['exact friction', 'smooth'])
@pytest.mark.parametrize('kinds', some_kinds(), ids=' and '.join)
def test_every_field_is_that_of_the_definition_with_elastic_joints(kinds, sticking):
    one = case(*kinds)
    robot, q = elastic_case(one)
    rows = []
    for name in robot.speed_names:
        rows.append(0.05 if 'mode' in name else 1.0)
    modes = np.array(rows)
    u = modes * np.random.default_rng(3).uniform(-0.5, 0.5, robot.n)
    torque = torque_of(robot)
    stable = longest_step(robot, q, t=one.time).step > 2.5e-4
    for integrator in ('rk4', 'implicit') if stable or sticking else ('implicit',):
        run = simulate(robot, q, u, 0.08, step=2.5e-4, t0=one.time, torque=torque,
                       sample=0.01, sticking=sticking, integrator=integrator)
        check_fields(robot, run, samples=9, tolerance=1e-7, torque=torque,
                     sticking=sticking)


@pytest.mark.parametrize('field',
                         ['udot', 'tau', 'energy', 'constraint_forces', 'sticking',
                          'constraint_residual', 'constraint_velocity_residual'])
def test_the_check_notices_a_wrong_field_of_exact_friction(field):
    one = case('closed loop')
    robot = Robot(with_friction(one.robot.model, 0.2),
                  **one.robot.options | {'configuration': one.q})
    run = simulate(robot, one.q, one.u, 0.01,
                   step=1e-3, torque=torque_of(robot), sticking=True)
    check_fields(robot, run, sticking=True)
    value = getattr(run, field)
    wrong = ~value if value.dtype == bool else value + 1e-3 * (1.0 + np.abs(value))
    with pytest.raises(AssertionError):
        check_fields(robot, replace(run, **{field: wrong}), sticking=True)


CHANGING = {
    'four-bar': {}, 'absolute rates': {'speeds': absolute_rates},
    'actuated crank': {'actuated': ['crank']},
    'redundant actuators': {'actuated': {'crank': 1.0, 'rocker': 3.0}}}


@pytest.mark.parametrize('name', [
    'four-bar',
    *(pytest.param(name, marks=pytest.mark.slow) for name in (
        'absolute rates', 'actuated crank', 'redundant actuators'))])
def test_fields_stay_those_of_the_users_speeds_through_singular_speeds(name):
    robot = Robot(four_bar_model(bars=(0.5, 0.9, 0.5)),
                  constraints=[PIN], **CHANGING[name])
    q = robot.closed_configuration((0.8, 0.0, -1.5))
    torque = np.array([2.0])
    run = simulate(robot, q, [1.0], 1.5, torque=torque, sample=0.01)
    check_fields(robot, run, samples=40, torque=torque)


def test_torques_and_accelerations_of_a_law_are_right_through_singular_speeds():
    robot = Robot(four_bar_model(bars=(0.5, 0.9, 0.5)), constraints=[PIN])
    q = robot.closed_configuration((0.8, 0.0, -1.5))
    free = simulate(robot, q, [1.0], 0.35, torque=np.array([2.0]), sample=0.05)
    motion = Motion.from_points(free.t, free.q[:, :1], joint_names=['crank'])
    law = ComputedTorque(robot, motion, 100.0, 20.0, followed=['crank'])
    run = simulate(robot, q, [1.0], 0.31, torque=law, sample=1e-3)
    # By differences, and from these by the user's robot alone; not at the points of the
    # motion, where the desired jerk jumps.
    udot = np.gradient(run.u[:, 0], run.t)[:, None]
    tau = robot.inverse_dynamics(run.q, run.u, udot)
    smooth = np.abs(run.t[:, None] - motion.times).min(axis=1) > 1.5e-3
    smooth[-1] = False
    for value, expected in ((run.udot, udot), (run.tau, tau)):
        np.testing.assert_allclose(value[smooth], expected[smooth], rtol=0.01, atol=0.01)


def test_fields_of_a_nonholonomic_body_are_right_through_singular_speeds():
    robot = sleigh()
    torque = np.array([0.7, 0.1])
    run = simulate(robot, np.zeros(3), [0.3, 1.7], 3.0, torque=torque, sample=0.05)
    check_fields(robot, run, samples=30, torque=torque)


def test_fields_are_right_through_singular_speeds_with_a_joint_at_its_stop():
    robot = Robot(four_bar_model(bars=(0.5, 0.9, 0.5)), constraints=[PIN])
    q = robot.closed_configuration((0.8, 0.0, -1.5))
    robot.limits = replace(robot.limits, lower=np.array([-1.2, -np.inf, -np.inf]))
    run = simulate(robot, q, [1.0], 1.5, torque=np.array([2.0]), sample=0.01, stops=True)
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
    u = np.zeros((2, 2))
    torque = np.array([-40.0, 1.0])
    run = simulate(robot, q, u, 0.1, torque=torque, stops=True, sample=0.005)
    for k, (start, speed) in enumerate(zip(q, u)):
        alone = simulate(robot, start, speed, 0.1,
                         torque=torque, stops=True, sample=0.005)
        np.testing.assert_allclose(run.stop_forces[k], alone.stop_forces, atol=1e-9)
        np.testing.assert_array_equal(run.state(k).stop_forces, run.stop_forces[k])
        check_fields(robot, run.state(k), torque=torque)
    assert run.stop_forces[1, 0, 0] > 1.0
