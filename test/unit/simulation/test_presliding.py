"""Friction with its own state: Dahl, LuGre, all mechanisms, energy, stops."""

from dataclasses import replace

from kane_dynamics import (ComputedTorque, Drive, Limits, longest_step, ModelBuilder,
                           Motion, point_mass, PointVelocity, Prescribed, Robot, rod,
                           simulate, Trajectory, with_drives)
from kane_dynamics.errors import InputError, ModelError, ModelWarning
from kane_dynamics.model.drive import friction_seen_through
from kinds_of_mechanism import case, KINDS
from mechanisms import wheel
import numpy as np
import pytest
from scipy.integrate import solve_ivp

# Canudas de Wit, Olsson, Astrom & Lischinsky 1995, table I.
STIFFNESS = 1e5
DAMPING = np.sqrt(1e5)
VISCOUS = 0.4
COULOMB = 1.0
STATIC = 1.5
STRIBECK = 1e-3
LUGRE = {'damping': VISCOUS, 'friction': COULOMB, 'breakaway_friction': STATIC,
         'stribeck_speed': STRIBECK, 'presliding_stiffness': STIFFNESS,
         'presliding_damping': DAMPING}
IN_SHORT_RUN = (('tree', 'implicit'),)
DAHL = {'friction': 2.0, 'presliding_stiffness': 500.0}


def block(**law):
    """Return a mass of 1 kg that slides with friction."""
    builder = ModelBuilder('block', gravity=(0, 0, 0))
    builder.body('block', kind='prismatic', axis=(1, 0, 0), inertial=point_mass(1.0),
                 **law)
    return Robot(builder.model())


def pulled(speed=0.1, stiffness=2.0):
    """Return a block pulled by a spring whose other end moves steadily."""
    builder = ModelBuilder('pulled', gravity=(0, 0, 0))
    builder.body('block', kind='prismatic', axis=(1, 0, 0), inertial=point_mass(1.0),
                 **LUGRE)
    builder.body('hook', 'block', kind='prismatic', axis=(1, 0, 0), stiffness=stiffness)
    builder.frame('eye', 'hook')
    hook = PointVelocity('eye', (1, 0, 0), value=speed)
    return Robot(builder.model(), constraints=[hook], independent=['block'])


def readable_friction(v, z):
    """Return the friction and the rate of the deflection, of LuGre, as in the paper."""
    g = COULOMB + (STATIC - COULOMB) * np.exp(-(v / STRIBECK)**2)
    rate = v - STIFFNESS * abs(v) / g * z
    return STIFFNESS * z + DAMPING * rate + VISCOUS * v, rate


def reference(force, duration, tolerance=1e-11, times=None, method='Radau'):
    """Return x, v and z of a block under force(t, x), by a stiff integrator of SciPy."""
    def rates(t, y):
        x, v, z = y
        friction, rate = readable_friction(v, z)
        return [v, force(t, x) - friction, rate]
    return solve_ivp(rates, (0.0, duration), np.zeros(3), method, rtol=tolerance,
                     atol=1e-3 * tolerance, t_eval=times).y


@pytest.mark.parametrize('integrator, steps, order', [
    pytest.param('rk4', (2.5e-4, 1.25e-4), 4, marks=pytest.mark.slow),
    ('implicit', (1e-3, 5e-4), 2)])
def test_a_block_breaks_away_as_a_stiff_reference_at_the_order_of_the_integrator(
        integrator, steps, order):
    robot = block(**LUGRE)
    expected = reference(lambda t, x: 2.0, 0.1)[:, -1]
    errors = []
    for step in steps:
        run = simulate(robot, [0.0], [0.0], 0.1,
                       step=step, torque=[2.0], integrator=integrator)
        assert run.warnings == () and run.bristle_names == ('block',)
        reached = np.concatenate([run.q[-1], run.u[-1], run.bristles[-1]])
        errors.append(np.abs(reached - expected)[:2])
    np.testing.assert_array_less(0.8 * 2.0**order * errors[1], errors[0])
    assert errors[1].max() < (1e-9 if order == 4 else 5e-6)


def driven_block(amplitude, w, **law):
    """Return a block that follows amplitude sin(w t), beside a free wheel."""
    builder = ModelBuilder('driven', gravity=(0, 0, 0))
    builder.body('block', kind='prismatic', axis=(1, 0, 0), inertial=point_mass(1.0),
                 **law)
    builder.body('wheel', axis=(1, 0, 0), inertial=rod(1.0, (0, 0, 0), (0, 0.3, 0)))
    path = Prescribed('block', lambda t: amplitude * np.sin(w * t))
    return Robot(builder.model(), constraints=[path], independent=['wheel'])


