"""Invalid URDFs are rejected with the element, its value and the valid ones."""

from kane_dynamics.errors import KaneError, ModelError, UrdfError
from kane_dynamics.urdf import load_urdf
import pytest
from urdf_writer import chain, joint, link, load_with_warnings, robot

A = link('a')
B = link('b')
C = link('c')
J = joint('j', 'a', 'b')
K = joint('k', 'b', 'c')
NUMBERS = ('one finite number',)
THREE = ('3 finite numbers',)
HALF_TURN = 'quat_xyzw="0 0 1 0" '


def limit(**values):
    """Return a complete <limit> with some values replaced."""
    arguments = {'lower': -1, 'upper': 1, 'velocity': 2, 'effort': 3, **values}
    return f'<limit {" ".join(f"{k}={str(v)!r}" for k, v in arguments.items())}/>'


def mimic(master, more=''):
    """Return a <mimic>."""
    return f'<mimic joint="{master}"{more}/>'


# name: (URDF, error, words that the message must hold)
FAULTS = {
    'decimal comma': (robot(A, B, joint('j', 'a', 'b', xyz='1,0 0 0')), UrdfError,
                      ("joint 'j'", '<origin> xyz', "'1,0 0 0'", *THREE)),
    'letters': (robot(A, link('b', 'abc'), J), UrdfError,
                ("link 'b'", '<mass> value', "'abc'", *NUMBERS)),
    'two numbers of three': (robot(A, B, joint('j', 'a', 'b', xyz='1 0')), UrdfError,
                             ("joint 'j'", 'xyz', "'1 0'", *THREE)),
    'four numbers of three': (robot(A, B, joint('j', 'a', 'b', rpy='1 0 0 0')),
                              UrdfError,
                              ("joint 'j'", 'rpy', "'1 0 0 0'", *THREE)),
    'unknown attribute of <dynamics>': (
        robot(A, B, joint('j', 'a', 'b', more='<dynamics armature="1"/>')), UrdfError,
        ("joint 'j'", '<dynamics>', "'armature' = '1'", 'expected damping, friction')),
    'misspelt attribute': (
        robot(A, B, joint('j', 'a', 'b', more='<dynamics dampping="1"/>')), UrdfError,
        ("joint 'j'", "'dampping'", 'expected damping, friction')),
    'unknown attribute of <axis>': (
        robot(A, B, joint('j', 'a', 'b').replace('<axis ', '<axis rpy="0 0 1" ')),
        UrdfError, ("joint 'j'", '<axis>', "'rpy' = '0 0 1'", 'expected xyz')),
    'version unknown': (robot(A, B, J).replace('<robot ', '<robot version="2.0" '),
                        UrdfError, ('<robot>', "version '2.0'", '1.0, 1.1, 1.2')),
    'quaternion in a file of version 1.0': (
        robot(A, B, joint('j', 'a', 'b')).replace('<origin ', '<origin ' + HALF_TURN, 1),
        UrdfError, ('<origin>', "'quat_xyzw'", 'version="1.1"')),
    'no number': (robot(A, B, joint('j', 'a', 'b', axis=' ')), UrdfError,
                  ("joint 'j'", '<axis>', "'xyz'", 'expected xyz')),
    'nan': (robot(A, link('b', 'nan'), J), UrdfError, ("link 'b'", "'nan'", 'finite')),
    'infinity': (robot(A, B, joint('j', 'a', 'b', xyz='inf 0 0')), UrdfError,
                 ("joint 'j'", "'inf 0 0'", 'finite')),
    'overflow': (robot(A, link('b', '1e999'), J), UrdfError,
                 ("link 'b'", "'1e999'", 'finite')),
    'infinite limit': (robot(A, B, joint('j', 'a', 'b', limit=limit(effort='inf'))),
                       UrdfError,
                       ("joint 'j'", '<limit> effort', "'inf'", 'finite')),
    'python number': (robot(A, link('b', '1_0'), J), UrdfError,
                      ("link 'b'", "'1_0'", *NUMBERS)),
    'foreign digits': (robot(A, link('b', '\u0661'), J), UrdfError,
                       ("link 'b'", *NUMBERS)),
    'unexpanded macro': (robot(A, link('b', '${m}'), J), UrdfError,
                         ("link 'b'", '${m}', 'xacro first')),
    'macro element': (robot(A, '<xacro:arm name="x"/>'), UrdfError,
                      ("robot 'r'", '<xacro:arm>', 'output of xacro')),
    'bad damping': (robot(A, B, joint('j', 'a', 'b', more='<dynamics damping="x"/>')),
                    UrdfError,
                    ("joint 'j'", '<dynamics> damping', "'x'", *NUMBERS)),
    'bad multiplier': (robot(A, B, C, J, joint('k', 'b', 'c', more=mimic(
        'j', ' multiplier="1/2"'))), UrdfError, ("joint 'k'", "'1/2'", *NUMBERS)),
    'mass missing': (robot('<link name="a"><inertial><inertia ixx="1" iyy="1" izz="1" '
                           'ixy="0" ixz="0" iyz="0"/></inertial></link>'), UrdfError,
                     ("link 'a'", '<inertial>', '<mass>', 'exactly one')),
    'inertia missing': (robot('<link name="a"><inertial><mass '
                              'value="1"/></inertial></link>'), UrdfError,
                        ("link 'a'", '<inertial>', 'no <inertia>',
                         'expected <inertia>, or strict=False for a point mass')),
    'moment missing': (robot('<link name="a"><inertial><mass value="1"/><inertia '
                             'ixx="1"/></inertial></link>'), UrdfError,
                       ("link 'a'", '<inertia>', "'ixy'", 'ixx, ixy, ixz')),
    'two inertials': (robot(A.replace('</link>', '') + A[A.index('<inertial>'):]),
                      UrdfError,
                      ("link 'a'", 'more than one <inertial>', '; expected one')),
    'two origins': (robot(A, B, joint('j', 'a', 'b', more='<origin xyz="1 0 0"/>')),
                    UrdfError,
                    ("joint 'j'", 'more than one <origin>', '; expected one')),
    'no link name': (robot('<link/>'), UrdfError, ('<link>', 'None', 'nonempty')),
    'empty joint name': (robot(A, B, joint('', 'a', 'b')), UrdfError,
                         ('<joint>', "''", 'nonempty')),
    'no robot name': ('<robot><link name="a"/></robot>', UrdfError,
                      ('<robot>', 'nonempty')),
    'endless name': (robot(link('n' * 5000)), UrdfError, ('<link>', '5000', 'at most')),
    'no link': (robot(), UrdfError, ("robot 'r'", 'no <link>', 'at least one')),
    'no parent': (robot(A, B, J.replace('<parent link="a"/>', '')), UrdfError,
                  ("joint 'j'", 'no <parent>', 'exactly one')),
    'parent without link': (robot(A, B, J.replace('<parent link="a"/>', '<parent/>')),
                            UrdfError,
                            ("joint 'j'", '<parent>', "'link'", 'expected link')),
    'no child': (robot(A, B, J.replace('<child link="b"/>', '')), UrdfError,
                 ("joint 'j'", 'no <child>', 'exactly one')),
    'unknown type': (robot(A, B, joint('j', 'a', 'b', 'screw')), UrdfError,
                     ("joint 'j'", "'screw'", 'revolute, continuous, prismatic, fixed')),
    'type missing': (robot(A, B, J.replace(' type="revolute"', '')), UrdfError,
                     ("joint 'j'", 'type None', 'revolute, continuous')),
    'duplicate link': (robot(A, B, A, J), UrdfError, ('link names', "'a'", 'unique')),
    'duplicate joint': (robot(A, B, C, J, joint('j', 'b', 'c')), UrdfError,
                        ('joint names', "'j'", 'unique')),
    'unknown parent': (robot(A, B, joint('j', 'x', 'b')), UrdfError,
                       ("joint 'j'", "parent 'x'", 'expected one of a, b')),
    'unknown child': (robot(A, B, joint('j', 'a', 'x')), UrdfError,
                      ("joint 'j'", "child 'x'", 'expected one of a, b')),
    'two roots': (robot(A, B), ModelError,
                  ('links a, b', 'no parent', 'exactly one root')),
    'two parents': (robot(A, B, C, J, K, joint('l', 'a', 'c')), ModelError,
                    ("link 'c'", "'k' and 'l'", '; expected one')),
    'loop beside the tree': (robot(A, B, C, joint('j', 'c', 'b'), K), ModelError,
                             ('b', 'c', 'loop', 'expected a tree')),
    'loop without root': (robot(A, B, J, joint('k', 'b', 'a')), ModelError,
                          ('a, b, a', 'loop', 'expected a tree')),
    'own parent': (robot(A, B, joint('j', 'b', 'b')), ModelError, ('b, b', 'loop')),
    'mimics nothing': (robot(A, B, joint('j', 'a', 'b', more=mimic('x'))), UrdfError,
                       ("joint 'j'", "'x'", 'is no joint')),
    'mimic without joint': (robot(A, B, joint('j', 'a', 'b', more='<mimic/>')),
                            UrdfError,
                            ("joint 'j'", '<mimic>', "'joint'", 'expected joint')),
    'mimics a fixed joint': (robot(A, B, C, joint('j', 'a', 'b', 'fixed'), joint(
        'k', 'b', 'c', more=mimic('j'))), UrdfError,
                             ("joint 'k'", "'j'", 'is fixed', 'expected')),
    'mimics a floating joint': (
        robot(A, B, C, joint('j', 'a', 'b', 'floating', limit=''),
              joint('k', 'b', 'c', more=mimic('j'))), UrdfError,
        ("joint 'k'", "'j'", 'is floating')),
    'floating mimic': (robot(A, B, C, J, joint('k', 'b', 'c', 'floating',
                                               more=mimic('j'))), UrdfError,
                       ("joint 'k'", 'floating', '<mimic>', 'revolute, continuous')),
    'mimics itself': (robot(A, B, joint('j', 'a', 'b', more=mimic('j'))), ModelError,
                      ('j, j', 'circle', 'chain')),
    'mimic circle': (robot(A, B, C, joint('j', 'a', 'b', more=mimic('k')), joint(
        'k', 'b', 'c', more=mimic('j'))), ModelError, ('j, k, j', 'circle', 'chain')),
    'mimic overflow': (robot(A, B, C, link('d'), J, joint('k', 'b', 'c', more=mimic(
        'j', ' multiplier="1e50"')), joint('l', 'c', 'd', more=mimic(
            'k', ' multiplier="1e50"'))), ModelError,
                       ("joint 'l'", 'multiplier', '1e+100')),
    'zero axis': (robot(A, B, joint('j', 'a', 'b', axis='0 0 0')), ModelError,
                  ("joint 'j'", '<axis>', '[0.0, 0.0, 0.0]', 'nonzero')),
    'negative mass': (robot(A, link('b', -1), J), ModelError,
                      ("link 'b'", '<mass>', '-1.0', 'negative')),
    'negative moment': (robot(A, link('b', 1, (-1, 1, 1)), J), ModelError,
                        ("link 'b'", '<inertia>', '-1', 'strict=False')),
    'indefinite products': (
        robot(A, link('b', 1, (1, 1, 1), products=(2, 0, 0)), J), ModelError,
        ("link 'b'", '<inertia>', '-1', 'strict=False')),
    'negative damping': (robot(A, B,
                               joint('j', 'a', 'b', more='<dynamics damping="-1"/>')),
                         ModelError, ("joint 'j'", 'damping', '-1.0', 'negative')),
    'negative friction': (robot(A, B,
                                joint('j', 'a', 'b', more='<dynamics friction="-1"/>')),
                          ModelError, ("joint 'j'", 'friction', '-1.0', 'negative')),
    'negative effort': (robot(A, B, joint('j', 'a', 'b', limit=limit(effort=-3))),
                        ModelError,
                        ("joint 'j'", 'effort', '-3.0', 'negative')),
    'negative velocity': (robot(A, B, joint('j', 'a', 'b', limit=limit(velocity=-3))),
                          ModelError,
                          ("joint 'j'", 'velocity', '-3.0', 'negative')),
    'expanded name taken': (
        robot(A, B, C, joint('j', 'a', 'b', 'planar', limit=''),
              joint('j/x', 'b', 'c')), UrdfError,
        ("joint 'j'", "'j/x'", 'planar', 'expected a unique name')),
    'SDF': ('<sdf version="1.6"><model name="m"/></sdf>', UrdfError,
            ('<sdf>', 'expected <robot>')),
    'unclosed': ('<robot name="r"><link name="a">', UrdfError,
                 ('expected well-formed XML', 'line 1')),
    'comment before the declaration': (
        f'<!-- arm --><?xml version="1.0"?>{robot(A)}', UrdfError,
        ('expected <?xml ...?> before all else',)),
    'empty bytes': (b'', UrdfError, ('expected well-formed XML', 'no element')),
    'two documents': (robot(A) + robot(A), UrdfError,
                      ('expected well-formed XML', 'junk')),
}


