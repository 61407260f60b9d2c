"""Exact Coulomb friction: closed forms, event-driven references, loops."""

from dataclasses import replace
import itertools
import json

from coupled_sliders import exact_motion, random_sliders, Sliders, state_at
from kane_dynamics import (absolute_rates, Closure, ComputedTorque, FlexibleLink,
                           Inertial, Limits, ModelBuilder, Motion, point_mass,
                           PointVelocity, Robot, rod, simulate, Trajectory)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.cli import main
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.definition import kane
from kane_dynamics.mechanics.friction import AT_BOUND, friction_torque, holding_interval
from kinds_of_mechanism import case, elastic_case, torque_of
from linkages import at_angle, four_bar_model, PIN, sleigh
from mechanisms import random_model, wheel, with_joints
import numpy as np
import pytest
from trajectory_fields import check_fields

STEP = 1e-3


def rubbing(model, **law):
    """Return a model with the same friction in all joints."""
    return with_joints(model, **law)


def exact(robot, q0, u0, duration, **options):
    """Return a simulation with exact friction that has no warning."""
    options = {'step': STEP, 'sticking': True} | options
    run = simulate(robot, q0, u0, duration, **options)
    assert run.warnings == ()
    return run


@pytest.mark.parametrize('integrator', ['rk4', 'implicit'])
def test_a_wheel_stops_where_its_kinetic_energy_is_spent_and_sticks(integrator):
    run = exact(wheel(friction=2.0), [0.0], [1.0], 1.0, integrator=integrator)
    assert run.q[-1, 0] == pytest.approx(1.0 / (2.0 * 2.0), abs=1e-12)
    assert run.u[-1, 0] == 0.0 and run.udot[-1, 0] == 0.0
    # It stops at 0.5 s, between no two steps.
    np.testing.assert_array_equal(run.sticking[:, 0], run.t > 0.5 - 1e-9)
    sliding = run.t < 0.4999
    np.testing.assert_allclose(run.u[sliding, 0], 1.0 - 2.0 * run.t[sliding], atol=1e-12)


@pytest.mark.parametrize('backward', [False, True])
def test_a_wheel_breaks_away_when_the_torque_exceeds_breakaway_friction(backward):
    robot = wheel(friction=2.0, friction_backward=1.0, breakaway_friction=2.5)
    sign, kinetic, static = (-1.0, 1.0, 1.5) if backward else (1.0, 2.0, 2.5)
    levels = np.arange(40) * 0.1
    torque = sign * np.repeat(levels, 50)[:, None]
    run = exact(robot, [0.0], [0.0], 2.0, torque=torque)
    begins = np.argmax(levels > static + 1e-9) * 0.05
    assert run.t[np.argmax(~run.sticking[:, 0])] == pytest.approx(begins, abs=2.1e-3)
    impulse = 0.05 * (levels[levels > static + 1e-9] - kinetic).sum()
    assert run.u[-1, 0] == pytest.approx(sign * impulse, abs=1e-10)


def test_a_torque_that_alternates_reverses_a_wheel_in_every_step_without_a_warning():
    # A step begins at -w, the wheel slows down with 5 + 2, and speeds up with 5 - 2: in
    # the limit w = 3 (h - w / 7). The power of friction is the same at all steps' ends.
    torque = np.where(np.arange(200) % 2, 5.0, -5.0)[:, None]
    run = exact(wheel(friction=2.0, breakaway_friction=2.5), [0.0], [0.0], 0.2,
                torque=torque)
    assert run.u[-1, 0] == pytest.approx(3.0 * STEP / (1.0 + 3.0 / 7.0), abs=1e-12)


def test_a_joint_at_rest_does_not_creep_in_an_hour():
    run = exact(wheel(friction=2.0), [0.3], [0.0], 3600.0, step=0.01, torque=[1.99])
    assert (run.q == 0.3).all() and (run.u == 0.0).all() and run.sticking.all()


@pytest.mark.parametrize('integrator, order', [('rk4', 4), ('implicit', 2)])
def test_breakaway_under_a_spring_is_found_at_the_order_of_the_integrator(
        integrator, order):
    # The spring of a cart that starts at rest is pulled by another cart, which moves
    # freely.
    builder = ModelBuilder('carts', gravity=(0, 0, 0))
    builder.body('slow', kind='prismatic', axis=(1, 0, 0), inertial=point_mass(1.0),
                 friction=1.0)
    builder.body('puller', 'slow', 'prismatic', axis=(1, 0, 0), inertial=point_mass(4.0),
                 stiffness=5.0)
    robot = Robot(builder.model())
    errors = []
    # The puller oscillates on its spring; at |5 x| = 1 the cart breaks away.
    reference = exact(robot, [0.0, 0.0], [0.0, 0.9], 1.0, step=2e-4)
    for step in (0.02, 0.01):
        run = exact(robot, [0.0, 0.0], [0.0, 0.9], 1.0, step=step, integrator=integrator)
        errors.append(np.abs(run.q[-1] - reference.q[-1]).max())
    assert errors[0] > 0.5 * 2**order * errors[1]
    assert errors[1] < (1e-8 if order == 4 else 2e-4)

    # Until then the motion is a quarter of a harmonic one, in closed form.
    w = np.sqrt(5.0 / 4.0)
    first = np.arcsin(0.2 * w / 0.9) / w
    breakaway = reference.t[np.argmax(~reference.sticking[:, 0])]
    assert first < breakaway < first + 2.1 * np.diff(reference.t).max()


