"""Warnings: one per kind of legal but questionable content, naming links and joints."""

import math
import subprocess
import sys
import warnings

from kane_dynamics.urdf import load_urdf
import pytest
from urdf_writer import chain, joint, LIMIT, link, load, load_with_warnings, robot

A = link('a')
B = link('b')


def limit(text):
    """Return a robot with the attributes `text` in a joint's limit, or none."""
    return robot(A, B, joint('j', 'a', 'b', limit=text and f'<limit {text}/>'))


# name: (URDF, words of the one warning)
WARNINGS = {
    'triangle inequality': (robot(A, link('b', 1, (1, 1, 3)), joint('j', 'a', 'b')),
                            ('principal moment exceeds', ': b')),
    'singular inertia': (robot(A, link('b', 1, (0, 1, 1)), joint('j', 'a', 'b')),
                         ('moment of inertia of zero', ': b')),
    'massless body': (robot(A, link('b', 0, (0, 0, 0)), joint('j', 'a', 'b')),
                      ('without mass', ': b')),
    'missing inertial': (robot(A, link('b', None), joint('j', 'a', 'b')),
                         ('without <inertial>', ': b')),
    'long axis': (robot(A, B, joint('j', 'a', 'b', axis='0 0 2')),
                  ('not a unit vector', 'normalized', 'j (2)')),
    'missing axis': (robot(A, B, joint('j', 'a', 'b', axis=None)), ('"1 0 0"', ': j')),
    'missing limit': (limit(''), ('unlimited', ': j')),
    'missing bounds': (limit('velocity="1" effort="1"'),
                       ('unlimited', 'j (lower, upper)')),
    'missing effort': (limit('lower="-1" upper="1" velocity="1"'),
                       ('unlimited', 'j (effort)')),
    'missing velocity': (limit('lower="-1" upper="1" effort="1"'),
                         ('unlimited', 'j (velocity)')),
    'reversed bounds': (limit('lower="1" upper="-1" velocity="1" effort="1"'),
                        ('not below upper', 'unlimited', 'j (1 to -1)')),
    'zero effort': (limit('lower="-1" upper="1" velocity="1" effort="0"'),
                    ('0 for effort', 'unlimited', 'j (effort)')),
    'transmission': (robot(A, B, joint('j', 'a', 'b'),
                           '<transmission name="t"><joint name="j"/>'
                           '</transmission>'), ('not used', '<transmission>: j')),
    'safety controller': (robot(A, B,
                                joint('j', 'a', 'b', more='<safety_controller k="1"/>')),
                          ('not used', "<safety_controller>: joint 'j'")),
    'calibration': (robot(A, B, joint('j', 'a', 'b', more='<calibration rising="0"/>')),
                    ('not used', "<calibration>: joint 'j'")),
    'gazebo spring': (robot(A, B, joint('j', 'a', 'b'),
                            '<gazebo reference="j"><springStiffness>1'
                            '</springStiffness></gazebo>'),
                      ('not used', '<gazebo> <springStiffness>: j')),
    'unknown attribute that states zero': (
        robot(A, B, joint('j', 'a', 'b', more='<dynamics armature="0.0"/>')),
        ('not used', "<dynamics> attribute 'armature': joint 'j'")),
    'lower triangle of an inertia that differs': (
        robot(A, link('b').replace('ixy="0"', 'ixy="0" iyx="0.1"'),
              joint('j', 'a', 'b')),
        ('not used', "<inertia> attribute 'iyx': link 'b'")),
    'limit of another quantity': (
        limit('lower="-1" upper="1" velocity="1" effort="1" jerk="9"'),
        ('not used', "<limit> attribute 'jerk': joint 'j'")),
    'misspelt element': (robot(A, '<link name="b"><inertail/></link>',
                               joint('f', 'a', 'b', 'fixed')),
                         ('not used', "<inertail>: link 'b'")),
    'bounds of a continuous joint': (
        robot(A, B, joint('j', 'a', 'b', 'continuous')),
        ('not used', '<limit> lower and upper of a continuous joint: j')),
    'effort of a mimic joint': (robot(A, B, link('c'), joint('j', 'a', 'b'), joint(
        'f', 'a', 'c', limit='<limit lower="-1" upper="1" velocity="2" effort="0.1"/>',
        more='<mimic joint="j"/>')),
                                ('not used', ('<limit> effort of a mimic joint, whose '
                                              "torque is its master's: f"))),
    'bounds of a mimic joint beyond its master': (
        robot(A, B, link('c'), joint('j', 'a', 'b'), joint(
            'f', 'a', 'c', more='<mimic joint="j" offset="2"/>')),
        ('excludes all positions', 'unlimited in position', 'f (-1 to 1)')),
    'limit of a floating joint': (robot(A, B, joint('j', 'a', 'b', 'floating')),
                                  ('not used', '<limit> of a floating joint: j')),
    'mimic on a fixed joint': (robot(A, B, joint('j', 'a', 'b', 'fixed',
                                                 more='<mimic joint="x"/>')),
                               ('not used', '<mimic> of a fixed joint: j')),
}