@pytest.mark.parametrize('integrator, error', [
    pytest.param('rk4', 1e-8, marks=pytest.mark.slow), ('implicit', 2e-5)])
def test_dahls_friction_follows_its_closed_form_through_reversals(integrator, error):
    # dz/dx = 1 - z / z_s forward and 1 + z / z_s backward, z_s = friction / stiffness.
    amplitude = 0.02
    w = 2.0 * np.pi
    robot = driven_block(amplitude, w, **DAHL)
    run = simulate(robot, [0.0, 0.0], [0.0], 1.25, step=1e-3, sample=1e-3, t0=0.0,
                   integrator=integrator)
    x = run.q[:, 0]
    z_s = DAHL['friction'] / DAHL['presliding_stiffness']
    z = np.zeros_like(x)
    start = 0.0
    begin = 0
    for end, sign in ((250, 1.0), (750, -1.0), (1250, 1.0)):
        part = slice(begin, end + 1)
        travel = np.abs(x[part] - x[begin])
        z[part] = sign * z_s + (start - sign * z_s) * np.exp(-travel / z_s)
        start = z[end]
        begin = end
    np.testing.assert_allclose(run.bristles[:, 0], z, atol=error * z_s)

    # The force that moves the block carries friction; a cycle of the loop costs energy.
    force = run.constraint_forces[:, 0] + run.q[:, 0] * w**2
    np.testing.assert_allclose(force, DAHL['presliding_stiffness'] * z, atol=2e-4)


def test_a_force_below_breakaway_moves_a_block_along_the_hysteresis_loop_of_the_paper():
    # The force rises to 95 % of breakaway, falls to its opposite, and rises again.
    turns = np.array([0.0, 0.5, 1.5, 2.5])
    peaks = np.array([0.0, 1.425, -1.425, 1.425])
    step = 5e-4
    middles = np.arange(0.5 * step, turns[-1], step)
    run = simulate(block(**LUGRE), [0.0], [0.0], turns[-1], step=step, sample=step,
                   torque=np.interp(middles, turns, peaks)[:, None],
                   integrator='implicit')
    assert run.warnings == ()
    expected = reference(
        lambda t, x: np.interp(t, turns, peaks), turns[-1], 1e-10, run.t, 'LSODA')[0]
    x = run.q[:, 0]
    np.testing.assert_allclose(x, expected, atol=1e-3 * np.ptp(expected))
    # It gives back less than it took: the loop is passed clockwise, force over position.
    loop = run.t >= turns[1]
    force = np.interp(run.t[loop], turns, peaks)
    dissipated = np.trapezoid(force, x[loop])
    assert dissipated > 0.1 * np.ptp(force) * np.ptp(x[loop])
    # Without force it keeps a part of its deflection.
    assert np.interp(0.0, -force[:2000], x[loop][:2000]) > 0.1 * x.max()


@pytest.mark.slow
def test_a_block_that_a_spring_pulls_sticks_and_slips_as_a_stiff_reference():
    times = np.arange(0.0, 20.01, 0.5)
    expected = reference(lambda t, x: 2.0 * (0.1 * t - x), 20.0, 1e-9, times)
    errors = []
    for step in (1e-3, 5e-4):
        run = simulate(pulled(), [0.0, 0.0], [0.0], 20.0, step=step, sample=0.5)
        assert run.warnings == ()
        errors.append(np.abs(run.q[:, 0] - expected[0]).max())
    # It sticks until the spring pulls with breakaway friction, after 7.5 s.
    assert np.abs(run.q[times < 7.4, 0]).max() < 5e-5 < run.q[times > 8.5, 0].min()
    slips = np.diff(run.q[:, 0]) > 0.1
    assert slips.any() and (~slips[times[:-1] > 9.0]).any()
    assert errors[1] < 2e-4 and errors[1] < 0.35 * errors[0]


