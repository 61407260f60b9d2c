"""What the doctor makes of parameter files and of the joint states that it hears."""

from functools import cache
import math
from pathlib import Path

from kane_dynamics import load_urdf, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.errors import InputError
from kane_dynamics.ros.common.conversion import NANO
from kane_dynamics.ros.doctor.configuration import examine_configuration
from kane_dynamics.ros.doctor.live_graph import examine_states, Heard
import numpy as np
import pytest
from sensor_msgs.msg import JointState

URDF = Path(resource_path('urdf', 'two_link.urdf')).read_text(encoding='utf-8')
FITS = 'every parameter is known and fits the arm'
POSE = [0.3, 0.5]
NOW = 1_000 * NANO


@cache
def arm():
    return Robot(load_urdf(URDF))


@pytest.fixture
def examine(tmp_path):
    """Return a function that examines a file of this text: what is found, and the robot."""
    def examine(text, **choices):
        path = tmp_path / 'arm.yaml'
        path.write_text(text)
        found, robot = examine_configuration(path, URDF, **choices)
        return [(each.level, each.words) for each in found], robot
    return examine


def test_blocks_of_other_nodes_are_passed_over(examine):
    found, _ = examine("""
        controller_manager: {ros__parameters: {update_rate: 500}}
        plant: {ros__parameters: {urdf: no.urdf}}
        simulator: {ros__parameters: {urdf: no.urdf, supplement: no.yaml, rate: 500.0}}
        kane_dynamics: {ros__parameters: {mode: computed_torque}}""")
    assert found == [('fine', f'arm.yaml, /kane_dynamics: {FITS}')]
    with pytest.raises(InputError, match='those of /controller_manager'):
        examine('controller_manager: {ros__parameters: {update_rate: 500, mode: x}}')
    with pytest.raises(InputError, match='no ros__parameters'):
        examine('kane_dynamics: {mode: computed_torque}')


def test_each_arm_of_a_file_is_examined_by_itself_and_named(examine):
    found, robot = examine("""
        /**: {ros__parameters: {joints: [joint2]}}
        left: {kane_dynamics: {ros__parameters: {mode: comptued_torque}}}
        /right/kane_dynamics: {ros__parameters: {limits: {effort: [5.0]}, prefix: right_}}
        /third/arm_feedforward: {ros__parameters: {mode: computed_torque, joints: []}}""",
                           namespace='right')
    (level, words), *others = found
    assert level == 'problem'
    assert words.startswith("arm.yaml, /left/kane_dynamics: parameter 'mode' is 'comptued_torque'")
    assert others == [('fine', f'arm.yaml, {name}: {FITS}')
                      for name in ('/right/kane_dynamics', '/third/arm_feedforward')]
    assert robot.joint_names == ('right_joint2',)


def test_the_robot_is_the_one_that_the_file_describes(examine):
    found, robot = examine("""
        /**: {ros__parameters: {tip: link1, limits: {effort: [9.0]}, gravity: [0, 0, -9.8],
              payload: {frame: link1, mass: 2.0, com: [0.5, 0, 0]}}}""", prefix='left_')
    assert found == [('fine', f'arm.yaml: {FITS}')]
    assert robot.joint_names == ('left_joint1',)
    bare = load_urdf(URDF, tip='link1', gravity=(0, 0, -9.8))
    np.testing.assert_allclose(robot.gravity_force([0.0]),
                               Robot(bare).gravity_force([0.0]) + 2.0 * 9.8 * 0.5, rtol=1e-12)


