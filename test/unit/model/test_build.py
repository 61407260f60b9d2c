"""`ModelBuilder` builds the same models as a URDF or a manual `Model`."""

from dataclasses import replace
import math

from definition import Definition
from kane_dynamics import (ball, box, disc, FlexibleLink, Frame, Inertial, Limits,
                           load_urdf, ModelBuilder, ModelError, ModelWarning, point_mass,
                           Robot, rod)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.mechanics.definition import kane, kinematics
from mechanisms import random_inertial, random_state
import numpy as np
import pytest

X, Y, Z = np.eye(3)
FLOATING = """<robot name="drone"><link name="world"/>
  <link name="hull"><inertial><origin xyz="0.1 0.2 -0.1"/><mass value="2"/>
    <inertia ixx="0.1" iyy="0.2" izz="0.25" ixy="0" ixz="0" iyz="0.01"/></inertial></link>
  <link name="arm"><inertial><mass value="1"/>
    <inertia ixx="0.05" iyy="0.05" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="free" type="floating"><parent link="world"/><child link="hull"/>
    <origin xyz="1 0 0.5" rpy="0.3 -0.2 0.7"/></joint>
  <joint name="slide" type="planar"><parent link="hull"/><child link="arm"/>
    <origin xyz="0 0.3 0" rpy="1.1 0 0.4"/><axis xyz="0 1 1"/></joint>
</robot>"""  # noqa: E501


def assert_same_dynamics(model, other):
    """Check that two models have the same dynamics."""
    assert model.coordinate_names == other.coordinate_names
    one = Definition(model)
    two = Definition(other)
    for q, u, udot in random_state(model, 0, 30).reshape(10, 3, -1):
        expected = two.inverse_dynamics(q, u, udot)
        np.testing.assert_allclose(one.inverse_dynamics(q, u, udot), expected,
                                   rtol=1e-12, atol=1e-12 * np.abs(expected).max())


def test_expanded_joints_match_those_of_a_urdf():
    b = ModelBuilder()
    hull = Inertial(2, (0.1, 0.2, -0.1), [[0.1, 0, 0], [0, 0.2, 0.01], [0, 0.01, 0.25]])
    b.body('hull', 'world', 'floating', joint='free', at=(1, 0, 0.5),
           rpy=(0.3, -0.2, 0.7), inertial=hull)
    b.body('arm', 'hull', 'planar', joint='slide', at=(0, 0.3, 0), rpy=(1.1, 0, 0.4),
           axis=(0, 1, 1), inertial=Inertial(1, inertia=0.05 * np.eye(3)))
    with pytest.warns(ModelWarning):
        assert_same_dynamics(b.model(), load_urdf(FLOATING))


def test_the_spring_mass_pendulum_is_the_shipped_urdf():
    b = ModelBuilder()
    b.body('block', 'world', 'prismatic', joint='slider', axis=X, inertial=point_mass(2),
           stiffness=50)
    b.body('pendulum', 'block', joint='pivot', axis=-Y,
           inertial=point_mass(1, (0, 0, -0.5)))
    path = resource_path('urdf', 'spring_mass_pendulum.urdf')
    supplement = str(path).replace('.urdf', '.supplement.yaml')
    with pytest.warns(ModelWarning, match='pendulum'):
        assert_same_dynamics(b.model(), load_urdf(path, supplement=supplement))


@pytest.mark.parametrize('turns', ['zxy', 'zxz'])
def test_rotations_are_about_successively_rotated_axes(turns):
    b = ModelBuilder()
    b.body('top', 'world', 'spherical', turns=turns, inertial=ball(1, 0.1))
    b.body('fork', 'top', 'universal', turns='zx', inertial=ball(1, 0.1))
    model = b.model()
    angles = np.array([0.3, -0.5, 0.9, 1.2, -0.8])

    def about(letter, angle):
        axis = np.eye(3)['xyz'.index(letter)]
        return np.eye(3) + np.sin(angle) * (K := np.cross(np.eye(3), -axis).T) + (
            1 - np.cos(angle)) * K @ K
    expected = np.linalg.multi_dot([about(s, x) for s, x in zip(turns + 'zx', angles)])
    R, _ = kinematics.frame_pose(model, model.frame('fork'), angles)
    np.testing.assert_allclose(R, expected, atol=1e-15)
    assert model.coordinate_names[:3] == tuple(
        f'top/r{s}' for s in (turns if turns != 'zxz' else ['z', 'x', 'z2']))


