"""Arguments that a public call does not take are answered with those that it takes."""

import inspect

from kane_dynamics import (Inertial, InputError, load_urdf, ModelBuilder, ModelError,
                           Robot, rod)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.identification import read_recording
import numpy as np
from public_surface import public_classes, public_functions, public_methods
import pytest

ROBOT = Robot(load_urdf(resource_path('urdf', 'two_link.urdf')))
METHODS = {f'Robot.{name}': getattr(ROBOT, name) for name in public_methods(Robot)}
CALLS = public_functions() | public_classes() | METHODS
SIGNATURES = {}
for NAME, CALL in CALLS.items():
    OWNER = Robot if NAME in METHODS else None
    STATED = getattr(Robot, NAME.removeprefix('Robot.')) if OWNER else CALL
    PARAMETERS = list(inspect.signature(STATED).parameters.values())
    SIGNATURES[NAME] = PARAMETERS[1:] if OWNER else PARAMETERS
OTHERS = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)


@pytest.mark.parametrize('name', CALLS)
def test_arguments_that_a_public_call_does_not_take_are_answered_with_those_it_takes(
        name):
    call = CALLS[name]
    short = name if name.startswith('Robot.') else name.rpartition('.')[2]
    parameters = SIGNATURES[name]
    kinds = {parameter.kind for parameter in parameters}
    if inspect.Parameter.VAR_KEYWORD not in kinds:
        with pytest.raises(TypeError, match=rf"^{short}.*'nonsense_'; expected "):
            call(nonsense_=1)
    if inspect.Parameter.VAR_POSITIONAL not in kinds:
        with pytest.raises(TypeError, match=rf'^{short}\(.*; expected {short}\('):
            call(*[None] * 60)
    if any(parameter.default is inspect.Parameter.empty and parameter.kind not in OTHERS
           for parameter in parameters):
        with pytest.raises(TypeError,
                           match=rf'^{short}\(.*missing.*; expected {short}\('):
            call()


def test_keywords_of_other_libraries_are_answered_with_ours():
    q = np.zeros(2)
    for call, expected in (
            (lambda: ROBOT.frame_pose(link='link2', q=q), 'frame='),
            (lambda: ROBOT.mass_matrix(qpos=q), 'q='),
            (lambda: Inertial(m=1.0), 'mass='),
            (lambda: ROBOT.forward_dynamics(q, q, torque=q), 'tau=')):
        with pytest.raises(TypeError, match=rf'; expected {expected}$'):
            call()
    with pytest.raises(ModelError, match=r"no property 'mass'; expected inertial$"):
        ModelBuilder().body('a', axis=(0, 0, 1), mass=3)


def test_a_type_error_of_the_body_is_the_one_that_is_raised():
    with pytest.raises(TypeError, match=r'^unhashable type') as raised:
        ROBOT.compiled(lambda q: {}[[]], name='fails', shape=(), q=(2,))
    assert raised.value.__traceback__ is not None


def test_a_rod_between_equal_points_is_no_rod():
    with pytest.raises(ModelError, match=r'rod: both ends at .*; expected two points'):
        rod(1.0, (0.1, 0, 0), (0.1, 0, 0))


@pytest.mark.parametrize(('separator', 'words'), [(';', 'semicolons'), ('\t', 'tabs')])
def test_tables_without_commas_are_named(tmp_path, separator, words):
    path = tmp_path / 'run.csv'
    path.write_text('\n'.join(separator.join(line) for line in (
        ('t', 'q.joint1', 'q.joint2'), ('0,0', '0,1', '0,2'), ('0,1', '0,2', '0,3'))))
    with pytest.raises(InputError,
                       match=rf'columns separated by {words}; expected commas'):
        read_recording(path, ROBOT.joint_names)