@pytest.mark.slow
def test_breakaway_force_falls_with_the_force_rate_as_a_stiff_reference():
    robot = block(**LUGRE)
    forces = []
    for rate in (1.0, 4.0, 16.0):
        duration = 2.0 / rate
        step = 1e-4 / np.sqrt(rate)
        count = round(duration / step)
        ramp = rate * step * (np.arange(count) + 0.5)
        run = simulate(robot, [0.0], [0.0], duration, step=step, sample=step,
                       torque=ramp[:, None])
        expected = reference(lambda t, x, rate=rate: rate * t, duration, 1e-9, run.t)
        # Breakaway is where the deflection is largest.
        at = int(np.argmax(run.bristles[:, 0]))
        assert abs(at - int(np.argmax(expected[2]))) <= 3
        forces.append(rate * run.t[at])
    assert (np.diff(forces) < -1e-3).all()
    assert forces[-1] > COULOMB
    assert forces[0] < STATIC


@pytest.mark.parametrize('kind, integrator', [
    pytest.param(kind, integrator,
                 marks=() if (kind, integrator) in IN_SHORT_RUN else pytest.mark.slow)
    for kind in KINDS for integrator in ('rk4', 'implicit')])
def test_every_kind_of_mechanism_moves_as_a_readable_reference(kind, integrator):
    smooth = case(kind)
    bodies = []
    for body in smooth.robot.model.bodies:
        joint = body.joint
        if joint.friction:
            joint = replace(joint, presliding_stiffness=60.0, presliding_damping=1.5,
                            breakaway_friction=1.4 * joint.friction, stribeck_speed=0.2)
        bodies.append(replace(body, joint=joint))
    model = replace(smooth.robot.model, bodies=tuple(bodies))
    robot = Robot(model, **smooth.robot.options)
    joints = [body.joint for body in bodies if body.joint.friction]
    assert joints or kind == 'closed loop' or kind == 'nonholonomic'
    t0 = smooth.time

    def rates(t, y):
        # The smooth robot, with the torques by which both laws differ.
        q, u, z = np.split(y, [robot.n_q, robot.n_q + robot.n])
        at = {'t': t} if smooth.t else {}
        v = joint_speeds(smooth.robot, q, u, at)
        torques = np.zeros(robot.model.n)
        changes = []
        for joint, deflection in zip(joints, z):
            rate = v[joint.coordinate]
            g = joint.friction * (1.0 + 0.4 * np.exp(-(rate / 0.2)**2))
            change = rate - 60.0 * abs(rate) / g * deflection
            law = 60.0 * deflection + 1.5 * change
            smooth_law = joint.friction * np.tanh(rate / joint.friction_speed)
            torques[joint.coordinate] += smooth_law - law
            changes.append(change)
        force = smooth.robot.generalized_force(torques, q, **at)
        udot = smooth.robot.forward_dynamics(q, u, force, **at)
        return np.concatenate([smooth.robot.joint_rates(q, u, **at), udot, changes])
    start = np.concatenate([smooth.q, smooth.u, np.zeros(len(joints))])
    expected = solve_ivp(rates, (t0, t0 + 0.1), start, 'DOP853',
                         rtol=1e-9, atol=1e-11).y[:, -1]
    step = 5e-4
    run = simulate(robot, smooth.q, smooth.u, 0.1,
                   step=step, t0=t0, integrator=integrator)
    assert run.warnings == ()
    reached = np.concatenate([run.q[-1], run.u[-1], run.bristles[-1]])
    np.testing.assert_allclose(reached, expected, rtol=0.0,
                               atol=2e-6 if integrator == 'rk4' else 3e-4)
    last = rates(run.t[-1], reached)[robot.n_q:robot.n_q + robot.n]
    np.testing.assert_allclose(run.udot[-1], last, rtol=1e-9, atol=1e-9)


def joint_speeds(robot, q, u, at):
    """Return the joint rates, angular velocities of ball joints included."""
    t = at.get('t', 0.0)
    return np.asarray(robot.equations.joint_speeds(q, u, t), dtype=float)


def test_a_constant_load_below_friction_does_not_creep_in_an_hour():
    robot = block(**DAHL, presliding_damping=200.0)
    run = simulate(robot, [0.0], [0.0], 3600.0, step=0.01, torque=[1.5], sample=60.0)
    # It rests where its bristles bear the load.
    np.testing.assert_allclose(run.bristles[-1], 1.5 / 500.0, rtol=1e-9)
    assert run.q[1, 0] > 0.005 and np.ptp(run.q[5:]) < 1e-12


