"""Model of a URDF: expanded joints, merged bodies, mimic joints, frames, order."""

import math

from kane_dynamics.model.model import WORLD
import numpy as np
from numpy.testing import assert_allclose, assert_array_equal
import pytest
from urdf_writer import chain, joint, link, load, load_with_warnings, robot

HALF = repr(math.pi / 2)


def rotation(axis, angle):
    """Return the rotation about the x, y or z axis."""
    i = 'xyz'.index(axis)
    j = (i + 1) % 3
    k = (i + 2) % 3
    R = np.eye(3)
    R[j, j] = R[k, k] = np.cos(angle)
    R[k, j], R[j, k] = np.sin(angle), -np.sin(angle)
    return R


def test_joint_has_the_values_of_the_urdf():
    model = load(robot(link('a', None), link('b', 2.5, (1, 2, 2.5), '0.1 0.2 0.3'),
                       joint('j', 'a', 'b', axis='0 1 0', xyz='1 2 3', rpy='0.1 0.2 0.3',
                             more='<dynamics damping="0.7" friction="0.3"/>')))
    body, = model.bodies
    assert (model.name, model.base_name, body.name, body.parent) == ('r', 'a', 'b',
                                                                     WORLD)
    assert (body.joint.name, body.joint.kind) == ('j', 'revolute')
    assert_array_equal(body.joint.axis, [0, 1, 0])
    assert_array_equal(body.joint.translation, [1, 2, 3])
    assert_allclose(body.joint.rotation,
                    rotation('z', 0.3) @ rotation('y', 0.2) @ rotation('x', 0.1),
                    atol=1e-15)
    limits = body.joint.limits
    assert (limits.lower, limits.upper, limits.velocity, limits.effort) == (-1, 1, 2, 3)
    assert (body.joint.damping, body.joint.friction) == (0.7, 0.3)
    assert body.inertial.mass == 2.5
    assert_array_equal(body.inertial.com, [0.1, 0.2, 0.3])
    assert_array_equal(body.inertial.inertia, np.diag([1, 2, 2.5]))


def test_inertial_origin_turns_the_inertia():
    model = load(robot(link('a'), link('b', 1, (1, 2, 2.5), rpy='0 0 0.4'),
                       joint('j', 'a', 'b')))
    R = rotation('z', 0.4)
    assert_allclose(model.bodies[0].inertial.inertia, R @ np.diag([1, 2, 2.5]) @ R.T,
                    atol=1e-15)


def test_continuous_is_revolute_without_bounds_and_prismatic_is_prismatic():
    model = load(robot(link('a'), link('b'), link('c'),
                       joint('j', 'a', 'b', 'continuous',
                             limit='<limit effort="5" velocity="6"/>'),
                       joint('k', 'b', 'c', 'prismatic')))
    assert [b.joint.kind for b in model.bodies] == ['revolute', 'prismatic']
    limits = model.bodies[0].joint.limits
    assert (limits.lower, limits.upper, limits.velocity, limits.effort) == (
        -math.inf, math.inf, 6, 5)


def test_gravity_is_the_argument():
    assert_array_equal(load(chain(1)).gravity, [0, 0, -9.81])
    assert_array_equal(load(chain(1), gravity=[0, 9.8, 0]).gravity, [0, 9.8, 0])


@pytest.mark.parametrize(
    'rpy', [f'{HALF} 0 0', f'0 -{HALF} 0', f'{math.pi} {HALF} -{math.pi}',
            f'{HALF} {HALF} {HALF}', '0 0 4.71238898038469', '3.14159265358979 0 0'])
def test_quarter_turns_are_exact(rpy):
    model = load(robot(link('a'), link('b'), joint('j', 'a', 'b', rpy=rpy)))
    R = model.bodies[0].joint.rotation
    assert set(R.ravel()) <= {0.0, 1.0, -1.0}
    assert not np.signbit(R[R == 0.0]).any()
    assert np.linalg.det(R) == 1.0


@pytest.mark.parametrize('angle', [1.5708, 3.14159265359, 1.57079632679, 1e-10])
def test_rounded_angles_are_not_snapped(angle):
    model = load(robot(link('a'), link('b'), joint('j', 'a', 'b', rpy=f'{angle!r} 0 0')))
    assert_allclose(model.bodies[0].joint.rotation, rotation('x', angle),
                    atol=1e-15, rtol=0)
    assert model.bodies[0].joint.rotation[1, 2] != round(
        model.bodies[0].joint.rotation[1, 2]) or (
            model.bodies[0].joint.rotation[1, 1]
            != round(model.bodies[0].joint.rotation[1, 1]))