@pytest.mark.parametrize('inertial, moments, com', [
    (rod(3, (0, 0, 0), (0, 0, -2)), (1, 1, 0), (0, 0, -1)),
    (disc(2, 1, X), (1, 0.5, 0.5), (0, 0, 0)),
    (disc(2, 1, (0, 0, 5), at=Y, thickness=6), (6.5, 6.5, 1), Y),
    (ball(5, 1, at=X), (2, 2, 2), X),
    (box(12, (1, 2, 3)), (13, 10, 5), (0, 0, 0)),
    (point_mass(1, X) + point_mass(1, -X), (0, 2, 2), (0, 0, 0))])
def test_uniform_shapes_have_the_textbook_moments(inertial, moments, com):
    np.testing.assert_allclose(inertial.inertia, np.diag(moments), atol=1e-14)
    np.testing.assert_allclose(inertial.com, com, atol=1e-15)


@pytest.mark.parametrize(('shape', 'words'), [
    (lambda: box(1, (-1, 1, 1)), r'size of a box: \[-1.0, 1.0, 1.0\] m'),
    (lambda: disc(1, -1), 'radius of a disc: -1.0 m'),
    (lambda: disc(1, 1, thickness=-2), 'thickness of a disc: -2.0 m'),
    (lambda: ball(1, -3), 'radius of a ball: -3.0 m')])
def test_a_negative_length_is_refused(shape, words):
    with pytest.raises(ModelError, match=words):
        shape()


def test_inertia_on_a_frame_is_added_to_its_body():
    inertial = random_inertial(np.random.default_rng(3))
    b = ModelBuilder()
    direct = ModelBuilder()
    for builder in (b, direct):
        builder.body('link', rpy=(0.1, 0.2, 0.3), axis=Y)
    b.frame('tool', 'link', at=(0.3, 0, 0.1), rpy=(0, 0, np.pi / 2))
    b.load('tool', inertial)
    turned = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    direct.load('link', inertial.moved(turned, (0.3, 0, 0.1)))
    assert_same_dynamics(b.model(), direct.model())


def test_a_mounted_arm_moves_with_its_carrier_and_has_its_own_dynamics():
    with pytest.warns(ModelWarning):
        arm = load_urdf(resource_path('urdf', 'two_rods.urdf'))
    b = ModelBuilder()
    b.body('cart', 'world', 'prismatic', axis=X, inertial=point_mass(4))
    b.mount(arm, 'cart', at=(0, 0, 0.2), prefix='left_')
    b.mount(arm, 'left_rod_b', at=(0, 1, 0), prefix='right_')
    model = b.model()
    assert model.coordinate_names == ('cart', 'left_rod_a_joint', 'left_rod_b_joint',
                                      'right_rod_a_joint', 'right_rod_b_joint')
    plain = ModelBuilder()
    plain.body('cart', 'world', 'prismatic', axis=X, inertial=point_mass(4))
    for side, on, at in (('left', 'cart', 0.2 * Z), ('right', 'left_rod_b', Y)):
        plain.body(f'{side}_rod_a', on, joint=f'{side}_rod_a_joint', axis=Y, at=at,
                   inertial=rod(2, (0, 0, 0), 1.2 * Z))
        plain.body(f'{side}_rod_b', f'{side}_rod_a', joint=f'{side}_rod_b_joint', axis=Z,
                   at=1.2 * Z, inertial=rod(1, (0, 0, 0), -0.6 * Y))
    assert_same_dynamics(model, plain.model())
    q = random_state(model, 1)[0]
    for frame in ('left_rod_b', 'right_rod_b'):
        np.testing.assert_allclose(kane.partial_velocities(model, q, frame),
                                   kane.partial_velocities(plain.model(), q, frame),
                                   atol=1e-14)


def test_expanded_joint_properties_are_set_by_joint_name():
    b = ModelBuilder()
    b.body('table', 'world', 'planar', inertial=box(1, (1, 1, 0.1)))
    b.joint('table/y', stiffness=7, damping=2)
    joint = b.model().bodies[1].joint
    assert (joint.name, joint.stiffness, joint.damping) == ('table/y', 7.0, 2.0)


def built_model(*steps):
    """Return a builder with a first body and some further steps."""
    b = ModelBuilder('rig')
    b.body('a')
    for name, arguments, options in steps:
        getattr(b, name)(*arguments, **options)
    return b


