"""Vibrations of constrained mechanisms, of free and ball joints, and what has none."""

from functools import cache

from kane_dynamics import (absolute_rates, box, Inertial, InputError, ModelBuilder,
                           natural_vibration, Robot, rod, simulate)
from linkages import at_angle, four_bar, four_bar_model, PIN, sleigh
import numpy as np
import pytest


@cache
def hanging():
    """Return the configuration of the four-bar with least potential energy."""
    linkage = four_bar('crank')
    q = [at_angle(0.8)]
    for angle in np.linspace(0.8, 0.8 - 2.0 * np.pi, 200)[1:]:
        q.append(linkage.closed_configuration([angle, *q[-1][1:]], fixed=['crank']))
    best = min(q, key=linkage.potential_energy)
    for _ in range(20):  # Newton's method
        step = linkage.gravity_force(best)[0] / natural_stiffness(linkage, best)
        best = linkage.closed_configuration(best - [step, 0.0, 0.0], fixed=['crank'])
    return best


def natural_stiffness(linkage, q):
    """Return the stiffness in the crank angle."""
    return natural_vibration(linkage, q).frequencies[0]**2 * linkage.mass_matrix(q)[0, 0]


def test_a_linkage_released_beside_its_equilibrium_swings_at_its_natural_frequency():
    linkage = four_bar('crank')
    equilibrium = hanging()
    vibration = natural_vibration(linkage, equilibrium)
    assert vibration.frequencies.shape == (1,) and vibration.shapes.shape == (3, 1)
    beside = linkage.closed_configuration(equilibrium + [1e-4, 0.0, 0.0],
                                          fixed=['crank'])
    run = simulate(linkage, beside, [0.0], 4.0, step=1e-3, sample=1e-3)
    around = run.q[:, 0] - equilibrium[0]
    crossings = np.flatnonzero(np.diff(np.sign(around)))
    times = run.t[crossings] - around[crossings] * 1e-3 / np.diff(around)[crossings]
    period = 2.0 * (times[-1] - times[0]) / (len(times) - 1)
    assert len(times) >= 3
    assert 2.0 * np.pi / period == pytest.approx(vibration.frequencies[0], rel=1e-5)


def test_frequencies_are_those_of_every_choice_of_speeds():
    q = hanging()
    expected = natural_vibration(four_bar('crank'), q).frequencies
    for robot in (four_bar('rocker'), Robot(four_bar_model(), constraints=[PIN],
                                            speeds=absolute_rates)):
        np.testing.assert_allclose(natural_vibration(robot, q).frequencies, expected,
                                   rtol=1e-9)


def test_a_brake_on_a_dependent_joint_holds_the_linkage():
    assert natural_vibration(
        four_bar('crank'), at_angle(0.8), ['rocker']).frequencies.size == 0


def test_loaded_velocity_constraints_are_refused():
    with pytest.raises(InputError,
                       match=r"velocity .* \['runner'\] carries a load; expected"):
        natural_vibration(sleigh(), np.zeros(3))


@cache
def pendulum(height=-0.4):
    """Return a body on a ball joint, its center of mass above it by its axis."""
    b = ModelBuilder('pendulum')
    b.body('bob', kind='ball', inertial=Inertial(2.0, [0.0, 0.0, height],
                                                 np.diag([0.02, 0.03, 0.015])))
    return Robot(b.model())


@pytest.mark.parametrize('turn', [0.0, 0.7, -2.0])
def test_a_pendulum_on_a_ball_joint_swings_about_two_axes_and_turns_freely(turn):
    q = np.array([0.0, 0.0, np.sin(0.5 * turn), np.cos(0.5 * turn)])
    vibration = natural_vibration(pendulum(), q)
    swing = [np.sqrt(2.0 * 9.81 * 0.4 / (moment + 2.0 * 0.4**2))
             for moment in (0.03, 0.02)]
    assert vibration.frequencies[0] == 0.0
    np.testing.assert_allclose(vibration.frequencies[1:], swing, rtol=1e-12)
    assert vibration.names == ('bob/wx', 'bob/wy', 'bob/wz')
    size = [0.015, 0.03 + 0.32, 0.02 + 0.32]
    np.testing.assert_allclose(vibration.shapes**2, np.eye(3)[::-1] / size, atol=1e-12)
    beside = pendulum().integrate(q, 1e-4 * vibration.shapes[:, 1])
    run = simulate(pendulum(), beside, np.zeros(3), np.pi / swing[0],
                   step=np.pi / swing[0] / 500)
    back = pendulum().difference(q, run.q[-1])
    np.testing.assert_allclose(back, -1e-4 * vibration.shapes[:, 1], atol=1e-9)