@pytest.mark.slow
@pytest.mark.parametrize('static', [2.0, 3.0])
def test_a_mass_on_a_belt_has_the_period_of_stick_slip(static):
    kinetic = 2.0
    k = 8.0
    m = 0.5
    speed = 0.3
    builder = ModelBuilder('belt', gravity=(0, 0, 0))
    builder.body('mass', kind='prismatic', axis=(1, 0, 0), inertial=point_mass(m),
                 stiffness=k)
    builder.body('belt', 'mass', 'prismatic', axis=(1, 0, 0), friction=kinetic,
                 breakaway_friction=static)
    belt = PointVelocity('belt', (1, 0, 0), value=speed)
    robot = Robot(builder.model(), constraints=[belt], independent=['mass'])
    run = exact(robot, [static / k - 0.1 * speed, 0.0], [speed], 6.0, sample=STEP)
    sticks = run.sticking[:, 1]
    ends = np.flatnonzero(sticks[:-1] & ~sticks[1:])
    if static == kinetic:  # no excess: after the first slip the mass oscillates or rests
        assert len(ends) == 1
        return
    # Times of breakaway: a mass that sticks moves with the belt to where it breaks away.
    begins = run.t[ends] + (static / k - run.q[ends, 0]) / speed
    assert len(begins) > 3 and (begins - run.t[ends] < STEP + 1e-9).all()
    w = np.sqrt(k / m)
    excess = (static - kinetic) / k
    slip = 2.0 / w * (np.pi - np.arctan(w * excess / speed))
    period = 2.0 * excess / speed + slip
    np.testing.assert_allclose(np.diff(begins), period, atol=1e-9)
    # The last state, many transitions later, is that of the closed form.
    phase = (run.t[-1] - 0.1) % period
    y = excess * np.cos(w * phase) + speed / w * np.sin(w * phase)
    expected = kinetic / k + y if phase < slip else static / k - speed * (period - phase)
    assert run.q[-1, 0] == pytest.approx(expected, abs=1e-8)


def two_links(**law):
    """Return a horizontal arm of two links with friction."""
    builder = ModelBuilder('arm', gravity=(0, 0, 0))
    builder.body('one', axis=(0, 0, 1), inertial=rod(2.0, (0, 0, 0), (0.6, 0, 0)), **law)
    builder.body('two', 'one', axis=(0, 0, 1), at=(0.6, 0, 0),
                 inertial=rod(1.5, (0, 0, 0), (0.5, 0, 0)), **law)
    return Robot(builder.model())


def reference_of_two(model, level, torque, duration):
    """
    Return q of two joints by events and an enumeration of all modes, with scipy.

    The forces are those of the definition of Kane's equations.
    """
    from scipy.integrate import solve_ivp

    def motion(x, modes, t):
        q = x[:2]
        u = x[2:]
        M = kane.mass_matrix(model, q)
        h = kane.bias_force(model, q, u, friction=False)
        net = torque(t) - h - level * np.where(np.isnan(modes), 0.0, modes)
        held = np.isnan(modes)
        udot = np.zeros(2)
        f = np.zeros(2)
        free = ~held
        udot[free] = np.linalg.solve(M[np.ix_(free, free)], net[free])
        f[held] = (M @ udot - net)[held]
        return udot, f

    def modes_of(x, t):
        options = []
        for v in x[2:]:
            options.append([np.sign(v)] if abs(v) > 1e-9 else [np.nan, 1.0, -1.0])
        for modes in itertools.product(*options):
            modes = np.array(modes)
            # A little later: at breakaway a mode is right from there on.
            udot, f = motion(x, modes, t + 1e-7)
            held = np.isnan(modes)
            begins = ~held & (np.abs(x[2:]) <= 1e-9)
            sticks = (np.abs(f[held]) <= level).all()
            slides_ahead = (udot[begins] * modes[begins] > 0.0).all()
            if sticks and slides_ahead:
                return modes
        raise AssertionError('no mode')
    x = np.zeros(4)
    t = 0.0
    while t < duration - 1e-12:
        modes = modes_of(x, t)
        held = np.isnan(modes)
        events = []
        for j in range(2):
            if held[j]:
                events.append(
                    lambda s, y, j=j, m=modes: level - abs(motion(y, m, s)[1][j]))
            else:
                events.append(lambda s, y, j=j, m=modes: m[j] * y[2 + j] + 1e-14)
            events[-1].terminal = True
            events[-1].direction = -1
        part = solve_ivp(lambda s, y, m=modes: [*y[2:], *motion(y, m, s)[0]],
                         (t, duration), x,
                         method='DOP853', rtol=1e-12, atol=1e-13, events=events,
                         max_step=0.02)
        x = part.y[:, -1]
        t = part.t[-1]
        x[2:] = np.where(np.abs(x[2:]) < 1e-10, 0.0, x[2:])
    return x[:2]


