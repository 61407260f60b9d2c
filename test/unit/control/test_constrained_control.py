"""Computed torque and Controller under constraints and with chosen speeds."""

from functools import cache

from kane_dynamics import (absolute_rates, ComputedTorque, ConstraintError, Controller,
                           Inertial, InputError, Motion, Robot, simulate)
from kane_dynamics.control.terms import Terms
from kane_dynamics.mechanics.definition import kane
from linkages import (five_bar, five_bar_at, five_bar_partial_rates, four_bar_model, PIN,
                      sleigh)
from mechanisms import random_model
import numpy as np
import pytest

KP = 100.0
KD = 25.0


def at_zero(function, h=5e-3):
    """Return value, rate and acceleration at 0 by differences of order 6."""
    f = {k: function(k * h) for k in range(-3, 4)}
    rate = (45 * (f[1] - f[-1]) - 9 * (f[2] - f[-2]) + (f[3] - f[-3])) / (60 * h)
    twice = (270 * (f[1] + f[-1]) - 27 * (f[2] + f[-2]) + 2 * (f[3] + f[-3])
             - 490 * f[0]) / (180 * h**2)
    return f[0], rate, twice


@cache
def five_bar_motion():
    """Return a motion of the cranks."""
    return Motion.from_points([0.0, 0.6, 1.2], [[2.0, 1.1], [2.3, 0.8], [1.8, 0.9]],
                              joint_names=['left_crank', 'right_crank'])


def decayed(t, error, rate, kp=KP, kd=KD):
    """Return e(t) of e'' + kd e' + kp e = 0."""
    slow, fast = np.roots([1.0, kd, kp])
    a = (rate - fast * error) / (slow - fast)
    return np.real(np.multiply.outer(np.exp(slow * t), a)
                   + np.multiply.outer(np.exp(fast * t), error - a))


@pytest.mark.parametrize('actuated', [('left_crank', 'right_crank'),
                                      ('left_crank', 'left_bar', 'right_crank')])
def test_the_errors_of_a_five_bar_decay_as_the_gains_say(actuated):
    robot = five_bar(*actuated)
    motion = five_bar_motion()
    q0 = five_bar_at(2.1, 1.05)
    u0 = np.array([0.3, -0.2])
    run = simulate(robot, q0, u0, 1.0, torque=ComputedTorque(robot, motion, KP, KD),
                   sample=0.02)
    assert not run.warnings
    q_d, u_d, _ = motion.sample(run.t)
    error = q_d - run.q[:, [0, 2]]
    expected = decayed(run.t, error[0], u_d[0] - u0)
    np.testing.assert_allclose(error, expected, atol=1e-6 * np.abs(error).max())


@pytest.mark.parametrize('follows', [['rocker'], ['coupler']])
def test_any_joint_of_a_four_bar_may_follow_whatever_the_independent_speed(follows):
    robot = Robot(four_bar_model(), constraints=[PIN], friction=False,
                  independent=['crank'])
    k = robot.joint_names.index(follows[0])
    q0 = robot.closed_configuration((1.2, 0.0, -1.5), fixed=['crank'])
    motion = Motion.from_points([0.0, 0.5, 1.0],
                                q0[k] + np.array([[0.05], [0.2], [-0.1]]),
                                joint_names=follows)
    run = simulate(robot, q0, [0.2], 0.8, torque=ComputedTorque(robot, motion, KP, KD),
                   sample=0.02)
    q_d, u_d, _ = motion.sample(run.t)
    error = q_d[:, 0] - run.q[:, k]
    rate = u_d[0, 0] - robot.joint_rates(q0, [0.2])[k]
    np.testing.assert_allclose(error, decayed(run.t, error[0], rate),
                               atol=1e-6 * np.abs(error).max())


def test_a_body_on_a_runner_follows_in_its_independent_joints():
    robot = sleigh()
    names = robot.speed_names
    motion = Motion.from_points([0.0, 1.0], [[0.1] * 2, [0.5] * 2], joint_names=names)
    run = simulate(robot, np.zeros(3), [0.1, 0.2], 0.8, sample=0.02,
                   torque=ComputedTorque(robot, motion, KP, KD))
    places = [robot.joint_names.index(name) for name in names]
    q_d, u_d, _ = motion.sample(run.t)
    error = q_d - run.q[:, places]
    np.testing.assert_allclose(error, decayed(run.t, error[0], u_d[0] - [0.1, 0.2]),
                               atol=1e-6)


