"""The table of arms: its rows, how it recognises an arm, and what contradicts it."""

from kane_dynamics import Terms
from kane_dynamics.analysis import known_arms
from kane_dynamics.analysis.known_arms import (arms_named, contradiction,
                                               effort_contradiction, words)
from kane_dynamics.control.terms import stated_terms
from kane_dynamics.errors import InputError
import pytest
import yaml


def first(name, joints=()):
    return next(iter(arms_named(name, joints)), None)


def test_every_row_has_sources_and_is_recognised_by_one_name_of_its_own():
    names = ('ur10e', 'fr3', 'panda', 'lbr_iiwa_14_r820', 'lwr', 'j2n6s300', 'gen3',
             'xarm7', 'openarm', 'yam', 'open_manipulator_x', 'so101', 'piper',
             'rebot_b601', 'axol', 'wxai')
    recognised = set()
    for name in names:
        for row in arms_named(name):
            recognised.add(row)
    assert recognised == set(known_arms.known_arms())
    assert all(row.sources and all(row.sources) for row in recognised)


@pytest.mark.parametrize(('names', 'vendor'), [
    (('ur', 'ur3', 'ur5e', 'ur20', 'UR10e', 'ur5e_robot'), 'Universal Robots'),
    (('fr3', 'fr3v2', 'panda', 'fer', 'panda_arm'), 'Franka Robotics'),
    (('iiwa', 'iiwa7', 'lbr', 'med14', 'lbr_iiwa_7_r800'), 'KUKA'),
    (('gen3', 'gen3_lite', 'j2s7s300'), 'Kinova'),
    (('xarm6', 'UF850', 'lite6'), 'UFACTORY'),
    (('so100', 'so101_new_calib', 'SO_ARM101'), 'TheRobotStudio, Hugging Face'),
    (('piper', 'piper_description'), 'AgileX')])
def test_an_arm_is_recognised_by_the_name_of_its_robot(names, vendor):
    assert [first(name).vendor for name in names] == [vendor] * len(names)


def test_an_arm_is_recognised_by_its_joints_and_others_are_not():
    joints = [f'left_{name}_joint' for name in ('shoulder_pan', 'elbow', 'wrist_1')]
    assert first('robot', joints).vendor == 'Universal Robots'
    assert first('robot', [*joints, 'rail']) is None
    for name in ('arm', 'two_link', 'medium_arm', 'literature',
                 'feral', 'turtle', 'yams', ''):
        assert arms_named(name) == ()


def test_gravity_in_the_command_of_an_arm_that_adds_it_is_a_contradiction():
    rows = arms_named('ur10e')
    assert contradiction(rows, ('friction', 'gravity')) == ''
    assert 'where gravity would count twice' in contradiction(rows, ('none',))
    assert 'where gravity would count twice' in contradiction(rows, ('friction',))
    assert 'expected gravity, friction for Universal Robots' in contradiction(
        rows, ('gravity',))
    assert 'nothing would hold the weight' in contradiction(
        arms_named('gen3'), ('gravity',))


def test_an_arm_with_two_interfaces_may_be_either_and_an_unknown_one_anything():
    rows = arms_named('yam')
    assert contradiction(rows, ('none',)) == contradiction(
        rows, ('gravity', 'friction')) == ''
    assert 'count twice' not in contradiction(rows, ('friction',))
    assert contradiction((), ('coriolis',)) == ''
    # It has no effort interface.
    assert contradiction(arms_named('xarm7'), ('none',)) == ''


def test_efforts_that_the_table_does_not_list_for_an_arm_are_a_contradiction():
    ur = arms_named('ur10e')
    yam = arms_named('yam')
    assert effort_contradiction(ur, 'motor_torque', False) == ''
    assert effort_contradiction(ur, 'motor_current', True) == ''
    assert effort_contradiction(ur, 'external_torque', True) == ''
    assert effort_contradiction(yam, 'joint_torque', True) == ''  # unconfirmed
    words = effort_contradiction(ur, 'motor_torque', True)
    assert words.startswith(
        'efforts: motor_torque with gravity; expected motor_torque without')


ROW = {'vendor': 'V', 'arm': 'A', 'name': 'a', 'interface': 'i', 'versions': 1,
       'compensates': ['gravity'], 'efforts': [{'kind': 'joint_torque'}],
       'sources': ['s']}


@pytest.mark.parametrize(('change', 'words'), [
    ({'compensates': ['weight']}, 'row 1, compensates'), ({'sources': []}, 'no sources'),
    ({'name': '('}, 'expected a regular expression'), ({'colour': 'red'}, 'unknown key'),
    ({'efforts': [{'kind': 'force'}]}, "kind 'force'"),
    ({'efforts': [{'kind': 'joint_torque', 'gravity': 'some'}]}, "gravity 'some'")])
def test_a_wrong_row_is_refused_by_its_number(change, words, tmp_path, monkeypatch):
    path = tmp_path / 'arms.yaml'
    path.write_text(yaml.safe_dump([ROW | change]))
    monkeypatch.setattr(known_arms, 'TABLE', path)
    with pytest.raises(InputError, match=words):
        known_arms.known_arms.__wrapped__()


def test_a_row_without_a_needed_key_is_refused(tmp_path, monkeypatch):
    path = tmp_path / 'arms.yaml'
    path.write_text(
        yaml.safe_dump([{key: ROW[key] for key in ROW if key != 'compensates'}]))
    monkeypatch.setattr(known_arms, 'TABLE', path)
    with pytest.raises(InputError, match='no compensates; expected all of'):
        known_arms.known_arms.__wrapped__()


def test_the_terms_to_command_are_those_that_the_arm_does_not_add():
    assert Terms.beside(['none']) == Terms()
    assert Terms.beside(('gravity', 'friction')) == Terms(gravity=False, friction=False)
    assert stated_terms('gravity, friction', 'x') == ('gravity', 'friction')
    for wrong in ('', [], 'weight', ['none', 'gravity'], ['gravity', 'gravity'], 3, None,
                  [3]):
        with pytest.raises(InputError, match='expected a list of gravity, friction'):
            stated_terms(wrong, 'x')
    assert [words(names) for names in (('none',), ('gravity',),
                                       ('gravity', 'friction'))] == [
                                           'nothing', 'gravity', 'gravity and friction']