@pytest.mark.slow
def test_two_joints_under_ramps_move_as_an_event_driven_reference():
    level = 2.0
    duration = 3.0
    robot = two_links(friction=level)

    def torque(t):
        return np.array([4.0 * np.sin(1.5 * t), 3.0 * np.sin(2.3 * t + 0.4)])
    expected = reference_of_two(robot.model, level, torque, duration)

    errors = []
    for step in (2e-3, 1e-3):
        middles = (np.arange(round(duration / step)) + 0.5) * step
        run = exact(robot, [0.0, 0.0], [0.0, 0.0], duration, step=step,
                    torque=np.array([torque(t) for t in middles]))
        errors.append(np.abs(run.q[-1] - expected).max())
    # Torques held during each step are of second order.
    assert errors[1] < 1e-5 and errors[0] > 3.0 * errors[1]
    assert run.sticking[:, 0].any() and run.sticking[:, 1].any()


def stiff_model(seed):
    """Return a random tree with springs, and with friction that stops it."""
    rng = np.random.default_rng(seed)
    bodies = []
    for body in random_model(seed, 4, mimics=seed % 2).bodies:
        limits = replace(body.joint.limits, lower=-1.0, upper=1.2)
        bodies.append(replace(body, joint=replace(
            body.joint, friction=rng.uniform(1.0, 6.0), limits=limits,
            stiffness=body.joint.stiffness + 2.0)))
    return replace(random_model(seed, 4, mimics=seed % 2), bodies=tuple(bodies))


@pytest.mark.slow
@pytest.mark.parametrize('seed, stops', [(0, True), (3, False), (4, True)])
def test_random_trees_converge_at_fourth_order_through_all_transitions(seed, stops):
    robot = Robot(stiff_model(seed))
    rng = np.random.default_rng(seed)
    q0 = rng.uniform(-0.5, 0.5, 4)
    u0 = rng.uniform(-2.0, 2.0, 4)
    tau = rng.uniform(-5, 5, 4)
    runs = [exact(robot, q0, u0, 1.0, step=step, torque=tau, stops=stops)
            for step in (0.02, 0.01, 0.005)]
    errors = [np.abs(run.q[-1] - runs[2].q[-1]).max() for run in runs[:2]]
    assert errors[1] < 1e-7 and errors[0] > 5.0 * errors[1]
    assert runs[2].sticking.any() and bool(runs[2].stop_events) == stops
    if stops:
        rows = []
        for run in runs[1:]:
            rows.append([event.t for event in run.stop_events])
        times = np.array(rows)
        np.testing.assert_allclose(times[0], times[1], atol=1e-6)


@pytest.mark.slow
def test_the_sum_of_forces_on_every_joint_vanishes():
    robot = Robot(stiff_model(4))
    run = exact(robot, [0.2, -0.3, 0.4, 0.1], [1.0, -2.0, 0.5, 1.5], 2.0,
                torque=[2, 0, -3, 1], stops=True)
    bare = Robot(robot.model, friction=False)
    levels = np.zeros(4)
    for body in robot.model.bodies:
        levels[body.joint.coordinate] += abs(body.joint.multiplier) * body.joint.friction
    viscous = Robot(rubbing(robot.model, friction=0.0)).friction_force(run.u)
    friction = run.tau + run.stop_forces - viscous - bare.inverse_dynamics(
        run.q, run.u, run.udot)
    sliding = ~run.sticking
    assert (np.abs(friction) <= levels * (1.0 + 1e-9)).all()
    expected = np.sign(run.u) * levels
    moving = sliding & (run.u != 0.0)
    np.testing.assert_allclose(friction[moving], expected[moving], atol=1e-8)


@pytest.mark.slow
def test_many_simulations_are_the_single_ones():
    robot = two_links(friction=0.5)
    q0 = np.array([[0.0, 0.0], [0.3, -0.2]])
    u0 = np.array([[1.0, -1.0], [0.0, 2.0]])
    many = exact(robot, q0, u0, 1.0)
    for k in range(2):
        single = exact(robot, q0[k], u0[k], 1.0)
        np.testing.assert_array_equal(many.state(k).q, single.q)
        np.testing.assert_array_equal(many.state(k).sticking, single.sticking)


