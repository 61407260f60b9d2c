"""Promises of a bound workspace: the robot's numbers, refused where not finite."""

import copy
import gc
import pickle
import sys
import tracemalloc
import weakref

from kane_dynamics import InputError, Robot
from kane_dynamics.native.python_call import entry
from kane_dynamics.robot.kernel_set import FRAME_QUANTITIES, QUANTITIES
from kane_dynamics.robot.workspace import Workspace
from mechanisms import random_inertial, random_model, random_state
import numpy as np
import pytest

MODEL = random_model(3, 5)
STATE = random_state(MODEL, 0)


@pytest.fixture(params=['machine code', 'fallback'])
def robot(request, monkeypatch):
    """Return a robot with a payload and a wrench, for either code path."""
    if request.param == 'fallback':
        monkeypatch.setattr(entry, 'supported', lambda: False)
    return Robot(MODEL, wrench_frames=['frame4'], payload_frame='frame2')


def bound(robot):
    """Return a workspace at a state with a wrench."""
    workspace = robot.bind()
    workspace.q[:], workspace.u[:], workspace.udot[:] = STATE
    workspace.tau[:] = [1.0, -2.0, 3.0, 0.5, -0.5]
    workspace.wrench[:] = np.arange(6.0)
    return workspace


@pytest.mark.parametrize('name', QUANTITIES)
def test_every_quantity_is_the_robots_own(robot, name):
    workspace = bound(robot)
    arguments = {key: getattr(workspace, key).copy()
                 for key in ('q', 'u', 'udot', 'tau', 'wrench')}
    quantity = QUANTITIES[name]
    wrench = {'wrench': arguments['wrench']} if quantity.wrench else {}
    expected = getattr(robot, name)(*[arguments[a] for a in quantity.arguments],
                                    **wrench)
    result = getattr(workspace, name)()
    assert np.array_equal(result, expected)
    assert isinstance(result, float) == isinstance(expected, float)


@pytest.mark.parametrize('name', FRAME_QUANTITIES)
def test_every_quantity_of_a_frame_is_the_robots_own(robot, name):
    call = bound(robot).at_frame(name, 'frame4')
    other_names = {'partial_velocities': 'jacobian',
                   'partial_velocity_rates': 'jacobian_rate'}
    method = getattr(robot, other_names.get(name, name))
    expected = method('frame4', *STATE[:len(FRAME_QUANTITIES[name].arguments)])
    assert np.array_equal(call(), expected)
    assert call() is call()


def test_a_joints_reaction_is_the_robots_own(robot):
    workspace = bound(robot)
    call = workspace.reaction('joint2')
    assert np.array_equal(
        call(), robot.joint_reaction('joint2', *STATE, wrench=workspace.wrench))
    assert call is workspace.reaction('joint2')


def test_results_that_are_states_are_written_there(robot):
    workspace = bound(robot)
    assert workspace.inverse_dynamics() is workspace.tau
    workspace.udot[:] = 0.0
    assert workspace.forward_dynamics() is workspace.udot
    np.testing.assert_allclose(workspace.udot, STATE[2], rtol=1e-9)
    assert workspace.mass_matrix() is workspace.mass_matrix()


def test_parameters_are_read_as_they_are(robot):
    workspace = bound(robot)
    workspace.gravity_force()
    robot.parameters.gravity = (1.0, 2.0, 3.0)
    robot.parameters.payload = random_inertial(np.random.default_rng(0))
    assert np.array_equal(workspace.gravity_force(), robot.gravity_force(STATE[0]))