def test_many_simulations_follow_as_each_alone_does():
    robot = five_bar()
    motion = five_bar_motion()
    q0 = np.array([five_bar_at(2.1, 1.05), five_bar_at(1.9, 1.2)])
    u0 = np.array([[0.3, -0.2], [0.0, 0.1]])
    law = ComputedTorque(robot, motion, KP, KD)
    many = simulate(robot, q0, u0, 0.2, torque=law)
    for k in range(2):
        alone = simulate(robot, q0[k], u0[k], 0.2, torque=law)
        for name in ('q', 'u', 'tau'):
            np.testing.assert_allclose(getattr(many, name)[k], getattr(alone, name),
                                       rtol=1e-9, atol=1e-9)


def controllers(robot, tree, **settings):
    return Controller(robot, **settings), Controller(tree, **settings)


@pytest.mark.parametrize('mode',
                         ['inverse_dynamics', 'computed_torque', 'gravity_compensation'])
@pytest.mark.parametrize('terms', [Terms(), Terms(gravity=False, inertia=False),
                                   Terms(coriolis=False, friction=False)])
def test_joint_torques_do_not_depend_on_the_choice_of_speeds(mode, terms):
    model = random_model(11, 4)
    robot = Robot(model, speeds=absolute_rates(model))
    tree = Robot(model)
    chosen, plain = controllers(robot, tree, mode=mode, compensate=terms, kp=KP, kd=KD)
    motion = Motion.from_points([0.0, 1.0],
                                np.random.default_rng(0).normal(size=(2, 4)) * 0.4,
                                joint_names=model.joint_names)
    rng = np.random.default_rng(1)
    q, qdot = rng.normal(size=(2, 4))
    u = np.array(robot.mechanism.state(q).speed_rows(robot.speed_names)[0],
                 dtype=float) @ qdot
    external = np.array([0.1, 0.2, -0.3, 0.4])
    dual = robot.generalized_force(external, q)
    for desired, known in ((None, True), (motion, mode != 'inverse_dynamics')):
        torques = chosen.command(0.3, q, u, desired,
                                 external=dual if known else None).tau
        expected = plain.command(0.3, q, qdot, desired,
                                 external=external if known else None).tau
        np.testing.assert_allclose(torques, expected,
                                   atol=1e-11 * np.abs(expected).max() + 1e-11)


@pytest.mark.parametrize('everything', [False, True])
def test_the_feedforward_of_a_five_bar_is_that_of_the_definition(everything):
    robot = five_bar('left_crank', 'right_crank')
    motion = five_bar_motion()
    stated_motion = motion
    if everything:  # a fine table of all joints
        times = np.linspace(0.0, 1.2, 241)
        stated_motion = Motion.from_points(
            times, [five_bar_at(*row) for row in motion.sample(times)[0]],
            joint_names=robot.joint_names)
    control = Controller(robot)
    for t in np.linspace(0.1, 1.1, 11):
        q_c, u_c, udot_c = stated_motion.sample(t)
        cranks = [0, 2] if everything else [0, 1]

        def pose(s, at=q_c, rate=u_c, twice=udot_c, cranks=cranks):
            return five_bar_at(*(at + s * rate + 0.5 * s**2 * twice)[cranks])
        q, qdot, qddot = at_zero(pose)
        force = five_bar_partial_rates(q).T @ kane.inverse_dynamics(
            robot.model, q, qdot, qddot, friction=False)
        torques = control.command(t, five_bar_at(2.0,
                                                 1.0), [0.0, 0.0], stated_motion).tau
        np.testing.assert_allclose(torques[[0, 2]], force, rtol=0.0,
                                   atol=1e-9 * np.abs(force).max())
        assert not torques[[1, 3]].any()