def test_a_torque_function_sees_a_joint_that_sticks():
    run = exact(wheel(friction=2.0), [0.0], [1.0], 1.0,
                torque=lambda t, q, u: [1.5 * (u[0] == 0)])
    assert run.q[-1, 0] == pytest.approx(0.25, abs=1e-9)
    assert run.sticking[-1, 0] and run.tau[-1, 0] == 1.5


@pytest.mark.slow
def test_computed_torque_moves_a_joint_that_sticks():
    robot = wheel(friction=2.0, friction_speed=0.01)
    motion = Motion.from_points([0.0, 1.0], [[0.0], [1.0]],
                                joint_names=robot.joint_names)
    errors = []
    for step in (4e-3, 2e-3):
        run = exact(robot, [0.0], [0.0], 1.0, step=step,
                    torque=ComputedTorque(robot, motion, 400.0, 40.0))
        errors.append(run.q[-1, 0])
    assert abs(errors[0] - errors[1]) < 1e-4 and abs(errors[1] - 1.0) < 2e-2


@pytest.mark.parametrize('tau, sticks', [(0.0, True), (3.0, True), (20.0, False)])
def test_a_closed_loop_is_held_by_the_friction_of_all_its_joints(tau, sticks):
    # A joint alone would not hold it: friction of all of them, weighted by their rates.
    robot = Robot(rubbing(four_bar_model(), friction=3.0), constraints=[PIN],
                  independent=['crank'])
    q = at_angle(1.1)
    run = exact(robot, q, [0.0], 0.1, torque=[tau])
    rates = robot.joint_rates(q, [1.0])
    needed = abs(tau - robot.gravity_force(q)[0])
    assert (needed <= 3.0 * np.abs(rates).sum()) == sticks
    assert run.sticking[-1].all() == sticks
    if sticks:
        np.testing.assert_allclose(run.q[-1], q, atol=1e-12)
        assert abs(run.u[-1, 0]) < 1e-15 and abs(run.udot[-1, 0]) < 1e-9


LAWS_OF_LOOPS = {
    'drops': {'breakaway_friction': 3.0},
    'falls with the speed': {'breakaway_friction': 3.0, 'stribeck_speed': 0.1},
    'of directions': {'friction_backward': 1.2}}


def ramped_loop(law, step=STEP):
    """Return a four-bar at rest, a torque up and down, and it at each time."""
    robot = Robot(rubbing(four_bar_model(), friction=2.0, **law), constraints=[PIN],
                  independent=['crank'])
    q = at_angle(1.1)
    t = np.arange(round(1.0 / step)) * step
    return robot, q, (robot.gravity_force(q)[0] + 12.0 * np.sin(4.0 * t))[:, None]


@pytest.mark.parametrize('name', LAWS_OF_LOOPS)
def test_a_closed_loop_holds_until_all_of_its_joints_are_at_their_bounds(name):
    law = LAWS_OF_LOOPS[name]
    robot, q, torque = ramped_loop(law)
    run = exact(robot, q, [0.0], 0.35, torque=torque[:350])
    rates = robot.joint_rates(q, [1.0])
    # Each joint has its friction in the direction in which it would move.
    level = law.get('breakaway_friction', 2.0)
    bounds = np.where(rates > 0.0, level, law.get('friction_backward', level))
    begins = np.arcsin(np.abs(rates) @ bounds / 12.0) / 4.0
    moving = run.t[np.argmax(~run.sticking.all(axis=1))]
    assert moving == pytest.approx(begins, abs=1.5 * STEP)
    assert not run.sticking[-1].any()
    np.testing.assert_allclose(run.q[run.t < begins - STEP], q[None].repeat(
        np.sum(run.t < begins - STEP), axis=0), atol=1e-12)


@pytest.mark.parametrize('name', LAWS_OF_LOOPS)
def test_fields_of_a_loop_that_sticks_are_right_at_their_times(name):
    robot, q, torque = ramped_loop(LAWS_OF_LOOPS[name], step=4e-3)
    run = exact(robot, q, [0.0], 1.0, step=4e-3, torque=torque)
    assert 0 < run.sticking.all(axis=1).sum() < len(run.t) - 50
    check_fields(robot, run, samples=60, tolerance=1e-7, sticking=True)


def follows_the_exact_motion(sliders, u0, step=1e-2):
    """Require the exact motion of coupled sliders, and return the simulation."""
    phases = exact_motion(sliders, u0, 3.0)
    robot = sliders.robot()
    run = exact(robot, np.zeros(robot.n_q), u0, 3.0, step=step, sample=0.05,
                torque=sliders.torque)
    q, u = zip(*(state_at(phases, t) for t in run.t))
    np.testing.assert_allclose(run.u, u, atol=2e-9)
    np.testing.assert_allclose(run.q[:, 1:1 + len(u0)], q, atol=4e-9)
    return run


