"""The parameters of the nodes: valid and invalid values, and the shipped files."""

import math
from pathlib import Path
from types import SimpleNamespace

from kane_dynamics import load_urdf, Robot
from kane_dynamics.errors import InputError
from kane_dynamics.ros.common.configuration_files import resolve_path
from kane_dynamics.ros.parameters.parameter_checks import (declare, per_joint, read,
                                                           similar_parameter,
                                                           unknown_parameters)
from kane_dynamics.ros.parameters.parameter_table import BY_NAME, SPECS
from kane_dynamics.ros.plant import plant_parameters as plant_specs
from kane_dynamics.ros.torque_path.path_controller import rate_limit
import numpy as np
import pytest
from ros_lines import flat
import yaml

FOLDER = Path(__file__).parents[3] / 'config'
TABLES = {path: plant_specs.SPECS if path.stem == 'plant' else SPECS
          for path in sorted(FOLDER.glob('*.yaml'))}
FILES = pytest.mark.parametrize('path', TABLES, ids=lambda path: path.stem)


def parameters_of_file(path):
    section = '/**/plant_node' if path.stem == 'plant' else '/**'
    return dict(flat(yaml.safe_load(path.read_text())[section]['ros__parameters']))


@FILES
def test_a_shipped_file_sets_what_differs_from_the_defaults_to_valid_values(path):
    specs = {spec.name: spec for spec in TABLES[path]}
    values = {}
    for name, value in parameters_of_file(path).items():
        values[name] = read(specs[name], value)
        default = read(specs[name], specs[name].default)
        assert not np.array_equal(values[name], default), name
    assert len(values) <= 20
    model = load_urdf(resolve_path('urdf', values['urdf']),
                      joints=list(values['joints']))
    assert model.joint_names == values['joints']
    for name in values:
        if specs[name].kind == 'per_joint':
            assert per_joint(
                values, name, model.joint_names, math.inf).shape == (model.n,)


def test_the_descriptors_state_the_range_of_each_parameter():
    described = {}

    class Node:

        def declare_parameter(self, name, value, descriptor):
            described[name] = descriptor
            return SimpleNamespace(value=value)

        def set_descriptor(self, name, descriptor):
            described[name] = descriptor
    declare(Node(), SPECS)
    for spec in SPECS:
        text = described[spec.name].additional_constraints
        # Tools show a slider for a number with two bounds.
        sliders = [(bounds.from_value, bounds.to_value)
                   for bounds in described[spec.name].floating_point_range]
        bounded = spec.kind == 'number' and math.isfinite(spec.high - spec.low)
        assert sliders == [(spec.low, spec.high)] * bounded
        for bound, words in ((spec.low, 'at least'), (spec.high, 'at most')):
            if math.isfinite(bound) and spec.kind in ('number', 'count', 'per_joint',
                                                      'numbers'):
                assert f'{words} {bound:g}' in text or (spec.positive
                                                        and 'positive' in text), text
        assert all(choice in text for choice in spec.choices)


@pytest.mark.parametrize(('name', 'value'), [
    ('mode', 'fly'), ('mode', 3), ('state_timeout', 0), ('state_timeout', -0.1),
    ('state_timeout', math.nan), ('state_timeout', math.inf), ('state_timeout', True),
    ('state_timeout', '1'), ('state_timeout', None), ('autostart', 1), ('urdf', 5),
    ('gravity', [0.0, 0.0]), ('gravity', [0.0, 0.0, math.nan]), ('gravity', 9.81),
    ('gravity', [0.0, 0.0, 981.0]),
    ('gains.kp', -1.0), ('gains.kp', [1.0, -1.0]), ('gains.kp', math.inf),
    ('gains.kp', 'high'),
    ('limits.effort', 0.0), ('limits.effort', [math.nan]), ('joints', 'a'),
    ('joints', ['a', 'a']),
    ('joints', ['']), ('joints', [1]), ('realtime.priority', -1),
    ('realtime.priority', 1.5), ('realtime.priority', 10**9),
    ('modes', ['computed_torque']), ('modes', 'joint_impedance'),
    ('arm_compensates', 'weight'), ('arm_compensates', ['gravity', 'none']),
    ('arm_compensates', ['gravity', 'gravity']), ('arm_compensates', 3),
    ('arm_compensates', ''),
])
def test_an_invalid_value_is_refused_by_name(name, value):
    with pytest.raises(InputError, match=rf"parameter '{name}': .*; expected "):
        read(BY_NAME[name], value)


