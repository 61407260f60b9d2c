"""A watch and a crane: lengths times 1e-3 or 1e3 scale results as physics says."""

from dataclasses import replace
from functools import cache

from kane_dynamics import (absolute_rates, Closure, Coupling, Inertial,
                           inverse_kinematics, knife_edge, ModelBuilder,
                           natural_vibration, point_mass, Prescribed, Robot, rod,
                           Rolling, simulate)
from kane_dynamics.errors import ConstraintError
from kinds_of_mechanism import drive, model_of, state, T
from linkages import at_angle, five_bar, five_bar_at, four_bar_model, PIN
import numpy as np
import pytest
from scaled_models import scaled_model, units_of

SCALES = (1e-3, pytest.param(1e3, marks=pytest.mark.slow))
EVERY_TIME = ('slider-crank', 'rolling')  # compiling the others takes a minute
TOLERANCE = 1e-9


def slider_crank():
    """Return a crank that moves a piston, by a closure of mixed rows."""
    b = ModelBuilder('slider-crank')
    b.body('crank', axis=(0, -1, 0), inertial=rod(0.6, (0, 0, 0), (0.3, 0, 0)),
           damping=0.1, friction=0.2)
    b.body('bar', 'crank', axis=(0, -1, 0), at=(0.3, 0, 0), inertial=rod(1.8, (0, 0, 0),
                                                                         (0.9, 0, 0)))
    b.frame('end', 'bar', at=(0.9, 0, 0))
    b.body('piston', kind='prismatic', axis=(1, 0, 0), inertial=point_mass(2.0),
           stiffness=40.0, rest=1.0, damping=1.0, friction=0.5)
    return b.model()


def wheel():
    """Return a free wheel that rolls on a plane."""
    b = ModelBuilder('wheel')
    b.body('wheel', kind='free',
           inertial=Inertial(3.0, (0, 0, 0), np.diag([0.2, 0.4, 0.2])))
    return b.model()


MECHANISMS = {
    'tree': (lambda: model_of(()), lambda s: {}),
    'absolute rates': (lambda: model_of(()), lambda s: {'speeds': absolute_rates}),
    'closed loop': (lambda: model_of(('closed loop',)),
                    lambda s: {'constraints': [PIN]}),
    'slider-crank': (slider_crank, lambda s: {
        'constraints': [Closure('end', 'piston', 'revolute',
                                axis=(0, 1, 0), name='pin')], 'independent': ['crank']}),
    'nonholonomic': (lambda: model_of(('nonholonomic',)), lambda s: {
        'constraints': [knife_edge('cart', (0, 1, 0), name='runner')]}),
    'driven slide': (lambda: model_of(('nonholonomic',)), lambda s: {
        'constraints': [Prescribed('cart/x', lambda t: s * drive(t), name='drive')]}),
    'free and ball joints': (lambda: model_of(('free and ball joints',)), lambda s: {}),
    'rolling': (wheel, lambda s: {'constraints': [
        Rolling('wheel', 0.4 * s, axis=(0, 1, 0), name='roll')]}),
    'gear and slide': (slider_crank, lambda s: {'constraints': [
        Coupling('piston', {'crank': 0.2 * s}, offset=0.5 * s, name='gear')]})}


NAMES = [name if name in EVERY_TIME else pytest.param(name, marks=pytest.mark.slow)
         for name in MECHANISMS]


@cache
def robot_at(name, s):
    """Return a mechanism of `MECHANISMS` with lengths times s."""
    model, options = MECHANISMS[name]
    return Robot(scaled_model(model(), s), **options(s))


def guess_of(name):
    """Return an initial guess for loop closure, and speeds, by coordinates."""
    if name in ('slider-crank', 'gear and slide'):
        return np.array([0.8, -1.1, 1.1])
    if name == 'rolling':
        return np.array([0.1, 0.2, 0.41, 0.1, 0.05, 0.1, 0.9])
    return state(robot_at(name, 1.0))[0]


def assert_close(value, expected, tolerance=TOLERANCE):
    size = np.abs(expected).max(initial=0.0) or 1.0
    np.testing.assert_allclose(value, expected, rtol=0.0, atol=tolerance * size)