# Of one to three speeds; several transitions, or one at which others are at their
# bounds.
@pytest.mark.parametrize('seed', [3, 7, *(
    pytest.param(seed, marks=pytest.mark.slow) for seed in (0, 1, 5, 6, 8, 9, 10))])
def test_coupled_joints_break_away_when_no_forces_hold_them(seed):
    sliders = random_sliders(seed)
    run = follows_the_exact_motion(sliders, np.zeros(sliders.T.shape[1]))
    assert run.sticking.any() and not run.sticking.all()


def test_joints_break_away_at_the_exact_time_in_the_last_native_step():
    # At 2.5553 s, in the 256th step: as many are computed at a time.
    sliders = replace(random_sliders(20), torque=np.array([-2.55482818]))
    follows_the_exact_motion(sliders, np.array([-0.15093434]))


def test_a_joint_whose_friction_drops_breaks_away_with_one_whose_friction_does_not():
    # The latter reaches its bound last: neither waits until it has begun to move.
    coupling = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, -1.0]])
    sliders = Sliders(coupling, np.array([0.5, 2.2, 1.6]), np.ones(3),
                      np.array([1.1, 1.0, 1.3]),
                      np.array([0.0, -9.0, 4.5]), np.array([-0.85, -0.77]))
    run = follows_the_exact_motion(sliders, np.zeros(2))
    assert run.sticking[:, 1:].all(axis=1).any() and not run.sticking[:, 1:].all()


def test_a_joint_at_its_bound_waits_for_a_slow_one_that_holds_it():
    # The second one moves a fiftieth as far as the first, and holds it nevertheless.
    sliders = Sliders(np.array([[1.0], [-0.0207]]), np.array([1.6, 1.9]),
                      np.array([1.8, 1.3]),
                      np.array([2.7, 1.3]), np.array([0.0, -12.0, 6.0]), np.zeros(1))
    follows_the_exact_motion(sliders, np.zeros(1))


def test_coupled_joints_at_their_bounds_stay_at_rest_when_the_load_turns():
    sliders = Sliders(np.ones((2, 1)), np.ones(2), np.array([0.2, 0.2]),
                      np.array([1.0, 0.7]), np.zeros(3), np.zeros(1))
    robot = sliders.robot()
    # Less than the sum of both bounds, 1.7 N; the first one alone has reached its own.
    torque = np.repeat([1.5, -1.5, 1.65, -1.65, 1.7], 20)[:, None]
    run = exact(robot, np.zeros(robot.n_q), [0.0], 0.1, torque=torque)
    assert run.sticking[:, 1:].all() and (run.u == 0.0).all()


def test_joints_without_a_drop_keep_their_friction_where_their_master_is_at_its_bound():
    builder = ModelBuilder('gripper', gravity=(0, 0, 0))
    builder.body('left', kind='prismatic', axis=(1, 0, 0), inertial=point_mass(1.0),
                 friction=2.0, breakaway_friction=3.0)
    builder.body('right', kind='prismatic', axis=(-1, 0, 0), inertial=point_mass(1.0),
                 friction=0.5, mimic='left', multiplier=-1.0)
    equations = Robot(builder.model()).equations
    for direction, friction in ((1.0, 2.5), (AT_BOUND, 3.5), (-AT_BOUND, -3.5)):
        force = equations.tree.friction_force([0.0], None, np.array([direction]))
        np.testing.assert_allclose(force, [friction])


@pytest.mark.slow
@pytest.mark.parametrize('integrator', ['rk4', 'implicit'])
def test_joints_of_a_loop_reach_their_bounds_at_one_instant(integrator):
    # A four-bar on a cart, with drives: where it breaks away, its joints took turns
    # without end.
    one = case('closed loop', 'nonholonomic')
    robot, q = elastic_case(one)
    u = np.random.default_rng(3).uniform(-0.5, 0.5, robot.n)
    ends = []
    for step in (2.5e-4, 1e-4):
        run = simulate(robot, q, u, 0.1, step=step, torque=torque_of(robot), sample=0.01,
                       sticking=True, integrator=integrator)
        check_fields(robot, run, samples=11, tolerance=1e-7, torque=torque_of(robot),
                     sticking=True)
        ends.append(run.q[-1])
    np.testing.assert_allclose(*ends, atol=1e-6)


