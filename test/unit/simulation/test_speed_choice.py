"""What simulations of constrained robots watch: right results, or the reason."""

import warnings

from kane_dynamics import (ConstraintError, Coupling, FlexibleLink, longest_step,
                           ModelBuilder, ModelWarning, point_mass, Prescribed, Robot,
                           rod, simulate)
from linkages import at_angle, four_bar, four_bar_model, PIN, sleigh, sleigh_path, SPIN
import numpy as np
import pytest


@pytest.mark.parametrize('step', [1e-3, 1e-4])
def test_a_motion_through_singular_independent_speeds_is_the_closed_form(step):
    run = simulate(sleigh(), [0.0, 0.0, 0.0], [0.0, SPIN], 3.0, step=step, sample=0.1)
    np.testing.assert_allclose(run.q[:, :2], sleigh_path(run.t), atol=1e-8)
    assert np.ptp(run.energy.sum(axis=1)) < 1e-8 * run.energy[:, 0].max()
    assert np.ptp(run.q[:, 2]) > np.pi  # x' does not determine it throughout


def test_speeds_of_the_asked_set_are_given_wherever_the_motion_goes():
    run = simulate(sleigh(), [0.0, 0.0, 0.0], [0.0, SPIN], 3.0, step=1e-3, sample=0.1)
    h = 1e-5
    rates = (sleigh_path(run.t + h) - sleigh_path(run.t - h)) / (2 * h)
    np.testing.assert_allclose(run.u,
                               np.column_stack([rates[:, 0], np.full(len(rates), SPIN)]),
                               atol=1e-7)
    accelerations = (sleigh_path(run.t + 1e-4) - 2 * sleigh_path(run.t)
                     + sleigh_path(run.t - 1e-4)) / 1e-8
    np.testing.assert_allclose(run.udot[:, 0], accelerations[:, 0], atol=1e-5)


def test_torques_stay_dual_to_the_user_given_speeds_after_a_change():
    # A constant moment about the vertical: u2' = tau / J whichever speeds are
    # independent.
    run = simulate(sleigh(), [0.0, 0.0, 0.0], [0.3, SPIN], 3.0,
                   step=1e-3, torque=[0.0, 0.2], sample=0.5)
    np.testing.assert_allclose(run.u[:, 1], SPIN + 0.5 * run.t, atol=1e-9)
    asked = []

    def torque(t, q, u):
        asked.append(u[1])
        return [0.0, 0.2]
    by_function = simulate(sleigh(), [0.0, 0.0, 0.0], [0.3, SPIN], 3.0,
                           step=1e-3, torque=torque, sample=0.5)
    np.testing.assert_allclose(by_function.q, run.q, atol=1e-10)
    np.testing.assert_allclose(asked, SPIN + 0.5 * np.arange(3001) * 1e-3, atol=1e-9)


def test_many_simulations_pass_singular_speeds_each_when_it_must():
    u0 = np.array([[0.0, SPIN], [0.0, 0.1], [0.0, -2.5]])
    together = simulate(sleigh(), np.zeros((3, 3)), u0, 2.0, step=1e-3, sample=0.25)
    for k in range(3):
        alone = simulate(sleigh(), np.zeros(3), u0[k], 2.0, step=1e-3, sample=0.25)
        np.testing.assert_allclose(together.state(k).q, alone.q, atol=1e-10)


@pytest.mark.parametrize('step', [1e-3, 1e-4])
def test_speeds_that_the_user_named_may_become_singular_on_the_way(step):
    # The rocker turns back where its rate does not determine that of the crank.
    q0 = at_angle(0.8)
    named, crank = four_bar('rocker'), four_bar('crank')
    u0 = [crank.joint_rates(q0, [5.0])[2]]
    run = simulate(named, q0, u0, 2.0, step=step, torque=[0.3], sample=step)
    assert (np.diff(np.sign(run.u[:, 0])) != 0).sum() >= 2
    # The work of a constant torque on the rocker.
    gained = run.energy.sum(axis=1) - run.energy[0].sum()
    np.testing.assert_allclose(gained, 0.3 * (run.q[:, 2] - q0[2]), atol=1e-7)
    # u and u' are those of the rocker's angle.
    tolerance = 2e-3 * (step / 1e-3)**2
    by_angle = np.gradient(run.q[:, 2], step, edge_order=2)
    np.testing.assert_allclose(run.u[:, 0], by_angle, atol=tolerance)
    by_rate = np.gradient(run.u[:, 0], step, edge_order=2)
    np.testing.assert_allclose(run.udot[:, 0], by_rate, atol=200.0 * tolerance)


