"""Closed forms, evaluated with numbers, agree with Kane's definition."""

from dataclasses import replace
from itertools import product

from kane_dynamics import box, Inertial, InputError, Model, ModelBuilder, point_mass
from kane_dynamics.closed_forms import polynomials
from kane_dynamics.closed_forms.closed_form import closed_form
from kane_dynamics.closed_forms.closed_form_text import as_csv
from kane_dynamics.closed_forms.polynomials import shortened
from kane_dynamics.closed_forms.symbolic import exact, Symbolic, symbols, unwrapped
from kane_dynamics.mechanics.definition import kane, kinematics
from mechanisms import random_model, random_state
import numpy as np
import pytest
import sympy as sp


def hanging():
    """Return a box on a universal joint, its center of mass off every axis."""
    b = ModelBuilder()
    b.body('box', 'world', 'universal', at=(0.1, 0.2, 0.3), rpy=(0.3, 0, 0),
           inertial=box(1.5, (0.1, 0.2, 0.3), at=(0.1, -0.2, -0.4)))
    return b.model()


def crane():
    """Return a boom on an oblique axis with a prismatic joint, spring and damper."""
    b = ModelBuilder(gravity=(0, -3, -9))
    b.body('boom', axis=(0, 3, 4), inertial=Inertial(2, (0.4, 0.1, 0), np.eye(3)),
           friction=0.3)
    b.body('slide', 'boom', 'prismatic', axis=(1, 0, 0), at=(1, 0, 0), damping=0.7,
           stiffness=30, rest=0.2, armature=0.1, inertial=point_mass(0.5, (0.2, 0, 0.1)))
    return b.model()


def geared():
    """Return two links; the second rotates twice as far as the first."""
    b = ModelBuilder()
    b.body('first', axis=(0, 1, 0), inertial=Inertial(2, (0.5, 0, 0)))
    b.body('second', 'first', axis=(0, 1, 0), at=(1, 0, 0),
           inertial=Inertial(1, (0.3, 0, 0)))
    first, second = b.model().bodies
    joint = replace(second.joint, coordinate=0, multiplier=2.0, offset=0.25)
    return Model('geared', (first, replace(second, joint=joint)), ('first',))


def general():
    """Return two links on oblique axes."""
    return random_model(3, 2, prismatic=0.0, branching=0.0, passive=False)


@pytest.mark.parametrize(('make', 'numbers'), [
    *product([hanging, crane, geared], [False, True]), (general, True)])
def test_closed_form_is_what_the_sums_over_bodies_give(make, numbers):
    model = make()
    form = closed_form(model, numbers=numbers)
    values = {p.symbol: p.value for p in form.parameters}
    entries = [form.M, form.bias, *form.partials.values()]
    function = sp.lambdify([*form.q, *form.u], [entry.subs(values) for entry in entries])
    tolerance = 2e-5 if numbers else 1e-12  # numbers are printed with six digits
    for q, u in random_state(model, 0, 10).reshape(5, 2, -1):
        M, bias, *partials = function(*q, *u)
        bodies = kinematics.configurations(model, q)
        expected = []
        for body, placed in zip(model.bodies, bodies):
            if body.inertial.mass:
                expected.append(
                    np.concatenate([placed.partial_angular_velocity @ placed.R_wb,
                                    placed.partial_velocity @ placed.R_wb], axis=1).T)
        pairs = [(M, kane.mass_matrix(model, q)),
                 (bias[:, 0], kane.bias_force(model, q, u)), *zip(partials, expected)]
        for got, reference in pairs:
            np.testing.assert_allclose(np.array(got, dtype=float), reference,
                                       rtol=tolerance,
                                       atol=tolerance * np.abs(reference).max())


def test_a_planar_chain_comes_out_in_sums_of_its_angles():
    b = ModelBuilder()
    for k in range(3):
        b.body(f'link{k}', f'link{k - 1}' if k else 'world', axis=(0, 1, 0),
               at=(0.5, 0, 0) if k else (0, 0, 0),
               inertial=Inertial(1 + k, (0.25, 0, 0)))
    form = closed_form(b.model(), friction=False)
    q1, q2, q3 = form.q
    assert form.M.free_symbols.isdisjoint({q1})
    assert form.bias[2].coeff(form.u[0], 0).has(sp.cos(q1 + q2 + q3))


