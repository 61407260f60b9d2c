"""Functions that users give: numpy's values and derivatives, or a refusal by name."""

import math

from hyperdual import seeded
from kane_dynamics import (ConstraintError, ModelBuilder, Motion, point_mass, Prescribed,
                           Robot)
from kane_dynamics.mechanics.algebra.jet import moving, rates, values
from kane_dynamics.mechanics.algebra.spline import clamped_spline
from kane_dynamics.mechanics.algebra.user_functions import evaluated_scalar
from kane_dynamics.mechanics.constraints import DependentSpeeds, PointVelocity
from kane_dynamics.mechanics.constraints.independent_speeds import choose_independent
from kane_dynamics.mechanics.constraints.speeds import Speeds
from kane_dynamics.native.backends.llvm_scalar import module_text
from kane_dynamics.native.machine_code import llvm
from kane_dynamics.native.runtime.loops import repeat
from kane_dynamics.native.tracing.program import trace_program
import mpmath
import numpy as np
import pytest

FUNCTIONS = {
    'sin': np.sin, 'tan': np.tan, 'arctan': np.arctan,
    'arcsin': lambda t: np.arcsin(t / 3.0),
    'arccos': lambda t: np.arccos(t / 3.0), 'arctan2': lambda t: np.arctan2(t, t - 2.0),
    'arctan2 steep': lambda t: np.arctan2(t - 2.0, t * 0.1), 'tanh': np.tanh,
    'cosh': np.cosh,
    'sinh': np.sinh, 'exp': lambda t: np.exp(-t), 'expm1': np.expm1, 'exp2': np.exp2,
    'log': np.log, 'log2': np.log2, 'log10': np.log10, 'sqrt': np.sqrt,
    'square': np.square,
    'reciprocal': np.reciprocal, 'hypot': lambda t: np.hypot(t, 1.0), 'deg': np.rad2deg,
    '**3': lambda t: t**3, '**-2': lambda t: t**-2, '**0.5': lambda t: t**0.5,
    '**2.7': lambda t: t**2.7, '2**t': lambda t: 2.0**t, 't**t': lambda t: t**t,
    'power': lambda t: np.power(t, 3), 'abs': lambda t: abs(t - 2.0) * t,
    'np.abs': lambda t: np.abs(t - 1.0) * t, 'sign': lambda t: np.sign(t - 2.0) * t * t,
    'minimum': lambda t: np.minimum(t * t, 1.0 + t),
    'maximum': lambda t: np.maximum(t**3, t),
    'clip': lambda t: np.clip(t * t, 0.0, 1.0), 'floor': lambda t: np.floor(t) * t * t,
    'ceil': lambda t: np.ceil(t) * t, 'mod': lambda t: (t % 1.0) ** 2,
    '//': lambda t: t // 0.3, 'where': lambda t: np.where(t < 1.0, t, t * t),
    'heaviside': lambda t: np.heaviside(t, 0.5),
    'and': lambda t: np.where((t > 1.0) & (t <= 2.0), t * t, 0.0),
    't > 1': lambda t: t * (t > 1),
    'or': lambda t: np.where((t < 0.0) | ~(t < 1.0), t**2, 0.0),
    '!=': lambda t: (t != 7.0) * t,
    'log of what is positive': lambda t: np.where(t > 5.0, np.log(t - 5.0), t * t),
    'piecewise': lambda t: np.piecewise(t, [t < 1.0, t >= 1.0],
                                        [lambda x: x, lambda x: x**2]),
    'polyval': lambda t: np.polyval([1.0, 2.0, 3.0], t), 'constant': lambda t: 1,
    'Polynomial': np.polynomial.Polynomial([1.0, 2.0, 3.0]),
    'float64': lambda t: np.float64(2) * t,
    'two': lambda t: np.exp(np.sin(t)) / (1.0 + t**2)}
T = 1.3


def compiled(program):
    """Return a program of one number as a function in native code."""
    code = llvm.Code(llvm.assemble(module_text(program, 'f')))

    def run(t):
        t = np.array([t])
        out = np.empty(len(program.outputs))
        repeat(code.address('f'), [t.ctypes.data, out.ctypes.data], [0, 0], 1)
        return out
    return run