@pytest.mark.parametrize('named', [('crank',), ('coupler',), ('rocker',), ()])
def test_every_regular_choice_of_speeds_gives_the_same_motion(named):
    q0 = at_angle(0.8)
    rates = four_bar('crank').joint_rates(q0, [5.0])
    robot = four_bar(*named)
    u0 = robot.mechanism.state(q0).speed_rows(robot.speed_names)[0] @ rates
    run = simulate(robot, q0, u0, 2.0, step=1e-3, sample=0.1)
    expected = simulate(four_bar('crank'), q0, [5.0], 2.0, step=1e-3, sample=0.1)
    np.testing.assert_allclose(run.q, expected.q, atol=1e-6)


@pytest.mark.parametrize('named', [('crank',), ('coupler',), ('rocker',), ()])
def test_the_four_bar_of_the_readme_turns_fully_with_every_choice(named):
    q0 = at_angle(0.8)
    rates = four_bar('crank').joint_rates(q0, [5.0])
    robot = four_bar(*named)
    u0 = robot.mechanism.state(q0).speed_rows(robot.speed_names)[0] @ rates
    run = simulate(robot, q0, u0, 2.0, step=1e-3)
    assert np.ptp(run.q[:, 0]) > 2.0 * np.pi
    assert np.ptp(run.energy.sum(axis=1)) < 1e-7 * run.energy[:, 0].max()


def test_a_dead_point_is_an_error_that_says_so():
    # A parallelogram passes its flat configuration, from where two motions are possible.
    model = four_bar_model(bars=(0.5, 1.0, 0.5))
    q0 = (1.0, -1.0, 1.0 - np.pi)
    robot = Robot(model, constraints=[PIN], independent=['crank'], configuration=q0)
    for step in (1e-3, 1e-4):
        with pytest.raises(ConstraintError,
                           match=r"kinematic singularity \(dead point\).*'pin'"):
            simulate(robot, q0, [6.0], 3.0, step=step)
    with pytest.raises(ConstraintError,
                       match=r"kinematic singularity \(dead point\) of 'pin'"):
        robot.inverse_dynamics([0.0, 0.0, -np.pi], [1.0], [0.0])


@pytest.mark.parametrize('step', [1e-3, 1e-4])
def test_a_loop_on_a_turntable_keeps_its_energy_wherever_the_table_turns(step):
    run = simulate(four_bar('table', 'crank', turntable=True), [0.0, *at_angle(0.8)],
                   [3.0, 5.0], 3.0, step=step, sample=0.1)
    assert run.q[-1, 0] > 2.0 * np.pi / 2.0
    assert np.ptp(run.energy.sum(axis=1)) < 1e-7 * run.energy[:, 0].max()
    assert run.drift < 1e-11


def contradicting():
    """Return two drives of coupled joints that agree at first, and part as t cubed."""
    b = ModelBuilder('two')
    for name in ('one', 'two'):
        b.body(name, kind='prismatic', axis=(1, 0, 0), inertial=point_mass(1.0))
    b.body('free', kind='prismatic', axis=(0, 1, 0), inertial=point_mass(1.0))
    return Robot(b.model(), constraints=[
        Coupling('two', {'one': 1.0}, name='gear'),
        Prescribed('one', lambda t: np.sin(t), name='drive one'),
        Prescribed('two', lambda t: np.sin(t) + t * t * t, name='drive two')])


def test_constraints_that_contradict_each_other_later_are_an_error():
    robot = contradicting()
    with pytest.raises(ConstraintError,
                       match=r"simulation, 0\.0\d* s: constraint 'drive two' "
                       'contradicts the others'):
        simulate(robot, np.zeros(3), [0.0], 1.0, step=1e-3)
    with pytest.raises(ConstraintError, match="'drive two'"):
        robot.inverse_dynamics([np.sin(1.0), np.sin(1.0), 0.0], [0.0], [0.0], t=1.0)


def test_drift_covers_velocities():
    run = simulate(four_bar('crank'), at_angle(0.8), [5.0], 0.1)
    worst = np.abs(run.constraint_velocity_residual).max()
    assert run.drift == max(worst, np.abs(run.constraint_residual).max())
    h = 1e-6
    k = 50
    robot = four_bar('crank')
    q = run.q[k]
    rates = robot.joint_rates(q, run.u[k]) + [0.0, 0.0, 0.1]
    ahead = robot.constraint_residual(q + h * rates)
    behind = robot.constraint_residual(q - h * rates)
    off = (ahead - behind) / (2 * h)
    exact = robot.mechanism.rows(robot.mechanism.state(q))
    np.testing.assert_allclose(np.array(exact.J, dtype=float) @ rates, off, atol=1e-8)