def test_all_that_does_not_fit_is_told_at_once(examine):
    found, _ = examine("""
        /**: {ros__parameters: {urdf: /no/such.urdf, supplement: /no/such.yaml, gains: {kp: [1.0]},
              limits: {effort: [1.0, 2.0, 3.0]}, payload: {mass: 2.0}, wrench: {frames: [claw]},
              observer: {enabled: true, threshold: [1.0], frame: paw},
              estimator: {enabled: true, torque_deviation: 1.0}}}""")
    assert {level for level, _ in found} == {'problem'}
    told = '\n'.join(words for _, words in found)
    for words in ("'urdf' is '/no/such.urdf': no file", "'supplement' is '/no/such.yaml': no file",
                  "'gains.kp' has 1 entries for 2 joints", "'limits.effort' has 3 entries",
                  "'wrench.frames' names claw; valid: ", "'observer.frame' names paw",
                  "'observer.threshold' has 1 entries", "'estimator.enabled' is true",
                  'carries no payload; set parameter payload.frame'):
        assert words in told, told
    assert len(found) == 9
    (_, words), = examine('/**: {ros__parameters: {tip: nonsense}}')[0]
    assert "tip is 'nonsense', and no such link exists" in words


def test_what_a_node_does_not_use_need_not_fit(examine):
    found, _ = examine("""
        /**: {ros__parameters: {observer: {threshold: [1.0], frame: paw}, imu: {frame: ear},
              estimator: {torque_deviation: [1.0]}, use_sim_time: true}}""")
    assert found == [('fine', f'arm.yaml: {FITS}')]


def heard(stamp=None, now=NOW, names=('joint2', 'joint1'), count=200, **arrays):
    """Return joint states that came at 100 Hz, by default with no age."""
    message = JointState(name=list(names), **{'position': POSE[::-1], 'velocity': [0.0, 0.0],
                                              'effort': weight()[::-1], **arrays})
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(
        now if stamp is None else stamp, NANO)
    return [Heard(k * NANO // 100, now, message) for k in range(count)]


def weight():
    return arm().gravity_force(POSE).tolist()


def told(*messages):
    """Return the levels of what is found, and the words."""
    found = examine_states(arm(), [*messages], 1.0)
    return [each.level for each in found], '\n'.join(each.words for each in found)


def test_sound_states_are_found_sound():
    levels, words = told(*heard())
    assert levels == ['fine', 'fine']
    assert '100 joint states a second' in words
    assert 'hold 100% of the weight' in words


def test_stamps_are_held_against_the_clock_of_the_node():
    levels, words = told(*heard(stamp=NOW - NANO // 5))
    assert 'problem' in levels
    assert '0.2 s old' in words
    # Before /clock has come there is no age.
    assert 'old when' not in told(*heard(now=0, stamp=NOW), *heard(count=9))[1]
    assert 'nothing came on it' in told(*heard(now=0, stamp=5))[1]


def test_stamps_of_zero_say_nothing_about_age():
    levels, words = told(*heard(stamp=0))
    assert 'problem' not in levels
    assert 'stamps of joint states are zero' in words


@pytest.mark.parametrize(('what', 'level'), [
    ('position', 'problem'), ('velocity', 'problem'), ('effort', 'doubt')])
def test_numbers_that_are_not_finite_are_called_that(what, level):
    name = {'position': 'positions', 'velocity': 'velocities', 'effort': 'efforts'}[what]
    levels, words = told(*heard(**{what: [math.nan, 1.0]}))
    assert f'{name} that are not finite: joint2;' in words
    assert level in levels
    for wrong in ('nan', 'limits', 'gravity', 'weight'):
        assert wrong not in words


def test_efforts_of_zero_under_weight_are_told():
    levels, words = told(*heard(effort=[0.0, 0.0]))
    assert 'doubt' in levels
    assert 'observer.torque: command' in words
    upright = heard(effort=[0.0, 0.0], position=[0.0, math.pi / 2])  # nothing to hold
    assert told(*upright)[0] == ['fine']


def test_states_of_other_joints_do_not_count():
    finger = heard(names=['finger', 'thumb'])
    assert told(*finger, *heard())[0] == ['fine', 'fine']
    assert 'joint1, joint2 missing; they name finger, thumb' in told(*finger)[1]