def traced(f):
    """Return value, first and second derivative by a compiled program."""
    def of(t):
        first = evaluated_scalar(f, 'f', moving(moving(t[0], 1.0), 1.0))
        parts = [values(values(np.array([first]))), values(rates(np.array([first]))),
                 rates(rates(np.array([first])))]
        return np.concatenate(parts)
    program = trace_program('f', of, [('t', (1,))])
    return compiled(program)(T)


@pytest.mark.parametrize('name', FUNCTIONS)
def test_value_and_two_derivatives_are_numpys(name):
    f = FUNCTIONS[name]
    h = 1e-3
    places = T + h * np.arange(-3, 4)
    with np.errstate(invalid='ignore'):  # numpy evaluates both branches of where
        samples = np.array([float(f(x)) for x in places])
        want = float(f(np.float64(T)))  # Python 3.12 deprecates ~ of its own bool
    first = samples @ [-1, 9, -45, 0, 45, -9, 1] / (60.0 * h)
    second = samples @ [2, -27, 270, -490, 270, -27, 2] / (180.0 * h * h)
    hyper = evaluated_scalar(f, 'f', seeded([T], [1.0], 0, 1)[0])
    dual = evaluated_scalar(f, 'f', moving(T, 1.0))
    value = values(np.array([dual], dtype=object))[0]
    assert value == pytest.approx(want, rel=4e-15)
    rate = rates(np.array([dual], dtype=object))[0]
    assert rate == pytest.approx(first, rel=1e-9, abs=1e-9)
    if not isinstance(hyper, float):
        assert hyper.value == pytest.approx(want, rel=4e-15)
        assert hyper.rate == pytest.approx(first, rel=1e-9, abs=1e-9)
        assert hyper.gradient_rate[0] == pytest.approx(second, rel=1e-6, abs=1e-6)


REFUSED = {
    'math.sin': (math.sin, r'float\(\), or a function of math'),
    'branch': (lambda t: t if t < 1 else 2 * t, 'a decision of Python'),
    'max': (lambda t: max(t, 1.0), 'use numpy.where, numpy.maximum'),
    'float': (lambda t: float(t) * 1.0, r'float\(\)'), 'int': (int, r'int\(\)'),
    'round': (round, r'round\(\)'), 'interp': (lambda t: np.interp(t, [0, 1], [0, 1]),
                                               'numpy.interp, whose velocity jumps'),
    'sinc': (np.sinc, 'numpy.sinc'), 'cbrt': (np.cbrt, 'numpy.cbrt'),
    'shape': (lambda t: np.array([t]), r'returns shape \(1,\); expected a number'),
    'None': (lambda t: None, "uses 'None'"),
    'nan': (lambda t: float('nan'), 'returns nan at'),
    'error': (lambda t: {}['key'], 'raises KeyError'),
    'pole': (lambda t: 1.0 / t, 'by zero at'),
    'string': (lambda t: 'fast', "uses 'fast'")}


@pytest.mark.parametrize('name', REFUSED)
def test_a_user_function_without_a_derivative_is_refused_by_name(name):
    function, words = REFUSED[name]
    b = ModelBuilder('pair')
    for joint in ('a', 'b'):
        b.body(joint, kind='prismatic', axis=(1, 0, 0), inertial=point_mass(1.0))
    for constraint in (Prescribed('a', function, name='it'),
                       PointVelocity('a', (1, 0, 0), value=function, name='it')):
        with pytest.raises(ConstraintError, match=f"constraint 'it': .*{words}"):
            choose_independent(b.model(), None, (constraint,))
    if name in ('branch', 'float', 'max'):
        with pytest.raises(ConstraintError, match=rf'Y\(q, t\) uses .*{words}'):
            choose_independent(b.model(),
                               Speeds(lambda q, t: np.diag([function(q[0]), 1.0])), ())
        with pytest.raises(ConstraintError, match=rf'A\(q, t\) uses .*{words}'):
            choose_independent(b.model(), None, (
                DependentSpeeds(('a',), lambda q, t: np.array([[function(q[1])]])),))