def test_fixed_joint_merges_its_link_into_the_moving_body():
    model = load(robot(link('a'), link('b', 2), link('c', 3, xyz='0 0 0.5'),
                       joint('j', 'a', 'b'),
                       joint('f', 'b', 'c', 'fixed', xyz='1 0 0', rpy=f'{HALF} 0 0')))
    body, = model.bodies
    assert body.inertial.mass == 5.0
    assert_allclose(body.inertial.com, np.array([3 * 1, 3 * -0.5, 0]) / 5, atol=1e-15)
    frame = model.frame('c')
    assert frame.body == 0
    assert_array_equal(frame.translation, [1, 0, 0])
    assert_array_equal(frame.rotation, [[1, 0, 0], [0, 0, -1], [0, 1, 0]])


def test_links_fixed_to_the_root_merge_into_the_base():
    model = load(robot(link('w', None), link('a', 2), link('b'),
                       joint('f', 'w', 'a', 'fixed', xyz='0 0 1'),
                       joint('j', 'a', 'b', xyz='0 0 1')))
    assert model.base_name == 'w'
    assert model.base_inertial.mass == 2.0
    assert_array_equal(model.base_inertial.com, [0, 0, 1])
    assert (model.frame('w').body, model.frame('a').body) == (WORLD, WORLD)
    assert_array_equal(model.bodies[0].joint.translation, [0, 0, 2])


def test_rotations_that_cancel_over_fixed_joints_leave_exact_zeros():
    model = load(robot(link('a'), link('b'), link('c'), link('d'),
                       joint('f', 'a', 'b', 'fixed', xyz='0.1 0.3 0', rpy='0 0 0.7'),
                       joint('g', 'b', 'c', 'fixed', rpy='0 0 -0.7'),
                       joint('j', 'c', 'd', xyz='0.2 -0.3 0')))
    assert_array_equal(model.bodies[0].joint.rotation, np.eye(3))
    assert model.bodies[0].joint.translation[1] == 0.0


def test_every_link_is_a_frame():
    model = load(robot(link('a'), link('b'), link('c'), link('d'), joint('j', 'a', 'b'),
                       joint('f', 'b', 'c', 'fixed'), joint('k', 'c', 'd')))
    assert {frame.name: frame.body for frame in model.frames} == {
        'a': WORLD, 'b': 0, 'c': 0, 'd': 1}


def test_order_is_topological_with_ties_as_in_the_urdf():
    model = load(robot(link('a'), link('b'), link('c'), link('d'), link('e'),
                       joint('tip', 'c', 'd'), joint('mid', 'b', 'c', 'fixed'),
                       joint('side', 'a', 'e'), joint('first', 'a', 'b')))
    assert model.joint_names == ('side', 'first', 'tip')
    assert [body.parent for body in model.bodies] == [WORLD, WORLD, 1]


def test_late_fixed_joint_does_not_delay_what_is_behind_it():
    model = load(robot(link('a'), link('b'), link('c'), link('d'), joint('k', 'b', 'c'),
                       joint('side', 'a', 'd'), joint('f', 'a', 'b', 'fixed')))
    assert model.joint_names == ('k', 'side')


def test_mimic_shares_its_masters_coordinate():
    model = load(robot(link('a'), link('b'), link('c'), joint('m', 'a', 'b'), joint(
        'f', 'a', 'c', more='<mimic joint="m" multiplier="-2" offset="0.5"/>')))
    assert model.joint_names == ('m',)
    follower = model.bodies[1].joint
    assert (follower.name, follower.coordinate) == ('f', 0)
    assert (follower.multiplier, follower.offset) == (-2.0, 0.5)


def test_mimic_defaults_are_one_and_zero():
    model = load(robot(link('a'), link('b'), link('c'), joint('m', 'a', 'b'), joint(
        'f', 'a', 'c', more='<mimic joint="m"/>')))
    assert (model.bodies[1].joint.multiplier, model.bodies[1].joint.offset) == (1.0, 0.0)


def test_mimic_chain_resolves_to_the_root_master_whatever_the_order():
    model = load(robot(link('a'), link('b'), link('c'), link('d'),
                       joint('h', 'a', 'b', limit='',
                             more='<mimic joint="g" multiplier="2" offset="1"/>'),
                       joint('g', 'b', 'c', limit='',
                             more='<mimic joint="m" multiplier="3" offset="5"/>'),
                       joint('m', 'c', 'd')))
    by_name = {body.joint.name: body.joint for body in model.bodies}
    assert model.joint_names == ('m',)
    assert (by_name['g'].multiplier, by_name['g'].offset) == (3.0, 5.0)
    assert (by_name['h'].multiplier, by_name['h'].offset) == (6.0, 11.0)