@pytest.mark.parametrize('name, arguments, options, words', [
    ('body', ('b', 'nowhere'), {},
     "'b'.*no body or frame 'nowhere'; expected one of world, a"),
    ('body', ('a',), {}, "'a': exists already; expected a unique name"),
    ('body', ('b',), {'joint': 'a'}, "joint 'a': exists already"),
    ('body', ('b', 'a', 'glued'), {}, "kind 'glued'; expected one of revolute, .*fixed"),
    ('body', ('b', 'a', 'fixed'), {'damping': 1.0}, 'damping of a fixed joint'),
    ('body', ('b', 'a'), {'mimic': 'c'}, "mimic: 'c'; expected one of a"),
    ('body', ('b', 'a'), {'mimic': ['a']}, r"mimic: \['a'\]; expected one of a"),
    ('body', ('b', 'a', 'floating'), {'mimic': 'a'}, "a floating joint mimics 'a'"),
    ('body', ('b', 'a'), {'mimic': 'a', 'multiplier': 0.0}, 'multiplier: 0'),
    ('body', ('b', 'a'), {'multiplier': 2.0}, 'without mimic'),
    ('body', ('b',), {'axis': (0, 0, 0)}, "joint 'b': axis"),
    ('body', ('b', 'a', 'spherical'), {'turns': 'xxy'}, "turns 'xxy'; expected"),
    ('body', ('b', 'a', 'spherical'), {'turns': 3}, "turns '3'; expected"),
    ('body', ('',), {}, "name of a body or frame: ''; expected a text"),
    ('body', (None,), {}, 'name of a body or frame: None; expected a text'),
    ('body', ('b', ['a']), {}, r"no body or frame '\['a'\]'; expected"),
    ('body', ('b',), {'inertial': 1.0},
     "'b': inertial properties: a float; expected an Inertial"),
    ('body', ('b',), {'stifness': 3}, "no property 'stifness'; expected .*stiffness"),
    ('body', ('b', 'a', 'planar'), {'damping': 3},
     'damping of 3 degrees of freedom; expected joint\\(\\) for one of b/x, b/y'),
    ('body', ('b',), {'at': (0, 0)}, "joint 'b': at"),
    ('body', ('b',), {'inertial': Inertial(1, inertia=np.diag([1, 1, 3]))},
     "'b': principal"),
    ('joint', ('c',), {'damping': 3}, "no joint 'c'; expected one of a"),
    ('frame', ('f', 'c'), {}, "frame 'f': no body or frame 'c'"),
    ('load', ('a', None), {}, "'a': inertial properties: a NoneType"),
    ('load', ('c', point_mass(1)), {}, "no body or frame 'c'"),
    ('mount', (built_model().model(), 'a'), {}, "'a': exists already")])
def test_builder_error_names_the_fault(name, arguments, options, words):
    with pytest.raises(ModelError, match=words):
        built_model((name, arguments, options))


def test_a_refused_body_leaves_the_builder_as_it_was():
    b = built_model()
    with pytest.raises(ModelError):
        b.body('b', 'a', inertial=Inertial(1, inertia=np.diag([1, 1, 3])))
    with pytest.raises(ModelError):
        b.mount(built_model().model(), 'a')
    assert [body.name for body in b.model().bodies] == ['a']


def test_builder_without_body_is_rejected():
    with pytest.raises(ModelError, match="'empty': no body; expected"):
        ModelBuilder('empty').model()


def test_a_mimic_joint_follows_its_master_and_that_ones_master():
    b = ModelBuilder('gripper')
    b.body('left', kind='prismatic', axis=(1, 0, 0), inertial=box(1.0, (0.1, 0.1, 0.1)))
    b.body('right', kind='prismatic', axis=(1, 0, 0), inertial=box(1.0, (0.1, 0.1, 0.1)),
           mimic='left', multiplier=-2.0, offset=0.1)
    b.body('third', 'right', kind='prismatic', axis=(1, 0, 0), mimic='right',
           multiplier=0.5, offset=0.2, inertial=box(1.0, (0.1, 0.1, 0.1)))
    robot = Robot(b.model())
    assert robot.joint_names == ('left',)
    x = 0.3
    assert robot.frame_pose('right', [x])[0, 3] == pytest.approx(-2.0 * x + 0.1)
    assert robot.frame_pose('third', [x])[0, 3] == pytest.approx(
        -2.0 * x + 0.1 + 0.5 * (-2.0 * x + 0.1) + 0.2)
    assert robot.mass_matrix([x])[0, 0] == pytest.approx(1.0 + 2.0**2 + 3.0**2)
    assert robot.verify() < 1e-13


