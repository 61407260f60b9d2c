"""Motions of slow reversals keep limits, load joints and show friction."""

import json

from command_in_process import command
from kane_dynamics import (box, InputError, load_urdf, ModelBuilder, ModelWarning, Robot,
                           rod)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.identification import friction_motion, identify, Recording
from kane_dynamics.identification.excitation.clearance import Clearance
from kane_dynamics.model.model import Limits
from kane_dynamics.urdf.link_shapes import load_collision_shapes
import numpy as np
import pytest

TWO_LINK = resource_path('urdf', 'two_link.urdf')
FRICTION = {'joint1': {'damping': 1.5, 'friction': 2.0, 'friction_speed': 0.02},
            'joint2': {'damping': 0.8, 'friction': 1.0, 'friction_speed': 0.02}}
EXTREME = [  # share of the speed limits, and of the effort
    ({}, 0.3, 0.9), ({'speeds': [0.005, 0.2], 'loads': 2, 'share': 0.6}, 0.3, 0.6)]


@pytest.mark.parametrize('name, links',
                         [('two_link', {}), ('fr3', {'tip': 'fr3_link7'})])
@pytest.mark.parametrize('options, speed, effort', EXTREME)
def test_the_motion_rests_at_reversals_and_keeps_all_limits(name, links, options, speed,
                                                            effort):
    model = load_urdf(resource_path('urdf', f'{name}.urdf'), **links)
    motion = friction_motion(model, distance=None, **options)
    robot = Robot(model)
    q, u, udot = motion.sample(np.arange(0.0, motion.duration, 0.01))
    assert (np.abs(u) <= speed * robot.limits.velocity * (1.0 + 1e-9)).all()
    assert (q >= robot.limits.lower).all() and (q <= robot.limits.upper).all()
    torque = np.abs(robot.inverse_dynamics(q, u, udot))
    assert (torque <= 1.02 * effort * robot.limits.effort).all()
    _, at_ends, accelerations = motion.sample(motion.times)
    np.testing.assert_allclose(at_ends, 0.0, atol=1e-9)
    np.testing.assert_allclose(accelerations, 0.0, atol=1e-6)


def test_every_joint_reverses_under_loads_that_differ():
    model = load_urdf(TWO_LINK)
    robot = Robot(model)
    motion = friction_motion(model, loads=3, strokes=4, speeds=[0.05], distance=None)
    # About each configuration there are ten ends of strokes.
    loads = robot.gravity_force(motion.sample(motion.times)[0])[::10]
    largest = np.abs(robot.gravity_force(robot.random_configuration(0, 2000))).max(
        axis=0)
    relative = loads / largest
    assert len(loads) == 3
    for i in range(3):
        for j in range(i):
            assert np.abs(relative[i] - relative[j]).max() > 0.5
    reversals = np.diff(np.sign(np.diff(motion.sample(motion.times)[0], axis=0)), axis=0)
    assert (np.sum(reversals != 0.0, axis=0) >= 3 * 8).all()


def test_friction_of_an_arm_whose_bodies_are_known_is_that_of_the_motion():
    motion = friction_motion(load_urdf(TWO_LINK), distance=None)
    true = Robot(load_urdf(TWO_LINK, supplement={'joints': FRICTION}))
    t = np.arange(0.0, motion.duration, 0.01)
    q, u, udot = motion.sample(t)
    noise = 0.05 * np.random.default_rng(1).normal(size=q.shape)
    tau = true.inverse_dynamics(q, u, udot) + noise
    identified = identify(load_urdf(TWO_LINK), Recording(t, q, u, udot, tau),
                          friction_only=True, standstill=0.0, diagnosed=True)
    np.testing.assert_allclose(identified.losses[:, 0], [1.5, 0.8], rtol=0.1)
    np.testing.assert_allclose(identified.losses[:, 1], [2.0, 1.0], rtol=0.02)
    np.testing.assert_allclose(identified.friction_speed, 0.02, rtol=0.15)


