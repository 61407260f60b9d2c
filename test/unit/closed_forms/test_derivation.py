"""Derivations on paper, evaluated with numbers, agree with Kane's definition."""

import ctypes
from functools import cache
import re
import shutil
import subprocess

from kane_dynamics import Inertial, InputError, ModelBuilder, Robot
from kane_dynamics.closed_forms import derivation, polynomials
from kane_dynamics.closed_forms.derivation_code import as_code
from kane_dynamics.closed_forms.derivation_text import as_data, as_text
from kane_dynamics.closed_forms.polynomials import operations, shortened
from kane_dynamics.closed_forms.symbolic import exact, Symbolic, symbols, unwrapped
from kane_dynamics.mechanics.ball_joints import coordinate_rates
from kane_dynamics.mechanics.definition import kane, kinematics, nonholonomic
from mechanisms import random_model
import numpy as np
import paper_mechanisms
from paper_mechanisms import derived
import pytest
import sympy as sp

ROBOTS = paper_mechanisms.mechanisms()


@cache
def function_of(form):
    """Return the function that the derivation prints as Python."""
    names = {}
    exec(as_code(form, 'python'), names)  # noqa: S102
    return next(value for name, value in names.items() if name.startswith('dynamics_of'))


def close(got, expected, tolerance=1e-12):
    """Check an array relative to its largest entry."""
    size = max(np.abs(expected).max(initial=0.0), 1e-3)
    np.testing.assert_allclose(np.array(got, dtype=float), expected, rtol=0.0,
                               atol=tolerance * size)


def test_sixty_mechanisms_are_derived():
    assert len(ROBOTS) >= 60


@pytest.mark.parametrize('name', ROBOTS)
def test_the_printed_equations_are_the_definition(name):
    robot = ROBOTS[name]
    form = derived(name)
    function = function_of(form)
    mechanism = robot.mechanism
    model = robot.model
    rng = np.random.default_rng(1)
    for seed in range(3):
        q, u, t = paper_mechanisms.state(robot, seed)
        torques = np.zeros(model.n)
        places = [int(str(symbol)[1:]) - 1 for symbol in form.torques]
        torques[places] = rng.normal(size=len(places))
        arguments = {'T': torques[places], 't': t}
        wrenches = None
        if form.wrench:
            wrench = arguments['wrench'] = rng.normal(size=6)
            wrenches = {'tip': (wrench[:3], wrench[3:])}
        if form.auxiliary:
            arguments['udot'] = np.zeros(robot.n)
        qdot, M, f, *_ = function(q, u, **arguments)

        # The definition on numbers: the sums over bodies, projected on the speeds.
        rates, bias_rates = nonholonomic.joint_motion(mechanism, q, u,
                                                      np.zeros(robot.n), t)
        force = kane.generalized_active_force(model, q, rates, tau=torques,
                                              wrenches=wrenches)
        force = force + kane.generalized_inertia_force(model, q, rates, bias_rates)
        close(qdot, coordinate_rates(model, q, rates))
        close(M, nonholonomic.mass_matrix(mechanism, q, t))
        close(f, nonholonomic.nonholonomic_force(mechanism, q, force, t))


@pytest.mark.parametrize(('name', 'axes'), [
    ('zyy False', 'own'), ('zyy False', 'bar0'), ('zy rheonomic', 'own'),
    ('zy rheonomic', 'world'), ('point', 'bar0')])