@pytest.mark.parametrize('multiplier, offset, stated, expected', [
    ('-2', '0.5', 'lower="0" upper="1" velocity="1"', (-0.25, 0.25, 0.5, 3.0)),
    ('-4', '0', 'lower="-3.2" upper="8" velocity="20"', (-1.0, 0.8, 2.0, 3.0)),
    ('0.1', '0', 'lower="-0.1" upper="0.1" velocity="0.2"', (-1.0, 1.0, 2.0, 3.0)),
    ('1', '0', 'lower="-1" upper="1" velocity="2"', (-1.0, 1.0, 2.0, 3.0))])
def test_limits_of_a_mimic_joint_bound_its_master(multiplier, offset, stated, expected):
    follower = joint(
        'f', 'a', 'c', limit=f'<limit {stated} effort="3"/>',
        more=f'<mimic joint="m" multiplier="{multiplier}" offset="{offset}"/>')
    for order in ((follower, joint('m', 'a', 'b')), (joint('m', 'a', 'b'), follower)):
        limits = load(robot(link('a'), link('b'), link('c'),
                            *order)).coordinate_joints[0].limits
        assert (limits.lower, limits.upper, limits.velocity, limits.effort) == expected


def test_mimic_with_multiplier_zero_stands_at_its_offset():
    model = load(robot(link('a'), link('b'), link('c'), joint('m', 'a', 'b'), joint(
        'f', 'b', 'c', more='<mimic joint="m" multiplier="0" offset="0.5"/>')))
    assert len(model.bodies) == 1
    assert_allclose(model.frame('c').rotation, rotation('z', 0.5), atol=1e-15)


def test_floating_joint_expands_to_six_with_documented_names():
    model = load(robot(link('a'), link('b', 2),
                       joint('j', 'a', 'b', 'floating', axis=None,
                             limit='', xyz='1 0 0', rpy='0 0 0.3')))
    assert model.joint_names == ('j/x', 'j/y', 'j/z', 'j/rx', 'j/ry', 'j/rz')
    assert [b.joint.kind for b in model.bodies] == ['prismatic'] * 3 + ['revolute'] * 3
    assert_array_equal([b.joint.axis for b in model.bodies], np.tile(np.eye(3), (2, 1)))
    assert [b.parent for b in model.bodies] == [WORLD, 0, 1, 2, 3, 4]
    assert_array_equal(model.bodies[0].joint.translation, [1, 0, 0])
    assert_allclose(model.bodies[0].joint.rotation, rotation('z', 0.3), atol=1e-15)
    for body in model.bodies[1:]:
        assert_array_equal(body.joint.rotation, np.eye(3))
        assert not body.joint.translation.any()
    assert [b.inertial.mass for b in model.bodies] == [0, 0, 0, 0, 0, 2]
    assert [f.name for f in model.frames] == ['a', 'b']
    assert model.bodies[-1].name == 'b'


@pytest.mark.parametrize(('axis', 'x', 'y'), [
    ('0 0 1', [1, 0, 0], [0, 1, 0]),
    ('0 1 0', [1, 0, 0], [0, 0, -1]),
    ('1 0 0', [0, 1, 0], [0, 0, 1]),
    ('0 0 -1', [1, 0, 0], [0, -1, 0]),
    ('0 0.6 0.8', [1, 0, 0], [0, 0.8, -0.6]),
])
def test_planar_joint_slides_normal_to_its_axis_and_turns_about_it(axis, x, y):
    model = load(
        robot(link('a'), link('b'), joint('j', 'a', 'b', 'planar', axis=axis, limit='')))
    assert model.joint_names == ('j/x', 'j/y', 'j/rz')
    assert [b.joint.kind for b in model.bodies] == ['prismatic', 'prismatic', 'revolute']
    assert_allclose([b.joint.axis for b in model.bodies[:2]], [x, y], atol=1e-15)
    assert_allclose(model.bodies[2].joint.axis, [float(s) for s in axis.split()],
                    atol=1e-15)


def test_robot_that_does_not_move_loads():
    model = load(robot(link('a', 3)))
    assert (model.n, model.bodies, model.base_inertial.mass) == (0, (), 3.0)


def test_point_masses_are_legal():
    model, texts = load_with_warnings(robot(link('a'), link('b', 1, (0, 0, 0)),
                                            joint('j', 'a', 'b')))
    assert model.bodies[0].inertial.mass == 1.0
    assert len(texts) == 1