def test_actuators_share_by_norm_weight_and_preload():
    names = ('left_crank', 'left_bar', 'right_crank')
    q = five_bar_at(2.0, 1.0)
    u = np.zeros(2)
    tau = {}
    T = five_bar_partial_rates(q)[:3]
    motion = five_bar_motion()
    plain = five_bar(*names)
    heavy = five_bar(*names, weights=(1.0, 9.0, 1.0))
    desired = np.array([1.0, -2.0, 3.0, 0.0])
    tau['norm'] = Controller(plain, mode='computed_torque').command(
        0.2, q, u, motion).tau
    tau['weight'] = Controller(heavy, mode='computed_torque').command(
        0.2, q, u, motion).tau
    tau['preload'] = Controller(plain, mode='computed_torque', preload=desired).command(
        0.2, q, u, motion).tau
    force = T.T @ tau['norm'][:3]
    np.testing.assert_allclose(tau['norm'][:3], np.linalg.pinv(T.T) @ force, atol=1e-10)
    W = np.diag([1.0, 9.0, 1.0])
    np.testing.assert_allclose(
        tau['weight'][:3],
        np.linalg.solve(W, T) @ np.linalg.solve(T.T @ np.linalg.solve(W, T), force),
        atol=1e-10)
    np.testing.assert_allclose(
        tau['preload'][:3],
        desired[:3] + np.linalg.pinv(T.T) @ (force - T.T @ desired[:3]), atol=1e-10)
    for torques in tau.values():
        assert torques[3] == 0.0
        np.testing.assert_allclose(plain.generalized_force(torques, q), force,
                                   atol=1e-10)


@pytest.mark.parametrize('mode',
                         ['computed_torque', 'gravity_compensation', 'inverse_dynamics'])
def test_a_singular_configuration_of_the_actuation_is_an_error_and_no_huge_torque(mode):
    robot = Robot(four_bar_model(), constraints=[PIN], actuated=['rocker'],
                  independent=['crank'])
    control = Controller(robot, mode=mode)
    # The rate of the rocker changes its sign between these crank angles.
    low = 2.9
    high = 3.3

    def pose(angle):
        return robot.closed_configuration((angle, 0.0, -1.5), fixed=['crank'])
    first = robot.joint_rates(pose(low), [1.0])[2]
    while high - low > 1e-12:
        middle = 0.5 * (low + high)
        same = robot.joint_rates(pose(middle), [1.0])[2] * first > 0.0
        low, high = (middle, high) if same else (low, middle)
    assert np.abs(control.command(0.0, pose(2.5), [0.0]).tau).max() < 1e3
    with pytest.raises(ConstraintError,
                       match='actuated: rocker cannot produce every motion'):
        control.command(0.1, pose(low), [0.0])
    with pytest.raises(ConstraintError, match='singular configuration of the actuation'):
        robot.joint_torques([1.0], pose(low))
    motion = Motion.from_points([0.0, 1.0], [[2.5], [low]], joint_names=['crank'])
    with pytest.raises(ConstraintError, match=r'simulation, 0\.9.*actuated: rocker'):
        simulate(robot, pose(2.5), [0.0], 1.0,
                 torque=ComputedTorque(robot, motion, KP, KD))


def test_payload_gravity_and_effort_limits_act_as_for_trees():
    model = four_bar_model()
    robot = Robot(model, constraints=[PIN], actuated=['crank'], independent=['crank'],
                  payload_frame='middle')
    q = robot.closed_configuration((1.2, 0.0, -1.5), fixed=['crank'])
    control = Controller(robot, mode='gravity_compensation',
                         effort_limit=[2.0, 9.0, 9.0])
    light = robot.joint_torques(robot.gravity_force(q), q)
    robot.parameters.payload = Inertial(3.0, [0.0, 0.0, 0.0])
    J = robot.jacobian('middle', q)[2, 0]
    heavy = robot.joint_torques(robot.gravity_force(q), q)
    np.testing.assert_allclose(heavy[0] - light[0], 3.0 * 9.81 * J, rtol=1e-3)
    command = control.command(0.0, q)
    assert command.tau[0] == np.clip(heavy[0], -2.0, 2.0) and not command.tau[1:].any()
    assert command.limited == (abs(heavy[0]) > 2.0)


def test_without_a_motion_the_first_configuration_is_held():
    robot = five_bar('left_crank', 'right_crank')
    control = Controller(robot, mode='computed_torque', kp=KP, kd=KD)
    q0 = five_bar_at(2.0, 1.0)
    control.command(0.0, q0, [0.0, 0.0])
    run = simulate(robot, five_bar_at(2.05, 0.97), [0.1, 0.0], 1.0, step=1e-3,
                   torque=lambda t, q, u: robot.generalized_force(
                       control.command(t, q, u).tau, q))
    assert np.abs(run.q[-1] - q0).max() < 1e-3