def test_tables_hold_the_velocities_and_accelerations_in_the_chosen_axes(name, axes):
    robot = ROBOTS[name]
    form = derivation(robot, axes=axes, points=['tip'])
    results = {}
    for kind in ('velocities', 'accelerations', 'partials'):
        for label, matrix in getattr(form, kind).items():
            results[f'{kind} {label}'] = matrix
    q, u, t = paper_mechanisms.state(robot)
    udot = np.linspace(1.0, 2.0, robot.n)
    values = dict(zip(form.q, q)) | {p.symbol: p.value for p in form.parameters}
    values |= {form.u[r]: x for r, x in zip(form.free, u)}
    values |= {form.udot[r]: x for r, x in zip(form.free, udot)}
    values[sp.Symbol('t', real=True)] = t
    rates, accelerations = nonholonomic.joint_motion(robot.mechanism, q, u, udot, t)
    model = robot.model
    bodies = kinematics.configurations(model, q)
    T = nonholonomic.partial_rates(robot.mechanism, q, t)
    for k, (body, motion) in enumerate(zip(
            model.bodies, kinematics.motions(model, bodies, q, rates, accelerations))):
        R = {'own': bodies[k].R_wb, 'world': np.eye(3), 'bar0': bodies[0].R_wb}[axes]
        place = bodies[k]
        partials = np.concatenate([place.partial_angular_velocity @ R,
                                   place.partial_velocity @ R], axis=1).T @ T
        for kind, expected in (
                ('velocities', [*(R.T @ motion.omega), *(R.T @ motion.v_com)]),
                ('accelerations', [*(R.T @ motion.alpha), *(R.T @ motion.a_com)]),
                ('partials', partials.ravel())):
            got = form.expanded(results[f'{kind} {body.name}']).subs(values)
            close(list(got), expected)
    velocity, _ = kinematics.frame_motion(model, model.frame('tip'), q, rates, rates)
    close(list(form.expanded(results['velocities point tip']).subs(values))[3:],
          {'own': bodies[-1].R_wb, 'world': np.eye(3),
           'bar0': bodies[0].R_wb}[axes].T @ velocity[:3])


@pytest.mark.parametrize('name', paper_mechanisms.WITH_ROWS)
def test_forces_of_constraint_rows_are_those_of_the_robot(name):
    robot = ROBOTS[name]
    form = derived(name)
    q, u, t = paper_mechanisms.state(robot)
    tau = np.linspace(0.5, 1.0, robot.n)
    udot = robot.forward_dynamics(q, u, tau)
    torques = robot.joint_torques(tau, q)
    torques = torques[[int(str(symbol)[1:]) - 1 for symbol in form.torques]]
    *_, forces = function_of(form)(q, u, torques, udot, t=t)
    expected = robot.constraint_forces(q, u, tau)[robot.mechanism.kept]
    close(forces, expected, 1e-10)  # of forward dynamics: its conditioning


def test_a_reaction_of_a_joint_is_that_of_the_robot():
    robot = ROBOTS['zyy False']
    names = ['bar0:y', 'bar0:z', 'bar0:rx', 'bar1:x', 'bar1:ry', 'bar1:rz']
    form = derivation(robot, auxiliary=names)
    q, u, _ = paper_mechanisms.state(robot)
    udot = np.array([0.3, -1.0, 2.0])
    torques = robot.inverse_dynamics(q, u, udot)
    *_, forces = function_of(form)(q, u, torques, udot)
    expected = {}
    for joint in ('bar0', 'bar1'):
        wrench = robot.joint_reaction(joint, q, u, udot)
        R = robot.frame_pose(joint, q)[:3, :3]  # bodies have the names of their joints
        components = [*(R.T @ wrench[:3]), *(R.T @ wrench[3:])]
        for direction, component in zip(('x', 'y', 'z', 'rx', 'ry', 'rz'), components):
            expected[f'{joint}:{direction}'] = component
    close(forces, np.array([expected[name] for name in names]), 1e-11)


@pytest.mark.parametrize('name', ['yy True', 'zy wrench', 'zy rheonomic', 'beam',
                                  *paper_mechanisms.WITH_ROWS])
def test_the_printed_c_gives_the_numbers_of_the_printed_python(name, tmp_path):
    compiler = shutil.which('cc')
    if compiler is None:
        pytest.skip('no C compiler (cc) on this machine')
    robot, form = ROBOTS[name], derived(name)
    source = tmp_path / 'equations.c'
    source.write_text(form.code('c'))
    library = tmp_path / 'equations.so'
    subprocess.run([compiler, '-std=c99', '-Wall', '-Wextra', '-Wno-unused-parameter',
                    '-Wno-unused-variable', '-Werror', '-O1', '-shared', '-fPIC',
                    str(source), '-o', str(library), '-lm'], check=True)
    symbol = form.code('c').partition('void ')[2].partition('(')[0]
    function = getattr(ctypes.CDLL(str(library)), symbol)
    rng = np.random.default_rng(2)
    q, u, t = paper_mechanisms.state(robot)
    inputs = [q, u]
    for symbols_of_argument in (form.torques, form.wrench):
        if symbols_of_argument:
            inputs.append(rng.normal(size=len(symbols_of_argument)))
    if form.auxiliary:
        inputs.append(rng.normal(size=robot.n))
    expected = [np.ravel(x) for x in function_of(form)(*inputs, t=t)]
    outputs = [np.full(len(x), np.nan) for x in expected]
    function(*map(np.ctypeslib.as_ctypes, inputs), ctypes.c_double(t),
             *map(np.ctypeslib.as_ctypes, outputs))
    for got, value in zip(outputs, expected, strict=True):
        close(got, value, 1e-13)


