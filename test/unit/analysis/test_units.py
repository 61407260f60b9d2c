"""Doctor finds lengths in mm, masses in g, angles in degrees, gravity upwards."""

from dataclasses import replace
import warnings

from kane_dynamics import load_urdf, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.analysis.model_checks import examine_model, examine_units
from kane_dynamics.cli import main
import numpy as np
import pytest
from urdf_writer import joint, link, load_with_warnings, robot

ARM = load_urdf(resource_path('urdf', 'ur10e.urdf'))


def changed(model, length=1.0, com=1.0, mass=1.0, inertia=1.0):
    """Return a model with other units."""
    bodies = []
    for body in model.bodies:
        bodies.append(replace(
            body, joint=replace(body.joint, translation=length * body.joint.translation),
            inertial=type(body.inertial)(mass * body.inertial.mass,
                                         com * body.inertial.com,
                                         inertia * body.inertial.inertia)))
    return replace(model, bodies=tuple(bodies))


@pytest.mark.parametrize(('units', 'words'), [
    ({'length': 1e3, 'com': 1e3}, 'are these millimeters'),
    ({'mass': 1e3}, 'are these grams'),
    ({'com': 1e3}, 'centers of mass farther away than all links'),
    ({'inertia': 1e6}, 'expected inertias in kg m'),
    ({'mass': 1e3, 'inertia': 1e9}, 'are these grams')])
def test_other_units_are_a_problem(units, words):
    findings = examine_units(changed(ARM, **units))
    assert any(words in finding.words and finding.level == 'problem'
               for finding in findings)


def test_the_radius_of_gyration_is_that_of_the_largest_moment():
    model = changed(ARM, inertia=1e6)
    body = model.bodies[1]
    smallest, _, largest = np.linalg.eigvalsh(body.inertial.inertia)
    assert smallest < 0.5 * largest
    radius = (largest / body.inertial.mass)**0.5
    finding, = examine_units(model)
    assert f'{body.name} ({radius:.4g} m)' in finding.words


@pytest.mark.parametrize('name',
                         ['ur10e', 'fr3', 'two_link', 'two_rods', 'human_hand',
                          'palletizer', 'spring_mass_pendulum', 'two_link_planar'])
def test_shipped_models_are_in_si_units(name):
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        assert not examine_units(load_urdf(resource_path('urdf', f'{name}.urdf')))


def test_gravity_upwards_is_a_warning():
    finding, = examine_units(replace(ARM, gravity=[0.0, 0.0, 9.81]))
    assert finding.level == 'warning' and 'points upwards' in finding.words


def test_origins_in_degrees_are_a_problem(tmp_path, capsys):
    text = robot(link('a'), link('b'), joint('j', 'a', 'b', rpy='0 90 0', xyz='0 0 0.3'))
    _, messages = load_with_warnings(text)
    message, = messages
    assert message.startswith('origins whose rpy') and "joint 'j' (0 90 0)" in message
    path = tmp_path / 'degrees.urdf'
    path.write_text(text)
    assert main(['doctor', str(path)]) == 1
    assert 'problem: URDF: origins whose rpy' in capsys.readouterr().out


@pytest.mark.parametrize(('bounds', 'level'), [
    ((170.0, 170.0, 90.0), 'problem'), ((170.0, 1.0, 1.0), 'warning')])
def test_limits_in_degrees_are_a_problem_where_most_joints_have_them(bounds, level):
    """A single joint may turn many times, as a winch does."""
    links = [link(name) for name in 'abcd']
    joints = []
    for k, x in enumerate(bounds):
        joints.append(
            joint(f'j{k}', 'abcd'[k], 'abcd'[k + 1], xyz='0 0 0.3',
                  limit=f'<limit lower="{-x}" upper="{x}" velocity="2" effort="99"/>'))
    model, messages = load_with_warnings(robot(*links, *joints))
    findings = []
    for f in examine_model(model, Robot(model), messages):
        if 'spans many turns' in f.words:
            findings.append(f)
    assert [f.level for f in findings] == [level]


def standing(*names):
    """Return a robot on a base, with two links in series for each name."""
    parts = [link('base')]
    for name in names:
        parts += [link(f'{name}_upper'), link(f'{name}_lower'),
                  joint(f'{name}_1', 'base', f'{name}_upper', axis='0 1 0'),
                  joint(f'{name}_2', f'{name}_upper', f'{name}_lower', axis='0 1 0',
                        xyz='0 0 -0.3')]
    return robot(*parts)


@pytest.mark.parametrize(('names', 'root_joint', 'warned'), [
    (('FL_hip', 'FR_hip'), 'fixed', True),
    (('left_wheel', 'right_wheel', 'arm'), 'fixed', True),
    (('FL_hip', 'FR_hip'), 'free', False), (('FL_hip', 'FR_hip'), 'planar', False),
    (('LHip', 'RHip'), 'fixed', True), (('LEFT_KNEE', 'RIGHT_KNEE'), 'fixed', True),
    (('left_arm', 'right_arm'), 'fixed', False), (('leg',), 'fixed', False),
    (('legato', 'ship'), 'fixed', False)])
def test_legs_or_wheels_on_a_fixed_base_are_a_warning(names, root_joint, warned):
    model = load_urdf(standing(*names), root_joint=root_joint)
    findings = []
    for f in examine_model(model, Robot(model), []):
        if 'legs or wheels' in f.words:
            findings.append(f)
    assert [f.level for f in findings] == ['warning'] * warned
    if warned:
        assert f'({names[0]}_1, {names[1]}_1)' in findings[0].words
        assert '--root-joint' in findings[0].words