def test_joints_that_constraints_lock_need_no_friction():
    # A wheel slides beside a bar whose end is pinned to the ground: 2 kg m^2, 3 N m.
    b = ModelBuilder('wheel beside a locked bar')
    b.body('wheel', inertial=Inertial(1.0, (0, 0, 0), np.diag([1.0, 1.0, 2.0])),
           friction=3.0)
    b.body('bar', at=(1, 0, 0), inertial=rod(1.0, (0, 0, 0), (0.5, 0, 0)), friction=1.0)
    b.frame('end', 'bar', at=(0.5, 0, 0))
    b.frame('ground', 'world', at=(1.5, 0, 0))
    robot = Robot(b.model(), constraints=[Closure('end', 'ground', 'spherical')])
    run = simulate(robot, [0.0, 0.0], [2.0], 2.0, step=0.01, sticking=True)
    np.testing.assert_allclose(run.u[:, 0], np.maximum(2.0 - 1.5 * run.t, 0.0),
                               atol=1e-10)
    np.testing.assert_array_equal(run.q[:, 1], 0.0)


@pytest.mark.slow
def test_a_closed_loop_stops_at_the_order_of_the_integrator_and_balances_forces():
    robot = Robot(rubbing(four_bar_model(turntable=True), friction=1.5),
                  constraints=[PIN])
    q0 = np.concatenate([[0.3], at_angle(1.1)])
    runs = [exact(robot, q0, [1.0, 1.0], 0.6, step=step)
            for step in (0.02, 0.01, 0.0025)]
    errors = [np.abs(run.q[-1] - runs[2].q[-1]).max() for run in runs[:2]]
    assert errors[1] < 1e-7 and errors[0] > 5.0 * errors[1]
    run = runs[2]
    assert run.sticking[-1].sum() == 3 and run.drift < 1e-10


def motion_of_four_bar(second, stops):
    """Return a simulation of a four-bar that sticks, with `second` for 1 s, and u."""
    b = ModelBuilder('four-bar', gravity=(0, 0, -9.81 / second**2))
    on = 'world'
    at = (0, 0, 0)
    for name, length in zip(('crank', 'coupler', 'rocker'), (0.3, 0.9, 0.7)):
        limits = {}
        if stops and name == 'rocker':
            limits = {'limits': Limits(-2.2, -0.9, 1e9 / second**2, 1e9 / second)}
        bar = rod(2.0 * length, (0, 0, 0), (length, 0, 0))
        b.body(name, on, axis=(0, -1, 0), at=at, inertial=bar,
               friction=1.2 / second**2, breakaway_friction=1.6 / second**2, **limits)
        on = name
        at = (length, 0, 0)
    b.frame('end', on, at=at)
    b.frame('ground', 'world', at=(1, 0, 0))
    robot = Robot(b.model(), constraints=[PIN], independent=['crank'],
                  actuated=['crank'])
    q = robot.closed_configuration((1.1, 0.0, -1.5), fixed=['crank'])
    torque = robot.gravity_force(q) + -5.0 * np.sin(
        0.04 * np.arange(200))[:, None] / second**2
    run = exact(robot, q, [2.0 / second], 2.0 * second,
                step=0.01 * second, torque=torque, stops=stops, sample=0.04 * second)
    return run, run.u * second


@pytest.mark.parametrize('stops', [False, True])
def test_a_loop_sticks_in_the_same_way_whatever_the_unit_of_time(stops):
    expected, expected_u = motion_of_four_bar(1.0, stops)
    assert 0.1 < expected.sticking.mean() < 0.9
    assert bool(expected.stop_events) == stops
    for second in (1e-6, 1e6):
        run, u = motion_of_four_bar(second, stops)
        np.testing.assert_allclose(run.q, expected.q, atol=1e-9)
        np.testing.assert_allclose(u, expected_u, atol=1e-9)
        np.testing.assert_array_equal(run.sticking, expected.sticking)


@pytest.mark.parametrize('kinds, joint, integrator', [
    (('chosen speeds', 'flexible'), 'fore', 'implicit'),
    (('closed loop', 'flexible'), 'rocker', 'rk4')])
def test_a_joint_that_presses_stays_at_its_stop_whatever_the_speeds(
        kinds, joint, integrator):
    one = case(*kinds)
    robot = one.robot.copy()
    q = one.q
    place = robot.coordinate_names.index(joint)
    T = one.T[place]
    along = np.linalg.solve(robot.mass_matrix(q), T) / (
        T @ np.linalg.solve(robot.mass_matrix(q), T))
    # At its lower stop, at rest, and driven into it; the other joints move.
    lower = robot.limits.lower.copy()
    lower[place] = q[place]
    robot.limits = replace(robot.limits, lower=lower)
    u = one.u - along * (T @ one.u)
    torque = robot.inverse_dynamics(q, u, -20.0 * along)
    run = simulate(robot, q, u, 0.05, step=1e-3, torque=torque, stops=True,
                   sticking=True, integrator=integrator)
    assert np.abs(run.u - run.u[0]).max() > 0.05
    assert np.abs(run.q[:, place] - q[place]).max() < 1e-14
    assert (run.stop_forces[:, robot.joint_names.index(joint)] > 0.0).all()
    check_fields(robot, run, tolerance=1e-7, torque=torque, sticking=True)


