"""Every misuse of speeds and constraints is refused by name, inverses are exact."""

from kane_dynamics import ConstraintError, InputError, ModelBuilder, Robot
from kane_dynamics.mechanics.algebra.jet import moving, rates, values
from kane_dynamics.mechanics.algebra.linear_solve import inverse
from kane_dynamics.mechanics.constraints import (Closure, Coupling, DependentSpeeds,
                                                 PointVelocity, Prescribed, Rolling)
from kane_dynamics.mechanics.constraints.independent_speeds import (choose_independent,
                                                                    closed_configuration)
from kane_dynamics.mechanics.constraints.speeds import body_angular_velocity, Speeds
from kane_dynamics.mechanics.definition import nonholonomic
from kane_dynamics.model.primitive_inertias import box, rod
from kane_dynamics.native.tracing.program import trace_program
import numpy as np
import pytest


def arm(n=3):
    """Return a planar chain of rods with a frame at its tip."""
    b = ModelBuilder('arm')
    for k in range(n):
        b.body(f'rod{k}', f'rod{k - 1}' if k else 'world',
               axis=(0, 1, 0), joint=f'joint{k}',
               at=(1.0 if k else 0.0, 0, 0), inertial=rod(1.0, (0, 0, 0), (1, 0, 0)))
    b.frame('tip', f'rod{n - 1}', at=(1, 0, 0))
    b.frame('far', 'world', at=(10, 0, 0))
    b.frame('near', 'world', at=(1.5, 0, 0.3))
    return b.model()


@pytest.mark.parametrize(('constraints', 'words'), [
    ([PointVelocity('hand', (1, 0, 0))],
     "'velocity of hand': no frame 'hand'; expected one of .*tip"),
    ([Closure('tip', 'moon')], "'closure of tip and moon': no frame 'moon'"),
    ([Coupling('joint0', {'elbow': 1.0})],
     ("'coupling of joint0': no coordinate "
      "'elbow'; expected one of joint0, joint1, joint2")),
    ([Closure('tip', 'far', 'spherical')], "for 'closure of tip and far/x'.* residual"),
    ([Prescribed('joint0', np.sin), Prescribed('joint0', np.cos, name='again')],
     "for '(again|prescribed joint0)'"),
    ([PointVelocity('tip', (1, 0, 0), value=1.0),
      PointVelocity('tip', (1, 0, 0), name='b')],
     "'b' contradicts the others: its velocity residual is 1"),
    ([Closure('tip', 'near', 'weld')],
     'fewer than the 3 speeds, because these leave no degree of freedom'),
    ([PointVelocity('tip', (1, 0, 0)), PointVelocity('tip', (0, 0, 1))],
     'different names'),
    ([DependentSpeeds(('joint2',), lambda q, t: np.zeros((2, 2)))],
     r"'dependent speeds': A\(q, t\) returns shape \(2, 2\); expected \(1, 2\)"),
    ([DependentSpeeds(('u9',), lambda q, t: np.zeros((1, 2)))],
     "no speed 'u9'; expected one of joint0"),
])
def test_constraints_that_cannot_be_are_refused_by_name(constraints, words):
    with pytest.raises(ConstraintError, match=words):
        choose_independent(arm(), None, constraints)


@pytest.mark.parametrize(('make', 'words'), [
    (lambda: PointVelocity('tip', (0, 0, 0)), r'direction: \[0.0, 0.0, 0.0\]'),
    (lambda: PointVelocity('tip', (1, 0, 0), value=np.nan),
     'value: nan; expected a finite'),
    (lambda: PointVelocity('tip', (1, 0, 0), value=None),
     'value: None; expected a finite'),
    (lambda: Rolling('tip', -1.0), 'radius: -1.0; expected a positive number'),
    (lambda: Coupling('joint0', 'joint1'),
     "ratios: 'joint1'; expected a mapping of other joints"),
    (lambda: Coupling('joint0', {'joint0': 1.0}), 'expected a mapping of other joints'),
    (lambda: Coupling('joint0', {'joint1': np.nan}),
     "ratio of 'joint1': nan; expected a finite"),
    (lambda: Coupling('joint0', {'joint1': 1.0}, 'a'),
     "offset: 'a'; expected a finite number"),
    (lambda: DependentSpeeds('joint2', np.zeros),
     "dependent: 'joint2'; expected a list of speed"),
    (lambda: Closure('tip', 'near', 'glue'),
     "kind: 'glue'; expected one of weld, revolute, prismatic")])
