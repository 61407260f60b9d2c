"""Calls of the laws that follow a pose: their entry points do what their methods do."""

import copy
from functools import cache
import gc
import pickle
import sys
import weakref

from kane_dynamics import (CartesianImpedance, HandGuiding, HybridForce, InputError,
                           JointImpedance, load_urdf, OperationalSpace, Robot)
from kane_dynamics._util.resources import resource_path
import numpy as np
from palletizer import palletizer, positions
import pytest

STIFFNESS = [2000.0] * 3 + [100.0] * 3
WRENCH = np.array([1.0, -2.0, -10.0, 0.1, 0.2, 0.3])
MEASURED = np.array([0.0, 0.0, 8.0, 0.0, 0.0, 0.0])
LAWS = ('CartesianImpedance', 'OperationalSpace', 'HybridForce')


@cache
def fr3():
    return Robot(load_urdf(resource_path('urdf', 'fr3.urdf'), tip='fr3_link8'))


def law_and_state(name, on='fr3'):
    """Return a law, and q, u, pose of a state of its robot."""
    robot, frame = (fr3(), 'fr3_link8') if on == 'fr3' else (palletizer(), 'tool')
    if on == 'fr3':
        q = np.array([0.0, -0.7, 0.0, -2.2, 0.0, 1.5, 0.785])
    else:
        q = positions(robot, 0.1, 0.2, -0.1, 0.3)
    laws = {
        'CartesianImpedance': lambda: CartesianImpedance(robot, frame,
                                                         stiffness=STIFFNESS),
        'OperationalSpace': lambda: OperationalSpace(robot, frame),
        'HybridForce': lambda: HybridForce(robot, frame, stiffness=STIFFNESS,
                                           force_directions=['z'])}
    pose = robot.frame_pose(frame, q)
    pose[:3, 3] += [0.01, -0.02, 0.01]
    return laws[name](), (q, np.linspace(-0.2, 0.3, robot.n), pose)


def method_of(law):
    """Return the method of a law that its entry point replaces."""
    return type(law).torque.__get__(law)


CALLS = [
    ((), {}), ((np.full(6, 0.1),), {}), ((None, np.full(6, 0.2)), {'wrench': WRENCH}),
    ((), {'acceleration': np.full(6, 0.3), 'twist': None}), ((None, None, WRENCH), {}),
    ((None, None, None, 0.7), {}), ((), {'t': 0.5, 'wrench': WRENCH.tolist()})]


@pytest.mark.parametrize('on', ['fr3', 'palletizer'])
@pytest.mark.parametrize('name', LAWS)
def test_an_entry_point_returns_the_torques_of_the_method(name, on):
    law, state = law_and_state(name, on)
    first = law.torque(*state)
    assert law.torque is not method_of(law) and type(law.torque) is type(len)
    np.testing.assert_array_equal(law.torque(*state), first)
    further = [{}]
    if name == 'HybridForce':
        further = [{}, {'measured': MEASURED}, {'elapsed': 1e-3, 'measured': MEASURED},
                   {'elapsed': 1, 'measured': MEASURED.tolist()}, {'measured': None}]
    for values, named in CALLS:
        for extra in further:
            twin = copy.deepcopy(law)
            expected = method_of(twin)(*state, *values, **named, **extra)
            tau = law.torque(*state, *values, **named, **extra)
            np.testing.assert_array_equal(tau, expected)
            if name == 'HybridForce':
                np.testing.assert_array_equal(law.integral, twin.integral)


@pytest.mark.parametrize('name', LAWS)
def test_wrong_calls_are_answered_as_by_the_method(name):
    law, (q, u, pose) = law_and_state(name)
    law.torque(q, u, pose)
    bad = pose.copy()
    bad[:3, :3] *= 2.0
    unfinite = u.copy()
    unfinite[2] = np.nan
    for values, named in (((), {}), ((q, u), {}), ((q, u, pose), {'q': q}),
                          ((q, u, pose), {'weight': 1.0}), ((q, u, pose, u), {}),
                          ((q, u, bad), {}), ((q, unfinite, pose), {}),
                          ((q, u, pose, WRENCH), {'twist': WRENCH}),
                          ((q, u, pose), {'wrench': unfinite[:6]}),
                          ((q[:6], u, pose), {})):
        with pytest.raises((InputError, TypeError)) as of_method:
            method_of(law)(*values, **named)
        with pytest.raises(type(of_method.value)) as of_entry:
            law.torque(*values, **named)
        assert str(of_entry.value) == str(of_method.value)