def test_friction_is_left_in_words_and_can_be_left_out():
    b = ModelBuilder(gravity=(0, 0, 0))
    b.body('wheel', damping=2, friction=3, armature=0.5, stiffness=4, rest=-1)
    model = b.model()
    form = closed_form(model)
    d1 = sp.Symbol('d1', positive=True)
    f1 = sp.Symbol('f1', positive=True)
    w1 = sp.Symbol('w1', positive=True)
    J1 = sp.Symbol('J1', positive=True)
    k1 = sp.Symbol('k1', positive=True)
    s1 = sp.Symbol('s1', positive=True)
    q1 = form.q[0]
    u1 = form.u[0]
    spring = k1 * (q1 + s1)
    assert form.M[0] == J1
    assert sp.simplify(form.bias[0] - spring - d1 * u1 - f1 * sp.tanh(u1 / w1)) == 0
    assert sp.simplify(closed_form(model, friction=False).bias[0] - spring) == 0


def test_operations_are_counted_after_sharing():
    b = ModelBuilder()
    b.body('link', axis=(0, 1, 0), inertial=Inertial(2, (0.5, 0, 0)))
    # M 0.5; bias -9.81 cos(q1)
    counts = closed_form(b.model(), numbers=True).operations()
    assert counts['mass_matrix'].multiplications == counts['mass_matrix'].additions == 0
    assert (counts['bias_force'].multiplications, counts['bias_force'].functions) == (1,
                                                                                      1)


def test_a_massless_body_has_no_line_in_the_table():
    b = ModelBuilder()
    b.body('table', 'world', 'planar', inertial=Inertial(1))
    lines = as_csv(closed_form(b.model())).splitlines()
    assert lines[1:] == ['u1,table,0,0,0,cos(q3),-sin(q3),0',
                         'u2,table,0,0,0,sin(q3),cos(q3),0', 'u3,table,0,0,1,0,0,0']


@pytest.mark.parametrize('n', [5, 9])
def test_a_mechanism_with_many_coordinates_is_refused_with_a_way_out(n):
    with pytest.raises(InputError, match=f'{n} coordinates; expected 1 to 4.*--joints'):
        closed_form(random_model(0, n))


def test_short_forms_are_equal_to_what_they_shorten():
    (q1, q2, u1), _ = symbols(['q1', 'q2', 'u1'])
    for expression, expected in (
            (u1 * sp.sin(q1)**2 + u1 * sp.cos(q1)**2, u1),
            (sp.cos(q1) * sp.cos(q2) - sp.sin(q1) * sp.sin(q2), sp.cos(q1 + q2)),
            (sp.sin(q1) * sp.cos(q2), sp.sin(q1) * sp.cos(q2)),
            (1 - sp.cos(q1)**2, sp.sin(q1)**2),
            (sp.tanh(u1) * (sp.sin(q2)**2 - 1), -sp.tanh(u1) * sp.cos(q2)**2)):
        assert shortened([expression], (q1, q2), (u1,)) == [expected]


def test_terms_that_cancel_are_not_expanded_first():
    (q1, q2, m), _ = symbols(['q1', 'q2', 'm'])
    x = m * (sp.sqrt(6) * sp.sin(q2)).subs(q2, 2 * q1)
    for _ in range(40):  # 2^40 terms, if they were
        x = x * sp.sin(q1 + q2)**2 + sp.cos(q1 + q2)**2 * x
    assert shortened([x * sp.sqrt(2)], (q1, q2)) == [2 * sp.sqrt(3) * m * sp.sin(2 * q1)]


def test_a_closed_form_that_fills_pages_is_refused_with_a_way_out(monkeypatch):
    monkeypatch.setattr(polynomials, 'MOST_TERMS', 20)
    with pytest.raises(InputError,
                       match=r'more than 20 terms; expected fewer joints .*--numbers'):
        closed_form(hanging())


def test_numbers_become_exact():
    assert exact(0.1) == sp.Rational(1, 10)
    assert exact(-np.sqrt(0.5)) == -sp.sqrt(2) / 2
    assert exact(1e-7) == sp.Rational(1, 10**7)
    x = Symbolic(sp.Symbol('x'))
    y = (2.0 / x - x / 4.0) * np.array([1.0, 0.5])
    assert [sp.expand(unwrapped(value) - k * (2 / x.value - x.value / 4))
            for value, k in zip(y, (1, sp.Rational(1, 2)))] == [0, 0]


def test_legend_names_every_axis_of_a_shared_moment_of_inertia():
    b = ModelBuilder()
    b.body('rod', inertial=Inertial(1.0, (0, 0, 0), np.diag([0.1, 0.4, 0.4])))
    meaning, = (p.meaning
                for p in closed_form(b.model()).parameters if p.unit == 'kg m^2')
    assert meaning == 'central moment of inertia of rod, yy and zz'
