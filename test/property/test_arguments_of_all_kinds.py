"""Wrong arguments of quantities are named in an error, for every kind of mechanism."""

import inspect

from degenerate_input import EXPECTED
from kane_dynamics import natural_vibration, power_balance, Robot, simulate
from kane_dynamics.errors import KaneError
from kane_dynamics.robot.kernel_set import ALL
from kinds_of_mechanism import case, KINDS, torque_of
import numpy as np
import pytest

WRONG = {'ragged': [[1.0], [1.0, 2.0]], 'text': 'abc', 'complex': np.full(2, 1j),
         'mapping': {3: 4}, 'a function': len, 'not finite': np.full(2, np.nan),
         'two numbers too many': np.zeros((2, 2, 2, 2))}
WRONG_OUT = {'number': 3, 'text': 'abc', 'list': [0.0], 'short': np.zeros(1),
             'integers': None, 'longer': None}


# Arguments that robots in joint rates ignore: the result is another argument.
UNUSED = {'joint_rates': ('q',), 'joint_torques': ('q',), 'generalized_force': ('q',),
          'joint_accelerations': ('q', 'u')}


def is_ignored(robot, name, argument):
    """Return whether a robot ignores an argument of a call, as documented."""
    if argument == 't':
        return not robot.equations.timed
    return robot.equations.in_joint_rates and argument in UNUSED.get(name, ())


def values_of(one):
    """Return valid arguments of quantities by name."""
    return {'q': one.q, 'u': one.u, 'udot': one.udot, 'tau': torque_of(one.robot),
            'wrench': np.ones((1, 6)), 't': one.time}


def quantities(one):
    """Yield methods of the robot with valid arguments."""
    robot = one.robot
    valid = values_of(one)
    for name in ALL:
        method = getattr(robot, name, None)
        if method is None or (name.startswith('constraint')
                              and not robot.constraint_names):
            continue
        parameters = inspect.signature(getattr(Robot, name)).parameters
        arguments = {key: valid[key] for key in parameters if key in valid}
        if name == 'friction_force' and robot.equations.in_joint_rates:
            del arguments['q']
        yield name, method, arguments


def refusal(method, **arguments):
    """Return the words with which a call is refused, '' if it is not."""
    try:
        method(**arguments)
    except KaneError as error:
        return str(error)
    return ''


@pytest.mark.parametrize('kind', KINDS)
def test_wrong_states_loads_and_times_are_named(kind):
    one = case(kind)
    wrong = []
    for name, method, arguments in quantities(one):
        if refusal(method, **arguments):  # a quantity that this kind does not have
            continue
        for key in arguments:
            if is_ignored(one.robot, name, key):
                continue
            for form, value in WRONG.items():
                words = refusal(method, **arguments | {key: value})
                if not EXPECTED.search(words):
                    wrong.append(f'{name}, {key}: {form}: {words}')
    assert not wrong


@pytest.mark.parametrize('kind', KINDS)
def test_results_are_written_to_arrays_of_their_shape_and_type_alone(kind):
    one = case(kind)
    wrong = []
    for name, method, arguments in quantities(one):
        if 'derivatives' in name or refusal(method, **arguments):
            continue
        result = np.asarray(method(**arguments))
        outs = WRONG_OUT | {'integers': np.zeros(result.shape, dtype=int),
                            'longer': np.zeros((2, *result.shape))}
        for form, out in outs.items():
            if getattr(out, 'shape', None) == result.shape and form != 'integers':
                continue
            words = refusal(method, **arguments, out=out)
            if not EXPECTED.search(words):
                wrong.append(f'{name}: {form}: {words}')
        # A view of the right shape that is not contiguous is written to.
        spread = np.zeros((*result.shape, 2))[..., 0]
        method(**arguments, out=spread)
        np.testing.assert_array_equal(spread, result)
    assert not wrong


def other_calls(one):
    """Yield calls beside the quantities, with valid arguments."""
    robot = one.robot
    valid = values_of(one)
    state = {key: valid[key] for key in ('q', 'u', 'udot')}
    yield 'power_balance', power_balance, {'robot': robot, **state,
                                           'wrench': valid['wrench'], 't': one.time}
    yield 'integrate', robot.integrate, {'q': one.q, 'u': one.u, 't': one.time}
    yield 'difference', robot.difference, {'q0': one.q, 'q1': one.q, 't': one.time}
    yield ('operational_space_bias', robot.operational_space_bias,
           {'frame': 'tool', 'q': one.q, 'u': one.u, 'directions': ('x',), **one.t})
    yield ('generalized_force', robot.generalized_force,
           {'joint_torques': np.ones(len(robot.joint_names)), 'q': one.q, 't': one.time})
    yield ('derivative', lambda q, u, udot, **named: robot.derivative(
        'inverse_dynamics', q, u, udot, **named), {**state, 'by': 'u', 't': one.time})
    if not robot.equations.timed and not robot.model.balls:
        yield 'vibration', natural_vibration, {'robot': robot, 'q': one.q, 'held': ()}
    yield ('simulate', simulate, {'robot': robot, 'q0': one.q, 'u0': one.u,
                                  'duration': 0.001, 't0': one.time})


@pytest.mark.parametrize('kind', KINDS)
def test_wrong_arguments_of_other_calls_are_named(kind):
    one = case(kind)
    wrong = []
    for name, call, arguments in other_calls(one):
        call(**arguments)
        for key in arguments:
            if is_ignored(one.robot, name, key):
                continue
            for form, value in WRONG.items():
                words = refusal(call, **arguments | {key: value})
                if not EXPECTED.search(words):
                    wrong.append(f'{name}, {key}: {form}: {words}')
    assert not wrong


def test_motions_to_infinity_and_quaternions_of_any_length_are_handled():
    one = case('free and ball joints')
    robot = one.robot
    for q, u, dt in ((one.q, np.full(robot.n, 1e300), 1.0), (one.q, one.u, 1e300)):
        with pytest.raises(KaneError, match=r'too large.*expected'):
            robot.integrate(q, u, dt)
    unit = robot.closed_configuration(one.q)
    for scale in (1e-300, 1e-10, 1e300):
        q = unit.copy()
        for first in (3, 8):
            q[first:first + 4] *= scale
        np.testing.assert_allclose(robot.closed_configuration(q), unit, atol=1e-15)
