"""The doctor's checks of parameter files and joint states."""

from functools import cache
import math
from pathlib import Path
import sys

from kane_dynamics import load_urdf, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.errors import InputError
from kane_dynamics.identification import Efforts
from kane_dynamics.ros.common.conversion import NANO
from kane_dynamics.ros.doctor.configuration import (configured_efforts,
                                                    examine_configuration)
from kane_dynamics.ros.doctor.live_graph import examine_states, ReceivedState
import numpy as np
import pytest
from sensor_msgs.msg import JointState

URDF = Path(resource_path('urdf', 'two_link.urdf')).read_text(encoding='utf-8')
FITS = ('all parameters are known and fit the arm, which adds nothing to commanded '
        'efforts itself')
LOADS = 'loads the URDF of the launch argument urdf or of topic robot_description'
POSE = [0.3, 0.5]
NOW = 1_000 * NANO


@cache
def arm():
    return Robot(load_urdf(URDF))


@pytest.fixture
def examine(tmp_path):
    """Return a function that checks a file with a text: findings and robot."""
    def examine(text, **choices):
        path = tmp_path / 'arm.yaml'
        path.write_text(text)
        findings, robot = examine_configuration(path, URDF, **choices)
        # Whether the action is served depends on the machine.
        return [(finding.level, finding.words) for finding in findings
                if 'action ~/follow_joint_trajectory' not in finding.words], robot
    return examine


@pytest.mark.parametrize(('mode', 'said'), [
    ('computed_torque', True), ('inverse_dynamics', False)])
def test_a_missing_control_msgs_is_named_where_the_action_could_be_served(
        tmp_path, monkeypatch, mode, said):
    monkeypatch.setitem(sys.modules, 'control_msgs.action', None)
    path = tmp_path / 'arm.yaml'
    path.write_text(f'/**: {{ros__parameters: {{mode: {mode}, arm_compensates: none}}}}')
    findings, _ = examine_configuration(path, URDF)
    lines = []
    for finding in findings:
        if 'follow_joint_trajectory' in finding.words:
            lines.append(finding.words)
    assert bool(lines) == said
    for line in lines:
        assert 'not served without control_msgs/FollowJointTrajectory' in line


def test_the_settings_of_a_mode_are_checked(examine):
    findings, _ = examine("""
        /**:
          ros__parameters:
            arm_compensates: none
            mode: cartesian_impedance
            cartesian: {frame: nowhere, axes: world}""")
    assert any(level == 'problem' and 'nowhere' in words for level, words in findings)
    findings, _ = examine("""
        /**:
          ros__parameters:
            arm_compensates: none
            modes: [joint_impedance]
            joint_impedance: {stiffness: [1.0, 2.0, 3.0]}""")
    assert any("'joint_impedance.stiffness': 3 entries" in words
               for _, words in findings)


def test_blocks_of_other_nodes_are_ignored(examine):
    findings, _ = examine("""
        controller_manager: {ros__parameters: {update_rate: 500}}
        plant_node: {ros__parameters: {urdf: no.urdf}}
        simulator: {ros__parameters: {urdf: no.urdf, supplement: no.yaml, rate: 500.0}}
        kane_dynamics: {ros__parameters: {mode: computed_torque, arm_compensates: none}}""")  # noqa: E501
    block = 'arm.yaml, /kane_dynamics'
    changed = 'parameters other than default: '
    changed += 'mode, arm_compensates'
    assert findings == [('fine', f'{block}: {FITS}'),
                        ('fine', f'{block}: node /kane_dynamics {LOADS}; {changed}')]
    with pytest.raises(InputError,
                       match='ros__parameters of /controller_manager; expected'):
        examine('controller_manager: {ros__parameters: {update_rate: 500, mode: x}}')
    with pytest.raises(InputError, match='no ros__parameters; expected'):
        examine('kane_dynamics: {mode: computed_torque}')


def test_each_arm_of_a_file_is_checked_separately(examine):
    findings, robot = examine("""
        /**: {ros__parameters: {joints: [joint2], arm_compensates: [none]}}
        left: {kane_dynamics: {ros__parameters: {mode: comptued_torque}}}
        /right/kane_dynamics: {ros__parameters: {limits: {effort: [5.0]}, prefix: right_}}
        /third/arm_feedforward: {ros__parameters: {mode: computed_torque, joints: []}}""",  # noqa: E501
                              namespace='right')
    (level, words), *others = findings
    assert level == 'problem'
    assert words.startswith(
        "arm.yaml, /left/kane_dynamics: parameter 'mode': 'comptued_torque'")
    assert [words.partition('; ')[0] for level, words in others if level == 'fine'] == [
        f'arm.yaml, /right/kane_dynamics: {FITS}',
        f'arm.yaml, /right/kane_dynamics: node /right/kane_dynamics {LOADS}',
        f'arm.yaml, /third/arm_feedforward: node /third/arm_feedforward {LOADS}']
    warning, = [words for level, words in others if level == 'warning']
    assert ('takes effect only for a node of this name (-r __node:=arm_feedforward)'
            in warning)
    assert robot.joint_names == ('right_joint2',)


