"""Joint stops of simulate: rigid, inelastic impacts in admissible motions."""

from dataclasses import replace
from functools import cache
import warnings

from kane_dynamics import (absolute_rates, ComputedTorque, ConstraintError, InputError,
                           load_urdf, ModelBuilder, Motion, point_mass, Prescribed,
                           Robot, simulate, Trajectory)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.mechanics.definition import kane
from kane_dynamics.simulation.stepper import RowSteps
from linkages import (five_bar, five_bar_at, five_bar_partial_rates, four_bar_model, PIN,
                      sleigh)
from mechanisms import random_model
import numpy as np
import pytest

FREE = 1e9


def stopped(robot, **limits):
    """Return a copy of a robot with stops (lower, upper) of named joints."""
    other_robot = robot.copy()
    lower, upper = np.full((2, robot.n_q), FREE) * [[-1.0], [1.0]]
    for name, (low, high) in limits.items():
        k = robot.joint_names.index(name)
        lower[k] = low
        upper[k] = high
    other_robot.limits = replace(robot.limits,
                                 lower=np.where(lower == -FREE, -np.inf, lower),
                                 upper=np.where(upper == FREE, np.inf, upper))
    return other_robot


@cache
def tree(friction=False, chosen=False):
    model = random_model(4, 3, prismatic=0.0, branching=0.0)
    speeds = {'speeds': absolute_rates(model)} if chosen else {}
    return stopped(Robot(model, friction=friction, **speeds), joint0=(-0.4, 0.5),
                   joint1=(-0.3, 0.6))


@cache
def four_bar():
    return Robot(four_bar_model(), constraints=[PIN], independent=['crank'],
                 friction=False)


def impact(M, J, rows, qdot):
    """Return the rates after an inelastic impact on rows, by the full system."""
    held = np.concatenate([J, rows])
    n = len(M)
    m = len(held)
    K = np.block([[M, held.T], [held, np.zeros((m, m))]])
    return np.linalg.solve(K, np.concatenate([M @ qdot, np.zeros(m)]))[:n]


def test_an_arm_rests_on_its_stops_and_the_balance_counts_what_was_lost():
    robot = tree()
    run = simulate(robot, [0.1, 0.2, 0.3], [1.0, -2.0, 0.5], 1.5,
                   stops=True, sample=1e-3)
    assert run.stop_events and not run.warnings
    assert {event.limit for event in run.limit_events} <= {'velocity'}
    lower = robot.limits.lower
    upper = robot.limits.upper
    assert (run.q >= lower).all() and (run.q <= upper).all()
    total = run.energy.sum(axis=1)
    assert (np.diff(total) <= 1e-4).all(), 'stops take energy'
    lost = sum(event.loss for event in run.stop_events)
    assert 0.9 * (total[0] - total[-1]) < lost < 1.1 * (total[0] - total[-1])
    assert all(event.speed > 0.0 and event.loss > -1e-9 for event in run.stop_events)


def test_the_balance_would_warn_of_an_impact_that_is_not_counted(monkeypatch):
    monkeypatch.setattr(RowSteps, 'settle', lambda *_: ())
    with pytest.warns(UserWarning, match='energy balance'):
        simulate(tree(friction=True), [0.1, 0.2, 0.3], [1.0, -2.0, 0.5], 1.0, stops=True)


@pytest.mark.parametrize('torque', ['held', 'function', 'computed torque'])
def test_a_joint_that_is_pressed_against_its_stop_stays_there_without_a_warning(torque):
    robot = stopped(tree(), joint0=(-0.4, 0.5), joint1=(-0.3, 0.6), joint2=(-1.0, 0.7))
    q0 = [0.1, 0.2, 0.3]
    end = [0.5, 0.6, 0.7]
    motion = Motion.from_points([0.0, 0.2], [q0, [0.9, 1.5, 2.0]],
                                joint_names=robot.joint_names)
    source = {'held': [80.0, 40.0,
                       20.0], 'function': lambda *_: np.array([80.0, 40.0, 20.0]),
              'computed torque': ComputedTorque(robot, motion)}[torque]
    run = simulate(robot, q0, np.zeros(3), 0.6, stops=True, torque=source)
    assert not run.warnings
    assert {e.joint for e in run.stop_events} == set(robot.joint_names)
    np.testing.assert_allclose(run.q[-1], end, atol=1e-12)
    np.testing.assert_allclose(run.u[-1], 0.0, atol=1e-12)


