"""Doctor finds lengths in millimeters, masses in grams, angles in degrees, gravity upwards."""

from dataclasses import replace
import warnings

from kane_dynamics import load_urdf
from kane_dynamics._util.resources import resource_path
from kane_dynamics.analysis.model_checks import examine_units
from kane_dynamics.cli import main
import pytest
from urdf_writer import joint, link, load_with_warnings, robot

ARM = load_urdf(resource_path('urdf', 'ur10e.urdf'))


def changed(model, length=1.0, com=1.0, mass=1.0, inertia=1.0):
    """Return a model with other units."""
    bodies = [replace(body, joint=replace(body.joint, translation=length * body.joint.translation),
                      inertial=type(body.inertial)(mass * body.inertial.mass,
                                                   com * body.inertial.com,
                                                   inertia * body.inertial.inertia))
              for body in model.bodies]
    return replace(model, bodies=tuple(bodies))


@pytest.mark.parametrize(('units', 'words'), [
    ({'length': 1e3, 'com': 1e3}, 'are these millimeters'), ({'mass': 1e3}, 'are these grams'),
    ({'com': 1e3}, 'centers of mass farther away than all links'),
    ({'inertia': 1e6}, 'expected inertias in kg m'),
    ({'mass': 1e3, 'inertia': 1e9}, 'are these grams')])
def test_other_units_are_a_problem(units, words):
    found = examine_units(changed(ARM, **units))
    assert any(words in finding.words and finding.level == 'problem' for finding in found)


@pytest.mark.parametrize('name', ['ur10e', 'fr3', 'two_link', 'two_rods', 'human_hand',
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
