"""Constraints from YAML: the same as from Python, and every slip told by name."""

from kane_dynamics import (Closure, ConstraintError, Coupling, knife_edge,
                           load_constraints, ModelBuilder, PointVelocity, Robot, rod,
                           Rolling)
import numpy as np
from palletizer import CONSTRAINTS, DRIVEN, palletizer
import pytest

WHOLE = """
constraints:
  pin: {closure: {first: end, second: ground, kind: revolute, axis: [0, 2, 0]}}
  gear: {coupling: {joint: wrist, ratios: {elbow: -1.5}, offset: 0.1}}
  blade: {knife_edge: {frame: skate, direction: [0, 1, 0]}}
  wheel: {rolling: {frame: hub, radius: 0.1, axis: [0, 1, 0], height: 0.2}}
  drift: {point_velocity: {frame: tool, direction: [1, 0, 0], axes: tool,
                           relative_to: base, value: 0.5, angular: true}}
  rod: {closure: {first: a, second: b, kind: distance, length: 0.5}}
  cross: {closure: {first: a, second: b, kind: universal, axis: [1, 0, 0],
                    second_axis: [0, 1, 0]}}
  gear_rim: {rolling: {frame: planet, radius: 0.1, axis: [0, 0, 1], surface: cylinder,
                       surface_frame: ring, surface_radius: 0.3, inside: true}}
independent: [crank]
"""
PYTHON = (Closure('end', 'ground', 'revolute', (0, 1, 0), 'pin'),
          Coupling('wrist', {'elbow': -1.5}, 0.1, 'gear'),
          knife_edge('skate', (0, 1, 0), 'blade'),
          Rolling('hub', 0.1, (0, 1, 0), height=0.2, name='wheel'),
          PointVelocity('tool', (1, 0, 0), 'tool', 'base', 0.5, True, 'drift'),
          Closure('a', 'b', 'distance', name='rod', length=0.5),
          Closure('a', 'b', 'universal', (1, 0, 0), 'cross', (0, 1, 0)),
          Rolling('planet', 0.1, (0, 0, 1), name='gear_rim', surface_frame='ring',
                  surface='cylinder', surface_radius=0.3, inside=True))


def plain(constraint):
    return type(constraint), {name: value.tolist() if isinstance(value, np.ndarray)
                              else value for name, value in vars(constraint).items()}


def test_a_file_says_what_python_says(tmp_path):
    path = tmp_path / 'all.yaml'
    path.write_text(WHOLE)
    loaded = load_constraints(path)
    assert loaded['independent'] == ('crank',)
    assert list(map(plain, loaded['constraints'])) == list(map(plain, PYTHON))


def test_a_prefix_goes_before_every_joint_and_frame_but_not_before_forces(tmp_path):
    path = tmp_path / 'all.yaml'
    path.write_text(WHOLE)
    loaded = load_constraints(path, prefix='left_')
    assert loaded['independent'] == ('left_crank',)
    pin, gear, blade, wheel, drift, *_, rim = loaded['constraints']
    assert (rim.frame, rim.surface_frame) == ('left_planet', 'left_ring')
    assert (pin.first, pin.second, pin.labels[0]) == ('left_end', 'left_ground', 'pin/x')
    assert (gear.joint, dict(gear.ratios)) == ('left_wrist', {'left_elbow': -1.5})
    assert (blade.frame, blade.axes, wheel.frame) == ('left_skate', 'left_skate',
                                                      'left_hub')
    assert (drift.frame, drift.axes, drift.relative_to) == ('left_tool', 'left_tool',
                                                            'left_base')


def test_constraints_of_a_mapping_act_on_the_robot():
    b = ModelBuilder('pair')
    b.body('one', 'world', 'revolute', axis=(0, 1, 0),
           inertial=rod(1.0, (0, 0, 0), (1, 0, 0)))
    b.body('two', 'one', 'revolute', axis=(0, 1, 0), at=(1, 0, 0),
           inertial=rod(1.0, (0, 0, 0), (1, 0, 0)))
    mapping = {
        'constraints': {'gear': {'coupling': {'joint': 'two', 'ratios': {'one': -2}}}}}
    robot = Robot(b.model(), **load_constraints(mapping))
    assert robot.constraint_names == ('gear',)
    np.testing.assert_allclose(robot.joint_rates([0.1, -0.2], [1.0])[1]
                               / robot.joint_rates([0.1, -0.2], [1.0])[0], -2.0,
                               rtol=1e-14)