def test_chosen_speeds_hit_the_stops_of_the_tree():
    plain = tree()
    chosen = tree(chosen=True)
    q0 = np.array([0.1, 0.2, 0.3])
    qdot = np.array([1.0, -2.0, 0.5])
    Y = np.array(chosen.mechanism.state(q0).speed_rows(chosen.speed_names)[0],
                 dtype=float)
    one = simulate(plain, q0, qdot, 0.3, stops=True, sample=0.01)
    other_run = simulate(chosen, q0, Y @ qdot, 0.3, stops=True, sample=0.01)
    assert not other_run.warnings
    assert [(e.joint, e.limit) for e in other_run.stop_events] == [
        (e.joint, e.limit) for e in one.stop_events] != []
    np.testing.assert_allclose(other_run.q, one.q, atol=1e-10)


def test_the_impact_of_a_five_bar_is_projected_and_loses_the_energy_of_the_jump():
    q0 = five_bar_at(2.0, 1.1)
    robot = stopped(five_bar(), left_bar=(-FREE, q0[1] + 1e-7))
    T = five_bar_partial_rates(q0)
    u0 = np.array([1.0, 0.7]) * np.sign(T[1] @ [1.0, 0.7])
    M = kane.mass_matrix(robot.model, q0)
    J = np.linalg.svd(T.T)[2][2:]  # rows that admit the columns of T alone
    expected = impact(M, J, np.eye(4)[[1]], T @ u0)
    run = simulate(robot, q0, u0, 1e-5, step=1e-6, stops=True)
    np.testing.assert_allclose(run.u[-1], expected[[0, 2]], rtol=1e-3)
    jump = T @ u0 - expected
    assert len(run.stop_events) == 1
    event = run.stop_events[0]
    np.testing.assert_allclose(event.loss, 0.5 * jump @ M @ jump, rtol=1e-3)
    np.testing.assert_allclose(event.speed, T[1] @ u0, rtol=1e-3)
    assert (event.joint, event.limit) == ('left_bar', 'upper')


def test_the_impact_of_a_body_on_a_runner_is_projected():
    names = sleigh().joint_names
    q0 = np.array([0.0, 0.0, 0.5])
    speed = 2.0
    free = Robot(sleigh().model, constraints=sleigh()._choices['constraints'],
                 independent=[names[0], names[2]])
    robot = stopped(free, **{names[0]: (-FREE, 1e-7)})
    qdot = np.array([speed * np.cos(0.5), speed * np.sin(0.5), 0.8])
    J = np.array([[-np.sin(0.5), np.cos(0.5), 0.0]])
    expected = impact(kane.mass_matrix(robot.model, q0), J, np.eye(3)[[0]], qdot)
    run = simulate(robot, q0, qdot[[0, 2]], 1e-5, step=1e-6, stops=True)
    np.testing.assert_allclose(run.u[-1], expected[[0, 2]], atol=1e-4)
    assert [event.joint for event in run.stop_events] == [names[0]]


def test_a_four_bar_rests_with_a_dependent_joint_at_its_stop_and_two_stops_share():
    robot = four_bar()
    q0 = robot.closed_configuration((0.5, 0.0, -1.5), fixed=['crank'])
    one = stopped(robot, rocker=(-FREE, q0[2] + 0.3))
    run = simulate(one, q0, [2.0], 0.6, stops=True, torque=[5.0])
    assert not run.warnings and len(run.stop_events) == 1 and run.drift < 1e-12
    np.testing.assert_allclose(run.q[-1, 2], q0[2] + 0.3, atol=1e-10)
    np.testing.assert_allclose(run.u[-1], 0.0, atol=1e-10)
    both = stopped(robot, rocker=(-FREE, q0[2]), crank=(-FREE, q0[0]))
    run = simulate(both, q0, [2.0], 0.05, stops=True, torque=[50.0])
    assert not run.warnings and {e.joint for e in run.stop_events} == {'crank', 'rocker'}
    np.testing.assert_allclose(run.q[-1], q0, atol=1e-9)