def test_a_motion_or_controller_that_does_not_fit_the_loop_is_refused_with_the_reason():
    robot = five_bar()
    closed = np.array([five_bar_at(2.0, 1.0), five_bar_at(2.1, 1.0)])

    def motion(names, rows=closed):
        return Motion.from_points([0.0, 1.0], np.asarray(rows)[:, :len(names)],
                                  joint_names=names)
    for call, words in (
            (lambda: ComputedTorque(robot, motion(['left_crank'])),
             'motion: of the joints'),
            (lambda: ComputedTorque(robot, motion(robot.joint_names, closed + 0.1)),
             'residual of .* in point'),
            (lambda: ComputedTorque(robot, motion(robot.joint_names),
                                    followed=['tip', 'x']), 'expected 2 of the joints'),
            (lambda: Controller(robot, followed=['left_crank']), 'followed:'),
            (lambda: Controller(robot, preload=np.zeros(4)), 'preload:'),
            (lambda: Controller(five_bar('left_crank', 'right_crank'),
                                preload=np.ones(4)), 'preload:'),
            (lambda: Controller(Robot(random_model(1, 2)), preload=np.ones(2)),
             'preload'),
            (lambda: simulate(robot, closed[0], [0.0, 0.0], 0.1,
                              torque=with_deprecated_order(motion)),
             r'expected ComputedTorque\(robot'),
            (lambda: Controller(sleigh()).command(
                0.0, np.zeros(3), np.zeros(2),
                Motion.from_points([0.0, 1.0], np.zeros((2, 2)), joint_names=sleigh(
                ).speed_names)), 'constraint on velocities leaves the configuration')):
        with pytest.raises(InputError, match=words):
            call()
    with pytest.raises(ConstraintError, match=r"actuated: weight -1\.0 of 'left_crank'"):
        five_bar('left_crank', 'right_crank', weights=(-1.0, 1.0))


def with_deprecated_order(motion):
    with pytest.warns(DeprecationWarning, match='deprecated'):
        return ComputedTorque(
            motion(['left_crank', 'left_bar', 'right_crank', 'right_bar']))


def test_computed_torque_of_a_tree_with_wrench_frames():
    model = random_model(5, 3)
    motion = Motion.from_points([0.0, 0.1], np.zeros((2, 3)),
                                joint_names=model.joint_names)
    runs = []
    for robot in (Robot(model), Robot(model, wrench_frames=['frame2'])):
        runs.append(simulate(robot, [0.1, 0.2, 0.3], np.zeros(3), 0.05,
                             torque=ComputedTorque(robot, motion, KP, KD)))
    np.testing.assert_allclose(runs[1].tau, runs[0].tau, rtol=1e-12)


def test_refusals_are_named_with_wrench_frames_too():
    tree = Controller(Robot(random_model(5, 3), wrench_frames=['frame2']),
                      mode='computed_torque', kp=1e300)
    motion = Motion.from_points([0.0, 1.0], np.full((2, 3), 1e200),
                                joint_names=tree.robot.joint_names)
    with pytest.raises(InputError,
                       match='not finite'), pytest.warns(UserWarning, match='degrees'):
        tree.command(0.5, np.zeros(3), np.zeros(3), motion)
    control = Controller(five_bar(wrench_frames=('left_tip',)), mode='computed_torque')
    with pytest.raises(ConstraintError, match='residual'):
        control.command(0.0, five_bar_at(2.0, 1.0) + 0.1, [0.0, 0.0])


def test_a_motion_is_followed_where_the_independent_speeds_change():
    robot = sleigh()
    u0 = np.array([0.1, 0.2])
    motion = Motion.from_points([0.0, 1.0, 2.0], [[0.0, 0.5], [0.6, 1.4], [1.5, 2.3]],
                                joint_names=['body/y', 'body/rz'])
    run = simulate(robot, [0.0, 0.0, 0.5], u0, 2.0, sample=0.02,
                   torque=ComputedTorque(robot, motion, KP, KD))
    assert not run.warnings
    q_d, u_d, _ = motion.sample(run.t)
    error = q_d - run.q[:, 1:]
    expected = decayed(run.t, error[0], u_d[0] - [0.1 * np.tan(0.5), 0.2])
    np.testing.assert_allclose(error, expected, atol=1e-6 * np.abs(error).max())