@pytest.mark.parametrize('elapsed', [-1.0, np.nan, np.inf, 'soon'])
def test_a_time_that_is_none_is_refused_and_changes_no_integral(elapsed):
    law, state = law_and_state('HybridForce')
    law.torque(*state, wrench=WRENCH, measured=MEASURED, elapsed=1e-3)
    integral = law.integral
    assert integral.any()
    with pytest.raises(InputError, match='elapsed: '):
        law.torque(*state, wrench=WRENCH, measured=MEASURED, elapsed=elapsed)
    np.testing.assert_array_equal(law.integral, integral)


@pytest.mark.parametrize('name', LAWS)
def test_torques_belong_to_the_caller_and_no_reference_is_lost(name):
    law, state = law_and_state(name)
    law.torque(*state)
    results = [law.torque(*state, wrench=WRENCH) for _ in range(4)]
    assert len({tau.ctypes.data for tau in results}) == 4
    expected = results[0].copy()
    for tau in results:
        assert tau.flags.owndata
        tau[:] = 0.0
    np.testing.assert_array_equal(law.torque(*state, wrench=WRENCH), expected)
    counts = [sys.getrefcount(x) for x in (*state, WRENCH, law._zero, law._block)]
    for _ in range(1000):
        law.torque(*state, wrench=WRENCH)
    assert counts == [sys.getrefcount(x)
                      for x in (*state, WRENCH, law._zero, law._block)]


def unpickled(law):
    """Return a copy by way of bytes, as another process gets it."""
    return pickle.loads(pickle.dumps(law))


@pytest.mark.parametrize('copied', [copy.copy, copy.deepcopy, unpickled])
@pytest.mark.parametrize('name', ['CartesianImpedance', 'HybridForce'])
def test_a_copy_has_its_own_settings(name, copied):
    law, state = law_and_state(name)
    expected = law.torque(*state)
    twin = copied(law)
    np.testing.assert_array_equal(twin.torque(*state), expected)
    twin.update(stiffness=[500.0] * 3 + [20.0] * 3)
    assert np.abs(twin.torque(*state) - expected).max() > 0.1
    np.testing.assert_array_equal(law.torque(*state), expected)


@pytest.mark.parametrize('copied', [copy.copy, copy.deepcopy, unpickled])
@pytest.mark.parametrize('make, changes', [
    (lambda robot: JointImpedance(robot, stiffness=50.0), {'stiffness': 80.0}),
    (lambda robot: JointImpedance(robot, stiffness=50.0), {'damping': 9.0}),
    (lambda robot: JointImpedance(robot, stiffness=50.0, damping=9.0),
     {'damping': None, 'damping_ratio': 0.2}),
    (HandGuiding, {'damping': 4.0})])
def test_a_copy_of_a_law_of_joints_has_its_own_settings(make, changes, copied):
    robot = fr3()
    _, (q, u, _) = law_and_state('CartesianImpedance')
    law = make(robot)
    state = (q, u, q + 0.1) if isinstance(law, JointImpedance) else (q, u)
    expected = law.torque(*state)
    twin = copied(law)
    np.testing.assert_array_equal(twin.torque(*state), expected)
    twin.update(**changes)
    assert np.abs(twin.torque(*state) - expected).max() > 0.1
    np.testing.assert_array_equal(law.torque(*state), expected)
    # A copy of the robot has its own gravity.
    if twin.robot is not robot:
        torque_before = twin.torque(*state)
        twin.robot.parameters.gravity = [0.0, 0.0, 0.0]
        assert np.abs(twin.torque(*state) - torque_before).max() > 1.0
        np.testing.assert_array_equal(law.torque(*state), expected)


def test_update_changes_the_next_call():
    law, state = law_and_state('CartesianImpedance')
    law.torque(*state)
    law.update(stiffness=[500.0] * 3 + [20.0] * 3)
    fresh = CartesianImpedance(law.robot, 'fr3_link8',
                               stiffness=[500.0] * 3 + [20.0] * 3)
    np.testing.assert_array_equal(law.torque(*state), fresh.torque(*state))


def test_the_method_of_a_subclass_stays():
    class Doubled(CartesianImpedance):

        def torque(self, *values, **named):
            return 2.0 * super().torque(*values, **named)
    law, state = law_and_state('CartesianImpedance')
    doubled = Doubled(law.robot, 'fr3_link8', stiffness=STIFFNESS)
    for _ in range(2):
        np.testing.assert_array_equal(doubled.torque(*state), 2.0 * law.torque(*state))


def test_a_law_is_freed_with_its_entry_point():
    law, state = law_and_state('CartesianImpedance')
    law.torque(*state)
    gone = weakref.ref(law)
    del law
    gc.collect()
    assert gone() is None