@pytest.mark.parametrize('problem', WARNINGS)
def test_warning_names_the_link_or_joint(problem):
    source, words = WARNINGS[problem]
    _, texts = load_with_warnings(source)
    assert len(texts) == 1, texts
    for word in words:
        assert word in texts[0]


def test_each_kind_of_problem_is_one_warning_that_names_all():
    source = chain(4, axis='0 0 3', limit='')
    _, texts = load_with_warnings(source)
    assert len(texts) == 2
    assert 'j1 (3), j2 (3), j3 (3), j4 (3)' in texts[0]
    assert texts[1].endswith('j1, j2, j3, j4')


def test_warning_points_at_the_caller():
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter('always')
        load_urdf(chain(1, limit=''))
    assert caught[0].filename == __file__


@pytest.mark.parametrize('problem', ['zero effort', 'missing limit', 'reversed bounds'])
def test_invalid_or_missing_limit_is_infinite(problem):
    model, _ = load_with_warnings(WARNINGS[problem][0])
    limits = model.bodies[0].joint.limits
    assert (limits.effort if problem == 'zero effort' else limits.upper) == math.inf


def test_one_bound_alone_leaves_the_other_at_zero_as_urdf_says():
    limits = load(limit('upper="0.04" velocity="1" effort="1"')).bodies[0].joint.limits
    assert (limits.lower, limits.upper) == (0.0, 0.04)


def test_joints_that_stand_still_need_no_limits():
    load(chain(3, limit=''), locked={'j1': 0, 'j2': 0, 'j3': 0})


def test_massless_fixed_or_removed_links_cause_no_warning():
    load(robot(link('a', 1, (1, 1, 9)), B, link('tool', None), joint('j', 'a', 'b'),
               joint('f', 'b', 'tool', 'fixed')), base='b')


@pytest.mark.parametrize('more', [
    '<material name="m"><color rgba="1 1 1 1"/></material>',
    '<gazebo reference="a"><material>x</material><selfCollide>1</selfCollide></gazebo>',
    '<gazebo><plugin name="p" filename="f"><springStiffness/></plugin></gazebo>',
    '<ros2_control name="x" type="system"><joint name="j"/></ros2_control>',
])
def test_elements_without_dynamics_cause_no_warning(more):
    load(robot(A, B, joint('j', 'a', 'b', limit=LIMIT), more))


def test_axis_rounded_in_decimal_causes_no_warning():
    load(robot(A, B, joint('j', 'a', 'b', axis='0.7071 0.7071 0')))


def test_thin_plate_and_rod_rounded_in_decimal_satisfy_the_triangle_inequality():
    load(
        robot(A, link('b', 1, (0.0333333, 0.0333333, 0.06666664)), joint('j', 'a', 'b')))


def test_transmissions_are_reported_only_where_a_filter_asks_for_it(tmp_path):
    path = tmp_path / 'arm.urdf'
    path.write_text(WARNINGS['transmission'][0])
    load = f'from kane_dynamics import load_urdf; load_urdf({str(path)!r})'
    quiet = subprocess.run([sys.executable, '-c', load], capture_output=True, text=True,
                           check=True)
    assert quiet.stderr == ''
    asked = subprocess.run([sys.executable, '-W', 'always', '-c', load],
                           capture_output=True, text=True, check=True)
    assert '<transmission>: j' in asked.stderr
