"""
Names and order of arguments are those of the method, in every way to call a quantity.

For `derivative`, `vjp`, `jvp`, workspaces, CasADi, PyTorch, JAX and exported C.
"""

from functools import cache
from importlib.util import find_spec
import inspect
import re

from kane_dynamics import Robot
from kane_dynamics.robot.frameworks.batch_function import batch_function
from kane_dynamics.robot.kernel_set import FRAME_QUANTITIES
from kinds_of_mechanism import case
import numpy as np
import pytest

# Mechanisms with as many speeds as coordinates, where a wrong order would have the right
# shapes, and others.
KINDS = (('tree',), ('chosen speeds', 'time-dependent'), ('closed loop',))
IDENTITIES = ('joint_rates', 'joint_accelerations', 'joint_torques')


def names_of(robot):
    """Return the names of all quantities of a robot that one kernel computes."""
    return [*robot.kernels.names, *(name for name in IDENTITIES
                                    if name not in robot.kernels.names)]


def positional(name, robot):
    """Return the names of a method's arguments before the wrench and the time."""
    parameters = inspect.signature(getattr(Robot, name)).parameters
    names = []
    for key, parameter in parameters.items():
        if parameter.kind is not parameter.KEYWORD_ONLY and key not in ('self', 'frame',
                                                                        'joint'):
            names.append(key)
    if name == 'friction_force' and 'q' not in robot.kernels.arguments(name):
        names.remove('q')  # ignored where friction does not depend on it
    return tuple(names)


def state_of(one):
    """Return different values of every argument, by name."""
    rng = np.random.default_rng(5)
    robot = one.robot
    return {'q': one.q, 'u': one.u, 'udot': one.udot, 'tau': rng.normal(size=robot.n)}


@cache
def with_a_robot(kinds):
    """Return a case, whose robot has wrench frames and a payload frame."""
    return case(*kinds)


@pytest.mark.parametrize('kinds', KINDS, ids=' and '.join)
def test_quantities_take_the_arguments_of_their_methods(kinds):
    robot = with_a_robot(kinds).robot
    for name in (*names_of(robot), *FRAME_QUANTITIES, 'joint_reaction'):
        method = {'partial_velocities': 'jacobian',
                  'partial_velocity_rates': 'jacobian_rate'}.get(
                      name, name)
        assert robot.kernels.arguments(name) == positional(method, robot), name


@pytest.mark.parametrize('kinds', KINDS, ids=' and '.join)
def test_derivatives_differentiate_the_method_by_its_arguments(kinds):
    """By all of its inputs, the time and others without axes included."""
    one = with_a_robot(kinds)
    robot = one.robot
    state = state_of(one) | {'t': np.array(one.time)}
    rng = np.random.default_rng(7)
    for name in ('joint_torques', 'kinetic_energy'):  # a vector and a number
        method = positional(name, robot)
        arguments = [state[key] for key in method]
        by = (*method, 't') if one.t else method
        # Beside q the loop is open, where the method has no value.
        if robot.constraint_names:
            by = tuple(key for key in by if key != 'q')
        directions = {key: rng.normal(size=np.shape(state[key])) for key in by}

        def value(h, name=name, method=method, directions=directions):
            moved = {key: state[key] + h * directions.get(key, 0.0) for key in state}
            at = {'t': moved['t']} if one.t else {}
            return np.asarray(
                getattr(robot, name)(*(moved[key] for key in method), **at))
        # The reference: central differences of the method along all directions at once.
        expected = (value(1e-6) - value(-1e-6)) / 2e-6
        slopes = robot.derivative(name, *arguments, by=by, **one.t)
        along = np.zeros(expected.shape)
        for key, slope in zip(by, slopes):
            # Axes of the input come last in the derivative; a number has none.
            along = along + np.tensordot(slope, directions[key],
                                         np.ndim(directions[key]))
        np.testing.assert_allclose(along, expected, atol=1e-7)
        np.testing.assert_allclose(robot.jvp(name, directions, *arguments, **one.t),
                                   along, atol=1e-11)
        weight = rng.normal(size=expected.shape)
        gradients = robot.vjp(name, weight, *arguments, by=by, **one.t)
        for gradient, key in zip(gradients, by):
            assert np.shape(gradient) == np.shape(state[key])
        total = sum(np.sum(gradient * directions[key])
                    for key, gradient in zip(by, gradients))
        assert total == pytest.approx(np.sum(weight * along), abs=1e-10)


@pytest.mark.parametrize('kinds', KINDS, ids=' and '.join)
def test_functions_of_frameworks_take_the_arguments_of_the_method(kinds):
    robot = with_a_robot(kinds).robot
    expected_ends = {'', 'wrench', 't', 'wrench t', 'gravity', 'wrench gravity',
                     't gravity', 'wrench t gravity'}
    for name in names_of(robot):
        known = robot.kernels.differentiable(name)
        parameters = ('gravity',) if 'gravity' in known else ()
        function = batch_function(robot, name, '', parameters)  # of PyTorch and JAX
        names = [argument.name for argument in function.arguments]
        method = list(positional(name, robot))
        assert names[:len(method)] == method, name
        assert ' '.join(names[len(method):]) in expected_ends, name


@pytest.mark.skipif(find_spec('casadi') is None, reason='CasADi is not installed')
@pytest.mark.parametrize('kinds', KINDS, ids=' and '.join)
def test_casadi_functions_take_the_arguments_of_the_method(kinds):
    one = with_a_robot(kinds)
    robot = one.robot
    state = state_of(one)
    for name in ('joint_torques', 'friction_force', 'joint_rates',
                 'joint_accelerations'):
        function = robot.casadi(name)
        method = list(positional(name, robot))
        assert function.name_in()[:len(method)] == method
        arguments = [state[key] for key in method]
        value = function(*arguments, *one.t.values())
        np.testing.assert_allclose(value.full().ravel(),
                                   getattr(robot, name)(*arguments, **one.t), atol=1e-12)


@pytest.mark.parametrize('kinds', KINDS, ids=' and '.join)
def test_exported_functions_take_the_arguments_of_the_method(kinds, tmp_path):
    robot = with_a_robot(kinds).robot
    names = [name for name in robot.kernels.names if name in (
        'inverse_dynamics', 'forward_dynamics', 'joint_torques', 'friction_force',
        'joint_rates', 'kinetic_energy')]
    _, header = robot.export_c(tmp_path / 'out.c', names, self_test=False)
    text = header.read_text(encoding='utf-8')
    for name in names:
        prototype = re.search(rf'out_{name}\(([^)]*)\)', text)[1]
        exported = re.findall(r'\*(\w+)', prototype)
        method = list(positional(name, robot))
        assert exported[:len(method)] == method, prototype


@pytest.mark.parametrize('kinds', KINDS, ids=' and '.join)
def test_workspaces_give_what_the_methods_give(kinds):
    one = with_a_robot(kinds)
    robot = one.robot
    state = state_of(one)
    workspace = robot.bind()
    for name, value in state.items():
        getattr(workspace, name)[:] = value
    if one.t:
        workspace.t[...] = one.time
    for name in ('joint_torques', 'friction_force', *IDENTITIES):
        arguments = [state[key] for key in positional(name, robot)]
        np.testing.assert_array_equal(getattr(workspace, name)(),
                                      getattr(robot, name)(*arguments, **one.t))
