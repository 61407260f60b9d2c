"""Rolling on moving planes, cylinders, spheres: contacts by brute force."""

from constrained_trees import ROLLING, rolling, two_bodies_on_a_base
from kane_dynamics import (ConstraintError, disc, Inertial, ModelBuilder, Robot, Rolling,
                           simulate)
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
import numpy as np
import pytest


def nearest(constraint, mechanism, q):
    """Return the least distance of the wheel or ball from the surface, by search."""
    placed = mechanism.state(q)
    R, p = placed.pose('end')
    Rs, origin = placed.pose('socket')
    center = Rs.T @ (p - origin)

    def far(x):
        if constraint.surface == 'plane':
            return x @ constraint.normal - constraint.height
        off = x if constraint.surface == 'sphere' else (
            x - np.outer(x @ constraint.surface_axis, constraint.surface_axis))
        size = np.linalg.norm(off, axis=-1) - constraint.surface_radius
        return -size if constraint.inside else size
    if constraint.axis is None:
        return far(center[None])[0] - constraint.radius
    axle = Rs.T @ R @ constraint.axis
    one = np.cross(axle, [0.3, 0.5, 0.8])
    one /= np.linalg.norm(one)
    low = 0.0
    high = 2.0 * np.pi
    for _ in range(10):
        angle = np.linspace(low, high, 2001)
        rim = center + constraint.radius * (
            np.outer(np.cos(angle), one) + np.outer(np.sin(angle), np.cross(axle, one)))
        k = int(np.argmin(distance := far(rim)))
        width = (high - low) / 1000.0
        low = angle[k] - width
        high = angle[k] + width
    return distance[k]


def states(kind, mechanism, count):
    """Return configurations with the bodies near, some open, some overlapping."""
    rng = np.random.default_rng(3)
    for _ in range(count):
        q = rng.uniform(-0.5, 0.5, 15)
        (_, p1) = mechanism.state(q).pose('end')
        (_, p2) = mechanism.state(q).pose('socket')
        (R_base, _) = mechanism.state(q).pose('base')
        inside = 'inside' in kind
        if inside:
            apart = rng.uniform(-0.3, 0.3, 3)
        else:  # across the cylinder's axis
            line = mechanism.state(q).pose(
                'socket')[0] @ mechanism.constraints[0].surface_axis
            apart = np.cross(line, rng.normal(size=3))
            apart *= rng.uniform(0.9, 1.5) / np.linalg.norm(apart)
        q[9:12] += R_base.T @ (p1 - p2 - apart)
        yield q


@pytest.mark.parametrize('kind',
                         [kind for kind in ROLLING if kind != 'wheel inside cylinder'])
def test_residual_is_the_distance_and_the_normal_row_its_rate(kind):
    constraint = rolling(kind)
    mechanism = Mechanism(two_bodies_on_a_base(), None, (constraint,))
    h = 1e-6

    def normal(q):
        rows = mechanism.rows(mechanism.state(q))
        return float(rows.residual[2]), np.array(rows.J, dtype=float)
    for q in states(kind, mechanism, 15):
        gap, J = normal(q)
        assert gap == pytest.approx(nearest(constraint, mechanism, q), abs=1e-12)
        rate = [(normal(q + h * unit)[0] - normal(q - h * unit)[0]) / (2.0 * h)
                for unit in np.eye(15)]
        np.testing.assert_allclose(J[2], rate, atol=2e-8)


@pytest.mark.parametrize('inside', [False, True])
def test_a_wheel_on_a_parallel_cylinder_is_a_pair_of_gears(inside):
    R = 1.0
    r = 0.3
    b = ModelBuilder('planet', gravity=(0, 0, 0))
    b.body('sun', axis=(0, 0, 1), inertial=disc(3.0, R))
    b.body('arm', axis=(0, 0, 1), inertial=disc(1.0, 0.1))
    b.body('planet', 'arm', axis=(0, 0, 1), at=(R - r if inside else R + r, 0, 0),
           inertial=disc(0.5, r))
    robot = Robot(b.model(), independent=['sun', 'arm'], constraints=[
        Rolling('planet', r, (0, 0, 1), name='mesh', surface_frame='sun',
                surface='cylinder', surface_radius=R, inside=inside)])
    rates = robot.joint_rates([0.3, 0.5, 0.2], [2.0, 0.7])
    # Willis: without slip R (sun - arm) = -+ r (planet - arm), rates of absolute angles
    ratio = R / r if inside else -R / r
    assert rates[2] == pytest.approx(ratio * (2.0 - 0.7), rel=1e-13)
    run = simulate(robot, [0.3, 0.5, 0.2], [2.0, 0.7], 1.0)
    np.testing.assert_allclose(run.u[-1], [2.0, 0.7], atol=1e-9)  # nothing brakes it