@pytest.mark.parametrize('integrator', ['rk4', 'implicit'])
def test_a_heavy_joint_is_held_exactly_beside_a_link_that_weighs_nearly_nothing(
        integrator):
    # A force on the slide accelerates it 1e-8 times as much as a torque does the link.
    b = ModelBuilder('heavy slide', gravity=(0, 0, 0))
    b.body('slide', kind='prismatic', axis=(0, 0, 1), inertial=point_mass(10.0),
           friction=2.0, limits=Limits(-1.0, 0.0, 10.0, 1e4))
    b.body('link', 'slide', axis=(0, 1, 0), inertial=rod(1e-3, (0, 0, 0), (0.02, 0, 0)),
           friction=1e-8)
    robot = Robot(b.model(), speeds=absolute_rates)
    for force in (1.5, 900.0):  # held by friction; pressed against the stop
        torque = np.array([force, 1e-6])
        run = simulate(robot, [0.0, 0.3], [0.0, 20.0], 0.01, step=5e-4, torque=torque,
                       sticking=True, stops=True, integrator=integrator)
        assert run.sticking[:, 0].all()
        assert np.abs(run.udot[:, 0]).max() < 1e-9 * force
        check_fields(robot, run, samples=8, torque=torque, sticking=True)


@pytest.mark.slow
def test_a_sleigh_stops_on_its_slope():
    runner = sleigh().mechanism.constraints
    robot = Robot(rubbing(sleigh().model, friction=4.0), constraints=runner)
    run = exact(robot, [0.0, 0.0, 0.0], [0.5] * robot.n, 1.5)
    assert run.sticking[-1].all() and np.abs(run.u[-1]).max() < 1e-9


@pytest.mark.slow
def test_a_flexible_arm_sticks_while_its_beam_vibrates():
    builder = ModelBuilder('flexible', gravity=(0, 0, 0))
    link = FlexibleLink(length=1.0, density=0.8, stiffness=120.0, modes=(1, 0))
    builder.beam('arm', 'world', link, axis=(0, 0, 1), friction=3.0)
    robot = Robot(builder.model())
    run = exact(robot, [0.0, 0.0], [3.0, 0.0], 1.0, step=1e-4)
    assert run.sticking[-1, 0] and run.u[-1, 0] == 0.0
    energy = run.energy.sum(axis=1)
    held = run.sticking[:, 0] & (run.t > 0.9)
    assert held.sum() > 50 and np.ptp(energy[held]) < 1e-6 * energy[0]


def worm(driving=0.3, backdriven=1.4, **law):
    """Return a bar of 1 kg and 1 m on a drive with load friction."""
    builder = ModelBuilder('worm')
    builder.body('bar', axis=(0, -1, 0), inertial=rod(1.0, (0, 0, 0), (1, 0, 0)),
                 load_friction=driving, load_friction_backdriven=backdriven, **law)
    return Robot(builder.model())


WEIGHT = 0.5 * 9.81


def test_a_self_locking_drive_holds_any_load_and_lifts_above_its_efficiency():
    for tau in (0.0, 3.0, 1.3 * WEIGHT - 1e-6):
        assert exact(worm(), [0.0], [0.0], 0.2, torque=[tau]).sticking.all()
    run = exact(worm(), [0.0], [0.0], 1e-3, torque=[8.0])
    assert run.udot[0, 0] == pytest.approx((8.0 / 1.3 - WEIGHT) * 3.0, rel=1e-9)
    # A drive that is not self-locking falls where the load exceeds its friction.
    for backdriven, tau, sticks in ((0.4, 0.61 * WEIGHT, True),
                                    (0.4, 0.59 * WEIGHT, False)):
        run = exact(worm(backdriven=backdriven), [0.0], [0.0], 0.1, torque=[tau])
        assert run.sticking[-1, 0] == sticks


def test_a_self_locking_drive_stops_at_once_without_its_motor():
    torque = np.where(np.arange(1000) < 500, 8.0, 0.0)[:, None]
    run = exact(worm(), [0.0], [0.0], 1.0, torque=torque)
    moving = run.t < 0.4995
    assert (run.u[1:][moving[1:], 0] > 0.0).all()
    assert (run.u[~moving & (run.t > 0.5005), 0] == 0.0).all()


def test_a_load_that_helps_the_motor_of_a_self_locking_drive_is_refused():
    with pytest.raises(InputError, match="self-locking joint 'bar' helps its motor"):
        simulate(worm(), [0.0], [0.0], 0.1, step=STEP, torque=[-3.0], sticking=True)