@pytest.mark.parametrize('fault', FAULTS)
def test_fault_is_refused_with_element_value_and_what_is_valid(fault):
    source, kind, words = FAULTS[fault]
    with pytest.raises(KaneError) as caught:
        load_urdf(source)
    assert type(caught.value) is kind
    for word in words:
        assert word in str(caught.value)


def test_an_error_names_the_line():
    source = ('<robot name="r">\n<link name="a"/>\n<link name="b"><inertial>\n<mass '
              'value="x"/>')
    with pytest.raises(UrdfError, match=r'\(line 4\)'):
        load_urdf(source + '<inertia/></inertial></link></robot>')


def test_long_list_of_what_is_valid_is_cut():
    source = chain(500).replace('parent link="l7"', 'parent link="nowhere"')
    with pytest.raises(UrdfError, match='and 461 more') as caught:
        load_urdf(source)
    assert len(str(caught.value)) < 500


def test_indefinite_inertia_is_a_warning_if_not_strict():
    model, texts = load_with_warnings(robot(A, link('b', 1, (-0.5, 1, 1)), J),
                                      strict=False)
    assert any('negative principal moment' in text and text.endswith(': b')
               for text in texts)
    assert model.bodies[0].inertial.inertia[0, 0] == -0.5


def test_inertia_indefinite_by_rounding_only_is_no_error():
    load_with_warnings(robot(A, link('b', 0.3, (0, 0, 0), products=(0, 1.4e-20, 0)), J))
