"""Selection of joints and links: base, tip, joints, locked and drop."""

from kane_dynamics.errors import InputError, KaneError, ModelError
from kane_dynamics.model.model import WORLD
from kane_dynamics.urdf import load_urdf
import numpy as np
from numpy.testing import assert_allclose, assert_array_equal
import pytest
from urdf_writer import chain, joint, link, load, load_with_warnings, robot

MIMIC = '<mimic joint="finger1" multiplier="-1" offset="0.5"/>'
# world -fixed- base -j1- upper -j2- fore -fixed- hand, with two fingers on the hand, and
# a camera on a joint of its own on the base.
ARM = robot(
    link('world', None), link('base', 10), link('upper', 2, xyz='0 0 0.5'),
    link('fore', 1),
    link('hand', 0.5), link('left', 0.1), link('right', 0.1), link('camera', 0.3),
    joint('mount', 'world', 'base', 'fixed', xyz='0 0 1'),
    joint('pan', 'base', 'camera', axis='0 0 1'),
    joint('j1', 'base', 'upper', axis='0 1 0'),
    joint('j2', 'upper', 'fore', axis='0 1 0', xyz='0 0 1'),
    joint('wrist', 'fore', 'hand', 'fixed', xyz='0 0 1'),
    joint('finger1', 'hand', 'left', 'prismatic', axis='0 1 0'),
    joint('finger2', 'hand', 'right', 'prismatic', axis='0 1 0', more=MIMIC))


def masses(model):
    """Return the mass of every body, and of the base, by name."""
    mass_by_link = {body.name: body.inertial.mass for body in model.bodies}
    return {**mass_by_link, 'base of the model': model.base_inertial.mass}


def test_by_default_all_joints_move():
    model = load(ARM)
    assert model.joint_names == ('pan', 'j1', 'j2', 'finger1')
    assert model.base_name == 'world'


def test_joints_move_in_the_given_order_and_others_are_locked():
    model = load(ARM, joints=['j2', 'j1'])
    assert model.joint_names == ('j2', 'j1')
    assert [(b.joint.name, b.joint.coordinate) for b in model.bodies] == [
        ('j1', 1), ('j2', 0)]
    assert_allclose(model.bodies[1].inertial.mass, 1.7)
    assert model.base_inertial.mass == 10.3


def test_locked_joint_and_its_mimic_are_at_their_positions():
    model = load(ARM, locked={'finger1': 0.2, 'j1': 0.3})
    assert model.joint_names == ('pan', 'j2')
    assert_array_equal(model.frame('left').translation, [0, 0.2, 1])
    assert_allclose(model.frame('right').translation, [0, 0.3, 1])
    assert_allclose(model.frame('upper').rotation[0], [np.cos(0.3), 0, np.sin(0.3)],
                    atol=1e-15)
    assert model.frame('upper').body == WORLD


def test_locked_without_joints_or_value_is_at_zero():
    model = load(ARM, joints=['j1'])
    assert_array_equal(model.frame('left').translation, [0, 0, 2])
    assert_array_equal(model.frame('right').translation, [0, 0.5, 2])


def test_tip_keeps_what_is_beyond_it_with_its_mass():
    model = load(ARM, tip='hand')
    assert model.joint_names == ('j1', 'j2')
    assert_allclose(masses(model)['fore'], 1.7)
    assert masses(model)['base of the model'] == 10.3
    assert {frame.name for frame in model.frames} == {
        'world', 'base', 'upper', 'fore', 'hand', 'left', 'right', 'camera'}


def test_base_cuts_what_is_not_behind_it():
    model = load(ARM, base='upper')
    assert model.base_name == 'upper'
    assert model.joint_names == ('j2', 'finger1')
    assert masses(model) == {'fore': 1.5, 'left': 0.1, 'right': 0.1,
                             'base of the model': 2}
    assert {frame.name for frame in model.frames} == {'upper', 'fore', 'hand', 'left',
                                                      'right'}


def test_base_and_tip_and_joints_together():
    model = load(ARM, base='upper', tip='left', joints=['finger1'], locked={'j2': 0.1})
    assert model.joint_names == ('finger1',)
    assert model.bodies[0].parent == WORLD


def test_tip_that_is_the_base_moves_nothing():
    assert load(ARM, base='upper', tip='upper').n == 0


def test_mimic_off_the_path_follows_a_master_on_it():
    model = load(ARM, tip='left')
    assert [b.joint.name for b in model.bodies] == ['j1', 'j2', 'finger1', 'finger2']
    assert model.joint_names == ('j1', 'j2', 'finger1')


