"""Supplement of a URDF: its effect on the model and its error messages."""

from kane_dynamics.errors import KaneError, ModelError, UrdfError
from kane_dynamics.urdf import load_urdf
from kane_dynamics.urdf.supplement import JOINT_KEYS
import numpy as np
from numpy.testing import assert_allclose
import pytest
from urdf_writer import chain, joint, link, load, robot

ARM = robot(link('a'), link('b'), link('c'), link('tool', None),
            joint('j', 'a', 'b', more='<dynamics damping="0.7" friction="0.3"/>'),
            joint('k', 'b', 'c'), joint('f', 'c', 'tool', 'fixed', xyz='0 0 1'))
FULL = """
joints:
  j: {armature: 0.1, stiffness: 5, rest: -0.2, damping: 0.5, friction: 1.2,
      friction_speed: 1e-3, friction_offset: -0.3, fast_damping: 0.4, damping_speed: 0.8,
      friction_backward: 1.1, load_friction: 0.05,
      breakaway_friction: 1.6, stribeck_speed: 0.2, load_friction_backdriven: 0.1,
      presliding_stiffness: 300, presliding_damping: 2.5}
  k:
    stiffness: 2.5
payload:
  link: tool
  mass: 2
  com: [0, 0, 0.5]
  inertia: {ixx: 0.1, iyy: 0.2, izz: 0.25, ixy: 0.01, ixz: -0.02, iyz: 0.03}
"""


def test_every_supplement_key_sets_the_model(tmp_path):
    path = tmp_path / 'arm.yaml'
    path.write_text(FULL)
    model = load(ARM, supplement=path)
    first, second = (body.joint for body in model.bodies)
    assert [getattr(first, key) for key in JOINT_KEYS] == [
        0.1, 5.0, -0.2, 0.5, 0.4, 0.8, 1.2, 1.1, 1.6, 0.2, 0.05, 0.1, -0.3, 300.0, 2.5,
        1e-3]
    assert (second.stiffness, second.rest, second.armature) == (2.5, 0.0, 0.0)
    carrier = model.bodies[1].inertial
    assert carrier.mass == 3.0
    assert_allclose(carrier.com, [0, 0, 1.0])
    about_com = 0.1 * np.eye(3)
    moved = np.diag([1, 1, 0]) * (1 * 1.0 ** 2 + 2 * 0.5 ** 2)
    load_inertia = [[0.1, 0.01, -0.02], [0.01, 0.2, 0.03], [-0.02, 0.03, 0.25]]
    assert_allclose(carrier.inertia, about_com + load_inertia + moved, atol=1e-15)


def test_supplement_as_dict_equals_file(tmp_path):
    path = tmp_path / 'arm.yaml'
    path.write_text('joints: {j: {armature: 0.1}}')
    assert load(ARM, supplement={'joints': {'j': {'armature': 0.1}}}).digest() == load(
        ARM, supplement=str(path)).digest() != load(ARM).digest()


def test_values_without_override_are_unchanged():
    joint_ = load(ARM, supplement={'joints': {'j': {'armature': 0.1}}}).bodies[0].joint
    assert (joint_.damping, joint_.friction, joint_.friction_speed) == (0.7, 0.3, 0.05)


@pytest.mark.parametrize('text', ['', '# nothing', '---\n'])
def test_a_supplement_that_was_cut_to_nothing_is_named(text, tmp_path):
    path = tmp_path / 'arm.yaml'
    path.write_text(text)
    with pytest.raises(UrdfError,
                       match=r"supplement '.*arm\.yaml': an empty file; expected a YAML "
                       'mapping'):
        load(ARM, supplement=path)


@pytest.mark.parametrize('text', ['joints: {}', '{}'])
def test_empty_supplement_changes_nothing(text, tmp_path):
    path = tmp_path / 'arm.yaml'
    path.write_text(text)
    assert load(ARM, supplement=path).digest() == load(ARM).digest()