@pytest.mark.parametrize('independent', ['crank', 'coupler'])
def test_computed_torque_against_a_stop_of_a_closed_loop(independent):
    robot = Robot(four_bar_model(), constraints=[PIN], independent=[independent],
                  friction=False)
    q0 = robot.closed_configuration((0.5, 0.0, -1.5), fixed=['crank'])
    robot = stopped(robot, crank=(-FREE, 0.9))
    motion = Motion.from_points([0.0, 0.2], [[0.5], [2.5]], joint_names=['crank'])
    run = simulate(robot, q0, [0.0], 0.6, stops=True,
                   torque=ComputedTorque(robot, motion))
    assert not run.warnings and {e.joint for e in run.stop_events} == {'crank'}
    np.testing.assert_allclose(run.q[-1, 0], 0.9, atol=1e-10)
    np.testing.assert_allclose(run.u[-1], 0.0, atol=1e-10)


def test_each_of_many_simulations_hits_as_alone_and_files_keep_the_impacts(tmp_path):
    robot = tree()
    q0 = np.array([[0.1, 0.2, 0.3], [-0.2, 0.1, 0.0], [0.0, 0.0, 0.0]])
    u0 = np.array([[1.0, -2.0, 0.5], [0.0, 0.0, 0.0], [3.0, 3.0, 0.0]])
    many = simulate(robot, q0, u0, 0.3, stops=True)
    for k in range(3):
        alone = simulate(robot, q0[k], u0[k], 0.3, stops=True)
        np.testing.assert_allclose(many.q[k], alone.q, atol=1e-9)
        assert [(e.joint, e.limit,
                 round(e.t, 6)) for e in many.state(k).stop_events] == [
                     (e.joint, e.limit, round(e.t, 6)) for e in alone.stop_events]
    many.save_npz(tmp_path / 'many.npz')
    assert Trajectory.load_npz(tmp_path / 'many.npz').stop_events == many.stop_events
    assert 'hits its' in str(many.stop_events[0])


def test_an_impact_on_a_prescribed_motion_does_work_on_it():
    b = ModelBuilder('carriage', gravity=(0, 0, 0))
    b.body('base', kind='prismatic', axis=(1, 0, 0), inertial=point_mass(1.0))
    b.body('load', 'base', 'prismatic', axis=(1, 0, 0), inertial=point_mass(1.0),
           friction=0.5)
    # The base accelerates by 2 m/s^2, the load slides back by 1.5 m/s^2 to its stop.
    robot = stopped(Robot(b.model(), constraints=[Prescribed('base', lambda t: t * t)]),
                    load=(-0.2, 0.2))
    run = simulate(robot, [0.0, 0.0], [0.0], 1.0, stops=True, sticking=True)
    event, = run.stop_events
    hit = np.sqrt(0.4 / 1.5)
    np.testing.assert_allclose([event.t, event.speed, event.loss],
                               [hit, 1.5 * hit, 0.5 * (1.5 * hit)**2], atol=1e-9)
    np.testing.assert_allclose(run.stop_forces[-1], [0.0, 1.5], atol=1e-9)
    assert not run.warnings


def test_without_a_contact_stops_change_nothing():
    free = simulate(tree(), [0.1, 0.2, 0.3], [0.1, 0.0, 0.0], 0.05)
    np.testing.assert_array_equal(
        simulate(tree(), [0.1, 0.2, 0.3], [0.1, 0.0, 0.0], 0.05, stops=True).q, free.q)