def test_a_ball_in_a_bowl_swings_as_a_pendulum_that_carries_its_spin():
    R = 1.0
    r = 0.1
    ball = 0.4 * r * r  # moment of inertia of a solid ball of 1 kg
    b = ModelBuilder('bowl')
    b.body('ball', kind='floating', at=(0, 0, R),
           inertial=Inertial(1.0, np.zeros(3), ball * np.eye(3)))
    b.frame('bowl', 'world', at=(0, 0, R))
    roll = Rolling('ball', r, surface_frame='bowl', surface='sphere', surface_radius=R,
                   inside=True)
    robot = Robot(b.model(), constraints=[roll],
                  configuration=np.array([0.01, 0, -(R - r), 0, 0, 0]),
                  independent=['ball/x', 'ball/y', 'ball/rz'])
    q = robot.closed_configuration([0.01, 0.0, -(R - r), 0.0, 0.0, 0.0],
                                   fixed=['ball/x', 'ball/y'])
    slow = np.sqrt(9.80665 / ((R - r) * (1.0 + 0.4)))  # rad/s: a ball's inertia adds 2/5
    half = np.pi / slow
    run = simulate(robot, q, [0.0, 0.0, 0.0], half, step=half / 1000)
    assert run.q[-1][0] == pytest.approx(-0.01, rel=1e-3)
    assert np.ptp(run.energy.sum(axis=1)) < 1e-9


def test_a_ball_at_the_pole_opposite_to_the_normal_is_refused_by_its_rows():
    b = ModelBuilder('globe')
    b.body('ball', kind='floating',
           inertial=Inertial(1.0, np.zeros(3), 4e-3 * np.eye(3)))
    b.frame('globe', 'world')
    q = [0.0, 0.0, -1.1, 0.0, 0.0, 0.0]
    robots = []
    for normal in ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0)):
        robots.append(Robot(b.model(), configuration=q, constraints=[
            Rolling('ball', 0.1, surface_frame='globe', surface='sphere',
                    surface_radius=1.0, name='roll', normal=normal)]))
    with pytest.raises(ConstraintError, match=(
            r"'roll/tangent_1', .* not finite at .*expected.* opposite to `normal`")):
        robots[0].mass_matrix(q)
    assert (np.linalg.eigvalsh(robots[1].mass_matrix(q)) > 0.0).all()


def test_wheels_on_an_axle_hold_the_same_force_for_every_heading():
    b = ModelBuilder('cart')
    b.body('base', kind='planar', inertial=disc(5.0, 0.3))
    for name, side in (('left', 0.2), ('right', -0.2)):
        b.body(name, 'base', axis=(0, 1, 0), at=(0.05, side, 0), inertial=disc(0.2, 0.1))
    robot = Robot(b.model(), constraints=[Rolling(name, 0.1, (0, 1, 0), height=-0.1)
                                          for name in ('left', 'right')],
                  independent=['left', 'right'])
    forces = []
    for heading in np.deg2rad([0.0, 30.0, 89.9, 90.0, 180.0]):
        q = np.array([0.0, 0.0, heading, 0.1, 0.2])
        forces.append(robot.constraint_forces(q, [3.0, 8.0], [0.3, -0.1]))
    np.testing.assert_allclose(forces, np.broadcast_to(forces[0], np.shape(forces)),
                               atol=1e-9)
    assert 1e-3 < np.abs(forces[0]).max() < 100.0


@pytest.mark.parametrize(('options', 'words'), [
    ({'surface': 'cone'}, "surface: 'cone'; expected one of plane, cylinder, sphere"),
    ({'surface': 'sphere'}, 'surface_radius: None, of a sphere'),
    ({'surface_radius': 1.0}, 'surface_radius: 1.0, of a plane'),
    ({'inside': True}, 'inside: true, of a plane'),
    ({'surface': 'sphere', 'surface_radius': 0.1, 'inside': True},
     'radius: 0.1; expected less than surface_radius, 0.1'),
    ({'height': 'x'}, "height: 'x'; expected a finite number"),
    ({'surface': 'cylinder', 'surface_radius': 1.0, 'height': 3.0},
     'height: 3.0, of a cylinder; expected it for a plane only'),
    ({'surface': 'sphere', 'surface_radius': np.nan}, 'surface_radius: ')])
def test_surfaces_that_nothing_rolls_on_are_refused(options, words):
    with pytest.raises(ConstraintError, match=words):
        Rolling('hub', 0.1, **options)


def test_a_ball_in_the_center_of_its_bowl_is_refused_by_the_row_without_direction():
    builder = ModelBuilder('bowl')
    builder.body('ball', 'world', joint='free', at=(0, 0, 0),
                 inertial=Inertial(2.0, (0, 0, 0), np.eye(3) * 0.008))
    builder.frame('bowl', 'world', at=(0, 0, 0))
    rolling = Rolling('ball', radius=0.1, surface='sphere', surface_frame='bowl',
                      surface_radius=1.0, inside=True)
    with pytest.raises(ConstraintError, match=r'normal: undefined at .*expected'):
        Robot(builder.model(), constraints=[rolling])