def test_the_latex_of_all_kinds_compiles_and_no_line_is_too_wide(tmp_path):
    compiler = shutil.which('pdflatex')
    if compiler is None:
        pytest.skip('no pdflatex on this machine')
    # Among them those with the longest equations.
    forms = [derived(name).latex() for name in (
        'zy rheonomic', 'zy wrench', 'four-bar revolute', 'distance', 'disc', 'top',
        'yyy rheonomic')]
    page = tmp_path / 'page.tex'
    page.write_text('\\documentclass{article}\n\\usepackage{amsmath}\n'
                    f'\\begin{{document}}\n{"".join(forms)}\\end{{document}}\n')
    done = subprocess.run([compiler, '-interaction=nonstopmode', '-halt-on-error',
                           page.name], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-2000:]
    assert (tmp_path / 'page.pdf').stat().st_size > 10_000
    too_wide = re.findall(r'Overfull \\hbox \(([\d.]+)pt', done.stdout)
    assert max(map(float, too_wide), default=0.0) < 5.0, too_wide


def test_all_formats_hold_the_same_equations():
    robot = ROBOTS['sleigh']
    form = derived('sleigh')
    count = robot.operation_count()
    text = as_text(form, count)
    dependent = form.u[form.dependent[0]]
    assert '3. Constraints: ' in text and f"\n{dependent}' = " in text
    assert text.startswith(form.text().partition('\noperations')[0])
    assert form.latex().count(r'\displaystyle') > 10
    assert form.code('c').startswith('#include <math.h>')
    markdown = form.markdown()
    assert '| r | omega of body | v of body |' in markdown
    data = as_data(form, count)
    assert sp.sympify(data['steps']["Kane's equations"]['M11']).free_symbols
    assert set(data['steps']['Letters']) <= set(map(str, form.letters))


def test_numbers_are_exact_and_printed_with_six_digits():
    robot = ROBOTS['zy True']
    form = derivation(robot, numbers=True)
    q, u, _ = paper_mechanisms.state(robot)
    _, M, f = function_of(form)(q, u, np.zeros(2))
    close(M, robot.mass_matrix(q))
    close(f, -robot.bias_force(q, u))
    assert form.parameters == []


def test_expanded_expressions_have_no_letters():
    form = derived('four-bar revolute')
    assert form.M.free_symbols & set(form.letters)
    expanded = form.expanded(form.M)
    assert expanded.free_symbols.isdisjoint(form.letters)
    q, _, _ = paper_mechanisms.state(form.robot)
    values = dict(zip(form.q, q)) | {p.symbol: p.value for p in form.parameters}
    close(np.array(expanded.subs(values), dtype=float), form.robot.mass_matrix(q), 1e-10)


def test_signs_of_roots_are_those_at_the_configuration_and_stated():
    form = derived('disc')
    assert form.conditions == (sp.cos(form.q[4]),)
    assert not form.M.has(sp.Abs) and not form.M.has(sp.sqrt(2))


@pytest.mark.parametrize(('options', 'words'), [
    ({'auxiliary': ['bar0']}, "auxiliary: 'bar0'; expected a constraint row, or"),
    ({'axes': 'nowhere'}, "no frame 'nowhere'"),
    ({'points': ['nowhere']}, "no frame 'nowhere'")])
def test_unknown_names_are_refused(options, words):
    with pytest.raises(InputError, match=words):
        derivation(ROBOTS['yy False'], **options)


def test_the_force_of_a_redundant_row_is_refused():
    robot = ROBOTS['four-bar revolute']
    name = robot.mechanism.labels[robot.mechanism.left_out[0]]
    with pytest.raises(InputError, match=r'a redundant row.*expected one of'):
        derivation(robot, auxiliary=[name])