def test_a_start_beyond_the_stops_is_refused():
    with pytest.raises(InputError,
                       match=r"q0: joint 'joint0' at 0\.6; expected -0\.4 to 0\.5"):
        simulate(tree(), [0.6, 0.2, 0.3], np.zeros(3), 0.1, stops=True)
    model = random_model(4, 3, prismatic=0.0, branching=0.0)
    driven = stopped(Robot(model, constraints=[Prescribed('joint0', lambda t: t)],
                           friction=False), joint0=(-1.0, 0.05))
    with pytest.raises(ConstraintError,
                       match="'joint0' is at its stop, and the constraints"):
        simulate(driven, np.zeros(3), np.zeros(2), 0.1, stops=True)


def test_stops_act_after_a_change_of_the_independent_speeds():
    robot = stopped(sleigh(), **{'body/y': (-FREE, 0.9)})
    run = simulate(robot, [0.0, 0.0, 0.5], [1.0, 1.7], 3.0,
                   stops=True, torque=[0.0, 0.2])
    assert not run.warnings
    assert [event.joint for event in run.stop_events] == ['body/y']
    assert run.q[:, 1].max() < 0.9 + 1e-9
    # No moment of the stop.
    np.testing.assert_allclose(run.u[:, 1], 1.7 + 0.5 * run.t, atol=1e-6)


@pytest.mark.parametrize(('integrator', 'error'), [('rk4', 1e-9), ('implicit', 1e-5)])
def test_a_pendulum_on_a_pressed_link_keeps_its_energy(integrator, error):
    robot = stopped(Robot(random_model(1, 2, prismatic=0.0, branching=0.0),
                          friction=False), joint0=(0.0, 1.0))
    run = simulate(robot, [0.0, 0.3], [0.0, 0.0], 20.0, stops=True, torque=[-50.0, 0.0],
                   integrator=integrator)
    assert not run.warnings and not run.q[:, 0].any()
    kinetic, potential = run.energy.T
    assert np.ptp(kinetic + potential) < error * np.ptp(potential) > 0.0


@pytest.mark.parametrize(('integrator', 'order'), [('rk4', 4.0), ('implicit', 2.0)])
def test_an_arm_on_two_pressed_joints_moves_as_one_whose_joints_are_fixed(
        integrator, order):
    path = resource_path('urdf', 'fr3.urdf')
    names = [f'fr3_joint{k}' for k in range(1, 8)]
    q0 = np.array([0.0, -0.7, 0.0, -2.3, 0.0, 1.6, 0.7])
    u0 = [0.5, 0.0, 0.3, 0.0, 0.2, -0.5, 1.0]
    tau = [2.0, 200.0, 1.0, -200.0, 0.5, 0.2, 0.1]
    free = [0, 2, 4, 5, 6]
    arm = stopped(Robot(load_urdf(path, joints=names), friction=False),
                  fr3_joint2=(-FREE, -0.7), fr3_joint4=(-2.3, FREE))
    fixed = Robot(load_urdf(path, joints=[names[k] for k in free],
                            locked={names[1]: -0.7, names[3]: -2.3}), friction=False)
    arguments = q0[free], np.array(u0)[free], 0.5
    exact = simulate(fixed, *arguments, torque=np.array(tau)[free], step=2e-4)
    errors = []
    for step in (1e-2, 5e-3):
        run = simulate(arm, q0, u0, 0.5, torque=tau, stops=True, step=step,
                       integrator=integrator)
        same = simulate(fixed, *arguments, torque=np.array(tau)[free], step=step,
                        integrator=integrator)
        assert not run.warnings and not run.stop_events
        np.testing.assert_array_equal(run.q[:, [1, 3]] - q0[[1, 3]], 0.0)
        np.testing.assert_allclose(run.q[:, free], same.q, rtol=0.0, atol=1e-12)
        errors.append(np.abs(run.q[-1, free] - exact.q[-1]).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.3)


def five_bar_on_its_stop():
    """Return a five-bar with a dependent joint at its stop, or prescribed."""
    q0 = five_bar_at(2.0, 1.1)
    free = five_bar()
    T = five_bar_partial_rates(q0)
    tip = free._choices['constraints'][0]
    fixed = Robot(free.model,
                  constraints=[tip, Prescribed('left_bar', lambda t: q0[1] + 0.0 * t)],
                  friction=False, independent=('right_crank',))
    return stopped(free, left_bar=(q0[1], FREE)), fixed, q0, np.array(
        [-T[1, 1] / T[1, 0], 1.0])