def test_the_robot_is_that_of_the_file(examine):
    findings, robot = examine("""
        /**: {ros__parameters: {tip: link1, limits: {effort: [9.0]}, gravity: [0, 0, -9.8],
              arm_compensates: [none],
              payload: {frame: link1, mass: 2.0, com: [0.5, 0, 0]}}}""", prefix='left_')  # noqa: E501
    assert [words.partition('; ')[0] for _, words in findings] == [
        f'arm.yaml: {FITS}', f'arm.yaml: every node {LOADS}']
    assert robot.joint_names == ('left_joint1',)
    bare = load_urdf(URDF, tip='link1', gravity=(0, 0, -9.8))
    np.testing.assert_allclose(robot.gravity_force([0.0]),
                               Robot(bare).gravity_force([0.0]) + 2.0 * 9.8 * 0.5,
                               rtol=1e-12)


def test_all_problems_are_reported_at_once(examine):
    findings, _ = examine("""
        /**: {ros__parameters: {urdf: /no/such.urdf, supplement: /no/such.yaml, gains: {kp: [1.0]},
              arm_compensates: none,
              limits: {effort: [1.0, 2.0, 3.0]}, payload: {mass: 2.0}, wrench: {frames: [claw]},
              observer: {enabled: true, threshold: [1.0]}, cartesian: {frame: paw}}}""")  # noqa: E501
    assert {level for level, _ in findings} == {'problem'}
    text = '\n'.join(words for _, words in findings)
    for words in (
            "'urdf': no file '/no/such.urdf'", "'supplement': no file '/no/such.yaml'",
            ("'gains.kp': a list of one, [1.0]; "
             'expected one number without brackets, or '),
            "'limits.effort': 3 entries", "'wrench.frames': claw; expected frames of ",
            "'cartesian.frame': paw", "'observer.threshold': a list of one, [1.0]",
            'payload: parameter payload.frame is empty; expected a frame'):
        assert words in text, text
    assert len(findings) == 8
    (_, words), = examine(
        '/**: {ros__parameters: {tip: nonsense, arm_compensates: none}}')[0]
    assert "tip: 'nonsense' is no link; expected one of" in words


def test_a_missing_statement_of_what_the_arm_adds_is_a_problem_and_names_the_table(
        examine):
    (level, words), *_ = examine('/**: {ros__parameters: {mode: computed_torque}}')[0]
    assert level == 'problem'
    assert "parameter 'arm_compensates': not stated; expected what the arm adds" in words
    path = resource_path('urdf', 'ur10e.urdf')
    findings, _ = examine(f'/**: {{ros__parameters: {{urdf: {path}}}}}')
    assert any(level == 'problem' and 'ur10e is known: gravity, friction for Universal'
               in words for level, words in findings)


def test_a_statement_that_contradicts_the_table_of_arms_gives_a_warning(examine):
    path = resource_path('urdf', 'fr3.urdf')
    text = '/**: {{ros__parameters: {{urdf: {}, arm_compensates: {}}}}}'
    (level, words), *_ = examine(text.format(path, 'none'))[0]
    assert level == 'warning'
    assert ('arm_compensates: none, where gravity would count twice; expected gravity'
            in words)
    findings, _ = examine(text.format(path, '[gravity, friction]'), prefix='left_')
    assert not any('where gravity' in words for _, words in findings)


def test_unused_parameters_are_not_checked(examine):
    findings, _ = examine("""
        /**: {ros__parameters: {observer: {threshold: [1.0]},
              arm_compensates: [none],
              estimator: {torque_deviation: [1.0]}, use_sim_time: true}}""")  # noqa: E501
    assert findings[0] == ('fine', f'arm.yaml: {FITS}')


def test_a_file_that_loads_another_arm_is_a_problem_and_says_which(examine):
    text = '/**: {ros__parameters: {urdf: "package://kane_dynamics/urdf/%s.urdf", %s}}'
    findings, _ = examine(text % ('ur10e', 'arm_compensates: [gravity, friction]'))
    (level, words), (_, launch) = findings
    assert level == 'problem'
    assert "ur10e.urdf' is loaded, not the examined URDF" in words
    assert f"every node loads '{resource_path('urdf', 'ur10e.urdf')}'" in launch
    findings, _ = examine(text % ('two_link', 'arm_compensates: none'))
    assert {level for level, _ in findings} == {'fine'}


def test_problems_of_other_parameters_are_reported_beside_unknown_joints(examine):
    findings, robot = examine("""
        /**: {ros__parameters: {joints: [a, b, c], mode: fly, kp: 5.0, gains: {kd: -1.0},
              arm_compensates: none,
              payload: {frame: claw}, observer: {enabled: true},
              cartesian: {frame: paw}}}""")
    text = '\n'.join(words for _, words in findings)
    assert robot is None
    for words in ("joints: 'a' is no joint", "'mode': 'fly'", "'gains.kd': -1.0",
                  "'kp': unknown and ignored; expected 'gains.kp'",
                  "'payload.frame': claw",
                  "'cartesian.frame': paw", 'observer.threshold: empty'):
        assert words in text, text
    assert len(findings) == 7