def test_a_pendulum_on_its_head_falls_and_a_turned_one_is_refused():
    over = natural_vibration(pendulum(0.4), [0.0, 0.0, 0.0, 1.0]).frequencies
    np.testing.assert_allclose(over, [-np.sqrt(2.0 * 9.81 * 0.4 / (0.02 + 0.32)),
                                      -np.sqrt(2.0 * 9.81 * 0.4 / (0.03 + 0.32)), 0.0],
                               rtol=1e-12)
    turned = pendulum().integrate(np.array([0.0, 0.0, 0.0, 1.0]), [0.3, 0.0, 0.0])
    with pytest.raises(InputError,
                       match=r"ball joint .* among \['bob'\] carries a load"):
        natural_vibration(pendulum(), turned)
    held = natural_vibration(pendulum(), turned, ['bob/wx', 'bob/wy', 'bob/wz'])
    assert held.frequencies.size == 0


def test_two_free_bodies_on_a_spring_vibrate_by_their_reduced_mass():
    b = ModelBuilder('pair', gravity=(0.0, 0.0, 0.0))
    b.body('first', kind='free', inertial=box(3.0, (0.2, 0.3, 0.4)))
    b.body('second', 'first', 'prismatic', axis=(0.6, 0.8, 0.0), stiffness=50.0,
           inertial=box(5.0, (0.1, 0.2, 0.1)))
    robot = Robot(b.model())
    q = robot.random_configuration(3)
    q[-1] = 0.0
    vibration = natural_vibration(robot, q)
    assert (vibration.frequencies[:6] == 0.0).all()
    assert vibration.frequencies[6] == pytest.approx(np.sqrt(50.0 * (3.0 + 5.0) / 15.0),
                                                     rel=1e-12)


def test_vibrations_of_a_free_flying_arm_are_eigenvalues_of_its_forward_dynamics():
    b = ModelBuilder('satellite', gravity=(0.0, 0.0, 0.0))
    b.body('bus', kind='free',
           inertial=box(60.0, (1.2, 1.0, 1.4), at=(0.03, 0.02, 0.03)))
    on = 'bus'
    at = (0.6, 0.0, 0.0)
    for k, axis in enumerate(((0, 0, 1), (0, 1, 0), (1, 0, 0)), 1):
        b.body(f'joint{k}', on, axis=axis, at=at, stiffness=10.0 * k, rest=0.2 * k,
               inertial=box(8.0 - k, (0.4, 0.1, 0.1), at=(0.2, 0, 0.02)))
        on = f'joint{k}'
        at = (0.4, 0.0, 0.0)
    b.body('panel', 'bus', 'ball', at=(-0.6, 0, 0), inertial=box(4.0, (1.0, 0.5, 0.02),
                                                                 at=(-0.5, 0.0, 0.0)))
    robot = Robot(b.model())
    h = 1e-4
    q = robot.random_configuration(5)
    q[7:10] = 0.2, 0.4, 0.6  # the springs are at rest

    def acceleration(step):
        return robot.forward_dynamics(robot.integrate(q, step), 0.0 * step, 0.0 * step)
    A = np.array([(8.0 * (acceleration(h * e) - acceleration(-h * e))
                   - acceleration(2.0 * h * e) + acceleration(-2.0 * h * e)) / (12.0 * h)
                  for e in np.eye(robot.n)]).T
    expected = np.sqrt(np.sort(-np.linalg.eigvals(A).real)[-3:])
    vibration = natural_vibration(robot, q)
    assert (vibration.frequencies[:9] == 0.0).all()
    np.testing.assert_allclose(vibration.frequencies[9:], expected, rtol=1e-9)
    np.testing.assert_allclose(A @ vibration.shapes,
                               -vibration.shapes * vibration.frequencies**2,
                               atol=1e-8 * expected[-1]**2)


def test_bad_configurations_and_massless_motions_are_named():
    b = ModelBuilder('massless tip')
    b.body('arm', axis=(0, 0, 1), inertial=rod(1.0, (0, 0, 0), (0.3, 0, 0)))
    b.body('tip', 'arm', axis=(0, 0, 1), at=(0.3, 0, 0))
    robot = Robot(b.model())
    with pytest.raises(InputError,
                       match=r'mass matrix is singular .*; expected mass in every'):
        natural_vibration(robot, [0.0, 0.0])
    assert natural_vibration(robot, [0.0, 0.0], ['tip']).frequencies.shape == (1,)
    for q, words in ((np.zeros((2, 2)), r'q: shape \(2, 2\); expected \(2,\)'),
                     ('rest', "q: 'rest'; expected 2 numbers"),
                     ([0.0, np.nan], 'q of joint')):
        with pytest.raises(InputError, match=words):
            natural_vibration(robot, q)
    with pytest.raises(InputError, match=r'q: shape \(2,\); expected \(4,\)'):
        natural_vibration(pendulum(), [0.0, 0.0])