@pytest.mark.parametrize(('integrator', 'order'), [('rk4', 3.7), ('implicit', 1.8)])
def test_a_loop_on_a_pressed_joint_moves_as_one_where_it_is_prescribed(
        integrator, order):
    robot, fixed, q0, u0 = five_bar_on_its_stop()
    exact = simulate(fixed, q0, u0[1:], 0.09, torque=[10.0], step=1e-4)
    errors = []
    for step in (1.5e-2, 7.5e-3):
        run = simulate(robot, q0, u0, 0.09, torque=[0.0, 10.0], stops=True, step=step,
                       integrator=integrator)
        assert not run.warnings and not run.stop_events and run.drift < 1e-11
        np.testing.assert_allclose(run.q[:, 1], q0[1], rtol=0.0, atol=1e-10)
        errors.append(np.abs(run.q[-1] - exact.q[-1]).max())
    assert np.log2(errors[0] / errors[1]) > order


def test_a_pressed_joint_leaves_its_stop_where_the_force_of_the_stop_changes_its_sign():
    """Prescribed, the joint needs a force of that sign, as its power shows."""
    robot, fixed, q0, u0 = five_bar_on_its_stop()
    left = []
    leaves = []
    for step in (1e-3, 5e-4, 1.25e-4):
        run = simulate(robot, q0, u0, 0.12, torque=[0.0, 10.0], stops=True, step=step,
                       sample=step)
        leaves.append(run.t[np.argmax(run.q[:, 1] > q0[1] + 1e-10)])
        left.append(run.q[-1])
        assert not run.warnings
    held = simulate(fixed, q0, u0[1:], 0.12, torque=[10.0], step=1.25e-4, sample=1.25e-4)
    force = fixed.constraint_forces(held.q, held.u, held.tau, t=held.t)[:, -1]
    changes = held.t[np.flatnonzero(np.diff(np.sign(force)))]
    assert len(changes) == 1
    assert -1.25e-4 <= leaves[-1] - changes[0] < 4 * 1.25e-4  # beyond 1e-10 rad
    assert np.abs(left[1] - left[2]).max() < 1e-6


@pytest.mark.parametrize('torque', [5.0, 50.0])
@pytest.mark.parametrize('apart', [0.0, 1e-9, 1e-7, -1e-7, 1e-5, -1e-5, 1e-3, -1e-3])
def test_of_two_nearly_coincident_stops_of_a_loop_the_first_one_holds(apart, torque):
    robot = four_bar()
    q0 = robot.closed_configuration((0.5, 0.0, -1.5), fixed=['crank'])
    at = robot.closed_configuration((0.9, 0.0, -1.5), fixed=['crank'])
    run = simulate(stopped(robot, rocker=(-FREE, at[2] + apart), crank=(-FREE, at[0])),
                   q0, [2.0], 0.3, stops=True, torque=[torque])
    hits = [event.joint for event in run.stop_events]
    if apart < 0.0:
        np.testing.assert_allclose(run.q[-1, 2], at[2] + apart, rtol=0.0, atol=2e-11)
        assert hits == ['rocker'] and run.q[-1, 0] < at[0]
    else:
        np.testing.assert_allclose(run.q[-1, 0], at[0], rtol=0.0, atol=2e-11)
        assert hits == (['crank', 'rocker'] if apart == 0.0 else ['crank'])
    assert not run.warnings and all(event.speed > 0.0 for event in run.stop_events)


def test_two_pressed_stops_of_one_motion_share():
    robot = four_bar()
    q0 = robot.closed_configuration((0.5, 0.0, -1.5), fixed=['crank'])
    both = stopped(robot, rocker=(-FREE, q0[2]), crank=(-FREE, q0[0]))
    run = simulate(both, q0, [0.0], 0.5, stops=True, torque=[50.0])
    assert not run.warnings and not run.stop_events
    np.testing.assert_allclose(run.q[-1], q0, atol=1e-10)