def test_energy_of_bristles_and_of_the_block_is_the_work_less_what_is_dissipated():
    robot = block(**LUGRE)
    step = 2e-5
    torque = 1.2 + 0.6 * np.sin(40.0 * step * np.arange(10000))
    run = simulate(robot, [0.0], [0.0], 0.2, step=step, sample=step,
                   torque=torque[:, None])
    assert run.warnings == ()
    v = run.u[:, 0]
    z = run.bristles[:, 0]
    friction, rate = readable_friction(v, z)
    lost = friction * v - STIFFNESS * z * rate
    assert (lost > -1e-12).all()
    dissipated = np.sum(0.5 * step * (lost[1:] + lost[:-1]))
    work = np.sum(torque * np.diff(run.q[:, 0]))
    expected = 0.5 * v[-1]**2 + 0.5 * STIFFNESS * z[-1]**2
    assert run.energy[-1].sum() == pytest.approx(expected, rel=1e-12)
    assert work - dissipated == pytest.approx(expected, rel=1e-4)


def test_steady_sliding_has_the_friction_of_the_law_without_bristles():
    law = {'damping': 0.3, 'fast_damping': 0.9, 'friction': 1.0,
           'friction_backward': 0.6,
           'breakaway_friction': 1.2, 'stribeck_speed': 0.5, 'friction_offset': 0.05}
    sliding = block(**law, friction_speed=1e-3)
    bristled = block(**law, presliding_stiffness=2e3, presliding_damping=5.0)
    for torque in (2.0, -2.0):
        run = simulate(bristled, [0.0], [0.0], 30.0,
                       step=1e-3, torque=[torque], sample=30.0)
        assert abs(run.udot[-1, 0]) < 1e-8
        friction = sliding.friction_force(run.u[-1])
        np.testing.assert_allclose(friction, torque, rtol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize('torque, drives', [(4.0, True), (-4.0, False)])
def test_the_level_of_bristles_has_the_friction_of_the_load(torque, drives):
    # A block on a slope: gravity is 2 N against positive motions.
    builder = ModelBuilder('slope', gravity=(-2.0, 0, 0))
    law = {'friction': 0.5, 'load_friction': 0.2, 'load_friction_backdriven': 0.1,
           'damping': 3.0}
    builder.body('block', kind='prismatic', axis=(1, 0, 0), inertial=point_mass(1.0),
                 presliding_stiffness=2e3, **law)
    robot = Robot(builder.model())
    run = simulate(robot, [0.0], [0.0], 10.0, step=1e-3, torque=[torque], sample=10.0)
    assert run.warnings == ()
    # At a constant speed the load is 2 N: tau = 2 + d v + sign(v) (0.5 + fraction 2).
    level = 0.5 + 2.0 * (0.2 if drives else 0.1)
    v = (torque - 2.0 - np.sign(torque) * level) / 3.0
    assert run.u[-1, 0] == pytest.approx(v, rel=1e-9)


@pytest.mark.slow
def test_a_stop_holds_a_block_whose_bristles_are_bent():
    builder = ModelBuilder('stopped', gravity=(0, 0, 0))
    builder.body('block', kind='prismatic', axis=(1, 0, 0), inertial=point_mass(1.0),
                 limits=Limits(-1.0, 0.01), **LUGRE)
    robot = Robot(builder.model())
    run = simulate(robot, [0.0], [0.0], 0.3, step=1e-3, torque=[2.0], stops=True)
    assert run.warnings == () and len(run.stop_events) == 1
    assert run.q[-1, 0] == 0.01 and run.u[-1, 0] == 0.0
    # The bristles still bear what they did when it slid, the stop the rest.
    carried = STIFFNESS * run.bristles[-1, 0]
    assert carried == pytest.approx(COULOMB, rel=1e-3)
    assert run.stop_forces[-1, 0] == pytest.approx(carried - 2.0, rel=1e-9)


@pytest.mark.slow
def test_computed_torque_acts_on_a_joint_with_bristles():
    robot = wheel(**DAHL)
    motion = Motion.from_points([0.0, 0.5], [[0.0], [0.4]],
                                joint_names=robot.joint_names)
    run = simulate(robot, [0.0], [0.0], 0.5, step=1e-3,
                   torque=ComputedTorque(robot, motion, kp=400.0, kd=40.0))
    assert run.warnings == () and np.abs(run.q[-1] - 0.4).max() < 0.01
    assert run.bristles[-1, 0] > 0.003


def test_many_simulations_are_the_single_ones_and_start_bent():
    robot = block(**LUGRE)
    torque = np.full(1, 1.4)
    bent = np.array([[0.0], [1e-5], [-1e-5]])
    runs = simulate(robot, np.zeros((3, 1)), np.zeros((3, 1)), 0.05, torque=torque,
                    bristles0=bent)
    for k in range(3):
        one = simulate(robot, [0.0], [0.0], 0.05, torque=torque, bristles0=bent[k])
        np.testing.assert_allclose(runs.state(k).bristles, one.bristles,
                                   rtol=1e-12, atol=1e-18)
        np.testing.assert_allclose(runs.state(k).q, one.q, rtol=1e-12, atol=1e-18)
    assert np.ptp(runs.q[:, -1]) > 1e-7


def test_a_simulation_goes_on_from_its_last_deflection(tmp_path):
    robot = block(**LUGRE)
    whole = simulate(robot, [0.0], [0.0], 0.1, torque=[1.8])
    first = simulate(robot, [0.0], [0.0], 0.05, torque=[1.8])
    first.save_npz(tmp_path / 'first.npz')
    first = Trajectory.load_npz(tmp_path / 'first.npz')
    second = simulate(robot, first.q[-1], first.u[-1], 0.05, torque=[1.8],
                      bristles0=first.bristles[-1])
    np.testing.assert_array_equal(second.q[-1], whole.q[-1])
    assert second.bristle_names == ('block',)


def test_a_step_too_long_for_bristles_that_slide_is_reported():
    robot = block(**LUGRE)
    assert longest_step(robot, [0.0], [0.1]).step == pytest.approx(2.785e-4, rel=1e-2)
    with pytest.warns(ModelWarning,
                      match=r"too long for the bristles of joint 'block' with "
                      r"'rk4'; expected at most"):
        simulate(robot, [0.0], [0.0], 0.1, step=1e-3, torque=[2.0], integrator='rk4')


@pytest.mark.parametrize('options, text', [
    ({'sticking': True}, "sticking: joint 'block' has presliding_stiffness 100000"),
    ({'bristles0': [0.0, 1.0]}, r'bristles0: shape \(2,\); expected'),
    ({'bristles0': [np.nan]}, 'bristles0'), ({'bristles0': 'bent'}, 'bristles0'),
    ({'bristles0': [[0.0], [0.0]]}, r'bristles0: shape \(2, 1\); expected \(1,\)$')])
def test_options_without_meaning_for_bristles_are_refused(options, text):
    with pytest.raises(InputError, match=text):
        simulate(block(**LUGRE), [0.0], [0.0], 0.1, **options)


def test_deflections_of_a_robot_without_bristles_are_refused():
    with pytest.raises(InputError, match='bristles0: deflections for a robot without'):
        simulate(block(friction=1.0), [0.0], [0.0], 0.1, bristles0=[0.0])


@pytest.mark.parametrize('law, text', [
    ({'presliding_stiffness': 10.0}, 'presliding_stiffness 10.0 and friction 0'),
    ({'friction': 1.0, 'friction_backward': 0.0, 'presliding_stiffness': 10.0},
     'friction_backward 0'),
    ({'friction': 1.0, 'presliding_damping': 1.0}, 'without presliding_stiffness'),
    ({'friction': 1.0, 'presliding_stiffness': -1.0}, 'expected a nonnegative number')])
def test_impossible_bristles_are_refused(law, text):
    with pytest.raises(ModelError, match=text):
        block(**law)


def test_bristles_of_a_motor_are_seen_through_its_gear():
    builder = ModelBuilder('elastic')
    builder.body('link', axis=(0, 0, 1), inertial=rod(1.0, (0, 0, 0), (0.4, 0, 0)))
    law = {'friction': 0.04, 'presliding_stiffness': 0.2, 'presliding_damping': 2e-3}
    drive = Drive(stiffness=500.0, ratio=50.0, rotor_inertia=0.2,
                  friction=friction_seen_through(law, 50.0))
    robot = Robot(with_drives(builder.model(), {'link': drive}))
    run = simulate(robot, [0.0, 0.0], [0.0, 0.0], 4.0, step=1e-3, torque=[0.0, 1.5])
    assert run.bristle_names == ('link_motor',) and run.warnings == ()
    # The motor rests where the bristles bear its torque: 2 N m of friction, 500 N m/rad.
    np.testing.assert_allclose(run.bristles[-1], 1.5 / 500.0, rtol=1e-3)