def test_payload_on_a_base_link_adds_to_the_base_inertial():
    model = load(ARM, supplement={'payload': {'link': 'a', 'mass': 4}})
    assert model.base_inertial.mass == 5.0


def test_payload_is_kept_on_a_dropped_link():
    model = load(ARM, supplement={'payload': {'link': 'tool', 'mass': 4}},
                 drop=['tool', 'c'])
    assert model.bodies[1].inertial.mass == 4.0


def test_supplement_may_name_a_locked_joint():
    extra = {'joints': {'j': {'stiffness': 1}, 'k': {'stiffness': 2}}}
    assert load(ARM, joints=['k'], supplement=extra).bodies[0].joint.stiffness == 2.0


def test_supplement_may_name_an_expanded_joint():
    source = robot(link('a'), link('b'), joint('j', 'a', 'b', 'floating', limit=''))
    model = load(source, supplement={'joints': {'j/z': {'stiffness': 9}}})
    assert [body.joint.stiffness for body in model.bodies] == [0, 0, 9, 0, 0, 0]


PAYLOAD = {'link': 'tool', 'mass': 1}
FAULTS = {
    'unknown section': ({'joint': {}}, ("'joint'", 'expected one of joints, payload')),
    'unknown key': ({'joints': {'j': {'stifness': 1}}},
                    ("joint 'j'", "'stifness'", 'armature, stiffness')),
    'unknown joint': ({'joints': {'x': {}}}, ("'x'", 'expected some of j, k')),
    'fixed joint': ({'joints': {'f': {'stiffness': 1}}},
                    ("'f'", 'can move', 'expected some of j, k')),
    'negative stiffness': ({'joints': {'j': {'stiffness': -1}}},
                           ("joint 'j'", 'stiffness: -1;', 'not negative')),
    'friction speed of zero': ({'joints': {'j': {'friction_speed': 0}}},
                               ("joint 'j'", 'friction_speed: 0;', 'positive')),
    'nan': ({'joints': {'j': {'armature': float('nan')}}},
            ("'j'", 'armature: nan', 'finite')),
    'infinite': ({'joints': {'j': {'rest': '1e999'}}}, ("'j'", 'rest:', 'finite')),
    'text': ({'joints': {'j': {'damping': 'much'}}},
             ("'j'", "damping: 'much'", 'finite')),
    'truth': ({'joints': {'j': {'damping': True}}}, ("'j'", 'damping: True', 'finite')),
    'nothing': ({'joints': {'j': {'damping': None}}},
                ("'j'", 'damping: None', 'finite')),
    'list': ({'joints': {'j': {'damping': [1]}}}, ("'j'", 'damping: [1]', 'finite')),
    'joint without mapping': ({'joints': {'j': 5}},
                              ("joint 'j': 5", 'a mapping of armature')),
    'joints without mapping': ({'joints': ['j']}, ("joints: ['j']", 'mapping of names')),
    'number as joint': ({'joints': {1: {}}}, ('1', 'expected one of')),
    'unknown payload key': ({'payload': {**PAYLOAD, 'weight': 1}},
                            ('payload', "'weight'", 'link, mass, com, inertia')),
    'payload without mass': ({'payload': {'link': 'tool'}},
                             ('payload', "'mass'", 'com and inertia')),
    'payload without link': ({'payload': {'mass': 1}},
                             ('payload', 'link None', 'name of a link')),
    'payload nowhere': ({'payload': {'link': 'x', 'mass': 1}},
                        ("'x'", 'expected one of a, b, c, tool')),
    'payload on a number': ({'payload': {'link': 1, 'mass': 1}},
                            ('link 1;', 'name of a link')),
    'negative payload': ({'payload': {'link': 'tool', 'mass': -1}},
                         ('payload: mass: -1', 'not negative')),
    'com of two': ({'payload': {**PAYLOAD, 'com': [0, 0]}},
                   ('com [0, 0]', 'three numbers')),
    'com of text': ({'payload': {**PAYLOAD, 'com': 'abc'}},
                    ("com 'abc'", 'three numbers')),
    'com of none': ({'payload': {**PAYLOAD, 'com': [0, 0, None]}},
                    ('com: None', 'finite')),
    'unknown moment': ({'payload': {**PAYLOAD, 'inertia': {'iyx': 1}}},
                       ("'iyx'", 'ixx, ixy')),
    'inertia as list': ({'payload': {**PAYLOAD, 'inertia': [1, 1, 1]}},
                        ('inertia: [1, 1, 1]', 'a mapping of ixx')),
    'no mapping': ([1], ('[1]', 'path of a YAML file, or a dict')),
    'no file': ('/nowhere/x.yaml', ("'/nowhere/x.yaml'", 'no such file')),
    'a directory': ('/', ("'/'", 'directory')),
}