def test_a_fixed_body_is_part_of_its_carrier():
    both = []
    for kind in ('fixed', 'load'):
        b = ModelBuilder('pair')
        b.body('arm', axis=(0, 1, 0), inertial=rod(1.0, (0, 0, 0), (1, 0, 0)))
        if kind == 'fixed':
            b.body('tool', 'arm', 'fixed', at=(1, 0, 0), rpy=(0, 0.3, 0),
                   inertial=disc(0.5, 0.2))
        else:
            b.frame('tool', 'arm', at=(1, 0, 0), rpy=(0, 0.3, 0))
            b.load('tool', disc(0.5, 0.2))
        both.append(Robot(b.model()))
    np.testing.assert_allclose(*(robot.mass_matrix([0.2]) for robot in both), rtol=1e-14)
    np.testing.assert_array_equal(*(robot.frame_pose('tool', [0.2]) for robot in both))


@pytest.mark.parametrize('on', ['world', 'arm'])
def test_a_fixed_beam_is_a_cantilever(on):
    b = ModelBuilder('cantilever', gravity=(0, 0, 0))
    b.body('arm', kind='prismatic', axis=(0, 0, 1), inertial=disc(1e9, 1.0))
    b.beam('beam', on, FlexibleLink(1.0, 2.0, 50.0, modes=(3, 0)), 'fixed',
           at=(0.1, 0.2, 0.3))
    robot = Robot(b.model())
    assert robot.joint_names == ('arm', 'beam/mode_1', 'beam/mode_2', 'beam/mode_3')
    none = np.zeros(4)
    M = robot.mass_matrix(none)[1:, 1:]
    K = np.array([robot.bias_force(1e-6 * unit, none)
                  for unit in np.eye(4)[1:]])[:, 1:] / 1e-6
    frequencies = np.sort(np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).real))
    waves = np.array([1.87510407, 4.69409113, 7.85475744])  # cos b cosh b = -1
    np.testing.assert_allclose(frequencies, waves**2 * np.sqrt(50.0 / 2.0), rtol=1e-6)
    assert robot.verify() < 1e-12


def test_impossible_inertias_are_accepted_on_request_with_a_warning_that_names_them():
    inertial = Inertial(1.0, np.zeros(3), np.diag([1.0, 1.0, 5.0]))
    b = ModelBuilder('loose', strict=False)
    b.body('a', inertial=inertial)
    with pytest.warns(ModelWarning, match='strict=False: a$'):
        assert b.model().bodies[0].inertial.inertia[2, 2] == 5.0
    with pytest.raises(ModelError, match="'a': principal moments"):
        ModelBuilder('tight').body('a', inertial=inertial)


def model_with(frame):
    """Return a model of one body with another frame."""
    b = ModelBuilder('arm')
    b.body('link', inertial=rod(1.0, (0, 0, 0), (1, 0, 0)))
    return replace(b.model(), frames=(*b.model().frames, frame))


@pytest.mark.parametrize(('frame', 'words'), [
    (Frame('f', 0, 2.0 * np.eye(3)), r"frame 'f': rotation \[\[2.0, .*rotation matrix"),
    (Frame('f', 0, -np.eye(3)), "frame 'f': rotation .*expected a rotation matrix"),
    (Frame('f', 0, np.eye(2)), r"frame 'f': rotation: (.|\n)*shape \(3, 3\)"),
    (Frame('f', 0, np.eye(3), np.full(3, np.nan)), "frame 'f': translation.*finite"),
    (Frame('f', 1), "frame 'f': body 1; expected the index of one of 1 bodies"),
    (Frame('f', 0.5), "frame 'f': body 0.5; expected the index of one of 1 bodies")])
def test_frames_that_no_body_can_have_are_refused(frame, words):
    with pytest.raises(ModelError, match=words):
        model_with(frame)


def test_arrays_of_frames_are_those_of_the_model_alone():
    translation = np.array([1.0, 2.0, 3.0])
    model = model_with(Frame('f', 0, np.eye(3), translation))
    translation[:] = 0.0
    assert model.frame('f').translation.tolist() == [1.0, 2.0, 3.0]
    for frame in model.frames:
        assert not frame.rotation.flags.writeable
        assert not frame.translation.flags.writeable


@pytest.mark.parametrize(('stated', 'words'), [
    ({'effort': -1.0}, 'limits: effort: -1.0; expected a number >= 0'),
    ({'velocity': math.nan}, 'limits: velocity: nan; expected a number >= 0'),
    ({'lower': 'low'}, "limits: lower: 'low'; expected a number"),
    ({'lower': 1.0, 'upper': -1.0}, 'limits: lower 1, upper -1; expected lower <= up')])
def test_limits_that_no_joint_can_have_are_refused(stated, words):
    with pytest.raises(ModelError, match=words):
        Limits(**stated)


def test_a_rod_between_equal_points_is_no_rod():
    with pytest.raises(ModelError, match=r'rod: both ends at .*; expected two points'):
        rod(1.0, (0.1, 0, 0), (0.1, 0, 0))
