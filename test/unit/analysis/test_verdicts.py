"""Doctor says fine only of what it could judge."""

import json
from pathlib import Path

from kane_dynamics import Robot
from kane_dynamics.analysis.model_checks import examine_model
from kane_dynamics.cli.parser import main
from kane_dynamics.urdf.link_shapes import load_collisions
import pytest
from urdf_writer import joint, link, load_with_warnings, robot

URDF = Path(__file__).resolve().parents[3] / 'urdf'
LENGTH, RADIUS = 0.3, 0.04
VOLUME = 3.141592653589793 * RADIUS**2 * LENGTH


def arm(mass=3.0, efforts=(30.0, 20.0, 10.0), shapes=True):
    """Return an arm of cylinders in a row, with these effort limits."""
    parts = [link('base')]
    shape = (f'<collision><origin xyz="{0.5 * LENGTH} 0 0" rpy="0 1.5708 0"/><geometry>'
             f'<cylinder radius="{RADIUS}" length="{LENGTH}"/></geometry></collision>')
    for k, effort in enumerate(efforts):
        text = link(f'l{k}', mass, [mass * 0.008] * 3, xyz=f'{0.5 * LENGTH} 0 0')
        if shapes:
            text = text.replace('</link>', f'{shape}</link>')
        parent = f'l{k - 1}' if k else 'base'
        stated = '' if effort is None else f'effort="{effort}"'
        limit = f'<limit lower="-2" upper="2" velocity="2" {stated}/>'
        parts += [text, joint(f'j{k}', parent, f'l{k}', axis='0 1 0',
                              xyz=f'{LENGTH if k else 0} 0 0', limit=limit)]
    return robot(*parts)


def verdict(source, words):
    """Return the levels of the findings with these words."""
    model, texts = load_with_warnings(source)
    findings = examine_model(model, Robot(model), texts, shapes=load_collisions(source))
    return [finding.level for finding in findings if words in finding.words]


HOLDS = 'hold'  # in 'the efforts hold the arm' and 'whether the motors hold the arm'


@pytest.mark.parametrize(('efforts', 'level'), [
    ((30.0, 20.0, 10.0), 'fine'), ((30.0, None, 10.0), 'cannot judge'),
    ((0.0, 0.0, 0.0), 'cannot judge'), ((1000.0, 20.0, 10.0), 'cannot judge'),
    ((90.0,) * 4 + (80.0,), 'fine'), ((90.0,) * 5, 'cannot judge'),
    ((30.0, 1.0, 10.0), 'problem')])
def test_the_motors_hold_the_arm_only_by_limits_that_someone_chose(efforts, level):
    mass = 0.6  # so that five links weigh less than the efforts
    if level == 'problem':
        mass = 3.0
    assert verdict(arm(mass, efforts), HOLDS) == [level]


@pytest.mark.parametrize(('factor', 'words', 'level'), [
    (1.0, 'masses fit', 'fine'), (6.0, 'masses over the volumes', 'warning'),
    (1e-3, 'masses over the volumes', 'warning'), (1e-3, '% of the effort', 'warning')])
def test_masses_in_another_unit_are_not_fine(factor, words, level):
    mass = factor * 1500.0 * VOLUME
    assert verdict(arm(mass, (120.0, 90.0, 50.0)), words) == [level]
    if factor < 1.0:
        assert verdict(arm(mass, (120.0, 90.0, 50.0)), HOLDS) == []


def test_masses_of_links_without_shapes_cannot_be_judged():
    assert verdict(arm(shapes=False), 'masses by the volumes') == ['cannot judge']


@pytest.mark.parametrize('name', ['fr3', 'ur10e'])
def test_shipped_arms_are_fine(name):
    model, texts = load_with_warnings(URDF / f'{name}.urdf')
    shapes = load_collisions(URDF / f'{name}.urdf')
    levels = {finding.level for finding in examine_model(model, Robot(model), texts,
                                                         shapes=shapes)}
    assert levels <= {'warning', 'fine'}


def test_all_faults_of_a_file_are_problems_also_as_json(tmp_path, capsys):
    source = arm().replace('mass value="3.0"', 'mass value="-3"', 1).replace(
        'velocity="2"', 'velocity="-2"', 1)
    path = tmp_path / 'arm.urdf'
    path.write_text(source)
    assert main(['doctor', '--json', str(path)]) == 1
    findings = json.loads(capsys.readouterr().out)
    assert [f['level'] for f in findings] == ['problem', 'problem', 'cannot judge']
    assert main(['doctor', str(path)]) == 1
    assert '2 problems, 0 warnings, 1 cannot judge, 0 fine' in capsys.readouterr().out
