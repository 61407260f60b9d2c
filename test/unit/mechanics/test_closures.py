"""Closures of every kind: what they hold, at the right orientation, in axes."""

from functools import cache

from constrained_trees import AXIS, closure, CLOSURES, two_bodies_on_a_base
from kane_dynamics import (Closure, ConstraintError, ModelBuilder, point_mass, Robot,
                           rod, simulate)
from kane_dynamics.mechanics.constraints.independent_speeds import (choose_independent,
                                                                    closed_configuration)
import numpy as np
import pytest

# Of each kind: may the first origin move along the axis, and across it (second's axes);
# may the frames turn about the axis, and tilt it.
FREE = {'weld': '', 'revolute': 'turn', 'prismatic': 'along',
        'cylindrical': 'along turn',
        'spherical': 'turn tilt', 'planar': 'across turn', 'inline': 'along turn tilt'}


def at(mechanism, q):
    """Return the first origin in the second's axes, and the relative rotation."""
    placed = mechanism.state(q)
    R1, p1 = placed.pose('end')
    R2, p2 = placed.pose('socket')
    return R2.T @ (p1 - p2), R2.T @ R1


def residual(mechanism, q):
    """Return the residuals and the rows at a configuration."""
    rows = mechanism.rows(mechanism.state(q))
    return np.array(rows.residual, dtype=float), np.array(rows.J, dtype=float)


@pytest.mark.parametrize('kind', FREE)
def test_a_closed_loop_is_what_its_kind_says(kind):
    mechanism = choose_independent(two_bodies_on_a_base(), None, (closure(kind),))
    rng = np.random.default_rng(1)
    moved = dict.fromkeys(('along', 'across', 'turn', 'tilt'), 0.0)
    for _ in range(20):
        r, Q = at(mechanism, closed_configuration(mechanism, rng.uniform(-1.5, 1.5, 15)))
        tilt = np.arccos(np.clip(AXIS @ Q @ AXIS, -1.0, 1.0))
        turn = np.arccos(np.clip((np.trace(Q) - 1.0) / 2.0, -1.0, 1.0))
        for word, size in (('along', abs(r @ AXIS)), ('tilt', tilt),
                           ('turn', turn - tilt),
                           ('across', np.linalg.norm(r - (r @ AXIS) * AXIS))):
            moved[word] = max(moved[word], size)
    for word, size in moved.items():
        assert (size
                > 0.1) if word in FREE[kind].split() else (size < 1e-7), (word, size)


def test_a_universal_closure_keeps_its_axes_perpendicular_and_a_distance_its_length():
    universal = choose_independent(two_bodies_on_a_base(), None, (closure('universal'),))
    q = closed_configuration(universal, np.full(15, 0.4))
    r, Q = at(universal, q)
    np.testing.assert_allclose(r, 0.0, atol=1e-10)
    assert abs(universal.constraints[0].second_axis @ Q @ AXIS) < 1e-10
    distance = choose_independent(two_bodies_on_a_base(), None, (closure('distance'),))
    r, _ = at(distance, closed_configuration(distance, np.full(15, 0.4)))
    assert np.linalg.norm(r) == pytest.approx(0.5, abs=1e-10)


@pytest.mark.parametrize('kind', CLOSURES)
def test_rows_are_the_rates_of_their_residuals(kind):
    mechanism = choose_independent(two_bodies_on_a_base(), None, (closure(kind),))
    rng = np.random.default_rng(2)
    h = 1e-6
    for _ in range(5):
        q = closed_configuration(mechanism, rng.uniform(-1.5, 1.5, 15))
        for place, exact in ((q, True), (q + rng.uniform(-0.3, 0.3, 15), False)):
            J = residual(mechanism, place)[1]
            rate = np.array([(residual(mechanism, place + h * unit)[0]
                              - residual(mechanism, place - h * unit)[0]) / (2.0 * h)
                             for unit in np.eye(15)]).T
            turning = np.array(['turn_' in label for label in mechanism.labels])
            always = turning if kind == 'universal' else ~turning
            rows = slice(None) if exact else (always | ~turning)
            np.testing.assert_allclose(J[rows], rate[rows], atol=2e-8)


@pytest.mark.parametrize('kind',
                         ['weld', 'revolute', 'prismatic', 'cylindrical', 'planar'])
@pytest.mark.parametrize('angle',
                         [0.5, 2.0, 3.0, np.pi - 1e-9, np.pi, -3.0, 2.0 * np.pi])
def test_orientations_are_held_the_right_way_round(kind, angle):
    b = ModelBuilder('plate')
    b.body('cart', kind='prismatic', axis=(1, 0, 0), inertial=point_mass(1.0))
    b.body('plate', kind='floating', inertial=rod(1.0, (0, 0, 0), (0.3, 0.1, 0)))
    mechanism = choose_independent(b.model(), None, (Closure('plate', 'cart', kind),))
    for turned in (4, 5, 6):  # about x, y, z; only z is free to a revolute closure
        start = np.zeros(7)
        start[turned] = angle
        gap = np.abs(residual(mechanism, start)[0]).max()
        free = turned == 6 and kind not in ('weld', 'prismatic')
        assert np.isfinite(gap)
        assert (gap < 1e-12) == (free or angle == 2.0 * np.pi)
        R = mechanism.state(closed_configuration(mechanism, start)).pose('plate')[0]
        np.testing.assert_allclose(R[:, 2], [0, 0, 1], atol=1e-9)
        if kind in ('weld', 'prismatic'):
            np.testing.assert_allclose(R, np.eye(3), atol=1e-9)