@pytest.mark.parametrize('fault', FAULTS)
def test_fault_is_refused_with_key_value_and_what_is_valid(fault):
    supplement, words = FAULTS[fault]
    with pytest.raises(UrdfError) as caught:
        load_urdf(ARM, supplement=supplement)
    for word in words:
        assert word in str(caught.value)


def test_payload_with_indefinite_inertia_is_rejected():
    with pytest.raises(ModelError, match=r'payload: inertia .* -1 .* negative'):
        load_urdf(ARM, supplement={'payload': {**PAYLOAD, 'inertia': {'ixx': -1}}})


def test_payload_on_a_link_that_was_cut_off_is_refused():
    with pytest.raises(UrdfError, match=r"link 'a'.*expected one of c, tool"):
        load_urdf(ARM, base='c', supplement={'payload': {'link': 'a', 'mass': 1}})


@pytest.mark.parametrize(('text', 'words'), [
    ('joints: {j: {damping: 1, damping: 2}}', ('damping', 'more than once')),
    ('joints: {j: {damping: 1}', ('not valid YAML',)),
    ('- 1\n', ('[1]', 'mapping of joints, payload')),
    ('just text', ("'just text'", 'mapping of joints, payload')),
    ('!!python/object/apply:os.system ["true"]', ('not valid YAML',)),
    ('a: 1\n---\nb: 2', (': 2 YAML documents',)),
    ('[' * 20_000, ('not valid YAML',)),
    ('joints: &a {j: *a}', ("joint 'j'", 'expected one of armature')),
    ('joints: {? [1] : 2}', ('joints',)),
    ('<<: 5', ('not valid YAML',)),
    ('\ufffe\x00', ('not valid YAML',)),
])
def test_yaml_fault_is_refused_in_words(text, words, tmp_path):
    path = tmp_path / 'arm.yaml'
    path.write_bytes(text.encode())
    with pytest.raises(KaneError) as caught:
        load_urdf(chain(1), supplement=path)
    for word in words:
        assert word in str(caught.value)
    assert len(str(caught.value)) < 1000


def test_binary_yaml_is_rejected(tmp_path):
    path = tmp_path / 'arm.yaml'
    path.write_bytes(b'\x80\x81\xff')
    with pytest.raises(UrdfError, match='not valid YAML'):
        load_urdf(ARM, supplement=path)


def test_yaml_of_many_aliases_is_refused_at_once(tmp_path):
    path = tmp_path / 'arm.yaml'
    levels = [f'a{i}: &a{i} [{", ".join([f"*a{i - 1}"] * 9)}]' for i in range(1, 12)]
    path.write_text('a0: &a0 x\n' + '\n'.join(levels) + '\njoints: {j: *a11}\n')
    with pytest.raises(UrdfError, match="unknown key 'a0'"):
        load_urdf(ARM, supplement=path)
    path.write_text(
        path.read_text().replace('joints: {j: *a11}', '').replace('a0:', 'joints:', 1)
        .replace('a11:', 'payload:'))
    with pytest.raises(UrdfError) as caught:
        load_urdf(ARM, supplement=path)
    assert len(str(caught.value)) < 2000
