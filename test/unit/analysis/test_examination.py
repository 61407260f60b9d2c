"""Promises of what `doctor` says of a description: the weight motors can hold."""

from functools import cache
import math

from kane_dynamics import (Drive, Limits, ModelBuilder, point_mass, Robot, rod,
                           StiffnessCurve, with_drives)
from kane_dynamics.analysis.model_checks import examine_model, largest_gravity_forces
import numpy as np
import pytest

# N m: four rods of 1 kg and 0.5 m, held level.
STRETCHED = 9.81 * (0.25 + 0.75 + 1.25 + 1.75)


@cache
def arm(effort):
    """Return four rods in a vertical plane; the first motor is `effort` strong."""
    builder = ModelBuilder()
    at = (0, 0, 0)
    for k in range(4):
        builder.body(f'rod{k}', f'rod{k - 1}' if k else 'world', axis=(0, 1, 0), at=at,
                     inertial=rod(1.0, (0, 0, 0), (0.5, 0, 0)),
                     limits=Limits(-2.5, 2.5, 1.0, effort if k == 0 else 400.0))
        at = (0.5, 0, 0)
    return Robot(builder.model())


@pytest.mark.parametrize(('share', 'level'), [(0.9999, 'problem'), (1.0001, 'fine')])
def test_a_motor_that_fails_in_one_configuration_of_many_is_found(share, level):
    robot = arm(share * STRETCHED)
    findings = []
    for finding in examine_model(robot.model, robot, []):
        if 'hold' in finding.words:
            findings.append(finding)
    assert [finding.level for finding in findings] == [level]
    assert (level == 'fine'
            or "'rod0' (weight up to 39.24, effort 39.236)" in findings[0].words)


@pytest.mark.parametrize(('limits', 'slide', 'expected'), [
    (Limits(4.0, 5.4), Limits(0.0, 1.0), 9.81 * -math.cos(4.0)),  # beyond half a turn
    (Limits(), Limits(-0.5, 5.0), 9.81 * 5.0),  # metres are no radians
    (Limits(1.4, math.inf), Limits(-0.5, 0.5), 9.81 * 0.5),
    (Limits(), Limits(2.0, math.inf), 9.81 * 3.0)])
def test_configurations_are_tried_up_to_the_limits_and_not_beyond(
        limits, slide, expected):
    builder = ModelBuilder()
    builder.body('turn', axis=(0, 1, 0), limits=limits)
    builder.body('slide', 'turn', 'prismatic', axis=(1, 0, 0), inertial=point_mass(1.0),
                 limits=slide)
    largest = largest_gravity_forces(Robot(builder.model()))[0]
    np.testing.assert_allclose(largest, expected, rtol=1e-6)


@pytest.mark.parametrize('limits', [{'motor_effort': 30.0}, {'gear_effort': 30.0}])
def test_the_weight_of_elastic_joints_is_held_by_motors_and_gears(limits):
    b = ModelBuilder('arm')
    b.body('rod', joint='lift', axis=(0, 1, 0),
           inertial=rod(8.0, (0, 0, 0), (1.0, 0, 0)),
           limits=Limits(-1.0, 1.0, 2.0, 60.0))
    strong = {'motor_effort': 60.0, 'gear_effort': 60.0}
    for stated, level in ((strong, 'fine'), (strong | limits, 'problem')):
        model = with_drives(b.model(), {'lift': Drive(1e4, rotor_inertia=0.1, **stated)})
        findings = examine_model(model, Robot(model), [])
        about = [finding for finding in findings if 'hold' in finding.words]
        assert [finding.level for finding in about] == [level]
    assert "'lift' (weight up to 39.24, effort 30)" in about[0].words


@pytest.mark.parametrize(('link', 'motor', 'named'), [
    ({}, {}, True), ({'damping': 1.0}, {}, False), ({}, {'damping': 1.0}, False)])
def test_the_friction_of_an_elastic_joint_is_that_of_either_side(link, motor, named):
    b = ModelBuilder('arm')
    b.body('rod', joint='lift', axis=(0, 1, 0),
           inertial=rod(8.0, (0, 0, 0), (1.0, 0, 0)),
           drive=Drive(1e4, rotor_inertia=0.1, friction=motor), **link)
    findings = examine_model(b.model(), Robot(b.model()), [])
    about = []
    for finding in findings:
        if 'no friction is known' in finding.words:
            about.append(finding.words)
    assert len(about) == named
    assert not named or 'of lift:' in about[0]


def test_a_fully_coupled_rotor_is_known():
    b = ModelBuilder('arm')
    b.body('rod', joint='lift', axis=(0, 1, 0),
           inertial=rod(8.0, (0, 0, 0), (1.0, 0, 0)))
    model = with_drives(b.model(), {'lift': Drive(1e4, ratio=50.0, rotor_inertia=0.1,
                                                  full_coupling=True)})
    findings = examine_model(model, Robot(model), [])
    assert not any('rotor inertia' in finding.words for finding in findings)


def test_a_link_behind_the_gear_of_a_drive_is_not_asked_for_a_rotor():
    rigid = arm(100.0).model
    assert any('no rotor inertia' in finding.words
               for finding in examine_model(rigid, arm(100.0), []))
    elastic = with_drives(rigid, {name: Drive(1e4, rotor_inertia=0.1)
                                  for name in rigid.joint_names})
    assert not any('rotor inertia' in finding.words
                   for finding in examine_model(elastic, Robot(elastic), []))


@pytest.mark.parametrize(('stiffness', 'words'), [
    (2e4, None), (StiffnessCurve([1e-3, 4e-3], [0.0, 60.0]), None),
    (20.0, "'rod0' (20: gravity deflects it by "),
    (1e12, "'rod0' (1e+12: its link vibrates at ")])
def test_a_stiffness_that_no_gear_of_an_arm_has_is_named(stiffness, words):
    rigid = arm(100.0).model
    elastic = with_drives(rigid, {'rod0': Drive(stiffness, rotor_inertia=0.1)})
    texts = []
    for finding in examine_model(elastic, Robot(elastic), []):
        if finding.words.startswith('stiffness of the drives'):
            texts.append(finding.words)
    assert len(texts) == (words is not None)
    assert words is None or words in texts[0]