def turntable(kind, axis):
    """Return a four-bar on a table turning about z, its pins across z."""
    b = ModelBuilder('turntable')
    b.body('table', axis=(0, 0, 1), inertial=rod(20.0, (-0.5, 0, 0), (0.5, 0, 0)))
    on = 'table'
    place = (0, 0, 0)
    for name, length in (('crank', 0.3), ('coupler', 0.9), ('rocker', 0.7)):
        b.body(name, on, axis=(0, -1, 0), at=place,
               inertial=rod(2.0 * length, (0, 0, 0), (length, 0, 0)))
        on = name
        place = (length, 0, 0)
    b.frame('end', 'rocker', at=place)
    b.frame('ground', 'table', at=(1, 0, 0))
    return Robot(b.model(),
                 constraints=[Closure('end', 'ground', kind, axis=axis, name='pin')],
                 independent=['table', 'crank'])


@pytest.mark.parametrize(('kind', 'axis'),
                         [('revolute', (0, 1, 0)), ('spherical', (0, 0, 1))])
def test_forces_of_a_planar_loop_do_not_depend_on_the_heading_of_its_base(kind, axis):
    robot = turntable(kind, axis)
    q = robot.closed_configuration((0.0, 0.8, 0.0, -1.5), fixed=['table', 'crank'])
    u = np.array([0.0, 5.0])
    forces = []
    for heading in np.deg2rad([0.0, 45.0, 89.99, 90.0, 90.000001, 135.0, -170.0]):
        q[0] = heading
        tau = robot.inverse_dynamics(q, u, np.zeros(2))
        forces.append([*tau, *robot.constraint_forces(q, u, tau)])
    np.testing.assert_allclose(forces, np.broadcast_to(forces[0], np.shape(forces)),
                               atol=1e-10)
    assert np.abs(forces[0]).max() < 100.0


@pytest.mark.parametrize(('make', 'words'), [
    (lambda: Closure('a', 'b', 'distance'), 'length: missing'),
    (lambda: Closure('a', 'b', 'distance', length=-1.0),
     'length: -1.0; expected a positive'),
    (lambda: Closure('a', 'b', 'weld', length=1.0), "length, given with kind 'weld'"),
    (lambda: Closure('a', 'b', 'weld', second_axis=(1, 0, 0)),
     'second_axis, given with kind'),
    (lambda: Closure('a', 'b', 'universal', second_axis=(0, 0, 0)), 'second_axis: ')])
def test_parameters_that_a_kind_has_not_are_refused(make, words):
    with pytest.raises(ConstraintError, match=words):
        make()


def rounded(kind, tolerance=1e-9, digits=4, tilt=0.0, configuration=None):
    """Return a four-bar whose pins are parallel up to rounding of pi."""
    b = ModelBuilder('rounded')
    on = 'world'
    place = (0, 0, 0)
    quarter = round(np.pi / 2, digits)
    half = round(np.pi, digits)
    for name, length, turn in (('crank', 0.3, quarter + tilt), ('coupler', 0.9, half),
                               ('rocker', 0.7, -half)):
        b.body(name, on, at=place, rpy=(turn, 0, 0),
               inertial=rod(2.0 * length, (0, 0, 0), (length, 0, 0)))
        on = name
        place = (length, 0, 0)
    b.frame('end', 'rocker', at=place)
    b.frame('ground', 'world', at=(1, 0, 0), rpy=(quarter, 0, 0))
    return Robot(b.model(), constraints=[Closure('end', 'ground', kind, name='pin')],
                 independent=['crank'], rank_tolerance=tolerance,
                 configuration=configuration)


def test_a_rounded_loop_that_does_not_close_names_both_remedies():
    near = 0.8, 1.9, 2.1
    with pytest.raises(ConstraintError, match=r'no configuration .*rank_tolerance='):
        rounded('revolute', tilt=1e-4, configuration=near)
    assert rounded('revolute', 1e-3, tilt=1e-4, configuration=near).n == 1


@cache
def motion_of_a_rounded_loop(kind, tolerance, digits):
    """Return the torque at the crank, and where it is after a third of a turn."""
    robot = rounded(kind, tolerance, digits)
    q = robot.closed_configuration((0.8, 1.0, 1.5), fixed=['crank'])
    run = simulate(robot, q, [5.0], 0.5)
    return [*robot.inverse_dynamics(q, [5.0], [0.0]), *run.q[-1]]


@pytest.mark.parametrize('kind', ['revolute', 'spherical'])
@pytest.mark.parametrize(('digits', 'tolerance', 'off'), [
    (4, 5e-5, 1e-7), (2, 5e-3, 5e-5)])
def test_a_rounded_loop_moves_with_a_tolerance_and_with_another_kind(
        kind, digits, tolerance, off):
    with pytest.raises(ConstraintError, match=r"singular values.*'inline'"):
        rounded(kind, digits=digits)
    np.testing.assert_allclose(motion_of_a_rounded_loop(kind, tolerance, digits),
                               motion_of_a_rounded_loop('inline', 1e-9, digits),
                               rtol=off)