def test_values_that_no_constraint_has_are_refused(make, words):
    with pytest.raises(ConstraintError, match=words):
        make()


def test_a_direction_of_any_size_is_normalized():
    for size in (1e-11, 1e200):
        assert PointVelocity('tip', (0, size, 0)).direction.tolist() == [0.0, 1.0, 0.0]


@pytest.mark.parametrize(('speeds', 'error', 'words'), [
    (Speeds(lambda q, t: np.eye(2)), ConstraintError,
     r'Y\(q, t\) returns shape \(2, 2\); expected \(3, 3\)'),
    (Speeds(lambda q, t: np.eye(3), lambda q, t: np.zeros(2)), ConstraintError,
     r'Z\(q, t\) returns shape \(2,\); expected \(3,\)'),
    (Speeds(lambda q, t: np.diag([1.0, 1.0, 0.0])), ConstraintError,
     r'Y is singular at q = \['),
    (Speeds(lambda q, t: np.eye(3), names=('a', 'b')), InputError,
     'expected 3 different ones'),
    ('rates', InputError, 'speeds: a str; expected Speeds, or a function'),
    (body_angular_velocity('rod1'), ConstraintError,
     r'2 revolute joints \(joint0, joint1\)')])
def test_speeds_that_cannot_be_are_refused_by_name(speeds, error, words):
    with pytest.raises(error, match=words):
        choose_independent(arm(), speeds, (PointVelocity('tip', (1, 0, 0)),))


def test_independent_speeds_that_do_not_fit_are_refused():
    constraints = (Coupling('joint1', {'joint0': 2.0}),)
    assert choose_independent(
        arm(), None, constraints, ('joint0', 'joint2')).speed_names == (
            'joint0', 'joint2')
    with pytest.raises(ConstraintError,
                       match='expected exactly 2 of joint0, joint1, joint2'):
        choose_independent(arm(), None, constraints, ('joint0',))
    with pytest.raises(ConstraintError,
                       match='joint0, joint1, which do not determine the other'):
        choose_independent(arm(), None, constraints, ('joint0', 'joint1'))


def test_a_closed_configuration_is_near_closed_and_leaves_what_is_fixed():
    mechanism = choose_independent(arm(), None, (Closure('tip', 'near', 'spherical'),))
    q = closed_configuration(mechanism, [0.5, 1.0, 1.0], fixed=['joint0'])
    assert q[0] == 0.5
    np.testing.assert_allclose(mechanism.state(q).pose('tip')[1], [1.5, 0, 0.3],
                               atol=1e-10)
    with pytest.raises(ConstraintError, match="no coordinate 'elbow'"):
        closed_configuration(mechanism, q, fixed=['elbow'])


@pytest.mark.parametrize('n', range(1, 8))
def test_inverses_of_numbers_and_of_traced_blocks(n):
    rng = np.random.default_rng(n)
    A = rng.normal(size=(n, n)) + 2.0 * np.eye(n)
    np.testing.assert_allclose(inverse(A).astype(float), np.linalg.inv(A),
                               rtol=0.0, atol=1e-11)
    for known in (0, 2):  # rows of the unit matrix above: what is constant goes first
        whole = np.block(
            [[np.eye(known), np.zeros((known, n))], [rng.normal(size=(n, known)), A]])

        def of(block, whole=whole, known=known):
            matrix = whole.astype(object)
            matrix[known:, known:] = block
            return inverse(matrix)
        traced = trace_program('inverse', of, [('A', (n, n))])
        assert traced.shape == whole.shape
        np.testing.assert_allclose(of(A).astype(float) @ whole, np.eye(n + known),
                                   atol=1e-10)


def test_inverting_a_singular_matrix_raises_with_the_row():
    with pytest.raises(ZeroDivisionError) as error:
        inverse(np.array([[1.0, 2.0], [2.0, 4.0]]))
    assert error.value.args[0] in (0, 1)