@pytest.mark.parametrize(('text', 'words'), [
    ('constraints: {}', "slip.yaml': no constraint; expected at least one"),
    ('', "slip.yaml': an empty file; expected a YAML mapping"),
    ('[pin]', "slip.yaml': ['pin']; expected a mapping"),
    ('constraints: [pin]', "slip.yaml': constraints: ['pin']; expected a mapping"),
    ('loops: {}', "unknown key 'loops'; expected one of constraints, independent"),
    ('constraints: {pin: {weld: {}}}',
     "constraint 'pin': unknown key 'weld'; expected one of closure"),
    ('constraints: {pin: {}}', "constraint 'pin': []; expected one of closure"),
    ('constraints: {pin: {closure: {first: a}}}', 'closure without second'),
    ('constraints: {pin: {closure: {first: a, second: 3}}}',
     'second: 3; expected a name'),
    ('constraints: {pin: {closure: {first: a, second: b, kind: glued}}}',
     "kind: 'glued'"),
    ('constraints: {pin: {closure: {first: a, second: b, kind: [weld]}}}',
     "kind: ['weld']; expected one of weld"),
    ('constraints: {pin: {closure: {first: a, second: b, axis: [0, 0]}}}', 'axis'),
    ('constraints: {g: {coupling: {joint: a, ratios: {b: true}}}}',
     "ratio of 'b': True"),
    ('constraints: {w: {rolling: {frame: a, radius: -1.0}}}', 'radius: -1.0'),
    ('constraints: {w: {rolling: {frame: a, radius: wide}}}',
     "radius: 'wide'; expected a num"),
    ('constraints: {d: {point_velocity: {frame: a, direction: [1, 0, 0], angular: 1}}}',
     'angular: 1; expected true or false'),
    ('{constraints: {d: {coupling: {joint: a, ratios: {b: 1}}}}, independent: a}',
     "independent: 'a'; expected a list"),
    ('constraints: {d: {}, d: {}}', 'given more than once: d'),
    ('constraints: [', 'not valid YAML')])
def test_an_invalid_entry_of_a_constraint_file_is_named(tmp_path, text, words):
    path = tmp_path / 'slip.yaml'
    path.write_text(text)
    with pytest.raises(ConstraintError) as caught:
        load_constraints(path)
    assert words in str(caught.value)


def test_frames_of_a_closure_are_names():
    with pytest.raises(ConstraintError, match=r"second: \['b'\]; expected the name"):
        Closure('a', ['b'])


def test_a_file_that_is_not_there_is_named():
    with pytest.raises(ConstraintError, match=r'nowhere\.yaml'):
        load_constraints('/nowhere.yaml')


def test_a_file_names_actuators_and_the_assembly_mode():
    robot = palletizer()
    assert [robot.joint_names[k] for k in robot.equations.actuated] == sorted(
        DRIVEN, key=robot.joint_names.index)
    np.testing.assert_array_equal(robot.configuration, np.zeros(robot.n_q))
    loaded = load_constraints({**CONSTRAINTS, 'actuated': {'swivel': 2},
                               'configuration': {'shoulder': 0.1}}, prefix='left_')
    assert loaded['actuated'] == {'left_swivel': 2.0}
    assert loaded['configuration'] == {'left_shoulder': 0.1}
    with pytest.raises(ConstraintError,
                       match=r"configuration: joint 'left_shoulder'; expected"):
        Robot(robot.model, constraints=robot.mechanism.constraints,
              configuration=loaded['configuration'])
    for key, value in (('actuated', 'swivel'), ('configuration', {'shoulder': 'up'})):
        with pytest.raises(ConstraintError, match=rf'constraints file: {key}'):
            load_constraints({**CONSTRAINTS, key: value})