def test_a_planar_chain_comes_out_in_sums_of_its_angles():
    b = ModelBuilder()
    for k in range(3):
        b.body(f'link{k}', f'link{k - 1}' if k else 'world', axis=(0, 1, 0),
               at=(0.5, 0, 0) if k else (0, 0, 0),
               inertial=Inertial(1 + k, (0.25, 0, 0)))
    form = derivation(Robot(b.model(), friction=False))
    q1, q2, q3 = form.q
    assert form.M.free_symbols.isdisjoint({q1})
    assert form.bias[2].coeff(form.u[0], 0).has(sp.cos(q1 + q2 + q3))


def test_friction_is_left_in_words_and_can_be_left_out():
    b = ModelBuilder(gravity=(0, 0, 0))
    b.body('wheel', damping=2, friction=3, armature=0.5, stiffness=4, rest=-1)
    model = b.model()
    form = derivation(Robot(model))
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
    assert sp.simplify(derivation(Robot(model, friction=False)).bias[0] - spring) == 0


def test_operations_are_counted_after_sharing():
    b = ModelBuilder()
    b.body('link', axis=(0, 1, 0), inertial=Inertial(2, (0.5, 0, 0)))
    # M 0.5; bias -9.81 cos(q1)
    form = derivation(Robot(b.model()), numbers=True)
    assert operations(list(form.M)) == 0
    assert operations(list(form.bias)) == 3  # a sign, a product, a cosine


def test_a_massless_body_has_no_line_in_the_table():
    b = ModelBuilder()
    b.body('table', 'world', 'planar', inertial=Inertial(1))
    table = as_data(derivation(Robot(b.model())))['steps']['Partial velocities']
    assert table == {
        'omega1 of table': ['0', '0', '0'], 'v1 of table': ['cos(q3)', '-sin(q3)', '0'],
        'omega2 of table': ['0', '0', '0'], 'v2 of table': ['sin(q3)', 'cos(q3)', '0'],
        'omega3 of table': ['0', '0', '1'], 'v3 of table': ['0', '0', '0']}


def test_a_mechanism_with_many_coordinates_is_refused_with_a_way_out():
    with pytest.raises(InputError, match=r'10 coordinates; expected 1 to 7.*--joints'):
        derivation(Robot(random_model(0, 10)))


def test_short_forms_are_equal_to_what_they_shorten():
    (q1, q2, u1), _ = symbols(['q1', 'q2', 'u1'])
    for expression, expected in (
            (u1 * sp.sin(q1)**2 + u1 * sp.cos(q1)**2, u1),
            (sp.cos(q1) * sp.cos(q2) - sp.sin(q1) * sp.sin(q2), sp.cos(q1 + q2)),
            (sp.sin(q1) * sp.cos(q2), sp.sin(q1) * sp.cos(q2)),
            (1 - sp.cos(q1)**2, sp.sin(q1)**2),
            (sp.tanh(u1) * (sp.sin(q2)**2 - 1), -sp.tanh(u1) * sp.cos(q2)**2)):
        assert shortened([expression], (u1,)) == [expected]


def test_terms_that_cancel_are_not_expanded_first():
    (q1, q2, m), _ = symbols(['q1', 'q2', 'm'])
    x = m * (sp.sqrt(6) * sp.sin(q2)).subs(q2, 2 * q1)
    for _ in range(40):  # 2^40 terms, if they were
        x = x * sp.sin(q1 + q2)**2 + sp.cos(q1 + q2)**2 * x
    assert shortened([x * sp.sqrt(2)]) == [2 * sp.sqrt(3) * m * sp.sin(2 * q1)]


def test_a_closed_form_that_fills_pages_is_refused_with_a_way_out(monkeypatch):
    monkeypatch.setattr(polynomials, 'MOST_TERMS', 5)
    with pytest.raises(InputError,
                       match=r'more than 5 terms; expected fewer joints .*--numbers'):
        derivation(ROBOTS['universal'])


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
                for p in derivation(Robot(b.model())).parameters if p.unit == 'kg m^2')
    assert meaning == 'central moment of inertia of rod, yy and zz'