def test_rates_follow_the_rules_of_differentiation():
    t = 0.4
    h = 1e-6

    def f(t):
        x = np.sin(3.0 * t) + 2.0
        return np.array(
            [x * np.cos(t) / x ** 2, np.sqrt(x) - np.tanh(t), 1.0 / x, -x + 1.0])
    answer = f(moving(t, 1.0))
    np.testing.assert_allclose(values(answer), f(t), rtol=1e-15)
    np.testing.assert_allclose(rates(answer), (f(t + h) - f(t - h)) / (2.0 * h),
                               rtol=1e-8)
    assert rates(np.array([1.0, moving(2.0, 0.0)], dtype=object)).tolist() == [0.0, 0.0]


@pytest.mark.parametrize(('options', 'words'), [
    ({'constraints': Coupling('joint1', {'joint0': 2.0})},
     r'constraints: a Coupling; .*\[pin\]'),
    ({'constraints': ['pin']}, r"constraints\[0\]: 'pin'; expected one of .*Closure"),
    ({'constraints': 'pin'}, "constraints: 'pin'; expected a sequence"),
    ({'constraints': 3}, r'constraints\[0\]: 3'),
    ({'independent': 'joint0'}, r"independent: 'joint0'; .*such as \['joint0'\]"),
    ({'independent': [3]}, r'independent: \[3\]'),
    ({'actuated': 'joint0'}, 'actuated: '),
    ({'constraints': [Coupling('joint1', {'joint0': 2.0})], 'rank_tolerance': -1.0},
     'rank_tolerance: -1.0; expected a positive')])
def test_arguments_of_a_wrong_type_are_refused_by_name(options, words):
    with pytest.raises(ConstraintError, match=words):
        Robot(arm(), **options)


@pytest.mark.parametrize(('q', 'options', 'words'), [
    ([1.0, 2.0], {}, r'q: \[1.0, 2.0\]'),
    ([np.nan, 1.0, 2.0], {}, 'expected 3 finite numbers'),
    ('abc', {}, "q: 'abc'"), ([0.0, 1.0, 2.0], {'t': np.inf}, 't: inf'),
    ([0.0, 1.0, 2.0], {'fixed': 'joint0'}, "fixed: 'joint0'; expected a sequence")])
def test_a_start_from_which_no_loop_closes_is_refused_by_name(q, options, words):
    mechanism = choose_independent(arm(), None, (Closure('tip', 'near', 'spherical'),))
    with pytest.raises((ConstraintError, InputError), match=words):
        closed_configuration(mechanism, q, **options)


@pytest.mark.parametrize('tilt', [1e-14, 1e-10, 1e-5, 0.0])
def test_a_direction_that_is_zero_but_for_the_digits_of_a_file_is_no_pivot(tilt):
    b = ModelBuilder('slider-crank')
    b.body('crank', axis=(0, -1, 0), inertial=rod(0.6, (0, 0, 0), (0.3, 0, 0)))
    b.body('coupler', 'crank', axis=(0, -1, 0), at=(0.3, 0, 0),
           inertial=rod(1.8, (0, 0, 0), (0.9, 0, 0)))
    b.body('slider', 'world', 'prismatic', at=(0.9, 0, 0), axis=(tilt, 0, 1),
           inertial=box(1.0, (0.1, 0.1, 0.1)))
    b.frame('end', 'coupler', at=(0.9, 0, 0))
    b.frame('pin', 'slider')
    robot = Robot(b.model(),
                  constraints=[Closure('end', 'pin', 'inline', axis=(0, 1, 0))],
                  independent=['crank'])
    q = robot.closed_configuration([0.8, -0.4, 0.3], fixed=['crank'])
    u = np.array([2.0])
    udot = np.array([1.0])
    expected = nonholonomic.inverse_dynamics(robot.mechanism, q, u, udot)
    np.testing.assert_allclose(robot.inverse_dynamics(q, u, udot), expected, rtol=1e-12)
    assert np.abs(robot.constraint_velocity_residual(q, u)).max() < 1e-14