def test_rigid_gears_that_lock_have_three_motions_where_the_load_helps_the_motor():
    inertia = 1.0 / 3.0
    driving = 0.3
    backdriven = 1.4
    joint = worm(driving, backdriven).model.bodies[0].joint
    for motor in (0.1, 1.0, 1.9):  # below (1.4 - 1) WEIGHT = 1.96, with the load -WEIGHT
        # Rest: friction carries load and motor, within what the drive holds.
        least, largest = holding_interval(joint, -WEIGHT)
        assert least < motor + WEIGHT < largest
        # Forward accelerations a: the drive bears L = I a - WEIGHT, and motor = L +
        # friction.
        for load in (motor / (1.0 + driving), -motor / (backdriven - 1.0)):
            assert (load + WEIGHT) / inertia > 0.0
            friction = friction_torque(joint, 0.0, load, 1.0)
            assert load + friction == pytest.approx(motor, rel=1e-12)
        with pytest.raises(InputError, match="self-locking joint 'bar' helps its motor"):
            exact(worm(driving, backdriven), [0.0], [0.0], 0.1, torque=[-motor])
    # Beyond, neither rest nor a driving load is possible.
    motor = 2.0
    assert motor + WEIGHT > holding_interval(joint, -WEIGHT)[1]
    assert -motor / (backdriven - 1.0) + WEIGHT < 0.0


def test_nothing_sticks_without_friction():
    free = simulate(wheel(), [0.0], [1.0], 1.0, step=STEP, sticking=True)
    assert not free.sticking.any() and free.q[-1, 0] == pytest.approx(1.0)
    with pytest.raises(InputError, match="sticking: 'yes'; expected True or False"):
        simulate(wheel(), [0.0], [1.0], 1.0, sticking='yes')


def test_joints_without_friction_move_between_their_stops():
    builder = ModelBuilder('arm')
    builder.body('link', axis=(0, -1, 0), inertial=rod(2.0, (0, 0, 0), (0.8, 0, 0)),
                 limits=Limits(-2.0, 2.0))
    robot = Robot(builder.model())
    for q in (0.3, np.pi - 1.3):  # falls, from both sides of the lowest position
        run = exact(robot, [q], [0.0], 0.2, stops=True)
        free = simulate(robot, [q], [0.0], 0.2, step=STEP)
        np.testing.assert_allclose(run.q, free.q, atol=1e-12)
        assert not run.sticking.any()


def test_the_command_line_has_exact_friction(capsys, tmp_path):
    supplement = tmp_path / 'rub.yaml'
    supplement.write_text(
        'joints: {joint1: {friction: 200.0}, joint2: {friction: 200.0}}')
    asked = ['simulate', str(resource_path('urdf', 'two_link.urdf')), '--supplement',
             str(supplement), '--duration', '0.1', '--json', '--sticking']
    assert main(asked) == 0
    result = json.loads(capsys.readouterr().out)
    assert result['u'] == [0.0, 0.0]


def test_sticking_joints_are_saved_and_read(tmp_path):
    run = exact(wheel(friction=2.0), [0.0], [1.0], 1.0)
    run.save_npz(tmp_path / 'run.npz')
    loaded = Trajectory.load_npz(tmp_path / 'run.npz')
    np.testing.assert_array_equal(loaded.sticking, run.sticking)
    assert loaded.sticking.dtype == bool
    run.save_csv(tmp_path / 'run.csv')


@pytest.mark.parametrize('stops_of_first_run', [np.inf, 1.0])
@pytest.mark.parametrize('law', [{'friction': 0.01}, {
    'friction': 0.01, 'presliding_stiffness': 50.0}], ids=['dry', 'bristles'])
def test_stops_are_those_of_the_present_limits(stops_of_first_run, law):
    # Two wheels, of which the second has no friction: without a stop it is never held.
    # In chosen speeds the simulation runs in a robot of its own.
    b = ModelBuilder('wheels', gravity=(0, 0, 0))
    for name, friction in (('first', law), ('second', {})):
        b.body(name, axis=(0, 0, 1), inertial=rod(1.0, (0, 0, 0), (1, 0, 0)), **friction)
    sticks = 'presliding_stiffness' not in law
    for robot in (Robot(b.model()), Robot(b.model(), speeds=absolute_rates)):
        most = {}
        for stop in (stops_of_first_run, 0.4, np.inf, 0.6):
            ends = np.array([stop, 0.5 * stop])
            robot.limits = replace(robot.limits, lower=-ends, upper=ends)
            run = simulate(robot, [0.0, 0.0], [1.0, 0.5], 2.0, step=2e-3, stops=True,
                           sticking=sticks, torque=[0.5, 0.1])
            most[stop] = run.q[:, 0].max()
            assert (run.q[:, 1] <= 0.5 * stop + 1e-6).all()
            pressed = np.abs(run.stop_forces[-1, 0]) > 0.1
            assert pressed == np.isfinite(stop)
        for stop in (0.4, 0.6):
            assert most[stop] == pytest.approx(stop, abs=1e-6)
        assert most[np.inf] > 1.2