@pytest.mark.parametrize(('name', 'value', 'expected'), [
    ('state_timeout', 1, 1.0), ('gains.kp', 5, np.array(5.0)),
    ('limits.effort', [], np.zeros(0)),
    ('limits.rate', math.inf, np.array(math.inf)), ('joints', ['b', 'a'], ('b', 'a')),
    ('arm_compensates', [], ()), ('arm_compensates', 'none', ('none',)),
    ('arm_compensates', 'gravity, friction', ('gravity', 'friction')),
    ('arm_compensates', ['coriolis'], ('coriolis',)),
    ('joints', [], ()), ('gravity', [0, 0, -1], np.array([0.0, 0.0, -1.0])),
])
def test_integers_and_single_numbers_are_valid_for_numbers_and_lists(
        name, value, expected):
    result = read(BY_NAME[name], value)
    assert np.array_equal(result, expected)
    assert type(result) is type(expected)


def test_a_list_of_the_wrong_length_names_the_joints():
    with pytest.raises(InputError,
                       match=r'2 entries; expected .* the 3 joints \(a, b, c\)'):
        per_joint({'gains.kp': np.ones(2)}, 'gains.kp', ('a', 'b', 'c'), 0.0)


def test_an_unknown_parameter_gives_the_most_similar_name():
    known = ['state_timeout', 'use_sim_time', 'qos_overrides./clock.depth']
    assert unknown_parameters(known, BY_NAME) == []
    warning, = unknown_parameters(['gains.pk'], BY_NAME)
    assert warning == "parameter 'gains.pk': unknown and ignored; expected 'gains.kp'"


@pytest.mark.parametrize(('name', 'similar'), [
    ('kp', 'gains.kp'), ('effort_limit', 'limits.effort'),
    ('max_effort', 'limits.effort'),
    ('payload_mass', 'payload.mass'), ('joint_names', 'joints'), ('urdf_path', 'urdf'),
    ('gravity_compensation', 'arm_compensates'),
    ('robot_descripton', 'robot_description'),
    ('foo', ''), ('measured', ''), ('seed', '')])
def test_similar_parameters_have_the_same_words_or_a_similar_spelling(name, similar):
    assert similar_parameter(name, BY_NAME) == similar


@pytest.mark.parametrize(('limits', 'expected'), [
    ({}, [1200.0, 400.0]), ({'limits.effort': np.array([10.0, 100.0])}, [200.0, 400.0]),
    ({'limits.rate': np.array(50.0)}, [50.0, 50.0]),
    ({'limits.rate': np.array(np.inf)}, [np.inf, np.inf])])
def test_by_default_an_effort_takes_50_ms_from_zero_to_its_limit(limits, expected):
    values = {spec.name: read(spec, spec.default) for spec in SPECS}
    robot = Robot(
        load_urdf(resolve_path('urdf', 'package://kane_dynamics/urdf/two_link.urdf')))
    assert robot.limits.effort.tolist() == [60.0, 20.0]
    np.testing.assert_allclose(rate_limit(values | limits, robot), expected, rtol=1e-15)


def test_a_package_that_is_not_installed_is_named():
    with pytest.raises(InputError,
                       match=r"package 'no_such_package' .*is not installed"):
        resolve_path('urdf', 'package://no_such_package/a.urdf')
    with pytest.raises(InputError, match=r"no file 'nothing\.urdf' in urdf"):
        resolve_path('urdf', 'package://kane_dynamics/urdf/nothing.urdf')
    with pytest.raises(InputError,
                       match="parameter 'urdf': no file '/no/file'; expected"):
        resolve_path('urdf', '/no/file')