def pair():
    """Return a cart that is prescribed, and another."""
    b = ModelBuilder('pair')
    for joint in ('a', 'b'):
        b.body(joint, kind='prismatic', axis=(1, 0, 0), inertial=point_mass(1.0))
    return b.model()


def test_a_joint_moves_as_a_motion_and_as_a_table():
    times = [0.2, 0.5, 1.0, 1.7]
    positions = [0.0, 0.4, -0.2, 0.3]
    motion = Motion.from_points(times, np.array([positions, positions]).T,
                                joint_names=['b', 'a'])
    for course in (motion, (times, positions)):
        robot = Robot(pair(), constraints=[Prescribed('a', course)])
        for t in (0.0, 0.3, 0.5, 0.77, 1.2, 1.69, 3.0):
            q, u, udot = (part[1] for part in motion.sample(t))
            assert abs(robot.constraint_residual([q, 0.1], t=t)[0]) < 1e-14
            assert robot.joint_rates([q, 0.1], [0.0], t=t)[0] == pytest.approx(
                u, abs=1e-13)
            acceleration = robot.frame_acceleration('a', [q, 0.1], [0.0], [0.0], t=t)[0]
            assert acceleration == pytest.approx(udot, abs=1e-11)


@pytest.mark.parametrize(('given', 'words'), [
    (([0.0, 0.0], [1.0, 2.0]), 'strictly increasing'),
    (([0.0, 1.0], [1.0]), 'positions'),
    (3.0, 'position: a float; expected a function of t'),
    (Motion, 'position: a type; expected'),
    (([0.0], [1.0]), 'times: 1'),
    (Motion.from_points([0.0, 1.0], [[0.0], [1.0]], joint_names=['other']),
     "no joint 'a'")])
def test_tables_and_motions_that_do_not_fit_are_refused(given, words):
    with pytest.raises(ConstraintError, match=f"'prescribed a': .*{words}"):
        Prescribed('a', given)


def test_a_table_that_is_traced_is_the_table():
    spline = clamped_spline([0.0, 1.0, 3.0, 4.0], [0.0, 1.0, -1.0, 2.0])
    program = trace_program('f',
                            lambda t: np.array([evaluated_scalar(spline, 'f', t[0])]),
                            [('t', (1,))])
    kernel = compiled(program)
    for t in (-1.0, 0.0, 0.3, 1.0, 2.9, 3.5, 4.0, 9.0):
        assert kernel(t)[0] == pytest.approx(spline(t), abs=1e-14)


def test_user_functions_are_asked_only_about_the_configuration_of_the_user():
    asked = []

    def A(q, t):
        asked.append(float(getattr(q[1].inner, 'value', q[1].inner))
                     if isinstance(getattr(q[1].inner, 'value', q[1].inner), float)
                     else None)
        return np.array([[np.log(q[1])]])
    robot = Robot(pair(), constraints=[DependentSpeeds(('a',), A)],
                  configuration=[0.0, 2.0], independent=['b'])
    robot.verify()
    numbers = [x for x in asked if x is not None]
    assert numbers and min(numbers) > 1.5 and max(numbers) < 2.5


def test_functions_of_a_compiled_mechanism_are_exact():
    with mpmath.workdps(30):
        for name in ('exp', 'log', 'arctan', '**2.7', 'tan'):
            exact = {'exp': lambda t: mpmath.exp(-t), 'log': mpmath.log,
                     'arctan': mpmath.atan,
                     '**2.7': lambda t: t**mpmath.mpf(2.7), 'tan': mpmath.tan}[name]
            want = [exact(mpmath.mpf(T)),
                    *(mpmath.diff(exact, mpmath.mpf(T), k) for k in (1, 2))]
            np.testing.assert_allclose(traced(FUNCTIONS[name]), [float(x) for x in want],
                                       rtol=5e-14)