def states(stamp=None, now=NOW, names=('joint2', 'joint1'), count=200, **arrays):
    """Return joint states received at 100 Hz, by default with age zero."""
    message = JointState(name=list(names),
                         **{'position': POSE[::-1], 'velocity': [0.0, 0.0],
                            'effort': weight()[::-1], **arrays})
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(
        now if stamp is None else stamp, NANO)
    return [ReceivedState(k * NANO // 100, now, message) for k in range(count)]


def weight():
    return arm().gravity_force(POSE).tolist()


def test_the_stated_kind_of_efforts_is_checked_at_rest():
    without = [0.001 * effort for effort in weight()[::-1]]
    efforts = Efforts('motor_torque', gravity=False)
    for stated, effort, level, words in (
            (efforts, without, 'fine',
             'efforts at rest fit motor torques without gravity'),
            (efforts, [0.0, 0.0], 'fine',
             'efforts at rest fit motor torques without gravity'),
            (efforts, weight()[::-1], 'problem', 'do they contain gravity'),
            (Efforts(), without, 'problem', 'do they lack gravity'),
            (Efforts(), weight()[::-1], 'fine',
             'efforts at rest fit motor torques with gravity')):
        findings = examine_states(arm(), states(effort=effort), 1.0, stated)
        assert any(finding.level == level and words in finding.words
                   for finding in findings), findings


def test_the_kind_of_efforts_is_that_of_the_file(tmp_path):
    path = tmp_path / 'arm.yaml'
    path.write_text(
        'left: {kane_dynamics: {ros__parameters: {efforts: {gravity: false}}}}\n'
        'right: {kane_dynamics: {ros__parameters: {mode: computed_torque}}}')
    assert str(configured_efforts(path, 'left')) == 'motor torques without gravity'
    assert configured_efforts(path, 'right') is None


def test_efforts_in_another_unit_are_compared_with_their_scale(tmp_path):
    path = tmp_path / 'arm.yaml'
    path.write_text('/**: {ros__parameters: {efforts: {scale: [-2.0, 0.5]}}}')
    stated = configured_efforts(path)
    reported = (np.asarray(weight()) / [-2.0, 0.5])[::-1].tolist()
    for efforts, level in ((stated, 'fine'), (Efforts(), 'problem')):
        findings = examine_states(arm(), states(effort=reported), 1.0, efforts)
        assert any(finding.level == level and 'efforts at rest' in finding.words
                   for finding in findings), findings


def findings(*messages):
    """Return the levels and the texts of the findings."""
    results = examine_states(arm(), [*messages], 1.0)
    return [finding.level
            for finding in results], '\n'.join(finding.words for finding in results)


def test_valid_states_give_no_problem():
    levels, words = findings(*states())
    assert levels == ['fine', 'fine']
    assert '100 joint states/s with all joints' in words
    assert 'hold 100% of the weight' in words


def test_stamps_are_compared_with_the_clock_of_the_node():
    levels, words = findings(*states(stamp=NOW - NANO // 5))
    assert 'problem' in levels
    assert '0.2 s old on arrival' in words
    # Without a message on /clock there is no age.
    assert 'old on arrival' not in findings(*states(now=0,
                                                    stamp=NOW), *states(count=9))[1]
    assert '/clock: a publisher but no message' in findings(*states(now=0, stamp=5))[1]


def test_an_infinite_velocity_is_a_problem():
    levels, words = findings(*states(velocity=[math.inf, 1.0]))
    assert 'problem' in levels and 'velocities of joint2: not finite; expected' in words


def test_zero_stamps_give_a_warning():
    levels, words = findings(*states(stamp=0))
    assert 'problem' not in levels
    assert 'stamps of joint states: zero' in words


@pytest.mark.parametrize(('what', 'level'), [
    ('position', 'problem'), ('velocity', 'warning'), ('effort', 'warning')])
def test_non_finite_numbers_are_reported_as_such(what, level):
    name = {'position': 'positions', 'velocity': 'velocities', 'effort': 'efforts'}[what]
    levels, words = findings(*states(**{what: [math.nan, 1.0]}))
    assert f'{name} of joint2: not finite;' in words
    assert level in levels
    for wrong in ('nan', 'limits', 'gravity', 'weight'):
        assert wrong not in words


def test_zero_efforts_under_gravity_give_a_warning():
    levels, words = findings(*states(effort=[0.0, 0.0]))
    assert 'warning' in levels
    assert 'observer.torque: command' in words
    assert 'efforts.gravity: false if they lack gravity' in words
    upright = states(effort=[0.0, 0.0], position=[0.0, math.pi / 2])  # no gravity torque
    assert findings(*upright)[0] == ['fine']


def test_states_of_other_joints_are_ignored():
    finger = states(names=['finger', 'thumb'])
    assert findings(*finger, *states())[0] == ['fine', 'fine']
    words = 'joint1, joint2 missing among finger, thumb; expected all joints'
    assert words in findings(*finger)[1]