@pytest.mark.parametrize('value', [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize('name, place', [(name, place) for name in ('q', 'u', 'udot')
                                         for place in range(5)] + [('wrench', (0, 5))])
def test_no_number_comes_from_memory_that_is_not_finite(robot, value, name, place):
    workspace = bound(robot)
    workspace.inverse_dynamics()
    getattr(workspace, name)[place] = value
    with pytest.raises(InputError, match=rf'{name}\[.*: -?(nan|inf)'):
        workspace.inverse_dynamics()


def test_no_infinite_result_is_returned(robot):
    workspace = bound(robot)
    workspace.udot[:] = 1e308
    with pytest.raises(InputError, match='not finite'):
        workspace.inverse_dynamics()


def test_memory_stays_where_it_is(robot):
    workspace = bound(robot)
    for name in ('q', 'inverse_dynamics', 'nothing'):
        with pytest.raises(InputError,
                           match=rf'workspace.{name}: assigned; .*{name}\[:\]'):
            setattr(workspace, name, np.zeros(5))
    for array in (workspace.q, workspace.tau, workspace.mass_matrix()):
        with pytest.raises(ValueError, match='own'):
            array.resize(99, refcheck=False)


def test_arguments_and_unknown_names_are_refused(robot):
    workspace = bound(robot)
    with pytest.raises(InputError,
                       match=r'workspace: inverse_dynamics\(ndarray\); expected no'):
        workspace.inverse_dynamics(STATE[0])
    with pytest.raises((InputError, TypeError),
                       match=r'inverse_dynamics\(.*no .*arguments'):
        workspace.inverse_dynamics(q=STATE[0])
    with pytest.raises(AttributeError, match='torque'):
        _ = workspace.torque
    with pytest.raises(InputError, match="'pose'; expected one of frame_pose"):
        workspace.at_frame('pose', 'frame1')
    with pytest.raises(InputError, match=r"'nowhere'; expected one of .*frame0"):
        workspace.at_frame('frame_pose', 'nowhere')
    with pytest.raises(TypeError, match='bind'):
        copy.copy(workspace)
    assert {'q', 'wrench', 'inverse_dynamics', 'at_frame'} <= set(dir(workspace))


@pytest.mark.parametrize('name', [3, None, ['frame4']])
def test_a_name_that_is_no_text_is_refused(robot, name):
    workspace = robot.bind()
    kind = type(name).__name__
    for what, call in (('name', lambda: workspace.at_frame(name, 'frame4')),
                       ('frame', lambda: workspace.at_frame('frame_pose', name)),
                       ('joint', lambda: workspace.reaction(name))):
        with pytest.raises(InputError,
                           match=rf'^{what}: a {kind}; expected the name of a'):
            call()
    with pytest.raises(InputError,
                       match=r'^kernels: a Robot; expected .*robot\.bind\(\)'):
        Workspace(robot)


def test_two_workspaces_share_nothing(robot):
    first = bound(robot)
    second = robot.bind()
    expected = first.inverse_dynamics().copy()
    second.inverse_dynamics()
    assert np.array_equal(first.tau, expected)


def test_a_quantity_serves_workspaces_that_were_there_before_its_first_use(robot):
    earlier = robot.bind()
    user = bound(robot)
    expected = user.gravity_force().copy()
    later = bound(robot)
    assert not np.array_equal(earlier.gravity_force(),
                              expected), 'at zero, not at the state'
    assert np.array_equal(later.gravity_force(), expected)
    assert np.array_equal(user.gravity_force(), expected)
    assert len({id(w.gravity_force()) for w in (earlier, user, later)}) == 3


def test_quantities_are_methods_of_machine_code_found_without_a_look_into_the_object():
    workspace = Robot(MODEL).bind()
    assert isinstance(workspace, Workspace)
    for name in QUANTITIES:
        assert type(type(workspace).__dict__[name]).__name__ == 'method_descriptor'
        assert name in getattr(workspace, name).__doc__


def test_a_workspace_of_a_robot_without_joints_works():
    workspace = Robot(random_model(0, 0, passive=False)).bind()
    assert workspace.inverse_dynamics().shape == (0,)
    with pytest.raises(InputError, match='expected no arguments'):
        workspace.inverse_dynamics(1)


def test_a_workspace_without_references_is_freed(robot):
    workspace = bound(robot)
    workspace.mass_matrix()
    gone = weakref.ref(workspace)
    del workspace
    assert gone() is None


def test_a_workspace_keeps_alive_what_it_needs():
    call = bound(Robot(MODEL, wrench_frames=['frame4'])).inverse_dynamics
    gc.collect()
    expected = Robot(MODEL, wrench_frames=['frame4']).inverse_dynamics(
        *STATE, wrench=np.arange(6.0)[None])
    assert np.array_equal(call(), expected)


def test_a_call_allocates_nothing():
    workspace = bound(Robot(MODEL, wrench_frames=['frame4']))
    calls = workspace.inverse_dynamics, workspace.mass_matrix
    references = [sys.getrefcount(call()) for call in calls]
    loop = [None] * 1000
    tracemalloc.start()
    memory_before = tracemalloc.get_traced_memory()[0]
    tracemalloc.reset_peak()
    for _ in loop:
        for call in calls:
            call()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak - memory_before < 200  # the loops' own iterators
    assert [sys.getrefcount(call()) for call in calls] == references


@pytest.mark.parametrize('name', ['gravity_force', 'mass_matrix', 'kinetic_energy'])
def test_an_object_that_was_not_initialized_is_refused(robot, name):
    kind = type(robot.bind())
    for owner in (object.__new__(kind), object.__new__(type('Own', (kind,), {}))):
        for _ in range(2):
            with pytest.raises(TypeError, match=r'not initialized; expected .*bind'):
                getattr(owner, name)()
    with pytest.raises(TypeError, match='kernels'):
        kind.__new__(kind)


@pytest.mark.parametrize('base', ['Workspace', 'its kind'])
def test_a_subclass_that_forgets_its_base_is_initialized_all_the_same(robot, base):
    class Own(Workspace if base == 'Workspace' else type(robot.bind())):

        def __init__(self, kernels):
            pass
    expected = robot.gravity_force(STATE[0])
    derived = Own(robot.kernels)
    bare = Workspace.__new__(Workspace, robot.kernels)
    assert isinstance(derived, Own)
    for workspace in (derived, bare):
        workspace.q[:] = STATE[0]
        assert np.array_equal(workspace.gravity_force(), expected)


def test_attributes_that_compiled_calls_read_cannot_be_deleted(robot):
    workspace = bound(robot)
    for name in ('q', '_tables', '_owned'):
        with pytest.raises(InputError, match=f'{name} cannot be deleted'):
            delattr(workspace, name)
    for function in (robot.gravity_force, workspace.at_frame('frame_pose', 'frame4')):
        if isinstance(getattr(function, '__self__', None), np.ndarray):
            with pytest.raises(ValueError, match='read-only'):
                function.__self__[:] = 0


def test_a_method_of_the_robot_is_pickled_with_it_and_a_bound_one_is_refused(robot):
    robot.parameters.gravity = (1.0, 2.0, 3.0)
    call = pickle.loads(pickle.dumps(robot.gravity_force))
    assert np.array_equal(call(STATE[0]), robot.gravity_force(STATE[0]))
    workspace = bound(robot)
    for function in (workspace.gravity_force,
                     workspace.at_frame('frame_pose', 'frame4')):
        # Without native methods the error is Python's; 3.13 has other words, 3.14
        # another type.
        with pytest.raises((TypeError, AttributeError, pickle.PicklingError),
                           match=r"pickle|Can't get local object"):
            pickle.dumps(function)
