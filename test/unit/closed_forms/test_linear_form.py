"""Linear equations on paper are those of `linearized`, and published ones."""

from kane_dynamics import (FlexibleLink, InputError, linearized, ModelBuilder,
                           point_mass, Robot)
from kane_dynamics.closed_forms import linear_form
import numpy as np
import paper_mechanisms
import pytest
import sympy as sp

# Of all kinds, those whose entries are short at any state.
NAMES = ('yy True', 'Xy rheonomic', 'mimic', 'elastic joints', 'cart',
         'yy absolute_rates', 'yy coupling', 'zy prescribed', 'Xy speeds')

ROBOTS = paper_mechanisms.mechanisms()


@pytest.mark.parametrize('name', NAMES)
def test_the_entries_are_those_of_numbers_at_any_state(name):
    robot = ROBOTS[name]
    q, u, t = paper_mechanisms.state(robot)
    form = linear_form(robot, q, u, t=t)
    expected = linearized(robot, q, u, t=t)
    got = form.numeric()
    assert got.names == expected.names
    for key in ('A', 'B', 'positions'):
        matrix = getattr(expected, key)
        np.testing.assert_allclose(getattr(got, key), matrix, rtol=0.0,
                                   atol=1e-12 * max(1.0, np.abs(matrix).max()))


def test_loops_deviate_as_their_constraints_admit():
    robot = ROBOTS['four-bar revolute']
    q, _, _ = paper_mechanisms.state(robot)
    got = linear_form(robot, q, [0.7], numbers=True).numeric()
    expected = linearized(robot, q, [0.7])
    np.testing.assert_allclose(got.A, expected.A, rtol=0.0,
                               atol=1e-10 * np.abs(expected.A).max())
    np.testing.assert_allclose(got.positions, expected.positions, atol=1e-11)


def test_an_inverted_pendulum_on_a_cart_falls_as_in_the_textbook():
    b = ModelBuilder()
    b.body('cart', 'world', 'prismatic', axis=(1, 0, 0), inertial=point_mass(2))
    b.body('pole', 'cart', axis=(0, 1, 0), inertial=point_mass(1.5, (0, 0, 0.8)))
    form = linear_form(Robot(b.model()))
    M, m, L, g = sp.symbols('m1 m2 r2 g', positive=True)
    s = sp.Symbol('s')
    expected = s**4 - s**2 * g * (M + m) / (M * L)
    assert sp.simplify(form.characteristic(form.names, s) - expected) == 0
    assert sp.simplify(form.A[2, 1] + m * g / M) == 0
    assert sp.simplify(form.B[3, 1] - (M + m) / (M * m * L**2)) == 0
    modes = form.numeric().modes()
    assert modes[-1][1] in ('pole', 'rate of pole')
    assert modes[-1][0] == pytest.approx(np.sqrt(9.81 * 3.5 / (2 * 0.8)), rel=1e-12)


@pytest.mark.parametrize(('modes', 'shift'), [((1, 0), 0), ((0, 1), 1)])
def test_a_spinning_beam_stiffens_by_southwells_coefficient(modes, shift):
    # Out of the plane of the rotation the squared frequency grows by 1.1933 Omega^2
    # (uniform clamped beam, first mode), in the plane by Omega^2 less. Without
    # foreshortening it would fall by Omega^2 there.
    b = ModelBuilder()
    b.beam('beam', 'world', FlexibleLink(1.0, 2.0, 80.0, modes, up=(0, 0, 1)),
           axis=(0, 0, 1))
    robot = Robot(b.model())
    u = [3.0, 0.0]
    form = linear_form(robot, None, u)
    np.testing.assert_allclose(form.numeric().A, linearized(robot, [0.0, 0.0], u).A,
                               rtol=1e-12, atol=1e-10)
    omega, = (parameter.symbol for parameter in form.parameters
              if str(parameter.symbol) == 'u1')
    square = sp.Poly(form.K[1, 1] / form.M[1, 1], omega)
    assert square.coeff_monomial(omega**2) == pytest.approx(1.1933 - shift, abs=1e-4)
    frequency = 1.8751040687**2 * np.sqrt(80.0 / 2.0)  # EI over mass per length
    assert square.coeff_monomial(1) == pytest.approx(frequency**2, rel=1e-9)


def test_ball_joints_are_refused():
    with pytest.raises(InputError, match=r"linear_form of .*'body'"):
        linear_form(ROBOTS['ball joint'])