@pytest.mark.parametrize('s', SCALES)
@pytest.mark.parametrize('name', NAMES)
def test_quantities_scale(name, s):
    one = robot_at(name, 1.0)
    scaled = robot_at(name, s)
    assert scaled.speed_names == one.speed_names
    of_q, of_u, of_rows = units_of(one, s)
    guess = guess_of(name)
    t = {'t': T} if one.equations.timed else {}
    q = guess
    q_other = of_q * guess
    if one.constraint_names:
        q = one.closed_configuration(guess, t=T)
        q_other = scaled.closed_configuration(of_q * guess, t=T)
        assert_close(q_other / of_q, q)
        assert scaled.mechanism.kept == one.mechanism.kept
    rng = np.random.default_rng(2)
    u, udot, tau = rng.uniform(-1.0, 1.0, (3, one.n))
    force = s**2 / of_u
    scaled_state = q_other, of_u * u
    assert_close(scaled.inverse_dynamics(*scaled_state, of_u * udot, **t) / force,
                 one.inverse_dynamics(q, u, udot, **t))
    assert_close(scaled.forward_dynamics(*scaled_state, force * tau, **t) / of_u,
                 one.forward_dynamics(q, u, tau, **t), 1e-8)
    assert_close(scaled.mass_matrix(q_other, **t) / np.outer(force, 1.0 / of_u),
                 one.mass_matrix(q, **t))
    assert_close(scaled.friction_force(of_u * u, q_other, **t) / force,
                 one.friction_force(u, q, **t))
    assert_close(scaled.kinetic_energy(*scaled_state, **t) / s**2,
                 one.kinetic_energy(q, u, **t))
    assert_close(scaled.potential_energy(q_other) / s**2, one.potential_energy(q))
    if one.constraint_names:
        assert_close(
            scaled.constraint_forces(*scaled_state, force * tau, **t) / (s**2 / of_rows),
            one.constraint_forces(q, u, tau, **t), 1e-8)


@pytest.mark.parametrize('s', SCALES)
@pytest.mark.parametrize('name', NAMES)
def test_simulations_scale(name, s):
    one = robot_at(name, 1.0)
    scaled = robot_at(name, s)
    of_q, of_u, of_rows = units_of(one, s)
    guess = guess_of(name)
    q = guess
    q_other = of_q * guess
    if one.constraint_names:
        q = one.closed_configuration(guess, t=T)
        q_other = scaled.closed_configuration(of_q * guess, t=T)
    u = np.linspace(0.5, 1.0, one.n)
    runs = [simulate(robot, *start, 0.2, step=1e-3, t0=T, sample=0.02)
            for robot, start in ((one, (q, u)), (scaled, (q_other, of_u * u)))]
    assert_close(runs[1].q / of_q, runs[0].q, 1e-8)
    assert_close(runs[1].u / of_u, runs[0].u, 1e-8)
    assert_close(runs[1].udot / of_u, runs[0].udot, 1e-7)
    assert_close(runs[1].energy / s**2, runs[0].energy, 1e-8)
    assert_close(runs[1].constraint_forces / (s**2 / of_rows), runs[0].constraint_forces,
                 1e-7)
    assert np.abs(runs[1].constraint_residual / of_rows).max(initial=0.0) < 1e-11


@pytest.mark.slow
@pytest.mark.parametrize('s', [2.0**-10, 2.0**10])  # which round nothing
def test_stops_in_singular_speeds_scale_bit_for_bit(s):
    def run(s):
        robot = Robot(scaled_model(four_bar_model(bars=(0.5, 0.9, 0.5)), s),
                      constraints=[PIN])
        q = robot.closed_configuration((0.8, 0.0, -1.5))
        robot.limits = replace(robot.limits, lower=np.array([-1.2, -np.inf, -np.inf]))
        return simulate(robot, q, [1.0], 1.5, torque=np.array([2.0 * s**2]), sample=0.01,
                        stops=True)
    one, scaled = run(1.0), run(s)
    assert [event.t for event in scaled.stop_events] == [
        event.t for event in one.stop_events]
    assert one.stop_events
    assert np.array_equal(scaled.q, one.q)
    assert np.array_equal(scaled.stop_forces / s**2, one.stop_forces)