def test_a_step_that_opens_a_loop_wide_is_an_error():
    with pytest.raises(ConstraintError,
                       match=r"'pin/.' opens by .* within one step of 0.05 s"):
        simulate(four_bar('crank'), at_angle(0.8), [25.0], 2.0, step=0.05)


def test_a_simulation_may_start_at_another_time():
    b = ModelBuilder('shaken')
    b.body('cart', kind='prismatic', axis=(1, 0, 0), inertial=point_mass(1.0))
    b.body('arm', 'cart', axis=(0, -1, 0), inertial=rod(1.0, (0, 0, 0), (0.5, 0, 0)))
    robot = Robot(b.model(), constraints=[Prescribed('cart', lambda t: np.sin(3.0 * t))])
    whole = simulate(robot, [0.0, -1.0], [0.0], 2.0, step=1e-3, sample=0.5)
    second_half = simulate(robot, whole.q[2], whole.u[2], 1.0,
                           step=1e-3, sample=0.5, t0=1.0)
    np.testing.assert_allclose(second_half.t, [1.0, 1.5, 2.0])
    np.testing.assert_allclose(second_half.q, whole.q[2:], atol=1e-11)
    times = []
    simulate(robot, whole.q[2], whole.u[2], 0.01, step=1e-3, t0=1.0,
             torque=lambda t, q, u: times.append(t) or [0.0])
    np.testing.assert_allclose(times, 1.0 + 1e-3 * np.arange(11))


def test_the_longest_step_counts_springs_under_constraints():
    b = ModelBuilder('stiff')
    b.body('cart', kind='prismatic', axis=(1, 0, 0), inertial=point_mass(1.0))
    b.body('mass', 'cart', 'prismatic', axis=(1, 0, 0), inertial=point_mass(0.1),
           stiffness=1e6)
    b.body('other', 'cart', 'prismatic', axis=(0, 0, 1), inertial=point_mass(0.1))
    robot = Robot(b.model(), constraints=[Coupling('other', {'cart': 0.5})])
    longest = longest_step(robot, np.zeros(3))
    assert longest.step == pytest.approx(
        np.sqrt(8.0) / np.sqrt(1e6 * (10.0 + 1.0 / 1.125)), rel=1e-3)
    assert longest.name == 'mass'
    for share, grows in ((0.97, False), (1.08, True)):
        step = share * longest.step
        with warnings.catch_warnings():
            warnings.simplefilter('error' if not grows else 'ignore', ModelWarning)
            # Near the longest step the method damps the spring, which the energy shows.
            warnings.filterwarnings('ignore', 'energy balance', ModelWarning)
            run = simulate(robot, [0.0, 1e-6, 0.0], [0.0, 0.0], 30 * step, step=step,
                           sample=step, integrator='rk4')
        assert (np.abs(run.q[:, 1]).max() > 1e-4) == grows


def test_a_closed_loop_of_stiff_beams_sets_a_step():
    def steps(stiffness):
        b = ModelBuilder('flexible')
        b.body('crank', axis=(0, -1, 0), inertial=rod(0.6, (0, 0, 0), (0.3, 0, 0)))
        b.beam('coupler', 'crank',
               FlexibleLink(0.9, 2.0, stiffness, (2, 0), up=(0, 0, 1)),
               axis=(0, -1, 0), at=(0.3, 0, 0))
        b.body('rocker', 'coupler/tip', axis=(0, -1, 0),
               inertial=rod(1.4, (0, 0, 0), (0.7, 0, 0)))
        b.frame('end', 'rocker', at=(0.7, 0, 0))
        b.frame('ground', 'world', at=(1, 0, 0))
        free = ('crank', 'coupler/mode_1', 'coupler/mode_2')
        robot = Robot(b.model(), constraints=[PIN], independent=free)
        start = dict.fromkeys(robot.coordinate_names, 0.0) | {'crank': 0.8,
                                                              'rocker': -1.5}
        q = robot.closed_configuration(list(start.values()), fixed=free)
        return longest_step(robot, q)
    soft, hard = steps(100.0), steps(400.0)
    assert soft.name == hard.name and 'mode' in soft.name
    assert soft.step == pytest.approx(2.0 * hard.step, rel=0.05)