def test_mimic_of_a_removed_master_uses_its_locked_position():
    source = robot(link('a'), link('b'), link('c'), joint('m', 'a', 'b'), joint(
        'f', 'b', 'c', 'prismatic', more='<mimic joint="m" multiplier="2" offset="1"/>'))
    assert_array_equal(load(source, base='b').frame('c').translation, [0, 0, 1])
    model, messages = load_with_warnings(source, base='b', locked={'m': 3})
    assert 'locked positions outside the limits' in messages[0]
    assert_array_equal(model.frame('c').translation, [0, 0, 7])


def test_drop_removes_the_inertial_of_the_named_links_alone():
    model = load(ARM, joints=['j1', 'j2'], drop=['hand', 'camera'])
    assert_allclose(masses(model)['fore'], 1.2)
    assert masses(model)['base of the model'] == 10
    assert model.frame('hand').body == 1


def test_dropped_link_may_have_an_impossible_inertia():
    source = robot(link('a'), link('b'), link('c', 1, (-1, 1, 1)), joint('j', 'a', 'b'),
                   joint('f', 'b', 'c', 'fixed'))
    with pytest.raises(ModelError, match="'c'"):
        load(source)
    assert load(source, drop=['c']).bodies[0].inertial.mass == 1.0


def test_dropping_all_of_a_moving_body_warns():
    _, texts = load_with_warnings(chain(1), drop=['l1'])
    assert len(texts) == 1
    assert 'without mass' in texts[0]


FREE = robot(link('a'), link('b'), joint('j', 'a', 'b', 'floating', limit=''))


def test_expanded_joints_of_a_floating_joint_lock_individually():
    model = load(FREE, joints=['j/rz', 'j/x'], locked={'j/z': 0.5})
    assert model.joint_names == ('j/rz', 'j/x')
    assert [b.joint.name for b in model.bodies] == ['j/x', 'j/rz']
    assert_array_equal(model.bodies[1].joint.translation, [0, 0, 0.5])
    assert model.bodies[1].inertial.mass == 1.0


def test_locked_revolute_by_a_quarter_turn_is_exact():
    model, messages = load_with_warnings(chain(2), locked={'j1': np.pi / 2})
    assert 'locked positions outside the limits' in messages[0]
    assert_array_equal(model.frame('l1').rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]])


@pytest.mark.parametrize(('options', 'words'), [
    ({'base': 'x'}, ("base: 'x'", 'expected one of world, base')),
    ({'base': 3}, ('base: 3', 'expected one of world')),
    ({'tip': 'x'}, ("tip: 'x'", 'expected one of world, base')),
    ({'base': 'upper', 'tip': 'camera'}, ("'camera'", "not behind base 'upper'")),
    ({'joints': ['j1', 'x']}, ("'x'", 'expected some of pan, j1, j2, finger1')),
    ({'joints': ['mount']}, ("'mount' is fixed", 'expected some of pan')),
    ({'joints': ['finger2']}, ("'finger2' mimics 'finger1'", 'expected some of pan')),
    ({'joints': ['pan'], 'tip': 'hand'},
     ("'pan'", 'between base and tip', 'expected some of j1, j2')),
    ({'joints': ['j1', 'j1']}, ('j1', 'more than once')),
    ({'joints': 'j1'}, ("joints: 'j1'", 'list of names')),
    ({'joints': {'j1', 'j2'}}, ('joints:', 'order')),
    ({'joints': 5}, ('joints: 5', 'list')),
    ({'joints': [5]}, ('5', 'expected some of pan')),
    ({'joints': [['j1']]}, ("['j1']", 'expected some of pan')),
    ({'locked': {'x': 0.0}}, ("'x'", 'expected some of pan, j1')),
    ({'locked': {'mount': 0.0}}, ("'mount' is fixed", 'expected some of pan')),
    ({'locked': {'finger2': 0.0}},
     ("'finger2' mimics 'finger1'", 'expected some of pan')),
    ({'locked': {'j1': float('nan')}}, ("'j1': nan", 'finite')),
    ({'locked': {'j1': '1'}}, ("'j1': '1'", 'finite')),
    ({'locked': {'j1': None}}, ("'j1': None", 'finite')),
    ({'locked': {'j1': [1]}}, ("'j1': [1]", 'finite')),
    ({'locked': ['j1']}, ('locked:', 'mapping')),
    ({'joints': ['j1'], 'locked': {'j1': 0}}, ("'j1'", 'also in joints')),
    ({'drop': ['x']}, ("drop: 'x'", 'expected one of world')),
    ({'drop': 'hand'}, ("drop: 'hand'", 'list of names')),
    ({'drop': [None]}, ('drop: None', 'expected one of world')),
])
def test_unsuitable_argument_is_an_input_error(options, words):
    with pytest.raises(InputError) as caught:
        load_urdf(ARM, **options)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize('gravity',
                         [[0, 0], 'down', [0, 0, float('nan')], [[0], [0, 1]], None])
def test_bad_gravity_is_refused(gravity):
    with pytest.raises(KaneError, match='gravity'):
        load_urdf(ARM, gravity=gravity)