def test_links_stay_above_the_floor_and_apart():
    urdf = resource_path('urdf', 'ur10e.urdf')
    model = load_urdf(urdf)
    shapes = load_collision_shapes(urdf)
    motion = friction_motion(model, floor=0.0, shapes=shapes, loads=2)
    free = friction_motion(model, distance=None, loads=2)
    clearance = Clearance(model, shapes, 0.0, 0.05)
    q = motion.sample(np.arange(0.0, motion.duration, 0.1))[0]
    anywhere = free.sample(np.arange(0.0, free.duration, 0.1))[0]
    assert clearance.lowest(q)[1] > 0.0 > clearance.lowest(anywhere)[1]
    # Links that are near each other at rest keep half of their distance there.
    assert (clearance.distances(q) >= clearance.needed).all()
    assert not (clearance.distances(anywhere) >= clearance.needed).all()


def test_the_command_writes_the_motion(tmp_path):
    path = tmp_path / 'slow.csv'
    ran = command('excite', str(TWO_LINK), '--out', str(path), '--friction', '--loads',
                  '2', '--seed', '3', '--floor', 'none', '--distance', 'none', '--json')
    assert ran.returncode == 0, ran.stderr
    motion = friction_motion(load_urdf(TWO_LINK), loads=2, seed=3, distance=None)
    assert json.loads(ran.stdout)['duration'] == pytest.approx(motion.duration,
                                                               rel=1e-12)
    table = np.genfromtxt(path, delimiter=',', names=True, deletechars='')
    expected = motion.sample(table['t'])[0]
    written = np.stack([table['q.joint1'], table['q.joint2']], axis=1)
    np.testing.assert_allclose(written, expected, atol=1e-9)


@pytest.mark.parametrize('options, words', [
    ({'loads': 0}, 'loads'), ({'speeds': [0.0]}, 'speeds'), ({'speeds': []}, 'speeds'),
    ({'reach': -1.0}, 'reach'), ({'share': 2.0}, 'share'), ({'strokes': 0}, 'strokes'),
    ({'floor': 1e3}, 'most others exceed the floor'),
    ({'share': 1e-3}, "at most 0.*effort of 'joint1'")])
def test_impossible_options_are_refused(options, words):
    with pytest.raises(InputError, match=words):
        friction_motion(load_urdf(TWO_LINK), **{'distance': None, **options})


def arm(**limits):
    """Return an arm of two links whose first joint has these limits."""
    b = ModelBuilder('arm')
    stated = {'lower': -1.0, 'upper': 1.0, 'velocity': 2.0, 'effort': 50.0}
    for name, on, at in (('upper', 'world', (0, 0, 0)), ('fore', 'upper', (0.5, 0, 0))):
        b.body(name, on, axis=(0, 1, 0), at=at,
               inertial=rod(1.0, (0, 0, 0), (0.5, 0, 0)),
               limits=Limits(**stated | limits if name == 'upper' else stated))
    return b


@pytest.mark.parametrize('limits, words', [
    ({'lower': 0.5, 'upper': 0.5}, "joint 'upper': limits of position 0.5 and 0.5"),
    ({'velocity': 1e-300}, "joint 'upper': limit of speed 1e-300"),
    ({'velocity': np.inf}, "joint 'upper': limit of speed inf")])
def test_limits_without_a_useful_range_are_refused_by_the_name_of_the_joint(
        limits, words):
    with pytest.raises(InputError, match=words):
        friction_motion(arm(**limits).model(), distance=None)


@pytest.mark.parametrize('limits, least, most', [
    ({'lower': -np.inf, 'upper': np.inf}, -np.pi, np.pi),
    ({'lower': -1e308, 'upper': 1e308}, -np.pi, np.pi),
    ({'lower': -np.inf, 'upper': -9.0}, -9.0 - np.pi, -9.0)])
def test_a_joint_without_a_limit_moves_where_random_configurations_are(
        limits, least, most):
    motion = friction_motion(arm(**limits).model(), distance=None)
    positions = motion.sample(motion.times)[0][:, 0]
    assert least <= positions.min() <= positions.max() <= most
    assert np.ptp(positions) > 1.0


def test_ball_joints_are_refused():
    b = arm()
    b.body('hand', 'fore', 'ball', inertial=box(1.0, (0.1, 0.2, 0.3)))
    with pytest.raises(InputError, match='ball joints'):
        friction_motion(b.model(), distance=None)


def test_without_shapes_a_warning_says_that_links_are_not_kept_apart():
    with pytest.warns(ModelWarning, match='not kept apart') as record:
        friction_motion(load_urdf(TWO_LINK), loads=1)
    assert record[0].filename == __file__