@pytest.mark.parametrize('torque', [1e4, 1e7])
def test_the_energy_balance_does_not_warn_of_joints_that_rest_under_large_torques(
        torque):
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        arm = stopped(tree(), joint0=(-0.4, 0.5), joint1=(-0.3, 0.6), joint2=(-1.0, 0.7))
        simulate(arm, [0.5, 0.6, 0.7], np.zeros(3), 0.1,
                 stops=True, torque=np.full(3, torque))
        q0 = four_bar().closed_configuration((0.5, 0.0, -1.5), fixed=['crank'])
        simulate(stopped(four_bar(), rocker=(-FREE, q0[2])), q0, [0.0], 0.1, stops=True,
                 torque=[0.01 * torque])


def test_joints_that_others_lift_off_their_stops_bounce_ever_less_and_end_at_rest():
    """The bounces do not depend on the step, until flights are too short."""
    robot = stopped(tree(), joint0=(-0.4, 0.5), joint1=(-0.3, 0.6), joint2=(-1.0, 0.7))
    events = []
    for step in (1e-3, 2e-4):
        run = simulate(robot, [0.1, 0.2, 0.3], np.zeros(3), 0.6, step=step, stops=True,
                       torque=[80.0, 40.0, 20.0])
        assert not run.warnings and len(run.stop_events) < 110
        assert not run.u[-1].any() and (run.q[-1] == [0.5, 0.6, 0.7]).all()
        events.append([event for event in run.stop_events if event.speed > 0.01])
    for coarse, fine in zip(*events, strict=True):
        assert coarse[1:3] == fine[1:3]
        np.testing.assert_allclose([coarse.t, coarse.speed], [fine.t, fine.speed],
                                   rtol=1e-3, atol=1e-5)


@pytest.mark.parametrize(('argument', 'message'), [
    ({'integrator': ['implicit']},
     r"integrator: \['implicit'\]; expected one of rk4, implicit"),
    ({'step': True}, 'step: True; expected a positive, finite time'),
    ({'sample': True}, 'sample: True; expected a positive, finite time'),
    ({'duration': np.array([0.1])}, r'duration: array\(\[0\.1\]\); expected a positive'),
    ({'t0': True}, 't0: True; expected a finite number'),
    ({'progress': 3}, 'progress: 3; expected None or a function'),
    ({'robot': 3}, 'robot: a int; expected a Robot')])
def test_arguments_of_a_wrong_kind_are_named(argument, message):
    arguments = {'robot': tree(), 'q0': [0.1, 0.2, 0.3], 'u0': [0.0] * 3,
                 'duration': 0.01}
    with pytest.raises(InputError, match=message):
        simulate(**{**arguments, **argument})


@pytest.mark.parametrize('stops', [False, True])
def test_a_limit_that_is_not_a_number_is_named(stops):
    robot = stopped(tree(), joint1=(-1.0, 0.6))
    robot.limits.lower[1] = np.nan
    with pytest.raises(InputError, match=r"'joint1' nan to 0\.6; expected numbers, inf"):
        simulate(robot, [0.1, 0.2, 0.3], [0.0] * 3, 0.01, stops=stops)


@pytest.mark.parametrize('bad', ['no', 1, None, np.array([True, False])], ids=repr)
def test_stops_are_on_or_off(bad):
    with pytest.raises(InputError, match=r'stops: .*expected True or False'):
        simulate(tree(), [0.1, 0.2, 0.3], [0.0, 0.0, 0.0], 0.01, stops=bad)


@pytest.mark.parametrize(('limits', 'words'), [
    ((0.1, 0.1), "limits: of joint 'joint0' .*expected a range"),
    ((0.4, -0.4), "joint 'joint0': lower 0.4, upper -0.4; expected lower <= upper")])
def test_limits_that_leave_no_range_are_refused(limits, words):
    with pytest.raises(InputError, match=words):
        simulate(stopped(tree(), joint0=limits), [0.1, 0.2, 0.3], [0.0, 0.0, 0.0], 0.01,
                 stops=True)