@pytest.mark.parametrize('s', SCALES)
def test_a_slide_at_its_stop_scales(s):
    def run(s):
        b = ModelBuilder('carts')
        for name in ('first', 'second'):
            b.body(name, kind='prismatic', axis=(1, 0, 0), inertial=point_mass(1.0))
            b.body(f'{name}_bob', name, axis=(0, 1, 0),
                   inertial=rod(1.0, (0, 0, 0), (0, 0, -0.5)))
        robot = Robot(scaled_model(b.model(), s),
                      constraints=[Coupling('second', {'first': 0.5}, name='gear')])
        upper = np.full(robot.n_q, np.inf)
        upper[0] = 0.1 * s
        robot.limits = replace(robot.limits, upper=upper)
        _, of_u, _ = units_of(robot, s)
        q = np.array([0.0, 0.1, 0.0, 0.3])
        of_q = np.array([s, 1.0, s, 1.0])
        u = of_u * np.array([0.5 if name in ('first', 'second') else 0.0
                             for name in robot.speed_names])
        torque = s**2 / of_u * np.array([3.0 if name in ('first', 'second') else 0.0
                                         for name in robot.speed_names])
        trajectory = simulate(robot, of_q * q, u, 0.6,
                              torque=torque, stops=True, sample=0.02)
        return trajectory, of_q
    (one, _), (scaled, of_q) = run(1.0), run(s)
    assert len(one.stop_events) == len(scaled.stop_events) > 0
    assert_close(scaled.q / of_q, one.q, 1e-7)
    assert_close(scaled.stop_forces / (s**2 / of_q), one.stop_forces, 1e-5)
    assert one.stop_forces.any()


@pytest.mark.parametrize('s', [1e-6, 1e5])
@pytest.mark.parametrize('angle', [1e-4, 0.05])
def test_an_open_loop_is_refused_alike(s, angle):
    robot = Robot(scaled_model(four_bar_model(), s), constraints=[PIN])
    with pytest.raises(ConstraintError, match=r'its residual is .* m at'):
        robot.inverse_dynamics(at_angle(0.8) + [0.0, angle + 1e-4, 0.0], [1.0], [0.0])
    robot.inverse_dynamics(at_angle(0.8) + [0.0, 1e-6, 0.0], [1.0], [0.0])


@pytest.mark.slow
@pytest.mark.parametrize('s', SCALES)
def test_inverse_kinematics_and_vibrations_scale(s):
    one = robot_at('tree', 1.0)
    scaled = robot_at('tree', s)
    q = state(one)[0]
    target = one.frame_pose('tool', q)
    scaled_target = target.copy()
    scaled_target[:3, 3] *= s
    solutions = [inverse_kinematics(robot, 'tool', pose, q + 0.05) for robot, pose in (
        (one, target), (scaled, scaled_target))]
    assert solutions[0].converged == solutions[1].converged
    assert_close(solutions[1].q, solutions[0].q, 1e-6)
    frequencies = [natural_vibration(robot, q).frequencies for robot in (one, scaled)]
    assert_close(frequencies[1], frequencies[0], 1e-8)


@pytest.mark.slow
@pytest.mark.parametrize('s', SCALES)
def test_a_five_bar_scales_on_its_stop(s):
    q = five_bar_at(2.2, 0.9)
    one = five_bar('left_crank', 'right_crank')
    runs = []
    for scale in (1.0, s):
        robot = Robot(scaled_model(one.model, scale), **{
            key: value
            for key, value in one.options.items() if key != 'closure_tolerance'})
        robot.limits = replace(robot.limits,
                               upper=np.array([2.2, np.inf, np.inf, np.inf]))
        runs.append(simulate(robot, q, np.zeros(2), 0.1, stops=True, sample=0.01,
                             torque=scale**2 * np.array([60.0, 5.0])))
    assert_close(runs[1].q, runs[0].q, 1e-9)
    assert_close(runs[1].stop_forces / s**2, runs[0].stop_forces, 1e-6)
    assert_close(runs[1].udot, runs[0].udot, 1e-6)
